"""Diffusion coefficients from mean square displacements, and the gravitational height."""
from __future__ import annotations

import dataclasses
import warnings
from typing import Optional, Sequence

import numpy as np
from openmm import unit

from .. import _units
from .._types import Array, Number, Numbers
from ._sampling import too_few_blocks
from .displacements import MeanSquareDisplacement, _without_unit, meanAndError

#: A mean square displacement is doubted if its curvature changes a coefficient by more than this
#: ratio, and if noise makes such a curvature in one case of ten thousand only.
LARGEST_CURVATURE, LEAST_PROBABILITY = 0.1, 1e-4
#: Or if in each block it makes this part of itself and the coefficient: a third of the coefficient.
LEAST_GROWTH = 0.25


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
        degrees of freedom of this standard error: number of blocks minus 1
    doubts : tuple of str
        reasons not to take the value for a diffusion coefficient, or not to trust its error. A bend
        of the displacements was also a warning; fewer than 10 blocks stand here alone.
    """

    value: unit.Quantity
    error: unit.Quantity
    degrees: int
    doubts: tuple = ()

    @property
    def isTrusted(self) -> bool:
        """Whether nothing speaks against the value; doubts has the reasons."""
        return not self.doubts


@dataclasses.dataclass
class InfiniteBoxDiffusion:
    """A diffusion coefficient extrapolated from cubic boxes of several sizes.

    Attributes
    ----------
    value : Quantity
        the coefficient in an infinite box, nm^2/ps
    error : Quantity
        its standard error, from the errors of the coefficients
    viscosity : Quantity
        the viscosity that belongs to the slope against 1/L, dalton/(nm ps)
    viscosityError : Quantity
        its standard error, dalton/(nm ps)
    doubts : tuple of str
        reasons not to trust the line through the coefficients: a coefficient in doubt, a slope that
        is not beyond twice its error, and boxes that lie on no line beyond noise (probability
        0.0001). The last is also a warning.
    """

    value: unit.Quantity
    error: unit.Quantity
    viscosity: unit.Quantity
    viscosityError: unit.Quantity
    doubts: tuple = ()

    @property
    def isTrusted(self) -> bool:
        """Whether nothing speaks against the line; doubts has the reasons."""
        return not self.doubts


def shortTimeDiffusion(msd: MeanSquareDisplacement,
                       maxTime: Optional[Number] = None) -> DiffusionCoefficient:
    r"""Get the short-time diffusion coefficient (eq. 59).

    It is half the slope of a mean square displacement at zero lag time. A warning says if the
    displacements bend so much at the lag times used that the value is more than 10 % off, as those
    of bodies with momenta do within their relaxation time.

    Parameters
    ----------
    msd : MeanSquareDisplacement
        with some lag times above 0
    maxTime : float or Quantity, optional
        fit a straight line in the lag time t to :math:`\mathrm{MSD}/(2 t)` up to this lag time, ps,
        and extrapolate to 0. None: return the value at the smallest lag time, which has an error
        from the curvature up to there.

    Returns
    -------
    DiffusionCoefficient
        a coefficient for each component of a tensor; for ``msd.isotropic`` and ``msd.lateral`` the
        mean coefficient; for ``msd.trace`` and ``msd.parallel`` three and two times the mean

    Raises
    ------
    TypeError
        if msd is no MeanSquareDisplacement
    ValueError
        if msd has no lag times above 0, or fewer than two up to maxTime
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
        return _estimate(msd, weights, _bend_at_the_first_lag(times))
    maxTime = _units.number(maxTime, _units.TIME, 'shortTimeDiffusion', 'maxTime')
    chosen = (times > 0) & (times <= maxTime*(1 + 1e-12))
    if len(np.unique(times[chosen])) < 2:
        raise ValueError(
            f'shortTimeDiffusion: maxTime: got {maxTime} ps; extrapolation needs two lag times '
            'above 0 up to there: give a longer time, or smaller lags')
    weights[chosen] = _value_at_zero(times[chosen], 1)
    bend = None
    if len(np.unique(times[chosen])) > 2:
        bend = np.zeros(len(times))
        bend[chosen] = _value_at_zero(times[chosen], 2) - weights[chosen]
    remedy = ('give a shorter maxTime, or smaller lags; of bodies that still have their momenta '
              'take longTimeDiffusion')
    return _estimate(
        msd, weights,
        _Curvature(
            'shortTimeDiffusion', bend,
            f'a parabola through MSD/(2 lag time) up to {times[chosen].max():g} ps has another '
            'value at 0 than the line, by {change:+.0%}', remedy, remedy))


def longTimeDiffusion(msd: MeanSquareDisplacement, minTime: Number,
                      maxTime: Optional[Number] = None) -> DiffusionCoefficient:
    """Get the long-time diffusion coefficient (eq. 60).

    It is half the slope of a mean square displacement at long lag times. The slope comes from a
    least-squares straight line, with the same weight for all lag times. Take ``msd.isotropic`` for
    motion in space and ``msd.lateral`` for motion along a wall: these are means over three and two
    axes, so the result is the diffusion coefficient itself. A warning says if the displacements are
    no straight line in this range: those of bound bodies level off, and those of bodies that drift,
    swim or still have their momenta grow faster. Two lag times alone show no bend. Rotational
    displacements level off, too: for rotation take :func:`rotationalDiffusion`.

    Parameters
    ----------
    msd : MeanSquareDisplacement
        with at least two lag times in the range
    minTime : float or Quantity
        the shortest lag time in the fit, ps; longer than the time in which the body loses its
        orientation
    maxTime : float or Quantity, optional
        the longest lag time in the fit, ps; None: all lag times from minTime on

    Returns
    -------
    DiffusionCoefficient
        a coefficient for each component

    Raises
    ------
    TypeError
        if msd is no MeanSquareDisplacement
    ValueError
        if the range contains fewer than two lag times
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
    return _estimate(msd, _half_slope(times, chosen), _bend_of_the_line(times, chosen),
                     _near_the_limit(msd, times, chosen))


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
        weight minus buoyancy, kJ/(mol nm)

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


#: The sum over images of a cubic lattice in Hasimoto (1959); Yeh and Hummer (2004), eq. (8).
_CUBIC_LATTICE = 2.837297


def finiteSizeCorrection(temperature: Number, viscosity: Number, box: Numbers,
                         radius: Optional[Number] = None,
                         structureFactor: float = 1) -> unit.Quantity:
    r"""Get the reduction of a diffusion coefficient by a periodic box: add it to the measured one.

    This correction for the finite size of the box is :math:`kT \xi/(6 \pi \eta L)`, with
    :math:`\xi = 2.837297` in a cube of edge L (Yeh and Hummer, J. Phys. Chem. B 108, 15873 (2004),
    eq. 8). The viscosity :math:`\eta` depends on the diffusing particle:

    - a molecule, or one colloid in its box: the viscosity of the fluid. For molecules of a liquid
      without a MobilityForce take the viscosity of the model, not of the experiment; if it is
      unknown, run in two boxes and take infiniteBoxDiffusion().
    - one of many spheres, at short times: the viscosity of the *suspension* at high frequencies,
      from getStressInContext() in uniform shear. The correction is then
      :math:`1.76 (\phi/n)^{1/3} \eta_\mathrm{fluid}/\eta` times
      :math:`kT/(6 \pi \eta_\mathrm{fluid} a)`, as in Ladd (1990) and Mo and Sangani (1994).
    - at long times: the viscosity of the suspension in steady shear.

    The box slows spheres that sediment together by this correction times S(0): give
    structureFactor.

    Parameters
    ----------
    temperature : float or Quantity
        K
    viscosity : float or Quantity
        dalton/(nm ps), or a quantity in any unit of viscosity
    box : float, or sequence or Quantity of shape (3,) or (3, 3)
        edge of a cube, nm; three equal edges and the vectors of a cube are also accepted
    radius : float or Quantity, optional
        nm; radius of a single sphere in the box, for the next term of the sum over images,
        :math:`1 - (4 \pi/3) (a/L)^2/\xi` times the first term, with this radius a
    structureFactor : float
        S(0) of the suspension, for sedimentation; 1 for diffusion

    Returns
    -------
    Quantity
        nm^2/ps

    Raises
    ------
    TypeError
        for arguments of another kind or dimension
    ValueError
        for numbers that are not finite and positive, and for a box that is no cube

    Examples
    --------
    >>> from openmm import unit
    >>> from openmmrigidhi import analysis
    >>> water = 0.89e-3*unit.pascal*unit.second
    >>> correction = analysis.finiteSizeCorrection(298.15*unit.kelvin, water, 10*unit.nanometer)
    >>> round(correction/(unit.nanometer**2/unit.nanosecond), 5)
    0.06962
    """
    where = 'finiteSizeCorrection'
    kT = _units.GAS_CONSTANT*_positive(temperature, _units.TEMPERATURE, where, 'temperature')
    viscosity = _check_positive(_units.viscosity(viscosity, where, 'viscosity'), where, 'viscosity')
    structureFactor = _positive(structureFactor, _units.NONE, where, 'structureFactor')
    edge = _edge_of_cube(box, where, 'box')
    images = _CUBIC_LATTICE
    if radius is not None:
        images -= 4*np.pi/3*(_positive(radius, _units.LENGTH, where, 'radius')/edge)**2
    return unit.Quantity(kT*images*structureFactor/(6*np.pi*viscosity*edge),
                         unit.nanometer**2/unit.picosecond)


def infiniteBoxDiffusion(coefficients: Sequence[DiffusionCoefficient], boxes: Sequence[Numbers],
                         temperature: Number) -> InfiniteBoxDiffusion:
    r"""Extrapolate diffusion coefficients of several cubic boxes to an infinite box.

    A cubic box of edge L reduces the coefficient of a molecule by :math:`kT \xi/(6 \pi \eta L)`
    with :math:`\xi = 2.837297` (Yeh and Hummer, J. Phys. Chem. B 108, 15873 (2004), eq. 8). A
    straight line in 1/L thus gives the coefficient without this reduction, and the viscosity
    :math:`\eta` of the model from its slope. No viscosity need be known before, unlike for
    finiteSizeCorrection(). Each coefficient has the weight of its standard error.

    Run at least two boxes of the same composition and density whose edges differ by half or more.

    Parameters
    ----------
    coefficients : sequence of DiffusionCoefficient
        one for each box, each a single number of nm^2/ps with an error above 0: from
        ``msd.isotropic``
    boxes : sequence
        the box of each coefficient, as for finiteSizeCorrection(): an edge in nm, or vectors of a
        cube
    temperature : float or Quantity
        K

    Returns
    -------
    InfiniteBoxDiffusion
        the coefficient, the viscosity, and their errors

    Raises
    ------
    TypeError
        for arguments of another kind or dimension
    ValueError
        for fewer than two different edges, another number of boxes, a box that is no cube,
        coefficients without an error, and numbers that are not finite and positive
    """
    where = 'infiniteBoxDiffusion'
    kT = _units.GAS_CONSTANT*_positive(temperature, _units.TEMPERATURE, where, 'temperature')
    for k, each in enumerate(coefficients):
        if not isinstance(each, DiffusionCoefficient):
            raise TypeError(
                f'{where}: coefficients: number {k} is a {type(each).__name__}; it must '
                'be a DiffusionCoefficient: give what longTimeDiffusion() returns')
    edges = np.array([_edge_of_cube(box, where, 'boxes') for box in boxes])
    if len(edges) != len(coefficients) or len(np.unique(edges)) < 2:
        raise ValueError(
            f'{where}: boxes: got {len(coefficients)} coefficients and the edges {edges.tolist()} '
            'nm; a line needs a box for each coefficient, and two different edges at least: run in '
            'another box too')
    squareNm = unit.nanometer**2/unit.picosecond
    values, errors = (np.array([getattr(each, which)/squareNm
                                for each in coefficients], dtype=float)
                      for which in ('value', 'error'))
    if values.ndim != 1 or not np.all(np.isfinite(values) & (errors > 0) & np.isfinite(errors)):
        raise ValueError(
            f'{where}: coefficients: got the values {values.tolist()} and the errors '
            f'{errors.tolist()} nm^2/ps; each must be a single finite number with an error above '
            '0: take msd.isotropic and at least two blocks')
    design = np.stack([np.ones(len(edges)), 1/edges], axis=1)/errors[:, None]
    covariance = np.linalg.inv(design.T @ design)
    line = covariance @ design.T @ (values/errors)
    slope, slopeError = -line[1], np.sqrt(covariance[1, 1])
    doubts = [
        f'the coefficient of the box of {edge:g} nm: {doubt}'
        for each, edge in zip(coefficients, edges) for doubt in each.doubts
    ]
    if slope < 2*slopeError:
        doubts.append(
            f'the coefficients fall by {slope:.3g} +- {slopeError:.1g} nm^3/ps a 1/L, and only '
            'twice this error would show a viscosity: run longer, or in boxes that differ more')
    bent = _far_from_the_line(values - np.stack([np.ones(len(edges)), 1/edges]).T @ line, errors)
    if bent:
        doubts.append(bent)
        warnings.warn(f'{where}: {bent}', stacklevel=2)
    viscosity = kT*_CUBIC_LATTICE/(6*np.pi*slope)
    return InfiniteBoxDiffusion(unit.Quantity(float(line[0]), squareNm),
                                unit.Quantity(float(np.sqrt(covariance[0, 0])), squareNm),
                                _units.VISCOSITY.attach(float(viscosity)),
                                _units.VISCOSITY.attach(float(abs(viscosity/slope)*slopeError)),
                                tuple(doubts))


def _far_from_the_line(residuals, errors):
    """The sentence about boxes that lie on no line beyond noise, or None."""
    if len(residuals) < 3:
        return None
    from scipy.special import chdtrc
    probability = chdtrc(len(residuals) - 2, np.sum((residuals/errors)**2))
    if probability >= LEAST_PROBABILITY:
        return None
    return (f'the coefficients lie on no line in 1/L (probability {probability:.1g}), the worst '
            f'{np.max(np.abs(residuals/errors)):.1f} standard errors off: leave out the smallest '
            'box, and see that all have one density and errors of enough blocks')


def _positive(value, dimension, where, name):
    """A number that must be finite and positive."""
    result = _units.number(value, dimension, where, name)
    return _check_positive(result, where, name)


def _check_positive(value, where, name):
    if not 0 < value < np.inf:
        raise ValueError(f'{where}: {name}: got {value}; this number must be finite and positive')
    return value


def _edge_of_cube(box, where, name):
    """The edge of a cubic box, nm."""
    edges = _units.array_of(box, _units.LENGTH, where, name)
    if edges.ndim > 2:
        raise ValueError(f'{where}: {name}: got the boxes of {len(edges)} frames; it must be one '
                         'cube: give the cube of their mean volume')
    vectors = edges if edges.shape == (3, 3) else edges*np.eye(3)
    edge = vectors.flat[0]
    if vectors.shape != (3, 3) or not 0 < edge < np.inf or not np.allclose(
            vectors, edge*np.eye(3), rtol=0, atol=1e-6*edge):
        raise ValueError(
            f'{where}: {name}: got {edges.tolist()} nm; the sum over images is that of a cube of '
            'one positive edge: run in cubes')
    return edge


def _lag_times(msd, where):
    if not isinstance(msd, MeanSquareDisplacement):
        raise TypeError(
            f'{where}: msd: got {type(msd).__name__}; it must be a MeanSquareDisplacement: give '
            'what the MSD functions return')
    return msd.lagTimes.value_in_unit(unit.picosecond)


def _half_slope(times, chosen):
    """Weights of the mean square displacements in half the slope of their line, 1/ps."""
    weights = np.zeros(len(times))
    centred = times[chosen] - times[chosen].mean()
    weights[chosen] = centred/(2*(centred @ centred))
    return weights


def _value_at_zero(times, order):
    """Weights of the mean square displacements in the value at 0 of a polynomial through MSD/(2 lag
    time), 1/ps."""
    return np.linalg.pinv(np.vander(times, order + 1, increasing=True))[0]/(2*times)


@dataclasses.dataclass
class _Curvature:
    """A change of the estimate that shows whether the displacements bend, and what to say then.

    weights are as in _estimate(), or None where there are too few lag times.
    """

    where: str
    weights: Optional[Array]
    finding: str
    ifLower: str
    ifHigher: str
    growsInAllBlocks: bool = False

    def doubts(self, blocks, values):
        """The sentence about a curvature that is large and beyond noise.

        blocks are the mean square displacements of the blocks, and values their estimates.
        """
        if self.weights is None:
            return ()
        from scipy.special import stdtrit
        change = _diagonal(np.tensordot(blocks, self.weights, axes=(1, 0)))
        mean, error = meanAndError(change)
        scale = np.abs(_diagonal(values.mean(axis=0)[None])[0])
        # Blocks that are equal, of motion without noise, differ by rounding.
        inErrors = stdtrit(len(change) - 1, 1 - LEAST_PROBABILITY/2)
        certain = np.abs(mean) > np.maximum(inErrors*error, 1e-9*scale)
        if self.growsInAllBlocks:
            # Flows move the bodies of each block by very different amounts. Noise of long lag times
            # is in numerator and denominator, so that without a bend the mean is 0 or below.
            own = change/(np.abs(change) + np.abs(_diagonal(values)) + np.finfo(float).tiny)
            mean_own, error_own = meanAndError(own)
            certain |= (mean > 0) & (mean_own > np.maximum(1.5*inErrors*error_own, LEAST_GROWTH))
        large = np.abs(mean) > LARGEST_CURVATURE*scale
        bent = np.flatnonzero(certain & large & (scale > 0))
        if len(bent) == 0:
            return ()
        ratios = (mean/np.where(scale > 0, scale, 1))[bent]
        worst = np.argmax(np.abs(ratios))
        which = f'component {"xyz"[bent[worst]]*2}: ' if len(scale) == 3 else ''
        remedy = self.ifLower if ratios[worst] < 0 else self.ifHigher
        return (f'{which}{self.finding.format(change=ratios[worst])}: {remedy}',)


def _diagonal(values):
    """The diagonal of a tensor for each block, or the number of each block in a row."""
    return np.einsum('bii->bi', values) if values.ndim == 3 else values[:, None]


def _bend_at_the_first_lag(times):
    """The error of MSD/(2 lag time) at the smallest lag time, by a line through the first two."""
    positive = np.unique(times[times > 0])
    weights = None
    if len(positive) > 1:
        first, second = positive[:2]
        weights = np.zeros(len(times))
        slope = first/(second - first)
        weights[np.argmax(times == first)] = slope/(2*first)
        weights[np.argmax(times == second)] = -slope/(2*second)
    return _Curvature(
        'shortTimeDiffusion', weights,
        'MSD/(2 lag time) still changes at the smallest lag time, and the slope at 0 may differ by '
        '{change:+.0%}',
        'bodies keep their momenta for longer than this lag time, or drift: take longTimeDiffusion '
        'from the time on in which momenta are forgotten, or subtract the drift',
        'give maxTime, for an extrapolation to 0, or smaller lags')


def _bend_of_the_line(times, chosen):
    """The difference of half the slopes at the long and the short lag times of the range."""
    inRange = np.unique(times[chosen])
    middle = inRange[len(inRange) // 2]
    weights = None
    if len(inRange) > 2:
        early, late = chosen & (times <= middle), chosen & (times >= middle)
        weights = _half_slope(times, late) - _half_slope(times, early)
    return _Curvature(
        'longTimeDiffusion', weights,
        f'from the lag times of {inRange[0]:g} to {middle:g} ps to those of {middle:g} to '
        f'{inRange[-1]:g} ps half the slope of the mean square displacement changes by '
        '{change:+.0%} of the value',
        'the displacements level off: give a longer minTime; those of bodies that are bound or '
        'enclosed have no slope in the end',
        'the displacements grow faster than the lag time: give a minTime longer than the time in '
        'which momenta and orientations are forgotten, and subtract a drift or a flow '
        '(nonAffinePositions())', growsInAllBlocks=True)


def _near_the_limit(msd, times, chosen):
    """The sentence about displacements that can grow no further."""
    if not msd.limit:
        return ()
    part = np.abs(_diagonal(np.asarray(msd.mean))/msd.limit)
    part = np.where(chosen[:, None], part, 0)
    if part.max() <= LARGEST_CURVATURE:
        return ()
    return (f'the displacements at {times[np.argmax(part.max(axis=1))]:g} ps are {part.max():.0%} '
            f'of the {msd.limit:.3g} that those of free rotation tend to, so that their slope is '
            'too small, and none in the end: take rotationalDiffusion() of '
            'orientationCorrelation(), or shorter lag times',)


def _estimate(msd, weights, curvature, doubts=()):
    """The estimate, linear in the mean square displacement of the lag times.

    Weights are in 1/ps. The doubts are those found before.
    """
    blocks, _ = _without_unit(msd.blocks)
    values = np.tensordot(blocks, weights, axes=(1, 0))
    value, error = meanAndError(values)
    doubts = doubts or curvature.doubts(blocks, values)
    for doubt in doubts:
        warnings.warn(f'{curvature.where}: {doubt}', stacklevel=3)
    few = too_few_blocks(len(blocks) - 1, len(blocks))
    if few:
        doubts += (f'{few}, or give more blocks; a bend of the displacements can hide in so few',)
    diffusionUnit = (msd.blocks.unit
                     if unit.is_quantity(msd.blocks) else unit.dimensionless)/unit.picosecond
    return DiffusionCoefficient(unit.Quantity(value, diffusionUnit),
                                unit.Quantity(error, diffusionUnit),
                                len(blocks) - 1, doubts)
