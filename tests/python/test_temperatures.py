"""Mid-step temperatures, and the watch that warns of bodies that stay too hot or too cold.

Closed forms are in tests/unit/TestMidStep.cpp, changes from outside, resumed runs and small systems
in tests/platform/TestTemperatures.cpp. Here are water, and what Python adds.
"""
import numpy as np
import openmm
import pytest
from openmm import unit

import openmmrigidhi
from openmmrigidhi import CustomRigidHIIntegrator
from scenes import WaterBox


def run(side, stepSize, friction, steps, scheme=CustomRigidHIIntegrator.LangevinC):
    """Water on the CPU platform from a minimum; the warnings and mean mid-step temperatures.

    The start is cold: the watch waits until it has relaxed.
    """
    box = WaterBox(side)
    integrator = box.integrator(300, stepSize)
    integrator.setScheme(scheme)
    integrator.setFriction(friction)
    integrator.setRotationalFriction(friction)
    simulation = box.simulation(openmm.Platform.getPlatformByName('CPU'), integrator)
    openmmrigidhi.app.minimize(simulation.context)
    # The last part of a lattice's tension goes at a short step.
    integrator.setStepSize(0.002)
    integrator.step(2000)
    integrator.setStepSize(stepSize)
    means = []
    for _ in range(steps // 100):
        integrator.step(100)
        temperatures = integrator.computeMidStepTemperatures()
        means.append([temperatures[name]._value for name in ('translational', 'rotational')])
    return integrator.getEffects()['warnings'], np.mean(means, axis=0)


def wells(platform, scheme, stepSize, friction=20.0, count=40):
    """Spheres of 2 dalton in wells of frequency 20/ps."""
    system = openmm.System()
    well = openmm.CustomExternalForce('400*((x-x0)^2+y^2+z^2)')
    well.addPerParticleParameter('x0')
    integrator = CustomRigidHIIntegrator(300, stepSize)
    for i in range(count):
        well.addParticle(system.addParticle(2), [float(i)])
        integrator.addRigidBody([i], 2, (0.3, 0.4, 0.5), [(0, 0, 0)])
    system.addForce(well)
    integrator.setScheme(scheme)
    integrator.setFriction(friction)
    integrator.setRotationalFriction(friction)
    integrator.setRandomNumberSeed(1)
    context = openmm.Context(system, integrator, platform)
    context.setPositions([(i, 0, 0) for i in range(count)])
    context.setVelocitiesToTemperature(300, 1)
    return integrator, context


def test_mid_step_temperatures_are_quantities_by_name(platform):
    integrator, _context = wells(platform, CustomRigidHIIntegrator.LangevinC, 0.01)
    temperature = integrator.computeMidStepTemperature()
    parts = integrator.computeMidStepTemperatures()
    assert set(parts) == {'translational', 'rotational', 'total'}
    assert parts['total'] == temperature and temperature.unit == unit.kelvin
    assert 200*unit.kelvin < parts['rotational'] < 400*unit.kelvin


def test_a_step_that_is_too_long_is_printed_once(platform, capfd):
    """LangevinB at h omega = 1 moves bodies with 4/3 of the temperature."""
    integrator, _context = wells(platform, CustomRigidHIIntegrator.LangevinB, 0.05)
    integrator.step(7900)
    assert capfd.readouterr().err == ''
    integrator.step(8100)
    printed = capfd.readouterr().err
    assert printed.count('translations of bodies have been at') == 1
    assert 'instead of 300 K: the step is too long, or forces are not conservative' in printed
    assert 'translations of bodies have been at' in integrator.describeEffects()
    assert not integrator.getEffects()['warnings'].startswith('off')


def test_a_right_run_prints_nothing(platform, capfd):
    """LangevinC at the same step, where the temperature between steps is a quarter too low."""
    integrator, _context = wells(platform, CustomRigidHIIntegrator.LangevinC, 0.05)
    integrator.step(16000)
    assert capfd.readouterr().err == '' and integrator.getEffects()['warnings'] == 'off: none'


def test_rotation_that_is_not_resolved_names_a_bound_of_free_rotation_alone(platform):
    integrator, _context = wells(platform, CustomRigidHIIntegrator.LangevinC, 0.5)
    warning = integrator.getEffects()['warnings']
    assert 'does not resolve the rotation of 40 bodies' in warning
    assert 'free rotation alone needs a step of 0.155' in warning
    assert 'forces may need a far smaller one: watch computeMidStepTemperature()' in warning


def test_a_few_waters_at_a_right_step(capfd):
    warnings, means = run(3, 0.004, 5, 8400)
    assert warnings == 'off: none' and capfd.readouterr().err == ''
    np.testing.assert_allclose(means, 300, rtol=0.1)


@pytest.mark.full
@pytest.mark.parametrize('stepSize, friction, steps', [(0.009, 1, 40000), (0.01, 5, 12500)])
def test_water_at_steps_that_are_too_long(stepSize, friction, steps):
    """At 9 fs and 1/ps the potential energy is 3 % off, at 10 fs and 5/ps 5 %. Windows are 12100
    and 4000 steps long, and rotations are at 340 to 380 K."""
    warnings, means = run(6, stepSize, friction, steps)
    assert 'rotations of bodies have been at' in warnings
    assert means[1] > 335


@pytest.mark.long
@pytest.mark.parametrize('friction', [1, 5])
@pytest.mark.parametrize('stepSize', [0.004, 0.007])
def test_water_at_right_steps(stepSize, friction, capfd):
    warnings, means = run(6, stepSize, friction, 100000)
    assert warnings == 'off: none' and 'bodies have been at' not in capfd.readouterr().err
    np.testing.assert_allclose(means, 300, rtol=0.06)
