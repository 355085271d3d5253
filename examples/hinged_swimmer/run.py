#!/usr/bin/env python3
"""Purcell's swimmer: three links, two hinges with motors, and a stroke that is not reciprocal.

    python3 run.py                     # about a minute; draws picture.png
"""
import argparse

import numpy as np
import openmm

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, app

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
PART = 2*AMPLITUDE/RATE
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
    """
    def __init__(self, number, temperature, steps, seed=1, joined=True):
        system, self.fluid = openmm.System(), MobilityForce()
        fluid = self.fluid
        fluid.setViscosity(602)  # water, dalton/(nm ps)
        self.steps = steps
        self.integrator = integrator = CustomRigidHIIntegrator(temperature, PART/steps)
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
        self.context.setPositions(np.concatenate(number*[pose(AMPLITUDE, AMPLITUDE)]))
        self.work = 0.0  # of all motors, kJ/mol

    def centres(self):
        return np.array(self.integrator.getBodyPositions()._value).reshape(-1, 3, 3)

    def sites(self):
        return self.context.getState(getPositions=True).getPositions(asNumpy=True)._value

    def turn(self, signs, part=1.0):
        """One part of a stroke, or this much of it."""
        rates = RATE*np.tile(signs, len(self.motors) // 2)
        for motor, rate in zip(self.motors, rates):
            self.integrator.setHingeMotorRate(motor, rate)
        for _ in range(round(part*self.steps)):
            self.integrator.step(1)
            torques = self.integrator.getHingeMotorTorques()._value
            self.work += torques @ rates*PART/self.steps

    def swim(self, strokes, parts=PURCELL):
        """The centres of the links (frames, swimmers, 3, 3) before and after frames of strokes."""
        path = [self.centres()]
        for _ in range(strokes):
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


def stroke(friction, parts=PURCELL, steps=50):
    """Where the middle link is after a stroke, (x, y, angle), without joints: RK4 in time.

    `friction` gives the matrix (9, 9) of the links at angles (first, second, turn), for x, y and
    spin of each.
    """
    def rate(state, rates):
        x, y, turn, first, second = state
        return np.array([*alone(friction(first, second, turn), first, second, turn)(rates), *rates])

    state, h = np.array([0, 0, 0, AMPLITUDE, AMPLITUDE]), PART/steps
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


def picture(plt, quiet, noisy, file):
    """The middle link's way without noise, and swimmers with noise after each stroke."""
    figure, axes = plt.subplots(1, 2, figsize=(10, 4), layout='constrained')
    for (name, path), parts in zip(quiet.items(), (PURCELL, SCALLOP)):
        axes[0].plot(
            np.arange(len(path))/FRAMES/len(parts), -path[:, 1, 0]/LENGTH, label=f'{name} stroke')
    axes[0].set(xlabel='strokes', ylabel='way of the middle link / length of a link')
    axes[0].legend()
    after = ((noisy[:, :, 1] - noisy[0, :, 1])[::FRAMES*len(PURCELL), :, :2]/LENGTH)
    axes[1].plot(after[:, :, 0], after[:, :, 1], color='0.8', linewidth=0.8)
    axes[1].plot(*after[-1].T, '.', color='tab:orange', label='ends with noise')
    path = quiet['Purcell'][:, 1, :2]/LENGTH
    axes[1].plot(*path[::FRAMES*len(PURCELL)].T, 'o-', color='tab:blue', markersize=4,
                 label='after each stroke, without noise')
    axes[1].set(xlabel='x / length of a link', ylabel='y / length of a link', aspect='equal',
                title='middle links after each stroke')
    axes[1].legend(fontsize=8)
    figure.savefig(file, dpi=110)


def animate(plt, swimmer, strokes, file):
    """Frames of the swimmer without noise, with the path of its middle."""
    from matplotlib.animation import FuncAnimation, PillowWriter
    figure, axes = plt.subplots(figsize=(4.2, 2.6), layout='constrained')
    places = []
    for _ in range(strokes):
        for signs in PURCELL:
            for _ in range(FRAMES):
                swimmer.turn(signs, part=1/FRAMES)
                places.append(swimmer.sites())
    places = np.array(places)/LENGTH
    count = places.shape[1] // 3
    blobs = [[plt.Circle((0, 0), RADIUS/LENGTH, color=color) for _ in range(count)]
             for color in ('tab:blue', 'tab:gray', 'tab:orange')]
    for blob in sum(blobs, []):
        axes.add_patch(blob)
    way, = axes.plot([], [], 'k', linewidth=1)
    axes.set(xlim=(-1.9, 1.6), ylim=(-0.9, 1.2), aspect='equal', xlabel='x / length of a link')

    def draw(frame):
        for blob, place in zip(sum(blobs, []), places[frame]):
            blob.center = place[:2]
        middle = places[:frame + 1, count:2*count].mean(axis=1)
        way.set_data(middle[:, 0], middle[:, 1])

    FuncAnimation(figure, draw, len(places)).save(file, PillowWriter(fps=20), dpi=70)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--strokes', type=int, default=6, help='of each swimmer (default 6)')
    parser.add_argument('--swimmers', type=int, default=32, help='with noise (default 32)')
    parser.add_argument('--steps', type=int, default=40, help='of a part of a stroke (default 40)')
    parser.add_argument('--picture', default='picture.png',
                        help='file to draw (default picture.png)')
    parser.add_argument('--animation', default='',
                        help='file of the animation, such as swimmer.gif (default: none)')
    arguments = parser.parse_args()
    if arguments.steps < 1 or arguments.steps % FRAMES:
        parser.error(f'--steps is {arguments.steps}; give a multiple of {FRAMES}')
    import matplotlib
    matplotlib.use('Agg')
    import matplotlib.pyplot as plt
    quiet = {}
    for name, parts in (('Purcell', PURCELL), ('scallop', SCALLOP)):
        swimmer = Swimmers(1, 0, arguments.steps)
        quiet[name] = swimmer.swim(arguments.strokes, parts)[:, 0]
        way = (quiet[name][-1] - quiet[name][0])[1]/arguments.strokes/LENGTH
        print(f'{name} stroke: {way.round(6)} links a stroke, with the work '
              f'{swimmer.work/arguments.strokes:.1f} kJ/mol')
    for name, friction in (('without joints, exact in time',
                            frictionOfBlobs()), ('resistive forces, ratio 2', resistiveForces(2)),
                           ('resistive forces, ratio 1', resistiveForces(1))):
        print(f'{name}: {(stroke(friction)[:2]/LENGTH).round(6)} links a stroke')
    noisy = Swimmers(arguments.swimmers, TEMPERATURE, arguments.steps).swim(arguments.strokes)
    ways = (noisy[-1] - noisy[0])[:, 1, :2]/LENGTH
    error = ways.std(axis=0, ddof=1)/np.sqrt(len(ways))
    print(f'with noise, {len(ways)} swimmers after {arguments.strokes} strokes: '
          f'{ways.mean(axis=0).round(3)} links, errors {error.round(3)}')
    picture(plt, quiet, noisy, arguments.picture)
    if arguments.animation:
        animate(plt, Swimmers(1, 0, arguments.steps), 2, arguments.animation)


if __name__ == '__main__':
    main()
