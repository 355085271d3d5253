"""What the results of all studies share: wanted errors and answers, the machine, CSV and JSON."""
from __future__ import annotations

import csv
import json
import math
import os
import platform
import re
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Collection, Optional, Sequence, TypeVar, Union

import numpy as np
import openmm
import scipy

from .. import _loading

if TYPE_CHECKING:
    from ._pages import Report

RECOMMENDED, NONE, UNDECIDED = 'recommended', 'none of these', 'cannot tell'
#: Above this factor, "run N times longer" is not given as advice.
LARGEST_FACTOR = 1000
#: Why an answer is not sharper, or that it is as sharp as can be. What to do follows from the
#: verdict and the reason (_pages.advise).
DECIDED, UNUSABLE = 'decided', 'nothing could be used'
LONGER, HARDLY = 'longer runs decide', 'longer runs hardly decide'
SMALL_STEPS, REFERENCE = 'the limit of small steps', 'the reference'
NO_REFERENCE, NO_MEAN = 'nothing to compare with', 'no mean'

# ---- Wanted errors and answers -------------------------------------------------------------------


@dataclass
class Wanted:
    """A wanted error: |mean - reference| <= tolerance (observable's unit), as given by text."""

    observable: str
    tolerance: float
    text: str


@dataclass
class Recommendation:
    """The answer to "what is the cheapest setting with this error?".

    Attributes
    ----------
    verdict : str
        'recommended', 'none of these' or 'cannot tell'
    setting : dict or None
        the recommended candidate
    text : str
        one paragraph
    candidates : list of dict
        every usable setting, fastest first, with its verdict ('yes', 'no', 'undecided', 'n/a') and
        the additional entries of recommend()
    factor : float or None
        how many times longer a run would have to be to settle an undecided answer, or to decide
        about a faster setting
    reason : str
        'decided', or why the answer is not sharper, from which the report's advice follows
    """

    verdict: str
    setting: Optional[dict]
    text: str
    candidates: list
    factor: Optional[float]
    wanted: list
    reason: str = DECIDED

    def __str__(self):
        return self.text


def split_wanted(wanted: Union[str, Sequence[str]], names: Collection[str],
                 example: str) -> list[tuple[str, str, float]]:
    """Wanted errors from text, as (observable, amount as written, its number).

    Parameters
    ----------
    wanted : str, or sequence of str
        text such as "observable:0.5%" or "observable:0.2"; several are separated by commas
    names : collection of str
        the observables of the result
    example : str
        an example for error messages

    Returns
    -------
    list of (str, str, float)
    """
    items = wanted.split(',') if isinstance(wanted, str) else list(wanted)
    if not items:
        raise ValueError(f'wanted error: got none; at least one is needed: write e.g. {example}')
    result = []
    for item in items:
        name, _, amount = item.strip().rpartition(':')
        if name not in names:
            raise ValueError(
                f'wanted error: got {item.strip()!r}, which is not measured; name one that is: the '
                f'observable must be one of {", ".join(names)}, as in {example}')
        try:
            value = float(amount.rstrip('%'))
        except ValueError:
            value = math.nan
        if not value > 0 or not math.isfinite(value):
            raise ValueError(
                f'wanted error: got {item!r}; the error must be a positive number or percentage: '
                f'write e.g. {example}')
        result.append((name, amount, value))
    return result


def check_lengths(where: str, budget: Optional[float] = None, length: Optional[float] = None,
                  equilibration: Optional[float] = None, rounds: Optional[int] = None) -> None:
    """Refuse impossible lengths of a measurement; None is not checked.

    Parameters
    ----------
    where : str
        who asks
    budget : float, optional
        s
    length, equilibration : float, optional
        ps
    rounds : int, optional
    """
    for name, value, what, isRight in (
        ('budget', budget, 'the time for the measurement must be above 0 and finite, in seconds',
         lambda x: 0 < x < math.inf), ('length', length,
                                       'the time of each run must be above 0 and finite',
                                       lambda x: 0 < x < math.inf),
        ('equilibration', equilibration, 'the time left out must be 0 or more and finite',
         lambda x: 0 <= x < math.inf), ('rounds', rounds,
                                        'the number of turns must be a whole number of 1 or more',
                                        lambda x: x >= 1 and x == int(x))):
        try:
            if value is None or isRight(value):
                continue
        except (TypeError, ValueError, OverflowError):
            pass
        raise ValueError(f'{where}: {name}: got {value!r}; {what}')


def checked_confidence(confidence: float, where: str) -> float:
    """A confidence, if it is one.

    Parameters
    ----------
    confidence : float
    where : str
        who asks
    """
    if not 0 < confidence < 1:
        raise ValueError(f'{where}: confidence: got {confidence}; it must be above 0 and below 1: '
                         f'give e.g. 0.95')
    return confidence


def worst(verdicts: Collection[str]) -> str:
    """The verdict about a setting from the verdicts about each wanted error.

    'no' comes before 'n/a' before 'undecided' before 'yes'.
    """
    return next((verdict for verdict in ('no', 'n/a', 'undecided') if verdict in verdicts), 'yes')


def decide(candidates: Sequence[dict]) -> tuple[str, Optional[dict], list[dict]]:
    """The verdict, the cheapest candidate that qualifies or None, and those that may qualify.

    Candidates are by ascending cost.
    """
    best = next((candidate for candidate in candidates if candidate['verdict'] == 'yes'), None)
    undecided = [candidate for candidate in candidates if candidate['verdict'] == 'undecided']
    meaningless = candidates and all(candidate['verdict'] == 'n/a' for candidate in candidates)
    return (RECOMMENDED if best is not None else UNDECIDED if undecided or meaningless else NONE,
            best, undecided)


def factor_to_decide(undecided: list[dict]) -> float:
    """How many times longer to run for an answer where no setting is decided in favour.

    A setting that is decided in favour is an answer. If none looks like it, all must be decided.

    Parameters
    ----------
    undecided : list of dict
        candidates with likely and factor
    """
    likely = [candidate['factor'] for candidate in undecided if candidate['likely']]
    return min(likely) if likely else max(candidate['factor'] for candidate in undecided)


def times(factor: float) -> str:
    """How many times longer to run, as text of two digits.

    Parameters
    ----------
    factor : float
    """
    return f'{float(f"{max(1.1, factor):.2g}"):g}'


# ---- Files ---------------------------------------------------------------------------------------


def json_text(data: dict) -> str:
    """Data as JSON that people can read: each list of numbers is on one line.

    Parameters
    ----------
    data : dict

    Returns
    -------
    str
    """
    return re.sub(r'\[[^\[\]{}"]*\]', lambda match: ' '.join(match.group().split()),
                  json.dumps(data, indent=1)) + '\n'


#: The class of a result.
_Kind = TypeVar('_Kind', bound='Result')


class Result:
    """Rows of a table, and data on their measurement.

    A subclass has asDict(), fromDict(), recommend() and a REPORT.

    Attributes
    ----------
    rows : list of dict
        one row for each setting and observable
    observables : dict
        name -> dict with label
    scene : dict
        with name and description
    provenance : dict
        what provenance() returned, and the settings of the study
    """

    #: The name of the format in the JSON; the columns of the CSV; the class of the report.
    FORMAT, COLUMNS, REPORT = '', (), None
    rows: list[dict]
    observables: dict[str, dict]
    scene: dict
    provenance: dict

    def parseWanted(self, wanted: Union[str, Sequence[str]]) -> list[Wanted]:
        """Wanted relative errors from text.

        Parameters
        ----------
        wanted : str, or sequence of str
            text such as "observable:0.5%" or "observable:5e-3"; several are separated by commas

        Returns
        -------
        list of Wanted
        """
        return [
            Wanted(name, value/100 if amount.endswith('%') else value,
                   f'{amount} of {self.observables[name]["label"]}')
            for name, amount, value in split_wanted(wanted, self.observables, self.REPORT.EXAMPLE)
        ]

    def report(self, wanted: Sequence[str] = ()) -> Report:
        """The report: the files of :meth:`write`, textTable() and paragraphs().

        Parameters
        ----------
        wanted : sequence of str
            wanted errors; the report answers each of them

        Returns
        -------
        Report
            a report of the class for this result
        """
        return self.REPORT(self, wanted)

    def write(self, directory: str, wanted: Sequence[str] = ()) -> list[str]:
        """Write CSV, JSON, pictures and an HTML page into a directory.

        The CSV has the rows, and the JSON has everything.

        Parameters
        ----------
        directory : str
            created if it does not exist
        wanted : sequence of str
            wanted errors; the report answers each of them

        Returns
        -------
        list of str
            paths of the files
        """
        return self.report(wanted).write(directory)

    def writeJson(self, path: str, **extra: Any) -> None:
        """Write everything as JSON; extra entries are added at the top level.

        Parameters
        ----------
        path : str
        """
        with open(path, 'w') as file:
            file.write(json_text(dict(self.asDict(), **extra)))

    @classmethod
    def isOne(cls, path: str) -> bool:
        """Whether writeJson() of this class wrote a file.

        Parameters
        ----------
        path : str
        """
        return _read(path).get('format') == cls.FORMAT

    @classmethod
    def fromJson(cls: type[_Kind], path: str) -> _Kind:
        """Read a file of writeJson().

        Parameters
        ----------
        path : str

        Raises
        ------
        ValueError
            if writeJson() of this class did not write the file
        """
        data = _read(path)
        if data.get('format') != cls.FORMAT:
            raise ValueError(
                f'{path}: it is no result of openmmrigidhi.accuracy that a {cls.__name__} wrote: '
                f'give the file of such a study')
        return cls.fromDict(data)

    def writeCsv(self, path: str) -> None:
        """Write the table as CSV, one line for each row; a cell without a number is empty.

        Parameters
        ----------
        path : str
        """
        with open(path, 'w', newline='') as file:
            writer = csv.writer(file, lineterminator='\n')
            writer.writerow(self.COLUMNS)
            for row in self.rows:
                writer.writerow([
                    '' if row.get(key) is None else
                    f'{row[key]:.8g}' if isinstance(row[key], float) else row[key]
                    for key in self.COLUMNS
                ])


def finite(value: Any) -> Any:
    """A value for JSON, where infinite numbers are null, in dicts and lists, too."""
    if isinstance(value, dict):
        return {key: finite(each) for key, each in value.items()}
    if isinstance(value, list):
        return [finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _read(path):
    with open(path) as file:
        return json.load(file)


# ---- The machine ---------------------------------------------------------------------------------


def beginning() -> dict:
    """When a measurement began, and how busy the machine was."""
    return {'started': _now(), 'load_at_start': _load()}


def provenance(began: float) -> dict:
    """The date, machine and versions of a measurement.

    Parameters
    ----------
    began : float
        time.perf_counter() at the start of the measurement

    Returns
    -------
    dict
    """
    return {
        'finished': _now(),
        'wall_seconds': round(time.perf_counter() - began, 1),
        'load_at_end': _load(),
        'processor': _processor(),
        'processors': os.cpu_count(),
        'system': platform.system(),
        'architecture': platform.machine(),
        'versions': {
            'openmmrigidhi': _loading.version,
            'openmm': openmm.version.full_version,
            'python': platform.python_version(),
            'numpy': np.__version__,
            'scipy': scipy.__version__
        }
    }


def _now():
    return time.strftime('%Y-%m-%dT%H:%M:%SZ', time.gmtime())


def _load():
    return [round(x, 2) for x in os.getloadavg()] if hasattr(os, 'getloadavg') else None


def _processor():
    try:
        with open('/proc/cpuinfo') as file:
            for line in file:
                if line.startswith('model name'):
                    return line.split(':', 1)[1].strip()
    except OSError:
        pass
    return platform.processor()
