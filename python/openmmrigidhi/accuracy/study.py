"""Studies: their settings, the lengths of runs, and the reference of the comparison.

:class:`Study` runs settings side by side and does not know what distinguishes them.
:class:`StepSizeStudy` changes the step size. A study of another quantity (hydrodynamic model,
solver tolerance, grid spacing) overrides ``knob``, ``settings``, ``makeContext`` and ``reference``.
"""
from __future__ import annotations

import contextlib
import math
import time
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Callable, Optional, Sequence, Union

import numpy as np
import openmm

from .._systems import refuse_driven_flow, refuse_joints
from .. import _tasks
from . import methods as methodsModule
from . import observables as observablesModule
from ._results import beginning, check_lengths, provenance
from .measurement import FAILED, NOT_RUN, Run, summarise
from .methods import Method
# Users look for Knob in the module of the study.
from .result import STEP_SIZE, Knob, Reference, StudyResult  # noqa: F401
from .scenes import platformProperties, water
from .statistics import Point, extrapolate

if TYPE_CHECKING:
    from .observables import Observable
    from .scenes import Scene

#: With fewer samples than this a run is too short for any statement.
FEWEST_SAMPLES = 20
#: Rounds that are made even if the budget is over: a median needs three.
FEWEST_ROUNDS = 3
#: Least seconds of the trial of a setting, and of each of the times of a run made elsewhere.
TRIAL_SECONDS, TIMING_SECONDS = 0.3, 0.5


@dataclass(frozen=True)
class Setting:
    """One point of a curve: a method, the knob's value, and the step size (ps) of the point."""

    method: Method
    value: float
    stepSize: float


class Study:
    """Runs every setting on one scene in turn, round by round, and gathers samples and times.

    Parameters
    ----------
    scene : Scene
        a scene in equilibrium; a scene with a driven flow or with joints is an error
    methods : sequence of str or Method
    observables : sequence of str, Observable or callable
        see :func:`openmmrigidhi.accuracy.observables.byName`
    platform : str
        'CPU' or 'Reference'
    threads : int
        threads of the CPU platform
    seed : int
        seed of all random numbers; each setting gets its own seed from it
    clock : str
        the time for ns/day, 'wall' or 'cpu'. Other programs disturb CPU time less, but with several
        threads it means ns per CPU-day.
    sampleInterval : float, optional
        time between samples, ps, rounded to whole steps; default: the scene's. Nothing is lost
        below half the correlation time of the fastest observable of interest.
        :meth:`StudyResult.price` marks observables that are sampled too seldom.
    """

    knob = None

    def __init__(self, scene: Scene, methods: Sequence[Union[str, Method]],
                 observables: Sequence[Union[str, Observable,
                                             Callable]] = observablesModule.DEFAULT,
                 platform: str = 'CPU', threads: int = 1, seed: int = 1, clock: str = 'wall',
                 sampleInterval: Optional[float] = None) -> None:
        if clock not in ('wall', 'cpu'):
            raise ValueError(f'Study: clock: got {clock!r}; it must be wall or cpu')
        if sampleInterval is not None and not (math.isfinite(sampleInterval)
                                               and sampleInterval > 0):
            raise ValueError(
                f'Study: sampleInterval: got {sampleInterval}; the time between samples must be '
                f'positive, in ps')
        refuse_driven_flow(
            scene.system, f'{type(self).__name__}: scene',
            'where alone all methods have the same averages: compare steady states of one '
            'method at several steps by runs of your own')
        refuse_joints(
            scene.makeIntegrator(), f'{type(self).__name__}: scene',
            'which most methods would tear: compare schemes that have joints by runs of your own')
        self.scene = scene
        self.methods = [
            method if isinstance(method, Method) else methodsModule.byName(method)
            for method in methods
        ]
        self.observables = [observablesModule.byName(observable) for observable in observables]
        names = [observable.name for observable in self.observables]
        if len(set(names)) < len(names) or not names:
            raise ValueError(
                f'Study: observables: got {names}; at least one is needed, and none may '
                'occur twice')
        self.platform = platform
        self.threads = threads
        self.seed = seed
        self.clock = clock
        self.sampleInterval = scene.sampleInterval if sampleInterval is None else sampleInterval
        #: (Setting, Record) of the last run: all samples and times.
        self.records = []

    # ---- What a study of another knob overrides --------------------------------------------------

    def settings(self) -> list[Setting]:
        """All settings, a list of Setting."""
        raise NotImplementedError

    def makeContext(self, setting: Setting, seed: int) -> openmm.Context:
        """A Context of the scene for one setting.

        Parameters
        ----------
        setting : Setting
        seed : int
        """
        scene = setting.method.sceneOf(self.scene)
        integrator = setting.method.makeIntegrator(scene, setting.stepSize, seed)
        return scene.makeContext(integrator, openmm.Platform.getPlatformByName(self.platform),
                                 platformProperties(self.platform, self.threads), seed)

    def reference(self, observable: Observable, rows: Sequence[dict]) -> Optional[Reference]:
        """The reference for the means of an observable, a Reference or None.

        rows are the observable's rows of stable settings.
        """
        exact = observable.exact(self.scene)
        return None if exact is None else Reference(observable.name, exact, 0.0, 'exact')

    # ---- The run ---------------------------------------------------------------------------------

    def settingSeed(self, setting: Setting) -> int:
        """The seed of a setting.

        It depends only on the study's seed, the method's name and the value.
        """
        text = f'{self.seed}|{setting.method.name}|{setting.value:.9g}'
        return zlib.crc32(text.encode()) % (2**31 - 2) + 1

    def _make_run(self, setting):
        return Run(setting.method.sceneOf(self.scene), self.observables,
                   lambda: self.makeContext(setting, self.settingSeed(setting)), setting.stepSize,
                   self.sampleInterval, openmm.Platform.getPlatformByName(self.platform),
                   platformProperties(self.platform, self.threads))

    def run(self, budget: float = 600.0, length: Optional[float] = None,
            equilibration: Optional[float] = None, rounds: int = 20, jobs: int = 1,
            progress: Optional[Callable] = None, cluster: Optional[str] = None) -> StudyResult:
        """Measure.

        The runs take turns. In each round every setting advances by a part of its length, in a
        random order. Whatever slows the machine for a while thus slows all settings, and ratios of
        times remain valid. Ctrl-C ends the measurement early; the collected samples are evaluated.
        Runs in other processes count as a whole: an unfinished run has the status 'not run', and a
        failed run has the status 'failed' and a message.

        Parameters
        ----------
        budget : float
            allowed time of the measurement, seconds (wall). A short trial of each setting
            determines the run lengths, in proportion to the square root of its speed: large steps
            get longer runs, and small steps get more time.
        length : float, optional
            length of the run of every setting, ps; then no budget applies, and results do not
            depend on the machine's speed
        equilibration : float, optional
            time left out at the start of each run, ps; default: the scene's, or else a tenth of the
            run's length
        rounds : int
            number of turns for which the lengths are planned; with a budget as many as fit
        jobs : int
            above 1: number of runs at the same time. The runs do not take turns, and times are
            measured afterwards, alone.
        progress : callable, optional
            called with (done, total, text) in steps
        cluster : str, optional
            who makes the runs if they do not take turns: see
            :func:`openmmrigidhi.ensemble.tasks.run`. The runs use all workers of a scheduler; the
            plan of the budget assumes as many workers as jobs.

        Returns
        -------
        StudyResult

        Raises
        ------
        TaskError
            if all runs in other processes failed
        """
        check_lengths(f'{type(self).__name__}.run', budget if length is None else None, length,
                      equilibration, rounds)
        began = time.perf_counter()
        about = beginning()
        settings = self.settings()
        runs, refusals = [], {}
        for setting in settings:
            refusal = setting.method.whyNot(
                self.scene) if setting.method.whyNot is not None else None
            if refusal is not None:
                refusals[setting.method.name] = refusal
            else:
                runs.append((setting, self._make_run(setting)))
        cost = [run.secondsPerStep(TRIAL_SECONDS) for _, run in runs]
        # The length of the trial depends on the machine. The results do not: settings that survived
        # the trial start afresh.
        runs = [(setting, self._make_run(setting) if run.isAlive else run) for setting, run in runs]
        inTurn = jobs == 1 and cluster is None
        lengths, left = self._plan(runs, cost, budget - (time.perf_counter() - began), length,
                                   equilibration, jobs, rounds, inTurn)
        meter = _Meter(
            progress,
            sum((total + left)/run.stepSize
                for (_, run), (total, left) in zip(runs, zip(lengths, left)) if run.isAlive))
        deadline = math.inf if length is not None else began + budget
        if inTurn:
            done = self._in_turn(runs, lengths, left, rounds, deadline, meter)
        else:
            done = rounds
            self._together(runs, lengths, left, jobs, cluster, meter)
        about.update(self._provenance(began, done, jobs))
        return self._evaluate([(setting, run.record) for setting, run in runs], refusals, about)

    def _plan(self, runs, cost, budget, length, equilibration, jobs, rounds, inTurn):
        """Lengths of all runs and of their equilibration, ps.

        They are whole sample intervals, with equal parts for all rounds.
        """
        alive = [i for i, (_, run) in enumerate(runs) if run.isAlive]
        perPs = {i: cost[i]/runs[i][1].stepSize for i in alive}
        fixed = equilibration if equilibration is not None else self.scene.equilibration
        timing = 0.0 if inTurn else 0.1
        seconds = max(0.0, budget)*(1 - timing)*jobs
        lengths, left = [0.0]*len(runs), [0.0]*len(runs)
        share = 1.0 if fixed is not None else 1/1.1
        forSampling = share*seconds - sum(perPs[i]*(fixed or 0) for i in alive)
        norm = sum(math.sqrt(perPs[i]) for i in alive)
        for i in alive:
            run = runs[i][1]
            total = length if length is not None else max(0.0, forSampling)/(math.sqrt(perPs[i])*
                                                                             norm)
            interval = run.record.samplesAt
            perRound = max(1, round(total/rounds/interval))
            lengths[i] = max(perRound, math.ceil(FEWEST_SAMPLES/rounds))*rounds*interval
            left[i] = math.ceil((fixed if fixed is not None else 0.1*lengths[i])/interval -
                                1e-9)*interval
        return lengths, left

    def _in_turn(self, runs, lengths, left, rounds, deadline, meter):
        rng = np.random.default_rng([self.seed, 1])
        turn = 0
        try:
            for (setting, run), ps in zip(runs, left):
                run.advance(round(ps/run.record.samplesAt), False,
                            meter.advance(self._text(setting)))
            pieces = [
                max(1, round(ps/rounds/run.record.samplesAt))
                for (_, run), ps in zip(runs, lengths)
            ]
            # With a budget there are as many rounds as fit. They are more or fewer than planned if
            # the trial misjudged the speed.
            slowest = 0.0
            while (turn < rounds if deadline == math.inf else turn < FEWEST_ROUNDS
                   or time.perf_counter() + 0.7*slowest < deadline):
                began = time.perf_counter()
                for i in rng.permutation(len(runs)):
                    setting, run = runs[i]
                    run.advance(pieces[i], True, meter.advance(self._text(setting)))
                slowest = max(slowest, time.perf_counter() - began)
                turn += 1
            return turn
        except KeyboardInterrupt:
            return turn

    def _together(self, runs, lengths, left, jobs, cluster, meter):
        """Whole runs in other processes; then times, here and in turn, without other work.

        A failing run does not discard the others, nor does an interruption. If no other run exists,
        the failure is raised.
        """
        alive = [i for i, (_, run) in enumerate(runs) if run.isAlive]
        # The longest first, so that none is left alone at the end.
        order = sorted(alive, key=lambda i: -lengths[i]/runs[i][1].stepSize)
        failed, missing, interrupted = [], set(alive), False

        def take(outcome):
            i = order[outcome.index]
            missing.discard(i)
            if outcome.failure is None:
                runs[i][1].record = outcome.value
            else:
                failed.append(outcome)
                runs[i][1].end(FAILED, f'{outcome.failure.kind}: {outcome.failure.message}')
            meter.advance(self._text(runs[i][0]))(round((lengths[i] + left[i])/runs[i][1].stepSize))

        try:
            _tasks.run(_whole_run, [(self, runs[i][0], lengths[i], left[i]) for i in order], jobs,
                       cluster, names=[self._text(runs[i][0]) for i in order], finished=take,
                       quiet=True)
        except KeyboardInterrupt:
            interrupted = True
        for i in missing:
            runs[i][1].end(NOT_RUN, 'the measurement was interrupted before the end of this run')
        if failed and len(failed) == len(alive):
            failed[0].get()
        for i in alive:
            runs[i][1].record.timings = []
        with contextlib.suppress(KeyboardInterrupt):
            # After an interruption there are times, but it does not take long.
            self._time([runs[i] for i in alive if runs[i][1].isAlive], 1 if interrupted else 7)

    def _time(self, runs, rounds):
        """Times of runs whose samples already exist."""
        rng = np.random.default_rng([self.seed, 2])
        for _ in range(rounds):
            for i in rng.permutation(len(runs)):
                setting, old = runs[i]
                # Times may end although the run itself did not end, since their start differs.
                if old.context is None:
                    continue
                # This process has a Context of its own for the times; what that computes is thrown
                # away.
                record, old.record = old.record, type(old.record)(
                    old.record.samplesAt, {o.name: []
                                           for o in self.observables})
                try:
                    before = time.perf_counter()
                    steps = [0, 0.0, 0.0]
                    while time.perf_counter() - before < TIMING_SECONDS:
                        old.advance(1, True)
                        if not old.isAlive:
                            break
                        steps = [a + b for a, b in zip(steps, old.record.timings[-1])]
                    if steps[0]:
                        record.timings.append(tuple(steps))
                finally:
                    old.record = record

    def _text(self, setting):
        return f'{setting.method.name} {self.knob.format(setting.value)}'

    def _provenance(self, began, rounds, jobs):
        return {
            'rounds': rounds,
            'jobs': jobs,
            'seed': self.seed,
            'platform': self.platform,
            'threads': self.threads if self.platform == 'CPU' else 1,
            'clock': self.clock,
            **provenance(began)
        }

    def _evaluate(self, runs, refusals, about):
        self.records = runs
        rows = summarise(self.knob, [(setting, record, self.settingSeed(setting))
                                     for setting, record in runs], self.observables, self.clock)
        references = {}
        for observable in self.observables:
            mine = [
                row for row in rows
                if row['observable'] == observable.name and row['mean'] is not None
            ]
            reference = self.reference(observable, mine)
            if reference is not None:
                references[observable.name] = reference
        orders = {method.name: method.order for method in self.methods}
        scene = {
            'name': self.scene.name,
            'description': self.scene.description,
            'bodies': len(self.scene.bodies),
            'particles': self.scene.system.getNumParticles(),
            'temperature': self.scene.temperature,
            'friction': self.scene.friction,
            'rotational_friction': self.scene.rotationalFriction
        }
        return StudyResult(self.knob, scene, rows, references, orders,
                           {o.name: {
                               'label': o.label,
                               'unit': o.unit
                           }
                            for o in self.observables}, refusals, about)


def _whole_run(argument, job):
    study, setting, length, left = argument
    run = study._make_run(setting)
    run.advance(round(left/run.record.samplesAt), False)
    run.advance(round(length/run.record.samplesAt), True)
    return run.record


class StepSizeStudy(Study):
    r"""Error against ns/day for step sizes and schemes.

    Parameters
    ----------
    scene : Scene, optional
        default: :func:`openmmrigidhi.accuracy.scenes.water`
    methods : sequence of str or Method
        methods among LangevinA, LangevinB, LangevinC, GradientThermostat, LangevinMiddle, or your
        own
    stepSizes : sequence of float, or dict from method name to sequence of float, optional
        ps; default: the scene's. A method that the dict does not name gets the scene's step sizes.
    references : dict, optional
        observable name -> (value, standard error): known averages, used instead of exact averages
        and of the extrapolation
    **kwargs
        observables, platform, threads, seed, clock, sampleInterval: see Study

    Notes
    -----
    All methods sample the canonical ensemble as :math:`h \to 0`, so they have a common limit
    :math:`A_0` of an observable. The study fits :math:`A_0 + E_m h^p + F_m h^{2p}` to all stable
    settings (:func:`openmmrigidhi.accuracy.statistics.extrapolate`). Kinetic temperatures need no
    fit, since their limit is the temperature of the heat bath.

    Examples
    --------
    >>> from openmmrigidhi import accuracy
    >>> scene = accuracy.scenes.trap(bodies=50)
    >>> study = accuracy.StepSizeStudy(scene, ['LangevinC'], [0.002, 0.004, 0.008],
    ...                                observables=['translational_temperature'],
    ...                                platform='Reference')
    >>> print(study.run(length=2).recommend('translational_temperature:20%').setting['method'])
    LangevinC
    """

    knob = STEP_SIZE

    def __init__(self, scene: Optional[Scene] = None,
                 methods: Sequence[Union[str, Method]] = ('LangevinC', 'LangevinMiddle'),
                 stepSizes: Optional[Union[Sequence[float], dict[str, Sequence[float]]]] = None,
                 references: Optional[dict] = None, **kwargs: Any) -> None:
        super().__init__(water() if scene is None else scene, methods, **kwargs)
        self.stepSizes = stepSizes
        self.references = dict(references or {})
        for setting in self.settings():
            if not (math.isfinite(setting.stepSize) and setting.stepSize > 0):
                raise ValueError(
                    f'StepSizeStudy: stepSizes: got {setting.stepSize}; a step must be positive, '
                    f'in ps')

    def settings(self) -> list[Setting]:
        """All settings: methods and their step sizes, in ascending order."""
        def steps(method):
            if isinstance(self.stepSizes, dict):
                return self.stepSizes.get(method.name, self.scene.stepSizes)
            return self.scene.stepSizes if self.stepSizes is None else self.stepSizes

        return [
            Setting(method, h, h) for method in self.methods for h in sorted(set(steps(method)))
        ]

    def reference(self, observable: Observable, rows: list[dict]) -> Optional[Reference]:
        """The given value, the exact one, or the extrapolation to step 0.

        Parameters
        ----------
        observable : Observable
        rows : list of dict
            the observable's rows of stable settings
        """
        if observable.name in self.references:
            value, error = self.references[observable.name]
            return Reference(observable.name, value, error, 'given')
        exact = super().reference(observable, rows)
        if exact is not None:
            return exact
        orders = {method.name: method.order for method in self.methods}
        points = [
            Point(row['method'], row['step_size'], row['mean'], row['standard_error'],
                  orders[row['method']]) for row in rows
        ]
        fit = extrapolate(points)
        if fit is None:
            return None
        return Reference(observable.name, fit.value, fit.standardError, 'extrapolated', fit,
                         [(row['method'], row['value']) for row in rows])


class _Meter:
    """Counts steps for a progress display."""
    def __init__(self, report, total):
        self.report = report
        self.total = total
        self.done = 0

    def advance(self, text):
        def count(steps):
            self.done += steps
            if self.report is not None:
                self.report(self.done, self.total, text)

        return count
