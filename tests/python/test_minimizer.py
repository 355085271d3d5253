"""openmmrigidhi.app.minimize: bodies and free particles keep their shapes, minima are found, and
what stops early is said."""
import numpy as np
import openmm
import pytest
from openmm import app, unit
from scenes import checkShapes, dumbbells, energyOf, mixedBox, positionsOf

import openmmrigidhi
from openmmrigidhi import CustomRigidHIIntegrator
from openmmrigidhi.app import minimizer


@pytest.mark.parametrize('start', ['lattice', 'perturbed', 'clashing'])
def test_minimising_a_water_box_lowers_the_energy_and_keeps_shapes(start, waterBox, platform):
    simulation = waterBox.simulation(platform)
    integrator = simulation.integrator
    random = np.random.default_rng(2)
    if start == 'perturbed':
        integrator.setBodyPositions(integrator.getBodyPositions()._value +
                                    random.normal(scale=0.005, size=(27, 3)))
    elif start == 'clashing':
        integrator.setBodyPositions(random.uniform(0, waterBox.box, size=(27, 3)))
    before = energyOf(simulation.context)
    result = openmmrigidhi.app.minimize(simulation.context)
    assert result.converged and result.rmsForce._value <= 10
    assert result.initialEnergy._value == pytest.approx(before, rel=1e-5)
    assert result.finalEnergy._value == pytest.approx(energyOf(simulation.context), rel=1e-5)
    assert result.finalEnergy._value < min(
        before, -27*45)  # liquid water has about -45 kJ/mol a molecule at 300 K
    checkShapes(waterBox, simulation.context, 1e-12)
    simulation.step(2)


def test_the_gradient_is_the_derivative_of_the_energy():
    """The gradient agrees with central differences where bodies have turned far. Some waters are
    free, with springs for constraints."""
    box, simulation = mixedBox(openmm.Platform.getPlatformByName('Reference'))
    search = minimizer._Search(minimizer._Scene(simulation.context), 10, 0, None, None)
    random = np.random.default_rng(4)
    y = random.normal(scale=0.003, size=search._size())
    y[42:84] = (random.normal(scale=0.7, size=(14, 3))*search.scene.length[:, None]).ravel()
    _, gradient = search._value(y)
    step = 1e-6
    for k in random.choice(search._size(), 60, replace=False):
        e = np.zeros_like(y)
        e[k] = step
        difference = (search._value(y + e)[0] - search._value(y - e)[0])/(2*step)
        # The tolerance is the rounding of an energy of at most 1e6 over the step, and the third
        # derivative.
        assert gradient[k] == pytest.approx(difference, rel=1e-5, abs=1e-3)


def test_free_constrained_molecules_are_minimised_beside_bodies(platform):
    box, simulation = mixedBox(platform)
    integrator, context = simulation.integrator, simulation.context
    context.setVelocitiesToTemperature(300, 1)
    velocities = integrator.getBodyVelocities()._value
    before = positionsOf(context)
    result = openmmrigidhi.app.minimize(context, tolerance=20)
    assert result.converged
    assert result.finalEnergy._value < result.initialEnergy._value - 27*5
    checkShapes(box, context, 2e-5)  # OpenMM's SETTLE is single precision
    moved = np.linalg.norm(positionsOf(context) - before, axis=1)
    assert np.median(moved[:4*14]) > 0.005 and np.median(moved[4*14:]) > 0.005
    assert np.allclose(integrator.getBodyVelocities()._value, velocities, rtol=0, atol=1e-12)
    simulation.step(5)


def tetheredDumbbell(platform, turn):
    """A dumbbell whose ends are tied to (0.5, 0, -0.1) and (0.5, 0, 0.1), and a free particle tied
    to the origin."""
    system, positions, definitions = dumbbells(1)
    system.addParticle(1.0)
    system.addParticle(0.0)
    force = openmm.CustomExternalForce('500*((x-x0)^2+(y-y0)^2+(z-z0)^2)')
    for name in ('x0', 'y0', 'z0'):
        force.addPerParticleParameter(name)
    for particle, anchor in enumerate([(0.5, 0, -0.1), (0.5, 0, 0.1), (0, 0, 0), (9, 9, 9)]):
        force.addParticle(particle, anchor)
    system.addForce(force)
    integrator = CustomRigidHIIntegrator(300, 0.002)
    integrator.addRigidBody(*definitions[0])
    context = openmm.Context(system, integrator, platform)
    context.setPositions(np.concatenate([positions, [(0.3, 0.2, 0.1), (0, 0, 0)]]))
    integrator.setBodyOrientations([(np.cos(turn/2), np.sin(turn/2), 0, 0)])
    return integrator, context


@pytest.mark.parametrize('turn', [0.3, 3.0])
def test_minimising_finds_a_known_minimum_from_afar(turn, platform):
    integrator, context = tetheredDumbbell(platform, turn)
    result = openmmrigidhi.app.minimize(context, tolerance=0.01)
    assert result.converged
    got = positionsOf(context)
    # A residual force of 0.01 against springs of 1000 kJ/(mol nm^2) leaves 1e-5 nm, in any of eight
    # coordinates.
    assert np.allclose(got[:3], [(0.5, 0, -0.1), (0.5, 0, 0.1), (0, 0, 0)], rtol=0, atol=8e-5)
    assert np.array_equal(got[3], (0, 0, 0))  # massless and in no body
    assert np.linalg.norm(got[1] - got[0]) == pytest.approx(0.2, rel=1e-12)


@pytest.mark.parametrize('held', ['nothing', 'body', 'particle', 'both'])
def test_what_is_held_stays_to_the_bit(held, platform):
    integrator, context = tetheredDumbbell(platform, 0.3)
    body, particle = held in ('body', 'both'), held in ('particle', 'both')
    integrator.setBodyHeld(0, body)
    integrator.setParticleHeld(2, particle)
    R, q = integrator.getBodyPositions()._value, integrator.getBodyOrientations()
    x = positionsOf(context)[2]
    if body and particle:
        with pytest.warns(UserWarning, match='nothing can move: the integrator holds all bodies'):
            openmmrigidhi.app.minimize(context, tolerance=0.01)
    else:
        assert openmmrigidhi.app.minimize(context, tolerance=0.01).converged
    assert np.array_equal(integrator.getBodyPositions()._value, R) == body
    assert np.array_equal(integrator.getBodyOrientations(), q) == body
    assert np.array_equal(positionsOf(context)[2], x) == particle
    # The others are where they are without anything held.
    if not body:
        assert np.allclose(integrator.getBodyPositions()._value, (0.5, 0, 0), rtol=0, atol=8e-5)
    if not particle:
        assert np.allclose(positionsOf(context)[2], 0, rtol=0, atol=8e-5)


def test_a_body_beside_a_held_one_finds_its_minimum(platform):
    """The first of two dumbbells is held, and a spring pulls an end of the other to it."""
    system, positions, definitions = dumbbells(2)
    spring = openmm.HarmonicBondForce()
    spring.addBond(1, 2, 0.3, 1000)
    system.addForce(spring)
    integrator = CustomRigidHIIntegrator(300, 0.002)
    for definition in definitions:
        integrator.addRigidBody(*definition)
    integrator.setBodyHeld(0, True)
    context = openmm.Context(system, integrator, platform)
    context.setPositions(positions)
    R = integrator.getBodyPositions()._value
    result = openmmrigidhi.app.minimize(context, tolerance=0.01)
    assert result.converged and result.finalEnergy._value < 1e-6
    assert np.array_equal(integrator.getBodyPositions()._value[0], R[0])
    assert not np.allclose(integrator.getBodyPositions()._value[1], R[1], rtol=0, atol=0.1)
    x = positionsOf(context)
    assert np.linalg.norm(x[2] - x[1]) == pytest.approx(0.3, abs=1e-4)


def overlappingColloids(platform, kind):
    """A hundred spheres of 0.5 um that overlap, with an energy of 20 MJ/mol and more."""
    count, radius = 100, 500.0
    force = openmm.CustomNonbondedForce(f'2*step({2*radius}-r)*({2*radius}-r)^2')
    fluid = openmmrigidhi.MobilityForce()
    system = openmm.System()
    integrator = CustomRigidHIIntegrator(300, 1e6)
    mass = 1e11 if kind == 'dry' else 0
    for _ in range(count):
        sphere = system.addParticle(mass)
        force.addParticle()
        fluid.addParticle(radius)
        if kind == 'free':
            continue
        sites = [(0, 0, 0)]
        if kind == 'marked':
            sites.append((1, 0, 0))
            force.addExclusion(sphere, system.addParticle(0))
            force.addParticle()
            fluid.addParticle(0)
        integrator.addRigidBody(range(sphere, sphere + len(sites)), mass, (mass*radius**2,)*3,
                                sites)
    if kind == 'marked':
        force.addInteractionGroup(range(0, 2*count, 2), range(0, 2*count, 2))
    system.addForce(force)
    if kind != 'dry':
        system.addForce(fluid)
        integrator.setScheme(integrator.EulerMaruyama)
    context = openmm.Context(system, integrator, platform)
    positions = np.random.default_rng(1).uniform(0, 3500, (count, 3))
    if kind == 'marked':
        positions = np.repeat(positions, 2, axis=0) + count*[(0, 0, 0), (1, 0, 0)]
    context.setPositions(positions)
    return context


@pytest.mark.parametrize('kind', ['spheres', 'marked', 'free', 'dry'])
def test_the_default_tolerance_suits_colloids(kind, platform):
    context = overlappingColloids(platform, kind)
    assert energyOf(context) > 1e7
    result = openmmrigidhi.app.minimize(context)
    assert result.converged and 0 < result.iterations < 200
    # 2.5 kJ/mol over the radius; without radii over half of the distance of neighbours
    if kind == 'dry':
        assert 0.003 < result.tolerance._value < 0.03
    else:
        assert result.tolerance._value == pytest.approx(0.005, rel=1e-12)
    assert result.rmsForce <= result.tolerance
    assert energyOf(context) < 100


def test_torques_of_spheres_are_measured_by_their_radii(platform):
    context = overlappingColloids(platform, 'marked')
    assert np.all(minimizer._Scene(context).length == 500)


def test_a_given_tolerance_is_used_as_it_is(platform):
    context = overlappingColloids(platform, 'spheres')
    result = openmmrigidhi.app.minimize(context, tolerance=1e5)
    assert result.iterations == 0 and result.tolerance._value == 1e5


def test_molecules_have_the_default_tolerance_of_openmm(waterBox, platform):
    simulation = waterBox.simulation(platform)
    assert openmmrigidhi.app.minimize(simulation.context, maxIterations=1).tolerance._value == 10


def mixture(platform, small, inBodies=True):
    """Two overlapping spheres of 500 nm, far from a row of spheres of 1 nm."""
    system, fluid = openmm.System(), openmmrigidhi.MobilityForce()
    integrator = CustomRigidHIIntegrator(300, 1)
    integrator.setScheme(integrator.TrapezoidalSlip)
    force = openmm.CustomNonbondedForce('step(d - r)*eps*((d/r)^12 - 2*(d/r)^6 + 1); '
                                        'eps = select(step(d - 900), 1000, 100); d = a1 + a2')
    force.addPerParticleParameter('a')
    for radius in [500, 500] + [1]*small:
        i = system.addParticle(0)
        if inBodies:
            integrator.addRigidBody([i], 0, (0, 0, 0), [(0, 0, 0)])
        fluid.addParticle(radius)
        force.addParticle([radius])
    system.addForce(force)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, platform)
    context.setPositions([(0, 0, 0), (950, 0, 0)] + [(2.5*k, 600, 0) for k in range(small)])
    return context


@pytest.mark.parametrize('inBodies', [True, False], ids=['bodies', 'free particles'])
@pytest.mark.parametrize('small', [0, 20, 500])
def test_large_particles_among_small_ones_are_minimised(small, inBodies, platform):
    """The energy is 52 kT at the start, and the many small forces of 0 must not hide it."""
    context = mixture(platform, small, inBodies)
    result = openmmrigidhi.app.minimize(context)
    kT = 2.5*unit.kilojoule_per_mole
    assert result.initialEnergy > 50*kT and result.converged
    assert result.finalEnergy < 0.1*kT and 0 < result.iterations < 50
    assert result.tolerance._value == pytest.approx(0.005, rel=1e-12)
    forces = context.getState(getForces=True).getForces(asNumpy=True)._value
    assert np.sqrt(np.mean(forces[:2]**2, axis=1)).max() < 0.01


@pytest.mark.parametrize('inBodies, name', [(True, 'body 1'), (False, 'particle 1')])
def test_a_large_particle_that_stays_above_the_tolerance_is_named(inBodies, name, platform):
    """Its energy has a kink, at which the force is never small."""
    context = mixture(platform, 20, inBodies)
    kink = openmm.CustomExternalForce('1000 + abs(z - 0.3)')
    kink.addParticle(1, [])
    context.getSystem().addForce(kink)
    context.reinitialize(preserveState=True)
    with pytest.warns(
            UserWarning, match=f'the root mean square force of {name} is .*, above the '
            'tolerance 0.005'):
        assert not openmmrigidhi.app.minimize(context).converged


def test_molecules_are_judged_together(waterBox, platform):
    simulation = waterBox.simulation(platform)
    search = minimizer._Search(minimizer._Scene(simulation.context), None, 0, None, None)
    assert np.all(search.groups == 0) and np.all(search.scales == 1)
    search._note(np.zeros(search._size()), 0.0, np.arange(search._size(), dtype=float))
    assert search.rms == pytest.approx(np.sqrt(np.mean(np.arange(search._size())**2.0)), rel=1e-12)
    assert search.tolerance == 10


def test_nothing_to_minimise_is_said(platform):
    """OpenMM's minimiser would say nothing."""
    system = openmm.System()
    system.addParticle(0)
    context = openmm.Context(system, CustomRigidHIIntegrator(300, 0.001), platform)
    context.setPositions([(0, 0, 0)])
    with pytest.warns(UserWarning, match='minimize: nothing can move: the Context has no bodies'):
        openmmrigidhi.app.minimize(context)


def test_iterations_are_limited_and_reported(waterBox, platform):
    simulation = waterBox.simulation(platform)
    seen = []
    result = openmmrigidhi.app.minimize(simulation.context, 1e-3, 7,
                                        reporter=lambda *values: seen.append(values))
    assert result.iterations == 7 and not result.converged and result.evaluations >= 7
    assert [iteration for iteration, _, _ in seen] == list(range(1, 8))
    energies = [energy.value_in_unit(unit.kilojoule_per_mole) for _, energy, _ in seen]
    assert energies == sorted(energies, reverse=True)
    assert seen[-1][2].value_in_unit(
        unit.kilojoule_per_mole/unit.nanometer) == result.rmsForce._value


def test_a_minimum_stays_where_it_is(platform):
    integrator, context = tetheredDumbbell(platform, 0.3)
    openmmrigidhi.app.minimize(context, tolerance=1)
    before = positionsOf(context)
    result = openmmrigidhi.app.minimize(context, tolerance=1)
    assert result.iterations == 0 and result.converged
    assert np.allclose(positionsOf(context), before, rtol=0, atol=1e-15)


def test_an_unreachable_tolerance_is_said_to_be_so(waterBox):
    simulation = waterBox.simulation(openmm.Platform.getPlatformByName('CPU'))
    with pytest.warns(UserWarning, match='above the tolerance 1e-09'):
        result = openmmrigidhi.app.minimize(simulation.context, tolerance=1e-9)
    assert not result.converged and result.rmsForce._value < 10


def test_bad_arguments_of_minimize_are_refused(waterBox, platform):
    simulation = waterBox.simulation(platform)
    for tolerance in (0, -1, np.nan, np.inf):
        with pytest.raises(ValueError, match='tolerance'):
            openmmrigidhi.app.minimize(simulation.context, tolerance)
    with pytest.raises(TypeError, match='tolerance'):
        openmmrigidhi.app.minimize(simulation.context, 1*unit.kelvin)
    with pytest.raises(ValueError, match='maxIterations'):
        openmmrigidhi.app.minimize(simulation.context, maxIterations=-1)
    other = openmm.Context(waterBox.system, openmm.VerletIntegrator(0.001), platform)
    with pytest.raises(TypeError, match='cast'):
        openmmrigidhi.app.minimize(other)


def test_minimising_needs_positions_and_finite_energies(waterBox, platform):
    simulation = app.Simulation(waterBox.topology, waterBox.system, waterBox.integrator(), platform)
    with pytest.raises(openmm.OpenMMException, match='[Pp]ositions'):
        openmmrigidhi.app.minimize(simulation.context)
    integrator, context = tetheredDumbbell(platform, 0.3)
    force = context.getSystem().getForce(0)
    force.setParticleParameters(0, 0, (np.nan, 0, 0))
    force.updateParametersInContext(context)
    with pytest.raises(openmm.OpenMMException, match='energy at the start is nan'):
        openmmrigidhi.app.minimize(context)
