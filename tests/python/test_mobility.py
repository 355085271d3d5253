"""MobilityForce in Python: units, shapes, settings that are read as they were set, copies, and use
in a Context."""
import copy
import gc
import pickle

import numpy as np
import openmm
import pytest
from openmm import unit

import openmmrigidhi
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce

PASCAL_SECOND = 602214.076  # in dalton/(nm ps)


def tensor(seed):
    """A positive definite 6 x 6 matrix without any further symmetry."""
    x = np.random.default_rng(seed).normal(size=(6, 6))
    return x @ x.T + np.eye(6)


def everything():
    """A MobilityForce in which no property has its default."""
    fluid = MobilityForce()
    for radius in (0.1, 0, 1/3):
        fluid.addParticle(radius)
    fluid.setViscosity(1000/3)
    fluid.setModel(MobilityForce.StokesianDynamics)
    fluid.setLubrication(False)
    fluid.setLubricationReach(7/3, 3)
    fluid.setFastSummation(False)
    fluid.setMinimumGap(1e-3/3)
    fluid.setBoundary(MobilityForce.NoSlipWall)
    fluid.setWallHeight(-4/3)
    fluid.setChannelWalls(-4/3, 5/3)
    fluid.setSphereWallMobility(MobilityForce.BestKnown)
    fluid.setSolver(MobilityForce.MatrixFree)
    fluid.setSolverTolerance(1e-5/3)
    fluid.setGridSpacing(1/7)
    fluid.setBackgroundFlow((1/3, -2, 3), ((1/7, 2, 3), (4, -1/7, 6), (7, 8, 0)))
    fluid.setSinusoidalForceDensity(1/3, 2, 0, 3)
    fluid.setBodyMobility(4, tensor(1)/3)
    fluid.setBodyFriction(1, tensor(2)/7)
    fluid.setGroups([0, 3, 3, 1, 0])
    fluid.setForceGroup(5)
    fluid.setName('water & "glycerol"')
    return fluid


def assertSame(a, b):
    """All getters agree, to the last bit."""
    assert a.getNumParticles() == b.getNumParticles()
    for i in range(a.getNumParticles()):
        assert a.getParticleRadius(i) == b.getParticleRadius(i)
    for name in ('Viscosity', 'Model', 'Boundary', 'WallHeight', 'ChannelWalls',
                 'SphereWallMobility', 'Lubrication', 'LubricationReach', 'MinimumGap', 'Solver',
                 'SolverTolerance', 'GridSpacing', 'FastSummation', 'SinusoidalForceDensity',
                 'ForceGroup', 'Name'):
        assert getattr(a, 'get' + name)() == getattr(b, 'get' + name)(), name
    for mine, other in zip(a.getBackgroundFlow(), b.getBackgroundFlow()):
        assert mine.unit == other.unit and np.array_equal(mine._value, other._value)
    assert np.array_equal(a.getBodiesWithOwnTensors(), b.getBodiesWithOwnTensors())
    for body in a.getBodiesWithOwnTensors():
        assert a.getBodyTensorIsFriction(body) == b.getBodyTensorIsFriction(body)
        assert np.array_equal(a.getBodyMobility(body), b.getBodyMobility(body))
        assert np.array_equal(a.getBodyFriction(body), b.getBodyFriction(body))
    assert np.array_equal(a.getGroups(), b.getGroups())


def castForce(force):
    return MobilityForce.cast(force)


def throughSystem(fluid):
    system = openmm.System()
    system.addForce(copy.copy(fluid))
    twin = openmm.XmlSerializer.deserialize(openmm.XmlSerializer.serialize(system))
    force = castForce(twin.getForce(0))
    force._system = twin  # the owner of the C++ object must live as long
    return force


COPIES = {
    'xml': lambda fluid: castForce(
        openmm.XmlSerializer.deserialize(openmm.XmlSerializer.serialize(fluid))),
    'system': throughSystem,
    'copy': copy.copy,
    'deepcopy': copy.deepcopy,
    'pickle': lambda fluid: pickle.loads(pickle.dumps(fluid)),
    'clone': lambda fluid: castForce(openmm.XmlSerializer.clone(fluid))
}

# ---- Settings ------------------------------------------------------------------------------------


def test_defaults():
    fluid = MobilityForce()
    assert fluid.getNumParticles() == 0
    assert fluid.getModel() is MobilityForce.RotnePragerYamakawa and fluid.getBoundary(
    ) is MobilityForce.Unbounded
    assert fluid.getSolver() is MobilityForce.Auto and fluid.getSolverTolerance() == 1e-6
    assert fluid.getLubrication() is MobilityForce.AutoLubrication and fluid.getFastSummation(
    ) is True and fluid.getMinimumGap() == 0
    assert fluid.getWallHeight(
    ) == 0*unit.nanometer and fluid.getSphereWallMobility() is MobilityForce.FromModel
    assert fluid.getViscosity()._value == pytest.approx(0.89e-3*PASCAL_SECOND, rel=1e-14)
    assert len(fluid.getGroups()) == 0 and len(fluid.getBodiesWithOwnTensors()) == 0
    assert not fluid.usesPeriodicBoundaryConditions()


@pytest.mark.parametrize('value', [
    0.89e-3*PASCAL_SECOND, 0.89e-3*PASCAL_SECOND*unit.dalton/(unit.nanometer*unit.picosecond),
    0.89e-3*unit.pascal*unit.second, 890*unit.micropascal*unit.second,
    np.float64(0.89e-3*PASCAL_SECOND), 0.89e-3*unit.kilogram/(unit.meter*unit.second)
])
def test_viscosity_in_any_unit(value):
    fluid = MobilityForce()
    fluid.setViscosity(1)
    fluid.setViscosity(value)
    viscosity = fluid.getViscosity()
    assert viscosity.unit == unit.dalton/(unit.nanometer*unit.picosecond)
    assert viscosity._value == pytest.approx(0.89e-3*PASCAL_SECOND, rel=1e-9)


def test_radii_in_any_unit():
    fluid = MobilityForce()
    assert [fluid.addParticle(radius)
            for radius in (0.25, 0.25*unit.nanometer, 2.5*unit.angstrom)] == [0, 1, 2]
    fluid.addParticle(0)
    fluid.setParticleRadius(3, 250*unit.picometer)
    for i in range(4):
        assert fluid.getParticleRadius(i).unit == unit.nanometer
        assert fluid.getParticleRadius(i)._value == pytest.approx(0.25, rel=1e-12)


@pytest.mark.parametrize('name', ['Model', 'Boundary', 'SphereWallMobility', 'Solver'])
def test_every_constant_comes_back(name):
    kind = type(getattr(MobilityForce(), 'get' + name)())
    for constant in kind:
        fluid = MobilityForce()
        getattr(fluid, 'set' + name)(constant)
        assert getattr(fluid, 'get' + name)() is constant
        getattr(fluid, 'set' + name)(int(constant))
        assert getattr(fluid, 'get' + name)() is constant
        assert getattr(MobilityForce, constant.name) is constant


def test_settings_come_back():
    fluid = everything()
    assert fluid.getLubrication() is MobilityForce.Off and fluid.getFastSummation() is False
    assert fluid.getMinimumGap() == 1e-3/3 and fluid.getSolverTolerance() == 1e-5/3
    assert list(fluid.getGroups()) == [0, 3, 3, 1, 0]
    fluid.setGroups(np.array([2, 1]))
    assert list(fluid.getGroups()) == [2, 1]
    fluid.setGroups([])
    assert len(fluid.getGroups()) == 0


def test_tensors_come_back_both_ways():
    fluid = MobilityForce()
    for setter, getter, other, isFriction in ((fluid.setBodyMobility, fluid.getBodyMobility,
                                               fluid.getBodyFriction, False),
                                              (fluid.setBodyFriction, fluid.getBodyFriction,
                                               fluid.getBodyMobility, True)):
        value = tensor(3)
        setter(2, value)
        assert fluid.getBodyHasOwnTensor(2) and not fluid.getBodyHasOwnTensor(0)
        assert fluid.getBodyTensorIsFriction(2) is isFriction
        assert np.array_equal(getter(2), value)
        assert np.allclose(other(2) @ value, np.eye(6), atol=1e-12)
        setter(2, value.tolist())
        assert np.array_equal(getter(2), value)
        setter(2, np.asfortranarray(value))
        assert np.array_equal(getter(2), value)
    fluid.clearBodyTensor(2)
    assert not fluid.getBodyHasOwnTensor(2) and list(fluid.getBodiesWithOwnTensors()) == []
    fluid.clearBodyTensor(2)


def test_results_are_the_users_to_change():
    fluid = everything()
    fluid.getBodyMobility(4)[:] = 0
    fluid.getGroups()
    assert np.array_equal(fluid.getBodyMobility(4), tensor(1)/3)


# ---- Copies --------------------------------------------------------------------------------------


@pytest.mark.parametrize('way', COPIES)
def test_everything_survives(way):
    fluid = everything()
    twin = COPIES[way](fluid)
    assert type(twin) is MobilityForce and twin is not fluid
    assertSame(fluid, twin)
    assert openmm.XmlSerializer.serialize(twin) == openmm.XmlSerializer.serialize(fluid)
    twin.setViscosity(1)
    twin.setBodyMobility(4, np.eye(6))
    assertSame(fluid, everything())


@pytest.mark.parametrize('way', ['copy', 'deepcopy', 'pickle'])
def test_python_attributes_survive(way):
    fluid = everything()
    fluid.note = ['mine']
    twin = COPIES[way](fluid)
    assert twin.note == ['mine']
    assert (twin.note is fluid.note) == (way == 'copy')


def test_cast():
    fluid = everything()
    assert MobilityForce.cast(fluid) is fluid
    system = openmm.System()
    system.addForce(fluid)
    generic = system.getForce(0)
    assert MobilityForce.cast(generic).getNumParticles() == 3
    owner = openmm.XmlSerializer.clone(fluid)
    result = MobilityForce.cast(owner)
    assert MobilityForce.cast(owner) is result
    del owner
    gc.collect()
    assertSame(result, everything())


@pytest.mark.parametrize('other', [
    None, 3, 'fluid',
    openmm.HarmonicBondForce(),
    openmm.System(),
    openmm.VerletIntegrator(0.001),
    CustomRigidHIIntegrator(300, 0.001)
])
def test_cast_refuses_what_is_something_else(other):
    with pytest.raises(TypeError,
                       match=r'MobilityForce\.cast: obj: got .*; it must be a MobilityForce'):
        MobilityForce.cast(other)


def test_repr_says_what_it_is():
    text = repr(everything())
    assert 'StokesianDynamics' in text and '3 particles' in text and 'MobilityForce' in text


def test_docstring_examples_run():
    import doctest
    result = doctest.testmod(openmmrigidhi.mobility)
    assert result.attempted > 0 and result.failed == 0


# ---- In a Context --------------------------------------------------------------------------------


class Spheres:
    """Spheres on a line, in a Context."""
    def __init__(self, platform, radii=(0.5, 0.3, 0.4), model=MobilityForce.RotnePragerYamakawa,
                 temperature=300):
        self.system = openmm.System()
        self.fluid = MobilityForce()
        self.fluid.setModel(model)
        self.integrator = CustomRigidHIIntegrator(temperature, 0.001)
        for i, radius in enumerate(radii):
            self.integrator.addRigidBody([self.system.addParticle(10)], 10, (1, 1, 1), [(0, 0, 0)])
            self.fluid.addParticle(radius)
        self.integrator.setScheme(CustomRigidHIIntegrator.LangevinHI)
        self.system.addForce(self.fluid)
        self.context = openmm.Context(self.system, self.integrator, platform)
        self.context.setPositions([(1.2*i, 0.1*i*i, 0) for i in range(len(radii))])


def test_matrices_have_their_shapes(platform):
    scene = Spheres(platform)
    mobility, friction = (ask(scene.context) for ask in (scene.fluid.getMobilityInContext,
                                                         scene.fluid.getFrictionInContext))
    for matrix in (mobility, friction):
        assert type(matrix) is np.ndarray and matrix.shape == (18,
                                                               18) and matrix.dtype == np.float64
        assert np.array_equal(matrix, matrix.T) or np.allclose(matrix, matrix.T, rtol=0,
                                                               atol=1e-15*abs(matrix).max())
    assert np.allclose(mobility @ friction, np.eye(18), atol=1e-10)
    eta = scene.fluid.getViscosity()._value
    assert mobility[0, 0] == pytest.approx(1/(6*np.pi*eta*0.5), rel=1e-13)
    assert mobility[9, 9] == pytest.approx(1/(8*np.pi*eta*0.3**3), rel=1e-13)
    wrenches = np.random.default_rng(1).normal(size=(3, 6))
    twists = scene.fluid.applyMobilityInContext(scene.context, wrenches)
    assert twists.shape == (3, 6)
    assert np.allclose(twists.ravel(), mobility @ wrenches.ravel(), rtol=1e-12,
                       atol=1e-12*abs(twists).max())
    assert np.array_equal(scene.fluid.applyMobilityInContext(scene.context, wrenches.tolist()),
                          twists)


def test_velocities_of_blobs(platform):
    scene = Spheres(platform)
    forces = np.random.default_rng(2).normal(size=(3, 3))
    velocities = scene.fluid.applyBlobMobilityInContext(scene.context, forces)
    assert velocities.unit == unit.nanometer/unit.picosecond and velocities._value.shape == (3, 3)
    mobility = scene.fluid.getMobilityInContext(scene.context)
    translation = mobility.reshape(3, 6, 3, 6)[:, :3, :, :3].reshape(9, 9)
    assert np.allclose(velocities._value.ravel(), translation @ forces.ravel(), rtol=1e-12,
                       atol=1e-15)
    # kcal/(mol A) is a unit of force too, and lists of rows are accepted as arrays.
    other = scene.fluid.applyBlobMobilityInContext(
        scene.context,
        forces.tolist()*unit.kilocalorie_per_mole/unit.angstrom)
    assert np.allclose(other._value, 41.84*velocities._value, rtol=1e-13, atol=0)


def test_no_bodies(platform):
    system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(
        300, 0.001)
    for i in range(2):
        system.addParticle(1)
        fluid.addParticle(0.2)
    system.addForce(fluid)
    integrator.setScheme(CustomRigidHIIntegrator.LangevinHI)
    context = openmm.Context(system, integrator, platform)
    context.setPositions([(0, 0, 0), (1, 0, 0)])
    integrator.step(2)
    assert fluid.getMobilityInContext(context).shape == (0, 0)
    assert fluid.getFrictionInContext(context).shape == (0, 0)
    assert fluid.applyMobilityInContext(context, np.empty((0, 6))).shape == (0, 6)
    assert integrator.getStepStatistics()['randomNumbers'] == 12


def test_viscosity_in_a_context(platform):
    scene = Spheres(platform)
    before = scene.fluid.getMobilityInContext(scene.context)
    scene.fluid.setViscosity(2*scene.fluid.getViscosity())
    scene.fluid.updateParametersInContext(scene.context)
    assert np.allclose(2*scene.fluid.getMobilityInContext(scene.context), before, rtol=1e-13,
                       atol=0)


def test_a_force_from_the_system_answers_too(platform):
    scene = Spheres(platform)
    fluid = MobilityForce.cast(scene.context.getSystem().getForce(0))
    assert np.array_equal(fluid.getMobilityInContext(scene.context),
                          scene.fluid.getMobilityInContext(scene.context))


def test_the_force_has_no_energy(platform):
    scene = Spheres(platform)
    assert scene.context.getState(getEnergy=True).getPotentialEnergy()._value == 0
    scene.integrator.step(3)
    assert np.all(scene.context.getState(getForces=True).getForces(asNumpy=True)._value == 0)


def test_reinitialize_takes_model_and_groups(platform):
    scene = Spheres(platform)
    scene.integrator.step(2)
    coupled = scene.fluid.getMobilityInContext(scene.context)
    scene.fluid.setModel(MobilityForce.FreeDraining)
    scene.context.reinitialize(preserveState=True)
    draining = scene.fluid.getMobilityInContext(scene.context)
    for i in range(3):
        for k in range(i):
            block = np.s_[6*i:6*i + 6, 6*k:6*k + 6]
            assert not draining[block].any() and coupled[block].any()
    scene.fluid.setModel(MobilityForce.RotnePragerYamakawa)
    scene.fluid.setGroups([0, 1, 0])
    scene.context.reinitialize(preserveState=True)
    grouped = scene.fluid.getMobilityInContext(scene.context)
    assert not grouped[:6, 6:12].any() and np.array_equal(grouped[:6, 12:], coupled[:6, 12:])


def test_a_saved_simulation_resumes(platform):
    scene = Spheres(platform)
    scene.integrator.setRandomNumberSeed(5)
    scene.context.reinitialize(preserveState=True)
    scene.integrator.step(5)
    system, integrator, state = (openmm.XmlSerializer.serialize(thing) for thing in (
        scene.system, scene.integrator,
        scene.context.getState(getPositions=True, getVelocities=True, getParameters=True,
                               getIntegratorParameters=True)))
    scene.integrator.step(5)
    twin = CustomRigidHIIntegrator.cast(openmm.XmlSerializer.deserialize(integrator))
    context = openmm.Context(openmm.XmlSerializer.deserialize(system), twin, platform)
    context.setState(openmm.XmlSerializer.deserialize(state))
    twin.step(5)
    assert np.array_equal(twin.getBodyPositions()._value,
                          scene.integrator.getBodyPositions()._value)
    assert np.array_equal(twin.getBodyOrientations(), scene.integrator.getBodyOrientations())


def test_effects_name_the_fluid(platform):
    scene = Spheres(platform)
    text = scene.integrator.getEffects()['hydrodynamic interactions']
    assert text.startswith('on'), text
    statistics = scene.integrator.getStepStatistics()
    assert statistics['randomNumbers'] == 0
    scene.integrator.step(4)
    assert scene.integrator.getStepStatistics()['randomNumbers'] == 4*18
