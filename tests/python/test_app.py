"""openmmrigidhi.app: building bodies, minimising, reporters, files, and use with OpenMM's own
Simulation."""
import copy
import io
import os
import warnings

import h5py
import numpy as np
import openmm
import pytest
import scipy.spatial
from openmm import app, unit

import openmmrigidhi
from openmmrigidhi import CustomRigidHIIntegrator
from openmmrigidhi.app import minimizer
from scenes import WaterBox, dumbbells

GAS_CONSTANT = unit.MOLAR_GAS_CONSTANT_R.value_in_unit(unit.kilojoule_per_mole/unit.kelvin)
OXYGEN_HYDROGEN = 0.09572  # nm, TIP4P-Ew


def positionsOf(context, **options):
    return context.getState(getPositions=True, **options).getPositions(asNumpy=True)._value


def energyOf(context):
    return context.getState(getEnergy=True).getPotentialEnergy()._value


# ---- Bodies from residues ------------------------------------------------------------------------


def test_every_water_becomes_a_body_with_its_extra_particle(waterBox):
    integrator = CustomRigidHIIntegrator(300, 0.002)
    assert openmmrigidhi.app.addRigidWater(integrator, waterBox.topology,
                                           waterBox.system) == list(range(27))
    for body, residue in enumerate(waterBox.topology.residues()):
        assert integrator.getRigidBodyParticles(body) == [atom.index for atom in residue.atoms()]
        assert len(integrator.getRigidBodyParticles(body)) == 4


def test_the_shape_of_water_comes_from_constraints_not_from_coordinates(waterBox, platform):
    """Coordinates as a PDB file has them, rounded to 1e-4 nm."""
    integrator = waterBox.integrator()
    simulation = waterBox.simulation(platform, integrator)
    simulation.context.setPositions(np.round(waterBox.positions._value, 4))
    simulation.step(1)
    shapes = [integrator.getRigidBodyParameters(body)[3]._value for body in range(27)]
    for sites in shapes:
        assert np.linalg.norm(sites[1] - sites[0]) == pytest.approx(OXYGEN_HYDROGEN, rel=1e-12)
        assert np.allclose(sites, shapes[0], rtol=0, atol=1e-14)
    # The M site of TIP4P-Ew lies 0.0125 nm from the oxygen.
    assert np.linalg.norm(shapes[0][3] - shapes[0][0]) == pytest.approx(0.0125, abs=2e-5)
    assert 0 < integrator.getPoseResidual()._value < 2e-4


def test_flexible_water_is_refused_if_the_system_is_given():
    flexible = WaterBox(2, rigidWater=False, nonbondedMethod=app.NoCutoff)
    with pytest.raises(ValueError,
                       match='residue HOH 1: particles .* have no constraint.*rigidWater=True'):
        openmmrigidhi.app.addRigidWater(CustomRigidHIIntegrator(300, 0.002), flexible.topology,
                                        flexible.system)


def test_residues_are_chosen_by_name(waterBox):
    integrator = CustomRigidHIIntegrator(300, 0.002)
    with pytest.raises(ValueError, match='no residue is named LIG; the topology has HOH'):
        openmmrigidhi.app.addRigidResidues(integrator, waterBox.topology, ['LIG'])
    with pytest.raises(TypeError, match='sequence of names'):
        openmmrigidhi.app.addRigidResidues(integrator, waterBox.topology, 'HOH')
    with pytest.raises(TypeError, match='cast'):
        openmmrigidhi.app.addRigidWater(openmm.VerletIntegrator(0.001), waterBox.topology)
    assert len(openmmrigidhi.app.addRigidResidues(integrator, waterBox.topology,
                                                  {'HOH', 'LIG'})) == 27
    with pytest.raises(openmm.OpenMMException, match='already in body 0'):
        openmmrigidhi.app.addRigidWater(integrator, waterBox.topology)


def renamed(topology, names):
    """The topology with these residue names, in turn."""
    topology = copy.deepcopy(topology)
    for k, residue in enumerate(topology.residues()):
        residue.name = names[k % len(names)]
    return topology


@pytest.mark.parametrize('name', ['T4E', 'OPC3', 'TP4E', 'T3P', 'TIP', 'SOL', 'TIP3'])
def test_common_names_of_water_are_known(name, waterBox):
    integrator = CustomRigidHIIntegrator(300, 0.002)
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        assert len(
            openmmrigidhi.app.addRigidWater(integrator, renamed(waterBox.topology, [name]),
                                            waterBox.system)) == 27


def test_water_of_an_unknown_name_is_not_skipped_without_a_word(waterBox):
    topology = renamed(waterBox.topology, ['HOH', 'W4', 'UNL'])
    integrator = CustomRigidHIIntegrator(300, 0.002)
    with pytest.warns(UserWarning) as seen:
        assert len(openmmrigidhi.app.addRigidWater(integrator, topology)) == 9
    assert [str(warning.message) for warning in seen] == [
        'addRigidWater: 9 residues named UNL, 9 residues named W4 have the composition of water, '
        "but are not made bodies, since their name is not known: give names=['UNL', 'W4'] to "
        'include them'
    ]
    assert seen[0].filename == __file__
    integrator = CustomRigidHIIntegrator(300, 0.002)
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        assert len(openmmrigidhi.app.addRigidWater(integrator, topology, names=['W4', 'UNL'])) == 27
    with pytest.raises(ValueError, match=r"the topology has W4: give .* as names=\['W4'\]"):
        openmmrigidhi.app.addRigidWater(CustomRigidHIIntegrator(300, 0.002),
                                        renamed(waterBox.topology, ['W4']))


def frozenBox(frozen):
    """A box of water, some of it without masses and constraints."""
    box = WaterBox(3)
    particles = {
        atom.index
        for residue in list(box.topology.residues())[:frozen] for atom in residue.atoms()
    }
    for i in particles:
        box.system.setParticleMass(i, 0)
    for i in reversed(range(box.system.getNumConstraints())):
        if box.system.getConstraintParameters(i)[0] in particles:
            box.system.removeConstraint(i)
    return box


def test_frozen_water_is_left_out(platform):
    box = frozenBox(2)
    integrator = CustomRigidHIIntegrator(300, 0.002)
    integrator.setRandomNumberSeed(1)
    with pytest.warns(
            UserWarning, match='2 residues named HOH have mass 0 in the System and are '
            'not made bodies.*skipFrozen=True') as seen:
        assert len(openmmrigidhi.app.addRigidWater(integrator, box.topology, box.system)) == 25
    assert len(seen) == 1 and seen[0].filename == __file__
    assert integrator.getRigidBodyParticles(0) == [8, 9, 10, 11]
    context = openmm.Context(box.system, integrator, platform)
    context.setPositions(box.positions)
    integrator.step(2)
    moved = np.linalg.norm(positionsOf(context) - box.positions._value, axis=1)
    # Atoms move by about 1e-3 nm, in three dimensions: by less than 1e-7 nm once in 10^12 cases.
    assert np.all(moved[:8] < 1e-7) and np.all(moved[8:] > 1e-7)


def test_frozen_water_is_left_out_or_taken_as_asked():
    box = frozenBox(2)
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        for skip, count in ((True, 25), (False, 27)):
            assert len(
                openmmrigidhi.app.addRigidWater(CustomRigidHIIntegrator(300, 0.002), box.topology,
                                                box.system, skipFrozen=skip)) == count
        for arguments, count in (({}, 27), ({'skipFrozen': True}, 25)):
            assert len(
                openmmrigidhi.app.addRigidResidues(CustomRigidHIIntegrator(300,
                                                                           0.002), box.topology,
                                                   ['HOH'], box.system, **arguments)) == count
    for add, names in ((openmmrigidhi.app.addRigidWater, ()), (openmmrigidhi.app.addRigidResidues,
                                                               (['HOH'],))):
        with pytest.raises(
                ValueError, match=f'{add.__name__}: skipFrozen: got True without a '
                'system; masses are in the System: give the system'):
            add(CustomRigidHIIntegrator(300, 0.002), box.topology, *names, skipFrozen=True)
    with pytest.raises(TypeError, match='skipFrozen: got 1; it must be True or False'):
        openmmrigidhi.app.addRigidWater(CustomRigidHIIntegrator(300, 0.002), box.topology,
                                        box.system, skipFrozen=1)


def withoutExtraParticles(topology):
    """The topology as OpenFF writes it: without the virtual sites of the System."""
    bare = app.Topology()
    chain = bare.addChain()
    for residue in topology.residues():
        copied = bare.addResidue(residue.name, chain)
        for atom in residue.atoms():
            if atom.element is not None:
                bare.addAtom(atom.name, atom.element, copied)
    return bare


@pytest.mark.parametrize('place', ['between', 'behind'])
def test_virtual_sites_that_the_topology_lacks_come_from_the_system(place, waterBox, platform):
    """Virtual sites lie between the atoms of the topology, or behind them."""
    places = np.arange(4*27).reshape(27, 4)  # index in the new System
    if place == 'behind':
        places[:, :3], places[:, 3] = np.arange(3*27).reshape(27, 3), np.arange(3*27, 4*27)
    new = places.ravel().tolist()
    old = np.argsort(new)
    system = openmm.System()
    for i in old.tolist():
        system.addParticle(waterBox.system.getParticleMass(i))
    for i in range(waterBox.system.getNumConstraints()):
        first, second, distance = waterBox.system.getConstraintParameters(i)
        system.addConstraint(new[first], new[second], distance)
    for *parents, extra in places.tolist():
        weights = [waterBox.system.getVirtualSite(3).getWeight(k) for k in range(3)]
        system.setVirtualSite(extra, openmm.ThreeParticleAverageSite(*parents, *weights))
    topology = withoutExtraParticles(waterBox.topology)
    assert topology.getNumAtoms() == 3*27
    integrator = CustomRigidHIIntegrator(300, 0.002)
    openmmrigidhi.app.addRigidWater(integrator, topology)
    with pytest.raises(
            openmm.OpenMMException, match='give addRigidWater.. the System'
            if place == 'behind' else 'particle 6 outside it'):
        openmm.Context(system, integrator, platform)
    integrator = CustomRigidHIIntegrator(300, 0.002)
    openmmrigidhi.app.addRigidWater(integrator, topology, system)
    assert [integrator.getRigidBodyParticles(body) for body in range(27)] == places.tolist()
    context = openmm.Context(system, integrator, platform)
    context.setPositions(np.array(waterBox.positions._value)[old])
    integrator.step(1)


def test_a_site_between_two_molecules_belongs_to_none():
    topology = app.Topology()
    chain = topology.addChain()
    system = openmm.System()
    for _ in range(2):
        residue = topology.addResidue('N2', chain)
        for name in 'AB':
            topology.addAtom(name, app.Element.getBySymbol('N'), residue)
            system.addParticle(14)
    for parents in ((0, 1), (1, 2), (2, 3)):
        system.setVirtualSite(system.addParticle(0),
                              openmm.TwoParticleAverageSite(*parents, .5, .5))
    for pair in ((0, 1), (2, 3)):
        system.addConstraint(*pair, 0.11)
    integrator = CustomRigidHIIntegrator(300, 0.002)
    openmmrigidhi.app.addRigidResidues(integrator, topology, ['N2'], system)
    assert [integrator.getRigidBodyParticles(body) for body in (0, 1)] == [[0, 1, 4], [2, 3, 6]]


def test_remedies_for_missing_constraints_are_true():
    """rigidWater=True adds constraints to residues named HOH alone, and to no other molecules."""
    flexible = WaterBox(2, rigidWater=False, nonbondedMethod=app.NoCutoff)
    with pytest.raises(
            ValueError, match='residue OPC 1: .*System.addConstraint.*the residue HOH '
            'before the System is created with rigidWater=True'):
        openmmrigidhi.app.addRigidWater(CustomRigidHIIntegrator(300, 0.002),
                                        renamed(flexible.topology, ['OPC']), flexible.system)
    topology = app.Topology()
    residue = topology.addResidue('CH', topology.addChain())
    system = openmm.System()
    for symbol in 'CH':
        topology.addAtom(symbol, app.Element.getBySymbol(symbol), residue)
        system.addParticle(1)
    with pytest.raises(ValueError, match='its shape: add one for each pair by') as error:
        openmmrigidhi.app.addRigidResidues(CustomRigidHIIntegrator(300, 0.002), topology, ['CH'],
                                           system)
    assert 'rigidWater' not in str(error.value)


# ---- Bodies as molecules -------------------------------------------------------------------------


def periodicDumbbells():
    """Two molecules without constraints in a periodic box of 2 nm. The first lies across a face of
    the box."""
    system, positions, definitions = dumbbells(2)
    system.setDefaultPeriodicBoxVectors((2, 0, 0), (0, 2, 0), (0, 0, 2))
    force = openmm.NonbondedForce()
    force.setNonbondedMethod(openmm.NonbondedForce.CutoffPeriodic)
    force.setCutoffDistance(0.9)
    for _ in range(4):
        force.addParticle(0, 0.1, 0)
    system.addForce(force)
    integrator = CustomRigidHIIntegrator(300, 0.002)
    for definition in definitions:
        integrator.addRigidBody(*definition)
    return system, integrator, positions + (0, 0, 1.9)


def test_unbound_bodies_in_a_periodic_system_are_refused_with_the_remedy(platform):
    system, integrator, _ = periodicDumbbells()
    with pytest.raises(openmm.OpenMMException, match='bindBodies'):
        openmm.Context(system, integrator, platform)


def test_bound_bodies_stay_whole_in_the_periodic_box(platform):
    system, integrator, positions = periodicDumbbells()
    force = openmmrigidhi.app.bindBodies(system, integrator)
    assert force.getNumBonds() == 2 and force.usesPeriodicBoundaryConditions()
    context = openmm.Context(system, integrator, platform)
    context.setPositions(positions)
    context.setVelocitiesToTemperature(300, 1)
    integrator.step(20)
    wrapped = positionsOf(context, enforcePeriodicBox=True)
    assert np.allclose(np.linalg.norm(wrapped[1::2] - wrapped[::2], axis=1), 0.2, rtol=1e-12)
    assert not np.allclose(wrapped, positionsOf(context), atol=0.1)
    assert energyOf(context) == 0


def test_binding_does_not_make_a_system_periodic(platform):
    system, _, definitions = dumbbells(2)
    integrator = CustomRigidHIIntegrator(300, 0.002)
    for definition in definitions:
        integrator.addRigidBody(*definition)
    openmmrigidhi.app.bindBodies(system, integrator)
    assert not system.usesPeriodicBoundaryConditions()


# ---- Minimising ----------------------------------------------------------------------------------


def mixedBox(platform, numBodies=14):
    """Waters, some as bodies, the others as free particles that are held by constraints."""
    box = WaterBox(3)
    integrator = CustomRigidHIIntegrator(300, 0.002)
    for residue in list(box.topology.residues())[:numBodies]:
        integrator.addRigidBody([atom.index for atom in residue.atoms()])
    return box, box.simulation(platform, integrator)


def checkShapes(box, context, tolerance):
    positions = positionsOf(context)
    for i in range(box.system.getNumConstraints()):
        first, second, distance = box.system.getConstraintParameters(i)
        assert np.linalg.norm(positions[first] - positions[second]) == pytest.approx(
            distance._value, rel=tolerance)
    before = positions.copy()
    context.computeVirtualSites()
    assert np.allclose(positionsOf(context), before, rtol=0, atol=1e-7)


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


# ---- Temperatures --------------------------------------------------------------------------------


def readTable(text):
    lines = text.strip().splitlines()
    names = [name.strip('"') for name in lines[0].lstrip('#').split(',')]
    return names, [dict(zip(names, line.split(','))) for line in lines[1:]]


TEMPERATURES = ['Temperature (K)', 'Translational Temperature (K)'
                ] + [f'Rotational Temperature {k} (K)' for k in (1, 2, 3)]


def reportTemperatures(simulation, count, prepare):
    """The table that a StateDataReporter writes of this number of prepared states."""
    out = io.StringIO()
    reporter = openmmrigidhi.app.StateDataReporter(out, 1, temperature=True,
                                                   translationalTemperature=True,
                                                   rotationalTemperatures=True)
    for k in range(count):
        prepare(k)
        reporter.report(simulation, simulation.context.getState(getEnergy=True))
    return readTable(out.getvalue())[1]


def checkTemperatures(table, expected, degrees):
    """The mean of n chi-square variables has the relative standard deviation sqrt(2/(degrees n)).
    Five of these are exceeded by chance with probability 6e-7."""
    for name, count in zip(TEMPERATURES, degrees):
        values = np.array([float(row[name]) for row in table])
        sigma = expected*np.sqrt(2/(count*len(values)))
        z = (values.mean() - expected)/sigma
        print(f'{name}: {values.mean():.2f} +- {sigma:.2f}, expected {expected}, z = {z:.2f}')
        assert abs(z) < 5, name


def test_temperatures_are_right_at_equilibrium(waterBox, platform):
    simulation = waterBox.simulation(platform)
    table = reportTemperatures(simulation, 200,
                               lambda k: simulation.context.setVelocitiesToTemperature(300, k + 1))
    checkTemperatures(table, 300, (6*27, 3*27, 27, 27, 27))


def test_temperatures_are_right_without_centre_of_mass_motion(platform):
    """A motion remover takes 3 degrees of freedom in a tiny step. Half of the mass is in free
    particles."""
    box, simulation = mixedBox(platform)
    box.system.addForce(openmm.CMMotionRemover())
    integrator = CustomRigidHIIntegrator(300, 1e-7)
    for residue in list(box.topology.residues())[:14]:
        integrator.addRigidBody([atom.index for atom in residue.atoms()])
    integrator.setFriction(0)
    integrator.setRotationalFriction(0)
    simulation = box.simulation(platform, integrator)

    def prepare(k):
        simulation.context.setVelocitiesToTemperature(300, k + 1)
        simulation.step(1)

    table = reportTemperatures(simulation, 150, prepare)
    checkTemperatures(table, 300, (6*27 - 3, 3*14 - 3*14/27, 14, 14, 14))


def test_the_total_energy_column_matches_the_temperature(waterBox, platform):
    out = io.StringIO()
    simulation = waterBox.simulation(platform)
    simulation.context.setVelocitiesToTemperature(300, 1)
    simulation.reporters.append(
        openmmrigidhi.app.StateDataReporter(out, 2, step=True, time=True, kineticEnergy=True,
                                            temperature=True, volume=True, density=True,
                                            speed=True))
    simulation.step(4)
    names, rows = readTable(out.getvalue())
    assert names == [
        'Step', 'Time (ps)', 'Kinetic Energy (kJ/mole)', 'Temperature (K)', 'Box Volume (nm^3)',
        'Density (g/mL)', 'Speed (ns/day)'
    ]
    for row in rows:
        kinetic = float(row['Kinetic Energy (kJ/mole)'])
        assert float(row['Temperature (K)']) == pytest.approx(2*kinetic/(6*27*GAS_CONSTANT),
                                                              rel=1e-9)
    assert float(rows[0]['Density (g/mL)']) == pytest.approx(0.997, abs=0.002)


def test_schemes_without_momenta_report_not_available(waterBox, platform):
    integrator = waterBox.integrator(stepSize=0.0005)
    integrator.setScheme(CustomRigidHIIntegrator.GradientThermostat)
    simulation = waterBox.simulation(platform, integrator)
    table = reportTemperatures(simulation, 1, lambda k: None)
    assert [table[0][name] for name in TEMPERATURES] == ['n/a']*5


def test_massless_systems_report_not_available_and_density_zero(platform):
    system = openmm.System()
    system.addParticle(0.0)
    topology = app.Topology()
    topology.addAtom('X', None, topology.addResidue('X', topology.addChain()))
    simulation = app.Simulation(topology, system, CustomRigidHIIntegrator(300, 0.002), platform)
    simulation.context.setPositions([(0, 0, 0)])
    out = io.StringIO()
    simulation.reporters.append(
        openmmrigidhi.app.StateDataReporter(out, 1, temperature=True, density=True,
                                            translationalTemperature=True,
                                            rotationalTemperatures=True))
    simulation.step(1)
    _, rows = readTable(out.getvalue())
    assert [rows[0][name]
            for name in TEMPERATURES] == ['n/a']*5 and float(rows[0]['Density (g/mL)']) == 0


def test_linear_bodies_have_two_rotational_temperatures(platform):
    system, positions, definitions = dumbbells(3)
    integrator = CustomRigidHIIntegrator(300, 0.002)
    for definition in definitions:
        integrator.addRigidBody(*definition)
    topology = app.Topology()
    residue = topology.addResidue('X', topology.addChain())
    for _ in range(6):
        topology.addAtom('X', None, residue)
    simulation = app.Simulation(topology, system, integrator, platform)
    simulation.context.setPositions(positions)
    table = reportTemperatures(simulation, 1,
                               lambda k: simulation.context.setVelocitiesToTemperature(300, 1))
    assert table[0]['Rotational Temperature 1 (K)'] == 'n/a'
    assert float(table[0]['Rotational Temperature 2 (K)']) > 0


# ---- OpenMM's own reporters, states and checkpoints ----------------------------------------------


def test_openmm_reporters_work(tmp_path, waterBox, platform):
    simulation = waterBox.simulation(platform)
    text = io.StringIO()
    simulation.reporters += [
        app.DCDReporter(str(tmp_path/'out.dcd'), 2),
        app.StateDataReporter(text, 2, temperature=True),
        app.PDBReporter(str(tmp_path/'out.pdb'), 2)
    ]
    simulation.step(6)
    simulation.reporters.clear()
    atoms = waterBox.topology.getNumAtoms()
    header, frame = 276, 56 + 3*(4*atoms + 8)
    assert os.path.getsize(tmp_path/'out.dcd') == header + 3*frame
    assert len(text.getvalue().splitlines()) == 4


@pytest.mark.parametrize('way', ['checkpoint', 'state', 'checkpoint reporter'])
def test_a_simulation_resumes_bit_for_bit_on_reference(way, tmp_path, waterBox):
    reference = openmm.Platform.getPlatformByName('Reference')
    first, second = waterBox.simulation(reference), waterBox.simulation(reference)
    file = str(tmp_path/'saved')
    first.context.setVelocitiesToTemperature(300, 3)
    if way == 'checkpoint reporter':
        first.reporters.append(app.CheckpointReporter(file, 3))
    first.step(3)
    if way == 'checkpoint':
        first.saveCheckpoint(file)
    elif way == 'state':
        first.saveState(file)
    first.reporters.clear()
    first.step(4)
    second.loadState(file) if way == 'state' else second.loadCheckpoint(file)
    assert second.currentStep == 3
    second.step(4)
    assert np.array_equal(positionsOf(first.context), positionsOf(second.context))
    assert np.array_equal(first.integrator.getBodyOrientations(),
                          second.integrator.getBodyOrientations())
    assert np.array_equal(first.integrator.getBodyAngularVelocities()._value,
                          second.integrator.getBodyAngularVelocities()._value)


def test_a_simulation_resumes_on_cpu(tmp_path, waterBox):
    """On CPU OpenMM's own forces differ between runs in the last bits of a float. So the states
    agree exactly only at the resumed step."""
    cpu = openmm.Platform.getPlatformByName('CPU')
    first, second = waterBox.simulation(cpu), waterBox.simulation(cpu)
    first.context.setVelocitiesToTemperature(300, 3)
    first.step(3)
    first.saveState(str(tmp_path/'state'))
    second.loadState(str(tmp_path/'state'))
    for getter in ('getBodyPositions', 'getBodyVelocities', 'getBodyAngularVelocities'):
        assert np.array_equal(
            getattr(first.integrator, getter)()._value,
            getattr(second.integrator, getter)()._value)
    assert np.array_equal(first.integrator.getBodyOrientations(),
                          second.integrator.getBodyOrientations())
    first.step(3)
    second.step(3)
    assert np.allclose(positionsOf(first.context), positionsOf(second.context), rtol=0, atol=1e-5)


def test_openmm_minimiser_works_on_constrained_bodies(waterBox, platform):
    simulation = waterBox.simulation(platform)
    before = energyOf(simulation.context)
    # OpenMM 8.1 gives up at a limit of 20 iterations without having moved anything.
    simulation.minimizeEnergy(tolerance=100)
    assert energyOf(simulation.context) < before
    simulation.step(1)
    checkShapes(waterBox, simulation.context, 1e-12)


# ---- Files of body states ------------------------------------------------------------------------


def runWithReporter(waterBox, platform, file, steps=6):
    simulation = waterBox.simulation(platform)
    simulation.context.setVelocitiesToTemperature(300, 3)
    simulation.reporters.append(openmmrigidhi.app.RigidBodyReporter(file, 2))
    simulation.step(steps)
    return simulation


def test_body_states_come_back_from_the_file(tmp_path, waterBox, platform):
    simulation = runWithReporter(waterBox, platform, tmp_path/'states.h5')
    integrator = simulation.integrator
    states = openmmrigidhi.app.readBodyStates(tmp_path/'states.h5')
    assert len(states) == 3 and states.step.tolist() == [2, 4, 6]
    assert np.allclose(states.time.value_in_unit(unit.femtosecond), [4, 8, 12])
    assert np.array_equal(states.positions[-1].value_in_unit(unit.nanometer),
                          integrator.getBodyPositions()._value)
    assert np.array_equal(states.orientations[-1], integrator.getBodyOrientations())
    assert np.array_equal(states.velocities[-1]._value, integrator.getBodyVelocities()._value)
    assert np.array_equal(states.angularVelocities[-1]._value,
                          integrator.getBodyAngularVelocities()._value)
    assert np.allclose(states.boxVectors[0].value_in_unit(unit.nanometer), np.eye(3)*waterBox.box)
    for body, (particles, mass, moments, sites) in enumerate(
            map(integrator.getRigidBodyParameters, range(27))):
        assert states.particles[body] == particles and states.mass[body] == mass
        assert np.all(states.principalMoments[body] == moments) and np.all(
            states.sitePositions[body] == sites)


def test_the_documented_layout_is_there(tmp_path, waterBox):
    runWithReporter(waterBox, openmm.Platform.getPlatformByName('Reference'), tmp_path/'states.h5',
                    2)
    from openmmrigidhi.app import bodystates
    documented = [
        line.split()[0] for line in bodystates.__doc__.splitlines() if line.startswith('    /')
    ]
    with h5py.File(tmp_path/'states.h5') as file:
        for path in documented[1:]:
            assert 'unit' in file[path].attrs, path
        found = []
        file.visititems(lambda name, item: found.append('/' + name)
                        if isinstance(item, h5py.Dataset) else None)
    assert sorted(found) == sorted(documented[1:])


def test_a_resumed_run_leaves_the_file_of_the_uninterrupted_one(tmp_path, waterBox):
    reference = openmm.Platform.getPlatformByName('Reference')
    first = waterBox.simulation(reference)
    first.context.setVelocitiesToTemperature(300, 3)
    first.reporters.append(openmmrigidhi.app.RigidBodyReporter(tmp_path/'whole.h5', 2))
    first.reporters.append(openmmrigidhi.app.RigidBodyReporter(tmp_path/'parts.h5', 2))
    first.step(3)
    first.saveCheckpoint(str(tmp_path/'checkpoint'))
    first.step(2)
    del first.reporters[1]
    first.step(3)
    second = waterBox.simulation(reference)
    second.loadCheckpoint(str(tmp_path/'checkpoint'))
    second.reporters.append(openmmrigidhi.app.RigidBodyReporter(tmp_path/'parts.h5', 2,
                                                                append=True))
    second.step(5)
    whole, parts = [
        openmmrigidhi.app.readBodyStates(tmp_path/name) for name in ('whole.h5', 'parts.h5')
    ]
    assert whole.step.tolist() == parts.step.tolist() == [2, 4, 6, 8]
    assert np.array_equal(whole.positions._value, parts.positions._value)
    assert np.array_equal(whole.orientations, parts.orientations)


def test_a_frame_that_was_half_written_is_ignored_and_overwritten(tmp_path, waterBox):
    platform = openmm.Platform.getPlatformByName('Reference')
    runWithReporter(waterBox, platform, tmp_path/'states.h5', 4)
    with h5py.File(tmp_path/'states.h5', 'r+') as file:
        file['positions'].resize(3, axis=0)
    assert len(openmmrigidhi.app.readBodyStates(tmp_path/'states.h5')) == 2
    simulation = waterBox.simulation(platform)
    simulation.currentStep = 4
    simulation.reporters.append(
        openmmrigidhi.app.RigidBodyReporter(tmp_path/'states.h5', 2, append=True))
    simulation.step(2)
    states = openmmrigidhi.app.readBodyStates(tmp_path/'states.h5')
    assert states.step.tolist() == [2, 4, 6] and len(states.positions) == 3


def test_files_of_others_are_refused(tmp_path, waterBox):
    platform = openmm.Platform.getPlatformByName('Reference')
    with h5py.File(tmp_path/'foreign.h5', 'w') as file:
        file['positions'] = np.zeros(3)
    with pytest.raises(ValueError, match='give a file that a RigidBodyReporter wrote'):
        openmmrigidhi.app.readBodyStates(tmp_path/'foreign.h5')
    runWithReporter(waterBox, platform, tmp_path/'states.h5', 2)
    _, simulation = mixedBox(platform)
    simulation.reporters.append(
        openmmrigidhi.app.RigidBodyReporter(tmp_path/'states.h5', 2, append=True))
    with pytest.raises(ValueError,
                       match=r'it holds other bodies \(27\) than the integrator \(14\)'):
        simulation.step(2)
    for interval in (0, -3):
        with pytest.raises(ValueError, match='reportInterval'):
            openmmrigidhi.app.RigidBodyReporter(tmp_path/'x.h5', interval)
    with pytest.raises(TypeError, match='reportInterval'):
        openmmrigidhi.app.RigidBodyReporter(tmp_path/'x.h5', 1.5)


# ---- Shapes --------------------------------------------------------------------------------------


@pytest.mark.parametrize('n', [12, 42, 162, 642, 2562])
def test_sphere_shells_are_even(n):
    points = openmmrigidhi.app.sphereShell(n, 2*unit.angstrom).value_in_unit(unit.nanometer)
    assert points.shape == (n, 3)
    assert np.allclose(np.linalg.norm(points, axis=1), 0.2, rtol=1e-14)
    assert np.allclose(points.mean(axis=0), 0, atol=1e-14)
    # By icosahedral symmetry the second moments are isotropic.
    assert np.allclose(points.T @ points/n, np.eye(3)*0.2**2/3, atol=1e-14)
    nearest = scipy.spatial.cKDTree(points).query(points, 2)[0][:, 1]
    # The nearest neighbours of the flattened icosahedron's faces are at most 1.2 times as far as
    # those at its vertices.
    assert nearest.max()/nearest.min() < 1.2


def test_the_twelve_points_are_an_icosahedron():
    points = openmmrigidhi.app.sphereShell(12, 1)._value
    distances = np.sort(np.linalg.norm(points - points[0], axis=1))
    assert np.allclose(distances[1:6], 4/np.sqrt(10 + 2*np.sqrt(5)), rtol=1e-14)


@pytest.mark.parametrize('arguments, error', [((13, 1), ValueError), ((12, 0), ValueError),
                                              ((12, -1), ValueError), ((12, np.nan), ValueError),
                                              ((12.0, 1), TypeError), ((12, 'a'), TypeError),
                                              ((12, 1*unit.kelvin), TypeError)])
def test_bad_shells_are_refused(arguments, error):
    with pytest.raises(error, match='sphereShell'):
        openmmrigidhi.app.sphereShell(*arguments)


# ---- The package ---------------------------------------------------------------------------------


def test_everything_in_app_is_documented():
    for name in openmmrigidhi.app.__all__:
        assert getattr(openmmrigidhi.app, name).__doc__, name


def test_unknown_attributes_are_errors():
    with pytest.raises(AttributeError, match='nonsense'):
        openmmrigidhi.nonsense
    assert {'app', 'analysis', 'accuracy', 'CustomRigidHIIntegrator'} <= set(dir(openmmrigidhi))
