"""Measurement: a recording in SI units, from a file or a simulation, and its time base."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.data.sensors import SensorResponse
from estimation.data.stamps import count_from_first
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
    RunConfiguration,
)
from expdesign.configuration.run import add_back_emf
from expdesign.mechanism.hexapod import ACTUATORS

_FEWEST = 3
"""Smallest number of rows that shows the step and its jitter."""


@dataclass(frozen=True, eq=False)
class Measurement:
    """Strut lengths and actuator forces over time.

    Time, lengths and forces suffice: without a step the stamps are treated as those of a file.
    Uniform stamps become the grid that fits them best, and gaps count as lost samples. Times since
    1970 then count from the first row.

    Raises
    ------
    ValueError
        Shapes do not fit together.
    InputError
        Without a step: time does not increase or is not uniform, or values are not finite.

    Examples
    --------
    >>> Measurement(np.arange(4.0), np.ones((4, 6)), np.zeros((4, 6))).step
    1.0
    """

    time: Array
    """(T,), time stamps, s, strictly increasing: the fitted grid of a uniform recording, or the
    stamps as recorded."""
    lengths: Array
    """(T, 6), q1…q6, m."""
    forces: Array
    """(T, 6), Q1…Q6, N, positive when they extend."""
    step: float = np.nan
    """Time between two samples, s (the mean if stamped); by default from the stamps."""
    stamped: bool = False
    """True if the stamps are used as recorded, with their jitter."""
    period: NDArray[np.int64] | None = None
    """(T,), number of each row's period; None without that column."""
    length_delay: float = 0.0
    force_delay: float = 0.0
    """Lag of the channels behind the time stamps, s: a length recorded at t is that at
    t − length_delay."""
    has_units: frozenset[str] = frozenset()
    """Groups of channels, ``t``, ``q``, ``Q``, of which the file has units."""
    back_emf: tuple[float, ...] | None = None
    """(6,), N s/m: the forces are those of the motors' voltages at rest, which exceed the forces in
    motion by this damping; None: they are the forces themselves."""
    length_sensors: SensorResponse | None = None
    force_sensors: SensorResponse | None = None
    """Filters and delays of single channels; None: they have none."""
    jitter: float = 0.0
    """Largest deviation of the stamps from the uniform grid, as a share of a step."""
    lost: int = 0
    """Number of samples missing between the rows."""
    source: str = ""
    content: str = ""
    """SHA-256 of the numbers in its file; empty: not from a file."""
    warnings: tuple[str, ...] = ()
    """Remarks from reading it, for the user."""

    @property
    def file(self) -> Path | None:
        """The file that it was read from; None without one."""
        return Path(self.source) if self.source else None

    @property
    def fingerprint(self) -> str:
        """SHA-256 of the measured numbers, whatever their units, signs, order and file."""
        return self.content or sha256(self.lengths.tobytes() + self.forces.tobytes()).hexdigest()

    def __post_init__(self) -> None:
        """Refuse inconsistent shapes; determine a missing step from the stamps."""
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
            self._determine_time_base()

    def __repr__(self) -> str:
        """Return number of samples, step, and source."""
        source = f", from {self.source}" if self.source else ""
        step = f"{1e3 * self.step:.6g} ms apart"
        return f"Measurement({len(self.time)} samples {step}{source})"

    def _determine_time_base(self) -> None:
        """Determine step, grid and gaps from the stamps, as for a file."""
        relative, _ = count_from_first(self.time)
        values = self.channels | {"t": relative}
        table = RawTable(Path(self.source or type(self).__name__), values, {})
        if len(table) < _FEWEST:
            problem = table.problem(f"{len(table)} rows", "t", allowed=f"{_FEWEST} rows or more")
            raise InputError(problem)
        refuse_cells(table, tuple(table.values), ".")
        refuse_periods(table)
        base = time_base(table, DataSection(time="stamped" if self.stamped else "uniform"))
        found = {name: getattr(base, name) for name in ("time", "step", "jitter", "lost")}
        self._set({**found, "warnings": (*self.warnings, *base.warnings)})
        if self.period is not None:
            self._set({"period": self.period.astype(np.int64)})

    def _set(self, values: Mapping[str, Any]) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def channels(self) -> dict[str, NDArray[Any]]:
        """(T,) of every channel by the name of its column, with the period if it is known."""
        values: dict[str, NDArray[Any]] = {"t": self.time}
        for names, rows in ((LENGTH_CHANNELS, self.lengths), (FORCE_CHANNELS, self.forces)):
            values |= dict(zip(names, rows.T, strict=True))
        return values if self.period is None else values | {"period": self.period}

    @property
    def has_sensors(self) -> bool:
        """Whether filters or delays of single channels are stated."""
        return self.length_sensors is not None or self.force_sensors is not None

    @property
    def gapless(self) -> bool:
        """True if the rows follow each other on a uniform grid."""
        return not self.stamped and not self.lost

    @property
    def places(self) -> NDArray[np.intp]:
        """(T,), rounded number of steps from the first row to each row."""
        if self.gapless:
            return np.arange(len(self))
        return np.rint((self.time - self.time[0]) / self.step).astype(np.intp)

    def between(self, start: float, end: float) -> Measurement:
        """Return the rows from start to end, s, without that of the end."""
        limits = np.searchsorted(self.time, np.array([start, end]) - self.step / 2)
        rows = slice(*limits.tolist())
        period = None if self.period is None else self.period[rows]
        taken = {name: getattr(self, name)[rows] for name in ("time", "lengths", "forces")}
        lost = self.lost and round((taken["time"][-1] - taken["time"][0]) / self.step) + 1
        part = sha256(f"{self.content} {start} {end}".encode()).hexdigest()
        content = part if self.content else ""
        lost = max(lost - len(taken["time"]), 0)
        return replace(self, **taken, period=period, lost=lost, content=content)

    def __len__(self) -> int:
        """Return the number of rows T."""
        return len(self.time)


def add_motors(
    configuration: RunConfiguration, recordings: Sequence[Measurement]
) -> RunConfiguration:
    """Return the run with the damping of the motors if forces were recorded as voltages.

    Raises
    ------
    InputError
        Only some of the recordings are of voltages.
    """
    damping, *others = [each.back_emf for each in recordings]
    for other, recording in zip(others, recordings[1:], strict=True):
        if other != damping:
            message = "forces and voltages cannot be combined in one estimate"
            raise InputError(message, recording.file, allowed="recordings of one kind")
    return configuration if damping is None else add_back_emf(configuration, damping)


_LARGE = 1.5
"""Interval, in steps, from which on samples may be missing."""
_NEIGHBOURS = 10
"""Samples to either side of an interval that show whether the stamps stay late."""
_LATE = 0.75
"""Delay, in steps, that indicates a missing sample: the neighbours jitter too."""
_MOST_LOST = 0.1
"""Largest share of missing samples: more indicates a fault of the recorder."""
_WIDEST_TOLERANCE = 0.5
"""Jitter, in steps, from which on a sample could belong to the neighbouring point of the grid."""


@dataclass(frozen=True, eq=False)
class TimeBase:
    """Time of the samples of a recording."""

    time: Array
    """(T,), s, strictly increasing."""
    step: float
    """Step of the grid, or mean step of stamps, s."""
    jitter: float
    worst: int
    """Largest deviation of the stamps from the fitted grid, in steps, and its row."""
    lost: int = 0
    """Number of samples missing between the rows."""
    warnings: tuple[str, ...] = ()


def time_base(table: RawTable, section: DataSection) -> TimeBase:
    """Return the time base of a recording: the grid that fits its stamps, or the stamps themselves.

    A few lost samples do not matter: the stamps show their places, and the others keep theirs.

    Raises
    ------
    InputError
        Time does not increase, many samples are missing, or the time is not uniform.
    """
    time = table.values["t"]

    def name_rows(row: int) -> str:
        return f"{table.row_name(row - 1)}: {time[row - 1]:.9g} s, then {time[row]:.9g} s"

    def describe_step_back(row: int) -> Problem:
        what = "the same time as" if time[row] == time[row - 1] else "time goes back from"
        return table.problem(f"{what} {name_rows(row)}", "t", row)

    rows = np.flatnonzero(np.diff(time) <= 0) + 1
    refuse_rows(rows, describe_step_back, table.file, "rows are not later than the one before")
    gaps = find_gaps(time)
    grid = fit_grid(time, gaps)
    if (share := grid.lost / (len(time) + grid.lost)) > _MOST_LOST:
        allowed = (
            f"up to {100 * _MOST_LOST:g} % of missing samples, here {100 * share:.2g} %: take a "
            "part without them (data.start, data.end), or record again"
        )
        problems = []
        for row, missing in gaps[:MOST_PROBLEMS]:
            count = f"{missing} sample{'' if missing == 1 else 's'}"
            message = f"a gap of {count} after {name_rows(row)}"
            problems.append(table.problem(message, "t", row, allowed))
        refuse(problems, table.file, "gaps", len(gaps))
    if section.time == "stamped":
        mean = float((time[-1] - time[0]) / (len(time) - 1 + grid.lost))
        grid = replace(grid, time=time, step=mean)
    elif grid.jitter > section.time_tolerance:
        off = f"{100 * grid.jitter:.3g} % of a step ({grid.step:.6g} s)"
        allowed = f"up to {100 * section.time_tolerance:g} %; data.time: stamped"
        if grid.jitter < _WIDEST_TOLERANCE:
            allowed += f", or a time_tolerance above {grid.jitter:.3g}"
        message = f"time is not uniform: {off} off the fitted grid"
        raise InputError(table.problem(message, "t", grid.worst, allowed))
    if not grid.lost:
        return grid
    absent = f"{grid.lost} samples are" if grid.lost > 1 else "a sample is"
    where = f"(after {table.row_name(gaps[0][0] - 1)})"
    return replace(grid, warnings=(f"{absent} missing {where}: the others keep their places",))


def find_gaps(stamps: Array) -> list[tuple[int, int]]:
    """Find missing samples: the row after each gap, and the number of samples in the gap.

    A long interval between increasing stamps, (T,), is a gap if the stamps after it stay late. A
    single late stamp is no gap: the following ones are back on the grid.

    Examples
    --------
    >>> find_gaps(np.array([0.0, 0.1, 0.2, 0.3, 0.6, 0.7, 0.8, 0.9, 1.0]))
    [(4, 2)]
    """
    intervals = np.diff(stamps)
    # Over several samples, so that jitter averages out, but few, so that most have no gap.
    lag = min(max(len(stamps) // 8, 1), _NEIGHBOURS)
    step = float(np.median(stamps[lag:] - stamps[:-lag])) / lag
    late = stamps - stamps[0] - step * np.arange(len(stamps))
    rows = np.flatnonzero(intervals > _LARGE * step) + 1

    def median_of(places: range) -> Array:
        index = rows[:, None] + np.array(places)
        inside = (index >= 0) & (index < len(late))
        return np.nanmedian(np.where(inside, late[index % len(late)], np.nan), axis=1)

    stays_late = median_of(range(_NEIGHBOURS)) - median_of(range(-_NEIGHBOURS, 0)) > _LATE * step
    return [
        (row, max(1, round(intervals[row - 1] / step) - 1)) for row in rows[stays_late].tolist()
    ]


def fit_grid(stamps: Array, gaps: Sequence[tuple[int, int]] = ()) -> TimeBase:
    """Fit the uniform grid t₀ + i h to increasing stamps, (T,), s, by least squares.

    Every gap of `find_gaps` leaves as many points of the grid empty.

    Examples
    --------
    >>> fit_grid(np.array([0.0, 0.1, 0.2, 0.5]), [(3, 2)]).time.round(9).tolist()
    [0.0, 0.1, 0.2, 0.5]
    """
    index = np.arange(len(stamps), dtype=float)
    for row, lost in gaps:
        index[row:] += lost
    index -= np.mean(index)
    relative = stamps - stamps[0]  # stamps since 1970 would lose digits in the sums
    centre = float(np.mean(relative))
    step = float(index @ (relative - centre) / (index @ index))
    grid = centre + index * step
    deviation = np.abs(relative - grid) / step
    worst = int(np.argmax(deviation))
    lost = sum(count for _, count in gaps)
    return TimeBase(stamps[0] + grid, step, float(deviation[worst]), worst, lost)
