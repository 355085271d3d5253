"""Samples of poses from a Boltzmann distribution, and averages with errors from correlations."""
from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
from openmm import unit

from .. import _units
from .._types import Array, Numbers
from .series import SeriesStatistics, seriesStatistics

if TYPE_CHECKING:
    import numpy.typing as npt


@dataclasses.dataclass
class PoseSamples:
    """Poses from a GibbsBoltzmannSampler or a WalkerSampler.

    A GibbsBoltzmannSampler has n interacting bodies. A WalkerSampler has n independent walkers of
    one body.

    Attributes
    ----------
    positions : Quantity of shape (samples, n, 3)
        origins of the bodies, unwrapped, nm
    orientations : array of shape (samples, n, 4)
        unit quaternions (w, x, y, z), body frame to lab frame
    energies : Quantity of shape (samples,), or (samples, n) for walkers
        potential energy, kJ/mol
    freePositions : Quantity of shape (samples, m, 3)
        positions of the sampled free particles, nm; m = 0 for walkers
    acceptance : dict
        accepted fraction of the trials of each kind: "translation", "rotation", "free"
    stepSizes : dict
        size of the moves of each kind, one number for each thing that moves: nm (standard deviation
        along each coordinate), or rad (largest angle)
    independent : bool
        whether the n columns are independent walkers
    """

    positions: unit.Quantity
    orientations: np.ndarray
    energies: unit.Quantity
    freePositions: unit.Quantity
    acceptance: dict
    stepSizes: dict
    independent: bool

    def __len__(self):
        return len(self.orientations)

    def average(self, values: Numbers) -> SeriesStatistics:
        """Get the mean of an observable over all samples and its standard error.

        For interacting bodies the error comes from block averages over many autocorrelation times.
        For walkers the error comes from the spread of the walkers' own means, which are independent
        whatever the autocorrelation is.

        Parameters
        ----------
        values : array-like or Quantity of shape (samples,) or (samples, n)
        the observable for each sample, or for each body of each sample; values of interacting
        bodies are first averaged over the bodies

        Returns
        -------
        openmmrigidhi.analysis.series.SeriesStatistics
            mean and standardError in the values' unit; tau, the integrated autocorrelation time in
            samples; degrees; effectiveSamples; isTrusted: whether the blocks suffice

        Raises
        ------
        ValueError
            for another number of samples or bodies, or fewer than 2 samples or walkers
        """
        return self._statistics(self._series(values, 'average'))

    def histogram(self, values: Numbers, edges: npt.ArrayLike) -> tuple[Array, Array]:
        """Get the probabilities of an observable's bins, with standard errors.

        Parameters
        ----------
        values : array-like or Quantity of shape (samples,) or (samples, n)
            the observable, as for :meth:`average`
        edges : array-like of shape (bins + 1,)
            ascending edges, in the values' unit; the last bin includes its upper edge

        Returns
        -------
        probabilities : array of shape (bins,)
            fractions of all values; values outside the edges are in no bin
        errors : array of shape (bins,)
            standard errors of the probabilities; errors of neighbouring bins are not independent

        Raises
        ------
        ValueError
            as for :meth:`average`
        """
        values = self._series(values, 'histogram')
        edges = _units.sequence(edges, _units.NONE, 'histogram', 'edges')
        if len(edges) < 2 or np.any(np.diff(edges) <= 0):
            raise ValueError(
                f'histogram: edges: got {edges}; bins need at least two edges in ascending order: '
                f'sort them')
        bins = np.searchsorted(edges, values, side='right') - 1
        bins[values == edges[-1]] = len(edges) - 2
        found = [self._statistics((bins == k).astype(float)) for k in range(len(edges) - 1)]
        return np.array([one.mean for one in found]), np.array([one.standardError for one in found])

    def _series(self, values, where):
        values = np.asarray(values._value if unit.is_quantity(values) else values, dtype=float)
        shapes = [(len(self),), self.orientations.shape[:2]]
        if values.shape not in shapes[1 if self.independent else 0:]:
            raise ValueError(
                f'{where}: values: got an array of shape {values.shape} for {shapes[1][0]} samples '
                f'of {shapes[1][1]} bodies; the shape must be (samples, bodies), or (samples,) '
                'where bodies interact: give one number for each')
        return values

    def _statistics(self, values):
        if not self.independent or values.shape[1] < 2:
            series = values.reshape(len(self), -1).mean(axis=1)
            # The error is that of whole blocks, whose length is the observable's own. The mean is
            # that of all samples. Means of several observables so fit together: probabilities of
            # bins add up to 1.
            return dataclasses.replace(seriesStatistics(series), mean=float(series.mean()))
        samples, walkers = values.shape
        means = values.mean(axis=0)
        error, variance = means.std(ddof=1)/np.sqrt(walkers), values.var()
        # error^2 = 2 tau var/(all samples), as for a series.
        tau = max(0.5, samples*walkers*error**2/(2*variance)) if variance > 0 else 0.5
        return SeriesStatistics(float(means.mean()), float(error), walkers - 1, float(tau),
                                samples*walkers, samples)
