"""The conventions of docs/CONVENTIONS.md are tested by turning marked bodies."""
import numpy as np
import openmm
import pytest

import openmmrigidhi

MOMENTS = np.array([2.0, 4.0, 3.0])  # about x, y, z; not in the order of their sizes
#: Four massless markers, at the origin and at the tips of the body's axes.
MARKERS = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)])
BOLTZMANN = 8.31446261815324e-3


def turn(axis, degrees):
    """The quaternion (w, x, y, z) of a right-handed turn about an axis."""
    half = np.deg2rad(degrees)/2
    return np.concatenate([[np.cos(half)], np.sin(half)*np.asarray(axis, dtype=float)])


def product(a, b):
    return np.concatenate([[a[0]*b[0] - a[1:] @ b[1:]],
                           a[0]*b[1:] + b[0]*a[1:] + np.cross(a[1:], b[1:])])


@pytest.fixture
def marked(platform):
    """A body with markers, its Context and its integrator. A force along lab y acts on the marker
    of body x."""
    system = openmm.System()
    for _ in MARKERS:
        system.addParticle(0)
    force = openmm.CustomExternalForce('-strength*y')
    force.addGlobalParameter('strength', 0)
    force.addParticle(1, [])
    system.addForce(force)
    integrator = openmmrigidhi.CustomRigidHIIntegrator(0, 1e-4)
    integrator.setFriction(0)
    integrator.setRotationalFriction(0)
    integrator.addRigidBody(range(4), 5, MOMENTS, MARKERS)
    context = openmm.Context(system, integrator, platform)
    context.setPositions(MARKERS)
    integrator.getBodyPositions()
    return context, integrator


def markers(context):
    return context.getState(getPositions=True).getPositions(asNumpy=True)._value


@pytest.mark.parametrize(
    'q, x, y, z',
    [(turn((1, 0, 0), 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)),
     (turn((0, 0, 1), 90), (0, 1, 0), (-1, 0, 0), (0, 0, 1)),
     (turn((1, 0, 0), 90), (1, 0, 0), (0, 0, 1), (0, -1, 0)),
     (turn((0, 1, 0), 90), (0, 0, -1), (0, 1, 0), (1, 0, 0)),
     # A product turns by its right factor first: y goes to -x, then stays; x goes to y, then to z.
     (product(turn((1, 0, 0), 90), turn((0, 0, 1), 90)), (0, 0, 1), (-1, 0, 0), (0, -1, 0)),])
def test_a_quaternion_turns_a_marked_body(marked, q, x, y, z):
    context, integrator = marked
    for sign in (1, -1):
        integrator.setBodyOrientations([sign*q])
        np.testing.assert_allclose(markers(context)[1:], [x, y, z], atol=1e-14)
        np.testing.assert_allclose(integrator.getBodyOrientations()[0], sign*q, atol=1e-15)


def test_positions_give_the_quaternion_back(marked):
    context, integrator = marked
    q = turn(np.array([1, 2, 2])/3, 50)
    integrator.setBodyOrientations([q])
    placed = markers(context) + [1, 2, 3]
    integrator.setBodyOrientations([[1, 0, 0, 0]])
    context.setPositions(placed)
    np.testing.assert_allclose(integrator.getBodyOrientations()[0], q, atol=1e-12)
    np.testing.assert_allclose(integrator.getBodyPositions()._value[0], [1, 2, 3], atol=1e-12)


def test_angular_velocity_is_right_handed_and_in_the_lab_frame(marked):
    context, integrator = marked
    integrator.setBodyOrientations([turn((1, 0, 0), 90)])  # body y is lab z
    integrator.setBodyAngularVelocities([(0, 0, 10)])
    velocities = context.getState(getVelocities=True).getVelocities(asNumpy=True)._value
    np.testing.assert_allclose(velocities[1], [0, 10, 0], atol=1e-12)  # of the marker at lab x
    # The energy is that of body y, which has the largest moment. It is the third of the sorted
    # axes.
    np.testing.assert_allclose(integrator.computeRotationalKineticEnergies()._value,
                               [0, 0, 0.5*4*100], atol=1e-9)
    integrator.step(100)  # 0.1 rad
    np.testing.assert_allclose(markers(context)[1], [np.cos(0.1), np.sin(0.1), 0], atol=1e-9)
    np.testing.assert_allclose(integrator.getBodyOrientations()[0],
                               product(turn((0, 0, 1), np.rad2deg(0.1)), turn((1, 0, 0), 90)),
                               atol=1e-9)


def test_torque_is_arm_times_force(marked):
    context, integrator = marked
    context.setParameter('strength', 2.5)
    integrator.step(1)
    np.testing.assert_allclose(integrator.getBodyForces()._value, [[0, 2.5, 0]], rtol=1e-6)
    np.testing.assert_allclose(integrator.getBodyTorques()._value, [[0, 0, 2.5]], rtol=1e-6,
                               atol=1e-6)
    assert integrator.getBodyAngularVelocities()._value[0, 2] > 0


def test_energies_are_sorted_by_moment(marked):
    _, integrator = marked
    for axis, place in ((0, 0), (1, 2), (2, 1)):
        integrator.setBodyAngularVelocities([np.eye(3)[axis]])
        expected = np.zeros(3)
        expected[place] = 0.5*MOMENTS[axis]
        np.testing.assert_allclose(integrator.computeRotationalKineticEnergies()._value, expected,
                                   atol=1e-14)


@pytest.mark.parametrize('axis', range(3))
def test_rotation_relaxes_at_the_documented_rate(marked, axis):
    _, integrator = marked
    integrator.setFriction(3)
    integrator.setRotationalFriction(7)
    integrator.setBodyVelocities([(1, 0, 0)])
    integrator.setBodyAngularVelocities([1e-3*np.eye(3)[axis]])
    integrator.step(50)
    time = 50e-4
    rate = 7/(MOMENTS[axis]*np.sum(1/MOMENTS))
    np.testing.assert_allclose(integrator.getBodyVelocities()._value[0, 0], np.exp(-3*time),
                               rtol=1e-12)
    np.testing.assert_allclose(integrator.getBodyAngularVelocities()._value[0, axis],
                               1e-3*np.exp(-rate*time), rtol=1e-9)


def test_degrees_of_freedom(platform):
    """The degrees of freedom of a triangle, a linear molecule, a point, and three free particles
    with a constraint, minus those of the centre of mass."""
    system = openmm.System()
    for _ in range(9):
        system.addParticle(1)
    system.addConstraint(7, 8, 0.1)
    system.addForce(openmm.CMMotionRemover())
    integrator = openmmrigidhi.CustomRigidHIIntegrator(300, 0.001)
    for body in ([0, 1, 2], [3, 4], [5]):
        integrator.addRigidBody(body)
    context = openmm.Context(system, integrator, platform)
    context.setPositions([(0, 0, 0), (0.1, 0, 0), (0, 0.2, 0), (1, 0, 0), (1, 0.1, 0), (2, 0, 0),
                          (3, 0, 0), (4, 0, 0), (4, 0.1, 0)])
    assert integrator.getDegreesOfFreedom() == {
        'translational': 9,
        'rotational1': 1,
        'rotational2': 2,
        'rotational3': 2,
        'free': 8,
        'removed': 3,
        'total': 19
    }


def test_boltzmanns_constant():
    """T = 2 E/(k n), with the documented k."""
    system = openmm.System()
    system.addParticle(2)
    integrator = openmmrigidhi.CustomRigidHIIntegrator(300, 0.001)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions([(0, 0, 0)])
    context.setVelocities([(1, 0, 0)])
    np.testing.assert_allclose(integrator.computeSystemTemperature()._value, 2/(3*BOLTZMANN),
                               rtol=1e-14)
