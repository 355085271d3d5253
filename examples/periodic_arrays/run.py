#!/usr/bin/env python3
"""Simple cubic arrays of spheres: what each model makes of the drag and the torque of a dense array, beside exact numbers.

One sphere in a cubic periodic box is an infinite array. F = 6 pi eta a K U is the force on each sphere that moves through the fluid with the
velocity U relative to the mean, T = 8 pi eta a^3 KR Omega the torque where all spheres rotate alike. Exact K: A. A. Zick, G. M. Homsy,
J. Fluid Mech. 115, 13 (1982), to more digits by a collocation of our own, KR by the same.

    python3 run.py --output results          # a second
"""
import argparse
import sys
from pathlib import Path

import numpy as np
import openmm

import openmmrigidhi
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
import recording  # noqa: E402

# volume fraction: K, KR
EXACT = {0.001: (1.212141, 1.001001), 0.027: (2.007748, 1.027761), 0.064: (2.810198, 1.068608), 0.125: (4.291589, 1.145253),
         0.216: (7.441954, 1.292910), 0.343: (15.39949, 1.635752), 0.45: (28.0864, 2.318367)}
MODELS = {'RPY': (MobilityForce.RotnePragerYamakawa, False), 'force coupling': (MobilityForce.ForceCoupling, False),
          'FTS': (MobilityForce.StokesianDynamics, False), 'FTS + lubrication': (MobilityForce.StokesianDynamics, True)}


def drag(fraction, model, lubrication):
    """K and KR of the array, by the friction of one sphere of radius 1 in its box."""
    system, fluid = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(0, 0.001)
    integrator.setScheme(CustomRigidHIIntegrator.EulerMaruyama)
    integrator.addRigidBody([system.addParticle(0)], 0, (0, 0, 0), [(0, 0, 0)])
    fluid.addParticle(1)
    fluid.setViscosity(1)
    fluid.setModel(model)
    fluid.setBoundary(MobilityForce.Periodic)
    fluid.setLubrication(lubrication)
    system.addForce(fluid)
    side = (4*np.pi/3/fraction)**(1/3)
    system.setDefaultPeriodicBoxVectors((side, 0, 0), (0, side, 0), (0, 0, side))
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions([(0, 0, 0)])
    friction = fluid.getFrictionInContext(context)
    return friction[0, 0]/(6*np.pi), friction[3, 3]/(8*np.pi)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--output', type=Path, default=Path('results'), help='folder of the JSON (results)')
    arguments = parser.parse_args()
    rows = []
    for fraction, (K, KR) in EXACT.items():
        row = {'fraction': fraction, 'exact': {'K': K, 'KR': KR}}
        for name, (model, lubrication) in MODELS.items():
            row[name] = dict(zip(('K', 'KR'), drag(fraction, model, lubrication)))
        rows.append(row)
        print(f'{fraction:6.3f}', *(f'{name}: K {values["K"]:.6f}, KR {values["KR"]:.6f};'
                                    for name, values in row.items() if name != 'fraction'))
    recording.save(arguments.output, 'simple_cubic.json', {'arrays': rows, 'run': recording.provenance(arguments)})


if __name__ == '__main__':
    main()
