"""CustomBodyForce: the Python side of the C++ class, with checked types and documentation."""
from __future__ import annotations

import numpy as np
import openmm
from openmm import unit

from . import _bindings, _copies, _units
from ._types import Number, Numbers

_Base = _bindings.CustomBodyForce


def _where(method):
    return 'CustomBodyForce.' + method


def _text(value, method, name):
    if not isinstance(value, str):
        raise TypeError(f'{_where(method)}: {name}: got {value!r}; it must be a string: give text')
    return value


def _plain(quantity):
    """The value of a quantity of any dimension in OpenMM's units.

    Quantities per particle (1 N, 1 g) become quantities per mole.
    """
    powers = {dimension.name: power for dimension, power in quantity.unit.iter_base_dimensions()}
    if powers.get('mass'):
        # OpenMM's unit of mass is g/mol, so a mass without a mole becomes larger by Avogadro's
        # number.
        quantity = quantity*unit.AVOGADRO_CONSTANT_NA**(powers['mass'] + powers.get('amount', 0))
    return quantity.value_in_unit_system(unit.md_unit_system)


def _value(value, method, name):
    """A parameter as a float in OpenMM's units.

    Expressions give the parameter its meaning, so it may have any dimension.
    """
    return _units.number(
        _plain(value) if unit.is_quantity(value) else value, _units.NONE, _where(method), name)


class CustomBodyForce(_copies.Copies, _Base):
    """A force and a torque on rigid bodies of a CustomRigidHIIntegrator, as expressions.

    Add the force to the System with ``system.addForce``, and bodies to the force with
    :meth:`addBody`. Six expressions give the components of the force and of the torque about the
    body's origin, all in the lab frame. Expressions are written in the language of OpenMM's Custom
    forces (``'-k*(x-x0); k=2*stiffness'``). They may use

    - ``x y z``: the position of the body's origin, nm, unwrapped;
    - ``q0 q1 q2 q3``: the body's orientation, the unit quaternion (w, x, y, z) that turns
      body-frame vectors into lab-frame vectors. q and -q are the same orientation and either may
      occur, so only expressions that are even in q make sense;
    - ``vx vy vz``: the velocity of the origin, nm/ps (Langevin schemes only);
    - ``t``: the time, ps;
    - per-body parameters, which have a value for each body that was added;
    - global parameters, which are parameters of the Context (``context.setParameter``).

    The expressions are evaluated whenever the integrator evaluates OpenMM's forces, at the same
    positions and time, if the force group is one of the integrator's. The forces and torques are
    part of ``getBodyForces`` and ``getBodyTorques`` of the integrator. They have no energy:
    minimisers and barostats do not see them. Torques about an axis without inertia have no effect.

    If an expression uses velocities, the first half kick of a step takes the velocities at its
    beginning. The second half kick takes the velocities that it leads to (predicted once). The weak
    order is 2 with LangevinC and LangevinHI, and 1 with LangevinA and LangevinB (2 without
    friction). Set strong friction in the integrator: a step of an expression like ``-g*vx`` is
    stable for h*g/m below 1 or so.

    A wrong type raises TypeError, and a wrong shape ValueError. Everything else that is refused
    raises openmm.OpenMMException. Each message names the object, the value, the bound and the
    remedy. Expressions are checked when a Context is created.

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
        super().__init__(*[_text(value, '__init__', name) for name, value in given.items()])

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

    def getExpression(self, component: str) -> str:
        """Get one of the six expressions, a str.

        Parameters
        ----------
        component : str
            'fx', 'fy', 'fz', 'tx', 'ty' or 'tz'
        """
        return super().getExpression(_text(component, 'getExpression', 'component'))

    def setExpression(self, component: str, expression: str) -> None:
        """Set one of the six expressions.

        The expression takes effect at the next Context creation or reinitialize().

        Parameters
        ----------
        component : str
            'fx', 'fy', 'fz', 'tx', 'ty' or 'tz'
        expression : str
            the expression
        """
        super().setExpression(_text(component, 'setExpression', 'component'),
                              _text(expression, 'setExpression', 'expression'))

    # ---- Parameters ------------------------------------------------------------------------------

    def getNumPerBodyParameters(self) -> int:
        """Get the number of per-body parameters."""
        return super().getNumPerBodyParameters()

    def addPerBodyParameter(self, name: str) -> int:
        """Add a per-body parameter, and get its index.

        Parameters
        ----------
        name : str
            its name, without spaces or operators and without a digit first; it must differ from the
            names of variables and other parameters
        """
        return super().addPerBodyParameter(_text(name, 'addPerBodyParameter', 'name'))

    def getPerBodyParameterName(self, index: int) -> str:
        """Get the name of a per-body parameter by its index."""
        return super().getPerBodyParameterName(self._index(index, 'getPerBodyParameterName'))

    def setPerBodyParameterName(self, index: int, name: str) -> None:
        """Set the name of a per-body parameter by its index.

        Parameters and errors as in :meth:`addPerBodyParameter`.
        """
        super().setPerBodyParameterName(self._index(index, 'setPerBodyParameterName'),
                                        _text(name, 'setPerBodyParameterName', 'name'))

    def getNumGlobalParameters(self) -> int:
        """Get the number of global parameters."""
        return super().getNumGlobalParameters()

    def addGlobalParameter(self, name: str, defaultValue: Number) -> int:
        """Add a global parameter, which is a parameter of the Context, and get its index.

        Parameters
        ----------
        name : str
            its name, without spaces or operators and without a digit first; it must differ from the
            names of variables and other parameters
        defaultValue : float or Quantity
            its value in a new Context, in OpenMM's units; finite
        """
        return super().addGlobalParameter(
            _text(name, 'addGlobalParameter', 'name'),
            _value(defaultValue, 'addGlobalParameter', 'defaultValue'))

    def getGlobalParameterName(self, index: int) -> str:
        """Get the name of a global parameter by its index."""
        return super().getGlobalParameterName(self._index(index, 'getGlobalParameterName'))

    def setGlobalParameterName(self, index: int, name: str) -> None:
        """Set the name of a global parameter by its index.

        Parameters and errors as in :meth:`addGlobalParameter`.
        """
        super().setGlobalParameterName(self._index(index, 'setGlobalParameterName'),
                                       _text(name, 'setGlobalParameterName', 'name'))

    def getGlobalParameterDefaultValue(self, index: int) -> float:
        """Get the value of a global parameter in a new Context by its index, in OpenMM's units."""
        return super().getGlobalParameterDefaultValue(
            self._index(index, 'getGlobalParameterDefaultValue'))

    def setGlobalParameterDefaultValue(self, index: int, defaultValue: Number) -> None:
        """Set the value of a global parameter in a new Context.

        Parameters
        ----------
        index : int
            index of the parameter
        defaultValue : float or Quantity
            the value, in OpenMM's units; finite
        """
        method = 'setGlobalParameterDefaultValue'
        super().setGlobalParameterDefaultValue(self._index(index, method),
                                               _value(defaultValue, method, 'defaultValue'))

    # ---- Bodies ----------------------------------------------------------------------------------

    def getNumBodies(self) -> int:
        """Get the number of entries; an entry lets this force act on a body."""
        return super().getNumBodies()

    def addBody(self, bodyIndex: int, parameters: Numbers = ()) -> int:
        """Let the force act on a body; it acts twice on a body that is added twice.

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
        return super().addBody(_units.integer(bodyIndex, _where('addBody'), 'bodyIndex'),
                               self._parameters(parameters, 'addBody'))

    def getBodyParameters(self, index: int) -> tuple[int, tuple[float, ...]]:
        """Get the body and the parameters of an entry.

        Parameters
        ----------
        index : int
            index of the entry

        Returns
        -------
        bodyIndex : int
            index of the body in the integrator
        parameters : tuple of float
            values of the per-body parameters, in OpenMM's units
        """
        body, buffer = super().getBodyParameters(self._index(index, 'getBodyParameters'))
        return body, tuple(np.frombuffer(buffer, dtype=np.double).tolist())

    def setBodyParameters(self, index: int, bodyIndex: int, parameters: Numbers = ()) -> None:
        """Set the body and the parameters of an entry.

        The change takes effect at the next Context creation, or with
        :meth:`updateParametersInContext`.

        Parameters
        ----------
        index : int
            index of the entry
        bodyIndex : int
            index of the body in the integrator
        parameters : sequence of float or Quantity
            values of the per-body parameters, in OpenMM's units; finite
        """
        super().setBodyParameters(
            self._index(index, 'setBodyParameters'),
            _units.integer(bodyIndex, _where('setBodyParameters'), 'bodyIndex'),
            self._parameters(parameters, 'setBodyParameters'))

    def updateParametersInContext(self, context: openmm.Context) -> None:
        """Copy the per-body parameters of all entries to a Context.

        Expressions, names and the set of bodies stay as they were when the Context was created.

        Parameters
        ----------
        context : openmm.Context
            the Context

        Raises
        ------
        openmm.OpenMMException
            if this force is not in the Context, or acts on other bodies than when the Context was
            created
        """
        super().updateParametersInContext(
            _units.context(context, _where('updateParametersInContext')))

    def usesPeriodicBoundaryConditions(self) -> bool:
        """Get whether this force uses periodic boundary conditions.

        It does not: positions are unwrapped.
        """
        return super().usesPeriodicBoundaryConditions()

    @staticmethod
    def _index(index, method):
        return _units.integer(index, _where(method), 'index')

    @staticmethod
    def _parameters(values, method):
        if unit.is_quantity(values):
            values = _plain(values)
        try:
            values = list(values)
        except TypeError:
            raise TypeError(
                f'{_where(method)}: parameters: got {values!r}; it must be a sequence of numbers: '
                'give one for each per-body parameter') from None
        return np.array([_value(value, method, f'parameter {i}') for i, value in enumerate(values)],
                        dtype=np.double)
