"""openmmrigidhi.accuracy: its statistics on synthetic numbers, its advice, and known orders on a
scene with exact averages.

Statistical tests have fixed seeds and print z; the limit of 4.5 is passed by chance with
probability 7e-6 per comparison.
"""
import csv
import html.parser
import json
import math
import os
import re
import subprocess
import sys

import numpy as np
import openmm
import pytest

import openmmrigidhi
from openmmrigidhi import accuracy
from openmmrigidhi.accuracy import cli, measurement, statistics
from openmmrigidhi.accuracy.result import Reference, StudyResult
from openmmrigidhi.accuracy.study import STEP_SIZE

pytestmark = pytest.mark.usefixtures('shortTimes')

Z_LIMIT = 4.5


def autoregressive(n, rho, rng):
    """A stationary series with variance 1 and autocorrelation rho^k: tau = 1/2 + rho/(1 - rho)."""
    noise = rng.normal(size=n)*math.sqrt(1 - rho*rho)
    series = np.empty(n)
    series[0] = rng.normal()
    for k in range(1, n):
        series[k] = rho*series[k - 1] + noise[k]
    return series


def syntheticResult(errors, sigma, reference=100.0, unstable=(), observable='potential_energy'):
    """A result with given errors: {method: {step in fs: error}}, equal standard errors, 10 ns/day
    per fs (LangevinMiddle: 8)."""
    rows = []
    for method, points in errors.items():
        for fs, error in points.items():
            speed = fs*(8.0 if method == 'LangevinMiddle' else 10.0)
            stable = (method, fs) not in unstable
            rows.append({
                'method': method,
                'knob': 'step_size',
                'value': fs/1000,
                'step_size': fs/1000,
                'status': 'stable' if stable else 'unstable',
                'message': '' if stable else 'after 1 ps: exploded',
                'ns_per_day': speed if stable else None,
                'ns_per_day_low': speed,
                'ns_per_day_high': speed,
                'ns_per_cpu_day': speed,
                'speeds': [speed]*5 if stable else [],
                'length': 100.0,
                'equilibration': 5.0,
                'seed': 1,
                'observable': observable,
                'mean': reference + error if stable else None,
                'standard_error': sigma if stable else None,
                'degrees': 1000,
                'tau': 1.0,
                'samples': 1000,
                'drift': 0.0,
                'note': ''
            })
    return StudyResult(STEP_SIZE, {
        'name': 'synthetic',
        'description': 'synthetic numbers'
    }, rows, {observable: Reference(observable, reference, 0.0, 'exact')}, dict.fromkeys(errors, 2),
                       {observable: {
                           'label': 'potential energy per body',
                           'unit': 'kJ/mol'
                       }}, {}, {
                           'platform': 'CPU',
                           'threads': 1,
                           'rounds': 5,
                           'clock': 'wall'
                       })


# ---- Statistics ----------------------------------------------------------------------------------


def test_autocorrelation_time():
    rng = np.random.default_rng(1)
    for rho in (0.0, 0.5, 0.9):
        tau = statistics.autocorrelationTime(autoregressive(200000, rho, rng))
        expected = 0.5 + rho/(1 - rho)
        # The relative error is sqrt(2 (2W+1)/n) < 0.04 for the longest window of 48.
        print(f'rho {rho}: tau {tau:.3f}, expected {expected:.3f}')
        assert tau/expected == pytest.approx(1, abs=0.1)


def test_standard_error_covers_the_truth():
    # There are 400 series of 200 tau. For a right error the mean of z^2 is 1, or (n-1)/(n-3) =
    # 1.25 for Student's t with about 10 blocks.
    rng = np.random.default_rng(2)
    z = []
    for _ in range(400):
        summary = statistics.seriesStatistics(autoregressive(2000, 0.818, rng))
        z.append(summary.mean/summary.standardError)
    meanSquare = np.mean(np.square(z))
    print(f'mean z^2 {meanSquare:.3f}, blocks {summary.degrees + 1}')
    assert meanSquare > 0.8
    assert meanSquare < 1.7


def test_constant_series():
    summary = statistics.seriesStatistics(np.full(50, 3.0))
    assert summary.mean == 3.0
    assert summary.standardError == 0.0


def test_too_short_a_series_is_refused():
    with pytest.raises(ValueError, match='samples; at least 2 are needed'):
        statistics.seriesStatistics([1.0])


def test_extrapolation_is_exact_on_exact_data():
    points = [
        statistics.Point(method, h, 5.0 + E*h**order + F*h**(2*order), 0.01, order)
        for method, order, E, F in (('a', 2, 0.3, 0.02), ('b', 2, -0.1, 0.0), ('g', 1, 1.0, 0.1))
        for h in (1, 2, 3, 4, 5)
    ]
    fit = statistics.extrapolate(points)
    assert fit.value == pytest.approx(5.0, abs=0.5e-9)
    assert fit.weights.sum() == pytest.approx(1.0, abs=0.5e-9)
    assert fit.coefficients['a'][0] == pytest.approx(0.3, abs=0.5e-9)
    assert fit.coefficients['g'][1] == pytest.approx(0.1, abs=0.5e-9)
    assert all(fit.used)


def test_extrapolation_error_is_right():
    rng = np.random.default_rng(3)
    steps = np.arange(1.0, 9.0)
    z = []
    for _ in range(500):
        points = [
            statistics.Point(method, h, 2.0 + E*h**2 + 0.1*rng.normal(), 0.1, 2)
            for method, E in (('a', 0.01), ('b', -0.02)) for h in steps
        ]
        fit = statistics.extrapolate(points)
        z.append((fit.value - 2.0)/fit.standardError)
    print(f'mean z {np.mean(z):.3f}, std {np.std(z):.3f}')
    assert abs(np.mean(z)) < Z_LIMIT/math.sqrt(500)
    assert np.std(z) < 1.15
    assert np.std(z) > 0.8


def test_extrapolation_leaves_out_what_does_not_fit():
    points = [
        statistics.Point('a', h, 1.0 + 0.01*h**2 + (5.0 if h == 8 else 0), 0.01, 2)
        for h in range(1, 9)
    ]
    fit = statistics.extrapolate(points)
    assert not fit.used[-1]
    assert fit.value == pytest.approx(1.0, abs=0.02)


def test_extrapolation_knows_what_its_model_leaves_out():
    # A harmonic oscillator's bias has all powers of h^2, of which the fit has one or two. The
    # largest step is at 0.7 of the limit of stability. Of 95 % intervals 95 % should hold the
    # truth; without the error of the model it is less than half.
    rng = np.random.default_rng(4)
    for steps, untested in (((8, 14), True), ((6, 8, 10, 12), False)):
        steps = np.array(steps)/20
        bias = 1/(1 - steps**2) - 1
        held, cases = 0, 100
        for _ in range(cases):
            fit = statistics.extrapolate([
                statistics.Point('a', h, 1 + error + 0.002*rng.normal(), 0.002, 2)
                for h, error in zip(steps, bias)
            ])
            held += abs(fit.value - 1) < 1.96*fit.standardError
            assert fit.modelError < fit.standardError
            if untested:
                assert fit.note == statistics.UNTESTED
        print(f'steps {steps}: held {held} of {cases}')
        assert held > 0.95*cases - 4.5*math.sqrt(0.95*0.05*cases)


def test_extrapolation_needs_two_steps():
    assert statistics.extrapolate(
        [statistics.Point('a', 1.0, 1.0, 0.1, 2),
         statistics.Point('b', 2.0, 1.0, 0.1, 2)]) is None


# ---- Advice --------------------------------------------------------------------------------------

ERRORS = {
    'LangevinC': {h: 0.01*h**2
                  for h in (2, 4, 6, 8)},
    'LangevinMiddle': {h: 0.03*h**2
                       for h in (2, 4, 6, 8)}
}


def test_cheapest():
    answer = syntheticResult(ERRORS, 0.001).recommend('potential_energy:0.5%')
    assert answer.verdict == 'recommended'
    # 0.01*36 = 0.36 <= 0.5 < 0.64
    assert (answer.setting['method'], answer.setting['value']) == ('LangevinC', 0.006)
    assert 'LangevinC at 6 fs' in answer.text
    assert 'LangevinMiddle at 4 fs' in answer.text
    assert answer.factor is None


def exactly(wish, errors, sigma, **options):
    lines = syntheticResult(errors, sigma, **options).report([wish], 'LangevinC').paragraphs()
    line, = (line for line in lines if line.startswith('At exactly'))
    return line


def test_steps_between_and_beyond_the_measured_ones_are_told_apart():
    line = exactly('potential_energy:0.3%', ERRORS, 0.0005)
    assert re.search(r'LangevinC: reaches .* 5\.48 fs \(.*\), between the measured steps', line)
    # An accident of noise: the fit is above the error at the smallest step.
    line = exactly('potential_energy:0.3%', {'LangevinC': {2: 0.29, 4: 2.0}}, 0.1)
    assert re.search(r'at a step of 1\.\d+ fs \(.*\), beyond the measured steps, by the fit', line)
    assert 'between' not in line


def test_errors_that_never_meet_the_wish_give_no_step(tmp_path, blankPictures):
    """A scheme with a wrong distribution has no limit 0, and is no baseline either."""
    errors = {'LangevinC': {2: 3.0, 4: 3.1, 8: 3.0}, 'LangevinB': {2: 0.1, 4: 0.4, 8: 1.6}}
    line = exactly('potential_energy:1%', errors, 0.01)
    assert ('LangevinC: its errors as measured are above the wanted one at all measured steps, so '
            'that no step is known') in line
    assert re.search(r'LangevinB: reaches the wanted error at a step of 6\.', line)
    assert 'times the' not in line
    result = syntheticResult(errors, 0.01)
    assert result.compareAt('potential_energy:1%')['LangevinC']['step'] is None
    blankPictures()
    result.write(str(tmp_path), ['potential_energy:1%'], 'LangevinC')
    assert 'not known' in (tmp_path/'report.html').read_text(encoding='utf-8')


def test_the_largest_step_is_called_what_it_is():
    errors = {'LangevinC': {2: 0.01, 4: 0.04, 8: 0.16}}
    wish = 'potential_energy:1%'
    assert ('still below the wanted one at its largest measured step, 8 fs: at least'
            in exactly(wish, errors, 0.01))
    assert ('still below the wanted one at its largest stable step, 4 fs: at least'
            in exactly(wish, errors, 0.01, unstable=[('LangevinC', 8)]))
    # The answer above says that the statistics do not suffice.
    line = exactly(wish, errors, 2.0)
    assert ('the statistics do not suffice to tell whether its error is below the wanted one at '
            'its largest measured step, 8 fs; if it is, at least') in line
    assert 'still below' not in line


def test_absolute_wish():
    answer = syntheticResult(ERRORS, 0.001).recommend('potential_energy:0.2')
    assert answer.setting['value'] == 0.004


def test_none_of_these():
    answer = syntheticResult(ERRORS, 0.001).recommend('potential_energy:0.01%')
    assert answer.verdict == 'none of these'
    assert answer.setting is None
    assert 'none of these' in answer.text


def test_cannot_tell():
    answer = syntheticResult(ERRORS, 0.3).recommend('potential_energy:0.5%')
    assert answer.verdict == 'cannot tell'
    assert answer.setting is None
    assert re.search(r'cannot tell.*run longer: about [0-9.]+ times', answer.text)
    # The setting that is most easily decided in favour is LangevinC at 2 fs. Its error is 0.04,
    # 0.46 from the limit, and 1.645*0.3 = 0.49.
    assert answer.factor == pytest.approx((1.6449*0.3/0.46)**2, abs=0.5e-3)


def test_faster_candidate_is_mentioned():
    errors = {'LangevinC': {2: 0.0, 4: 0.48}}
    answer = syntheticResult(errors, 0.05).recommend('potential_energy:0.5%')
    assert answer.setting['value'] == 0.002
    assert 'may or may not meet it: LangevinC at 4 fs; run longer: about 17 times' in answer.text


def test_at_the_limit_no_length_helps():
    answer = syntheticResult({'LangevinC': {2: 0.5}}, 0.05).recommend('potential_energy:0.5%')
    assert answer.verdict == 'cannot tell'
    assert 'hardly decide' in answer.text


def test_unstable_settings_are_never_recommended():
    result = syntheticResult(ERRORS, 0.001, unstable=[('LangevinC', 8), ('LangevinC', 6)])
    assert result.recommend('potential_energy:0.5%').setting['value'] == 0.004
    everything = [(method, fs) for method, points in ERRORS.items() for fs in points]
    answer = syntheticResult(ERRORS, 0.001, unstable=everything).recommend('potential_energy:1')
    assert answer.verdict == 'none of these'
    assert 'No setting was stable' in answer.text


def test_at_exactly_the_wanted_error():
    comparison = syntheticResult(ERRORS, 0.0005).compareAt('potential_energy:0.3%')
    assert comparison['LangevinC']['step']*1000 == pytest.approx(math.sqrt(30), abs=0.03)
    assert comparison['LangevinMiddle']['step']*1000 == pytest.approx(math.sqrt(10), abs=0.03)
    expected = math.sqrt(3)*10/8
    assert comparison['LangevinC']['ratio'] == pytest.approx(expected, abs=0.03)
    assert comparison['LangevinC']['ratio_low'] < expected
    assert comparison['LangevinC']['ratio_high'] > expected


def test_below_the_wish_up_to_the_largest_step():
    comparison = syntheticResult(ERRORS, 0.001).compareAt('potential_energy:10%')
    assert comparison['LangevinC']['capped']
    assert comparison['LangevinC']['step'] == 0.008


def test_an_error_is_judged_with_the_references_error():
    result = syntheticResult(ERRORS, 0.1)
    result.references['potential_energy'].standardError = 0.2
    for row in result.rows:
        result._compare(row)
    assert result.rows[0]['error_standard_error'] == pytest.approx(math.hypot(0.1, 0.2), abs=0.5e-7)


@pytest.mark.parametrize('wish, message',
                         [('nothing:1%', 'the observable must be one of'),
                          ('potential_energy:x', 'the error must be a positive number'),
                          ('potential_energy:-1', 'positive number'),
                          ('potential_energy:0%', 'positive number')])
def test_wrong_wishes_are_refused(wish, message):
    with pytest.raises(ValueError, match=message):
        syntheticResult(ERRORS, 0.1).recommend(wish)


class _Resources(html.parser.HTMLParser):
    """Collects all that a page refers to."""
    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attributes):
        self.found += [(tag, name, value) for name, value in attributes
                       if name in ('src', 'href', 'srcset', 'data') and not value.startswith('#')]
        if tag in ('script', 'link', 'iframe'):
            self.found.append((tag, '', ''))


# ---- Files ---------------------------------------------------------------------------------------


def test_files_of_a_result(tmp_path):
    result = syntheticResult(ERRORS, 0.01, unstable=[('LangevinMiddle', 8)])
    paths = result.write(str(tmp_path), ['potential_energy:0.5%'])
    assert {os.path.basename(path)
            for path in paths
            } == {'results.csv', 'results.json', 'report.html', 'error_potential_energy.png'}
    with open(tmp_path/'results.csv', newline='') as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 8
    assert rows[-1]['status'] == 'unstable'
    assert rows[-1]['mean'] == ''
    assert float(rows[0]['error']) == pytest.approx(0.04, abs=0.5e-7)
    picture = (tmp_path/'error_potential_energy.png').read_bytes()
    assert picture.startswith(b'\x89PNG\r\n\x1a\n')
    text = (tmp_path/'report.html').read_text()
    page = _Resources()
    page.feed(text)
    assert len(page.found) == 1
    for tag, name, value in page.found:
        assert (tag, name) == ('img', 'src')
        assert value.startswith('data:image/png;base64,')
    assert 'http' not in text.split('base64,')[0] + text.rsplit('">', 1)[1]
    assert 'LangevinC at 6 fs' in text
    assert ('Which setting is the cheapest with an error of at most 0.5% of potential energy'
            in text)
    # Each entry of the contents leads to its section, in the order of a reader's questions.
    sections = re.findall('<h2 id="([^"]*)">', text)
    assert re.findall('<a href="#([^"]*)">', text)[:len(sections)] == sections
    assert sections[:4] == ['what-was-asked', 'answer', 'how-sure-it-is', 'what-to-do']
    assert 'LangevinMiddle was unstable at 8 fs' in text

    # Results that were written are the same when they are read again.
    again = StudyResult.fromJson(str(tmp_path/'results.json'))
    assert (again.recommend('potential_energy:0.5%').text == result.recommend(
        'potential_energy:0.5%').text)
    data = json.loads((tmp_path/'results.json').read_text())
    assert data['recommendations'][0]['verdict'] == 'recommended'
    assert data['at_wanted_error']['potential_energy:0.5%']['LangevinC']['ratio'] > 1


def test_a_foreign_json_is_refused(tmp_path):
    path = tmp_path/'x.json'
    path.write_text('{}')
    with pytest.raises(ValueError, match='no result of openmmrigidhi.accuracy'):
        StudyResult.fromJson(str(path))


# ---- Scenes --------------------------------------------------------------------------------------


def test_scenes_from_files_and_functions(tmp_path):
    scene = accuracy.scenes.trap(bodies=5)
    integrator = scene.makeIntegrator()
    context = scene.makeContext(integrator, openmm.Platform.getPlatformByName('Reference'), {}, 1)
    paths = [tmp_path/f'{name}.xml' for name in ('system', 'state', 'integrator')]
    state = context.getState(getPositions=True, getVelocities=True)
    for path, thing in zip(paths, (scene.system, state, integrator)):
        path.write_text(openmm.XmlSerializer.serialize(thing))
    again = accuracy.scenes.fromFiles(*map(str, paths))
    assert again.bodies == scene.bodies
    np.testing.assert_allclose(again.positions, state.getPositions(asNumpy=True)._value)
    np.testing.assert_allclose(again.velocities, state.getVelocities(asNumpy=True)._value)
    assert len(accuracy.scenes.fromFunction(f'{__name__}:sceneFunction').bodies) == 3


def test_foreign_integrators_and_empty_ones_are_refused():
    scene = accuracy.scenes.trap(bodies=2)
    with pytest.raises(TypeError, match='which says what the bodies are'):
        accuracy.Scene(scene.system, scene.positions, openmm.VerletIntegrator(0.001))
    with pytest.raises(ValueError, match='Scene: integrator: it has no bodies'):
        accuracy.Scene(scene.system, scene.positions,
                       openmmrigidhi.CustomRigidHIIntegrator(300, 0.001))
    with pytest.raises(ValueError, match='Scene: state: got positions of shape'):
        accuracy.Scene(scene.system, scene.positions[1:], scene.makeIntegrator())


def test_driven_scenes_are_refused():
    scene = accuracy.scenes.spheres([(1, 1, 1)], edges=(9, 9, 9))
    accuracy.StepSizeStudy(scene, ['LangevinC'])
    system = openmm.XmlSerializer.clone(scene.system)
    openmmrigidhi.MobilityForce.cast(system.getForce(0)).setSinusoidalForceDensity(1.5, 0, 1, 1)
    driven = accuracy.Scene(system, scene.positions, scene.makeIntegrator())
    with pytest.raises(
            ValueError,
            match=r'StepSizeStudy: scene: its MobilityForce drives the fluid by a sinusoidal force '
            r'density of 1.5 kJ.* no equilibrium in a driven flow.* '
            r'setSinusoidalForceDensity\(\) with zeros'):
        accuracy.StepSizeStudy(driven, ['LangevinC'])


def test_small_water_boxes_are_refused():
    with pytest.raises(ValueError, match='less than twice the cutoff'):
        accuracy.scenes.water(100)


@pytest.mark.parametrize(
    'call, message',
    [(lambda: accuracy.methods.byName('Verlet'),
      'must be a Method or the name of one of these: LangevinA'),
     (lambda: accuracy.observables.byName('entropy'), 'must be one of potential_energy'),
     (lambda: accuracy.scenes.fromFunction('nowhere'), 'it must have the form module:function'),
     (lambda: accuracy.scenes.fromFunction('nowhere:at_all'), 'cannot be imported'),
     (lambda: accuracy.StepSizeStudy(accuracy.scenes.trap(2), stepSizes=[-1]),
      'a step must be positive, in ps'),
     (lambda: accuracy.StepSizeStudy(accuracy.scenes.trap(2), clock='moon'),
      'it must be wall or cpu'),
     (lambda: accuracy.StepSizeStudy(accuracy.scenes.trap(2), observables=['pressure']*2),
      'at least one is needed, and none may occur twice')],
    ids=['method', 'observable', 'form', 'module', 'step', 'clock', 'twice'])
def test_wrong_names_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_bodies_without_constraints_exclude_langevin_middle():
    system = openmm.System()
    force = openmm.CustomExternalForce('x^2+y^2+z^2')
    system.addForce(force)
    for k in range(2):
        system.addParticle(10.0)
        force.addParticle(k)
    integrator = openmmrigidhi.CustomRigidHIIntegrator(300, 0.001)
    integrator.addRigidBody([0, 1])
    scene = accuracy.Scene(system, np.array([[0, 0, 0], [0.1, 0, 0]]), integrator)
    result = accuracy.StepSizeStudy(scene, stepSizes=[0.001], observables=['potential_energy'],
                                    platform='Reference').run(length=2.5, rounds=2)
    assert result.methods() == ['LangevinC']
    assert 'constraints do not hold body 0' in result.refusals['LangevinMiddle']


def test_particles_and_bodies_give_the_same_kinetic_energies():
    scene = accuracy.scenes.trap(bodies=20)
    integrator = scene.makeIntegrator()
    context = scene.makeContext(integrator, openmm.Platform.getPlatformByName('Reference'), {}, 1)
    integrator.step(10)
    state = context.getState(getPositions=True, getVelocities=True)
    mine = scene.bodyTable().kineticEnergies(
        state.getPositions(asNumpy=True)._value,
        state.getVelocities(asNumpy=True)._value)
    np.testing.assert_allclose(mine[0],
                               integrator.computeTranslationalKineticEnergy()._value, rtol=1e-10)
    np.testing.assert_allclose(mine[1:],
                               integrator.computeRotationalKineticEnergies()._value, rtol=1e-8)
    degrees = integrator.getDegreesOfFreedom()
    for name, value in scene.bodyTable().degrees.items():
        assert value == degrees[name], name


def test_pressure_of_an_ideal_gas():
    # The bodies do not interact. So the virial vanishes, and exactly P V = sum p^2/(3 m).
    scene = accuracy.scenes.trap(bodies=8)
    system = openmm.System()
    for k in range(scene.system.getNumParticles()):
        system.addParticle(scene.system.getParticleMass(k))
    for k in range(scene.system.getNumConstraints()):
        system.addConstraint(*scene.system.getConstraintParameters(k))
    system.setDefaultPeriodicBoxVectors(*(4*np.eye(3)))
    force = openmm.NonbondedForce()
    force.setNonbondedMethod(openmm.NonbondedForce.CutoffPeriodic)
    for k in range(system.getNumParticles()):
        force.addParticle(0, 1, 0)
    system.addForce(force)
    gas = accuracy.Scene(system, scene.positions, scene.makeIntegrator())
    platform = openmm.Platform.getPlatformByName('Reference')
    integrator = gas.makeIntegrator()
    context = gas.makeContext(integrator, platform, {}, 1)
    pressure = accuracy.observables.byName('pressure')
    value = pressure.measure(accuracy.observables.Sample(gas, context),
                             pressure.setup(gas, platform, {}))
    # 1 kJ/mol/nm^3 = 1e3/6.02214076e23/1e-27 Pa
    expected = 2*integrator.computeTranslationalKineticEnergy()._value/(3*64)*1e30/6.02214076e23/1e6
    assert value/expected == pytest.approx(1, abs=0.5e-6)
    with pytest.raises(ValueError,
                       match='the System is not periodic; it has no volume: leave this observable'):
        pressure.setup(scene, platform, {})


def sceneFunction():
    """The scene of testScenesFromFilesAndFunctions."""
    scene = accuracy.scenes.trap(bodies=3)
    return scene.system, None, scene.positions, scene.makeIntegrator()


def firstCoordinate(context):
    """An observable that a user might write."""
    return context.getState(getPositions=True).getPositions()[0][0]


firstCoordinate.unit = 'nm'
firstCoordinate.exact = 0.0

# ---- Known orders --------------------------------------------------------------------------------


@pytest.fixture(scope='module')
def trap():
    """The errors of LangevinB and LangevinC in a harmonic trap with w = 100/ps.

    LangevinC has the exact <x^2> and the temperature T (1 - h^2 w^2/4). LangevinB has the exact
    temperature T and <x^2> divided by 1 - h^2 w^2/4. The rotational temperature of each axis stays
    at T."""
    scene = accuracy.scenes.trap(bodies=150, gamma=20, Gamma=40)
    study = accuracy.StepSizeStudy(
        scene, ['LangevinB', 'LangevinC'], [0.004, 0.008, 0.012, 0.03], platform='Reference',
        seed=7, observables=[
            'energy_group_0', 'energy_group_1', 'translational_temperature',
            'rotational_temperature_1', firstCoordinate
        ])
    return study.run(length=8, rounds=4)


def compare(result, method, observable, law):
    for row in result.select(observable, method):
        expected = law(row['value'])*result.references[observable].value
        z = (row['mean'] - expected)/row['standard_error']
        print(f'{method} {observable} h = {row["value"]}: {row["mean"]:.4f} expected '
              f'{expected:.4f} z = {z:.2f}, {row["degrees"] + 1} blocks')
        assert abs(z) < statistics.quantile(1 - 7e-6, row['degrees'])


def test_langevin_c(trap):
    compare(trap, 'LangevinC', 'energy_group_0', lambda h: 1)
    compare(trap, 'LangevinC', 'translational_temperature', lambda h: 1 - (100*h)**2/4)


def test_langevin_b(trap):
    compare(trap, 'LangevinB', 'energy_group_0', lambda h: 1/(1 - (100*h)**2/4))
    compare(trap, 'LangevinB', 'translational_temperature', lambda h: 1)


def test_order_is_found(trap):
    # By |error| = h^2 w^2/4 T the step for 9 % is 6 fs.
    entry = trap.compareAt('translational_temperature:9%', baseline='LangevinC')['LangevinC']
    print(f'step for 9 %: {entry["step"]*1000:.3f} fs ({entry["step_low"]*1000:.3f} to '
          f'{entry["step_high"]*1000:.3f})')
    assert entry['step']*1000 == pytest.approx(6, abs=0.5)


def test_blow_up_is_reported(trap):
    # The method is unstable because w h = 3 > 2.
    for method in ('LangevinB', 'LangevinC'):
        row = next(row for row in trap.rows if row['method'] == method and row['value'] == 0.03)
        assert row['status'] == 'unstable'
        assert 'the potential energy reached' in row['message']


def test_advice(trap):
    answer = trap.recommend(['energy_group_0:25%', 'translational_temperature:6%'])
    # The fastest of the settings that qualify depends on the other load of the machine.
    verdicts = {(c['method'], c['value']): c['verdict'] for c in answer.candidates}
    assert answer.verdict == 'recommended'
    assert verdicts['LangevinB', 0.008] == 'yes'  # 19 % of the energy, 0 of the temperature
    assert verdicts['LangevinB', 0.012] == 'no'  # 56 % of the energy
    assert verdicts['LangevinC', 0.008] == 'no'  # 16 % of the temperature
    assert verdicts['LangevinC', 0.004] == 'yes'  # 4 % of the temperature
    assert ('LangevinB', 0.03) not in verdicts


def test_users_observable(trap):
    row = trap.select('firstCoordinate')[0]
    assert abs(row['error']/row['error_standard_error']) < Z_LIMIT + 1


def test_same_seed_same_numbers():
    short = [
        accuracy.StepSizeStudy(accuracy.scenes.trap(bodies=5), ['LangevinC', 'LangevinB'], [0.004],
                               platform='Reference', observables=['potential_energy'],
                               seed=seed).run(length=2, rounds=2) for seed in (3, 3, 4)
    ]
    means = [[row['mean'] for row in result.rows] for result in short]
    assert means[0] == means[1]
    assert means[0] != means[2]


def test_a_budget_is_spent():
    study = accuracy.StepSizeStudy(accuracy.scenes.trap(bodies=5), ['LangevinC'], [0.002, 0.008],
                                   platform='Reference', observables=['potential_energy'])
    calls = []
    result = study.run(budget=1.5, rounds=4, progress=lambda done, total, text: calls.append(
        (done, text)))
    assert result.provenance['rounds'] >= 3
    small, large = result.rows
    assert min(small['length'], large['length']) > 0
    assert len(small['speeds']) == result.provenance['rounds']
    assert calls == sorted(calls, key=lambda call: call[0])


def test_a_throwing_observable_ends_the_run_only():
    def broken(context):
        raise ValueError('broken on purpose')

    result = accuracy.StepSizeStudy(accuracy.scenes.trap(bodies=2), ['LangevinC'], [0.004],
                                    platform='Reference', observables=[broken]).run(length=2)
    assert result.rows[0]['status'] == measurement.UNSTABLE
    assert 'broken on purpose' in result.rows[0]['message']


def test_an_infinite_observable_ends_the_run():
    def infinite(context):
        return math.inf

    result = accuracy.StepSizeStudy(accuracy.scenes.trap(bodies=2), ['LangevinC'], [0.004],
                                    platform='Reference', observables=[infinite]).run(length=2)
    assert 'infinite has become infinite' in result.rows[0]['message']


def test_gradient_thermostat_has_no_temperature():
    result = accuracy.StepSizeStudy(accuracy.scenes.trap(bodies=5), ['GradientThermostat'], [0.001],
                                    platform='Reference',
                                    observables=['translational_temperature']).run(length=2)
    assert result.rows[0]['note'] == 'n/a'
    assert result.recommend('translational_temperature:1%').verdict == 'cannot tell'


# ---- The command line ----------------------------------------------------------------------------


def run_command(*arguments):
    return subprocess.run([sys.executable, '-m', 'openmmrigidhi.accuracy', *arguments],
                          capture_output=True, text=True, env=dict(
                              os.environ,
                              PYTHONPATH=os.path.dirname(os.path.dirname(openmmrigidhi.__file__))))


def test_short_run(tmp_path, blankPictures):
    done = run_command('--scene', 'trap', '--bodies', '10', '--platform', 'Reference', '--length',
                       '3', '--rounds', '3', '--methods', 'LangevinC', 'LangevinMiddle:4,40',
                       '--steps', '4,8', '--observables', 'energy_group_0', '--wanted-error',
                       'energy_group_0:50%', '--output', str(tmp_path), '--quiet')
    assert done.returncode == 0, done.stderr
    assert 'For an error of at most 50% of energy of force group 0 per body' in done.stdout
    assert 'LangevinMiddle was unstable at 40 fs' in done.stdout
    assert (tmp_path/'report.html').exists()
    assert 'the potential energy is not finite' in (tmp_path/'results.csv').read_text()
    # The same answers come from the written file.
    blankPictures()
    status = cli.main([
        '--from',
        str(tmp_path/'results.json'), '--wanted-error', 'energy_group_0:0.001', '--output',
        str(tmp_path/'again')
    ])
    assert status == 0
    assert (tmp_path/'again'/'report.html').exists()
    # Without --output they go beside it, and not into the folder of another study.
    (tmp_path/'report.html').unlink()
    assert cli.main(
        ['--from', str(tmp_path/'results.json'), '--wanted-error', 'energy_group_0:0.001']) == 0
    assert (tmp_path/'report.html').exists()


def test_two_jobs(tmp_path, blankPictures):
    blankPictures()
    assert cli.main([
        '--scene', 'trap', '--bodies', '5', '--platform', 'Reference', '--length', '2', '--jobs',
        '2', '--methods', 'LangevinC', '--steps', '4', '--observables', 'potential_energy',
        '--output',
        str(tmp_path), '--quiet'
    ]) == 0
    result = StudyResult.fromJson(str(tmp_path/'results.json'))
    assert result.rows[0]['status'] == 'stable'
    assert result.rows[0]['ns_per_day'] > 0


@pytest.mark.parametrize(
    'arguments, message',
    [(['--scene', 'nowhere'], 'it must be a built-in scene'),
     (['--steps', 'x'], 'they must be positive numbers in fs'),
     (['--methods', 'Verlet'], 'the name of one of these'),
     (['--wanted-error', 'x:1%'], ', which is not measured; name'),
     (['--system', 'x.xml'], 'all three must be given'),
     (['--reference', 'potential_energy=x'], 'it must be name=value or name=value+-error')],
    ids=lambda value: value[0] if isinstance(value, list) else '')
def test_wrong_arguments(arguments, message, capsys):
    assert cli.main(arguments + ['--quiet']) == 2
    assert message in capsys.readouterr().err


def test_a_wrong_amount_is_refused_before_anything_is_measured(monkeypatch, capsys):
    def run(*arguments, **named):
        raise AssertionError('it was measured')

    monkeypatch.setattr(accuracy.StepSizeStudy, 'run', run)
    assert cli.main([
        '--scene', 'trap', '--bodies', '2', '--platform', 'Reference', '--wanted-error',
        'potential_energy:much', '--quiet'
    ]) == 2
    assert 'the error must be a positive number or percentage' in capsys.readouterr().err


def test_a_result_of_another_kind_is_refused(tmp_path):
    path = str(tmp_path/'results.json')
    syntheticResult(ERRORS, 0.01).writeJson(path)
    assert StudyResult.isOne(path)
    with pytest.raises(ValueError,
                       match='no result of openmmrigidhi.accuracy that a LadderResult wrote'):
        accuracy.LadderResult.fromJson(path)
