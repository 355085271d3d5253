"""CustomBodyForce in Python: units, casts, copies, damaged files, and refused input."""
import copy
import gc
import pickle
import re

import numpy as np
import openmm
import pytest
from openmm import unit

from openmmrigidhi import CustomBodyForce, CustomRigidHIIntegrator, MobilityForce
from scenes import dumbbells

COMPONENTS = ('fx', 'fy', 'fz', 'tx', 'ty', 'tz')


def make():
    force = CustomBodyForce('-k*x; k=2*stiffness', 'a<0.5', '"\'&\t', 'cos(w*t)', 'b^2', '0')
    force.addGlobalParameter('stiffness', 1/3)
    force.addGlobalParameter('w', -1e300/7)
    force.addPerBodyParameter('a')
    force.addPerBodyParameter('b')
    force.addBody(3, [1/7, -2])
    force.addBody(3, (1e-300/3, 0))
    force.addBody(0, np.array([1, 2]))
    force.setForceGroup(5)
    force.setName('trap')
    return force


def throughSystem(force):
    system = openmm.System()
    system.addForce(copy.copy(force))
    twin = copy.deepcopy(system)  # must live as long as its forces are used
    return copy.copy(CustomBodyForce.cast(twin.getForce(0)))


COPIES = {
    'xml': lambda force: CustomBodyForce.cast(
        openmm.XmlSerializer.deserialize(openmm.XmlSerializer.serialize(force))),
    'copy': copy.copy,
    'deepcopy': copy.deepcopy,
    'pickle': lambda force: pickle.loads(pickle.dumps(force)),
    'clone': lambda force: CustomBodyForce.cast(openmm.XmlSerializer.clone(force)),
    'system': throughSystem
}


def scene(force, platform, temperature=0):
    """Two dumbbells under a force."""
    system, positions, definitions = dumbbells(2)
    system.addForce(force)
    integrator = CustomRigidHIIntegrator(temperature, 0.002)
    for definition in definitions:
        integrator.addRigidBody(*definition)
    context = openmm.Context(system, integrator, platform)
    context.setPositions(positions)
    return system, integrator, context


# ---- Getters, setters, units ---------------------------------------------------------------------


def test_what_is_set_is_got():
    force = make()
    assert [force.getExpression(c) for c in COMPONENTS
            ] == ['-k*x; k=2*stiffness', 'a<0.5', '"\'&\t', 'cos(w*t)', 'b^2', '0']
    for component in COMPONENTS:
        force.setExpression(component, component + '1')
    assert [force.getExpression(c) for c in COMPONENTS] == [c + '1' for c in COMPONENTS]
    assert force.getNumGlobalParameters() == 2 and force.getNumPerBodyParameters(
    ) == 2 and force.getNumBodies() == 3
    assert force.getGlobalParameterName(1) == 'w' and force.getGlobalParameterDefaultValue(0) == 1/3
    force.setGlobalParameterName(1, 'ω')
    force.setGlobalParameterDefaultValue(1, 4)
    assert force.getGlobalParameterName(1) == 'ω' and force.getGlobalParameterDefaultValue(1) == 4
    force.setPerBodyParameterName(1, 'c')
    assert force.getPerBodyParameterName(1) == 'c'
    assert force.getBodyParameters(0) == (3, (1/7, -2))
    force.setBodyParameters(np.int64(0), np.int32(2), [5, 6])
    assert force.getBodyParameters(0) == (2, (5, 6))
    assert not force.usesPeriodicBoundaryConditions()
    assert isinstance(force,
                      openmm.Force) and force.getForceGroup() == 5 and 'trap' == force.getName()
    assert "fx='fx1'" in repr(force) and '3 bodies' in repr(force)
    assert CustomBodyForce(*6*['0']).getName() == 'CustomBodyForce'


@pytest.mark.parametrize(
    'value, expected',
    [(2, 2), (2*unit.kilojoule_per_mole/unit.angstrom**2, 200),
     (1*unit.kilocalorie_per_mole, 4.184), (3*unit.angstrom, 0.3), (90*unit.degree, np.pi/2),
     (1*unit.elementary_charge, 1), (5*unit.gram/unit.mole, 5), (np.float32(2), 2),
     # These are per particle, not per mole: OpenMM's own conversion is off by Avogadro's number.
     (1*unit.piconewton, 0.602214076), (1*unit.volt, 96.48533212),
     (1.66053906660e-24*unit.gram, 1),])
def test_parameters_take_quantities_of_any_dimension(value, expected):
    force = CustomBodyForce(*6*['0'])
    force.addGlobalParameter('g', value)
    assert force.getGlobalParameterDefaultValue(0) == pytest.approx(expected, rel=1e-9)
    force.setGlobalParameterDefaultValue(0, 0)
    force.setGlobalParameterDefaultValue(0, value)
    assert force.getGlobalParameterDefaultValue(0) == pytest.approx(expected, rel=1e-9)
    force.addPerBodyParameter('a')
    force.addPerBodyParameter('b')
    force.addBody(0, [value, 1])
    assert force.getBodyParameters(0)[1] == pytest.approx((expected, 1), rel=1e-9)
    if unit.is_quantity(value):
        force.addBody(0, np.array([1, 2])*value)
        assert force.getBodyParameters(1)[1] == pytest.approx((expected, 2*expected), rel=1e-9)


@pytest.mark.parametrize(
    'action, message',
    [(lambda f: CustomBodyForce(1, *5*['0']), '__init__: fx: got 1; it must be a string'),
     (lambda f: f.addPerBodyParameter(7), 'addPerBodyParameter: name: got 7; it must be a string'),
     (lambda f: f.setExpression('fx', 0), 'setExpression: expression: got 0; it must be a string'),
     (lambda f: f.getExpression(0), 'getExpression: component: got 0; it must be a string'),
     (lambda f: f.addGlobalParameter('g', '1'), "defaultValue: got '1'; it must be a number"),
     (lambda f: f.addBody(0, 5), 'addBody: parameters: got 5; it must be a sequence of numbers'),
     (lambda f: f.addBody(0, ['a']), "addBody: parameter 0: got 'a'; it must be a number"),
     (lambda f: f.addBody(1.5), 'addBody: bodyIndex: got 1.5; it must be an integer'),
     (lambda f: f.setBodyParameters('0', 0),
      "setBodyParameters: index: got '0'; it must be an integer"),
     (lambda f: super(CustomBodyForce, f).addPerBodyParameter(3), 'expected text as argument 2'),])
def test_wrong_types(action, message):
    with pytest.raises(TypeError, match=re.escape(message)):
        action(make())


# ---- Copies and casts ----------------------------------------------------------------------------


@pytest.mark.parametrize('duplicate', COPIES.values(), ids=COPIES)
def test_everything_survives(duplicate):
    force = make()
    result = duplicate(force)
    assert type(result) is CustomBodyForce and CustomBodyForce.cast(result) is result
    assert openmm.XmlSerializer.serialize(result) == openmm.XmlSerializer.serialize(force)
    assert [result.getExpression(c)
            for c in COMPONENTS] == [force.getExpression(c) for c in COMPONENTS]
    assert [result.getBodyParameters(i)
            for i in range(3)] == [force.getBodyParameters(i) for i in range(3)]
    result.addBody(9)
    assert force.getNumBodies() == 3


def test_cast_moves_ownership_and_refuses_others():
    generic = openmm.XmlSerializer.clone(make())
    assert type(generic) is openmm.Force
    force = CustomBodyForce.cast(generic)
    assert force.thisown and not generic.thisown and CustomBodyForce.cast(generic) is force
    del generic
    gc.collect()
    system = openmm.System()
    system.addForce(force)
    assert not force.thisown
    part = CustomBodyForce.cast(system.getForce(0))
    assert not part.thisown and part.getNumBodies() == 3
    for other in (openmm.HarmonicBondForce(), None, 5, CustomRigidHIIntegrator(300, 0.001)):
        with pytest.raises(TypeError, match='CustomBodyForce.cast: obj: got'):
            CustomBodyForce.cast(other)


def xml():
    return openmm.XmlSerializer.serialize(make())


@pytest.mark.parametrize('attribute',
                         sorted(set(re.findall(r' (\w+)="', xml())) - {'type', 'openmmVersion'}))
def test_a_missing_property_is_refused_by_name(attribute):
    with pytest.raises(openmm.OpenMMException, match=f"'{attribute}'"):
        openmm.XmlSerializer.deserialize(re.sub(rf' {attribute}="[^"]*"', '', xml()))


@pytest.mark.parametrize(
    'before, after, message',
    [('version="1"', 'version="2"', "property 'version' is '2'; it must be 1"),
     ('count="3"', 'count="4"', "it has 3 elements; it must have 4"),
     ('parameters="2"', 'parameters="1"', "it has 2 elements; it must have 1"),
     ('value="-2"', 'value="two"', "property 'value' is 'two'; it must be a number"),
     ('index="3"', 'index="-3"', 'body index -3 is negative'),
     ('name="a"', 'name="q0"', "the name 'q0' is that of a variable"),
     ('<Bodies', '<Corps', "the element 'Bodies' is missing"),])
def test_damaged_files_are_refused(before, after, message):
    damaged = xml().replace(before, after).replace('</Bodies',
                                                   '</Corps' if 'Corps' in after else '</Bodies')
    assert damaged != xml()
    with pytest.raises(openmm.OpenMMException, match=re.escape(message)):
        openmm.XmlSerializer.deserialize(damaged)


# ---- In a Context --------------------------------------------------------------------------------


def test_parameters_and_forces(platform):
    force = CustomBodyForce('-k*(x-x0)', '0', '3', '0', 'k', '0')
    force.addGlobalParameter('k', 10*unit.kilojoule_per_mole/unit.nanometer**2)
    force.addPerBodyParameter('x0')
    force.addBody(1, [0.5*unit.nanometer])
    system, integrator, context = scene(force, platform)
    assert dict(context.getParameters()) == {'k': 10}
    integrator.step(1)
    x = integrator.getBodyPositions()[1, 0]._value
    assert np.allclose(integrator.getBodyForces()._value, [(0, 0, 0), (-10*(x - 0.5), 0, 3)],
                       atol=1e-12)
    assert np.allclose(integrator.getBodyTorques()._value, [(0, 0, 0), (0, 10, 0)], atol=1e-12)
    context.setParameter('k', 0)
    mine = CustomBodyForce.cast(system.getForce(0))
    mine.setBodyParameters(0, 1, [9])
    mine.updateParametersInContext(context)
    integrator.step(1)
    assert np.array_equal(integrator.getBodyForces()._value, [(0, 0, 0), (0, 0, 3)])
    assert integrator.getEffects()['body forces'] == 'on: 1 body, 1 CustomBodyForce'
    assert '  body forces: 1 body, 1 CustomBodyForce\n' in integrator.describeEffects()
    with pytest.raises(openmm.OpenMMException, match='not present in the Context'):
        make().updateParametersInContext(context)


def test_a_new_expression_waits_for_reinitialize(platform):
    force = CustomBodyForce('1', *5*['0'])
    force.addBody(0)
    system, integrator, context = scene(force, platform)
    mine = CustomBodyForce.cast(system.getForce(0))
    mine.setExpression('fx', '2')
    integrator.step(1)
    assert integrator.getBodyForces()[0, 0]._value == 1
    context.reinitialize(preserveState=True)
    integrator.step(1)
    assert integrator.getBodyForces()[0, 0]._value == 2


@pytest.mark.parametrize('other', [
    lambda: openmm.VerletIntegrator(0.001), lambda: openmm.LangevinMiddleIntegrator(300, 1, 0.001)
])
def test_other_integrators_are_refused_by_name(other, platform):
    system = dumbbells(1)[0]
    system.addForce(CustomBodyForce(*6*['0']))
    integrator = other()
    with pytest.raises(
            openmm.OpenMMException,
            match=f'integrator is a {type(integrator).__name__}, which has no rigid bodies'):
        openmm.Context(system, integrator, platform)


def test_resume_through_files(tmp_path):
    platform = openmm.Platform.getPlatformByName('Reference')

    def simulation():
        force = CustomBodyForce('-20*x - 0.1*vx', 'sin(7*t)', '-20*z', 'q1*q2', 't', '-0.2*vy')
        force.addBody(0)
        force.addBody(1)
        return scene(force, platform, 300)

    system, integrator, context = simulation()
    integrator.setRandomNumberSeed(4)
    context.reinitialize(preserveState=True)
    context.setVelocitiesToTemperature(300, 3)
    integrator.step(5)
    state = openmm.XmlSerializer.serialize(
        context.getState(getPositions=True, getVelocities=True, getParameters=True,
                         getIntegratorParameters=True))
    integrator.step(30)
    _, other, twin = simulation()
    twin.setState(openmm.XmlSerializer.deserialize(state))
    other.step(30)
    assert np.array_equal(integrator.getBodyPositions()._value, other.getBodyPositions()._value)
    assert np.array_equal(integrator.getBodyForces()._value, other.getBodyForces()._value)


@pytest.mark.parametrize('scheme, order', [('LangevinA', 1), ('LangevinB', 1), ('LangevinC', 2),
                                           ('LangevinHI', 2)])
def test_order_with_velocities_and_friction(scheme, order):
    """Self-convergence at T = 0 has exactly the order that the documentation promises."""
    def run(stepSize):
        system = openmm.System()
        integrator = CustomRigidHIIntegrator(0, stepSize)
        integrator.setScheme(getattr(CustomRigidHIIntegrator, scheme))
        integrator.setFriction(0.5)
        force = CustomBodyForce('-1.5*vx*sqrt(vx^2 + vy^2) + sin(3*t)', '-2*y', '0', '0', '0', '0')
        fluid = MobilityForce()
        fluid.setViscosity(0.2)
        for body in range(2):
            system.addParticle(2)
            integrator.addRigidBody([body], 2, (1, 1, 1), [(0, 0, 0)])
            force.addBody(body)
            fluid.addParticle(0.3)
        system.addForce(force)
        if scheme == 'LangevinHI':
            system.addForce(fluid)
        context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
        context.setPositions([(0, 0, 0), (1, 0.5, 0)])
        integrator.setBodyVelocities([(2, 1, 0), (0, 1, 1)])
        integrator.step(round(2/stepSize))
        return np.concatenate(
            [integrator.getBodyPositions()._value,
             integrator.getBodyVelocities()._value])

    results = [run(h) for h in (0.02, 0.01, 0.005)]
    ratio = np.abs(results[0] - results[1]).max()/np.abs(results[1] - results[2]).max()
    assert ratio == pytest.approx(2**order, rel=0.1)


@pytest.mark.parametrize('expression', ('-x', '-vx', 'cos(t)'))
def test_one_force_evaluation_a_step(platform, expression):
    """OpenMM takes the forces for changed after every updateContextState, unless the ForceImpl says
    otherwise."""
    system = openmm.System()
    system.addParticle(1.0)
    force = CustomBodyForce(expression, '0', '0', '0', '0', '0')
    force.addBody(0, [])
    system.addForce(force)
    integrator = CustomRigidHIIntegrator(0, 0.01)
    integrator.addRigidBody([0], 1.0, (1, 1, 1), [(0, 0, 0)])
    context = openmm.Context(system, integrator, platform)
    context.setPositions([(0.1, 0, 0)])
    integrator.step(1)
    before = integrator.getStepStatistics()['forceEvaluations']
    integrator.step(10)
    assert integrator.getStepStatistics()['forceEvaluations'] - before == 10
