"""Readers refuse damaged files with a ValueError that names the file. They neither fill the memory
nor crash."""
import random

import gsd.fl
import gsd.hoomd
import h5py
import numpy as np
import openmm
import pytest
from openmm import app

import openmmrigidhi
from gsdversions import WRITE, Frame

tools = openmmrigidhi.app
READERS = {
    'bodies.h5': tools.readBodyStates,
    'trajectory.h5md': tools.readH5md,
    'trajectory.gsd': tools.readGsd,
    'shape.vertex': tools.readVertexFile,
    'places.clones': tools.readClones
}


@pytest.fixture(scope='module')
def files(tmp_path_factory):
    """One small file for each reader."""
    folder = tmp_path_factory.mktemp('whole')
    system, topology = openmm.System(), app.Topology()
    residue = topology.addResidue('A', topology.addChain())
    integrator = openmmrigidhi.CustomRigidHIIntegrator(300, 0.01)
    for body in range(2):
        for _ in range(2):
            system.addParticle(1)
            topology.addAtom('C', None, residue)
        integrator.addRigidBody([2*body, 2*body + 1], 2, (1, 1, 1), [(-0.1, 0, 0), (0.1, 0, 0)])
    simulation = app.Simulation(topology, system, integrator,
                                openmm.Platform.getPlatformByName('Reference'))
    simulation.context.setPositions([(-0.1, 0, 0), (0.1, 0, 0), (-0.1, 1, 0), (0.1, 1, 0)])
    simulation.reporters += [
        tools.RigidBodyReporter(folder/'bodies.h5', 2),
        tools.H5mdReporter(folder/'trajectory.h5md', 2, velocities=True),
        tools.GsdReporter(folder/'trajectory.gsd', 2, radii=0.1)
    ]
    simulation.step(6)
    (folder/'shape.vertex').write_text('3 0.5\n0 0 0\n1 0 0\n0 1 0\n')
    tools.writeClones(folder/'places.clones', np.zeros((2, 3)), np.tile([1, 0, 0, 0], (2, 1)))
    return folder


def damaged(data, seed):
    """Bits flipped, bytes replaced, bytes lost in the middle or at the end."""
    random_, data = random.Random(seed), bytearray(data)
    place, kind = random_.randrange(len(data)), seed % 4
    if kind == 0:
        for _ in range(random_.choice([1, 8, 64])):
            data[random_.randrange(len(data))] ^= 1 << random_.randrange(8)
    elif kind == 1:
        del data[place:]
    elif kind == 2:
        data[place:place + 64] = random_.randbytes(len(data[place:place + 64]))
    else:
        del data[place:place + random_.randrange(1, 300)]
    return bytes(data)


@pytest.mark.parametrize('name', READERS)
def test_damaged_files_are_errors_that_name_them(files, tmp_path, name):
    READERS[name](files/name)
    whole, refused = (files/name).read_bytes(), 0
    for seed in range(60):
        copy = tmp_path/name
        copy.write_bytes(damaged(whole, seed))
        try:
            READERS[name](copy)
        except ValueError as error:
            assert type(error) is ValueError and str(copy) in str(error)
            refused += 1
    assert refused >= 20  # other damage is to numbers, or to unused bytes


@pytest.mark.parametrize('name', ['bodies.h5', 'trajectory.h5md', 'trajectory.gsd'])
def test_damage_names_its_kind_and_a_remedy(files, tmp_path, name):
    (tmp_path/name).write_bytes((files/name).read_bytes()[:-700])
    with pytest.raises(
            ValueError,
            match=f'{name}: it is damaged, or of another kind .* restore it from a copy'):
        READERS[name](tmp_path/name)
    (tmp_path/name).unlink()
    with pytest.raises(FileNotFoundError, match=name):
        READERS[name](tmp_path/name)


@pytest.mark.parametrize('reporter, name', [(tools.RigidBodyReporter, 'bodies.h5'),
                                            (tools.H5mdReporter, 'trajectory.h5md'),
                                            (tools.GsdReporter, 'trajectory.gsd')])
def test_damaged_files_are_not_continued(files, tmp_path, reporter, name):
    whole = (files/name).read_bytes()
    (tmp_path/name).write_bytes(whole[:-700])
    system = openmm.System()
    system.addParticle(1)
    integrator = openmmrigidhi.CustomRigidHIIntegrator(300, 0.01)
    integrator.addRigidBody([0], 1, (1, 1, 1), [(0, 0, 0)])
    topology = app.Topology()
    topology.addAtom('C', None, topology.addResidue('A', topology.addChain()))
    simulation = app.Simulation(topology, system, integrator,
                                openmm.Platform.getPlatformByName('Reference'))
    simulation.context.setPositions([(0, 0, 0)])
    simulation.reporters.append(reporter(tmp_path/name, 1, append=True))
    with pytest.raises(ValueError, match=f'{reporter.__name__}: .*{name}: it is damaged'):
        simulation.step(1)
    assert (tmp_path/name).read_bytes() == whole[:-700]


def test_shapes_that_do_not_fit(files, tmp_path):
    def spoil(name, path, shape):
        copy = tmp_path/name
        copy.write_bytes((files/name).read_bytes())
        with h5py.File(copy, 'r+') as file:
            del file[path]
            file.create_dataset(path, shape, 'f8', chunks=True)
        return copy

    with pytest.raises(
            ValueError, match=
            r'positions has the shape \(3, 1, 3\); with 3 frames of 2 bodies it must be \(3, 2, 3\)'
    ):
        tools.readBodyStates(spoil('bodies.h5', 'positions', (3, 1, 3)))
    with pytest.raises(ValueError,
                       match=r'positions have the shape \(3, 2, 3\), orientations \(3, 1, 4\)'):
        tools.readH5md(spoil('trajectory.h5md', 'particles/bodies/orientation/value', (3, 1, 4)))
    # Data that was never written takes no space in a file, but would take it in memory.
    with pytest.raises(
            ValueError, match=
            r'data set positions has the shape \(3, 1000000000, 3\), 7.2e\+10 bytes; in a file of '
            r'\d+ bytes there is'):
        tools.readBodyStates(spoil('bodies.h5', 'positions', (3, 10**9, 3)))


def test_the_sites_of_an_h5md_file_are_those_of_its_bodies(files, tmp_path):
    copy = tmp_path/'trajectory.h5md'
    copy.write_bytes((files/'trajectory.h5md').read_bytes())
    with h5py.File(copy, 'r+') as file:
        first = file['parameters/bodies/first_site'][:]
        assert len(first) == 3
        del file['parameters/bodies/first_site']
        file['parameters/bodies/first_site'] = first[:-1]
    with pytest.raises(
            ValueError, match='/parameters/bodies has 1 bodies, and /particles/bodies has 2; the '
            'numbers must agree: the file is damaged, restore it from a copy'):
        tools.readH5md(copy)


def test_a_gsd_file_that_claims_more_particles_than_it_can_hold(tmp_path):
    name = str(tmp_path/'large.gsd')
    with gsd.fl.open(name=name, mode=WRITE, application='test', schema='hoomd',
                     schema_version=[1, 4]) as file:
        file.write_chunk('particles/N', np.array([4*10**9], dtype=np.uint32))
        file.end_frame()
    with pytest.raises(ValueError, match='frame 0 has 4000000000 particles; in a file of'):
        tools.readGsd(name, stepSize=1)


def test_the_group_of_an_h5md_file_is_a_name(files):
    with pytest.raises(TypeError, match='readH5md: group: got 3; it must be a name or None'):
        tools.readH5md(files/'trajectory.h5md', group=3)


# ---- Numbers that are none -----------------------------------------------------------------------


def spoiled(source, target, path, index, value):
    """A copy of an HDF5 file with another value in a data set."""
    target.write_bytes(source.read_bytes())
    with h5py.File(target, 'r+') as file:
        file[path][index] = value
    return target


#: Data sets that have a row for each frame, how a message calls them, and what their rows are of.
STATES = {
    'time': None,
    'positions': 'body',
    'orientations': 'body',
    'velocities': 'body',
    'angularVelocities': 'body',
    'boxVectors': None
}
H5MD = {
    'position/time': None,
    'position/value': 'body',
    'orientation/value': 'body',
    'velocity/value': 'body',
    'angular_velocity/value': 'body'
}


@pytest.mark.parametrize('value', [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize('whole', [False, True], ids=['one', 'all'])
@pytest.mark.parametrize('kind, path',
                         [('bodies.h5', name) for name in STATES] + [('trajectory.h5md', name)
                                                                     for name in H5MD])
def test_numbers_of_frames_must_be_finite(files, tmp_path, kind, path, value, whole):
    """The message names frame, body and value, and the frames before can be read."""
    item = (STATES if kind == 'bodies.h5' else H5MD)[path]
    full = path if kind == 'bodies.h5' else 'particles/bodies/' + path
    with h5py.File(files/kind) as file:
        width = file[full].ndim
    place = 1 if width == 1 else (1, 1) if whole and item else (1,) if whole else (1,
                                                                                   *[1]*(width - 1))
    copy, read = spoiled(files/kind, tmp_path/kind, full, place, value), READERS[kind]
    where = 'frame 1' + (f', {item} 1' if item else '')
    with pytest.raises(ValueError) as error:
        read(copy)
    name = path.removesuffix('/value').replace('position/time',
                                               'time').replace('orientations', 'orientation')
    assert f'{copy}: {where}: {name} is ' in str(error.value) and str(value) in str(error.value)
    assert 'frames=slice(1) for those before' in str(error.value)
    assert len(read(copy, frames=slice(1))) == 1
    assert read(copy, frames=slice(2, None)).step.tolist() == [6]


@pytest.mark.parametrize('path, name', [('bodies/mass', 'body 1: mass'),
                                        ('bodies/principalMoments', 'body 1: principalMoments'),
                                        ('bodies/sitePositions', 'site 1: sitePositions')])
def test_numbers_of_bodies_must_be_finite(files, tmp_path, path, name):
    copy = spoiled(files/'bodies.h5', tmp_path/'bodies.h5', path, 1, np.nan)
    with pytest.raises(
            ValueError, match=f'bodies.h5: {name} is .*nan.*; numbers in a file must be '
            'finite: restore the file from a copy'):
        tools.readBodyStates(copy)


def test_sites_of_h5md_files_must_be_finite_and_those_of_the_bodies(files, tmp_path):
    name, own = 'trajectory.h5md', 'parameters/bodies/'
    for path, text in ((own + 'site_position', 'site 1: site_position is .*nan'),
                       (own + 'site_radius', 'site 1: site_radius is nan')):
        with pytest.raises(ValueError, match=text):
            tools.readH5md(spoiled(files/name, tmp_path/name, path, 1, np.nan))
    for place, value in ((0, 1), (1, 7), (2, 3)):
        with pytest.raises(ValueError, match='each body needs sites of its own'):
            tools.readH5md(spoiled(files/name, tmp_path/name, own + 'first_site', place, value))


ZERO, SHORT, LONG = [0.0, 0, 0, 0], [0.9, 0, 0, 0], [1e200, 1e200, 0, 0]


@pytest.mark.parametrize('q, length', [(ZERO, '0'), (SHORT, '0.9'), ([1.0, 0, np.nan, 0], 'nan'),
                                       (LONG, '.*')], ids=str)
@pytest.mark.parametrize('kind, path', [('bodies.h5', 'orientations'),
                                        ('trajectory.h5md', 'particles/bodies/orientation/value'),
                                        ('trajectory.gsd', None), ('places.clones', None)])
@pytest.mark.filterwarnings('error')
def test_quaternions_must_have_length_1(files, tmp_path, kind, path, q, length):
    copy = tmp_path/kind
    if kind == 'places.clones':
        copy.write_text(f'2\n0 0 0 1 0 0 0\n1 2 3 {" ".join(map(str, q))}\n')
        where = 'line 3: found (a quaternion of length|the row)'
    elif kind == 'trajectory.gsd':
        q = np.minimum(q, 1e30)  # single precision
        writeGsd(copy, orientation=[[[1, 0, 0, 0]]*2, [[1, 0, 0, 0], q]])
        where = f'frame 1, body 1: orientation is .*, of length {length}; a unit quaternion has'
    else:
        spoiled(files/kind, copy, path, (1, 1), q)
        where = f'frame 1, body 1: orientation is .*, of length {length}; a unit quaternion has'
    with pytest.raises(ValueError, match=f'{kind}[:,] {where}'):
        READERS[kind](*[copy, 1][:2 if kind == 'trajectory.gsd' else 1])


def test_quaternions_of_few_digits_are_normalised(files, tmp_path):
    for kind, path in (('bodies.h5', 'orientations'), ('trajectory.h5md',
                                                       'particles/bodies/orientation/value')):
        copy = spoiled(files/kind, tmp_path/kind, path, (1, 1), [0.70711, 0, 0, 0.70711])
        found = READERS[kind](copy).orientations[1, 1]
        assert found == pytest.approx([np.sqrt(0.5), 0, 0, np.sqrt(0.5)], rel=1e-15)


def writeGsd(name, count=2, box=(10, 10, 10, 0, 0, 0), periodic=None, **values):
    """A GSD file of two frames, with values of particles for each frame."""
    with gsd.hoomd.open(str(name), WRITE) as file:
        for k in range(2):
            frame = Frame()
            frame.configuration.step = 10*k
            frame.configuration.box = box if k else (10, 10, 10, 0, 0, 0)
            frame.particles.N = count
            frame.particles.position = np.zeros((count, 3))
            for key, each in values.items():
                setattr(frame.particles, key, each[k])
            if periodic is not None:
                frame.log['openmmrigidhi/periodic'] = np.array([periodic], dtype=np.uint8)
            file.append(frame)


@pytest.mark.parametrize('value', [np.nan, np.inf])
@pytest.mark.parametrize('whole', [False, True], ids=['one', 'all'])
@pytest.mark.parametrize('name, item, width', [('position', 'particle', 3), ('velocity', 'body', 3),
                                               ('angmom', 'body', 4), ('moment_inertia', 'body', 3),
                                               ('orientation', 'body', 4)])
@pytest.mark.filterwarnings('error')
def test_numbers_of_gsd_files_must_be_finite(tmp_path, name, item, width, value, whole):
    good = np.tile(np.eye(4)[0] if width == 4 else np.ones(3), (2, 1))
    bad = good.copy()
    bad[1] = np.where(whole | (np.arange(width) == 1), value, bad[1])
    file = tmp_path/'x.gsd'
    writeGsd(file, **{name: [good, bad]})
    with pytest.raises(ValueError, match=f'x.gsd: frame 1, {item} 1: {name} is .*{value}'):
        tools.readGsd(file, 1)
    assert len(tools.readGsd(file, 1, slice(1))) == 1


@pytest.mark.filterwarnings('error')
def test_boxes_times_and_spins_of_gsd_files_must_be_finite(tmp_path):
    file = tmp_path/'x.gsd'
    writeGsd(file, box=(10, np.nan, 10, 0, 0, 0))
    with pytest.raises(ValueError, match=r'frame 1: box is .*nan'):
        tools.readGsd(file, 1)
    writeGsd(file, box=(10, np.nan, 10, 0, 0, 0), periodic=0)
    assert tools.readGsd(file, 1).boxVectors is None  # a box that means nothing
    writeGsd(file, angmom=[[[0, 0, 0, 0]]*2, [[0, 3e38, 0, 0]]*2], moment_inertia=[[[1e-45]*3]*2]*2)
    with np.errstate(over='ignore'):
        assert np.isfinite(tools.readGsd(file, 1).angularVelocities._value).all()
    with gsd.hoomd.open(str(file), WRITE) as handle:
        for time in (0.0, np.inf):
            frame = Frame()
            frame.configuration.step, frame.particles.N = 0, 1
            frame.log['openmmrigidhi/time_ps'] = np.array([time])
            handle.append(frame)
    with pytest.raises(ValueError, match='frame 1: time is inf'):
        tools.readGsd(file)
    for step in (0, -1, np.nan, np.inf):
        with pytest.raises(
                ValueError, match=r'readGsd: stepSize: got .*; the time between steps '
                'must be positive and finite'):
            tools.readGsd(file, step)
    with pytest.raises(ValueError,
                       match=r'frames: slice\(5, None, None\) has none of its 2 frames'):
        tools.readGsd(file, 1, slice(5, None))


def test_blobs_of_gsd_files_have_finite_diameters(tmp_path):
    writeGsd(tmp_path/'x.gsd', body=[[0, 0]]*2, diameter=[[0, np.nan]]*2)
    with pytest.raises(ValueError, match='x.gsd: blob 0: diameter is nan'):
        tools.readGsd(tmp_path/'x.gsd', 1)


@pytest.mark.parametrize('name', ['bodies.h5', 'trajectory.h5md', 'trajectory.gsd'])
def test_parts_of_files_are_those_of_the_whole(files, name):
    read = READERS[name]
    whole = read(files/name)
    assert whole.step.tolist() == [2, 4, 6]
    for frames in (slice(1), slice(1, None), slice(None, None, 2), slice(-1, None)):
        part = read(files/name, frames=frames)
        for key in 'step', 'orientations':
            assert np.array_equal(getattr(part, key), getattr(whole, key)[frames])
        for key in 'time', 'positions':
            assert np.array_equal(getattr(part, key)._value, getattr(whole, key)._value[frames])
    with pytest.raises(TypeError, match='frames: got 2; it must be a slice of integers or None'):
        read(files/name, frames=2)
    with pytest.raises(ValueError, match='frames are read in the order of the file'):
        read(files/name, frames=slice(None, None, -1))
