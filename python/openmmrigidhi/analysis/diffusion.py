"""Diffusion coefficients from mean square displacements, and the length that gravity sets."""
from __future__ import annotations

import dataclasses
from typing import Optional

import numpy as np
from openmm import unit

from .. import _units
from .._types import Number
from .displacements import MeanSquareDisplacement, _without_unit, meanAndError


@dataclasses.dataclass
class DiffusionCoefficient:
    """A diffusion coefficient or tensor, half the slope of a mean square displacement.

    Attributes
    ----------
    value : Quantity
        nm^2/ps, or 1/ps for rotations; of shape (3, 3) for a tensor
    error : Quantity
        its standard error, from the spread of the blocks
    degrees : int
        degrees of freedom of that standard error: number of blocks less 1
    """

    value: unit.Quantity
    error: unit.Quantity
    degrees: int


def shortTimeDiffusion(msd: MeanSquareDisplacement,
                       maxTime: Optional[Number] = None) -> DiffusionCoefficient:
    """Get the short-time diffusion coefficient (eq. 59).

    It is half the slope of a mean square displacement at zero lag time.

    Parameters
    ----------
    msd : MeanSquareDisplacement
        with some lag times above 0
    maxTime : float or Quantity, optional
        MSD/(2 lag time) is fitted by a straight line in the lag time up to this lag time, ps, and
        extrapolated to 0. None: its value at the smallest lag time is returned, which has an error
        from the curvature up to there.

    Returns
    -------
    DiffusionCoefficient
        a coefficient for each component; the trace of a tensor over d dimensions is d times the
        mean coefficient

    Raises
    ------
    TypeError
        if msd is no MeanSquareDisplacement
    ValueError
        if there are no lag times above 0, or fewer than two up to maxTime
    """
    times = _lag_times(msd, 'shortTimeDiffusion')
    if not np.any(times > 0):
        raise ValueError(
            'shortTimeDiffusion: msd: it has no lag times above 0; the slope needs one: give other '
            'lags')
    weights = np.zeros(len(times))
    if maxTime is None:
        first = np.argmin(np.where(times > 0, times, np.inf))
        weights[first] = 1/(2*times[first])
        return _estimate(msd, weights)
    maxTime = _units.number(maxTime, _units.TIME, 'shortTimeDiffusion', 'maxTime')
    chosen = (times > 0) & (times <= maxTime*(1 + 1e-12))
    if len(np.unique(times[chosen])) < 2:
        raise ValueError(
            f'shortTimeDiffusion: maxTime: got {maxTime} ps; extrapolation needs two lag times '
            'above 0 up to there: give a longer time, or smaller lags')
    # The row of the pseudo-inverse that gives the line's value at 0.
    line = np.stack([np.ones(chosen.sum()), times[chosen]], axis=1)
    weights[chosen] = np.linalg.pinv(line)[0]/(2*times[chosen])
    return _estimate(msd, weights)


def longTimeDiffusion(msd: MeanSquareDisplacement, minTime: Number,
                      maxTime: Optional[Number] = None) -> DiffusionCoefficient:
    """Get the long-time diffusion coefficient (eq. 60).

    It is half the slope of a mean square displacement at long lag times. The slope is that of the
    least-squares straight line, with the same weight for all lag times. For motion along a wall
    take half of the result for ``msd.parallel``. For motion in space take a third of the result for
    ``msd.trace``.

    Parameters
    ----------
    msd : MeanSquareDisplacement
        with at least two lag times in the range
    minTime : float or Quantity
        the shortest lag time that is used, ps; longer than the time in which the body loses its
        orientation
    maxTime : float or Quantity, optional
        the longest lag time that is used, ps; None: all lag times from minTime on

    Returns
    -------
    DiffusionCoefficient
        a coefficient for each component

    Raises
    ------
    TypeError
        if msd is no MeanSquareDisplacement
    ValueError
        if there are fewer than two lag times in the range
    """
    times = _lag_times(msd, 'longTimeDiffusion')
    minTime = _units.number(minTime, _units.TIME, 'longTimeDiffusion', 'minTime')
    maxTime = np.inf if maxTime is None else _units.number(maxTime, _units.TIME,
                                                           'longTimeDiffusion', 'maxTime')
    chosen = (times >= minTime*(1 - 1e-12)) & (times <= maxTime*(1 + 1e-12))
    if len(np.unique(times[chosen])) < 2:
        raise ValueError(
            f'longTimeDiffusion: minTime, maxTime: got {minTime} and {maxTime} ps; a slope needs '
            f'two lag times in that range, and they end at {times.max() if len(times) else 0:g} '
            'ps: widen it, or give more lags')
    weights = np.zeros(len(times))
    centred = times[chosen] - times[chosen].mean()
    weights[chosen] = centred/(2*(centred @ centred))
    return _estimate(msd, weights)


def gravitationalHeight(kT: Number, weight: Number) -> unit.Quantity:
    """Get the gravitational height kT/weight.

    The density of sedimenting particles falls by a factor e over this height. Eq. (70) defines a
    height for any body, from the plateau of its perpendicular mean square displacement. It is the
    standard deviation of the body's height at equilibrium. Far above the wall's repulsion both
    heights are equal.

    Parameters
    ----------
    kT : float or Quantity
        thermal energy, kJ/mol
    weight : float or Quantity
        weight less buoyancy, kJ/(mol nm)

    Returns
    -------
    Quantity
        nm

    Raises
    ------
    ValueError
        if kT or weight is not finite and positive
    """
    kT = _units.number(kT, _units.ENERGY, 'gravitationalHeight', 'kT')
    weight = _units.number(weight, _units.FORCE, 'gravitationalHeight', 'weight')
    if not (0 < kT < np.inf and 0 < weight < np.inf):
        raise ValueError(
            f'gravitationalHeight: got kT = {kT} kJ/mol and weight = {weight} kJ/(mol nm); both '
            'must be finite and positive: give the size of a downward force')
    return _units.LENGTH.attach(kT/weight)


def _lag_times(msd, where):
    if not isinstance(msd, MeanSquareDisplacement):
        raise TypeError(
            f'{where}: msd: got {type(msd).__name__}; it must be a MeanSquareDisplacement: give '
            'what the MSD functions return')
    return msd.lagTimes.value_in_unit(unit.picosecond)


def _estimate(msd, weights):
    """The estimate that is linear in the mean square displacement of the lag times.

    Weights are in 1/ps.
    """
    blocks, _ = _without_unit(msd.blocks)
    value, error = meanAndError(np.tensordot(blocks, weights, axes=(1, 0)))
    diffusionUnit = (msd.blocks.unit
                     if unit.is_quantity(msd.blocks) else unit.dimensionless)/unit.picosecond
    return DiffusionCoefficient(unit.Quantity(value, diffusionUnit),
                                unit.Quantity(error, diffusionUnit),
                                len(blocks) - 1)
