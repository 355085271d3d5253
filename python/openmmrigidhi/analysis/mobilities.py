"""A body's mobility about other points and in other frames, and its hydrodynamic centres.

Mobilities are 6 x 6 matrices of plain numbers in OpenMM's units, with rows Vx Vy Vz Wx Wy Wz and
columns Fx Fy Fz Tx Ty Tz. MobilityForce.getMobilityInContext returns such matrices: N[6*i:6*i+6,
6*i:6*i+6] is the mobility of body i. Points are relative to the point of the mobility, and in the
same frame. Functions that do not search for a point also take stacks of mobilities, of n bodies or
configurations.
"""
from __future__ import annotations

from typing import TYPE_CHECKING, Union

import numpy as np

from .. import _units
from .._types import Array, Number, Numbers
from .._quaternions import rotation_matrices

if TYPE_CHECKING:
    from openmm import unit
    import numpy.typing as npt

#: A mobility from an iterative solver is symmetric to its tolerance only.
_SYMMETRY_TOLERANCE = 1e-3


def mobilityAboutPoint(N: npt.ArrayLike, shift: Numbers) -> Array:
    """Get the mobility about another point of the body (eq. 61).

    Parameters
    ----------
    N : array-like of shape (6, 6) or (n, 6, 6)
        mobility about a point of the body, or n of them
    shift : Vec3, sequence or Quantity of shape (3,) or (n, 3)
        from the point to the new point, in the frame of N, nm; one for all mobilities, or one for
        each

    Returns
    -------
    array of shape (6, 6), or (n, 6, 6) if N or shift are n
        velocity of the new point and angular velocity, for a force and the torque about the new
        point

    Raises
    ------
    TypeError, ValueError
        if N is no symmetric matrix of finite numbers of this shape, or shift no three lengths
    """
    N = _mobility(N, 'mobilityAboutPoint', stack=True)
    shift = _one_or_each(shift, _units.LENGTH, 3, N, 'mobilityAboutPoint', 'shift')
    transfer = np.tile(np.eye(6), shift.shape[:-1] + (1, 1))
    transfer[..., :3, 3:] = -_cross(shift)  # V + W x shift
    return transfer @ N @ transfer.swapaxes(-1, -2)


def mobilityInBodyFrame(N: npt.ArrayLike, orientation: npt.ArrayLike) -> Array:
    """Get a mobility in the body's frame from the mobility in the lab frame.

    Parameters
    ----------
    N : array-like of shape (6, 6) or (n, 6, 6)
        mobility in the lab frame, or n of them
    orientation : sequence of shape (4,) or (n, 4)
        unit quaternion (w, x, y, z), body frame to lab frame, of any length but 0; one for all
        mobilities, or one for each

    Returns
    -------
    array of shape (6, 6), or (n, 6, 6) if N or orientation are n
        velocities and forces along the body axes

    Raises
    ------
    TypeError, ValueError
        if N is no symmetric matrix of finite numbers of this shape, or orientation no quaternion
    """
    N = _mobility(N, 'mobilityInBodyFrame', stack=True)
    q = _one_or_each(orientation, _units.NONE, 4, N, 'mobilityInBodyFrame', 'orientation')
    length = np.linalg.norm(q, axis=-1, keepdims=True)
    good = (0 < length) & (length < np.inf)
    if not np.all(good):
        raise ValueError(
            f'mobilityInBodyFrame: orientation: got {_first(~good[..., 0], q)}; it must be four '
            'numbers w, x, y, z, not all 0: give rows of getBodyOrientations()')
    A = rotation_matrices(q/length)
    turn = np.zeros(A.shape[:-2] + (6, 6))
    turn[..., :3, :3] = turn[..., 3:, 3:] = A.swapaxes(-1, -2)
    return turn @ N @ turn.swapaxes(-1, -2)


def centerOfMobility(N: npt.ArrayLike) -> unit.Quantity:
    """Get the centre of mobility (or diffusion) of a body (eq. 64).

    It is the only point about which the coupling block of N is symmetric. For an isolated body in
    unbounded fluid, the mean square displacement of this point is a straight line (eq. 67). Near
    walls and other bodies the point changes with the configuration.

    Parameters
    ----------
    N : array-like of shape (6, 6)
        mobility about any point of the body

    Returns
    -------
    Quantity of shape (3,)
        from that point to the centre, in the frame of N, nm

    Raises
    ------
    TypeError, ValueError
        if N is no symmetric matrix of finite numbers of this shape, or has no rotational part
    """
    N = _mobility(N, 'centerOfMobility')
    return _units.LENGTH.attach(_center_of_mobility(N, 'centerOfMobility'))


def centerOfHydrodynamicStress(N: npt.ArrayLike, tolerance: float = 1e-6) -> unit.Quantity:
    """Get the centre of hydrodynamic stress: the point where the coupling block of N vanishes.

    Bodies of enough symmetry in unbounded fluid, such as spheres, rods and ellipsoids, have this
    point. It is then the centre of mobility. Boomerangs and screws do not have it: see
    :func:`planarCenterOfHydrodynamicStress` and :func:`centerOfMobility`.

    Parameters
    ----------
    N : array-like of shape (6, 6)
        mobility about any point of the body
    tolerance : float
        the largest allowed coupling, relative to the geometric mean of the largest translational
        and rotational mobility

    Returns
    -------
    Quantity of shape (3,)
        from that point to the centre, in the frame of N, nm

    Raises
    ------
    TypeError, ValueError
        as in :func:`centerOfMobility`, and if the body has no such point
    """
    where = 'centerOfHydrodynamicStress'
    N = _mobility(N, where)
    tolerance = _units.number(tolerance, _units.NONE, where, 'tolerance')
    center = _center_of_mobility(N, where)
    about = mobilityAboutPoint(N, center)
    coupling = np.linalg.norm(about[:3, 3:], 2)/np.sqrt(
        np.linalg.norm(about[:3, :3], 2)*np.linalg.norm(about[3:, 3:], 2))
    if not coupling <= tolerance:
        raise ValueError(
            f'{where}: N: the coupling about the centre of mobility is {coupling:.3g}, above '
            f'{tolerance:g}: this body has no centre of hydrodynamic stress; take centerOfMobility '
            'or planarCenterOfHydrodynamicStress')
    return _units.LENGTH.attach(center)


def planarCenterOfHydrodynamicStress(N: npt.ArrayLike, z: Number = 0) -> unit.Quantity:
    """Get the quasi-two-dimensional centre of hydrodynamic stress (eq. 65).

    A torque about z does not move this point of the body along x and y. Each height z has one such
    point. Track it if a flat body lies flat on a wall, with z along the body's normal.

    Parameters
    ----------
    N : array-like of shape (6, 6)
        mobility about any point of the body
    z : float or Quantity
        height of the wanted point above the point of N, nm

    Returns
    -------
    Quantity of shape (3,)
        from that point to the centre, in the frame of N, nm

    Raises
    ------
    TypeError, ValueError
        if N is no symmetric matrix of finite numbers of this shape, or a torque about z does not
        turn the body about z
    """
    where = 'planarCenterOfHydrodynamicStress'
    N = _mobility(N, where)
    z = _units.number(z, _units.LENGTH, where, 'z')
    if not N[5, 5] > 0:
        raise ValueError(
            f'{where}: N: the rotational mobility about z is {N[5, 5]}; it must be positive for a '
            'torque about z: turn the frame')
    return _units.LENGTH.attach(
        np.array([-(N[5, 1] - N[5, 3]*z)/N[5, 5], (N[5, 0] + N[5, 4]*z)/N[5, 5], z]))


def planarAngleMobility(N: npt.ArrayLike, direction: Numbers) -> Union[float, Array]:
    """Get the mobility of the angle of a direction's projection onto the xy plane (eq. 93).

    The mobility times kT is the short-time diffusion coefficient of :func:`planarAngleMSD`. It
    grows without bound as the direction turns to z. Its average over orientations therefore
    diverges if nothing keeps the body flat.

    Parameters
    ----------
    N : array-like of shape (6, 6) or (n, 6, 6)
        mobility in the lab frame, or n of them
    direction : Vec3 or sequence of shape (3,) or (n, 3)
        the direction in the lab frame, of any length; one for all mobilities, or one for each

    Returns
    -------
    float, or array of shape (n,) if N or direction are n
        rad^2/ps per kJ/mol

    Raises
    ------
    TypeError, ValueError
        if N is no symmetric matrix of finite numbers of this shape, or direction is along z
    """
    N = _mobility(N, 'planarAngleMobility', stack=True)
    v = _one_or_each(direction, _units.NONE, 3, N, 'planarAngleMobility', 'direction')
    x, y, z = np.moveaxis(v, -1, 0)
    square = x**2 + y**2
    good = (0 < square) & (square < np.inf)
    if not np.all(good):
        raise ValueError(
            f'planarAngleMobility: direction: got {_first(~good, v)}; a direction along z has no '
            f'angle in the xy plane: leave it out')
    gradient = np.stack([-x*z/square, -y*z/square, np.ones_like(x)],
                        axis=-1)  # of the angle with respect to a small rotation
    result = np.einsum('...i,...ij,...j->...', gradient, N[..., 3:, 3:], gradient)
    return result if result.ndim else float(result)


def _center_of_mobility(N, where):
    coupling, rotation = N[3:, :3], N[3:, 3:]
    skew = coupling - coupling.T
    axial = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
    # D [r] + [r] D = [(tr D - D) r] for symmetric D; regular even if D is zero about one axis.
    matrix = np.trace(rotation)*np.eye(3) - rotation
    if not np.min(np.linalg.eigvalsh(matrix)) > 0:
        raise ValueError(
            f'{where}: N: its rotational part is {rotation.tolist()}; a centre needs rotational '
            'mobility about two axes or more: give the mobility of one body, 6 x 6')
    return -np.linalg.solve(matrix, axial)


def _cross(r):
    """The matrices [r] (..., 3, 3) with [r] a = r x a."""
    x, y, z = np.moveaxis(r, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([
        np.stack([zero, -z, y], axis=-1),
        np.stack([z, zero, -x], axis=-1),
        np.stack([-y, x, zero], axis=-1)
    ], axis=-2)


def _first(bad, rows):
    """The first row of an array (..., columns) that is bad."""
    return rows[bad][0] if rows.ndim > 1 else rows


def _one_or_each(values, dimension, columns, N, where, name):
    """Checked rows of numbers for mobilities (..., 6, 6): one for all, or one for each."""
    return _units.one_or_each(values, dimension, columns,
                              len(N) if N.ndim == 3 else None, where, name)


def _mobility(N, where, stack=False):
    """A checked mobility, made exactly symmetric; with `stack` also n of them, (n, 6, 6)."""
    N = _units.matrix(N, (6, 6), where, 'N', stack)
    transposed = N.swapaxes(-1, -2)
    # Translational and rotational parts have scales of their own: lengths may have any unit.
    diagonal = np.abs(np.diagonal(N, axis1=-2, axis2=-1))
    scale = np.sqrt(
        np.repeat(np.stack([diagonal[..., :3].max(-1), diagonal[..., 3:].max(-1)], axis=-1), 3,
                  axis=-1))
    if not (np.all(np.isfinite(N)) and np.all(
            np.abs(N - transposed) <= _SYMMETRY_TOLERANCE*scale[..., :, None]*scale[..., None, :])):
        raise ValueError(
            f'{where}: N: a mobility must be symmetric, with finite numbers, and is not: give rows '
            'Vx Vy Vz Wx Wy Wz and columns Fx Fy Fz Tx Ty Tz of one body')
    return (N + transposed)/2
