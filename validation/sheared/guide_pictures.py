#!/usr/bin/env python3
"""Two pictures of the user guide: lubrication against the gap, and a box that tilts with the flow.

    python3 guide_pictures.py --output results           # seconds
"""
import argparse
import pathlib
import sys

import numpy as np
import openmm

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1]/'common'))
from recording import pyplot  # noqa: E402

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, app  # noqa: E402

GAPS = np.geomspace(1e-4, 3, 40)
STYLES = {'Off': ('C1--', 'without lubrication'), 'On': ('C0-', 'with lubrication')}
#: Of the sheared box: edge, positions in the plane of flow and gradient, and strains of the panels.
EDGE = 6.
PLACES = ((0.9, 1.1), (3.6, 0.9), (5.0, 2.8), (1.9, 3.1), (3.7, 4.4), (0.8, 5.1))
STRAINS = (0, 0.45, 0.55)


def mobilityOfApproach(gap, toWall, lubrication):
    """Mobility of a sphere of radius 1 across a wall, or of half the approach of two spheres, over
    that of a free sphere."""
    system, fluid = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(0, 0.01)
    integrator.setScheme('EulerMaruyama')
    places = [(0, 0, 1 + gap)] if toWall else [(0, 0, 0), (0, 0, 2 + gap)]
    for _ in places:
        app.addRigidMultiblob(system, integrator, fluid, [(0, 0, 0)], 1)
    fluid.setBoundary('NoSlipWall' if toWall else 'Unbounded')
    fluid.setLubrication(lubrication)
    fluid.setViscosity(1)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions(places)
    N = np.array(fluid.getMobilityInContext(context))
    return 6*np.pi*(N[2, 2] if toWall else N[2, 2] - N[2, 8])


def exactMobility(gap, toWall):
    """The same from Brenner's series (Chem. Eng. Sci. 16:242, 1961)."""
    alpha = np.arccosh(1 + gap if toWall else 1 + gap/2)
    n = np.arange(1, int(20/alpha) + 20)
    # Numerators and denominators are divided by exp((2n + 1) alpha), which may overflow.
    decay, k = np.exp(-(2*n + 1)*alpha), 2*n + 1
    sinh2, sinh1 = np.sinh(2*alpha)*decay, np.sinh(alpha)**2*decay
    if toWall:
        upper = 1 - decay**2 + k*sinh2
        lower = (1 - decay)**2 - k**2*sinh1
    else:
        upper = (1 + decay)**2 + k**2*sinh1
        lower = 1 - decay**2 - k*sinh2
    terms = n*(n + 1)/((2*n - 1)*(2*n + 3))*(upper/lower - 1)
    return 1/(4/3*np.sinh(alpha)*terms.sum())


def drawLubrication(file, gaps=GAPS):
    plt = pyplot()
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.7), layout='constrained', sharey=True)
    for axis, toWall in zip(axes, (False, True)):
        for lubrication, (style, label) in STYLES.items():
            axis.plot(gaps, [mobilityOfApproach(gap, toWall, lubrication) for gap in gaps], style,
                      label=label)
        some = gaps[::4]
        axis.plot(some, [exactMobility(gap, toWall) for gap in some], 'ko', ms=4,
                  label='exact (Brenner 1961)')
        axis.set(xscale='log', yscale='log', xlabel='gap / radius',
                 title='a sphere towards a no-slip wall' if toWall else 'two spheres approach')
        axis.grid(alpha=0.3)
    axes[0].set(ylabel='mobility over that of a free sphere')
    axes[0].legend(fontsize=9)
    figure.savefig(file, dpi=85)
    plt.close(figure)


def shearedPlaces():
    """For each strain: (positions (n, 2), tracks (n, steps, 2), tilt) of spheres in a run."""
    system, fluid = openmm.System(), MobilityForce()
    step = 0.01
    integrator = CustomRigidHIIntegrator(0, step)
    integrator.setScheme('FixmanMidpoint')
    for _ in PLACES:
        app.addRigidMultiblob(system, integrator, fluid, [(0, 0, 0)], 0.45)
    fluid.setModel('StokesianDynamics')
    fluid.setBoundary('Periodic')
    fluid.setViscosity(1)
    fluid.setShear(1, 0, 1)
    system.addForce(fluid)
    system.setDefaultPeriodicBoxVectors(*(EDGE*np.eye(3)).tolist())
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions([(x, y, EDGE/2) for x, y in PLACES])
    tracks, panels = [np.array(PLACES)], []
    for strain in STRAINS:
        while len(tracks) - 1 < round(strain/step):
            integrator.step(1)
            tracks.append(integrator.getBodyPositions()._value[:, :2])
        box = context.getState().getPeriodicBoxVectors(asNumpy=True)._value
        panels.append((tracks[-1], np.array(tracks).transpose(1, 0, 2), box[1, 0]/EDGE))
    return panels


def drawShear(file):
    plt = pyplot()
    figure, axes = plt.subplots(1, 3, figsize=(11, 3.4), layout='constrained')
    for axis, strain, (places, tracks, tilt) in zip(axes, STRAINS, shearedPlaces()):
        a, b = EDGE*np.array((1, 0)), EDGE*np.array((tilt, 1))
        for i in range(-3, 4):
            for j in range(-2, 3):
                corners = np.array([i*a + j*b + corner for corner in (0*a, a, a + b, b)])
                own = i == j == 0
                axis.add_patch(
                    plt.Polygon(corners, fill=False, ec='k' if own else '0.8',
                                lw=1.8 if own else 0.7, zorder=3 if own else 1))
                for k, place in enumerate(places):
                    axis.add_patch(
                        plt.Circle(place + i*a + j*b, 0.45, fc=f'C{k}', ec='none',
                                   alpha=1 if own else 0.25, zorder=4 if own else 2))
        for track in tracks:
            axis.plot(*track.T, 'k-', lw=1, zorder=5)
            axis.plot(*track[0], 'k.', ms=4, zorder=5)
        axis.set(xlim=(-3.2, 12.2), ylim=(-3, 9), aspect='equal', xlabel='x / nm',
                 title=f'strain {strain:g}: tilt {tilt:.2f}')
    axes[0].set(ylabel='y / nm')
    figure.savefig(file, dpi=80)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--output', type=pathlib.Path, default=pathlib.Path('results'))
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    drawLubrication(args.output/'lubrication.png')
    drawShear(args.output/'tilting_box.png')


if __name__ == '__main__':
    main()
