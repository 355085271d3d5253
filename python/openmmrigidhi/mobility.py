"""MobilityForce: the Python face of the C++ class, with units, checked shapes and documentation."""
from __future__ import annotations

import warnings
import weakref
from typing import TYPE_CHECKING, NamedTuple, Sequence, Union

import numpy as np
import openmm

from . import _bindings, _copies, _enums, _models, _units
from ._models import Boundary, Model
from ._positionforces import external_forces
from ._types import Array, Number, Numbers

if TYPE_CHECKING:
    from openmm import unit
    import numpy.typing as npt

_Base = _bindings.MobilityForce
_TENSOR = (6, 6)


class SphereWallMobility(_enums.Documented):
    """The mobility of a single sphere above a wall; also class attributes of MobilityForce."""

    FromModel = _Base.FromModel, (
        'The sphere moves as the model says, which has no lubrication (default).')
    BestKnown = _Base.BestKnown, (
        'The sphere moves like a rigid sphere alone above the wall, at every gap, to 3e-8.')


class Lubrication(_enums.Documented):
    """Whether spheres have lubrication; also class attributes of MobilityForce.

    ``MobilityForce.Auto`` and 'Auto' stand for AutoLubrication, too.
    """

    AutoLubrication = _Base.AutoLubrication, (
        'Spheres of StokesianDynamics have lubrication, and those of other models have none '
        '(default).')
    On = _Base.On, 'Spheres have lubrication with each other, and with no-slip walls.'
    Off = _Base.Off, 'No sphere has lubrication.'


class ChannelCondition(_enums.Documented):
    """The mean flow along a NoSlipChannel; also class attributes of MobilityForce."""

    ZeroPressureGradient = _Base.ZeroPressureGradient, (
        'The mean pressure gradient is 0 (default), as in a long channel with open ends. Forces '
        'along the walls drive fluid through the box.')
    ZeroFlux = _Base.ZeroFlux, (
        'The flux through the box is 0, as in a channel with closed ends. The mean pressure '
        'gradient balances the forces.')


class Solver(_enums.Documented):
    """How the solver does the linear algebra; also class attributes of MobilityForce."""

    Auto = _Base.Auto, (
        'Dense or matrix-free (default), by the numbers of rows of the matrices. Periodic fluids '
        'of more than 150 rows are done in the way whose step is estimated to take less time, and '
        'those of fewer rows by matrices unless these are five times slower.')
    Dense = _Base.Dense, 'Matrices are formed and decomposed.'
    MatrixFree = _Base.MatrixFree, (
        'Krylov methods, or a grid, compute products and solutions to the solver tolerance.')


class Stress(NamedTuple):
    """The stress that bodies add to a periodic fluid (:meth:`MobilityForce.getStressInContext`).

    Each part is a Quantity of shape (3, 3) in kJ/(mol nm^3), and symmetric.
    """

    #: of the resistance of force-free bodies to the driven flow, and of swimmers
    hydrodynamic: unit.Quantity
    #: one sample, whose mean is the Brownian stress
    brownian: unit.Quantity
    #: of OpenMM's forces and torques: their virial, and the stresslets that they cause
    interparticle: unit.Quantity
    #: :math:`-n\,kT`, with the number density n of bodies and free particles
    ideal: unit.Quantity


# The class has attributes of the same names, which its annotations would mean.
_Model = Model
_Boundary = Boundary
_SphereWallMobility = SphereWallMobility
_ChannelCondition = ChannelCondition
_Lubrication = Lubrication
_Solver = Solver


def _where(method):
    return 'MobilityForce.' + method


class MobilityForce(_copies.Copies, _Base):
    """The fluid that couples the bodies of a CustomRigidHIIntegrator.

    It has the viscosity, the hydrodynamic radii of the particles and the hydrodynamic model. It
    adds no forces and no energy; the schemes with hydrodynamic interactions read it. Add one
    MobilityForce to the System with ``system.addForce``. Give every particle of the System a
    hydrodynamic radius, in order, by :meth:`addParticle`.

    A body with one hydrodynamic particle is a sphere, which takes force and torque. A body with
    several particles is a rigid multiblob; its blobs carry forces only. Its mobility is
    :math:`N = (K^T M^{-1} K)^{-1}`. M is the mobility of the blobs, and K maps the velocities of
    the body to the velocities of its blobs. If all blobs of a body lie on a line, the fluid does
    not resist rotation about this line, and a torque about the line beyond rounding is an error. A
    particle in no body that has a radius takes a force only.

    :meth:`setModel` chooses how the fluid couples particles. The models are @models@.
    :meth:`setBoundary` chooses what bounds the fluid. The boundaries are @boundaries@.
    ``help(MobilityForce.Model)`` and ``help(MobilityForce.Boundary)`` describe them.
    docs/models/README.md says which model to take for which scene. Each model has a page there with
    its equations, its accuracy, its cost, and the requirements and effects of each boundary.

    You may give a constant by its name, as in ``setModel('StokesianDynamics')``. A wrong type
    raises TypeError, and a wrong shape or an unknown name ValueError. Any other error raises
    openmm.OpenMMException. Each message names the object, the value, the bound and the remedy.

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
    ChannelCondition = ChannelCondition
    Lubrication = Lubrication
    Solver = Solver
    FromModel = SphereWallMobility.FromModel
    BestKnown = SphereWallMobility.BestKnown
    ZeroPressureGradient = ChannelCondition.ZeroPressureGradient
    ZeroFlux = ChannelCondition.ZeroFlux
    AutoLubrication = Lubrication.AutoLubrication
    On = Lubrication.On
    Off = Lubrication.Off
    Auto = Solver.Auto
    Dense = Solver.Dense
    MatrixFree = Solver.MatrixFree

    _base = _Base
    _generic = openmm.Force

    def __init__(self) -> None:
        # Type checkers take an inherited constructor for one of the base class.
        super().__init__()

    def __repr__(self):
        return (f'<MobilityForce: {self.getModel().name}, {self.getBoundary().name}, viscosity '
                f'{self.getViscosity()}, {self.getNumParticles()} particles>')

    @staticmethod
    def cast(obj: openmm.Force) -> MobilityForce:
        """Get a MobilityForce from a generic openmm.Force.

        ``system.getForce`` and deserialisation return the generic class.

        Parameters
        ----------
        obj : openmm.Force
            the object; if it owned the C++ object, the result owns the C++ object from now on, and
            obj remains usable

        Returns
        -------
        MobilityForce
            obj itself if it is one already

        Raises
        ------
        TypeError
            if obj is anything else
        """
        return MobilityForce._cast_generic(obj)

    # ---- Particles and fluid ---------------------------------------------------------------------

    def getNumParticles(self) -> int:
        """Get the number of particles."""
        return super().getNumParticles()

    def addParticle(self, radius: Number) -> int:
        """Add the next particle of the System.

        Parameters
        ----------
        radius : float or Quantity
            hydrodynamic radius, nm; not negative, finite; a particle with 0 does not interact with
            the fluid

        Returns
        -------
        int
            index of the particle
        """
        return super().addParticle(self._number(radius, _units.LENGTH, 'addParticle', 'radius'))

    def getParticleRadius(self, index: int) -> unit.Quantity:
        """Get the hydrodynamic radius of a particle, a Quantity in nm."""
        return _units.LENGTH.attach(super().getParticleRadius(
            self._index(index, 'getParticleRadius', 'index')))

    def setParticleRadius(self, index: int, radius: Number) -> None:
        """Set the hydrodynamic radius of a particle.

        :meth:`updateParametersInContext` copies it to a Context.

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

    def getViscosity(self) -> unit.Quantity:
        """Get the viscosity, a Quantity in dalton/(nm ps)."""
        return _units.VISCOSITY.attach(super().getViscosity())

    def setViscosity(self, eta: Number) -> None:
        """Set the viscosity; default: water at 298.15 K, 0.89 mPa s.

        Parameters
        ----------
        eta : float or Quantity
            dalton/(nm ps), or a quantity such as ``0.89e-3*unit.pascal*unit.second``; positive,
            finite
        """
        super().setViscosity(_units.viscosity(eta, _where('setViscosity'), 'eta'))

    def getModel(self) -> _Model:
        """Get the model (FreeDraining, RotnePragerYamakawa, StokesianDynamics or ForceCoupling)."""
        return Model(super().getModel())

    def setModel(self, model: Union[_Model, str, int]) -> None:
        """Set the model (default RotnePragerYamakawa), one of the class attributes or its name.

        The model takes effect at Context creation.
        """
        super().setModel(_units.constant(model, Model, _where('setModel'), 'model'))

    def getBoundary(self) -> _Boundary:
        """Get the boundary of the fluid, a constant of Boundary such as Unbounded."""
        return Boundary(super().getBoundary())

    def setBoundary(self, boundary: Union[_Boundary, str, int]) -> None:
        """Set the boundary of the fluid.

        The boundary takes effect at Context creation.

        Parameters
        ----------
        boundary : constant or str
            Unbounded (default). NoSlipWall: fluid above the plane z = :meth:`setWallHeight`, with
            the model RotnePragerYamakawa. Periodic: the Context's periodic box, with all models
            (under FreeDraining nothing changes compared with Unbounded). SlipChannel: fluid between
            two slip walls (:meth:`setChannelWalls`), with ForceCoupling. PeriodicWall: fluid above
            the plane z = :meth:`setWallHeight`, periodic in x and y, with RotnePragerYamakawa and
            ForceCoupling. NoSlipChannel: fluid between two walls z = const
            (:meth:`setChannelWalls`, :meth:`setChannelCondition`), periodic in x and y, with the
            same models. Film: fluid between a wall and a flat free surface, with ForceCoupling. The
            third vector of the box is not a period of the last three fluids.
        """
        super().setBoundary(_units.constant(boundary, Boundary, _where('setBoundary'), 'boundary'))

    def getWallHeight(self) -> unit.Quantity:
        """Get the z of the NoSlipWall or PeriodicWall, a Quantity in nm."""
        return _units.LENGTH.attach(super().getWallHeight())

    def setWallHeight(self, height: Number) -> None:
        """Set the z of the NoSlipWall or PeriodicWall; other boundaries ignore it.

        The height takes effect at Context creation.

        Parameters
        ----------
        height : float or Quantity
            nm; finite; default 0
        """
        super().setWallHeight(self._number(height, _units.LENGTH, 'setWallHeight', 'height'))

    def getChannelWalls(self) -> tuple[unit.Quantity, unit.Quantity]:
        """Get the walls of a SlipChannel, NoSlipChannel or Film, (low, high), Quantities in nm."""
        low, high = super().getChannelWalls()
        return _units.LENGTH.attach(low), _units.LENGTH.attach(high)

    def setChannelWalls(self, low: Number, high: Number) -> None:
        """Set the walls of a SlipChannel, NoSlipChannel or Film; other boundaries ignore them.

        They are the y of both walls of a SlipChannel, the z of both walls of a NoSlipChannel, or
        the z of the wall and of the free surface of a Film.

        The walls take effect at Context creation.

        Parameters
        ----------
        low, high : float or Quantity
            nm; finite, the first below the second. The default, 0 and 0, means no channel; a
            boundary with such walls is then an error at Context creation.
        """
        super().setChannelWalls(self._number(low, _units.LENGTH, 'setChannelWalls', 'low'),
                                self._number(high, _units.LENGTH, 'setChannelWalls', 'high'))

    def getChannelCondition(self) -> _ChannelCondition:
        """Get the condition on the mean flow of a channel (ZeroPressureGradient or ZeroFlux)."""
        return ChannelCondition(super().getChannelCondition())

    def setChannelCondition(self, condition: Union[_ChannelCondition, str, int]) -> None:
        """Set what drives or stops the mean flow along a NoSlipChannel.

        The setting takes effect at Context creation. Other boundaries ignore it.

        Parameters
        ----------
        condition : constant or str
            ZeroPressureGradient (default): the mean pressure gradient is 0, as in a long channel
            with open ends, and forces along the walls drive fluid through the box. ZeroFlux: the
            flux through the box is 0, as in a channel with closed ends.
        """
        super().setChannelCondition(
            _units.constant(condition, ChannelCondition, _where('setChannelCondition'),
                            'condition'))

    def getSphereWallMobility(self) -> _SphereWallMobility:
        """Get how a single sphere above a wall moves (FromModel or BestKnown)."""
        return SphereWallMobility(super().getSphereWallMobility())

    def setSphereWallMobility(self, mobility: Union[_SphereWallMobility, str, int]) -> None:
        """Set how a single sphere above a NoSlipWall or PeriodicWall moves.

        The setting takes effect at Context creation.

        Parameters
        ----------
        mobility : constant or str
            FromModel (default): the mobility of the model, without lubrication. At contact a
            quarter of the free mobility towards the wall remains. BestKnown: the mobility of a
            single rigid sphere above the wall, at every gap, to 3e-8.

        Notes
        -----
        BestKnown uses the exact solutions: along the wall Dean, O'Neill, 1963, and O'Neill, 1964,
        towards it Brenner, 1961, about the normal Jeffery, 1915. Eqs. 94 to 97 of Delong et al., J.
        Chem. Phys. 143, 144107, 2015, approximate them. A congruence combines the exact mobility
        with the interactions of other spheres. BestKnown is for bodies of one sphere and free
        particles. It needs the model RotnePragerYamakawa, a NoSlipWall or PeriodicWall, and the
        wall rejection Overlap; otherwise Context creation fails.
        """
        super().setSphereWallMobility(
            _units.constant(mobility, SphereWallMobility, _where('setSphereWallMobility'),
                            'mobility'))

    def getLubrication(self) -> _Lubrication:
        """Get whether spheres have lubrication (AutoLubrication, which equals Auto, On or Off)."""
        return Lubrication(super().getLubrication())

    def setLubrication(self, lubrication: Union[_Lubrication, _Solver, str, bool]) -> None:
        """Set whether spheres that are close to each other, or to a no-slip wall, have lubrication.

        Spheres are bodies of one hydrodynamic particle. Multiblobs and free particles have no
        lubrication. ``CustomRigidHIIntegrator.describeEffects`` says which spheres have it.

        Parameters
        ----------
        lubrication : constant, str or bool
            Auto (default): on with StokesianDynamics, off with other models. On or True: also with
            RotnePragerYamakawa and ForceCoupling. Off or False: no sphere has it.

        Notes
        -----
        With RotnePragerYamakawa and ForceCoupling the friction is the friction of the model plus a
        correction for each pair of spheres, and for each sphere and wall: the friction that the
        model lacks for this pair alone. So it is exact for two spheres, and for one sphere above a
        wall. The models' pages state the accuracy. Spheres must not overlap each other
        (:meth:`setMinimumGap`) or touch walls, and the ratios of their radii are up to 10. Context
        creation fails with sphere-wall mobility BestKnown, which this lubrication replaces, and
        with the wall rejection Crossing.
        """
        if isinstance(lubrication, (bool, np.bool_)):
            lubrication = Lubrication.On if lubrication else Lubrication.Off
        elif lubrication is Solver.Auto or lubrication == 'Auto':
            lubrication = Lubrication.AutoLubrication
        elif not isinstance(lubrication, (Lubrication, str)):  # 0 and 1 may mean truth values
            raise TypeError(
                f'{_where("setLubrication")}: lubrication: got {lubrication!r}; it must '
                'be Auto, On, Off, True or False: give one of them')
        super().setLubrication(
            _units.constant(lubrication, Lubrication, _where('setLubrication'), 'lubrication'))

    def getLubricationReach(self) -> tuple[float, float]:
        """Get how far lubrication of pairs reaches, in mean radii; (0, 0): as the model says."""
        whole, nothing = super().getLubricationReach()
        return whole, nothing

    def setLubricationReach(self, whole: Number, nothing: Number) -> None:
        """Set how far lubrication of pairs reaches.

        Lubrication at walls acts fully at every height.

        Parameters
        ----------
        whole : float
            the distance of the centres, in mean radii of the pair, up to which lubrication acts
            fully; at least 2, the contact
        nothing : float
            the distance from which on lubrication vanishes, above the other one. 0 for both
            (default): 3 and 4, but with matrices of StokesianDynamics 8 and 10 in a periodic box,
            and all distances without a box.
        """
        super().setLubricationReach(
            self._number(whole, _units.NONE, 'setLubricationReach', 'whole'),
            self._number(nothing, _units.NONE, 'setLubricationReach', 'nothing'))

    def getMinimumGap(self) -> float:
        """Get the smallest gap of spheres with lubrication, in mean radii."""
        return super().getMinimumGap()

    def setMinimumGap(self, gap: Number) -> None:
        """Set the smallest gap between spheres with lubrication; default 0.

        The gap is relative to the mean radius of the two spheres. It is finite and not negative.
        Smaller gaps, and overlaps, count as this gap. With 0, a start with overlapping spheres is
        an error, and the scheme redoes a step after which spheres overlap, with new noise. The
        setting also applies to spheres of StokesianDynamics without lubrication.
        """
        super().setMinimumGap(self._number(gap, _units.NONE, 'setMinimumGap', 'gap'))

    def getSolver(self) -> _Solver:
        """Get how the solver does the linear algebra (Auto, Dense or MatrixFree)."""
        return Solver(super().getSolver())

    def setSolver(self, solver: Union[_Solver, str, int]) -> None:
        """Set how the solver does the linear algebra.

        Parameters
        ----------
        solver : constant or str
            Auto (default): Dense or MatrixFree, by the numbers of rows of the matrices, and in
            periodic fluids by an estimate of the time of a step, never by measured times. Dense:
            the solver forms and decomposes matrices; memory is quadratic and time cubic in bodies.
            MatrixFree: Krylov methods to the solver tolerance; memory is linear in particles, and
            time quadratic, or less by multipoles or on a grid.

        Notes
        -----
        With LangevinHI the same seed gives the same step with Dense and with MatrixFree, to the
        tolerance. In schemes without momenta Dense and MatrixFree take different square roots of
        the mobility, and different random numbers. The law of the noise is the same, but the same
        seed gives other trajectories. For another scene, scheme or tolerance Auto may choose the
        other way, and the noise then differs.

        :meth:`applyMobilityInContext` uses the same way, for any masses.
        ``CustomRigidHIIntegrator.getEffects`` names this way.
        """
        super().setSolver(_units.constant(solver, Solver, _where('setSolver'), 'solver'))

    def getSolverTolerance(self) -> float:
        """Get the relative tolerance of MatrixFree."""
        return super().getSolverTolerance()

    def setSolverTolerance(self, tolerance: Number) -> None:
        """Set the relative tolerance of MatrixFree (default 1e-6), from 1e-14 to 0.1.

        With LangevinHI, friction and noise of a step differ from the Dense ones by at most five
        times the tolerance, in the norm of mass-weighted momenta. Velocities from forces, also the
        velocities of applyMobilityInContext() with multiblobs, have an error of at most the
        tolerance, in the norm of the friction. This error is an estimate, and it may be larger if
        bodies nearly coincide. In schemes without momenta, the random velocities have an error of
        at most five times the tolerance. Its norm uses velocities divided by the square roots of
        the self-mobilities of the particles (of multiblobs: of the bodies). If an iteration does
        not reach the tolerance, an exception states the error.
        """
        super().setSolverTolerance(
            self._number(tolerance, _units.NONE, 'setSolverTolerance', 'tolerance'))

    def getGridSpacing(self) -> unit.Quantity:
        """Get the largest spacing of the nodes of a grid, in nm; 0: the tolerance sets it."""
        return _units.LENGTH.attach(super().getGridSpacing())

    def setGridSpacing(self, spacing: Number) -> None:
        """Set the largest spacing of the nodes of a grid.

        A periodic fluid (each boundary except Unbounded and NoSlipWall) is on a grid with
        MatrixFree, except under FreeDraining. The grid has the next larger number of nodes without
        prime factors above 7.

        Parameters
        ----------
        spacing : float or Quantity
            nm; 0 (default): the spacing at which products have the solver tolerance. With
            ForceCoupling another spacing means another tolerance of products, stated by
            ``CustomRigidHIIntegrator.describeEffects``. With RotnePragerYamakawa it means more or
            fewer pairs at the same tolerance.
        """
        super().setGridSpacing(self._number(spacing, _units.LENGTH, 'setGridSpacing', 'spacing'))

    def getFastSummation(self) -> bool:
        """Get whether multipoles may compute products of many particles with the mobility."""
        return super().getFastSummation()

    def setFastSummation(self, enabled: bool) -> None:
        """Set whether multipoles may compute products of many particles with the mobility.

        Multipoles (default True) are for RotnePragerYamakawa with the boundary Unbounded or
        NoSlipWall and MatrixFree, on all platforms except Reference.

        Parameters
        ----------
        enabled : bool
            True: products for which a tolerance is good enough take a time that grows little faster
            than the number of particles. Three kinds of products use multipoles, at tolerances of
            1e-6 and more: the answers of :meth:`applyMobilityInContext` for spheres, to the solver
            tolerance; products of iterations, to a part of their tolerance, unless a scheme takes
            differences of the results; and products of which a scheme takes differences. The
            tolerance alone determines the number of particles from which on multipoles are used;
            ``CustomRigidHIIntegrator.getEffects`` states it. False: all products are sums over all
            pairs.
        """
        super().setFastSummation(_units.boolean(enabled, _where('setFastSummation'), 'enabled'))

    # ---- Driven flows ----------------------------------------------------------------------------

    def getBackgroundFlow(self) -> tuple[unit.Quantity, unit.Quantity]:
        """Get the flow that :meth:`setBackgroundFlow` has set, as (velocity, gradient).

        Both are Quantities: velocity has the shape (3,) in nm/ps, gradient (3, 3) in 1/ps.
        """
        velocity, gradient = super().getBackgroundFlow()
        return _units.VELOCITY.attach(_units.array(velocity)), _units.RATE.attach(
            _units.array(gradient, 3))

    def setBackgroundFlow(self, velocity: Numbers, gradient: Numbers) -> None:
        r"""Set a flow that exists without bodies, :math:`v(x) = v_0 + G x`.

        Here :math:`v_0` is velocity and G is gradient, and x counts from the origin of coordinates.
        The flow carries and turns bodies. Blobs have the slip v(x), spheres v(x) and half the curl
        of v. Multiblobs resist the strain of the flow by their blobs. Spheres of StokesianDynamics
        resist it by their stresslets, with lubrication of the strain. Spheres of other models, and
        tensors of :meth:`setBodyMobility`, do not resist it.

        The flow is for schemes without momenta and for LangevinHI. The friction of LangevinHI acts
        on velocities relative to the velocities of force-free bodies in the flow.

        Parameters
        ----------
        velocity : array-like or Quantity of shape (3,)
            at the origin, nm/ps
        gradient : array-like or Quantity of shape (3, 3)
            :math:`\partial v_a/\partial x_b` in row a and column b, 1/ps; its trace must be 0

        Notes
        -----
        The boundary must be Unbounded, or NoSlipWall or PeriodicWall if the flow is 0 at the wall.
        Other boundaries are an error at Context creation. The default is zeros: no flow.
        """
        where = _where('setBackgroundFlow')
        rows = _units.rows(gradient, _units.RATE, 3, where, 'gradient', 3)
        super().setBackgroundFlow(_units.vector(velocity, _units.VELOCITY, where, 'velocity'),
                                  rows.reshape(-1))

    def getSinusoidalForceDensity(self) -> tuple[unit.Quantity, int, int, int]:
        """Get the settings of :meth:`setSinusoidalForceDensity`.

        It is the tuple (f0, forceAxis, waveAxis, waveVectorIndex), with f0 a Quantity in
        kJ/(mol nm^4).
        """
        f0, forceAxis, waveAxis, waveVectorIndex = super().getSinusoidalForceDensity()
        return _units.FORCE_DENSITY.attach(f0), forceAxis, waveAxis, waveVectorIndex

    def setSinusoidalForceDensity(self, f0: Number, forceAxis: int, waveAxis: int,
                                  waveVectorIndex: int) -> None:
        r"""Drive the fluid by a force density :math:`f_0 \sin(k x)` along forceAxis.

        Here x is the coordinate along waveAxis, and :math:`k = 2 \pi n/L`, where n is
        waveVectorIndex and L the edge of the Context's box along waveAxis. Without bodies the fluid
        flows with the velocity :math:`f_0/(\eta k^2) \sin(k x)`. The slip of a blob is the average
        of this flow over its surface or Gaussian. Spheres with torque also have a slip by the
        average curl. Spheres of StokesianDynamics resist the strain by their stresslets.
        :meth:`getFlowModeInContext` gives the flow that remains among bodies.

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
        The boundary must be periodic, and both axes must be along its walls; otherwise Context
        creation fails. It also fails for waves that are not periodic in a triclinic box, or too
        short for the grid.

        Above a no-slip wall, in a NoSlipChannel and in a Film the flow is
        :math:`f_0/(\eta k^2) (1 - p) \sin(k x)`, where p depends on z and is 1 on a wall:
        :math:`\exp(-k s)`, :math:`\cosh(k (s - H/2))/\cosh(k H/2)` and
        :math:`\cosh(k (H - s))/\cosh(k H)`, with the distance s from the lower wall and the height
        H of the fluid.
        """
        where = _where('setSinusoidalForceDensity')
        super().setSinusoidalForceDensity(_units.number(f0, _units.FORCE_DENSITY, where, 'f0'),
                                          *self._wave(where, forceAxis, waveAxis, waveVectorIndex))

    def getWallVelocity(self) -> unit.Quantity:
        """Get the velocity of the upper wall of a NoSlipChannel, a Quantity of shape (3,) in nm/ps.
        """
        return _units.VELOCITY.attach(_units.array(super().getWallVelocity()))

    def setWallVelocity(self, velocity: Numbers) -> None:
        r"""Let the upper wall of a NoSlipChannel move along itself, which shears the fluid.

        The lower wall is at rest. Without bodies the fluid has Couette's flow,
        :math:`U (z - z_\mathrm{low})/H` with the height H of the channel. With the condition
        ZeroFlux the channel is closed at its ends, and the pressure makes the flux 0: the flow is
        :math:`U (3 s^2 - 2 s)` with :math:`s = (z - z_\mathrm{low})/H`. Bodies follow the flow as
        in :meth:`setBackgroundFlow`.

        Parameters
        ----------
        velocity : array-like or Quantity of shape (3,)
            nm/ps, z must be 0; zeros (default): the wall is at rest

        Notes
        -----
        With other boundaries a velocity other than 0 is an error at Context creation.
        """
        where = _where('setWallVelocity')
        super().setWallVelocity(_units.vector(velocity, _units.VELOCITY, where, 'velocity'))

    def getBodyForceDensity(self) -> unit.Quantity:
        """Get the uniform force density on the fluid, a Quantity of shape (3,) in kJ/(mol nm^4)."""
        return _units.FORCE_DENSITY.attach(_units.array(super().getBodyForceDensity()))

    def setBodyForceDensity(self, forceDensity: Numbers) -> None:
        r"""Drive the fluid along its walls by a uniform force density f.

        The force density acts like a pressure gradient -f. Without bodies the fluid has
        Poiseuille's flow. This is :math:`f (z - z_\mathrm{low}) (z_\mathrm{high} - z)/(2 \eta)` in
        a NoSlipChannel, and
        :math:`f (z - z_\mathrm{low}) (2 z_\mathrm{high} - z_\mathrm{low} - z)/(2 \eta)` in a Film.
        Bodies follow the flow as in :meth:`setBackgroundFlow`, and the force density exerts no
        other force on them. :meth:`getMeanFlowInContext` gives the mean flow that remains among
        bodies.

        Parameters
        ----------
        forceDensity : array-like or Quantity of shape (3,)
            kJ/(mol nm^4), z must be 0; zeros (default): none

        Notes
        -----
        The boundary must be NoSlipChannel with the condition ZeroPressureGradient, or Film. Other
        boundaries are an error at Context creation: with ZeroFlux the pressure balances the force
        density, and above a PeriodicWall no flow is steady.
        """
        where = _where('setBodyForceDensity')
        super().setBodyForceDensity(
            _units.vector(forceDensity, _units.FORCE_DENSITY, where, 'forceDensity'))

    def getShear(self) -> tuple[unit.Quantity, int, int]:
        """Get the settings of :meth:`setShear`, as (rate, flowAxis, gradientAxis).

        The rate is a Quantity in 1/ps.
        """
        rate, flowAxis, gradientAxis = super().getShear()
        return _units.RATE.attach(rate), flowAxis, gradientAxis

    def setShear(self, rate: Number, flowAxis: int, gradientAxis: int) -> None:
        r"""Shear a periodic fluid steadily, with the boundary conditions of Lees and Edwards.

        Without bodies the fluid flows along flowAxis with the velocity :math:`g x`, where g is the
        rate and x the coordinate along gradientAxis. The box tilts with the flow: steps set the
        Context's box, and forces are computed in the box at their time. The tilt starts from the
        tilt of the Context's box. Where a tilt exceeds half an edge, the box continues with the
        other tilt of the same lattice, so positions, which are not wrapped, and forces stay the
        same. States and checkpoints hold the box, and with it the strain. If
        :meth:`updateParametersInContext` changes the rate, the shear continues from the present
        tilt.

        Bodies follow the flow as in :meth:`setBackgroundFlow`. The velocity gradient is the mean
        gradient of the fluid with its bodies. The relative viscosity is therefore
        :math:`1 + s/(\eta g)`, with the stress s of :meth:`getStressInContext`.

        Parameters
        ----------
        rate : float or Quantity
            1/ps; 0 (default): none
        flowAxis, gradientAxis : int
            (0, 1), (0, 2) or (1, 2), for x, y and z, since OpenMM's boxes are lower triangular

        Notes
        -----
        Context creation fails with boundaries other than Periodic, with the model FreeDraining,
        with schemes that have momenta, with barostats, with a sinusoidal force density in addition
        to the shear, and on platforms other than Reference and CPU. A step is an error if it
        strains the fluid by more than 0.1, or if you have set the box, but no positions, since the
        last step. :meth:`getFlowInContext` gives the flow of the present forces, without noise,
        because the stages of a sheared step are in different boxes. In the two boxes of one lattice
        OpenMM's PME agrees only to its tolerance, so its forces jump there by its error.
        """
        where = _where('setShear')
        super().setShear(_units.number(rate, _units.RATE, where, 'rate'),
                         _units.integer(flowAxis, where, 'flowAxis'),
                         _units.integer(gradientAxis, where, 'gradientAxis'))

    # ---- Bodies ----------------------------------------------------------------------------------

    def setBodyMobility(self, body: int, mobility: npt.ArrayLike) -> None:
        r"""Give a body its own mobility tensor, the tensor of the body alone in unbounded fluid.

        FreeDraining uses the tensor unchanged. RotnePragerYamakawa combines it with the
        interactions by congruence: :math:`N = B N_\mathrm{RPY} B^T` with
        :math:`B = N_\mathrm{own}^{1/2} N_\mathrm{RPY,alone}^{-1/2}`. The result is exact for a
        single body, and always positive definite. B scales the interactions on both sides, so
        choose the particles' radii such that their tensor is near the own tensor. StokesianDynamics
        takes no such tensors, and lubrication takes none for single spheres.

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

    def setBodyFriction(self, body: int, friction: npt.ArrayLike) -> None:
        """Give a body its own friction tensor of shape (6, 6), the inverse of its mobility tensor.

        :meth:`setBodyMobility` explains the use of the tensor; friction is in the same frame.
        """
        where = _where('setBodyFriction')
        super().setBodyFriction(_units.integer(body, where, 'body'),
                                _units.matrix(friction, _TENSOR, where, 'friction'))

    def getBodyHasOwnTensor(self, body: int) -> bool:
        """Get whether a body has its own tensor."""
        return super().getBodyHasOwnTensor(self._index(body, 'getBodyHasOwnTensor', 'body'))

    def getBodyTensorIsFriction(self, body: int) -> bool:
        """Get whether a body's own tensor was set as friction; an error if the body has none."""
        return super().getBodyTensorIsFriction(self._index(body, 'getBodyTensorIsFriction', 'body'))

    def getBodyMobility(self, body: int) -> Array:
        """Get a body's own mobility tensor of shape (6, 6); an error if the body has none."""
        return _units.array(super().getBodyMobility(self._index(body, 'getBodyMobility', 'body')),
                            6)

    def getBodyFriction(self, body: int) -> Array:
        """Get a body's own friction tensor of shape (6, 6); an error if the body has none."""
        return _units.array(super().getBodyFriction(self._index(body, 'getBodyFriction', 'body')),
                            6)

    def clearBodyTensor(self, body: int) -> None:
        """Remove a body's own tensor."""
        super().clearBodyTensor(self._index(body, 'clearBodyTensor', 'body'))

    def getBodiesWithOwnTensors(self) -> Array:
        """Get the indices of the bodies with own tensors, an array of int."""
        return np.frombuffer(super().getBodiesWithOwnTensors(), dtype=np.intc)

    def setBodySlip(self, body: int, velocities: npt.ArrayLike) -> None:
        """Give the surface of a multiblob a slip, as for a swimmer.

        At each blob the fluid moves with the body plus the velocity of the blob's slip. The body is
        nevertheless free of forces and torques; the slip moves the body and the fluid. The
        velocities turn with the body. They enter a step like a driven flow: they cause no drift and
        no noise. Slips act in schemes without momenta; with other schemes Context creation fails.
        It also fails for a wrong number of velocities, and for the slip of a body of one particle,
        because the models have no stresslet sources for a single sphere.

        The velocities at blobs are not the velocities at a smooth surface. A shell of 12 to 642
        blobs with the velocities of a squirmer swims 73 to 11 % too fast. :func:`app.squirmerSlip`
        scales the modes of a squirmer by the response of the given shell.

        Parameters
        ----------
        body : int
            index of the body
        velocities : array-like of shape (n, 3) or Quantity
            of the surface relative to the body, at each hydrodynamic particle of the body in the
            order of its particles with a radius, nm/ps, body frame; finite
        """
        where = _where('setBodySlip')
        super().setBodySlip(_units.integer(body, where, 'body'),
                            _units.rows(velocities, _units.VELOCITY, 3, where, 'velocities'))

    def getBodySlip(self, body: int) -> unit.Quantity:
        """Get the slip velocities of a body, a Quantity of shape (n, 3) in nm/ps, body frame.

        It is an error if the body has no slip.
        """
        return _units.VELOCITY.attach(
            _units.array(super().getBodySlip(self._index(body, 'getBodySlip', 'body')), 3))

    def clearBodySlip(self, body: int) -> None:
        """Remove a body's slip."""
        super().clearBodySlip(self._index(body, 'clearBodySlip', 'body'))

    def getBodiesWithSlip(self) -> Array:
        """Get the indices of the bodies with a slip, an array of int."""
        return np.frombuffer(super().getBodiesWithSlip(), dtype=np.intc)

    def addBodyForceOnFluid(self, body: int, site: npt.ArrayLike, radius: Number,
                            force: npt.ArrayLike) -> int:
        """Let a body exert a force on the fluid at a site that moves with the body.

        The flagella of a swimmer do so. The body takes the opposite force at the site, so body and
        site together are free of forces and torques. Force and site turn with the body. They cause
        no drift and no noise. (Forces between the blobs of a body would have no effect, because the
        body is rigid.)

        For the fluid the site is a separate particle that nothing holds and that resists nothing.
        It may be anywhere in the fluid. These forces act in schemes without momenta. Context
        creation fails with other schemes, and with StokesianDynamics, in which such a particle
        would have lubrication.

        Parameters
        ----------
        body : int
            index of the body
        site : array-like of shape (3,) or Quantity
            body frame, nm; finite
        radius : float or Quantity
            of the particle that exerts the force, nm; positive, finite
        force : array-like of shape (3,) or Quantity
            on the fluid, body frame, kJ/(mol nm); finite

        Returns
        -------
        int
            index of the force
        """
        return super().addBodyForceOnFluid(
            *self._force_on_fluid('addBodyForceOnFluid', body, site, radius, force))

    def getNumBodyForcesOnFluid(self) -> int:
        """Get the number of forces of bodies on the fluid."""
        return super().getNumBodyForcesOnFluid()

    def getBodyForceOnFluidParameters(
            self, index: int) -> tuple[int, unit.Quantity, unit.Quantity, unit.Quantity]:
        """Get a force on the fluid: (body, site, radius, force), Quantities except for the body.

        Site and radius are in nm, the force in kJ/(mol nm); site and force are in the body frame.
        """
        body, site, radius, force = super().getBodyForceOnFluidParameters(
            self._index(index, 'getBodyForceOnFluidParameters', 'index'))
        return (body, _units.LENGTH.attach(_units.array(site)), _units.LENGTH.attach(radius),
                _units.FORCE.attach(_units.array(force)))

    def setBodyForceOnFluidParameters(self, index: int, body: int, site: npt.ArrayLike,
                                      radius: Number, force: npt.ArrayLike) -> None:
        """Set a force on the fluid; a force of 0 switches it off.

        :meth:`updateParametersInContext` copies it to a Context.

        Parameters
        ----------
        index : int
            index of the force
        body, site, radius, force
            as in :meth:`addBodyForceOnFluid`
        """
        super().setBodyForceOnFluidParameters(
            self._index(index, 'setBodyForceOnFluidParameters', 'index'),
            *self._force_on_fluid('setBodyForceOnFluidParameters', body, site, radius, force))

    def _force_on_fluid(self, method, body, site, radius, force):
        where = _where(method)
        return (_units.integer(body, where,
                               'body'), _units.vector(site, _units.LENGTH, where, 'site'),
                self._number(radius, _units.LENGTH, method,
                             'radius'), _units.vector(force, _units.FORCE, where, 'force'))

    def getGroups(self) -> Array:
        """Get the group of each body, an array of int; empty: all bodies are in one group."""
        return np.frombuffer(super().getGroups(), dtype=np.intc)

    def setGroups(self, groups: Sequence[int]) -> None:
        """Set groups of bodies; the fluid couples bodies only within a group.

        In this way replicas of a scene can run in one Context, at a cost linear in their number.
        Hydrodynamic particles in no body belong to group 0.

        Groups should be independent. In schemes without momenta, if a group must redo a step (at a
        wall, or for overlap), only this group redoes it. The trajectories of the other groups stay
        the same bit for bit. OpenMM forces between groups break this independence. In schemes that
        evaluate forces at intermediate positions, such forces may have been evaluated at rejected
        poses. LangevinHI redoes a step for all groups.

        Parameters
        ----------
        groups : sequence of int
            a number from 0 up for each body; empty: all bodies feel each other
        """
        super().setGroups(_units.indices(groups, _where('setGroups'), 'groups'))

    # ---- In a Context ----------------------------------------------------------------------------

    def updateParametersInContext(self, context: openmm.Context) -> None:
        """Copy changed parameters to a Context.

        The parameters are viscosity, radii, own tensors, slips, forces on the fluid, lubrication
        and its reach, minimum gap, solver, tolerance, grid spacing, fast summation and flows. A
        radius may not change between 0 and a positive value. Changes of model, boundary, wall
        height, channel walls and condition, sphere-wall mobility, groups and the number of
        particles need ``reinitialize``.
        """
        super().updateParametersInContext(
            _units.context(context, _where('updateParametersInContext')))

    def getMobilityInContext(self, context: openmm.Context) -> Array:
        """Get the mobility matrix of the bodies at their present poses.

        Dense matrices give the matrix. MatrixFree iterates column by column, to its tolerance,
        where this takes less time: for bodies of 850 blobs and more on the CPU platform, and of
        3500 on Reference. ``CustomRigidHIIntegrator.getEffects`` names the way ("mobilities asked
        for").

        Returns
        -------
        array of shape (6n, 6n)
            rows per body Vx Vy Vz Wx Wy Wz about the body's origin, columns Fx Fy Fz Tx Ty Tz, lab
            frame, in OpenMM's units; free particles are force-free
        """
        numbers = _units.array(super().getMobilityInContext(
            _units.context(context, _where('getMobilityInContext'))))
        return numbers.reshape(2*(int(np.sqrt(numbers.size)),))

    def getFrictionInContext(self, context: openmm.Context) -> Array:
        """Get the friction matrix of the bodies, an array of shape (6n, 6n).

        It is the inverse of the mobility matrix, or the pseudo-inverse for bodies whose blobs lie
        on a line. It always uses dense matrices.
        """
        numbers = _units.array(super().getFrictionInContext(
            _units.context(context, _where('getFrictionInContext'))))
        return numbers.reshape(2*(int(np.sqrt(numbers.size)),))

    def applyMobilityInContext(self, context: openmm.Context, wrenches: npt.ArrayLike) -> Array:
        """Get the velocities that forces and torques on the bodies would give without inertia.

        The computation is dense or matrix-free, as :meth:`setSolver` says. For spheres it is always
        a product, without a matrix. The product is exact to rounding, or to the solver tolerance
        where :meth:`setFastSummation` applies.

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

    def applyBlobMobilityInContext(self, context: openmm.Context, forces: Numbers) -> unit.Quantity:
        """Get the velocities that forces on hydrodynamic particles would give if each were free.

        The result is the product of the forces with the mobility of the blobs, without the rigidity
        of bodies. Blobs, spheres and free particles are at their present positions. Spheres (one
        particle in a body) feel no torque, and the result omits their angular velocities. Particles
        feel each other as bodies do: within a group of :meth:`setGroups`, or, under FreeDraining,
        within a body. Tensors of :meth:`setBodyMobility` and :meth:`setBodyFriction` belong to
        bodies and have no effect. The call solves no linear system. Its cost is one product with
        the model's matrix for each group, with any solver. StokesianDynamics forms its matrix.

        Parameters
        ----------
        context : openmm.Context
            a Context whose System has this Force
        forces : array-like or Quantity of shape (particles, 3)
            one finite row for each particle of the System, kJ/(mol nm), lab frame; forces on
            particles that do not interact with the fluid are ignored

        Returns
        -------
        Quantity of shape (particles, 3)
            velocities, nm/ps, lab frame; 0 for particles that do not interact with the fluid
        """
        rows = _units.rows(forces, _units.FORCE, 3, _where('applyBlobMobilityInContext'), 'forces')
        context = _units.context(context, _where('applyBlobMobilityInContext'))
        return _units.VELOCITY.attach(
            _units.array(super().applyBlobMobilityInContext(context, rows.reshape(-1)), 3))

    def getFlowInContext(self, context: openmm.Context, points: Numbers) -> unit.Quantity:
        r"""Get the velocities of the fluid at points.

        The flow of the fluid is the driven flow plus the flow that the bodies cause. Within a
        particle it is the flow of the particle's spread forces.

        In schemes without momenta the flow belongs to the last step, at the poses where the step
        evaluated its forces. For DriftCorrectorFD, DriftCorrectorRFD and FixmanMidpoint these poses
        are the mid-point. The flow is the sum of the driven flow, :math:`\nu` times the random flow
        (:math:`\nu` is the drift factor of
        :meth:`CustomRigidHIIntegrator.setDriftCorrectorScaling`), and the flow of the forces that
        kept the bodies rigid. The mean of this flow has the Brownian stress; a mean of the forces
        alone does not. For a fluid on a grid the flow has all modes of the random field. Where the
        model has no random field, the random flow is the mean of all random flows that fit the
        particles' random velocities.

        Before a step, or after changes of poses or parameters, the flow has no noise: it is the
        flow of the present forces at the present poses. With LangevinHI it is the flow of the
        friction forces at the present poses and velocities.

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
        Checkpoints and States hold what the flow needs from the last step. The cost is the cost of
        a step, plus the work of each particle at each point; on a grid, of each node at each point.
        With several groups of :meth:`setGroups`, and with FreeDraining, no common fluid exists, and
        the call is an error.
        """
        where = _where('getFlowInContext')
        rows = _units.rows(points, _units.LENGTH, 3, where, 'points')
        return _units.VELOCITY.attach(
            _units.array(super().getFlowInContext(_units.context(context, where), rows), 3))

    def getFlowModeInContext(self, context: openmm.Context, forceAxis: int, waveAxis: int,
                             waveVectorIndex: int) -> unit.Quantity:
        r"""Get the amplitudes of a wave in the flow of :meth:`getFlowInContext`.

        They are the amplitudes of :math:`\sin(k x)` and of :math:`\cos(k x)` in the component
        forceAxis of the flow, with the coordinate x along waveAxis, and with :math:`k = 2 \pi n/L`,
        where n is waveVectorIndex and L the edge of the box along waveAxis. The amplitudes are
        exact, without a grid: they are :math:`2/(\eta k^2 V)` times the power of the particles'
        forces on such a flow. In a NoSlipChannel and a Film, where a flow is not a sum of such
        waves, the amplitudes are means over the height of the fluid.

        Parameters
        ----------
        context : openmm.Context
            a Context whose System has this Force, with the boundary Periodic, or SlipChannel,
            NoSlipChannel or Film and both axes along its walls. The fluid above a PeriodicWall has
            no finite height and is refused.
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

    def getRandomFlowModeInContext(self, context: openmm.Context, forceAxis: int, waveAxis: int,
                                   waveVectorIndex: int) -> unit.Quantity:
        r"""Get the amplitudes of a wave in the random field of the last step, without :math:`\nu`.

        The random field is the part of the noise that the model draws itself, on a grid; without a
        grid the amplitudes are 0. Their mean is 0, so they serve as a control variate. Subtract a
        multiple of them from :meth:`getFlowModeInContext` to reduce the error of a mean.

        Parameters
        ----------
        context, forceAxis, waveAxis, waveVectorIndex
            as in :meth:`getFlowModeInContext`

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

    def getMeanFlowInContext(self, context: openmm.Context) -> unit.Quantity:
        """Get the mean of the flow of :meth:`getFlowInContext` over the volume of the fluid.

        Times the height of a channel, the mean is the flux through the channel per length across
        the flow. The mean is exact, without a grid: it is the power of the particles' forces on
        Poiseuille's flow of a unit force density, and the mean of the driven flow.

        Parameters
        ----------
        context : openmm.Context
            a Context whose System has this Force. The boundary must be NoSlipChannel or Film, or
            Periodic or SlipChannel, where the mean is 0. It is 0 as well with the condition
            ZeroFlux.

        Returns
        -------
        Quantity of shape (3,)
            nm/ps
        """
        context = _units.context(context, _where('getMeanFlowInContext'))
        return _units.VELOCITY.attach(_units.array(super().getMeanFlowInContext(context)))

    def getRandomMeanFlowInContext(self, context: openmm.Context) -> unit.Quantity:
        r"""Get the mean of the random field of the last step over the volume of the fluid.

        The mean relates to :meth:`getMeanFlowInContext` as :meth:`getRandomFlowModeInContext`
        relates to :meth:`getFlowModeInContext`: it is the part of the noise that the model draws
        itself, without :math:`\nu`.

        Parameters
        ----------
        context
            as in :meth:`getMeanFlowInContext`

        Returns
        -------
        Quantity of shape (3,)
            nm/ps
        """
        context = _units.context(context, _where('getRandomMeanFlowInContext'))
        return _units.VELOCITY.attach(_units.array(super().getRandomMeanFlowInContext(context)))

    def getStressInContext(self, context: openmm.Context) -> Stress:
        r"""Get the stress that the bodies add to a periodic fluid, by parts, at present poses.

        Each part is a mean over the box. The mean of their sum over a run, plus the stress of the
        fluid alone, is the stress of the suspension. The hydrodynamic and Brownian parts have no
        trace, because the models know no pressure in bodies. Spheres of StokesianDynamics have
        stresslets, and multiblobs have stresslets by their blobs. Single spheres of the other
        models have none.

        The Brownian part is :math:`kT\,\mathrm{div}(R N)`, where :math:`R N` gives stresslets from
        forces and torques. It is one sample of a random finite difference; this sample costs two
        mobility problems and is right on average over steps, in every scheme. It has rare huge
        values where spheres nearly touch. It is 0 at the temperature 0.

        The interparticle part comes from OpenMM's forces, which must not depend on absolute
        positions or orientations. It is the virial of the forces, and the stresslets that they
        cause in the fluid. Single spheres of models other than StokesianDynamics have no
        stresslets, so the part is then the virial alone; otherwise it differs from the sum of
        distance x force over pairs. The virial is a difference of energies: to 1e-9 on the platform
        Reference, and to about 1e-4 on CPU, which computes in single precision.

        Parameters
        ----------
        context : openmm.Context
            a Context whose System has this Force, with the boundary Periodic

        Returns
        -------
        Stress
            four Quantities of shape (3, 3), kJ/(mol nm^3): hydrodynamic, brownian, interparticle
            and ideal

        Notes
        -----
        A warning says so if a sheared fluid has single spheres without stresslets alone, which no
        bonds connect, and, at the first call of a Context, if a CustomExternalForce acts on
        particles: its virial depends on the origin. The call is an error with FreeDraining, several
        groups of :meth:`setGroups`, schemes with momenta, a CustomBodyForce, platforms other than
        Reference and CPU, and bodies that are held, driven, joined or exert forces on the fluid.
        """
        where = _where('getStressInContext')
        context = _units.context(context, where)
        stress = self._stress(context)
        if not stress.hydrodynamic._value.any() and self.getShear()[0]._value != 0:
            # Beads that bonds connect resist by their bonds.
            beads = [
                sum(self.getParticleRadius(i)._value > 0 for i in molecule)
                for molecule in context.getMolecules()
            ]
            if max(beads) < 2:
                warnings.warn(
                    f'{where}: no body resists the strain of the flow: single spheres of model '
                    f'{self.getModel().name} have no stresslets; use setModel(StokesianDynamics), '
                    'or bodies of several blobs (app.multiblobSphere())', stacklevel=2)
        if context not in _KNOWN_STRESSES:
            _KNOWN_STRESSES.add(context)
            groups = context.getIntegrator().getIntegrationForceGroups()
            for index, forces in external_forces(context, groups):
                if forces.any():
                    warnings.warn(
                        f'{where}: a CustomExternalForce (Force {index} of the System) depends on '
                        'absolute positions, so that the interparticle part depends on the origin '
                        'and is no stress; take such forces away, by a global parameter of 0 or a '
                        'force group that setIntegrationForceGroups() leaves out', stacklevel=2)
        return stress

    def _stress(self, context):
        """getStressInContext() without warnings, for samples of a run."""
        parts = _units.array(super().getStressInContext(context)).reshape(4, 3, 3)
        return Stress(*(_units.STRESS.attach(part.copy()) for part in parts))

    def usesPeriodicBoundaryConditions(self) -> bool:
        """Get whether this Force makes the System periodic.

        It does with all boundaries except Unbounded and NoSlipWall.
        """
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


#: Contexts whose forces getStressInContext() has looked at.
_KNOWN_STRESSES: weakref.WeakSet = weakref.WeakSet()

for _place, _table in (('@models@', _models.MODELS), ('@boundaries@', _models.BOUNDARIES)):
    MobilityForce.__doc__ = MobilityForce.__doc__.replace(_place, _models.summary(_table))
for _member in (*Model, *Boundary):
    setattr(MobilityForce, _member.name, _member)
