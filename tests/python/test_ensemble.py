"""openmmrigidhi.ensemble: no results are lost when workers die, and numbers do not depend on the
processes that compute them. What goes wrong with files is tested in test_ensemble_failures.py."""
import os
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest

import ensemble_tasks
from ensemble_support import CLUSTERS, SCENE, distributed, needsDask, same, samples, small, waitFor
from openmmrigidhi import ensemble
from openmmrigidhi.accuracy import scenes
from openmmrigidhi.ensemble import cli, simulation, taskfiles

pytest_plugins = ['ensemble_fixtures']
pytestmark = pytest.mark.usefixtures('marks')

#: Where workers die within a study. Quick tests of test_ensemble_tasks.py let those of the library
#: die.
DYING = ['processes', *([pytest.param('local', marks=pytest.mark.full)] if distributed else [])]

# ---- Studies: the same numbers, whoever computes them --------------------------------------------


@pytest.mark.parametrize('where', CLUSTERS, indirect=True)
def test_two_workers_give_the_same_numbers(where, undisturbed, tmp_path):
    result = small().run(str(tmp_path/'study'), 2, where, quiet=True)
    assert same(samples(result), samples(undisturbed))
    assert result.rows == undisturbed.rows


@pytest.mark.parametrize('where', DYING)
def test_one_of_two_workers_is_killed_and_nothing_is_lost(where, undisturbed, tmp_path, marks):
    """After a SIGKILL within a task another worker goes on from the checkpoint, as the sessions in
    the task's file show."""
    result = small(['ensemble_tasks:energyOfMortals']).run(str(tmp_path/'study'), 2, where,
                                                           quiet=True)
    assert (marks/'died').exists()
    assert result.isComplete and same(samples(result), samples(undisturbed))
    sessions = [taskfiles.load(task.path).about['sessions'] for task in result.tasks]
    assert sorted(len(each) for each in sessions) == [1, 1, 2]
    resumed = max(sessions, key=len)
    # When the task died at 1.55 ps, 0.5 ps of equilibration and 1 ps of samples, one each 0.05 ps,
    # were saved.
    assert resumed[0]['to_position'] == resumed[1]['from_position'] == 30
    assert result.about['sessions'][0]['attempts'] == 4


@pytest.mark.parametrize('where', DYING)
def test_workers_that_live_shorter_than_the_interval_get_on(where, undisturbed, tmp_path):
    """Workers die 0.7 s after their first sample, and the task takes twice as long. The time
    between two checkpoints, 9.6 s, never comes; the first checkpoints come after 0.15 s and 0.3 s
    more."""
    study = small(['ensemble_tasks:energyOfTheShortLived'], replicas=1)
    study.checkpointInterval = 9.6
    result = study.run(str(tmp_path/'study'), 2, where, quiet=True)
    assert result.isComplete and result.about['sessions'][0]['attempts'] > 1
    assert np.array_equal(result.series('energyOfTheShortLived', 0, 0),
                          undisturbed.series('energy', 0, 0))


def test_times_of_checkpoints():
    """First a 64th of the interval, then twice the time before, and ten times what saving took at
    least; never more than the interval."""
    def times(interval, cost):
        found, now, course = [], 0.0, simulation.CheckpointTimes(interval, 0.0)
        while len(found) < 8:
            now += 0.25
            if course.isDue(now):
                found.append(now)
                now += cost
                course.saved(now - cost, now)
        return list(np.diff([-cost, *found]) - cost)

    assert times(64.0, 0.0) == [1, 2, 4, 8, 16, 32, 64, 64]
    assert times(64.0, 1.0) == [1, 10, 20, 40, 64, 64, 64, 64]
    assert times(0.0, 1.0) == [0.25]*8


@needsDask
def test_workers_of_a_scheduler_are_killed_from_outside(cluster, tmp_path):
    """One of two workers is killed at an arbitrary time, while both compute."""
    study = small(['ensemble_tasks:energyOfTheSlow'], replicas=2, length=4.0)
    directory = tmp_path/'study'

    def kill():
        waitFor(lambda: all((directory/'tasks'/f's0000_r000{k}.h5').exists() for k in (0, 1)))
        with distributed.Client(cluster, set_as_default=False) as client:
            os.kill(next(iter(client.run(os.getpid).values())), signal.SIGKILL)

    thread = threading.Thread(target=kill)
    thread.start()
    result = study.run(str(directory), cluster=cluster.scheduler_address, quiet=True)
    thread.join()
    assert sorted(len(taskfiles.load(task.path).about['sessions'])
                  for task in result.tasks) == [1, 2]
    alone = small(length=4.0, replicas=2).run(str(tmp_path/'alone'), quiet=True)
    assert same(samples(result), samples(alone))


def test_extension_equals_one_long_run(undisturbed, tmp_path):
    """A study may become longer, or get more replicas or settings. Earlier results stay as they
    are."""
    directory = str(tmp_path/'study')
    begun = small(length=1.0, replicas=2).run(directory, quiet=True)
    larger = ensemble.Study.load(directory, 0.0).extended(length=3.0, replicas=3, settings=[{
        'temperature': 280.0
    }])
    result = larger.run(directory, extend=True, quiet=True)
    of = samples(result)
    assert all(np.array_equal(of[key][:20], values) for key, values in samples(begun).items())
    assert all(np.array_equal(of[key], values) for key, values in samples(undisturbed).items())
    assert sorted(of) == [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2)]
    assert len({task.seed for task in result.tasks}) == 6
    assert not np.array_equal(of[0, 0], of[1, 0])
    assert [each['length'] for each in result.about['earlier_definitions']] == [1.0]


def test_a_study_goes_on_where_the_whole_program_was_killed(undisturbed, tmp_path):
    directory = tmp_path/'study'
    script = (f'import sys; sys.path.insert(0, {os.path.dirname(__file__)!r})\n'
              'from ensemble_support import small\n'
              f"small(['ensemble_tasks:energyOfMortals']).run({str(directory)!r}, quiet=True)")
    finished = subprocess.run([sys.executable, '-c', script],
                              env=dict(os.environ,
                                       PYTHONPATH=os.pathsep.join(sys.path)), timeout=120)
    assert finished.returncode == -signal.SIGKILL
    before = ensemble.read(directory)
    assert not before.isComplete and 0 < before.tasks[0].samples < 60
    result = ensemble.Study.load(directory, 0.0).run(str(directory), quiet=True)
    assert same(samples(result), samples(undisturbed))


def test_observables_of_the_sample_before_go_on(tmp_path):
    """The observable msd compares with the previous sample, also if an earlier process measured
    that sample.
    """
    def run(directory, *lengths):
        for length in lengths:
            study = ensemble.Study('boomerang', [{
                'replicas': 2,
                'blobsPerArm': 1,
                'stepSize': 500.0
            }], 1, length, ['height', 'msd'], platform='Reference', equilibration=0.0,
                                   sampleInterval=5000.0)
            result = study.run(str(directory), extend=True, quiet=True)
        return result.series('msd', 0, 0)

    whole, parts = run(tmp_path/'one', 50000.0), run(tmp_path/'two', 20000.0, 50000.0)
    assert whole.shape == (10, 2) and np.isnan(whole[0]).all() and np.isfinite(whole[1:]).all()
    np.testing.assert_array_equal(parts, whole)


def test_a_diffusion_coefficient_goes_on(tmp_path):
    """diffusion_coefficient remembers samples over 4 ps, here the first 80, and has no value for
    them. An extension goes on bit for bit, since checkpoints hold what is remembered."""
    def run(directory, *lengths):
        for length in lengths:
            study = ensemble.Study(SCENE, replicas=2, length=length,
                                   observables=['diffusion_coefficient'], platform='Reference',
                                   equilibration=0.0)
            result = study.run(str(directory), extend=True, quiet=True)
        return result

    whole, parts = run(tmp_path/'one', 6.0), run(tmp_path/'two', 2.0, 5.0, 6.0)
    np.testing.assert_array_equal(list(samples(parts).values()), list(samples(whole).values()))
    row, chains = parts.row('diffusion_coefficient'), list(samples(parts).values())
    assert all(np.isnan(chain[:80]).all() and np.isfinite(chain[80:]).all() for chain in chains)
    assert row['mean'] == pytest.approx(np.mean([chain[80:] for chain in chains]), rel=1e-12)
    assert (row['replicas'], row['samples']) == (2, 80)
    assert 'n/a' not in row['note'] and 'interruptions' not in row['note']


def test_samples_without_a_value_after_an_interruption_are_left_out(tmp_path):
    for length in (1.0, 2.0):
        result = small([ensemble_tasks.forgetful], length=length,
                       replicas=2).run(str(tmp_path/'study'), extend=True, quiet=True)
    # The last sample of the first session is measured again, so that only one has no value.
    values = result.series('forgetful', 0, 1)
    assert list(np.flatnonzero(np.isnan(values))) == [0, 1, 20]
    row = result.row('forgetful')
    assert row['mean'] == pytest.approx(np.nanmean(values), rel=1e-12)
    assert row['samples'] == 2*37
    assert row['note'].startswith('replicas 0 and 1 without samples after interruptions')


def test_a_replica_that_is_sometimes_no_number_is_named(undisturbed, tmp_path):
    result = small(['ensemble_tasks:energyOrNan']).run(str(tmp_path/'study'), quiet=True)
    row = result.row('energyOrNan')
    assert row['note'].startswith('replica 0 sometimes not a number, left out')
    others = [undisturbed.series('energy', 0, k) for k in (1, 2)]
    assert row['replicas'] == 2 and row['mean'] == pytest.approx(np.mean(others), rel=1e-12)


def test_seeds_depend_on_the_place_alone():
    study = small(settings=[{}, {'bodies': 4}], replicas=5, seed=7)
    assert study.seeds() == [[ensemble.taskSeed(7, s, r) for r in range(5)] for s in (0, 1)]
    assert study.extended(replicas=9, settings=[{'bodies': 5}]).seeds()[1][:5] == study.seeds()[1]
    many = [ensemble.taskSeed(seed, s, r) for seed in (1, 2) for s in range(3) for r in range(3)]
    assert len(set(many)) == len(many) and all(0 < each < 2**31 for each in many)


def test_replicas_whose_first_numbers_coincide_get_others(monkeypatch):
    """With 31 bits seeds coincide once in a million studies, so the numbers have fewer bits here.
    """
    class Short(np.random.SeedSequence):
        def generate_state(self, words):
            return super().generate_state(words) % 8

    monkeypatch.setattr(np.random, 'SeedSequence', Short)
    six = [ensemble.taskSeed(1, 0, replica) for replica in range(6)]
    assert len(
        set(six)) == 6 and six[:3] == [ensemble.taskSeed(1, 0, replica) for replica in range(3)]


def test_a_scene_is_kept_with_its_study(undisturbed, tmp_path):
    """A Scene, unlike a function, cannot be called again. So its XML is in the directory, and
    load() needs nothing else."""
    scene = scenes.trap(3)
    directory = str(tmp_path/'study')
    first = ensemble.Study(scene, replicas=2, length=1.0, observables=['ensemble_tasks:energy'],
                           platform='Reference', equilibration=0.5)
    first.run(directory, quiet=True)
    result = ensemble.Study.load(directory).extended(length=2.0).run(directory, extend=True,
                                                                     quiet=True)
    whole = ensemble.Study(scene, replicas=2, length=2.0, observables=['ensemble_tasks:energy'],
                           platform='Reference', equilibration=0.5)
    assert same(samples(result), samples(whole.run(str(tmp_path/'whole'), quiet=True)))
    for name in ('system.xml', 'integrator.xml', 'start.npz', 'scene.json'):
        path = tmp_path/'study'/'scene'/name
        whole = path.read_bytes()
        path.write_bytes(whole[:len(whole) // 2])
        with pytest.raises(ValueError, match='the scene of the study is damaged'):
            ensemble.Study.load(directory)
        path.write_bytes(whole)
    ensemble.Study.load(directory)


def test_functions_may_return_parts_and_the_integrator_can_be_set(tmp_path):
    study = ensemble.Study(ensemble_tasks.bare, [{
        'scheme': 'LangevinA',
        'stepSize': 0.001
    }, {
        'stepSize': 0.004
    }], 1, 1.0, ['potential_energy'], platform='Reference', sampleInterval=0.1)
    result = study.run(str(tmp_path/'study'), quiet=True)
    assert result.isComplete
    assert [taskfiles.load(task.path).about['step_size'] for task in result.tasks] == [0.001, 0.004]
    assert 'one replica' in result.row('potential_energy')['note']


# ---- The command line ----------------------------------------------------------------------------


def command(*words):
    return cli.main([str(word) for word in words])


def test_the_command_line_begins_continues_and_extends(tmp_path, capsys):
    directory = tmp_path/'study'
    begin = (directory, '--scene', SCENE, '--set', 'bodies=2', '--sweep', 'temperature=280,320',
             '--replicas', 2, '--length', 1, '--platform', 'Reference', '--observables',
             'potential_energy', 'translational_temperature', '--quiet')
    assert command(*begin) == 0
    assert 'bodies 2, temperature 320' in capsys.readouterr().out
    assert command(*begin) == 2
    assert 'it has a study already; a new study' in capsys.readouterr().err
    assert command(directory, '--resume', '--quiet') == 0
    assert command(directory, '--extend', '--length', 2, '--sweep', 'temperature=300', '--jobs', 2,
                   '--cluster', 'processes') == 0
    assert 'complete, 2 ps' in capsys.readouterr().err
    assert command(directory, '--show') == 0
    result = ensemble.read(directory)
    assert result.definition['settings'][2] == {
        'temperature': 300
    } and len(result.tasks) == 6 and result.isComplete


@pytest.mark.parametrize('words, text', [
    (('--scene', 'trap'), 'a new study needs both: give them'),
    (('--resume',), 'so it is no study'),
    (('--resume', '--extend'), 'a study is begun, continued, extended or shown'),
    (('--show', '--scene', 'trap'), 'a study is begun, continued, extended or shown'),
    (('--resume', '--platform', 'CPU', '--seed', 2), '--resume: got --seed, --platform too; those'),
    (('--extend', '--observables', 'pressure'), '--extend: got --observables too; those of the'),
    (('--show', '--length', 2), r'leave out what was given, or begin a new study (or say --extend'),
    (('--scene', 'trap', '--length', '1', '--set', 'gamma=1', '--sweep', 'gamma=1,2'),
     'got gamma 2 times; a parameter must be given once'),
    (('--scene', 'trap', '--length', '1', '--set', 'bodies'), 'a name and its value are needed'),
    (('--scene', 'trap', '--length', '1', '--cluster', 'nonsense'), 'it gave no answer within')
])
def test_wrong_command_lines(words, text, tmp_path, capsys):
    if 'nonsense' in words and distributed is None:
        pytest.skip('dask.distributed is not installed')
    assert command(tmp_path/'study', *words, '--timeout', 1, '--quiet') == 2
    assert text in capsys.readouterr().err


def test_a_resumed_study_takes_no_other_length(tmp_path, capsys):
    small(replicas=1, length=0.2).run(str(tmp_path/'study'), quiet=True)
    assert command(tmp_path/'study', '--resume', '--length', 3) == 2
    assert 'those of the study go on as they are' in capsys.readouterr().err


def test_parameters_may_be_given_in_several_options(tmp_path):
    assert command(tmp_path/'study', '--scene', SCENE, '--set', 'bodies=2', '--set', 'broken=false',
                   '--sweep', 'temperature=280,300', '--sweep', 'seed=1,2', '--length', 0.1,
                   '--replicas', 1, '--platform', 'Reference', '--quiet') == 0
    settings = ensemble.read(tmp_path/'study').definition['settings']
    assert settings[3] == {'bodies': 2, 'broken': False, 'temperature': 300, 'seed': 2}
    assert len(settings) == 4


def test_failures_show_in_the_exit_status(tmp_path, capsys):
    assert command(tmp_path/'study', '--scene', SCENE, '--set', 'broken=true', '--replicas', 1,
                   '--length', 1, '--platform', 'Reference', '--quiet') == 1
    assert 'this scene is broken on purpose' in capsys.readouterr().out


def test_sigterm_ends_the_command_as_ctrl_c_does(tmp_path):
    """Batch systems send it when the time is over."""
    directory = tmp_path/'study'
    process = subprocess.Popen([
        sys.executable, '-m', 'openmmrigidhi.ensemble',
        str(directory), '--scene', SCENE, '--observables', 'ensemble_tasks:energyOfTheSlow',
        '--length', '100', '--platform', 'Reference', '--replicas', '1', '--checkpoint', '0',
        '--quiet'
    ], env=dict(os.environ, PYTHONPATH=os.pathsep.join([os.path.dirname(__file__), *sys.path])),
                               stdout=subprocess.PIPE, text=True)
    try:
        waitFor(lambda: (directory/'tasks'/'s0000_r0000.h5').exists())
        process.terminate()
        output = process.communicate(timeout=60)[0]
    finally:
        process.kill()
    assert process.returncode == 1 and '1 unfinished' in output
    assert ensemble.read(directory).about['sessions'][-1]['interrupted']


def test_ctrl_c_keeps_what_was_saved(tmp_path, undisturbed):
    """After a SIGINT while two processes compute, the program ends soon, and keeps the results so
    far."""
    directory = tmp_path/'study'
    # In the background of a shell the signal is ignored, and programs that the tests start inherit
    # this setting.
    script = (f'import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); '
              f'sys.path.insert(0, {os.path.dirname(__file__)!r})\n'
              'from ensemble_support import small\n'
              "if __name__ == '__main__':\n"
              f"    small(['ensemble_tasks:energyOfTheSlow'], length=100.0, "
              f"replicas=2).run({str(directory)!r}, 2, 'processes', quiet=True)\n"
              "    print('ended by itself')")
    path = tmp_path/'script.py'
    path.write_text(script)
    process = subprocess.Popen([sys.executable, str(path)],
                               env=dict(os.environ, PYTHONPATH=os.pathsep.join(sys.path)),
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        waitFor(lambda: all((directory/'tasks'/f's0000_r000{k}.h5').exists() for k in (0, 1)))
        process.send_signal(signal.SIGINT)
        printed, errors = process.communicate(timeout=60)
        assert printed == 'ended by itself\n' and process.returncode == 0
        assert 'the run was interrupted, and result.isComplete is False' in errors
    finally:
        process.kill()
    result = ensemble.read(directory)
    assert [task.status for task in result.tasks
            ] == ['unfinished']*2 and result.about['sessions'][-1]['interrupted']
    for replica in range(2):
        known = min(result.tasks[replica].samples, 60)
        assert np.array_equal(
            result.series('energyOfTheSlow', 0, replica)[:known],
            undisturbed.series('energy', 0, replica)[:known])
