"""The result of the hydrodynamic ladder: errors and times of models, and recommendations."""
from __future__ import annotations

from typing import Optional, Sequence, Union

from ._results import (DECIDED, NO_REFERENCE, NONE, RECOMMENDED, REFERENCE, UNDECIDED, UNUSABLE,
                       Recommendation, Result, decide, worst)
from .ladderreport import LadderReport, duration, percent
from .measurement import STABLE
from .rungs import BEST

#: This name takes the place of a rung's name for exact numbers of the scenes.
EXACT = 'exact numbers'


class LadderResult(Result):
    """Rows of rungs and observables, the references, and data on the measurement.

    Attributes
    ----------
    rows : list of dict
        one row for each scene, rung and observable. Keys: parameter (0 for a single scene), rung,
        observable, status ('stable' or 'not applicable'), message, value (arrays: their norm),
        error (relative to the reference rung), believed (error of the reference rung itself, or
        None if unknown), is_reference, seconds_step (of LangevinHI, the scene's forces included;
        median over rounds), seconds_low and _high (16 and 84 %), seconds_forces (the part of
        seconds_step for the scene's forces), platform (the faster one), solver.
    references : dict
        parameter -> dict with exact (whether the reference is a pair's, exact up to rounding) and
        observables: name -> dict with rung (or 'exact numbers'), believed (relative error of the
        reference itself, or None), seconds (the rungs that tell it) and, for exact numbers, value
    parameter : str or None
        the parameter that distinguishes the scenes; None for a single scene
    """

    FORMAT = 'openmmrigidhi.accuracy.ladder 1'
    REPORT = LadderReport
    COLUMNS = ('parameter', 'rung', 'observable', 'status', 'value', 'error', 'believed',
               'is_reference', 'seconds_step', 'seconds_low', 'seconds_high', 'seconds_forces',
               'platform', 'solver', 'message')

    def __init__(self, scene: dict, parameter: Optional[str], rows: list[dict], references: dict,
                 observables: dict[str, dict], rungs: dict[str, str], provenance: dict) -> None:
        self.scene = scene
        self.parameter = parameter
        self.rows = rows
        self.references = references
        self.observables = observables
        self.rungs = rungs
        self.provenance = provenance

    # ---- Questions -------------------------------------------------------------------------------

    def select(self, observable: str, rung: Optional[str] = None) -> list[dict]:
        """Rows of one observable that have an error, by ascending parameter.

        Parameters
        ----------
        observable : str
        rung : str, optional
            only rows of this rung

        Returns
        -------
        list of dict
        """
        return sorted((row for row in self.rows if row['observable'] == observable and rung in (
            None, row['rung']) and row['error'] is not None), key=lambda row: row['parameter'])

    def seconds(self, rung: str) -> Optional[float]:
        """Seconds a step of a rung, or None.

        Parameters
        ----------
        rung : str
        """
        return next((row['seconds_step'] for row in self.rows if row['rung'] == rung), None)

    @staticmethod
    def judge(row: dict, tolerance: float) -> str:
        """Whether an error meets a tolerance: 'yes', 'no', 'undecided' or 'n/a'.

        The reference itself has an error, which limits the knowledge of a rung's error.

        Parameters
        ----------
        row : dict
        tolerance : float
            relative
        """
        if row['error'] is None:
            return 'n/a'
        size, own = abs(row['error']), row['believed']
        if own is None:
            return 'undecided'
        if size + own <= tolerance:
            return 'yes'
        return 'no' if size - own > tolerance else 'undecided'

    def recommend(self, wanted: Union[str, Sequence[str]]) -> Recommendation:
        """The cheapest rung whose errors are below the wanted errors in every scene.

        Parameters
        ----------
        wanted : str or sequence of str
            see :meth:`parseWanted`

        Returns
        -------
        Recommendation
            its setting and candidates have rung, seconds_step, platform, error (the largest error
            of the first observable), bound (the largest error with the believed error of the
            reference), isWhole (whether the rung could be used on all scenes) and verdict
        """
        wanted = self.parseWanted(wanted)
        candidates = []
        for rung in self.rungs:
            rows = [row for row in self.rows if row['rung'] == rung]
            verdicts = [
                self.judge(row, item.tolerance) if row['status'] == STABLE else 'no'
                for item in wanted for row in rows if row['observable'] == item.observable
            ]
            if self.seconds(rung) is None or not verdicts:
                continue
            errors = [
                abs(row['error']) for row in rows
                if row['observable'] == wanted[0].observable and row['error'] is not None
            ]
            bounds = [
                abs(row['error']) + row['believed'] for row in rows
                if row['observable'] in [item.observable for item in wanted]
                and row['error'] is not None and row['believed'] is not None
            ]
            candidates.append({
                'rung': rung,
                'seconds_step': self.seconds(rung),
                'platform': rows[0]['platform'],
                'error': max(errors, default=None),
                'bound': max(bounds, default=None),
                'isWhole': all(row['status'] == STABLE for row in rows),
                'verdict': worst(verdicts)
            })
        candidates.sort(key=lambda candidate: candidate['seconds_step'])
        return self._conclude(candidates, wanted)

    def _conclude(self, candidates, wanted):
        aim = 'For an error of at most ' + ' and '.join(item.text for item in wanted)
        if self.parameter:
            values = [f'{value:g}' for value in self.references]
            aim += f', {self.parameter}s {values[0]} to {values[-1]}'
        verdict, best, undecided = decide(candidates)
        reason = REFERENCE
        if verdict == RECOMMENDED:
            text = (f'{aim}: {best["rung"]}, {duration(best["seconds_step"])} a step on '
                    f'{best["platform"]}, error at '
                    f'most {percent(best["bound"])}. It is the cheapest that meets this.')
            faster = [c['rung'] for c in undecided if c['seconds_step'] < best['seconds_step']]
            if faster:
                text += (' Faster, but closer to the limit than the reference is known: '
                         f'{", ".join(faster)}.')
            else:
                reason = DECIDED
        elif verdict == UNDECIDED:
            text = f'{aim}: cannot tell. '
            if undecided:
                text += (
                    f'{", ".join(c["rung"] for c in undecided)} may meet it, but the reference '
                    'itself is not known to that: add a finer multiblob.')
            else:
                text += 'This observable has no meaning here.'
                reason = NO_REFERENCE
        elif not candidates:
            text, reason = f'{aim}: {NONE}. No model could be used.', UNUSABLE
        else:
            reason = DECIDED
            least = min((c for c in candidates if c['error'] is not None and c['isWhole']),
                        key=lambda c: c['error'], default=None)
            text = (f'{aim}: {NONE}. Every model that was measured misses it' +
                    (f'; the most accurate is {least["rung"]} with {percent(least["error"])}.'
                     if least else '.'))
        return Recommendation(verdict, best, text, candidates, None, wanted, reason)

    def goodDownTo(self, wanted: str) -> dict:
        """For several scenes: the parameter from which upward each rung meets a wanted error.

        Parameters
        ----------
        wanted : str

        Returns
        -------
        dict
            rung -> the smallest parameter from which on all scenes meet it, or None if not even the
            last scene does
        """
        return self._good_to(wanted, sorted(self.references, reverse=True))

    def goodUpTo(self, wanted: str) -> dict:
        """For several scenes: the parameter up to which each rung meets a wanted error.

        Parameters
        ----------
        wanted : str

        Returns
        -------
        dict
            rung -> the largest parameter up to which all scenes meet it, or None if not even the
            first scene does
        """
        return self._good_to(wanted, sorted(self.references))

    @property
    def isHarderUpwards(self) -> bool:
        """Whether approximations get worse for larger parameters."""
        return self.scene.get('harder') == 'larger'

    def exactNumbers(self, observable: str) -> dict:
        """Exact numbers of the scenes: parameter -> number.

        The dict is empty if one of the scenes has no exact number.

        Parameters
        ----------
        observable : str
        """
        found = {
            value: entry['observables'][observable]
            for value, entry in self.references.items()
        }
        return {value: found[value]['value']
                for value in sorted(found)} if all(entry['rung'] == EXACT
                                                   for entry in found.values()) else {}

    def _good_to(self, wanted, values):
        """How far along these values each rung meets a wanted error."""
        result = {}
        items = self.parseWanted(wanted)
        for rung in self.rungs:
            result[rung] = None
            for value in values:
                rows = {
                    row['observable']: row
                    for row in self.rows if row['rung'] == rung and row['parameter'] == value
                }
                if any(
                        self.judge(rows[item.observable], item.tolerance) != 'yes'
                        for item in items):
                    break
                result[rung] = value
        return result

    def referenceText(self) -> str:
        """The reference of the errors, and its quality, as text."""
        if all(entry['exact'] for entry in self.references.values()):
            return f'Compared with {BEST}, which is exact for a pair of spheres, to 1e-9.'
        if all(self.exactNumbers(name) for name in self.observables):
            return 'Compared with exact numbers, which have six digits and more.'
        parts = []
        entry = next(iter(self.references.values()))
        for name, chosen in entry['observables'].items():
            if not self.select(name):
                continue
            if chosen['rung'] == EXACT:
                parts.append(f'{self.observables[name]["label"]}: exact numbers')
                continue
            others = " and ".join(chosen['seconds'])
            how = (
                'nothing that was computed tells how wrong that is itself'
                if chosen['believed'] is None else
                f'believed to be off by {percent(chosen["believed"])}, by how {others} approach it'
                if chosen['rung'] != BEST else
                f'believed to be off by no more than {percent(chosen["believed"])}, its distance '
                f'to {others}')
            parts.append(f'{self.observables[name]["label"]}: {chosen["rung"]}, {how}')
        where = f' ({self.parameter} {next(iter(self.references)):g})' if self.parameter else ''
        return ('Compared with the best rung that could be used here, by observable'
                f'{where}. {"; ".join(parts)}.')

    # ---- Files -----------------------------------------------------------------------------------

    def asDict(self) -> dict:
        """Everything, as a dict for JSON."""
        return {
            'format': self.FORMAT,
            'scene': self.scene,
            'parameter': self.parameter,
            'observables': self.observables,
            'rungs': self.rungs,
            'provenance': self.provenance,
            'references': [{
                'parameter': value,
                **entry
            } for value, entry in self.references.items()],
            'rows': self.rows
        }

    @classmethod
    def fromDict(cls, data: dict) -> LadderResult:
        """The result from what asDict() returned.

        Parameters
        ----------
        data : dict
        """
        references = {entry.pop('parameter'): entry for entry in data['references']}
        return cls(data['scene'], data['parameter'], data['rows'], references, data['observables'],
                   data['rungs'], data['provenance'])
