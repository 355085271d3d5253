"""A body's mobility about other points and in other frames, and the points about which it is simplest.

Mobilities are 6 x 6 matrices of plain numbers in OpenMM's units, rows Vx Vy Vz Wx Wy Wz, columns Fx Fy Fz Tx Ty Tz, as
MobilityForce.getMobilityInContext returns them: N[6*i:6*i+6, 6*i:6*i+6] is that of body i. Points are relative to that about which the
mobility is given, and in the same frame.
"""
import numpy as np

from .. import _units
from .._quaternions import rotationMatrices

#: A mobility from an iterative solver is symmetric to its tolerance only.
_SYMMETRY_TOLERANCE = 1e-3


def mobilityAboutPoint(N, shift):
    """Get the mobility about another point of the body (eq. 61).

    Parameters
    ----------
    N : array-like of shape (6, 6)
        mobility about a point of the body
    shift : Vec3, sequence or Quantity of shape (3,)
        from that point to the new one, in the frame of N, nm

    Returns
    -------
    array of shape (6, 6)
        velocity of the new point and angular velocity, for a force and the torque about the new point

    Raises
    ------
    TypeError, ValueError
        if N is no symmetric matrix of finite numbers of this shape, or shift no three lengths
    """
    N = _mobility(N, 'mobilityAboutPoint')
    transfer = np.eye(6)
    transfer[:3, 3:] = -_cross(_units.vector(shift, _units.LENGTH, 'mobilityAboutPoint', 'shift'))  # V + W x shift
    return transfer @ N @ transfer.T


def mobilityInBodyFrame(N, orientation):
    """Get a mobility in the body's frame from that in the lab frame.

    Parameters
    ----------
    N : array-like of shape (6, 6)
        mobility in the lab frame
    orientation : sequence of shape (4,)
        unit quaternion (w, x, y, z), body frame to lab frame, of any length but 0

    Returns
    -------
    array of shape (6, 6)
        velocities and forces along the body axes

    Raises
    ------
    TypeError, ValueError
        if N is no symmetric matrix of finite numbers of this shape, or orientation no quaternion
    """
    N = _mobility(N, 'mobilityInBodyFrame')
    q = _units.sequence(orientation, _units.NONE, 'mobilityInBodyFrame', 'orientation')
    if q.shape != (4,) or not 0 < np.linalg.norm(q) < np.inf:
        raise ValueError(f'mobilityInBodyFrame: orientation: got {q}; it must be four numbers w, x, y, z, not all 0: '
                         'give one row of getBodyOrientations()')
    turn = np.kron(np.eye(2), rotationMatrices(q/np.linalg.norm(q)).T)
    return turn @ N @ turn.T


def centerOfMobility(N):
    """Get the centre of mobility (or diffusion): the one point about which the coupling block of N is symmetric (eq. 64).

    The mean square displacement of this point of an isolated body in unbounded fluid is a straight line (eq. 67). Near walls and
    other bodies the point changes with the configuration.

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
    return _units.LENGTH.attach(_centerOfMobility(N, 'centerOfMobility'))


def centerOfHydrodynamicStress(N, tolerance=1e-6):
    """Get the centre of hydrodynamic stress: the point about which the coupling block of N vanishes.

    Bodies of enough symmetry in unbounded fluid have one, spheres, rods and ellipsoids for instance; it is then the centre of mobility.
    Boomerangs and screws have none: see :func:`planarCenterOfHydrodynamicStress` and :func:`centerOfMobility`.

    Parameters
    ----------
    N : array-like of shape (6, 6)
        mobility about any point of the body
    tolerance : float
        how large the coupling may be, relative to the geometric mean of the largest translational and rotational mobility

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
    center = _centerOfMobility(N, where)
    about = mobilityAboutPoint(N, center)
    coupling = np.linalg.norm(about[:3, 3:], 2)/np.sqrt(np.linalg.norm(about[:3, :3], 2)*np.linalg.norm(about[3:, 3:], 2))
    if not coupling <= tolerance:
        raise ValueError(f'{where}: N: the coupling about the centre of mobility is {coupling:.3g}, above {tolerance:g}: this body has no '
                         'centre of hydrodynamic stress; take centerOfMobility or planarCenterOfHydrodynamicStress')
    return _units.LENGTH.attach(center)


def planarCenterOfHydrodynamicStress(N, z=0):
    """Get the quasi-two-dimensional centre: where a torque about z moves the body's point not along x and y (eq. 65).

    There is one such point at each height z. For a flat body in its frame, with z along its normal, it is the point to track if the
    body lies flat on a wall.

    Parameters
    ----------
    N : array-like of shape (6, 6)
        mobility about any point of the body
    z : float or Quantity
        height of the wanted point above that point, nm

    Returns
    -------
    Quantity of shape (3,)
        from that point to the centre, in the frame of N, nm

    Raises
    ------
    TypeError, ValueError
        if N is no symmetric matrix of finite numbers of this shape, or a torque about z does not turn the body about z
    """
    where = 'planarCenterOfHydrodynamicStress'
    N = _mobility(N, where)
    z = _units.number(z, _units.LENGTH, where, 'z')
    if not N[5, 5] > 0:
        raise ValueError(f'{where}: N: the rotational mobility about z is {N[5, 5]}; it must be positive for a torque about z: '
                         'turn the frame')
    return _units.LENGTH.attach(np.array([-(N[5, 1] - N[5, 3]*z)/N[5, 5], (N[5, 0] + N[5, 4]*z)/N[5, 5], z]))


def planarAngleMobility(N, direction):
    """Get the mobility of the angle of a direction's projection onto the xy plane (eq. 93).

    Times kT it is the short-time diffusion coefficient of :func:`planarAngleMSD`. It grows without bound as the direction turns to z:
    its average over orientations diverges if nothing keeps the body flat.

    Parameters
    ----------
    N : array-like of shape (6, 6)
        mobility in the lab frame
    direction : Vec3 or sequence of shape (3,)
        the direction in the lab frame, of any length

    Returns
    -------
    float
        rad^2/ps per kJ/mol

    Raises
    ------
    TypeError, ValueError
        if N is no symmetric matrix of finite numbers of this shape, or direction is along z
    """
    N = _mobility(N, 'planarAngleMobility')
    v = _units.vector(direction, _units.NONE, 'planarAngleMobility', 'direction')
    square = v[0]**2 + v[1]**2
    if not 0 < square < np.inf:
        raise ValueError(f'planarAngleMobility: direction: got {v}; a direction along z has no angle in the xy plane: leave it out')
    gradient = np.array([-v[0]*v[2]/square, -v[1]*v[2]/square, 1])  # of the angle with respect to a small rotation
    return float(gradient @ N[3:, 3:] @ gradient)


def _centerOfMobility(N, where):
    coupling, rotation = N[3:, :3], N[3:, 3:]
    skew = coupling - coupling.T
    axial = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
    # D [r] + [r] D = [(tr D - D) r] for symmetric D; regular even if D is zero about one axis.
    matrix = np.trace(rotation)*np.eye(3) - rotation
    if not np.min(np.linalg.eigvalsh(matrix)) > 0:
        raise ValueError(f'{where}: N: its rotational part is {rotation.tolist()}; a centre needs rotational mobility about two axes '
                         'or more: give the mobility of one body, 6 x 6')
    return -np.linalg.solve(matrix, axial)


def _cross(r):
    """The matrix [r] with [r] a = r x a."""
    return np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])


def _mobility(N, where):
    """A checked mobility, made exactly symmetric."""
    N = _units.matrix(N, (6, 6), where, 'N')
    # Translational and rotational parts have scales of their own: lengths may have any unit.
    translation, rotation = np.max(np.abs(np.diag(N)[:3])), np.max(np.abs(np.diag(N)[3:]))
    size = np.sqrt(np.outer(np.repeat([translation, rotation], 3), np.repeat([translation, rotation], 3)))
    if not (np.all(np.isfinite(N)) and np.all(np.abs(N - N.T) <= _SYMMETRY_TOLERANCE*size)):
        raise ValueError(f'{where}: N: a mobility must be symmetric, with finite numbers, and is not: give rows Vx Vy Vz Wx Wy Wz and '
                         'columns Fx Fy Fz Tx Ty Tz of one body')
    return (N + N.T)/2
