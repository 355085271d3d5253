#!/usr/bin/env python3
"""A boomerang diffuses among pillars: where it is, how far it comes, and how long it stays in a
cell, with and without a fluid that couples it to the pillars.

    python3 run.py                     # three minutes; draws picture.png and writes results.json
    python3 run.py --animation         # draws animation.gif, too
"""
import argparse
import sys
from pathlib import Path

import numpy as np
import openmm
import tqdm
from openmm import unit

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, analysis, app

sys.path.insert(0, str(Path(__file__).resolve().parents[2]/'validation'/'common'))
import recording  # noqa: E402

#: Water at 300 K.
TEMPERATURE, VISCOSITY = 300*unit.kelvin, 0.89e-3*unit.pascal*unit.second
KT = (unit.MOLAR_GAS_CONSTANT_R*TEMPERATURE).value_in_unit(unit.kilojoule_per_mole)
#: nm: distance of neighbouring pillars; radius of a pillar; radius of a blob of the boomerang, and
#: distance between its blobs.
LATTICE, PILLAR, RADIUS, SPACING = 3000.0, 500.0, 200.0, 300.0
#: The blobs of a pillar, along z, the places of 4 x 4 pillars, and the blobs of the boomerang about
#: their mean.
COLUMN = np.array([(0, 0, -2*PILLAR), (0, 0, 0), (0, 0, 2*PILLAR)])
PLACES = np.array([(x, y, 0) for x in (-1.5, -0.5, 0.5, 1.5) for y in (-1.5, -0.5, 0.5, 1.5)])
SITES = app.boomerang(SPACING, blobsPerArm=2)/unit.nanometer
SITES = SITES - SITES.mean(axis=0)
#: Energy of a blob of the boomerang at the distance r from the axis of the nearest pillar, and at
#: the height z above the middle of the pillars.
ENERGY = (f'kT*(4*exp(-(r - {PILLAR + RADIUS})/100) + z^2/{5*2*500**2}); r = sqrt(dx^2 + dy^2); '
          f'dx = x - L*floor(x/L) - L/2; dy = y - L*floor(y/L) - L/2; L = {LATTICE}')
#: Bodies of a replica.
BODIES = len(PLACES) + 1
#: The four pillars about the cell in the middle.
CELL = np.array([(x, y, 0) for x in (-0.5, 0.5) for y in (-0.5, 0.5)])
STEP = 2*unit.millisecond
#: Times of the displacements that are printed, s.
TIMES = (0.1, 0.4)
MODELS = {'RotnePragerYamakawa': 'with a fluid', 'FreeDraining': 'without interactions'}


def scene(model, replicas, seed=1, places=PLACES):
    """Independent forests of pillars that are held, with a boomerang each, in one Context.

    Parameters
    ----------
    model : str
        of the MobilityForce
    replicas : int
    seed : int
    places : array of shape (pillars, 3)
        of the pillars of a forest, in units of their distance

    Returns
    -------
    integrator : CustomRigidHIIntegrator
    context : openmm.Context
        of the bodies of a replica the last one is the boomerang
    """
    system, fluid = openmm.System(), MobilityForce()
    fluid.setModel(getattr(fluid, model))
    fluid.setSolver(fluid.Dense)
    fluid.setViscosity(VISCOSITY)
    integrator = CustomRigidHIIntegrator(TEMPERATURE, STEP)
    integrator.setScheme(integrator.FixmanMidpoint)
    integrator.setRandomNumberSeed(seed)
    push = openmm.CustomExternalForce(ENERGY)
    push.addGlobalParameter('kT', KT)
    for _ in range(replicas):
        for _ in places:
            pillar = app.addRigidMultiblob(system, integrator, fluid, COLUMN, PILLAR)
            integrator.setBodyHeld(pillar, True)
        body = app.addRigidMultiblob(system, integrator, fluid, SITES, RADIUS)
        for particle in integrator.getRigidBodyParticles(body):
            push.addParticle(particle, [])
    fluid.setGroups(np.repeat(np.arange(replicas), len(places) + 1))
    system.addForce(push)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'))
    forest = [COLUMN + LATTICE*place for place in places]
    context.setPositions(np.tile(np.concatenate([*forest, SITES]), (replicas, 1)))
    return integrator, context


def dynamics(model, replicas, steps, seed=1, quiet=False):
    """Positions (frames, replicas, 3) and orientations (frames, replicas, 4) of the boomerangs.

    A frame is every fifth step after the first 400.
    """
    integrator, context = scene(model, replicas, seed)
    integrator.step(400)
    R, q = [], []
    for _ in tqdm.trange(steps // 5, desc=f'{MODELS[model]}: paths', disable=quiet):
        integrator.step(5)
        R.append(integrator.getBodyPositions()[BODIES - 1::BODIES]/unit.nanometer)
        q.append(integrator.getBodyOrientations()[BODIES - 1::BODIES])
    return np.array(R), np.array(q)


def blobsOf(positions, orientations):
    """Positions (k, blobs, 3) of the blobs of boomerangs at poses (k, 3) and (k, 4)."""
    w, x, y, z = orientations.T
    rows = np.stack([
        np.stack([1 - 2*(y*y + z*z), 2*(x*y - w*z), 2*(x*z + w*y)], axis=1),
        np.stack([2*(x*y + w*z), 1 - 2*(x*x + z*z), 2*(y*z - w*x)], axis=1),
        np.stack([2*(x*z - w*y), 2*(y*z + w*x), 1 - 2*(x*x + y*y)], axis=1)
    ], axis=1)
    return positions[:, None] + np.einsum('kij,nj->kni', rows, SITES)


def passages(integrator, context, replicas, steps, shift=0.0, seed=1, name='', quiet=False):
    """Times until boomerangs leave the cell in the middle through one of its four gaps.

    Each starts in the middle of the cell with a random orientation. When its centre is at a gap, it
    is put back. Passages that begin within the steps are followed to their end.

    Parameters
    ----------
    integrator, context
        of scene() with the places CELL
    replicas : int
    steps : int
    shift : float
        nm, by which a gap counts as nearer than it is

    Returns
    -------
    list of array
        the times of each replica, in steps
    """
    random = np.random.default_rng(seed)
    bodies = len(CELL) + 1
    x = context.getState(getPositions=True).getPositions(asNumpy=True)/unit.nanometer
    x = x.reshape(replicas, -1, 3)

    def restart(which):
        q = random.normal(size=(len(which), 4))
        q /= np.linalg.norm(q, axis=1)[:, None]
        x[which, -len(SITES):] = blobsOf(np.zeros((len(which), 3)), q)
        context.setPositions(x.reshape(-1, 3))

    restart(np.arange(replicas))
    times, began, now = [[] for _ in range(replicas)], np.zeros(replicas, int), 0
    active = np.full(replicas, True)
    with tqdm.tqdm(total=steps, desc=name, disable=quiet) as bar:
        while active.any():
            integrator.step(1)
            now += 1
            bar.update(now <= steps)
            R = integrator.getBodyPositions()[bodies - 1::bodies]/unit.nanometer
            out = np.flatnonzero(active & (np.abs(R[:, :2]).max(axis=1) > LATTICE/2 - shift))
            if not len(out):
                continue
            for replica in out:
                times[replica].append(now - began[replica])
            began[out] = now
            if now < steps:
                x = context.getState(getPositions=True).getPositions(asNumpy=True)/unit.nanometer
                x = x.reshape(replicas, -1, 3)
                restart(out)
            else:
                active[out] = False
    return [np.array(each) for each in times]


def meanPassage(model, replicas, steps, seed=1, quiet=False):
    """Times (passages,) through a gap, s, and their mean with its standard error.

    Whoever looks after each step only misses passages and returns within a step. Gaps therefore
    count as nearer by 0.583 root mean square displacements of a step (Siegmund 1985), with the
    mobility that a boomerang has in a gap.
    """
    integrator, context = scene(model, replicas, seed, CELL)
    x = context.getState(getPositions=True).getPositions(asNumpy=True)/unit.nanometer
    moved = x.copy()
    moved[-len(SITES):, 0] += LATTICE/2
    context.setPositions(moved)
    fluid = MobilityForce.cast(context.getSystem().getForce(1))
    mobility = np.asarray(fluid.getMobilityInContext(context))[-6, -6]
    context.setPositions(x)
    h = STEP.value_in_unit(unit.picosecond)
    times = passages(integrator, context, replicas, steps, 0.583*np.sqrt(2*KT*mobility*h), seed,
                     f'{MODELS[model]}: passages', quiet)
    numbers, sums = np.array([len(each)
                              for each in times]), np.array([each.sum() for each in times])
    mean = sums.sum()/numbers.sum()
    error = np.sqrt(((sums - mean*numbers)**2).sum()*replicas/(replicas - 1))/numbers.sum()
    second = 1e-12*h
    return second*np.concatenate(times), second*mean, second*error


def energies(positions, orientations):
    """Energies (k,) of boomerangs at poses (k, 3) and (k, 4), kJ/mol, as the force has them."""
    blobs = blobsOf(positions, orientations)
    wall = 4*np.exp(-(distances(blobs) - PILLAR - RADIUS)/100)
    return KT*(wall + blobs[..., 2]**2/(5*2*500**2)).sum(axis=1)


def distances(positions):
    """Distances from the axis of the nearest pillar, nm."""
    across = positions[..., :2]/LATTICE - np.floor(positions[..., :2]/LATTICE) - 0.5
    return LATTICE*np.linalg.norm(across, axis=-1)


def equilibrium(walkers, samples=200, seed=1):
    """Positions (samples, walkers, 3) from exp(-U/kT), by Monte Carlo."""
    sampler = analysis.WalkerSampler(energies, TEMPERATURE, walkers, (0, 0, 0), seed=seed)
    sampler.burnIn(300)
    return sampler.sample(samples, interval=5).positions/unit.nanometer


def density(positions, edges):
    """Density in bins of the distance from the axis, over that of a uniform distribution.

    Returns the values and their standard errors, from the spread of the replicas.
    """
    r = distances(positions)
    areas = np.pi*np.diff(edges**2)/LATTICE**2
    each = np.array([np.histogram(chain, edges)[0]
                     for chain in r.reshape(len(r), -1).T])/len(r)/areas
    return each.mean(axis=0), each.std(axis=0, ddof=1)/np.sqrt(len(each))


def animation(paths, path, frames=60):
    """The first boomerang of each run, seen from above."""
    from matplotlib.animation import FuncAnimation, PillowWriter
    plt = recording.pyplot()
    figure, axes = plt.subplots(1, 2, figsize=(7.6, 4.1), layout='constrained')
    shown = []
    for ax, (name, (R, q)), color in zip(axes, paths.items(), ('tab:blue', 'tab:orange')):
        pillars(ax)
        blobs = blobsOf(R[:, 0], q[:, 0])/1000
        discs = [
            ax.add_patch(
                plt.Circle((0, 0), RADIUS/1000, facecolor=color, edgecolor='k', linewidth=0.5))
            for _ in SITES
        ]
        trail, = ax.plot([], [], color=color, linewidth=0.7)
        ax.set(xlabel='x (μm)', ylabel='y (μm)', aspect='equal', xlim=(-6, 6), ylim=(-6, 6),
               title=name)
        shown.append((blobs, R[:, 0]/1000, discs, trail))
    clock = axes[0].text(0.03, 0.93, '', transform=axes[0].transAxes)

    def draw(frame):
        changed = [clock]
        for blobs, R, discs, trail in shown:
            now = round(frame/max(1, frames - 1)*(len(R) - 1))
            for disc, blob in zip(discs, blobs[now]):
                disc.set_center(blob[:2])
            trail.set_data(R[:now + 1, 0], R[:now + 1, 1])
            clock.set_text(f't = {now*5*STEP.value_in_unit(unit.second):.1f} s')
            changed += [trail, *discs]
        return changed

    FuncAnimation(figure, draw, frames).save(path, PillowWriter(fps=12), dpi=80)
    plt.close(figure)


def pillars(ax):
    """Draw the pillars, seen from above."""
    from matplotlib.patches import Circle
    for place in PLACES:
        ax.add_patch(Circle(LATTICE*place[:2]/1000, PILLAR/1000, color='0.6'))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--replicas', type=int, default=32, help='boomerangs (default 32)')
    parser.add_argument('--steps', type=int, default=4000, help='time steps (default 4000)')
    parser.add_argument('--cells', type=int, default=64,
                        help='boomerangs whose passages are timed (default 64)')
    parser.add_argument('--passage-steps', type=int, default=10000,
                        help='time steps in which passages begin (default 10000)')
    parser.add_argument('--walkers', type=int, default=400, help='of Monte Carlo (default 400)')
    parser.add_argument('--picture', default='picture.png',
                        help='file to draw (default picture.png)')
    parser.add_argument('--seed', type=int, default=1, help='of the noise (default 1)')
    parser.add_argument('--results', default='results.json', type=Path,
                        help='file for the numbers (default results.json)')
    parser.add_argument('--animation', nargs='?', const='animation.gif',
                        help='draw an animation, too (animation.gif)')
    parser.add_argument('--frames', type=int, default=60, help='of the animation (default 60)')
    arguments = parser.parse_args()
    plt = recording.pyplot()
    edges = np.linspace(800, LATTICE/2, 15)
    figure, axes = plt.subplots(2, 2, figsize=(10, 8.4), layout='constrained')
    axes, found, paths = axes.ravel(), {}, {}
    axes[1].stairs(
        density(equilibrium(arguments.walkers), edges)[0], edges/1000, color='0.75', fill=True,
        label='equilibrium, by Monte Carlo')
    alone = scene('FreeDraining', 1)
    fluid = MobilityForce.cast(alone[1].getSystem().getForce(1))
    D = KT*np.trace(fluid.getMobilityInContext(alone[1])[-6:-3, -6:-3])/3*1e6  # μm²/s, at any place
    for (model, note), marker, color in zip(MODELS.items(), 'os', ('tab:blue', 'tab:orange')):
        R, q = paths[note] = dynamics(model, arguments.replicas, arguments.steps, arguments.seed)
        value, error = density(R, edges)
        axes[1].errorbar((edges[1:] + edges[:-1])/2000, value, error, fmt=marker, markersize=4,
                         color=color, label=note)
        path = R[:, 0, :2]/1000
        axes[0].plot(*path.T, color=color, linewidth=0.7)
        lags = np.unique(np.geomspace(1, len(R)/3, 25).round().astype(int))
        msd = analysis.translationalMSD(R, q, 5*STEP, (0, 0, 0), lags=lags, numBlocks=1,
                                        independentBodies=True).parallel
        t = msd.lagTimes.value_in_unit(unit.second)
        squares, spread = msd.mean/unit.nanometer**2, msd.error/unit.nanometer**2
        axes[2].errorbar(t, squares/1e6, spread/1e6, fmt=marker, markersize=4, color=color,
                         label=note)
        shown = [k for k in (0, *np.searchsorted(t, TIMES)) if k < len(t)]
        found[note] = {
            'times_s': t[shown],
            'msd_over_4t_um2_per_s': squares[shown]/4e6/t[shown],
            'error': spread[shown]/4e6/t[shown]
        }
        said = ', '.join('{} after {:.2f} s'.format(recording.brackets(*each[1:]), each[0])
                         for each in zip(*found[note].values()))
        print(f'{note}: mean square displacement/(4 t) in μm²/s: {said}')
        times, mean, error = meanPassage(model, arguments.cells, arguments.passage_steps,
                                         arguments.seed)
        found[note]['passages'] = {'number': len(times), 'mean_s': mean, 'error': error}
        print(f'{note}: {len(times)} passages, mean time {recording.brackets(mean, error)} s')
        axes[3].step(np.sort(times), 1 - np.arange(1,
                                                   len(times) + 1)/len(times), where='post',
                     color=color, label=f'{note}: mean {recording.brackets(mean, error)} s')
    print(f'far from pillars: {D:.3f} μm²/s')
    axes[2].plot(t, 4*D*t, color='0.6', linewidth=2, label='far from pillars')
    x, y = axes[0].get_xlim(), axes[0].get_ylim()
    pillars(axes[0])
    axes[0].set(xlabel='x (μm)', ylabel='y (μm)', aspect='equal', adjustable='datalim',
                title='paths of two boomerangs', xlim=(x[0] - 1, x[1] + 1),
                ylim=(y[0] - 1, y[1] + 1))
    axes[1].set(xlabel='distance from the axis of a pillar (μm)',
                ylabel='density / uniform density', ylim=(0, None))
    axes[2].set(xlabel='time (s)', ylabel='mean square displacement, x and y (μm²)', xscale='log',
                yscale='log')
    axes[3].set(xlabel='time (s)', ylabel='fraction that is still in its cell', yscale='log',
                xlim=(0, None), ylim=(0.01, 1.1))
    axes[1].legend(loc='upper left', fontsize=9)
    axes[2].legend(fontsize=9)
    axes[3].legend(fontsize=9)
    figure.savefig(arguments.picture, dpi=90)
    plt.close(figure)
    recording.save(arguments.results.parent, arguments.results.name, {
        **found, 'far_from_pillars_um2_per_s': D,
        'run': recording.provenance(arguments)
    })
    if arguments.animation:
        animation(paths, arguments.animation, arguments.frames)


if __name__ == '__main__':
    main()
