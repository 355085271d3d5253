"""openmmrigidhi.analysis on exact motions, on random motions with known averages, and on the
mobilities of multiblobs."""
import re
import warnings

import numpy as np
import openmm
import openmm.app
import pytest
from openmm import unit

import openmmrigidhi
from openmmrigidhi import analysis, app
from openmmrigidhi._quaternions import product, rotation_matrices

KT = (unit.MOLAR_GAS_CONSTANT_R*300*unit.kelvin).value_in_unit(unit.kilojoule_per_mole)
#: 1 nm^2/ps in um^2/s, and 1/ps in 1/s.
MICROMETRES, SECONDS = 1e6, 1e12


def refused(*pieces, error=ValueError):
    return pytest.raises(error, match='.*'.join(re.escape(piece) for piece in pieces))


def turns(vectors):
    """Quaternions of rotation vectors."""
    angle = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle/2), 0.5*np.sinc(angle/(2*np.pi))*vectors], axis=-1)


def still(frames, bodies=1):
    """Orientations of bodies that do not turn."""
    return np.tile((1.0, 0, 0, 0), (frames, bodies, 1))


def numbers(quantity, unit_):
    return quantity.value_in_unit(unit_)


NM2 = unit.nanometer**2

# ---- Exact motions -------------------------------------------------------------------------------


def test_constant_velocity():
    times = 0.5*np.arange(100)
    velocity = np.array([1.0, -2, 0.5])
    R = (times[:, None]*velocity)[:, None]
    msd = analysis.translationalMSD(R, still(100), 0.5*unit.picosecond, (3, 4, 5), lags=[0, 1, 7],
                                    numBlocks=4)
    assert np.array_equal(numbers(msd.lagTimes, unit.picosecond), [0, 0.5, 3.5])
    expected = np.multiply.outer(np.array([0, 0.5, 3.5])**2, np.outer(velocity, velocity))
    assert np.allclose(numbers(msd.mean, NM2), expected, rtol=1e-12, atol=1e-12)
    assert np.allclose(numbers(msd.error, NM2), 0, atol=1e-12) and numbers(
        msd.blocks, NM2).shape == (4, 3, 3, 3)
    assert np.allclose(numbers(msd.parallel.mean, NM2), 5*np.array([0, 0.25, 12.25]))
    assert np.allclose(numbers(msd.perpendicular.mean, NM2), 0.25*np.array([0, 0.25, 12.25]))
    assert np.allclose(numbers(msd.trace.mean, NM2), 5.25*np.array([0, 0.25, 12.25]))
    assert np.allclose(numbers(msd.component([[0, 1, 0], [0, 0, 0], [0, 0, 0]]).mean, NM2),
                       -2*np.array([0, 0.25, 12.25]))


def test_displacements_along_body_axes():
    q = turns(np.array([0.4, -1.1, 0.7]))
    velocity = np.array([0.3, 0.2, -1])
    R = (np.arange(40)[:, None]*velocity)[:, None]
    msd = analysis.translationalMSD(R, np.tile(q, (40, 1, 1)), 1, (0, 0, 0), lags=[2], numBlocks=2,
                                    bodyFrame=True)
    inBody = rotation_matrices(q).T @ velocity
    assert np.allclose(numbers(msd.mean, NM2)[0], 4*np.outer(inBody, inBody), rtol=1e-12)


def test_lags_must_be_given():
    with pytest.raises(ValueError,
                       match='translationalMSD: lags: got none; at least one is needed'):
        analysis.translationalMSD(np.zeros((40, 1, 3)), still(40), 1, (0, 0, 0), lags=[])


def test_constant_rotation_about_different_points():
    rate, lags = 0.3, np.array([1, 5, 20, 60])
    q = turns(np.outer(rate*np.arange(400), (0, 0, 1)))[:, None]
    R = np.full((400, 1, 3), 7.0)
    for radius in (0, 0.5, 2):
        msd = analysis.translationalMSD(R, q, 1, (radius*0.6, -radius*0.8, 3)*unit.nanometer, lags,
                                        4)
        assert np.allclose(numbers(msd.parallel.mean, NM2), 2*radius**2*(1 - np.cos(rate*lags)),
                           atol=1e-12)
        assert np.allclose(numbers(msd.perpendicular.mean, NM2), 0, atol=1e-12)
    for bodyFrame in (False, True):
        msd = analysis.rotationalMSD(q, 1, lags, 4, bodyFrame=bodyFrame)
        assert np.allclose(msd.mean[:, 2, 2], np.sin(rate*lags)**2, atol=1e-12)
        assert np.allclose(msd.perpendicular.mean, msd.trace.mean, atol=1e-12)
    # The sign of a quaternion has no effect, and the planar angle goes on through full turns.
    q *= np.random.default_rng(1).choice((-1, 1), size=(400, 1, 1))
    assert np.allclose(analysis.rotationalMSD(q, 1, lags, 4).mean, msd.mean, atol=1e-12)
    planar = analysis.planarAngleMSD(q, 1, (1, 2, 30), lags, 4)
    assert np.allclose(planar.mean, (rate*lags)**2, rtol=1e-10)


def test_rotational_displacement_is_that_of_equation_20():
    random = np.random.default_rng(2)
    q = turns(random.normal(size=(2, 1, 3)))
    A = rotation_matrices(q)[:, 0]
    u = 0.5*np.cross(A[0].T, A[1].T).sum(axis=0)  # body axes are the columns
    expected = np.outer(u, u)
    q = np.tile(q, (4, 1, 1))  # four blocks of the two frames
    assert np.allclose(analysis.rotationalMSD(q, 1, [1], 4).mean[0], expected, rtol=1e-12)
    inBody = A[0].T @ expected @ A[0]
    assert np.allclose(
        analysis.rotationalMSD(q, 1, [1], 4, bodyFrame=True).mean[0], inBody, rtol=1e-12)


def test_frames_beyond_whole_blocks_are_left_out_at_the_start():
    R = np.zeros((23, 1, 3))
    R[:3] = 1e6
    assert np.all(
        numbers(analysis.translationalMSD(R, still(23), 1, (0, 0, 0), numBlocks=4).mean, NM2) == 0)


def test_from_a_file_of_body_states(tmp_path):
    """Files of RigidBodyReporter go into the functions as they are read. A body without forces
    moves along a straight line."""
    system, integrator = openmm.System(), openmmrigidhi.CustomRigidHIIntegrator(0, 0.002)
    for _ in range(2):
        system.addParticle(10)
    integrator.addRigidBody([0, 1])
    integrator.setFriction(0)
    integrator.setRotationalFriction(0)
    topology = openmm.app.Topology()
    residue = topology.addResidue('AB', topology.addChain())
    for name in 'AB':
        topology.addAtom(name, None, residue)
    simulation = openmm.app.Simulation(topology, system, integrator,
                                       openmm.Platform.getPlatformByName('Reference'))
    simulation.context.setPositions([(0, 0, 0), (0.1, 0, 0)])
    simulation.context.setVelocities([(1, 2, 0), (1, 2, 0)])
    simulation.reporters.append(app.RigidBodyReporter(tmp_path/'states.h5', 5))
    simulation.step(100)
    states = app.readBodyStates(tmp_path/'states.h5')
    msd = analysis.translationalMSD(states.positions, states.orientations,
                                    states.time[1] - states.time[0], (0, 0, 0), [1, 3], 2)
    assert np.allclose(numbers(msd.lagTimes, unit.picosecond), [0.01, 0.03])
    assert np.allclose(numbers(msd.parallel.mean, NM2), 5*np.array([0.01, 0.03])**2, rtol=1e-6)


def test_default_lags():
    times = analysis.rotationalMSD(still(10000), 2).lagTimes._value
    assert times[0] == 2 and times[-1] == 500 and 35 <= len(times) <= 50 and np.all(
        np.diff(times) > 0)
    assert np.array_equal(analysis.rotationalMSD(still(8), 1, numBlocks=4).lagTimes._value, [1])


# ---- Random motions ------------------------------------------------------------------------------


@pytest.fixture(scope='module')
def freeDiffusion():
    """100 bodies, 1000 frames 0.5 ps apart, D = 0.01, 0.02, 0.05 nm^2/ps along x, y, z."""
    steps = np.random.default_rng(3).normal(size=(1000, 100, 3))*np.sqrt(
        2*0.5*np.array([0.01, 0.02, 0.05]))
    return np.cumsum(steps, axis=0)


@pytest.mark.parametrize('independent', [False, True])
def test_free_diffusion(freeDiffusion, independent):
    expected = np.array([0.01, 0.02, 0.05])
    msd = analysis.translationalMSD(freeDiffusion, still(1000, 100), 0.5, (0, 0, 0),
                                    lags=range(1, 11), numBlocks=20, independentBodies=independent)
    short = analysis.shortTimeDiffusion(msd)
    # The variance of a squared Gaussian is twice the square of its mean. There are 98000 steps
    # within blocks.
    trueError = expected*np.sqrt(2/98000)
    value, error = (np.diag(numbers(x, NM2/unit.picosecond)) for x in (short.value, short.error))
    assert short.degrees == (1999 if independent else 19)
    assert np.all(np.abs(value - expected) < 4*trueError)
    # A standard error from n blocks is known to 1/sqrt(2n), which is 16 % for 20 blocks.
    assert np.allclose(error, trueError, rtol=4/np.sqrt(2*(short.degrees + 1)))
    for estimate in (analysis.shortTimeDiffusion(msd, 2.0),
                     analysis.longTimeDiffusion(msd, 1, 5*unit.picosecond),
                     analysis.longTimeDiffusion(msd, 0)):
        value, error = (np.diag(numbers(x, NM2/unit.picosecond))
                        for x in (estimate.value, estimate.error))
        assert np.all(np.abs(value - expected) < 4*error) and np.all(error < 0.05*expected)
    trace = analysis.shortTimeDiffusion(msd.trace)
    assert trace.value._value == pytest.approx(np.trace(short.value._value))
    # Independent components: errors add in squares.
    assert trace.error._value == pytest.approx(np.sqrt(np.sum(trueError**2)),
                                               rel=4/np.sqrt(2*(short.degrees + 1)))


def test_errors_of_overlapping_lags(freeDiffusion):
    """The variance of a one-dimensional mean over K overlapping lags of n steps (Qian, Sheetz,
    Elson 1991) is exact."""
    msd = analysis.translationalMSD(freeDiffusion, still(1000,
                                                         100), 0.5, (0, 0, 0), lags=[1, 3, 10, 24],
                                    numBlocks=20, independentBodies=True).component((1, 0, 0))
    n = np.array([1, 3, 10, 24])
    K = 50 - n
    relative = np.sqrt((4*n**2*K + 2*K + n - n**3)/(3*n*K**2)/2000)
    assert np.allclose(numbers(msd.error, NM2), relative*2*0.01*0.5*n,
                       rtol=0.12)  # squares have heavy tails


def test_free_rotation_overshoots_and_saturates():
    """Exactly <u_i u_j> = delta_ij (1 + 1.5 exp(-2Dt) - 2.5 exp(-6Dt))/6 (REFERENCE).

    For random steps of finite size s the two exponentials are powers of the steps' own averages, (1
    + 2 <cos a>)/3 and (1 + 2 <cos a> + 2 <cos 2a>)/5, with <cos k a> = (1 - (k s)^2) exp(-(k
    s)^2/2) for a Gaussian rotation vector.
    """
    variance, lags = 0.02, np.array([1, 4, 10, 22, 45, 80, 240])  # D dt = 0.01
    steps = turns(np.random.default_rng(4).normal(size=(300, 1500, 3))*np.sqrt(variance))
    q = np.empty_like(steps)
    q[0] = steps[0]
    for k in range(1, 300):
        q[k] = product(steps[k], q[k - 1])
    cosine, cosineOfTwice = ((1 - k*k*variance)*np.exp(-k*k*variance/2) for k in (1, 2))
    decay1, decay2 = ((1 + 2*cosine)/3)**lags, ((1 + 2*cosine + 2*cosineOfTwice)/5)**lags
    expected = (1 + 1.5*decay1 - 2.5*decay2)/6
    continuous = (1 + 1.5*np.exp(-variance*lags) - 2.5*np.exp(-3*variance*lags))/6
    assert np.allclose(expected, continuous, rtol=0.03)

    msd = analysis.rotationalMSD(q, 1, lags, numBlocks=1, independentBodies=True)
    difference = msd.mean - expected[:, None, None]*np.eye(3)
    assert np.all(np.abs(difference) < 4.5*msd.error)
    trace = msd.trace
    assert np.all(trace.error < 0.02*trace.mean)
    assert trace.mean[4]/3 > 1/6 + 5*trace.error[4]/3  # the overshoot
    assert trace.mean[-1]/3 == pytest.approx(1/6, abs=4*trace.error[-1]/3 + 2e-3)
    # The closed form is 2Dt (1 - 3.5 Dt + 7.3 (Dt)^2). So the first frame alone is 3.5 % low, and
    # the extrapolation is right to 0.5 %.
    short = analysis.rotationalMSD(q, 1, [1, 2, 3], 1, independentBodies=True).trace
    assert analysis.shortTimeDiffusion(short).value._value/3 == pytest.approx(0.00965, rel=0.01)
    short = analysis.shortTimeDiffusion(short, 3)
    assert short.value.unit == unit.picosecond**-1
    assert short.value._value/3 == pytest.approx(0.01, rel=0.01)


# ---- Mobilities ----------------------------------------------------------------------------------


def mobility(sites, radius, viscosity=1.0, orientation=None):
    """N of one multiblob in unbounded fluid, from a Context on Reference."""
    sites = np.array(sites._value if unit.is_quantity(sites) else sites, dtype=float)
    system, integrator, fluid = openmm.System(), openmmrigidhi.CustomRigidHIIntegrator(
        300, 0.001), openmmrigidhi.MobilityForce()
    fluid.setViscosity(viscosity)
    # No moment about the line if the blobs are on one.
    moments = (0, 1, 1) if np.all(sites[:, 1:] == sites[0, 1:]) else (1, 1, 1)
    app.addRigidMultiblob(system, integrator, fluid, sites, radius, 1, moments)
    integrator.setScheme(integrator.LangevinHI)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions(sites)
    if orientation is not None:
        integrator.setBodyOrientations([orientation])
    return fluid.getMobilityInContext(context)


BOOMERANG = app.boomerang(0.3*unit.micrometer)._value
BISECTOR = np.array([1, 1, 0])/np.sqrt(2)


@pytest.fixture(scope='module')
def boomerang():
    return mobility(BOOMERANG, 324.557*unit.nanometer, 8.9e-4*unit.pascal*unit.second)


def test_centres_and_diffusion_of_the_boomerang(boomerang):
    """The mobility has the values of REFERENCE, section 5."""
    center = analysis.centerOfMobility(boomerang).value_in_unit(unit.micrometer)
    assert center == pytest.approx(0.9609*BISECTOR, abs=1e-4)
    planar = analysis.planarCenterOfHydrodynamicStress(boomerang).value_in_unit(unit.micrometer)
    assert planar == pytest.approx(1.0749*BISECTOR, abs=1e-4)

    D = KT*analysis.mobilityAboutPoint(boomerang, center*unit.micrometer)
    assert np.trace(D[:3, :3])/3*MICROMETRES == pytest.approx(0.26961, abs=2e-5)
    axes = np.stack([BISECTOR, np.array([-1, 1, 0])/np.sqrt(2), (0, 0, 1)])
    assert np.diag(axes @ D[:3, :3] @ axes.T)*MICROMETRES == pytest.approx(
        [0.26895, 0.29665, 0.24323], abs=2e-5)
    assert np.diag(axes @ D[3:, 3:] @ axes.T)*SECONDS == pytest.approx([0.13384, 0.42711, 0.11552],
                                                                       abs=2e-5)
    with refused('this body has no centre of hydrodynamic stress'):
        analysis.centerOfHydrodynamicStress(boomerang)


def test_a_torque_about_the_normal_leaves_the_planar_centre(boomerang):
    for z in (0, 150.0, -0.4*unit.micrometer):
        about = analysis.mobilityAboutPoint(boomerang,
                                            analysis.planarCenterOfHydrodynamicStress(boomerang, z))
        assert np.allclose(about[:2, 5], 0, atol=1e-12*np.abs(boomerang[:3, 3:]).max())


SHAPES = {
    'boomerang': app.boomerang(1.0, 3)._value,
    'skew': np.random.default_rng(5).uniform(0, 4, size=(7, 3)),
    'tetramer': app.tetramer(2.5)._value + (0.3, 0, 1),
    'rod': app.rod(5, 1.5)._value + (2, 0, 0)
}


@pytest.mark.parametrize('shape', SHAPES)
def test_mobility_about_another_origin_is_that_of_a_body_with_that_origin(shape):
    sites = SHAPES[shape]
    shift = np.array([1.5, 0, 0]) if shape == 'rod' else np.array([0.7, -1.2, 2.0])
    moved = mobility(sites - shift, 0.8)
    assert np.allclose(analysis.mobilityAboutPoint(mobility(sites, 0.8), shift), moved, rtol=0,
                       atol=1e-12*np.abs(moved).max())


@pytest.mark.parametrize('shape', SHAPES)
def test_coupling_is_symmetric_about_the_centre_of_mobility_only(shape):
    N = mobility(SHAPES[shape], 0.8)
    center = analysis.centerOfMobility(N)
    about = analysis.mobilityAboutPoint(N, center)
    assert np.allclose(about[:3, 3:], about[3:, :3], rtol=0, atol=1e-12*np.abs(N).max())
    elsewhere = analysis.mobilityAboutPoint(N, center + (0, 0.2, 0.1)*unit.nanometer)
    assert np.abs(elsewhere[:3, 3:] - elsewhere[3:, :3]).max() > 1e-5*np.abs(N).max()
    # From any tracking point, and in the body frame, the result is the same point of the body.
    assert np.allclose(analysis.centerOfMobility(elsewhere)._value, (0, -0.2, -0.1), atol=1e-10)
    # No other point has a smaller mean translational mobility.
    assert np.trace(about[:3, :3]) < np.trace(N[:3, :3]) and np.trace(about[:3, :3]) < np.trace(
        elsewhere[:3, :3])


def test_bodies_with_a_centre_of_hydrodynamic_stress():
    assert np.allclose(
        analysis.centerOfHydrodynamicStress(mobility(SHAPES['tetramer'], 0.8))._value, (0.3, 0, 1),
        atol=1e-10)
    assert np.allclose(
        analysis.centerOfHydrodynamicStress(mobility(SHAPES['rod'], 0.8))._value, (2, 0, 0),
        atol=1e-10)
    skew = mobility(SHAPES['skew'], 0.8)
    with refused('the coupling about the centre of mobility is'):
        analysis.centerOfHydrodynamicStress(skew)
    assert np.allclose(
        analysis.centerOfHydrodynamicStress(skew, tolerance=1)._value,
        analysis.centerOfMobility(skew)._value)


def test_mobility_in_the_body_frame():
    q = turns(np.array([0.8, 0.3, -2.0]))
    inLab, expected = mobility(SHAPES['skew'], 0.8, orientation=q), mobility(SHAPES['skew'], 0.8)
    assert not np.allclose(inLab, expected, rtol=0, atol=1e-3*np.abs(expected).max())
    assert np.allclose(analysis.mobilityInBodyFrame(inLab, -3*q), expected, rtol=0,
                       atol=1e-10*np.abs(expected).max())


def test_stacks_of_mobilities_are_the_matrices_one_by_one():
    random = np.random.default_rng(3)
    N = np.stack([
        mobility(SHAPES[shape], 0.8, orientation=turns(random.normal(size=3)))
        for shape in ('boomerang', 'skew', 'tetramer')
    ])
    for function, rows in ((analysis.mobilityAboutPoint, random.normal(size=(3, 3))),
                           (analysis.mobilityInBodyFrame, random.normal(size=(3, 4))),
                           (analysis.planarAngleMobility, random.normal(size=(3, 3)))):
        for mobilities, values in ((N, rows), (N, rows[0]), (N[0], rows)):
            expected = [
                function(m, v) for m, v in zip(np.broadcast_to(mobilities, N.shape),
                                               np.broadcast_to(values, rows.shape))
            ]
            found = function(mobilities, values)
            assert found.shape == np.shape(expected) and np.allclose(
                found, expected, rtol=1e-12, atol=1e-14*np.abs(expected).max())
        assert function(N[:0], rows[:0]).shape == (0, *np.shape(expected)[1:])
    assert isinstance(analysis.planarAngleMobility(N[0], (1, 0, 0)), float)
    assert np.allclose(analysis.mobilityAboutPoint(N, rows*unit.angstrom),
                       analysis.mobilityAboutPoint(N, rows/10), rtol=1e-12)


def test_planar_angle_mobility(boomerang):
    assert analysis.planarAngleMobility(boomerang, BISECTOR) == pytest.approx(boomerang[5, 5])
    M = mobility(SHAPES['skew'], 0.8)
    v = np.array([0.3, -0.5, 0.7])
    R = M[3:, 3:]
    alpha = 1/(v[0]**2 + v[1]**2)
    equation93 = R[2, 2] - alpha*(2*v[0]*v[2]*R[0, 2] + 2*v[1]*v[2]*R[1, 2]) + \
        alpha**2*v[2]**2*(v[0]**2*R[0, 0] + v[1]**2*R[1, 1] + 2*R[0, 1]*v[0]*v[1])
    assert analysis.planarAngleMobility(M, 5*v) == pytest.approx(equation93, rel=1e-12)


def test_the_planar_angle_diffuses_with_its_mobility(boomerang):
    """Many short steps from one tilted orientation have the diffusion of the angle's mobility.
    """
    D = KT*SECONDS*analysis.mobilityInBodyFrame(boomerang, (1, 0, 0, 0))[3:, 3:]  # rad^2/s
    q = np.empty((2, 40000, 4))
    q[0] = turns(np.array([0.5, -0.6, 0.4]))
    steps = np.random.default_rng(7).normal(size=(40000, 3)) @ np.linalg.cholesky(2*D*1e-4).T
    q[1] = product(q[0], turns(steps))
    msd = analysis.planarAngleMSD(q, 1e-4, BISECTOR, [1], numBlocks=1, independentBodies=True)
    found = analysis.shortTimeDiffusion(msd)
    inLab = analysis.mobilityInBodyFrame(boomerang, q[0, 0]*(-1, 1, 1, 1))  # the inverse turn
    expected = KT*SECONDS*analysis.planarAngleMobility(inLab, rotation_matrices(q[0, 0]) @ BISECTOR)
    assert abs(expected/D[2, 2] - 1) > 0.2
    assert found.value._value == pytest.approx(expected, abs=4*found.error._value)
    assert found.error._value == pytest.approx(expected*np.sqrt(2/40000), rel=0.05)


@pytest.fixture(scope='module')
def brownianBoomerangs(boomerang):
    """1000 free boomerangs, 1000 frames of 0.05 s, tracked at the centre of mobility. Steps are
    those of the constant body-frame tensor.

    About that point a step from the frame at its start needs no drift. Lengths in um, times in s.
    """
    center = analysis.centerOfMobility(boomerang)
    scale = np.repeat([1e-3, 1], 3)
    D = 1e12*KT*np.outer(scale, scale)*analysis.mobilityAboutPoint(boomerang, center)
    random = np.random.default_rng(6)
    steps = random.normal(size=(999, 1000, 6)) @ np.linalg.cholesky(2*D*0.05).T
    R, q = np.zeros((1000, 1000, 3)), np.empty((1000, 1000, 4))
    q[0] = turns(random.normal(scale=10, size=(1000, 3)))
    for k, step in enumerate(steps):
        R[k + 1] = R[k] + np.einsum('nij,nj->ni', rotation_matrices(q[k]), step[:, :3])
        q[k + 1] = product(q[k], turns(step[:, 3:]))
        q[k + 1] /= np.linalg.norm(q[k + 1], axis=-1, keepdims=True)
    return D, R, q, center.value_in_unit(unit.micrometer)


def test_the_tracking_point_matters_at_short_times_only(brownianBoomerangs):
    """Here nm stands for um and ps for s."""
    D, R, q, center = brownianBoomerangs
    lags = [1, 2, 3, 300, 350, 400]
    means = {}
    for name, point in (('center', np.zeros(3)), ('cross point', -center), ('tip',
                                                                            (2.1, 0, 0) - center)):
        msd = analysis.translationalMSD(R, q, 0.05, point, lags, numBlocks=1,
                                        independentBodies=True).trace
        # This D is in um and s, but the functions take only its numbers.
        expected = np.trace(analysis.mobilityAboutPoint(D, point)[:3, :3])/3
        short, long = analysis.shortTimeDiffusion(msd, 0.15), analysis.longTimeDiffusion(msd, 15)
        # After the extrapolation an error of third order in the lag is left, below 0.1 %.
        assert short.value._value/3 == pytest.approx(expected,
                                                     abs=4*short.error._value/3 + 1e-3*expected)
        # The slowest direction turns in 1/(0.134 + 0.116) = 4 s. So from 15 to 20 s the slope of
        # the tip is still 0.002 too high.
        assert long.value._value/3 == pytest.approx(0.26961, abs=4*long.error._value/3 + 0.0025)
        assert (short.error._value < 0.01*short.value._value
                and long.error._value < 0.06*long.value._value)
        means[name] = short.value._value/3
    assert means['tip'] > 1.1*means['cross point'] and means['cross point'] > 1.5*means['center']


def test_body_frame_tensors_of_the_boomerang(brownianBoomerangs):
    D, R, q, _ = brownianBoomerangs
    translation = analysis.shortTimeDiffusion(
        analysis.translationalMSD(R, q, 0.05, (0, 0, 0), [1], numBlocks=1, bodyFrame=True,
                                  independentBodies=True))
    assert np.all(np.abs(translation.value._value - D[:3, :3]) < 4.5*translation.error._value)
    rotation = analysis.shortTimeDiffusion(
        analysis.rotationalMSD(q, 0.05, [1, 2, 3], numBlocks=1, bodyFrame=True,
                               independentBodies=True), 0.15)
    assert np.all(
        np.abs(rotation.value._value - D[3:, 3:]) < 4.5*rotation.error._value +
        0.01*D[3:, 3:].max())


def test_gravitational_height():
    height = analysis.gravitationalHeight(KT, 0.5*unit.kilojoule_per_mole/unit.nanometer)
    assert height.value_in_unit(unit.nanometer) == pytest.approx(2*KT)
    for bad in ((0, 1), (1, -1), (np.inf, 1)):
        with refused('gravitationalHeight: got kT = ', 'both must be finite and'):
            analysis.gravitationalHeight(*bad)
    # Of one particle, too.
    ofOne = analysis.gravitationalHeight(KT*unit.kilojoule_per_mole/unit.AVOGADRO_CONSTANT_NA,
                                         1e-12*unit.newton)
    assert ofOne._value == pytest.approx(KT/0.602214076, rel=1e-12)
    with refused('weight: got a quantity in kilojoule/mole', error=TypeError):
        analysis.gravitationalHeight(KT, 1*unit.kilojoule_per_mole)


# ---- Bad input -----------------------------------------------------------------------------------

GOOD = dict(positions=np.zeros((40, 2, 3)), orientations=still(40, 2), frameInterval=1,
            trackingPoint=(0, 0, 0))


@pytest.mark.parametrize(
    'change, pieces, error',
    [({
        'positions': np.zeros((40, 3))
    }, ('positions: got an array of shape (40, 3)', 'the shape (frames, bodies, 3)'), ValueError),
     ({
         'positions': np.zeros((0, 2, 3))
     }, ('positions: got an array of shape (0, 2, 3)',), ValueError),
     ({
         'positions': np.zeros((40, 2, 3))*unit.kelvin
     }, ('positions: got a quantity in kelvin',), TypeError),
     ({
         'positions': np.full((40, 2, 3), np.nan)
     }, ('frame 0, body 0: the trajectory holds [nan nan nan]',), ValueError),
     ({
         'positions': np.zeros((39, 2, 3))
     }, ('got 39 frames of 2 bodies, but orientations of 40 frames of 2',), ValueError),
     ({
         'orientations': 1.01*still(40, 2)
     }, ('frame 0, body 0: a quaternion has length 1.01; orientations must be unit',), ValueError),
     ({
         'frameInterval': 0
     }, ('frameInterval: got 0.0 ps; the time between frames must be finite',), ValueError),
     ({
         'frameInterval': 1*unit.nanometer
     }, ('frameInterval: got a quantity in nanometer',), TypeError),
     ({
         'trackingPoint': (0, 0)
     }, ('trackingPoint: got an array of shape (2,)',), ValueError),
     ({
         'numBlocks': 1
     }, ('numBlocks: got 1; errors need at least two blocks',), ValueError),
     ({
         'numBlocks': 0,
         'independentBodies': True
     }, ('numBlocks: got 0; errors need',), ValueError),
     ({
         'numBlocks': 21
     }, ('40 frames are too few for 21 blocks, which need 2 frames each',), ValueError),
     ({
         'lags': [4]
     }, ('lags: got a lag of 4 frames; it must be from 0 to 3, less than a block',), ValueError),
     ({
         'lags': [-1]
     }, ('lags: got a lag of -1 frames',), ValueError),
     ({
         'lags': [0.5]
     }, ('lags: got 0.5; it must be an integer',), TypeError),
     ({
         'bodyFrame': 1
     }, ('bodyFrame: got 1; it must be True or False',), TypeError),])
def test_bad_trajectories(change, pieces, error):
    with refused('translationalMSD: ', *pieces, error=error):
        analysis.translationalMSD(**{**GOOD, **change})


def test_the_tracking_point_is_mandatory():
    with pytest.raises(TypeError,
                       match='trackingPoint: got none; which point of a body is followed'):
        analysis.translationalMSD(GOOD['positions'], GOOD['orientations'], 1)


def test_bad_vectors_and_components():
    with refused(
            'planarAngleMSD: bodyVector: got [0. 0. 0.]; its length must be finite and positive to '
            'have'):
        analysis.planarAngleMSD(still(40), 1, (0, 0, 0))
    msd = analysis.rotationalMSD(still(40), 1)
    for bad in (lambda: msd.trace.trace, lambda: msd.component((1, 1))):
        with refused('a tensor needs 3 or 3 x 3 weights'):
            bad()


def msd_of(x):
    return analysis.translationalMSD(x, still(*x.shape[:2]), 1.0, (0, 0, 0))


def walk(rng, forget, back, drift=0.0, shape=(800, 20, 3)):
    """Random walks whose steps forget a part of their velocity, which a trap pulls back by a part
    of the distance, and which drift."""
    x, v = np.zeros(shape), np.zeros(shape[1:])
    for k in range(1, len(x)):
        v = v*(1 - forget) + rng.normal(size=shape[1:])*np.sqrt(forget)
        x[k] = (1 - back)*x[k - 1] + v
    return x + drift*np.arange(len(x))[:, None, None]


@pytest.mark.parametrize(
    'what,forget,back,drift,shortWarns,longWarns',
    [('free', 1, 0, 0, None, None), ('bound', 1, 0.1, 0, None, 'level off: give a longer minTime'),
     ('with momenta', 0.02, 0, 0, 'keep their momenta for longer', 'grow faster than the lag time'),
     ('with a drift', 1, 0, 0.7, 'or drift: take longTimeDiffusion', 'subtract a drift'),])
def test_diffusion_from_displacements_that_are_no_line(what, forget, back, drift, shortWarns,
                                                       longWarns):
    msd = msd_of(walk(np.random.default_rng(11), forget, back, drift))
    for estimate, expected in ((lambda m: analysis.shortTimeDiffusion(m), shortWarns),
                               (lambda m: analysis.longTimeDiffusion(m, 0), longWarns)):
        for displacement in (msd, msd.isotropic):
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter('always')
                found = estimate(displacement)
            messages = [str(each.message) for each in caught]
            assert len(messages) == (expected is not None), (what, messages)
            assert found.isTrusted == (expected is None)
            if expected:
                assert expected in messages[0] and messages[0].endswith(found.doubts[0])
                assert ('component' in messages[0]) == (displacement is msd)


@pytest.mark.parametrize('axis', [0, 2])
def test_wrapped_positions_are_found(axis):
    x = np.random.default_rng(1).normal(size=(400, 20, 3)).cumsum(axis=0)*0.1
    x += np.random.default_rng(2).random((20, 3))*8
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        analysis.translationalMSD(x, None, 1.0, lags=[1, 2])
        analysis.translationalMSD(x[:, :1], None, 1.0, lags=[1, 2])
    x[..., axis] %= 8
    with pytest.warns(UserWarning,
                      match=f'along {"xyz"[axis]} between frames .* wrapped into a box'):
        analysis.translationalMSD(x, None, 1.0, lags=[1, 2])


def test_displacements_of_a_shear_flow_are_doubted():
    """The flow at their places carries the bodies of each block along by another distance."""
    x = np.random.default_rng(1).normal(size=(4000, 5, 3)).cumsum(0)
    x[..., 0] += 0.05*x[..., 1].cumsum(0)
    msd = analysis.translationalMSD(x, None, 1.0, lags=[1, 2, 5, 10, 20, 40, 80])
    for displacement in (msd, msd.isotropic):
        with pytest.warns(UserWarning, match='grow faster than the lag time'):
            assert not analysis.longTimeDiffusion(displacement, 5).isTrusted


def test_an_extrapolation_over_a_bend_is_doubted():
    msd = msd_of(walk(np.random.default_rng(12), 1, 0.1, shape=(4000, 5, 3))).isotropic
    with pytest.warns(UserWarning, match='a parabola through .* give a shorter maxTime'):
        assert not analysis.shortTimeDiffusion(msd, 50).isTrusted
    assert analysis.shortTimeDiffusion(msd, 3).isTrusted


def test_few_blocks_are_doubted_without_a_warning():
    """A bend of bound bodies is within the errors of three blocks; ten blocks show it."""
    walks = walk(np.random.default_rng(14), 1, 0.1, shape=(1500, 5, 3))

    def estimate(blocks):
        return analysis.longTimeDiffusion(
            analysis.translationalMSD(walks, still(1500, 5), 1.0, (0, 0, 0), numBlocks=blocks,
                                      lags=range(1, 30)).isotropic, 0)

    with warnings.catch_warnings():
        warnings.simplefilter('error')
        found = estimate(3)
    assert len(found.doubts) == 1 and not found.isTrusted
    assert found.doubts[0].startswith('the errors come from 3 blocks of samples, and at least 10')
    with pytest.warns(UserWarning, match='level off'):
        assert all('blocks' not in doubt for doubt in estimate(10).doubts)


def test_free_walks_are_not_doubted():
    """The probability of a false alarm is 1e-4 for each test of a component."""
    rng = np.random.default_rng(13)
    for _ in range(50):
        msd = msd_of(rng.normal(size=(200, 1, 3)).cumsum(axis=0))
        for found in (analysis.shortTimeDiffusion(msd), analysis.longTimeDiffusion(msd, 0),
                      analysis.shortTimeDiffusion(msd, 10)):
            assert found.isTrusted, found.doubts


def test_diffusion_from_too_few_lags():
    msd = analysis.rotationalMSD(still(40), 1, lags=[0, 1, 3], numBlocks=4)
    with refused(
            'shortTimeDiffusion: maxTime: got 2.0 ps; extrapolation needs two lag times above 0'):
        analysis.shortTimeDiffusion(msd, 2)
    with refused(
            'longTimeDiffusion: minTime, maxTime: got 2.0 and inf ps; a slope needs two lag times',
            'they end at 3 ps'):
        analysis.longTimeDiffusion(msd, 2)
    with refused('shortTimeDiffusion: msd: it has no lag times above 0'):
        analysis.shortTimeDiffusion(analysis.rotationalMSD(still(40), 1, lags=[0]))
    with refused('longTimeDiffusion: msd: got list; it must be a MeanSquareDisplacement',
                 error=TypeError):
        analysis.longTimeDiffusion([1, 2], 0)


def test_bad_mobilities():
    good = np.diag([2.0, 2, 2, 1, 1, 1])
    lopsided = good.copy()
    lopsided[0, 4] = 0.5
    for function in (analysis.centerOfMobility, analysis.centerOfHydrodynamicStress,
                     analysis.planarCenterOfHydrodynamicStress):
        for bad in (lopsided, np.nan*good):
            with refused(
                    f'{function.__name__}: N: a mobility must be symmetric, with finite numbers, '
                    f'and is not'):
                function(bad)
        with refused(
                f'{function.__name__}: N: got an array of shape (12, 12); the shape must be (6, 6)'
        ):
            function(np.eye(12))
    with refused('centerOfMobility: N: its rotational part is',
                 'a centre needs rotational mobility about two axes'):
        analysis.centerOfMobility(np.diag([1.0, 1, 1, 0, 0, 0]))
    with refused(
            'the rotational mobility about z is 0.0; it must be positive for a torque about z'):
        analysis.planarCenterOfHydrodynamicStress(np.diag([1.0, 1, 1, 1, 1, 0]))
    with refused('mobilityAboutPoint: shift: got a quantity in picosecond', error=TypeError):
        analysis.mobilityAboutPoint(good, (0, 0, 1)*unit.picosecond)
    for bad in ((0, 0, 0, 0), [(1, 0, 0, 0), (0, 0, 0, 0)]):
        with refused('mobilityInBodyFrame: orientation: got [0. 0. 0. 0.]',
                     'it must be four numbers w, x, y, z, not all 0'):
            analysis.mobilityInBodyFrame(good, bad)
    for bad in ((0, 0, 1), [(1, 0, 0), (0, 0, 1)]):
        with refused(
                'planarAngleMobility: direction: got [0. 0. 1.]; a direction along z has no angle'):
            analysis.planarAngleMobility(good, bad)


def test_bad_stacks_of_mobilities():
    good, row = np.diag([2.0, 2, 2, 1, 1, 1]), {
        'shift': (0, 0, 1),
        'orientation': (1, 0, 0, 0),
        'direction': (1, 0, 0)
    }
    for function, name in ((analysis.mobilityAboutPoint, 'shift'), (analysis.mobilityInBodyFrame,
                                                                    'orientation'),
                           (analysis.planarAngleMobility, 'direction')):
        columns = len(row[name])
        # One bad matrix among good ones is refused. Small matrices are judged by their own size.
        lopsided = np.stack([1e6*good, good])
        lopsided[1, 0, 1] = 1
        with refused(f'{function.__name__}: N: a mobility must be symmetric'):
            function(lopsided, row[name])
        for bad in (np.eye(12), np.ones((2, 2, 6, 6)), np.ones((2, 6, 5))):
            with refused(
                    f'{function.__name__}: N: got an array of shape {bad.shape}; the shape must be '
                    f'(6, 6) or (n, 6, 6)'):
                function(bad, row[name])
        for N, bad, count in ((good, row[name][1:], 'n'), ([good, good], 3*[row[name]], 2),
                              ([good, good], [[row[name]]], 2)):
            with refused(
                    f'{function.__name__}: {name}: got an array of shape {np.shape(bad)}',
                    f'the shape must be ({columns},), for all matrices, or ({count}, {columns}), '
                    f'for each'):
                function(N, bad)
