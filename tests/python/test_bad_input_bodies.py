"""Bad arguments of the integrator are refused where they are given. Messages name the object, the
value, the bound and the remedy.

tests/platform/TestBadInput*.cpp have the messages of C++. Here are those that Python adds, and
errors of each kind of call (setters, getters, calls that need a Context), which show that
exceptions of C++ arrive.
"""
import re

import numpy as np
import openmm
import pytest
from openmm import unit

import openmmrigidhi
from openmmrigidhi import _bindings

Integrator = openmmrigidhi.CustomRigidHIIntegrator
SITES = [(0, 0, 0), (0.1, 0, 0)]


@pytest.fixture
def integrator():
    integrator = Integrator(300, 0.001)
    integrator.addRigidBody([0, 1, 2])
    return integrator


def refused(*pieces, error=openmm.OpenMMException):
    """Expect an error whose message has all the pieces, in this order."""
    return pytest.raises(error, match='.*'.join(re.escape(piece) for piece in pieces))


# ---- Particles -----------------------------------------------------------------------------------


def test_a_body_index_out_of_range(integrator):
    for index in (1, -1):
        with refused('getRigidBodyParticles()', f'body index {index} is out of range',
                     'the integrator has 1 bodies, counted from 0'):
            integrator.getRigidBodyParticles(index)


# ---- Mass, moments, sites ------------------------------------------------------------------------

# ---- Settings ------------------------------------------------------------------------------------


@pytest.mark.parametrize('setter', ['setTemperature', 'setFriction', 'setRotationalFriction'])
def test_a_negative_or_non_finite_setting(integrator, setter):
    with refused(setter, 'it must be finite and not negative'):
        getattr(integrator, setter)(-1e-9)


@pytest.mark.parametrize('setter', [
    'setStepSize', 'setPoseTolerance', 'setConstraintTolerance', 'setInertiaScale',
    'setGradientRelaxationTime', 'setGradientRotationalRelaxationTime'
])
def test_a_setting_that_must_be_positive(integrator, setter):
    with refused(setter, 'it must be finite and positive'):
        getattr(integrator, setter)(0)


@pytest.mark.parametrize('groups', ['x', -1.0, 1.5, None, [0, 1], {'a'}, {1.5}])
def test_force_groups_that_are_no_groups(integrator, groups):
    what = ('it must be an integer' if isinstance(groups, set) else
            'it must be a set of groups from 0 to 31, such as {0, 1}, or an integer with a bit')
    with refused('setIntegrationForceGroups: groups: got', what, error=TypeError):
        integrator.setIntegrationForceGroups(groups)


def test_force_groups_that_are_out_of_range(integrator):
    for group in (-1, 32, 40):
        with refused(
                f'setIntegrationForceGroups: groups: got the group {group}; a group must be '
                'from 0 to 31', error=ValueError):
            integrator.setIntegrationForceGroups({0, group})
    for mask in (2**32, -2**31 - 1, 2**40):
        with refused(f'groups: got the bit mask {mask}; a bit mask must be from -2^31 to 2^32-1',
                     'give a set of groups from 0 to 31', error=ValueError):
            integrator.setIntegrationForceGroups(mask)
    assert integrator.getIntegrationForceGroups() == -1
    for groups, mask in (({0, 31}, -2**31 + 1), (set(), 0), (-1, -1), (2**32 - 1, -1),
                         (np.int64(6), 6), (frozenset([2]), 4)):
        integrator.setIntegrationForceGroups(groups)
        assert integrator.getIntegrationForceGroups() == mask


@pytest.mark.parametrize('number', [-1, 65536, 2**31 - 1])
def test_more_rejections_than_have_random_numbers(integrator, number):
    with refused('setMaximumRejections()', f'the number is {number}',
                 'it must be from 0 to 65535, since no further attempts', 'a smaller step'):
        integrator.setMaximumRejections(number)
    assert integrator.getMaximumRejections() == 100
    integrator.setMaximumRejections(65535)
    assert integrator.getMaximumRejections() == 65535


@pytest.mark.parametrize('number', [-1, 1025, -2**31])
def test_more_threads_than_machines_have(integrator, number):
    with refused('setNumHostThreads()', f'the number is {number}', 'it must be from 0 to 1024',
                 '0 for OpenMM'):
        integrator.setNumHostThreads(number)
    assert integrator.getNumHostThreads() == 0
    integrator.setNumHostThreads(1024)
    assert integrator.getNumHostThreads() == 1024


def test_unknown_constants(integrator):
    with refused('setScheme()', 'scheme 17 is unknown', 'it must be one of LangevinA'):
        integrator.setScheme(17)
    with refused('setNoiseLaw()', 'noise law -1 is unknown', 'it must be one of Gaussian'):
        integrator.setNoiseLaw(-1)
    with refused('setScheme', 'it must be a Scheme', 'use one of', error=TypeError):
        integrator.setScheme(Integrator.Gaussian)


# ---- Types, dimensions and shapes ----------------------------------------------------------------


def test_quantities_of_the_wrong_dimension(integrator):
    with refused('setTemperature: temperature: got a quantity in nanometer',
                 'convert it or give a number in kelvin', error=TypeError):
        integrator.setTemperature(5*unit.nanometer)
    with refused('got a quantity in', 'convert it or give', error=TypeError):
        integrator.addRigidBody([3, 4], 1*unit.dalton, (1, 1, 1)*unit.nanometer, SITES)


def test_what_is_no_number(integrator):
    with refused('setFriction: gamma', "'high'", 'it must be a number', 'give one in 1/ps',
                 error=TypeError):
        integrator.setFriction('high')


def test_what_is_no_integer(integrator):
    with refused('setRandomNumberSeed: seed: got 1.5', 'it must be an integer: convert it',
                 error=TypeError):
        integrator.setRandomNumberSeed(1.5)
    with refused('it must be from -2^31 to 2^31-1', error=ValueError):
        integrator.setRandomNumberSeed(2**31)


def test_what_is_no_list_of_particles(integrator):
    with refused('addRigidBody: particles: got 3', 'give a list of particle indices',
                 error=TypeError):
        integrator.addRigidBody(3)


def test_only_some_of_an_explicit_body(integrator):
    with refused('addRigidBody: only some of mass, principalMoments and sitePositions are given',
                 error=TypeError):
        integrator.addRigidBody([3, 4], mass=1)


def test_arrays_of_the_wrong_shape(integrator):
    with refused('principalMoments: got an array of shape (2,)', 'the shape must be (3,)',
                 error=ValueError):
        integrator.addRigidBody([3, 4], 1, (1, 1), SITES)
    with refused('sitePositions: got an array of shape (2, 2)', 'give one row per item',
                 error=ValueError):
        integrator.addRigidBody([3, 4], 1, (1, 1, 1), [(0, 0), (1, 1)])
    with refused('sitePositions: the rows have different lengths', 'they must form an array',
                 error=ValueError):
        integrator.addRigidBody([3, 4], 1, (1, 1, 1), [(0, 0, 0), (1, 1)])
    with refused('its elements must be numbers', 'give numbers in nm', error=TypeError):
        integrator.addRigidBody([3, 4], 1, (1, 1, 1), [('a', 'b', 'c'), ('d', 'e', 'f')])


def test_bindings_check_their_buffers(integrator):
    """Errors of the SWIG layer itself, which users do not meet."""
    Base = _bindings.CustomRigidHIIntegrator
    one = np.array([3], dtype=np.intc)
    with refused('openmmrigidhi: expected an object with a C-contiguous buffer', error=TypeError):
        Base.setBodyPositions(integrator, [1, 2, 3])
    with refused('openmmrigidhi: expected a buffer of format', 'with rows of 3 numbers',
                 error=TypeError):
        Base.setBodyPositions(integrator, np.zeros((1, 3), dtype='f4'))
    with refused('openmmrigidhi: expected a buffer of 3 numbers', error=TypeError):
        Base.addRigidBody(integrator, one, 1.0, np.zeros(6), np.zeros((1, 3)))
    with refused('openmmrigidhi: in method', 'argument 1 is None', error=TypeError):
        Base.getTemperature(None)


# ---- Before there is a Context -------------------------------------------------------------------
