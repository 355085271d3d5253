#!/usr/bin/python3
"""Compare the steps of two builds of openmm-rigidhi, in turns.

    benchmarks/two_builds.py OLD/build/python NEW/build/python

Each build runs in a process of its own. A scene takes some steps in one build, then in the other,
and so on; the ratio new/old of processor times is taken turn by turn. Both builds must be of one
OpenMM. The scenes use only what the package has had since bodies in a fluid became a part of it.
"""
import argparse
import json
import os
import pathlib
import subprocess
import sys
import time

import numpy as np

SCENES = {}  # name -> (maker of an integrator and its Context, steps of a turn)


def scene(name, steps):
    """Register a maker."""
    def add(make):
        SCENES[name] = make, steps
        return make

    return add


def bodies(sites, radius, centres, scheme, platform='CPU', solver='Auto',
           model='RotnePragerYamakawa', boundary='Unbounded', box=None, walls=None, mass=0):
    """Equal bodies in a fluid of viscosity 1: (integrator, Context)."""
    import openmm

    from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, app
    system, integrator, fluid = openmm.System(), CustomRigidHIIntegrator(300, 1e-4), MobilityForce()
    integrator.setScheme(getattr(CustomRigidHIIntegrator, scheme))
    integrator.setRandomNumberSeed(1)
    fluid.setModel(getattr(MobilityForce, model))
    fluid.setBoundary(getattr(MobilityForce, boundary))
    fluid.setSolver(getattr(MobilityForce, solver))
    fluid.setViscosity(1.0)
    if box:
        system.setDefaultPeriodicBoxVectors(*np.diag(box))
    if walls:
        fluid.setChannelWalls(*walls)
    for _ in centres:
        app.addRigidMultiblob(system, integrator, fluid, sites, radius, mass, (0.4*mass,)*3)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platform))
    context.setPositions(np.concatenate([sites + centre for centre in centres]))
    return integrator, context


def spheres(count, *arguments, **settings):
    from common import spheresAtRandom
    centres = spheresAtRandom(count)
    edge = np.ceil(count**(1/3) - 1e-9)*(4*np.pi/0.3)**(1/3)
    boundary = settings.get('boundary')
    if boundary == 'Periodic':
        settings['box'] = (edge,)*3
    elif boundary == 'SlipChannel':
        centres[:, 1] -= centres[:, 1].min() - 1.1
        width = centres[:, 1].max() + 1.1
        settings.update(box=(edge, 2.2*width, edge), walls=(0, width))
    elif boundary == 'NoSlipWall':
        centres[:, 2] -= centres[:, 2].min() - 1.1
    return bodies(np.zeros((1, 3)), 1.0, centres, *arguments, **settings)


def boomerangs(count, *arguments, **settings):
    from openmmrigidhi import app
    centres = [(4*(i % 8), 4*(i // 8), 3) for i in range(count)]
    return bodies(
        app.boomerang(0.9, 2)._value, 0.5, centres, *arguments, boundary='NoSlipWall', **settings)


@scene('water, LangevinC', 50)
def water():
    import openmm
    from openmm import app

    import openmmrigidhi
    from common import waterBox
    topology, positions = waterBox(343)
    system = app.ForceField('tip4pew.xml').createSystem(topology, nonbondedMethod=app.PME,
                                                        nonbondedCutoff=0.9, rigidWater=False,
                                                        removeCMMotion=False)
    integrator = openmmrigidhi.CustomRigidHIIntegrator(300, 0.002)
    integrator.setScheme(integrator.LangevinC)
    integrator.setFriction(1.0)
    integrator.setRandomNumberSeed(1)
    openmmrigidhi.app.addRigidResidues(integrator, topology, ['HOH'])
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'))
    context.setPositions(positions)
    return integrator, context


@scene('1 boomerang above a wall, FixmanMidpoint, Reference', 20000)
def one_on_reference():
    return boomerangs(1, 'FixmanMidpoint', platform='Reference')


@scene('1 boomerang above a wall, TrapezoidalSlip', 6000)
def one():
    return boomerangs(1, 'TrapezoidalSlip')


@scene('16 boomerangs above a wall, TrapezoidalSlip, matrix-free', 300)
def boomerangs_without_matrix():
    return boomerangs(16, 'TrapezoidalSlip', solver='MatrixFree')


@scene('16 boomerangs above a wall, TrapezoidalSlip, dense', 100)
def boomerangs_with_matrix():
    return boomerangs(16, 'TrapezoidalSlip', solver='Dense')


@scene('64 spheres, RPY, TractionEulerMaruyama, dense', 150)
def traction():
    return spheres(64, 'TractionEulerMaruyama', solver='Dense')


@scene('64 spheres above a wall, RPY, RandomFiniteDifference, dense, Reference', 60)
def differences():
    return spheres(64, 'RandomFiniteDifference', platform='Reference', solver='Dense',
                   boundary='NoSlipWall')


@scene('27 spheres, RPY, LangevinHI, dense', 80)
def momenta():
    return spheres(27, 'LangevinHI', solver='Dense', mass=100.0)


@scene('16 spheres, StokesianDynamics, TractionEulerMaruyama, dense', 100)
def stokesian():
    return spheres(16, 'TractionEulerMaruyama', solver='Dense', model='StokesianDynamics')


@scene('512 spheres, RPY, EulerMaruyama, matrix-free', 20)
def pairs():
    return spheres(512, 'EulerMaruyama', solver='MatrixFree')


@scene('512 spheres, periodic RPY, EulerMaruyama, matrix-free', 15)
def waves():
    return spheres(512, 'EulerMaruyama', solver='MatrixFree', boundary='Periodic')


@scene('1000 spheres, ForceCoupling on a grid, DriftCorrectorFD', 5)
def grid():
    return spheres(1000, 'DriftCorrectorFD', solver='MatrixFree', model='ForceCoupling',
                   boundary='Periodic')


@scene('1000 spheres, ForceCoupling in a slip channel, EulerMaruyama', 5)
def channel():
    return spheres(1000, 'EulerMaruyama', solver='MatrixFree', model='ForceCoupling',
                   boundary='SlipChannel')


def work():
    """Take the steps of each scene whose name comes in; answer with processor seconds a step."""
    integrator = last = None
    for line in sys.stdin:
        make, steps = SCENES[line.strip()]
        if line != last:
            integrator, context = make()
            assert context
            integrator.step(2)
            last = line
        begin = time.process_time()
        integrator.step(steps)
        print(json.dumps((time.process_time() - begin)/steps), flush=True)


class Build:
    """A process that works with one build."""
    def __init__(self, package):
        environment = dict(os.environ, PYTHONPATH=package, OPENMM_CPU_THREADS='1')
        environment.pop('OPENBLAS_CORETYPE', None)
        self.process = subprocess.Popen([sys.executable, __file__, '--work'], text=True,
                                        env=environment, stdin=subprocess.PIPE,
                                        stdout=subprocess.PIPE)

    def time(self, name):
        self.process.stdin.write(name + '\n')
        self.process.stdin.flush()
        answer = self.process.stdout.readline()
        if not answer:
            raise SystemExit(f'the process of a build ended at the scene "{name}"')
        return json.loads(answer)


def main():
    if sys.argv[1:] == ['--work']:
        work()
        return
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('old', help='folder of the package openmmrigidhi of the one build')
    parser.add_argument('new', help='of the other')
    parser.add_argument('--names', nargs=2, default=('old', 'new'),
                        help='say which builds they are')
    parser.add_argument('--rounds', type=int, default=9)
    parser.add_argument('--output', type=pathlib.Path)
    arguments = parser.parse_args()
    sys.path.insert(0, str(pathlib.Path(arguments.new).resolve()))
    import tqdm

    from common import RESULTS, describeMachine, save, show, spread
    machine = describeMachine()
    builds = [Build(arguments.old), Build(arguments.new)]
    rows = {}
    for name in tqdm.tqdm(SCENES, desc='scenes'):
        times = [[], []]
        for turn in range(arguments.rounds + 1):
            for k in (0, 1) if turn % 2 else (1, 0):
                seconds = builds[k].time(name)
                if turn > 0:  # the first turn makes the scene
                    times[k].append(seconds)
        old, new = np.array(times)
        rows[name] = {
            'old_microseconds': round(1e6*old.min(), 2),
            'new_microseconds': round(1e6*new.min(), 2),
            'ratio_of_least': round(new.min()/old.min(), 3),
            'ratio': spread(new/old)
        }
        tqdm.tqdm.write(f'{rows[name]["ratio_of_least"]:.3f}, turn by turn '
                        f'{show(rows[name]["ratio"])}: {name}')
    save(arguments.output or RESULTS, 'two_builds.json', machine, {
        'old': arguments.names[0],
        'new': arguments.names[1],
        'rounds': arguments.rounds,
        'rows': rows
    })


if __name__ == '__main__':
    main()
