"""analysis.viscosity: shells, spheres and lattices have their known viscosities. Further tests are
of noise, drift, channels, and refused input."""
import copy
import json
import pathlib
import re
import subprocess
import sys
import warnings

import numpy as np
import openmm
import openmm.app
import pytest
from openmm import unit
from scipy import stats

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, analysis, app
from openmmrigidhi.accuracy.statistics import quantile

VALIDATION = pathlib.Path(__file__).resolve().parents[2]/'validation'
FALSE_ALARMS = 1e-6  # probability for each comparison with noise
ETA, F0 = 1.5, 0.7
KT = 300*8.31446261815324e-3
CROSS = np.array([(0, 0, 0), (1.8, 0, 0), (-1.8, 0, 0), (0, 1.8, 0), (0, 0, 1.8)])

#: For tests of single spheres without stresslets.
DO_NOT_RESIST = pytest.mark.filterwarnings('ignore:.* do not resist the strain')


@pytest.fixture(scope='module')
def run():
    """validation/accuracy/viscosity/run.py as a module."""
    sys.path[:0] = [str(VALIDATION/'accuracy'/'viscosity'), str(VALIDATION/'common')]
    try:
        sys.modules.pop('run', None)
        import run as module
        yield module
    finally:
        sys.modules.pop('run', None)
        del sys.path[:2]


def driven(bodies, box, model='RotnePragerYamakawa', temperature=0, scheme='DriftCorrectorFD',
           f0=F0, axes=(0, 1, 1), step=0.05, seed=3, platform='CPU', setUp=lambda fluid: None):
    """A Context of bodies (sites, radii, place): integrator, fluid, context."""
    system, fluid = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(temperature, step)
    integrator.setScheme(getattr(CustomRigidHIIntegrator, scheme))
    integrator.setRandomNumberSeed(seed)
    inertia = {'mass': 100, 'principalMoments': (40, 40, 40)} if scheme == 'LangevinHI' else {}
    for sites, radii, _ in bodies:
        app.addRigidMultiblob(system, integrator, fluid, sites, radii, **inertia)
    fluid.setViscosity(ETA)
    fluid.setModel(getattr(MobilityForce, model))
    fluid.setBoundary(MobilityForce.Periodic)
    fluid.setSinusoidalForceDensity(f0, *axes)
    setUp(fluid)
    system.addForce(fluid)
    system.setDefaultPeriodicBoxVectors(*np.diag(np.asarray(box, float)).tolist())
    app.bindBodies(system, integrator)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platform),
                             {'Threads': '1'} if platform == 'CPU' else {})
    context.setPositions(np.concatenate([np.asarray(sites) + place for sites, _, place in bodies]))
    integrator.setBodyPositions([place for _, _, place in bodies])
    integrator.setBodyOrientations([(1, 0, 0, 0)]*len(bodies))
    return integrator, fluid, context


def sphere(*place):
    return np.zeros((1, 3)), 1.0, place


# ---- Without noise -------------------------------------------------------------------------------


@pytest.mark.parametrize('blobs', [12, 42, 162])
@pytest.mark.parametrize('model', ['RotnePragerYamakawa', 'ForceCoupling'])
def test_dilute_shells(run, model, blobs):
    """The slope in the volume fraction is 5/2 for spheres of the shell's stresslet radius, which
    dense algebra gives independently. The error by one body's images and by the curvature of the
    wave is far below (k a)^2 = 0.025, and 1e-3 is allowed."""
    sites, radius = run.shell(blobs)
    due = 2.5*run.stressletRadius(sites, radius, model)**3
    slope = (run.dilute(model, (sites, radius), 40.0) - 1)*40**3/(4/3*np.pi)
    assert slope == pytest.approx(due, rel=1e-3)


def test_the_way_a_shell_is_turned_does_not_matter(run):
    """To first order in the volume fraction the orientation has no effect, because an icosahedron
    is isotropic in strain.

    What remains is of order (k a)^2, and the effect of images.
    """
    sites, radius = run.shell(12)
    scene = run.Scene('RotnePragerYamakawa', [(sites, radius)], (40.0,)*3)
    q = np.random.default_rng(2).standard_normal((3, 4))
    ratios = [
        scene.viscosity(np.zeros((1, 3)), turn[None]/np.linalg.norm(turn)).ratio for turn in q
    ]
    assert np.ptp(ratios) < 2e-3*(ratios[0] - 1) and ratios[0] > 1 + 2.4e-4


def test_dilute_spheres_with_stresslets(run):
    """The slope is Einstein's 5/2, reduced by the average of the wave over the sphere: the square
    of t(k) = 3 j1(ka)/(ka) = 1 - (ka)^2/10. Images have an effect of the order of the volume
    fraction, 6.5e-5."""
    edge = 40.0
    slope = (run.dilute('StokesianDynamics', (np.zeros((1, 3)), 1.0), edge) - 1)*edge**3/(4/3*np.pi)
    assert slope == pytest.approx(2.5*(1 - (2*np.pi/edge)**2/5), rel=3e-4)


@pytest.mark.parametrize('model, solver', [('ForceCoupling', 'Dense'),
                                           ('ForceCoupling', 'MatrixFree'),
                                           ('RotnePragerYamakawa', 'Dense')])
def test_spheres_without_stresslets_leave_the_viscosity_as_it_is(model, solver):
    """Spheres without forces make no flow, whatever their number."""
    places = 2.2*np.stack(np.meshgrid(*[np.arange(3)]*3), axis=-1).reshape(-1, 3)
    _, _, context = driven([sphere(*place) for place in places], (6.6,)*3, model,
                           setUp=lambda fluid: fluid.setSolver(getattr(fluid, solver)))
    with pytest.warns(
            UserWarning, match='viscosity: all bodies are single spheres of model '
            f'{model}, which do not resist .* fraction of 0.39 and more: use setModel'):
        found = analysis.viscosity(context)
    assert found.ratio == pytest.approx(1, abs=1e-12) and found.ratioError == 0
    assert found.samples == 1 and not found.isTrusted
    assert 'not trusted: all bodies are single spheres' in str(found)


def test_spheres_that_resist_are_not_warned_of(run):
    """Stresslets, and shells of blobs."""
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        for bodies, model in (([sphere(1, 2, 3)], 'StokesianDynamics'),
                              ([(*run.shell(12), (1, 2, 3))], 'ForceCoupling')):
            found = analysis.viscosity(driven(bodies, (15,)*3, model)[2])
            assert found.isTrusted and str(found).endswith('samples: 1\ntrusted')


@pytest.mark.parametrize('fraction, stresslets', [(0.027, 1.066332), (0.125, 1.301682),
                                                  (0.45, 2.437858)])
def test_lattices_in_long_waves(run, fraction, stresslets):
    """In waves that are much longer than their spacing, simple cubic arrays have the viscosity of
    uniform shear. The next term is (k spacing)^2. After the extrapolation the fourth power is left,
    (2 pi/32)^4 = 1.5e-3 of the stresslets' effect, times a small prefactor."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter('always')
        ratios = [run.lattice(fraction, count) for count in (16, 32)]
    assert (4*ratios[1] - ratios[0])/3 == pytest.approx(stresslets, abs=1e-4*(stresslets - 1))
    assert abs(ratios[1] - stresslets) < 2e-2*(stresslets - 1)
    # Lubrication, which is on, does not act on the strain of a wave.
    assert len(told) == (2 if fraction > 0.1 else 0)
    for warning in told:
        assert 'does not act on the strain' in str(warning.message) and 'setShear()' in str(
            warning.message)


def test_units_and_definitions():
    """viscosity = f0/(k^2 amplitude), and shear rate = k amplitude. The sign of f0 does not matter,
    and without noise the sizes of f0 and of the box do not matter either."""
    bodies = [(CROSS, 1.0, (1, 2, 3)), (CROSS, 1.0, (6, 7, 2))]
    found = {}
    for f0 in (F0, -F0, 5*F0):
        _, fluid, context = driven(bodies, (12, 11, 13), f0=f0, axes=(2, 1, 1))
        one = found[f0] = analysis.viscosity(context)
        k = 2*np.pi/11
        sine, cosine = fluid.getFlowModeInContext(context, 2, 1, 1)._value
        assert one.viscosity.unit == fluid.getViscosity(
        ).unit and one.amplitude.unit == unit.nanometer/unit.picosecond
        assert one.amplitude._value == pytest.approx(
            np.sign(f0)*sine, rel=1e-12) and one.cosine._value == pytest.approx(
                np.sign(f0)*cosine, rel=1e-9)
        assert one.viscosity._value == pytest.approx(f0/(k**2*sine),
                                                     rel=1e-12) and one.ratio == pytest.approx(
                                                         one.viscosity._value/ETA, rel=1e-12)
        assert one.shearRate._value == pytest.approx(
            k*abs(sine), rel=1e-12) and one.shearRate.unit == unit.picosecond**-1
    assert found[-F0].ratio == pytest.approx(found[F0].ratio, rel=1e-10) == pytest.approx(
        found[5*F0].ratio, rel=1e-10) and found[F0].ratio > 1.001


def test_a_run_without_noise_is_a_mean_over_time():
    """The expected amplitude is the mean over steps that getFlowModeInContext gives one by one,
    after those of the equilibration."""
    bodies = [(CROSS, 1.0, (1, 2, 3)), (CROSS, 1.0, (6, 7, 2))]
    _, _, context = driven(bodies, (12, 11, 13), step=0.5)
    found = analysis.viscosity(context, 24, 7, 2, progress=False)
    integrator, fluid, context = driven(bodies, (12, 11, 13), step=0.5)
    integrator.step(7)
    amplitudes = []
    for _ in range(12):
        integrator.step(2)
        amplitudes.append(fluid.getFlowModeInContext(context, 0, 1, 1)._value)
    amplitudes = np.array(amplitudes)
    again = analysis.viscosityFromAmplitudes(
        context,
        np.hstack([amplitudes, 0*amplitudes])*(unit.nanometer/unit.picosecond))
    assert again == found and found.samples == 12
    statistics = analysis.series.seriesStatistics(amplitudes[:, 0])
    assert (found.amplitude._value == statistics.mean
            and found.amplitudeError._value == statistics.standardError > 0)
    assert found.tau == pytest.approx(
        12*statistics.standardError**2/(2*np.var(amplitudes[:, 0], ddof=1)))
    assert found.ratioError/found.ratio == pytest.approx(statistics.standardError/statistics.mean)


def test_a_channel_is_half_a_periodic_box():
    """A body between slip walls has the viscosity of this body and its mirror image in a box of
    twice the width. The wave is along the walls and is its own mirror image."""
    sites = CROSS*(1, 1, 1)
    place = np.array((2, 3.5, 4))
    mirrored = sites*(1, -1, 1)
    _, _, channel = driven([(sites, 1.0, place)], (9, 12, 10), 'ForceCoupling', axes=(0, 2, 1),
                           setUp=lambda fluid:
                           (fluid.setBoundary(fluid.SlipChannel), fluid.setChannelWalls(0, 7)))
    _, _, box = driven([(sites, 1.0, place), (mirrored, 1.0, place*(1, -1, 1) + (0, 14, 0))],
                       (9, 14, 10), 'ForceCoupling', axes=(0, 2, 1))
    one, two = analysis.viscosity(channel), analysis.viscosity(box)
    assert one.ratio == pytest.approx(two.ratio, rel=1e-9) and one.ratio > 1.02


# ---- With noise ----------------------------------------------------------------------------------


@DO_NOT_RESIST
def test_the_noise_of_a_step_and_a_mean_of_many():
    """For force-coupling spheres on a grid without forces, the amplitude is that of the driven flow
    plus that of the random field. The latter has the variance 4 kT/(eta k^2 V h) and is new at each
    step. So the ratio is 1 within its errors, which are those of independent samples, and it is
    exactly 1 without the field's own amplitude. EulerMaruyama is right here, since the mobility has
    no divergence."""
    steps, edge, step = 1500, 6.0, 0.05
    integrator, fluid, context = driven(
        [sphere(1, 2, 3), sphere(4, 4, 1)], (edge,)*3, 'ForceCoupling', 300, 'EulerMaruyama', 5.0,
        setUp=lambda fluid: (fluid.setSolver(fluid.MatrixFree), fluid.setSolverTolerance(1e-3)),
        step=step)
    k = 2*np.pi/edge
    amplitudes = analysis.sampleFlowAmplitudes(context, steps, progress=False)._value
    spread = np.sqrt(4*KT/(ETA*k**2*edge**3*step))
    for column in amplitudes.T:
        # The variance of n Gaussian samples has the relative standard error sqrt(2/n).
        assert abs(column.var()/spread**2 - 1) < quantile(1 - FALSE_ALARMS, np.inf)*np.sqrt(2/steps)
    exact = analysis.viscosityFromAmplitudes(context, amplitudes)
    assert exact.ratio == pytest.approx(
        1, abs=1e-10) and exact.ratioError < 1e-10 and abs(exact.cosine/exact.amplitude) < 1e-10
    found = analysis.viscosityFromAmplitudes(context, amplitudes*(1, 1, 0, 0))
    z = (found.ratio - 1)/found.ratioError
    print(f'{found.ratio:.4f} +- {found.ratioError:.4f}, z = {z:.2f}')
    assert abs(z) < quantile(1 - FALSE_ALARMS, found.degrees)
    assert found.degrees == 19
    # The variance of twenty blocks is a chi-squared variable of 19 degrees.
    low, high = (np.sqrt(stats.chi2.ppf(p, found.degrees)/found.degrees)
                 for p in (FALSE_ALARMS/2, 1 - FALSE_ALARMS/2))
    assert found.degrees == 19 and low < found.amplitudeError._value/(spread/np.sqrt(steps)) < high
    assert abs(found.cosine/found.cosineError) < quantile(1 - FALSE_ALARMS, found.degrees)


@DO_NOT_RESIST
def test_the_fields_own_amplitude_is_taken_out_by_regression():
    """For synthetic samples the mean stays right, and the error is that of the part that the field
    does not explain."""
    _, _, context = driven([sphere(1, 2, 3)], (9, 9, 9))
    random, n = np.random.default_rng(5), 4000
    field, rest = 3*random.standard_normal((n, 2)), 0.2*random.standard_normal((n, 2))
    found = analysis.viscosityFromAmplitudes(
        context, np.hstack([np.array((10, 0)) + 0.7*field + rest, field]))
    low, high = (np.sqrt(stats.chi2.ppf(p, found.degrees)/found.degrees)
                 for p in (FALSE_ALARMS/2, 1 - FALSE_ALARMS/2))
    for error in (found.amplitudeError, found.cosineError):
        assert low < error._value/(0.2/np.sqrt(n)) < high
    for value, exact, error in ((found.amplitude, 10, found.amplitudeError), (found.cosine, 0,
                                                                              found.cosineError)):
        assert abs(value._value - exact)/error._value < quantile(1 - FALSE_ALARMS, found.degrees)


@DO_NOT_RESIST
def test_errors_know_slow_fluctuations_under_white_noise():
    """The samples have a slow part with a fiftieth of the variance. The autocorrelation of single
    samples does not show this part, but it makes half the variance of the mean."""
    _, _, context = driven([sphere(1, 2, 3)], (9, 9, 9))
    random, n, replicas, memory, share = np.random.default_rng(8), 6000, 150, np.exp(-1/25), 0.02
    slow = np.empty((n, replicas))
    slow[0] = random.standard_normal(replicas)
    for k in range(1, n):
        slow[k] = memory*slow[k - 1] + np.sqrt(1 - memory**2)*random.standard_normal(replicas)
    amplitudes = 10 + random.standard_normal((n, replicas)) + np.sqrt(share)*slow
    tau = (0.5 + share*(0.5 + memory/(1 - memory)))/(1 + share)
    found = [
        analysis.viscosityFromAmplitudes(context,
                                         np.stack([column, column, 0*column, 0*column], axis=1))
        for column in amplitudes.T
    ]
    variance = 2*tau*(1 + share)/n
    # Blocks have twelve memory times, so 8 % of the slow part's share is correlation between
    # blocks. The mean of 150 variances of 19 degrees is known to 2.6 %.
    assert np.mean([one.amplitudeError._value**2
                    for one in found]) == pytest.approx(variance, rel=0.15)
    assert np.mean([one.tau for one in found]) == pytest.approx(tau, rel=0.15) and tau > 0.95
    z = np.array([(one.amplitude._value - 10)/one.amplitudeError._value for one in found])
    assert abs(z).max() < quantile(1 - FALSE_ALARMS/replicas, 19)


@pytest.mark.parametrize('scheme', ['DriftCorrectorFD', 'FixmanMidpoint', 'TractionEulerMaruyama'])
def test_parts_are_the_whole(scheme):
    """viscosity() of a run equals viscosityFromAmplitudes() of its parts, with the same seed."""
    bodies = [(CROSS, 1.0, (1, 2, 3))]
    arguments = (bodies, (9, 9, 9), 'RotnePragerYamakawa', 300, scheme, 200.0)
    whole = analysis.viscosity(
        driven(*arguments, platform='Reference')[2], 31, 4, 3, progress=False)
    integrator, _, context = driven(*arguments, platform='Reference')
    integrator.step(4)
    parts = [
        analysis.sampleFlowAmplitudes(context, steps, 3, progress=False)._value
        for steps in (6, 9, 15)
    ]
    assert analysis.viscosityFromAmplitudes(context, np.concatenate(parts)) == whole
    assert whole.samples == 10 and whole.ratioError > 0 and whole.ratio == pytest.approx(
        1.2, abs=0.5)


def test_a_simulation_counts_its_steps():
    integrator, _, context = driven([sphere(1, 2, 3)], (9,)*3, 'StokesianDynamics')
    simulation = openmm.app.Simulation(app.bodyTopology(context.getSystem(), integrator),
                                       context.getSystem(), copy.deepcopy(integrator))
    simulation.context.setPositions([(1, 2, 3)])
    found = analysis.viscosity(simulation, 12, 3)
    assert simulation.currentStep == 15 and found.samples == 12
    assert len(analysis.sampleFlowAmplitudes(simulation, 4)._value) == 4
    assert simulation.currentStep == 19
    with pytest.raises(TypeError, match='got str; it must be an openmm.Context or an openmm.app'):
        analysis.viscosity('simulation')


@DO_NOT_RESIST
def test_progress_bars(capfd):
    _, _, context = driven([sphere(1, 2, 3)], (9, 9, 9))
    analysis.viscosity(context, 3, 2, progress=True)
    shown = capfd.readouterr().err
    assert 'equilibration' in shown and 'sampling the flow' in shown and '3/3' in shown


# ---- Between walls -------------------------------------------------------------------------------


def channel(bodies, height, force=(0.3, -0.4, 0), setUp=lambda fluid: None, **arguments):
    """A Context of bodies in a channel from z = 1, in a box as wide as the channel is high."""
    def between(fluid):
        fluid.setSinusoidalForceDensity(0, 0, 1, 1)
        fluid.setBoundary(fluid.NoSlipChannel)
        fluid.setChannelWalls(1, 1 + height)
        fluid.setBodyForceDensity(force)
        setUp(fluid)

    return driven(bodies, (height,)*3, setUp=between, **arguments)


@DO_NOT_RESIST
def test_a_channel_without_what_resists():
    """A sphere goes with the flow: the mean flow is f H^2/(12 eta), and the shear at a wall
    f H/(2 eta)."""
    _, fluid, context = channel([sphere(1, 2, 3)], 6)
    found = analysis.viscosity(context)
    assert found.ratio == pytest.approx(1, abs=1e-12) and found.viscosity._value == pytest.approx(
        ETA, rel=1e-12)
    assert found.amplitude._value == pytest.approx(0.5*36/(12*ETA), rel=1e-12)
    assert found.shearRate._value == pytest.approx(0.5*6/(2*ETA), rel=1e-12)
    assert found.cosine._value == pytest.approx(0, abs=1e-13)
    assert fluid.getMeanFlowInContext(context)._value == pytest.approx(
        np.array([0.3, -0.4, 0])*36/(12*ETA), abs=1e-13)
    wave = channel([sphere(1, 2, 3)], 6, (0, 0, 0),
                   setUp=lambda fluid: fluid.setSinusoidalForceDensity(-F0, 0, 1, 1))[2]
    assert analysis.viscosity(wave).ratio == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize('place', [1/4, 1/3, 1/2])
def test_a_small_shell_in_a_channel(run, place):
    """The stresslet S = 20/3 pi eta a^3 E of a small sphere at the height s takes the part
    40 pi a^3 (1/2 - s/H)^2/V of the mean flow: half the way to the middle a quarter, and in the
    middle nothing. The mean over the heights is Einstein's 5/2 of the volume fraction. Images by
    the walls change the stresslet by (a/s)^3, and the curvature of the flow by (a/H)^2.
    """
    sites, radius = run.shell(12)
    scale, height = 0.3, 12.0
    _, _, context = channel([(scale*sites, scale*radius, (3, 4, 1 + place*height))], height)
    found = analysis.viscosity(context)
    a = scale*run.stressletRadius(sites, radius, 'RotnePragerYamakawa')
    due = 40*np.pi*a**3*(1/2 - place)**2/height**3
    assert 1 - 1/found.ratio == pytest.approx(due, rel=0.01, abs=1e-3*40*np.pi*a**3/height**3)


def film(bodies, height, force=(0.3, -0.4, 0), tolerance=1e-3):
    """A Context of bodies in a film on a wall at z = 1, in a box as wide as the film is high."""
    def onAWall(fluid):
        fluid.setSinusoidalForceDensity(0, 0, 1, 1)
        fluid.setBoundary(fluid.Film)
        fluid.setChannelWalls(1, 1 + height)
        fluid.setBodyForceDensity(force)
        fluid.setSolverTolerance(tolerance)

    return driven(bodies, (height,)*3, model='ForceCoupling', setUp=onAWall)


@DO_NOT_RESIST
def test_a_film_without_what_resists():
    """The mean flow is f H^2/(3 eta), the shear at the wall f H/eta, and the velocity of the
    surface f H^2/(2 eta)."""
    _, fluid, context = film([sphere(1, 2, 4)], 6)
    found = analysis.viscosity(context)
    assert found.ratio == pytest.approx(1, abs=1e-12) and found.viscosity._value == pytest.approx(
        ETA, rel=1e-12)
    assert found.amplitude._value == pytest.approx(0.5*36/(3*ETA), rel=1e-12)
    assert found.shearRate._value == pytest.approx(0.5*6/ETA, rel=1e-12)
    assert found.cosine._value == pytest.approx(0, abs=1e-13)
    surface = fluid.getFlowInContext(context, [(4, 5, 7)])._value
    assert surface == pytest.approx(np.array([(0.3, -0.4, 0)])*36/(2*ETA), abs=1e-13)


@pytest.mark.parametrize('place', [1/3, 2/3])
def test_a_small_shell_in_a_film(run, place):
    """Between the wall, where the shear is f H/eta, and the surface, where it is 0, the stresslet
    of a small sphere at the height s takes the part 10 pi a^3 (1 - s/H)^2/V of the mean flow. So
    f H^3/(3 Q) with the flux Q is larger than the viscosity by as much. Images change the
    stresslet by (a/s)^3, and the curvature of the flow by (a/H)^2.
    """
    sites, radius = run.shell(12)
    scale, height, f = 0.5, 12.0, 0.5
    _, fluid, context = film([(scale*sites, scale*radius, (3, 4, 1 + place*height))], height)
    found = analysis.viscosity(context)
    Q = height*np.hypot(*fluid.getMeanFlowInContext(context)._value[:2])
    assert found.viscosity._value == pytest.approx(f*height**3/(3*Q), rel=1e-12)
    a = scale*run.stressletRadius(sites, radius, 'ForceCoupling')
    due = 10*np.pi*a**3*(1 - place)**2/height**3
    assert 1 - ETA/found.viscosity._value == pytest.approx(due, rel=0.02)


def test_parts_of_a_run_in_a_channel():
    bodies = [(CROSS, 1.0, (1, 2, 5))]
    arguments = {'temperature': 300, 'platform': 'Reference', 'step': 0.005}
    whole = analysis.viscosity(
        channel(bodies, 9, (30, 40, 0), **arguments)[2], 31, 4, 3, progress=False)
    integrator, _, context = channel(bodies, 9, (30, 40, 0), **arguments)
    integrator.step(4)
    parts = [
        analysis.sampleFlowAmplitudes(context, steps, 3, progress=False)._value
        for steps in (6, 9, 15)
    ]
    assert analysis.viscosityFromAmplitudes(context, np.concatenate(parts)) == whole
    assert whole.samples == 10 and whole.ratioError > 0


@pytest.mark.parametrize('setUp', [
    lambda fluid: fluid.setWallVelocity(
        (0, 0.1, 0)), lambda fluid: fluid.setSinusoidalForceDensity(1, 0, 1, 1)
])
def test_a_fluid_that_is_driven_in_two_ways(setUp):
    context = channel([sphere(1, 2, 3)], 6, setUp=setUp)[2]
    with pytest.raises(
            ValueError, match='viscosity: context: its MobilityForce drives the fluid '
            'in more than one way; the viscosity is measured by one force density'):
        analysis.viscosity(context)


def test_a_fluid_that_only_its_wall_drives():
    context = channel([sphere(1, 2, 3)], 6, (0, 0, 0), setUp=lambda fluid: fluid.setWallVelocity(
        (0, 0.1, 0)))[2]
    with pytest.raises(
            ValueError, match='a wall drives the fluid .* setWallVelocity.. with zeros, '
            'and setBodyForceDensity'):
        analysis.viscosity(context)


# ---- What is refused -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    'arguments, error, problem',
    [({
        'steps': -1
    }, ValueError, 'viscosity: steps: got -1; the number of steps must be at least 0'),
     ({
         'equilibration': -5
     }, ValueError, 'viscosity: equilibration: got -5; the number of steps must be at least 0'),
     ({
         'steps': 100,
         'interval': 0
     }, ValueError, 'viscosity: interval: got 0; it must be 1 or more'),
     ({
         'steps': 10.0
     }, TypeError, 'viscosity: steps: got 10.0; it must be an integer'),
     ({
         'steps': 7,
         'interval': 5
     }, ValueError,
      'viscosity: steps, interval: got 7 and 5, so 1 samples; a mean over time needs at least 2'),])
def test_numbers_that_are_none(arguments, error, problem):
    _, _, context = driven([sphere(1, 2, 3)], (9, 9, 9))
    with pytest.raises(error, match=re.escape(problem)):
        analysis.viscosity(context, **arguments)


@pytest.mark.parametrize('arguments', [{}, {'steps': 9}, {'steps': 39, 'interval': 4}])
def test_too_few_samples_of_noise(arguments):
    integrator, _, context = driven([sphere(1, 2, 3)], (9, 9, 9), temperature=300)
    with pytest.raises(
            ValueError,
            match='a standard error needs at least 10 where there is noise: give more steps'):
        analysis.viscosity(context, **arguments)
    assert integrator.getStepStatistics()['steps'] == 0


def test_contexts_without_a_driven_flow():
    with pytest.raises(TypeError,
                       match='viscosity: context: got NoneType; it must be an openmm.Context'):
        analysis.viscosity(None)
    _, _, context = driven([sphere(1, 2, 3)], (9, 9, 9), f0=0)
    with pytest.raises(
            ValueError, match=re.escape(
                'viscosity: context: its System has no MobilityForce with a sinusoidal force '
                'density other than 0; the viscosity is '
                'measured by the flow that one drives: call setSinusoidalForceDensity()')):
        analysis.viscosity(context)
    system = openmm.System()
    system.addParticle(1)
    plain = openmm.Context(system, CustomRigidHIIntegrator(300, 0.001),
                           openmm.Platform.getPlatformByName('Reference'))
    with pytest.raises(ValueError,
                       match='sampleFlowAmplitudes: context: its System has no MobilityForce'):
        analysis.sampleFlowAmplitudes(plain, 10)
    other = openmm.Context(system, openmm.VerletIntegrator(0.001),
                           openmm.Platform.getPlatformByName('Reference'))
    with pytest.raises(TypeError):
        analysis.viscosity(other)


def test_schemes_whose_mean_flow_lacks_the_brownian_stress():
    for scheme, problem in (
        ('EulerMaruyama',
         'its scheme is EulerMaruyama at a temperature above 0, with bodies that have a stochastic '
         'drift, which it omits; its mean flow then lacks Brownian stress: use DriftCorrectorFD'),
        ('LangevinHI',
         'its scheme is LangevinHI, whose flow is that of the friction forces, at a temperature '
         'above 0; the mean must have the Brownian stress: use a scheme without momenta')):
        integrator, _, context = driven([(CROSS, 1.0, (1, 2, 3))], (9, 9, 9), temperature=300,
                                        scheme=scheme, step=1e-4)
        for call in (lambda: analysis.viscosity(context, 20),
                     lambda: analysis.viscosity(context, 20, 5),
                     lambda: analysis.sampleFlowAmplitudes(context, 20)):
            with pytest.raises(ValueError, match=problem):
                call()
        assert integrator.getStepStatistics()['steps'] == 0
        # Without noise both schemes are right.
        _, _, cold = driven([(CROSS, 1.0, (1, 2, 3))], (9, 9, 9), scheme=scheme, step=1e-4)
        assert analysis.viscosity(
            cold, 2, progress=False).ratio > (1.01 if scheme == 'EulerMaruyama' else 0.9)


@DO_NOT_RESIST
def test_a_flow_that_is_lost_in_noise():
    _, _, context = driven([sphere(1, 2, 3)], (9, 9, 9), 'ForceCoupling', 300, f0=1e-4)
    with pytest.raises(
            ValueError,
            match=re.escape('viscosity: the amplitude of the flow is') + '.*' + re.escape(
                'nm/ps; it must be more than 3 standard errors above 0: run longer, or drive by a '
                'larger f0')):
        analysis.viscosity(context, 20, progress=False)


def test_amplitudes_that_are_none():
    _, _, context = driven([sphere(1, 2, 3)], (9, 9, 9))
    with pytest.raises(
            ValueError, match=re.escape(
                'viscosityFromAmplitudes: amplitudes: got 9; an error needs at least 10 samples, '
                'and 1 is taken to be without noise')):
        analysis.viscosityFromAmplitudes(context, np.ones((9, 4)))
    with pytest.raises(
            ValueError, match=
            'amplitudes: number 4 is not finite; all must be: leave out what follows a run that '
            'blew up'):
        analysis.viscosityFromAmplitudes(
            context, np.where(np.arange(12)[:, None] == 4, np.nan, np.ones((12, 4))))
    with pytest.raises(ValueError, match=r'got an array of shape \(12, 3\)'):
        analysis.viscosityFromAmplitudes(context, np.ones((12, 3)))
    with pytest.raises(TypeError, match='got a quantity in'):
        analysis.viscosityFromAmplitudes(context, np.ones((12, 4))*unit.nanometer)
    with pytest.raises(
            ValueError,
            match='sampleFlowAmplitudes: steps: got 4; the number of steps must be at least 5'):
        analysis.sampleFlowAmplitudes(context, 4, 5)


@pytest.mark.scripts
def test_two_schemes_of_rods_at_a_time(tmp_path):
    """Each scheme gives the same as alone, and a longer run begins with the samples of the shorter
    one."""
    def rows(*options):
        finished = subprocess.run([
            sys.executable,
            str(VALIDATION/'accuracy'/'viscosity'/'run.py'), '--brownian', '--output',
            str(tmp_path), *options
        ], capture_output=True, text=True, timeout=600)
        assert finished.returncode == 0, finished.stdout + finished.stderr
        return {
            row['scheme']: row['ratio_less_1']
            for row in json.loads((tmp_path/'brownian.json').read_text())['rows']
        }

    def samples():
        with np.load(tmp_path/'work'/'brownian_TractionEulerMaruyama'/'state.npz') as file:
            return file['rows']

    together = rows('--steps', '60', '--jobs', '2', '--cluster', 'processes')
    short = samples()
    assert rows('--steps', '60', '--fresh', '--schemes',
                'EulerMaruyama')['EulerMaruyama'] == together['EulerMaruyama']
    rows('--steps', '80', '--schemes', 'TractionEulerMaruyama')
    assert len(samples()) == 80 and np.array_equal(samples()[:60], short)
