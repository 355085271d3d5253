#!/usr/bin/python3
"""How the time of a step grows with the number of spheres or blobs, for every model and boundary.

Spheres: bodies of one sphere of radius 1 nm at a volume fraction of 0.1, above a wall in a layer
as high as it is needed for squares of at most 100 spheres, under EulerMaruyama with noise: one
product with the mobility and one square root a step. Blobs: boomerangs of 15 blobs of the same
radius, under TrapezoidalSlip: three mobility problems and one square root. Matrix-free fluids have
the tolerance 1e-3. One thread; times are those of seconds_mobility + seconds_scheme of
getStepStatistics(), or the process's CPU time if that is less (a busy machine). A series ends
where a step is refused, or would take more than --limit seconds by the growth so far.

The exponent is that of a line through the times from 1000 particles on (dense: 100), what
dominates is the largest part of the last number.

    PYTHONPATH=build/python /usr/bin/python3 benchmarks/growth.py
    PYTHONPATH=build/python /usr/bin/python3 benchmarks/growth.py --draw
"""
import os

os.environ['OPENBLAS_NUM_THREADS'] = '1'
import argparse  # noqa: E402  (one thread of BLAS must be said before numpy comes)
import json  # noqa: E402
import pathlib  # noqa: E402

import numpy as np  # noqa: E402
import openmm  # noqa: E402
import tqdm  # noqa: E402
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, app  # noqa: E402

from common import RESULTS, describeMachine, ownSeconds, save  # noqa: E402

NUMBERS = (10, 30, 100, 300, 1000, 3000, 10000, 30000, 100000)
TOLERANCE = 1e-3
#: Series: (what, model, boundary, solver).
# yapf: disable
SERIES = (
    ('spheres', 'FreeDraining', 'Unbounded', 'Auto'),
    ('spheres', 'RotnePragerYamakawa', 'Unbounded', 'Dense'),
    ('spheres', 'RotnePragerYamakawa', 'Unbounded', 'MatrixFree'),
    ('spheres', 'RotnePragerYamakawa', 'NoSlipWall', 'Dense'),
    ('spheres', 'RotnePragerYamakawa', 'NoSlipWall', 'MatrixFree'),
    ('spheres', 'RotnePragerYamakawa', 'Periodic', 'Dense'),
    ('spheres', 'RotnePragerYamakawa', 'Periodic', 'MatrixFree'),
    ('spheres', 'ForceCoupling', 'Periodic', 'Dense'),
    ('spheres', 'ForceCoupling', 'Periodic', 'MatrixFree'),
    ('spheres', 'ForceCoupling', 'SlipChannel', 'Dense'),
    ('spheres', 'ForceCoupling', 'SlipChannel', 'MatrixFree'),
    ('spheres', 'RotnePragerYamakawa', 'PeriodicWall', 'Dense'),
    ('spheres', 'RotnePragerYamakawa', 'PeriodicWall', 'MatrixFree'),
    ('spheres', 'RotnePragerYamakawa', 'NoSlipChannel', 'MatrixFree'),
    ('spheres', 'ForceCoupling', 'PeriodicWall', 'MatrixFree'),
    ('spheres', 'ForceCoupling', 'NoSlipChannel', 'MatrixFree'),
    ('spheres', 'ForceCoupling', 'Film', 'MatrixFree'),
    ('spheres', 'StokesianDynamics', 'Unbounded', 'Dense'),
    ('spheres', 'StokesianDynamics', 'Periodic', 'Dense'),
    ('blobs', 'RotnePragerYamakawa', 'Unbounded', 'Dense'),
    ('blobs', 'RotnePragerYamakawa', 'Unbounded', 'MatrixFree'),
    ('blobs', 'RotnePragerYamakawa', 'NoSlipWall', 'Dense'),
    ('blobs', 'RotnePragerYamakawa', 'NoSlipWall', 'MatrixFree'),
    ('blobs', 'RotnePragerYamakawa', 'Periodic', 'MatrixFree'),
    ('blobs', 'ForceCoupling', 'Periodic', 'MatrixFree'),
    ('blobs', 'ForceCoupling', 'SlipChannel', 'MatrixFree'),
    ('blobs', 'RotnePragerYamakawa', 'NoSlipChannel', 'MatrixFree'),
    ('blobs', 'ForceCoupling', 'PeriodicWall', 'MatrixFree'),
    ('blobs', 'ForceCoupling', 'NoSlipChannel', 'MatrixFree'),
)
# yapf: enable
COLOURS = {
    'FreeDraining': 'tab:gray',
    'RotnePragerYamakawa': 'tab:blue',
    'ForceCoupling': 'tab:green',
    'StokesianDynamics': 'tab:red'
}
MARKERS = {
    'Unbounded': 'o',
    'NoSlipWall': 's',
    'Periodic': '^',
    'SlipChannel': 'D',
    'PeriodicWall': 'P',
    'NoSlipChannel': 'X',
    'Film': '*'
}
#: Boundaries with walls across z and periods along x and y.
CONFINED = ('PeriodicWall', 'NoSlipChannel', 'Film')
PARTS = ('seconds_spreading', 'seconds_fft', 'seconds_averaging', 'seconds_solver')


def arranged(count, boundary, spacing):
    """Centres on a lattice, displaced at random, and the box: (count, 3), (3,)."""
    random = np.random.default_rng(1)
    if boundary in ('NoSlipWall', 'SlipChannel', *CONFINED):
        layers = max(1, int(np.ceil(count/10000)))
        side = int(np.ceil(np.sqrt(count/layers) - 1e-9))
    else:
        side = layers = int(np.ceil(count**(1/3) - 1e-9))
    cells = np.array(list(np.ndindex(layers, side, side)))[:count, ::-1]
    box = spacing*np.array([side, side, layers])
    centres = spacing*(cells + 0.5) + random.uniform(-0.1, 0.1, (count, 3))
    if boundary == 'SlipChannel':  # between walls that are normal to y
        return centres[:, [0, 2, 1]], box[[0, 2, 1]]
    return centres, box


def scene(what, model, boundary, solver, count):
    """(integrator, Context, number of spheres or blobs)."""
    fluid, system = MobilityForce(), openmm.System()
    integrator = CustomRigidHIIntegrator(300, 1e-3)
    integrator.setRandomNumberSeed(1)
    if what == 'spheres':
        sites, spacing = np.zeros((1, 3)), (4*np.pi/3/0.1)**(1/3)
        integrator.setScheme(CustomRigidHIIntegrator.EulerMaruyama)
    else:
        sites, spacing = app.boomerang(2.0)._value, 22.0
        sites = sites - sites.mean(0)
        integrator.setScheme(CustomRigidHIIntegrator.TrapezoidalSlip)
        count = max(1, round(count/len(sites)))
    centres, box = arranged(count, boundary, spacing)
    for _ in range(count):
        app.addRigidMultiblob(system, integrator, fluid, sites, 1.0)
    positions = (centres[:, None] + sites).reshape(-1, 3)
    fluid.setModel(getattr(MobilityForce, model))
    fluid.setBoundary(getattr(MobilityForce, boundary))
    fluid.setSolver(getattr(MobilityForce, solver))
    if solver == 'MatrixFree':
        fluid.setSolverTolerance(TOLERANCE)
    if boundary == 'SlipChannel':
        low, high = positions[:, 1].min() - 2, positions[:, 1].max() + 2
        fluid.setChannelWalls(float(low), float(high))
        box[1] = max(box[1], high - low + 1)  # the box must be longer than the channel is wide
    if boundary in CONFINED:
        low, high = positions[:, 2].min() - 2, positions[:, 2].max() + 2
        fluid.setWallHeight(float(low))
        fluid.setChannelWalls(float(low), float(high))
        box[2] = max(box[2], high - low + 1)
    system.addForce(fluid)
    if boundary in ('Periodic', 'SlipChannel', *CONFINED):
        system.setDefaultPeriodicBoxVectors(*np.diag(box))
        app.bindBodies(system, integrator)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'),
                             {'Threads': '1'})
    context.setPositions(positions)
    return integrator, context, len(positions)


def measure(what, model, boundary, solver, count, seconds):
    """A row: the least of three times of a step, and what happened in it."""
    integrator, context, number = scene(what, model, boundary, solver, count)
    before = integrator.getStepStatistics()
    first = ownSeconds(integrator, 1)
    times = [first]
    if first < 60:  # what is made once does not count
        first = ownSeconds(integrator, 1)
        steps = int(min(1000, max(1, seconds/3/max(first, 1e-6))))
        before = integrator.getStepStatistics()
        times = [ownSeconds(integrator, steps) for _ in range(3 if first < 1 else 1)]
    after = integrator.getStepStatistics()
    made = max(1, after['steps'] - before['steps'])
    row = {'number': number, 'seconds': float(f'{min(times):.4g}')}
    for key in ('mobilityProducts', 'solverIterations', *PARTS):
        row[key] = float(f'{(after[key] - before[key])/made:.4g}')
    return row


def exponent(rows, solver):
    """Of a line through logarithms, for large numbers; None where there are fewer than three."""
    rows = [row for row in rows if row['number'] >= (100 if solver == 'Dense' else 1000)]
    if len(rows) < 3:
        return None
    slope = np.polyfit(np.log([row['number'] for row in rows]),
                       np.log([row['seconds'] for row in rows]), 1)[0]
    return round(float(slope), 2)


def draw(result, file):
    """The times of all series against the number, doubly logarithmic, spheres beside blobs."""
    from matplotlib.figure import Figure
    figure = Figure((11, 7), layout='constrained')
    axes = figure.subplots(1, 2, sharey=True)
    for series in result['series']:
        panel = axes[int(series['what'] == 'blobs')]
        rows = series['rows']
        panel.loglog([row['number'] for row in rows], [row['seconds'] for row in rows],
                     color=COLOURS[series['model']], marker=MARKERS[series['boundary']],
                     markersize=4, linewidth=1.2,
                     linestyle='--' if series['solver'] == 'Dense' else '-',
                     label=f'{series["model"]}, {series["boundary"]}' +
                     (', dense' if series['solver'] == 'Dense' else ''))
    for panel, title in zip(
            axes,
        ('Spheres with torques, EulerMaruyama', 'Boomerangs of 15 blobs, TrapezoidalSlip')):
        numbers = np.array([1e3, 1e5])
        for power, text in ((1, 'N'), (2, 'N²')):
            panel.loglog(numbers, 3e-6*numbers*(numbers/1e3)**(power - 1), color='0.7',
                         linewidth=0.8)
            panel.text(numbers[1], 3e-6*numbers[1]*(numbers[1]/1e3)**(power - 1), text, color='0.5',
                       va='center')
        panel.set(title=title, xlabel='number of spheres or blobs')
        panel.grid(color='0.92')
        panel.legend(fontsize=7.5, loc='upper center', bbox_to_anchor=(0.5, -0.12), ncols=2)
    axes[0].set_ylabel('seconds a step, one thread')
    figure.savefig(file, dpi=110)


def table(result):
    """Lines of Markdown: a row for each series."""
    columns = [10, 100, 1000, 10000, 100000]
    lines = [
        '| bodies | model | boundary | solver | ' + ' | '.join(f'{n:,}' for n in columns) +
        ' | exponent | ends |', '|' + '---|'*(6 + len(columns))
    ]
    for series in result['series']:
        found = {}
        for row in series['rows']:
            near = min(columns, key=lambda n: abs(np.log(row['number']/n)))
            if abs(np.log(row['number']/near)) < 0.35:
                found[near] = duration(row['seconds'])
        power = series['exponent']
        lines.append('| ' + ' | '.join((series['what'], series['model'], series['boundary'],
                                        series['solver'], *(found.get(n, '–') for n in columns),
                                        '–' if power is None else f'{power:.2f}', series['end'])) +
                     ' |')
    return '\n'.join(lines)


def duration(seconds):
    """Seconds with two digits and their unit."""
    for unit, scale in (('s', 1), ('ms', 1e-3), ('µs', 1e-6)):
        if seconds >= scale:
            return f'{float(f"{seconds/scale:.2g}"):g} {unit}'
    return f'{1e6*seconds:.2g} µs'


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--limit', type=float, default=60, help='seconds of a step, at most')
    parser.add_argument('--seconds', type=float, default=0.3, help='of steps for each time')
    parser.add_argument('--largest', type=int, default=NUMBERS[-1])
    parser.add_argument('--bodies', nargs='*', help='only these series; the JSON keeps the others')
    parser.add_argument('--boundaries', nargs='*', help='likewise')
    parser.add_argument('--draw', action='store_true', help='from the JSON, without measuring')
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    file = arguments.output/'growth.json'
    if arguments.draw:
        result = json.loads(file.read_text())
        for series in result['series']:
            series['exponent'] = exponent(series['rows'], series['solver'])
        file.write_text(json.dumps(result, indent=1) + '\n')
    else:
        machine = describeMachine()
        result = {'tolerance': TOLERANCE, 'limit_seconds': arguments.limit, 'series': []}
        wanted = [
            each for each in SERIES if (not arguments.bodies or each[0] in arguments.bodies) and (
                not arguments.boundaries or each[2] in arguments.boundaries)
        ]
        if len(wanted) < len(SERIES):
            kept = json.loads(file.read_text())
            result['refusals'] = kept.get('refusals', {})
            for each in wanted:
                for name in [n for n in result['refusals'] if n.startswith(', '.join(each))]:
                    del result['refusals'][name]
            result['series'] = [
                each for each in kept['series']
                if (each['what'], each['model'], each['boundary'], each['solver']) not in wanted
            ]
        progress = tqdm.tqdm(total=len(wanted)*len(NUMBERS), desc='Steps')
        for what, model, boundary, solver in wanted:
            rows, end = [], ''
            for index, number in enumerate(NUMBERS):
                power = 3 if solver == 'Dense' else 1.3
                if rows and rows[-1]['seconds']*(number/rows[-1]['number'])**power \
                        > arguments.limit:
                    end = f'{number:,} would take more than {arguments.limit:g} s'
                elif number > arguments.largest:
                    end = 'as asked'
                else:
                    try:
                        rows.append(
                            measure(what, model, boundary, solver, number, arguments.seconds))
                    except openmm.OpenMMException as refusal:
                        end = f'{number:,} are refused'
                        result.setdefault(
                            'refusals',
                            {})[f'{what}, {model}, {boundary}, {solver}, {number}'] = str(refusal)
                if end:
                    progress.update(len(NUMBERS) - index)
                    break
                progress.update()
            result['series'].append({
                'what': what,
                'model': model,
                'boundary': boundary,
                'solver': solver,
                'exponent': exponent(rows, solver),
                'end': end,
                'rows': rows
            })
            result['series'].sort(key=lambda each: SERIES.index(
                (each['what'], each['model'], each['boundary'], each['solver'])))
            tqdm.tqdm.write(f'{what} {model} {boundary} {solver}: ' +
                            ', '.join(f'{row["number"]}: {duration(row["seconds"])}'
                                      for row in rows) + f'; {end}')
            save(arguments.output, file.name, machine, result)
    draw(result, arguments.output/'growth.png')
    print(table(result))


if __name__ == '__main__':
    main()
