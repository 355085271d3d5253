"""Files of body states: positions, orientations and velocities of rigid bodies over time, in HDF5.

Layout version 1 has n bodies, T frames, and m particles in all bodies. Numbers are doubles unless
the table says otherwise. The unit of each data set is its attribute "unit":

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
from __future__ import annotations

import dataclasses
from typing import Optional

import numpy as np
from openmm import unit

from .. import _units
from .._types import Path
from .._systems import BodyDefinitions
from .trajectories import (Hdf5Reporter, addSeries, checkedFrames, numFrames, openHdf5, readingFrom,
                           requireFinite, unitQuaternions)

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


@dataclasses.dataclass
class BodyStates:
    """The content of a body-state file: T frames of n bodies."""

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


class RigidBodyReporter(Hdf5Reporter):
    """Writes the states of all bodies to an HDF5 file, once per interval of steps.

    openmmrigidhi.app.bodystates describes the layout of the file.

    Parameters
    ----------
    file : str or path
        name of the file
    reportInterval : int
        number of steps between frames
    append : bool
        continue an existing file of the same bodies. Frames at or after the step of the first new
        frame are dropped. So a run resumed from a checkpoint leaves the same file as the
        uninterrupted run. If the new run began at step 0, the first report raises ValueError. A
        file that does not exist is created. Without append an existing file is replaced.

    Notes
    -----
    The file is closed between reports. You can read it during the run, and it is whole if the run
    is killed between reports. Closing costs about two milliseconds a report.
    """
    def __init__(self, file: Path, reportInterval: int, append: bool = False) -> None:
        super().__init__(file, reportInterval, append)

    def _frame(self, simulation, state, integrator):
        return {
            'time': state.getTime()._value,
            'step': simulation.currentStep,
            'positions': integrator.getBodyPositions()._value,
            'orientations': integrator.getBodyOrientations(),
            'velocities': integrator.getBodyVelocities()._value,
            'angularVelocities': integrator.getBodyAngularVelocities()._value,
            'boxVectors': state.getPeriodicBoxVectors(asNumpy=True)._value
        }

    def _describe(self, simulation, integrator):
        bodies = BodyDefinitions(integrator)
        #: The data sets of /bodies, with their dimensions.
        self._bodies = {
            'mass': (bodies.masses, _units.MASS),
            'principalMoments': (bodies.moments, _units.MOMENT),
            'particles': (bodies.members.astype('i4'), _units.NONE),
            'sitePositions': (bodies.places, _units.LENGTH),
            'firstParticle': (bodies.first.astype('i4'), _units.NONE)
        }

    def _create(self, file):
        file.attrs['format'] = _FORMAT
        file.attrs['version'] = _VERSION
        count = len(self._bodies['mass'][0])
        for name, (shape, kind, dimension) in _FRAME_DATA.items():
            addSeries(file, name, shape(count), kind).attrs['unit'] = _label(dimension)
        for name, (values, dimension) in self._bodies.items():
            file.create_dataset('bodies/' + name, data=values).attrs['unit'] = _label(dimension)

    def _check_same(self, file):
        _check_format(file, self._file)
        for entry in ('particles', 'firstParticle'):
            if not np.array_equal(file['bodies'][entry][:], self._bodies[entry][0]):
                raise ValueError(
                    f'RigidBodyReporter: {self._file}: it holds other bodies '
                    f'({len(file["bodies/mass"])}) than the integrator '
                    f'({len(self._bodies["mass"][0])}); to append they must be the same: write to '
                    'another file')

    @staticmethod
    def _series(file):
        return [file[name] for name in _FRAME_DATA]


def readBodyStates(file: Path, frames: Optional[slice] = None) -> BodyStates:
    """Read a body-state file.

    Parameters
    ----------
    file : str or path
        name of the file
    frames : slice, optional
        the frames to read; None: all

    Returns
    -------
    BodyStates
        arrays and Quantities over frames: time, step, positions (T, n, 3), orientations (T, n, 4),
        velocities, angularVelocities, boxVectors (T, 3, 3); and over bodies: mass, principalMoments
        (n, 3), particles and sitePositions (lists with one entry per body)

    Raises
    ------
    TypeError, ValueError
        for bad arguments; if the file is no body-state file of a known version, if it is damaged,
        or if it has non-finite numbers or orientations whose length is not 1
    """
    frames = checkedFrames(frames, 'readBodyStates')
    with readingFrom(file, 'readBodyStates:'), openHdf5(file, 'r') as handle:
        return _read_states(handle, frames, file)


def _read_states(handle, chosen, file):
    _check_format(handle, file)
    count = numFrames(RigidBodyReporter._series(handle))
    numbers = np.arange(count)[chosen]
    frames = {name: handle[name][:count] for name in _FRAME_DATA}
    bodies = handle['bodies']
    first = bodies['firstParticle'][:]
    particles, sites = bodies['particles'][:], bodies['sitePositions'][:]
    spans = list(zip(first[:-1], first[1:]))
    for name, (shape, _, _) in _FRAME_DATA.items():
        if frames[name].shape != (count, *shape(len(spans))):
            raise ValueError(
                f'readBodyStates: {file}: {name} has the shape {frames[name].shape}; with {count} '
                f'frames of {len(spans)} bodies it must be {(count, *shape(len(spans)))}: the file '
                'is damaged, restore it from a copy')
    where = f'readBodyStates: {file}'
    for name, (shape, *_) in _FRAME_DATA.items():
        frames[name] = frames[name][numbers]
        # An orientation is checked by its length.
        if name != 'orientations':
            isPerBody = shape(2)[:1] == (2,)
            requireFinite(frames[name], name, where, numbers, 'body' if isPerBody else None)
    frames['orientations'] = unitQuaternions(frames['orientations'], where, numbers)
    for name, item in (('mass', 'body'), ('principalMoments', 'body'), ('sitePositions', 'site')):
        requireFinite(bodies[name][:], name, where, None, item)
    return BodyStates(
        **{name: _with_unit(values, _FRAME_DATA[name][2])
           for name, values in frames.items()}, mass=_units.MASS.attach(bodies['mass'][:]),
        principalMoments=_units.MOMENT.attach(bodies['principalMoments'][:]),
        particles=[particles[a:b].tolist() for a, b in spans],
        sitePositions=[_units.LENGTH.attach(sites[a:b]) for a, b in spans])


def _with_unit(array, dimension):
    return array if dimension is _units.NONE else dimension.attach(array)


def _label(dimension):
    return '' if dimension is _units.NONE else dimension.label


def _check_format(file, name):
    found, version = file.attrs.get('format'), file.attrs.get('version')
    if found != _FORMAT or version != _VERSION:
        raise ValueError(
            f"{name}: format '{found}' version {version}; it must be '{_FORMAT}' version "
            f'{_VERSION}: give a file that a RigidBodyReporter wrote')
