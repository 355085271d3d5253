"""The rigid bodies of a scene, for integrators that know particles only."""
from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import openmm

from .._types import Array

if TYPE_CHECKING:
    from .scenes import Scene


class BodyTable:
    """Bodies as OpenMM's own integrators see them: particles with masses.

    Computations are vectorised over bodies of equal size. A moment below 1e-9 of the largest counts
    as zero here, since positions that constraints hold are not exactly on a line.
    """

    smallestMoment = 1e-9

    def __init__(self, scene: Scene) -> None:
        masses = np.array(
            [scene.system.getParticleMass(i)._value for i in range(scene.system.getNumParticles())])
        sizes = {}
        for body in scene.bodies:
            massive = [i for i in body if masses[i] > 0]
            sizes.setdefault(len(massive), []).append(massive)
        self.groups = [(np.array(members), masses[np.array(members)]) for members in sizes.values()]
        removed = 3*any(
            isinstance(force, openmm.CMMotionRemover) for force in scene.system.getForces())
        live = np.zeros(3, dtype=int)
        for members, mass in self.groups:
            moments = np.linalg.eigvalsh(self._inertia(scene.positions[members], mass))
            live += (moments > self.smallestMoment*moments[:, 2:]).sum(axis=0)
        inBodies = sum(mass.sum() for _, mass in self.groups)
        self.massFraction = inBodies/masses.sum()
        self.degrees = {
            'translational': 3*len(scene.bodies),
            'rotational1': int(live[0]),
            'rotational2': int(live[1]),
            'rotational3': int(live[2]),
            'removed': removed
        }

    @staticmethod
    def _inertia(positions, mass):
        centre = np.einsum('bk,bki->bi', mass, positions)/mass.sum(axis=1)[:, None]
        arms = positions - centre[:, None, :]
        second = np.einsum('bk,bki,bkj->bij', mass, arms, arms)
        return np.trace(second, axis1=1, axis2=2)[:, None, None]*np.eye(3) - second

    def kineticEnergies(self, positions: Array, velocities: Array) -> Array:
        """As Sample.kineticEnergies, from particle positions (nm) and velocities (nm/ps)."""
        total = np.zeros(4)
        for members, mass in self.groups:
            x, v = positions[members], velocities[members]
            whole = mass.sum(axis=1)
            velocity = np.einsum('bk,bki->bi', mass, v)/whole[:, None]
            centre = np.einsum('bk,bki->bi', mass, x)/whole[:, None]
            angular = np.einsum('bk,bki->bi', mass,
                                np.cross(x - centre[:, None], v - velocity[:, None]))
            moments, axes = np.linalg.eigh(self._inertia(x, mass))
            about = np.einsum('bij,bi->bj', axes, angular)
            alive = moments > self.smallestMoment*moments[:, 2:]
            total[0] += 0.5*(whole*(velocity**2).sum(axis=1)).sum()
            total[1:] += (0.5*np.where(alive, about**2/np.where(alive, moments, 1), 0)).sum(axis=0)
        return total
