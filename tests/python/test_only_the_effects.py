"""A step computes only the effects that a scene calls for. The counters of getStepStatistics() show
what was not computed."""
import numpy as np
import openmm
import pytest

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, app

STEPS = 7


def scene(platform, model, temperature, bodies=3, blobs=0, solver=MobilityForce.Auto):
    """Spheres or multiblobs in a row: (integrator, Context)."""
    system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(
        temperature, 0.001)
    integrator.setScheme(CustomRigidHIIntegrator.LangevinHI)
    integrator.setRandomNumberSeed(1)
    fluid.setModel(model)
    fluid.setSolver(solver)
    sites, radius = np.zeros((1, 3)), 1.0
    if blobs:
        sites, radius = (x._value for x in app.multiblobSphere(blobs, 1.0))
    positions = []
    for body in range(bodies):
        integrator.addRigidBody([system.addParticle(0.0) for _ in sites], 100.0, (40.0, 40.0, 40.0),
                                sites)
        for _ in sites:
            fluid.addParticle(radius)
        positions.extend(sites + (3*body, 0.1*body, 0))
    system.addForce(fluid)
    context = openmm.Context(system, integrator, platform)
    context.setPositions(positions)
    integrator.setBodyVelocities(np.ones((bodies, 3)))
    return integrator, context


def counted(integrator, context):
    """The increments of the counters in STEPS steps of the Context's integrator.

    The step before them does the work that is done only once.
    """
    integrator.step(1)
    before = integrator.getStepStatistics()
    integrator.step(STEPS)
    after = integrator.getStepStatistics()
    result = {name: after[name] - before[name] for name in after}
    print(result)
    assert result['steps'] == result['forceEvaluations'] == STEPS
    return result


def test_free_draining_spheres_have_no_matrices(platform):
    integrator, context = scene(platform, MobilityForce.FreeDraining, 300)
    done = counted(integrator, context)
    assert done['mobilityProducts'] == done['squareRoots'] == done['solverIterations'] == 0
    assert done['seconds_mobility'] == 0
    assert done['randomNumbers'] == STEPS*3*6
    assert integrator.getEffects()['hydrodynamic interactions'].startswith('off')


@pytest.mark.parametrize(
    'model',
    (MobilityForce.FreeDraining, MobilityForce.RotnePragerYamakawa, MobilityForce.StokesianDynamics)
)
def test_no_noise_at_zero_temperature(platform, model):
    done = counted(*scene(platform, model, 0))
    assert done['randomNumbers'] == done['squareRoots'] == 0
    assert done['mobilityProducts'] == (0 if model == MobilityForce.FreeDraining else STEPS)


def test_no_noise_at_zero_temperature_matrix_free(platform):
    done = counted(
        *scene(platform, MobilityForce.RotnePragerYamakawa, 0, solver=MobilityForce.MatrixFree))
    assert done['randomNumbers'] == done['squareRoots'] == 0 < done['solverIterations']


def test_interactions_cost_one_matrix_and_one_root_a_step(platform):
    done = counted(*scene(platform, MobilityForce.RotnePragerYamakawa, 300))
    assert done['mobilityProducts'] == done['squareRoots'] == STEPS
    assert done['randomNumbers'] == STEPS*3*6 and done['solverIterations'] == 0


@pytest.mark.parametrize(
    'model',
    (MobilityForce.FreeDraining, MobilityForce.RotnePragerYamakawa, MobilityForce.StokesianDynamics)
)
@pytest.mark.parametrize('blobs', (0, 12))
def test_one_body_is_computed_once(platform, model, blobs):
    if blobs and model == MobilityForce.StokesianDynamics:
        pytest.skip('StokesianDynamics is for spheres')
    integrator, context = scene(platform, model, 300, bodies=1, blobs=blobs)
    assert counted(integrator, context)['mobilityProducts'] == 0
    # The mobility is not computed later either, wherever the body is.
    integrator.setBodyPositions([(5, 5, 5)])
    integrator.setBodyOrientations([(0.6, 0, 0.8, 0)])
    before = integrator.getStepStatistics()['mobilityProducts']
    integrator.step(3)
    assert integrator.getStepStatistics()['mobilityProducts'] == before


def test_free_draining_multiblobs_are_computed_once(platform):
    done = counted(*scene(platform, MobilityForce.FreeDraining, 300, blobs=12))
    assert done['mobilityProducts'] == done['solverIterations'] == 0


def test_one_sphere_needs_no_root_of_a_matrix(platform):
    done = counted(*scene(platform, MobilityForce.RotnePragerYamakawa, 300, bodies=1))
    assert done['squareRoots'] == 0 and done['randomNumbers'] == STEPS*6


def test_a_warning_is_printed_once_for_its_cause(capfd):
    """Temperatures and steps that change from run to run, as in annealing, change only the numbers
    in the warning. It is not printed again."""
    system = openmm.System()
    system.addParticle(1)
    integrator = CustomRigidHIIntegrator(300, 0.1)
    integrator.addRigidBody([0], 1, (0.3, 0.8, 1), [(0, 0, 0)])
    integrator.setScheme(integrator.LangevinA)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions([(0, 0, 0)])
    for k in range(10):
        integrator.setTemperature(300 + k)
        integrator.setStepSize(1 + 0.1*k)
        integrator.setFriction(200 + k)
        integrator.step(1)
    printed = capfd.readouterr().err
    assert printed.count('does not resolve the rotation') == 1 and printed.count(
        'LangevinA breaks down') == 1
    assert 'gamma 209' in integrator.getEffects()['warnings']


def test_warnings_of_steps_wait_for_a_step(capfd):
    """Who asks for matrices alone hears nothing of steps that are never taken."""
    system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(300, 1e4)
    integrator.setScheme(CustomRigidHIIntegrator.EulerMaruyama)
    fluid.setModel(MobilityForce.RotnePragerYamakawa)
    for _ in range(2):
        app.addRigidMultiblob(system, integrator, fluid, [(0, 0, 0)], 1.0)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions([(0, 0, 0), (3, 0, 0)])
    fluid.getMobilityInContext(context)
    assert 'moves at random' in integrator.getEffects()['warnings']
    assert capfd.readouterr().err == ''
    integrator.step(1)
    assert capfd.readouterr().err.count('moves at random') == 1
