"""The studies of validation/sheared: shortened scripts run, pages have the tables of the results,
and a few of the numbers are found again."""
import importlib
import json
import pathlib
import subprocess
import sys

import numpy as np
import pytest
from scipy import special

FOLDER = pathlib.Path(__file__).resolve().parents[2]/'validation'/'sheared'
STUDIES = ('tilted_arrays', 'steady_shear', 'rollers', 'settling')


@pytest.fixture
def study(monkeypatch):
    """A function that imports a script."""
    for folder in ('confined', 'common', 'sheared'):
        monkeypatch.syspath_prepend(str(FOLDER.parent/folder))
    return importlib.import_module


def results(name):
    return json.loads((FOLDER/'results'/f'{name}.json').read_text())


@pytest.mark.parametrize('name', STUDIES)
def test_the_page_has_the_tables_of_the_results(study, name):
    module, data = study(name), results(name)
    page = (FOLDER/'README.md').read_text(encoding='utf-8')
    tables = '\n'.join(module.tables(data)).split('\n\n')
    assert len(tables) > 0 and all(len(table.splitlines()) > 2 for table in tables)
    for table in tables:
        assert table.strip() in page, table
    assert data['provenance']['arguments']['quick'] == 'False'
    assert {'processor', 'openmm', 'commit', 'plugin_sha256'} <= set(data['provenance'])


@pytest.mark.scripts
@pytest.mark.parametrize('name', STUDIES)
def test_shortened_scripts_run(name, tmp_path):
    finished = subprocess.run(
        [sys.executable,
         str(FOLDER/f'{name}.py'), '--quick', '--fresh', '--output',
         str(tmp_path)], capture_output=True, text=True, timeout=600)
    assert finished.returncode == 0, finished.stdout + finished.stderr
    assert (tmp_path/f'{name}.png').stat().st_size > 5000
    assert json.loads((tmp_path/f'{name}.json').read_text())['provenance']['arguments']['quick']


# ---- Pictures of the guide -----------------------------------------------------------------------


@pytest.mark.parametrize('toWall', [False, True])
def test_the_picture_of_lubrication_is_right(study, toWall):
    pictures = study('guide_pictures')
    for gap in (1e-4, 0.03, 1):
        exact = pictures.exactMobility(gap, toWall)
        found = {name: pictures.mobilityOfApproach(gap, toWall, name) for name in pictures.STYLES}
        assert found['On'] == pytest.approx(exact, rel=1e-6)
        assert found['Off'] > 1.05*exact
    if toWall:  # Brenner's own value at alpha = 1
        assert 1/pictures.exactMobility(np.cosh(1) - 1, toWall) == pytest.approx(3.0361, abs=1e-4)


def test_the_picture_of_a_box_has_one_flow_through_the_flip(study):
    pictures = study('guide_pictures')
    panels = pictures.shearedPlaces()
    assert [tilt for *_, tilt in panels] == pytest.approx([0, 0.45, -0.45], abs=1e-12)
    steps = np.diff(panels[-1][1], axis=1)
    assert np.abs(np.diff(steps, axis=1)).max() < 2e-3  # without a jump


@pytest.mark.scripts
def test_pictures_of_the_guide_are_drawn(tmp_path):
    subprocess.run(
        [sys.executable, str(FOLDER/'guide_pictures.py'), '--output',
         str(tmp_path)], check=True, timeout=600)
    for name in ('lubrication', 'tilting_box'):
        assert (tmp_path/f'{name}.png').stat().st_size > 5000


# ---- Tilted arrays -------------------------------------------------------------------------------


def test_numbers_of_tilted_arrays(study):
    tilted, data = study('tilted_arrays'), results('tilted_arrays')
    for name in ('FTS', 'FTS + pairs'):
        again = tilted.measure(0.216, 0.5, name)
        assert again['viscosity'] == pytest.approx(tilted.at(data, 0.216, name, 0.5), rel=1e-8)
        assert again['spin'] == pytest.approx(tilted.at(data, 0.216, name, 0.5, 'spin'), rel=1e-5)


def test_what_the_page_says_of_tilted_arrays(study):
    tilted, data = study('tilted_arrays'), results('tilted_arrays')

    def errors(name, fraction):
        return [
            tilted.at(data, fraction, name, tilt)/exact - 1
            for tilt, exact in tilted.EXACT[fraction].items()
        ]

    assert max(np.abs(errors('FTS + pairs', 0.064))) < 4e-4
    assert 0.008 < min(errors('FTS + pairs', 0.216)) < max(errors('FTS + pairs', 0.216)) < 0.014
    assert 0.06 < min(errors('FTS + pairs', 0.45)) < max(errors('FTS + pairs', 0.45)) < 0.085
    assert -0.22 < min(errors('FTS', 0.45)) < max(errors('FTS', 0.45)) < -0.1
    # Single spheres of other models do not resist strain, with lubrication or without.
    for name in ('RPY', 'RPY + pairs', 'force coupling'):
        rows = [each for each in data['rows'] if each['model'] == name]
        assert len(rows) == 3 and np.allclose([each['viscosity'] for each in rows], 1, atol=1e-10)


# ---- Rollers and monolayers ----------------------------------------------------------------------


def test_collocation_of_two_spheres_above_a_wall(study):
    """Far apart each sphere is that of the wall; far up the pair is that of unbounded fluid."""
    collocation, rollers = study('collocation'), study('rollers')
    x = np.random.default_rng(1).normal(size=(6, 3))
    assert abs(collocation.blake(x*(1, 1, 0), np.abs(x) + 0.3)).max() < 1e-13
    R = collocation.frictionOfPair(1000, 1.5, 150)
    assert abs(R - R.T).max() < 1e-4
    one = rollers.sceneOf('RPY + lubrication', 'NoSlipWall', *rollers.sphere(1), 1)
    one.place(np.array([(0, 0, 1.5)]))
    alone = np.linalg.inv(one.mobility().reshape(6, 6))
    assert np.allclose(R[:6, :6], alone, atol=2e-3)
    R = collocation.frictionOfPair(3, 3000, 150)
    pair = rollers.Scene('Unbounded', *rollers.sphere(1), 2, model='StokesianDynamics')
    pair.place(np.array([(0, 0, 0), (3, 0, 0)]))
    assert np.allclose(R, np.linalg.inv(pair.mobility().reshape(12, 12)), atol=2e-3)


def test_numbers_of_rollers(study):
    rollers, data = study('rollers'), results('rollers')
    kept = next(each for each in data['pairs'] if (each['gap'], each['wall']) == (1, 1))
    again = rollers.pair((1, 1, (100, 150)), None)
    for name in ('exact', *rollers.MODELS):
        for key, value in kept['rolling'][name].items():
            assert again['rolling'][name][key] == pytest.approx(value, abs=2e-5), (name, key)
    for name in rollers.MODELS:
        assert again['error'][name] == pytest.approx(kept['error'][name], abs=2e-3)


def test_what_the_page_says_of_walls(study):
    rollers, data = study('rollers'), results('rollers')
    errors = {(each['gap'], each['wall']): each['error'] for each in data['pairs']}
    # Largest errors of frictions as another collocation has them.
    others = {
        (1, 1): (0.083, 0.072, 0.017),
        (1, 0.2): (0.49, 0.073, 0.030),
        (0.2, 1): (0.45, 0.44, 0.044),
        (0.2, 0.2): (0.51, 0.40, 0.11),
        (0.1, 0.1): (0.71, 0.55, 0.11)
    }
    assert set(others) == set(rollers.CORNERS)
    for corner, wanted in others.items():
        for name, value in zip(rollers.MODELS, wanted):
            uncertain = 0.01 + errors[corner]['fewer points']
            assert errors[corner][name] == pytest.approx(value, rel=0.02, abs=uncertain)
    for key in ('self', 'friction'):
        for height in rollers.HEIGHTS:
            runs = [run for run in data['layers'] if run['height'] == height and run['blobs'] == 1]
            last = {run['model']: run[key] for run in runs if run['fraction'] == 0.6}
            if key == 'self':
                assert last['RPY + lubrication'] < 0.6*last['RPY, BestKnown'] < last['RPY']
            else:
                assert last['RPY + lubrication'] > 1.5*last['RPY, BestKnown'] > last['RPY']


# ---- Settling ------------------------------------------------------------------------------------


def test_numbers_of_settling(study):
    settling, data = study('settling'), results('settling')
    for each in data['arrays']:
        if each['fraction'] in (0.064, 0.45):
            for name in ('FTS + pairs', 'RPY + pairs', 'force coupling + pairs'):
                again = settling.collective(settling.MODELS[name], np.zeros((1, 3)),
                                            settling.edgeOf(1, each['fraction']))
                assert again == pytest.approx(each['velocity'][name], rel=1e-8)


def test_dense_suspensions_settle_twice_too_fast():
    """As the page says plainly, of all models of single spheres but force coupling."""
    data = results('settling')
    for rows, key in ((data['arrays'], 'exact'), (data['random'], 'fit')):
        last = next(each for each in rows if each['fraction'] == 0.45)
        for name in ('FTS + pairs', 'RPY', 'RPY + pairs'):
            assert 1.9 < np.ravel(last['velocity'][name])[0]/last[key] < 3, (key, name)
    for each in data['random']:
        shells = each['velocity']['shells of 42'][0]/each['fit']
        assert shells == pytest.approx(1, abs=0.05 if each['fraction'] < 0.4 else 0.25)
    dilute = next(each for each in data['random'] if each['fraction'] == 0.1)
    for name in ('FTS + pairs', 'RPY + pairs'):
        assert dilute['velocity'][name][0] == pytest.approx(dilute['fit'], rel=0.1)


# ---- Steady shear --------------------------------------------------------------------------------


def test_fits_of_hard_spheres(study):
    """The formulas have their dilute limits, and values of other formulas in dense suspensions."""
    hard, shear = study('hardspheres'), study('steady_shear')
    phi = 1e-4
    assert (hard.fits(phi)['viscosity'] - 1)/phi == pytest.approx(2.5, rel=1e-3)
    assert (shear.zeroShear(phi) - 1)/phi == pytest.approx(2.5, rel=1e-3)
    for phi in shear.FRACTIONS:
        # Quemada's formula, with random close packing at 0.63.
        assert shear.zeroShear(phi) == pytest.approx((1 - phi/0.63)**-2, rel=0.2)


def test_neighbours_are_counted_with_images_of_a_tilted_box(study):
    shear = study('steady_shear')
    box = np.array([(6.0, 0, 0), (2.9, 6, 0), (0, 0, 6)])
    x = np.array([(0.1, 0.1, 0.1), (0.1, 2.106, 0.1), (0, 0, 0)])
    x[2] = x[0] + box[1] + np.array([0, -0.01, 2.003]) - 3*box[0]
    near = np.array(shear.pairsNearer(x, box))*3/2
    # Gaps of 0.006, and of sqrt(2.003^2 + 0.01^2) - 2 = 0.00302.
    assert np.array_equal(near, np.searchsorted([0.00302, 0.006], shear.EDGES))


def test_configurations_in_equilibrium_have_the_neighbours_of_theory(study):
    hard, shear = study('hardspheres'), study('steady_shear')
    counts = []
    for seed in range(6):
        x, edge = hard.hardSpheres(32, 0.45, np.random.default_rng(seed))
        counts.append(shear.pairsNearer(x, edge*np.eye(3)))
    mean, error = np.mean(counts, axis=0), np.std(counts, axis=0, ddof=1)/6**0.5
    wanted = np.array(shear.equilibrium(0.45, isRepelled=False))
    # At gaps below 0.05 and 0.1; 32 spheres have a few per cent more or fewer than many.
    assert (abs(mean - wanted) < 4*error + 0.05*wanted)[4:].all()


def test_the_effective_diameter_is_that_of_the_exponential(study):
    shear = study('steady_shear')
    # The integral of 1 - exp(-A exp(-x)) over x from 0 on.
    known = np.log(shear.REPULSION) + np.euler_gamma + special.exp1(shear.REPULSION)
    assert shear.effectiveDiameter() == pytest.approx(2 + shear.RANGE*known, abs=1e-6)
    repelled, hard = shear.equilibrium(0.3), shear.equilibrium(0.3, isRepelled=False)
    assert repelled[0] < 0.1*hard[0] and 0.6 < repelled[-1]/hard[-1] < 0.9


def test_half_the_step_gives_the_same(study):
    shear, whole, half = (study('steady_shear'), results('steady_shear'),
                          results('steady_shear_halved'))
    page = (FOLDER/'README.md').read_text(encoding='utf-8')
    assert '\n'.join(shear.tables(half)).split('\n\n')[0] in page
    assert [each['peclet'] for each in half['runs']] == list(shear.HALVED[1])
    for each in half['runs']:
        same = next(other for other in whole['runs']
                    if all(other[key] == each[key] for key in ('fraction', 'peclet')))
        assert each['step'] == pytest.approx(same['step']/2)
        (value, error), (wanted, uncertain) = each['viscosity_total'], same['viscosity_total']
        assert abs(value - wanted) < 1.5*np.hypot(error, uncertain)
        assert error < 0.1*value and each['redone'] < 0.5*same['redone']


def test_what_the_page_says_of_steady_shear(study):
    hard, data = study('hardspheres'), results('steady_shear')
    for phi in study('steady_shear').FRACTIONS:
        runs = [each for each in data['runs'] if each['fraction'] == phi]
        assert [each['peclet'] for each in runs] == [0.3, 1, 3, 10, 30]
        for each in runs:
            # The parts are those of the whole.
            for name, fluid in (('viscosity', 1), ('N1', 0), ('N2', 0)):
                parts = sum(each[f'{name}_{part}'][0]
                            for part in ('hydrodynamic', 'brownian', 'interparticle'))
                assert each[f'{name}_total'][0] == pytest.approx(fluid + parts, abs=1e-9)
            assert each['redone'] < 0.4
        # The thermal part falls by far, and the hydrodynamic part rises.
        weak, strong = runs[1], runs[-1]
        fall = weak['viscosity_thermal'][0] - strong['viscosity_thermal'][0]
        assert fall > 3*np.hypot(weak['viscosity_thermal'][1], strong['viscosity_thermal'][1])
        rise = strong['viscosity_hydrodynamic'][0] - weak['viscosity_hydrodynamic'][0]
        assert rise > 3*np.hypot(weak['viscosity_hydrodynamic'][1],
                                 strong['viscosity_hydrodynamic'][1])
        assert 1 + weak['viscosity_hydrodynamic'][0] == pytest.approx(
            hard.fits(phi)['viscosity'], rel=0.15)
