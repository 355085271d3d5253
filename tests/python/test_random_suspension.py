"""Random suspensions, their structure, and what a periodic box takes off their diffusion."""
import re

import numpy as np
import openmm
import openmmrigidhi
import pytest
from openmm import unit
from openmmrigidhi import analysis, app

nm = unit.nanometer


def edgeOf(n, fraction, radius=1.0):
    return (4*np.pi/3*n/fraction)**(1/3)*radius


def gaps(x, radii, edges, periodic=(True, True, True)):
    """Distances between the surfaces of all pairs, nearest images."""
    x, edges = np.asarray(x), np.asarray(edges)*np.ones(3)
    d = x[:, None] - x
    d -= np.where(periodic, edges*np.round(d/edges), 0)
    i, j = np.triu_indices(len(x), 1)
    return np.linalg.norm(d, axis=-1)[i,
                                      j] - (radii*np.ones(len(x)))[i] - (radii*np.ones(len(x)))[j]


# ---- Places --------------------------------------------------------------------------------------


@pytest.mark.parametrize('n, fraction', [(1, 0.1), (2, 0.2), (5, 0.4), (64, 0.01), (64, 0.3),
                                         (64, 0.5)])
def test_spheres_do_not_overlap_and_are_in_the_box(n, fraction):
    edge = edgeOf(n, fraction)
    x = app.randomSuspension(n, 1.0, edge, seed=3)/nm
    assert x.shape == (n, 3) and np.all((0 <= x) & (x < edge))
    assert n == 1 or gaps(x, 1.0, edge).min() >= 0


def test_spheres_of_several_radii_keep_their_gap_in_a_box_of_three_edges():
    radii = np.array([0.5]*30 + [1.0]*10 + [2.0]*2)
    edges = np.array([7.0, 8.0, 9.0])
    x = app.randomSuspension(42, radii*nm, edges*nm, gap=0.5*unit.angstrom, seed=1)/nm
    assert gaps(x, radii, edges).min() >= 0.05 - 1e-12


def test_walls_keep_their_distance_and_are_not_periodic():
    edges = (9.0, 6.0, 9.0)
    x = app.randomSuspension(40, 1.0, edges, gap=0.1, wallAxis=1, seed=2)/nm
    assert x[:, 1].min() >= 1.1 - 1e-12 and x[:, 1].max() <= 4.9 + 1e-12
    assert gaps(x, 1.0, edges, (True, False, True)).min() >= 0.1 - 1e-12
    # Spheres fill the whole width.
    assert x[:, 1].min() < 1.6 and x[:, 1].max() > 4.4


@pytest.mark.parametrize('n, reach', [(12, 1.21), (42, 1.13), (162, 1.08), (642, 1.04),
                                      (2562, 1.02)])
def test_the_outer_radius_of_a_shell(n, reach):
    """Blobs reach beyond the sphere whose drag a shell has."""
    sites, radius = app.multiblobSphere(n, 2*nm)
    outer = app.outerRadius(sites, radius)
    assert outer/nm == pytest.approx(2*reach, abs=0.01)
    marked = np.vstack([sites/nm, (9, 0, 0)])
    assert app.outerRadius(marked, [radius/nm]*n + [0]) == outer


def test_shells_of_the_outer_radius_are_clear_of_walls():
    sites, radius = app.multiblobSphere(12, 1.0)
    x = app.randomSuspension(8, app.outerRadius(sites, radius), (9, 9, 6), gap=0.05, wallAxis=2)/nm
    blobs = x[:, None] + sites/nm
    assert blobs[:, :, 2].min() >= radius/nm and blobs[:, :, 2].max() <= 6 - radius/nm


@pytest.mark.parametrize('sites, radii, problem', [
    ([(0, 0, 0)], 0, r'outerRadius: radii: got \[0.0\]; a body needs a particle of radius above 0'),
    ([(0, 0, 0)], [1, 1], 'radii: got 2 for 1 sites'),
    ([(0, 0)], 1, r'sites: got an array of shape \(1, 2\)'),
])
def test_bodies_without_an_outer_radius(sites, radii, problem):
    with pytest.raises(ValueError, match=problem):
        app.outerRadius(sites, radii)


def test_an_edge_of_a_diameter_gives_a_monolayer():
    x = app.randomSuspension(60, 1.0, (18, 18, 2), wallAxis=2, seed=1)/nm
    assert np.allclose(x[:, 2], 1, rtol=0, atol=1e-12)
    assert gaps(x, 1.0, (18, 18, 2), (True, True, False)).min() >= 0


def test_a_seed_gives_the_same_places_and_another_one_others():
    one, same, other = (app.randomSuspension(20, 1, 10, seed=seed)/nm
                        for seed in (1, np.random.default_rng(1), 2))
    assert np.array_equal(one, same) and not np.allclose(one, other)


def contactRatio(frames, edge, fraction):
    """The mean of g from contact to 1.05 diameters, over g at contact by Carnahan and Starling,
    (1 - phi/2)/(1 - phi)^3. It is 0.98(6) at 0.15 and 0.85(2) at 0.45, in 30 runs of 5000 sweeps.
    """
    g = analysis.pairDistribution(frames, edge, maxDistance=2.1, numBins=21)
    assert np.all(g.values[:-1] == 0) and g.edges[-2]/nm == pytest.approx(2.0)
    return g.values[-1]*(1 - fraction)**3/(1 - fraction/2)


def test_dense_spheres_have_the_contact_value_of_the_hard_sphere_fluid():
    """Some 1160 pairs are counted, of an error of 3 %; the bound is three of these. Spheres that
    are only pushed apart have 1.7 of the value at contact."""
    edge = edgeOf(250, 0.45)
    frames = [app.randomSuspension(250, 1.0, edge, seed=seed) for seed in range(4)]
    assert abs(contactRatio(frames, edge, 0.45) - 0.85) < 0.09


def test_dilute_spheres_are_near_and_far_as_in_the_hard_sphere_fluid():
    """At contact some 430 pairs are counted, of an error of 5 %, and the expected value is known to
    6 %; the bound is below three of both. Spheres that are only pushed apart have none. For long
    waves Carnahan and Starling have S(0) = 0.268 at 0.15. Independent points would have 1, a
    lattice 0."""
    fraction, n = 0.15, 400
    edge = edgeOf(n, fraction)
    runs = [app.randomSuspension(n, 1.0, edge, seed=seed) for seed in range(8)]
    assert abs(contactRatio(runs, edge, fraction) - 0.98) < 0.18
    S = analysis.structureFactor(runs, edge, 3*np.pi/edge)
    expected = (1 - fraction)**4/((1 + 2*fraction)**2 + fraction**3*(fraction - 4))
    # 9 waves in 8 runs; a wave's power has the spread of its mean: 0.12 of it.
    assert S.numWaves[0] == 9 and S.values[0] == pytest.approx(expected*1.05, rel=0.4)


# ---- Structure -----------------------------------------------------------------------------------


def test_independent_points_have_no_structure():
    points = np.random.default_rng(1).random((40, 200, 3))*(5, 6, 7)
    g = analysis.pairDistribution(points, (5, 6, 7), numBins=10)
    assert g.distances[0]/nm == pytest.approx(0.125) and g.edges[-1]/nm == pytest.approx(2.5)
    assert np.all(np.abs(g.values - 1) < 5*g.errors) and g.errors.max() < 0.1
    S = analysis.structureFactor(points, (5, 6, 7), 3.0)
    assert np.all(np.abs(S.values - 1) < 5*S.errors) and S.errors.max() < 0.3


def test_a_lattice_has_its_neighbours_and_its_bragg_peak():
    places = np.stack(np.meshgrid(*[np.arange(4)]*3), axis=-1).reshape(-1, 3)*1.0
    g = analysis.pairDistribution(places, 4, maxDistance=1.6, numBins=16)
    shells = 4*np.pi/3*np.diff((np.arange(17)*0.1)**3)
    neighbours = g.values*shells*63/64
    # Distances 1 and sqrt(2) have 6 and 12 neighbours; 1.0 is the upper edge of a bin.
    assert neighbours[9] + neighbours[10] == pytest.approx(6)
    assert neighbours[14] == pytest.approx(12) and np.isnan(g.errors).all()
    S = analysis.structureFactor(places, 4, 2*np.pi, binWidth=0.1)
    k = S.waveNumbers/unit.nanometer**-1
    assert k[-1] == pytest.approx(2*np.pi) and np.allclose(S.values[:-1], 0, atol=1e-12)
    assert S.values[-1]*S.numWaves[-1] == pytest.approx(64*3)


def test_images_across_a_triclinic_box_are_neighbours():
    box = np.array([(4.0, 0, 0), (1.5, 4.0, 0), (0.5, -1.0, 4.0)])
    points = np.random.default_rng(2).random((30, 3)) @ box
    shifts = np.stack(np.meshgrid(*[np.arange(-2, 3)]*3), axis=-1).reshape(-1, 3) @ box
    d = np.linalg.norm(points[:, None, None] - points[:, None] - shifts, axis=-1)
    expected = np.histogram(d[d > 1e-9], bins=np.linspace(0, 3, 13))[0]
    wrapped = points + box[1] - 2*box[2]
    for places in (points, wrapped):
        g = analysis.pairDistribution(places, box, maxDistance=3, numBins=12)
        shells = 4*np.pi/3*np.diff(np.linspace(0, 3, 13)**3)
        assert np.allclose(g.values*shells*30*29/64, expected)


def pairsOfAtoms(a, b, box, apart, edges):
    """The pair distribution, pair by pair with 125 images, of those that apart chooses."""
    shifts = np.stack(np.meshgrid(*[np.arange(-2, 3)]*3), axis=-1).reshape(-1, 3)
    d = np.linalg.norm(a[:, None, None] - b[:, None] - shifts @ box, axis=-1)
    nearest = np.arange(len(shifts)) == d.argmin(axis=-1)[..., None]
    counted = d[apart[:, :, None] | ~nearest]
    volume, shells = np.linalg.det(box), 4*np.pi/3*np.diff(edges**3)
    return np.histogram(counted, bins=edges)[0]*volume/(shells*apart.sum())


def test_atoms_of_two_kinds_in_boxes_that_change():
    """Rigid molecules of three atoms, whose distances lie on edges of bins, cut by the box."""
    random = np.random.default_rng(5)
    molecule = np.repeat(np.arange(20), 3)
    isFirst = np.arange(60) % 3 == 0
    frames, boxes = [], []
    for scale in (1.0, 1.1, 0.95):
        box = np.array([(2.0, 0, 0), (0.5, 2.0, 0), (-0.4, 0.3, 2.0)])*scale
        along = random.normal(size=(20, 3))
        along *= 0.2/np.linalg.norm(along, axis=1)[:, None]
        centres = random.random((20, 3)) @ box
        atoms = (centres[:, None] + np.array([0, 1, -1])[:, None]*along[:, None]).reshape(-1, 3)
        frames.append(((atoms @ np.linalg.inv(box)) % 1) @ box)
        boxes.append(box)
    edges = np.linspace(0, 0.8, 9)
    for given in (boxes, [unit.Quantity([openmm.Vec3(*row) for row in box], nm) for box in boxes]):
        mixed = analysis.pairDistribution([frame[isFirst] for frame in frames], given, 0.8, 8,
                                          others=[frame[~isFirst]
                                                  for frame in frames], molecules=molecule[isFirst],
                                          otherMolecules=molecule[~isFirst])
        same = analysis.pairDistribution([frame[~isFirst] for frame in frames], given, 0.8, 8,
                                         molecules=molecule[~isFirst])
        for g, one, two in ((mixed, isFirst, ~isFirst), (same, ~isFirst, ~isFirst)):
            apart = molecule[one][:, None] != molecule[two]
            expected = np.mean([
                pairsOfAtoms(frame[one], frame[two], box, apart, edges)
                for frame, box in zip(frames, boxes)
            ], axis=0)
            assert np.allclose(g.values, expected, rtol=1e-6, atol=1e-9)
    # Without molecules all pairs count, also those at 0.2, which is on no edge of these bins.
    everything = analysis.pairDistribution(frames[0][isFirst], boxes[0], 0.8, 5,
                                           others=frames[0][~isFirst])
    expected = pairsOfAtoms(frames[0][isFirst], frames[0][~isFirst], boxes[0],
                            np.ones((20, 40), dtype=bool), np.linspace(0, 0.8, 6))
    assert np.allclose(everything.values, expected) and expected[1] > 2


def test_structure_in_a_layer():
    points = np.random.default_rng(3).random((60, 100, 3))*(8, 8, 0.1)
    g = analysis.pairDistribution(points, (8, 8, 50), numBins=8, normalAxis=2)
    assert np.all(np.abs(g.values - 1) < 5*g.errors) and g.edges[-1]/nm == pytest.approx(4)
    S = analysis.structureFactor(points, (8, 8, 50), 2.0, normalAxis=2)
    assert np.all(np.abs(S.values - 1) < 5*S.errors)
    assert S.waveNumbers[0]/unit.nanometer**-1 >= 2*np.pi/8*(1 - 1e-9)


# ---- Images --------------------------------------------------------------------------------------


def periodicMobility(edge, radius=1.0, viscosity=1.0):
    """The mobility of a sphere in a periodic box, about x, nm/ps over kJ/(mol nm)."""
    system, fluid = openmm.System(), openmmrigidhi.MobilityForce()
    integrator = openmmrigidhi.CustomRigidHIIntegrator(300, 0.01)
    integrator.setScheme('EulerMaruyama')
    app.addRigidMultiblob(system, integrator, fluid, [(0, 0, 0)], radius)
    fluid.setViscosity(viscosity)
    fluid.setBoundary('Periodic')
    system.addForce(fluid)
    system.setDefaultPeriodicBoxVectors((edge, 0, 0), (0, edge, 0), (0, 0, edge))
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName('Reference'))
    context.setPositions([(0, 0, 0)])
    return fluid.getMobilityInContext(context)[0, 0]


@pytest.mark.parametrize('edge', [5.0, 20.0])
def test_the_correction_restores_the_diffusion_of_a_single_sphere(edge):
    kT = unit.MOLAR_GAS_CONSTANT_R*300*unit.kelvin/unit.kilojoule_per_mole
    inBox, free = kT*periodicMobility(edge), kT/(6*np.pi)
    squareNm = nm**2/unit.picosecond
    correction = analysis.finiteSizeCorrection(300, 1.0, edge, radius=1.0)/squareNm
    assert inBox + correction == pytest.approx(free, rel=1e-6)
    # The first term alone leaves (4 pi/3)(a/L)^3.
    first = analysis.finiteSizeCorrection(300*unit.kelvin, 1.0, edge*nm)/squareNm
    assert inBox + first - free == pytest.approx(free*4*np.pi/3/edge**3, rel=1e-4)


def test_the_correction_of_a_suspension_is_that_of_the_literature():
    """Ladd (1990): 1.76 (phi/n)^(1/3) eta/eta_suspension of kT/(6 pi eta a), times S(0)."""
    fraction, n, radius, eta, ratio, S = 0.3, 108, 2.0, 535.0, 2.56, 0.1
    edge = edgeOf(n, fraction, radius)
    found = analysis.finiteSizeCorrection(300, ratio*eta, edge*np.eye(3)*nm, structureFactor=S)
    free = 300*unit.kelvin*unit.MOLAR_GAS_CONSTANT_R/unit.kilojoule_per_mole/(6*np.pi*eta*radius)
    assert found/(nm**2/unit.picosecond) == pytest.approx(1.7601*(fraction/n)**(1/3)/ratio*free*S,
                                                          rel=1e-4)
    pascals = analysis.finiteSizeCorrection(300, 1e-3*unit.pascal*unit.second, (5, 5, 5))
    assert pascals/analysis.finiteSizeCorrection(300, 602.214076, 5) == pytest.approx(1)


def coefficient(value, error, doubts=()):
    return analysis.DiffusionCoefficient(value*nm**2/unit.picosecond, error*nm**2/unit.picosecond,
                                         9, doubts)


def test_boxes_give_the_infinite_box_and_the_viscosity():
    """Mobilities of a sphere without their term of (a/L)^3 are a line in 1/L."""
    edges, kT = np.array([20.0, 30.0, 60.0]), 300*8.31446261815324e-3
    free = kT/(6*np.pi)
    values = [kT*periodicMobility(edge) - free*4*np.pi/3/edge**3 for edge in edges]
    found = analysis.infiniteBoxDiffusion([coefficient(each, 1e-3) for each in values],
                                          [20*nm, np.eye(3)*30, (60, 60, 60)], 300*unit.kelvin)
    assert found.value/(nm**2/unit.picosecond) == pytest.approx(free, rel=1e-6)
    assert found.viscosity/(unit.dalton/(nm*unit.picosecond)) == pytest.approx(1, rel=1e-5)
    assert found.isTrusted
    # Of two boxes, the line goes through both coefficients.
    two = analysis.infiniteBoxDiffusion([coefficient(each, 0.001) for each in values[:2]],
                                        edges[:2], 300)
    first = 2.837297*kT/(6*np.pi)/(two.viscosity/(unit.dalton/(nm*unit.picosecond)))/edges[0]
    assert two.value/(nm**2/unit.picosecond) - first == pytest.approx(values[0], rel=1e-9)


def test_errors_of_the_infinite_box_cover_its_scatter():
    """400 draws know the ratio of scatter and error to 1/sqrt(800) = 3.5 %."""
    rng, errors = np.random.default_rng(4), np.array([0.01, 0.02, 0.01])
    edges, kT, viscosity = np.array([2.0, 3.0, 6.0]), 300*8.31446261815324e-3, 500.0
    exact = 0.2 - 2.837297*kT/(6*np.pi*viscosity*edges)
    errors *= (exact[2] - exact[0])/2
    scatter = []
    for _ in range(400):
        found = analysis.infiniteBoxDiffusion(
            [coefficient(*each) for each in zip(exact + rng.normal(size=3)*errors, errors)], edges,
            300)
        eta = unit.dalton/(nm*unit.picosecond)
        scatter.append(
            [(found.value/(nm**2/unit.picosecond) - 0.2)/(found.error/(nm**2/unit.picosecond)),
             (found.viscosity/eta - viscosity)/(found.viscosityError/eta)])
    assert np.allclose(np.std(scatter, axis=0), 1, atol=4*0.035)


def test_boxes_that_give_no_line_are_doubted():
    kT = 300*8.31446261815324e-3
    with pytest.warns(UserWarning, match='lie on no line in 1/L .* leave out the smallest box'):
        found = analysis.infiniteBoxDiffusion(
            [coefficient(kT*periodicMobility(edge), 1e-4) for edge in (3, 6, 20)], (3, 6, 20), 300)
    assert not found.isTrusted
    flat = analysis.infiniteBoxDiffusion(
        [coefficient(0.1, 0.01), coefficient(0.105, 0.01, ('it bends',))], (2, 4), 300)
    assert flat.doubts[0] == 'the coefficient of the box of 4 nm: it bends'
    assert 'would show a viscosity: run longer' in flat.doubts[1] and not flat.isTrusted


@pytest.mark.parametrize(
    'coefficients, boxes, temperature, kind, message',
    [([coefficient(1, 0.1)]*2, (3, 3), 300, ValueError, 'two different edges at least'),
     ([coefficient(1, 0.1)]*2, (3, 4, 5), 300, ValueError, 'a box for each coefficient'),
     ([coefficient(1, 0.1), coefficient(1, 0.0)], (3, 4), 300, ValueError, 'an error above 0'),
     ([coefficient(1, 0.1)]*2, (3, (4, 4, 5)), 300, ValueError, 'that of a cube'),
     ([coefficient(1, 0.1)]*2, (3, 4), 0, ValueError, 'must be finite and positive'),
     ([1.0, 2.0], (3, 4), 300, TypeError, 'number 0 is a float; it must be a DiffusionCoeff'),])
def test_bad_coefficients_of_boxes_are_refused(coefficients, boxes, temperature, kind, message):
    with pytest.raises(kind, match=re.escape(message)):
        analysis.infiniteBoxDiffusion(coefficients, boxes, temperature)


# ---- Diffusion coefficients ----------------------------------------------------------------------


def walk():
    """Random walks of 200 bodies with D = 0.5, 0.5 and 0.125 nm^2/ps along x, y, z."""
    steps = np.random.default_rng(5).normal(size=(400, 200, 3))*(1, 1, 0.5)
    return np.cumsum(steps, axis=0)


def test_diffusion_is_divided_by_dimensions():
    msd = analysis.translationalMSD(walk(), None, 1*unit.picosecond, lags=[1, 2, 4], numBlocks=4)
    D = analysis.longTimeDiffusion(msd.isotropic, 1)
    assert abs(D.value/(nm**2/unit.picosecond) - 0.375) < 5*D.error/(nm**2/unit.picosecond)
    along = analysis.longTimeDiffusion(msd.lateral, 1)
    assert abs(along.value/(nm**2/unit.picosecond) - 0.5) < 5*along.error/(nm**2/unit.picosecond)
    thrice = analysis.longTimeDiffusion(msd.trace, 1)
    assert thrice.value/D.value == pytest.approx(3) and thrice.error/D.error == pytest.approx(3)


def test_origins_need_no_orientations():
    x = walk()[:50]
    q = np.broadcast_to((1.0, 0, 0, 0), x.shape[:2] + (4,))
    one, other = (analysis.translationalMSD(x, each, 1, (0, 0, 0), lags=[1, 3])
                  for each in (None, q))
    assert np.array_equal(one.blocks/nm**2, other.blocks/nm**2)
    for more in ({'trackingPoint': (0, 0, 1)}, {'bodyFrame': True}):
        with pytest.raises(ValueError, match='without orientations only the origins of bodies'):
            analysis.translationalMSD(x, None, 1, lags=[1], **more)


# ---- Bad input -----------------------------------------------------------------------------------


@pytest.mark.parametrize('arguments, message',
                         [((0, 1, 10), 'n: got 0 spheres; at least one is needed'),
                          ((3, -1, 10), 'each must be finite and not negative'),
                          ((3, 0, 10), 'a sphere needs a radius above 0'),
                          ((3, [1, 1], 10), 'got 2 for 3 sites'),
                          ((3, 1, 0), 'box: got the edges [0.0, 0.0, 0.0] nm; they must be finite'),
                          ((3, 1, (10, 10)), 'the shape must be (3,)'),
                          ((3, 1,
                            (10, 10, 1.5)), 'its edge along z is 1.5 nm; sphere 0 of radius 1 nm'),
                          ((3, 1, 10, -1), 'the distance between surfaces must be'),
                          ((3, 1, 10, 0, 3), 'the axis across the walls must'),
                          ((3, 1, 10, 0, None, -1), 'the number of Monte Carlo moves must'),])
def test_bad_suspensions_are_refused(arguments, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        app.randomSuspension(*arguments)


def test_more_spheres_than_fit_are_refused():
    with pytest.raises(ValueError, match=r'20 spheres.* fill 0.7 .*still overlap after'):
        app.randomSuspension(20, 1.0, edgeOf(20, 0.7))


@pytest.mark.parametrize(
    'arguments, message',
    [((0, 1.0, 5), 'temperature: got 0.0; this number must be finite'),
     ((300, -1, 5), 'viscosity: got -1.0; this number must be finite'),
     ((300, 1, 5, 0), 'radius: got 0.0; this number must be finite'),
     ((300, 1, 5, None, 0), 'structureFactor: got 0.0; this number must be finite'),
     ((300, 1, (5, 5, 6)), 'the sum over images is that of a cube'),
     ((300, 1, 0), 'the sum over images is that of a cube'),
     ((300, 1, np.ones((9, 3, 3))), 'got the boxes of 9 frames; it must be one cube'),])
def test_bad_corrections_are_refused(arguments, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        analysis.finiteSizeCorrection(*arguments)


POINTS = np.random.default_rng(1).random((3, 5, 3))


@pytest.mark.parametrize('call, message', [
    (lambda: analysis.pairDistribution(POINTS[:, :1], 1),
     'got 1 without a pair; pairs need at least two'),
    (lambda: analysis.pairDistribution(POINTS, -1), 'it must be the edge of a cube'),
    (lambda: analysis.pairDistribution(POINTS, (1, 1)), 'it must be the edge of a cube'),
    (lambda: analysis.pairDistribution(POINTS, 1, 1.1), 'at most the smallest width of the box, 1'),
    (lambda: analysis.pairDistribution(POINTS, 1, numBins=0), 'got 0 bins; at least one is needed'),
    (lambda: analysis.pairDistribution(POINTS, 1, normalAxis=4), 'the axis across the layer must'),
    (lambda: analysis.pairDistribution(POINTS, [(1, 0, 0), (0, 1, 0), (0.2, 0, 1)], normalAxis=2),
     'its vector along axis 2 is not at right angles'),
    (lambda: analysis.pairDistribution(POINTS, 1, molecules=[0]*5), 'got 5 without a pair'),
    (lambda: analysis.pairDistribution(POINTS, 1, molecules=[0, 1]),
     'got 2 numbers for 5 positions: give the molecule of each'),
    (lambda: analysis.pairDistribution(POINTS, 1, others=POINTS[:2]),
     'got 2 frames, and positions'),
    (lambda: analysis.pairDistribution(POINTS, 1, others=POINTS, molecules=range(5)),
     'otherMolecules: not given, but molecules is'),
    (lambda: analysis.pairDistribution(POINTS, 1, otherMolecules=range(5)), 'given without others'),
    (lambda: analysis.pairDistribution(POINTS, np.ones((2, 3, 3))), 'got the vectors of 2 frames'),
    (lambda: analysis.structureFactor(POINTS, 1, -1), 'a wave number must be finite'),
    (lambda: analysis.structureFactor(POINTS, 1, 1), 'the longest wave of this'),
    (lambda: analysis.structureFactor(POINTS[0, 0], 1, 9), 'a trajectory must have the'),
])
def test_bad_structures_are_refused(call, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        call()
