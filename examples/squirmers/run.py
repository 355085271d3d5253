#!/usr/bin/env python3
"""Squirmers: their flow, two of them side by side, and one at a wall.

    python3 run.py                     # seconds; draws picture.png and velocities.png
    python3 run.py --animation         # draws animation.gif, too
"""
import argparse
import sys
from pathlib import Path

import numpy as np
import openmm
import tqdm
from openmm import unit

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, app

sys.path.insert(0, str(Path(__file__).resolve().parents[2]/'validation'/'common'))
import recording  # noqa: E402

#: Lengths are in radii and velocities in units of B1, whatever the viscosity.
RADIUS, B1 = 1.0, 1.0
#: B2/B1 of the three kinds.
KINDS = {'pusher': -3.0, 'neutral': 0.0, 'puller': 3.0}
COLORS = {'pusher': 'tab:orange', 'neutral': 'tab:green', 'puller': 'tab:blue'}
#: Orientations (w, x, y, z) in which a squirmer swims along z, along x, and towards z = 0.
UPWARDS, ALONG, DOWNWARDS = (1, 0, 0, 0), (0.5**0.5, 0, 0.5**0.5, 0), (0, 0, 1, 0)


def squirmers(poses, slips, blobs=42, wall=False, step=1e-5, groups=None, repulsion=False):
    """A Context with squirmers, without noise.

    Parameters
    ----------
    poses : list of (place, orientation)
        centres in radii, and quaternions
    slips : list of (B1, B2)
    blobs : int
        of a shell
    wall : bool
        whether there is a no-slip wall at z = 0
    step : float
        in radii over B1
    groups : sequence of int, optional
        of bodies that feel each other
    repulsion : bool
        whether a soft repulsion keeps the squirmers of a group apart, and off the wall

    Returns
    -------
    integrator : CustomRigidHIIntegrator
    fluid : MobilityForce
    context : openmm.Context
    """
    system, fluid = openmm.System(), MobilityForce()
    fluid.setViscosity(1)
    fluid.setSolver(fluid.Dense)
    if wall:
        fluid.setBoundary(fluid.NoSlipWall)
    integrator = CustomRigidHIIntegrator(0, step)
    integrator.setScheme(integrator.TrapezoidalSlip)
    sites, radius = app.multiblobSphere(blobs, RADIUS)
    for slip in slips:
        body = app.addRigidMultiblob(system, integrator, fluid, sites, radius)
        fluid.setBodySlip(body, app.squirmerSlip(sites, radius, *slip))
    if groups is not None:
        fluid.setGroups(groups)
    if repulsion:
        push = openmm.CustomCentroidBondForce(2, '300*max(0, 2.2 - distance(g1, g2))^2')
        number = range(len(slips))
        for k in number:
            push.addGroup(range(k*blobs, (k + 1)*blobs), [1]*blobs)
        for i in number:
            for j in number:
                if i < j and (groups is None or groups[i] == groups[j]):
                    push.addBond([i, j])
        system.addForce(push)
        if wall:
            off = openmm.CustomExternalForce(f'300*max(0, {1.4*radius/unit.nanometer} - z)^2')
            for k in range(len(slips)*blobs):
                off.addParticle(k, [])
            system.addForce(off)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'))
    sites = sites/unit.nanometer
    context.setPositions(np.concatenate([turned(sites, q) + place for place, q in poses]))
    return integrator, fluid, context


def turned(points, q):
    """Points of the body frame in the lab frame."""
    w, v = q[0], np.asarray(q[1:])
    return points + 2*np.cross(v, np.cross(v, points) + w*points)


def twists(*arguments, **options):
    """Velocities and angular velocities (bodies, 6) at the start, from a very short step."""
    integrator, _, context = squirmers(*arguments, **options)
    before, turns = integrator.getBodyPositions()/unit.nanometer, integrator.getBodyOrientations()
    step = integrator.getStepSize()/unit.picosecond
    integrator.step(1)
    (w, x, y, z), q = turns.T, integrator.getBodyOrientations()
    inverse = np.array([[-x, w, -z, y], [-y, z, w, -x], [-z, -y, x, w]])
    spin = 2*np.einsum('ijk,kj->ki', inverse, q)/step
    velocity = (integrator.getBodyPositions()/unit.nanometer - before)/step
    return np.concatenate([velocity, spin], axis=1)


# ---- Velocities against distance -----------------------------------------------------------------


def pairs(distances, blobs=42, B2=3.0):
    """Velocities (distances, 6) of the left one of two squirmers side by side that swim upwards."""
    poses = [((x, 0, 0), UPWARDS) for D in distances for x in (0, D)]
    groups = np.repeat(np.arange(len(distances)), 2)
    return twists(poses, [(B1, B2)]*len(poses), blobs, groups=groups)[::2]


def walls(heights, orientation, slip, blobs=42):
    """Velocities (heights, 6) of a squirmer at heights above a wall."""
    poses = [((0, 0, height), orientation) for height in heights]
    return twists(poses, [slip]*len(poses), blobs, wall=True, groups=range(len(poses)))


# ---- Paths ---------------------------------------------------------------------------------------


def race(distance, duration, step=0.05, blobs=42, quiet=False):
    """Two squirmers of each kind swim upwards from side by side.

    Returns the poses (frames, kinds, 2, 7) of centres and quaternions.
    """
    poses = [((x, 0, 0), UPWARDS) for _ in KINDS for x in (-distance/2, distance/2)]
    slips = [(B1, B2) for B2 in KINDS.values() for _ in range(2)]
    groups = np.repeat(np.arange(len(KINDS)), 2)
    integrator, _, context = squirmers(poses, slips, blobs, step=step, groups=groups,
                                       repulsion=True)
    found = follow(integrator, duration, 'pairs', quiet)
    del context  # which had to live until here
    return found.reshape(len(found), len(KINDS), 2, 7)


def glide(height, duration, step=0.02, blobs=42, quiet=False):
    """One squirmer of each kind starts along a wall; the poses (frames, kinds, 7)."""
    poses = [((0, 0, height), ALONG) for _ in KINDS]
    slips = [(B1, B2) for B2 in KINDS.values()]
    integrator, _, context = squirmers(poses, slips, blobs, True, step, range(len(KINDS)), True)
    found = follow(integrator, duration, 'at a wall', quiet)
    del context
    return found


def follow(integrator, duration, name, quiet):
    """Poses (frames, bodies, 7), step by step."""
    found, step = [], integrator.getStepSize()/unit.picosecond
    for _ in tqdm.trange(round(duration/step), desc=name, disable=quiet):
        R = integrator.getBodyPositions()/unit.nanometer
        found.append(np.concatenate([R, integrator.getBodyOrientations()], axis=1))
        integrator.step(1)
    return np.array(found)


# ---- Flow ----------------------------------------------------------------------------------------


def flow(points, B2, blobs=162, height=None):
    """Velocities of the fluid in the lab frame at points (..., 3) about a squirmer.

    It is at the origin and swims upwards; or, with a height, it is above a wall and swims along x.
    """
    pose = ((0, 0, 0), UPWARDS) if height is None else ((0, 0, height), ALONG)
    _, fluid, context = squirmers([pose], [(B1, B2)], blobs, wall=height is not None)
    u = fluid.getFlowInContext(context, np.reshape(points, (-1, 3)))
    return (u/(unit.nanometer/unit.picosecond)).reshape(np.shape(points))


def theory(points, B2):
    """The same of a smooth squirmer in unbounded fluid (Blake 1971), outside of it."""
    r = np.linalg.norm(points, axis=-1)[..., None]
    radial, upwards = points/r, np.array([0, 0, 1.0])
    cosine = radial[..., 2:]
    tangential = cosine*radial - upwards  # sin(theta) times the unit vector along theta
    return (2/3*B1*cosine/r**3 + B2/2*(1/r**4 - 1/r**2)*
            (3*cosine**2 - 1))*radial + (B1/3/r**3 + B2*cosine/r**4)*tangential


def errorOfFlow(r, B2, blobs):
    """Root mean square of flow() - theory() at the distance r, over that of theory()."""
    normals = app.multiblobSphere(642, 1.0)[0]/unit.nanometer
    points = r*normals/np.linalg.norm(normals, axis=1)[:, None]
    exact = theory(points, B2)
    return np.sqrt(((flow(points, B2, blobs) - exact)**2).sum()/(exact**2).sum())


# ---- Numbers and pictures ------------------------------------------------------------------------


def measure(quiet=False):
    """All numbers, as a dictionary."""
    distances, heights, shells = np.array([2.5, 3, 4, 5, 8]), np.array([1.5, 2, 3, 4,
                                                                        8]), (12, 42, 162)
    found = {
        'pairs': {
            'distances': distances,
            'far_limit': -1/(2*distances**2),
            'blobs': {}
        },
        'wall': {
            'heights': heights,
            'far_limit': 3/(16*heights**2),
            'blobs': {}
        },
        'flow': {
            'r': np.array([1.2, 1.5, 2, 3, 5]),
            'blobs': {}
        }
    }
    for blobs in tqdm.tqdm(shells, desc='shells', disable=quiet):
        both, alone = (pairs(distances, blobs, B2) for B2 in (3.0, 0.0))
        found['pairs']['blobs'][blobs] = {
            'puller': both,
            'neutral': alone,
            # What B2 adds is linear in it.
            'vx_over_B2': (both[:, 0] - alone[:, 0])/3
        }
        found['wall']['blobs'][blobs] = {
            'vx_of_B1': walls(heights, ALONG, (1, 0), blobs)[:, 0],
            'vz_of_B2': walls(heights, ALONG, (0, 1), blobs)[:, 2],
            'vz_towards': walls(heights, DOWNWARDS, (1, 0), blobs)[:, 2]
        }
        found['flow']['blobs'][blobs] = {
            name: [errorOfFlow(r, KINDS[name], blobs) for r in found['flow']['r']]
            for name in ('puller', 'neutral')
        }
    return found


def report(found):
    """The tables of the page."""
    shells = found['pairs']['blobs']
    print('\n| distance | V_x/B2 with 12, 42, 162 blobs | far limit |\n|---|---|---|')
    for k, D in enumerate(found['pairs']['distances']):
        values = ', '.join(f'{shell["vx_over_B2"][k]:.5f}' for shell in shells.values())
        print(f'| {D:g} | {values} | {found["pairs"]["far_limit"][k]:.5f} |')
    shells = found['wall']['blobs']
    print('\n| height | V_z/B2 with 12, 42, 162 blobs | far limit | V_x/B1 along | V_z/B1 towards |'
          '\n|---|---|---|---|---|')
    for k, height in enumerate(found['wall']['heights']):
        values = ', '.join(f'{shell["vz_of_B2"][k]:.5f}' for shell in shells.values())
        print(f'| {height:g} | {values} | {found["wall"]["far_limit"][k]:.5f} | '
              f'{shells[162]["vx_of_B1"][k]:.4f} | {shells[162]["vz_towards"][k]:.4f} |')
    print('\n| distance | error of the flow with 12, 42, 162 blobs: puller | neutral |\n'
          '|---|---|---|')
    for k, r in enumerate(found['flow']['r']):
        cells = (', '.join(f'{100*shell[name][k]:.1f} %'
                           for shell in found['flow']['blobs'].values())
                 for name in ('puller', 'neutral'))
        print(f'| {r:g} | {" | ".join(cells)} |')


def drawFlow(path, points=61, blobs=162):
    """Streamlines of the three kinds, in unbounded fluid and above a wall."""
    plt = recording.pyplot()
    figure, axes = plt.subplots(2, 3, figsize=(10.5, 5.9), layout='constrained',
                                gridspec_kw={'height_ratios': [2, 1]})
    for row, height in enumerate((None, 1.5)):
        x = np.linspace(-4, 4, points)
        z = x if height is None else np.linspace(0, 4, (points + 1) // 2)
        grid = np.stack(np.meshgrid(x, [0], z, indexing='ij'), axis=-1)[:, 0].swapaxes(0, 1)
        for ax, (name, B2) in zip(axes[row], KINDS.items()):
            u = flow(grid, B2, blobs, height)
            u[np.linalg.norm(grid - (0, 0, height or 0), axis=-1) < 1] = np.nan
            speed = np.log10(np.maximum(np.linalg.norm(u, axis=-1), 1e-4))
            drawn = ax.contourf(x, z, speed, levels=np.linspace(-3, 0.25, 14), cmap='viridis',
                                extend='both')
            ax.streamplot(x, z, u[..., 0], u[..., 2], color='w', density=1.1, linewidth=0.6,
                          arrowsize=0.7)
            ax.add_patch(
                plt.Circle((0, height or 0), 1, facecolor='0.8', edgecolor='k', linewidth=0.8,
                           zorder=3))
            step = (0, 1.1) if height is None else (1.1, 0)
            ax.annotate('', (step[0]/2, (height or 0) + step[1]/2),
                        (-step[0]/2, (height or 0) - step[1]/2), arrowprops={
                            'arrowstyle': '-|>',
                            'color': 'k',
                            'linewidth': 1.5
                        }, zorder=4)
            ax.set(aspect='equal', xlim=(-4, 4), ylim=(z[0], z[-1]), xlabel='x / radius',
                   ylabel='z / radius')
            if height is None:
                ax.set_title(f'{name}, B2/B1 = {B2:g}')
    bar = figure.colorbar(drawn, ax=axes, label='speed of the fluid / B1', shrink=0.9,
                          ticks=[-3, -2, -1, 0])
    bar.ax.set_yticklabels(['0.001', '0.01', '0.1', '1'])
    figure.savefig(path, dpi=80)
    plt.close(figure)


def drawVelocities(found, race, glide, duration, path):
    """Velocities over distance with their far limits, and paths."""
    plt = recording.pyplot()
    figure, axes = plt.subplots(2, 2, figsize=(10.5, 8), layout='constrained')
    for ax, scene, key, label in ((axes[0, 0], 'pairs', 'vx_over_B2', 'distances'),
                                  (axes[0, 1], 'wall', 'vz_of_B2', 'heights')):
        for (blobs, shell), marker in zip(found[scene]['blobs'].items(), 'svo'):
            ax.plot(found[scene][label], shell[key]/found[scene]['far_limit'], marker, markersize=6,
                    fillstyle='none', label=f'shells of {blobs} blobs')
        ax.axhline(1, color='0.6', linewidth=1)
        ax.set(ylim=(0.7, 1.4))
        ax.legend()
    axes[0, 0].set(xlabel='distance of the centres / radius',
                   ylabel='speed apart / far limit B2/(2D²)', title='two squirmers side by side')
    axes[0, 1].set(xlabel='height of the centre / radius',
                   ylabel='speed away / far limit 3 B2/(16h²)', title='one that swims along a wall')
    time = np.linspace(0, duration, len(race), endpoint=False)
    gap = np.linalg.norm(race[:, :, 1, :3] - race[:, :, 0, :3], axis=-1)
    for k, (name, B2) in enumerate(KINDS.items()):
        axes[1, 0].plot(time, gap[:, k], color=COLORS[name], label=name)
        cube = gap[0, k]**3 + 3*B2*time
        shown = cube > 8
        axes[1, 0].plot(time[shown], np.cbrt(cube[shown]), '--', color='0.4', linewidth=1,
                        label=None if k else 'far limit')
        axes[1, 1].plot(glide[:, k, 0], glide[:, k, 2], color=COLORS[name], label=name)
    axes[1, 0].axhline(2, color='0.8', linewidth=1)
    axes[1, 0].set(xlabel='time × B1 / radius', ylabel='distance of the centres / radius',
                   title='pairs that start side by side')
    axes[1, 1].axhspan(0, 1, color='0.9')
    axes[1, 1].set(xlabel='x / radius', ylabel='height of the centre / radius', ylim=(0, None),
                   title='paths that start along a wall')
    for ax in axes[1]:
        ax.legend()
    figure.savefig(path, dpi=80)
    plt.close(figure)


def animation(race, glide, path, frames=60):
    """Pairs that swim upwards, and single squirmers that swim along a wall."""
    from matplotlib.animation import FuncAnimation, PillowWriter
    plt = recording.pyplot()
    figure, axes = plt.subplots(1, 2, figsize=(8.4, 3.2), layout='constrained',
                                gridspec_kw={'width_ratios': [1.25, 1]})
    poses, colors, where, lane = [], [], [], 9.0
    for k, name in enumerate(KINDS):
        for side in range(2):
            poses.append(race[:, k, side].copy())
            poses[-1][:, 0] += lane*k
            where.append(axes[0])
        poses.append(glide[:, k])
        where.append(axes[1])
        colors += [COLORS[name]]*3
        axes[0].text(lane*k, -2.6, name, ha='center')
    top = race[..., 2].max() + 1.5
    axes[0].set(xlim=(-lane/2, 2.5*lane), ylim=(-3.2, top), aspect='equal', xlabel='x / radius',
                ylabel='z / radius', title='two side by side')
    axes[1].axhspan(-0.5, 0, color='0.8')
    axes[1].set(xlim=(-1.5, glide[..., 0].max() + 1.5), ylim=(-0.5, glide[..., 2].max() + 4),
                aspect='equal', xlabel='x / radius', ylabel='z / radius', title='along a wall')
    discs = [
        ax.add_patch(plt.Circle((0, 0), 1, facecolor=color, edgecolor='k', linewidth=0.6,
                                alpha=0.8)) for ax, color in zip(where, colors)
    ]
    noses = [ax.plot([], [], 'k', linewidth=2)[0] for ax in where]
    trails = [ax.plot([], [], color=color, linewidth=0.8)[0] for ax, color in zip(where, colors)]

    def draw(frame):
        last = round(frame/max(1, frames - 1)*(len(race) - 1))
        for pose, disc, nose, trail in zip(poses, discs, noses, trails):
            now = round(last/(len(race) - 1)*(len(pose) - 1))
            centre = pose[now, [0, 2]]
            ahead = turned(np.array([0, 0, 1.0]), pose[now, 3:])[[0, 2]]
            disc.set_center(centre)
            nose.set_data(*np.stack([centre, centre + ahead], axis=1))
            trail.set_data(pose[:now + 1, 0], pose[:now + 1, 2])
        return discs + noses + trails

    FuncAnimation(figure, draw, frames).save(path, PillowWriter(fps=12), dpi=80)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--duration', type=float, default=18,
                        help='of paths, in radii over B1 (default 18)')
    parser.add_argument('--points', type=int, default=61,
                        help='of a flow along an edge of the picture (default 61)')
    parser.add_argument('--picture', default='picture.png', type=Path,
                        help='file to draw (default picture.png); velocities.png is beside it')
    parser.add_argument('--results', default='results.json', type=Path,
                        help='file for the numbers (default results.json)')
    parser.add_argument('--animation', nargs='?', const='animation.gif',
                        help='draw an animation, too (animation.gif)')
    parser.add_argument('--frames', type=int, default=60, help='of the animation (default 60)')
    arguments = parser.parse_args()
    found = measure()
    report(found)
    pair, single = race(4.0, arguments.duration), glide(2.0, arguments.duration)
    ends = np.linalg.norm(pair[-1, :, 1, :3] - pair[-1, :, 0, :3], axis=-1)
    found['paths'] = {
        'duration': arguments.duration,
        'last_distance_of_pairs': dict(zip(KINDS, ends)),
        'last_height_at_wall': dict(zip(KINDS, single[-1, :, 2])),
        'last_z_component_of_direction_at_wall': {
            name: turned(np.array([0, 0, 1.0]), single[-1, k, 3:])[2]
            for k, name in enumerate(KINDS)
        }
    }
    print('last distances of pairs, and heights at the wall:', found['paths'])
    recording.save(arguments.results.parent, arguments.results.name, {
        **found, 'run': recording.provenance(arguments)
    })
    drawFlow(arguments.picture, arguments.points)
    drawVelocities(found, pair, single, arguments.duration,
                   arguments.picture.with_name('velocities.png'))
    if arguments.animation:
        animation(pair, single, arguments.animation, arguments.frames)


if __name__ == '__main__':
    main()
