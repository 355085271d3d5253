"""Energy minimisation with rigid bodies as units."""
from __future__ import annotations

import dataclasses
import warnings
from typing import Callable, Optional

import numpy as np
import openmm
from openmm import unit

from .. import _units
from .._types import Number
from .._quaternions import rotation_matrices
from .._systems import BodyDefinitions, hydrodynamic_radii, refuse_joints
from ..integrator import CustomRigidHIIntegrator

#: The default tolerance for molecules. With the length of molecules it is an energy of 2.5 kJ/mol,
#: kT at 300 K. Larger particles have this energy over their own length.
_MOLECULAR_TOLERANCE = 10.0  # kJ/(mol nm)
_MOLECULAR_LENGTH = 0.25  # nm
#: The largest move of coordinates within one run of L-BFGS. A chart of rotation vectors is good up
#: to about a radian.
_LARGEST_TRANSLATION = 0.8  # of the length of the particle
_LARGEST_ROTATION = 0.5  # rad
#: Springs hold constraints among free particles to this relative error; the end is exact.
_CONSTRAINT_ERROR = 1e-4
#: The largest number of times that springs are made stiffer, tenfold each time.
_MAX_STIFFENINGS = 3
#: A run of L-BFGS that lowers the energy by less than this part has come as far as rounding allows.
_SMALLEST_DECREASE = 1e-8
#: The largest move of a coordinate in the first step of a run of L-BFGS, of the length of the
#: particle. The run does not know the curvature of the energy yet.
_FIRST_STEP = 0.02


@dataclasses.dataclass
class MinimizationResult:
    """The outcome of a minimisation.

    It has the energies, the remaining root mean square force component, the numbers of iterations
    and evaluations, and the tolerance. Force and tolerance belong to one particle, or to all
    molecules together: to the one whose force is the largest multiple of its tolerance.
    """

    initialEnergy: unit.Quantity
    finalEnergy: unit.Quantity
    rmsForce: unit.Quantity
    iterations: int
    evaluations: int
    converged: bool
    tolerance: unit.Quantity = None


def minimize(context: openmm.Context, tolerance: Optional[Number] = None, maxIterations: int = 0,
             reporter: Optional[Callable] = None,
             progress: Optional[bool] = None) -> MinimizationResult:
    """Minimise the potential energy with the bodies of a CustomRigidHIIntegrator as rigid units.

    OpenMM's own minimiser moves the members of bodies one by one. This does not work for bodies
    that no constraints hold. It leaves particles of mass 0, and so bodies without mass, where they
    are, and does not say so. Here each body has six coordinates, a translation and a rotation
    vector, and each free particle three. Massless free particles stay, unless they have a
    hydrodynamic radius. Held bodies and particles stay, too. The method is L-BFGS-B of SciPy. The
    origin of the rotation vectors moves along whenever a body has turned by half a radian. Stiff
    springs hold the constraints between free particles during the search. At its end the
    constraints are made exact, as in OpenMM's minimiser. Velocities do not change.

    Parameters
    ----------
    context : openmm.Context
        with positions; left at the minimum
    tolerance : float or Quantity, optional
        the search ends when the root mean square of the force components is at most this, kJ/(mol
        nm), for each body and free particle that is longer than 0.25 nm, and for all others
        together. Torques are divided by the root mean square distance of a body's sites from its
        origin, or by the body's largest hydrodynamic radius if this is larger. None: 2.5 kJ/mol (kT
        at 300 K) divided by the length of the body or particle, but at most 10, which suits
        molecules. The length is the body's smallest hydrodynamic radius above 0. Where it has no
        radius, the length is the smallest radius of all, or without radii half of the median
        distance of a particle from its nearest neighbour. The result states the tolerance.
    maxIterations : int
        the largest number of iterations; 0: no limit
    reporter : callable, optional
        called as reporter(iteration, energy, rmsForce) after each iteration, with Quantities
    progress : bool, optional
        whether to show a progress bar; None: if standard error is a terminal

    Returns
    -------
    MinimizationResult

    Raises
    ------
    TypeError
        if the Context's integrator is of another class
    ValueError
        for a wrong argument, or if the integrator has joints
    openmm.OpenMMException
        if positions are missing or do not fit the bodies, or if the energy is not finite at the
        start

    Notes
    -----
    An iteration costs one to two force evaluations and O(particles) numpy arithmetic. Energies on
    the CPU platform have single precision, which limits the smallest tolerance that a search can
    reach. If a search does not reach the tolerance, converged is False and a warning says so.
    """
    import tqdm
    if tolerance is not None:
        tolerance = _units.number(tolerance, _units.FORCE, 'minimize', 'tolerance')
    maxIterations = _units.integer(maxIterations, 'minimize', 'maxIterations')
    if tolerance is not None and not 0 < tolerance < np.inf:
        raise ValueError(
            f'minimize: tolerance: got {tolerance} kJ/(mol nm); it must be finite and positive')
    if maxIterations < 0:
        raise ValueError(
            f'minimize: maxIterations: got {maxIterations}; it must not be negative: give 0 for no '
            f'limit')
    with tqdm.tqdm(desc='minimize', unit=' iterations',
                   disable=None if progress is None else not progress) as bar:
        search = _Search(_Scene(context), tolerance, maxIterations, reporter, bar)
        return search.run()


class _Scene:
    """The coordinates of a Context.

    They are the origins R and quaternions q of the bodies, and the positions x of the free
    particles that move. Of the bodies, those in ``movable`` move.
    """
    def __init__(self, context):
        self.context = context
        self.integrator = CustomRigidHIIntegrator.cast(context.getIntegrator())
        refuse_joints(
            self.integrator, 'minimize: context',
            'which the search would tear: run steps of the integrator at temperature 0 instead')
        self.groups = self.integrator.getIntegrationForceGroups()
        system = context.getSystem()
        self.radii = hydrodynamic_radii(system, None, 'minimize')
        self._read_bodies(system)
        self._read_free_particles(system)
        self.R = self.integrator.getBodyPositions()._value
        self.q = self.integrator.getBodyOrientations()
        self.x = self._all_positions()[self.free]
        self.extent = self._extent()
        self.bodyLengths, self.freeLengths = self._own_lengths(), self._lengths_of(
            self.radii[self.free])

    def _read_bodies(self, system):
        bodies = BodyDefinitions(self.integrator)
        self.numBodies, self.members, self.first = len(bodies), bodies.members, bodies.first
        self.movable = np.flatnonzero(~bodies.held)
        # OpenMM has added a virtual site's force to its parents when we see it.
        real = np.array([not system.isVirtualSite(int(i)) for i in self.members], dtype=bool)
        self.sites, self.siteBody, self.siteParticle = bodies.places[real], bodies.owners[
            real], self.members[real]
        distance = np.sqrt(
            self._sum_over_bodies((self.sites**2).sum(axis=1))/
            np.maximum(1, np.bincount(self.siteBody, minlength=self.numBodies)))
        # A body without extent feels no torque, so any length will do.
        self.length = np.where(distance > 0, distance, 1.0)
        if self.numBodies > 0:
            # A sphere may have a marker near its centre.
            self.length = np.maximum(
                self.length, np.maximum.reduceat(self.radii[self.members], bodies.first[:-1]))

    def _read_free_particles(self, system):
        inBody = set(self.members.tolist())
        others = [i for i in range(system.getNumParticles()) if i not in inBody]
        held = set(self.integrator.getHeldParticles())
        # Schemes without momenta move massless particles that the fluid sees.
        self.free = np.array([
            i for i in others if i not in held and not system.isVirtualSite(i) and (
                system.getParticleMass(i)._value > 0 or self.radii[i] > 0)
        ], dtype=int)
        self.hasFreeVirtualSites = any(system.isVirtualSite(i) for i in others)
        place = {particle: k for k, particle in enumerate(self.free)}
        constraints = [system.getConstraintParameters(i) for i in range(system.getNumConstraints())]
        constraints = [(place[i], place[j], d._value) for i, j, d in constraints
                       if i in place and j in place]
        self.constraints = np.array([c[:2] for c in constraints], dtype=int).reshape(-1, 2)
        self.distances = np.array([c[2] for c in constraints])

    def _extent(self):
        """The length of the scene, nm."""
        radii = self.radii[np.concatenate([self.members, self.free])]
        if np.any(radii > 0):
            length = radii[radii > 0].min()
        else:
            length = self._neighbour_distance()/2
        return max(length, _MOLECULAR_LENGTH)

    def _lengths_of(self, radii):
        """The lengths of particles with such radii, nm."""
        return np.where(radii > 0, np.maximum(radii, _MOLECULAR_LENGTH), self.extent)

    def _own_lengths(self):
        """The length of each body, nm."""
        if self.numBodies == 0:
            return np.empty(0)
        radii = self.radii[self.members]
        smallest = np.minimum.reduceat(np.where(radii > 0, radii, np.inf), self.first[:-1])
        return self._lengths_of(np.where(np.isfinite(smallest), smallest, 0))

    def _neighbour_distance(self):
        """Median distance of a particle from its nearest neighbour, nm; 0 without one.

        A body of one or two particles, a sphere perhaps with a marker, is one particle at its
        origin.
        """
        import scipy.spatial
        small = np.bincount(self.siteBody, minlength=self.numBodies) <= 2
        points = np.concatenate([
            self.R[small],
            self._all_positions()[self.siteParticle[~small[self.siteBody]]], self.x
        ])
        if len(points) < 2 or not np.all(np.isfinite(points)):
            return 0.0
        return np.median(scipy.spatial.cKDTree(points).query(points, 2)[0][:, 1])

    def _sum_over_bodies(self, values):
        """Sum values over the sites of each body; values of shape (sites,) or (sites, 3)."""
        if values.ndim == 1:
            return np.bincount(self.siteBody, values, self.numBodies)
        return np.stack([np.bincount(self.siteBody, column, self.numBodies) for column in values.T],
                        axis=1)

    def _all_positions(self):
        return self.context.getState(getPositions=True).getPositions(asNumpy=True)._value

    def place(self, R, q, x):
        """Move everything in the Context to these coordinates."""
        if self.numBodies > 0:
            self.integrator.setBodyPositions(R)
            self.integrator.setBodyOrientations(q)
        if len(self.free) > 0:
            positions = self._all_positions()
            positions[self.free] = x
            self.context.setPositions(positions)
        if self.hasFreeVirtualSites:
            self.context.computeVirtualSites()

    def evaluate(self, R, q, x):
        """Energy, forces and torques on bodies, and forces on free particles.

        The torques are about the origins, in the lab frame.
        """
        self.place(R, q, x)
        state = self.context.getState(getEnergy=True, getForces=True, groups=self.groups)
        forces = state.getForces(asNumpy=True)._value
        siteForces = forces[self.siteParticle]
        arms = np.einsum('sij,sj->si', rotation_matrices(q)[self.siteBody], self.sites)
        return (state.getPotentialEnergy()._value, self._sum_over_bodies(siteForces),
                self._sum_over_bodies(np.cross(arms, siteForces)), forces[self.free])

    def applyConstraints(self, R, q, x):
        """Make the constraints of free particles exact, and return their positions; bodies stay."""
        self.place(R, q, x)
        if len(self.distances) == 0:
            return x
        self.context.applyConstraints(self.integrator.getConstraintTolerance())
        x = self._all_positions()[self.free]
        # OpenMM has also moved members of constrained bodies, in single precision: put them back.
        self.place(R, q, x)
        return x


class _Finished(Exception):
    """The search is over."""


class _Recentre(Exception):
    """The rotation vectors have grown too large."""


class _Search:
    """A sequence of L-BFGS runs.

    The vector y holds translations, length times rotation vectors, and moves of free particles. The
    coordinates of a particle that is longer than the scene's length are divided by their ratio, so
    that large and small particles come as far in a step as their sizes allow.
    """
    def __init__(self, scene, tolerance, maxIterations, reporter, bar):
        self.scene = scene
        n = len(scene.movable)
        lengths = np.concatenate([
            np.tile(np.repeat(scene.bodyLengths[scene.movable], 3), 2),
            np.repeat(scene.freeLengths, 3)
        ])
        self.turnLengths = scene.length[scene.movable]
        self.scales = lengths/scene.extent
        # Molecules are judged together, and each larger particle by itself.
        particles = np.concatenate([
            np.tile(np.repeat(np.arange(n), 3), 2),
            np.repeat(np.arange(n, n + len(scene.freeLengths)), 3)
        ])
        self.particles, self.groups = np.unique(
            np.where(lengths > _MOLECULAR_LENGTH, particles, -1), return_inverse=True)
        self.counts = np.bincount(self.groups)
        energy = _MOLECULAR_TOLERANCE*_MOLECULAR_LENGTH
        self.tolerances = np.full(len(self.counts), tolerance or energy/_MOLECULAR_LENGTH)
        if tolerance is None:
            self.tolerances[self.groups] = energy/lengths
            tolerance = energy/scene.extent
        self.tolerance = tolerance
        self.maxIterations = maxIterations
        self.reporter = reporter
        self.bar = bar
        self.iterations = self.evaluations = 0
        self.stiffness = tolerance/_CONSTRAINT_ERROR  # kJ/(mol nm^2)
        self.converged = False
        self.R, self.q, self.x = scene.R, scene.q, scene.x

    def run(self):
        scene = self.scene
        if self._size() == 0:
            warnings.warn(
                'minimize: nothing can move: the Context has no bodies, and no particle has a mass '
                'or a hydrodynamic radius; add bodies to the integrator before the Context is '
                'created' if scene.numBodies == 0 and not scene.integrator.getHeldParticles() else
                'minimize: nothing can move: the integrator holds all bodies and particles; let '
                'some go by setBodyHeld() or setParticleHeld()', stacklevel=3)
        self.x = scene.applyConstraints(self.R, self.q, self.x)
        initial, gradient = self._value(np.zeros(self._size()))
        if not np.isfinite(initial) or not np.all(np.isfinite(gradient)):
            raise openmm.OpenMMException(
                f'minimize: energy at the start is {initial} kJ/mol; it and all forces must be '
                'finite: look for particles at the same place or with bad parameters')
        initialEnergy = initial - self._springs(self.x)[0]
        for _ in range(_MAX_STIFFENINGS + 1):
            self._minimize_with_springs()
            if self._constraint_error() <= _CONSTRAINT_ERROR or self._out_of_iterations():
                break
            self.stiffness *= 10
        self.x = scene.applyConstraints(self.R, self.q, self.x)
        finalEnergy = scene.evaluate(self.R, self.q, self.x)[0]
        if not self.converged and not self._out_of_iterations():
            warnings.warn(
                f'minimize: the root mean square force{self._of_what()} is {self.rms:.3g} '
                f'kJ/(mol nm), above the tolerance {self.tolerance:.3g}: the search got stuck, '
                'most likely at the precision of the forces; use the Reference platform or a '
                'larger tolerance')
        return MinimizationResult(_units.ENERGY.attach(initialEnergy),
                                  _units.ENERGY.attach(finalEnergy), _units.FORCE.attach(self.rms),
                                  self.iterations, self.evaluations, self.converged,
                                  _units.FORCE.attach(self.tolerance))

    def _size(self):
        return 6*len(self.scene.movable) + 3*len(self.scene.free)

    def _out_of_iterations(self):
        return 0 < self.maxIterations <= self.iterations

    def _minimize_with_springs(self):
        """Run L-BFGS until it is done.

        It is done when the forces are small, when the iterations are used up, or when the energy
        does not go down any more.
        """
        import scipy.optimize
        limits = self._limits()
        self.converged = False
        energy, gradient = self._value(np.zeros(self._size()))
        self._note(np.zeros(self._size()), energy, gradient)
        while not self.converged and not self._out_of_iterations():
            before = self.energy
            # The first trial step of SciPy is minus the gradient of the function that it is given.
            scale = _FIRST_STEP*self.scene.extent/np.max(np.abs(self.gradient))

            def scaled_value(y):
                energy, gradient = self._value(y)
                return scale*(energy - before), scale*gradient

            try:
                result = scipy.optimize.minimize(
                    scaled_value, np.zeros(self._size()), jac=True, method='L-BFGS-B',
                    callback=self._after_iteration, bounds=np.stack([-limits, limits],
                                                                    axis=1), options={
                                                                        'maxiter': 2**30,
                                                                        'maxfun': 2**30,
                                                                        'ftol': 0,
                                                                        'gtol': 0,
                                                                        'maxcor': 20,
                                                                        'maxls': 30
                                                                    })
                self._note(result.x, *self._value(result.x))
                stuck = before - self.energy <= _SMALLEST_DECREASE*abs(self.energy)
            except (_Recentre, _Finished):
                stuck = False
            self.R, self.q, self.x = self._unpack(self.best)
            if stuck:
                break

    def _limits(self):
        n = len(self.scene.movable)
        rotations = np.repeat(self.turnLengths, 3)*_LARGEST_ROTATION/self.scales[3*n:6*n]
        return np.concatenate([
            np.full(3*n, _LARGEST_TRANSLATION*self.scene.extent), rotations,
            np.full(3*len(self.scene.free), _LARGEST_TRANSLATION*self.scene.extent)
        ])

    def _split(self, y):
        """Translations, rotation vectors and moves of free particles in y."""
        n = len(self.scene.movable)
        y = y*self.scales
        return (y[:3*n].reshape(-1, 3), y[3*n:6*n].reshape(-1, 3)/self.turnLengths[:, None],
                y[6*n:].reshape(-1, 3))

    def _unpack(self, y):
        """Origins, quaternions and free positions for y, from the present centre of the chart."""
        translations, rotations, moves = self._split(y)
        movable = self.scene.movable
        R, q = self.R.copy(), self.q.copy()
        R[movable] += translations
        q[movable] = _turned(rotations, q[movable])
        return R, q, self.x + moves

    def _value(self, y):
        """Energy (with springs) and its gradient."""
        self.evaluations += 1
        R, q, x = self._unpack(y)
        energy, forces, torques, freeForces = self.scene.evaluate(R, q, x)
        springEnergy, springForces = self._springs(x)
        movable = self.scene.movable
        turns = -_turn_gradient(self._split(y)[1], torques[movable])/self.turnLengths[:, None]
        gradient = np.concatenate(
            [-forces[movable].ravel(),
             turns.ravel(), -(freeForces + springForces).ravel()])*self.scales
        energy += springEnergy
        self.last = (y.copy(), energy, gradient)
        if not (np.isfinite(energy) and np.all(np.isfinite(gradient))) and np.any(y):
            return self._wall(y)
        return energy, gradient

    def _wall(self, y):
        """Replaces an energy that is not finite.

        The replacement is so high and steep that the line search turns back.
        """
        away = y - self.best
        height = 1e3*(1 + abs(self.energy))
        return self.energy + height, 2*height*away/max(away @ away, 1e-30)

    def _springs(self, x):
        """Energy and forces of the springs that hold the constraints of free particles."""
        i, j = self.scene.constraints.T
        forces = np.zeros_like(x)
        if len(i) == 0:
            return 0.0, forces
        separation = x[j] - x[i]
        distance = np.linalg.norm(separation, axis=1)
        stretch = distance - self.scene.distances
        pull = (self.stiffness*stretch/distance)[:, None]*separation
        np.add.at(forces, i, pull)
        np.add.at(forces, j, -pull)
        return 0.5*self.stiffness*(stretch @ stretch), forces

    def _constraint_error(self):
        """Largest relative error of a constraint between free particles."""
        i, j = self.scene.constraints.T
        if len(i) == 0:
            return 0.0
        distance = np.linalg.norm(self.x[j] - self.x[i], axis=1)
        return np.max(np.abs(distance - self.scene.distances)/self.scene.distances)

    def _note(self, y, energy, gradient):
        self.best, self.energy, self.gradient = y.copy(), energy, gradient
        self.worst, self.rms = 0, 0.0
        if len(gradient) > 0:
            rms = np.sqrt(np.bincount(self.groups, (gradient/self.scales)**2)/self.counts)
            self.worst = np.argmax(rms/self.tolerances)
            self.rms, self.tolerance = rms[self.worst], self.tolerances[self.worst]
        self.converged = bool(self.rms <= self.tolerance)

    def _of_what(self):
        """The particle that is judged by itself and farthest from its tolerance, in words."""
        k = self.particles[self.worst]
        if k < 0:
            return ''
        movable, free = self.scene.movable, self.scene.free
        if k < len(movable):
            return f' of body {movable[k]}'
        return f' of particle {free[k - len(movable)]}'

    def _after_iteration(self, y):
        """SciPy calls this after each iteration; an exception is the only way to end its search."""
        if not np.array_equal(y, self.last[0]):
            self._value(y)
        self._note(*self.last)
        self.iterations += 1
        self.bar.update()
        self.bar.set_postfix_str(f'{self.energy:.6g} kJ/mol, rms force {self.rms:.3g} kJ/(mol nm)',
                                 refresh=False)
        if self.reporter is not None:
            self.reporter(self.iterations, _units.ENERGY.attach(self.energy),
                          _units.FORCE.attach(self.rms))
        if self.converged or self._out_of_iterations():
            raise _Finished()
        if np.any(np.abs(y) >= 0.999*self._limits()):
            raise _Recentre()


def _turned(rotations, q):
    """Quaternions q after turns by lab-frame rotation vectors: exp(rotation/2) q, normalised."""
    angle = np.linalg.norm(rotations, axis=1)
    c = np.cos(angle/2)[:, None]
    s = (0.5*np.sinc(angle/(2*np.pi))
         )[:, None]*rotations  # sin(angle/2) times the axis; numpy's sinc(x) has x pi
    w, v = q[:, :1], q[:, 1:]
    result = np.concatenate([c*w - np.sum(s*v, axis=1, keepdims=True), c*v + w*s + np.cross(s, v)],
                            axis=1)
    return result/np.linalg.norm(result, axis=1, keepdims=True)


def _turn_gradient(rotations, torques):
    """J^T torque, with J the left Jacobian of the exponential map.

    A change d of the rotation vector turns by J d, and J^T torque = torque - (1-cos a)/a^2 w x
    torque + (a - sin a)/a^3 w x (w x torque), a = |w|.
    """
    angle = np.linalg.norm(rotations, axis=1)[:, None]
    # Below this angle the series to a^2 is right to 1e-10, and the closed form loses digits.
    small = angle < 1e-2
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 0.5 - angle**2/24, (1 - np.cos(safe))/safe**2)
    second = np.where(small, 1/6 - angle**2/120, (safe - np.sin(safe))/safe**3)
    once = np.cross(rotations, torques)
    return torques - first*once + second*np.cross(rotations, once)
