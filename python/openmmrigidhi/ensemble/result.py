"""The results of a study: means over replicas with their errors, and each task's outcome."""
from __future__ import annotations

import csv
import io
import json
import math
import os
from dataclasses import dataclass
from typing import Optional, Sequence

import numpy as np
import openmm.unit

from .. import _units
from .._types import Array
from ..accuracy.observables import splitBodies
from ..accuracy.statistics import quantile
from ..analysis.series import LARGEST_RHAT, independentRuns
from . import taskfiles

CONFIDENCE = 0.95
COLUMNS = ('setting', 'settings', 'observable', 'unit', 'mean', 'standard_error', 'degrees', 'low',
           'high', 'replicas', 'samples', 'tau', 'effective_samples', 'r_hat', 'exact', 'note')


@dataclass
class TaskRecord:
    """The outcome of a task.

    Attributes
    ----------
    setting, replica : int
    settings : dict
    seed : int
    path : str
        path of its file
    status : str
        'complete', 'unfinished', 'waiting', 'failed' or 'damaged'
    message, traceback : str
        reason why the task failed or its file is damaged
    samples : int
    length : float
        sampled time, ps
    seconds : float
        wall time of its steps
    """

    setting: int
    replica: int
    settings: dict
    seed: int
    path: str
    status: str = 'waiting'
    message: str = ''
    traceback: str = ''
    samples: int = 0
    length: float = 0.0
    seconds: float = 0.0

    def __str__(self):
        text = (f'setting {self.setting} {self.settings}, replica {self.replica}, seed '
                f'{self.seed}: {self.status}')
        return text + (f' ({self.message})' if self.message else f', {self.length:g} ps')


class EnsembleResult:
    """Means over replicas, and the samples behind them.

    Attributes
    ----------
    definition : dict
        the definition of the study
    observables : dict
        name -> dict with label and unit
    tasks : list of TaskRecord
    rows : list of dict
        one row for each setting and observable: setting, settings, observable, unit, mean,
        standard_error (over replicas; for a single replica from block averages), degrees (degrees
        of freedom of standard_error, for Student's t), low, high (95 % interval), replicas,
        samples, tau (ps), effective_samples, r_hat, exact (where the scene knows it), note. Failed
        replicas are left out. Of unfinished replicas the existing samples count.
    about : dict
        the study's JSON: machine, versions, sessions, failures
    """
    def __init__(self, definition: dict, observables: dict, tasks: list[TaskRecord], contents: dict,
                 about: dict) -> None:
        self.definition, self.observables, self.tasks, self.about = (definition, observables, tasks,
                                                                     about)
        self._contents = contents
        self.rows = [
            self._row(setting, name) for setting in range(len(definition['settings']))
            for name in observables
        ]

    def series(self, observable: str, setting: int, replica: int) -> Array:
        """The samples of one task.

        Parameters
        ----------
        observable : str
        setting, replica : int

        Returns
        -------
        ndarray of shape (n,), or (n, k) for a scene that contains k independent replicas
        """
        content = self._contents.get((setting, replica))
        if content is None or observable not in content.series:
            raise ValueError(
                f'series: found no samples of {observable!r} in setting {setting}, replica '
                f'{replica}; it must be one of {", ".join(self.observables)}, of a task that has '
                'begun: see the tasks of this result')
        return content.series[observable]

    def row(self, observable: str, setting: int = 0) -> dict:
        """One row of the table.

        Parameters
        ----------
        observable : str
        setting : int

        Returns
        -------
        dict
        """
        return next(row for row in self.rows
                    if (row['observable'], row['setting']) == (observable, setting))

    def sampleInterval(self, setting: int = 0) -> openmm.unit.Quantity:
        """The time between the samples of a setting: a whole number of steps.

        Parameters
        ----------
        setting : int

        Returns
        -------
        Quantity
            ps

        Raises
        ------
        ValueError
            if no replica of this setting has begun
        """
        for task in self.tasks:
            content = self._contents.get((setting, task.replica))
            if task.setting == setting and content is not None:
                return _units.TIME.attach(content.about['sample_interval'])
        raise ValueError(f'sampleInterval: setting {setting} has no samples yet; run the study, '
                         f'or give one of its {len(self.definition["settings"])} settings')

    def histogram(self, of: str = 'height', setting: int = 0,
                  bodies: Optional[Sequence[int]] = None) -> tuple[Array, Array, Array]:
        """The averages of the observables of a histogram.

        Parameters
        ----------
        of : str
            the argument of :func:`openmmrigidhi.accuracy.observables.bins`: "height" or
            "module:function"
        setting : int
        bodies : sequence of int, optional
            those of :func:`openmmrigidhi.accuracy.observables.bins`

        Returns
        -------
        edges : array of shape (n, 2)
            lower and upper edges of the bins, nm for heights
        fractions, errors : array of shape (n,)
            mean fraction of bodies in each bin, and its standard error

        Raises
        ------
        ValueError
            if the study has no such observables, or no samples of them yet
        """
        wanted = None if bodies is None else set(bodies)
        rows, names = [], []
        for row in self.rows:
            if (row['setting'] != setting or row['mean'] is None
                    or not row['observable'].startswith(f'{of}[')):
                continue
            name, chosen = splitBodies(row['observable'])
            if (None if chosen is None else set(chosen)) == wanted:
                rows.append(row)
                names.append(name)
        if not rows:
            whose = '' if bodies is None else f' of bodies {sorted(wanted)}'
            raise ValueError(
                f'histogram: found no samples of bins of {of!r}{whose} in setting {setting}; they '
                f'must be observables of the study, which has {", ".join(self.observables)}: give '
                'it accuracy.observables.bins()')
        lengths = _units.LENGTHS if of == 'height' else {'': 1.0}
        edges = [[
            _units.from_text(edge, lengths, 'nm' if of == 'height' else '')
            for edge in name[len(of) + 1:-1].split(',')
        ] for name in names]
        return (np.array(edges), np.array([row['mean'] for row in rows]),
                np.array([row['standard_error'] for row in rows]))

    @property
    def isComplete(self) -> bool:
        """Whether all tasks are complete."""
        return all(task.status == 'complete' for task in self.tasks)

    def problems(self) -> list:
        """Failed tasks and tasks with damaged files, a list of TaskRecord."""
        return [task for task in self.tasks if task.status in ('failed', 'damaged')]

    def _row(self, setting, name):
        row = dict.fromkeys(COLUMNS)
        row.update(setting=setting, settings=self.definition['settings'][setting], observable=name,
                   unit=self.observables[name]['unit'], replicas=0, samples=0, note='')
        mine = [task for task in self.tasks if task.setting == setting]
        chains, interval, meaningless, holes, gaps, short = [], None, [], [], [], []
        for task in mine:
            content = self._contents.get((setting, task.replica))
            if content is None or task.status == 'failed' or name not in content.series:
                continue
            chain = np.asarray(content.series[name], dtype=float)
            chain = chain.mean(axis=1) if chain.ndim == 2 else chain
            whole, afterGaps = _without_beginnings(chain, content.about)
            if len(chain) and np.isnan(chain).all():
                # It has no meaning in this scene, or the run is too short for it.
                meaningless.append(task)
                continue
            if np.isnan(whole).any():
                holes.append(task)
                continue
            chain = whole
            if len(chain) < 2:
                short.append(task)
                continue
            if afterGaps:
                gaps.append(task)
            chains.append(chain)
            interval = content.about['sample_interval']
            row['exact'] = content.about['exact'].get(name)
        notes = []
        if meaningless and not chains and not holes:
            notes.append('n/a')
        elif meaningless:
            notes.append(f'{_replicas(meaningless)} not a number, left out')
        if holes:
            notes.append(f'{_replicas(holes)} sometimes not a number, left out')
        if gaps:
            notes.append(f'{_replicas(gaps)} without samples after interruptions')
        complete = [task for task in short if task.status == 'complete']
        if complete:
            notes.append(
                f'{_replicas(complete)} with fewer than two samples, left out: run longer, '
                'or take a shorter sampleInterval')
        asked = self.definition.get('sample_interval')
        if interval is not None and asked is not None and abs(interval/asked - 1) > 1e-6:
            notes.append(f'samples are every {interval:.12g} ps, a whole number of steps, and not '
                         f'every {asked:.12g} ps')
        if chains:
            found = independentRuns(chains)
            reach = quantile(CONFIDENCE, found.degrees)*found.standardError
            row.update(mean=found.mean, standard_error=found.standardError, degrees=found.degrees,
                       low=found.mean - reach, high=found.mean + reach, replicas=len(chains),
                       samples=found.samples, tau=found.tau*interval,
                       effective_samples=found.effectiveSamples,
                       r_hat=None if found.rHat is None or np.isnan(found.rHat) else found.rHat)
            if row['r_hat'] == math.inf:
                notes.append('R-hat is infinite: each replica is stuck at a value of its own')
            elif row['r_hat'] is not None and row['r_hat'] > LARGEST_RHAT:
                notes.append(f'R-hat above {LARGEST_RHAT}: run longer')
            if len(chains) == 1:
                notes.append('one replica: error from blocks')
        for status in ('failed', 'damaged', 'unfinished', 'waiting'):
            count = sum(task.status == status for task in mine)
            if count:
                notes.append(f'{count} {status}')
        row['note'] = ', '.join(notes)
        return row

    # ---- Text and files --------------------------------------------------------------------------

    def table(self) -> str:
        """The rows and the problems as text."""
        lines = [
            f'{"setting":40} {"observable":26} {"mean":>14} {"error":>10} {"t":>3} {"R-hat":>6} '
            f'{"eff. samples":>12}  note'
        ]
        for row in self.rows:
            settings = ', '.join(f'{key} {value}'
                                 for key, value in row['settings'].items()) or 'as it is'
            number = '' if row['mean'] is None else (
                f'{row["mean"]:14.6g} {row["standard_error"]:10.2g} {row["degrees"]:3d} '
                f'{"-" if row["r_hat"] is None else format(row["r_hat"], ".3f"):>6} '
                f'{row["effective_samples"]:12.0f}')
            lines.append(f'{row["setting"]:>3} {settings:36} {row["observable"]:26} {number:49}  '
                         f'{row["unit"]}{"; " if row["unit"] and row["note"] else ""}{row["note"]}')
        return '\n'.join([*lines, *(str(task) for task in self.problems())])

    def asDict(self) -> dict:
        """Everything except the samples, as values that JSON can hold."""
        tasks = [{
            'setting': task.setting,
            'replica': task.replica,
            'seed': task.seed,
            'status': task.status,
            'message': task.message,
            'samples': task.samples,
            'length': task.length,
            'seconds': round(task.seconds, 3)
        } for task in self.tasks]
        # JSON has no infinity; the note of the row tells it.
        rows = [dict(row, r_hat=None) if row['r_hat'] == math.inf else row for row in self.rows]
        return {
            'format': 'openmmrigidhi ensemble result 1',
            'definition': self.definition,
            'observables': self.observables,
            'rows': rows,
            'tasks': tasks,
            'sessions': self.about['sessions']
        }

    def write(self, directory: str) -> list[str]:
        """Write results.json and results.csv.

        Parameters
        ----------
        directory : str

        Returns
        -------
        list of str
            their paths
        """
        json_, csv_ = (os.path.join(directory, 'results' + end) for end in ('.json', '.csv'))
        for path, fill in ((json_, self._fill_json), (csv_, self._fill_csv)):
            text = io.StringIO(newline='')
            fill(text)
            taskfiles.write(path, text.getvalue().encode())
        return [json_, csv_]

    def _fill_json(self, file):
        json.dump(self.asDict(), file, indent=1)
        file.write('\n')

    def _fill_csv(self, file):
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(COLUMNS)
        for row in self.rows:
            writer.writerow([
                '' if row[key] is None else f'{row[key]:.8g}' if isinstance(row[key], float) else
                json.dumps(row[key]) if key == 'settings' else row[key] for key in COLUMNS
            ])


def _replicas(tasks):
    return f'replica{"s" if len(tasks) > 1 else ""} ' + ' and '.join(
        [', '.join(str(task.replica)
                   for task in tasks[:-1])]*(len(tasks) > 1) + [str(tasks[-1].replica)])


def _without_beginnings(chain, about):
    """A chain without the samples that are NaN because there was nothing to compare them with.

    They are the first ones of a task, and of each session that had to begin to remember anew.

    Parameters
    ----------
    chain : ndarray of shape (n,)
    about : dict
        of the task's file

    Returns
    -------
    (ndarray, bool)
        the rest, and whether samples inside are left out
    """
    warm = about['position'] - about['samples']
    begins = sorted({0} | {
        min(len(chain), session['from_position'] - warm)
        for session in about['sessions'] if session['from_position'] > warm
    })
    keep = np.ones(len(chain), dtype=bool)
    for begin, end in zip(begins, [*begins[1:], len(chain)]):
        numbers = np.flatnonzero(~np.isnan(chain[begin:end]))
        keep[begin:begin + (numbers[0] if len(numbers) else end - begin)] = False
    first = np.flatnonzero(keep)
    return chain[keep], bool(len(first)) and not keep[first[0]:].all()
