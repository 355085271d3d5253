"""Every property that has a setter survives XML, copying and pickling with a value that is not its default."""
import copy
import pickle

import numpy as np
import openmm
import openmmrigidhi
import pytest
from openmm import unit

Integrator = openmmrigidhi.CustomRigidHIIntegrator

#: For each setter, arguments that differ from the default. A new setter needs a line here, or one below.
VALUES = {
    'setTemperature': (271.25,),
    'setStepSize': (0.00375,),
    'setConstraintTolerance': (3.5e-7,),
    'setIntegrationForceGroups': (0b1011,),
    'setScheme': (Integrator.LangevinA,),
    'setNoiseLaw': (Integrator.ThreePoint,),
    'setFriction': (4.125,),
    'setRotationalFriction': (17.0625,),
    'setGradientRelaxationTime': (0.0071,),
    'setGradientRotationalRelaxationTime': (0.0019,),
    'setRandomNumberSeed': (-987654321,),
    'setPoseTolerance': (0.0123,),
    'setBodyFriction': (1, 0.1, 1/3),
    'setRigidBodyParameters': (0, [4, 1, 3], 7/3, (0.1, 0.2, 0.25), [(0.1, 0, 1/3), (0, -0.2, 0), (0, 0, 0)]),
}
#: Setters of what a State or checkpoint holds, not the integrator's XML, and why.
STATE = {
    'setBodyPositions': 'state of a Context', 'setBodyOrientations': 'state of a Context',
    'setBodyVelocities': 'state of a Context', 'setBodyAngularVelocities': 'state of a Context',
}
SETTERS = sorted(name for name in dir(Integrator) if name.startswith('set'))


def fresh():
    integrator = Integrator(300, 0.001)
    integrator.addRigidBody([0, 1, 2], 5.0, (1, 1, 1), [(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0)])
    integrator.addRigidBody([5, 6, 7])
    return integrator


def value(integrator, setter):
    index = VALUES[setter][:1] if setter in ('setBodyFriction', 'setRigidBodyParameters') else ()
    return getattr(integrator, 'get' + setter[3:])(*index)


def same(a, b):
    if isinstance(a, tuple):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b))
    if unit.is_quantity(a):
        return a.unit == b.unit and same(a._value, b._value)
    return np.array_equal(a, b)


def through_xml(integrator):
    return Integrator.cast(openmm.XmlSerializer.deserialize(openmm.XmlSerializer.serialize(integrator)))


def through_pickle(integrator):
    return pickle.loads(pickle.dumps(integrator))


@pytest.mark.parametrize('setter', SETTERS)
def test_setter_is_listed(setter):
    assert (setter in VALUES) != (setter in STATE), f'{setter}: give it a value that is not the default in this file'


@pytest.mark.parametrize('setter', sorted(VALUES))
@pytest.mark.parametrize('through', [through_xml, copy.copy, copy.deepcopy, through_pickle])
def test_value_survives(setter, through):
    integrator = fresh()
    default = value(integrator, setter)
    getattr(integrator, setter)(*VALUES[setter])
    changed = value(integrator, setter)
    assert not same(default, changed), f'{setter}: the value in this file is the default'
    assert same(value(through(integrator), setter), changed)


@pytest.mark.parametrize('through', [through_xml, copy.copy, copy.deepcopy, through_pickle])
def test_all_together_survive_to_the_same_xml(through):
    integrator = fresh()
    for setter in sorted(VALUES):
        getattr(integrator, setter)(*VALUES[setter])
    xml = openmm.XmlSerializer.serialize(integrator)
    assert openmm.XmlSerializer.serialize(through(integrator)) == xml


@pytest.mark.parametrize('constants', ['Scheme', 'NoiseLaw'])
def test_every_constant_survives(constants):
    kind = type(Integrator.LangevinA if constants == 'Scheme' else Integrator.Gaussian)
    for constant in kind:
        integrator = fresh()
        getattr(integrator, 'set' + constants)(constant)
        assert getattr(through_xml(integrator), 'get' + constants)() is constant


def test_bodies_survive():
    integrator = fresh()
    integrator.setBodyFriction(0, 2, 3)
    twin = through_xml(integrator)
    assert twin.getNumRigidBodies() == 2
    assert [twin.getRigidBodyIsExplicit(i) for i in range(2)] == [True, False]
    assert [twin.getRigidBodyGeometryIsKnown(i) for i in range(2)] == [True, False]
    assert [twin.getBodyHasOwnFriction(i) for i in range(2)] == [True, False]
    assert twin.getRigidBodyParticles(1) == [5, 6, 7]
