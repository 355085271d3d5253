"""Gibbs-Boltzmann Monte Carlo of rigid bodies under the forces of an OpenMM Context."""
from __future__ import annotations

from typing import TYPE_CHECKING, Callable, Optional, Sequence, Union

import numpy as np

from .. import _units
from .._types import Number, Numbers
from .._quaternions import rotate
from .._systems import (BodyDefinitions, forces_of, hydrodynamic_radii, refuse_driven_flow,
                        refuse_joints, walls_of)
from ..bodyforce import CustomBodyForce
from ..integrator import CustomRigidHIIntegrator
from ..mobility import MobilityForce
from . import _moves
from ._sampler import Sampler

if TYPE_CHECKING:
    import openmm

_MOVES = ('single', 'all')
_Z = 2


class GibbsBoltzmannSampler(Sampler):
    r"""Samples poses of a Context's rigid bodies and free particles from :math:`\exp(-U/kT)`.

    The samples are the reference that dynamics must reproduce. Metropolis moves respect the measure
    dR times Haar's on SO(3) for each body (and dr for each free particle), at constant box. U is
    the potential energy of the Context's forces in the integrator's force groups, plus
    energyFunction. Momenta, fluid and scheme do not matter: every right scheme has this
    distribution as its step tends to 0. A driven fluid has no such distribution and is an error.

    A trial costs one evaluation of the Context's energy (1 us or less of OpenMM's own on the
    Reference platform, 50 us on CPU) and some 40 us of Python. A sweep is one trial of each kind
    for every body. For one body with an energy written in NumPy, :class:`WalkerSampler` is a
    hundred times faster.

    Parameters
    ----------
    context : openmm.Context
        with a CustomRigidHIIntegrator and positions, at which the sampler starts; the sampler
        leaves it at the last sample
    temperature : float or Quantity, optional
        K; None: the integrator's temperature
    energyFunction : callable, optional
        ``energyFunction(positions, orientations)`` is an additional energy, kJ/mol, of the poses of
        all bodies: arrays (n, 3) in nm, and (n, 4) of unit quaternions (w, x, y, z), body frame to
        lab frame. Infinity forbids the poses. A System with a CustomBodyForce, which has no energy,
        needs this function.
    wallHeight : float or Quantity, optional
        height z of a hard wall, nm; None: the no-slip wall of a MobilityForce, else no wall. Both
        walls of a MobilityForce's SlipChannel or NoSlipChannel, or the wall and the surface of its
        Film, act in addition.
    radii : sequence or Quantity of shape (particles of the System,), optional
        radii that walls stop, nm; particles of radius 0 do not feel walls; None: the radii of the
        MobilityForce
    rejection : str or constant, optional
        Under "Overlap" every particle with a radius must have z - wallHeight >= its radius, under
        "Crossing" z - wallHeight > 0. The same holds at both walls of a channel. None: the
        integrator's wall rejection.
    coordinates : sequence of str
        the sampled coordinates: any of "x", "y", "z", "rotation"
    rotationAxis : Vec3 or sequence of shape (3,), optional
        turn only about this axis of the lab; None: about all axes
    trackingPoints : array-like or Quantity of shape (bodies, 3), optional
        the point of each body about which the moves turn it, body frame, nm; None: the origins. The
        points change only how fast samples become independent.
    bodies : sequence of int, optional
        which bodies move; None: all bodies that the integrator does not hold
    freeParticles : sequence of int, optional
        which free particles move; None: all free particles that have a mass or a radius and are not
        held, without virtual sites
    moves : str
        with "single" every trial moves one body or free particle; with "all" every trial moves all
        of them, which suits few or strongly coupled bodies
    seed : int
        seed of the random numbers; 0: a fresh seed

    Attributes
    ----------
    seed : int
        the seed in use

    Raises
    ------
    TypeError, ValueError
        for arguments of wrong dimension or shape, for a start that a wall forbids or that has an
        infinite energy, for a CustomBodyForce without energyFunction, for constraints on a moving
        free particle, for a MobilityForce with a driven flow, or for joints

    Notes
    -----
    Bodies need no masses. A Context of bodies without masses, as
    :func:`openmmrigidhi.app.addRigidMultiblob` adds them, needs a scheme without momenta, such as
    ``FixmanMidpoint``, and a MobilityForce for this scheme.

    Unconfined coordinates, such as x and y over a plain wall, drift without limit. This does not
    harm the other coordinates. StokesianDynamics keeps spheres from overlapping; here a force, or
    an infinite energyFunction, must do so.
    """
    def __init__(self, context: openmm.Context, temperature: Optional[Number] = None,
                 energyFunction: Optional[Callable] = None, wallHeight: Optional[Number] = None,
                 radii: Optional[Numbers] = None, rejection: Optional[Union[int, str]] = None,
                 coordinates: Sequence[str] = _moves.COORDINATES,
                 rotationAxis: Optional[Numbers] = None, trackingPoints: Optional[Numbers] = None,
                 bodies: Optional[Sequence[int]] = None,
                 freeParticles: Optional[Sequence[int]] = None, moves: str = 'single',
                 seed: int = 0) -> None:
        where = 'GibbsBoltzmannSampler'
        self._context = _units.context(context, where)
        system = context.getSystem()
        self._integrator = CustomRigidHIIntegrator.cast(context.getIntegrator())
        refuse_driven_flow(
            system, f'{where}: context',
            'and bodies in it are not distributed as exp(-U/kT): average over steps of the '
            'integrator')
        refuse_joints(self._integrator, f'{where}: context',
                      'which moves of bodies would tear: average over steps of the integrator')
        self._groups = self._integrator.getIntegrationForceGroups()
        self._kT = _moves.thermal_energy(
            self._integrator.getTemperature() if temperature is None else temperature, where)
        self._energyFunction = energyFunction
        if energyFunction is None and forces_of(system, CustomBodyForce):
            raise ValueError(
                f'{where}: energyFunction: the System has a CustomBodyForce, which has no energy; '
                f'sampling needs one: give '
                'the potential of its forces and torques, or zero where they have none')
        if moves not in _MOVES:
            raise ValueError(f'{where}: moves: got {moves!r}; it must be "single" or "all"')
        self._together = moves == 'all'
        self._motion = _moves.Motion(coordinates, rotationAxis, where)
        self.seed, self._random = _moves.generator(seed, where)
        self._take_bodies(trackingPoints, where)
        fluids = forces_of(system, MobilityForce)
        radii = hydrodynamic_radii(system, radii, where)
        self._bodies = self._chosen(bodies, self._movableBodies, where, 'bodies')
        self._free = self._chosen(freeParticles, self._movable_particles(system, radii), where,
                                  'freeParticles')
        self._check_constraints(system, where)
        self._walls = self._walls_of(wallHeight, radii, rejection, fluids, where)
        self._virtualSites = any(
            system.isVirtualSite(i)
            for i in set(range(system.getNumParticles())) - set(self._members.tolist()))
        self._places = context.getState(getPositions=True).getPositions(asNumpy=True)._value.copy()
        self._adopt_poses()
        self._check_start(where)
        extent = float(np.linalg.norm(self._sites, axis=1).max(initial=0))
        extent = extent or float(radii.max(initial=0)) or 1.0
        self._steps = _moves.stepSizes(self._motion.kinds if len(self._bodies) else [],
                                       len(self._bodies), extent)
        if len(self._free) and self._motion.along.any():
            self._steps['free'] = _moves.stepSizes(['translation'], len(self._free),
                                                   extent)['translation']

    # ---- What there is ---------------------------------------------------------------------------

    def _take_bodies(self, trackingPoints, where):
        """Members, sites and owners of all bodies, body after body."""
        bodies = BodyDefinitions(self._integrator)
        self._firstSite, self._members, self._sites, self._owners = (bodies.first, bodies.members,
                                                                     bodies.places, bodies.owners)
        self._movableBodies = np.flatnonzero(~bodies.held)
        self._points = np.zeros((len(bodies), 3)) if trackingPoints is None else \
            _units.rows(trackingPoints, _units.LENGTH, 3, where, 'trackingPoints', len(bodies))

    @staticmethod
    def _chosen(chosen, possible, where, name):
        possible = [int(i) for i in possible]
        if chosen is None:
            return np.array(possible, dtype=int)
        chosen = _units.indices(chosen, where, name).astype(int)
        wrong = [int(i) for i in chosen if i not in possible]
        if wrong or len(set(chosen.tolist())) < len(chosen):
            raise ValueError(
                f'{where}: {name}: got {chosen.tolist()}; each must be one of the {len(possible)} '
                f'that can move, and occur once: take out {wrong or "repetitions"}')
        return chosen

    def _movable_particles(self, system, radii):
        others = set(self._members.tolist()) | set(self._integrator.getHeldParticles())
        return [
            i for i in range(system.getNumParticles())
            if i not in others and not system.isVirtualSite(i) and (
                system.getParticleMass(i)._value > 0 or radii[i] > 0)
        ]

    def _check_constraints(self, system, where):
        moving = set(self._free.tolist())
        for k in range(system.getNumConstraints()):
            i, j, _ = system.getConstraintParameters(k)
            if i in moving or j in moving:
                raise ValueError(
                    f'{where}: freeParticles: a constraint holds the free particles {i} and {j}; '
                    'moves of one by one would break it: make them a body, or leave them out')

    def _walls_of(self, height, radii, rejection, fluids, where):
        """The plane wall, if there is one, and both walls of a channel."""
        places = [(place, axis, side)
                  for axis, place, side in walls_of(fluids[0])] if fluids else []
        if height is not None:
            given = (_units.number(height, _units.LENGTH, where, 'wallHeight'), _Z, 1)
            places = [given] + [wall for wall in places if len(places) > 1]
        if not places:
            return []
        if not np.any(radii > 0):
            raise ValueError(
                f'{where}: radii: got a wall, but every radius is 0, so that the wall would stop '
                'nothing: give radii, or add a MobilityForce')
        if rejection is None:
            rejection = self._integrator.getWallRejection()
        return [
            _moves.Wall(place, radii, rejection, where, axis, side) for place, axis, side in places
        ]

    def _adopt_poses(self):
        """Take the poses of the Context, and put the members where the poses say."""
        self._positions = self._integrator.getBodyPositions()._value.copy()
        self._orientations = self._integrator.getBodyOrientations().copy()
        self._places[self._members] = self._members_at(slice(None), self._positions,
                                                       self._orientations)

    def _check_start(self, where):
        for wall in self._walls:
            heights = wall.heights(self._places)
            if not wall.allows(heights):
                k = int(np.argmin(heights - wall.limits))
                owner = self._owners[self._members == k]
                raise ValueError(
                    f'{where}: context: particle {k} '
                    f'({f"body {owner[0]}" if len(owner) else "free"}) is at {"xyz"[wall.axis]} = '
                    f'{self._places[k, wall.axis]} nm, where a wall allows '
                    f'{wall.side*wall.limits[k]} nm or {"more" if wall.side > 0 else "less"}; a '
                    'start must be allowed: set positions away from it')
        self._energy = self._evaluate(self._positions, self._orientations)
        if not np.isfinite(self._energy):
            raise ValueError(
                f'{where}: context: the energy at the start is {self._energy} kJ/mol; a start must '
                'have a finite one: set other positions')

    # ---- Sampling --------------------------------------------------------------------------------

    def _present(self):
        return self._positions, self._orientations, self._energy, self._places[self._free]

    def _sweep(self, adapt):
        for kind, steps in self._steps.items():
            count = len(steps.sizes)
            for which in [np.arange(count)] if self._together else np.arange(count)[:, None]:
                trial = self._try_free if kind == 'free' else self._try_bodies
                steps.count(which, 1, trial(kind, which, steps.sizes[which]), adapt)

    def _try_bodies(self, kind, which, sizes):
        """Move some of the moving bodies, if Metropolis accepts the move; return whether it did."""
        bodies = self._bodies[which]
        R, q = self._positions.copy(), self._orientations.copy()
        if kind == 'translation':
            R[bodies] += self._motion.translations(self._random, sizes)
        else:
            q[bodies] = _moves.turned(self._motion.rotations(self._random, sizes), q[bodies])
            points = self._points[bodies]
            if points.any():
                R[bodies] += rotate(self._orientations[bodies], points) - rotate(q[bodies], points)
        sites = slice(self._firstSite[bodies[0]],
                      self._firstSite[bodies[0] + 1]) if len(bodies) == 1 else slice(None)
        members = self._members[sites]
        if not self._accept(members, self._members_at(sites, R, q), R, q):
            return False
        self._positions, self._orientations = R, q
        return True

    def _try_free(self, _, which, sizes):
        particles = self._free[which]
        moved = self._places[particles] + self._motion.translations(self._random, sizes)
        return self._accept(particles, moved, self._positions, self._orientations)

    def _accept(self, particles, places, R, q):
        """Put particles to places if Metropolis accepts the move; return whether it did."""
        if not all(
                wall.allows(wall.heights(places), wall.limits[particles]) for wall in self._walls):
            return False
        before = self._places[particles]
        self._places[particles] = places
        try:
            energy = self._evaluate(R, q)
        except BaseException:
            # The user may catch what energyFunction raised, or Ctrl-C, and go on: places must stay
            # those of the poses and of the energy.
            self._places[particles] = before
            raise
        # -log of a uniform number is an exponential number, and needs no care with large
        # differences.
        if energy - self._energy <= self._kT*self._random.standard_exponential():
            self._energy = energy
            return True
        self._places[particles] = before
        return False

    def _members_at(self, sites, R, q):
        owners = self._owners[sites]
        return R[owners] + rotate(q[owners], self._sites[sites])

    def _evaluate(self, R, q):
        """The energy, kJ/mol, with the particles at self._places.

        OpenMM gives NaN for an energy beyond the range of numbers; such an energy is never
        accepted.
        """
        self._context.setPositions(self._places)
        if self._virtualSites:
            self._context.computeVirtualSites()
        energy = self._context.getState(getEnergy=True,
                                        groups=self._groups).getPotentialEnergy()._value
        if self._energyFunction is not None:
            more = _moves.plain_energies(self._energyFunction(R, q), 'GibbsBoltzmannSampler')
            if more.ndim or _moves.is_no_energy(more):
                raise ValueError(
                    f'GibbsBoltzmannSampler: energyFunction: it returned {more.tolist()}; it must '
                    f'return one number, kJ/mol, or '
                    'infinity where a pose is forbidden: sum over bodies')
            energy += float(more)
        return energy

    def _hand_back(self):
        """Leave the Context at the last accepted configuration, with poses exact to the bit."""
        self._context.setPositions(self._places)
        if self._virtualSites:
            self._context.computeVirtualSites()
        self._integrator.setBodyPositions(self._positions)
        self._integrator.setBodyOrientations(self._orientations)
