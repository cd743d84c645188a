"""Time of a recording: the uniform grid behind it, or its stamps; what makes either unusable."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from constraints.arrays import Array
from estimation.data.table import RawTable, refuse
from expdesign.configuration import DataSection, InputError

_LARGE = 1.5
"""Interval, in steps, from which on samples may be missing."""

_NEIGHBOURS = 10
"""Samples on either side of an interval that tell whether the stamps stay late."""

_LATE = 0.75
"""By how much of a step they are late when a sample is missing: the neighbours jitter too."""

_WIDEST_TOLERANCE = 0.5
"""Of a step: from there on a sample could belong to the neighbouring point of the grid."""


@dataclass(frozen=True, eq=False)
class TimeBase:
    """Time of the samples, (T,), s, strictly increasing; its step, of stamps the mean one.

    `jitter` is the largest deviation of the stamps from the fitted grid, in steps, `worst` its row.
    """

    time: Array
    step: float
    jitter: float
    worst: int


def time_base(table: RawTable, section: DataSection) -> TimeBase:
    """Return the time of a recording: the grid behind it, or its stamps when these are asked for.

    Raises
    ------
    InputError
        Time does not increase, samples are missing, or it is not uniform.
    """
    refuse_time(table)
    time = table.values["t"]
    if section.time == "stamped":
        refuse_gaps(table)
        return stamped(time)
    grid = fitted_grid(time)
    refuse_uneven(table, grid, section.time_tolerance)
    return grid


def refuse_time(table: RawTable) -> None:
    """Refuse time that does not increase."""
    time = table.values["t"]
    problems = []
    for row in (np.flatnonzero(np.diff(time) <= 0) + 1).tolist():
        what = "the same time as" if time[row] == time[row - 1] else "time goes back from"
        message = f"{what} {table.row_name(row - 1)}: {_times(time, row)}"
        problems.append(table.problem(message, "t", row))
    refuse(problems, table.file, "rows are not later than the one before")


def _times(time: Array, row: int) -> str:
    return f"{time[row - 1]:.9g} s, then {time[row]:.9g} s"


def refuse_gaps(table: RawTable) -> None:
    """Refuse missing samples; the row named is the one after the gap."""
    time = table.values["t"]
    problems = []
    for row, missing in gaps(time):
        count = f"{missing} sample{'' if missing == 1 else 's'}"
        message = f"a gap of {count} after {table.row_name(row - 1)}: {_times(time, row)}"
        problems.append(table.problem(message, "t", row))
    refuse(problems, table.file, "gaps")


def refuse_uneven(table: RawTable, grid: TimeBase, tolerance: float) -> None:
    """Refuse time that deviates from its uniform grid by more than a share of a step.

    Missing samples are reported as such.
    """
    if grid.jitter <= tolerance:
        return
    refuse_gaps(table)
    off = f"{100 * grid.jitter:.3g} % of a step ({grid.step:.6g} s)"
    message = f"time is not uniform: {off} off the fitted grid"
    allowed = f"up to {100 * tolerance:g} %; data.time: stamped"
    if grid.jitter < _WIDEST_TOLERANCE:
        allowed += f", or a time_tolerance above {grid.jitter:.3g}"
    raise InputError(table.problem(message, "t", grid.worst, allowed))


def fitted_grid(stamps: Array) -> TimeBase:
    """Return the uniform grid t₀ + i h that fits increasing stamps best, by least squares; s."""
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
    mean = float((stamps[-1] - stamps[0]) / (len(stamps) - 1))
    return replace(fitted_grid(stamps), time=stamps, step=mean)


def gaps(stamps: Array) -> list[tuple[int, int]]:
    """Return where samples are missing: the row after the gap, and how many.

    An interval between increasing stamps, (T,), that is too long is a gap when the stamps after it
    stay late. After a stamp that is late by itself the following ones are back on the grid.
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
