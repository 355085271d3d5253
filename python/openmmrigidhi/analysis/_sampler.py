"""The common part of Monte Carlo samplers.

They make sweeps, with moves of adaptive or fixed sizes, and keep samples.
"""
from __future__ import annotations

from typing import Optional

import numpy as np

from .. import _units
from . import _moves
from .samples import PoseSamples


class Sampler:
    """The base of samplers.

    A sampler has _steps (kind of move -> StepSizes), _sweep(adapt) and _present(), and _hand_back()
    if anything must be left tidy.
    """

    #: Whether the columns of the samples are independent walkers.
    _INDEPENDENT = False

    def burnIn(self, sweeps: int, progress: Optional[bool] = None) -> None:
        """Move towards equilibrium, and adapt the sizes of the moves to an acceptance of 0.4.

        Parameters
        ----------
        sweeps : int
            number of sweeps. A sweep is one trial of each kind for every walker, or for every body
            and free particle (with moves="all" one trial for all of them). Take many
            autocorrelation times, and some hundreds of sweeps for the sizes.
        progress : bool, optional
            show a progress bar; None: on a terminal only
        """
        self._run(_moves.positive(sweeps, 'burnIn', 'sweeps'), 'burn-in', progress, True)

    def sample(self, numSamples: int, interval: int = 1,
               progress: Optional[bool] = None) -> PoseSamples:
        """Sample poses, with moves of fixed sizes, beginning where the last call ended.

        Parameters
        ----------
        numSamples : int
            number of samples of each walker; all stay in memory, some 60 bytes for each body or
            walker
        interval : int
            sweeps between samples
        progress : bool, optional
            as in :meth:`burnIn`

        Returns
        -------
        PoseSamples
            acceptance and stepSizes of "free" refer to free particles
        """
        count, interval = _moves.positive(numSamples, 'sample', 'numSamples'), _moves.positive(
            interval, 'sample', 'interval')
        for steps in self._steps.values():
            steps.forget()
        kept = [np.empty((count,) + np.shape(part)) for part in self._present()]

        def keep(sweep):
            if (sweep + 1) % interval == 0:
                for array, part in zip(kept, self._present()):
                    array[sweep // interval] = part

        self._run(count*interval, 'sampling', progress, False, keep)
        R, q, energies, free = kept
        return PoseSamples(_units.LENGTH.attach(R), q, _units.ENERGY.attach(energies),
                           _units.LENGTH.attach(free),
                           {kind: steps.acceptance
                            for kind, steps in self._steps.items()},
                           {kind: steps.sizes.copy()
                            for kind, steps in self._steps.items()}, self._INDEPENDENT)

    def _run(self, sweeps, label, progress, adapt, keep=None):
        try:
            for sweep in _moves.progress_bar(range(sweeps), label, progress):
                self._sweep(adapt)
                if keep is not None:
                    keep(sweep)
        finally:
            self._hand_back()

    def _hand_back(self):
        """Do nothing, unless somebody else has the bodies too."""
