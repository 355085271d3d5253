"""The price of knowing a number: bias and noise of every setting together.

The module gives the time to a wanted error, and the error after a given time. The arithmetic is in
accuracy/statistics.py. Here settings are compared, with the uncertainty of all measured quantities.
"""
from __future__ import annotations

import math
import numbers
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Collection, Optional

import numpy as np

from .._types import Array
from ._pages import duration
from ._results import (DECIDED, NO_MEAN, NO_REFERENCE, NONE, RECOMMENDED, UNDECIDED, UNUSABLE,
                       Recommendation, checked_confidence, factor_to_decide, worst)
from .measurement import SECONDS_PER_DAY, SLOW, STABLE
from .statistics import errorAfter, noiseDegrees, resampledNoise, timeToError

if TYPE_CHECKING:
    from ._results import Wanted
    from .result import StudyResult

#: Verdicts about settings.
CHEAPEST, SAME, DEARER, OPEN = 'cheapest', 'not distinguishable', 'dearer', 'undecided'
BEST, WORSE = 'best', 'worse'
#: Intervals need some resamplings in their tails.
FEWEST_RESAMPLINGS = 100
#: The notes of rows without a mean, as sentences.
NO_MEAN_NOTES = {
    'too few samples': 'there are too few samples',
    'n/a': 'no sample is a number',
    'sometimes not a number': 'some samples are not numbers'
}
#: The largest number of settings that are named in a sentence.
MOST_NAMES = 6
#: With fewer degrees of freedom the relative standard error of a noise is above one half.
FEWEST_NOISE_DEGREES = 8


def completeNoise(row: dict, clock: Optional[str] = None) -> None:
    """Give a row what prices are made of, as far as the row has it.

    A price is made of noise, the row's own times, and independent samples a second. Results that
    were written before noise was measured have the standard error of block averages. Its square
    times the length is the noise, known with the degrees of freedom of the blocks.

    Parameters
    ----------
    row : dict
        the row, which is changed; see StudyResult.rows
    clock : str, optional
        the clock that ns_per_day is from, 'wall' or 'cpu'
    """
    row.setdefault('ns_per_wall_day', row['ns_per_day'] if clock == 'wall' else None)
    for key in ('sample_interval', 'variance', 'own_tau', 'own_tau_error', 'noise',
                'noise_degrees'):
        row.setdefault(key, None)
    if row['noise'] is None and row['mean'] is not None and row['tau'] and row['samples'] and row[
            'length']:
        interval, noise = row['length']/row['samples'], row['standard_error']**2*row['length']
        degrees = noiseDegrees(row['tau']/interval, row['samples'])
        row.update(sample_interval=interval, noise=noise, noise_degrees=row['degrees'],
                   variance=noise/(2*row['tau']), own_tau=row['tau'],
                   own_tau_error=row['tau']*math.sqrt(2/degrees))
    for key, speed in (('effective_per_second', 'ns_per_day'),
                       ('effective_per_cpu_second', 'ns_per_cpu_day'), ('effective_per_wall_second',
                                                                        'ns_per_wall_day')):
        row[key] = row['variance']/row['noise']*row[speed]*1000/SECONDS_PER_DAY if row[
            'noise'] and row[speed] else None


@dataclass
class _Known:
    """What is known of one observable at all settings; not a number where nothing is known.

    Attributes
    ----------
    rows : list of dict
    bias, noise, equilibration : ndarray of shape (settings,)
    biases, noises : ndarray of shape (resamplings, settings)
        resampled biases and noises
    leastBiases : ndarray of shape (resamplings, settings)
        resampled biases, but 0 where the bias cannot be told from 0
    """

    rows: list
    bias: np.ndarray
    noise: np.ndarray
    equilibration: np.ndarray
    biases: np.ndarray
    noises: np.ndarray
    leastBiases: np.ndarray


class Prices:
    """The settings of a result as sources of a number: bias, noise and speed resampled together.

    Parameters
    ----------
    result : StudyResult
    resamplings : int
    """
    def __init__(self, result: StudyResult, resamplings: int = 2000) -> None:
        if not resamplings >= FEWEST_RESAMPLINGS:
            raise ValueError(f'price: resamplings: got {resamplings}; intervals need at least '
                             f'{FEWEST_RESAMPLINGS}')
        self.result = result
        self.resamplings = int(resamplings)
        #: (method, value) of the settings that can be used, and a row of each.
        self.keys, self.rows = [], []
        for row in result.rows:
            key = row['method'], row['value']
            if key not in self.keys and row['status'] == STABLE and row['speeds']:
                self.keys.append(key)
                self.rows.append(row)
        #: ps/s
        self.speed = np.array([np.median(row['speeds']) for row in self.rows])*1000/SECONDS_PER_DAY
        rng = np.random.default_rng(54321)
        shared = min((len(row['speeds']) for row in self.rows), default=1)
        # The rounds are the same for all settings, since what slowed one down slowed the others.
        picks = rng.integers(0, shared, size=(self.resamplings, shared))
        self.speeds = np.stack(
            [np.median(np.array(row['speeds'][:shared])[picks], axis=1)
             for row in self.rows], axis=1)*1000/SECONDS_PER_DAY if self.rows else np.zeros(
                 (self.resamplings, 0))
        self._known = {}

    def known(self, observable: str) -> _Known:
        """What is known of an observable.

        Parameters
        ----------
        observable : str

        Returns
        -------
        _Known
        """
        if observable in self._known:
            return self._known[observable]
        # Each observable has its own random numbers, so that no answer depends on earlier
        # questions.
        rng = np.random.default_rng([list(self.result.observables).index(observable), 54321])
        found = {(row['method'], row['value']): row
                 for row in self.result.rows if row['observable'] == observable}
        rows = [found[key] for key in self.keys]
        there = np.array([row['error'] is not None and row['noise'] is not None for row in rows],
                         dtype=bool)
        mine = [row for row, flag in zip(rows, there) if flag]

        def column(key):
            return np.array([row[key] if flag else np.nan for row, flag in zip(rows, there)],
                            dtype=float)

        bias, noise = column('error'), column('noise')
        biases, noises = (np.full((self.resamplings, len(rows)), np.nan) for _ in range(2))
        if mine:
            degrees = np.array([row['degrees'] for row in mine], dtype=float)
            # A normal law with a standard error that is itself uncertain is Student's t.
            spread = np.sqrt(degrees/rng.chisquare(degrees, size=(self.resamplings, len(mine))))
            biases[:,
                   there] = bias[there] + self.result.deviations(mine, rng, self.resamplings)*spread
            noises[:, there] = resampledNoise(noise[there],
                                              column('noise_degrees')[there], rng, self.resamplings)
        isNothing = np.array(
            [flag and row['error_low'] <= 0 <= row['error_high'] for row, flag in zip(rows, there)],
            dtype=bool)
        self._known[observable] = _Known(rows, bias, noise, column('equilibration'), biases, noises,
                                         np.where(isNothing, 0, biases))
        return self._known[observable]

    # ---- Time to a wanted error ------------------------------------------------------------------

    def recommend(self, wanted: list[Wanted], confidence: float) -> Recommendation:
        """See StudyResult.price().

        Parameters
        ----------
        wanted : list of Wanted
        confidence : float

        Returns
        -------
        Recommendation
        """
        checked_confidence(confidence, 'price')
        all_ = [self.known(item.observable) for item in wanted]
        times = np.array([
            timeToError(item.tolerance, each.bias, each.noise, self.speed, each.equilibration)
            for item, each in zip(wanted, all_)
        ])
        cloud, least = (np.max([
            timeToError(item.tolerance, getattr(each, which), each.noises, self.speeds,
                        each.equilibration) for item, each in zip(wanted, all_)
        ], axis=0) for which in ('biases', 'leastBiases'))
        seconds, slowest = times.max(axis=0), times.argmax(axis=0)
        low, high = self._interval(least, cloud, confidence)
        candidates = []
        for k, row in enumerate(self.rows):
            judged = [
                self.result.judge(each.rows[k], item, confidence)
                for item, each in zip(wanted, all_)
            ]
            verdict = worst([one[0] for one in judged])
            limit, item = all_[slowest[k]], wanted[slowest[k]]
            hasPrice = all(np.isfinite(each.bias[k]) for each in all_) and all(
                math.isfinite(item.tolerance) for item in wanted)
            factor = max((one[1] for one in judged if one[0] == 'undecided'), default=None)
            candidates.append({
                **self._setting(row), 'bias': verdict if hasPrice else 'n/a',
                'verdict': None,
                'seconds': float(seconds[k]) if hasPrice else math.inf,
                'seconds_low': float(low[k]) if hasPrice else math.inf,
                'seconds_high': float(high[k]) if hasPrice else math.inf,
                'observable': item.observable,
                'bias_part': _part(limit.bias[k], item.tolerance, 2) if hasPrice else None,
                'own_tau': limit.rows[k]['own_tau'],
                'effective_per_second': limit.rows[k]['effective_per_second'],
                'equilibration_part': _part(limit.equilibration[k]/
                                            self.speed[k], seconds[k]) if hasPrice else None,
                'length': float(seconds[k]*self.speed[k] -
                                limit.equilibration[k]) if hasPrice else math.inf,
                'factor': factor if verdict == 'undecided' else None,
                'likely': all(one[2] for one in judged),
                'marks': list(dict.fromkeys(mark for each in all_ for mark in marks(each.rows[k])))
            })
        good = [k for k, each in enumerate(candidates) if each['bias'] == 'yes']
        best = min(good, key=lambda k: candidates[k]['seconds'], default=None)
        self._rank(candidates, best, seconds, cloud, confidence)
        for k, each in enumerate(candidates):
            if k == best:
                each['verdict'] = CHEAPEST
            elif each['bias'] in ('n/a', 'no'):
                each['verdict'] = each['bias']
            elif best is not None and each['ratio_low'] > 1:
                each['verdict'] = DEARER
            else:
                each['verdict'] = SAME if each['bias'] == 'yes' else OPEN
        chosen = None if best is None else candidates[best]
        candidates.sort(key=lambda each: each['seconds'])
        return self._conclude(candidates, chosen, wanted, confidence)

    def _conclude(self, candidates, best, wanted, confidence):
        text = (f'To know {" and ".join(aim(item) for item in wanted)}, bias and standard error '
                'together: ')
        clock = ' of processor time' if self.result.provenance.get('clock') == 'cpu' else ''
        undecided = [each for each in candidates if each['verdict'] == OPEN]
        factor, reason = None, DECIDED
        if best is not None:
            verdict = RECOMMENDED
            text += (
                f'{self._name(best)}, {duration(best["seconds"])}{clock} ({_between(best)}). It '
                'takes the least time of the settings whose bias is below that with '
                f'{100*confidence:g} % confidence; {100*best["bias_part"]:.0f} % of the squared '
                f'error is bias, {100*best["equilibration_part"]:.0f} % of the time equilibration' +
                (f', {self.result.observables[best["observable"]]["label"]} takes longest'
                 if len(wanted) > 1 else '') + '.')
            same = [each for each in candidates if each['verdict'] == SAME]
            if same:
                text += (' Not distinguishable from it: '
                         f'{self._names(same, lambda each: duration(each["seconds"]))}.')
            others = []
            for method in self.result.methods():
                own = next(
                    (each
                     for each in candidates if each['method'] == method and each['bias'] == 'yes'),
                    None)
                if method != best['method'] and own is not None:
                    others.append(
                        f'{self._name(own)} ({duration(own["seconds"])}, {own["ratio"]:.2f} times '
                        f'as long, {own["ratio_low"]:.2f} to {_bound(own["ratio_high"])})')
            if others:
                text += f' The best of the other methods: {"; ".join(others)}.'
            if undecided:
                factor = min(each['factor'] for each in undecided)
                reason, todo = self.result.outlook(factor, undecided, wanted, confidence)
                text += (' Settings that may cost less or never get there, since their bias is not '
                         f'known well enough: {self._names(undecided)}; {todo}.')
            if best['marks']:
                text += f' Beware: {"; ".join(best["marks"])}.'
        elif undecided:
            verdict, factor = UNDECIDED, factor_to_decide(undecided)
            reason, todo = self.result.outlook(factor, undecided, wanted, confidence)
            text += ('cannot tell. The bias is not known well enough for '
                     f'{self._names(undecided)}; {todo}.')
        elif candidates and all(each['verdict'] == 'n/a' for each in candidates):
            verdict = UNDECIDED
            why = self._why_no_mean(candidates)
            reason = NO_MEAN if why else NO_REFERENCE
            text += f'cannot tell. {why}' if why else (
                'cannot tell. There is nothing to compare with, or no correlation time. An exact '
                'value, a reference or smaller steps are needed, and runs with samples.')
        else:
            verdict = NONE
            reason = DECIDED if candidates else UNUSABLE
            unknown = [each for each in candidates if each['verdict'] == 'n/a']
            text += f'{NONE}. ' + (
                f'The bias of every stable setting{" that can be judged" if unknown else ""} '
                f'exceeds it with {100*confidence:g} % confidence: no time suffices. Smaller steps '
                'may suffice.' if candidates else 'No setting was stable; smaller steps may be.')
            if unknown:
                text += f' Nothing can be said about {self._names(unknown)}.'
        return Recommendation(verdict, best, text, candidates, factor, wanted, reason)

    # ---- Error after a time ----------------------------------------------------------------------

    def spend(self, observable: str, seconds: float, confidence: float) -> Recommendation:
        """See StudyResult.spend().

        Parameters
        ----------
        observable : str
        seconds : float
        confidence : float

        Returns
        -------
        Recommendation
        """
        self._check(observable, seconds)
        checked_confidence(confidence, 'spend')
        known = self.known(observable)
        label, unit = (self.result.observables[observable][key] for key in ('label', 'unit'))
        errors = errorAfter(seconds, known.bias, known.noise, self.speed, known.equilibration)
        cloud, least = (errorAfter(seconds, biases, known.noises, self.speeds, known.equilibration)
                        for biases in (known.biases, known.leastBiases))
        low, high = self._interval(least, cloud, confidence)
        # Settings without a finite error, or not yet equilibrated, are left out.
        out = ~np.isfinite(errors)
        candidates = []
        for k, row in enumerate(self.rows):
            length = seconds*self.speed[k] - known.equilibration[k]
            candidates.append({
                **self._setting(row), 'verdict': 'n/a' if out[k] else None,
                'total_error': math.inf if out[k] else float(errors[k]),
                'total_error_low': math.inf if out[k] else float(low[k]),
                'total_error_high': math.inf if out[k] else float(high[k]),
                'bias': None if out[k] else abs(float(known.bias[k])),
                'standard_error': None if out[k] else float(math.sqrt(known.noise[k]/length)),
                'length': max(0.0, float(length)),
                'marks': marks(known.rows[k])
            })
        best = min((k for k in range(len(candidates)) if not out[k]), key=lambda k: errors[k],
                   default=None)
        self._rank(candidates, best, np.where(out, np.inf, errors), cloud, confidence)
        for k, each in enumerate(candidates):
            each['verdict'] = each['verdict'] or (BEST if k == best else
                                                  WORSE if each['ratio_low'] > 1 else SAME)
        chosen = None if best is None else candidates[best]
        candidates.sort(key=lambda each: float(each['total_error']))
        text = f'With {duration(seconds)} for {label}: '
        if chosen is None:
            why = self._why_no_mean(candidates)
            return Recommendation(
                NONE, None, text + f'{NONE}. ' +
                (why or 'It does not suffice for the equilibration of any setting, or there is '
                 'nothing to compare with; take more time.'), candidates, None, [])
        reference = self.result.references[observable].value
        part = f' ({100*chosen["total_error"]/abs(reference):.2g} %)' if reference else ''
        text += (f'{self._name(chosen)}, which gets it to '
                 f'{chosen["total_error"]:.2g}{" " + unit if unit else ""}{part}, '
                 f'{chosen["total_error_low"]:.2g} to {chosen["total_error_high"]:.2g}: bias '
                 f'{chosen["bias"]:.2g}, standard error {chosen["standard_error"]:.2g}.')
        same = [each for each in candidates if each['verdict'] == SAME]
        if same:
            text += f' Not distinguishable from it: {self._names(same)}.'
        if chosen['marks']:
            text += f' Beware: {"; ".join(chosen["marks"])}.'
        return Recommendation(RECOMMENDED, chosen, text, candidates, None, [])

    def curves(self, observable: str, seconds: Array, confidence: float) -> tuple[Array, ...]:
        """Total errors after several times.

        Parameters
        ----------
        observable : str
        seconds : ndarray of shape (n,)
        confidence : float

        Returns
        -------
        tuple of ndarray of shape (n, settings)
            errors, and the ends of their intervals; infinite where there is none
        """
        known = self.known(observable)
        errors, low, high = [], [], []
        for time in seconds:
            errors.append(
                np.nan_to_num(
                    errorAfter(time, known.bias, known.noise, self.speed, known.equilibration),
                    nan=np.inf, posinf=np.inf))
            ends = self._interval(
                *(errorAfter(time, biases, known.noises, self.speeds, known.equilibration)
                  for biases in (known.leastBiases, known.biases)), confidence)
            for values, end in zip((low, high), ends):
                values.append(end)
        return np.array(errors), np.array(low), np.array(high)

    def _check(self, observable, seconds):
        if observable not in self.result.observables:
            raise ValueError(
                f'spend: observable: got {observable!r}, of which nothing is known here: ask for '
                f'one of {", ".join(self.result.observables)}')
        if not (isinstance(seconds, numbers.Real) and 0 < seconds < math.inf):
            raise ValueError(
                f'spend: seconds: got {seconds!r}; the time to spend must be above 0 and finite: '
                f'give it in seconds')

    # ---- Both ------------------------------------------------------------------------------------

    @staticmethod
    def _interval(least, cloud, confidence):
        """The ends of intervals.

        Infinite numbers are values like others, so nothing is interpolated.
        """
        tail = (1 - confidence)/2
        return (np.quantile(np.nan_to_num(each, nan=np.inf, posinf=np.inf), q, axis=0,
                            method='nearest') for each, q in ((least, tail), (cloud, 1 - tail)))

    def _rank(self, candidates, best, values, cloud, confidence):
        """Ratios to the best, with intervals."""
        for k, each in enumerate(candidates):
            each.update(ratio=None, ratio_low=None, ratio_high=None)
            if best is None:
                continue
            with np.errstate(invalid='ignore', divide='ignore'):
                ratios = cloud[:, k]/cloud[:, best]
                ratio = np.nan_to_num(np.float64(values[k])/values[best], nan=1.0, posinf=np.inf)
            # Where both never get there, or nothing is known, there is no difference: the ratio is
            # 1.
            ratios = np.where(np.isnan(ratios), 1.0, ratios)
            tail = (1 - confidence)/2
            low, high = np.quantile(ratios, [tail, 1 - tail], method='nearest')
            each.update(ratio=float(ratio) if np.isfinite(values[k]) else math.inf,
                        ratio_low=float(low), ratio_high=float(high))

    def _why_no_mean(self, candidates):
        """A sentence, if settings have samples of which there is no mean; otherwise nothing."""
        mine = [each for each in candidates if set(each['marks']) & set(NO_MEAN_NOTES.values())]
        if not mine:
            return ''
        reasons = dict.fromkeys(mark for each in mine for mark in each['marks']
                                if mark in NO_MEAN_NOTES.values())
        return (f'For {self._names(mine)} {" and ".join(reasons)}, so there is no mean: look at '
                'the observable.')

    def _setting(self, row):
        return {key: row[key] for key in ('method', 'value', 'step_size', 'ns_per_day')}

    def _names(self, candidates, about=None):
        """Names of settings with commas between, and a text about each; only the first of many."""
        names = [
            self._name(each) + (f' ({about(each)})' if about else '')
            for each in candidates[:MOST_NAMES]
        ]
        return ', '.join(names) + (f' and {len(candidates) - MOST_NAMES} more'
                                   if len(candidates) > MOST_NAMES else '')

    def _name(self, candidate):
        return f'{candidate["method"]} at {self.result.knob.format(candidate["value"])}'


#: The units of times.
UNITS = {'': 1, 's': 1, 'min': 60, 'h': 3600, 'd': 86400}


def parseSpending(text: str, names: Collection[str]) -> tuple[str, float]:
    """An observable and the seconds to spend on it, from text.

    Parameters
    ----------
    text : str
        "observable:3600", "observable:90s", "observable:30min", "observable:2h" or
        "observable:1.5d"
    names : collection of str
        the observables of the result

    Returns
    -------
    tuple of (str, float)
    """
    name, _, amount = text.strip().rpartition(':')
    match = re.fullmatch(r'([0-9.]+(?:[eE][-+]?[0-9]+)?) *([a-z]*)', amount.strip())
    try:
        seconds = float(match.group(1))*UNITS[match.group(2)] if match else math.nan
    except (KeyError, ValueError):
        seconds = math.nan
    if name not in names or not (seconds > 0 and math.isfinite(seconds)):
        raise ValueError(
            f'time to spend: got {text!r}, which is not an observable and its time; the observable '
            f'is one of {", ".join(names)}, the '
            f'time above 0: write e.g. {next(iter(names))}:2h, with s, min, h or d')
    return name, seconds


def marks(row: dict) -> list[str]:
    """Texts about what is doubtful about the price of a setting.

    Parameters
    ----------
    row : dict
    """
    if row['noise'] is None:
        return [NO_MEAN_NOTES[row['note']]] if row['note'] in NO_MEAN_NOTES else []
    found = []
    # Where oscillations cancel, samples know more than independent ones, and closer ones no more.
    if row['noise'] and 0.5*row['sample_interval'] <= row['own_tau'] < 2*row['sample_interval']:
        found.append(
            'samples are further apart than half a correlation time; closer samples may cost less')
    if row['noise_degrees'] < FEWEST_NOISE_DEGREES:
        found.append(
            'the run is too short for its correlation time, which is known to a half at best')
    if row['note'] == 'drifts':
        found.append('the two halves of the run disagree')
    if row['note'] == SLOW:
        found.append(f'the samples have {SLOW}, which longer runs may show to be larger')
    return found


def aim(item: Wanted) -> str:
    """A wanted error as text: what is to be known, and how well.

    Parameters
    ----------
    item : Wanted
    """
    amount, _, what = item.text.partition(' of ')
    return f'{what} to {amount}'


def _part(part, whole, power=1):
    """A part of something, to a power: 0 of nothing, and infinite beyond all numbers."""
    with np.errstate(over='ignore'):
        return float((np.float64(part)/whole)**power) if part else 0.0


def _between(candidate):
    return f'{duration(candidate["seconds_low"])} to {_or(candidate["seconds_high"], duration)}'


def _or(value, form):
    return form(value) if math.isfinite(value) else 'infinity'


def _bound(ratio):
    return _or(ratio, lambda value: f'{value:.2f}')
