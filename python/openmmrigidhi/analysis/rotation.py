"""Correlations of orientations, and rotational diffusion coefficients at long times."""
from __future__ import annotations

import dataclasses
import warnings
from typing import Optional, Sequence

import numpy as np
import numpy.typing as npt
from openmm import unit

from .. import _units
from .._quaternions import rotate
from .._types import Array, Number, Numbers
from ._sampling import too_few_blocks
from .diffusion import LARGEST_CURVATURE, LEAST_PROBABILITY, DiffusionCoefficient
from .displacements import _Blocks, _direction, _orientations, meanAndError

#: By default the decay is fitted down to this correlation: below, noise of long lag times rules.
LEAST_CORRELATION = 0.3


@dataclasses.dataclass
class OrientationCorrelation:
    r"""The correlation of a direction in bodies with itself at a later time.

    Attributes
    ----------
    lagTimes : Quantity of shape (lags,)
        lag times, ps
    mean : array of shape (lags,)
        the mean of the Legendre polynomial :math:`P_l(u(0) \cdot u(t))`
    error : array of shape (lags,)
        its standard error, from the spread of the blocks
    blocks : array of shape (blocks, lags)
        the correlation of each block of the trajectory
    order : int
        l, 1 or 2
    """

    lagTimes: unit.Quantity
    mean: Array
    error: Array
    blocks: Array
    order: int


def orientationCorrelation(orientations: npt.ArrayLike, frameInterval: Number, bodyVector: Numbers,
                           lags: Optional[Sequence[int]] = None, numBlocks: int = 10,
                           independentBodies: bool = False,
                           order: int = 1) -> OrientationCorrelation:
    r"""Get the correlation of a direction in bodies with itself at a later time.

    Free bodies whose mobility is symmetric about the direction u have the correlation
    :math:`e^{-l (l + 1) D t}`, where D is the coefficient of rotation about axes normal to u
    (Debye). For l = 1 and a principal axis u of the mobility this is true of every free body, with
    D the mean of the coefficients about the two other axes. Other bodies and directions have a sum
    of such decays.

    Parameters
    ----------
    orientations : array-like of shape (frames, bodies, 4)
        unit quaternions (w, x, y, z) at equal intervals, body frame to lab frame
    frameInterval : float or Quantity
        time between frames, ps
    bodyVector : Vec3 or sequence of shape (3,)
        the direction in the body frame, of any length but 0, such as the axis of a rod
    lags : sequence of int, optional
        as in :func:`translationalMSD`
    numBlocks : int
        as in :func:`translationalMSD`
    independentBodies : bool
        as in :func:`translationalMSD`
    order : int
        l: 1, as in dielectric relaxation, or 2, as in NMR and fluorescence

    Returns
    -------
    OrientationCorrelation

    Raises
    ------
    TypeError, ValueError
        as in :func:`translationalMSD`, and for a vector of length 0 or another order
    """
    where = 'orientationCorrelation'
    q = _orientations(orientations, where)
    direction = _direction(bodyVector, where)
    order = _units.integer(order, where, 'order')
    if order not in (1, 2):
        raise ValueError(f'{where}: order: got {order}; the order of the Legendre polynomial must '
                         'be 1 or 2: give one of these')
    blocks = _Blocks(len(q), q.shape[1], frameInterval, lags, numBlocks, independentBodies, where)
    u = blocks.cut(rotate(q, direction))
    rows = []
    for lag in blocks.lags:
        cosines = np.einsum('btni,btni->btn', u[:, lag:], u[:, :blocks.length - lag])
        values = (cosines if order == 1 else 1.5*cosines**2 - 0.5).mean(axis=1)
        rows.append(values.ravel() if blocks.independent else values.mean(axis=1))
    found = np.stack(rows, axis=1)
    return OrientationCorrelation(_units.TIME.attach(blocks.interval*blocks.lags),
                                  *meanAndError(found), found, order)


def rotationalDiffusion(correlation: OrientationCorrelation, minTime: Number = 0.0,
                        maxTime: Optional[Number] = None) -> DiffusionCoefficient:
    r"""Get the rotational diffusion coefficient from the decay of a correlation.

    It is the slope of :math:`-\ln C(t)` over :math:`l (l + 1)`, of a line through the lag times of
    a range, with weights for errors that do not depend on the lag time. Its error comes from
    leaving out one block after the other. A warning says if the decay is no exponential: bodies in
    fields, at walls, and those that are not symmetric about the direction have others.

    Parameters
    ----------
    correlation : OrientationCorrelation
    minTime : float or Quantity
        the shortest lag time in the fit, ps; longer than the time in which the body forgets its
        angular momentum, and for the coefficient at long times in a suspension longer than that in
        which its neighbours move
    maxTime : float or Quantity, optional
        the longest lag time in the fit, ps; None: up to where the correlation falls below 0.3

    Returns
    -------
    DiffusionCoefficient
        1/ps

    Raises
    ------
    TypeError
        if correlation is no OrientationCorrelation
    ValueError
        if the range has fewer than two lag times, or a correlation that is not above its errors
    """
    where = 'rotationalDiffusion'
    if not isinstance(correlation, OrientationCorrelation):
        raise TypeError(f'{where}: correlation: got {type(correlation).__name__}; it must be an '
                        'OrientationCorrelation: give what orientationCorrelation() returns')
    times = correlation.lagTimes.value_in_unit(unit.picosecond)
    minTime = _units.number(minTime, _units.TIME, where, 'minTime')
    if maxTime is None:
        low = times[(correlation.mean < LEAST_CORRELATION) & (times > 0)]
        maxTime = low.min()*(1 - 1e-9) if len(low) else np.inf
    else:
        maxTime = _units.number(maxTime, _units.TIME, where, 'maxTime')
    chosen = np.flatnonzero((times >= minTime*(1 - 1e-12)) & (times <= maxTime*(1 + 1e-12)))
    if len(np.unique(times[chosen])) < 2:
        raise ValueError(
            f'{where}: minTime, maxTime: got {minTime:g} and {maxTime:g} ps; a slope needs two lag '
            f'times in that range, and they are from {times.min():g} to {times.max():g} ps: widen '
            'it, or give smaller or more lags to orientationCorrelation()')
    worst = chosen[np.argmin(correlation.mean[chosen] - 3*correlation.error[chosen])]
    if correlation.mean[worst] <= 3*correlation.error[worst]:
        raise ValueError(
            f'{where}: maxTime: the correlation at {times[worst]:g} ps is '
            f'{correlation.mean[worst]:.3g} +- {correlation.error[worst]:.2g}; a decay is seen '
            'only where it is above three times its error: give a shorter maxTime, or run longer')
    times, blocks, mean = times[chosen], correlation.blocks[:, chosen], correlation.mean[chosen]
    factor = 1/(correlation.order*(correlation.order + 1))

    def slopes(curve):
        """Of the range, and of its second half minus its first half."""
        whole = factor*_decay(times, curve, mean**2)
        if len(np.unique(times)) < 3:
            return whole, 0.0
        middle = np.unique(times)[len(np.unique(times)) // 2]
        early, late = times <= middle, times >= middle
        return whole, factor*(_decay(times[late], curve[late], mean[late]**2) -
                              _decay(times[early], curve[early], mean[early]**2))

    count = len(blocks)
    without = np.array([slopes((count*mean - block)/(count - 1)) for block in blocks])
    value, bend = slopes(mean)
    spread = ((without - without.mean(axis=0))**2).sum(axis=0)
    error, errorOfBend = np.sqrt((count - 1)/count*spread)
    doubts = _doubts(bend, errorOfBend, value, times, count)
    for doubt in doubts:
        warnings.warn(f'{where}: {doubt}', stacklevel=2)
    few = too_few_blocks(count - 1, count)
    if few:
        doubts += (f'{few}, or give more blocks; a bend of the decay can hide in so few',)
    return DiffusionCoefficient(_units.RATE.attach(value), _units.RATE.attach(error), count - 1,
                                doubts)


def _decay(times, curve, weights):
    """Minus the slope of a line through the logarithm of a curve."""
    if np.any(curve <= 0):
        return np.nan
    centre = weights @ times/weights.sum()
    return -(weights*(times - centre)) @ np.log(curve)/(weights @ (times - centre)**2)


def _doubts(bend, error, value, times, count):
    """The sentence about a decay that is no exponential beyond noise."""
    from scipy.special import stdtrit
    least = max(stdtrit(count - 1, 1 - LEAST_PROBABILITY/2)*error, 1e-9*abs(value))
    if not (abs(bend) > least and abs(bend) > LARGEST_CURVATURE*abs(value)):
        return ()
    return (
        f'between {times.min():g} and {times.max():g} ps the rate of decay changes by '
        f'{bend/value:+.0%} of the value, so that the decay is no single exponential: the body '
        'is in a field or at a wall, keeps its angular momentum, or is not symmetric about this '
        'direction; give a longer minTime or a shorter maxTime, or compare correlations',)
