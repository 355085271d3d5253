"""Particles of bodies, particles that should be in bodies, and parameters that do not fit the
System are named once, when the first step begins, and only where something is wrong."""
import itertools

import numpy as np
import openmm
import pytest
from openmm import unit

import openmmrigidhi
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, app

MASSES, CHARGES = (15.9994, 12.0108, 15.9994), (-0.35, 0.7, -0.35)
LINE = np.array([(-0.116, 0, 0), (0, 0, 0), (0.116, 0, 0)])
MOMENT = 2*15.9994*0.116**2
EDGE = 2.6


class Molecules:
    """Rigid CO2 on a lattice: (system, integrator, positions)."""
    def __init__(self, bodies=8, excluded=True, explicit=None, step=0.002):
        self.system, self.integrator = openmm.System(), CustomRigidHIIntegrator(300, step)
        self.integrator.setRandomNumberSeed(1)
        self.system.setDefaultPeriodicBoxVectors(*EDGE*np.eye(3))
        self.force = openmm.NonbondedForce()
        self.force.setNonbondedMethod(openmm.NonbondedForce.PME)
        self.force.setCutoffDistance(1.2)
        positions = []
        for m, place in enumerate(itertools.product((0.3, 1.6), repeat=3)):
            particles = [self.system.addParticle(mass) for mass in MASSES]
            for charge, sigma, epsilon in zip(CHARGES, (0.305, 0.28, 0.305), (0.66, 0.22, 0.66)):
                self.force.addParticle(charge, sigma, epsilon)
            if excluded:
                for one, other in itertools.combinations(particles, 2):
                    self.force.addException(one, other, 0, 1, 0)
            if m < bodies:
                self.integrator.addRigidBody(particles, *(explicit or ()))
            positions.append(np.array(place) + LINE)
        self.positions = np.concatenate(positions)
        self.system.addForce(self.force)
        app.bindBodies(self.system, self.integrator)

    def start(self, platform='CPU', temperature=300):
        """The Context, after a step."""
        if isinstance(platform, str):
            platform = openmm.Platform.getPlatformByName(platform)
        context = openmm.Context(self.system, self.integrator, platform)
        context.setPositions(self.positions)
        context.setVelocitiesToTemperature(temperature, 1)
        self.integrator.step(1)
        self.context = context
        return context

    def warnings(self):
        return self.integrator.getEffects()['warnings']


def assertWarned(scene, text, capfd):
    """A warning with this text, in the effects and printed once."""
    printed = capfd.readouterr().err
    assert printed.count('Warning: ') == 1 and text in printed and text in scene.warnings()
    scene.integrator.step(10)
    assert capfd.readouterr().err == ''


@pytest.mark.parametrize('explicit', [None, (44.0096, (0, MOMENT, MOMENT), LINE)])
def test_right_molecules_have_no_warnings(platform, explicit, capfd):
    scene = Molecules(explicit=explicit)
    scene.start(platform)
    assert scene.warnings() == 'off: none' and capfd.readouterr().err == ''


def test_wrapped_molecules(platform, capfd):
    scene = Molecules()
    whole = scene.positions
    scene.positions = np.mod(whole - (0.35, 0, 0), EDGE)
    scene.start(platform)
    assertWarned(scene, 'as do those of 3 other bodies', capfd)
    mended = Molecules()
    mended.positions = app.makeWhole(mended.integrator, scene.positions, EDGE*np.eye(3))
    mended.start(platform)
    assert mended.warnings() == 'off: none' and capfd.readouterr().err == ''


def test_a_rod_of_almost_the_box_is_in_one_part(capfd):
    system, integrator = openmm.System(), CustomRigidHIIntegrator(300, 0.002)
    system.setDefaultPeriodicBoxVectors(*EDGE*np.eye(3))
    integrator.addRigidBody([system.addParticle(10) for _ in range(12)])
    app.bindBodies(system, integrator)
    system.getForce(0).setUsesPeriodicBoundaryConditions(True)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions([(0.2*k, 0, 0) for k in range(12)])
    integrator.step(1)
    assert integrator.getEffects()['warnings'] == 'off: none' and capfd.readouterr().err == ''


def test_forces_within_bodies(capfd):
    """In double precision their energies are a constant."""
    scene = Molecules(excluded=False)
    scene.start('CPU')
    assertWarned(scene, 'acts between particles of one body, such as ', capfd)
    # Charges alone, as in a protein, have small energies.
    weak = Molecules(excluded=False)
    for particle, charge in zip(range(weak.system.getNumParticles()), itertools.cycle(CHARGES)):
        weak.force.setParticleParameters(particle, charge, 0.305, 0)
    weak.start('CPU')
    assert weak.warnings() == 'off: none'
    exact = Molecules(excluded=False)
    exact.start('Reference')
    assert exact.warnings() == 'off: none'


def test_exclude_within_bodies(capfd):
    scene, reference = Molecules(excluded=False), Molecules()
    pairs = openmm.CustomNonbondedForce('1/r')
    for _ in range(scene.system.getNumParticles()):
        pairs.addParticle()
    pairs.addExclusion(0, 1)
    scene.force.addException(1, 0, 0, 1, 0)
    scene.system.addForce(pairs)
    assert app.excludeWithinBodies(scene.system, scene.integrator) == 8*3 - 1
    assert pairs.getNumExclusions() == scene.force.getNumExceptions() == 8*3
    assert app.excludeWithinBodies(scene.system, scene.integrator) == 0
    scene.system.removeForce(scene.system.getNumForces() - 1)
    energies = [
        each.start('Reference').getState(getEnergy=True).getPotentialEnergy()._value
        for each in (scene, reference)
    ]
    assert energies[0] == pytest.approx(energies[1], rel=1e-9)
    assert capfd.readouterr().err == ''


@pytest.mark.parametrize('held', ['nothing', 'bonds', 'constraints', 'unknown'])
def test_a_molecule_that_was_left_out(held, capfd):
    scene = Molecules(bodies=7)
    last = scene.system.getNumParticles() - 3
    for one, other in ((last, last + 1), (last + 1, last + 2)):
        if held == 'bonds':
            scene.system.getForce(1).addBond(one, other, 0.116, 1e5)
        elif held == 'constraints':
            scene.system.addConstraint(one, other, 0.116)
    if held == 'unknown':  # which may hold them
        bonds = openmm.CustomCompoundBondForce(2, 'distance(p1, p2)^2')
        bonds.addBond([last, last + 1])
        scene.system.addForce(bonds)
    scene.start()
    if held == 'nothing':
        assertWarned(scene, 'but they are in no body', capfd)
    else:
        assert scene.warnings() == 'off: none' and capfd.readouterr().err == ''


@pytest.mark.parametrize(
    'explicit, text',
    [((0.0440096, (0, MOMENT, MOMENT), LINE), 'has a mass of 0.0440096 dalton'),
     ((44.0096, (0, 100*MOMENT, 100*MOMENT), LINE), 'has a moment of inertia of'),
     ((44.0096, (MOMENT, MOMENT, 0), LINE), 'has a moment of inertia of 0 dalton nm^2 about z'),
     ((44.0096, (0, MOMENT, MOMENT), LINE + (0.116, 0, 0)), 'from the origin of the sites'),
     ((44.0096, (0, 8*MOMENT, 8*MOMENT), LINE), None), ((80.0, (1.0, 1.0, 1.0), LINE), None),])
def test_inertia_against_masses(explicit, text, capfd):
    scene = Molecules(explicit=explicit)
    scene.start('Reference', temperature=0)  # contradictory bodies would fly away
    printed = capfd.readouterr().err
    if text is None:
        assert printed == '' and scene.warnings() == 'off: none'
    else:
        assert text in printed and text in scene.warnings()


@pytest.mark.parametrize('step, warns', [(0.002, False), (2.0, True)])
def test_steps_in_femtoseconds(step, warns, capfd):
    """Free rotation of linear molecules is exact, but their torques need a step that they see."""
    scene = Molecules(step=step)
    scene.start('Reference', temperature=0)
    assert ('rad at thermal speeds' in capfd.readouterr().err) == warns


@pytest.mark.parametrize('per', ['particle', 'global', 'bond', 'pair'])
@pytest.mark.parametrize('isRight', [False, True])
def test_newtons_in_forces_of_openmm(per, isRight, capfd):
    weight = 0.25e-15*unit.newton*(unit.AVOGADRO_CONSTANT_NA if isRight else 1)
    system, integrator = openmm.System(), CustomRigidHIIntegrator(300, 0.002)
    for _ in range(2):
        integrator.addRigidBody([system.addParticle(10)], 10, (1, 1, 1), [(0, 0, 0)])
    if per in ('particle', 'global'):
        force = openmm.CustomExternalForce('w*z')
        if per == 'global':
            force.addGlobalParameter('w', weight)
        else:
            force.addPerParticleParameter('w')
        for particle in range(2):
            force.addParticle(particle, [weight] if per == 'particle' else [])
    elif per == 'bond':
        force = openmm.CustomBondForce('w*r')
        force.addPerBondParameter('w')
        force.addBond(0, 1, [weight])
    else:
        force = openmm.CustomNonbondedForce('w1*w2*r')
        force.addPerParticleParameter('w')
        for _ in range(2):
            force.addParticle([weight])
    system.addForce(force)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions([(0, 0, 0), (1, 0, 0)])
    integrator.step(1)
    assert ('the parameter w of force 0' in capfd.readouterr().err) == (not isRight)


def _collective():
    force = openmm.CustomCVForce('w*d')
    distance = openmm.CustomBondForce('r')
    distance.addBond(0, 1, [])
    force.addCollectiveVariable('d', distance)
    return force


@pytest.mark.parametrize(
    'make, add, parameter',
    [(lambda: openmm.CustomAngleForce('w*theta'), lambda f, w: f.addAngle(0, 1, 2, w), 'PerAngle'),
     (lambda: openmm.CustomTorsionForce('w*theta'), lambda f, w: f.addTorsion(0, 1, 2, 3, w),
      'PerTorsion'),
     (lambda: openmm.CustomCompoundBondForce(2, 'w*distance(p1, p2)'),
      lambda f, w: f.addBond([0, 1], w), 'PerBond'),
     (lambda: openmm.CustomCentroidBondForce(2, 'w*distance(g1, g2)'), lambda f, w:
      (f.addGroup([0]), f.addGroup([1]), f.addBond([0, 1], w)), 'PerBond'),
     (_collective, lambda f, w: None, None),])
@pytest.mark.parametrize('isGlobal', [False, True])
@pytest.mark.parametrize('isRight', [False, True])
def test_joules_in_other_forces_of_openmm(make, add, parameter, isGlobal, isRight, capfd):
    if not isGlobal and parameter is None:
        pytest.skip('a CustomCVForce has global parameters only')
    energy = 2e-20*unit.joule*(unit.AVOGADRO_CONSTANT_NA if isRight else 1)
    system, integrator = openmm.System(), CustomRigidHIIntegrator(300, 0.002)
    for _ in range(4):
        integrator.addRigidBody([system.addParticle(10)], 10, (1, 1, 1), [(0, 0, 0)])
    force = make()
    if isGlobal:
        force.addGlobalParameter('w', energy)
    else:
        getattr(force, f'add{parameter}Parameter')('w')
    add(force, [] if isGlobal else [energy])
    system.addForce(force)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1)])
    integrator.step(1)
    assert ('the parameter w ' in capfd.readouterr().err) == (not isRight)


def test_a_body_force_without_bodies(capfd):
    scene = Molecules()
    pull = openmmrigidhi.CustomBodyForce('0', '0', '-1', '0', '0', '0')
    scene.system.addForce(pull)
    scene.start('Reference')
    assertWarned(scene, 'a CustomBodyForce, acts on no body', capfd)


def test_an_exploded_run_ends(platform):
    """Of overlapping particles, long before numbers overflow."""
    scene = Molecules(step=0.04)
    scene.positions[3:6] = scene.positions[:3] + (0, 0, 0.05)
    context = openmm.Context(scene.system, scene.integrator, platform)
    context.setPositions(scene.positions)
    with pytest.raises(openmm.OpenMMException, match='the run has exploded|has a non-finite force'):
        scene.integrator.step(1000)
    assert context.getState().getStepCount() <= 100


@pytest.mark.parametrize('scheme', ['quench', 'hot', 'sediment'])
def test_hot_and_driven_bodies_do_not_explode(scheme, capfd):
    """Energies far above those of the bath are right after a quench, at the start, and of colloids
    that sink."""
    if scheme == 'sediment':
        system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(
            300, 1)
        integrator.setScheme('LangevinHI')
        radius = 5e4
        mass = 4/3*np.pi*radius**3*1204.4  # 2 g/cm^3
        integrator.addRigidBody([system.addParticle(0)], mass, [0.4*mass*radius**2]*3, [(0, 0, 0)])
        fluid.addParticle(radius)
        weight = openmmrigidhi.CustomBodyForce('0', '0', '-w', '0', '0', '0')
        weight.addGlobalParameter('w', mass/2*9.81e-15)
        weight.addBody(0, [])
        system.addForce(fluid)
        system.addForce(weight)
        relaxation = mass/(6*np.pi*fluid.getViscosity()._value*radius)
        integrator.setStepSize(0.1*relaxation)
        context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
        context.setPositions([(0, 0, 0)])
        integrator.step(200)
        velocity = integrator.getBodyVelocities()[0, 2]._value
        assert velocity == pytest.approx(-9.81e-15/2*relaxation, rel=0.01)
        assert mass*velocity**2 > 1e6*2.5
    else:
        molecules = Molecules(step=1e-4)
        molecules.start('Reference')
        if scheme == 'hot':
            molecules.context.setVelocitiesToTemperature(1e5, 1)
        else:
            molecules.integrator.setTemperature(1e-4)
        molecules.integrator.step(300)
    assert 'exploded' not in capfd.readouterr().err


def test_a_leap_of_one_step(capfd):
    """A repulsion that throws overlapping spheres apart in the first step has no second one."""
    system, fluid = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(300, 10)
    integrator.setScheme('TrapezoidalSlip')
    repulsion = openmm.CustomNonbondedForce('10*exp(-(r-2)/0.05)')
    for _ in range(2):
        app.addRigidMultiblob(system, integrator, fluid, [(0, 0, 0)], 1.0)
        repulsion.addParticle([])
    fluid.setViscosity(536)
    system.addForce(fluid)
    system.addForce(repulsion)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions([(0, 0, 0), (0, 1.5, 0)])
    integrator.step(50)
    assert 'relative to the others' in capfd.readouterr().err


def test_dummy_masses_are_no_contradiction(capfd):
    system, integrator = openmm.System(), CustomRigidHIIntegrator(300, 0.002)
    integrator.addRigidBody([system.addParticle(1) for _ in range(6)], 5000, (300, 300, 300),
                            np.vstack([np.eye(3), -np.eye(3)])*0.4)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions(np.vstack([np.eye(3), -np.eye(3)])*0.4)
    integrator.step(1)
    assert integrator.getEffects()['warnings'] == 'off: none' and capfd.readouterr().err == ''


def test_tracers_that_exclude_each_other(capfd):
    """They act on nothing, and nothing has to hold them together."""
    system, integrator = openmm.System(), CustomRigidHIIntegrator(300, 0.002)
    force = openmm.NonbondedForce()
    for _ in range(4):
        system.addParticle(10)
        force.addParticle(0, 1, 0)
    for one, other in itertools.combinations(range(4), 2):
        force.addException(one, other, 0, 1, 0)
    system.addForce(force)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions([(0.3*k, 0, 0) for k in range(4)])
    integrator.step(1)
    assert integrator.getEffects()['warnings'] == 'off: none' and capfd.readouterr().err == ''


def test_forces_that_were_added_too_late():
    """OpenMM ignores them, and so do the checks."""
    scene = Molecules()
    scene.start('Reference')
    late = openmm.CustomExternalForce('k*z')
    late.addGlobalParameter('k', 1)
    scene.system.addForce(late)
    scene.system.addForce(openmm.NonbondedForce())
    scene.integrator.step(2)
    assert scene.warnings() == 'off: none'


def test_bodies_that_are_set_elsewhere_do_not_leap(capfd):
    system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(300, 0.01)
    integrator.setScheme('EulerMaruyama')
    for _ in range(3):
        app.addRigidMultiblob(system, integrator, fluid, [(0, 0, 0)], 1.0)
    fluid.setViscosity(536)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions([(0, 0, 0), (5, 0, 0), (10, 0, 0)])
    for k in range(10):
        integrator.step(5)
        positions = integrator.getBodyPositions()._value
        positions[0, 1] += 30
        integrator.setBodyPositions(positions)
    assert capfd.readouterr().err == ''


def test_driven_over_bumps(capfd):
    """Forces that change because a force drives a colloid over bumps are not stiff."""
    radius, h = 5e3, 1e6
    system, fluid = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(300, h)
    integrator.setScheme('EulerMaruyama')
    app.addRigidMultiblob(system, integrator, fluid, [(0, 0, 0)], radius)
    mobility = 1/(6*np.pi*fluid.getViscosity()._value*radius)
    bumps = openmm.CustomExternalForce('amplitude*cos(k*x)*cos(k*y) - pull*x')
    wave = 2*np.pi/(4*radius)
    # mu K h = 0.05 at most, and 0.05 radii a step.
    bumps.addGlobalParameter('amplitude', 0.05/(mobility*h*wave**2))
    bumps.addGlobalParameter('k', wave)
    bumps.addGlobalParameter('pull', 0.05*radius/(mobility*h))
    bumps.addParticle(0, [])
    system.addForce(fluid)
    system.addForce(bumps)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions([(0, 0.3*radius, 0)])
    integrator.step(3000)
    assert 'relaxes in the forces' not in integrator.getEffects()['warnings']
