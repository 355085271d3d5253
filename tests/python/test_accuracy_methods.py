"""openmmrigidhi.accuracy: methods by name with frictions, with heavy hydrogens, and with reciprocal
space in fewer steps. Also the observables dipole moment and diffusion.

Statistical tests have fixed seeds and print z; the limit of 4.5 is passed by chance with
probability 7e-6 per comparison.
"""
import math

import numpy as np
import openmm
import pytest

import openmmrigidhi
from openmmrigidhi import accuracy
from openmmrigidhi.accuracy import measurement, methods, observables

pytestmark = pytest.mark.usefixtures('shortTimes')

Z_LIMIT = 4.5
REFERENCE = openmm.Platform.getPlatformByName('Reference')
MASSES = (16.0, 1.0, 1.0)
SIDE = 3.0


def ions(charges=(-0.8, 0.5, 0.3), bodies=4, temperature=300.0, gamma=5.0, free=False):
    """Triangles with charges that are held by constraints, in a periodic box with PME. If `free`
    there is no force."""
    shape = np.array([[0, 0, 0], [0.1, 0, 0], [-0.03, 0.09, 0]])
    system = openmm.System()
    system.setDefaultPeriodicBoxVectors(*(SIDE*np.eye(3)))
    force = openmm.NonbondedForce()
    force.setNonbondedMethod(openmm.NonbondedForce.PME)
    force.setCutoffDistance(0.9)
    force.setForceGroup(3)
    integrator = openmmrigidhi.CustomRigidHIIntegrator(temperature, 0.001)
    integrator.setFriction(gamma)
    rng = np.random.default_rng(5)
    positions = []
    for body in range(bodies):
        first = 3*body
        for mass, charge in zip(MASSES, charges):
            system.addParticle(mass)
            force.addParticle(charge, 0.3, 0.1)
        for i, j in ((0, 1), (0, 2), (1, 2)):
            system.addConstraint(first + i, first + j, np.linalg.norm(shape[i] - shape[j]))
            force.addException(first + i, first + j, 0, 1, 0)
        integrator.addRigidBody([first, first + 1, first + 2])
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        positions.append(shape @ turn.T + np.array([body % 2, body // 2 % 2, body // 4])*0.6 + 0.3)
    if not free:
        system.addForce(force)
    return accuracy.Scene(system, np.concatenate(positions), integrator, 'ions')


def centreVelocities(context):
    velocities = context.getState(getVelocities=True).getVelocities(asNumpy=True)._value.reshape(
        -1, 3, 3)
    return np.einsum('k,bki->bi', MASSES, velocities)/sum(MASSES)


def netForces(context, groups):
    forces = context.getState(getForces=True, groups=groups).getForces(asNumpy=True)._value
    return forces.reshape(-1, 3, 3).sum(axis=1)


# ---- Names ---------------------------------------------------------------------------------------


def test_options_in_a_name_reach_the_integrator():
    scene = accuracy.scenes.trap(2)
    method = methods.byName('LangevinC-I8-g0.5-G1.5')
    integrator = method.makeIntegrator(scene, 0.003, 5)
    assert integrator.getInertiaScale() == 8 and integrator.getFriction(
    )._value == 0.5 and integrator.getRotationalFriction()._value == 1.5
    assert method.name == 'LangevinC-I8-g0.5-G1.5' and method.description.endswith(
        'moments times 8; gamma = 0.5/ps; Gamma = 1.5/ps')
    # Settings that the name does not give are those of the scene.
    integrator = methods.byName('LangevinB-G3').makeIntegrator(scene, 0.003, 5)
    assert integrator.getFriction()._value == 10 and integrator.getRotationalFriction(
    )._value == 3 and integrator.getInertiaScale() == 1
    for name, friction in (('LangevinMiddle', 10), ('LangevinMiddle-g2e-1', 0.2)):
        assert methods.byName(name).makeIntegrator(scene, 0.003, 5).getFriction()._value == friction
    assert methods.byName('LangevinC').sceneOf(scene) is scene


@pytest.mark.parametrize(
    'name, why',
    [('Verlet-g1', 'no method has this name'),
     ('LangevinMiddle-I8', 'LangevinMiddle has no option -I, only -g, -H, -N'),
     ('LangevinMiddle-G1', 'LangevinMiddle has no option -G'),
     ('LangevinC-H3', 'LangevinC has no option -H, only -I, -g, -G'),
     ('GradientThermostat-g1', 'GradientThermostat has no option -g, only none'),
     ('LangevinC-g1-g1', '-g occurs twice'),
     ('LangevinC-g0', 'the number behind -g must be above 0'),
     ('LangevinC-g1e999', 'the number behind -g must be above 0'),
     ('LangevinMiddle-H1', 'the number behind -H must be above 1.2'),
     ('LangevinMiddle-N1.5', 'the number behind -N must be a whole number from 2 to 100'),
     ('LangevinC-g', 'are no options, each a dash, a letter and a number'),
     ('LangevinC-g-1', 'are no options'), ('LangevinCg1', 'no method has this name')])
def test_nonsense_is_refused_by_name(name, why):
    with pytest.raises(ValueError, match=why) as error:
        methods.byName(name)
    assert repr(name) in str(error.value) and 'such as LangevinC-I8' in str(error.value)


def test_inertia_scales_start_at_the_temperature_of_the_bath():
    # If the State's angular velocities were kept for moments times 100, they would be 100 times too
    # hot.
    scene = accuracy.scenes.trap(bodies=400)
    first = scene.makeContext(scene.makeIntegrator(), REFERENCE, {}, 1)
    started = accuracy.Scene(scene.system, first.getState(getPositions=True, getVelocities=True),
                             scene.makeIntegrator())
    assert started.velocities is not None
    method = methods.byName('LangevinC-I100')
    own = method.sceneOf(started)
    integrator = method.makeIntegrator(own, 0.001, 3)
    context = own.makeContext(integrator, REFERENCE, {}, 3)
    temperature = observables.byName('rotational_temperature_2').measure(
        observables.Sample(own, context))
    # The temperature of 400 degrees of freedom has the relative standard deviation sqrt(2/400).
    z = (temperature/300 - 1)/math.sqrt(2/400)
    print(f'{temperature:.1f} K, z = {z:.2f}')
    assert abs(z) < Z_LIMIT
    assert started.velocities is not None


# ---- Heavier hydrogens ---------------------------------------------------------------------------


def test_heavy_hydrogens_keep_masses_of_bodies_and_constraints():
    scene = ions()
    heavy = methods.byName('LangevinMiddle-H3').sceneOf(scene)
    assert [heavy.system.getParticleMass(i)._value for i in range(6)] == [12, 3, 3]*2
    assert [scene.system.getParticleMass(i)._value for i in range(3)] == list(MASSES)
    for k in range(scene.system.getNumConstraints()):
        assert heavy.system.getConstraintParameters(k) == scene.system.getConstraintParameters(k)
    assert heavy.velocities is None and heavy.rigidByConstraints() is None
    contexts = [
        each.makeContext(openmm.VerletIntegrator(0.001), REFERENCE, {}, 1)
        for each in (scene, heavy)
    ]
    energies = [
        context.getState(getEnergy=True).getPotentialEnergy()._value for context in contexts
    ]
    assert energies[0] == energies[1]


def test_too_heavy_and_missing_hydrogens_are_refused():
    method = methods.byName('LangevinMiddle-H7')
    with pytest.raises(
            ValueError, match=
            'the hydrogens of body 0 would be heavier than the 4 dalton that are left of particle 0'
    ):
        method.sceneOf(ions())
    # A study leaves the method out and says why.
    study = accuracy.StepSizeStudy(accuracy.scenes.trap(2), ['LangevinC', 'LangevinMiddle-H9'],
                                   [0.002], observables=['potential_energy'], platform='Reference')
    assert 'choose less' in study.run(length=1, rounds=1).refusals['LangevinMiddle-H9']
    scene = ions()
    for i in range(scene.system.getNumParticles()):
        scene.system.setParticleMass(i, 12)
    with pytest.raises(ValueError, match='no body has a particle of up to 1.2 dalton'):
        methods.heavyHydrogens(scene, 3)
    assert 'hydrogens are told by their mass' in methods.byName('LangevinMiddle-H3').whyNot(scene)


def test_heavy_hydrogens_leave_exact_averages():
    # The trap's hydrogen of 1 dalton gets 4, and the particle of 16 keeps 13. The moments change by
    # up to three times, but mean energies must not change.
    study = accuracy.StepSizeStudy(
        accuracy.scenes.trap(bodies=100), ['LangevinMiddle-H4'], [0.002], platform='Reference',
        seed=3, observables=[
            'energy_group_0', 'energy_group_1', 'translational_temperature',
            'rotational_temperature_1', 'rotational_temperature_3'
        ])
    result = study.run(length=15, rounds=2)
    for row in result.rows:
        exact = result.references[row['observable']].value
        z = (row['mean'] - exact)/row['standard_error']
        print(f'{row["observable"]}: {row["mean"]:.4f} +- {row["standard_error"]:.4f}, exact '
              f'{exact:.4f}, z = {z:.2f}')
        assert abs(z) < Z_LIMIT
        assert row['standard_error'] < 0.02*abs(exact)


# ---- Reciprocal space less often -----------------------------------------------------------------


def test_slow_kicks_are_as_long_as_the_steps_between_them():
    # Without friction and noise, a step adds to a body's momentum its net force times the step. The
    # force of reciprocal space is added in every third step, times three steps.
    scene = ions(temperature=1e-12, gamma=1e-12)
    method = methods.byName('LangevinMiddle-N3')
    apart = method.sceneOf(scene)
    assert apart.system.getForce(0).getReciprocalSpaceForceGroup() == 0 and apart.system.getForce(
        0).getForceGroup() == 3
    assert scene.system.getForce(0).getReciprocalSpaceForceGroup() == -1
    h = 0.001
    context = apart.makeContext(method.makeIntegrator(apart, h, 1), REFERENCE, {}, 1)
    context.setVelocities(np.zeros((12, 3)))
    for step in range(7):
        slow, fast, before = netForces(context, {0}), netForces(context,
                                                                {3}), centreVelocities(context)
        context.getIntegrator().step(1)
        gained = (centreVelocities(context) - before)*sum(MASSES)
        expected = h*(fast + (3*slow if step % 3 == 0 else 0))
        assert np.abs(slow).max() > 0.01*np.abs(fast).max()
        np.testing.assert_allclose(gained, expected, atol=1e-5*np.abs(h*fast).max())


def test_frictions_are_those_of_the_name():
    # The bodies have no charges and are far apart. The velocities of their centres decay as
    # exp(-gamma t), whatever the inner steps.
    scene = ions((0, 0, 0), temperature=1e-12)
    for name in ('LangevinMiddle-N2-g3', 'MTSLangevin-N4-g3', 'LangevinMiddle-g3', 'LangevinC-g3',
                 'MTSLangevin-g3-H2'):
        method = methods.byName(name)
        assert method.whyNot is None or method.whyNot(scene) is None
        own = method.sceneOf(scene)
        integrator = method.makeIntegrator(own, 0.002, 1)
        context = own.makeContext(integrator, REFERENCE, {}, 1)
        for i in range(own.system.getNumParticles()):
            own.system.getForce(0).setParticleParameters(i, 0, 1, 0)
        own.system.getForce(0).updateParametersInContext(context)
        context.setVelocities(np.tile([0.1, 0.2, -0.1], (12, 1)))
        integrator.step(50)
        np.testing.assert_allclose(centreVelocities(context),
                                   np.tile(np.array([0.1, 0.2, -0.1])*math.exp(-0.3), (4, 1)),
                                   rtol=1e-5)


def test_multiple_time_steps_agree_with_single_ones():
    # The reference is a trajectory without friction and noise. Trajectories with reciprocal space
    # in every other step stay as near to the reference as their order says.
    scene = ions(temperature=1e-12, gamma=1e-12)
    ends = {}
    for name, h in (('LangevinMiddle', 0.0001), ('LangevinMiddle-N2', 0.001),
                    ('LangevinMiddle-N2', 0.0005), ('MTSLangevin-N2', 0.002)):
        method = methods.byName(name)
        own = method.sceneOf(scene)
        context = own.makeContext(method.makeIntegrator(own, h, 1), REFERENCE, {}, 1)
        context.setVelocities(np.zeros((12, 3)))
        context.getIntegrator().step(round(0.04/h))
        ends[name, h] = context.getState(getPositions=True).getPositions(asNumpy=True)._value
    exact = ends['LangevinMiddle', 0.0001]
    moved = np.abs(exact - scene.positions).max()
    errors = {key: np.abs(end - exact).max()/moved for key, end in ends.items()}
    print(errors)
    assert errors['MTSLangevin-N2', 0.002] < 0.02 and errors['LangevinMiddle-N2', 0.001] < 0.06
    # In the leapfrog form the start is off by half a kick, which is an error of first order.
    assert 1.5 < errors['LangevinMiddle-N2', 0.001]/errors['LangevinMiddle-N2', 0.0005] < 3


def test_what_cannot_be_split_says_why():
    trap = accuracy.scenes.trap(2)
    for name in ('LangevinMiddle-N2', 'MTSLangevin', 'LangevinMiddle-N2-H2'):
        assert 'no reciprocal space that could be evaluated less often' in methods.byName(
            name).whyNot(trap)
    scene = ions()
    scene.system.setParticleMass(2, 0)
    scene.system.setVirtualSite(2, openmm.TwoParticleAverageSite(0, 1, 0.5, 0.5))
    assert 'places virtual sites only at the end of its outer steps' in methods.byName(
        'MTSLangevin').whyNot(scene)


def test_custom_integrators_leave_virtual_sites_behind_within_a_step():
    # This behaviour of OpenMM is why MTSLangevin is refused for virtual sites. If the test fails
    # with a later OpenMM, the refusal may be removed.
    system = openmm.System()
    for mass in (10, 10, 0):
        system.addParticle(mass)
    system.setVirtualSite(2, openmm.TwoParticleAverageSite(0, 1, 0.5, 0.5))
    force = openmm.CustomExternalForce('x')
    force.addParticle(2)
    system.addForce(force)
    integrator = openmm.CustomIntegrator(0.001)
    integrator.addGlobalVariable('within', 0)
    integrator.addComputePerDof('x', 'x + 1')
    integrator.addComputeGlobal('within', 'energy')
    context = openmm.Context(system, integrator, REFERENCE)
    context.setPositions(np.zeros((3, 3)))
    integrator.step(1)
    assert context.getState(getEnergy=True).getPotentialEnergy()._value == 1
    assert integrator.getGlobalVariableByName('within') == 0


# ---- The dipole moment ---------------------------------------------------------------------------


def dipoleSquared(scene, positions=None):
    context = scene.makeContext(scene.makeIntegrator(), REFERENCE, {}, 1)
    if positions is not None:
        context.setPositions(positions)
    observable = observables.byName('dipole_squared')
    return observable.measure(observables.Sample(scene, context),
                              observable.setup(scene, REFERENCE, {}))


def test_dipole_of_known_bodies():
    scene = ions()
    arms = scene.positions.reshape(-1, 3, 3)
    # Positions are relative to each body's first particle. Bodies are neutral, so any origin gives
    # the same moment.
    total = np.einsum('k,bki->i', (-0.8, 0.5, 0.3), arms - arms[:, :1])
    value = dipoleSquared(scene)
    assert value == pytest.approx(total @ total/4, rel=1e-12)
    # Bodies across a face of the box, or in another image of the box, have the same moment.
    moved = (arms + np.array([[-0.35, 0, 0], [SIDE, -SIDE, 0], [0, 5*SIDE, SIDE - 0.3], [0, 0, 0]
                              ])[:, None]).reshape(-1, 3)
    assert dipoleSquared(scene, moved) == pytest.approx(value, rel=1e-9)


def test_dipoles_of_free_bodies_are_independent():
    # Without forces <M^2>/N is the square of one body's moment.
    scene = ions(bodies=8)
    arms = scene.positions.reshape(-1, 3, 3)
    exact = np.square(np.einsum('k,ki->i', (-0.8, 0.5, 0.3), arms[0])).sum()
    charges = observables.BUILT_IN['dipole_squared'].setup(scene, REFERENCE, {})
    own = ions(bodies=8, free=True)
    integrator = own.makeIntegrator()
    context = own.makeContext(integrator, REFERENCE, {}, 1)
    values = []
    integrator.setRandomNumberSeed(7)
    integrator.setRotationalFriction(10)
    integrator.setStepSize(0.01)
    for _ in range(1500):
        integrator.step(20)
        values.append(observables.BUILT_IN['dipole_squared'].measure(
            observables.Sample(own, context), charges))
    summary = accuracy.statistics.seriesStatistics(np.array(values))
    z = (summary.mean - exact)/summary.standardError
    print(f'<M^2>/N = {summary.mean:.5f} +- {summary.standardError:.5f}, exact {exact:.5f}, z = '
          f'{z:.2f}')
    assert abs(z) < Z_LIMIT and summary.standardError < 0.06*exact


def test_charged_bodies_and_free_ions_have_no_dipole():
    with pytest.raises(ValueError, match='body 0 has a net charge of 0.2 e'):
        dipoleSquared(ions((-0.6, 0.5, 0.3)))
    with pytest.raises(ValueError,
                       match='NonbondedForces; the charges must be those of a single one'):
        dipoleSquared(accuracy.scenes.trap(1))
    scene = ions()
    scene.system.addParticle(23)
    scene.system.getForce(0).addParticle(1, 0.3, 0.1)
    with pytest.raises(ValueError, match='particle 12 has a charge of 1 e and is in no body'):
        observables.BUILT_IN['dipole_squared'].setup(scene, REFERENCE, {})


# ---- Diffusion -----------------------------------------------------------------------------------


def test_diffusion_of_straight_lines():
    # With msd(t) = v^2 t^2, (msd(2 w) - msd(w))/(6 w) is v^2 w/2, also where bodies leave the box.
    scene = ions(bodies=2, free=True)
    context = scene.makeContext(openmm.VerletIntegrator(0.01), REFERENCE, {}, 1)
    context.setVelocities(np.repeat([[3.0, 0, 0], [0, 1, 0]], 3, axis=0))
    observable = observables.diffusionCoefficient(0.5)
    centres = observable.setup(scene, REFERENCE, {})
    values = []
    for _ in range(15):
        values.append(observable.measure(observables.Sample(scene, context), centres))
        context.getIntegrator().step(10)
    assert np.isnan(values[:10]).all()
    np.testing.assert_allclose(values[10:], 0.5*(9 + 1)/2*0.5, rtol=1e-6)


def test_diffusion_of_free_bodies_is_that_of_einstein():
    # Free bodies in a bath have msd(t) = 6 D (t - (1 - exp(-gamma t))/gamma). For steps of
    # LangevinC, D = kT/(M gamma) x/tanh(x) with x = gamma h/2. Here w = 0.4 ps.
    gamma, h, window = 20.0, 0.01, 0.4
    study = accuracy.StepSizeStudy(ions(bodies=60, gamma=gamma, free=True), ['LangevinC'], [h],
                                   observables=[observables.diffusionCoefficient(window)],
                                   platform='Reference', seed=2, sampleInterval=0.1)
    row = study.run(length=60, equilibration=1, rounds=3).rows[0]
    x = gamma*h/2
    D = accuracy.scenes.GAS_CONSTANT*300/(sum(MASSES)*gamma)*x/math.tanh(x)
    exact = D*(1 - (math.exp(-gamma*window) - math.exp(-2*gamma*window))/(gamma*window))
    z = (row['mean'] - exact)/row['standard_error']
    print(f'D = {row["mean"]:.5f} +- {row["standard_error"]:.5f}, exact {exact:.5f}, z = {z:.2f}')
    assert abs(z) < Z_LIMIT and row['standard_error'] < 0.03*exact


def test_diffusion_says_what_it_cannot_do():
    with pytest.raises(ValueError,
                       match='diffusionCoefficient: window: got 0 ps; a window must be positive'):
        observables.diffusionCoefficient(0)
    scene = ions()
    scene.system.addForce(openmm.MonteCarloBarostat(1, 300))
    with pytest.raises(ValueError, match='MonteCarloBarostat, which moves bodies with the box'):
        observables.byName('diffusion_coefficient').setup(scene, REFERENCE, {})


def test_a_series_may_begin_with_samples_that_have_no_past():
    record = measurement.Record(1.0, {
        'a': [math.nan, math.nan, 1.0, 2.0],
        'b': [math.nan, 1.0, math.nan, 2.0]
    })
    a, b = (observables.Observable(name, name, '', None) for name in 'ab')
    assert measurement._series(record, a).tolist() == [1, 2
                                                       ] and measurement._series(record, b) is None
