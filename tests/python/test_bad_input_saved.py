"""Damaged, truncated and foreign files are refused: XML of integrators and States, checkpoints,
body-state files."""
import re
import struct

import numpy as np
import openmm
import pytest

import openmmrigidhi

Integrator = openmmrigidhi.CustomRigidHIIntegrator
SHAPE = np.array([(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1)])
MARK = b'RIGIDHI3'  # where this plugin's part of a checkpoint begins


def refused(*pieces, error=openmm.OpenMMException):
    return pytest.raises(error, match='.*'.join(re.escape(piece) for piece in pieces))


def make(platform, bodies=((0, 1, 2, 3), (4, 5, 6, 7)), explicitMass=None, integrator=None):
    """A Context that has made a few steps, and its integrator."""
    system = openmm.System()
    for _ in range(8):
        system.addParticle(1)
    if integrator is None:
        integrator = Integrator(300, 0.001)
        for body in bodies:
            if explicitMass is None:
                integrator.addRigidBody(body)
            else:
                integrator.addRigidBody(body, explicitMass, (1, 1, 1), SHAPE[:len(body)])
    context = openmm.Context(system, integrator, platform)
    context.setPositions(np.concatenate([SHAPE, SHAPE + 1]))
    context.setVelocitiesToTemperature(300, 1)
    integrator.step(3)
    return context, integrator


def state_xml(context):
    return openmm.XmlSerializer.serialize(
        context.getState(getPositions=True, getVelocities=True, getIntegratorParameters=True))


def load_xml(context, xml):
    context.setState(openmm.XmlSerializer.deserialize(xml))


# ---- XML of the integrator -----------------------------------------------------------------------


@pytest.fixture(scope='module')
def xml():
    integrator = Integrator(300, 0.001)
    integrator.addRigidBody([0, 1], 2, (0, 1, 1), [(-0.1, 0, 0), (0.1, 0, 0)])
    return openmm.XmlSerializer.serialize(integrator)


@pytest.mark.parametrize(
    'pattern, replacement, pieces',
    [(r' friction="[^"]*"', '',
      ["property 'friction' is missing", 'every property must be present']),
     (r' temperature="[^"]*"', ' temperature="warm"',
      ["property 'temperature' is 'warm'", 'it must be a number']),
     (r' randomSeed="[^"]*"', ' randomSeed="0.5"',
      ["property 'randomSeed' is '0.5'", 'it must be an integer']),
     (r' scheme="[^"]*"', ' scheme="LangevinZ"',
      ["property 'scheme' is 'LangevinZ'", 'it must be one of']),
     (r' explicit="[^"]*"', ' explicit="2"', ["property 'explicit' is '2'", 'it must be 0 or 1']),
     (r' geometryIsKnown="[^"]*"', ' geometryIsKnown="0"',
      ["property 'geometryIsKnown' is '0'", '1 for an explicit body']),
     (r' version="1"', ' version="99"', ["property 'version' is '99'"]),
     (r'<PrincipalMoments [^>]*/>', '',
      ["the element 'PrincipalMoments' is missing", 'this element must be present']),
     (r'<RigidBodies count="1"', '<RigidBodies count="2"',
      ['it has 1 elements', "it must have 2, as its property 'count' says"]),
     (r' temperature="[^"]*"', ' temperature="-1"',
      ['temperature is -1 K', 'finite and not negative']),])
def test_damaged_xml_of_an_integrator(xml, pattern, replacement, pieces):
    damaged, count = re.subn(pattern, replacement, xml, count=1)
    assert count == 1
    with refused(*pieces):
        openmm.XmlSerializer.deserialize(damaged)


def test_damaged_xml_names_element_and_remedy(xml):
    with refused("XML element '",
                 'the file is damaged or foreign, write it anew with XmlSerializer'):
        openmm.XmlSerializer.deserialize(re.sub(' friction="[^"]*"', '', xml))


# ---- Checkpoints ---------------------------------------------------------------------------------


def test_a_foreign_checkpoint(platform):
    context, _ = make(platform)
    foreign, _ = make(platform, integrator=openmm.LangevinMiddleIntegrator(300, 1, 0.001))
    with refused('the checkpoint was not written by this integrator',
                 'use a checkpoint of this integrator, or a State'):
        context.loadCheckpoint(foreign.createCheckpoint())


def test_checkpoints_cut_short(platform):
    context, _ = make(platform)
    checkpoint = context.createCheckpoint()
    start = checkpoint.index(MARK)
    for end in range(start, len(checkpoint), 5):
        with pytest.raises(Exception):
            context.loadCheckpoint(checkpoint[:end])
    with refused('the checkpoint is corrupt: its header is damaged; use another'):
        context.loadCheckpoint(checkpoint[:start + 12])
    with refused('the checkpoint is corrupt: it ends too early; use another checkpoint'):
        context.loadCheckpoint(checkpoint[:start + 60])


def test_checkpoints_with_a_flipped_bit(platform):
    context, _ = make(platform)
    checkpoint = context.createCheckpoint()
    start = checkpoint.index(MARK)
    (length,) = struct.unpack_from('<Q', checkpoint, start + 8)
    for place in range(start + 24, start + 24 + length, 11):
        damaged = bytearray(checkpoint)
        damaged[place] ^= 4
        with refused('the checkpoint is corrupt: its check sum does not match'):
            context.loadCheckpoint(bytes(damaged))
    huge = checkpoint[:start + 8] + struct.pack('<Q', 2**60) + checkpoint[start + 16:]
    with refused('the checkpoint is corrupt: its header is damaged'):
        context.loadCheckpoint(huge)
    context.loadCheckpoint(checkpoint)


# ---- States --------------------------------------------------------------------------------------


def test_a_state_of_another_integrator(platform):
    context, _ = make(platform)
    xml = state_xml(context)
    with refused("the State's integrator parameters belong to another integrator",
                 'getIntegratorParameters=False'):
        load_xml(context, re.sub('RigidBodyState', 'NoseHooverChain', xml))


def test_a_state_without_integrator_parameters_serves(platform):
    context, integrator = make(platform)
    before = integrator.getBodyPositions()._value
    context.setState(context.getState(getPositions=True, getVelocities=True))
    assert np.abs(integrator.getBodyPositions()._value - before).max() < 1e-12
    integrator.step(1)


def test_a_state_of_another_version(platform):
    context, _ = make(platform)
    with refused('the State has version 7',
                 'of the body state, but this library reads versions 1 to 4'):
        load_xml(
            context,
            re.sub('(<RigidBodyState[^>]*) version="3"', r'\1 version="7"', state_xml(context)))


@pytest.mark.parametrize('pattern, replacement',
                         [(' seed="[^"]*"', ''), (' velocitiesHash="[^"]*"', ' velocitiesHash="x"'),
                          (' qw="[^"]*"', ''), (' mass="[^"]*"', ''), ('<Bodies>', '<Corpses>')])
def test_a_damaged_state(platform, pattern, replacement):
    context, _ = make(platform)
    damaged, count = re.subn(pattern, replacement, state_xml(context), count=1)
    assert count == 1
    damaged = damaged.replace('</Bodies>', '</Corpses>') if 'Corpses' in replacement else damaged
    with refused("the State's integrator parameters are corrupt (", 'use another State'):
        load_xml(context, damaged)


def test_a_state_with_a_number_that_is_not_finite(platform):
    context, _ = make(platform)
    with refused('body 0: the saved state is corrupt: it has a non-finite number; use another'):
        load_xml(context, re.sub(' qw="[^"]*"', ' qw="nan"', state_xml(context), count=1))


@pytest.mark.parametrize('save', [lambda context: context.createCheckpoint(), state_xml])
def test_a_state_of_other_bodies(platform, save):
    def load(context, saved):
        context.loadCheckpoint(saved) if isinstance(saved, bytes) else load_xml(context, saved)

    saved = save(make(platform)[0])
    with refused('the saved state has 2 bodies, but this integrator has 1',
                 'load it into an integrator with the same bodies'):
        load(make(platform, bodies=[(0, 1, 2, 3)])[0], saved)
    with refused(
            'body 1: the saved state has 4 particles for this body, but this integrator has 3'):
        load(make(platform, bodies=[(0, 1, 2, 3), (4, 5, 6)])[0], saved)
    heavy = save(make(platform, explicitMass=2)[0])
    with refused('body 0 was saved with another shape or mass than this integrator gives it'):
        load(make(platform, explicitMass=1)[0], heavy)


# ---- Body-state files ----------------------------------------------------------------------------


def run_with_reporter(path, bodies, append=False):
    context, integrator = make(openmm.Platform.getPlatformByName('Reference'), bodies)
    reporter = openmmrigidhi.app.RigidBodyReporter(path, 1, append=append)

    class Simulation:
        currentStep = 3

    Simulation.context = context
    reporter.report(Simulation, context.getState())


def test_a_body_state_file_of_other_bodies(tmp_path):
    path = tmp_path/'bodies.h5'
    run_with_reporter(path, [(0, 1, 2, 3), (4, 5, 6, 7)])
    with refused('RigidBodyReporter', 'it holds other bodies (2) than the integrator (1)',
                 'write to another file', error=ValueError):
        run_with_reporter(path, [(0, 1, 2, 3)], append=True)


def test_what_is_no_body_state_file(tmp_path):
    import h5py
    path = tmp_path/'other.h5'
    h5py.File(path, 'w').close()
    with refused('give a file that a RigidBodyReporter wrote', error=ValueError):
        openmmrigidhi.app.readBodyStates(path)
