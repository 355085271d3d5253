"""What a System says about this package's Forces, and an integrator about its bodies."""
from __future__ import annotations

from typing import TYPE_CHECKING, Optional

import numpy as np

from . import _units
from ._types import Array, Numbers
from .bodymotion import CustomBodyMotion
from .mobility import MobilityForce

if TYPE_CHECKING:
    import openmm
    from .integrator import CustomRigidHIIntegrator


def forces_of(system: openmm.System, kind: type) -> list:
    """The System's forces of one of this package's classes."""
    found = []
    for force in system.getForces():
        try:
            found.append(kind.cast(force))
        except TypeError:
            pass
    return found


def hydrodynamic_radii(system: openmm.System, radii: Optional[Numbers], where: str) -> Array:
    """Radius of each particle of the System, nm.

    The radii are those given, or else those of the MobilityForce, or else 0.
    """
    count = system.getNumParticles()
    if radii is not None:
        return np.array(_units.per_site(radii, _units.LENGTH, count, where, 'radii'))
    fluids = forces_of(system, MobilityForce)
    if not fluids:
        return np.zeros(count)
    fromForce = np.array([fluids[0].getParticleRadius(i)._value for i in range(count)])
    return fromForce


def walls_of(fluid: MobilityForce) -> list[tuple[int, float, int]]:
    """The walls of a fluid: the axis across each, where it is (nm), and the side of the fluid."""
    traits = fluid.getBoundary().traits
    if traits.numWalls == 0:
        return []
    places = (fluid.getWallHeight(),) if traits.numWalls == 1 else fluid.getChannelWalls()
    return [(traits.wallAxis, place._value, side) for place, side in zip(places, (1, -1))]


def refuse_driven_flow(system: openmm.System, where: str, consequence: str) -> None:
    """Refuse a System that a flow or moving bodies drive, where equilibrium is assumed.

    The text consequence says what is wrong then, and what to do instead.
    """
    if any(motion.getNumBodies() for motion in forces_of(system, CustomBodyMotion)):
        raise ValueError(
            f'{where}: a CustomBodyMotion prescribes how bodies move; the System has no '
            f'equilibrium beside such bodies, {consequence}, or remove the CustomBodyMotion')
    for fluid in forces_of(system, MobilityForce):
        velocity, gradient = (quantity._value for quantity in fluid.getBackgroundFlow())
        f0 = fluid.getSinusoidalForceDensity()[0]._value
        if fluid.getNumBodyForcesOnFluid() > 0:
            raise ValueError(
                f'{where}: body {fluid.getBodyForceOnFluidParameters(0)[0]} exerts a force on the '
                f'fluid by addBodyForceOnFluid(); the System has no equilibrium beside bodies that '
                f'swim, {consequence}, or make a MobilityForce without this force')
        if len(fluid.getBodiesWithSlip()) > 0:
            raise ValueError(
                f'{where}: body {fluid.getBodiesWithSlip()[0]} has a slip, which drives it and the '
                f'fluid; the System has no equilibrium beside bodies that swim, {consequence}, or '
                'take the slips away by clearBodySlip()')
        if velocity.any() or gradient.any():
            flow, setter = (f'a background flow of {velocity.tolist()} nm/ps with the gradient '
                            f'{gradient.tolist()} 1/ps', 'setBackgroundFlow()')
        elif f0:
            flow, setter = (f'a sinusoidal force density of {f0} kJ/(mol nm^4)',
                            'setSinusoidalForceDensity()')
        elif fluid.getWallVelocity()._value.any():
            flow, setter = (f'a wall of the velocity {fluid.getWallVelocity()._value.tolist()} '
                            'nm/ps', 'setWallVelocity()')
        elif fluid.getBodyForceDensity()._value.any():
            flow, setter = (f'a uniform force density of '
                            f'{fluid.getBodyForceDensity()._value.tolist()} kJ/(mol nm^4)',
                            'setBodyForceDensity()')
        elif fluid.getShear()[0]._value:
            flow, setter = f'a shear of {fluid.getShear()[0]._value}/ps', 'setShear()'
        else:
            continue
        raise ValueError(
            f'{where}: its MobilityForce drives the fluid by {flow}; the System has no equilibrium '
            f'in a driven flow, {consequence}, or take the flow away by {setter} with zeros')


def refuse_joints(integrator: CustomRigidHIIntegrator, where: str, consequence: str) -> None:
    """Refuse an integrator of jointed bodies, where bodies are moved one by one.

    The text consequence says what is wrong then, and what to do instead.
    """
    count = integrator.getNumJoints()
    if count:
        raise ValueError(
            f'{where}: its integrator has {count} joint{"s" if count > 1 else ""} between bodies, '
            f'{consequence}')


class BodyDefinitions:
    """The definitions of an integrator's bodies, whose geometry is known.

    Attributes
    ----------
    particles : list of list of int
        particles of each body
    masses : array of shape (n,)
        dalton
    moments : array of shape (n, 3)
        dalton nm^2, about the body axes
    sites : list of array of shape (particles of the body, 3)
        nm, body frame
    held : array of shape (n,)
        whether the integrator holds each body
    members, places, owners : array of shape (m,), (m, 3) and (m,)
        particles and sites of all bodies, body after body, and the body that each belongs to
    first : array of shape (n + 1,)
        where each body begins in these arrays
    """
    def __init__(self, integrator: CustomRigidHIIntegrator) -> None:
        definitions = [
            integrator.getRigidBodyParameters(i)
            for i in range(integrator.getNumRigidBodiesOfContext())
        ]
        self.particles = [particles for particles, _, _, _ in definitions]
        self.masses = np.array([mass._value for _, mass, _, _ in definitions], dtype=float)
        self.moments = np.array([moments._value for _, _, moments, _ in definitions],
                                dtype=float).reshape(-1, 3)
        self.sites = [sites._value for _, _, _, sites in definitions]
        self.held = np.array([integrator.getBodyHeld(i) for i in range(len(definitions))],
                             dtype=bool)
        self.members = np.array([i for particles in self.particles for i in particles], dtype=int)
        self.places = np.concatenate([np.empty((0, 3)), *self.sites])
        self.first = np.cumsum([0] + [len(particles) for particles in self.particles])
        self.owners = np.repeat(np.arange(len(self)), np.diff(self.first))

    def __len__(self):
        return len(self.particles)
