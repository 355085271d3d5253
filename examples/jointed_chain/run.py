#!/usr/bin/env python3
"""A freely jointed chain of rods: its angles, its length and its diffusion, with and without
hydrodynamic interactions.

    python3 run.py                     # two minutes; draws picture.png and writes results.json
    python3 run.py --animation         # draws animation.gif, too
"""
import argparse
import math
import sys
import warnings
from pathlib import Path

import numpy as np
import openmm
import tqdm
from openmm import unit

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, app

sys.path.insert(0, str(Path(__file__).resolve().parents[2]/'validation'/'common'))
import recording  # noqa: E402

#: Water at 300 K.
TEMPERATURE, VISCOSITY = 300*unit.kelvin, 0.89e-3*unit.pascal*unit.second
KT = (unit.MOLAR_GAS_CONSTANT_R*TEMPERATURE).value_in_unit(unit.kilojoule_per_mole)
#: Rods of a chain; nm: length of a rod between its joints, radius of its blobs.
RODS, LENGTH, RADIUS = 4, 3.0, 0.4
#: Blobs along a rod, about their mean, and its two joints. The blobs are nearer to the first joint,
#: so that blobs of neighbours are never at the same place.
SITES = np.array([(-1, 0, 0), (0, 0, 0), (1, 0, 0)], float)
FIRST, LAST = (-1.25, 0, 0), (LENGTH - 1.25, 0, 0)
#: Particles in a mole, and friction of a blob, dalton/ps.
AVOGADRO = unit.AVOGADRO_CONSTANT_NA*unit.mole
FRICTION = 6*np.pi*AVOGADRO*1e-18*VISCOSITY.value_in_unit(unit.pascal*unit.second)*RADIUS
#: Without interactions radii are so many times smaller, and the viscosity is larger by the same
#: factor: each blob keeps its friction, and its flow becomes negligible.
FACTORS = {'with interactions': 1, 'without interactions': 1000}
STEP = 30.0  # ps
#: Steps from frame to frame.
EVERY = 5


def orientations(shape, random):
    """Uniform unit vectors (*shape, 3)."""
    u = random.normal(size=(*shape, 3))
    return u/np.linalg.norm(u, axis=-1)[..., None]


def blobs(directions):
    """Positions (..., rods, 3 blobs, 3) of blobs of chains with the directions (..., rods, 3)."""
    steps = LENGTH*directions
    starts = np.cumsum(steps, axis=-2) - steps
    along = (SITES[:, 0] - FIRST[0])[:, None]
    return starts[..., None, :] + along*directions[..., None, :]


def scene(factor, replicas, seed=1):
    """Independent chains in one Context, which start with random directions.

    Parameters
    ----------
    factor : float
        by which radii are divided and the viscosity is multiplied
    replicas : int
    seed : int

    Returns
    -------
    integrator : CustomRigidHIIntegrator
    fluid : MobilityForce
    context : openmm.Context
    """
    system, fluid = openmm.System(), MobilityForce()
    fluid.setViscosity(factor*VISCOSITY)
    fluid.setSolver(fluid.Dense)
    integrator = CustomRigidHIIntegrator(TEMPERATURE, STEP)
    integrator.setScheme(integrator.FixmanMidpoint)
    integrator.setRandomNumberSeed(seed)
    for _ in range(replicas):
        for rod in range(RODS):
            with warnings.catch_warnings():
                warnings.simplefilter('ignore')  # radii much smaller than distances are meant
                body = app.addRigidMultiblob(system, integrator, fluid, SITES, RADIUS/factor)
            if rod > 0:
                integrator.addBallJoint(body - 1, LAST, body, FIRST)
    fluid.setGroups(np.repeat(np.arange(replicas), RODS))
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'))
    start = blobs(orientations((replicas, RODS), np.random.default_rng(seed)))
    context.setPositions(start.reshape(-1, 3))
    return integrator, fluid, context


def run(factor, replicas, steps, seed=1, name='', quiet=False):
    """Chains that diffuse.

    Returns
    -------
    centres : array of shape (frames, replicas, 3)
        means of all blobs of a chain, nm
    directions : array of shape (frames, replicas, rods, 3)
    short : array of shape (replicas,)
        mean over the run of kT/3 times the trace of the mobility of the centre, nm^2/ps
    gap : float
        the largest distance between two ends that a joint keeps together, nm
    """
    integrator, fluid, context = scene(factor, replicas, seed)
    integrator.step(20*EVERY)
    centres, directions, short, gap = [], [], [], 0.0
    average = np.tile(np.eye(3, 6), RODS)/RODS  # from velocities of rods to that of the centre
    for frame in tqdm.trange(steps // EVERY, desc=name, disable=quiet):
        integrator.step(EVERY)
        R = (integrator.getBodyPositions()/unit.nanometer).reshape(replicas, RODS, 3)
        u = axes(integrator.getBodyOrientations()).reshape(replicas, RODS, 3)
        centres.append(R.mean(axis=1))
        directions.append(u)
        apart = R[:, :-1] + LAST[0]*u[:, :-1] - R[:, 1:] - FIRST[0]*u[:, 1:]
        gap = max(gap, np.abs(apart).max())
        if frame % 20 == 0:
            N = np.asarray(fluid.getMobilityInContext(context))
            size = 6*RODS
            short.append([
                KT/3*np.trace(average @ N[k:k + size, k:k + size] @ average.T)
                for k in range(0, len(N), size)
            ])
    return np.array(centres), np.array(directions), np.mean(short, axis=0), gap


def axes(q):
    """The x axes of bodies with the quaternions (bodies, 4) in the lab frame."""
    w, x, y, z = q.T
    return np.stack([1 - 2*(y*y + z*z), 2*(x*y + w*z), 2*(x*z - w*y)], axis=1)


# ---- Theory --------------------------------------------------------------------------------------


def endToEnd(r, n=RODS):
    """Density of the distance r of the ends of n independent uniform unit vectors (Treloar)."""
    r = np.asarray(r, float)
    total = np.zeros_like(r)
    for k in range(n):
        total += np.where(n - 2*k > r, (-1)**k*math.comb(n, k)*np.maximum(n - 2*k - r, 0)**(n - 2),
                          0)
    return r*total/(2**(n - 1)*math.factorial(n - 2))


def kirkwood(chains=20000, seed=1):
    """Kirkwood's approximation to the diffusion coefficient with interactions, nm^2/ps.

    It is the mobility of the centre if no joint and no rod held the blobs together, averaged over
    ideal chains.
    """
    x = blobs(orientations((chains, RODS), np.random.default_rng(seed)))
    x = x.reshape(chains, -1, 3)
    n = x.shape[1]
    total = np.full(chains, float(n))
    for i in range(n):
        r = np.linalg.norm(x[:, i + 1:] - x[:, i, None], axis=-1)/RADIUS
        # A third of the trace of the Rotne-Prager-Yamakawa tensor, in units of 1/FRICTION.
        total += 2*np.where(r > 2, 1/np.maximum(r, 2), 1 - r/4).sum(axis=1)
    return KT/FRICTION*total.mean()/n**2


# ---- Numbers and pictures ------------------------------------------------------------------------


def overReplicas(values):
    """Mean and standard error of (frames, replicas, ...) from the spread of the replicas."""
    each = values.mean(axis=0)
    return each.mean(axis=0), each.std(axis=0, ddof=1)/np.sqrt(len(each))


def diffusion(centres, lags):
    """Mean square displacement over 6 t at the lags (in frames), with errors, nm^2/ps."""
    found = [
        overReplicas(((centres[lag:] - centres[:-lag])**2).sum(axis=-1)/(6*lag*EVERY*STEP))
        for lag in lags
    ]
    return np.array(found).T


def histogram(values, edges):
    """Densities of (frames, replicas, ...) in bins, with errors from the spread of replicas."""
    each = np.stack(
        [np.histogram(values[:, k], edges, density=True)[0] for k in range(values.shape[1])])
    return each.mean(axis=0), each.std(axis=0, ddof=1)/np.sqrt(len(each))


#: Bins of the angle between neighbours and of the distance of the ends over the length of a rod.
ANGLES, ENDS = np.linspace(0, np.pi, 13), np.linspace(0, RODS, 17)


def measure(arguments):
    """All numbers, as a dictionary, and the directions of both runs."""
    found, paths = {'kirkwood': kirkwood(), 'sum_of_frictions': KT/(3*RODS*FRICTION)}, {}
    for name, factor in FACTORS.items():
        centres, u, short, gap = run(factor, arguments.replicas, arguments.steps, arguments.seed,
                                     name)
        cosines = (u[:, :, 1:]*u[:, :, :-1]).sum(axis=-1)
        ends = u.sum(axis=2)
        lags = np.unique(np.geomspace(1, len(centres)/4, 16).round().astype(int))
        value, error = diffusion(centres, lags)
        found[name] = {
            'mean_cosine': overReplicas(cosines.mean(axis=2)),
            'mean_square_cosine': overReplicas((cosines**2).mean(axis=2)),
            'mean_square_end_to_end': overReplicas((ends**2).sum(axis=-1)),
            'angles': histogram(np.arccos(np.clip(cosines, -1, 1)), ANGLES),
            'end_to_end': histogram(np.linalg.norm(ends, axis=-1), ENDS),
            'times_ps': lags*EVERY*STEP,
            'diffusion': value,
            'diffusion_error': error,
            'mobility_of_centre': (short.mean(), short.std(ddof=1)/np.sqrt(len(short))),
            'largest_gap_nm': gap
        }
        paths[name] = centres, u
    return found, paths


def nearest(times, time):
    return int(np.argmin(np.abs(np.log(np.asarray(times)/time))))


def report(found):
    """The tables of the page; diffusion in μm²/s, which is 1e6 nm²/ps."""
    print('\n| | with interactions | without | exact |\n|---|---|---|---|')
    for key, exact in (('mean_cosine', '0'), ('mean_square_cosine', '1/3'),
                       ('mean_square_end_to_end', str(RODS))):
        print(f'| {key} |', *(f'{recording.brackets(*found[name][key])} |' for name in FACTORS),
              f'{exact} |')
    print('\n| diffusion, μm²/s | with interactions | without |\n|---|---|---|')
    for time in (150, 1000, 10000):
        cells = []
        for name in FACTORS:
            rows = found[name]
            k = nearest(rows['times_ps'], time)
            cells.append(
                recording.brackets(1e6*rows['diffusion'][k], 1e6*rows['diffusion_error'][k]))
        print(f'| after {rows["times_ps"][k]/1000:.3g} ns | {" | ".join(cells)} |')
    print(
        '| mobility of the centre |',
        *(recording.brackets(*(1e6*np.array(found[name]['mobility_of_centre']))) + ' |'
          for name in FACTORS))
    print(f'| Kirkwood, kT/sum of frictions | {1e6*found["kirkwood"]:.2f} | '
          f'{1e6*found["sum_of_frictions"]:.2f} |')
    print('largest gap of a joint: {:.1e} nm'.format(
        max(found[name]['largest_gap_nm'] for name in FACTORS)))


def picture(found, path):
    plt = recording.pyplot()
    figure, axes = plt.subplots(1, 3, figsize=(13, 4.2), layout='constrained')
    for k, (name, color, marker) in enumerate(zip(FACTORS, ('tab:blue', 'tab:orange'), 'os')):
        rows = found[name]
        for ax, key, edges in ((axes[0], 'angles', ANGLES), (axes[1], 'end_to_end', ENDS)):
            width = (edges[1] - edges[0])*(k - 0.5)*0.2
            ax.errorbar((edges[1:] + edges[:-1])/2 + width, *rows[key], fmt=marker, markersize=4,
                        color=color, label=name, zorder=3)
        axes[2].errorbar(
            np.array(rows['times_ps'])/1000, 1e6*np.array(rows['diffusion']),
            1e6*np.array(rows['diffusion_error']), fmt=marker, markersize=4, color=color,
            label=name)
    theta, r = np.linspace(0, np.pi, 200), np.linspace(0, RODS, 200)
    axes[0].plot(theta, np.sin(theta)/2, color='0.5', label='sin(angle)/2')
    axes[1].plot(r, endToEnd(r), color='0.5', label=f'{RODS} independent unit vectors')
    axes[2].axhline(1e6*found['with interactions']['mobility_of_centre'][0], color='tab:blue',
                    linewidth=1, label='mean mobility of the centre')
    axes[2].axhline(1e6*found['sum_of_frictions'], color='tab:orange', linewidth=1,
                    label='kT/sum of frictions')
    axes[0].set(xlabel='angle between neighbours (rad)', ylabel='density (1/rad)', ylim=(0, 0.72))
    axes[1].set(xlabel='distance of the ends / length of a rod', ylabel='density', ylim=(0, 0.78))
    axes[2].set(xlabel='time (ns)', ylabel='mean square displacement / 6t (μm²/s)', xscale='log',
                ylim=(0, None))
    for ax, where in zip(axes, ('upper right', 'upper left', 'lower left')):
        ax.legend(fontsize=9, loc=where)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def animation(paths, path, frames=60, every=4):
    """A chain with interactions and one without, seen along y, with the paths of their centres."""
    from matplotlib.animation import FuncAnimation, PillowWriter
    plt = recording.pyplot()
    figure, axes = plt.subplots(1, 2, figsize=(7.6, 3.9), layout='constrained')
    shown = []
    for ax, (name, (centres, u)) in zip(axes, paths.items()):
        x = blobs(u[:frames*every:every, 0])
        middle = x.mean(axis=(1, 2))
        x += (centres[:frames*every:every, 0] - middle - centres[0, 0])[:, None, None]
        centre = x.mean(axis=(1, 2))
        ends = np.concatenate([
            x[:, :, 0] - 0.25*u[:frames*every:every, 0], x[:, -1:, 0] +
            (LENGTH - 0.25)*u[:frames*every:every, 0, -1:]
        ], axis=1)
        line, = ax.plot([], [], color='0.4', linewidth=2)
        points, = ax.plot([], [], 'o', color='tab:blue' if ax is axes[0] else 'tab:orange',
                          markersize=6, markeredgecolor='k', markeredgewidth=0.4)
        trail, = ax.plot([], [], color='k', linewidth=0.7)
        ax.set(aspect='equal', xlabel='x (nm)', ylabel='z (nm)', title=name)
        shown.append((x, centre, ends, line, points, trail))
    reach = 1 + max(np.abs(ends[..., [0, 2]]).max() for _, _, ends, *_ in shown)
    for ax in axes:
        ax.set(xlim=(-reach, reach), ylim=(-reach, reach))
    clock = axes[0].text(0.03, 0.93, '', transform=axes[0].transAxes)

    def draw(frame):
        changed = [clock]
        for x, centre, ends, line, points, trail in shown:
            now = min(frame, len(x) - 1)
            line.set_data(ends[now, :, 0], ends[now, :, 2])
            points.set_data(x[now, ..., 0].ravel(), x[now, ..., 2].ravel())
            trail.set_data(centre[:now + 1, 0], centre[:now + 1, 2])
            changed += [line, points, trail]
        clock.set_text(f't = {frame*every*EVERY*STEP/1000:.1f} ns')
        return changed

    FuncAnimation(figure, draw, frames).save(path, PillowWriter(fps=12), dpi=80)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description=' '.join(__doc__.split('\n\n')[0].split()))
    parser.add_argument('--replicas', type=int, default=16, help='chains (default 16)')
    parser.add_argument('--steps', type=int, default=20000, help=f'of {STEP:g} ps (default 20000)')
    parser.add_argument('--seed', type=int, default=1, help='of the noise (default 1)')
    parser.add_argument('--picture', default='picture.png',
                        help='file to draw (default picture.png)')
    parser.add_argument('--results', default='results.json', type=Path,
                        help='file for the numbers (default results.json)')
    parser.add_argument('--animation', nargs='?', const='animation.gif',
                        help='draw an animation, too (animation.gif)')
    parser.add_argument('--frames', type=int, default=60, help='of the animation (default 60)')
    arguments = parser.parse_args()
    found, paths = measure(arguments)
    report(found)
    recording.save(arguments.results.parent, arguments.results.name, {
        **found, 'run': recording.provenance(arguments)
    })
    picture(found, arguments.picture)
    if arguments.animation:
        animation(paths, arguments.animation, arguments.frames)


if __name__ == '__main__':
    main()
