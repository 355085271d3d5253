"""The rungs of the hydrodynamic ladder, and a scene's spheres in the fluid of each rung."""
from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Optional, Union

import numpy as np
import openmm

from .. import app
from .._systems import BodyDefinitions, forces_of
from ..integrator import CustomRigidHIIntegrator
from ..mobility import MobilityForce
from .mobilities import MobilitySample

if TYPE_CHECKING:
    from .scenes import Scene

#: A mobility matrix with more rows of blobs is not made, since it would take gigabytes.
LARGEST_ROWS = 8000
#: ps; nothing moves in a step so short, and forces can be asked for.
NO_STEP = 1e-9


@dataclass(frozen=True)
class Rung:
    """A model of spheres in a fluid.

    Parameters
    ----------
    name : str
    model : constant
        constant of MobilityForce
    lubrication : bool
        lubrication of StokesianDynamics
    blobs : int
        number of blobs of each sphere; 0: the sphere is one particle
    exactAlone : bool
        for multiblobs: each sphere's tensor alone is set to Stokes' by
        MobilityForce.setBodyMobility
    description : str
    """

    name: str
    model: int
    lubrication: bool = True
    blobs: int = 0
    exactAlone: bool = False
    description: str = ''

    @property
    def isBest(self) -> bool:
        """Whether the rung is exact for a pair."""
        return self.model == MobilityForce.StokesianDynamics and self.lubrication


BEST = 'FTS+lubrication'
#: Numbers of blobs of shells. A pair of the next larger shells would take minutes for each matrix.
SHELLS = (12, 42, 162, 642)
#: By name, in the order of pictures.
RUNGS = {
    rung.name: rung
    for rung in (
        Rung('FreeDraining', MobilityForce.FreeDraining, description='Stokes drag, no interaction'),
        Rung('RPY', MobilityForce.RotnePragerYamakawa,
             description='Rotne-Prager-Yamakawa with rotation'),
        Rung('ForceCoupling', MobilityForce.ForceCoupling,
             description='force coupling by Gaussians; periodic fluids only'),
        Rung('FTS', MobilityForce.StokesianDynamics, False,
             description='force, torque, stresslet; no lubrication'),
        *(Rung(f'multiblob{n}', MobilityForce.RotnePragerYamakawa, blobs=n,
               description=f'shells of {n} blobs') for n in SHELLS),
        *(Rung(f'multiblob{n}+self', MobilityForce.RotnePragerYamakawa, blobs=n, exactAlone=True,
               description=f"shells of {n} blobs, each sphere's own tensor set to Stokes'")
          for n in SHELLS),
        Rung(BEST, MobilityForce.StokesianDynamics,
             description='force, torque, stresslet and pair lubrication'),
    )
}
DEFAULT = ('FreeDraining', 'RPY', 'FTS', 'multiblob12', 'multiblob42', 'multiblob162', BEST)
#: The rungs in a periodic fluid.
PERIODIC = ('FreeDraining', 'RPY', 'ForceCoupling', 'FTS', 'multiblob12', 'multiblob42',
            'multiblob162', BEST)


def byName(name: Union[str, Rung]) -> Rung:
    """The rung of this name.

    Parameters
    ----------
    name : str or Rung

    Raises
    ------
    ValueError
        for any other name
    """
    if isinstance(name, Rung):
        return name
    if name not in RUNGS:
        raise ValueError(f'rung: got {name!r}; the hydrodynamic ladder has {", ".join(RUNGS)}')
    return RUNGS[name]


class Spheres:
    """The part of a scene that interacts with the fluid.

    It has the spheres at their start, their inertia, and the forces on them there.

    Parameters
    ----------
    scene : Scene
        its System must have a MobilityForce; each of its bodies must have one particle with a
        hydrodynamic radius, and no particle outside of the bodies may have one

    Raises
    ------
    ValueError
        for another scene
    """
    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        system = openmm.XmlSerializer.clone(scene.system)
        fluid = self._fluid(system)
        radii = np.array(
            [fluid.getParticleRadius(i)._value for i in range(fluid.getNumParticles())])
        self.groups, self.viscosity, self.boundary = fluid.getGroups().tolist(), fluid.getViscosity(
        )._value, fluid.getBoundary()
        self.minimumGap = fluid.getMinimumGap()
        self.isPeriodic = self.boundary.traits.isPeriodic
        self.wallHeight, self.walls = fluid.getWallHeight(), fluid.getChannelWalls()
        self.condition = fluid.getChannelCondition()
        if len(fluid.getBodiesWithOwnTensors()):
            raise ValueError(
                'the hydrodynamic ladder: a body has a tensor of its own; the models are compared '
                'on spheres: take it away with clearBodyTensor()')
        members = [[i for i in body if radii[i] > 0] for body in scene.bodies]
        for index, found in enumerate(members):
            if len(found) != 1:
                raise ValueError(
                    f'the hydrodynamic ladder: body {index} has {len(found)} hydrodynamic '
                    'particles; it must be a sphere, which has one: choose another scene')
        self.radii = radii[[found[0] for found in members]]
        if np.count_nonzero(radii) > len(members):
            raise ValueError(
                'the hydrodynamic ladder: a particle that is in no body has a hydrodynamic radius; '
                'all must be bodies: make it one with addRigidBody()')
        # The cheapest model is enough for geometry and forces. Mobilities do not depend on a flow
        # that drives the fluid.
        fluid.setBackgroundFlow((0, 0, 0), np.zeros((3, 3)))
        fluid.setSinusoidalForceDensity(0, 0, 1, 1)
        fluid.setWallVelocity((0, 0, 0))
        fluid.setBodyForceDensity((0, 0, 0))
        fluid.setShear(0, 0, 1)
        fluid.setModel(MobilityForce.FreeDraining)
        fluid.setBoundary(MobilityForce.Unbounded)
        self._system = system
        integrator, context = self._start('Reference', {})
        bodies = BodyDefinitions(integrator)
        self.inertia = list(zip(bodies.masses.tolist(), bodies.moments.tolist()))
        self.sites = np.array([
            sites[particles.index(found[0])]
            for particles, sites, found in zip(bodies.particles, bodies.sites, members)
        ])
        self.positions, self.orientations = integrator.getBodyPositions(
        )._value, integrator.getBodyOrientations()
        integrator.step(1)
        self.centres = np.array([
            context.getState(getPositions=True).getPositions(asNumpy=True)._value[found[0]]
            for found in members
        ])
        arms = self.centres - self.positions
        self.arms = arms
        self.forces = integrator.getBodyForces()._value
        self.torques = integrator.getBodyTorques()._value - np.cross(arms, self.forces)

    @staticmethod
    def _fluid(system):
        found = forces_of(system, MobilityForce)
        if len(found) != 1:
            raise ValueError(
                f'the hydrodynamic ladder: the System has {len(found)} MobilityForces; it must '
                'have one, which gives the radii and the viscosity: add it')
        return found[0]

    def _start(self, platform, properties):
        integrator = self.scene.makeIntegrator()
        integrator.setScheme(CustomRigidHIIntegrator.LangevinHI)
        integrator.setStepSize(NO_STEP)
        integrator.setTemperature(0)
        context = self.scene.makeContext(integrator, openmm.Platform.getPlatformByName(platform),
                                         properties, 1, self._system)
        return integrator, context

    def secondsOfForces(self, platform: str, properties: dict, seconds: float = 0.2) -> float:
        """Seconds a step for the scene's own forces.

        Parameters
        ----------
        platform : str
        properties : dict
            properties of the platform
        seconds : float
            time of the measurement
        """
        integrator, context = self._start(platform, properties)
        integrator.step(2)
        before, began = integrator.getStepStatistics(), time.perf_counter()
        while time.perf_counter() - began < seconds:
            integrator.step(5)
        after = integrator.getStepStatistics()
        del context
        return (after['seconds_forces'] - before['seconds_forces'])/(after['forceEvaluations'] -
                                                                     before['forceEvaluations'])

    def makeContext(self, rung: Rung, platform: str = 'Reference',
                    properties: Optional[dict] = None,
                    seed: int = 1) -> tuple[MobilityForce, CustomRigidHIIntegrator, openmm.Context]:
        """The spheres alone, without the scene's forces, in the fluid of a rung.

        Parameters
        ----------
        rung : Rung
        platform : str
        properties : dict, optional
            properties of the platform
        seed : int
            seed of the noise

        Returns
        -------
        (MobilityForce, CustomRigidHIIntegrator, openmm.Context)
        """
        rows = 3*len(self.radii)*rung.blobs
        if rows > LARGEST_ROWS:
            raise ValueError(
                f'{rows//3} blobs in all; their matrix would have {rows} rows, and at most '
                f'{LARGEST_ROWS} are computed: choose fewer blobs or spheres')
        system, fluid, integrator = openmm.System(), MobilityForce(), self._integrator(seed)
        fluid.setViscosity(self.viscosity)
        fluid.setModel(rung.model)
        if rung.model == MobilityForce.StokesianDynamics:
            fluid.setLubrication(rung.lubrication)
        # Without interaction there are no images.
        fluid.setBoundary(MobilityForce.Unbounded if self.isPeriodic
                          and rung.model == MobilityForce.FreeDraining else self.boundary)
        fluid.setWallHeight(self.wallHeight)
        if self.walls[0] < self.walls[1]:
            fluid.setChannelWalls(*self.walls)
        fluid.setChannelCondition(self.condition)
        fluid.setMinimumGap(self.minimumGap)
        fluid.setGroups(self.groups)
        positions = []
        for index, (radius, (mass, moments), site) in enumerate(
                zip(self.radii, self.inertia, self.sites)):
            sites, blob = np.zeros((1, 3)), radius
            if rung.blobs:
                centres, blob = app.multiblobSphere(rung.blobs, radius)
                sites, blob = centres._value, blob._value
            members = [system.addParticle(0.0) for _ in sites]
            for _ in sites:
                fluid.addParticle(blob)
            integrator.addRigidBody(members, mass, moments, site + sites)
            positions.extend(site + sites + self.positions[index])
            if rung.exactAlone:
                fluid.setBodyMobility(index, self._alone(radius, site))
        system.addForce(fluid)
        system.setDefaultPeriodicBoxVectors(*self.scene.boxVectors)
        if self.isPeriodic:
            app.bindBodies(system, integrator)
        context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platform),
                                 properties or {})
        context.setPositions(positions)
        self.reset(integrator)
        return fluid, integrator, context

    def _integrator(self, seed):
        template = self.scene.makeIntegrator()
        integrator = CustomRigidHIIntegrator(template.getTemperature(), template.getStepSize())
        integrator.setScheme(CustomRigidHIIntegrator.LangevinHI)
        integrator.setRandomNumberSeed(seed)
        return integrator

    def _alone(self, radius, site):
        """Stokes' mobility of a sphere about the body's origin, body frame."""
        turn = np.eye(6)
        # V at the origin = V at the centre - W x site; torque about the centre = torque about the
        # origin - site x F.
        turn[:3, 3:] = [[0, -site[2], site[1]], [site[2], 0, -site[0]], [-site[1], site[0], 0]]
        eta = self.viscosity
        return turn @ np.diag([1/(6*np.pi*eta*radius)]*3 + [1/(8*np.pi*eta*radius**3)]*3) @ turn.T

    def reset(self, integrator: CustomRigidHIIntegrator) -> None:
        """Put the bodies back to the start of the scene, at rest.

        Parameters
        ----------
        integrator : CustomRigidHIIntegrator
            integrator of a Context of makeContext()
        """
        integrator.setBodyOrientations(self.orientations)
        integrator.setBodyPositions(self.positions)
        integrator.setBodyVelocities(np.zeros_like(self.positions))
        integrator.setBodyAngularVelocities(np.zeros_like(self.positions))

    def sample(self, fluid: MobilityForce, context: openmm.Context) -> MobilitySample:
        """The mobility about the spheres' centres, a MobilitySample.

        Parameters
        ----------
        fluid, context
            results of makeContext()
        """
        mobility = fluid.getMobilityInContext(context)
        shift = np.eye(len(mobility))
        # V at the centre = V at the origin + W x arm.
        for k, (x, y, z) in enumerate(self.arms):
            shift[6*k:6*k + 3, 6*k + 3:6*k + 6] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
        if self.arms.any():
            mobility = shift @ mobility @ shift.T
        return MobilitySample(mobility, self.centres, self.radii, self.viscosity, self.forces,
                              self.torques)
