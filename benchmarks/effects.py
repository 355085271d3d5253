#!/usr/bin/python3
"""The price of each effect on one scene: a step with the effect and without it.

Spheres are at volume fraction 0.1. In the unbounded scene steps are those of LangevinHI, with
friction/mass times step equal to 1. In the periodic scene steps are those of TractionEulerMaruyama,
matrix-free to 1e-3. The variants take turns in one process. Times are seconds_mobility +
seconds_scheme of getStepStatistics(), without OpenMM's force evaluations, or CPU time if it is less
(on a busy machine). Questions for the stress are CPU time. Ratios are taken within a round.

    PYTHONPATH=build/python /usr/bin/python3 benchmarks/effects.py
    PYTHONPATH=build/python /usr/bin/python3 benchmarks/effects.py --scene periodic
"""
import os

os.environ['OPENBLAS_NUM_THREADS'] = '1'
import argparse  # noqa: E402  (the number of BLAS threads must be set before numpy is imported)
import math  # noqa: E402
import pathlib  # noqa: E402
import time  # noqa: E402

import tqdm  # noqa: E402
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce  # noqa: E402

from common import (  # noqa: E402
    RESULTS, describeMachine, fluidScene, ownSeconds, save, show, spheresAtRandom, spread, stepsFor)

FREE, RPY = MobilityForce.FreeDraining, MobilityForce.RotnePragerYamakawa
SD, COUPLED = MobilityForce.StokesianDynamics, MobilityForce.ForceCoupling
DENSE, KRYLOV = MobilityForce.Dense, MobilityForce.MatrixFree
UNBOUNDED = {
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
GRID = dict(solver=KRYLOV, tolerance=1e-3, rate_step=1e-4,
            scheme=CustomRigidHIIntegrator.TractionEulerMaruyama)
SHEARED = dict(tilt=0.4, shear=1.0)
PERIODIC = {
    'RPY': dict(model=RPY, lubrication=False),
    'RPY, sheared': dict(model=RPY, lubrication=False, **SHEARED),
    'RPY and lubrication': dict(model=RPY),
    'ForceCoupling': dict(model=COUPLED, lubrication=False),
    'ForceCoupling, sheared': dict(model=COUPLED, lubrication=False, **SHEARED),
    'ForceCoupling and lubrication': dict(model=COUPLED),
    'FTS': dict(model=SD, lubrication=False),
    'FTS and lubrication': dict(model=SD),
    'FTS and lubrication, sheared': dict(model=SD, **SHEARED),
    'FTS and lubrication, sheared, stress': dict(model=SD, stress=True, **SHEARED),
}
#: For each scene: (effect, variant with it, variant without it).
# yapf: disable
PRICES = {'unbounded': (
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
), 'periodic': (
    ('lubrication, RPY', 'RPY and lubrication', 'RPY'),
    ('lubrication, ForceCoupling', 'ForceCoupling and lubrication', 'ForceCoupling'),
    ('lubrication, FTS', 'FTS and lubrication', 'FTS'),
    ('stresslets: FTS', 'FTS', 'RPY'),
    ('shear: the tilted grid of RPY', 'RPY, sheared', 'RPY'),
    ('shear: the tilted grid of ForceCoupling', 'ForceCoupling, sheared', 'ForceCoupling'),
    ('shear: FTS and lubrication', 'FTS and lubrication, sheared', 'FTS and lubrication'),
    ('getStressInContext after each step', 'FTS and lubrication, sheared, stress',
     'FTS and lubrication, sheared'),
)}
# yapf: enable
VARIANTS = {
    'unbounded': UNBOUNDED,
    'periodic': {name: {
        **GRID,
        **options
    }
                 for name, options in PERIODIC.items()}
}


def secondsOf(integrator, context, steps, stress):
    """Seconds a step, with the question for the stress after each step if wanted."""
    if not stress:
        return ownSeconds(integrator, steps)
    fluid = MobilityForce.cast(context.getSystem().getForce(0))
    start = time.process_time()
    for _ in range(steps):
        integrator.step(1)
        fluid.getStressInContext(context)
    return (time.process_time() - start)/steps


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--scene', default='unbounded', choices=tuple(VARIANTS))
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
    box = {}
    if arguments.scene == 'periodic':
        box['edge'] = (4*math.pi/3*arguments.bodies/0.1)**(1/3)
        if round(arguments.bodies**(1/3))**3 != arguments.bodies:
            raise SystemExit('--bodies: give a cube of a whole number in a periodic box')
    for name, options in VARIANTS[arguments.scene].items():
        options = dict(options)
        stress = options.pop('stress', False)
        integrator, context = fluidScene(centres, platform=arguments.platform, **box, **options)
        # The state in which every round starts.
        state = context.getState(getPositions=True, getVelocities=True)
        steps = stepsFor(integrator, arguments.seconds)
        # Without noise velocities decay, and products with a zero vector cost nothing.
        runs[name] = integrator, context, state, stress, min(
            steps, 50) if options.get('temperature') == 0 else steps
        effects[name] = {
            key: text
            for key, text in integrator.getEffects().items() if key.startswith(('hydro', 'noise'))
        }
    times, names = {name: [] for name in runs}, list(runs)
    counters = {}
    for number in tqdm.trange(arguments.rounds, desc='Rounds'):
        for name in names[number % len(names):] + names[:number % len(names)]:
            integrator, context, state, stress, steps = runs[name]
            context.setState(state)
            integrator.step(1)
            before = integrator.getStepStatistics()
            times[name].append(secondsOf(integrator, context, steps, stress))
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
        'friction_over_mass_times_step': 1.0
        if arguments.scene == 'unbounded' else GRID['rate_step'],
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
            for effect, more, less in PRICES[arguments.scene]
        }
    }
    print('microseconds a step, median (quartiles):')
    for name, values in result['microseconds_per_step'].items():
        print(f'  {name:52} {show(values, 1)}')
    print('price, median (quartiles):')
    for name, values in result['price'].items():
        print(f'  {name:52} {show(values, 2)}')
    where = '' if arguments.scene == 'unbounded' else 'periodic_'
    save(arguments.output, f'effects_{where}{arguments.bodies}_{arguments.platform}.json', machine,
         result)


if __name__ == '__main__':
    main()
