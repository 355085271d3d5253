"""XML of format version 1 must always stay readable. There is a file of each class, as the first
version of the library wrote it.

The files of the integrator and of States are loaded into Contexts by test_saved_definitions.py.
"""
import pathlib

import numpy as np
import openmm

from openmmrigidhi import (CustomBodyForce, CustomBodyMotion, CustomRigidHIIntegrator,
                           MobilityForce)

DATA = pathlib.Path(__file__).parent/'data'


def read(name):
    return openmm.XmlSerializer.deserialize((DATA/name).read_text())


def test_mobility_force():
    force = MobilityForce.cast(read('mobility_force_version1.xml'))
    assert (force.getForceGroup(), force.getName()) == (3, 'fluid')
    np.testing.assert_allclose(force.getViscosity()._value, 535.97, rtol=1e-15)
    assert (force.getModel(), force.getBoundary()) == (force.RotnePragerYamakawa, force.NoSlipWall)
    assert (force.getWallHeight()._value, force.getSphereWallMobility()) == (-0.25, force.BestKnown)
    assert (force.getSolver(), force.getSolverTolerance(), force.getMinimumGap(),
            force.getLubrication()) == (force.MatrixFree, 1e-4, 0.002, force.Off)
    assert [force.getParticleRadius(i)._value
            for i in range(force.getNumParticles())] == [0.5, 0.25, 0.125]
    assert list(force.getGroups()) == [0, 0, 1]
    expected = np.diag([1., 2, 3, 4, 5, 6])
    expected[0, 1] = expected[1, 0] = 0.5
    np.testing.assert_array_equal(force.getBodyMobility(1), expected)
    expected[0, 0] = 9
    np.testing.assert_array_equal(force.getBodyFriction(2), expected)
    assert list(force.getBodiesWithOwnTensors()) == [1, 2]
    # Settings that the first version did not have are off.
    assert force.getGridSpacing()._value == 0
    assert force.getSinusoidalForceDensity()[0]._value == 0
    assert not np.any(force.getBackgroundFlow()[0]._value) and not np.any(
        force.getBackgroundFlow()[1]._value)


def test_body_force():
    force = CustomBodyForce.cast(read('body_force_version1.xml'))
    assert (force.getForceGroup(), force.getName()) == (4, 'drive')
    assert [force.getExpression(name) for name in ('fx', 'fy', 'fz', 'tx', 'ty', 'tz')
            ] == ['k*sin(q0)', '2*fx0', '-w', '0', '0', 't*vz']
    assert [force.getPerBodyParameterName(i)
            for i in range(force.getNumPerBodyParameters())] == ['fx0', 'w']
    assert (force.getGlobalParameterName(0), force.getGlobalParameterDefaultValue(0)) == ('k', 2.5)
    assert [(body, list(values))
            for body, values in (force.getBodyParameters(i)
                                 for i in range(force.getNumBodies()))] == [(2, [1.5, -2]),
                                                                            (0, [0, 4])]


def test_body_motion():
    force = CustomBodyMotion.cast(read('body_motion_version1.xml'))
    assert (force.getForceGroup(), force.getName(), force.getFrame()) == (0, 'rollers', force.Body)
    assert [force.getExpression(name) for name in ('vx', 'vy', 'vz', 'wx', 'wy', 'wz')
            ] == ['', '', '0', '', 'w*step(t-t0)', '']
    assert force.getPerBodyParameterName(0) == 'w'
    assert (force.getGlobalParameterName(0), force.getGlobalParameterDefaultValue(0)) == ('t0', 2.5)
    assert [force.getBodyParameters(i) for i in range(2)] == [(2, (1.5,)), (0, (-4,))]


def test_integrator_with_something_held():
    integrator = CustomRigidHIIntegrator.cast(read('integrator_version2.xml'))
    assert [integrator.getBodyHeld(i) for i in range(2)] == [False, True]
    assert integrator.getHeldParticles() == [3, 9]


def test_integrator_with_joints():
    integrator = CustomRigidHIIntegrator.cast(read('integrator_version2_joints.xml'))
    assert integrator.getJointTolerance()._value == 1e-8
    joints = [integrator.getJointParameters(index) for index in range(integrator.getNumJoints())]
    assert [(joint['kind'], joint['i'], joint['j']) for joint in joints] == [('Ball', 0, 1),
                                                                             ('BallToPoint', 1, -1),
                                                                             ('Link', 1, 0),
                                                                             ('Hinge', 0, 1)]
    assert [list(joint['anchor_i']._value) for joint in joints] == [[1, 2, 3], [0, 0, 1], [0, 1, 0],
                                                                    [0, 0, 0]]
    assert [list(joint['point' if joint['j'] < 0 else 'anchor_j']._value)
            for joint in joints] == [[0.5, 0, -1], [4, 5, 6], [2, 0, 0], [1, 0, 0]]
    assert joints[2]['length']._value == 0.25
    assert (list(joints[3]['axis_i']), list(joints[3]['axis_j'])) == ([0, 0.6, -0.8], [1, 0, 0])


def test_integrator():
    integrator = CustomRigidHIIntegrator.cast(read('integrator_version1.xml'))
    assert integrator.getNumRigidBodies() == 3
    assert [integrator.getRigidBodyIsExplicit(i) for i in range(3)] == [False, True, True]
    assert integrator.getInertiaScale() == 1
    assert integrator.getPoseTolerance()._value == 1e-3  # as saved; the default has changed
