"""What makes a measured viscosity doubtful: spheres that do not resist strain, and forces on
absolute positions."""
import numpy as np

from .._positionforces import external_forces
from .._systems import BodyDefinitions, walls_of
from ..mobility import MobilityForce

#: Forces between bodies cancel to rounding, and those of OpenMM's PME to its tolerance, 5e-4 of the
#: force on a particle by default.
LARGEST_NET_FORCE = 1e-3
#: What a net force may change in the ratio of viscosities if the origin moves by an edge of the
#: box.
LARGEST_EFFECT_OF_ORIGIN = 1e-3


def without_resistance(context, integrator, fluid):
    """The sentence about single spheres that do not resist the strain of a flow, or None.

    Beads of polymers and other spheres that bonds connect are no such case: their forces are then
    the object.
    """
    if fluid.getModel() == MobilityForce.StokesianDynamics:
        return None
    bodies, system = BodyDefinitions(integrator), context.getSystem()
    radii = np.array([fluid.getParticleRadius(i)._value for i in range(fluid.getNumParticles())])
    isIn = radii > 0
    isFree = isIn.copy()
    isFree[bodies.members] = False
    elements = [[i for i in particles if isIn[i]] for particles in bodies.particles]
    elements = [each for each in elements if each] + [[i] for i in np.flatnonzero(isFree)]
    elementOf = {i: e for e, each in enumerate(elements) for i in each}
    spheres = []
    for molecule in context.getMolecules():
        inside = {elementOf[i] for i in molecule if i in elementOf}
        if len(inside) == 1 and len(elements[min(inside)]) == 1:
            spheres.append(elements[min(inside)][0])
    if not spheres:
        return None
    fraction = float(4/3*np.pi*(radii[spheres]**3).sum()/_volume(context, fluid))
    count = f'{len(spheres)} of {len(elements)}' if len(spheres) < len(elements) else 'all'
    lubrication = ('' if fluid.getLubrication() != MobilityForce.On else
                   ', and their lubrication does not act on strain')
    remedy = 'make each body of several blobs (app.multiblobSphere())'
    boundaries = MobilityForce.StokesianDynamics.traits.boundaries
    isAlone = len(spheres) == len(elements) == len(bodies) == system.getNumParticles()
    if isAlone and fluid.getBoundary().name in boundaries:
        remedy = 'use setModel(StokesianDynamics), or ' + remedy
    return (f'{count} bodies are single spheres of model {fluid.getModel().name}, which do not '
            f'resist the strain of the flow{lubrication}; the viscosity lacks their hydrodynamic '
            f'part, 2.5 times their volume fraction of {fraction:.2g} and more: {remedy}')


def _volume(context, fluid):
    """The volume of the fluid, nm^3."""
    volume = context.getState().getPeriodicBoxVolume()._value
    walls = walls_of(fluid)
    if len(walls) == 2:
        axis = walls[0][0]
        edge = context.getState().getPeriodicBoxVectors(asNumpy=True)._value[axis, axis]
        volume *= (walls[1][1] - walls[0][1])/edge
    return volume


def forces_on_positions(context, integrator, fluid):
    """The sentence about forces that depend on absolute positions, or None.

    Their virial depends on the origin.
    """
    groups = integrator.getIntegrationForceGroups()
    eta, (rate, *axes) = fluid.getViscosity()._value, fluid.getShear()
    for index, forces in external_forces(context, groups):
        if forces.any():
            found, isInPlane = (f'a CustomExternalForce (Force {index} of the System) acts on them',
                                forces[:, axes].any())
            break
    else:
        net, state = _net_force(context, groups), context.getState()
        edge = np.diag(state.getPeriodicBoxVectors(asNumpy=True)._value).max()
        effects = np.abs(net)*edge/(state.getPeriodicBoxVolume()._value*eta*abs(rate._value))
        if effects.max() <= LARGEST_EFFECT_OF_ORIGIN:
            return None
        found, isInPlane = (f'they add up to {net.round(6).tolist()} kJ/(mol nm)',
                            effects[axes].max() > LARGEST_EFFECT_OF_ORIGIN)
    wrong = 'the viscosity' if isInPlane else 'the second normal stress difference'
    return (f'the forces on bodies depend on absolute positions, because {found}; their virial '
            f'depends on the origin, so that the interparticle part of {wrong} means nothing: take '
            'such forces away before you measure, by a global parameter of 0 or a force group that '
            'setIntegrationForceGroups() leaves out')


def _net_force(context, groups):
    """The sum of the forces on all particles, or 0 where it is within errors, kJ/(mol nm)."""
    system = context.getSystem()
    forces = context.getState(getForces=True, groups=groups).getForces(asNumpy=True)._value
    # The force on a virtual site is also part of the forces on the particles that define it.
    isReal = [not system.isVirtualSite(i) for i in range(system.getNumParticles())]
    forces = forces[isReal]
    net = forces.sum(axis=0)
    return net if np.abs(net).max() > LARGEST_NET_FORCE*np.abs(forces).sum() else np.zeros(3)
