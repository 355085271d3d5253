"""Observables of Davidchack 2015, section VI, for the TIP4P water of tip4p_model.py.

Everything configurational is a sum over pairs of sites of different molecules i, j. Their centres
of mass are R_i, R_j, with R = R_i - R_j (nearest image). Site a is at R_i + d_a, site b at R_j +
d_b, so r = R + d_a - d_b. The pair energy is u(r):

    potential energy            sum u
    virial, COM separations     sum R . f_ab = -sum (u'/r) (r . R),   P_ex = + virial/(3 V)
    sum_j lap_{r_j} U           2 sum (u'' + 2 u'/r)
    sum_j lap_{omega_j} U       sum [(u'' + u'/r)(|d_a|^2 + |d_b|^2)
                                     - (u'' - u'/r)((r.d_a)^2 + (r.d_b)^2)/r^2
                                     - 2 (u'/r) r.(d_a - d_b)]

The last line: turning molecule i by the vector w moves site a by w x d + w x (w x d)/2. The second
derivatives with respect to the three Cartesian components of w at w = 0 thus sum up to Tr(H)|d|^2 -
d.H d - 2 d.grad u, where H is the Hessian of u. (The paper prints P_ex with a minus sign, a
misprint: its table has the + convention.)

Method: each sum is a histogram over s = r^2 with one of three weights (1, (r.d_a)^2 + (r.d_b)^2,
r.R) times a function of s at the bin centres. A bin of 1e-4 nm^2 changes averages by less than 1e-5
of their value: (bin/s)^2/24 times 42 to 56 for Lennard-Jones at 0.25 nm, the steepest case that
matters, where s = 0.0625. The same counts give the RDFs. Three scalar products per pair of
molecules suffice, because all sites are combinations of d_H1 and d_H2.
"""
import numpy as np

import tip4p_model as tip4p

# site = a1 d_H1 + a2 d_H2 about the centre of mass
_WEIGHT_O = -tip4p.MASS_H/tip4p.MASS_O
_WEIGHT_M = tip4p.W_M + (1 - 2*tip4p.W_M)*_WEIGHT_O
_COMBINATION = {
    "O": (_WEIGHT_O, _WEIGHT_O),
    "H1": (1.0, 0.0),
    "H2": (0.0, 1.0),
    "M": (_WEIGHT_M, _WEIGHT_M)
}
_SQUARED_LENGTH = dict(zip(tip4p.SITE_NAMES, np.sum(tip4p.site_coordinates()**2, axis=1)))
_PAIRS = {
    "OO": [("O", "O")],
    "HH": [("H1", "H1"), ("H1", "H2"), ("H2", "H1"), ("H2", "H2")],
    "HM": [("H1", "M"), ("H2", "M"), ("M", "H1"), ("M", "H2")],
    "MM": [("M", "M")],
    "OH": [("O", "H1"), ("O", "H2"), ("H1", "O"),
           ("H2", "O")],  # no interaction; counted for the RDF
}
_CHARGE_PRODUCT = {"HH": tip4p.CHARGE_H**2, "HM": -2*tip4p.CHARGE_H**2, "MM": 4*tip4p.CHARGE_H**2}
_SQUARED_LENGTHS = {
    kind: sum(_SQUARED_LENGTH[s] for s in pairs[0])
    for kind, pairs in _PAIRS.items()
}
RDF_POINTS = {"OO": 0.278, "OH": 0.182, "HH": 0.238}  # nm, where the paper's table evaluates them

SCALARS = ("energy", "virial", "laplacian_translation", "laplacian_rotation",
           "energy_fast_minus_exact")


class PairSums:
    """Sums over site pairs of configurations of n waters.

    bin_width: of s = r^2, nm^2.
    """
    def __init__(self, n, bin_width=1e-4):
        self.n = n
        self.length = tip4p.box_length(n)
        self.volume = self.length**3
        longest = np.sqrt(max(_SQUARED_LENGTH.values()))
        self.reach = tip4p.R_CUT + 2*longest
        if self.reach > self.length/2:
            raise ValueError(
                f"{n} molecules: half the box, {self.length / 2:.3f} nm, is less than the cutoff "
                f"plus two molecular radii, {self.reach:.3f} nm, so nearest images of molecules "
                "miss pairs of sites: take at least 440")
        self.bins = int(round(tip4p.R_CUT**2/bin_width))
        self.bin_width = tip4p.R_CUT**2/self.bins
        self.s = (np.arange(self.bins) + 0.5)*self.bin_width
        self.counts = {kind: np.zeros(self.bins)
                       for kind in ("OO", "OH", "HH")}  # accumulated for the RDFs
        self.samples = 0
        self._i, self._j = (k.astype(np.int32) for k in np.triu_indices(n, 1))
        r = np.sqrt(self.s)
        self._functions = {}
        for kind in ("OO", "HH", "HM", "MM"):
            if kind == "OO":
                u, u1, u2 = tip4p.lennard_jones(r)
                difference = tip4p.lennard_jones_fast(r) - u
            else:
                u, u1, u2 = (_CHARGE_PRODUCT[kind]*f for f in tip4p.coulomb(r))
                difference = _CHARGE_PRODUCT[kind]*tip4p.coulomb_fast(r) - u
            g = u1/r
            square = _SQUARED_LENGTHS[kind]
            # rows: what a count, a squared projection and an r.R contribute to each of SCALARS
            # (r.(d_a - d_b) = s - r.R)
            zero = np.zeros_like(r)
            self._functions[kind] = (np.array(
                [u, zero, 2*(u2 + 2*g), (u2 + g)*square - 2*g*self.s,
                 difference]), -(u2 - g)/self.s, np.array([-g, 2*g]))

    def molecules(self, positions):
        """Centres of mass (n, 3) and d_H1, d_H2 (2, n, 3) of whole molecules, nm.

        positions: (4 n, 3), nm.
        """
        x = np.asarray(positions).reshape(self.n, 4, 3)
        centre = (tip4p.MASS_O*x[:, 0] + tip4p.MASS_H*(x[:, 1] + x[:, 2]))/tip4p.MASS
        return centre, np.stack([x[:, 1] - centre, x[:, 2] - centre])

    def sample(self, positions):
        """Add the configuration to the RDFs; return its SCALARS in kJ/mol and nm."""
        centre, hydrogens = self.molecules(positions)
        i, j, separation = self._molecule_pairs(centre)
        square = np.einsum("kp,kp->p", separation, separation)
        left = [np.ascontiguousarray(h[i].T)
                for h in hydrogens]  # d_H1, d_H2 of molecule i, (3, pairs)
        right = [np.ascontiguousarray(h[j].T) for h in hydrogens]
        dot = lambda a, b: np.einsum("kp,kp->p", a, b)
        along_left = [dot(separation, d) for d in left]  # R . d
        along_right = [dot(separation, d) for d in right]
        mutual = [[dot(a, b) for b in right] for a in left]  # d_i . d_j
        combine = lambda name, values: (values[0] if name == "H1" else values[1]
                                        if name == "H2" else _COMBINATION[name][0]*
                                        (values[0] + values[1]))
        site_left = {name: combine(name, along_left) for name in tip4p.SITE_NAMES}
        site_right = {name: combine(name, along_right) for name in tip4p.SITE_NAMES}
        half = {
            name: [combine(name, [mutual[0][b], mutual[1][b]]) for b in (0, 1)]
            for name in tip4p.SITE_NAMES
        }
        result = np.zeros(len(SCALARS))
        for kind, pairs in _PAIRS.items():
            counts, projections, virials = np.zeros(self.bins), np.zeros(self.bins), np.zeros(
                self.bins)
            for a, b in pairs:
                cross = combine(b, half[a])
                p = site_left[a] - cross
                p += _SQUARED_LENGTH[a]  # r . d_a
                q = site_right[b] + cross
                q -= _SQUARED_LENGTH[b]  # r . d_b
                v = square + site_left[a]
                v -= site_right[b]  # r . R
                s = v + p
                s -= q  # r . r
                bin_index = (s*(1/self.bin_width)).astype(np.int32)
                near = np.flatnonzero(bin_index < self.bins)
                bin_index = bin_index[near]
                counts += np.bincount(bin_index, minlength=self.bins)
                if kind != "OH":
                    p *= p
                    q *= q
                    p += q
                    projections += np.bincount(bin_index, p[near], minlength=self.bins)
                    virials += np.bincount(bin_index, v[near], minlength=self.bins)
            if kind != "OH":
                by_count, by_projection, by_virial = self._functions[kind]
                result += by_count @ counts
                result[3] += by_projection @ projections
                result[[1, 3]] += by_virial @ virials
            if kind in self.counts:
                self.counts[kind] += counts
        self.samples += 1
        return dict(zip(SCALARS, result))

    def _molecule_pairs(self, centre):
        """Pairs (i, j) within reach and R_i - R_j, nearest image, (3, pairs)."""
        c = np.ascontiguousarray(centre.T/self.length)
        separation = c[:, self._i] - c[:, self._j]
        separation -= np.rint(separation)
        near = np.flatnonzero(
            np.einsum("kp,kp->p", separation, separation) < (self.reach/self.length)**2)
        return self._i[near], self._j[near], separation[:, near]*self.length

    def pressure(self, virial):
        """Excess pressure from SCALARS' virial, MPa."""
        return virial/(3*self.volume)*tip4p.MEGAPASCAL

    def rdf(self, kind, counts=None, samples=None):
        """Radial distribution function of `kind` ("OO", "OH", "HH"): (r, g).

        r are the centres of shells about 0.002 nm thick, nm. g is that of pairs of different
        molecules, from the configurations sampled so far (or the given counts).
        """
        counts = self.counts[kind] if counts is None else counts
        samples = self.samples if samples is None else samples
        edges_r = np.arange(0.1, tip4p.R_CUT - 1e-9, 0.002)
        edges = np.unique(np.rint(edges_r**2/self.bin_width).astype(int))
        number = np.add.reduceat(counts, edges)[:-1]
        shell_r = np.sqrt(edges*self.bin_width)
        shell_volume = 4/3*np.pi*np.diff(shell_r**3)
        per_sample = 0.5*self.n*(self.n - 1)*{"OO": 1, "OH": 4, "HH": 4}[kind]/self.volume
        return 0.5*(shell_r[1:] + shell_r[:-1]), number/(samples*per_sample*shell_volume)


def rdf_value(r, g, where, half_width=0.012):
    """g at `where`: value of the quartic least-squares fit to the shells within half_width (nm)."""
    near = np.abs(r - where) < half_width
    return np.polynomial.Polynomial.fit(r[near] - where, g[near], 4)(0.0)


def rdf_first_maximum(r, g, guess, half_width=0.012):
    """(position, height) of the highest maximum near `guess`, nm.

    It is the maximum of the quartic least-squares fit around the highest shell.
    """
    near = np.flatnonzero(np.abs(r - guess) < 0.03)
    top = r[near[np.argmax(np.convolve(g, np.ones(5)/5, "same")[near])]]
    window = np.abs(r - top) < half_width
    fit = np.polynomial.Polynomial.fit(r[window] - top, g[window], 4)
    fine = np.linspace(-half_width, half_width, 2001)
    best = fine[np.argmax(fit(fine))]
    return top + best, fit(best)


def body_forces_and_torques(context, integrator):
    """Force and torque about the centre of mass of every molecule: two (n, 3) arrays.

    Units are kJ/(mol nm) and kJ/mol. With this plugin's integrator they are those of its last force
    evaluation, at no cost (schemes A, B, C: at the present positions; gradient: at those before the
    last step). Otherwise they are computed from the Context's forces.
    """
    if hasattr(integrator, "getBodyForces"):
        return tuple(
            np.asarray(getattr(x, "_value", x))
            for x in (integrator.getBodyForces(), integrator.getBodyTorques()))
    state = context.getState(getPositions=True, getForces=True, groups={0})
    # OpenMM adds the force on M to O, H1 and H2 and leaves it on M: M must not be counted again.
    x = state.getPositions(asNumpy=True)._value.reshape(-1, 4, 3)[:, :3]
    f = state.getForces(asNumpy=True)._value.reshape(-1, 4, 3)[:, :3]
    mass = np.array([tip4p.MASS_O, tip4p.MASS_H, tip4p.MASS_H])
    centre = np.einsum("s,nsk->nk", mass, x)/tip4p.MASS
    return f.sum(axis=1), np.cross(x - centre[:, None], f).sum(axis=1)


def kinetic_energies(context, integrator):
    """Translational kinetic energy and the three rotational ones, kJ/mol, summed over molecules.

    The rotational energies are sorted by moment of inertia, smallest first. With this plugin's
    integrator they come from its momenta, otherwise from the Context's velocities.
    """
    if hasattr(integrator, "computeRotationalKineticEnergies"):
        values = [
            integrator.computeTranslationalKineticEnergy(),
            *integrator.computeRotationalKineticEnergies()
        ]
        return np.array([float(getattr(v, "_value", v)) for v in values])
    state = context.getState(getPositions=True, getVelocities=True)
    x = state.getPositions(asNumpy=True)._value.reshape(-1, 4, 3)[:, :3]
    v = state.getVelocities(asNumpy=True)._value.reshape(-1, 4, 3)[:, :3]
    mass = np.array([tip4p.MASS_O, tip4p.MASS_H, tip4p.MASS_H])
    centre, drift = (np.einsum("s,nsk->nk", mass, y)/tip4p.MASS for y in (x, v))
    momentum = np.einsum("s,nsk->nk", mass, np.cross(x - centre[:, None], v - drift[:, None]))
    frame_x = x[:, 1] - x[:, 2]  # H-H
    frame_z = x[:, 1] + x[:, 2] - 2*x[:, 0]  # the symmetry axis
    axes = [frame_x, frame_z, np.cross(frame_z, frame_x)]
    sites = tip4p.site_coordinates()[:3]
    moments = [np.sum(mass*(np.sum(sites**2, axis=1) - sites[:, k]**2)) for k in (0, 2, 1)]
    energies = [
        0.5/moment*np.sum((np.einsum("nk,nk->n", momentum, axis)/np.linalg.norm(axis, axis=1))**2)
        for moment, axis in zip(moments, axes)
    ]
    return np.array([0.5*tip4p.MASS*np.sum(drift**2), *(energies[k] for k in np.argsort(moments))])
