"""The result of a GridStudy: errors, grids and times of products, and recommended tolerances."""
from __future__ import annotations

from typing import Optional, Sequence, Union

import numpy as np

from ._results import DECIDED, NONE, RECOMMENDED, UNUSABLE, Recommendation, Result, decide
from .gridreport import GridReport, milliseconds


class GridResult(Result):
    """Rows of settings of a grid, and data on their measurement.

    Attributes
    ----------
    rows : list of dict
        one row for each observable and setting. Keys: observable ('forces' or 'wrenches'), kind
        ('tolerance': the library chooses the grid; 'spacing': the study gives it), setting (the
        tolerance, or sigma/dx), status ('stable' or 'not applicable'), message, nodes (text),
        fineness (sigma/dx of the grid, sigma of the narrowest envelope), described (the tolerance
        from describeEffects()), error (its norm divided by the norm of the mobility, see
        GridStudy), own_error (the same relative to self-mobilities), typical (error of velocities
        from random forces), seconds_product (the fastest round; for tolerances only),
        seconds_median.
    observables : dict
        name -> dict with label, description, width (of the narrowest envelope, radii), norm (of the
        mobility divided by self-mobilities)
    scene : dict
        also edges (nm), least_radius (nm), seconds_dense (of a product by lattice sums)
    """

    FORMAT = 'openmmrigidhi.accuracy.grid 1'
    REPORT = GridReport
    COLUMNS = ('observable', 'kind', 'setting', 'status', 'nodes', 'fineness', 'described', 'error',
               'own_error', 'typical', 'seconds_product', 'seconds_median', 'message')

    def __init__(self, scene: dict, rows: list[dict], observables: dict, provenance: dict) -> None:
        self.scene = scene
        self.rows = rows
        self.observables = observables
        self.provenance = provenance

    def select(self, observable: str, kind: Optional[str] = None) -> list[dict]:
        """Rows of one observable that have an error, from coarse to fine.

        Parameters
        ----------
        observable : str
        kind : str, optional
            'tolerance' or 'spacing'

        Returns
        -------
        list of dict
        """
        rows = [
            row for row in self.rows if row['observable'] == observable and kind in (
                None, row['kind']) and row['error'] is not None
        ]
        return sorted(rows, key=lambda row: (row['fineness'], -row['described']))

    def recommend(self, wanted: Union[str, Sequence[str]]) -> Recommendation:
        """The tolerance with the cheapest products whose error is below the wanted error.

        Parameters
        ----------
        wanted : str or sequence of str
            see :meth:`parseWanted`

        Returns
        -------
        Recommendation
            its setting and candidates have tolerance, seconds_product (the sum over the wanted
            observables), error (the largest), nodes and verdict. The larger of error and typical is
            compared with the wanted error.
        """
        wanted = self.parseWanted(wanted)
        found = [{
            row['setting']: row
            for row in self.rows
            if row['observable'] == item.observable and row['kind'] == 'tolerance'
        } for item in wanted]
        candidates = []
        for tolerance in found[0]:
            rows = [each[tolerance] for each in found]
            if any(row['error'] is None for row in rows):
                continue
            candidates.append({
                'tolerance': tolerance,
                'seconds_product': sum(row['seconds_product'] for row in rows),
                'error': max(max(row['error'], row['typical']) for row in rows),
                'nodes': rows[0]['nodes'],
                'verdict': 'yes' if all(
                    max(row['error'], row['typical']) <= item.tolerance
                    for row, item in zip(rows, wanted)) else 'no'
            })
        candidates.sort(key=lambda candidate: candidate['seconds_product'])
        verdict, best, _ = decide(candidates)
        aim = 'For an error of at most ' + ' and '.join(item.text for item in wanted)
        if verdict == RECOMMENDED:
            text = (
                f'{aim}: a tolerance of {best["tolerance"]:g}, with errors up to '
                f'{best["error"]:.1e}; ' +
                (f'a product takes {milliseconds(best["seconds_product"])} ms on {best["nodes"]} '
                 f'nodes' if len(wanted) == 1 else
                 f'one product of each takes {milliseconds(best["seconds_product"])} ms') +
                '. It is the cheapest that meets this.')
        else:
            least = min(candidates, key=lambda c: c['error'], default=None)
            text = f'{aim}: {NONE}. ' + (
                f'The smallest error is {least["error"]:.1e}, with a tolerance of '
                f'{least["tolerance"]:g}.' if least else 'No grid could be used.')
        return Recommendation(verdict, best, text, candidates, None, wanted,
                              DECIDED if candidates else UNUSABLE)

    def finenessFor(self, observable: str, error: float) -> Optional[float]:
        """The fineness sigma/dx with this error, between the measured spacings.

        Parameters
        ----------
        observable : str
        error : float

        Returns
        -------
        float or None
            None if the finest grid did not reach the error, or if even the coarsest did
        """
        rows = self.select(observable, 'spacing')
        for coarse, fine in zip(rows[:-1], rows[1:]):
            if coarse['error'] > error >= fine['error']:
                # A grid leaves exp(-(pi sigma/dx)^2) of a Gaussian out.
                part = np.log(coarse['error']/error)/np.log(coarse['error']/fine['error'])
                return float(
                    np.sqrt(coarse['fineness']**2 + part*
                            (fine['fineness']**2 - coarse['fineness']**2)))
        return None

    def asDict(self) -> dict:
        """Everything, as a dict for JSON."""
        return {
            'format': self.FORMAT,
            'scene': self.scene,
            'observables': self.observables,
            'provenance': self.provenance,
            'rows': self.rows
        }

    @classmethod
    def fromDict(cls, data: dict) -> GridResult:
        """The result from what asDict() returned.

        Parameters
        ----------
        data : dict
        """
        return cls(data['scene'], data['rows'], data['observables'], data['provenance'])
