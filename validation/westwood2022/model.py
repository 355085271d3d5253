"""Rods between slip walls: Westwood 2022, section 6.3, as an OpenMM System and in NumPy.

The energy is also computed in NumPy. Units: suspension.py.
"""
import numpy as np
import openmm

import openmmrigidhi
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce
from openmmrigidhi._quaternions import rotate
from suspension import (CONTACT, LENGTH, PAIR_RANGE, PAIR_STRENGTH, STEP, TEMPERATURE, VISCOSITY,
                        Moving, placed)

RODS = {
    8: 64,
    4: 128,
    2: 256
}  # L/Ly: number of rods in the paper's periodic box, L x 2 Ly x L, a volume fraction of 10 %
WALL_RANGE = 2.2  # b of eq. 59, nm
WALL_STIFFNESS = 40/WALL_RANGE  # K = 40 kT/(ab), kJ/mol/nm^2
LAYERS = 11


def sites():
    """Beads of a rod along z, array (22, 3), nm.

    There are eleven layers of two beads that touch, along x and y in turn. Each bead touches both
    beads of the next layer.
    """
    k = np.arange(LAYERS)
    across = np.where((k % 2 == 0)[:, None], (1.0, 0, 0), (0, 1.0, 0))
    middle = np.stack([0*k, 0*k, np.sqrt(2)*(k - (LAYERS - 1)/2)], axis=1)
    return np.stack([middle - across, middle + across], axis=1).reshape(-1, 3)


SITES = sites()
#: From the centre of a rod to the outermost layer of beads, and from its axis to beads.
HALF_LENGTH, OFF_AXIS = SITES[:, 2].max(), 1.0


def pairEnergy(r, cutoff):
    """Eq. 60, shifted to be 0 at the cut-off: it is the energy of forces that end there."""
    def U(r):
        return PAIR_STRENGTH*np.where(r < CONTACT, 1 +
                                      (CONTACT - r)/PAIR_RANGE, np.exp((CONTACT - r)/PAIR_RANGE))

    return np.where(r < cutoff, U(r) - U(cutoff), 0.0)


def wallEnergy(y, width):
    """Eq. 59 of beads at these heights, summed over the last axis.

    It is infinite for centres that are not between the walls.
    """
    energy = 0.5*WALL_STIFFNESS*(np.maximum(WALL_RANGE - y, 0)**2 +
                                 np.maximum(WALL_RANGE - (width - y), 0)**2).sum(axis=-1)
    return np.where(np.all((y > 0) & (y < width), axis=-1), energy, np.inf)


def beads(R, q):
    """Places (..., n, 22, 3) of the beads of rods at R (..., n, 3), turned by q (..., n, 4)."""
    return placed(SITES, R, q)


class Scene:
    """The simulated scene: a width, a cut-off, and the part of the paper's box along x and z.

    Attributes
    ----------
    width, side, cutoff : float
        Ly; the period along x and z; where eq. 60 ends; nm
    rods : int
        the number that keeps the paper's density
    """
    def __init__(self, fraction, cutoff, part=0.5):
        self.fraction, self.cutoff, self.part = fraction, cutoff, part
        self.width, self.side = LENGTH/fraction, LENGTH*part
        self.rods = round(RODS[fraction]*part**2)
        if not abs(self.rods/(RODS[fraction]*part**2) -
                   1) < 1e-9 or self.side < 2*(HALF_LENGTH + OFF_AXIS) + cutoff:
            raise SystemExit(
                f'--part {part}: {RODS[fraction]*part**2:g} rods in a box of {self.side:.2f} a; '
                f'there must be a whole number of rods, and '
                'a box in which no rod meets itself: give 0.5, 0.75 or 1')
        self.name = f'L{fraction}_cutoff{cutoff:g}' + ('' if part == 0.5 else f'_part{part:g}')

    def describe(self):
        return {
            'width_over_L': 1/self.fraction,
            'width': self.width,
            'side': self.side,
            'rods': self.rods,
            'cutoff': self.cutoff,
            'rods_of_paper': RODS[self.fraction],
            'side_of_paper': LENGTH
        }

    def energy(self, R, q):
        """Energies (...,) of configurations R (..., n, 3), q (..., n, 4), bead by bead, kJ/mol.

        This plain form is for checks; montecarlo.py is the fast one.
        """
        x = beads(np.asarray(R, float), np.asarray(q, float))
        total = wallEnergy(x[..., 1], self.width).sum(axis=-1)
        for i in range(x.shape[-3]):
            for j in range(i):
                d = x[..., i, :, None, :] - x[..., j, None, :, :]
                d[..., ::2] -= self.side*np.round(d[..., ::2]/self.side)
                total = total + pairEnergy(np.linalg.norm(d, axis=-1),
                                           self.cutoff).sum(axis=(-1, -2))
        return total

    def system(self, integrator, tolerance, solver=MobilityForce.Auto):
        """The System and its MobilityForce; the rods are added to the integrator."""
        system, fluid = openmm.System(), MobilityForce()
        fluid.setModel(MobilityForce.ForceCoupling)
        fluid.setBoundary(MobilityForce.SlipChannel)
        fluid.setChannelWalls(0, self.width)
        fluid.setViscosity(VISCOSITY)
        fluid.setSolver(solver)
        fluid.setSolverTolerance(tolerance)
        for _ in range(self.rods):
            openmmrigidhi.app.addRigidMultiblob(system, integrator, fluid, SITES, 1.0)
        walls = openmm.CustomExternalForce(
            'K/2*(max(0, reach - y)^2 + max(0, reach - (width - y))^2)')
        for name, value in (('K', WALL_STIFFNESS), ('reach', WALL_RANGE), ('width', self.width)):
            walls.addGlobalParameter(name, value)
        pairs = openmm.CustomNonbondedForce(
            'U0*(select(step(s - r), 1 + (s - r)/b, exp((s - r)/b)) - exp((s - end)/b))')
        for name, value in (('U0', PAIR_STRENGTH), ('b', PAIR_RANGE), ('s', CONTACT),
                            ('end', self.cutoff)):
            pairs.addGlobalParameter(name, value)
        pairs.setNonbondedMethod(openmm.CustomNonbondedForce.CutoffPeriodic)
        pairs.setCutoffDistance(self.cutoff)
        for i in range(system.getNumParticles()):
            walls.addParticle(i, [])
            pairs.addParticle([])
            for j in range(i - i % len(SITES), i):
                pairs.addExclusion(i, j)
        for force in (walls, pairs, fluid):
            system.addForce(force)
        # Along y no interaction may reach through the walls.
        system.setDefaultPeriodicBoxVectors((self.side, 0, 0), (0, self.width + 2*self.cutoff, 0),
                                            (0, 0, self.side))
        openmmrigidhi.app.bindBodies(system, integrator)
        return system, fluid


class Rods(Moving):
    """Rods that move, in a Context.

    Parameters
    ----------
    scheme : str
        of the integrator; DriftCorrectorFD is the paper's gDC
    """

    sites = SITES

    def __init__(self, scene, scheme='DriftCorrectorFD', scaling='Whole', step=STEP, tolerance=1e-3,
                 seed=1, platform='CPU', solver=MobilityForce.Auto):
        self.integrator = CustomRigidHIIntegrator(TEMPERATURE, step)
        self.integrator.setScheme(getattr(CustomRigidHIIntegrator, scheme))
        self.integrator.setDriftCorrectorScaling(getattr(CustomRigidHIIntegrator, scaling))
        # Repulsions are soft: beads may reach through a wall, centres may not.
        self.integrator.setWallRejection(CustomRigidHIIntegrator.Crossing)
        self.integrator.setRandomNumberSeed(seed)
        system, self.fluid = scene.system(self.integrator, tolerance, solver)
        properties = {'Threads': '1'} if platform == 'CPU' else {}
        self.context = openmm.Context(system, self.integrator,
                                      openmm.Platform.getPlatformByName(platform), properties)


def heights(R):
    return R[..., 1]


def angles(q):
    """Angles between rods and the walls, 0 to pi/2."""
    return np.arcsin(np.minimum(1, np.abs(rotate(q, np.array((0.0, 0, 1)))[..., 1])))
