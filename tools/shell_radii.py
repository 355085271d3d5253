#!/usr/bin/python3
"""Compute the hydrodynamic radii of shells in python/openmmrigidhi/app/shapes.py.

The shells are made of touching blobs. A shell has its blobs at sphereShell(n, 1); their radius is
half their smallest distance. The force f on blobs that all have the velocity (1, 0, 0) solves M f =
u, with M the Rotne-Prager-Yamakawa mobility of blobs that do not overlap, in unbounded fluid. The
radius for translation is the sum of f_x over 6 pi eta. The radius for rotation is the cube root of
the torque of blobs that turn about z over 8 pi eta. The shells have the symmetry of an icosahedron,
which makes both tensors isotropic.

Conjugate gradients solve the equations, with products by rows of pairs: 2562 blobs take a minute
and no large matrix. The plugin's mobilities are not used, since tests with these radii check the
plugin's mobilities.

    PYTHONPATH=build/python python3 tools/shell_radii.py [n ...]      # default: 12 42 162 642 2562
"""
import sys

import numpy as np

from openmmrigidhi import app

VISCOSITY = 1.0
#: Tolerance of the residual. The error of the radii is its square, since they are quadratic forms.
TOLERANCE = 1e-9
ROWS = 200


def smallestDistance(points):
    return min(
        np.linalg.norm(points[k + 1:] - points[k], axis=1).min() for k in range(len(points) - 1))


def product(points, a, forces):
    """M forces, both of shape (n, 3), for blobs of radius a with centres at least 2a apart."""
    velocities = forces/(6*np.pi*VISCOSITY*a)
    for first in range(0, len(points), ROWS):
        rows = slice(first, min(first + ROWS, len(points)))
        r = points[rows, None] - points[None]
        squares = np.einsum('ijk,ijk->ij', r, r)
        own = np.arange(rows.start, rows.stop)
        squares[own - first, own] = np.inf  # no contribution to itself
        inverse = 1/np.sqrt(squares)
        ratio = 2*a*a/squares
        along = np.einsum('ijk,jk->ij', r, forces)*(1 - ratio)*inverse**3
        velocities[rows] += ((
            (1 + ratio/3)*inverse) @ forces + np.einsum('ij,ijk->ik', along, r))/(8*np.pi*VISCOSITY)
    return velocities


def solve(points, a, velocities):
    """The forces for these velocities, and the number of iterations."""
    forces, residual = np.zeros_like(velocities), velocities.copy()
    direction, old, iterations = residual.copy(), np.vdot(residual, residual), 0
    stop = TOLERANCE**2*old
    while old > stop:
        image = product(points, a, direction)
        step = old/np.vdot(direction, image)
        forces += step*direction
        residual -= step*image
        new = np.vdot(residual, residual)
        direction = residual + new/old*direction
        old = new
        iterations += 1
    return forces, iterations


def radii(n):
    """Hydrodynamic radii of a shell of geometric radius 1, for translation and rotation.

    The number of iterations follows.
    """
    points = app.sphereShell(n, 1)._value
    a = smallestDistance(points)/2
    translation = np.tile((1.0, 0, 0), (n, 1))
    rotation = np.cross((0, 0, 1.0), points)
    forces, first = solve(points, a, translation)
    torques, second = solve(points, a, rotation)
    return (np.vdot(translation, forces)/(6*np.pi*VISCOSITY),
            (np.vdot(rotation, torques)/(8*np.pi*VISCOSITY))**(1/3), first + second)


if __name__ == '__main__':
    print('blobs  translation  rotation  rotation below translation by  iterations')
    for n in map(int, sys.argv[1:] or (12, 42, 162, 642, 2562)):
        translation, rotation, iterations = radii(n)
        print(
            f'{n:5d}  {translation:11.6f}  {rotation:8.6f}  '
            f'{100*(1 - rotation/translation):28.3f}%  {iterations:10d}', flush=True)
