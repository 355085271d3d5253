#!/usr/bin/env python3
"""Replicas of dipoles in a field of several strengths: means with error bars, in processes.

    python3 run.py                     # half a minute; draws picture.png
"""
import argparse
import tempfile

import numpy as np
import openmm
from openmm import unit

from openmmrigidhi import CustomBodyForce, CustomRigidHIIntegrator, ensemble

TEMPERATURE = 300*unit.kelvin
KT = (unit.MOLAR_GAS_CONSTANT_R*TEMPERATURE).value_in_unit(unit.kilojoule_per_mole)
#: Dipoles in each replica; they do not feel each other.
DIPOLES = 5
#: Energies of a dipole along the field, kT.
FIELDS = [0.5, 1.0, 2.0, 4.0, 8.0]
#: The torque n x E of a field along z on a dipole n, the z axis of the body.
TORQUE = ('ny*energy; ny = 2*(q2*q3 - q0*q1)', '-nx*energy; nx = 2*(q1*q3 + q0*q2)', '0')


def scene(field=1.0, seed=1):
    """Dipoles that are turned at random at the start.

    Parameters
    ----------
    field : float
        energy of a dipole along the field, kT
    seed : int
        of the start

    Returns
    -------
    system : openmm.System
    positions : list
    integrator : CustomRigidHIIntegrator
    """
    system, integrator = openmm.System(), CustomRigidHIIntegrator(TEMPERATURE, 0.02)
    integrator.setFriction(5/unit.picosecond)
    integrator.setRotationalFriction(5/unit.picosecond)
    torque = CustomBodyForce('-10*x', '-10*y', '-10*z', *TORQUE)
    torque.addGlobalParameter('energy', field*KT)
    system.addForce(torque)
    positions = []
    for turn in np.linalg.qr(np.random.default_rng(seed).normal(size=(DIPOLES, 3, 3)))[0]:
        # A second, massless particle marks the z axis.
        particles = [system.addParticle(50), system.addParticle(0)]
        torque.addBody(
            integrator.addRigidBody(particles, 50, (0.8, 0.8, 0.8), [(0, 0, 0), (0, 0, 0.2)]), [])
        positions += [(0, 0, 0), tuple(0.2*turn[:, 2])]
    return system, positions, integrator


def alignment(context):
    """The mean cosine between the dipoles and the field."""
    integrator = CustomRigidHIIntegrator.cast(context.getIntegrator())
    _, x, y, _ = integrator.getBodyOrientations().T
    return np.mean(1 - 2*(x*x + y*y))


def theory(field):
    """Langevin's function."""
    return 1/np.tanh(field) - 1/field


def study(replicas, length, fields=FIELDS):
    """The study, not run: a setting for each field."""
    return ensemble.Study(scene, ensemble.sweep(field=list(fields)), replicas=replicas,
                          length=length, equilibration=5.0, sampleInterval=0.2,
                          observables=[alignment], platform='Reference')


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--replicas', type=int, default=4, help='of each field (default 4)')
    parser.add_argument('--length', type=float, default=200, help='of each, ps (default 200)')
    parser.add_argument('--jobs', type=int, default=2, help='processes (default 2)')
    parser.add_argument('--picture', default='picture.png',
                        help='file to draw (default picture.png)')
    arguments = parser.parse_args()
    import matplotlib
    matplotlib.use('Agg')
    import matplotlib.pyplot as plt
    with tempfile.TemporaryDirectory() as directory:
        result = study(arguments.replicas, arguments.length).run(directory, jobs=arguments.jobs,
                                                                 quiet=True)
    print('field  mean cosine        theory  R-hat')
    for row in result.rows:
        print('{:5g}  {:.4f} +- {:.4f}  {:.4f}  {:.3f}'.format(row['settings']['field'],
                                                               row['mean'], row['standard_error'],
                                                               theory(row['settings']['field']),
                                                               row['r_hat']))
    fine = np.linspace(0.05, 8.5, 200)
    means = np.array([row['mean'] for row in result.rows])
    bars = [
        means - [row['low'] for row in result.rows], [row['high'] for row in result.rows] - means
    ]
    figure, axes = plt.subplots(2, 1, figsize=(6, 5.5), layout='constrained', sharex=True,
                                height_ratios=(2, 1))
    axes[0].plot(fine, theory(fine), color='0.6', linewidth=2, label="theory: Langevin's function")
    axes[0].errorbar(FIELDS, means, bars, fmt='o', markersize=5, capsize=4,
                     label=f'mean of {arguments.replicas} replicas, 95 % interval')
    axes[0].set(ylabel='mean cosine to the field')
    axes[0].legend()
    axes[1].axhline(0, color='0.6', linewidth=2)
    axes[1].errorbar(FIELDS, means - theory(np.array(FIELDS)), bars, fmt='o', markersize=5,
                     capsize=4)
    axes[1].set(xlabel='energy of a dipole along the field (kT)', ylabel='less theory')
    figure.savefig(arguments.picture, dpi=110)


if __name__ == '__main__':
    main()
