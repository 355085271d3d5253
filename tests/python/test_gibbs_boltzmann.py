"""Gibbs-Boltzmann Monte Carlo against closed forms and quadrature.

Every comparison of a mean is by z = (mean - exact)/(standard error) with fixed seeds. |z| < 4.5 fails by chance 7 times in a million,
and there are some sixty of them. Sample sizes are chosen such that the errors are well below what a wrong measure would do: without the
factor sin^2(angle/2) of Haar's measure, or with a proposal that is not symmetric, the orientations below are off by 1 to 10 %.
"""
import re

import numpy as np
import openmm
import pytest
import scipy.special
import scipy.stats
from openmm import unit

import openmmrigidhi
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, analysis, app
from openmmrigidhi._quaternions import rotationMatrices
from openmmrigidhi.analysis import _moves

KT = (unit.MOLAR_GAS_CONSTANT_R*300*unit.kelvin).value_in_unit(unit.kilojoule_per_mole)
LARGEST_Z = 4.5
#: Probabilities of heights of the boomerang's cross point between 2, 5, 10, 15, 20, 30 and 40 radii, and of angles between its normal
#: and the vertical in five of six equal parts of a right angle (either normal), by quadrature.
BOOMERANG_HEIGHTS = np.array([0.117248, 0.421539, 0.273614, 0.111321, 0.063661, 0.010523])
BOOMERANG_ANGLES = np.array([0.045831, 0.122511, 0.173987, 0.205273, 0.222457])


def refused(*pieces, error=ValueError):
    return pytest.raises(error, match='.*'.join(re.escape(piece) for piece in pieces))


def check(statistics, exact, relativeError=None):
    """A mean is the exact one within its error, and its error is as small as the test wants."""
    z = (statistics.mean - exact)/statistics.standardError
    print(f'{statistics.mean:.6f} +- {statistics.standardError:.6f}, exact {exact:.6f}, z = {z:.2f}, tau = {statistics.tau:.1f}')
    assert abs(z) < LARGEST_Z
    if relativeError is not None:
        assert statistics.standardError < relativeError*abs(exact)


def axis(samples, k):
    """Components (samples, bodies, 3) of body axis k in the lab."""
    return rotationMatrices(samples.orientations)[..., :, k]


def walkers(energy, count=1000, position=(0, 0, 0), seed=1, burnIn=150, samples=40, interval=3, **options):
    sampler = analysis.WalkerSampler(energy, 300, count, position, seed=seed, **options)
    sampler.burnIn(burnIn, progress=False)
    return sampler.sample(samples, interval, progress=False)


# ---- Proposals -------------------------------------------------------------------------------------------------------

@pytest.mark.parametrize('largest', [0.2, 1.5, np.pi])
def test_random_rotations_are_uniform_up_to_the_largest_angle(largest):
    """Haar's measure has the density 1 - cos(angle), on any axis. chi^2 of 20 x 10 bins: fails by chance once in 1e5."""
    n = 100_000
    q = _moves.uniformRotations(np.random.default_rng(3), np.full(n, largest))
    assert np.allclose(np.linalg.norm(q, axis=1), 1, rtol=0, atol=1e-14)
    angle = 2*np.arccos(np.minimum(1, q[:, 0]))
    assert angle.max() <= largest*(1 + 1e-7)
    probability = (angle - np.sin(angle))/(largest - np.sin(largest))
    height = q[:, 3]/np.sin(angle/2)
    counts = np.histogram2d(probability, height, bins=(np.linspace(0, 1 + 1e-9, 21), np.linspace(-1 - 1e-9, 1 + 1e-9, 11)))[0]
    assert counts.sum() == n
    chi2 = ((counts - n/200)**2).sum()/(n/200)
    assert chi2 < scipy.stats.chi2.isf(1e-5, 199)
    around = np.arctan2(q[:, 2], q[:, 1])
    assert abs(np.mean(np.cos(around))) < LARGEST_Z/np.sqrt(2*n) and abs(np.mean(np.sin(around))) < LARGEST_Z/np.sqrt(2*n)


def test_sizes_of_moves_change_in_burn_in_only():
    sampler = analysis.WalkerSampler(lambda R, q: 50*KT*(R**2).sum(axis=1), 300, 400, (0, 0, 0), seed=4)
    sampler.burnIn(200, progress=False)
    first, second = sampler.sample(20, progress=False), sampler.sample(20, progress=False)
    assert first.stepSizes['translation'] == second.stepSizes['translation'] != 0.1
    # 8000 trials: a standard deviation of 0.006, more for correlation between sweeps, and what burn-in leaves.
    assert first.acceptance['translation'] == pytest.approx(0.4, abs=0.05)
    assert first.stepSizes['rotation'] == np.pi and first.acceptance['rotation'] == 1   # nothing depends on orientations


# ---- Walkers against closed forms ------------------------------------------------------------------------------------

@pytest.mark.parametrize('rejection, lowest', [('Overlap', 0.7), ('Crossing', 0.2)])
def test_gravitational_height_over_a_wall(rejection, lowest):
    """A sphere of radius 0.5 over a wall at 0.2: an exponential law from where the wall stops it."""
    samples = walkers(lambda R, q: KT/0.8*R[:, 2], position=(0, 0, 2), sitePositions=[(0, 0, 0)], radii=0.5, wallHeight=0.2,
                      rejection=rejection, samples=100)
    z = samples.positions[:, :, 2]
    assert z._value.min() >= lowest
    check(samples.average(z), lowest + 0.8, 0.01)
    check(samples.average((z._value - lowest - 0.8)**2), 0.64)
    probabilities, errors = samples.histogram(z, lowest + 0.8*np.array([0, 0.5, 1, 2, 4]))
    exact = -np.diff(np.exp(-np.array([0, 0.5, 1, 2, 4])))
    assert np.all(np.abs(probabilities - exact) < LARGEST_Z*errors) and np.all(errors < 0.02*exact + 0.001)
    free = samples.positions._value[-1, :, :2]
    assert free.std() > 3  # x and y are sampled, and nothing holds them


@pytest.mark.parametrize('kr, exact', [(2, 0.4292307058), (10, 0.7642662212), (200, 0.9899487014)])
def test_orientations_in_a_quadrupolar_well(kr, exact):
    samples = walkers(lambda R, q: -kr/2*KT*rotationMatrices(q)[:, 0, 0]**2, coordinates='rotation', samples=60)
    check(samples.average(axis(samples, 0)[..., 0]**2), exact, 0.005)
    assert not samples.positions._value.any()


@pytest.mark.parametrize('k', [0.5, 4, 30])
def test_a_dipole_in_a_field(k):
    samples = walkers(lambda R, q: -k*KT*rotationMatrices(q)[:, 2, 2], coordinates=['rotation'], samples=60)
    n = axis(samples, 2)
    check(samples.average(n[..., 2]), 1/np.tanh(k) - 1/k, 0.02)
    check(samples.average(n[..., 0]*n[..., 1]), 0)
    check(samples.average(axis(samples, 0)[..., 0]**2 - axis(samples, 0)[..., 1]**2), 0)


@pytest.mark.parametrize('k, exact', [(10, 0.6510520512), (0, 0.25)])
def test_a_well_of_the_quaternion(k, exact):
    """U = -k/2 q0^2 tells Haar's measure from others most directly: it is that of the angle alone."""
    if k:
        x = k/4
        i0, i1, i2 = (scipy.special.iv(n, x) for n in range(3))
        assert 0.5*(1 + (i1 - (i0 + i2)/2)/(i0 - i1)) == pytest.approx(exact, abs=1e-10)
    samples = walkers(lambda R, q: -k/2*KT*q[:, 0]**2, coordinates=['rotation'], samples=60)
    check(samples.average(samples.orientations[..., 0]**2), exact, 0.005)


def test_turning_about_a_point_far_from_the_origin_changes_no_distribution():
    """Origin in a harmonic well, dipole in a field: they are independent, whatever the moves mix."""
    samples = walkers(lambda R, q: KT*(0.5*8*(R**2).sum(axis=1) - 3*rotationMatrices(q)[:, 2, 2]), trackingPoint=(0.4, -0.3, 0.5),
                      samples=60)
    R = samples.positions._value
    for k in range(3):
        check(samples.average(R[..., k]**2), 1/8, 0.02)
    n = axis(samples, 2)
    check(samples.average(n[..., 2]), 1/np.tanh(3) - 1/3, 0.01)
    check(samples.average(R[..., 0]*n[..., 0]), 0)
    assert 0.3 < samples.acceptance['rotation'] < 0.5


def test_turning_about_one_axis_only():
    """A dipole in the plane: <cos phi> = I1(k)/I0(k)."""
    samples = walkers(lambda R, q: -2*KT*rotationMatrices(q)[:, 0, 0], coordinates=['rotation'], rotationAxis=(0, 0, -3), samples=60)
    assert not samples.orientations[..., 1:3].any()
    check(samples.average(axis(samples, 0)[..., 0]), scipy.special.iv(1, 2)/scipy.special.iv(0, 2), 0.01)


def test_only_the_coordinates_that_are_named_move():
    samples = walkers(lambda R, q: KT*R[:, 2]**2, position=(0.1, -0.2, 0.3), coordinates=['z'], samples=20)
    assert np.all(samples.positions._value[..., :2] == (0.1, -0.2)) and np.all(samples.orientations == (1, 0, 0, 0))
    check(samples.average(samples.positions[:, :, 2]), 0)
    assert set(samples.stepSizes) == {'translation'}


# ---- Bodies of the literature over a wall ----------------------------------------------------------------------------

def overWall(sites, weights, strength):
    """Weights, kT/a, on the blobs, and their repulsion strength kT a/(h - a) exp(-2(h - a)/a), in units of a (Delong 2015, eq. 73)."""
    def energy(R, q):
        h = R[:, 2:] + rotationMatrices(q)[:, 2] @ sites.T
        return KT*(h @ weights + (strength/(h - 1)*np.exp(-2*(h - 1))).sum(axis=1))
    return energy


def chiSquare(probabilities, errors, exact):
    return np.sum(((probabilities - exact)/errors)**2)


def test_the_boomerang():
    """Delong 2015, section IV.5, g = 1: mean, second moment and bins of quadrature, converged to more digits than are given.

    Weight 0.18 kT/a and strength 23.08 kT as printed there. 1e5 nearly independent samples: mean height to 0.2 %.
    """
    sites = app.boomerang(0.3/(0.265*np.sqrt(1.5)))._value
    samples = walkers(overWall(sites, np.full(15, 0.18/15), 23.08), 1500, position=(0, 0, 15), sitePositions=sites, radii=1.0, wallHeight=0,
                      coordinates=['z', 'rotation'], samples=70, interval=10, burnIn=300)
    h, cosine = samples.positions[:, :, 2], axis(samples, 2)[..., 2]
    check(samples.average(h), 10.854, 0.003)
    check(samples.average((h._value - 10.854)**2), 5.939**2)
    check(samples.average(cosine**2), 0.3702, 0.004)
    check(samples.average(cosine), 0)
    edges = [2, 5, 10, 15, 20, 30, 40]
    exact = BOOMERANG_HEIGHTS
    assert chiSquare(*samples.histogram(h, edges), exact) < scipy.stats.chi2.isf(1e-5, len(exact))
    angles = np.arccos(np.abs(cosine))
    exact = BOOMERANG_ANGLES
    assert chiSquare(*samples.histogram(angles, np.pi/12*np.arange(6)), exact) < scipy.stats.chi2.isf(1e-5, len(exact))


def test_the_tetramer():
    """Delong 2015, section IV.3: four weights, edges of 4 a. Means and standard deviations of quadrature."""
    sites = app.tetramer(4.0)._value
    samples = walkers(overWall(sites, np.array([0.15, 0.1, 0.3, 0.05]), 20), 1500, position=(0, 0, 8), sitePositions=sites, radii=1.0,
                      wallHeight=0, coordinates=['z', 'rotation'], samples=50, interval=10, burnIn=300)
    h = samples.positions[:, :, 2]._value
    vertex = h + axis(samples, 2)[..., 2]*sites[3, 2]
    check(samples.average(h), 5.943619, 0.002)
    check(samples.average((h - 5.943619)**2), 1.747745**2)
    check(samples.average(vertex), 6.205976, 0.002)
    check(samples.average((vertex - 6.205976)**2), 2.242462**2)


# ---- Samples ---------------------------------------------------------------------------------------------------------

def poses(values, independent):
    """Samples whose observable is given."""
    samples, n = np.shape(values)
    return analysis.PoseSamples(np.zeros((samples, n, 3))*unit.nanometer, np.tile((1.0, 0, 0, 0), (samples, n, 1)),
                                np.zeros(samples)*unit.kilojoule_per_mole, np.empty((samples, 0, 3))*unit.nanometer, {}, {}, independent)


def test_errors_know_the_correlation():
    """A stationary autoregressive process of correlation 0.9: tau = 1/2 (1.9/0.1) = 9.5, and the error of the mean is known."""
    random = np.random.default_rng(5)
    samples, n = 4000, 50
    x = np.empty((samples, n))
    x[0] = random.normal(size=n)
    for k in range(1, samples):
        x[k] = 0.9*x[k - 1] + np.sqrt(1 - 0.81)*random.normal(size=n)
    walkers_ = poses(x, True).average(x)
    chain = poses(x[:, :1], False).average(x[:, :1])
    # The standard error of n walkers has itself a relative one of 1/sqrt(2 (n - 1)); of b blocks likewise.
    assert walkers_.standardError == pytest.approx(np.sqrt(19/(samples*n)), rel=LARGEST_Z/np.sqrt(2*(n - 1)))
    assert walkers_.tau == pytest.approx(9.5, rel=2*LARGEST_Z/np.sqrt(2*(n - 1))) and walkers_.degrees == n - 1
    assert chain.standardError == pytest.approx(np.sqrt(19/samples), rel=LARGEST_Z/np.sqrt(2*chain.degrees))
    assert walkers_.effectiveSamples == pytest.approx(samples*n/(2*walkers_.tau))


def test_bodies_of_one_sample_count_together_or_apart():
    """Bodies that do the same are as good as one of them; walkers that do not move tell tau = half the samples."""
    x = np.random.default_rng(6).normal(size=(1000, 1))
    one, three = poses(x, False).average(x), poses(np.tile(x, 3), False).average(np.tile(x, 3))
    assert three.standardError == pytest.approx(one.standardError) and three.mean == pytest.approx(one.mean)
    still = np.tile(np.random.default_rng(7).normal(size=200), (10, 1))
    found = poses(still, True).average(still)
    assert found.standardError == pytest.approx(still[0].std(ddof=1)/np.sqrt(200)) and found.tau == pytest.approx(5, rel=0.01)


def test_bins_of_a_histogram():
    x = np.array([[0.0, 1.0], [0.5, 2.0], [0.25, 3.0]])
    probabilities, errors = poses(x, True).histogram(x*unit.nanometer, [0, 0.5, 1, 2])
    assert np.allclose(probabilities, [2/6, 1/6, 2/6]) and errors.shape == (3,)
    assert np.allclose(errors, [1/3, 1/6, 1/3])   # half the difference of the two walkers
