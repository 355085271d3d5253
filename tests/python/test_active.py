"""Active bodies in Python: slips as settings, in files, in samplers; and squirmers, which are
compared with values that an independent program gave."""
import copy
import json
import pathlib
import pickle
import re

import numpy as np
import openmm
import pytest
from openmm import unit

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, _systems, app

DATA = pathlib.Path(__file__).parent/'data'
VELOCITY = unit.nanometer/unit.picosecond
SLIP = np.arange(12).reshape(4, 3)/7
#: 1/c1 and 1/c2 of shells: how many times too fast they swim, and too large their stresslet is,
#: with the velocities of the formula.
RESPONSES = {
    12: (1.729723699475, 1.762136689108),
    42: (1.445569418169, 1.784893520753),
    162: (1.227526581961, 1.386705250637)
}


def active():
    fluid = MobilityForce()
    fluid.addParticle(0.5)
    fluid.setBodySlip(3, SLIP)
    fluid.setBodySlip(1, [(1, 2, 3)]*VELOCITY)
    return fluid


class Swimmers:
    """Bodies of blobs without forces, and the velocities with which a step moves them."""
    def __init__(self, bodies, slips, boundary=MobilityForce.Unbounded, eta=1, h=1):
        self.fluid = MobilityForce()
        self.fluid.setViscosity(eta)
        self.fluid.setBoundary(boundary)
        self.fluid.setSolver('Dense')
        self.integrator = CustomRigidHIIntegrator(0, h)
        self.integrator.setScheme('EulerMaruyama')
        system = openmm.System()
        system.addForce(self.fluid)
        positions = []
        for body, slip in zip(bodies, slips):
            sites = np.array(body['sites'])
            first = system.getNumParticles()
            for radius in body['radii']:
                self.fluid.addParticle(radius)
                system.addParticle(0)
            index = self.integrator.addRigidBody(list(range(first, system.getNumParticles())), 0,
                                                 (0, 0, 0), sites)
            if slip is not None:
                self.fluid.setBodySlip(index, slip)
            positions.extend(np.array(body['position']) + sites @ self.turn(body['quaternion']).T)
        self.positions = np.array(positions)
        self.context = openmm.Context(system, self.integrator,
                                      openmm.Platform.getPlatformByName('Reference'))
        self.context.setPositions(positions)
        app.placeBodies(self.context, [body['position'] for body in bodies],
                        [body['quaternion'] for body in bodies])

    @staticmethod
    def turn(q):
        w, v = q[0], np.array(q[1:])
        cross = np.array([(0, -v[2], v[1]), (v[2], 0, -v[0]), (-v[1], v[0], 0)])
        return np.eye(3) + 2*w*cross + 2*cross @ cross

    def twists(self):
        R, q = (get()._value if hasattr(get(), '_value') else get()
                for get in (self.integrator.getBodyPositions, self.integrator.getBodyOrientations))
        R, q = np.array(R), np.array(q)
        self.integrator.step(1)
        twists = np.empty((len(R), 6))
        twists[:, :3] = self.integrator.getBodyPositions()._value - R
        for row, before, after in zip(twists, q, self.integrator.getBodyOrientations()):
            turned = self.turn(after) @ self.turn(before).T
            axis = np.array((turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0],
                             turned[1, 0] - turned[0, 1]))/2
            sine = np.linalg.norm(axis)
            angle = np.arctan2(sine, (np.trace(turned) - 1)/2)
            row[3:] = axis*(angle/sine if sine > 0 else 1)
        return twists/self.integrator.getStepSize()._value


# ---- Settings ------------------------------------------------------------------------------------


@pytest.mark.parametrize('duplicate', [
    copy.copy, copy.deepcopy, lambda fluid: pickle.loads(pickle.dumps(fluid)), lambda fluid:
    MobilityForce.cast(openmm.XmlSerializer.deserialize(openmm.XmlSerializer.serialize(fluid)))
])
def test_slips_survive(duplicate):
    fluid = duplicate(active())
    assert list(fluid.getBodiesWithSlip()) == [1, 3]
    assert fluid.getBodySlip(3).unit == VELOCITY
    assert np.array_equal(fluid.getBodySlip(3)._value, SLIP)
    assert np.array_equal(fluid.getBodySlip(1)._value, [(1, 2, 3)])
    assert openmm.XmlSerializer.serialize(fluid) == openmm.XmlSerializer.serialize(active())


def test_slips_are_taken_away():
    fluid = active()
    fluid.clearBodySlip(3)
    fluid.clearBodySlip(7)
    assert list(fluid.getBodiesWithSlip()) == [1]
    with pytest.raises(openmm.OpenMMException, match='body 3 has no slip'):
        fluid.getBodySlip(3)


def test_units():
    fluid = MobilityForce()
    fluid.setBodySlip(0, SLIP*unit.angstrom/unit.picosecond)
    assert np.allclose(fluid.getBodySlip(0)._value, SLIP/10, rtol=1e-15)
    with pytest.raises(TypeError, match='setBodySlip: velocities: got a quantity in'):
        fluid.setBodySlip(0, SLIP*unit.nanometer)
    with pytest.raises(ValueError, match=re.escape('the shape must be (n, 3)')):
        fluid.setBodySlip(0, [1, 2, 3])
    with pytest.raises(TypeError, match='setBodySlip: body: got 0.5'):
        fluid.setBodySlip(0.5, SLIP)
    for method in (fluid.getBodySlip, fluid.clearBodySlip):
        with pytest.raises(TypeError, match=method.__name__ + ': body: got'):
            method('0')


def test_only_files_with_slips_have_the_newer_version():
    """Earlier versions of the library can read all other files."""
    fluid = active()
    assert ' version="2"' in openmm.XmlSerializer.serialize(fluid)
    for body in (1, 3):
        fluid.clearBodySlip(body)
    text = openmm.XmlSerializer.serialize(fluid)
    assert ' version="1"' in text and 'Slip' not in text.replace('NoSlip', '')


@pytest.mark.parametrize(
    'before, after, message',
    [(' version="2"', ' version="4"', "property 'version' is '4'; it must be 1, 2 or 3"),
     ('Slips', 'Slides', "the element 'Slips' is missing"),
     ('<Slip body="3" count="4">', '<Slip body="3" count="5">', 'it has 4 elements; it must have'),
     ('<Slip body="3"', '<Slip body="-3"', 'the index of the body is -3'),
     ('<Velocity x="1"', '<Velocity x="nan"', 'all velocities must be finite')])
def test_damaged_files_are_refused(before, after, message):
    text = openmm.XmlSerializer.serialize(active())
    assert before in text
    with pytest.raises(openmm.OpenMMException, match=re.escape(message)):
        openmm.XmlSerializer.deserialize(text.replace(before, after))


def test_there_is_no_equilibrium_beside_bodies_that_swim():
    system = openmm.System()
    system.addForce(active())
    with pytest.raises(
            ValueError, match=re.escape(
                'here: body 1 has a slip, which drives it and the fluid; the System has no '
                'equilibrium beside bodies that swim, average over steps, or take the slips away '
                'by clearBodySlip()')):
        _systems.refuse_driven_flow(system, 'here', 'average over steps')


# ---- Forces on the fluid -------------------------------------------------------------------------


def pushing():
    fluid = MobilityForce()
    fluid.addParticle(0.5)
    assert fluid.addBodyForceOnFluid(3, (1, 2, 1/3), 0.25, (0, 0, -1/7)) == 0
    assert fluid.addBodyForceOnFluid(0, (1, 2, 3)*unit.angstrom, 1*unit.angstrom,
                                     (1, 0, 0)*unit.kilocalorie_per_mole/unit.nanometer) == 1
    return fluid


def test_forces_on_the_fluid_survive():
    fluid = pushing()
    twin = MobilityForce.cast(
        openmm.XmlSerializer.deserialize(openmm.XmlSerializer.serialize(fluid)))
    for one in (fluid, twin, copy.copy(fluid), pickle.loads(pickle.dumps(fluid))):
        assert one.getNumBodyForcesOnFluid() == 2
        body, site, radius, force = one.getBodyForceOnFluidParameters(0)
        assert body == 3 and radius == 0.25*unit.nanometer
        assert list(site._value) == [1, 2, 1/3] and list(force._value) == [0, 0, -1/7]
        body, site, radius, force = one.getBodyForceOnFluidParameters(1)
        assert body == 0 and np.allclose(site._value, (0.1, 0.2, 0.3), rtol=1e-15)
        assert np.allclose(force._value, (4.184, 0, 0), rtol=1e-15)
    twin.setBodyForceOnFluidParameters(0, 1, (0, 0, 0), 1, (0, 0, 0))
    assert twin.getBodyForceOnFluidParameters(0)[0] == 1


def test_files_with_forces_on_the_fluid_have_the_newer_version():
    text = openmm.XmlSerializer.serialize(pushing())
    assert ' version="2"' in text
    for before, after, message in (('<ForceOnFluid body="3"', '<ForceOnFluid body="-3"',
                                    'the index of its body is -3'),
                                   ('radius=".25"', 'radius="-1"',
                                    'the radius of its particle is -1 nm'),
                                   ('<Site', '<Place', "the element 'Site' is missing"),
                                   ('<ForcesOnFluid count="2"', '<ForcesOnFluid count="1"',
                                    'it has 2 elements; it must have')):
        assert before in text
        with pytest.raises(openmm.OpenMMException, match=re.escape(message)):
            openmm.XmlSerializer.deserialize(text.replace(before, after))


def test_wrong_types_of_forces_on_the_fluid():
    fluid = pushing()
    where = 'addBodyForceOnFluid: '
    for arguments, message, error in (((0.5, (0, 0, 0), 1, (1, 0, 0)), 'body: got 0.5', TypeError),
                                      ((0, (0, 0), 1, (1, 0, 0)), 'site: got an array', ValueError),
                                      ((0, (0, 0, 0), '1', (1, 0, 0)), "radius: got '1'",
                                       TypeError), ((0, (0, 0, 0), 1, (1, 0, 0)*unit.nanometer),
                                                    'force: got a quantity', TypeError)):
        with pytest.raises(error, match=re.escape(where + message)):
            fluid.addBodyForceOnFluid(*arguments)
        with pytest.raises(error, match='setBodyForceOnFluidParameters'):
            fluid.setBodyForceOnFluidParameters(0, *arguments)
    with pytest.raises(TypeError, match='index: got'):
        fluid.getBodyForceOnFluidParameters('0')


def test_there_is_no_equilibrium_beside_forces_on_the_fluid():
    system = openmm.System()
    system.addForce(pushing())
    with pytest.raises(
            ValueError, match=re.escape(
                'here: body 3 exerts a force on the fluid by addBodyForceOnFluid(); '
                'the System has no equilibrium beside bodies that swim, average over steps, '
                'or make a MobilityForce without this force')):
        _systems.refuse_driven_flow(system, 'here', 'average over steps')


@pytest.mark.parametrize('solver', ['Dense', 'MatrixFree'])
@pytest.mark.parametrize('name', ['force_dipoles', 'force_dipoles_wall'])
def test_force_dipoles_of_an_independent_program(name, solver):
    scene = json.loads((DATA/f'{name}.json').read_text())
    swimmers = Swimmers(scene['bodies'], [None]*len(scene['bodies']),
                        MobilityForce.Boundary[scene['boundary']], scene['viscosity'])
    for dipole in scene['dipoles']:
        swimmers.fluid.addBodyForceOnFluid(dipole['body'], dipole['site'], dipole['radius'],
                                           dipole['force_on_fluid_body_frame'])
    swimmers.fluid.setSolver(solver)
    swimmers.fluid.setSolverTolerance(1e-13)
    swimmers.fluid.updateParametersInContext(swimmers.context)
    expected = np.array(scene['U']).reshape(-1, 6)
    assert np.abs(expected).max() > 0.01
    assert np.allclose(swimmers.twists(), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize('shape, site, warns',
                         [('sphere', (0, 0, -1.5), False), ('sphere', (0, 0, -0.9), True),
                          ('sphere', (0, 0, -0.95), False),  # a part is outside
                          ('shell', (0, 0, -1.5), False), ('shell', (0, 0, -0.2), True),
                          ('rod', (0, 0, -0.8), False),  # beside the blobs
                          ('ring', (0, 0, 0), False), ('rod', (0.9, 0, 0.2), True),])
def test_a_force_inside_its_own_body_is_named(shape, site, warns, capfd):
    """With the force inside, a sphere does not swim, and shells and rods are slower than with a
    force at half a radius outside, by the flow between their blobs alone."""
    system, fluid = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(0, 1e-3)
    integrator.setScheme('FixmanMidpoint')
    sites, radius = {
        'sphere': ([(0, 0, 0)], 1.0),
        'shell': app.multiblobSphere(42, 1.0),
        'rod': (app.rod(5, 1.0), 0.5),
        'ring': (3.0*np.array([(np.cos(a), np.sin(a), 0) for a in np.arange(24)*np.pi/12]), 0.4)
    }[shape]
    app.addRigidMultiblob(system, integrator, fluid, sites, radius)
    fluid.addBodyForceOnFluid(0, site, 0.1, (0, 0, -1))
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    app.placeBodies(context, [(0, 0, 0)])
    integrator.step(3)
    speed = np.linalg.norm(integrator.getBodyPositions()._value)/(3*1e-3)
    outside = 1/(6*np.pi*fluid.getViscosity()._value)
    if warns:
        assert speed < (1e-6 if shape == 'sphere' else 0.11)*outside
    elif site[2] == -1.5:
        assert speed > 0.14*outside
    text = 'force 0 on the fluid (addBodyForceOnFluid()) acts inside body 0'
    assert (text in integrator.getEffects()['warnings']) == warns
    assert capfd.readouterr().err.count(text) == warns


# ---- Squirmers -----------------------------------------------------------------------------------


@pytest.mark.parametrize('name', ['squirmers', 'squirmers_wall'])
def test_two_squirmers_of_an_independent_program(name):
    scene = json.loads((DATA/f'{name}.json').read_text())
    swimmers = Swimmers(scene['bodies'], scene['slip_velocities'],
                        MobilityForce.Boundary[scene['boundary']], scene['viscosity'])
    # Forces on blobs that make up for the slips in rigid motion: M lambda + s = K U.
    forces = np.array(scene['blobForces'])
    velocities = swimmers.fluid.applyBlobMobilityInContext(swimmers.context, forces.reshape(-1, 3))
    expected = np.array(scene['U']).reshape(2, 6)
    rigid, count = [], len(scene['bodies'][0]['sites'])
    for k, body in enumerate(scene['bodies']):
        blobs = swimmers.positions[count*k:count*(k + 1)] - body['position']
        slip = -np.array(scene['slip_velocities'][k]) @ swimmers.turn(body['quaternion']).T
        rigid.append(expected[k, :3] + np.cross(expected[k, 3:], blobs) - slip)
    assert np.allclose(velocities, np.concatenate(rigid), rtol=0, atol=1e-12)
    assert np.allclose(swimmers.twists(), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize('n', RESPONSES)
def test_modes_are_scaled_by_the_response_of_the_shell(n):
    sites, radius = app.multiblobSphere(n, 1)
    unscaled = sites._value/np.linalg.norm(sites._value, axis=1)[:, None]
    cosine = unscaled[:, 2:]
    first = cosine*unscaled - (0, 0, 1)
    for B, mode, response in (((1, 0), first, RESPONSES[n][0]), ((0, 1), cosine*first,
                                                                 RESPONSES[n][1])):
        slip = app.squirmerSlip(sites, radius, *B)
        assert slip.unit == VELOCITY
        assert np.allclose(slip._value, mode/response, rtol=0, atol=1e-12)
    # Lengths do not matter, and amplitudes are linear.
    twice = app.squirmerSlip(2*sites + (1, 2, 3)*unit.nanometer, 2*radius, 3, -2)
    assert np.allclose(twice._value, 3*first/RESPONSES[n][0] - 2*cosine*first/RESPONSES[n][1],
                       rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    'n, pair, wall', [(12, (-0.205718, 0.659334, -0.005339), (0.651571, 0.081961, -0.608090)),
                      (42, (-0.161106, 0.657629, -0.001612), (0.648976, 0.063716, -0.588446)),
                      (162, (-0.159001, 0.656351, -0.001744), (0.646620, 0.061815, -0.577206)),])
def test_squirmers_beside_another_and_above_a_wall(n, pair, wall):
    sites, radius = app.multiblobSphere(n, 1)

    def bodies(positions, q):
        return [{
            'sites': sites._value,
            'radii': n*[radius._value],
            'position': position,
            'quaternion': q
        } for position in positions]

    slip = app.squirmerSlip(sites, radius, 1, 3)
    both = Swimmers(bodies([(0, 0, 0), (3, 0, 0)], (1, 0, 0, 0)), [slip, slip]).twists()
    assert np.allclose(both[0, [0, 2, 4]], pair, rtol=0, atol=1e-6)
    half = np.sqrt(0.5)
    found = []
    for q, B, row in (((half, 0, half, 0), (1, 0), 0), ((half, 0, half, 0), (0, 1), 2),
                      ((0, 1, 0, 0), (1, 0), 2)):
        slip = app.squirmerSlip(sites, radius, *B)
        alone = Swimmers(bodies([(0, 0, 1.5)], q), [slip], MobilityForce.NoSlipWall, h=0.01)
        found.append(alone.twists()[0, row])
    assert np.allclose(found, wall, rtol=0, atol=1e-6)


def test_the_stresslet_is_that_of_a_squirmer():
    """Far away the flow is that of a stresslet, (1 - 3 cos^2) B2 a^2/(2 r^2) along r."""
    sites, radius = app.multiblobSphere(42, 1.3)
    body = {
        'sites': sites._value,
        'radii': 42*[radius._value],
        'position': (0, 0, 0),
        'quaternion': (1, 0, 0, 0)
    }
    fluid = Swimmers([body], [app.squirmerSlip(sites, radius, 0, 2)])
    for direction in np.array([(0, 0, 1), (1, 0, 0), (0.6, 0, 0.8)]):
        flow = fluid.fluid.getFlowInContext(fluid.context, [2000*direction])._value[0]
        expected = (1 - 3*direction[2]**2)*2*1.3**2/(2*2000**2)*direction
        assert np.allclose(flow, expected, rtol=0, atol=1e-4*2*1.3**2/2000**2)


@pytest.mark.parametrize(
    'change, message, error',
    [({
        'sites': np.eye(3)
    }, 'sites: got 3 of them', ValueError),
     ({
         'sites': np.vstack([np.eye(3), (np.nan, 0, 0)])
     }, 'sites: the position of site 3 is', ValueError),
     ({
         'sites': [(0, 0, 1), (1, 0, 0), (0, 1, 0), (0, 0, 3)]
     }, 'they must be on a sphere to 0.001 of its radius', ValueError),
     ({
         'sites': [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)]
     }, 'both must be positive', ValueError), ({
         'sites': 3
     }, 'squirmerSlip: sites: got', ValueError),
     ({
         'radius': 0
     }, 'radius: got 0.0 nm; it must be finite and positive: give the radius of a '
      'blob', ValueError), ({
          'radius': 1*unit.picosecond
      }, 'radius: got a quantity in', TypeError),
     ({
         'B1': np.inf
     }, 'B1: got inf nm/ps; it must be finite', ValueError),
     ({
         'B2': 1*unit.nanometer
     }, 'B2: got a quantity in', TypeError),])
def test_what_squirmerSlip_refuses(change, message, error):
    sites, radius = app.multiblobSphere(12, 1)
    arguments = {'sites': sites, 'radius': radius, 'B1': 1, 'B2': 0}
    with pytest.raises(error, match=re.escape(message)):
        app.squirmerSlip(**{**arguments, **change})
