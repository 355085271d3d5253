#!/usr/bin/python3
"""Write the tables of the benchmarks' pages from the JSONs of the last run.

    PYTHONPATH=build/python /usr/bin/python3 benchmarks/page.py

Each table stands between two comments, <!-- table NAME of benchmarks/page.py --> and
<!-- end of table -->, and is what the function NAME below returns for the results. So pages say
nothing that the JSONs do not. run.py calls this script at its end.
"""
import argparse
import json
import math
import pathlib
import re

import growth
import planes

ROOT = pathlib.Path(__file__).resolve().parents[1]
RESULTS = ROOT/'benchmarks'/'results'
PAGES = ('benchmarks/README.md', 'docs/how_cost_grows.md', 'docs/schemes/README.md',
         'docs/guide/lubrication.md')
TABLE = re.compile(r'(<!-- table (\w+) of benchmarks/page.py -->\n).*?\n?(<!-- end of table -->)',
                   re.S)
AVX2 = 'avx2/'
UNITS = (('s', 1), ('ms', 1e-3), ('µs', 1e-6), ('ns', 1e-9))


class Results:
    """The JSONs of a folder by name, as results('water_step') or results('avx2/free_bodies')."""
    def __init__(self, folder):
        self.folder = folder

    def __call__(self, name):
        return json.loads((self.folder/f'{name}.json').read_text())

    def has(self, name):
        return (self.folder/f'{name}.json').exists()


def number(value, digits=2):
    """A number with so many significant digits, not in powers of ten."""
    if value == 0:
        return '0'
    places = max(0, digits - 1 - math.floor(math.log10(abs(value)) + 1e-12))
    return f'{float(f"{value:.{digits}g}"):,.{places}f}'


def seconds(value, digits=2):
    """Seconds with a unit that suits them."""
    for unit, scale in UNITS:
        if value >= 0.9995*scale or unit == UNITS[-1][0]:
            return f'{number(value/scale, digits)} {unit}'


def spread(values, digits=2, scale=1):
    """Median, and quartiles in parentheses where they differ from it as printed."""
    middle, low, high = (number(scale*value, digits)
                         for value in (values['median'], *values['quartiles']))
    return middle if low == high == middle else f'{middle} ({low} … {high})'


def tolerance(value):
    """A tolerance as the pages write it: 1e-3."""
    return f'1e{round(math.log10(value))}'


def rows(head, lines):
    """A table in Markdown from texts."""
    return '\n'.join('| ' + ' | '.join(map(str, line)) + ' |'
                     for line in (head, *lines)).replace('|\n', '|\n|' + '---|'*len(head) + '\n', 1)


def verdict(isReached):
    return '**reached**' if isReached else '**not reached**'


def slope(points):
    """The exponent of a line through the logarithms of (number, time)."""
    xs, ys = ([math.log(p[i]) for p in points] for i in (0, 1))
    x, y = sum(xs)/len(xs), sum(ys)/len(ys)
    return sum((a - x)*(b - y) for a, b in zip(xs, ys))/sum((a - x)**2 for a in xs)


# ---- The run -------------------------------------------------------------------------------------


def run(results):
    machine, parts = results('run')['machine'], results('run')['parts']
    loads = [load for part in parts for load in part['load_averages']]
    total = results('run')['seconds']
    failed = [part['part'] for part in parts if part['failed']]
    text = (f'The run began on {machine["date"]}, on {machine["cores"]} cores of an '
            f'{machine["processor"]} with {"AVX-512" if machine["avx512"] else "AVX2"} (Linux, '
            f'Python {machine["python"]}, OpenMM {machine["openmm"]}, openmm-rigidhi '
            f'{machine["openmmrigidhi"]}), and its parts took {round(total/60)} minutes.\n'
            f'The load average before and after the parts, which contains the run itself, was '
            f'{min(loads):.2g} to {max(loads):.2g}.')
    if failed:
        text += '\nThese parts failed: ' + ', '.join(failed) + '.'
    return text


def parts(results):
    return rows(
        ('part', 'seconds', 'load average before and after'),
        ((part['part'] + (', with AVX2' if part['avx2'] else ''), part['seconds'], ' and '.join(
            map(str, part['load_averages']))) for part in results('run')['parts']))


# ---- Few bodies, water, platforms ----------------------------------------------------------------


def few(results):
    """The cost of one or two bodies on Reference and on CPU."""
    one = {
        row['platform']: row
        for row in results('platforms')['rows'] if row['scene'] == 'one body'
    }
    boomerang, dense = results('overdamped')['one'], results('langevin_hi')['dense']
    lines = [('a water molecule without forces, LangevinC, the whole step',
              *(spread(one[p]['microseconds_ours']) for p in ('Reference', 'CPU'))),
             ('the same without OpenMM\'s evaluation of forces',
              *(spread(one[p]['microseconds_without_forces']) for p in ('Reference', 'CPU')))]
    for scheme in ('FixmanMidpoint', 'TrapezoidalSlip'):
        lines.append(
            (f'a boomerang of 15 blobs above a wall, {scheme}, without forces',
             *(spread(boomerang[p][scheme]['microseconds_step']) for p in ('Reference', 'CPU'))))
    for bodies in ('2', '10'):
        lines.append(
            (f'{bodies} spheres, RotnePragerYamakawa, LangevinHI, without forces',
             *(spread(dense[p][bodies]['microseconds_step']) for p in ('Reference', 'CPU'))))
    return rows(('a step of', 'Reference, µs', 'CPU, µs'), lines)


def water(results):
    lines = []
    for name, text in (('water_step_1728_threads2',
                        '2 threads'), ('water_step_1728_threads2_no_cm_removal',
                                       '2 threads, without CMMotionRemover'),
                       ('water_step_1728_threads1', '1 thread'), (AVX2 + 'water_step_1728_threads2',
                                                                  '2 threads, AVX2')):
        if not results.has(name):
            continue
        found = results(name)
        times = found['milliseconds_per_step']
        lines.append(
            (text, *(spread(times[key], 3)
                     for key in ('LangevinC', 'LangevinMiddle + SETTLE', 'Verlet + SETTLE')),
             *(spread(found['ratio_of_steps']['LangevinC / ' + key])
               for key in ('LangevinMiddle + SETTLE', 'Verlet + SETTLE')),
             spread(found['own_share_of_step']['LangevinC, by its timer'], 2, 100) + ' %'))
    return rows(('', 'LangevinC, rigid bodies, ms', 'LangevinMiddle, SETTLE, ms',
                 'Verlet, SETTLE, ms', 'over LangevinMiddle', 'over Verlet', 'own part'), lines)


def platforms(results):
    return rows(
        ('scene', 'platform', 'LangevinC, rigid bodies, µs', 'Verlet, constraints, µs', 'more, µs'),
        ((row['scene'], row['platform'] + (' ' + row['Precision'] if 'Precision' in row else ''),
          *(spread(row['microseconds_' + key]) for key in ('ours', 'verlet', 'more')))
         for row in results('platforms')['rows']))


# ---- Free bodies ---------------------------------------------------------------------------------

SHAPES = {
    'general3': 'three axes, three sites',
    'ellipsoid': 'three axes, one site',
    'linear2': 'linear, two sites',
    'point': 'point'
}
COUNTS = (1, 10, 100, 1000, 10000)


def freeTimes(results, platform, key, name='free_bodies'):
    medians = results(name)['medians']
    return [
        (text,
         *(number(medians[f'FreeBodies/{platform}/{shape}/LangevinC/n:{count}/real_time'][key], 3)
           for count in COUNTS)) for shape, text in SHAPES.items()
    ]


def free(results):
    head = tuple(f'{count:,}' for count in COUNTS)
    text = [
        rows(('ns a body and step, own part, CPU, 1 thread', *head),
             freeTimes(results, 'CPU', 'own_time_per_body'))
    ]
    if results.has(AVX2 + 'free_bodies'):
        text.append(
            rows(('the same with AVX2', *head),
                 freeTimes(results, 'CPU', 'own_time_per_body', AVX2 + 'free_bodies')))
    text.append(
        rows(('ns a body and step, whole step, Reference', *head),
             freeTimes(results, 'Reference', 'time_per_body')))
    return '\n\n'.join(text)


def schemesOfFreeBodies(results):
    medians = results('free_bodies')['medians']
    names = ('LangevinA', 'LangevinB', 'LangevinC', 'LangevinC_ThreePoint',
             'LangevinC_without_friction', 'GradientThermostat')
    return rows(
        ('own part, 1000 bodies of three sites', 'CPU, ns a body', 'Reference, ns a body'),
        ((name.replace('_ThreePoint', ', three-point noise').replace('_', ' '), *(number(
            medians[f'FreeBodies/{platform}/general3/{name}/n:1000/real_time']['own_time_per_body'],
            3) for platform in ('CPU', 'Reference'))) for name in names))


def pieces(results):
    numbers, fit = results('random_numbers')['medians'], results('pose_fit')['medians']
    lines = []
    for key, text in (('0 Gaussian', 'Gaussian'), ('1 ThreePoint', 'three-point'), ('2 TwoPoint',
                                                                                    'two-point')):
        lines.append((f'a {text} random number, in packs; one at a time',
                      *(number(numbers[f'{way}/{key}']['time_per_number'], 2)
                        for way in ('inPacks', 'oneAtATime'))))
    for shape, text in (('triangle', 'three sites'), ('ring42', '42 sites'), ('line', 'a line'),
                        ('point', 'a point')):
        lines.append((f'the pose of a body of {text} from its particles; its twist',
                      *(number(fit[f'{what}/{shape}']['time'], 2) for what in ('pose', 'twist'))))
    return rows(('', 'ns', 'ns'), lines)


def lammps(results):
    found = results('lammps_compare')
    lines = []
    for row in found['speed']:
        times = row['ns_per_body_and_step']
        lines.append((f'{row["bodies"]:,}',
                      *(spread(times[key], 3)
                        for key in ('LAMMPS', 'here, CPU, Gaussian noise',
                                    'here, CPU, three-point noise', 'here, Reference')),
                      spread(row['LAMMPS_over_here']['here, CPU, Gaussian noise'])))
    text = rows(('free bodies', 'LAMMPS, ns', 'CPU, Gaussian noise, ns', 'CPU, three-point, ns',
                 'Reference, ns', 'LAMMPS over CPU, Gaussian'), lines)
    physics = found['physics']['kinetic_temperature_over_kT']
    return text + '\n\n' + rows(
        ('kinetic temperature over kT in a trap', 'exact', 'LAMMPS', 'here'),
        ((name, f'{row["expected"]:.4g}', *(f'{row[who][0]:.4f} ± {row[who][1]:.4f}'
                                            for who in ('LAMMPS', 'here')))
         for name, row in physics.items()))


# ---- Hydrodynamic interactions -------------------------------------------------------------------


def langevin(results):
    text = []
    for name, note in (('langevin_hi', ''), (AVX2 + 'langevin_hi', ', with AVX2')):
        if not results.has(name):
            continue
        dense = results(name)['dense']
        text.append(
            rows((f'spheres, dense, one thread{note}', *dense['CPU']),
                 (('a step, CPU', *(seconds(1e-6*row['microseconds_step']['median'])
                                    for row in dense['CPU'].values())),
                  ('`numpy.linalg.eigh` of the same size',
                   *(seconds(1e-6*row['microseconds_eigh']['median'])
                     for row in dense['CPU'].values())),
                  ('ratio, CPU', *(spread(row['ratio']) for row in dense['CPU'].values())),
                  ('ratio, Reference', *(spread(row['ratio'])
                                         for row in dense['Reference'].values())),
                  )))
        free = results(name)['matrix_free']
        of = free['spheres']
        text.append(
            rows((f'spheres, matrix-free, 1e-3, {free["threads"]} threads{note}', *(f'{int(n):,}'
                                                                                    for n in of)),
                 (('a step', *(seconds(row['seconds_step']['median']) for row in of.values())),
                  ('iterations', *(number(row['iterations_per_step']) for row in of.values())),
                  ('peak memory of the process, MB', *(row['peak_memory_MB']
                                                       for row in of.values())))))
    return '\n\n'.join(text)


def price(results, names):
    """The price of each effect for several numbers of bodies."""
    found = [results(name) for name in names]
    head = ('effect', 'compared with', *(f'{one["bodies"]} bodies' for one in found))
    return rows(head, ((effect, found[0]['price'][effect]['without'], *(spread(one['price'][effect])
                                                                        for one in found))
                       for effect in found[0]['price']))


def effects(results):
    return price(results, [f'effects_{n}_CPU' for n in (8, 27, 64)])


def effectsPeriodic(results):
    return price(results, [f'effects_periodic_{n}_CPU' for n in (27, 216, 1000)])


def overdamped(results):
    found = results('overdamped')
    lines = []
    for scheme in found['one']['Reference']:
        many = found['interacting']['4.0'].get(scheme)
        lines.append((f'[`{scheme}`]({scheme}.md)',
                      *(number(found['one'][p][scheme]['microseconds_step']['median'], 3)
                        for p in ('Reference', 'CPU')),
                      number(many['milliseconds_step']['median'], 3) if many else '–',
                      number(many['solverIterations']) if many else '–'))
    return rows(('scheme', 'one boomerang, Reference, µs', 'one boomerang, CPU, µs',
                 '64 that interact, CPU, ms', 'iterations'), lines)


def boomerangs(results):
    lines = []
    for name, note in (('overdamped', ''), (AVX2 + 'overdamped', ', AVX2')):
        if not results.has(name):
            continue
        found = results(name)
        for platform, schemes in found['one'].items():
            lines.append((f'one, {platform}{note}, µs', *(spread(row['microseconds_step'], 3)
                                                          for row in schemes.values())))
        for apart, schemes in found['interacting'].items():
            lines.append(
                (f'64, {apart} µm apart, CPU{note}, ms',
                 *(spread(schemes[scheme]['milliseconds_step'], 3) if scheme in schemes else '–'
                   for scheme in found['one']['Reference'])))
    return rows(('boomerangs', *results('overdamped')['one']['Reference']), lines)


def replicas(results):
    of = results('overdamped')['replicas']
    return rows(('replicas of one boomerang, RandomFiniteDifference, Reference', *of),
                (('µs a step and replica', *(spread(row['microseconds_step_and_body'], 3)
                                             for row in of.values())),))


# ---- Products ------------------------------------------------------------------------------------


def products(results):
    found = {(row['kind'], row['instructions'], row['n'], row['columns'], row['threads']): row
             for row in results('products')['rows']}
    sets = sorted({key[1] for key in found})
    widest = 'AVX-512' if results('products')['machine']['avx512'] else 'AVX2'
    lines = []
    for kind, text in (('Blobs', 'blobs'), ('Spheres', 'spheres'),
                       ('BlobsAtWall', 'blobs above a wall'), ('SpheresAtWall',
                                                               'spheres above a wall')):
        for threads in (1, 2):
            cells = []
            for instructions in sets:
                for columns in (1, 2):
                    row = found[kind, instructions, 10000, columns, threads]
                    cells.append(f'{number(row["ours_ms"], 3)}; {number(row["rough_ms"], 3)} '
                                 f'({row["rate_over_plain"]:.2f})')
            lines.append((f'{text}, {threads} thread' + 's'*(threads > 1), *cells))
    rates = [row['rate_over_plain'] for row in found.values()]
    goal = results('products')['goal_of_rate']
    return rows(
        ('n = 10,000, ms', *(f'{widest if name == "best" else name}, {columns} column' + 's'*
                             (columns > 1) for name in sets for columns in (1, 2))), lines
    ) + (
        f'\n\nThe goal was {goal:g} of the plain loop\'s rate: {verdict(min(rates) >= goal)}, with '
        f'{min(rates):.2f} to {max(rates):.2f} of it in {len(rates)} cases (n = 1000 and 10,000).')


def matrices(results):
    of = {
        key.split('/real_time')[0]: row
        for key, row in results('rotne_prager_yamakawa')['medians'].items()
    }
    names = {
        'matrix/Spheres/n:1000/threads:1': 'the matrix of 1000 spheres',
        'matrix/Spheres/n:1000/threads:2': 'the same with two threads',
        'matrix/SpheresAtWall/n:1000/threads:1': 'the matrix of 1000 spheres above a wall',
        'scalarBlobs/15': 'the matrix of 15 blobs, one pair at a time (Reference)',
        'scalarBlobsAtWall/15': 'the same above a wall'
    }
    return rows(('', 'ns a pair'),
                ((text, number(of[key]['time_per_pair'], 3)) for key, text in names.items()))


def multipoles(results):
    of = {
        key.split('/threads')[0]: {
            'time': row.get('time_per_product', row.get('time_per_placement')),
            **row
        }
        for key, row in results('fast_sum')['medians'].items()
    }

    def row(kind, n, text):
        cells = [f'{n:,} {text}']
        for digits in (3, 6):
            found = of[f'product/{kind}/n:{n}/digits:{digits}']
            cells += [seconds(1e-9*found['time']), f'{found["error"]:.1e}']
        return (*cells, seconds(1e-9*of[f'pairs/{kind}/n:{n}/digits:6']['time']))

    lines = [row('Blobs', n, 'blobs') for n in (10000, 30000, 100000)]
    lines += [
        row(kind, 30000, text)
        for kind, text in (('Spheres', 'spheres'), ('BlobsAtWall', 'blobs above a wall'),
                           ('SpheresAtWall', 'spheres above a wall'))
    ]

    def power(key):
        return slope([(n, of[key.format(n)]['time']) for n in (10000, 100000)])

    return rows(
        ('', 'multipoles to 1e-3', 'error found', 'to 1e-6', 'error found', 'all pairs, floats'),
        lines
    ) + (
        f'\n\nFrom 10,000 to 100,000 blobs the time of a product to 1e-3 grows with the power '
        f'{power("product/Blobs/n:{}/digits:3"):.2f} of their number, and the time of all pairs '
        f'with the power {power("pairs/Blobs/n:{}/digits:6"):.2f}.\n'
        f'All pairs of 100,000 take {seconds(1e-9*of["pairs/Blobs/n:100000/digits:0"]["time"])} in '
        f'double precision.\n'
        f'A new placement of 100,000 particles takes '
        f'{seconds(1e-9*of["placement/Blobs/n:100000/digits:3"]["time"])} in addition to the '
        f'products, and {number(of["product/Blobs/n:100000/digits:3"]["megabytes"])} MB (1e-3) or '
        f'{number(of["product/Blobs/n:100000/digits:6"]["megabytes"])} MB (1e-6) of memory.')


# ---- Grids ---------------------------------------------------------------------------------------


def gridProducts(results):
    of = results('grid_fluid')['medians']
    kinds = ('sixTransforms', 'product', 'roughProduct', 'randomField', 'average',
             'averageGradients', 'stencils')
    sizes = (1000, 10000, 22363, 100000)
    lines, ratios = [], []
    for n in sizes:
        times = {kind: of[f'{kind}/{n}']['time'] for kind in kinds}
        ratios.append([times[kind]/times['sixTransforms'] for kind in ('product', 'roughProduct')])
        lines.append((f'{n:,}', *(number(1e-6*times[kind], 3)
                                  for kind in kinds), *(f'{ratio:.2f}' for ratio in ratios[-1])))
    power = slope([(n, of[f'product/{n}']['time']) for n in sizes])
    goal = 1.6
    return rows(
        ('blobs', 'six transforms, FFTW_MEASURE', 'product', 'rough product', 'random field',
         'average', 'gradients', 'stencils', 'product over six transforms',
         'rough product over them'), lines
    ) + (
        f'\n\nThe goal was a product of at most {goal} times its six transforms: '
        f'{verdict(max(r[0] for r in ratios) <= goal)} (at most '
        f'{max(r[0] for r in ratios):.2f}), and in single precision '
        f'{verdict(max(r[1] for r in ratios) <= goal)} (at most {max(r[1] for r in ratios):.2f}).\n'
        f'The time of products grows as N^{power:.2f} (goal: 1.1, {verdict(power <= 1.1)}).')


def gridSteps(results):
    lines = []
    steps = results('grid_steps')['steps']
    for row in steps:
        shares = (100*row[f'seconds_{part}']/row['seconds_mobility']
                  for part in ('spreading', 'fft', 'averaging', 'solver'))
        lines.append((f'{row["blobs"]:,}', f'{row["iterations"]:.3g}', seconds(
            row['seconds'], 3), f'{row["step_over_its_transforms"]:.2f}',
                      *(f'{share:.0f} %' for share in shares), f'{number(row["gigabytes"])} GB'))
    most = max(row['step_over_its_transforms'] for row in steps)
    memory = max(row['gigabytes'] for row in steps)
    return rows(
        ('blobs', 'n', 'a step', 'over its transforms', 'spreading', 'transforms', 'averaging',
         'solver', 'memory'), lines
    ) + (
        f'\n\nThe goals were 1.7 times the transforms, {verdict(most <= 1.7)} (at most {most:.2f}),'
        f' and 4 GB for 100,000 blobs, {verdict(memory <= 4)}.')


def breakEven(results):
    times = {}
    for case in results('grid_break_even')['cases']:
        times.setdefault((case['volume_fraction'], case['what']),
                         {}).setdefault(case['blobs'], {})[case['solver']] = case['seconds']
    return rows(('volume fraction', 'step', 'lattice sums over grid'),
                ((fraction, what, ', '.join(f'{n}: {number(of["Dense"]/of["MatrixFree"])}'
                                            for n, of in sizes.items()))
                 for (fraction, what), sizes in times.items()))


def splitSteps(results):
    found = results('split_ewald_steps')['rows']
    numbers = list(found[0]['dense_over_grid'])
    return rows(('', 'volume fraction', 'tolerance', 'scheme', *numbers),
                ((row['what'], row['volume_fraction'], tolerance(
                    row['tolerance']), row['scheme'], *(number(row['dense_over_grid'][n])
                                                        for n in numbers)) for row in found))


def splitProducts(results):
    of = results('split_ewald')['medians']
    kinds = ('product', 'roughProduct', 'productWithTorques', 'forceCoupling', 'sixTransforms',
             'makingPairs', 'makingWeights', 'noise', 'noiseByOneRoot')

    def time(kind, n, digits):
        found = [
            row['time'] for key, row in of.items()
            if key.startswith(f'{kind}/{n}/{digits}') and key.split('/')[2] == str(digits)
        ]
        return found[0] if found else None

    lines, beside, inProducts = [], [], []
    for n in (1000, 10648, 103823):
        for digits in (3, 4, 6):
            times = {kind: time(kind, n, digits) for kind in kinds}
            beside.append(times['product']/times['forceCoupling'])
            if times['noise']:
                inProducts.append(times['noise']/times['product'])
            lines.append(
                (f'{n:,}', f'1e-{digits}',
                 *('' if times[kind] is None else number(1e-6*times[kind], 3) for kind in kinds)))
    powers = [
        slope([(n, time('product', n, digits)) for n in (1000, 10648, 103823)])
        for digits in (3, 4, 6)
    ]
    return rows(
        ('particles', 'tolerance', 'product', 'rough product', 'with torques', 'force coupling',
         'six transforms', 'making pairs', 'making weights', 'noise',
         'noise by one root of the whole matrix'), lines
    ) + (f'\n\nA product takes {number(min(beside))} to {number(max(beside))} of force coupling\'s '
         f'time, because its grid is coarser: its Gaussians need not be as narrow as particles.\n'
         f'Its time grows as N^{min(powers):.2f} to N^{max(powers):.2f}.\n'
         f'Noise takes as long as {number(min(inProducts))} to {number(max(inProducts))} products.')


def lubricated(results):
    avx2 = {}
    if results.has(AVX2 + 'lubricated_steps'):
        avx2 = {
            tuple(row[key] for key in ('scene', 'spheres', 'volume_fraction', 'model', 'scheme',
                                       'tolerance', 'sheared')): row['seconds']
            for row in results(AVX2 + 'lubricated_steps')['rows']
        }
    lines = []
    of = results('lubricated_steps')['rows']
    for row in of:
        key = tuple(row[key] for key in ('scene', 'spheres', 'volume_fraction', 'model', 'scheme',
                                         'tolerance', 'sheared'))
        lines.append((row['scene'] + (', in shear' if row['sheared'] else ''),
                      f'{row["spheres"]:,}', row['volume_fraction'], row['model'], row['scheme'],
                      tolerance(row['tolerance']), f'{row["mobilityProducts"]:.1f}',
                      seconds(row['seconds']), seconds(avx2[key]) if key in avx2 else '',
                      seconds(row['seconds_of_stress']) if 'seconds_of_stress' in row else ''))
    plain = [(row['spheres'], row['seconds']) for row in of
             if (row['scene'], row['volume_fraction'], row['model'], row['scheme'],
                 row['tolerance'], row['sheared']) == ('random', 0.3, 'StokesianDynamics',
                                                       'TractionEulerMaruyama', 1e-3, False)]
    thousand, most = plain[0][1]*1000/plain[0][0], plain[-1][1]
    return rows(
        ('scene', 'spheres', 'volume fraction', 'model', 'scheme', 'tolerance', 'products',
         'a step', 'with AVX2', 'stress'), lines
    ) + (f'\n\nThe goals were 0.3 s for 1000 spheres, {verdict(thousand <= 0.3)} '
         f'({number(thousand)} s by the time a sphere), and 6 s for 10,000, '
         f'{verdict(most*10000/plain[-1][0] <= 6)} ({number(most)} s for {plain[-1][0]:,}), at a '
         f'volume fraction of 0.3 and a tolerance of 1e-3.\n'
         f'The time grows as the number of spheres to the power {slope(plain):.2f}.')


def autoChoice(results):
    found = results('auto_choice')['rows']
    columns = sorted({(row['volume_fraction'], row['tolerance']) for row in found}, reverse=True)
    cells = {}
    for row in found:
        what = {'cubes': 'blobs in cubes'}.get(row['what'], row['what'])
        key = row['model'], row['scheme'], f'{row["particles"]} {what}'
        cells.setdefault(
            key, {})[row['volume_fraction'],
                     row['tolerance']] = (number(row['seconds_matrices']/row['seconds_grid']) +
                                          (' (m)' if row['auto'] == 'matrices' else ''))

    def factors(times):
        ratios = [time/min(row['seconds_matrices'], row['seconds_grid']) for time, row in times]
        return math.exp(sum(map(math.log, ratios))/len(ratios)), max(ratios)

    taken = factors((row['seconds_' + row['auto']], row) for row in found)
    grid = factors((row['seconds_grid'], row) for row in found)
    return rows(
        ('model', 'scheme', 'particles', *(f'{fraction:g}, {tolerance(eps)}'
                                           for fraction, eps in columns)),
        ((*key, *(cell[column] for column in columns)) for key, cell in cells.items())
    ) + (f'\n\nIn {len(found)} cases `Auto` takes {taken[0]:.2f} times the time of the faster way '
         f'(geometric mean), and at worst {number(taken[1])} times.\n'
         f'Always taking a grid would take {grid[0]:.2f} times the time of the faster way, and at '
         f'worst {number(grid[1])} times.')


def channelSteps(results):
    return rows(
        ('blobs', 'width', 'tolerance', 'nodes', 'a step', 'spreading', 'transforms', 'averaging',
         'solver'),
        ((f'{row["blobs"]:,}', f'{number(row["width_in_radii"], 3)} a', row['tolerance'],
          re.search(r'\d.*\d', row['grid']).group().replace('x', '×'), seconds(
              row['seconds'], 3), *(f'{100*row[f"seconds_{part}"]/row["seconds_mobility"]:.0f} %'
                                    for part in ('spreading', 'fft', 'averaging', 'solver')))
         for row in results('channel_steps')['steps']))


def byImages(results):
    of = results('slip_channel')['medians']

    def time(kind, case):
        return next(row['time'] for key, row in of.items() if key.startswith(f'{kind}/{case} '))

    cases = ((1000, 8), (8000, 20), (32000, 80))
    names = (('product', 'product'), ('roughProduct', 'rough product'),
             ('randomField', 'random field'), ('average', 'average'), ('stencils', 'stencils'))
    return rows(
        ('times faster than by images, tolerance 1e-2; 1e-3', *(f'{n:,} blobs, {width} a wide'
                                                                for n, width in cases)),
        ((text, *('; '.join(
            number(
                time(f'{kind} by images', f'{n}/{width}/{digits}')/
                time(kind, f'{n}/{width}/{digits}')) for digits in (2, 3)) for n, width in cases))
         for kind, text in names))


def transforms(results):
    of = results('slip_channel')['medians']
    periods = (32, 64, 140, 256)
    names = (('wholePeriod', 'complex transform of the period'),
             ('halfPeriod', 'complex transform of half the length'), ('cosines', 'REDFT10'),
             ('sines', 'RODFT10'), ('cosinesFromWall', 'REDFT00, nodes on the walls'),
             ('sinesFromWall', 'RODFT00, nodes on the walls'))
    return rows(('nodes across the channel', *periods),
                ((text, *(seconds(1e-9*of[f'{kind}/{period}']['time']) for period in periods))
                 for kind, text in names))


def periodic(results):
    found = {(row['spheres'], row['model']): row for row in results('periodic')['cases']}
    numbers = sorted({key[0] for key in found})
    models = list(dict.fromkeys(key[1] for key in found))
    return rows(
        ('spheres', *(f'{n:,}' for n in numbers)),
        ((model, *('–' if
                   (n, model) not in found else f'{number(found[n, model]["seconds_cold"])}, '
                   f'{number(found[n, model]["seconds_with_noise"])} s; '
                   f'{number(found[n, model]["gigabytes"])} GB' for n in numbers))
         for model in models))


def growthTable(results):
    return growth.table(results('growth'))


def growthAvx2(results):
    wide = {(s['what'], s['model'], s['boundary'], s['solver']): s
            for s in results('growth')['series']}
    ratios = {}
    for series in results(AVX2 + 'growth')['series']:
        key = series['what'], series['model'], series['boundary'], series['solver']
        beside = {row['number']: row['seconds'] for row in wide[key]['rows']}
        for row in series['rows']:
            if row['number'] >= 300 and row['number'] in beside:
                ratios.setdefault((series['solver'], series['boundary']),
                                  []).append(row['seconds']/beside[row['number']])
    return rows(
        ('solver', 'boundary', 'AVX2 over AVX-512, geometric mean', 'least', 'most'),
        ((*key, *(f'{value:.2f}'
                  for value in (math.exp(sum(map(math.log, of))/len(of)), min(of), max(of))))
         for key, of in ratios.items()))


def confined(results):
    numbers = (1000, 3000, 10000, 30000, 100000)
    lines = []
    for series in results('confined')['series']:
        found = {
            min(numbers, key=lambda n: abs(math.log(row['number']/n))): row['seconds']
            for row in series['rows']
        }
        lines.append(
            (series['model'], series['boundary'], *(seconds(found[n]) if n in found else '–'
                                                    for n in numbers),
             '–' if series['exponent'] is None else f'{series["exponent"]:.2f}'))
    return rows(('model', 'boundary', *(f'{n:,}' for n in numbers), 'exponent'), lines)


def planesTables(results):
    return '\n'.join(planes.tables(results('planes')))


def rollers(results):
    times = {}
    for row in results('rollers')['rows']:
        times.setdefault((row['boundary'], row['model'], row['solver']),
                         {})[row['lubrication']] = row['seconds']
    return rows(('boundary', 'model', 'solver', 'without lubrication', 'with lubrication'),
                ((f'`{boundary}`', model, f'`{solver}`', seconds(of['Off']), seconds(of['On']))
                 for (boundary, model, solver), of in times.items()))


# ---- Other programs ------------------------------------------------------------------------------


def multiblobs(results):
    lines = []
    for row in results('multiblob_compare')['rows']:
        where = f'{row["bodies"]} boomerangs, {row["apart_um"]:g} µm apart' \
            if row['bodies'] > 1 else 'one boomerang'
        lines.append((f'{where}, {row["scheme"]}', '1e-3' if row['bodies'] > 1 else '–',
                      *(spread(row[key], 3)
                        for key in ('their_ms_step', 'our_ms_step')), spread(row['ratio'])))
    for row in results('multiblob_solve')['rows']:
        what = 'a solve' if row['what'] == 'solve' else row['what']
        lines.append(
            (f'{row["shells"]} shells of {row["blobs"]} blobs, {row["layer"]}, {what}',
             tolerance(row['tolerance']), *(spread(row[key], 3) for key in ('their_ms', 'our_ms')),
             spread(row['ratio'])))
    return rows(('', 'tolerance', 'RigidMultiblobsWall, ms', 'here, ms', 'times faster'), lines)


def ensemble(results):
    return rows(('workers', 'overhead of a task of 30 s', 'two workers over one'),
                (({
                    'processes': 'plain processes',
                    'local': 'dask.distributed'
                }[name], f'{100*row["overhead"]:.2f} %', f'{row["scaling_of_two_workers"]:.2f}')
                 for name, row in results('ensemble')['clusters'].items()))


def goals(results):
    """Each goal with what was measured."""
    lines = []

    def add(goal, measured, isReached):
        lines.append((goal, measured, verdict(isReached)))

    wide = results('water_step_1728_threads2')
    own = wide['own_share_of_step']['LangevinC, by its timer']
    add('own part at most 2 % of the water step, 2 threads',
        spread(own, 2, 100) + ' %', own['median'] <= 0.02)
    ratio = wide['ratio_of_steps']['LangevinC / LangevinMiddle + SETTLE']
    add('a whole water step no slower than LangevinMiddle\'s with SETTLE',
        spread(ratio) + ' times', ratio['median'] <= 1)
    of = results('free_bodies')['medians']
    times = [
        of[f'FreeBodies/CPU/{shape}/LangevinC/n:10000/real_time']['own_time_per_body']
        for shape in ('general3', 'ellipsoid')
    ]
    add('at most 100 ns a free body and step, 10,000 bodies of three sites; ellipsoids',
        '; '.join(f'{number(time, 3)} ns' for time in times),
        max(times) <= 100)
    for platform, dense in results('langevin_hi')['dense'].items():
        add(
            f'dense LangevinHI step, {platform}: at most 3 eigendecompositions for 2 and 10 '
            f'bodies, 1.3 for 50 and 200',
            ', '.join(number(row['ratio']['median']) for row in dense.values()),
            all(row['ratio']['median'] <= row['goal'] for row in dense.values()))
    for n, row in results('langevin_hi')['matrix_free']['spheres'].items():
        if row['goal']:
            add(f'matrix-free LangevinHI step of {int(n):,} spheres at 1e-3: {row["goal"]} s',
                spread(row['seconds_step']) + ' s', row['seconds_step']['median'] <= row['goal'])
    for platform, schemes in results('overdamped')['one'].items():
        with_goals = {name: row for name, row in schemes.items() if row['goal']}
        add(
            f'one boomerang above a wall, {platform}, µs: ' +
            ', '.join(f'{name} {row["goal"]}' for name, row in with_goals.items()),
            ', '.join(number(row['microseconds_step']['median'], 3) for row in with_goals.values()),
            all(row['microseconds_step']['median'] <= row['goal'] for row in with_goals.values()))
    for apart, schemes in results('overdamped')['interacting'].items():
        row = schemes['TrapezoidalSlip']
        add(
            f'64 boomerangs {apart} µm apart, TrapezoidalSlip, 1e-3, 2 threads: '
            f'{row["goal"]:.3g} ms',
            spread(row['milliseconds_step'], 3) + ' ms',
            row['milliseconds_step']['median'] <= row['goal'])
    if results.has('multiblob_compare'):
        many = [
            row['ratio']['median'] for row in results('multiblob_compare')['rows']
            if row['bodies'] > 1
        ]
        add('64 boomerangs beside RigidMultiblobsWall in one run: 8 times faster',
            ', '.join(map(number, many)),
            min(many) >= 8)
    if results.has('multiblob_solve'):
        found = results('multiblob_solve')['rows']
        for what, goal in (('a solve', 5), ('a step', 8)):
            ratios = [
                row['ratio']['median'] for row in found
                if (row['what'] == 'solve') == (what == 'a solve')
            ]
            add(
                f'shells of blobs above a wall beside RigidMultiblobsWall, {what}: {goal} times '
                f'faster', f'{number(min(ratios))} to {number(max(ratios))}',
                min(ratios) >= goal)
    if results.has('ensemble'):
        of = results('ensemble')['clusters'].values()
        add(
            'a study of `openmmrigidhi.ensemble`: overhead below 1 % of tasks of 30 s; two workers '
            '1.8 times as fast as one',
            ', '.join(f'{100*row["overhead"]:.2f} % and {row["scaling_of_two_workers"]:.2f}'
                      for row in of),
            all(row['overhead'] < 0.01 and row['scaling_of_two_workers'] >= 1.8 for row in of))
    return rows(('goal (ratios in one run)', 'measured', ''), lines)


# ---- Pages ---------------------------------------------------------------------------------------


def filled(text, results, missing=None):
    """The text of a page with its tables; tables whose JSONs are missing stay as they are."""
    def replace(match):
        begin, name, end = match.groups()
        try:
            return begin + globals()[name](results) + '\n' + end
        except FileNotFoundError as error:
            if missing is not None:
                missing.append(f'{name}: {pathlib.Path(error.filename).name}')
            return match.group()

    return TABLE.sub(replace, text)


def write(folder=RESULTS, root=ROOT):
    """Fill the tables of all pages."""
    missing = []
    for page in PAGES:
        path = root/page
        path.write_text(filled(path.read_text(), Results(folder), missing))
    for each in missing:
        print('Left as it was, without a result: ' + each)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--results', type=pathlib.Path, default=RESULTS)
    write(parser.parse_args().results)


if __name__ == '__main__':
    main()
