"""Placing bodies by openmmrigidhi.app.placeBodies() and makeWhole(), and the messages that advise
it."""
import re

import numpy as np
import openmm
import pytest
import scipy.optimize
from openmm import unit
from scipy.spatial.transform import Rotation

from openmmrigidhi import CustomRigidHIIntegrator
from openmmrigidhi.app import makeWhole, placeBodies
from scenes import WaterBox, dumbbells

T = 0.109/3**0.5
S, C = 0.125*np.sin(np.deg2rad(63)), 0.125*np.cos(np.deg2rad(63))
#: Sites (nm) and masses of molecules all of whose distances are constrained.
REDUNDANT = {
    'CO2': ([(0, 0, 0), (0.116, 0, 0), (-0.116, 0, 0)], (12, 16, 16)),
    'formate': ([(0, 0, 0), (S, C, 0), (-S, C, 0), (0, -0.112, 0)], (12, 16, 16, 1)),
    'nearly planar': ([(0, 0, 0.002), (S, C, 0), (-S, C, 0), (0, -0.112, 0)], (12, 16, 16, 1)),
    'methane': ([(0, 0, 0), (T, T, T), (-T, -T, T), (-T, T, -T), (T, -T, -T)], (12, 1, 1, 1, 1))
}
INDEPENDENT = {
    'N2': ([(0, 0, 0), (0.11, 0, 0)], (14, 14)),
    'water': ([(0, 0, 0), (0.1, 0, 0), (-0.03, 0.095, 0)], (16, 1, 1)),
    'P4': ([(T, T, T), (-T, -T, T), (-T, T, -T), (T, -T, -T)], (31,)*4)
}
MOLECULES = {**REDUNDANT, **INDEPENDENT}


def refused(*pieces, error=ValueError):
    return pytest.raises(error, match='.*'.join(re.escape(piece) for piece in pieces))


def positionsOf(context):
    return context.getState(getPositions=True).getPositions(asNumpy=True)._value


def molecule(name, platform):
    """A Context without positions, and positions off by about 0.003 nm in every coordinate."""
    sites, masses = MOLECULES[name]
    sites = np.array(sites)
    system = openmm.System()
    for mass in masses:
        system.addParticle(mass)
    for i in range(len(sites)):
        for j in range(i):
            system.addConstraint(i, j, np.linalg.norm(sites[i] - sites[j]))
    integrator = CustomRigidHIIntegrator(300, 0.002)
    integrator.addRigidBody(range(len(sites)))
    context = openmm.Context(system, integrator, platform)
    return integrator, context, sites + np.random.default_rng(2).normal(
        scale=0.003, size=sites.shape)


def checkShape(context):
    system, x = context.getSystem(), positionsOf(context)
    for i in range(system.getNumConstraints()):
        first, second, distance = system.getConstraintParameters(i)
        assert np.linalg.norm(x[first] - x[second]) == pytest.approx(distance._value, rel=1e-9)


# ---- Fits ----------------------------------------------------------------------------------------


@pytest.mark.parametrize('way', ['first placement', 'after the error', 'later'])
@pytest.mark.parametrize('name', MOLECULES)
def test_particles_are_put_in_their_places(name, way, platform):
    integrator, context, x = molecule(name, platform)
    if way == 'later':
        context.setPositions(MOLECULES[name][0])
        integrator.step(5)
    if way == 'after the error':
        context.setPositions(x)
        with refused('nm from its place', 'placeBodies()', error=openmm.OpenMMException):
            integrator.step(1)
        distance = placeBodies(context)
    else:
        distance = placeBodies(context, particlePositions=x)
    moved = np.linalg.norm(positionsOf(context) - x, axis=1)
    assert 0.002 < moved.max() == pytest.approx(distance.value_in_unit(unit.nanometer), rel=1e-6)
    # The fit leaves the centre of mass where it is.
    masses = MOLECULES[name][1]
    assert np.allclose(masses @ (positionsOf(context) - x), 0, rtol=0, atol=1e-9)
    checkShape(context)
    assert integrator.getPoseTolerance() == 2e-3*unit.nanometer
    integrator.step(5)
    checkShape(context)


def test_what_a_fit_leaves_alone(platform):
    """Velocities, the box, and free particles."""
    system, x, definitions = dumbbells(3)
    x = np.concatenate([x, [(5, 5, 5), (6, 5, 5)]])
    for _ in range(2):
        system.addParticle(1.0)
    system.addParticle(0.0)
    system.setVirtualSite(8, openmm.TwoParticleAverageSite(6, 7, 0.25, 0.75))
    integrator = CustomRigidHIIntegrator(300, 0.002)
    for definition in definitions:
        integrator.addRigidBody(*definition)
    context = openmm.Context(system, integrator, platform)
    context.setPositions(np.concatenate([x, [(0, 0, 0)]]))
    context.setPeriodicBoxVectors((7, 0, 0), (1, 8, 0), (2, 3, 9))
    context.setVelocitiesToTemperature(300, 1)
    integrator.step(1)
    before = [integrator.getBodyVelocities()._value, integrator.getBodyAngularVelocities()._value]
    new = np.concatenate([x[:, [1, 2, 0]] + (1, 2, 3), [(np.nan,)*3]])  # files lack virtual sites
    new[:6] += np.random.default_rng(1).normal(scale=0.003, size=(6, 3))
    placeBodies(context, particlePositions=new)
    got = positionsOf(context)
    assert np.allclose(got[6:8], new[6:8], rtol=0, atol=1e-6)
    assert np.allclose(got[8], 0.25*new[6] + 0.75*new[7], rtol=0, atol=1e-6)
    assert np.allclose(integrator.getBodyVelocities()._value, before[0], rtol=0, atol=1e-12)
    # There is no rotation about the line of a dumbbell, which has turned.
    omega, axis = before[1], integrator.getBodyOrientations()
    assert np.all(np.linalg.norm(omega, axis=1) > 0.1)
    line = (got[1:6:2] - got[:6:2])/0.2
    omega = omega - np.sum(omega*line, axis=1)[:, None]*line
    assert np.allclose(integrator.getBodyAngularVelocities()._value, omega, rtol=0, atol=1e-9)
    assert axis.shape == (3, 4)
    box = context.getState().getPeriodicBoxVectors(asNumpy=True)._value
    assert box.tolist() == [[7, 0, 0], [1, 8, 0], [2, 3, 9]]


def test_hopeless_fits_are_refused_and_change_nothing(platform):
    integrator, context, x = molecule('methane', platform)
    context.setPositions(MOLECULES['methane'][0])
    context.setVelocitiesToTemperature(300, 1)
    integrator.step(1)
    before = positionsOf(context), integrator.getBodyVelocities()._value
    torn = np.array(MOLECULES['methane'][0])
    torn[2] += (2, 0, 0)
    for wrong in (torn, x[[1, 0, 2, 3, 4]]):
        with refused('placeBodies: body 0: particle', 'nm from its place after the fit, more than '
                     '0.0545 nm', 'makeWhole()'):
            placeBodies(context, particlePositions=wrong)
    with refused('placeBodies: body 0: particle', 'more than 0.001 nm',
                 'or give a larger tolerance'):
        placeBodies(context, particlePositions=x, tolerance=0.01*unit.angstrom)
    x[3, 1] = np.inf
    with refused('placeBodies: particlePositions: particle 3 is at [', ', inf, ',
                 'give it three finite numbers'):
        placeBodies(context, particlePositions=x)
    assert np.array_equal(positionsOf(context), before[0])
    assert np.allclose(integrator.getBodyVelocities()._value, before[1], rtol=0, atol=1e-12)
    assert integrator.getPoseTolerance() == 2e-3*unit.nanometer
    integrator.step(1)


def everything(integrator, context):
    state = context.getState(getPositions=True, getVelocities=True)
    return [
        quantity._value if unit.is_quantity(quantity) else quantity
        for quantity in (state.getPositions(asNumpy=True), state.getVelocities(asNumpy=True),
                         integrator.getBodyPositions(), integrator.getBodyOrientations(),
                         integrator.getBodyVelocities(), integrator.getBodyAngularVelocities())
    ]


@pytest.mark.parametrize('given', [{}, {
    'orientations': [(0.5, 0.5, 0.5, 0.5)]*3
}, {
    'positions': [(1, 2, 3)]*3
}], ids=['no poses', 'orientations', 'positions'])
def test_a_refused_call_changes_no_bit(given, platform):
    rng = np.random.default_rng(4)
    system, integrator = openmm.System(), CustomRigidHIIntegrator(300, 0.002)
    sites = np.array([(0.1, 0.1, 0.1), (-0.1, -0.1, 0.1), (-0.1, 0.1, -0.1), (0.1, -0.1, -0.12)])
    for _ in range(3):
        integrator.addRigidBody([system.addParticle(10) for _ in sites], 40, (1, 1.1, 1.2), sites)
    system.addParticle(5)
    context = openmm.Context(system, integrator, platform)
    x = np.vstack([sites + rng.normal(size=3) for _ in range(3)] + [(9, 9, 9)])
    context.setPositions(x)
    context.setVelocitiesToTemperature(300, 3)
    integrator.step(3)
    before, checkpoint = everything(integrator, context), context.createCheckpoint()
    with refused('nm from its place after the fit'):
        placeBodies(context, particlePositions=rng.normal(size=x.shape), **given)
    assert all(map(np.array_equal, everything(integrator, context), before))
    if platform.getName() == 'Reference':
        assert context.createCheckpoint() == checkpoint


def test_another_error_than_a_misfit_is_passed_on(platform):
    """A site that contradicts the System's virtual site."""
    system = openmm.System()
    for mass in (1, 1, 0):
        system.addParticle(mass)
    system.setVirtualSite(2, openmm.TwoParticleAverageSite(0, 1, 0.5, 0.5))
    integrator = CustomRigidHIIntegrator(300, 0.002)
    sites = np.array([(-0.1, 0, 0), (0.1, 0, 0), (0.01, 0, 0)])
    integrator.addRigidBody(range(3), 2, (0, 0.02, 0.02), sites)
    with refused('the site given for particle 2 is', error=openmm.OpenMMException):
        context = openmm.Context(system, integrator, platform)
        placeBodies(context, particlePositions=sites)
    assert integrator.getPoseTolerance() == 2e-3*unit.nanometer


# ---- Given poses ---------------------------------------------------------------------------------


def turned(angle):
    return (np.cos(angle/2), 0, np.sin(angle/2), 0)


@pytest.mark.parametrize('first', [True, False])
def test_poses_are_set_in_one_call(first, platform):
    system, x, definitions = dumbbells(2)
    integrator = CustomRigidHIIntegrator(300, 0.002)
    for definition in definitions:
        integrator.addRigidBody(*definition)
    context = openmm.Context(system, integrator, platform)
    if not first:
        context.setPositions(x)
    R, q = np.array([(1, 2, 3), (4, 5, 6)]), [turned(np.pi/2), turned(0)]
    assert placeBodies(context, R*10*unit.angstrom, q)._value < 1e-6
    assert np.array_equal(integrator.getBodyPositions()._value, R)
    assert np.allclose(integrator.getBodyOrientations(), q, rtol=0, atol=1e-15)
    assert np.allclose(positionsOf(context), [(0.9, 2, 3), (1.1, 2, 3), (4, 5, 5.9), (4, 5, 6.1)],
                       rtol=0, atol=1e-6)
    placeBodies(context, positions=R + 1)
    placeBodies(context, orientations=q[::-1])
    assert np.array_equal(integrator.getBodyPositions()._value, R + 1)
    assert np.allclose(integrator.getBodyOrientations(), q[::-1], rtol=0, atol=1e-15)
    integrator.step(1)


SHAPES = {
    'general': [(0.1, 0.1, 0.1), (-0.1, -0.1, 0.1), (-0.1, 0.1, -0.1), (0.1, -0.1, -0.12)],
    'flat': [(-0.1, 0, 0), (0.1, 0, 0), (0, 0.15, 0)],
    'rod': [(-0.1, 0, 0), (0, 0, 0), (0.1, 0, 0)],
    'off its origin': [(0.3, 0.2, 0.1)],
    'a rod off its origin': [(0.3, 0.2, 0.1), (0.3, 0.2, 0.3)],
    'a sphere': [(0, 0, 0)]
}


@pytest.mark.parametrize('masses', [(10, 7, 3, 1), (0, 0, 0, 0), (10, 0, 0, 0)],
                         ids=['masses', 'no masses', 'one mass'])
@pytest.mark.parametrize('givenFirst', [False, True])
@pytest.mark.parametrize('given', ['positions', 'orientations'])
@pytest.mark.parametrize('shape', SHAPES)
def test_one_part_of_a_pose_is_fitted_for_the_other(shape, given, givenFirst, masses, platform):
    """Against SciPy's minimiser; with the whole pose given, particles are in their places."""
    rng = np.random.default_rng(6)
    sites = np.array(SHAPES[shape])
    masses = np.array(masses[:len(sites)])
    system, integrator = openmm.System(), CustomRigidHIIntegrator(300, 0.002)
    for _ in range(2):
        integrator.addRigidBody([system.addParticle(m) for m in masses], 20, (1, 1.1, 1.2), sites)
    context = openmm.Context(system, integrator, platform)
    if not givenFirst:
        context.setPositions(np.vstack([sites, sites + 2]))
    turns = Rotation.random(2, random_state=5)
    x = np.vstack([turn.apply(sites) + rng.normal(size=3) for turn in turns])
    x += rng.normal(scale=0.002, size=x.shape)
    pose = {
        'positions': rng.normal(size=(2, 3)),
        'orientations': Rotation.random(2, random_state=7).as_quat()[:, [3, 0, 1, 2]]
    }
    distance = placeBodies(context, particlePositions=x, **{given: pose[given]})._value
    R, q = integrator.getBodyPositions()._value, integrator.getBodyOrientations()
    assert np.allclose(pose[given], R if given == 'positions' else q, rtol=0, atol=1e-12)
    places = np.vstack([
        position + Rotation.from_quat(turn).apply(sites)
        for position, turn in zip(R, q[:, [1, 2, 3, 0]])
    ])
    assert np.allclose(positionsOf(context), places, rtol=0, atol=1e-6)
    assert distance == pytest.approx(np.linalg.norm(x - places, axis=1).max(), rel=1e-9)
    isLeftOpen = len(sites) > 1 and np.count_nonzero(masses) == 1
    weights = np.ones(len(sites)) if isLeftOpen or not masses.any() else masses

    def cost(change, body):
        members = slice(body*len(sites), (body + 1)*len(sites))
        if given == 'positions':
            moved = R[body] + (Rotation.from_rotvec(change)*
                               Rotation.from_quat(q[body, [1, 2, 3, 0]])).apply(sites)
        else:
            moved = places[members] + change
        return weights @ np.sum((moved - x[members])**2, axis=1)

    for body in range(2):
        best = scipy.optimize.minimize(cost, np.zeros(3), (body,), options={'gtol': 1e-9}).fun
        assert cost(np.zeros(3), body) <= best + 1e-9
    integrator.step(1) if masses.any() else None


@pytest.mark.parametrize('given', ['positions', 'orientations'])
def test_an_open_rotation_is_the_smallest_one(given, platform):
    """A rod keeps its spin, and a rod that points the other way turns by half a turn."""
    sites = np.array(SHAPES['rod'])
    system, integrator = openmm.System(), CustomRigidHIIntegrator(300, 0.002)
    integrator.addRigidBody([system.addParticle(1) for _ in sites], 3, (0, 0.02, 0.02), sites)
    context = openmm.Context(system, integrator, platform)
    spin = (np.cos(0.3), np.sin(0.3), 0, 0)  # about its line
    placeBodies(context, [(0, 0, 0)], [spin])
    pose = {'positions': [(1, 2, 3)], 'orientations': [spin]}
    placeBodies(context, particlePositions=sites + 1, **{given: pose[given]})
    assert np.allclose(integrator.getBodyOrientations(), [spin], rtol=0, atol=1e-12)
    if given == 'positions':
        placeBodies(context, [(1, 2, 3)], particlePositions=-sites)
        assert np.allclose(positionsOf(context), (1, 2, 3) - sites, rtol=0, atol=1e-6)


def test_a_tolerance_holds_for_given_poses(platform):
    system, x, definitions = dumbbells(1)
    integrator = CustomRigidHIIntegrator(300, 0.002)
    integrator.addRigidBody(*definitions[0])
    context = openmm.Context(system, integrator, platform)
    with refused('body 0: particle', 'nm from its place after the fit, more than 0.5 nm'):
        placeBodies(context, [(1, 2, 3)], particlePositions=x, tolerance=0.5)
    assert placeBodies(context, [(1, 2, 3)], particlePositions=x, tolerance=9)._value > 1


def test_given_poses_do_not_need_positions_that_fit(platform):
    """Present positions are nonsense, and free particles get theirs from particlePositions."""
    system, x, definitions = dumbbells(1)
    system.addParticle(1.0)
    integrator = CustomRigidHIIntegrator(300, 0.002)
    integrator.addRigidBody(*definitions[0])
    context = openmm.Context(system, integrator, platform)
    context.setPositions([(0, 0, 0), (0, 0, 3), (0, 0, 0)])
    given = [(np.nan,)*3, (np.nan,)*3, (7, 8, 9)]
    placeBodies(context, [(1, 2, 3)], [turned(0)], given)
    assert np.allclose(positionsOf(context), [(1, 2, 2.9), (1, 2, 3.1), (7, 8, 9)], rtol=0,
                       atol=1e-6)
    context.setPositions([(0, 0, 0), (0, 0, 3), (4, 5, 6)])
    placeBodies(context, [(1, 2, 3)], [turned(0)])
    assert np.allclose(positionsOf(context), [(1, 2, 2.9), (1, 2, 3.1), (4, 5, 6)], rtol=0,
                       atol=1e-6)
    integrator.step(1)


def test_a_first_placement_of_water_by_poses(platform):
    """Constraints and virtual sites define the shape, so that poses are enough."""
    box = WaterBox(2)
    integrator = box.integrator()
    context = openmm.Context(box.system, integrator, platform)
    placeBodies(context, np.arange(24).reshape(8, 3)*0.4)
    checkShape(context)
    assert np.array_equal(integrator.getBodyOrientations(), np.tile((1, 0, 0, 0), (8, 1)))
    before = positionsOf(context)
    context.computeVirtualSites()
    assert np.allclose(positionsOf(context), before, rtol=0, atol=1e-6)


def test_first_placements_that_leave_something_open(platform):
    system, x, definitions = dumbbells(1)
    integrator = CustomRigidHIIntegrator(300, 0.002)
    integrator.addRigidBody([0, 1])
    context = openmm.Context(system, integrator, platform)
    with refused('placeBodies: the Context has no positions yet, and none are given',
                 'give positions of the bodies, or particlePositions'):
        placeBodies(context)
    with refused('the shape of body 0 is not known yet', 'give particlePositions, too, or add'):
        placeBodies(context, [(0, 0, 0)])
    placeBodies(context, [(1, 2, 3)], particlePositions=x)
    assert np.allclose(positionsOf(context), [(1, 2, 2.9), (1, 2, 3.1)], rtol=0, atol=1e-6)
    integrator.step(1)
    system.addParticle(1.0)
    integrator = CustomRigidHIIntegrator(300, 0.002)
    integrator.addRigidBody(*definitions[0])
    context = openmm.Context(system, integrator, platform)
    with refused('particle 2 is in no body, and the Context has no positions yet',
                 'give particlePositions, too'):
        placeBodies(context, [(0, 0, 0)])


def test_bad_arguments_of_placeBodies(platform):
    system, x, definitions = dumbbells(1)
    integrator = CustomRigidHIIntegrator(300, 0.002)
    integrator.addRigidBody(*definitions[0])
    context = openmm.Context(system, integrator, platform)
    context.setPositions(x)
    with refused('placeBodies: positions: body 0 is at [0.0, nan, 0.0] nm'):
        placeBodies(context, [(0, np.nan, 0)])
    with refused('orientations: that of body 0 has the length 1.1', 'divide it by its length'):
        placeBodies(context, [(5, 5, 5)], [(1.1, 0, 0, 0)])
    with refused('placeBodies: positions: got an array of shape (2, 3)', '(1, 3)'):
        placeBodies(context, np.zeros((2, 3)))
    with refused('placeBodies: particlePositions: got an array of shape (3, 3)', '(2, 3)'):
        placeBodies(context, particlePositions=np.zeros((3, 3)))
    with refused(
            'placeBodies: tolerance: got 0.0 nm; it must be positive: leave it out for half of'):
        placeBodies(context, particlePositions=x, tolerance=0)
    with refused('placeBodies: positions: got a quantity in kelvin', error=TypeError):
        placeBodies(context, [(0, 0, 0)]*unit.kelvin)
    with refused('placeBodies: context: got CustomRigidHIIntegrator', error=TypeError):
        placeBodies(integrator)
    other = openmm.Context(system, openmm.VerletIntegrator(0.001), platform)
    with refused('CustomRigidHIIntegrator.cast', error=TypeError):
        placeBodies(other)
    assert np.allclose(positionsOf(context), x, rtol=0, atol=1e-6)


# ---- Messages ------------------------------------------------------------------------------------


@pytest.mark.parametrize('name', MOLECULES)
def test_the_advice_for_positions_that_do_not_fit_is_right(name, platform):
    integrator, context, x = molecule(name, platform)
    context.setPositions(x)
    with refused('nm from its place in the body', 'call openmmrigidhi.app.placeBodies()',
                 error=openmm.OpenMMException) as error:
        integrator.step(1)
    if name in INDEPENDENT:
        assert ', or call applyConstraints() on the Context.' in str(error.value)
        context.applyConstraints(1e-6)
        integrator.step(1)
    else:
        assert ("but not applyConstraints() or OpenMM's minimisers, which make NaN of its "
                'redundant constraints') in str(error.value)


def test_bodies_without_constraints_are_not_told_of_them(platform):
    system, x, definitions = dumbbells(1)
    integrator = CustomRigidHIIntegrator(300, 0.002)
    integrator.addRigidBody(*definitions[0])
    context = openmm.Context(system, integrator, platform)
    context.setPositions(1.1*x)
    with refused('call openmmrigidhi.app.placeBodies(). Or raise setPoseTolerance()',
                 error=openmm.OpenMMException) as error:
        integrator.step(1)
    assert 'applyConstraints' not in str(error.value)


def scaledBody(sites, x, platform):
    """A Context with one body of three sites, or of two, and its positions."""
    system, integrator = openmm.System(), CustomRigidHIIntegrator(300, 0.002)
    integrator.addRigidBody([system.addParticle(10) for _ in sites], 10*len(sites), (1, 1, 2),
                            sites)
    context = openmm.Context(system, integrator, platform)
    context.setPositions(x)
    return integrator, context


SCALED = np.array([(-0.1, 0, 0), (0.1, 0, 0), (0, 0.1, 0)])


@pytest.mark.parametrize('count, unitOfSites, unitOfPositions, ratio', [(3, 1000, 1, '0.001'),
                                                                        (3, 1, 10, '10'),
                                                                        (3, 1, 6, '6'),
                                                                        (2, 1, 1000, '1000'),
                                                                        (2, 1, 0.1, '0.1')])
def test_positions_in_another_unit_are_told_of_units(count, unitOfSites, unitOfPositions, ratio,
                                                     platform):
    sites = SCALED[:count]
    integrator, context = scaledBody(sites*unitOfSites, sites*unitOfPositions + 3, platform)
    hint = ('positions seem to be in another unit of length',
            f'(they are about {ratio} times as far apart as the sites)',
            'give positions and sites in nm, or as Quantities with units')
    with refused('nm from its place in the body', *hint, error=openmm.OpenMMException) as error:
        integrator.step(1)
    assert 'placeBodies' not in str(error.value) and 'Rounding' not in str(error.value)
    with refused('placeBodies: body 0: particle', 'nm from its place after the fit',
                 *hint) as error:
        placeBodies(context)
    assert 'mirror' not in str(error.value)


@pytest.mark.parametrize('x', [
    SCALED + [(0, 0, 0), (3, 0, 0),
              (0, 0, 0)], SCALED + [(0, 0, 0), (3, 0, 0),
                                    (0, 3, 0)], SCALED[:2] + [(0, 0, 0),
                                                              (3, 0, 0)], SCALED*4, SCALED/4,
    np.random.default_rng(3).normal(size=(3, 3))
], ids=['torn', 'torn twice', 'a torn pair', 'four times', 'a fourth', 'random'])
def test_positions_with_other_faults_are_not_told_of_units(x, platform):
    integrator, context = scaledBody(SCALED[:len(x)], x, platform)
    with refused('nm from its place in the body', 'call openmmrigidhi.app.placeBodies()',
                 error=openmm.OpenMMException) as error:
        integrator.step(1)
    assert 'unit of length' not in str(error.value)
    with refused('do not have the shape of the body: look for') as error:
        placeBodies(context)
    assert 'unit of length' not in str(error.value)


@pytest.mark.parametrize('started', [False, True])
@pytest.mark.parametrize('name', ['CO2', 'formate', 'methane'])
def test_what_openmm_makes_of_redundant_constraints_is_named(name, started, platform):
    integrator, context, x = molecule(name, platform)
    if started:
        context.setPositions(MOLECULES[name][0])
        integrator.step(1)
    context.setPositions(x)
    context.applyConstraints(1e-6)  # minimisers call it, and some then run for ever
    if np.all(np.isfinite(positionsOf(context))):
        pytest.skip('this version of OpenMM copes with redundant constraints')
    cause = ("OpenMM's applyConstraints() and minimisers do that to a body whose constraints are "
             'redundant', 'call openmmrigidhi.app.placeBodies() instead')
    with refused('body 0: particle 0 has the position', 'nm, which is not finite', *cause,
                 error=openmm.OpenMMException):
        integrator.step(1)
    placeBodies(context, particlePositions=x)
    integrator.step(1)
    checkShape(context)


def test_velocities_that_openmm_makes_nan_of_are_explained(platform):
    """setVelocitiesToTemperature() applies constraints, too."""
    integrator, context, x = molecule('CO2', platform)
    context.setPositions(MOLECULES['CO2'][0])
    context.setVelocities(np.full((3, 3), np.inf))
    with refused(
            'body 0: particle 0 has the velocity',
            'nm/ps, which is not finite; set finite velocities by the '
            "Context's setVelocities(), without setVelocitiesToTemperature(), in which OpenMM "
            'makes NaN of a body with redundant constraints', error=openmm.OpenMMException):
        integrator.step(1)
    context.setVelocities(np.zeros((3, 3)))
    integrator.step(1)


def test_positions_of_gro_files_fit():
    """Three decimals of nm are off by up to 0.9e-3 nm, and the poses by as much."""
    box = WaterBox(6)
    integrator = box.integrator()
    context = openmm.Context(box.system, integrator, openmm.Platform.getPlatformByName('CPU'))
    context.setPositions(box.positions)
    integrator.step(1)
    exact = positionsOf(context)
    context.setPositions(exact.round(3))
    assert 1e-3 < integrator.getPoseResidual()._value < 1.75e-3
    integrator.step(1)


@pytest.mark.parametrize('tolerance, decimals, hint', [
    (1e-5, 4, '. Rounding to 4 decimals of nm, as in PDB files, may move particles this far; give'),
    (1e-4, 3,
     '. Rounding to 3 decimals of nm, as in .gro files, may move particles this far; give'),
    (1e-3, 2, '. Rounding to 2 decimals of nm may move particles this far; give'),
    (1e-3, 1, 'nm; give positions'),
    (1e-4, None, '. The positions may belong to another model of the molecule, with other bond'),
])
def test_the_decimals_of_a_file_are_named(tolerance, decimals, hint, waterBox, platform):
    """Also where a file of settings has a smaller tolerance than the default."""
    integrator = waterBox.integrator()
    context = openmm.Context(waterBox.system, integrator, platform)
    context.setPositions(waterBox.positions)
    integrator.step(1)
    exact = positionsOf(context)
    integrator.setPoseTolerance(tolerance)
    # Water of another model has longer bonds.
    rounded = 1.01*exact if decimals is None else exact.round(decimals)
    for body in range(1, 27):
        rounded[4*body:4*body + 4] = exact[4*body:4*body + 4]
    context.setPositions(rounded)
    with refused('body 0: particle', 'more than the pose tolerance', hint,
                 error=openmm.OpenMMException):
        integrator.step(1)


# ---- Bodies that were wrapped into the box -------------------------------------------------------


@pytest.mark.parametrize('box', [np.eye(3)*1.2, [(1.2, 0, 0), (0.4, 1.3, 0), (-0.5, 0.6, 1.1)]],
                         ids=['cubic', 'triclinic'])
def test_bodies_are_made_whole(box):
    box = np.array(box)
    random = np.random.default_rng(5)
    integrator = CustomRigidHIIntegrator(300, 0.002)
    whole = random.uniform(-2, 2, (60, 1, 3)) + random.uniform(-0.12, 0.12, (60, 4, 3))
    whole = np.concatenate([whole.reshape(-1, 3), [(7, 8, 9)]])
    for body in range(60):
        integrator.addRigidBody([4*body + k for k in (2, 0, 1, 3)])
    fractions = whole @ np.linalg.inv(box)
    torn = (fractions - np.floor(fractions)) @ box
    torn[-1] = whole[-1]
    made = makeWhole(integrator, torn*unit.nanometer, box)._value
    assert np.array_equal(made[2::4], torn[2::4]) and np.array_equal(made[-1], whole[-1])
    shift = np.repeat((made - whole)[2:-1:4], 4, axis=0)
    assert np.allclose(made[:-1], whole[:-1] + shift, rtol=0, atol=1e-13)
    assert not np.allclose(made, torn, atol=0.5)


def test_what_cannot_be_made_whole():
    integrator = CustomRigidHIIntegrator(300, 0.001)
    integrator.addRigidBody([1, 0, 2])
    places = np.array([(0, 0, 0), (0.3, 0, 0), (0.6, 0, 0)])
    box = np.eye(3)
    with refused('makeWhole: body 0 is 0.6 of the box long along box vector a',
                 'it must be shorter than half the box', 'give whole positions of this body'):
        makeWhole(integrator, places, box)
    makeWhole(integrator, places, np.diag([1.3, 1, 1]))
    with refused('makeWhole: positions: got 2 rows; body 0 has particle 2', 'give a row for each'):
        makeWhole(integrator, places[:2], box)
    with refused('makeWhole: boxVectors: got', 'three finite vectors must span a volume'):
        makeWhole(integrator, places, np.zeros((3, 3)))
    places[2, 1] = np.nan
    with refused('makeWhole: positions: particle 2 of body 0 is at [0.6, nan, 0.0]',
                 'all numbers must be finite: correct the file'):
        makeWhole(integrator, places, box)
    with refused('makeWhole: system: got int; it must be an openmm.System', 'or leave it out',
                 error=TypeError):
        makeWhole(integrator, places, box, 3)


def dumbbell(length):
    """An integrator with one explicit body, and its sites."""
    integrator = CustomRigidHIIntegrator(300, 0.001)
    sites = np.array([(-length/2, 0, 0), (length/2, 0, 0)])
    integrator.addRigidBody([0, 1], 2, (0, 1, 1), sites)
    return integrator, sites


@pytest.mark.parametrize('length', [0.8, 0.55, 0.95])
def test_bodies_that_are_longer_than_half_the_box_are_not_torn(length):
    """The ends are nearest to each other through a face of the box, as a short body."""
    integrator, sites = dumbbell(length)
    with refused(
            f'makeWhole: body 0 is {length:.3g} nm long by its sites, and half the width of '
            'the box is 0.5 nm', 'give whole positions of this body'):
        makeWhole(integrator, sites + (0.9, 0.5, 0.5) - [(0, 0, 0), (1, 0, 0)], np.eye(3))


def test_bodies_that_are_nearly_as_long_as_the_box_may_have_their_shape(platform):
    """A body along the diagonal is shorter than half the box along each edge."""
    integrator, sites = dumbbell(0.7)
    along = sites[:, :1]*np.ones(3)/3**0.5
    torn = (along + 0.2) % 1
    assert np.allclose(
        makeWhole(integrator, torn, np.eye(3))._value - torn[0], along - along[0], rtol=0,
        atol=1e-12)
    # Coordinates that do not fit, of a short body, are no matter of the box.
    integrator, sites = dumbbell(0.3)
    assert np.allclose(makeWhole(integrator, 1.4*sites, np.eye(3))._value, 1.4*sites)


def test_virtual_sites_without_positions_are_left_to_be_computed(platform):
    system = openmm.System()
    integrator = CustomRigidHIIntegrator(300, 0.001)
    sites = np.array([(0, 0.03, 0), (-0.1, 0, 0), (0.1, 0, 0), (0, 0.1, 0)])
    for mass in (0, 10, 10, 10):
        system.addParticle(mass)
    system.setVirtualSite(0, openmm.ThreeParticleAverageSite(1, 2, 3, 0.35, 0.35, 0.3))
    integrator.addRigidBody(range(4), 30, (1, 1, 2), sites)
    torn = (sites + (0, 0.5, 0.5)) % 1
    torn[0] = np.nan
    with refused('makeWhole: positions: particle 0 of body 0 is at [nan, nan, nan]',
                 'or give the system if the particle is a virtual site'):
        makeWhole(integrator, torn, np.eye(3))
    made = makeWhole(integrator, torn, np.eye(3), system)._value
    assert np.isnan(made[0]).all() and np.allclose(made[1:] - made[1], sites[1:] - sites[1])
    context = openmm.Context(system, integrator, platform)
    placeBodies(context, particlePositions=made)
    assert np.allclose(positionsOf(context) - made[1], sites - sites[1], rtol=0, atol=1e-6)
    # setPositions() alone does not compute virtual sites.
    integrator.step(1)
    context.setPositions(made)
    with refused(
            'body 0: particle 0 has the position (nan, nan, nan) nm, which is not finite; it '
            'is a virtual site: call computeVirtualSites() on the Context after '
            'setPositions()', error=openmm.OpenMMException):
        integrator.step(1)
    context.computeVirtualSites()
    integrator.step(1)
    with refused('makeWhole: positions: particle 2 of body 0 is at [nan, nan, nan]'):
        makeWhole(integrator, np.where(np.arange(4)[:, None] == 2, np.nan, made), np.eye(3), system)
