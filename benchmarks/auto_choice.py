#!/usr/bin/python3
"""Whether Auto takes the faster of matrices and a grid in a periodic box, or along a wall.

    PYTHONPATH=build/python /usr/bin/python3 benchmarks/auto_choice.py
    PYTHONPATH=build/python /usr/bin/python3 benchmarks/auto_choice.py --walls

Steps by matrices of lattice sums are compared with steps on a grid, by model, scheme, volume
fraction, tolerance and number of particles. The particles are of radius 1 nm: free particles
(blobs), spheres that form bodies, and cubes of eight touching blobs, on a cubic lattice. The
smaller CPU time of two steps on one thread of the CPU platform counts, one way right after the
other. The choice and its estimates are those of describeEffects() with setSolver(Auto). Results are
written to auto_choice.json.

With --walls the scenes are layers of spheres above a wall, which are periodic in the plane. The
fraction is that of the plane which the spheres cover. Results are written to
auto_choice_walls.json.
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

#: Of layers above a wall: scheme, lubrication, temperature.
OF_LAYERS = (('EulerMaruyama', False, 300), ('FixmanMidpoint', False, 300),
             ('TractionEulerMaruyama', True, 300), ('TractionEulerMaruyama', True, 0))


def startLayer(scheme, lubricated, temperature, count, fraction, tolerance, solver):
    """Spheres of 1 nm at heights of 1.05 to 1.35 nm above a wall."""
    edge = (np.pi*count/fraction)**0.5
    positions = openmmrigidhi.app.randomSuspension(count, 1.0, (edge, edge, 2.4), gap=0.05,
                                                   wallAxis=2, seed=1)
    system, fluid = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(temperature, 0.001)
    integrator.setScheme(getattr(CustomRigidHIIntegrator, scheme))
    integrator.setRandomNumberSeed(1)
    for _ in range(count):
        openmmrigidhi.app.addRigidMultiblob(system, integrator, fluid, [(0, 0, 0)], 1.0)
    fluid.setBoundary(MobilityForce.PeriodicWall)
    fluid.setSolver(getattr(MobilityForce, solver))
    fluid.setSolverTolerance(tolerance)
    if lubricated:
        fluid.setLubrication('On')
    system.addForce(fluid)
    system.setDefaultPeriodicBoxVectors(*edge*np.eye(3))
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'),
                             {'Threads': '1'})
    context.setPositions(positions)
    return context, integrator


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


def seconds(begin, scene, solver):
    context, integrator = begin(*scene, solver)
    integrator.step(1)
    return float(f'{min(ownSeconds(integrator, 1) for _ in range(2)):.3g}')


def compared(begin, scene):
    """The choice of Auto, its estimates, and the times of both ways."""
    context, integrator = begin(*scene, 'Auto')
    text = integrator.describeEffects()
    matrices, grid = map(float, ESTIMATE.search(text).groups())
    del context
    auto = 'grid' if ' on a grid of ' in text else 'matrices'
    ways = {'matrices': 'Dense', 'grid': 'MatrixFree'}
    measured = {way: seconds(begin, scene, solver) for way, solver in ways.items()}
    return {
        'estimated_matrices': matrices,
        'estimated_grid': grid,
        'seconds_matrices': measured['matrices'],
        'seconds_grid': measured['grid'],
        'auto': auto,
        'auto_over_faster': float(f'{measured[auto]/min(measured.values()):.3g}')
    }


def compareLayers(output):
    machine, rows = describeMachine(), []
    for (scheme, lubricated, temperature), count, fraction, tolerance in itertools.product(
            OF_LAYERS, (30, 80), (0.3, 0.03), (1e-3, 1e-6)):
        scene = scheme, lubricated, temperature, count, fraction, tolerance
        row = dict(
            zip(('scheme', 'lubrication', 'temperature', 'particles', 'area_fraction', 'tolerance'),
                scene), **compared(startLayer, scene))
        rows.append(row)
        print(row, flush=True)
        save(output, 'auto_choice_walls.json', machine, {'rows': rows})


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--largest', type=int, default=288, help='number of particles')
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    parser.add_argument('--walls', action='store_true', help='layers above a wall')
    arguments = parser.parse_args()
    if arguments.walls:
        return compareLayers(arguments.output)
    machine, rows = describeMachine(), []
    for model, fraction, tolerance in itertools.product(('ForceCoupling', 'RotnePragerYamakawa'),
                                                        (0.1, 0.003), (1e-3, 1e-6)):
        for scheme, kinds in SCHEMES.items():
            for what in kinds:
                for count in NUMBERS[what]:
                    if count > arguments.largest:
                        continue
                    scene = model, scheme, what, count, fraction, tolerance
                    row = dict(
                        zip(('model', 'scheme', 'what', 'particles', 'volume_fraction',
                             'tolerance'), scene), **compared(start, scene))
                    rows.append(row)
                    print(row, flush=True)
        save(arguments.output, 'auto_choice.json', machine, {'rows': rows})


if __name__ == '__main__':
    main()
