"""H5MD files of other programs: elements with steps of their own, ids, boxes of all kinds."""
import re
import warnings

import h5py
import numpy as np
import pytest
from test_trajectories import Scene

from openmmrigidhi import app

STEPS = np.arange(5)*10
BODIES = 3


def refused(*pieces, error=ValueError):
    return pytest.raises(error, match='.*'.join(re.escape(piece) for piece in pieces))


def perBody(steps, width=3):
    """An entry that tells its step and its body: step + body/8, in each of some components."""
    return (np.asarray(steps, dtype=float)[:, None, None] + np.arange(BODIES)[:, None]/8 +
            np.zeros(width))


def turned(steps):
    """Quaternions (T, BODIES, 4) about z by angles that tell step and body."""
    half = perBody(steps, 1)[..., 0]/100
    return np.stack([np.cos(half), 0*half, 0*half, np.sin(half)], axis=-1)


def angles(trajectory):
    return 100*np.arctan2(trajectory.orientations[..., 3], trajectory.orientations[..., 0])


def element(group, name, values, steps=None, scalar=None):
    """A static element without steps; with scalar = (increment, offset) steps are not explicit."""
    if steps is None and scalar is None:
        group[name] = values
        return group[name]
    made = group.create_group(name)
    made['value'] = values
    if scalar is None:
        made['step'], made['time'] = np.asarray(steps), 0.5*np.asarray(steps)
    else:
        made['step'], made['time'] = scalar[0], 0.5*scalar[0]
        if scalar[1]:
            made['step'].attrs['offset'], made['time'].attrs['offset'] = scalar[1], 0.5*scalar[1]
    return made


class File:
    """A file whose entries tell step and body, and what should be read of it.

    Of each element named in `elements` the value is its steps, (increment, offset, count), or None
    where it is static.
    """
    def __init__(self, path, elements=(), ids=None, periodic=True):
        self.path = path
        with h5py.File(path, 'w') as file:
            file.create_group('h5md').attrs['version'] = [1, 1]
            group = file.create_group('particles/rods')
            box = group.create_group('box')
            box.attrs['dimension'] = 3
            box.attrs['boundary'] = np.array(['periodic' if periodic else 'none']*3, dtype='S')
            makers = {
                'position': perBody,
                'orientation': turned,
                'velocity': lambda steps: 1000 + perBody(steps),
                'angular_velocity': lambda steps: -perBody(steps),
                'image': lambda steps: np.rint(8*perBody(steps)).astype(int),
                'box/edges': lambda steps: 1000.0 + np.asarray(steps)[:, None] + np.zeros(3),
            }
            for name, maker in makers.items():
                about = dict(elements).get(name, STEPS)
                scalar = about[:2] if isinstance(about, tuple) else None
                steps = np.array([7]) if about is None else np.arange(
                    about[2])*about[0] + about[1] if scalar else np.asarray(about)
                values = maker(steps)
                if ids is not None and values.ndim == 3 and values.shape[1] == BODIES:
                    values = np.stack([entry[ids(step)] for entry, step in zip(values, steps)])
                element(group, name, values[0] if about is None else values,
                        None if about is None or scalar else steps, scalar)

    def change(self):
        return h5py.File(self.path, 'r+')

    def read(self, **options):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter('always')
            self.trajectory = app.readH5md(self.path, **options)
        self.warnings = [str(each.message) for each in caught]
        return self.trajectory

    def check(self, steps, **options):
        """All numbers are of these steps and of their body."""
        found, expected = self.read(**options), perBody(steps)
        assert found.step.tolist() == list(steps) and np.allclose(found.time._value,
                                                                  0.5*np.asarray(steps))
        assert np.allclose(angles(found), expected[..., 0])
        edges = 1000.0 + np.asarray(steps)
        if found.boxVectors is None:
            assert np.allclose(found.positions._value, expected)
        else:
            assert np.allclose(found.boxVectors._value, edges[:, None, None]*np.eye(3))
            assert np.allclose(found.positions._value, expected + 8*expected*edges[:, None, None])
        if options.get('velocities', True):
            assert np.allclose(found.velocities._value, 1000 + expected)
            assert np.allclose(found.angularVelocities._value, -expected)
        else:
            assert found.velocities is found.angularVelocities is None


# ---- Steps ---------------------------------------------------------------------------------------

OTHERS = ('orientation', 'velocity', 'angular_velocity', 'image', 'box/edges')


def test_elements_of_equal_steps_need_no_word(tmp_path):
    file = File(tmp_path/'x.h5')
    file.check(STEPS)
    assert file.warnings == []


@pytest.mark.parametrize('name', OTHERS)
@pytest.mark.parametrize('steps, common, first', [(np.arange(3)*20, [0, 20, 40], 10),
                                                  (STEPS + 10, [10, 20, 30, 40], 0),
                                                  (STEPS[:3], [0, 10, 20], 30),
                                                  (np.arange(30)*5, STEPS, None),
                                                  ([5, 10, 15, 40, 45], [10, 40], 0),
                                                  ((20, 0, 3), [0, 20, 40], 10),
                                                  ((10, 20, 3), [20, 30, 40], 0),
                                                  ((30, 10, 2), [10, 40], 0)], ids=str)
def test_entries_are_paired_by_step(tmp_path, name, steps, common, first):
    file = File(tmp_path/'x.h5', {name: steps})
    file.check(common)
    assert len(file.warnings) == (first is not None)
    if file.warnings:
        text, = file.warnings
        assert (
            f'/particles/rods/{name} has no step {first} ({5 - len(common)} of 5 steps are '
            f'missing). Only the {len(common)} frames that have all elements are read: ') in text
        assert ('velocities=False reads frames without' in text) == ('velocity' in name)


def test_positions_may_be_the_rare_ones(tmp_path):
    for steps in (np.arange(3)*20, (20, 0, 3)):
        file = File(tmp_path/'x.h5', {'position': steps})
        file.check([0, 20, 40])
        assert file.warnings == []


def test_frames_without_velocities_can_be_had(tmp_path):
    file = File(tmp_path/'x.h5', {'velocity': [0, 20], 'angular_velocity': [1000]})
    file.check(STEPS, velocities=False)
    assert file.warnings == []
    with refused('velocity has no step 10 (3 of 5', 'angular_velocity has no step 0 (5 of 5',
                 'there must be a step that all have: velocities=False reads frames without'):
        file.read()
    with refused('velocities: got 1', error=TypeError):
        file.read(velocities=1)


def test_static_elements_are_those_of_all_steps(tmp_path):
    file = File(tmp_path/'x.h5', dict.fromkeys(('orientation', 'velocity', 'image', 'box/edges')))
    found = file.read()
    assert file.warnings == [] and found.step.tolist() == STEPS.tolist()
    assert np.allclose(angles(found), perBody([7])[..., 0])
    assert np.allclose(found.velocities._value, 1000 + perBody([7]))
    assert np.allclose(found.boxVectors._value, 1007*np.eye(3))
    assert np.allclose(found.positions._value, perBody(STEPS) + 8*perBody([7])*1007)


def test_elements_that_are_not_used_do_not_count(tmp_path):
    """Without periodic directions images and edges are placeholders."""
    file = File(tmp_path/'x.h5', {'image': [3], 'box/edges': [4]}, periodic=False)
    file.check(STEPS)
    assert file.warnings == [] and file.trajectory.boxVectors is None


def test_parts_of_a_file(tmp_path):
    file = File(tmp_path/'x.h5', {'velocity': [20, 40]})
    file.check([20], frames=slice(1, 4))
    assert '(2 of 3 steps are missing)' in file.warnings[0]
    file.check([0, 20, 40], frames=slice(None, None, 2), velocities=False)
    assert len(file.read(frames=slice(7, 9))) == 0
    for frames, pieces in ((3, 'got 3; it must be a slice of integers or None'),
                           (slice('a'), "got slice(None, 'a', None)")):
        with refused('readH5md: frames: ', pieces, error=TypeError):
            file.read(frames=frames)
    with refused('frames: got slice(None, None, -1); frames are read in the order of the file'):
        file.read(frames=slice(None, None, -1))


def test_steps_that_do_not_tell(tmp_path):
    twice = [0, 10, 10, 20, 30]
    every = {name: twice for name in ('position', *OTHERS)}
    assert File(tmp_path/'x.h5', every).read().step.tolist() == twice  # they agree
    for name in 'position', 'orientation':
        with refused('/particles/rods/orientation and position have different steps, and step 10 '
                     'does not come after the step before it'):
            File(tmp_path/'x.h5', {name: twice}).read()
    file = File(tmp_path/'x.h5')
    with file.change() as handle:
        del handle['particles/rods/orientation/step']
    with refused('/particles/rods/orientation has no step; without steps nothing tells'):
        file.read()
    for steps, pieces in ((STEPS[:3], 'has 5 entries and step of shape (3,); there must be one for '
                           'each entry'), (STEPS + 0.5, 'has steps of type float64')):
        with file.change() as handle:
            handle.pop('particles/rods/orientation/step', None)
            handle['particles/rods/orientation/step'] = steps
        with refused('/particles/rods/orientation', pieces):
            file.read()
    with file.change() as handle:
        del handle['particles/rods/orientation/step']
        handle['particles/rods/orientation/step'] = STEPS*1.0
    file.check(STEPS)
    with file.change() as handle:
        del handle['particles/rods/velocity']
        handle['particles/rods/velocity/nothing'] = 1
    with refused('/particles/rods/velocity is no element of numbers'):
        file.read()


def test_the_last_frame_of_a_run_that_was_killed_is_left_out(tmp_path):
    """It may lack entries of elements whose steps are those of the positions by a link."""
    Scene().run(app.H5mdReporter(tmp_path/'x.h5', 1, velocities=True), 4)
    with h5py.File(tmp_path/'x.h5', 'r+') as file:
        file['particles/bodies/orientation/value'].resize(3, axis=0)
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        assert app.readH5md(tmp_path/'x.h5').step.tolist() == [1, 2, 3]
    with h5py.File(tmp_path/'x.h5', 'r+') as file:
        file['particles/bodies/velocity/value'].resize(1, axis=0)
    with refused('/particles/bodies/velocity has 1 entries and step of shape (4,)'):
        app.readH5md(tmp_path/'x.h5')
    assert app.readH5md(tmp_path/'x.h5', velocities=False).step.tolist() == [1, 2, 3]


def test_data_sets_in_place_of_groups_are_no_reason_to_search_their_numbers(tmp_path):
    """NumPy warns of a name that is looked for among numbers, and fails from 1.25 on."""
    file = File(tmp_path/'x.h5', dict.fromkeys(('orientation', 'image', 'box/edges')))
    with file.change() as handle:
        handle['particles/numbers'], handle['parameters/rods'] = np.arange(3), np.arange(3)
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        assert len(app.readH5md(tmp_path/'x.h5')) == 5
        with refused("group: 'numbers' is not there; the groups are rods"):
            app.readH5md(tmp_path/'x.h5', 'numbers')
        for name in 'orientation', 'position':
            with file.change() as handle:
                del handle[f'particles/rods/{name}']
            with refused(f'/particles/rods has no {name}',
                         'without this element there are no poses'):
                app.readH5md(tmp_path/'x.h5', 'rods')
    Scene().run(app.H5mdReporter(tmp_path/'y.h5', 1), 2)
    with h5py.File(tmp_path/'y.h5', 'r+') as handle:
        handle['particles/numbers'] = handle['particles/bodies/charge'] = np.arange(3)
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        scene = Scene()
        scene.simulation.currentStep = 2
        scene.run(app.H5mdReporter(tmp_path/'y.h5', 1, append=True), 2)


# ---- Ids -----------------------------------------------------------------------------------------


def shuffled(step):
    """The body in each row of a frame."""
    return np.random.default_rng(step).permutation(BODIES)


def withIds(path, ids=lambda step: 100 + shuffled(step), steps=STEPS, elements=(), **options):
    """A file whose rows are shuffled, each frame in its way, and whose ids say how."""
    file = File(path, elements, ids=shuffled)
    with file.change() as handle:
        group = handle['particles/rods'].create_group('id')
        values = np.stack([ids(step) for step in steps])
        group.create_dataset('value', data=values, **options)
        group['step'] = np.asarray(steps)
    return file


def test_bodies_are_in_the_order_of_the_first_frame(tmp_path):
    orders = [shuffled(step).tolist() for step in STEPS]
    assert len({tuple(order) for order in orders}) > 2
    file = withIds(tmp_path/'x.h5')
    found, first = file.read(), orders[0]
    expected = perBody(STEPS)[:, first]
    assert file.warnings == []
    assert np.allclose(angles(found), expected[..., 0])
    assert np.allclose(found.velocities._value, 1000 + expected)
    assert np.allclose(found.angularVelocities._value, -expected)
    assert np.allclose(found.positions._value, expected + 8*expected*(1000 + STEPS)[:, None, None])


def test_ids_at_other_steps_and_parts_of_a_file(tmp_path):
    file = withIds(tmp_path/'x.h5', steps=[0, 20, 40, 60])
    assert file.read().step.tolist() == [0, 20, 40]
    assert '/particles/rods/id has no step 10' in file.warnings[0]
    file = withIds(tmp_path/'x.h5', elements={'velocity': [10, 40]})
    found = file.read(frames=slice(1, None))
    assert found.step.tolist() == [10, 40]
    assert np.allclose(found.velocities._value, 1000 + perBody([10, 40])[:, shuffled(10)])


def test_ids_that_do_not_change_order_need_nothing(tmp_path):
    file = File(tmp_path/'x.h5')
    with file.change() as handle:
        handle['particles/rods/id'] = [9, 3, 5]
        handle['particles/rods/species'] = [1, 2, 3]
    file.check(STEPS)
    assert file.trajectory.types == ['1', '2', '3'] and file.warnings == []


def test_rows_that_are_always_absent_are_no_bodies(tmp_path):
    """A fill value that was defined for the ids marks a row without a particle."""
    def ids(step):
        return np.where(shuffled(step) == 1, -1, shuffled(step))

    found = withIds(tmp_path/'x.h5', ids, fillvalue=-1).read()
    present = [body for body in shuffled(0) if body != 1]
    assert np.allclose(angles(found), perBody(STEPS)[:, present, 0])
    assert found.velocities.shape == (5, 2, 3)
    # 0 is an id like others, unless a file says that it marks absent ones.
    assert withIds(tmp_path/'y.h5', shuffled).read().positions.shape == (5, 3, 3)


def test_bodies_that_are_not_always_there(tmp_path):
    def changed(step, body, value):
        return np.where((shuffled(step) == body) & (step == 20), value, shuffled(step))

    where = '/particles/rods/id in frame 2 (step 20) '
    for value, options, pieces in ((7, {},
                                    'has the id 7, which frame 0 does not have; each body must be '
                                    'there in every frame'), (0, {}, 'has the id 0 twice; each '
                                                              'body has an id of its own'),
                                   (-1, {
                                       'fillvalue': -1
                                   }, 'lacks the id 1, which frame 0 has')):
        file = withIds(tmp_path/'x.h5', lambda step: changed(step, 1, value), **options)
        with refused('readH5md: ', 'x.h5: ' + where + pieces):
            file.read()
        assert len(file.read(frames=slice(2))) == 2
    file = withIds(tmp_path/'x.h5', lambda step: np.arange(4))
    with refused('has entries of shape (3, 3), id of (4,); there must be a row for each id'):
        withIds(tmp_path/'x.h5', lambda step: np.roll(np.arange(4), step)).read()
    with refused('has entries of shape (3,) and type float64; an id is one integer for each body'):
        withIds(tmp_path/'x.h5', lambda step: shuffled(step)*1.0).read()


def test_static_rows_beside_ids_that_change_order(tmp_path):
    for species in ([1, 2, 3], [4, 4, 4]):
        file = withIds(tmp_path/'x.h5')
        with file.change() as handle:
            handle['particles/rods/species'] = species
        if species[0] == 4:
            assert file.read().types == ['4']*3
            continue
        with refused('/particles/rods/species does not change with time, but the order of the ids '
                     'does; nothing tells which of its rows belongs to which body'):
            file.read()


def test_species_may_have_steps(tmp_path):
    kinds = h5py.enum_dtype({'rod': 3, 'disc': 7, 'ball': 9})
    for values, steps, types in ((None, STEPS, True), (None, STEPS[1:3], True), (None, [5], False),
                                 (9, STEPS, False)):
        file = withIds(tmp_path/'x.h5')
        with file.change() as handle:
            species = np.array([np.array([3, 7, 9])[shuffled(step)] for step in steps])
            species[0] = values or species[0]
            group = handle['particles/rods'].create_group('species')
            group.create_dataset('value', data=species, dtype=kinds)
            group['step'] = steps
        found = file.read()
        if types:
            assert found.types == [['rod', 'disc', 'ball'][k] for k in shuffled(0)]
            assert file.warnings == []
        else:
            assert found.types is None
            assert 'species changes with time, or has no entry at the steps' in file.warnings[0]
    file = File(tmp_path/'y.h5')
    with file.change() as handle:
        handle['particles/rods/species'] = [1, 2]
    with refused('species has entries of shape (2,); there must be a type for each of 3 bodies'):
        file.read()


# ---- Continuing files ----------------------------------------------------------------------------


def test_a_file_with_other_changing_elements_is_not_continued(tmp_path):
    """Their numbers of entries would no longer be those of the frames."""
    for name in 'id', 'image':
        Scene().run(app.H5mdReporter(tmp_path/'x.h5', 1), 3)
        with h5py.File(tmp_path/'x.h5', 'r+') as file:
            group = file['particles/bodies']
            element(group, name, np.zeros((3, 3), int), [1, 2, 3])
            assert list(group['id/step' if name == 'id' else 'image/step']) == [1, 2, 3]
        with refused(
                f'H5mdReporter: {tmp_path/"x.h5"}: it has /particles/bodies/{name}/',
                'changes with time and which this reporter does not write; each frame must '
                'extend all that changes'):
            Scene().run(app.H5mdReporter(tmp_path/'x.h5', 1, append=True), 1)


def test_a_copy_without_the_links_is_read_but_not_continued(tmp_path):
    """Some tools copy each data set for itself, so that each element gets steps of its own."""
    seen = Scene().run(app.H5mdReporter(tmp_path/'x.h5', 1), 3)
    with h5py.File(tmp_path/'x.h5', 'r+') as file:
        group = file['particles/bodies/orientation']
        for name in 'step', 'time':
            values = group[name][:]
            del group[name]
            group.create_dataset(name, data=values, maxshape=(None,))
    assert np.array_equal(app.readH5md(tmp_path/'x.h5').orientations, seen['q'])
    with refused('it has /particles/bodies/orientation/step, which changes with time'):
        Scene().run(app.H5mdReporter(tmp_path/'x.h5', 1, append=True), 1)


# ---- Boxes ---------------------------------------------------------------------------------------


def withBox(path, dimension, boundary, edges, steps=None, image=None, velocity=None, spin=None):
    """A file of two frames of one body at (1, 2, 3) or (1, 2), and a box."""
    with h5py.File(path, 'w') as file:
        file.create_group('h5md').attrs['version'] = [1, 1]
        group, two = file.create_group('particles/rods'), [0, 10]
        size = dimension or 3
        element(group, 'position', np.tile([1.0, 2, 3][:size], (2, 1, 1)), two)
        element(group, 'orientation', np.tile([1.0, 0, 0, 0], (2, 1, 1)), two)
        for name, values in (('image', image), ('velocity', velocity), ('angular_velocity', spin)):
            if values is not None:
                element(group, name, np.asarray([[values]]*2), two)
        box = group.create_group('box')
        if dimension is not None:
            box.attrs['dimension'] = dimension
        if boundary is not None:
            box.attrs['boundary'] = boundary
        if edges is not None:
            element(box, 'edges', np.asarray(edges), steps)
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        return app.readH5md(path)


def names(*boundary):
    return np.array(boundary, dtype='S')


TRICLINIC = [[4.0, 0, 0], [1, 5, 0], [0, 2, 6]]


@pytest.mark.parametrize(
    'boundary, edges, steps, vectors, moved',
    [(names(*['periodic']*3), [4.0, 5, 6], None, np.diag([4, 5, 6]), (4, -5, 12)),
     (names(*['periodic']*3), 4.0, None, 4*np.eye(3), (4, -4, 8)),
     (names(*['periodic']*3), [4.0], None, 4*np.eye(3), (4, -4, 8)),
     (names(*['periodic']*3), [4.0, 8], [0, 10], [4*np.eye(3), 8*np.eye(3)], [[(4, -4, 8)],
                                                                              [(8, -8, 16)]]),
     (names(*['periodic']*3), [[4.0, 5, 6], [8, 5, 6]], [0, 10],
      [np.diag([4, 5, 6]), np.diag([8, 5, 6])], [[(4, -5, 12)], [(8, -5, 12)]]),
     (names(*['periodic']*3), TRICLINIC, None, TRICLINIC, (3, -1, 12)),
     (names(*['periodic']*3), [TRICLINIC]*2, [0, 10], TRICLINIC, (3, -1, 12)),
     (names('periodic', 'none', 'periodic'), TRICLINIC, None, TRICLINIC, (4, 4, 12)),
     (names('none', 'periodic', 'none'), [np.inf, 5, np.nan], None, np.diag([0, 5, 0]), (0, -5, 0)),
     ('periodic', [4, 5, 6], None, np.diag([4, 5, 6]), (4, -5, 12)),
     (['periodic ', 'periodic', 'none'], [4, 5, 6], None, np.diag([4, 5, 6]), (4, -5, 0)),
     (None, [4, 5, 6], None, np.diag([4, 5, 6]), (4, -5, 12)),], ids=range(12))
def test_boxes(tmp_path, boundary, edges, steps, vectors, moved):
    found = withBox(tmp_path/'x.h5', 3, boundary, edges, steps, image=[1, -1, 2])
    assert np.allclose(found.boxVectors._value, vectors) and found.boxVectors.shape == (2, 3, 3)
    assert np.allclose(found.positions._value, np.array([1, 2, 3]) + moved)


@pytest.mark.parametrize('edges, vectors, moved', [([4.0, 5], np.diag([4, 5, 0]), (4, -5, 0)),
                                                   (4.0, np.diag([4, 4, 0]), (4, -4, 0)),
                                                   ([[4.0, 0], [1, 5]], [(4, 0, 0), (1, 5, 0),
                                                                         (0, 0, 0)], (3, -5, 0))],
                         ids=range(3))
@pytest.mark.parametrize('dimension', [2, [2], None])
def test_two_dimensions(tmp_path, edges, vectors, moved, dimension):
    boundary = names('periodic', 'periodic')
    found = withBox(tmp_path/'x.h5', 2, boundary, edges, image=[1, -1], velocity=[7.0, 8], spin=9.0)
    if dimension != 2:
        with h5py.File(tmp_path/'x.h5', 'r+') as file:
            del file['particles/rods/box'].attrs['dimension']
            if dimension:
                file['particles/rods/box'].attrs['dimension'] = dimension
        found = app.readH5md(tmp_path/'x.h5')
    assert np.allclose(found.positions._value, np.array([1, 2, 0]) + moved)
    assert np.allclose(found.boxVectors._value, vectors)
    assert np.allclose(found.velocities._value, (7, 8, 0))
    assert np.allclose(found.angularVelocities._value, (0, 0, 9))
    app.movie(tmp_path/'x.h5', tmp_path/'x.gif', radii=0.5, quiet=True)


def test_open_boxes(tmp_path):
    for edges in (None, [4, 5, 6]):
        found = withBox(tmp_path/'x.h5', 3, names(*['none']*3), edges, image=[1, 2, 3])
        assert found.boxVectors is None and np.allclose(found.positions._value, (1, 2, 3))
    # Images of 0 need no box.
    found = withBox(tmp_path/'x.h5', 3, names(*['periodic']*3), None, image=[0, 0, 0])
    assert found.boxVectors is None and np.allclose(found.positions._value, (1, 2, 3))


@pytest.mark.parametrize(
    'options, pieces',
    [(dict(dimension=1), '/particles/rods/box: dimension is 1; bodies have poses in 2 or 3'),
     (dict(boundary=names('periodic', 'mirror', 'none')),
      'boundary is periodic, mirror, none; it must be none or periodic for each of 3 directions'),
     (dict(boundary=names('periodic', 'none')), 'boundary is periodic, none; it must be'),
     (dict(edges=[4.0, 5]),
      'edges has entries of shape (2,); in 3 dimensions an edge must be one number'),
     (dict(edges=[4.0, np.nan, 5]), 'frame 0: box is [[ 4.'),
     (dict(edges=[4.0, 0, 5]), 'edges is 0 in frame 0 along a periodic direction'),
     (dict(edges=None), 'image is not 0, but the group has no box/edges; positions cannot be '
      'unwrapped'),
     (dict(image=[1, 2]),
      'image has the shape (2, 1, 2); images must have that of the positions, (2, 1, 3)'),
     (dict(image=[1, np.inf, 2]), 'frame 0, body 0: image is [ 1. inf  2.]'),
     (dict(velocity=[1.0, 2]),
      'velocity has the shape (2, 1, 2); velocities of 1 bodies in 2 frames must have'),
     (dict(spin=1.0),
      'angular_velocity has the shape (2, 1); velocities of 1 bodies in 2 frames must have'),],
    ids=lambda value: ' '.join(value) if isinstance(value, dict) else '')
def test_boxes_that_tell_nothing(tmp_path, options, pieces):
    about = dict(dimension=3, boundary=names(*['periodic']*3), edges=[4.0, 5, 6], image=[1, 1, 1])
    with refused('readH5md: ', 'x.h5: ', pieces):
        withBox(tmp_path/'x.h5', **{**about, **options})


def test_images_without_a_box(tmp_path):
    with refused('image is not 0, but the group has no box/edges'):
        withBox(tmp_path/'x.h5', 3, None, None, image=[0, 1, 0])
    with h5py.File(tmp_path/'x.h5', 'r+') as file:
        del file['particles/rods/box']
    with refused('image is not 0, but the group has no box/edges'):
        app.readH5md(tmp_path/'x.h5')
    with h5py.File(tmp_path/'x.h5', 'r+') as file:
        file['particles/rods/image/value'][...] = 0
    assert app.readH5md(tmp_path/'x.h5').boxVectors is None


def test_a_direction_is_no_orientation(tmp_path):
    file = File(tmp_path/'x.h5')
    with file.change() as handle:
        del handle['particles/rods/orientation/value']
        handle['particles/rods/orientation/value'] = perBody(STEPS)
    with refused('orientations (5, 3, 3); these must be (frames, bodies, 3) and '
                 '(frames, bodies, 4)'):
        file.read()


# ---- Blobs ---------------------------------------------------------------------------------------


def test_blobs_are_paired_by_step_and_id(tmp_path):
    scene = Scene()
    seen = scene.run(app.H5mdReporter(tmp_path/'x.h5', 1, blobs=True, radii=scene.radii), 4)
    rows, order = [0, 1, 3, 4, 6, 8], np.array([3, 5, 0, 1, 4, 2])
    with h5py.File(tmp_path/'x.h5', 'r+') as file:
        blobs = file['particles/blobs']
        del blobs['position']
        values = seen['x'][1:][:, rows]
        values[1] = values[1][order]
        element(blobs, 'position', values, [2, 3, 4])
        ids = np.tile(np.arange(6), (3, 1))
        ids[1] = order
        element(blobs, 'id', ids, [2, 3, 4])
        for name in 'radius', 'body':
            about = blobs[name][:]
            del blobs[name]
            element(blobs, name, np.array([about, about[order], about]), [2, 3, 4])
    with pytest.warns(UserWarning, match='/particles/blobs/position has no step 1 '):
        found = app.readH5md(tmp_path/'x.h5')
    assert found.step.tolist() == [2, 3, 4]
    assert np.array_equal(found.blobPositions._value, seen['x'][1:][:, rows])
    assert np.allclose(found.blobRadii._value, [0.25, 0.35, 0.25, 0.35, 0.5, 0.15])
    assert found.blobBodies.tolist() == [0, 0, 1, 1, 2, -1]
    with h5py.File(tmp_path/'x.h5', 'r+') as file:
        file['particles/blobs/radius/value'][1, 2] = 7
    with refused('radius changes with time, or is not one number for each blob'), \
            pytest.warns(UserWarning):
        app.readH5md(tmp_path/'x.h5')
    with h5py.File(tmp_path/'x.h5', 'r+') as file:
        del file['particles/blobs/position/value']
        file['particles/blobs/position/value'] = np.zeros((3, 6, 2))
    with refused('/particles/blobs/position has the shape (3, 6, 2); it must be (frames, blobs, '
                 '3)'), pytest.warns(UserWarning):
        app.readH5md(tmp_path/'x.h5')
