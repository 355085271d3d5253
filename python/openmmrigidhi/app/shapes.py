"""Blob models of simple shapes."""
import numpy as np

from .. import _units

#: How often an icosahedron's faces are divided into four for each number of vertices, 10*4^k + 2.
_SUBDIVISIONS = {12: 0, 42: 1, 162: 2, 642: 3, 2562: 4}
#: Hydrodynamic radius for translation of a shell of geometric radius 1 with blobs that touch.
SHELL_RADII = {12: 1.262447, 42: 1.122022, 162: 1.052965, 642: 1.023940}


def sphereShell(n, radius):
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
        raise ValueError(f'sphereShell: n: got {n}; it must be one of {", ".join(map(str, _SUBDIVISIONS))}: '
                         'use one of these')
    if not 0 < radius < np.inf:
        raise ValueError(f'sphereShell: radius: got {radius} nm; it must be finite and positive: give a value above 0')
    vertices, faces = _icosahedron()
    for _ in range(_SUBDIVISIONS[n]):
        vertices, faces = _subdivide(vertices, faces)
    return _units.LENGTH.attach(radius*vertices)


def _icosahedron():
    golden = (1 + np.sqrt(5))/2
    vertices = np.array([(-1, golden, 0), (1, golden, 0), (-1, -golden, 0), (1, -golden, 0),
                         (0, -1, golden), (0, 1, golden), (0, -1, -golden), (0, 1, -golden),
                         (golden, 0, -1), (golden, 0, 1), (-golden, 0, -1), (-golden, 0, 1)])
    faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6),
             (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11), (6, 2, 10),
             (8, 6, 7), (9, 8, 1)]
    return vertices/np.linalg.norm(vertices[0]), faces


def multiblobSphere(n, radius):
    """Get a sphere as a rigid multiblob: a shell whose hydrodynamic radius for translation is that of the sphere.

    The blobs' radius is half their smallest distance. The hydrodynamic radius for rotation is smaller, by 2.5, 1.8, 0.55 and 0.13 %
    for 12, 42, 162 and 642 blobs.

    Parameters
    ----------
    n : int
        number of blobs: 12, 42, 162 or 642
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
        raise ValueError(f'multiblobSphere: n: got {n!r}; the numbers of blobs with a known hydrodynamic radius are '
                         f'{", ".join(map(str, SHELL_RADII))}: choose one of them')
    centres = sphereShell(n, radius)/SHELL_RADII[n]
    points = centres._value
    squares = np.concatenate([((points[k+1:] - points[k])**2).sum(axis=1) for k in range(n - 1)])
    return centres, _units.LENGTH.attach(float(np.sqrt(squares.min())/2))


def _subdivide(vertices, faces):
    """Divide each triangle into four, with the new vertices, one on each edge, pushed out to the sphere."""
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
