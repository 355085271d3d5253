"""Contexts of spheres and multiblobs above a periodic wall and between walls, for all scripts here.

Units: the radius of a sphere is 1, kT is 1, and 6 pi eta is 1. So a sphere far from walls has
D = 1. Lengths are OpenMM's nm, times its ps.
"""
import pathlib
import sys
import warnings

import numpy as np
import openmm

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, app

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1]/'common'))
from walls import TEMPERATURE  # noqa: E402

VISCOSITY = 1/(6*np.pi)


def sphere(blobs):
    """Sites and radius of the blobs of a sphere of radius 1: 1, 12, 42, ... blobs."""
    if blobs == 1:
        return np.zeros((1, 3)), 1.0
    sites, radius = app.multiblobSphere(blobs, 1.0)
    return sites._value, radius._value


def turns(random, count):
    """Uniform unit quaternions (count, 4)."""
    q = random.normal(size=(count, 4))
    return q/np.linalg.norm(q, axis=1, keepdims=True)


class Scene:
    """Copies of one body in a Context.

    Parameters
    ----------
    boundary : str
        as MobilityForce names it
    sites, radii
        of the blobs of a body
    side : float
        period along x and y
    height : float, optional
        of a channel whose lower wall is z = 0
    isAlone : bool
        whether each copy is in a fluid of its own
    repulsion : (float, float), optional
        strength and range of what keeps blobs off the walls of a channel: each blob has the energy
        strength exp(-gap/range) from each wall
    prepare : callable, optional
        of the MobilityForce, for further settings
    """
    def __init__(self, boundary, sites, radii, count, side=None, height=None, model=None,
                 solver='Dense', scheme='FixmanMidpoint', step=1e-4, seed=1,
                 temperature=TEMPERATURE, isBestKnown=False, isAlone=False, repulsion=None,
                 platform='CPU', prepare=None):
        self.count, self.sites = count, np.asarray(sites, float)
        self.system, self.fluid = openmm.System(), MobilityForce()
        self.integrator = CustomRigidHIIntegrator(temperature, step)
        self.integrator.setScheme(scheme)
        self.integrator.setRandomNumberSeed(seed)
        self.fluid.setViscosity(VISCOSITY)
        self.fluid.setBoundary(boundary)
        if model:
            self.fluid.setModel(model)
        self.fluid.setSolver(solver)
        if isBestKnown:
            self.fluid.setSphereWallMobility('BestKnown')
        if height:
            self.fluid.setChannelWalls(0, height)
        if side:
            # The third vector is not a period of the fluid.
            self.system.setDefaultPeriodicBoxVectors((side, 0, 0), (0, side, 0), (0, 0, side))
        for _ in range(count):
            app.addRigidMultiblob(self.system, self.integrator, self.fluid, self.sites, radii)
        if isAlone:
            self.fluid.setGroups(range(count))
        if prepare:
            prepare(self.fluid)
        self.system.addForce(self.fluid)
        if repulsion:
            strength, reach = repulsion
            push = openmm.CustomExternalForce(
                f'{strength}*(exp(({radii} - z)/{reach}) + exp((z - {height - radii})/{reach}))')
            for particle in range(self.system.getNumParticles()):
                push.addParticle(particle, [])
            self.system.addForce(push)
        app.bindBodies(self.system, self.integrator)
        properties = {'Threads': '1'} if platform == 'CPU' else {}
        self.context = openmm.Context(self.system, self.integrator,
                                      openmm.Platform.getPlatformByName(platform), properties)
        # Poses follow; this start is any that has no blob behind a wall.
        self.context.setPositions(
            np.tile(self.sites + (0, 0, height/2 if height else 1e3), (count, 1)))

    def place(self, positions, orientations=None):
        """Origins (count, 3), and unit quaternions (count, 4), (1, 0, 0, 0) by default."""
        self.integrator.setBodyPositions(positions)
        if orientations is not None:
            self.integrator.setBodyOrientations(orientations)

    def poses(self):
        return self.integrator.getBodyPositions()._value, np.asarray(
            self.integrator.getBodyOrientations())

    def mobility(self):
        """The mobility as (count, 6, count, 6)."""
        return np.asarray(self.fluid.getMobilityInContext(self.context)).reshape(
            self.count, 6, self.count, 6)


def quietly(function, *arguments, **settings):
    """Call a function without warnings, which are of steps that nobody takes here."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        return function(*arguments, **settings)


def meanAndError(values):
    """Mean and standard error of independent values along the first axis."""
    values = np.asarray(values, float)
    return values.mean(0), values.std(0, ddof=1)/np.sqrt(len(values))
