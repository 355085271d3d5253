#!/usr/bin/python3
"""Equilibria of jointed bodies: averages over steps of finite size beside exact ones.

    /usr/bin/python3 joints.py --output results

README.md in this folder says what was measured. Lengths are in nm, times in ps, and kT is 1 kJ/mol.
"""
import argparse
import pathlib
import sys
import time

import numpy as np
import openmm
from openmm import unit
from scipy import integrate

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1]/'common'))
import campaign  # noqa: E402
from recording import brackets, provenance, pyplot, save  # noqa: E402

TEMPERATURE = 1/unit.MOLAR_GAS_CONSTANT_R.value_in_unit(unit.kilojoule_per_mole/unit.kelvin)
SCHEMES = ('TrapezoidalSlip', 'FixmanMidpoint', 'RandomFiniteDifference')
UP = np.array([0.0, 0, 1])
#: The mean of cos^2 of a trumbbell of equal masses with rigid constraints, for comparison.
RIGID_CONSTRAINTS = 0.3210


class Scene:
    """Many copies of one scene in a Context. Each is in a fluid of its own.

    A scene builds its bodies by add(), its joints and its forces in build(), and says in poses()
    where its sites are in an equilibrium of its own, from random numbers.
    """
    #: Names of observables and their exact means.
    exact: dict
    #: Of the blobs; by default 6 pi eta = 1/kT.
    viscosity = 1/(6*np.pi)

    def __init__(self, copies, scheme, step, seed):
        self.copies, self.step = copies, step
        self.system, self.fluid = openmm.System(), MobilityForce()
        self.fluid.setViscosity(self.viscosity)
        self.integrator = CustomRigidHIIntegrator(TEMPERATURE, step)
        self.integrator.setScheme(scheme)
        self.integrator.setRandomNumberSeed(seed)
        self.forces = {}
        for _ in range(copies):
            self.build()
        bodies = self.integrator.getNumRigidBodies()
        self.fluid.setGroups(np.repeat(np.arange(copies), bodies // copies))
        self.system.addForce(self.fluid)
        self.context = openmm.Context(self.system, self.integrator,
                                      openmm.Platform.getPlatformByName('Reference'))
        self.context.setPositions(self.poses(np.random.default_rng(seed)).reshape(-1, 3))

    def add(self, sites, radii):
        """Add a body without mass, about the origin of its frame; returns its index."""
        first = self.system.getNumParticles()
        for radius in np.broadcast_to(radii, len(sites)):
            self.system.addParticle(0)
            self.fluid.addParticle(radius)
        return self.integrator.addRigidBody(range(first, first + len(sites)), 0, (0, 0, 0), sites)

    def force(self, name, make):
        """The force of this name, which is made when it is needed first."""
        if name not in self.forces:
            self.forces[name] = make()
            self.system.addForce(self.forces[name])
        return self.forces[name]

    def positions(self):
        """Of all sites, (copies, sites, 3)."""
        x = self.context.getState(getPositions=True).getPositions(asNumpy=True)._value
        return np.asarray(x).reshape(self.copies, -1, 3)


def turns(random, count):
    """Uniform rotation matrices (count, 3, 3)."""
    q = random.normal(size=(count, 4))
    w, x, y, z = (q/np.linalg.norm(q, axis=1, keepdims=True)).T
    return np.array([[1 - 2*(y*y + z*z), 2*(x*y - w*z), 2*(x*z + w*y)],
                     [2*(x*y + w*z), 1 - 2*(x*x + z*z), 2*(y*z - w*x)],
                     [2*(x*z - w*y), 2*(y*z + w*x), 1 - 2*(x*x + y*y)]]).transpose(2, 0, 1)


def directions(random, weight, count, largest):
    """Cosines with the density weight(c) <= largest on (-1, 1), by rejection."""
    found = np.empty(0)
    while len(found) < count:
        c = random.uniform(-1, 1, 4*count)
        found = np.append(found, c[random.uniform(0, largest, len(c)) < weight(c)])
    return found[:count]


def average(observable, weight, low=-1, high=1):
    """The mean of an observable of a number with a density that needs no normalisation."""
    total = integrate.quad(weight, low, high, epsabs=1e-13)[0]
    return integrate.quad(lambda c: observable(c)*weight(c), low, high, epsabs=1e-13)[0]/total


class Trumbbell(Scene):
    """Three spheres in a row, with links of length 1 between their centres. D = kT/(6 pi eta a)."""
    exact = {'cos^2': 1/3}
    settle, every = 0.5, 0.05

    def build(self):
        beads = [self.add([(0, 0, 0)], self.radius) for _ in range(3)]
        for end in (0, 2):
            self.integrator.addLink(beads[end], (0, 0, 0), beads[1], (0, 0, 0), 1)

    def poses(self, random):
        ends = random.normal(size=(2, self.copies, 3))
        ends /= np.linalg.norm(ends, axis=-1, keepdims=True)
        return np.stack([ends[0], np.zeros((self.copies, 3)), ends[1]], axis=1)

    def observe(self, x):
        cosine = ((x[:, 0] - x[:, 1])*(x[:, 2] - x[:, 1])).sum(-1)
        return {'cos^2': cosine**2}


class LooseTrumbbell(Trumbbell):
    """With spheres so small that the fluid hardly couples them."""
    radius = 0.01
    viscosity = 1/(6*np.pi*radius)


class CoupledTrumbbell(Trumbbell):
    """With spheres of 0.4 of the link."""
    radius = 0.4
    viscosity = 1/(6*np.pi*radius)


class Ring(Scene):
    """Two bodies like an L, hinged where their long arms meet; the angle of the hinge is free."""
    exact = {'cos': 0.0, 'sin': 0.0, 'cos 2': 0.0, 'sin 2': 0.0}
    settle, every = 1.5, 0.1
    first = np.array([(0.8, 0, 0), (1.6, 0, 0), (1.6, 0, 0.9)])
    second = np.array([(0.7, 0, -0.4), (1.5, 0, -0.4), (1.5, 0.9, -0.4)])

    def build(self):
        i, j = (self.add(sites - sites[0], 0.3) for sites in (self.first, self.second))
        self.integrator.addHinge(i, -self.first[0], j, -self.second[0], UP, UP)

    def poses(self, random):
        # The angle is that of the second body; the whole is turned at random.
        angle = random.uniform(0, 2*np.pi, self.copies)
        c, s, o, e = np.cos(angle), np.sin(angle), np.zeros(self.copies), np.ones(self.copies)
        spin = np.array([[c, -s, o], [s, c, o], [o, o, e]]).transpose(2, 0, 1)
        sites = np.concatenate([
            np.broadcast_to(self.first, (self.copies, 3, 3)),
            np.einsum('nij,kj->nki', spin, self.second)
        ], axis=1)
        return np.einsum('nij,nkj->nki', turns(random, self.copies), sites)

    def observe(self, x):
        arm, other = x[:, 1] - x[:, 0], x[:, 4] - x[:, 3]
        axis = x[:, 2] - x[:, 1]
        axis /= np.linalg.norm(axis, axis=1, keepdims=True)
        angle = np.arctan2((np.cross(arm, other)*axis).sum(-1), (arm*other).sum(-1))
        return {
            'cos': np.cos(angle),
            'sin': np.sin(angle),
            'cos 2': np.cos(2*angle),
            'sin 2': np.sin(2*angle)
        }


class Tied(Scene):
    """A triangle of blobs that hangs by a ball from the top of a held sphere, in a uniform field.

    The joint is at (0, 0, 1), and the centre of the triangle is 1.2 from it. U = -2 kT cos. Between
    the centre of the triangle and a point of space acts nothing; r is its distance from the centre
    of the sphere.
    """
    strength, arm, joint = 2.0, 1.2, UP
    exact = {
        'cos': 1/np.tanh(2.0) - 1/2.0,
        'r': average(lambda c: np.sqrt(1 + 1.2**2 + 2*1.2*c), lambda c: np.exp(2.0*c))
    }
    settle, every = 3.0, 0.2
    sites = np.array([(0.7, 0, 0), (-0.35, 0.606217782649107, 0), (-0.35, -0.606217782649107, 0)])

    def build(self):
        sphere, body = self.add([(0, 0, 0)], 0.6), self.add(self.sites, 0.35)
        self.integrator.setBodyHeld(sphere, True)
        self.integrator.addBallJoint(body, -self.arm*UP, sphere, self.joint)
        field = self.force('field',
                           lambda: openmm.CustomExternalForce(f'{-self.strength/3/self.arm}*z'))
        for k in range(1, 4):
            field.addParticle(self.system.getNumParticles() - k, [])

    def poses(self, random):
        cosines = directions(random, lambda c: np.exp(self.strength*(c - 1)), self.copies, 1)
        azimuths, spins = random.uniform(0, 2*np.pi, (2, self.copies))
        sines = np.sqrt(1 - cosines**2)
        axis = np.array([sines*np.cos(azimuths), sines*np.sin(azimuths), cosines])
        one = np.array([cosines*np.cos(azimuths), cosines*np.sin(azimuths), -sines])
        two = np.cross(axis, one, axis=0)
        first = np.cos(spins)*one + np.sin(spins)*two
        frames = np.array([first, np.cross(axis, first, axis=0), axis]).transpose(2, 1, 0)
        sites = np.einsum('nij,kj->nki', frames, self.sites + self.arm*UP) + self.joint
        return np.concatenate([np.zeros((self.copies, 1, 3)), sites], axis=1)

    def observe(self, x):
        centre = x[:, 1:].mean(axis=1)
        return {
            'cos': (centre - self.joint)[:, 2]/self.arm,
            'r': np.linalg.norm(centre - x[:, 0], axis=1)
        }


class Linked(Scene):
    """A sphere off its anchor, at a link of length 2 from the centre of a held sphere.

    The anchor is 0.8 from the centre of the free sphere, and U = 10 kT (r - 2)^2 in the distance r
    of the centres. cos is that of the link and of the arm from the centre to the anchor.
    """
    length, arm = 2.0, 0.8

    @staticmethod
    def distance(c):
        return np.sqrt(2.0**2 + 0.8**2 - 2*2.0*0.8*c)

    @classmethod
    def weight(cls, c):
        return np.exp(-10*(cls.distance(c) - 2)**2)

    settle, every = 3.0, 0.2

    def build(self):
        sphere, other = self.add([(0, 0, 0)], 0.6), self.add([(0, 0, 0), self.arm*UP], (0.8, 0))
        self.integrator.setBodyHeld(sphere, True)
        self.integrator.addLink(other, self.arm*UP, sphere, (0, 0, 0), self.length)
        bond = self.force('bond', lambda: openmm.CustomBondForce('10*(r - 2)^2'))
        count = self.system.getNumParticles()
        bond.addBond(count - 3, count - 2, [])

    def poses(self, random):
        cosines = directions(random, self.weight, self.copies, 1)
        azimuths = random.uniform(0, 2*np.pi, self.copies)
        sines = np.sqrt(1 - cosines**2)
        anchors = np.broadcast_to(self.length*UP, (self.copies, 3))
        arms = np.array([sines*np.cos(azimuths), sines*np.sin(azimuths), cosines]).T
        sites = np.stack([np.zeros((self.copies, 3)), anchors - self.arm*arms, anchors], axis=1)
        return np.einsum('nij,nkj->nki', turns(random, self.copies), sites)

    def observe(self, x):
        link, arm = x[:, 2] - x[:, 0], x[:, 2] - x[:, 1]
        return {
            'cos': (link*arm).sum(-1)/self.length/self.arm,
            'r': np.linalg.norm(x[:, 1] - x[:, 0], axis=1)
        }


Linked.exact = {
    'cos': average(lambda c: c, Linked.weight),
    'r': average(Linked.distance, Linked.weight)
}


class Pair(Scene):
    """Two triangles of blobs joined by a ball, with U = 3 kT cos(angle of their arms).

    The centres of the triangles are 1.5 and 2.2 from the joint, so that no two blobs can be at one
    place.
    """
    exact = {'cos': -(1/np.tanh(3.0) - 1/3.0), 'cos^2': 1 - 2/3.0*(1/np.tanh(3.0) - 1/3.0)}
    settle, every = 4.0, 0.2
    sites = Tied.sites
    arms = (1.5, 2.2)

    def build(self):
        bodies = []
        for arm in self.arms:
            # The joint is a site that the fluid does not see.
            sites = np.concatenate([self.sites, [-arm*UP]])
            bodies.append((self.add(sites, (0.4, 0.4, 0.4, 0)), sites))
            bodies[-1] += (self.system.getNumParticles() - 4,)
        (i, sites_i, first_i), (j, sites_j, first_j) = bodies
        self.integrator.addBallJoint(i, sites_i[3], j, sites_j[3])
        arms = ','.join(f'({a}1+{a}2+{a}3)/3-{a}4' for a in 'xyz').split(',')
        others = ','.join(f'({a}5+{a}6+{a}7)/3-{a}4' for a in 'xyz').split(',')
        energy = '+'.join(f'({a})*({b})' for a, b in zip(arms, others))
        bond = self.force(
            'bond',
            lambda: openmm.CustomCompoundBondForce(7, f'3*({energy})/{self.arms[0]*self.arms[1]}'))
        bond.addBond(
            [first_i, first_i + 1, first_i + 2, first_i + 3, first_j, first_j + 1, first_j + 2], [])

    def poses(self, random):
        cosines = directions(random, lambda c: np.exp(-3*(c + 1)), self.copies, 1)
        sines = np.sqrt(1 - cosines**2)
        o, e = np.zeros(self.copies), np.ones(self.copies)
        tilt = np.array([[cosines, o, sines], [o, e, o], [-sines, o, cosines]]).transpose(2, 0, 1)
        whole, joint = turns(random, self.copies), []
        for arm, turn in zip(self.arms, (whole, whole @ tilt)):
            spins = random.uniform(0, 2*np.pi, self.copies)
            c, s = np.cos(spins), np.sin(spins)
            spin = np.array([[c, -s, o], [s, c, o], [o, o, e]]).transpose(2, 0, 1)
            sites = np.concatenate([self.sites + arm*UP, [(0, 0, 0)]])
            joint.append(np.einsum('nij,kj->nki', turn @ spin, sites))
        return np.concatenate(joint, axis=1)

    def observe(self, x):
        one, two = (x[:, k:k + 3].mean(axis=1) - x[:, k + 3] for k in (0, 4))
        cosine = (one*two).sum(-1)/self.arms[0]/self.arms[1]
        return {'cos': cosine, 'cos^2': cosine**2}


SCENES = {
    scene.__name__: scene
    for scene in (LooseTrumbbell, CoupledTrumbbell, Ring, Tied, Linked, Pair)
}
#: Scene, step, and time of each copy after it has settled. The seed of a run follows from its place
#: here, so that new ones go to the end.
RUNS = [('LooseTrumbbell', 0.009, 26), ('LooseTrumbbell', 0.004, 18), ('LooseTrumbbell', 0.002, 11),
        ('CoupledTrumbbell', 0.009, 26), ('CoupledTrumbbell', 0.004, 18),
        ('CoupledTrumbbell', 0.002, 11), ('Ring', 0.01, 50), ('Tied', 0.02, 60), ('Tied', 0.01, 30),
        ('Linked', 0.02, 60), ('Linked', 0.01, 30), ('Pair', 0.02, 70), ('Pair', 0.01, 35),
        ('Ring', 0.005, 50), ('Ring', 0.0025, 30), ('Tied', 0.005, 30), ('Linked', 0.005, 30),
        ('Pair', 0.005, 35), ('Pair', 0.0025, 25)]


def simulate(argument, job):
    """The averages of every copy of a scene, over all times and copies."""
    name, scheme, step, copies, duration, seed = argument
    scene = SCENES[name](copies, scheme, step, seed)
    every, start = max(1, round(scene.every/step)), time.process_time()
    settling = round(scene.settle/step/every)
    frames = max(1, round(duration/step/every))
    sums = {key: np.zeros(copies) for key in scene.exact}
    for frame in range(-settling, frames):
        scene.integrator.step(every)
        # Copies begin in the exact equilibrium, and have now settled into that of these steps.
        if frame >= 0:
            for key, values in scene.observe(scene.positions()).items():
                sums[key] += values
        job.report((frame + settling + 1)*every*copies)
    means = {key: total/frames for key, total in sums.items()}
    return {
        'scene': name,
        'scheme': scheme,
        'step': step,
        'copies': copies,
        'seed': seed,
        'steps_of_each_copy': (settling + frames)*every,
        'settling_steps': settling*every,
        'steps_between_frames': every,
        'processor_seconds': time.process_time() - start,
        'rejected_steps': scene.integrator.getNumRejectedSteps(),
        'mean': {key: value.mean()
                 for key, value in means.items()},
        'error': {key: value.std(ddof=1)/np.sqrt(copies)
                  for key, value in means.items()},
        'exact': scene.exact
    }


def table(runs):
    """Lines of Markdown: averages of all schemes, with one standard error in brackets."""
    yield f'| scene | average | exact | step | {" | ".join(SCHEMES)} |'
    yield '|---|---|---|---|' + len(SCHEMES)*'---|'
    for name, scene in SCENES.items():
        for key, exact in scene.exact.items():
            for step in sorted({run['step'] for run in runs if run['scene'] == name}, reverse=True):
                own = {
                    run['scheme']: run
                    for run in runs if (run['scene'], run['step']) == (name, step)
                }
                found = ' | '.join(
                    brackets(own[scheme]['mean'][key], own[scheme]['error'][key]) if scheme in
                    own else '' for scheme in SCHEMES)
                yield f'| {name} | {key} | {exact:.4f} | {step:g} | {found} |'


#: What the picture shows of each scene.
SHOWN = {
    'LooseTrumbbell': 'cos^2',
    'CoupledTrumbbell': 'cos^2',
    'Ring': 'cos',
    'Tied': 'cos',
    'Linked': 'r',
    'Pair': 'cos'
}


def draw(runs, file):
    """Averages over the step, beside exact ones."""
    plt = pyplot()
    figure, axes = plt.subplots(2, 3, figsize=(11, 6.4), layout='constrained')
    for ax, (name, key) in zip(axes.flat, SHOWN.items()):
        for k, scheme in enumerate(SCHEMES):
            own = [run for run in runs if (run['scene'], run['scheme']) == (name, scheme)]
            if own:
                ax.errorbar([run['step']*(1 + 0.03*(k - 1)) for run in own],
                            [run['mean'][key] for run in own], [run['error'][key] for run in own],
                            fmt='os^'[k], capsize=3, markersize=4, label=scheme)
        ax.axhline(SCENES[name].exact[key], color='k', linewidth=0.8, label='exact')
        if issubclass(SCENES[name], Trumbbell):
            ax.axhline(RIGID_CONSTRAINTS, color='0.6', linestyle='--',
                       label='rigid constraints with masses')
        ax.set(title=name, ylabel=f'mean of {key}', xlabel='step', xlim=(0, None))
    axes[0, 0].legend(fontsize=7)
    figure.savefig(file, dpi=90)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--output', type=pathlib.Path, default=pathlib.Path('joints_output'),
                        help='folder for results')
    parser.add_argument('--scenes', nargs='+', choices=SCENES, default=list(SCENES))
    parser.add_argument('--schemes', nargs='+', choices=SCHEMES, default=list(SCHEMES))
    parser.add_argument('--copies', type=int, default=256)
    parser.add_argument('--length', type=float, default=1, help='of the runs, of the default one')
    parser.add_argument('--seed', type=int, default=31)
    campaign.addOptions(parser)
    arguments = campaign.settle(parser.parse_args())
    todo = [(name, scheme, step, arguments.copies, duration*arguments.length, arguments.seed + k)
            for k, (name, step, duration, scheme) in enumerate(
                (*run, scheme) for run in RUNS for scheme in SCHEMES)
            if name in arguments.scenes and scheme in arguments.schemes]
    amounts = [(duration + SCENES[name].settle)/step*copies
               for name, _, step, copies, duration, _ in todo]
    runs = campaign.run(simulate, todo,
                        [f'{name} {scheme} {step}' for name, scheme, step, *_ in todo], arguments,
                        amounts, 'step', 'joints')
    for name in arguments.scenes:
        save(
            arguments.output, f'{name}.json', {
                'provenance': provenance(arguments),
                'runs': sorted(
                    (run for run in runs if run['scene'] == name), key=lambda run: -run['step'])
            })
    runs.sort(key=lambda run: (list(SCENES).index(run['scene']), -run['step']))
    draw(runs, arguments.output/'joints.png')
    print('\n'.join(table(runs)))
    worst = max(
        abs(run['mean'][key] - exact)/run['error'][key] for run in runs
        for key, exact in run['exact'].items())
    print(f'largest difference: {worst:.1f} standard errors')


if __name__ == '__main__':
    main()
