"""Studies: settings times replicas, in one directory; you can continue and extend them."""
from __future__ import annotations

import contextlib
import fcntl
import hashlib
import itertools
import json
import math
import os
import socket
import time
import uuid
import warnings
from typing import TYPE_CHECKING, Any, Callable, Optional, Sequence, Union

import numpy as np
from openmm import unit

from .. import _tasks, _units
from .._types import Number
from ..accuracy import observables as observablesModule
from ..accuracy import overdamped
from ..accuracy._results import beginning, provenance
from . import taskfiles
from .result import EnsembleResult, TaskRecord
from .simulation import SCENE_DIRECTORY, SceneSource, Task, expectations, simulate

if TYPE_CHECKING:
    import distributed
    from ..accuracy.observables import Observable
    from ..accuracy.scenes import Scene

FORMAT = 'openmmrigidhi ensemble study 1'
STUDY, TASKS, LOCK, CHECKSUM = 'study.json', 'tasks', 'study.lock', 'checksum'
#: What an extension may change, and in which direction; everything else must stay.
GROWING = ('length', 'replicas', 'settings')


def sweep(**values: Any) -> list[dict]:
    """All combinations of values; the last name changes fastest.

    Parameters
    ----------
    **values
        name -> sequence of values

    Returns
    -------
    list of dict

    Examples
    --------
    >>> from openmmrigidhi import ensemble
    >>> ensemble.sweep(temperature=[280, 300], stepSize=[0.002, 0.004])[1]
    {'temperature': 280, 'stepSize': 0.004}
    """
    return [dict(zip(values, each)) for each in itertools.product(*values.values())]


def taskSeed(seed: int, setting: int, replica: int) -> int:
    """The seed of a task.

    It depends only on the study's seed and the task's place in the study. Replicas of one setting
    never have the same seed: the numbers of earlier replicas are skipped.

    Parameters
    ----------
    seed : int
        seed of the study
    setting, replica : int

    Returns
    -------
    int
        1 to 2^31 - 2
    """
    return _seeds(seed, setting, replica + 1)[replica]


def _seeds(seed, setting, replicas):
    """The seeds of the first replicas of a setting."""
    found = []
    for replica in range(replicas):
        sequence = np.random.SeedSequence(seed, spawn_key=(setting, replica))
        words = 1
        while True:
            candidate = int(sequence.generate_state(words)[-1]) % (2**31 - 2) + 1
            if candidate not in found:
                break
            words += 1
        found.append(candidate)
    return found


class Study:
    """Independent replicas of a scene, for each of several settings.

    A task is one replica of one setting. The study's seed and the task's place determine its own
    seed. A task saves its samples and its state at intervals. After an interruption it continues
    from there; on the Reference platform the result is the same bit for bit.

    Parameters
    ----------
    scene : str, callable or openmmrigidhi.accuracy.Scene
        a built-in name (water, trap, suspension, periodic, boomerang), "module:function", or a
        function. A function gets the settings, and the task's seed if it has a parameter `seed`. It
        returns a Scene, (system, state or positions, integrator) or (system, topology, positions,
        integrator). Its integrator determines scheme and step size.
    settings : sequence of dict
        parameters of the function. If the function has no parameter `scheme` (a name) or `stepSize`
        (ps, or a Quantity), these are set on the integrator. :func:`sweep` makes combinations.
    replicas : int
        number of replicas of each setting
    length : float or Quantity
        sampled time in each task, ps
    observables : sequence of str, Observable or callable
        see :func:`openmmrigidhi.accuracy.observables.byName`. An observable that remembers more
        than the last sample continues after an interruption if its `setup` object has `memory` and
        `recall` (see :class:`openmmrigidhi.accuracy.Observable`), as diffusion_coefficient has;
        otherwise it begins anew, and its samples that are then NaN are left out.
    seed : int
        seed of all random numbers; 0 or more
    platform : str
    threads : int
        threads of the CPU platform, in each task
    equilibration : float or Quantity, optional
        time left out at the start, ps; default: the scene's, or a tenth of the length at the
        study's beginning
    sampleInterval : float or Quantity, optional
        ps; default: the scene's
    checkpointInterval : float or Quantity
        seconds of wall time between two checkpoints of a task; after an interruption at most so
        much is computed again. After each start the first checkpoint comes at a 64th of it, and
        each wait is twice the previous one, so that short-lived workers also make progress.

    Raises
    ------
    ValueError, TypeError
        for invalid arguments

    Examples
    --------
    >>> import tempfile
    >>> from openmmrigidhi import ensemble
    >>> study = ensemble.Study('trap', ensemble.sweep(bodies=[20], temperature=[280.0, 320.0]),
    ...                        replicas=2, length=2.0, observables=['energy_group_0'],
    ...                        platform='Reference')
    >>> result = study.run(tempfile.mkdtemp(), quiet=True)
    >>> [row['replicas'] for row in result.rows]
    [2, 2]
    """
    def __init__(self, scene: Union[str, Callable, Scene], settings: Sequence[dict] = ({},),
                 replicas: int = 4, length: Optional[Number] = None,
                 observables: Sequence[Union[str, Observable,
                                             Callable]] = observablesModule.DEFAULT, seed: int = 1,
                 platform: str = 'CPU', threads: int = 1, equilibration: Optional[Number] = None,
                 sampleInterval: Optional[Number] = None,
                 checkpointInterval: Number = 60.0) -> None:
        self.source = scene if isinstance(scene, SceneSource) else SceneSource(scene)
        self.settings = [_plain_step(each) for each in settings]
        self.replicas, self.length, self.seed = replicas, _time(length, 'length'), seed
        self.platform, self.threads = platform, threads
        self.equilibration = _time(equilibration, 'equilibration')
        self.sampleInterval = _time(sampleInterval, 'sampleInterval')
        self.checkpointInterval = _time(checkpointInterval, 'checkpointInterval', 1e-12)
        self._defaultEquilibration = None
        self._given = list(observables)
        self.observables = [_observable(each) for each in self._given]
        self._check()

    def _check(self):
        names = [observable.name for observable in self.observables]
        if len(set(names)) < len(names) or not names:
            raise ValueError(f'ensemble.Study: observables: got {names}; give one or more, none of '
                             'them twice')
        for name in names:
            # HDF5 takes the first as a path, and the second as the group itself.
            if not isinstance(name, str) or '/' in name or '\0' in name or name in ('', '.'):
                raise ValueError(
                    f'ensemble.Study: observables: got the name {name!r}; it must be a text '
                    f'without / and other than ".", since samples are kept under it: give the '
                    f'observable another name')
        for name, value, least in (('replicas', self.replicas, 1), ('seed', self.seed, 0),
                                   ('threads', self.threads, 1)):
            if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
                raise ValueError(
                    f'ensemble.Study: {name}: got {value!r}; it must be a whole number, at '
                    f'least {least}')
        for name, value, zero in (('length', self.length,
                                   False), ('equilibration', self.equilibration,
                                            True), ('sampleInterval', self.sampleInterval, False),
                                  ('checkpointInterval', self.checkpointInterval, True)):
            if value is None and name in ('equilibration', 'sampleInterval'):
                continue
            if not isinstance(
                    value,
                (int, float,
                 np.number)) or not math.isfinite(value) or value < 0 or value == 0 and not zero:
                raise ValueError(
                    f'ensemble.Study: {name}: got {value!r}; it must be a finite time above '
                    f'{"or at " if zero else ""}0, in '
                    f'{"s" if name == "checkpointInterval" else "ps"}')
        if not self.settings:
            raise ValueError(
                'ensemble.Study: settings: the list is empty; at least one dict is needed: '
                'give [{}] for the scene as it is')
        allowed = self.source.parameters()
        for number, each in enumerate(self.settings):
            unknown = [key for key in each if allowed is not None and key not in allowed]
            if unknown:
                raise ValueError(
                    f'ensemble.Study: settings {number}: got {unknown[0]!r}, which the scene '
                    f'{self.source.name} does not have; it must be one of '
                    f'{", ".join(sorted(allowed))}: correct the name, or give a function with '
                    'this parameter')
            try:
                json.dumps(each)
            except TypeError as error:
                raise TypeError(
                    f'ensemble.Study: settings {number}: {error}; each value must be a number, a '
                    f'text, a truth value or a list of these, since the '
                    'study is kept as JSON: convert them') from error
            if each in self.settings[:number]:
                raise ValueError(
                    f'ensemble.Study: settings {number}: {each} is there already; settings must '
                    f'differ: raise replicas instead')

    # ---- What it is ------------------------------------------------------------------------------

    def definition(self) -> dict:
        """The definition of the study, as its JSON has it, a dict."""
        names = [
            each if isinstance(each, str) else
            f'{each.__module__}:{each.__qualname__}' if not hasattr(each, 'measure') else each.name
            for each in self._given
        ]
        first = (0.1*
                 self.length if self._defaultEquilibration is None else self._defaultEquilibration)
        # The values are as JSON gives them back: tuples become lists, and so on.
        return json.loads(
            json.dumps({
                'scene': self.source.specification,
                'settings': self.settings,
                'replicas': int(self.replicas),
                'length': float(self.length),
                'observables': names,
                'seed': int(self.seed),
                'platform': self.platform,
                'threads': int(self.threads),
                'equilibration': self.equilibration,
                'default_equilibration': first,
                'sample_interval': self.sampleInterval
            }))

    @classmethod
    def load(cls, directory: str, checkpointInterval: float = 60.0) -> Study:
        """The study in a directory; continue it with run(), or extend it.

        Parameters
        ----------
        directory : str
        checkpointInterval : float
            see Study

        Raises
        ------
        FileNotFoundError, ValueError
            if the directory has no study, or its study.json is damaged
        """
        about = _read_about(directory)['definition']
        for name in about['observables']:
            try:
                _observable(name)
            except ValueError as error:
                raise ValueError(
                    f'ensemble.Study.load: {directory}: observable {name!r} is not known by its '
                    f'name ({error}); if the study was begun with an Observable of this name, run '
                    'the script again that made it, with its own Study, or begin studies with '
                    '"module:name" of the Observable') from error
        study = cls(SceneSource.load(about['scene'], directory), about['settings'],
                    about['replicas'], about['length'], about['observables'], about['seed'],
                    about['platform'], about['threads'], about['equilibration'],
                    about['sample_interval'], checkpointInterval)
        study._defaultEquilibration = about['default_equilibration']
        return study

    def extended(self, length: Optional[Number] = None, replicas: Optional[int] = None,
                 settings: Sequence[dict] = ()) -> Study:
        """A larger study.

        ``run(directory, extend=True)`` of the larger study extends the directory of this study, and
        does not change existing results.

        Parameters
        ----------
        length : float or Quantity, optional
            total time of each task, ps
        replicas : int, optional
            total number of replicas of each setting
        settings : sequence of dict
            further settings

        Returns
        -------
        Study
        """
        larger = Study.__new__(Study)
        larger.__dict__.update(self.__dict__)
        larger._defaultEquilibration = self.definition()['default_equilibration']
        larger.length = self.length if length is None else _time(length, 'length')
        larger.replicas = self.replicas if replicas is None else replicas
        larger.settings = self.settings + [_plain_step(each) for each in settings]
        larger._check()
        return larger

    def seeds(self) -> list:
        """The seeds of all tasks, a list over settings of lists over replicas."""
        return [_seeds(self.seed, setting, self.replicas) for setting in range(len(self.settings))]

    # ---- The run ---------------------------------------------------------------------------------

    def run(self, directory: str, jobs: int = 1,
            cluster: Optional[Union[str, distributed.Client]] = None, *, extend: bool = False,
            retries: int = _tasks.RETRIES, timeout: float = 60.0, quiet: bool = False,
            finished: Optional[Callable] = None) -> EnsembleResult:
        """Do the remaining tasks, and return the result.

        In an empty directory the study begins; in its own directory it continues. Ctrl-C ends the
        run with a warning: saved samples remain, and are evaluated.

        Parameters
        ----------
        directory : str
            directory of the study, created if it does not exist. Workers on other machines must see
            it under this path.
        jobs, cluster, retries, timeout
            who computes: see :func:`openmmrigidhi.ensemble.tasks.run`
        extend : bool
            whether an existing study may become longer, or get more replicas or settings
        quiet : bool
            show no progress bar
        finished : callable, optional
            called with each TaskRecord when its task ends

        Returns
        -------
        EnsembleResult

        Raises
        ------
        ValueError
            if the directory has another study, or files but no study
        NotADirectoryError
            if a file has the name of the directory or of its tasks
        taskfiles.UnreadableFile
            if a task's file cannot be read
        RuntimeError
            if another process is running the study
        OSError
            if the directory's file system has no locks
        ConnectionError, ImportError
            see tasks.run(): a cluster does not answer, or a worker has no plugin
        """
        _tasks.check_numbers(jobs, retries)
        directory = os.path.abspath(directory)
        _check_that_it_is_empty(directory)
        taskfiles.makeDirectory(os.path.join(directory, TASKS))
        with _locked(directory):
            about = self._begin(directory, extend)
            taskfiles.clean(os.path.join(directory, TASKS))
            began, session = time.perf_counter(), {
                **beginning(), 'jobs': jobs,
                'cluster': cluster if cluster is None else str(cluster),
                'length': self.length,
                'host': socket.gethostname()
            }
            todo, aside = self._left(directory, about)
            failures = {}

            def note(outcome):
                task = todo[outcome.index]
                key = taskName(task.setting, task.replica)
                failure = outcome.failure
                session['attempts'] = session.get('attempts', 0) + outcome.attempts
                if failure is not None:
                    failures[key] = {
                        'setting': task.setting,
                        'replica': task.replica,
                        'settings': task.settings,
                        'seed': task.seed,
                        'kind': failure.kind,
                        'message': failure.message,
                        'traceback': failure.traceback,
                        'attempts': outcome.attempts
                    }
                about['failures'].pop(key, None)
                about['failures'].update(failures)
                _write_about(directory, about)
                if finished is not None:
                    finished(
                        _record(directory, task.setting, task.replica, task.seed, task.settings,
                                about, self.length)[0])

            try:
                _tasks.run(
                    simulate, todo, jobs, cluster,
                    names=[taskName(task.setting, task.replica) for task in todo], amounts=[
                        task.length + (task.defaultEquilibration
                                       if task.equilibration is None else task.equilibration)
                        for task in todo
                    ], unit='ps', title=self.source.name, retries=retries, timeout=timeout,
                    finished=note, quiet=quiet)
            except KeyboardInterrupt:
                session['interrupted'] = True
            finally:
                session.update(provenance(began), tasks=len(todo), failed=len(failures),
                               put_aside=aside)
                about['sessions'].append(session)
                _write_about(directory, about)
        result = read(directory)
        result.write(directory)
        if session.get('interrupted'):
            warnings.warn(
                'ensemble.Study.run: the run was interrupted, and result.isComplete is '
                f'{result.isComplete}; the same call continues from the last checkpoints',
                stacklevel=2)
        return result

    def _begin(self, directory, extend):
        """The study's JSON, for a new study or for one that continues."""
        wanted = self.definition()
        if not os.path.exists(os.path.join(directory, STUDY)):
            self.source.save(directory)
            about = {
                'format': FORMAT,
                'identity': str(uuid.uuid4()),
                'definition': wanted,
                'seeds': self.seeds(),
                'earlier_definitions': [],
                'observables': {
                    observable.name: {
                        'label': observable.label,
                        'unit': observable.unit
                    }
                    for observable in self.observables
                },
                'failures': {},
                'sessions': []
            }
            _write_about(directory, about)
            return about
        about = _read_about(directory)
        before = about['definition']
        if self._defaultEquilibration is None:
            wanted['default_equilibration'] = before['default_equilibration']
        if 'files' in before['scene'] and 'sha256' not in before['scene']:
            # An earlier version did not note what the scene was.
            wanted['scene'].pop('sha256', None)
        different = [key for key in wanted if wanted[key] != before.get(key)]
        if not different:
            return about
        fixed = [key for key in different if key not in GROWING]
        if fixed:
            raise ValueError(
                f'{directory}: its study has {fixed[0]} {before.get(fixed[0])!r}, and this one '
                f'{wanted[fixed[0]]!r}; it must be the same: take '
                'another directory, or Study.load()')
        count = len(before['settings'])
        if wanted['length'] < before['length'] or wanted['replicas'] < before['replicas'] or wanted[
                'settings'][:count] != before['settings']:
            raise ValueError(
                f'{directory}: its study has length {before["length"]:g}, {before["replicas"]} '
                f'replicas and {count} settings, of which this one lacks some; nothing that is '
                'there may be left out: extend it with Study.load().extended()')
        if not extend:
            raise ValueError(
                f'{directory}: its study has another {different[0]}; only an extension may change '
                'it: say extend=True (--extend), or take another directory')
        about['earlier_definitions'].append(before)
        about.update(definition=wanted, seeds=self.seeds())
        _write_about(directory, about)
        return about

    def _left(self, directory, about):
        """Incomplete tasks, and damaged files that were put aside.

        Tasks with the most remaining work come first.
        """
        todo, aside = [], []
        for setting, seeds in enumerate(self.seeds()):
            for replica, seed in enumerate(seeds):
                path = taskPath(directory, setting, replica)
                try:
                    saved = taskfiles.load(
                        path,
                        expectations(setting, replica, seed, self.settings[setting],
                                     about['identity']))
                except taskfiles.UnreadableFile:
                    raise  # it may be whole
                except taskfiles.DamagedFile:
                    saved = None
                    aside.append(_put_aside(path))
                done = 0.0 if saved is None else saved.about['samples']*saved.about[
                    'sample_interval']
                if done < self.length*(1 - 1e-9):
                    todo.append((done,
                                 Task(self.source, self.settings[setting], setting, replica, seed,
                                      self.observables, self.equilibration,
                                      about['definition']['default_equilibration'], self.length,
                                      self.sampleInterval, self.platform, self.threads,
                                      self.checkpointInterval, directory, path, about['identity'])))
        return [task for _, task in sorted(todo, key=lambda pair: pair[0])], aside


def _time(value, name, scale=1.0):
    """A time as a number of ps, or of ps over the scale; any other value stays unchanged."""
    if isinstance(value, str):
        try:
            return _units.from_text(value, _units.TIMES, 'ps')*scale
        except (KeyError, ValueError):
            raise ValueError(f'ensemble.Study: {name}: got {value!r}; a time is a number of ps, a '
                             'Quantity, or a text such as 5ns') from None
    if not unit.is_quantity(value):
        return value
    return _units.number(value, _units.TIME, 'ensemble.Study', name)*scale


def _plain_step(settings):
    """Settings with a step size that is a number; other quantities are left to the function."""
    settings = dict(settings)
    if 'stepSize' in settings:
        settings['stepSize'] = _time(settings['stepSize'], 'stepSize')
    return settings


def _observable(given):
    return overdamped.OBSERVABLES[given] if isinstance(
        given, str) and given in overdamped.OBSERVABLES else observablesModule.byName(given)


def taskName(setting: int, replica: int) -> str:
    """The name of a task.

    Parameters
    ----------
    setting, replica : int
    """
    return f's{setting:04d}_r{replica:04d}'


def taskPath(directory: str, setting: int, replica: int) -> str:
    """The path of a task's file.

    Parameters
    ----------
    directory : str
        directory of the study
    setting, replica : int
    """
    return os.path.join(directory, TASKS, taskName(setting, replica) + '.h5')


def _put_aside(path):
    number = 1
    while os.path.exists(f'{path}.damaged{number}'):
        number += 1
    os.rename(path, f'{path}.damaged{number}')
    return f'{path}.damaged{number}'


# ---- The study's own file ------------------------------------------------------------------------


@contextlib.contextmanager
def _locked(directory):
    """Lock the study, so that no other process runs it meanwhile.

    The system opens the lock when this process ends, however it ends.
    """
    with open(os.path.join(directory, LOCK), 'a') as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise RuntimeError(
                f'{directory}: another process runs this study at the moment; one at a time may: '
                f'wait for it, or end it') from error
        except OSError as error:
            raise OSError(
                error.errno,
                f'{directory}: it cannot be locked ({error.strerror}); its file system must have '
                f'locks, so that one process at a time runs the study: take a directory on another '
                f'one') from error
        yield


def _check_that_it_is_empty(directory):
    """A directory may contain only a study, or the remains of one that could not begin."""
    if os.path.exists(os.path.join(directory, STUDY)) or not os.path.isdir(directory):
        return
    tasks = os.path.join(directory, TASKS)
    if os.path.isdir(tasks) and os.listdir(tasks):
        raise ValueError(
            f'{directory}: it has tasks but no {STUDY}, which says what they are; a study begins '
            'in an empty directory: put that file back, or take another directory')
    others = sorted(
        set(os.listdir(directory)) - {TASKS, LOCK, STUDY + taskfiles.PART, SCENE_DIRECTORY})
    if others:
        raise ValueError(
            f'{directory}: it has {others[0]} but no {STUDY}; a study begins in an empty '
            f'directory, so that it replaces no other files: take another directory')


def _checksum(about):
    """The SHA-256 of a study's JSON without its checksum."""
    content = json.loads(json.dumps({key: about[key] for key in about if key != CHECKSUM}))
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _write_about(directory, about):
    text = json.dumps({**about, CHECKSUM: _checksum(about)}, indent=1) + '\n'
    taskfiles.write(os.path.join(directory, STUDY), text.encode())


def _read_about(directory):
    path = os.path.join(directory, STUDY)
    if not os.path.exists(path):
        raise FileNotFoundError(
            f'{directory}: it has no {STUDY}, so it is no study; give the directory of a study')
    try:
        with open(path) as file:
            about = json.load(file)
        if about.get('format') != FORMAT:
            raise ValueError(f'its format is {about.get("format")!r} instead of {FORMAT!r}')
        # An earlier version wrote none.
        if about.get(CHECKSUM) not in (None, _checksum(about)):
            raise ValueError('its content is not the one that its checksum is of')
        about['definition']['settings'], about['observables'], about['seeds'], about[
            'failures'], about['sessions'], about['identity']
        return about
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(
            f'{path}: it is damaged ({type(error).__name__}: {error}); it must say what the study '
            f'is: put a copy back, the tasks in {TASKS} are whole for themselves') from error


def read(directory: str) -> EnsembleResult:
    """Read a study, finished or not.

    The result names damaged files and uses all other files. It imports nothing for this.

    Parameters
    ----------
    directory : str

    Returns
    -------
    EnsembleResult

    Raises
    ------
    FileNotFoundError, ValueError
        if the directory has no study, or its study.json is damaged
    """
    about = _read_about(directory)
    definition, records, contents = about['definition'], [], {}
    for setting, seeds in enumerate(about['seeds']):
        for replica, seed in enumerate(seeds):
            record, content = _record(directory, setting, replica, seed,
                                      definition['settings'][setting], about, definition['length'])
            records.append(record)
            if content is not None:
                contents[setting, replica] = content
    return EnsembleResult(definition, about['observables'], records, contents, about)


def _record(directory, setting, replica, seed, settings, about, length):
    """The knowledge about a task, and the content of its file or None."""
    key, path = taskName(setting, replica), taskPath(directory, setting, replica)
    record = TaskRecord(setting, replica, settings, seed, path)
    content = None
    try:
        content = taskfiles.load(path,
                                 expectations(setting, replica, seed, settings, about['identity']))
    except taskfiles.DamagedFile as error:
        record.status, record.message = 'damaged', str(error)
        return record, None
    if content is not None:
        record.samples, record.length = content.about[
            'samples'], content.about['samples']*content.about['sample_interval']
        record.seconds = sum(session['seconds'] for session in content.about['sessions'])
        record.status = 'complete' if record.length >= length*(1 - 1e-9) else 'unfinished'
    failure = about['failures'].get(key)
    if failure is not None and record.status != 'complete':
        record.status, record.message, record.traceback = (
            'failed', f'{failure["kind"]}: {failure["message"]}', failure['traceback'])
    return record, content
