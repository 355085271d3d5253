"""One task: a scene with its settings, a seed and a length.

A task saves its state and continues from it, whoever computes it.
"""
from __future__ import annotations

import hashlib
import inspect
import json
import os
import platform as machine
import socket
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Callable, Optional, Union

import numpy as np
import openmm

from .. import _loading
from .._schemes import Scheme
from ..accuracy import overdamped, scenes
from ..accuracy.observables import Sample
from ..accuracy.scenes import Scene, importObject, platformProperties
from . import taskfiles
from .taskfiles import TaskFile

if TYPE_CHECKING:
    from .._tasks import Job
    from ..integrator import CustomRigidHIIntegrator

#: Scenes by name.
BUILT_IN = {
    **scenes.BUILT_IN, 'suspension': scenes.suspension,
    'periodic': scenes.periodicSuspension,
    'boomerang': overdamped.boomerang
}
#: Settings that are set on the integrator, if the scene's function has no parameter of this name.
OF_THE_INTEGRATOR = ('scheme', 'stepSize')
SCENE_DIRECTORY = 'scene'
SCENE_FILES = ('system.xml', 'integrator.xml', 'start.npz', 'scene.json')


class SceneSource:
    """Where the scenes of a study come from: a function of the settings, or one Scene.

    Parameters
    ----------
    scene : str, callable or Scene
        a built-in name, "module:function", a function, or a Scene
    """
    def __init__(self, scene: Union[str, Callable, Scene]) -> None:
        self.scene, self.function = (scene, None) if isinstance(scene, Scene) else (None, None)
        if self.scene is not None:
            self.specification = {'files': SCENE_DIRECTORY, 'sha256': self._fingerprint()}
        elif callable(scene):
            self.function = scene
            self.specification = {'function': f'{scene.__module__}:{scene.__qualname__}'}
        elif scene in BUILT_IN:
            self.function = BUILT_IN[scene]
            self.specification = {'built_in': scene}
        elif isinstance(scene, str) and ':' in scene:
            self.function = importObject(scene, 'scene')
            self.specification = {'function': scene}
        else:
            raise ValueError(
                f'Study: scene: got {scene!r}; it must be one of {", ".join(BUILT_IN)}, '
                'module:function, a function or a Scene')

    @property
    def name(self) -> str:
        """The name in tables."""
        return self.scene.name if self.scene is not None else next(iter(
            self.specification.values()))

    def parameters(self) -> Optional[set[str]]:
        """The names that settings may have; None if the function takes any name."""
        if self.function is None:
            return set(OF_THE_INTEGRATOR)
        own = inspect.signature(self.function).parameters
        if any(parameter.kind == parameter.VAR_KEYWORD for parameter in own.values()):
            return None
        return set(own) | set(OF_THE_INTEGRATOR)

    def make(self, settings: dict, seed: int) -> tuple[Scene, CustomRigidHIIntegrator]:
        """The scene and an integrator for it.

        Parameters
        ----------
        settings : dict
        seed : int
            the function gets the seed too, if it has a parameter of this name that is not among the
            settings

        Returns
        -------
        (Scene, CustomRigidHIIntegrator)
        """
        settings = dict(settings)
        scene: Any = self.scene
        own = {} if self.function is None else inspect.signature(self.function).parameters
        ofIntegrator = {
            key: settings.pop(key)
            for key in OF_THE_INTEGRATOR if key in settings and key not in own
        }
        if self.function is not None:
            if 'seed' in own:
                settings.setdefault('seed', seed)
            scene = self.function(**settings)
            if not isinstance(scene, Scene):
                parts = tuple(scene)
                scene = Scene(*(parts if len(parts) == 3 else (parts[0], parts[2], parts[3])),
                              name=self.name, description=f'scene {self.name}')
        integrator = scene.makeIntegrator()
        if 'scheme' in ofIntegrator:
            integrator.setScheme(Scheme[ofIntegrator['scheme']])
        if 'stepSize' in ofIntegrator:
            integrator.setStepSize(ofIntegrator['stepSize'])
        integrator.setRandomNumberSeed(seed)
        return scene, integrator

    def save(self, directory: str) -> None:
        """Write a Scene into a directory, so that the study can continue without it.

        Parameters
        ----------
        directory : str
            directory of the study
        """
        if self.scene is None:
            return
        folder = os.path.join(directory, self.specification['files'])
        os.makedirs(folder, exist_ok=True)
        system, integrator, start, about = (os.path.join(folder, name) for name in SCENE_FILES)
        for path, thing in ((system, self.scene.system), (integrator, self.scene.makeIntegrator())):
            with open(path, 'w') as file:
                file.write(openmm.XmlSerializer.serialize(thing))
        arrays = {'positions': self.scene.positions, 'box': self.scene.boxVectors}
        if self.scene.velocities is not None:
            arrays['velocities'] = self.scene.velocities
        np.savez(start, **arrays)
        with open(about, 'w') as file:
            json.dump(self._properties(), file, indent=1)

    def _properties(self):
        """What is kept of a Scene beside System, integrator and start, as values of JSON."""
        return json.loads(
            json.dumps({
                'name': self.scene.name,
                'description': self.scene.description,
                'exact': self.scene.exact,
                'equilibration': self.scene.equilibration,
                'sampleInterval': self.scene.sampleInterval,
                'stepSizes': list(self.scene.stepSizes)
            }))

    def _fingerprint(self):
        """The SHA-256 of everything that is kept of a Scene."""
        found = hashlib.sha256(json.dumps(self._properties(), sort_keys=True).encode())
        for thing in (self.scene.system, self.scene.makeIntegrator()):
            found.update(openmm.XmlSerializer.serialize(thing).encode())
        for array in (self.scene.positions, self.scene.boxVectors, self.scene.velocities):
            found.update(b'' if array is None else np.asarray(array, dtype=float).tobytes())
        return found.hexdigest()

    @classmethod
    def load(cls, specification: dict, directory: str) -> SceneSource:
        """The source that a study's JSON and the files of :meth:`save` describe.

        Parameters
        ----------
        specification : dict
        directory : str
            directory of the study
        """
        if 'files' not in specification:
            return cls(next(iter(specification.values())))
        system, integrator, start, about = (os.path.join(directory, specification['files'], name)
                                            for name in SCENE_FILES)
        try:
            things = []
            for path in (system, integrator):
                with open(path) as file:
                    things.append(openmm.XmlSerializer.deserialize(file.read()))
            with open(about) as file:
                extra = json.load(file)
            with np.load(start) as arrays:
                scene = Scene(things[0], arrays['positions'], things[1], **extra)
                scene.boxVectors = arrays['box']
                scene.velocities = arrays['velocities'] if 'velocities' in arrays else None
            source = cls(scene)
            known = specification.get('sha256')
            if known is not None and known != source.specification['sha256']:
                raise ValueError('its checksum is not the one that the study has')
        # Each library that reads a file has its own errors.
        except Exception as error:
            raise ValueError(f'{os.path.dirname(system)}: the scene of the study is damaged '
                             f'({type(error).__name__}: {error}); {", ".join(SCENE_FILES)} must '
                             'be as they were written: put copies back') from error
        source.specification = specification
        return source


@dataclass
class Task:
    """All that a worker needs to know.

    Attributes
    ----------
    source : SceneSource
    settings : dict
        settings of the scene
    setting, replica : int
        indices of the setting and the replica in the study
    seed : int
    observables : list of Observable
    equilibration, defaultEquilibration, length, sampleInterval : float
        ps; if equilibration is None, it is the scene's, or the default where the scene has none; if
        sampleInterval is None, it is the scene's
    platform : str
    threads : int
    checkpointInterval : float
        longest time between two checkpoints, seconds; see CheckpointTimes
    directory : str
        directory of the study
    path : str
        path of the task's file
    study : str
        identity of the study that must be in the directory
    """

    source: SceneSource
    settings: dict
    setting: int
    replica: int
    seed: int
    observables: list
    equilibration: Any
    defaultEquilibration: float
    length: float
    sampleInterval: Any
    platform: str
    threads: int
    checkpointInterval: float
    directory: str
    path: str
    study: str

    def expected(self) -> dict:
        """What the task's file must say about it."""
        return expectations(self.setting, self.replica, self.seed, self.settings, self.study)


def expectations(setting: int, replica: int, seed: int, settings: dict, study: str) -> dict:
    """What the file of a task must say about it.

    Parameters
    ----------
    setting, replica, seed : int
    settings : dict
    study : str
        identity of the study

    Returns
    -------
    dict
    """
    return {
        'setting': setting,
        'replica': replica,
        'seed': seed,
        'settings': json.loads(json.dumps(settings)),
        'study': study
    }


def simulate(task: Task, job: Job) -> dict:
    """Do a task, from its last checkpoint if it has one.

    Parameters
    ----------
    task : Task
    job : Job

    Returns
    -------
    dict
        samples, and the seconds that this call spent in steps
    """
    _check_directory(task)
    saved = taskfiles.load(task.path, task.expected())
    scene, integrator = task.source.make(task.settings, task.seed)
    digest = _digest(scene.system, integrator)
    if saved is not None and saved.about['digest'] != digest:
        raise ValueError(
            f'{task.path}: the scene {task.source.name} with {task.settings} makes another System '
            f'or integrator now than when this task began; '
            'they must be the same: put the function back as it was, or begin a new study')
    run = _Run(task, scene, integrator, digest, saved)
    # Where it begins shows how much an earlier attempt has saved.
    job.report(run.position*run.interval)
    times = CheckpointTimes(task.checkpointInterval, time.monotonic())
    while run.position < run.end:
        run.advance()
        job.report(run.position*run.interval)
        if run.position < run.end and times.isDue(time.monotonic()):
            began = time.monotonic()
            run.save()
            times.saved(began, time.monotonic())
    run.save()
    return {'samples': run.about['samples'], 'seconds': run.segment['seconds']}


class CheckpointTimes:
    """When an attempt saves: early, then after waits that double up to the interval.

    Workers may live for less than the interval. A worker that works longer than the first wait
    saves at least about half of its work; otherwise its successors would repeat the same steps for
    ever. An attempt cannot know whether it is the first, since a scheduler may repeat it by itself,
    so all attempts do this; it costs six additional checkpoints.

    Parameters
    ----------
    interval : float
        longest time between two checkpoints, seconds
    now : float
        seconds
    """

    #: The first wait as a part of the interval; least wait, as a multiple of what saving took.
    FIRST, LEAST = 1/64, 10

    def __init__(self, interval: float, now: float) -> None:
        self.interval, self.wait, self.last = interval, self.FIRST*interval, now

    def isDue(self, now: float) -> bool:
        """Whether a checkpoint is due."""
        return now - self.last >= self.wait

    def saved(self, began: float, now: float) -> None:
        """Register a checkpoint.

        Parameters
        ----------
        began, now : float
            times of its beginning and its end, in s
        """
        self.wait = min(self.interval, max(2*self.wait, self.LEAST*(now - began)))
        self.last = now


def _check_directory(task):
    try:
        with open(os.path.join(task.directory, 'study.json')) as file:
            found = json.load(file).get('identity')
    except (OSError, ValueError):
        found = None
    if found != task.study:
        raise FileNotFoundError(
            f'worker on {socket.gethostname()}: it does not see the study in {task.directory}; '
            f'every worker must, under this path: '
            'put the study where all machines of the cluster look, on a shared file system')


def _digest(system, integrator):
    text = openmm.XmlSerializer.serialize(system) + openmm.XmlSerializer.serialize(integrator)
    return hashlib.sha256(text.encode()).hexdigest()


class _Run:
    """A Context with its samples.

    A position is a number of sample intervals since the start, including the equilibration.
    """
    def __init__(self, task, scene, integrator, digest, saved):
        self.task, self.scene = task, scene
        stepSize = integrator.getStepSize()._value
        for name in ('sampleInterval', 'length'):
            time = getattr(task, name)
            if time is not None and time < 0.5*stepSize:
                raise ValueError(
                    f'{name}: got {time:g} ps, which is shorter than a step of {stepSize:g} ps: '
                    'give a longer time; a plain number is in ps')
        self.stepsPerSample = max(1, round((task.sampleInterval or scene.sampleInterval)/stepSize))
        self.interval = self.stepsPerSample*stepSize
        self.warm = intervals(
            next(each
                 for each in (task.equilibration, scene.equilibration, task.defaultEquilibration)
                 if each is not None), self.interval)
        self.end = self.warm + intervals(task.length, self.interval)
        _loading.checkPlatform(task.platform)
        platform, properties = openmm.Platform.getPlatformByName(task.platform), platformProperties(
            task.platform, task.threads)
        self.context = scene.makeContext(integrator, platform, properties, task.seed)
        for observable in task.observables:
            observable.requireBodies(scene)
        self.extras = {
            observable.name: observable.setup(scene, platform, properties)
            for observable in task.observables if observable.setup is not None
        }
        if saved is None:
            self.position, self.series = 0, {observable.name: [] for observable in task.observables}
            self.about = {
                **task.expected(), 'scene': scene.name,
                'description': scene.description,
                'digest': digest,
                'step_size': stepSize,
                'sample_interval': self.interval,
                'equilibration': self.warm*self.interval,
                'platform': task.platform,
                'position': 0,
                'samples': 0,
                'exact': {
                    observable.name: observable.exact(scene)
                    for observable in task.observables
                },
                'sessions': []
            }
        else:
            self.about, self.position = saved.about, saved.about['position']
            self.about.setdefault('study', task.study)
            self.series = {name: list(values) for name, values in saved.series.items()}
            self.context.setState(openmm.XmlSerializer.deserialize(saved.state))
            for name, values in saved.memory.items():
                self.extras[name].recall(values)
            # Another observable that remembers the sample before is told this sample again.
            if self.about['samples']:
                self._measure([
                    observable for observable in task.observables
                    if observable.name in self.extras and observable.name not in saved.memory
                ])
        self.segment = {
            'from_position': self.position,
            'to_position': self.position,
            'seconds': 0.0,
            'seconds_sampling': 0.0,
            'host': socket.gethostname(),
            'architecture': machine.machine(),
            'started': _now(),
            'saved': None,
            'versions': {
                'openmmrigidhi': _loading.version,
                'openmm': openmm.version.full_version,
                'numpy': np.__version__
            }
        }
        self.about['sessions'].append(self.segment)

    def advance(self):
        """Advance one sample interval, and take the sample if equilibration is over."""
        began = time.perf_counter()
        self.context.getIntegrator().step(self.stepsPerSample)
        self.segment['seconds'] += time.perf_counter() - began
        self.position += 1
        if self.position > self.warm:
            began = time.perf_counter()
            for name, value in self._measure(self.task.observables).items():
                self.series[name].append(value)
            self.segment['seconds_sampling'] += time.perf_counter() - began

    def _measure(self, observables):
        sample = Sample(self.scene, self.context)
        values = {}
        for observable in observables:
            extra = self.extras.get(observable.name)
            value = observable.measure(sample) if extra is None else observable.measure(
                sample, extra)
            if np.isinf(value).any():
                raise ArithmeticError(
                    f'observable {observable.name}: it is infinite at '
                    f'{self.context.getState().getTime()._value:g} ps; it must be finite: '
                    'the run may have exploded, take a smaller step')
            values[observable.name] = value
        return values

    def save(self):
        """Save a checkpoint: State and samples belong together, or neither is replaced."""
        state = self.context.getState(getPositions=True, getVelocities=True, getParameters=True,
                                      getIntegratorParameters=True)
        self.about.update(position=self.position, samples=max(0, self.position - self.warm))
        self.segment.update(to_position=self.position, saved=_now())
        memory = {
            name: extra.memory()
            for name, extra in self.extras.items() if hasattr(extra, 'memory')
        }
        self.about['remember'] = list(memory)
        taskfiles.save(
            self.task.path,
            TaskFile(self.about, openmm.XmlSerializer.serialize(state), self.series, memory))


def intervals(length: float, interval: float) -> int:
    """The smallest number of sample intervals whose total is at least a length.

    Parameters
    ----------
    length, interval : float
        ps
    """
    return int(np.ceil(length/interval - 1e-9))


def _now():
    return time.strftime('%Y-%m-%dT%H:%M:%SZ', time.gmtime())
