"""Slips of swimming bodies."""
from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .. import _units
from .._types import Array, Number

if TYPE_CHECKING:
    import numpy.typing as npt
    from openmm import unit

#: How far distances from the centre of a shell may be from their mean, relative to it.
_ROUND = 1e-3


def squirmerSlip(sites: npt.ArrayLike, radius: Number, B1: Number, B2: Number) -> unit.Quantity:
    r"""Get the slip of a squirmer, for ``MobilityForce.setBodySlip``, of a shell of blobs.

    A squirmer is a sphere whose surface moves with
    :math:`u = (B_1 + B_2 \cos \theta) \sin \theta\,e_\theta`, where :math:`\theta` is the angle
    from the z axis of the body frame. In unbounded fluid it swims along z with :math:`2 B_1/3`. For
    :math:`B_2 > 0` it is a puller, for :math:`B_2 < 0` a pusher, with the stresslet
    :math:`4 \pi \eta a^2 B_2 (z z^T - 1/3)` on the fluid, where a is its radius.

    Parameters
    ----------
    sites : array-like of shape (n, 3) or Quantity
        centres of the blobs in the body frame, nm, on a sphere, such as those of
        :func:`multiblobSphere`
    radius : float or Quantity
        radius of each blob, nm
    B1, B2 : float or Quantity
        amplitudes of the modes, nm/ps

    Returns
    -------
    Quantity of shape (n, 3)
        velocities of the surface at the blobs, relative to the body, body frame, nm/ps

    Raises
    ------
    ValueError
        if the sites are not on a sphere to 1e-3 of its radius, or do not respond to a mode

    Notes
    -----
    The blobs of a shell respond to velocities more strongly than the smooth surface does: with the
    velocities of the formula, shells of 12, 42, 162 and 642 blobs of multiblobSphere() swim 1.730,
    1.446, 1.228 and 1.115 times as fast, and have 1.762, 1.785, 1.387 and 1.188 times the
    stresslet. The function therefore divides each mode by its factor, computed from the mobility
    matrix (Rotne-Prager-Yamakawa, unbounded fluid) of the given shell. The swimming velocity and
    the stresslet of a single body are then exact. The flow of B1 alone, which decays as
    :math:`1/r^3`, is not: it is too weak at all distances, by 38, 25, 14 and 8 % with these shells.
    Objects nearer than a few radii to the body also feel the other moments of the shell, so use 42
    blobs or more there.
    """
    where = 'squirmerSlip'
    points = _units.rows(sites, _units.LENGTH, 3, where, 'sites')
    radius = _units.number(radius, _units.LENGTH, where, 'radius')
    B1, B2 = (_units.number(B, _units.VELOCITY, where, name)
              for B, name in ((B1, 'B1'), (B2, 'B2')))
    if not 0 < radius < np.inf:
        raise ValueError(f'{where}: radius: got {radius} nm; it must be finite and positive: give '
                         'the radius of a blob')
    for name, B in (('B1', B1), ('B2', B2)):
        if not np.isfinite(B):
            raise ValueError(f'{where}: {name}: got {B} nm/ps; it must be finite: give a velocity')
    if len(points) < 4:
        raise ValueError(f'{where}: sites: got {len(points)} of them; at least 4 are needed: '
                         'give the centres of the blobs of a shell')
    for i, point in enumerate(points):
        if not np.isfinite(point).all():
            raise ValueError(f'{where}: sites: the position of site {i} is {point.tolist()} nm; it '
                             'must be finite: give the centre of a blob')
    arms = points - points.mean(axis=0)
    distances = np.linalg.norm(arms, axis=1)
    spread = np.abs(distances - distances.mean()).max()
    if not spread < _ROUND*distances.mean():
        raise ValueError(
            f'{where}: sites: they are {distances.min()} to {distances.max()} nm from their '
            f'centre; they must be on a sphere to {_ROUND} of its radius: give the blobs of a '
            'shell, such as those of multiblobSphere()')
    modes = _modes(arms/distances[:, None])
    swimming, stresslet = _responses(arms, radius, modes)
    if not min(swimming, stresslet) > 0:
        raise ValueError(
            f'{where}: sites: the modes of the shell swim with {swimming} and have {stresslet} of '
            'what a sphere has; both must be positive: give more blobs, spread evenly')
    return _units.VELOCITY.attach(B1/swimming*modes[0] + B2/stresslet*modes[1])


def _modes(radial):
    """The velocities of both modes at points of the unit sphere, for B1 = 1 and B2 = 1."""
    c = radial[:, 2:]
    first = c*radial - (0, 0, 1)
    return first, c*first


def _responses(arms, radius, modes):
    """The swimming velocity by the first mode and the stresslet by the second one, relative to
    those of a sphere with the same mobility."""
    n = len(arms)
    K = np.zeros((n, 3, 6))
    K[:, :, :3] = np.eye(3)
    for axis in range(3):
        K[:, :, 3 + axis] = np.cross(np.eye(3)[axis], arms)
    K = K.reshape(3*n, 6)
    slips = -np.stack([mode.ravel() for mode in modes], axis=1)
    solved = np.linalg.solve(_mobility(arms, radius), np.hstack([K, slips]))
    N = np.linalg.inv(K.T @ solved[:, :6])
    twists = N @ (K.T @ solved[:, 6:])
    forces = (solved[:, :6] @ twists - solved[:, 6:])[:, 1].reshape(n, 3)
    dipole = arms.T @ forces
    a = 1/(6*np.pi*N[2, 2])
    deviator = dipole[2, 2] - np.trace(dipole)/3
    return twists[2, 0]/(2/3), -deviator/(2/3)/(4*np.pi*a**2)


def _mobility(centres: Array, radius: float) -> Array:
    """The Rotne-Prager-Yamakawa matrix of equal blobs in unbounded fluid of viscosity 1."""
    n = len(centres)
    d = centres[:, None] - centres
    r = np.linalg.norm(d, axis=2)
    np.fill_diagonal(r, 1)  # anything but 0: the diagonal has its own formula
    far = r > 2*radius
    s = radius/r
    even = np.where(far, (0.75*s + 0.5*s**3), 1 - 9/(32*s))
    odd = np.where(far, (0.75*s - 1.5*s**3), 3/(32*s))
    np.fill_diagonal(even, 1)
    np.fill_diagonal(odd, 0)
    M = np.empty((n, 3, n, 3))
    for i in range(3):
        for k in range(3):
            M[:, i, :, k] = odd*d[:, :, i]*d[:, :, k]/r**2 + (even if i == k else 0)
    return M.reshape(3*n, 3*n)/(6*np.pi*radius)
