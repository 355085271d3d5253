"""Systems that the integrator does not support are refused when the Context is created, with the
reason and the remedy."""
import pathlib
import re
import shutil
import subprocess
import sys
import textwrap

import numpy as np
import openmm
import pytest

import openmmrigidhi

Integrator = openmmrigidhi.CustomRigidHIIntegrator


def refused(*pieces):
    return pytest.raises(openmm.OpenMMException,
                         match='.*'.join(re.escape(piece) for piece in pieces))


def system_of(*masses):
    system = openmm.System()
    for mass in masses:
        system.addParticle(mass)
    return system


def integrator_of(*bodies, scheme=None):
    integrator = Integrator(300, 0.001)
    for body in bodies:
        integrator.addRigidBody(body)
    if scheme is not None:
        integrator.setScheme(scheme)
    return integrator


# ---- Particles and bodies ------------------------------------------------------------------------


@pytest.mark.parametrize(
    'scheme',
    [scheme for scheme in openmmrigidhi.integrator.Scheme if not scheme.traits.needsFluid])
def test_a_massless_body(platform, scheme):
    with refused('body 0 has mass 0', f'scheme {scheme.name} needs a positive mass',
                 'add the body with explicit mass',
                 'a scheme without momenta such as FixmanMidpoint, with a MobilityForce'):
        openmm.Context(system_of(0, 0), integrator_of([0, 1], scheme=scheme), platform)
    integrator = Integrator(300, 0.001)
    integrator.setScheme(scheme)
    integrator.addRigidBody([0, 1], 2.0, (0, 1, 1), [(-0.1, 0, 0), (0.1, 0, 0)])
    openmm.Context(system_of(0, 0), integrator, platform)


def test_a_virtual_site_outside_that_depends_on_a_body(platform):
    system = system_of(1, 1, 0)
    system.setVirtualSite(2, openmm.TwoParticleAverageSite(0, 1, 0.5, 0.5))
    with refused(
            'virtual site particle 2 depends on particle 0 of body 0',
            'belong in one body: add all of them to it (for water, give addRigidWater() the System)'
    ):
        openmm.Context(system, integrator_of([0, 1]), platform)


def symmetrySite(parent):
    if not hasattr(openmm, 'SymmetrySite'):
        pytest.skip('this OpenMM has no SymmetrySite')
    return openmm.SymmetrySite(parent, openmm.Vec3(-1, 0, 0), openmm.Vec3(0, -1, 0),
                               openmm.Vec3(0, 0, 1), openmm.Vec3(0, 0, 0.5), False)


def test_a_symmetry_site_among_free_particles_is_none(platform):
    system = system_of(1, 1, 2, 0)
    system.setVirtualSite(3, symmetrySite(2))
    integrator = integrator_of([0, 1])
    context = openmm.Context(system, integrator, platform)
    context.setPositions([(0, 0, 0), (0.1, 0, 0), (1, 2, 3), (0, 0, 0)])
    context.setVelocitiesToTemperature(300, 1)
    integrator.step(10)
    x = context.getState(getPositions=True).getPositions(asNumpy=True)._value
    assert abs(x[2] - [1, 2, 3]).max() > 1e-4
    assert x[3] == pytest.approx([-x[2, 0], -x[2, 1], x[2, 2] + 0.5], abs=1e-7)


def test_an_explicit_site_that_contradicts_the_virtual_site(platform):
    system = system_of(1, 1, 0)
    system.setVirtualSite(2, openmm.TwoParticleAverageSite(0, 1, 0.5, 0.5))
    integrator = Integrator(300, 0.001)
    integrator.addRigidBody([0, 1, 2], 2, (0, 1, 1), [(-0.1, 0, 0), (0.1, 0, 0), (0.05, 0, 0)])
    with refused('body 0: the site given for particle 2 is 0.05 nm', 'from where the System',
                 'mend the site position'):
        openmm.Context(system, integrator, platform)


# ---- Constraints that no shape satisfies ---------------------------------------------------------


def test_a_triangle_that_does_not_close(platform):
    system = system_of(1, 1, 1)
    for i, j, d in [(0, 1, 0.1), (0, 2, 0.1), (1, 2, 0.3)]:
        system.addConstraint(i, j, d)
    with refused('body 0: constraint lengths 0.1', 'nm violate the triangle inequality',
                 "mend the System's constraints"):
        openmm.Context(system, integrator_of([0, 1, 2]), platform)


def test_distances_that_do_not_fit_into_space(platform):
    system = system_of(1, 1, 1, 1, 1)
    for i in range(5):
        for j in range(i):
            system.addConstraint(i, j, 0.1)  # five points at equal distances need four dimensions
    with refused('body 0: the constraints between particles',
                 'cannot be satisfied in three dimensions'):
        integrator = integrator_of(range(5))
        context = openmm.Context(system, integrator, platform)
        context.setPositions(np.random.default_rng(1).random((5, 3)))
        integrator.step(1)


# ---- Periodic boundaries -------------------------------------------------------------------------


def periodic_system():
    system = system_of(1, 1, 1)
    force = openmm.NonbondedForce()
    force.setNonbondedMethod(openmm.NonbondedForce.CutoffPeriodic)
    force.setCutoffDistance(0.5)
    for _ in range(3):
        force.addParticle(0, 0.1, 0)
    system.addForce(force)
    return system


def test_a_body_of_several_molecules_in_a_periodic_system(platform):
    with refused('body 0: particle 0 and particle 1 are in different molecules',
                 'bindBodies(system, integrator)'):
        openmm.Context(periodic_system(), integrator_of([0, 1, 2]), platform)
    system, integrator = periodic_system(), integrator_of([0, 1, 2])
    openmmrigidhi.app.bindBodies(system, integrator)
    openmm.Context(system, integrator, platform)


# ---- Forces --------------------------------------------------------------------------------------


def test_a_flexible_barostat(platform):
    if not hasattr(openmm, 'MonteCarloFlexibleBarostat'):
        pytest.skip('this OpenMM has no MonteCarloFlexibleBarostat')
    system = periodic_system()
    integrator = integrator_of([0, 1, 2])
    openmmrigidhi.app.bindBodies(system, integrator)
    system.addForce(openmm.MonteCarloFlexibleBarostat(1, 300))
    with refused('a MonteCarloFlexibleBarostat, may deform rigid bodies',
                 'use a MonteCarloBarostat'):
        openmm.Context(system, integrator, platform)


@pytest.mark.parametrize('make', [
    lambda: openmm.MonteCarloBarostat(1, 300), lambda: openmm.MonteCarloAnisotropicBarostat(
        (1, 1, 1), 300),
    lambda: openmm.MonteCarloMembraneBarostat(1, 0, 300, openmm.MonteCarloMembraneBarostat.
                                              XYIsotropic, openmm.MonteCarloMembraneBarostat.ZFree)
], ids=['isotropic', 'anisotropic', 'membrane'])
def test_a_barostat_that_scales_particles_independently(platform, make):
    barostat = make()
    if not hasattr(barostat, 'setScaleMoleculesAsRigid'):
        pytest.skip('barostats of this OpenMM keep molecules rigid')
    system = periodic_system()
    openmmrigidhi.app.bindBodies(system, integrator_of([0, 1, 2]))
    force = system.getForce(system.addForce(barostat))
    openmm.Context(system, integrator_of([0, 1, 2]), platform)
    force.setScaleMoleculesAsRigid(False)
    with refused(f'a {type(barostat).__name__}, scales the particles of a molecule independently',
                 'setScaleMoleculesAsRigid(true)'):
        openmm.Context(system, integrator_of([0, 1, 2]), platform)


def test_drude_particles():
    system = system_of(1, 0.1)
    force = openmm.DrudeForce()
    force.addParticle(1, 0, -1, -1, -1, -0.1, 0.001, 1, 1)
    system.addForce(force)
    with refused('force 0, a DrudeForce, needs an integrator for Drude particles',
                 'DrudeLangevinIntegrator'):
        openmm.Context(system, integrator_of([0, 1]),
                       openmm.Platform.getPlatformByName('Reference'))


# ---- The gradient thermostat ---------------------------------------------------------------------


def test_the_gradient_thermostat_has_no_constraints_of_free_particles(platform):
    system = system_of(1, 1, 1, 1)
    system.addConstraint(2, 3, 0.1)
    with refused('the System has 1 constraints between particles that are in no body',
                 'GradientThermostat allows none'):
        openmm.Context(system, integrator_of([0, 1], scheme=Integrator.GradientThermostat),
                       platform)


@pytest.mark.parametrize('barostat', [
    openmm.MonteCarloBarostat(1, 300),
    openmm.MonteCarloAnisotropicBarostat(openmm.Vec3(1, 1, 1), 300),
    openmm.MonteCarloMembraneBarostat(1, 0, 300, 0, 0)
])
def test_the_gradient_thermostat_has_no_barostat(platform, barostat):
    system = periodic_system()
    integrator = integrator_of([0, 1, 2], scheme=Integrator.GradientThermostat)
    openmmrigidhi.app.bindBodies(system, integrator)
    system.addForce(openmm.XmlSerializer.clone(barostat))
    with refused(
            f'the System has a {type(barostat).__name__}, which is supported with the schemes '
            f'LangevinA', 'change the scheme or remove the barostat'):
        openmm.Context(system, integrator, platform)


def test_a_scheme_is_checked_when_it_is_changed(platform):
    system = system_of(1, 1)
    system.addForce(openmm.CMMotionRemover())
    integrator = integrator_of([0, 1])
    context = openmm.Context(system, integrator, platform)
    context.setPositions([(0, 0, 0), (0.1, 0, 0)])
    integrator.step(1)
    integrator.setScheme(Integrator.GradientThermostat)
    with refused('has no momenta to remove'):
        integrator.step(1)
    integrator.setScheme(Integrator.LangevinB)
    integrator.step(1)


# ---- Contexts and platforms ----------------------------------------------------------------------


def test_part_of_another_integrator(platform):
    compound = openmm.CompoundIntegrator()
    compound.addIntegrator(integrator_of([0, 1]))
    with refused('this integrator is part of another integrator',
                 'do not put it into a CompoundIntegrator'):
        openmm.Context(system_of(1, 1), compound, platform)


def test_platforms_without_our_kernels():
    with refused("openmmrigidhi: platform 'Abacus': OpenMM has no platform of this name",
                 'load its plugin first'):
        openmmrigidhi.checkPlatform('Abacus')


def broken_package(tmp_path, damage, then=''):
    """Import a copy of the package after `damage`, and run a line; returns what Python wrote to
    standard error."""
    source = pathlib.Path(openmmrigidhi.__file__).parent
    copy = tmp_path/'openmmrigidhi'
    shutil.copytree(source, copy, symlinks=False)
    damage(copy)
    script = textwrap.dedent(f'''
        import sys
        sys.path.insert(0, {str(tmp_path)!r})
        import openmmrigidhi
        {then}
    ''')
    return subprocess.run([sys.executable, '-I', '-c', script], capture_output=True,
                          text=True).stderr


def test_a_package_without_platform_libraries(tmp_path):
    def damage(package):
        for library in (package/'lib'/'plugins').iterdir():
            library.unlink()

    errors = broken_package(tmp_path, damage)
    assert 'openmmrigidhi: found no platform library (libOpenMMRigidHI*.so) in ' in errors
    assert 'ImportError' in errors and str(tmp_path) in errors


def test_a_platform_library_that_does_not_load(tmp_path):
    errors = broken_package(
        tmp_path, lambda package: (package/'lib'/'plugins'/'libOpenMMRigidHICPU.so').write_text(''))
    assert 'openmmrigidhi: cannot load the platform library libOpenMMRigidHICPU.so from ' in errors


def test_a_platform_whose_library_is_missing(tmp_path):
    errors = broken_package(
        tmp_path, lambda package: (package/'lib'/'plugins'/'libOpenMMRigidHICPU.so').unlink(),
        'openmmrigidhi.checkPlatform("CPU")')
    assert "openmmrigidhi: platform 'CPU': it has no kernels of this plugin" in errors
    assert "use one of Reference" in errors


def test_a_package_without_its_binding_module(tmp_path):
    errors = broken_package(tmp_path, lambda package: (package/'_openmmrigidhi.so').unlink())
    assert 'openmmrigidhi: cannot load its binding module _openmmrigidhi.so from ' in errors


# ---- Definitions that change under a Context -----------------------------------------------------


def test_bodies_that_change_under_a_context_wait_for_the_next_one(platform):
    """Whatever definitions change meanwhile, the Context keeps the bodies with which it was
    created."""
    integrator = integrator_of([0, 1, 2])
    context = openmm.Context(system_of(*[1]*6), integrator, platform)
    positions = np.random.default_rng(1).random((6, 3))
    context.setPositions(positions)
    integrator.step(2)
    integrator.addRigidBody([3, 4])
    integrator.setRigidBodyParameters(0, [0, 1, 2000000], 1, (1, 1, 1), [(0, 0, 0), (0.1, 0, 0),
                                                                         (0, 0.1, 0)])
    integrator.step(2)
    context.setPositions(positions)
    integrator.step(2)
    assert integrator.getBodyPositions().shape == (1, 3)
    context.loadCheckpoint(context.createCheckpoint())
    integrator.step(2)
    with refused('body 0: particle index 2000000 is out of range'):
        context.reinitialize()


def test_bodies_that_change_before_positions_are_known(platform):
    integrator = integrator_of([0, 1, 2])
    context = openmm.Context(system_of(*[1]*6), integrator, platform)
    integrator.setRigidBodyParameters(0, [3, 4], 1, (1, 1, 1), [(0, 0, 0), (0.1, 0, 0)])
    context.setPositions(np.random.default_rng(1).random((6, 3)))
    integrator.step(2)
    assert integrator.getRigidBodyParameters(0)[0] == [3, 4]
    context.reinitialize()
