"""Put bodies in their places, and make bodies whole that a periodic box has torn apart."""
from __future__ import annotations

from typing import TYPE_CHECKING, Optional

import numpy as np
import openmm

from .. import _units
from .._quaternions import product, rotate
from .._types import Number, Numbers
from .._systems import BodyDefinitions
from ..integrator import CustomRigidHIIntegrator

if TYPE_CHECKING:
    from openmm import unit
    import numpy.typing as npt

#: The largest distance of a particle from its place, in units of the largest distance of a site
#: from the centre of the body. Particles that are farther off are another molecule, or the same one
#: mirrored, torn apart, or in another order.
_FARTHEST = 0.5
#: A pose tolerance, in nm, that no finite positions exceed.
_ANY_DISTANCE = 1e300
#: Singular values below this fraction of the largest are rounding of site positions.
_ROUNDING = 1e-10
#: Positions seem to be in another unit of length if they are apart by this factor more or less than
#: the sites, and have the shape of the body but for this part of its size.
_ANOTHER_SIZE, _LIKENESS = 5, 0.1
#: How far the length of a quaternion may be from 1, as in setBodyOrientations().
_LENGTH_ERROR = 1e-3


def placeBodies(context: openmm.Context, positions: Optional[Numbers] = None,
                orientations: Optional[npt.ArrayLike] = None,
                particlePositions: Optional[Numbers] = None,
                tolerance: Optional[Number] = None) -> unit.Quantity:
    """Set the poses of bodies, and put all their particles exactly in their places.

    You give poses by positions and orientations, or the function fits them to the coordinates of
    particles, as in a file, by mass-weighted least squares (massless bodies: unweighted). If you
    give only positions or only orientations, it fits the others. The function also works as the
    first placement in a Context. Coordinates may be farther from the shape of a body than the
    integrator's pose tolerance. The periodic box, the velocities of bodies and the pose tolerance
    do not change.

    ``placeBodies(context)`` alone fits poses to the present positions of the Context.

    Parameters
    ----------
    context : openmm.Context
        its integrator must be a CustomRigidHIIntegrator
    positions : array-like or Quantity of shape (n, 3), optional
        positions of the n bodies' origins, nm, lab frame
    orientations : array-like of shape (n, 4), optional
        unit quaternions (w, x, y, z), body frame to lab frame. At a first placement without
        particlePositions the default is unrotated bodies.
    particlePositions : array-like or Quantity of shape (N, 3), optional
        positions of all particles of the System, nm. Particles outside bodies get these positions;
        virtual sites are computed. The rows of bodies define shapes that are not yet known. They
        are ignored if you give both positions and orientations and the shape is known.
    tolerance : float or Quantity, optional
        the largest distance of a particle from its place after the fit, nm. None: half of the
        largest distance of a site from the centre of its body, after a fit of both position and
        orientation. Nothing changes if a particle is farther off.

    Returns
    -------
    Quantity
        the largest distance of a given position from the place of its particle, nm; 0, up to
        rounding, if you give positions and orientations

    Raises
    ------
    TypeError
        for arguments of another kind or dimension, or if the Context's integrator is of another
        class
    ValueError
        for wrong shapes, values that are not finite, quaternions whose length is not 1 within 1e-3,
        particles that are farther from their places than the tolerance, or a first placement that
        leaves a shape or a particle undetermined
    """
    where = 'placeBodies'
    integrator = CustomRigidHIIntegrator.cast(_units.context(context, where).getIntegrator())
    count = integrator.getNumRigidBodiesOfContext()
    if positions is not None:
        positions = _units.rows(positions, _units.LENGTH, 3, where, 'positions', count)
        _require_finite(positions, where, 'positions', 'body')
    if orientations is not None:
        orientations = _units.rows(orientations, _units.NONE, 4, where, 'orientations', count)
        _require_unit_length(orientations, where)
    if particlePositions is not None:
        particlePositions = _units.rows(particlePositions, _units.LENGTH, 3, where,
                                        'particlePositions',
                                        context.getSystem().getNumParticles())
    if tolerance is not None:
        tolerance = _units.number(tolerance, _units.LENGTH, where, 'tolerance')
        if not tolerance > 0:
            raise ValueError(f'{where}: tolerance: got {tolerance} nm; it must be positive: leave '
                             'it out for half of the size of each body')
    return _Placement(context, integrator, where).run(positions, orientations, particlePositions,
                                                      tolerance)


def _require_finite(rows, where, name, item):
    for k in np.flatnonzero(~np.isfinite(rows).all(axis=1))[:1]:
        raise ValueError(f'{where}: {name}: {item} {k} is at {rows[k].tolist()} nm; give it three '
                         'finite numbers')


def _require_unit_length(orientations, where):
    lengths = np.linalg.norm(orientations, axis=1)
    for k in np.flatnonzero(~(np.abs(lengths - 1) <= _LENGTH_ERROR))[:1]:
        raise ValueError(f'{where}: orientations: that of body {k} has the length {lengths[k]}; a '
                         'unit quaternion must have the length 1 within 1e-3: divide it by its '
                         'length')


class _Placement:
    """One call of placeBodies()."""
    def __init__(self, context, integrator, where):
        self.context = context
        self.integrator = integrator
        self.where = where
        self.system = context.getSystem()
        self.refusal = self._refusal()
        self.isFirst = self.refusal is not None and 'needs positions' in self.refusal
        inBodies = {
            i
            for body in range(integrator.getNumRigidBodiesOfContext())
            for i in integrator.getRigidBodyParticles(body)
        }
        self.others = [i for i in range(self.system.getNumParticles()) if i not in inBodies]

    def run(self, positions, orientations, x, tolerance):
        integrator = self.integrator
        if x is None and self.isFirst:
            x, orientations = self._first_positions(positions, orientations)
        elif x is None and self.refusal is not None:
            x = self._present_positions()
        distance = 0.0
        if x is not None:
            x = self._checked(self._with_given_poses(x, positions, orientations))
            positions, orientations, distance = self._fit(x, positions, orientations, tolerance)
        if positions is None and orientations is None:
            positions = integrator.getBodyPositions()._value  # all members go to their places
        if orientations is not None:
            integrator.setBodyOrientations(orientations)
        if positions is not None:
            integrator.setBodyPositions(positions)
        if any(map(self.system.isVirtualSite, self.others)):
            self.context.computeVirtualSites()
        return _units.LENGTH.attach(distance)

    def _refusal(self):
        """Why the integrator has no poses for the Context's positions, or None if it has them."""
        try:
            self.integrator.getBodyPositions()
        except openmm.OpenMMException as error:
            return str(error)
        return None

    def _present_positions(self):
        return self.context.getState(getPositions=True).getPositions(asNumpy=True)._value

    def _is_known(self, body):
        return self.integrator.getRigidBodyGeometryIsKnown(body)

    def _members_at(self, body, position, orientation):
        """Particles of a body with known shape, and their positions at a pose."""
        particles, _, _, sites = self.integrator.getRigidBodyParameters(body)
        q = orientation/np.linalg.norm(orientation)
        return particles, position + rotate(q, sites._value)

    def _first_positions(self, positions, orientations):
        """Positions of all particles where the Context has none, and orientations.

        The particles of bodies are put in their places later.
        """
        if positions is None:
            raise ValueError(f'{self.where}: the Context has no positions yet, and none are given; '
                             'give positions of the bodies, or particlePositions')
        free = [i for i in self.others if not self.system.isVirtualSite(i)]
        if free:
            raise ValueError(f'{self.where}: particle {free[0]} is in no body, and the Context has '
                             'no positions yet; give particlePositions, too')
        if orientations is None:
            orientations = np.tile((1.0, 0, 0, 0), (len(positions), 1))
        for body in range(len(positions)):
            if not self._is_known(body):
                raise ValueError(
                    f'{self.where}: the shape of body {body} is not known yet, since it comes from '
                    'the first positions; give particlePositions, too, or add the body with '
                    'explicit site positions')
        return np.zeros((self.system.getNumParticles(), 3)), orientations

    def _with_given_poses(self, x, positions, orientations):
        """The particles' positions, with those of bodies whose pose and shape are known."""
        if positions is None or orientations is None:
            return x
        for body, pose in enumerate(zip(positions, orientations)):
            if self._is_known(body):
                particles, places = self._members_at(body, *pose)
                x[particles] = places
        return x

    def _checked(self, x):
        isReal = np.array([not self.system.isVirtualSite(i) for i in range(len(x))], dtype=bool)
        _require_finite(np.where(isReal[:, None], x, 0), self.where, 'particlePositions',
                        'particle')
        # Virtual sites are computed, and files often do not have them.
        x[~isReal & ~np.isfinite(x).all(axis=1)] = 0
        return x

    def _fit(self, x, positions, orientations, tolerance):
        """Move the particles to positions, and fit poses to them.

        The result has positions and orientations of the bodies as far as they must still be set,
        and the largest distance of a particle from its place, nm.
        """
        integrator = self.integrator
        poseTolerance = integrator.getPoseTolerance()
        isKnown = all(map(self._is_known, range(integrator.getNumRigidBodiesOfContext())))
        if isKnown:  # what is refused here has changed nothing
            found = self._fitted(x, positions, orientations, tolerance, poseTolerance._value)
        state = None if self.isFirst else self.context.getState(getPositions=True,
                                                                getVelocities=True)
        twists = None if self.refusal else (integrator.getBodyVelocities(),
                                            integrator.getBodyAngularVelocities())
        try:
            self.context.setPositions(x)
            refusal = self._refusal()
            if refusal is not None:
                if 'nm from its place in the body' not in refusal:
                    raise openmm.OpenMMException(refusal)
                # The shapes are known now, and only the poses are missing.
                integrator.setPoseTolerance(_ANY_DISTANCE)
            if not isKnown:
                found = self._fitted(x, positions, orientations, tolerance, poseTolerance._value)
            # The members go to their places, where they fit any tolerance.
            integrator.setBodyPositions(integrator.getBodyPositions())
        except (ValueError, openmm.OpenMMException):
            integrator.setPoseTolerance(poseTolerance)
            if state is not None:
                self.context.setPositions(state.getPositions(asNumpy=True))
                self.context.setVelocities(state.getVelocities(asNumpy=True))
            raise
        integrator.setPoseTolerance(poseTolerance)
        if twists is not None:
            integrator.setBodyVelocities(twists[0])
            integrator.setBodyAngularVelocities(twists[1])
        return found

    def _fitted(self, x, positions, orientations, tolerance, poseTolerance):
        """As _fit(), without any change, for shapes that are known."""
        bodies = BodyDefinitions(self.integrator)
        isGiven = positions is not None, orientations is not None
        if len(bodies) == 0 or all(isGiven):
            return positions, orientations, 0.0
        fit = _PoseFit(self.system, bodies)
        present = np.tile((1.0, 0, 0, 0), (len(bodies), 1))
        if self._refusal() is None:
            present = self.integrator.getBodyOrientations()
        R, q = fit.poses(x, present, positions, orientations)
        distances = fit.distances(x, R, q)
        largest = float(distances.max())
        if tolerance is None:
            # Poses that are given may be far from the particles, whose shape must be right.
            if any(isGiven):
                distances = fit.distances(x, *fit.poses(x, present))
            limits = np.maximum(_FARTHEST*fit.sizes(), poseTolerance)[bodies.owners]
        else:
            limits = np.full(len(distances), tolerance)
        for k in np.argsort(limits - distances)[:1]:
            if not distances[k] <= limits[k]:
                raise ValueError(
                    f'{self.where}: body {bodies.owners[k]}: particle {bodies.members[k]} is '
                    f'{distances[k]:.3g} nm from its place after the fit, more than '
                    f'{limits[k]:.3g} nm; {fit.likely_fault(x, bodies.owners[k])}')
        # Without given poses, the integrator has made the same fit with more digits.
        return (R, q, largest) if any(isGiven) else (None, None, largest)


class _PoseFit:
    """Least squares for poses of bodies, with the weights that the integrator takes."""
    def __init__(self, system, bodies):
        self.bodies = bodies
        self.isReal = np.array([not system.isVirtualSite(int(i)) for i in bodies.members])
        masses = np.array([system.getParticleMass(int(i))._value for i in bodies.members])
        self.weights = np.empty(len(masses))
        self.lines = {}
        for begin, end in zip(bodies.first, bodies.first[1:]):
            sites, real = bodies.places[begin:end], self.isReal[begin:end].astype(float)
            own = masses[begin:end]
            if not own.any() or self._line(sites, own)[0] < self._line(sites, real)[0]:
                own = real  # the masses leave open a rotation that all members together fix
            self.weights[begin:end] = own
        self.centres = self._mean(bodies.places)

    def poses(self, x, present, positions=None, orientations=None):
        """Positions and orientations of the bodies; given ones stay.

        Rotations that the particles leave open are the smallest ones from the present orientations.
        """
        bodies, given = self.bodies, positions
        x = x[bodies.members]
        centres = self._mean(x)
        if orientations is None:
            # About a given position, the sites count from the origin of the body.
            pivots, origins = (centres, self.centres) if given is None else (given, 0*self.centres)
            orientations = self._orientations(x - pivots[bodies.owners],
                                              bodies.places - origins[bodies.owners], present,
                                              given is None)
        else:
            orientations = orientations/np.linalg.norm(orientations, axis=1)[:, None]
        if given is None:
            positions = centres - rotate(orientations, self.centres)
        return positions, orientations

    def distances(self, x, R, q):
        """Distance of each member from its place, nm; 0 for virtual sites."""
        bodies = self.bodies
        places = R[bodies.owners] + rotate(q[bodies.owners], bodies.places)
        return np.where(self.isReal, np.linalg.norm(x[bodies.members] - places, axis=1), 0)

    def sizes(self):
        """The largest distance of a site from the centre of each body, nm."""
        bodies = self.bodies
        starts = bodies.first[:-1]
        centres = np.add.reduceat(bodies.places, starts)/np.diff(bodies.first)[:, None]
        return np.maximum.reduceat(np.linalg.norm(bodies.places - centres[bodies.owners], axis=1),
                                   starts)

    def likely_fault(self, x, body):
        """What may be wrong with particles that do not have the shape of their body."""
        members = slice(*self.bodies.first[body:body + 2])
        real = self.isReal[members]
        points = x[self.bodies.members[members]][real], self.bodies.places[members][real]
        apart, own = (np.linalg.norm(p - p.mean(axis=0), axis=1) for p in points)
        ratio = apart.max()/own.max() if own.max() > 0 and apart.max() > 0 else 1.0
        # Two particles have this shape at any distance, also where a box has torn them apart.
        isLike = np.all(np.abs(apart/ratio - own) <= _LIKENESS*own.max()) and (
            len(own) > 2 or abs(np.log10(ratio) - np.round(np.log10(ratio))) <= 0.02)
        if isLike and not 1/_ANOTHER_SIZE < ratio < _ANOTHER_SIZE:
            times = float(f'{ratio:.2g}')
            return (f'positions seem to be in another unit of length (they are about {times:g} '
                    'times as far apart as the sites): give positions and sites in nm, or as '
                    'Quantities with units')
        return ('its particles do not have the shape of the body: look for another order of atoms, '
                'a mirror image, or a body that was wrapped across the periodic box (makeWhole()), '
                'or give a larger tolerance')

    def _mean(self, values):
        """Weighted means over the members of each body."""
        starts = self.bodies.first[:-1]
        return (np.add.reduceat(self.weights[:, None]*values, starts)/
                np.add.reduceat(self.weights, starts)[:, None])

    def _orientations(self, targets, sites, present, isCentred):
        from scipy.spatial.transform import Rotation
        bodies = self.bodies
        arms = rotate(present[bodies.owners], sites)
        correlation = np.add.reduceat(
            self.weights[:, None, None]*targets[:, :, None]*arms[:, None, :], bodies.first[:-1])
        left, _, right = np.linalg.svd(correlation)
        left[:, :, 2] *= np.linalg.det(left @ right)[:, None]  # no mirror images
        turns = Rotation.from_matrix(left @ right).as_quat()[:, [3, 0, 1, 2]]
        for body, (begin, end) in enumerate(zip(bodies.first, bodies.first[1:])):
            rank, line = self._line(bodies.places[begin:end], self.weights[begin:end], isCentred)
            if rank == 0:
                turns[body] = (1, 0, 0, 0)
            elif rank == 1:
                start = rotate(present[body], line)
                turns[body] = _smallest_turn(start, correlation[body] @ start)
        q = product(turns, present)
        q /= np.linalg.norm(q, axis=1)[:, None]
        return q*np.where(np.sum(q*present, axis=1) < 0, -1, 1)[:, None]

    def _line(self, sites, weights, isCentred=True):
        """0 for sites in one point, 1 for those on a line, 2 for others; and the longest axis.

        The point and the line go through the origin of the body if sites are not centred.
        """
        key = sites.tobytes(), weights.tobytes(), isCentred
        if key not in self.lines:
            largest = np.abs(sites).max()
            if isCentred:
                sites = sites - weights @ sites/weights.sum()
            _, values, axes = np.linalg.svd(np.sqrt(weights/weights.sum())[:, None]*sites)
            rank = (0 if not values[0] > _ROUNDING*largest else
                    1 if len(values) < 2 or values[1] <= _ROUNDING*values[0] else 2)
            self.lines[key] = rank, axes[0]
        return self.lines[key]


def _smallest_turn(start, end):
    """The quaternion of the smallest rotation from one direction to another one."""
    length = np.linalg.norm(end)
    if not length > 0:
        return 1, 0, 0, 0
    start, end = start/np.linalg.norm(start), end/length
    twice = np.linalg.norm(start + end)  # the cosine of half the angle, twice
    if twice < 1e-6:
        # The axis is lost in rounding: half a turn about any perpendicular one.
        axis = np.cross(start, np.eye(3)[np.argmin(np.abs(start))])
        return 0, *(axis/np.linalg.norm(axis))
    return twice/2, *(np.cross(start, end)/twice)


def makeWhole(integrator: CustomRigidHIIntegrator, positions: Numbers, boxVectors: Numbers,
              system: Optional[openmm.System] = None) -> unit.Quantity:
    """Make bodies whole whose particles were wrapped one by one into the periodic box.

    Programs that write files often move each particle into the box, which tears bodies at its faces
    apart. This function moves the particles of each body to the periodic images nearest to its
    first particle. All other particles stay where they are.

    Parameters
    ----------
    integrator : CustomRigidHIIntegrator
        the bodies; the integrator needs no Context
    positions : array-like or Quantity of shape (n, 3)
        positions of all particles of the System, nm
    boxVectors : array-like or Quantity of shape (3, 3)
        the periodic box vectors, nm, in rows
    system : openmm.System, optional
        if given, positions of virtual sites need not be finite; non-finite ones stay unchanged, and
        :func:`placeBodies` computes them

    Returns
    -------
    Quantity of shape (n, 3)
        the positions of all particles, nm

    Raises
    ------
    ValueError
        for wrong shapes, positions that are not finite, box vectors that span no volume, and bodies
        that are longer than half the box along one of its vectors, since the nearest images are
        then unknown

    Notes
    -----
    A body that is longer than half the box may look short after its particles have moved. The
    function notices this where the integrator knows the shape: from explicit sites, or in a
    Context. Otherwise the body stays torn apart. Give whole positions of such bodies.
    """
    where = 'makeWhole'
    integrator = CustomRigidHIIntegrator.cast(integrator)
    result = _units.rows(positions, _units.LENGTH, 3, where, 'positions')
    box = _units.rows(boxVectors, _units.LENGTH, 3, where, 'boxVectors', 3)
    if not np.all(np.isfinite(box)) or not abs(np.linalg.det(box)) > 0:
        raise ValueError(f'{where}: boxVectors: got {box.tolist()} nm; three finite vectors must '
                         'span a volume: give the box of the file')
    if system is not None and not isinstance(system, openmm.System):
        raise TypeError(f'{where}: system: got {type(system).__name__}; it must be an '
                        'openmm.System: give the System of the bodies, or leave it out')
    toFractions = np.linalg.inv(box)
    halfWidth = 0.5/np.linalg.norm(toFractions, axis=0).max()
    for body in range(integrator.getNumRigidBodies()):
        particles = integrator.getRigidBodyParticles(body)
        if max(particles) >= len(result):
            raise ValueError(
                f'{where}: positions: got {len(result)} rows; body {body} has particle '
                f'{max(particles)}: give a row for each particle of the System')
        isFinite = np.isfinite(result[particles]).all(axis=1)
        for bad, isGood in zip(particles, isFinite):
            if not isGood and (system is None or not system.isVirtualSite(bad)):
                raise ValueError(f'{where}: positions: particle {bad} of body {body} is at '
                                 f'{result[bad].tolist()}; all numbers must be finite: correct the '
                                 'file, or give the system if the particle is a virtual site')
        whole = np.array(particles)[isFinite]
        members = result[whole]
        if len(members) == 0:
            continue
        fractions = (members - members[0]) @ toFractions
        shifts = np.round(fractions)
        lengths = np.ptp(fractions - shifts, axis=0)
        if np.any(lengths >= 0.5):
            k = np.argmax(lengths)
            raise ValueError(
                f'{where}: body {body} is {lengths[k]:.3g} of the box long along box vector '
                f'{"abc"[k]}; it must be shorter than half the box, for else the nearest images of '
                'its particles are not known: give whole positions of this body')
        members -= shifts @ box
        if integrator.getRigidBodyGeometryIsKnown(body):
            sites = integrator.getRigidBodyParameters(body)[3]._value[isFinite]
            length = np.linalg.norm(sites - sites[0], axis=1).max()
            if length >= halfWidth and not _have_shape(members, sites):
                raise ValueError(
                    f'{where}: body {body} is {length:.3g} nm long by its sites, and half the '
                    f'width of the box is {halfWidth:.3g} nm; the nearest images of its particles '
                    'do not have its shape: give whole positions of this body')
        result[whole] = members
    return _units.LENGTH.attach(result)


def _have_shape(points, sites):
    """Whether distances of points from a few of them are those of the sites, to a tenth."""
    first = np.linalg.norm(sites - sites[0], axis=1)
    anchors = [0, np.argmax(first)]
    second = np.linalg.norm(sites - sites[anchors[1]], axis=1)
    anchors.append(np.argmax(first + second))
    for anchor in anchors:
        apart, own = (np.linalg.norm(p - p[anchor], axis=1) for p in (points, sites))
        if np.any(np.abs(apart - own) > 0.1*first.max()):
            return False
    return True
