"""Averages of Gibbs-Boltzmann Monte Carlo agree with closed forms and quadrature.

Every comparison of a mean is by z = (mean - exact)/(standard error) with fixed seeds. Its bound,
from Student's t, is exceeded by chance 7 times in a million, and there are some sixty comparisons.
Samples are so large that errors are much smaller than the effects of a move that is not symmetric,
of a wrong wall or of a wrong tracking point.
"""
import doctest
import re

import numpy as np
import openmm
import pytest
import scipy.special
import scipy.stats
from openmm import unit

import openmmrigidhi
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, analysis, app
from openmmrigidhi._quaternions import rotation_matrices
from openmmrigidhi.accuracy.statistics import quantile
from openmmrigidhi.analysis import _moves
from openmmrigidhi.analysis import walkers as walkersModule

KT = (unit.MOLAR_GAS_CONSTANT_R*300*unit.kelvin).value_in_unit(unit.kilojoule_per_mole)
FALSE_ALARMS = 7e-6
LARGEST_Z = 4.5  # of a normal law
#: Probabilities of heights of the boomerang's cross point between 2, 5, 10, 15, 20, 30 and 40
#: radii, and of angles between its normal and the vertical in five of six equal parts of a right
#: angle (either normal), by quadrature.
BOOMERANG_HEIGHTS = np.array([0.117248, 0.421539, 0.273614, 0.111321, 0.063661, 0.010523])
BOOMERANG_ANGLES = np.array([0.045831, 0.122511, 0.173987, 0.205273, 0.222457])


def refused(*pieces, error=ValueError):
    return pytest.raises(error, match='.*'.join(re.escape(piece) for piece in pieces))


def check(statistics, exact, relativeError=None):
    """A mean equals the exact one within its error, and its error is as small as the test requires.
    """
    z = (statistics.mean - exact)/statistics.standardError
    print(
        f'{statistics.mean:.6f} +- {statistics.standardError:.6f}, exact {exact:.6f}, z = {z:.2f}, '
        f'tau = {statistics.tau:.1f}')
    assert statistics.degrees >= 20 and abs(z) < quantile(1 - FALSE_ALARMS, statistics.degrees)
    if relativeError is not None:
        assert statistics.standardError < relativeError*abs(exact)


def axis(samples, k):
    """Components (samples, bodies, 3) of body axis k in the lab."""
    return rotation_matrices(samples.orientations)[..., :, k]


def walkers(energy, count=1000, position=(0, 0, 0), seed=1, burnIn=150, samples=40, interval=3,
            **options):
    sampler = analysis.WalkerSampler(energy, 300, count, position, seed=seed, **options)
    sampler.burnIn(burnIn, progress=False)
    return sampler.sample(samples, interval, progress=False)


# ---- Proposals -----------------------------------------------------------------------------------


@pytest.mark.parametrize('largest', [0.2, 1.5, np.pi])
def test_random_rotations_are_uniform_up_to_the_largest_angle(largest):
    """Haar's measure has the density 1 - cos(angle), about any axis. A chi^2 of 20 x 10 bins is
    used, which fails by chance once in 1e5."""
    n = 100_000
    q = _moves.uniform_rotations(np.random.default_rng(3), np.full(n, largest))
    assert np.allclose(np.linalg.norm(q, axis=1), 1, rtol=0, atol=1e-14)
    angle = 2*np.arccos(np.minimum(1, q[:, 0]))
    assert angle.max() <= largest*(1 + 1e-7)
    probability = (angle - np.sin(angle))/(largest - np.sin(largest))
    height = q[:, 3]/np.sin(angle/2)
    counts = np.histogram2d(
        probability, height, bins=(np.linspace(0, 1 + 1e-9,
                                               21), np.linspace(-1 - 1e-9, 1 + 1e-9, 11)))[0]
    assert counts.sum() == n
    chi2 = ((counts - n/200)**2).sum()/(n/200)
    assert chi2 < scipy.stats.chi2.isf(1e-5, 199)
    around = np.arctan2(q[:, 2], q[:, 1])
    assert abs(np.mean(np.cos(around))) < LARGEST_Z/np.sqrt(2*n) and abs(np.mean(
        np.sin(around))) < LARGEST_Z/np.sqrt(2*n)


def test_sizes_of_moves_change_in_burn_in_only():
    sampler = analysis.WalkerSampler(lambda R, q: 50*KT*(R**2).sum(axis=1), 300, 400, (0, 0, 0),
                                     seed=4)
    sampler.burnIn(200, progress=False)
    first, second = sampler.sample(20, progress=False), sampler.sample(20, progress=False)
    assert first.stepSizes['translation'] == second.stepSizes['translation'] != 0.1
    # For 8000 trials the standard deviation is 0.006. Correlation between sweeps and the end of
    # burn-in add to this.
    assert first.acceptance['translation'] == pytest.approx(0.4, abs=0.05)
    assert first.stepSizes['rotation'] == np.pi and first.acceptance[
        'rotation'] == 1  # nothing depends on orientations


def test_progress_is_shown_if_wanted(capsys):
    sampler = analysis.WalkerSampler(lambda R, q: 0*R[:, 0], 300, 2, (0, 0, 0))
    sampler.burnIn(3, progress=True)
    sampler.sample(3, progress=False)
    shown = capsys.readouterr().err
    assert 'burn-in' in shown and '3/3' in shown and 'sampling' not in shown


def test_the_example_in_the_documentation():
    assert doctest.testmod(walkersModule).attempted > 0 == doctest.testmod(walkersModule).failed


# ---- Walkers against closed forms ----------------------------------------------------------------


@pytest.mark.parametrize('rejection, lowest', [('Overlap', 0.7), ('Crossing', 0.2)])
def test_gravitational_height_over_a_wall(rejection, lowest):
    """A sphere of radius 0.5 over a wall at 0.2 has an exponential law that begins where the wall
    stops it.
    """
    samples = walkers(lambda R, q: KT/0.8*R[:, 2], position=(0, 0, 2), sitePositions=[(0, 0, 0)],
                      radii=0.5, wallHeight=0.2, rejection=rejection, samples=100)
    z = samples.positions[:, :, 2]
    assert z._value.min() >= lowest
    check(samples.average(z), lowest + 0.8, 0.01)
    check(samples.average((z._value - lowest - 0.8)**2), 0.64)
    probabilities, errors = samples.histogram(z, lowest + 0.8*np.array([0, 0.5, 1, 2, 4]))
    exact = -np.diff(np.exp(-np.array([0, 0.5, 1, 2, 4])))
    assert np.all(np.abs(probabilities - exact) < LARGEST_Z*errors) and np.all(
        errors < 0.02*exact + 0.001)
    free = samples.positions._value[-1, :, :2]
    assert free.std() > 3  # x and y are sampled without any potential


@pytest.mark.parametrize('kr, exact', [(2, 0.4292307058), (10, 0.7642662212), (200, 0.9899487014)])
def test_orientations_in_a_quadrupolar_well(kr, exact):
    samples = walkers(lambda R, q: -kr/2*KT*rotation_matrices(q)[:, 0, 0]**2,
                      coordinates='rotation', samples=60)
    check(samples.average(axis(samples, 0)[..., 0]**2), exact, 0.005)
    assert not samples.positions._value.any()


@pytest.mark.parametrize('k', [0.5, 4, 30])
def test_a_dipole_in_a_field(k):
    samples = walkers(lambda R, q: -k*KT*rotation_matrices(q)[:, 2, 2], coordinates=['rotation'],
                      samples=60)
    n = axis(samples, 2)
    check(samples.average(n[..., 2]), 1/np.tanh(k) - 1/k, 0.02)
    check(samples.average(n[..., 0]*n[..., 1]), 0)
    check(samples.average(axis(samples, 0)[..., 0]**2 - axis(samples, 0)[..., 1]**2), 0)


@pytest.mark.parametrize('k, exact', [(10, 0.6510520512), (0, 0.25)])
def test_a_well_of_the_quaternion(k, exact):
    """The averages for U = -k/2 q0^2, which depends on the angle alone, distinguish Haar's measure
    from others most directly.
    """
    if k:
        x = k/4
        i0, i1, i2 = (scipy.special.iv(n, x) for n in range(3))
        assert 0.5*(1 + (i1 - (i0 + i2)/2)/(i0 - i1)) == pytest.approx(exact, abs=1e-10)
    samples = walkers(lambda R, q: -k/2*KT*q[:, 0]**2, coordinates=['rotation'], samples=60)
    check(samples.average(samples.orientations[..., 0]**2), exact, 0.005)


def test_turning_about_a_point_far_from_the_origin_changes_no_distribution():
    """An origin in a harmonic well and a dipole in a field are independent, although the moves mix
    both.
    """
    samples = walkers(lambda R, q: KT*(0.5*8*(R**2).sum(axis=1) - 3*rotation_matrices(q)[:, 2, 2]),
                      trackingPoint=(0.4, -0.3, 0.5), samples=60)
    R = samples.positions._value
    for k in range(3):
        check(samples.average(R[..., k]**2), 1/8, 0.02)
    n = axis(samples, 2)
    check(samples.average(n[..., 2]), 1/np.tanh(3) - 1/3, 0.01)
    check(samples.average(R[..., 0]*n[..., 0]), 0)
    assert 0.3 < samples.acceptance['rotation'] < 0.5


def test_the_tracking_point_stays_where_it_is():
    point = np.array([0.4, -0.3, 0.5])
    samples = walkers(lambda R, q: 0*R[:, 0], count=20, position=(1, 2, 3), coordinates='rotation',
                      trackingPoint=point)
    there = samples.positions._value + rotation_matrices(samples.orientations) @ point
    assert np.allclose(there,
                       (1.4, 1.7, 3.5), rtol=0, atol=1e-12) and samples.positions._value.std() > 0.1
    points = np.array([(0.1, 0.2, 0.1), (0, -0.3, 0)])
    samples = Scene().sample(sweeps=100, coordinates='rotation', trackingPoints=points)
    there = samples.positions._value + np.einsum('sbij,bj->sbi',
                                                 rotation_matrices(samples.orientations), points)
    assert np.allclose(there, points + [(0, 0, 0), (0, 0, 3)], rtol=0,
                       atol=1e-12) and samples.positions._value.std(axis=0).max() > 0.1


def test_turning_about_one_axis_only():
    """A dipole in the plane has <cos phi> = I1(k)/I0(k)."""
    samples = walkers(lambda R, q: -2*KT*rotation_matrices(q)[:, 0, 0], coordinates=['rotation'],
                      rotationAxis=(0, 0, -3), samples=60)
    assert not samples.orientations[..., 1:3].any()
    check(samples.average(axis(samples, 0)[..., 0]),
          scipy.special.iv(1, 2)/scipy.special.iv(0, 2), 0.01)


def test_only_the_coordinates_that_are_named_move():
    samples = walkers(lambda R, q: KT*R[:, 2]**2, position=(0.1, -0.2, 0.3), coordinates=['z'],
                      samples=20)
    assert np.all(samples.positions._value[..., :2] == (0.1, -0.2)) and np.all(
        samples.orientations == (1, 0, 0, 0))
    check(samples.average(samples.positions[:, :, 2]), 0)
    assert set(samples.stepSizes) == {'translation'}


# ---- Bodies of the literature over a wall --------------------------------------------------------


def overWall(sites, weights, strength):
    """The energy of weights, in kT/a, on the blobs, and of their repulsion, strength kT a/(h - a)
    exp(-2(h - a)/a), in units of a (Delong 2015, eq. 73)."""
    def energy(R, q):
        h = R[:, 2:] + rotation_matrices(q)[:, 2] @ sites.T
        return KT*(h @ weights + (strength/(h - 1)*np.exp(-2*(h - 1))).sum(axis=1))

    return energy


def chiSquare(probabilities, errors, exact):
    return np.sum(((probabilities - exact)/errors)**2)


def test_the_boomerang():
    """The boomerang of Delong 2015, section IV.5, g = 1, has the mean, second moment and bins of
    quadrature, which are converged to more digits than are given.

    The weight of 0.18 kT/a and the strength of 23.08 kT are as printed there. 7e4 nearly
    independent samples give the mean height to 0.25 %.
    """
    sites = app.boomerang(0.3/(0.265*np.sqrt(1.5)))._value
    samples = walkers(overWall(sites, np.full(15, 0.18/15), 23.08), 1000, position=(0, 0, 15),
                      sitePositions=sites, radii=1.0, wallHeight=0, coordinates=['z', 'rotation'],
                      samples=70, interval=10, burnIn=300)
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
    assert chiSquare(*samples.histogram(angles, np.pi/12*np.arange(6)),
                     exact) < scipy.stats.chi2.isf(1e-5, len(exact))


def test_the_tetramer():
    """The tetramer of Delong 2015, section IV.3, has four weights and edges of 4 a.

    The exact means and standard deviations are from quadrature.
    """
    sites = app.tetramer(4.0)._value
    samples = walkers(overWall(sites, np.array([0.15, 0.1, 0.3, 0.05]), 20), 1000,
                      position=(0, 0, 8), sitePositions=sites, radii=1.0, wallHeight=0,
                      coordinates=['z', 'rotation'], samples=50, interval=10, burnIn=300)
    h = samples.positions[:, :, 2]._value
    vertex = h + axis(samples, 2)[..., 2]*sites[3, 2]
    check(samples.average(h), 5.943619, 0.002)
    check(samples.average((h - 5.943619)**2), 1.747745**2)
    check(samples.average(vertex), 6.205976, 0.002)
    check(samples.average((vertex - 6.205976)**2), 2.242462**2)


# ---- Samples -------------------------------------------------------------------------------------


def poses(values, independent):
    """Samples whose observable is given."""
    samples, n = np.shape(values)
    return analysis.PoseSamples(
        np.zeros((samples, n, 3))*unit.nanometer, np.tile((1.0, 0, 0, 0), (samples, n, 1)),
        np.zeros(samples)*unit.kilojoule_per_mole,
        np.empty((samples, 0, 3))*unit.nanometer, {}, {}, independent)


def test_errors_know_the_correlation():
    """For a stationary autoregressive process of correlation 0.9, tau = 1/2 (1.9/0.1) = 9.5, and
    the error of the mean is known."""
    random = np.random.default_rng(5)
    samples, n = 4000, 50
    x = np.empty((samples, n))
    x[0] = random.normal(size=n)
    for k in range(1, samples):
        x[k] = 0.9*x[k - 1] + np.sqrt(1 - 0.81)*random.normal(size=n)
    walkers_ = poses(x, True).average(x)
    chain = poses(x[:, :1], False).average(x[:, :1])
    # The standard error from n walkers has a relative error of 1/sqrt(2 (n - 1)). The same holds
    # for b blocks.
    assert walkers_.standardError == pytest.approx(np.sqrt(19/(samples*n)),
                                                   rel=LARGEST_Z/np.sqrt(2*(n - 1)))
    assert walkers_.tau == pytest.approx(
        9.5, rel=2*LARGEST_Z/np.sqrt(2*(n - 1))) and walkers_.degrees == n - 1
    assert chain.standardError == pytest.approx(np.sqrt(19/samples),
                                                rel=LARGEST_Z/np.sqrt(2*chain.degrees))
    assert walkers_.effectiveSamples == pytest.approx(samples*n/(2*walkers_.tau))


def test_bodies_of_one_sample_count_together_or_apart():
    """Bodies that move alike give the error of one body. For walkers that do not move, tau is half
    the number of samples."""
    x = np.random.default_rng(6).normal(size=(1000, 1))
    one, three = poses(x, False).average(x), poses(np.tile(x, 3), False).average(np.tile(x, 3))
    assert three.standardError == pytest.approx(one.standardError) and three.mean == pytest.approx(
        one.mean)
    still = np.tile(np.random.default_rng(7).normal(size=200), (10, 1))
    found = poses(still, True).average(still)
    assert found.standardError == pytest.approx(
        still[0].std(ddof=1)/np.sqrt(200)) and found.tau == pytest.approx(5, rel=0.01)


def test_bins_of_a_histogram():
    x = np.array([[0.0, 1.0], [0.5, 2.0], [0.25, 3.0]])
    probabilities, errors = poses(x, True).histogram(x*unit.nanometer, [0, 0.5, 1, 2])
    assert np.allclose(probabilities, [2/6, 1/6, 2/6]) and errors.shape == (3,)
    assert np.allclose(errors, [1/3, 1/6, 1/3])  # half the difference of the two walkers


def correlated(samples, n, seed=8):
    """A series in which each bin has another autocorrelation time."""
    random = np.random.default_rng(seed)
    x = random.normal(size=(samples, n))
    for k in range(1, samples):
        x[k] = 0.95*x[k - 1] + np.sqrt(1 - 0.95**2)*x[k]
    return x


@pytest.mark.parametrize('independent, n', [(False, 1), (False, 3), (True, 1), (True, 3)])
def test_averages_are_those_of_all_samples(independent, n):
    """Probabilities of bins that cover all values add up to 1, and averages are linear, whatever
    their numbers of blocks."""
    x = correlated(300, n)
    samples = poses(x, independent)
    edges = np.array([-10, -1, -0.3, 0, 0.5, 1.5, 10])
    probabilities, errors = samples.histogram(x, edges)
    assert np.allclose(probabilities, np.histogram(x, edges)[0]/x.size, rtol=0, atol=1e-14)
    assert abs(probabilities.sum() - 1) < 1e-14 and np.all(errors > 0)
    assert samples.average(x).mean == pytest.approx(x.mean(), rel=0, abs=1e-14)
    assert samples.average(x**2).mean + samples.average(1 - x**2).mean == pytest.approx(
        1, rel=1e-14)


# ---- Bodies in a Context -------------------------------------------------------------------------


class Scene:
    """Two bodies with markers on their z axes and a free particle: body 0 in a trap of strength 20
    kT/nm^2, the free particle bound to body 0 by 10 kT/nm^2, body 1 in a trap of 5 kT/nm^2 at (0,
    0, 3), and -J kT between the bodies' axes."""
    def __init__(self, J=2.0, platform='Reference', wall=None):
        self.system = openmm.System()
        self.integrator = CustomRigidHIIntegrator(300, 0.01)
        for _ in range(2):
            particles = [self.system.addParticle(5) for _ in range(2)]
            self.integrator.addRigidBody(particles, 10, (1, 1, 1), [(0, 0, 0), (0, 0, 0.2)])
        self.system.addParticle(3)
        trap = openmm.CustomExternalForce('0.5*k*(x^2 + y^2 + (z - z0)^2)')
        for name in 'k', 'z0':
            trap.addPerParticleParameter(name)
        trap.addParticle(0, [20*KT, 0])
        trap.addParticle(2, [5*KT, 3])
        bond = openmm.CustomBondForce('0.5*k*r^2')
        bond.addGlobalParameter('k', 10*KT)
        bond.addBond(0, 4, [])
        axes = openmm.CustomCompoundBondForce(
            4, '-J*((x2-x1)*(x4-x3) + (y2-y1)*(y4-y3) + (z2-z1)*(z4-z3))')
        axes.addGlobalParameter('J', J*KT/0.04)
        axes.addBond([0, 1, 2, 3], [])
        self.force = axes
        for force in trap, bond, axes:
            self.system.addForce(force)
        self.platform = openmm.Platform.getPlatformByName(platform)
        self.context = None

    def bind(self):
        self.context = openmm.Context(self.system, self.integrator, self.platform)
        self.context.setPositions([(0, 0, 0), (0, 0, 0.2), (0, 0, 3), (0, 0, 3.2), (0, 0, 0.1)])
        return self.context

    def sample(self, sweeps=5000, burnIn=300, interval=2, seed=3, **options):
        sampler = analysis.GibbsBoltzmannSampler(self.context or self.bind(), seed=seed, **options)
        sampler.burnIn(burnIn, progress=False)
        return sampler.sample(sweeps // interval, interval, progress=False)


@pytest.mark.parametrize('options', [{}, {
    'moves': 'all',
    'sweeps': 12000,
    'interval': 4
}, {
    'trackingPoints': [(0.1, 0.2, 0.1), (0, -0.3, 0)]
}], ids=['one by one', 'all at once', 'about other points'])
def test_interacting_bodies_and_a_free_particle(options):
    """Positions have the law of a Gaussian chain, and axes have <n0 n1> = coth J - 1/J."""
    samples = Scene().sample(**{'sweeps': 6000, **options})
    R, free = samples.positions._value, samples.freePositions._value[:, 0]
    n = axis(samples, 2)
    check(samples.average((R[:, 0]**2).sum(axis=1)), 3/20)
    check(samples.average((free**2).sum(axis=1)), 3/20 + 3/10)
    check(samples.average((free*R[:, 0]).sum(axis=1)), 3/20)
    check(samples.average(((R[:, 1] - (0, 0, 3))**2).sum(axis=1)), 3/5)
    check(samples.average((n[:, 0]*n[:, 1]).sum(axis=1)), 1/np.tanh(2) - 1/2, 0.1)
    check(samples.average(n[..., 2]), 0)
    for kind in ('translation', 'rotation', 'free'):
        assert 0.25 < samples.acceptance[kind] < 0.6, (kind, samples.acceptance)


def test_the_context_is_left_at_the_last_sample(platform):
    scene = Scene(platform=platform.getName())
    samples = scene.sample(sweeps=20, burnIn=5)
    assert np.array_equal(scene.integrator.getBodyPositions()._value, samples.positions._value[-1])
    assert np.allclose(scene.integrator.getBodyOrientations(), samples.orientations[-1], rtol=0,
                       atol=1e-15)
    state = scene.context.getState(getPositions=True, getEnergy=True)
    places = state.getPositions(asNumpy=True)._value
    assert np.array_equal(places[4], samples.freePositions._value[-1, 0])
    assert np.allclose(places[2:4],
                       samples.positions._value[-1, 1] + [(0, 0, 0), 0.2*axis(samples, 2)[-1, 1]],
                       rtol=0, atol=1e-14)
    # CPU also computes bonded energies in double precision.
    assert state.getPotentialEnergy()._value == pytest.approx(samples.energies._value[-1],
                                                              rel=1e-12)
    scene.integrator.step(5)


def test_a_seed_gives_the_same_samples_again():
    first, again, other = (Scene().sample(sweeps=30, burnIn=10, seed=seed) for seed in (8, 8, 9))
    assert np.array_equal(first.positions._value, again.positions._value) and np.array_equal(
        first.orientations, again.orientations)
    assert not np.array_equal(first.positions._value, other.positions._value)
    fresh = [analysis.GibbsBoltzmannSampler(Scene().bind()).seed for _ in range(2)]
    assert fresh[0] != fresh[1] and min(fresh) > 0


def test_only_the_bodies_and_particles_that_are_named_move():
    scene = Scene()
    samples = scene.sample(sweeps=40, bodies=[1], freeParticles=[])
    assert not samples.positions._value[:, 0].any() and samples.freePositions.shape == (20, 0, 3)
    assert samples.positions._value[:, 1].std(axis=0).min() > 0
    assert np.all(
        scene.context.getState(getPositions=True).getPositions(asNumpy=True)._value[4] == (0, 0,
                                                                                           0.1))
    assert set(samples.acceptance) == {'translation', 'rotation'}


def test_what_the_integrator_holds_does_not_move():
    scene = Scene()
    scene.integrator.setBodyHeld(0, True)
    scene.integrator.setParticleHeld(4, True)
    samples = scene.sample(sweeps=40)
    assert not samples.positions._value[:, 0].any() and samples.freePositions.shape == (20, 0, 3)
    assert samples.positions._value[:, 1].std(axis=0).min() > 0
    # The samples are those of a sampler that is told to move the others only.
    named = Scene().sample(sweeps=40, bodies=[1], freeParticles=[])
    assert np.array_equal(samples.positions._value, named.positions._value)
    for name, index in (('bodies', 0), ('freeParticles', 4)):
        with refused(f'{name}: got [{index}]; each must be one of the ', 'that can move'):
            analysis.GibbsBoltzmannSampler(scene.context, **{name: [index]})


def test_forces_that_the_integrator_leaves_out_are_left_out():
    """The bodies' axes do not feel each other if that force's group is not integrated."""
    scene = Scene(J=20)
    scene.force.setForceGroup(3)
    scene.integrator.setIntegrationForceGroups({0})
    samples = scene.sample(sweeps=600, coordinates=['rotation'])
    assert samples.acceptance == {'rotation': 1}
    n = axis(samples, 2)
    check(samples.average((n[:, 0]*n[:, 1]).sum(axis=1)), 0)


def test_the_temperature_is_the_integrators_or_ones_own():
    cold = Scene().sample(sweeps=4000, temperature=75, bodies=[1], freeParticles=[],
                          coordinates=['x', 'y', 'z'])
    check(cold.average(((cold.positions._value[:, 1] - (0, 0, 3))**2).sum(axis=1)), 0.25*3/5, 0.1)


def test_further_energy():
    """A body force has no energy. So the test gives its potential, that of a dipole along x."""
    scene = Scene(J=0)
    dipole = openmmrigidhi.CustomBodyForce('0', '0', '0', '0', 'E*2*(q1*q3+q0*q2)',
                                           '-E*2*(q2*q3-q0*q1)')
    dipole.addGlobalParameter('E', 3*KT)
    dipole.addBody(0, [])
    scene.system.addForce(dipole)
    with refused('energyFunction: the System has a CustomBodyForce',
                 'give the potential of its forces and torques'):
        analysis.GibbsBoltzmannSampler(scene.bind())
    samples = scene.sample(sweeps=2500,
                           energyFunction=lambda R, q: -3*KT*rotation_matrices(q[0])[0, 2],
                           coordinates='rotation')
    check(samples.average(axis(samples, 2)[:, 0, 0]), 1/np.tanh(3) - 1/3, 0.1)
    check(samples.average(axis(samples, 2)[:, 1, 0]), 0)


class OverWall:
    """A dumbbell of two blobs of radius 0.3 with a marker, and a free blob, over a wall at 1. Each
    blob has a weight of 2 kT/nm."""
    def __init__(self, boundary=None):
        self.system, self.fluid, self.integrator = openmm.System(), MobilityForce(
        ), CustomRigidHIIntegrator(300, 0.01)
        app.addRigidMultiblob(self.system, self.integrator, self.fluid, [(-0.5, 0, 0), (0.5, 0, 0),
                                                                         (0, -4, 0)], [0.3, 0.3, 0],
                              4, (0, 1, 1))
        self.system.addParticle(1)
        self.fluid.addParticle(0.5)
        weight = openmm.CustomExternalForce('w*z')
        weight.addGlobalParameter('w', 2*KT)
        for particle in (0, 1, 3):
            weight.addParticle(particle, [])
        self.system.addForce(weight)
        self.system.addForce(self.fluid)
        self.integrator.setScheme(self.integrator.LangevinHI)
        self.context = openmm.Context(self.system, self.integrator,
                                      openmm.Platform.getPlatformByName('Reference'))
        self.context.setPositions([(-0.5, 0, 3), (0.5, 0, 3), (0, -4, 3), (3, 0, 3)])


@pytest.mark.parametrize('rejection, stops', [('Overlap', (0.3, 0.5)), ('Crossing', (0, 0))])
def test_blobs_over_a_wall(rejection, stops):
    """The dumbbell's z above contact is the lower blob's height plus |cos|/2, and has the density
    exp(-4 z). Here c = |cos| is uniform in 0..1, weighted by exp(-4 c/2), so <z> = 1/4 + <c>/2. The
    marker of radius 0 is free, and at times far below the wall."""
    scene = OverWall()
    sampler = analysis.GibbsBoltzmannSampler(scene.context, wallHeight=1*unit.nanometer,
                                             rejection=rejection, seed=2,
                                             coordinates=['z', 'rotation'])
    sampler.burnIn(300, progress=False)
    samples = sampler.sample(3000, 2, progress=False)
    ends = samples.positions._value[..., 2:] + 0.5*axis(samples, 0)[..., 2:]*(-1, 1)
    assert ends.min() >= 1 + stops[0] and samples.freePositions._value[..., 2].min() >= 1 + stops[1]
    c = 1/2 - np.exp(-2)/(1 - np.exp(-2))
    check(samples.average(samples.positions[:, 0, 2]), 1 + stops[0] + 1/4 + c/2, 0.02)
    check(samples.average(np.abs(axis(samples, 0)[:, 0, 2])), c, 0.04)
    check(samples.average(samples.freePositions[:, 0, 2]), 1 + stops[1] + 1/2, 0.02)
    assert (samples.positions._value[:, 0, 2] - 4*axis(samples, 1)[:, 0, 2]).min() < 0
    assert not samples.positions._value[..., :2].any()


def test_the_wall_of_the_fluid_is_taken(monkeypatch):
    """Height, radii and rejection come from MobilityForce and integrator where these have a wall.
    """
    class Name:
        def __init__(self, name):
            self.name = name

    scene = OverWall()
    plain = analysis.GibbsBoltzmannSampler(scene.context)
    assert plain._walls == []
    monkeypatch.setattr(MobilityForce, 'getBoundary', lambda self: MobilityForce.NoSlipWall)
    monkeypatch.setattr(MobilityForce, 'getWallHeight', lambda self: 2*unit.nanometer,
                        raising=False)
    monkeypatch.setattr(CustomRigidHIIntegrator, 'getWallRejection', lambda self: Name('Overlap'),
                        raising=False)
    wall, = analysis.GibbsBoltzmannSampler(scene.context)._walls
    assert np.allclose(wall.limits, [2.3, 2.3, -np.inf, 2.5]) and not wall.crossing
    monkeypatch.setattr(CustomRigidHIIntegrator, 'getWallRejection', lambda self: Name('Crossing'),
                        raising=False)
    wall, = analysis.GibbsBoltzmannSampler(scene.context)._walls
    assert np.allclose(wall.limits, [2, 2, -np.inf, 2]) and wall.crossing
    assert analysis.GibbsBoltzmannSampler(scene.context, rejection='Overlap',
                                          radii=0.1)._walls[0].limits[2] == pytest.approx(2.1)


def test_virtual_sites_follow():
    """A virtual site in the middle of two free particles in traps has a weight. Each of the two
    particles feels half of this weight."""
    system = openmm.System()
    for mass in (1, 1, 0):
        system.addParticle(mass)
    system.setVirtualSite(2, openmm.TwoParticleAverageSite(0, 1, 0.5, 0.5))
    trap, weight = openmm.CustomExternalForce('0.5*k*(x^2+y^2+z^2)'), openmm.CustomExternalForce(
        'w*z')
    trap.addGlobalParameter('k', 4*KT)
    weight.addGlobalParameter('w', 4*KT)
    for particle in range(2):
        trap.addParticle(particle, [])
    weight.addParticle(2, [])
    for force in trap, weight:
        system.addForce(force)
    integrator = CustomRigidHIIntegrator(300, 0.01)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions(np.zeros((3, 3)))
    sampler = analysis.GibbsBoltzmannSampler(context, seed=1)
    sampler.burnIn(200, progress=False)
    samples = sampler.sample(2000, 3, progress=False)
    assert samples.freePositions.shape == (2000, 2, 3) and samples.positions.shape == (2000, 0, 3)
    for particle in range(2):
        check(samples.average(samples.freePositions[:, particle, 2]), -0.5)
        check(samples.average(samples.freePositions[:, particle, 0]), 0)


class _Stop(BaseException):
    """Like KeyboardInterrupt, which pytest would take for the user's."""


def test_sampling_goes_on_after_an_interruption():
    """Ctrl-C or an exception in energyFunction ends a move in its middle. Particles are then where
    poses and energy say. The calls that end differ, so that bodies and the free particle are on
    their way in turns."""
    calls, end = [0], [None]

    def more(R, q):
        calls[0] += 1
        if calls[0] == end[0]:
            raise _Stop
        return 0.0

    sampler = analysis.GibbsBoltzmannSampler(Scene().bind(), energyFunction=more, seed=3)
    sampler.burnIn(20, progress=False)
    for k in range(12):
        end[0] = calls[0] + 5 + k
        free = sampler._places[sampler._free].copy()
        with pytest.raises(_Stop):
            sampler.sample(50, progress=False)
        # The energy is that of the same numbers, but for poses that are rounded in places.
        assert sampler._evaluate(sampler._positions,
                                 sampler._orientations) == pytest.approx(sampler._energy, abs=1e-9)
        members = sampler._members_at(slice(None), sampler._positions, sampler._orientations)
        assert np.abs(sampler._places[sampler._members] - members).max() < 1e-12
    assert np.any(sampler._places[sampler._free] != free)


# ---- Bad input -----------------------------------------------------------------------------------


def energy(R, q):
    return np.zeros(len(R))


@pytest.mark.parametrize(
    'arguments, pieces',
    [(dict(coordinates=['x', 'theta']), ('coordinates: got', 'one or more of x, y, z, rotation')),
     (dict(coordinates=[]), ('coordinates: got []', 'one or more of')),
     (dict(rotationAxis=(0, 0, 0)),
      ('rotationAxis: got', 'to turn about it its length must be finite')),
     (dict(temperature=0),
      ('temperature: got 0.0 K', 'a Boltzmann distribution needs a finite temperature above 0')),
     (dict(seed=-1), ('seed: got -1', 'seeds are not negative')),
     (dict(rejection='Bounce', wallHeight=0, radii=1, sitePositions=[(0, 0, 0)]),
      ("rejection: got 'Bounce'", "a wall rejects 'Overlap'")),
     (dict(wallHeight=0),
      ('wallHeight: got a wall, but no sitePositions or no radii', 'give both')),
     (dict(wallHeight=0, radii=[1], sitePositions=[(0, 0, 0),
                                                   (1, 0, 0)]), ('radii: got 1 for 2 sites',)),
     (dict(wallHeight=0, radii=1, sitePositions=[(0, 0, 0)]),
      ('position: walker 0 begins at', 'a start must be allowed')),
     (dict(orientation=(1, 1, 0, 0)),
      ('orientation: got (1, 1, 0, 0)', 'must have the length 1 to be rotations')),
     (dict(position=[(0, 0, 0)]*2), ('position: got an array of shape (2, 3)',)),
     (dict(numWalkers=0), ('numWalkers: got 0', 'must be 1 or more')),
     (dict(energyFunction=lambda R, q: np.zeros((len(R), 2))),
      ('it returned an array of shape (3, 2) for 3 poses',)),
     (dict(energyFunction=lambda R, q: np.full(len(R), np.nan)),
      ('energyFunction: it returned nan',
       'energies must be numbers, or infinity where a pose is forbidden')),
     (dict(energyFunction=lambda R, q: np.full(len(R), np.inf)),
      ('is inf at the start of walker 0', 'begin elsewhere')),])
def test_bad_walkers(arguments, pieces):
    arguments = {
        'energyFunction': energy,
        'temperature': 300,
        'numWalkers': 3,
        'position': (0, 0, 0),
        **arguments
    }
    with refused('WalkerSampler', *pieces):
        analysis.WalkerSampler(**arguments)


def test_energies_may_be_quantities():
    samples = walkers(lambda R, q: 10*KT*(R**2).sum(axis=1)*unit.kilojoule_per_mole/2, count=200)
    check(samples.average(samples.positions._value[..., 0]**2), 1/10)
    scene = Scene()
    potential = scene.sample(
        sweeps=4, energyFunction=lambda R, q: 1*unit.kilocalorie_per_mole).energies._value[-1]
    assert potential - scene.context.getState(
        getEnergy=True).getPotentialEnergy()._value == pytest.approx(4.184)
    with refused('energyFunction: got a quantity in', error=TypeError):
        scene.sample(sweeps=4, energyFunction=lambda R, q: 1*unit.kelvin)


def test_infinity_forbids():
    samples = walkers(lambda R, q: np.where(np.abs(R).max(axis=1) < 1, 0, np.inf), count=200)
    assert np.abs(samples.positions._value).max() < 1
    check(samples.average(samples.positions._value[..., 0]**2), 1/3)


def test_driven_flows_are_refused():
    """Bodies in a flow are not distributed as exp(-U/kT), so the sampler refuses them."""
    def context(drive):
        system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(
            300, 0.01)
        integrator.setScheme(CustomRigidHIIntegrator.EulerMaruyama)
        integrator.addRigidBody([system.addParticle(0)], 0, (0, 0, 0), [(0, 0, 0)])
        fluid.addParticle(1)
        drive(fluid)
        system.addForce(fluid)
        system.setDefaultPeriodicBoxVectors(*9*np.eye(3))
        made = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
        made.setPositions(np.zeros((1, 3)))
        return made

    def wave(fluid, f0):
        fluid.setModel(MobilityForce.ForceCoupling)
        fluid.setBoundary(MobilityForce.Periodic)
        fluid.setSinusoidalForceDensity(f0, 0, 1, 1)

    shear = np.zeros((3, 3))
    shear[0, 2] = 0.25
    analysis.GibbsBoltzmannSampler(context(lambda fluid: None))
    analysis.GibbsBoltzmannSampler(context(lambda fluid: wave(fluid, 0)))
    with refused(
            'GibbsBoltzmannSampler: context: its MobilityForce drives the fluid by a sinusoidal '
            'force density of 2.0 kJ/(mol nm^4)', 'no equilibrium in a driven flow',
            'average over steps of the integrator', 'setSinusoidalForceDensity() with zeros'):
        analysis.GibbsBoltzmannSampler(context(lambda fluid: wave(fluid, 2)))
    for velocity, gradient in ((0, 0, 0), shear), ((1, 0, 0), 0*shear):
        with refused('its MobilityForce drives the fluid by a background flow of', str(velocity[0]),
                     str(gradient[0, 2]), 'setBackgroundFlow() with zeros'):
            analysis.GibbsBoltzmannSampler(
                context(lambda fluid: fluid.setBackgroundFlow(velocity, gradient)))

    def between(fluid, setter, value):
        fluid.setBoundary(MobilityForce.NoSlipChannel)
        fluid.setChannelWalls(-2, 2)
        setter(fluid, value)

    for setter, flow in ((MobilityForce.setWallVelocity, 'a wall of the velocity [1.0, 0.0, 0.0]'),
                         (MobilityForce.setBodyForceDensity,
                          'a uniform force density of [1.0, 0.0, 0.0] kJ/(mol nm^4)')):
        analysis.GibbsBoltzmannSampler(context(lambda fluid: between(fluid, setter, (0, 0, 0))))
        with refused(f'drives the fluid by {flow}', f'{setter.__name__}() with zeros'):
            analysis.GibbsBoltzmannSampler(context(lambda fluid: between(fluid, setter, (1, 0, 0))))


@pytest.mark.parametrize(
    'arguments, pieces',
    [(dict(moves='some'), ("moves: got 'some'", 'must be "single" or "all"')),
     (dict(bodies=[2]), ('bodies: got [2]', 'one of the 2 that can move')),
     (dict(freeParticles=[4, 4]), ('freeParticles: got [4, 4]', 'take out repetitions')),
     (dict(trackingPoints=[(0, 0, 0)]), ('trackingPoints: got an array of shape (1, 3)',)),
     (dict(wallHeight=0), ('radii: got a wall, but every radius is 0', 'MobilityForce')),
     (dict(wallHeight=2, radii=[0, 0, 0.1, 0.1, 0.3]),
      ('context: particle 4 (free) is at z = 0.1 nm',
       'a start must be allowed: set positions away')),
     (dict(wallHeight=3, radii=[0, 0, 0.1, 0.1, 0]),
      ('context: particle 2 (body 1) is at z = 3.0 nm, where a wall allows 3.1 nm or more',)),
     (dict(energyFunction=lambda R, q: R),
      ('energyFunction: it returned', 'it must return one number, kJ/mol')),
     (dict(energyFunction=lambda R, q: np.inf), ('context: the energy at the start is inf',)),])
def test_bad_samplers(arguments, pieces):
    context = Scene().bind()
    with refused('GibbsBoltzmannSampler', *pieces):
        analysis.GibbsBoltzmannSampler(context, **arguments)


def test_constraints_on_what_moves():
    scene = Scene()
    scene.system.addParticle(1)
    scene.system.addConstraint(4, 5, 0.1)
    scene.context = openmm.Context(scene.system, scene.integrator, scene.platform)
    scene.context.setPositions([(0, 0, 0), (0, 0, 0.2), (0, 0, 3), (0, 0, 3.2), (0, 0, 0.1),
                                (0, 0, 0.2)])
    with refused('freeParticles: a constraint holds the free particles 4 and 5',
                 'make them a body'):
        analysis.GibbsBoltzmannSampler(scene.context)
    assert len(scene.sample(sweeps=4, freeParticles=[])) == 2


def test_bad_samples():
    samples = Scene().sample(sweeps=20)
    for values in (np.zeros(9), np.zeros((10, 3))):
        with refused('average: values: got an array of shape', 'for 10 samples of 2 bodies'):
            samples.average(values)
    with refused('average: values', '(samples, bodies)'):
        poses(np.zeros((4, 2)), True).average(np.zeros(4))
    with refused('histogram: edges: got [1. 1.]', 'at least two edges in ascending order'):
        samples.histogram(np.zeros(10), [1, 1])
    with refused('numSamples: got 0'):
        analysis.GibbsBoltzmannSampler(Scene().bind()).sample(0)


def test_bodies_without_mass_need_a_scheme_without_momenta():
    """The Context refuses such bodies by name and names the remedy, with which the sampler takes
    them."""
    system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(300, 0.01)
    app.addRigidMultiblob(system, integrator, fluid, [(-0.5, 0, 0), (0.5, 0, 0), (0, 0.5, 0)], 0.4)
    platform = openmm.Platform.getPlatformByName('Reference')
    with refused(
            'body 0 has mass 0',
            'a scheme without momenta such as FixmanMidpoint, with a MobilityForce (for Monte '
            'Carlo too)', error=openmm.OpenMMException):
        openmm.Context(system, integrator, platform)
    integrator.setScheme(integrator.FixmanMidpoint)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, platform)
    context.setPositions([(-0.5, 0, 0), (0.5, 0, 0), (0, 0.5, 0)])
    sampler = analysis.GibbsBoltzmannSampler(context, coordinates=['rotation'], seed=1)
    assert sampler.sample(3).orientations.shape == (3, 1, 4)
