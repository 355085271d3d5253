"""Vertex files and clones files: text files of rigid multiblobs.

RigidMultiblobsWall writes and reads such files. A vertex file gives the positions of a body's
blobs, and a clones file the poses of the body's copies. In both, ``#`` opens a comment, the first
number is the number of rows, and each row is a line of numbers. The author of a file chooses the
unit of length, often micrometers or the radius of a blob. The file does not name it.
"""
from __future__ import annotations

import os
import warnings
from typing import TYPE_CHECKING, Literal, Optional, Union, overload

import numpy as np
from openmm import unit as units

from .. import _units
from .._types import Array, Number, Numbers, Path
from .trajectories import NORM_TOLERANCE, lengths

if TYPE_CHECKING:
    import numpy.typing as npt

#: Neighbouring blobs of a body are about a diameter apart. Lengths in two units differ by 1000 or
#: more. So spacings in diameters beyond these bounds are most likely of two units, which are found
#: if the true spacing is between half a diameter and five diameters.
_ODD_SPACINGS = 1/200, 500


@overload
def readVertexFile(file: Path, radii: Literal[False] = False,
                   unit: Optional[Union[units.Unit, Number]] = None) -> Array:
    ...


@overload
def readVertexFile(file: Path, radii: Literal[True],
                   unit: Optional[Union[units.Unit, Number]] = None) -> tuple[Array, Array]:
    ...


def readVertexFile(
        file: Path, radii: bool = False,
        unit: Optional[Union[units.Unit, Number]] = None) -> Union[Array, tuple[Array, Array]]:
    """Read the positions of a body's blobs from a vertex file.

    The file has the number of blobs, then a row ``x y z`` for each blob, with an optional fourth
    number, the blob's radius. Text after the number of blobs on its line is ignored, as in
    RigidMultiblobsWall.

    Parameters
    ----------
    file : str or path
        name of the file
    radii : bool
        also return the fourth column
    unit : openmm.unit.Unit, Quantity or float, optional
        the file's unit of length, as ``unit.micrometer``, ``0.5*unit.micrometer`` or in nm; None:
        return the numbers of the file unchanged, as nm

    Returns
    -------
    positions : array of shape (n, 3)
        body frame, nm
    radii : array of shape (n,)
        nm, only with ``radii=True``. A warning appears where the blobs are so near or far that the
        radii seem to be in another unit.

    Raises
    ------
    TypeError, ValueError
        for a unit that is no length; if the file is no vertex file, or if a requested radius is
        negative; the message has the name of the file, the line, the found text and the expected
        text
    OSError
        if the file does not exist
    """
    withRadii = _units.boolean(radii, 'readVertexFile', 'radii')
    scale = _length_of(unit, 'readVertexFile')
    rows = _read_rows(file, (4,) if withRadii else (3, 4), 'x y z radius' if withRadii else 'x y z',
                      'blobs')
    for line, values in rows:
        if withRadii and values[3] < 0:
            raise ValueError(
                f"{os.fspath(file)}, line {line}: found the radius {values[3]:g}; a blob's radius "
                'is 0 or more')
    rows = np.array([values for _, values in rows])*scale
    if not withRadii:
        return rows
    positions, found = rows[:, :3].copy(), rows[:, 3].copy()
    warnOfUnits(positions, found, f'readVertexFile: {os.fspath(file)}')
    return positions, found


def warnOfUnits(positions: Array, radii: Array, where: str) -> None:
    """Warn where the blobs of a body are so near or far that lengths seem to be in two units.

    Parameters
    ----------
    positions : array of shape (n, 3)
        nm
    radii : array of shape (n,)
        nm; blobs of radius 0 are left out
    where : str
        for the message
    """
    from scipy.spatial import cKDTree
    positions, radii = np.asarray(positions)[np.asarray(radii) > 0], np.asarray(radii)
    radii = radii[radii > 0]
    if len(radii) < 2 or not (np.isfinite(positions).all() and np.isfinite(radii).all()):
        return
    nearest = cKDTree(positions).query(positions, k=2)[0][:, 1]
    spacings = nearest/(2*radii)
    if _ODD_SPACINGS[0] <= spacings.max() and spacings.min() <= _ODD_SPACINGS[1] or not nearest.any(
    ):
        return
    blob = int(np.argmax(nearest))
    warnings.warn(
        f'{where}: blob {blob} of radius {radii[blob]:.6g} nm is {nearest[blob]:.6g} nm from the '
        f'next blob, and the others are as odd: positions and radii seem to be in different units '
        f'of length; give both in nm, as by unit= of the readers of files', stacklevel=3)


def _length_of(unit, where):
    """A unit of length in nm."""
    if unit is None:
        return 1.0
    scale = _units.number(1*unit if units.is_unit(unit) else unit, _units.LENGTH, where, 'unit')
    if not 0 < scale < np.inf:
        raise ValueError(f'{where}: unit: got {scale} nm; a unit of length must be positive and '
                         f'finite: give for example unit.micrometer')
    return scale


def readClones(file: Path, unit: Optional[Union[units.Unit, Number]] = None) -> tuple[Array, Array]:
    """Read the poses of a body's copies from a clones file.

    The file has the number of bodies, then a row ``x y z q0 q1 q2 q3`` for each body, with q0 the
    scalar part of the quaternion. Quaternions of few digits are normalised. A quaternion whose
    length differs from 1 by more than 1e-3 is an error.

    Parameters
    ----------
    file : str or path
        name of the file
    unit : openmm.unit.Unit, Quantity or float, optional
        the file's unit of length, as ``unit.micrometer``, ``0.5*unit.micrometer`` or in nm; None:
        return the numbers of the file unchanged, as nm

    Returns
    -------
    positions : array of shape (n, 3)
        nm
    orientations : array of shape (n, 4)
        unit quaternions (w, x, y, z), body frame to lab frame

    Raises
    ------
    TypeError, ValueError
        for a unit that is no length; if the file is no clones file; the message has the name of the
        file, the line, the found text and the expected text
    OSError
        if the file does not exist
    """
    scale = _length_of(unit, 'readClones')
    numbered = _read_rows(file, (7,), 'x y z q0 q1 q2 q3', 'bodies')
    rows = np.array([values for _, values in numbered])
    norms = lengths(rows[:, 3:])
    for (line, _), norm in zip(numbered, norms):
        if abs(norm - 1) > NORM_TOLERANCE:
            raise ValueError(
                f'{os.fspath(file)}, line {line}: found a quaternion of length {norm:.6g}; it must '
                f'be 1: normalise it')
    return rows[:, :3]*scale, rows[:, 3:]/norms[:, None]


def writeClones(file: Path, positions: Numbers, orientations: npt.ArrayLike,
                unit: Optional[Union[units.Unit, Number]] = None) -> None:
    """Write the poses of bodies to a clones file, with 17 digits.

    :func:`readClones` reads the same numbers.

    Parameters
    ----------
    file : str or path
        name of the file; an existing file is replaced
    positions : array-like or Quantity of shape (n, 3)
        positions of the bodies, nm
    orientations : array-like of shape (n, 4)
        unit quaternions (w, x, y, z), body frame to lab frame
    unit : openmm.unit.Unit, Quantity or float, optional
        the file's unit of length, as ``unit.micrometer``, ``0.5*unit.micrometer`` or in nm; None:
        nm, so that numbers are written as they are

    Raises
    ------
    TypeError
        for a unit that is no length
    ValueError
        for arrays of other shapes, for numbers that are not finite, or for quaternions whose length
        differs from 1 by more than 1e-3
    """
    positions = _units.rows(positions, _units.LENGTH, 3, 'writeClones', 'positions')
    positions = positions/_length_of(unit, 'writeClones')
    orientations = _units.rows(orientations, _units.NONE, 4, 'writeClones', 'orientations',
                               len(positions))
    if len(positions) == 0:
        raise ValueError(
            'writeClones: positions: got no bodies to write; at least one is needed: give its '
            'position')
    rows = np.concatenate([positions, orientations], axis=1)
    norms = lengths(orientations)
    for body, (row, norm) in enumerate(zip(rows, norms)):
        if not np.all(np.isfinite(row)):
            raise ValueError(f'writeClones: body {body}: got {row}; a written pose must be finite')
        if abs(norm - 1) > NORM_TOLERANCE:
            raise ValueError(
                f'writeClones: orientations: the quaternion of body {body} has length {norm:.6g}; '
                'it must be 1: normalise before writing')
    with open(file, 'w', encoding='ascii') as output:
        output.write(
            '# number of bodies, then for each: x y z q0 q1 q2 q3 (q0 is the scalar part)\n')
        output.write(f'{len(rows)}\n')
        for row in rows:
            output.write(' '.join(repr(float(value)) for value in row) + '\n')


def _read_rows(file, widths, names, what):
    """The rows of a file as (line number, numbers); all rows have one of the allowed widths."""
    name = os.fspath(file)
    count, rows, line = None, [], 0
    with open(file, encoding='utf-8', errors='replace') as lines:
        for line, text in enumerate(lines, 1):
            words = text.split('#', 1)[0].split()
            if not words:
                continue
            if count is None:
                count = _count(words[0], name, line, what)
            elif len(rows) == count:
                raise ValueError(
                    f"{name}, line {line}: found '{text.strip()}' after the last of {count} "
                    f"{what}; expected the end of the file")
            else:
                rows.append((line, _numbers(words, name, line, widths, names)))
                widths = (len(words),)
    if count is None:
        raise ValueError(
            f'{name}, line {line}: found the end of the file; expected the number of {what}: check '
            'that the file is complete')
    if len(rows) < count:
        raise ValueError(
            f'{name}, line {line}: found the end of the file after {len(rows)} rows; expected '
            f'{count} {what}: check the count at its top')
    return [(line, values[:3] if widths == (4,) and names == 'x y z' else values)
            for line, values in rows]


def _count(word, name, line, what):
    try:
        count = int(word)
    except ValueError:
        count = 0
    if count < 1:
        raise ValueError(
            f"{name}, line {line}: found '{word}' where the number of {what} should be; expected a "
            'positive integer: the first number of the file counts its rows')
    return count


def _numbers(words, name, line, widths, names):
    """A row's numbers, which must be finite."""
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) not in widths or not np.all(np.isfinite(values)):
        expected = ' or '.join(map(str, widths))
        raise ValueError(
            f"{name}, line {line}: found the row '{' '.join(words)}'; expected {expected} finite "
            f"numbers, {names}")
    return values
