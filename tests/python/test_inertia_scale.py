"""setInertiaScale() for Python users: reporters, files, States, the accuracy tool, and a liquid.
The dynamics is tested in tests/platform/TestInertiaScale.cpp."""
import io

import numpy as np
import openmm
import pytest
from openmm import app, unit

import openmmrigidhi
from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, accuracy
from scenes import dumbbells

KT = unit.MOLAR_GAS_CONSTANT_R.value_in_unit(unit.kilojoule_per_mole/unit.kelvin)*300
FIVE_SIGMA = 5


def waters(waterBox, platform, factor, step=0.001):
    integrator = waterBox.integrator(stepSize=step)
    integrator.setInertiaScale(factor)
    return waterBox.simulation(platform, integrator), integrator


def state(context):
    return openmm.XmlSerializer.serialize(
        context.getState(getPositions=True, getVelocities=True, getIntegratorParameters=True))


def test_temperatures_are_those_of_the_scaled_moments(platform):
    """With drawn velocities every temperature is the wanted one, to 5 standard errors of chi^2, in
    the reporter and by hand."""
    system, positions, definitions = dumbbells(400)
    integrator = CustomRigidHIIntegrator(300, 0.001)
    for definition in definitions:
        integrator.addRigidBody(*definition)
    integrator.setInertiaScale(9)
    context = openmm.Context(system, integrator, platform)
    context.setPositions(positions)
    context.setVelocitiesToTemperature(300, 4)
    energies = np.array([
        integrator.computeTranslationalKineticEnergy()._value,
        *integrator.computeRotationalKineticEnergies()._value
    ])
    degrees = np.array([1200, 0, 400, 400])
    assert energies[1] == 0
    for energy, number in zip(energies[degrees > 0], degrees[degrees > 0]):
        assert abs(energy/(number*KT/2) - 1) < FIVE_SIGMA*np.sqrt(2/number)
    # The energy about an axis is that of I omega^2 with nine times the real moment.
    omega = integrator.getBodyAngularVelocities()._value
    moment = integrator.getRigidBodyParameters(0)[2]._value[0]
    assert moment == 0.04
    assert 0.5*9*moment*(omega**2).sum() == pytest.approx(energies.sum() - energies[0], rel=1e-12)
    assert context.getState(getEnergy=True).getKineticEnergy()._value == pytest.approx(
        energies.sum(), rel=1e-12)
    topology = app.Topology()
    chain = topology.addChain()
    for _ in range(400):
        residue = topology.addResidue('D', chain)
        for name in ('A', 'B'):
            topology.addAtom(name, app.element.carbon, residue)
    out = io.StringIO()
    reporter = openmmrigidhi.app.StateDataReporter(out, 1, temperature=True,
                                                   rotationalTemperatures=True)
    simulation = app.Simulation(topology, system, openmm.XmlSerializer.clone(integrator), platform)
    simulation.context.setState(
        context.getState(getPositions=True, getVelocities=True, getIntegratorParameters=True))
    reporter.report(
        simulation,
        simulation.context.getState(getPositions=True, getVelocities=True, getEnergy=True))
    header, values = (line.split(',') for line in out.getvalue().strip().splitlines())
    temperature = {name.strip('#"'): value for name, value in zip(header, values)}
    assert float(temperature['Temperature (K)']) == pytest.approx(energies.sum()/1000/KT*300,
                                                                  rel=1e-9)


def test_files_have_real_moments_and_angular_velocities(waterBox, platform, tmp_path):
    simulation, integrator = waters(waterBox, platform, 8)
    simulation.context.setVelocitiesToTemperature(300, 2)
    file = str(tmp_path/'bodies.h5')
    simulation.reporters.append(openmmrigidhi.app.RigidBodyReporter(file, 2))
    simulation.step(2)
    simulation.reporters.clear()
    states = openmmrigidhi.app.readBodyStates(file)
    assert np.array_equal(states.principalMoments[0]._value,
                          integrator.getRigidBodyParameters(0)[2]._value)
    assert np.allclose(states.angularVelocities[-1]._value,
                       integrator.getBodyAngularVelocities()._value, rtol=1e-6)
    plain, real = waters(waterBox, platform, 1)
    plain.step(1)
    assert np.array_equal(
        real.getRigidBodyParameters(0)[2]._value, states.principalMoments[0]._value)


@pytest.mark.parametrize('way', ['checkpoint', 'State'])
def test_a_saved_state_goes_on_under_another_factor(waterBox, platform, way):
    """A run may equilibrate with slow rotation and produce with the real one. Positions and
    velocities go on, and energies of rotation follow the factor."""
    simulation, slow = waters(waterBox, platform, 8)
    simulation.context.setVelocitiesToTemperature(300, 2)
    simulation.step(3)
    saved = simulation.context.createCheckpoint() if way == 'checkpoint' else state(
        simulation.context)
    other, real = waters(waterBox, platform, 1)
    other.step(1)
    if way == 'checkpoint':
        other.context.loadCheckpoint(saved)
    else:
        other.context.setState(openmm.XmlSerializer.deserialize(saved))
    assert np.array_equal(real.getBodyPositions()._value, slow.getBodyPositions()._value)
    assert np.allclose(real.getBodyAngularVelocities()._value,
                       slow.getBodyAngularVelocities()._value, rtol=1e-13, atol=1e-12)
    assert np.allclose(8*real.computeRotationalKineticEnergies()._value,
                       slow.computeRotationalKineticEnergies()._value, rtol=1e-13)
    assert real.computeTranslationalKineticEnergy() == slow.computeTranslationalKineticEnergy()
    other.step(2)


def test_reinitialize_takes_the_new_factor_along(waterBox, platform):
    simulation, integrator = waters(waterBox, platform, 2)
    simulation.context.setVelocitiesToTemperature(300, 2)
    simulation.step(2)
    integrator.setInertiaScale(6)
    spins, energies = integrator.getBodyAngularVelocities(
    )._value, integrator.computeRotationalKineticEnergies()._value
    simulation.context.reinitialize(preserveState=True)
    assert integrator.getInertiaScale() == 6
    assert np.array_equal(integrator.getBodyAngularVelocities()._value, spins)
    assert np.array_equal(integrator.computeRotationalKineticEnergies()._value, energies)
    simulation.step(2)


def test_effects_say_that_motion_is_not_the_real_one(waterBox, platform):
    simulation, integrator = waters(waterBox, platform, 1)
    assert integrator.getEffects(
    )['inertia scale'] == 'off: the dynamics has the real principal moments'
    integrator.setInertiaScale(4)
    assert 'inertia scale: the dynamics has the principal moments times 4: averages over ' \
           'configurations do not depend on this factor, ' \
           'but the motion is not the real one' in integrator.describeEffects()
    integrator.setScheme(integrator.GradientThermostat)
    assert integrator.getEffects(
    )['inertia scale'] == 'off: the scheme has no momenta, so that the factor 4 has no effect'


def test_long_time_diffusion_in_a_fluid_is_the_real_one():
    """Rotational diffusion of spheres under LangevinHI: momenta relax more slowly by the factor,
    but D = kT/friction stays.

    <cos> of the angle that an axis turns by in the time t is exp(-2 D t), except for a relaxation
    time. For the moment I and the friction xi it is exp(-2 D (t - I/xi (1 - exp(-xi t/I)))) to
    first order in D I/xi, here below 0.01. Steps of length h of Langevin C have the diffusion D
    x/tanh(x), x = h xi/(2 I).
    """
    bodies, kT, friction, moment, step, steps = 600, 1.0, 8.0, 0.1, 0.005, 100
    D, t = kT/friction, steps*step
    for factor in (1, 5):
        system, fluid = openmm.System(), MobilityForce()
        system.addForce(fluid)
        fluid.setModel(MobilityForce.FreeDraining)
        radius = 0.5
        fluid.setViscosity(friction/(8*np.pi*radius**3))
        integrator = CustomRigidHIIntegrator(300*kT/KT, step)
        integrator.setScheme(CustomRigidHIIntegrator.LangevinHI)
        integrator.setRandomNumberSeed(8)
        integrator.setInertiaScale(factor)
        for body in range(bodies):
            system.addParticle(1)
            fluid.addParticle(radius)
            integrator.addRigidBody([body], 1, (moment,)*3, [(0, 0, 0)])
        context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
        context.setPositions([(2*body, 0, 0) for body in range(bodies)])
        context.setVelocitiesToTemperature(integrator.getTemperature(), 3)
        before = integrator.getBodyOrientations()
        turns = []
        for _ in range(8):
            integrator.step(steps)
            after = integrator.getBodyOrientations()
            w = (before*after).sum(axis=1)
            turns.append((4*w**2 - 1)/3)  # the mean of the three axes' cosines: trace/3
            before = after
        turns = np.concatenate(turns)
        relaxation = factor*moment/friction
        x = step/(2*relaxation)
        expected = np.exp(-2*D*x/np.tanh(x)*(t - relaxation*(1 - np.exp(-t/relaxation))))
        z = (turns.mean() - expected)/(turns.std()/np.sqrt(len(turns)))
        print(f'factor {factor}: <cos> {turns.mean():.4f}, expected {expected:.4f}, z = {z:.2f}')
        assert abs(z) < FIVE_SIGMA
        # The test would detect a diffusion that is slower by the factor.
        assert factor == 1 or (np.exp(-2*D*t/factor) -
                               expected)/(turns.std()/np.sqrt(len(turns))) > 2*FIVE_SIGMA


def test_the_accuracy_tool_compares_inertia_scales():
    method = accuracy.methods.byName('LangevinC-I8')
    scene = accuracy.scenes.trap(2)
    integrator = method.makeIntegrator(scene, 0.003, 5)
    assert integrator.getInertiaScale() == 8 and integrator.getScheme(
    ) == CustomRigidHIIntegrator.LangevinC
    assert (method.order == 2 and method.name == 'LangevinC-I8'
            and 'moments times 8' in method.description)
    assert accuracy.methods.byName('LangevinC').makeIntegrator(scene, 0.003,
                                                               5).getInertiaScale() == 1
    for wrong in ('GradientThermostat-I8', 'LangevinMiddle-I8', 'LangevinC-I0', 'LangevinC-Inf',
                  'LangevinC-I', 'LangevinC-I-2', 'Verlet-I2'):
        with pytest.raises(ValueError, match='such as LangevinC-I8'):
            accuracy.methods.byName(wrong)
