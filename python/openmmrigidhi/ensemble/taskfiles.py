"""The HDF5 file of one task: its samples, and the state from which it goes on.

    about     JSON as bytes: settings, seed, progress, who computed the task when and with which
              versions
    state     the openmm.State at the last sample, XML as bytes
    memory/   what observables remember of earlier samples, where they say it
    series/   one dataset for each observable: (samples,), or (samples, replicas) for a scene that
              has independent replicas in it

A file is always written as a whole. All datasets and headers have checksums, which reveal damage.
"""
from __future__ import annotations

import contextlib
import glob
import io
import json
import os
import socket
from dataclasses import dataclass, field
from typing import Optional, Union

import h5py
import numpy as np

FORMAT = 'openmmrigidhi ensemble task 1'
PART = '.part'
#: What a file must say about its task.
REQUIRED = ('setting', 'replica', 'settings', 'seed', 'digest', 'sample_interval', 'position',
            'samples', 'exact', 'sessions')


class DamagedFile(ValueError):
    """A file that is not a whole file of a task; the message names the file."""


class UnreadableFile(DamagedFile):
    """A file that the system does not deliver; its content may be whole."""


def makeDirectory(path: str) -> None:
    """Make a directory if it does not exist.

    Parameters
    ----------
    path : str

    Raises
    ------
    NotADirectoryError
        if something else has this name
    """
    try:
        os.makedirs(path, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise NotADirectoryError(
            error.errno,
            f'{path}: it is, or is below, a file; it must be a directory, for the files of a '
            f'study: move that file away, or take another directory') from error


@dataclass
class TaskFile:
    """The content of a task's file.

    Attributes
    ----------
    about : dict
    state : str
        openmm.State as XML
    series : dict
        observable -> ndarray of samples
    memory : dict
        observable -> ndarray, its memory of earlier samples
    """

    about: dict
    state: str
    series: dict
    memory: dict = field(default_factory=dict)


def save(path: str, content: TaskFile) -> None:
    """Write a file as a whole.

    A reader finds the old file or the new file, even after a power cut.

    Parameters
    ----------
    path : str
    content : TaskFile
    """
    # The library's own writing to a full disk leaves messages of its own, and no plain error.
    buffer = io.BytesIO()
    # The newest format has checksums of its own structures, too.
    with h5py.File(buffer, 'w', libver='latest') as file:
        file.attrs['format'] = FORMAT
        _write(file, 'about', np.frombuffer(json.dumps(content.about).encode(), np.uint8))
        _write(file, 'state', np.frombuffer(content.state.encode(), np.uint8))
        for group, items in (('series', content.series), ('memory', content.memory)):
            for name, values in items.items():
                _write(file, f'{group}/{name}', np.asarray(values, dtype=float))
    # Two workers may write for the same task, if one of them was taken for dead.
    write(path, buffer.getbuffer(), f'{path}.{socket.gethostname()}.{os.getpid()}{PART}')


def _write(file, name, values):
    if values.size:
        file.create_dataset(name, data=values, chunks=True, compression='gzip', compression_opts=1,
                            shuffle=True, fletcher32=True)
    else:
        file.create_dataset(name, data=values)


def write(path: str, data: Union[bytes, memoryview], part: Optional[str] = None) -> None:
    """Write bytes as a file, as a whole, and flush it to the disk.

    Parameters
    ----------
    path : str
    data : bytes or memoryview
    part : str, optional
        the path of the file until it is whole; default: the path with PART

    Raises
    ------
    OSError
        if this is not possible; an existing file then stays unchanged
    """
    part = path + PART if part is None else part
    try:
        with open(part, 'wb') as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
        directory = os.open(os.path.dirname(os.path.abspath(path)), os.O_RDONLY)
        try:
            os.fsync(directory)
        finally:
            os.close(directory)
    except OSError as error:
        raise OSError(
            error.errno,
            f'{path}: it cannot be written ({error.strerror}); there must be space and permission '
            f'for it: make room, then go on; what was saved before is kept') from error
    finally:
        with contextlib.suppress(OSError):
            os.remove(part)


def load(path: str, expected: Optional[dict] = None) -> Optional[TaskFile]:
    """Read a task's file.

    Parameters
    ----------
    path : str
    expected : dict, optional
        the required entries about its task, where the file has them

    Returns
    -------
    TaskFile or None
        None if the file does not exist

    Raises
    ------
    DamagedFile
    UnreadableFile
        if the system does not deliver the file
    """
    if not os.path.exists(path):
        return None
    # HDF5 would want to lock the file, which some file systems refuse.
    try:
        with open(path, 'rb') as file:
            data = io.BytesIO(file.read())
    except OSError as error:
        raise UnreadableFile(
            f'{path}: it cannot be read ({error.strerror}); this process must be allowed to read '
            f'it: set its permissions, or wait until its disk is there again') from error
    try:
        with h5py.File(data, 'r') as file:
            found = file.attrs.get('format')
            if found != FORMAT:
                raise ValueError(f'its format is {found!r} instead of {FORMAT!r}')
            about = json.loads(file['about'][()].tobytes())
            # A group that damage has hidden must not look like one that is not there.
            content = TaskFile(
                about, file['state'][()].tobytes().decode(),
                {name: values[()]
                 for name, values in file['series'].items()},
                {name: file['memory'][name][()]
                 for name in about.get('remember', [])})
        missing = [key for key in REQUIRED if key not in about]
        if missing:
            raise ValueError(f'it does not say its {missing[0]}')
        for key, value in (expected or {}).items():
            if about.get(key, value) != value:
                raise ValueError(f'it is of another task: its {key} is {about[key]!r} instead of '
                                 f'{value!r}')
        samples = content.about['samples']
        wrong = [name for name, values in content.series.items() if len(values) != samples]
        if wrong:
            raise ValueError(
                f'{wrong[0]} has {len(content.series[wrong[0]])} samples where {samples} are said '
                f'to be')
        return content
    # HDF5 and its Python binding raise errors of many kinds.
    except Exception as error:
        raise DamagedFile(
            f'{path}: it is damaged ({type(error).__name__}: {error}); it must be a whole file of '
            f'a task: put a copy back, or run the '
            'study again, which puts it aside and does this task anew') from error


def clean(directory: str) -> None:
    """Remove what interrupted writers left behind.

    Parameters
    ----------
    directory : str
    """
    for path in glob.glob(os.path.join(glob.escape(directory), '*' + PART)):
        os.remove(path)
