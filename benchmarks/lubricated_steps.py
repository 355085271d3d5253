#!/usr/bin/python3
"""Steps of spheres with lubrication in a periodic box by iterations, and the price of their stress.

    PYTHONPATH=build/python /usr/bin/python3 benchmarks/lubricated_steps.py

Spheres of radius 1 nm are hard spheres in equilibrium, gaps of a thousandth of a radius and more
("random"), or the same with each sphere moved to this gap from its nearest neighbour where there is
room ("close"), or with every eighth sphere a shell of 12 blobs ("shells"). Steps have noise, on one
thread of the CPU platform; the smallest CPU time of three steps counts. Results are written to
lubricated_steps.json.
"""
import argparse
import pathlib
import time

import numpy as np
import openmm
import tqdm

from common import RESULTS, describeMachine, ownSeconds, save
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, app

GAP = 1e-3
#: (scene, number, volume fraction, model, scheme, tolerance, sheared)
# yapf: disable
ROWS = (
    ('random', 864, 0.3, 'StokesianDynamics', 'TractionEulerMaruyama', 1e-3, False),
    ('random', 2916, 0.3, 'StokesianDynamics', 'TractionEulerMaruyama', 1e-3, False),
    ('random', 10976, 0.3, 'StokesianDynamics', 'TractionEulerMaruyama', 1e-3, False),
    ('close', 864, 0.3, 'StokesianDynamics', 'TractionEulerMaruyama', 1e-3, False),
    ('close', 10976, 0.3, 'StokesianDynamics', 'TractionEulerMaruyama', 1e-3, False),
    ('random', 864, 0.45, 'StokesianDynamics', 'TractionEulerMaruyama', 1e-3, False),
    ('random', 864, 0.3, 'StokesianDynamics', 'TractionEulerMaruyama', 1e-3, True),
    ('random', 864, 0.3, 'StokesianDynamics', 'TractionEulerMaruyama', 1e-6, False),
    ('random', 864, 0.3, 'StokesianDynamics', 'TrapezoidalSlip', 1e-3, False),
    ('random', 864, 0.3, 'StokesianDynamics', 'FixmanMidpoint', 1e-3, False),
    ('random', 864, 0.3, 'RotnePragerYamakawa', 'TractionEulerMaruyama', 1e-3, False),
    ('random', 864, 0.3, 'ForceCoupling', 'TractionEulerMaruyama', 1e-3, False),
    ('shells', 864, 0.3, 'RotnePragerYamakawa', 'TractionEulerMaruyama', 1e-3, False),
    ('shells', 864, 0.3, 'ForceCoupling', 'TractionEulerMaruyama', 1e-3, False),
)
# yapf: enable


def nearest(x, edge, i):
    """Distances of sphere i from all others; that from itself is infinite."""
    apart = x - x[i]
    apart -= edge*np.round(apart/edge)
    distances = np.linalg.norm(apart, axis=1)
    distances[i] = np.inf
    return distances, apart


def suspension(scene, number, fraction, seed):
    """(centres (number, 3), edge of the box, share of spheres within 0.01 of a neighbour)."""
    edge = (4*np.pi/3*number/fraction)**(1/3)
    x = app.randomSuspension(number, 1, edge, gap=GAP, seed=seed)._value
    for i in range(number) if scene == 'close' else ():
        distances, apart = nearest(x, edge, i)
        j, before = distances.argmin(), x[i].copy()
        x[i] += (distances[j] - 2 - GAP*(1 + 1e-9))*apart[j]/distances[j]
        if nearest(x, edge, i)[0].min() < 2 + GAP:
            x[i] = before
    close = np.mean([nearest(x, edge, i)[0].min() < 2.01 for i in range(number)])
    return x, edge, float(close)


def measure(scene, number, fraction, model, scheme, tolerance, sheared, seed):
    x, edge, close = suspension(scene, number, fraction, seed)
    system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(300, 1e-7)
    system.setDefaultPeriodicBoxVectors(*edge*np.eye(3))
    integrator.setScheme(getattr(CustomRigidHIIntegrator, scheme))
    integrator.setRandomNumberSeed(seed)
    shell, radius = (found._value for found in app.multiblobSphere(12, 1))
    positions = []
    for i, centre in enumerate(x):
        sites = shell if scene == 'shells' and i % 8 == 0 else np.zeros((1, 3))
        members = [system.addParticle(0) for _ in sites]
        integrator.addRigidBody(members, 0, (0, 0, 0), sites)
        for _ in sites:
            fluid.addParticle(radius if len(sites) > 1 else 1)
        positions.extend(centre + sites)
    app.bindBodies(system, integrator)
    fluid.setModel(getattr(MobilityForce, model))
    fluid.setLubrication(True)
    fluid.setBoundary(MobilityForce.Periodic)
    fluid.setSolver(MobilityForce.MatrixFree)
    fluid.setSolverTolerance(tolerance)
    if sheared:
        fluid.setShear(1.0, 0, 1)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'),
                             {'Threads': '1'})
    context.setPositions(positions)
    integrator.step(1)  # tables and plans are made once
    before = integrator.getStepStatistics()
    seconds = min(ownSeconds(integrator, 1) for _ in range(3))
    after = integrator.getStepStatistics()
    row = {
        'scene': scene,
        'spheres': number,
        'volume_fraction': fraction,
        'within_0.01': float(f'{close:.2g}'),
        'model': model,
        'scheme': scheme,
        'tolerance': tolerance,
        'sheared': sheared,
        'seconds': float(f'{seconds:.3g}')
    }
    for key in ('mobilityProducts', 'solverIterations'):
        row[key] = round((after[key] - before[key])/3, 1)
    if model == 'StokesianDynamics':
        fluid.getStressInContext(context)
        start = time.process_time()
        fluid.getStressInContext(context)
        row['seconds_of_stress'] = float(f'{time.process_time() - start:.3g}')
    return row


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--largest', type=int, default=10976, help='number of spheres')
    parser.add_argument('--scene', choices=['random', 'close', 'shells'], help='only this one')
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    machine, rows = describeMachine(), []
    wanted = [
        row for row in ROWS if row[1] <= arguments.largest and arguments.scene in (None, row[0])
    ]
    for row in tqdm.tqdm(wanted, desc='Steps'):
        rows.append(measure(*row, arguments.seed))
        tqdm.tqdm.write(str(rows[-1]))
        save(arguments.output, 'lubricated_steps.json', machine, {
            'seed': arguments.seed,
            'gap': GAP,
            'rows': rows
        })


if __name__ == '__main__':
    main()
