#!/usr/bin/env python3
"""A boomerang above a wall: heights and tilts that Brownian dynamics visits, beside equilibrium.

    python3 run.py                     # half a minute; draws picture.png
"""
import argparse

import numpy as np
import openmm
from openmm import unit

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, analysis, app

#: Water at 300 K.
TEMPERATURE, VISCOSITY = 300*unit.kelvin, 0.89e-3*unit.pascal*unit.second
#: kT, kJ/mol; radius of a blob and distance between neighbours, nm.
KT = (unit.MOLAR_GAS_CONSTANT_R*TEMPERATURE).value_in_unit(unit.kilojoule_per_mole)
RADIUS, SPACING = 324.6, 300.0
#: Weight of a boomerang, kT per radius, and strength of the repulsion of each blob, kT: the
#: heaviest boomerang of Delong et al. 2015.
WEIGHT, REPULSION = 3.6, 23.08
#: Energy of a blob at height z.
ENERGY = f'kT*({WEIGHT}/15*z/a + {REPULSION}*a/gap*exp(-2*gap/a)); gap = z - a'
SITES = app.boomerang(SPACING)
#: Edges of the bins: heights of the cross point, nm, and tilts of the body's plane, degrees.
HEIGHTS, TILTS = np.linspace(600, 2400, 31), np.linspace(0, 90, 19)
#: Below this height the wall repels strongly, nm.
NEAR = 800
SCHEMES = {'FixmanMidpoint': 'with the stochastic drift', 'EulerMaruyama': 'without the drift'}


def scene(replicas, scheme='FixmanMidpoint', step=10*unit.millisecond, seed=1):
    """Independent boomerangs in one Context: bodies of different groups do not feel each other.

    Parameters
    ----------
    replicas : int
    scheme : str
        one without momenta
    step : Quantity
    seed : int

    Returns
    -------
    integrator : CustomRigidHIIntegrator
    context : openmm.Context
    """
    system, fluid = openmm.System(), MobilityForce()
    fluid.setBoundary(fluid.NoSlipWall)
    fluid.setViscosity(VISCOSITY)
    integrator = CustomRigidHIIntegrator(TEMPERATURE, step)
    integrator.setScheme(getattr(integrator, scheme))
    integrator.setRandomNumberSeed(seed)
    push = openmm.CustomExternalForce(ENERGY)
    push.addGlobalParameter('kT', KT)
    push.addGlobalParameter('a', RADIUS)
    for _ in range(replicas):
        app.addRigidMultiblob(system, integrator, fluid, SITES, RADIUS)
    for particle in range(system.getNumParticles()):
        push.addParticle(particle, [])
    fluid.setGroups(range(replicas))
    system.addForce(push)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions(np.tile(SITES/unit.nanometer + (0, 0, 1000), (replicas, 1)))
    return integrator, context


def heightsAndTilts(positions, orientations):
    """Heights of the cross point, nm, and angles of the body's plane to the wall, degrees."""
    _, x, y, _ = np.moveaxis(np.asarray(orientations), -1, 0)
    return np.asarray(positions)[..., 2], np.degrees(np.arccos(np.abs(1 - 2*(x*x + y*y))))


def dynamics(scheme, replicas, steps, seed=1):
    """Heights and tilts, each (samples, replicas), of every fifth step after the first 300."""
    integrator, context = scene(replicas, scheme, seed=seed)
    integrator.step(300)  # 3 s: the start is forgotten
    samples = []
    for _ in range(steps // 5):
        integrator.step(5)
        positions = integrator.getBodyPositions()/unit.nanometer
        samples.append(heightsAndTilts(positions, integrator.getBodyOrientations()))
    return np.array(samples).swapaxes(0, 1)


def energies(positions, orientations):
    """Energies (k,) of poses, kJ/mol, as the force has them."""
    w, x, y, z = orientations.T
    vertical = np.stack([2*(x*z - w*y), 2*(y*z + w*x), 1 - 2*(x*x + y*y)], axis=1)
    heights = positions[:, 2:] + vertical @ (SITES/unit.nanometer).T
    gaps = np.maximum(heights - RADIUS, 1e-3)
    repulsion = REPULSION*RADIUS/gaps*np.exp(-2*gaps/RADIUS)
    return KT*(WEIGHT*heights.mean(axis=1)/RADIUS + repulsion.sum(axis=1))


def equilibrium(walkers, samples=300, seed=1):
    """Heights and tilts, each (samples, walkers), from exp(-U/kT) by Monte Carlo."""
    sampler = analysis.WalkerSampler(energies, TEMPERATURE, walkers, (0, 0, 1000),
                                     sitePositions=SITES, radii=RADIUS, wallHeight=0,
                                     coordinates=['z', 'rotation'], seed=seed)
    sampler.burnIn(300)
    found = sampler.sample(samples, interval=5)
    return heightsAndTilts(found.positions, found.orientations)


def density(samples, edges):
    """Density in bins and its standard error, from the spread of the replicas."""
    counts = np.array([np.histogram(chain, edges)[0] for chain in samples.T])
    each = counts/len(samples)/np.diff(edges)
    return each.mean(axis=0), each.std(axis=0, ddof=1)/np.sqrt(len(each))


def mean(samples):
    """Mean and its standard error, likewise."""
    chains = samples.mean(axis=0)
    return chains.mean(), chains.std(ddof=1)/np.sqrt(len(chains))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--replicas', type=int, default=32, help='boomerangs (default 32)')
    parser.add_argument('--steps', type=int, default=2400, help='time steps (default 2400)')
    parser.add_argument('--walkers', type=int, default=400, help='of Monte Carlo (default 400)')
    parser.add_argument('--picture', default='picture.png',
                        help='file to draw (default picture.png)')
    arguments = parser.parse_args()
    import matplotlib
    matplotlib.use('Agg')
    import matplotlib.pyplot as plt
    exact = equilibrium(arguments.walkers)
    found = {s: dynamics(s, arguments.replicas, arguments.steps) for s in SCHEMES}
    for name, (heights, _) in {'equilibrium': exact, **found}.items():
        print('{}: mean height {:.0f} +- {:.0f} nm; '.format(name, *mean(heights)), end='')
        print('below {} nm {:.2f} +- {:.2f} %'.format(NEAR, *mean(100.0*(heights < NEAR))))
    figure, axes = plt.subplots(1, 2, figsize=(9.5, 4), layout='constrained')
    for k, (edges, scale) in enumerate(((HEIGHTS, 1000), (TILTS, 1))):
        axes[k].stairs(
            density(exact[k], edges)[0]*scale, edges/scale, color='0.75', fill=True,
            label='equilibrium, by Monte Carlo')
        for (scheme, note), marker in zip(SCHEMES.items(), 'os'):
            value, error = density(found[scheme][k], edges)
            axes[k].errorbar((edges[1:] + edges[:-1])/2/scale, value*scale, error*scale, fmt=marker,
                             markersize=4, label=f'{scheme}, {note}')
    axes[0].set(xlabel='height of the cross point (μm)', ylabel='probability density (1/μm)',
                yscale='log', ylim=(0.01, 12))
    axes[1].set(xlabel='angle between the boomerang and the wall (degrees)',
                ylabel='probability density (1/degree)', ylim=(0, None))
    axes[0].legend(loc='upper right', fontsize=9)
    figure.savefig(arguments.picture, dpi=110)


if __name__ == '__main__':
    main()
