"""Shared code of functions that step a Context and average its samples."""
from __future__ import annotations

import numpy as np

from .. import _units
from ._moves import positive, progress_bar
from .series import BLOCK_LENGTH_IN_TAU, FEWEST_TRUSTED_BLOCKS, seriesStatistics

#: The largest number of blocks. Noise that is new at each step hides the slower fluctuations of
#: configurations from the autocorrelation of the samples, but not from the spread of long blocks.
#: The error is known to 1/sqrt(2 (20 - 1)) = 16 %.
MOST_BLOCKS = 20


def at_least(least, value, where, name):
    """A number of steps."""
    value = _units.integer(value, where, name)
    if value < least:
        raise ValueError(
            f'{where}: {name}: got {value}; the number of steps must be at least {least}')
    return value


def lengths(steps, equilibration, interval, random, where):
    """Checked numbers of steps, of which there are enough for an error, or 0 without noise."""
    steps = at_least(0, steps, where, 'steps')
    equilibration = at_least(0, equilibration, where, 'equilibration')
    interval = positive(interval, where, 'interval')
    if random and steps // interval < FEWEST_TRUSTED_BLOCKS:
        raise ValueError(
            f'{where}: steps, interval: got {steps} and {interval}, so {steps//interval} samples; '
            f'a standard error needs at least '
            f'{FEWEST_TRUSTED_BLOCKS} where there is noise: give more steps')
    if 0 < steps < 2*interval:
        raise ValueError(
            f'{where}: steps, interval: got {steps} and {interval}, so {steps//interval} samples; '
            'a mean over time needs at least 2: give more steps, or 0 for the present poses')
    return steps, equilibration, interval


def advance(step, steps, label, progress):
    """Make steps without measurement."""
    with progress_bar(range(steps), label, progress, ' steps') as bar:
        for _ in bar:
            step(1)


def sampled(step, read, shape, steps, interval, label, progress):
    """The arrays of this shape that read() gives after each interval, one after the other."""
    found = np.empty((steps // interval, *shape))
    with progress_bar(range(len(found)), label, progress, ' samples') as bar:
        for k in bar:
            step(interval)
            found[k] = read()
    step(steps - interval*len(found))
    return found


def too_few_blocks(degrees, samples):
    """The sentence about blocks that are too few for an error, or None."""
    if degrees + 1 >= FEWEST_TRUSTED_BLOCKS or samples == 1:
        return None
    return (f'the errors come from {degrees + 1} blocks of samples, and at least '
            f'{FEWEST_TRUSTED_BLOCKS} are needed: run longer')


def lines_of_doubts(doubts):
    """What the text of a result says about trust."""
    return ['trusted'] if not doubts else [f'not trusted: {each}' for each in doubts]


def check_finite(rows, where, name):
    """Refuse samples of a run that blew up."""
    if not np.all(np.isfinite(rows)):
        raise ValueError(
            f'{where}: {name}: number {np.argwhere(~np.isfinite(rows))[0][0]} is not finite; '
            'all must be: leave out what follows a run that blew up')


def block_average(series):
    """Mean, standard error, its degrees of freedom, and the autocorrelation time of samples.

    A single sample counts as free of noise.
    """
    if len(series) == 1:
        return float(series[0]), 0.0, 0, 0.5
    found = seriesStatistics(series, len(series)/(BLOCK_LENGTH_IN_TAU*MOST_BLOCKS))
    variance = series.var(ddof=1)
    tau = float(len(series)*found.standardError**2/(2*variance)) if variance > 0 else 0.5
    return float(found.mean), float(found.standardError), found.degrees, tau
