#!/usr/bin/python3
"""From which number of particles on a grid serves RotnePragerYamakawa in a periodic box best.

    PYTHONPATH=build/python /usr/bin/python3 benchmarks/split_ewald_steps.py

Steps by matrices of lattice sums are compared with steps by pairs and waves on a grid.
EulerMaruyama takes a product and a random field, FixmanMidpoint products and two roots of the whole
matrix. The scenes are spheres of radius 1 nm without overlap, or as many free particles. The
smallest CPU time of three steps on one thread of the CPU platform counts. Results are written to
split_ewald_steps.json.
"""
import argparse
import pathlib

import numpy as np
import openmm

from common import RESULTS, describeMachine, ownSeconds, save
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce

NUMBERS = (10, 20, 40, 80, 160)


def places(count, edge, seed):
    """Places of spheres of radius 1, at random without overlap."""
    random, found = np.random.default_rng(seed), np.empty((0, 3))
    while len(found) < count:
        place = random.uniform(0, edge, 3)
        separations = (found - place + edge/2) % edge - edge/2
        if (np.linalg.norm(separations, axis=1) > 2).all():
            found = np.vstack([found, place])
    return found


def seconds(count, spheres, fraction, solver, tolerance, scheme, seed):
    edge = (4*np.pi/3*count/fraction)**(1/3)
    system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(300, 1e-6)
    system.setDefaultPeriodicBoxVectors(*edge*np.eye(3))
    integrator.setScheme(getattr(CustomRigidHIIntegrator, scheme))
    integrator.setRandomNumberSeed(seed)
    for _ in range(count):
        particle = system.addParticle(0)
        if spheres:
            integrator.addRigidBody([particle], 0, (0, 0, 0), [(0, 0, 0)])
        fluid.addParticle(1)
    fluid.setBoundary(MobilityForce.Periodic)
    fluid.setSolver(getattr(MobilityForce, solver))
    fluid.setSolverTolerance(tolerance)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'),
                             {'Threads': '1'})
    context.setPositions(places(count, edge, seed))
    integrator.step(1)
    return min(ownSeconds(integrator, 1) for _ in range(3))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    machine, rows = describeMachine(), []
    for spheres in (True, False):
        for fraction in (0.1, 0.01):
            for tolerance in (1e-3, 1e-6):
                for scheme in ('EulerMaruyama', 'FixmanMidpoint'):
                    row = {
                        'what': 'spheres' if spheres else 'blobs',
                        'volume_fraction': fraction,
                        'tolerance': tolerance,
                        'scheme': scheme,
                        'dense_over_grid': {},
                        'ms_grid': {}
                    }
                    for count in NUMBERS:
                        dense, grid = (seconds(count, spheres, fraction, solver, tolerance, scheme,
                                               arguments.seed)
                                       for solver in ('Dense', 'MatrixFree'))
                        row['dense_over_grid'][count], row['ms_grid'][count] = float(
                            f'{dense/grid:.2g}'), float(f'{1e3*grid:.2g}')
                    rows.append(row)
                    print(row, flush=True)
    save(arguments.output, 'split_ewald_steps.json', machine, {
        'seed': arguments.seed,
        'rows': rows
    })


if __name__ == '__main__':
    main()
