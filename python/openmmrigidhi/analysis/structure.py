"""The arrangement of bodies: the pair distribution g(r) and the structure factor S(k)."""
from __future__ import annotations

import dataclasses
from typing import Optional, Sequence

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
    """The pair distribution of bodies or atoms.

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
                     numBins: int = 100, normalAxis: Optional[int] = None,
                     others: Optional[Numbers] = None, molecules: Optional[Sequence[int]] = None,
                     otherMolecules: Optional[Sequence[int]] = None) -> PairDistribution:
    """Get the pair distribution g(r) of bodies, or of atoms of one or two kinds, in a periodic box.

    Parameters
    ----------
    positions : array-like or Quantity of shape (frames, bodies, 3) or (bodies, 3)
        origins of the bodies, or atoms, nm, wrapped into the box or not
    box : float, or sequence or Quantity of shape (3,), (3, 3) or (frames, 3, 3)
        edge of a cube, three edges along x, y and z, three box vectors in rows, or these vectors
        for each frame, as a barostat changes them, nm
    maxDistance : float or Quantity, optional
        the largest distance, nm; None: half of the smallest width of the box
    numBins : int
        number of bins of distance, of equal width
    normalAxis : int, optional
        0, 1 or 2: distances in the plane across this axis, with the density per area, for a
        monolayer along a wall. None: distances in space.
    others : array-like or Quantity of shape (frames, others, 3) or (others, 3), optional
        the second kind of atoms, nm: g(r) of pairs of one of positions and one of others. None:
        pairs among positions.
    molecules : sequence of int, optional
        the molecule or body of each of positions: pairs within one do not count. None: each is a
        molecule of its own.
    otherMolecules : sequence of int, optional
        the same for others, with the same numbers of molecules

    Returns
    -------
    PairDistribution
        1 for pairs without interactions, in all these cases

    Raises
    ------
    TypeError, ValueError
        for arrays of other shapes or dimensions, no pairs, an invalid box, or a distance beyond the
        smallest width of the box

    Examples
    --------
    Carbon and oxygen of different molecules of a rigid CO2, from the atoms of a trajectory:

    >>> import numpy as np
    >>> from openmmrigidhi import analysis
    >>> atoms = np.random.default_rng(1).random((5, 300, 3))*3  # frames of C, O, O, C, O, O, ...
    >>> molecule = np.arange(300) // 3
    >>> isCarbon = np.arange(300) % 3 == 0
    >>> g = analysis.pairDistribution(atoms[:, isCarbon], 3.0, others=atoms[:, ~isCarbon],
    ...                               molecules=molecule[isCarbon],
    ...                               otherMolecules=molecule[~isCarbon])
    >>> bool(abs(g.values[-1] - 1) < 0.2)
    True
    """
    from scipy.spatial import cKDTree
    where = 'pairDistribution'
    x = _frames(positions, where, 'positions')
    y = x if others is None else _frames(others, where, 'others')
    if len(y) != len(x):
        raise ValueError(f'{where}: others: got {len(y)} frames, and positions has {len(x)}; both '
                         'must have the same')
    vectors = _vectors_of_frames(box, len(x), where)
    axes = _axes(normalAxis, vectors, where)
    vectors, x, y = vectors[:, axes][:, :, axes], x[:, :, axes], y[:, :, axes]
    within = _pairs_within(x, y, others is None, molecules, otherMolecules, where)
    pairs = x.shape[1]*y.shape[1] - len(within[0])
    if pairs < 1:
        raise ValueError(
            f'{where}: positions: got {x.shape[1]} without a pair; pairs need at least '
            'two bodies, or atoms of different molecules')
    inverses = np.linalg.inv(vectors)
    widths = 1/np.linalg.norm(inverses, axis=1)
    smallest = widths.min()
    largest = smallest/2 if maxDistance is None else _units.number(maxDistance, _units.LENGTH,
                                                                   where, 'maxDistance')
    if not 0 < largest <= smallest:
        raise ValueError(
            f'{where}: maxDistance: got {largest:g} nm; it must be above 0 and at most the '
            f'smallest width of the box, {smallest:g} nm: give a distance in this range')
    numBins = _at_least_one(numBins, where, 'numBins')
    edges = np.linspace(0, largest, numBins + 1)
    dimensions = len(axes)
    shells = (4*np.pi/3 if dimensions == 3 else np.pi)*np.diff(edges**dimensions)
    shifts = np.stack(np.meshgrid(*[(-1, 0, 1)]*dimensions, indexing='ij'),
                      axis=-1).reshape(-1, dimensions)
    rows = []
    for a, b, cell, inverse, width in zip(x, y, vectors, inverses, widths):
        reach = largest/width
        a, b = (a @ inverse) % 1.0, (b @ inverse) % 1.0
        images = (b + shifts[:, None]).reshape(-1, dimensions)
        images = images[np.all((images > -reach - 1e-9) & (images < 1 + reach + 1e-9), axis=1)]
        # Only the nearest image of an atom is in the molecule.
        nearest = np.sort(_distances_within(a, b, within, cell, shifts))
        between = _edges_between(edges, nearest)
        counts = cKDTree(a @ cell).count_neighbors(cKDTree(images @ cell), between)
        counts = counts - np.searchsorted(nearest, between, side='right')
        rows.append(np.diff(counts)*abs(np.linalg.det(cell))/(shells*pairs))
    values, errors = _over_blocks(np.array(rows))
    return PairDistribution(_units.LENGTH.attach(edges),
                            _units.LENGTH.attach((edges[1:] + edges[:-1])/2), values, errors)


def _distances_within(a, b, within, cell, shifts):
    """Distances of pairs in one molecule; a and b are in units of the box vectors."""
    distances = np.zeros(len(within[0]))
    if within[0] is within[1]:
        return distances  # each with itself
    if np.array_equal(cell, np.diag(np.diag(cell))):
        shifts = np.zeros((1, len(cell)))
    chunk = _AT_A_TIME // (8*len(shifts))
    for k in range(0, len(distances), chunk):
        apart = a[within[0][k:k + chunk]] - b[within[1][k:k + chunk]]
        apart = (apart - np.rint(apart))[:, None] + shifts
        distances[k:k + chunk] = np.linalg.norm(apart @ cell, axis=2).min(axis=1)
    return distances


def _edges_between(edges, distances):
    """Edges, moved by some 1e-9 of the largest where a distance within molecules equals one to
    rounding, so that two ways to compute the distance put it into the same bin."""
    moved, tolerance = edges.copy(), 1e-10*edges[-1]
    while len(distances) > 0:
        at = np.searchsorted(distances, moved[1:] - tolerance)
        near = distances[np.minimum(at, len(distances) - 1)]
        hit = np.abs(near - moved[1:]) <= tolerance
        if not hit.any():
            break
        moved[1:][hit] += 3*tolerance
    return moved


def _pairs_within(x, y, same, molecules, otherMolecules, where):
    """Two arrays: the indices, among x and y, of pairs in one molecule."""
    first = _molecules(molecules, x.shape[1], where, 'molecules')
    second = first if same else _molecules(otherMolecules, y.shape[1], where, 'otherMolecules')
    if same and otherMolecules is not None:
        raise ValueError(f'{where}: otherMolecules: given without others: give others, too')
    if not same and (first is None) != (second is None):
        given, missing = ('molecules', 'otherMolecules')[::1 if second is None else -1]
        raise ValueError(f'{where}: {missing}: not given, but {given} is: pairs within a molecule '
                         'can be left out only if both are known')
    if first is None:
        own = np.arange(x.shape[1] if same else 0)
        return own, own
    order = np.argsort(second, kind='stable')
    low = np.searchsorted(second[order], first, side='left')
    high = np.searchsorted(second[order], first, side='right')
    a = np.repeat(np.arange(len(first)), high - low)
    b = np.concatenate([order[i:j] for i, j in zip(low, high)] + [np.empty(0, dtype=int)])
    return a, b


def _molecules(values, count, where, name):
    """Numbers of molecules, or None."""
    if values is None:
        return None
    array = _units.indices(values, where, name)
    if len(array) != count:
        raise ValueError(f'{where}: {name}: got {len(array)} numbers for {count} positions: give '
                         'the molecule of each')
    return array


def structureFactor(positions: Numbers, box: Numbers, maxWaveNumber: Number,
                    binWidth: Optional[Number] = None,
                    normalAxis: Optional[int] = None) -> StructureFactor:
    r"""Get the structure factor S(k) of bodies in a periodic box.

    It is the mean of ``|sum_i exp(i k r_i)|^2/n``, for the waves k that fit into the box. Its limit
    at small k is the compressibility of the suspension divided by that of an ideal suspension. A
    box of longest edge L shows it down to :math:`2 \pi/L`.

    Parameters
    ----------
    positions : array-like or Quantity of shape (frames, bodies, 3) or (bodies, 3)
        origins of the bodies, nm, wrapped into the box or not
    box : float, or sequence or Quantity of shape (3,) or (3, 3)
        as in :func:`pairDistribution`, but the same box for all frames, whose waves these are
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
    x, vectors = _frames(positions, where, 'positions'), _vectors(box, where)
    axes = _axes(normalAxis, vectors[None], where)
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


def _frames(positions, where, name):
    """Positions as (frames, bodies, 3), nm."""
    array = _units.array_of(positions, _units.LENGTH, where, name)
    return _units.frames(array[None] if array.ndim == 2 else array, _units.LENGTH, 3, where, name)


def _vectors_of_frames(box, frames, where):
    """Box vectors in rows for each frame, nm."""
    array = _units.array_of(box, _units.LENGTH, where, 'box')
    if array.ndim < 3:
        return np.broadcast_to(_vectors(array, where), (frames, 3, 3))
    if len(array) != frames:
        raise ValueError(
            f'{where}: box: got the vectors of {len(array)} frames for {frames} frames '
            'of positions: give those of each frame, or of one box for all')
    return np.array([_vectors(each, where) for each in array])


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
    if vectors[:, axes, normalAxis].any() or vectors[:, normalAxis, axes].any():
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
