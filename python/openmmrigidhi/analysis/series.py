"""Means of series of correlated samples, their autocorrelation times, and their errors.

This module uses numpy and scipy, not OpenMM, so tests can check every rule on synthetic numbers.
"""
from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Optional, Sequence

import numpy as np
import scipy.special

if TYPE_CHECKING:
    import numpy.typing as npt

#: Sokal's window: the autocorrelation is summed up to this many autocorrelation times.
WINDOW = 5
#: The least length of a block in autocorrelation times. Neighbouring blocks are then so little
#: correlated that the variance of their mean is underestimated by about tau/block = 5 %, and the
#: standard error by 2.5 %.
BLOCK_LENGTH_IN_TAU = 20
#: With fewer blocks than this a mean is reported, but flagged, since its error is hardly known.
FEWEST_TRUSTED_BLOCKS = 10
#: An error from longer blocks counts as larger if it is above that of shorter blocks by this many
#: of its own standard errors.
GROWTH_IN_ERRORS = 2
#: The same of an error that is smaller than that of shorter blocks or of autocorrelations.
FALL_IN_ERRORS = 3
#: With fewer blocks an autocorrelation time of 1 block may be chance. That of 100 independent
#: blocks has the standard error sqrt(2 (2 W + 1)/100)/2 = 0.17 at W = 2.5.
FEWEST_BLOCKS_TO_SEE = 100
#: What may make the error of a mean another one than its autocorrelations say.
SLOW, OSCILLATING = 'slow', 'oscillating'
#: Above this R-hat chains should be run longer: Vehtari et al. 2021, section 4.
LARGEST_RHAT = 1.01


@dataclass
class SeriesStatistics:
    r"""The mean of a series of correlated samples.

    Attributes
    ----------
    mean : float
        the mean
    standardError : float
        its standard error (one sigma), from block averages
    degrees : float
        degrees of freedom of this standard error: number of blocks minus 1, or fewer where slow
        fluctuations were found
    tau : float
        integrated autocorrelation time :math:`\frac12 + \sum_k \rho(k)`, in samples; 0.5 for
        independent samples, and less only where longer blocks show that an oscillation makes the
        error smaller
    samples : int
        number of samples
    blockLength : int
        samples in a block
    isSlow : bool
        whether slow fluctuations of small amplitude, which Sokal's window misses, made the error
        larger; tau then corresponds to this error
    """

    mean: float
    standardError: float
    degrees: int
    tau: float
    samples: int
    blockLength: int
    isSlow: bool = False

    @property
    def effectiveSamples(self) -> float:
        """The number of independent samples that would give the same error."""
        return self.samples/(2*self.tau)

    @property
    def isTrusted(self) -> bool:
        """Whether the number of blocks suffices to trust the standard error."""
        return self.degrees + 1 >= FEWEST_TRUSTED_BLOCKS


def autocorrelationTime(series: npt.ArrayLike) -> float:
    r"""Integrated autocorrelation time of a series, by Sokal's automatic window.

    Parameters
    ----------
    series : array-like of shape (n,)
        equally spaced samples

    Returns
    -------
    float
        :math:`\tau = \frac12 + \sum_{k=1}^W \rho(k)`, in samples, with the smallest
        :math:`W \ge 5 \tau(W)`; at least 0.5, and 0.5 for a constant series. The variance of the
        mean is :math:`2 \tau \sigma^2/n`, where :math:`\sigma^2` is the variance of a sample. For
        oscillating and anticorrelated series this is too large, since the window closes before the
        oscillation has cancelled. It misses a slow part of small variance under a fast one, since
        the window closes on the fast part. seriesStatistics() and noise() find both by longer
        blocks.
    """
    series = np.asarray(series, dtype=float)
    n = len(series)
    if n < 4 or _is_constant(series):
        return 0.5
    deviation = series - series.mean()
    size = 1 << (2*n - 1).bit_length()
    spectrum = np.fft.rfft(deviation, size)
    correlation = np.fft.irfft(spectrum*spectrum.conj(), size)[:n]
    # Divided by n, not n - k: the noise at long lags is damped.
    rho = correlation/correlation[0]
    tau = 0.5 + np.concatenate([[0], np.cumsum(rho[1:])])
    inside = np.arange(n) >= WINDOW*tau
    window = np.argmax(inside) if inside.any() else n - 1
    return max(0.5, float(tau[window]))


def _is_constant(values):
    """Whether all numbers are the same up to rounding."""
    return np.abs(values - values.mean()).max() <= 1e-14*np.abs(values).max()


@dataclass
class _Blocks:
    """The mean over replicas and samples, and its error from averages over blocks."""

    mean: float
    standardError: float
    degrees: int
    length: int
    used: int


def _block_statistics(replicas, length):
    """The _Blocks of replicas (count, n), whose deviations are about the mean of each replica.

    Samples that do not fill a block are left out at the start.
    """
    count, n = replicas.shape
    blocks = n // length
    used = replicas[:, n - blocks*length:]
    means = used.reshape(count, blocks, length).mean(axis=2)
    error = np.sqrt(means.var(axis=1, ddof=1).mean())/np.sqrt(blocks*count)
    return _Blocks(float(used.mean()), float(error), count*(blocks - 1), length, blocks*length)


def _block_length(tau, n):
    length = int(np.ceil(BLOCK_LENGTH_IN_TAU*tau)) if tau > 0.5 else 1
    return max(1, min(length, n // 5))


def _mean_error(replicas, length, known=0.0):
    """What the error of a mean becomes where blocks of one length do not tell all of it.

    A slow part of small variance under a fast one hardly shows in autocorrelations, but it can make
    most of the variance of the mean. It shows in blocks as long as itself. An oscillation makes the
    mean better known than its autocorrelations up to Sokal's window say. This shows in blocks of
    several periods. So the length is doubled while blocks are left to trust, and changes of the
    error count if they are larger than chance.

    Parameters
    ----------
    replicas : ndarray of shape (count, n)
    length : int
        of the first blocks
    known : float
        an error that may be too large: smaller ones count beside it

    Returns
    -------
    tuple of (_Blocks, str)
        and the last change that counted: '', SLOW or OSCILLATING
    """
    blocks = [_block_statistics(replicas, length)]
    if _is_constant(replicas):
        return blocks[0], ''
    while replicas.shape[1] // (2*length) >= FEWEST_TRUSTED_BLOCKS:
        length *= 2
        blocks.append(_block_statistics(replicas, length))
    found, change, last = blocks[0], '', 0
    for k, each in enumerate(blocks):
        # The relative standard error of a standard error of d degrees of freedom is 1/sqrt(2 d).
        own = 1/np.sqrt(2*each.degrees)
        both = np.hypot(own, 1/np.sqrt(2*found.degrees) if change == SLOW else 0)
        largest = found.standardError if change else max(found.standardError, known)
        if each.standardError > found.standardError*(1 + GROWTH_IN_ERRORS*own):
            found, change = _resolved(replicas, each), SLOW
        elif each.standardError < largest*(1 - FALL_IN_ERRORS*both):
            found, change, last = each, OSCILLATING, k
    if change == OSCILLATING:
        # What blocks still miss of an oscillation falls as 1/length. It was less than chance for
        # blocks of twice the length, so it is far below chance for blocks that are longer.
        found = blocks[min(last + 3, len(blocks) - 1)]
    return found, change


def _resolved(replicas, least):
    """The _Blocks for the error of the mean where blocks may be shorter than what is slow.

    Autocorrelations of averages over blocks have no fast part under which the slow one would be
    lost. The longest blocks in which it still shows leave the least of the fast part. Their
    autocorrelation time says how much larger the variance of the mean is than independent blocks
    would make it.
    """
    count, n = replicas.shape
    length, longest = least.length, None
    while n // length >= FEWEST_TRUSTED_BLOCKS:
        blocks = n // length
        means = replicas[:, n - blocks*length:].reshape(count, blocks, length).mean(axis=2)
        tau = float(np.mean([autocorrelationTime(one) for one in means]))
        shows = longest is not None and longest[2] >= 1
        if longest is None or tau >= 1 and (shows or blocks >= FEWEST_BLOCKS_TO_SEE):
            longest = length, means, tau
        elif shows:
            break
        length *= 2
    length, means, tau = longest
    blocks = means.shape[1]
    each = noiseDegrees(tau, blocks)
    error = np.sqrt(2*tau*means.var(axis=1).mean()*(1 + 1/each)/(blocks*count))
    return _Blocks(float(means.mean()), max(float(error), least.standardError),
                   max(1.0, count*each), length, blocks*length)


def seriesStatistics(series: npt.ArrayLike, leastTau: float = 0.0) -> SeriesStatistics:
    """Mean of a correlated series, and its standard error from block averages.

    The block length is 20 autocorrelation times (:func:`autocorrelationTime`), but never so long
    that fewer than 5 blocks remain. It is doubled as long as 10 blocks remain. If the error of
    longer blocks is larger by more than twice its own standard error, the series has slow
    fluctuations of small amplitude under fast ones. The error then comes from the autocorrelations
    of averages over blocks, in which the fast part no longer hides the slow one. If the error of
    longer blocks is smaller by more than three times its own standard error, the series oscillates,
    and the smaller error counts. Samples that do not fill a block are left out at the start, where
    they are least equilibrated.

    Parameters
    ----------
    series : array-like of shape (n,)
        equally spaced samples, n >= 2
    leastTau : float
        lower limit of the autocorrelation time, in samples: the time of similar runs

    Returns
    -------
    SeriesStatistics
    """
    series = np.asarray(series, dtype=float)
    n = len(series)
    if n < 2:
        raise ValueError(f'seriesStatistics: got {n} samples; at least 2 are needed: run longer')
    tau = max(autocorrelationTime(series), leastTau)
    found, change = _mean_error(series[None], _block_length(tau, n))
    if change:
        # One tau belongs to the error, also where that of similar runs is longer.
        tau = found.used*found.standardError**2/(2*float(series.var()))
    return SeriesStatistics(found.mean, found.standardError, found.degrees, tau, n, found.length,
                            change == SLOW)


def replicaStatistics(series: npt.ArrayLike, leastTau: float = 0.0) -> SeriesStatistics:
    """Mean over independent replicas, and its standard error from their spread.

    Correlations in time do not matter. With fewer than 10 replicas their spread is hardly known.
    The error is then the error of their mean by :func:`seriesStatistics`.

    Parameters
    ----------
    series : array-like of shape (n, replicas)
        equally spaced samples of each, n >= 2
    leastTau : float
        as in seriesStatistics()

    Returns
    -------
    SeriesStatistics
        degrees: number of replicas minus 1; tau: mean over the replicas; samples: n
    """
    series = np.asarray(series, dtype=float)
    if series.shape[1] < FEWEST_TRUSTED_BLOCKS:
        return seriesStatistics(series.mean(axis=1), leastTau)
    n, replicas = series.shape
    means = series.mean(axis=0)
    tau = float(np.mean([autocorrelationTime(each) for each in series.T]))
    return SeriesStatistics(float(means.mean()), float(means.std(ddof=1)/np.sqrt(replicas)),
                            replicas - 1, tau, n, n)


@dataclass
class Noise:
    r"""How fast the mean of a series becomes known.

    After n samples the standard error of the mean is :math:`\sqrt{v/n}` with v = value.

    Attributes
    ----------
    value : float
        :math:`2 \tau` times the variance of the series (of the mean over replicas, if there are
        several): n times the squared standard error of its mean
    degrees : float
        value divided by its true value, times this number, is nearly :math:`\chi^2` distributed
        with this many degrees of freedom
    variance : float
        variance of one sample, about the mean of its replica
    tau : float
        integrated autocorrelation time of the series, in samples
    tauError : float
        standard error of tau
    isSlow : bool
        whether slow fluctuations of small amplitude made the noise larger, see seriesStatistics();
        value, degrees and tau then come from averages over blocks
    """

    value: float
    degrees: float
    variance: float
    tau: float
    tauError: float
    isSlow: bool = False


def noiseDegrees(tau: float, samples: int) -> float:
    r"""Degrees of freedom of the :class:`Noise` that a series determines.

    Parameters
    ----------
    tau : float
        integrated autocorrelation time, in samples
    samples : int

    Returns
    -------
    float
        :math:`n/(2 W + 1)` for n samples, with :math:`W = 5 \tau`; the relative standard error of
        noise and tau is the square root of 2 divided by this
    """
    return samples/(2*WINDOW*tau + 1)


def noise(series: npt.ArrayLike) -> Noise:
    r"""How fast the mean of a series becomes known, and how accurate this information is.

    By Madras and Sokal (J. Stat. Phys. 50, 109 (1988), appendices) a sum of autocorrelations up to
    the lag W has the relative variance :math:`2 (2 W + 1)/n`, here with :math:`W = 5 \tau`. The
    relative variance of :math:`\chi^2` with :math:`n/(2 W + 1)` degrees of freedom is the same
    (:func:`noiseDegrees`). Deviations from the mean of the samples make the sum too small by
    :math:`(2 W + 1)/n` of itself (Wolff, Comput. Phys. Commun. 156, 143 (2004)). The function
    corrects this bias. Where longer blocks show slow fluctuations of small amplitude, or
    oscillations, the noise comes from these blocks (:func:`seriesStatistics`).

    Parameters
    ----------
    series : array-like of shape (n,) or (n, replicas)
        equally spaced samples of independent replicas, n >= 2

    Returns
    -------
    Noise
    """
    series = np.asarray(series, dtype=float)
    n = len(series)
    if n < 2:
        raise ValueError(
            f'noise: the series has {n} samples, which have no spread; 2 are needed: run longer')
    replicas = series.reshape(n, -1).T
    variances, taus = replicas.var(axis=1), np.array([autocorrelationTime(one) for one in replicas])
    tau = float(taus.mean())
    each = noiseDegrees(tau, n)
    degrees = len(replicas)*each
    value = 2*float((taus*variances).mean())*(1 + 1/each)/len(replicas)
    found, change = _mean_error(replicas, _block_length(tau, n), float(np.sqrt(value/n)))
    other = found.used*found.standardError**2
    if change == SLOW and other < value:
        change = ''
    if change:
        value, degrees = other, found.degrees
        tau = value*len(replicas)/(2*float(variances.mean()))
    return Noise(value, degrees, float(variances.mean()), tau, tau*float(np.sqrt(2/degrees)),
                 change == SLOW)


def splitRHat(chains: npt.ArrayLike) -> float:
    """R-hat of several chains.

    It compares how much chains, and halves of chains, differ with how much chains that have
    forgotten their start would differ. It is the larger of two numbers. Rank-normalised split R-hat
    detects means that differ. The same number for distances from the median ("folded") detects
    widths that differ. R-hat is 1 for chains that sample the same distribution. Run chains longer
    if it is above 1.01.

    Reference: Vehtari, Gelman, Simpson, Carpenter, Buerkner 2021, Bayesian Analysis 16, 667,
    equations (1) to (4) and (14), section 4; split R-hat: Gelman, Carlin, Stern, Dunson, Vehtari,
    Rubin 2013, Bayesian Data Analysis, 3rd edition, section 11.4.

    Parameters
    ----------
    chains : array-like of shape (chains, n)
        n samples of each chain, n >= 4; a single chain is enough, since the function then compares
        its halves

    Returns
    -------
    float
        NaN if all samples are the same up to rounding; infinity if each chain is stuck at a value
        of its own
    """
    chains = np.asarray(chains, dtype=float)
    if chains.ndim != 2 or chains.shape[1] < 4:
        raise ValueError(
            f'splitRHat: got chains of shape {chains.shape}; there must be rows of at least 4 '
            f'samples: run longer')
    if _is_constant(chains):
        return float('nan')
    half = chains.shape[1] // 2
    # An odd chain loses its middle sample.
    halves = np.concatenate([chains[:, :half], chains[:, -half:]])
    # Distances of two values from their median are the same, and say nothing.
    return float(
        np.fmax(_r_hat(_normal_scores(halves)),
                _r_hat(_normal_scores(np.abs(halves - np.median(halves))))))


def _normal_scores(values):
    """Ranks among all values, as quantiles of a normal law, by Blom's offsets."""
    # Its import takes as long as the import of OpenMM, and workers do not need it.
    from scipy import stats
    ranks = stats.rankdata(values).reshape(values.shape)
    return scipy.special.ndtri((ranks - 3/8)/(values.size + 1/4))


def _r_hat(chains):
    n = chains.shape[1]
    if not np.ptp(chains, axis=1).any():
        return float('inf') if np.ptp(chains) > 0 else float('nan')
    between, within = n*chains.mean(axis=1).var(ddof=1), chains.var(axis=1, ddof=1).mean()
    return float(np.sqrt((n - 1)/n + between/(n*within)))


@dataclass
class ReplicaSummary:
    r"""The common mean of several independent runs.

    Attributes
    ----------
    mean : float
        mean of the runs' means, each counted once
    standardError : float
        error from the spread of the runs' means; for a single run from block averages
    degrees : int
        degrees of freedom of the standard error, for Student's t: number of runs minus 1, or of
        blocks minus 1
    tau : float
        integrated autocorrelation time, mean over runs, in samples
    effectiveSamples : float
        number of independent samples in all runs together: :math:`n/(2 \tau)` for n samples; where
        R-hat is above 1.01, at most the variance of all samples divided by the square of
        standardError, since runs that disagree know little about their mean however many samples
        each has
    rHat : float or None
        see :func:`splitRHat`, of as many samples as the shortest run has; None with fewer than 4
    samples : int
        number of samples of all runs
    """

    mean: float
    standardError: float
    degrees: int
    tau: float
    effectiveSamples: float
    rHat: Optional[float]
    samples: int


def independentRuns(chains: Sequence[npt.ArrayLike]) -> ReplicaSummary:
    """Mean over independent runs of the same system.

    The error comes from the spread of the runs. The result also has R-hat and the effective sample
    size.

    Parameters
    ----------
    chains : sequence of array-like of shape (n_i,)
        equally spaced samples of each run, n_i >= 2

    Returns
    -------
    ReplicaSummary
    """
    chains = [np.asarray(chain, dtype=float) for chain in chains]
    shortest = min((len(chain) for chain in chains), default=0)
    if shortest < 2:
        raise ValueError(
            f'independentRuns: got {len(chains)} runs, the shortest of {shortest} samples; at '
            f'least one run of 2 is needed: run longer')
    tau = float(np.mean([seriesStatistics(chain).tau for chain in chains]))
    samples = sum(len(chain) for chain in chains)
    rHat = splitRHat([chain[:shortest] for chain in chains]) if shortest >= 4 else None
    if len(chains) == 1:
        one = seriesStatistics(chains[0])
        mean, error, degrees = one.mean, one.standardError, one.degrees
    else:
        means = np.array([chain.mean() for chain in chains])
        mean, error, degrees = float(means.mean()), float(
            means.std(ddof=1)/np.sqrt(len(means))), len(means) - 1
    effective = samples/(2*tau)
    if rHat is not None and rHat > LARGEST_RHAT and error > 0:
        effective = min(effective, float(np.concatenate(chains).var())/error**2)
    return ReplicaSummary(mean, error, degrees, tau, effective, rHat, samples)
