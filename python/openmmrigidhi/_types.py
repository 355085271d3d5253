"""Names of types in the annotations of this package."""
import os
from typing import Any, Union

import numpy.typing as npt
from openmm import unit

#: A number in OpenMM's units, or a quantity of the argument's dimension.
Number = Union[float, unit.Quantity]
#: Vec3, sequences or arrays of numbers in OpenMM's units, or a quantity of the argument's
#: dimension.
Numbers = Union[npt.ArrayLike, unit.Quantity]
#: Numbers as an array.
Array = npt.NDArray[Any]
#: The path of a file or directory.
Path = Union[str, 'os.PathLike[str]']
