"""The schemes without momenta through Python: constants, settings, units, warnings, effects.

Numerical results are tested in tests/platform/TestOverdamped.cpp.
"""
import copy
import re

import numpy as np
import openmm
import pytest
from openmm import unit

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, app
from openmmrigidhi._quaternions import rotation_matrices
from openmmrigidhi.integrator import Scheme

#: The way in which each scheme makes the stochastic drift, in the words of getEffects(), and
#: whether it takes finite differences.
SCHEMES = {
    s.name: (s.traits.drift, s.traits.differenced != '')
    for s in Scheme if s.traits.isOverdamped and s.traits.drift
}
ALL = ('EulerMaruyama', *SCHEMES)


def scene(scheme, temperature=300, wall=False, bodies=1, groups=None, sites=None,
          solver=MobilityForce.Auto, stepSize=0.001, context=True):
    """Massless boomerangs of five blobs with origins at their cross points: (integrator, Context or
    System).
    """
    system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(
        temperature, stepSize)
    integrator.setScheme(getattr(CustomRigidHIIntegrator, scheme))
    integrator.setRandomNumberSeed(3)
    sites = np.asarray(app.boomerang(0.9, 2)._value if sites is None else sites)
    positions = []
    for body in range(bodies):
        app.addRigidMultiblob(system, integrator, fluid, sites, 0.5)
        positions.extend(sites + (4*body, 0, 3))
    if wall:
        fluid.setBoundary(MobilityForce.NoSlipWall)
    if groups is not None:
        fluid.setGroups(groups)
    fluid.setSolver(solver)
    system.addForce(fluid)
    if not context:
        return integrator, system
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions(positions)
    return integrator, context


@pytest.mark.parametrize('name', ALL)
def test_constants(name):
    """A scheme is a class attribute, and survives copies and XML."""
    integrator = CustomRigidHIIntegrator(300, 0.001)
    scheme = getattr(CustomRigidHIIntegrator, name)
    integrator.setScheme(scheme)
    assert integrator.getScheme() is scheme and scheme.name == name
    read = openmm.XmlSerializer.deserialize(openmm.XmlSerializer.serialize(integrator))
    assert CustomRigidHIIntegrator.cast(read).getScheme() is scheme
    assert CustomRigidHIIntegrator.cast(copy.copy(integrator)).getScheme() is scheme


def test_constants_are_different():
    assert sorted(int(getattr(CustomRigidHIIntegrator, name)) for name in ALL) == list(range(5, 12))
    with pytest.raises((TypeError, openmm.OpenMMException), match='scheme'):
        CustomRigidHIIntegrator(300, 0.001).setScheme(12)


def test_finite_difference_step():
    integrator = CustomRigidHIIntegrator(300, 0.001)
    assert integrator.getFiniteDifferenceStep() == 0
    for good in (0, 1e-6, 0.1, 1e-4*unit.dimensionless, 1e-3*unit.nanometer/unit.nanometer):
        integrator.setFiniteDifferenceStep(good)
        assert integrator.getFiniteDifferenceStep() == getattr(good, '_value', good)
    for wrong in ('small', None, [1e-5], 1e-5*unit.nanometer, 1e-5*unit.radian*unit.picosecond):
        with pytest.raises(TypeError, match='setFiniteDifferenceStep'):
            integrator.setFiniteDifferenceStep(wrong)
    for outside in (-1e-5, 0.11, np.inf, np.nan):
        with pytest.raises(openmm.OpenMMException, match='setFiniteDifferenceStep.*relative'):
            integrator.setFiniteDifferenceStep(outside)
    assert integrator.getFiniteDifferenceStep() == 1e-3


@pytest.mark.parametrize('name', ALL)
def test_run_with_units(name):
    """With quantities in micrometres, seconds and pascals the body moves as far in a step as its
    mobility says, and stays rigid."""
    integrator, system = scene(name, wall=True, sites=app.boomerang(0.3*unit.micrometer, 2)._value,
                               stepSize=0.001*unit.second, context=False)
    fluid = MobilityForce.cast(system.getForce(0))
    fluid.setViscosity(8.9e-4*unit.pascal*unit.second)
    for particle in range(system.getNumParticles()):
        fluid.setParticleRadius(particle, 0.15*unit.micrometer)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    start = np.asarray(app.boomerang(0.3*unit.micrometer, 2)._value) + (0, 0, 3000)
    squares = []
    for _ in range(100):
        context.setPositions(start)
        integrator.step(1)
        squares.append((integrator.getBodyPositions()/unit.micrometer)[0] - (0, 0, 3))
    positions = context.getState(getPositions=True).getPositions(asNumpy=True).value_in_unit(
        unit.nanometer)
    between = positions[:, None] - positions[None]
    assert np.allclose((between**2).sum(axis=2), ((start[:, None] - start[None])**2).sum(axis=2),
                       rtol=1e-10)
    context.setPositions(start)
    mobility = fluid.getMobilityInContext(context)[:3, :3]
    expected = 2*1e9*300*8.31446261815324e-3*np.trace(mobility)*1e-6  # um^2
    measured = np.mean(np.square(squares).sum(axis=1))
    # The square of a step has a standard deviation of 1.1 of its mean (measured for the drift
    # corrector; 0.82 for other schemes), so this is 4.5 standard errors.
    print(measured/expected)
    assert abs(measured/expected - 1) < 0.5
    assert not integrator.getBodyVelocities()._value.any() and integrator.getDegreesOfFreedom(
    )['total'] == 0


def warningsOf(scheme_, temperature, capfd):
    """The text on standard error while steps, step sizes and schemes change back and forth."""
    capfd.readouterr()
    integrator, context = scene(scheme_, temperature, wall=True)
    for stepSize in (0.001, 0.0005, 0.001):
        integrator.setStepSize(stepSize)
        integrator.step(2)
        integrator.setScheme(CustomRigidHIIntegrator.FixmanMidpoint)
        integrator.step(1)
        integrator.setScheme(getattr(CustomRigidHIIntegrator, scheme_))
    assert context.getState().getStepCount() == 9
    return capfd.readouterr().err


def test_euler_maruyama_warns_once(capfd):
    """The warning is printed once for a Context, and not if the scheme omits nothing."""
    warning = 'EulerMaruyama omits the stochastic drift kT div N'
    assert warningsOf('EulerMaruyama', 300, capfd).count(warning) == 1
    assert warningsOf('EulerMaruyama', 300, capfd).count(warning) == 1
    assert warningsOf('EulerMaruyama', 0, capfd) == ''


@pytest.mark.parametrize('platform', ['Reference', 'CPU'])
@pytest.mark.parametrize('case, warns', [('spheres', False), ('free draining', False),
                                         ('free', False), ('alone', False), ('wall', True),
                                         ('off its origin', True), ('lubrication', True),
                                         ('alone off its centre', True)])
def test_euler_maruyama_warns_where_it_is_wrong(case, warns, platform, capfd):
    """If div N = 0 nothing is omitted, as for spheres in an unbounded fluid, and for a body alone
    about its centre of mobility."""
    system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(
        300, 0.001)
    integrator.setScheme(CustomRigidHIIntegrator.EulerMaruyama)
    sites = {
        'off its origin': [(0.1, 0, 0)],
        'alone': [(-1, 0, 0), (1, 0, 0)],
        'alone off its centre': [(0, 0, 0), (1, 0.5, 0), (0, 1, 0)]
    }.get(case, [(0, 0, 0)])
    positions = []
    for body in range(1 if case.startswith('alone') else 3):
        if case == 'free':
            system.addParticle(0)
            fluid.addParticle(0.5 + 0.1*body)
        else:
            app.addRigidMultiblob(system, integrator, fluid, sites, 0.5 + 0.1*body)
        positions.extend(np.array(sites) + (1.5*body, 0, 3))
    if case == 'wall':
        fluid.setBoundary(MobilityForce.NoSlipWall)
    if case == 'free draining':
        fluid.setModel(MobilityForce.FreeDraining)
    if case == 'lubrication':
        fluid.setModel(MobilityForce.StokesianDynamics)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platform))
    context.setPositions(positions)
    integrator.step(1)
    printed = capfd.readouterr().err
    assert ('EulerMaruyama omits the stochastic drift' in printed) == warns, printed
    assert integrator.getEffects()['warnings'].startswith('on' if warns else 'off')
    assert integrator.getEffects()['stochastic drift'].startswith(
        'off: EulerMaruyama omits it' if warns else 'off: ')


@pytest.mark.parametrize('name', SCHEMES)
def test_other_schemes_do_not_warn(name, capfd):
    assert warningsOf(name, 300, capfd) == ''


@pytest.mark.parametrize('name', SCHEMES)
def test_effects_of_the_drift(name):
    """The effects that are on, and the reasons, agree with the counters."""
    how, hasDifferences = SCHEMES[name]
    integrator, _ = scene(name, wall=True)
    effects = integrator.getEffects()
    print(integrator.describeEffects())
    assert effects['stochastic drift'].startswith(
        'on: ' + how) and effects['stochastic drift'].endswith('for 1 group of bodies')
    assert effects['finite differences'] == ('on: steps of 1e-05 body lengths, and radians'
                                             if hasDifferences else 'off: the scheme has none')
    assert effects['hydrodynamic interactions'] == (
        'off: no bodies or free particles interact through the fluid, but each of them interacts '
        'with the wall')
    assert effects['noise'] == 'on: temperature 300 K' and effects['momenta'].startswith('off')
    assert '1 group with dense matrices' in effects['hydrodynamics'] and effects[
        'rotation'].startswith('on: 1 body')
    integrator.step(2)
    assert integrator.getEffects() == effects
    integrator.setFiniteDifferenceStep(2e-4)
    assert not hasDifferences or integrator.getEffects(
    )['finite differences'] == 'on: steps of 0.0002 body lengths, and radians'
    integrator.setTemperature(0)
    cold = integrator.getEffects()
    assert cold['stochastic drift'] == 'off: the temperature is 0' and cold['noise'].startswith(
        'off')


def test_differences_of_two_lengths():
    """Where velocities come from iterations in one group alone, its differences are longer."""
    system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(
        300, 0.001)
    integrator.setScheme(CustomRigidHIIntegrator.RandomFiniteDifference)
    sites, positions = app.boomerang(0.9, 2)._value, []
    for body, own in enumerate(([[0, 0, 0]], sites, sites)):
        app.addRigidMultiblob(system, integrator, fluid, own, 0.5)
        positions.extend(np.array(own) + (4*body, 0, 3))
    fluid.setBoundary(MobilityForce.NoSlipWall)
    fluid.setGroups([0, 1, 1])
    fluid.setSolver(MobilityForce.MatrixFree)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions(positions)
    # The velocities of the sphere are products with a formula, although its group has no matrix.
    assert integrator.getEffects()['finite differences'] == (
        'on: steps of 1e-05 of exact results and 0.01 of results of iterations, in body lengths, '
        'and radians')


@pytest.mark.parametrize('name', SCHEMES)
def test_effects_of_constant_mobility(name):
    """One body in unbounded fluid needs no finite differences. About its centre of mobility it has
    no drift."""
    hasDifferences = SCHEMES[name][1]
    integrator, context = scene(name, bodies=2, groups=[0, 1])
    offCentre = integrator.getEffects()
    assert context
    assert offCentre['stochastic drift'] == (
        'on: without differences for 2 groups of bodies alone in a uniform fluid'
        if hasDifferences else 'on: by the mobility at the mid-point for 2 groups of bodies')
    assert offCentre['finite differences'].startswith('off')
    integrator, _ = scene(name, sites=[(0, 0, -0.6), (0, 0, 0.6)])
    rod = integrator.getEffects()
    assert rod['stochastic drift'] == ('off: every body is alone in a uniform fluid, '
                                       'and the drift is 0 about their origins')
    assert '; 1 has its blobs on a line and does not rotate' in rod[
        'rotation'] and '1 alone with a constant tensor' in rod['hydrodynamics']
    before = integrator.getStepStatistics()
    integrator.step(5)
    after = integrator.getStepStatistics()
    assert after['mobilityProducts'] == before['mobilityProducts'] and after['squareRoots'] == 0


def test_effects_of_euler_maruyama():
    integrator, _ = scene('EulerMaruyama', bodies=2)
    effects = integrator.getEffects()
    assert effects['stochastic drift'] == ('off: EulerMaruyama omits it, '
                                           'so averages are wrong for 1 group of bodies')
    assert effects['warnings'].startswith('on: EulerMaruyama omits the stochastic drift')
    assert effects['hydrodynamic interactions'].startswith('on: 2 bodies')


def test_effects_matrix_free():
    """The finite-difference step grows with the solver's tolerance. Here it is the cube root of
    1e-6."""
    integrator, _ = scene('RandomFiniteDifference', bodies=2, solver=MobilityForce.MatrixFree)
    effects = integrator.getEffects()
    assert effects['finite differences'] == 'on: steps of 0.01 body lengths, and radians'
    assert '1 group matrix-free' in effects['hydrodynamics']


def test_effects_of_other_schemes():
    """The effects name drift and differences for all schemes. With momenta or a constant mobility
    they are off."""
    integrator = CustomRigidHIIntegrator(300, 0.001)
    system = openmm.System()
    system.addParticle(1)
    integrator.addRigidBody([0], 1, (1, 1, 1), [(0, 0, 0)])
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions([(0, 0, 0)])
    assert integrator.getEffects()['stochastic drift'].startswith('off: the scheme has momenta')
    integrator.setScheme(CustomRigidHIIntegrator.GradientThermostat)
    assert integrator.getEffects(
    )['stochastic drift'] == 'off: the mobility does not depend on poses'
    assert integrator.getEffects()['finite differences'] == 'off: the scheme has none'


def test_effects_before_positions():
    """The drift is unknown before there are positions, for bodies whose geometry the positions
    define."""
    integrator, system = scene('TrapezoidalSlip', wall=True, context=False)
    again = CustomRigidHIIntegrator(300, 0.001)
    again.setScheme(integrator.getScheme())
    again.addRigidBody(range(system.getNumParticles()))
    context = openmm.Context(system, again, openmm.Platform.getPlatformByName('Reference'))
    assert context and again.getEffects()['stochastic drift'] == 'off: positions are not set yet'


def test_temperature_is_not_available():
    integrator, _ = scene('FixmanMidpoint')
    integrator.step(1)
    assert integrator.computeTranslationalKineticEnergy()._value == 0
    with pytest.raises(openmm.OpenMMException, match='momenta'):
        integrator.computeSystemTemperature()


def atOnePlace(sites, radii, bodies=1):
    """Bodies at one place above a wall: (integrator, Context)."""
    system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(
        300, 0.001)
    integrator.setScheme(CustomRigidHIIntegrator.RandomFiniteDifference)
    fluid.setBoundary(MobilityForce.NoSlipWall)
    for _ in range(bodies):
        app.addRigidMultiblob(system, integrator, fluid, sites, radii)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions(np.tile(np.asarray(sites) + (0, 0, 3), (bodies, 1)))
    return integrator, context


def test_blobs_at_one_place():
    """Blobs at one place are refused. Two of one radius would move alike under any forces, and
    concentric blobs of two radii do not resist rotation."""
    integrator, context = atOnePlace([(0, 0, 0), (1, 0, 0), (0, 1, 0)], 0.5, bodies=2)
    with pytest.raises(
            openmm.OpenMMException, match=
            r'particle 0 \(body 0\) and particle 3 \(body 1\), both of radius 0.5 nm, are at the '
            r'same'):
        integrator.step(1)
    assert context.getState().getStepCount() == 0
    with pytest.raises(openmm.OpenMMException,
                       match='body 0: its 2 hydrodynamic particles are all at one place'):
        atOnePlace([(0, 0, 0), (0, 0, 0)], (0.5, 0.3))


def test_a_virtual_site_with_a_radius():
    """A virtual site outside of bodies may have no radius, because its motion is not defined by the
    fluid."""
    system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(
        300, 0.001)
    integrator.setScheme(CustomRigidHIIntegrator.FixmanMidpoint)
    for _ in range(3):
        system.addParticle(0)
        fluid.addParticle(0.4)
    system.setVirtualSite(2, openmm.TwoParticleAverageSite(0, 1, 0.5, 0.5))
    system.addForce(fluid)
    context = None
    with pytest.raises(
            openmm.OpenMMException, match=
            'particle 2 has hydrodynamic radius 0.4.* is a virtual site in no body, which the fluid'
    ):
        context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
        context.setPositions([(0, 0, 0), (2, 0, 0), (1, 0, 0)])
        integrator.step(1)
    assert context is None or context.getState().getStepCount() == 0


# ---- Steps without noise that forces make unstable -----------------------------------------------


def trapped(positions, scheme, relaxation):
    """Spheres of RPY in equal traps at T = 0, with the step over the shortest time of relaxation
    (of all together), and that of a sphere alone."""
    system, fluid = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(0, 1e-3)
    integrator.setScheme(scheme)
    trap = openmm.CustomExternalForce('k/2*((x-x0)^2+(y-y0)^2+(z-z0)^2)')
    trap.addGlobalParameter('k', 0)
    for name in ('x0', 'y0', 'z0'):
        trap.addPerParticleParameter(name)
    for i, place in enumerate(positions):
        app.addRigidMultiblob(system, integrator, fluid, [(0, 0, 0)], 1.0)
        trap.addParticle(i, place)
    system.addForce(fluid)
    system.addForce(trap)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions(positions)
    rows = np.arange(6*len(positions)).reshape(-1, 6)[:, :3].ravel()
    mobility = np.asarray(fluid.getMobilityInContext(context))[np.ix_(rows, rows)]
    k = relaxation/(np.linalg.eigvalsh(mobility)[-1]*1e-3)
    context.setParameter('k', k)
    random = np.random.default_rng(4)
    context.setPositions(positions + 1e-3*random.normal(size=np.shape(positions)))
    return integrator, context, k*mobility[0, 0]*1e-3


def test_spheres_that_relax_together_are_warned_of():
    """Touching spheres relax together many times as fast as one alone."""
    lattice = 2.0*np.stack(np.meshgrid(*[range(3)]*3), axis=-1).reshape(-1, 3)
    integrator, _context, alone = trapped(lattice, 'EulerMaruyama', 1.95)
    assert alone < 0.4
    integrator.step(400)
    text = integrator.getEffects()['warnings']
    assert 'relaxes in the forces on it' in text
    assert float(re.search('ps is ([0-9.]+) times', text)[1]) == pytest.approx(1.95, rel=0.05)


def test_spheres_that_relax_slowly_together_are_not_warned_of():
    """Of two that touch, a bond moves each less than if it were alone."""
    integrator, context, _ = trapped(np.array([(0., 0, 0), (2, 0, 0)]), 'EulerMaruyama', 1e-9)
    bond = openmm.HarmonicBondForce()
    mobility = 1/(6*np.pi*MobilityForce().getViscosity()._value)
    bond.addBond(0, 1, 2.0, 0.6/(mobility*1e-3))
    context.getSystem().addForce(bond)
    context.reinitialize()
    context.setPositions([(-0.1, 0, 0), (2.1, 0, 0)])
    integrator.step(40)
    assert 'relaxes in the forces on it' not in integrator.getEffects()['warnings']


@pytest.mark.parametrize('along', [0, 1])
def test_a_turned_rod_relaxes_by_its_mobility_along_the_force(along):
    """With forces at a mid-point the measure needs the rod's own friction in the frame of the body:
    along the axis a rod is 1.5 times as mobile as across."""
    system, fluid = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(0, 1e-3)
    integrator.setScheme('FixmanMidpoint')
    app.addRigidMultiblob(system, integrator, fluid, app.rod(7, 1.0), 0.5)
    q = np.array([0.8, 0.2, -0.5, 0.3])/np.linalg.norm([0.8, 0.2, -0.5, 0.3])
    n = rotation_matrices(q)[:, along]  # the rod is along the body's x axis
    trap = openmm.CustomExternalForce('k/2*(nx*x+ny*y+nz*z)^2')
    trap.addGlobalParameter('k', 0)
    for name, value in zip(('nx', 'ny', 'nz'), n):
        trap.addGlobalParameter(name, value)
    trap.addParticle(3, [])  # the middle one, so that no torque acts
    system.addForce(fluid)
    system.addForce(trap)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    app.placeBodies(context, [0.1*n], [q])
    mobility = np.asarray(fluid.getMobilityInContext(context))[:3, :3]
    assert np.linalg.eigvalsh(mobility)[-1] > 1.3*np.linalg.eigvalsh(mobility)[0]
    context.setParameter('k', 1.9/(n @ mobility @ n*1e-3))
    integrator.step(300)
    text = integrator.getEffects()['warnings']
    assert float(re.search('ps is ([0-9.]+) times', text)[1]) == pytest.approx(1.9, rel=0.01)
