#!/usr/bin/python3
"""The time of a step with force coupling on a grid, beside that of FFTW's transforms.

The script also finds from which number of blobs on a grid takes less time than lattice sums.

Cubes of eight touching blobs are on a cubic lattice. Each case runs in a process of its own, on one
thread. CPU time counts where it is less than the clock's. Grid: steps of DriftCorrectorFD at volume
fraction 0.2, tolerance 1e-4. Transforms are measured by BenchmarkGridFluid with FFTW_MEASURE before
and after the steps, and the smaller time counts. Break-even, at the default tolerance and several
volume fractions, is found for three steps: a step of EulerMaruyama of single blobs without noise,
which is one product; the same step with noise, which takes the root of a matrix; a step of
DriftCorrectorFD.

    PYTHONPATH=build/python /usr/bin/python3 benchmarks/grid_steps.py
"""
import argparse
import json
import pathlib
import resource
import subprocess
import sys
import tempfile

import numpy as np
import openmm
import openmmrigidhi
import tqdm
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce

from common import RESULTS, describeMachine, ownSeconds, save

GRID = (1000, 10000, 22360, 100000)
PROGRAM = {
    22360: 22363
}  # the number of blobs in BenchmarkGridFluid, where it is no multiple of eight
BREAK_EVEN = {
    'product': (8, 24, 96, 384),
    'EulerMaruyama': (24, 96, 192),
    'DriftCorrectorFD': (8, 24)
}
FRACTIONS = (0.1, 0.01, 0.001)
CUBE = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), -1).reshape(-1, 3).astype(float)
TIMES = ('seconds_spreading', 'seconds_fft', 'seconds_averaging', 'seconds_solver',
         'seconds_mobility')


def measure(count, solver, tolerance, fraction, what, repetitions):
    """Seconds of a step, its parts, iterations, and the peak of memory above Python's, GB."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    system, fluid = openmm.System(), MobilityForce()
    product = what == 'product'
    integrator = CustomRigidHIIntegrator(0 if product else 300, 0.001)
    integrator.setScheme(CustomRigidHIIntegrator.
                         EulerMaruyama if product else getattr(CustomRigidHIIntegrator, what))
    integrator.setRandomNumberSeed(1)
    sites = np.zeros((1, 3)) if product else CUBE
    bodies, side = count // len(sites), (count*4*np.pi/3/fraction)**(1/3)
    cells = int(np.ceil(bodies**(1/3) - 1e-9))
    centres = (np.array(list(np.ndindex(cells, cells, cells)))[:bodies] + 0.5)*side/cells
    for _ in range(bodies):
        members = [system.addParticle(1 if product else 0) for _ in sites]
        for _ in sites:
            fluid.addParticle(1)
        if not product:
            integrator.addRigidBody(members, 0, (0, 0, 0), sites)
    fluid.setModel(MobilityForce.ForceCoupling)
    fluid.setBoundary(MobilityForce.Periodic)
    fluid.setSolver(getattr(MobilityForce, solver))
    if tolerance is not None:
        fluid.setSolverTolerance(tolerance)
    system.addForce(fluid)
    system.setDefaultPeriodicBoxVectors(*side*np.eye(3))
    openmmrigidhi.app.bindBodies(system, integrator)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'),
                             {'Threads': '1'})
    context.setPositions((centres[:, None] + sites).reshape(-1, 3))
    integrator.step(1)
    first = integrator.getStepStatistics()
    seconds = [ownSeconds(integrator, 1) for _ in range(repetitions)]
    done = integrator.getStepStatistics()
    result = {
        'blobs': bodies*len(sites),
        'solver': solver,
        'seconds': round(min(seconds), 5),
        'iterations': (done['solverIterations'] - first['solverIterations'])/repetitions,
        'gigabytes': round((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)/1e6, 3)
    }
    for name in TIMES:
        result[name] = round((done[name] - first[name])/repetitions, 5)
    return result


def apart(*case):
    """measure() in a process of its own."""
    return json.loads(
        subprocess.run([sys.executable, __file__, '--case',
                        json.dumps(case)], capture_output=True, text=True, check=True).stdout)


def sixTransforms(program, blobs):
    """Seconds of three forward and three backward transforms by FFTW_MEASURE."""
    with tempfile.TemporaryDirectory() as folder:
        report = pathlib.Path(folder)/'report.json'
        subprocess.run([
            str(program), f'--benchmark_filter=^sixTransforms/{PROGRAM.get(blobs, blobs)}$',
            '--benchmark_repetitions=3', f'--benchmark_out={report}', '--benchmark_out_format=json'
        ], check=True, capture_output=True)
        return min(run['cpu_time'] for run in json.loads(report.read_text())['benchmarks']
                   if run['run_type'] == 'iteration')/1e9


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS, help='folder of the JSON')
    parser.add_argument('--case', help='measure one case and print it')
    arguments = parser.parse_args()
    if arguments.case:
        print(json.dumps(measure(*json.loads(arguments.case))))
        return
    program = pathlib.Path(openmmrigidhi.__file__).parents[2]/'benchmarks/BenchmarkGridFluid'
    if not program.exists():
        raise SystemExit(
            'BenchmarkGridFluid was not built: configure with -DRIGIDHI_BUILD_BENCHMARKS=ON, as '
            'make benchmark does')
    machine, steps, evens = describeMachine(), [], []
    for blobs in tqdm.tqdm(GRID, desc='steps on a grid'):
        before = sixTransforms(program, blobs)
        step = apart(blobs, 'MatrixFree', 1e-4, 0.2, 'DriftCorrectorFD', 3)
        step['seconds_of_six_transforms'] = round(min(before, sixTransforms(program, blobs)), 5)
        step['step_over_its_transforms'] = round(
            step['seconds']/((3 + 6*(step['iterations'] + 1))*step['seconds_of_six_transforms']/6),
            3)
        steps.append(step)
    save(arguments.output, 'grid_steps.json', machine, {'steps': steps})
    machine = describeMachine()
    cases = [(what, fraction, blobs, solver) for fraction in FRACTIONS
             for what, numbers in BREAK_EVEN.items() for blobs in numbers
             for solver in ('Dense', 'MatrixFree')]
    for what, fraction, blobs, solver in tqdm.tqdm(cases, desc='break-even'):
        evens.append({
            'what': what,
            'volume_fraction': fraction,
            **apart(blobs, solver, None, fraction, what, 3)
        })
    save(arguments.output, 'grid_break_even.json', machine, {'cases': evens})


if __name__ == '__main__':
    main()
