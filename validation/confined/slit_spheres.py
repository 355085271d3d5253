#!/usr/bin/python3
"""The mobility of a sphere in a slit: single spheres, with and without lubrication, beside shells.

    /usr/bin/python3 slit_spheres.py --output results        # minutes
    /usr/bin/python3 slit_spheres.py --output somewhere --quick

A shell of many blobs resolves both walls. Lubrication of a single sphere acts at each wall as if
the other wall were absent. README.md in this folder has the table. Lengths are in radii, mobilities
in those of a sphere in unbounded fluid.
"""
import argparse
import pathlib

import numpy as np
import openmm

from confinedscene import quietly  # isort: skip
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, app
from recording import provenance, save  # isort: skip

#: Width of the slit and height of the centre.
PLACES = ((10, 5), (10, 1.2), (6, 3), (4, 2), (4, 1.2), (3, 1.5), (2.6, 1.3))
#: Blobs of the shells; two numbers show how far they have converged.
SHELLS = (162, 642)
#: The edge of the box along the walls, in widths.
EDGE = 2.5


def mobilities(width, height, blobs, lubrication):
    """Along and across the slit, of one sphere or of a shell of blobs.

    Along the walls the value is the mean of those without a pressure gradient and without flux,
    whose images have opposite effects.
    """
    values = []
    for condition in ('ZeroPressureGradient', 'ZeroFlux'):
        system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(0, 1)
        integrator.setScheme('FixmanMidpoint')
        sites, radius = ([(0, 0, 0)], 1.0) if blobs == 1 else app.multiblobSphere(blobs, 1.0)
        app.addRigidMultiblob(system, integrator, fluid, sites, radius)
        fluid.setViscosity(1/(6*np.pi))
        fluid.setModel('RotnePragerYamakawa' if blobs == 1 else 'ForceCoupling')
        fluid.setBoundary('NoSlipChannel')
        fluid.setChannelWalls(0, width)
        fluid.setChannelCondition(condition)
        fluid.setSolver('Dense' if blobs == 1 else 'MatrixFree')
        fluid.setSolverTolerance(1e-6 if blobs == 1 else 1e-3)
        fluid.setLubrication('On' if lubrication else 'Off')
        system.addForce(fluid)
        system.setDefaultPeriodicBoxVectors(*np.diag([EDGE*width, EDGE*width, width]))
        app.bindBodies(system, integrator)
        context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'))
        app.placeBodies(context, [(0, 0, height)])
        velocities = fluid.applyMobilityInContext(context, np.eye(6)[[0]])[0], \
            fluid.applyMobilityInContext(context, np.eye(6)[[2]])[0]
        values.append([velocities[0][0], velocities[1][2]])
    return np.mean(values, axis=0).tolist()


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--quick', action='store_true', help='one place, small shells')
    parser.add_argument('--output', type=pathlib.Path, default=pathlib.Path('results'))
    args = parser.parse_args()
    rows = []
    for width, height in PLACES[3:4] if args.quick else PLACES:
        row = {'width': width, 'height': height}
        for name, blobs, lubrication in [('spheres', 1, False), ('lubricated', 1, True),
                                         *((f'shell of {blobs}', blobs, False)
                                           for blobs in ((12, 42) if args.quick else SHELLS))]:
            row[name] = quietly(mobilities, width, height, blobs, lubrication)
        rows.append(row)
        print(row, flush=True)
    save(args.output, 'slit_spheres.json', {'rows': rows, 'provenance': provenance(args)})


if __name__ == '__main__':
    main()
