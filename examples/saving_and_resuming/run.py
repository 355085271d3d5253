#!/usr/bin/env python3
"""A run is stopped and goes on from files, and equals the run that was not stopped, bit for bit.

    python3 run.py                     # seconds; draws picture.png
"""
import argparse
import pathlib
import tempfile

import numpy as np
import openmm
from openmm import unit

from openmmrigidhi import CustomRigidHIIntegrator

#: The three particles of each molecule, nm, and their masses, dalton.
SHAPE = np.array([(0, 0, 0), (0.1, 0, 0), (-0.03, 0.09, 0)])
MASSES, MOLECULES = (16, 2, 1), 4
FILES = 'system.xml', 'integrator.xml', 'state.xml'


def begin(seed=1):
    """Rigid molecules in a trap that repel each other, at 300 K.

    Returns
    -------
    openmm.Context
        on the Reference platform, where all is the same to the last bit
    """
    system, integrator = openmm.System(), CustomRigidHIIntegrator(300*unit.kelvin, 0.004)
    integrator.setFriction(2/unit.picosecond)
    integrator.setRotationalFriction(4/unit.picosecond)
    integrator.setRandomNumberSeed(seed)
    trap = openmm.CustomExternalForce('20*(x^2 + y^2 + z^2)')
    repulsion = openmm.CustomNonbondedForce('2*exp(-(r/0.15)^2)')
    places = []
    for molecule in range(MOLECULES):
        particles = [system.addParticle(mass) for mass in MASSES]
        integrator.addRigidBody(particles)
        for particle in particles:
            trap.addParticle(particle, [])
            repulsion.addParticle([])
        for i, j in ((0, 1), (0, 2), (1, 2)):
            system.addConstraint(particles[i], particles[j], np.linalg.norm(SHAPE[i] - SHAPE[j]))
            repulsion.addExclusion(particles[i], particles[j])
        places.append(SHAPE + (0.4*molecule - 0.6, 0, 0))
    system.addForce(trap)
    system.addForce(repulsion)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions(np.concatenate(places))
    context.setVelocitiesToTemperature(300, seed)
    return context


def save(context, folder):
    """Write the System, the integrator and the State as XML.

    Parameters
    ----------
    context : openmm.Context
    folder : pathlib.Path
    """
    # The integrator's part of the State has poses, velocities and the count of random numbers.
    state = context.getState(getPositions=True, getVelocities=True, getIntegratorParameters=True)
    things = context.getSystem(), context.getIntegrator(), state
    for name, thing in zip(FILES, things):
        (folder/name).write_text(openmm.XmlSerializer.serialize(thing))


def resume(folder):
    """Make a Context of these files alone, as another program on another day would."""
    system, integrator, state = (openmm.XmlSerializer.deserialize((folder/name).read_text())
                                 for name in FILES)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setState(state)
    return context


def follow(context, steps):
    """Positions (steps, bodies, 3), nm, after each step."""
    integrator, path = CustomRigidHIIntegrator.cast(context.getIntegrator()), []
    for _ in range(steps):
        integrator.step(1)
        path.append(integrator.getBodyPositions()/unit.nanometer)
    return np.array(path)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--steps', type=int, default=1000,
                        help='of the whole run, which is stopped at half (default 1000)')
    parser.add_argument('--picture', default='picture.png',
                        help='file to draw (default picture.png)')
    arguments = parser.parse_args()
    import matplotlib
    matplotlib.use('Agg')
    import matplotlib.pyplot as plt
    half = arguments.steps // 2
    whole = follow(begin(), 2*half)
    context = begin()
    first = follow(context, half)
    with tempfile.TemporaryDirectory() as folder:
        save(context, pathlib.Path(folder))
        checkpoint = context.createCheckpoint()
        del context
        context = resume(pathlib.Path(folder))
    second = follow(context, half)
    context.loadCheckpoint(checkpoint)
    again = follow(context, half)
    stopped = np.concatenate([first, second])
    print(f'largest difference after XML: {np.abs(stopped - whole).max()} nm')
    print(f'largest difference after a checkpoint: {np.abs(again - whole[half:]).max()} nm')
    print(f'the bodies moved by up to {np.abs(whole - whole[0]).max():.2f} nm')
    times = 0.004*np.arange(1, 2*half + 1)
    figure, axes = plt.subplots(2, 1, figsize=(7, 5), layout='constrained', sharex=True,
                                height_ratios=(3, 1))
    axes[0].plot(times, whole[:, 0, 0], color='0.7', linewidth=5, label='not stopped')
    axes[0].plot(times[:half], first[:, 0, 0], color='C0', label='until it is stopped')
    axes[0].plot(times[half:], second[:, 0, 0], color='C1', label='resumed from XML')
    axes[0].axvline(times[half - 1], color='0.3', linestyle=':')
    axes[0].set(ylabel='x of the first molecule (nm)')
    axes[0].legend(ncols=3, fontsize=9, loc='upper center', bbox_to_anchor=(0.5, 1.17))
    axes[1].plot(times, np.abs(stopped - whole).max(axis=(1, 2)), color='C3')
    axes[1].axvline(times[half - 1], color='0.3', linestyle=':')
    axes[1].set(xlabel='time (ps)', ylabel='largest\ndifference (nm)', ylim=(-1, 1))
    figure.savefig(arguments.picture, dpi=110)


if __name__ == '__main__':
    main()
