#!/usr/bin/env python3
"""A boomerang diffuses among pillars: where it is, and how far it comes, with and without a fluid
that couples it to the pillars.

    python3 run.py                     # one or two minutes; draws picture.png
"""
import argparse

import numpy as np
import openmm
from openmm import unit

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, analysis, app

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
SITES = app.boomerang(SPACING, blobsPerArm=2)._value
SITES = SITES - SITES.mean(axis=0)
#: Energy of a blob of the boomerang at the distance r from the axis of the nearest pillar, and at
#: the height z above the middle of the pillars.
ENERGY = (f'kT*(4*exp(-(r - {PILLAR + RADIUS})/100) + z^2/{5*2*500**2}); r = sqrt(dx^2 + dy^2); '
          f'dx = x - L*floor(x/L) - L/2; dy = y - L*floor(y/L) - L/2; L = {LATTICE}')
#: Bodies of a replica.
BODIES = len(PLACES) + 1
STEP = 2*unit.millisecond
#: Times of the displacements that are printed, s.
TIMES = (0.1, 0.4)
MODELS = {'RotnePragerYamakawa': 'with a fluid', 'FreeDraining': 'without interactions'}


def scene(model, replicas, seed=1):
    """Independent forests of pillars that are held, with a boomerang each, in one Context.

    Parameters
    ----------
    model : str
        of the MobilityForce
    replicas : int
    seed : int

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
        for _ in PLACES:
            pillar = app.addRigidMultiblob(system, integrator, fluid, COLUMN, PILLAR)
            integrator.setBodyHeld(pillar, True)
        body = app.addRigidMultiblob(system, integrator, fluid, SITES, RADIUS)
        for particle in integrator.getRigidBodyParticles(body):
            push.addParticle(particle, [])
    fluid.setGroups(np.repeat(np.arange(replicas), BODIES))
    system.addForce(push)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'))
    forest = [COLUMN + LATTICE*place for place in PLACES]
    context.setPositions(np.tile(np.concatenate([*forest, SITES]), (replicas, 1)))
    return integrator, context


def dynamics(model, replicas, steps, seed=1):
    """Positions (frames, replicas, 3) and orientations (frames, replicas, 4) of the boomerangs.

    A frame is every fifth step after the first 400.
    """
    integrator, context = scene(model, replicas, seed)
    integrator.step(400)
    R, q = [], []
    for _ in range(steps // 5):
        integrator.step(5)
        R.append(integrator.getBodyPositions()._value[BODIES - 1::BODIES])
        q.append(integrator.getBodyOrientations()[BODIES - 1::BODIES])
    return np.array(R), np.array(q)


def energies(positions, orientations):
    """Energies (k,) of boomerangs at poses (k, 3) and (k, 4), kJ/mol, as the force has them."""
    w, x, y, z = orientations.T
    rows = np.stack([
        np.stack([1 - 2*(y*y + z*z), 2*(x*y - w*z), 2*(x*z + w*y)], axis=1),
        np.stack([2*(x*y + w*z), 1 - 2*(x*x + z*z), 2*(y*z - w*x)], axis=1),
        np.stack([2*(x*z - w*y), 2*(y*z + w*x), 1 - 2*(x*x + y*y)], axis=1)
    ], axis=1)
    blobs = positions[:, None] + np.einsum('kij,nj->kni', rows, SITES)
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
    return sampler.sample(samples, interval=5).positions._value


def density(positions, edges):
    """Density in bins of the distance from the axis, over that of a uniform distribution.

    Returns the values and their standard errors, from the spread of the replicas.
    """
    r = distances(positions)
    areas = np.pi*np.diff(edges**2)/LATTICE**2
    each = np.array([np.histogram(chain, edges)[0]
                     for chain in r.reshape(len(r), -1).T])/len(r)/areas
    return each.mean(axis=0), each.std(axis=0, ddof=1)/np.sqrt(len(each))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--replicas', type=int, default=32, help='boomerangs (default 32)')
    parser.add_argument('--steps', type=int, default=4000, help='time steps (default 4000)')
    parser.add_argument('--walkers', type=int, default=400, help='of Monte Carlo (default 400)')
    parser.add_argument('--picture', default='picture.png',
                        help='file to draw (default picture.png)')
    arguments = parser.parse_args()
    import matplotlib
    matplotlib.use('Agg')
    import matplotlib.pyplot as plt
    edges = np.linspace(800, LATTICE/2, 15)
    figure, axes = plt.subplots(1, 3, figsize=(13, 4), layout='constrained')
    axes[1].stairs(
        density(equilibrium(arguments.walkers), edges)[0], edges/1000, color='0.75', fill=True,
        label='equilibrium, by Monte Carlo')
    alone = scene('FreeDraining', 1)
    fluid = MobilityForce.cast(alone[1].getSystem().getForce(1))
    D = KT*np.trace(fluid.getMobilityInContext(alone[1])[-6:-3, -6:-3])/3*1e6  # μm²/s, at any place
    for (model, note), marker, color in zip(MODELS.items(), 'os', ('tab:blue', 'tab:orange')):
        R, q = dynamics(model, arguments.replicas, arguments.steps)
        value, error = density(R, edges)
        axes[1].errorbar((edges[1:] + edges[:-1])/2000, value, error, fmt=marker, markersize=4,
                         color=color, label=note)
        path = R[:, 0, :2]/1000
        axes[0].plot(*path.T, color=color, linewidth=0.7)
        lags = np.unique(np.geomspace(1, len(R)/3, 25).round().astype(int))
        msd = analysis.translationalMSD(R, q, 5*STEP, (0, 0, 0), lags=lags, numBlocks=1,
                                        independentBodies=True).parallel
        t = msd.lagTimes.value_in_unit(unit.second)
        axes[2].errorbar(t, msd.mean._value/1e6, msd.error._value/1e6, fmt=marker, markersize=4,
                         color=color, label=note)
        said = ', '.join(
            '{:.3f} +- {:.3f} after {:.2f} s'.format(msd.mean._value[k]/4e6/
                                                     t[k], msd.error._value[k]/4e6/t[k], t[k])
            for k in (0, *np.searchsorted(t, TIMES)) if k < len(t))
        print(f'{note}: mean square displacement/(4 t) in μm²/s: {said}')
    print(f'far from pillars: {D:.3f} μm²/s')
    axes[2].plot(t, 4*D*t, color='0.6', linewidth=2, label='far from pillars')
    x, y = axes[0].get_xlim(), axes[0].get_ylim()
    for place in PLACES:
        axes[0].add_patch(plt.Circle(LATTICE*place[:2]/1000, PILLAR/1000, color='0.6'))
    axes[0].set(xlabel='x (μm)', ylabel='y (μm)', aspect='equal', adjustable='datalim',
                title='paths of two boomerangs', xlim=(x[0] - 1, x[1] + 1),
                ylim=(y[0] - 1, y[1] + 1))
    axes[1].set(xlabel='distance from the axis of a pillar (μm)',
                ylabel='density / uniform density', ylim=(0, None))
    axes[2].set(xlabel='time (s)', ylabel='mean square displacement, x and y (μm²)', xscale='log',
                yscale='log')
    axes[1].legend(loc='upper left', fontsize=9)
    axes[2].legend(fontsize=9)
    figure.savefig(arguments.picture, dpi=100)


if __name__ == '__main__':
    main()
