"""Put bodies in their places, and make bodies whole that a periodic box has torn apart."""
from __future__ import annotations

from typing import TYPE_CHECKING, Optional

import numpy as np
import openmm

from .. import _units
from .._types import Number, Numbers
from .._quaternions import rotate
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
#: How far the length of a quaternion may be from 1, as in setBodyOrientations().
_LENGTH_ERROR = 1e-3


def placeBodies(context: openmm.Context, positions: Optional[Numbers] = None,
                orientations: Optional[npt.ArrayLike] = None,
                particlePositions: Optional[Numbers] = None,
                tolerance: Optional[Number] = None) -> unit.Quantity:
    """Set the poses of bodies, and put all their particles exactly in their places.

    Poses are given by positions and orientations, or fitted to the coordinates of particles, as a
    file has them, by mass-weighted least squares (massless bodies: unweighted). Poses that are
    given take the place of fitted ones. The function also works as the first placement in a
    Context. Coordinates may be farther from the shape of a body than the integrator's pose
    tolerance. The periodic box, the velocities of bodies and the pose tolerance do not change.

    ``placeBodies(context)`` alone fits poses to the present positions of the Context.

    Parameters
    ----------
    context : openmm.Context
        its integrator must be a CustomRigidHIIntegrator
    positions : array-like or Quantity of shape (n, 3), optional
        positions of the n bodies' origins, nm, lab frame
    orientations : array-like of shape (n, 4), optional
        unit quaternions (w, x, y, z), body frame to lab frame. At a first placement without
        particlePositions the default is bodies that are not turned.
    particlePositions : array-like or Quantity of shape (N, 3), optional
        positions of all particles of the System, nm. Particles outside bodies are set to these
        positions; virtual sites are computed. The rows of bodies define shapes that are not known
        yet. They are ignored where both positions and orientations are given and the shape is
        known.
    tolerance : float or Quantity, optional
        the largest distance of a particle from its place after the fit, nm. None: half of the
        largest distance of a site from the centre of its body. Nothing changes if a particle is
        farther off.

    Returns
    -------
    Quantity
        the largest distance of a given position from the particle's place, nm; 0, but for
        rounding, if no pose was fitted

    Raises
    ------
    TypeError
        for arguments of another kind or dimension, or if the Context's integrator is of another
        class
    ValueError
        for wrong shapes, values that are not finite, quaternions whose length is not 1 within 1e-3,
        particles that are farther from their places than the tolerance, or a first placement that
        leaves a shape or a particle open
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
        if x is not None:
            x = self._with_given_poses(x, positions, orientations)
        distance = 0.0
        if x is not None:
            isReal = np.array([not self.system.isVirtualSite(i) for i in range(len(x))], dtype=bool)
            _require_finite(np.where(isReal[:, None], x, 0), self.where, 'particlePositions',
                            'particle')
            # Virtual sites are computed, and files often do not have them.
            x[~isReal & ~np.isfinite(x).all(axis=1)] = 0
            distance = self._fit(x, tolerance)
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

    def _fit(self, x, tolerance):
        """Fit poses to positions; the largest distance of a particle from its place, nm."""
        integrator = self.integrator
        before = None if self.isFirst else self._present_positions()
        twists = None if self.refusal else (integrator.getBodyVelocities(),
                                            integrator.getBodyAngularVelocities())
        poseTolerance = integrator.getPoseTolerance()
        try:
            self.context.setPositions(x)
            refusal = self._refusal()
            if refusal is not None:
                if 'nm from its place in the body' not in refusal:
                    raise openmm.OpenMMException(refusal)
                # The shapes are known now, and only the poses are missing.
                integrator.setPoseTolerance(_ANY_DISTANCE)
            distance = self._checked_distance(x, tolerance, poseTolerance._value)
            # The members go to their places, where they fit any tolerance.
            integrator.setBodyPositions(integrator.getBodyPositions())
        except (ValueError, openmm.OpenMMException):
            integrator.setPoseTolerance(poseTolerance)
            if before is not None:
                self.context.setPositions(before)
            raise
        integrator.setPoseTolerance(poseTolerance)
        if twists is not None:
            integrator.setBodyVelocities(twists[0])
            integrator.setBodyAngularVelocities(twists[1])
        return distance

    def _checked_distance(self, x, tolerance, poseTolerance):
        bodies = BodyDefinitions(self.integrator)
        if len(bodies) == 0:
            return 0.0
        R, q = self.integrator.getBodyPositions()._value, self.integrator.getBodyOrientations()
        places = R[bodies.owners] + rotate(q[bodies.owners], bodies.places)
        isReal = np.array([not self.system.isVirtualSite(int(i)) for i in bodies.members])
        distances = np.where(isReal, np.linalg.norm(x[bodies.members] - places, axis=1), 0)
        if tolerance is None:
            centres = np.add.reduceat(bodies.places, bodies.first[:-1])/np.diff(bodies.first)[:,
                                                                                              None]
            arms = np.linalg.norm(bodies.places - centres[bodies.owners], axis=1)
            limits = np.maximum(_FARTHEST*np.maximum.reduceat(arms, bodies.first[:-1]),
                                poseTolerance)[bodies.owners]
        else:
            limits = np.full(len(distances), tolerance)
        for k in np.argsort(limits - distances)[:1]:
            if not distances[k] <= limits[k]:
                raise ValueError(
                    f'{self.where}: body {bodies.owners[k]}: particle {bodies.members[k]} is '
                    f'{distances[k]:.3g} nm from its place after the fit, more than '
                    f'{limits[k]:.3g} nm; its particles do not have the shape of the body: look '
                    'for another order of atoms, a mirror image, or a body that was wrapped across '
                    'the periodic box (makeWhole()), or give a larger tolerance')
        return float(distances.max())


def makeWhole(integrator: CustomRigidHIIntegrator, positions: Numbers,
              boxVectors: Numbers) -> unit.Quantity:
    """Make bodies whole whose particles were wrapped one by one into the periodic box.

    Programs that write files often move each particle into the box, so that bodies at its faces are
    torn apart. This function moves the particles of each body to the periodic images that are
    nearest to its first particle. All other particles stay where they are.

    Parameters
    ----------
    integrator : CustomRigidHIIntegrator
        has the bodies; it needs no Context
    positions : array-like or Quantity of shape (n, 3)
        positions of all particles of the System, nm
    boxVectors : array-like or Quantity of shape (3, 3)
        the periodic box vectors, nm, in rows

    Returns
    -------
    Quantity of shape (n, 3)
        the positions of all particles, nm

    Raises
    ------
    ValueError
        for wrong shapes, positions that are not finite, box vectors that span no volume, and bodies
        that are longer than half the box along one of its vectors: which images are nearest is
        then not known

    Notes
    -----
    A body that is longer than half the box, but short after its particles have moved, is torn
    apart without being noticed here; its shape no longer fits, which the next step says if the
    shape is known. Give whole positions of such bodies.
    """
    where = 'makeWhole'
    integrator = CustomRigidHIIntegrator.cast(integrator)
    result = _units.rows(positions, _units.LENGTH, 3, where, 'positions')
    box = _units.rows(boxVectors, _units.LENGTH, 3, where, 'boxVectors', 3)
    if not np.all(np.isfinite(box)) or not abs(np.linalg.det(box)) > 0:
        raise ValueError(f'{where}: boxVectors: got {box.tolist()} nm; three finite vectors must '
                         'span a volume: give the box of the file')
    toFractions = np.linalg.inv(box)
    for body in range(integrator.getNumRigidBodies()):
        particles = integrator.getRigidBodyParticles(body)
        if max(particles) >= len(result):
            raise ValueError(
                f'{where}: positions: got {len(result)} rows; body {body} has particle '
                f'{max(particles)}: give a row for each particle of the System')
        members = result[particles]
        if not np.all(np.isfinite(members)):
            bad = particles[np.argwhere(~np.isfinite(members))[0, 0]]
            raise ValueError(f'{where}: positions: particle {bad} of body {body} is at '
                             f'{result[bad].tolist()}; all numbers must be finite: correct the '
                             'file')
        fractions = (members - members[0]) @ toFractions
        shifts = np.round(fractions)
        lengths = np.ptp(fractions - shifts, axis=0)
        if np.any(lengths >= 0.5):
            k = np.argmax(lengths)
            raise ValueError(
                f'{where}: body {body} is {lengths[k]:.3g} of the box long along box vector '
                f'{"abc"[k]}; it must be shorter than half the box, for else the nearest images of '
                'its particles are not known: give whole positions of this body')
        result[particles] = members - shifts @ box
    return _units.LENGTH.attach(result)
