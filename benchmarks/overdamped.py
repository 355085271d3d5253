#!/usr/bin/python3
"""A step of the schemes without momenta: one boomerang above a wall, replicas of it, and 64.

The 64 boomerangs interact. The boomerang is that of Delong, Balboa Usabiaga and Donev 2015 (15
blobs), with gravity and a repulsion from the wall. Times are without OpenMM's force evaluations
(seconds_mobility + seconds_scheme of getStepStatistics()). On one thread, CPU time counts where it
is less than the clock's: on a busy machine the clock also counts what other processes compute. The
Python code of the literature (RigidMultiblobsWall) takes 360 to 1500 us a step of one boomerang,
and 134 ms a step of 64 with trapezoidal slip at tolerance 1e-3. The goals are derived from these
times.

    PYTHONPATH=build/python /usr/bin/python3 benchmarks/overdamped.py
"""
import os

os.environ['OPENBLAS_NUM_THREADS'] = '1'
from instructions import HELP, keepToAvx2IfAsked  # noqa: E402

keepToAvx2IfAsked()
import argparse  # noqa: E402  (what is set above is set before numpy is imported)
import math  # noqa: E402
import pathlib  # noqa: E402

import numpy as np  # noqa: E402
import openmm  # noqa: E402
import tqdm  # noqa: E402
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, app  # noqa: E402

from common import RESULTS, describeMachine, ownSeconds, save, show, spread, stepsFor  # noqa: E402

SCHEMES = ('EulerMaruyama', 'FixmanMidpoint', 'RandomFiniteDifference', 'TractionEulerMaruyama',
           'TrapezoidalSlip', 'DriftCorrectorFD', 'DriftCorrectorRFD')
GOALS = {
    'FixmanMidpoint': 20,
    'RandomFiniteDifference': 20,
    'TrapezoidalSlip': 40,
    'DriftCorrectorRFD': 40
}  # us
MILLISECONDS_OF_PYTHON, TIMES_FASTER = 134, 8
RADIUS, SPACING = 0.324557, 0.3  # um as nm


def scene(scheme, count=1, platform='Reference', groups=False, solver=None, tolerance=1e-6,
          threads=1, apart=4.0, step=1e-4):
    """Boomerangs lying on a square lattice 3 radii above the wall: (integrator, Context)."""
    fluid, system, integrator = MobilityForce(), openmm.System(), CustomRigidHIIntegrator(300, step)
    fluid.setBoundary(MobilityForce.NoSlipWall)
    fluid.setViscosity(1)
    integrator.setScheme(getattr(CustomRigidHIIntegrator, scheme))
    integrator.setRandomNumberSeed(1)
    sites = app.boomerang(SPACING)._value
    side, positions = math.ceil(math.sqrt(count)), []
    for body in range(count):
        app.addRigidMultiblob(system, integrator, fluid, sites, RADIUS)
        positions.extend(sites + [apart*(body % side), apart*(body // side), 3*RADIUS])
    if groups:
        fluid.setGroups(list(range(count)))
    if solver is not None:
        fluid.setSolver(solver)
    fluid.setSolverTolerance(tolerance)
    field = openmm.CustomExternalForce(f'0.1*z + 57*exp(-2*(z-{RADIUS})/{RADIUS})')
    for particle in range(system.getNumParticles()):
        field.addParticle(particle, [])
    system.addForce(field)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platform),
                             {'Threads': str(threads)} if platform == 'CPU' else {})
    context.setPositions(positions)
    return integrator, context


def time(rounds, seconds, threads=1, **options):
    """Seconds a step, with the numbers of iterations and products."""
    integrator, context = scene(threads=threads, **options)
    steps = stepsFor(integrator, seconds)
    before = integrator.getStepStatistics()
    times = [ownSeconds(integrator, steps, threads) for _ in range(rounds)]
    after = integrator.getStepStatistics()
    made = after['steps'] - before['steps']
    return times, {
        key: round((after[key] - before[key])/made, 2)
        for key in ('forceEvaluations', 'mobilityProducts', 'solverIterations', 'randomNumbers')
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--rounds', type=int, default=20)
    parser.add_argument('--seconds', type=float, default=0.05,
                        help='time of the steps in a round, which has at least one step')
    parser.add_argument('--threads', type=int, default=2, help='threads for the 64 boomerangs')
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    parser.add_argument('--avx2', action='store_true', help=HELP)
    arguments = parser.parse_args()
    machine = describeMachine()
    result = {'rounds': arguments.rounds, 'one': {}, 'replicas': {}, 'interacting': {}}

    for platform in ('Reference', 'CPU'):
        for scheme in tqdm.tqdm(SCHEMES, desc=f'One boomerang, {platform}'):
            times, counts = time(arguments.rounds, arguments.seconds, scheme=scheme,
                                 platform=platform)
            row = {
                'microseconds_step': spread(1e6*np.array(times)),
                'goal': GOALS.get(scheme),
                **counts
            }
            result['one'].setdefault(platform, {})[scheme] = row
            tqdm.tqdm.write(
                f'  {platform:9} {scheme:24} {show(row["microseconds_step"], 1)} us, goal '
                f'{row["goal"]}')
    for count in tqdm.tqdm((1, 10, 100, 1000), desc='Replicas'):
        times, counts = time(arguments.rounds, arguments.seconds, scheme='RandomFiniteDifference',
                             count=count, groups=True)
        result['replicas'][str(count)] = {
            'microseconds_step_and_body': spread(1e6*np.array(times)/count),
            **counts
        }
        tqdm.tqdm.write(
            f'  {count:5} replicas: '
            f'{show(result["replicas"][str(count)]["microseconds_step_and_body"], 1)} us each')
    for apart in (4.0, 2.6):
        for scheme in tqdm.tqdm([s for s in SCHEMES if s != 'DriftCorrectorFD'],
                                desc=f'64 boomerangs, {apart} apart'):
            times, counts = time(arguments.rounds, arguments.seconds, arguments.threads,
                                 scheme=scheme, count=64, platform='CPU',
                                 solver=MobilityForce.MatrixFree, tolerance=1e-3, apart=apart)
            row = {'milliseconds_step': spread(1e3*np.array(times)), **counts}
            if scheme == 'TrapezoidalSlip':
                row['goal'] = MILLISECONDS_OF_PYTHON/TIMES_FASTER
            result['interacting'].setdefault(str(apart), {})[scheme] = row
            tqdm.tqdm.write(f'  {apart} {scheme:24} {show(row["milliseconds_step"], 2)} ms, '
                            f'{counts["mobilityProducts"]} products' +
                            (f', goal {row["goal"]}' if 'goal' in row else ''))
    result['threads_of_interacting'] = arguments.threads
    save(arguments.output, 'overdamped.json', machine, result)


if __name__ == '__main__':
    main()
