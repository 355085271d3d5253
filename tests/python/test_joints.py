"""Joints in Python: arguments and results, copies, files, and what refuses them. (The C++ test
TestBadInputJoints has the messages of what a Context or a setter refuses.)"""
import copy
import pickle
import re

import numpy as np
import openmm
import pytest
from openmm import unit

import openmmrigidhi
from openmmrigidhi import CustomRigidHIIntegrator, accuracy, analysis, app
from scenes import dumbbells

ANCHORS = {'anchor_i': (1/3, 0, 0), 'anchor_j': (0, -1/7, 0)}
#: The method and the arguments of a joint of each kind.
JOINTS = {
    'Ball': ('addBallJoint', {
        'i': 2,
        'j': 0,
        **ANCHORS
    }),
    'BallToPoint': ('addBallJointToPoint', {
        'i': 1,
        'anchor_i': (0, 0, 1/9),
        'point': (1e3/7, -2, 0)
    }),
    'Link': ('addLink', {
        'i': 0,
        'j': 1,
        **ANCHORS, 'length': 2/3
    }),
    'Hinge': ('addHinge', {
        'i': 1,
        'j': 2,
        **ANCHORS, 'axis_i': (0.3, 0.1, -7),
        'axis_j': (0, 0, -5)
    })
}


def make(kinds=tuple(JOINTS)):
    """An integrator of three bodies with a joint of each of these kinds."""
    integrator = CustomRigidHIIntegrator(300, 0.002)
    for particle in range(3):
        integrator.addRigidBody([particle], 0, (0, 0, 0), [(0, 0, 0)])
    for number, kind in enumerate(kinds):
        method, arguments = JOINTS[kind]
        assert getattr(integrator, method)(**arguments) == number
    return integrator


def xml(integrator):
    return openmm.XmlSerializer.serialize(integrator)


def from_xml(text):
    return CustomRigidHIIntegrator.cast(openmm.XmlSerializer.deserialize(text))


COPIES = {
    'xml': lambda integrator: from_xml(xml(integrator)),
    'copy': copy.copy,
    'deepcopy': copy.deepcopy,
    'pickle': lambda integrator: pickle.loads(pickle.dumps(integrator)),
}


def plain(joint):
    """The definition without units, which must be nm."""
    result = dict(joint)
    for name in ('anchor_i', 'anchor_j', 'point', 'length'):
        if name in joint:
            result[name] = joint[name].value_in_unit(unit.nanometer)
            assert joint[name].unit == unit.nanometer
    return {
        name: tuple(value) if isinstance(value, np.ndarray) else value
        for name, value in result.items()
    }


# ---- Arguments and results -----------------------------------------------------------------------


@pytest.mark.parametrize('number, kind', enumerate(JOINTS))
def test_the_definition_is_what_was_given(number, kind):
    integrator = make()
    assert integrator.getNumJoints() == len(JOINTS)
    found, expected = plain(integrator.getJointParameters(number)), dict(JOINTS[kind][1])
    for name in ('axis_i', 'axis_j'):
        if name in expected:
            axis = np.array(expected.pop(name), dtype=float)
            np.testing.assert_allclose(found.pop(name), axis/np.linalg.norm(axis), rtol=0,
                                       atol=1e-15)
    assert found == {'j': -1, **expected, 'kind': kind}


def test_quantities_are_converted_and_checked():
    integrator = make(())
    angstrom = unit.angstrom
    integrator.addLink(0, [10, 0, 0]*angstrom, 1, np.array([0, 20, 0])*angstrom, 5*angstrom)
    integrator.addBallJointToPoint(0, (0, 0, 0), openmm.Vec3(0, 0, 1)*unit.micrometer)
    integrator.setJointTolerance(1e-3*angstrom)
    link, ball = (plain(integrator.getJointParameters(index)) for index in range(2))
    assert link['anchor_i'] == (1, 0, 0) and link['anchor_j'] == (0, 2, 0)
    assert link['length'] == 0.5 and ball['point'] == (0, 0, 1000)
    assert integrator.getJointTolerance() == 1e-4*unit.nanometer
    where = 'CustomRigidHIIntegrator.'
    for call, error, message in (
        (lambda: integrator.addBallJoint(0, (1, 0), 1, (0, 0, 0)), ValueError,
         'addBallJoint: anchor_i: got an array of shape (2,)'),
        (lambda: integrator.addBallJoint(0, (1, 0, 0), 1.5,
                                         (0, 0, 0)), TypeError, 'addBallJoint: j: got 1.5'),
        (lambda: integrator.addBallJointToPoint(0, (1, 0, 0), (0, 0, 0)*unit.picosecond), TypeError,
         'addBallJointToPoint: point: '), (lambda: integrator.addLink(0, (1, 0, 0), 1,
                                                                      (0, 0, 0), 'long'), TypeError,
                                           "addLink: length: got 'long'"),
        (lambda: integrator.addHinge(0, (1, 0, 0), 1, (0, 0, 0), 3, (0, 0, 1)), ValueError,
         'addHinge: axis_i: got an array of shape ()'), (lambda: integrator.getJointParameters('0'),
                                                         TypeError,
                                                         "getJointParameters: index: got '0'"),
    ):
        with pytest.raises(error, match=re.escape(where + message)):
            call()
    assert integrator.getNumJoints() == 2


# ---- Copies and files ----------------------------------------------------------------------------


@pytest.mark.parametrize('way', COPIES)
def test_joints_survive(way):
    integrator = make()
    result = COPIES[way](integrator)
    assert result.getNumJoints() == len(JOINTS)
    for index in range(len(JOINTS)):
        assert plain(result.getJointParameters(index)) == plain(
            integrator.getJointParameters(index))
    assert xml(result) == xml(integrator)


@pytest.mark.parametrize('kind', JOINTS)
def test_only_files_with_joints_have_the_newer_version(kind):
    """Earlier versions of the library can read all other files."""
    assert ' version="1"' in xml(make(())) and 'Joints' not in xml(make(()))
    assert ' version="2"' in xml(make((kind,))) and '<Joints count="1">' in xml(make((kind,)))


@pytest.mark.parametrize(
    'before, after, message',
    [(' kind="Ball"', ' kind="Slider"',
      "property 'kind' is 'Slider'; it must be one of Ball, BallToPoint, Hinge, Link"),
     (' kind="Ball"', '', "property 'kind' is missing"), (' j="0"', '', "property 'j' is missing"),
     (' j="0"', ' j="3"', 'addBallJoint(): body index 3 is out of range'),
     ('<Point ', '<Place ', "the element 'Point' is missing"),
     (' length=".6666666666666666"', '', "property 'length' is missing"),
     (' length=".6666666666666666"', ' length="-1"', 'addLink(): length is -1 nm'),
     ('<Axis_i ', '<Axis ', "the element 'Axis_i' is missing"),
     ('<Joints count="4">', '<Joints count="5">', 'it has 4 elements; it must have 5')])
def test_damaged_files_are_refused(before, after, message):
    text = xml(make())
    assert before in text
    with pytest.raises(openmm.OpenMMException, match=re.escape(message)):
        openmm.XmlSerializer.deserialize(text.replace(before, after))


# ---- Motors --------------------------------------------------------------------------------------


def with_motors():
    integrator = make(('Link', 'Hinge', 'Hinge'))
    assert integrator.addHingeMotor(2, -1/3) == 0
    assert integrator.addHingeMotor(hinge=1, rate=360*unit.degree/unit.nanosecond) == 1
    return integrator


def test_motors_are_what_was_given():
    integrator = with_motors()
    assert integrator.getNumHingeMotors() == 2
    per_ps = unit.radian/unit.picosecond
    assert integrator.getHingeMotorParameters(0) == (2, -1/3*per_ps)
    hinge, rate = integrator.getHingeMotorParameters(1)
    assert hinge == 1 and rate.unit == per_ps
    assert rate._value == pytest.approx(2e-3*np.pi, rel=1e-15)
    integrator.setHingeMotorRate(index=1, rate=2/unit.picosecond)
    assert integrator.getHingeMotorRate(1) == 2*per_ps
    where = 'CustomRigidHIIntegrator.'
    for call, message in ((lambda: integrator.addHingeMotor(1.5, 1), 'addHingeMotor: hinge: '),
                          (lambda: integrator.addHingeMotor(0, 1*unit.kelvin),
                           'addHingeMotor: rate: got a quantity in kelvin'),
                          (lambda: integrator.setHingeMotorRate(0, 'fast'),
                           "setHingeMotorRate: rate: got 'fast'"),
                          (lambda: integrator.getHingeMotorRate(None),
                           'getHingeMotorRate: index: got None'),
                          (lambda: integrator.getHingeMotorParameters('0'),
                           "getHingeMotorParameters: index: got '0'")):
        with pytest.raises(TypeError, match=re.escape(where + message)):
            call()
    assert integrator.getNumHingeMotors() == 2


@pytest.mark.parametrize('way', COPIES)
def test_motors_survive(way):
    integrator = with_motors()
    result = COPIES[way](integrator)
    for index in range(2):
        assert result.getHingeMotorParameters(index) == integrator.getHingeMotorParameters(index)
    assert xml(result) == xml(integrator)
    assert 'HingeMotors' not in xml(make())


@pytest.mark.parametrize(
    'before, after, message',
    [(' hinge="2"', ' hinge="0"', 'joint 0 (a link of body 0 and body 1) is no hinge'),
     (' hinge="2"', ' hinge="3"', 'addHingeMotor(): joint index 3 is out of range'),
     (' hinge="2"', ' hinge="1"', 'joint 1 (a hinge of body 1 and body 2) has motor 0 already'),
     (' hinge="2"', '', "property 'hinge' is missing"),
     (' rate="-.3333333333333333"', '', "property 'rate' is missing"),
     ('<HingeMotors count="2">', '<HingeMotors count="3">', 'it has 2 elements; it must have 3')])
def test_damaged_motors_are_refused(before, after, message):
    text = xml(with_motors())
    assert before in text
    with pytest.raises(openmm.OpenMMException, match=re.escape(message)):
        openmm.XmlSerializer.deserialize(text.replace(before, after))


# ---- What refuses joints -------------------------------------------------------------------------


def jointed(platform):
    """A Context of two dumbbells, whose integrator has been given a joint since."""
    system, positions, definitions = dumbbells(2)
    integrator = CustomRigidHIIntegrator(300, 0.002)
    for definition in definitions:
        integrator.addRigidBody(*definition)
    context = openmm.Context(system, integrator, platform)
    context.setPositions(positions)
    integrator.addLink(0, (0, 0, 0), 1, (0, 0, 0), 1)
    return context, integrator, positions


def test_what_moves_bodies_one_by_one_refuses_joints(platform):
    context, integrator, positions = jointed(platform)
    with pytest.raises(
            ValueError, match='GibbsBoltzmannSampler: context: its integrator has 1 joint between '
            'bodies, which moves of bodies would tear: average over steps of the integrator'):
        analysis.GibbsBoltzmannSampler(context)
    integrator.addBallJointToPoint(0, (0, 0, 0), (0, 0, 0))
    with pytest.raises(
            ValueError, match='minimize: context: its integrator has 2 joints between bodies, '
            'which the search would tear: run steps of the integrator at temperature 0 instead'):
        openmmrigidhi.app.minimize(context)
    scene = accuracy.Scene(context.getSystem(), positions, integrator, 'jointed')
    with pytest.raises(
            ValueError, match='StepSizeStudy: scene: its integrator has 2 joints between bodies, '
            'which most methods would tear: compare schemes that have joints by runs of your own'):
        accuracy.StepSizeStudy(scene, ['LangevinC'], [0.001, 0.002])


def test_joints_of_later_are_not_those_of_the_context(platform):
    context, integrator, _ = jointed(platform)
    integrator.step(1)
    forces = integrator.getJointForces()
    assert forces.shape == (0, 3) and forces.unit == unit.kilojoule_per_mole/unit.nanometer


# ---- In a Context --------------------------------------------------------------------------------


@pytest.mark.parametrize('scheme', ['TrapezoidalSlip', 'FixmanMidpoint', 'RandomFiniteDifference'])
def test_a_pulled_link_pulls_with_half_the_force(platform, scheme):
    """Of two equal spheres with a link, one is pulled along it. By symmetry, each of them feels
    half of the force."""
    system, fluid = openmm.System(), openmmrigidhi.MobilityForce()
    pull = openmm.CustomExternalForce('-2*x')
    integrator = CustomRigidHIIntegrator(0, 0.01)
    integrator.setScheme(scheme)
    for particle in range(2):
        system.addParticle(0)
        fluid.addParticle(0.5)
        integrator.addRigidBody([particle], 0, (0, 0, 0), [(0, 0, 0)])
    pull.addParticle(1)
    system.addForce(fluid)
    system.addForce(pull)
    integrator.addLink(0, (0, 0, 0), 1, (0, 0, 0), 1.5)
    context = openmm.Context(system, integrator, platform)
    context.setPositions([(0, 0, 0), (1.5, 0, 0)])
    integrator.step(3)
    forces = integrator.getJointForces()
    assert forces.unit == unit.kilojoule_per_mole/unit.nanometer
    np.testing.assert_allclose(forces._value, [(1, 0, 0)], rtol=0, atol=1e-9)
    first, second = integrator.getBodyPositions()._value
    assert first[0] > 0
    np.testing.assert_allclose(second - first, (1.5, 0, 0), rtol=0, atol=1e-10)
    # Copies of the integrator have the joint too.
    later = openmm.Context(system, copy.copy(integrator), platform)
    later.setPositions([(0, 0, 0), (1.52, 0, 0)])
    with pytest.raises(openmm.OpenMMException,
                       match=r'joint 0 \(a link of body 0 and body 1\) is violated by 0.02 nm'):
        later.getIntegrator().step(1)


def test_a_motor_turns_its_bodies(platform):
    """By the right hand about the axis, in opposite directions, and with a torque that has a
    unit."""
    system, fluid = openmm.System(), openmmrigidhi.MobilityForce()
    integrator = CustomRigidHIIntegrator(300, 0.01)
    integrator.setScheme('FixmanMidpoint')
    for particle in range(2):
        system.addParticle(0)
        fluid.addParticle(0.5)
        integrator.addRigidBody([particle], 0, (0, 0, 0), [(0, 0, 0)])
    system.addForce(fluid)
    hinge = integrator.addHinge(0, (0, 0, 0.6), 1, (0, 0, -0.6), (0, 0, 1), (0, 0, 1))
    motor = integrator.addHingeMotor(hinge, 5)
    context = openmm.Context(system, integrator, platform)
    context.setPositions([(0, 0, 0), (0, 0, 1.2)])

    def angle():
        """Of the second body relative to the first, about their common axis."""
        first, second = integrator.getBodyOrientations()
        between = np.array([
            first @ second,
            *(first[0]*second[1:] - second[0]*first[1:] - np.cross(first[1:], second[1:]))
        ])
        assert np.allclose(between[1:3], 0, rtol=0, atol=1e-9)
        return 2*np.arctan2(between[3], between[0])

    integrator.step(20)
    np.testing.assert_allclose(angle(), 1, rtol=0, atol=1e-8)
    torques = integrator.getHingeMotorTorques()
    assert torques.shape == (1,) and torques.unit == unit.kilojoule_per_mole
    integrator.setHingeMotorRate(motor, -5)
    integrator.step(10)
    np.testing.assert_allclose(angle(), 0.5, rtol=0, atol=1e-8)


@pytest.mark.parametrize('place', [0.0, 2e6])
def test_links_hold_far_from_the_origin(place):
    """The rounding of coordinates of 2 mm is 2e-10 nm, above the default tolerance of 1e-10."""
    system, fluid = openmm.System(), openmmrigidhi.MobilityForce()
    integrator = openmmrigidhi.CustomRigidHIIntegrator(298, 1e9)
    integrator.setScheme('FixmanMidpoint')
    integrator.setRandomNumberSeed(1)
    for _ in range(2):
        app.addRigidMultiblob(system, integrator, fluid, [(0, 0, 0)], 500.0)
    integrator.addLink(0, (0, 0, 0), 1, (0, 0, 0), 1000.0)
    fluid.setViscosity(536)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions([(place, place/3, 0), (place + 1000, place/3, 0)])
    integrator.step(2000)
    x = integrator.getBodyPositions()._value
    assert abs(np.linalg.norm(x[1] - x[0]) - 1000) < 8*np.finfo(float).eps*abs(x).max() + 1e-10
