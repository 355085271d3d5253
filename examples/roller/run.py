#!/usr/bin/env python3
"""Rollers: spheres that spin at a prescribed rate above a wall, and are free to move along it.

    python3 run.py                     # seconds; draws picture.png and writes results.json
    python3 run.py --animation         # draws animation.gif, too
"""
import argparse
import sys
from pathlib import Path

import numpy as np
import openmm
import tqdm
from openmm import unit

from openmmrigidhi import CustomBodyMotion, CustomRigidHIIntegrator, MobilityForce, app

sys.path.insert(0, str(Path(__file__).resolve().parents[2]/'validation'/'common'))
import recording  # noqa: E402

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
    sites, radius = np.zeros((1, 3)), RADIUS
    if blobs > 1:
        sites, radius = (x/unit.nanometer for x in app.multiblobSphere(blobs, RADIUS))
    for _ in heights:
        motion.addBody(app.addRigidMultiblob(system, integrator, fluid, sites, radius))
    fluid.setGroups(range(len(heights)))
    if exact:
        fluid.setSphereWallMobility(fluid.BestKnown)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions(np.concatenate([sites + (0, 0, height) for height in heights]))
    integrator.step(1)
    return integrator.getBodyPositions()[:, 0]/unit.nanometer/step


def theory(heights):
    """The same for a sphere of the Rotne-Prager-Yamakawa model, in closed form."""
    u = RADIUS/np.asarray(heights)
    return SPIN*RADIUS*(u**4/8)/(1 - 5*u**3/16)


def pairs(distances, direction, height=1.5):
    """The speed along x of each of two rollers at the same height.

    Parameters
    ----------
    distances : array
        of their centres
    direction : sequence of float
        unit vector from one to the other, along the wall
    height : float
    """
    step = 1e-4
    system, fluid, integrator, motion = world(step, wy='spin', vz='0')
    for _ in range(2*len(distances)):
        motion.addBody(app.addRigidMultiblob(system, integrator, fluid, [(0, 0, 0)], RADIUS))
    fluid.setGroups(np.repeat(np.arange(len(distances)), 2))
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    start = np.array([(0, 0, height) + x*np.array(direction) for D in distances for x in (0, D)])
    context.setPositions(start)
    integrator.step(1)
    return ((integrator.getBodyPositions()/unit.nanometer - start)/step)[:, 0].reshape(-1, 2)


def farPair(distances, height=1.5):
    """What another roller far ahead or behind adds to the speed.

    The first factor is the flow of a torque 8 pi eta a^3 spin above a wall. The torque is larger by
    the second factor, because the wall resists the spin. The third factor is due to the flow's own
    spin at the other roller, which then needs less torque.
    """
    u = RADIUS/height
    wall = 1 - 5*u**3/16
    return 6*SPIN*RADIUS**3*height/np.asarray(distances)**3/wall*(1 - u**5/(16*wall))


def crowd(number, duration, height=1.5, step=2.0, seed=1, quiet=False):
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
    for _ in tqdm.trange(round(duration/step), desc='crowd', disable=quiet):
        integrator.step(1)
        path.append(integrator.getBodyPositions()[:, :2]/unit.nanometer)
    return np.array(path)


def animation(path, duration, file, frames=60):
    """The crowd, seen from above."""
    from matplotlib.animation import FuncAnimation, PillowWriter
    plt = recording.pyplot()
    figure, ax = plt.subplots(figsize=(6.8, 2.9), layout='constrained')
    low, high = path.min(axis=(0, 1)) - 2, path.max(axis=(0, 1)) + 2
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect='equal', xlabel='x / radius',
           ylabel='y / radius')
    discs = [
        ax.add_patch(plt.Circle((0, 0), RADIUS, facecolor='tab:blue', edgecolor='k', linewidth=0.5))
        for _ in range(path.shape[1])
    ]
    trails = [
        ax.plot([], [], color='0.7', linewidth=0.7, zorder=0)[0] for _ in range(path.shape[1])
    ]
    clock = ax.set_title(' ')

    def draw(frame):
        now = round(frame/max(1, frames - 1)*(len(path) - 1))
        for k, (disc, trail) in enumerate(zip(discs, trails)):
            disc.set_center(path[now, k])
            trail.set_data(path[:now + 1, k, 0], path[:now + 1, k, 1])
        clock.set_text(f'{now/(len(path) - 1)*duration*SPIN/(2*np.pi):.0f} turns')
        return [clock, *discs, *trails]

    FuncAnimation(figure, draw, frames).save(file, PillowWriter(fps=12), dpi=80)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--rollers', type=int, default=20, help='in the crowd (default 20)')
    parser.add_argument('--duration', type=float, default=600,
                        help='of the crowd, ps (default 600)')
    parser.add_argument('--picture', default='picture.png',
                        help='file to draw (default picture.png)')
    parser.add_argument('--results', default='results.json', type=Path,
                        help='file for the numbers (default results.json)')
    parser.add_argument('--animation', nargs='?', const='animation.gif',
                        help='draw an animation, too (animation.gif)')
    parser.add_argument('--frames', type=int, default=60, help='of the animation (default 60)')
    arguments = parser.parse_args()
    plt = recording.pyplot()
    heights = np.concatenate([np.linspace(1.02, 1.5, 9), np.linspace(1.75, 4, 10)])
    sphere = speeds(heights)
    error = np.abs(sphere/theory(heights) - 1).max()
    print(f'largest difference of a sphere from the closed form: {error:.1e} of the speed')
    shown = np.array([1.02, 1.2, 1.5, 2, 4])
    kinds = {'closed form': theory(shown), 'sphere, exact at the wall': speeds(shown, exact=True)}
    for name, values in kinds.items():
        print(f'{name} at {shown} radii:', np.array2string(values, precision=5))
    alone = theory([1.5])[0]
    distances = np.array([2.2, 3, 4, 6, 10, 20, 40, 100])
    behind, beside = (pairs(distances, n)[:, 0]/alone for n in ((1, 0, 0), (0, 1, 0)))
    far = 1 + farPair(distances)/alone
    print('\n| distance | one behind the other | far limit | side by side |\n|---|---|---|---|')
    for row in zip(distances, behind, far, beside):
        print('| {:g} | {:.5f} | {:.5f} | {:.5f} |'.format(*row))
    path = crowd(arguments.rollers, arguments.duration)
    mean = (path[-1] - path[0])[:, 0].mean()/arguments.duration
    print(f'{arguments.rollers} rollers at the height 1.5: {mean/alone:.2f} times as fast as one')
    figure, axes = plt.subplot_mosaic([[0, 1], [2, 2]], figsize=(9.6, 7.2), layout='constrained',
                                      gridspec_kw={'height_ratios': [1.1, 1]})
    fine = np.linspace(1, 4, 200)
    axes[0].plot(fine, theory(fine), color='0.6', linewidth=2, label='closed form')
    axes[0].plot(heights, sphere, 'o', markersize=5, label='sphere')
    above = heights[heights > 1.1]  # the blobs of a shell reach out a little
    axes[0].plot(above, speeds(above, blobs=162), 's', markersize=4, fillstyle='none',
                 label='shell of 162 blobs')
    axes[0].plot(heights, speeds(heights, exact=True), '^', markersize=4,
                 label='sphere, exact at the wall')
    axes[0].set(xlabel='height of the centre / radius', ylabel='speed / (spin × radius)',
                yscale='log', title='one roller')
    axes[0].legend()
    axes[2].plot(path[:, :, 0], path[:, :, 1], color='0.8', linewidth=0.8)
    for frame, color in ((0, 'tab:blue'), (len(path) // 2, 'tab:orange'), (-1, 'tab:red')):
        for x, y in path[frame]:
            axes[2].add_patch(plt.Circle((x, y), RADIUS, color=color, alpha=0.6, linewidth=0))
    axes[2].set(xlabel='x / radius', ylabel='y / radius', aspect='equal',
                title=f'{arguments.rollers} rollers, seen from above: start, half time, end')
    axes[2].autoscale_view()
    fine = np.geomspace(6, 100, 50)
    axes[1].plot(fine, farPair(fine)/alone, color='0.6', linewidth=2, label='far limit')
    axes[1].plot(distances, behind - 1, 'o', markersize=5, label='one behind the other')
    axes[1].plot(distances, beside - 1, 's', markersize=4, label='side by side')
    axes[1].set(xlabel='distance of the centres / radius',
                ylabel='gain in speed / speed of one alone', xscale='log', yscale='log',
                title='a pair at the height 1.5')
    ticks = [2, 5, 10, 20, 50, 100]
    axes[1].set_xticks(ticks, map(str, ticks))
    axes[1].minorticks_off()
    axes[1].legend()
    figure.savefig(arguments.picture, dpi=90)
    plt.close(figure)
    recording.save(
        arguments.results.parent, arguments.results.name, {
            'heights': shown,
            'speeds': kinds,
            'largest_relative_error_of_sphere': error,
            'pair': {
                'distances': distances,
                'one_behind_the_other': behind,
                'far_limit': far,
                'side_by_side': beside
            },
            'crowd_over_one': mean/alone,
            'run': recording.provenance(arguments)
        })
    if arguments.animation:
        animation(path, arguments.duration, arguments.animation, arguments.frames)


if __name__ == '__main__':
    main()
