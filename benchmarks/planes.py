#!/usr/bin/python3
"""What no-slip walls cost on a grid, beside a periodic fluid on the same nodes.

BenchmarkPlanes measures products and random velocities of force coupling and of
Rotne-Prager-Yamakawa in a channel, above a wall and in a film, the same on the same nodes without
planes, and random velocities by a root of the whole mobility. Its repetitions run in random order,
and ratios are those of the same repetition. Times are the process's own, on one thread.

Steps of single spheres in a channel and in a periodic box, whose third edge is the period of the
channel's grid, follow, with their products and Fourier transforms of the whole grid: six for each
product and three for each random field, twice as many where spheres of Rotne-Prager-Yamakawa have
torques, whose channel is one of its own.

    PYTHONPATH=build/python /usr/bin/python3 benchmarks/planes.py
"""
import os

os.environ['OPENBLAS_NUM_THREADS'] = '1'
import argparse  # noqa: E402  (one thread of BLAS must be said before numpy comes)
import collections  # noqa: E402
import json  # noqa: E402
import pathlib  # noqa: E402
import subprocess  # noqa: E402
import sys  # noqa: E402
import tempfile  # noqa: E402

import numpy as np  # noqa: E402
import openmm  # noqa: E402
import tqdm  # noqa: E402

import openmmrigidhi  # noqa: E402
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, app  # noqa: E402

from common import RESULTS, describeMachine, ownSeconds, save, spread  # noqa: E402

TOLERANCE, FRACTION, HEIGHT, NUMBER = 1e-3, 0.2, 6.0, 1000
#: Goals: times over those of a periodic fluid on the same nodes.
GOALS = {'product': 1.25, 'noise': 1.3}
#: Boundaries without nodes of their own: (boundary, the one with the same nodes).
NODES_OF = {'Film': 'NoSlipChannel'}
BOUNDARIES = ('NoSlipChannel', 'PeriodicWall', 'Film')
SCHEMES = {
    'ForceCoupling': ('EulerMaruyama', 'DriftCorrectorFD', 'TractionEulerMaruyama'),
    # DriftCorrectorFD takes a root of pairs for each component of each sphere.
    'RotnePragerYamakawa': ('EulerMaruyama', 'TractionEulerMaruyama')
}


def measured(program, repetitions):
    """{(what, model, boundary, isPeriodic, blobs, height): runs of BenchmarkPlanes in turn}."""
    with tempfile.TemporaryDirectory() as folder:
        report = pathlib.Path(folder)/'report.json'
        subprocess.run([
            str(program), f'--benchmark_out={report}', '--benchmark_out_format=json',
            f'--benchmark_repetitions={repetitions}', '--benchmark_enable_random_interleaving=true'
        ], check=True, stdout=sys.stderr)
        content = json.loads(report.read_text())
    found = collections.defaultdict(dict)
    for run in content['benchmarks']:
        if run['run_type'] != 'iteration':
            continue
        # Options of the program, such as min_time:0.1, follow the arguments.
        parts = [part for part in run['run_name'].split('/') if ':' not in part]
        key = tuple(parts[:3]) + ('periodic' in parts,) + tuple(parts[-2:])
        found[key][run['repetition_index']] = run
    return {key: [runs[k] for k in sorted(runs)] for key, runs in found.items()}


def milliseconds(runs):
    return np.array([run['cpu_time'] for run in runs])


def rowsOf(found):
    """A row for each model, boundary and scene."""
    rows = []
    for what, model, boundary, isPeriodic, blobs, height in found:
        if what != 'product' or isPeriodic:
            continue

        def of(kind, boundary=boundary, isPeriodic=False, model=model, scene=(blobs, height)):
            return found.get((kind, model, boundary, isPeriodic) + scene)

        row = {
            'model': model,
            'boundary': boundary,
            'blobs': int(blobs),
            'height': int(height),
            'nodes': of('product')[0]['label']
        }
        for kind in ('product', 'noise'):
            own, plain = of(kind), of(kind, NODES_OF.get(boundary, boundary), True)
            assert plain[0]['label'] == row['nodes'], (plain[0]['label'], row['nodes'])
            row[kind] = {
                'ms': spread(milliseconds(own)),
                'periodic_ms': spread(milliseconds(plain)),
                'ratio': spread(milliseconds(own)/milliseconds(plain))
            }
            if 'iterationsOfPairs' in own[0]:
                row[kind]['iterations'] = int(own[0]['iterationsOfPairs'])
        product, noise = milliseconds(of('product')), milliseconds(of('noise'))
        row['noise']['in_products'] = spread(noise/product)
        root = of('noiseByProducts')
        if root:
            row['root'] = {
                'ms': spread(milliseconds(root)),
                'products': int(root[0]['products']),
                'over_noise': spread(milliseconds(root)/noise)
            }
        rows.append(row)
    return sorted(
        rows, key=lambda row:
        (row['model'], BOUNDARIES.index(row['boundary']), row['blobs'], row['height']))


def layers(random):
    """Centres (NUMBER, 3) of spheres of radius 1 in shaken layers, and the edge along walls."""
    count = round(HEIGHT/3)
    side = int(np.ceil(np.sqrt(NUMBER/count)))
    size = np.array([*[np.sqrt(4*np.pi/3/FRACTION/(HEIGHT/count))]*2, HEIGHT/count])
    cells = np.array(list(np.ndindex(side, side, count)))[:NUMBER]
    return (cells + 0.5)*size + random.uniform(1 - size/2, size/2 - 1, (NUMBER, 3)), side*size[0]


def scene(model, boundary, scheme):
    """An integrator and its Context, after a first step."""
    system, fluid = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(300, 1e-4)
    integrator.setScheme(scheme)
    integrator.setRandomNumberSeed(1)
    centres, edge = layers(np.random.default_rng(1))
    for _ in centres:
        app.addRigidMultiblob(system, integrator, fluid, [(0, 0, 0)], 1.0)
    fluid.setModel(model)
    fluid.setBoundary(boundary)
    fluid.setChannelWalls(0, HEIGHT)
    fluid.setSolver('MatrixFree')
    fluid.setSolverTolerance(TOLERANCE)
    system.addForce(fluid)
    system.setDefaultPeriodicBoxVectors((edge, 0, 0), (0, edge, 0), (0, 0, HEIGHT + 2))
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'),
                             {'Threads': '1'})
    context.setPositions(centres)
    integrator.step(1)
    return integrator, context


def stepsOf(cases, steps):
    """A row for each case: seconds of a step, and its products and transforms.

    All take a step in turn, so that a slow moment of the machine does not fall on one alone.
    """
    scenes = [scene(*case) for case in cases]
    before = [integrator.getStepStatistics() for integrator, _ in scenes]
    seconds = [[ownSeconds(integrator, 1) for integrator, _ in scenes]
               for _ in tqdm.tqdm(range(steps), desc='steps')]
    return [
        rowOf(case, integrator, start, steps, own)
        for case, (integrator, _), start, own in zip(cases, scenes, before, zip(*seconds))
    ]


def rowOf(case, integrator, before, steps, seconds):
    """What `steps` steps took, of which the statistics were `before` at first."""
    model, boundary, scheme = case
    after = integrator.getStepStatistics()
    counts = {
        key: (after[key] - before[key])/steps
        for key in ('mobilityProducts', 'squareRoots', 'randomNumbers', 'seconds_fft')
    }
    ofChannels = 2 if model == 'RotnePragerYamakawa' else 1
    return {
        'model': model,
        'boundary': boundary,
        'scheme': scheme,
        'spheres': NUMBER,
        'grid': integrator.getEffects()['hydrodynamics'].split(' on a grid of ')[-1].split(',')[0],
        'seconds': spread(seconds),
        'transforms': ofChannels*(6*counts['mobilityProducts'] + 3),
        **{key: float(f'{value:.4g}')
           for key, value in counts.items()}
    }


def between(values, count=2):
    """The smallest and the largest of medians as text."""
    texts = [f'{value:.{count}f}' for value in (min(values), max(values))]
    return texts[0] if texts[0] == texts[1] else ' … '.join(texts)


def tables(result):
    """Lines of Markdown: ratios of planes, from one height to the other, and steps."""
    yield ('| model | boundary | blobs | heights in radii | product | random velocities | the same '
           'in products | iterations of pairs | products of a root | root over random velocities |')
    yield '|' + '---|'*10
    groups = collections.defaultdict(list)
    for row in result['rows']:
        groups[row['model'], row['boundary'], row['blobs']].append(row)
    for (model, boundary, blobs), rows in groups.items():
        heights = sorted(row['height'] for row in rows)
        roots = [row['root'] for row in rows if 'root' in row]
        iterations = [row['noise']['iterations'] for row in rows if 'iterations' in row['noise']]
        yield '| ' + ' | '.join(
            (model, boundary, f'{blobs:,}', ', '.join(map(
                str, heights)), *(between([row[kind]['ratio']['median'] for row in rows])
                                  for kind in ('product', 'noise')),
             between([row['noise']['in_products']['median']
                      for row in rows], 1), between(iterations, 0) if iterations else '–',
             between([root['products'] for root in roots], 0) if roots else '–',
             between([root['over_noise']['median'] for root in roots], 1) if roots else '–')) + ' |'
    yield ''
    for kind, name in (('product', 'products'), ('noise', 'random velocities')):
        missed = [
            f'{row["model"]} {row["boundary"]} {row["blobs"]:,} height {row["height"]}: '
            f'{row[kind]["ratio"]["median"]:.2f}' for row in result['rows']
            if row[kind]['ratio']['median'] > GOALS[kind]
        ]
        yield (f'Above the goal of {GOALS[kind]:g} for {name}: ' + '; '.join(missed or ['none']) +
               '.')
    yield ''
    yield ('| model | scheme | products a step | transforms a step | a step in the channel | in '
           'the periodic box |')
    yield '|' + '---|'*6
    periodic = {(row['model'], row['scheme']): row
                for row in result['steps'] if row['boundary'] == 'Periodic'}
    for row in result['steps']:
        if row['boundary'] == 'Periodic':
            continue
        beside = periodic[row['model'], row['scheme']]
        yield (f'| {row["model"]} | {row["scheme"]} | {row["mobilityProducts"]:g} | '
               f'{row["transforms"]:g} | {row["seconds"]["median"]:.2g} s | '
               f'{beside["seconds"]["median"]:.2g} s |')


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--repetitions', type=int, default=5)
    parser.add_argument('--steps', type=int, default=11, help='steps of each scheme')
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS, help='folder of the JSON')
    arguments = parser.parse_args()
    program = pathlib.Path(openmmrigidhi.__file__).parents[2]/'benchmarks/BenchmarkPlanes'
    if not program.exists():
        raise SystemExit('BenchmarkPlanes was not built: configure with '
                         '-DRIGIDHI_BUILD_BENCHMARKS=ON, as make benchmark does')
    machine = describeMachine()
    result = {
        'tolerance': TOLERANCE,
        'volume_fraction': FRACTION,
        'repetitions': arguments.repetitions,
        'goals': GOALS,
        'rows': rowsOf(measured(program, arguments.repetitions))
    }
    cases = [(model, boundary, scheme) for model, schemes in SCHEMES.items() for scheme in schemes
             for boundary in ('Periodic', 'NoSlipChannel')]
    result['steps'] = stepsOf(cases, arguments.steps)
    save(arguments.output, 'planes.json', machine, result)
    print('\n'.join(tables(result)))


if __name__ == '__main__':
    main()
