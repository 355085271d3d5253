"""openmmrigidhi.ensemble: no results are lost when workers die, and numbers do not depend on the
processes that compute them."""
import contextlib
import errno
import fcntl
import importlib.util
import json
import math
import os
import resource
import signal
import socket
import subprocess
import sys
import threading
import time
import types

import numpy as np
import pytest

import ensemble_tasks
from openmmrigidhi import _loading, _tasks, accuracy, ensemble
from openmmrigidhi.accuracy import scenes
from openmmrigidhi.accuracy.measurement import Run
from openmmrigidhi.analysis import series as seriesModule
from openmmrigidhi.ensemble import cli, simulation, study as studyModule, taskfiles, tasks
from openmmrigidhi.ensemble.result import EnsembleResult, TaskRecord

try:
    import distributed
except ImportError:
    distributed = None

#: The ways to compute: plain processes, and two workers behind a scheduler.
CLUSTERS = ['processes', *(['scheduler'] if distributed else [])]
needsDask = pytest.mark.skipif(distributed is None, reason='dask.distributed is not installed')
SCENE = 'ensemble_tasks:scene'


@pytest.fixture(scope='module')
def folderOfMarks(tmp_path_factory):
    """Where tasks in other processes leave marks."""
    folder = tmp_path_factory.mktemp('marks')
    before = os.environ.get(ensemble_tasks.MARKS)
    os.environ[ensemble_tasks.MARKS] = str(folder)
    yield folder
    del os.environ[ensemble_tasks.MARKS]
    if before is not None:
        os.environ[ensemble_tasks.MARKS] = before


@pytest.fixture(autouse=True)
def marks(folderOfMarks):
    """The directory of marks, emptied for each test."""
    for path in folderOfMarks.iterdir():
        path.unlink()
    return folderOfMarks


@pytest.fixture(scope='module')
def clusters(folderOfMarks):
    """The clusters that were made. The last one is in use."""
    if distributed is None:
        pytest.skip('dask.distributed is not installed')
    with contextlib.ExitStack() as made:
        yield made, []


@pytest.fixture
def cluster(clusters):
    """Two workers behind a scheduler that has an address.

    Tests kill workers. If the workers do not come back on a busy machine, the next test gets
    another cluster.
    """
    made, last = clusters
    deadline = time.monotonic() + 20
    while last and len(last[-1].scheduler.workers) < 2 and time.monotonic() < deadline:
        time.sleep(0.1)
    if not last or len(last[-1].scheduler.workers) < 2:
        last.append(
            made.enter_context(
                distributed.LocalCluster(n_workers=2, threads_per_worker=1,
                                         dashboard_address='127.0.0.1:0', memory_limit=0,
                                         silence_logs=50)))
    return last[-1]


@pytest.fixture
def where(request):
    """The argument `cluster` of run()."""
    return request.getfixturevalue(
        'cluster').scheduler_address if request.param == 'scheduler' else request.param


def small(observables=('ensemble_tasks:energy',), length=3.0, replicas=3, **kwargs):
    kwargs.setdefault('settings', ({},))
    return ensemble.Study(SCENE, replicas=replicas, length=length, observables=observables,
                          platform='Reference', checkpointInterval=0.0, equilibration=0.5, **kwargs)


def samples(result):
    """All series by setting and replica, for any name of the observable."""
    return {(task.setting, task.replica): result.series(next(iter(result.observables)),
                                                        task.setting, task.replica)
            for task in result.tasks}


def same(one, other):
    return one.keys() == other.keys() and all(np.array_equal(one[key], other[key]) for key in one)


@pytest.fixture(scope='module')
def undisturbed(tmp_path_factory):
    """The result of three replicas, one after the other in this process, without checkpoints in
    between."""
    study = small()
    study.checkpointInterval = 1e9
    result = study.run(str(tmp_path_factory.mktemp('undisturbed')), quiet=True)
    assert result.isComplete and [len(each) for each in samples(result).values()] == [60, 60, 60]
    return result


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
    """With one retry a task may die four times, because it makes progress before each death."""
    outcome, = tasks.run(ensemble_tasks.dieOften, [0], 2, where, directory=str(tmp_path),
                         amounts=[4], retries=1, quiet=True)
    assert outcome.get() == 4 and outcome.attempts == 5


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


@pytest.mark.parametrize('where', ['processes', *(['local'] if distributed else [])])
def test_as_many_at_a_time_as_there_are_jobs(where):
    """With 1 or 3 jobs exactly 1 or 3 tasks run at a time, whatever the number of processors. Tasks
    wait until this number has begun, or until a deadline."""
    for jobs in (1, 3):
        begun = [
            outcome.get() for outcome in tasks.run(ensemble_tasks.countTogether, [(
                jobs, k) for k in range(3)], jobs, where, quiet=True)
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
                          (dict(retries=-1), 'a number of retries from 0 on'),
                          (dict(names=['a', 'a']), 'each task needs one of its own')])
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
                           replicas=4).run(str(directory), cluster=cluster.scheduler_address,
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


def waitFor(condition, seconds=60):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, 'it did not happen'
        time.sleep(0.05)


# ---- Studies: the same numbers, whoever computes them --------------------------------------------


@pytest.mark.parametrize('where', CLUSTERS, indirect=True)
def test_two_workers_give_the_same_numbers(where, undisturbed, tmp_path):
    result = small().run(str(tmp_path/'study'), 2, where, quiet=True)
    assert same(samples(result), samples(undisturbed))
    assert result.rows == undisturbed.rows


@pytest.mark.parametrize('where', ['processes', *(['local'] if distributed else [])])
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


@pytest.mark.parametrize('where', ['processes', *(['local'] if distributed else [])])
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
    script = (
        f'import sys; sys.path.insert(0, {os.path.dirname(__file__)!r})\nfrom test_ensemble import '
        f'small\n'
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


# ---- What goes wrong -----------------------------------------------------------------------------


def test_a_failing_setting_is_reported_and_the_rest_goes_on(tmp_path):
    study = small(settings=[{}, {'broken': True}], replicas=2, length=1.0)
    result = study.run(str(tmp_path/'study'), quiet=True)
    assert [task.status for task in result.tasks] == ['complete', 'complete', 'failed', 'failed']
    failed = result.problems()[0]
    assert failed.seed == ensemble.taskSeed(1, 1, 0) and failed.settings == {'broken': True}
    assert ('ArithmeticError: this scene is broken on purpose' in failed.message
            and 'in scene' in failed.traceback)
    assert str(failed.seed) in result.table() and '2 failed' in result.row('energy', 1)['note']
    assert result.row('energy', 1)['mean'] is None and result.row('energy', 0)['replicas'] == 2


def test_what_failed_is_tried_again_from_its_checkpoint(undisturbed, tmp_path):
    directory = str(tmp_path/'study')
    study = small(['ensemble_tasks:energyOrNot'])
    first = study.run(directory, quiet=True)
    assert [task.status for task in first.tasks] == ['failed', 'complete', 'complete']
    assert first.tasks[0].samples == 20 and first.row('energyOrNot')['replicas'] == 2
    second = study.run(directory, quiet=True)
    assert second.isComplete and not second.about['failures']
    assert same(samples(second), samples(undisturbed))


def test_an_observable_that_is_infinite(tmp_path):
    result = small(['ensemble_tasks:infinite'], replicas=1).run(str(tmp_path/'study'), quiet=True)
    assert 'it must be finite: the run may have exploded' in result.tasks[0].message


def test_damaged_files_are_named_and_the_rest_is_used(undisturbed, tmp_path):
    directory = tmp_path/'study'
    study = small()
    whole = study.run(str(directory), quiet=True)
    path = directory/'tasks'/'s0000_r0001.h5'
    path.write_bytes(path.read_bytes()[:1000])
    damaged = ensemble.read(directory)
    assert [task.status for task in damaged.tasks] == ['complete', 'damaged', 'complete']
    assert 's0000_r0001.h5: it is damaged' in damaged.table() and damaged.row(
        'energy')['replicas'] == 2
    assert np.array_equal(damaged.series('energy', 0, 2), whole.series('energy', 0, 2))
    with pytest.raises(ValueError, match='there are no samples of .*, of a task that has begun'):
        damaged.series('energy', 0, 1)
    again = study.run(str(directory), quiet=True)
    assert same(samples(again), samples(undisturbed))
    assert (directory/'tasks'/'s0000_r0001.h5.damaged1').stat().st_size == 1000
    assert again.about['sessions'][-1]['put_aside'] == [
        str(directory/'tasks'/'s0000_r0001.h5.damaged1')
    ]


def test_files_that_cannot_be_read_are_named_and_stay_where_they_are(tmp_path, monkeypatch):
    directory = tmp_path/'study'
    study = small()
    study.run(str(directory), quiet=True)
    path = directory/'tasks'/'s0000_r0001.h5'
    before = path.read_bytes()
    # Root may read everything, so the system's refusal is made up.
    plain = open

    def refuse(name, *arguments, **keywords):
        if str(name) == str(path):
            raise PermissionError(errno.EACCES, 'Permission denied')
        return plain(name, *arguments, **keywords)

    monkeypatch.setattr('builtins.open', refuse)
    found = ensemble.read(directory)
    assert [task.status for task in found.tasks] == ['complete', 'damaged', 'complete']
    assert r's0000_r0001.h5: it cannot be read (Permission denied)' in found.tasks[1].message
    with pytest.raises(taskfiles.UnreadableFile, match='it cannot be read .Permission denied'):
        study.run(str(directory), quiet=True)
    monkeypatch.undo()
    assert path.read_bytes() == before
    assert not list(path.parent.glob('*.damaged*'))


def test_files_that_others_have_locked_are_read(tmp_path):
    directory = tmp_path/'study'
    small(replicas=1, length=0.2).run(str(directory), quiet=True)
    with open(directory/'tasks'/'s0000_r0000.h5', 'rb') as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert [task.status for task in ensemble.read(directory).tasks] == ['complete']


def test_a_file_where_a_directory_should_be(tmp_path):
    (tmp_path/'study').mkdir()
    (tmp_path/'study'/'tasks').write_text('')
    with pytest.raises(NotADirectoryError, match='tasks: it is, or is below, a file; it must be'):
        small(replicas=1, length=0.2).run(str(tmp_path/'study'), quiet=True)
    (tmp_path/'file').write_text('')
    with pytest.raises(NotADirectoryError, match='it is, or is below, a file; it must be a direct'):
        small(replicas=1, length=0.2).run(str(tmp_path/'file'), quiet=True)


def test_a_file_system_without_locks(tmp_path, monkeypatch):
    def refuse(*arguments):
        raise OSError(errno.ENOLCK, 'No locks available')

    monkeypatch.setattr(fcntl, 'flock', refuse)
    with pytest.raises(OSError, match='it cannot be locked .No locks available.; its file system'):
        small(replicas=1, length=0.2).run(str(tmp_path/'study'), quiet=True)


def test_every_flipped_byte_that_matters_is_noticed(undisturbed, tmp_path):
    """One wrong byte anywhere: the file is refused, or its content is unchanged."""
    source = undisturbed.tasks[0].path
    good, data = taskfiles.load(source), open(source, 'rb').read()
    rng, refused = np.random.default_rng(1), 0
    path = str(tmp_path/'flipped.h5')
    for place in rng.choice(len(data), 150, replace=False):
        flipped = bytearray(data)
        flipped[place] ^= 1 << int(rng.integers(8))
        with open(path, 'wb') as file:
            file.write(flipped)
        try:
            found = taskfiles.load(path)
        except taskfiles.DamagedFile as error:
            refused += 1
            assert 'flipped.h5: it is damaged' in str(
                error) and 'it must be a whole file of a task' in str(error)
        else:
            assert found.about == good.about and found.state == good.state and same(
                found.series, good.series)
    print(f'{refused} of 150 were refused')
    # Nearly half of the bytes of so small a file have no meaning.
    assert refused > 50


def test_files_of_other_formats_and_with_missing_samples(undisturbed, tmp_path):
    path = str(tmp_path/'other.h5')
    content = taskfiles.load(undisturbed.tasks[0].path)
    content.about['samples'] += 1
    taskfiles.save(path, content)
    with pytest.raises(taskfiles.DamagedFile, match='60 samples where 61 are said to be'):
        taskfiles.load(path)
    import h5py
    with h5py.File(path, 'w') as file:
        file.attrs['format'] = 'something else'
    with pytest.raises(taskfiles.DamagedFile, match='its format is .something else. instead of'):
        taskfiles.load(path)
    assert taskfiles.load(str(tmp_path/'nothing.h5')) is None


def test_a_writer_that_fails_leaves_the_old_file(undisturbed, tmp_path, monkeypatch):
    path = str(tmp_path/'task.h5')
    content = taskfiles.load(undisturbed.tasks[0].path)
    taskfiles.save(path, content)
    before = open(path, 'rb').read()
    content.series['energy'] = ['not a number']
    with pytest.raises(ValueError):
        taskfiles.save(path, content)
    assert open(path, 'rb').read() == before and os.listdir(tmp_path/'..'/tmp_path.name) == sorted(
        os.listdir(tmp_path))
    assert not [name for name in os.listdir(tmp_path) if name.endswith('.part')]
    (tmp_path/'task.h5.host.1.part').write_text('')
    taskfiles.clean(str(tmp_path))
    assert not (tmp_path/'task.h5.host.1.part').exists()


def test_files_of_other_tasks_are_named(undisturbed, tmp_path):
    """A whole file at the wrong place: of another replica, setting, or study. It is not taken for
    the one that belongs there, and put aside."""
    directory, other = tmp_path/'study', tmp_path/'other'
    study = small(settings=[{}, {'temperature': 280.0}], replicas=2, length=1.0)
    whole = study.run(str(directory), quiet=True)
    small(settings=[{}, {'temperature': 280.0}], replicas=2, length=1.0).run(str(other), quiet=True)
    path = directory/'tasks'/'s0000_r0000.h5'
    for source, text in ((directory/'tasks'/'s0000_r0001.h5',
                          'it is of another task: its replica is 1 instead of 0'),
                         (directory/'tasks'/'s0001_r0000.h5', 'its setting is 1 instead of 0'),
                         (other/'tasks'/'s0000_r0000.h5', 'its study is ')):
        path.write_bytes(source.read_bytes())
        found = ensemble.read(directory)
        assert [task.status for task in found.tasks] == ['damaged', *['complete']*3]
        assert text in found.tasks[0].message and found.row('energy')['replicas'] == 1
        again = study.run(str(directory), quiet=True)
        assert again.isComplete and same(samples(again), samples(whole))


def test_files_of_earlier_versions_are_read(tmp_path):
    """They do not say of which study they are, and study.json has no checksum."""
    directory = tmp_path/'study'
    study = small(replicas=1, length=0.5)
    whole = study.run(str(directory), quiet=True)
    content = taskfiles.load(whole.tasks[0].path)
    del content.about['study']
    taskfiles.save(whole.tasks[0].path, content)
    about = json.loads((directory/'study.json').read_text())
    del about['checksum']
    (directory/'study.json').write_text(json.dumps(about))
    longer = study.extended(length=1.0).run(str(directory), extend=True, quiet=True)
    assert np.array_equal(longer.series('energy', 0, 0)[:10], whole.series('energy', 0, 0))
    assert taskfiles.load(whole.tasks[0].path).about['study'] == about['identity']
    content.about = {'samples': 10}
    taskfiles.save(whole.tasks[0].path, content)
    assert 'it does not say its setting' in ensemble.read(directory).tasks[0].message


def test_every_change_of_study_json_is_noticed(tmp_path):
    """A flipped bit, or a number or text that was changed, is refused: a wrong temperature there
    would be the one that the results are said to be of."""
    directory = tmp_path/'study'
    small(settings=[{'temperature': 280.0}], replicas=2, length=0.1).run(str(directory), quiet=True)
    path = directory/'study.json'
    data, good = path.read_bytes(), studyModule._read_about(directory)
    changed = [data.replace(b'280.0', b'281.0'), data.replace(b'"length": 0.1', b'"length": 0.2')]
    rng = np.random.default_rng(3)
    for place in rng.choice(len(data), 150, replace=False):
        flipped = bytearray(data)
        flipped[place] ^= 1 << int(rng.integers(8))
        changed.append(bytes(flipped))
    refused = 0
    for each in changed:
        path.write_bytes(each)
        try:
            found = studyModule._read_about(directory)
        except ValueError as error:
            refused += 1
            assert 'study.json: it is damaged' in str(error)
        else:
            # One bit may make another name of the checksum itself.
            assert all(found[key] == good[key] for key in good if key != 'checksum')
    # Blanks at the beginnings of lines have no meaning.
    assert refused > 75
    path.write_bytes(changed[0])
    with pytest.raises(ValueError, match='the one that its checksum is of'):
        ensemble.Study.load(directory)


def test_a_kept_scene_is_the_one_of_its_study(tmp_path):
    """A System that was changed in the directory, or another Scene, would give the replicas of an
    extension another System than the earlier ones have."""
    directory = tmp_path/'study'

    def study(scene):
        return ensemble.Study(scene, replicas=1, length=0.2, equilibration=0.1,
                              observables=['ensemble_tasks:energy'], platform='Reference')

    study(scenes.trap(3)).run(str(directory), quiet=True)
    for name, old, new in (('system.xml', 'mass="16"', 'mass="17"'),
                           ('integrator.xml', 'temperature="300"', 'temperature="301"'),
                           ('scene.json', '"sampleInterval": 0.05', '"sampleInterval": 0.06')):
        path = directory/'scene'/name
        whole = path.read_text()
        assert old in whole
        path.write_text(whole.replace(old, new, 1))
        with pytest.raises(ValueError, match='its checksum is not the one that the study has'):
            ensemble.Study.load(directory)
        path.write_text(whole)
    with pytest.raises(ValueError, match='its study has scene .*it must be the same'):
        study(scenes.trap(4)).run(str(directory), quiet=True)
    assert study(scenes.trap(3)).run(str(directory), quiet=True).isComplete
    # A study of an earlier version does not know the checksum.
    about = json.loads((directory/'study.json').read_text())
    del about['checksum'], about['definition']['scene']['sha256']
    (directory/'study.json').write_text(json.dumps(about))
    assert study(scenes.trap(3)).run(str(directory), quiet=True).isComplete
    assert ensemble.Study.load(directory).run(str(directory), quiet=True).isComplete


def test_other_files_are_not_replaced(tmp_path):
    (tmp_path/'results.csv').write_text('of another program')
    with pytest.raises(
            ValueError, match='no study.json; a study begins in an empty '
            'directory, so that it replaces no other files'):
        small(replicas=1, length=0.1).run(str(tmp_path), quiet=True)
    assert os.listdir(tmp_path) == ['results.csv']
    with pytest.raises(ValueError, match='jobs: got 0'):
        small(replicas=1, length=0.1).run(str(tmp_path/'study'), jobs=0)
    assert not (tmp_path/'study').exists()


@pytest.mark.parametrize('name', ['task.h5', 'study.json'])
def test_a_full_disk_is_named_and_loses_nothing(name, undisturbed, tmp_path, capfd):
    """The limit on the size of files stands for the disk."""
    path = str(tmp_path/name)
    content = taskfiles.load(undisturbed.tasks[0].path)

    def write():
        if name == 'study.json':
            taskfiles.write(path, b'x'*10000)
        else:
            taskfiles.save(path, content)

    write()
    before, limits = open(path, 'rb').read(), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, limits[1]))
    try:
        with pytest.raises(OSError, match=f'{name}: it cannot be written .*before is kept'):
            write()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert open(path, 'rb').read() == before and os.listdir(tmp_path) == [name]
    assert capfd.readouterr() == ('', '')


def test_a_platform_that_is_not_there_is_named(tmp_path):
    study = ensemble.Study(SCENE, replicas=1, length=0.1, platform='Quantum')
    result = study.run(str(tmp_path/'study'), quiet=True)
    assert "platform 'Quantum': OpenMM has none of this name" in result.tasks[0].message


def test_a_study_that_is_damaged_or_missing(tmp_path):
    directory = tmp_path/'study'
    with pytest.raises(FileNotFoundError, match='in it, so no study; give'):
        ensemble.read(directory)
    small(replicas=1, length=0.1).run(str(directory), quiet=True)
    about = (directory/'study.json').read_text()
    for text in (about[:200], '{}', json.dumps(dict(json.loads(about), seeds=None, definition=[]))):
        (directory/'study.json').write_text(text)
        with pytest.raises(ValueError,
                           match='study.json: it is damaged .*it must say what the study is'):
            ensemble.read(directory)
    (directory/'study.json').unlink()
    with pytest.raises(ValueError, match='it has tasks but no .*a study begins in an empty'):
        small(replicas=1, length=0.1).run(str(directory), quiet=True)


def test_another_study_in_the_directory_is_refused(tmp_path):
    directory = str(tmp_path/'study')
    small(replicas=2, length=0.2).run(directory, quiet=True)
    with pytest.raises(ValueError,
                       match='its study has seed 1, and this one 2; it must be the same'):
        small(replicas=2, length=0.2, seed=2).run(directory, extend=True, quiet=True)
    with pytest.raises(ValueError, match='nothing that is there may be left out'):
        small(replicas=1, length=0.2).run(directory, extend=True, quiet=True)
    with pytest.raises(ValueError, match='only an extension may change it: say extend=True'):
        small(replicas=3, length=0.2).run(directory, quiet=True)


def test_two_processes_do_not_run_one_study(tmp_path):
    directory = str(tmp_path/'study')
    study = small(replicas=1, length=0.2)
    study.run(directory, quiet=True)
    with studyModule._locked(directory):
        with pytest.raises(RuntimeError, match='another process runs this study at the moment'):
            study.run(directory, quiet=True)


def test_a_scene_that_has_changed_is_noticed(tmp_path, marks):
    directory = str(tmp_path/'study')
    study = ensemble.Study('ensemble_tasks:otherScene', replicas=1, length=1.0,
                           observables=['potential_energy'], platform='Reference')
    study.run(directory, quiet=True)
    (marks/'changed').touch()
    result = study.extended(length=2.0).run(directory, extend=True, quiet=True)
    assert 'makes another System or integrator now than when' in result.tasks[0].message
    assert result.tasks[0].samples == 20


def test_a_worker_that_does_not_see_the_directory(tmp_path):
    study, directory = small(replicas=1), str(tmp_path/'study')
    study.run(directory, quiet=True)
    larger = study.extended(length=4.0)
    about = studyModule._read_about(directory)
    task, = larger._left(directory, about)[0]
    task.study = 'another'
    outcome, = tasks.run(studyModule.simulate, [task], quiet=True)
    assert (outcome.failure.kind == 'FileNotFoundError'
            and 'it does not see the study in' in outcome.failure.message)


@pytest.mark.parametrize(
    'wrong, text', [(dict(scene='nothing'), 'module:function, a function or a Scene: correct'),
                    (dict(scene='nowhere:nothing'), 'which cannot be imported'),
                    (dict(scene='__main__:nothing'), 'it was defined in a script'),
                    (dict(observables=[]), 'one at least, and none twice'),
                    (dict(observables=['potential_energy']*2), 'one at least, and none twice'),
                    (dict(replicas=0), 'replicas: got 0, where a whole number from'),
                    (dict(replicas=1.5), 'replicas: got 1.5, where a whole number from'),
                    (dict(seed=-1), 'seed: got -1, where a whole number from'),
                    (dict(length=None), 'it must be a finite time above 0, in ps'),
                    (dict(length=math.inf), 'it must be a finite time above 0, in ps'),
                    (dict(checkpointInterval=-1), 'it must be a finite time above or at 0, in s'),
                    (dict(settings=[]), 'the list is empty; there must be one'),
                    (dict(settings=[{
                        'size': 3
                    }]), "got 'size', which the scene trap has not"),
                    (dict(settings=[{
                        'bodies': 3
                    }]*2), 'is there already; settings must differ')])
def test_wrong_studies_are_refused(wrong, text):
    with pytest.raises(ValueError, match=text):
        ensemble.Study(**{'scene': 'trap', 'length': 1.0, **wrong})


@pytest.mark.parametrize('name', ['time/box', '.', '', 'a\0b'])
def test_names_that_files_cannot_have_are_refused(name):
    observable = accuracy.Observable(name, 'time', 'ps', ensemble_tasks.energy)
    with pytest.raises(ValueError, match='it must be a text without / and other than'):
        ensemble.Study('trap', length=1.0, observables=[observable])


def test_settings_must_be_what_json_takes():
    with pytest.raises(TypeError, match='a number, a text, a truth value or a list'):
        ensemble.Study('trap', [{'bodies': {1, 2}}], length=1.0)


# ---- Numbers -------------------------------------------------------------------------------------


def test_means_and_errors_of_a_scene_whose_averages_are_known(tmp_path):
    """Two exact means are tested by Student's t of 6 replicas. With 5 degrees of freedom each
    exceeds 6.9 once in 1000."""
    study = ensemble.Study('trap', [{
        'bodies': 20
    }], 6, 10.0, ['energy_group_0', 'translational_temperature'], platform='Reference', seed=3)
    result = study.run(str(tmp_path/'study'), 2, 'processes', quiet=True)
    for row in result.rows:
        exact = 300.0 if row['exact'] is None else row['exact']
        t = (row['mean'] - exact)/row['standard_error']
        print(f'{row["observable"]}: t {t:.2f}, R-hat {row["r_hat"]:.4f}, '
              f'{row["effective_samples"]:.0f} effective samples')
        assert abs(t) < 6.9 and row['degrees'] == 5 and row['replicas'] == 6
        means = [result.series(row['observable'], 0, replica).mean() for replica in range(6)]
        assert row['mean'] == pytest.approx(np.mean(means), rel=1e-12)
        assert row['standard_error'] == pytest.approx(np.std(means, ddof=1)/math.sqrt(6), rel=1e-12)
        # 2.5706 is the 97.5 % point of Student's t at 5 degrees of freedom.
        assert row['high'] - row['mean'] == pytest.approx(2.5706*row['standard_error'], rel=1e-4)
        assert row['r_hat'] < 1.05
    lines = (tmp_path/'study'/'results.csv').read_text().splitlines()
    assert len(lines) == 3 and lines[0].startswith('setting,settings,observable')
    assert json.loads((tmp_path/'study'/'results.json').read_text())['rows'] == result.rows


def autoregressive(count, n, rho, rng):
    """Chains of variance 1 with autocorrelation rho^k."""
    noise = rng.normal(size=(n, count))
    chains = np.empty((n, count))
    chains[0] = noise[0]
    for k in range(1, n):
        chains[k] = rho*chains[k - 1] + math.sqrt(1 - rho*rho)*noise[k]
    return chains.T


def test_rhat_of_equal_chains_is_one():
    """For independent samples R-hat^2 - 1 is (B/W - 1)/n with B/W about F(7, inf). So R-hat exceeds
    1 + 24.3/7/n/2 once in 1000, and the folded R-hat too."""
    value = seriesModule.splitRHat(np.random.default_rng(1).normal(size=(4, 1000)))
    print(f'R-hat {value:.5f}')
    assert 0.999 < value < 1 + (24.3/7 - 1)/500/2 + 1e-3


def test_rhat_sees_means_widths_and_drifts():
    """R-hat of shifted chains has its exact value, and R-hat also detects widths and drifts.

    For two groups of chains at -d/2 and d/2 with small d, R-hat^2 is 1 + d^2/4 8/7.
    """
    rng = np.random.default_rng(2)
    chains = rng.normal(size=(4, 4000))
    d = 0.5
    shifted = chains + d*np.array([-0.5, -0.5, 0.5, 0.5])[:, None]
    # All normal scores together have variance 1. Of it d^2/4 of (1 + d^2/4) is between the halves
    # of chains, of which there are 8, with ddof 1.
    between = d*d/4/(1 + d*d/4)
    expected = math.sqrt(1 + 8/7*between/(1 - between))
    value = seriesModule.splitRHat(shifted)
    print(f'means: {value:.4f}, expected {expected:.4f}')
    assert value == pytest.approx(expected, abs=0.015)
    wide = chains*np.array([1, 1, 1, 3])[:, None]
    assert seriesModule._r_hat(
        seriesModule._normal_scores(wide)) < 1.01 < 1.1 < seriesModule.splitRHat(wide)
    assert seriesModule.splitRHat(chains[:1] + np.linspace(-1, 1, 4000)) > 1.2
    # R-hat depends only on ranks. So heavy tails, monotone functions and reflections do not change
    # it.
    bulk = seriesModule._r_hat(seriesModule._normal_scores(np.exp(5*shifted)))
    assert bulk == pytest.approx(seriesModule._r_hat(seriesModule._normal_scores(shifted)),
                                 rel=1e-12)


def test_rhat_by_hand():
    """The halves (1, 2), (3, 4), (5, 6), (7, 8) of two chains of four are their own ranks, which
    give the normal scores by hand."""
    from scipy.stats import norm
    chains = np.arange(1.0, 9).reshape(2, 4)
    z = norm.ppf((np.array([1, 2, 3, 4, 5, 6, 7, 8]) - 0.375)/8.25).reshape(4, 2)
    between, within = 2*np.var(z.mean(axis=1), ddof=1), np.var(z, axis=1, ddof=1).mean()
    assert seriesModule.splitRHat(chains) == pytest.approx(
        math.sqrt((0.5*within + between/2)/within), rel=1e-12)
    assert math.isnan(seriesModule.splitRHat(np.ones((2, 8))))
    with pytest.raises(ValueError, match='there must be rows of at least 4 samples'):
        seriesModule.splitRHat([[1, 2, 3]])


def test_effective_samples_of_autoregressive_chains():
    """For rho = 0.8, tau is 1/2 + 0.8/0.2 = 4.5, so 40000 samples are 4444 independent ones.

    The relative error of tau is sqrt(2 (2 W + 1)/n) = 0.05 with the window W = 5 tau, for n = 40000
    samples in all. Three times this error is allowed.
    """
    chains = autoregressive(4, 10000, 0.8, np.random.default_rng(3))
    found = seriesModule.independentRuns(chains)
    print(f'effective samples {found.effectiveSamples:.0f} of 4444')
    assert found.effectiveSamples == pytest.approx(
        40000/9, rel=0.15) and found.samples == 40000 and found.degrees == 3


def test_students_errors_cover_the_truth():
    """With 4 chains (3 degrees of freedom), t exceeds 3.182 in 5 % of 1000 studies. Four times the
    standard error of 0.7 % is allowed."""
    rng = np.random.default_rng(4)
    beyond = 0
    for _ in range(1000):
        found = seriesModule.independentRuns(rng.normal(size=(4, 50)))
        beyond += abs(found.mean) > 3.182*found.standardError
    print(f'{beyond} of 1000 beyond')
    assert 22 <= beyond <= 78


def test_stuck_replicas_have_an_infinite_rhat():
    """Replicas that never move, each at a value of its own, disagree as much as replicas can. Equal
    up to rounding they say nothing."""
    stuck = np.array([1.0, 1.0, 2.0])[:, None] + np.zeros((3, 8))
    assert seriesModule.splitRHat(stuck) == math.inf
    assert seriesModule.independentRuns(stuck).rHat == math.inf
    assert math.isnan(seriesModule.splitRHat(np.array([[0.3]*8, [0.1 + 0.2]*8])))
    # Two values that all chains visit have one distance from their median. Halves of 50 with the
    # same mean give sqrt(1 - 1/50).
    assert seriesModule.splitRHat(np.tile([0.0, 1.0],
                                          (4, 50))) == pytest.approx(math.sqrt(49/50), rel=1e-12)


def test_a_table_and_files_of_stuck_replicas(tmp_path):
    """JSON has no infinity, so that parsers that follow its rules would refuse the file."""
    contents = {(0, k): types.SimpleNamespace(
        series={'u': np.full(8, float(k))}, about={
            'sample_interval': 1.0,
            'exact': {},
            'position': 8,
            'samples': 8,
            'sessions': []
        })
                for k in range(3)}
    records = [TaskRecord(0, k, {}, 1, '', 'complete') for k in range(3)]
    found = EnsembleResult({'settings': [{}]}, {'u': {
        'label': 'u',
        'unit': 'kJ/mol'
    }}, records, contents, {'sessions': []})
    row, = found.rows
    assert row['r_hat'] == math.inf and 'stuck at a value of its own' in row['note']
    assert ' inf ' in found.table()
    json_, csv_ = found.write(str(tmp_path))

    def refuse(name):
        raise AssertionError(f'{name} is no number of JSON')

    with open(json_) as file:
        read, = json.load(file, parse_constant=refuse)['rows']
    assert read['r_hat'] is None and 'infinite' in read['note']
    with open(csv_) as file:
        assert ',inf,' in file.read()


def test_replicas_that_disagree_have_few_effective_samples():
    """Four chains of 1000 with the means 0, 0, 5, 5 know their mean to sqrt(25/3/4); samples of
    variance 1 + 25/4 that are independent know it as well if they are 3.5."""
    chains = np.random.default_rng(6).normal(size=(4, 1000)) + np.array([0, 0, 5, 5])[:, None]
    found = seriesModule.independentRuns(chains)
    # The means are known to 0.03, which is 1 % of their differences.
    assert found.effectiveSamples == pytest.approx((1 + 25/4)/(25/3/4), rel=0.05)


def test_runs_of_unequal_lengths_and_single_ones():
    rng = np.random.default_rng(5)
    found = seriesModule.independentRuns([rng.normal(size=100), rng.normal(size=60)])
    assert found.samples == 160 and found.degrees == 1 and found.rHat is not None
    single = seriesModule.independentRuns([rng.normal(size=100)])
    assert single.degrees > 3 and single.standardError == pytest.approx(0.1, rel=0.5)
    assert seriesModule.independentRuns([[1.0, 2.0]]).rHat is None
    with pytest.raises(ValueError, match='at least one run of 2 is needed'):
        seriesModule.independentRuns([])


# ---- Who else takes its processes from here ------------------------------------------------------


def withoutTimes(rows):
    times = ('ns_per', 'seconds', 'speeds', 'effective_per', 'platform', 'solver')
    return [{key: value for key, value in row.items() if not key.startswith(times)} for row in rows]


@pytest.mark.parametrize('where', CLUSTERS, indirect=True)
def test_accuracy_gives_the_same_numbers_whoever_makes_its_runs(where):
    study = accuracy.StepSizeStudy(scenes.trap(5), ['LangevinC'], [0.004, 0.008],
                                   platform='Reference')
    one = study.run(length=3, rounds=2)
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
    assert 'there is a study in it already; a new one' in capsys.readouterr().err
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
    (('--resume',), 'in it, so no study'),
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
              'from test_ensemble import small\n'
              "if __name__ == '__main__':\n"
              f"    small(['ensemble_tasks:energyOfTheSlow'], length=100.0, "
              f"replicas=2).run({str(directory)!r}, 2, 'processes', quiet=True)\n"
              "    print('ended by itself')")
    path = tmp_path/'script.py'
    path.write_text(script)
    process = subprocess.Popen([sys.executable, str(path)], env=dict(
        os.environ, PYTHONPATH=os.pathsep.join(sys.path)), stdout=subprocess.PIPE, text=True)
    try:
        waitFor(lambda: all((directory/'tasks'/f's0000_r000{k}.h5').exists() for k in (0, 1)))
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=60)[0] == 'ended by itself\n' and process.returncode == 0
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
