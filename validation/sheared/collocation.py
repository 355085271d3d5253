"""The friction of two rigid spheres side by side above a no-slip wall, nearly exact.

Point forces inside the spheres, each with its image of the wall (Blake 1971), make a flow that is
fitted to rigid motions on the surfaces by least squares: the method of fundamental solutions. Its
error falls exponentially with the square root of the number of points. Two mirror planes split the
problem into four. Units: radius 1, viscosity 1/(6 pi).
"""
import numpy as np
import scipy.linalg

VISCOSITY = 1/(6*np.pi)
#: Modes of a sphere (velocities x y z, angular velocities x y z) by their parity in the plane of
#: the centres, y = 0.
EVEN, ODD = (0, 2, 4), (1, 3, 5)


def blake(x, y):
    """Velocities at x (m, 3) by unit forces at y (n, 3) above the wall z = 0, as (m, 3, n, 3)."""
    d = x[:, None] - y
    D = d.copy()
    h = y[:, 2]
    D[..., 2] += 2*h
    r, R = np.linalg.norm(d, axis=-1), np.linalg.norm(D, axis=-1)
    G = np.empty((len(x), 3, len(y), 3))
    for i in range(3):
        for j in range(3):
            same = float(i == j)
            value = same/r + d[..., i]*d[..., j]/r**3 - same/R - D[..., i]*D[..., j]/R**3
            # The image's doublets: the derivative along j, with the other sign across the wall.
            sign = -1 if j == 2 else 1
            source = h*(same/R**3 - 3*D[..., i]*D[..., j]/R**5)
            stokeslet = (-float(i == 2)*D[..., j]/R**3 + same*D[..., 2]/R**3 +
                         float(j == 2)*D[..., i]/R**3 - 3*D[..., i]*D[..., 2]*D[..., j]/R**5)
            G[:, i, :, j] = value + sign*2*h*(source - stokeslet)
    return G/(8*np.pi*VISCOSITY)


def halfSphere(count):
    """Evenly spread points (count, 3) of the unit sphere at y > 0."""
    k = np.arange(count) + 0.5
    y, angle = k/count, np.pi*(1 + 5**0.5)*k
    across = np.sqrt(1 - y*y)
    return np.stack([across*np.cos(angle), y, across*np.sin(angle)], axis=1)


def frictionOfPair(apart, height, points=500):
    """Friction (12, 12) of spheres at (0, 0, height) and (apart, 0, height).

    Rows are velocities and angular velocities of the first sphere, then of the second.

    Parameters
    ----------
    points : int
        forces within half of a sphere
    """
    # Images of the other surfaces in a sphere gather at a point; forces are between it and the
    # sphere's surface.
    gap = min(apart/2 - 1, height - 1)
    deep = 1 + gap - np.sqrt((1 + gap)**2 - 1)
    centre = np.array([-apart/2, 0, height])
    inner = centre + (1 + deep)/2*halfSphere(points)
    outer = centre + halfSphere(2*points)
    mirrors = {'x': np.array([-1.0, 1, 1]), 'y': np.array([1.0, -1, 1])}
    blocks = {
        name: blake(outer, inner*mirror)*mirror
        for name, mirror in (('1', np.ones(3)), ('x', mirrors['x']), ('y', mirrors['y']),
                             ('xy', mirrors['x']*mirrors['y']))
    }
    arm = outer - centre
    motions = np.zeros((6, len(outer), 3))
    for axis in range(3):
        motions[axis, :, axis] = 1
        motions[3 + axis] = np.cross(np.eye(3)[axis], arm)
    sectors = {}
    for sx in (1, -1):
        R = np.zeros((6, 6))
        for modes, sy in ((EVEN, 1), (ODD, -1)):
            A = blocks['1'] + sx*blocks['x'] + sy*blocks['y'] + sx*sy*blocks['xy']
            f = scipy.linalg.lstsq(A.reshape(3*len(outer),
                                             -1), motions[list(modes)].reshape(3, -1).T, cond=1e-13,
                                   overwrite_a=True, check_finite=False,
                                   lapack_driver='gelsy')[0].T.reshape(3, -1, 3)
            # Forces of both halves; the mirrored half adds as much to the modes of this parity.
            force = 2*f.sum(axis=1)
            torque = 2*np.cross(inner - centre, f).sum(axis=1)
            for column, mode in enumerate(modes):
                total = np.append(force[column], torque[column])
                R[list(modes), mode] = total[list(modes)]
        sectors[sx] = R
    own, other = (sectors[1] + sectors[-1])/2, (sectors[1] - sectors[-1])/2
    # Mirrored in x: velocities as vectors, angular velocities with the other sign.
    P = np.diag([-1.0, 1, 1, 1, -1, -1])
    return np.block([[own, other @ P], [P @ other, P @ own @ P]])
