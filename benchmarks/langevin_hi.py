#!/usr/bin/python3
"""A LangevinHI step of RPY spheres: dense, and matrix-free up to 10,000 spheres.

A dense step is given as a multiple of one symmetric eigendecomposition. Spheres are at volume
fraction 0.1, with friction/mass times step equal to 1. Times are without OpenMM's force evaluations
(seconds_mobility + seconds_scheme of getStepStatistics()). The decomposition is numpy.linalg.eigh
of the scene's own friction matrix with one BLAS thread, in turns with the steps in one process. On
one thread, CPU time counts where it is less than the clock's: on a busy machine the clock also
counts what other processes compute.

    PYTHONPATH=build/python /usr/bin/python3 benchmarks/langevin_hi.py
"""
import os

os.environ['OPENBLAS_NUM_THREADS'] = '1'
import argparse  # noqa: E402  (the number of BLAS threads must be set before numpy is imported)
import math  # noqa: E402
import pathlib  # noqa: E402
import resource  # noqa: E402
import time  # noqa: E402

import numpy as np  # noqa: E402
import tqdm  # noqa: E402
from openmmrigidhi import MobilityForce  # noqa: E402

from common import (  # noqa: E402
    RESULTS, describeMachine, fluidScene, ownSeconds, save, show, spheresAtRandom, spread, stepsFor)

GOALS = {2: 3, 10: 3, 50: 1.3, 200: 1.3}
SECONDS_GOALS = {1000: 0.1, 10000: 6}


def dense(bodies, platform, rounds, seconds):
    """Steps and decompositions in turns; all times in microseconds."""
    integrator, context = fluidScene(spheresAtRandom(bodies), MobilityForce.RotnePragerYamakawa,
                                     solver=MobilityForce.Dense, platform=platform)
    state = context.getState(getPositions=True, getVelocities=True)
    fluid = MobilityForce.cast(context.getSystem().getForce(0))
    matrix = fluid.getFrictionInContext(context)
    # Scaled as in LangevinHI, with mass 1 and moment of inertia 0.4.
    scale = np.tile([1, 1, 1] + [1/math.sqrt(0.4)]*3, bodies)
    matrix *= np.outer(scale, scale)
    np.linalg.eigh(matrix)
    steps = stepsFor(integrator, seconds)
    own, other = [], []
    for number in range(rounds):
        for what in ((0, 1) if number % 2 else (1, 0)):
            if what:
                context.setState(state)
                integrator.step(1)
                own.append(1e6*ownSeconds(integrator, steps))
            else:
                began, cpu = time.perf_counter(), time.process_time()
                for _ in range(steps):
                    np.linalg.eigh(matrix)
                other.append(1e6*min(time.perf_counter() - began, time.process_time() - cpu)/steps)
    return {
        'rows': 6*bodies,
        'microseconds_step': spread(own),
        'microseconds_eigh': spread(other),
        'ratio': spread([a/b for a, b in zip(own, other)]),
        'goal': GOALS[bodies]
    }


def matrixFree(bodies, tolerance, threads, rounds, seconds):
    """Seconds a step, iterations, and the peak of the process's memory so far."""
    integrator, context = fluidScene(spheresAtRandom(bodies), MobilityForce.RotnePragerYamakawa,
                                     solver=MobilityForce.MatrixFree, tolerance=tolerance,
                                     threads=threads)
    steps = stepsFor(integrator, seconds)
    times, before = [], integrator.getStepStatistics()
    for _ in range(rounds):
        times.append(ownSeconds(integrator, steps, threads))
        if steps == 1 and sum(times) > 60:
            break
    after = integrator.getStepStatistics()
    made = after['steps'] - before['steps']
    del context
    return {
        'seconds_step': spread(times),
        'steps': made,
        'goal': SECONDS_GOALS.get(bodies),
        'iterations_per_step': (after['solverIterations'] - before['solverIterations'])/made,
        'products_per_step': (after['mobilityProducts'] - before['mobilityProducts'])/made,
        'peak_memory_MB': round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss/1024)
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--rounds', type=int, default=20)
    parser.add_argument('--seconds', type=float, default=0.05,
                        help='time of the steps in a round, which has at least one step')
    parser.add_argument('--threads', type=int, default=2, help='threads of the matrix-free steps')
    parser.add_argument('--tolerance', type=float, default=1e-3)
    parser.add_argument('--sizes', type=int, nargs='+', default=[100, 1000, 10000],
                        help='numbers of bodies of the matrix-free scenes')
    parser.add_argument('--only', choices=('dense', 'matrix-free'))
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    machine = describeMachine()
    result = {
        'volume_fraction': 0.1,
        'friction_over_mass_times_step': 1.0,
        'rounds': arguments.rounds
    }
    if arguments.only != 'matrix-free':
        result['dense'] = {}
        for platform in ('Reference', 'CPU'):
            for bodies in tqdm.tqdm(GOALS, desc=f'Dense, {platform}'):
                row = dense(bodies, platform, arguments.rounds, arguments.seconds)
                result['dense'].setdefault(platform, {})[str(bodies)] = row
                tqdm.tqdm.write(
                    f'  {platform:9} {bodies:4} bodies: {show(row["microseconds_step"], 1)} us a '
                    f'step, {show(row["microseconds_eigh"], 1)} us eigh, ratio '
                    f'{show(row["ratio"], 2)}, goal {row["goal"]}')
    if arguments.only != 'dense':
        rows = {}
        for bodies in tqdm.tqdm(sorted(arguments.sizes), desc='Matrix-free'):
            rows[bodies] = matrixFree(bodies, arguments.tolerance, arguments.threads,
                                      arguments.rounds, arguments.seconds)
            tqdm.tqdm.write(
                f'  {bodies:6} spheres: {show(rows[bodies]["seconds_step"], 4)} s a step, '
                f'{rows[bodies]["iterations_per_step"]:.1f} iterations, peak '
                f'{rows[bodies]["peak_memory_MB"]} MB')
        sizes = list(rows)
        exponents = {
            f'{small} to {large}': round(
                math.log(rows[large]['seconds_step']['median']/
                         rows[small]['seconds_step']['median'])/math.log(large/small), 2)
            for small, large in zip(sizes, sizes[1:])
        }
        print('exponents:', exponents)
        result['matrix_free'] = {
            'tolerance': arguments.tolerance,
            'threads': arguments.threads,
            'platform': 'CPU',
            'spheres': {str(bodies): row
                        for bodies, row in rows.items()},
            'exponents_of_time': exponents
        }
    result['load_averages_at_the_end'] = [round(x, 2) for x in os.getloadavg()]
    save(
        arguments.output, 'langevin_hi' +
        ('' if arguments.only is None else '_' + arguments.only.replace('-', '_')) + '.json',
        machine, result)


if __name__ == '__main__':
    main()
