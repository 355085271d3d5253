"""Bodies above a wall, of validation/delong2015 and validation/westwood2022. Shortened scripts run,
their theory agrees with independent numbers, and kept runs go on."""
import json
import pathlib
import subprocess
import sys

import numpy as np
import pytest
from openmmrigidhi.ensemble import tasks

VALIDATION = pathlib.Path(__file__).resolve().parents[2]/'validation'


def run(script, folder, paper='delong2015', *options):
    """Run a script with --quick, and return its results."""
    finished = subprocess.run([
        sys.executable,
        str(VALIDATION/paper/f'{script}.py'), '--quick', '--output',
        str(folder), *options
    ], capture_output=True, text=True, timeout=600)
    assert finished.returncode == 0, finished.stdout + finished.stderr
    assert (folder/f'{script}.png').stat().st_size > 5000
    data = json.loads((folder/f'{script}.json').read_text())
    assert {'processor', 'openmm', 'commit', 'plugin_sha256', 'arguments'} <= set(
        data['provenance'])
    for entry in data['runs']:
        assert (folder/'work').is_dir() and entry['frames'] > 0
        # Replicas are independent. One chunk is short, so errors are large. With 31 degrees of
        # freedom 6 errors are exceeded by chance with probability 1e-6, and seeds are fixed.
        for mean in entry['means'].values():
            assert abs(mean['mean'] - mean['exact']) < 6*mean['error'], (entry['scheme'], mean)
    return data


def near(pair, value, ownError=0.0):
    """A mean with its standard error agrees with an independent one."""
    return abs(pair[0] - value) < 4*np.hypot(pair[1], ownError)


@pytest.fixture(scope='module')
def tetramer(tmp_path_factory):
    """The results of the script, and their directory."""
    folder = tmp_path_factory.mktemp('tetramer')
    return run('tetramer', folder), folder


@pytest.mark.scripts
def test_tetramer(tetramer):
    exact = tetramer[0]['exact']
    # The expected values are from independent Monte Carlo and quadrature.
    assert exact['mean h'] == pytest.approx(5.94362, abs=1e-5)
    assert exact['gravitational height'] == pytest.approx(1.74775, abs=1e-5)
    slopes = exact['mobility averages (mean, error)']
    assert near(slopes['slope centre'], 1.3411, 0.0004) and near(slopes['slope vertex'], 2.2102,
                                                                 0.0008)
    # Without the drift the body sits lower, where it is slower, by much more than the runs' errors
    # of 0.5 %.
    assert exact['without drift']['mean h'] < 0.97*exact['mean h']


@pytest.mark.scripts
def test_schemes_at_a_time(tmp_path, tetramer):
    """Runs two at a time have the results of runs one after the other. With --keep, runs that are
    not made again stay in the JSON."""
    def means(data):
        return {(r['scheme'], r['step']): r['means']['h']['mean'] for r in data['runs']}

    written = tetramer[1]/'tetramer.json'
    kept = json.loads(written.read_text())
    for r in kept['runs']:
        r['means']['h']['mean'] += 0 if r['scheme'] == 'DriftCorrectorRFD' else 1e-3
    (tmp_path/'tetramer.json').write_text(json.dumps(kept))
    again = run('tetramer', tmp_path, 'delong2015', '--keep', '--jobs', '2', '--cluster',
                'processes', '--schemes', 'EulerMaruyama', 'FixmanMidpoint')
    first = means(tetramer[0])
    assert list(means(again)) == list(first) and len(first) == 4
    for key, mean in means(again).items():
        assert mean == first[key] + (1e-3 if key[0] == 'RandomFiniteDifference' else 0)


@pytest.mark.scripts
def test_icosahedron(tmp_path):
    data = run('icosahedron', tmp_path)
    h = np.linspace(0.5, 12, 400001)[1:]
    density = np.exp(-2.5*h - 10/(h - 0.5)*np.exp(-(h - 0.5)/0.5))
    assert data['exact']['mean h'] == pytest.approx(h @ density/density.sum(), rel=1e-6)
    # For P(theta) ~ sin theta exp(k cos theta) the mean of the cosine is coth k - 1/k.
    k = 1.09375
    assert data['exact']['mean cos theta'] == pytest.approx(1/np.tanh(k) - 1/k, rel=1e-9)
    theta = np.array(data['runs'][0]['histograms']['theta']['edges'])
    assert np.allclose(data['runs'][0]['histograms']['theta']['exact'],
                       -np.diff(np.exp(k*np.cos(theta)))/(2*np.sinh(k)), atol=1e-8)


@pytest.mark.scripts
def test_boomerang(tmp_path):
    data = run('boomerang', tmp_path)
    bulk, row = data['bulk'], data['table']['1']
    assert bulk['CoH'] == pytest.approx(1.0749, abs=1e-4) and bulk['CoM'] == pytest.approx(
        0.9609, abs=1e-4)
    assert bulk['chi_3D'] == pytest.approx(0.26961, abs=1e-5)
    # Translation is about the centre of mobility, along the bisector, in the plane, and normal to
    # it. Then comes rotation.
    assert np.allclose(bulk['D about CoM: bisector, in plane, normal'], (0.26895, 0.29665, 0.24323),
                       atol=1e-5)
    assert np.allclose(bulk['D_rot: bisector, in plane, normal'], (0.13384, 0.42711, 0.11552),
                       atol=1e-5)
    # The strength 23.08 has two digits fewer than these numbers, so the tolerance is 1e-4.
    assert row['mean h/a'] == pytest.approx(
        10.85443, rel=1e-4) and row['cos2 theta'] == pytest.approx(0.37016, abs=1e-5)
    averages = row['averages (mean, error)']
    assert near(averages['chi_2D CoH'], 0.22752, 0.00009) and near(averages['chi_2D CoM'], 0.22531,
                                                                   0.00009)
    assert near(averages['chi_theta where sine > cut-off, else 0'], 0.476, 0.004)
    assert near(averages['chi_2D cross point'], 0.3848, 0.0003) and near(
        averages['chi_2D tip'], 0.4459, 0.0003)


@pytest.mark.scripts
def test_boomerang_steps(tmp_path):
    means = run('boomerang_steps', tmp_path, 'westwood2022')['runs'][0]['means']
    assert means['h']['exact'] == pytest.approx(
        11.00216, abs=2e-5) and means['cos²θ']['exact'] == pytest.approx(0.37376, abs=1e-5)


@pytest.fixture
def plan(monkeypatch):
    """A function that makes plans of short runs of the tetramer with a given step. Its attribute
    runs is the module."""
    for folder in ('common', 'delong2015'):
        monkeypatch.syspath_prepend(str(VALIDATION/folder))
    import runs
    import tetramer
    from equilibrium import Equilibrium

    body = tetramer.body()
    equilibrium = Equilibrium(body, np.linspace(1.5, 16.5, 11), np.linspace(0, np.pi, 7), 8)

    def make(step):
        return runs.Plan('trial', body, equilibrium, 'RandomFiniteDifference', step, 2, 5, 0,
                         {'h': (lambda h, A: h, None)}, {'parallel': runs.parallel(
                             (0, 0, 0))}, [1, 2], 4)

    make.runs = runs
    return make


def test_replicas_that_the_wall_throws_begin_anew(plan):
    runs, wanted = plan.runs, plan(0.05)
    tally, replicas = runs.Tally(wanted), runs.Replicas(wanted.body, 4, wanted.scheme, wanted.step)
    R, q = wanted.equilibrium.draw(np.random.default_rng(1), 4)
    # Three blobs are a thousandth of a radius from contact, where the force is 6e7 kT/a.
    R[2], q[2] = (3.0, 4.0, 1.001 - wanted.body.sites[0, 2]), (1, 0, 0, 0)
    replicas.place(R, q)
    runs.step(replicas, tally, 1, np.random.default_rng(2))
    assert tally.arrays['restarted'].tolist() == [0, 0, 1, 0]
    after = replicas.poses()[0]
    assert 2 < after[2, 2] < wanted.equilibrium.ceiling and np.all(
        abs(after[[0, 1, 3], 2] - R[[0, 1, 3], 2]) < 2)


def test_kept_runs_go_on(tmp_path, monkeypatch, plan):
    """A second run adds to the first with new random numbers. Other settings are refused."""
    runs = plan.runs
    job = tasks.Job(0, 'trial', str(tmp_path))
    first = runs.run(plan(0.05), job, 0)
    assert first.chunks == 1 and first.frames == 5 and np.all(first.arrays['count h'].sum(1) == 5)
    # No time is left, so the results are those of the file.
    same = runs.run(plan(0.05), job, 0)
    assert all(np.array_equal(same.arrays[key], first.arrays[key]) for key in first.arrays)
    monkeypatch.setattr(runs, 'finished', lambda tally: tally.chunks >= 2)
    second = runs.run(plan(0.05), job, 60)
    assert second.chunks == 2 and second.frames == 10 and second.arrays['numbers'][5] == 2
    # The second run began where the first ended. So the sum of heights grows by frames near that
    # end, not by those of a fresh start.
    added = (second.arrays['sum h'] - first.arrays['sum h'])/5
    assert np.all(abs(added - first.arrays['positions'][:, 2]) < 2) and not np.array_equal(
        second.arrays['msd parallel'], 2*first.arrays['msd parallel'])
    with pytest.raises(ValueError, match='begun with other settings'):
        runs.run(plan(0.06), job, 60)
