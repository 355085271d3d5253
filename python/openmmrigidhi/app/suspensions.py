"""Random suspensions of hard spheres: starts of simulations, without overlaps."""
from __future__ import annotations

from typing import TYPE_CHECKING, Optional, Union

import numpy as np

from .. import _units
from .._types import Number, Numbers

if TYPE_CHECKING:
    from openmm import unit

#: Spheres are pushed apart as if they were larger by this part of their radius, until no spheres of
#: the right size overlap, so that a little room is left to move in.
_ROOM = 0.02
#: Random spheres of one size jam at a volume fraction of 0.64, and come apart slowly near it.
_LARGEST_FRACTION, _MOST_PUSHES = 0.58, 5000
#: Steps of a sequence whose points are spread evenly over a box, for any number of them: powers of
#: the root of g^4 = g + 1.
_SPREAD = 1.2207440846057596**-np.arange(1.0, 4.0)
#: Monte Carlo moves of each sphere. Where spheres have little room, steps are small: from this
#: volume fraction on more moves are needed, as its fourth power.
_SWEEPS, _DENSE = 300, 0.3
#: Wanted fraction of accepted moves; with it spheres go furthest in a given time at volume
#: fractions of 0.3 to 0.5.
_ACCEPTANCE = 0.25
#: Moves per list of neighbours at most; largest step along an axis, in smallest radii.
_MOST_MOVES, _LARGEST_STEP = 20, 0.5


def randomSuspension(n: int, radius: Numbers, box: Numbers, gap: Number = 0,
                     wallAxis: Optional[int] = None, sweeps: Optional[int] = None,
                     seed: Union[int, np.random.Generator] = 0) -> unit.Quantity:
    r"""Get random positions of spheres in a box, without overlaps.

    The function pushes random points apart until no spheres overlap. Monte Carlo moves of hard
    spheres then give them the distribution of the equilibrium fluid. A thousand spheres take a
    second at a volume fraction of 0.1, and some seconds at 0.5.

    Parameters
    ----------
    n : int
        number of spheres
    radius : float, or sequence or Quantity of shape (n,)
        radius of all spheres or of each, nm. For shells of blobs give :func:`outerRadius`: blobs
        reach beyond the sphere that a shell stands for.
    box : float, or sequence or Quantity of shape (3,)
        edge of a cube, or three edges along x, y and z, nm. A cube of volume fraction :math:`\phi`
        has the edge :math:`(4 \pi n/(3 \phi))^{1/3}` times the radius.
    gap : float or Quantity
        smallest distance between surfaces, and between a surface and a wall, nm
    wallAxis : int, optional
        0, 1 or 2: the box has walls across x, y or z at 0 and at its edge there, like a channel,
        and is periodic along the other two axes. An edge of one diameter gives a monolayer. None:
        the box is periodic along all axes.
    sweeps : int, optional
        number of Monte Carlo moves of each sphere. None: 300 in dilute suspensions, 600 at a volume
        fraction of 0.3 and 2600 at 0.5. 0: the function only pushes spheres apart; this is no
        equilibrium.
    seed : int or numpy.random.Generator
        seed of the random numbers; the same seed gives the same positions

    Returns
    -------
    Quantity of shape (n, 3)
        centres, nm, between 0 and the edges of the box

    Raises
    ------
    TypeError
        for arguments of another kind or dimension
    ValueError
        for numbers that are not positive, a sphere that does not fit into the box, or more spheres
        than fit in at random (volume fractions above about 0.58)

    Notes
    -----
    All spheres try to move at the same time. A pair of spheres stays where it is if any of its old
    and new positions overlap. Reverse moves are then accepted as often, so detailed balance holds
    exactly.

    Examples
    --------
    >>> from openmmrigidhi import app
    >>> app.randomSuspension(100, 1.0, 12.0, seed=1).shape
    (100, 3)
    """
    where = 'randomSuspension'
    n = _units.integer(n, where, 'n')
    if n < 1:
        raise ValueError(f'{where}: n: got {n} spheres; at least one is needed')
    radii = np.array(_units.per_site(radius, _units.LENGTH, n, where, 'radius'))
    if not np.all(radii > 0):
        raise ValueError(f'{where}: radius: got {radii.min()} nm; a sphere needs a radius above 0: '
                         'leave out what the fluid does not see')
    edges = _edges(box, where)
    gap = _units.number(gap, _units.LENGTH, where, 'gap')
    if not 0 <= gap < np.inf:
        raise ValueError(f'{where}: gap: got {gap} nm; the distance between surfaces must be '
                         'finite and 0 or more')
    if sweeps is not None:
        sweeps = _units.integer(sweeps, where, 'sweeps')
        if sweeps < 0:
            raise ValueError(f'{where}: sweeps: got {sweeps}; the number of Monte Carlo moves must '
                             'be 0 or more')
    periodic = np.full(3, True)
    if wallAxis is not None:
        wallAxis = _units.integer(wallAxis, where, 'wallAxis')
        if wallAxis not in (0, 1, 2):
            raise ValueError(f'{where}: wallAxis: got {wallAxis}; the axis across the walls must '
                             'be 0, 1 or 2: give one of them, or None for a periodic box')
        periodic[wallAxis] = False
    random = seed if isinstance(seed, np.random.Generator) else np.random.default_rng(
        _units.integer(seed, where, 'seed'))
    return _units.LENGTH.attach(_Spheres(radii, edges, periodic, gap, where).draw(sweeps, random))


def _edges(box, where):
    """Three edges, nm."""
    try:
        edges = np.full(3, _units.number(box, _units.LENGTH, where, 'box'))
    except TypeError:
        edges = _units.vector(box, _units.LENGTH, where, 'box')
    if not np.all((0 < edges) & (edges < np.inf)):
        raise ValueError(f'{where}: box: got the edges {edges.tolist()} nm; they must be finite '
                         'and positive: give a length, or three')
    return edges


class _Spheres:
    """Spheres in a box.

    Half of the gap is part of each radius; the walls leave room for the other half.
    """
    def __init__(self, radii, edges, periodic, gap, where):
        self.radii = radii + gap/2
        self.edges, self.periodic, self.where = edges, periodic, where
        margin = (radii + gap)[:, None]
        self.low = np.where(periodic, -np.inf, margin)
        self.high = np.where(periodic, np.inf, edges - margin)
        largest = int(np.argmax(radii))
        for axis in range(3):
            room = edges[axis] - 2*self.radii[largest]
            if not periodic[axis]:
                room -= gap
            if room < -1e-12*edges[axis]:
                raise ValueError(
                    f'{where}: box: its edge along {"xyz"[axis]} is {edges[axis]:g} nm; sphere '
                    f'{largest} of radius {radii[largest]:g} nm with a gap of {gap:g} nm must fit '
                    'without touching its own image or a wall: give a longer edge')
        # An edge of one diameter, to rounding.
        self.high = np.maximum(self.high, self.low)
        self.fraction = 4*np.pi/3*(self.radii**3).sum()/np.prod(edges)
        #: Lists of neighbours reach this far beyond contact.
        self.skin = self.radii.min()
        #: Whether the nearest image of a neighbour may change while a list is used.
        self.isSmall = edges[periodic].min() < 4*(self.radii.max() + self.skin)

    def draw(self, sweeps, random):
        # Independent random points would have long waves of density, which moves remove only
        # slowly; the points of an evenly spread sequence have none.
        points = (random.random(3) + np.outer(np.arange(len(self.radii)), _SPREAD)) % 1
        low = np.where(self.periodic, 0, self.low)
        width = np.where(self.periodic, self.edges, self.high - self.low)
        order = random.permutation(len(self.radii))
        x = self._move_apart(low + width*points[order])
        if len(x) > 1:
            x = self._move(x, sweeps, random)
        x = np.where(self.periodic, x % self.edges, x)
        return np.where(self.periodic & (x >= self.edges), 0, x)

    def _pairs(self, x, reach):
        """Pairs of spheres whose centres are within this distance, as two arrays of indices."""
        from scipy.spatial import cKDTree
        places = np.where(self.periodic, x % self.edges, x)
        places = np.where(self.periodic & (places >= self.edges), 0, places)
        tree = cKDTree(places, boxsize=np.where(self.periodic, self.edges, 0))
        return tree.query_pairs(reach, output_type='ndarray').T

    def _nearest(self, d):
        """Differences of places to the nearest images."""
        return d - np.where(self.periodic, self.edges*np.round(d/self.edges), 0)

    def _move_apart(self, x):
        """Push overlapping spheres apart, until no spheres overlap."""
        radii = (1 + _ROOM)*self.radii
        for _ in range(_MOST_PUSHES):
            i, j = self._pairs(x, 2*radii.max())
            d = self._nearest(x[j] - x[i])
            distance = np.sqrt((d*d).sum(axis=1))
            if np.all(distance >= self.radii[i] + self.radii[j]):
                return x
            overlap = np.maximum(0, radii[i] + radii[j] - distance)
            push = (overlap/(2*np.maximum(distance, 1e-300)))[:, None]*d
            move = np.zeros_like(x)
            np.add.at(move, i, -push)
            np.add.at(move, j, push)
            x = np.clip(x + move, self.low, self.high)
        raise ValueError(
            f'{self.where}: box: {len(x)} spheres, with half of the gap on each, fill '
            f'{self.fraction:.3g} of it, and still overlap after {_MOST_PUSHES} pushes; random '
            f'spheres fit up to about {_LARGEST_FRACTION:g}: give a larger box or fewer spheres')

    def _move(self, x, sweeps, random):
        """Monte Carlo moves; the step adapts in their first half."""
        if sweeps is None:
            sweeps = round(_SWEEPS*(1 + (self.fraction/_DENSE)**4))
        done, step = 0, 0.1*self.radii.min()
        while done < sweeps:
            moves = int(np.clip(self.skin/(2*3**0.5*step), 1, min(_MOST_MOVES, sweeps - done)))
            x, accepted = self._move_often(x, step, moves, random)
            done += moves
            if done <= sweeps/2:
                step = min(step*np.exp(accepted - _ACCEPTANCE), _LARGEST_STEP*self.radii.min())
        return x

    def _move_often(self, x, step, moves, random):
        """Some moves of all spheres with one list of neighbours; the accepted fraction, too."""
        i, j = self._pairs(x, 2*self.radii.max() + 2*3**0.5*step*moves)
        contact = (self.radii[i] + self.radii[j])**2
        d = self._nearest(x[j] - x[i])
        moved, accepted = np.zeros_like(x), 0.0
        for _ in range(moves):
            trial = step*(2*random.random(x.shape) - 1)
            stays = np.any((x + moved + trial < self.low) | (x + moved + trial > self.high), axis=1)
            now, ti, tj = d + moved[j] - moved[i], trial[i], trial[j]
            overlaps = np.zeros(len(i), dtype=bool)
            for each in (now - ti, now + tj, now - ti + tj):
                each = self._nearest(each) if self.isSmall else each
                overlaps |= np.einsum('pk,pk->p', each, each) < contact
            stays[i[overlaps]] = stays[j[overlaps]] = True
            moved += np.where(stays[:, None], 0, trial)
            accepted += 1 - stays.mean()
        return x + moved, accepted/moves
