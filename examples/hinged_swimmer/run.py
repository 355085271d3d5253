#!/usr/bin/env python3
"""Purcell's swimmer: three links, two hinges with motors, and a stroke that is not reciprocal.

    python3 run.py                     # about a minute; draws picture.png and writes results.json
    python3 run.py --animation         # draws animation.gif, too
"""
import argparse
import sys
from pathlib import Path

import numpy as np
import openmm
import tqdm
from openmm import unit

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, app

sys.path.insert(0, str(Path(__file__).resolve().parents[2]/'validation'/'common'))
import recording  # noqa: E402

#: Of a link: blobs along it, and the distance of its two rows, in radii of a blob, 0.5 nm. Hinges
#: are halfway between the last blobs of two links.
BLOBS, RADIUS = 6, 0.5
SPACING = 2*RADIUS
LENGTH = BLOBS*SPACING
#: The hinges turn between -AMPLITUDE and AMPLITUDE, at this rate in rad/ps.
AMPLITUDE, RATE = np.pi/3, 1e-2
#: The rates of both motors in the parts of a stroke. Each part turns one hinge from end to end.
PURCELL = [(-1, 0), (0, -1), (1, 0), (0, 1)]
#: One hinge opens and closes, as a scallop does.
SCALLOP = [(-1, 0), (1, 0)]
#: K, of the swimmers in noise; and frames of a part of a stroke in paths.
TEMPERATURE, FRAMES = 300, 8
UP = (0, 0, 1)


def link(blobs=BLOBS):
    """Two rows of blobs along x, one above the other: a line of blobs alone has no rotation about
    itself, which hinges need."""
    x = SPACING*(np.arange(blobs) - (blobs - 1)/2)
    return np.array([(along, 0, side) for side in (-RADIUS, RADIUS) for along in x])


def pose(first, second, turn=0):
    """The sites of a swimmer in the plane z = 0 with these angles; `turn` is the middle link's."""
    sites = [link()]
    for side, angle in ((-1, -first), (1, second)):
        turned = rotated(link() + (side*LENGTH/2, 0, 0), angle)
        sites.append(turned + (side*LENGTH/2, 0, 0))
    return rotated(np.concatenate([sites[1], sites[0], sites[2]]), turn)


def rotated(sites, angle):
    """About the z axis."""
    c, s = np.cos(angle), np.sin(angle)
    return sites @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


class Swimmers:
    """Many swimmers in a Context, each in a fluid of its own.

    Parameters
    ----------
    number : int
    temperature : float
        K
    steps : int
        of the integrator in a part of a stroke
    joined : bool
        whether there are hinges and motors
    amplitude : float
        rad
    """
    def __init__(self, number, temperature, steps, seed=1, joined=True, amplitude=AMPLITUDE):
        system, self.fluid = openmm.System(), MobilityForce()
        fluid = self.fluid
        fluid.setViscosity(602)  # water, dalton/(nm ps)
        self.steps = steps
        self.step = 2*amplitude/RATE/steps
        self.integrator = integrator = CustomRigidHIIntegrator(temperature, self.step)
        integrator.setScheme(integrator.TrapezoidalSlip)
        integrator.setRandomNumberSeed(seed)
        end = np.array((LENGTH/2, 0, 0))
        self.motors = []
        for _ in range(number):
            left, middle, right = (app.addRigidMultiblob(system, integrator, fluid, link(), RADIUS)
                                   for _ in range(3))
            # Both angles are counted by the right hand, along the chain from left to right.
            for i, j in ((left, middle), (middle, right)) if joined else ():
                hinge = integrator.addHinge(i, end, j, -end, UP, UP)
                self.motors.append(integrator.addHingeMotor(hinge, 0))
        fluid.setGroups(np.repeat(np.arange(number), 3))
        system.addForce(fluid)
        self.context = openmm.Context(system, integrator,
                                      openmm.Platform.getPlatformByName('Reference'))
        self.context.setPositions(np.concatenate(number*[pose(amplitude, amplitude)]))
        self.work = 0.0  # of all motors, kJ/mol

    def centres(self):
        return (self.integrator.getBodyPositions()/unit.nanometer).reshape(-1, 3, 3)

    def sites(self):
        return self.context.getState(getPositions=True).getPositions(asNumpy=True)/unit.nanometer

    def turn(self, signs, part=1.0):
        """One part of a stroke, or this much of it."""
        rates = RATE*np.tile(signs, len(self.motors) // 2)
        for motor, rate in zip(self.motors, rates):
            self.integrator.setHingeMotorRate(motor, rate)
        for _ in range(round(part*self.steps)):
            self.integrator.step(1)
            torques = self.integrator.getHingeMotorTorques()/unit.kilojoule_per_mole
            self.work += torques @ rates*self.step

    def swim(self, strokes, parts=PURCELL, quiet=True):
        """The centres of the links (frames, swimmers, 3, 3) before and after frames of strokes."""
        path = [self.centres()]
        for _ in tqdm.trange(strokes, desc='strokes', disable=quiet):
            for signs in parts:
                for _ in range(FRAMES):
                    self.turn(signs, part=1/FRAMES)
                    path.append(self.centres())
        return np.array(path)


def alone(friction, first, second, turn):
    """How the swimmer moves when nothing pushes it, by its friction with three links let go.

    Returns
    -------
    function
        of the rates of the motors: the velocity (x, y) of the middle link and its spin
    """
    angles = np.array([turn - first, turn, turn + second])
    along = np.array([np.cos(angles), np.sin(angles)]).T*LENGTH/2
    # From the middle link's centre to those of the others, and from the hinges to these.
    arms = np.array([-along[1] - along[0], (0, 0), along[1] + along[2]])
    bends = np.array([-along[0], (0, 0), along[2]])
    rigid = np.zeros((9, 3))
    for k in range(3):
        rigid[3*k:3*k + 3] = [(1, 0, -arms[k, 1]), (0, 1, arms[k, 0]), (0, 0, 1)]

    def velocity(rates):
        own = np.zeros(9)
        for k, spin in ((0, -rates[0]), (2, rates[1])):
            own[3*k:3*k + 3] = (-spin*bends[k, 1], spin*bends[k, 0], spin)
        return -np.linalg.solve(rigid.T @ friction @ rigid, rigid.T @ friction @ own)

    return velocity


def stroke(friction, parts=PURCELL, steps=50, amplitude=AMPLITUDE):
    """Where the middle link is after a stroke, (x, y, angle), without joints: RK4 in time.

    `friction` gives the matrix (9, 9) of the links at angles (first, second, turn), for x, y and
    spin of each.
    """
    def rate(state, rates):
        x, y, turn, first, second = state
        return np.array([*alone(friction(first, second, turn), first, second, turn)(rates), *rates])

    state, h = np.array([0, 0, 0, amplitude, amplitude]), 2*amplitude/RATE/steps
    for signs in parts:
        rates = RATE*np.array(signs)
        for _ in range(steps):
            one = rate(state, rates)
            two = rate(state + h/2*one, rates)
            three = rate(state + h/2*two, rates)
            state = state + h/6*(one + 2*two + 2*three + rate(state + h*three, rates))
    return state[:3]


def frictionOfBlobs():
    """The friction of the three links, which are free, as the fluid has it."""
    swimmer = Swimmers(1, 0, 1, joined=False)
    rows = [6*k + i for k in range(3) for i in (0, 1, 5)]

    def friction(first, second, turn):
        swimmer.context.setPositions(pose(first, second, turn))
        return swimmer.fluid.getFrictionInContext(swimmer.context)[np.ix_(rows, rows)]

    return friction


def resistiveForces(ratio=2.0):
    """The friction of slender links that do not feel each other's flow.

    That of a piece of a link is 1 along the link and `ratio` across.
    """
    def friction(first, second, turn):
        result = np.zeros((9, 9))
        for k, angle in enumerate((turn - first, turn, turn + second)):
            t = np.array([np.cos(angle), np.sin(angle)])
            result[3*k:3*k + 2, 3*k:3*k + 2] = ratio*np.eye(2) + (1 - ratio)*np.outer(t, t)
            result[3*k + 2, 3*k + 2] = ratio*LENGTH**2/12
        return result

    return friction


def measure(strokes, swimmers, steps, quiet=True):
    """Everything that report() and picture() need; ways are in lengths of a link.

    The swimmer goes along -x, which counts as ahead.
    """
    def way(path):
        """Of the only swimmer in (frames, 1, 3, 3)."""
        return -(path - path[0])[:, 0, 1, 0]/LENGTH

    blobs = frictionOfBlobs()
    found = {'steps': [], 'ways': [], 'works': []}
    for number in (8, 16, 32):
        swimmer = Swimmers(1, 0, number)
        found['steps'].append(4*number)
        found['ways'].append(way(swimmer.swim(1))[-1])
        found['works'].append(swimmer.work)
    found['exact'] = -stroke(blobs)[0]/LENGTH
    found['slender'] = -stroke(resistiveForces(2))[0]/LENGTH
    scallop = way(Swimmers(1, 0, steps).swim(1, SCALLOP))
    found['scallop'] = {'way': scallop[-1], 'farthest': np.abs(scallop).max()}
    angles = np.radians(np.arange(10, 100, 10))
    found['amplitudes'] = {
        'degrees': np.degrees(angles),
        'ways': [way(Swimmers(1, 0, steps, amplitude=a).swim(1))[-1] for a in angles],
        'exact': [-stroke(blobs, steps=20, amplitude=a)[0]/LENGTH for a in angles],
        'slender': [-stroke(resistiveForces(2), amplitude=a)[0]/LENGTH for a in angles]
    }
    found['paths'] = {
        name: way(Swimmers(1, 0, steps).swim(strokes, parts))
        for name, parts in (('Purcell', PURCELL), ('scallop', SCALLOP))
    }
    path = Swimmers(swimmers, TEMPERATURE, steps).swim(strokes, quiet=quiet)
    after = ((path - path[0])[::FRAMES*len(PURCELL), :, 1, :2]*(-1, 1)/LENGTH)
    found['noise'] = {
        'swimmers': swimmers,
        'strokes': strokes,
        'after_each_stroke': after,
        'mean': after[-1, :, 0].mean(),
        'error': after[-1, :, 0].std(ddof=1)/np.sqrt(swimmers),
        'spread': after[-1].std(axis=0, ddof=1)
    }
    return found


def report(found):
    print('| | way of a stroke / length of a link |\n|---|---|')
    for steps, way in zip(found['steps'], found['ways']):
        print(f"| Purcell's stroke, {steps} steps | {way:.5f} |")
    print(f"| the same, exact in time, without joints | {found['exact']:.5f} |")
    print(f"| links that are slender, by resistive force theory | {found['slender']:.5f} |")
    print(f"| the scallop's stroke | {abs(found['scallop']['way']):.5f} |")
    noise = found['noise']
    way = recording.brackets(noise['mean']/noise['strokes'], noise['error']/noise['strokes'])
    print(f"| {noise['swimmers']} swimmers at {TEMPERATURE} K, mean of {noise['strokes']} strokes "
          f'| {way} |')
    print(f"work of the motors in a stroke: {found['works'][-1]:.1f} kJ/mol")
    print(f"the scallop is away by {found['scallop']['farthest']:.3f} at most")
    print('spread of the ways after {} strokes: {:.2f} ahead, {:.2f} aside'.format(
        noise['strokes'], *noise['spread']))


def picture(found, file):
    """The way without noise over time and over the amplitude, and swimmers with noise."""
    plt = recording.pyplot()
    figure, axes = plt.subplot_mosaic([[0, 1], [2, 2]], figsize=(9, 6.6), layout='constrained')
    for (name, path), parts in zip(found['paths'].items(), (PURCELL, SCALLOP)):
        axes[0].plot(np.arange(len(path))/FRAMES/len(parts), path, label=f'{name} stroke')
    axes[0].set(xlabel='strokes', ylabel='way / length of a link', title='the middle link')
    axes[0].legend()
    by = found['amplitudes']
    axes[1].plot(by['degrees'], by['slender'], color='0.6', label='slender links')
    axes[1].plot(by['degrees'], by['exact'], color='tab:blue', label='blobs, without joints')
    axes[1].plot(by['degrees'], by['ways'], 'o', color='tab:blue', label='blobs, with motors')
    axes[1].set(xlabel='amplitude / degrees', ylabel='way of a stroke / length of a link')
    axes[1].legend()
    after = np.asarray(found['noise']['after_each_stroke'])
    axes[2].plot(after[:, :, 0], after[:, :, 1], color='0.8', linewidth=0.8)
    axes[2].plot(*after[-1].T, '.', color='tab:orange', label='ends with noise')
    way = found['paths']['Purcell'][::FRAMES*len(PURCELL)]
    axes[2].plot(way, 0*way, 'o-', color='tab:blue', markersize=4, label='without noise')
    axes[2].set(xlabel='ahead / length of a link', ylabel='aside / length of a link',
                aspect='equal', title='middle links after each stroke')
    axes[2].legend(fontsize=8)
    figure.savefig(file, dpi=90)
    plt.close(figure)


def animation(steps, file, frames=64):
    """Two strokes without noise, with the path of the middle link."""
    from matplotlib.animation import FuncAnimation, PillowWriter
    plt = recording.pyplot()
    figure, axes = plt.subplots(figsize=(4.2, 2.6), layout='constrained')
    swimmer = Swimmers(1, 0, steps)
    places = []
    for signs in 2*PURCELL:
        for _ in range(FRAMES):
            swimmer.turn(signs, part=1/FRAMES)
            places.append(swimmer.sites())
    places = np.array(places)*(-1, 1, 1)/LENGTH
    count = places.shape[1] // 3
    blobs = [
        axes.add_patch(plt.Circle((0, 0), RADIUS/LENGTH, color=color))
        for color in ('tab:orange', 'tab:gray', 'tab:blue') for _ in range(count)
    ]
    way, = axes.plot([], [], 'k', linewidth=1)
    axes.set(xlim=(-1.5, 1.9), ylim=(-0.7, 1.1), aspect='equal', xlabel='ahead / length of a link')

    def draw(frame):
        now = round(frame/max(1, frames - 1)*(len(places) - 1))
        for blob, place in zip(blobs, places[now]):
            blob.center = place[:2]
        middle = places[:now + 1, count:2*count].mean(axis=1)
        way.set_data(middle[:, 0], middle[:, 1])

    FuncAnimation(figure, draw, frames).save(file, PillowWriter(fps=16), dpi=80)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--strokes', type=int, default=6, help='of each swimmer (default 6)')
    parser.add_argument('--swimmers', type=int, default=64, help='with noise (default 64)')
    parser.add_argument('--steps', type=int, default=16, help='of a part of a stroke (default 16)')
    parser.add_argument('--picture', default='picture.png',
                        help='file to draw (default picture.png)')
    parser.add_argument('--results', default='results.json', type=Path,
                        help='file for the numbers (default results.json)')
    parser.add_argument('--animation', nargs='?', const='animation.gif',
                        help='draw an animation, too (animation.gif)')
    parser.add_argument('--frames', type=int, default=64, help='of the animation (default 64)')
    arguments = parser.parse_args()
    if arguments.steps < 1 or arguments.steps % FRAMES:
        parser.error(f'--steps is {arguments.steps}; give a multiple of {FRAMES}')
    found = measure(arguments.strokes, arguments.swimmers, arguments.steps, quiet=False)
    report(found)
    picture(found, arguments.picture)
    recording.save(arguments.results.parent, arguments.results.name, {
        **found, 'run': recording.provenance(arguments)
    })
    if arguments.animation:
        animation(arguments.steps, arguments.animation, arguments.frames)


if __name__ == '__main__':
    main()
