#!/usr/bin/python3
"""The price of each effect on one scene: a LangevinHI step with the effect and without it.

Spheres are at volume fraction 0.1, with friction/mass times step equal to 1. The variants take
turns in one process. Times are seconds_mobility + seconds_scheme of getStepStatistics(), without
OpenMM's force evaluations, or CPU time if it is less (on a busy machine). Ratios are taken within a
round.

    PYTHONPATH=build/python /usr/bin/python3 benchmarks/effects.py
"""
import os

os.environ['OPENBLAS_NUM_THREADS'] = '1'
import argparse  # noqa: E402  (the number of BLAS threads must be set before numpy is imported)
import pathlib  # noqa: E402

import tqdm  # noqa: E402
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce  # noqa: E402

from common import (  # noqa: E402
    RESULTS, describeMachine, fluidScene, ownSeconds, save, show, spheresAtRandom, spread, stepsFor)

FREE, RPY = MobilityForce.FreeDraining, MobilityForce.RotnePragerYamakawa
SD = MobilityForce.StokesianDynamics
DENSE, KRYLOV = MobilityForce.Dense, MobilityForce.MatrixFree
VARIANTS = {
    'LangevinC, no fluid': dict(scheme=CustomRigidHIIntegrator.LangevinC),
    'FreeDraining': dict(model=FREE),
    'FreeDraining, no noise': dict(model=FREE, temperature=0),
    'RPY, dense': dict(model=RPY, solver=DENSE),
    'RPY, dense, no noise': dict(model=RPY, solver=DENSE, temperature=0),
    'RPY, dense, no rotation': dict(model=RPY, solver=DENSE, free=True),
    'RPY, matrix-free, 1e-3': dict(model=RPY, solver=KRYLOV, tolerance=1e-3),
    'RPY, matrix-free, 1e-3, no noise': dict(model=RPY, solver=KRYLOV, tolerance=1e-3,
                                             temperature=0),
    'RPY, matrix-free, 1e-6': dict(model=RPY, solver=KRYLOV, tolerance=1e-6),
    'FTS': dict(model=SD, lubrication=False),
    'FTS and lubrication': dict(model=SD),
    'multiblob 12, dense': dict(model=RPY, blobs=12, solver=DENSE),
    'multiblob 12, FreeDraining': dict(model=FREE, blobs=12),
    'multiblob 12, matrix-free, 1e-3': dict(model=RPY, blobs=12, solver=KRYLOV, tolerance=1e-3),
}
#: (effect, variant with it, variant without it).
# yapf: disable
PRICES = (
    ('noise, FreeDraining', 'FreeDraining', 'FreeDraining, no noise'),
    ('noise, RPY dense', 'RPY, dense', 'RPY, dense, no noise'),
    ('noise, RPY matrix-free', 'RPY, matrix-free, 1e-3', 'RPY, matrix-free, 1e-3, no noise'),
    ('a fluid without interactions', 'FreeDraining', 'LangevinC, no fluid'),
    ('interactions: RPY', 'RPY, dense', 'FreeDraining'),
    ('rotation and its coupling', 'RPY, dense', 'RPY, dense, no rotation'),
    ('stresslets: FTS', 'FTS', 'RPY, dense'),
    ('lubrication', 'FTS and lubrication', 'FTS'),
    ('12 blobs a sphere', 'multiblob 12, dense', 'RPY, dense'),
    ('12 blobs a sphere, without interactions', 'multiblob 12, FreeDraining', 'FreeDraining'),
    ('dense instead of matrix-free (1e-3)', 'RPY, dense', 'RPY, matrix-free, 1e-3'),
    ('dense instead of matrix-free (1e-3), multiblob 12', 'multiblob 12, dense',
     'multiblob 12, matrix-free, 1e-3'),
    ('tolerance 1e-6 instead of 1e-3', 'RPY, matrix-free, 1e-6', 'RPY, matrix-free, 1e-3'),
)
# yapf: enable


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--bodies', type=int, default=27)
    parser.add_argument('--platform', default='CPU', choices=('CPU', 'Reference'))
    parser.add_argument('--rounds', type=int, default=20)
    parser.add_argument('--seconds', type=float, default=0.02,
                        help='time of each variant in a round')
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    machine = describeMachine()
    centres = spheresAtRandom(arguments.bodies)
    runs, effects = {}, {}
    for name, options in VARIANTS.items():
        integrator, context = fluidScene(centres, platform=arguments.platform, **options)
        # The state in which every round starts.
        state = context.getState(getPositions=True, getVelocities=True)
        steps = stepsFor(integrator, arguments.seconds)
        # Without noise velocities decay, and products with a zero vector cost nothing.
        runs[name] = integrator, context, state, min(
            steps, 50) if options.get('temperature') == 0 else steps
        effects[name] = {
            key: text
            for key, text in integrator.getEffects().items() if key.startswith(('hydro', 'noise'))
        }
    times, names = {name: [] for name in runs}, list(runs)
    counters = {}
    for number in tqdm.trange(arguments.rounds, desc='Rounds'):
        for name in names[number % len(names):] + names[:number % len(names)]:
            integrator, context, state, steps = runs[name]
            context.setState(state)
            integrator.step(1)
            before = integrator.getStepStatistics()
            times[name].append(ownSeconds(integrator, steps))
            after = integrator.getStepStatistics()
            counters[name] = {
                key: (after[key] - before[key])/steps
                for key in ('mobilityProducts', 'solverIterations', 'randomNumbers', 'squareRoots')
            }
    result = {
        'bodies': arguments.bodies,
        'volume_fraction': 0.1,
        'platform': arguments.platform,
        'threads': 1,
        'rounds': arguments.rounds,
        'friction_over_mass_times_step': 1.0,
        'microseconds_per_step': {
            name: spread([1e6*t for t in values])
            for name, values in times.items()
        },
        'counted_per_step': counters,
        'effects': effects,
        'price': {
            effect: {
                'with': more,
                'without': less,
                **spread([a/b for a, b in zip(times[more], times[less])])
            }
            for effect, more, less in PRICES
        }
    }
    print('microseconds a step, median (quartiles):')
    for name, values in result['microseconds_per_step'].items():
        print(f'  {name:52} {show(values, 1)}')
    print('price, median (quartiles):')
    for name, values in result['price'].items():
        print(f'  {name:52} {show(values, 2)}')
    save(arguments.output, f'effects_{arguments.bodies}_{arguments.platform}.json', machine, result)


if __name__ == '__main__':
    main()
