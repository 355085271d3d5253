"""openmmrigidhi.ensemble: many tasks in many processes. Workers that die or go away lose nothing
but their own task, and whoever takes processes from here gets the same numbers."""
import importlib.util
import math
import os
import signal
import socket
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import ensemble_tasks
from ensemble_support import CLUSTERS, distributed, needsDask, small, waitFor
from openmmrigidhi import _loading, _tasks, accuracy, ensemble
from openmmrigidhi.accuracy import scenes
from openmmrigidhi.accuracy.measurement import Run
from openmmrigidhi.ensemble import simulation, tasks

pytest_plugins = ['ensemble_fixtures']
pytestmark = pytest.mark.usefixtures('shortTimes', 'marks')

# ---- The lower layer -----------------------------------------------------------------------------


@pytest.mark.parametrize('where', [None, *CLUSTERS], indirect=True)
def test_a_task_that_throws_is_reported_and_the_rest_goes_on(where):
    seen = []
    outcomes = tasks.run(ensemble_tasks.throwAtThree, range(5), 1 if where is None else 2, where,
                         names='abcde', quiet=True, finished=seen.append)
    assert [outcome.value for outcome in outcomes] == [0, 1, 4, None, 16]
    assert sorted(outcome.index for outcome in seen) == list(range(5))
    failure = outcomes[3].failure
    assert (failure.kind,
            failure.message) == ('ValueError',
                                 'three is not wanted here') and 'throwAtThree' in failure.traceback
    with pytest.raises(tasks.TaskError, match='task d: it failed with ValueError: three is not'):
        outcomes[3].get()


@pytest.mark.parametrize('where', CLUSTERS, indirect=True)
def test_a_task_that_kills_every_worker_is_given_up(where):
    """Dead workers are replaced and each attempt is counted, up to a largest number of attempts."""
    outcomes = tasks.run(ensemble_tasks.alwaysDie, range(4), 2, where, retries=1, quiet=True)
    assert [outcome.value for outcome in outcomes] == [0, None, 2, 3]
    failure = outcomes[1].failure
    assert failure.kind == 'WorkerDied'
    assert 'are not made: look for what ends the process' in failure.message
    # The scheduler would allow 3 failures. It has begun another attempt before the library ends the
    # task.
    assert outcomes[1].attempts == (2 if where == 'processes' else 3)


def test_workers_that_die_before_they_begin_count_less(monkeypatch):
    """Starting takes longer than anything else on a busy machine, and the task has no part in it.
    A task that never begins is given up, too."""
    monkeypatch.setattr(_tasks, 'UNBORN', 2)
    for times, dead in ((2, 0), (100, 3)):
        outcome, = tasks.run(ensemble_tasks.returnIt, [ensemble_tasks.Stillborn(times)], 2,
                             'processes', retries=0, quiet=True)
        if dead:
            assert f'{dead} workers died with it' in outcome.failure.message
        else:
            assert outcome.get() == times and outcome.attempts == 1


@pytest.mark.parametrize('where', CLUSTERS, indirect=True)
def test_a_task_goes_on_from_what_is_in_its_directory(where, tmp_path):
    outcomes = tasks.run(ensemble_tasks.countInDirectory, range(2), 2, where,
                         directory=str(tmp_path/'own'), quiet=True)
    assert [outcome.get() for outcome in outcomes] == [3, 0]
    assert outcomes[0].attempts == 2
    # A result that was still on the dead worker is computed again.
    assert outcomes[1].attempts in (1, 2)
    assert (tmp_path/'own'/'0'/'count').read_text() == '6'


@pytest.mark.parametrize('where', CLUSTERS, indirect=True)
def test_workers_that_die_are_no_end_where_each_comes_further(where, tmp_path):
    """With one retry a task may die three times, because it makes progress before each death."""
    outcome, = tasks.run(ensemble_tasks.dieOften, [0], 2, where, directory=str(tmp_path),
                         amounts=[3], retries=1, quiet=True)
    assert outcome.get() == 3 and outcome.attempts == 4


@pytest.mark.parametrize('plan, progress',
                         [([(0, 100), (20, 80), (40, 90), (50, 70), (60, 95)], [1, 1, 1, 1, 1]),
                          ([(0, 100), (50, 100), (75, 101), (90, 100)], [1, 0, 0, 0]),
                          ([(0, 100), (0, 80), (0, 90), (0, 70), (0, 120)], [1, 0, 0, 0, 1]),
                          ([(0, 0), (0, 0), None, (0, 3)], [0, 0, 0, 1]),
                          ([(1, 1), (2, 2), (4, 5), (6, 6), (7, 7)], [1, 1, 1, 1, 1])])
def test_progress_is_what_was_saved(plan, progress):
    """Attempts, each with the position where it begins and the one where it dies. Workers that die
    before the furthest position make progress where they begin later than those before, which shows
    that more was saved; but not where they die at one place, within what is done between two
    reports (here 1)."""
    attempts, found = _tasks._Attempts(), []
    for each in plan:
        attempts.start()
        for position in () if each is None else range(each[0], each[1] + 1):
            attempts.report(position)
        found.append(attempts.end())
        assert attempts.fruitless == 0 if found[-1] else attempts.fruitless > 0
    assert found == [bool(each) for each in progress]


def fate(lifetimes, need=math.inf, place=math.inf, saves=True):
    """The fate of a task, simulated: whether it is done (None: not yet), and attempts.

    Workers take 2 s to begin, then do 1 unit a second and report twice a second, and save as
    ensemble tasks do, if at all. They die after their lifetimes, or at a place.
    """
    attempts, saved, tick = _tasks._Attempts(), 0.0, 0.1
    for life in lifetimes:
        attempts.start()
        now, position, reported = 2.0, saved, -math.inf
        times = simulation.CheckpointTimes(60.0, now)
        while now < life and position < place:
            if position >= need:
                return True, attempts.starts
            if now - reported > 0.5:
                attempts.report(position)
                reported = now
            now, position = now + tick, position + tick
            if saves and times.isDue(now):
                saved = position
                times.saved(now, now)
        attempts.end()
        if attempts.fruitless > _tasks.RETRIES:
            return False, attempts.starts
    return None, attempts.starts


def test_workers_that_are_killed_at_random_are_no_end():
    """Workers live for 10 s to 10 min on average, with 60 s between checkpoints; the task takes
    half an hour. An attempt without progress dies before its first checkpoint, about 3 s after its
    start: with probability 0.26 at most, so 11 in a row are expected in less than 2000*0.26^11 =
    8e-4 of all tasks, and hardly among these 60."""
    rng = np.random.default_rng(11)
    for mean in (10.0, 60.0, 600.0):
        for _ in range(20):
            assert fate(rng.exponential(mean, 10000), 1800.0)[0]


def test_tasks_that_kill_their_workers_are_given_up():
    """At one place: the checkpoints come closer to it with each attempt, to half the distance at
    least (the last wait is as long as those before together, at most), and this is no progress.
    Without checkpoints it is the same at random places, as of a process that grows: only records
    count, of which there are few (ln n among n)."""
    for place in (0.0, 0.3, 5.0, 200.0, 1000.0):
        done, attempts = fate([math.inf]*100, place=place)
        assert done is False and attempts <= _tasks.RETRIES + 3
    rng = np.random.default_rng(12)
    for _ in range(20):
        done, attempts = fate(rng.exponential(100.0, 1000), saves=False)
        assert done is False and attempts < 100


@pytest.mark.parametrize('where, jobs',
                         [('processes', 1),
                          ('processes', 3), *([('local', 3)] if distributed else [])])
def test_as_many_at_a_time_as_there_are_jobs(where, jobs):
    """With 1 or 3 jobs exactly 1 or 3 tasks run at a time, whatever the number of processors. Tasks
    wait until this number has begun, or until a deadline."""
    begun = [
        outcome.get() for outcome in tasks.run(ensemble_tasks.countTogether, [(
            jobs, k) for k in range(max(2, jobs))], jobs, where, quiet=True)
    ]
    assert max(begun) == jobs


def test_values_that_cannot_be_sent_and_exits_are_failures():
    outcome, = tasks.run(ensemble_tasks.unpicklable, [1], 2, 'processes', quiet=True)
    assert outcome.failure is not None and outcome.failure.message.startswith(
        'what it returned cannot be pickled: ')
    outcome, = tasks.run(ensemble_tasks.leave, [1], 2, 'processes', quiet=True)
    assert (outcome.failure.kind, outcome.failure.message) == ('SystemExit', 'leaving')


@pytest.mark.parametrize('where', CLUSTERS, indirect=True)
def test_a_value_that_cannot_be_unpickled_is_the_failure_of_its_task_alone(where):
    outcomes = tasks.run(ensemble_tasks.fragileOne, range(4), 2, where, quiet=True)
    assert [outcome.value for outcome in outcomes] == [0, None, 2, 3]
    assert outcomes[1].failure.kind == 'RuntimeError' and outcomes[1].failure.message.startswith(
        'what it returned cannot be unpickled in this process: this breaks on purpose: return ')


@pytest.mark.parametrize('how', ['stdin', '-c'])
def test_functions_that_other_processes_cannot_import(how):
    """Other processes cannot import a program from stdin, so they do not find its functions, which
    they say at once. Functions of modules are no trouble."""
    script = (f'import sys; sys.path.insert(0, {os.path.dirname(__file__)!r})\n'
              'import ensemble_tasks\nfrom openmmrigidhi.ensemble import tasks\n'
              'def own(x, job):\n    return x\n\n'
              'for function in (own, ensemble_tasks.square):\n'
              "    for each in tasks.run(function, [3], 2, 'processes', quiet=True):\n"
              '        print(each.attempts, each.value, each.failure and each.failure.message)\n')
    finished = subprocess.run([sys.executable, *(['-'] if how == 'stdin' else ['-c', script])],
                              input=script, capture_output=True, text=True, timeout=120,
                              env=dict(os.environ, PYTHONPATH=os.pathsep.join(sys.path)))
    first, second = finished.stdout.splitlines()
    assert first.startswith('1 None the function or its argument cannot be unpickled in another')
    assert first.endswith('put them into a file of their own, or use jobs=1')
    assert second == '1 9 None' and not finished.stderr


def test_without_dask_there_are_plain_processes(monkeypatch):
    monkeypatch.setattr(importlib.util, 'find_spec', lambda name: None)
    assert isinstance(_tasks._backend(ensemble_tasks.square, 2, None, 3, 1), _tasks._Processes)
    with pytest.raises(ImportError, match='is not installed, which talks to clusters'):
        tasks.run(ensemble_tasks.square, [1], cluster='tcp://127.0.0.1:1')


@pytest.mark.parametrize('wrong, text',
                         [(dict(jobs=0), 'whole number of 1 or more'),
                          (dict(retries=-1), 'it must be a whole number of 0 or more'),
                          (dict(names=['a', 'a']), 'each task needs a name of its own')])
def test_wrong_numbers_are_refused(wrong, text):
    with pytest.raises(ValueError, match=text):
        tasks.run(ensemble_tasks.square, [1, 2], **wrong)


def test_no_tasks_are_no_trouble():
    assert tasks.run(ensemble_tasks.square, [], 2) == []


@needsDask
@pytest.mark.parametrize('listens', [False, True], ids=['nobody', 'someone who is silent'])
def test_a_cluster_that_does_not_answer(listens):
    with socket.socket() as server:
        server.bind(('127.0.0.1', 0))
        if listens:
            server.listen()
        began = time.monotonic()
        with pytest.raises(ConnectionError, match='it gave no answer within 1 s'):
            tasks.run(ensemble_tasks.square, [1],
                      cluster=f'tcp://127.0.0.1:{server.getsockname()[1]}', timeout=1.0, quiet=True)
        assert time.monotonic() - began < 15


@needsDask
def test_a_cluster_without_workers():
    scheduler = {
        'cls': distributed.Scheduler,
        'options': {
            'host': '127.0.0.1',
            'dashboard_address': '127.0.0.1:0'
        }
    }
    with distributed.SpecCluster(scheduler=scheduler, workers={}, silence_logs=50) as empty:
        with pytest.raises(ConnectionError, match='no worker came within 0.5 s'):
            tasks.run(ensemble_tasks.square, [1], cluster=empty.scheduler_address, timeout=0.5,
                      quiet=True)


@needsDask
def test_workers_without_the_plugin_or_with_another_version(cluster, monkeypatch):
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1,
                                  dashboard_address='127.0.0.1:0', silence_logs=50,
                                  memory_limit=0) as other:
        with distributed.Client(other, set_as_default=False) as client:
            # On this worker openmmrigidhi is as if it had never been installed.
            client.run(exec, "import sys; sys.modules['openmmrigidhi'] = None")
        with pytest.raises(ImportError, match='cannot import openmmrigidhi .*every worker must'):
            tasks.run(ensemble_tasks.square, [1], cluster=other.scheduler_address, quiet=True)
    monkeypatch.setattr(_loading, 'version', '99.0')
    with pytest.raises(ImportError, match='it must be 99.0, as here: install'):
        tasks.run(ensemble_tasks.square, [1], cluster=cluster.scheduler_address, quiet=True)


@needsDask
def test_workers_that_come_late_are_checked(tmp_path, capfd):
    """A worker without the plugin that joins while a study runs gets no tasks. It would fail each
    at once, and so take all that are left."""
    directory = tmp_path/'study'
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1,
                                  dashboard_address='127.0.0.1:0', silence_logs=50,
                                  memory_limit=0) as cluster:

        def join():
            waitFor(lambda: (directory/'tasks'/'s0000_r0000.h5').exists())
            preload = tmp_path/'preload.py'
            preload.write_text("import sys; sys.modules['openmmrigidhi'] = None")
            process.append(
                subprocess.Popen([
                    sys.executable, '-m', 'distributed.cli.dask_worker', cluster.scheduler_address,
                    '--no-nanny', '--nthreads', '1', '--no-dashboard', '--preload',
                    str(preload), '--local-directory',
                    str(tmp_path)
                ], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
            waitFor(lambda: len(cluster.scheduler.workers) == 2)

        def wait(record):
            thread.join()

        process, thread = [], threading.Thread(target=join)
        thread.start()
        try:
            result = small(['ensemble_tasks:energyOfTheSlow'],
                           replicas=3).run(str(directory), cluster=cluster.scheduler_address,
                                           finished=wait)
        finally:
            thread.join()
            for each in process:
                each.kill()
                each.wait()
    assert result.isComplete
    assert 'cannot import openmmrigidhi' in capfd.readouterr().err


#: A script that starts a scheduler with a worker. Both end with this process.
CLUSTER_SCRIPT = """
import distributed, sys, time
if __name__ == '__main__':
    made = distributed.LocalCluster(n_workers=1, threads_per_worker=1,
                                    dashboard_address='127.0.0.1:0', memory_limit=0,
                                    silence_logs=50)
    print(made.scheduler_address, flush=True)
    sys.stdin.readline()
    made.scale(0)
    time.sleep(100)
"""


@needsDask
@pytest.mark.parametrize('what, text', [('workers', 'it has had no worker for 2 s'),
                                        ('scheduler', 'connection to its scheduler was lost'),
                                        ('silent scheduler', r'was lost \(no answer within 2 s\)')])
def test_a_cluster_that_goes_away_is_an_error(what, text, tmp_path, monkeypatch):
    """If the workers or the scheduler end, or the scheduler hangs, the call ends with an error, and
    saved results are kept."""
    monkeypatch.setattr(_tasks, 'LEAST_PATIENCE', 2.0 if what == 'silent scheduler' else 10.0)
    script, directory = tmp_path/'cluster.py', tmp_path/'study'
    script.write_text(CLUSTER_SCRIPT)
    process = subprocess.Popen([sys.executable, str(script)], env=dict(
        os.environ, PYTHONPATH=os.pathsep.join(sys.path)), stdin=subprocess.PIPE,
                               stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    address = process.stdout.readline().strip()

    def destroy():
        waitFor(lambda: (directory/'tasks'/'s0000_r0000.h5').exists())
        if what == 'workers':
            process.stdin.write('\n')
            process.stdin.flush()
        elif what == 'scheduler':
            process.kill()
        else:
            process.send_signal(signal.SIGSTOP)

    thread = threading.Thread(target=destroy)
    thread.start()
    try:
        with pytest.raises(ConnectionError, match=text):
            small(['ensemble_tasks:energyOfTheSlow'], replicas=1,
                  length=100.0).run(str(directory), cluster=address, timeout=2.0, quiet=True)
    finally:
        thread.join()
        process.kill()
        process.communicate()
    found = ensemble.read(directory)
    assert found.tasks[0].status == 'unfinished' and found.about['sessions'][-1]['failed'] == 0


# ---- Who else takes its processes from here ------------------------------------------------------


def withoutTimes(rows):
    times = ('ns_per', 'seconds', 'speeds', 'effective_per', 'platform', 'solver')
    return [{key: value for key, value in row.items() if not key.startswith(times)} for row in rows]


@pytest.fixture(scope='module')
def oneAfterTheOther():
    """A study of accuracy, and its result in this process."""
    study = accuracy.StepSizeStudy(scenes.trap(5), ['LangevinC'], [0.004, 0.008],
                                   platform='Reference')
    return study, study.run(length=3, rounds=2)


@pytest.mark.parametrize('where', CLUSTERS, indirect=True)
def test_accuracy_gives_the_same_numbers_whoever_makes_its_runs(where, oneAfterTheOther):
    study, one = oneAfterTheOther
    two = study.run(length=3, rounds=2, jobs=2, cluster=where)
    assert withoutTimes(two.rows) == withoutTimes(one.rows)
    assert all(row['ns_per_day'] > 0 for row in two.rows)


@pytest.mark.parametrize('where', CLUSTERS, indirect=True)
def test_the_ladder_gives_the_same_numbers_whoever_computes_mobilities(where):
    study = accuracy.LadderStudy(scenes.pairs([0.1, 1.0]),
                                 ['RPY', 'FTS', 'FTS+lubrication', 'multiblob12', 'ForceCoupling'])
    one, two = study.run(rounds=1), study.run(rounds=1, jobs=2, cluster=where)
    assert withoutTimes(two.rows) == withoutTimes(one.rows)
    assert {row['status'] for row in two.rows} == {'stable', 'not applicable'}


def test_times_that_end_where_the_runs_did_not(monkeypatch):
    """After parallel runs each run is timed from its start. If this start explodes there are no
    times, but the samples stay."""
    advance = Run.advance

    def explode(self, samples, record=True, progress=None):
        if record:
            self.end('unstable', 'exploded on purpose')
        else:
            advance(self, samples, record, progress)

    monkeypatch.setattr(Run, 'advance', explode)
    rows = accuracy.StepSizeStudy(scenes.trap(3), ['LangevinC'], [0.004],
                                  platform='Reference').run(length=2, jobs=2,
                                                            cluster='processes').rows
    assert rows[0]['status'] == 'stable' and rows[0][
        'samples'] == 40 and rows[0]['ns_per_day'] is None


def test_a_run_of_accuracy_that_fails_leaves_the_others(capsys):
    study = accuracy.StepSizeStudy(
        scenes.trap(3), ['LangevinC'], [0.004, 0.008], platform='Reference',
        observables=['energy_group_0', 'ensemble_tasks:exitsAtLargeSteps'])
    result = study.run(length=2, jobs=2, cluster='processes')
    short, long = [row for row in result.rows if row['observable'] == 'energy_group_0']
    assert short['status'] == 'stable' and short['mean'] > 0 and short['ns_per_day'] > 0
    assert (long['status'], long['message'], long['mean']) == ('failed', 'SystemExit: leaving',
                                                               None)
    assert 'LangevinC failed at 8 fs: SystemExit: leaving.' in result.report().paragraphs()


def test_ctrl_c_keeps_the_runs_of_accuracy_that_are_finished():
    """Ctrl-C comes when the first of two runs in other processes is finished."""
    def interrupt(done, total, text):
        raise KeyboardInterrupt

    study = accuracy.StepSizeStudy(scenes.trap(3), ['LangevinC'], [0.004, 0.008],
                                   platform='Reference', observables=['energy_group_0'])
    result = study.run(length=2, jobs=2, cluster='processes', progress=interrupt)
    rows = sorted(result.rows, key=lambda row: row['status'])
    assert [row['status'] for row in rows] == ['not run', 'stable']
    assert rows[0]['mean'] is None and 'interrupted' in rows[0]['message']
    assert rows[1]['mean'] > 0 and rows[1]['ns_per_day'] > 0
    assert any('LangevinC did not come to its end at' in text
               for text in result.report().paragraphs())


def test_a_run_of_accuracy_that_fails_names_its_setting(capsys):
    from openmmrigidhi.accuracy import cli as accuracyCli
    assert accuracyCli.main([
        '--scene', 'trap', '--bodies', '3', '--platform', 'Reference', '--length', '1', '--jobs',
        '2', '--cluster', 'processes', '--methods', 'LangevinC', '--steps', '4', '--observables',
        'ensemble_tasks:exits', '--quiet'
    ]) == 2
    assert 'task LangevinC 4 fs: it failed with SystemExit' in capsys.readouterr().err
