"""Czech hedgehogs in a driven fluid: Westwood 2022, section 6.4, as an OpenMM System.

Units: suspension.py.
"""
import numpy as np
import openmm

import openmmrigidhi
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce
from suspension import (CONTACT, LENGTH, PAIR_RANGE, PAIR_STRENGTH, STEP, TEMPERATURE, VISCOSITY,
                        Moving, placed)

BODIES = 1177  # in the paper's cubic box
#: Beads at the middle and at 2a, 4a, 6a on the six half axes.
SITES = np.array([(0, 0, 0)] + [
    r*np.array(e) for r in (2, 4, 6)
    for e in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
], float)
FRACTION = BODIES*len(SITES)*4/3*np.pi/LENGTH**3  # 0.2001
WELL, WIDTH = 5.0, 0.5  # A, kJ/mol, and lambda, nm, of eq. 61
#: Where the potentials end, nm: eq. 60 is 0.007 kT there. The paper does not say.
CUTOFF = 6.0
#: Places r_c and signs of the Gaussians of eqs. 62 and 63.
GAUSSIANS = {'repel-attract': ((3.0, -1),), 'repel-attract-repel': ((3.0, -1), (3.5, 1))}


def _outside(r, potential):
    """Energy and slope of eqs. 62 and 63 from contact on."""
    energy = PAIR_STRENGTH*np.exp((CONTACT - r)/PAIR_RANGE)
    slope = -energy/PAIR_RANGE
    for place, sign in GAUSSIANS[potential]:
        gauss = sign*WELL*np.exp(-((r - place)/WIDTH)**2)
        energy, slope = energy + gauss, slope - 2*(r - place)/WIDTH**2*gauss
    return energy, slope


def pairEnergy(r, potential):
    """Eqs. 62 and 63, kJ/mol, of two beads.

    From contact on the potential is as in the paper. Below contact it is a straight line. It is
    shifted to be 0 at the cut-off.
    """
    r = np.asarray(r, float)
    atContact, slope = _outside(CONTACT, potential)
    energy = np.where(r < CONTACT, atContact + slope*(r - CONTACT),
                      _outside(np.maximum(r, CONTACT), potential)[0])
    return np.where(r < CUTOFF, energy - _outside(CUTOFF, potential)[0], 0.0)


def pairForce(potential):
    """An OpenMM Force with this energy, without particles."""
    outside = ' + '.join(
        ['U0*exp((s - r)/b)'] +
        [f'({sign})*A*exp(-((r - {place})/w)^2)' for place, sign in GAUSSIANS[potential]])
    force = openmm.CustomNonbondedForce(
        f'select(step(s - r), start + slope*(r - s), {outside}) - last')
    atContact, slope = _outside(CONTACT, potential)
    for name, value in (('U0', PAIR_STRENGTH), ('b', PAIR_RANGE), ('s', CONTACT), ('A', WELL),
                        ('w', WIDTH), ('start', atContact), ('slope', slope),
                        ('last', _outside(CUTOFF, potential)[0])):
        force.addGlobalParameter(name, value)
    force.setNonbondedMethod(openmm.CustomNonbondedForce.CutoffPeriodic)
    force.setCutoffDistance(CUTOFF)
    return force


def side(bodies):
    """Edge of the cube in which this number of bodies has the paper's volume fraction, nm."""
    return LENGTH*(bodies/BODIES)**(1/3)


def forceDensity(bareShearRate, edge):
    """f0, kJ/(mol nm^4), that would drive the fluid without bodies to this shear rate, 1/tau.

    The force density is one wave in the box: gamma = f0/(k eta).
    """
    return bareShearRate*2*np.pi/edge*VISCOSITY


def beads(R, q):
    """Places (..., n, 19, 3) of beads of hedgehogs at R (..., n, 3), turned by q (..., n, 4)."""
    return placed(SITES, R, q)


class Hedgehogs(Moving):
    """Hedgehogs that move, in a Context.

    Parameters
    ----------
    bodies : int
        number of hedgehogs
    potential : str or None
        'repel-attract', 'repel-attract-repel', or None for no forces
    bareShearRate : float
        f0/(k eta) tau; None: relaxation, without noise and without a fluid that couples them
    tolerance : float
        of grid and solver
    edge : float, optional
        of the cubic box, nm; None: that of the paper's volume fraction
    """

    sites = SITES

    def __init__(self, bodies, potential, bareShearRate, tolerance=1e-2, temperature=TEMPERATURE,
                 seed=1, platform='CPU', solver=MobilityForce.Auto, step=STEP, edge=None):
        relax = bareShearRate is None
        self.bodies, self.side = bodies, edge or side(bodies)
        self.integrator = CustomRigidHIIntegrator(0 if relax else temperature, step)
        self.integrator.setScheme(CustomRigidHIIntegrator.EulerMaruyama
                                  if relax else CustomRigidHIIntegrator.DriftCorrectorFD)
        self.integrator.setDriftCorrectorScaling(CustomRigidHIIntegrator.Whole)
        self.integrator.setRandomNumberSeed(seed)
        self.fluid = MobilityForce()
        self.fluid.setViscosity(VISCOSITY)
        if relax:
            self.fluid.setModel(MobilityForce.FreeDraining)
        else:
            self.fluid.setModel(MobilityForce.ForceCoupling)
            self.fluid.setBoundary(MobilityForce.Periodic)
            self.fluid.setSolver(solver)
            self.fluid.setSolverTolerance(tolerance)
            self.fluid.setSinusoidalForceDensity(forceDensity(bareShearRate, self.side), 0, 1, 1)
        system = openmm.System()
        for _ in range(bodies):
            openmmrigidhi.app.addRigidMultiblob(system, self.integrator, self.fluid, SITES, 1.0)
        if potential is not None:
            pairs = pairForce(potential)
            for i in range(system.getNumParticles()):
                pairs.addParticle([])
                for j in range(i - i % len(SITES), i):
                    pairs.addExclusion(i, j)
            system.addForce(pairs)
        system.addForce(self.fluid)
        system.setDefaultPeriodicBoxVectors((self.side, 0, 0), (0, self.side, 0), (0, 0, self.side))
        openmmrigidhi.app.bindBodies(system, self.integrator)
        self.context = openmm.Context(system, self.integrator,
                                      openmm.Platform.getPlatformByName(platform),
                                      {'Threads': '1'} if platform == 'CPU' else {})


def atRandom(bodies, random):
    """Poses that overlap: uniform places and orientations."""
    q = random.standard_normal((bodies, 4))
    return random.random((bodies, 3))*side(bodies), q/np.linalg.norm(q, axis=1)[:, None]
