"""Settings of integrator, System, fluid and barostat that do not fit each other are named: once,
and only where they do not fit."""
import itertools
import re

import numpy as np
import openmm
import pytest

import openmmrigidhi
from openmmrigidhi import MobilityForce, app

Integrator = openmmrigidhi.CustomRigidHIIntegrator
REFERENCE = openmm.Platform.getPlatformByName('Reference')


def periodic(system):
    """A force that knows the box, and does nothing."""
    bonds = openmm.HarmonicBondForce()
    bonds.setUsesPeriodicBoundaryConditions(True)
    system.addForce(bonds)


def scene(bodies=2):
    system, integrator = openmm.System(), Integrator(300, 0.001)
    for _ in range(bodies):
        integrator.addRigidBody([system.addParticle(10)], 10, (1, 1, 1), [(0, 0, 0)])
    system.setDefaultPeriodicBoxVectors((9, 0, 0), (0, 9, 0), (0, 0, 9))
    return system, integrator


def started(system, integrator):
    context = openmm.Context(system, integrator, REFERENCE)
    context.setPositions([(3*i, 0, 0) for i in range(system.getNumParticles())])
    return context


# ---- Barostats -----------------------------------------------------------------------------------

BAROSTATS = {
    'isotropic': (lambda T: openmm.MonteCarloBarostat(1.5, T), 'MonteCarloTemperature',
                  'at {} K, 1.5 bar'),
    'anisotropic': (lambda T: openmm.MonteCarloAnisotropicBarostat(openmm.Vec3(1, 2, 3), T),
                    'AnisotropicMonteCarloTemperature',
                    'at {} K, 1 bar along x, 2 bar along y, 3 bar along z'),
    'membrane': (lambda T: openmm.MonteCarloMembraneBarostat(1, 4, T, 0, 0),
                 'MembraneMonteCarloTemperature', 'at {} K, 1 bar, 4 bar nm of surface'),
}


@pytest.mark.parametrize('make, parameter, shown', BAROSTATS.values(), ids=BAROSTATS.keys())
def test_a_barostat_at_another_temperature(capfd, make, parameter, shown):
    system, integrator = scene()
    periodic(system)
    system.addForce(make(310))
    context = started(system, integrator)
    assert shown.format(310) in integrator.getEffects()['barostat']
    warning = ('is at 310 K, but the integrator at 300 K: set one temperature by setTemperature() '
               f"and by the Context's parameter {parameter}")
    assert warning in integrator.getEffects()['warnings']
    assert capfd.readouterr().err == '', 'the user may set the other temperature before a step'
    integrator.step(2)
    assert capfd.readouterr().err.count(warning) == 1
    # One temperature after the other, as in annealing.
    context.setParameter(parameter, 320)
    assert shown.format(320) in integrator.getEffects()['barostat']
    integrator.setTemperature(320)
    integrator.step(1)
    assert integrator.getEffects()['warnings'] == 'off: none'


@pytest.mark.parametrize('make, parameter, shown', BAROSTATS.values(), ids=BAROSTATS.keys())
def test_a_barostat_at_the_temperature_of_the_integrator(capfd, make, parameter, shown):
    system, integrator = scene()
    periodic(system)
    system.addForce(make(310))
    context = started(system, integrator)
    context.setParameter(parameter, 300)
    for temperature in 300, 295.7, 280:
        integrator.setTemperature(temperature)
        context.setParameter(parameter, temperature)
        integrator.step(1)
        assert integrator.getEffects()['warnings'] == 'off: none'
    assert capfd.readouterr().err == ''


def test_a_barostat_beside_bodies_without_a_thermostat(capfd):
    """Without friction nothing has the integrator's temperature."""
    system, integrator = scene()
    periodic(system)
    system.addForce(openmm.MonteCarloBarostat(1, 310))
    integrator.setFriction(0)
    integrator.setRotationalFriction(0)
    _context = started(system, integrator)
    integrator.step(1)
    assert integrator.getEffects()['warnings'] == 'off: none' and capfd.readouterr().err == ''


# ---- Bodies that are not those of the Context ----------------------------------------------------


def test_bodies_that_were_added_after_the_context(capfd):
    system, integrator = scene(2)
    particles = [system.addParticle(10) for _ in range(3)]
    context = started(system, integrator)
    integrator.step(1)
    assert integrator.getEffects()['bodies'] == 'on: 2 bodies' and capfd.readouterr().err == ''
    for particle in particles:
        integrator.addRigidBody([particle], 10, (1, 1, 1), [(0, 0, 0)])
    warning = '3 bodies were added after the creation of this Context'
    for effect in 'bodies', 'warnings':
        assert warning in integrator.getEffects()[effect]
    integrator.step(2)
    assert capfd.readouterr().err.count(warning) == 1
    context.reinitialize()
    context.setPositions([(3*i, 0, 0) for i in range(5)])
    integrator.step(1)
    assert integrator.getEffects()['bodies'] == 'on: 5 bodies'
    assert integrator.getEffects()['warnings'] == 'off: none' and capfd.readouterr().err == ''


@pytest.mark.parametrize('platform', ['Reference', 'CPU'])
def test_particles_that_were_added_after_the_context(platform):
    """OpenMM would write beyond the end of its arrays."""
    system, fluid = openmm.System(), MobilityForce()
    integrator = Integrator(300, 0.01)
    integrator.setScheme('EulerMaruyama')
    for _ in range(2):
        app.addRigidMultiblob(system, integrator, fluid, [(0, 0, 0)], 1.0)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platform))
    context.setPositions([(0, 0, 0), (3, 0, 0)])
    integrator.step(1)
    mine = MobilityForce.cast(system.getForce(0))
    app.addRigidMultiblob(system, integrator, mine, [(0, 0, 0)], 1.0)
    with pytest.raises(openmm.OpenMMException, match='the System has 3 particles, but had 2 when'):
        integrator.step(1)
    context.reinitialize()
    context.setPositions([(0, 0, 0), (3, 0, 0), (6, 0, 0)])
    integrator.step(1)
    assert integrator.getEffects()['bodies'] == 'on: 3 bodies'


def test_joints_and_motors_that_were_added_after_the_context(capfd):
    system, fluid = openmm.System(), openmmrigidhi.MobilityForce()
    integrator = Integrator(0, 0.01)
    integrator.setScheme('FixmanMidpoint')
    for _ in range(3):
        app.addRigidMultiblob(system, integrator, fluid, [(0, 0, 0), (0, 1, 0), (0, 0, 1)], 0.5)
    integrator.addHinge(0, (1.5, 0, 0), 1, (-1.5, 0, 0), (0, 0, 1), (0, 0, 1))
    system.addForce(fluid)
    context = openmm.Context(system, integrator, REFERENCE)
    app.placeBodies(context, [(3*b, 0, 0) for b in range(3)])
    integrator.step(2)
    assert capfd.readouterr().err == ''
    integrator.addHingeMotor(0, 0.01)
    assert '1 motor was added after the creation' in integrator.getEffects()['warnings']
    integrator.addBallJoint(1, (1.5, 0, 0), 2, (-1.5, 0, 0))
    integrator.step(2)
    warning = '1 joint was added after the creation of this Context'
    assert capfd.readouterr().err.count(warning) == 1
    context.reinitialize(preserveState=True)
    integrator.step(2)
    assert integrator.getEffects()['joints'].startswith('on')
    assert integrator.getEffects()['warnings'] == 'off: none' and capfd.readouterr().err == ''


# ---- Rigid water ---------------------------------------------------------------------------------

WATER = np.array([(0, 0, 0), (0.09572, 0, 0), (-0.0239872, 0.0926627, 0)])


def molecule(system, masses, lengths, shape=WATER):
    """Three particles with constraints 0-1, 0-2, 1-2 of these lengths, as far as there are any."""
    first = system.getNumParticles()
    for mass in masses:
        system.addParticle(mass)
    for (i, j), length in zip([(0, 1), (0, 2), (1, 2)], lengths):
        system.addConstraint(first + i, first + j, length)
    return shape + (0, 0, 0.1*first)


RIGID = (0.09572, 0.09572, np.linalg.norm(WATER[1] - WATER[2]))


@pytest.mark.parametrize('scheme', [Integrator.LangevinA, Integrator.LangevinC])
@pytest.mark.parametrize('others, masses',
                         [(0, (15.999, 1.008, 1.008)), (2, (15.999, 1.008, 1.008)),
                          (0, (15.999, 2.014, 2.014)), (0, (18, 1.008, 1.008)),
                          (0, (15.999, 3.016, 3.016)), (0, (12.015, 3, 3)),
                          (0, (10.015, 4, 4))], ids=[
                              'water', 'and others', 'deuterium', 'heavy oxygen', 'tritium',
                              'mass moved', 'more mass moved'
                          ])
def test_rigid_water_that_is_in_no_body(capfd, others, masses, scheme):
    system, integrator = scene(others)
    integrator.setScheme(scheme)
    positions = [(i, 5, 0) for i in range(others)]
    positions += [row for _ in range(2) for row in molecule(system, masses, RIGID)]
    context = openmm.Context(system, integrator, REFERENCE)
    context.setPositions(positions)
    integrator.step(2)
    effects = integrator.getEffects()
    assert '6 constraints, also of 2 rigid waters that are in no body' in effects[
        'constraints of free particles']
    warning = '2 rigid waters are in no body, so that each step solves their constraints ' \
        f'(the first water begins with particle {others}); call openmmrigidhi.app.addRigidWater()'
    assert warning in effects['warnings'] and capfd.readouterr().err.count(warning) == 1


@pytest.mark.parametrize('masses, lengths, asBody', [((15.999, 1.008, 1.008), RIGID, True),
                                                     ((15.999, 1.008, 1.008), RIGID[:2], False),
                                                     ((15.999, 1.008, 1.008), (), False),
                                                     ((12.011, 12.011, 12.011), RIGID, False),
                                                     ((16, 12, 1), RIGID, False),
                                                     ((32.06, 15.999, 15.999), RIGID, False),
                                                     ((32.06, 1.008, 1.008), RIGID, False),
                                                     ((12.011, 1.008, 1.008), RIGID, False),
                                                     ((15.999, 14.007, 14.007), RIGID, False),
                                                     ((8.027, 3, 3), RIGID, False),],
                         ids=[
                             'a body', 'flexible angle', 'flexible', 'equal masses', 'others',
                             'SO2', 'H2S', 'CH2', 'N2O', 'CH2 with mass moved'
                         ])
def test_water_that_is_right_as_it_is(capfd, masses, lengths, asBody):
    system, integrator = openmm.System(), Integrator(300, 0.001)
    positions = molecule(system, masses, lengths)
    if asBody:
        integrator.addRigidBody([0, 1, 2])
    context = openmm.Context(system, integrator, REFERENCE)
    context.setPositions(positions)
    integrator.step(1)
    assert integrator.getEffects()['warnings'] == 'off: none' and capfd.readouterr().err == ''
    assert 'water' not in integrator.getEffects()['constraints of free particles']


# ---- Fluids --------------------------------------------------------------------------------------


def fluidScene(model, boundary, isPeriodic, bodies=2, groups=(), scheme='LangevinHI'):
    system, integrator = scene(bodies)
    integrator.setScheme(getattr(integrator, scheme))
    integrator.setStepSize(1e-4)  # momenta of LangevinHI relax in longer times
    fluid = MobilityForce()
    for _ in range(bodies):
        fluid.addParticle(0.5)
    fluid.setModel(getattr(fluid, model))
    fluid.setBoundary(getattr(fluid, boundary))
    if 'Wall' in boundary or 'Channel' in boundary:
        fluid.setWallHeight(-2)
        fluid.setChannelWalls(-2, 3)
    fluid.setGroups(list(groups))
    system.addForce(fluid)
    if isPeriodic:
        periodic(system)
    context = started(system, integrator)
    integrator.step(1)
    return integrator, context


@pytest.mark.parametrize('scheme', ['LangevinHI', 'EulerMaruyama'])
def test_an_unbounded_fluid_with_periodic_forces(capfd, scheme):
    integrator, _context = fluidScene('RotnePragerYamakawa', 'Unbounded', True, scheme=scheme)
    integrator.step(1)
    warning = 'the fluid is unbounded, though forces are periodic: bodies feel images of each other'
    assert warning in integrator.getEffects()['warnings']
    assert integrator.getEffects()['hydrodynamics'].endswith(
        '; unbounded, though forces are periodic')
    assert capfd.readouterr().err.count(warning) == 1


@pytest.mark.parametrize('model, boundary, isPeriodic, bodies, groups',
                         [('RotnePragerYamakawa', 'Unbounded', False, 2, ()),
                          ('RotnePragerYamakawa', 'Periodic', True, 2, ()),
                          ('FreeDraining', 'Unbounded', True, 2, ()),
                          ('FreeDraining', 'Periodic', True, 2, ()),
                          ('RotnePragerYamakawa', 'Unbounded', True, 1, ()),
                          ('RotnePragerYamakawa', 'Unbounded', True, 2, (0, 1)),])
def test_fluids_that_fit_the_forces(capfd, model, boundary, isPeriodic, bodies, groups):
    integrator, _context = fluidScene(model, boundary, isPeriodic, bodies, groups)
    effects = integrator.getEffects()
    assert effects['warnings'] == 'off: none' and capfd.readouterr().err == ''
    assert ('unbounded, though forces' in effects['hydrodynamics']) == (isPeriodic
                                                                        and boundary == 'Unbounded')


@pytest.mark.parametrize('scheme', ['LangevinHI', 'TrapezoidalSlip'])
@pytest.mark.parametrize('isPeriodic', [False, True])
def test_walls_with_periodic_forces(capfd, isPeriodic, scheme):
    """A periodic fluid would have no wall, so that nothing is to be changed."""
    integrator, _context = fluidScene('RotnePragerYamakawa', 'NoSlipWall', isPeriodic,
                                      scheme=scheme)
    effects = integrator.getEffects()
    assert effects['warnings'] == 'off: none' and capfd.readouterr().err == ''
    assert 'unbounded' not in effects['hydrodynamics']
    assert effects['hydrodynamics'].endswith(
        '; without images along x and y, though forces are periodic') == isPeriodic


@pytest.mark.parametrize('isPeriodic', [False, True])
def test_channels_with_periodic_forces(capfd, isPeriodic):
    integrator, _context = fluidScene('ForceCoupling', 'SlipChannel', isPeriodic,
                                      scheme='DriftCorrectorFD')
    effects = integrator.getEffects()
    assert effects['warnings'] == 'off: none' and capfd.readouterr().err == ''
    assert 'with all images along x and z' in effects['hydrodynamics']
    assert 'though forces' not in effects['hydrodynamics']


# ---- Boxes of fluids that are periodic along walls alone -----------------------------------------


def nonbonded(method, cutoff, charge):
    def add(system):
        force = openmm.NonbondedForce()
        force.setNonbondedMethod(getattr(force, method))
        force.setCutoffDistance(cutoff)
        for _ in range(system.getNumParticles()):
            force.addParticle(charge, 1, 0)
        system.addForce(force)

    return add


def custom(method, cutoff):
    def add(system):
        force = openmm.CustomNonbondedForce('1/r^12')
        force.setNonbondedMethod(getattr(force, method))
        force.setCutoffDistance(cutoff)
        for _ in range(system.getNumParticles()):
            force.addParticle([])
        system.addForce(force)

    return add


def others(name, cutoff):
    """Forces of classes that few people use, without an effect."""
    def make(count):
        if name == 'CustomCVForce':
            force = openmm.CustomCVForce('0*v')
            force.addCollectiveVariable('v', make_with('CustomGBForce', count))
            return force
        return make_with(name, count)

    def make_with(kind, count):
        force = {
            'CustomGBForce': lambda: openmm.CustomGBForce(),
            'CustomHbondForce': lambda: openmm.CustomHbondForce('0*distance(d1, a1)'),
            'CustomManyParticleForce': lambda: openmm.CustomManyParticleForce(
                2, '0*distance(p1, p2)'),
            'GayBerneForce': lambda: openmm.GayBerneForce(),
            'GBSAOBCForce': lambda: openmm.GBSAOBCForce(),
        }[kind]()
        force.setNonbondedMethod(force.CutoffPeriodic)
        force.setCutoffDistance(cutoff)
        if kind == 'CustomHbondForce':
            force.addDonor(0, -1, -1, [])
            force.addAcceptor(1, -1, -1, [])
            return force
        if kind == 'CustomGBForce':
            force.addComputedValue('B', '1', force.ParticlePair)
            force.addEnergyTerm('0*B', force.SingleParticle)
        parameters = {
            'GayBerneForce': (1, 0, -1, -1, 1, 1, 1, 1, 1, 1),
            'GBSAOBCForce': (0, 0.1, 1)
        }.get(kind, ([],))
        for _ in range(count):
            force.addParticle(*parameters)
        return force

    return lambda system: system.addForce(make(system.getNumParticles()))


def confined(boundary, edge, *forces):
    """Two spheres, at z = 1 and 2.5 nm, above a wall z = 0 or in a channel of 4 nm."""
    system, integrator, fluid = openmm.System(), Integrator(0, 1e-3), MobilityForce()
    integrator.setScheme(integrator.TrapezoidalSlip)
    for _ in range(2):
        integrator.addRigidBody([system.addParticle(0)], 0, (0, 0, 0), [(0, 0, 0)])
        fluid.addParticle(0.5)
    fluid.setBoundary(boundary)
    if 'Wall' in boundary or 'Channel' in boundary:
        fluid.setChannelWalls(0, 4)
    system.addForce(fluid)
    for add in forces:
        add(system)
    system.setDefaultPeriodicBoxVectors((9, 0, 0), (0, 9, 0), (0, 0, edge))
    context = openmm.Context(system, integrator, REFERENCE)
    context.setPositions([(1, 1, 1), (6, 6, 2.5)])
    integrator.step(2)
    return integrator, context


@pytest.mark.parametrize(
    'boundary, edge, forces, reach',
    [('NoSlipChannel', 5.4, [nonbonded('CutoffPeriodic', 1.5, 0.5)], 4),
     ('NoSlipChannel', 5.4, [custom('CutoffPeriodic', 1.5)], 4),
     ('PeriodicWall', 3.9, [nonbonded('PME', 1.5, 0)], 2.5),
     ('PeriodicWall', 3.9, [custom('CutoffPeriodic', 0.2),
                            custom('CutoffPeriodic', 1.5)], 2.5),
     *[('NoSlipChannel', 5.4, [others(name, 1.5)], 4)
       for name in ('CustomGBForce', 'CustomHbondForce', 'CustomManyParticleForce', 'GayBerneForce',
                    'GBSAOBCForce', 'CustomCVForce')]])
def test_a_box_that_is_too_short_across_the_walls(capfd, boundary, edge, forces, reach):
    integrator, _context = confined(boundary, edge, *forces)
    integrator.setStepSize(5e-4)
    integrator.step(2)
    warning = (f'boundary {boundary} has no images along z, but forces do: the box is {edge:g} nm '
               f'along z, less than the {reach:g} nm where particles are and the cut-off of force '
               f'{len(forces)}, 1.5 nm, so particles feel images of others through the walls; make '
               f'the third vector of the box {reach + 1.5:g} nm or longer')
    assert warning in integrator.getEffects()['warnings']
    assert 'Ewald' not in integrator.getEffects()['warnings']
    assert capfd.readouterr().err.count(warning) == 1


def test_charges_with_images_across_the_walls(capfd):
    integrator, _context = confined('NoSlipChannel', 9, nonbonded('PME', 1.5, 0.5))
    warning = 'Ewald sums of charges include all images along z; leave a gap along z'
    assert warning in integrator.getEffects()['warnings']
    err = capfd.readouterr().err
    assert err.count(warning) == 1 and 'the box is' not in err
    assert 'boundary NoSlipChannel has no images along z, but forces do: Ewald sums' in err
    confined('NoSlipChannel', 5, nonbonded('Ewald', 1.5, 0.5))
    err = capfd.readouterr().err
    assert 'which does not change the fluid; and Ewald sums of charges' in err


@pytest.mark.parametrize(
    'boundary, edge, forces',
    [('NoSlipChannel', 5.5, [nonbonded('CutoffPeriodic', 1.5, 0.5),
                             custom('CutoffPeriodic', 1.2)]),
     ('PeriodicWall', 4.0, [nonbonded('PME', 1.5, 0)]), ('NoSlipChannel', 2.5, []),
     ('NoSlipChannel', 2.5, [custom('CutoffNonPeriodic', 3)]),
     ('NoSlipWall', 3.1, [nonbonded('CutoffPeriodic', 1.5, 0.5)]),])
def test_boxes_that_are_long_enough_across_the_walls(capfd, boundary, edge, forces):
    integrator, _context = confined(boundary, edge, *forces)
    assert integrator.getEffects()['warnings'] == 'off: none' and capfd.readouterr().err == ''


# ---- Periodic fluids whose forces or box do not fit ----------------------------------------------


def inBox(boundary, edges, add=None, positions=((1, 1, 1), (6, 6, 2.5)), groups=(),
          model='RotnePragerYamakawa'):
    """Two spheres in a fluid with this box: (integrator, Context) after two steps."""
    system, integrator, fluid = openmm.System(), Integrator(0, 1e-3), MobilityForce()
    integrator.setScheme(integrator.TrapezoidalSlip)
    for _ in positions:
        integrator.addRigidBody([system.addParticle(0)], 0, (0, 0, 0), [(0, 0, 0)])
        fluid.addParticle(0.5)
    fluid.setBoundary(boundary)
    if 'Wall' in boundary or 'Channel' in boundary:
        fluid.setChannelWalls(0, 4)
    fluid.setGroups(list(groups))
    fluid.setModel(model)
    system.addForce(fluid)
    if add:
        add(system)
    if edges:
        system.setDefaultPeriodicBoxVectors(*np.diag(edges))
    context = openmm.Context(system, integrator, REFERENCE)
    context.setPositions(positions)
    integrator.step(2)
    return integrator, context


@pytest.mark.parametrize('boundary', ['Periodic', 'PeriodicWall', 'NoSlipChannel'])
@pytest.mark.parametrize('add', [
    custom('CutoffNonPeriodic', 4.5),
    custom('NoCutoff', 1),
    nonbonded('NoCutoff', 1, 0.5),
    nonbonded('CutoffNonPeriodic', 4.5, 0.5)
])
def test_forces_without_images_in_a_periodic_fluid(capfd, boundary, add):
    integrator, _context = inBox(boundary, (9, 9, 9), add)
    warning = ('has no images: particles that meet through a face of the box (9 nm along x) do not '
               'feel each other by this force, and can overlap; use '
               'setNonbondedMethod(CutoffPeriodic) of this force, or a longer box')
    assert warning in integrator.getEffects()['warnings']
    assert 'the fluid is periodic, but force 1, a ' in integrator.getEffects()['warnings'].replace(
        'The', 'the')
    assert capfd.readouterr().err.count(warning) == 1


@pytest.mark.parametrize('boundary, add, settings',
                         [('Periodic', custom('CutoffPeriodic', 4.4), {}),
                          ('Periodic', custom('CutoffNonPeriodic', 3.9), {}),
                          ('Periodic', nonbonded('NoCutoff', 1, 0), {}),
                          ('Periodic', custom('NoCutoff', 1), {
                              'positions': ((1, 1, 1), (5, 4, 3))
                          }), ('Periodic', custom('NoCutoff', 1), {
                              'groups': (0, 1)
                          }), ('NoSlipWall', custom('NoCutoff', 1), {}),
                          ('Unbounded', custom('NoCutoff', 1), {}),])
def test_forces_that_need_no_images(capfd, boundary, add, settings):
    """Images do not matter for a cluster amid its box, without interactions, or without images of
    the fluid."""
    integrator, _context = inBox(boundary, (9, 9, 9), add, **settings)
    assert integrator.getEffects()['warnings'] == 'off: none' and capfd.readouterr().err == ''


@pytest.mark.parametrize('boundary', ['Periodic', 'PeriodicWall'])
def test_a_box_that_nobody_has_set(capfd, boundary):
    integrator, _context = inBox(boundary, None)
    warning = ("the box of the periodic fluid has edges of 2 nm, as OpenMM's System has them by "
               'default, but particles are up to 5 nm apart along x; set the box by')
    assert warning[4:] in integrator.getEffects()['warnings']
    assert capfd.readouterr().err.count(warning) == 1
    for edges, positions in (((2, 2, 2), ((1, 1, 1), (2.5, 2.5, 2))), ((3, 3, 3), ((1, 1, 1),
                                                                                   (6.2, 6, 1)))):
        integrator, _context = inBox(boundary, edges, positions=positions)
        assert integrator.getEffects()['warnings'] == 'off: none'
        assert capfd.readouterr().err == ''


WIDE, CLUSTER = ((0, 0, 1), (6.5, 0, 1)), ((0, 0, 1), (4, 0, 1))


@pytest.mark.parametrize('add', [custom('CutoffPeriodic', 3), nonbonded('PME', 3, 0.5)])
def test_periodic_forces_above_a_wall_without_images(capfd, add):
    integrator, _context = inBox('NoSlipWall', (9, 9, 9), add, WIDE)
    warning = ('the fluid above the NoSlipWall has no images, though forces are periodic and '
               'particles are up to 6.5 nm apart along x in a box of 9 nm')
    assert warning in integrator.getEffects()['warnings']
    assert capfd.readouterr().err.count(warning) == 1


@pytest.mark.parametrize(
    'boundary, add, positions, model',
    [('NoSlipWall', custom('CutoffPeriodic', 3), CLUSTER, 'RotnePragerYamakawa'),
     ('NoSlipWall', custom('CutoffNonPeriodic', 3), WIDE, 'RotnePragerYamakawa'),
     ('NoSlipWall', custom('CutoffPeriodic', 2), WIDE, 'RotnePragerYamakawa'),
     ('NoSlipWall', nonbonded('PME', 3, 0.5), CLUSTER, 'RotnePragerYamakawa'),
     ('PeriodicWall', custom('CutoffPeriodic', 3), WIDE, 'RotnePragerYamakawa'),
     ('Unbounded', custom('CutoffPeriodic', 3), WIDE, 'FreeDraining'),])
def test_forces_above_a_wall_that_need_no_images(capfd, boundary, add, positions, model):
    integrator, _context = inBox(boundary, (9, 9, 9), add, positions, model=model)
    assert integrator.getEffects()['warnings'] == 'off: none' and capfd.readouterr().err == ''


# ---- Forces between replicas ---------------------------------------------------------------------


def bond(system):
    force = openmm.HarmonicBondForce()
    force.addBond(0, 2, 1, 1)
    system.addForce(force)


def within(*sets):
    """A pair force within sets of particles only."""
    def add(system):
        custom('NoCutoff', 1)(system)
        force = system.getForce(system.getNumForces() - 1)
        for each in sets:
            force.addInteractionGroup(each, each)

    return add


def excluded(kind):
    """A pair force that excludes particles 0 and 1 from 2 and 3."""
    def add(system):
        (custom('NoCutoff', 1) if kind == 'custom' else nonbonded('NoCutoff', 1, 0.5))(system)
        force = system.getForce(system.getNumForces() - 1)
        for i, j in itertools.product((0, 1), (2, 3)):
            if kind == 'custom':
                force.addExclusion(i, j)
            else:
                force.addException(i, j, 0, 1, 0)

    return add


#: Two replicas of two spheres, of which the second pair is shifted by 1.5 nm or by 10 nm.
NEAR = ((0, 0, 0), (3, 0, 0), (0, 1.5, 0), (3, 1.5, 0))
FAR = ((0, 0, 0), (3, 0, 0), (0, 10, 0), (3, 10, 0))


@pytest.mark.parametrize('add, positions', [(custom('NoCutoff', 1), NEAR),
                                            (custom('CutoffNonPeriodic', 1.6), NEAR),
                                            (nonbonded('NoCutoff', 1, 0.5), NEAR),
                                            (custom('CutoffNonPeriodic', 11), FAR), (bond, FAR)])
def test_forces_between_replicas(capfd, add, positions):
    integrator, _context = inBox('Unbounded', None, add, positions, (0, 0, 1, 1))
    # Which pair is named depends on places, of several pairs that are near.
    warning = (
        r'acts between particles [01] and [23] of groups 0 and 1 of setGroups\(\): the fluid '
        'keeps groups apart, but forces do not')
    assert re.search(warning, integrator.getEffects()['warnings'])
    assert len(re.findall(warning, capfd.readouterr().err)) == 1


@pytest.mark.parametrize('add, positions, groups, model',
                         [(custom('NoCutoff', 1), NEAR, (0, 0, 0, 0), 'RotnePragerYamakawa'),
                          (custom('NoCutoff', 1), NEAR, (), 'RotnePragerYamakawa'),
                          (custom('NoCutoff', 1), NEAR, (0, 0, 1, 1), 'FreeDraining'),
                          (custom('NoCutoff', 1), FAR, (0, 0, 1, 1), 'RotnePragerYamakawa'),
                          (custom('CutoffNonPeriodic', 9), FAR,
                           (0, 0, 1, 1), 'RotnePragerYamakawa'),
                          (nonbonded('NoCutoff', 1, 0), NEAR, (0, 0, 1, 1), 'RotnePragerYamakawa'),
                          (within((0, 1), (2, 3)), NEAR, (0, 0, 1, 1), 'RotnePragerYamakawa'),
                          (excluded('custom'), NEAR, (0, 0, 1, 1), 'RotnePragerYamakawa'),
                          (excluded('nonbonded'), NEAR, (0, 0, 1, 1), 'RotnePragerYamakawa'),
                          (bond, FAR, (0, 1, 0, 1), 'RotnePragerYamakawa'),])
def test_replicas_that_no_force_joins(capfd, add, positions, groups, model):
    integrator, _context = inBox('Unbounded', None, add, positions, groups, model)
    assert integrator.getEffects()['warnings'] == 'off: none' and capfd.readouterr().err == ''


# ---- FreeDraining in a periodic box --------------------------------------------------------------


@pytest.mark.parametrize('scheme', ['LangevinHI', 'EulerMaruyama', 'TrapezoidalSlip'])
def test_free_draining_in_a_periodic_box_is_that_in_unbounded_fluid(platform, scheme):
    """Multiblobs too, which must not feel their own images, in a box shorter than the body."""
    shape = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (2.5, 0, 0)])
    found = []
    for boundary in MobilityForce.Unbounded, MobilityForce.Periodic:
        system, integrator, fluid = openmm.System(), Integrator(300, 0.01), MobilityForce()
        integrator.setRandomNumberSeed(3)
        integrator.setScheme(getattr(integrator, scheme))
        system.setDefaultPeriodicBoxVectors((3, 0, 0), (0, 3, 0), (0, 0, 3))
        for sites in shape, shape[:1]:
            integrator.addRigidBody([system.addParticle(1) for _ in sites], 20, (9, 8, 7), sites)
            for _ in sites:
                fluid.addParticle(0.4)
        fluid.setModel(MobilityForce.FreeDraining)
        fluid.setBoundary(boundary)
        fluid.setBackgroundFlow((1, 2, 3), np.zeros((3, 3)))
        system.addForce(fluid)
        openmmrigidhi.app.bindBodies(system, integrator)
        context = openmm.Context(system, integrator, platform)
        context.setPositions(np.concatenate([shape, shape[:1] + 1]))
        integrator.step(20)
        found.append((fluid.getMobilityInContext(context), integrator.getBodyPositions()._value,
                      integrator.getBodyOrientations()))
        text = integrator.getEffects()['hydrodynamics']
        assert ('in a periodic box, where bodies feel neither others nor images, as if unbounded'
                in text) == (boundary == MobilityForce.Periodic)
        assert system.usesPeriodicBoundaryConditions() == (boundary == MobilityForce.Periodic)
        copy = MobilityForce.cast(openmm.XmlSerializer.clone(fluid))
        assert (copy.getModel(), copy.getBoundary()) == (MobilityForce.FreeDraining, boundary)
    for unbounded, inBox in zip(*found):
        assert np.array_equal(unbounded, inBox)


@pytest.mark.parametrize('boundary', ['Unbounded', 'Periodic'])
def test_flows_that_free_draining_does_not_have(boundary):
    system, integrator = scene(1)
    integrator.setScheme(integrator.EulerMaruyama)
    fluid = MobilityForce()
    fluid.addParticle(0.5)
    fluid.setModel(fluid.FreeDraining)
    fluid.setBoundary(getattr(fluid, boundary))
    fluid.setSinusoidalForceDensity(1, 0, 1, 1)
    system.addForce(fluid)
    with pytest.raises(openmm.OpenMMException,
                       match='under FreeDraining each body has a fluid of its own; use setModel'):
        openmm.Context(system, integrator, REFERENCE)
    fluid.setSinusoidalForceDensity(0, 0, 1, 1)
    fluid.setBackgroundFlow((0, 0, 0), ((0, 1, 0), (0, 0, 0), (0, 0, 0)))
    integrator = openmm.XmlSerializer.clone(integrator)
    if boundary == 'Unbounded':
        openmm.Context(system, integrator, REFERENCE)
    else:
        with pytest.raises(openmm.OpenMMException, match='a velocity gradient is not periodic'):
            openmm.Context(system, integrator, REFERENCE)
