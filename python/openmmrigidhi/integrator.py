"""CustomRigidHIIntegrator: the Python side of the C++ class, with units and checked shapes."""
from __future__ import annotations

import operator
import time
from typing import TYPE_CHECKING, Any, Iterable, Optional, Sequence, Union

import numpy as np
import openmm

from . import _bindings, _copies, _enums, _schemes, _units
from ._types import Array, Number, Numbers
from ._schemes import Scheme

if TYPE_CHECKING:
    from openmm import unit
    import numpy.typing as npt

_Base = _bindings.CustomRigidHIIntegrator


class NoiseLaw(_enums.Documented):
    """The laws of the random numbers, all of mean 0 and variance 1.

    They are also class attributes of CustomRigidHIIntegrator.
    """

    Gaussian = _Base.Gaussian, 'Normal numbers (default).'
    ThreePoint = _Base.ThreePoint, (
        r'0 with probability 2/3, :math:`\pm\sqrt 3` with probability 1/6 each: enough for weak '
        'order 2 (Davidchack 2015, eq. 21).')
    TwoPoint = _Base.TwoPoint, (
        '+-1 with probability 1/2 each: enough for weak order 1, so for GradientThermostat and the '
        'schemes without momenta in a fluid (Davidchack 2015, eq. 31).')


class WallRejection(_enums.Documented):
    """The steps through a wall that the scheme redoes with new noise.

    They are also class attributes of CustomRigidHIIntegrator.
    """

    Overlap = _Base.Overlap, (
        'Steps after which a hydrodynamic particle is nearer to the wall than its radius '
        '(default).')
    Crossing = _Base.Crossing, (
        'Steps after which the centre of a hydrodynamic particle is on the wall or behind it; '
        'particles that reach through a NoSlipWall have damped mobilities.')


class DriftCorrectorScaling(_enums.Documented):
    """What the drift factor of DriftCorrectorFD and DriftCorrectorRFD multiplies.

    The constants are also class attributes of CustomRigidHIIntegrator.
    """

    SlipOnly = _Base.SlipOnly, (
        'The slips (random surface velocities) alone (default): the same weak order, without noise '
        'on what forces do.')
    Whole = _Base.Whole, 'The whole step, as in Westwood 2022, eq. 44.'


# The class has attributes of the same names, which its annotations would mean.
_Scheme = Scheme
_NoiseLaw = NoiseLaw
_WallRejection = WallRejection
_DriftCorrectorScaling = DriftCorrectorScaling


def _where(method):
    return 'CustomRigidHIIntegrator.' + method


class CustomRigidHIIntegrator(_copies.Copies, _Base):
    """Integrates rigid bodies, whose orientations are unit quaternions, under a Context's forces.

    :meth:`addRigidBody` groups particles of the System into bodies. The integrator moves all other
    particles ("free particles") as point particles, with the same scheme. The state of a body has
    four parts:

    - the position R of its origin (its centre of mass), nm;
    - the unit quaternion q = (w, x, y, z) that rotates body-frame vectors into lab-frame vectors;
    - the momentum p, lab frame;
    - the angular momentum l, body frame.

    Arguments are numbers in OpenMM's units (nm, ps, dalton, K, kJ/mol), or quantities, whose
    dimension is checked. Rows are Vec3, tuples, lists or rows of an array. Getters of dimensional
    arrays return a Quantity of a numpy array. You may give a constant by its name, as in
    ``setScheme('TrapezoidalSlip')``. A wrong type or dimension raises TypeError, and a wrong shape
    or an unknown name ValueError. Any other error raises openmm.OpenMMException. Each message names
    the object, the value, the bound and the remedy.

    :meth:`setScheme` chooses how bodies move. ``help(CustomRigidHIIntegrator.Scheme)`` describes
    each scheme. docs/schemes/README.md says which scheme to take for which scene. Each scheme has a
    page there with its equations, cost and limits:

    @schemes@

    Parameters
    ----------
    temperature : float or Quantity
        temperature of the heat bath, K; 0: no noise at all
    stepSize : float or Quantity
        step size, ps

    Raises
    ------
    openmm.OpenMMException
        if the temperature is negative, the step size not positive, or either not finite

    Examples
    --------
    >>> import openmmrigidhi
    >>> from openmm import unit
    >>> integrator = openmmrigidhi.CustomRigidHIIntegrator(300*unit.kelvin, 4*unit.femtosecond)
    >>> integrator.addRigidBody([0, 1, 2])
    0
    """

    Scheme = Scheme
    NoiseLaw = NoiseLaw
    WallRejection = WallRejection
    DriftCorrectorScaling = DriftCorrectorScaling
    Gaussian = NoiseLaw.Gaussian
    ThreePoint = NoiseLaw.ThreePoint
    TwoPoint = NoiseLaw.TwoPoint
    Overlap = WallRejection.Overlap
    Crossing = WallRejection.Crossing
    SlipOnly = DriftCorrectorScaling.SlipOnly
    Whole = DriftCorrectorScaling.Whole

    def __init__(self, temperature: Number, stepSize: Number, *others: Any, **named: Any) -> None:
        if others or named:
            # Langevin integrators of OpenMM take (temperature, friction, stepSize).
            extra = ', '.join([f'{value!r}' for value in (temperature, stepSize, *others)] +
                              [f'{name}={value!r}' for name, value in named.items()])
            raise TypeError(
                f'CustomRigidHIIntegrator: got the arguments {extra}; it takes a temperature and a '
                'step size only: create it with these two, and set the friction of Langevin '
                'schemes by setFriction() and setRotationalFriction()')
        super().__init__(
            _units.number(temperature, _units.TEMPERATURE, 'CustomRigidHIIntegrator',
                          'temperature'),
            _units.number(stepSize, _units.TIME, 'CustomRigidHIIntegrator', 'stepSize'))

    def __repr__(self):
        return (f'<CustomRigidHIIntegrator: {self.getScheme().name}, {self.getTemperature()}, '
                f'{self.getStepSize()}, {self.getNumRigidBodies()} bodies>')

    # ---- Copies ----------------------------------------------------------------------------------

    @staticmethod
    def cast(obj: openmm.Integrator) -> CustomRigidHIIntegrator:
        """Get a CustomRigidHIIntegrator from a generic openmm.Integrator.

        OpenMM's deserialisation and copies return the generic class.

        Parameters
        ----------
        obj : openmm.Integrator
            the object; if it owned the C++ object, the result owns the C++ object from now on, and
            obj remains usable

        Returns
        -------
        CustomRigidHIIntegrator
            obj itself if it is one already

        Raises
        ------
        TypeError
            if obj is anything else
        """
        return CustomRigidHIIntegrator._cast_generic(obj)

    _base = _Base
    _generic = openmm.Integrator

    # ---- Bodies ----------------------------------------------------------------------------------

    def addRigidBody(self, particles: Sequence[int], mass: Optional[Number] = None,
                     principalMoments: Optional[Numbers] = None,
                     sitePositions: Optional[Numbers] = None) -> int:
        """Add a rigid body.

        With particles alone, shape, mass and inertia come from the System. The masses of the
        particles give mass and inertia. If the constraints among the massive members fix the shape,
        the shape comes from these constraints. Two members need one constraint, three a triangle,
        and more need all pairs; the first positions determine the handedness. Virtual sites come
        from their definitions. Otherwise the first positions of the Context give the shape, and the
        body keeps it until :meth:`resetBodyGeometry`. The body frame has its origin at the centre
        of mass and its axes along the principal axes, the smallest moment first.

        The System has precedence over a saved state: changed constraints and masses take effect at
        reinitialize(), and the positions and velocities of the state continue.

        If you give mass, principalMoments and sitePositions, they override the System's masses.
        Then only OpenMM uses the System's masses.

        Parameters
        ----------
        particles : sequence of int
            indices of the particles, virtual sites included
        mass : float or Quantity, optional
            mass, dalton; positive for schemes with momenta and for GradientThermostat. OpenMM's own
            minimiser leaves particles of mass 0 where they are; :func:`openmmrigidhi.app.minimize`
            moves bodies without mass, too.
        principalMoments : Vec3, sequence or Quantity of shape (3,), optional
            principal moments of inertia about the body axes x, y, z, dalton nm^2, in any order. A
            moment below 1e-13 of the largest counts as zero: the body then has no rotation, noise
            or energy about this axis.
        sitePositions : array-like or Quantity of shape (n, 3), optional
            position of each particle in the body frame, nm. The origin of the frame is the centre
            of mass and its axes are the principal axes. Schemes without momenta in a fluid take any
            origin (the tracking point), any axes, and 0 for mass and moments.

        Returns
        -------
        int
            index of the body

        Raises
        ------
        TypeError
            for a wrong type or dimension, or if only some of the last three are given
        ValueError
            for a wrong shape
        openmm.OpenMMException
            for an empty body, a negative or repeated particle, a particle that is already in a
            body, a negative or non-finite mass or moment, moments that violate the triangle
            inequality, or numbers of sites and particles that differ
        """
        where = _where('addRigidBody')
        indices = _units.indices(particles, where, 'particles')
        given = [argument is not None for argument in (mass, principalMoments, sitePositions)]
        if not any(given):
            return super().addRigidBody(indices)
        if not all(given):
            raise TypeError(
                f'{where}: only some of mass, principalMoments and sitePositions are given; an '
                f'explicit body '
                'needs all three: give them all, or none to take them from the System')
        return super().addRigidBody(
            indices, *self._explicit_body(where, mass, principalMoments, sitePositions))

    @staticmethod
    def _explicit_body(where, mass, principalMoments, sitePositions):
        return (_units.number(mass, _units.MASS, where, 'mass'),
                _units.vector(principalMoments, _units.MOMENT, where, 'principalMoments'),
                _units.rows(sitePositions, _units.LENGTH, 3, where, 'sitePositions'))

    def getNumRigidBodies(self) -> int:
        """Get the number of rigid bodies."""
        return super().getNumRigidBodies()

    def getNumRigidBodiesOfContext(self) -> int:
        """Get the number of rigid bodies of the bound Context.

        It is the number of bodies at the creation of the Context. Bodies added later wait for the
        next Context or `reinitialize()`. The call needs a Context.
        """
        return super().getNumRigidBodiesOfContext()

    def getRigidBodyParameters(
            self, index: int) -> tuple[list[int], unit.Quantity, unit.Quantity, unit.Quantity]:
        """Get the definition of a body.

        For a body without explicit geometry the call needs a Context with positions (or a geometry
        read from XML).

        Parameters
        ----------
        index : int
            index of the body

        Returns
        -------
        particles : list of int
            indices of the particles
        mass : Quantity
            mass, dalton
        principalMoments : Quantity of shape (3,)
            principal moments about the body axes, dalton nm^2
        sitePositions : Quantity of shape (n, 3)
            positions of the particles in the body frame, nm

        Raises
        ------
        openmm.OpenMMException
            if the index is out of range or the geometry is not yet known
        """
        particles, mass, moments, sites = super().getRigidBodyParameters(
            self._index(index, 'getRigidBodyParameters'))
        return (np.frombuffer(particles, dtype=np.intc).tolist(), _units.MASS.attach(mass),
                _units.MOMENT.attach(_units.array(moments)),
                _units.LENGTH.attach(_units.array(sites, 3)))

    def getRigidBodyParticles(self, index: int) -> list[int]:
        """Get the indices of a body's particles, a list of int; the call needs no Context.

        Parameters
        ----------
        index : int
            index of the body
        """
        buffer = super().getRigidBodyParticles(self._index(index, 'getRigidBodyParticles'))
        return np.frombuffer(buffer, dtype=np.intc).tolist()

    def getRigidBodyIsExplicit(self, index: int) -> bool:
        """Get whether a body has explicit mass, moments and sites."""
        return super().getRigidBodyIsExplicit(self._index(index, 'getRigidBodyIsExplicit'))

    def getRigidBodyGeometryIsKnown(self, index: int) -> bool:
        """Get whether mass, moments and sites of a body are known."""
        return super().getRigidBodyGeometryIsKnown(self._index(index,
                                                               'getRigidBodyGeometryIsKnown'))

    def setRigidBodyParameters(self, index: int, particles: Iterable[int], mass: Number,
                               principalMoments: Numbers, sitePositions: Numbers) -> None:
        """Replace the definition of a body by an explicit one.

        The definition takes effect at the next Context creation or reinitialize(). Loading a state
        that was saved with another mass, other moments or other sites is an error, also in
        ``reinitialize(preserveState=True)``. Parameters and errors as in :meth:`addRigidBody`.
        """
        where = _where('setRigidBodyParameters')
        super().setRigidBodyParameters(
            self._index(index, 'setRigidBodyParameters'),
            _units.indices(particles, where, 'particles'),
            *self._explicit_body(where, mass, principalMoments, sitePositions))

    def resetBodyGeometry(self) -> None:
        """Forget the geometry of all bodies without an explicit geometry.

        The present positions of the Context, or the next ones, define the geometry anew.
        """
        super().resetBodyGeometry()

    @staticmethod
    def _index(index, method):
        return _units.integer(index, _where(method), 'index')

    # ---- Settings --------------------------------------------------------------------------------

    def getScheme(self) -> _Scheme:
        """Get the scheme, one of the class attributes that :meth:`setScheme` takes."""
        return Scheme(super().getScheme())

    def setScheme(self, scheme: Union[_Scheme, str, int]) -> None:
        """Set the scheme (default LangevinC); you may change it between steps.

        Parameters
        ----------
        scheme : constant or str
            one of the class attributes of that name, such as ``integrator.LangevinC``, or its name,
            ``'LangevinC'``; :class:`Scheme` describes them

        Raises
        ------
        TypeError
            for a constant of another kind
        ValueError
            for an unknown name; the message lists the names
        """
        super().setScheme(_units.constant(scheme, Scheme, _where('setScheme'), 'scheme'))

    def getNoiseLaw(self) -> _NoiseLaw:
        """Get the law of the random numbers (Gaussian, ThreePoint or TwoPoint)."""
        return NoiseLaw(super().getNoiseLaw())

    def setNoiseLaw(self, law: Union[_NoiseLaw, str, int]) -> None:
        r"""Set the law of the random numbers; all have mean 0 and variance 1.

        Parameters
        ----------
        law : constant or str
            Gaussian (default). ThreePoint: 0 with probability 2/3, :math:`\pm\sqrt 3` with
            probability 1/6 each (Davidchack 2015, eq. 21); enough for weak order 2. TwoPoint:
            :math:`\pm 1` with probability 1/2 each (Davidchack 2015, eq. 31); enough for weak order
            1, so for GradientThermostat and the schemes without momenta in a fluid.
        """
        super().setNoiseLaw(_units.constant(law, NoiseLaw, _where('setNoiseLaw'), 'law'))

    def getTemperature(self) -> unit.Quantity:
        """Get the temperature of the heat bath, a Quantity in K."""
        return _units.TEMPERATURE.attach(super().getTemperature())

    def setTemperature(self, temperature: Number) -> None:
        """Set the temperature of the heat bath, K; not negative, finite.

        At 0 the scheme has no noise and draws no random numbers.
        """
        super().setTemperature(
            self._number(temperature, _units.TEMPERATURE, 'setTemperature', 'temperature'))

    def getFriction(self) -> unit.Quantity:
        """Get the translational friction gamma of the Langevin schemes, a Quantity in 1/ps."""
        return _units.RATE.attach(super().getFriction())

    def setFriction(self, gamma: Number) -> None:
        """Set gamma, the rate at which momenta relax (eq. 8), 1/ps; default 1.

        It applies to the momenta of bodies and of free particles.
        """
        super().setFriction(self._number(gamma, _units.RATE, 'setFriction', 'gamma'))

    def getRotationalFriction(self) -> unit.Quantity:
        """Get the rotational friction Gamma of the Langevin schemes, a Quantity in 1/ps."""
        return _units.RATE.attach(super().getRotationalFriction())

    def setRotationalFriction(self, Gamma: Number) -> None:
        r"""Set Gamma (eqs. 9, 10), 1/ps; default 1.

        Body axis k relaxes at the rate :math:`\Gamma/(I_k \sum_j 1/I_j)`. Where a moment is below a
        tenth of the middle one, the rates approach the rates of a linear body
        (docs/schemes/LangevinC.md).
        """
        super().setRotationalFriction(
            self._number(Gamma, _units.RATE, 'setRotationalFriction', 'Gamma'))

    def getInertiaScale(self) -> float:
        """Get the factor of the principal moments in the dynamics."""
        return super().getInertiaScale()

    def setInertiaScale(self, factor: float) -> None:
        """Set the factor of the principal moments in the dynamics; default 1.

        Schemes with momenta multiply the principal moments of all bodies by the factor.

        Averages over configurations do not depend on the factor, since momenta are Gaussian and
        independent of configurations. Motion depends on the factor and is not the real motion;
        :meth:`describeEffects` says so. With a factor of 4 to 16, the rotation of light bodies
        (water) becomes slower than the other motion that limits the step. Time steps can then be
        longer: docs/guide/thermostats.md has measurements.

        Angular momenta, kinetic energies and temperatures use the scaled moments, so equipartition
        holds about every axis. Angular velocities are real: :meth:`setBodyAngularVelocities` and
        the velocities of particles refer to the visible rotation. The factor does not change the
        rates of :meth:`setRotationalFriction`. It does not change the friction of a fluid
        (LangevinHI) either; there angular momenta relax more slowly by the factor, and diffusion
        over long times is real. :meth:`getRigidBodyParameters` and files have the real moments. The
        factor does not change masses and free particles. Schemes without momenta ignore it.

        You may change the factor between steps, and the change takes effect at once. Positions and
        all velocities stay the same, so rotational kinetic energies change by the ratio of the
        factors. Friction restores thermal equilibrium. The Context's
        ``setVelocitiesToTemperature()`` does so at once. A checkpoint or State saved under another
        factor continues in the same way.

        Parameters
        ----------
        factor : float
            dimensionless; positive, finite
        """
        super().setInertiaScale(self._number(factor, _units.NONE, 'setInertiaScale', 'factor'))

    def setBodyFriction(self, index: int, gamma: Number, Gamma: Number) -> None:
        """Give one body its own frictions.

        Parameters
        ----------
        index : int
            index of the body
        gamma, Gamma : float or Quantity
            translational and rotational friction, 1/ps; not negative, finite
        """
        super().setBodyFriction(self._index(index, 'setBodyFriction'),
                                self._number(gamma, _units.RATE, 'setBodyFriction', 'gamma'),
                                self._number(Gamma, _units.RATE, 'setBodyFriction', 'Gamma'))

    def getBodyFriction(self, index: int) -> tuple[unit.Quantity, unit.Quantity]:
        """Get the pair (gamma, Gamma) of one body, Quantities in 1/ps.

        They are the body's own frictions, or else the frictions of the integrator.
        """
        gamma, Gamma = super().getBodyFriction(self._index(index, 'getBodyFriction'))
        return _units.RATE.attach(gamma), _units.RATE.attach(Gamma)

    def getBodyHasOwnFriction(self, index: int) -> bool:
        """Get whether a body has its own frictions."""
        return super().getBodyHasOwnFriction(self._index(index, 'getBodyHasOwnFriction'))

    def clearBodyFriction(self, index: int) -> None:
        """Let a body use the frictions of the integrator again."""
        super().clearBodyFriction(self._index(index, 'clearBodyFriction'))

    def setBodyHeld(self, index: int, held: bool) -> None:
        """Hold a body at its position and orientation, or release it.

        A held body is an obstacle. It never moves, has no momentum and needs no mass, and a fluid
        is at rest on it. Forces on it change only the wrench that holds it
        (:meth:`computeHoldingWrenches`).

        You may change the flag between steps. XML has the flag, but checkpoints and States do not.

        Parameters
        ----------
        index : int
            index of the body
        held : bool
            whether the body is held

        Raises
        ------
        openmm.OpenMMException
            if the index is out of range; at Context creation and at the next step: if nothing could
            move, or if the System has a barostat or a CMMotionRemover
        """
        super().setBodyHeld(self._index(index, 'setBodyHeld'),
                            _units.boolean(held, _where('setBodyHeld'), 'held'))

    def getBodyHeld(self, index: int) -> bool:
        """Get whether a body is held."""
        return super().getBodyHeld(self._index(index, 'getBodyHeld'))

    def setParticleHeld(self, particle: int, held: bool) -> None:
        """Hold a free particle where it is, or release it.

        It is then an obstacle, like a held body (:meth:`setBodyHeld`).

        Parameters
        ----------
        particle : int
            index of a particle that is in no body and is no virtual site
        held : bool
            whether the particle is held

        Raises
        ------
        openmm.OpenMMException
            if the index is negative; at Context creation and at the next step: as for
            :meth:`setBodyHeld`, if the particle does not exist, if it is in a body or is a virtual
            site, or if a constraint ties it to another particle
        """
        where = _where('setParticleHeld')
        super().setParticleHeld(_units.integer(particle, where, 'particle'),
                                _units.boolean(held, where, 'held'))

    def getParticleHeld(self, particle: int) -> bool:
        """Get whether :meth:`setParticleHeld` holds a particle."""
        return super().getParticleHeld(
            _units.integer(particle, _where('getParticleHeld'), 'particle'))

    def getHeldParticles(self) -> list[int]:
        """Get the indices of all particles held by :meth:`setParticleHeld`, ascending."""
        return np.frombuffer(super().getHeldParticles(), dtype=np.intc).tolist()

    # ---- Joints ----------------------------------------------------------------------------------

    def addBallJoint(self, i: int, anchor_i: Numbers, j: int, anchor_j: Numbers) -> int:
        """Join two bodies by a ball joint: the two anchors are at one place.

        Joints are rigid. The schemes sample the equilibrium of infinitely stiff springs, whose
        constant does not depend on the poses. Jointed bodies must belong to one group of
        :meth:`MobilityForce.setGroups`, and poses at the start must have the anchors together
        within the pose tolerance. Only FixmanMidpoint, RandomFiniteDifference and TrapezoidalSlip
        support joints. Joints become part of a Context at its creation.

        Parameters
        ----------
        i : int
            index of the first body
        anchor_i : sequence of 3 float, or Quantity
            the anchor in the body frame of the first body, nm
        j : int
            index of the second body
        anchor_j : sequence of 3 float, or Quantity
            the anchor in the body frame of the second body, nm

        Returns
        -------
        int
            index of the joint

        Raises
        ------
        openmm.OpenMMException
            if an index is out of range, if both indices are the same, or if a number is not finite
        """
        return super().addBallJoint(*self._ends('addBallJoint', i, anchor_i, j, anchor_j))

    def addBallJointToPoint(self, i: int, anchor_i: Numbers, point: Numbers) -> int:
        """Join a body to a point of space by a ball joint: the anchor is at the point.

        Everything else is as for :meth:`addBallJoint`.

        Parameters
        ----------
        i : int
            index of the body
        anchor_i : sequence of 3 float, or Quantity
            the anchor in the body frame, nm
        point : sequence of 3 float, or Quantity
            the point, lab frame, nm

        Returns
        -------
        int
            index of the joint

        Raises
        ------
        openmm.OpenMMException
            if the index is out of range, or if a number is not finite
        """
        where = _where('addBallJointToPoint')
        return super().addBallJointToPoint(
            _units.integer(i, where, 'i'), _units.vector(anchor_i, _units.LENGTH, where,
                                                         'anchor_i'),
            _units.vector(point, _units.LENGTH, where, 'point'))

    def addLink(self, i: int, anchor_i: Numbers, j: int, anchor_j: Numbers, length: Number) -> int:
        """Join two bodies by a link: the two anchors have a fixed distance.

        Everything else is as for :meth:`addBallJoint`.

        Parameters
        ----------
        i : int
            index of the first body
        anchor_i : sequence of 3 float, or Quantity
            the anchor in the body frame of the first body, nm
        j : int
            index of the second body
        anchor_j : sequence of 3 float, or Quantity
            the anchor in the body frame of the second body, nm
        length : float or Quantity
            the distance, nm

        Returns
        -------
        int
            index of the joint

        Raises
        ------
        openmm.OpenMMException
            if an index is out of range, if both indices are the same, if a number is not finite, or
            if the length is not positive
        """
        return super().addLink(*self._ends('addLink', i, anchor_i, j, anchor_j),
                               self._number(length, _units.LENGTH, 'addLink', 'length'))

    def addHinge(self, i: int, anchor_i: Numbers, j: int, anchor_j: Numbers, axis_i: Numbers,
                 axis_j: Numbers) -> int:
        """Join two bodies by a hinge: the anchors are at one place, the axes have one direction.

        Everything else is as for :meth:`addBallJoint`.

        Parameters
        ----------
        i : int
            index of the first body
        anchor_i : sequence of 3 float, or Quantity
            the anchor in the body frame of the first body, nm
        j : int
            index of the second body
        anchor_j : sequence of 3 float, or Quantity
            the anchor in the body frame of the second body, nm
        axis_i, axis_j : sequence of 3 float
            the axis in the body frame of the first and of the second body; its length has no effect

        Returns
        -------
        int
            index of the joint

        Raises
        ------
        openmm.OpenMMException
            if an index is out of range, if both indices are the same, if a number is not finite, or
            if an axis is zero
        """
        where = _where('addHinge')
        return super().addHinge(*self._ends('addHinge', i, anchor_i, j, anchor_j),
                                _units.vector(axis_i, _units.NONE, where, 'axis_i'),
                                _units.vector(axis_j, _units.NONE, where, 'axis_j'))

    @staticmethod
    def _ends(method, i, anchor_i, j, anchor_j):
        where = _where(method)
        return (_units.integer(i, where,
                               'i'), _units.vector(anchor_i, _units.LENGTH, where,
                                                   'anchor_i'), _units.integer(j, where, 'j'),
                _units.vector(anchor_j, _units.LENGTH, where, 'anchor_j'))

    def getNumJoints(self) -> int:
        """Get the number of joints."""
        return super().getNumJoints()

    def getJointParameters(self, index: int) -> dict[str, Any]:
        """Get the definition of a joint.

        Parameters
        ----------
        index : int
            index of the joint

        Returns
        -------
        dict
            kind ('Ball', 'BallToPoint', 'Link' or 'Hinge') and the arguments of the method that
            adds such a joint, by their names. Lengths are Quantities in nm. The axes of a hinge are
            unit vectors. For a ball joint to a point, j is -1.

        Raises
        ------
        openmm.OpenMMException
            if the index is out of range
        """
        joint = super().getJointParameters(self._index(index, 'getJointParameters'))
        for name in ('anchor_i', 'anchor_j', 'point'):
            if name in joint:
                joint[name] = _units.LENGTH.attach(_units.array(joint[name]))
        for name in ('axis_i', 'axis_j'):
            if name in joint:
                joint[name] = _units.array(joint[name])
        if 'length' in joint:
            joint['length'] = _units.LENGTH.attach(joint['length'])
        return joint

    def addHingeMotor(self, hinge: int, rate: Number) -> int:
        """Add a motor to a hinge: it turns the second body about the axis, relative to the first.

        You prescribe the rate of the right-handed rotation, and the motor exerts the necessary
        torque. A rate of 0 locks the hinge. The motor becomes part of a Context at its creation.

        In each step the angle of the hinge grows by rate times step size, as exactly as anchors
        keep their places (:meth:`setJointTolerance`), with noise, too. The noise and the drift of
        the other motions are correct for bodies with this motor.

        Parameters
        ----------
        hinge : int
            index of the joint, as :meth:`addHinge` returned it
        rate : float or Quantity
            rad/ps, of either sign

        Returns
        -------
        int
            index of the motor

        Raises
        ------
        openmm.OpenMMException
            if the index is out of range, if the joint is no hinge or already has a motor, or if the
            rate is not finite
        """
        return super().addHingeMotor(
            _units.integer(hinge, _where('addHingeMotor'), 'hinge'),
            self._number(rate, _units.ANGULAR_VELOCITY, 'addHingeMotor', 'rate'))

    def getNumHingeMotors(self) -> int:
        """Get the number of motors."""
        return super().getNumHingeMotors()

    def getHingeMotorParameters(self, index: int) -> tuple[int, unit.Quantity]:
        """Get the pair (hinge, rate) of a motor: the index of its joint, and a Quantity in rad/ps.

        Parameters
        ----------
        index : int
            index of the motor

        Raises
        ------
        openmm.OpenMMException
            if the index is out of range
        """
        hinge, rate = super().getHingeMotorParameters(self._index(index, 'getHingeMotorParameters'))
        return hinge, _units.ANGULAR_VELOCITY.attach(rate)

    def getHingeMotorRate(self, index: int) -> unit.Quantity:
        """Get the rate of a motor, a Quantity in rad/ps."""
        return _units.ANGULAR_VELOCITY.attach(super().getHingeMotorRate(
            self._index(index, 'getHingeMotorRate')))

    def setHingeMotorRate(self, index: int, rate: Number) -> None:
        """Set the rate of a motor, rad/ps.

        You may change the rate between steps; it is constant during a step: for a rate that depends
        on time give the mean over the step, or the value at its middle. XML has the rate, but
        checkpoints and States do not.

        Parameters
        ----------
        index : int
            index of the motor
        rate : float or Quantity
            rad/ps, of either sign

        Raises
        ------
        openmm.OpenMMException
            if the index is out of range, or if the rate is not finite
        """
        super().setHingeMotorRate(
            self._index(index, 'setHingeMotorRate'),
            self._number(rate, _units.ANGULAR_VELOCITY, 'setHingeMotorRate', 'rate'))

    def getJointTolerance(self) -> unit.Quantity:
        """Get the tolerance of joints, a Quantity in nm."""
        return _units.LENGTH.attach(super().getJointTolerance())

    def setJointTolerance(self, tolerance: Number) -> None:
        """Set the largest distance of an anchor from its place after each step, nm.

        The default is 1e-10. The same number in radians holds for axes of hinges, and for the turns
        of motors during a step. Far from the origin, where coordinates round to more than an eighth
        of it, eight of these roundings take its place. You may change the setting between steps.
        """
        super().setJointTolerance(
            self._number(tolerance, _units.LENGTH, 'setJointTolerance', 'tolerance'))

    # ---- Further settings ------------------------------------------------------------------------

    def getGradientRelaxationTime(self) -> unit.Quantity:
        """Get upsilon of GradientThermostat, a Quantity in ps."""
        return _units.TIME.attach(super().getGradientRelaxationTime())

    def setGradientRelaxationTime(self, upsilon: Number) -> None:
        """Set upsilon of GradientThermostat (eq. 15), ps; default 0.004; positive, finite."""
        super().setGradientRelaxationTime(
            self._number(upsilon, _units.TIME, 'setGradientRelaxationTime', 'upsilon'))

    def getGradientRotationalRelaxationTime(self) -> unit.Quantity:
        """Get Upsilon of GradientThermostat, a Quantity in ps."""
        return _units.TIME.attach(super().getGradientRotationalRelaxationTime())

    def setGradientRotationalRelaxationTime(self, Upsilon: Number) -> None:
        """Set Upsilon of GradientThermostat (eq. 16), ps; default 0.001; positive, finite."""
        method = 'setGradientRotationalRelaxationTime'
        super().setGradientRotationalRelaxationTime(
            self._number(Upsilon, _units.TIME, method, 'Upsilon'))

    def getRandomNumberSeed(self) -> int:
        """Get the seed in use, an int.

        It is the seed of the bound Context: as set, drawn afresh, or loaded with a checkpoint or
        State. Without a Context it is the seed as it was set (0: each Context draws a fresh seed).
        """
        return super().getRandomNumberSeed()

    def getRandomNumberSeedAsSet(self) -> int:
        """Get the seed with which the next Context begins: as it was set, 0 for a fresh one."""
        return super().getRandomNumberSeedAsSet()

    def setRandomNumberSeed(self, seed: int) -> None:
        """Set the seed, an int.

        With 0 (default) each Context draws a fresh seed. A bound Context uses the new seed from its
        next step on; with 0 it draws a fresh seed at once.

        Checkpoints and States save the seed in use. It continues after loading one of them, and
        after ``reinitialize(preserveState=True)``. If runs begin with one checkpoint and must
        differ, call this method after loading the checkpoint. Random numbers are functions of seed
        and step, so setting the seed that is in use changes nothing.
        """
        super().setRandomNumberSeed(_units.integer(seed, _where('setRandomNumberSeed'), 'seed'))

    def getPoseTolerance(self) -> unit.Quantity:
        """Get the pose tolerance, a Quantity in nm."""
        return _units.LENGTH.attach(super().getPoseTolerance())

    def setPoseTolerance(self, tolerance: Number) -> None:
        """Set how far a particle may lie from its place in the body, nm; default 2e-3.

        The tolerance applies to positions given to the Context. The next step moves particles
        within the tolerance back to their places. A particle beyond it is an error that names body,
        particle and distance. The default accepts positions rounded to three decimals of nm, as in
        .gro files. :func:`openmmrigidhi.app.placeBodies` moves particles to their places from
        farther away.
        """
        super().setPoseTolerance(
            self._number(tolerance, _units.LENGTH, 'setPoseTolerance', 'tolerance'))

    def getFiniteDifferenceStep(self) -> float:
        """Get the relative finite-difference step; 0: the solver chooses it."""
        return super().getFiniteDifferenceStep()

    def setFiniteDifferenceStep(self, relative: Number) -> None:
        r"""Set the relative step delta of the finite differences; from 0 to 0.1.

        The schemes without momenta in a fluid take these differences. They displace bodies by delta
        times their length (the longest distance of points on their particles) and turn them by
        delta radians.

        The default is 0, which means 1e-5, except for differences of matrix-free solves: in
        RandomFiniteDifference with multiblobs, and in all such schemes with multiblobs that have
        own tensors. There 0 means :math:`\epsilon^{1/3}` with the solver tolerance
        :math:`\epsilon`, between 1e-5 and 1e-2, with iterations to a tenth of the tolerance. The
        same holds in the drift-correctors at tolerances from 5e-5 up, where products are in single
        precision. On a grid (ForceCoupling) the step has no effect on the drift-correctors, because
        they take the derivative of the random field.
        """
        super().setFiniteDifferenceStep(
            self._number(relative, _units.NONE, 'setFiniteDifferenceStep', 'relative'))

    def getNumHostThreads(self) -> int:
        """Get the number of threads of the host as it was set (0: OpenMM's default)."""
        return super().getNumHostThreads()

    def setNumHostThreads(self, number: int) -> None:
        """Set the number of threads for bodies, fluid and noise on a device's host; 0 to 1024.

        The number applies to platforms other than Reference and CPU. On these platforms a device
        computes the forces, and the host computes everything that :meth:`getEffects` does not
        report as "on the device". With 0 (default) the number is that of OpenMM's CPU platform:
        ``OPENMM_CPU_THREADS``, or the number of processors. A change takes effect at the next
        Context creation or ``reinitialize()``. Reference has one thread. On the CPU platform its
        own property "Threads" counts instead of this setting. Results do not depend on the number.
        """
        super().setNumHostThreads(_units.integer(number, _where('setNumHostThreads'), 'number'))

    def getWallRejection(self) -> _WallRejection:
        """Get which steps through a wall the scheme redoes (Overlap or Crossing)."""
        return WallRejection(super().getWallRejection())

    def setWallRejection(self, rejection: Union[_WallRejection, str, int]) -> None:
        """Set which steps through a wall the scheme redoes with new noise.

        The setting applies to a MobilityForce with a boundary that has walls. You may change it
        between steps, and the change takes effect at once. A start in such a position is an error.

        Parameters
        ----------
        rejection : constant or str
            Overlap (default): steps after which a hydrodynamic particle is nearer to the wall than
            its radius a. Repulsions that diverge at contact need Overlap. Crossing: steps after
            which the centre of a hydrodynamic particle is on the wall or behind it.

        Notes
        -----
        Under Crossing, particles with their centre at :math:`0 < z < a` above a NoSlipWall have the
        mobility at contact, multiplied by :math:`z/a` for their velocities, and once more for the
        forces on them. This keeps the mobility continuous and positive definite. Between slip walls
        the scheme damps no mobility.
        """
        super().setWallRejection(
            _units.constant(rejection, WallRejection, _where('setWallRejection'), 'rejection'))

    def getDriftCorrectorScaling(self) -> _DriftCorrectorScaling:
        """Get what the drift factor of the drift-correctors multiplies (SlipOnly or Whole)."""
        return DriftCorrectorScaling(super().getDriftCorrectorScaling())

    def setDriftCorrectorScaling(self, scaling: Union[_DriftCorrectorScaling, str, int]) -> None:
        r"""Set what the drift factor of DriftCorrectorFD and DriftCorrectorRFD multiplies.

        The factor :math:`\nu = 1 + (h/2)\,\mathrm{div}\,V` is one number for all bodies of a group.
        It fluctuates about 1 by the step times the divergence of the random velocities. The
        fluctuation grows with the number of bodies. Where it is larger than 0.3, a warning says so.
        You may change the setting between steps.

        Parameters
        ----------
        scaling : constant or str
            SlipOnly (default): :math:`\nu` multiplies the slips (random surface velocities) in the
            mobility problem, :math:`U = N (F + \nu K^T M^{-1} v)`. The weak order is the same, and
            the effect of forces has no noise from :math:`\nu`. Whole: :math:`\nu` multiplies the
            whole step, as in Westwood 2022, eq. 44.
        """
        super().setDriftCorrectorScaling(
            _units.constant(scaling, DriftCorrectorScaling, _where('setDriftCorrectorScaling'),
                            'scaling'))

    def getMaximumRejections(self) -> int:
        """Get how many times in a row the scheme may redo a step."""
        return super().getMaximumRejections()

    def setMaximumRejections(self, number: int) -> None:
        """Set how many times in a row the scheme may redo a step with new noise; default 100.

        The number is from 0 to 65535. More redone steps in a row are an error. The scheme redoes a
        step when spheres with lubrication overlap, or when particles come too near to a wall
        (:meth:`setWallRejection`). In schemes without momenta the number applies to each group of
        :meth:`MobilityForce.setGroups`.
        """
        super().setMaximumRejections(
            _units.integer(number, _where('setMaximumRejections'), 'number'))

    def getNumRejectedSteps(self) -> int:
        """Get how many steps were redone since the creation of the Context, at most 2**31 - 1.

        In schemes without momenta every group of :meth:`MobilityForce.setGroups` counts its own
        steps. The call needs a Context.
        """
        return super().getNumRejectedSteps()

    def setStepSize(self, size: Number) -> None:
        """Set the step size, ps; positive, finite."""
        super().setStepSize(self._number(size, _units.TIME, 'setStepSize', 'size'))

    def setConstraintTolerance(self, tolerance: Number) -> None:
        """Set the relative tolerance of the constraints of free particles; positive, finite."""
        super().setConstraintTolerance(
            self._number(tolerance, _units.NONE, 'setConstraintTolerance', 'tolerance'))

    def setIntegrationForceGroups(self, groups: Union[int, set[int], frozenset[int]]) -> None:
        """Set the force groups that move the particles; default: all of them.

        Parameters
        ----------
        groups : set of int, or int
            groups from 0 to 31, or a bit mask in which bit i stands for group i (-1: all groups)

        Raises
        ------
        TypeError, ValueError
            for any other value
        """
        where = _where('setIntegrationForceGroups')
        if isinstance(groups, (set, frozenset)):
            mask = 0
            for group in groups:
                group = _units.integer(group, where, 'groups')
                if not 0 <= group < 32:
                    raise ValueError(f'{where}: groups: got the group {group}; a group must be '
                                     'from 0 to 31')
                mask |= 1 << group
        else:
            try:
                mask = operator.index(groups)
            except TypeError:
                raise TypeError(f'{where}: groups: got {groups!r}; it must be a set of groups from '
                                '0 to 31, such as {0, 1}, or an integer with a bit for each '
                                'group') from None
            if not -2**31 <= mask < 2**32:
                raise ValueError(f'{where}: groups: got the bit mask {mask}; a bit mask must be '
                                 'from -2^31 to 2^32-1: give a set of groups from 0 to 31')
        super().setIntegrationForceGroups(mask)

    @staticmethod
    def _number(value, dimension, method, name):
        return _units.number(value, dimension, _where(method), name)

    # ---- State of the bodies of the bound Context ------------------------------------------------

    def getBodyPositions(self) -> unit.Quantity:
        """Get the positions of the bodies' origins, a Quantity of shape (n, 3).

        The positions are in nm, in the lab frame, unwrapped. The origin is the centre of mass.
        Under schemes without momenta in a fluid it may be any point, the tracking point.

        All methods of this section need a Context with positions.
        """
        return _units.LENGTH.attach(_units.array(super().getBodyPositions(), 3))

    def getBodyOrientations(self) -> Array:
        """Get the orientations of the bodies, an array of shape (n, 4).

        Rows are unit quaternions (w, x, y, z), from the body frame to the lab frame.
        """
        return _units.array(super().getBodyOrientations(), 4)

    def getBodyVelocities(self) -> unit.Quantity:
        """Get the velocities of the bodies' origins, a Quantity of shape (n, 3).

        The velocities are in nm/ps, in the lab frame. Under schemes without momenta they are the
        velocities that you set.
        """
        return _units.VELOCITY.attach(_units.array(super().getBodyVelocities(), 3))

    def getBodyAngularVelocities(self) -> unit.Quantity:
        """Get the angular velocities of the bodies: Quantity of shape (n, 3), rad/ps, lab frame."""
        return _units.ANGULAR_VELOCITY.attach(_units.array(super().getBodyAngularVelocities(), 3))

    def setBodyPositions(self, positions: Numbers) -> None:
        """Set the positions of the bodies' origins, and move their particles.

        Parameters
        ----------
        positions : array-like or Quantity of shape (n, 3)
            one finite row for each body, nm, lab frame
        """
        super().setBodyPositions(
            self._rows(positions, _units.LENGTH, 3, 'setBodyPositions', 'positions'))

    def setBodyOrientations(self, orientations: npt.ArrayLike) -> None:
        """Set the orientations of the bodies, and move their particles.

        Parameters
        ----------
        orientations : array-like of shape (n, 4)
            quaternions (w, x, y, z), body to lab frame; their length must be 1 within 1e-3, and
            they are normalised
        """
        super().setBodyOrientations(
            self._rows(orientations, _units.NONE, 4, 'setBodyOrientations', 'orientations'))

    def setBodyVelocities(self, velocities: Numbers) -> None:
        """Set the velocities of the bodies' origins.

        Parameters
        ----------
        velocities : array-like or Quantity of shape (n, 3)
            one finite row for each body, nm/ps, lab frame
        """
        super().setBodyVelocities(
            self._rows(velocities, _units.VELOCITY, 3, 'setBodyVelocities', 'velocities'))

    def setBodyAngularVelocities(self, angularVelocities: Numbers) -> None:
        """Set the angular velocities of the bodies.

        Components about axes without inertia are dropped.

        Parameters
        ----------
        angularVelocities : array-like or Quantity of shape (n, 3)
            one finite row for each body, rad/ps, lab frame
        """
        super().setBodyAngularVelocities(
            self._rows(angularVelocities, _units.ANGULAR_VELOCITY, 3, 'setBodyAngularVelocities',
                       'angularVelocities'))

    def _rows(self, values, dimension, columns, method, name):
        known = count = self.getNumRigidBodies()
        try:
            count = self.getNumRigidBodiesOfContext()
        except openmm.OpenMMException:
            pass  # there is no Context, which the method itself will say
        if count == known:
            return _units.rows(values, dimension, columns, _where(method), name, count)
        result = _units.rows(values, dimension, columns, _where(method), name)
        if len(result) != count:
            raise ValueError(
                f'{_where(method)}: {name}: got {len(result)} rows; the Context has {count} of the '
                f'integrator\'s {known} bodies, because the others were added later: give one row '
                'for each body of the Context, or reinitialize the Context')
        return result

    def getBodyForces(self) -> unit.Quantity:
        """Get the total forces on the bodies at the last force evaluation of the last step.

        Returns
        -------
        Quantity of shape (n, 3)
            kJ/(mol nm), lab frame
        """
        return _units.FORCE.attach(_units.array(super().getBodyForces(), 3))

    def getBodyTorques(self) -> unit.Quantity:
        """Get the total torques on the bodies at the last force evaluation of the last step.

        The torques are about the bodies' origins.

        Returns
        -------
        Quantity of shape (n, 3)
            kJ/mol, lab frame
        """
        return _units.ENERGY.attach(_units.array(super().getBodyTorques(), 3))

    def computeHoldingWrenches(self) -> Array:
        """Get the wrenches that hold the bodies at the present poses, without noise.

        The fluid and all forces on a held body together exert the opposite of its wrench. Under
        LangevinHI the wrenches belong to the present velocities of the other bodies.

        Returns
        -------
        array of shape (n, 6)
            the force, kJ/(mol nm), and the torque about the body's origin, kJ/mol, both in the lab
            frame, as plain numbers; rows of bodies that are not held are 0
        """
        return _units.array(super().computeHoldingWrenches(), 6)

    def getHoldingWrenches(self) -> Array:
        """Get the wrenches that held the bodies during the last step, with the share of the noise.

        Only schemes in a fluid have them. Their variance is inversely proportional to the step
        size.

        Returns
        -------
        array of shape (n, 6)
            as from :meth:`computeHoldingWrenches`
        """
        return _units.array(super().getHoldingWrenches(), 6)

    def computeParticleHoldingForces(self) -> unit.Quantity:
        """Get the forces that hold particles at the present positions, without noise.

        The particles are those of :meth:`setParticleHeld`.

        Returns
        -------
        Quantity of shape (m, 3)
            kJ/(mol nm), lab frame; a row for each particle of the System, which is 0 unless the
            particle is held
        """
        return _units.FORCE.attach(_units.array(super().computeParticleHoldingForces(), 3))

    def getParticleHoldingForces(self) -> unit.Quantity:
        """Get the forces that held particles during the last step, with the share of the noise.

        The share of the noise is as in :meth:`getHoldingWrenches`.

        Returns
        -------
        Quantity of shape (m, 3)
            as from :meth:`computeParticleHoldingForces`
        """
        return _units.FORCE.attach(_units.array(super().getParticleHoldingForces(), 3))

    def getJointForces(self) -> unit.Quantity:
        """Get the forces that the joints exerted during the last step.

        The share of the noise is as in :meth:`getHoldingWrenches`. A hinge also exerts a torque
        across its axis, which the result omits; its motor exerts a torque about the axis, which
        :meth:`getHingeMotorTorques` returns.

        Returns
        -------
        Quantity of shape (m, 3)
            kJ/(mol nm), lab frame; for each joint of the Context the force on its first body, which
            acts at the anchor. The force on the second body is the opposite.
        """
        return _units.FORCE.attach(_units.array(super().getJointForces(), 3))

    def getHingeMotorTorques(self) -> unit.Quantity:
        """Get the torques that the motors exerted during the last step.

        Without noise, torque times rate is the power of the motor. With noise the torque fluctuates
        like the wrenches of :meth:`getHoldingWrenches`.

        Returns
        -------
        Quantity of shape (m,)
            kJ/mol; for each motor of the Context the torque about the axis of its hinge on the
            second body. The torque on the first body is the opposite.
        """
        return _units.ENERGY.attach(_units.array(super().getHingeMotorTorques()))

    def getPoseResidual(self) -> unit.Quantity:
        """Get the largest distance of a particle from its place in its body, a Quantity in nm.

        The distance belongs to the last fit of poses to positions.
        """
        return _units.LENGTH.attach(super().getPoseResidual())

    # ---- Energies and temperature ----------------------------------------------------------------

    def computeTranslationalKineticEnergy(self) -> unit.Quantity:
        """Get the translational kinetic energy of all bodies, a Quantity in kJ/mol.

        It is 0 for schemes without momenta.
        """
        return _units.ENERGY.attach(super().computeTranslationalKineticEnergy())

    def computeRotationalKineticEnergies(self) -> unit.Quantity:
        """Get the rotational kinetic energies, summed over bodies; 0 for schemes without momenta.

        Returns
        -------
        Quantity of shape (3,)
            kJ/mol, about the axis of the smallest, the middle and the largest principal moment of
            each body
        """
        return _units.ENERGY.attach(_units.array(super().computeRotationalKineticEnergies()))

    def computeFreeParticleKineticEnergy(self) -> unit.Quantity:
        """Get the kinetic energy of the free particles, a Quantity in kJ/mol.

        It is 0 for schemes without momenta.
        """
        return _units.ENERGY.attach(super().computeFreeParticleKineticEnergy())

    def getDegreesOfFreedom(self) -> dict:
        """Get the numbers of kinetic degrees of freedom, a dict of int.

        Returns
        -------
        dict
            The keys are "translational"; "rotational1", "rotational2", "rotational3": the numbers
            of bodies that can rotate about the axis of their smallest, middle, largest moment;
            "free": the number for free particles, minus their constraints; "removed": 3 with a
            CMMotionRemover; "total". All are 0 for schemes without momenta.

        Notes
        -----
        A CMMotionRemover removes the momentum of bodies and free particles, whether or not the
        bodies' masses are the System's masses.
        """
        return super().getDegreesOfFreedom()

    def computeSystemTemperature(self) -> unit.Quantity:
        r"""Get the instantaneous temperature of bodies and free particles.

        It is :math:`2 E_\mathrm{kin}/(k_\mathrm{B} n)` with the number n of degrees of freedom of
        :meth:`getDegreesOfFreedom`. From OpenMM 8 on, OpenMM's StateDataReporter calls this method.

        Returns
        -------
        Quantity
            K

        Raises
        ------
        openmm.OpenMMException
            if the scheme has no momenta or nothing moves
        """
        return _units.TEMPERATURE.attach(super().computeSystemTemperature())

    def computeMidStepTemperature(self) -> unit.Quantity:
        r"""Get the mid-step temperature of bodies and free particles.

        It is the temperature of the momenta with which the first drift of the next step moves
        bodies and particles, averaged over the noise that this step draws before the drift. It
        distinguishes right runs from wrong ones at long steps, where
        :meth:`computeSystemTemperature` reads low.

        Returns
        -------
        Quantity
            K; the degrees of freedom are those of :meth:`getDegreesOfFreedom`

        Raises
        ------
        openmm.OpenMMException
            if the scheme has no momenta, nothing moves, or positions were not set

        Notes
        -----
        In a right run the expected mean is:

        - LangevinC and LangevinHI: the temperature of the bath;
        - LangevinB: the temperature of the bath, times the factor by which the step makes mean
          squares of positions in a harmonic well wrong, :math:`1/(1 - h^2 \omega^2/4)`;
        - LangevinA: the temperature of the bath, times about :math:`1 - \gamma h/2`, with the rate
          of the axis for rotations.

        The call evaluates forces if they are out of date. It does not change the following steps.
        """
        return _units.TEMPERATURE.attach(super().computeMidStepTemperature())

    def computeMidStepTemperatures(self) -> dict[str, unit.Quantity]:
        """Get separate mid-step temperatures of bodies and free particles.

        Returns
        -------
        dict of Quantity
            K: "translational" and "rotational" of bodies, "free" of free particles, "total". Names
            without degrees of freedom are left out. The degrees of freedom that a CMMotionRemover
            removes are divided between bodies and free particles by their masses.

        Raises
        ------
        openmm.OpenMMException
            as :meth:`computeMidStepTemperature`
        """
        return {
            name: _units.TEMPERATURE.attach(temperature)
            for name, temperature in super().computeMidStepTemperatures().items()
        }

    # ---- What the scene costs --------------------------------------------------------------------

    def describeEffects(self) -> str:
        """Get which effects are on, and why, as text; the call needs a Context.

        Returns
        -------
        str
            a line for each effect that is on, a line with the names of the effects that are off,
            and then warnings, each a sentence with a remedy; :meth:`getEffects` has the same for
            programs
        """
        return super().describeEffects()

    def getEffects(self) -> dict:
        """Get which effects are on, and why; the call needs a Context.

        Returns
        -------
        dict
            from name to "on: reason" or "off: reason": scheme, momenta, noise, "stochastic drift",
            "finite differences", hydrodynamics, "hydrodynamic interactions", "mobilities asked
            for", rotation, frictions, "free particles", "body forces", barostat, warnings and
            others
        """
        return super().getEffects()

    def getStepStatistics(self) -> dict:
        """Get counters and times since the creation of the Context; the call needs a Context.

        Returns
        -------
        dict
            steps, forceEvaluations, mobilityProducts, solverIterations, randomNumbers, squareRoots
            (int); seconds_forces, seconds_mobility, seconds_scheme (float, seconds); for a fluid on
            a grid, summed over all threads, seconds_spreading (forces to nodes), seconds_fft
            (Fourier transforms, with the fluid's response), seconds_averaging (velocities over
            nodes), seconds_solver (iterations apart from products) (float, seconds; 0 without a
            grid); for bodies on a device, deviceLaunches (kernels, without OpenMM's) and
            deviceLooks (at a flag or a few sums, for which the host waits) (int; 0 elsewhere);
            deviceTransfers (int: states of bodies, and positions, velocities or forces of all
            particles, in either direction, also where the host moves bodies; 0 without a device)
        """
        return {
            name: value if name.startswith('seconds') else int(value)
            for name, value in super().getStepStatistics().items()
        }

    def step(self, steps: int) -> None:
        """Advance the simulation.

        A step costs one evaluation of the Context's forces, or two with FixmanMidpoint and
        TrapezoidalSlip. Other Python threads run meanwhile. Ctrl-C stops the simulation between
        steps.

        Parameters
        ----------
        steps : int
            number of steps

        Raises
        ------
        openmm.OpenMMException
            if the positions do not fit the bodies, or if forces or positions become non-finite; the
            message then names the step and the body, and the Context keeps the last good state
        """
        steps = _units.integer(steps, _where('step'), 'steps')
        # Python looks for signals only when C++ returns. On a device each return waits for it, so
        # that fast steps are taken in longer rows.
        stepsBetweenSignals, longest, soon = 50, 1600, 0.05
        while steps > stepsBetweenSignals:
            begin = time.monotonic()
            super().step(stepsBetweenSignals)
            steps -= stepsBetweenSignals
            if time.monotonic() - begin < soon:
                stepsBetweenSignals = min(2*stepsBetweenSignals, longest)
        super().step(steps)


CustomRigidHIIntegrator.__doc__ = CustomRigidHIIntegrator.__doc__.replace(
    '@schemes@', _schemes.summary())
for _scheme in Scheme:
    setattr(CustomRigidHIIntegrator, _scheme.name, _scheme)
