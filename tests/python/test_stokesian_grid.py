"""StokesianDynamics of a periodic fluid with the solver MatrixFree.

Products, solves, noise and drift are tested by themselves in
tests/unit/TestStokesianDynamicsGrid.cpp.
"""
import re
import warnings

import numpy as np
import openmm
import pytest

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce

PLATFORMS = ['Reference', 'CPU']
REACH = (3, 4)


def refused(*pieces):
    """Expect an error whose message has all the pieces, in this order."""
    return pytest.raises(openmm.OpenMMException,
                         match='.*'.join(re.escape(piece) for piece in pieces))


def suspension(number=16, edge=8.0, gap=0.01, seed=1):
    """Positions and radii of spheres that do not overlap."""
    random = np.random.default_rng(seed)
    positions, radii = [], []
    while len(positions) < number:
        x, a = random.uniform(0, edge, 3), 1 + 0.3*(len(positions) % 2)
        apart = np.array(positions).reshape(-1, 3) - x
        apart -= edge*np.round(apart/edge)
        if np.all(np.linalg.norm(apart, axis=1) > (1 + gap/2)*(np.array(radii) + a)):
            positions.append(x)
            radii.append(a)
    return positions, radii


def scene(solver='MatrixFree', scheme='TractionEulerMaruyama', tolerance=1e-6, temperature=0.0,
          step=1e-3, platform='Reference', boundary='Periodic', edge=8.0, reach=REACH, spheres=None,
          threads=None, mass=0, offset=(0, 0, 0), context=True, **more):
    """(fluid, integrator, Context)"""
    positions, radii = spheres or suspension(edge=edge)
    system, fluid = openmm.System(), MobilityForce()
    system.setDefaultPeriodicBoxVectors(*np.diag([edge]*3))
    integrator = CustomRigidHIIntegrator(temperature, step)
    integrator.setScheme(scheme)
    integrator.setRandomNumberSeed(5)
    fluid.setViscosity(1)
    fluid.setModel('StokesianDynamics')
    fluid.setBoundary(boundary)
    fluid.setSolver(solver)
    fluid.setSolverTolerance(tolerance)
    if reach is not None:
        fluid.setLubricationReach(*reach)
    for name, value in more.items():
        owner = fluid if hasattr(fluid, name) else integrator
        getattr(owner, name)(*(value if isinstance(value, tuple) else (value,)))
    force = openmm.CustomExternalForce('-3*x*sin(7*i) - 3*y*sin(8*i + 1) - 3*z*sin(9*i + 2)')
    force.addPerParticleParameter('i')
    for i, radius in enumerate(radii):
        system.addParticle(0)
        fluid.addParticle(radius)
        force.addParticle(i, [i])
        integrator.addRigidBody([i], mass, (mass,)*3, [offset if i == 0 else (0, 0, 0)])
    system.addForce(fluid)
    system.addForce(force)
    properties = {} if threads is None else {'Threads': str(threads)}
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platform),
                             properties)
    context.setPositions(
        np.array(positions) + np.array(offset)*(np.arange(len(radii)) == 0)[:, None])
    return fluid, integrator, context


@pytest.mark.parametrize('platform', PLATFORMS)
@pytest.mark.parametrize('scheme', [
    'TractionEulerMaruyama', 'TrapezoidalSlip', 'FixmanMidpoint', 'RandomFiniteDifference',
    'EulerMaruyama'
])
def test_steps_without_noise_are_those_of_matrices(scheme, platform):
    found = []
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        for solver in ('Dense', 'MatrixFree'):
            _, integrator, _ = scene(solver, scheme, 1e-7, platform=platform, step=1e-2)
            start = integrator.getBodyPositions()._value
            integrator.step(2)
            found.append(integrator.getBodyPositions()._value - start)
            assert integrator.getStepStatistics()['randomNumbers'] == 0
    assert np.abs(found[0]).max() > 1e-3
    np.testing.assert_allclose(found[1], found[0], atol=1e-6*np.abs(found[0]).max())


@pytest.mark.parametrize('scheme', [
    'TractionEulerMaruyama', 'TrapezoidalSlip', 'FixmanMidpoint', 'RandomFiniteDifference',
    'EulerMaruyama'
])
def test_covariance_of_steps(scheme):
    """A short step has the covariance 2 kT h N of matrices, also after the solves of a scheme."""
    spheres = ([(0, 0, 0), (2.3, 0.2, 0.1)], [1, 1.2])
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        fluid, integrator, context = scene('Dense', scheme, spheres=spheres, edge=6)
        N = fluid.getMobilityInContext(context)
        fluid, integrator, context = scene('MatrixFree', scheme, 1e-2, 300, 1e-9, spheres=spheres,
                                           edge=6)
        kT = 0.00831446261815324*300
        start = integrator.getBodyPositions()._value
        moves = []
        for k in range(400):
            integrator.step(1)
            now = integrator.getBodyPositions()._value
            moves.append((now - start).ravel())
            start = now
    rows = [0, 1, 2, 6, 7, 8]
    root = np.linalg.inv(np.linalg.cholesky(2*kT*1e-9*N[np.ix_(rows, rows)]))
    white = np.array(moves) @ root.T
    covariance = white.T @ white/len(moves)
    np.testing.assert_allclose(covariance, np.eye(6), atol=5*np.sqrt(2/len(moves)))


@pytest.mark.parametrize('platform', PLATFORMS)
@pytest.mark.parametrize('scheme', ['TractionEulerMaruyama', 'TrapezoidalSlip', 'FixmanMidpoint'])
def test_noise_does_not_depend_on_how_a_run_is_cut(scheme, platform):
    ends = []
    for cut in (False, True):
        more = dict(scheme=scheme, tolerance=1e-3, temperature=300, step=1e-4, platform=platform)
        _, integrator, context = scene(**more)
        integrator.step(2)
        if cut:
            saved = context.createCheckpoint()
            _, integrator, context = scene(**more)
            context.loadCheckpoint(saved)
        integrator.step(2)
        ends.append(integrator.getBodyPositions()._value)
    np.testing.assert_array_equal(*ends)


def test_threads_do_not_change_a_bit():
    ends = []
    for threads in (1, 3):
        _, integrator, _ = scene(tolerance=1e-3, temperature=300, step=1e-4, platform='CPU',
                                 threads=threads)
        integrator.step(3)
        ends.append(integrator.getBodyPositions()._value)
    np.testing.assert_array_equal(*ends)


def test_overlaps_are_redone():
    _, integrator, _ = scene(spheres=([(0, 0, 0), (2.003, 0, 0)], [1, 1]), temperature=300,
                             step=0.05, tolerance=1e-3)
    integrator.step(20)
    assert integrator.getNumRejectedSteps() > 0
    x = integrator.getBodyPositions()._value
    d = x[0] - x[1]
    assert np.linalg.norm(d - 8*np.round(d/8)) > 2


def test_answers_and_flows_are_those_of_matrices():
    """Velocities of wrenches, and every part of the stress: the Brownian one is a difference of
    solves.
    """
    answers = []
    for solver in ('Dense', 'MatrixFree'):
        fluid, integrator, context = scene(solver, tolerance=1e-8, temperature=300,
                                           setSinusoidalForceDensity=(0.5, 0, 1, 1))
        wrenches = np.sin(1 + np.arange(96)).reshape(16, 6)
        answers.append([np.array(fluid.applyMobilityInContext(context, wrenches))] +
                       [part._value for part in fluid.getStressInContext(context)])
        integrator.setTemperature(0)
        integrator.step(1)
        answers[-1].append(integrator.getBodyPositions()._value)
    assert len(answers[0]) == 6
    for right, found in zip(*answers):
        assert np.abs(right).max() > 0
        np.testing.assert_allclose(found, right, atol=1e-5*np.abs(right).max())


def test_flow_at_points():
    """No data of steps are kept, so that the flow is that of forces at the present positions, and
    there is none of noise.
    """
    points = [(0.1, 0.2, 0.3), (4, 4, 4)]
    flows = []
    for solver in ('Dense', 'MatrixFree'):
        fluid, integrator, context = scene(solver, tolerance=1e-8, step=1e-9)
        integrator.step(1)
        flows.append(np.array(fluid.getFlowInContext(context, points)._value))
    np.testing.assert_allclose(flows[1], flows[0], atol=1e-6*np.abs(flows[0]).max())
    integrator.setTemperature(300)
    for ask in (lambda: fluid.getFlowInContext(context, points),
                lambda: fluid.getFlowModeInContext(context, 0, 1, 1)):
        with refused('InContext() includes the flow of the noise of a step',
                     'StokesianDynamics with solver MatrixFree does not keep', 'temperature 0',
                     'getStressInContext()', 'setSolver(Dense)'):
            ask()


def test_statistics_count_iterations():
    _, integrator, _ = scene(tolerance=1e-3, temperature=300, step=1e-4)
    integrator.step(1)
    statistics = integrator.getStepStatistics()
    assert statistics['randomNumbers'] > 0
    text = integrator.getEffects()['hydrodynamics']
    assert 'matrix-free' in text and 'on a grid of' in text
    assert 'lubrication of 16 spheres with each other and with images' in text


def test_reach_by_default():
    """It is shorter without matrices, and Auto never takes a grid, so that it never changes it."""
    positions = ([(0, 0, 0), (3.5, 0, 0)], [1, 1])
    answers = {}
    for solver, reach in (('MatrixFree', None), ('MatrixFree', (3, 4)), ('Dense', None),
                          ('Dense', (8, 10)), ('Auto', None)):
        fluid, _, context = scene(solver, reach=reach, spheres=positions, tolerance=1e-6)
        answers[solver, reach] = fluid.getMobilityInContext(context)
    np.testing.assert_array_equal(answers['MatrixFree', None], answers['MatrixFree', (3, 4)])
    np.testing.assert_array_equal(answers['Dense', None], answers['Dense', (8, 10)])
    np.testing.assert_array_equal(answers['Dense', None], answers['Auto', None])


@pytest.mark.parametrize('number, hint', [(24, True), (16, False)])
def test_auto_says_that_a_grid_takes_less_time(number, hint):
    """Auto keeps matrices, because the grid has another reach."""
    spheres = suspension(number, 10.0)
    for solver in ('Auto', 'MatrixFree'):
        _, integrator, context = scene(solver=solver, edge=10.0, spheres=spheres)
        assert context
        told = 'setSolver(MatrixFree) takes a fraction of' in integrator.getEffects(
        )['hydrodynamics']
        assert told == (hint and solver == 'Auto')


def test_what_cannot_go_together():
    start = 'model StokesianDynamics cannot be used with solver MatrixFree and '
    with refused(start + 'the minimum gap 0.01', 'setMinimumGap(0)'):
        scene(setMinimumGap=0.01)
    with refused(start + 'scheme LangevinHI', 'friction is stiff', 'setSolver(Dense)'):
        scene(scheme='LangevinHI', mass=1)
    for scheme in ('DriftCorrectorFD', 'DriftCorrectorRFD'):
        with refused(start + f'scheme {scheme}', 'TractionEulerMaruyama'):
            scene(scheme=scheme)
    with refused('solver MatrixFree cannot be used with model StokesianDynamics',
                 'setSolver(Dense)'):
        scene(boundary='Unbounded')
    with refused('model StokesianDynamics cannot be used with solver MatrixFree',
                 'their origin off the centre', 'setSolver(Dense)'):
        _, integrator, _ = scene(offset=(0.1, 0, 0))
        integrator.step(1)
