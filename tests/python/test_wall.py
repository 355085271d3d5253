"""A no-slip wall in Python: units, old files, and a user's run above it."""
import re

import numpy as np
import openmm
import pytest
from openmm import unit

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce


def scene(height=1*unit.nanometer, rejection=CustomRigidHIIntegrator.Overlap, platform='Reference'):
    """A sphere of 0.5 nm and a triangle of blobs above a wall, with a repulsion from the wall and a
    weight."""
    system, fluid = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(300, 0.005)
    integrator.setScheme(CustomRigidHIIntegrator.LangevinHI)
    integrator.setRandomNumberSeed(5)
    integrator.setWallRejection(rejection)
    for mass, radius in ((300, 0.5), (100, 0.2), (100, 0.2), (100, 0.2)):
        system.addParticle(mass)
        fluid.addParticle(radius)
    integrator.addRigidBody([0], 300, (30, 30, 30), [(0, 0, 0)])
    integrator.addRigidBody([1, 2, 3])
    fluid.setViscosity(0.2e-3*unit.pascal*unit.second)
    fluid.setBoundary(MobilityForce.NoSlipWall)
    fluid.setWallHeight(height)
    system.addForce(fluid)
    field = openmm.CustomExternalForce('5*z+20*exp(-(z-1-a)/0.1)')
    field.addPerParticleParameter('a')
    for i, radius in enumerate((0.5, 0.2, 0.2, 0.2)):
        field.addParticle(i, [radius])
    system.addForce(field)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platform))
    context.setPositions([(0, 0, 2), (1.5, 0, 1.6), (2, 0, 1.6), (1.5, 0.5, 1.6)])
    return context, integrator, fluid


def test_height_in_any_unit():
    fluid = MobilityForce()
    for value in (-2.5, -2.5*unit.nanometer, -25*unit.angstrom):
        fluid.setWallHeight(value)
        assert fluid.getWallHeight().unit == unit.nanometer
        assert fluid.getWallHeight()._value == pytest.approx(-2.5, rel=1e-12)


@pytest.mark.parametrize('platform', ['Reference', 'CPU'])
def test_a_run_above_a_wall(platform):
    context, integrator, fluid = scene(platform=platform)
    context.setVelocitiesToTemperature(300, 2)
    for _ in range(20):
        integrator.step(20)
        z = context.getState(getPositions=True).getPositions(asNumpy=True)[:, 2]._value
        assert np.all(z - 1 >= [0.5, 0.2, 0.2, 0.2])
    N = fluid.getMobilityInContext(context)
    assert N.shape == (12, 12) and np.linalg.eigvalsh(N)[0] > 0
    assert N[2, 2] < N[0, 0]  # a wall hinders motion towards it more than along it
    assert 'above a no-slip wall at z = 1 nm' in integrator.describeEffects()


def test_rejection_may_change_between_steps():
    context, integrator, fluid = scene()
    context.setPositions([(0, 0, 1.3), (1.5, 0, 1.6), (2, 0, 1.6), (1.5, 0.5, 1.6)])
    with pytest.raises(openmm.OpenMMException,
                       match=re.escape('particle 0 (body 0) has its centre 0.3 nm above the wall')):
        integrator.step(1)
    integrator.setWallRejection(CustomRigidHIIntegrator.Crossing)
    assert integrator.getWallRejection() is CustomRigidHIIntegrator.Crossing
    integrator.step(1)
    assert 'has its centre behind the wall' in integrator.describeEffects()


def test_best_known_and_far_from_the_wall():
    mobilities = {}
    for kind in (MobilityForce.FromModel, MobilityForce.BestKnown):
        for height in (1.4, -1e4):
            context, integrator, fluid = scene()
            fluid.setWallHeight(height)
            fluid.setSphereWallMobility(kind)
            context.reinitialize(preserveState=True)
            mobilities[kind, height] = fluid.getMobilityInContext(context)
    stokes = 1/(6*np.pi*120.4428152*0.5)
    # The exact value at a gap of 0.2 radii is by Brenner. The other body, which is free to move,
    # reduces it by 1e-3.
    brenner = 0.15770665
    assert mobilities[MobilityForce.BestKnown, 1.4][2, 2]/stokes == pytest.approx(brenner, rel=2e-3)
    assert mobilities[MobilityForce.FromModel, 1.4][2, 2]/stokes > 0.3
    far = [mobilities[kind, -1e4] for kind in (MobilityForce.FromModel, MobilityForce.BestKnown)]
    assert far[0] == pytest.approx(far[1], rel=1e-4)
    assert far[0][2, 2] == pytest.approx(stokes, rel=1e-2)


def test_files_of_earlier_versions_have_no_wall():
    fluid = MobilityForce()
    fluid.addParticle(0.5)
    fluid.setWallHeight(3)
    fluid.setSphereWallMobility(MobilityForce.BestKnown)
    xml, count = re.subn(r' (wallHeight|sphereWallMobility)="[^"]*"', '',
                         openmm.XmlSerializer.serialize(fluid))
    assert count == 2
    twin = MobilityForce.cast(openmm.XmlSerializer.deserialize(xml))
    assert twin.getWallHeight(
    )._value == 0 and twin.getSphereWallMobility() is MobilityForce.FromModel
    # Only a Context refuses BestKnown without a wall. So the file can be read and mended.
    whole = MobilityForce.cast(
        openmm.XmlSerializer.deserialize(openmm.XmlSerializer.serialize(fluid)))
    assert whole.getBoundary() is MobilityForce.Unbounded and whole.getSphereWallMobility(
    ) is MobilityForce.BestKnown
    damaged = openmm.XmlSerializer.serialize(fluid).replace('"BestKnown"', '"Best"')
    with pytest.raises(openmm.OpenMMException, match="it must be one of BestKnown, FromModel"):
        openmm.XmlSerializer.deserialize(damaged)


def test_system_and_integrator_survive_together():
    context, integrator, fluid = scene(rejection=CustomRigidHIIntegrator.Crossing)
    system = openmm.XmlSerializer.deserialize(openmm.XmlSerializer.serialize(context.getSystem()))
    twin = CustomRigidHIIntegrator.cast(
        openmm.XmlSerializer.deserialize(openmm.XmlSerializer.serialize(integrator)))
    copied = openmm.Context(system, twin, openmm.Platform.getPlatformByName('Reference'))
    copied.setState(
        context.getState(getPositions=True, getVelocities=True, getParameters=True,
                         getIntegratorParameters=True))
    for stepper in (integrator, twin):
        stepper.step(10)
    ends = [
        c.getState(getPositions=True).getPositions(asNumpy=True)._value for c in (context, copied)
    ]
    assert np.array_equal(*ends)
