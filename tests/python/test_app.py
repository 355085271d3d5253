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
from scenes import WaterBox, checkShapes, dumbbells, energyOf, mixedBox, positionsOf

import openmmrigidhi
from openmmrigidhi import CustomRigidHIIntegrator

GAS_CONSTANT = unit.MOLAR_GAS_CONSTANT_R.value_in_unit(unit.kilojoule_per_mole/unit.kelvin)
OXYGEN_HYDROGEN = 0.09572  # nm, TIP4P-Ew

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


def test_residues_are_bound_where_positions_fix_their_shape(platform):
    system, _, positions = periodicDumbbells()
    topology = app.Topology()
    chain = topology.addChain()
    for _ in range(2):
        residue = topology.addResidue('DUM', chain)
        for _ in range(2):
            topology.addAtom('B', None, residue)
    integrator = CustomRigidHIIntegrator(300, 0.002)
    arguments = integrator, topology, ['DUM']
    with pytest.raises(ValueError, match=r'pass no system .*\(or fromPositions=True\)'):
        openmmrigidhi.app.addRigidResidues(*arguments, system)
    with pytest.raises(ValueError, match='fromPositions: got True without a system; OpenMM must'):
        openmmrigidhi.app.addRigidResidues(*arguments, fromPositions=True)
    assert openmmrigidhi.app.addRigidResidues(*arguments, system, fromPositions=True) == [0, 1]
    context = openmm.Context(system, integrator, platform)
    context.setPositions(positions)
    integrator.step(5)
    wrapped = positionsOf(context, enforcePeriodicBox=True)
    assert np.allclose(np.linalg.norm(wrapped[1::2] - wrapped[::2], axis=1), 0.2, atol=1e-6)
    assert [len(molecule) for molecule in context.getMolecules()] == [2, 2]


# ---- Topologies without elements -----------------------------------------------------------------


def colloids():
    """Two rods and a sphere, with a free particle and a particle of the first rod between them."""
    system, fluid = openmm.System(), openmmrigidhi.MobilityForce()
    integrator = CustomRigidHIIntegrator(300, 0.01)
    integrator.setScheme('EulerMaruyama')
    for _ in range(9):
        system.addParticle(0)
        fluid.addParticle(0.5)
    rod = openmmrigidhi.app.rod(3, 1.0)
    integrator.addRigidBody([0, 1, 4], 0, (0, 0, 0), rod)
    integrator.addRigidBody([5, 6, 7], 0, (0, 0, 0), rod)
    integrator.addRigidBody([8], 0, (0, 0, 0), [(0, 0, 0)])
    integrator.addRigidBody([2], 0, (0, 0, 0), [(0, 0, 0)])
    system.addForce(fluid)
    positions = [(-1, 0, 0), (0, 0, 0), (0, 9, 0), (9, 0, 0), (1, 0, 0), (-1, 4, 0), (0, 4, 0),
                 (1, 4, 0), (0, 0, 5)]
    return system, integrator, positions


def test_a_topology_of_colloids_serves_simulations_and_reporters(tmp_path, platform):
    system, integrator, positions = colloids()
    topology = openmmrigidhi.app.bodyTopology(system, integrator, ['ROA', 'ROB', 'SPH', 'SPI'])
    # OpenMM wants the atoms of a residue in one row: the first rod is two residues.
    assert [residue.name
            for residue in topology.residues()] == ['ROA', 'SPI', 'FRE', 'ROA', 'ROB', 'SPH']
    assert [atom.index for atom in topology.atoms()] == list(range(9))
    assert all(atom.element is None for atom in topology.atoms())
    assert sorted((one.index, two.index) for one, two in topology.bonds()) == [(0, 1), (0, 4),
                                                                               (5, 6), (5, 7)]
    assert topology.getPeriodicBoxVectors() is None
    simulation = app.Simulation(topology, system, integrator, platform)
    simulation.context.setPositions(positions)
    pdb, dcd, gsd = (str(tmp_path/name) for name in ('a.pdb', 'a.dcd', 'a.gsd'))
    simulation.reporters += [app.PDBReporter(pdb, 1), app.DCDReporter(dcd, 1)]
    try:
        import gsd as _  # noqa: F401
        simulation.reporters.append(openmmrigidhi.app.GsdReporter(gsd, 1))
    except ImportError:
        gsd = None
    simulation.step(2)
    read = app.PDBFile(pdb).topology
    assert read.getNumAtoms() == 9
    if gsd:
        assert openmmrigidhi.app.readGsd(gsd).positions.shape == (2, 4, 3)


def test_a_topology_of_colloids_has_the_periodic_box_and_refuses_other_bodies():
    system, integrator, _ = periodicDumbbells()
    topology = openmmrigidhi.app.bodyTopology(system, integrator)
    assert topology.getPeriodicBoxVectors()[0][0] == 2*unit.nanometer
    for names in (['A'], 'AB'):
        with pytest.raises(ValueError, match='each body needs a name of its own'):
            openmmrigidhi.app.bodyTopology(system, integrator, names)
    with pytest.raises(
            ValueError, match=
            'body 1 needs particle 3, but the System has 2 particles; the bodies must be of this'):
        smaller = openmm.System()
        for _ in range(2):
            smaller.addParticle(1)
        openmmrigidhi.app.bodyTopology(smaller, integrator)


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


@pytest.mark.parametrize('progress', [False, True])
def test_a_table_continues_without_lines_twice(progress, tmp_path, waterBox):
    """Lines after the checkpoint, of which the last is not whole, are written again."""
    def reporter(name, append):
        return openmmrigidhi.app.StateDataReporter(str(tmp_path/name), 2, step=True, time=True,
                                                   potentialEnergy=True, progress=progress,
                                                   totalSteps=20, append=append)

    def simulation(*reporters):
        made = waterBox.simulation(openmm.Platform.getPlatformByName('Reference'))
        made.reporters += reporters
        return made

    first = simulation(reporter('whole', False), reporter('parts', True))
    first.step(5)
    first.saveCheckpoint(str(tmp_path/'checkpoint'))
    first.step(4)
    del first.reporters[1]
    first.step(3)
    with open(tmp_path/'parts', 'a') as file:
        file.write('10,0.0')
    second = simulation(reporter('parts', True))
    second.loadCheckpoint(str(tmp_path/'checkpoint'))
    second.step(7)
    second.reporters.clear()
    whole = (tmp_path/'whole').read_text()
    assert whole == (tmp_path/'parts').read_text()
    assert len(whole.splitlines()) == 7
    # A run from the start is another run.
    with pytest.raises(ValueError,
                       match='parts: append: the file has 6 frames or lines up to step 12, and'):
        simulation(reporter('parts', True)).step(2)
    assert whole == (tmp_path/'parts').read_text()
    # Without steps nobody knows which lines these are.
    for _ in range(2):
        timed = openmmrigidhi.app.StateDataReporter(str(tmp_path/'timed'), 1, time=True,
                                                    append=True)
        run = simulation(timed)
        if _ == 0:
            run.step(1)
            continue
        with pytest.warns(UserWarning, match='give step=True and the name of the file'):
            run.step(1)


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
