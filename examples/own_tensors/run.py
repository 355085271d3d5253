#!/usr/bin/env python3
"""Rods with given mobility tensors fall through a fluid; tilted rods glide sideways.

    python3 run.py                     # seconds; draws picture.png
"""
import argparse

import numpy as np
import openmm
from openmm import unit

from openmmrigidhi import CustomBodyForce, CustomRigidHIIntegrator, MobilityForce

#: Mobilities of a slender rod along it, across it, and about its axes; then its weight.
ALONG, ACROSS, TURNING, WEIGHT = 2.0, 1.0, 1.0, 1.0


def fall(tilts, duration, steps=50):
    """Paths (steps + 1, rods, 3) of rods tilted by these angles from the vertical, rad."""
    system, fluid = openmm.System(), MobilityForce()
    fluid.setModel(fluid.FreeDraining)  # bodies do not interact through the fluid
    fluid.setViscosity(1.0)
    integrator = CustomRigidHIIntegrator(0, duration/steps)
    integrator.setScheme(integrator.FixmanMidpoint)
    weight = CustomBodyForce('0', '0', '-weight', '0', '0', '0')
    weight.addGlobalParameter('weight', WEIGHT)
    for _ in tilts:
        particle = system.addParticle(0)
        fluid.addParticle(1.0)
        body = integrator.addRigidBody([particle], 0, (0, 0, 0), [(0, 0, 0)])
        fluid.setBodyMobility(body, np.diag([ALONG, ACROSS, ACROSS, TURNING, TURNING,
                                             TURNING]))  # in the body's frame, x along the rod
        weight.addBody(body, [])
    system.addForce(weight)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions([(0, 0, 0)]*len(tilts))
    # A turn about y brings the body's x axis to (sin tilt, 0, cos tilt).
    half = (np.asarray(tilts) - np.pi/2)/2
    integrator.setBodyOrientations(np.stack([np.cos(half), 0*half, np.sin(half), 0*half], axis=1))
    path = [integrator.getBodyPositions()/unit.nanometer]
    for _ in range(steps):
        integrator.step(1)
        path.append(integrator.getBodyPositions()/unit.nanometer)
    return np.array(path)


def theory(tilts):
    """The velocity of each rod.

    It is the weight along the rod times one mobility, plus the weight across the rod times the
    other.
    """
    axis = np.stack([np.sin(tilts), 0*tilts, np.cos(tilts)], axis=1)
    force = np.array([0, 0, -WEIGHT])
    along = (axis @ force)[:, None]*axis
    return ALONG*along + ACROSS*(force - along)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--duration', type=float, default=10, help='ps (default 10)')
    parser.add_argument('--picture', default='picture.png',
                        help='file to draw (default picture.png)')
    arguments = parser.parse_args()
    import matplotlib
    matplotlib.use('Agg')
    import matplotlib.pyplot as plt
    tilts = np.radians([0, 20, 40, 60, 90])
    paths = fall(tilts, arguments.duration)
    print(f'largest difference from theory: '
          f'{np.abs(paths[-1]/arguments.duration - theory(tilts)).max():.1e} nm/ps')
    figure, ax = plt.subplots(figsize=(7, 5), layout='constrained')
    for k, tilt in enumerate(tilts):
        start = 6*k
        x, z = start + paths[:, k, 0], paths[:, k, 2]
        ax.plot(x, z, '--', color=f'C{k}', linewidth=1)
        for place in (0, 25, 50):
            ends = np.outer([-1.8, 1.8], [np.sin(tilt), np.cos(tilt)]) + (x[place], z[place])
            ax.plot(*ends.T, color=f'C{k}', linewidth=6, solid_capstyle='round')
        ax.text(start, 3, f'{np.degrees(tilt):.0f}°', ha='center')
    ax.set(xlabel='x (nm)', ylabel='z (nm)', aspect='equal', ylim=(-24, 5.5))
    figure.savefig(arguments.picture, dpi=130)


if __name__ == '__main__':
    main()
