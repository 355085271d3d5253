#!/usr/bin/env python3
"""Two flows around bodies, read by MobilityForce.getFlowInContext() and drawn.

One is a periodic box with shells in a wave of force density. The other is a shell in shear above a
wall. No force acts on a body, and there is no noise: bodies go with the flow, turn with it, and
resist its strain.

    python3 run.py --output results                     # half a minute
"""
import argparse
import sys
from pathlib import Path

import numpy as np
import openmm
from openmm import unit

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, app

sys.path.insert(0, str(Path(__file__).resolve().parents[2]/'validation'/'common'))
import recording  # noqa: E402

ETA = 1.0
#: Edge of the box over the radius of shells; f0 of the wave. Then the places of the shells in the
#: plane z = 0: on both crests, between them, and between crest and zero.
EDGE, F0 = 12.0, 1.0
PLACES = ((-3.0, 3.0, 0.0), (2.5, -3.6, 0.0), (3.2, 0.0, 0.0), (-2.2, -1.6, 0.0))
#: Rate of the shear above the wall z = 0, 1/ps, and the height of the centre over the radius.
RATE, HEIGHT = 1.0, 1.3


class Flow:
    """Shells of blobs without forces on them, and the flow around them.

    Parameters
    ----------
    places : array-like of shape (n, 3)
        centres, nm; hydrodynamic radii are 1 nm
    blobs : int
        number of blobs of each shell
    setUp : callable
        called with the MobilityForce and the System
    """
    def __init__(self, places, blobs, setUp):
        self.places = np.asarray(places, float)
        sites, radius = app.multiblobSphere(blobs, 1.0)
        self.sites = sites/unit.nanometer
        self.system, self.fluid = openmm.System(), MobilityForce()
        self.integrator = CustomRigidHIIntegrator(0, 1e-3)
        self.integrator.setScheme(CustomRigidHIIntegrator.EulerMaruyama)
        for _ in self.places:
            app.addRigidMultiblob(self.system, self.integrator, self.fluid, sites, radius)
        self.fluid.setViscosity(ETA)
        setUp(self.fluid, self.system)
        self.system.addForce(self.fluid)
        app.bindBodies(self.system, self.integrator)
        self.context = openmm.Context(self.system, self.integrator,
                                      openmm.Platform.getPlatformByName('CPU'), {'Threads': '1'})
        self.context.setPositions((self.places[:, None] + self.sites).reshape(-1, 3))

    def at(self, points):
        """Velocities of the fluid at points (..., 3), nm/ps."""
        points = np.asarray(points, float)
        u = self.fluid.getFlowInContext(self.context, points.reshape(-1, 3))
        return (u/(unit.nanometer/unit.picosecond)).reshape(points.shape)

    def twists(self):
        """Velocities and angular velocities of the shells, (n, 3) each.

        They are found by one step, which is so short that the shells hardly move.
        """
        before = self.integrator.getBodyPositions()/unit.nanometer
        self.integrator.step(1)
        q = self.integrator.getBodyOrientations()
        h = self.integrator.getStepSize()/unit.picosecond
        found = (self.integrator.getBodyPositions()/unit.nanometer - before)/h, 2*q[:, 1:]/h
        self.context.setPositions((self.places[:, None] + self.sites).reshape(-1, 3))
        return found

    def slipOfSurface(self, twists, distance=1.0):
        """Root mean square of the flow relative to the shells, at points around them.

        The points are at this distance from the centres. The unit is the shells' radius times a
        rate of strain of 1/ps.
        """
        sphere = app.multiblobSphere(162, 1.0)[0]/unit.nanometer
        normals = sphere/np.linalg.norm(sphere, axis=1)[:, None]
        squares = [((self.at(place + distance*normals) - V -
                     np.cross(W, distance*normals))**2).sum(axis=1).mean()
                   for place, V, W in zip(self.places, *twists)]
        return float(np.mean(squares)**0.5)


def inWave(blobs):
    """Shells in a periodic box, with a force density f0 sin(ky) along x on the fluid."""
    def setUp(fluid, system):
        fluid.setBoundary(MobilityForce.Periodic)
        fluid.setSinusoidalForceDensity(F0, 0, 1, 1)
        system.setDefaultPeriodicBoxVectors(*EDGE*np.eye(3))

    return Flow(PLACES, blobs, setUp)


def aboveWall(blobs):
    """One shell above the wall z = 0, in the shear v_x = rate z."""
    def setUp(fluid, system):
        fluid.setBoundary(MobilityForce.NoSlipWall)
        fluid.setBackgroundFlow((0, 0, 0), [(0, 0, RATE), (0, 0, 0), (0, 0, 0)])

    return Flow([(0, 0, HEIGHT)], blobs, setUp)


def measure(blobs=162, points=61):
    """Both flows on points of a plane, and numbers about them: (flows, numbers)."""
    crest = F0/(ETA*(2*np.pi/EDGE)**2)
    wave, wall = inWave(blobs), aboveWall(blobs)
    rate = crest*2*np.pi/EDGE
    numbers, flows = {}, {}
    for name, flow, strain in (('wave', wave, rate), ('wall', wall, RATE)):
        twists = flow.twists()
        numbers[name] = {
            'velocities': twists[0],
            'angular_velocities': twists[1],
            'slip_of_surfaces': flow.slipOfSurface(twists)/strain
        }
    x = np.linspace(-EDGE/2, EDGE/2, points)
    xy = np.stack(np.meshgrid(x, x), -1)
    flows['wave'] = x, x, wave.at(np.concatenate([xy, 0*xy[..., :1]], -1))[..., :2]/crest
    mode = wave.fluid.getFlowModeInContext(wave.context, 0, 1, 1)
    amplitude = mode[0]/(unit.nanometer/unit.picosecond)
    numbers['wave'].update({
        'crest': crest,
        'amplitude_over_crest': amplitude/crest,
        'effective_viscosity_over_viscosity': crest/amplitude,
        'volume_fraction': len(PLACES)*4/3*np.pi/EDGE**3
    })
    x, z = np.linspace(-4, 4, points), np.linspace(0, 4, (points + 1) // 2)
    xz = np.stack(np.meshgrid(x, z), -1)
    found = wall.at(np.stack([xz[..., 0], 0*xz[..., 0], xz[..., 1]], -1))
    V = numbers['wall']['velocities'][0]
    numbers['wall'].update({
        'height': HEIGHT,
        'speed_over_undisturbed': V[0]/(RATE*HEIGHT),
        'turning_over_undisturbed': numbers['wall']['angular_velocities'][0][1]/(RATE/2),
        'fastest_at_the_wall_over_shear': float(np.abs(found[0]).max()/RATE)
    })
    # Velocities relative to the shell's.
    flows['wall'] = x, z, (found - V)[..., [0, 2]]/RATE
    return flows, numbers


def picture(flows, path):
    plt = recording.pyplot()
    figure, axes = plt.subplots(1, 2, figsize=(10.5, 4.6), layout='constrained',
                                gridspec_kw={'width_ratios': [1, 1.7]})
    for ax, name, centres, label in ((axes[0], 'wave', PLACES,
                                      'speed over that of the crest without shells'),
                                     (axes[1], 'wall', [(0, HEIGHT, 0)],
                                      'speed relative to the shell over rate × radius')):
        x, y, u = flows[name]
        # Few colours make a small file.
        drawn = ax.contourf(x, y, np.hypot(u[..., 0], u[..., 1]), levels=16, cmap='viridis')
        ax.streamplot(x, y, u[..., 0], u[..., 1], color='w', density=1.2, linewidth=0.6,
                      arrowsize=0.7)
        for centre in centres:
            ax.add_patch(
                plt.Circle(centre[:2], 1, facecolor='0.75', edgecolor='k', linewidth=0.8, zorder=3))
        ax.set(aspect='equal', xlabel='x/a', ylabel='y/a' if name == 'wave' else 'z/a',
               xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))
        figure.colorbar(drawn, ax=ax, label=label, location='bottom')
    axes[0].set_title('four shells in a wave of force density')
    axes[1].set_title('a shell in shear above a wall')
    figure.savefig(path, dpi=100)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--output', type=Path, default=Path(__file__).resolve().parent/'results')
    parser.add_argument('--blobs', type=int, default=162, help='blobs of a shell (%(default)s)')
    parser.add_argument('--points', type=int, default=61,
                        help='points along an edge of the pictures (%(default)s)')
    arguments = parser.parse_args()
    flows, numbers = measure(arguments.blobs, arguments.points)
    recording.save(arguments.output, 'flows.json', {
        **numbers, 'run': recording.provenance(arguments)
    })
    picture(flows, arguments.output/'flows.png')


if __name__ == '__main__':
    main()
