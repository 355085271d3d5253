"""CustomBodyForce: the Python side of the C++ class, with checked types and documentation."""
from __future__ import annotations

import openmm

from . import _bindings, _bodyexpressions, _copies

_Base = _bindings.CustomBodyForce


class CustomBodyForce(_copies.Copies, _Base):
    """A force and a torque on rigid bodies of a CustomRigidHIIntegrator, as expressions.

    Add the force to the System with ``system.addForce``, and bodies to the force with
    :meth:`addBody`. Six expressions give the components of the force and of the torque about the
    body's origin, all in the lab frame. Expressions use the language of OpenMM's Custom forces
    (``'-k*(x-x0); k=2*stiffness'``). They may contain

    - ``x y z``: the position of the body's origin, nm, unwrapped;
    - ``q0 q1 q2 q3``: the body's orientation, the unit quaternion (w, x, y, z) that rotates
      body-frame vectors into lab-frame vectors. q and -q are the same orientation and either may
      occur, so only expressions that are even in q make sense;
    - ``vx vy vz``: the velocity of the origin, nm/ps (Langevin schemes only);
    - ``t``: the time, ps;
    - per-body parameters, which have a value for each added body;
    - global parameters, which are parameters of the Context (``context.setParameter``).

    The integrator evaluates the expressions whenever it evaluates OpenMM's forces, at the same
    positions and time, if the force group is one of the integrator's. The forces and torques are
    part of ``getBodyForces`` and ``getBodyTorques`` of the integrator. They have no energy, so
    minimisers and barostats ignore them. Torques about an axis without inertia have no effect.

    If an expression uses velocities, the first half kick of a step takes the velocities at its
    beginning. The second half kick takes the resulting velocities (predicted once). The weak order
    is 2 with LangevinC and LangevinHI, and 1 with LangevinA and LangevinB (2 without friction). Set
    strong friction in the integrator: a step of an expression like ``-g*vx`` is stable only for
    :math:`h g/m` below 1 or so, where h is the step and m the mass.

    A wrong type raises TypeError, and a wrong shape ValueError. Any other error raises
    openmm.OpenMMException. Each message names the object, the value, the bound and the remedy.
    Context creation checks the expressions.

    Parameters
    ----------
    fx, fy, fz : str
        components of the force, kJ/(mol nm)
    tx, ty, tz : str
        components of the torque about the body's origin, kJ/mol

    Examples
    --------
    >>> import openmmrigidhi
    >>> trap = openmmrigidhi.CustomBodyForce('-k*x', '-k*y', '-k*z', '0', '0', 'drive*cos(0.5*t)')
    >>> trap.addGlobalParameter('k', 100.0)
    0
    >>> trap.addPerBodyParameter('drive')
    0
    >>> trap.addBody(0, [2.5])
    0
    """

    _base = _Base
    _generic = openmm.Force

    def __init__(self, fx: str, fy: str, fz: str, tx: str, ty: str, tz: str) -> None:
        given = {'fx': fx, 'fy': fy, 'fz': fz, 'tx': tx, 'ty': ty, 'tz': tz}
        super().__init__(*[
            _bodyexpressions.text(value, 'CustomBodyForce.__init__', name)
            for name, value in given.items()
        ])

    def __repr__(self):
        expressions = ', '.join(f'{c}={self.getExpression(c)!r}'
                                for c in ('fx', 'fy', 'fz', 'tx', 'ty', 'tz'))
        return f'<CustomBodyForce: {expressions}, {self.getNumBodies()} bodies>'

    @staticmethod
    def cast(obj: openmm.Force) -> CustomBodyForce:
        """Get a CustomBodyForce from a generic openmm.Force.

        ``system.getForce`` and deserialisation return the generic class.

        Parameters
        ----------
        obj : openmm.Force
            the object; if it owned the C++ object, the result owns the C++ object from now on, and
            obj remains usable

        Returns
        -------
        CustomBodyForce
            obj itself if it is one already

        Raises
        ------
        TypeError
            if obj is anything else
        """
        return CustomBodyForce._cast_generic(obj)

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

    getNumBodies = _bodyexpressions.getNumBodies
    addBody = _bodyexpressions.addBody
    getBodyParameters = _bodyexpressions.getBodyParameters
    setBodyParameters = _bodyexpressions.setBodyParameters
    updateParametersInContext = _bodyexpressions.updateParametersInContext

    def usesPeriodicBoundaryConditions(self) -> bool:
        """Get whether this force uses periodic boundary conditions.

        It does not: positions are unwrapped.
        """
        return super().usesPeriodicBoundaryConditions()
