#!/usr/bin/python3
"""Record trajectories of many scenes, and compare two recordings bit for bit.

Use it to move code without changing what it computes: record before, and compare after every
change:

    PYTHONPATH=build/python tools/trajectories.py record before.npz
    PYTHONPATH=build/python tools/trajectories.py record after.npz
    tools/trajectories.py compare before.npz after.npz

Record both in one environment: OPENBLAS_CORETYPE, for example, changes the last bits of the scenes.

Every scheme is recorded, and every model with each of its boundaries, by the library's tables.
Scenes have water, free particles with constraints, spheres, multiblobs, lines, own tensors, walls,
lubrication, replicas, dense and matrix-free solvers, driven flows, held, driven, jointed and active
bodies, rejected steps, CustomBodyForce with velocities and time, and a barostat. They run on
Reference, on CPU with one thread, and, where OpenMM's own forces do not depend on the number of
threads, on CPU with two threads. Each trajectory is resumed from a checkpoint in its middle.
Recorded are poses and twists of all bodies, positions and velocities of all particles, and the
counters.
"""
import argparse
import os
import sys

import numpy as np

FIRST, STEPS = 1, 4  # recorded after the first step and at the end; the checkpoint is after step 2


def imports():
    global openmm, app, unit, openmmrigidhi, Integrator, MobilityForce, _models
    import openmm
    import openmmrigidhi
    from openmm import app, unit
    from openmmrigidhi import CustomRigidHIIntegrator as Integrator
    from openmmrigidhi import MobilityForce, _models


# ---- What scenes are made of ---------------------------------------------------------------------


class Scene:
    """A System, positions, and a function that makes the integrator.

    Scenes with a fluid have a MobilityForce.
    """
    def __init__(self, seed=1, temperature=300, step=0.002):
        self.system, self.positions, self.bodies, self.radii = openmm.System(), [], [], []
        self.random = np.random.default_rng(seed)
        self.temperature, self.step, self.settings, self.fluid = temperature, step, [], None
        self.joints = []  # arguments of addBallJoint()
        self.field = openmm.CustomExternalForce(
            '30*((x-x0)^2+1.3*(y-y0)^2+0.7*(z-z0)^2)+sin(3*x)*y')
        for name in ('x0', 'y0', 'z0'):
            self.field.addPerParticleParameter(name)

    def particle(self, mass, place, radius=0.0, held=True):
        index = self.system.addParticle(mass)
        self.positions.append(np.asarray(place, dtype=float))
        self.radii.append(radius)
        if held:
            self.field.addParticle(index, list(place))
        return index

    def turn(self):
        q = self.random.normal(size=4)
        w, x, y, z = q/np.linalg.norm(q)
        return np.array([(1 - 2*(y*y + z*z), 2*(x*y - w*z), 2*(x*z + w*y)),
                         (2*(x*y + w*z), 1 - 2*(x*x + z*z), 2*(y*z - w*x)),
                         (2*(x*z - w*y), 2*(y*z + w*x), 1 - 2*(x*x + y*y))])

    def body(self, sites, place, masses, radii=None, explicit=None):
        sites = np.asarray(sites, dtype=float)
        A = self.turn()
        radii = [0.0]*len(sites) if radii is None else radii
        particles = [self.particle(m, place + A @ s, r) for s, m, r in zip(sites, masses, radii)]
        self.bodies.append((particles,) if explicit is None else (particles, *explicit, sites))

    def sphere(self, place, radius, mass=20.0):
        index = self.particle(mass, place, radius)
        self.bodies.append(([index], mass, 0.4*mass*radius**2*np.array([1, 1.1, 0.9]), [(0, 0, 0)]))

    def makeFluid(self, **settings):
        self.fluid = MobilityForce()
        self.fluid.setViscosity(20)
        for radius in self.radii:
            self.fluid.addParticle(radius)
        for name, value in settings.items():
            method = name if name.startswith('add') else 'set' + name
            getattr(self.fluid, method)(*(value if isinstance(value, tuple) else (value,)))
        self.system.addForce(self.fluid)
        return self

    def boxed(self, *edges):
        """Put the scene into a periodic box, or a channel, whose walls are part of the fluid."""
        self.system.setDefaultPeriodicBoxVectors((edges[0], 0, 0), (0, edges[1], 0),
                                                 (0, 0, edges[2]))
        integrator = Integrator(self.temperature, self.step)
        for body in self.bodies:
            integrator.addRigidBody(*body)
        openmmrigidhi.app.bindBodies(self.system, integrator)
        return self

    def set(self, **settings):
        self.settings += settings.items()
        return self

    def finish(self):
        self.system.addForce(self.field)
        return self

    def integrator(self, scheme):
        integrator = Integrator(self.temperature, self.step)
        for body in self.bodies:
            integrator.addRigidBody(*body)
        integrator.setScheme(scheme)
        integrator.setRandomNumberSeed(11)
        for name, value in self.settings:
            getattr(integrator, 'set' + name)(*(value if isinstance(value, tuple) else (value,)))
        for joint in self.joints:
            integrator.addBallJoint(*joint)
        return integrator


def lattice(count, spacing, height=0.0):
    side = int(np.ceil(count**(1/3)))
    return [np.array(cell)*spacing + (0, 0, height)
            for cell in np.ndindex(side, side, side)][:count]


def water(side=2, barostat=False):
    """TIP4P-Ew with a reaction field."""
    scene = Scene()
    force = app.ForceField('tip4pew.xml')
    modeller = app.Modeller(app.Topology(), [])
    np.random.seed(1)
    modeller.addSolvent(force, model='tip4pew', numAdded=60*side)
    scene.system = force.createSystem(modeller.topology, nonbondedMethod=app.CutoffPeriodic,
                                      nonbondedCutoff=0.4)
    scene.positions = modeller.positions.value_in_unit(unit.nanometer)
    waters = {}
    for atom in modeller.topology.atoms():
        waters.setdefault(atom.residue.index, []).append(atom.index)
    scene.bodies = [(particles,) for particles in waters.values()]
    if barostat:
        pressure = openmm.MonteCarloBarostat(1, 300, 2)
        pressure.setRandomNumberSeed(3)
        scene.system.addForce(pressure)
    return scene


def mixed():
    """Implicit and explicit bodies of every rotor, and free particles, in a field.

    The free particles have a constraint and a virtual site.
    """
    scene = Scene(2)
    shapes = [[(0, 0, 0), (0.1, 0, 0), (0, 0.12, 0)], [(0, 0, 0), (0.1, 0, 0)], [(0, 0, 0)],
              [(0, 0, 0), (0.1, 0, 0), (0, 0.12, 0), (0.05, 0.02, 0.2)],
              [(-0.1, 0, 0), (0, 0, 0), (0.1, 0, 0)]]
    for i, place in enumerate(lattice(11, 1.1)):
        sites = shapes[i % 5]
        scene.body(sites, place, [10.0 + i, 3.0, 2.0, 5.0][:len(sites)])
    scene.body([(0, 0, 0), (0.1, 0, 0)], (4, 0, 0), [5, 0], explicit=(7, (2, 0.5, 1.7)))
    a = scene.particle(12, (5, 0, 0))
    b = scene.particle(1, (5.1, 0, 0))
    scene.particle(23, (5, 2, 0))
    scene.system.addConstraint(a, b, 0.1)
    c = scene.particle(0, (5.05, 0, 0), held=False)
    scene.system.setVirtualSite(c, openmm.TwoParticleAverageSite(a, b, 0.5, 0.5))
    return scene.finish()


def withBodyForce(scene):
    force = openmmrigidhi.CustomBodyForce('-3*vx + 5*sin(t)', '2*q1', '-z', '0.1*vx', '0',
                                          '-0.2*q2')
    for body in range(min(3, len(scene.bodies))):
        force.addBody(body, [])
    scene.system.addForce(force)
    return scene


def withBodyMotion(scene, *expressions):
    """Drive the first body; components without an expression are free."""
    motion = openmmrigidhi.CustomBodyMotion(*expressions)
    motion.addBody(0, [])
    scene.system.addForce(motion)
    return scene


def spheres(count=6, spacing=1.05, height=0.0, radii=(0.4, 0.5, 0.3), free=0, mass=20.0,
            jitter=0.05):
    scene = Scene(3)
    places = lattice(count + free, spacing, height)
    for i in range(count):
        scene.sphere(places[i] + jitter*scene.random.normal(size=3)*(1, 1, 0),
                     radii[i % len(radii)], mass)
    for i in range(free):
        scene.particle(mass, places[count + i], radii[i % len(radii)])
    return scene.finish()


BOOMERANG = [(0, 0, 0), (0.5, 0, 0), (1, 0, 0), (0, 0.5, 0), (0, 1, 0.1)]
ROD = [(-0.6, 0, 0), (0, 0, 0), (0.6, 0, 0)]


def multiblobs(count=3, sites=BOOMERANG, height=0.0, mass=20.0, explicit=None, radius=0.3,
               spheres=0):
    scene = Scene(4)
    places = lattice(count + spheres, 2.4, height)
    for i in range(count):
        scene.body(sites, places[i], [mass]*len(sites), [radius]*len(sites), explicit)
    for i in range(spheres):
        scene.sphere(places[count + i], 0.45, mass or 0)
    return scene.finish()


def jointed():
    """Four spheres; two of them move about a point between them."""
    spacing = 1.05
    scene = spheres(4, spacing, jitter=0, mass=0.0)
    half = (scene.positions[1] - scene.positions[0])/2
    scene.joints.append((0, half, 1, -half))
    return scene


TENSOR = np.diag([0.01, 0.012, 0.009, 0.02, 0.03, 0.025]) + 1e-3*np.ones((6, 6))

# ---- All scenes ----------------------------------------------------------------------------------


def scenes():
    """All scenes, as (name, function that makes the scene, schemes)."""
    I = Integrator
    table = list(openmmrigidhi.integrator.Scheme)
    inertial = [s for s in table if s.traits.hasMomenta and not s.traits.needsFluid]
    overdamped = [s for s in table if s.traits.isOverdamped]
    dense, free = dict(Solver=MobilityForce.Dense), dict(Solver=MobilityForce.MatrixFree,
                                                         SolverTolerance=1e-6)
    rough = dict(Solver=MobilityForce.MatrixFree, SolverTolerance=1e-3)
    wall = dict(Boundary=MobilityForce.NoSlipWall)
    best = dict(wall, SphereWallMobility=MobilityForce.BestKnown)
    sd = dict(Model=MobilityForce.StokesianDynamics)
    fd = dict(Model=MobilityForce.FreeDraining)
    yield 'water', lambda: water(1), inertial
    yield 'water-barostat', lambda: water(1, True), [I.LangevinC]
    for law in (I.ThreePoint, I.TwoPoint):
        yield f'mixed-law{int(law)}', lambda law=law: mixed().set(NoiseLaw=law), inertial
    yield 'mixed', mixed, inertial
    yield 'mixed-inertia', lambda: mixed().set(InertiaScale=3.3), inertial
    yield 'mixed-frictions', lambda: mixed().set(BodyFriction=(1, 20, 30), Friction=3,
                                                 RotationalFriction=0), [I.LangevinC]
    yield 'mixed-bodyforce', lambda: withBodyForce(mixed()), inertial
    yield 'gradient', lambda: gradientScene(), [I.GradientThermostat]
    for name, options in (('dense', dense), ('free', free), ('rough', rough),
                          ('wall', dict(wall,
                                        **dense)), ('wall-free', dict(wall,
                                                                      **free)), ('best', best),
                          ('groups', dict(Groups=([0, 1, 0, 1, 2, 0],))), ('draining', fd)):
        height = 1.0 if 'all' in name or name == 'best' else 0.0
        yield f'spheres-{name}', lambda options=options, height=height: spheres(
            6, height=height, free=2).makeFluid(**options), [I.LangevinHI]
        yield f'spheres-{name}', lambda options=options, height=height: spheres(
            6, height=height, free=2, mass=0.0).makeFluid(**options), overdamped
    yield 'stokesian', lambda: spheres(6, jitter=0.02).makeFluid(**sd), [I.LangevinHI]
    yield 'stokesian', lambda: spheres(4, jitter=0.02, mass=0.0).makeFluid(**sd), overdamped
    yield 'stokesian-rejections', lambda: spheres(8, spacing=0.85, mass=2.0, radii=(
        0.4,), jitter=0).set(Temperature=3000, StepSize=0.01, MaximumRejections=500).makeFluid(
            **sd), [I.LangevinHI]
    for name, options in (('dense', dense), ('free', free), ('rough', rough),
                          ('wall', dict(wall,
                                        **dense)), ('wall-free', dict(wall,
                                                                      **free)), ('draining', fd)):
        height = 1.8 if 'wall' in name else 0.0
        yield f'blobs-{name}', lambda options=options, height=height: multiblobs(
            3, height=height, spheres=1).makeFluid(**options), [I.LangevinHI]
        yield (f'blobs-{name}', lambda options=options, height=height: multiblobs(
            3, height=height, mass=0.0, spheres=1).makeFluid(**options), overdamped)
        yield (f'rods-{name}', lambda options=options, height=height: multiblobs(
            3, ROD, height=height, mass=0.0, explicit=(0,
                                                       (0, 0, 0))).makeFluid(**options), overdamped)
    yield 'rods', lambda: multiblobs(3, ROD, explicit=(60, (0, 14, 14))).makeFluid(**dense), [
        I.LangevinHI
    ]
    yield 'rods-free', lambda: multiblobs(3, ROD, explicit=(60, (0, 14, 14))).makeFluid(**free), [
        I.LangevinHI
    ]
    yield 'own', lambda: spheres(4).makeFluid(BodyMobility=(1, TENSOR), **dense), [I.LangevinHI
                                                                                   ] + overdamped
    yield 'own-free', lambda: spheres(4).makeFluid(BodyMobility=(1, TENSOR), **free
                                                   ), [I.LangevinHI] + overdamped
    yield 'own-draining', lambda: spheres(4).makeFluid(BodyMobility=(1, TENSOR), **fd
                                                       ), [I.LangevinHI] + overdamped
    yield ('replicas-rejections', lambda: multiblobs(6, height=0.9, mass=0.0).set(
        StepSize=0.5, Temperature=1000).makeFluid(Groups=(list(range(6)),), **wall), overdamped)
    yield 'crossing', lambda: spheres(4, height=0.5, mass=0.0).set(
        WallRejection=I.Crossing, StepSize=0.01).makeFluid(**wall), overdamped
    yield 'fluid-bodyforce', lambda: withBodyForce(spheres(6).makeFluid(**dense)), [I.LangevinHI]
    yield 'differences', lambda: multiblobs(2, height=1.8, mass=0.0).set(
        FiniteDifferenceStep=1e-3).makeFluid(**wall), overdamped
    # Fluids in boxes and channels, by lattice sums and on grids, driven and at rest.
    fc = dict(Model=MobilityForce.ForceCoupling)
    periodic = dict(Boundary=MobilityForce.Periodic)
    channel = dict(fc, Boundary=MobilityForce.SlipChannel, ChannelWalls=(-1.5, 3.5))
    grid = dict(Solver=MobilityForce.MatrixFree, SolverTolerance=1e-3)
    wave = dict(SinusoidalForceDensity=(3.0, 0, 2, 1))
    for name, options in (('rpy', dict(periodic, **dense)), ('dense', dict(
            fc, **periodic, **dense)), ('grid', dict(fc, **periodic, **grid)),
                          ('channel', dict(channel, **dense)), ('channel-grid', dict(
                              channel, **grid)), ('driven', dict(fc, **periodic, **grid, **wave)),
                          ('channel-driven', dict(channel, **dense, **wave))):
        yield (f'periodic-spheres-{name}', lambda options=options: spheres(4, radii=(0.4, 0.3)).
               boxed(4, 6, 5).makeFluid(**options), [I.LangevinHI])
        yield (f'periodic-blobs-{name}', lambda options=options: multiblobs(
            2, ROD, mass=0.0, explicit=(0,
                                        (0, 0, 0)), spheres=1).boxed(4, 6, 5).makeFluid(**options),
               overdamped)
    yield 'periodic-stokesian', lambda: spheres(4, jitter=0.02).boxed(5, 6, 5).makeFluid(
        **sd, **periodic), [I.LangevinHI]
    # Lubrication, and fluids along walls that are periodic in the plane.
    walls = {
        'wall': (dict(wall), None),
        'periodic': (dict(periodic), (4, 6, 5)),
        'periodic-wall': (dict(Boundary=MobilityForce.PeriodicWall), (4, 6, 5)),
        'fcm-wall': (dict(fc, Boundary=MobilityForce.PeriodicWall), (4, 6, 5)),
        'fcm-slit': (dict(fc, Boundary=MobilityForce.NoSlipChannel,
                          ChannelWalls=(0.0, 2.1)), (4, 6, 5)),
        'fcm-film': (dict(fc, Boundary=MobilityForce.Film, ChannelWalls=(0.0, 2.1)), (4, 6, 5))
    }
    for name, (options, edges) in walls.items():
        for solver in (dense, grid):
            for lubrication in ('Off', 'On'):

                def make(options=options, edges=edges, solver=solver, lubrication=lubrication):
                    scene = spheres(4, spacing=0.95, height=0.7, radii=(0.4, 0.3), mass=0.0)
                    if edges:
                        scene.boxed(*edges)
                    return scene.makeFluid(Lubrication=lubrication, **options, **solver)

                schemes = [I.TractionEulerMaruyama, I.TrapezoidalSlip, I.FixmanMidpoint]
                way = 'dense' if solver is dense else 'grid'
                yield f'lubrication-{lubrication}-{name}-{way}', make, schemes
    yield 'sheared', lambda: multiblobs(2, mass=0.0).makeFluid(BackgroundFlow=(
        (0.1, 0, 0), [(0, 0, 2.0), (0, 0, 0), (0, 0, 0)])), overdamped
    # Every model with each of its boundaries.
    for model in _models.MODELS:
        for boundary in model.boundaries:
            for way, solver in (('dense', dense), ('grid', grid)):
                if way == 'grid' and boundary not in model.grids:
                    continue
                options = dict(Model=model.name, Boundary=boundary, **solver)
                yield (f'{model.name}-{boundary}-spheres-{way}', lambda options=options: bounded(
                    spheres(4, radii=(0.4, 0.3), jitter=0.02), options), [I.LangevinHI])
                yield (f'{model.name}-{boundary}-spheres-{way}', lambda options=options: bounded(
                    spheres(4, radii=(0.4, 0.3), jitter=0.02, mass=0.0), options), overdamped)
                if model.takesMultiblobs:
                    yield (f'{model.name}-{boundary}-blobs-{way}', lambda options=options: bounded(
                        multiblobs(2, ROD, mass=0.0, explicit=(0, (0, 0, 0)), spheres=1), options),
                           overdamped)
    # Bodies that are held, driven, jointed or active, and driven flows of each kind.
    whole = ('0.1', '0', '-0.2*sin(t)', '0', '0.3*t', '0')
    for way, solver in (('dense', dense), ('free', free)):
        yield f'held-{way}', lambda solver=solver: multiblobs(3).set(BodyHeld=(0, True)).makeFluid(
            **solver), [I.LangevinHI]
        yield f'held-{way}', lambda solver=solver: multiblobs(3, mass=0.0).set(BodyHeld=(
            0, True)).makeFluid(**solver), overdamped
        yield f'driven-{way}', lambda solver=solver: withBodyMotion(
            multiblobs(3).makeFluid(**solver), *whole), [I.LangevinHI]
        yield f'driven-{way}', lambda solver=solver: withBodyMotion(
            multiblobs(3, mass=0.0).makeFluid(**solver), '', '', '0', '0.2', '', ''), overdamped
        yield f'jointed-{way}', lambda solver=solver: jointed().makeFluid(**solver), [
            I.FixmanMidpoint, I.RandomFiniteDifference, I.TrapezoidalSlip
        ]
        slip = np.outer(range(len(BOOMERANG)), (0.1, 0, -0.05))
        yield f'active-{way}', lambda solver=solver: multiblobs(3, mass=0.0).makeFluid(
            BodySlip=(0, slip), addBodyForceOnFluid=(1, (0, 0, 0.9), 0.3,
                                                     (2, 0, 1)), **solver), overdamped
    flows = {
        'shear': ('Periodic', dict(Shear=(0.5, 0, 2))),
        'wall-velocity': ('NoSlipChannel', dict(WallVelocity=((0.3, 0.1, 0),))),
        'force-density': ('NoSlipChannel', dict(BodyForceDensity=((2, 0, 0),))),
        'film-force-density': ('Film', dict(BodyForceDensity=((2, 0, 0),)))
    }
    for name, (boundary, flow) in flows.items():
        for way, solver in (('dense', dense), ('grid', grid)):
            yield f'flow-{name}-{way}', lambda boundary=boundary, flow=flow, solver=solver: bounded(
                multiblobs(2, ROD, mass=0.0, explicit=(0, (0, 0, 0)), spheres=1),
                dict(fc, Boundary=boundary, **flow, **solver)), overdamped
    yield 'cold', lambda: multiblobs(2, height=1.8).set(Temperature=0).makeFluid(
        **wall), [I.LangevinHI] + overdamped


def bounded(scene, options):
    """A scene with a fluid, in the box and between the walls that its boundary needs."""
    boundary = openmmrigidhi.mobility.Boundary[options['Boundary']].traits
    if boundary.isPeriodic:
        scene.boxed(4, 6, 6)
    walls = [{}, dict(WallHeight=-1.5), dict(ChannelWalls=(-1.5, 3.5))][boundary.numWalls]
    return scene.makeFluid(**walls, **options)


def gradientScene():
    scene = mixed()
    scene.system.removeConstraint(0)
    scene.step = 1e-5
    return scene


def platforms(scene):
    yield 'Reference', 'Reference', {}
    yield 'CPU-1', 'CPU', {'Threads': '1'}
    names = {type(scene.system.getForce(i)).__name__ for i in range(scene.system.getNumForces())}
    if 'NonbondedForce' not in names:
        yield 'CPU-2', 'CPU', {'Threads': '2'}


def snapshot(context, integrator):
    state = context.getState(getPositions=True, getVelocities=True)
    statistics = integrator.getStepStatistics()
    return [
        integrator.getBodyPositions()._value,
        np.asarray(integrator.getBodyOrientations()),
        integrator.getBodyVelocities()._value,
        integrator.getBodyAngularVelocities()._value,
        state.getPositions(asNumpy=True)._value,
        state.getVelocities(asNumpy=True)._value,
        np.array([float(v) for k, v in sorted(statistics.items()) if not k.startswith('seconds')] +
                 [integrator.getNumRejectedSteps()])
    ]


def run(make, scheme, platformName, properties):
    """Arrays after the first step and at the end, with a resume in the middle."""
    scene = make()
    platform = openmm.Platform.getPlatformByName(platformName)
    if scheme.traits.needsFluid or not scheme.traits.hasMomenta:
        for i in reversed(range(scene.system.getNumForces())):
            if isinstance(scene.system.getForce(i), openmm.CMMotionRemover):
                scene.system.removeForce(i)
    integrator = scene.integrator(scheme)
    context = openmm.Context(scene.system, integrator, platform, properties)
    context.setPositions(np.array(scene.positions)*unit.nanometer)
    context.setVelocitiesToTemperature(integrator.getTemperature(), 5)
    integrator.step(FIRST)
    first = snapshot(context, integrator)
    integrator.step(1)
    checkpoint = context.createCheckpoint()
    fresh = scene.integrator(scheme)
    resumed = openmm.Context(scene.system, fresh, platform, properties)
    resumed.loadCheckpoint(checkpoint)
    fresh.step(STEPS - 2)
    last = snapshot(resumed, fresh)
    last[-1][-1] += integrator.getNumRejectedSteps()
    return first + last


PARTS = [
    'positions of bodies', 'orientations', 'velocities of bodies', 'angular velocities',
    'positions', 'velocities', 'counters'
]
PARTS = [f'{part} after {when}' for when in ('the first step', 'the last step') for part in PARTS]


def record(path):
    imports()
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # warnings of the library
    arrays, rejected = {}, 0
    for name, make, schemes in scenes():
        for scheme in schemes:
            for label, platform, properties in platforms(make()):
                key = f'{name}/{openmmrigidhi.integrator.Scheme(scheme).name}/{label}'
                try:
                    result = run(make, scheme, platform, properties)
                except Exception as error:
                    print(f'{key}: {error}')
                    arrays[key + '/error'] = np.array(str(error))
                    continue
                rejected += result[-1][-1] > 0
                for part, array in zip(PARTS, result):
                    arrays[f'{key}/{part}'] = array
    np.savez_compressed(path, **arrays)
    print(f'{path}: {len({k.rsplit("/", 1)[0] for k in arrays})} trajectories, {rejected} with '
          f'rejected steps')


def compare(before, after, tolerance):
    a, b = np.load(before), np.load(after)
    different = 0
    for key in sorted(set(a.files) | set(b.files)):
        if key not in a.files or key not in b.files:
            print(f'{key}: only in {before if key in a.files else after}')
            different += 1
        elif key.endswith('/error'):
            if str(a[key]) != str(b[key]):
                print(f'{key}: "{a[key]}" became "{b[key]}"')
                different += 1
        elif a[key].shape != b[key].shape or a[key].tobytes() != b[key].tobytes():
            error = np.abs(a[key] - b[key]).max()/max(np.abs(
                a[key]).max(), 1e-300) if a[key].shape == b[key].shape else np.inf
            if not error <= tolerance:
                print(f'{key}: relative difference {error:.1e}')
                different += 1
    print(f'{different} differences in {len(a.files)} arrays')
    return different


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest='command', required=True)
    commands.add_parser('record').add_argument('file')
    two = commands.add_parser('compare')
    two.add_argument('before')
    two.add_argument('after')
    two.add_argument('--tolerance', type=float, default=0,
                     help='allowed difference over the largest number of an array; 0: same bits')
    arguments = parser.parse_args()
    if arguments.command == 'record':
        record(arguments.file)
    else:
        sys.exit(compare(arguments.before, arguments.after, arguments.tolerance) > 0)


if __name__ == '__main__':
    main()
