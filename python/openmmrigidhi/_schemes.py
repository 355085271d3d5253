"""The table of schemes, as the library has it: the enumeration, docstrings and the table of the user guide are made from it."""
import enum
import textwrap
from typing import NamedTuple

from . import _bindings


class SchemeTraits(NamedTuple):
    """What is known of a scheme without running it."""

    name: str
    number: int
    hasMomenta: bool
    needsFluid: bool     # a MobilityForce in the System
    isOverdamped: bool   # without momenta, in a fluid
    weakOrder: int       # of averages at a temperature
    coldOrder: int       # of trajectories at temperature 0
    forces: int          # force evaluations a step
    differenced: str     # what it takes finite differences of where div N is not known
    drift: str           # how it makes the stochastic drift; empty: it has none to make, or omits it
    description: str


TABLE = [SchemeTraits(*row) for row in _bindings.schemeTable()]


class _TableEnum(enum.IntEnum):
    @property
    def traits(self):
        """What the table of schemes says of this one, a SchemeTraits."""
        return TABLE[self]


Scheme = _TableEnum('Scheme', {traits.name: traits.number for traits in TABLE}, module='openmmrigidhi.integrator')
Scheme.__doc__ = 'The time-stepping schemes; also class attributes of CustomRigidHIIntegrator. Each has its ``traits``.'
for _scheme in Scheme:
    _scheme.__doc__ = _scheme.traits.description


def _orders(traits):
    cold = f'; {traits.coldOrder} at T = 0' if traits.coldOrder != traits.weakOrder else ''
    return f'weak order {traits.weakOrder}{cold}'


def bullets(overdamped, indent=4, width=120):
    """The schemes of a docstring, an item each."""
    items = [f'- ``{t.name}`` ({_orders(t)}; {t.forces} force evaluation{"s" if t.forces > 1 else ""} a step). {t.description}'
             for t in TABLE if t.isOverdamped == overdamped]
    lines = [textwrap.fill(item, width - indent, subsequent_indent='  ') for item in items]
    return textwrap.indent('\n'.join(lines), ' '*indent).lstrip()


def markdown():
    """The table of the user guide."""
    rows = ['| scheme | momenta | fluid | weak order | order at T = 0 | forces a step | |', '|---|---|---|---|---|---|---|']
    rows += [f'| `{t.name}` | {"yes" if t.hasMomenta else "no"} | {"yes" if t.needsFluid else "no"} | {t.weakOrder} | {t.coldOrder} | '
             f'{t.forces} | {t.description} |' for t in TABLE]
    return '\n'.join(rows)
