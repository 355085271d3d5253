"""The observables of validation/davidchack2015 against OpenMM: energies, forces, torques,
Laplacians, pressure.

The tests need OpenMM only, not the plugin. The configuration is a lattice of randomly turned
waters, jittered and minimised for a few steps. So every pair function is exercised, and no test
depends on an equilibrated liquid. All results are compared with OpenMM's Reference platform (double
precision) with the formula as printed.
"""
import os
import sys
import unittest

import numpy as np
import openmm as mm
import pytest
from scipy.spatial.transform import Rotation

sys.path.insert(
    0,
    os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "validation",
                 "davidchack2015"))
import observables  # noqa: E402
import tip4p_model as tip4p  # noqa: E402

N = 440
#: matrices that make e_k x d of d, for the rotations about three axes
GENERATORS = [np.cross(axis, np.eye(3)).T for axis in np.eye(3)]
FINE_BIN = 1e-6  # nm^2: a hundredth of the default, so that a single configuration is good to 1e-4


def reference_context(potential):
    integrator = mm.VerletIntegrator(0.001)
    return tip4p.make_context(N, integrator, potential, "Reference")


class TestTip4pObservables(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        integrator = mm.VerletIntegrator(0.001)
        integrator.setIntegrationForceGroups({0})
        fast = tip4p.make_context(N, integrator)
        fast.setPositions(tip4p.lattice_positions(N, 7))
        mm.LocalEnergyMinimizer.minimize(fast, 10.0, 60)
        cls.positions = tip4p.make_whole_rigid(
            fast.getState(getPositions=True).getPositions(asNumpy=True)._value)
        cls.context = reference_context("exact")
        cls.sums = observables.PairSums(N, FINE_BIN)
        cls.sample = cls.sums.sample(cls.positions)
        cls.coarse = observables.PairSums(N)
        cls.coarse_sample = cls.coarse.sample(cls.positions)

    def energy(self, positions, context=None):
        context = context or self.context
        context.setPositions(positions)
        return context.getState(getEnergy=True, groups={0}).getPotentialEnergy()._value

    def forces(self, positions):
        self.context.setPositions(positions)
        return observables.body_forces_and_torques(self.context, self.context.getIntegrator())

    def whole(self, positions):
        """(n, 4, 3) sites relative to the centre of mass, and the centres."""
        centre, _ = self.sums.molecules(positions)
        return positions.reshape(N, 4, 3) - centre[:, None], centre

    def moved(self, shift=None, turn=None):
        """Positions after rigid translations (n, 3) and rotations by vectors (n, 3)."""
        sites, centre = self.whole(self.positions)
        if turn is not None:
            sites = np.einsum("nij,nsj->nsi", Rotation.from_rotvec(turn).as_matrix(), sites)
        return (sites + (centre if shift is None else centre + shift)[:, None]).reshape(-1, 3)

    def test_pair_potential_derivatives(self):
        """u' and u'' agree with five-point differences on both sides of r_m, and are zero beyond
        the cut-off.
        """
        r = np.concatenate([np.linspace(0.16, 0.9499, 40), np.linspace(0.9501, 0.998, 40)])
        d = 1e-5
        difference = lambda f: (8*(f(r + d) - f(r - d)) - (f(r + 2*d) - f(r - 2*d)))/(12*d)
        for function in (tip4p.coulomb, tip4p.lennard_jones):
            u, u1, u2 = function(r)
            # Rounding of phi makes an error of 1e-15/d = 1e-10 of the bare u, which is 1e-4 at
            # 0.998 nm. The truncation d^4 u^(5)/30 is less.
            self.assertLess(
                np.max(
                    np.abs(difference(lambda x: function(x)[0]) - u1)/(np.abs(u1) + np.abs(u/r))),
                1e-8)
            self.assertLess(
                np.max(
                    np.abs(difference(lambda x: function(x)[1]) - u2)/(np.abs(u2) + np.abs(u1/r))),
                1e-8)
            self.assertTrue(all(np.all(x == 0) for x in function(np.array([1.0, 1.1]))))

    def test_energy(self):
        """The histogram gives the energy of OpenMM's formula. The default bins scatter by rounding
        of s, with negligible bias."""
        exact = self.energy(self.positions)
        self.assertLess(abs(self.sample["energy"]/exact - 1), 2e-5)
        self.assertLess(abs(self.coarse_sample["energy"]/exact - 1), 3e-3)
        # for the default bins' bias see test_bins_do_not_bias

    def test_bins_do_not_bias(self):
        """Averages over 12 jittered copies of the box are the same by default bins and by fine
        bins, within their scatter."""
        rng = np.random.default_rng(11)
        difference, both = [], (observables.PairSums(N, 1e-5), observables.PairSums(N))
        for _ in range(12):
            jittered = self.moved(shift=rng.normal(scale=2e-3, size=(N, 3)),
                                  turn=rng.normal(scale=0.02, size=(N, 3)))
            fine, coarse = (sums.sample(jittered) for sums in both)
            difference.append([
                coarse[k]/fine[k] - 1
                for k in ("energy", "virial", "laplacian_translation", "laplacian_rotation")
            ])
        mean, error = np.mean(difference, axis=0), np.std(difference, axis=0, ddof=1)/np.sqrt(12)
        print("\nbins, relative bias of energy, virial, two Laplacians:", mean, "+-", error)
        self.assertTrue(np.all(np.abs(mean) < 5*error + 1e-5))

    def test_fast_variant_energy(self):
        """NonbondedForce's direct space less its constant is the formula plus the difference that
        the histogram predicts."""
        fast = self.energy(self.positions, reference_context("fast")) - tip4p.fast_energy_offset(N)
        difference = fast - self.energy(self.positions)
        print(f"\nfast - exact: {difference:.5f} kJ/mol for the box; predicted "
              f"{self.sample['energy_fast_minus_exact']:.5f}")
        # OpenMM 7.7 interpolates erfc from a table, with an error of about 1e-6 of the direct-space
        # energy (2e4 kJ/mol).
        self.assertLess(abs(difference - self.sample["energy_fast_minus_exact"]), 0.02)

    def test_fast_variant_forces(self):
        """OpenMM's forces on the molecules differ between the variants by what phi and the two
        switches predict, pair by pair."""
        fast = reference_context("fast")
        fast.setPositions(self.positions)
        fast_force, _ = observables.body_forces_and_torques(fast, fast.getIntegrator())
        measured = fast_force - self.forces(self.positions)[0]
        sites, centre = self.whole(self.positions)
        separation = centre[:, None] - centre[None]
        separation -= self.sums.length*np.rint(separation/self.sums.length)
        expected, d = np.zeros((N, 3)), 1e-6
        for a in range(4):
            for b in range(4):
                x = separation + sites[:, None, a] - sites[None, :, b]
                r = np.linalg.norm(x, axis=2)
                shell = (r > tip4p.R_SWITCH) & (r < tip4p.R_CUT - d) & ~np.eye(N, dtype=bool)
                rs = r[shell]
                if (a, b) == (0, 0):
                    fast_u = tip4p.lennard_jones_fast
                    slope = (fast_u(rs + d) - fast_u(rs - d))/(2*d) - tip4p.lennard_jones(rs)[1]
                else:
                    slope = tip4p.CHARGES[a]*tip4p.CHARGES[b]*(tip4p.coulomb_bare(rs)[1] -
                                                               tip4p.coulomb(rs)[1])
                pair = np.zeros((N, N))
                pair[shell] = -slope/rs
                expected += np.einsum("ij,ijk->ik", pair, x)
        rms = lambda v: np.sqrt(np.mean(np.sum(v**2, axis=1)))
        print(f"\nforces, fast - exact: rms {rms(measured):.3f} kJ/(mol nm), unexplained "
              f"{rms(measured - expected):.5f}")
        # the rest is OpenMM's table of erfc
        self.assertLess(rms(measured - expected), 0.02*rms(measured))

    def test_forces_and_torques(self):
        """The force and torque on each molecule are minus the derivative of OpenMM's energy along
        rigid motions in random directions."""
        rng = np.random.default_rng(3)
        force, torque = self.forces(self.positions)
        d = 2e-5
        for kind in ("shift", "turn"):
            for _ in range(2):
                direction = rng.normal(size=(N, 3))
                plus, minus = (self.energy(self.moved(**{kind: sign*d*direction}))
                               for sign in (1, -1))
                expected = -np.sum((force if kind == "shift" else torque)*direction)
                scale = np.linalg.norm(force if kind == "shift" else torque)
                self.assertLess(abs((plus - minus)/(2*d) - expected), 1e-4*scale)

    def laplacian_by_differences(self, kind, molecules, d):
        """sum over the given molecules and 3 axes of the second derivative of OpenMM's energy along
        rigid motions, by differences of its forces (translation) or torques (rotation)."""
        total = 0.0
        for m in molecules:
            for k in range(3):
                displacement = np.zeros((N, 3))
                displacement[m, k] = d
                plus = self.forces(self.moved(**{kind: displacement}))[kind == "turn"][m, k]
                minus = self.forces(self.moved(**{kind: -displacement}))[kind == "turn"][m, k]
                total -= (plus - minus)/(2*d)
        return total

    def test_laplacians_of_single_molecules(self):
        """
        The closed form for single molecules agrees with differences of OpenMM's forces and torques.

        For two molecules the direct evaluation, with generators written out, equals the
        differences. For the whole box the histogram sums equal the sum of the direct evaluation
        over all molecules.
        """
        whole = self.whole(self.positions)
        single = np.array([self.direct_laplacians(m, *whole) for m in range(N)])
        self.assertLess(abs(self.sample["laplacian_translation"]/single[:, 0].sum() - 1), 2e-5)
        self.assertLess(abs(self.sample["laplacian_rotation"]/single[:, 1].sum() - 1), 1e-4)
        for m in (0, 439):
            translation = self.laplacian_by_differences("shift", [m], 1e-5)
            rotation = self.laplacian_by_differences("turn", [m], 1e-4)
            print(f"\nmolecule {m}: lap_r U {single[m, 0]:.4f} (differences {translation:.4f}), "
                  f"lap_omega U {single[m, 1]:.5f} (differences {rotation:.5f})")
            self.assertLess(abs(translation/single[m, 0] - 1), 1e-5)
            self.assertLess(abs(rotation - single[m, 1]), 1e-5*max(abs(single[m, 1]), 100.0))

    def direct_laplacians(self, m, sites, centre):
        """The formulas of observables.py for molecule m alone, pair by pair, without histograms."""
        separation = centre[m] - centre
        separation -= self.sums.length*np.rint(separation/self.sums.length)
        others = np.flatnonzero(np.arange(N) != m)
        translation = rotation = 0.0
        for a in range(4):
            for b in range(4):
                r_vector = separation[others] + sites[m, a] - sites[others, b]
                r = np.linalg.norm(r_vector, axis=1)
                if (a, b) == (0, 0):
                    _, u1, u2 = tip4p.lennard_jones(r)
                else:
                    _, u1, u2 = (tip4p.CHARGES[a]*tip4p.CHARGES[b]*f for f in tip4p.coulomb(r))
                d = sites[m, a]
                hessian = (np.sum(u1/r)*np.eye(3) + np.einsum("p,pi,pj->ij",
                                                              (u2 - u1/r)/r**2, r_vector, r_vector))
                slope = (u1/r) @ r_vector
                translation += np.trace(hessian)
                for generator in GENERATORS:
                    t = generator @ d
                    rotation += t @ hessian @ t + slope @ (generator @ t)
        return translation, rotation

    def test_pressure(self):
        """P_ex agrees with -dU/dV when the centres of mass, not the molecules, scale with the box.
        """
        sites, centre = self.whole(self.positions)

        def energy(factor):
            edge = self.sums.length*factor
            self.context.setPeriodicBoxVectors((edge, 0, 0), (0, edge, 0), (0, 0, edge))
            return self.energy((sites + centre[:, None]*factor).reshape(-1, 3))

        d = 1e-5
        try:
            slope = (energy(1 + d) - energy(1 - d))/(2*d)  # dU/d(ln L) = 3 V dU/dV
        finally:
            self.context.setPeriodicBoxVectors(*np.diag([self.sums.length]*3))
        expected = -slope/(3*self.sums.volume)*tip4p.MEGAPASCAL
        measured = self.sums.pressure(self.sample["virial"])
        print(f"\nP_ex {measured:.3f} MPa, -dU/dV {expected:.3f} MPa")
        self.assertLess(abs(measured - expected),
                        0.5)  # of terms of the order of 1000 MPa that cancel

    def test_rdf(self):
        """All pairs inside 1 nm are counted once, and g = 1 for points without correlation (rigid
        triplets placed at random)."""
        rng = np.random.default_rng(5)
        sums = observables.PairSums(N)
        frames = 12
        for _ in range(frames):
            turns = Rotation.random(N, random_state=rng.integers(2**31)).as_matrix()
            sites = np.einsum("nij,sj->nsi", turns, tip4p.site_coordinates())
            sums.sample((sites + rng.uniform(0, sums.length, (N, 1, 3))).reshape(-1, 3))
        for kind, multiplicity in (("OO", 1), ("OH", 4), ("HH", 4)):
            r, g = sums.rdf(kind)
            outer = (r > 0.3)
            mean = np.average(g[outer], weights=r[outer]**2)
            pairs = frames*multiplicity*N*(N - 1)/2*4/3*np.pi/sums.volume
            # sites of a molecule move together: at most `multiplicity` equal counts
            z = (mean - 1)*np.sqrt(pairs/multiplicity)
            print(f"\nrandom {kind}: g = {mean:.5f}, z = {z:.2f}")
            self.assertLess(abs(z), 5)
        brute = 0
        centre, h = self.sums.molecules(self.positions)
        for a in range(2):
            for b in range(2):
                x = (centre + h[a])[:, None] - (centre + h[b])[None]
                x -= self.sums.length*np.rint(x/self.sums.length)
                near = np.sum(x*x, axis=2) < tip4p.R_CUT**2
                brute += (near.sum() - np.trace(near))/2
        self.assertEqual(self.coarse.counts["HH"].sum(), brute)

    def test_rdf_value_and_maximum(self):
        """Fits on shells of 0.002 nm recover a peak as sharp as water's g_OH (half maxima 0.024 nm
        apart) to 0.1 %."""
        peak = lambda r: 1.5*np.exp(-0.5*(np.log((r - 0.13)/0.052)/0.2)**2)
        fine = np.linspace(0.16, 0.21, 50001)
        r = np.arange(0.141, 0.3, 0.002)
        where, height = observables.rdf_first_maximum(r, peak(r), 0.18)
        self.assertLess(abs(height/peak(fine).max() - 1), 1e-3)
        self.assertLess(abs(where - fine[np.argmax(peak(fine))]), 5e-4)
        self.assertLess(abs(observables.rdf_value(r, peak(r), 0.182)/peak(0.182) - 1), 1e-3)

    def test_too_small_a_box_is_refused(self):
        with self.assertRaisesRegex(ValueError, "at least 440"):
            observables.PairSums(439)
        with self.assertRaisesRegex(ValueError, "at least 265"):
            tip4p.make_system(200)


def plugin_or_none():
    try:
        return tip4p.import_plugin()
    except ImportError:
        return None


@unittest.skipIf(plugin_or_none() is None, "openmmrigidhi is not built")
class TestWithPlugin(unittest.TestCase):
    """The integrator's own methods give the same as the Context's positions, velocities and forces.
    """
    def check(self, scheme, platform):
        n = 265
        integrator = tip4p.make_integrator(n, scheme, 1.0, seed=3)
        context = tip4p.make_context(n, integrator, platform=platform)
        context.setPositions(tip4p.lattice_positions(n, 4))
        mm.LocalEnergyMinimizer.minimize(context, 100.0, 20)
        context.setPositions(
            tip4p.make_whole_rigid(
                context.getState(getPositions=True).getPositions(asNumpy=True)._value))
        if scheme != "gradient":
            context.setVelocitiesToTemperature(300.0, 1)
        integrator.step(5)

        class Generic:
            """Hides the integrator's own methods, so that the functions take their other branch."""

        x = context.getState(getPositions=True).getPositions(asNumpy=True)._value
        self.assertLess(np.max(np.abs(x - tip4p.make_whole_rigid(x))), 2e-6)
        if scheme != "gradient":
            for own, generic in zip(observables.body_forces_and_torques(context, integrator),
                                    observables.body_forces_and_torques(context, Generic())):
                self.assertLess(np.linalg.norm(own - generic), 1e-5*np.linalg.norm(own))
            own, generic = observables.kinetic_energies(context,
                                                        integrator), observables.kinetic_energies(
                                                            context, Generic())
            self.assertLess(np.max(np.abs(own/generic - 1)), 1e-5)

    @pytest.mark.scripts
    def test_handed_out_values(self):
        for scheme in ("A", "B", "C", "gradient"):
            with self.subTest(scheme=scheme):
                self.check(scheme, "CPU")
        self.check("C", "Reference")


class Interrupted(Exception):
    pass


@pytest.mark.scripts
def test_a_run_goes_on_where_it_was_interrupted(tmp_path, monkeypatch):
    """After an interruption validation/davidchack2015/run.py takes as many samples as without one,
    and the earlier samples are the same."""
    import run
    monkeypatch.setattr(run.campaign, "NOTES_EVERY", 0.0)
    monkeypatch.setattr(run, "BLOCKS", 6)
    spec = {
        "scheme": "C",
        "h_fs": 0.5,
        "molecules": N,
        "steps": 300,
        "equilibration_steps": 40,
        "seed": 3,
        "replica": 0,
        "potential": "fast",
        "platform": "CPU"
    }
    start = tip4p.make_whole_rigid(tip4p.lattice_positions(N, 7))

    class Job:
        directory, end = str(tmp_path), 180

        def report(self, done):
            if done > self.end:
                raise Interrupted

    with pytest.raises(Interrupted):
        run.simulate(spec, start, Job())
    job = Job()
    job.end = 1e9
    resumed, whole = run.simulate(spec, start, job), run.simulate(spec, start)
    assert resumed["rdf"]["OO"]["r_nm"] == whole["rdf"]["OO"]["r_nm"]
    for name, values in whole["blocks"].items():
        assert len(resumed["blocks"][name]) == len(values) == run.BLOCKS
        assert resumed["blocks"][name][:2] == pytest.approx(values[:2], rel=1e-6), name
    with pytest.raises(ValueError, match="begun with other settings"):
        run.simulate(dict(spec, seed=4), start, job)


if __name__ == "__main__":
    unittest.main()
