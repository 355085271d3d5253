#!/usr/bin/env python3
"""Rollers: spheres that spin at a prescribed rate above a wall, and are free to move along it.

    python3 run.py                     # seconds; draws picture.png
"""
import argparse

import numpy as np
import openmm

from openmmrigidhi import CustomBodyMotion, CustomRigidHIIntegrator, MobilityForce, app

#: Radius, nm, and spin, rad/ps: speeds are in units of their product. Without forces the viscosity
#: does not matter.
RADIUS, SPIN = 1.0, 1.0


def world(step, **components):
    """System, fluid above the wall z = 0, integrator without noise, and prescribed components."""
    system, fluid = openmm.System(), MobilityForce()
    fluid.setBoundary(fluid.NoSlipWall)
    fluid.setViscosity(1)
    integrator = CustomRigidHIIntegrator(0, step)
    integrator.setScheme(integrator.TrapezoidalSlip)
    motion = CustomBodyMotion(**components)
    motion.addGlobalParameter('spin', SPIN)
    system.addForce(fluid)
    system.addForce(motion)
    return system, fluid, integrator, motion


def speeds(heights, blobs=1, exact=False):
    """The speed along x of a roller alone at each height of its centre.

    Parameters
    ----------
    heights : array
    blobs : int
        1 for a sphere; otherwise the roller is a shell of so many blobs
    exact : bool
        whether the sphere has the mobility of a rigid sphere at the wall, lubrication included
    """
    step = 1e-4
    system, fluid, integrator, motion = world(step, wy='spin')
    sites, radius = (np.zeros(
        (1, 3)), RADIUS) if blobs == 1 else [x._value for x in app.multiblobSphere(blobs, RADIUS)]
    for _ in heights:
        motion.addBody(app.addRigidMultiblob(system, integrator, fluid, sites, radius))
    fluid.setGroups(range(len(heights)))
    if exact:
        fluid.setSphereWallMobility(fluid.BestKnown)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions(np.concatenate([sites + (0, 0, height) for height in heights]))
    integrator.step(1)
    return integrator.getBodyPositions()._value[:, 0]/step


def theory(heights):
    """The same for a sphere of the Rotne-Prager-Yamakawa model, in closed form."""
    u = RADIUS/np.asarray(heights)
    return SPIN*RADIUS*(u**4/8)/(1 - 5*u**3/16)


def crowd(number, duration, height=1.5, step=2.0, seed=1):
    """The paths (frames, rollers, 2) along the wall of rollers that start in a strip across x.

    They stay at their height, and a soft repulsion keeps them apart.
    """
    system, fluid, integrator, motion = world(step, vz='0', wy='spin')
    repulsion = openmm.CustomNonbondedForce('20*max(0, 2.3 - r)^2')
    for _ in range(number):
        motion.addBody(app.addRigidMultiblob(system, integrator, fluid, [(0, 0, 0)], RADIUS))
        repulsion.addParticle([])
    system.addForce(repulsion)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    random = np.random.default_rng(seed)
    rows = np.arange(number)
    start = np.stack([3.0*(rows % 2), 3.0*(rows // 2), np.full(number, height)], axis=1)
    start[:, :2] += random.uniform(-0.3, 0.3, (number, 2))
    context.setPositions(start)
    path = [start[:, :2]]
    for _ in range(round(duration/step)):
        integrator.step(1)
        path.append(integrator.getBodyPositions()._value[:, :2])
    return np.array(path)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--rollers', type=int, default=20, help='in the crowd (default 20)')
    parser.add_argument('--duration', type=float, default=600,
                        help='of the crowd, ps (default 600)')
    parser.add_argument('--picture', default='picture.png',
                        help='file to draw (default picture.png)')
    arguments = parser.parse_args()
    import matplotlib
    matplotlib.use('Agg')
    import matplotlib.pyplot as plt
    heights = np.concatenate([np.linspace(1.02, 1.5, 9), np.linspace(1.75, 4, 10)])
    sphere = speeds(heights)
    error = np.abs(sphere/theory(heights) - 1).max()
    print(f'largest difference of a sphere from the closed form: {error:.1e} of the speed')
    shown = np.array([1.02, 1.2, 1.5, 2, 4])
    kinds = {'closed form': theory(shown), 'sphere, exact at the wall': speeds(shown, exact=True)}
    for name, values in kinds.items():
        print(f'{name} at {shown} radii:', np.array2string(values, precision=5))
    path = crowd(arguments.rollers, arguments.duration)
    alone = theory([1.5])[0]
    mean = (path[-1] - path[0])[:, 0].mean()/arguments.duration
    print(f'{arguments.rollers} rollers at the height 1.5: {mean/alone:.2f} times as fast as one')
    figure, axes = plt.subplots(1, 2, figsize=(10, 4), layout='constrained')
    fine = np.linspace(1, 4, 200)
    axes[0].plot(fine, theory(fine), color='0.6', linewidth=2, label='closed form')
    axes[0].plot(heights, sphere, 'o', markersize=5, label='sphere')
    above = heights[heights > 1.1]  # the blobs of a shell reach out a little
    axes[0].plot(above, speeds(above, blobs=162), 's', markersize=4, fillstyle='none',
                 label='shell of 162 blobs')
    axes[0].plot(heights, speeds(heights, exact=True), '^', markersize=4,
                 label='sphere, exact at the wall')
    axes[0].set(xlabel='height of the centre / radius', ylabel='speed / (spin × radius)',
                yscale='log')
    axes[0].legend()
    axes[1].plot(path[:, :, 0], path[:, :, 1], color='0.8', linewidth=0.8)
    for frame, color in ((0, 'tab:blue'), (len(path) // 2, 'tab:orange'), (-1, 'tab:red')):
        for x, y in path[frame]:
            axes[1].add_patch(plt.Circle((x, y), RADIUS, color=color, alpha=0.6, linewidth=0))
    axes[1].set(xlabel='x / radius', ylabel='y / radius', aspect='equal',
                title='seen from above: start, half time, end')
    axes[1].autoscale_view()
    figure.savefig(arguments.picture, dpi=110)


if __name__ == '__main__':
    main()
