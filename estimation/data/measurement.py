"""A recorded experiment in SI units, whatever file or simulation it came from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.data.channels import refuse_cells, refuse_periods
from estimation.data.table import NUMERIC, RawTable
from estimation.data.timebase import lost_samples, time_base
from expdesign.configuration import FORCE_CHANNELS, LENGTH_CHANNELS, DataSection, InputError
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
