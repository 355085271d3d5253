#!/usr/bin/python3
"""The time of a Brownian step in a slip channel on a grid, and where the time goes.

Cubes of eight touching blobs are on a lattice between the walls, at a volume fraction of 0.2, with
DriftCorrectorFD. Each case runs in one process of its own, on one thread. The smallest CPU time of
five steps counts.

    PYTHONPATH=build/python /usr/bin/python3 benchmarks/channel_steps.py
"""
import argparse
import json
import pathlib
import subprocess
import sys

import numpy as np
import openmm
import openmmrigidhi
import tqdm
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce

from common import RESULTS, describeMachine, ownSeconds, save

CELLS = ((12, 1, 12), (16, 4, 16), (16, 16, 16))  # cubes along x, y, z
TOLERANCES = (1e-2, 1e-3)
FRACTION = 0.2
CUBE = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), -1).reshape(-1, 3).astype(float)
TIMES = ('seconds_spreading', 'seconds_fft', 'seconds_averaging', 'seconds_solver',
         'seconds_mobility', 'seconds_scheme')


def measure(cells, tolerance, steps=5):
    """Seconds of a step, its parts, and iterations."""
    system, fluid = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(300, 0.001)
    integrator.setScheme(CustomRigidHIIntegrator.DriftCorrectorFD)
    integrator.setRandomNumberSeed(1)
    edge = (8*4*np.pi/3/FRACTION)**(1/3)
    centres = edge*(np.array(list(np.ndindex(*cells))) + 0.5)
    for _ in centres:
        integrator.addRigidBody([system.addParticle(0) for _ in CUBE], 0, (0, 0, 0), CUBE)
        for _ in CUBE:
            fluid.addParticle(1)
    fluid.setModel(MobilityForce.ForceCoupling)
    fluid.setBoundary(MobilityForce.SlipChannel)
    fluid.setChannelWalls(0, edge*cells[1])
    fluid.setSolver(MobilityForce.MatrixFree)
    fluid.setSolverTolerance(tolerance)
    system.addForce(fluid)
    system.setDefaultPeriodicBoxVectors(*np.diag(edge*(np.array(cells) + (0, 1, 0))))
    openmmrigidhi.app.bindBodies(system, integrator)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'),
                             {'Threads': '1'})
    context.setPositions((centres[:, None] + CUBE).reshape(-1, 3))
    integrator.step(1)
    first = integrator.getStepStatistics()
    seconds = [ownSeconds(integrator, 1) for _ in range(steps)]
    done = integrator.getStepStatistics()
    result = {
        'blobs': len(centres)*len(CUBE),
        'width_in_radii': round(edge*cells[1], 2),
        'tolerance': tolerance,
        'grid': integrator.getEffects()['hydrodynamics'].split(' on ')[-1].split(',')[0],
        'seconds': round(min(seconds), 5),
        'iterations': (done['solverIterations'] - first['solverIterations'])/steps
    }
    for name in TIMES:
        result[name] = round((done[name] - first[name])/steps, 5)
    return result


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS, help='folder of the JSON')
    parser.add_argument('--case', help='measure one case and print it')
    arguments = parser.parse_args()
    if arguments.case:
        print(json.dumps(measure(*json.loads(arguments.case))))
        return
    machine, results = describeMachine(), []
    for case in tqdm.tqdm([(cells, tolerance) for cells in CELLS for tolerance in TOLERANCES],
                          desc='steps in channels'):
        results.append(
            json.loads(
                subprocess.run([sys.executable, __file__, '--case',
                                json.dumps(case)], capture_output=True, text=True,
                               check=True).stdout))
    save(arguments.output, 'channel_steps.json', machine, {
        'volume_fraction': FRACTION,
        'scheme': 'DriftCorrectorFD',
        'steps': results
    })


if __name__ == '__main__':
    main()
