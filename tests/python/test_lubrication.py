"""Lubrication on top of models that have none: setLubrication() with RotnePragerYamakawa and
ForceCoupling.

Numerical results of the parts are tested in tests/unit/TestLubrication.cpp, the drift of schemes in
tests/unit/TestOverdampedSchemes.cpp.
"""
import copy
import json
import pathlib
import re
import sys
import warnings

import numpy as np
import openmm
import pytest
from scipy import linalg

from openmmrigidhi import CustomBodyMotion, CustomRigidHIIntegrator, MobilityForce, app


def refused(*pieces, error=openmm.OpenMMException):
    """Expect an error whose message has all the pieces, in this order."""
    return pytest.raises(error, match='.*'.join(re.escape(piece) for piece in pieces))


SCENES = json.loads(
    (pathlib.Path(__file__).parents[1]/'data'/'sheared'/'wall_three_spheres.json').read_text())


def scene(positions, radii, boundary='Unbounded', model='RotnePragerYamakawa', lubrication=True,
          reach=None, solver='Auto', tolerance=1e-6, scheme='TractionEulerMaruyama', box=None,
          temperature=0, platform='Reference', step=0.01, mass=0, sites=((0, 0, 0),), context=True,
          free=0, **more):
    """Spheres, the last `free` of which are in no body; viscosity 1: (fluid, integrator, Context or
    System).
    """
    system, fluid = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(temperature, step)
    integrator.setScheme(scheme)
    integrator.setRandomNumberSeed(5)
    if box is not None:
        system.setDefaultPeriodicBoxVectors(*np.diag(np.broadcast_to(box, 3).astype(float)))
    fluid.setViscosity(1)
    fluid.setModel(model)
    fluid.setBoundary(boundary)
    fluid.setLubrication(lubrication)
    if reach is not None:
        fluid.setLubricationReach(*reach)
    fluid.setSolver(solver)
    fluid.setSolverTolerance(tolerance)
    for name, value in more.items():
        owner = fluid if hasattr(fluid, name) else integrator
        getattr(owner, name)(*(value if isinstance(value, tuple) else (value,)))
    placed = []
    for i, (position, radius) in enumerate(zip(positions, radii)):
        members = []
        isFree = i >= len(radii) - free
        for site in sites if i == 0 else ((0, 0, 0),):
            members.append(system.addParticle(0))
            fluid.addParticle(radius)
            placed.append(np.add(position, site))
        if not isFree:
            integrator.addRigidBody(members, mass, (mass,)*3, sites if i == 0 else [(0, 0, 0)])
    system.addForce(fluid)
    if box is not None:
        app.bindBodies(system, integrator)
    if not context:
        return fluid, integrator, system
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platform))
    context.setPositions(placed)
    return fluid, integrator, context


@pytest.mark.parametrize('solver', ['Dense', 'MatrixFree'])
@pytest.mark.parametrize('values', SCENES, ids=lambda values: values['name'])
@pytest.mark.parametrize('platform', ['Reference', 'CPU'])
def test_three_spheres_above_a_wall(values, solver, platform):
    """The prototype's values. Its pair at a gap of 0.0032 is right to 2e-6 (solveTwoSpheres())."""
    error = 1e-11 if values['name'] == 'near' else 3e-6
    fluid, _, context = scene(values['positions'], values['radii'], 'NoSlipWall', reach=(100, 101),
                              solver=solver, tolerance=1e-9, platform=platform)
    fluid.setWallHeight(values['wallHeight'])
    wrench, twist = np.array(values['wrench']), np.array(values['twist'])
    found = fluid.applyMobilityInContext(context, wrench)
    np.testing.assert_allclose(found, twist, rtol=0, atol=5e-7*np.abs(twist).max())
    N = fluid.getMobilityInContext(context)
    np.testing.assert_allclose(np.diag(N), np.ravel(values['mobilityDiagonal']), rtol=error)
    R, numbers = fluid.getFrictionInContext(context), np.ravel(values['frictionTimesWrenchNumbers'])
    np.testing.assert_allclose(R @ wrench.ravel(), numbers, rtol=0,
                               atol=error*np.abs(numbers).max())
    fluid.setLubrication(False)
    fluid.updateParametersInContext(context)
    without = np.array(values['twistRPY'])
    found = fluid.applyMobilityInContext(context, wrench)
    np.testing.assert_allclose(found, without, atol=1e-12*np.abs(without).max())


@pytest.mark.parametrize('fraction, K, KR', [(0.064, 2.77814, 1.06838), (0.216, 6.29927, 1.34581),
                                             (0.45, 10.0339, 2.67820)])
def test_simple_cubic_arrays(fraction, K, KR):
    edge = (4*np.pi/3/fraction)**(1/3)
    fluid, _, context = scene([(0.1, 0.2, 0.3)], [1], 'Periodic', box=edge)
    N = fluid.getMobilityInContext(context)
    assert 1/(6*np.pi*N[0, 0]) == pytest.approx(K, rel=2e-5)
    assert 1/(8*np.pi*N[3, 3]) == pytest.approx(KR, rel=2e-5)
    fluid.setLubricationReach(8, 10)
    fluid.updateParametersInContext(context)
    assert 1/(6*np.pi*fluid.getMobilityInContext(context)[0, 0]) > 1.002*K


def test_two_spheres_are_those_of_stokesian_dynamics():
    positions, radii = [(0, 0, 0), (0.9, 0.5, -0.3)], [0.6, 0.45]
    matrices = []
    for model in ('RotnePragerYamakawa', 'StokesianDynamics'):
        fluid, _, context = scene(positions, radii, model=model,
                                  reach=(50, 60) if model == 'RotnePragerYamakawa' else None)
        matrices.append(fluid.getMobilityInContext(context))
    np.testing.assert_allclose(matrices[0], matrices[1], atol=1e-9*matrices[1].max())


@pytest.mark.parametrize('boundary, model', [('PeriodicWall', 'RotnePragerYamakawa'),
                                             ('NoSlipChannel', 'RotnePragerYamakawa'),
                                             ('Periodic', 'ForceCoupling'),
                                             ('PeriodicWall', 'ForceCoupling'),
                                             ('NoSlipChannel', 'ForceCoupling'),
                                             ('Film', 'ForceCoupling'),
                                             ('SlipChannel', 'ForceCoupling'),
                                             ('Periodic', 'RotnePragerYamakawa')])
def test_products_are_those_of_matrices(boundary, model):
    """On a grid, which has errors of its own, in every boundary."""
    positions = [(0, 0, 1.1), (2.1, 0.3, 1.2), (0.6, 2.1, 1.6), (3.9, 4, 3.1)]
    if boundary == 'SlipChannel':  # across y
        positions = [(x, z, y) for x, y, z in positions]
    radii = [1, 1, 1, 1]
    answers = []
    for solver in ('Dense', 'MatrixFree'):
        fluid, integrator, context = scene(positions, radii, boundary, model, solver=solver,
                                           box=(6.5, 6.2, 7), tolerance=1e-6,
                                           setChannelWalls=(0.0, 4.3))
        answers.append(
            np.array(fluid.applyMobilityInContext(context,
                                                  np.sin(1 + np.arange(24)).reshape(4, 6))))
        text = integrator.getEffects()['hydrodynamics']
        assert 'lubrication' in text
    np.testing.assert_allclose(answers[1], answers[0], atol=1e-5*np.abs(answers[0]).max())
    if boundary in ('PeriodicWall', 'NoSlipChannel') and model == 'RotnePragerYamakawa':
        # A wide box has no images that matter: the wall's blocks are those of one sphere.
        single = {}
        for where, edge in (('NoSlipWall', 7), (boundary, 60)):
            fluid, _, context = scene([(1, 1, 1.02)], [1], where, box=(edge, edge, 70),
                                      solver='Dense', setChannelWalls=(0.0, 60.0))
            single[where] = fluid.getMobilityInContext(context)
        np.testing.assert_allclose(single[boundary][2, 2], single['NoSlipWall'][2, 2], rtol=1e-3)


#: A multiblob, spheres near each other and near walls, and a free particle.
MIXED = dict(
    positions=[(4.6, 4.4, 2.2), (0, 0, 1.02), (2.03, 0.3, 1.05), (0.6, 2.05, 1.6),
               (3.9, 1.4, 2.8)], radii=[0.5, 1, 1, 1, 0.4],
    sites=((0, 0, 0), (0.9, 0.1, 0), (0, 0.9, 0.2), (-0.5, -0.6, 0.4)), free=1)


def mixed(boundary='NoSlipWall', model='RotnePragerYamakawa', **more):
    settings = dict(MIXED, boundary=boundary, model=model, box=(7.2, 7.5, 7),
                    setChannelWalls=(0.0, 4.3))
    settings.update(more)
    if boundary == 'SlipChannel':  # across y
        settings['positions'] = [(x, z, y) for x, y, z in settings['positions']]
        settings['sites'] = [(x, z, y) for x, y, z in settings['sites']]
    return scene(**settings)


@pytest.mark.parametrize('boundary, model', [('Unbounded', 'RotnePragerYamakawa'),
                                             ('NoSlipWall', 'RotnePragerYamakawa'),
                                             ('Periodic', 'RotnePragerYamakawa'),
                                             ('PeriodicWall', 'RotnePragerYamakawa'),
                                             ('NoSlipChannel', 'RotnePragerYamakawa'),
                                             ('Periodic', 'ForceCoupling'),
                                             ('PeriodicWall', 'ForceCoupling'),
                                             ('NoSlipChannel', 'ForceCoupling'),
                                             ('Film', 'ForceCoupling'),
                                             ('SlipChannel', 'ForceCoupling')])
def test_products_beside_multiblobs_are_those_of_matrices(boundary, model):
    """In every boundary, on a grid where there is one."""
    answers = []
    for solver in ('Dense', 'MatrixFree'):
        fluid, integrator, context = mixed(boundary, model, solver=solver, tolerance=1e-6)
        wrenches = np.sin(1 + np.arange(24)).reshape(4, 6)
        answers.append(np.array(fluid.applyMobilityInContext(context, wrenches)))
        assert 'lubrication of 3 spheres' in integrator.getEffects()['hydrodynamics']
    np.testing.assert_allclose(answers[1], answers[0], atol=1e-5*np.abs(answers[0]).max())


@pytest.mark.parametrize(
    'scheme',
    ['TractionEulerMaruyama', 'TrapezoidalSlip', 'FixmanMidpoint', 'RandomFiniteDifference'])
@pytest.mark.parametrize('platform', ['Reference', 'CPU'])
def test_steps_beside_multiblobs_go_on_with_the_same_bits(scheme, platform):
    """After a checkpoint, and with any number of threads."""
    ends = []
    for threads in ('1', '3') if platform == 'CPU' else ('',):
        _, integrator, system = mixed(scheme=scheme, solver='MatrixFree', tolerance=1e-3,
                                      temperature=300, step=1e-3, context=False)
        owner = openmm.Platform.getPlatformByName(platform)
        properties = {'Threads': threads} if threads else {}
        context = openmm.Context(system, integrator, owner, properties)
        sites = [np.add(MIXED['positions'][0], site) for site in MIXED['sites']]
        context.setPositions(sites + MIXED['positions'][1:])
        integrator.step(3)
        assert integrator.getNumRejectedSteps() < 3
        saved = context.createCheckpoint()
        for _ in range(2):
            integrator.step(3)
            state = context.getState(getPositions=True)
            ends.append(state.getPositions(asNumpy=True)._value)
            context.loadCheckpoint(saved)
        assert integrator.getEffects()['hydrodynamics'].count('matrix-free')
    for end in ends:
        assert np.isfinite(end).all()
        np.testing.assert_array_equal(end, ends[0])


@pytest.mark.parametrize('solver', ['Dense', 'MatrixFree'])
@pytest.mark.parametrize('platform', ['Reference', 'CPU'])
def test_a_gaussian_at_a_wall_is_a_rigid_sphere(solver, platform):
    """Images along the wall change the friction of the sphere by less than 1e-3 of that of the gap.
    """
    fluid, _, context = scene([(1, 1, 1.01)], [1], 'NoSlipWall')
    exact = fluid.getMobilityInContext(context)
    fluid, _, context = scene([(1, 1, 1.01)], [1], 'PeriodicWall', 'ForceCoupling', box=24,
                              solver=solver, tolerance=1e-4, platform=platform)
    found = fluid.applyMobilityInContext(context, [[0, 0, 1, 0, 0, 0]])[0]
    assert found[2] == pytest.approx(exact[2, 2], rel=1e-3)
    assert np.abs(np.delete(found, 2)).max() < 1e-6
    found = fluid.applyMobilityInContext(context, [[1, 0, 0, 0, 0, 0]])[0]
    np.testing.assert_allclose(found, exact[:, 0], atol=0.01*exact[0, 0])


#: Gaps between two spheres and to the wall, in radii -> largest relative error of the friction in
#: percent, without and with lubrication: the table of docs/models/ForceCoupling.md.
PAIRS_AT_A_WALL = {
    (1, 1): (7.9, 1.5),
    (1, 0.2): (47.3, 1.9),
    (0.2, 1): (43.8, 3.8),
    (0.2, 0.2): (49.0, 8.6),
    (0.1, 0.1): (68.6, 9.3)
}


@pytest.mark.parametrize('gap, wall', [(1, 0.2),
                                       (0.2, 0.2), *(pytest.param(*gaps, marks=pytest.mark.full)
                                                     for gaps in ((1, 1), (0.2, 1), (0.1, 0.1)))])
def test_pairs_of_gaussians_at_a_wall(gap, wall):
    """Against a collocation of both surfaces, in a box of 40 radii."""
    folder = pathlib.Path(__file__).parents[2]/'validation'/'sheared'
    sys.path.insert(0, str(folder))
    try:
        from collocation import frictionOfPair
    finally:
        sys.path.remove(str(folder))
    exact = 6*np.pi*frictionOfPair(2 + gap, 1 + wall, 700 if wall < 0.15 else 250)
    errors = []
    for lubrication in ('Off', 'On'):
        fluid, _, context = scene([(0, 0, 1 + wall), (2 + gap, 0, 1 + wall)], [1, 1],
                                  'PeriodicWall', 'ForceCoupling', lubrication, box=40,
                                  solver='Dense', tolerance=1e-4, platform='CPU')
        found = fluid.getFrictionInContext(context)
        values = linalg.eigh(found - exact, (exact + exact.T)/2, eigvals_only=True)
        errors.append(100*np.abs(values).max())
    print(errors)
    assert errors == pytest.approx(PAIRS_AT_A_WALL[gap, wall], abs=0.5)


@pytest.mark.parametrize('solver', ['Dense', 'MatrixFree'])
def test_spheres_between_slip_walls_are_those_with_images(solver):
    """As in a periodic box of twice the width, where images have mirrored forces."""
    gaps = [(0, 1.03, 0), (2.1, 1.2, 0.3), (0.5, 3.4, 0.2)]
    wrenches = np.sin(1 + np.arange(18)).reshape(3, 6)
    fluid, integrator, context = scene(gaps, [1, 1, 0.6], 'SlipChannel', 'ForceCoupling',
                                       box=(7, 9, 8), solver=solver, tolerance=1e-8,
                                       setChannelWalls=(0.0, 4.05))
    assert 'mirror images in the slip walls' in integrator.getEffects()['hydrodynamics']
    found = fluid.applyMobilityInContext(context, wrenches)
    images = [(x, -y, z) for x, y, z in gaps]
    mirror = np.array([1, -1, 1, -1, 1, -1])
    fluid, _, context = scene(gaps + images, [1, 1, 0.6]*2, 'Periodic', 'ForceCoupling',
                              box=(7, 8.1, 8), solver='Dense', tolerance=1e-8)
    expected = fluid.applyMobilityInContext(context, np.concatenate([wrenches, wrenches*mirror]))
    np.testing.assert_allclose(found, expected[:3], atol=1e-6*np.abs(expected).max())


def test_a_film_has_lubrication_at_its_surface():
    """Towards the free surface a sphere moves as one of two spheres that approach each other."""
    found = []
    for gap in (0.02, 0.01):
        fluid, integrator, context = scene([(1, 1, 5 - gap)], [1], 'Film', 'ForceCoupling', box=12,
                                           tolerance=1e-4, setChannelWalls=(0.0, 6.0))
        found.append(1/fluid.applyMobilityInContext(context, [[0, 0, 1, 0, 0, 0]])[0, 2])
    assert 'free surface' in integrator.getEffects()['hydrodynamics']
    # The friction of two equal spheres that approach each other is 6 pi eta a (1/(2 s) - 9/20 ln s)
    # for each of them, where s is their gap over a (Jeffrey and Onishi 1984), here twice `gap`.
    leading = 1.5*np.pi*(1/0.01 - 1/0.02)
    logarithm = 6*np.pi*2*(9/40)*np.log(2)
    assert found[1] - found[0] == pytest.approx(leading + logarithm, rel=0.02)
    # Along the surface nothing is sheared.
    fluid, _, context = scene([(1, 1, 4.99)], [1], 'Film', 'ForceCoupling', box=12, tolerance=1e-4,
                              setChannelWalls=(0.0, 6.0))
    along = fluid.applyMobilityInContext(context, [[1, 0, 0, 0, 0, 0]])[0, 0]
    fluid.setLubrication(False)
    fluid.updateParametersInContext(context)
    without = fluid.applyMobilityInContext(context, [[1, 0, 0, 0, 0, 0]])[0, 0]
    assert along == pytest.approx(without, rel=0.1)


@pytest.mark.parametrize('boundary', ['PeriodicWall', 'NoSlipChannel', 'Film'])
@pytest.mark.parametrize('platform', ['Reference', 'CPU'])
def test_gaussians_at_walls_step(boundary, platform):
    """Steps with matrices and with products; checkpoints go on with the same bits."""
    positions = [(0, 0, 1.05), (2.1, 0.3, 1.2), (0.6, 2.1, 1.6), (3.9, 4, 2.92)]
    for solver in ('Dense', 'MatrixFree'):
        _, integrator, context = scene(positions, [1]*4, boundary, 'ForceCoupling', box=7,
                                       solver=solver, tolerance=1e-3, temperature=300, step=2e-3,
                                       platform=platform, setChannelWalls=(0.0, 4.0))
        integrator.step(5)
        x = integrator.getBodyPositions()._value
        assert np.isfinite(x).all() and x[:, 2].min() > 1
        assert boundary == 'PeriodicWall' or x[:, 2].max() < 3
        saved = context.createCheckpoint()
        integrator.step(3)
        end = integrator.getBodyPositions()._value
        context.loadCheckpoint(saved)
        integrator.step(3)
        np.testing.assert_array_equal(integrator.getBodyPositions()._value, end)


@pytest.mark.parametrize('platform', ['Reference', 'CPU'])
def test_rollers_and_held_bodies_beside_multiblobs_are_those_of_matrices(platform):
    """A sphere that spins at a prescribed rate, one that is held, and a held free particle."""
    found = []
    for solver in ('Dense', 'MatrixFree'):
        _, integrator, system = mixed(solver=solver, tolerance=1e-9, step=1e-2, context=False)
        spin = CustomBodyMotion(wy='0.7')
        spin.addBody(1)
        system.addForce(spin)
        integrator.setBodyHeld(2, True)
        integrator.setParticleHeld(system.getNumParticles() - 1, True)
        context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platform))
        sites = [np.add(MIXED['positions'][0], site) for site in MIXED['sites']]
        context.setPositions(sites + MIXED['positions'][1:])
        integrator.setTemperature(0)
        holds = integrator.computeHoldingWrenches()
        integrator.step(2)
        x = integrator.getBodyPositions()._value
        found.append((x, integrator.getBodyOrientations(), holds))
    assert np.linalg.norm(found[0][0][1] - MIXED['positions'][1]) > 1e-4
    for dense, free in zip(*found):
        np.testing.assert_allclose(free, dense, atol=1e-7*np.abs(dense).max())


@pytest.mark.parametrize('scheme', [
    'TractionEulerMaruyama', 'TrapezoidalSlip', 'FixmanMidpoint', 'RandomFiniteDifference',
    'EulerMaruyama'
])
def test_steps_without_noise_are_those_of_matrices(scheme):
    positions = [(0, 0, 1.1), (2.1, 0.3, 1.2), (0.6, 2.1, 1.6)]
    found = []
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        for solver in ('Dense', 'MatrixFree'):
            _, integrator, context = scene(positions, [1, 1, 1], 'NoSlipWall', solver=solver,
                                           scheme=scheme, tolerance=1e-9)
            integrator.setTemperature(0)
            integrator.step(1)
            statistics = integrator.getStepStatistics()
            assert statistics['randomNumbers'] == 0
            found.append(integrator.getBodyPositions()._value)
    np.testing.assert_allclose(found[0], found[1], atol=1e-9)


def test_noise_does_not_depend_on_how_a_run_is_cut():
    positions = [(0, 0, 1.1), (2.1, 0.3, 1.2), (0.6, 2.1, 1.6)]
    ends = []
    for cut in (False, True):
        _, integrator, context = scene(positions, [1, 1, 1], 'NoSlipWall', solver='MatrixFree',
                                       temperature=1, step=1e-3)
        integrator.step(3)
        if cut:
            saved = context.createCheckpoint()
            _, integrator, context = scene(positions, [1, 1, 1], 'NoSlipWall', solver='MatrixFree',
                                           temperature=1, step=1e-3)
            context.loadCheckpoint(saved)
        integrator.step(3)
        ends.append(integrator.getBodyPositions()._value)
    np.testing.assert_array_equal(*ends)


def test_overlaps_are_redone():
    """A step that leads to an overlap, or into the wall, is taken again with new noise."""
    _, integrator, context = scene([(0, 0, 1.001), (2.003, 0, 1.001)], [1, 1], 'NoSlipWall',
                                   temperature=300, step=0.05)
    integrator.step(20)
    assert integrator.getNumRejectedSteps() > 0
    x = integrator.getBodyPositions()._value
    assert np.linalg.norm(x[0] - x[1]) > 2 and x[:, 2].min() > 1


def test_values_of_the_setting():
    fluid = MobilityForce()
    assert fluid.getLubrication() is MobilityForce.AutoLubrication
    assert fluid.getLubrication() == MobilityForce.Auto
    for given, stored in ((True, 'On'), (False, 'Off'), ('Auto', 'AutoLubrication'),
                          (MobilityForce.On, 'On'), (MobilityForce.Off, 'Off'),
                          (MobilityForce.Auto, 'AutoLubrication'), (np.bool_(True), 'On')):
        fluid.setLubrication(given)
        assert fluid.getLubrication().name == stored
    assert fluid.getLubricationReach() == (0, 0)
    fluid.setLubricationReach(2.5, 3)
    assert fluid.getLubricationReach() == (2.5, 3)
    fluid.setLubricationReach(0, 0)
    assert fluid.getLubricationReach() == (0, 0)


@pytest.mark.parametrize('bad', [1, 0, None, 0.5, MobilityForce.Dense])
def test_what_is_no_setting(bad):
    with refused('lubrication: got', 'it must be Auto, On, Off, True or False: give one of them',
                 error=TypeError):
        MobilityForce().setLubrication(bad)


def test_auto_is_on_for_stokesian_dynamics_only():
    positions, radii = [(0, 0, 0), (2.1, 0, 0)], [1, 1]
    for model, same in (('StokesianDynamics', 'On'), ('RotnePragerYamakawa', 'Off')):
        matrices = {}
        for lubrication in ('Auto', 'On', 'Off'):
            fluid, _, context = scene(positions, radii, model=model, lubrication=lubrication)
            matrices[lubrication] = fluid.getMobilityInContext(context)
        np.testing.assert_array_equal(matrices['Auto'], matrices[same])
        assert np.abs(matrices['On'] - matrices['Off']).max() > 0.01*matrices['Off'].max()


def test_what_cannot_go_together():
    positions, radii = [(0, 0, 2), (2.5, 0, 2)], [1, 1]
    with refused('lubrication is known only for spheres that do not overlap the wall',
                 'wall rejection Crossing', 'use setWallRejection(Overlap) or setLubrication(Off)'):
        scene(positions, radii, 'NoSlipWall', setWallRejection='Crossing')
    with refused('sphere-wall mobility BestKnown', 'setSphereWallMobility(FromModel)'):
        scene(positions, radii, 'NoSlipWall', setSphereWallMobility='BestKnown')
    own = (0, np.eye(6)/10)
    with refused('body 0 is a single sphere with a tensor of its own', 'use setLubrication(Off)'):
        scene(positions, radii, setBodyMobility=own)
    scene(positions, radii, setBodyMobility=own, lubrication=False)
    # A body of blobs has no lubrication, which a tensor could spoil.
    scene(positions, radii, setBodyMobility=own, sites=((0, 0, 0), (0, 0, 0.5), (0, 0.5, 0)))
    with refused('solver MatrixFree and the minimum gap 0.01', 'setMinimumGap(0)'):
        scene(positions, radii, solver='MatrixFree', setMinimumGap=0.01)
    with refused('solver MatrixFree and scheme LangevinHI', 'friction is stiff',
                 'setSolver(Dense)'):
        scene(positions, radii, solver='MatrixFree', scheme='LangevinHI', mass=1)
    for scheme in ('DriftCorrectorFD', 'DriftCorrectorRFD'):
        with refused(f'solver MatrixFree and scheme {scheme}', 'TractionEulerMaruyama'):
            scene(positions, radii, solver='MatrixFree', scheme=scheme)
    with refused('have the ratio 12', 'lubrication is known up to a ratio of 10',
                 'setLubrication(Off)'):
        scene([(0, 0, 0), (2.5, 0, 0)], [1.2, 0.1])
    _, integrator, context = scene([(0, 0, 0), (1.9, 0, 0)], [1, 1])
    with refused('RotnePragerYamakawa with lubrication', 'overlap or touch', 'setMinimumGap()'):
        integrator.step(1)
    _, integrator, context = scene([(0, 0, 1), (5, 0, 2)], [1, 1], 'NoSlipWall')
    with refused('touches the wall', 'setLubrication(Off)'):
        integrator.step(1)
    for boundary, center, what in (('Film', (0, 0, 3), 'touches the free surface'),
                                   ('SlipChannel', (0, 1, 0), 'touches a slip wall')):
        _, integrator, context = scene([center], [1], boundary, 'ForceCoupling', box=6,
                                       setChannelWalls=(0.0, 4.0), tolerance=1e-3)
        with refused(what, 'setLubrication(Off)'):
            integrator.step(1)


def test_descriptions_name_the_spheres():
    # A multiblob, two spheres and a free particle.
    _, integrator, context = scene([(0, 0, 3), (5, 0, 3), (8, 0, 3),
                                    (0, 6, 3)], [1, 1, 1, 0.5], 'NoSlipWall',
                                   sites=((0, 0, 0), (1.5, 0, 0), (0, 1.5, 0)), free=1)
    integrator.step(1)
    text = integrator.getEffects()['hydrodynamics']
    assert 'lubrication of 2 spheres with each other and with the wall' in text
    assert 'whole up to 3 mean radii and nothing from 4 on' in text
    assert 'multiblobs and free particles have none' in text


@pytest.mark.parametrize('scheme, way', [('TractionEulerMaruyama', '1 group matrix-free'),
                                         ('DriftCorrectorRFD', '1 group with dense matrices'),
                                         ('LangevinHI', '1 group with dense matrices')])
def test_auto_takes_products_where_there_are_any(scheme, way):
    positions = [(2.1*(i % 8), 2.1*(i // 8), 1.2) for i in range(64)]
    _, integrator, _ = scene(positions, [1]*64, 'NoSlipWall', scheme=scheme, mass=1, temperature=1,
                             step=1e-4, tolerance=1e-3)
    integrator.step(1)
    assert way in integrator.getEffects()['hydrodynamics']


@pytest.mark.parametrize(
    'more, pieces',
    [(dict(model='FreeDraining'), ['setLubrication(On) has no effect with model FreeDraining']),
     (dict(lubrication='Off', reach=(3, 4)), ['setLubricationReach() has no effect']),
     (dict(sites=((0, 0, 0), (1.5, 0, 0), (0, 1.5, 0))),
      ['setLubrication(On) has no effect, for only single spheres have lubrication'])])
def test_settings_without_effect_are_warned_of(capfd, more, pieces):
    _, integrator, _ = scene([(0, 0, 0)], [1], **more)
    integrator.step(1)
    warned = capfd.readouterr().err
    for piece in pieces:
        assert piece in warned
    _, integrator, _ = scene([(0, 0, 0), (3, 0, 0)], [1, 1])
    integrator.step(1)
    assert 'ubrication' not in capfd.readouterr().err


@pytest.mark.parametrize(
    'settings, pieces',
    [(dict(scheme='DriftCorrectorFD'), ['DriftCorrectorFD takes', 'use TractionEulerMaruyama']),
     (dict(scheme='DriftCorrectorFD', lubrication=False), None),
     (dict(scheme='DriftCorrectorFD', temperature=0), None),
     (dict(scheme='DriftCorrectorFD', solver='Dense'), None),
     (dict(scheme='DriftCorrectorFD', model='RotnePragerYamakawa'), None),
     (dict(scheme='TractionEulerMaruyama'), None),
     (dict(scheme='TractionEulerMaruyama', setMinimumGap=0.01,
           count=200), ['setMinimumGap(0.01) takes', 'use setMinimumGap(0)'])])
def test_steps_of_seconds_are_warned_of(settings, pieces):
    """A column of a matrix of ForceCoupling along no-slip walls is a product on the grid."""
    settings = {'model': 'ForceCoupling', 'temperature': 1, **settings}
    count = settings.pop('count', 12)
    positions = [(2.3*(i % 12), 2.3*(i // 12), 1.2) for i in range(count)]
    _, integrator, _ = scene(positions, [1]*count, 'PeriodicWall', box=28, tolerance=1e-3,
                             step=1e-4, platform='CPU', **settings)
    warned = integrator.getEffects()['warnings']
    if pieces is None:
        assert 'is a product on the grid' not in warned
    else:
        for piece in [*pieces, 'a step is estimated to take']:
            assert piece in warned


def test_a_step_of_seconds_warns_the_user(platform, capfd):
    _, integrator, _ = scene([(2.3*i, 0, 1.2) for i in range(6)], [1]*6, 'PeriodicWall',
                             'ForceCoupling', box=20, tolerance=1e-3, step=1e-4, temperature=1,
                             scheme='DriftCorrectorFD', platform=platform.getName())
    integrator.step(1)
    assert capfd.readouterr().err.count('is a product on the grid') == 1


@pytest.mark.parametrize('model', ['RotnePragerYamakawa', 'StokesianDynamics'])
def test_iterations_keep_their_tolerance_where_many_spheres_nearly_touch(model):
    """A crystal in which each sphere has twelve neighbours at a thousandth of a radius."""
    edge, tolerance, step = 2*np.sqrt(2)*2.001, 1e-3, 1e-6
    base = np.array([(0, 0, 0), (0.5, 0.5, 0), (0.5, 0, 0.5), (0, 0.5, 0.5)])
    x = np.concatenate([base + cell for cell in np.ndindex(2, 2, 2)])*edge/2
    pull = openmm.CustomExternalForce('-(fx*x + fy*y + fz*z)')
    for name in ('fx', 'fy', 'fz'):
        pull.addPerParticleParameter(name)
    for particle, force in enumerate(np.random.default_rng(5).normal(size=x.shape)):
        pull.addParticle(particle, force)
    velocities = []
    for solver in ('Dense', 'MatrixFree'):
        system, fluid = openmm.System(), MobilityForce()
        integrator = CustomRigidHIIntegrator(0, step)
        integrator.setScheme(integrator.EulerMaruyama)
        for _ in x:
            integrator.addRigidBody([system.addParticle(0)], 0, (0, 0, 0), [(0, 0, 0)])
            fluid.addParticle(1)
        fluid.setViscosity(1)
        fluid.setModel(getattr(fluid, model))
        fluid.setLubrication(fluid.On)
        fluid.setLubricationReach(3, 4)
        fluid.setBoundary(fluid.Periodic)
        fluid.setSolver(getattr(fluid, solver))
        fluid.setSolverTolerance(tolerance)
        system.addForce(fluid)
        system.addForce(copy.deepcopy(pull))
        system.setDefaultPeriodicBoxVectors(*(edge*np.eye(3)).tolist())
        context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'))
        context.setPositions(x)
        integrator.step(1)
        velocities.append((integrator.getBodyPositions()._value - x)/step)
    dense, iterated = velocities
    assert np.linalg.norm(iterated - dense) < 2.5*tolerance*np.linalg.norm(dense)
