"""A recorded experiment in SI units, whatever file or simulation it came from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.data.table import (
    MOST_PROBLEMS,
    NUMERIC,
    RawTable,
    refuse,
    refuse_cells,
    refuse_periods,
    refuse_rows,
)
from expdesign.configuration import (
    FORCE_CHANNELS,
    LENGTH_CHANNELS,
    DataSection,
    InputError,
    Problem,
)
from expdesign.mechanism.hexapod import ACTUATORS

_FEWEST = 3
"""Rows from which a step can be told from its jitter."""


@dataclass(frozen=True, eq=False)
class Measurement:
    """Strut lengths and actuator forces over time.

    Time, lengths and forces are enough: where no step is given, what reading a file does is done
    with the stamps. Uniform ones become the grid that fits them best, gaps are counted as lost
    samples.

    Raises
    ------
    ValueError
        Shapes do not fit together.
    InputError
        Without a step: time does not increase or is not uniform, or there are values that are not
        finite.
    """

    time: Array
    """(T,), time stamps, s, strictly increasing. Uniform recordings hold the fitted grid, stamped
    ones the stamps as they were."""
    lengths: Array
    """(T, 6), q1…q6, m."""
    forces: Array
    """(T, 6), Q1…Q6, N, positive when they extend."""
    step: float = np.nan
    """Time between two samples, s (the mean one when stamped); by default that of the stamps."""
    stamped: bool = False
    """True when the stamps jitter and are to be used as they are."""
    period: NDArray[np.int64] | None = None
    """(T,), number of the period that each row belongs to, when the file has that column."""
    length_delay: float = 0.0
    force_delay: float = 0.0
    """By how much the channels lag behind the time stamps, s: a length recorded at t is the
    one at t − length_delay."""
    jitter: float = 0.0
    """Largest deviation of the stamps from the uniform grid, as a share of a step."""
    lost: int = 0
    """Samples that are missing between the rows: gaps in a uniform grid, or in stamps."""
    source: str = ""
    warnings: tuple[str, ...] = ()
    """What a user should know about how it was read."""

    def __post_init__(self) -> None:
        """Refuse shapes that do not fit together; take the step from the stamps where none is."""
        for name in ("time", "lengths", "forces"):
            values = np.asarray(getattr(self, name))
            if values.dtype.kind not in NUMERIC:
                raise ValueError(f"{name}: expected numbers, got {values.dtype}")
            self._set({name: values.astype(np.float64, copy=False)})
        if self.period is not None:
            self._set({"period": np.asarray(self.period)})
        if self.time.ndim != 1:
            raise ValueError(f"time: expected (T,), got {np.shape(self.time)}")
        count = len(self.time)
        shapes = {"lengths": (count, ACTUATORS), "forces": (count, ACTUATORS), "period": (count,)}
        for name, shape in shapes.items():
            found = getattr(self, name)
            if found is not None and np.shape(found) != shape:
                raise ValueError(f"{name}: expected {shape}, got {np.shape(found)}")
        if np.isnan(self.step):
            self._take_time()

    def _take_time(self) -> None:
        """Take step, grid and gaps from the stamps, as of a file."""
        table = RawTable(Path(self.source or type(self).__name__), self.channels, {})
        if len(table) < _FEWEST:
            raise InputError(
                table.problem(f"{len(table)} rows", "t", allowed=f"{_FEWEST} rows or more")
            )
        refuse_cells(table, tuple(table.values), ".")
        refuse_periods(table)
        base = time_base(table, DataSection(time="stamped" if self.stamped else "uniform"))
        found = {name: getattr(base, name) for name in ("time", "step", "jitter", "lost")}
        self._set({**found, "warnings": (*self.warnings, *lost_samples(table, base))})
        if self.period is not None:
            self._set({"period": self.period.astype(np.int64)})

    def _set(self, values: Mapping[str, Any]) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def channels(self) -> dict[str, NDArray[Any]]:
        """(T,) of every channel, by the name of its column; the period where it is known."""
        values: dict[str, NDArray[Any]] = {"t": self.time}
        for names, rows in ((LENGTH_CHANNELS, self.lengths), (FORCE_CHANNELS, self.forces)):
            values |= dict(zip(names, rows.T, strict=True))
        return values if self.period is None else values | {"period": self.period}

    @property
    def gapless(self) -> bool:
        """True when the rows follow each other on a uniform grid."""
        return not self.stamped and not self.lost

    @property
    def places(self) -> NDArray[np.intp]:
        """(T,), steps from the first row to each, rounded."""
        if self.gapless:
            return np.arange(len(self))
        return np.rint((self.time - self.time[0]) / self.step).astype(np.intp)

    def __len__(self) -> int:
        """Return the number of rows T."""
        return len(self.time)


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
