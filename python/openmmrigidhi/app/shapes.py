"""Blob models of simple shapes."""
from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .. import _units
from .._types import Number, Numbers

if TYPE_CHECKING:
    from openmm import unit

#: How many times the faces of an icosahedron are divided into four, for each number of vertices,
#: 10*4^k + 2.
_SUBDIVISIONS = {12: 0, 42: 1, 162: 2, 642: 3, 2562: 4}
#: Hydrodynamic radius for translation of a shell of geometric radius 1 with blobs that touch, by
#: tools/shell_radii.py.
SHELL_RADII = {12: 1.262447, 42: 1.122022, 162: 1.052965, 642: 1.023940, 2562: 1.011270}


def sphereShell(n: int, radius: Number) -> unit.Quantity:
    """Get points spread evenly over a sphere: the vertices of a subdivided icosahedron.

    Parameters
    ----------
    n : int
        number of points: 12, 42, 162, 642 or 2562
    radius : float or Quantity
        geometric radius of the sphere on which the points lie, nm

    Returns
    -------
    Quantity of shape (n, 3)
        nm, centred at the origin

    Raises
    ------
    ValueError
        for another n, or a radius that is not positive
    """
    n = _units.integer(n, 'sphereShell', 'n')
    radius = _units.number(radius, _units.LENGTH, 'sphereShell', 'radius')
    if n not in _SUBDIVISIONS:
        raise ValueError(
            f'sphereShell: n: got {n}; it must be one of {", ".join(map(str, _SUBDIVISIONS))}')
    if not 0 < radius < np.inf:
        raise ValueError(f'sphereShell: radius: got {radius} nm; it must be finite and positive')
    vertices, faces = _icosahedron()
    for _ in range(_SUBDIVISIONS[n]):
        vertices, faces = _subdivide(vertices, faces)
    return _units.LENGTH.attach(radius*vertices)


def rod(n: int, spacing: Number) -> unit.Quantity:
    """Get blobs in a row along the x axis.

    Parameters
    ----------
    n : int
        number of blobs, at least 2
    spacing : float or Quantity
        distance between neighbours, nm

    Returns
    -------
    Quantity of shape (n, 3)
        nm, from the lowest x up, about the rod's centre. The blobs are on a line, so the fluid does
        not resist rotation about this line.
    """
    n = _at_least(2, n, 'rod', 'n')
    spacing = _positive_length(spacing, 'rod', 'spacing')
    points = np.zeros((n, 3))
    points[:, 0] = spacing*(np.arange(n) - (n - 1)/2)
    return _units.LENGTH.attach(points)


def cylinder(radius: Number, length: Number, spacing: Number, closed: bool = True) -> unit.Quantity:
    """Get blobs on the surface of a cylinder about the x axis.

    The blobs lie on staggered rings on the side, and on rings that fill the two ends.

    Parameters
    ----------
    radius : float or Quantity
        geometric radius, on which the side's blobs lie, nm
    length : float or Quantity
        distance between the two end planes, on which blobs lie, nm
    spacing : float or Quantity
        approximate distance between neighbours, nm; the rings divide length and circumference
        evenly
    closed : bool
        fill the ends; without them the cylinder is a tube that lets the fluid through

    Returns
    -------
    Quantity of shape (n, 3)
        nm, about the cylinder's centre: the side from the lowest x up, then the end at low x, then
        the end at high x
    """
    radius = _positive_length(radius, 'cylinder', 'radius')
    length = _positive_length(length, 'cylinder', 'length')
    spacing = _positive_length(spacing, 'cylinder', 'spacing')
    around = max(3, round(2*np.pi*radius/spacing))
    heights = length*np.linspace(-0.5, 0.5, max(1, round(length/spacing)) + 1)
    rings = [_ring(x, radius, around, (k % 2)/2) for k, x in enumerate(heights)]
    if _units.boolean(closed, 'cylinder', 'closed'):
        inner = radius*np.arange(round(radius/spacing))/max(1, round(radius/spacing))
        rings += [
            _ring(x, r, max(1, round(2*np.pi*r/spacing)), 0) for x in (heights[0], heights[-1])
            for r in inner[::-1]
        ]
    return _units.LENGTH.attach(np.concatenate(rings))


def _ring(x, radius, n, turn):
    """n points on a circle about the x axis, turned by a part of the angle between neighbours."""
    angles = 2*np.pi*(np.arange(n) + turn)/n
    return np.stack([np.full(n, x), radius*np.cos(angles), radius*np.sin(angles)], axis=1)


def boomerang(spacing: Number, blobsPerArm: int = 7) -> unit.Quantity:
    r"""Get blobs of a right-angled boomerang.

    The boomerang of Delong, Balboa Usabiaga and Donev 2015 has 15 blobs of radius
    :math:`0.265 \sqrt{1.5}` um at a spacing of 0.3 um.

    Parameters
    ----------
    spacing : float or Quantity
        distance between neighbours, nm
    blobsPerArm : int
        number of blobs in each arm, without the blob at the cross point

    Returns
    -------
    Quantity of shape (2*blobsPerArm + 1, 3)
        nm, about the cross point, with arms along +x and +y: from the tip on the x axis over the
        cross point (row blobsPerArm) to the tip on the y axis. The bisector is the direction (1, 1,
        0).
    """
    spacing = _positive_length(spacing, 'boomerang', 'spacing')
    blobsPerArm = _at_least(1, blobsPerArm, 'boomerang', 'blobsPerArm')
    steps = np.arange(-blobsPerArm, blobsPerArm + 1)
    return _units.LENGTH.attach(
        spacing*
        np.stack([np.maximum(0, -steps), np.maximum(0, steps), 0*steps], axis=1))


def tetramer(spacing: Number) -> unit.Quantity:
    """Get four blobs at the corners of a regular tetrahedron.

    Parameters
    ----------
    spacing : float or Quantity
        distance between any two blobs, nm

    Returns
    -------
    Quantity of shape (4, 3)
        nm, about the tetrahedron's centre: three of equal z < 0, the first of which has y = 0 and x
        > 0, then one on the +z axis
    """
    spacing = _positive_length(spacing, 'tetramer', 'spacing')
    base = _ring(-spacing/np.sqrt(24), spacing/np.sqrt(3), 3, 0)[:, [1, 2, 0]]
    return _units.LENGTH.attach(np.concatenate([base, [(0, 0, spacing*np.sqrt(3/8))]]))


def icosahedron(radius: Number) -> unit.Quantity:
    """Get twelve blobs at the vertices of a regular icosahedron, two of them on the z axis.

    It is :func:`sphereShell` of 12 points, turned. Delong, Balboa Usabiaga and Donev 2015 hang a
    weight on a corner that lies on an axis.

    Parameters
    ----------
    radius : float or Quantity
        distance of the vertices from the centre, nm

    Returns
    -------
    Quantity of shape (12, 3)
        nm, about the icosahedron's centre: the vertex on +z, five of equal z > 0, five of equal z <
        0, the vertex on -z
    """
    radius = _positive_length(radius, 'icosahedron', 'radius')
    z, r = radius/np.sqrt(5), 2*radius/np.sqrt(5)
    rings = [_ring(z, r, 5, 0)[:, [1, 2, 0]], _ring(-z, r, 5, 0.5)[:, [1, 2, 0]]]
    return _units.LENGTH.attach(np.concatenate([[(0, 0, radius)], *rings, [(0, 0, -radius)]]))


def _positive_length(value, where, name):
    value = _units.number(value, _units.LENGTH, where, name)
    if not 0 < value < np.inf:
        raise ValueError(
            f'{where}: {name}: got the length {value} nm; a shape needs a finite length above 0')
    return value


def _at_least(fewest, value, where, name):
    value = _units.integer(value, where, name)
    if value < fewest:
        raise ValueError(
            f'{where}: {name}: got {value} blobs; a shape of this kind needs at least {fewest}')
    return value


def _icosahedron():
    golden = (1 + np.sqrt(5))/2
    vertices = np.array([(-1, golden, 0), (1, golden, 0), (-1, -golden, 0), (1, -golden, 0),
                         (0, -1, golden), (0, 1, golden), (0, -1, -golden), (0, 1, -golden),
                         (golden, 0, -1), (golden, 0, 1), (-golden, 0, -1), (-golden, 0, 1)])
    faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4),
             (11, 10, 2), (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8),
             (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]
    return vertices/np.linalg.norm(vertices[0]), faces


def multiblobSphere(n: int, radius: Number) -> tuple[unit.Quantity, unit.Quantity]:
    """Get a sphere as a rigid multiblob: a shell of blobs.

    The hydrodynamic radius of the shell for translation equals the radius of the sphere. The radius
    of the blobs is half their smallest distance. The hydrodynamic radius for rotation is smaller,
    by 2.5, 1.8, 0.55, 0.13 and 0.02 % for 12, 42, 162, 642 and 2562 blobs.

    The blobs reach beyond the radius of the sphere: to 1.21, 1.13, 1.08, 1.04 and 1.02 times the
    radius for these numbers of blobs. Beside walls, and to keep shells from overlapping, use the
    radius that :func:`outerRadius` returns.

    Parameters
    ----------
    n : int
        number of blobs: 12, 42, 162, 642 or 2562
    radius : float or Quantity
        hydrodynamic radius of the sphere, nm

    Returns
    -------
    centres : Quantity of shape (n, 3)
        nm, about the sphere's centre
    blobRadius : Quantity
        nm

    Raises
    ------
    ValueError
        for another n, or a radius that is not positive
    """
    if n not in SHELL_RADII:
        raise ValueError(
            f'multiblobSphere: n: got {n!r}; the numbers of blobs with a known hydrodynamic radius '
            f'are {", ".join(map(str, SHELL_RADII))}')
    centres = sphereShell(n, radius)/SHELL_RADII[n]
    points = centres._value
    squares = np.concatenate([((points[k + 1:] - points[k])**2).sum(axis=1) for k in range(n - 1)])
    return centres, _units.LENGTH.attach(float(np.sqrt(squares.min())/2))


def outerRadius(sites: Numbers, radii: Numbers) -> unit.Quantity:
    """Get the radius of the smallest sphere about a body's origin that contains its blobs.

    A shell of blobs reaches beyond the sphere that it stands for. Give this radius to
    :func:`randomSuspension` to place shells without overlaps, and clear of walls.

    Parameters
    ----------
    sites : array-like or Quantity of shape (n, 3)
        positions of the body's particles about its origin, nm
    radii : float, or sequence or Quantity of shape (n,)
        radius of all particles or of each, nm; particles of radius 0 do not count

    Returns
    -------
    Quantity
        nm

    Raises
    ------
    TypeError, ValueError
        for arrays of other shapes or dimensions, or without a particle of radius above 0

    Examples
    --------
    >>> from openmmrigidhi import app
    >>> round(app.outerRadius(*app.multiblobSphere(12, 1.0))._value, 3)
    1.209
    """
    where = 'outerRadius'
    places = _units.rows(sites, _units.LENGTH, 3, where, 'sites')
    radii = np.array(_units.per_site(radii, _units.LENGTH, len(places), where, 'radii'))
    if not radii.any():
        raise ValueError(f'{where}: radii: got {radii.tolist()}; a body needs a particle of radius '
                         'above 0')
    reach = np.linalg.norm(places, axis=1) + radii
    return _units.LENGTH.attach(float(reach[radii > 0].max()))


def _subdivide(vertices, faces):
    """Divide each triangle into four, with new vertices on the edges, pushed out to the sphere."""
    points = list(vertices)
    middle = {}

    def between(i, j):
        edge = (min(i, j), max(i, j))
        if edge not in middle:
            point = points[i] + points[j]
            middle[edge] = len(points)
            points.append(point/np.linalg.norm(point))
        return middle[edge]

    smaller = []
    for a, b, c in faces:
        ab, bc, ca = between(a, b), between(b, c), between(c, a)
        smaller += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
    return np.array(points), smaller
