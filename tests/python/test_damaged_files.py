"""Readers refuse damaged files with a ValueError that names the file. They neither fill the memory
nor crash."""
import random

import gsd.fl
import h5py
import numpy as np
import openmm
import pytest
from openmm import app

import openmmrigidhi
from gsdversions import WRITE

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
            ValueError, match='/parameters/bodies is of 1 bodies, /particles/bodies of 2; these '
            'must be the same: the file is damaged, restore it from a copy'):
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
