"""Time of a recording: the uniform grid behind it, or its stamps; what makes either unusable.

A few lost samples make neither unusable: the stamps say where they are missing, and the others keep
their places on the grid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.data.table import MOST_PROBLEMS, RawTable, refuse, refuse_rows
from expdesign.configuration import DataSection, InputError, Problem

_LARGE = 1.5
"""Interval, in steps, from which on samples may be missing."""

_AT_ONCE = 50_000
"""Intervals that are looked at together."""

_NEIGHBOURS = 10
"""Samples on either side of an interval that tell whether the stamps stay late."""

_LATE = 0.75
"""By how much of a step they are late when a sample is missing: the neighbours jitter too."""

_MOST_LOST = 0.1
"""Largest share of the samples that may be missing: more is a fault of the recorder to look for."""

_WIDEST_TOLERANCE = 0.5
"""Of a step: from there on a sample could belong to the neighbouring point of the grid."""


@dataclass(frozen=True, eq=False)
class TimeBase:
    """Time of the samples, (T,), s, strictly increasing; its step, of stamps the mean one.

    `jitter` is the largest deviation of the stamps from the fitted grid, in steps, `worst` its row;
    `lost` is how many samples are missing between the rows.
    """

    time: Array
    step: float
    jitter: float
    worst: int
    lost: int = 0


def time_base(table: RawTable, section: DataSection) -> TimeBase:
    """Return the time of a recording: the grid behind it, or its stamps when these are asked for.

    Raises
    ------
    InputError
        Time does not increase, many samples are missing, or it is not uniform.
    """
    refuse_time(table)
    time = table.values["t"]
    found = gaps(time)
    refuse_many_gaps(table, found)
    if section.time == "stamped":
        return stamped_time_base(time, found)
    grid = fitted_grid(time, found)
    refuse_uneven(table, grid, section.time_tolerance)
    return grid


def lost_samples(table: RawTable, base: TimeBase) -> tuple[str, ...]:
    """Say how many samples are missing, and where the first of them are."""
    if not base.lost:
        return ()
    first = gaps(table.values["t"])[0][0]
    missing = f"{base.lost} samples are" if base.lost > 1 else "a sample is"
    return (f"{missing} missing (after {table.row_name(first - 1)}): the others keep their places",)


def refuse_time(table: RawTable) -> None:
    """Refuse time that does not increase."""
    time = table.values["t"]

    def problem(row: int) -> Problem:
        what = "the same time as" if time[row] == time[row - 1] else "time goes back from"
        message = f"{what} {table.row_name(row - 1)}: {_times(time, row)}"
        return table.problem(message, "t", row)

    rows = np.flatnonzero(np.diff(time) <= 0) + 1
    refuse_rows(rows, problem, table.file, "rows are not later than the one before")


def _times(time: Array, row: int) -> str:
    return f"{time[row - 1]:.9g} s, then {time[row]:.9g} s"


def refuse_many_gaps(table: RawTable, found: Sequence[tuple[int, int]]) -> None:
    """Refuse too many missing samples, (row after the gap, how many) each."""
    time = table.values["t"]
    lost = sum(missing for _, missing in found)
    if lost <= _MOST_LOST * (len(time) + lost):
        return
    problems = []
    share = f"{100 * lost / (len(time) + lost):.2g} %"
    allowed = (
        f"up to {100 * _MOST_LOST:g} % of missing samples, here {share}: take a part without them "
        "(data.start, data.end), or record again"
    )
    for row, missing in found[:MOST_PROBLEMS]:
        count = f"{missing} sample{'' if missing == 1 else 's'}"
        message = f"a gap of {count} after {table.row_name(row - 1)}: {_times(time, row)}"
        problems.append(table.problem(message, "t", row, allowed))
    refuse(problems, table.file, "gaps", len(found))


def refuse_uneven(table: RawTable, grid: TimeBase, tolerance: float) -> None:
    """Refuse time that deviates from its uniform grid by more than a share of a step."""
    if grid.jitter <= tolerance:
        return
    off = f"{100 * grid.jitter:.3g} % of a step ({grid.step:.6g} s)"
    message = f"time is not uniform: {off} off the fitted grid"
    allowed = f"up to {100 * tolerance:g} %; data.time: stamped"
    if grid.jitter < _WIDEST_TOLERANCE:
        allowed += f", or a time_tolerance above {grid.jitter:.3g}"
    raise InputError(table.problem(message, "t", grid.worst, allowed))


def fitted_grid(stamps: Array, missing: Sequence[tuple[int, int]] = ()) -> TimeBase:
    """Return the uniform grid t₀ + i h that fits increasing stamps best, by least squares; s.

    Where samples are `missing`, as `gaps` finds them, as many places of the grid are empty.
    """
    index = np.arange(len(stamps), dtype=float)
    for row, lost in missing:
        index[row:] += lost
    index -= np.mean(index)
    relative = stamps - stamps[0]  # stamps since 1970 would lose digits in the sums
    centre = float(np.mean(relative))
    step = float(index @ (relative - centre) / (index @ index))
    grid = centre + index * step
    deviation = np.abs(relative - grid) / step
    worst = int(np.argmax(deviation))
    lost = sum(count for _, count in missing)
    return TimeBase(stamps[0] + grid, step, float(deviation[worst]), worst, lost)


def stamped_time_base(stamps: Array, missing: Sequence[tuple[int, int]] = ()) -> TimeBase:
    """Return the stamps (T,) as they are, with their mean step and the jitter about a grid."""
    grid = fitted_grid(stamps, missing)
    mean = float((stamps[-1] - stamps[0]) / (len(stamps) - 1 + grid.lost))
    return replace(grid, time=stamps, step=mean)


def gaps(stamps: Array) -> list[tuple[int, int]]:
    """Return where samples are missing: the row after the gap, and how many.

    An interval between increasing stamps, (T,), that is too long is a gap when the stamps after it
    stay late. A single late stamp is no gap: the following ones are back on the grid.
    """
    intervals = np.diff(stamps)
    # Over several samples, so that jitter averages out, but few, so that most have no gap.
    lag = min(max(len(stamps) // 8, 1), _NEIGHBOURS)
    step = float(np.median(stamps[lag:] - stamps[:-lag])) / lag
    late = stamps - stamps[0] - step * np.arange(len(stamps))
    rows = np.flatnonzero(intervals > _LARGE * step) + 1
    found = []
    for some in np.split(rows, range(_AT_ONCE, len(rows), _AT_ONCE)):
        before = _median_of(late, some, range(-_NEIGHBOURS, 0))
        after = _median_of(late, some, range(_NEIGHBOURS))
        found += [
            (row, max(1, round(intervals[row - 1] / step) - 1))
            for row in some[after - before > _LATE * step].tolist()
        ]
    return found


def _median_of(values: Array, rows: NDArray[np.intp], places: range) -> Array:
    """Return the median of the existing values at places around each row."""
    index = rows[:, None] + np.array(places)
    there = (index >= 0) & (index < len(values))
    return np.nanmedian(np.where(there, values[index % len(values)], np.nan), axis=1)
