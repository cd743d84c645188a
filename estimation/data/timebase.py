"""Time of a recording: the uniform grid behind it, or its stamps as they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array

_LARGE = 1.5
"""Interval, in steps, from which on samples may be missing."""

_NEIGHBOURS = 10
"""Samples on either side of an interval that tell whether the stamps stay late."""

_LATE = 0.75
"""By how much of a step they are late when a sample is missing: the neighbours jitter too."""


@dataclass(frozen=True, eq=False)
class TimeBase:
    """Time of the samples.

    Attributes
    ----------
    time : (T,)
        s, strictly increasing.
    step : float
        Of the grid; the mean one of stamps, s.
    jitter : float
        Largest deviation of the stamps from the fitted grid, in steps.
    worst : int
        Row of that.
    """

    time: Array
    step: float
    jitter: float
    worst: int


def fitted_grid(stamps: Array) -> TimeBase:
    """Return the uniform grid t₀ + i h that fits best in the least-squares sense.

    Parameters
    ----------
    stamps : (T,)
        Increasing, s; at least two.
    """
    count = len(stamps)
    index = np.arange(count) - (count - 1) / 2
    relative = stamps - stamps[0]  # stamps since 1970 would lose digits in the sums
    centre = float(np.mean(relative))
    step = float(index @ (relative - centre) / (index @ index))
    grid = centre + index * step
    deviation = np.abs(relative - grid) / step
    worst = int(np.argmax(deviation))
    return TimeBase(stamps[0] + grid, step, float(deviation[worst]), worst)


def stamped(stamps: Array) -> TimeBase:
    """Return the stamps (T,) as they are, with their mean step and the jitter about a grid."""
    fit = fitted_grid(stamps)
    mean = float((stamps[-1] - stamps[0]) / (len(stamps) - 1))
    return TimeBase(stamps, mean, fit.jitter, fit.worst)


def not_increasing(stamps: Array) -> NDArray[np.int64]:
    """Return the rows whose stamp is not later than the one before."""
    return np.flatnonzero(np.diff(stamps) <= 0) + 1


def gaps(stamps: Array) -> list[tuple[int, int]]:
    """Return where samples are missing: the row after the gap, and how many.

    An interval that is too long is a gap when the stamps after it stay late. After a stamp that
    is late by itself the following ones are back on the grid.

    Parameters
    ----------
    stamps : (T,)
        Increasing, s.
    """
    intervals = np.diff(stamps)
    # Over several samples, so that jitter averages out, but few, so that most have no gap.
    lag = min(max(len(stamps) // 8, 1), _NEIGHBOURS)
    step = float(np.median(stamps[lag:] - stamps[:-lag])) / lag
    late = stamps - stamps[0] - step * np.arange(len(stamps))
    found = []
    for row in np.flatnonzero(intervals > _LARGE * step) + 1:
        before = np.median(late[max(0, row - _NEIGHBOURS) : row])
        after = np.median(late[row : row + _NEIGHBOURS])
        if after - before > _LATE * step:
            found.append((int(row), max(1, round(intervals[row - 1] / step) - 1)))
    return found
