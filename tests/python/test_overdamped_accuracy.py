"""openmmrigidhi.accuracy, the overdamped limit: exact averages, the scenes that are compared,
results of the study, and the command line."""
import contextlib
import io
import os

import numpy as np
import openmm
import pytest
import scipy.integrate

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce
from openmmrigidhi.accuracy import cli, overdamped, statistics
from openmmrigidhi.accuracy.scenes import GAS_CONSTANT

pytestmark = pytest.mark.usefixtures('shortTimes')

KT = GAS_CONSTANT*overdamped.TEMPERATURE


def reference():
    return openmm.Platform.getPlatformByName('Reference')


@pytest.fixture(scope='module')
def small():
    """Eight boomerangs of three blobs."""
    return overdamped.boomerang(8, blobsPerArm=1)


def test_quadrature_of_the_published_boomerang():
    """For g = 1 independent quadratures give the mean height and <cos^2>, to 1e-4."""
    found = overdamped.quadrature(overdamped._body_sites(7), overdamped.WEIGHT)
    assert found['height'] == pytest.approx(10.8544, rel=1e-4)
    assert found['cos2'] == pytest.approx(0.37016, rel=1e-4)


@pytest.mark.parametrize('weight', (0.18, 1.8, 20))
def test_quadrature_of_a_sphere(weight):
    """For one blob all directions are alike, and the exact mean is a one-dimensional integral."""
    found = overdamped.quadrature([(0, 0, 0)], weight, 4)

    def weighted(value):
        def integrand(d):
            repulsion = overdamped.REPULSION/d*np.exp(-2*d)
            return value(d, repulsion)*np.exp(-weight*d - repulsion)

        return sum(
            scipy.integrate.quad(integrand, a, b, epsabs=1e-13)[0]
            for a, b in ((1e-9, 1), (1, 5), (5, 30), (30, 400)))

    norm = weighted(lambda d, u: 1)
    assert found['height'] == pytest.approx(1 + weighted(lambda d, u: d)/norm, rel=1e-6)
    assert found['repulsion'] == pytest.approx(weighted(lambda d, u: u)/norm, rel=1e-6)
    assert found['cos2'] == pytest.approx(1/3, rel=1e-12)


def test_the_start_is_in_equilibrium(small):
    """The potential energy in OpenMM is the weight and repulsion of the measured values.
    Observables are those of the particles."""
    integrator = overdamped.METHODS['TrapezoidalSlip'].makeIntegrator(small, small.stepSizes[0], 1)
    context = small.makeContext(integrator, reference(), {}, 1)
    values = overdamped.measure(integrator.getBodyPositions()._value,
                                integrator.getBodyOrientations(), small.sites)
    heights = small.positions.reshape(8, 3, 3)[:, :, 2]
    assert np.allclose(values['height'], heights[:, 1], rtol=1e-12)
    energy = context.getState(getEnergy=True).getPotentialEnergy()._value/KT
    assert energy == pytest.approx(
        (10*overdamped.WEIGHT*heights.mean(axis=1) + values['repulsion']).sum(), rel=1e-10)
    # The expected cos^2 is from the particles, with the normal of their triangle.
    triangles = small.positions.reshape(8, 3, 3)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    assert np.allclose(values['cos2'], normals[:, 2]**2/(normals**2).sum(axis=1), rtol=1e-9)
    # Bodies are independent, each in a group of its own.
    fluid = MobilityForce.cast(small.system.getForce(0))
    assert len(set(fluid.getGroups())) == 8


def test_monte_carlo_of_the_suspension_has_the_forces_of_the_scene():
    scene = overdamped.suspension(bodies=4, sweeps=3, systems=3)
    sampler = overdamped._Pen(scene.sites, 4, 10*overdamped.WEIGHT, 9.0, 3, 5)
    sampler.burnIn(30)
    integrator = overdamped.METHODS['FixmanMidpoint'].makeIntegrator(scene, scene.stepSizes[0], 1)
    context = scene.makeContext(integrator, reference(), {}, 1)
    energies = sampler.totalEnergy()
    for blobs, energy in zip(sampler.blobs, energies):
        context.setPositions(blobs.reshape(-1, 3)*overdamped.RADIUS)
        assert context.getState(getEnergy=True).getPotentialEnergy()._value/KT == pytest.approx(
            energy, rel=1e-10)
    assert set(scene.sampled) == {'height', 'cos2', 'repulsion'} and all(
        error > 0 for _, error in scene.sampled.values())


def test_monte_carlo_samples_the_quadrature():
    """Monte Carlo of one body, far inside the pen, has the mean height of the quadrature."""
    sites = overdamped._body_sites(1)
    sampler = overdamped._Pen(sites, 1, 3.0, 1e6, 400, 7)
    sampler.burnIn(100)
    heights = np.zeros(400)
    for _ in range(300):
        sampler.sweep()
        heights += overdamped.measure(sampler.R*overdamped.RADIUS, sampler.q,
                                      sites)['height'][:, 0]/300
    exact = overdamped.quadrature(sites/overdamped.RADIUS, 3.0)['height']
    error = heights.std(ddof=1)/20
    print(f'{heights.mean():.4f} +- {error:.4f}, exact {exact:.4f}')
    # The bound is 4.5 standard errors, with a probability of 7e-6 of a false alarm.
    assert abs(heights.mean() - exact) < 4.5*error < 0.1*exact


@pytest.mark.parametrize('name', overdamped.INERTIA)
def test_masses_relax_at_the_rate_they_are_named_for(small, name):
    step = small.stepSizes[1]
    integrator = overdamped.METHODS[name].makeIntegrator(small, step, 1)
    mass, moments = (x._value for x in integrator.getRigidBodyParameters(3)[1:3])
    assert integrator.getScheme() == CustomRigidHIIntegrator.LangevinHI
    N = np.linalg.inv(overdamped._bulk_mobility(small.sites))
    # The rate is that of the mean mobility, which determines diffusion.
    mean = 3/np.trace(np.linalg.inv(N)[:3, :3])
    assert mean/mass*step == pytest.approx(overdamped.INERTIA[name], rel=1e-10)
    assert np.allclose(1/np.diag(np.linalg.inv(N))[3:]/moments*step, overdamped.INERTIA[name],
                       rtol=1e-10)


def test_what_the_study_finds():
    """The study detects the drift that EulerMaruyama omits, and leaves this scheme out of the
    reference of the motion.
    """
    scene = overdamped.boomerang(16, blobsPerArm=3)
    study = overdamped.OverdampedStudy(
        scene, ['EulerMaruyama', 'RandomFiniteDifference', 'LangevinHI(0.3)'], {
            'EulerMaruyama': [0.1],
            'RandomFiniteDifference': [0.05, 0.1],
            'LangevinHI(0.3)': [0.1]
        })
    result = study.run(length=160*scene.timeUnit, equilibration=10*scene.timeUnit, rounds=5)
    repulsion = {(row['method'], round(row['value']/scene.timeUnit, 3)): row
                 for row in result.select('repulsion')}
    wrong, right = repulsion['EulerMaruyama', 0.1], repulsion['LangevinHI(0.3)', 0.1]
    print({
        key:
        (row['relative_error'], row['error_standard_error']/result.references['repulsion'].value)
        for key, row in repulsion.items()
    })
    assert wrong['error'] > 4*wrong['error_standard_error'] and wrong['error_standard_error'] < 0.03
    assert abs(right['error']) < 4.5*right['error_standard_error']
    assert result.references['repulsion'].kind == result.references['height'].kind == 'exact'
    motion = result.references['msd']
    assert motion.kind == 'extrapolated' and {method
                                              for method, _ in motion.points
                                              } == {'RandomFiniteDifference'}
    assert all(row['mean'] > 0 for row in result.select('msd'))
    # The times of independent replicas add up.
    row = result.select('height', 'RandomFiniteDifference')[0]
    perSecond = row['ns_per_day']*1000/86400/scene.timeUnit*16
    assert row['ns_per_day']*result.knob.speedScale == pytest.approx(perSecond, rel=1e-12)
    assert result.knob.speed(row['ns_per_day']).endswith(' τ_D/s') and result.knob.format(
        row['value']) == '0.05 τ_D'


def test_refused(small):
    with pytest.raises(
            ValueError,
            match='method: got .LangevinC., which is no road to the overdamped limit; choose among '
            'EulerMaruyama'):
        overdamped.OverdampedStudy(small, ['LangevinC'])
    with pytest.raises(
            ValueError, match=
            'observable: got .pressure., which bodies above a wall do not have; choose among height'
    ):
        overdamped.OverdampedStudy(small, observables=['pressure'])
    sheared = openmm.XmlSerializer.clone(small.system)
    MobilityForce.cast(sheared.getForce(0)).setBackgroundFlow((0, 0, 0), [(0, 0, 0.5), (0, 0, 0),
                                                                          (0, 0, 0)])
    sheared = overdamped.WallScene(sheared, small.positions, small.makeIntegrator(), small.sites,
                                   small.replicas)
    with pytest.raises(
            ValueError, match=
            r'OverdampedStudy: scene: its MobilityForce drives the fluid by a background flow of '
            r'.*0\.5.* the System has no equilibrium '
            r'in a driven flow, where alone all methods have the same averages.* '
            r'setBackgroundFlow\(\) with zeros'):
        overdamped.OverdampedStudy(sheared, ['TrapezoidalSlip'])
    with pytest.raises(ValueError, match='got 0.3; a whole number of steps must make 1'):
        overdamped.OverdampedStudy(small, ['TrapezoidalSlip'], [0.1, 0.3])


def test_command_line(tmp_path, blankPictures):
    directory = str(tmp_path/'found')
    arguments = [
        '--overdamped', '--bodies', '4', '--methods', 'TractionEulerMaruyama:0.05,0.1',
        'LangevinHI(1)', '--steps', '0.1', '--length', '6', '--equilibration', '1', '--rounds', '3',
        '--clock', 'cpu', '--quiet', '--observables', 'height', 'cos2', '--wanted-error',
        'height:50%', '--output', directory
    ]
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        assert cli.main(arguments) == 0
    assert 'τ_D/s' in out.getvalue() and 'LangevinHI(1)' in out.getvalue(
    ) and 'For an error of at most 50% of mean height' in out.getvalue()
    assert {'results.csv', 'results.json', 'report.html', 'error_height.png', 'error_cos2.png'
            } <= set(os.listdir(directory))
    page = (tmp_path/'found'/'report.html').read_text()
    assert 'τ_D/s' in page and 'ns/day' not in page
    # The same answers come from the file.
    blankPictures()
    again = io.StringIO()
    with contextlib.redirect_stdout(again):
        assert cli.main([
            '--from',
            os.path.join(directory, 'results.json'), '--output',
            str(tmp_path/'again'), '--wanted-error', 'cos2:90%'
        ]) == 0
    assert '0.05' in again.getvalue() and 'τ_D/s' in again.getvalue()


@pytest.mark.parametrize(
    'arguments, message',
    [(['--scene', 'water'
       ], "--scene: got 'water' with --overdamped; it must be one of boomerang, suspension"),
     (['--methods', 'TrapezoidalSlip:fast'], 'positive numbers in tau_D'),
     (['--wanted-error', 'pressure:1%'], 'the observable must be one of height')])
def test_wrong_arguments(arguments, message, capsys):
    assert cli.main(['--overdamped', '--quiet', *arguments]) == 2
    assert message in capsys.readouterr().err


def test_errors_come_from_replicas():
    """The interval of one standard error covers the true mean as often as it should, for any
    correlation time of the samples of a replica."""
    rng = np.random.default_rng(11)
    inside, cases = 0, 400
    for _ in range(cases):
        series = 3 + rng.normal(size=(1, 20)) + 0.1*rng.normal(size=(30, 20))  # correlated for ever
        found = statistics.replicaStatistics(series)
        inside += abs(found.mean - 3) < found.standardError
        assert found.degrees == 19 and found.isTrusted
    # By Student's t with 19 degrees the coverage is 67 %, with a standard error of 2.3 %. The test
    # allows 4.5 of these.
    print(inside/cases)
    assert abs(inside/cases - 0.67) < 0.105
    few = statistics.replicaStatistics(rng.normal(size=(400, 3)))
    assert few.degrees > 19 and few.standardError == pytest.approx(1/np.sqrt(1200), rel=0.5)
