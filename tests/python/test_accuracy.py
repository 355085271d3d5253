"""openmmrigidhi.accuracy: its statistics on synthetic numbers, its advice, and known orders on a
scene with exact averages.

Statistical tests have fixed seeds and print z; the limit of 4.5 is passed by chance with
probability 7e-6 per comparison.
"""
import csv
import html.parser
import io
import json
import math
import os
import re
import subprocess
import sys
import tempfile
import unittest
import unittest.mock

import numpy as np
import openmm

import openmmrigidhi
from openmmrigidhi import accuracy
from openmmrigidhi.accuracy import cli, measurement, statistics
from openmmrigidhi.accuracy.result import Reference, StudyResult
from openmmrigidhi.accuracy.study import STEP_SIZE

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


class TestStatistics(unittest.TestCase):
    def testAutocorrelationTime(self):
        rng = np.random.default_rng(1)
        for rho in (0.0, 0.5, 0.9):
            tau = statistics.autocorrelationTime(autoregressive(200000, rho, rng))
            expected = 0.5 + rho/(1 - rho)
            # The relative error is sqrt(2 (2W+1)/n) < 0.04 for the longest window of 48.
            print(f'rho {rho}: tau {tau:.3f}, expected {expected:.3f}')
            self.assertAlmostEqual(tau/expected, 1, delta=0.1)

    def testStandardErrorCoversTheTruth(self):
        # There are 400 series of 200 tau. For a right error the mean of z^2 is 1, or (n-1)/(n-3) =
        # 1.25 for Student's t with about 10 blocks.
        rng = np.random.default_rng(2)
        z = []
        for _ in range(400):
            summary = statistics.seriesStatistics(autoregressive(2000, 0.818, rng))
            z.append(summary.mean/summary.standardError)
        meanSquare = np.mean(np.square(z))
        print(f'mean z^2 {meanSquare:.3f}, blocks {summary.degrees + 1}')
        self.assertGreater(meanSquare, 0.8)
        self.assertLess(meanSquare, 1.7)

    def testConstantSeries(self):
        summary = statistics.seriesStatistics(np.full(50, 3.0))
        self.assertEqual(summary.mean, 3.0)
        self.assertEqual(summary.standardError, 0.0)

    def testTooShortASeriesIsRefused(self):
        with self.assertRaisesRegex(ValueError, 'samples; at least 2 are needed'):
            statistics.seriesStatistics([1.0])

    def testExtrapolationIsExactOnExactData(self):
        points = [
            statistics.Point(method, h, 5.0 + E*h**order + F*h**(2*order), 0.01, order)
            for method, order, E, F in (('a', 2, 0.3, 0.02), ('b', 2, -0.1, 0.0),
                                        ('g', 1, 1.0, 0.1)) for h in (1, 2, 3, 4, 5)
        ]
        fit = statistics.extrapolate(points)
        self.assertAlmostEqual(fit.value, 5.0, places=9)
        self.assertAlmostEqual(fit.weights.sum(), 1.0, places=9)
        self.assertAlmostEqual(fit.coefficients['a'][0], 0.3, places=9)
        self.assertAlmostEqual(fit.coefficients['g'][1], 0.1, places=9)
        self.assertTrue(all(fit.used))

    def testExtrapolationErrorIsRight(self):
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
        self.assertLess(abs(np.mean(z)), Z_LIMIT/math.sqrt(500))
        self.assertLess(np.std(z), 1.15)
        self.assertGreater(np.std(z), 0.8)

    def testExtrapolationLeavesOutWhatDoesNotFit(self):
        points = [
            statistics.Point('a', h, 1.0 + 0.01*h**2 + (5.0 if h == 8 else 0), 0.01, 2)
            for h in range(1, 9)
        ]
        fit = statistics.extrapolate(points)
        self.assertFalse(fit.used[-1])
        self.assertAlmostEqual(fit.value, 1.0, delta=0.02)

    def testExtrapolationKnowsWhatItsModelLeavesOut(self):
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
                self.assertLess(fit.modelError, fit.standardError)
                if untested:
                    self.assertEqual(fit.note, statistics.UNTESTED)
            print(f'steps {steps}: held {held} of {cases}')
            self.assertGreater(held, 0.95*cases - 4.5*math.sqrt(0.95*0.05*cases))

    def testExtrapolationNeedsTwoSteps(self):
        self.assertIsNone(
            statistics.extrapolate(
                [statistics.Point('a', 1.0, 1.0, 0.1, 2),
                 statistics.Point('b', 2.0, 1.0, 0.1, 2)]))


class TestAdvice(unittest.TestCase):
    errors = {
        'LangevinC': {h: 0.01*h**2
                      for h in (2, 4, 6, 8)},
        'LangevinMiddle': {h: 0.03*h**2
                           for h in (2, 4, 6, 8)}
    }

    def testCheapest(self):
        answer = syntheticResult(self.errors, 0.001).recommend('potential_energy:0.5%')
        self.assertEqual(answer.verdict, 'recommended')
        # 0.01*36 = 0.36 <= 0.5 < 0.64
        self.assertEqual((answer.setting['method'], answer.setting['value']), ('LangevinC', 0.006))
        self.assertIn('LangevinC at 6 fs', answer.text)
        self.assertIn('LangevinMiddle at 4 fs', answer.text)
        self.assertIsNone(answer.factor)

    def testAbsoluteWish(self):
        answer = syntheticResult(self.errors, 0.001).recommend('potential_energy:0.2')
        self.assertEqual(answer.setting['value'], 0.004)

    def testNoneOfThese(self):
        answer = syntheticResult(self.errors, 0.001).recommend('potential_energy:0.01%')
        self.assertEqual(answer.verdict, 'none of these')
        self.assertIsNone(answer.setting)
        self.assertIn('none of these', answer.text)

    def testCannotTell(self):
        answer = syntheticResult(self.errors, 0.3).recommend('potential_energy:0.5%')
        self.assertEqual(answer.verdict, 'cannot tell')
        self.assertIsNone(answer.setting)
        self.assertRegex(answer.text, r'cannot tell.*run longer: about [0-9.]+ times')
        # The setting that is most easily decided in favour is LangevinC at 2 fs. Its error is 0.04,
        # 0.46 from the limit, and 1.645*0.3 = 0.49.
        self.assertAlmostEqual(answer.factor, (1.6449*0.3/0.46)**2, places=3)

    def testFasterCandidateIsMentioned(self):
        errors = {'LangevinC': {2: 0.0, 4: 0.48}}
        answer = syntheticResult(errors, 0.05).recommend('potential_energy:0.5%')
        self.assertEqual(answer.setting['value'], 0.002)
        self.assertIn('may or may not meet it: LangevinC at 4 fs; run longer: about 17 times',
                      answer.text)

    def testAtTheLimitNoLengthHelps(self):
        answer = syntheticResult({'LangevinC': {2: 0.5}}, 0.05).recommend('potential_energy:0.5%')
        self.assertEqual(answer.verdict, 'cannot tell')
        self.assertIn('hardly decide', answer.text)

    def testUnstableSettingsAreNeverRecommended(self):
        result = syntheticResult(self.errors, 0.001, unstable=[('LangevinC', 8), ('LangevinC', 6)])
        self.assertEqual(result.recommend('potential_energy:0.5%').setting['value'], 0.004)
        everything = [(method, fs) for method, points in self.errors.items() for fs in points]
        answer = syntheticResult(self.errors, 0.001,
                                 unstable=everything).recommend('potential_energy:1')
        self.assertEqual(answer.verdict, 'none of these')
        self.assertIn('No setting was stable', answer.text)

    def testAtExactlyTheWantedError(self):
        comparison = syntheticResult(self.errors, 0.0005).compareAt('potential_energy:0.3%')
        self.assertAlmostEqual(comparison['LangevinC']['step']*1000, math.sqrt(30), delta=0.03)
        self.assertAlmostEqual(comparison['LangevinMiddle']['step']*1000, math.sqrt(10), delta=0.03)
        expected = math.sqrt(3)*10/8
        self.assertAlmostEqual(comparison['LangevinC']['ratio'], expected, delta=0.03)
        self.assertLess(comparison['LangevinC']['ratio_low'], expected)
        self.assertGreater(comparison['LangevinC']['ratio_high'], expected)

    def testBelowTheWishUpToTheLargestStep(self):
        comparison = syntheticResult(self.errors, 0.001).compareAt('potential_energy:10%')
        self.assertTrue(comparison['LangevinC']['capped'])
        self.assertEqual(comparison['LangevinC']['step'], 0.008)

    def exactly(self, wish, errors, sigma, **options):
        lines = syntheticResult(errors, sigma, **options).report([wish], 'LangevinC').paragraphs()
        line, = (line for line in lines if line.startswith('At exactly'))
        return line

    def testStepsBetweenAndBeyondTheMeasuredOnesAreToldApart(self):
        line = self.exactly('potential_energy:0.3%', self.errors, 0.0005)
        self.assertRegex(line, r'LangevinC: reaches .* 5\.48 fs \(.*\), between the measured steps')
        # An accident of noise: the fit is above the error at the smallest step.
        line = self.exactly('potential_energy:0.3%', {'LangevinC': {2: 0.29, 4: 2.0}}, 0.1)
        self.assertRegex(line,
                         r'at a step of 1\.\d+ fs \(.*\), beyond the measured steps, by the fit')
        self.assertNotIn('between', line)

    def testErrorsThatNeverMeetTheWishGiveNoStep(self):
        """A scheme with a wrong distribution has no limit 0, and is no baseline either."""
        errors = {'LangevinC': {2: 3.0, 4: 3.1, 8: 3.0}, 'LangevinB': {2: 0.1, 4: 0.4, 8: 1.6}}
        line = self.exactly('potential_energy:1%', errors, 0.01)
        self.assertIn(
            'LangevinC: its errors as measured are above the wanted one at all measured steps, so '
            'that no step is known', line)
        self.assertRegex(line, r'LangevinB: reaches the wanted error at a step of 6\.')
        self.assertNotIn('times the', line)
        result = syntheticResult(errors, 0.01)
        self.assertIsNone(result.compareAt('potential_energy:1%')['LangevinC']['step'])
        with tempfile.TemporaryDirectory() as directory:
            result.write(directory, ['potential_energy:1%'], 'LangevinC')
            with open(os.path.join(directory, 'report.html'), encoding='utf-8') as file:
                self.assertIn('not known', file.read())

    def testTheLargestStepIsCalledWhatItIs(self):
        errors = {'LangevinC': {2: 0.01, 4: 0.04, 8: 0.16}}
        wish = 'potential_energy:1%'
        self.assertIn('still below the wanted one at its largest measured step, 8 fs: at least',
                      self.exactly(wish, errors, 0.01))
        self.assertIn('still below the wanted one at its largest stable step, 4 fs: at least',
                      self.exactly(wish, errors, 0.01, unstable=[('LangevinC', 8)]))
        # The answer above says that the statistics do not suffice.
        line = self.exactly(wish, errors, 2.0)
        self.assertIn(
            'the statistics do not suffice to tell whether its error is below the wanted one at '
            'its largest measured step, 8 fs; if it is, at least', line)
        self.assertNotIn('still below', line)

    def testAnErrorIsJudgedWithTheReferencesError(self):
        result = syntheticResult(self.errors, 0.1)
        result.references['potential_energy'].standardError = 0.2
        for row in result.rows:
            result._compare(row)
        self.assertAlmostEqual(result.rows[0]['error_standard_error'], math.hypot(0.1, 0.2))

    def testWrongWishesAreRefused(self):
        result = syntheticResult(self.errors, 0.1)
        for wish, message in (('nothing:1%', 'the observable must be one of'),
                              ('potential_energy:x', 'the error must be a positive number'),
                              ('potential_energy:-1', 'positive number'), ('potential_energy:0%',
                                                                           'positive number')):
            with self.assertRaisesRegex(ValueError, message):
                result.recommend(wish)


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


class TestFiles(unittest.TestCase):
    def testFilesOfAResult(self):
        result = syntheticResult(TestAdvice.errors, 0.01, unstable=[('LangevinMiddle', 8)])
        with tempfile.TemporaryDirectory() as directory:
            paths = result.write(directory, ['potential_energy:0.5%'])
            self.assertEqual(
                {os.path.basename(path)
                 for path in paths},
                {'results.csv', 'results.json', 'report.html', 'error_potential_energy.png'})
            with open(os.path.join(directory, 'results.csv'), newline='') as file:
                rows = list(csv.DictReader(file))
            self.assertEqual(len(rows), 8)
            self.assertEqual(rows[-1]['status'], 'unstable')
            self.assertEqual(rows[-1]['mean'], '')
            self.assertAlmostEqual(float(rows[0]['error']), 0.04)
            with open(os.path.join(directory, 'error_potential_energy.png'), 'rb') as file:
                self.assertEqual(file.read(8), b'\x89PNG\r\n\x1a\n')
            with open(os.path.join(directory, 'report.html')) as file:
                text = file.read()
            page = _Resources()
            page.feed(text)
            self.assertEqual(len(page.found), 1)
            for tag, name, value in page.found:
                self.assertEqual((tag, name), ('img', 'src'))
                self.assertTrue(value.startswith('data:image/png;base64,'))
            self.assertNotIn('http', text.split('base64,')[0] + text.rsplit('">', 1)[1])
            self.assertIn('LangevinC at 6 fs', text)
            self.assertIn(
                'Which setting is the cheapest with an error of at most 0.5% of potential energy',
                text)
            # Each entry of the contents leads to its section, in the order of a reader's questions.
            sections = re.findall('<h2 id="([^"]*)">', text)
            self.assertEqual(re.findall('<a href="#([^"]*)">', text)[:len(sections)], sections)
            self.assertEqual(sections[:4],
                             ['what-was-asked', 'answer', 'how-sure-it-is', 'what-to-do'])
            self.assertIn('LangevinMiddle was unstable at 8 fs', text)

            # Results that were written are the same when they are read again.
            again = StudyResult.fromJson(os.path.join(directory, 'results.json'))
            self.assertEqual(
                again.recommend('potential_energy:0.5%').text,
                result.recommend('potential_energy:0.5%').text)
            with open(os.path.join(directory, 'results.json')) as file:
                data = json.load(file)
            self.assertEqual(data['recommendations'][0]['verdict'], 'recommended')
            self.assertGreater(
                data['at_wanted_error']['potential_energy:0.5%']['LangevinC']['ratio'], 1)

    def testAForeignJsonIsRefused(self):
        with tempfile.TemporaryDirectory() as directory:
            path = os.path.join(directory, 'x.json')
            with open(path, 'w') as file:
                file.write('{}')
            with self.assertRaisesRegex(ValueError, 'no result of openmmrigidhi.accuracy'):
                StudyResult.fromJson(path)


class TestScenes(unittest.TestCase):
    def testScenesFromFilesAndFunctions(self):
        scene = accuracy.scenes.trap(bodies=5)
        integrator = scene.makeIntegrator()
        context = scene.makeContext(integrator, openmm.Platform.getPlatformByName('Reference'), {},
                                    1)
        with tempfile.TemporaryDirectory() as directory:
            paths = [
                os.path.join(directory, name + '.xml') for name in ('system', 'state', 'integrator')
            ]
            state = context.getState(getPositions=True, getVelocities=True)
            for path, thing in zip(paths, (scene.system, state, integrator)):
                with open(path, 'w') as file:
                    file.write(openmm.XmlSerializer.serialize(thing))
            again = accuracy.scenes.fromFiles(*paths)
        self.assertEqual(again.bodies, scene.bodies)
        np.testing.assert_allclose(again.positions, state.getPositions(asNumpy=True)._value)
        np.testing.assert_allclose(again.velocities, state.getVelocities(asNumpy=True)._value)
        self.assertEqual(len(accuracy.scenes.fromFunction(f'{__name__}:sceneFunction').bodies), 3)

    def testForeignIntegratorsAndEmptyOnesAreRefused(self):
        scene = accuracy.scenes.trap(bodies=2)
        with self.assertRaisesRegex(TypeError, 'which says what the bodies are'):
            accuracy.Scene(scene.system, scene.positions, openmm.VerletIntegrator(0.001))
        with self.assertRaisesRegex(ValueError, 'Scene: integrator: it has no bodies'):
            accuracy.Scene(scene.system, scene.positions,
                           openmmrigidhi.CustomRigidHIIntegrator(300, 0.001))
        with self.assertRaisesRegex(ValueError, 'Scene: state: got positions of shape'):
            accuracy.Scene(scene.system, scene.positions[1:], scene.makeIntegrator())

    def testDrivenScenesAreRefused(self):
        scene = accuracy.scenes.spheres([(1, 1, 1)], edges=(9, 9, 9))
        accuracy.StepSizeStudy(scene, ['LangevinC'])
        system = openmm.XmlSerializer.clone(scene.system)
        openmmrigidhi.MobilityForce.cast(system.getForce(0)).setSinusoidalForceDensity(1.5, 0, 1, 1)
        driven = accuracy.Scene(system, scene.positions, scene.makeIntegrator())
        with self.assertRaisesRegex(
                ValueError,
                r'StepSizeStudy: scene: its MobilityForce drives the fluid by a sinusoidal force '
                r'density of 1.5 kJ.* no '
                r'equilibrium in a driven flow.* setSinusoidalForceDensity\(\) with zeros'):
            accuracy.StepSizeStudy(driven, ['LangevinC'])

    def testSmallWaterBoxesAreRefused(self):
        with self.assertRaisesRegex(ValueError, 'less than twice the cutoff'):
            accuracy.scenes.water(100)

    def testWrongNamesAreRefused(self):
        for call, message in (
            (lambda: accuracy.methods.byName('Verlet'),
             'must be a Method or the name of one of these: LangevinA'),
            (lambda: accuracy.observables.byName('entropy'),
             'must be one of potential_energy'), (lambda: accuracy.scenes.fromFunction('nowhere'),
                                                  'it must have the form module:function'),
            (lambda: accuracy.scenes.fromFunction('nowhere:at_all'), 'cannot be imported'),
            (lambda: accuracy.StepSizeStudy(accuracy.scenes.trap(2), stepSizes=[-1]),
             'a step must be positive, in ps'),
            (lambda: accuracy.StepSizeStudy(accuracy.scenes.trap(2), clock='moon'),
             'it must be wall or cpu'),
            (lambda: accuracy.StepSizeStudy(accuracy.scenes.trap(2), observables=['pressure']*2),
             'there must be at least one, and none twice')):
            with self.assertRaisesRegex(ValueError, message):
                call()

    def testBodiesWithoutConstraintsExcludeLangevinMiddle(self):
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
        self.assertEqual(result.methods(), ['LangevinC'])
        self.assertIn('constraints do not hold body 0', result.refusals['LangevinMiddle'])

    def testParticlesAndBodiesGiveTheSameKineticEnergies(self):
        scene = accuracy.scenes.trap(bodies=20)
        integrator = scene.makeIntegrator()
        context = scene.makeContext(integrator, openmm.Platform.getPlatformByName('Reference'), {},
                                    1)
        integrator.step(10)
        state = context.getState(getPositions=True, getVelocities=True)
        mine = scene.bodyTable().kineticEnergies(
            state.getPositions(asNumpy=True)._value,
            state.getVelocities(asNumpy=True)._value)
        np.testing.assert_allclose(mine[0],
                                   integrator.computeTranslationalKineticEnergy()._value,
                                   rtol=1e-10)
        np.testing.assert_allclose(mine[1:],
                                   integrator.computeRotationalKineticEnergies()._value, rtol=1e-8)
        degrees = integrator.getDegreesOfFreedom()
        for name, value in scene.bodyTable().degrees.items():
            self.assertEqual(value, degrees[name], name)

    def testPressureOfAnIdealGas(self):
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
        expected = 2*integrator.computeTranslationalKineticEnergy()._value/(
            3*64)*1e30/6.02214076e23/1e6
        self.assertAlmostEqual(value/expected, 1, places=6)
        with self.assertRaisesRegex(
                ValueError, 'the System is not periodic; it has no volume: leave this observable'):
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


class TestKnownOrders(unittest.TestCase):
    """In a harmonic trap with w = 100/ps, LangevinC has the exact <x^2> and the temperature T (1 -
    h^2 w^2/4). LangevinB has the exact temperature T and <x^2> divided by 1 - h^2 w^2/4. The
    rotational temperature of each axis stays at T."""
    @classmethod
    def setUpClass(cls):
        cls.scene = accuracy.scenes.trap(bodies=150, gamma=20, Gamma=40)
        cls.study = accuracy.StepSizeStudy(
            cls.scene, ['LangevinB', 'LangevinC'], [0.004, 0.008, 0.012, 0.03],
            platform='Reference', seed=7, observables=[
                'energy_group_0', 'energy_group_1', 'translational_temperature',
                'rotational_temperature_1', firstCoordinate
            ])
        cls.result = cls.study.run(length=8, rounds=4)

    def compare(self, method, observable, law):
        for row in self.result.select(observable, method):
            expected = law(row['value'])*self.result.references[observable].value
            z = (row['mean'] - expected)/row['standard_error']
            print(f'{method} {observable} h = {row["value"]}: {row["mean"]:.4f} expected '
                  f'{expected:.4f} z = {z:.2f}, '
                  f'{row["degrees"] + 1} blocks')
            self.assertLess(abs(z), statistics.quantile(1 - 7e-6, row['degrees']))

    def testLangevinC(self):
        self.compare('LangevinC', 'energy_group_0', lambda h: 1)
        self.compare('LangevinC', 'translational_temperature', lambda h: 1 - (100*h)**2/4)

    def testLangevinB(self):
        self.compare('LangevinB', 'energy_group_0', lambda h: 1/(1 - (100*h)**2/4))
        self.compare('LangevinB', 'translational_temperature', lambda h: 1)

    def testOrderIsFound(self):
        # By |error| = h^2 w^2/4 T the step for 9 % is 6 fs.
        entry = self.result.compareAt('translational_temperature:9%',
                                      baseline='LangevinC')['LangevinC']
        print(f'step for 9 %: {entry["step"]*1000:.3f} fs ({entry["step_low"]*1000:.3f} to '
              f'{entry["step_high"]*1000:.3f})')
        self.assertAlmostEqual(entry['step']*1000, 6, delta=0.5)

    def testBlowUpIsReported(self):
        # The method is unstable because w h = 3 > 2.
        for method in ('LangevinB', 'LangevinC'):
            row = next(row for row in self.result.rows
                       if row['method'] == method and row['value'] == 0.03)
            self.assertEqual(row['status'], 'unstable')
            self.assertIn('the potential energy reached', row['message'])

    def testAdvice(self):
        answer = self.result.recommend(['energy_group_0:25%', 'translational_temperature:6%'])
        # The fastest of the settings that qualify depends on the other load of the machine.
        verdicts = {(c['method'], c['value']): c['verdict'] for c in answer.candidates}
        self.assertEqual(answer.verdict, 'recommended')
        self.assertEqual(verdicts['LangevinB', 0.008],
                         'yes')  # 19 % of the energy, 0 of the temperature
        self.assertEqual(verdicts['LangevinB', 0.012], 'no')  # 56 % of the energy
        self.assertEqual(verdicts['LangevinC', 0.008], 'no')  # 16 % of the temperature
        self.assertEqual(verdicts['LangevinC', 0.004], 'yes')  # 4 % of the temperature
        self.assertNotIn(('LangevinB', 0.03), verdicts)

    def testUsersObservable(self):
        row = self.result.select('firstCoordinate')[0]
        self.assertLess(abs(row['error']/row['error_standard_error']), Z_LIMIT + 1)

    def testSameSeedSameNumbers(self):
        short = [
            accuracy.StepSizeStudy(accuracy.scenes.trap(bodies=5), ['LangevinC', 'LangevinB'],
                                   [0.004], platform='Reference', observables=['potential_energy'],
                                   seed=seed).run(length=2, rounds=2) for seed in (3, 3, 4)
        ]
        means = [[row['mean'] for row in result.rows] for result in short]
        self.assertEqual(means[0], means[1])
        self.assertNotEqual(means[0], means[2])

    def testABudgetIsSpent(self):
        study = accuracy.StepSizeStudy(accuracy.scenes.trap(bodies=5), ['LangevinC'],
                                       [0.002, 0.008], platform='Reference',
                                       observables=['potential_energy'])
        calls = []
        result = study.run(budget=3, rounds=4, progress=lambda done, total, text: calls.append(
            (done, text)))
        self.assertGreaterEqual(result.provenance['rounds'], 3)
        small, large = result.rows
        self.assertGreater(min(small['length'], large['length']), 0)
        self.assertEqual(len(small['speeds']), result.provenance['rounds'])
        self.assertEqual(calls, sorted(calls, key=lambda call: call[0]))

    def testAThrowingObservableEndsTheRunOnly(self):
        def broken(context):
            raise ValueError('broken on purpose')

        result = accuracy.StepSizeStudy(accuracy.scenes.trap(bodies=2), ['LangevinC'], [0.004],
                                        platform='Reference', observables=[broken]).run(length=2)
        self.assertEqual(result.rows[0]['status'], measurement.UNSTABLE)
        self.assertIn('broken on purpose', result.rows[0]['message'])

    def testAnInfiniteObservableEndsTheRun(self):
        def infinite(context):
            return math.inf

        result = accuracy.StepSizeStudy(accuracy.scenes.trap(bodies=2), ['LangevinC'], [0.004],
                                        platform='Reference', observables=[infinite]).run(length=2)
        self.assertIn('infinite has become infinite', result.rows[0]['message'])

    def testGradientThermostatHasNoTemperature(self):
        result = accuracy.StepSizeStudy(accuracy.scenes.trap(bodies=5), ['GradientThermostat'],
                                        [0.001], platform='Reference',
                                        observables=['translational_temperature']).run(length=2)
        self.assertEqual(result.rows[0]['note'], 'n/a')
        self.assertEqual(result.recommend('translational_temperature:1%').verdict, 'cannot tell')


class TestCommandLine(unittest.TestCase):
    def run_(self, *arguments):
        return subprocess.run([sys.executable, '-m', 'openmmrigidhi.accuracy', *arguments],
                              capture_output=True, text=True, env=dict(
                                  os.environ, PYTHONPATH=os.path.dirname(
                                      os.path.dirname(openmmrigidhi.__file__))))

    def testShortRun(self):
        with tempfile.TemporaryDirectory() as directory:
            done = self.run_('--scene', 'trap', '--bodies', '10', '--platform', 'Reference',
                             '--length', '3', '--rounds', '3', '--methods', 'LangevinC',
                             'LangevinMiddle:4,40', '--steps', '4,8', '--observables',
                             'energy_group_0', '--wanted-error', 'energy_group_0:50%', '--output',
                             directory, '--quiet')
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertIn('For an error of at most 50% of energy of force group 0 per body',
                          done.stdout)
            self.assertIn('LangevinMiddle was unstable at 40 fs', done.stdout)
            self.assertIn('report.html', os.listdir(directory))
            with open(os.path.join(directory, 'results.csv')) as file:
                self.assertIn('the potential energy is not finite', file.read())
            # The same answers come from the written file.
            status = cli.main([
                '--from',
                os.path.join(directory, 'results.json'), '--wanted-error', 'energy_group_0:0.001',
                '--output',
                os.path.join(directory, 'again')
            ])
            self.assertEqual(status, 0)
            self.assertIn('report.html', os.listdir(os.path.join(directory, 'again')))

    def testTwoJobs(self):
        with tempfile.TemporaryDirectory() as directory:
            done = self.run_('--scene', 'trap', '--bodies', '5', '--platform', 'Reference',
                             '--length', '2', '--jobs', '2', '--methods', 'LangevinC', '--steps',
                             '4', '--observables', 'potential_energy', '--output', directory,
                             '--quiet')
            self.assertEqual(done.returncode, 0, done.stderr)
            result = StudyResult.fromJson(os.path.join(directory, 'results.json'))
            self.assertEqual(result.rows[0]['status'], 'stable')
            self.assertGreater(result.rows[0]['ns_per_day'], 0)

    def testWrongArguments(self):
        for arguments, message in ((['--scene', 'nowhere'], ', or module:function: correct it'), ([
                '--steps', 'x'
        ], 'they must be positive numbers in fs'), (['--methods',
                                                     'Verlet'], 'the name of one of these'),
                                   (['--wanted-error', 'x:1%'], ', which is not measured; name'),
                                   (['--system', 'x.xml'], 'all three must be given'), ([
                                       '--reference', 'potential_energy=x'
                                   ], 'it must be name=value or name=value+-error')):
            with self.subTest(arguments), tempfile.TemporaryFile('w+') as file:
                standard, sys.stderr = sys.stderr, file
                try:
                    self.assertEqual(cli.main(arguments + ['--quiet']), 2)
                finally:
                    sys.stderr = standard
                file.seek(0)
                self.assertIn(message, file.read())

    def testAWrongAmountIsRefusedBeforeAnythingIsMeasured(self):
        with unittest.mock.patch.object(accuracy.StepSizeStudy, 'run',
                                        side_effect=AssertionError('it was measured')), \
                unittest.mock.patch('sys.stderr', io.StringIO()) as error:
            self.assertEqual(
                cli.main([
                    '--scene', 'trap', '--bodies', '2', '--platform', 'Reference', '--wanted-error',
                    'potential_energy:much', '--quiet'
                ]), 2)
        self.assertIn('the error must be a positive number or percentage', error.getvalue())

    def testAResultOfAnotherKindIsRefused(self):
        with tempfile.TemporaryDirectory() as directory:
            path = os.path.join(directory, 'results.json')
            syntheticResult(TestAdvice.errors, 0.01).writeJson(path)
            self.assertTrue(StudyResult.isOne(path))
            with self.assertRaisesRegex(
                    ValueError, 'no result of openmmrigidhi.accuracy that a LadderResult wrote'):
                accuracy.LadderResult.fromJson(path)


if __name__ == '__main__':
    unittest.main()
