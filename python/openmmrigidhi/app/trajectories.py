"""Shared parts of body trajectory files: the reporters' frame, scenes, and readers' results."""
from __future__ import annotations

import contextlib
import dataclasses
import os
from typing import TYPE_CHECKING, Iterator, Optional, Sequence

import numpy as np
from openmm import unit

from .. import _units
from .._types import Array, Numbers, Path
from .._systems import BodyDefinitions, hydrodynamic_radii
from ..integrator import CustomRigidHIIntegrator

if TYPE_CHECKING:
    import h5py
    import numpy.typing as npt
    import openmm.app

#: Bodies whose sites and radii agree within this length, nm, are of one type.
_SAME_SHAPE = 1e-6
#: No compression in HDF5 makes data smaller by a larger factor.
_MOST_COMPRESSED = 1100
#: Chunks of HDF5 data sets with one row a frame have this size.
_BYTES_PER_CHUNK = 2**16
#: Times of frames at equal intervals may be off by the rounding of single precision.
_EVEN_FRAMES = 1e-6
#: A quaternion in a file may differ from unit length by its few printed digits, not by more.
NORM_TOLERANCE = 1e-3
#: Quaternions this close to unit length are left alone, so that what this package wrote in double
#: precision is read bit for bit.
_ROUNDING = 1e-14


class BodyReporter:
    """The common part of reporters of body states.

    Use one of RigidBodyReporter, GsdReporter, H5mdReporter.

    Parameters
    ----------
    file : str or path
        name of the file
    reportInterval : int
        number of steps between frames
    append : bool
        continue an existing file

    Raises
    ------
    TypeError, ValueError
        for an interval that is not a positive integer
    """

    _needsPositions = _needsVelocities = False

    def __init__(self, file: Path, reportInterval: int, append: bool) -> None:
        self._file = os.fspath(file)
        self._name = type(self).__name__
        self._reportInterval = _units.integer(reportInterval, self._name, 'reportInterval')
        if self._reportInterval <= 0:
            raise ValueError(
                f'{self._name}: reportInterval: got {self._reportInterval}; it must be positive: '
                'give a number of steps')
        self._append = append
        self._started = False
        self._firstStep = None

    def describeNextReport(self, simulation: openmm.app.Simulation) -> tuple:
        """Tell the Simulation when the next report is due, and what the report needs.

        The report needs unwrapped positions.
        """
        if self._firstStep is None:
            self._firstStep = simulation.currentStep
        steps = self._reportInterval - simulation.currentStep % self._reportInterval
        return (steps, self._needsPositions, self._needsVelocities, False, False,
                False if self._needsPositions else None)

    def report(self, simulation: openmm.app.Simulation, state: openmm.State) -> None:
        """Write one frame."""
        integrator = CustomRigidHIIntegrator.cast(simulation.context.getIntegrator())
        if not self._started:
            self._start(simulation, integrator)
            self._started = True
        self._write(simulation, state, integrator)

    def _continues(self):
        """Whether a file to continue exists."""
        return self._append and os.path.exists(self._file)

    def _rows_before(self, steps, step):
        """The number of the file's frames before the first new frame, which is at a step."""
        first = step if self._firstStep is None else self._firstStep
        return rowsBefore(steps, step, first, f'{self._name}: {self._file}')


class Hdf5Reporter(BodyReporter):
    """The common part of reporters into HDF5 files.

    A subclass defines its record by _describe, _create, _check_same, _series and _frame.

    Parameters
    ----------
    file, reportInterval, append
        as in BodyReporter
    """

    #: The data set of step numbers.
    _STEPS = 'step'

    def _start(self, simulation, integrator):
        import h5py
        self._describe(simulation, integrator)
        if self._continues():
            with readingFrom(self._file, f'{self._name}:'), openHdf5(self._file, 'r+') as file:
                self._check_same(file)
                kept = self._rows_before(file[self._STEPS][:numFrames(self._series(file))],
                                         simulation.currentStep)
                for data in self._series(file):
                    data.resize(kept, axis=0)
        else:
            with h5py.File(self._file, 'w') as file:
                self._create(file)

    def _write(self, simulation, state, integrator):
        import h5py
        frame = self._frame(simulation, state, integrator)
        with h5py.File(self._file, 'r+') as file:
            count = numFrames(self._series(file))
            for name, value in frame.items():
                file[name].resize(count + 1, axis=0)
                file[name][count] = value


def addSeries(group: h5py.Group, name: str, shape: tuple[int, ...],
              kind: str = 'f8') -> h5py.Dataset:
    """Add a data set for arrays of a shape, one for each frame, without rows yet.

    Parameters
    ----------
    group : h5py.Group
    name : str
    shape : tuple of int
    kind : str
        type of the numbers, of 8 bytes

    Returns
    -------
    h5py.Dataset
    """
    rows = max(1, _BYTES_PER_CHUNK // (8*max(1, int(np.prod(shape)))))
    return group.create_dataset(name, (0,) + shape, kind, maxshape=(None,) + shape,
                                chunks=(rows,) + tuple(max(1, size) for size in shape))


def numFrames(series: Sequence[h5py.Dataset]) -> int:
    """Get the number of complete frames.

    A run that was killed while it wrote may have extended only some of the data sets.

    Parameters
    ----------
    series : sequence of h5py.Dataset
        with one row a frame
    """
    return min(map(len, series))


@dataclasses.dataclass
class Trajectory:
    """The content of a trajectory file: T frames of n bodies.

    Attributes
    ----------
    time : Quantity of shape (T,)
        ps
    step : array of shape (T,)
        step numbers
    positions : Quantity of shape (T, n, 3)
        origins of the bodies, lab frame, unwrapped, nm
    orientations : array of shape (T, n, 4)
        unit quaternions (w, x, y, z), body frame to lab frame
    velocities, angularVelocities : Quantity of shape (T, n, 3), or None
        nm/ps and rad/ps, lab frame; None if the file has none
    boxVectors : Quantity of shape (T, 3, 3), or None
        rows a, b, c, nm; None without periodic boundaries; in two dimensions c may be 0
    types : list of str
        name of the type of each body
    blobPositions : Quantity of shape (T, m, 3), or None
        the hydrodynamic particles, nm; None if the file has none
    blobRadii : Quantity of shape (m,), or None
        their radii, nm
    blobBodies : array of shape (m,), or None
        the body of each blob; -1: a free particle
    sites : list of Quantity of shape (s, 3), or None
        for each body its particles, or its particles with a radius, body frame, nm; None if the
        file does not have them
    siteRadii : list of Quantity of shape (s,), or None
        radii of the sites, nm; 0: none
    """

    time: unit.Quantity
    step: np.ndarray
    positions: unit.Quantity
    orientations: np.ndarray
    velocities: unit.Quantity = None
    angularVelocities: unit.Quantity = None
    boxVectors: unit.Quantity = None
    types: list = None
    blobPositions: unit.Quantity = None
    blobRadii: unit.Quantity = None
    blobBodies: np.ndarray = None
    sites: list = None
    siteRadii: list = None

    def __len__(self):
        return len(self.step)

    @property
    def frameInterval(self) -> unit.Quantity:
        """The time between frames, a Quantity in ps, for the functions of openmmrigidhi.analysis.

        Raises
        ------
        ValueError
            if the file has fewer than two frames, or their intervals differ
        """
        times = self.time.value_in_unit(unit.picosecond)
        if len(times) < 2:
            raise ValueError(
                f'Trajectory.frameInterval: the trajectory has {len(times)} frames; an interval '
                'needs at least two: run longer')
        interval = (times[-1] - times[0])/(len(times) - 1)
        gaps = np.diff(times)
        worst = int(np.argmax(np.abs(gaps - interval)))
        if abs(gaps[worst] - interval) > _EVEN_FRAMES*max(abs(interval), abs(times[-1])):
            raise ValueError(
                f'Trajectory.frameInterval: frames {worst} and {worst + 1} are {gaps[worst]:g} ps '
                f'apart, on average it is '
                f'{interval:g} ps; frames must be at equal intervals: take a part of the trajectory'
            )
        return _units.TIME.attach(interval)


class BodyScene(BodyDefinitions):
    """The bodies of an integrator as trajectory files describe them: types, radii, blobs.

    Parameters
    ----------
    integrator : CustomRigidHIIntegrator
        bound to a Context with positions
    system : openmm.System
        gives radii, by its MobilityForce, and periodic boundaries
    types : sequence of str or None
        a name for each body; None: bodies of equal sites and radii get one name
    radii : sequence or Quantity or None
        radius of each particle of the System, nm; None: the radii of the MobilityForce
    blobs : bool
        whether to include particles with a radius
    where : str
        name of the caller, for error messages
    """
    def __init__(self, integrator: CustomRigidHIIntegrator, system: openmm.System,
                 types: Optional[Sequence[str]], radii: Optional[Numbers], blobs: bool,
                 where: str) -> None:
        super().__init__(integrator)
        if not len(self):
            raise ValueError(
                f'{where}: the integrator has no rigid bodies to write: add bodies before')
        self.radii = hydrodynamic_radii(system, radii, where)
        self.periodic = system.usesPeriodicBoundaryConditions()
        self.typeNames, self.typeIndices = self._types(types, where)
        owner = dict(zip(self.members.tolist(), self.owners.tolist()))
        self.blobs = np.flatnonzero(self.radii > 0) if blobs else np.empty(0, dtype=int)
        if blobs and not len(self.blobs):
            raise ValueError(
                f'{where}: blobs: no particle has a radius; blobs need one: give radii, or add a '
                f'MobilityForce')
        self.blobBodies = np.array([owner.get(int(particle), -1) for particle in self.blobs],
                                   dtype=int)

    def spheres(self, body: int) -> tuple[Array, Array]:
        """Places (m, 3) in the body frame and radii (m,) of a body's particles with radii, nm."""
        radii = self.radii[self.particles[body]]
        return self.sites[body][radii > 0], radii[radii > 0]

    def _types(self, types, where):
        """Names of types, and the type of each body; all bodies of a type have one shape."""
        if types is None:
            names, representatives, indices = [], [], []
            for body in range(len(self)):
                found = next(
                    (k for k, other in enumerate(representatives) if self._alike(body, other)),
                    None)
                if found is None:
                    found = len(names)
                    names.append(f'body{found}')
                    representatives.append(body)
                indices.append(found)
            return names, np.array(indices)
        types = list(types)
        if len(types) != len(self) or not all(
                isinstance(name, str) and name and name.isascii() for name in types):
            raise ValueError(
                f'{where}: types: got {types} for {len(self)} bodies; each body needs one, '
                'of ASCII characters')
        names = list(dict.fromkeys(types))
        indices = np.array([names.index(name) for name in types])
        for body, kind in enumerate(indices):
            first = int(np.argmax(indices == kind))
            if not self._alike(body, first):
                raise ValueError(
                    f'{where}: types: bodies {first} and {body} are both {names[kind]!r}, but have '
                    'different sites or radii; a type has one shape: give them different names')
        return names, indices

    def _alike(self, one, other):
        a, b = self.sites[one], self.sites[other]
        return a.shape == b.shape and np.allclose(a, b, rtol=0, atol=_SAME_SHAPE) and \
            np.allclose(self.radii[self.particles[one]], self.radii[self.particles[other]], rtol=0,
            atol=_SAME_SHAPE)


def openHdf5(file: Path, mode: str) -> h5py.File:
    """Open an existing HDF5 file, with mode "r" or "r+".

    h5py's own error for another kind of file does not name the file.

    Raises
    ------
    ValueError
        if the file exists and is no HDF5 file
    OSError
        if the file does not exist
    """
    import h5py
    name = os.fspath(file)
    if os.path.isfile(name) and not h5py.is_hdf5(name):
        raise ValueError(f'{name}: it is no HDF5 file, which this one must be: give another file')
    opened = h5py.File(name, mode)

    def check_size(path, item):
        # HDF5 gives what was never written as zeros, so a damaged shape would fill the memory.
        if isinstance(item, h5py.Dataset) and item.nbytes > _MOST_COMPRESSED*os.path.getsize(name):
            raise ValueError(
                f'{name}: data set {path} has the shape {item.shape}, {item.nbytes:.3g} bytes; in '
                f'a file of {os.path.getsize(name)} bytes there is no room for it: the file is '
                'damaged, restore it from a copy')

    try:
        opened.visititems(check_size)
    except BaseException:
        opened.close()
        raise
    return opened


@contextlib.contextmanager
def readingFrom(file: Path, what: str) -> Iterator[None]:
    """Turn what a library raises while it reads a damaged file into a ValueError.

    The ValueError names the file. Messages of this package already name the file and pass. So do
    the operating system's errors about missing or unreadable files.
    """
    name = os.fspath(file)
    with open(name, 'rb'):
        pass  # libraries have errors of their own for that
    try:
        yield
    except ImportError:
        raise
    except Exception as error:
        if type(error) is ValueError and name in str(error):
            raise
        raise ValueError(
            f'{what} {name}: it is damaged, or of another kind ({type(error).__name__}: '
            f'{str(error)[:200]}); it must be whole: '
            'restore it from a copy, or write it anew') from error


def checkedFrames(frames: Optional[slice], where: str) -> slice:
    """The requested frames of a reader, as a slice.

    Parameters
    ----------
    frames : slice or None
        None: all
    where : str
        name of the caller, for error messages

    Raises
    ------
    TypeError, ValueError
        if frames is no slice, or goes backwards
    """
    if frames is None:
        return slice(None)
    try:
        step = frames.indices(1)[2]
    except (AttributeError, TypeError, ValueError):
        raise TypeError(f'{where}: frames: got {frames!r}; it must be a slice of integers or None: '
                        f'give for example slice(0, 100) for the first 100 frames') from None
    if step < 1:
        raise ValueError(
            f'{where}: frames: got {frames!r}; frames are read in the order of the file: give a '
            f'slice with a positive step')
    return frames


def requireFinite(values: Optional[Array], name: str, where: str, frames: Optional[Sequence[int]],
                  item: Optional[str] = 'body') -> None:
    """Refuse numbers from a file that are not finite.

    Parameters
    ----------
    values : array of shape (T, ...) or None
    name : str
        name of the numbers
    where : str
        reader and file, for error messages
    frames : sequence of int or None
        number of each frame in the file; None: the numbers are the same in all frames, and values
        has no axis of frames
    item : str or None
        name of the entries along the next axis of values; None: no such axis

    Raises
    ------
    ValueError
        naming frame, item and value
    """
    if values is None or np.isfinite(values).all():
        return
    place = tuple(np.argwhere(~np.isfinite(values))[0])
    axes = [] if frames is None else [f'frame {frames[place[0]]}']
    axes += [f'{item} {place[len(axes)]}'] if item else []
    remedy = 'restore the file from a copy' if frames is None else _other_frames(frames[place[0]])
    raise ValueError(f'{where}: {", ".join(axes)}: {name} is {_shown(values[place[:len(axes)]])}; '
                     f'numbers in a file must be finite: {remedy}')


def unitQuaternions(orientations: Array, where: str, frames: Sequence[int]) -> Array:
    """Get unit quaternions from the quaternions of a file, which may have few digits.

    Parameters
    ----------
    orientations : array of shape (T, n, 4)
    where : str
        reader and file, for error messages
    frames : sequence of int
        number of each frame in the file

    Returns
    -------
    array of shape (T, n, 4)

    Raises
    ------
    ValueError
        naming frame, body and value, if the length of a quaternion is not 1 or not finite
    """
    norms = lengths(orientations)
    bad = ~(np.abs(norms - 1) <= NORM_TOLERANCE)
    if bad.any():
        place = tuple(np.argwhere(bad)[0])
        raise ValueError(
            f'{where}: frame {frames[place[0]]}, body {place[1]}: orientation is '
            f'{_shown(orientations[place])}, of length {norms[place]:.6g}; a unit quaternion has '
            f'the length 1: correct it, or {_other_frames(frames[place[0]])}')
    return orientations/norms[..., None]


def lengths(orientations: Array) -> Array:
    """Lengths of quaternions (..., 4), exactly 1 where they are 1 up to rounding."""
    # A length beyond all numbers is infinite, and not 1.
    with np.errstate(over='ignore', invalid='ignore'):
        norms = np.linalg.norm(orientations, axis=-1)
        return np.where(np.abs(norms - 1) <= _ROUNDING, 1.0, norms)


def _shown(values):
    """A number, or a row of numbers, as text."""
    return np.array2string(np.asarray(values), precision=6).replace('\n', '')


def _other_frames(frame):
    """The remedy for a frame that cannot be used."""
    part = f'slice({frame}) for those before' if frame > 0 else 'slice(1, None) for those after'
    return f'read other frames, as by frames={part}'


def rowsBefore(steps: npt.ArrayLike, step: int, firstStep: int, where: str) -> int:
    """Get the number of a file's frames, with these steps, before the first new frame.

    The first new frame is at the given step. A resumed run replaces the frames from this step on.

    Parameters
    ----------
    steps : array-like of shape (frames,)
    step : int
    firstStep : int
        where the run began that writes the new frame
    where : str
        the beginning of messages

    Raises
    ------
    ValueError
        if the run began at step 0, for then it continues no other run
    """
    if firstStep == 0 and len(steps) > 0:
        raise ValueError(
            f'{where}: append: the file has {len(steps)} frames or lines up to step {steps[-1]}, '
            'and this run began at step 0, so that it does not continue them; load the State or '
            'checkpoint of the run that is to go on, or write to another file, or remove this one')
    return int(np.searchsorted(steps, step))
