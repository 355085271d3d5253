#!/usr/bin/env python3
"""Bodies of six shapes move above a wall, under their weight and by Brownian motion.

    python3 run.py                     # ten seconds; draws picture.png
"""
import argparse

import numpy as np
import openmm
from openmm import unit

from openmmrigidhi import CustomBodyForce, CustomRigidHIIntegrator, MobilityForce, app

TEMPERATURE = 300*unit.kelvin


def hedgehog(arm, spacing):
    """Three rods of blobs through one centre, at right angles."""
    steps = spacing*np.arange(-arm, arm + 1)
    return np.unique(np.concatenate([np.outer(steps, axis) for axis in np.eye(3)]), axis=0)


#: Blobs of each shape, the radius of its blobs, and where the body starts; all in nm.
SHAPES = [(app.multiblobSphere(42, 90)[0]/unit.nanometer, 32, (-40, 100, 320)),
          (app.boomerang(42, 5)/unit.nanometer, 33, (-420, -150, 200)),
          (app.rod(8, 42)/unit.nanometer, 33, (230, -200, 240)),
          (hedgehog(3, 42), 26, (-330, 200, 330)),
          (app.cylinder(60, 180, 42)/unit.nanometer, 26, (400, 100, 220)),
          (app.tetramer(100)/unit.nanometer, 55, (0, -330, 180)),]


def scene(seed):
    """The integrator and the Context of all bodies; the weight of each is 2 kT over 100 nm."""
    system, fluid, weight = openmm.System(), MobilityForce(), CustomBodyForce(
        '0', '0', '-weight', '0', '0', '0')
    fluid.setBoundary(fluid.NoSlipWall)
    fluid.setViscosity(0.89e-3*unit.pascal*unit.second)
    weight.addGlobalParameter('weight', 0.02*unit.MOLAR_GAS_CONSTANT_R*TEMPERATURE/unit.nanometer)
    integrator = CustomRigidHIIntegrator(TEMPERATURE, 5*unit.microsecond)
    integrator.setScheme(integrator.TrapezoidalSlip)
    integrator.setRandomNumberSeed(seed)
    repulsion = openmm.CustomNonbondedForce(
        '25*(1 - tanh((r - a1 - a2)/20))')  # within a body this repulsion cancels
    repulsion.addPerParticleParameter('a')
    positions = []
    for sites, radius, origin in SHAPES:
        body = app.addRigidMultiblob(system, integrator, fluid, sites, radius)
        weight.addBody(body, [])
        positions.append(sites + origin)
        for _ in sites:
            repulsion.addParticle([radius])
    for force in (weight, repulsion, fluid):
        system.addForce(force)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'))
    context.setPositions(np.concatenate(positions))
    return integrator, context


def move(integrator, steps):
    """Take steps, and print the heights of the bodies before and after them."""
    integrator.step(steps)
    heights = integrator.getBodyPositions()[:, 2]/unit.nanometer
    for (_, _, start), height in zip(SHAPES, heights):
        print(f'height {start[2]} nm, and {height:.0f} nm after {steps} steps')
    print(
        f'{integrator.getNumRejectedSteps()} steps were done again, because they led into the wall')


def draw(context):
    """The bodies, seen from the side."""
    picture = app.show(context, view=(17, -72), title='')
    low, high = picture.get_ylim()
    picture.set_ylim(low + 80, high - 90)  # without the margin that bodies would need to turn
    picture.figure.set_size_inches(9, 5.5)
    return picture.figure


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--steps', type=int, default=250, help='time steps (default 250)')
    parser.add_argument('--seed', type=int, default=4,
                        help='seed of the random numbers (default 4)')
    parser.add_argument('--picture', default='picture.png',
                        help='file to draw (default picture.png)')
    arguments = parser.parse_args()
    integrator, context = scene(arguments.seed)
    move(integrator, arguments.steps)
    draw(context).savefig(arguments.picture, dpi=130, bbox_inches='tight', pad_inches=0)


if __name__ == '__main__':
    main()
