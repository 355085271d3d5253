"""Trajectories of rigid bodies as H5MD 1.1 files, which other programs read.

H5MD is a layout of HDF5 files (de Buyl, Colberg, Hoefling, Comput. Phys. Commun. 185, 1546 (2014),
nongnu.org/h5md). The files have its module "units". There are n bodies, T frames, s sites in all
bodies, and m blobs. Numbers are doubles unless the table says otherwise. The unit of each data set
is its attribute "unit". Every element that changes with time is a group of step, time and value.
Its step and time are the same data sets everywhere:

    /h5md                                  attributes and groups that H5MD demands; author, creator,
                                           module units
    /particles/bodies/box                  dimension, boundary; edges (T, 3, 3) nm, rows a, b, c,
                                           if the System is periodic
    /particles/bodies/position             (T, n, 3)  nm, of the bodies' origins, unwrapped
    /particles/bodies/orientation          (T, n, 4)  unit quaternions (w, x, y, z), body frame to
                                           lab frame
    /particles/bodies/velocity             (T, n, 3)  nm ps-1, if wanted
    /particles/bodies/angular_velocity     (T, n, 3)  rad ps-1, lab frame, if wanted
    /particles/bodies/species              (n,) enumeration of the names of types
    /particles/bodies/mass                 (n,)       u
    /particles/bodies/principal_moments    (n, 3)     u nm+2, about the body axes
    /particles/blobs                       if wanted: box, position (T, m, 3), radius (m,) nm,
                                           body (m,) int, -1 for free particles
    /parameters/bodies                     particle (s,) int, site_position (s, 3) nm, site_radius
                                           (s,) nm, first_site (n+1,) int

H5MD 1.1 has no name for orientations. The name "orientation" is that of proposal 104 to H5MD.
"""
import getpass
import re

import numpy as np

from .. import _loading, _units
from .trajectories import (BodyScene, Hdf5Reporter, Trajectory, addSeries, numFrames, openHdf5,
                           readingFrom)

_VERSION = (1, 1)
_UNITS_VERSION = (1, 0)
_BODIES, _BLOBS = 'bodies', 'blobs'
#: The known symbols of H5MD's unit strings: power of length, power of time, value in nm and ps.
_SYMBOLS = {
    'm': (1, 0, 1e9),
    'mm': (1, 0, 1e6),
    'um': (1, 0, 1e3),
    'nm': (1, 0, 1.0),
    'pm': (1, 0, 1e-3),
    'Ang': (1, 0, 0.1),
    'Angstrom': (1, 0, 0.1),
    's': (0, 1, 1e12),
    'ms': (0, 1, 1e9),
    'us': (0, 1, 1e6),
    'ns': (0, 1, 1e3),
    'ps': (0, 1, 1.0),
    'fs': (0, 1, 1e-3),
    'rad': (0, 0, 1.0)
}


class H5mdReporter(Hdf5Reporter):
    """Writes the poses of all bodies to an H5MD file, once per interval of steps.

    Numbers are written in double precision: they are bit for bit those of the bodies.

    Parameters
    ----------
    file : str or path
        name of the file
    reportInterval : int
        number of steps between frames
    append : bool
        continue an existing file of the same bodies. Frames at or after the step of the first new
        frame are dropped. So a run that is resumed from a checkpoint leaves the file of the
        uninterrupted run. A file that does not exist is created. Without append an existing file is
        replaced.
    velocities : bool
        also write velocities and angular velocities
    blobs : bool
        also write the positions of the hydrodynamic particles, as particles of their own
    types : sequence of str, optional
        a name of the type of each body; None: bodies of equal sites and radii are body0, body1, ...
    radii : sequence or Quantity of shape (particles of the System,), optional
        radius of each particle, nm, 0 for none; None: those of the MobilityForce, if there is one
    author : str, optional
        name of the responsible person, which H5MD asks for; None: the user's login name, or
        "unknown"

    Raises
    ------
    TypeError, ValueError
        for bad arguments; at the first report also if types or radii do not fit the bodies, or if
        the file to continue holds other bodies or other data

    Notes
    -----
    The file is closed between reports. It can be read while the run goes on, and it is whole if the
    run is killed between reports. Closing costs about a millisecond a report. A frame that was only
    partly written (when the disk was full, for example) is ignored by readH5md and overwritten by
    append. If the run is killed within the few milliseconds of a report, HDF5 may leave a file that
    cannot be opened.
    """

    _STEPS = f'particles/{_BODIES}/position/step'

    def __init__(self, file, reportInterval, append=False, velocities=False, blobs=False,
                 types=None, radii=None, author=None):
        super().__init__(file, reportInterval, append)
        self._velocities = _units.boolean(velocities, self._name, 'velocities')
        self._needsPositions = self._blobs = _units.boolean(blobs, self._name, 'blobs')
        self._types, self._radii = types, radii
        self._author = _login() if author is None else author

    def _describe(self, simulation, integrator):
        self._scene = BodyScene(integrator, simulation.system, self._types, self._radii,
                                self._blobs, self._name)

    def _frame(self, simulation, state, integrator):
        frame = {
            'bodies/position/value': integrator.getBodyPositions()._value,
            'bodies/orientation/value': integrator.getBodyOrientations()
        }
        if self._velocities:
            frame['bodies/velocity/value'] = integrator.getBodyVelocities()._value
            frame['bodies/angular_velocity/value'] = integrator.getBodyAngularVelocities()._value
        if self._scene.periodic:
            for group in (_BODIES, _BLOBS) if self._blobs else (_BODIES,):
                frame[group + '/box/edges/value'] = state.getPeriodicBoxVectors(asNumpy=True)._value
        if self._blobs:
            frame['blobs/position/value'] = state.getPositions(
                asNumpy=True)._value[self._scene.blobs]
        # The last data set is written last, because readers go by its length.
        frame['bodies/position/time'] = state.getTime()._value
        frame['bodies/position/step'] = simulation.currentStep
        return {f'particles/{name}': value for name, value in frame.items()}

    @staticmethod
    def _series(file):
        return _timeData(file)

    # ---- Layout ----------------------------------------------------------------------------------

    def _create(self, file):
        import h5py
        scene = self._scene
        root = file.create_group('h5md')
        root.attrs['version'] = np.array(_VERSION, dtype='i4')
        root.create_group('author').attrs['name'] = _text(self._author)
        creator = root.create_group('creator')
        creator.attrs['name'], creator.attrs['version'] = _text('openmm-rigidhi'), _text(
            _loading.version)
        units = root.create_group('modules/units')
        units.attrs['version'], units.attrs['system'] = np.array(_UNITS_VERSION,
                                                                 dtype='i4'), _text('SI')
        bodies = file.create_group('particles').create_group(_BODIES)
        count = len(scene)
        self._addElement(bodies, 'position', (count, 3), 'nm')
        self._addElement(bodies, 'orientation', (count, 4), None)
        if self._velocities:
            self._addElement(bodies, 'velocity', (count, 3), 'nm ps-1')
            self._addElement(bodies, 'angular_velocity', (count, 3), 'rad ps-1')
        self._addBox(bodies, scene)
        species = h5py.enum_dtype({name: k
                                   for k, name in enumerate(scene.typeNames)}, basetype='i4')
        bodies.create_dataset('species', data=scene.typeIndices.astype('i4'), dtype=species)
        _constant(bodies, 'mass', scene.masses, 'u')
        _constant(bodies, 'principal_moments', scene.moments, 'u nm+2')
        if self._blobs:
            blobs = file['particles'].create_group(_BLOBS)
            self._addElement(blobs, 'position', (len(scene.blobs), 3), 'nm', bodies['position'])
            self._addBox(blobs, scene)
            _constant(blobs, 'radius', scene.radii[scene.blobs], 'nm')
            _constant(blobs, 'body', scene.blobBodies.astype('i4'), None)
        own = file.create_group('parameters').create_group(_BODIES)
        _constant(own, 'particle', scene.members.astype('i4'), None)
        _constant(own, 'site_position', scene.places, 'nm')
        _constant(own, 'site_radius', scene.radii[scene.members], 'nm')
        _constant(own, 'first_site', scene.first.astype('i4'), None)

    def _addBox(self, group, scene):
        box = group.create_group('box')
        box.attrs['dimension'] = np.int32(3)
        box.attrs['boundary'] = np.array(3*['periodic' if scene.periodic else 'none'], dtype='S8')
        if scene.periodic:
            self._addElement(box, 'edges', (3, 3), 'nm', group['position'])

    @staticmethod
    def _addElement(group, name, shape, unitString, like=None):
        """An element that changes with time.

        All elements but the first have its step and time by hard links.
        """
        element = group.create_group(name)
        value = addSeries(element, 'value', shape)
        if unitString is not None:
            value.attrs['unit'] = _text(unitString)
        like = like or (group['position'] if name != 'position' else None)
        if like is not None:
            element['step'], element['time'] = like['step'], like['time']
            return
        element.create_dataset('step', (0,), 'i8', maxshape=(None,), chunks=(1024,))
        element.create_dataset('time', (0,), 'f8', maxshape=(None,),
                               chunks=(1024,)).attrs['unit'] = _text('ps')

    def _checkSame(self, file):
        """Refuse to continue a file with other bodies or other data."""
        scene = self._scene
        own = file.get('parameters/bodies')
        if own is None or f'particles/{_BODIES}/position' not in file:
            raise ValueError(
                f'{self._name}: {self._file}: it has no /parameters/bodies; to append it must be a '
                f'file of this reporter: '
                'write to another file')
        first = own['first_site'][:]
        if len(first) != len(scene) + 1 or not np.array_equal(own['particle'][:], scene.members):
            raise ValueError(
                f'{self._name}: {self._file}: it is of {len(first) - 1} bodies with {first[-1]} '
                f'particles, the integrator has '
                f'{len(scene)} with {len(scene.members)}; to append they must be the same bodies: '
                f'write to '
                'another file')
        there = {
            'velocities': f'particles/{_BODIES}/velocity' in file,
            'blobs': f'particles/{_BLOBS}' in file,
            'periodic boundaries': f'particles/{_BODIES}/box/edges' in file
        }
        wanted = {
            'velocities': self._velocities,
            'blobs': self._blobs,
            'periodic boundaries': scene.periodic
        }
        for what in there:
            if there[what] != wanted[what]:
                raise ValueError(
                    f'{self._name}: {self._file}: it has {"" if there[what] else "no "}{what}, '
                    f'what is to be appended has '
                    f'{"" if wanted[what] else "none"}; all frames must hold the same data: use '
                    f'the same options, or write to '
                    'another file')
        if self._blobs and len(file['particles'][_BLOBS]['radius']) != len(scene.blobs):
            raise ValueError(
                f'{self._name}: {self._file}: it is of {len(file["particles"][_BLOBS]["radius"])} '
                f'blobs, the System has '
                f'{len(scene.blobs)}; all frames must have as many: give the same radii, or write '
                f'to another file')


def readH5md(file, group=None):
    """Read poses of rigid bodies from an H5MD file, of H5mdReporter or of another program.

    Parameters
    ----------
    file : str or path
        name of the file
    group : str, optional
        the group below /particles that is read; None: "bodies", or the only group that has
        orientations

    Returns
    -------
    Trajectory
        in nm and ps; data sets without unit are taken to be in these units, and positions with an
        "image" element are unwrapped

    Raises
    ------
    ValueError
        if the file is damaged or is no H5MD file of version 1, or if it has no such group, no
        position, orientation or time there, or units that are no lengths or times
    """
    if group is not None and not isinstance(group, str):
        raise TypeError(
            f'readH5md: group: got {group!r}; it must be a name or None: give the name of a group '
            f'below /particles')
    with readingFrom(file, 'readH5md:'), openHdf5(file, 'r') as handle:
        version = handle['h5md'].attrs.get('version') if 'h5md' in handle else None
        if version is None or version[0] != _VERSION[0]:
            raise ValueError(
                f'readH5md: {file}: its H5MD version is {version}; it must be 1.x: give an H5MD '
                f'file')
        particles = handle.get('particles', {})
        if group is None:
            found = [name for name in particles if 'orientation' in particles[name]]
            group = _BODIES if _BODIES in found else found[0] if len(found) == 1 else None
        if group is None or group not in particles:
            raise ValueError(f'readH5md: {file}: group: {group!r} is not there; the groups are '
                             f'{", ".join(particles) or "none"}: name one that '
                             'has positions and orientations')
        return _readGroup(handle, particles[group], group, file)


def _readGroup(handle, bodies, group, file):
    import h5py
    for name in ('position', 'orientation'):
        if name not in bodies or 'value' not in bodies[name]:
            raise ValueError(
                f'readH5md: {file}: /particles/{group} has no {name} that changes with time; poses '
                f'need it: choose another group')
    count = numFrames(_timeData(handle, bodies))
    step, time = _axis(bodies['position'], 'step', count), _axis(bodies['position'], 'time', count)
    if time is None:
        raise ValueError(
            f'readH5md: {file}: /particles/{group}/position has no time, only steps; trajectories '
            f'need times: write them')
    time = time*_conversion(bodies['position/time'], 0, 1, file)
    positions = _values(bodies, 'position', 1, 0, count, file)
    edges, periodic = _box(bodies, count, file)
    if 'image' in bodies and edges is not None:
        image = bodies['image']
        positions = positions + (
            (image['value'][:count] if 'value' in image else image[:])*periodic) @ edges
    orientations = np.asarray(bodies['orientation/value'][:count], dtype=float)
    if positions.ndim != 3 or positions.shape[2] != 3 or orientations.shape != (
            *positions.shape[:2], 4):
        raise ValueError(
            f'readH5md: {file}: /particles/{group}: positions have the shape {positions.shape}, '
            f'orientations {orientations.shape}; '
            'these must be (frames, bodies, 3) and (frames, bodies, 4): choose another group, or '
            'restore the file from a copy')
    velocities, angular = (_values(bodies, name, length, -1, count, file)
                           for name, length in (('velocity', 1), ('angular_velocity', 0)))
    types = None
    if isinstance(bodies.get('species'), h5py.Dataset):
        names = h5py.check_enum_dtype(bodies['species'].dtype)
        names = {} if names is None else {number: name for name, number in names.items()}
        types = [names.get(k, str(k)) for k in bodies['species'][:].tolist()]
    blobs = bodies.parent.get(_BLOBS)
    hasBlobs = blobs is not None and group == _BODIES and 'radius' in blobs and 'body' in blobs
    blobPositions = _values(blobs, 'position', 1, 0, count, file) if hasBlobs else None
    return Trajectory(
        _units.TIME.attach(time), step, _units.LENGTH.attach(positions), orientations,
        _attach(_units.VELOCITY, velocities), _attach(_units.ANGULAR_VELOCITY, angular),
        _attach(_units.LENGTH, edges), types, _attach(_units.LENGTH, blobPositions),
        _attach(_units.LENGTH,
                blobs['radius'][:]*_conversion(blobs['radius'], 1, 0, file) if hasBlobs else None),
        blobs['body'][:] if hasBlobs else None, *_sites(handle, group, positions.shape[1], file))


def _sites(handle, group, bodies, file):
    """Sites and radii of each body, where the file has them."""
    own = handle.get(f'parameters/{group}')
    if own is None or not all(name in own
                              for name in ('site_position', 'site_radius', 'first_site')):
        return None, None
    first = own['first_site'][:]
    if len(first) != bodies + 1:
        raise ValueError(f'readH5md: {file}: /parameters/{group} is of {len(first) - 1} bodies, '
                         f'/particles/{group} of {bodies}; these must be the same: '
                         'the file is damaged, restore it from a copy')
    sites = own['site_position'][:]*_conversion(own['site_position'], 1, 0, file)
    radii = own['site_radius'][:]*_conversion(own['site_radius'], 1, 0, file)
    spans = list(zip(first[:-1], first[1:]))
    return [_units.LENGTH.attach(sites[a:b])
            for a, b in spans], [_units.LENGTH.attach(radii[a:b]) for a, b in spans]


def _attach(dimension, values):
    return None if values is None else dimension.attach(values)


def _values(group, name, length, time, count, file):
    """The values of an element as (frames, ...), in nm and ps, or None."""
    if name not in group:
        return None
    data = group[name]['value']
    return np.asarray(data[:count], dtype=float)*_conversion(data, length, time, file)


def _box(group, count, file):
    """Box vectors (frames, 3, 3) in nm, and the vectors (3,) along which the box is periodic.

    None: the box is periodic along no vector.
    """
    box = group.get('box')
    boundary = [] if box is None else [
        np.bytes_(name) for name in box.attrs.get('boundary', 3*[b'periodic'])
    ]
    periodic = np.array([name == b'periodic' for name in boundary])
    if not periodic.any() or 'edges' not in box:
        return None, periodic
    changes = 'value' in box['edges']
    data = box['edges/value'] if changes else box['edges']
    edges = (data[:count] if changes else data[()])*_conversion(data, 1, 0, file)
    # A vector is the diagonal of a cuboid, a matrix has the edges as rows.
    edges = edges if edges.ndim == 2 + changes else edges[..., None]*np.eye(3)
    return np.broadcast_to(edges, (count, 3, 3)).copy(), periodic


def _axis(element, name, count):
    """Steps or times of an element's frames, stored singly or as an increment and an offset."""
    if name not in element:
        return None
    data = element[name]
    return data[:count] if data.shape else data[()]*np.arange(count) + data.attrs.get('offset', 0)


def _conversion(data, length, time, file):
    """The factor that brings a data set to nm and ps.

    The unit of the data set must have these powers of length and time.
    """
    text = data.attrs.get('unit')
    if text is None:
        return 1.0
    text = text.decode() if isinstance(text, bytes) else str(text)
    factor, powers = 1.0, [0, 0]
    for part in text.split():
        match = re.fullmatch(r'([A-Za-z]+|\d+(?:\.\d+)?)([+-]\d+)?', part)
        symbol = match and (_SYMBOLS.get(match[1]) or (not match[1].isalpha() and
                                                       (0, 0, float(match[1]))))
        if not symbol:
            powers = None
            break
        power = int(match[2] or 1)
        factor *= symbol[2]**power
        powers = [powers[0] + power*symbol[0], powers[1] + power*symbol[1]]
    if powers != [length, time]:
        raise ValueError(
            f'readH5md: {file}: {data.name}: its unit is {text!r}; it must be a unit of '
            f'{"length" if time == 0 else "time" if length == 0 and time == 1 else "velocity"} '
            f'made of '
            f'{", ".join(_SYMBOLS)}: convert the file')
    return factor


def _login():
    """The user's login name; in a container there may be none."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return 'unknown'


def _text(text):
    """A string as H5MD stores them: of fixed length."""
    return np.bytes_(text.encode('ascii', 'replace'))


def _constant(group, name, values, unitString):
    data = group.create_dataset(name, data=values)
    if unitString is not None:
        data.attrs['unit'] = _text(unitString)


def _timeData(file, within=None):
    """All data sets of this package's groups that have one row a frame, each once."""
    import h5py
    found = {}
    groups = [within] if within is not None else list(file['particles'].values())
    for group in groups:
        for element in [*group.values(), *(group['box'].values() if 'box' in group else ())]:
            if isinstance(element, h5py.Group) and 'value' in element:
                for name in ('value', 'step', 'time'):
                    if name in element and element[name].shape:
                        found[h5py.h5o.get_info(element[name].id).addr] = element[name]
    return list(found.values())
