"""Common methods of CustomBodyForce and CustomBodyMotion.

They are for expressions, parameters and bodies. Each of these classes names them as its own. They
reach the C++ methods of the same names through the class's attribute `_base`.
"""
from __future__ import annotations

import numpy as np
import openmm
from openmm import unit

from . import _units
from ._types import Number, Numbers


def _where(self, method):
    return f'{self._base.__name__}.{method}'


def text(value, where, name):
    """A string; anything else raises TypeError."""
    if not isinstance(value, str):
        raise TypeError(f'{where}: {name}: got {value!r}; it must be a string')
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


def _value(value, where, name):
    """A parameter as a float in OpenMM's units.

    Expressions give the parameter its meaning, so it may have any dimension.
    """
    return _units.number(
        _plain(value) if unit.is_quantity(value) else value, _units.NONE, where, name)


def _index(self, index, method):
    return _units.integer(index, _where(self, method), 'index')


def _parameters(values, where):
    if unit.is_quantity(values):
        values = _plain(values)
    try:
        values = list(values)
    except TypeError:
        raise TypeError(f'{where}: parameters: got {values!r}; it must be a sequence of numbers: '
                        'give one for each per-body parameter') from None
    return np.array([_value(value, where, f'parameter {i}') for i, value in enumerate(values)],
                    dtype=np.double)


# ---- Expressions ---------------------------------------------------------------------------------


def getExpression(self, component: str) -> str:
    """Get one of the six expressions, a str.

    Parameters
    ----------
    component : str
        its name, as the constructor has it
    """
    return self._base.getExpression(self, text(component, _where(self, 'getExpression'),
                                               'component'))


def setExpression(self, component: str, expression: str) -> None:
    """Set one of the six expressions.

    The expression takes effect at the next Context creation or reinitialize().

    Parameters
    ----------
    component : str
        its name, as the constructor has it
    expression : str
        the expression
    """
    where = _where(self, 'setExpression')
    self._base.setExpression(self, text(component, where, 'component'),
                             text(expression, where, 'expression'))


# ---- Parameters ----------------------------------------------------------------------------------


def getNumPerBodyParameters(self) -> int:
    """Get the number of per-body parameters."""
    return self._base.getNumPerBodyParameters(self)


def addPerBodyParameter(self, name: str) -> int:
    """Add a per-body parameter, and get its index.

    Parameters
    ----------
    name : str
        its name, without spaces or operators and without a digit first; it must differ from the
        names of variables and other parameters
    """
    return self._base.addPerBodyParameter(self,
                                          text(name, _where(self, 'addPerBodyParameter'), 'name'))


def getPerBodyParameterName(self, index: int) -> str:
    """Get the name of a per-body parameter by its index."""
    return self._base.getPerBodyParameterName(self, _index(self, index, 'getPerBodyParameterName'))


def setPerBodyParameterName(self, index: int, name: str) -> None:
    """Set the name of a per-body parameter by its index.

    Parameters and errors as in :meth:`addPerBodyParameter`.
    """
    self._base.setPerBodyParameterName(self, _index(self, index, 'setPerBodyParameterName'),
                                       text(name, _where(self, 'setPerBodyParameterName'), 'name'))


def getNumGlobalParameters(self) -> int:
    """Get the number of global parameters."""
    return self._base.getNumGlobalParameters(self)


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
    where = _where(self, 'addGlobalParameter')
    return self._base.addGlobalParameter(self, text(name, where, 'name'),
                                         _value(defaultValue, where, 'defaultValue'))


def getGlobalParameterName(self, index: int) -> str:
    """Get the name of a global parameter by its index."""
    return self._base.getGlobalParameterName(self, _index(self, index, 'getGlobalParameterName'))


def setGlobalParameterName(self, index: int, name: str) -> None:
    """Set the name of a global parameter by its index.

    Parameters and errors as in :meth:`addGlobalParameter`.
    """
    self._base.setGlobalParameterName(self, _index(self, index, 'setGlobalParameterName'),
                                      text(name, _where(self, 'setGlobalParameterName'), 'name'))


def getGlobalParameterDefaultValue(self, index: int) -> float:
    """Get the value of a global parameter in a new Context by its index, in OpenMM's units."""
    return self._base.getGlobalParameterDefaultValue(
        self, _index(self, index, 'getGlobalParameterDefaultValue'))


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
    self._base.setGlobalParameterDefaultValue(
        self, _index(self, index, method), _value(defaultValue, _where(self, method),
                                                  'defaultValue'))


# ---- Bodies --------------------------------------------------------------------------------------


def getNumBodies(self) -> int:
    """Get the number of entries; an entry lets this force act on a body."""
    return self._base.getNumBodies(self)


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
    where = _where(self, 'addBody')
    return self._base.addBody(self, _units.integer(bodyIndex, where, 'bodyIndex'),
                              _parameters(parameters, where))


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
    body, buffer = self._base.getBodyParameters(self, _index(self, index, 'getBodyParameters'))
    return body, tuple(np.frombuffer(buffer, dtype=np.double).tolist())


def setBodyParameters(self, index: int, bodyIndex: int, parameters: Numbers = ()) -> None:
    """Set the body and the parameters of an entry.

    The change takes effect at the next Context creation, or with :meth:`updateParametersInContext`.

    Parameters
    ----------
    index : int
        index of the entry
    bodyIndex : int
        index of the body in the integrator
    parameters : sequence of float or Quantity
        values of the per-body parameters, in OpenMM's units; finite
    """
    where = _where(self, 'setBodyParameters')
    self._base.setBodyParameters(self, _index(self, index, 'setBodyParameters'),
                                 _units.integer(bodyIndex, where, 'bodyIndex'),
                                 _parameters(parameters, where))


def updateParametersInContext(self, context: openmm.Context) -> None:
    """Copy the per-body parameters of all entries to a Context.

    Expressions, names and the set of bodies stay as they were at Context creation.

    Parameters
    ----------
    context : openmm.Context
        the Context

    Raises
    ------
    openmm.OpenMMException
        if this force is not in the Context, or acts on other bodies than at Context creation
    """
    self._base.updateParametersInContext(
        self, _units.context(context, _where(self, 'updateParametersInContext')))
