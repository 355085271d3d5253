"""Files of body states: positions, orientations and velocities of rigid bodies over time, in HDF5.

Layout, version 1 (n bodies, T frames, m particles in all bodies; doubles unless said otherwise; the unit of each data set
is its attribute "unit"):

    /                          attributes "format" = "openmmrigidhi body states", "version" = 1
    /time                      (T,)        ps
    /step                      (T,) int64
    /positions                 (T, n, 3)   nm, lab frame, unwrapped
    /orientations              (T, n, 4)   unit quaternions (w, x, y, z), body to lab frame
    /velocities                (T, n, 3)   nm/ps, lab frame
    /angularVelocities         (T, n, 3)   rad/ps, lab frame
    /boxVectors                (T, 3, 3)   nm, rows a, b, c
    /bodies/mass               (n,)        dalton
    /bodies/principalMoments   (n, 3)      dalton nm^2, about the body axes
    /bodies/particles          (m,) int32  particle indices, body after body
    /bodies/sitePositions      (m, 3)      nm, body frame
    /bodies/firstParticle      (n+1,) int32  where each body's particles begin in the two above
"""
import dataclasses
import itertools

import numpy as np
from openmm import unit

from .. import _units
from .trajectories import BodyReporter, openHdf5, readingFrom, rowsBefore

_FORMAT = 'openmmrigidhi body states'
_VERSION = 1

#: name: (shape of a frame with n bodies, type, dimension)
_FRAME_DATA = {
    'time': (lambda n: (), 'f8', _units.TIME),
    'step': (lambda n: (), 'i8', _units.NONE),
    'positions': (lambda n: (n, 3), 'f8', _units.LENGTH),
    'orientations': (lambda n: (n, 4), 'f8', _units.NONE),
    'velocities': (lambda n: (n, 3), 'f8', _units.VELOCITY),
    'angularVelocities': (lambda n: (n, 3), 'f8', _units.ANGULAR_VELOCITY),
    'boxVectors': (lambda n: (3, 3), 'f8', _units.LENGTH),
}
_BYTES_PER_CHUNK = 2**16


@dataclasses.dataclass
class BodyStates:
    """What a body-state file holds: T frames of n bodies."""

    time: unit.Quantity
    step: np.ndarray
    positions: unit.Quantity
    orientations: np.ndarray
    velocities: unit.Quantity
    angularVelocities: unit.Quantity
    boxVectors: unit.Quantity
    mass: unit.Quantity
    principalMoments: unit.Quantity
    particles: list
    sitePositions: list

    def __len__(self):
        return len(self.step)


class RigidBodyReporter(BodyReporter):
    """Writes the states of all bodies to an HDF5 file every so many steps (layout in openmmrigidhi.app.bodystates).

    Parameters
    ----------
    file : str or path
        name of the file
    reportInterval : int
        number of steps between frames
    append : bool
        continue an existing file of the same bodies. Frames at or after the step of the first new one are dropped, so that a
        run that is resumed from a checkpoint leaves the file of the uninterrupted run. A file that does not exist is
        created. Without append an existing file is replaced.

    Notes
    -----
    The file is closed between reports, so that it can be read while the run goes on and is whole if the run is killed
    between reports; that costs about two milliseconds a report.
    """

    def __init__(self, file, reportInterval, append=False):
        super().__init__(file, reportInterval, append)

    def _write(self, simulation, state, integrator):
        import h5py
        frame = {
            'time': state.getTime(), 'step': simulation.currentStep,
            'positions': integrator.getBodyPositions(), 'orientations': integrator.getBodyOrientations(),
            'velocities': integrator.getBodyVelocities(), 'angularVelocities': integrator.getBodyAngularVelocities(),
            'boxVectors': state.getPeriodicBoxVectors(asNumpy=True)}
        with h5py.File(self._file, 'r+') as file:
            count = _numFrames(file)
            for name, value in frame.items():
                dimension = _FRAME_DATA[name][2]
                file[name].resize(count + 1, axis=0)
                file[name][count] = dimension.strip(value, name, name) if unit.is_quantity(value) else value

    def _start(self, simulation, integrator):
        import h5py
        definition = _definition(integrator)
        if self._continues():
            with readingFrom(self._file, 'RigidBodyReporter:'), openHdf5(self._file, 'r+') as file:
                _checkSameBodies(file, definition, self._file)
                kept = rowsBefore(file['step'][:_numFrames(file)], simulation.currentStep)
                for name in _FRAME_DATA:
                    file[name].resize(kept, axis=0)
        else:
            with h5py.File(self._file, 'w') as file:
                _create(file, definition)


def readBodyStates(file):
    """Read a body-state file.

    Parameters
    ----------
    file : str or path
        name of the file

    Returns
    -------
    BodyStates
        arrays and Quantities over frames: time, step, positions (T, n, 3), orientations (T, n, 4), velocities,
        angularVelocities, boxVectors (T, 3, 3); and over bodies: mass, principalMoments (n, 3), particles and sitePositions
        (lists with one entry per body)

    Raises
    ------
    ValueError
        if the file is no body-state file of a known version
    """
    with readingFrom(file, 'readBodyStates:'), openHdf5(file, 'r') as handle:
        return _readStates(handle, file)


def _readStates(handle, file):
    _checkFormat(handle, file)
    count = _numFrames(handle)
    frames = {name: handle[name][:count] for name in _FRAME_DATA}
    bodies = handle['bodies']
    first = bodies['firstParticle'][:]
    particles, sites = bodies['particles'][:], bodies['sitePositions'][:]
    spans = list(zip(first[:-1], first[1:]))
    for name, (shape, _, _) in _FRAME_DATA.items():
        if frames[name].shape != (count, *shape(len(spans))):
            raise ValueError(f'readBodyStates: {file}: {name} has the shape {frames[name].shape}; with {count} frames of {len(spans)} bodies '
                             f'it must be {(count, *shape(len(spans)))}: the file is damaged, restore it from a copy')
    return BodyStates(**{name: _withUnit(values, _FRAME_DATA[name][2]) for name, values in frames.items()},
                      mass=_units.MASS.attach(bodies['mass'][:]),
                      principalMoments=_units.MOMENT.attach(bodies['principalMoments'][:]),
                      particles=[particles[a:b].tolist() for a, b in spans],
                      sitePositions=[_units.LENGTH.attach(sites[a:b]) for a, b in spans])


def _withUnit(array, dimension):
    return array if dimension is _units.NONE else dimension.attach(array)


def _numFrames(file):
    """Complete frames: a run that was killed while it wrote may have extended some data sets only."""
    return min(len(file[name]) for name in _FRAME_DATA)


def _definition(integrator):
    """The data sets of /bodies, with their units."""
    bodies = [integrator.getRigidBodyParameters(i) for i in range(integrator.getNumRigidBodiesOfContext())]
    counts = [len(particles) for particles, _, _, _ in bodies]
    return {
        'mass': (np.array([mass._value for _, mass, _, _ in bodies], dtype='f8'), _units.MASS),
        'principalMoments': (np.array([m._value for _, _, m, _ in bodies], dtype='f8').reshape(-1, 3), _units.MOMENT),
        'particles': (np.array(list(itertools.chain.from_iterable(p for p, _, _, _ in bodies)), dtype='i4'), _units.NONE),
        'sitePositions': (np.concatenate([s._value for _, _, _, s in bodies] or [np.empty((0, 3))]), _units.LENGTH),
        'firstParticle': (np.cumsum([0] + counts).astype('i4'), _units.NONE),
    }


def _create(file, definition):
    file.attrs['format'] = _FORMAT
    file.attrs['version'] = _VERSION
    count = len(definition['mass'][0])
    for name, (shape, dtype, dimension) in _FRAME_DATA.items():
        frame = shape(count)
        framesPerChunk = max(1, _BYTES_PER_CHUNK//(8*max(1, int(np.prod(frame)))))
        data = file.create_dataset(name, (0,) + frame, dtype, maxshape=(None,) + frame,
                                   chunks=(framesPerChunk,) + tuple(max(1, size) for size in frame))
        data.attrs['unit'] = '' if dimension is _units.NONE else dimension.label
    for name, (values, dimension) in definition.items():
        file.create_dataset('bodies/' + name, data=values).attrs['unit'] = \
            '' if dimension is _units.NONE else dimension.label


def _checkFormat(file, name):
    found, version = file.attrs.get('format'), file.attrs.get('version')
    if found != _FORMAT or version != _VERSION:
        raise ValueError(f"{name}: format '{found}' version {version}; it must be '{_FORMAT}' version {_VERSION}: "
                         'give a file that a RigidBodyReporter wrote')


def _checkSameBodies(file, definition, name):
    _checkFormat(file, name)
    for entry in ('particles', 'firstParticle'):
        if not np.array_equal(file['bodies'][entry][:], definition[entry][0]):
            raise ValueError(f'RigidBodyReporter: {name}: it holds other bodies ({len(file["bodies/mass"])}) than the '
                             f'integrator ({len(definition["mass"][0])}); to append they must be the same: '
                             'write to another file')
