"""The Python API of CustomRigidHIIntegrator: units, shapes, constants, and that bad input is
refused with a reason."""
import enum

import numpy as np
import openmm
import pytest
from openmm import unit

import openmmrigidhi
from api_support import SITES, make, makeWithBodies, plain
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce

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


def test_a_body_without_particles_is_refused():
    """Empty arrays reach C++, whose tests have the other bad particles and shapes."""
    for explicit in ((), (1.0, (1, 1, 1), np.zeros((0, 3)))):
        integrator = makeWithBodies()
        with pytest.raises(openmm.OpenMMException, match='body 2: it has no particles'):
            integrator.addRigidBody([], *explicit)
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


def test_a_body_without_sites_is_refused():
    integrator = make()
    with pytest.raises(openmm.OpenMMException, match='body 0: it has 2 particles but 0 site'):
        integrator.addRigidBody([0, 1], 1, (1, 1, 1), [])


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
