"""Products by multipoles through the public API: answers and steps of many particles, and the
setting that turns these products off."""
import numpy as np
import openmm
import pytest

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, app


def manySpheres(count, edge, boundary, tolerance, fast, free=False, platform='CPU'):
    """A Context with spheres at random in a cube above z = 0, as bodies or free particles, at T =
    0. A force pulls each sphere."""
    random = np.random.default_rng(3)
    positions = random.uniform(0, edge, (count, 3)) + (0, 0, 1)
    system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(0, 0.01)
    integrator.setScheme(CustomRigidHIIntegrator.EulerMaruyama)
    pull = openmm.CustomExternalForce('-fx*x-fz*z')
    pull.addPerParticleParameter('fx')
    pull.addPerParticleParameter('fz')
    for k in range(count):
        index = system.addParticle(1 if free else 0)
        fluid.addParticle(1)
        pull.addParticle(index, random.normal(size=2))
        if not free:
            integrator.addRigidBody([index], 0, (0, 0, 0), [(0, 0, 0)])
    system.addForce(pull)
    fluid.setBoundary(boundary)
    fluid.setSolver(MobilityForce.MatrixFree)
    fluid.setSolverTolerance(tolerance)
    fluid.setFastSummation(fast)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platform))
    context.setPositions(positions)
    return context, fluid, integrator


@pytest.mark.parametrize('boundary, count', [(MobilityForce.Unbounded, 6500),
                                             (MobilityForce.NoSlipWall, 4500)])
def test_answers_to_the_tolerance(boundary, count):
    wrenches = np.random.default_rng(4).normal(size=(count, 6))
    answers, effects = {}, {}
    for fast in (True, False):
        context, fluid, integrator = manySpheres(count, 70, boundary, 1e-2, fast)
        answers[fast] = fluid.applyMobilityInContext(context, wrenches)
        effects[fast] = str(integrator.getEffects()['mobilities asked for'])
    error = np.linalg.norm(answers[True] - answers[False])/np.linalg.norm(answers[False])
    assert 1e-6 < error < 1e-2
    assert 'by multipoles of order 4' in effects[True] and 'multipoles' not in effects[False]


def test_few_particles_and_the_default_tolerance_are_summed_over_pairs():
    for count, tolerance in ((1000, 1e-2), (7000, 1e-6)):
        answers = []
        for fast in (True, False):
            context, fluid, integrator = manySpheres(count, 70, MobilityForce.Unbounded, tolerance,
                                                     fast)
            answers.append(fluid.applyMobilityInContext(context, np.ones((count, 6))))
            assert 'multipoles' not in str(integrator.getEffects())
        assert np.array_equal(*answers)


def test_forces_in_a_step():
    moved = {}
    for fast in (True, False):
        context, _, integrator = manySpheres(10500, 90, MobilityForce.Unbounded, 0.1, fast,
                                             free=True)
        before = context.getState(getPositions=True).getPositions(asNumpy=True)._value
        integrator.step(1)
        moved[fast] = context.getState(getPositions=True).getPositions(asNumpy=True)._value - before
    # The solver's tolerance is 0.1, and the error must be below a hundredth of it.
    error = np.linalg.norm(moved[True] - moved[False])/np.linalg.norm(moved[False])
    assert 1e-7 < error < 1e-3


def test_effects_say_after_a_step_of_langevin_hi_what_they_said_before():
    context, _, integrator = manySpheres(10500, 90, MobilityForce.Unbounded, 0.1, True, free=True)
    integrator.setScheme(CustomRigidHIIntegrator.LangevinHI)
    before = str(integrator.getEffects()['hydrodynamics'])
    integrator.step(1)
    assert str(integrator.getEffects()['hydrodynamics']) == before
    assert 'by multipoles' in before


def test_reference_sums_over_pairs():
    context, fluid, integrator = manySpheres(100, 20, MobilityForce.Unbounded, 1e-2, True,
                                             platform='Reference')
    assert fluid.getFastSummation() is True and 'multipoles' not in str(integrator.getEffects())


def noisyStep(scheme, blobs, boundary, tolerance, fast, count, platform='CPU'):
    """Displacements in a step with noise, and the description of the fluid. Bodies are single
    spheres with torques, or tetrahedra of touching blobs, on a lattice with random shifts."""
    random = np.random.default_rng(5)
    sites = np.array([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)])/np.sqrt(2)
    sites = sites[:blobs] - sites[:blobs].mean(axis=0)
    bodies, spacing = count // blobs, 4.0*blobs**(1/3)
    side = int(np.ceil(bodies**(1/3)))
    centres = spacing*(np.array(list(np.ndindex(side, side, side)))[:bodies] + 0.8)
    centres += random.uniform(-0.3, 0.3, centres.shape)
    system, fluid = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(300, 1e-3)
    integrator.setRandomNumberSeed(2)
    integrator.setScheme(scheme)
    for _ in range(bodies):
        app.addRigidMultiblob(system, integrator, fluid, sites, 1.0, 100.0, (60.0, 60.0, 60.0))
    system.addForce(fluid)
    fluid.setBoundary(boundary)
    fluid.setSolver(MobilityForce.MatrixFree)
    fluid.setSolverTolerance(tolerance)
    fluid.setFastSummation(fast)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platform))
    context.setPositions((centres[:, None] + sites).reshape(-1, 3))
    before = np.array(integrator.getBodyPositions()._value)
    effects = str(integrator.getEffects()['hydrodynamics'])
    integrator.step(1)
    return np.array(integrator.getBodyPositions()._value) - before, effects


SCHEMES = CustomRigidHIIntegrator


@pytest.mark.parametrize(
    'scheme, blobs, boundary, tolerance',
    [(SCHEMES.EulerMaruyama, 1, MobilityForce.Unbounded, 0.1),
     # Steps of the two schemes below it contain what this one does.
     pytest.param(SCHEMES.EulerMaruyama, 1, MobilityForce.NoSlipWall, 0.1, marks=pytest.mark.full),
     (SCHEMES.LangevinHI, 1, MobilityForce.Unbounded, 1e-2),
     (SCHEMES.RandomFiniteDifference, 1, MobilityForce.NoSlipWall, 0.1),
     # Quick above the wall, and spheres are quick without a wall.
     pytest.param(SCHEMES.TrapezoidalSlip, 4, MobilityForce.Unbounded, 0.1, marks=pytest.mark.full),
     (SCHEMES.TrapezoidalSlip, 4, MobilityForce.NoSlipWall, 0.1),
     (SCHEMES.TractionEulerMaruyama, 4, MobilityForce.NoSlipWall, 0.1)])
def test_iterations_to_the_tolerance(scheme, blobs, boundary, tolerance):
    """Products by multipoles are as coarse as the tolerance allows, and the same noise moves bodies
    by the same amounts, to the tolerance."""
    count = 6400 if boundary == MobilityForce.NoSlipWall else 10500
    moved, effects = {}, {}
    for fast in (True, False):
        moved[fast], effects[fast] = noisyStep(scheme, blobs, boundary, tolerance, fast, count)
    error = np.linalg.norm(moved[True] - moved[False])/np.linalg.norm(moved[False])
    print(f'error {error:.2g} at a tolerance of {tolerance}; {effects[True][-60:]}')
    assert 1e-9 < error < tolerance
    assert 'by multipoles' in effects[True] and 'multipoles' not in effects[False]


def test_iterated_results_that_are_differenced_have_no_multipoles():
    moved = [
        noisyStep(SCHEMES.RandomFiniteDifference, 4, MobilityForce.NoSlipWall, 0.1, fast, 6400)
        for fast in (True, False)
    ]
    assert np.array_equal(moved[0][0], moved[1][0]) and 'multipoles' not in moved[0][1]


def test_results_after_differences_have_multipoles():
    """The drift-corrector differences roots at the start, and no result of the mid-point."""
    moved = [
        noisyStep(SCHEMES.DriftCorrectorRFD, 4, MobilityForce.NoSlipWall, 0.1, fast, 6400)
        for fast in (True, False)
    ]
    error = np.linalg.norm(moved[0][0] - moved[1][0])/np.linalg.norm(moved[1][0])
    print(f'error {error:.2g}; {moved[0][1][-120:]}')
    assert 1e-9 < error < 0.1
    assert 'over all pairs for differences, then by multipoles' in moved[0][1]
