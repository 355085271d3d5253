"""The integrator on a platform that keeps particles on a device. OpenCL, which also runs on
processors, stands for all such platforms.

Only forces are computed on the device. So a few steps differ from those on Reference by no more
than the rounding of forces and positions.
"""
import os
import subprocess
import sys

import numpy as np
import openmm
import pytest
from openmm import unit

import openmmrigidhi
from openmmrigidhi import CustomBodyForce, CustomRigidHIIntegrator, MobilityForce
from openmmrigidhi._schemes import TABLE

REFERENCE = openmm.Platform.getPlatformByName('Reference')


def device():
    """The OpenCL platform in double precision. Without a device for it the test is skipped with the
    reason."""
    names = [
        openmm.Platform.getPlatform(i).getName() for i in range(openmm.Platform.getNumPlatforms())
    ]
    if 'OpenCL' not in names:
        pytest.skip('OpenMM has no platform OpenCL')
    platform = openmm.Platform.getPlatformByName('OpenCL')
    system = openmm.System()
    system.addParticle(1)
    try:
        openmm.Context(system, openmm.VerletIntegrator(0.001), platform)
    except openmm.OpenMMException as error:
        pytest.skip(f'no device for platform OpenCL: {error}')
    return platform


@pytest.fixture(scope='module')
def opencl():
    platform = device()
    openmmrigidhi.checkPlatform(platform)
    return platform


def trimers(scheme):
    """Three bodies in a trap, one of them driven. They feel each other through a fluid if the
    scheme needs a fluid."""
    system, integrator, momenta = openmm.System(), CustomRigidHIIntegrator(
        300, 0.002), not scheme.isOverdamped
    integrator.setScheme(scheme.number)
    integrator.setRandomNumberSeed(3)
    sites = [(0, 0, 0), (0.2, 0, 0), (0, 0.3, 0)]
    positions = []
    for k in range(3):
        particles = [system.addParticle(mass if momenta else 0) for mass in (16, 2, 3)]
        if momenta:
            integrator.addRigidBody(particles)
        else:
            integrator.addRigidBody(particles, 0, (0, 0, 0), sites)
        positions += [np.array(site) + (0.8*k, 0.1*k, -0.2*k) for site in sites]
    trap = openmm.CustomExternalForce('k/2*(x^2+2*y^2+3*z^2)')
    trap.addGlobalParameter('k', 50)
    for particle in range(9):
        trap.addParticle(particle)
    system.addForce(trap)
    drive = CustomBodyForce('3 - x', '0', '0', '0', '0', '0')
    drive.addBody(0)
    system.addForce(drive)
    if scheme.needsFluid:
        fluid = MobilityForce()
        fluid.setViscosity(500)
        for _ in range(9):
            fluid.addParticle(0.08)
        system.addForce(fluid)
    return system, integrator, np.array(positions)


def context(scene, platform, precision=None):
    system, integrator, positions = scene
    made = openmm.Context(system, integrator, platform,
                          {'Precision': precision} if precision else {})
    made.setPositions(positions)
    return made


def bodies(integrator):
    return np.hstack([integrator.getBodyPositions()._value, integrator.getBodyOrientations()])


def test_every_scheme_takes_the_steps_of_reference(opencl):
    for scheme in TABLE:
        ours, theirs = trimers(scheme), trimers(scheme)
        on_device, on_reference = context(ours, opencl, 'double'), context(theirs, REFERENCE)
        ours[1].step(3)
        ours[1].step(4)
        theirs[1].step(7)
        assert np.abs(bodies(ours[1]) - bodies(theirs[1])).max() < 1e-9, scheme.name
        positions, expected = (c.getState(getPositions=True).getPositions(asNumpy=True)._value
                               for c in (on_device, on_reference))
        assert np.abs(positions - expected).max() < 1e-9, scheme.name
        assert on_device.getState().getTime() == on_reference.getState().getTime()


@pytest.mark.parametrize('precision', [
    'double',
    pytest.param('single', marks=pytest.mark.full),
    pytest.param('mixed', marks=pytest.mark.full)
])
def test_a_resumed_run_is_the_uninterrupted_one_to_rounding(opencl, precision):
    scheme = TABLE[CustomRigidHIIntegrator.LangevinC]
    scenes = [trimers(scheme) for _ in range(3)]
    whole, byState, byCheckpoint = (context(scene, opencl, precision) for scene in scenes)
    whole.setVelocitiesToTemperature(300*unit.kelvin, 1)
    scenes[0][1].step(20)
    byState.setState(
        whole.getState(getPositions=True, getVelocities=True, getIntegratorParameters=True))
    byCheckpoint.loadCheckpoint(whole.createCheckpoint())
    saved = bodies(scenes[0][1])
    for scene in scenes[1:]:
        assert np.array_equal(bodies(scene[1]),
                              saved)  # the doubles, not what the device holds of them
    for scene in scenes:
        scene[1].step(20)
    for scene in scenes[1:]:
        assert np.abs(bodies(scene[1]) -
                      bodies(scenes[0][1])).max() < (1e-10 if precision == 'double' else 1e-5)


def test_what_others_do_is_honoured(opencl):
    """Changes by users, by OpenMM's constraints and by CMMotionRemover are taken into account."""
    system, integrator, positions = trimers(TABLE[CustomRigidHIIntegrator.LangevinC])
    system.addForce(openmm.CMMotionRemover(2))
    integrator.setTemperature(0)
    integrator.setFriction(0)
    integrator.setIntegrationForceGroups(0)
    made = context((system, integrator, positions), opencl, 'single')
    integrator.step(1)
    made.setPositions(positions + (0.25, 0, 0))
    assert np.allclose(
        integrator.getBodyPositions()._value[0] - positions[0],
        np.array([0.25, 0, 0]) +
        np.average(positions[:3] - positions[0], weights=(16, 2, 3), axis=0), atol=1e-6)
    for step in (1, 2, 3, 4):
        made.setVelocities(np.tile((1.0, 2.0, 3.0), (9, 1)))
        integrator.step(1)
        left = made.getState(getVelocities=True).getVelocities(asNumpy=True)._value
        assert np.allclose(left, 0 if step % 2 == 0 else (1, 2, 3), atol=1e-6), step


def test_water_with_virtual_sites_barostat_and_minimisers(opencl, waterBox):
    system = openmm.XmlSerializer.clone(waterBox.system)
    simulation = {}
    for name, platform in (('device', opencl), ('Reference', REFERENCE)):
        integrator = waterBox.integrator()
        properties = {'Precision': 'double'} if name == 'device' else {}
        simulation[name] = openmm.Context(system, integrator, platform, properties)
        simulation[name].setPositions(waterBox.positions)
        openmmrigidhi.app.minimize(simulation[name], maxIterations=20)
    # The minimisations differ by rounding. So the device begins with the positions of Reference.
    start = simulation['Reference'].getState(getPositions=True).getPositions()
    for made in simulation.values():
        made.setPositions(start)
        made.setVelocitiesToTemperature(300*unit.kelvin, 2)
        made.getIntegrator().step(5)
    positions = [
        made.getState(getPositions=True).getPositions(asNumpy=True)._value
        for made in simulation.values()
    ]
    assert np.abs(positions[0] - positions[1]).max() < 1e-6
    del simulation, made

    system.addForce(openmm.MonteCarloBarostat(1*unit.bar, 300*unit.kelvin, 2))
    integrator = waterBox.integrator()
    made = openmm.Context(system, integrator, opencl, {'Precision': 'single'})
    made.setPositions(start)
    openmm.LocalEnergyMinimizer.minimize(made, 100, 20)
    before = made.getState().getPeriodicBoxVolume()
    integrator.step(40)
    state = made.getState(getPositions=True)
    assert state.getPeriodicBoxVolume() != before
    x = state.getPositions(asNumpy=True)._value.reshape(-1, 4, 3)
    assert np.allclose(np.linalg.norm(x[:, 1] - x[:, 0], axis=1), 0.09572, atol=1e-6)
    assert np.allclose(x[:, 3], 0.786646558*x[:, 0] + 0.106676721*(x[:, 1] + x[:, 2]), atol=1e-6)
    assert integrator.getPoseResidual()._value < 1e-5


def test_number_of_host_threads(opencl, monkeypatch):
    def threads(number):
        scene = trimers(TABLE[CustomRigidHIIntegrator.LangevinHI])
        scene[1].setNumHostThreads(number)
        made = context(scene, opencl, 'double')
        scene[1].step(3)
        return scene[1].describeEffects(), bodies(scene[1]), made

    monkeypatch.setenv('OPENMM_CPU_THREADS', '3')
    assert '3 threads' in threads(0)[0]
    one, two = threads(1), threads(2)
    assert ' 1 thread,' in one[0] and ' 2 threads' in two[0]
    assert np.array_equal(one[1], two[1])


def test_non_finite_forces_name_the_body(opencl):
    system, integrator, positions = trimers(TABLE[CustomRigidHIIntegrator.LangevinC])
    bad = openmm.CustomExternalForce('broken*sqrt(-1-x*x)')
    bad.addGlobalParameter('broken', 0)
    made = context((system, integrator, positions), opencl)
    system.addForce(bad)
    bad = system.getForce(system.getNumForces() - 1)
    bad.addParticle(4)
    made.reinitialize()
    made.setPositions(positions)
    made.setParameter('broken', 1)
    with pytest.raises(openmm.OpenMMException, match='step 1: body 1 .* has a non-finite force'):
        integrator.step(1)


def test_without_a_name_openmm_takes_the_fastest_platform(opencl, monkeypatch):
    monkeypatch.delenv('OPENMM_DEFAULT_PLATFORM', raising=False)
    system, integrator, positions = trimers(TABLE[CustomRigidHIIntegrator.LangevinC])
    fastest = max((openmm.Platform.getPlatform(i)
                   for i in range(openmm.Platform.getNumPlatforms())), key=lambda p: p.getSpeed())
    assert openmm.Context(system, integrator).getPlatform().getName() == fastest.getName()


#: Two steps on OpenCL; prints where bodies move, and the platform.
STEPS = """
system, integrator = openmm.System(), openmmrigidhi.CustomRigidHIIntegrator(300, 0.001)
integrator.addRigidBody([system.addParticle(1)])
context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('OpenCL'))
context.setPositions([(0, 0, 0)])
integrator.step(2)
print(integrator.getEffects()['bodies on the device'])
print(context.getPlatform().getName())
"""
LATE = """
import glob, os, sys
import openmm, openmmrigidhi
names = lambda: [openmm.Platform.getPlatform(i).getName()
                 for i in range(openmm.Platform.getNumPlatforms())]
assert 'OpenCL' not in names()
openmm.Platform.loadPluginLibrary(os.path.join(sys.argv[1], 'libOpenMMOpenCL.so'))
assert 'OpenCL' in names()
for _ in range(2):
    openmmrigidhi.checkPlatform('OpenCL')
"""


def test_a_platform_that_is_loaded_later_is_served(opencl, tmp_path):
    finished = subprocess.run(
        [sys.executable, '-c', LATE + STEPS,
         openmm.Platform.getDefaultPluginsDirectory()], capture_output=True, text=True,
        env=dict(os.environ, OPENMM_PLUGIN_DIR=str(tmp_path)))
    assert finished.returncode == 0, finished.stderr
    *_, bodies, name = finished.stdout.splitlines()
    assert name == 'OpenCL'
    # The library of this package for OpenCL, not only the one for every platform.
    assert bodies.startswith('on: ')


WITHOUT_LIBRARY = '''
import sys, warnings
import openmm, openmmrigidhi
from openmmrigidhi import _loading
library = 'libOpenMMRigidHIOpenCL.so'
found = _loading.find_platform_library
_loading.find_platform_library = lambda name: None if name == library else found(name)
openmm.Platform.loadPluginLibrary(sys.argv[1] + '/libOpenMMOpenCL.so')
for _ in range(2):
    with warnings.catch_warnings(record=True) as caught:
        openmmrigidhi.checkPlatform('OpenCL')
    message, = (str(each.message) for each in caught)
    assert 'the host moves bodies' in message and library in message, message
'''


def test_a_platform_without_the_library_of_its_bodies_says_so(opencl, tmp_path):
    finished = subprocess.run([
        sys.executable, '-c', WITHOUT_LIBRARY + STEPS,
        openmm.Platform.getDefaultPluginsDirectory()
    ], capture_output=True, text=True, env=dict(os.environ, OPENMM_PLUGIN_DIR=str(tmp_path)))
    assert finished.returncode == 0, finished.stderr
    *_, bodies, _ = finished.stdout.splitlines()
    assert bodies.startswith('off: ') and 'libOpenMMRigidHIOpenCL.so is not loaded' in bodies
