"""Reading the flow in Python: units and shapes, refused input, closed forms, and saved states."""
import re

import numpy as np
import openmm
import pytest
from openmm import unit
from test_flows import ETA, VELOCITY, spheres

from openmmrigidhi import CustomBodyForce, CustomRigidHIIntegrator, MobilityForce, app

FORCE = np.array([1.0, -2.0, 0.5])


def pushed(platform, positions, radii, setUp=lambda fluid: None, force=FORCE, **settings):
    """The scene of spheres(), with a force on the first sphere."""
    def alsoPush(fluid):
        setUp(fluid)
        pushed.push = CustomBodyForce(*(repr(float(f)) for f in force), '0', '0', '0')
        pushed.push.addBody(0, [])

    fluid, integrator, context = spheres(platform, positions, radii, alsoPush, **settings)
    context.getSystem().addForce(pushed.push)
    context.reinitialize()
    context.setPositions(positions)
    return fluid, integrator, context


def stokeslet(x, radius):
    r = np.linalg.norm(x, axis=1)[:, None]
    n, c = x/r, (radius/r)**2
    return ((1 + c/3)*FORCE + (1 - c)*n*(n @ FORCE)[:, None])/(8*np.pi*ETA*r)


# ---- Units and shapes ----------------------------------------------------------------------------


@pytest.mark.parametrize('inUnits', [
    lambda x: x, lambda x: x.tolist(), lambda x: x*unit.nanometer, lambda x: 10*x*unit.angstrom,
    lambda x: [openmm.Vec3(*row) for row in x]*unit.nanometer
])
def test_points_in_any_unit(platform, inUnits):
    centre = np.array((1.0, 2, 3))
    fluid, _, context = pushed(platform.getName(), [centre], [0.8])
    points = centre + [(2, 0, 0), (-1, 1, 0.5), (0, 0, 30)]
    flow = fluid.getFlowInContext(context, inUnits(points))
    assert flow.unit == VELOCITY and flow._value.shape == (3, 3)
    assert np.allclose(flow._value, stokeslet(points - centre, 0.8), rtol=1e-12, atol=0)


def test_no_points_have_no_flow(platform):
    fluid, _, context = pushed(platform.getName(), [(1, 2, 3)], [0.8])
    assert fluid.getFlowInContext(context, np.zeros((0, 3)))._value.shape == (0, 3)


def test_modes_are_two_velocities(platform):
    x = np.array((1.0, 2, 3))
    fluid, integrator, context = pushed(platform.getName(), [x], [0.8],
                                        boundary=MobilityForce.Periodic)
    k, radius = 2*np.pi*2/8, 0.8
    mode = fluid.getFlowModeInContext(context, 0, 1, np.int64(2))
    assert mode.unit == VELOCITY and mode._value.shape == (2,)
    # The amplitude is that of a force spread over the sphere: 2/(eta k^2 V) times its power on the
    # wave.
    expected = 2/(ETA*k**2*9*8*10)*FORCE[0]*np.sin(k*radius)/(k*radius)*np.array(
        (np.sin(k*x[1]), np.cos(k*x[1])))
    assert np.allclose(mode._value, expected, rtol=1e-12, atol=0)
    noise = fluid.getRandomFlowModeInContext(context, 0, 1, 2)
    assert noise.unit == VELOCITY and np.array_equal(noise._value, (0, 0))


def test_a_wave_is_its_own_mode(platform):
    fluid, integrator, context = spheres(
        platform.getName(), [(1, 2, 3)], [0.8],
        lambda fluid: fluid.setSinusoidalForceDensity(0.6, 2, 0, 3),
        boundary=MobilityForce.Periodic)
    k = 2*np.pi*3/9
    for _ in range(2):  # before a step and after it
        assert np.allclose(
            fluid.getFlowModeInContext(context, 2, 0, 3)._value, (0.6/(ETA*k**2), 0), rtol=1e-12,
            atol=1e-15)
        assert np.allclose(fluid.getFlowModeInContext(context, 2, 0, 2)._value, 0, atol=1e-15)
        assert np.allclose(fluid.getFlowModeInContext(context, 1, 0, 3)._value, 0, atol=1e-15)
        assert np.allclose(
            fluid.getFlowInContext(context, [(0.75, 5, 5)])._value,
            [(0, 0, 0.6/(ETA*k**2)*np.sin(0.75*k))], rtol=1e-12, atol=1e-15)
        integrator.step(1)


def test_random_modes_of_a_grid(platform):
    def onAGrid(fluid):
        fluid.setSolver(fluid.MatrixFree)

    fluid, integrator, context = spheres(platform.getName(), [(1, 2, 3)], [1], onAGrid,
                                         MobilityForce.ForceCoupling, MobilityForce.Periodic,
                                         temperature=300, step=0.01)
    assert np.array_equal(fluid.getRandomFlowModeInContext(context, 0, 1, 1)._value,
                          (0, 0))  # no step, no noise
    integrator.step(1)
    noise = fluid.getRandomFlowModeInContext(context, 0, 1, 1)._value
    # A sphere without forces adds nothing to the amplitude.
    assert noise.all() and np.allclose(
        fluid.getFlowModeInContext(context, 0, 1, 1)._value, noise, rtol=1e-12, atol=0)


def test_the_last_step_is_answered(platform):
    """The flow within a sphere without neighbours is the velocity with which the sphere moved, also
    after loading a State.
    """
    fluid, integrator, context = spheres(platform.getName(), [(1, 2, 3)], [0.8], lambda fluid: None,
                                         temperature=300, step=0.01)
    assert not fluid.getFlowInContext(context, [(1, 2, 3)])._value.any()
    integrator.step(1)
    velocity = (integrator.getBodyPositions()._value[0] - (1, 2, 3))/0.01
    assert np.linalg.norm(velocity) > 1
    flow = fluid.getFlowInContext(context, [(1, 2, 3), (1.1, 2.2, 2.7), (0.9, 1.8, 3.3)])._value
    assert np.allclose([flow[0], (flow[1] + flow[2])/2], [velocity, velocity], rtol=1e-9,
                       atol=1e-9)  # and it turns
    files = [
        openmm.XmlSerializer.serialize(thing)
        for thing in (context.getSystem(), integrator,
                      context.getState(getPositions=True, getVelocities=True, getParameters=True,
                                       getIntegratorParameters=True))
    ]
    system, twin, state = (openmm.XmlSerializer.deserialize(file) for file in files)
    twin = CustomRigidHIIntegrator.cast(twin)
    other = openmm.Context(system, twin, platform)
    other.setState(state)
    itsFluid = MobilityForce.cast(system.getForce(0))
    assert np.array_equal(
        itsFluid.getFlowInContext(other, [(1, 2, 3), (1.1, 2.2, 2.7), (0.9, 1.8, 3.3)])._value,
        flow)
    # Files of earlier versions have no last step.
    older = re.sub(r'<LastStep.*</LastStep>', '', files[2], flags=re.S)
    assert older != files[2]
    other.setState(openmm.XmlSerializer.deserialize(older))
    assert not itsFluid.getFlowInContext(other, [(1, 2, 3)])._value.any()


# ---- What is refused -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    'points, error, problem',
    [((1, 2, 3), ValueError,
      r'getFlowInContext: points: got an array of shape \(3,\); the shape must be \(m, '
      r'3\)|getFlowInContext: points'),
     (np.zeros((2, 2)), ValueError, r'getFlowInContext: points: got an array of shape \(2, 2\)'),
     (np.zeros((2, 3))*unit.picosecond, TypeError, 'getFlowInContext: points: got a quantity in'),
     ([(0, 0, 0), (0, float('nan'), 0)], openmm.OpenMMException,
      r'getFlowInContext\(\): point 1 is at .*nan.* nm; it must be finite: give a '
      'position in the fluid'),])
def test_points_that_are_none(points, error, problem):
    fluid, _, context = spheres('Reference', [(3, 2, 4)], [1], lambda fluid: None)
    with pytest.raises(error, match=problem):
        fluid.getFlowInContext(context, points)
    with pytest.raises(TypeError, match='getFlowInContext'):
        fluid.getFlowInContext('context', [(0, 0, 0)])


@pytest.mark.parametrize('boundary, behind, at', [('NoSlipWall', (0, 0, -1e-9), (0, 0, 0)),
                                                  ('SlipChannel', (0, -1e-9, 0), (0, 0, 0)),
                                                  ('SlipChannel', (0, 5.6, 0), (0, 5.5, 0))])
def test_points_behind_walls(boundary, behind, at):
    model = (MobilityForce.ForceCoupling
             if boundary == 'SlipChannel' else MobilityForce.RotnePragerYamakawa)
    fluid, _, context = spheres('Reference', [(3, 2, 4)], [1], lambda fluid: None, model,
                                getattr(MobilityForce, boundary))
    with pytest.raises(
            openmm.OpenMMException, match=
            r'getFlowInContext\(\): point 1 at .* nm is behind a wall, where there is no fluid; '
            'give points above the wall or between the walls'):
        fluid.getFlowInContext(context, [(1, 1, 1), behind])
    fluid.getFlowInContext(context, [at])


READERS = [
    lambda fluid, context: fluid.getFlowInContext(context, [(1, 1, 1)]),
    lambda fluid, context: fluid.getFlowModeInContext(context, 0, 1, 1),
    lambda fluid, context: fluid.getRandomFlowModeInContext(context, 0, 1, 1)
]


@pytest.mark.parametrize(
    'read, name',
    zip(READERS, ('getFlowInContext', 'getFlowModeInContext', 'getRandomFlowModeInContext')))
def test_fluids_that_are_not_one(read, name):
    with_ = dict(boundary=MobilityForce.Periodic)
    fluid, _, context = spheres('Reference', [(3, 2, 4), (1, 1, 1)], [1, 0.5],
                                lambda fluid: fluid.setGroups([0, 1]), **with_)
    with pytest.raises(
            openmm.OpenMMException,
            match=rf'{name}\(\): the Context has 2 groups of bodies, each in a fluid of its own; '
            'ask in a Context with one group'):
        read(fluid, context)
    fluid, _, context = spheres('Reference', [(3, 2, 4), (1, 1, 1)], [1, 0.5], lambda fluid: None,
                                MobilityForce.FreeDraining)
    with pytest.raises(
            openmm.OpenMMException,
            match=rf'{name}\(\): model FreeDraining has a separate fluid for each body, and no '
            'flow between bodies; use RotnePragerYamakawa'):
        read(fluid, context)


@pytest.mark.parametrize('name', ['getFlowModeInContext', 'getRandomFlowModeInContext'])
@pytest.mark.parametrize(
    'boundary, axes, error, problem',
    [('Unbounded', (0, 1, 1), openmm.OpenMMException,
      r'{}\(\): the flow has no Fourier modes with the boundary Unbounded; ask with the '
      r'boundary Periodic or SlipChannel or NoSlipChannel or Film, or use getFlowInContext\(\)'),
     ('NoSlipWall',
      (0, 1, 1), openmm.OpenMMException, 'the flow has no Fourier modes with the boundary '
      'NoSlipWall'),
     ('SlipChannel', (0, 1, 1), openmm.OpenMMException,
      r'{}\(\): the axes are 0 and 1, and in a SlipChannel both must be along the walls; give the '
      'axes 0 and 2'),
     ('SlipChannel',
      (1, 2, 1), openmm.OpenMMException, 'the axes are 1 and 2, and in a SlipChannel'),
     ('Periodic', (0, 3, 1), openmm.OpenMMException, r'{}\(\): an axis is 3; it must be 0, 1 or 2'),
     ('Periodic', (1, 1, 1), openmm.OpenMMException, r'{}\(\): both axes are 1'),
     ('Periodic', (0, 1, 0), openmm.OpenMMException,
      r'{}\(\): the wave-vector index is 0; it must be at least 1'),
     ('Periodic', (0.5, 1, 1), TypeError, '{}: forceAxis: got 0.5; it must be an integer'),
     ('Periodic', (0, 'y', 1), TypeError, "{}: waveAxis: got 'y'; it must be an integer"),
     ('Periodic', (0, 1, 1.5), TypeError, '{}: waveVectorIndex: got 1.5; it must be an integer'),])
def test_modes_that_are_none(name, boundary, axes, error, problem):
    model = MobilityForce.ForceCoupling if boundary in (
        'Periodic', 'SlipChannel') else MobilityForce.RotnePragerYamakawa
    fluid, _, context = spheres('Reference', [(3, 2, 4)], [1], lambda fluid: None, model,
                                getattr(MobilityForce, boundary))
    with pytest.raises(error, match=problem.format(name)):
        getattr(fluid, name)(context, *axes)
    with pytest.raises(TypeError, match=name):
        getattr(fluid, name)(None, 0, 1, 1)


def test_waves_that_boxes_and_grids_do_not_have():
    def onAGrid(fluid):
        fluid.setSolver(fluid.MatrixFree)
        fluid.setGridSpacing(0.3)

    fluid, _, context = spheres('Reference', [(3, 2, 4)], [1], onAGrid, MobilityForce.ForceCoupling,
                                MobilityForce.Periodic)
    with pytest.raises(
            openmm.OpenMMException, match=
            'a wave of index 14 along the edge 1 of the box is too short for a grid of 28 nodes'):
        fluid.getFlowModeInContext(context, 0, 1, 14)
    fluid.getFlowModeInContext(context, 0, 1, 13)
    fluid, _, context = spheres('Reference', [(3, 2, 4)], [1], lambda fluid: None,
                                boundary=MobilityForce.Periodic, box=[(9, 0, 0), (3, 8, 0),
                                                                      (0, 0, 10)])
    with pytest.raises(openmm.OpenMMException,
                       match='a wave of index 1 along the edge 0 of the box is not periodic'):
        fluid.getFlowModeInContext(context, 1, 0, 1)
    fluid.getFlowModeInContext(context, 1, 0, 3)


def test_a_context_of_others_has_no_flow():
    fluid = MobilityForce()
    system = openmm.System()
    system.addParticle(1)
    context = openmm.Context(system, openmm.VerletIntegrator(1),
                             openmm.Platform.getPlatformByName('Reference'))
    for read in READERS:
        with pytest.raises(openmm.OpenMMException,
                           match='This Force is not present in the Context'):
            read(fluid, context)


# ---- What the guide says -------------------------------------------------------------------------


def rotnePrager(r, a, b):
    """The velocity of a sphere of radius a, or of a point of the fluid (a = 0), from a force on a
    sphere at the distance r, for eta = 1."""
    d = np.linalg.norm(r)
    if d == 0:
        return np.eye(3)/(6*np.pi*b)
    nn = np.outer(r, r)/d**2
    if d < a + b:  # equal radii
        return ((1 - 9*d/(32*a))*np.eye(3) + 3*d/(32*a)*nn)/(6*np.pi*a)
    c = (a**2 + b**2)/d**2
    return ((1 + c/3)*np.eye(3) + (1 - c)*nn)/(8*np.pi*d)


@pytest.mark.parametrize('blobs, left', [(42, 0.6), (162, 1/3)])
def test_a_shell_of_blobs_leaks(blobs, left):
    """A shell holds the fluid only on average over each blob, so a part of a strain is left at its
    centre. This part falls with the distance of blobs, which is half as large for the finer shell.
    """
    sites, radius = app.multiblobSphere(blobs, 1.0)
    system, fluid = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(0, 0.1)
    integrator.setScheme(CustomRigidHIIntegrator.EulerMaruyama)
    app.addRigidMultiblob(system, integrator, fluid, sites, radius)
    strain = np.diag([1, 1, -2])
    fluid.setBackgroundFlow((0, 0, 0), strain)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('CPU'))
    context.setPositions(sites)
    points = np.array([(0, 0, 0.05), (0.1, -0.2, 0.3), (0, 0, 3)])
    flow = fluid.getFlowInContext(context, points)._value
    assert flow[0, 2]/(-2*0.05) == pytest.approx(left, abs=0.01)
    # Outside, the flow is that of a sphere (Batchelor 1967, eq. 4.9), as far as the shell's radius
    # for a strain is 1.
    assert flow[2, 2]/(-2*3) - 1 == pytest.approx(-2.5/3**3 + 1.5/3**5, rel=0.04)
    # The expected flow is by the matrix of the blobs, for which the strain causes no force or
    # torque on the shell.
    places, a = sites._value, radius._value
    M = np.block([[rotnePrager(x - y, a, a) for y in places] for x in places])
    forces = -np.linalg.solve(M, (places @ strain).reshape(-1)).reshape(-1, 3)
    expected = [
        strain @ x + sum(rotnePrager(x - y, 0, a) @ f for y, f in zip(places, forces))
        for x in points
    ]
    assert np.allclose(flow, expected, rtol=0, atol=1e-10)
