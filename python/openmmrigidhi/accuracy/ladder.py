"""The hydrodynamic ladder: errors of models of the fluid, and the cost of a step with each.

The scenes have spheres.
"""
from __future__ import annotations

import time
from typing import TYPE_CHECKING, Callable, Optional, Sequence, Union

import numpy as np
import openmm

from .. import _tasks
from . import mobilities
from . import rungs as rungsModule
from ._results import check_lengths, provenance
from .ladderresult import EXACT, LadderResult
from .measurement import NOT_APPLICABLE, STABLE
from .rungs import BEST, Spheres
from .scenes import Scene, platformProperties

if TYPE_CHECKING:
    from .mobilities import MobilityObservable
    from .rungs import Rung

#: The error of StokesianDynamics with lubrication for at most two spheres. The tests of the pair's
#: resistance functions allow this error, and no larger error was found.
PAIR_ERROR = 1e-9
#: What exact numbers of a scene are off by: they have six digits and more.
DIGITS_ERROR = 2e-6
#: Seconds of a step on the CPU platform above which Reference is not tried.
LONG_STEP = 0.01
#: Seconds of a step that is measured once only.
VERY_LONG_STEP = 2.0


def remainder(distances: list[float]) -> Optional[float]:
    """Estimated distance of the finest multiblob from the limit of many blobs.

    The number of blobs grows fourfold from rung to rung. If the last difference is q times the
    previous one, the differences to come sum up to :math:`q/(1 - q)` times the last. q is at least
    1/2, as for an error proportional to the spacing of the blobs. The last difference counts as at
    least a quarter of the previous one, as for an error proportional to the square of the spacing.
    Smaller values may be chance.

    Parameters
    ----------
    distances : list of float
        distances of the coarser multiblobs to the finest, coarsest first

    Returns
    -------
    float or None
        relative; None if there are fewer than two distances, or if differences do not shrink
    """
    if len(distances) < 2 or None in distances:
        return None
    before, last = distances[-2] - distances[-1], distances[-1]
    last = max(last, abs(before)/4)
    if last == 0:
        return 0.0
    q = max(0.5, last/max(abs(before), 1e-300))
    return last*q/(1 - q) if q < 0.9 else None


class LadderStudy:
    """Error of the mobility against time per step, for models of the fluid.

    The study computes the mobility of the scene's spheres at its start with every rung. It compares
    this mobility, and numbers that follow from it, with the best rung (see
    :meth:`chooseReference`). It times steps of LangevinHI.

    Parameters
    ----------
    scene : Scene, or dict from float to Scene
        one scene of spheres, or several along a parameter, such as
        :func:`openmmrigidhi.accuracy.scenes.pairs` over gaps or
        :func:`openmmrigidhi.accuracy.scenes.arrays` over volume fractions. A driven flow of the
        fluid is left out, since mobilities do not depend on it.
    rungs : sequence of str or Rung, optional
        among FreeDraining, RPY, ForceCoupling (periodic fluids), FTS, multiblob12, multiblob42,
        multiblob162, multiblob642, FTS+lubrication, and multiblobs with +self, whose single spheres
        have Stokes' tensor; default: all except multiblob642 and rungs with +self
    observables : sequence of str, MobilityObservable or callable, optional
        see :func:`openmmrigidhi.accuracy.mobilities.byName`; default: the observables for which the
        scenes have exact numbers, or else the general ones
    reference : str, optional
        the rung with which the other rungs are compared; default: the best
    platforms : sequence of str
        platforms for the times of each rung; the faster platform counts
    threads : int
        threads of the CPU platform; with one thread, time is the process's CPU time where other
        programs lengthen the wall-clock time
    parameter : str, optional
        meaning of the keys of a dict of scenes; default: the parameter of a Sweep, or gap
    seed : int
        seed of the noise in the timed steps

    Examples
    --------
    >>> from openmmrigidhi import accuracy
    >>> pairs = accuracy.scenes.pairs([0.1, 1.0])
    >>> study = accuracy.LadderStudy(pairs, ['RPY', 'FTS', 'FTS+lubrication'], ['sedimentation'])
    >>> print(study.run(rounds=1).recommend('sedimentation:0.5%').setting['rung'])
    FTS+lubrication
    """
    def __init__(self, scene: Union[Scene,
                                    dict[float,
                                         Scene]], rungs: Optional[Sequence[Union[str,
                                                                                 Rung]]] = None,
                 observables: Optional[Sequence[Union[str, MobilityObservable, Callable]]] = None,
                 reference: Optional[str] = None, platforms: Sequence[str] = ('Reference', 'CPU'),
                 threads: int = 1, parameter: Optional[str] = None, seed: int = 1) -> None:
        self.scenes = {0.0: scene} if isinstance(scene, Scene) else dict(sorted(scene.items()))
        if not self.scenes:
            raise ValueError(
                'LadderStudy: scene: the dict is empty; it must have at least one scene')
        self.isSweep = not isinstance(scene, Scene)
        self.parameter = parameter or getattr(scene, 'parameter', 'gap')
        self.harder = getattr(scene, 'harder', 'smaller')
        first = next(iter(self.scenes.values()))
        if rungs is None:
            rungs = rungsModule.PERIODIC if first.system.usesPeriodicBoundaryConditions(
            ) else rungsModule.DEFAULT
        if observables is None:
            observables = [name for name in mobilities.BUILT_IN if name in first.exact
                           ] or mobilities.DEFAULT
        self.rungs = [rungsModule.byName(name) for name in rungs]
        self.observables = [mobilities.byName(name) for name in observables]
        for what, things in (('rungs', self.rungs), ('observables', self.observables)):
            names = [thing.name for thing in things]
            if len(set(names)) < len(names) or not names:
                raise ValueError(
                    f'LadderStudy: {what}: got {names}; at least one is needed, and each only once')
        self.reference = None if reference is None else rungsModule.byName(reference)
        self.platforms = tuple(platforms)
        self.threads = threads
        self.seed = seed

    def chooseReference(self, observable: MobilityObservable, values: dict) -> dict:
        """The reference of the rungs for an observable without an exact number.

        The result also estimates the error of this reference. For at most two spheres in unbounded
        fluid the reference is StokesianDynamics with lubrication, which is exact. For more spheres
        it lacks many-body terms, and multiblobs lack resolution where spheres nearly touch. The
        multiblob with the most blobs is the reference where multiblobs have converged (see
        :func:`remainder`) to less than half of its distance to StokesianDynamics. Elsewhere
        StokesianDynamics is the reference. Its estimated error is its distance to the finest
        multiblobs (unchanged, and with Stokes' tensor for each single sphere), since this distance
        contains both errors.

        Parameters
        ----------
        observable : MobilityObservable
        values : dict
            rung name -> value, for the computed rungs

        Returns
        -------
        dict
            rung (name), believed (relative error, or None if unknown), seconds (names of the rungs
            that tell it)
        """
        known = [rungsModule.byName(name) for name in values]
        own = [rung for rung in self.rungs if rung.name in values]

        def distance(rung, other):
            found = observable.compare(values[rung.name], values[other.name])
            return None if found is None else abs(found)

        if self.reference is not None:
            if self.reference.name not in values:
                raise ValueError(
                    f'LadderStudy: reference: {self.reference.name} cannot be used on this scene: '
                    f'choose another one')
            best = self.reference
        else:
            best = max(own or known, key=lambda rung:
                       (rung.isBest, rung.blobs, rung.exactAlone, rung.model))
        plain = sorted((rung for rung in own if rung.blobs and not rung.exactAlone),
                       key=lambda rung: rung.blobs)
        converged = remainder([distance(rung, plain[-1]) for rung in plain[:-1]]) if plain else None
        if (best.isBest and self.reference is None and converged is not None
                and converged < 0.5*distance(best, plain[-1])):
            best = plain[-1]
        if plain and best == plain[-1]:
            return {
                'rung': best.name,
                'believed': converged,
                'seconds': [rung.name for rung in plain[:-1]]
            }
        finest = max((rung.blobs for rung in known if rung.blobs != best.blobs), default=0)
        seconds = [rung for rung in known if rung.blobs == finest > 0]
        # The smallest of the distances says most.
        distances = [d for d in (distance(rung, best) for rung in seconds) if d is not None]
        return {
            'rung': best.name,
            'believed': min(distances, default=None),
            'seconds': [rung.name for rung in seconds]
        }

    def run(self, rounds: int = 5, seconds: float = 0.05, progress: Optional[Callable] = None,
            jobs: int = 1, cluster: Optional[str] = None) -> LadderResult:
        """Compute and time everything.

        It measures times here, one after the other, after everything else.

        Parameters
        ----------
        rounds : int
            number of rounds in which the rungs take turns
        seconds : float
            time for each rung in a round
        progress : callable, optional
            called with (done, total, text)
        jobs : int
            number of mobilities computed at a time
        cluster : str, optional
            who computes them: see :func:`openmmrigidhi.ensemble.tasks.run`

        Returns
        -------
        LadderResult
        """
        check_lengths('LadderStudy.run', rounds=rounds)
        began = time.perf_counter()
        # Other estimates of the best rung are computed even if nobody asked for them as rungs.
        extra = self._second_opinions()
        total, done = len(self.scenes)*(len(self.rungs) + len(extra)) + 2*len(self.rungs), 0
        rows, references, messages = [], {}, {}

        def count(text):
            nonlocal done
            done += 1
            if progress is not None:
                progress(done, total, text)

        spheres = {value: Spheres(scene) for value, scene in self.scenes.items()}
        places = [(value, rung) for value in self.scenes for rung in [*self.rungs, *extra]]
        outcomes = _tasks.run(_mobility,
                              [(self.scenes[value], rung, self.platforms[-1], self.threads)
                               for value, rung in places], jobs, cluster,
                              finished=lambda outcome: count(self._text(*places[outcome.index])),
                              quiet=True)
        found = {(value, rung.name): outcome.get()
                 for (value, rung), outcome in zip(places, outcomes)}
        for value, scene in self.scenes.items():
            samples = {}
            for rung in [*self.rungs, *extra]:
                sample, message = found[value, rung.name]
                if message is None:
                    samples[rung.name] = rung, sample
                else:
                    messages[value, rung.name] = message
            if not samples:
                raise ValueError('LadderStudy: none of the rungs can be used on this scene: ' +
                                 '; '.join(messages.values()))
            references[value] = self._compare(value, scene, spheres[value], samples, messages, rows)
        middle = list(self.scenes)[len(self.scenes) // 2]
        costs, problems = self._time(spheres[middle], rounds, seconds, count)
        for row in rows:
            row['message'] = row['message'] or problems.get(row['rung'], '')
            row.update({
                key: costs.get(row['rung'], {}).get(key)
                for key in ('seconds_step', 'seconds_low', 'seconds_high', 'seconds_forces',
                            'platform', 'solver')
            })
        scene = self.scenes[middle]
        about = {
            'name': self.parameter + 's of ' + scene.name if self.isSweep else scene.name,
            'description': scene.description,
            'harder': self.harder,
            'bodies': len(scene.bodies),
            'temperature': scene.temperature,
            'timed_at': middle if self.isSweep else None
        }
        return LadderResult(
            about, self.parameter if self.isSweep else None, rows, references,
            {o.name: {
                'label': o.label,
                'description': o.description
            }
             for o in self.observables}, {rung.name: rung.description
                                          for rung in self.rungs}, {
                                              'rounds': rounds,
                                              'threads': self.threads,
                                              'seed': self.seed,
                                              'platforms': ', '.join(self.platforms),
                                              **provenance(began)
                                          })

    def _text(self, value, rung):
        return f'{rung.name} {self.parameter} {value:g}' if self.isSweep else rung.name

    def _second_opinions(self):
        """Rungs that are computed, but not offered: the finest multiblob with exact own tensors."""
        if all(len(scene.bodies) <= 2
               for scene in self.scenes.values()) or all(observable.name in scene.exact
                                                         for observable in self.observables
                                                         for scene in self.scenes.values()):
            return []
        counts = sorted({rung.blobs for rung in self.rungs})
        best = max(self.rungs, key=lambda rung:
                   (rung.isBest, rung.blobs)) if self.reference is None else self.reference
        finest = max((n for n in counts if n != best.blobs), default=0)
        own = {rung.name for rung in self.rungs}
        return [
            rung for rung in rungsModule.RUNGS.values()
            if rung.blobs == finest > 0 and rung.exactAlone and rung.name not in own
        ]

    def _compare(self, value, scene, spheres, samples, messages, rows):
        """Add the rows of one scene; return what is known about its reference."""
        exact = self.reference is None and BEST in samples and len(
            spheres.radii) <= 2 and not spheres.isPeriodic
        reference = {'exact': exact, 'observables': {}}
        for observable in self.observables:
            values = {name: observable.measure(sample) for name, (_, sample) in samples.items()}
            if self.reference is None and observable.name in scene.exact:
                right = scene.exact[observable.name]
                chosen = {'rung': EXACT, 'believed': DIGITS_ERROR, 'seconds': [], 'value': right}
            else:
                chosen = {
                    'rung': BEST,
                    'believed': PAIR_ERROR,
                    'seconds': []
                } if exact else self.chooseReference(observable, values)
                right = values[chosen['rung']]
            reference['observables'][observable.name] = chosen
            for rung in self.rungs:
                error = observable.compare(values[rung.name],
                                           right) if rung.name in values else None
                measured = values.get(rung.name)
                rows.append({
                    'parameter': value,
                    'rung': rung.name,
                    'observable': observable.name,
                    'status': STABLE if rung.name in values else NOT_APPLICABLE,
                    'message': messages.get((value, rung.name), ''),
                    'value': None if measured is None else
                    float(measured if np.ndim(measured) == 0 else np.linalg.norm(measured)),
                    'error': error,
                    'believed': chosen['believed'],
                    'is_reference': rung.name == chosen['rung']
                })
        return reference

    def _time(self, spheres, rounds, seconds, count):
        """Seconds a step of each rung on its faster platform, and what went wrong.

        The seconds are medians over rounds in which all rungs take turns.
        """
        runs, problems, forces = [], {}, {
            p: spheres.secondsOfForces(p, platformProperties(p, self.threads))
            for p in self.platforms
        }
        for rung in self.rungs:
            one = 0.0
            # Reference is faster only by its smaller overhead; with long steps it cannot win.
            for platform in sorted(self.platforms):
                if platform == 'Reference' and one > LONG_STEP:
                    continue
                try:
                    _, integrator, context = spheres.makeContext(
                        rung, platform, platformProperties(platform, self.threads), self.seed)
                    integrator.step(1)
                    one = self._own_seconds(integrator, 1)
                    runs.append((rung, platform, integrator, context,
                                 min(1000, max(1, round(seconds/max(one, 1e-7)))),
                                 [one] if one > VERY_LONG_STEP else []))
                except (openmm.OpenMMException, ValueError) as error:
                    problems.setdefault(rung.name, f'not timed on {platform}: {error}')
            count(f'timing {rung.name}')
        rng = np.random.default_rng(self.seed)
        broken = set()
        for turn in range(rounds):
            for i in rng.permutation(len(runs)):
                rung, platform, integrator, _, steps, times = runs[i]
                # Two rounds are enough for long steps, and the trial for steps of seconds.
                if i in broken or (turn >= 2 and times[-1]*steps > 20*seconds) or (
                        times and times[0] > VERY_LONG_STEP):
                    continue
                try:
                    spheres.reset(integrator)
                    times.append(self._own_seconds(integrator, steps))
                except openmm.OpenMMException as error:
                    broken.add(i)
                    problems.setdefault(rung.name, f'not timed to the end on {platform}: {error}')
        costs = {}
        for rung in self.rungs:
            for i, (other, platform, integrator, _, _, times) in enumerate(runs):
                if other is not rung or not times:
                    continue
                low, middle, high = np.percentile(times, [16, 50, 84]) + forces[platform]
                if rung.name not in costs or middle < costs[rung.name]['seconds_step']:
                    effect = integrator.getEffects().get('hydrodynamics', '')
                    costs[rung.name] = {
                        'seconds_step': float(middle),
                        'seconds_low': float(low),
                        'seconds_high': float(high),
                        'seconds_forces': forces[platform],
                        'platform': platform,
                        'solver': 'matrix-free' if ' matrix-free' in effect else
                        'dense' if ' with dense matrices' in effect else 'none'
                    }
            count(f'timing {rung.name}')
        return costs, problems

    def _own_seconds(self, integrator, steps):
        """Seconds a step without the forces.

        They are by the clock, or the process's CPU time if it is less because other programs
        disturb.
        """
        before, cpu = integrator.getStepStatistics(), time.process_time()
        integrator.step(steps)
        cpu, after = time.process_time() - cpu, integrator.getStepStatistics()
        wall = sum(after[key] - before[key] for key in ('seconds_mobility', 'seconds_scheme'))
        return (min(wall, cpu) if self.threads == 1 else wall)/steps


def _mobility(argument, job):
    """The MobilitySample of a scene by a rung and None, or None and the reason for its absence."""
    scene, rung, platform, threads = argument
    spheres = Spheres(scene)
    try:
        fluid, _, context = spheres.makeContext(rung, platform,
                                                platformProperties(platform, threads))
        sample = spheres.sample(fluid, context)
        del context
        return sample, None
    except (openmm.OpenMMException, ValueError) as error:
        return None, str(error)
