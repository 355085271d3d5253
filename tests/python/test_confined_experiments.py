"""The studies of validation/confined: shortened scripts run, and agree with independent numbers."""
import importlib
import json
import pathlib
import subprocess
import sys

import numpy as np
import pytest

FOLDER = pathlib.Path(__file__).resolve().parents[2]/'validation'/'confined'
STUDIES = ('monolayer', 'sedimentation', 'periods', 'slits', 'poiseuille')


def shortened(name, folder):
    """The results of a script with --quick."""
    finished = subprocess.run(
        [sys.executable,
         str(FOLDER/f'{name}.py'), '--quick', '--fresh', '--output',
         str(folder)], capture_output=True, text=True, timeout=600)
    assert finished.returncode == 0, finished.stdout + finished.stderr
    assert (folder/f'{name}.png').stat().st_size > 5000
    data = json.loads((folder/f'{name}.json').read_text())
    assert {'processor', 'openmm', 'commit', 'plugin_sha256', 'arguments'} <= set(
        data['provenance'])
    return data


@pytest.fixture
def study(monkeypatch):
    """A function that imports a script."""
    for folder in ('confined', 'common', 'delong2015'):
        monkeypatch.syspath_prepend(str(FOLDER.parent/folder))
    return importlib.import_module


@pytest.mark.parametrize('name', STUDIES)
def test_the_page_has_the_tables_of_the_results(study, name):
    module, data = study(name), json.loads((FOLDER/'results'/f'{name}.json').read_text())
    page = (FOLDER/'README.md').read_text(encoding='utf-8')
    tables = '\n'.join(module.tables(data)).split('\n\n')
    assert len(tables) > 0 and all(len(table.splitlines()) > 2 for table in tables)
    for table in tables:
        assert table.strip() in page, table
    assert not data['provenance']['arguments']['quick'] == 'True'


@pytest.mark.scripts
def test_monolayer(tmp_path):
    data = shortened('monolayer', tmp_path)
    u, single = 1/data['height'], data['singles']['1']
    parallel = 1 - 9*u/16 + u**3/8 - u**5/16
    assert single['mean'][0] == pytest.approx(parallel, rel=1e-12)
    assert single['mean'][1] == pytest.approx(1 - 9*u/8 + u**3/2 - u**5/8, rel=1e-12)
    spheres = [run for run in data['runs'] if run['blobs'] == 1 and not run['isBestKnown']]
    assert len(spheres) >= 4
    for run in spheres:
        # Spheres without stresslets do not change each other's own mobility.
        assert run['self'][0] - run['images'] == pytest.approx(parallel, rel=1e-9)
        # The leading term of images, 12 z^2 4.51681/(8 pi eta L^3), is the larger part of them.
        if run['boundary'] == 'PeriodicWall' and run['side'] > 9:
            law = 9*data['height']**2*4.51681/run['side']**3
            assert run['images'] == pytest.approx(law, rel=0.2)
    # Two shells hinder each other nearly as two exact spheres do. Chance is that of orientations.
    exact = data['singles']['unbounded exact pairs']['pairs']['self_slope']
    assert exact < -0.4
    assert data['singles']['unbounded 42']['pairs']['self_slope'] == pytest.approx(exact, rel=0.1)


def test_the_exact_slope_of_pairs(study):
    """The own mobility of two far spheres is that of the leading terms of Jeffrey's functions."""
    found = study('monolayer').pairs(1, False, 'Unbounded', 1, model='StokesianDynamics')
    far = np.array(found['distance']) > 6
    ratio, distance = np.array(found['own_ratio'])[far], np.array(found['distance'])[far]
    # It is 1 - 15/4 (a/r)^4 along the line of centres, and 1 - 17/16 (a/r)^6 across it.
    assert far.sum() >= 3
    assert (1 - ratio)*distance**4 == pytest.approx(np.full(far.sum(), 15/8), rel=0.05)


def test_discs_do_not_overlap_and_forget_their_lattice(study):
    discs = study('monolayer').Discs(16, 0.4, np.random.default_rng(3))
    start = discs.centres.copy()
    discs.sweep(200, adapt=True)
    apart = discs.centres[:, None] - discs.centres
    apart -= discs.side*np.rint(apart/discs.side)
    assert (np.linalg.norm(apart, axis=-1) + 10*np.eye(16)).min() >= 2
    moved = np.linalg.norm(discs.centres - start, axis=1)
    assert np.median(moved) > 1 and discs.side == pytest.approx(np.sqrt(16*np.pi/0.4))


@pytest.mark.scripts
def test_sedimentation(tmp_path):
    data = shortened('sedimentation', tmp_path)
    hard = [run for run in data['runs'] if run['body'] == 'sphere' and not run['isSoft']]
    assert hard[0]['means']['h']['exact'] == pytest.approx(1 + hard[0]['length'], rel=1e-9)
    for run in data['runs']:
        # Replicas begin in equilibrium. Of 32 replicas 6 errors are exceeded by chance with
        # probability 1e-6, and seeds are fixed.
        for name, mean in run['means'].items():
            assert abs(mean['mean'] - mean['exact']) < 6*mean['error'], (run['body'], name)
    boxes = data['boxes']
    # The same poses: images only add to the mobility along the wall, as 1/L^3.
    assert 1.4 < boxes['16']['slope centre'][0]/boxes['infinite']['slope centre'][0] < 2


@pytest.mark.scripts
def test_periods(tmp_path):
    data = shortened('periods', tmp_path)
    assert {row['body'] for row in data['mobilities']} == {'one blob', 'icosahedron', 'tetramer'}
    for row in data['mobilities']:
        # Images add a term in 1/L^3, which the law has, and terms in 1/L^5 and beyond.
        for key, power in (('images', 3), ('beyond_law', 5)):
            first, second = row[key][-2:]
            assert np.log2(first/second) == pytest.approx(power, abs=0.12), (row['body'], key)
        across = row['zz'][-2] - row['infinite'][2][2], row['zz'][-1] - row['infinite'][2][2]
        assert np.log2(across[0]/across[1]) > 4
    blob = data['mobilities'][0]
    u = 1/blob['height']
    assert blob['infinite'][0][0] == pytest.approx(1 - 9*u/16 + u**3/8 - u**5/16, rel=1e-12)
    means = data['averages']
    widest = means['periods'][str(max(map(int, means['periods'])))]
    assert widest['parallel'] == pytest.approx(widest['law']['parallel'], rel=1e-4)
    for run in data['runs']:
        row = means['periods'][str(run['period'])] if run['period'] else means['infinite']
        for mean in run['means'].values():
            assert abs(mean['mean'] - mean['exact']) < 6*mean['error']
        lag = run['msd']['parallel']
        error = lag['error'][0]/lag['lag'][0]
        assert lag['mean'][0]/lag['lag'][0] == pytest.approx(row['parallel'][0], abs=6*error)


@pytest.mark.scripts
def test_slits(tmp_path):
    data = shortened('slits', tmp_path)
    for run in data['runs']:
        for name, mean in run['means'].items():
            assert abs(mean['z']) < 6, (run['body'], run['width'], name)
    slit, free = data['along'][:2]
    assert slit['width'] == 3 and free['width'] is None
    # A channel with closed ends is slower than an open one, and both are slower than no walls.
    assert slit['closed'] < slit['mean'] < slit['open'] < free['open'] == free['closed']


def test_steric_poses_of_a_rod(study):
    """The ends of a rod are 1 from its middle and 0.5 thick: at a distance g + 0.5 from the nearer
    wall a share min(g, 1) of directions fits, so that averages over heights are integrals."""
    slits = study('slits')
    width, count = 4, 200000
    z, q, share = slits.draw_poses('rod', width, False, count, np.random.default_rng(2))
    height = np.linspace(0.5, 3.5, 30001)
    fits = np.minimum(np.minimum(height, width - height) - 0.5, 1)
    assert share == pytest.approx(fits.mean()*3/4, rel=0.01)
    expected = (np.abs(height - 2)*fits).sum()/fits.sum()
    found = np.abs(z - 2)
    assert found.mean() == pytest.approx(expected, abs=5*found.std()/count**0.5)
    cosine = slits.observe('rod', z, q)
    expected = (fits**3/3).sum()/fits.sum()
    assert cosine.mean() == pytest.approx(expected, abs=5*cosine.std()/count**0.5)


@pytest.mark.scripts
def test_poiseuille(tmp_path):
    data = shortened('poiseuille', tmp_path)
    spheres, shell, shells = data['runs']
    # Spheres of RotnePragerYamakawa have no stresslet, and leave the flow as it is.
    assert spheres['blobs'] == 1 and spheres['ratio'] == pytest.approx(1, abs=1e-12)
    z, H = np.array(spheres['z']), spheres['height']
    parabola = data['force']*z*(H - z)/(2*data['viscosity'])
    assert spheres['profile'] == pytest.approx(parabola, rel=1e-10)
    assert 1 < shell['ratio'] < 1.05 < shells['ratio'] + 3*shells['ratio_error'] + 0.05
    assert np.all(np.array(shells['profile']) < 1.001*parabola)
