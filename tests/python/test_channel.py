"""A fluid between two slip walls: reference values, XML, and refused input."""
import re

import numpy as np
import openmm
import pytest
from openmm import unit
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, analysis
from openmmrigidhi.accuracy.statistics import quantile

KT = (unit.MOLAR_GAS_CONSTANT_R*300*unit.kelvin).value_in_unit(unit.kilojoule_per_mole)


def channel(platform, positions, radii, solver=MobilityForce.Dense, walls=(0, 5.5), box=(9, 8, 10),
            scheme='DriftCorrectorFD', temperature=0):
    """A Context of spheres in a channel."""
    system, fluid = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(temperature, 0.01)
    integrator.setScheme(getattr(CustomRigidHIIntegrator, scheme))
    for radius in radii:
        integrator.addRigidBody([system.addParticle(0)], 0, (0, 0, 0), [(0, 0, 0)])
        fluid.addParticle(radius)
    fluid.setViscosity(1)
    fluid.setModel(fluid.ForceCoupling)
    fluid.setBoundary(fluid.SlipChannel)
    fluid.setSolver(solver)
    fluid.setSolverTolerance(1e-6)
    if walls:
        fluid.setChannelWalls(*walls)
    system.addForce(fluid)
    system.setDefaultPeriodicBoxVectors(*np.diag(box).tolist())
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platform))
    context.setPositions(positions)
    return fluid, integrator, context


@pytest.mark.parametrize('solver', [MobilityForce.Dense, MobilityForce.MatrixFree])
@pytest.mark.parametrize('platform', ['Reference', 'CPU'])
def test_one_sphere(platform, solver):
    # Two independent sums agree on the expected values, for a box of 9, 5.5, 10 radii and viscosity
    # 1.
    fluid, _, context = channel(platform, [(3, 1, 2)], [1], solver)
    diagonal = np.diag(fluid.getMobilityInContext(context))[:3]
    # The tolerance of the grid is one in the norm of the matrix.
    assert np.allclose(diagonal, [0.04824844196, 0.01853161598, 0.04607665115], rtol=0,
                       atol=1e-11 if solver == MobilityForce.Dense else 5e-8)


def test_images_are_particles_of_a_periodic_fluid():
    # The expected mobility is that of images with reflected forces and torques in a periodic box of
    # twice the width.
    positions, radii = np.array([(3, 1.4, 2), (4.1, 3.8, 9.5)]), [1, 0.7]
    fluid, _, context = channel('Reference', positions, radii)
    N = fluid.getMobilityInContext(context)

    system, periodic = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(0, 0.01)
    integrator.setScheme(CustomRigidHIIntegrator.EulerMaruyama)
    for radius in radii*2:
        integrator.addRigidBody([system.addParticle(0)], 0, (0, 0, 0), [(0, 0, 0)])
        periodic.addParticle(radius)
    periodic.setViscosity(1)
    periodic.setModel(periodic.ForceCoupling)
    periodic.setBoundary(periodic.Periodic)
    system.addForce(periodic)
    system.setDefaultPeriodicBoxVectors((9, 0, 0), (0, 11, 0), (0, 0, 10))
    twice = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    twice.setPositions(np.vstack([positions, positions*(1, -1, 1)]))
    reflection = np.tile([1, -1, 1, -1, 1, -1], 2)
    M = periodic.getMobilityInContext(twice)
    assert np.allclose(N, M[:12, :12] + M[:12, 12:]*reflection, rtol=0, atol=1e-12*N.max())


@pytest.mark.parametrize('platform', ['Reference', 'CPU'])
@pytest.mark.parametrize('scheme', [
    'DriftCorrectorFD', 'FixmanMidpoint', 'RandomFiniteDifference', 'TractionEulerMaruyama',
    'TrapezoidalSlip'
])
@pytest.mark.parametrize('solver', [MobilityForce.Dense, MobilityForce.MatrixFree])
def test_spheres_stay_inside(platform, scheme, solver):
    fluid, integrator, context = channel(platform, [(3, 1.2, 2), (6, 4.2, 7)], [1, 0.8], solver,
                                         scheme=scheme, temperature=1000)
    fluid.setSolverTolerance(1e-3)
    context.reinitialize(preserveState=True)
    integrator.step(20)
    y = integrator.getBodyPositions()._value[:, 1]
    assert np.all(y >= [1, 0.8]) and np.all(y <= [4.5, 4.7])
    assert 'between slip walls at y = 0 and 5.5 nm' in integrator.describeEffects()


def test_xml():
    fluid = MobilityForce()
    fluid.setChannelWalls(-0.5*unit.nanometer, 20*unit.angstrom)
    fluid.setBoundary(fluid.SlipChannel)
    xml = openmm.XmlSerializer.serialize(fluid)
    twin = MobilityForce.cast(openmm.XmlSerializer.deserialize(xml))
    assert twin.getChannelWalls() == (
        -0.5*unit.nanometer, 2*unit.nanometer) and twin.getBoundary() is MobilityForce.SlipChannel
    # Files of earlier versions have no channel.
    older, count = re.subn(r' channel(Low|High)="[^"]*"', '', xml)
    assert count == 2
    assert MobilityForce.cast(
        openmm.XmlSerializer.deserialize(older)).getChannelWalls() == (0*unit.nanometer,
                                                                       0*unit.nanometer)


@pytest.mark.parametrize('walls, problem', [((1, 1), 'the walls are at 1 and 1 nm'),
                                            ((3, 1), 'the walls are at 3 and 1 nm'),
                                            ((0, float('nan')), 'both must be finite'),])
def test_walls_that_are_none(walls, problem):
    with pytest.raises(openmm.OpenMMException, match=problem):
        MobilityForce().setChannelWalls(*walls)


def test_wrong_units():
    with pytest.raises(TypeError, match='MobilityForce.setChannelWalls: high: got a quantity in'):
        MobilityForce().setChannelWalls(0, 1*unit.picosecond)


def test_refused():
    with pytest.raises(openmm.OpenMMException,
                       match=r'boundary SlipChannel has walls at y = 0 and 0 nm.*setChannelWalls'):
        channel('Reference', [(3, 1, 2)], [1], walls=None)
    _, integrator, _ = channel('Reference', [(3, 1, 2)], [1], box=(9, 5, 9))
    with pytest.raises(openmm.OpenMMException,
                       match='whose y edge is longer than the channel is wide, but it has 5 nm'):
        integrator.step(1)
    _, integrator, _ = channel('Reference', [(3, 5, 2)], [1])
    with pytest.raises(
            openmm.OpenMMException, match=r'particle 0 \(body 0\) has its centre at y = 5 nm, '
            'with walls at y = 0 and 5.5 nm'):
        integrator.step(1)


@pytest.mark.parametrize('rejection, lowest, highest', [('Overlap', [1, 0.5], [4.5, 5]),
                                                        ('Crossing', [0, 0], [5.5, 5.5])])
def test_a_sampler_knows_the_walls(rejection, lowest, highest):
    """Two spheres do not interact, and the same weight pulls each of them down. So y - lowest has
    an exponential law that ends at the upper wall."""
    _, integrator, context = channel('Reference', [(3, 1.5, 2), (6, 4, 7)], [1, 0.5],
                                     temperature=300)
    integrator.setWallRejection(getattr(CustomRigidHIIntegrator, rejection))
    weight = 0.6*KT
    sampler = analysis.GibbsBoltzmannSampler(context,
                                             energyFunction=lambda R, q: weight*R[:, 1].sum(),
                                             coordinates=['y'], seed=4)
    sampler.burnIn(200, progress=False)
    samples = sampler.sample(8000, 2, progress=False)
    y = samples.positions._value[:, :, 1]
    assert np.all(y.min(axis=0) >= lowest) and np.all(y.max(axis=0) <= highest)
    for k in range(2):
        grid = np.linspace(lowest[k], highest[k], 100001)
        law = np.exp(-0.6*grid)
        for power in (1, 2):
            exact = (grid**power @ law)/law.sum()
            found = samples.average(y[:, k]**power)
            z = (found.mean - exact)/found.standardError
            print(
                f'<y^{power}> {found.mean:.4f} +- {found.standardError:.4f}, exact {exact:.4f}, z '
                f'= {z:.2f}')
            # A false alarm has a probability of 7 in a million for each comparison, as in
            # test_gibbs_boltzmann.py. A wall off by 0.1 would move the mean by 0.05 or more.
            assert found.degrees >= 9 and abs(z) < quantile(
                1 - 7e-6, found.degrees) and found.standardError < 0.05*exact
    integrator.step(1)  # the sampler leaves the Context in a state from which a step may begin


def test_a_sampler_begins_between_the_walls():
    _, integrator, context = channel('Reference', [(3, 4.75, 2)], [1], temperature=300)
    with pytest.raises(
            ValueError, match=
            r'particle 0 \(body 0\) is at y = 4.75 nm, where a wall allows 4.5 nm or less; a start '
            r'must be allowed'):
        analysis.GibbsBoltzmannSampler(context)
    integrator.setWallRejection(CustomRigidHIIntegrator.Crossing)
    analysis.GibbsBoltzmannSampler(context)
