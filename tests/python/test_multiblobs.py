"""Shapes made of blobs, bodies made of them, and their files."""
import inspect
import re

import numpy as np
import openmm
import pytest
import scipy.sparse.linalg
import scipy.spatial
from openmm import unit

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, app


def refused(*pieces, error=ValueError):
    return pytest.raises(error, match='.*'.join(re.escape(piece) for piece in pieces))


def distances(points):
    return scipy.spatial.distance.pdist(points._value)


# ---- Shapes --------------------------------------------------------------------------------------


def test_a_rod():
    points = app.rod(4, 0.2*unit.nanometer)
    assert points.unit == unit.nanometer
    assert np.allclose(points._value, [(-0.3, 0, 0), (-0.1, 0, 0), (0.1, 0, 0), (0.3, 0, 0)],
                       rtol=0, atol=1e-15)
    with refused('rod: n: got 1 blobs; a shape of this kind needs at least 2'):
        app.rod(1, 0.2)
    with refused('rod: spacing: got the length 0.0 nm; a shape needs a finite length above 0'):
        app.rod(2, 0)


def test_the_boomerang_of_delong():
    points = app.boomerang(0.3*unit.micrometer)._value
    assert points.shape == (15, 3)
    assert np.allclose(points[7], 0) and np.allclose(points[0], (2100, 0, 0)) and np.allclose(
        points[14], (0, 2100, 0))
    assert np.allclose(np.linalg.norm(np.diff(points, axis=0), axis=1), 300)
    assert app.boomerang(1, blobsPerArm=3)._value.shape == (7, 3)
    with refused('boomerang: blobsPerArm: got 0 blobs'):
        app.boomerang(1, 0)


def test_a_tetramer():
    points = app.tetramer(2.0)
    assert np.allclose(distances(points), 2.0, rtol=1e-14)
    assert np.allclose(points._value.mean(axis=0), 0, atol=1e-15)
    assert np.allclose(points._value[3],
                       (0, 0, 2*np.sqrt(3/8))) and np.allclose(points._value[0, :2],
                                                               (2/np.sqrt(3), 0))


def test_an_icosahedron():
    points = app.icosahedron(2.5)
    assert np.allclose(np.linalg.norm(points._value, axis=1), 2.5)
    assert np.allclose(points._value[[0, 11]], [(0, 0, 2.5), (0, 0, -2.5)])
    # Each vertex has five neighbours at the edge's length, 1.0515 radii.
    assert np.allclose(np.sort(distances(points)), np.sort(distances(app.sphereShell(12, 2.5))),
                       rtol=1e-13)
    assert np.allclose(np.sort(distances(points))[:30], 2.5*1/np.sin(0.4*np.pi))


def test_a_cylinder():
    points = app.cylinder(1, 6, 0.5)._value
    assert np.allclose(points.mean(axis=0), 0, atol=1e-14)
    radial = np.hypot(points[:, 1], points[:, 2])
    side = points[np.isclose(radial, 1)]
    assert len(side) == 13*13 and radial.max() < 1 + 1e-12 and np.abs(points[:, 0]).max() == 3
    assert np.allclose(np.unique(np.round(side[:, 0], 12)), np.linspace(-3, 3, 13))
    nearest = scipy.spatial.cKDTree(points).query(points, 2)[0][:, 1]
    assert 0.45 < nearest.min() and nearest.max() < 0.6
    # Both ends are equal and closed by blobs.
    ends = [np.sort(radial[np.isclose(points[:, 0], x)]) for x in (-3, 3)]
    assert np.allclose(*ends) and ends[0][0] == 0
    assert len(app.cylinder(1, 6, 0.5, closed=False)._value) == 13*13
    with refused('cylinder: length: got the length inf nm'):
        app.cylinder(1, np.inf, 0.5)


# ---- Bodies --------------------------------------------------------------------------------------


def empty():
    return openmm.System(), CustomRigidHIIntegrator(300, 0.001), MobilityForce()


def test_system_integrator_and_fluid_are_kept_in_step(platform):
    system, integrator, fluid = empty()
    shell, radius = app.multiblobSphere(12, 0.5)
    assert app.addRigidMultiblob(system, integrator, fluid, shell, radius, 120*unit.dalton,
                                 (9, 9, 9)) == 0
    assert app.addRigidMultiblob(system, integrator, fluid, [(0, 0, 0), (0.1, 0, 0)], [0.5, 0], 100,
                                 (1, 2, 2), particleMasses=[70, 30]) == 1
    assert system.getNumParticles() == fluid.getNumParticles() == 14
    assert integrator.getRigidBodyParticles(1) == [12, 13]
    assert [system.getParticleMass(i)._value for i in (0, 11, 12, 13)] == [10, 10, 70, 30]
    assert fluid.getParticleRadius(3) == radius and fluid.getParticleRadius(13)._value == 0
    _, mass, moments, sites = integrator.getRigidBodyParameters(0)
    assert mass._value == 120 and np.array_equal(sites._value, shell._value) and np.array_equal(
        moments._value, (9, 9, 9))

    integrator.setScheme(integrator.LangevinHI)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, platform)
    context.setPositions(np.concatenate([shell._value, [(3, 0, 0), (3.1, 0, 0)]]))
    context.setVelocitiesToTemperature(300, 1)
    integrator.step(3)
    N = fluid.getMobilityInContext(context)
    # Two spheres of 0.5 nm are far apart. The radius for translation is the one that defines the
    # multiblob.
    assert N[0, 0] == pytest.approx(N[6, 6], rel=3e-3)


@pytest.mark.parametrize('n, rotation', [(12, 0.02464), (42, 0.01793), (162, 0.00548),
                                         (642, 0.00125), (2562, 0.00017)])
def test_radii_of_shells(n, rotation):
    """By conjugate gradients with products of blobs, a shell of hydrodynamic radius 0.7 nm has the
    Stokes drag of a sphere."""
    R, eta = 0.7, 2.0
    centres, blob = (x._value for x in app.multiblobSphere(n, R))
    system, integrator, fluid = empty()
    for _ in range(n):
        system.addParticle(1)
        fluid.addParticle(blob)
    fluid.setViscosity(eta)
    system.addForce(fluid)
    integrator.setScheme(integrator.LangevinHI)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'))
    context.setPositions(centres)

    def product(forces):
        return fluid.applyBlobMobilityInContext(context, forces.reshape(n, 3))._value.ravel()

    def drag(velocities):
        """The product velocities . forces. Its error is the square of the residual's error, times a
        condition number of thousands."""
        hasRtol = 'rtol' in inspect.signature(scipy.sparse.linalg.cg).parameters
        relative = {'rtol' if hasRtol else 'tol': 1e-7}  # SciPy 1.12 renamed it
        forces, status = scipy.sparse.linalg.cg(
            scipy.sparse.linalg.LinearOperator((3*n, 3*n), product), velocities.ravel(), atol=0,
            **relative)
        assert status == 0
        return forces @ velocities.ravel()

    assert drag(np.tile((1.0, 0, 0), (n, 1)))/(6*np.pi*eta) == pytest.approx(R, rel=1e-6)
    turning = (drag(np.cross((0, 0, 1.0), centres))/(8*np.pi*eta))**(1/3)
    assert 1 - turning/R == pytest.approx(rotation, abs=1e-5)


def test_massless_bodies():
    system, integrator, fluid = empty()
    assert app.addRigidMultiblob(system, integrator, fluid, app.tetramer(1), 0.5) == 0
    assert [system.getParticleMass(i)._value for i in range(4)] == 4*[0]
    assert integrator.getRigidBodyParameters(0)[1]._value == 0


@pytest.mark.parametrize(
    'change, pieces, error',
    [({
        'radii': [0.1, 0.2]
    }, ('radii: got 2 for 4 sites; give one for all',), ValueError),
     ({
         'radii': -0.1
     }, ('radii: got [-0.1,', 'each must be finite and not negative'), ValueError),
     ({
         'radii': 1*unit.kelvin
     }, ('addRigidMultiblob: radii: got a quantity in kelvin',), TypeError),
     ({
         'radii': [[0.1]]
     }, ('addRigidMultiblob: radii: got an array of shape (1, 1); it must be a plain sequence',),
      ValueError),
     ({
         'particleMasses': [1, 2, 3, np.nan]
     }, ('particleMasses: got [1.0,',), ValueError),
     ({
         'mass': -1
     }, ('mass',), openmm.OpenMMException),
     ({
         'principalMoments': (1, 1, 5)
     }, ('triangle inequality',), openmm.OpenMMException),
     ({
         'sitePositions': np.empty((0, 3))
     }, ('at least one',), openmm.OpenMMException),
     ({
         'mobilityForce': openmm.NonbondedForce()
     }, ('cast',), TypeError),])
def test_a_refused_body_leaves_nothing_behind(change, pieces, error):
    system, integrator, fluid = empty()
    arguments = dict(system=system, integrator=integrator, mobilityForce=fluid,
                     sitePositions=app.tetramer(1), radii=0.5, mass=4)
    with refused(*pieces, error=error):
        app.addRigidMultiblob(**{**arguments, **change})
    assert system.getNumParticles() == fluid.getNumParticles() == integrator.getNumRigidBodies(
    ) == 0


def test_a_fluid_that_is_out_of_step():
    system, integrator, fluid = empty()
    system.addParticle(1)
    with refused(
            'mobilityForce: it has 0 particles and the System 1; the numbers must agree before a '
            'body is added'):
        app.addRigidMultiblob(system, integrator, fluid, app.tetramer(1), 0.5)


# ---- Files ---------------------------------------------------------------------------------------

VERTICES = """# The format is:
# number of blobs
# vector_location_blob_0

3  0.3  # spacing, not read
2.1  0.  0.
  0  0.3e0 -1   # a comment
-1 -2 -3"""


def write(path, text):
    path.write_text(text)
    return path


def test_a_vertex_file(tmp_path):
    file = write(tmp_path/'body.vertex', VERTICES)
    expected = [(2.1, 0, 0), (0, 0.3, -1), (-1, -2, -3)]
    for name in (file, str(file)):
        assert np.array_equal(app.readVertexFile(name), expected)
    withRadii = write(tmp_path/'radii.vertex', '2\n0 0 0 0.5\n1 0 0 0.25\n')
    assert np.array_equal(app.readVertexFile(withRadii), [(0, 0, 0), (1, 0, 0)])
    positions, radii = app.readVertexFile(withRadii, radii=True)
    assert positions.shape == (2, 3) and np.array_equal(radii, [0.5, 0.25])


@pytest.mark.parametrize(
    'text, line, pieces',
    [('', 0, ('found the end of the file; expected the number of blobs',)),
     ('# nothing\n\n', 2, ('found the end of the file; expected the number of blobs',)),
     ('three\n0 0 0\n', 1,
      ("found 'three' where the number of blobs should be; expected a positive integer",)),
     ('0.5 0 0\n', 1, ("found '0.5' where the number",)),
     ('0\n', 1, ("found '0' where the number",)), ('-2\n', 1, ("found '-2' where the number",)),
     ('2\n0 0 0\n', 2,
      ('found the end of the file after 1 rows; expected 2 blobs: check the count',)),
     ('1\n0 0 0\n# more\n1 0 0\n', 4,
      ("found '1 0 0' after the last of 1 blobs; expected the end of the file",)),
     ('1\n0 0\n', 2, ("found the row '0 0'; expected 3 or 4 finite numbers, x y z",)),
     ('1\n0 0 0 0 0\n', 2, ("found the row '0 0 0 0 0'",)),
     ('2\n0 0 0\n1 0 0 0.5\n', 3, ("found the row '1 0 0 0.5'; expected 3 finite numbers",)),
     ('1\n0 0 zero\n', 2, ("found the row '0 0 zero'",)),
     ('1\n0,0,0\n', 2, ("found the row '0,0,0'",)),
     ('1\n0 0 nan\n', 2, ("found the row '0 0 nan'",)), ('1\n0 \xff 0\n', 2, ('found the row',)),])
def test_vertex_files_that_do_not_parse(text, line, pieces, tmp_path):
    file = tmp_path/'bad.vertex'
    file.write_bytes(text.encode('latin-1'))
    with refused(f'bad.vertex, line {line}: ', *pieces):
        app.readVertexFile(file)


def test_files_that_are_not_there(tmp_path):
    for read in (app.readVertexFile, app.readClones):
        with pytest.raises(FileNotFoundError):
            read(tmp_path/'missing')
    with refused('line 2', 'x y z radius'):
        app.readVertexFile(write(tmp_path/'no.vertex', '1\n0 0 0\n'), radii=True)
    with refused("negative.vertex, line 3: found the radius -0.5; a blob's radius is 0 or more"):
        app.readVertexFile(write(tmp_path/'negative.vertex', '2\n0 0 0 0\n1 0 0 -0.5\n'),
                           radii=True)
    with refused('radii: got 1; it must be True or False', error=TypeError):
        app.readVertexFile(tmp_path/'no.vertex', radii=1)


def test_clones_round_trip_bit_for_bit(tmp_path):
    random = np.random.default_rng(1)
    positions = random.normal(size=(20, 3))*10.0**random.integers(-9, 9, size=(20, 1))
    orientations = random.normal(size=(20, 4))
    orientations /= np.linalg.norm(orientations, axis=1)[:, None]
    file = tmp_path/'bodies.clones'
    app.writeClones(file, positions*unit.nanometer, orientations)
    for found, expected in zip(app.readClones(file), (positions, orientations)):
        assert np.array_equal(found, expected)
    app.writeClones(str(file), positions[:1]*unit.micrometer, orientations[:1])
    assert np.allclose(app.readClones(str(file))[0], 1000*positions[:1], rtol=1e-15)
    app.writeClones(file, 3000*positions[:1], orientations[:1], unit=unit.micrometer)
    assert np.allclose(app.readClones(file)[0], 3*positions[:1], rtol=1e-15)
    assert np.allclose(
        app.readClones(file, unit=unit.micrometer)[0], 3000*positions[:1], rtol=1e-15)
    with refused('writeClones: unit: got a quantity in picosecond', error=TypeError):
        app.writeClones(file, positions[:1], orientations[:1], unit=unit.picosecond)


def test_clones_of_few_digits_are_normalised(tmp_path):
    file = write(tmp_path/'few.clones', '# comment\n2\n0 0 0 1 0 0 0\n1 1 0 0.70711 0.70711 0 0\n')
    positions, orientations = app.readClones(file)
    assert np.array_equal(positions, [(0, 0, 0), (1, 1, 0)])
    assert np.allclose(orientations, [(1, 0, 0, 0), (np.sqrt(0.5), np.sqrt(0.5), 0, 0)], rtol=1e-15)


@pytest.mark.parametrize(
    'text, line, pieces',
    [('1\n0 0 0 1 0 0\n', 2, ('expected 7 finite numbers, x y z q0 q1 q2 q3',)),
     ('1\n\n0 0 0 1 1 0 0\n', 3, ('found a quaternion of length 1.41421; it must be 1',)),
     ('2\n0 0 0 1 0 0 0\n', 2, ('expected 2 bodies',)),])
def test_clones_files_that_do_not_parse(text, line, pieces, tmp_path):
    with refused(f'bad.clones, line {line}: ', *pieces):
        app.readClones(write(tmp_path/'bad.clones', text))


def test_files_in_other_units(tmp_path):
    vertices = write(tmp_path/'x.vertex', '2\n0 0 0 0.5\n1 0 0 0.25\n')
    clones = write(tmp_path/'x.clones', '1\n1 2 3 0 1 0 0\n')
    for length, scale in ((unit.micrometer, 1000), (0.5*unit.micrometer, 500), (3, 3),
                          (unit.angstrom, 0.1), (None, 1)):
        assert np.allclose(app.readVertexFile(vertices, unit=length), [(0, 0, 0), (scale, 0, 0)])
        positions, radii = app.readVertexFile(vertices, radii=True, unit=length)
        assert np.allclose(positions, [(0, 0, 0), (scale, 0, 0)])
        assert np.allclose(radii, [0.5*scale, 0.25*scale])
        positions, orientations = app.readClones(clones, length)
        assert np.allclose(positions, np.array([(1, 2, 3)])*scale)
        assert orientations.tolist() == [[0, 1, 0, 0]]
    for read, name in ((app.readVertexFile, vertices), (app.readClones, clones)):
        with refused(f'{read.__name__}: unit: got a quantity in picosecond; it must be nm',
                     error=TypeError):
            read(name, unit=unit.picosecond)
        with refused(f"{read.__name__}: unit: got 'um'", error=TypeError):
            read(name, unit='um')
        for length in (0, -1, np.nan, np.inf):
            with refused(f'{read.__name__}: unit: got {float(length)} nm; a unit of length must be '
                         'positive and finite'):
                read(name, unit=length)


def body(radii, positions):
    """A multiblob, as a user makes it."""
    system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(0, 1)
    app.addRigidMultiblob(system, integrator, fluid, positions, radii)


SHELL, RADIUS = (each._value for each in app.multiblobSphere(42, 500))


@pytest.mark.parametrize('scale', [1e-9, 1e-6, 1e-3, 1e3, 1e6])
@pytest.mark.parametrize('positions, radii', [(SHELL, RADIUS), (app.rod(10, 2.0)._value, 1.0),
                                              ([(0, 0, 0), (1.5, 0, 0)], [1.0, 0.5])],
                         ids=['shell', 'rod', 'pair'])
def test_lengths_in_two_units_are_noticed(tmp_path, scale, positions, radii):
    pattern = 'positions and radii seem to be in different units of length; give both in nm'
    with pytest.warns(UserWarning, match='addRigidMultiblob: blob .*' + pattern):
        body(radii, np.asarray(positions)*scale)
    rows = np.column_stack([np.asarray(positions)*scale, np.broadcast_to(radii, len(positions))])
    file = write(
        tmp_path/'x.vertex',
        f'{len(rows)}\n' + '\n'.join(' '.join(repr(float(x)) for x in row) for row in rows))
    with pytest.warns(UserWarning, match='readVertexFile: .*x.vertex: blob .*' + pattern):
        app.readVertexFile(file, radii=True)
    app.readVertexFile(file)


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('positions, radii', [(SHELL, RADIUS), (SHELL, RADIUS/5), (SHELL, RADIUS*5),
                                              (app.rod(10, 0.1)._value, 1.0), ([(0, 0, 0)], 1.0),
                                              ([(0, 0, 0), (0, 0, 0)], [1.0, 2.0]),
                                              ([(0, 0, 0), (600, 0, 0)], 1.0),
                                              ([(0, 0, 0), (1e-3, 0, 0), (2, 0, 0)], 1.0),
                                              ([(0, 0, 0), (1e-6, 0, 0)], [1.0, 0])], ids=range(9))
def test_lengths_in_one_unit_need_no_word(positions, radii):
    body(radii, positions)


def test_clones_that_cannot_be_written(tmp_path):
    file = tmp_path/'new.clones'
    with refused(
            'writeClones: orientations: got an array of shape (1, 4); the shape must be (2, 4)'):
        app.writeClones(file, np.zeros((2, 3)), [(1, 0, 0, 0)])
    with refused('writeClones: body 0: got', 'a written pose must be finite'):
        app.writeClones(file, [(0, 0, np.nan)], [(1, 0, 0, 0)])
    with refused(
            'orientations: the quaternion of body 1 has length 2; it must be 1: normalise before '
            'writing'):
        app.writeClones(file, np.zeros((2, 3)), [(1, 0, 0, 0), (2, 0, 0, 0)])
    with refused('got no bodies to write'):
        app.writeClones(file, np.empty((0, 3)), np.empty((0, 4)))
    assert not file.exists()
