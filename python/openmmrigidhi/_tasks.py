"""A function of many arguments: here, in processes, or on a cluster of dask.distributed.

Users see it as ensemble.tasks. Workers come and go. If a worker dies, another worker gets its task,
up to a fixed number of times. A task keeps its memory in files.
"""
from __future__ import annotations

import asyncio
import collections
import concurrent.futures
import contextlib
import functools
import importlib.util
import logging
import multiprocessing
import multiprocessing.connection
import os
import pickle
import sys
import tempfile
import threading
import time
import traceback
import uuid
import warnings
from dataclasses import dataclass, field
from multiprocessing.reduction import ForkingPickler
from typing import TYPE_CHECKING, Any, Callable, Optional, Sequence, Union

from tqdm import tqdm

from . import _loading

if TYPE_CHECKING:
    import distributed

#: Seconds between two reports of a task, and between two looks at a cluster.
BETWEEN_REPORTS, BETWEEN_LOOKS = 0.5, 0.5
#: Seconds between two requests for missing workers of this process.
BETWEEN_REPAIRS = 5.0
#: How many workers in a row may die after the first one with a task that makes no progress.
RETRIES = 10
#: How many times as many workers may die before they have begun with a task, while they start.
UNBORN = 5
#: Least numbers of seconds to wait for a scheduler that is connected, and for a worker that imports
#: this package.
LEAST_PATIENCE, IMPORT_PATIENCE = 10.0, 30.0
#: Seconds that a worker has to end by itself, after an interruption.
PATIENCE = 5.0
STARTED, PROGRESS, DONE, DIED = 'started', 'progress', 'done', 'died'


class TaskError(RuntimeError):
    """A task has failed; the message has its name and the traceback of its process."""


@dataclass
class Failure:
    """The reason why a task has no value.

    Attributes
    ----------
    kind : str
        name of the exception's class, or WorkerDied
    message : str
        text of the exception
    traceback : str
        traceback of the process of the task; empty if the process died
    """

    kind: str
    message: str
    traceback: str = ''


@dataclass
class Outcome:
    """The outcome of a task.

    Attributes
    ----------
    index : int
        index of its argument
    name : str
    value : object
        the value that the function returned; None after a failure
    failure : Failure or None
    attempts : int
        number of starts: one more than the number of its dead workers
    seconds : float
        wall time of the final attempt
    """

    index: int
    name: str
    value: Any = None
    failure: Optional[Failure] = None
    attempts: int = 1
    seconds: float = 0.0

    def get(self) -> Any:
        """The value; raises TaskError if the task has none."""
        if self.failure is not None:
            raise TaskError(f'task {self.name}: it failed with {self.failure.kind}: '
                            f'{self.failure.message}\n{self.failure.traceback}'.rstrip())
        return self.value


@dataclass
class Job:
    """The knowledge of a function about its task, in addition to its argument.

    Attributes
    ----------
    index : int
    name : str
    directory : str or None
        an existing directory of this task alone; it holds what another worker needs to continue if
        this one dies
    """

    index: int
    name: str
    directory: Optional[str] = None
    _tell: Optional[Callable] = None
    _last: float = field(default=-1e300, repr=False)

    def report(self, done: float) -> None:
        """Report progress; frequent calls cost nothing.

        The progress bar shows it. It also measures progress when workers die: a task that continues
        from a file reports its starting point before it computes.

        Parameters
        ----------
        done : float
            amount since the task's beginning, in the unit of the amounts given to run()
        """
        now = time.monotonic()
        if self._tell is not None and now - self._last > BETWEEN_REPORTS:
            self._last = now
            self._tell((PROGRESS, self.index, done))


def _perform(function, argument, job):
    """The Outcome of one task, whatever it does."""
    began, outcome = time.perf_counter(), Outcome(job.index, job.name)
    try:
        if job.directory is not None:
            os.makedirs(job.directory, exist_ok=True)
        outcome.value = function(argument, job)
    except (Exception, SystemExit) as error:
        outcome.failure = Failure(type(error).__name__, str(error), traceback.format_exc())
    outcome.seconds = time.perf_counter() - began
    return outcome


def _failure(error, text='{}'):
    """The Failure of an exception that is being handled."""
    return Failure(type(error).__name__, text.format(error), traceback.format_exc())


def _packed(outcome, dumps):
    """An Outcome as bytes; a failure instead of a value that pickle does not accept."""
    try:
        return bytes(dumps(outcome))
    # Whatever pickle, or a method of the value, says.
    except Exception as error:
        outcome.value, outcome.failure = None, _failure(error,
                                                        'what it returned cannot be pickled: {}')
        return bytes(dumps(outcome))


def _unpacked(packed, index, loads):
    """The Outcome in the bytes of _packed().

    Values run their own code here, which may fail: this is the failure of one task, and no reason
    to lose the others.
    """
    try:
        return loads(packed)
    except Exception as error:
        return Outcome(
            index, '', failure=_failure(
                error, 'what it returned cannot be unpickled in this process: {}: return numbers, '
                'texts, arrays, or lists and dicts of them'))


# ---- Where tasks are done: free() places, submit() to one, look() what happened, cancel() what has
# had its chances ---------


class _Here:
    """One after the other in this process."""
    def __init__(self, function):
        self.function = function
        self.waiting = None
        self.tell = None

    def free(self):
        return 1 if self.waiting is None else 0

    def submit(self, argument, job):
        self.waiting = argument, job

    def look(self):
        (argument, job), self.waiting = self.waiting, None
        job._tell = self.tell
        yield STARTED, job.index, None
        yield DONE, job.index, _perform(self.function, argument, job)

    def close(self):
        pass


class _Worker:
    """A process, and this end of the pipe to it."""
    def __init__(self, context):
        self.connection, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs,), daemon=True)
        with _main_that_can_be_imported():
            self.process.start()
        # Without this copy the pipe ends when the process does.
        theirs.close()
        self.index = None


@contextlib.contextmanager
def _main_that_can_be_imported():
    """New processes import the main module by its file.

    Where there is no such file (a program from stdin, '<stdin>'), they would die of it, and so they
    are not told of it. Functions of other modules then work; a function of such a main module is
    not found, which _serve() says.
    """
    main = sys.modules['__main__']
    path = getattr(main, '__file__', None)
    hidden = path is not None and getattr(main, '__spec__',
                                          None) is None and not os.path.exists(path)
    if hidden:
        main.__file__ = None
    try:
        yield
    finally:
        if hidden:
            main.__file__ = path


def _serve(connection):
    """What a worker process does until the pipe ends."""
    with contextlib.suppress(EOFError, BrokenPipeError, KeyboardInterrupt):
        while True:
            packed, index, name = connection.recv()
            try:
                function, argument, job = pickle.loads(packed)
            except Exception as error:
                outcome = Outcome(
                    index, name, failure=_failure(
                        error, 'the function or its argument cannot be unpickled in another '
                        'process: {}: functions and classes must be in a module that can be '
                        'imported, not in a notebook or a program from stdin: put them into a file '
                        'of their own, or use jobs=1'))
            else:
                connection.send((STARTED, index, None))
                job._tell = connection.send
                outcome = _perform(function, argument, job)
            connection.send((DONE, index, _packed(outcome, ForkingPickler.dumps)))


class _Processes:
    """Processes of this process.

    The executors of the standard library do not say whose process has died.
    """
    def __init__(self, function, jobs):
        self.function = function
        # Not forked: OpenMM's thread pools do not survive a fork.
        self.context = multiprocessing.get_context('spawn')
        self.jobs = jobs
        self.workers = []

    def free(self):
        return self.jobs - sum(worker.index is not None for worker in self.workers)

    def submit(self, argument, job):
        packed = bytes(ForkingPickler.dumps((self.function, argument, job)))
        worker = next((worker for worker in self.workers if worker.index is None), None)
        if worker is None:
            worker = _Worker(self.context)
            self.workers.append(worker)
        worker.index = job.index
        with contextlib.suppress(
                BrokenPipeError):  # a worker that is dead already is noticed by look()
            worker.connection.send((packed, job.index, job.name))

    def look(self):
        busy = {worker.connection: worker for worker in self.workers if worker.index is not None}
        for connection in multiprocessing.connection.wait(list(busy), BETWEEN_LOOKS):
            worker = busy[connection]
            try:
                event = connection.recv()
            except (EOFError, OSError):
                worker.process.join()
                self.workers.remove(worker)
                code = worker.process.exitcode
                yield DIED, worker.index, f'signal {-code}' if code < 0 else f'exit status {code}'
                continue
            if event[0] == DONE:
                worker.index = None
                event = *event[:2], _unpacked(event[2], event[1], pickle.loads)
            yield event

    def close(self):
        for worker in self.workers:
            worker.connection.close()
        deadline = time.monotonic() + PATIENCE
        for worker in self.workers:
            # Workers that still compute end where they are: what they need to go on is in their
            # files.
            worker.process.join(
                max(0.0, deadline - time.monotonic()) if worker.index is None else 0.0)
            if worker.process.is_alive():
                worker.process.terminate()
                worker.process.join(PATIENCE)


def _within(seconds, call):
    """The value of a call that may never return; TimeoutError if it does not within some time."""
    value = concurrent.futures.Future()

    def work():
        try:
            value.set_result(call())
        except BaseException as error:
            value.set_exception(error)

    threading.Thread(target=work, daemon=True).start()
    try:
        return value.result(seconds)
    except concurrent.futures.TimeoutError as error:
        raise TimeoutError(f'no answer within {seconds:g} s') from error


def _perform_pickled(payload, topic):
    """One task on a worker of dask, and its Outcome as bytes.

    Everything is in one piece of bytes, in which dask looks for no tasks of its own, and whose
    unpickling is no matter of dask's.
    """
    import distributed
    worker = distributed.get_worker()
    dumps, loads = distributed.protocol.pickle.dumps, distributed.protocol.pickle.loads
    payload, index, name = payload
    worker.log_event(topic, (STARTED, index, None))
    try:
        function, argument, job = loads(payload)
    except Exception as error:  # e.g. a module of the user's that this worker does not find
        return _packed(Outcome(index, name, failure=_failure(error)), dumps)
    job._tell = functools.partial(worker.log_event, topic)
    return _packed(_perform(function, argument, job), dumps)


class _Cluster:
    """Workers of dask.distributed.

    They belong to a scheduler, or there are as many local ones as there are jobs.
    """
    def __init__(self, function, jobs, address, retries, timeout):
        import dask
        import distributed
        self.function, self.timeout, self.patience = function, timeout, max(timeout, LEAST_PATIENCE)
        self.distributed = distributed
        self.topic = f'openmmrigidhi-{uuid.uuid4()}'
        self.told, self.news = collections.deque(), threading.Event()
        self.futures, self.submitted = {}, 0
        self.lonelySince = None
        #: Workers that have been checked; those of them that cannot be used; the others.
        self.known, self.unusable, self.usable = set(), set(), []
        self.say = print
        #: Whether something there does not answer, although the connection stands.
        self.isSilent = False
        self.place = contextlib.ExitStack()
        self.jobs, self.local, self.mended = jobs, None, 0.0
        self.address = address if isinstance(address, str) else 'local'
        with contextlib.ExitStack() as ifItFails:
            ifItFails.callback(self.close)
            if address is None:
                folder = self.place.enter_context(
                    tempfile.TemporaryDirectory(prefix='openmmrigidhi-',
                                                ignore_cleanup_errors=True))
                self.place.enter_context(
                    dask.config.set({'distributed.comm.timeouts.connect': timeout}))
                self.local = self.place.enter_context(
                    distributed.LocalCluster(n_workers=jobs, threads_per_worker=1, processes=True,
                                             dashboard_address='127.0.0.1:0', memory_limit=0,
                                             local_directory=folder, silence_logs=logging.CRITICAL,
                                             scheduler_kwargs={'allowed_failures': retries}))
                address = self.local
            if isinstance(address, distributed.Client):
                self.client = address
            else:
                self.client = self._connect(address)
            self._check_workers()
            self.client.subscribe_topic(self.topic, self._hear)
            self.place.callback(self.client.unsubscribe_topic, self.topic)
            ifItFails.pop_all()

    def _connect(self, address):
        limit = self.timeout

        class Client(self.distributed.Client):
            async def _start(self, **kwargs):
                # Newer versions of distributed wait without limit for the answer of a server that
                # has accepted the connection.
                try:
                    return await asyncio.wait_for(super()._start(**kwargs), limit)
                except asyncio.TimeoutError as error:
                    await self._close()
                    raise OSError('silence') from error

            def __del__(self):
                # A client that never connected complains when it is deleted.
                with contextlib.suppress(Exception):
                    super().__del__()

        try:
            return self.place.enter_context(
                Client(address, timeout=self.timeout, set_as_default=False))
        except (OSError, ValueError) as error:
            raise ConnectionError(
                f'cluster {address}: it gave no answer within {self.timeout:g} s ({error}): start '
                'a scheduler there (dask-scheduler), correct the address, or leave it out for '
                'processes on this machine') from error

    def _check_workers(self):
        """Wait for a worker, and check that all workers have this package; both within timeout."""
        try:
            self.client.wait_for_workers(1, timeout=self.timeout)
        except (OSError, self.distributed.TimeoutError) as error:
            raise ConnectionError(
                f'cluster {self.address}: no worker came within {self.timeout:g} s; at least 1 is '
                'needed: start some there (dask-worker)') from error
        workers = list(self.client.nthreads())
        self.known.update(workers)
        for problem in self._problems(workers).values():
            if problem is not None:
                raise problem

    def _problems(self, workers):
        """Worker -> an exception that says why it cannot be used, or None."""
        # Neither eval nor the text needs anything of this package on the worker.
        text = "__import__('openmmrigidhi').__version__"
        try:
            found = _within(max(self.timeout, IMPORT_PATIENCE),
                            lambda: self.client.run(eval, text, workers=workers, on_error='return'))
        except TimeoutError as error:
            self.isSilent = True
            return dict.fromkeys(workers, self._silent_worker('one of ' + ', '.join(workers),
                                                              error))
        return {worker: self._problem(worker, version) for worker, version in found.items()}

    def _problem(self, worker, version):
        if isinstance(version, (OSError, asyncio.TimeoutError)):
            return self._silent_worker(f'the worker {worker}', version)
        if isinstance(version, BaseException):
            return ImportError(
                f'cluster {self.address}: the worker {worker} cannot import openmmrigidhi '
                f'({version}); every worker must: '
                'install it there, or put it on the PYTHONPATH of the worker')
        if version != _loading.version:
            return ImportError(
                f'cluster {self.address}: the worker {worker} has openmmrigidhi {version}; it must '
                f'be {_loading.version}, as here: install the same version there')
        return None

    def _hear(self, event):
        self.told.append(event[1])

    def free(self):
        try:
            threads = _within(self.patience, self.client.nthreads)
        except (OSError, RuntimeError) as error:
            self.isSilent = isinstance(error, TimeoutError)
            raise self._lost(f' ({error})' if self.isSilent else '') from error
        self._check_late_workers(threads)
        self.usable = [worker for worker in threads if worker not in self.unusable]
        slots = sum(threads[worker] for worker in self.usable)
        if self.local is not None and slots < self.jobs and time.monotonic(
        ) - self.mended > BETWEEN_REPAIRS:
            # Dask replaces a worker that dies, but not a worker that dies while it starts. This
            # asks for all workers again.
            self.mended = time.monotonic()
            self.local.scale(self.jobs)
        if slots:
            self.lonelySince = None
        elif self.lonelySince is None:
            self.lonelySince = time.monotonic()
        elif time.monotonic() - self.lonelySince > self.timeout:
            raise ConnectionError(
                f'cluster {self.address}: it has had no worker for {self.timeout:g} s; at least 1 '
                'is needed: start some there, then go on where this ended')
        # No more tasks than can be done at once: a worker that dies then uses up no attempts of
        # other tasks.
        return slots - len(self.futures)

    def _check_late_workers(self, workers):
        """Workers of others may come while tasks are done; one that cannot be used gets none."""
        late = [worker for worker in workers if worker not in self.known]
        if self.local is None and late:
            for worker, problem in self._problems(late).items():
                if problem is not None:
                    self.unusable.add(worker)
                    self.say(f'{problem}; it gets no tasks')
        self.known.update(late)

    def _silent_worker(self, which, error):
        return ConnectionError(
            f'cluster {self.address}: {which} does not answer ({error}); every worker must: end '
            f'it, or look what it waits for')

    def _lost(self, how=''):
        return ConnectionError(
            f'cluster {self.address}: the connection to its scheduler was lost{how}; what was '
            f'finished is kept: start it anew, then go on where this ended')

    def submit(self, argument, job):
        payload = self.distributed.protocol.pickle.dumps(
            (self.function, argument, job)), job.index, job.name
        with warnings.catch_warnings():
            warnings.filterwarnings('ignore', 'Large object', UserWarning)
            # To the scheduler, a task that is submitted again is another task.
            self.submitted += 1
            # If all of them are gone when it begins, any other one may take it.
            self.futures[job.index] = self.client.submit(
                _perform_pickled, payload, self.topic, pure=False,
                key=f'{self.topic}-{self.submitted}',
                workers=self.usable if self.unusable else None,
                allow_other_workers=bool(self.unusable))
        self.futures[job.index].add_done_callback(lambda future: self.news.set())

    def look(self):
        self.news.wait(BETWEEN_LOOKS)
        self.news.clear()
        while self.told:
            event = self.told.popleft()
            if event[1] in self.futures:
                yield event
        for index, future in list(self.futures.items()):
            if future.status in ('finished', 'error'):
                del self.futures[index]
                error = future.exception() if future.status == 'error' else None
                if isinstance(error, self.distributed.KilledWorker):
                    yield DIED, index, None
                else:
                    yield DONE, index, _unpacked(
                        future.result(), index,
                        self.distributed.protocol.pickle.loads) if error is None else Outcome(
                            index, '', failure=Failure(type(error).__name__, str(error)))
            elif future.status in ('cancelled', 'lost'):
                raise self._lost()

    def cancel(self, index):
        """Take back a task that has been started too many times."""
        self.futures.pop(index).cancel()

    def close(self):
        logger = logging.getLogger('distributed')
        before = logger.level
        logger.setLevel(logging.CRITICAL)
        try:
            if self.isSilent:
                # Saying goodbye may take for ever, too.
                with contextlib.suppress(Exception):
                    _within(PATIENCE, self.place.close)
                return
            for future in self.futures.values():
                with contextlib.suppress(Exception):  # the scheduler may be gone
                    future.cancel()
            self.place.close()
        finally:
            logger.setLevel(before)


def _backend(function, jobs, cluster, retries, timeout):
    if cluster is None and jobs == 1:
        return _Here(function)
    if cluster == 'processes' or cluster is None and importlib.util.find_spec(
            'distributed') is None:
        return _Processes(function, jobs)
    if importlib.util.find_spec('distributed') is None:
        raise ImportError(
            f'cluster {cluster}: dask.distributed is not installed, which talks to clusters: '
            'install python3-distributed, or leave the cluster out for processes on this machine')
    return _Cluster(function, jobs, None if cluster == 'local' else cluster, retries, timeout)


class _Attempts:
    """How far the attempts at one task came, and whether another one has a chance.

    The furthest position does not say this. A worker begins at the last position that was saved, so
    one that dies before the furthest position may have saved more than all before. What was saved
    shows when the next attempt begins: a task that can go on reports its position at once. Two
    cases are no progress although more was saved: a task that dies at one place, which its attempts
    begin ever closer to; and attempts whose ends differ by no more than what is done between two
    reports, which is how well ends are known.
    """
    def __init__(self):
        self.starts = 0
        #: Attempts since one that made progress.
        self.fruitless = 0
        self.begin = self.now = None
        self._furthestBegin, self._furthest, self._last, self._stride = 0, 0, None, 0

    def start(self):
        self.starts += 1
        self.begin = self.now = None

    def report(self, done):
        """A position that the present attempt has come to."""
        if self.begin is None:
            self.begin = done
        else:
            self._stride = max(self._stride, done - self.now)
        self.now = done

    def end(self):
        """The worker of the present attempt has died. Returns whether it made progress."""
        progress = False
        if self.now is not None:
            progress = (
                # Further than all before, with certainty.
                self.now > self._furthest + self._stride or self.begin > self._furthest
                or self.now > self.begin >= self._furthest
                # More saved than all before, and ended elsewhere.
                or self._last is not None and self.begin > self._furthestBegin
                and abs(self.now - self._last) > self._stride)
            self._furthestBegin = max(self._furthestBegin, self.begin)
            self._furthest, self._last = max(self._furthest, self.now), self.now
        self.fruitless = 0 if progress else self.fruitless + 1
        return progress


# ---- All tasks -----------------------------------------------------------------------------------


def check_numbers(jobs, retries):
    """Check the numbers of simultaneous tasks and of retries.

    Parameters
    ----------
    jobs, retries : int

    Raises
    ------
    ValueError
    """
    if isinstance(jobs, bool) or not isinstance(jobs, int) or jobs < 1:
        raise ValueError(f'tasks.run: jobs: got {jobs!r}; it must be a whole number of 1 or more')
    if retries < 0:
        raise ValueError(
            f'tasks.run: retries: got {retries!r}; it must be a whole number of 0 or more')


def run(function: Callable, arguments: Sequence, jobs: int = 1,
        cluster: Optional[Union[str, distributed.Client]] = None, *,
        names: Optional[Sequence[str]] = None, directory: Optional[str] = None,
        amounts: Optional[Sequence[float]] = None, unit: str = 'task', title: str = '',
        retries: int = RETRIES, timeout: float = 60.0, finished: Optional[Callable] = None,
        quiet: bool = False) -> list[Outcome]:
    """Call a function for each of many arguments, several at a time.

    Outcomes do not depend on who computes what, in which order, unless the function does. The tasks
    start in the order of the arguments, so put the longest first.

    Parameters
    ----------
    function : callable
        (argument, Job) -> value. pickle must accept the function, its arguments and its values. An
        exception ends only its own task.
    arguments : sequence
    jobs : int
        number of tasks at a time; with 1 this process does them one after the other
    cluster : str, distributed.Client or None
        the address of a scheduler of dask.distributed, e.g. tcp://host:8786, whose workers then
        decide how many tasks run at a time; None or 'local': workers on this machine, by
        dask.distributed where it is installed and else by plain processes; 'processes': plain
        processes
    names : sequence of str, optional
        names of the tasks; default: their numbers
    directory : str, optional
        directory in which each task gets its own directory, by its name, for its checkpoints;
        workers on other machines must see it under this path
    amounts : sequence of float, optional
        amounts of work: the values with which each task's Job.report() ends; without them the
        progress bar counts tasks
    unit : str
        unit of the amounts, for the progress bar
    title : str
        title of the progress bar
    retries : int
        how often another worker gets a task after a worker has died with it. The count begins anew
        when a worker makes progress: it comes further than all workers before it, or it begins
        further on and does not die where the previous worker died (Job.report()).
    timeout : float
        seconds to wait for a cluster's answer, and for a first worker; connected workers have at
        least 10 s, and a worker that imports this package 30 s
    finished : callable, optional
        called in this process with each Outcome, as they arrive
    quiet : bool
        show no progress bar

    Returns
    -------
    list of Outcome
        in the order of the arguments; outcomes of failed tasks have a `failure`

    Raises
    ------
    ConnectionError
        if a cluster does not answer, has no workers, or was lost
    ImportError
        if a worker has no openmmrigidhi or another version, or if a cluster is requested without
        dask.distributed
    ValueError
        for invalid numbers

    Notes
    -----
    With jobs above 1 put the call under ``if __name__ == '__main__':``, as for everything that
    starts processes. Ctrl-C ends all tasks where they are.

    Examples
    --------
    >>> from openmmrigidhi.ensemble import tasks
    >>> def square(x, job):
    ...     return x*x
    >>> [outcome.get() for outcome in tasks.run(square, [1, 2, 3], quiet=True)]
    [1, 4, 9]
    """
    arguments = list(arguments)
    check_numbers(jobs, retries)
    names = _checked_names(names, len(arguments))
    if not arguments:
        return []
    backend = _backend(function, jobs, cluster, retries, timeout)
    bar = _Bar(amounts, len(arguments), unit, title, quiet)
    tasks = [
        _Task(argument, index, name, directory)
        for index, (argument, name) in enumerate(zip(arguments, names))
    ]
    return _Run(tasks, backend, bar, retries, finished).outcomes()


def _checked_names(names, count):
    """The names of all tasks; default: their numbers."""
    names = [str(k) for k in range(count)] if names is None else [str(name) for name in names]
    if len(names) != count or len(set(names)) < len(names):
        raise ValueError(f'tasks.run: names: got {len(names)} with {len(set(names))} different '
                         f'ones for {count} tasks; each task needs a name of its own')
    return names


class _Task:
    """An argument, and what has become of it so far."""
    def __init__(self, argument, index, name, directory):
        self.argument, self.index, self.name = argument, index, name
        self.directory = None if directory is None else os.path.join(directory, name)
        self.attempts = _Attempts()
        #: Whether no attempt has begun since the task was submitted last.
        self.isFresh = True
        #: How many workers in a row have died so early.
        self.unborn = 0

    def submit(self, backend):
        self.isFresh = True
        backend.submit(self.argument, Job(self.index, self.name, self.directory))

    def start(self):
        """A worker begins with the task."""
        # A scheduler has tried it again by itself.
        if not self.isFresh:
            self.attempts.end()
        self.isFresh, self.unborn = False, 0
        self.attempts.start()

    def has_early_death(self, how):
        """Whether a worker died before it began with the task; counts such workers."""
        # A scheduler does not tell how its workers died, and counts by itself.
        isEarly = how is not None and self.isFresh
        self.unborn += isEarly
        return isEarly


class _Run:
    """All tasks, from the first one that is submitted to the last outcome.

    Each kind of event that a backend sees has a method of its own.
    """
    def __init__(self, tasks, backend, bar, retries, finished):
        self._tasks, self._backend, self._bar = tasks, backend, bar
        self._retries, self._finished = retries, finished
        self._waiting = collections.deque(tasks)
        self._outcomes = {}
        self._events = {
            STARTED: self._start,
            PROGRESS: self._report,
            DONE: self._end,
            DIED: self._bury
        }
        backend.tell, backend.say = lambda event: bar.show(event[1], event[2]), bar.say

    def outcomes(self):
        """Do all tasks. Returns the list of Outcome, in the order of the tasks."""
        with contextlib.closing(self._backend), contextlib.closing(self._bar):
            while len(self._outcomes) < len(self._tasks):
                places = self._backend.free()
                while self._waiting and places > 0:
                    self._waiting.popleft().submit(self._backend)
                    places -= 1
                for event, index, what in self._backend.look():
                    self._events[event](self._tasks[index], what)
        return [self._outcomes[task.index] for task in self._tasks]

    def _start(self, task, _):
        task.start()
        if task.attempts.starts > 1:
            self._bar.say(f'{task.name}: its worker died; attempt {task.attempts.starts}')
        # An external scheduler may allow more attempts.
        if task.attempts.fruitless > self._retries:
            self._backend.cancel(task.index)
            self._give_up(task)

    def _report(self, task, done):
        task.attempts.report(done)
        self._bar.show(task.index, done)

    def _end(self, task, outcome):
        outcome.name, outcome.attempts = task.name, max(1, task.attempts.starts)
        self._outcomes[task.index] = outcome
        self._bar.end(task.index)
        if self._finished is not None:
            self._finished(outcome)

    def _bury(self, task, how):
        """A worker has died with the task: another one gets it, if it has a chance."""
        if task.has_early_death(how) and task.unborn <= UNBORN*(self._retries + 1):
            # The task has nothing to do with it, unless it never begins.
            self._waiting.appendleft(task)
            return
        task.attempts.end()
        # A scheduler that gives up ignores progress, and has a number of retries of its own.
        if task.attempts.fruitless <= self._retries:
            self._waiting.appendleft(task)
        else:
            self._give_up(task, how)

    def _give_up(self, task, how=None):
        died = f'{task.attempts.starts + task.unborn} workers died with it, one after the other'
        cause = '' if how is None else f' ({how})'
        self._end(
            task,
            Outcome(
                task.index, task.name, failure=Failure(
                    'WorkerDied',
                    f'{died}{cause}; more retries than {self._retries} without progress are not '
                    'made: look for what ends the process (memory?), then run it again')))


class _Bar:
    """The progress of all tasks together."""
    def __init__(self, amounts, count, unit, title, quiet):
        self.amounts = [1]*count if amounts is None else list(amounts)
        self.done = [0]*count
        self.counts = amounts is None
        self.bar = tqdm(
            total=sum(self.amounts), unit=' ' + unit, desc=title or None, disable=quiet,
            mininterval=0.5, smoothing=0.05,
            bar_format='{l_bar}{bar}| {n:.4g}/{total:.4g}{unit} [{elapsed}<{remaining}]{postfix}')

    def show(self, index, done):
        if not self.counts:
            # A task that begins anew from its checkpoint goes back a little.
            self.done[index] = min(done, self.amounts[index])
            self._draw()

    def end(self, index):
        self.done[index] = self.amounts[index]
        self._draw()

    def _draw(self):
        change = sum(self.done) - self.bar.n
        if change >= 0:
            self.bar.update(change)
        else:
            self.bar.n += change
            self.bar.refresh()

    def say(self, text):
        if not self.bar.disable:
            self.bar.write(text, file=sys.stderr)

    def close(self):
        self.bar.close()
