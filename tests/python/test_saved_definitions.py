"""Saved states are loaded after definitions of bodies have changed. The state is kept, the System's
definition wins, or the change is refused."""
import json
import pathlib
import re
import struct

import numpy as np
import openmm
import pytest

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce

DATA = pathlib.Path(__file__).parent/'data'
MOMENTS = (1, 2, 2.5)
SITES = [(0.05, 0, 0), (-0.04, 0.1, 0), (0, -0.1, 0.2)]


def refused(*pieces):
    return pytest.raises(openmm.OpenMMException,
                         match='.*'.join(re.escape(piece) for piece in pieces))


def explicitBody(platform, mass=9, moments=MOMENTS, sites=SITES, step=1e-9):
    """A body with explicit definition and a free spin, in a Context without positions."""
    system = openmm.System()
    for _ in range(3):
        system.addParticle(1)
    integrator = CustomRigidHIIntegrator(300, step)
    integrator.addRigidBody([0, 1, 2], mass, moments, sites)
    return openmm.Context(system, integrator, platform), integrator


def start(context, integrator):
    context.setPositions(np.array(SITES))
    integrator.setBodyOrientations([np.array([0.5, -0.1, 0.7, 0.5])/1.0])
    integrator.setBodyVelocities([(0.3, 0.2, 0.1)])
    integrator.setBodyAngularVelocities([(3, -4, 5)])


def stateXml(context):
    return openmm.XmlSerializer.serialize(
        context.getState(getPositions=True, getVelocities=True, getIntegratorParameters=True))


def load(context, saved):
    if isinstance(saved, bytes):
        context.loadCheckpoint(saved)
    else:
        context.setState(openmm.XmlSerializer.deserialize(saved))


WAYS = {'checkpoint': lambda context: context.createCheckpoint(), 'State': stateXml}


def twist(integrator):
    return np.concatenate(
        [integrator.getBodyVelocities()._value,
         integrator.getBodyAngularVelocities()._value], 1)


def places(context):
    return context.getState(getPositions=True).getPositions(asNumpy=True)._value


# ---- Explicit bodies: another definition is refused ----------------------------------------------


@pytest.mark.parametrize('moments', [(2.5, 2, 1), (2, 1, 2.5), (1, 2, 2.6), (1, 2, 2.5*(1 + 1e-7))])
@pytest.mark.parametrize('way', WAYS)
def test_other_moments_are_refused(platform, way, moments):
    context, integrator = explicitBody(platform)
    start(context, integrator)
    saved = WAYS[way](context)
    other, otherIntegrator = explicitBody(platform, moments=moments)
    other.setPositions(np.array(SITES) + 1)
    with refused('body 0 was saved with another shape or mass', 'moments (1, 2, 2.5) instead of',
                 'load the state into'):
        load(other, saved)
    # The former state stays, except positions that OpenMM may have replaced already.
    otherIntegrator.step(1)


@pytest.mark.parametrize('moments', [(2.5, 2, 1), (2, 1, 2.5), (1, 2, 2.6)])
def test_a_body_redefined_before_reinitialize_that_preserves_the_state(platform, moments):
    context, integrator = explicitBody(platform)
    start(context, integrator)
    integrator.setRigidBodyParameters(0, [0, 1, 2], 9, moments, SITES)
    with refused('body 0 was saved with another shape or mass',
                 'reinitialize() without preserveState'):
        context.reinitialize(preserveState=True)
    context.setPositions(np.array(SITES))
    integrator.step(1)


@pytest.mark.parametrize('change', ['mass', 'site'])
@pytest.mark.parametrize('way', WAYS)
def test_another_mass_or_site_is_refused(platform, way, change):
    """The mass is compared by itself, not with the pose tolerance, which is a length."""
    context, integrator = explicitBody(platform)
    start(context, integrator)
    saved = WAYS[way](context)
    sites = np.array(SITES)
    if change == 'site':
        sites[1, 2] += 0.002
    other, otherIntegrator = explicitBody(platform, mass=9*(1 + 1e-4) if change == 'mass' else 9,
                                          sites=sites)
    with refused('body 0 was saved with another shape or mass', {
            'mass': 'mass 9 instead of 9.0009',
            'site': 'particle 1'
    }[change]):
        load(other, saved)


@pytest.mark.parametrize('saved, given', [((1.5, 2, 2*(1 + 4e-16)), (1.5, 2*(1 + 4e-16), 2)),
                                          ((2*(1 + 4e-16), 1.5, 2), (2, 1.5, 2*(1 + 4e-16))),
                                          ((1, 1 + 3e-16, 1), (1 + 3e-16, 1, 1))])
@pytest.mark.parametrize('way', WAYS)
def test_moments_that_differ_by_rounding_are_the_same(platform, way, saved, given):
    """Rounding decides in which order such moments are sorted, and no result may depend on this
    order.
    """
    context, integrator = explicitBody(platform, moments=saved)
    start(context, integrator)
    before, poses = places(context), integrator.getBodyOrientations()
    state = WAYS[way](context)
    other, otherIntegrator = explicitBody(platform, moments=given)
    load(other, state)
    assert np.abs(otherIntegrator.getBodyOrientations() - poses).max() < 1e-13
    assert np.abs(twist(otherIntegrator) - twist(integrator)).max() < 1e-12
    otherIntegrator.step(1)
    assert np.abs(places(other) - before).max() < 2e-8  # 10 nm/ps for 1e-9 ps


# ---- Implicit bodies: the System wins ------------------------------------------------------------


def water(platform, masses=(16, 1, 1), bond=0.1, constrained=True, shape=None):
    """Two waters. Constraints define the shape of one, its first positions that of the other."""
    system = openmm.System()
    for mass in 2*masses:
        system.addParticle(mass)
    for a, b, length in ((0, 1, bond), (0, 2, bond), (1, 2, 0.16)):
        system.addConstraint(a, b, length)
    integrator = CustomRigidHIIntegrator(300, 0.001)
    integrator.setRandomNumberSeed(3)
    integrator.addRigidBody([0, 1, 2])
    integrator.addRigidBody([3, 4, 5])
    return system, integrator


def waterPositions(bond=0.1):
    triangle = np.array([(0, 0, 0), (0.08, np.sqrt(bond**2 - 0.08**2), 0),
                         (-0.08, np.sqrt(bond**2 - 0.08**2), 0)])
    return np.concatenate([triangle, triangle + 1])


def expectedBody(masses, bond=0.1):
    """The mass and moments, computed here from the masses and the shape."""
    m, x = np.array(masses, dtype=float), waterPositions(bond)[:3]
    x = x - m @ x/m.sum()
    inertia = np.einsum('i,ij->', m, x**2)*np.eye(3) - np.einsum('i,ij,ik->jk', m, x, x)
    return m.sum(), np.linalg.eigvalsh(inertia)


def started(platform, **options):
    system, integrator = water(platform, **options)
    context = openmm.Context(system, integrator, platform)
    context.setPositions(waterPositions())
    context.setVelocitiesToTemperature(300, 1)
    integrator.step(3)
    return system, integrator, context


def checkBodies(integrator, masses, bond=0.1):
    for body in (0, 1):
        _, mass, moments, sites = integrator.getRigidBodyParameters(body)
        expectedMass, expectedMoments = expectedBody(masses, bond if body == 0 else 0.1)
        assert mass._value == pytest.approx(expectedMass, rel=1e-12)
        assert np.allclose(moments._value, expectedMoments, rtol=1e-6)
        centre = np.array(masses) @ sites._value/sum(masses)
        assert np.abs(centre).max() < 1e-12


@pytest.mark.parametrize('masses', [(10, 4, 4), (160, 10, 10), (2, 7, 9)],
                         ids=['repartitioned', 'ten times', 'skew'])
@pytest.mark.parametrize('way', ['preserveState', 'State', 'checkpoint'])
def test_changed_masses_win_over_saved_ones(platform, way, masses):
    """Particles keep their positions and velocities, as under OpenMM's own integrators.
    """
    system, integrator, context = started(platform)
    before = context.getState(getPositions=True, getVelocities=True)
    saved = WAYS[way](context) if way in WAYS else None
    for particle, mass in enumerate(2*masses):
        system.setParticleMass(particle, mass)
    context.reinitialize(preserveState=way == 'preserveState')
    if saved is not None:
        load(context, saved)
    checkBodies(integrator, masses)
    after = context.getState(getPositions=True, getVelocities=True)
    assert np.array_equal(
        after.getPositions(asNumpy=True)._value,
        before.getPositions(asNumpy=True)._value)
    assert np.array_equal(
        after.getVelocities(asNumpy=True)._value,
        before.getVelocities(asNumpy=True)._value)
    # Momentum and kinetic energy are those of the particles with their new masses.
    v = before.getVelocities(asNumpy=True)._value
    m = np.array(2*masses, dtype=float)[:, None]
    assert np.allclose(integrator.getBodyVelocities()._value,
                       (m*v).reshape(2, 3, 3).sum(1)/sum(masses), atol=1e-12)
    assert context.getState(getEnergy=True).getKineticEnergy()._value == pytest.approx(
        0.5*(m*v**2).sum(), rel=1e-6)
    integrator.setStepSize(1e-9)
    integrator.step(1)
    assert np.abs(places(context) - before.getPositions(asNumpy=True)._value).max() < 1e-7


def test_changed_masses_win_at_a_plain_reinitialize_and_in_another_system(platform):
    system, integrator, context = started(platform)
    masses = (10, 4, 4)
    xml = openmm.XmlSerializer.serialize(integrator)
    for particle, mass in enumerate(2*masses):
        system.setParticleMass(particle, mass)
    context.reinitialize()
    context.setPositions(waterPositions())
    checkBodies(integrator, masses)
    # The bodies have the shapes of the file and the masses of the System.
    copy = CustomRigidHIIntegrator.cast(openmm.XmlSerializer.deserialize(xml))
    other = openmm.Context(system, copy, platform)
    checkBodies(copy, masses)
    other.setPositions(waterPositions())
    copy.step(1)


@pytest.mark.parametrize('way', ['preserveState', 'State', 'checkpoint'])
def test_a_changed_constraint_wins_over_the_saved_shape(platform, way):
    system, integrator, context = started(platform)
    saved = WAYS[way](context) if way in WAYS else None
    for constraint in (0, 1):
        a, b, _ = system.getConstraintParameters(constraint)
        system.setConstraintParameters(constraint, a, b, 0.12)
    context.reinitialize(preserveState=way == 'preserveState')
    if saved is not None:
        load(context, saved)
    checkBodies(integrator, (16, 1, 1), bond=0.12)
    with refused('body 0: particle', 'nm from its place in the body',
                 'call applyConstraints() on the Context'):
        integrator.step(1)
    context.applyConstraints(1e-6)
    integrator.step(1)
    x = places(context)
    assert np.linalg.norm(x[1] - x[0]) == pytest.approx(0.12, abs=1e-9)
    assert np.linalg.norm(x[4] - x[3]) == pytest.approx(0.1, abs=1e-9)


def test_unchanged_bodies_resume_bit_for_bit_beside_changed_ones():
    platform = openmm.Platform.getPlatformByName('Reference')
    system, integrator, context = started(platform)
    before = integrator.getBodyOrientations()
    system.setParticleMass(0, 17)
    context.reinitialize(preserveState=True)
    assert np.array_equal(integrator.getBodyOrientations()[1], before[1])


# ---- Files of earlier versions -------------------------------------------------------------------


def versionOne(platform, state='state_version1.xml'):
    system = openmm.System()
    force = openmm.CustomExternalForce('50*(x^2 + 2*y^2 + 3*z^2)')
    for i in range(7):
        system.addParticle(1 + i)
        force.addParticle(i, [])
    system.addForce(force)
    integrator = CustomRigidHIIntegrator.cast(
        openmm.XmlSerializer.deserialize((DATA/'integrator_version1.xml').read_text()))
    context = openmm.Context(system, integrator, platform)
    load(context, (DATA/state).read_text())
    return context, integrator


@pytest.mark.parametrize('state', ['state_version1.xml', 'state_version2.xml'])
def test_files_of_earlier_versions_are_read(state):
    """States of version 1 have the orientation in the frame of sorted moments; those of version 2
    have no inertia scale."""
    context, integrator = versionOne(openmm.Platform.getPlatformByName('Reference'), state)
    integrator.step(3)
    expected = json.loads((DATA/'state_version1_after3steps.json').read_text())
    assert np.abs(integrator.getBodyPositions()._value - expected['positions']).max() < 1e-13
    assert np.abs(integrator.getBodyOrientations() - expected['orientations']).max() < 1e-13
    assert np.abs(integrator.getBodyAngularVelocities()._value -
                  expected['angularVelocities']).max() < 1e-11


def test_a_checkpoint_of_another_version(platform):
    context, integrator = explicitBody(platform)
    start(context, integrator)
    saved = context.createCheckpoint()
    assert saved.count(b'RIGIDHI3') == 1
    for other in (b'1', b'5'):
        with refused(
                f'the checkpoint has version {other.decode()}, but this library reads versions 2 '
                f'to 4', 'load it with the library that saved it'):
            context.loadCheckpoint(saved.replace(b'RIGIDHI3', b'RIGIDHI' + other))


def test_a_checkpoint_of_version_two_has_no_inertia_scale_and_no_last_step(platform):
    context, integrator = explicitBody(platform)
    start(context, integrator)
    saved = context.createCheckpoint()
    integrator.step(5)
    expected = places(context)
    at = 4 + 8 + 4 + 8 + 8  # seed, step number, whether there are bodies, two hashes
    assert struct.unpack_from('<d', saved, saved.index(b'RIGIDHI3') + 24 + at) == (1,)

    # A scheme with momenta has no last step: its name's length and the number of groups are 0.
    def asVersionTwo(body):
        assert body[-8:] == bytes(8)
        return body[:at] + body[at + 8:-8]

    context.loadCheckpoint(forged(saved, asVersionTwo).replace(b'RIGIDHI3', b'RIGIDHI2'))
    integrator.step(5)
    assert np.array_equal(places(context), expected)


# ---- Strict reading ------------------------------------------------------------------------------


@pytest.mark.parametrize('pattern, replacement, pieces', [
    (' Rx="[^"]*"', ' Rx="abc"', ["property 'Rx' is 'abc'", 'it must be a number']),
    (' seed="[^"]*"', ' seed="abc"', ["property 'seed' is 'abc'", 'it must be an integer']),
    (' seed="[^"]*"', ' seed="-1"', ["property 'seed' is '-1'"]),
    (' stepNumber="[^"]*"', ' stepNumber="1.5"', ["property 'stepNumber' is '1.5'"]),
    (' stepNumber="[^"]*"', ' stepNumber="-7"', ['its step number -7 is below 0; use another']),
    (' mass="[^"]*"', ' mass="abc"', ["property 'mass' is 'abc'"]),
    (' mass="[^"]*"', ' mass="-1"',
     ['body 0: the saved state is corrupt: it has mass -1 amu; use another']),
    (' mass="[^"]*"', ' mass="0"', ['body 0', 'it has mass 0 amu']),
    (' I1="[^"]*"', ' I1="-2"', ['body 0', 'no body has its moments (-2, ']),
    (' I1="[^"]*"', ' I1="200"', ['body 0', 'no body has its moments (200, ']),
    (' qw="[^"]*"', ' qw="5"',
     ['body 0', 'its quaternion has length ', ', which must be 1; use another']),
    (' qw="[^"]*"', ' qw="inf"',
     ['body 0: the saved state is corrupt: it has a non-finite number; use another']),
    (' px="[^"]*"', ' px="nan"',
     ['body 0: the saved state is corrupt: it has a non-finite number; use another']),
    (' Rx="[^"]*"', ' Rx="7"', ['body 0', 'particle', 'from where the saved pose puts it']),
    (' inertiaScale="[^"]*"', ' inertiaScale="0"', [
        'the saved state is corrupt: its inertia scale 0', 'is not positive and finite; use another'
    ]),
    (' inertiaScale="[^"]*"', ' inertiaScale="inf"',
     ['the saved state is corrupt: its inertia scale inf']),
    (' inertiaScale="[^"]*"', ' inertiaScale="2"',
     ['body 0', 'its pose or velocities do not agree with its stored internal state']),
    (' positionsHash="[^"]*"', ' positionsHash="12x"', ["property 'positionsHash' is '12x'"]),
    (' wx="[^"]*"', ' wx="7"',
     ['body 0', 'its pose or velocities do not agree with its stored internal state']),
    ('<Site [^>]*/>', '', ['body 0', 'particles']),
    ('<Site x="[^"]*"', '<Site x="nan"',
     ['body 0: the saved state is corrupt: it has a non-finite number; use another']),
])
@pytest.mark.parametrize('version', [1, 3])
def test_body_states_are_read_strictly(platform, version, pattern, replacement, pieces):
    if version == 1:
        context, _ = versionOne(platform)
        xml = (DATA/'state_version1.xml').read_text()
    else:
        context, _ = versionOne(platform)
        xml = stateXml(context)
    head, tail = xml[:xml.index('<RigidBodyState')], xml[xml.index('<RigidBodyState'):]
    damaged, count = re.subn(pattern, replacement, tail, count=1)
    assert count == (0 if version == 1 and re.search('wx|inertia', pattern) else 1)
    if count == 0:
        return  # version 1 has the exact numbers only
    with refused(*pieces):
        load(context, head + damaged)


def test_a_refused_state_leaves_the_bodies_as_they_were(platform):
    context, integrator = versionOne(platform)
    xml = stateXml(context)
    before, spins = integrator.getBodyPositions()._value, integrator.getBodyAngularVelocities(
    )._value
    with refused('body 2'):
        at = xml.rindex(' qw="')
        load(context, xml[:at] + ' qw="3"' + xml[xml.index('"', at + 5) + 1:])
    assert np.array_equal(integrator.getBodyPositions()._value, before)
    assert np.array_equal(integrator.getBodyAngularVelocities()._value, spins)


def forged(checkpoint, edit):
    """A checkpoint with changed bytes and the check sum of these bytes."""
    at = checkpoint.index(b'RIGIDHI3')
    length = int.from_bytes(checkpoint[at + 8:at + 16], 'little')
    body = bytearray(checkpoint[at + 24:at + 24 + length])
    edited = edit(body)
    body = body if edited is None else edited
    value = 0xcbf29ce484222325
    for byte in body:
        value = ((value ^ byte)*0x100000001b3) % 2**64
    return checkpoint[:at + 8] + len(body).to_bytes(8, 'little') + value.to_bytes(
        8, 'little') + bytes(body) + checkpoint[at + 24 + length:]


def test_checkpoints_with_a_forged_check_sum(platform):
    """If any byte is changed there is an OpenMMException, or the bodies are the same to the pose
    tolerance, 1 % of their size, as for sites."""
    context, integrator = versionOne(platform)
    checkpoint = context.createCheckpoint()
    at = checkpoint.index(b'RIGIDHI3')
    length = int.from_bytes(checkpoint[at + 8:at + 16], 'little')
    numbers = 8 + 4 + 4 + 8 + 8 + 8 + 4  # before the bodies
    poses, motion = (integrator.getBodyPositions()._value,
                     integrator.getBodyOrientations()), twist(integrator)
    random = np.random.default_rng(1)
    refusals = 0
    for place in random.choice(np.arange(numbers, length), 150, replace=False):

        def edit(body):
            body[place] ^= 0x40 if random.random() < 0.5 else 0x7f

        try:
            context.loadCheckpoint(forged(checkpoint, edit))
        except openmm.OpenMMException:
            refusals += 1
            continue
        assert np.abs(integrator.getBodyPositions()._value - poses[0]).max() < 1e-3
        assert np.abs(integrator.getBodyOrientations() - poses[1]).max() < 0.02
        assert np.allclose(twist(integrator), motion, rtol=0.02, atol=0.02*np.abs(motion).max())
        integrator.step(1)
        assert np.isfinite(places(context)).all()
    assert refusals > 50  # of 150, from the three leading bytes of eight
    for edit, piece in ((lambda body: body + struct.pack('<ddi', 1e-7, 1e-7, 0) + b'\0',
                         '1 bytes follow its end'), (lambda body: body + b'\0',
                                                     'it ends too early'), (lambda body: body[:-8],
                                                                            'it ends too early'),
                        (lambda body: b'',
                         'it ends too early'), (lambda body: body[:40] + b'\xff\xff\xff\xff',
                                                'it claims to hold -1 bodies'),
                        (lambda body: body[:-4] + b'\xff\xff\xff\xff',
                         'it claims that -1 items follow; use another')):
        with refused('the checkpoint is corrupt', piece):
            context.loadCheckpoint(forged(checkpoint, edit))
    context.loadCheckpoint(forged(checkpoint, lambda body: None))
    assert np.array_equal(twist(integrator), motion)
    integrator.step(1)


def test_memory_of_a_scheme_that_is_not_of_these_bodies(platform):
    """Data that a scheme keeps between steps belongs to groups of bodies. No scheme of the library
    keeps data, so the test writes some by hand."""
    system, fluid = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(300, 0.001)
    integrator.setScheme(CustomRigidHIIntegrator.FixmanMidpoint)
    system.addParticle(0)
    fluid.addParticle(0.1)
    system.addForce(fluid)
    integrator.addRigidBody([0], 0, (0, 0, 0), [(0, 0, 0)])
    context = openmm.Context(system, integrator, platform)
    context.setPositions([(0, 0, 0)])
    integrator.step(1)
    xml = stateXml(context)
    for memory, pieces in (('<Group><Vectors rows="2" columns="1"/></Group>', [
            "property 'rows' is '2'",
            'it must be the number of values divided by the number of columns'
    ]), ('<Group/><Group/>', [
            "the saved state's memory of scheme FixmanMidpoint is damaged, or belongs to other "
            'bodies'
    ]), ('<Group><Vectors rows="0" columns="0"/></Group>',
         ['is damaged, or belongs to other bodies'])):
        before = integrator.getBodyPositions()._value, integrator.getBodyOrientations()
        with refused(*pieces):
            load(
                context,
                xml.replace(
                    '</RigidBodyState>', f'<SchemeMemory '
                    f'scheme="FixmanMidpoint">{memory}</SchemeMemory></RigidBodyState>'))
        assert np.array_equal(integrator.getBodyPositions()._value, before[0]) and np.array_equal(
            integrator.getBodyOrientations(), before[1])
    load(
        context,
        xml.replace(
            '</RigidBodyState>',
            '<SchemeMemory scheme="FixmanMidpoint"><Group/></SchemeMemory></RigidBodyState>'))
    integrator.step(1)


def test_memory_that_a_scheme_cannot_have(platform):
    """The data has the name of the present scheme, which keeps none."""
    context, integrator = versionOne(platform)
    xml = stateXml(context).replace(
        '</RigidBodyState>',
        '<SchemeMemory scheme="LangevinC"><Group/></SchemeMemory></RigidBodyState>')
    load(context, xml)  # without a fluid the data is ignored
    integrator.step(1)
    system, fluid = openmm.System(), MobilityForce()
    langevin = CustomRigidHIIntegrator(300, 0.001)
    langevin.setScheme(CustomRigidHIIntegrator.LangevinHI)
    system.addParticle(20)
    fluid.addParticle(0.1)
    system.addForce(fluid)
    langevin.addRigidBody([0], 20, (1, 1, 1), [(0, 0, 0)])
    context = openmm.Context(system, langevin, platform)
    context.setPositions([(0, 0, 0)])
    langevin.step(1)
    with refused("the saved state's memory of scheme LangevinHI is damaged"):
        load(
            context,
            stateXml(context).replace(
                '</RigidBodyState>',
                '<SchemeMemory scheme="LangevinHI"><Group/></SchemeMemory></RigidBodyState>'))
    langevin.step(1)


def test_states_hold_what_users_mean(platform):
    """The numbers in the file are those of the getters, in the user's frame, whatever the order of
    the moments."""
    context, integrator = explicitBody(platform, moments=(2.5, 1, 2))
    start(context, integrator)
    xml = stateXml(context)
    body = re.search(r'<Body ([^>]*)>', xml).group(1)
    values = {name: float(value) for name, value in re.findall(r'(\w+)="([^"]*)"', body)}
    assert [values['R' + axis]
            for axis in 'xyz'] == integrator.getBodyPositions()._value[0].tolist()
    assert [values['q' + axis] for axis in 'wxyz'] == integrator.getBodyOrientations()[0].tolist()
    assert [values['v' + axis] for axis in 'xyz'] == pytest.approx([0.3, 0.2, 0.1], rel=1e-14)
    assert [values['w' + axis] for axis in 'xyz'] == pytest.approx([3, -4, 5], rel=1e-13)


# ---- First positions -----------------------------------------------------------------------------


def test_first_positions_that_are_refused_do_not_become_the_shape(platform):
    """The fluid refuses a body that is below the wall, and its shape is not kept."""
    system, fluid = openmm.System(), MobilityForce()
    integrator = CustomRigidHIIntegrator(300, 0.001)
    integrator.setScheme(CustomRigidHIIntegrator.LangevinHI)
    for _ in range(2):
        system.addParticle(20)
        fluid.addParticle(0.1)
    system.addForce(fluid)
    integrator.addRigidBody([0, 1])
    context = openmm.Context(system, integrator, platform)
    context.setPositions([(0, 0, 0), (0, 0, 0)])  # coincident
    with pytest.raises(openmm.OpenMMException):
        integrator.step(1)
    assert not integrator.getRigidBodyGeometryIsKnown(0)
    context.setPositions([(0, 0, 0), (0, 0, 0.3)])
    integrator.step(1)
    assert np.linalg.norm(np.diff(integrator.getRigidBodyParameters(0)[3]._value,
                                  axis=0)) == pytest.approx(0.3)


# ---- The seed ------------------------------------------------------------------------------------


def test_the_saved_seed_goes_on(platform):
    """A seed that is set takes effect at the next step, and a state that is loaded brings its
    own."""
    def run(action):
        _, integrator, context = started(platform)
        action(integrator, context)
        integrator.step(2)
        return places(context), integrator.getRandomNumberSeed()

    def preserve(integrator, context):
        context.reinitialize(preserveState=True)

    def load(integrator, context):
        state = context.getState(getPositions=True, getVelocities=True,
                                 getIntegratorParameters=True)
        integrator.setRandomNumberSeed(99)
        context.setState(state)

    def reseed(integrator, context):
        integrator.setRandomNumberSeed(99)

    def reseedAndPreserve(integrator, context):
        integrator.setRandomNumberSeed(99)
        context.reinitialize(preserveState=True)

    (plain, seed), (other, newSeed) = run(lambda *_: None), run(reseed)
    assert newSeed == 99 != seed
    assert np.abs(other - plain).max() > 1e-5
    for action in preserve, load:
        found, inUse = run(action)
        assert np.abs(found - plain).max() < 1e-6 and inUse == seed
    found, inUse = run(reseedAndPreserve)
    assert np.abs(found - other).max() < 1e-6 and inUse == 99
