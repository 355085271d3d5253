"""The arrangement of bodies: the pair distribution g(r) and the structure factor S(k)."""
from __future__ import annotations

import dataclasses
from typing import Optional

import numpy as np
from openmm import unit

from .. import _units
from .._types import Array, Number, Numbers
from .displacements import meanAndError

#: Blocks of frames, from whose spread errors come.
_BLOCKS = 10
#: Complex numbers that are in memory at a time.
_AT_A_TIME = 2**22


@dataclasses.dataclass
class PairDistribution:
    """The pair distribution of bodies.

    Attributes
    ----------
    edges : Quantity of shape (bins + 1,)
        edges of the bins of distance, nm
    distances : Quantity of shape (bins,)
        their middles, nm
    values : array of shape (bins,)
        g(r): number of pairs at this distance, divided by the number for bodies without
        interactions
    errors : array of shape (bins,)
        standard errors, from the spread of blocks of frames; NaN for a single frame
    """

    edges: unit.Quantity
    distances: unit.Quantity
    values: Array
    errors: Array


@dataclasses.dataclass
class StructureFactor:
    """The structure factor of bodies.

    Attributes
    ----------
    waveNumbers : Quantity of shape (bins,)
        mean wave number of the waves in each bin, 1/nm
    values : array of shape (bins,)
        S(k), averaged over the waves of a bin and over frames
    errors : array of shape (bins,)
        standard errors, from the spread of blocks of frames; NaN for a single frame
    numWaves : array of shape (bins,)
        number of waves in each bin, k and -k counted once
    """

    waveNumbers: unit.Quantity
    values: Array
    errors: Array
    numWaves: Array


def pairDistribution(positions: Numbers, box: Numbers, maxDistance: Optional[Number] = None,
                     numBins: int = 100, normalAxis: Optional[int] = None) -> PairDistribution:
    """Get the pair distribution g(r) of bodies in a periodic box.

    Parameters
    ----------
    positions : array-like or Quantity of shape (frames, bodies, 3) or (bodies, 3)
        origins of the bodies, nm, wrapped into the box or not
    box : float, or sequence or Quantity of shape (3,) or (3, 3)
        edge of a cube, three edges along x, y and z, or three box vectors in rows, nm
    maxDistance : float or Quantity, optional
        the largest distance, nm; None: half of the smallest width of the box
    numBins : int
        number of bins of distance, of equal width
    normalAxis : int, optional
        0, 1 or 2: distances in the plane across this axis, with the density per area, for a
        monolayer along a wall. None: distances in space.

    Returns
    -------
    PairDistribution

    Raises
    ------
    TypeError, ValueError
        for arrays of other shapes or dimensions, fewer than two bodies, an invalid box, or a
        distance beyond the smallest width of the box
    """
    from scipy.spatial import cKDTree
    where = 'pairDistribution'
    x, vectors = _frames(positions, where), _vectors(box, where)
    if x.shape[1] < 2:
        raise ValueError(f'{where}: positions: got {x.shape[1]} body; pairs need at least two')
    axes = _axes(normalAxis, vectors, where)
    vectors, x = vectors[np.ix_(axes, axes)], x[:, :, axes]
    widths = 1/np.linalg.norm(np.linalg.inv(vectors), axis=0)
    largest = widths.min()/2 if maxDistance is None else _units.number(
        maxDistance, _units.LENGTH, where, 'maxDistance')
    if not 0 < largest <= widths.min():
        raise ValueError(
            f'{where}: maxDistance: got {largest:g} nm; it must be above 0 and at most the '
            f'smallest width of the box, {widths.min():g} nm: give a distance in this range')
    numBins = _at_least_one(numBins, where, 'numBins')
    edges = np.linspace(0, largest, numBins + 1)
    dimensions = len(axes)
    shells = (4*np.pi/3 if dimensions == 3 else np.pi)*np.diff(edges**dimensions)
    n = x.shape[1]
    expected = shells*n*(n - 1)/abs(np.linalg.det(vectors))
    shifts = np.stack(np.meshgrid(*[(-1, 0, 1)]*dimensions, indexing='ij'),
                      axis=-1).reshape(-1, dimensions)
    reach = largest/widths
    rows = []
    for frame in x:
        inside = (frame @ np.linalg.inv(vectors)) % 1.0
        images = (inside + shifts[:, None]).reshape(-1, dimensions)
        images = images[np.all((images > -reach - 1e-9) & (images < 1 + reach + 1e-9), axis=1)]
        counts = cKDTree(inside @ vectors).count_neighbors(cKDTree(images @ vectors), edges)
        # Each body is its own neighbour at the distance 0, in the count of every edge.
        rows.append(np.diff(counts)/expected)
    values, errors = _over_blocks(np.array(rows))
    return PairDistribution(_units.LENGTH.attach(edges),
                            _units.LENGTH.attach((edges[1:] + edges[:-1])/2), values, errors)


def structureFactor(positions: Numbers, box: Numbers, maxWaveNumber: Number,
                    binWidth: Optional[Number] = None,
                    normalAxis: Optional[int] = None) -> StructureFactor:
    """Get the structure factor S(k) of bodies in a periodic box.

    It is the mean of ``|sum_i exp(i k r_i)|^2/n``, for the waves k that fit into the box. Its limit
    at small k is the compressibility of the suspension divided by that of an ideal suspension. A
    box shows it down to 2 pi divided by its longest edge.

    Parameters
    ----------
    positions : array-like or Quantity of shape (frames, bodies, 3) or (bodies, 3)
        origins of the bodies, nm, wrapped into the box or not
    box : float, or sequence or Quantity of shape (3,) or (3, 3)
        as in :func:`pairDistribution`
    maxWaveNumber : float or Quantity
        the largest wave number, 1/nm. The number of waves, and the time, grow as its cube.
    binWidth : float or Quantity, optional
        width of the bins of wave numbers, 1/nm; None: the smallest wave number of the box. Bins
        without waves are left out.
    normalAxis : int, optional
        0, 1 or 2: only waves in the plane across this axis, for a monolayer along a wall

    Returns
    -------
    StructureFactor

    Raises
    ------
    TypeError, ValueError
        for arrays of other shapes or dimensions, an invalid box, or a largest wave number below all
        waves of the box
    """
    where = 'structureFactor'
    x, vectors = _frames(positions, where), _vectors(box, where)
    axes = _axes(normalAxis, vectors, where)
    vectors, x = vectors[np.ix_(axes, axes)], x[:, :, axes]
    reciprocal = 2*np.pi*np.linalg.inv(vectors).T
    largest = _positive_wave_number(maxWaveNumber, where, 'maxWaveNumber')
    # |h_i| = |k . a_i|/(2 pi) is at most |k| |a_i|/(2 pi).
    most = np.floor(largest*np.linalg.norm(vectors, axis=1)/(2*np.pi)).astype(int)
    indices = np.stack(np.meshgrid(*[np.arange(-m, m + 1) for m in most], indexing='ij'),
                       axis=-1).reshape(-1, len(axes))
    # One of k and -k, whose amplitudes are conjugate.
    indices = indices[len(indices) // 2 + 1:]
    lengths = np.linalg.norm(indices @ reciprocal, axis=1)
    keep = lengths <= largest*(1 + 1e-12)
    indices, lengths = indices[keep], lengths[keep]
    smallest = np.linalg.norm(reciprocal, axis=1).min()
    if len(lengths) == 0:
        raise ValueError(f'{where}: maxWaveNumber: got {largest:g}/nm; the longest wave of this '
                         f'box has {smallest:g}/nm: give a larger wave number')
    width = smallest if binWidth is None else _positive_wave_number(binWidth, where, 'binWidth')
    # Waves at an edge, to rounding, belong to one bin.
    bins = np.floor(lengths/width + 0.5 + 1e-9).astype(int)
    used, bins, numWaves = np.unique(bins, return_inverse=True, return_counts=True)
    waves = indices @ reciprocal
    rows = []
    chunk = max(1, _AT_A_TIME // x.shape[1])
    for frame in x:
        powers = np.concatenate([
            np.abs(np.exp(1j*(waves[k:k + chunk] @ frame.T)).sum(axis=1))**2
            for k in range(0, len(waves), chunk)
        ])/x.shape[1]
        rows.append(np.bincount(bins, powers)/numWaves)
    values, errors = _over_blocks(np.array(rows))
    return StructureFactor(unit.Quantity(np.bincount(bins, lengths)/numWaves, unit.nanometer**-1),
                           values, errors, numWaves)


def _frames(positions, where):
    """Positions as (frames, bodies, 3), nm."""
    array = _units.array_of(positions, _units.LENGTH, where, 'positions')
    return _units.frames(array[None] if array.ndim == 2 else array, _units.LENGTH, 3, where,
                         'positions')


def _vectors(box, where):
    """Box vectors in rows, nm."""
    array = _units.array_of(box, _units.LENGTH, where, 'box')
    vectors = array*np.eye(3) if array.shape in ((), (3,)) else array
    if vectors.shape != (3, 3) or not np.all(np.isfinite(vectors)) or not (
            np.linalg.det(vectors) > 1e-12*np.prod(np.linalg.norm(vectors, axis=1))):
        raise ValueError(
            f'{where}: box: got {np.asarray(array).tolist()} nm; it must be the edge of a cube, '
            'three edges, or three box vectors in rows that span a volume')
    return vectors


def _axes(normalAxis, vectors, where):
    """The axes that count."""
    if normalAxis is None:
        return [0, 1, 2]
    normalAxis = _units.integer(normalAxis, where, 'normalAxis')
    if normalAxis not in (0, 1, 2):
        raise ValueError(f'{where}: normalAxis: got {normalAxis}; the axis across the layer must '
                         'be 0, 1 or 2: give one of them, or None for distances in space')
    axes = [axis for axis in range(3) if axis != normalAxis]
    if vectors[axes, normalAxis].any() or vectors[normalAxis, axes].any():
        raise ValueError(f'{where}: box: its vector along axis {normalAxis} is not at right angles '
                         'to the others; a layer needs this: give a box of edges')
    return axes


def _at_least_one(value, where, name):
    value = _units.integer(value, where, name)
    if value < 1:
        raise ValueError(f'{where}: {name}: got {value} bins; at least one is needed')
    return value


def _positive_wave_number(value, where, name):
    value = _units.number(value, _units.WAVE_NUMBER, where, name)
    if not 0 < value < np.inf:
        raise ValueError(f'{where}: {name}: got {value}/nm; a wave number must be finite and '
                         'positive')
    return value


def _over_blocks(rows):
    """Mean over frames, and its standard error from the spread of blocks of frames."""
    if len(rows) < 2:
        return rows[0], np.full(rows.shape[1], np.nan)
    blocks = np.array([each.mean(axis=0) for each in np.array_split(rows, min(_BLOCKS, len(rows)))])
    return rows.mean(axis=0), meanAndError(blocks)[1]
