"""Settings of a fluid that a Context does not have or use, and positions that do not fit the fluid,
are named once; pair forces act next to the origin."""
import numpy as np
import openmm
import pytest
from openmm import unit

import openmmrigidhi
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, app

REFERENCE = openmm.Platform.getPlatformByName('Reference')
#: What getEffects() says without warnings.
NONE = 'off: none'
KT = 300*unit.kelvin*unit.MOLAR_GAS_CONSTANT_R/unit.kilojoule_per_mole


class Spheres:
    """Spheres of 1 nm, or bodies of other sites, in a fluid."""
    def __init__(self, positions, boundary='Unbounded', sites=((0, 0, 0),), radius=1.0,
                 temperature=300, scheme='FixmanMidpoint', step=1.0, edge=20.0, change=None):
        self.system, self.fluid = openmm.System(), MobilityForce()
        self.integrator = CustomRigidHIIntegrator(temperature, step)
        self.integrator.setScheme(scheme)
        self.integrator.setRandomNumberSeed(1)
        for _ in positions:
            app.addRigidMultiblob(self.system, self.integrator, self.fluid, sites, radius)
        self.fluid.setBoundary(boundary)
        self.system.setDefaultPeriodicBoxVectors(*edge*np.eye(3))
        if change:
            change(self)
        self.system.addForce(self.fluid)
        self.positions = np.array(positions, float)

    def start(self, platform=REFERENCE, steps=1):
        self.context = openmm.Context(self.system, self.integrator, platform)
        app.placeBodies(self.context, self.positions)
        self.integrator.step(steps)
        return self

    def warnings(self):
        return self.integrator.getEffects()['warnings']


def assertSilent(scene, capfd):
    assert (scene.warnings(), capfd.readouterr().err) == (NONE, '')


def assertNamedOnce(scene, text, capfd):
    for _ in range(2):
        assert text in scene.warnings()
        scene.integrator.step(1)
    assert capfd.readouterr().err.count(text) == 1


# ---- Changes that the Context does not know ------------------------------------------------------

CHANGES = [
    ('setViscosity', (1000,), 'viscosity is 1000 in the MobilityForce, but 535.97'),
    ('setParticleRadius', (1, 2.0), 'radius is 2 in the MobilityForce, but 1 in this'),
    ('setModel', ('StokesianDynamics',), 'model is StokesianDynamics in the MobilityForce, but'),
    ('setBoundary', ('NoSlipWall',), 'boundary is NoSlipWall in the MobilityForce, but'),
    ('setGroups', ([0, 1, 1],), 'Groups: '),
    ('setLubrication', ('On',), 'lubricationSetting is On in the MobilityForce, but'),
    ('setBodyMobility', (0, np.eye(6).tolist()),
     'OwnMobilities: count is 1 in the MobilityForce, but 0'),
    ('setBackgroundFlow', ((0.1, 0, 0), np.zeros((3, 3)).tolist()), 'in the MobilityForce, but'),
    ('setFastSummation', (False,), 'fastSummation is 0 in the MobilityForce, but'),
    ('addBodyForceOnFluid', (0, (0, 0, 2), 0.5, (1, 0, 0)),
     'the MobilityForce has more entries of ForcesOnFluid'),
    ('setSolverTolerance', (1e-3,), 'in the MobilityForce, but')
]


@pytest.mark.parametrize('method, arguments, text', CHANGES, ids=[each[0] for each in CHANGES])
def test_changes_without_an_update_are_named(method, arguments, text, platform, capfd):
    scene = Spheres([(0, 0, 3), (4, 0, 3), (0, 4, 3)]).start(platform)
    before = scene.integrator.getBodyPositions()[0]._value
    assertSilent(scene, capfd)
    getattr(scene.fluid, method)(*arguments)
    scene.integrator.step(1)
    assert text in scene.warnings()
    assertNamedOnce(scene, 'its steps do not know of it; call updateParametersInContext()', capfd)
    scene.context.reinitialize(preserveState=method != 'setGroups')
    if method == 'setGroups':
        app.placeBodies(scene.context, scene.positions)
    scene.integrator.step(1)
    assert 'its steps do not know' not in scene.warnings()
    assert not np.array_equal(before, scene.integrator.getBodyPositions()[0]._value)


def test_updated_and_undone_changes_are_not_named(platform, capfd):
    scene = Spheres([(0, 0, 3), (4, 0, 3)]).start(platform)
    scene.fluid.setViscosity(1000)
    scene.fluid.updateParametersInContext(scene.context)
    scene.integrator.step(1)
    scene.fluid.setViscosity(500)
    scene.fluid.setViscosity(1000)
    scene.integrator.step(1)
    assertSilent(scene, capfd)
    # A second Context of the same System takes what the Force has now.
    scene.fluid.setViscosity(300)
    second = CustomRigidHIIntegrator(300, 1)
    second.setScheme('FixmanMidpoint')
    for _ in scene.positions:
        second.addRigidBody([second.getNumRigidBodies()], 0, (0, 0, 0), [(0, 0, 0)])
    context = openmm.Context(scene.system, second, platform)
    context.setPositions(scene.positions)
    second.step(1)
    assert (second.getEffects()['warnings'], capfd.readouterr().err) == (NONE, '')


def test_a_shear_without_an_update_is_named_and_its_end(platform, capfd):
    scene = Spheres([(0, 0, 3), (4, 0, 3)], 'Periodic').start(platform)
    scene.fluid.setShear(1e-4, 0, 1)
    assert 'the MobilityForce has more entries of Shear than this Context' in scene.warnings()
    scene.fluid.updateParametersInContext(scene.context)
    assertSilent(scene, capfd)
    scene.fluid.setShear(0, 0, 1)
    assert 'the MobilityForce has fewer entries of Shear than this Context' in scene.warnings()


# ---- Settings without effect ---------------------------------------------------------------------

SPHERES, ROD = ((0, 0, 0),), ((0, 0, 0), (1, 0, 0))
IDLE = [('setWallHeight', (1.5,), 'Unbounded', SPHERES, 'setWallHeight(1.5) has no effect with'),
        ('setWallHeight', (1.5,), 'Periodic', SPHERES, 'setWallHeight(1.5) has no effect with'),
        ('setChannelWalls', (0, 9), 'Unbounded', SPHERES, 'setChannelWalls(0, 9) has no effect'),
        ('setChannelCondition', ('ZeroFlux',), 'Periodic', SPHERES, 'ZeroFlux) has no effect'),
        ('setSphereWallMobility', ('BestKnown',), 'NoSlipWall', ROD, 'no body is a single sphere'),
        ('setMinimumGap', (0.1,), 'Periodic', SPHERES, 'no effect without lubrication')]


@pytest.mark.parametrize('method, arguments, boundary, sites, text', IDLE,
                         ids=[f'{each[0]}-{each[2]}' for each in IDLE])
def test_settings_without_effect_are_named(method, arguments, boundary, sites, text, platform,
                                           capfd):
    def change(scene):
        getattr(scene.fluid, method)(*arguments)

    scene = Spheres([(0, 0, 3), (5, 0, 3)], boundary, sites, change=change).start(platform)
    assertNamedOnce(scene, text, capfd)


@pytest.mark.parametrize(
    'boundary',
    ['Unbounded', 'NoSlipWall', 'Periodic', 'SlipChannel', 'PeriodicWall', 'NoSlipChannel', 'Film'])
def test_settings_with_effect_are_not_named(boundary, platform, capfd):
    def change(scene):
        if boundary in ('NoSlipWall', 'PeriodicWall'):
            scene.fluid.setWallHeight(0.5)
        if boundary in ('SlipChannel', 'NoSlipChannel', 'Film'):
            scene.fluid.setChannelWalls(0, 9)
        if boundary == 'NoSlipChannel':
            scene.fluid.setChannelCondition('ZeroFlux')
        if boundary == 'NoSlipWall':
            scene.fluid.setSphereWallMobility('BestKnown')
        if boundary in ('SlipChannel', 'Film'):
            scene.fluid.setModel('ForceCoupling')
        scene.fluid.setSolverTolerance(1e-3)

    positions = [(0, 4, 3), (5, 4, 3)]
    assertSilent(Spheres(positions, boundary, change=change).start(platform), capfd)


def test_free_particles_have_the_best_known_mobility_at_a_wall(platform, capfd):
    scene = Spheres([], 'NoSlipWall')
    scene.fluid.addParticle(1.0)
    scene.system.addParticle(0)
    scene.fluid.setSphereWallMobility('BestKnown')
    scene.context = openmm.Context(scene.system, scene.integrator, platform)
    scene.context.setPositions([(0, 0, 3)])
    scene.integrator.step(1)
    assertSilent(scene, capfd)


# ---- Positions that do not fit -------------------------------------------------------------------


def test_spheres_at_nearly_one_place_are_named(platform, capfd):
    scene = Spheres([(0, 0, 3), (0, 0.019, 3), (6, 0, 3)]).start(platform, steps=0)
    assert 'centres are 0.019 nm apart' in scene.warnings()
    scene.integrator.step(1)
    printed = capfd.readouterr().err
    assert printed.count('body 0 and body 1 have particles of radii 1 and 1 nm whose centres') == 1


def test_overlaps_that_are_meant_are_not_named(platform, capfd):
    # Before positions are known, all are at the origin.
    scene = Spheres([(0, 0, 3), (6, 0, 3)])
    openmm.Context(scene.system, scene.integrator, platform)
    # Beads of a chain without excluded volume, blobs of a body.
    assertSilent(Spheres([(0, 0, 3), (0, 0.1, 3), (6, 0, 3)]).start(platform), capfd)
    blobs = ((0, 0, 0), (0.05, 0, 0))
    assertSilent(Spheres([(0, 0, 3), (6, 0, 3)], sites=blobs).start(platform), capfd)
    # Replicas.
    replicas = Spheres([(0, 0, 3), (0, 0, 3)], change=lambda scene: scene.fluid.setGroups([0, 1]))
    assertSilent(replicas.start(platform), capfd)

    def free(scene):
        scene.fluid.setModel('FreeDraining')

    assertSilent(
        Spheres([(0, 0, 3), (0, 0, 3)], scheme='EulerMaruyama', change=free).start(platform), capfd)

    # Both bodies of a joint have a bead at the joint.
    def join(scene):
        scene.integrator.addBallJoint(0, (1.004, 0, 0), 1, (-1.004, 0, 0))

    rods = ((-1, 0, 0), (0, 0, 0), (1, 0, 0))
    joined = Spheres([(0, 0, 3), (2.008, 0, 3)], sites=rods, radius=0.5, step=0.01, change=join)
    assertSilent(joined.start(platform), capfd)


def test_spheres_larger_than_the_box_are_named(platform, capfd):
    positions = [(0, 0, 0), (0, 0, 1.5)]
    scene = Spheres(positions, 'Periodic', edge=2.0).start(platform)
    assertNamedOnce(scene, 'spheres of the fluid have 1.0472 times the volume of the periodic box',
                    capfd)
    assertSilent(Spheres(positions, 'Periodic', edge=2.2).start(platform), capfd)


GRADIENT = (0, 0, 0.001), (0, 0, 0), (0, 0, 0)


def shearAtWall(scene):
    scene.fluid.setBackgroundFlow((0, 0, 0), GRADIENT)


def movingWall(scene):
    scene.fluid.setChannelWalls(0, 6)
    scene.fluid.setWallVelocity((0.001, 0, 0))
    scene.fluid.setSolverTolerance(1e-3)


@pytest.mark.parametrize('boundary, drive', [('NoSlipWall', shearAtWall),
                                             ('PeriodicWall', shearAtWall),
                                             ('NoSlipChannel', movingWall)])
def test_spheres_in_shear_at_a_wall_are_named(boundary, drive, platform, capfd):
    scene = Spheres([(0, 0, 3), (6, 0, 1.25)], boundary, temperature=0, change=drive)
    assertNamedOnce(
        scene.start(platform), 'body 1 is a single sphere 1.25 radii from a no-slip wall, in a '
        'flow with a gradient; single spheres follow the flow as if the wall were absent, which is '
        '19 % too fast', capfd)


@pytest.mark.parametrize('height, excess', [(1.5, 10), (1.25, 19)])
def test_the_warning_says_how_much_faster_than_a_shell(height, excess):
    def distance(sites, radius):
        scene = Spheres([(0, 0, height)], 'NoSlipWall', sites, radius, 0, 'EulerMaruyama', 0.1,
                        change=shearAtWall).start()
        return scene, scene.integrator.getBodyPositions()[0, 0]._value

    sites, radius = app.multiblobSphere(162, 1.0)
    sphere, ofSphere = distance([(0, 0, 0)], 1.0)
    _, ofShell = distance(sites._value, radius)
    assert f'which is {excess} % too fast' in sphere.warnings()
    assert ofSphere/ofShell - 1 == pytest.approx(0.01*excess, abs=0.02)


def test_other_bodies_in_flows_at_walls_are_not_named(platform, capfd):
    near, far = [(0, 0, 1.25)], [(0, 0, 2.1)]
    for positions, options in ((near, {}), (far, {
            'change': shearAtWall
    }), (near, {
            'change': shearAtWall,
            'sites': ROD
    })):
        scene = Spheres(positions, 'NoSlipWall', temperature=0, **options)
        assertSilent(scene.start(platform), capfd)

    def hold(scene):
        shearAtWall(scene)
        scene.integrator.setBodyHeld(0, True)

    def prescribe(scene):
        shearAtWall(scene)
        motion = openmmrigidhi.CustomBodyMotion('0', '0', '0', '0', '0', '0')
        motion.addBody(0)
        scene.system.addForce(motion)

    assertSilent(
        Spheres(near + [(9, 0, 4)], 'NoSlipWall', temperature=0, change=prescribe).start(platform),
        capfd)

    assertSilent(
        Spheres(near + [(9, 0, 4)], 'NoSlipWall', temperature=0, change=hold).start(platform),
        capfd)


# ---- What is printed -----------------------------------------------------------------------------


def test_effects_say_how_fast_a_sphere_diffuses():
    """Whoever gave a number in a wrong unit sees it there."""
    scene = Spheres([(0, 0, 0)]).start()
    text = scene.integrator.getEffects()['hydrodynamics']
    D = KT/(6*np.pi*536)
    assert 'viscosity 536 dalton/(nm ps) (0.89 mPa s), radius 1 nm: alone, a sphere ' in text
    assert f'{D:.3g} nm^2/ps ({1e6*D:.3g} um^2/s)' in text
    # 1 dalton/(nm ps) in SI.
    eta = 1*unit.dalton/(unit.nanometer*unit.picosecond)
    assert eta/unit.AVOGADRO_CONSTANT_NA/(unit.pascal*unit.second) == pytest.approx(1.66053907e-6)
    cold = Spheres([(0, 0, 0)], temperature=0).start()
    assert 'diffuses' not in cold.integrator.getEffects()['hydrodynamics']


# ---- Forces next to the origin -------------------------------------------------------------------

#: Edges of boxes, and coordinates that OpenMM's Reference platform rounds into no cell.
LOST = [(10.0, -5e-324), (10.0, -7.3e-16), (13.2, -1.8e-15), (13.2, np.nextafter(13.2, 0)),
        (8.0, np.nextafter(8.0, 0)), (7.9, -5e-16), (8.4, np.nextafter(25.2, 0))]


@pytest.mark.parametrize('axis', range(3))
@pytest.mark.parametrize('edge, coordinate', LOST)
def test_pair_forces_act_on_particles_next_to_a_face(axis, edge, coordinate, platform):
    """OpenMM's Reference platform loses the neighbours of some of these particles."""
    def moved(first, second):
        def push(scene):
            pairs = openmm.CustomNonbondedForce('50*exp(-(r - 2)/0.1)')
            pairs.setNonbondedMethod(pairs.CutoffPeriodic)
            pairs.setCutoffDistance(2.6)
            for _ in range(2):
                pairs.addParticle([])
            scene.system.addForce(pairs)

        positions = np.full((2, 3), 0.2)
        positions[0, axis], positions[1, axis] = first, second
        scene = Spheres(positions, 'Periodic', temperature=0, scheme='EulerMaruyama', step=0.1,
                        edge=edge, change=push)
        app.bindBodies(scene.system, scene.integrator)
        stress = scene.start(platform, 0).fluid.getStressInContext(scene.context).interparticle
        scene.integrator.step(1)
        return scene.integrator.getBodyPositions()._value - scene.positions, stress._value

    (there, stress), (inside, wanted) = moved(coordinate, coordinate + 2.1), moved(3.0, 5.1)
    assert inside[1, axis] > 1e-4
    assert np.allclose(there, inside, atol=1e-6)
    assert np.allclose(stress, wanted, atol=1e-3*np.abs(wanted).max())
