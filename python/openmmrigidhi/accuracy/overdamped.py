r"""The cheapest way to the overdamped limit: equilibrium of bodies above a wall.

The module compares the schemes without momenta with LangevinHI. All numbers are in units of the
blob radius a and of the time :math:`\tau_D = 6 \pi \eta a^3/kT`, in which a blob diffuses about its
radius.
"""
from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Optional, Sequence, Union

import numpy as np
import openmm

from .. import app
from .._types import Array
from .._quaternions import product, rotation_matrices
from ..analysis import WalkerSampler, mobilityAboutPoint
from ..integrator import CustomRigidHIIntegrator, Scheme
from ..mobility import MobilityForce
from .measurement import SECONDS_PER_DAY
from .methods import Method, RigidScheme
from .observables import Observable
from .scenes import GAS_CONSTANT, Scene
from .study import Knob, StepSizeStudy

if TYPE_CHECKING:
    import numpy.typing as npt
    from .result import Reference

#: Delong, Balboa Usabiaga, Donev 2015: spacing over radius of the boomerang's blobs; repulsion by
#: the wall, kT, and its weight at g = 1, kT/a.
SPACING, REPULSION, WEIGHT = 0.3/0.324557, 23.08, 0.18
#: Water, dalton/(nm ps); temperature, K; radius of a blob, nm. Results in units of a and tau_D do
#: not depend on these.
VISCOSITY, TEMPERATURE, RADIUS = 536.0, 300.0, 1.0
#: Of the suspension, kT: pair repulsion at contact of two blobs, stiffness of the pen (times
#: (distance beyond)^2).
PAIR, PEN = 10.0, 2.5
#: Relaxation rate times step of LangevinHI, by name. Diffusion is exaggerated by x coth x, x half
#: of it: 0.7 %, 8 %, 66 %.
INERTIA = {'LangevinHI(0.3)': 0.3, 'LangevinHI(1)': 1.0, 'LangevinHI(3)': 3.0}
SCHEMES = ('EulerMaruyama', 'FixmanMidpoint', 'RandomFiniteDifference', 'TractionEulerMaruyama',
           'TrapezoidalSlip', 'DriftCorrectorFD', 'DriftCorrectorRFD')


def picoseconds(h: float) -> float:
    """A time in ps.

    Parameters
    ----------
    h : float
        in units of tau_D
    """
    return h*6*math.pi*VISCOSITY*RADIUS**3/(GAS_CONSTANT*TEMPERATURE)


def wallRepulsion(gaps: Array) -> Array:
    """Energy of blobs in the repulsion by the wall, kT.

    Parameters
    ----------
    gaps : ndarray
        between blobs and wall, blob radii
    """
    return REPULSION/gaps*np.exp(-2*gaps)


class WallScene(Scene):
    """Boomerangs above a wall.

    Attributes
    ----------
    timeUnit : float
        tau_D, ps
        number of independent scenes in one; their times add up
    sites : ndarray of shape (blobs, 3)
        sites of a body, about its centre of mass along its principal axes, nm
    cross : int
        index of the blob at the cross point
    frictions : (float, ndarray of shape (3,))
        frictions of a body in unbounded fluid: mean of translation, dalton/ps; about its axes,
        dalton nm^2/ps
    """
    def __init__(self, system: openmm.System, positions: Array, integrator: CustomRigidHIIntegrator,
                 sites: Array, replicas: int, **kwargs: Any) -> None:
        self.timeUnit = picoseconds(1)
        self.sites, self.replicas, self.cross = sites, replicas, len(sites) // 2
        N = _bulk_mobility(sites)
        self.frictions = 3/np.trace(N[:3, :3]), 1/np.diag(N)[3:]
        super().__init__(system, positions, integrator, sampleInterval=self.timeUnit, **kwargs)

    def makeContext(self, integrator: openmm.Integrator, platform: openmm.Platform,
                    properties: dict[str, str], seed: int,
                    system: Optional[openmm.System] = None) -> openmm.Context:
        """As Scene.makeContext(), but bodies without mass get no velocities.

        Parameters
        ----------
        integrator, platform, properties, seed, system
            see Scene.makeContext()
        """
        context = openmm.Context(self.system if system is None else system, integrator, platform,
                                 properties)
        context.setPositions(self.positions)
        if CustomRigidHIIntegrator.cast(integrator).getScheme() == Scheme.LangevinHI:
            context.setVelocitiesToTemperature(self.temperature, seed)
        return context


def _body_sites(blobsPerArm):
    """Sites about the centre of mass along principal axes.

    x is along the bisector and z normal to the plane.
    """
    sites = app.boomerang(SPACING*RADIUS, blobsPerArm)._value
    sites -= sites.mean(axis=0)
    return sites @ np.array([(1, 1, 0), (-1, 1, 0), (0, 0, math.sqrt(2))]).T/math.sqrt(2)


def _bulk_mobility(sites):
    system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(0, 1)
    integrator.setScheme(Scheme.RandomFiniteDifference)
    fluid.setViscosity(VISCOSITY)
    app.addRigidMultiblob(system, integrator, fluid, sites, RADIUS)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions(sites)
    N = fluid.getMobilityInContext(context)
    return mobilityAboutPoint(N, (0, 0, 0))


def _system(sites, bodies, weight):
    """(System, MobilityForce, integrator) of massless bodies with weight.

    The wall repels them (force group 1).
    """
    kT = GAS_CONSTANT*TEMPERATURE
    system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(
        TEMPERATURE, 1)
    integrator.setScheme(Scheme.TrapezoidalSlip)
    fluid.setViscosity(VISCOSITY)
    fluid.setBoundary(MobilityForce.NoSlipWall)
    gravity = openmm.CustomExternalForce(f'{weight*kT/len(sites)/RADIUS!r}*z')
    repulsion = openmm.CustomExternalForce(f'{REPULSION*kT!r}/d*exp(-2*d); d=(z-{RADIUS})/{RADIUS}')
    repulsion.setForceGroup(1)
    for _ in range(bodies):
        body = app.addRigidMultiblob(system, integrator, fluid, sites, RADIUS)
        for particle in integrator.getRigidBodyParticles(body):
            gravity.addParticle(particle, [])
            repulsion.addParticle(particle, [])
    for force in (fluid, gravity, repulsion):
        system.addForce(force)
    return system, fluid, integrator


def quadrature(sites: npt.ArrayLike, weight: float, orientations: int = 32) -> dict:
    """Exact averages of one body above the wall, by quadrature.

    The quadrature is over the body's height and the direction of the vertical in its frame.

    Parameters
    ----------
    sites : array-like of shape (blobs, 3)
        sites about the centre of mass, in blob radii; the middle site is the cross point, z the
        normal
    weight : float
        kT per blob radius
    orientations : int
        Gauss points over the cosine of the polar angle; twice as many in the azimuth

    Returns
    -------
    dict
        height (of the cross point, blob radii), cos2 (of the angle between normal and vertical),
        repulsion (kT)
    """
    sites = np.asarray(sites, dtype=float)
    cosines, weights = np.polynomial.legendre.leggauss(orientations)
    azimuths = 2*np.pi*np.arange(2*orientations)/(2*orientations)
    knots = np.array([0, 0.5, 1, 2, 4, 8, 16, 32, 64])*max(1, 1/weight)
    knots = np.concatenate([[0, 0.25], knots[knots > 0.25]])
    x, w = np.polynomial.legendre.leggauss(20)
    above = np.concatenate([(b - a)/2*x + (a + b)/2 for a, b in zip(knots[:-1], knots[1:])])
    steps = np.concatenate([(b - a)/2*w for a, b in zip(knots[:-1], knots[1:])])
    sums = np.zeros(4)
    for cosine, part in zip(cosines, weights):
        sine = math.sqrt(1 - cosine*cosine)
        vertical = np.stack(
            [sine*np.cos(azimuths), sine*np.sin(azimuths),
             np.full_like(azimuths, cosine)], axis=1)
        offsets = vertical @ sites.T
        z = above[None, :] + 1 - offsets.min(axis=1)[:, None]
        gaps = z[:, :, None] + offsets[:, None, :] - 1
        repulsion = wallRepulsion(gaps).sum(axis=2)
        probability = part*steps*np.exp(-weight*z - repulsion)
        for k, value in enumerate((1, z + offsets[:, [len(sites) // 2]], cosine*cosine, repulsion)):
            sums[k] += (probability*value).sum()
    return dict(zip(('height', 'cos2', 'repulsion'), (sums[1:]/sums[0]).tolist()))


def boomerang(replicas: int = 32, weight: float = 10*WEIGHT, blobsPerArm: int = 7,
              seed: int = 1) -> WallScene:
    """Independent boomerangs above a wall, in equilibrium, by setGroups.

    The scene is that of Delong, Balboa Usabiaga, Donev 2015, Figs 8 and 9.

    Parameters
    ----------
    replicas : int
    weight : float
        kT per blob radius; the default is the paper's g = 10, for which heights relax some 30 times
        faster than for g = 1
    blobsPerArm : int
        number of blobs of an arm without the blob at the cross point; 7 in the paper
    seed : int
        seed of the start, which is a sample of the equilibrium

    Returns
    -------
    WallScene
        with exact averages, by quadrature
    """
    sites = _body_sites(blobsPerArm)
    system, fluid, integrator = _system(sites, replicas, weight)
    fluid = MobilityForce.cast(system.getForce(0))
    fluid.setGroups(range(replicas))
    kT = GAS_CONSTANT*TEMPERATURE

    def energy(R, q):
        vertical = rotation_matrices(q)[:, 2, :]
        gaps = (R[:, 2:] + vertical @ sites.T)/RADIUS - 1
        return kT*(weight*R[:, 2]/RADIUS + wallRepulsion(gaps).sum(axis=1))

    walkers = WalkerSampler(energy, TEMPERATURE, replicas, (0, 0, 10*RADIUS), sitePositions=sites,
                            radii=RADIUS, wallHeight=0, coordinates=['z', 'rotation'], seed=seed)
    walkers.burnIn(1000)
    start = walkers.sample(1, interval=1)
    return WallScene(
        system, _places(start.positions[-1], start.orientations[-1],
                        sites), integrator, sites, replicas, name=f'boomerang_g{weight/WEIGHT:.3g}',
        description=f'{replicas} independent boomerangs of {len(sites)} blobs above a wall, weight '
        f'{weight:.4g} kT/a, repulsion '
        f'{REPULSION} kT a/d exp(-2 d/a) at gaps d; exact averages by quadrature', exact=quadrature(
            sites/RADIUS, weight), stepSizes=[picoseconds(h) for h in (0.025, 0.05, 0.1, 0.2)])


class _Pen:
    """Monte Carlo of many independent systems of interacting boomerangs at a time, in NumPy.

    Lengths are in a, energies in kT.
    """
    def __init__(self, sites, bodies, weight, radius, systems, seed):
        self.sites, self.weight, self.radius = sites/RADIUS, weight, radius
        self.random = np.random.default_rng(seed)
        side = math.ceil(math.sqrt(bodies))
        grid = (np.arange(side) - (side - 1)/2)*1.3*radius/side
        self.R = np.tile([(x, y, 3.0) for x in grid for y in grid][:bodies], (systems, 1, 1))
        turns = self.random.uniform(0, 2*np.pi, (systems, bodies))
        self.q = np.stack([np.cos(turns/2), 0*turns, 0*turns, np.sin(turns/2)], axis=2)
        self.blobs = self._blobs(self.R, self.q)
        self.move = np.array([0.5, 0.5])  # a, and radians

    def _blobs(self, R, q):
        return R[..., None, :] + np.einsum(
            '...ij,kj->...ki',
            rotation_matrices(q.reshape(-1, 4)).reshape(q.shape[:-1] + (3, 3)), self.sites)

    def _energy(self, blobs, others):
        """Energy of one body in each system (systems, blobs, 3).

        others are the blobs of the other bodies (systems, m, 3).
        """
        gaps = blobs[..., 2] - 1
        inside = gaps.min(axis=1) > 0
        gaps = np.where(inside[:, None], gaps, 1)
        beyond = np.maximum(0, np.hypot(blobs[..., 0], blobs[..., 1]) - self.radius)
        energy = (self.weight*blobs[..., 2]).mean(axis=1) + (wallRepulsion(gaps) +
                                                             PEN*beyond**2).sum(axis=1)
        separations = blobs[:, :, None, :] - others[:, None, :, :]
        distances = np.sqrt(np.einsum('skmi,skmi->skm', separations, separations))
        energy += PAIR*np.exp(-3*(distances - 2)).sum(axis=(1, 2))
        return np.where(inside, energy, np.inf)

    def totalEnergy(self):
        """Energy of each system, kT."""
        systems, bodies, blobs = self.blobs.shape[:3]
        total = np.zeros(systems)
        for k in range(bodies):
            others = self.blobs[:, k + 1:].reshape(systems, -1, 3)
            total += self._energy(self.blobs[:, k], others)
        return total

    def sweep(self):
        """Make one trial for each body of each system; return the part that was accepted."""
        systems, bodies = self.R.shape[:2]
        accepted = 0
        for k in range(bodies):
            others = np.delete(self.blobs, k, axis=1).reshape(systems, -1, 3)
            R = self.R[:, k] + self.move[0]*self.random.uniform(-1, 1, (systems, 3))
            turn = np.concatenate(
                [np.ones((systems, 1)), 0.5*self.move[1]*self.random.uniform(-1, 1,
                                                                             (systems, 3))], axis=1)
            q = product(turn/np.linalg.norm(turn, axis=1, keepdims=True), self.q[:, k])
            blobs = self._blobs(R, q)
            change = self._energy(blobs, others) - self._energy(self.blobs[:, k], others)
            take = self.random.uniform(size=systems) < np.exp(-np.maximum(0, change))
            self.R[take, k], self.q[take, k], self.blobs[take, k] = R[take], q[take], blobs[take]
            accepted += take.mean()/bodies
        return accepted

    def burnIn(self, sweeps):
        """Equilibrate, and adapt the moves."""
        for _ in range(sweeps):
            self.move = np.clip(self.move*math.exp(0.1*(self.sweep() - 0.4)), 1e-3, 2)


def suspension(bodies: int = 16, weight: float = 10*WEIGHT, blobsPerArm: int = 2,
               radius: float = 9.0, sweeps: int = 500, systems: int = 60,
               seed: int = 1) -> WallScene:
    r"""Interacting boomerangs above a wall, held together by a round pen.

    The fluid and a soft repulsion couple them.

    Parameters
    ----------
    bodies : int
    weight : float
        weight of each body, kT per blob radius
    blobsPerArm : int
        number of blobs of an arm without the blob at the cross point
    radius : float
        radius of the pen, blob radii; at the distance r beyond it blobs feel
        :math:`2.5\,kT\,(r/a)^2`
    sweeps : int
        Monte Carlo sweeps for the reference, after half as many for equilibration
    systems : int
        number of systems sampled side by side
    seed : int
        seed of the Monte Carlo run

    Returns
    -------
    WallScene
        its attribute `sampled` has the averages of the Monte Carlo run: name -> (value, standard
        error)
    """
    sites, kT = _body_sites(blobsPerArm), GAS_CONSTANT*TEMPERATURE
    system, _, integrator = _system(sites, bodies, weight)
    pen = openmm.CustomExternalForce(f'{PEN*kT!r}*max(0,sqrt(x^2+y^2)/{RADIUS}-{radius})^2')
    pair = openmm.CustomNonbondedForce(f'{PAIR*kT!r}*exp(-3*(r/{RADIUS}-2))')
    for particle in range(system.getNumParticles()):
        pen.addParticle(particle, [])
        pair.addParticle([])
    for body in range(bodies):
        own = integrator.getRigidBodyParticles(body)
        for i in own:
            for j in own:
                if i < j:
                    pair.addExclusion(i, j)
    system.addForce(pen)
    system.addForce(pair)
    sampler = _Pen(sites, bodies, weight, radius, systems, seed)
    sampler.burnIn(max(1, sweeps // 2))
    sums = {}
    for _ in range(sweeps):
        sampler.sweep()
        for name, values in measure(sampler.R*RADIUS, sampler.q, sites).items():
            sums[name] = sums.get(name, 0) + values.mean(axis=1)/sweeps
    scene = WallScene(
        system, sampler.blobs[0].reshape(-1, 3)*RADIUS, integrator, sites, 1,
        name=f'boomerangs{bodies}', description=
        f'{bodies} boomerangs of {len(sites)} blobs above a wall in a pen of radius {radius:g} a, '
        f'weight {weight:.4g} '
        f'kT/a, which repel each other softly; averages by Monte Carlo ({systems} systems, '
        f'{sweeps} sweeps)', stepSizes=[picoseconds(h) for h in (0.02, 0.05, 0.1)])
    # Systems are independent, so their spread gives the error.
    scene.sampled = {
        name: (float(values.mean()), float(values.std(ddof=1)/math.sqrt(systems)))
        for name, values in sums.items()
    }
    return scene


def _places(R, q, sites):
    """Positions of all blobs of bodies at R (n, 3), q (n, 4): nm."""
    return (np.asarray(R)[:, None, :] +
            np.einsum('bij,kj->bki', rotation_matrices(np.asarray(q)), sites)).reshape(-1, 3)


def measure(R: npt.ArrayLike, q: npt.ArrayLike, sites: npt.ArrayLike) -> dict:
    """The observables of bodies, as functions of their poses.

    Parameters
    ----------
    R : array-like of shape (..., 3)
        centres of mass, nm
    q : array-like of shape (..., 4)
    sites : array-like of shape (blobs, 3)
        nm

    Returns
    -------
    dict
        height (of the cross point, blob radii), cos2, repulsion (kT), each of shape (...)
    """
    R, q = np.asarray(R, dtype=float), np.asarray(q, dtype=float)
    vertical = rotation_matrices(q.reshape(-1, 4))[:, 2, :].reshape(q.shape[:-1] + (3,))
    heights = (R[..., 2:] + vertical @ sites.T)/RADIUS
    gaps = heights - 1
    return {
        'height': heights[..., len(sites) // 2],
        'cos2': vertical[..., 2]**2,
        'repulsion': wallRepulsion(gaps).sum(axis=-1)
    }


def _sites_of(scene, name):
    """The blobs of the bodies above a wall."""
    if not hasattr(scene, 'sites'):
        raise ValueError(f'observable {name}: the scene {scene.name} is no WallScene, such as '
                         'boomerang; this observable is of its bodies: use mean_height, '
                         'height[LOW,HIGH], msd_PS or lateral_msd_PS for other scenes')
    return scene.sites


class _Average:
    """An observable of each replica, or averaged over the bodies of the only one."""
    def __init__(self, name):
        self.name = name

    def __call__(self, sample):
        scene = sample.scene
        sites = _sites_of(scene, self.name)
        R, q = sample.rigid.getBodyPositions()._value, sample.rigid.getBodyOrientations()
        values = measure(R, q, sites)[self.name]
        return values if scene.replicas > 1 else float(values.mean())


class _Last:
    """The previous sample of a run."""
    def __init__(self, scene, platform, properties):
        _sites_of(scene, 'msd')
        self.heights = None


class _Displacement:
    """Mean square change of heights from sample to sample; not a number at first."""
    def __call__(self, sample, last):
        R, q = sample.rigid.getBodyPositions()._value, sample.rigid.getBodyOrientations()
        before, last.heights = last.heights, measure(R, q, sample.scene.sites)['height']
        values = np.full(len(R), np.nan) if before is None else (last.heights - before)**2
        return values if sample.scene.replicas > 1 else float(values.mean())


OBSERVABLES = {
    observable.name: observable
    for observable in
    (Observable('height', 'mean height of the cross point', 'a', _Average('height')),
     Observable('cos2', '<cos^2> of normal and vertical', '', _Average('cos2')),
     Observable('repulsion', 'repulsion by the wall', 'kT per body', _Average('repulsion')),
     Observable('msd', 'mean square change of height in τ_D', 'a^2', _Displacement(), setup=_Last))
}
#: The schemes without momenta that sample the right distribution as the step vanishes.
CONSISTENT = SCHEMES[1:]


class _Inertial:
    """LangevinHI with masses and moments that relax at a given rate times the step.

    The rate is that in unbounded fluid.
    """
    def __init__(self, rateTimesStep):
        self.rateTimesStep = rateTimesStep

    def __call__(self, scene, stepSize, seed):
        translation, rotation = scene.frictions
        time = stepSize/self.rateTimesStep
        integrator = CustomRigidHIIntegrator(scene.temperature, stepSize)
        integrator.setScheme(Scheme.LangevinHI)
        integrator.setRandomNumberSeed(seed)
        for body in scene.bodies:
            integrator.addRigidBody(body, translation*time, rotation*time, scene.sites)
        return integrator


#: All methods by name. At a fixed rate times step the masses shrink with the step, so the error is
#: of first order.
METHODS = {
    **{
        name: Method(name, RigidScheme(getattr(Scheme, name)), 1, None, 'without momenta')
        for name in SCHEMES
    },
    **{
        name: Method(name, _Inertial(rate), 1, None, f'masses such that momenta relax in '
                     f'{1/rate:.3g} steps')
        for name, rate in INERTIA.items()
    }
}


def byName(name: str) -> Method:
    """A method by its name.

    Parameters
    ----------
    name : str

    Raises
    ------
    ValueError
        for any other name
    """
    if name not in METHODS:
        raise ValueError(
            f'method: got {name!r}, which is no road to the overdamped limit; choose among '
            f'{", ".join(METHODS)}')
    return METHODS[name]


#: Scenes by name.
SCENES = {'boomerang': boomerang, 'suspension': suspension}


class OverdampedStudy(StepSizeStudy):
    """Bias of equilibrium averages against time per diffusion time.

    The study compares the schemes without momenta and LangevinHI.

    Parameters
    ----------
    scene : WallScene
        :func:`boomerang` or :func:`suspension`
    methods : sequence of str
        among SCHEMES and INERTIA
    stepSizes : sequence of float, or dict from method name to sequence of float, optional
        in units of tau_D; default: the scene's. A whole number of steps must add up to 1.
    observables : sequence of str
        among height, cos2, repulsion and msd. msd describes the motion: its reference is the common
        limit of the consistent schemes without momenta.
    **kwargs
        platform, threads, seed, clock: see Study

    Examples
    --------
    >>> from openmmrigidhi.accuracy import overdamped
    >>> scene = overdamped.boomerang(4, blobsPerArm=1)
    >>> study = overdamped.OverdampedStudy(scene, ['RandomFiniteDifference'], [0.1, 0.4])
    >>> study.run(length=40*study.scene.timeUnit).recommend('height:50%').verdict
    'recommended'
    """
    def __init__(self, scene: WallScene, methods: Sequence[str] = tuple(METHODS),
                 stepSizes: Optional[Union[Sequence[float], dict[str, Sequence[float]]]] = None,
                 observables: Sequence[str] = tuple(OBSERVABLES), platform: str = 'Reference',
                 **kwargs: Any) -> None:
        if isinstance(stepSizes, dict):
            stepSizes = {
                name: [h*scene.timeUnit for h in steps]
                for name, steps in stepSizes.items()
            }
        elif stepSizes is not None:
            stepSizes = [h*scene.timeUnit for h in stepSizes]
        for name in observables:
            if name not in OBSERVABLES:
                raise ValueError(
                    f'observable: got {name!r}, which bodies above a wall do not have; choose '
                    f'among {", ".join(OBSERVABLES)}')
        super().__init__(scene, [byName(name) for name in methods], stepSizes,
                         getattr(scene, 'sampled',
                                 None), observables=[OBSERVABLES[name] for name in observables],
                         platform=platform, **kwargs)
        perDay = scene.replicas*1000/SECONDS_PER_DAY/scene.timeUnit
        for setting in self.settings():
            if abs(scene.timeUnit/setting.stepSize - round(scene.timeUnit/setting.stepSize)) > 1e-6:
                raise ValueError(
                    f'OverdampedStudy: stepSizes: got {setting.stepSize/scene.timeUnit:g}; a whole '
                    f'number of steps must make 1 '
                    '(τ_D), the time between samples: take e.g. 0.05, 0.1, 0.2, 0.25, 0.5')
        self.knob = Knob('step_size', 'step', 'τ_D', 1/scene.timeUnit, 'τ_D/s', perDay)

    def reference(self, observable: Observable, rows: list[dict]) -> Optional[Reference]:
        """The exact or sampled average, or the common limit of consistent schemes without momenta.

        Parameters
        ----------
        observable : Observable
        rows : list of dict
            the observable's rows of stable settings
        """
        return super().reference(observable, [row for row in rows if row['method'] in CONSISTENT])
