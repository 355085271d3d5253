"""Every property with a setter survives XML, copies and pickles with a value that is not its
default."""
import copy
import pickle
import re

import numpy as np
import openmm
import openmmrigidhi
import pytest
from conftest import read
from openmm import unit

Integrator = openmmrigidhi.CustomRigidHIIntegrator
MobilityForce = openmmrigidhi.MobilityForce
CustomBodyForce = openmmrigidhi.CustomBodyForce
CustomBodyMotion = openmmrigidhi.CustomBodyMotion
CLASSES = {
    'CustomRigidHIIntegrator': Integrator,
    'MobilityForce': MobilityForce,
    'CustomBodyForce': CustomBodyForce,
    'CustomBodyMotion': CustomBodyMotion
}

#: A symmetric positive definite tensor without zeros.
TENSOR = np.eye(6)/3 + 0.01*np.add.outer(np.arange(6)/7, np.arange(6)/7)

#: For each setter, arguments that differ from the default. A new setter needs a line here, or one
#: below.
VALUES = {
    'CustomRigidHIIntegrator': {
        'setTemperature': (271.25,),
        'setStepSize': (0.00375,),
        'setConstraintTolerance': (3.5e-7,),
        'setIntegrationForceGroups': (0b1011,),
        'setScheme': (Integrator.LangevinA,),
        'setNoiseLaw': (Integrator.ThreePoint,),
        'setFriction': (4.125,),
        'setRotationalFriction': (17.0625,),
        'setInertiaScale': (20/3,),
        'setGradientRelaxationTime': (0.0071,),
        'setGradientRotationalRelaxationTime': (0.0019,),
        'setRandomNumberSeed': (-987654321,),
        'setPoseTolerance': (0.0123,),
        'setMaximumRejections': (17,),
        'setNumHostThreads': (3,),
        'setWallRejection': (Integrator.Crossing,),
        'setDriftCorrectorScaling': (Integrator.Whole,),
        'setFiniteDifferenceStep': (1e-4/3,),
        'setJointTolerance': (1e-8/3,),
        'setHingeMotorRate': (0, -1/3),
        'setBodyFriction': (1, 0.1, 1/3),
        'setBodyHeld': (1, True),
        'setParticleHeld': (8, True),
        'setRigidBodyParameters': (0, [4, 1, 3], 7/3, (0.1, 0.2, 0.25), [(0.1, 0, 1/3),
                                                                         (0, -0.2, 0), (0, 0, 0)]),
    },
    'MobilityForce': {
        'setForceGroup': (7,),
        'setName': ('fluid <1> & "2"',),
        'setParticleRadius': (1, 1/3),
        'setViscosity': (1000/3,),
        'setModel': (MobilityForce.FreeDraining,),
        'setBoundary': (MobilityForce.NoSlipWall,),
        'setWallHeight': (-4/3,),
        'setChannelWalls': (-4/3, 5/3),
        'setChannelCondition': (MobilityForce.ZeroFlux,),
        'setGridSpacing': (1/3,),
        'setSinusoidalForceDensity': (1/3, 2, 0, 3),
        'setWallVelocity': ((1/3, -2, 0),),
        'setBodyForceDensity': ((-1/7, 2, 0),),
        'setShear': (1/3, 1, 2),
        'setBackgroundFlow': ((1/3, -2, 3), ((1/7, 2, 3), (4, -1/7, 6), (7, 8, 0))),
        'setSphereWallMobility': (MobilityForce.BestKnown,),
        'setLubrication': (MobilityForce.On,),
        'setLubricationReach': (7/3, 10/3),
        'setFastSummation': (False,),
        'setMinimumGap': (1e-3/3,),
        'setSolver': (MobilityForce.MatrixFree,),
        'setSolverTolerance': (1e-5/3,),
        'setBodyMobility': (3, TENSOR),
        'setBodyFriction': (2, TENSOR),
        'setBodyForceOnFluidParameters': (0, 2, (1/3, 0, -2), 1/7, (0, 1/3, 4)),
        'setBodySlip': (2, [(1/3, 0, -2), (0, 1/7, 3)]),
        'setGroups': ([3, 0, 3, 1],),
    },
    'CustomBodyForce': {
        'setForceGroup': (7,),
        'setName': ('drive <1> & "2"',),
        'setExpression': ('ty', 'k*step(x)/3'),
        'setPerBodyParameterName': (0, 'h'),
        'setGlobalParameterName': (0, 'stiffness'),
        'setGlobalParameterDefaultValue': (0, 1/3),
        'setBodyParameters': (0, 3, [1/3]),
    },
    'CustomBodyMotion': {
        'setForceGroup': (7,),
        'setName': ('rollers <1> & "2"',),
        'setExpression': ('wy', 'k*step(t)/3'),
        'setFrame': (CustomBodyMotion.Body,),
        'setPerBodyParameterName': (0, 'h'),
        'setGlobalParameterName': (0, 'stiffness'),
        'setGlobalParameterDefaultValue': (0, 1/3),
        'setBodyParameters': (0, 3, [1/3]),
    }
}
#: Setters that are left out, because a State or checkpoint holds their values, or because there is
#: only one value; and why.
ELSEWHERE = {
    'CustomRigidHIIntegrator': {
        'setBodyPositions': 'state of a Context',
        'setBodyOrientations': 'state of a Context',
        'setBodyVelocities': 'state of a Context',
        'setBodyAngularVelocities': 'state of a Context',
    },
    'MobilityForce': {},
    'CustomBodyForce': {},
    'CustomBodyMotion': {}
}
#: Setters whose getter takes the setter's first argument.
INDEXED = {
    'setBodyFriction', 'setBodyHeld', 'setParticleHeld', 'setHingeMotorRate',
    'setRigidBodyParameters', 'setParticleRadius', 'setBodyMobility', 'setBodySlip',
    'setBodyForceOnFluidParameters', 'setExpression', 'setPerBodyParameterName',
    'setGlobalParameterName', 'setGlobalParameterDefaultValue', 'setBodyParameters'
}
SETTERS = sorted(
    (cls, name) for cls in CLASSES for name in dir(CLASSES[cls]) if name.startswith('set'))
PROPERTIES = sorted((cls, setter) for cls in VALUES for setter in VALUES[cls])


def fresh(cls):
    if cls == 'MobilityForce':
        fluid = MobilityForce()
        fluid.addParticle(0.5)
        fluid.addParticle(0.25)
        fluid.addBodyForceOnFluid(1, (0, 0, 1), 0.5, (1, 0, 0))
        return fluid
    if cls == 'CustomBodyForce':
        force = CustomBodyForce('-k*x', 'g', '0', '0', '0', '0')
        force.addGlobalParameter('k', 1)
        force.addPerBodyParameter('g')
        force.addBody(0, [1])
        return force
    if cls == 'CustomBodyMotion':
        force = CustomBodyMotion('-k*t', 'g', '', '', '', '0')
        force.addGlobalParameter('k', 1)
        force.addPerBodyParameter('g')
        force.addBody(0, [1])
        return force
    integrator = Integrator(300, 0.001)
    integrator.addRigidBody([0, 1, 2], 5.0, (1, 1, 1), [(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0)])
    integrator.addRigidBody([5, 6, 7])
    integrator.addHingeMotor(integrator.addHinge(0, (0, 0, 0), 1, (0, 0, 0), (0, 0, 1), (0, 0, 1)),
                             1)
    return integrator


def value(thing, cls, setter):
    """The value that the getter returns, or None if there is none yet."""
    index = VALUES[cls][setter][:1] if setter in INDEXED else ()
    try:
        return getattr(thing, 'get' + setter[3:])(*index)
    except openmm.OpenMMException:
        return None


def same(a, b):
    if isinstance(a, tuple):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b))
    if unit.is_quantity(a):
        return a.unit == b.unit and same(a._value, b._value)
    return np.array_equal(a, b)


def through_xml(thing):
    return type(thing).cast(openmm.XmlSerializer.deserialize(openmm.XmlSerializer.serialize(thing)))


def through_pickle(thing):
    return pickle.loads(pickle.dumps(thing))


def test_every_class_is_listed():
    from test_cpp_python_parity import CLASSES as all_classes
    assert set(VALUES) == set(ELSEWHERE) == set(CLASSES) == set(all_classes)


@pytest.mark.parametrize('cls, setter', SETTERS)
def test_setter_is_listed(cls, setter):
    assert (setter in VALUES[cls]) != (setter in ELSEWHERE[cls]), \
        f'{setter}: give it a value that is not the default in this file'


def test_setters_of_the_fluid_count_changes():
    """Without this number a change that the Context does not know is not named."""
    method = r'(?:void|int) {}((?:set|add|clear)\w+)\([^;]*?\) \{{\n(.*?)^{}\}}'
    found = re.findall('^' + method.format('MobilityForce::', ''),
                       read('openmmapi/src/MobilityForce.cpp'), flags=re.M | re.S)
    found += re.findall(method.format('', '    '),
                        read('openmmapi/include/openmmrigidhi/MobilityForce.h'), flags=re.M | re.S)
    ofOpenMM = {'setForceGroup', 'setName'}
    wanted = set(VALUES['MobilityForce']) | set(ELSEWHERE['MobilityForce'])
    assert wanted - ofOpenMM <= {name for name, _ in found}
    assert [name for name, body in found if 'settingsVersion++;' not in body] == []


@pytest.mark.parametrize('cls, setter', PROPERTIES)
@pytest.mark.parametrize('through', [through_xml, copy.copy, copy.deepcopy, through_pickle])
def test_value_survives(cls, setter, through):
    thing = fresh(cls)
    default = value(thing, cls, setter)
    getattr(thing, setter)(*VALUES[cls][setter])
    changed = value(thing, cls, setter)
    assert not same(default, changed), f'{setter}: the value in this file is the default'
    assert same(value(through(thing), cls, setter), changed)


@pytest.mark.parametrize('cls', VALUES)
@pytest.mark.parametrize('through', [through_xml, copy.copy, copy.deepcopy, through_pickle])
def test_all_together_survive_to_the_same_xml(cls, through):
    thing = fresh(cls)
    for setter in sorted(VALUES[cls]):
        getattr(thing, setter)(*VALUES[cls][setter])
    xml = openmm.XmlSerializer.serialize(thing)
    assert openmm.XmlSerializer.serialize(through(thing)) == xml


@pytest.mark.parametrize('cls, constants', [('CustomRigidHIIntegrator', 'Scheme'),
                                            ('CustomRigidHIIntegrator', 'NoiseLaw'),
                                            ('CustomRigidHIIntegrator', 'WallRejection'),
                                            ('MobilityForce', 'Model'),
                                            ('MobilityForce', 'Boundary'),
                                            ('MobilityForce', 'SphereWallMobility'),
                                            ('MobilityForce', 'ChannelCondition'),
                                            ('MobilityForce', 'Lubrication'),
                                            ('MobilityForce', 'Solver'),
                                            ('CustomBodyMotion', 'Frame')])
def test_every_constant_survives(cls, constants):
    kind = type(getattr(fresh(cls), 'get' + constants)())
    for constant in kind:
        thing = fresh(cls)
        getattr(thing, 'set' + constants)(constant)
        assert getattr(through_xml(thing), 'get' + constants)() is constant


def test_bodies_survive():
    integrator = fresh('CustomRigidHIIntegrator')
    integrator.setBodyFriction(0, 2, 3)
    twin = through_xml(integrator)
    assert twin.getNumRigidBodies() == 2
    assert [twin.getRigidBodyIsExplicit(i) for i in range(2)] == [True, False]
    assert [twin.getRigidBodyGeometryIsKnown(i) for i in range(2)] == [True, False]
    assert [twin.getBodyHasOwnFriction(i) for i in range(2)] == [True, False]
    assert twin.getRigidBodyParticles(1) == [5, 6, 7]
