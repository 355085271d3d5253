"""CustomBodyMotion in Python: casts, copies, damaged files, and refused input. (The C++ tests
TestBodyMotions and TestBadInputMotion have its values.)"""
import copy
import gc
import pickle
import re

import numpy as np
import openmm
import pytest
from openmm import unit

from openmmrigidhi import CustomBodyForce, CustomBodyMotion, CustomRigidHIIntegrator, _systems

COMPONENTS = ('vx', 'vy', 'vz', 'wx', 'wy', 'wz')


def make():
    force = CustomBodyMotion(vx='k*t; k=2*rate', wy='"\'&\t', vz='0', wx='a<0.5')
    force.setFrame('Body')
    force.addGlobalParameter('rate', 1/3)
    force.addPerBodyParameter('a')
    force.addPerBodyParameter('b')
    force.addBody(3, [1/7, -2])
    force.addBody(0, np.array([1, 2]))
    force.setForceGroup(5)
    force.setName('rollers')
    return force


COPIES = {
    'xml': lambda force: CustomBodyMotion.cast(
        openmm.XmlSerializer.deserialize(openmm.XmlSerializer.serialize(force))),
    'copy': copy.copy,
    'deepcopy': copy.deepcopy,
    'pickle': lambda force: pickle.loads(pickle.dumps(force)),
    'clone': lambda force: CustomBodyMotion.cast(openmm.XmlSerializer.clone(force)),
}


def test_what_is_set_is_got():
    force = make()
    assert [force.getExpression(c)
            for c in COMPONENTS] == ['k*t; k=2*rate', '', '0', 'a<0.5', '"\'&\t', '']
    for component in COMPONENTS:
        force.setExpression(component, component + '1')
    assert [force.getExpression(c) for c in COMPONENTS] == [c + '1' for c in COMPONENTS]
    assert force.getFrame() is CustomBodyMotion.Body
    force.setFrame(CustomBodyMotion.Lab)
    assert force.getFrame() is CustomBodyMotion.Frame.Lab
    assert (force.getNumGlobalParameters(), force.getNumPerBodyParameters(),
            force.getNumBodies()) == (1, 2, 2)
    assert force.getBodyParameters(0) == (3, (1/7, -2))
    force.setBodyParameters(0, 2, [5*unit.nanometer/unit.nanosecond, 6])
    assert force.getBodyParameters(0) == (2, (0.005, 6))
    assert isinstance(force, openmm.Force) and not force.usesPeriodicBoundaryConditions()
    assert repr(make()).startswith("<CustomBodyMotion: vx='k*t; k=2*rate', vz='0', wx=")
    assert repr(make()).endswith(', Body, 2 bodies>')


def test_all_components_are_free_at_first():
    force = CustomBodyMotion()
    assert [force.getExpression(c) for c in COMPONENTS] == 6*['']
    assert force.getName() == 'CustomBodyMotion' and force.getFrame() is force.Lab
    assert CustomBodyMotion('1', '2', '3', '4', '5', '6').getExpression('wz') == '6'


@pytest.mark.parametrize('action, message', [
    (lambda f: CustomBodyMotion(wy=1), 'CustomBodyMotion.__init__: wy: got 1; it must be a string'),
    (lambda f: f.setExpression('vx', 0),
     'CustomBodyMotion.setExpression: expression: got 0; it must be a string'),
    (lambda f: f.setFrame(True), 'CustomBodyMotion.setFrame: frame: got True'),
    (lambda f: f.addGlobalParameter('g', '1'), "defaultValue: got '1'; it must be a number"),
    (lambda f: f.addBody(0, 5),
     'CustomBodyMotion.addBody: parameters: got 5; it must be a sequence of numbers'),
    (lambda f: f.addBody(1.5), 'CustomBodyMotion.addBody: bodyIndex: got 1.5; it must be an'),
    (lambda f: f.updateParametersInContext(None),
     'CustomBodyMotion.updateParametersInContext: context: got NoneType'),
])
def test_wrong_types(action, message):
    with pytest.raises(TypeError, match=re.escape(message)):
        action(make())


def test_an_unknown_frame():
    with pytest.raises(ValueError, match="setFrame: frame: 'lab' is no Frame; the names are Lab"):
        make().setFrame('lab')


@pytest.mark.parametrize('duplicate', COPIES.values(), ids=COPIES)
def test_everything_survives(duplicate):
    force = make()
    result = duplicate(force)
    assert type(result) is CustomBodyMotion and CustomBodyMotion.cast(result) is result
    assert openmm.XmlSerializer.serialize(result) == openmm.XmlSerializer.serialize(force)
    assert [result.getExpression(c)
            for c in COMPONENTS] == [force.getExpression(c) for c in COMPONENTS]
    assert result.getFrame() is force.getFrame()
    result.addBody(9)
    assert force.getNumBodies() == 2


def test_cast_moves_ownership_and_refuses_others():
    generic = openmm.XmlSerializer.clone(make())
    assert type(generic) is openmm.Force
    force = CustomBodyMotion.cast(generic)
    assert force.thisown and not generic.thisown
    del generic
    gc.collect()
    system = openmm.System()
    system.addForce(force)
    assert CustomBodyMotion.cast(system.getForce(0)).getNumBodies() == 2
    for other in (openmm.HarmonicBondForce(), None, CustomBodyForce(*6*['0']),
                  CustomRigidHIIntegrator(300, 0.001)):
        with pytest.raises(TypeError, match='CustomBodyMotion.cast: obj: got'):
            CustomBodyMotion.cast(other)
    with pytest.raises(TypeError, match='CustomBodyForce.cast: obj: got'):
        CustomBodyForce.cast(make())


def xml():
    return openmm.XmlSerializer.serialize(make())


@pytest.mark.parametrize('attribute',
                         sorted(set(re.findall(r' (\w+)="', xml())) - {'type', 'openmmVersion'}))
def test_a_missing_property_is_refused_by_name(attribute):
    with pytest.raises(openmm.OpenMMException, match=f"'{attribute}'"):
        openmm.XmlSerializer.deserialize(re.sub(rf' {attribute}="[^"]*"', '', xml()))


@pytest.mark.parametrize(
    'before, after, message',
    [('version="1"', 'version="2"', "property 'version' is '2'; it must be 1"),
     ('frame="Body"', 'frame="1"', "property 'frame' is '1'; it must be one of Body, Lab"),
     ('count="2"', 'count="4"', "CustomBodyMotion: XML element"),
     ('name="a"', 'name="t"', "the name 't' is that of a variable")])
def test_damaged_files_are_refused(before, after, message):
    assert before in xml()
    with pytest.raises(openmm.OpenMMException, match=re.escape(message)):
        openmm.XmlSerializer.deserialize(xml().replace(before, after))


def test_there_is_no_equilibrium_beside_bodies_that_are_moved():
    system = openmm.System()
    motion = CustomBodyMotion('1')
    system.addForce(copy.copy(motion))
    _systems.refuse_driven_flow(system, 'here', 'average over steps')  # it moves no body
    motion.addBody(0)
    system.addForce(motion)
    with pytest.raises(
            ValueError, match='here: a CustomBodyMotion prescribes how bodies move; '
            'the System has no equilibrium beside such bodies, average over steps, '
            'or remove the CustomBodyMotion'):
        _systems.refuse_driven_flow(system, 'here', 'average over steps')
