"""Trajectories of rigid bodies as GSD files (schema "hoomd").

OVITO, HOOMD-blue, freud and other programs read these files. A file has n bodies and m blobs.
Numbers have single precision, except for times:

    application                            "openmm-rigidhi <version>; nm, ps, dalton": the units of
                                           the file
    configuration/step, box
    particles/position, image              bodies' origins, wrapped into the box centred at 0, and
                                           the images that unwrap them; then blobs
    particles/orientation                  unit quaternions (w, x, y, z), body frame to lab frame
    particles/types, typeid, type_shapes   types of bodies, drawn as unions of their spheres
    particles/mass, moment_inertia         dalton, dalton nm^2 about the body axes
    particles/diameter, body               with blobs: body is each body's own index, for a blob the
                                           index of its body, -1 for a free blob
    particles/velocity, angmom             if wanted: nm/ps, and HOOMD's quaternion 2 q (0, L_body)
    log/openmmrigidhi/time_ps              double
    log/openmmrigidhi/periodic             0 or 1

Without periodic boundaries the box is a cube about the origin. Its edge is a power of 2 nm, and
large enough for its content.
"""
from __future__ import annotations

import os
from typing import Optional, Sequence

import numpy as np

from .. import _loading, _units
from .._types import Number, Numbers, Path
from .._quaternions import conjugate, product, rotate
from .trajectories import (BodyReporter, BodyScene, Trajectory, checkedFrames, readingFrom,
                           requireFinite, unitQuaternions)

_SCHEMA, _SCHEMA_VERSION = 'hoomd', [1, 4]
_TIME, _PERIODIC = 'openmmrigidhi/time_ps', 'openmmrigidhi/periodic'
_BLOB = 'blob'


class GsdReporter(BodyReporter):
    """Writes the poses of all bodies to a GSD file, once per interval of steps.

    Numbers have single precision. The reporter needs the Python package gsd.

    Parameters
    ----------
    file : str or path
        name of the file
    reportInterval : int
        number of steps between frames
    append : bool
        continue an existing file with the same numbers of bodies and blobs, of the same types.
        Frames at or after the step of the first new frame are dropped, by copying the earlier
        frames. So a run resumed from a checkpoint leaves the same file as the uninterrupted run. If
        the new run began at step 0, the first report raises ValueError. A file that does not exist
        is created. Without append an existing file is replaced.
    velocities : bool
        also write velocities and angular momenta
    blobs : bool
        also write the hydrodynamic particles as particles; programs draw them in place of the
        bodies; without blobs, they draw bodies as unions of spheres
    types : sequence of str, optional
        type name of each body; None: bodies of equal sites and radii are body0, body1, ...
    radii : sequence or Quantity of shape (particles of the System,), optional
        radius of each particle, nm, 0 for none; None: the radii of the MobilityForce, if the System
        has one

    Raises
    ------
    ImportError
        without the package gsd
    TypeError, ValueError
        for bad arguments; at the first report also if types or radii do not fit the bodies, or if
        the file to continue holds other bodies

    Notes
    -----
    The file is closed between reports, and its index is written after the data. You can read it
    during the run. Whenever the run is killed, the file holds all finished frames. A report takes
    about a millisecond.
    """
    def __init__(self, file: Path, reportInterval: int, append: bool = False,
                 velocities: bool = False, blobs: bool = False,
                 types: Optional[Sequence[str]] = None, radii: Optional[Numbers] = None) -> None:
        super().__init__(file, reportInterval, append)
        _gsd()
        self._velocities = _units.boolean(velocities, self._name, 'velocities')
        self._needsPositions = self._blobs = _units.boolean(blobs, self._name, 'blobs')
        self._needsVelocities = self._blobs and self._velocities
        self._types, self._radii = types, radii

    def _start(self, simulation, integrator):
        self._scene = BodyScene(integrator, simulation.system, self._types, self._radii,
                                self._blobs, self._name)
        self._constants = _constants(self._scene)
        # The largest distance of sites from the origins.
        self._reach = max(
            [float(np.linalg.norm(sites, axis=1).max(initial=0))
             for sites in self._scene.sites] + [0.0])
        self._reach += float(self._scene.radii.max(initial=0))
        if self._continues():
            self._resume(simulation.currentStep)
        else:
            _open(self._file, 'w').close()

    def _write(self, simulation, state, integrator):
        hoomd = _gsd()
        R, q = integrator.getBodyPositions()._value, integrator.getBodyOrientations()
        if self._blobs:
            R = np.concatenate([R, state.getPositions(asNumpy=True)._value[self._scene.blobs]])
        frame = (getattr(hoomd, 'Frame', None) or hoomd.Snapshot)()
        frame.configuration.step = simulation.currentStep
        box = (_periodic_box(state.getPeriodicBoxVectors(
            asNumpy=True)._value) if self._scene.periodic else _enclosing_box(R, self._reach))
        frame.configuration.box = box
        particles = frame.particles
        particles.N = len(R)
        particles.position, particles.image = _wrap(R, box)
        particles.orientation = self._padded(q, (1, 0, 0, 0))
        if self._velocities:
            v, omega = integrator.getBodyVelocities()._value, integrator.getBodyAngularVelocities(
            )._value
            momenta = self._scene.moments*rotate(conjugate(q), omega)
            particles.angmom = self._padded(
                2*product(q, np.concatenate([np.zeros((len(q), 1)), momenta], axis=1)),
                (0, 0, 0, 0))
            if self._blobs:
                v = np.concatenate([v, state.getVelocities(asNumpy=True)._value[self._scene.blobs]])
            particles.velocity = v
        frame.log[_TIME] = np.array([state.getTime()._value])
        frame.log[_PERIODIC] = np.array([self._scene.periodic], dtype=np.uint8)
        with _open(self._file, 'r+') as file:
            if len(file) == 0:
                for name, value in self._constants.items():
                    setattr(particles, name, value)
            file.append(frame)

    def _padded(self, values, default):
        """Values of the bodies, followed by the default for each blob."""
        return np.concatenate([values, np.tile(default, (len(self._scene.blobs), 1))])

    def _resume(self, step):
        """Check that the file holds the same bodies, and drop its frames from this step on."""
        with readingFrom(self._file, f'{self._name}:'), _open(self._file, 'r') as file:
            frames = len(file)
            _check_sizes(file.file, self._file)
            if frames:
                self._check_same(file[0].particles)
            kept = self._rows_before([_step(file.file, k) for k in range(frames)], step)
            if kept < frames:
                _copy_frames(file.file, self._file + '.part', kept)
        if kept < frames:
            os.replace(self._file + '.part', self._file)

    def _check_same(self, there):
        bodies = _bodies_of(there)
        count, blobs = len(self._scene), len(self._scene.blobs)
        if len(bodies) != count or there.N - len(bodies) != blobs:
            raise ValueError(
                f'{self._name}: {self._file}: it holds {len(bodies)} bodies and '
                f'{there.N - len(bodies)} blobs, and the frame to append {count} and {blobs}; '
                'all frames must have the same numbers: use the same options, or write to '
                'another file')
        for name, wanted in (('types', self._constants['types']),
                             ('typeid', self._constants['typeid'].tolist())):
            found = [
                entry if isinstance(entry, str) else int(entry) for entry in getattr(there, name)
            ]
            if found != list(wanted):
                raise ValueError(
                    f'{self._name}: {self._file}: {name} is {found}, and the frame to append has '
                    f'{list(wanted)}; bodies must be of the same types in the same order: give '
                    'those types, or write to another file')


def readGsd(file: Path, stepSize: Optional[Number] = None,
            frames: Optional[slice] = None) -> Trajectory:
    """Read poses of rigid bodies from a GSD file.

    The file may come from GsdReporter or from another program that writes orientations.

    Parameters
    ----------
    file : str or path
        name of the file
    stepSize : float or Quantity, optional
        time between steps, ps, for files of programs that write no times
    frames : slice, optional
        the frames to read; None: all

    Returns
    -------
    Trajectory
        lengths, times and masses count as nm, ps and dalton; angular velocities are zero about axes
        without inertia

    Raises
    ------
    ImportError
        without the package gsd
    TypeError, ValueError
        for bad arguments; if the file has no frames or no times, if the number of particles
        changes, if steps go back, if types or bodies are missing, if numbers are not finite or
        orientations not of length 1, if it is no GSD file of schema "hoomd", or if it is damaged
    """
    if stepSize is not None:
        stepSize = _units.number(stepSize, _units.TIME, 'readGsd', 'stepSize')
        if not 0 < stepSize < np.inf:
            raise ValueError(f'readGsd: stepSize: got {stepSize}; the time between steps must be '
                             f'positive and finite: give it in ps')
    frames = checkedFrames(frames, 'readGsd')
    _gsd()
    with readingFrom(file, 'readGsd:'):
        return _read_trajectory(file, stepSize, frames)


def _read_trajectory(file, stepSize, frames):
    with _open(os.fspath(file), 'r') as handle:
        _check_sizes(handle.file, file)
        if len(handle) == 0:
            raise ValueError(f'readGsd: {file}: it has no frames to read: run longer')
        first = handle[0]
        if stepSize is None and _TIME not in first.log:
            raise ValueError(
                f'readGsd: {file}: it holds steps, but no times; these must be known: give stepSize'
            )
        _check_indices(first.particles, 0, file)
        bodies = _bodies_of(first.particles)
        numbers = np.arange(len(handle))[frames]
        if not len(numbers):
            raise ValueError(f'readGsd: {file}: frames: {frames!r} has none of its {len(handle)} '
                             f'frames; at least one is needed: give another slice')
        columns = [_read_frame(handle[int(k)], first, bodies, k, file) for k in numbers]
    names = ('step', 'time', 'box', 'R', 'image', 'q', 'v', 'angmom', 'moments')
    step, time, box, R, image, q, v, angmom, moments = (np.array(
        [column[name] for column in columns]) for name in names)
    where = f'readGsd: {file}'
    for k in np.flatnonzero(np.diff(step) < 0)[:1]:
        raise ValueError(
            f'{where}: frame {numbers[k + 1]} is of step {step[k + 1]}, and frame {numbers[k]} '
            f'before it of step {step[k]}; steps must not go back: split the file, or give frames')
    if stepSize is not None:
        time = step*stepSize
    requireFinite(time, 'time', where, numbers, None)
    for name, values in (('position', R), ('velocity', v), ('angmom', angmom), ('moment_inertia',
                                                                                moments)):
        requireFinite(values, name, where, numbers, 'particle' if name == 'position' else 'body')
    q = unitQuaternions(q, where, numbers)
    if _is_periodic(first):
        requireFinite(box, 'box', where, numbers, None)
        R = R + image @ box
    momenta = 0.5*product(conjugate(q), angmom)[..., 1:]
    omega = rotate(q, np.divide(momenta, moments, out=np.zeros_like(momenta), where=moments > 0))
    requireFinite(omega, 'angular velocity', where, numbers)
    particles = first.particles
    blobs = np.setdiff1d(np.arange(particles.N), bodies)
    requireFinite(particles.diameter[blobs], 'diameter', where, None, 'blob')
    moves = v.any() or omega.any()
    return Trajectory(
        _units.TIME.attach(time), step, _units.LENGTH.attach(R[:, bodies]), q,
        _units.VELOCITY.attach(v) if moves else None,
        _units.ANGULAR_VELOCITY.attach(omega) if moves else None,
        _units.LENGTH.attach(box) if _is_periodic(first) else None,
        [particles.types[k] for k in particles.typeid[bodies]],
        _units.LENGTH.attach(R[:, blobs]) if len(blobs) else None,
        _units.LENGTH.attach(particles.diameter[blobs].astype(float)/2) if len(blobs) else None,
        particles.body[blobs] if len(blobs) else None, *_sites(particles, bodies, blobs, R[0],
                                                               q[0]))


def _sites(particles, bodies, blobs, R, q):
    """Sites and radii of each body.

    They are its constituents, or the shape of its type where the shapes of all types are made of
    spheres.
    """
    if len(blobs):
        members = [blobs[particles.body[blobs] == body] for body in bodies]
        sites = [
            rotate(conjugate(q[k:k + 1]), R[each] - R[body])
            for k, (body, each) in enumerate(zip(bodies, members))
        ]
        radii = [particles.diameter[each].astype(float)/2 for each in members]
    else:
        shapes = [_spheres_of(shape) for shape in particles.type_shapes or []]
        if len(shapes) < len(particles.types) or any(shapes[k] is None
                                                     for k in particles.typeid[bodies]):
            return None, None
        sites, radii = zip(*(shapes[k] for k in particles.typeid[bodies]))
    return [_units.LENGTH.attach(each)
            for each in sites], [_units.LENGTH.attach(each) for each in radii]


def _spheres_of(shape):
    """Centres and radii of a GSD shape that is made of spheres, else None."""
    if shape.get('type') == 'Sphere':
        return np.zeros((1, 3)), np.array([shape['diameter']])/2
    if shape.get('type') == 'SphereUnion':
        return np.array(shape['centers'], dtype=float), np.array(shape['diameters'], dtype=float)/2
    return None


def _read_frame(frame, first, bodies, k, file):
    """One frame in double precision."""
    particles = frame.particles
    if particles.N != first.particles.N:
        raise ValueError(f'readGsd: {file}: frame {k} has {particles.N} particles, frame 0 has '
                         f'{first.particles.N}; their number must not change: split the file')
    _check_indices(particles, k, file)
    return {
        'step': int(frame.configuration.step),
        'time': float(frame.log[_TIME][0]) if _TIME in frame.log else 0.0,
        'box': _vectors(frame.configuration.box),
        'R': particles.position.astype(float),
        'image': particles.image.astype(float),
        'q': particles.orientation[bodies].astype(float),
        'v': particles.velocity[bodies].astype(float),
        'angmom': particles.angmom[bodies].astype(float),
        'moments': particles.moment_inertia[bodies].astype(float)
    }


def _check_indices(particles, k, file):
    """Check the types of particles, and the bodies whose constituents they are."""
    body, typeid = np.asarray(particles.body), np.asarray(particles.typeid)
    for i in np.flatnonzero(typeid >= len(particles.types))[:1]:
        raise ValueError(f'readGsd: {file}: frame {k}: particle {i} has the typeid {typeid[i]}; '
                         f'the frame has {len(particles.types)} types, counted from 0')
    # Negative numbers mean that a particle is no constituent of a rigid body.
    central = body == np.arange(len(body))
    isWrong = (body >= len(body)) | (body >= 0) & ~central[np.minimum(body, len(body) - 1)]
    for i in np.flatnonzero(isWrong)[:1]:
        raise ValueError(f'readGsd: {file}: frame {k}: particle {i} has the body {body[i]}; a body '
                         f'must be one of the {len(body)} particles, counted from 0, whose own '
                         'body it is')


def _is_periodic(frame):
    """Whether the frame is periodic; files of other programs, such as HOOMD, always are."""
    return bool(frame.log[_PERIODIC][0]) if _PERIODIC in frame.log else True


def _bodies_of(particles):
    """Indices of particles that are bodies.

    They are all particles, or the central ones where HOOMD's "body" identifies constituents.
    """
    body = np.asarray(particles.body)
    return np.flatnonzero(body == np.arange(len(body))) if np.any(
        body >= 0) else np.arange(len(body))


def _constants(scene):
    """What does not change with time, as attributes of gsd's particles."""
    radii = np.unique(scene.radii[scene.blobs])
    largest = np.array([scene.spheres(body)[1].max(initial=0) for body in range(len(scene))])
    first = [int(np.argmax(scene.typeIndices == kind)) for kind in range(len(scene.typeNames))]
    shapes = [{} if len(scene.blobs) else _shape(*scene.spheres(body)) for body in first]
    count = len(scene)
    return {
        'types': scene.typeNames + [f'{_BLOB}{k}' for k in range(len(radii))],
        'typeid': np.concatenate([
            scene.typeIndices,
            len(scene.typeNames) + np.searchsorted(radii, scene.radii[scene.blobs])
        ]),
        'type_shapes': shapes + [{
            'type': 'Sphere',
            'diameter': float(2*radius)
        } for radius in radii],
        'mass': np.concatenate([scene.masses, np.zeros(len(scene.blobs))]),
        'moment_inertia': np.concatenate([scene.moments,
                                          np.zeros((len(scene.blobs), 3))]),
        'diameter': 2*np.concatenate([largest, scene.radii[scene.blobs]]),
        'body': np.concatenate([np.arange(count), scene.blobBodies])
        if len(scene.blobs) else np.full(count, -1),
    }


def _shape(centers, radii):
    """GSD's description of a body made of spheres."""
    if not len(radii):
        return {}
    if len(radii) == 1 and not centers.any():
        return {'type': 'Sphere', 'diameter': float(2*radii[0])}
    return {'type': 'SphereUnion', 'centers': centers.tolist(), 'diameters': (2*radii).tolist()}


def _periodic_box(vectors):
    """lx, ly, lz, xy, xz, yz of OpenMM's reduced box vectors, as rounded in the file."""
    (ax, _, _), (bx, by, _), (cx, cy, cz) = vectors
    return np.array([ax, by, cz, bx/by, cx/cz, cy/cz], dtype=np.float32)


def _enclosing_box(positions, reach):
    """A cube about the origin for a System without periodic boundaries."""
    edge = 2**np.ceil(np.log2(max(1.0, 2*(np.abs(positions).max() + reach))))
    return np.array([edge, edge, edge, 0, 0, 0], dtype=np.float32)


def _vectors(box):
    """Rows a, b, c of a GSD box, in double precision."""
    lx, ly, lz, xy, xz, yz = np.asarray(box, dtype=float)
    return np.array([[lx, 0, 0], [xy*ly, ly, 0], [xz*lz, yz*lz, lz]])


def _wrap(positions, box):
    """Positions in the box of the file, centred at 0, and images.

    positions = wrapped + images @ vectors.
    """
    vectors = _vectors(box)
    images = np.floor(positions @ np.linalg.inv(vectors) + 0.5)
    return (positions - images @ vectors).astype(np.float32), images.astype(np.int32)


def _gsd():
    """The module gsd.hoomd, which may not be installed."""
    try:
        import gsd.hoomd
    except ImportError as error:
        raise ImportError(f'GSD files need the Python package gsd ({error}); install the Debian '
                          f'package python3-gsd, or use H5mdReporter') \
            from error
    return gsd.hoomd


def _open(name, mode):
    """A gsd.hoomd.HOOMDTrajectory; mode "r", "r+" or "w"."""
    hoomd = _gsd()
    import gsd.fl
    # Version 3 renamed the modes.
    version = getattr(gsd, '__version__', None) or gsd.version.version
    mode = mode if int(version.split('.')[0]) >= 3 else {'r': 'rb', 'r+': 'rb+', 'w': 'wb'}[mode]
    file = gsd.fl.open(name=name, mode=mode,
                       application=f'openmm-rigidhi {_loading.version}; nm, ps, dalton',
                       schema=_SCHEMA, schema_version=_SCHEMA_VERSION)
    return hoomd.HOOMDTrajectory(file)


def _check_sizes(file, name):
    """Check the numbers of particles that frames claim to have.

    gsd makes arrays for this many particles before it looks for them in the file.
    """
    for k in range(file.nframes):
        if not file.chunk_exists(frame=k, name='particles/N'):
            continue
        count = int(file.read_chunk(frame=k, name='particles/N')[0])
        if count > os.path.getsize(name):
            raise ValueError(f'readGsd: {name}: frame {k} has {count} particles; in a file of '
                             f'{os.path.getsize(name)} bytes there is no room '
                             'for them: the file is damaged, restore it from a copy')


def _step(file, frame):
    """Step of a frame; a frame without a step has that of frame 0, or else 0."""
    for k in (frame, 0):
        if file.chunk_exists(frame=k, name='configuration/step'):
            return int(file.read_chunk(frame=k, name='configuration/step')[0])
    return 0


def _copy_frames(source, name, count):
    """Copy the first frames to another file, chunk by chunk."""
    with _open(name, 'w') as target:
        chunks = source.find_matching_chunk_names('')
        for frame in range(count):
            for chunk in chunks:
                if source.chunk_exists(frame=frame, name=chunk):
                    target.file.write_chunk(chunk, source.read_chunk(frame=frame, name=chunk))
            target.file.end_frame()
