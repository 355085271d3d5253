#!/usr/bin/env python3
"""Which step for which error, on a scene of your own: a droplet of rigid molecules.

    python3 run.py                     # half a minute; draws picture.png
"""
import argparse

import numpy as np
import openmm
from openmm import unit

from openmmrigidhi import CustomRigidHIIntegrator, accuracy

#: Three charged particles of each molecule, nm, their masses, dalton, and charges, e: TIP3P water.
SHAPE = np.array([(0, 0, 0), (0.09572, 0, 0), (-0.02399, 0.09266, 0)])
MASSES, CHARGES = (15.9994, 1.008, 1.008), (-0.834, 0.417, 0.417)
METHODS, STEPS = ('LangevinB', 'LangevinC'), (0.002, 0.004, 0.006, 0.008)
OBSERVABLE = 'potential_energy'


def scene(edge=2, seed=1):
    """A droplet in vacuum, held together by a soft trap.

    Parameters
    ----------
    edge : int
        molecules along each edge of the cube that the droplet begins as
    seed : int
        of the orientations at the start

    Returns
    -------
    accuracy.Scene
    """
    system, integrator = openmm.System(), CustomRigidHIIntegrator(300*unit.kelvin, 0.002)
    integrator.setFriction(5/unit.picosecond)
    integrator.setRotationalFriction(10/unit.picosecond)
    forces = openmm.NonbondedForce()
    trap = openmm.CustomExternalForce('25*(x^2 + y^2 + z^2)')
    turns = np.linalg.qr(np.random.default_rng(seed).normal(size=(edge**3, 3, 3)))[0]
    positions = []
    for cell, turn in zip(np.ndindex(edge, edge, edge), turns):
        particles = [system.addParticle(mass) for mass in MASSES]
        integrator.addRigidBody(particles)
        trap.addParticle(particles[0], [])
        for k, charge in enumerate(CHARGES):
            forces.addParticle(charge, 0.315061 if k == 0 else 0.1, 0.6364 if k == 0 else 0.0)
        for i, j in ((0, 1), (0, 2), (1, 2)):
            system.addConstraint(particles[i], particles[j], np.linalg.norm(SHAPE[i] - SHAPE[j]))
            forces.addException(particles[i], particles[j], 0, 0.1, 0)
        turn = turn*np.sign(np.linalg.det(turn))  # a rotation, not a reflection
        positions.append(0.32*(np.array(cell) - (edge - 1)/2) + SHAPE @ turn.T)
    system.addForce(forces)
    system.addForce(trap)
    return accuracy.Scene(system, np.concatenate(positions), integrator, name='droplet',
                          description=f'{edge**3} molecules of TIP3P in a trap', equilibration=10.0,
                          sampleInterval=0.12)


def measure(length, methods=METHODS, steps=STEPS):
    """The result of all methods at all steps, each for so many ps."""
    study = accuracy.StepSizeStudy(scene(), list(methods), list(steps), observables=[OBSERVABLE],
                                   platform='Reference', clock='cpu')
    return study.run(length=length)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--length', type=float, default=120, help='of each run, ps (default 120)')
    parser.add_argument('--wanted', default='2%', help='error of the energy (default 2%%)')
    parser.add_argument('--picture', default='picture.png',
                        help='file to draw (default picture.png)')
    arguments = parser.parse_args()
    import matplotlib
    matplotlib.use('Agg')
    import matplotlib.pyplot as plt
    result = measure(arguments.length)
    reference = result.references[OBSERVABLE]
    print(f'energy per molecule as the step vanishes: {reference.value:.2f} +- '
          f'{reference.standardError:.2f} kJ/mol')
    figure, ax = plt.subplots(figsize=(6, 4), layout='constrained')
    ax.axhline(0, color='0.6')
    for k, method in enumerate(METHODS):
        rows = result.select(OBSERVABLE, method)
        percent = 100/abs(reference.value)
        for row in rows:
            print('{} {:.0f} fs: error {:+.2f} +- {:.2f} %'.format(
                method, 1000*row['step_size'], percent*row['error'],
                percent*row['error_standard_error']))
        ax.errorbar([1000*row['step_size'] + 0.12*k - 0.06
                     for row in rows], [percent*row['error'] for row in rows],
                    [percent*row['error_standard_error'] for row in rows], fmt='os'[k] + '-',
                    capsize=4, label=method)
    ax.set(xlabel='step (fs)', ylabel='error of the potential energy (%)',
           xticks=[1000*step for step in STEPS])
    ax.legend()
    figure.savefig(arguments.picture, dpi=110)
    print(result.recommend(f'{OBSERVABLE}:{arguments.wanted}'))


if __name__ == '__main__':
    main()
