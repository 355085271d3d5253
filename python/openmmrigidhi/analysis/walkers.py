"""Gibbs-Boltzmann Monte Carlo of one rigid body, for many independent walkers at a time.

The energy is a function written in NumPy.
"""
from __future__ import annotations

from typing import TYPE_CHECKING, Callable, Optional, Sequence

import numpy as np
from openmm import unit

from .. import _units
from .._types import Number, Numbers
from .._quaternions import rotate, rotation_matrices
from . import _moves
from ._sampler import Sampler

if TYPE_CHECKING:
    import numpy.typing as npt


class WalkerSampler(Sampler):
    r"""Samples poses of one rigid body from :math:`\exp(-U/kT)`, by many independent walkers.

    All walkers move at the same time. A sweep has two Metropolis moves, a translation and a
    rotation, with respect to the measure dR times Haar's on SO(3). Brownian dynamics with the right
    stochastic drift has the same distribution. The energy is a function of arrays of poses, so a
    trial of a walker costs about a microsecond. For interacting bodies and OpenMM's forces see
    :class:`GibbsBoltzmannSampler`.

    Parameters
    ----------
    energyFunction : callable
        ``energyFunction(positions, orientations)`` gets the poses of the walkers whose trial the
        wall allows: arrays (k, 3) in nm, and (k, 4) of unit quaternions (w, x, y, z), body frame to
        lab frame. It returns (k,) energies in kJ/mol; infinity forbids a pose.
    temperature : float or Quantity
        K
    numWalkers : int
        number of walkers; errors come from their spread, so take dozens at least
    position : Vec3, sequence or Quantity of shape (3,) or (numWalkers, 3)
        starting position of the body's origin, nm
    orientation : sequence of shape (4,) or (numWalkers, 4)
        orientation at the start; default: the body frame is the lab frame
    sitePositions : array-like or Quantity of shape (m, 3), optional
        positions in the body frame of the blobs that a wall stops, nm
    radii : float, or sequence or Quantity of shape (m,), optional
        radii of the blobs, nm; blobs of radius 0 do not feel the wall
    wallHeight : float or Quantity, optional
        height z of a hard wall, nm; None: no wall
    rejection : str
        "Overlap": every blob must have z - wallHeight >= its radius; "Crossing": z - wallHeight > 0
    coordinates : sequence of str
        the sampled coordinates: any of "x", "y", "z", "rotation". Nothing holds a body along the
        wall. Without x and y it stays above its start.
    rotationAxis : Vec3 or sequence of shape (3,), optional
        turn only about this axis of the lab; None: about all axes
    trackingPoint : Vec3, sequence or Quantity of shape (3,)
        the point of the body about which the moves turn it, body frame, nm; it changes only how
        fast samples become independent
    seed : int
        seed of the random numbers; 0: a fresh seed

    Attributes
    ----------
    seed : int
        the seed in use

    Raises
    ------
    TypeError, ValueError
        for arguments of wrong dimension or shape, for a start that the wall forbids, or for a start
        with an infinite energy

    Examples
    --------
    A sphere of radius 1 nm over a wall, with a weight of 1 kT/nm: its mean height is 2 nm.

    >>> import openmmrigidhi
    >>> kT = 8.31446261815324e-3*300
    >>> sampler = openmmrigidhi.analysis.WalkerSampler(
    ...     lambda R, q: kT*R[:, 2], 300, 200, (0, 0, 2), sitePositions=[(0, 0, 0)], radii=1,
    ...     wallHeight=0, coordinates=['z'], seed=1)
    >>> sampler.burnIn(200)
    >>> samples = sampler.sample(100, interval=5)
    >>> height = samples.average(samples.positions[:, :, 2])
    >>> abs(height.mean - 2) < 4*height.standardError
    True
    """

    _INDEPENDENT = True

    def __init__(self, energyFunction: Callable, temperature: Number, numWalkers: int,
                 position: Numbers, orientation: npt.ArrayLike = (1, 0, 0, 0),
                 sitePositions: Optional[Numbers] = None, radii: Optional[Numbers] = None,
                 wallHeight: Optional[Number] = None, rejection: str = 'Overlap',
                 coordinates: Sequence[str] = _moves.COORDINATES,
                 rotationAxis: Optional[Numbers] = None, trackingPoint: Numbers = (0, 0, 0),
                 seed: int = 0) -> None:
        where = 'WalkerSampler'
        self._energyFunction = energyFunction
        self._kT = _moves.thermal_energy(temperature, where)
        count = _moves.positive(numWalkers, where, 'numWalkers')
        self._positions = _per_walker(position, _units.LENGTH, 3, count, where, 'position')
        q = _per_walker(orientation, _units.NONE, 4, count, where, 'orientation')
        norms = np.linalg.norm(q, axis=1, keepdims=True)
        if not np.all(np.abs(norms - 1) < 1e-3):
            raise ValueError(
                f'{where}: orientation: got {orientation!r}; quaternions must have the length 1 to '
                f'be rotations: normalise them')
        self._orientations = q/norms
        sites = np.zeros((1, 3)) if sitePositions is None else _units.rows(
            sitePositions, _units.LENGTH, 3, where, 'sitePositions')
        self._sites = sites
        self._wall = None
        if wallHeight is not None:
            if radii is None or sitePositions is None:
                raise ValueError(
                    f'{where}: wallHeight: got a wall, but no sitePositions or no radii; both '
                    'tell what the wall stops: give both')
            radii = np.array(_units.per_site(radii, _units.LENGTH, len(sites), where, 'radii'))
            self._wall = _moves.Wall(_units.number(wallHeight, _units.LENGTH, where, 'wallHeight'),
                                     radii, rejection, where)
        self._motion = _moves.Motion(coordinates, rotationAxis, where)
        self._point = _units.vector(trackingPoint, _units.LENGTH, where, 'trackingPoint')
        self.seed, self._random = _moves.generator(seed, where)
        extent = np.linalg.norm(sites, axis=1).max() + (0 if self._wall is None else radii.max())
        self._steps = _moves.stepSizes(self._motion.kinds, 1, extent or 1)
        self._check_start(where)

    def _check_start(self, where):
        allowed = self._allowed(self._positions, self._orientations)
        if not np.all(allowed):
            walker = np.argmin(allowed)
            raise ValueError(
                f'{where}: position: walker {walker} begins at {self._positions[walker]} nm, where '
                'the wall stops one of its blobs; a start must be allowed: begin higher up')
        self._energies = self._energies_of(self._positions, self._orientations)
        if not np.all(np.isfinite(self._energies)):
            walker = np.argmin(np.isfinite(self._energies))
            raise ValueError(
                f'{where}: energyFunction: it is {self._energies[walker]} at the start of walker '
                f'{walker}; there it must be finite: begin elsewhere')

    def _present(self):
        return self._positions, self._orientations, self._energies, np.empty((0, 3))

    def _sweep(self, adapt):
        for kind, steps in self._steps.items():
            sizes = np.broadcast_to(steps.sizes, len(self._positions))
            if kind == 'translation':
                R, q = self._positions + self._motion.translations(self._random,
                                                                   sizes), self._orientations
            else:
                q = _moves.turned(self._motion.rotations(self._random, sizes), self._orientations)
                R = self._positions
                if self._point.any():
                    R = R + rotate(self._orientations, self._point) - rotate(q, self._point)
            accepted = self._decide(R, q)
            steps.count(0, len(R), accepted, adapt)

    def _decide(self, R, q):
        """Accept or reject each walker's trial; return the number of accepted trials."""
        energies = np.full(len(R), np.inf)
        allowed = self._allowed(R, q)
        if np.any(allowed):
            energies[allowed] = self._energies_of(R[allowed], q[allowed])
        # -log of a uniform number is an exponential number, and needs no care with large
        # differences.
        accepted = energies - self._energies <= self._kT*self._random.standard_exponential(len(R))
        self._energies = np.where(accepted, energies, self._energies)
        self._positions = np.where(accepted[:, None], R, self._positions)
        self._orientations = np.where(accepted[:, None], q, self._orientations)
        return np.count_nonzero(accepted)

    def _allowed(self, R, q):
        if self._wall is None:
            return np.ones(len(R), dtype=bool)
        return self._wall.allows(R[:, 2:] + rotation_matrices(q)[:, 2] @ self._sites.T)

    def _energies_of(self, R, q):
        energies = _moves.plain_energies(self._energyFunction(R, q), 'WalkerSampler')
        if energies.shape != (len(R),):
            raise ValueError(
                f'WalkerSampler: energyFunction: it returned an array of shape {energies.shape} '
                f'for {len(R)} poses; it must return one energy for each: sum over the rest')
        bad = _moves.is_no_energy(energies)
        if np.any(bad):
            k = np.argmax(bad)
            raise ValueError(
                f'WalkerSampler: energyFunction: it returned {energies[k]} kJ/mol at position '
                f'{R[k]} nm, orientation {q[k]}; energies must be numbers, or infinity where a '
                'pose is forbidden: give a wall or correct the function')
        return energies


def _per_walker(values, dimension, columns, count, where, name):
    """One row for each walker; a single row is for all."""
    rows = np.shape(values._value if unit.is_quantity(values) else values)
    if len(rows) == 1:
        if columns == 3:
            return np.tile(_units.vector(values, dimension, where, name), (count, 1))
        values = [values]*count
    return _units.rows(values, dimension, columns, where, name, count)
