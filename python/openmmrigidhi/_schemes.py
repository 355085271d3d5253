"""The table of schemes, as the library has it.

The table generates the enumeration, its docstrings and the tables of the pages.
"""
from __future__ import annotations

import enum
import textwrap
from typing import TYPE_CHECKING, NamedTuple, Optional

from . import _bindings


class SchemeTraits(NamedTuple):
    """The known properties of a scheme."""

    name: str
    number: int
    hasMomenta: bool
    needsFluid: bool  # a MobilityForce in the System
    isOverdamped: bool  # without momenta, in a fluid
    weakOrder: int  # of averages at a temperature
    coldOrder: int  # of trajectories at temperature 0
    forces: int  # force evaluations a step
    differenced: str  # what the scheme takes finite differences of where div N is not known
    drift: str  # how it makes the stochastic drift; empty: it has no drift to make, or omits it
    description: str


TABLE = [SchemeTraits(*row) for row in _bindings.schemeTable()]


class _TableEnum(enum.IntEnum):
    @property
    def traits(self) -> SchemeTraits:
        """The row of this scheme in the table of schemes, a SchemeTraits."""
        return TABLE[self]


if TYPE_CHECKING:
    from ._enumerations import Scheme
else:
    Scheme = _TableEnum('Scheme', {traits.name: traits.number
                                   for traits in TABLE}, module='openmmrigidhi.integrator')
Scheme.__doc__ = """The time-stepping schemes that setScheme() takes.

They are also class attributes of CustomRigidHIIntegrator. LangevinA, LangevinB and LangevinC (the
default) are thermostats of bodies with momenta. LangevinHI is LangevinC in a fluid that a
MobilityForce describes. GradientThermostat has neither momenta nor a fluid. All other schemes are
Brownian dynamics in a fluid, without momenta. They differ in how they make the stochastic drift, in
their cost, and in their error at finite steps.

Each scheme has its ``traits`` (orders, force evaluations and so on) and its own docstring. Each
also has a page with its equations, cost and limits. docs/schemes/README.md says which scheme to
take for which scene.
"""


def page(name: str, folder: str = 'docs/schemes/') -> str:
    """The page of a scheme."""
    return f'{folder}{name}.md'


def facts(traits: SchemeTraits) -> str:
    """The properties and costs of a scheme, in one sentence that its page also has."""
    cold = (f', and order {traits.coldOrder} at T = 0'
            if traits.coldOrder != traits.weakOrder else '')
    forces = f'{traits.forces} force evaluation{"s" if traits.forces > 1 else ""} a step'
    return (f'{"With" if traits.hasMomenta else "Without"} momenta, '
            f'{"in a fluid" if traits.needsFluid else "without a fluid"}; '
            f'weak order {traits.weakOrder}{cold}; {forces}.')


#: The equations that are integrated, by whether the scheme has momenta and a fluid. Angular
#: momentum l and torque tau are in the body frame, L and T in the lab frame.
EQUATIONS = {
    (True, False): """dR = p/m dt,   dp = f dt - gamma p dt + sqrt(2 m gamma kT) dw,
dl_k = (l x omega)_k dt + tau_k dt - Gamma_k l_k dt + sqrt(2 Gamma_k I_k kT) dW_k,
Gamma_k = Gamma M/(4 I_k),   M = 4/sum_k 1/I'_k over axes k with a moment;
I'_k = I_k, for rods as docs/schemes says""",
    (False, False): """dR = upsilon/m f dt + sqrt(2 upsilon kT/m) dw,
dq = Upsilon/M F dt + sqrt(2 Upsilon kT/M) sum_k S_k q o dW_k (Stratonovich),
F = 2 q (0, tau),   M = 4/sum_k 1/I'_k over axes k with a moment;
I'_k = I_k, for rods as docs/schemes says""",
    (True, True): """dR = p/m dt,   dp = f dt - (xi U)_V dt + noise,
dL = T dt - (xi U)_W dt + noise,
noise of covariance 2 kT xi dt, with velocities U of all bodies and their friction matrix xi""",
    (False, True): """dQ = N F dt + kT div N dt + sqrt(2 kT) N^(1/2) dW (Ito)
for poses Q, the mobility N(Q) of the MobilityForce and wrenches F""",
}


def _equation(traits):
    return textwrap.indent(EQUATIONS[traits.hasMomenta, traits.needsFluid], '    ')


for _scheme in Scheme:
    _traits = _scheme.traits
    _drift = f'It makes the stochastic drift {_traits.drift}.\n\n' if _traits.drift else ''
    _scheme.__doc__ = (
        f'{_traits.description}\n\n{facts(_traits)} What is '
        f'integrated::\n\n{_equation(_traits)}\n\n{_drift}'
        f'{page(_scheme.name)} has one step of it, every symbol, cost, limits and an example.')


def summary(indent: int = 4) -> str:
    """The list of schemes in a docstring, with an item for each kind."""
    kinds = (('with momenta, without a fluid', True, False), ('without momenta, without a fluid',
                                                              False, False),
             ('with momenta, in a fluid', True, True), ('without momenta, in a fluid', False, True))
    items = []
    for kind, momenta, fluid in kinds:
        names = [f'``{t.name}``' for t in TABLE if (t.hasMomenta, t.needsFluid) == (momenta, fluid)]
        items += textwrap.wrap(f'- {kind}: ' + ', '.join(names), 150 - indent,
                               subsequent_indent='  ')
    return ('\n' + ' '*indent).join(items)


def markdown(folder: str = '../schemes/', overdamped: Optional[bool] = None) -> str:
    """The table of schemes of the user guide and of the schemes' own pages.

    The pages lie in this folder, as seen from the file with the table. The guide has schemes
    without momenta in a fluid on one page, and all others on another one.
    """
    rows = [
        '| scheme | momenta | fluid | weak order | order at T = 0 | forces a step | |',
        '|---|---|---|---|---|---|---|'
    ]
    rows += [
        f'| [`{t.name}`]({page(t.name, folder)}) | {"yes" if t.hasMomenta else "no"} | '
        f'{"yes" if t.needsFluid else "no"} | {t.weakOrder} | '
        f'{t.coldOrder} | {t.forces} | {t.description} |' for t in TABLE
        if overdamped in (None, t.needsFluid and not t.hasMomenta)
    ]
    return '\n'.join(rows)
