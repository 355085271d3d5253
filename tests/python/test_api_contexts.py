"""The Python API of CustomRigidHIIntegrator in a Context: states of bodies, steps, and what is
refused."""
import gc

import numpy as np
import openmm
import pytest
from openmm import unit

import openmmrigidhi
from api_support import SITES, bound, make, makeWithBodies, plain
from scenes import dumbbells

# ---- What needs a Context ------------------------------------------------------------------------

NEEDS_CONTEXT = [('getBodyPositions', ()), ('getBodyOrientations', ()), ('getBodyVelocities', ()),
                 ('getBodyAngularVelocities', ()), ('setBodyPositions', (np.zeros((2, 3)),)),
                 ('setBodyOrientations', (np.array([(1, 0, 0, 0)]*2),)),
                 ('setBodyVelocities', (np.zeros((2, 3)),)),
                 ('setBodyAngularVelocities', (np.zeros((2, 3)),)), ('getBodyForces', ()),
                 ('getBodyTorques', ()), ('getPoseResidual', ()),
                 ('computeTranslationalKineticEnergy', ()),
                 ('computeRotationalKineticEnergies', ()), ('computeFreeParticleKineticEnergy', ()),
                 ('getDegreesOfFreedom', ()), ('computeSystemTemperature', ()),
                 ('computeMidStepTemperature', ()), ('computeMidStepTemperatures', ()),
                 ('describeEffects', ()), ('getEffects', ()), ('getStepStatistics', ()),
                 ('step', (1,))]


@pytest.mark.parametrize('method, arguments', NEEDS_CONTEXT,
                         ids=[name for name, _ in NEEDS_CONTEXT])
def test_what_needs_a_context_says_so(method, arguments, platform):
    with pytest.raises(openmm.OpenMMException, match=rf'{method}\(\) needs a Context: create one'):
        getattr(makeWithBodies(), method)(*arguments)
    integrator, context = bound(platform)
    getattr(integrator, method)(*arguments)
    del context
    gc.collect()
    message = rf'{method}\(\) needs a Context, and the Context of this integrator was deleted'
    with pytest.raises(openmm.OpenMMException, match=message):
        getattr(integrator, method)(*arguments)


def test_body_states_are_arrays_with_units(platform):
    integrator, context = bound(platform)
    for value, dimension, columns in [
        (integrator.getBodyPositions(), unit.nanometer, 3),
        (integrator.getBodyVelocities(), unit.nanometer/unit.picosecond, 3),
        (integrator.getBodyAngularVelocities(), unit.radian/unit.picosecond, 3),
        (integrator.getBodyForces(), unit.kilojoule_per_mole/unit.nanometer, 3),
        (integrator.getBodyTorques(), unit.kilojoule_per_mole, 3)
    ]:
        array = value.value_in_unit(dimension)
        assert isinstance(array,
                          np.ndarray) and array.shape == (2, columns) and array.flags.writeable
    assert integrator.getBodyOrientations().shape == (2, 4)
    assert integrator.computeTranslationalKineticEnergy().value_in_unit(
        unit.kilojoule_per_mole) == 0
    assert integrator.computeRotationalKineticEnergies().value_in_unit(
        unit.kilojoule_per_mole).shape == (3,)
    assert integrator.getPoseResidual().value_in_unit(unit.nanometer) < 1e-12


def test_body_states_come_back_as_set(platform):
    integrator, context = bound(platform)
    random = np.random.default_rng(7)
    positions, velocities = random.normal(size=(2, 2, 3))
    orientations = random.normal(size=(2, 4))
    orientations /= np.linalg.norm(orientations, axis=1)[:, None]
    integrator.setBodyPositions(positions*10*unit.angstrom)
    integrator.setBodyOrientations(orientations)
    integrator.setBodyVelocities([openmm.Vec3(*row) for row in velocities])
    assert np.allclose(plain(integrator.getBodyPositions()), positions, rtol=0, atol=1e-15)
    assert np.allclose(integrator.getBodyOrientations(), orientations, rtol=0, atol=1e-15)
    assert np.allclose(plain(integrator.getBodyVelocities()), velocities, rtol=0, atol=1e-15)
    got = context.getState(getPositions=True).getPositions(asNumpy=True)._value
    for body in range(2):
        axis = _turn(orientations[body], (0, 0, 1))
        assert np.allclose(got[2*body], positions[body] - 0.1*axis, rtol=0, atol=1e-14)
        assert np.allclose(got[2*body + 1], positions[body] + 0.1*axis, rtol=0, atol=1e-14)


def _turn(q, vector):
    """q (w, x, y, z) turns body-frame vectors into lab-frame ones: v + 2 w (u x v) + 2 u x (u x v).
    """
    w, u = q[0], q[1:]
    return np.array(vector) + 2*w*np.cross(u, vector) + 2*np.cross(u, np.cross(u, vector))


def test_angular_velocities_lose_what_has_no_inertia(platform):
    integrator, context = bound(platform)
    integrator.setBodyAngularVelocities([(1, 2, 3), (4, 5, 6)])
    got = integrator.getBodyAngularVelocities().value_in_unit(unit.radian/unit.picosecond)
    assert np.allclose(got, [(1, 2, 0), (4, 5, 0)], atol=1e-14)
    # The energy is 1/2 I w^2 with I = 0.04 about x and y. The smallest moment, about z, is zero.
    energies = plain(integrator.computeRotationalKineticEnergies())
    assert energies[0] == 0 and energies[1:].sum() == pytest.approx(0.5*0.04*
                                                                    (1 + 4 + 16 + 25), rel=1e-14)


def test_angular_velocities_are_per_time_with_or_without_radians(platform):
    integrator, context = bound(platform)
    for value in (np.ones((2, 3))/unit.picosecond, np.ones(
        (2, 3))*unit.radian/unit.picosecond, np.full(
            (2, 3), 180/np.pi)*unit.degree/unit.picosecond):
        integrator.setBodyAngularVelocities(value)
        assert plain(integrator.getBodyAngularVelocities())[0, 0] == pytest.approx(1, rel=1e-12)


@pytest.mark.parametrize('method, columns', [('setBodyPositions', 3), ('setBodyOrientations', 4),
                                             ('setBodyVelocities', 3),
                                             ('setBodyAngularVelocities', 3)])
def test_arrays_of_the_wrong_shape_are_refused_with_both_shapes(method, columns, platform):
    integrator, context = bound(platform)
    for shape in [(columns,), (1, columns), (3, columns), (2, columns + 1), (columns, 2),
                  (2, columns, 1), (0, columns)]:
        with pytest.raises(ValueError) as error:
            getattr(integrator, method)(np.ones(shape))
        assert str(shape) in str(error.value) and f'(2, {columns})' in str(error.value)
    with pytest.raises(TypeError):
        getattr(integrator, method)(np.ones((2, columns))*unit.kelvin)
    for value in (None, 'abc', 1.0, [['a']*columns]*2, [[None]*columns]*2):
        with pytest.raises((TypeError, ValueError)):
            getattr(integrator, method)(value)


def test_quaternions_are_normalised(platform):
    integrator, context = bound(platform)
    integrator.setBodyOrientations([(1, 0, 0, 0), (0, 1.0005, 0, 0)])
    assert np.allclose(integrator.getBodyOrientations()[1], (0, 1, 0, 0), rtol=0, atol=1e-15)


# ---- Stepping and Contexts -----------------------------------------------------------------------


@pytest.mark.parametrize('steps', [1.0, '1', None])
def test_a_number_of_steps_is_an_integer(steps, platform):
    integrator, context = bound(platform)
    with pytest.raises(TypeError, match='steps'):
        integrator.step(steps)


def test_steps_are_counted(platform):
    integrator, context = bound(platform)
    for steps in (0, 1, np.int64(49), 50, 51, 149):
        integrator.step(steps)
    assert context.getStepCount() == 300
    assert context.getState().getTime().value_in_unit(unit.picosecond) == pytest.approx(
        0.6, rel=1e-12)
    statistics = integrator.getStepStatistics()
    assert statistics['steps'] == 300 and isinstance(statistics['steps'], int)


def test_base_class_methods_work(platform):
    integrator, context = bound(platform)
    integrator.setIntegrationForceGroups({0, 3})
    assert integrator.getIntegrationForceGroups() == 9
    assert context.getIntegrator() is integrator
    openmm.Integrator.setStepSize(integrator, 0.001)
    assert integrator.getStepSize() == 0.001*unit.picosecond


def test_an_integrator_serves_one_context_at_a_time(platform):
    integrator, context = bound(platform)
    system, positions, _ = dumbbells(2)
    with pytest.raises(openmm.OpenMMException, match='already bound to a context'):
        openmm.Context(system, integrator, platform)
    integrator.step(1)
    del context
    gc.collect()
    context = openmm.Context(system, integrator, platform)
    context.setPositions(positions)
    integrator.step(1)


def test_an_integrator_survives_a_context_that_was_refused(platform):
    """Here the System is too small for the body's particles."""
    system, positions, definitions = dumbbells(2)
    small, _, _ = dumbbells(1)
    integrator = make()
    for definition in definitions:
        integrator.addRigidBody(*definition)
    with pytest.raises(openmm.OpenMMException, match='body 1'):
        openmm.Context(small, integrator, platform)
    with pytest.raises(openmm.OpenMMException, match='needs a Context'):
        integrator.step(1)
    context = openmm.Context(system, integrator, platform)
    context.setPositions(positions)
    integrator.step(1)


def test_a_failed_reinitialize_is_no_crash(platform):
    integrator, context = bound(platform)
    integrator.setRigidBodyParameters(1, [2, 99], 4.0, (0.04, 0.04, 0.0), SITES)
    with pytest.raises(openmm.OpenMMException, match='body 1'):
        context.reinitialize()
    with pytest.raises(openmm.OpenMMException, match='needs a Context'):
        integrator.step(1)
    context.setPositions(np.zeros((4, 3)))
    with pytest.raises(openmm.OpenMMException, match='needs a Context'):
        context.getState(getEnergy=True)
    integrator.setRigidBodyParameters(1, [2, 3], 4.0, (0.04, 0.04, 0.0), SITES)
    context.reinitialize()
    _, positions, _ = dumbbells(2)
    context.setPositions(positions)
    integrator.step(1)


def test_steps_release_the_interpreter(platform):
    """While one thread steps, another thread must be able to run."""
    import threading
    integrator, context = bound(platform)
    ticks, done = [], threading.Event()

    def tick():
        while not done.is_set():
            ticks.append(1)
            done.wait(0.001)

    thread = threading.Thread(target=tick)
    thread.start()
    openmmrigidhi._bindings.CustomRigidHIIntegrator.step(integrator, {
        'Reference': 500000,
        'CPU': 20000
    }[platform.getName()])
    during = len(ticks)
    done.set()
    thread.join()
    assert during > 3
