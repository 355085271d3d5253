"""openmmrigidhi.accuracy: the price of a number on oscillators with exact correlation times.

Statistical tests have fixed seeds. Unless said otherwise, bounds are 4.5 standard deviations of the
number that is counted (passed by chance with probability 7e-6).
"""
import math

import numpy as np
import pytest
import scipy.linalg
import scipy.stats

from openmmrigidhi import accuracy
from openmmrigidhi.accuracy import measurement

pytestmark = pytest.mark.usefixtures('shortTimes')

FREQUENCY = 100.0


class Friction:
    """LangevinB with another friction, which changes correlation times but no average."""
    def __init__(self, gamma):
        self.gamma = gamma

    def __call__(self, scene, stepSize, seed):
        integrator = scene.makeIntegrator()
        integrator.setScheme(integrator.LangevinB)
        integrator.setFriction(self.gamma)
        integrator.setStepSize(stepSize)
        integrator.setRandomNumberSeed(seed)
        return integrator


def oscillator(gamma, h):
    """The map of (x, p) in one step of LangevinB, and the stationary covariance, in units of the
    thermal spread.

    Half an Ornstein-Uhlenbeck step, half a kick, a drift, half a kick, half an Ornstein-Uhlenbeck
    step.
    """
    damp = np.diag([1, math.exp(-gamma*h/2)])
    noise = np.diag([0, 1 - math.exp(-gamma*h)])
    kick, drift = np.array([[1, 0], [-FREQUENCY*h/2, 1]]), np.array([[1, FREQUENCY*h], [0, 1]])
    inner = kick @ drift @ kick
    step = damp @ inner @ damp
    return step, scipy.linalg.solve_discrete_lyapunov(
        step, damp @ inner @ noise @ inner.T @ damp.T + noise)


def exactEnergy(gamma, h, interval, power=2):
    """Mean of x^2 (1 as the step vanishes) and integrated autocorrelation time of x^2 in ps,
    sampled at an interval of whole steps.

    For a Gaussian process the autocorrelation of x^2 is the square of the autocorrelation of x.
    With the power 1 the time is that of x itself.
    """
    step, covariance = oscillator(gamma, h)
    sampled = np.linalg.matrix_power(step, round(interval/h))
    each, total, decay = sampled @ covariance, 0.5, 1.0
    while decay > 1e-12:
        total += (each[0, 0]/covariance[0, 0])**power
        each = sampled @ each
        decay = np.abs(each).max()
    return covariance[0, 0], total*interval


class Displacement:
    """x of the trapped bodies, in units of its thermal spread: its mean is 0 at every step."""
    def __call__(self, sample):
        spread = math.sqrt(accuracy.scenes.GAS_CONSTANT*300/19)/FREQUENCY
        return float(sample.rigid.getBodyPositions()._value[:, 0].mean()/spread)


def zero(_):
    return 0.0


@pytest.fixture(scope='module')
def oscillators():
    """The trap with three frictions and two step sizes. Every step is taken to cost 1 ms, so that
    exact prices are known."""
    scene = accuracy.scenes.trap(bodies=10, frequency=FREQUENCY)
    methods = [accuracy.Method(f'friction {gamma}', Friction(gamma), 2) for gamma in (8, 120, 2500)]
    result = accuracy.StepSizeStudy(
        scene, methods, [0.002, 0.004, 0.008], platform='Reference', seed=11, sampleInterval=0.008,
        observables=[
            'energy_group_0',
            accuracy.Observable('displacement', 'displacement', '', Displacement(), zero)
        ]).run(length=24, rounds=4, equilibration=0.1)
    for row in result.rows:
        row['speeds'] = [row['step_size']*measurement.SECONDS_PER_DAY]*4
        row['ns_per_day'] = row['speeds'][0]
    return result


def exactSeconds(row, tolerance):
    """The time to a wanted relative error of the energy of the trap, by formulas alone."""
    square, tau = exactEnergy(float(row['method'].split()[1]), row['step_size'],
                              row['sample_interval'])
    # For each of 10 bodies the energy has the mean 3/2 and the variance 3/2.
    noise = 2*tau*square**2*1.5/10/1.5**2
    room = tolerance**2 - (square - 1)**2
    return (row['equilibration'] + noise/room)/(row['step_size']/0.001) if room > 0 else math.inf


def test_exact_oscillators():
    """The formulas above have known limits: the means of LangevinB, weak damping and strong
    damping."""
    assert oscillator(30, 0.008)[1][0, 0] == pytest.approx(1/(1 - (0.008*FREQUENCY)**2/4))
    assert oscillator(30, 0.008)[1][1, 1] == pytest.approx(1)
    # The limits are the integrals of exp(-gamma t) (1 + cos 2 w t)/2 and of exp(-2 w^2 t/gamma).
    assert exactEnergy(2, 5e-4, 5e-4)[1] == pytest.approx(0.25, rel=1e-2)
    assert exactEnergy(2000, 1e-4, 1e-4)[1] == pytest.approx(2000/(2*FREQUENCY**2), rel=1e-2)


def test_correlation_times_are_right(oscillators):
    total = []
    for row in oscillators.select('energy_group_0'):
        square, tau = exactEnergy(float(row['method'].split()[1]), row['step_size'],
                                  row['sample_interval'])
        noise = 2*tau*1.5*square**2/10*(accuracy.scenes.GAS_CONSTANT*300)**2
        low, high = (row['noise_degrees']/scipy.stats.chi2.ppf(q, row['noise_degrees'])
                     for q in (1 - 1e-5, 1e-5))
        total.append((row['noise']/noise - 1)/math.sqrt(2/row['noise_degrees']))
        print(f'{row["method"]} {row["value"]}: tau {row["own_tau"]:.4f} ± '
              f'{row["own_tau_error"]:.4f}, exact {tau:.4f}; noise over exact '
              f'{row["noise"]/noise:.3f}, {row["noise_degrees"]:.0f} degrees of freedom')
        assert row['noise']*low < noise < row['noise']*high
        assert abs(row['own_tau'] - tau) < 4.5*tau*math.sqrt(2/row['noise_degrees'])
    assert abs(sum(total))/math.sqrt(len(total)) < 4.5


@pytest.mark.parametrize('percent', [30, 10, 3])
def test_the_cheapest_oscillator_is_recommended(oscillators, percent):
    exact = {(row['method'], row['value']): exactSeconds(row, percent/100)
             for row in oscillators.select('energy_group_0')}
    best = min(exact, key=exact.get)
    answer = oscillators.price(f'energy_group_0:{percent}%')
    outside = 0
    for each in answer.candidates:
        seconds = exact[each['method'], each['value']]
        print(
            f'{each["method"]} {each["value"]}: {each["seconds"]:.3g} s ({each["seconds_low"]:.3g} '
            f'to {each["seconds_high"]:.3g}), exact {seconds:.3g}; {each["verdict"]}')
        outside += not each['seconds_low'] <= seconds <= each['seconds_high']
        assert each['verdict'] in ('no', 'undecided') or math.isfinite(seconds)
    # Of nine intervals of 95 %, five miss with probability 3e-5.
    assert outside < 5
    # With the middle friction correlations decay fastest. The cheapest step is the largest with a
    # bias that is small enough.
    print(best)
    assert best[0] == 'friction 120'
    assert (answer.setting['method'], answer.setting['value']) == best
    assert all(each['verdict'] == 'dearer' for each in answer.candidates
               if math.isfinite(exact[each['method'], each['value']])
               and exact[each['method'], each['value']] > 5*exact[best] and each['bias'] == 'yes')


def test_prices_of_a_displacement(oscillators):
    """The displacement of a weakly damped oscillator is better known than independent samples would
    make it, since its periods cancel. Sokal's window ends within the first period, and prices from
    it alone would be 13 to 20 times too large at the weakest friction."""
    exact, limits = {}, {}
    for row in oscillators.select('displacement'):
        square, tau = exactEnergy(float(row['method'].split()[1]), row['step_size'],
                                  row['sample_interval'], power=1)
        noise = 2*tau*square/10
        key = row['method'], row['value']
        exact[key] = (row['equilibration'] + noise/0.01**2)/(row['step_size']/0.001)
        # An undetected remainder of an oscillation may leave a noise up to twice too large.
        degrees = row['noise_degrees']
        limits[key] = scipy.stats.chi2.ppf([1e-5, 1 - 1e-5], degrees)/degrees*[1, 2]
        print(f'{key}: noise over exact {row["noise"]/noise:.2f}, {degrees:.0f} degrees of freedom')
        assert limits[key][0] < row['noise']/noise < limits[key][1]
    answer = oscillators.price('displacement:0.01')
    best = min(exact, key=exact.get)
    assert best == ('friction 8', 0.008)
    assert (answer.setting['method'], answer.setting['value']) == best
    for each in answer.candidates:
        if each['method'] != 'friction 8':
            assert each['verdict'] in ('dearer', 'undecided', 'no'), each
