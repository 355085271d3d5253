"""Everything public in the Python package is documented, and dimensional results carry units."""
import enum
import importlib
import inspect
import pkgutil
import re

import numpy as np
import openmm
import openmmrigidhi
import pytest
from conftest import git_files, read
from openmm import unit


def modules():
    found = [openmmrigidhi]
    for info in pkgutil.walk_packages(openmmrigidhi.__path__, 'openmmrigidhi.'):
        if not any(part.startswith('_') and part != '__main__' for part in info.name.split('.')) \
                and not info.name.endswith('__main__'):
            found.append(importlib.import_module(info.name))
    return found


def public_objects():
    """(name, object) of public modules, functions, classes and methods that this package defines.
    """
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
#: Methods with these names do as the documentation of OpenMM's reporters and of Python's protocols
#: says.
PROTOCOL = {'describeNextReport', 'report'}


@pytest.mark.parametrize('name', OBJECTS)
def test_has_a_docstring(name):
    own = OBJECTS[name].__doc__
    assert own and own.strip(), f'{name} has no docstring'
    assert own.strip().split(
        '\n')[0].rstrip()[-1] in '.:', f'the docstring of {name} must open with a sentence'


@pytest.mark.parametrize('name', [n for n, o in OBJECTS.items() if inspect.isfunction(o)])
def test_docstring_names_every_parameter(name):
    if name.split('.')[-1] in PROTOCOL:
        return
    function = OBJECTS[name]
    parameters = [
        p.name for p in inspect.signature(function).parameters.values()
        if p.name not in ('self', 'cls') and p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)
    ]
    documentation = function.__doc__
    if len(parameters) == 1 and 'Parameters' not in documentation:
        return  # a setter's one argument is what its first sentence is about
    if 'Parameters and errors as in' in documentation:
        return
    missing = [p for p in parameters if p not in documentation]
    assert not missing, f'{name} does not document {missing}'


@pytest.mark.parametrize(
    'name', [n for n, o in OBJECTS.items() if inspect.isclass(o) and issubclass(o, enum.IntEnum)])
def test_enumerators_have_docstrings_of_their_own(name):
    for member in OBJECTS[name]:
        own = vars(member).get('__doc__')
        assert own and own.split(
            '\n')[0].rstrip()[-1] in '.:', f'{name}.{member.name} has no docstring of its own'


#: What a formula has, and a unit, a name or a condition has not.
FORMULA = re.compile(
    r'sqrt\(|exp\(|sin\(|cos\(|\^\(|\^T\b|\^-1\b|\bsum_\w| div [A-Z(]|/\((?!mol|nm)')
#: Mathematics and code, in which formulas may be: docstrings, headers, examples.
MARKED = re.compile(r':math:`[^`]*`|``[^`]*``|\\f\$.*?\\f\$|^ *(?:>>>|\.\.\.)[^\n]*$',
                    flags=re.S | re.M)


def ascii_formulas(text):
    return FORMULA.findall(MARKED.sub('', text))


def test_formulas_are_recognised():
    assert ascii_formulas('It is f0/(k^2 A)') and ascii_formulas('The drift kT div N')
    assert not ascii_formulas(
        r'It is :math:`\sqrt{2 kT}/(k^2 A)`, or \f$\exp(-U)\f$, in kJ/(mol nm)')


@pytest.mark.parametrize('name', OBJECTS)
def test_formulas_of_docstrings_are_mathematics(name):
    assert not ascii_formulas(inspect.getdoc(OBJECTS[name])), 'write :math:`...`'


@pytest.mark.parametrize(
    'header',
    [name for name in git_files('openmmapi/include/openmmrigidhi/*.h') if '/internal/' not in name])
def test_formulas_of_headers_are_mathematics(header):
    comments = re.findall(r'/\*\*.*?\*/', read(header), flags=re.S)
    assert not ascii_formulas('\n'.join(comments)), r'write \f$...\f$'


# ---- Units ---------------------------------------------------------------------------------------

#: Getters whose results have no dimension, and why, class by class.
WITHOUT_UNIT = {
    'CustomRigidHIIntegrator': {
        'getNumRigidBodies': 'a number of bodies',
        'getNumRigidBodiesOfContext': 'a number of bodies',
        'getRigidBodyParticles': 'indices',
        'getRigidBodyIsExplicit': 'a truth value',
        'getRigidBodyGeometryIsKnown': 'a truth value',
        'getScheme': 'a constant',
        'getNoiseLaw': 'a constant',
        'getBodyHasOwnFriction': 'a truth value',
        'getBodyHeld': 'a truth value',
        'getParticleHeld': 'a truth value',
        'getHeldParticles': 'indices',
        'getNumJoints': 'a number of joints',
        'getJointParameters': 'a dict, some of whose values have units',
        'getNumHingeMotors': 'a number of motors',
        'computeHoldingWrenches': 'rows of mixed dimension',
        'getHoldingWrenches': 'rows of mixed dimension',
        'getRandomNumberSeed': 'an integer',
        'getRandomNumberSeedAsSet': 'an integer',
        'getBodyOrientations': 'unit quaternions',
        'getDegreesOfFreedom': 'numbers of degrees of freedom',
        'computeMidStepTemperatures': 'a dict of quantities',
        'getEffects': 'text',
        'getStepStatistics': 'counters, and seconds that say so in their names',
        'getConstraintTolerance': 'relative',
        'getIntegrationForceGroups': 'a bit mask',
        'getMaximumRejections': 'a number',
        'getNumHostThreads': 'a number',
        'getFiniteDifferenceStep': 'relative',
        'getInertiaScale': 'a factor',
        'getWallRejection': 'a constant',
        'getDriftCorrectorScaling': 'a constant',
        'getNumRejectedSteps': 'a number',
    },
    'MobilityForce': {
        'getNumParticles': 'a number of particles',
        'getModel': 'a constant',
        'getBoundary': 'a constant',
        'getSphereWallMobility': 'a constant',
        'getChannelCondition': 'a constant',
        'getSolver': 'a constant',
        'getLubrication': 'a constant',
        'getLubricationReach': 'relative to radii',
        'getFastSummation': 'a truth value',
        'getMinimumGap': 'relative to radii',
        'getSolverTolerance': 'relative',
        'getBodyHasOwnTensor': 'a truth value',
        'getBodyTensorIsFriction': 'a truth value',
        'getBodyMobility': 'a matrix of mixed dimension',
        'getBodyFriction': 'a matrix of mixed dimension',
        'getBodiesWithOwnTensors': 'indices',
        'getBodiesWithSlip': 'indices',
        'getNumBodyForcesOnFluid': 'a number of forces',
        'getGroups': 'labels',
        'getMobilityInContext': 'a matrix of mixed dimension',
        'getFrictionInContext': 'a matrix of mixed dimension',
    },
    'CustomBodyForce': {
        'getExpression': 'text',
        'getNumPerBodyParameters': 'a number of parameters',
        'getPerBodyParameterName': 'text',
        'getNumGlobalParameters': 'a number of parameters',
        'getGlobalParameterName': 'text',
        'getGlobalParameterDefaultValue': 'what the expressions make of it',
        'getNumBodies': 'a number of bodies',
        'getBodyParameters': 'an index, and what the expressions make of the parameters',
    },
    'CustomBodyMotion': {
        'getFrame': 'a constant',
        'getExpression': 'text',
        'getNumPerBodyParameters': 'a number of parameters',
        'getPerBodyParameterName': 'text',
        'getNumGlobalParameters': 'a number of parameters',
        'getGlobalParameterName': 'text',
        'getGlobalParameterDefaultValue': 'what the expressions make of it',
        'getNumBodies': 'a number of bodies',
        'getBodyParameters': 'an index, and what the expressions make of the parameters',
    }
}
#: The unit of every other getter.
UNITS = {
    'CustomRigidHIIntegrator': {
        'getTemperature': unit.kelvin,
        'getStepSize': unit.picosecond,
        'getFriction': unit.picosecond**-1,
        'getRotationalFriction': unit.picosecond**-1,
        'getBodyFriction': unit.picosecond**-1,
        'getGradientRelaxationTime': unit.picosecond,
        'getGradientRotationalRelaxationTime': unit.picosecond,
        'getPoseTolerance': unit.nanometer,
        'getPoseResidual': unit.nanometer,
        'getBodyPositions': unit.nanometer,
        'getBodyVelocities': unit.nanometer/unit.picosecond,
        'getBodyAngularVelocities': unit.radian/unit.picosecond,
        'getBodyForces': unit.kilojoule_per_mole/unit.nanometer,
        'getBodyTorques': unit.kilojoule_per_mole,
        'computeParticleHoldingForces': unit.kilojoule_per_mole/unit.nanometer,
        'getParticleHoldingForces': unit.kilojoule_per_mole/unit.nanometer,
        'getJointForces': unit.kilojoule_per_mole/unit.nanometer,
        'getHingeMotorParameters': (None, unit.radian/unit.picosecond),
        'getHingeMotorRate': unit.radian/unit.picosecond,
        'getHingeMotorTorques': unit.kilojoule_per_mole,
        'getJointTolerance': unit.nanometer,
        'getRigidBodyParameters': (None, unit.dalton, unit.dalton*unit.nanometer**2,
                                   unit.nanometer),
        'computeTranslationalKineticEnergy': unit.kilojoule_per_mole,
        'computeRotationalKineticEnergies': unit.kilojoule_per_mole,
        'computeFreeParticleKineticEnergy': unit.kilojoule_per_mole,
        'computeSystemTemperature': unit.kelvin,
        'computeMidStepTemperature': unit.kelvin,
    },
    'MobilityForce': {
        'getViscosity': unit.dalton/(unit.nanometer*unit.picosecond),
        'getParticleRadius': unit.nanometer,
        'getWallHeight': unit.nanometer,
        'getChannelWalls': (unit.nanometer, unit.nanometer),
        'getGridSpacing': unit.nanometer,
        'getBodySlip': unit.nanometer/unit.picosecond,
        'getBodyForceOnFluidParameters': (None, unit.nanometer, unit.nanometer,
                                          unit.kilojoule_per_mole/unit.nanometer),
        'getBackgroundFlow': (unit.nanometer/unit.picosecond, unit.picosecond**-1),
        'getSinusoidalForceDensity': (unit.kilojoule_per_mole/unit.nanometer**4, None, None, None),
        'getShear': (unit.picosecond**-1, None, None),
        'getStressInContext': (unit.kilojoule_per_mole/unit.nanometer**3,)*4,
        'getWallVelocity': unit.nanometer/unit.picosecond,
        'getBodyForceDensity': unit.kilojoule_per_mole/unit.nanometer**4,
        'getFlowInContext': unit.nanometer/unit.picosecond,
        'getFlowModeInContext': unit.nanometer/unit.picosecond,
        'getRandomFlowModeInContext': unit.nanometer/unit.picosecond,
        'getMeanFlowInContext': unit.nanometer/unit.picosecond,
        'getRandomMeanFlowInContext': unit.nanometer/unit.picosecond,
    },
    'CustomBodyForce': {},
    'CustomBodyMotion': {}
}
#: Results that are arrays over bodies, and their number of columns.
COLUMNS = {
    'getBodyPositions': 3,
    'getBodyOrientations': 4,
    'getBodyVelocities': 3,
    'getBodyAngularVelocities': 3,
    'getBodyForces': 3,
    'getBodyTorques': 3,
    'computeHoldingWrenches': 6,
    'getHoldingWrenches': 6
}
#: The arguments of getters of a Context, besides the Context.
QUESTIONS = {
    'getFlowInContext': [[(0.1, 0.2, 0.3)]],
    'getFlowModeInContext': [0, 1, 1],
    'getRandomFlowModeInContext': [0, 1, 1]
}
#: Results that are matrices over bodies or of one body, and their numbers of rows and columns.
SQUARES = {'getBodyMobility': 6, 'getMobilityInContext': 12, 'getFrictionInContext': 12}
NEEDS_INDEX = {
    'getRigidBodyParameters', 'getRigidBodyParticles', 'getRigidBodyIsExplicit',
    'getRigidBodyGeometryIsKnown', 'getBodyFriction', 'getBodyHasOwnFriction', 'getBodyHeld',
    'getParticleHeld', 'getJointParameters', 'getHingeMotorParameters', 'getHingeMotorRate',
    'getParticleRadius', 'getBodyHasOwnTensor', 'getBodyTensorIsFriction', 'getBodyMobility',
    'getBodySlip', 'getBodyForceOnFluidParameters', 'getPerBodyParameterName',
    'getGlobalParameterName', 'getGlobalParameterDefaultValue', 'getBodyParameters'
}

#: All getters of all classes: (class, method).
GETTERS = sorted((cls, name) for cls in UNITS for name in dir(getattr(openmmrigidhi, cls))
                 if name.startswith(('get', 'compute')) and name in {
                     **vars(getattr(openmmrigidhi, cls)),
                     **WITHOUT_UNIT[cls]
                 })


@pytest.fixture(scope='module')
def scene():
    """One object of each class, in use in a Context."""
    system = openmm.System()
    fluid = openmmrigidhi.MobilityForce()
    for _ in range(6):
        system.addParticle(12)
        fluid.addParticle(0.1)
    system.addForce(fluid)
    fluid.setBodyMobility(0, np.eye(6))
    fluid.setBoundary(fluid.Periodic)  # only this fluid has modes
    bonds = openmm.HarmonicBondForce()
    for first, second in ((0, 1), (1, 2), (3, 4), (4, 5)):
        bonds.addBond(first, second, 1, 0)
    system.addForce(bonds)
    force = openmmrigidhi.CustomBodyForce('-k*x', 'g', '0', '0', '0', '0')
    force.addGlobalParameter('k', 1)
    force.addPerBodyParameter('g')
    force.addBody(0, [1])
    system.addForce(force)
    integrator = openmmrigidhi.CustomRigidHIIntegrator(300, 0.001)
    integrator.addRigidBody([0, 1, 2])
    integrator.addRigidBody([3, 4, 5])
    integrator.setScheme(integrator.LangevinHI)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions(np.random.default_rng(1).random((6, 3)))
    context.setVelocitiesToTemperature(300, 1)
    integrator.step(2)
    fluid.addBodyForceOnFluid(0, (0, 0, 1), 0.1, (1, 0, 0))
    fluid.setBodySlip(0, np.ones((3, 3)))  # which LangevinHI refuses
    integrator.addBallJoint(0, (0, 0, 0), 1, (0, 0, 0))  # for the next Context
    hinge = integrator.addHinge(0, (0, 0, 0), 1, (0, 0, 0), (0, 0, 1), (0, 0, 1))
    integrator.addHingeMotor(hinge, 1)
    motion = openmmrigidhi.CustomBodyMotion('k*t', 'g')
    motion.addGlobalParameter('k', 1)
    motion.addPerBodyParameter('g')
    motion.addBody(0, [1])
    yield {
        'CustomRigidHIIntegrator': integrator,
        'MobilityForce': fluid,
        'CustomBodyForce': force,
        'CustomBodyMotion': motion,
        'context': context
    }


def stress():
    """The answer of a Context without momenta and CustomBodyForces, which stress is for."""
    system, fluid = openmm.System(), openmmrigidhi.MobilityForce()
    integrator = openmmrigidhi.CustomRigidHIIntegrator(300, 0.001)
    integrator.setScheme(integrator.EulerMaruyama)
    integrator.addRigidBody([system.addParticle(12)], 12, (1, 1, 1), [(0, 0, 0)])
    fluid.addParticle(0.1)
    fluid.setBoundary(fluid.Periodic)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions([(0, 0, 0)])
    return fluid.getStressInContext(context)


def result(scene, cls, name):
    if name == 'getStressInContext':
        return stress()
    arguments = [scene['context'], *QUESTIONS.get(name, [])] if name.endswith('InContext') \
        else [{'CustomBodyForce': 'fx', 'CustomBodyMotion': 'vx'}[cls]] \
        if name == 'getExpression' else \
        [0] if name in NEEDS_INDEX else []
    return getattr(scene[cls], name)(*arguments)


def cases(table):
    return sorted((cls, name) for cls in table for name in table[cls] if (cls, name) in GETTERS)


def test_every_class_is_listed():
    from test_cpp_python_parity import CLASSES
    assert set(UNITS) == set(WITHOUT_UNIT) == set(CLASSES)


@pytest.mark.parametrize('cls, name', GETTERS)
def test_getter_is_listed(cls, name):
    assert (name in UNITS[cls]) != (
        name in WITHOUT_UNIT[cls]), f'{name}: say in this file which unit it returns, or why none'


@pytest.mark.parametrize('cls, name', cases(UNITS))
def test_getter_returns_its_unit(scene, cls, name):
    value, expected_units = result(scene, cls, name), UNITS[cls][name]
    values = value if isinstance(value, tuple) else (value,)
    units = expected_units if isinstance(expected_units, tuple) else (expected_units,)*len(values)
    assert len(values) == len(units)
    for one, expected in zip(values, units):
        if expected is None:
            assert not unit.is_quantity(one)
        else:
            assert unit.is_quantity(one) and one.unit.conversion_factor_to(
                expected) == 1, f'{name} returned {one}'


@pytest.mark.parametrize('cls, name', cases(WITHOUT_UNIT))
def test_getter_returns_no_unit(scene, cls, name):
    assert not unit.is_quantity(result(scene, cls, name))


@pytest.mark.parametrize('name', sorted(COLUMNS))
def test_arrays_have_one_row_a_body(scene, name):
    value = result(scene, 'CustomRigidHIIntegrator', name)
    value = value._value if unit.is_quantity(value) else value
    assert isinstance(
        value, np.ndarray) and value.shape == (2, COLUMNS[name]) and value.dtype == np.float64


@pytest.mark.parametrize('name', sorted(SQUARES))
def test_matrices_are_square(scene, name):
    value = result(scene, 'MobilityForce', name)
    assert isinstance(
        value, np.ndarray) and value.shape == 2*(SQUARES[name],) and value.dtype == np.float64
