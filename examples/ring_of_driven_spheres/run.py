#!/usr/bin/env python3
"""Spheres are driven around a ring: four or more go faster than one alone.

    python3 run.py                     # seconds; draws picture.png
"""
import argparse

import numpy as np
import openmm
from openmm import unit

from openmmrigidhi import CustomBodyForce, CustomRigidHIIntegrator, MobilityForce

#: Radius of the ring, in radii of the spheres, and stiffness of the trap that keeps them on it.
RING, STIFFNESS = 3.0, 10.0
#: Viscosity at which one sphere goes at speed 1 under a force of 1.
ETA = 1/(6*np.pi)
#: The force along the ring has no energy: it is a force on bodies, as an expression of x and y.
DRIVE = ('(-k*(rho - R)*x - f*y)/rho; rho = sqrt(x*x + y*y)',
         '(-k*(rho - R)*y + f*x)/rho; rho = sqrt(x*x + y*y)', '-k*z', '0', '0', '0')
#: Between spheres of one ring that come near; it vanishes smoothly at r = 2.4.
REPULSION = '0.02/((r/2)^12 - 1)*(1 - r*r/2.4^2)^2'


def scene(rings, model, step, repels):
    """Rings of spheres in one Context; those of one ring are a group, and do not feel the others.

    Parameters
    ----------
    rings : list of array
        the angles of the spheres in each ring at the start, rad
    model : MobilityForce.Model
    step : float
        ps
    repels : bool
        whether spheres of a ring repel each other when they come near

    Returns
    -------
    integrator : CustomRigidHIIntegrator
    context : openmm.Context
    """
    system, fluid = openmm.System(), MobilityForce()
    fluid.setModel(model)
    fluid.setViscosity(ETA)
    integrator = CustomRigidHIIntegrator(0, step)  # T = 0: no noise
    integrator.setScheme(integrator.FixmanMidpoint)
    drive = CustomBodyForce(*DRIVE)
    for name, value in (('k', STIFFNESS), ('R', RING), ('f', 1.0)):
        drive.addGlobalParameter(name, value)
    repulsion = openmm.CustomNonbondedForce(REPULSION)
    repulsion.setNonbondedMethod(repulsion.CutoffNonPeriodic)
    repulsion.setCutoffDistance(2.4)
    for angles in rings:
        particles = [system.addParticle(0) for _ in angles]
        for particle in particles:
            fluid.addParticle(1.0)
            drive.addBody(integrator.addRigidBody([particle], 0, (0, 0, 0), [(0, 0, 0)]), [])
            repulsion.addParticle([])
        repulsion.addInteractionGroup(particles, particles)
    fluid.setGroups(np.repeat(np.arange(len(rings)), [len(angles) for angles in rings]))
    for force in (drive, repulsion, fluid) if repels else (drive, fluid):
        system.addForce(force)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    angles = np.concatenate(rings)
    context.setPositions(RING*np.stack([np.cos(angles), np.sin(angles), 0*angles], axis=1))
    return integrator, context


def angles(integrator):
    """Where the spheres are on the ring, rad."""
    x, y, _ = (integrator.getBodyPositions()/unit.nanometer).T
    return np.arctan2(y, x)


def speeds(numbers, model, duration=1.0, step=0.01):
    """Speeds of rings of evenly spaced spheres, over the speed of one alone.

    Parameters
    ----------
    numbers : sequence of int
        spheres in each ring
    model : MobilityForce.Model
    duration, step : float
        ps
    """
    integrator, context = scene([2*np.pi*np.arange(n)/n for n in numbers], model, step,
                                repels=False)
    path = [angles(integrator)]
    for _ in range(round(duration/step)):
        integrator.step(1)
        path.append(angles(integrator))
    turned = np.unwrap(path, axis=0)
    speed = RING*(turned[-1] - turned[0])/duration
    first = np.cumsum([0, *numbers[:-1]])
    return speed[first]


def theory(number):
    """The speed of evenly spaced spheres that do not overlap, by the Rotne-Prager-Yamakawa tensor.

    What the others add to the velocity of the first, along the ring, for a force of 1 on each.
    """
    angle = 2*np.pi*np.arange(1, number)/number
    separation = RING*np.stack([1 - np.cos(angle), -np.sin(angle)], axis=1)
    tangent = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    r = np.linalg.norm(separation, axis=1)
    along = separation[:, 1]*(separation*tangent).sum(axis=1)/r**2
    return 1 + np.sum((3/(4*r) + 1/(2*r**3))*tangent[:, 1] + (3/(4*r) - 3/(2*r**3))*along)


def chase(model, duration, step=0.02, seed=1):
    """Six spheres that start unevenly: times, ps, and angles (times, 6), rad, without jumps."""
    gaps = 0.72 + (2*np.pi - 6*0.72)*np.random.default_rng(seed).dirichlet(np.ones(6))
    integrator, context = scene([np.cumsum(gaps)], model, step, repels=True)
    path, every = [angles(integrator)], round(0.2/step)
    for _ in range(round(duration/0.2)):
        integrator.step(every)
        path.append(angles(integrator))
    return 0.2*np.arange(len(path)), np.unwrap(path, axis=0)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--duration', type=float, default=200,
                        help='of the chase, ps (default 200)')
    parser.add_argument('--picture', default='picture.png',
                        help='file to draw (default picture.png)')
    arguments = parser.parse_args()
    import matplotlib
    matplotlib.use('Agg')
    import matplotlib.pyplot as plt
    numbers = np.arange(1, 10)
    sums = np.array([theory(n) for n in numbers])
    pairwise = speeds(numbers, MobilityForce.RotnePragerYamakawa)
    lubricated = speeds(numbers, MobilityForce.StokesianDynamics)
    print(f'largest difference from theory: {np.abs(pairwise - sums).max():.1e}')
    for n in (2, 6, 9):
        print(f'{n} spheres: {pairwise[n - 1]:.3f} and {lubricated[n - 1]:.3f} times as fast')
    times, turned = chase(MobilityForce.RotnePragerYamakawa, arguments.duration)
    half = len(times) // 2
    speed = RING*(turned[-1] - turned[half])/(times[-1] - times[half])
    print(f'six that start unevenly: {speed.mean():.3f} times as fast')
    figure, axes = plt.subplots(1, 2, figsize=(9.5, 4), layout='constrained')
    axes[0].plot(numbers, sums, color='0.6', linewidth=2, label='Rotne-Prager-Yamakawa, theory')
    axes[0].plot(numbers, pairwise, 'o', label='Rotne-Prager-Yamakawa, measured')
    axes[0].plot(numbers, lubricated, 's', label='Stokesian dynamics, measured')
    axes[0].set(xlabel='number of spheres, evenly spaced', ylabel='speed / speed of one alone',
                xticks=numbers)
    axes[0].legend(fontsize=9)
    late = times >= times[-1] - 100
    axes[1].plot(times[late], np.degrees(turned - turned.mean(axis=1, keepdims=True))[late])
    axes[1].set(xlabel='time (ps)', ylabel='angle less the mean angle (degrees)')
    figure.savefig(arguments.picture, dpi=110)


if __name__ == '__main__':
    main()
