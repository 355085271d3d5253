"""MobilityForce: the Python face of the C++ class, with units, checked shapes and documentation."""
import numpy as np
import openmm

from . import _bindings, _copies, _enums, _units

_Base = _bindings.MobilityForce
_TENSOR = (6, 6)


class Model(_enums.Documented):
    """The hydrodynamic models, which setModel() takes; also class attributes of MobilityForce.

    Each has its docstring, and a page with equations, boundaries, accuracy and cost:
    docs/models/README.md says which to take for which scene.
    """

    FreeDraining = _Base.FreeDraining, """No interaction between bodies: a sphere has its Stokes drag, a multiblob its own constant tensor.

        Spheres, multiblobs, free particles, own tensors; Unbounded. Cost: linear in bodies. docs/models/FreeDraining.md has the rest."""
    RotnePragerYamakawa = _Base.RotnePragerYamakawa, """Pairs of spheres or blobs by surface averages of a point force, with rotation (default).

        Unequal radii and overlap allowed; multiblobs, free particles, own tensors; always positive definite. Relative error O((a/r)^4), no lubrication
        (Wajnryb et al., J. Fluid Mech. 731, R3, 2013). Unbounded, NoSlipWall, Periodic. Cost: quadratic in particles for each product,
        less where there are many and setFastSummation() has it;
        Periodic and MatrixFree as the box, by pairs and waves on a grid (Fiore et al., J. Chem. Phys. 146, 124116, 2017).
        docs/models/RotnePragerYamakawa.md has the rest."""
    StokesianDynamics = _Base.StokesianDynamics, """Spheres with force, torque and stresslet of all together, and exact lubrication of each pair.

        Exact for two spheres at every gap (Jeffrey and Onishi, J. Fluid Mech. 139, 261, 1984). Spheres only, without overlap, ratios of radii 0.1 to 10.
        Unbounded, Periodic. Cost: cubic in bodies. docs/models/StokesianDynamics.md has the rest."""
    ForceCoupling = _Base.ForceCoupling, """Like RotnePragerYamakawa, with Gaussians in place of surfaces, on a grid where there are many particles.

        Unequal radii and overlap allowed; multiblobs, free particles, own tensors; always positive semidefinite (Maxey and Patel, Int. J. Multiphase Flow
        27, 1603, 2001; Lomholt and Maxey, J. Comput. Phys. 184, 381, 2003; grids: Yeo and Maxey, J. Comput. Phys. 229, 2401, 2010). Periodic,
        SlipChannel. Cost: as the box on a grid, from 300 rows on or with MatrixFree; else dense. docs/models/ForceCoupling.md has the rest."""


class Boundary(_enums.Documented):
    """What bounds the fluid; also class attributes of MobilityForce."""

    Unbounded = _Base.Unbounded, 'Nothing: fluid at rest at infinity (default).'
    NoSlipWall = _Base.NoSlipWall, 'A plane z = setWallHeight() on which the fluid is at rest, the fluid above it; RotnePragerYamakawa only.'
    Periodic = _Base.Periodic, 'The periodic box of the Context, as it is at each step; all models but FreeDraining.'
    SlipChannel = _Base.SlipChannel, 'Two walls y = const, setChannelWalls(), along which the fluid slips, periodic in x and z; ForceCoupling only.'


class SphereWallMobility(_enums.Documented):
    """What a single sphere above a wall moves like; also class attributes of MobilityForce."""

    FromModel = _Base.FromModel, 'As the model says, which has no lubrication (default).'
    BestKnown = _Base.BestKnown, 'Like a rigid sphere alone above the wall, at every gap, to 3e-8.'


class Solver(_enums.Documented):
    """How the linear algebra is done; also class attributes of MobilityForce."""

    Auto = _Base.Auto, 'Dense or matrix-free, by the numbers of rows of the matrices, never by a clock (default).'
    Dense = _Base.Dense, 'Matrices are formed and decomposed.'
    MatrixFree = _Base.MatrixFree, 'Krylov methods, or a grid, to the solver tolerance.'


def _where(method):
    return 'MobilityForce.' + method


class MobilityForce(_copies.Copies, _Base):
    """How the fluid couples the bodies of a CustomRigidHIIntegrator: viscosity, hydrodynamic radii, model.

    It adds no forces and no energy; the schemes with hydrodynamic interactions read it. Add one to
    the System with ``system.addForce``, and give every particle of the System a hydrodynamic
    radius, in order, by :meth:`addParticle`.

    A body with one hydrodynamic particle is a sphere, which takes force and torque. A body with
    several is a rigid multiblob: its blobs carry forces only, and make its mobility N = (K^T M^-1
    K)^-1, with the mobility M of the blobs and the velocities K of the blobs from those of the
    body. Where all blobs of a body lie on a line, the fluid does not drive its rotation about that
    line, and a torque about it beyond rounding is an error. A particle in no body with a radius
    takes a force only.

    :meth:`setModel` chooses how the fluid couples particles, least accurate first FreeDraining,
    RotnePragerYamakawa (default), ForceCoupling, StokesianDynamics; :meth:`setBoundary` what bounds
    the fluid: Unbounded (default), NoSlipWall, Periodic, SlipChannel. ``help(MobilityForce.Model)``
    and ``help(MobilityForce.Boundary)`` have a paragraph on each, docs/models/README.md says which
    to take for which scene, and each model has a page there with its equations, accuracy and cost,
    and with what each boundary wants and does.

    Wrong types are a TypeError, wrong shapes a ValueError, everything else that is refused an
    openmm.OpenMMException; each names the object, the value, the bound and the remedy.

    Examples
    --------
    >>> import openmmrigidhi
    >>> from openmm import unit
    >>> fluid = openmmrigidhi.MobilityForce()
    >>> fluid.setViscosity(0.89e-3*unit.pascal*unit.second)
    >>> fluid.addParticle(0.3*unit.nanometer)
    0
    """

    Model = Model
    Boundary = Boundary
    SphereWallMobility = SphereWallMobility
    Solver = Solver
    FreeDraining = Model.FreeDraining
    RotnePragerYamakawa = Model.RotnePragerYamakawa
    StokesianDynamics = Model.StokesianDynamics
    ForceCoupling = Model.ForceCoupling
    Unbounded = Boundary.Unbounded
    NoSlipWall = Boundary.NoSlipWall
    Periodic = Boundary.Periodic
    SlipChannel = Boundary.SlipChannel
    FromModel = SphereWallMobility.FromModel
    BestKnown = SphereWallMobility.BestKnown
    Auto = Solver.Auto
    Dense = Solver.Dense
    MatrixFree = Solver.MatrixFree

    _base = _Base
    _generic = openmm.Force

    def __repr__(self):
        return (f'<MobilityForce: {self.getModel().name}, {self.getBoundary().name}, viscosity '
                f'{self.getViscosity()}, '
                f'{self.getNumParticles()} particles>')

    @staticmethod
    def cast(obj):
        """Get a MobilityForce as what it is: ``system.getForce`` and deserialisation return a generic openmm.Force.

        Parameters
        ----------
        obj : openmm.Force
            the object; if it owned the C++ object, the result does from now on, and obj remains
            usable

        Returns
        -------
        MobilityForce
            obj itself if it is one already

        Raises
        ------
        TypeError
            if obj is anything else
        """
        return MobilityForce._castGeneric(obj)

    # ---- Particles and fluid ---------------------------------------------------------------------

    def getNumParticles(self):
        """Get the number of particles that were added."""
        return super().getNumParticles()

    def addParticle(self, radius):
        """Add the next particle of the System.

        Parameters
        ----------
        radius : float or Quantity
            hydrodynamic radius, nm; 0: the fluid does not see the particle; not negative, finite

        Returns
        -------
        int
            index of the particle
        """
        return super().addParticle(self._number(radius, _units.LENGTH, 'addParticle', 'radius'))

    def getParticleRadius(self, index):
        """Get the hydrodynamic radius of a particle, a Quantity in nm."""
        return _units.LENGTH.attach(super().getParticleRadius(
            self._index(index, 'getParticleRadius', 'index')))

    def setParticleRadius(self, index, radius):
        """Set the hydrodynamic radius of a particle; :meth:`updateParametersInContext` hands it to a Context.

        Parameters
        ----------
        index : int
            index of the particle
        radius : float or Quantity
            nm; not negative, finite
        """
        super().setParticleRadius(
            self._index(index, 'setParticleRadius', 'index'),
            self._number(radius, _units.LENGTH, 'setParticleRadius', 'radius'))

    def getViscosity(self):
        """Get the viscosity, a Quantity in dalton/(nm ps)."""
        return _units.VISCOSITY.attach(super().getViscosity())

    def setViscosity(self, eta):
        """Set the viscosity; default: that of water at 298.15 K, 0.89 mPa s.

        Parameters
        ----------
        eta : float or Quantity
            dalton/(nm ps), or a quantity such as ``0.89e-3*unit.pascal*unit.second``; positive,
            finite
        """
        super().setViscosity(_units.viscosity(eta, _where('setViscosity'), 'eta'))

    def getModel(self):
        """Get the model, one of the class attributes FreeDraining, RotnePragerYamakawa, StokesianDynamics, ForceCoupling."""
        return Model(super().getModel())

    def setModel(self, model):
        """Set the model (default RotnePragerYamakawa), one of the class attributes. Takes effect at Context creation."""
        super().setModel(_units.constant(model, Model, _where('setModel'), 'model'))

    def getBoundary(self):
        """Get what bounds the fluid, one of the class attributes Unbounded, NoSlipWall, Periodic, SlipChannel."""
        return Boundary(super().getBoundary())

    def setBoundary(self, boundary):
        """Set what bounds the fluid.

        Parameters
        ----------
        boundary : constant
            Unbounded (default), or NoSlipWall: fluid above the plane z = :meth:`setWallHeight`,
            with the model RotnePragerYamakawa; or Periodic: the Context's periodic box, with all
            models but FreeDraining (ForceCoupling has no boundaries but this and SlipChannel); or
            SlipChannel: between two walls (:meth:`setChannelWalls`) that the fluid slips along,
            with ForceCoupling. Takes effect at Context creation
        """
        super().setBoundary(_units.constant(boundary, Boundary, _where('setBoundary'), 'boundary'))

    def getWallHeight(self):
        """Get the z of the NoSlipWall, a Quantity in nm."""
        return _units.LENGTH.attach(super().getWallHeight())

    def setWallHeight(self, height):
        """Set the z of the NoSlipWall; other boundaries ignore it. Takes effect at Context creation.

        Parameters
        ----------
        height : float or Quantity
            nm; finite; default 0
        """
        super().setWallHeight(self._number(height, _units.LENGTH, 'setWallHeight', 'height'))

    def getChannelWalls(self):
        """Get the y of both walls of the SlipChannel, (yLow, yHigh), Quantities in nm."""
        low, high = super().getChannelWalls()
        return _units.LENGTH.attach(low), _units.LENGTH.attach(high)

    def setChannelWalls(self, yLow, yHigh):
        """Set the y of both walls of the SlipChannel; other boundaries ignore them. Takes effect at Context creation.

        Parameters
        ----------
        yLow, yHigh : float or Quantity
            nm; finite, the first below the second; default 0 and 0, no channel: a Context with this
            boundary is refused
        """
        super().setChannelWalls(self._number(yLow, _units.LENGTH, 'setChannelWalls', 'yLow'),
                                self._number(yHigh, _units.LENGTH, 'setChannelWalls', 'yHigh'))

    def getSphereWallMobility(self):
        """Get what a single sphere above a NoSlipWall moves like, one of the class attributes FromModel, BestKnown."""
        return SphereWallMobility(super().getSphereWallMobility())

    def setSphereWallMobility(self, mobility):
        """Set what a single sphere above a NoSlipWall moves like. Takes effect at Context creation.

        Parameters
        ----------
        mobility : constant
            FromModel (default): without lubrication, so that at contact a quarter of the free
            mobility towards the wall is left; BestKnown: like a rigid sphere alone above the wall,
            at every gap, to 3e-8 (exact solutions: along the wall Dean, O'Neill, 1963, and O'Neill,
            1964, towards it Brenner, 1961, about the normal Jeffery, 1915; eqs. 94 to 97 of Delong
            et al., J. Chem. Phys. 143, 144107, 2015, approximate them), other spheres by
            congruence: for bodies of one sphere and free particles. It needs a wall and the wall
            rejection Overlap: without them no Context is created
        """
        super().setSphereWallMobility(
            _units.constant(mobility, SphereWallMobility, _where('setSphereWallMobility'),
                            'mobility'))

    def getLubrication(self):
        """Get whether StokesianDynamics includes lubrication."""
        return super().getLubrication()

    def setLubrication(self, enabled):
        """Set whether StokesianDynamics includes lubrication (default True). Other models have none."""
        super().setLubrication(_units.boolean(enabled, _where('setLubrication'), 'enabled'))

    def getMinimumGap(self):
        """Get the smallest gap of StokesianDynamics, in mean radii."""
        return super().getMinimumGap()

    def setMinimumGap(self, gap):
        """Set the smallest gap between spheres for StokesianDynamics, relative to the mean of their radii; default 0.

        Smaller gaps, and overlaps, are treated as this one. With 0, a start with overlapping
        spheres is refused, and a step after which spheres overlap is redone with new noise. Not
        negative, finite.
        """
        super().setMinimumGap(self._number(gap, _units.NONE, 'setMinimumGap', 'gap'))

    def getSolver(self):
        """Get how the linear algebra is done, one of the class attributes Auto, Dense, MatrixFree."""
        return Solver(super().getSolver())

    def setSolver(self, solver):
        """Set how the linear algebra is done.

        Parameters
        ----------
        solver : constant
            Auto (default): by the numbers of rows of the matrices; Dense: matrices are formed and
            decomposed, memory quadratic and time cubic in bodies; MatrixFree: Krylov methods to the
            solver tolerance, memory linear, time quadratic in particles

        Notes
        -----
        With LangevinHI the same seed gives the same step either way, to the tolerance. In schemes without momenta Dense and MatrixFree
        take different square roots of other random numbers: noise of the same law, but for the same seed other trajectories. So Auto, which
        goes by the number of rows, has other noise for a larger scene. :meth:`applyMobilityInContext` goes the same way, whatever
        masses there are; ``CustomRigidHIIntegrator.getEffects`` says which.
        """
        super().setSolver(_units.constant(solver, Solver, _where('setSolver'), 'solver'))

    def getSolverTolerance(self):
        """Get the relative tolerance of MatrixFree."""
        return super().getSolverTolerance()

    def setSolverTolerance(self, tolerance):
        """Set the relative tolerance of MatrixFree (default 1e-6), from 1e-14 to 0.1.

        LangevinHI: in the norm of mass-weighted momenta one step differs from the Dense one by at
        most five times this. Schemes without momenta: velocities that belong to forces have at most
        this error in the norm of the friction, random ones at most five times this in the norm of
        velocities over the roots of the particles' (multiblobs: bodies') own mobilities. Or an
        exception says what was reached.
        """
        super().setSolverTolerance(
            self._number(tolerance, _units.NONE, 'setSolverTolerance', 'tolerance'))

    def getGridSpacing(self):
        """Get the largest spacing of the nodes of a grid, in nm; 0: as the solver tolerance wants."""
        return _units.LENGTH.attach(super().getGridSpacing())

    def setGridSpacing(self, spacing):
        """Set the largest spacing of the nodes where a fluid is on a grid: with the boundary Periodic or SlipChannel, MatrixFree.

        The grid has the next number of nodes without prime factors above 7.

        Parameters
        ----------
        spacing : float or Quantity
            nm; 0 (default): so that products have the solver tolerance. Another spacing means, for
            ForceCoupling, another tolerance of products, which
            ``CustomRigidHIIntegrator.describeEffects`` says; for RotnePragerYamakawa, more pairs or
            fewer at the same tolerance
        """
        super().setGridSpacing(self._number(spacing, _units.LENGTH, 'setGridSpacing', 'spacing'))

    def getFastSummation(self):
        """Get whether products with the mobility of many particles may be done by multipoles."""
        return super().getFastSummation()

    def setFastSummation(self, enabled):
        """Set whether products with the mobility of many particles may be done by multipoles (default True).

        For RotnePragerYamakawa, Unbounded or NoSlipWall, MatrixFree, on all platforms but
        Reference.

        Parameters
        ----------
        enabled : bool
            True: products that a tolerance is good enough for take a time that grows little faster
            than the number of particles: answers of :meth:`applyMobilityInContext` for spheres, to
            the solver tolerance from 1e-6 on, and products of iterations whose tolerance is 5e-5 or
            more, to 1e-6. From how many particles on follows from the tolerance alone, and
            ``CustomRigidHIIntegrator.getEffects`` says it. False: all products are sums over all
            pairs
        """
        super().setFastSummation(_units.boolean(enabled, _where('setFastSummation'), 'enabled'))

    # ---- Driven flows ----------------------------------------------------------------------------

    def getBackgroundFlow(self):
        """Get the flow that :meth:`setBackgroundFlow` has set: (velocity, gradient), Quantities of shape (3,) in nm/ps and (3, 3) in 1/ps."""
        velocity, gradient = super().getBackgroundFlow()
        return _units.VELOCITY.attach(_units.array(velocity)), _units.RATE.attach(
            _units.array(gradient, 3))

    def setBackgroundFlow(self, velocity, gradient):
        """Set a flow that is there without bodies, v(x) = velocity + gradient x, x from the origin of coordinates.

        Bodies are carried and turned by it: blobs have the slip v(x), spheres v(x) and half the
        curl of v. Multiblobs resist its strain by their blobs, spheres of StokesianDynamics by
        their stresslets (lubrication of the strain is left out); spheres of other models, and
        tensors of :meth:`setBodyMobility`, do not. For schemes without momenta, and LangevinHI,
        whose friction is that of velocities relative to those with which bodies free of forces go
        with the flow.

        Parameters
        ----------
        velocity : array-like or Quantity of shape (3,)
            at the origin, nm/ps
        gradient : array-like or Quantity of shape (3, 3)
            dv_a/dx_b in row a and column b, 1/ps; its trace must be 0

        Notes
        -----
        With the boundary Unbounded, and with NoSlipWall if it is 0 at the wall; with others a Context is refused. Zeros (default): no flow.
        """
        where = _where('setBackgroundFlow')
        rows = _units.rows(gradient, _units.RATE, 3, where, 'gradient', 3)
        super().setBackgroundFlow(_units.vector(velocity, _units.VELOCITY, where, 'velocity'),
                                  rows.reshape(-1))

    def getSinusoidalForceDensity(self):
        """Get what :meth:`setSinusoidalForceDensity` has set: (f0, forceAxis, waveAxis, waveVectorIndex), f0 a Quantity in kJ/(mol nm^4)."""
        f0, forceAxis, waveAxis, waveVectorIndex = super().getSinusoidalForceDensity()
        return _units.FORCE_DENSITY.attach(f0), forceAxis, waveAxis, waveVectorIndex

    def setSinusoidalForceDensity(self, f0, forceAxis, waveAxis, waveVectorIndex):
        """Drive the fluid by a force density f0 sin(k x_waveAxis) along forceAxis, k = 2 pi waveVectorIndex/L.

        L is the edge of the Context's box along waveAxis. Without bodies the fluid flows with the
        velocity f0/(eta k^2) sin(k x_waveAxis); blobs have the slip of its average over their
        surface or Gaussian, spheres with torque that of its average curl too, and spheres of
        StokesianDynamics resist its strain by their stresslets. :meth:`getFlowModeInContext` gives
        what is left of it among bodies.

        Parameters
        ----------
        f0 : float or Quantity
            kJ/(mol nm^4); 0 (default): none
        forceAxis, waveAxis : int
            0, 1, 2 for x, y, z; not the same
        waveVectorIndex : int
            periods of the wave in the box, at least 1

        Notes
        -----
        With the boundary Periodic, and with SlipChannel if both axes are along the walls; with others a Context is refused, and so are waves that are
        not periodic in a triclinic box, or too short for the grid.
        """
        where = _where('setSinusoidalForceDensity')
        super().setSinusoidalForceDensity(_units.number(f0, _units.FORCE_DENSITY, where, 'f0'),
                                          *self._wave(where, forceAxis, waveAxis, waveVectorIndex))

    # ---- Bodies ----------------------------------------------------------------------------------

    def setBodyMobility(self, body, mobility):
        """Give a body a mobility tensor of its own, that of the body alone in unbounded fluid.

        FreeDraining takes it as it is; with RotnePragerYamakawa it is combined with the
        interactions by congruence, N = B N_RPY B^T, B = N_own^(1/2) N_RPY,alone^(-1/2): exact for
        the body alone, positive definite always. Interactions are scaled by B on both sides: give
        the particles radii whose own tensor is near the one given.

        Parameters
        ----------
        body : int
            index of the body
        mobility : array-like of shape (6, 6)
            rows Vx Vy Vz Wx Wy Wz about the body's origin, columns Fx Fy Fz Tx Ty Tz; body frame,
            OpenMM's units; symmetric to 1e-9, positive definite
        """
        where = _where('setBodyMobility')
        super().setBodyMobility(_units.integer(body, where, 'body'),
                                _units.matrix(mobility, _TENSOR, where, 'mobility'))

    def setBodyFriction(self, body, friction):
        """Give a body a tensor of its own by its inverse, the friction tensor of shape (6, 6); see setBodyMobility."""
        where = _where('setBodyFriction')
        super().setBodyFriction(_units.integer(body, where, 'body'),
                                _units.matrix(friction, _TENSOR, where, 'friction'))

    def getBodyHasOwnTensor(self, body):
        """Get whether a body has a tensor of its own."""
        return super().getBodyHasOwnTensor(self._index(body, 'getBodyHasOwnTensor', 'body'))

    def getBodyTensorIsFriction(self, body):
        """Get whether a body's own tensor was given as friction. It is an error if it has none."""
        return super().getBodyTensorIsFriction(self._index(body, 'getBodyTensorIsFriction', 'body'))

    def getBodyMobility(self, body):
        """Get a body's own mobility tensor, an array of shape (6, 6). It is an error if it has none."""
        return _units.array(super().getBodyMobility(self._index(body, 'getBodyMobility', 'body')),
                            6)

    def getBodyFriction(self, body):
        """Get a body's own friction tensor, an array of shape (6, 6). It is an error if it has none."""
        return _units.array(super().getBodyFriction(self._index(body, 'getBodyFriction', 'body')),
                            6)

    def clearBodyTensor(self, body):
        """Take a body's own tensor away."""
        super().clearBodyTensor(self._index(body, 'clearBodyTensor', 'body'))

    def getBodiesWithOwnTensors(self):
        """Get the indices of the bodies with tensors of their own, an array of int."""
        return np.frombuffer(super().getBodiesWithOwnTensors(), dtype=np.intc)

    def getGroups(self):
        """Get the group of each body, an array of int; empty: all are in one."""
        return np.frombuffer(super().getGroups(), dtype=np.intc)

    def setGroups(self, groups):
        """Set which bodies feel each other through the fluid: only those of one group.

        So replicas of a scene run in one Context, at a cost linear in their number. Hydrodynamic
        particles that are in no body belong to group 0.

        Groups are meant to be independent: without momenta, a step that one must redo (at a wall,
        for overlap) is redone for it alone, and what the others do is the same bit for bit. OpenMM
        forces between groups break that: in schemes with forces in between, these may have felt
        poses that were rejected. LangevinHI redoes a step for all groups.

        Parameters
        ----------
        groups : sequence of int
            a number from 0 up for each body, or empty: all feel each other
        """
        super().setGroups(_units.indices(groups, _where('setGroups'), 'groups'))

    # ---- In a Context ----------------------------------------------------------------------------

    def updateParametersInContext(self, context):
        """Hand changed parameters to a Context.

        These are viscosity, radii, own tensors, lubrication, minimum gap, solver, tolerance and
        flow. A radius may not change between 0 and not 0; model, boundary, wall height, sphere-wall
        mobility and groups need ``reinitialize``.
        """
        super().updateParametersInContext(
            _units.context(context, _where('updateParametersInContext')))

    def getMobilityInContext(self, context):
        """Get the mobility matrix of the bodies at their present poses.

        By dense matrices; MatrixFree iterates column by column, to its tolerance, where that takes
        less time: bodies of 850 blobs and more on the CPU platform, 3500 on Reference.
        ``CustomRigidHIIntegrator.getEffects`` says which way it goes ("mobilities asked for").

        Returns
        -------
        array of shape (6n, 6n)
            rows per body Vx Vy Vz Wx Wy Wz about the body's origin, columns Fx Fy Fz Tx Ty Tz, lab
            frame, in OpenMM's units; free particles are force-free
        """
        numbers = _units.array(super().getMobilityInContext(
            _units.context(context, _where('getMobilityInContext'))))
        return numbers.reshape(2*(int(np.sqrt(numbers.size)),))

    def getFrictionInContext(self, context):
        """Get the friction matrix of the bodies, the inverse of the mobility matrix, an array of shape (6n, 6n).

        It is the pseudo-inverse for bodies whose blobs lie on a line. Always by dense matrices.
        """
        numbers = _units.array(super().getFrictionInContext(
            _units.context(context, _where('getFrictionInContext'))))
        return numbers.reshape(2*(int(np.sqrt(numbers.size)),))

    def applyMobilityInContext(self, context, wrenches):
        """Get the velocities that forces and torques on the bodies would give without inertia.

        Dense or matrix-free as :meth:`setSolver` says; of spheres always a product, without a
        matrix: to rounding, or where :meth:`setFastSummation` has it to the solver tolerance.

        Parameters
        ----------
        context : openmm.Context
            a Context whose System has this Force
        wrenches : array-like of shape (n, 6)
            Fx Fy Fz Tx Ty Tz about each body's origin, lab frame, kJ/(mol nm) and kJ/mol

        Returns
        -------
        array of shape (n, 6)
            Vx Vy Vz Wx Wy Wz, nm/ps and rad/ps, lab frame
        """
        rows = _units.rows(wrenches, _units.NONE, 6, _where('applyMobilityInContext'), 'wrenches')
        context = _units.context(context, _where('applyMobilityInContext'))
        return _units.array(super().applyMobilityInContext(context, rows.reshape(-1)), 6)

    def applyBlobMobilityInContext(self, context, forces):
        """Get the velocities that forces on the hydrodynamic particles would give if each of them were free.

        This is the mobility of blobs, without the rigidity of bodies: blobs, spheres and free
        particles where they are at present. Spheres (one particle in a body) feel no torque, and
        their angular velocities are not given. Particles feel each other as bodies do: those of one
        group of :meth:`setGroups`, or under FreeDraining those of one body. Tensors of
        :meth:`setBodyMobility` and :meth:`setBodyFriction` belong to bodies and have no effect.
        Nothing is solved for: the cost is that of one product with the model's matrix for each
        group, whatever the solver (StokesianDynamics makes its matrix).

        Parameters
        ----------
        context : openmm.Context
            a Context whose System has this Force
        forces : array-like or Quantity of shape (particles, 3)
            one finite row for each particle of the System, kJ/(mol nm), lab frame; those on
            particles that the fluid does not see count not

        Returns
        -------
        Quantity of shape (particles, 3)
            velocities, nm/ps, lab frame; 0 for particles that the fluid does not see
        """
        rows = _units.rows(forces, _units.FORCE, 3, _where('applyBlobMobilityInContext'), 'forces')
        context = _units.context(context, _where('applyBlobMobilityInContext'))
        return _units.VELOCITY.attach(
            _units.array(super().applyBlobMobilityInContext(context, rows.reshape(-1)), 3))

    def getFlowInContext(self, context, points):
        """Get the velocities of the fluid at points: the driven flow and what the bodies make of it.

        In schemes without momenta it is the flow of the last step, at the poses where that had its
        forces (for DriftCorrectorFD, DriftCorrectorRFD and FixmanMidpoint the mid-point): driven
        flow, nu times the random flow, and the flow of the forces that kept the bodies rigid. Its
        mean has the Brownian stress, which a mean of the forces alone has not. A fluid on a grid
        has all modes of its random field in it; where the model has no random field, the random
        flow is the mean of those that fit the particles' random velocities. Before a step, or after
        poses or parameters were changed, it is the flow without noise at the present poses under
        the present forces. With LangevinHI it is that of the friction forces at the present poses
        and velocities. Within a particle it is the flow of the particle's spread forces.

        Parameters
        ----------
        context : openmm.Context
            a Context whose System has this Force
        points : array-like or Quantity of shape (m, 3)
            nm; not behind walls

        Returns
        -------
        Quantity of shape (m, 3)
            nm/ps, lab frame

        Notes
        -----
        Checkpoints and States hold what it needs of the last step. The cost is that of a step, and the work of each particle at each point, on a grid
        that of each node at each point. Several groups of :meth:`setGroups`, and FreeDraining, have no common fluid: they are refused.
        """
        where = _where('getFlowInContext')
        rows = _units.rows(points, _units.LENGTH, 3, where, 'points')
        return _units.VELOCITY.attach(
            _units.array(super().getFlowInContext(_units.context(context, where), rows), 3))

    def getFlowModeInContext(self, context, forceAxis, waveAxis, waveVectorIndex):
        """Get the amplitudes of sin(k x_waveAxis) and cos(k x_waveAxis) in the component forceAxis of the flow of :meth:`getFlowInContext`.

        k = 2 pi waveVectorIndex/L, with L the edge of the box along waveAxis. They are exact,
        without a grid: 2/(eta k^2 V) times the power of the particles' forces on such a flow.

        Parameters
        ----------
        context : openmm.Context
            a Context whose System has this Force, with the boundary Periodic, or SlipChannel and
            both axes along its walls
        forceAxis, waveAxis : int
            0, 1, 2 for x, y, z; not the same
        waveVectorIndex : int
            periods of the wave in the box, at least 1

        Returns
        -------
        Quantity of shape (2,)
            amplitudes on sin and on cos, nm/ps
        """
        where = _where('getFlowModeInContext')
        return _units.VELOCITY.attach(
            _units.array(super().getFlowModeInContext(
                _units.context(context, where),
                *self._wave(where, forceAxis, waveAxis, waveVectorIndex))))

    def getRandomFlowModeInContext(self, context, forceAxis, waveAxis, waveVectorIndex):
        """Get the same amplitudes of the random field of the last step alone, without nu: a control variate.

        That is the part of the noise that the model draws itself, on a grid; 0 where there is none.
        Its mean is 0, so a multiple of it may be subtracted from :meth:`getFlowModeInContext` to
        make the error of a mean smaller.

        Parameters
        ----------
        context, forceAxis, waveAxis, waveVectorIndex
            as there

        Returns
        -------
        Quantity of shape (2,)
            amplitudes on sin and on cos, nm/ps
        """
        where = _where('getRandomFlowModeInContext')
        return _units.VELOCITY.attach(
            _units.array(super().getRandomFlowModeInContext(
                _units.context(context, where),
                *self._wave(where, forceAxis, waveAxis, waveVectorIndex))))

    def usesPeriodicBoundaryConditions(self):
        """Get whether this Force makes the System periodic: whether the boundary is Periodic."""
        return super().usesPeriodicBoundaryConditions()

    @staticmethod
    def _wave(where, forceAxis, waveAxis, waveVectorIndex):
        return tuple(
            _units.integer(value, where, name)
            for value, name in ((forceAxis, 'forceAxis'), (waveAxis, 'waveAxis'),
                                (waveVectorIndex, 'waveVectorIndex')))

    @staticmethod
    def _index(index, method, name):
        return _units.integer(index, _where(method), name)

    @staticmethod
    def _number(value, dimension, method, name):
        return _units.number(value, dimension, _where(method), name)
