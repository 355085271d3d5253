"""The water of Davidchack, Ouldridge, Tretyakov (2015), section VI, as an OpenMM System.

The paper is J. Chem. Phys. 142, 144114 (2015).

Model       original TIP4P, rigid; periodic box at 989.85 kg/m3; no Ewald sum, no dispersion
            correction. Site by site
                U = sum  [138.9 q q' erfc(alpha r)/r + A/r^12 - C/r^6] phi(z),
                phi = 1 - 10 z^3 + 15 z^4 - 6 z^5,   z = (r^2 - r_m^2)/(r_c^2 - r_m^2) in [0, 1],
            alpha = 3/nm, r_m = 0.95 nm, r_c = 1 nm. The paper does not print this formula
            ("screened", "smoothly truncated"). It was inferred by matching Table 1 with
            independent simulations.
Variants    potential="exact": this formula in a CustomNonbondedForce, double precision in every
            pair: 65 ms a step.
            potential="fast":  the direct-space part of NonbondedForce's PME with the same alpha
            and cut-off: 4 ms a step.
            They differ between r_m and r_c only. There "fast" has no phi on the charges (a jump of
            erfc(3) = 2e-5 of the bare Coulomb energy at r_c instead), and OpenMM's switch, a
            polynomial in r instead of r^2, on Lennard-Jones.
            `compare_potentials.py` measures the effect on energies, forces and averages.
Units       nm, ps, amu, kJ/mol, K, e unless a name says otherwise.
"""
import importlib
import os
import sys

import numpy as np
import openmm as mm
from openmm import app
from scipy.special import erfc
from scipy.spatial.transform import Rotation

KCAL = 4.184  # kJ
AVOGADRO = 6.02214076e23  # 1/mol
BOLTZMANN = 8.31446261815324e-3  # kJ/(mol K)
COULOMB = 138.935456  # kJ nm/(mol e^2), the value inside OpenMM 7.7's CPU and Reference platforms
MEGAPASCAL = 1e24/AVOGADRO  # MPa in one kJ/(mol nm^3): 1.6605

TEMPERATURE = 300.0
DENSITY = 989.85  # kg/m3
MASS_O, MASS_H = 15.9994, 1.00794
MASS = MASS_O + 2*MASS_H
CHARGE_H = 0.52
CHARGES = np.array([0.0, CHARGE_H, CHARGE_H, -2*CHARGE_H])  # O, H1, H2, M
R_OH, ANGLE_HOH, R_OM = 0.09572, np.deg2rad(104.52), 0.015
LJ_A = 6.0e5*KCAL*1e-12  # kJ nm^12/mol
LJ_C = 610.0*KCAL*1e-6  # kJ nm^6/mol
LJ_SIGMA = (LJ_A/LJ_C)**(1/6)
LJ_EPSILON = LJ_C**2/(4*LJ_A)
ALPHA, R_SWITCH, R_CUT = 3.0, 0.95, 1.0

# M = (1 - 2 W_M) O + W_M H1 + W_M H2
W_M = R_OM/(2*R_OH*np.cos(ANGLE_HOH/2))
SITE_NAMES = ("O", "H1", "H2", "M")
SITES_PER_MOLECULE = 4


def box_length(n):
    """Edge of the cubic box of n molecules, nm."""
    return (n*MASS/AVOGADRO/DENSITY/1e3)**(1/3)*1e9


def site_coordinates():
    """The molecule about its centre of mass: (4, 3) nm; H-H along x, symmetry axis z."""
    x, z = R_OH*np.sin(ANGLE_HOH/2), R_OH*np.cos(ANGLE_HOH/2)
    sites = np.array([[0, 0, 0], [x, 0, z], [-x, 0, z], [0, 0, R_OM]])
    return sites - np.array([0, 0, 2*MASS_H*z/MASS])


def principal_moments():
    """Moments of inertia, smallest first, amu nm^2."""
    s = site_coordinates()[:3]
    m = np.array([MASS_O, MASS_H, MASS_H])
    return np.sort([np.sum(m*(np.sum(s**2, axis=1) - s[:, k]**2)) for k in range(3)])


# ------------------------------------------------------------------------------------------------
# pair potential


def switch(r, derivatives=True):
    """phi, dphi/dr, d2phi/dr2 at distances r (nm)."""
    width = R_CUT**2 - R_SWITCH**2
    z = np.clip((r*r - R_SWITCH**2)/width, 0, 1)
    phi = 1 - z**3*(10 - 15*z + 6*z*z)
    first = -30*z**2*(1 - z)**2  # d phi/dz
    second = -60*z*(1 - z)*(1 - 2*z)
    slope = 2*r/width  # dz/dr
    return phi, first*slope, second*slope**2 + first*2/width


def _switched(r, e, e1, e2):
    phi, phi1, phi2 = switch(r)
    inside = r < R_CUT
    return (np.where(inside, e*phi, 0), np.where(inside, e1*phi + e*phi1,
                                                 0), np.where(inside, e2*phi + 2*e1*phi1 + e*phi2,
                                                              0))


def coulomb_bare(r):
    """erfc(alpha r)/r for unit charges, kJ/mol, with its first and second derivatives."""
    c = erfc(ALPHA*r)
    g = 2*ALPHA/np.sqrt(np.pi)*np.exp(-((ALPHA*r)**2))
    return (COULOMB*c/r, -COULOMB*(c/r + g)/r, COULOMB*(2*c/r**3 + 2*g/r**2 + 2*ALPHA**2*g))


def lennard_jones_bare(r):
    """A/r^12 - C/r^6 with its first and second derivatives."""
    a, c = LJ_A/r**12, LJ_C/r**6
    return a - c, (-12*a + 6*c)/r, (156*a - 42*c)/r**2


def coulomb(r):
    """The charge-charge energy for unit charges: value, first and second derivative at r."""
    return _switched(r, *coulomb_bare(r))


def lennard_jones(r):
    """The model's O-O Lennard-Jones energy: value, first and second derivative at r."""
    return _switched(r, *lennard_jones_bare(r))


def coulomb_fast(r):
    """The Coulomb energy in NonbondedForce's direct space: truncated, not switched."""
    return np.where(r < R_CUT, coulomb_bare(r)[0], 0)


def lennard_jones_fast(r):
    """NonbondedForce's own switch."""
    x = np.clip((r - R_SWITCH)/(R_CUT - R_SWITCH), 0, 1)
    return np.where(r < R_CUT, lennard_jones_bare(r)[0]*(1 - x**3*(10 - 15*x + 6*x*x)), 0)


# ------------------------------------------------------------------------------------------------
# System and Context

EXACT_EXPRESSION = ("(coulomb*q1*q2*erfc(alpha*r)/r + site1*site2*(A/r^12 - C/r^6))*phi;"
                    "phi = select(step(r - rm), 1 - z^3*(10 - 15*z + 6*z^2), 1);"
                    "z = (r^2 - rm^2)/(rc^2 - rm^2)")


def exact_force():
    """The CustomNonbondedForce of the formula in the module's docstring, without particles."""
    force = mm.CustomNonbondedForce(EXACT_EXPRESSION)
    for name, value in (("coulomb", COULOMB), ("alpha", ALPHA), ("A", LJ_A), ("C", LJ_C),
                        ("rm", R_SWITCH), ("rc", R_CUT)):
        force.addGlobalParameter(name, value)
    force.addPerParticleParameter("q")
    force.addPerParticleParameter("site")  # 1 on oxygens: Lennard-Jones
    force.setNonbondedMethod(mm.CustomNonbondedForce.CutoffPeriodic)
    force.setCutoffDistance(R_CUT)
    force.setUseLongRangeCorrection(False)
    return force


def fast_force():
    """The NonbondedForce without particles.

    Its reciprocal space is force group 1, which is never integrated.
    """
    force = mm.NonbondedForce()
    force.setNonbondedMethod(mm.NonbondedForce.PME)
    force.setPMEParameters(ALPHA, 16, 16, 16)  # the grid serves the reciprocal space only
    force.setCutoffDistance(R_CUT)
    force.setUseSwitchingFunction(True)
    force.setSwitchingDistance(R_SWITCH)
    force.setUseDispersionCorrection(False)
    force.setReciprocalSpaceForceGroup(1)
    return force


def make_system(n, potential="fast"):
    """System of n waters (particles O, H1, H2, M each) in their box.

    Only force group 0 is meant to be integrated.
    """
    length = box_length(n)
    if length < 2*R_CUT:
        raise ValueError(
            f"{n} molecules make a box of {length:.3f} nm, less than twice the cutoff: take at "
            f"least 265")
    system = mm.System()
    system.setDefaultPeriodicBoxVectors((length, 0, 0), (0, length, 0), (0, 0, length))
    force = {"fast": fast_force, "exact": exact_force}[potential]()
    for i in range(n):
        o = SITES_PER_MOLECULE*i
        for mass in (MASS_O, MASS_H, MASS_H, 0.0):
            system.addParticle(mass)
        system.addConstraint(o, o + 1, R_OH)
        system.addConstraint(o, o + 2, R_OH)
        system.addConstraint(o + 1, o + 2, 2*R_OH*np.sin(ANGLE_HOH/2))
        system.setVirtualSite(o + 3,
                              mm.ThreeParticleAverageSite(o, o + 1, o + 2, 1 - 2*W_M, W_M, W_M))
        for k in range(SITES_PER_MOLECULE):
            is_oxygen = k == 0
            if potential == "fast":
                force.addParticle(CHARGES[k], LJ_SIGMA if is_oxygen else 0.1,
                                  LJ_EPSILON if is_oxygen else 0.0)
            else:
                force.addParticle([CHARGES[k], 1.0 if is_oxygen else 0.0])
            for other in range(k):
                if potential == "fast":
                    force.addException(o + k, o + other, 0, 0.1, 0)
                else:
                    force.addExclusion(o + k, o + other)
    system.addForce(force)
    return system


def fast_energy_offset(n):
    """Energy of force group 0 of the fast variant that does not depend on coordinates, kJ/mol.

    For excluded pairs OpenMM's direct space subtracts q q' erf(alpha r)/r, which within rigid
    molecules is a constant.
    """
    s = site_coordinates()
    return -n*sum(COULOMB*CHARGES[a]*CHARGES[b]*(1 - erfc(ALPHA*d))/d for a in range(4)
                  for b in range(a) for d in [np.linalg.norm(s[a] - s[b])])


def make_topology(n):
    """Topology of n waters with OpenMM's names, for app.addRigidWater and trajectory writers."""
    topology = app.Topology()
    chain = topology.addChain()
    for _ in range(n):
        residue = topology.addResidue("HOH", chain)
        o = topology.addAtom("O", app.element.oxygen, residue)
        for name in ("H1", "H2"):
            topology.addBond(o, topology.addAtom(name, app.element.hydrogen, residue))
        topology.addAtom("M", None, residue)
    length = box_length(n)
    topology.setPeriodicBoxVectors(np.diag([length]*3))
    return topology


def import_plugin():
    """Import openmmrigidhi: installed, or from build/python or $OPENMMRIGIDHI_BUILD/python."""
    here = os.path.dirname(os.path.abspath(__file__))
    build = os.environ.get("OPENMMRIGIDHI_BUILD", os.path.join(here, "..", "..", "build"))
    for folder in (None, os.path.join(os.path.abspath(build), "python")):
        if folder and folder not in sys.path:
            sys.path.insert(0, folder)
        try:
            return importlib.import_module("openmmrigidhi")
        except ModuleNotFoundError as error:
            if error.name != "openmmrigidhi":
                raise
    raise ModuleNotFoundError(
        "openmmrigidhi is neither installed nor in build/python: run `make build` at the top of "
        "the repository, or set OPENMMRIGIDHI_BUILD to a build folder")


def make_integrator(n, scheme, step_fs, gamma=5.0, Gamma=10.0, upsilon_fs=4.0, Upsilon_fs=1.0,
                    seed=1, temperature=TEMPERATURE):
    """The integrator of one run.

    scheme: "A", "B", "C" (Langevin; gamma, Gamma in 1/ps), "gradient" (upsilon, Upsilon in fs), or
    "SETTLE" (OpenMM's LangevinMiddleIntegrator with constraints, friction gamma: what users have
    without this plugin).
    """
    if scheme == "SETTLE":
        integrator = mm.LangevinMiddleIntegrator(temperature, gamma, step_fs*1e-3)
        integrator.setConstraintTolerance(1e-6)
    else:
        plugin = import_plugin()
        integrator = plugin.CustomRigidHIIntegrator(temperature, step_fs*1e-3)
        plugin.app.addRigidWater(integrator, make_topology(n))
        integrator.setScheme({
            "A": integrator.LangevinA,
            "B": integrator.LangevinB,
            "C": integrator.LangevinC,
            "gradient": integrator.GradientThermostat
        }[scheme])
        integrator.setFriction(gamma)
        integrator.setRotationalFriction(Gamma)
        integrator.setGradientRelaxationTime(upsilon_fs*1e-3)
        integrator.setGradientRotationalRelaxationTime(Upsilon_fs*1e-3)
    integrator.setRandomNumberSeed(seed)
    integrator.setIntegrationForceGroups({0})
    return integrator


def make_context(n, integrator, potential="fast", platform="CPU", threads=1):
    """A Context for n waters; no positions yet."""
    properties = {"Threads": str(threads)} if platform == "CPU" else {}
    return mm.Context(make_system(n, potential), integrator,
                      mm.Platform.getPlatformByName(platform), properties)


# ------------------------------------------------------------------------------------------------
# start configuration


def lattice_positions(n, seed):
    """n randomly oriented waters on a cubic lattice: (4 n, 3) nm."""
    edge = int(np.ceil(n**(1/3) - 1e-9))
    cells = np.indices((edge,)*3).reshape(3, -1).T[:n]
    turns = Rotation.random(n, random_state=seed).as_matrix()
    sites = np.einsum("nij,sj->nsi", turns, site_coordinates())
    return (sites + (cells*(box_length(n)/edge))[:, None, :]).reshape(-1, 3)


def make_whole_rigid(positions):
    """Put the exact TIP4P geometry on molecules: (4 n, 3) nm.

    Their constraints hold to the solver's tolerance only.
    """
    x = np.asarray(positions, float).reshape(-1, 4, 3)
    mass = np.array([MASS_O, MASS_H, MASS_H])
    centre = np.einsum("s,nsk->nk", mass, x[:, :3])/MASS
    axis_x = x[:, 1] - x[:, 2]
    axis_x /= np.linalg.norm(axis_x, axis=1)[:, None]
    axis_z = 0.5*(x[:, 1] + x[:, 2]) - x[:, 0]
    axis_z -= np.einsum("nk,nk->n", axis_z, axis_x)[:, None]*axis_x
    axis_z /= np.linalg.norm(axis_z, axis=1)[:, None]
    frame = np.stack([axis_x, np.cross(axis_z, axis_x), axis_z], axis=-1)
    return (np.einsum("nij,sj->nsi", frame, site_coordinates()) + centre[:, None]).reshape(-1, 3)


def equilibrated_start(n, seed=20150414, picoseconds=60.0, threads=1, progress=None):
    """Liquid water at 300 K, reproducible on one machine for given n and seed: (4 n, 3), nm.

    From a lattice, after a minimisation, OpenMM's LangevinMiddleIntegrator with SETTLE runs 10 ps
    at 400 K and `picoseconds` at 300 K, step 3 fs, friction 2/ps. The plugin is not needed. This
    takes 1.5 minutes for 512 molecules on one thread.

    progress: called with the number of steps done and the total.
    """
    integrator = mm.LangevinMiddleIntegrator(400.0, 2.0, 0.0005)
    integrator.setConstraintTolerance(1e-6)
    integrator.setIntegrationForceGroups({0})
    integrator.setRandomNumberSeed(seed % 2**31)
    context = make_context(n, integrator, threads=threads)
    context.setPositions(lattice_positions(n, seed))
    mm.LocalEnergyMinimizer.minimize(context, 100.0, 200)
    context.setVelocitiesToTemperature(TEMPERATURE, seed % 2**31)
    stages = ((400.0, 0.0005, 1000), (400.0, 0.003, 3200), (TEMPERATURE, 0.003,
                                                            int(picoseconds/0.003)))
    total, done = sum(s[2] for s in stages), 0
    for temperature, step, steps in stages:
        integrator.setTemperature(temperature)
        integrator.setStepSize(step)
        while steps > 0:
            integrator.step(min(steps, 500))
            done += min(steps, 500)
            steps -= 500
            if progress:
                progress(done, total)
    return make_whole_rigid(context.getState(getPositions=True).getPositions(asNumpy=True)._value)
