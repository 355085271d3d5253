"""One run of one setting, and the table rows from runs.

A run has samples and times, and ends when it blows up.
"""
from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Callable, Optional

import numpy as np
import openmm

from .observables import Sample
from .scenes import GAS_CONSTANT
from .statistics import autocorrelationTime, noise, replicaStatistics, seriesStatistics

if TYPE_CHECKING:
    from .observables import Observable
    from .result import Knob
    from .scenes import Scene

STABLE, UNSTABLE, NOT_APPLICABLE = 'stable', 'unstable', 'not applicable'
#: Runs in other processes that failed, and those that an interruption left no time for.
FAILED, NOT_RUN = 'failed', 'not run'
#: A run has exploded when its potential energy exceeds that of the start by this many times the
#: thermal kinetic energy dof/2 kT, plus this many kT for scenes of few bodies (probability at
#: equilibrium below exp(-40)).
EXPLOSION_FACTOR, EXPLOSION_MARGIN = 10, 40
SECONDS_PER_DAY = 86400
#: Halves of a run whose means differ by more than this many standard errors are called drifting.
DRIFT_LIMIT = 4
#: The note of a run whose error is larger than its fast fluctuations make it.
SLOW = 'slow fluctuations of small amplitude'


@dataclass
class Record:
    """The results of a run.

    Attributes
    ----------
    series : dict
        observable name -> list of samples, each a number or an array over independent replicas
    timings : list of (steps, wall seconds, CPU seconds)
        one entry per round; integration steps only, without the sampling
    status : str
        'stable', 'unstable' or 'not applicable'; of runs in other processes also 'failed' or 'not
        run'
    message : str
        reason why it is not stable
    samplesAt : float
        time between samples, ps
    length : float
        sampled time, ps
    equilibration : float
        time left out before, ps
    """

    samplesAt: float
    series: dict = field(default_factory=dict)
    timings: list = field(default_factory=list)
    status: str = STABLE
    message: str = ''
    length: float = 0.0
    equilibration: float = 0.0


class Explosion(Exception):
    """The run has left the physical range."""


class Run:
    """A Context that advances in pieces.

    Parameters
    ----------
    scene : Scene
    observables : list of Observable
    makeContext : callable
        () -> openmm.Context; an exception in it makes the run "not applicable"
    stepSize : float
        ps
    sampleInterval : float
        time between samples, ps; rounded to whole steps
    platform, properties
        platform and properties of the Context, for observables that need their own Context
    """
    def __init__(self, scene: Scene, observables: list[Observable], makeContext: Callable,
                 stepSize: float, sampleInterval: float, platform: openmm.Platform,
                 properties: dict[str, str]) -> None:
        self.scene = scene
        self.observables = observables
        self.stepSize = stepSize
        self.stepsPerSample = max(1, round(sampleInterval/stepSize))
        self.record = Record(self.stepsPerSample*stepSize,
                             {observable.name: []
                              for observable in observables})
        self.time = 0.0
        self.context = None
        for observable in observables:
            observable.requireBodies(scene)
        try:
            self.context = makeContext()
            self.extras = {
                observable.name: observable.setup(scene, platform, properties)
                for observable in observables if observable.setup is not None
            }
            start = self.context.getState(getEnergy=True).getPotentialEnergy()._value
            particles = sum(
                scene.system.getParticleMass(i)._value > 0
                for i in range(scene.system.getNumParticles()))
            # Bodies may have no masses at all.
            particles = max(particles, 2*len(scene.bodies))
            kT = GAS_CONSTANT*scene.temperature
            self.largestEnergy = start + (EXPLOSION_FACTOR*1.5*particles + EXPLOSION_MARGIN)*kT
        except (openmm.OpenMMException, ValueError) as error:
            self.end(NOT_APPLICABLE, str(error))

    @property
    def isAlive(self) -> bool:
        """Whether the run can be advanced."""
        return self.record.status == STABLE

    def end(self, status: str, message: str) -> None:
        """End the run: its record gets this status, and the Context is deleted.

        Parameters
        ----------
        status, message : str
            see Record
        """
        self.record.status = status
        self.record.message = message
        self.context = None

    def advance(self, samples: int, record: bool = True,
                progress: Optional[Callable] = None) -> None:
        """Advance by a number of sample intervals; they make one entry in the timings.

        Parameters
        ----------
        samples : int
        record : bool
            False: a warm-up without samples (the energy is nevertheless watched)
        progress : callable, optional
            called with the number of steps made
        """
        steps, wall, cpu = 0, 0.0, 0.0
        for _ in range(samples if self.isAlive else 0):
            wall0, cpu0 = time.perf_counter(), time.process_time()
            try:
                self.context.getIntegrator().step(self.stepsPerSample)
                wall += time.perf_counter() - wall0
                cpu += time.process_time() - cpu0
                steps += self.stepsPerSample
                self.time += self.stepsPerSample*self.stepSize
                self._sample(record)
            # OpenMM raises OpenMMException; users' functions may fail on numbers that are not
            # finite.
            except (openmm.OpenMMException, Explosion, ArithmeticError, ValueError) as error:
                self.end(UNSTABLE, f'after {self.time:.3g} ps: {error}')
                break
            if progress is not None:
                progress(self.stepsPerSample)
        if steps:
            self.record.timings.append((steps, wall, cpu))
        if not record:
            self.record.timings = []
            self.record.equilibration = self.time
        else:
            self.record.length = self.time - self.record.equilibration

    def _sample(self, record):
        sample = Sample(self.scene, self.context)
        if not math.isfinite(sample.potentialEnergy):
            raise Explosion('the potential energy is not finite')
        if sample.potentialEnergy > self.largestEnergy:
            raise Explosion(
                f'the potential energy reached {sample.potentialEnergy:.4g} kJ/mol: exploded')
        if not record:
            return
        for observable in self.observables:
            extra = self.extras.get(observable.name)
            value = observable.measure(sample) if extra is None else observable.measure(
                sample, extra)
            if np.isinf(value).any():
                raise Explosion(f'{observable.name} has become infinite')
            self.record.series[observable.name].append(value)

    def secondsPerStep(self, seconds: float = 0.3, leastSamples: int = 2) -> Optional[float]:
        """Wall seconds per step, including sampling, from a short warm-up; None if the run ended.

        Parameters
        ----------
        seconds : float
            least time of the measurement
        leastSamples : int
            least number of sample intervals
        """
        samples, began = 0, time.perf_counter()
        while self.isAlive and (samples < leastSamples or time.perf_counter() - began < seconds):
            # The first piece contains what is done once, such as neighbour lists and plans.
            if samples == 1:
                began = time.perf_counter()
            self.advance(1, record=False)
            if self.isAlive:
                Sample(self.scene, self.context).kineticEnergies
            samples += 1
        return (time.perf_counter() - began)/(
            (samples - 1)*self.stepsPerSample) if self.isAlive else None


# ---- Rows ----------------------------------------------------------------------------------------


def summarise(knob: Knob, runs: list[tuple], observables: list[Observable],
              clock: str) -> list[dict]:
    """The rows of all settings.

    Block lengths are 20 autocorrelation times, of the run itself or the median over the runs of its
    method, whichever is longer. Otherwise a run that by chance looks less correlated than its
    neighbours would get too small an error.

    Parameters
    ----------
    knob : Knob
    runs : list of (Setting, Record, seed)
    observables : list of Observable
    clock : str
        'wall' or 'cpu'

    Returns
    -------
    list of dict
        see StudyResult.rows
    """
    rows = []
    for observable in observables:
        taus = {}
        for setting, record, _ in runs:
            series = _series(record, observable)
            if series is not None:
                taus.setdefault(setting.method.name, []).append(
                    autocorrelationTime(_over_replicas(series))*record.samplesAt)
        typical = {method: float(np.median(values)) for method, values in taus.items()}
        for setting, record, seed in runs:
            rows.append(
                _row(knob, setting, record, observable, seed, clock,
                     typical.get(setting.method.name, 0.0)))
    return rows


def _series(record, observable):
    """The samples as an array, or None where there is no average to take."""
    series = np.array(record.series.get(observable.name, []), dtype=float)
    # An observable that compares with earlier samples has nothing to compare the first sample with.
    present = np.flatnonzero(~np.isnan(series).all(axis=tuple(range(1, series.ndim))))
    series = series[present[0]:] if len(present) else series
    return series if record.status == STABLE and len(series) >= 2 and np.isfinite(
        series).all() else None


def _over_replicas(series):
    return series if series.ndim == 1 else series.mean(axis=1)


def _row(knob, setting, record, observable, seed, clock, typicalTau):
    wallSpeeds, cpuSpeeds = ([
        entry[0]*setting.stepSize/1000*SECONDS_PER_DAY/entry[k] for entry in record.timings
        if entry[k] > 0
    ] for k in (1, 2))
    speeds = wallSpeeds if clock == 'wall' else cpuSpeeds
    low, middle, high = np.percentile(speeds, [16, 50, 84]) if speeds else (None, None, None)
    row = {
        'method': setting.method.name,
        'knob': knob.name,
        'value': setting.value,
        'step_size': setting.stepSize,
        'status': record.status,
        'message': record.message,
        'ns_per_day': _float(middle),
        'ns_per_day_low': _float(low),
        'ns_per_day_high': _float(high),
        'ns_per_cpu_day': _float(np.median(cpuSpeeds)) if cpuSpeeds else None,
        'ns_per_wall_day': _float(np.median(wallSpeeds)) if wallSpeeds else None,
        'speeds': [float(x) for x in speeds],
        'length': record.length,
        'equilibration': record.equilibration,
        'seed': seed,
        'observable': observable.name,
        'mean': None,
        'standard_error': None,
        'degrees': None,
        'tau': None,
        'samples': 0,
        'drift': None,
        'note': '',
        'sample_interval': record.samplesAt,
        'variance': None,
        'own_tau': None,
        'own_tau_error': None,
        'noise': None,
        'noise_degrees': None
    }
    series = _series(record, observable)
    if series is None:
        samples = record.series.get(observable.name, [])
        if record.status == STABLE:
            row['note'] = ('too few samples' if len(samples) < 2 else
                           'n/a' if np.isnan(samples).all() else 'sometimes not a number')
        return row
    summary = (seriesStatistics if series.ndim == 1 else replicaStatistics)(
        series, typicalTau/record.samplesAt)
    own = noise(series)
    row.update(variance=own.variance, own_tau=own.tau*record.samplesAt,
               own_tau_error=own.tauError*record.samplesAt, noise=own.value*record.samplesAt,
               noise_degrees=own.degrees)
    series = _over_replicas(series)
    row.update(mean=summary.mean, standard_error=summary.standardError, degrees=summary.degrees,
               tau=summary.tau*record.samplesAt, samples=summary.samples,
               drift=_drift(series, summary))
    isSlow = summary.isSlow or own.isSlow
    if not summary.isTrusted and not isSlow:
        row['note'] = 'few independent samples'
    elif row['drift'] is not None and abs(row['drift']) > DRIFT_LIMIT:
        row['note'] = 'drifts'
    elif isSlow:
        row['note'] = SLOW
    return row


def _drift(series, summary):
    """Difference of the two halves' means in standard errors, or None."""
    half = len(series) // 2
    if half < 2 or summary.standardError == 0:
        return None
    # Each half has half the samples, so the difference has twice the standard error of the whole.
    return float((series[half:].mean() - series[:half].mean())/(2*summary.standardError))


def _float(value):
    return None if value is None else float(value)
