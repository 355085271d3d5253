"""CustomBodyMotion: the Python side of the C++ class, with checked types and documentation."""
from __future__ import annotations

from typing import Union

import openmm

from . import _bindings, _bodyexpressions, _copies, _enums, _units
from ._types import Numbers

_Base = _bindings.CustomBodyMotion


class Frame(_enums.Documented):
    """The frames of prescribed motion; also class attributes of CustomBodyMotion."""

    Lab = _Base.Lab, 'Components are along the axes of the lab (default).'
    Body = _Base.Body, (
        'Components are along the axes of the body frame, which turn with the body.')


# The class has an attribute of the same name, which its annotations would mean.
_Frame = Frame


class CustomBodyMotion(_copies.Copies, _Base):
    """Prescribed velocities of rigid bodies of a CustomRigidHIIntegrator, as expressions of time.

    Add the force to the System with ``system.addForce``, and bodies to the force with
    :meth:`addBody`. Six expressions give the components of the velocity of the body's origin and of
    the angular velocity. An empty expression leaves its component free: forces, the fluid and noise
    then move the body along it. A prescribed component has the value of its expression whatever
    forces act on the body. The integrator's ``computeHoldingWrenches`` gives the necessary wrench.
    So a roller has a prescribed spin and is otherwise free, and ``'0'`` for vz keeps a body in a
    plane.

    Expressions use the language of OpenMM's Custom forces. They may contain

    - ``t``: the time, ps; at each stage of a step it is the time of the stage;
    - per-body parameters, which have a value for each added body;
    - global parameters, which are parameters of the Context (``context.setParameter``).

    Schemes without momenta in a fluid support any prescribed components, and LangevinHI supports
    whole bodies. Other schemes can hold bodies (``integrator.setBodyHeld``). The force groups of
    OpenMM have no meaning here, and the force has no energy.

    A wrong type raises TypeError, and a wrong shape ValueError. Any other error raises
    openmm.OpenMMException. Each message names the object, the value, the bound and the remedy.
    Context creation checks the expressions.

    Parameters
    ----------
    vx, vy, vz : str
        components of the velocity of the body's origin, nm/ps; '': free (default)
    wx, wy, wz : str
        components of the angular velocity, rad/ps; '': free (default)

    Examples
    --------
    >>> import openmmrigidhi
    >>> rollers = openmmrigidhi.CustomBodyMotion(wy='spin*step(t-10)')
    >>> rollers.addPerBodyParameter('spin')
    0
    >>> rollers.addBody(0, [0.2])
    0
    """

    Frame = Frame
    Lab = Frame.Lab
    Body = Frame.Body

    _base = _Base
    _generic = openmm.Force

    def __init__(self, vx: str = '', vy: str = '', vz: str = '', wx: str = '', wy: str = '',
                 wz: str = '') -> None:
        given = {'vx': vx, 'vy': vy, 'vz': vz, 'wx': wx, 'wy': wy, 'wz': wz}
        super().__init__(*[
            _bodyexpressions.text(value, 'CustomBodyMotion.__init__', name)
            for name, value in given.items()
        ])

    def __repr__(self):
        given = {c: self.getExpression(c) for c in ('vx', 'vy', 'vz', 'wx', 'wy', 'wz')}
        expressions = ', '.join(f'{c}={e!r}' for c, e in given.items() if e)
        return (f'<CustomBodyMotion: {expressions}, {self.getFrame().name}, '
                f'{self.getNumBodies()} bodies>')

    @staticmethod
    def cast(obj: openmm.Force) -> CustomBodyMotion:
        """Get a CustomBodyMotion from a generic openmm.Force.

        ``system.getForce`` and deserialisation return the generic class.

        Parameters
        ----------
        obj : openmm.Force
            the object; if it owned the C++ object, the result owns the C++ object from now on, and
            obj remains usable

        Returns
        -------
        CustomBodyMotion
            obj itself if it is one already

        Raises
        ------
        TypeError
            if obj is anything else
        """
        return CustomBodyMotion._cast_generic(obj)

    def getFrame(self) -> _Frame:
        """Get the frame of the prescribed components (Lab or Body)."""
        return Frame(super().getFrame())

    def setFrame(self, frame: Union[_Frame, str, int]) -> None:
        """Set the frame of the prescribed components; default Lab.

        The frame takes effect at the next Context creation or reinitialize().

        Parameters
        ----------
        frame : constant or str
            Lab: along the axes of the lab; Body: along the axes of the body frame, which turn with
            the body
        """
        super().setFrame(_units.constant(frame, Frame, 'CustomBodyMotion.setFrame', 'frame'))

    # ---- Expressions -----------------------------------------------------------------------------

    getExpression = _bodyexpressions.getExpression
    setExpression = _bodyexpressions.setExpression

    # ---- Parameters ------------------------------------------------------------------------------

    getNumPerBodyParameters = _bodyexpressions.getNumPerBodyParameters
    addPerBodyParameter = _bodyexpressions.addPerBodyParameter
    getPerBodyParameterName = _bodyexpressions.getPerBodyParameterName
    setPerBodyParameterName = _bodyexpressions.setPerBodyParameterName
    getNumGlobalParameters = _bodyexpressions.getNumGlobalParameters
    addGlobalParameter = _bodyexpressions.addGlobalParameter
    getGlobalParameterName = _bodyexpressions.getGlobalParameterName
    setGlobalParameterName = _bodyexpressions.setGlobalParameterName
    getGlobalParameterDefaultValue = _bodyexpressions.getGlobalParameterDefaultValue
    setGlobalParameterDefaultValue = _bodyexpressions.setGlobalParameterDefaultValue

    # ---- Bodies ----------------------------------------------------------------------------------

    def getNumBodies(self) -> int:
        """Get the number of entries; an entry prescribes the motion of a body."""
        return super().getNumBodies()

    def addBody(self, bodyIndex: int, parameters: Numbers = ()) -> int:
        """Prescribe the motion of a body.

        A body may be in only one entry of one CustomBodyMotion.

        Parameters
        ----------
        bodyIndex : int
            index of the body in the integrator
        parameters : sequence of float or Quantity
            values of the per-body parameters, in OpenMM's units; finite

        Returns
        -------
        int
            index of the entry
        """
        return _bodyexpressions.addBody(self, bodyIndex, parameters)

    getBodyParameters = _bodyexpressions.getBodyParameters
    setBodyParameters = _bodyexpressions.setBodyParameters
    updateParametersInContext = _bodyexpressions.updateParametersInContext

    def usesPeriodicBoundaryConditions(self) -> bool:
        """Get whether this force uses periodic boundary conditions; it does not."""
        return super().usesPeriodicBoundaryConditions()
