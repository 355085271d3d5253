"""Synthetic results of studies of accuracy, for tests of prices and of advice."""
import math
import types

import numpy as np
import scipy.signal

from openmmrigidhi.accuracy import measurement
from openmmrigidhi.accuracy.result import Reference, StudyResult
from openmmrigidhi.accuracy.study import STEP_SIZE, Setting

REFERENCE = 100.0
OBSERVABLE = 'potential_energy'


def autoregressive(n, rho, rng):
    """A stationary series with variance 1 and autocorrelation rho^k: tau = 1/2 + rho/(1 - rho)."""
    noise = rng.normal(size=n)
    noise[1:] *= math.sqrt(1 - rho*rho)
    return scipy.signal.lfilter([1], [1, -rho], noise)


def resultOf(settings, observables=(OBSERVABLE,), rounds=7, clock='wall'):
    """A result whose rows are made as a study makes them.

    Parameters
    ----------
    settings : list of (method, fs, record)
        Each record has series of all observables.
    """
    methods = {name: types.SimpleNamespace(name=name) for name, _, _ in settings}
    runs = [(Setting(methods[name], fs/1000, fs/1000), record, 1) for name, fs, record in settings]
    rows = measurement.summarise(STEP_SIZE, runs,
                                 [types.SimpleNamespace(name=name) for name in observables], clock)
    return StudyResult(
        STEP_SIZE, {
            'name': 'synthetic',
            'description': 'synthetic numbers'
        }, rows, {name: Reference(name, REFERENCE, 0.0, 'exact')
                  for name in observables}, dict.fromkeys(methods, 2),
        {name: {
            'label': name.replace('_', ' '),
            'unit': 'kJ/mol'
        }
         for name in observables}, {}, {
             'platform': 'CPU',
             'threads': 1,
             'rounds': rounds,
             'clock': clock
         })


def record(series, interval, seconds, rounds=7, equilibration=1.0, rng=None):
    """The record of a run: samples by observable, ps between them, and seconds that the steps took.
    The rounds scatter by 10 % if there is an rng."""
    n = len(next(iter(series.values())))
    scatter = np.ones(rounds) if rng is None else np.exp(0.1*rng.normal(size=rounds))
    return measurement.Record(interval, {name: list(values)
                                         for name, values in series.items()},
                              [(1000, 1000*seconds*each, 1000*seconds*each) for each in scatter],
                              length=n*interval, equilibration=equilibration)


def knownResult(settings, sigma=1e-6, **kwargs):
    """A result with given numbers. Settings are (method, fs, bias, noise in unit^2 ps,
    equilibration in ps), and a step takes 1 ms."""
    result = resultOf([(method, fs,
                        record({OBSERVABLE: REFERENCE + np.random.default_rng(1).normal(size=50)},
                               0.1, 0.001, equilibration=left))
                       for method, fs, _, _, left in settings], **kwargs)
    for row, (_, _, bias, noise, _) in zip(result.rows, settings):
        row.update(mean=REFERENCE + bias, standard_error=sigma, degrees=10**6, noise=noise,
                   noise_degrees=10**6, own_tau=1.0, sample_interval=0.1, note='')
        result._compare(row)
    return result
