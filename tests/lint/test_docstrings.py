"""Everything public in the Python package is documented, and dimensional results carry units."""
import importlib
import inspect
import pkgutil

import numpy as np
import openmm
import openmmrigidhi
import pytest
from openmm import unit


def modules():
    found = [openmmrigidhi]
    for info in pkgutil.walk_packages(openmmrigidhi.__path__, 'openmmrigidhi.'):
        if not any(part.startswith('_') and part != '__main__' for part in info.name.split('.')) \
                and not info.name.endswith('__main__'):
            found.append(importlib.import_module(info.name))
    return found


def public_objects():
    """(name, object) of public modules, functions, classes and methods that this package defines."""
    for module in modules():
        yield module.__name__, module
        for name, value in vars(module).items():
            if name.startswith('_') or getattr(value, '__module__', None) != module.__name__:
                continue
            if inspect.isclass(value):
                yield f'{module.__name__}.{name}', value
                for member, function in vars(value).items():
                    function = getattr(function, '__func__', function)
                    if not member.startswith('_') and inspect.isfunction(function):
                        yield f'{module.__name__}.{name}.{member}', function
            elif inspect.isfunction(value):
                yield f'{module.__name__}.{name}', value


OBJECTS = dict(public_objects())
#: Methods with these names do what OpenMM's reporters and Python's protocols document.
PROTOCOL = {'describeNextReport', 'report'}


@pytest.mark.parametrize('name', OBJECTS)
def test_has_a_docstring(name):
    own = OBJECTS[name].__doc__
    assert own and own.strip(), f'{name} has no docstring'
    assert own.strip().split('\n')[0].rstrip()[-1] in '.:', f'the docstring of {name} must open with a sentence'


@pytest.mark.parametrize('name', [n for n, o in OBJECTS.items() if inspect.isfunction(o)])
def test_docstring_names_every_parameter(name):
    if name.split('.')[-1] in PROTOCOL:
        return
    function = OBJECTS[name]
    parameters = [p.name for p in inspect.signature(function).parameters.values()
                  if p.name not in ('self', 'cls') and p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)]
    documentation = function.__doc__
    if len(parameters) == 1 and 'Parameters' not in documentation:
        return  # a setter's one argument is what its first sentence is about
    if 'Parameters and errors as in' in documentation:
        return
    missing = [p for p in parameters if p not in documentation]
    assert not missing, f'{name} does not document {missing}'


# ---- Units ------------------------------------------------------------------------------------------------------------

#: Getters whose results have no dimension, and why.
WITHOUT_UNIT = {
    'getNumRigidBodies': 'a number of bodies',
    'getRigidBodyParticles': 'indices',
    'getRigidBodyIsExplicit': 'a truth value',
    'getRigidBodyGeometryIsKnown': 'a truth value',
    'getScheme': 'a constant',
    'getNoiseLaw': 'a constant',
    'getBodyHasOwnFriction': 'a truth value',
    'getRandomNumberSeed': 'an integer',
    'getBodyOrientations': 'unit quaternions',
    'getDegreesOfFreedom': 'numbers of degrees of freedom',
    'getEffects': 'text',
    'getStepStatistics': 'counters, and seconds that say so in their names',
    'getConstraintTolerance': 'relative',
    'getIntegrationForceGroups': 'a bit mask',
}
#: The unit of every other getter.
UNITS = {
    'getTemperature': unit.kelvin, 'getStepSize': unit.picosecond,
    'getFriction': unit.picosecond**-1, 'getRotationalFriction': unit.picosecond**-1,
    'getBodyFriction': unit.picosecond**-1,
    'getGradientRelaxationTime': unit.picosecond, 'getGradientRotationalRelaxationTime': unit.picosecond,
    'getPoseTolerance': unit.nanometer, 'getPoseResidual': unit.nanometer,
    'getBodyPositions': unit.nanometer, 'getBodyVelocities': unit.nanometer/unit.picosecond,
    'getBodyAngularVelocities': unit.radian/unit.picosecond,
    'getBodyForces': unit.kilojoule_per_mole/unit.nanometer, 'getBodyTorques': unit.kilojoule_per_mole,
    'getRigidBodyParameters': (None, unit.dalton, unit.dalton*unit.nanometer**2, unit.nanometer),
    'computeTranslationalKineticEnergy': unit.kilojoule_per_mole,
    'computeRotationalKineticEnergies': unit.kilojoule_per_mole,
    'computeFreeParticleKineticEnergy': unit.kilojoule_per_mole,
    'computeSystemTemperature': unit.kelvin,
}
#: Arrays over bodies: their number of columns.
COLUMNS = {'getBodyPositions': 3, 'getBodyOrientations': 4, 'getBodyVelocities': 3, 'getBodyAngularVelocities': 3,
           'getBodyForces': 3, 'getBodyTorques': 3}
NEEDS_INDEX = {'getRigidBodyParameters', 'getRigidBodyParticles', 'getRigidBodyIsExplicit',
               'getRigidBodyGeometryIsKnown', 'getBodyFriction', 'getBodyHasOwnFriction'}

GETTERS = sorted(name for name in dir(openmmrigidhi.CustomRigidHIIntegrator)
                 if name.startswith(('get', 'compute')))


@pytest.fixture(scope='module')
def integrator():
    system = openmm.System()
    for _ in range(6):
        system.addParticle(12)
    integrator = openmmrigidhi.CustomRigidHIIntegrator(300, 0.001)
    integrator.addRigidBody([0, 1, 2])
    integrator.addRigidBody([3, 4, 5])
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions(np.random.default_rng(1).random((6, 3)))
    context.setVelocitiesToTemperature(300, 1)
    integrator.step(2)
    yield integrator
    del context


def result(integrator, name):
    return getattr(integrator, name)(*([0] if name in NEEDS_INDEX else []))


@pytest.mark.parametrize('name', GETTERS)
def test_getter_is_listed(name):
    if name == 'getNumRigidBodies' or name in vars(openmmrigidhi.CustomRigidHIIntegrator):
        assert (name in UNITS) != (name in WITHOUT_UNIT), f'{name}: say in this file which unit it returns, or why none'


@pytest.mark.parametrize('name', sorted(UNITS))
def test_getter_returns_its_unit(integrator, name):
    value = result(integrator, name)
    values = value if isinstance(value, tuple) else (value,)
    units = UNITS[name] if isinstance(UNITS[name], tuple) else (UNITS[name],)*len(values)
    assert len(values) == len(units)
    for one, expected in zip(values, units):
        if expected is None:
            assert not unit.is_quantity(one)
        else:
            assert unit.is_quantity(one) and one.unit.conversion_factor_to(expected) == 1, f'{name} returned {one}'


@pytest.mark.parametrize('name', sorted(set(WITHOUT_UNIT) & set(GETTERS)))
def test_getter_returns_no_unit(integrator, name):
    assert not unit.is_quantity(result(integrator, name))


@pytest.mark.parametrize('name', sorted(COLUMNS))
def test_arrays_have_one_row_a_body(integrator, name):
    value = result(integrator, name)
    value = value._value if unit.is_quantity(value) else value
    assert isinstance(value, np.ndarray) and value.shape == (2, COLUMNS[name]) and value.dtype == np.float64
