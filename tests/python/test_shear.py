"""Sheared periodic fluids: the box that tilts with the flow, the motion of bodies through flips of
the box, what is saved and refused, and the stress by parts."""
import copy
import itertools
import json
import os
import re
import warnings

import numpy as np
import openmm
import pytest
from openmm import unit

from openmmrigidhi import CustomBodyForce, CustomRigidHIIntegrator, MobilityForce, analysis, app

DATA = os.path.join(os.path.dirname(__file__), '..', 'data', 'sheared')
PER_PS = 1/unit.picosecond
BOLTZ = unit.MOLAR_GAS_CONSTANT_R.value_in_unit(unit.kilojoule_per_mole/unit.kelvin)


def data(name):
    with open(os.path.join(DATA, name), encoding='utf8') as file:
        return json.load(file)


def cubic(edge, tilt=0, axes=(0, 1)):
    box = edge*np.eye(3)
    box[axes[1], axes[0]] = tilt*edge
    return box


def scene(platform, positions, box, rate=1., axes=(0, 1), radii=1, scheme='EulerMaruyama',
          step=0.01, temperature=0, model='StokesianDynamics', viscosity=1, forces=(), seed=7,
          setUp=lambda fluid, integrator: None):
    """A Context of spheres in a sheared fluid: (fluid, integrator, context)."""
    system, fluid = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(temperature, step)
    integrator.setScheme(getattr(CustomRigidHIIntegrator, scheme))
    integrator.setRandomNumberSeed(seed)
    for _, radius in zip(positions, np.broadcast_to(radii, len(positions))):
        integrator.addRigidBody([system.addParticle(100)], 100, (40, 40, 40), [(0, 0, 0)])
        fluid.addParticle(radius)
    fluid.setViscosity(viscosity)
    fluid.setModel(getattr(MobilityForce, model))
    fluid.setBoundary(MobilityForce.Periodic)
    fluid.setShear(rate, *axes)
    setUp(fluid, integrator)
    system.addForce(fluid)
    for force in forces:
        system.addForce(copy.deepcopy(force))
    system.setDefaultPeriodicBoxVectors(*np.asarray(box).tolist())
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platform))
    context.setPositions(positions)
    return fluid, integrator, context


def boxOf(context):
    return np.array(context.getState().getPeriodicBoxVectors(asNumpy=True)._value)


def energyOf(context):
    return context.getState(getEnergy=True).getPotentialEnergy()._value


def repulsion(numParticles, cutoff=2.5, strength=20.):
    """A soft repulsion that ends smoothly at its cutoff."""
    force = openmm.CustomNonbondedForce(f'{strength}*(1 - (r/{cutoff})^2)^3')
    force.setNonbondedMethod(force.CutoffPeriodic)
    force.setCutoffDistance(cutoff)
    for _ in range(numParticles):
        force.addParticle([])
    return force


def gas(number, edge, tilt=0, seed=3, nearest=1.3, axes=(0, 1)):
    """Positions, some of them in other images of the box."""
    random, found = np.random.default_rng(seed), []
    images = np.array(list(itertools.product((-1, 0, 1), repeat=3))) @ cubic(edge, tilt, axes)
    while len(found) < number:
        x = edge*random.random(3)
        if all(np.linalg.norm(x - y + images, axis=1).min() > nearest for y in found):
            found.append(x)
    return np.array(found) + random.integers(-1, 2, (number, 3)) @ cubic(edge, tilt, axes)


# ---- Settings ------------------------------------------------------------------------------------


def test_no_shear_by_default():
    assert MobilityForce().getShear() == (0*PER_PS, 0, 1)


@pytest.mark.parametrize('rate', [0.25, 0.25*PER_PS, 0.25e-3/unit.femtosecond, np.float64(0.25)])
def test_rates_in_any_unit(rate):
    fluid = MobilityForce()
    fluid.setShear(rate, np.int64(1), 2)
    found = fluid.getShear()
    assert found[0].unit == PER_PS.unit and found[0]._value == pytest.approx(0.25, rel=1e-12)
    assert found[1:] == (1, 2)


@pytest.mark.parametrize('isActive', [False, True])
def test_xml_and_copies(isActive):
    fluid = MobilityForce()
    if isActive:
        fluid.setBodySlip(2, [(1, 2, 3)])
    xml = openmm.XmlSerializer.serialize(fluid)
    # Older versions of the library read files without shear.
    assert 'Shear' not in xml and f' version="{2 if isActive else 1}"' in xml
    fluid.setShear(-1/3, 0, 2)
    xml = openmm.XmlSerializer.serialize(fluid)
    assert re.search('type="MobilityForce"[^>]* version="3"', xml)
    for twin in (MobilityForce.cast(openmm.XmlSerializer.deserialize(xml)), copy.copy(fluid),
                 copy.deepcopy(fluid)):
        assert twin.getShear() == (-1/3*PER_PS, 0, 2)
        assert len(twin.getBodiesWithSlip()) == isActive
        assert openmm.XmlSerializer.serialize(twin) == xml
    with pytest.raises(openmm.OpenMMException, match='Shear'):
        openmm.XmlSerializer.deserialize(re.sub(r'<Shear [^>]*/>', '', xml))


@pytest.mark.parametrize(
    'arguments, error, problem',
    [((float('nan'), 0, 1), openmm.OpenMMException,
      r'setShear\(\): the rate is nan/ps; .*: give a finite rate, or 0 for none'),
     ((1, 0, 3), openmm.OpenMMException,
      r'setShear\(\): an axis is 3; the axes of a flow and its gradient are 0, 1 or 2'),
     ((1, -1, 1), openmm.OpenMMException, r'setShear\(\): an axis is -1; the axes'),
     ((1, 1, 0), openmm.OpenMMException,
      'the flow is along axis 1 and its gradient along axis 0.*are lower triangular'),
     ((1, 2, 2), openmm.OpenMMException, 'the flow is along axis 2 and its gradient along axis 2'),
     ((1*unit.nanometer, 0, 1), TypeError, 'setShear: rate: got a quantity in'),
     ((1, 0.0, 1), TypeError, 'setShear: flowAxis: got 0.0; it must be an integer'),
     ((1, 0, '1'), TypeError, "setShear: gradientAxis: got '1'; it must be an integer"),])
def test_shears_that_are_none(arguments, error, problem):
    fluid = MobilityForce()
    with pytest.raises(error, match=problem):
        fluid.setShear(*arguments)
    assert fluid.getShear() == (0*PER_PS, 0, 1)


# ---- The box and the motion of bodies ------------------------------------------------------------


@pytest.mark.parametrize('axes', [(0, 1), (0, 2), (1, 2)])
@pytest.mark.parametrize('rate', [1., -0.7])
@pytest.mark.parametrize('scheme', ['EulerMaruyama', 'FixmanMidpoint', 'TrapezoidalSlip'])
def test_the_box_tilts_with_the_flow(platform, axes, rate, scheme):
    box = np.array([[5, 0, 0], [1, 6, 0], [-2, 0.7, 7]])
    _, integrator, context = scene(platform.getName(), [(1, 2, 3)], box, rate, axes, scheme=scheme,
                                   step=0.05, model='RotnePragerYamakawa')
    flow = np.zeros((3, 3))
    flow[axes] = rate
    flips, before = 0, box
    for steps in range(1, 41):
        integrator.step(1)
        found, moved = boxOf(context), box + 0.05*steps*box @ flow.T
        # The same lattice, in OpenMM's form.
        numbers = found @ np.linalg.inv(moved)
        assert abs(numbers - np.round(numbers)).max() < 1e-12
        assert np.array_equal(found, np.tril(found)) and np.allclose(np.diag(found), np.diag(box))
        assert all(abs(found[k, j]) <= found[j, j]/2 for k in range(3) for j in range(k))
        flips += abs(found - before).max() > 2
        before = found
    assert flips > 0


@pytest.mark.parametrize('platform, scheme',
                         [('Reference', 'FixmanMidpoint'), ('CPU', 'FixmanMidpoint'),
                          ('CPU', 'TrapezoidalSlip'),
                          # The platforms share the boxes of stages.
                          pytest.param('Reference', 'TrapezoidalSlip', marks=pytest.mark.full)])
def test_spheres_go_with_the_flow_through_a_flip(platform, scheme):
    """The positions and stresses of independent computations."""
    case = data('sheared_trajectory.json')
    runs, stresses = [], []
    steps, order = (10, 20, 40), 2
    for number in steps:
        fluid, integrator, context = scene(platform, case['start'], cubic(case['edge']),
                                           case['shearRate'], scheme=scheme, step=0.1/number)
        positions, tilts, stress = [], [], []
        for state in case['states']:
            if state['time'] > 0:
                integrator.step(number)
            positions.append(integrator.getBodyPositions()._value)
            stress.append(fluid.getStressInContext(context).hydrodynamic._value)
            tilts.append(boxOf(context)[1, 0]/case['edge'])
        runs.append(np.array(positions))
        stresses.append(np.array(stress))
    times = np.array([state['time'] for state in case['states']])
    away = abs(times - np.round(times)) < 0.49  # at the flip either tilt is right
    assert np.allclose(np.array(tilts)[away], (times - np.round(times))[away], atol=1e-12)

    def extrapolated(results):
        # The errors are of the orders 2 and 3.
        twice = [(4*fine - coarse)/3 for coarse, fine in zip(results, results[1:])]
        return (8*twice[1] - twice[0])/7

    wanted = np.array([state['positionsUnwrapped'] for state in case['states']])
    assert abs(extrapolated(runs) - wanted).max() < 2e-7
    wanted = np.array([state['particleStress'] for state in case['states']])
    assert abs(extrapolated(stresses) - wanted).max() < 2e-7
    # The scheme has its order here: the boxes of its stages are those of their times.
    errors = [abs(run - runs[-1]).max() for run in runs[:2]]
    assert errors[0]/errors[1] == pytest.approx((4**order - 1)/(2**order - 1), rel=0.2)


def test_a_lattice_has_one_flow_in_both_of_its_boxes(platform):
    """Tilts of a half and of minus a half are one lattice: for the fluid, and for OpenMM."""
    x = gas(12, 5.2, 0.5)
    results = []
    for tilt in (0.5, -0.5):
        fluid, integrator, context = scene(platform.getName(), x, cubic(5.2, tilt), radii=0.6,
                                           viscosity=0.8, forces=[repulsion(12)], step=1e-3)
        forces = context.getState(getForces=True).getForces(asNumpy=True)._value
        friction = fluid.getFrictionInContext(context)
        stress = fluid.getStressInContext(context)
        integrator.step(3)
        results.append((forces, friction, stress.hydrodynamic._value,
                        integrator.getBodyPositions()._value - x, stress.interparticle._value))
    rounding = 1e-11 if platform.getName() == 'Reference' else 1e-5
    for part, (first, second) in enumerate(zip(*results)):
        tolerance = {1: 1e-11, 2: 1e-11, 4: 1e-3 if rounding > 1e-6 else 1e-8}.get(part, rounding)
        assert np.allclose(first, second, rtol=0, atol=tolerance*abs(first).max())


@pytest.mark.parametrize('areHeld', [False, True])
def test_forces_are_those_of_the_tilted_box(platform, areHeld):
    """OpenMM's CPU platform keeps neighbours until particles have moved, whatever the box does."""
    number, edge = 30, 7.
    x = gas(number, edge)
    forces = [repulsion(number, cutoff=2)]

    def hold(fluid, integrator):
        for body in range(number - 1 if areHeld else 0):
            integrator.setBodyHeld(body, True)

    _, integrator, context = scene(platform.getName(), x, cubic(edge), radii=0.3, viscosity=50,
                                   model='RotnePragerYamakawa', forces=forces, step=0.02,
                                   setUp=hold)
    system = openmm.System()
    for _ in range(number):
        system.addParticle(1)
    system.addForce(copy.deepcopy(forces[0]))
    system.setDefaultPeriodicBoxVectors(*cubic(edge).tolist())
    fresh = openmm.Context(system, openmm.VerletIntegrator(1),
                           openmm.Platform.getPlatformByName('Reference'))
    energies, flips, tilt = [], 0, 0
    for steps in range(60):
        integrator.step(1)
        state = context.getState(getPositions=True, getEnergy=True, getForces=True)
        box = boxOf(context)
        fresh.setPeriodicBoxVectors(*box.tolist())
        fresh.setPositions(state.getPositions())
        wanted = fresh.getState(getForces=True).getForces(asNumpy=True)._value
        found = state.getForces(asNumpy=True)._value
        assert abs(found - wanted).max() < 1e-5*abs(wanted).max(), steps
        energies.append(state.getPotentialEnergy()._value)
        flips += abs(box[1, 0] - tilt) > edge/2
        tilt = box[1, 0]
    assert flips == 1
    # The energy goes on through the flip as it does elsewhere.
    jumps = abs(np.diff(energies, 2))
    assert jumps[21:26].max() < 3*np.median(jumps) + 1e-6*abs(energies[0])


def test_blobs_of_rigid_bodies_are_carried(platform):
    """A multiblob turns in shear as in an unbounded fluid, if it is small against the box."""
    sites = [(-0.3, 0, 0), (0.3, 0, 0), (0, 0.25, 0), (0, 0, 0.2)]
    moved = []
    for boundary in ('Periodic', 'Unbounded'):
        system, fluid = openmm.System(), MobilityForce()
        integrator = CustomRigidHIIntegrator(0, 0.05)
        integrator.setScheme(integrator.FixmanMidpoint)
        for _ in sites:
            system.addParticle(10)
            fluid.addParticle(0.15)
        integrator.addRigidBody([0, 1, 2, 3], 40, (1, 1, 1), sites)
        app.bindBodies(system, integrator)
        fluid.setBoundary(getattr(fluid, boundary))
        if boundary == 'Periodic':
            fluid.setShear(0.8, 0, 1)
        else:
            fluid.setBackgroundFlow((0, 0, 0), [[0, 0.8, 0], [0, 0, 0], [0, 0, 0]])
        system.addForce(fluid)
        system.setDefaultPeriodicBoxVectors((40, 0, 0), (0, 40, 0), (0, 0, 40))
        context = openmm.Context(system, integrator, platform)
        context.setPositions(np.array(sites) + (1, 2, 3))
        integrator.step(20)
        moved.append((integrator.getBodyPositions()._value, integrator.getBodyOrientations()))
    assert np.allclose(moved[0][0], moved[1][0], atol=1e-4)
    assert np.allclose(moved[0][1], moved[1][1], atol=1e-4)


# ---- What goes on, and what is saved -------------------------------------------------------------

# Three spheres nearly touch, so that lubrication redoes steps.
CLUSTER = np.array([(1, 1, 1), (2.01, 1, 1), (1, 2.02, 1), (1.2, 1.5, 3.5), (4, 3, 1.4),
                    (3.5, 4.2, 3)])


def wells():
    """A force in double precision on all platforms: lists of neighbours have a history on CPU."""
    force = openmm.CustomExternalForce('4*(sin(2*x) + cos(3*y + 1)*sin(z))')
    for particle in range(len(CLUSTER)):
        force.addParticle(particle)
    return force


def saving(context, way):
    if way == 'checkpoint':
        return context.createCheckpoint()
    return openmm.XmlSerializer.serialize(
        context.getState(getPositions=True, getVelocities=True, getParameters=True,
                         getIntegratorParameters=True))


def loading(context, way, saved):
    if way == 'checkpoint':
        context.loadCheckpoint(saved)
    else:
        context.setState(openmm.XmlSerializer.deserialize(saved))


@pytest.mark.parametrize('scheme, model, solver, lubrication', [
    *[(scheme, *fluid) for scheme in ('TractionEulerMaruyama', 'FixmanMidpoint')
      for fluid in (('RotnePragerYamakawa', 'Dense', 'Off'),
                    ('RotnePragerYamakawa', 'MatrixFree', 'Off'),
                    ('RotnePragerYamakawa', 'Dense', 'On'),
                    ('RotnePragerYamakawa', 'MatrixFree', 'On'),
                    ('ForceCoupling', 'MatrixFree', 'Off'), ('ForceCoupling', 'MatrixFree', 'On'),
                    ('StokesianDynamics', 'Dense', 'On'),
                    ('StokesianDynamics', 'MatrixFree', 'On'))],
    ('TrapezoidalSlip', 'RotnePragerYamakawa', 'Dense', 'Off'),
    ('TrapezoidalSlip', 'StokesianDynamics', 'MatrixFree', 'On'),
    ('RandomFiniteDifference', 'RotnePragerYamakawa', 'MatrixFree', 'On'),
    ('DriftCorrectorFD', 'RotnePragerYamakawa', 'MatrixFree', 'Off'),
    ('DriftCorrectorRFD', 'StokesianDynamics', 'Dense', 'On'),
])
def test_a_run_resumes_in_the_middle_of_a_period(platform, scheme, model, solver, lubrication):
    """Before a flip and after it, in a Context that had other positions and another tilt."""
    name, edge = platform.getName(), 5.

    def setUp(fluid, integrator):
        fluid.setSolver(getattr(fluid, solver))
        fluid.setSolverTolerance(1e-2 if model == 'ForceCoupling' else 1e-3)
        fluid.setLubrication(getattr(fluid, lubrication))
        integrator.setMaximumRejections(1000)

    def start(tilt):
        forces = [wells()] + [repulsion(len(CLUSTER))]*(name == 'Reference')
        return scene(name, CLUSTER, cubic(edge, tilt), radii=0.5, scheme=scheme, step=0.01,
                     temperature=300, viscosity=3, forces=forces, model=model, setUp=setUp)

    def found(fluid, integrator, context):
        stress = fluid.getStressInContext(context)
        return [
            integrator.getBodyPositions()._value,
            integrator.getBodyOrientations(),
            boxOf(context),
            *(part._value for part in (stress.hydrodynamic, stress.brownian, stress.interparticle))
        ]

    def flow(fluid, integrator, context):
        if model == 'StokesianDynamics' and solver == 'MatrixFree':  # refused with noise
            return None
        return fluid.getFlowInContext(context, [(2, 4, 4.5)])._value

    whole = start(0.45)
    saved = []
    for steps, tilt in ((3, 0.48), (4, -0.48)):
        whole[1].step(steps)
        assert boxOf(whole[2])[1, 0] == pytest.approx(tilt*edge, abs=1e-12)
        saved.append({way: saving(whole[2], way) for way in ('checkpoint', 'state')})
        saved[-1]['flow'] = flow(*whole)
    whole[1].step(4)
    wanted = found(*whole)
    if scheme == 'TractionEulerMaruyama' and lubrication == 'On':
        assert whole[1].getNumRejectedSteps() > 0
    for way in ('checkpoint', 'state'):
        other = start(0.1)
        other[1].step(2)
        for place, steps in ((1, 4), (0, 8)):
            loading(other[2], way, saved[place][way])
            assert np.array_equal(flow(*other), saved[place]['flow'])
            other[1].step(steps)
            for one, twin in zip(wanted, found(*other)):
                assert np.array_equal(one, twin)


SCHEMES = ('EulerMaruyama', 'FixmanMidpoint', 'TrapezoidalSlip', 'TractionEulerMaruyama',
           'RandomFiniteDifference', 'DriftCorrectorFD', 'DriftCorrectorRFD')


def moveOfTrimers(platform, scheme, images, solver, model='RotnePragerYamakawa', tilt=0.2,
                  step=1e-3):
    """The moves of eight rigid trimers in a step with noise, beside the flow, (8, 3, 3) nm. They
    in up to `images` times three images of the box along y."""
    edge, sites = 8., np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)])
    x = np.array(list(itertools.product((0.3, 4.3), repeat=3)))
    box = cubic(edge, tilt)
    x += np.outer(np.arange(8) % 4*images, box[1])
    system, fluid = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(300, step)
    integrator.setScheme(getattr(CustomRigidHIIntegrator, scheme))
    integrator.setRandomNumberSeed(3)
    for _ in x:
        app.addRigidMultiblob(system, integrator, fluid, sites, 0.5)
    fluid.setModel(getattr(MobilityForce, model))
    fluid.setBoundary(MobilityForce.Periodic)
    fluid.setSolver(getattr(MobilityForce, solver))
    fluid.setSolverTolerance(1e-4)
    fluid.setShear(1, 0, 1)
    push = repulsion(len(sites)*len(x), cutoff=3.9)
    for body in range(len(x)):
        for i, j in itertools.combinations(range(3), 2):
            push.addExclusion(3*body + i, 3*body + j)
    app.bindBodies(system, integrator)
    system.addForce(fluid)
    system.addForce(push)
    system.setDefaultPeriodicBoxVectors(*box.tolist())
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platform))
    start = x[:, None] + sites
    context.setPositions(start.reshape(-1, 3))
    integrator.step(1)
    moves = context.getState(getPositions=True).getPositions(asNumpy=True)._value.reshape(
        start.shape) - start
    moves[..., 0] -= step*x[:, None, 1]
    return moves


@pytest.mark.parametrize('scheme', SCHEMES)
@pytest.mark.parametrize('solver', ['Dense', 'MatrixFree'])
def test_a_step_does_not_know_the_image_of_a_body(platform, scheme, solver):
    """The box tilts during a step, so that bodies of distant images must go with the flow in all of
    its stages."""
    here, away = (moveOfTrimers(platform.getName(), scheme, images, solver) for images in (0, 25))
    # Forces of the CPU platform are in single precision, and so are places 600 nm away.
    rounding = 1e-9 if platform.getName() == 'Reference' else 1e-5
    assert np.abs(away - here).max() < max(rounding, 1e-5*(solver == 'MatrixFree'))
    assert np.abs(here).max() > 1e-3


@pytest.mark.parametrize('scheme', SCHEMES)
@pytest.mark.parametrize('model', ['RotnePragerYamakawa', 'ForceCoupling'])
def test_noise_on_a_grid_goes_on_through_a_flip(platform, scheme, model):
    """A box that flips during a step has the noise of one that does not, and an upright one, whose
    grid is another one, that of a box that leans a little."""
    for tilts in ((0.4999, 0.4989), (0, 1e-4)):
        one, other = (moveOfTrimers(platform.getName(), scheme, 2, 'MatrixFree', model, tilt)
                      for tilt in tilts)
        assert np.abs(one - other).max() < 0.05*np.abs(one).max()


def test_threads_and_seeds_change_nothing_else():
    results = []
    for threads in (1, 2):
        _, integrator, _ = scene('CPU', gas(8, 5), cubic(5), radii=0.5, temperature=5,
                                 scheme='TractionEulerMaruyama', viscosity=3,
                                 setUp=lambda fluid, own: own.setNumHostThreads(threads))
        integrator.step(5)
        results.append(integrator.getBodyPositions()._value)
    assert np.array_equal(*results)


def test_a_new_rate_goes_on_from_the_present_tilt(platform):
    fluid, integrator, context = scene(platform.getName(), [(1, 2, 3)], cubic(5), rate=0.5,
                                       step=0.1)
    integrator.step(2)
    fluid.setShear(-1, 0, 1)
    fluid.updateParametersInContext(context)
    assert boxOf(context)[1, 0] == pytest.approx(0.5, abs=1e-12)
    integrator.step(1)
    assert boxOf(context)[1, 0] == pytest.approx(0, abs=1e-12)
    fluid.setShear(0, 0, 1)
    fluid.updateParametersInContext(context)
    x = integrator.getBodyPositions()._value
    integrator.step(3)
    assert np.array_equal(integrator.getBodyPositions()._value, x)


def test_a_step_that_fails_leaves_the_box(platform):
    force = openmm.CustomExternalForce('sqrt(1.5 - x)*1e-6')  # not finite beyond x = 1.5
    force.addParticle(0)
    _, integrator, context = scene(platform.getName(), [(1, 2, 3)], cubic(9), rate=2, step=0.05,
                                   scheme='TrapezoidalSlip', forces=[force])
    for _ in range(10):
        x, box = integrator.getBodyPositions()._value, boxOf(context)
        try:
            integrator.step(1)
        except openmm.OpenMMException:
            break
    else:
        pytest.fail('no step failed')
    assert np.array_equal(integrator.getBodyPositions()._value, x)
    assert np.array_equal(boxOf(context), box)


def test_rejected_steps_are_redone_in_the_box_of_their_start(platform):
    """Spheres that touch are led to overlaps; the tilt does not depend on attempts."""
    x = np.array([(1, 1, 1), (2.02, 1, 1), (1, 2.03, 1), (1, 1, 2.02)])
    _, integrator, context = scene(platform.getName(), x, cubic(5), radii=0.5, temperature=300,
                                   viscosity=3, scheme='FixmanMidpoint', step=2e-2, rate=1)
    integrator.setMaximumRejections(1000)
    integrator.step(10)
    assert integrator.getNumRejectedSteps() > 0
    assert boxOf(context)[1, 0] == pytest.approx(1, abs=1e-12)


def test_the_flow_is_that_of_present_forces(platform):
    fluid, integrator, context = scene(platform.getName(), [(1, 2, 3)], cubic(60), rate=0.5,
                                       step=0.01, radii=0.5, model='RotnePragerYamakawa')
    integrator.step(3)
    points = np.array([(20, 10, 5), (3, -7, 40)])
    assert np.allclose(
        fluid.getFlowInContext(context, points)._value, np.outer(0.5*points[:, 1], (1, 0, 0)),
        atol=1e-12)
    effects = integrator.getEffects()['driven flow']
    assert 'shear of the rate 0.5/ps along x with its gradient along y' in effects
    assert 'PME' in effects


@pytest.mark.parametrize('axes', [(0, 1), (1, 2)])
def test_displacements_beside_the_flow(axes):
    """Noise alone moves bodies without images: then x - integral of the flow diffuses freely."""
    step, steps, rate = 0.05, 190, 0.8
    moved = []
    for present in (rate, 0):
        _, integrator, context = scene('Reference', [(1, 2, 3)], cubic(30), present, axes,
                                       temperature=300, step=step, model='RotnePragerYamakawa',
                                       viscosity=20)
        frames = [integrator.getBodyPositions()]
        for _ in range(steps):
            integrator.step(1)
            frames.append(integrator.getBodyPositions())
        frames = np.array([frame._value for frame in frames])
        assert (abs(boxOf(context)[axes[1], axes[0]]) > 1) == (present > 0)
        moved.append(
            analysis.nonAffinePositions(frames*unit.nanometer, step*unit.picosecond,
                                        present/unit.picosecond, *axes))
    assert moved[0].unit == unit.nanometer
    # The noise is the same, but for the forces by which images in tilted boxes differ.
    noise = moved[1]._value - moved[1]._value[0]
    assert abs(noise).max() > 0.3
    beside = moved[0]._value - moved[0]._value[0]
    # Euler's scheme has the flow of the start of a step: half a step of y late.
    late = np.zeros(3)
    late[axes[0]] = 1
    late = late*(rate*step/2*noise[:, :, axes[1]])[:, :, None]
    assert np.allclose(beside + late, noise, atol=2e-3*abs(noise).max())


@pytest.mark.parametrize(
    'axes, error, problem',
    [((0, 0), ValueError, 'flowAxis, gradientAxis: got 0 and 0; the axes of a shear are two of'),
     ((0, 3), ValueError, 'got 0 and 3; the axes of a shear are two of'),
     ((0, 1.), TypeError, 'nonAffinePositions: gradientAxis: got 1.0; it must be an integer'),])
def test_positions_without_a_shear_that_is_none(axes, error, problem):
    with pytest.raises(error, match=problem):
        analysis.nonAffinePositions(np.zeros((2, 1, 3)), 1, 1, *axes)


# ---- What is refused -----------------------------------------------------------------------------


def boundary(name):
    def setUp(fluid, integrator):
        fluid.setChannelWalls(0, 5)
        fluid.setBoundary(getattr(fluid, name))

    return setUp


@pytest.mark.parametrize('options, problem', [
    (dict(setUp=boundary('Unbounded'), model='RotnePragerYamakawa'),
     r'tilts a periodic box, and the boundary is Unbounded; use setBackgroundFlow\(\)'),
    (dict(setUp=boundary('NoSlipChannel'), model='RotnePragerYamakawa'),
     r'tilts a periodic box, and the boundary is NoSlipChannel.*; use setWallVelocity\(\)'),
    (dict(model='FreeDraining'), 'moves one fluid around all bodies, which the model FreeDraining'),
    (dict(setUp=lambda fluid, _: fluid.setSinusoidalForceDensity(1, 0, 1, 1)),
     'cannot be used together with a sinusoidal force density'),
    (dict(scheme='LangevinHI', model='RotnePragerYamakawa'),
     '/ps needs a scheme without momenta, and the scheme is LangevinHI; use setScheme'),
    (dict(temperature=300, forces=[openmm.MonteCarloBarostat(
        1, 300)]), 'has a MonteCarloBarostat, which is supported with the schemes LangevinA, '),
])
def test_shear_that_is_refused(options, problem):
    with pytest.raises(openmm.OpenMMException, match=problem):
        scene('Reference', [(1, 2, 3)], cubic(9), **options)


def onGrid(tolerance):
    def setUp(fluid, _):
        fluid.setSolver(fluid.MatrixFree)
        fluid.setSolverTolerance(tolerance)

    return setUp


@pytest.mark.parametrize('axes', [(0, 1), (0, 2), (1, 2)])
@pytest.mark.parametrize('model, lubrication', [('RotnePragerYamakawa', False),
                                                ('RotnePragerYamakawa', True),
                                                ('ForceCoupling', True),
                                                ('StokesianDynamics', True)])
def test_a_grid_takes_the_steps_of_matrices(platform, axes, model, lubrication):
    """Through a flip of the box, and with one grid for all its tilts."""
    x = gas(8, 6, 0.46, seed=5, nearest=2.1, axes=axes)
    places, stresses = [], []
    for way in ('Dense', 'MatrixFree'):

        def setUp(fluid, integrator):
            if lubrication:
                fluid.setLubricationReach(3, 4)
            if lubrication and model != 'StokesianDynamics':
                fluid.setLubrication(fluid.On)
            if way == 'MatrixFree':
                onGrid(1e-7)(fluid, integrator)

        fluid, integrator, context = scene(platform.getName(), x, cubic(6, 0.46, axes), axes=axes,
                                           model=model, radii=[1, 0.7]*4, scheme='FixmanMidpoint',
                                           setUp=setUp, forces=[repulsion(8)])
        described = []
        for _ in range(8):
            integrator.step(1)
            described.append(integrator.getEffects()['hydrodynamics'])
        grids = {re.search(r'a grid of [\d x]+ nodes|dense', text).group() for text in described}
        assert len(grids) == 1 and ('dense' in grids) == (way == 'Dense')
        assert boxOf(context)[axes[1], axes[0]] < 0
        places.append(context.getState(getPositions=True).getPositions(asNumpy=True)._value)
        stresses.append(fluid.getStressInContext(context))
    assert np.abs(places[0] - places[1]).max() < 1e-6
    for part in ('interparticle', 'hydrodynamic'):
        if part == 'interparticle' or model == 'StokesianDynamics':  # single spheres of the others
            dense, free = (np.array(getattr(stress, part)._value) for stress in stresses)
            assert np.abs(free - dense).max() < 1e-5*np.abs(dense).max()


def test_a_scheme_with_momenta_is_refused_between_steps(platform):
    _, integrator, context = scene(platform.getName(), [(1, 2, 3)], cubic(9),
                                   model='RotnePragerYamakawa')
    integrator.step(1)
    box = boxOf(context)
    integrator.setScheme(integrator.LangevinHI)
    with pytest.raises(openmm.OpenMMException, match='needs a scheme without momenta'):
        integrator.step(1)
    assert np.array_equal(boxOf(context), box)


def test_steps_that_strain_too_much_are_refused(platform):
    _, integrator, context = scene(platform.getName(), [(1, 2, 3)], cubic(9), rate=-2, step=0.051)
    with pytest.raises(openmm.OpenMMException,
                       match='a step of 0.051 ps strains the fluid by 0.102 .* at most 0.1'):
        integrator.step(1)
    assert boxOf(context)[1, 0] == 0
    integrator.setStepSize(0.05)
    integrator.step(1)


def test_a_box_that_others_set_is_refused(platform):
    _, integrator, context = scene(platform.getName(), [(1, 2, 3)], cubic(9))
    context.setPeriodicBoxVectors(*cubic(8, 0.1).tolist())  # before the first step
    integrator.step(3)
    box = boxOf(context)
    assert box[1, 0] == pytest.approx(8*0.13)
    context.setPeriodicBoxVectors(*cubic(8).tolist())
    energyOf(context)  # which looks at the box too
    for _ in range(2):
        with pytest.raises(openmm.OpenMMException,
                           match='although no positions were set since; the box tilts'):
            integrator.step(1)
    context.setPeriodicBoxVectors(*box.tolist())
    integrator.step(1)
    context.setPeriodicBoxVectors(*cubic(7).tolist())
    context.setPositions([(1, 2, 3)])
    integrator.step(1)
    assert boxOf(context)[1, 0] == pytest.approx(0.07)


# ---- Stress --------------------------------------------------------------------------------------


@pytest.mark.parametrize('case', data('periodic_sheared.json'), ids=lambda case: case['name'])
def test_the_viscosity_of_a_suspension(platform, case):
    """The values of independent computations, to their ten digits."""
    fluid, _, context = scene(platform.getName(), case['positions'], case['box'],
                              radii=case['radii'])
    stress = fluid.getStressInContext(context)
    assert stress.hydrodynamic.unit == unit.kilojoule_per_mole/unit.nanometer**3
    assert np.allclose(stress.hydrodynamic._value, case['particleStressInShear'], atol=1e-8)
    assert 1 + stress.hydrodynamic._value[0, 1] == pytest.approx(case['relativeViscosity'],
                                                                 rel=1e-8)
    for part in (stress.brownian, stress.interparticle, stress.ideal):
        assert not part._value.any()


@pytest.mark.parametrize('axes', [(0, 1), (0, 2), (1, 2)])
def test_a_dilute_suspension_has_einsteins_viscosity(axes):
    edge = 40.
    fraction = 4*np.pi/3/edge**3
    fluid, _, context = scene('Reference', [(1, 2, 3)], cubic(edge), 0.3, axes, viscosity=1.7)
    stress = fluid.getStressInContext(context).hydrodynamic._value
    wanted = np.zeros((3, 3))
    wanted[axes] = wanted[axes[::-1]] = 1.7*0.3*2.5*fraction
    assert np.allclose(stress, wanted, rtol=3*fraction, atol=1e-12)


def test_a_multiblob_has_stress_by_its_blobs():
    """A shell of blobs resists strain about as the sphere that it stands for."""
    sites, radius = app.multiblobSphere(42, 1.0)
    sites = getattr(sites, '_value', sites)
    radius = getattr(radius, '_value', radius)
    system, fluid, edge = openmm.System(), MobilityForce(), 30.
    integrator = CustomRigidHIIntegrator(0, 0.01)
    integrator.setScheme(integrator.EulerMaruyama)
    for _ in sites:
        system.addParticle(1)
        fluid.addParticle(radius)
    integrator.addRigidBody(range(len(sites)), len(sites), (10, 10, 10), sites)
    app.bindBodies(system, integrator)
    fluid.setBoundary(fluid.Periodic)
    fluid.setViscosity(1)
    fluid.setSolver(fluid.Dense)
    fluid.setShear(1, 0, 1)
    system.addForce(fluid)
    system.setDefaultPeriodicBoxVectors(*cubic(edge).tolist())
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions(np.asarray(sites) + 3)
    stress = fluid.getStressInContext(context).hydrodynamic._value
    assert stress[0, 1] == pytest.approx(2.5*4*np.pi/3/edge**3, rel=0.1)
    assert abs(stress - stress.T).max() < 1e-15 and abs(np.trace(stress)) < 1e-15


@pytest.mark.parametrize('model, warns', [('RotnePragerYamakawa', True), ('ForceCoupling', True),
                                          ('StokesianDynamics', False)])
def test_the_stress_of_spheres_without_stresslets_is_doubted(model, warns):
    fluid, _, context = scene('Reference', gas(8, 9., nearest=2.2), cubic(9.), model=model)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        stress = fluid.getStressInContext(context)
    assert np.any(stress.hydrodynamic._value) != warns
    assert [('no body resists the strain' in str(each.message)) for each in caught] == [True]*warns


def test_interparticle_stress_is_the_virial_of_nearest_images(platform):
    """Particles without stresslets, in other images of their box; and they are where they were."""
    number, edge = 20, 6.
    x, box = gas(number, edge), cubic(edge, 0.3)
    fluid, integrator, context = scene(platform.getName(), x, box, radii=0.3, temperature=50,
                                       model='RotnePragerYamakawa', forces=[repulsion(number)])
    before, places = energyOf(context), integrator.getBodyPositions()._value
    stress = fluid.getStressInContext(context)
    assert energyOf(context) == pytest.approx(before, rel=1e-7) and np.array_equal(
        boxOf(context), box)
    assert np.array_equal(integrator.getBodyPositions()._value, places)
    wanted = np.zeros((3, 3))
    for i, j in itertools.combinations(range(number), 2):
        for image in itertools.product((-1, 0, 1), repeat=3):
            d = (x[i] - x[j]) @ np.linalg.inv(box)
            r = (d - np.round(d) + image) @ box
            if r @ r < 2.5**2:
                wanted += np.outer(r, r)*20*3*(1 - r @ r/2.5**2)**2*2/2.5**2
    wanted *= -1/edge**3
    tolerance = 1e-8 if platform.getName() == 'Reference' else 2e-4
    assert np.allclose(stress.interparticle._value, wanted, atol=tolerance*abs(wanted).max())
    assert np.allclose(stress.ideal._value, -number/edge**3*BOLTZ*50*np.eye(3), rtol=1e-12)
    assert not stress.hydrodynamic._value.any() and not stress.brownian._value.any()


def test_stress_does_not_change_a_run():
    x = gas(5, 5)
    results = []
    for asks in (False, True):
        fluid, integrator, context = scene('Reference', x, cubic(5), radii=0.5, temperature=5,
                                           viscosity=3, scheme='TractionEulerMaruyama',
                                           forces=[repulsion(5)])
        for _ in range(4):
            integrator.step(1)
            if asks:
                fluid.getStressInContext(context)
        results.append(integrator.getBodyPositions()._value)
    assert np.array_equal(*results)


def test_brownian_stress_is_a_divergence():
    """The mean of samples is kT div(R N), whose entries are stresslets of single forces."""
    x, edge, kT = np.array([(1., 2, 3), (3.2, 2.6, 2.7)]), 7., BOLTZ*100
    volume = edge**3
    pull = openmm.CustomExternalForce('-(fx*x + fy*y + fz*z)')
    for name in ('fx', 'fy', 'fz'):
        pull.addPerParticleParameter(name)
    for p in range(2):
        pull.addParticle(p, (0, 0, 0))
    fluid, integrator, context = scene('Reference', x, cubic(edge), rate=0.1, forces=[pull],
                                       temperature=0)
    force = context.getSystem().getForce(1)

    def stresslets(sphere, axis, positions):
        """S of a unit force on a sphere."""
        F = np.zeros((2, 3))
        F[sphere, axis] = 1
        for p in range(2):
            force.setParticleParameters(p, p, F[p])
        force.updateParametersInContext(context)
        context.setPositions(positions)
        stress = fluid.getStressInContext(context).interparticle._value
        virial = np.triu(F.T @ positions)
        return -volume*stress - (virial + np.triu(virial, 1).T)

    delta, divergence = 1e-3, np.zeros((3, 3))
    for sphere in range(2):
        for axis in range(3):
            moved = np.zeros((2, 3))
            moved[sphere, axis] = delta
            divergence += (stresslets(sphere, axis, x + moved) -
                           stresslets(sphere, axis, x - moved))/(2*delta)
    wanted = -kT*divergence/volume
    samples = []
    for seed in range(1, 401):
        fluid, integrator, context = scene('Reference', x, cubic(edge), rate=0.1, temperature=100,
                                           seed=seed, scheme='RandomFiniteDifference')
        samples.append(fluid.getStressInContext(context).brownian._value)
    mean = np.mean(samples, axis=0)
    error = np.std(samples, axis=0)/np.sqrt(len(samples))
    assert (abs(mean - wanted) < 4.5*error).all()
    assert abs(wanted).max() > 5*error.max()  # the test could fail


@pytest.mark.parametrize(
    'options, problem',
    [(dict(rate=0, setUp=boundary('Unbounded')), 'the fluid has the boundary Unbounded'),
     (dict(rate=0, model='FreeDraining'), 'and the model FreeDraining; ask with'),
     (dict(setUp=lambda fluid, _: fluid.setGroups([0, 1])), 'the Context has 2 groups of bodies'),
     (dict(setUp=lambda _, integrator: integrator.setBodyHeld(0, True)),
      'bodies are held, driven or joined'),
     (dict(rate=0, scheme='LangevinHI'),
      r'is for schemes without momenta, where no body has inertia, and the scheme is LangevinHI'),
     (dict(forces=[CustomBodyForce('1', '0', '0', '0', '0', '0')]),
      'does not know the stress of a CustomBodyForce'),])
def test_stress_that_is_refused(options, problem):
    options = {'model': 'RotnePragerYamakawa', **options}
    for force in options.get('forces', ()):
        force.addBody(0, [])
    fluid, _, context = scene('Reference', [(1, 2, 3), (4, 5, 6)], cubic(9), **options)
    with pytest.raises(openmm.OpenMMException, match=problem):
        fluid.getStressInContext(context)


@pytest.mark.parametrize('stiffness', [0.0, 1.0])
def test_the_stress_beside_a_trap_is_doubted_once(stiffness):
    """A force of zero has no virial."""
    trap = openmm.CustomExternalForce('k*x^2')
    trap.addGlobalParameter('k', stiffness)
    trap.addParticle(0, [])
    fluid, integrator, context = scene('Reference', gas(4, 6), cubic(6), radii=0.6, forces=[trap])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        for _ in range(2):
            fluid.getStressInContext(context)
    doubts = [each for each in caught if 'depends on absolute positions' in str(each.message)]
    assert len(doubts) == (stiffness > 0)
