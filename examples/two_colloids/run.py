#!/usr/bin/env python3
"""Two colloids are pushed together: their surfaces touch only without lubrication.

    python3 run.py                     # seconds; draws picture.png
"""
import argparse

import numpy as np
import openmm
from openmm import unit

from openmmrigidhi import CustomBodyForce, CustomRigidHIIntegrator, MobilityForce

#: Radius of both colloids, nm; the force on each, kJ/mol/nm; the viscosity of water.
RADIUS, FORCE, VISCOSITY = 10.0, 100.0, 0.89e-3*unit.pascal*unit.second
#: The models, and whether pairs are lubricated.
MODELS = {
    'free draining': (MobilityForce.FreeDraining, False),
    'Rotne-Prager-Yamakawa': (MobilityForce.RotnePragerYamakawa, False),
    'Stokesian dynamics': (MobilityForce.StokesianDynamics, True)
}


def approach(model, lubrication, gap=1.0, duration=2.0, steps=2000):
    """Times and gaps between the surfaces, until these touch, at T = 0, without noise.

    The unit of time is the time in which one colloid alone moves by its radius. Gaps are in radii.
    """
    system, fluid = openmm.System(), MobilityForce()
    fluid.setModel(model)
    fluid.setLubrication(lubrication)
    fluid.setViscosity(VISCOSITY)
    eta = fluid.getViscosity()/(unit.dalton/(unit.nanometer*unit.picosecond))
    # The time in which one colloid alone moves by its radius, ps
    alone = 6*np.pi*eta*RADIUS**2/FORCE
    integrator = CustomRigidHIIntegrator(0, duration*alone/steps)
    integrator.setScheme(integrator.FixmanMidpoint)
    push = CustomBodyForce('push', '0', '0', '0', '0', '0')
    push.addPerBodyParameter('push')
    for sign in (1, -1):
        particle = system.addParticle(0)
        fluid.addParticle(RADIUS)
        push.addBody(integrator.addRigidBody([particle], 0, (0, 0, 0), [(0, 0, 0)]), [sign*FORCE])
    system.addForce(push)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions([(0, 0, 0), ((2 + gap)*RADIUS, 0, 0)])
    times, gaps = [0.0], [gap]
    for k in range(steps):
        integrator.step(1)
        first, second = integrator.getBodyPositions()[:, 0]/unit.nanometer
        times.append((k + 1)*duration/steps)
        gaps.append((second - first)/RADIUS - 2)
        if gaps[-1] < 0:
            break
    return np.array(times), np.array(gaps)


def compare(steps=2000):
    """Times and gaps for each model."""
    curves = {}
    for name, (model, lubrication) in MODELS.items():
        times, gaps = curves[name] = approach(model, lubrication, steps=steps)
        print(f'{name}: ' + (f'the surfaces touch at {times[-1]:.2f}' if gaps[-1] < 0 else
                             f'the gap at {times[-1]:.2f} is {gaps[-1]:.2e} radii'))
    return curves


def draw(curves):
    """The gap over time, a curve for each model."""
    import matplotlib.pyplot as plt
    figure, ax = plt.subplots(figsize=(6, 4), layout='constrained')
    for name, (times, gaps) in curves.items():
        ax.semilogy(times[gaps > 0], gaps[gaps > 0], label=name, linewidth=2)
    ax.set(xlabel='time, in that one colloid alone takes for its radius',
           ylabel='gap between the surfaces / radius', ylim=(8e-3, 1.2))
    ax.legend()
    return figure


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--steps', type=int, default=2000, help='time steps (default 2000)')
    parser.add_argument('--picture', default='picture.png',
                        help='file to draw (default picture.png)')
    arguments = parser.parse_args()
    import matplotlib
    matplotlib.use('Agg')
    draw(compare(arguments.steps)).savefig(arguments.picture, dpi=130)


if __name__ == '__main__':
    main()
