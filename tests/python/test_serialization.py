"""Every setting survives XML, copies and pickles. Damaged files are refused, and copies are working
objects."""
import copy
import gc
import pickle
import re

import numpy as np
import openmm
import pytest
from openmm import unit

from openmmrigidhi import CustomRigidHIIntegrator
from openmmrigidhi.integrator import Scheme
from scenes import dumbbells

SITES = [(0, 0, -1/30), (0.1, 1/7, 0.1)]

#: For every property: setter, getter, a value that is not the default.
PROPERTIES = [
    ('setTemperature', 'getTemperature', 1000/3*unit.kelvin),
    ('setStepSize', 'getStepSize', 0.001/3*unit.picosecond),
    ('setConstraintTolerance', 'getConstraintTolerance', 1e-7/3),
    ('setIntegrationForceGroups', 'getIntegrationForceGroups', 5),
    *[('setScheme', 'getScheme', scheme) for scheme in Scheme],
    ('setNoiseLaw', 'getNoiseLaw', CustomRigidHIIntegrator.Gaussian),
    ('setNoiseLaw', 'getNoiseLaw', CustomRigidHIIntegrator.ThreePoint),
    ('setNoiseLaw', 'getNoiseLaw', CustomRigidHIIntegrator.TwoPoint),
    ('setFriction', 'getFriction', 1/7/unit.picosecond),
    ('setRotationalFriction', 'getRotationalFriction', 1e20/3/unit.picosecond),
    ('setInertiaScale', 'getInertiaScale', 20/3),
    ('setGradientRelaxationTime', 'getGradientRelaxationTime', 1e-9/3*unit.picosecond),
    ('setGradientRotationalRelaxationTime', 'getGradientRotationalRelaxationTime',
     0.01/3*unit.picosecond), ('setRandomNumberSeed', 'getRandomNumberSeed', -2**31),
    ('setPoseTolerance', 'getPoseTolerance', 0.01/3*unit.nanometer),
    ('setMaximumRejections', 'getMaximumRejections', 17),
    ('setNumHostThreads', 'getNumHostThreads', 3),
    ('setWallRejection', 'getWallRejection', CustomRigidHIIntegrator.Crossing),
    ('setDriftCorrectorScaling', 'getDriftCorrectorScaling', CustomRigidHIIntegrator.Whole),
    ('setFiniteDifferenceStep', 'getFiniteDifferenceStep', 1e-4/3),
    ('setJointTolerance', 'getJointTolerance', 1e-8/3*unit.nanometer),
]
#: Properties that files of earlier versions do not have: the getter, and the default.
NEWER = {
    'inertiaScale': ('getInertiaScale', 1),
    'maximumRejections': ('getMaximumRejections', 100),
    'numHostThreads': ('getNumHostThreads', 0),
    'finiteDifferenceStep': ('getFiniteDifferenceStep', 0),
    'driftCorrectorScaling': ('getDriftCorrectorScaling', CustomRigidHIIntegrator.SlipOnly),
    'wallRejection': ('getWallRejection', CustomRigidHIIntegrator.Overlap),
    'jointTolerance': ('getJointTolerance', 1e-10*unit.nanometer)
}


def make():
    """Every kind of body: implicit, explicit, with and without frictions of its own."""
    integrator = CustomRigidHIIntegrator(300, 0.002)
    integrator.addRigidBody([7, 2, 9])
    integrator.addRigidBody([3, 4], 4/3, (1/3, 1/7, 2/7), SITES)
    integrator.addRigidBody([11])
    integrator.setBodyFriction(2, 1/3, 0)
    integrator.addRigidBody([12], 0, (0, 0, 0), [(0, 0, 0)])
    integrator.setBodyFriction(3, 0, 1/9)
    return integrator


def throughXml(integrator):
    return CustomRigidHIIntegrator.cast(
        openmm.XmlSerializer.deserialize(openmm.XmlSerializer.serialize(integrator)))


COPIES = {
    'xml': throughXml,
    'copy': copy.copy,
    'deepcopy': copy.deepcopy,
    'pickle': lambda integrator: pickle.loads(pickle.dumps(integrator)),
    'clone': lambda integrator: CustomRigidHIIntegrator.cast(openmm.XmlSerializer.clone(integrator))
}


@pytest.fixture(params=COPIES)
def duplicate(request):
    """Each way to make a copy."""
    return COPIES[request.param]


def assertSameBodies(a, b):
    assert a.getNumRigidBodies() == b.getNumRigidBodies()
    for index in range(a.getNumRigidBodies()):
        assert a.getRigidBodyParticles(index) == b.getRigidBodyParticles(index)
        assert a.getRigidBodyIsExplicit(index) == b.getRigidBodyIsExplicit(index)
        assert a.getRigidBodyGeometryIsKnown(index) == b.getRigidBodyGeometryIsKnown(index)
        assert a.getBodyHasOwnFriction(index) == b.getBodyHasOwnFriction(index)
        assert a.getBodyFriction(index) == b.getBodyFriction(index)
        if a.getRigidBodyGeometryIsKnown(index):
            for x, y in zip(a.getRigidBodyParameters(index), b.getRigidBodyParameters(index)):
                assert np.all(x == y)


# ---- What survives -------------------------------------------------------------------------------


@pytest.mark.parametrize('setter, getter, value', PROPERTIES,
                         ids=[f'{p[0]}-{p[2]}' for p in PROPERTIES])
def test_every_property_survives(setter, getter, value, duplicate):
    integrator = make()
    getattr(integrator, setter)(value)
    result = duplicate(integrator)
    assert getattr(result, getter)() == value
    assert openmm.XmlSerializer.serialize(result) == openmm.XmlSerializer.serialize(integrator)


def test_every_setter_is_in_the_list_of_properties():
    """A new setting cannot be forgotten here.

    Setters in `others` act on bodies or on the state of a Context.
    """
    others = {
        'setBodyPositions', 'setBodyOrientations', 'setBodyVelocities', 'setBodyAngularVelocities',
        'setRigidBodyParameters', 'setBodyFriction', 'setBodyHeld', 'setParticleHeld',
        'setHingeMotorRate'
    }
    setters = {name for name in dir(CustomRigidHIIntegrator) if name.startswith('set')}
    assert setters - others == {setter for setter, _, _ in PROPERTIES}


def test_every_kind_of_body_survives(duplicate):
    integrator = make()
    assertSameBodies(integrator, duplicate(integrator))
    assertSameBodies(CustomRigidHIIntegrator(300, 0.001),
                     duplicate(CustomRigidHIIntegrator(300, 0.001)))


def test_geometry_that_was_derived_survives(duplicate, waterBox, platform):
    integrator = waterBox.integrator()
    simulation = waterBox.simulation(platform, integrator)
    integrator.getBodyPositions()
    result = duplicate(integrator)
    assert result.getRigidBodyGeometryIsKnown(0) and not result.getRigidBodyIsExplicit(0)
    assertSameBodies(integrator, result)
    result.resetBodyGeometry()
    assert not result.getRigidBodyGeometryIsKnown(0)
    assert integrator.getRigidBodyGeometryIsKnown(0)


# ---- Copies are working objects ------------------------------------------------------------------


def test_copies_are_of_our_class_and_independent(duplicate):
    integrator = make()
    result = duplicate(integrator)
    assert type(result) is CustomRigidHIIntegrator and isinstance(result, openmm.Integrator)
    assert CustomRigidHIIntegrator.cast(result) is result
    result.setTemperature(77)
    result.addRigidBody([50])
    assert integrator.getTemperature() == 300*unit.kelvin and integrator.getNumRigidBodies() == 4
    del integrator
    gc.collect()
    assert result.getNumRigidBodies() == 5


def test_copies_run_as_the_original_does(duplicate, waterBox):
    platform = openmm.Platform.getPlatformByName('Reference')
    integrator = waterBox.integrator()
    result = duplicate(integrator)
    positions = []
    for each in (integrator, result):
        simulation = waterBox.simulation(platform, each)
        simulation.context.setVelocitiesToTemperature(300, 5)
        simulation.step(5)
        positions.append(
            simulation.context.getState(getPositions=True).getPositions(asNumpy=True)._value)
    assert np.array_equal(*positions)


def test_a_bound_integrator_copies_as_unbound(duplicate, platform):
    system, positions, definitions = dumbbells(1)
    integrator = CustomRigidHIIntegrator(300, 0.002)
    integrator.addRigidBody(*definitions[0])
    context = openmm.Context(system, integrator, platform)
    context.setPositions(positions)
    result = duplicate(integrator)
    with pytest.raises(openmm.OpenMMException, match='needs a Context'):
        result.getBodyPositions()
    integrator.step(1)


class Named(CustomRigidHIIntegrator):
    """A user's class with an attribute of its own."""
    def __init__(self, name):
        super().__init__(300, 0.002)
        self.name = name


@pytest.mark.parametrize('way', ['copy', 'deepcopy', 'pickle'])
def test_subclasses_keep_their_class_and_attributes(way):
    integrator = Named(['a'])
    result = COPIES[way](integrator)
    assert type(result) is Named and result.name == ['a']
    assert (result.name is integrator.name) == (way == 'copy')
    result.setTemperature(1)


def test_systems_and_simulations_deserialize_ours(tmp_path, waterBox, platform):
    """app.Simulation takes the name of an XML file for the integrator."""
    path = tmp_path/'integrator.xml'
    path.write_text(openmm.XmlSerializer.serialize(waterBox.integrator()))
    simulation = openmm.app.Simulation(waterBox.topology, waterBox.system, str(path), platform)
    simulation.context.setPositions(waterBox.positions)
    simulation.step(2)
    integrator = CustomRigidHIIntegrator.cast(simulation.integrator)
    assert integrator.getStepStatistics()['steps'] == 2


def test_cast_moves_ownership_and_keeps_both_alive():
    generic = openmm.XmlSerializer.clone(make())
    assert type(generic) is openmm.Integrator
    result = CustomRigidHIIntegrator.cast(generic)
    assert result.thisown and not generic.thisown
    assert CustomRigidHIIntegrator.cast(generic) is result
    del result
    gc.collect()
    assert generic.getStepSize() == 0.002*unit.picosecond
    result = CustomRigidHIIntegrator.cast(generic)
    del generic
    gc.collect()
    assert result.getNumRigidBodies() == 4


def test_cast_of_what_another_object_owns_does_not_own():
    compound = openmm.CompoundIntegrator()
    compound.addIntegrator(make())
    part = CustomRigidHIIntegrator.cast(compound.getIntegrator(0))
    assert not part.thisown and part.getNumRigidBodies() == 4


def test_copies_leak_nothing():
    """Hundreds of copies are each freed once, immediately. A double free would crash, and a leak
    would grow."""
    import resource
    integrator = CustomRigidHIIntegrator(300, 0.002)
    integrator.addRigidBody(range(1000), 1.0, (1, 1, 1), np.zeros((1000, 3)))  # about 30 kB

    def copies(count):
        for _ in range(count):
            CustomRigidHIIntegrator.cast(openmm.XmlSerializer.clone(integrator))
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    before = copies(50)
    assert copies(500) - before < 5000  # kB; leaking every copy would take 15000


# ---- Damaged and foreign files -------------------------------------------------------------------


def xml(integrator=None):
    return openmm.XmlSerializer.serialize(integrator or make())


def test_a_file_cut_short_is_refused_or_whole():
    """A file is cut after every element.

    OpenMM 7.7's own XML parser reads beyond the end of a text that stops inside a tag (found with
    AddressSanitizer, also for its own integrators). So nothing is promised for such texts.
    """
    whole = xml()
    lengths = [match.end() for match in re.finditer('>', whole)]
    assert len(lengths) > 20
    for length in lengths:
        try:
            result = openmm.XmlSerializer.deserialize(whole[:length])
        except (openmm.OpenMMException, ValueError):
            continue
        assert openmm.XmlSerializer.serialize(result) == whole, length


@pytest.mark.parametrize('attribute',
                         sorted(set(re.findall(r' (\w+)="', xml())) - {'type', 'openmmVersion'}))
def test_a_missing_property_is_refused_by_name(attribute):
    damaged, count = re.subn(rf' {attribute}="[^"]*"', '', xml())
    assert count > 0
    if attribute in NEWER:
        getter, default = NEWER[attribute]
        assert getattr(CustomRigidHIIntegrator.cast(openmm.XmlSerializer.deserialize(damaged)),
                       getter)() == default
        return
    if attribute in ('friction', 'rotationalFriction'):
        damaged = re.sub(rf'(<RigidBody [^>]*) {attribute}="[^"]*"', r'\1', xml())
    with pytest.raises(openmm.OpenMMException, match=f"'{attribute}'"):
        openmm.XmlSerializer.deserialize(damaged)


@pytest.mark.parametrize('garbage', ['', 'abc', '1x', '--1', '1e', '0x10', '1,5', ' 1'])
@pytest.mark.parametrize('attribute',
                         sorted(set(re.findall(r' (\w+)="', xml())) - {'type', 'openmmVersion'}))
def test_a_property_that_is_no_number_or_name_is_refused(attribute, garbage):
    damaged = re.sub(rf' {attribute}="[^"]*"', f' {attribute}="{garbage}"', xml())
    with pytest.raises(openmm.OpenMMException,
                       match=f"property '{attribute}' is '{re.escape(garbage)}'"):
        openmm.XmlSerializer.deserialize(damaged)


@pytest.mark.parametrize(
    'before, after, message',
    [('version="1"', 'version="3"', "property 'version' is '3'; it must be 1 or 2"),
     ('temperature="300"', 'temperature="-300"', 'temperature is -300'),
     ('temperature="300"', 'temperature="nan"', 'temperature is nan'),
     ('stepSize=".002"', 'stepSize="0"', 'step size is 0'),
     ('scheme="LangevinC"', 'scheme="LangevinD"', 'one of DriftCorrectorFD, DriftCorrectorRFD'),
     ('noiseLaw="Gaussian"', 'noiseLaw="2"', 'one of Gaussian, ThreePoint'),
     ('randomSeed="0"', 'randomSeed="99999999999"', "property 'randomSeed'"),
     ('index="4"', 'index="7"', 'particle 7 is already in body 0'),
     ('index="9"', 'index="2"', 'particle 2 is named twice'),
     ('index="9"', 'index="-9"', 'particle index -9 is negative'),
     ('<RigidBodies count="4">', '<RigidBodies count="5">', 'it has 4 elements; it must have 5'),
     ('<Particles count="3">', '<Particles count="2">', 'it has 3 elements; it must have 2'),
     ('explicit="1" geometryIsKnown="1"', 'explicit="1" geometryIsKnown="0"', 'geometryIsKnown'),
     ('explicit="1"', 'explicit="7"', "property 'explicit' is '7'; it must be 0 or 1"),
     ('RigidBodies', 'Bodies', "the element 'RigidBodies' is missing"),
     ('Particles', 'Atoms', "the element 'Particles' is missing"),
     ('PrincipalMoments', 'Moments', "the element 'PrincipalMoments' is missing"),
     ('x=".3333', 'x="7.3333', 'triangle inequality'),
     ('type="CustomRigidHIIntegrator"', 'type="Nonsense"', 'Nonsense'),
     ('type="CustomRigidHIIntegrator"', '', 'type')])
def test_a_wrong_value_is_refused_with_the_reason(before, after, message):
    assert before in xml()
    with pytest.raises(openmm.OpenMMException,
                       match=re.escape(message) if "'" in message else message):
        openmm.XmlSerializer.deserialize(xml().replace(before, after))


# ---- What is held --------------------------------------------------------------------------------


def holding():
    integrator = make()
    integrator.setBodyHeld(1, True)
    integrator.setBodyHeld(2, True)
    integrator.setBodyHeld(2, False)
    for particle in (20, 3, 17):
        integrator.setParticleHeld(particle, True)
    integrator.setParticleHeld(3, False)
    return integrator


def test_what_is_held_survives(duplicate):
    result = duplicate(holding())
    assert [result.getBodyHeld(i) for i in range(4)] == [False, True, False, False]
    assert result.getHeldParticles() == [17, 20]
    assert result.getParticleHeld(20) and not result.getParticleHeld(3)
    assert xml(result) == xml(holding())


@pytest.mark.parametrize('hold', [
    lambda integrator: integrator.setBodyHeld(3, True),
    lambda integrator: integrator.setParticleHeld(0, True)
])
def test_only_files_with_something_held_have_the_newer_version(hold):
    """Earlier versions of the library can read all other files."""
    integrator = make()
    before = xml(integrator)
    assert ' version="1"' in before and 'eld' not in before
    hold(integrator)
    assert ' version="2"' in xml(integrator)
    integrator.setBodyHeld(3, False)
    integrator.setParticleHeld(0, False)
    assert xml(integrator) == before


@pytest.mark.parametrize(
    'before, after, message',
    [(' held="1"', '', "property 'held' is missing"),
     (' held="1"', ' held="2"', "property 'held' is '2'; it must be 0 or 1"),
     ('HeldParticles', 'Particles', "the element 'HeldParticles' is missing"),
     ('<HeldParticles count="2">', '<HeldParticles count="3">', 'it has 2 elements; it must have'),
     ('index="20"', 'index="-20"', "the particle's index is -20; it must not be negative")])
def test_damaged_files_with_something_held_are_refused(before, after, message):
    assert before in xml(holding())
    with pytest.raises(openmm.OpenMMException, match=re.escape(message)):
        openmm.XmlSerializer.deserialize(xml(holding()).replace(before, after))


# ---- Foreign files -------------------------------------------------------------------------------


@pytest.mark.parametrize('foreign', [
    '', 'no xml', '<Integrator/>', '<Integrator type="CustomRigidHIIntegrator"/>',
    '<Integrator type="CustomRigidHIIntegrator" version="1"/>', '<Nonsense/>', '\x00\x01'
])
def test_foreign_text_is_refused(foreign):
    with pytest.raises((openmm.OpenMMException, ValueError)):
        openmm.XmlSerializer.deserialize(foreign)


def test_another_integrator_file_is_not_ours():
    other = openmm.XmlSerializer.deserialize(
        openmm.XmlSerializer.serialize(openmm.VerletIntegrator(0.001)))
    with pytest.raises(TypeError, match='cast'):
        CustomRigidHIIntegrator.cast(other)


def test_a_damaged_pickle_is_refused():
    damaged = pickle.dumps(make()).replace(b'CustomRigidHIIntegrator" version="1"',
                                           b'CustomRigidHIIntegrator" version="9"')
    with pytest.raises(openmm.OpenMMException, match='version'):
        pickle.loads(damaged)


# ---- States and checkpoints through Simulation ---------------------------------------------------


def test_xml_of_system_integrator_and_state_resumes_bit_for_bit(waterBox):
    """A run that is saved as XML only and rebuilt from it continues the first on Reference."""
    platform = openmm.Platform.getPlatformByName('Reference')
    simulation = waterBox.simulation(platform)
    simulation.context.setVelocitiesToTemperature(300, 2)
    simulation.step(3)
    state = simulation.context.getState(getPositions=True, getVelocities=True, getParameters=True,
                                        getIntegratorParameters=True)
    saved = [
        openmm.XmlSerializer.serialize(x) for x in (simulation.system, simulation.integrator, state)
    ]
    simulation.step(4)
    system, integrator, state = [openmm.XmlSerializer.deserialize(x) for x in saved]
    integrator = CustomRigidHIIntegrator.cast(integrator)
    context = openmm.Context(system, integrator, platform)
    context.setState(state)
    integrator.step(4)
    expected, got = [
        c.getState(getPositions=True, getVelocities=True) for c in (simulation.context, context)
    ]
    assert np.array_equal(
        expected.getPositions(asNumpy=True)._value,
        got.getPositions(asNumpy=True)._value)
    assert np.array_equal(
        expected.getVelocities(asNumpy=True)._value,
        got.getVelocities(asNumpy=True)._value)
    assert np.array_equal(simulation.integrator.getBodyOrientations(),
                          integrator.getBodyOrientations())


def test_a_checkpoint_cut_short_is_refused(waterBox, platform):
    simulation = waterBox.simulation(platform)
    simulation.step(1)
    checkpoint = simulation.context.createCheckpoint()
    for removed in (1, 8, 100):
        with pytest.raises(openmm.OpenMMException):
            simulation.context.loadCheckpoint(checkpoint[:-removed])
    simulation.context.loadCheckpoint(checkpoint)
    simulation.step(1)
