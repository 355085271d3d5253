"""The Python API of CustomRigidHIIntegrator: units, shapes, constants, and that bad input is
refused with a reason."""
import enum
import gc
import os
import shutil
import subprocess
import sys

import numpy as np
import openmm
import pytest
from openmm import unit

import openmmrigidhi
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce
from scenes import dumbbells

SITES = [(0, 0, -0.1), (0, 0, 0.1)]


def make():
    return CustomRigidHIIntegrator(300, 0.002)


def makeWithBodies():
    """Body 0 is implicit, body 1 explicit."""
    integrator = make()
    integrator.addRigidBody([0, 1, 2])
    integrator.addRigidBody([3, 4], 4.0, (0.04, 0.04, 0.0), SITES)
    return integrator


def bound(platform, count=2):
    system, positions, definitions = dumbbells(count)
    integrator = make()
    for definition in definitions:
        integrator.addRigidBody(*definition)
    context = openmm.Context(system, integrator, platform)
    context.setPositions(positions)
    return integrator, context


# ---- Numbers and quantities ----------------------------------------------------------------------

#: setter, getter, argument name, value as a quantity in another unit than this library's, the same
#: value as a plain number
SCALARS = [('setTemperature', 'getTemperature', 'temperature', 250*unit.kelvin, 250.0),
           ('setFriction', 'getFriction', 'gamma', 5/unit.nanosecond, 0.005),
           ('setRotationalFriction', 'getRotationalFriction', 'Gamma', 7/unit.nanosecond, 0.007),
           ('setGradientRelaxationTime', 'getGradientRelaxationTime', 'upsilon', 3*unit.femtosecond,
            0.003),
           ('setGradientRotationalRelaxationTime', 'getGradientRotationalRelaxationTime', 'Upsilon',
            2*unit.femtosecond, 0.002),
           ('setPoseTolerance', 'getPoseTolerance', 'tolerance', 0.03*unit.angstrom, 0.003),
           ('setInertiaScale', 'getInertiaScale', 'factor', 20/3*unit.dimensionless, 20/3),
           ('setStepSize', 'getStepSize', 'size', 3*unit.femtosecond, 0.003),
           ('setConstraintTolerance', 'getConstraintTolerance', 'tolerance',
            1e-7*unit.dimensionless, 1e-7),]
NAMES = [entry[0] for entry in SCALARS]


def plain(value):
    return value._value if unit.is_quantity(value) else value


def test_constructor_takes_numbers_and_quantities():
    for integrator in (CustomRigidHIIntegrator(300, 0.004),
                       CustomRigidHIIntegrator(300*unit.kelvin, 4*unit.femtosecond),
                       CustomRigidHIIntegrator(temperature=np.float32(300),
                                               stepSize=np.float64(0.004))):
        assert integrator.getTemperature() == 300*unit.kelvin
        assert integrator.getStepSize().value_in_unit(unit.femtosecond) == pytest.approx(
            4, rel=1e-12)
    assert isinstance(integrator, openmm.Integrator)


def test_defaults_are_the_documented_ones():
    integrator = make()
    assert integrator.getScheme() == CustomRigidHIIntegrator.LangevinC
    assert integrator.getNoiseLaw() == CustomRigidHIIntegrator.Gaussian
    assert plain(integrator.getFriction()) == plain(integrator.getRotationalFriction()) == 1
    assert plain(integrator.getGradientRelaxationTime()) == 0.004
    assert plain(integrator.getGradientRotationalRelaxationTime()) == 0.001
    assert plain(integrator.getPoseTolerance()) == 2e-3
    assert integrator.getInertiaScale() == 1
    assert integrator.getRandomNumberSeed() == 0


@pytest.mark.parametrize('setter, getter, name, quantity, number', SCALARS, ids=NAMES)
def test_setters_take_numbers_and_quantities(setter, getter, name, quantity, number):
    for value in (quantity, number, np.float64(number), np.array(number)):
        integrator = make()
        getattr(integrator, setter)(value)
        assert plain(getattr(integrator, getter)()) == pytest.approx(number, rel=1e-12)


def test_setters_take_integers():
    integrator = make()
    integrator.setTemperature(np.int32(3))
    assert integrator.getTemperature() == 3*unit.kelvin


@pytest.mark.parametrize('setter, getter, name, quantity, number', SCALARS, ids=NAMES)
def test_wrong_dimensions_are_refused_by_name(setter, getter, name, quantity, number):
    with pytest.raises(TypeError, match=f'{setter}: {name}: got a quantity in volt'):
        getattr(make(), setter)(5*unit.volt)


def test_a_length_is_no_temperature():
    with pytest.raises(TypeError,
                       match='temperature: got a quantity in nanometer; it must be kelvin'):
        CustomRigidHIIntegrator(5*unit.nanometer, 0.002)
    with pytest.raises(TypeError, match='stepSize'):
        CustomRigidHIIntegrator(300, 0.002*unit.nanometer)


@pytest.mark.parametrize(
    'value', ['1', None, [1], True, 1j, object(),
              (300*unit.kelvin,)], ids=lambda value: type(value).__name__)
@pytest.mark.parametrize('setter', NAMES)
def test_what_is_no_number_is_refused_by_name(setter, value):
    with pytest.raises(TypeError, match=setter):
        getattr(make(), setter)(value)


@pytest.mark.parametrize('value', [-1.0, np.nan, np.inf, -np.inf])
@pytest.mark.parametrize('setter', NAMES)
def test_negative_and_non_finite_settings_are_refused(setter, value):
    with pytest.raises(openmm.OpenMMException, match='must be finite and'):
        getattr(make(), setter)(value)


@pytest.mark.parametrize('setter', [
    'setGradientRelaxationTime', 'setGradientRotationalRelaxationTime', 'setPoseTolerance',
    'setInertiaScale', 'setStepSize', 'setConstraintTolerance'
])
def test_zero_is_refused_where_it_means_nothing(setter):
    with pytest.raises(openmm.OpenMMException, match='must be finite and positive'):
        getattr(make(), setter)(0)


def test_a_refused_setting_leaves_the_old_one():
    integrator = make()
    with pytest.raises(openmm.OpenMMException):
        integrator.setTemperature(-1)
    assert integrator.getTemperature() == 300*unit.kelvin


def test_constructor_refuses_bad_values():
    for arguments in ((-1, 0.002), (np.nan, 0.002), (300, 0), (300, -0.002), (300, np.inf)):
        with pytest.raises(openmm.OpenMMException):
            CustomRigidHIIntegrator(*arguments)


def test_friction_has_a_setter_of_its_own():
    """Langevin integrators of OpenMM take (temperature, friction, stepSize)."""
    for arguments, named in (((300, 1, 0.002), {}), ((300, 0.002), {'frictionCoeff': 1})):
        with pytest.raises(TypeError,
                           match='takes a temperature and a step size only.*setFriction'):
            CustomRigidHIIntegrator(*arguments, **named)


# ---- Constants -----------------------------------------------------------------------------------


@pytest.mark.parametrize('name', [scheme.name for scheme in openmmrigidhi.integrator.Scheme])
def test_schemes_are_class_constants(name):
    integrator = make()
    integrator.setScheme(getattr(CustomRigidHIIntegrator, name))
    assert integrator.getScheme() == getattr(CustomRigidHIIntegrator, name)
    assert integrator.getScheme().name == name
    integrator.setScheme(int(integrator.getScheme()))


@pytest.mark.parametrize('name', ['Gaussian', 'ThreePoint', 'TwoPoint'])
def test_noise_laws_are_class_constants(name):
    integrator = make()
    integrator.setNoiseLaw(getattr(CustomRigidHIIntegrator, name))
    assert integrator.getNoiseLaw().name == name


@pytest.mark.parametrize('value', [-1, 17, 2**31 - 1])
def test_unknown_constants_are_refused(value):
    with pytest.raises(openmm.OpenMMException, match='LangevinA'):
        make().setScheme(value)
    with pytest.raises(openmm.OpenMMException, match='ThreePoint'):
        make().setNoiseLaw(value)


def test_constants_of_another_kind_are_refused():
    with pytest.raises(TypeError, match='LangevinA'):
        make().setScheme(CustomRigidHIIntegrator.Gaussian)
    with pytest.raises(TypeError, match='ThreePoint'):
        make().setNoiseLaw(CustomRigidHIIntegrator.LangevinC)
    for value in (2.0, None, True):
        with pytest.raises(TypeError, match='it must be a Scheme'):
            make().setScheme(value)


#: class, setter, getter, enumeration
CHOICES = [
    (CustomRigidHIIntegrator, 'setScheme', 'getScheme', CustomRigidHIIntegrator.Scheme),
    (CustomRigidHIIntegrator, 'setNoiseLaw', 'getNoiseLaw', CustomRigidHIIntegrator.NoiseLaw),
    (CustomRigidHIIntegrator, 'setWallRejection', 'getWallRejection',
     CustomRigidHIIntegrator.WallRejection),
    (CustomRigidHIIntegrator, 'setDriftCorrectorScaling', 'getDriftCorrectorScaling',
     CustomRigidHIIntegrator.DriftCorrectorScaling),
    (MobilityForce, 'setModel', 'getModel', MobilityForce.Model),
    (MobilityForce, 'setBoundary', 'getBoundary', MobilityForce.Boundary),
    (MobilityForce, 'setSolver', 'getSolver', MobilityForce.Solver),
    (MobilityForce, 'setSphereWallMobility', 'getSphereWallMobility',
     MobilityForce.SphereWallMobility),
    (MobilityForce, 'setChannelCondition', 'getChannelCondition', MobilityForce.ChannelCondition),
    (MobilityForce, 'setLubrication', 'getLubrication', MobilityForce.Lubrication),
]


@pytest.mark.parametrize('cls, setter, getter, kind', CHOICES, ids=[c[1] for c in CHOICES])
def test_constants_are_taken_by_name(cls, setter, getter, kind):
    made = make() if cls is CustomRigidHIIntegrator else cls()
    for member in kind:
        for name in (member.name, np.str_(member.name)):
            getattr(made, setter)(kind(0))
            getattr(made, setter)(name)
            assert getattr(made, getter)() is member
    with pytest.raises(
            ValueError, match=f"{setter}: .*'Foo' is no {kind.__name__}; the names are "
            f"{', '.join(kind.__members__)}"):
        getattr(made, setter)('Foo')
    assert getattr(made, getter)() is member


def test_the_likeliest_name_comes_first():
    with pytest.raises(ValueError, match='the names are TrapezoidalSlip, LangevinA'):
        make().setScheme('trapezoidal slip')
    with pytest.raises(ValueError, match='the names are StokesianDynamics, FreeDraining'):
        MobilityForce().setModel('Stokesian')


def test_every_enumerator_is_taken_by_name():
    """A new enumeration must be in the list above."""
    for cls in (CustomRigidHIIntegrator, MobilityForce):
        kinds = {value for value in vars(cls).values() if isinstance(value, enum.EnumMeta)}
        assert kinds == {kind for owner, _, _, kind in CHOICES if owner is cls}


# ---- Bodies --------------------------------------------------------------------------------------


@pytest.mark.parametrize('particles',
                         [[5, 7], (5, 7),
                          range(5, 8, 2),
                          np.array([5, 7]),
                          np.array([5, 7], dtype=np.uint8), [np.int64(5), np.int32(7)],
                          iter([5, 7])], ids=lambda p: type(p).__name__)
def test_particles_are_any_sequence_of_integers(particles):
    integrator = make()
    assert integrator.addRigidBody(particles) == 0
    assert integrator.getRigidBodyParticles(0) == [5, 7]
    assert not integrator.getRigidBodyIsExplicit(0)
    assert not integrator.getRigidBodyGeometryIsKnown(0)


@pytest.mark.parametrize('sites', [
    SITES,
    np.array(SITES),
    np.array(SITES, dtype=np.float32),
    np.asfortranarray(SITES), [openmm.Vec3(*s) for s in SITES], 10*np.array(SITES)*unit.angstrom,
    [10*openmm.Vec3(*s)*unit.angstrom
     for s in SITES], [[10*x*unit.angstrom for x in s] for s in SITES],
    unit.Quantity([openmm.Vec3(*s) for s in SITES], unit.nanometer)
], ids=[
    'list', 'array', 'float32', 'fortran', 'Vec3', 'quantity of array', 'list of quantities',
    'nested quantities', 'quantity of list'
])
@pytest.mark.parametrize('moments', [(0.04, 0.04, 0),
                                     openmm.Vec3(0.04, 0.04, 0),
                                     np.array([0.04, 0.04, 0]),
                                     (4, 4, 0)*unit.dalton*unit.angstrom**2,
                                     openmm.Vec3(4, 4, 0)*unit.dalton*unit.angstrom**2],
                         ids=['tuple', 'Vec3', 'array', 'quantity of tuple', 'quantity of Vec3'])
def test_explicit_bodies_come_back_as_given(sites, moments):
    integrator = make()
    index = integrator.addRigidBody([8, 6], 4*unit.dalton, moments, sites)
    particles, mass, gotMoments, gotSites = integrator.getRigidBodyParameters(index)
    assert particles == [8, 6]
    assert mass == 4*unit.dalton
    assert np.allclose(gotMoments.value_in_unit(unit.dalton*unit.nanometer**2), (0.04, 0.04, 0),
                       rtol=1e-6)
    assert gotSites.value_in_unit(unit.nanometer).shape == (2, 3)
    assert np.allclose(gotSites.value_in_unit(unit.nanometer), SITES, rtol=1e-6)
    assert integrator.getRigidBodyIsExplicit(index) and integrator.getRigidBodyGeometryIsKnown(
        index)


def test_explicit_bodies_are_exact_to_the_last_bit():
    integrator = make()
    random = np.random.default_rng(3)
    sites = random.normal(size=(4, 3))
    integrator.addRigidBody(range(4), 1/3, (1/3, 1/7, 2/7), sites)
    _, mass, moments, gotSites = integrator.getRigidBodyParameters(0)
    assert plain(mass) == 1/3 and tuple(plain(moments)) == (1/3, 1/7, 2/7) and np.array_equal(
        plain(gotSites), sites)


def test_single_particles_and_massless_bodies_are_allowed():
    integrator = make()
    integrator.addRigidBody([0], 1.0, (0.1, 0.1, 0.1), [(0, 0, 0)])
    integrator.addRigidBody([1], 0, (0, 0, 0), [(0.3, 0, 0)])
    integrator.addRigidBody([2])
    assert integrator.getNumRigidBodies() == 3


@pytest.mark.parametrize('moments', [(1, 2, 3), (3, 1, 2), (0, 1, 1), (1, 0, 1), (1, 1, 0),
                                     (1e-9, 1, 1), (0, 0, 0)])
def test_moments_of_any_order_are_allowed_up_to_the_triangle_inequality(moments):
    make().addRigidBody([0], 1.0, moments, [(0, 0, 0)])


@pytest.mark.parametrize('moments', [(1, 2, 3.001), (3.001, 1, 2), (0, 0, 1), (0, 1, 2)])
def test_moments_beyond_the_triangle_inequality_are_refused(moments):
    with pytest.raises(openmm.OpenMMException,
                       match='body 0: moments .* violate the triangle inequality'):
        make().addRigidBody([0], 1.0, moments, [(0, 0, 0)])


@pytest.mark.parametrize('particles, message', [([], 'body 2: it has no particles'),
                                                ([-1], 'body 2: particle index -1 is negative'),
                                                ([5, 6, 5], 'body 2: particle 5 is named twice'),
                                                ([5, 1], 'body 2: particle 1 is already in body 0'),
                                                ([4], 'body 2: particle 4 is already in body 1')])
def test_bad_particles_are_refused_naming_body_and_particle(particles, message):
    for explicit in ((), (1.0, (1, 1, 1), np.zeros((len(particles), 3)))):
        integrator = makeWithBodies()
        with pytest.raises(openmm.OpenMMException, match=message):
            integrator.addRigidBody(particles, *explicit)
        assert integrator.getNumRigidBodies() == 2


@pytest.mark.parametrize(
    'particles',
    [3, None, 'ab', [1.0], [1.5], [None],
     np.array([0.0, 1.0]), [[1, 2]], [1*unit.nanometer]], ids=repr)
def test_what_is_no_list_of_integers_is_a_TypeError(particles):
    with pytest.raises(TypeError, match='particles'):
        make().addRigidBody(particles)


def test_indices_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match='particles: got 2147483648'):
        make().addRigidBody([2**31])


@pytest.mark.parametrize('mass, moments, sites, message',
                         [(-1, (1, 1, 1), SITES, 'body 0: mass is -1'),
                          (np.nan, (1, 1, 1), SITES, 'body 0: mass is nan'),
                          (np.inf, (1, 1, 1), SITES, 'body 0: mass is inf'),
                          (1, (1, -1, 1), SITES, 'body 0: moment about y is -1'),
                          (1, (1, 1, np.nan), SITES, 'body 0: moment about z is nan'),
                          (1, (np.inf, 1, 1), SITES, 'body 0: moment about x is inf'),
                          (1, (1, 1, 1), SITES[:1], 'body 0: it has 2 particles but 1 site'),
                          (1, (1, 1, 1), [], 'body 0: it has 2 particles but 0 site'),
                          (1, (1, 1, 1), [(0, 0, 0),
                                          (0, np.nan, 0)], 'body 0: site of particle 1')])
def test_bad_explicit_bodies_are_refused_naming_the_body(mass, moments, sites, message):
    integrator = make()
    with pytest.raises(openmm.OpenMMException, match=message):
        integrator.addRigidBody([0, 1], mass, moments, sites)
    assert integrator.getNumRigidBodies() == 0
    integrator.addRigidBody([0, 1])
    with pytest.raises(openmm.OpenMMException, match=message):
        integrator.setRigidBodyParameters(0, [0, 1], mass, moments, sites)
    assert not integrator.getRigidBodyIsExplicit(0)


@pytest.mark.parametrize(
    'arguments, error, name',
    [((4*unit.nanometer, (1, 1, 1), SITES), TypeError, 'mass'),
     ((4, (1, 1, 1)*unit.nanometer, SITES), TypeError, 'principalMoments'),
     ((4, (1, 1), SITES), ValueError, r'principalMoments: .*shape \(2,\)'),
     ((4, 1, SITES), ValueError, 'principalMoments'),
     ((4, ('a', 'b', 'c'), SITES), TypeError, 'principalMoments'),
     ((4, (1, 1, 1), np.zeros(
         (2, 2))), ValueError, r'sitePositions: .*shape \(2, 2\); the shape must be \(n, 3\)'),
     ((4, (1, 1, 1), (0, 0, 0)), ValueError, 'sitePositions'),
     ((4, (1, 1, 1), [(0, 0, 0), (0, 0)]), ValueError, 'sitePositions'),
     ((4, (1, 1, 1), np.array(SITES)*unit.kelvin), TypeError, 'sitePositions'),
     ((4, (1, 1, 1), [(0, 0, 1*unit.kelvin), (0, 0, 0)]), TypeError, 'sitePositions'),
     ((4, (1, 1, 1), [('0', '0', '0')]*2), TypeError, 'sitePositions'),
     ((4,), TypeError, 'needs all three'), ((4, (1, 1, 1)), TypeError, 'needs all three'),
     ((None, (1, 1, 1), SITES), TypeError, 'needs all three')])
def test_wrong_types_shapes_and_dimensions_of_bodies_are_refused_by_name(arguments, error, name):
    integrator = make()
    with pytest.raises(error, match=name):
        integrator.addRigidBody([0, 1], *arguments)
    assert integrator.getNumRigidBodies() == 0


def test_setting_a_body_gives_up_its_old_particles_and_keeps_its_friction():
    integrator = makeWithBodies()
    integrator.setBodyFriction(0, 3, 4)
    integrator.setRigidBodyParameters(0, [0, 9], 1, (1, 1, 0), SITES)
    assert integrator.getRigidBodyParticles(0) == [0, 9]
    assert integrator.getRigidBodyIsExplicit(0)
    assert [plain(x) for x in integrator.getBodyFriction(0)] == [3, 4]
    assert integrator.addRigidBody([1, 2]) == 2
    with pytest.raises(openmm.OpenMMException, match='particle 9 is already in body 0'):
        integrator.addRigidBody([9])


def test_geometry_that_is_not_known_yet_is_an_error_that_says_what_to_do():
    with pytest.raises(openmm.OpenMMException,
                       match='body 0: its mass, moments and sites are not known.*set positions'):
        makeWithBodies().getRigidBodyParameters(0)


def test_adding_many_bodies_is_linear():
    integrator = make()
    for k in range(50000):
        integrator.addRigidBody([2*k, 2*k + 1])
    assert integrator.getNumRigidBodies() == 50000


# ---- Indices -------------------------------------------------------------------------------------

INDEXED = [('getRigidBodyParameters', ()), ('getRigidBodyParticles', ()),
           ('getRigidBodyIsExplicit', ()), ('getRigidBodyGeometryIsKnown', ()),
           ('setRigidBodyParameters', ([8, 9], 1, (1, 1, 0), SITES)), ('setBodyFriction', (1, 1)),
           ('getBodyFriction', ()), ('getBodyHasOwnFriction', ()), ('clearBodyFriction', ())]


@pytest.mark.parametrize('method, arguments', INDEXED, ids=[name for name, _ in INDEXED])
def test_body_indices_are_checked(method, arguments):
    integrator = makeWithBodies()
    for index in (-1, 2, 1000000):
        with pytest.raises(openmm.OpenMMException, match=f'body index {index} is out of range'):
            getattr(integrator, method)(index, *arguments)
    for index in (0.0, 'a', None, [0]):
        with pytest.raises(TypeError, match='index'):
            getattr(integrator, method)(index, *arguments)
    with pytest.raises(ValueError, match='index'):
        getattr(integrator, method)(2**40, *arguments)
    getattr(integrator, method)(np.int64(1), *arguments)


def test_body_frictions_override_those_of_the_integrator():
    integrator = makeWithBodies()
    integrator.setFriction(5)
    integrator.setRotationalFriction(6)
    assert [plain(x) for x in integrator.getBodyFriction(1)] == [5, 6]
    integrator.setBodyFriction(1, 7/unit.picosecond, 8)
    assert integrator.getBodyHasOwnFriction(1) and not integrator.getBodyHasOwnFriction(0)
    assert [x.value_in_unit(unit.picosecond**-1) for x in integrator.getBodyFriction(1)] == [7, 8]
    integrator.clearBodyFriction(1)
    assert [plain(x) for x in integrator.getBodyFriction(1)] == [5, 6]


@pytest.mark.parametrize('gamma, Gamma', [(-1, 1), (1, -1), (np.nan, 1), (1, np.inf)])
def test_bad_body_frictions_are_refused_naming_the_body(gamma, Gamma):
    integrator = makeWithBodies()
    with pytest.raises(openmm.OpenMMException, match='body 1: '):
        integrator.setBodyFriction(1, gamma, Gamma)
    assert not integrator.getBodyHasOwnFriction(1)


def test_seeds_are_integers():
    integrator = make()
    integrator.setRandomNumberSeed(np.int32(-7))
    assert integrator.getRandomNumberSeed() == -7
    for value in (1.0, 'a', None):
        with pytest.raises(TypeError, match='seed'):
            integrator.setRandomNumberSeed(value)


# ---- What needs a Context ------------------------------------------------------------------------

NEEDS_CONTEXT = [('getBodyPositions', ()), ('getBodyOrientations', ()), ('getBodyVelocities', ()),
                 ('getBodyAngularVelocities', ()), ('setBodyPositions', (np.zeros((2, 3)),)),
                 ('setBodyOrientations', (np.array([(1, 0, 0, 0)]*2),)),
                 ('setBodyVelocities', (np.zeros((2, 3)),)),
                 ('setBodyAngularVelocities', (np.zeros((2, 3)),)), ('getBodyForces', ()),
                 ('getBodyTorques', ()), ('getPoseResidual', ()),
                 ('computeTranslationalKineticEnergy', ()),
                 ('computeRotationalKineticEnergies', ()), ('computeFreeParticleKineticEnergy', ()),
                 ('getDegreesOfFreedom', ()), ('computeSystemTemperature', ()),
                 ('computeMidStepTemperature', ()), ('computeMidStepTemperatures', ()),
                 ('describeEffects', ()), ('getEffects', ()), ('getStepStatistics', ()),
                 ('step', (1,))]


@pytest.mark.parametrize('method, arguments', NEEDS_CONTEXT,
                         ids=[name for name, _ in NEEDS_CONTEXT])
def test_what_needs_a_context_says_so(method, arguments, platform):
    with pytest.raises(openmm.OpenMMException, match=rf'{method}\(\) needs a Context: create one'):
        getattr(makeWithBodies(), method)(*arguments)
    integrator, context = bound(platform)
    getattr(integrator, method)(*arguments)
    del context
    gc.collect()
    message = rf'{method}\(\) needs a Context, and the Context of this integrator was deleted'
    with pytest.raises(openmm.OpenMMException, match=message):
        getattr(integrator, method)(*arguments)


@pytest.mark.parametrize(
    'method',
    ['getBodyPositions', 'getBodyOrientations', 'getBodyVelocities', 'getBodyAngularVelocities'])
def test_body_states_need_positions(method, platform):
    system, _, definitions = dumbbells(1)
    integrator = make()
    integrator.addRigidBody(*definitions[0])
    context = openmm.Context(system, integrator, platform)
    with pytest.raises(openmm.OpenMMException, match='[Pp]ositions'):
        getattr(integrator, method)()


def test_body_states_are_arrays_with_units(platform):
    integrator, context = bound(platform)
    for value, dimension, columns in [
        (integrator.getBodyPositions(), unit.nanometer, 3),
        (integrator.getBodyVelocities(), unit.nanometer/unit.picosecond, 3),
        (integrator.getBodyAngularVelocities(), unit.radian/unit.picosecond, 3),
        (integrator.getBodyForces(), unit.kilojoule_per_mole/unit.nanometer, 3),
        (integrator.getBodyTorques(), unit.kilojoule_per_mole, 3)
    ]:
        array = value.value_in_unit(dimension)
        assert isinstance(array,
                          np.ndarray) and array.shape == (2, columns) and array.flags.writeable
    assert integrator.getBodyOrientations().shape == (2, 4)
    assert integrator.computeTranslationalKineticEnergy().value_in_unit(
        unit.kilojoule_per_mole) == 0
    assert integrator.computeRotationalKineticEnergies().value_in_unit(
        unit.kilojoule_per_mole).shape == (3,)
    assert integrator.getPoseResidual().value_in_unit(unit.nanometer) < 1e-12


def test_body_states_come_back_as_set(platform):
    integrator, context = bound(platform)
    random = np.random.default_rng(7)
    positions, velocities = random.normal(size=(2, 2, 3))
    orientations = random.normal(size=(2, 4))
    orientations /= np.linalg.norm(orientations, axis=1)[:, None]
    integrator.setBodyPositions(positions*10*unit.angstrom)
    integrator.setBodyOrientations(orientations)
    integrator.setBodyVelocities([openmm.Vec3(*row) for row in velocities])
    assert np.allclose(plain(integrator.getBodyPositions()), positions, rtol=0, atol=1e-15)
    assert np.allclose(integrator.getBodyOrientations(), orientations, rtol=0, atol=1e-15)
    assert np.allclose(plain(integrator.getBodyVelocities()), velocities, rtol=0, atol=1e-15)
    got = context.getState(getPositions=True).getPositions(asNumpy=True)._value
    for body in range(2):
        axis = _turn(orientations[body], (0, 0, 1))
        assert np.allclose(got[2*body], positions[body] - 0.1*axis, rtol=0, atol=1e-14)
        assert np.allclose(got[2*body + 1], positions[body] + 0.1*axis, rtol=0, atol=1e-14)


def _turn(q, vector):
    """q (w, x, y, z) turns body-frame vectors into lab-frame ones: v + 2 w (u x v) + 2 u x (u x v).
    """
    w, u = q[0], q[1:]
    return np.array(vector) + 2*w*np.cross(u, vector) + 2*np.cross(u, np.cross(u, vector))


def test_angular_velocities_lose_what_has_no_inertia(platform):
    integrator, context = bound(platform)
    integrator.setBodyAngularVelocities([(1, 2, 3), (4, 5, 6)])
    got = integrator.getBodyAngularVelocities().value_in_unit(unit.radian/unit.picosecond)
    assert np.allclose(got, [(1, 2, 0), (4, 5, 0)], atol=1e-14)
    # The energy is 1/2 I w^2 with I = 0.04 about x and y. The smallest moment, about z, is zero.
    energies = plain(integrator.computeRotationalKineticEnergies())
    assert energies[0] == 0 and energies[1:].sum() == pytest.approx(0.5*0.04*
                                                                    (1 + 4 + 16 + 25), rel=1e-14)


def test_angular_velocities_are_per_time_with_or_without_radians(platform):
    integrator, context = bound(platform)
    for value in (np.ones((2, 3))/unit.picosecond, np.ones(
        (2, 3))*unit.radian/unit.picosecond, np.full(
            (2, 3), 180/np.pi)*unit.degree/unit.picosecond):
        integrator.setBodyAngularVelocities(value)
        assert plain(integrator.getBodyAngularVelocities())[0, 0] == pytest.approx(1, rel=1e-12)


@pytest.mark.parametrize('method, columns', [('setBodyPositions', 3), ('setBodyOrientations', 4),
                                             ('setBodyVelocities', 3),
                                             ('setBodyAngularVelocities', 3)])
def test_arrays_of_the_wrong_shape_are_refused_with_both_shapes(method, columns, platform):
    integrator, context = bound(platform)
    for shape in [(columns,), (1, columns), (3, columns), (2, columns + 1), (columns, 2),
                  (2, columns, 1), (0, columns)]:
        with pytest.raises(ValueError) as error:
            getattr(integrator, method)(np.ones(shape))
        assert str(shape) in str(error.value) and f'(2, {columns})' in str(error.value)
    with pytest.raises(TypeError):
        getattr(integrator, method)(np.ones((2, columns))*unit.kelvin)
    for value in (None, 'abc', 1.0, [['a']*columns]*2, [[None]*columns]*2):
        with pytest.raises((TypeError, ValueError)):
            getattr(integrator, method)(value)


@pytest.mark.parametrize('method',
                         ['setBodyPositions', 'setBodyVelocities', 'setBodyAngularVelocities'])
@pytest.mark.parametrize('bad', [np.nan, np.inf])
def test_non_finite_rows_are_refused_naming_the_body(method, bad, platform):
    integrator, context = bound(platform)
    rows = np.ones((2, 3))
    rows[1, 2] = bad
    with pytest.raises(openmm.OpenMMException, match='body 1'):
        getattr(integrator, method)(rows)


@pytest.mark.parametrize('quaternion', [(0, 0, 0, 0), (1.1, 0, 0, 0), (0.99, 0, 0, 0),
                                        (np.nan, 0, 0, 0), (np.inf, 0, 0, 0)])
def test_quaternions_must_have_unit_length(quaternion, platform):
    integrator, context = bound(platform)
    with pytest.raises(openmm.OpenMMException, match='body 1: its quaternion has length'):
        integrator.setBodyOrientations([(1, 0, 0, 0), quaternion])


def test_quaternions_are_normalised(platform):
    integrator, context = bound(platform)
    integrator.setBodyOrientations([(1, 0, 0, 0), (0, 1.0005, 0, 0)])
    assert np.allclose(integrator.getBodyOrientations()[1], (0, 1, 0, 0), rtol=0, atol=1e-15)


# ---- Stepping and Contexts -----------------------------------------------------------------------


@pytest.mark.parametrize('steps', [-1, -1000])
def test_a_negative_number_of_steps_is_refused(steps, platform):
    integrator, context = bound(platform)
    with pytest.raises(openmm.OpenMMException, match=f'number of steps is {steps}'):
        integrator.step(steps)


@pytest.mark.parametrize('steps', [1.0, '1', None])
def test_a_number_of_steps_is_an_integer(steps, platform):
    integrator, context = bound(platform)
    with pytest.raises(TypeError, match='steps'):
        integrator.step(steps)


def test_steps_are_counted(platform):
    integrator, context = bound(platform)
    for steps in (0, 1, np.int64(49), 50, 51, 149):
        integrator.step(steps)
    assert context.getStepCount() == 300
    assert context.getState().getTime().value_in_unit(unit.picosecond) == pytest.approx(
        0.6, rel=1e-12)
    statistics = integrator.getStepStatistics()
    assert statistics['steps'] == 300 and isinstance(statistics['steps'], int)


def test_base_class_methods_work(platform):
    integrator, context = bound(platform)
    integrator.setIntegrationForceGroups({0, 3})
    assert integrator.getIntegrationForceGroups() == 9
    assert context.getIntegrator() is integrator
    openmm.Integrator.setStepSize(integrator, 0.001)
    assert integrator.getStepSize() == 0.001*unit.picosecond


def test_an_integrator_serves_one_context_at_a_time(platform):
    integrator, context = bound(platform)
    system, positions, _ = dumbbells(2)
    with pytest.raises(openmm.OpenMMException, match='already bound to a context'):
        openmm.Context(system, integrator, platform)
    integrator.step(1)
    del context
    gc.collect()
    context = openmm.Context(system, integrator, platform)
    context.setPositions(positions)
    integrator.step(1)


def test_an_integrator_survives_a_context_that_was_refused(platform):
    """Here the System is too small for the body's particles."""
    system, positions, definitions = dumbbells(2)
    small, _, _ = dumbbells(1)
    integrator = make()
    for definition in definitions:
        integrator.addRigidBody(*definition)
    with pytest.raises(openmm.OpenMMException, match='body 1'):
        openmm.Context(small, integrator, platform)
    with pytest.raises(openmm.OpenMMException, match='needs a Context'):
        integrator.step(1)
    context = openmm.Context(system, integrator, platform)
    context.setPositions(positions)
    integrator.step(1)


def test_an_integrator_inside_another_is_refused(platform):
    system, _, definitions = dumbbells(1)
    inner = make()
    inner.addRigidBody(*definitions[0])
    compound = openmm.CompoundIntegrator()
    compound.addIntegrator(inner)
    with pytest.raises(openmm.OpenMMException, match='CompoundIntegrator'):
        openmm.Context(system, compound, platform)


def test_a_failed_reinitialize_is_no_crash(platform):
    integrator, context = bound(platform)
    integrator.setRigidBodyParameters(1, [2, 99], 4.0, (0.04, 0.04, 0.0), SITES)
    with pytest.raises(openmm.OpenMMException, match='body 1'):
        context.reinitialize()
    with pytest.raises(openmm.OpenMMException, match='needs a Context'):
        integrator.step(1)
    context.setPositions(np.zeros((4, 3)))
    with pytest.raises(openmm.OpenMMException, match='needs a Context'):
        context.getState(getEnergy=True)
    integrator.setRigidBodyParameters(1, [2, 3], 4.0, (0.04, 0.04, 0.0), SITES)
    context.reinitialize()
    _, positions, _ = dumbbells(2)
    context.setPositions(positions)
    integrator.step(1)


def test_temperature_needs_momenta_and_degrees_of_freedom(platform):
    integrator, context = bound(platform)
    context.setVelocitiesToTemperature(300, 1)
    assert integrator.computeSystemTemperature().value_in_unit(unit.kelvin) > 0
    integrator.setScheme(CustomRigidHIIntegrator.GradientThermostat)
    with pytest.raises(openmm.OpenMMException, match='the scheme has no momenta'):
        integrator.computeSystemTemperature()


def test_temperature_of_nothing_that_moves_is_an_error(platform):
    system = openmm.System()
    system.addParticle(0.0)
    integrator = make()
    context = openmm.Context(system, integrator, platform)
    context.setPositions([(0, 0, 0)])
    with pytest.raises(openmm.OpenMMException, match='0 degrees of freedom'):
        integrator.computeSystemTemperature()


@pytest.mark.parametrize('temperature', [-1, np.nan])
def test_velocities_of_a_bad_temperature_are_refused(temperature, platform):
    integrator, context = bound(platform)
    with pytest.raises(openmm.OpenMMException, match='temperature is'):
        context.setVelocitiesToTemperature(temperature)


def test_steps_release_the_interpreter(platform):
    """While one thread steps, another thread must be able to run."""
    import threading
    integrator, context = bound(platform)
    ticks, done = [], threading.Event()

    def tick():
        while not done.is_set():
            ticks.append(1)
            done.wait(0.001)

    thread = threading.Thread(target=tick)
    thread.start()
    openmmrigidhi._bindings.CustomRigidHIIntegrator.step(integrator, {
        'Reference': 500000,
        'CPU': 20000
    }[platform.getName()])
    during = len(ticks)
    done.set()
    thread.join()
    assert during > 3


# ---- Nothing crashes at the border ---------------------------------------------------------------


def test_no_object_is_a_TypeError():
    base = openmmrigidhi._bindings.CustomRigidHIIntegrator
    for name in [name for name in vars(base) if name[:3] in ('get', 'com', 'des', 'res')]:
        for nobody in (None, 3, CustomRigidHIIntegrator.__new__(CustomRigidHIIntegrator)):
            with pytest.raises((TypeError, AttributeError)):
                getattr(base, name)(nobody)


def test_cast_refuses_what_is_something_else():
    for value in (None, 3, openmm.VerletIntegrator(0.001), openmm.System(),
                  CustomRigidHIIntegrator):
        with pytest.raises(TypeError, match='cast'):
            CustomRigidHIIntegrator.cast(value)


def test_bindings_refuse_buffers_of_the_wrong_kind():
    base = openmmrigidhi._bindings.CustomRigidHIIntegrator
    for buffer in (b'123', np.zeros(3), np.zeros(3, dtype=np.int64), np.arange(
            8, dtype=np.intc)[::2], 'abc', None, [1, 2]):
        with pytest.raises(TypeError):
            base.addRigidBody(make(), buffer)
    with pytest.raises(TypeError):
        base.addRigidBody(make(), np.arange(1, dtype=np.intc), 1.0, np.zeros(6), np.zeros((1, 3)))


# ---- Loading -------------------------------------------------------------------------------------


def run(code, path=None, **variables):
    environment = {
        **os.environ, 'PYTHONPATH': path
        or os.path.dirname(os.path.dirname(openmmrigidhi.__file__)),
        **variables
    }
    return subprocess.run([sys.executable, '-c', code], env=environment, capture_output=True,
                          text=True)


def packageDirectory():
    return os.path.dirname(openmmrigidhi.__file__)


def test_checkPlatform_says_why():
    openmmrigidhi.checkPlatform('Reference')
    openmmrigidhi.checkPlatform(openmm.Platform.getPlatformByName('CPU'))
    with pytest.raises(openmm.OpenMMException,
                       match="'Nonsense': OpenMM has no platform of this name.*Reference, CPU"):
        openmmrigidhi.checkPlatform('Nonsense')


def test_importing_needs_no_environment_and_loads_twice_harmlessly():
    code = ('import importlib, openmm, openmmrigidhi; openmmrigidhi._loading.load(); '
            'openmmrigidhi.checkPlatform("Reference"); print(openmmrigidhi.app.sphereShell(12, '
            '1).shape)')
    result = run(code)
    assert result.returncode == 0, result.stderr
    assert result.stdout.strip() == '(12, 3)'


def test_a_library_that_does_not_load_fails_loudly(tmp_path):
    package = tmp_path/'openmmrigidhi'
    shutil.copytree(packageDirectory(), package)
    (package/'lib'/'plugins'/'libOpenMMRigidHICPU.so').write_bytes(b'no library')
    result = run('import openmmrigidhi', str(tmp_path))
    assert result.returncode != 0
    assert ('ImportError: openmmrigidhi: cannot load the platform library '
            'libOpenMMRigidHICPU.so') in result.stderr
    assert str(package) in result.stderr and 'invalid ELF header' in result.stderr \
        or 'file too short' in result.stderr


def test_the_library_of_a_device_may_fail_to_load(tmp_path):
    """The software of a GPU is not on every machine on which the package is."""
    package = tmp_path/'openmmrigidhi'
    shutil.copytree(packageDirectory(), package)
    (package/'lib'/'plugins'/'libOpenMMRigidHIHIP.so').write_bytes(b'no library')
    result = run(
        'import openmmrigidhi; openmmrigidhi.checkPlatform("CPU"); '
        'print(openmmrigidhi.describe())', str(tmp_path))
    assert result.returncode == 0, result.stderr
    found = [
        line for line in result.stdout.splitlines()
        if line.startswith('libraries of devices that failed to load')
    ]
    assert len(found) == 1 and 'libOpenMMRigidHIHIP.so: ' in found[0]


def test_another_copy_of_the_library_is_not_mixed_in(tmp_path):
    """The loader would take a library of the same name that is installed already, for example that
    of a Debian package instead of the build tree's."""
    copy = shutil.copy(os.path.join(packageDirectory(), 'lib', 'libOpenMMRigidHI.so'), tmp_path)
    result = run(f'import ctypes; ctypes.CDLL({copy!r}); import openmmrigidhi')
    assert ('ImportError: openmmrigidhi: its library libOpenMMRigidHI.so was loaded from '
            f'{copy}') in result.stderr
    assert 'this process would mix two copies of openmm-rigidhi' in result.stderr


def test_a_python_module_of_another_openmm_is_refused():
    """As on a machine with two of them, where the loader finds a library for the bindings."""
    result = run("import openmm; openmm.Platform.getOpenMMVersion = lambda: '99.1.2'; "
                 'import openmmrigidhi')
    assert result.returncode != 0
    assert 'but the Python module openmm is OpenMM 99.1, from ' in result.stderr


def test_describe_says_what_a_bug_report_needs():
    text = openmmrigidhi.describe()
    version = openmm.Platform.getOpenMMVersion()
    compiledFor = '.'.join(version.split('.')[:2])  # version 7.7 says no more, later ones do
    assert text.startswith(
        f'openmmrigidhi {openmmrigidhi.__version__}, compiled for OpenMM {compiledFor}, from '
    ) and f'\nOpenMM {version}; ' in text
    for name in ('Reference', 'CPU', f'NumPy {np.__version__}', 'instruction set: ', 'Eigen 3.',
                 'OpenBLAS', 'fftw-3', 'Highway', 'muParser'):
        assert name in text, name


def test_kernels_in_the_plugin_directory_of_openmm_serve(tmp_path):
    """In the layout of a distribution libraries are beside OpenMM's own, and none is in the Python
    package."""
    package = tmp_path/'python'/'openmmrigidhi'
    shutil.copytree(packageDirectory(), package)
    shutil.move(package/'lib', tmp_path/'openmm')
    code = ('import openmmrigidhi; openmmrigidhi.checkPlatform("CPU"); '
            'print(openmmrigidhi.describe())')
    # OpenMM's own plugins; below a prefix they are beside its library.
    own = os.path.join(openmm.version.openmm_library_path, 'plugins')
    if not os.path.isdir(own):
        own = openmm.Platform.getDefaultPluginsDirectory()
    environment = {'OPENMM_PLUGIN_DIR': os.pathsep.join([str(tmp_path/'openmm'/'plugins'), own])}
    result = run(code, str(package.parent), **environment)
    assert result.returncode == 0, result.stderr
    assert str(tmp_path/'openmm'/'libOpenMMRigidHI.so') in result.stdout


def test_missing_libraries_fail_loudly(tmp_path):
    package = tmp_path/'openmmrigidhi'
    shutil.copytree(packageDirectory(), package)
    shutil.rmtree(package/'lib'/'plugins')
    result = run('import openmmrigidhi', str(tmp_path))
    assert 'ImportError: openmmrigidhi: found no platform library' in result.stderr
    os.remove(package/'_openmmrigidhi.so')
    result = run('import openmmrigidhi', str(tmp_path))
    assert 'ImportError: openmmrigidhi: cannot load its binding module' in result.stderr


def test_a_context_without_our_platform_libraries_says_what_is_missing():
    """Only the bindings are loaded, as in a C++ program that does not load the plugin directory.
    """
    result = run(f'''
import sys, types, openmm
package = types.ModuleType('openmmrigidhi')
package.__path__ = [{packageDirectory()!r}]
sys.modules['openmmrigidhi'] = package
from openmmrigidhi.integrator import CustomRigidHIIntegrator
system = openmm.System()
system.addParticle(1.0)
openmm.Context(system, CustomRigidHIIntegrator(300, 0.001),
               openmm.Platform.getPlatformByName('Reference'))
''')
    message = 'no platform has the kernels of this integrator; libOpenMMRigidHIReference.so'
    assert message in result.stderr
    assert 'loadPluginsFromDirectory' in result.stderr


def test_reference_works_without_the_cpu_platform(tmp_path):
    """OPENMM_PLUGIN_DIR replaces OpenMM's own plugin directory, and its CPU platform with it."""
    os.environ['OPENMM_PLUGIN_DIR'] = str(tmp_path)
    try:
        result = run('''
import openmm, openmmrigidhi
openmmrigidhi.checkPlatform('Reference')
try:
    openmmrigidhi.checkPlatform('CPU')
except openmm.OpenMMException as error:
    print(error)
''')
    finally:
        del os.environ['OPENMM_PLUGIN_DIR']
    assert result.returncode == 0, result.stderr
    assert "platform 'CPU': OpenMM has no platform of this name" in result.stdout and str(
        tmp_path) in result.stdout


# ---- Documentation -------------------------------------------------------------------------------


def test_every_public_method_is_documented():
    for name, method in vars(CustomRigidHIIntegrator).items():
        if callable(method) and not name.startswith('_'):
            assert method.__doc__, name


def test_docstring_examples_run():
    import doctest
    import openmmrigidhi.integrator
    assert doctest.testmod(openmmrigidhi.integrator).attempted > 0
    assert doctest.testmod(openmmrigidhi.integrator).failed == 0
