"""Periodic fluids on a grid in Python: steps of every scheme, products against lattice sums, boxes,
saved states, and refused input."""
import copy

import numpy as np
import openmm
import pytest

from openmmrigidhi import CustomRigidHIIntegrator, MobilityForce, app

OVERDAMPED = ('EulerMaruyama', 'FixmanMidpoint', 'RandomFiniteDifference', 'TractionEulerMaruyama',
              'TrapezoidalSlip', 'DriftCorrectorFD', 'DriftCorrectorRFD')
SCHEMES = (*OVERDAMPED, 'LangevinHI')
MODELS = ('ForceCoupling', 'RotnePragerYamakawa')
KT = 2.494338785445972  # of 300 K, kJ/mol
BOX = (8, 7, 9)


class Scene:
    """Two spheres, two multiblobs and a free particle of different radii, across faces of the box
    and outside of it, under forces, with viscosity 1."""
    def __init__(self, platform, scheme='FixmanMidpoint', solver=MobilityForce.MatrixFree,
                 tolerance=1e-3, temperature=0, stepSize=0.05, box=BOX, model='ForceCoupling'):
        self.system, self.fluid, self.integrator = openmm.System(), MobilityForce(
        ), CustomRigidHIIntegrator(temperature, stepSize)
        self.system.setDefaultPeriodicBoxVectors(*np.diag(box).astype(float))
        self.integrator.setScheme(getattr(CustomRigidHIIntegrator, scheme))
        self.integrator.setRandomNumberSeed(3)
        self.fluid.setViscosity(1)
        self.fluid.setModel(getattr(MobilityForce, model))
        self.fluid.setBoundary(MobilityForce.Periodic)
        self.fluid.setSolver(solver)
        self.fluid.setSolverTolerance(tolerance)
        mass = 1 if scheme == 'LangevinHI' else 0
        positions = [(0, 0, 0), (2.1, 0.3, 8.8)]
        for radius in (1, 0.8):
            self.integrator.addRigidBody([self.system.addParticle(mass)], mass, (0.4*mass,)*3,
                                         [(0, 0, 0)])
            self.fluid.addParticle(radius)
        sites = np.array([(0.3, 0.6, 0), (-0.6, 0, 0), (0.3, -0.6, 0)])
        moments = mass*np.array([0.72, 0.54, 1.26])
        for place in ((-1, 2.5, 2.4), (3.5, -2.5, 0.4)):
            app.addRigidMultiblob(self.system, self.integrator, self.fluid, sites, 0.5, 3*mass,
                                  moments)
            positions.extend(sites + place)
        self.system.addParticle(mass)
        self.fluid.addParticle(0.6)
        positions.append((4, 1, 5))
        pull = openmm.CustomExternalForce('0.7*x-0.4*y+0.2*z*z')
        for particle in range(len(positions)):
            pull.addParticle(particle)
        self.system.addForce(pull)
        self.system.addForce(self.fluid)
        app.bindBodies(self.system, self.integrator)
        self.context = openmm.Context(self.system, self.integrator, platform)
        self.context.setPositions(positions)

    def positions(self):
        return self.context.getState(getPositions=True).getPositions(asNumpy=True)._value

    def moved(self, steps):
        """The displacements of all particles in some steps."""
        before = self.positions()
        self.integrator.step(steps)
        return self.positions() - before


def spheres(platform, solver, tolerance=1e-3, count=6, radii=(1, 0.7), scheme='FixmanMidpoint',
            temperature=0, stepSize=0.01, side=7.0, model='ForceCoupling'):
    """Spheres at random, without overlap of spheres of radius 1, viscosity 1: (Context,
    MobilityForce, integrator)."""
    rng, places = np.random.default_rng(5), []
    while len(places) < count:
        place = rng.uniform(-side, 2*side, 3)
        separations = [(place - other + side/2) % side - side/2 for other in places]
        if all(np.linalg.norm(r) > 2 for r in separations):
            places.append(place)
    system, fluid, integrator = openmm.System(), MobilityForce(), CustomRigidHIIntegrator(
        temperature, stepSize)
    system.setDefaultPeriodicBoxVectors(*side*np.eye(3))
    integrator.setScheme(getattr(CustomRigidHIIntegrator, scheme))
    integrator.setRandomNumberSeed(7)
    for k in range(count):
        integrator.addRigidBody([system.addParticle(0)], 0, (0, 0, 0), [(0, 0, 0)])
        fluid.addParticle(radii[k % len(radii)])
    fluid.setViscosity(1)
    fluid.setModel(getattr(MobilityForce, model))
    fluid.setBoundary(MobilityForce.Periodic)
    fluid.setSolver(solver)
    fluid.setSolverTolerance(tolerance)
    system.addForce(fluid)
    context = openmm.Context(system, integrator, platform)
    context.setPositions(places)
    return context, fluid, integrator


def columns(context, fluid, blobs=False):
    """The mobility matrix, product by product."""
    n = context.getSystem().getNumParticles()
    if blobs:
        return np.array([
            fluid.applyBlobMobilityInContext(context, row.reshape(n, 3))._value.ravel()
            for row in np.eye(3*n)
        ]).T
    return np.array(
        [fluid.applyMobilityInContext(context, row.reshape(n, 6)).ravel() for row in np.eye(6*n)]).T


def errorOf(M, exact):
    """The 2-norm of the error, with entries divided by the roots of the particles' own mobilities.
    So velocities are measured by own mobilities, and forces by own frictions."""
    root = 1/np.sqrt(np.diag(exact))
    return np.linalg.norm(root[:, None]*(M - exact)*root, 2)


# ---- Products ------------------------------------------------------------------------------------


@pytest.mark.parametrize('model', MODELS)
@pytest.mark.parametrize('tolerance', (1e-3, 1e-4, 1e-6, 1e-8))
def test_products_are_lattice_sums_to_the_tolerance(platform, tolerance, model):
    dense, grid = spheres(platform, MobilityForce.Dense,
                          model=model), spheres(platform, MobilityForce.MatrixFree, tolerance,
                                                model=model)
    assert ' on a grid of ' in grid[2].getEffects(
    )['hydrodynamics'] and ' on a grid' not in dense[2].getEffects()['hydrodynamics']
    for blobs in (False, True):
        M, exact = (columns(context, fluid, blobs) for context, fluid, _ in (grid, dense))
        error = errorOf(M, exact)
        print(f'{tolerance:g}: {error:.1e}, asymmetry {np.abs(M - M.T).max()/M.max():.1e}')
        # The fluid is on a grid that is no finer than it has to be. With forces alone the error is
        # smaller still, because torques need a finer grid.
        assert error < tolerance and (blobs or error > tolerance/100)
        assert np.abs(M - M.T).max() < 1e-14*M.max()
    assert grid[2].getStepStatistics()['seconds_fft'] > 0


@pytest.mark.parametrize('spacing', (0.35, 0.27, 0.22))
def test_a_spacing_means_the_tolerance_that_is_described(platform, spacing):
    exact = columns(*spheres(platform, MobilityForce.Dense)[:2])
    context, fluid, integrator = spheres(platform, MobilityForce.MatrixFree, 0.1)
    fluid.setGridSpacing(spacing)
    fluid.updateParametersInContext(context)
    described = integrator.getEffects()['hydrodynamics']
    tolerance = float(described.split('whose products have the tolerance ')[1].split(',')[0])
    nodes = int(described.split('on a grid of ')[1].split(' ')[0])
    assert 7/nodes <= spacing < 7/nodes*1.15
    error = errorOf(columns(context, fluid), exact)
    print(f'{spacing}: {error:.1e}, described {tolerance:g}')
    assert tolerance/1000 < error < tolerance


# ---- Steps ---------------------------------------------------------------------------------------


@pytest.mark.parametrize('model', MODELS)
@pytest.mark.parametrize('scheme', SCHEMES)
def test_without_temperature_it_is_the_trajectory_of_lattice_sums(platform, scheme, model):
    exact = Scene(platform, scheme, MobilityForce.Dense, model=model).moved(3)
    assert np.linalg.norm(exact, axis=1).min() > 1e-3
    errors = []
    for tolerance in (1e-3, 1e-6):
        scene = Scene(platform, scheme, tolerance=tolerance, model=model)
        moved = scene.moved(3)
        assert ' on a grid of ' in scene.integrator.getEffects(
        )['hydrodynamics'] and scene.integrator.getStepStatistics()['randomNumbers'] == 0
        errors.append(np.linalg.norm(moved - exact)/np.linalg.norm(exact))
        # The product and the solve each have one tolerance. Momenta have five.
        assert errors[-1] < (5 if scheme == 'LangevinHI' else 2)*tolerance
    print(f'{scheme}: {errors}')
    assert errors[1] < errors[0]/100


@pytest.mark.parametrize('model', MODELS)
@pytest.mark.parametrize('scheme', OVERDAMPED)
def test_displacements_have_the_covariance_of_the_mobility(platform, scheme, model):
    """Each displacement of spheres that hardly move is drawn with the covariance 2 kT h N. Weighted
    by the inverse of this matrix, its square is a chi squared variable of 18 degrees."""
    count, steps, stepSize = 6, 120, 1e-6
    context, fluid, integrator = spheres(platform, MobilityForce.MatrixFree, 1e-2, count,
                                         scheme=scheme, temperature=300, stepSize=stepSize,
                                         model=model)
    rows = [6*k + axis for k in range(count) for axis in range(3)]
    N = fluid.getMobilityInContext(context)[np.ix_(rows, rows)]
    inverse = np.linalg.inv(2*KT*stepSize*N)
    total, before = 0.0, integrator.getBodyPositions()._value
    for _ in range(steps):
        integrator.step(1)
        after = integrator.getBodyPositions()._value
        d = (after - before).ravel()
        total, before = total + d @ inverse @ d, after
    degrees = steps*len(rows)
    z = (total - degrees)/np.sqrt(2*degrees)
    print(f'{scheme}: z = {z:.2f}')
    # With 2160 squares the bound is 12 % of all noise. Errors of the square roots are 2 tolerances.
    # A false alarm has a probability of 1 in 15000.
    assert abs(z) < 4


@pytest.mark.parametrize('tolerance, difference', [(1e-3, 1e-5), (1e-5, 1e-8)])
@pytest.mark.parametrize('model', MODELS)
@pytest.mark.parametrize('scheme', SCHEMES)
def test_with_temperature_both_platforms_take_the_same_finite_steps(scheme, tolerance, difference,
                                                                    model):
    # Iterations on CPU multiply in single precision, with an error of 1e-6 that they and the
    # preconditioner make a few times larger. At a tolerance of 1e-5 exact products between the
    # iterations remove this error.
    ends = []
    for name in ('Reference', 'CPU'):
        scene = Scene(openmm.Platform.getPlatformByName(name), scheme, temperature=300,
                      stepSize=1e-3, tolerance=tolerance, model=model)
        ends.append(scene.moved(2))
        assert scene.integrator.getStepStatistics()['randomNumbers'] > 0
    assert np.isfinite(ends).all() and np.linalg.norm(ends[0], axis=1).min() > 1e-4
    assert np.abs(ends[1] - ends[0]).max() < difference*np.abs(ends[0]).max()


# ---- Boxes, saving -------------------------------------------------------------------------------


@pytest.mark.parametrize('scheme', SCHEMES)
def test_the_box_of_a_step_is_that_of_the_context(platform, scheme):
    changed, always = Scene(platform, scheme), Scene(platform, scheme, box=(6, 7.5, 10))
    changed.fluid.getMobilityInContext(changed.context)  # the grid of the first box is there
    changed.context.setPeriodicBoxVectors((6, 0, 0), (0, 7.5, 0), (0, 0, 10))
    assert np.array_equal(changed.moved(2), always.moved(2))
    same = Scene(platform, scheme)
    assert np.abs(same.moved(2) - always.moved(2)).max() > 1e-5


@pytest.mark.parametrize('scheme', ('DriftCorrectorFD', 'TrapezoidalSlip', 'LangevinHI'))
def test_a_copy_from_xml_and_a_saved_state_go_on_alike(platform, scheme):
    """The System and the integrator from XML, a State from XML: as the uninterrupted run, to the
    last bit."""
    once = Scene(platform, scheme, temperature=300, stepSize=1e-3)
    once.fluid.setGridSpacing(0.3)
    once.fluid.updateParametersInContext(once.context)
    once.integrator.step(2)
    state = openmm.XmlSerializer.serialize(
        once.context.getState(getPositions=True, getVelocities=True, getParameters=True,
                              getIntegratorParameters=True))
    system = openmm.XmlSerializer.deserialize(openmm.XmlSerializer.serialize(once.system))
    integrator = CustomRigidHIIntegrator.cast(openmm.XmlSerializer.clone(once.integrator))
    fluid = MobilityForce.cast(system.getForce(1))
    assert fluid.getGridSpacing()._value == 0.3 and fluid.getSolver(
    ) == MobilityForce.MatrixFree and fluid.getModel() == MobilityForce.ForceCoupling
    context = openmm.Context(system, integrator, platform)
    context.setState(openmm.XmlSerializer.deserialize(state))
    assert 'on a grid of 28 x 24 x 30 nodes' in integrator.getEffects()['hydrodynamics']
    once.integrator.step(2)
    integrator.step(2)
    assert np.array_equal(
        context.getState(getPositions=True).getPositions(asNumpy=True)._value, once.positions())


def test_copies_of_the_force_keep_the_grid():
    fluid = MobilityForce()
    fluid.setGridSpacing(0.3)
    fluid.setSolverTolerance(1e-5)
    for other in (copy.deepcopy(fluid), openmm.XmlSerializer.clone(fluid)):
        other = MobilityForce.cast(other)
        assert other.getGridSpacing()._value == 0.3 and other.getSolverTolerance() == 1e-5


def test_triclinic_boxes_have_the_mobility_of_lattice_sums(platform):
    scene = Scene(platform)
    scene.context.setPeriodicBoxVectors((8, 0, 0), (1, 7, 0), (0, 0, 9))
    scene.integrator.step(1)
    onGrid = scene.fluid.getMobilityInContext(scene.context)
    scene.fluid.setSolver(MobilityForce.Dense)
    scene.fluid.updateParametersInContext(scene.context)
    exact = scene.fluid.getMobilityInContext(scene.context)
    tolerance = scene.fluid.getSolverTolerance()
    assert np.linalg.norm(onGrid - exact) < tolerance*np.linalg.norm(exact)
    assert not np.array_equal(onGrid, exact)


# ---- What is refused -----------------------------------------------------------------------------


@pytest.mark.parametrize('spacing', (0.6, 2, 100))
def test_a_spacing_that_is_too_coarse_is_refused(platform, spacing):
    scene = Scene(platform)
    scene.fluid.setGridSpacing(spacing)
    with pytest.raises(
            openmm.OpenMMException, match=
            fr'the spacing is {spacing} nm, too coarse for the smallest particle of .*give at most '
            fr'0\.521 nm, or 0'):
        scene.fluid.updateParametersInContext(scene.context)
    # The Context goes on with its former grid, and the spacing that the message names is accepted.
    scene.integrator.step(1)
    scene.fluid.setGridSpacing(0.521)
    scene.fluid.updateParametersInContext(scene.context)
    scene.integrator.step(1)


def test_a_spacing_far_below_rounding_is_one_at_rounding(platform):
    exact = columns(*spheres(platform, MobilityForce.Dense, count=2, side=4.2)[:2])
    context, fluid, integrator = spheres(platform, MobilityForce.MatrixFree, count=2, side=4.2)
    fluid.setGridSpacing(0.05)
    fluid.updateParametersInContext(context)
    assert 'whose products have the tolerance 1e-14' in integrator.getEffects()['hydrodynamics']
    # In sums over 84^3 nodes and their transforms the rounding error is 1e-12.
    assert errorOf(columns(context, fluid), exact) < 1e-11


@pytest.mark.parametrize('box', ((1.9, 7, 9), (8, 7, 1.5)))
def test_a_box_smaller_than_a_particle_is_refused(platform, box):
    scene = Scene(platform)
    scene.context.setPeriodicBoxVectors(*np.diag(box).astype(float))
    with pytest.raises(
            openmm.OpenMMException, match=
            'body 0 has the length 2 nm, hydrodynamic radii included, and would overlap its own '
            'image'):
        scene.integrator.step(1)


def test_grids_that_no_machine_has_are_refused(platform):
    context, fluid, integrator = spheres(platform, MobilityForce.MatrixFree, 1e-10, 1,
                                         radii=(0.001,))
    context.setPeriodicBoxVectors(*1000*np.eye(3))
    with pytest.raises(
            openmm.OpenMMException, match=
            'nodes along an edge of 1000 nm, but must have fewer than .*raise setSolverTolerance'):
        fluid.applyMobilityInContext(context, np.zeros((1, 6)))


def test_wrong_settings():
    fluid = MobilityForce()
    for spacing in ('fine', 1*openmm.unit.kelvin, None):
        with pytest.raises(TypeError, match='setGridSpacing: spacing: got'):
            fluid.setGridSpacing(spacing)
    assert fluid.getGridSpacing()._value == 0


def test_wrong_forces_for_products(platform):
    context, fluid, _ = spheres(platform, MobilityForce.MatrixFree, count=2)
    for apply, width in ((fluid.applyMobilityInContext, 6), (fluid.applyBlobMobilityInContext, 3)):
        with pytest.raises(ValueError, match=fr'the shape must be \(n, {width}\)'):
            apply(context, np.zeros((2, 4)))
        with pytest.raises(openmm.OpenMMException):
            apply(context, np.full((2, width), np.nan))
        with pytest.raises(openmm.OpenMMException):
            apply(context, np.zeros((3, width)))
