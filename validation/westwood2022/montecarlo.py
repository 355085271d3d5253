"""Metropolis Monte Carlo of rods between walls, in NumPy.

Many independent systems run at once. They share nothing but the sizes of moves.
"""
import numpy as np

from openmmrigidhi._quaternions import product, rotate
from openmmrigidhi.analysis._moves import StepSizes, uniform_rotations
from model import CONTACT, HALF_LENGTH, OFF_AXIS, PAIR_RANGE, PAIR_STRENGTH, SITES, wallEnergy

AXIS = np.array((0.0, 0.0, 1.0))
#: Kinds of moves of one rod. Each move is as likely as its inverse with respect to dR times Haar's
#: measure. "shift" is Gaussian along x, y, z; "turn" is about the centre; "slide" is Gaussian along
#: the rod; "mirror" takes the image in the mid-plane. (The rod has mirror planes through its axis,
#: so its image is a rod.) "mirror" takes rods from layer to layer, where moves to random places
#: would be accepted once in 1e4 trials.
MOVES = ('shift', 'turn', 'slide', 'mirror')
#: How often a rod tries "mirror" in a sweep.
MIRRORED = 0.5
ADAPTED = {
    'shift': (0.5, 20.0),
    'turn': (0.2, np.pi),
    'slide': (2.0, 50.0)
}  # first and largest sizes


def inner(u, v):
    return np.einsum('...i,...i', u, v)


def clip(values, low, high):
    return np.minimum(np.maximum(values, low), high)


def squares(u):
    return inner(u, u)


def segmentDistances2(d, u, v):
    """Squared distances between segments of half length HALF_LENGTH; arrays (n, 3).

    The segments are along unit vectors u about 0 and v about d.
    """
    b, p, r = inner(u, v), inner(d, u), inner(d, v)
    denominator = 1 - b*b
    # Parallel segments: any s will do for the first guess.
    s = clip(np.where(denominator > 1e-12, (p - b*r)/np.maximum(denominator, 1e-12), 0),
             -HALF_LENGTH, HALF_LENGTH)
    t = clip(s*b - r, -HALF_LENGTH, HALF_LENGTH)
    s = clip(p + t*b, -HALF_LENGTH, HALF_LENGTH)
    t = clip(s*b - r, -HALF_LENGTH, HALF_LENGTH)
    return squares(d + t[:, None]*v - s[:, None]*u)


class Systems:
    """Independent systems of one Scene, each at R (rods, 3), q (rods, 4)."""
    def __init__(self, scene, R, q, random):
        self.scene, self.random = scene, random
        self.R, self.q = np.array(R, float), np.array(q, float)
        self.count, self.rods = self.R.shape[:2]
        self.arms = rotate(self.q[:, :, None], SITES)
        self.axes = rotate(self.q, AXIS)
        self.steps = {kind: StepSizes(1, *sizes) for kind, sizes in ADAPTED.items()}
        self.tried, self.accepted = dict.fromkeys(MOVES, 0), dict.fromkeys(MOVES, 0)
        self.computeEnergies()

    def computeEnergies(self):
        everyone = np.arange(self.count)
        self.walls = wallEnergy(self.R[..., None, 1] + self.arms[..., 1], self.scene.width)
        self.pairs = np.stack([
            self.pairEnergies(everyone, i, self.R[:, i], self.arms[:, i], self.axes[:, i])
            for i in range(self.rods)
        ], axis=1)

    def energies(self):
        """Energies of the systems, kJ/mol."""
        return self.walls.sum(axis=1) + self.pairs.sum(axis=(1, 2))/2

    def pairEnergies(self, systems, i, R, arms, axes):
        """Energies of rod i with each rod, array (systems, rods).

        Rod i is taken to be at R (systems, 3), with arms (systems, 22, 3) and axes (systems, 3).
        """
        side, cutoff = self.scene.side, self.scene.cutoff
        d = self.R[systems] - R[:, None]
        d[..., ::2] -= side*np.round(d[..., ::2]/side)
        # The nearest image and the next one along x and z: a rod may meet two images of another.
        nearest, other = d*d, (side - np.abs(d))**2
        x2, z2 = (nearest[..., 0], other[..., 0]), (nearest[..., 2], other[..., 2])
        bound = (2*(HALF_LENGTH + OFF_AXIS) + cutoff)**2 - nearest[..., 1]
        bound[:, i] = 0
        near = np.stack([x2[m] + z2[n] < bound for m, n in ((0, 0), (1, 0), (0, 1), (1, 1))])
        image, k, j = np.nonzero(near)
        shifts = d[k, j]
        beyond = side*np.copysign(1, shifts)
        shifts[:, 0] -= np.where(image % 2 == 1, beyond[:, 0], 0)
        shifts[:, 2] -= np.where(image >= 2, beyond[:, 2], 0)
        close = segmentDistances2(shifts, axes[k], self.axes[systems[k],
                                                             j]) < (cutoff + 2*OFF_AXIS)**2
        k, j, shifts = k[close], j[close], shifts[close]
        # |a - b|^2 = |a|^2 + |b|^2 - 2 a.b as one product of matrices of five columns.
        a, b = np.ones((2, len(k), len(SITES), 5))
        a[..., :3] = arms[k]
        b[..., :3] = self.arms[systems[k], j] + shifts[:, None]
        a[..., 3], b[..., 4] = squares(a[..., :3]), squares(b[..., :3])
        a[..., :3] *= -2
        r2 = (a @ b.transpose(0, 2, 1)).ravel()
        inside = np.flatnonzero(r2 < cutoff**2)
        r = np.sqrt(np.maximum(r2[inside], 0))
        x = (CONTACT - r)/PAIR_RANGE
        # exp(x) beyond contact and 1 + x within: exp(min(x, 0)) + max(x, 0).
        U = PAIR_STRENGTH*(np.exp(np.minimum(x, 0)) + np.maximum(x, 0) - np.exp(
            (CONTACT - cutoff)/PAIR_RANGE))
        found = (k*self.rods + j)[inside // len(SITES)**2]
        return np.bincount(found, weights=U,
                           minlength=len(systems)*self.rods).reshape(len(systems), self.rods)

    def propose(self, kind, i):
        """R (systems, 3) and q (systems, 4) of rod i after a move."""
        R, q, n = self.R[:, i].copy(), self.q[:, i], self.count
        size = self.steps[kind].sizes[0] if kind in self.steps else None
        if kind == 'shift':
            R += size*self.random.standard_normal((n, 3))
        elif kind == 'slide':
            R += size*self.random.standard_normal((n, 1))*self.axes[:, i]
        elif kind == 'turn':
            q = product(uniform_rotations(self.random, np.full(n, size)), q)
        else:
            R[:, 1] = self.scene.width - R[:, 1]
            # y -> -y in the lab and x -> -x in the body, under which the beads are the same: half
            # turns about both, j q i.
            q = q[:, ::-1]
        return R, q/np.linalg.norm(q, axis=1, keepdims=True)

    def move(self, kind, i, adapt=False):
        """Try to move rod i of every system."""
        R, q = self.propose(kind, i)
        arms, axes = rotate(q[:, None], SITES), rotate(q, AXIS)
        walls = wallEnergy(R[:, None, 1] + arms[..., 1], self.scene.width)
        limit = self.walls[:, i] + self.pairs[:, i].sum(axis=1) + self.random.standard_exponential(
            self.count)
        # Pair energies are positive, so the energy with the walls alone may already be too high.
        systems = np.flatnonzero(walls <= limit)
        pairs = self.pairEnergies(systems, i, R[systems], arms[systems], axes[systems])
        accepted = walls[systems] + pairs.sum(axis=1) <= limit[systems]
        systems, pairs = systems[accepted], pairs[accepted]
        self.R[systems, i], self.q[systems, i] = R[systems], q[systems]
        self.arms[systems, i], self.axes[systems, i] = arms[systems], axes[systems]
        self.walls[systems, i] = walls[systems]
        self.pairs[systems, i] = pairs
        self.pairs[systems, :, i] = pairs
        self.tried[kind] += self.count
        self.accepted[kind] += len(systems)
        if kind in self.steps:
            self.steps[kind].count(0, self.count, len(systems), adapt)

    def sweep(self, adapt=False):
        """Each rod: a shift, a turn, a slide, and at times the mirror image."""
        for i in range(self.rods):
            for kind in MOVES[:3]:
                self.move(kind, i, adapt)
            if self.random.random() < MIRRORED:
                self.move('mirror', i)


def starts(scene, count, flat, random):
    """R (count, rods, 3), q (count, rods, 4): rods at random between the walls.

    They are flat or turned at random; they overlap.
    """
    R, q = np.empty((count*scene.rods, 3)), np.empty((count*scene.rods, 4))
    missing = np.arange(len(R))
    while len(missing):
        n = len(missing)
        R[missing] = random.random((n, 3))*(scene.side, scene.width, scene.side)
        q[missing] = uniform_rotations(random, np.full(n, np.pi))
        if flat:
            # About z, then the turn that takes the axis from z to x, then about y.
            a, b = np.pi*random.random((2, n))
            onto = np.broadcast_to((np.sqrt(0.5), 0, np.sqrt(0.5), 0), (n, 4))
            q[missing] = product(np.stack([np.cos(a), 0*a, np.sin(a), 0*a], axis=1),
                                 product(onto, np.stack(
                                     [np.cos(b), 0*b, 0*b, np.sin(b)], axis=1)))
        places = R[missing, None, 1] + rotate(q[missing, None], SITES)[..., 1]
        missing = missing[~np.all(
            (places > 0.5*CONTACT) & (places < scene.width - 0.5*CONTACT), axis=1)]
    return R.reshape(count, -1, 3), q.reshape(count, -1, 4)
