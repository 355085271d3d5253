#!/usr/bin/python3
"""Time and memory of a step of spheres in a periodic box, by model and number of spheres.

The benchmark tells up to which number of spheres dense matrices are practical. Spheres are on a
cubic lattice at a volume fraction of 0.1, with EulerMaruyama. Each case runs in a process of its
own, on one thread.

    PYTHONPATH=build/python /usr/bin/python3 benchmarks/periodic.py
"""
import argparse
import json
import pathlib
import resource
import subprocess
import sys
import time

import numpy as np
import openmm
import tqdm
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce

from common import RESULTS, describeMachine, save

CASES = [(n, model) for n in (100, 300, 1000)
         for model in ('RotnePragerYamakawa', 'ForceCoupling', 'StokesianDynamics')] + \
    [(2000, 'RotnePragerYamakawa')]
FRACTION = 0.1


def measure(count, model):
    """Seconds of a step without and with noise, and the peak of memory, GB."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    system, fluid = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(0, 0.01)
    integrator.setScheme(CustomRigidHIIntegrator.EulerMaruyama)
    for i in range(count):
        integrator.addRigidBody([system.addParticle(0)], 0, (0, 0, 0), [(0, 0, 0)])
        fluid.addParticle(1)
    fluid.setModel(getattr(MobilityForce, model))
    fluid.setBoundary(MobilityForce.Periodic)
    fluid.setSolver(MobilityForce.Dense)
    system.addForce(fluid)
    side = (count*4*np.pi/3/FRACTION)**(1/3)
    system.setDefaultPeriodicBoxVectors(*side*np.eye(3))
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'),
                             {'Threads': '1'})
    cells = int(np.ceil(count**(1/3)))
    places = np.stack(np.meshgrid(*[np.arange(cells)]*3), -1).reshape(-1, 3)[:count]
    context.setPositions((places + 0.5)*side/cells)
    seconds = []
    for temperature in (0, 300):
        integrator.setTemperature(temperature)
        start = time.perf_counter()
        integrator.step(1)
        seconds.append(round(time.perf_counter() - start, 3))
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    return {
        'spheres': count,
        'model': model,
        'seconds_cold': seconds[0],
        'seconds_with_noise': seconds[1],
        'gigabytes': round(used/1e6, 3)
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS, help='folder of the JSON')
    parser.add_argument('--case', nargs=2, metavar=('COUNT', 'MODEL'),
                        help='measure one case and print it')
    arguments = parser.parse_args()
    if arguments.case:
        print(json.dumps(measure(int(arguments.case[0]), arguments.case[1])))
        return
    machine, results = describeMachine(), []
    for count, model in tqdm.tqdm(CASES, desc='cases'):
        finished = subprocess.run([sys.executable, __file__, '--case',
                                   str(count), model], capture_output=True, text=True, check=True)
        results.append(json.loads(finished.stdout))
    save(arguments.output, 'periodic.json', machine, {
        'volume_fraction': FRACTION,
        'cases': results
    })


if __name__ == '__main__':
    main()
