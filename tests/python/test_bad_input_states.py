"""Bad positions, velocities and body states, and forces that blow up during a run."""
import re

import numpy as np
import openmm
import pytest

import openmmrigidhi
from openmmrigidhi import _bindings

Integrator = openmmrigidhi.CustomRigidHIIntegrator
SHAPE = np.array([(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0)])


def refused(*pieces, error=openmm.OpenMMException):
    return pytest.raises(error, match='.*'.join(re.escape(piece) for piece in pieces))


class Scene:
    """Two triangles and a free particle; any particle can be given a bad force."""
    def __init__(self, platform, masses=(1,)*7):
        self.system = openmm.System()
        for mass in masses:
            self.system.addParticle(mass)
        self.force = openmm.CustomExternalForce('0.5*(x^2+y^2+z^2) + bad*(x+y+z)')
        self.force.addPerParticleParameter('bad')
        for particle in range(7):
            self.force.addParticle(particle, [0])
        self.system.addForce(self.force)
        self.integrator = Integrator(300, 0.001)
        self.integrator.addRigidBody([0, 1, 2])
        self.integrator.addRigidBody([3, 4, 5])
        self.context = openmm.Context(self.system, self.integrator, platform)
        self.positions = np.concatenate([SHAPE, SHAPE + 1, [(2, 2, 2)]])

    def start(self):
        self.context.setPositions(self.positions)
        self.context.setVelocitiesToTemperature(300, 1)
        self.integrator.step(1)
        return self

    def poison(self, particle, strength):
        self.force.setParticleParameters(particle, particle, [strength])
        self.force.updateParametersInContext(self.context)

    def heal(self):
        for particle in range(7):
            self.poison(particle, 0)

    def everything(self):
        state = self.context.getState(getPositions=True, getVelocities=True)
        return [
            state.getPositions(asNumpy=True)._value,
            state.getVelocities(asNumpy=True)._value,
            self.integrator.getBodyPositions()._value,
            self.integrator.getBodyOrientations(),
            self.integrator.getBodyVelocities()._value,
            self.integrator.getBodyAngularVelocities()._value,
            state.getTime()._value
        ]


@pytest.fixture
def scene(platform):
    return Scene(platform)


# ---- Positions and velocities --------------------------------------------------------------------

#: Entries that users may spoil: rows, columns, and what the error names. NumPy's NaN in all numbers
#: of a body was once the mark of positions that were not set yet.
SPOILT = {
    'one number': (4, 1, 'body 1: particle 4'),
    'one particle': (4, slice(3), 'body 1: particle 4'),
    'one body': (slice(3, 6), slice(3), 'body 1: particle 3'),
    'all bodies': (slice(6), slice(3), 'body 0: particle 0'),
    'all particles': (slice(8), slice(3), 'body 0: particle 0'),
    'a body of one site': (7, slice(3), 'body 2: particle 7'),
    'a free particle': (6, slice(3), 'particle 6, which is in no body,'),
    'a free massless particle': (8, slice(3), 'particle 8, which is in no body,'),
}


@pytest.mark.parametrize('quantity', ['position', 'velocity'])
@pytest.mark.parametrize('started', [False, True])
@pytest.mark.parametrize('scheme', [Integrator.LangevinC, Integrator.GradientThermostat])
def test_numbers_that_are_not_finite(platform, scheme, started, quantity):
    """Nothing moves, and the run goes on with finite numbers. Velocities are refused in schemes
    without momenta too, since these keep them for schemes that follow."""
    system, integrator = openmm.System(), Integrator(0, 0.001)
    integrator.setScheme(scheme)
    for mass in (1,)*8 + (0,):
        system.addParticle(mass)
    integrator.addRigidBody([0, 1, 2])
    integrator.addRigidBody([3, 4, 5])
    integrator.addRigidBody([7], 1, (1, 1, 1), [(0, 0, 0)])
    context = openmm.Context(system, integrator, platform)
    positions = np.concatenate([SHAPE, SHAPE + 1, [(2, 2, 2), (3, 3, 3), (4, 4, 4)]])
    good, setter = {
        'position': (positions, context.setPositions),
        'velocity': (np.zeros((9, 3)), context.setVelocities)
    }[quantity]
    centres = [positions[:3].mean(0), positions[3:6].mean(0), positions[7]]
    for rows, columns, named in SPOILT.values():
        for value in np.nan, np.inf, -np.inf:
            context.reinitialize()
            context.setPositions(positions)
            if started:
                integrator.step(2)
            bad = good.copy()
            bad[rows, columns] = value
            setter(bad)
            for call in (integrator.getBodyPositions, lambda: integrator.step(1),
                         lambda: integrator.step(3)):
                with refused(f'{named} has the {quantity} (',
                             'which is not finite; give all particles of the Context finite'):
                    call()
            setter(good)
            assert np.allclose(integrator.getBodyPositions()._value, centres)
            integrator.step(1)
            assert np.allclose(integrator.getBodyPositions()._value, centres)


@pytest.mark.parametrize('value', [np.nan, np.inf])
@pytest.mark.parametrize('barostat', [False, True])
def test_a_box_that_is_not_finite(scene, platform, value, barostat):
    """A barostat would scale positions with the box before the step looks at it."""
    if barostat:
        bonds = openmm.HarmonicBondForce()
        bonds.setUsesPeriodicBoundaryConditions(True)
        scene.system.addForce(bonds)
        scene.system.addForce(openmm.MonteCarloBarostat(1, 300, 1))
    openmmrigidhi.app.bindBodies(scene.system, scene.integrator)
    scene.context.reinitialize()
    scene.start()
    before = scene.everything()
    box = np.diag([5., 5., 5.])
    box[1, 1] = value
    scene.context.setPeriodicBoxVectors(*box)
    with refused("the Context's box vector b is (0, ", 'which is not finite; set finite vectors'):
        scene.integrator.step(1)
    box[1, 1] = 5
    scene.context.setPeriodicBoxVectors(*box)
    for a, b in zip(before, scene.everything()):
        assert np.array_equal(a, b), 'the last good state was not kept'
    scene.integrator.step(1)


def test_a_default_box_that_is_not_finite(platform):
    system, integrator = openmm.System(), Integrator(300, 0.001)
    integrator.addRigidBody([system.addParticle(1)])
    system.setDefaultPeriodicBoxVectors((np.nan, 0, 0), (0, 1, 0), (0, 0, 1))
    with refused("the Context's box vector a is (nan, 0, 0) nm", 'setDefaultPeriodicBoxVectors()'):
        openmm.Context(system, integrator, platform)


def test_a_time_that_is_not_finite(scene):
    scene.start()
    scene.context.setTime(np.nan)
    with refused("the Context's time is nan ps, which is not finite; set a finite time"):
        scene.integrator.step(1)
    scene.context.setTime(1)
    scene.integrator.step(1)


@pytest.mark.parametrize('value', [np.nan, np.inf])
def test_a_parameter_that_is_not_finite(scene, value):
    """step() would make a finite force of NaN."""
    force = openmmrigidhi.CustomBodyForce('step(k)', '0', '0', '0', '0', '0')
    force.addGlobalParameter('k', 1)
    force.addBody(0, [])
    scene.system.addForce(force)
    scene.context.reinitialize()
    scene.start()
    before = scene.everything()
    scene.context.setParameter('k', value)
    with refused(f"the Context's parameter 'k' of force 1 is {value}; set a finite value"):
        scene.integrator.step(2)
    scene.context.setParameter('k', 1)
    for a, b in zip(before, scene.everything()):
        assert np.array_equal(a, b), 'the last good state was not kept'
    scene.integrator.step(1)


@pytest.mark.parametrize('quantity', ['Position', 'Velocity'])
@pytest.mark.parametrize('parameters', [False, True])
def test_a_state_that_is_not_finite(scene, quantity, parameters):
    scene.start()
    state = scene.context.getState(getPositions=True, getVelocities=True,
                                   getIntegratorParameters=parameters)
    text = openmm.XmlSerializer.serialize(state)
    rows = text.split(f'<{quantity} ')
    assert len(rows) == 8
    rows[4:7] = [
        re.sub(r'^([xyz])="[^"]*" ([xyz])="[^"]*" ([xyz])="[^"]*"', r'\1="nan" \2="nan" \3="nan"',
               row) for row in rows[4:7]
    ]
    bad = openmm.XmlSerializer.deserialize(f'<{quantity} '.join(rows))
    scene.context.setState(bad)
    with refused(f'body 1: particle 3 has the {quantity.lower()} (nan, nan, nan)'):
        scene.integrator.step(1)
    scene.context.setState(state)
    scene.integrator.step(1)


@pytest.mark.parametrize('temperature', [-1, np.nan])
def test_velocities_of_a_bad_temperature(scene, temperature):
    scene.start()
    with refused('setVelocitiesToTemperature()', 'temperature is', 'finite and not negative'):
        scene.context.setVelocitiesToTemperature(temperature)


# ---- Body states ---------------------------------------------------------------------------------


@pytest.mark.parametrize('setter, columns', [('setBodyPositions', 3), ('setBodyOrientations', 4),
                                             ('setBodyVelocities', 3),
                                             ('setBodyAngularVelocities', 3)])
def test_rows_of_body_states(scene, setter, columns):
    scene.start()
    rows = np.tile(np.eye(columns)[0], (2, 1))
    with refused(setter, 'got an array of shape (3,', f'the shape must be (2, {columns})',
                 error=ValueError):
        getattr(scene.integrator, setter)(np.tile(rows[0], (3, 1)))
    with refused(setter, 'got 3 rows', 'each of the 2 bodies needs one row'):
        getattr(_bindings.CustomRigidHIIntegrator, setter)(scene.integrator,
                                                           np.tile(rows[0], (3, 1)))
    rows[1, 0] = np.nan
    before = scene.everything()
    with refused('body 1'):
        getattr(scene.integrator, setter)(rows)
    for a, b in zip(before, scene.everything()):
        assert np.array_equal(a, b), 'a refused call changed the state'


# ---- During a run --------------------------------------------------------------------------------


@pytest.mark.parametrize('strength', [np.nan, np.inf])
def test_a_force_that_blows_up_on_a_body(scene, strength):
    scene.start()
    before = scene.everything()
    scene.poison(5, strength)
    with refused('step 2: body 1 (first particle 3) has a non-finite force, torque or momentum',
                 'the Context keeps the state before this step'):
        scene.integrator.step(1)
    scene.heal()
    for a, b in zip(before, scene.everything()):
        assert np.array_equal(a, b), 'the last good state was not kept'
    scene.integrator.step(5)


def test_a_force_that_blows_up_within_a_step(scene):
    """The forces at the start of the step are finite, but those at its end are not."""
    scene.start()
    before = scene.everything()
    scene.integrator.setStepSize(1e200)
    with refused('step 2: body 0 (first particle 0) has a non-finite'):
        scene.integrator.step(1)
    scene.integrator.setStepSize(0.001)
    for a, b in zip(before, scene.everything()):
        assert np.array_equal(a, b), 'the last good state was not kept'
    scene.integrator.step(5)


def test_a_force_too_large_to_add_up():
    """Every component is finite, but their sum is not. Forces on the CPU platform have too few bits
    for such numbers."""
    system = openmm.System()
    system.addParticle(1)
    force = openmm.CustomExternalForce('1e308*(x+y+z)')
    force.addParticle(0, [])
    system.addForce(force)
    integrator = Integrator(0, 0.001)
    integrator.addRigidBody([0], 1, (1, 1, 1), [(0, 0, 0)])
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions([(0, 0, 0)])
    with refused('step 1: a non-finite force was found', 'take a smaller step'):
        integrator.step(1)


# ---- Temperatures --------------------------------------------------------------------------------


def test_a_temperature_without_momenta(scene):
    scene.start().integrator.setScheme(Integrator.GradientThermostat)
    for method in ('computeSystemTemperature', 'computeMidStepTemperature',
                   'computeMidStepTemperatures'):
        with refused(f'{method}(): the scheme has no momenta', 'a temperature needs momenta'):
            getattr(scene.integrator, method)()


def test_a_temperature_of_nothing(platform):
    system = openmm.System()
    system.addParticle(0)
    integrator = Integrator(300, 0.001)
    context = openmm.Context(system, integrator, platform)
    context.setPositions([(0, 0, 0)])
    for method in ('computeSystemTemperature', 'computeMidStepTemperature',
                   'computeMidStepTemperatures'):
        with refused(f'{method}(): the Context has 0 degrees of freedom',
                     'a temperature needs at least one'):
            getattr(integrator, method)()


def test_a_mid_step_temperature_without_positions(platform):
    system = openmm.System()
    system.addParticle(1)
    integrator = Integrator(300, 0.001)
    integrator.addRigidBody([0], 1, (1, 1, 1), [(0, 0, 0)])
    _context = openmm.Context(system, integrator, platform)
    with refused('computeMidStepTemperature() needs positions', 'call setPositions()'):
        integrator.computeMidStepTemperature()


def test_bodies_that_were_added_later_wait_for_the_next_context(scene):
    """Arrays from the Context have a row for each of its bodies, and can be set again."""
    integrator, context = scene.start().integrator, scene.context
    integrator.addRigidBody([6], 1, (1, 1, 1), [(0, 0, 0)])
    assert integrator.getNumRigidBodies() == 3 and integrator.getNumRigidBodiesOfContext() == 2
    for name in ('BodyPositions', 'BodyOrientations', 'BodyVelocities', 'BodyAngularVelocities'):
        values = getattr(integrator, 'get' + name)()
        getattr(integrator, 'set' + name)(values)
        rows = np.concatenate([np.asarray(getattr(values, '_value', values))]*2)[:3]
        with refused('set' + name, 'got 3 rows; the Context has 2 of the integrator', '3 bodies',
                     'because the others were added later', 'or reinitialize the Context',
                     error=ValueError):
            getattr(integrator, 'set' + name)(rows)
    openmmrigidhi.app.minimize(context, maxIterations=1)
    context.reinitialize(preserveState=False)
    assert integrator.getNumRigidBodiesOfContext() == 3
