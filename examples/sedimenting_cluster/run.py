#!/usr/bin/env python3
"""A cluster of spheres falls twenty times as fast as one sphere, and leaves some behind.

    python3 run.py                     # ten seconds; draws picture.png
"""
import argparse

import numpy as np
import openmm
from openmm import unit

from openmmrigidhi import CustomBodyForce, CustomRigidHIIntegrator, MobilityForce, app

#: The number of spheres, the radius of the cluster, and the weight of a sphere. A sphere has radius
#: 1 and weight 6 pi eta, so that alone it falls by its radius in a time of 1; all in OpenMM's
#: units.
NUMBER, CLUSTER, WEIGHT = 200, 12.0, 6*np.pi


def cluster(seed):
    """Points at random in a sphere, no two spheres of radius 1 overlapping."""
    random, points = np.random.default_rng(seed), []
    while len(points) < NUMBER:
        point = random.uniform(-CLUSTER, CLUSTER, 3)
        if np.linalg.norm(point) < CLUSTER and all(
                np.linalg.norm(point - other) > 2 for other in points):
            points.append(point)
    return np.array(points)


def scene(positions, step=0.05):
    """Spheres that fall without noise, coupled by the fluid."""
    system, fluid, weight = openmm.System(), MobilityForce(), CustomBodyForce(
        '0', '0', '-weight', '0', '0', '0')
    weight.addGlobalParameter('weight', WEIGHT)
    fluid.setViscosity(1.0)
    integrator = CustomRigidHIIntegrator(0, step)
    integrator.setScheme(integrator.FixmanMidpoint)
    for _ in positions:
        particle = system.addParticle(0)
        fluid.addParticle(1.0)
        weight.addBody(integrator.addRigidBody([particle], 0, (0, 0, 0), [(0, 0, 0)]), [])
    system.addForce(weight)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'))
    context.setPositions(positions)
    return integrator, context


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--steps', type=int, default=80,
                        help='time steps between two pictures (default 80)')
    parser.add_argument('--seed', type=int, default=1, help='seed of the positions (default 1)')
    parser.add_argument('--picture', default='picture.png',
                        help='file to draw (default picture.png)')
    arguments = parser.parse_args()
    import matplotlib
    matplotlib.use('Agg')
    import matplotlib.pyplot as plt
    integrator, context = scene(cluster(arguments.seed))
    start = np.median(integrator.getBodyPositions()[:, 2]/unit.nanometer)
    figure, axes = plt.subplots(1, 4, figsize=(8, 5.2), layout='constrained')
    for k, ax in enumerate(axes):
        if k:
            integrator.step(arguments.steps)
        time = k*arguments.steps*integrator.getStepSize()/unit.picosecond
        height = np.median(integrator.getBodyPositions()[:, 2]/unit.nanometer)
        depth = start - height
        app.show(context, view=(0, -90), ax=ax, title=f't = {time:g}\n{depth:.0f} radii')
        ax.set(xlim=(-20, 20), ylim=(height - 18, height + 62))
        print(f't = {time:g}: the cluster has fallen by {depth:.1f} radii, one sphere alone by '
              f'{time:.1f}')
    figure.savefig(arguments.picture, dpi=110)


if __name__ == '__main__':
    main()
