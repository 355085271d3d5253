#!/usr/bin/python3
"""Whether Auto takes the faster of matrices and a grid in a periodic box.

    PYTHONPATH=build/python /usr/bin/python3 benchmarks/auto_choice.py

Steps by matrices of lattice sums are compared with steps on a grid, by model, scheme, volume
fraction, tolerance and number of particles. The particles are of radius 1 nm: free particles
(blobs), spheres that form bodies, and cubes of eight touching blobs, on a cubic lattice. The
smaller CPU time of two steps on one thread of the CPU platform counts, one way right after the
other. The choice and its estimates are those of describeEffects() with setSolver(Auto). Results are
written to auto_choice.json.
"""
import argparse
import itertools
import pathlib
import re

import numpy as np
import openmm
import openmmrigidhi

from common import RESULTS, describeMachine, ownSeconds, save
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce

SCHEMES = {
    'EulerMaruyama': ('blobs', 'spheres'),
    'FixmanMidpoint': ('blobs', 'cubes'),
    'RandomFiniteDifference': ('cubes',),
    'TrapezoidalSlip': ('cubes',),
    'DriftCorrectorRFD': ('cubes',),
    'LangevinHI': ('blobs', 'spheres', 'cubes')
}
NUMBERS = {'blobs': (96, 288), 'spheres': (48,), 'cubes': (96, 288)}
CUBE = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), -1).reshape(-1, 3).astype(float)
ESTIMATE = re.compile(r'estimated to take (\S+) s with matrices and (\S+) s on a grid')


def start(model, scheme, what, count, fraction, tolerance, solver):
    hasMomenta = scheme == 'LangevinHI'
    sites = CUBE if what == 'cubes' else np.zeros((1, 3))
    edge, bodies = (4*np.pi/3*count/fraction)**(1/3), count // len(sites)
    cells = int(np.ceil(bodies**(1/3) - 1e-9))
    centres = (np.array(list(np.ndindex(cells, cells, cells)))[:bodies] + 0.5)*edge/cells
    system, fluid = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(300, 0.01 if hasMomenta else 0.001)
    integrator.setScheme(getattr(CustomRigidHIIntegrator, scheme))
    integrator.setRandomNumberSeed(1)
    mass = 100*len(sites) if hasMomenta else 0
    for body in range(bodies):
        for _ in sites:
            system.addParticle(100 if hasMomenta else 0)
            fluid.addParticle(1)
        if what != 'blobs':
            first = body*len(sites)
            integrator.addRigidBody(range(first, first + len(sites)), mass, (2*mass,)*3,
                                    [tuple(site) for site in sites])
    fluid.setModel(getattr(MobilityForce, model))
    fluid.setBoundary(MobilityForce.Periodic)
    fluid.setSolver(getattr(MobilityForce, solver))
    fluid.setSolverTolerance(tolerance)
    system.setDefaultPeriodicBoxVectors(*edge*np.eye(3))
    system.addForce(fluid)
    if what == 'cubes':
        openmmrigidhi.app.bindBodies(system, integrator)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'),
                             {'Threads': '1'})
    context.setPositions((centres[:, None] + sites).reshape(-1, 3))
    return context, integrator


def seconds(*scene):
    context, integrator = start(*scene)
    integrator.step(1)
    return min(ownSeconds(integrator, 1) for _ in range(2))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--largest', type=int, default=288, help='number of particles')
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    machine, rows = describeMachine(), []
    for model, fraction, tolerance in itertools.product(('ForceCoupling', 'RotnePragerYamakawa'),
                                                        (0.1, 0.003), (1e-3, 1e-6)):
        for scheme, kinds in SCHEMES.items():
            for what in kinds:
                for count in NUMBERS[what]:
                    if count > arguments.largest:
                        continue
                    scene = model, scheme, what, count, fraction, tolerance
                    context, integrator = start(*scene, 'Auto')
                    text = integrator.describeEffects()
                    matrices, grid = map(float, ESTIMATE.search(text).groups())
                    del context
                    row = dict(
                        zip(('model', 'scheme', 'what', 'particles', 'volume_fraction',
                             'tolerance'), scene))
                    measured = {
                        solver: float(f'{seconds(*scene, solver):.3g}')
                        for solver in ('Dense', 'MatrixFree')
                    }
                    taken = 'MatrixFree' if ' on a grid of ' in text else 'Dense'
                    row.update(
                        estimated_matrices=matrices, estimated_grid=grid,
                        seconds_matrices=measured['Dense'], seconds_grid=measured['MatrixFree'],
                        auto='grid' if taken == 'MatrixFree' else 'matrices',
                        auto_over_faster=float(f'{measured[taken]/min(measured.values()):.3g}'))
                    rows.append(row)
                    print(row, flush=True)
        save(arguments.output, 'auto_choice.json', machine, {'rows': rows})


if __name__ == '__main__':
    main()
