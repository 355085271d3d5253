"""Shortened runs of the scripts of validation/davidchack2017 end well, and the physics of their
results is right."""
import argparse
import importlib
import json
import pathlib
import subprocess
import sys

import numpy as np
import pytest
from openmmrigidhi.ensemble import tasks

FOLDER = pathlib.Path(__file__).resolve().parents[2]/'validation'/'davidchack2017'


def run(script, folder, *options):
    """Run a script with --quick, and return the files that it wrote, by name."""
    finished = subprocess.run(
        [sys.executable,
         str(FOLDER/script), '--quick', '--output',
         str(folder), *options], capture_output=True, text=True, timeout=600)
    assert finished.returncode == 0, finished.stdout + finished.stderr
    for picture in folder.glob('*.png'):
        assert picture.stat().st_size > 5000
    written = {path.name: json.loads(path.read_text()) for path in folder.glob('*.json')}
    for data in written.values():
        assert {'processor', 'openmm', 'commit', 'plugin_sha256', 'arguments'} <= set(
            data['provenance'])
    return written


@pytest.mark.scripts
def test_sedimenting_spheres(tmp_path):
    result = run('sedimenting_spheres.py', tmp_path)['sedimenting_spheres.json']
    exact = result['exact']['3']
    # The exact values were computed in two independent ways.
    assert exact['F/U_fundamental_solutions'] == pytest.approx(1.1840839517, rel=1e-9)
    assert exact['omega/U_fundamental_solutions'] == pytest.approx(0.064558335059, rel=1e-9)
    # The error of each rung at l = 3 was computed independently, to the digits given.
    for model, drag, spin in (('RPY', -1.35e-3, 1.76e-2), ('FTS', -9.45e-4, 1.8e-4),
                              ('multiblob 12', 4.2e-5, -7.9e-3)):
        error = result['models'][model]['3']['relative_error']
        assert error['F/U'] == pytest.approx(drag, abs=1e-5), model
        assert error['omega/U'] == pytest.approx(spin, abs=2e-4), model
    row = result['models']['FTS+lubrication']['3']
    assert abs(row['relative_error']['F/U']) < 1e-5 and abs(row['relative_error']['omega/U']) < 3e-4
    # By order 2 the error of U falls as h^2 (0.04, 0.03, 0.02, 0.01), up to the h^4 term.
    h, drag = np.array(row['h']), np.array(row['F/U_h'])
    order = np.polyfit(np.log(h[:4]), np.log(abs(drag[:4] - row['F/U'])), 1)[0]
    assert order == pytest.approx(2, abs=0.02)


@pytest.mark.scripts
def test_trapped_spheres(tmp_path):
    runs = run('trapped_spheres.py', tmp_path)['trapped_spheres.json']['runs']
    assert len(runs) == 2
    for r in runs:
        assert r['bias_of_this_step'] < 0.002 and r['theory_of'] == 'the equations'
        # Each of the ten numbers is an average of squares over many correlated lags. For a chi^2
        # with a few degrees of freedom, 3 is very improbable.
        print(r['set'], r['rms_z'])
        assert max(r['rms_z'].values()) < 3
        assert max(r['largest_difference'].values()) < 6*r['largest_standard_error']
    # The theory agrees with independent numbers for the value and the time of extremes (exact pair
    # friction, inertial set, R = 3).
    theory, times = runs[0]['theory'], np.array(runs[0]['times'])
    for name, value, time in (('z1 z2', -0.22006, 0.93), ('x1 x2', -0.11039, 0.94),
                              ('x1 chiy2', 0.03437, 0.61), ('x1 chiy1', 0.00791, 0.57),
                              ('chiy1 chiy2', 0.00896, 0.41), ('chiz1 chiz2', -0.01657, 0.41)):
        curve = np.array(theory[name])
        k = np.argmax(np.sign(value)*curve)
        # The extremes lie between samples 0.05 apart, which are at most half a percent lower.
        assert curve[k] == pytest.approx(value, abs=0.006*abs(value)), name
        assert times[k] == pytest.approx(time, abs=0.03), name


@pytest.mark.scripts
def test_ring(tmp_path):
    row, = run('ring.py', tmp_path)['ring_states_FTS_lubrication.json']['rows']
    assert row['state'] == '5+1 drafting'
    # The independent values are 64.8, 0.2889, 0.1227 and 0.287. The coarse step of the quick mode
    # makes an error of 0.1 %.
    assert row['period'] == pytest.approx(64.8, abs=0.3)
    assert row['orbital_speed'] == pytest.approx(0.2889, abs=0.001)
    assert row['spin'] == pytest.approx(0.1227, abs=0.001)
    assert row['smallest_gap'] == pytest.approx(0.287, abs=0.003)
    assert row['largest_out_of_plane'] < 1e-10


def test_ring_classifier():
    """The classifier gives the right name to made-up gaps of every kind."""
    sys.path.insert(0, str(FOLDER))
    try:
        import ring
    finally:
        sys.path.remove(str(FOLDER))
    t = np.arange(4000)*ring.SPACING
    period = 60.0

    def wave(phase, harmonic=1):
        return np.sin(2*np.pi*harmonic*(t/period + phase)) + 0.4*np.sin(4*np.pi*harmonic*
                                                                        (t/period + phase))

    def gaps(phases):
        return np.pi/3 + 0.2*np.stack([wave(p) for p in phases], axis=1)

    def steady(values):
        return np.tile(values, (4000, 1))

    assert ring.classify(steady(6*[np.pi/3]))[0] == 'uniform'
    assert ring.classify(steady(3*[0.8, 1.2]))[0] == 'steady pairs'
    assert ring.classify(steady(2*[0.8, 0.9, 1.4]))[0] == 'steady triplets'
    assert ring.classify(steady([0.8, 0.8, 0.8, 0.8, 0.8, 2.3]))[0] == 'steady cluster'
    state, _, found = ring.classify(gaps(np.arange(6)/6))
    assert state == '5+1 drafting' and found == pytest.approx(period, abs=0.3)
    assert ring.classify(gaps(2*[0, 0.1, 0.5]))[0] == 'in-phase triplets'
    # A shift by two gaps is a third of a period, but odd and even gaps differ.
    odd = np.pi/3 + np.stack([0.2*wave(k/6) if k % 2 else 0.1*wave(k/6, 2)
                              for k in range(6)], axis=1)
    assert ring.classify(odd)[0] == 'pair drafting'
    triplets = np.pi/3 + np.stack([0.2*wave(k // 3/2 + 0.1*(k % 3), 1 + k % 3)
                                   for k in range(6)], axis=1)
    triplets[:,
             [2, 5]] += 0.1*np.stack([np.sin(2*np.pi*t/period), -np.sin(2*np.pi*t/period)], axis=1)
    assert ring.classify(triplets)[0] == 'alternating triplets'


def checkLennardJones(runs):
    # The expected value is that of Monte Carlo plus the paper's error constant (below 0.001 at
    # these steps). The bound of 4.5 standard errors is exceeded by chance once in 1e5.
    for r in runs:
        expected = -2.34371 - 0.0098*r['h']**2
        z = (r['mean']['U/N'] - expected)/np.hypot(r['error']['U/N'], 4e-4)
        print(r['model'], r['h'], z)
        assert abs(z) < 4.5
        for name, constant in (('kT_t', -0.0697), ('kT_r1', 0), ('kT_r2', -0.006), ('kT_r3',
                                                                                    -0.014)):
            assert r['mean'][name] == pytest.approx(0.1 + constant*r['h']**2,
                                                    abs=5*r['error'][name] + 3e-4), name


@pytest.mark.scripts
def test_lennard_jones(tmp_path):
    checkLennardJones(run('lennard_jones.py', tmp_path)['lennard_jones.json']['runs'])


@pytest.mark.scripts
def test_lennard_jones_in_a_periodic_fluid(tmp_path):
    """With images, StokesianDynamics and RotnePragerYamakawa have kinetic temperatures right to 2
    or 3 %, and U/N to 0.005."""
    result = run('lennard_jones.py', tmp_path, '--periodic')['lennard_jones_periodic.json']
    assert {r['model'] for r in result['runs']} == {'SD periodic', 'RPY periodic'}
    checkLennardJones(result['runs'])
    # The published runs without interactions stand beside them.
    assert {m['model']
            for m in result['analysis']['kT=0.1']['models']} == {'SD periodic', 'RPY periodic'}


@pytest.fixture
def scripts(monkeypatch):
    """Imports a script of the folder."""
    monkeypatch.syspath_prepend(str(FOLDER))
    return importlib.import_module


@pytest.mark.scripts
def test_a_longer_run_goes_on_from_what_is_kept(tmp_path, scripts):
    """A run of 10 that is made 20 long is the run of 20, to the last bit on Reference. Other
    settings are refused."""
    lennard_jones = scripts('lennard_jones')

    def run(duration, job, seed=3):
        return lennard_jones.run((0.1, 0.2, 'RPY periodic', duration, 2, seed, 'Reference', 20.0),
                                 job)

    job = tasks.Job(0, 'run', str(tmp_path))
    first, longer, whole = run(10.0, job), run(20.0, job), run(20.0, None)
    assert first['samples'] == 25 and longer['samples'] == whole['samples'] == 50
    assert longer['mean'] == whole['mean'] and longer['mean'] != first['mean']
    with pytest.raises(ValueError, match='begun with other settings'):
        run(10.0, job, seed=4)


@pytest.mark.scripts
def test_trapped_spheres_go_on(tmp_path, scripts):
    trapped = scripts('trapped_spheres')

    def run(duration, job):
        return trapped.run(('inertial (Figs 2, 3)', 3.0, 0.01, 'RPY', duration, 5, np.inf), job)

    job = tasks.Job(0, 'run', str(tmp_path))
    run(130.0, job)
    longer, whole = run(300.0, job), run(300.0, None)
    assert longer['samples'] == whole['samples'] == 6000
    assert all(
        np.array_equal(longer['measured'][name], whole['measured'][name])
        for name in whole['measured'])


@pytest.mark.scripts
def test_trapped_spheres_at_a_step_of_their_own(scripts):
    """A run at another step is compared with the scheme at this step, not with the equations."""
    trapped = scripts('trapped_spheres')
    name = 'overdamped (Figs 4, 5)'
    found = trapped.run((name, 3.0, 0.0005, 'RPY', 700.0, 5, np.inf, 0.01))
    assert found['h'] == 0.01 and found['theory_of'] == 'the scheme at this step'
    probe = trapped.build(dict(trapped.SETS[name], kT=0.0005), 3.0, 'RPY', 0.001, 1)
    linear = trapped.Linear(trapped.SETS[name], probe.fluid.getFrictionInContext(probe.context))
    times, exact, biases = trapped.biases(linear, trapped.SETS[name])
    # The scheme's own bias, 0.03, is in the curve that is compared with.
    scheme = np.array(found['theory']['chiy1 chiy1'])
    assert found['bias_of_this_step'] == biases[0.01] == pytest.approx(0.03, abs=0.002)
    assert abs(scheme - exact['chiy1 chiy1']).max() == pytest.approx(biases[0.01], abs=1e-6)
    assert max(found['rms_z'].values()) < 3


@pytest.mark.scripts
def test_a_ring_that_has_settled_need_not_do_so_again(tmp_path, scripts):
    ring = scripts('ring')
    arguments = {
        'f': 1.0,
        'tau': 0.0,
        'kT': 1e-3,
        'model': 'RPY',
        'truncation': 'switch',
        'kind': 'random',
        'settle': 20.0,
        'window': 20.0,
        'seed': 1,
        'step': 0.05,
        'attempts': 1
    }
    job = tasks.Job(0, 'run', str(tmp_path))
    first, again = ring.runState(arguments, job), ring.runState(arguments, job)
    assert first['orbital_speed'] == again['orbital_speed'] == ring.runState(
        arguments)['orbital_speed'] and len(list(tmp_path.iterdir())) == 1


@pytest.mark.full
def test_two_runs_at_a_time(tmp_path):
    """Runs in parallel have the results of runs one after the other. A second call takes all
    results from the kept files, but not with --fresh."""
    models = ('--models', 'RPY', 'FTS')

    def found(folder, *options):
        rows = run('sedimenting_spheres.py', folder, *models,
                   *options)['sedimenting_spheres.json']['models']
        return {name: (row['3']['F/U'], row['3']['omega/U'])
                for name, row in rows.items()
                }, {name: row['3']['seconds']
                    for name, row in rows.items()}

    together, seconds = found(tmp_path, '--jobs', '2', '--cluster', 'processes')
    assert list(together) == ['RPY', 'FTS']
    again = found(tmp_path, '--work', str(tmp_path/'work'))
    assert again == (together, seconds)
    anew = found(tmp_path, '--fresh')
    assert anew[0] == together and anew[1] != seconds


def fails(argument, job):
    raise ValueError(f'no {argument}')


def test_runs_that_fail_are_named(tmp_path, scripts, capsys):
    """The message names a run that fails, and nothing of this run is kept."""
    campaign = scripts('spheres').campaign
    args = argparse.Namespace(jobs=1, cluster=None, work=tmp_path, fresh=False, quick=True)
    done = []
    with pytest.raises(SystemExit, match=r'1 of 1 runs failed \(some_run\)'):
        campaign.run(fails, [1], ['some run'], args, finished=done.append)
    assert 'no 1' in capsys.readouterr().err and not done and not (tmp_path/'some_run'/
                                                                   'result.json').exists()
