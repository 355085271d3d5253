"""Pictures and films of bodies: every sphere is drawn at its place, and near ones hide far ones."""
import re

import numpy as np
import openmm
import openmm.app
import pytest

matplotlib = pytest.importorskip('matplotlib')
matplotlib.use('Agg')

from openmm import unit  # noqa: E402

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, app  # noqa: E402

FRONT = (0, -90)  # x to the right, z upwards, seen from negative y


def refused(*pieces, error=ValueError):
    return pytest.raises(error, match='.*'.join(re.escape(piece) for piece in pieces))


class Scene:
    """A rod of three blobs, a sphere, and a free particle."""
    def __init__(self, boundary=MobilityForce.Unbounded, periodic=False, fluid=True):
        self.system, self.fluid, self.integrator = openmm.System(), MobilityForce(
        ), CustomRigidHIIntegrator(300, 0.01)
        app.addRigidMultiblob(self.system, self.integrator, self.fluid, [(-0.5, 0, 0), (0, 0, 0),
                                                                         (0.5, 0, 0)],
                              [0.2, 0.25, 0.3], 30, (0, 5, 5))
        app.addRigidMultiblob(self.system, self.integrator, self.fluid, [(0, 0, 0)], [0.4], 20,
                              (2, 2, 2))
        self.system.addParticle(7)
        self.fluid.addParticle(0.15)
        self.fluid.setBoundary(boundary)
        if periodic:
            self.system.setDefaultPeriodicBoxVectors((4, 0, 0), (0, 5, 0), (0, 0, 6))
            force = openmm.NonbondedForce()
            force.setNonbondedMethod(openmm.NonbondedForce.CutoffPeriodic)
            for sigma in (0.3, 0.3, 0.3, 0.8, 0.1):
                force.addParticle(0, sigma, 0.5)
            self.system.addForce(force)
        if fluid:
            self.integrator.setScheme(self.integrator.LangevinHI)
            self.system.addForce(self.fluid)
        app.bindBodies(self.system, self.integrator)
        topology = openmm.app.Topology()
        residue = topology.addResidue('X', topology.addChain())
        for _ in range(5):
            topology.addAtom('X', openmm.app.Element.getBySymbol('C'), residue)
        self.simulation = openmm.app.Simulation(topology, self.system, self.integrator,
                                                openmm.Platform.getPlatformByName('Reference'))
        self.context = self.simulation.context
        self.context.setPositions([(0.5, 2, 2), (1, 2, 2), (1.5, 2, 2), (2.5, 1, 3), (3, 3, 1)])


def discs(ax):
    """Offsets, widths and colours of the discs with which spheres are drawn, from the farthest to
    the nearest.
    """
    collection, = (each for each in ax.collections if type(each).__name__ == 'EllipseCollection')
    return np.array(
        collection.get_offsets()), 2*collection._widths, collection.get_facecolors()[:, :3]


def rims(ax):
    """Places and radii of spheres. A sphere is drawn with four discs, of which the first and
    largest has its radius."""
    offsets, widths, _ = discs(ax)
    return [(tuple(np.round(offset, 9)), round(width/2, 9))
            for offset, width in zip(offsets, widths)]


@pytest.fixture(autouse=True)
def closeFigures():
    yield
    import matplotlib.pyplot as plt
    plt.close('all')


def test_spheres_are_where_they_are_seen():
    """From the front a sphere at (x, y, z) is a disc at (x, z), as large as it is."""
    ax = app.show(Scene().context, view=FRONT)
    for x, z, radius in ((0.5, 2, 0.2), (1, 2, 0.25), (1.5, 2, 0.3), (2.5, 3, 0.4), (3, 1, 0.15)):
        assert ((x, z), radius) in rims(ax)
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    assert left < 0.3 and right > 3.15 and low < 0.85 and high > 3.4 and ax.get_title(
    ) == 't = 0 ps'


@pytest.mark.parametrize('time, text', [(2.5, '2.5 ps'), (4e3, '4 ns'), (3.5e13, '35 s')])
def test_the_time_is_in_a_unit_that_people_read(time, text):
    context = Scene().context
    context.setTime(time)
    assert app.show(context).get_title() == f't = {text}'


@pytest.mark.parametrize('view', [(20, -60), FRONT, (5, 10)])
def test_a_wall_is_within_the_picture(view):
    """Bodies far from each other have a wide wall, whose corners are seen."""
    scene = Scene(MobilityForce.NoSlipWall)
    scene.context.setPositions([(60, 70, 2), (60.5, 70, 2), (61, 70, 2), (-20, -30, 3), (3, 3, 1)])
    ax = app.show(scene.context, view=view)
    wall, = ax.patches
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    x, y = wall.get_xy().T
    assert left < x.min() and x.max() < right and low < y.min() and y.max() < high


@pytest.mark.parametrize('view, first, last', [(FRONT, (3, 1), (2.5, 3)),
                                               ((0, 90), (-2.5, 3), (-3, 1)),
                                               ((90, -90), (3, 3), (2.5, 1))])
def test_the_nearest_is_drawn_last(view, first, last):
    """The depth is that of the centres: y seen from the front, -y from behind, z from above."""
    found = rims(app.show(Scene().context, view=view))
    places = [place for place, _ in found]
    assert places.index(first) < places.index(last)


def test_marks_turn_with_a_sphere_and_hide_behind_it():
    """A white mark is on the axis x of the body, a black one on z. If the white mark points to the
    viewer, half a turn about z hides it."""
    scene = Scene()
    for turn, white, black in (((1, 0, 0, 0), False,
                                False), ((np.sqrt(0.5), 0, 0, -np.sqrt(0.5)), True,
                                         False), ((np.sqrt(0.5), 0, 0, np.sqrt(0.5)), False, False),
                               ((np.sqrt(0.5), np.sqrt(0.5), 0, 0), False, True)):
        q = scene.integrator.getBodyOrientations()
        q[1] = turn
        scene.integrator.setBodyOrientations(q)
        offsets, _, colours = discs(app.show(scene.context, view=FRONT))
        at = np.hypot(*(offsets - (2.5, 3)).T) < 0.02
        assert [any((colours[at] == shade).all(axis=1)) for shade in (1, 0)] == [white, black], turn


def test_a_body_is_light_where_its_own_x_is_positive():
    offsets, widths, colours = discs(app.show(Scene().context, view=FRONT))
    shade = {
        round(float(offset[0]), 6): colour.sum()
        for offset, width, colour in zip(offsets, widths, colours) if width/2 in (0.2, 0.3)
    }
    assert shade[0.5] < shade[1.5]


def test_radii_come_from_the_fluid_or_sigma_or_the_caller():
    assert ((2.5, 3.0), 0.4) in rims(app.show(
        Scene(periodic=True, fluid=False).context, view=FRONT))
    assert ((2.5, 3.0), 0.7) in rims(
        app.show(Scene().context, radii=[0.1, 0.1, 0.1, 0.7, 0.1], view=FRONT))
    assert ((1.0, 2.0), 0.02) in rims(
        app.show(Scene().context, radii=[0.1, 0.02*unit.nanometer, 0.1, 0.7, 0.1], view=FRONT))


def test_walls_and_boxes():
    """From the front a wall at z = 0 is a line below all bodies. A box has twelve edges.
    """
    ax = app.show(Scene(MobilityForce.NoSlipWall).context, view=FRONT)
    wall, = ax.patches
    assert np.allclose(wall.get_xy()[:, 1], 0) and ax.get_ylim()[0] < 0
    ax = app.show(Scene(periodic=True).context, view=FRONT)
    edges, = (each for each in ax.collections if type(each).__name__ == 'LineCollection')
    points = np.concatenate(edges.get_segments())
    assert len(edges.get_segments()) == 12 and points.min() == 0 and points[:, 0].max(
    ) == 4 and points[:, 1].max() == 6 and not ax.patches


def test_bodies_are_drawn_within_the_box_unless_told_otherwise():
    """The origin decides in which box a body is drawn. A rod that reaches through a face stays
    whole."""
    scene = Scene(periodic=True)
    scene.context.setPositions([(3.5 + 4, 2 - 5, 2), (4 + 4, 2 - 5, 2), (4.5 + 4, 2 - 5, 2),
                                (2.5, 1, 3 + 12), (3, 3, 1)])
    found = rims(app.show(scene.context, view=FRONT))
    assert all(
        (((x, 2.0), radius) in found)
        for x, radius in ((-0.5, 0.2), (0.0, 0.25), (0.5, 0.3))) and ((2.5, 3.0), 0.4) in found
    found = rims(app.show(scene.context, view=FRONT, wrap=False))
    assert ((8.5, 2.0), 0.3) in found and ((2.5, 15.0), 0.4) in found


def test_axes_of_the_caller_are_taken():
    import matplotlib.pyplot as plt
    _, axes = plt.subplots(1, 2)
    assert app.show(Scene().context, ax=axes[1], title='now') is axes[1] and axes[1].get_title(
    ) == 'now' and not axes[0].collections


def written(folder, kind, **options):
    """A trajectory of 5 frames and its file, (scene, name)."""
    scene = Scene(periodic=True)
    name = str(folder/{'gsd': 'run.gsd', 'h5md': 'run.h5', 'states': 'states.h5'}[kind])
    reporter = {
        'gsd': app.GsdReporter,
        'h5md': app.H5mdReporter,
        'states': app.RigidBodyReporter
    }[kind]
    scene.simulation.reporters.append(reporter(name, 2, **options))
    scene.simulation.step(10)
    return scene, name


@pytest.mark.parametrize('kind, options', [('gsd', {}), ('gsd', {
    'blobs': True
}), ('h5md', {}), ('h5md', {
    'blobs': True
})])
def test_files_tell_sites_and_radii(tmp_path, kind, options):
    if kind == 'gsd':
        pytest.importorskip('gsd')
    _, name = written(tmp_path, kind, **options)
    trajectory = (app.readGsd if kind == 'gsd' else app.readH5md)(name)
    sites = [each.value_in_unit(unit.nanometer) for each in trajectory.sites]
    assert np.allclose(sites[0], [(-0.5, 0, 0), (0, 0, 0),
                                  (0.5, 0, 0)], atol=2e-6) and np.allclose(sites[1], 0, atol=2e-6)
    assert np.allclose(trajectory.siteRadii[0]._value, [0.2, 0.25, 0.3]) and np.allclose(
        trajectory.siteRadii[1]._value, 0.4)


@pytest.mark.parametrize('kind', ['gsd', 'h5md', 'states'])
def test_a_film_has_the_frames_of_the_file(tmp_path, kind):
    if kind == 'gsd':
        pytest.importorskip('gsd')
    from PIL import Image
    scene, name = written(tmp_path, kind)
    for every, frames in ((1, 5), (2, 3)):
        film = app.movie(name, tmp_path/f'film{every}.gif', context=scene.context, every=every,
                         width=2, quiet=True)
        with Image.open(film) as image:
            assert image.n_frames == frames and image.size[0] == 200
    assert app.movie(name, width=1, radii=0.3, every=5, walls=[('z', 0)],
                     quiet=True) == str(tmp_path/(name.rsplit('.', 1)[0] + '.gif'))


def test_pictures_of_a_film_differ_as_bodies_move(tmp_path):
    from PIL import Image
    _, name = written(tmp_path, 'h5md')
    with Image.open(app.movie(name, width=2, quiet=True)) as image:
        frames = []
        for k in range(image.n_frames):
            image.seek(k)
            frames.append(np.array(image.convert('RGB')))
    assert all((a != b).any() for a, b in zip(frames, frames[1:]))


def test_what_cannot_be_drawn_is_refused(tmp_path):
    scene, name = written(tmp_path, 'h5md')
    with refused('show', 'view', 'it must be elevation and azimuth in degrees'):
        app.show(scene.context, view=(1, 2, 3))
    with refused('movie', 'output', 'its name must end in .gif or .mp4'):
        app.movie(name, 'film.png')
    with refused('movie', 'every: got 0', 'it must be positive: give a number of frames'):
        app.movie(name, every=0)
    with refused('movie', 'framesPerSecond: got -1', 'it must be positive: give frames a second'):
        app.movie(name, framesPerSecond=-1)
    with refused('movie', 'walls', 'a wall must be an axis and a place'):
        app.movie(name, walls=[0])
    other = Scene()
    other.integrator.addRigidBody([4], 7, (0, 0, 0), [(0, 0, 0)])
    other.context.reinitialize()
    other.context.setPositions(scene.context.getState(getPositions=True).getPositions())
    states = written(tmp_path, 'states')[1]
    with refused('movie', 'context', '3 bodies', '2', 'give the Context of the file'):
        app.movie(states, context=other.context)
    (tmp_path/'text.h5').write_text('no HDF5')
    with refused('text.h5', 'it must be a file of GsdReporter, whose name ends in .gsd',
                 'RigidBodyReporter'):
        app.movie(tmp_path/'text.h5')
    empty = tmp_path/'empty.h5'
    scene.simulation.reporters[:] = [app.H5mdReporter(str(empty), 1000)]
    app.H5mdReporter(str(empty), 1)._start(scene.simulation, scene.integrator)
    with refused('movie', 'empty.h5', 'it has no frames to draw'):
        app.movie(empty)


def test_a_film_needs_ffmpeg_for_mp4(tmp_path, monkeypatch):
    from matplotlib import animation
    monkeypatch.setattr(animation.FFMpegWriter, 'isAvailable', classmethod(lambda cls: False))
    with refused('movie', 'output', 'needs the program ffmpeg', '.gif'):
        app.movie(written(tmp_path, 'h5md')[1], tmp_path/'film.mp4')
