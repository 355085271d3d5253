"""Trajectory files: reading them back, reading by other programs, continued files, crashes, and
files of other programs."""
import os
import re
import subprocess
import sys

import gsd.fl
import gsd.hoomd
import h5py
import numpy as np
import openmm
import openmm.app
import pytest
from openmm import unit

import openmmrigidhi
from gsdversions import READ, UPDATE, WRITE, Frame
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, analysis, app

REFERENCE = openmm.Platform.getPlatformByName('Reference')
#: Half the spacing of single precision numbers, relative.
SINGLE = 2.0**-24


def refused(*pieces, error=ValueError):
    return pytest.raises(error, match='.*'.join(re.escape(piece) for piece in pieces))


class Scene:
    """Two dumbbells of two blobs, a sphere off its origin, and a free blob. All drift and turn, in
    a box of 4 nm or without a box."""
    def __init__(self, periodic=None, bodies=3, velocity=30.0, fluid=False, ball=(0.1, 0.2, 0),
                 tail=(0, 0, 0.5)):
        self.system, self.fluid, self.integrator = openmm.System(), MobilityForce(
        ), CustomRigidHIIntegrator(0, 0.01)
        sites = [[(-0.3, 0, 0), (0.3, 0.1, 0), end]
                 for end in ((0, 0, 0.5), tail)] + [[ball, (0, 0, 0.4)]]
        radii = [[0.25, 0.35, 0.1 if fluid else 0]]*2 + [[0.5, 0]]
        for k in range(bodies):
            app.addRigidMultiblob(self.system, self.integrator, self.fluid, sites[k], radii[k],
                                  10 + k, (3, 4, 5))
        self.system.addParticle(7)
        self.fluid.addParticle(0.15)
        if periodic is not None:
            self.system.setDefaultPeriodicBoxVectors(*periodic)
            force = openmm.NonbondedForce()
            force.setNonbondedMethod(openmm.NonbondedForce.CutoffPeriodic)
            force.setCutoffDistance(1)
            for _ in range(self.system.getNumParticles()):
                force.addParticle(0, 0.1, 0)
            self.system.addForce(force)
        if fluid:
            self.system.addForce(self.fluid)
            self.integrator.setScheme(self.integrator.LangevinHI)
        self.radii = [
            self.fluid.getParticleRadius(i)._value for i in range(self.fluid.getNumParticles())
        ]
        self.integrator.setFriction(0)
        self.integrator.setRotationalFriction(0)
        app.bindBodies(self.system, self.integrator)
        topology = openmm.app.Topology()
        residue = topology.addResidue('X', topology.addChain())
        for _ in range(self.system.getNumParticles()):
            topology.addAtom('X', openmm.app.Element.getBySymbol('C'), residue)
        self.simulation = openmm.app.Simulation(topology, self.system, self.integrator, REFERENCE)
        places = np.concatenate([np.array(sites[k]) + (3*k, 0.5, -1)
                                 for k in range(bodies)] + [[(1, 2, 3)]])
        self.simulation.context.setPositions(places)
        random = np.random.default_rng(4)
        self.integrator.setBodyVelocities(velocity*random.normal(size=(bodies, 3)))
        self.integrator.setBodyAngularVelocities(random.normal(size=(bodies, 3)))

    def run(self, reporter, steps=6):
        """The data that the reporter should have recorded, as one dict for each frame."""
        seen = []
        self.simulation.reporters.append(reporter)
        for _ in range(steps):
            self.simulation.step(1)
            integrator = self.integrator
            state = self.simulation.context.getState(getPositions=True)
            seen.append({
                'time': state.getTime()._value,
                'step': self.simulation.currentStep,
                'R': integrator.getBodyPositions()._value,
                'q': integrator.getBodyOrientations(),
                'v': integrator.getBodyVelocities()._value,
                'omega': integrator.getBodyAngularVelocities()._value,
                'box': state.getPeriodicBoxVectors(asNumpy=True)._value,
                'x': state.getPositions(asNumpy=True)._value
            })
        return {name: np.array([frame[name] for frame in seen]) for name in seen[0]}


TRICLINIC = ((4, 0, 0), (-0.5, 4.5, 0), (1.1, 0.7, 5))
BOXES = pytest.mark.parametrize('periodic', [None, ((4, 0, 0), (0, 4.5, 0), (0, 0, 5)), TRICLINIC],
                                ids=['open', 'cuboid', 'triclinic'])


def checkAgainst(trajectory, seen, same, periodic):
    """same(found, expected) compares arrays."""
    assert len(trajectory) == len(seen['step']) and np.array_equal(trajectory.step, seen['step'])
    assert np.array_equal(trajectory.time.value_in_unit(unit.picosecond), seen['time'])
    same(trajectory.positions.value_in_unit(unit.nanometer), seen['R'])
    same(trajectory.orientations, seen['q'])
    same(trajectory.velocities.value_in_unit(unit.nanometer/unit.picosecond), seen['v'])
    same(trajectory.angularVelocities.value_in_unit(unit.radian/unit.picosecond), seen['omega'])
    same(trajectory.blobPositions.value_in_unit(unit.nanometer), seen['x'][:, [0, 1, 3, 4, 6, 8]])
    same(trajectory.blobRadii.value_in_unit(unit.nanometer),
         np.array([0.25, 0.35, 0.25, 0.35, 0.5, 0.15]))
    assert trajectory.blobBodies.tolist() == [0, 0, 1, 1, 2, -1
                                              ] and trajectory.types == ['body0', 'body0', 'body1']
    if periodic is None:
        assert trajectory.boxVectors is None
    else:
        same(trajectory.boxVectors.value_in_unit(unit.nanometer), seen['box'])


# ---- Write and read ------------------------------------------------------------------------------


@BOXES
def test_h5md_comes_back_bit_for_bit(tmp_path, periodic):
    scene = Scene(periodic)
    seen = scene.run(
        app.H5mdReporter(tmp_path/'x.h5', 1, velocities=True, blobs=True, radii=scene.radii))
    trajectory = app.readH5md(tmp_path/'x.h5')

    def same(found, expected):
        assert found.dtype == expected.dtype == np.float64 and np.array_equal(found, expected)

    checkAgainst(trajectory, seen, same, periodic)
    if periodic is not None:
        assert np.abs(seen['R']).max() > 5  # positions are unwrapped


@BOXES
def test_gsd_comes_back_in_single_precision(tmp_path, periodic):
    """A coordinate that is wrapped into the box has a rounding error, at most that of the box.
    Products of rounded numbers have a few of these errors."""
    scene = Scene(periodic, velocity=300.0)
    seen = scene.run(
        app.GsdReporter(tmp_path/'x.gsd', 1, velocities=True, blobs=True, radii=scene.radii))
    trajectory = app.readGsd(tmp_path/'x.gsd')
    assert np.abs(seen['R']).max() > 20

    def same(found, expected):
        assert found.shape == expected.shape and found.dtype == np.float64
        scale = np.abs(expected).max() if periodic is None else np.minimum(
            np.abs(expected).max(), 20*np.ones(()))
        images = 0 if periodic is None else np.abs(
            expected).max()  # the box itself is rounded, which images multiply
        assert np.abs(found - expected).max() <= 8*SINGLE*(scale + images)

    checkAgainst(trajectory, seen, same, periodic)


def test_frames_go_into_the_functions_of_analysis(tmp_path):
    """In free motion the mean square displacement is (v t)^2, for both kinds of file."""
    scene = Scene(velocity=1.0)
    scene.simulation.reporters.append(app.H5mdReporter(tmp_path/'x.h5', 2))
    seen = scene.run(app.GsdReporter(tmp_path/'x.gsd', 2), 40)
    for trajectory in app.readH5md(tmp_path/'x.h5'), app.readGsd(tmp_path/'x.gsd'):
        assert trajectory.velocities is None and trajectory.blobPositions is None and len(
            trajectory) == 20
        assert trajectory.frameInterval.value_in_unit(unit.picosecond) == pytest.approx(0.02)
        msd = analysis.translationalMSD(trajectory.positions, trajectory.orientations,
                                        trajectory.frameInterval, (0, 0, 0), lags=[1,
                                                                                   4], numBlocks=2)
        expected = np.mean(np.sum(seen['v'][0]**2, axis=1))*np.array([0.02, 0.08])**2
        assert np.allclose(msd.trace.mean._value, expected, rtol=1e-4)
        analysis.rotationalMSD(trajectory.orientations, trajectory.frameInterval, lags=[1],
                               numBlocks=2)


def test_intervals_between_frames():
    def trajectory(times):
        return app.Trajectory(np.array(times)*unit.picosecond, np.arange(len(times)), None, None)

    assert trajectory([0, 0.5, 1]).frameInterval == 0.5*unit.picosecond
    with refused('frameInterval: the trajectory has 1 frames', 'an interval needs at least two'):
        trajectory([1]).frameInterval
    with refused('frameInterval: frames 2 and 3 are 2 ps apart', 'take a part of the trajectory'):
        trajectory([0, 1, 2, 4]).frameInterval


# ---- What other programs find --------------------------------------------------------------------


def text(value):
    assert isinstance(value, np.bytes_), 'strings are of fixed length'
    return value.decode('ascii')


@BOXES
def test_the_structure_is_that_of_h5md(tmp_path, periodic):
    """Files follow specification 1.1 and its module units 1.0, in all that these require of the
    data."""
    scene = Scene(periodic)
    scene.run(
        app.H5mdReporter(tmp_path/'x.h5', 1, velocities=True, blobs=True, radii=scene.radii,
                         author='Ada'), 3)
    with h5py.File(tmp_path/'x.h5') as file:
        assert file['h5md'].attrs['version'].tolist() == [
            1, 1
        ] and file['h5md'].attrs['version'].dtype.kind == 'i'
        assert text(file['h5md/author'].attrs['name']) == 'Ada'
        assert text(file['h5md/creator'].attrs['name']) == 'openmm-rigidhi'
        assert text(file['h5md/creator'].attrs['version']) == openmmrigidhi.__version__
        assert file['h5md/modules/units'].attrs['version'].tolist() == [1, 0] and text(
            file['h5md/modules/units'].attrs['system']) == 'SI'
        assert set(file) == {'h5md', 'particles', 'parameters'}
        for name, count in (('bodies', 3), ('blobs', 6)):
            group = file['particles'][name]
            box = group['box']
            assert box.attrs['dimension'] == 3 and box.attrs['dimension'].shape == (
            ) and box.attrs['dimension'].dtype.kind == 'i'
            assert box.attrs['boundary'].shape == (3,) and box.attrs['boundary'].dtype.kind == 'S'
            assert set(box.attrs['boundary']) == {b'none' if periodic is None else b'periodic'}
            assert ('edges' in box) == (periodic is not None)
            elements = [
                group[element] for element in group
                if isinstance(group[element], h5py.Group) and element != 'box'
            ]
            elements += [box['edges']] if 'edges' in box else []
            assert len(elements) == (4 if name == 'bodies' else 1) + (periodic is not None)
            for element in elements:
                assert set(element) == {'step', 'time', 'value'}
                assert element['step'].dtype.kind == 'i' and element['step'].shape == element[
                    'time'].shape == (3,)
                assert np.all(np.diff(element['step']) > 0) and np.all(np.diff(element['time']) > 0)
                assert len(element['value']) == 3 and text(element['time'].attrs['unit']) == 'ps'
                # Hard links share one data set.
                assert element['step'] == group['position/step'] and element['time'] == group[
                    'position/time']
            assert group['position/value'].shape == (3, count, 3) and text(
                group['position/value'].attrs['unit']) == 'nm'
        bodies = file['particles/bodies']
        assert bodies['orientation/value'].shape == (
            3, 3, 4) and 'unit' not in bodies['orientation/value'].attrs
        assert text(bodies['velocity/value'].attrs['unit']) == 'nm ps-1'
        assert text(bodies['angular_velocity/value'].attrs['unit']) == 'rad ps-1'
        assert bodies['mass'][:].tolist() == [10, 11, 12] and text(
            bodies['mass'].attrs['unit']) == 'u'
        assert h5py.check_enum_dtype(bodies['species'].dtype) == {'body0': 0, 'body1': 1}
        assert bodies['species'][:].tolist() == [0, 0, 1]


def test_an_author_is_found(tmp_path, monkeypatch):
    def nobody():
        raise KeyError('uid not found')

    for name, login in (('grace', lambda: 'grace'), ('unknown', nobody)):
        monkeypatch.setattr('getpass.getuser', login)
        Scene().run(app.H5mdReporter(tmp_path/'x.h5', 1), 1)
        with h5py.File(tmp_path/'x.h5') as file:
            assert text(file['h5md/author'].attrs['name']) == name


def test_the_documented_layouts_are_there(tmp_path):
    from openmmrigidhi.app import gsdfiles, h5mdfiles
    scene = Scene(TRICLINIC)
    scene.simulation.reporters.append(
        app.GsdReporter(tmp_path/'x.gsd', 1, velocities=True, blobs=True, radii=scene.radii))
    scene.run(app.H5mdReporter(tmp_path/'x.h5', 1, velocities=True, blobs=True, radii=scene.radii),
              2)
    documented = {
        line.split()[0]
        for line in h5mdfiles.__doc__.splitlines() if line.startswith('    /')
    }
    with h5py.File(tmp_path/'x.h5') as file:
        present = {'/h5md', '/particles/blobs', '/parameters/bodies'
                   } | {'/particles/bodies/' + name
                        for name in file['particles/bodies']}
    assert documented == present
    documented = {
        name
        for line in gsdfiles.__doc__.splitlines() if line.startswith('    ')
        for name in chunkNames(line)
    }
    with gsd.fl.open(name=str(tmp_path/'x.gsd'), mode=READ) as file:
        assert file.application == f'openmm-rigidhi {openmmrigidhi.__version__}; nm, ps, dalton'
        assert set(file.find_matching_chunk_names('')) - {'particles/N'} == documented


def chunkNames(line):
    """'    configuration/step, box   ...' names configuration/step and configuration/box."""
    first, *others = re.split(r', ', re.split(r'  +', line.strip())[0])
    category = first.rpartition('/')[0]
    return [first] + [f'{category}/{name}' for name in others] if category else []


def test_gsd_as_its_own_library_reads_it(tmp_path):
    scene = Scene(((4, 0, 0), (0, 4.5, 0), (0, 0, 5)))
    seen = scene.run(
        app.GsdReporter(tmp_path/'x.gsd', 1, velocities=True, radii=scene.radii,
                        types=['bell', 'bell', 'ball']), 4)
    with gsd.hoomd.open(str(tmp_path/'x.gsd'), READ) as file:
        assert file.file.schema == 'hoomd' and file.file.schema_version == (1, 4) and len(file) == 4
        for k, frame in enumerate(file):
            frame.validate()
            particles = frame.particles
            assert frame.configuration.step == k + 1 and frame.configuration.dimensions == 3
            assert frame.configuration.box.tolist() == [4, 4.5, 5, 0, 0, 0]
            assert np.all(np.abs(particles.position) <= np.array([2, 2.25, 2.5]))
            assert np.allclose(particles.position + particles.image*[4, 4.5, 5], seen['R'][k],
                               atol=1e-5)
            assert particles.types == ['bell', 'ball'] and particles.typeid.tolist() == [
                0, 0, 1
            ] and particles.body.tolist() == [-1]*3
            assert particles.mass.tolist() == [
                10, 11, 12
            ] and particles.moment_inertia.tolist() == [[3, 4, 5]]*3
            assert np.allclose(particles.diameter, [0.7, 0.7, 1])
            # In HOOMD's convention the angular momentum about the body axes is the vector part of
            # conj(q) P/2. The energies agree.
            from openmmrigidhi._quaternions import conjugate, product
            momenta = product(conjugate(particles.orientation.astype(float)),
                              particles.angmom.astype(float))/2
            energies = 0.5*(momenta[:, 1:]**2/(3, 4, 5)).sum(axis=0)
            if k == 3:
                assert np.allclose(
                    np.sort(energies),
                    np.sort(scene.integrator.computeRotationalKineticEnergies()._value), rtol=1e-5)
            bell, ball = particles.type_shapes
            assert bell == {
                'type': 'SphereUnion',
                'centers': [[-0.3, 0, 0], [0.3, 0.1, 0]],
                'diameters': [0.5, 0.7]
            }
            assert ball == {'type': 'SphereUnion', 'centers': [[0.1, 0.2, 0]], 'diameters': [1.0]}


def test_blobs_in_gsd_are_constituents_as_hoomd_has_them(tmp_path):
    scene = Scene()
    seen = scene.run(app.GsdReporter(tmp_path/'x.gsd', 1, blobs=True, radii=scene.radii), 2)
    with gsd.hoomd.open(str(tmp_path/'x.gsd'), READ) as file:
        particles = file[1].particles
        assert particles.types == ['body0', 'body1', 'blob0', 'blob1', 'blob2', 'blob3'
                                   ] and particles.N == 9
        assert particles.body.tolist() == [
            0, 1, 2, 0, 0, 1, 1, 2, -1
        ] and particles.typeid.tolist() == [0, 0, 1, 3, 4, 3, 4, 5, 2]
        assert particles.type_shapes == [{}, {}] + [{
            'type': 'Sphere',
            'diameter': d
        } for d in (0.3, 0.5, 0.7, 1.0)]
        assert np.allclose(particles.diameter[3:], [0.5, 0.7, 0.5, 0.7, 1, 0.3])
        assert np.allclose(particles.position[3:], seen['x'][1][[0, 1, 3, 4, 6, 8]],
                           atol=1e-5) and not particles.image.any()
        edge = file[1].configuration.box[0]
        assert np.log2(edge) == round(
            np.log2(edge)) and np.abs(particles.position).max() + 0.5 < edge/2


def test_a_sphere_at_its_origin_is_a_sphere(tmp_path):
    scene = Scene(ball=(0, 0, 0))
    scene.run(app.GsdReporter(tmp_path/'x.gsd', 1, radii=[0, 0, 0.2, 0, 0, 0.2, 0.4, 0, 0]), 1)
    with gsd.hoomd.open(str(tmp_path/'x.gsd'), READ) as file:
        assert file[0].particles.type_shapes[1] == {'type': 'Sphere', 'diameter': 0.8}
        assert file[0].particles.type_shapes[0] == {
            'type': 'SphereUnion',
            'centers': [[0, 0, 0.5]],
            'diameters': [0.4]
        }
    plain = Scene()
    plain.run(app.GsdReporter(tmp_path/'y.gsd', 1), 1)
    with gsd.hoomd.open(str(tmp_path/'y.gsd'), READ) as file:
        assert not any(file[0].particles.type_shapes) and file[0].particles.types == [
            'body0', 'body1'
        ]


@pytest.mark.parametrize('options, radii', [({}, [0.2]*8 + [0]),
                                            ({
                                                'tail': (0, 0, 0.51)
                                            }, [0.2]*8 + [0]), ({}, [0.2]*4 + [0.3]*4 + [0])],
                         ids=['alike', 'other sites', 'other radii'])
def test_bodies_of_one_shape_are_of_one_type(tmp_path, options, radii):
    alike = not options and len(set(radii[:6])) == 1
    scene = Scene(**options)
    scene.run(app.H5mdReporter(tmp_path/'x.h5', 1, radii=radii), 1)
    assert app.readH5md(
        tmp_path/
        'x.h5').types == (['body0', 'body0', 'body1'] if alike else ['body0', 'body1', 'body2'])


def test_radii_of_the_fluid_are_taken(tmp_path):
    Scene(fluid=True).run(app.H5mdReporter(tmp_path/'x.h5', 1, blobs=True), 1)
    assert app.readH5md(
        tmp_path/'x.h5').blobRadii._value.tolist() == [0.25, 0.35, 0.1, 0.25, 0.35, 0.1, 0.5, 0.15]


# ---- Continuing files, and crashes ---------------------------------------------------------------

KINDS = pytest.mark.parametrize('reporter, read', [(app.H5mdReporter, app.readH5md),
                                                   (app.GsdReporter, app.readGsd)],
                                ids=['H5MD', 'GSD'])


def equal(first, second):
    """Two trajectories hold the same numbers."""
    for name in ('time', 'step', 'positions', 'orientations', 'velocities', 'angularVelocities',
                 'blobPositions'):
        a, b = (getattr(trajectory, name) for trajectory in (first, second))
        a, b = (value._value if unit.is_quantity(value) else value for value in (a, b))
        if not (a is b is None or np.array_equal(a, b)):
            return False
    return first.types == second.types


@KINDS
def test_a_resumed_run_leaves_the_file_of_the_uninterrupted_one(tmp_path, reporter, read):
    options = {'velocities': True, 'blobs': True}
    first = Scene()
    first.simulation.reporters.append(reporter(tmp_path/'whole', 2, radii=first.radii, **options))
    first.simulation.reporters.append(reporter(tmp_path/'parts', 2, radii=first.radii, **options))
    first.simulation.step(5)
    first.simulation.saveCheckpoint(str(tmp_path/'checkpoint'))
    first.simulation.step(4)
    del first.simulation.reporters[1]
    first.simulation.step(3)
    second = Scene(velocity=1.0)
    second.simulation.loadCheckpoint(str(tmp_path/'checkpoint'))
    second.simulation.reporters.append(
        reporter(tmp_path/'parts', 2, append=True, radii=second.radii, **options))
    second.simulation.step(7)
    whole, parts = read(tmp_path/'whole'), read(tmp_path/'parts')
    assert whole.step.tolist() == [2, 4, 6, 8, 10, 12] and equal(whole, parts)
    assert not (tmp_path/'parts.part').exists()


@KINDS
def test_a_file_is_begun_anew_without_append_and_with_it_if_there_is_none(tmp_path, reporter, read):
    Scene().run(reporter(tmp_path/'x', 1, append=True), 3)
    assert len(read(tmp_path/'x')) == 3
    Scene().run(reporter(tmp_path/'x', 1), 2)
    assert len(read(tmp_path/'x')) == 2


@KINDS
def test_a_new_run_does_not_take_the_frames_of_another(tmp_path, reporter, read):
    """Whoever forgets to load the State with append=True must not lose the trajectory."""
    Scene().run(reporter(tmp_path/'x', 2), 6)
    for interval in 2, 5, 7:  # the new frame is before, among, and after those of the file
        with refused(reporter.__name__, 'up to step 6, and this run began at step 0',
                     'load the State'):
            Scene().run(reporter(tmp_path/'x', interval, append=True), interval)
        assert read(tmp_path/'x').step.tolist() == [2, 4, 6]
    # A State from before the first frame replaces all of them.
    begun = Scene()
    begun.simulation.step(1)
    begun.simulation.saveCheckpoint(str(tmp_path/'checkpoint'))
    begun.run(reporter(tmp_path/'early', 2), 3)
    again = Scene()
    again.simulation.loadCheckpoint(str(tmp_path/'checkpoint'))
    again.run(reporter(tmp_path/'early', 2, append=True), 7)
    assert read(tmp_path/'early').step.tolist() == [2, 4, 6, 8]


CRASH = """
import os, signal, sys
sys.path.insert(0, {tests!r})
from test_trajectories import Scene
from openmmrigidhi import app
scene = Scene()
scene.simulation.reporters.append(app.{reporter}({file!r}, 1, velocities=True))
scene.simulation.step(7)
scene.simulation.saveCheckpoint({file!r} + '.checkpoint')
scene.simulation.step(2)
os.kill(os.getpid(), signal.SIGKILL)
"""


@KINDS
def test_a_killed_run_leaves_all_frames_and_can_be_continued(tmp_path, reporter, read):
    file = str(tmp_path/'x')
    source = CRASH.format(tests=os.path.dirname(__file__), reporter=reporter.__name__, file=file)
    finished = subprocess.run([sys.executable, '-c', source], timeout=100, capture_output=True,
                              text=True)
    assert finished.returncode == -9, finished.stderr
    assert read(file).step.tolist() == list(range(1, 10))
    scene = Scene()
    scene.simulation.loadCheckpoint(file + '.checkpoint')
    scene.run(reporter(file, 1, append=True, velocities=True), 4)
    Scene().run(reporter(tmp_path/'whole', 1, velocities=True), 11)
    assert equal(read(file), read(tmp_path/'whole'))


def test_a_frame_of_h5md_that_was_half_written_is_ignored_and_overwritten(tmp_path):
    scene = Scene()
    seen = scene.run(app.H5mdReporter(tmp_path/'x.h5', 1, velocities=True), 2)
    with h5py.File(tmp_path/'x.h5', 'r+') as file:
        for name in 'position', 'orientation':
            file[f'particles/bodies/{name}/value'].resize(3, axis=0)
    assert len(app.readH5md(tmp_path/'x.h5')) == 2
    del scene.simulation.reporters[:]
    more = scene.run(app.H5mdReporter(tmp_path/'x.h5', 1, append=True, velocities=True), 1)
    trajectory = app.readH5md(tmp_path/'x.h5')
    assert trajectory.step.tolist() == [1, 2, 3] and np.array_equal(
        trajectory.positions._value, np.concatenate([seen['R'], more['R']]))


def test_a_frame_of_gsd_that_was_half_written_is_ignored_and_overwritten(tmp_path):
    """Chunks without an end of frame, as a run that is killed within a report leaves them."""
    scene = Scene()
    scene.run(app.GsdReporter(tmp_path/'x.gsd', 1), 2)
    source = (
        f"import gsd.fl, numpy, os, signal; f = gsd.fl.open(name='x.gsd', mode='{UPDATE}'); "
        "f.write_chunk('particles/position', numpy.ones((3, 3), dtype='f4')); os.kill(os.getpid(), "
        "signal.SIGKILL)")
    assert subprocess.run([sys.executable, '-c', source], cwd=tmp_path,
                          timeout=100).returncode == -9
    assert app.readGsd(tmp_path/'x.gsd').step.tolist() == [1, 2]
    del scene.simulation.reporters[:]
    more = scene.run(app.GsdReporter(tmp_path/'x.gsd', 1, append=True), 1)
    trajectory = app.readGsd(tmp_path/'x.gsd')
    assert trajectory.step.tolist() == [1, 2, 3] and np.allclose(trajectory.positions._value[2],
                                                                 more['R'][0], atol=1e-5)


@KINDS
def test_other_bodies_are_not_appended(tmp_path, reporter, read):
    Scene().run(reporter(tmp_path/'x', 1), 2)
    scene = Scene(bodies=2)
    scene.simulation.currentStep = 2
    piece = 'it has 3 bodies with 8 particles, and the integrator has 2 with 6' \
        if reporter is app.H5mdReporter else \
        'it holds 3 bodies and 0 blobs, and the frame to append 2 and 0'
    with refused(reporter.__name__, piece, 'write to another file'):
        scene.run(reporter(tmp_path/'x', 1, append=True), 1)
    assert len(read(tmp_path/'x')) == 2


def test_other_data_are_not_appended(tmp_path):
    Scene().run(app.H5mdReporter(tmp_path/'x.h5', 1, velocities=True), 2)
    for options, pieces in (({}, 'it has velocities, and the frame to append has none'), ({
            'velocities': True,
            'blobs': True
    }, 'it has no blobs, and the frame to append has ')):
        scene = Scene()
        with refused('all frames must hold the same data') as error:
            scene.run(
                app.H5mdReporter(tmp_path/'x.h5', 1, append=True, radii=scene.radii, **options), 1)
        assert pieces in str(error.value)
    scene = Scene()
    scene.run(app.H5mdReporter(tmp_path/'b.h5', 1, blobs=True, radii=scene.radii), 1)
    with refused('it has 6 blobs, and the System has 9', 'give the same radii'):
        Scene().run(app.H5mdReporter(tmp_path/'b.h5', 1, append=True, blobs=True, radii=0.1), 1)
    with h5py.File(tmp_path/'foreign.h5', 'w') as file:
        file['positions'] = np.zeros(3)
    with refused('it has no /parameters/bodies', 'a file of this reporter'):
        Scene().run(app.H5mdReporter(tmp_path/'foreign.h5', 1, append=True), 1)
    Scene().run(app.GsdReporter(tmp_path/'x.gsd', 1, types=['a', 'a', 'b']), 1)
    with refused("types is ['a', 'b'], and the frame to append has ['a', 'c']", 'give those types'):
        Scene().run(app.GsdReporter(tmp_path/'x.gsd', 1, append=True, types=['a', 'a', 'c']), 1)


# ---- Bad arguments, and files of others ----------------------------------------------------------


@KINDS
def test_bad_reporters(tmp_path, reporter, read):
    name = reporter.__name__
    for interval in (0, -1):
        with refused(name, f'reportInterval: got {interval}', 'give a number of steps'):
            reporter(tmp_path/'x', interval)
    with refused(name, 'velocities: got 1', error=TypeError):
        reporter(tmp_path/'x', 1, velocities=1)
    for options, pieces in (({
            'types': ['a']
    }, ("types: got ['a'] for 3 bodies", 'of ASCII characters')), ({
            'types': ['a', 'a', '\u00e4']
    }, ('types: got', 'of ASCII characters')), ({
            'types': ['a', 'b', 'a']
    }, ("bodies 0 and 2 are both 'a'", 'a type has one shape')), ({
            'blobs': True
    }, ('blobs: no particle has a radius', 'add a MobilityForce')), ({
            'radii': [1]
    }, ('radii: got 1 for 9 sites',))):
        with refused(name, *pieces):
            Scene().run(reporter(tmp_path/'x', 1, **options), 1)
    system = openmm.System()
    system.addParticle(1)
    topology = openmm.app.Topology()
    topology.addAtom('X', openmm.app.Element.getBySymbol('C'),
                     topology.addResidue('X', topology.addChain()))
    simulation = openmm.app.Simulation(topology, system, CustomRigidHIIntegrator(300, 0.001),
                                       REFERENCE)
    simulation.context.setPositions([(0, 0, 0)])
    simulation.reporters.append(reporter(tmp_path/'x', 1))
    with refused(name, 'the integrator has no rigid bodies', 'add bodies before'):
        simulation.step(1)


def test_h5md_of_other_programs(tmp_path):
    """A file with other units, wrapped positions with images in a box that is periodic along x and
    y only, and steps and times by increments."""
    random = np.random.default_rng(1)
    R, q = random.normal(size=(5, 2, 3)), random.normal(size=(5, 2, 4))
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    image = random.integers(-2, 3, size=(5, 2, 3))
    with h5py.File(tmp_path/'x.h5', 'w') as file:
        file.create_group('h5md').attrs['version'] = [1, 0]
        group = file.create_group('particles/colloids')
        for name, value in (('position', R), ('orientation', q), ('image', image), ('velocity', R)):
            group[f'{name}/value'] = value
            group[f'{name}/step'], group[f'{name}/time'] = 10, 0.25
            group[f'{name}/step'].attrs['offset'], group[f'{name}/time'].attrs['offset'] = 100, 1.5
            group[f'{name}/time'].attrs['unit'] = 'ns'
        group['position/value'].attrs['unit'] = np.bytes_('Angstrom')
        group['velocity/value'].attrs['unit'] = '60 um+1 s-1'
        box = group.create_group('box')
        box.attrs['boundary'] = np.array(['periodic', 'periodic', 'none'], dtype='S')
        box['edges'] = np.array([20.0, 30, 40])
        box['edges'].attrs['unit'] = 'Ang'
        group['species'] = np.array([7, 8])
    trajectory = app.readH5md(tmp_path/'x.h5')
    assert np.allclose(trajectory.time.value_in_unit(unit.nanosecond), 1.5 + 0.25*np.arange(5))
    assert trajectory.step.tolist() == [100, 110, 120, 130, 140] and trajectory.types == ['7', '8']
    assert np.allclose(trajectory.positions.value_in_unit(unit.angstrom), R + image*[20, 30, 0])
    assert np.array_equal(trajectory.orientations, q)
    assert np.allclose(trajectory.velocities.value_in_unit(unit.micrometer/unit.second), 60*R)
    assert np.allclose(trajectory.boxVectors.value_in_unit(unit.angstrom), np.diag(
        [20, 30, 40])) and len(trajectory.boxVectors) == 5
    assert app.readH5md(tmp_path/'x.h5', 'colloids').frameInterval == 250*unit.picosecond
    with refused("group: 'dust' is not there; the groups are colloids"):
        app.readH5md(tmp_path/'x.h5', 'dust')
    with h5py.File(tmp_path/'x.h5', 'r+') as file:
        file['particles/colloids/velocity/value'].attrs['unit'] = 'nm ps'
    with refused('/particles/colloids/velocity/value: its unit is', "'nm ps'",
                 'must be a unit of velocity'):
        app.readH5md(tmp_path/'x.h5')
    with h5py.File(tmp_path/'x.h5', 'r+') as file:
        file['particles/colloids/position/value'].attrs['unit'] = 'furlong'
    with refused("its unit is 'furlong'; it must be a unit of length"):
        app.readH5md(tmp_path/'x.h5')
    with h5py.File(tmp_path/'x.h5', 'r+') as file:
        del file['particles/colloids/position/time']
    with refused('has no time, only steps', 'trajectories need times'):
        app.readH5md(tmp_path/'x.h5')
    with h5py.File(tmp_path/'x.h5', 'r+') as file:
        del file['particles/colloids/position']
    with refused('/particles/colloids has no position that changes with time'):
        app.readH5md(tmp_path/'x.h5')


def test_files_that_are_no_h5md(tmp_path):
    with h5py.File(tmp_path/'x.h5', 'w') as file:
        file['positions'] = np.zeros(3)
    with refused('its H5MD version is None; it must be 1.x'):
        app.readH5md(tmp_path/'x.h5')
    with h5py.File(tmp_path/'x.h5', 'r+') as file:
        file.create_group('h5md').attrs['version'] = [1, 1]
    with refused('group: None is not there; the groups are none'):
        app.readH5md(tmp_path/'x.h5')
    (tmp_path/'text.h5').write_text('frames')
    for read in (app.readH5md, app.readBodyStates):
        with refused('text.h5: it is no HDF5 file'):
            read(tmp_path/'text.h5')
        with pytest.raises(FileNotFoundError):
            read(tmp_path/'missing.h5')


def test_gsd_of_other_programs(tmp_path):
    """A file as HOOMD writes it: steps without times, a periodic box, defaults left out."""
    frames = []
    for step in (0, 50, 100):
        frame = Frame()
        frame.configuration.step, frame.configuration.box = step, [10, 10, 10, 0, 0, 0]
        frame.particles.N, frame.particles.position = 2, [[step/50, 0, 0], [0, 1, 2]]
        frame.particles.image = [[0, step // 50, 0], [0, 0, 0]]
        frames.append(frame)
    with gsd.hoomd.open(str(tmp_path/'x.gsd'), WRITE) as file:
        file.extend(frames)
    with refused('it holds steps, but no times', 'give stepSize'):
        app.readGsd(tmp_path/'x.gsd')
    trajectory = app.readGsd(tmp_path/'x.gsd', 2*unit.femtosecond)
    assert np.allclose(trajectory.time.value_in_unit(unit.picosecond),
                       [0, 0.1, 0.2]) and trajectory.types == ['A', 'A']
    assert np.allclose(trajectory.positions._value[:, 0], [(0, 0, 0), (1, 10, 0), (2, 20, 0)])
    assert np.all(trajectory.orientations == (1, 0, 0, 0)) and trajectory.velocities is None
    frames[1].particles.N = 1
    frames[1].particles.position = frames[1].particles.image = [[0, 0, 0]]
    with gsd.hoomd.open(str(tmp_path/'y.gsd'), WRITE) as file:
        file.extend(frames)
    with refused('frame 1 has 1 particles, frame 0 has 2', 'split the file'):
        app.readGsd(tmp_path/'y.gsd', 1)
    gsd.hoomd.open(str(tmp_path/'z.gsd'), WRITE).close()
    with refused('it has no frames to read'):
        app.readGsd(tmp_path/'z.gsd')


def written(name, steps, changed=1, **changes):
    """Write frames of a body with two constituents and of a sphere; one frame is changed."""
    with gsd.hoomd.open(str(name), WRITE) as file:
        for k, step in enumerate(steps):
            frame = Frame()
            frame.configuration.step, frame.configuration.box = step, [10, 10, 10, 0, 0, 0]
            frame.particles.N, frame.particles.position = 4, np.eye(4)[:, :3]
            frame.particles.types, frame.particles.typeid = ['A', 'B'], [0, 1, 1, 0]
            frame.particles.body = [0, 0, 0, 3]
            for key, value in changes.items() if k == changed else ():
                setattr(frame.particles, key, value)
            file.append(frame)
    return name


def test_steps_of_gsd_that_go_back(tmp_path):
    name = written(tmp_path/'x.gsd', (0, 50, 20, 70))
    with refused(
            'x.gsd: frame 2 is of step 20, and frame 1 before it of step 50; steps must not go '
            'back: split the file, or give frames'):
        app.readGsd(name, 1)
    assert app.readGsd(name, 1, slice(2, None)).step.tolist() == [20, 70]
    with refused('frame 3 is of step 30, and frame 1 before it of step 50'):
        app.readGsd(written(tmp_path/'y.gsd', (0, 50, 20, 30)), 1, slice(1, None, 2))
    name = written(tmp_path/'z.gsd', (0, 50, 50, 70))
    assert app.readGsd(name, 1).step.tolist() == [0, 50, 50, 70]


@pytest.mark.parametrize('frame', [0, 1])
@pytest.mark.parametrize('changes, message',
                         [({
                             'typeid': [0, 1, 2, 0]
                         }, 'particle 2 has the typeid 2; the frame has 2 types, counted from 0'),
                          ({
                              'body': [0, 0, 4, 3]
                          }, 'particle 2 has the body 4; a body must be one of the 4 particles'),
                          ({
                              'body': [0, 0, 1000000, 3]
                          }, 'particle 2 has the body 1000000; a body must be one of the 4'),
                          ({
                              'body': [0, 0, 1, 3]
                          }, 'particle 2 has the body 1; a body must be one of the 4 particles, '
                           'counted from 0, whose own body it is')])
def test_types_and_bodies_of_gsd_that_are_not_there(tmp_path, frame, changes, message):
    name = written(tmp_path/'x.gsd', (0, 50, 100), frame, **changes)
    with refused(f'x.gsd: frame {frame}: {message}'):
        app.readGsd(name, 1)


def test_gsd_is_not_needed_until_it_is(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'gsd.hoomd', None)
    for use in (lambda: app.GsdReporter(tmp_path/'x.gsd', 1),
                lambda: app.readGsd(tmp_path/'x.gsd')):
        with refused('GSD files need the Python package gsd',
                     'install the Debian package python3-gsd', error=ImportError):
            use()
    Scene().run(app.H5mdReporter(tmp_path/'x.h5', 1), 1)
