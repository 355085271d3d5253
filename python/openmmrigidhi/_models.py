"""The tables of hydrodynamic models and of boundaries of the fluid, as the library has them.

These tables generate the enumerations, their docstrings and the tables of the pages.
"""
from __future__ import annotations

import enum
from typing import TYPE_CHECKING, NamedTuple, Sequence, Union

from . import _bindings

_DEFAULT = _bindings.MobilityForce()


class BoundaryTraits(NamedTuple):
    """The known properties of a boundary of the fluid."""

    name: str
    number: int
    isPeriodic: bool  # the fluid fills the periodic box of the Context
    wallAxis: int  # the axis that crosses the walls; -1: no walls
    numWalls: int  # 1: the fluid is above the wall; 2: it is between the walls
    walls: str  # what the walls do, a word; empty: no walls
    description: str

    @property
    def isDefault(self) -> bool:
        """Whether this is the default boundary of a MobilityForce."""
        return self.number == _DEFAULT.getBoundary()


class ModelTraits(NamedTuple):
    """The known properties of a model."""

    name: str
    number: int
    boundaries: tuple[str, ...]  # names of the boundaries that the model has
    grids: tuple[str,
                 ...]  # names of the boundaries with which a grid can take the place of matrices
    takesOverlap: bool  # spheres may overlap each other
    takesMultiblobs: bool  # and free particles and own tensors; if not, bodies are single spheres
    couplesBodies: bool
    interactions: str
    cost: str
    description: str

    @property
    def isDefault(self) -> bool:
        """Whether this is the default model of a MobilityForce."""
        return self.number == _DEFAULT.getModel()


BOUNDARIES = [BoundaryTraits(*row) for row in _bindings.boundaryTable()]
MODELS = [
    ModelTraits(name, number, tuple(boundaries.split()), tuple(grids.split()), *rest)
    for name, number, boundaries, grids, *rest in _bindings.modelTable()
]


class _BoundaryEnum(enum.IntEnum):
    @property
    def traits(self) -> BoundaryTraits:
        """The row of this boundary in the table, a BoundaryTraits."""
        return BOUNDARIES[self]


class _ModelEnum(enum.IntEnum):
    @property
    def traits(self) -> ModelTraits:
        """The row of this model in the table, a ModelTraits."""
        return MODELS[self]


if TYPE_CHECKING:
    from ._enumerations import Boundary, Model
else:
    Boundary = _BoundaryEnum('Boundary', {traits.name: traits.number
                                          for traits in BOUNDARIES},
                             module='openmmrigidhi.mobility')
    Model = _ModelEnum('Model', {traits.name: traits.number
                                 for traits in MODELS}, module='openmmrigidhi.mobility')
Boundary.__doc__ = """What bounds the fluid; also class attributes of MobilityForce.

Each boundary has its ``traits`` (whether it is periodic, where its walls are) and its own
docstring.
"""
Model.__doc__ = """The hydrodynamic models that setModel() takes.

They are also class attributes of MobilityForce.

Each model has its ``traits`` (boundaries, the bodies that it takes and so on) and its own
docstring. Each also has a page with its equations, boundaries, accuracy and cost.
docs/models/README.md says which model to take for which scene.
"""


def page(name: str, folder: str = 'docs/models/') -> str:
    """The page of a model."""
    return f'{folder}{name}.md'


def models_with(boundary: BoundaryTraits) -> list[str]:
    """The names of the models that have a boundary."""
    return [traits.name for traits in MODELS if boundary.name in traits.boundaries]


def _default(traits):
    return ' It is the default.' if traits.isDefault else ''


for _boundary in Boundary:
    _traits = _boundary.traits
    _boundary.__doc__ = (f'{_traits.description}{_default(_traits)}\n\n'
                         f'Models: {", ".join(models_with(_traits))}.')

for _model in Model:
    _traits = _model.traits
    _takes = ('spheres, multiblobs, free particles and own tensors'
              if _traits.takesMultiblobs else 'bodies of one sphere')
    _overlap = 'may' if _traits.takesOverlap else 'must not'
    _model.__doc__ = (f'{_traits.description}{_default(_traits)}\n\n'
                      f'It takes {_takes}. Particles {_overlap} overlap. '
                      f'Boundaries: {", ".join(_traits.boundaries)}. Cost: {_traits.cost}. '
                      f'{page(_traits.name)} has the rest.')


def summary(table: Sequence[Union[BoundaryTraits, ModelTraits]]) -> str:
    """The names of a table in a sentence of a docstring."""
    names = [f'{traits.name}{" (default)" if traits.isDefault else ""}' for traits in table]
    return ', '.join(names[:-1]) + ' and ' + names[-1]


def _code(names):
    return ', '.join(f'`{name}`' for name in names)


def markdown(folder: str = '../models/') -> str:
    """The table of models of the user guide and of the models' own pages.

    The pages lie in this folder, as seen from the file with the table.
    """
    rows = ['| model | bodies | interactions | boundaries | cost |', '|---|---|---|---|---|']
    for traits in MODELS:
        bodies = (('any' if traits.takesMultiblobs else 'spheres') +
                  (', overlapping or not' if traits.takesOverlap else ' without overlap'))
        default = ' (default)' if traits.isDefault else ''
        rows.append(f'| [`{traits.name}`]({page(traits.name, folder)}){default} | {bodies} | '
                    f'{traits.interactions} | {_code(traits.boundaries)} | {traits.cost} |')
    return '\n'.join(rows)


def markdown_of_boundaries() -> str:
    """The table of boundaries of the user guide and of the models' own pages."""
    rows = ['| boundary | what bounds the fluid | models |', '|---|---|---|']
    for traits in BOUNDARIES:
        default = ' (default)' if traits.isDefault else ''
        rows.append(f'| `{traits.name}`{default} | {traits.description} | '
                    f'{_code(models_with(traits))} |')
    return '\n'.join(rows)
