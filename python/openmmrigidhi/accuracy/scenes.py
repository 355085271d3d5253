"""Scenes to measure: built-in scenes, and the user's own."""
from __future__ import annotations

import copy
import importlib
import math
import os
from typing import TYPE_CHECKING, Any, Callable, Optional, Sequence, Union

import numpy as np
import openmm
from openmm import unit

from .. import _units, app
from .._types import Number, Numbers
from .._quaternions import rotation_matrices
from ..integrator import CustomRigidHIIntegrator
from ..mobility import MobilityForce
from .bodytable import BodyTable

if TYPE_CHECKING:
    import numpy.typing as npt

GAS_CONSTANT = _units.GAS_CONSTANT


class Scene:
    """A System, a start configuration, and an integrator.

    The integrator defines the bodies, the temperature and the frictions.

    Everything is stored as XML and arrays, so another process can receive a scene.

    Parameters
    ----------
    system : openmm.System
    state : openmm.State, or array or Quantity of shape (particles, 3)
        start: positions in nm, and velocities and box vectors where the State has them
    integrator : CustomRigidHIIntegrator
        the template: every run has its bodies, temperature, frictions and noise law; its scheme,
        step size and seed are replaced
    name, description : str
        texts for the report
    exact : dict, optional
        observable name -> exact canonical average, in the observable's unit
    equilibration : float or Quantity, optional
        time that each run discards at its start, ps; default: a tenth of its length
    sampleInterval : float or Quantity
        time between samples, ps
    stepSizes : sequence of float or Quantity, optional
        reasonable step sizes for this scene, ps

    Raises
    ------
    TypeError
        if the integrator is no CustomRigidHIIntegrator
    ValueError
        if it has no bodies
    """
    def __init__(
        self, system: openmm.System, state: Union[openmm.State,
                                                  Numbers], integrator: CustomRigidHIIntegrator,
        name: str = 'scene', description: str = '', exact: Optional[dict] = None,
        equilibration: Optional[Number] = None, sampleInterval: Number = 0.1,
        stepSizes: Numbers = (0.001, 0.002, 0.003, 0.004, 0.005, 0.006, 0.007, 0.008)
    ) -> None:
        try:
            integrator = CustomRigidHIIntegrator.cast(integrator)
        except TypeError:
            raise TypeError(f'Scene: integrator: got a {type(integrator).__name__}; it must be a '
                            'CustomRigidHIIntegrator, which says what the bodies are: build one, '
                            'with addRigidBody() or app.addRigidWater()') from None
        if integrator.getNumRigidBodies() == 0:
            raise ValueError('Scene: integrator: it has no bodies; at least one is needed: call '
                             'addRigidBody() or app.addRigidWater()')
        self.name = name
        self.description = description
        self.exact = dict(exact or {})
        self.equilibration = None if equilibration is None else _units.number(
            equilibration, _units.TIME, 'Scene', 'equilibration')
        self.sampleInterval = _units.number(sampleInterval, _units.TIME, 'Scene', 'sampleInterval')
        self.stepSizes = tuple(
            _units.sequence(stepSizes, _units.TIME, 'Scene', 'stepSizes').tolist())
        self.temperature = integrator.getTemperature()._value
        self.friction = integrator.getFriction()._value
        self.rotationalFriction = integrator.getRotationalFriction()._value
        self.bodies = [
            list(integrator.getRigidBodyParticles(i)) for i in range(integrator.getNumRigidBodies())
        ]
        self._systemXml = openmm.XmlSerializer.serialize(system)
        self._integratorXml = openmm.XmlSerializer.serialize(integrator)
        if isinstance(state, openmm.State):
            self.positions = _array(state.getPositions(asNumpy=True), unit.nanometer)
            self.velocities = _velocities(state)
            self.boxVectors = _array(state.getPeriodicBoxVectors(asNumpy=True), unit.nanometer)
        else:
            self.positions = _array(state, unit.nanometer)
            self.velocities = None
            self.boxVectors = _array(system.getDefaultPeriodicBoxVectors(), unit.nanometer)
        if self.positions.shape != (system.getNumParticles(), 3):
            raise ValueError(
                f'Scene: state: got positions of shape {self.positions.shape}; the shape must be '
                f'({system.getNumParticles()}, 3): give one row per particle of the System')
        self._system = None
        self._bodyTable: Optional[BodyTable] = None

    @property
    def system(self) -> openmm.System:
        """The System (one copy, shared by all Contexts)."""
        if self._system is None:
            self._system = openmm.XmlSerializer.deserialize(self._systemXml)
        return self._system

    def withSystem(self, system: openmm.System) -> Scene:
        """The same scene with another System.

        Parameters
        ----------
        system : openmm.System
            with the same particles in the same order; it is copied

        Returns
        -------
        Scene
        """
        changed = copy.copy(self)
        changed._systemXml = openmm.XmlSerializer.serialize(system)
        changed._system = changed._bodyTable = None
        return changed

    def makeIntegrator(self) -> CustomRigidHIIntegrator:
        """A fresh copy of the template integrator."""
        return CustomRigidHIIntegrator.cast(openmm.XmlSerializer.deserialize(self._integratorXml))

    def makeContext(self, integrator: openmm.Integrator, platform: openmm.Platform,
                    properties: dict, seed: int,
                    system: Optional[openmm.System] = None) -> openmm.Context:
        """A Context of this scene at its start.

        Velocities that the scene does not define are drawn at its temperature.

        Parameters
        ----------
        integrator : openmm.Integrator
        platform : openmm.Platform
        properties : dict
            properties of the platform
        seed : int
            seed of the velocities
        system : openmm.System, optional
            a System with the same particles, which replaces the scene's own
        """
        context = openmm.Context(self.system if system is None else system, integrator, platform,
                                 properties)
        context.setPeriodicBoxVectors(*self.boxVectors)
        context.setPositions(self.positions)
        if self.velocities is None:
            context.setVelocitiesToTemperature(self.temperature, seed)
        else:
            context.setVelocities(self.velocities)
        return context

    def rigidByConstraints(self) -> Optional[str]:
        """Whether constraints hold every body rigid, so that OpenMM's own integrators can move it.

        Returns
        -------
        str or None
            None if so, otherwise the reason
        """
        constrained = {
            frozenset(self.system.getConstraintParameters(i)[:2])
            for i in range(self.system.getNumConstraints())
        }
        for index, body in enumerate(self.bodies):
            massive = [i for i in body if self.system.getParticleMass(i)._value > 0]
            if len(massive) < 2:
                return (f'body {index} has fewer than two massive particles: no orientation for '
                        'OpenMM to move')
            # A rigid set of n particles has 3n - 6 independent constraints (one for a pair).
            needed = {frozenset((i, j)) for k, i in enumerate(massive) for j in massive[:k]}
            if len(massive) > 4 or not needed <= constrained:
                return f'the constraints do not hold body {index} rigid'
        return None

    def bodyTable(self) -> BodyTable:
        """The bodies' particles, masses and degrees of freedom.

        They are for integrators that know only particles.
        """
        if self._bodyTable is None:
            self._bodyTable = BodyTable(self)
        return self._bodyTable

    def __getstate__(self):
        return {
            key: None if key in ('_system', '_bodyTable') else value
            for key, value in self.__dict__.items()
        }


def _array(value, base):
    if unit.is_quantity(value):
        value = value.value_in_unit(base)
    return np.array([[
        float(unit.Quantity(x, base)._value) if not unit.is_quantity(x) else x.value_in_unit(base)
        for x in row
    ] for row in value]) if not isinstance(value, np.ndarray) else np.array(value, float)


def _velocities(state):
    try:
        return _array(state.getVelocities(asNumpy=True), unit.nanometer/unit.picosecond)
    except Exception:  # the State has none: OpenMM raises its bare Exception class
        return None


def water(molecules: int = 216, temperature: float = 298.15, gamma: float = 5.0,
          Gamma: float = 10.0, density: float = 995.0, cutoff: float = 0.9,
          equilibration: float = 40.0, seed: int = 1, platform: str = 'CPU',
          threads: Optional[int] = None, progress: Optional[Callable] = None) -> Scene:
    """A box of TIP4P-Ew water with PME, equilibrated with LangevinC.

    The force field comes from openmm.app.

    Parameters
    ----------
    molecules : int
        number of molecules; at least 216 for the default cutoff
    temperature : float
        K
    gamma, Gamma : float
        translational and rotational friction, 1/ps; LangevinMiddle gets gamma
    density : float
        kg/m^3
    cutoff : float
        cut-off of Lennard-Jones and of the direct space of PME, nm; at most half the box
    equilibration : float
        time at a step of 4 fs, ps, after minimisation and 5 ps at 2 fs with a friction of 20/ps
    seed : int
    platform : str
    threads : int, optional
        threads of the CPU platform
    progress : callable, optional
        called with (done, total) in steps

    Returns
    -------
    Scene
    """
    # Its import takes as long as the import of OpenMM, and other scenes do not need it.
    import openmm.app
    modeller = openmm.app.Modeller(openmm.app.Topology(), []*unit.nanometer)
    forceField = openmm.app.ForceField('tip4pew.xml')
    modeller.addSolvent(forceField, model='tip4pew', numAdded=molecules)
    topology = modeller.topology
    positions = np.array(modeller.positions.value_in_unit(unit.nanometer))
    wanted = (molecules*(15.99943 + 2*1.007947)/(density*0.602214076))**(1/3)
    if cutoff > wanted/2:
        raise ValueError(
            f'water: molecules: got {molecules}; the box is {wanted:.3f} nm wide, less than twice '
            f'the cutoff of {cutoff} nm: use at least '
            f'{math.ceil((2*cutoff)**3*density*0.602214076/18.01528)} molecules')
    old = topology.getPeriodicBoxVectors()[0][0]._value
    sites = len(positions) // molecules
    centres = np.repeat(positions.reshape(molecules, sites, 3).mean(axis=1), sites, axis=0)
    positions += centres*(wanted/old - 1)
    topology.setPeriodicBoxVectors(np.eye(3)*wanted*unit.nanometer)
    system = forceField.createSystem(topology, nonbondedMethod=openmm.app.PME,
                                     nonbondedCutoff=cutoff*unit.nanometer, rigidWater=True,
                                     removeCMMotion=False)
    # The bonds and angles of rigid water are constrained: these forces are empty.
    for index in reversed(range(system.getNumForces())):
        if isinstance(system.getForce(index),
                      (openmm.HarmonicBondForce, openmm.HarmonicAngleForce)):
            system.removeForce(index)

    def template(scheme=CustomRigidHIIntegrator.LangevinC):
        integrator = CustomRigidHIIntegrator(temperature, 0.002)
        integrator.setScheme(scheme)
        integrator.setFriction(gamma)
        integrator.setRotationalFriction(Gamma)
        app.addRigidWater(integrator, topology, system)
        return integrator

    integrator = template()
    integrator.setRandomNumberSeed(seed)
    integrator.setFriction(20)
    integrator.setRotationalFriction(40)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platform),
                             platformProperties(platform, threads))
    context.setPositions(positions)
    openmm.LocalEnergyMinimizer.minimize(context, 10, 200)
    context.setVelocitiesToTemperature(temperature, seed)
    first, second = int(5/0.002), int(equilibration/0.004)
    for done in range(0, first + second, 100):
        if done == first:
            integrator.setFriction(gamma)
            integrator.setRotationalFriction(Gamma)
            integrator.setStepSize(0.004)
        integrator.step(100)
        if progress is not None:
            progress(done + 100, first + second)
    state = context.getState(getPositions=True, getVelocities=True)
    return Scene(
        system, state, template(), f'water{molecules}',
        f'{molecules} TIP4P-Ew molecules at {density:g} kg/m^3 and {temperature:g} K, PME, cutoff '
        f'{cutoff:g} nm; gamma = {gamma:g}/ps, Gamma = {Gamma:g}/ps', equilibration=5.0,
        sampleInterval=0.1, stepSizes=[0.001*k for k in range(1, 10)])


def trap(bodies: int = 400, temperature: float = 300.0, gamma: float = 10.0, Gamma: float = 20.0,
         frequency: float = 100.0, field: float = 2.0, seed: int = 1) -> Scene:
    r"""Triangular rigid bodies in a harmonic trap with a uniform field on their dipoles.

    Every average is known exactly. The bodies do not interact. Each body has three massive
    particles and an asymmetric inertia. Constraints hold the particles, so LangevinMiddle with
    SETTLE can run for comparison. A potential :math:`m \omega^2 x^2/2` binds each particle. This is
    a trap :math:`M \omega^2 X^2/2` on the centre of mass, without a torque (force group 0). Forces
    along z that add up to zero make the energy :math:`-b\,kT\,n_z` of a dipole n, with b = field
    (force group 1). Then :math:`\langle U_\mathrm{trap} \rangle = \frac32 kT` and
    :math:`\langle U_\mathrm{field} \rangle = -b\,kT\,(\coth b - 1/b)`.

    Parameters
    ----------
    bodies : int
    temperature : float
        K
    gamma, Gamma : float
        frictions, 1/ps
    frequency : float
        :math:`\omega`, 1/ps; Langevin C is stable up to :math:`h = 2/\omega`
    field : float
        energy of the dipole in the field, kT
    seed : int
        seed of the start configuration

    Returns
    -------
    Scene
        with exact values of potential_energy, energy_group_0, energy_group_1 (kJ/mol per body) and
        all temperatures
    """
    masses = np.array([16.0, 2.0, 1.0])
    shape = np.array([[0, 0, 0], [0.1, 0, 0], [-0.03, 0.09, 0]])
    shape -= masses @ shape/masses.sum()
    kT = GAS_CONSTANT*temperature
    system = openmm.System()
    well = openmm.CustomExternalForce('0.5*k*(x^2+y^2+z^2)-c')
    well.addPerParticleParameter('k')
    well.addPerParticleParameter('c')
    well.setForceGroup(0)
    uniform = openmm.CustomExternalForce('-f*z')
    uniform.addPerParticleParameter('f')
    uniform.setForceGroup(1)
    dipole = np.linalg.norm(shape[1] - shape[0])
    integrator = CustomRigidHIIntegrator(temperature, 0.002)
    integrator.setFriction(gamma)
    integrator.setRotationalFriction(Gamma)
    for body in range(bodies):
        first = 3*body
        for k in range(3):
            system.addParticle(masses[k])
            stiffness = masses[k]*frequency**2
            well.addParticle(first + k, [stiffness, 0.5*stiffness*shape[k] @ shape[k]])
            uniform.addParticle(first + k, [field*kT/dipole*(-1, 1, 0)[k]])
        for i, j in ((0, 1), (0, 2), (1, 2)):
            system.addConstraint(first + i, first + j, np.linalg.norm(shape[i] - shape[j]))
        integrator.addRigidBody([first, first + 1, first + 2])
    system.addForce(well)
    system.addForce(uniform)
    rng = np.random.default_rng(seed)
    centres = rng.normal(scale=math.sqrt(kT/masses.sum())/frequency, size=(bodies, 1, 3))
    quaternions = rng.normal(size=(bodies, 4))
    rotations = rotation_matrices(quaternions/np.linalg.norm(quaternions, axis=1, keepdims=True))
    positions = (centres + np.einsum('bij,kj->bki', rotations, shape)).reshape(-1, 3)
    inWell, inField = 1.5*kT, -field*kT*(1/math.tanh(field) - 1/field)
    return Scene(
        system, positions, integrator, 'trap',
        f'{bodies} independent triangular bodies in a harmonic trap (w = {frequency:g}/ps) with a '
        f'field of {field:g} kT on their dipoles, {temperature:g} K; gamma = {gamma:g}/ps, Gamma = '
        f'{Gamma:g}/ps; exact averages known', exact={
            'potential_energy': inWell + inField,
            'energy_group_0': inWell,
            'energy_group_1': inField
        }, equilibration=1.0, sampleInterval=0.05,
        stepSizes=[0.1/frequency*k for k in (2, 4, 6, 8, 10, 12)])


def spheres(centres: npt.ArrayLike, radii: npt.ArrayLike = 1.0, temperature: float = 300.0,
            viscosity: Optional[float] = None, stepSize: float = 0.001, density: float = 1000.0,
            force: Optional[npt.ArrayLike] = None, name: str = 'spheres', description: str = '',
            edges: Optional[npt.ArrayLike] = None, exact: Optional[dict] = None) -> Scene:
    """Spheres in a fluid, each a body of one particle.

    Parameters
    ----------
    centres : array-like of shape (n, 3)
        nm
    radii : float or array-like of shape (n,)
        hydrodynamic radii, nm
    temperature : float
        K
    viscosity : float, optional
        dalton/(nm ps); default: water
    stepSize : float
        ps
    density : float
        kg/m^3, for masses and moments
    force : array-like of shape (3,), optional
        force on every sphere, kJ/(mol nm)
    name, description : str
    edges : array-like of shape (3,), optional
        edges of a periodic box, nm; the fluid is then periodic, too
    exact : dict, optional
        see Scene

    Returns
    -------
    Scene
    """
    centres = np.asarray(centres, float)
    system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(
        temperature, stepSize)
    integrator.setScheme(CustomRigidHIIntegrator.LangevinHI)
    if edges is not None:
        system.setDefaultPeriodicBoxVectors(*np.diag(np.asarray(edges, float)))
        fluid.setBoundary(MobilityForce.Periodic)
    if viscosity is not None:
        fluid.setViscosity(viscosity)
    for radius in np.broadcast_to(radii, len(centres)):
        mass = density*0.602214076*4/3*np.pi*radius**3
        integrator.addRigidBody([system.addParticle(mass)], mass, (0.4*mass*radius**2,)*3,
                                np.zeros((1, 3)))
        fluid.addParticle(float(radius))
    if force is not None:
        weight = openmm.CustomExternalForce('-(fx*x+fy*y+fz*z)')
        for letter, value in zip('xyz', force):
            weight.addGlobalParameter('f' + letter, float(value))
        for k in range(len(centres)):
            weight.addParticle(k)
        system.addForce(weight)
    system.addForce(fluid)
    return Scene(system, centres, integrator, name, description, exact)


def pair(gap: float, ratio: float = 1.0, temperature: float = 1e-9) -> Scene:
    """Two spheres side by side, along x, the first of radius 1 nm, in water.

    Parameters
    ----------
    gap : float
        gap between the surfaces, in radii of the first sphere
    ratio : float
        radius of the second sphere divided by the radius of the first
    temperature : float
        K; the default is so low that the spheres hardly move while steps are timed

    Returns
    -------
    Scene
    """
    return spheres([(0, 0, 0), (1 + ratio + gap, 0, 0)], (1.0, ratio), temperature, name='pair',
                   description='two spheres' +
                   (' of equal radii' if ratio == 1 else f' with radii in ratio {ratio:g}') +
                   ', the forces of settling across their line of centres')


def pairs(gaps: Sequence[float] = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10),
          ratio: float = 1.0) -> dict:
    """Pairs of spheres over gaps, for :class:`openmmrigidhi.accuracy.LadderStudy`.

    Parameters
    ----------
    gaps : sequence of float
        gaps between the surfaces, in radii of the first sphere
    ratio : float
        radius of the second sphere divided by the radius of the first

    Returns
    -------
    dict
        gap -> Scene
    """
    return {float(gap): pair(gap, ratio) for gap in gaps}


class Sweep(dict):
    """Scenes along a parameter: value -> Scene.

    Parameters
    ----------
    parameter : str
        meaning of the keys
    harder : str
        'smaller' or 'larger': the values towards which approximations get worse
    scenes : dict
    """
    def __init__(self, parameter: str, harder: str, scenes: dict) -> None:
        super().__init__(scenes)
        self.parameter = parameter
        self.harder = harder


#: Simple cubic arrays of spheres, volume fraction -> K, KR. The force on each sphere is 6 pi eta a
#: K U if all spheres move with U against the mean of the whole. The torque is 8 pi eta a^3 KR Omega
#: if all rotate alike. K is from A. A. Zick, G. M. Homsy, J. Fluid Mech. 115, 13 (1982), with more
#: digits by a collocation of this project; KR is by the same collocation.
SIMPLE_CUBIC = {
    0.001: (1.212141, 1.001001),
    0.027: (2.007748, 1.027761),
    0.064: (2.810198, 1.068608),
    0.125: (4.291589, 1.145253),
    0.216: (7.441954, 1.292910),
    0.343: (15.39949, 1.635752),
    0.45: (28.0864, 2.318367)
}


def array(fraction: float, radius: float = 1.0) -> Scene:
    """A simple cubic array of spheres in water: one sphere in a cubic periodic box.

    Parameters
    ----------
    fraction : float
        volume fraction, one of those in SIMPLE_CUBIC
    radius : float
        nm

    Returns
    -------
    Scene
        with the exact `drag` and `rotational_drag` of the array
    """
    if fraction not in SIMPLE_CUBIC:
        raise ValueError(
            f'array: fraction: got {fraction}; exact numbers of simple cubic arrays are known for '
            f'the volume fractions {", ".join(f"{known:g}" for known in SIMPLE_CUBIC)}')
    side = radius*(4*np.pi/3/fraction)**(1/3)
    return spheres([(0, 0, 0)], radius, 1e-9, name='simple cubic array',
                   description='spheres on a simple cubic lattice, one in a periodic box; exact '
                   'numbers: Zick and Homsy, J. Fluid Mech. 115, 13 (1982), and a collocation',
                   edges=(side,)*3, exact=dict(
                       zip(('drag', 'rotational_drag'), SIMPLE_CUBIC[fraction])))


def arrays(fractions: Sequence[float] = tuple(SIMPLE_CUBIC)) -> Sweep:
    """Simple cubic arrays of spheres over volume fractions.

    They are for :class:`openmmrigidhi.accuracy.LadderStudy`.

    Parameters
    ----------
    fractions : sequence of float
        volume fractions, among those in SIMPLE_CUBIC

    Returns
    -------
    Sweep
        volume fraction -> Scene
    """
    return Sweep('volume fraction', 'larger',
                 {float(fraction): array(fraction)
                  for fraction in fractions})


def suspension(bodies: int = 12, fraction: float = 0.1, radius: float = 1.0, leastGap: float = 0.02,
               temperature: float = 300.0, seed: int = 1) -> Scene:
    """Spheres of one size at random positions without overlap, within a sphere, in water, settling.

    Parameters
    ----------
    bodies : int
    fraction : float
        volume fraction, up to about 0.3
    radius : float
        nm
    leastGap : float
        smallest gap between surfaces, in radii
    temperature : float
        K
    seed : int

    Returns
    -------
    Scene
    """
    outer = radius*(bodies/fraction)**(1/3)
    centres = _random_centres(bodies, fraction, outer, (2 + leastGap)*radius, None, seed)
    return spheres(
        centres, radius, temperature, force=(0, 0, -1), name=f'suspension{bodies}', description=
        f'{bodies} spheres at random in a larger sphere, volume fraction {fraction:g}, settling in '
        f'water')


def _random_centres(bodies, fraction, outer, least, side, seed):
    """Positions that are no nearer to each other than `least`.

    They are in a sphere of this radius, or in a periodic cube of this side.
    """
    rng = np.random.default_rng(seed)
    centres = np.empty((0, 3))

    def apart(points, centre):
        between = points - centre
        if side is not None:
            between -= side*np.round(between/side)
        return np.einsum('ij,ij->i', between, between) >= least**2

    # Each point that is apart from all centres so far is the next one.
    for _ in range(10*bodies):
        points = rng.uniform(-outer, outer, (10000, 3))
        if side is None:
            points = points[np.linalg.norm(points, axis=1) <= outer]
        for centre in centres:
            points = points[apart(points, centre)]
        while len(points) and len(centres) < bodies:
            centres = np.concatenate([centres, points[:1]])
            points = points[apart(points, points[0])]
        if len(centres) == bodies:
            return centres
    raise ValueError(
        f'suspension: fraction: got {fraction}; {bodies} spheres found no room by chance: '
        f'choose a smaller one')


def periodicSuspension(bodies: int = 8, fraction: float = 0.15, radius: float = 1.0,
                       leastGap: float = 0.02, temperature: float = 300.0, seed: int = 1) -> Scene:
    """Spheres of one size at random positions in a cubic periodic box of water, settling.

    The spheres do not overlap.

    Parameters
    ----------
    bodies : int
    fraction : float
        volume fraction, up to about 0.3
    radius : float
        nm
    leastGap : float
        smallest gap between surfaces, in radii
    temperature : float
        K
    seed : int

    Returns
    -------
    Scene
    """
    side = radius*(4*np.pi/3*bodies/fraction)**(1/3)
    centres = _random_centres(bodies, fraction, side/2, (2 + leastGap)*radius, side, seed)
    return spheres(
        centres, radius, temperature, force=(0, 0, -1), name=f'periodic suspension of {bodies}',
        edges=(side,)*3, description=
        f'{bodies} spheres at random in a periodic box, volume fraction {fraction:g}, settling in '
        f'water')


def fromFiles(system: str, state: str, integrator: str) -> Scene:
    """The user's scene from three XML files.

    openmm.XmlSerializer and Simulation.saveState write such files.

    Parameters
    ----------
    system, state, integrator : str
        paths; the integrator must be a CustomRigidHIIntegrator

    Returns
    -------
    Scene
    """
    objects = []
    for path in (system, state, integrator):
        with open(path) as file:
            objects.append(openmm.XmlSerializer.deserialize(file.read()))
    return Scene(*objects, name=os.path.splitext(os.path.basename(system))[0],
                 description=f'system {system}, state {state}')


def fromFunction(specification: str) -> Scene:
    """The user's scene from a Python function.

    Parameters
    ----------
    specification : str
        "module:function". The function takes no arguments and returns a Scene, or (system, state or
        positions, integrator), or (system, topology, positions, integrator).

    Returns
    -------
    Scene
    """
    result = importObject(specification, 'scene')()
    if isinstance(result, Scene):
        return result
    if len(result) == 4:
        result = (result[0], result[2], result[3])
    return Scene(*result, name=specification.split(':')[1], description=f'scene {specification}')


def importObject(specification: str, what: str) -> Any:
    """The object "module:name".

    Parameters
    ----------
    specification : str
    what : str
        meaning of the object, for error messages
    """
    module, _, name = specification.partition(':')
    if not name:
        raise ValueError(
            f'{what}: got {specification!r}; it must have the form module:function: give the name '
            f'after a colon')
    try:
        return getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError) as error:
        remedy = ('put the module on PYTHONPATH or run in its directory'
                  if module != '__main__' else
                  'it was defined in a script, and is found only while this script runs: go on in '
                  'the script, or define it in a module from the beginning')
        raise ValueError(f'{what}: got {specification!r}, which cannot be imported ({error}): '
                         f'{remedy}') from error


def findObservable(name: Any, kind: type, builtIn: dict, fromFunction: Callable) -> Any:
    """An observable from the user's specification.

    Parameters
    ----------
    name : str, callable or of this kind
        an observable; a function; a built-in name; "module:name" of any of these
    kind : type
        of observables
    builtIn : dict
        name -> observable
    fromFunction : callable
        function -> observable

    Returns
    -------
    of this kind, or None
        None for any other name
    """
    if isinstance(name, kind):
        return name
    if callable(name):
        return fromFunction(name)
    if name in builtIn:
        return builtIn[name]
    return findObservable(importObject(name, 'observable'), kind, builtIn,
                          fromFunction) if ':' in name else None


def platformProperties(platform: str, threads: Optional[int]) -> dict:
    """Properties of a Context.

    Parameters
    ----------
    platform : str
    threads : int or None
        threads of the CPU platform; None: OpenMM's choice
    """
    return {'Threads': str(threads)} if threads is not None and platform == 'CPU' else {}


#: Scenes by name, for the command line; those for the hydrodynamic ladder.
BUILT_IN = {'water': water, 'trap': trap}
OF_SPHERES = {
    'pairs': pairs,
    'suspension': suspension,
    'arrays': arrays,
    'periodic': periodicSuspension
}
