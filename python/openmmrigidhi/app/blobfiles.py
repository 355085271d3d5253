"""Vertex files and clones files: text files of rigid multiblobs.

RigidMultiblobsWall writes and reads such files. A vertex file says where a body's blobs are, and a
clones file where the copies of the body are. In both, ``#`` opens a comment, the first number is
the number of rows, and each row is a line of numbers. The unit of length is the choice of the
file's author.
"""
import os

import numpy as np

from .. import _units

#: A quaternion in a file may differ from unit length by its few printed digits, not by more.
_NORM_TOLERANCE = 1e-3
#: Quaternions this close to unit length are left alone, so that what writeClones wrote is read bit
#: for bit.
_ROUNDING = 1e-14


def readVertexFile(file, radii=False):
    """Read the positions of a body's blobs from a vertex file.

    The file has the number of blobs, then a row ``x y z`` for each blob, with an optional fourth
    number, the blob's radius. Text after the number of blobs on its line is ignored, as in
    RigidMultiblobsWall.

    Parameters
    ----------
    file : str or path
        name of the file
    radii : bool
        return the fourth column too

    Returns
    -------
    positions : array of shape (n, 3)
        body frame, in the file's unit of length
    radii : array of shape (n,)
        only with ``radii=True``

    Raises
    ------
    ValueError
        if the file is no vertex file, or if a radius that is asked for is negative; the message has
        the name of the file, the line, what was found there and what was expected
    OSError
        if there is no such file
    """
    radii = _units.boolean(radii, 'readVertexFile', 'radii')
    rows = _readRows(file, (4,) if radii else (3, 4), 'x y z radius' if radii else 'x y z', 'blobs')
    for line, values in rows:
        if radii and values[3] < 0:
            raise ValueError(
                f"{os.fspath(file)}, line {line}: found the radius {values[3]:g}; a blob's radius "
                f"is 0 or more: correct the row")
    rows = np.array([values for _, values in rows])
    return (rows[:, :3].copy(), rows[:, 3].copy()) if radii else rows


def readClones(file):
    """Read the places of a body's copies from a clones file.

    The file has the number of bodies, then a row ``x y z q0 q1 q2 q3`` for each body, with q0 the
    scalar part of the quaternion. Quaternions of few digits are normalised. A quaternion whose
    length differs from 1 by more than 1e-3 is an error.

    Parameters
    ----------
    file : str or path
        name of the file

    Returns
    -------
    positions : array of shape (n, 3)
        in the file's unit of length
    orientations : array of shape (n, 4)
        unit quaternions (w, x, y, z), body frame to lab frame

    Raises
    ------
    ValueError
        if the file is no clones file; the message has the name of the file, the line, what was
        found there and what was expected
    OSError
        if there is no such file
    """
    numbered = _readRows(file, (7,), 'x y z q0 q1 q2 q3', 'bodies')
    rows = np.array([values for _, values in numbered])
    norms = np.linalg.norm(rows[:, 3:], axis=1)
    for (line, _), norm in zip(numbered, norms):
        if abs(norm - 1) > _NORM_TOLERANCE:
            raise ValueError(
                f'{os.fspath(file)}, line {line}: found a quaternion of length {norm:.6g}; it must '
                f'be 1: normalise it')
    norms[np.abs(norms - 1) <= _ROUNDING] = 1
    return rows[:, :3].copy(), rows[:, 3:]/norms[:, None]


def writeClones(file, positions, orientations):
    """Write the places of bodies to a clones file, with 17 digits.

    :func:`readClones` reads the same numbers.

    Parameters
    ----------
    file : str or path
        name of the file; an existing file is replaced
    positions : array-like or Quantity of shape (n, 3)
        positions of the bodies; a Quantity is written in nm, numbers as they are
    orientations : array-like of shape (n, 4)
        unit quaternions (w, x, y, z), body frame to lab frame

    Raises
    ------
    ValueError
        for arrays of other shapes, for numbers that are not finite, or for quaternions whose length
        differs from 1 by more than 1e-3
    """
    positions = _units.rows(positions, _units.LENGTH, 3, 'writeClones', 'positions')
    orientations = _units.rows(orientations, _units.NONE, 4, 'writeClones', 'orientations',
                               len(positions))
    if len(positions) == 0:
        raise ValueError(
            'writeClones: positions: got no bodies to write; there must be at least one: give its '
            'position')
    rows = np.concatenate([positions, orientations], axis=1)
    norms = np.linalg.norm(orientations, axis=1)
    for body, (row, norm) in enumerate(zip(rows, norms)):
        if not np.all(np.isfinite(row)):
            raise ValueError(
                f'writeClones: body {body}: got {row}; a written pose must be finite: correct it')
        if abs(norm - 1) > _NORM_TOLERANCE:
            raise ValueError(
                f'writeClones: orientations: the quaternion of body {body} has length {norm:.6g}; '
                f'it must be 1: '
                'normalise before writing')
    with open(file, 'w', encoding='ascii') as output:
        output.write(
            '# number of bodies, then for each: x y z q0 q1 q2 q3 (q0 is the scalar part)\n')
        output.write(f'{len(rows)}\n')
        for row in rows:
            output.write(' '.join(repr(float(value)) for value in row) + '\n')


def _readRows(file, widths, names, what):
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
                    f"{what}; expected the end "
                    'of the file: correct the count at its top')
            else:
                rows.append((line, _numbers(words, name, line, widths, names)))
                widths = (len(words),)
    if count is None:
        raise ValueError(
            f'{name}, line {line}: found the end of the file; expected the number of {what}: check '
            f'that the file is '
            'complete')
    if len(rows) < count:
        raise ValueError(
            f'{name}, line {line}: found the end of the file after {len(rows)} rows; expected '
            f'{count} {what}: '
            'check the count at its top')
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
            f"positive integer: "
            'the first number of the file counts its rows')
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
            f"numbers, {names}: "
            'correct the row')
    return values
