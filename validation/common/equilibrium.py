"""The Gibbs-Boltzmann distribution of one body above a wall, by quadrature.

Nothing depends on x, y or the turn about z. So a pose is the height h of the origin and u, the
lab's z axis in the body frame: dR dq becomes dh du. Within bins of h and of theta the grid has
Gauss-Legendre points; theta is the angle between the body's z axis and the lab's. Azimuths are
equally spaced. All functions are smooth, so the integrals over bins are good to many digits.
"""
import numpy as np
from scipy.spatial.transform import Rotation
from openmmrigidhi import analysis
from walls import KT, TEMPERATURE, Body, Replicas

POINTS_PER_BIN = 4
SWEEPS_OFF_GRID = 20


def panels(edges, points=POINTS_PER_BIN):
    """Gauss-Legendre points and weights in each interval between edges, flattened."""
    x, w = np.polynomial.legendre.leggauss(points)
    half = np.diff(edges)/2
    middle = (edges[1:] + edges[:-1])/2
    return (middle[:, None] + half[:, None]*x).ravel(), (half[:, None]*w).ravel()


class Equilibrium:
    """Probabilities of bins, averages, and poses drawn from the distribution.

    heightEdges are edges of bins of the height of the body's origin. Beyond the last edge the grid
    goes on to heights where the probability is negligible.
    """
    def __init__(self, body, heightEdges, thetaEdges, azimuths=48):
        self.body = body
        self.heightEdges, self.thetaEdges = np.asarray(heightEdges,
                                                       float), np.asarray(thetaEdges, float)
        # The bins begin at the wall, or no site is allowed below them. The grid ends 60 decay
        # lengths of the weight above the bins.
        top = self.heightEdges[-1] + 60/body.weights.sum()
        beyond = np.linspace(self.heightEdges[-1], top, 120)[1:]
        h, wh = panels(np.concatenate([self.heightEdges, beyond]))
        theta, wt = panels(self.thetaEdges)
        phi = 2*np.pi*(np.arange(azimuths) + 0.5)/azimuths
        t, p = [a.ravel() for a in np.meshgrid(theta, phi, indexing='ij')]
        self.h, self.theta = h, t
        self.up = np.stack([np.sin(t)*np.cos(p), np.sin(t)*np.sin(p), np.cos(t)], axis=1)
        weights = np.repeat(wt*np.sin(theta), azimuths)
        offsets = self.up @ body.sites.T
        density = np.empty((len(h), len(t)))
        for k, height in enumerate(h):
            density[k] = wh[k]*weights*np.exp(-body.energies(height + offsets))
        self.probability = density/density.sum()
        #: Above this height lies 1e-9 of the distribution.
        self.ceiling = self.h[np.searchsorted(np.cumsum(self.probability.sum(1)), 1 - 1e-9)]

    def heightBins(self):
        marginal = self.probability.sum(1).reshape(-1, POINTS_PER_BIN).sum(1)
        return marginal[:len(self.heightEdges) - 1]

    def thetaBins(self):
        return self.probability.sum(0).reshape(len(self.thetaEdges) - 1, -1).sum(1)

    def average(self, function):
        """The mean of function(height of the origin, up) over the distribution.

        The function gets arrays (k, 1) and (m, 3), and returns (k, m) or what broadcasts to it.
        """
        return float((self.probability*function(self.h[:, None], self.up)).sum())

    def reweighted(self, factorOfHeight):
        """Height bins and mean height of the density times a function of the height alone."""
        marginal = self.probability.sum(1)*factorOfHeight(self.h)
        marginal /= marginal.sum()
        return marginal.reshape(-1, POINTS_PER_BIN).sum(1)[:len(self.heightEdges) - 1], float(
            marginal @ self.h)

    def draw(self, random, count):
        """Independent poses: positions (count, 3) with x = y = 0, and quaternions (count, 4).

        The turn about z is random. Points of the grid are drawn, and moved off it by some Monte
        Carlo moves, which leave the distribution as it is. Without these moves, averages of
        functions that are not smooth would show the grid.
        """
        flat = self.probability.ravel()
        cumulative = np.cumsum(flat)
        chosen = np.searchsorted(cumulative, random.random(count)*cumulative[-1])
        R, q = self.poses(
            *np.unravel_index(np.minimum(chosen,
                                         len(flat) - 1), self.probability.shape), random)
        sampler = analysis.WalkerSampler(self._energies, TEMPERATURE, count, R, q,
                                         coordinates=('z', 'rotation'),
                                         seed=int(random.integers(1, 2**31 - 1)))
        sampler.burnIn(SWEEPS_OFF_GRID, progress=False)
        samples = sampler.sample(1, progress=False)
        return samples.positions._value[0], samples.orientations[0]

    def _energies(self, R, q):
        up = Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_matrix()[:, 2]
        return KT*self.body.energies(R[:, 2:] + up @ self.body.sites.T)

    def poses(self, k, m, random):
        """Poses of these heights and directions of the grid, with a random turn about z."""
        count = len(k)
        up = self.up[m]
        # Body to lab: rows are the lab's axes in the body frame.
        side = np.cross(up, np.where(abs(up[:, :1]) < 0.7, (1.0, 0, 0), (0, 1.0, 0)))
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        frames = Rotation.from_matrix(np.stack([side, np.cross(up, side), up], axis=1))
        turned = Rotation.from_rotvec(random.uniform(0, 2*np.pi, count)[:, None]*(0, 0, 1.0))*frames
        positions = np.zeros((count, 3))
        positions[:, 2] = self.h[k]
        return positions, turned.as_quat()[:, [3, 0, 1, 2]]


def rotationalPlateau(equilibrium, random, pairs=100000):
    """The rotational mean square displacement at long times, eq. 71.

    The result has mean and standard error of xx (or yy) and of zz.
    """
    first, second = (Rotation.from_quat(equilibrium.draw(random, pairs)[1][:, [1, 2, 3, 0]])
                     for _ in range(2))
    turn = (second*first.inv()).as_quat()
    u = 2*turn[:, 3:]*turn[:, :3]
    planar, normal = (u[:, 0]**2 + u[:, 1]**2)/2, u[:, 2]**2
    return {
        name: (float(v.mean()), float(v.std()/np.sqrt(pairs)))
        for name, v in (('xx', planar), ('zz', normal))
    }


def withoutDrift(equilibrium, random, heights=96, rounds=20):
    """The distribution to which a scheme without the stochastic drift tends.

    It is exp(-U/kT)/mu(h), with the mean of N_zz at each height for mu. It is exact if N_zz depends
    on the height alone and is not coupled to rotation, as for a sphere; otherwise it is an
    estimate. mu is computed at `heights` heights where there is any probability, and interpolated
    between them.
    """
    replicas = Replicas(equilibrium.body, heights, 'RandomFiniteDifference', 1.0)
    marginal = equilibrium.probability.sum(1)
    rows = np.flatnonzero(marginal > 1e-12*marginal.max())
    rows = rows[np.linspace(0, len(rows) - 1, heights).round().astype(int)]
    total = np.zeros(len(rows))
    for _ in range(rounds):
        R, q = np.empty((len(rows), 3)), np.empty((len(rows), 4))
        for k, row in enumerate(rows):
            R[k], q[k] = [
                values[0] for values in equilibrium.poses(
                    np.array([row]),
                    random.choice(len(equilibrium.up), 1, p=equilibrium.probability[row]/
                                  marginal[row]), random)
            ]
        replicas.place(R, q)
        total += replicas.mobilities()[:, 2, 2]
    P, mean = equilibrium.reweighted(lambda h: rounds/np.interp(h, equilibrium.h[rows], total))
    return {'P': np.round(P, 8), 'mean h': mean}


def averageMobility(equilibrium, functions, random, poses, atATime=32, **settings):
    """Means and standard errors of functions of the mobility over the distribution.

    The averages are over `poses` independent poses. functions maps names to f(N (n, 6, 6) times kT
    in the lab frame, A (n, 3, 3) body to lab, heights (n,)) -> (n,). Settings are those of
    Replicas.
    """
    replicas = Replicas(equilibrium.body, atATime, 'RandomFiniteDifference', 1.0, **settings)
    values = {name: [] for name in functions}
    R, q = equilibrium.draw(random, poses // atATime*atATime)
    for k in range(0, len(R), atATime):
        part = slice(k, k + atATime)
        replicas.place(R[part], q[part])
        N, A = replicas.mobilities(), Rotation.from_quat(q[part][:, [1, 2, 3, 0]]).as_matrix()
        for name, function in functions.items():
            values[name].append(function(N, A, R[part, 2]))
    values = {name: np.concatenate(v) for name, v in values.items()}
    return {
        name: (float(v.mean()), float(v.std(ddof=1)/np.sqrt(len(v))))
        for name, v in values.items()
    }


def sphereMobilities(heights, radius, viscosity):
    """Mobilities times kT (n, 6, 6) of a sphere with its centre at these heights.

    They are exact (setSphereWallMobility).
    """
    sphere = Body('sphere', np.zeros((1, 3)), np.array([radius]), np.zeros(1), np.array([], int),
                  0.0, radius, 1.0, viscosity)
    replicas = Replicas(sphere, len(heights), 'RandomFiniteDifference', 1.0, bestKnown=True)
    positions = np.zeros((len(heights), 3))
    # At contact there is no mobility.
    positions[:, 2] = np.maximum(heights, radius*(1 + 1e-9))
    replicas.place(positions, np.broadcast_to((1.0, 0, 0, 0), (len(heights), 4)))
    return replicas.mobilities()
