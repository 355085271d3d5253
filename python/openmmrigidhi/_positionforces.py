"""Forces of a System that depend on absolute positions."""
from __future__ import annotations

import copy
from typing import Iterator

import openmm

from ._types import Array


def external_forces(context: openmm.Context, groups: int) -> Iterator[tuple[int, Array]]:
    """The index of each CustomExternalForce in these groups, and its own forces, kJ/(mol nm)."""
    system = context.getSystem()
    state = context.getState(getPositions=True, getParameters=True)
    for index, force in enumerate(system.getForces()):
        if not isinstance(force, openmm.CustomExternalForce) or not force.getNumParticles(
        ) or not groups >> force.getForceGroup() & 1:
            continue
        alone = openmm.System()
        for _ in range(system.getNumParticles()):
            alone.addParticle(1)
        alone.addForce(copy.deepcopy(force))
        alone.setDefaultPeriodicBoxVectors(*state.getPeriodicBoxVectors())
        only = openmm.Context(alone, openmm.VerletIntegrator(1),
                              openmm.Platform.getPlatformByName('Reference'))
        only.setPositions(state.getPositions())
        for i in range(force.getNumGlobalParameters()):
            name = force.getGlobalParameterName(i)
            only.setParameter(name, state.getParameters()[name])
        yield index, only.getState(getForces=True).getForces(asNumpy=True)._value
