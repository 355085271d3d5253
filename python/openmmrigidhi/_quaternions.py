"""Quaternions (w, x, y, z) in the last axis of arrays."""
import numpy as np


def rotation_matrices(q):
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4).

    For the orientations of bodies they turn vectors of the body frame into vectors of the lab
    frame.
    """
    w, x, y, z = np.moveaxis(q, -1, 0)
    return np.stack([
        np.stack([1 - 2*(y*y + z*z), 2*(x*y - w*z), 2*(x*z + w*y)], axis=-1),
        np.stack([2*(x*y + w*z), 1 - 2*(x*x + z*z), 2*(y*z - w*x)], axis=-1),
        np.stack([2*(x*z - w*y), 2*(y*z + w*x), 1 - 2*(x*x + y*y)], axis=-1)
    ], axis=-2)


def cross(u, v):
    """Cross products; numpy's own function takes five times as long for a few vectors."""
    a, b, c = u[..., 0], u[..., 1], u[..., 2]
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    first = b*z - c*y
    result = np.empty(first.shape + (3,))
    result[..., 0], result[..., 1], result[..., 2] = first, c*x - a*z, a*y - b*x
    return result


def product(p, q):
    """Products p q: the rotation q, then p."""
    w = p[..., :1]*q[..., :1] - np.sum(p[..., 1:]*q[..., 1:], axis=-1, keepdims=True)
    v = p[..., :1]*q[..., 1:] + q[..., :1]*p[..., 1:] + cross(p[..., 1:], q[..., 1:])
    return np.concatenate([w, v], axis=-1)


def conjugate(q):
    """The inverse rotations."""
    return q*np.array([1, -1, -1, -1])


def rotate(q, v):
    """Vectors v turned by unit quaternions q, without their matrices."""
    u = q[..., 1:]
    t = 2*cross(u, v)
    return v + q[..., :1]*t + cross(u, t)
