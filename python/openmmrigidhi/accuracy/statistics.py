"""The extrapolation of a step-size study to step 0, curves of errors, and times to errors.

analysis.series computes means of series and their errors. This module uses numpy and scipy, not
OpenMM, so tests can check every rule on synthetic numbers.
"""
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Optional, Union

import numpy as np
import scipy.special

from .._types import Array
from ..analysis.series import (  # noqa: F401
    SeriesStatistics, autocorrelationTime, noise, noiseDegrees, replicaStatistics, seriesStatistics)

#: Errors up to this many times the wanted one are fitted by a polynomial in the step.
RANGE_IN_TOLERANCES = 2
#: The note of an extrapolation whose model the steps cannot test.
UNTESTED = 'the extrapolation could not be tested: add smaller steps'
#: A fit is rejected if its chi^2 would be exceeded with a smaller probability than this.
SMALLEST_FIT_PROBABILITY = 0.01


def quantile(confidence: float, degrees: float, sided: int = 2) -> float:
    """The half-width of a confidence interval in standard errors, by Student's t.

    Parameters
    ----------
    confidence : float
        e.g. 0.95
    degrees : float
        degrees of freedom of the standard error; infinity for a normal law
    sided : int
        2 for an interval, 1 for a bound
    """
    tail = (1 - confidence)/sided
    if not np.isfinite(degrees):
        return float(-scipy.special.ndtri(tail))
    return float(-scipy.special.stdtrit(max(1, degrees), tail))


@dataclass
class Point:
    """The data of one setting for the extrapolation.

    It has the method, the step size h, the mean, its standard error, and the order of the method.
    """

    method: str
    h: float
    mean: float
    standardError: float
    order: int


@dataclass
class Extrapolation:
    r"""The common limit :math:`h \to 0` of several methods.

    Attributes
    ----------
    value, standardError : float
        :math:`A_0`; the standard error is multiplied by :math:`\sqrt{\chi^2/n}`, with n degrees of
        freedom, where this factor is above 1, and includes the error of the model in quadrature
        (:func:`extrapolate`)
    weights : ndarray of shape (number of points,)
        the value is :math:`\sum_i w_i m_i` with these weights w and the means m; the covariance of
        :math:`A_0` with every mean needs the weights
    coefficients : dict
        method -> (E, F or None): :math:`m = A_0 + E h^p + F h^{2p}`
    used : list of bool
        which points are in the fit
    chi2 : float
    degrees : int
    probability : float
        probability of a larger chi2
    modelError : float
        the part of the standard error that longer runs do not reduce
    """

    value: float
    standardError: float
    weights: np.ndarray
    coefficients: dict
    used: list
    chi2: float
    degrees: int
    probability: float
    note: str = ''
    modelError: float = 0.0


def extrapolate(points: list[Point]) -> Optional[Extrapolation]:
    r"""Fit :math:`A_0 + E_m h^p + F_m h^{2p}` to means, with one :math:`A_0` for all methods.

    The term :math:`F_m` exists if a method has 4 or more steps. The fit is a least-squares fit,
    with points weighted by their standard errors. While the fit is not credible (probability of
    :math:`\chi^2` below 0.01), the largest step of the method that deviates most is left out, and
    the fit is repeated.

    Terms beyond the fitted ones make :math:`A_0` wrong by an amount that :math:`\chi^2` does not
    show. The error of the model is the larger of two changes of :math:`A_0`: without the largest
    step, and with an additional term for each method that has enough steps for it. A change within
    its own standard error counts only where fewer than three degrees of freedom test the model.
    Three steps of a single method test it poorly: intervals of 95 % contain the truth in some 84 %
    of the cases. Where no fit can be changed in this way, and where no degree of freedom remains,
    nothing tests the model: its error is then the contribution of the next term at the smallest
    step, if terms had the ratio of the smallest to the largest step, and a note says so.

    Parameters
    ----------
    points : list of Point
        means with positive standard errors, of methods that sample the same ensemble as
        :math:`h \to 0`

    Returns
    -------
    Extrapolation or None
        None if the points are too few: at least one method must have two steps
    """
    used = [np.isfinite(point.mean) and point.standardError > 0 for point in points]
    note = ''
    while True:
        fit = _fit(points, used)
        if fit is None:
            return None
        if fit.degrees == 0 or fit.probability >= SMALLEST_FIT_PROBABILITY:
            break
        worst = _worst_method(points, fit)
        if worst is None:
            note = 'the fit is poor (chi2 is too large); its error is enlarged accordingly'
            break
        used = list(fit.used)
        used[worst] = False
    fit.note = note
    _add_model_error(points, fit)
    return fit


def _add_model_error(points, fit):
    """Enlarge the standard error of a fit by the possible error of its model."""
    indices = [i for i in range(len(points)) if fit.used[i]]
    changes = []
    for other in _other_fits(points, fit, indices):
        # A0 of both fits is linear in the same means.
        sigma = np.array(
            [points[i].standardError if i in indices else 0 for i in range(len(points))])
        own = np.linalg.norm((other.weights - fit.weights)*sigma)
        change = other.value - fit.value
        changes.append(abs(change) if abs(change) > own or fit.degrees < 3 else 0.0)
    if fit.degrees == 0 or not changes:
        fit.note = fit.note or UNTESTED
        for method, (E, _) in fit.coefficients.items():
            mine = [points[i] for i in indices if points[i].method == method]
            h = [point.h for point in mine]
            order = mine[0].order
            changes.append(abs(E)*min(h)**order*(min(h)/max(h))**order)
    fit.modelError = float(max(changes))
    fit.standardError = math.hypot(fit.standardError, fit.modelError)


def _other_fits(points, fit, indices):
    """Fits of the same kind that are as good where the model is right."""
    largest = max(points[i].h for i in indices)
    used = [flag and points[i].h < largest for i, flag in enumerate(fit.used)]
    fits = [_fit(points, used)]
    count = _count(points, indices)
    terms = {
        method: _terms(count[method]) + 1
        for method in count if count[method] > _terms(count[method]) + 1
    }
    if terms:
        fits.append(_fit(points, fit.used, terms))
    return [other for other in fits if other is not None]


def _count(points, indices):
    count = {}
    for i in indices:
        count[points[i].method] = count.get(points[i].method, 0) + 1
    return count


def _terms(steps):
    """The number of powers of h^p for a method with so many steps."""
    return 2 if steps >= 4 else 1


def _worst_method(points, fit):
    """The index of the largest step of the method whose points deviate most.

    Only methods that can spare a step count.
    """
    deviation = {}
    for point, used in zip(points, fit.used):
        if used:
            deviation[point.method] = deviation.get(point.method, 0) + _residual(point, fit)**2
    for method in sorted(deviation, key=deviation.get, reverse=True):
        indices = [i for i, point in enumerate(points) if fit.used[i] and point.method == method]
        if len(indices) > 2:
            return max(indices, key=lambda i: points[i].h)
    return None


def _residual(point, fit):
    E, F = fit.coefficients[point.method]
    x = point.h**point.order
    return (point.mean - fit.value - E*x - (F or 0)*x*x)/point.standardError


def _fit(points, used, terms=None):
    indices = [i for i in range(len(points)) if used[i]]
    count = _count(points, indices)
    # A method with a single step says nothing about A0 that its own E cannot absorb.
    indices = [i for i in indices if count[points[i].method] >= 2]
    used = [i in indices for i in range(len(points))]
    if not indices:
        return None
    methods = sorted({points[i].method for i in indices})
    scale = max(points[i].h for i in indices)
    columns = [('A0', None, 0)]
    for method in methods:
        powers = (terms or {}).get(method, _terms(count[method]))
        columns += [(method, 'EFG'[power - 1], power) for power in range(1, powers + 1)]
    design = np.zeros((len(indices), len(columns)))
    mean = np.array([points[i].mean for i in indices])
    sigma = np.array([points[i].standardError for i in indices])
    for row, i in enumerate(indices):
        for column, (method, _, power) in enumerate(columns):
            if power == 0:
                design[row, column] = 1
            elif method == points[i].method:
                design[row, column] = (points[i].h/scale)**(power*points[i].order)
    inverse = np.linalg.pinv(design/sigma[:, None])
    parameters = inverse @ (mean/sigma)
    chi2 = float((((mean - design @ parameters)/sigma)**2).sum())
    degrees = len(indices) - len(columns)
    inflation = np.sqrt(max(1, chi2/degrees)) if degrees > 0 else 1
    weights = np.zeros(len(points))
    weights[indices] = inverse[0]/sigma
    orders = {points[i].method: points[i].order for i in indices}
    coefficients = {method: [0, None, None] for method in methods}
    for (method, name, power), value in zip(columns, parameters):
        if power:
            coefficients[method][power - 1] = float(value/scale**(power*orders[method]))
    probability = float(scipy.special.chdtrc(degrees, chi2)) if degrees > 0 else 1.0
    return Extrapolation(float(parameters[0]), float(inflation*np.linalg.norm(inverse[0])), weights,
                         {method: tuple(pair[:2])
                          for method, pair in coefficients.items()}, used, chi2, degrees,
                         probability)


@dataclass
class ErrorCurve:
    """The error of one method at the step h: :math:`E h^p + F h^{2p}` where the errors are small.

    Between the points above these errors the curve is a straight line in h. The stability limit of
    a scheme is a cliff that no low-order polynomial follows. Near it the measured points are the
    better curve.

    Attributes
    ----------
    order : int
    coefficients : ndarray of shape (2,)
        E, F
    cloud : ndarray of shape (resamplings, 2)
        resampled E, F
    beyond : ndarray of shape (k,)
        steps above the fitted ones, ascending
    errors : ndarray of shape (k,)
        errors at these steps
    errorCloud : ndarray of shape (resamplings, k)
        resampled errors
    largest : float
        the largest stable measured step
    fitted : float
        the largest step in the fit
    chi2 : float
    degrees : int
    """

    order: int
    coefficients: np.ndarray
    cloud: np.ndarray
    beyond: np.ndarray
    errors: np.ndarray
    errorCloud: np.ndarray
    largest: float
    fitted: float
    chi2: float
    degrees: int

    def stepFor(self, tolerance: float) -> tuple[float, Array]:
        """The step at which ``|error|`` first reaches the tolerance, capped at `largest`.

        The result is the value, and an ndarray for the cloud.
        """
        value = self._solve(self.coefficients, self.errors, tolerance)
        return value, np.array(
            [self._solve(*each, tolerance) for each in zip(self.cloud, self.errorCloud)])

    def _solve(self, pair, errors, tolerance):
        E, F = pair
        smallest = np.inf
        for sign in (1, -1):
            roots = np.roots([F, E, -sign*tolerance]) if F != 0 else np.array(
                [sign*tolerance/E if E != 0 else np.inf])
            for root in roots:
                if abs(root.imag) < 1e-12*abs(root) + 1e-300 and 0 < root.real < smallest:
                    smallest = root.real
        if smallest <= self.fitted**self.order:
            return smallest**(1/self.order)
        x = self.fitted**self.order
        h, error = self.fitted, E*x + F*x*x
        for nextStep, nextError in zip(self.beyond, errors):
            if abs(nextError) >= tolerance:
                limit = np.copysign(tolerance, nextError)
                return h + (nextStep - h)*(limit - error)/(nextError - error)
            h, error = nextStep, nextError
        return self.largest


def errorCurve(h: Array, errors: Array, sigma: Array, resampled: Array, order: int,
               tolerance: float, largest: float) -> ErrorCurve:
    """Fit :math:`E h^p + F h^{2p}` to the errors of one method up to twice a tolerance.

    The points above are kept unchanged.

    Parameters
    ----------
    h, errors : ndarray of shape (n,)
        steps, ascending, and the measured errors; n >= 1
    sigma : ndarray of shape (n,)
        standard errors of the errors
    resampled : ndarray of shape (resamplings, n)
        resampled errors
    order : int
    tolerance : float
    largest : float
        the largest stable step

    Returns
    -------
    ErrorCurve
    """
    h, errors, sigma, resampled = map(np.asarray, (h, errors, sigma, resampled))
    out = np.abs(errors) > RANGE_IN_TOLERANCES*tolerance
    # Points beyond the first point that is out are not in the fit, even if the error comes back.
    # Two points are needed.
    count = max(int(np.argmax(out)) if out.any() else len(h), min(2, len(h)))
    x, scale = h[:count], h[count - 1]
    powers = (1, 2) if count >= 3 else (1,)
    design = np.stack([(x/scale)**(order*power) for power in powers], axis=1)
    inverse = np.linalg.pinv(design/sigma[:count, None])/sigma[None, :count]

    def coefficients(values):
        result = np.zeros(values.shape[:-1] + (2,))
        result[..., :len(powers)] = values @ inverse.T/np.array(
            [scale**(order*power) for power in powers])
        return result

    residual = (errors[:count] - design @ (inverse @ errors[:count]))/sigma[:count]
    return ErrorCurve(order, coefficients(errors[:count]), coefficients(resampled[:, :count]),
                      h[count:], errors[count:], resampled[:, count:], largest, float(scale),
                      float((residual**2).sum()), count - len(powers))


# ---- Bias and noise together ---------------------------------------------------------------------


def timeToError(tolerance: float, bias: float, noise: float, speed: float,
                equilibration: float) -> Union[float, Array]:
    r"""How long a run must be for a total error.

    The total error is the root mean square of bias b and standard error:
    :math:`b^2 + N/T = \epsilon^2` with the noise N, the length T and the tolerance
    :math:`\epsilon`. Equilibration comes before the length. Arguments are numbers or arrays of
    compatible shapes.

    Parameters
    ----------
    tolerance : float
        the total error, in the observable's unit
    bias : float
        in the observable's unit; its sign does not matter
    noise : float
        squared standard error times length, unit^2 ps
        (:class:`openmmrigidhi.analysis.series.Noise`)
    speed : float
        ps/s
    equilibration : float
        ps

    Returns
    -------
    float or ndarray
        s; infinite where the bias is not below the tolerance
    """
    room = np.asarray(tolerance, float)**2 - np.square(bias)
    reachable = room > 0
    # A tolerance beyond all sense takes a time beyond the range of numbers, which is infinite.
    with np.errstate(over='ignore'):
        return np.where(reachable,
                        (equilibration + np.asarray(noise)/np.where(reachable, room, 1))/speed,
                        np.inf)[()]


def errorAfter(seconds: float, bias: float, noise: float, speed: float,
               equilibration: float) -> Union[float, Array]:
    """The total error after a time: the root mean square of bias and standard error.

    Parameters
    ----------
    seconds : float
    bias, noise, speed, equilibration : float
        as for :func:`timeToError`

    Returns
    -------
    float or ndarray
        in the observable's unit; infinite where the equilibration is not over
    """
    length = np.asarray(seconds*np.asarray(speed, float) - equilibration)
    sampled = length > 0
    return np.where(sampled, np.sqrt(np.square(bias) + noise/np.where(sampled, length, 1)),
                    np.inf)[()]


def resampledNoise(noise: Array, degrees: Array, rng: np.random.Generator,
                   resamplings: int) -> Array:
    """Possible true noises, given the measured noises.

    Parameters
    ----------
    noise, degrees : ndarray of shape (n,)
        the measured noises and their degrees of freedom
    rng : numpy.random.Generator
    resamplings : int

    Returns
    -------
    ndarray of shape (resamplings, n)
    """
    degrees = np.asarray(degrees, float)
    return np.asarray(noise)*degrees/rng.chisquare(degrees, size=(resamplings, len(degrees)))
