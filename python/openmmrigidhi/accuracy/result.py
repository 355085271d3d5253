"""The result of a study: a table with errors, recommended settings, a comparison of methods."""
from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from typing import Any, Optional, Sequence, Union

import numpy as np

from .._types import Array
from ._results import (DECIDED, HARDLY, LARGEST_FACTOR, LONGER, NO_MEAN, NO_REFERENCE, NONE,
                       RECOMMENDED, REFERENCE, SMALL_STEPS, UNDECIDED, UNUSABLE, Recommendation,
                       Result, Wanted, checked_confidence, decide, factor_to_decide, split_wanted,
                       times, worst)
from .measurement import SECONDS_PER_DAY, STABLE, UNSTABLE
from .price import NO_MEAN_NOTES, Prices, completeNoise
from .report import StudyReport
from .statistics import Extrapolation, errorCurve, quantile


@dataclass(frozen=True)
class Knob:
    """The quantity that changes along a curve.

    Parameters
    ----------
    name : str
        column name
    label : str
        name in texts
    unit : str
        unit in texts
    scale : float
        internal value times scale = value in this unit
    speedUnit : str
        unit of speeds in texts
    speedScale : float
        ns/day times speedScale = speed in this unit
    """

    name: str
    label: str
    unit: str
    scale: float = 1.0
    speedUnit: str = 'ns/day'
    speedScale: float = 1.0

    def format(self, value: float) -> str:
        """A value with its unit, for texts."""
        return f'{value*self.scale:.6g} {self.unit}'.strip()

    def speed(self, nsPerDay: float) -> str:
        """A speed with its unit, for texts: three digits, without an exponent."""
        value = nsPerDay*self.speedScale
        return f'{value:.3g} {self.speedUnit}' if value < 1000 else f'{value:.0f} {self.speedUnit}'


STEP_SIZE = Knob('step_size', 'step', 'fs', 1000.0)


@dataclass
class Reference:
    """The reference of the comparison of means.

    Attributes
    ----------
    observable : str
    value, standardError : float
        in the observable's unit
    kind : str
        'exact', 'given' or 'extrapolated'
    fit : statistics.Extrapolation, optional
    points : list of (method, knob value)
        the points of the fit's weights
    """

    observable: str
    value: float
    standardError: float
    kind: str
    fit: Optional[Any] = None
    points: list = field(default_factory=list)

    def weight(self, method: str, value: float) -> float:
        """d(reference)/d(mean of a setting).

        The mean contributes to the reference with which it is compared.

        Parameters
        ----------
        method : str
        value : float
            value of the knob
        """
        if self.fit is None:
            return 0.0
        return dict(zip(self.points, self.fit.weights)).get((method, value), 0.0)

    def asDict(self) -> dict:
        """The reference as a dict for JSON."""
        result = {'value': self.value, 'standard_error': self.standardError, 'kind': self.kind}
        if self.fit is not None:
            result['fit'] = {
                'model': 'A0 + E h^p + F h^2p, h in ps',
                'coefficients': self.fit.coefficients,
                'chi2': self.fit.chi2,
                'degrees_of_freedom': self.fit.degrees,
                'probability': self.fit.probability,
                'note': self.fit.note,
                'model_error': self.fit.modelError,
                'weights': [{
                    'method': method,
                    'value': value,
                    'weight': weight,
                    'used': used
                } for (method, value
                       ), weight, used in zip(self.points, self.fit.weights.tolist(), self.fit.used)
                            ]
            }
        return result

    @staticmethod
    def fromDict(observable: str, data: dict) -> Reference:
        """The reference from a dict of JSON.

        Parameters
        ----------
        observable : str
        data : dict
            what asDict() returned
        """
        fit, points = None, []
        if 'fit' in data:
            old = data['fit']
            points = [(item['method'], item['value']) for item in old['weights']]
            fit = Extrapolation(data['value'], data['standard_error'],
                                np.array([item['weight'] for item in old['weights']]),
                                {name: tuple(pair)
                                 for name, pair in old['coefficients'].items()},
                                [item['used'] for item in old['weights']], old['chi2'],
                                old['degrees_of_freedom'], old['probability'], old['note'],
                                old.get('model_error', 0.0))
        return Reference(observable, data['value'], data['standard_error'], data['kind'], fit,
                         points)


class StudyResult(Result):
    """Rows of settings and observables, the references, and data on the measurement.

    Attributes
    ----------
    rows : list of dict
        one row for each setting and observable. Keys: method, knob, value (of the knob, internal
        unit), step_size (ps), status ('stable', 'unstable', 'not applicable', 'failed', 'not run'),
        message, ns_per_day (median over rounds), ns_per_day_low and _high (16 and 84 %),
        ns_per_cpu_day, speeds (each round), length and equilibration (ps), seed, observable, mean,
        standard_error, degrees (of freedom of this error), tau (integrated autocorrelation time
        that determines the length of blocks, ps), samples, drift, note. From the comparison with
        the reference: error, error_standard_error, error_low, error_high (confidence interval),
        relative_error. For prices: sample_interval (ps), variance (of one sample), own_tau and
        own_tau_error (of this run alone, and its standard error, ps), noise (squared standard error
        times length, unit^2 ps), noise_degrees (degrees of freedom of noise), effective_per_second,
        effective_per_cpu_second and effective_per_wall_second (independent samples, by the study's
        clock and by both), ns_per_wall_day.
    references : dict
        observable -> Reference
    confidence : float
        confidence of all intervals; 0.95
    """

    FORMAT = 'openmmrigidhi.accuracy 1'
    COLUMNS = ('method', 'knob', 'value', 'step_size', 'status', 'ns_per_day', 'ns_per_day_low',
               'ns_per_day_high', 'ns_per_cpu_day', 'observable', 'mean', 'standard_error', 'error',
               'error_standard_error', 'error_low', 'error_high', 'relative_error', 'tau',
               'samples', 'length', 'equilibration', 'drift', 'seed', 'note', 'message',
               'sample_interval', 'variance', 'own_tau', 'own_tau_error', 'noise', 'noise_degrees',
               'effective_per_second', 'effective_per_cpu_second', 'effective_per_wall_second',
               'ns_per_wall_day')

    def __init__(self, knob: Knob, scene: dict, rows: list[dict], references: dict,
                 orders: dict[str, int], observables: dict[str, dict], refusals: dict[str, str],
                 provenance: dict, confidence: float = 0.95) -> None:
        self.knob = knob
        self.scene = scene
        self.rows = rows
        self.references = references
        self.orders = orders
        self.observables = observables
        self.refusals = refusals
        self.provenance = provenance
        self.confidence = confidence
        for row in rows:
            self._compare(row)
            completeNoise(row, provenance.get('clock'))

    def _compare(self, row):
        row.update(error=None, error_standard_error=None, error_low=None, error_high=None,
                   relative_error=None)
        reference = self.references.get(row['observable'])
        if row['mean'] is None or reference is None:
            return
        error = row['mean'] - reference.value
        weight = reference.weight(row['method'], row['value'])
        variance = row['standard_error']**2*(1 - 2*weight) + reference.standardError**2
        sigma = math.sqrt(max(0.0, variance))
        reach = quantile(self.confidence, row['degrees'])*sigma
        row.update(error=error, error_standard_error=sigma, error_low=error - reach,
                   error_high=error + reach,
                   relative_error=error/abs(reference.value) if reference.value else None)

    # ---- Questions -------------------------------------------------------------------------------

    def select(self, observable: str, method: Optional[str] = None,
               stableOnly: bool = True) -> list[dict]:
        """Rows of one observable, by ascending knob value.

        Parameters
        ----------
        observable : str
        method : str, optional
            only rows of this method
        stableOnly : bool
            only rows with a mean

        Returns
        -------
        list of dict
        """
        rows = [
            row for row in self.rows
            if row['observable'] == observable and (method is None or row['method'] == method) and (
                not stableOnly or row['mean'] is not None)
        ]
        return sorted(rows, key=lambda row: (row['method'], row['value']))

    def methods(self) -> list:
        """Names of the methods, in the given order."""
        return list(dict.fromkeys(row['method'] for row in self.rows))

    def parseWanted(self, wanted: Union[str, Sequence[str]]) -> list[Wanted]:
        """Wanted errors from text.

        Parameters
        ----------
        wanted : str, or sequence of str
            text such as "observable:0.5%" (of the reference's magnitude) or "observable:0.2" (in
            its unit); several are separated by commas

        Returns
        -------
        list of Wanted
        """
        result = []
        for name, amount, value in split_wanted(wanted, self.observables, 'potential_energy:0.5%'):
            if amount.endswith('%'):
                reference = self.references.get(name)
                if reference is not None and not reference.value:
                    raise ValueError(
                        f'wanted error: got {name}:{amount}, a percentage of an average that is 0: '
                        f'give it in its unit, as in {name}:0.2' +
                        (f' ({self.observables[name]["unit"]})' if self.
                         observables[name]['unit'] else ''))
                value *= abs(reference.value)/100 if reference is not None else math.nan
            unit = '' if amount.endswith('%') else ' ' + self.observables[name]['unit']
            text = f'{amount}{unit} of {self.observables[name]["label"]}'
            result.append(Wanted(name, value, text))
        return result

    def recommend(self, wanted: Union[str, Sequence[str]],
                  confidence: Optional[float] = None) -> Recommendation:
        """The cheapest setting whose errors are below the wanted ones, with confidence.

        A setting qualifies if the one-sided upper bound of ``|error|`` is below the tolerance for
        every wanted observable. It fails if the lower bound is above the tolerance for one of them.
        Otherwise the statistics cannot tell.

        Parameters
        ----------
        wanted : str or sequence of str
            see :meth:`parseWanted`
        confidence : float, optional
            default: the confidence of the result, 0.95

        Returns
        -------
        Recommendation
            its setting and candidates have method, value, step_size (ps), ns_per_day, verdict,
            likely (whether the measured errors are below the wanted ones) and factor (how many
            times longer to run for a decision, or None)
        """
        confidence = checked_confidence(self.confidence if confidence is None else confidence,
                                        'recommend')
        wanted = self.parseWanted(wanted)
        candidates = []
        for key in dict.fromkeys((row['method'], row['value']) for row in self.rows):
            rows = {
                row['observable']: row
                for row in self.rows if (row['method'], row['value']) == key
            }
            first = next(iter(rows.values()))
            if first['status'] != STABLE or first['ns_per_day'] is None:
                continue
            verdicts = [self.judge(rows[item.observable], item, confidence) for item in wanted]
            verdict = worst([each[0] for each in verdicts])
            factor = max((each[1] for each in verdicts if each[0] == 'undecided'), default=None)
            likely = all(each[2] for each in verdicts)
            candidates.append({
                'method': key[0],
                'value': key[1],
                'step_size': first['step_size'],
                'ns_per_day': first['ns_per_day'],
                'verdict': verdict,
                'likely': likely,
                'factor': factor if verdict == 'undecided' else None
            })
        candidates.sort(key=lambda candidate: -candidate['ns_per_day'])
        return self._conclude(candidates, wanted, confidence)

    def judge(self, row: dict, item: Wanted, confidence: float,
              isReferenceExact: bool = False) -> tuple[str, Optional[float], bool]:
        """Whether the error of a setting is below a wanted error.

        Parameters
        ----------
        row : dict
        item : Wanted
        confidence : float
        isReferenceExact : bool
            take the length for a decision without the remaining error of the reference

        Returns
        -------
        tuple of (str, float or None, bool)
            verdict 'yes', 'no', 'undecided' or 'n/a'; how many times longer to run for a decision,
            infinite where no length suffices; whether the measured error is below the wanted error
        """
        if row['error'] is None or not math.isfinite(item.tolerance):
            return 'n/a', None, False
        size, sigma = abs(row['error']), row['error_standard_error']
        reach = quantile(confidence, row['degrees'], sided=1)*sigma
        likely = size <= item.tolerance
        if size + reach <= item.tolerance:
            return 'yes', None, likely
        if size - reach > item.tolerance:
            return 'no', None, likely
        # Runs must become so long that the error of the error, times z, fits into this room. An
        # error that cannot be told from 0 is mostly noise: if it is really near 0, the room is the
        # wanted error, however far beyond it the noise has put the measured one.
        room = abs(item.tolerance - size)
        if size <= reach:
            room = min(room, item.tolerance)
        # The error of a given reference stays the same, however long the runs are, and so does what
        # the model of an extrapolation may be wrong by.
        fixed = self._fixed_error(item.observable)
        room = (room/quantile(confidence, math.inf, sided=1))**2
        room -= 0 if isReferenceExact else fixed**2
        return 'undecided', float(sigma**2 - fixed**2)/room if room > 0 else math.inf, likely

    def _fixed_error(self, observable):
        reference = self.references[observable]
        if reference.fit is not None:
            return float(reference.fit.modelError)
        return float(reference.standardError) if reference.kind == 'given' else 0.0

    def outlook(self, factor: float, undecided: list[dict], wanted: list[Wanted],
                confidence: float) -> tuple[str, str]:
        """What decides about settings: the reason of the answer, and advice, as text.

        Parameters
        ----------
        factor : float
            how many times longer to run
        undecided : list of dict
            the undecided candidates
        wanted : list of Wanted
        confidence : float

        Returns
        -------
        (str, str)
        """
        if factor <= LARGEST_FACTOR:
            return LONGER, f'run longer: about {times(factor)} times'
        keys = [(each['method'], each['value']) for each in undecided if each['factor'] >= factor]
        for item in wanted:
            fixed = self._fixed_error(item.observable) if item.observable in self.references else 0
            rows = [
                row for row in self.select(item.observable) if (row['method'], row['value']) in keys
            ]
            if fixed > 0 and any(self._is_for_reference(row, item, confidence) for row in rows):
                label, unit = (self.observables[item.observable][key] for key in ('label', 'unit'))
                reason, what, remedy = (
                    SMALL_STEPS, 'limit of small steps',
                    'smaller steps') if self.references[item.observable].fit is not None else (
                        REFERENCE, 'given reference', 'a better reference')
                return reason, (f'the {what} of {label} is not known well enough: its error is '
                                f'{fixed:.3g} {unit} however long runs are; longer runs will not '
                                f'decide it, {remedy} may')
        return HARDLY, ('their errors are so close to the limit that longer runs will hardly '
                        'decide it; ask for a larger error')

    def _is_for_reference(self, row, item, confidence):
        """Whether runs of some length would decide, if the reference were known exactly."""
        factors = [self.judge(row, item, confidence, isExact)[1] for isExact in (False, True)]
        return None not in factors and factors[1] <= LARGEST_FACTOR < factors[0]

    def _conclude(self, candidates, wanted, confidence):
        text = f'For an error of at most {" and ".join(item.text for item in wanted)}: '
        sure = f'{100*confidence:g} % confidence'
        verdict, best, undecided = decide(candidates)
        factor, reason = None, DECIDED
        if verdict == RECOMMENDED:
            text += (f'{self._name(best)}, {self.knob.speed(best["ns_per_day"])}. It is the '
                     f'cheapest setting that meets this with {sure}.')
            faster = [c for c in undecided if c['ns_per_day'] > best['ns_per_day']]
            if faster:
                factor = min(c['factor'] for c in faster)
                reason, todo = self.outlook(factor, faster, wanted, confidence)
                text += (f' Faster settings that may or may not meet it: '
                         f'{", ".join(self._name(c) for c in faster)}; {todo}.')
            text += self._best_of_others(candidates, best)
        elif undecided:
            factor = factor_to_decide(undecided)
            reason, todo = self.outlook(factor, undecided, wanted, confidence)
            text += (f'cannot tell. The statistics do not suffice for '
                     f'{", ".join(self._name(c) for c in undecided)}; {todo}.')
        elif verdict == UNDECIDED:
            notes = self._why_no_mean(wanted)
            reason = NO_MEAN if notes else NO_REFERENCE
            text += 'cannot tell. ' + (
                f'There is no mean, since {" and ".join(notes)}: look at the observable.'
                if notes else 'There is nothing to compare with: no exact value, and too few '
                'stable settings for an extrapolation; add smaller steps.')
        elif not candidates:
            reason = UNUSABLE
            text += f'{NONE}. No setting was stable; smaller steps may be.'
        else:
            unknown = [self._name(c) for c in candidates if c['verdict'] == 'n/a']
            text += (
                f'{NONE}. Every stable setting{" that can be judged" if unknown else ""} misses it '
                f'with {sure}; smaller steps may meet it.' +
                (f' There is no mean, or nothing to compare with, for {", ".join(unknown)}.'
                 if unknown else ''))
        return Recommendation(verdict, best, text, candidates, factor, wanted, reason)

    def _why_no_mean(self, wanted):
        """Why no setting has means of all these observables; empty if a reference is wanting."""
        if not all(
                math.isfinite(item.tolerance) and item.observable in self.references
                for item in wanted):
            wanted = [item for item in wanted if not self.select(item.observable)]
        names = [item.observable for item in wanted]
        return list(
            dict.fromkeys(
                NO_MEAN_NOTES.get(row['note'], 'the table has none') for row in self.rows
                if row['observable'] in names and row['status'] == STABLE and row['mean'] is None))

    def _best_of_others(self, candidates, best):
        """The results of the other methods, as text."""
        parts = []
        for method in self.methods():
            if method == best['method']:
                continue
            own = next((c for c in candidates if c['method'] == method and c['verdict'] == 'yes'),
                       None)
            if own is not None:
                parts.append(f'{self._name(own)} ({self.knob.speed(own["ns_per_day"])}, '
                             f'{best["ns_per_day"]/own["ns_per_day"]:.2f} times slower)')
        return f' The best of the other methods that meet it: {"; ".join(parts)}.' if parts else ''

    def _name(self, candidate):
        return f'{candidate["method"]} at {self.knob.format(candidate["value"])}'

    def compareAt(self, wanted: str, baseline: str = 'LangevinMiddle',
                  resamplings: int = 1000) -> dict:
        """How fast each method is at the wanted error, also between the measured steps.

        The function fits :math:`E h^p + F h^{2p}` to the errors of each method up to twice the
        wanted error. Above that the curve goes straight from point to point. The curve gives the
        step at which the error reaches the wanted error. ns/day at this step is the step times the
        steps per second (median over rounds). For uncertainties the means are resampled (normal
        law), together with the shared reference and the rounds of the timings.

        Parameters
        ----------
        wanted : str
            one wanted error, e.g. "potential_energy:0.5%"
        baseline : str
            the reference method of ratios
        resamplings : int

        Returns
        -------
        dict
            method -> dict with step (ps), step_low, step_high, capped (the error as measured is
            still below the wanted one at the largest stable step, which is given as the step), sure
            (it is below with the result's confidence), limited (a larger step was unstable), beyond
            (the step is smaller than all that were measured), missed (the errors as measured are
            above the wanted one at all measured steps, so that no limit of small steps is known:
            the numbers from step to ratio_high are None), ns_per_day, ns_per_day_low, _high, ratio,
            ratio_low, ratio_high (None without the baseline; intervals of the result's confidence),
            chi2, degrees. Methods without stable settings are missing.
        """
        item, = self.parseWanted(wanted)
        reference = self.references.get(item.observable)
        if reference is None or not math.isfinite(item.tolerance):
            return {}
        rng = np.random.default_rng(12345)
        curves, clouds = {}, {}
        selected = {
            method: [row for row in self.select(item.observable, method) if row['speeds']]
            for method in self.methods()
        }
        shared = min((len(row['speeds']) for rows in selected.values() for row in rows), default=0)
        # The rounds are the same for all methods, since what slowed one down slowed the others.
        picks = rng.integers(0, max(1, shared), size=(resamplings, max(1, shared)))
        everything = [row for rows in selected.values() for row in rows]
        if not everything:
            return {}
        errors = np.array([row['error'] for row in everything])
        sigmas = np.array([row['error_standard_error'] for row in everything])
        resampled = errors + self.deviations(everything, rng, resamplings)
        for method, rows in selected.items():
            if not rows:
                continue
            mine = np.array([row['method'] == method for row in everything])
            curve = errorCurve([row['step_size'] for row in rows], errors[mine],
                               np.maximum(sigmas[mine], 1e-300), resampled[:, mine],
                               self.orders[method], item.tolerance,
                               max(row['step_size'] for row in rows))
            step, steps = curve.stepFor(item.tolerance)
            rate = self.stepsPerSecond(item.observable, method, step)
            rates = np.median(rate[:shared][picks], axis=1)
            perNs = SECONDS_PER_DAY/1000
            curves[method] = {
                'step': step,
                'capped': bool(step >= curve.largest),
                'sure': self.judge(rows[-1], item, self.confidence)[0] == 'yes',
                'limited': self._was_unstable_above(method, curve.largest),
                'beyond': bool(step < rows[0]['step_size']),
                'missed': bool(np.all(np.abs(errors[mine]) > item.tolerance)),
                'ns_per_day': step*np.median(rate)*perNs,
                'steps_per_second': float(np.median(rate)),
                'chi2': curve.chi2,
                'degrees': curve.degrees,
                'coefficients': curve.coefficients.tolist(),
                'largest_fitted_step': curve.fitted
            }
            clouds[method] = (steps, steps*rates*perNs)
        tails = [50*(1 - self.confidence), 50*(1 + self.confidence)]
        for method, entry in curves.items():
            entry['step_low'], entry['step_high'] = map(float,
                                                        np.percentile(clouds[method][0], tails))
            entry['ns_per_day_low'], entry['ns_per_day_high'] = map(
                float, np.percentile(clouds[method][1], tails))
            entry.update(ratio=None, ratio_low=None, ratio_high=None, step_ratio=None)
            if baseline in curves:
                entry['ratio'] = entry['ns_per_day']/curves[baseline]['ns_per_day']
                entry['step_ratio'] = entry['step']/curves[baseline]['step']
                low, high = np.percentile(clouds[method][1]/clouds[baseline][1], tails)
                entry['ratio_low'], entry['ratio_high'] = float(low), float(high)
        isBaselineMissed = baseline in curves and curves[baseline]['missed']
        ratios = ('ratio', 'ratio_low', 'ratio_high', 'step_ratio')
        numbers = ('step', 'step_low', 'step_high', 'ns_per_day', 'ns_per_day_low',
                   'ns_per_day_high', 'steps_per_second')
        for entry in curves.values():
            if entry['missed'] or isBaselineMissed:
                entry.update(dict.fromkeys(ratios))
            if entry['missed']:
                entry.update(dict.fromkeys(numbers))
        return {method: curves[method] for method in self.methods() if method in curves}

    def _was_unstable_above(self, method, step):
        return any(row['method'] == method and row['status'] == UNSTABLE and row['step_size'] > step
                   for row in self.rows)

    def deviations(self, rows: list[dict], rng: np.random.Generator, resamplings: int) -> Array:
        """Possible deviations of the errors, by the normal law.

        Rows that share a reference are correlated.

        Parameters
        ----------
        rows : list of dict
            rows of one observable, with errors
        rng : numpy.random.Generator
        resamplings : int

        Returns
        -------
        ndarray of shape (resamplings, number of rows)
        """
        reference = self.references[rows[0]['observable']]
        variances = np.array([row['standard_error']**2 for row in rows])
        covariance = np.diag(variances) + reference.standardError**2
        parts = variances*[reference.weight(row['method'], row['value']) for row in rows]
        covariance -= np.add.outer(parts, parts)
        return rng.multivariate_normal(np.zeros(len(rows)), covariance, size=resamplings,
                                       method='eigh')

    def price(self, wanted: Union[str, Sequence[str]], confidence: Optional[float] = None,
              resamplings: int = 2000) -> Recommendation:
        r"""The setting that determines a number to a wanted total error in the least time.

        The total error is the root mean square of bias and standard error. A setting whose bias
        reaches the wanted error therefore never reaches the wanted total error. Time is the time of
        the integration steps by the study's clock, with the equilibration of the runs. With several
        observables the slowest one decides. Only measured settings count: the price is flat around
        the optimum. A step that is too long or too short by a fifth costs 9 to 14 % more where the
        error grows with the square of the step.

        For intervals the following are resampled together: the bias (Student's t, with the
        reference that settings share), the noise (:math:`\chi^2`, see
        :func:`openmmrigidhi.analysis.series.noise`) and the rounds of the timings. Where an error
        cannot be distinguished from 0, the lower end excludes it.

        Parameters
        ----------
        wanted : str or sequence of str
            see :meth:`parseWanted`
        confidence : float, optional
            default: the confidence of the result, 0.95
        resamplings : int
            at least 100

        Returns
        -------
        Recommendation
            recommended is the setting with the least time among those whose bias is below the
            wanted error with confidence, as :meth:`recommend` decides it. setting and candidates
            have method, value, step_size (ps), ns_per_day, bias (verdict about it alone), verdict
            ('cheapest', 'not distinguishable' from it, 'dearer', 'undecided', 'no', 'n/a'),
            seconds, seconds_low and _high, ratio (to the cheapest's), ratio_low and _high,
            observable (the one that takes the time), bias_part (of the squared total error),
            equilibration_part (of the time), own_tau (ps), effective_per_second, length (ps),
            factor (how many times longer to measure for a decision about the bias, or None) and
            marks (texts). Times are infinite where the wanted error is never reached.
        """
        return Prices(self,
                      resamplings).recommend(self.parseWanted(wanted),
                                             self.confidence if confidence is None else confidence)

    def spend(self, observable: str, seconds: float, confidence: Optional[float] = None,
              resamplings: int = 2000) -> Recommendation:
        """The setting that determines a number best in a given time.

        Parameters
        ----------
        observable : str
        seconds : float
            time of integration steps by the study's clock, equilibration included
        confidence : float, optional
            default: the confidence of the result, 0.95
        resamplings : int
            at least 100

        Returns
        -------
        Recommendation
            setting and candidates have method, value, step_size (ps), ns_per_day, verdict ('best',
            'not distinguishable' from it, 'worse', 'n/a': the time does not suffice for the
            equilibration), total_error, total_error_low and _high (observable's unit), bias,
            standard_error (in that time), ratio (to the best), ratio_low and _high, length (ps) and
            marks (texts)
        """
        return Prices(self,
                      resamplings).spend(observable, seconds,
                                         self.confidence if confidence is None else confidence)

    def stepsPerSecond(self, observable: str, method: str, step: float) -> Array:
        """Steps per second in each round at a step size.

        They are interpolated between the neighbouring measured step sizes. A step costs nearly the
        same for all sizes; larger steps rebuild neighbour lists more often.

        Parameters
        ----------
        observable, method : str
        step : float
            ps

        Returns
        -------
        ndarray of shape (rounds,)
            empty if the method has no stable setting
        """
        rows = [row for row in self.select(observable, method) if row['speeds']]
        if not rows:
            return np.array([])
        shared = min(len(row['speeds']) for row in rows)
        sizes = [row['step_size'] for row in rows]
        rates = np.array([
            np.array(row['speeds'][:shared])*1000/SECONDS_PER_DAY/row['step_size'] for row in rows
        ])
        return np.array([np.interp(step, sizes, rates[:, k]) for k in range(shared)])

    # ---- Files -----------------------------------------------------------------------------------

    def asDict(self) -> dict:
        """Everything, as a dict for JSON.

        The rounds' speeds are the same for all observables and are listed once.
        """
        speeds = {(row['method'], row['value']): row['speeds'] for row in self.rows}
        return {
            'format': self.FORMAT,
            'confidence': self.confidence,
            'knob': asdict(self.knob),
            'scene': self.scene,
            'orders': self.orders,
            'observables': self.observables,
            'refusals': self.refusals,
            'provenance': self.provenance,
            'references': {name: reference.asDict()
                           for name, reference in self.references.items()},
            'rows': [{key: value
                      for key, value in row.items() if key != 'speeds'} for row in self.rows],
            'ns_per_day_of_rounds': [{
                'method': method,
                'value': value,
                'speeds': [float(f'{x:.6g}') for x in values]
            } for (method, value), values in speeds.items()]
        }

    @classmethod
    def fromDict(cls, data: dict) -> StudyResult:
        """The result from what asDict() returned.

        Parameters
        ----------
        data : dict
        """
        speeds = {(entry['method'], entry['value']): entry['speeds']
                  for entry in data['ns_per_day_of_rounds']}
        for row in data['rows']:
            row['speeds'] = speeds[row['method'], row['value']]
        references = {
            name: Reference.fromDict(name, entry)
            for name, entry in data['references'].items()
        }
        return cls(Knob(**data['knob']), data['scene'], data['rows'], references, data['orders'],
                   data['observables'], data['refusals'], data['provenance'], data['confidence'])

    def report(
        self, wanted: Sequence[str] = (), baseline: str = 'LangevinMiddle',
        price: Sequence[str] = (), spend: Sequence[float] = ()
    ) -> StudyReport:
        """The report: the files of :meth:`write`, textTable() and paragraphs().

        Parameters
        ----------
        wanted, baseline, price, spend
            as for :meth:`write`

        Returns
        -------
        report.StudyReport
        """
        return StudyReport(self, wanted, baseline, price, spend)

    def write(
        self, directory: str, wanted: Sequence[str] = (), baseline: str = 'LangevinMiddle',
        price: Sequence[str] = (), spend: Sequence[tuple[str, float]] = ()
    ) -> list[str]:
        """Write results.csv, results.json, pictures and report.html into a directory.

        Parameters
        ----------
        directory : str
            created if it does not exist
        wanted : sequence of str
            wanted errors; :meth:`recommend` answers each of them
        baseline : str
            the method with which speeds are compared
        price : sequence of str
            wanted total errors; :meth:`price` answers each of them, with a picture
        spend : sequence of (str, float)
            observables and seconds; :meth:`spend` answers each of them

        Returns
        -------
        list of str
            paths of the files
        """
        return self.report(wanted, baseline, price, spend).write(directory)
