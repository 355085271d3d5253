#!/usr/bin/env python3
"""Spheres with a dipole follow a rotating field, up to a critical frequency.

Above the critical frequency friction holds them back.

    python3 run.py                     # seconds; draws picture.png
"""
import argparse

import numpy as np
import openmm

from openmmrigidhi import CustomBodyForce, CustomRigidHIIntegrator, MobilityForce

#: Viscosity, radius, and dipole moment times field, so that the critical frequency is 1 per ps.
ETA, RADIUS = 1.0, 1.0
STRENGTH = 8*np.pi*ETA*RADIUS**3
#: Frequencies of the fields, in units of the critical frequency.
FREQUENCIES = np.linspace(0.1, 3, 30)
#: The dipole is the body's x axis: in the lab frame (nx, ny), the first column of the rotation
#: matrix of q. The field turns about z.
TORQUE = ('strength*(nx*sin(frequency*t) - ny*cos(frequency*t)); nx = q0^2 + q1^2 - q2^2 - q3^2; '
          'ny = 2*(q1*q2 + q0*q3)')


def rates(frequencies, duration, step=0.02):
    """The mean rate at which a sphere turns in each field, rad/ps.

    All spheres are in one Context, in a fluid that does not couple them, without noise.
    """
    system, fluid = openmm.System(), MobilityForce()
    fluid.setModel(fluid.FreeDraining)
    fluid.setViscosity(ETA)
    integrator = CustomRigidHIIntegrator(0, step)
    integrator.setScheme(integrator.FixmanMidpoint)
    field = CustomBodyForce('0', '0', '0', '0', '0', TORQUE)
    field.addGlobalParameter('strength', STRENGTH)
    field.addPerBodyParameter('frequency')
    for frequency in frequencies:
        particle = system.addParticle(0)
        fluid.addParticle(RADIUS)
        field.addBody(integrator.addRigidBody([particle], 0, (0, 0, 0), [(0, 0, 0)]), [frequency])
    system.addForce(field)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'))
    context.setPositions([(0, 0, 0)]*len(frequencies))
    angles, steps = [], round(duration/step)
    for _ in range(steps):
        integrator.step(1)
        w, x, y, z = integrator.getBodyOrientations().T
        angles.append(np.arctan2(2*(x*y + w*z), w*w + x*x - y*y - z*z))
    turned = np.unwrap(angles, axis=0)
    half = steps // 2  # the first half is left out: the spheres still forget their start
    return (turned[-1] - turned[half])/((steps - 1 - half)*step)


def theory(frequencies):
    """The rate of a sphere: a field up to the critical frequency 1 is followed exactly.

    Behind a faster field the sphere lags and slips.
    """
    frequencies = np.asarray(frequencies, dtype=float)
    return frequencies - np.sqrt(np.maximum(frequencies**2 - 1, 0))


def draw(frequencies, measured):
    """The mean rate over the frequency, and theory."""
    import matplotlib.pyplot as plt
    difference = np.abs(measured - theory(frequencies)).max()
    print(f'largest difference from theory: {difference:.4f} rad/ps')
    fine = np.linspace(0, 3, 400)
    figure, ax = plt.subplots(figsize=(6, 4), layout='constrained')
    ax.plot(fine, theory(fine), color='0.6', linewidth=2, label='theory')
    ax.plot(frequencies, measured, 'o', markersize=5, label='measured')
    ax.set(xlabel='frequency of the field / critical frequency',
           ylabel='mean rate of the sphere / critical frequency')
    ax.legend()
    return figure


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--duration', type=float, default=400, help='ps (default 400)')
    parser.add_argument('--picture', default='picture.png',
                        help='file to draw (default picture.png)')
    arguments = parser.parse_args()
    import matplotlib
    matplotlib.use('Agg')
    measured = rates(FREQUENCIES, arguments.duration)
    draw(FREQUENCIES, measured).savefig(arguments.picture, dpi=130)


if __name__ == '__main__':
    main()
