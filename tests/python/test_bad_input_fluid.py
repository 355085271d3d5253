"""Errors that users may make with a MobilityForce. Wrong types raise TypeError, wrong shapes
ValueError, all else OpenMMException."""
import re

import numpy as np
import openmm
import pytest
from openmm import unit

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce


def refused(*pieces, error=openmm.OpenMMException):
    """Expect an error whose message has all the pieces, in this order."""
    return pytest.raises(error, match='.*'.join(re.escape(piece) for piece in pieces))


@pytest.fixture
def fluid():
    fluid = MobilityForce()
    fluid.addParticle(0.5)
    return fluid


# ---- Types, dimensions, shapes -------------------------------------------------------------------


@pytest.mark.parametrize('bad', ['0.5', None, [0.5], True, 1j, np.array([0.5])])
def test_numbers(fluid, bad):
    for method in (fluid.addParticle, fluid.setViscosity, fluid.setMinimumGap,
                   fluid.setSolverTolerance, fluid.setWallHeight):
        with refused('MobilityForce.' + method.__name__, 'it must be a number', error=TypeError):
            method(bad)
    assert fluid.getNumParticles() == 1


@pytest.mark.parametrize('method, bad, expected',
                         [('addParticle', 0.5*unit.picosecond, 'it must be nm'),
                          ('setViscosity', 5*unit.nanometer, 'it must be dalton/(nm ps)'),
                          ('setViscosity', 1*unit.pascal, 'it must be dalton/(nm ps)'),
                          ('setMinimumGap', 0.1*unit.nanometer, 'it must be a plain number'),
                          ('setWallHeight', 1*unit.picosecond, 'it must be nm'),
                          ('setSolverTolerance', 1e-6*unit.kelvin, 'it must be a plain number'),])
def test_dimensions(fluid, method, bad, expected):
    with refused('MobilityForce.' + method, 'got a quantity in', expected, error=TypeError):
        getattr(fluid, method)(bad)


def test_a_radius_of_the_wrong_dimension(fluid):
    with refused('setParticleRadius: radius: got a quantity in', 'it must be nm', error=TypeError):
        fluid.setParticleRadius(0, 1*unit.dalton)


@pytest.mark.parametrize('bad', [0.0, '0', None, 1.5*unit.nanometer])
def test_indices(fluid, bad):
    for method in (fluid.getParticleRadius, fluid.getBodyHasOwnTensor, fluid.getBodyMobility,
                   fluid.getBodyFriction, fluid.getBodyTensorIsFriction, fluid.clearBodyTensor):
        with refused('MobilityForce.' + method.__name__, 'it must be an integer', error=TypeError):
            method(bad)
    with refused('setBodyMobility: body', 'it must be an integer', error=TypeError):
        fluid.setBodyMobility(bad, np.eye(6))


@pytest.mark.parametrize('bad', [1, 0, 'True', None, 1.0])
def test_truth_values(fluid, bad):
    with refused('MobilityForce.setLubrication: lubrication',
                 error=ValueError if bad == 'True' else TypeError):
        fluid.setLubrication(bad)
    with refused('MobilityForce.setFastSummation: enabled', 'it must be True or False',
                 error=TypeError):
        fluid.setFastSummation(bad)


def test_constants(fluid):
    with refused('MobilityForce.setModel: model', 'it must be a Model: use one of FreeDraining',
                 error=TypeError):
        fluid.setModel(MobilityForce.Dense)
    with refused('MobilityForce.setSolver: solver', 'it must be a Solver: use one of Auto',
                 error=TypeError):
        fluid.setSolver(MobilityForce.Unbounded)
    with refused('MobilityForce.setBoundary: boundary', 'it must be a Boundary', error=TypeError):
        fluid.setBoundary(CustomRigidHIIntegrator.LangevinA)
    with refused("setModel: model: 'RPY' is no Model; the names are FreeDraining, Rotne",
                 error=ValueError):
        fluid.setModel('RPY')
    with refused('setModel()', 'model 17 is unknown'):
        fluid.setModel(17)


@pytest.mark.parametrize('shape', [(36,), (5, 6), (6, 7), (1, 6, 6), ()])
def test_tensors_of_another_shape(fluid, shape):
    for method in (fluid.setBodyMobility, fluid.setBodyFriction):
        with refused(
                'MobilityForce.' + method.__name__,
                f'got an array of shape {shape}; the shape must be (6, 6): give '
                "plain numbers in OpenMM's units", error=ValueError):
            method(0, np.ones(shape))


def test_tensors_that_are_none(fluid):
    with refused('setBodyMobility', 'the rows have different lengths', error=ValueError):
        fluid.setBodyMobility(0, [[1, 2], [1]])
    with refused('setBodyMobility', 'its elements must be numbers', error=TypeError):
        fluid.setBodyMobility(0, [['a']*6]*6)


def test_groups(fluid):
    with refused('MobilityForce.setGroups: groups', 'it must be an integer', error=TypeError):
        fluid.setGroups([0, 1.5])
    with refused('MobilityForce.setGroups: groups', 'it must be a sequence of integers',
                 error=TypeError):
        fluid.setGroups(3)


def test_a_negative_minimum_gap(fluid):
    with refused('setMinimumGap()', 'gap is', 'mean radii', 'finite and not negative'):
        fluid.setMinimumGap(-1e-9)


# ---- In a Context --------------------------------------------------------------------------------


@pytest.fixture
def scene(platform):
    system = openmm.System()
    fluid = MobilityForce()
    integrator = CustomRigidHIIntegrator(300, 0.001)
    for _ in range(2):
        integrator.addRigidBody([system.addParticle(10)], 10, (1, 1, 1), [(0, 0, 0)])
        fluid.addParticle(0.5)
    integrator.setScheme(CustomRigidHIIntegrator.LangevinHI)
    system.addForce(fluid)
    return system, fluid, integrator, platform


def test_wrenches(scene):
    system, fluid, integrator, platform = scene
    context = openmm.Context(system, integrator, platform)
    context.setPositions([(0, 0, 0), (2, 0, 0)])
    for bad in (np.zeros(12), np.zeros((2, 3)), np.zeros((2, 7))):
        with refused('MobilityForce.applyMobilityInContext', 'the shape must be (n, 6)',
                     error=ValueError):
            fluid.applyMobilityInContext(context, bad)


def test_forces_on_blobs(scene):
    system, fluid, integrator, platform = scene
    context = openmm.Context(system, integrator, platform)
    with refused('applyBlobMobilityInContext() needs positions'):
        fluid.applyBlobMobilityInContext(context, np.zeros((2, 3)))
    context.setPositions([(0, 0, 0), (2, 0, 0)])
    for bad in (np.zeros(6), np.zeros((2, 6))):
        with refused('MobilityForce.applyBlobMobilityInContext: forces', 'the shape must be (n, 3)',
                     error=ValueError):
            fluid.applyBlobMobilityInContext(context, bad)
    with refused('MobilityForce.applyBlobMobilityInContext: forces', error=TypeError):
        fluid.applyBlobMobilityInContext(context, np.zeros((2, 3))*unit.kilojoule_per_mole)
    for rows in (0, 1, 3):
        with refused('applyBlobMobilityInContext()',
                     f'{3*rows} numbers, but the System has 2 particles',
                     'give 3 numbers for each of them'):
            fluid.applyBlobMobilityInContext(context, np.zeros((rows, 3)))
    with refused('the force on particle 1 is not finite; forces on blobs must be finite'):
        fluid.applyBlobMobilityInContext(context, [[0]*3, [0, 0, np.inf]])
    with refused('applyBlobMobilityInContext: context: got', error=TypeError):
        fluid.applyBlobMobilityInContext(None, np.zeros((2, 3)))


def test_questions_too_early(scene):
    system, fluid, integrator, platform = scene
    for wrong in (None, system, integrator):
        for ask in (fluid.getMobilityInContext, fluid.getFrictionInContext,
                    fluid.updateParametersInContext):
            with refused('MobilityForce.' + ask.__name__, 'it must be an openmm.Context',
                         error=TypeError):
                ask(wrong)
        with refused('applyMobilityInContext: context: got', 'give the Context whose System has',
                     error=TypeError):
            fluid.applyMobilityInContext(wrong, np.zeros((2, 6)))
    context = openmm.Context(system, integrator, platform)
    for ask in (fluid.getMobilityInContext, fluid.getFrictionInContext):
        with refused(ask.__name__ + '() needs positions'):
            ask(context)


def test_a_compound_integrator(scene):
    system, _, _, platform = scene
    compound = openmm.CompoundIntegrator()
    compound.addIntegrator(openmm.VerletIntegrator(0.001))
    with pytest.raises(openmm.OpenMMException):
        openmm.Context(system, compound, platform)


# ---- Damaged XML ---------------------------------------------------------------------------------


def test_damaged_xml():
    fluid = MobilityForce()
    fluid.addParticle(0.5)
    fluid.setBodyMobility(0, np.eye(6))
    fluid.setGroups([1])
    xml = openmm.XmlSerializer.serialize(fluid)
    openmm.XmlSerializer.deserialize(xml)
    for before, after in (('viscosity="[^"]*"', 'viscosity="-1"'), ('viscosity="[^"]*"',
                                                                    'viscosity="thick"'),
                          ('viscosity="[^"]*"', ''), ('model="[^"]*"', 'model="Oseen"'),
                          ('boundary="[^"]*"', 'boundary="1"'), ('radius="[^"]*"', 'radius="-0.5"'),
                          ('v0="[^"]*"', 'v0="-1"'), ('v35="[^"]*"',
                                                      ''), ('group="[^"]*"',
                                                            'group="-3"'), ('<Particles count="1"',
                                                                            '<Particles count="2"'),
                          ('version="1"', 'version="99"'), ('friction="[^"]*"', 'friction="7"'),
                          ('solver="[^"]*"', 'solver="Fast"'), ('minimumGap="[^"]*"',
                                                                'minimumGap="nan"')):
        damaged, count = re.subn(before, after, xml)
        assert count >= 1, before
        with pytest.raises(openmm.OpenMMException, match='MobilityForce'):
            openmm.XmlSerializer.deserialize(damaged)
