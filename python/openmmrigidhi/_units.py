"""Conversion of Python users' arguments into plain numbers in OpenMM's units.

Users pass numbers, quantities, Vec3, tuples, lists and arrays. The functions check a quantity's
dimension: 5 nm is no temperature. OpenMM's own bindings drop units that they do not expect. All
errors name the method, the argument, the value, the requirement and the remedy.
"""
import difflib
import enum
import numbers
import re
import operator

import numpy as np
import openmm
from openmm import unit


class Dimension:
    """A unit in which the C++ library expects an argument, and equivalent units."""
    def __init__(self, label, base, *synonyms):
        self.label = label
        self.base = base
        self._accepted = (base,) + synonyms
        self._isMolar = any(each.name == 'mole' for each, _ in base.iter_base_or_scaled_units())

    def strip(self, quantity, where, name):
        """The value of a quantity in this unit; TypeError if the dimension is another."""
        for accepted in self._accepted:
            if quantity.unit.is_compatible(accepted):
                return quantity.value_in_unit(accepted)
        if self._isMolar:
            # Joule and newton are of one particle.
            ofMole = quantity*unit.AVOGADRO_CONSTANT_NA
            if unit.is_quantity(ofMole) and ofMole.unit.is_compatible(self.base):
                return ofMole.value_in_unit(self.base)
        remedy = ('divide it by its unit'
                  if self is NONE else f'convert it or give a number in {self.label}')
        raise TypeError(f'{where}: {name}: got a quantity in {quantity.unit.get_name()}; '
                        f'it must be {self.label}: {remedy}')

    def attach(self, value):
        """A Quantity of this unit."""
        return unit.Quantity(value, self.base)


TEMPERATURE = Dimension('kelvin', unit.kelvin)
TIME = Dimension('ps', unit.picosecond)
RATE = Dimension('1/ps', unit.picosecond**-1)
LENGTH = Dimension('nm', unit.nanometer)
WAVE_NUMBER = Dimension('1/nm', unit.nanometer**-1)
MASS = Dimension('dalton', unit.dalton)
MOMENT = Dimension('dalton nm^2', unit.dalton*unit.nanometer**2)
VELOCITY = Dimension('nm/ps', unit.nanometer/unit.picosecond)
ANGULAR_VELOCITY = Dimension('rad/ps', unit.radian/unit.picosecond, unit.picosecond**-1)
FORCE = Dimension('kJ/(mol nm)', unit.kilojoule_per_mole/unit.nanometer)
VISCOSITY = Dimension('dalton/(nm ps)', unit.dalton/(unit.nanometer*unit.picosecond))
FORCE_DENSITY = Dimension('kJ/(mol nm^4)', unit.kilojoule_per_mole/unit.nanometer**4)
STRESS = Dimension('kJ/(mol nm^3)', unit.kilojoule_per_mole/unit.nanometer**3)
ENERGY = Dimension('kJ/mol', unit.kilojoule_per_mole)
# 1 Pa s in dalton/(nm ps); Avogadro's constant is exact since 2019.
PASCAL_SECOND = 602214.076
# k_B per mole, kJ/(mol K).
GAS_CONSTANT = unit.MOLAR_GAS_CONSTANT_R.value_in_unit(unit.kilojoule_per_mole/unit.kelvin)
NONE = Dimension('a plain number', unit.dimensionless)

#: Units in names and on command lines: of time, ps, and of length, nm.
TIMES = {'fs': 1e-3, 'ps': 1.0, 'ns': 1e3, 'us': 1e6, 'ms': 1e9, 's': 1e12}
LENGTHS = {'pm': 1e-3, 'nm': 1.0, 'um': 1e3, 'mm': 1e6}


def from_text(text, units, default):
    """The number of a text such as 5ns or 0.1 s, in the units' base; default is the unit of a bare
    number.

    ValueError or KeyError if the text is none.
    """
    try:
        return float(text)*units[default]  # also inf
    except ValueError:
        number_, name = re.fullmatch(r'\s*(.*?)\s*([a-z]*)\s*', text).groups()
        return float(number_)*units[name or default]


def number(value, dimension, where, name):
    """A float in the dimension's unit."""
    if unit.is_quantity(value):
        value = dimension.strip(value, where, name)
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if not isinstance(value, numbers.Real) or isinstance(value, (bool, np.bool_)):
        raise TypeError(
            f'{where}: {name}: got {value!r}; it must be a number: give one in {dimension.label}')
    return float(value)


def plain(value):
    """The numbers of a Quantity in OpenMM's units; anything else is returned as it is."""
    return value.value_in_unit_system(unit.md_unit_system) if unit.is_quantity(value) else value


def viscosity(value, where, name):
    """A viscosity as a float in dalton/(nm ps).

    It is given as a number in this unit, or as a quantity in any unit of viscosity, also a molar
    unit.
    """
    pascal_second = unit.pascal*unit.second
    if unit.is_quantity(value) and not value.unit.is_compatible(
            VISCOSITY.base) and value.unit.is_compatible(pascal_second):
        return float(value.value_in_unit(pascal_second))*PASCAL_SECOND
    return number(value, VISCOSITY, where, name)


def integer(value, where, name):
    """An int that fits into C++'s int; numpy's integers are accepted, floats are refused."""
    try:
        result = operator.index(value)
    except TypeError:
        raise TypeError(
            f'{where}: {name}: got {value!r}; it must be an integer: convert it') from None
    if not -2**31 <= result < 2**31:
        raise ValueError(f'{where}: {name}: got {result}; it must be from -2^31 to 2^31-1')
    return result


def constant(value, kind, where, name):
    """An int from a constant of this enumeration, its name, or a plain integer.

    Another enumeration's constant is an error.
    """
    if isinstance(value, str):
        if value not in kind.__members__:
            raise ValueError(f'{where}: {name}: {value!r} is no {kind.__name__}; the names are '
                             f'{", ".join(_likeliest_first(value, kind))}')
        return int(kind[value])
    if isinstance(value, (bool, np.bool_)) or not hasattr(value, '__index__') or (isinstance(
            value, enum.Enum) and not isinstance(value, kind)):
        raise TypeError(f'{where}: {name}: got {value!r}; it must be a {kind.__name__}: '
                        f"use one of {', '.join(kind.__members__)}, or its name")
    return integer(value, where, name)


def _likeliest_first(wrong, kind):
    """The names of an enumeration; a name that the user may have meant comes first."""
    names = {member.lower(): member for member in kind.__members__}
    near = [names[key] for key in difflib.get_close_matches(wrong.lower(), names)]
    return near + [member for member in kind.__members__ if member not in near]


def boolean(value, where, name):
    """A bool; numbers are refused, since they are more likely misplaced arguments."""
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f'{where}: {name}: got {value!r}; it must be True or False')
    return bool(value)


def context(value, where):
    """An openmm.Context, or TypeError, since SWIG's own messages speak of null references."""
    if not isinstance(value, openmm.Context):
        raise TypeError(
            f'{where}: context: got {type(value).__name__}; it must be an openmm.Context: '
            'give the Context whose System has this Force')
    return value


def context_or_simulation(value, where):
    """An openmm.Context, and the step method of a Simulation, which calls reporters, or None."""
    if not isinstance(value, openmm.Context) and isinstance(getattr(value, 'context', None),
                                                            openmm.Context):
        return value.context, value.step
    if not isinstance(value, openmm.Context):
        raise TypeError(
            f'{where}: context: got {type(value).__name__}; it must be an openmm.Context or an '
            'openmm.app.Simulation: give the one whose System has the MobilityForce')
    return value, None


def array(buffer, columns=None):
    """The numbers of a buffer from C++ as a writable array, without a copy."""
    numbers_ = np.frombuffer(buffer, dtype=np.double)
    return numbers_ if columns is None else numbers_.reshape(-1, columns)


def matrix(values, shape, where, name, stack=False):
    """A matrix of mixed dimension: plain numbers of a fixed shape; with `stack` also n matrices."""
    result = _floats(values, NONE, where, name)
    if result.shape != shape and not (stack and result.shape[1:] == shape):
        either = f'{shape} or {("n", *shape)}'.replace("'", '') if stack else f'{shape}'
        raise ValueError(
            f'{where}: {name}: got an array of shape {result.shape}; the shape must be {either}: '
            "give plain numbers in OpenMM's units")
    return result


def indices(values, where, name):
    """An int32 array from any iterable of integers."""
    try:
        values = list(values)
    except TypeError:
        raise TypeError(f'{where}: {name}: got {values!r}; it must be a sequence of integers: '
                        'give a list of particle indices') from None
    return np.array([integer(value, where, name) for value in values], dtype=np.intc)


def rows(values, dimension, columns, where, name, count=None):
    """An (n, columns) array of floats in the dimension's unit; n is checked if it is given."""
    array = _floats(values, dimension, where, name)
    expected = f'({"n" if count is None else count}, {columns})'
    if array.size == 0 and count in (None, 0):
        return np.empty((0, columns))
    if array.ndim != 2 or array.shape[1] != columns or (count is not None and len(array) != count):
        raise ValueError(
            f'{where}: {name}: got an array of shape {array.shape}; the shape must be {expected}: '
            'give one row per item')
    return array


def array_of(values, dimension, where, name):
    """An array of floats in the dimension's unit, of any shape, also of a single number."""
    return _floats(values, dimension, where, name)


def vector(value, dimension, where, name):
    """An array of 3 floats in the dimension's unit."""
    array = _floats(value, dimension, where, name)
    if array.shape != (3,):
        raise ValueError(
            f'{where}: {name}: got an array of shape {array.shape}; the shape must be (3,)')
    return array


def one_or_each(values, dimension, columns, items, where, name):
    """An array (columns,) for all items of a stack, or (n, columns) for each item.

    items is None if there is only one item; then n may be any number.
    """
    array = _floats(values, dimension, where, name)
    count = 'n' if items is None else items
    if array.shape != (columns,) and not (array.ndim == 2 and array.shape[1] == columns
                                          and items in (None, len(array))):
        raise ValueError(f'{where}: {name}: got an array of shape {array.shape}; the shape must be '
                         f'({columns},), for all matrices, '
                         f'or ({count}, {columns}), for each: give rows of {columns} numbers')
    return array


def sequence(values, dimension, where, name):
    """An (n,) array of floats in the dimension's unit."""
    array = _floats(values, dimension, where, name)
    if array.ndim != 1:
        raise ValueError(
            f'{where}: {name}: got an array of shape {array.shape}; it must be a plain sequence of '
            'numbers: give one number per item')
    return array


def per_site(values, dimension, count, where, name):
    """A list of one number for each site, finite and not negative; a single number is for all."""
    try:
        numbers_ = np.full(count, number(values, dimension, where, name))
    except TypeError:
        numbers_ = sequence(values, dimension, where, name)
    if numbers_.shape != (count,):
        raise ValueError(
            f'{where}: {name}: got {len(numbers_)} for {count} sites; give one for all, or one for '
            f'each')
    if not np.all((0 <= numbers_) & (numbers_ < np.inf)):
        raise ValueError(
            f'{where}: {name}: got {numbers_.tolist()}; each must be finite and not negative')
    return numbers_.tolist()


def frames(values, dimension, columns, where, name):
    """A trajectory of n bodies, a (T, n, columns) array of finite floats in the unit."""
    array = _floats(values, dimension, where, name)
    if array.ndim != 3 or array.shape[2] != columns or array.size == 0:
        raise ValueError(
            f'{where}: {name}: got an array of shape {array.shape}; a trajectory must have the '
            f'shape (frames, bodies, {columns}): reshape it')
    if not np.all(np.isfinite(array)):
        frame, body, _ = np.argwhere(~np.isfinite(array))[0]
        raise ValueError(f'{where}: {name}: frame {frame}, body {body}: the trajectory holds '
                         f'{array[frame, body]}; all numbers must '
                         'be finite: leave out what follows a run that blew up')
    return array


def _floats(values, dimension, where, name):
    stripped = _strip_leaves(values, dimension, where, name)
    try:
        array = np.asarray(stripped)
    except ValueError:
        # numpy >= 1.24 refuses rows of different length.
        raise ValueError(
            f'{where}: {name}: the rows have different lengths; they must form an array') from None
    if array.dtype.kind not in 'fiu' and array.size > 0:
        raise TypeError(f'{where}: {name}: got {values!r}; its elements must be numbers: '
                        f'give numbers in {dimension.label}')
    return np.array(array, dtype=np.double, order='C')


def _strip_leaves(values, dimension, where, name):
    """Remove checked units from a quantity, or from quantities anywhere inside nested sequences."""
    if unit.is_quantity(values):
        return dimension.strip(values, where, name)
    if isinstance(values,
                  (list, tuple)) or (isinstance(values, np.ndarray) and values.dtype == object):
        return [_strip_leaves(value, dimension, where, name) for value in values]
    return values
