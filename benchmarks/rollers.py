#!/usr/bin/python3
"""Steps of rollers above a no-slip wall, with and without lubrication.

    PYTHONPATH=build/python /usr/bin/python3 benchmarks/rollers.py

100 spheres of radius 1 nm lie in a layer above the wall, at an area fraction of 0.3 and gaps of 0.1
and more, and torques spin them. Steps have noise, on one thread of the CPU platform; the smallest
time of some steps counts. Results are written to rollers.json.
"""
import argparse
import pathlib

import numpy as np
import openmm

from common import RESULTS, describeMachine, ownSeconds, save
from openmmrigidhi import CustomBodyForce, CustomRigidHIIntegrator, MobilityForce, app

AREA_FRACTION, GAP, LAYER, TORQUE, TOLERANCE, STEPS = 0.3, 0.1, 2.3, 1e3, 1e-3, 12
#: (boundary, model, solver, lubrication)
# yapf: disable
ROWS = (
    ('PeriodicWall', 'RotnePragerYamakawa', 'MatrixFree', 'Off'),
    ('PeriodicWall', 'RotnePragerYamakawa', 'MatrixFree', 'On'),
    ('PeriodicWall', 'ForceCoupling', 'MatrixFree', 'Off'),
    ('PeriodicWall', 'ForceCoupling', 'MatrixFree', 'On'),
    ('NoSlipWall', 'RotnePragerYamakawa', 'Dense', 'Off'),
    ('NoSlipWall', 'RotnePragerYamakawa', 'Dense', 'On'),
    ('NoSlipWall', 'RotnePragerYamakawa', 'MatrixFree', 'Off'),
    ('NoSlipWall', 'RotnePragerYamakawa', 'MatrixFree', 'On'),
)
# yapf: enable


def measure(number, boundary, model, solver, lubrication, seed):
    edge = (number*np.pi/AREA_FRACTION)**0.5
    system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(300, 1e-3)
    system.setDefaultPeriodicBoxVectors(*np.diag((edge, edge, 2*edge)))
    integrator.setScheme('TractionEulerMaruyama')
    integrator.setRandomNumberSeed(seed)
    drive = CustomBodyForce('0', '0', '0', '0', f'{TORQUE}', '0')
    for _ in range(number):
        drive.addBody(app.addRigidMultiblob(system, integrator, fluid, [(0, 0, 0)], 1.0))
    fluid.setModel(model)
    fluid.setBoundary(boundary)
    fluid.setViscosity(536)
    fluid.setSolver(solver)
    fluid.setSolverTolerance(TOLERANCE)
    fluid.setLubrication(lubrication)
    system.addForce(fluid)
    system.addForce(drive)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'),
                             {'Threads': '1'})
    context.setPositions(
        app.randomSuspension(number, 1, (edge, edge, LAYER), gap=GAP, wallAxis=2, seed=seed))
    integrator.step(2)  # tables and plans are made once
    return {
        'boundary': boundary,
        'model': model,
        'solver': solver,
        'lubrication': lubrication,
        'seconds': float(f'{min(ownSeconds(integrator, 1) for _ in range(STEPS)):.3g}')
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--number', type=int, default=100, help='number of spheres')
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    machine, rows = describeMachine(), []
    for row in ROWS:
        rows.append(measure(arguments.number, *row, arguments.seed))
        print(rows[-1], flush=True)
        save(
            arguments.output, 'rollers.json', machine, {
                'seed': arguments.seed,
                'spheres': arguments.number,
                'area_fraction': AREA_FRACTION,
                'tolerance': TOLERANCE,
                'rows': rows
            })


if __name__ == '__main__':
    main()
