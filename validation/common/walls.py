"""Rigid bodies of blobs above a no-slip wall: definitions, energies, replicas in a Context.

Units: the lengths of the papers (um, or blob radii) are used as OpenMM's nm, their times as ps. kT
is 1 kJ/mol, so energies are in kT. Only kT/viscosity enters the dynamics: a viscosity of eta is
given as kT/eta, in length^3/time.
"""
import dataclasses

import numpy as np
import openmm
from openmm import unit

import openmmrigidhi
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce

KT = 1.0
TEMPERATURE = KT/unit.MOLAR_GAS_CONSTANT_R.value_in_unit(unit.kilojoule_per_mole/unit.kelvin)


@dataclasses.dataclass
class Body:
    """A rigid body of blobs, with weights and a repulsion from the wall at z = 0.

    Its energy at heights z of its sites is sum_i weight_i z_i + sum_{i repelled} strength A/(z_i -
    A) exp(-(z_i - A)/debye), with the contact distance A (Delong, eq. 73).
    """

    name: str
    #: (n, 3), body frame; the origin is the tracking point of the schemes.
    sites: np.ndarray
    #: Hydrodynamic radius of each site; 0: not seen by the fluid.
    radii: np.ndarray
    weights: np.ndarray
    #: Which sites the wall repels.
    repelled: np.ndarray
    strength: float
    contact: float
    debye: float
    #: Viscosity over kT: time/length^3.
    viscosity: float

    def energies(self, heights):
        """Energies (k,), kT, at the sites' heights (k, n).

        They are infinite where a site is within its contact distance or overlaps the wall.
        """
        gap = heights[..., self.repelled] - self.contact
        allowed = np.all(gap > 0, axis=-1) & np.all(heights >= self.radii, axis=-1)
        gap = np.where(gap > 0, gap, 1.0)
        repulsion = self.strength*self.contact*(np.exp(-gap/self.debye)/gap).sum(-1)
        return np.where(allowed, heights @ self.weights + repulsion, np.inf)


class Replicas:
    """Many independent copies of one body in one Context.

    Each copy is in a group of its own, so that the copies do not interact through the fluid.

    Parameters
    ----------
    scheme : str
        its name; drift-correctors scale the whole step, as in the paper, or the noise alone if
        '+SlipOnly' follows
    side : float, optional
        period along x and y, of a boundary that has one
    """
    def __init__(self, body, count, scheme, step, seed=1, boundary='NoSlipWall',
                 platform='Reference', bestKnown=False, side=None):
        self.body = body
        self.count = count
        self.system = openmm.System()
        if side is not None:
            self.system.setDefaultPeriodicBoxVectors((side, 0, 0), (0, side, 0), (0, 0, side))
        self.integrator = CustomRigidHIIntegrator(TEMPERATURE, step)
        name, _, scaling = scheme.partition('+')
        self.integrator.setScheme(getattr(CustomRigidHIIntegrator, name))
        self.integrator.setDriftCorrectorScaling(
            getattr(CustomRigidHIIntegrator, scaling or 'Whole'))
        self.integrator.setRandomNumberSeed(seed)
        self.fluid = MobilityForce()
        self.fluid.setViscosity(body.viscosity*KT)
        self.fluid.setBoundary(getattr(MobilityForce, boundary))
        if bestKnown:
            self.fluid.setSphereWallMobility(MobilityForce.BestKnown)
        push = openmm.CustomExternalForce('w*z + s*A/(z-A)*exp(-(z-A)/B)')
        push.addGlobalParameter('A', body.contact)
        push.addGlobalParameter('B', body.debye)
        push.addPerParticleParameter('w')
        push.addPerParticleParameter('s')
        for k in range(count):
            openmmrigidhi.app.addRigidMultiblob(self.system, self.integrator, self.fluid,
                                                body.sites, body.radii)
            for i, weight in enumerate(body.weights):
                strength = body.strength if i in body.repelled else 0
                if weight or strength:
                    push.addParticle(k*len(body.sites) + i, (weight*KT, strength*KT))
        self.fluid.setGroups(range(count))
        self.system.addForce(self.fluid)
        self.system.addForce(push)
        openmmrigidhi.app.bindBodies(self.system, self.integrator)
        properties = {'Threads': '1'} if platform == 'CPU' else {}
        self.context = openmm.Context(self.system, self.integrator,
                                      openmm.Platform.getPlatformByName(platform), properties)
        self.context.setPositions(body.sites[None].repeat(count, 0).reshape(-1, 3) +
                                  (0, 0, 1e3*body.contact))

    def place(self, positions, orientations):
        """Give every copy its pose: origins (count, 3) and unit quaternions (count, 4)."""
        self.integrator.setBodyPositions(positions)
        self.integrator.setBodyOrientations(orientations)

    def poses(self):
        return self.integrator.getBodyPositions()._value, np.asarray(
            self.integrator.getBodyOrientations())

    def mobilities(self):
        """The mobility of each copy at its present pose, lab frame, times kT: (count, 6, 6)."""
        N = np.asarray(self.fluid.getMobilityInContext(self.context)).reshape(
            self.count, 6, self.count, 6)
        return KT*N[np.arange(self.count), :, np.arange(self.count)]
