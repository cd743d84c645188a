"""Tables that repeat a period: their motion with two periods, and the recognition of repeated rows.

Checks and certificates treat the lead-in, two periods and the lead-out: all pairs and triples of
neighbouring rows of the whole table are among their rows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import lru_cache, partial
from itertools import repeat
from pathlib import Path
from typing import NamedTuple

import numpy as np

from constraints.arrays import Array
from expdesign.configuration.schema import MOST_ROWS
from expdesign.export.definition import Rows, Settings, TableError, Task

PERIODS = 2
LEAD_IN, LEAD_OUT = ".lead-in", ".lead-out"
_ROWS = 20_000
"""Rows that are collected at once."""
_SAME_STEP = 0.5e-9
"""s; largest difference of two steps of time that count as equal."""
_SAME_PERIOD = 1e-10
"""s; largest difference between the rows of a period and the period: it adds up."""
_LOST_DIGITS = 1e-9
"""s; largest rounding error of a difference of late times."""
_AT_EDGE = 1e-7
"""s; largest distance of a row from the beginning of its period."""


def shorten(settings: Settings) -> Settings:
    """Return settings whose motion has at most two periods."""
    if settings.task.motion.periods <= PERIODS:
        return settings
    return replace(settings, task=shorten_task(settings.task))


@lru_cache(maxsize=8)
def shorten_task(task: Task) -> Task:
    """Return a task whose motion has at most two periods."""
    if task.motion.periods <= PERIODS:
        return task
    motion = task.motion.with_periods(PERIODS)
    return task if motion is task.motion else replace(task, motion=motion)


def repeat_rows(rows: Rows, settings: Settings) -> Rows | None:
    """Return rows of the motion with two periods as those of the whole motion.

    The second period gets the values of the first, to the last digit. None if a period is not a
    whole number of steps.
    """
    found = _find_periods(rows.times, shorten(settings))
    if found is None:
        return None
    first, middle, last = found
    values = [part for part in (rows.position, rows.rate, rows.acceleration) if part is not None]
    for part in values:
        part[[middle, last]] = part[first]
    for part in (*values, *(column for name, column in rows.columns.items() if name != "t")):
        part[middle + 1 : last] = part[first + 1 : middle]
    repeated = settings.task.motion.periods - PERIODS
    return replace(rows, repeated=repeated, block=(middle - 1, last - 1))


def split_rows(rows: Rows) -> tuple[Rows, Rows, Rows]:
    """Return lead-in, one period and lead-out; the last two begin with the row before them."""
    before, last = rows.block
    middle, end = before + 1, last + 1
    first = middle - (last - before)
    return rows.part(0, first), rows.part(first, middle), rows.part(end, len(rows.times) - 1)


def lead_files(
    suffix: str, text: Callable[[Rows, Settings], Iterable[str]]
) -> dict[str, Callable[[Rows, Settings], list[str]]]:
    """Return the companion files with lead-in and lead-out of a period that is repeated.

    The suffix is that of the format; `text` returns a line for each row of a part.
    """
    return {
        f"{name}{suffix}": partial(_lead_lines, text=text, part=part)
        for name, part in ((LEAD_IN, 0), (LEAD_OUT, 2))
    }


def _lead_lines(
    rows: Rows, settings: Settings, *, text: Callable[[Rows, Settings], Iterable[str]], part: int
) -> list[str]:
    if not settings.section.looped:
        return []
    return list(text(split_rows(rows)[part], settings))[min(part, 1) :]


def read_looped(
    path: Path, settings: Settings, read: Callable[[Path], Iterable[Array]]
) -> Iterator[Array]:
    """Yield the numbers of a table whose period is repeated: lead-in, every period, lead-out.

    Raises
    ------
    TableError
        A companion file is missing.
    """
    lead_in, lead_out = (
        path.with_name(f"{path.stem}{n}{path.suffix}") for n in (LEAD_IN, LEAD_OUT)
    )
    for file in (lead_in, lead_out):
        if not file.is_file():
            raise TableError(f"{file.name} is missing")
    yield from read(lead_in)
    yield from repeat(np.concatenate(list(read(path))), settings.task.motion.periods)
    yield from read(lead_out)


def _find_periods(times: Array, short: Settings) -> tuple[int, int, int] | None:
    """Return the rows at which the two periods begin and end; None without such rows.

    The rows of both periods have the same steps of time, which together are a period: on the
    controller's clock they may not be.
    """
    period = short.task.motion.trajectory.period
    edges = short.window[0] + period * np.arange(PERIODS + 1)
    places = np.minimum(np.searchsorted(times, edges - _AT_EDGE), len(times) - 1)
    first, middle, last = (int(place) for place in places)
    if middle - first != last - middle or np.any(np.abs(times[places] - edges) > _AT_EDGE):
        return None
    if abs(times[middle] - times[first] - period) > _SAME_PERIOD:
        return None
    steps = np.diff(times[first : last + 1]).reshape(PERIODS, -1)
    return None if np.any(np.abs(steps[0] - steps[1]) > _SAME_STEP) else (first, middle, last)


class Collected(NamedTuple):
    """The rows of a file, without the repeated periods that `Rows` leaves out."""

    times: Array
    """(N,), s."""
    values: Array
    """(N, K)."""
    repeated: int
    block: tuple[int, int]

    def rows(
        self, position: Array, rate: Array | None = None, acceleration: Array | None = None
    ) -> Rows:
        """Return the rows with these values; a `TableError` names the first wrong one."""
        rows = Rows(self.times, position, rate, acceleration)
        return replace(rows, repeated=self.repeated, block=self.block).checked()


def collect(blocks: Iterable[tuple[Array, Array]], settings: Settings) -> Collected:
    """Return the rows of a file that is read in blocks.

    The blocks are times (N,), s, and values (N, K) of successive rows. A table whose further
    periods differ from the second is kept whole. Raises `TableError` without rows, or for too many
    that do not repeat.
    """
    collector = _Collector(settings)
    for times, values in blocks:
        for first in range(0, len(times), _ROWS):
            rows = slice(first, first + _ROWS)
            collector.add(times[rows], values[rows])
    return collector.finish()


class _Collector:
    """The rows so far, and those of the repeated period once it is known."""

    def __init__(self, settings: Settings) -> None:
        self._short = shorten(settings)
        self._repeats = settings.task.motion.periods - self._short.task.motion.periods
        self._parts: list[tuple[Array, Array]] = []
        self._count = self._taken = 0
        self._block = (0, 0)
        self._period = np.empty(0), np.empty((0, 0))
        """Steps (n,), s, and values (n, K) of the repeated period."""
        self._time = 0.0
        """Of the last row, s."""

    def add(self, times: Array, values: Array) -> None:
        """Add rows; those that repeat the period are only counted."""
        if self._taken < self._expected:
            times, values = self._take(times, values)
        if not len(times):
            return
        self._parts.append((times, values))
        self._count += len(times)
        if self._count > MOST_ROWS:
            raise TableError(f"more than {MOST_ROWS} rows do not repeat a period")
        self._time = float(times[-1])
        if (
            self._repeats
            and self._block == (0, 0)
            and self._time > self._short.window[1] + _AT_EDGE
        ):
            self._begin()

    def finish(self) -> Collected:
        """Return the rows; the times after the repeated periods are those without them."""
        if self._taken < self._expected:
            self._expand()
        if not self._parts:
            raise TableError("the table has no rows")
        times, values = self._joined()
        if self._block == (0, 0):
            return Collected(times, values, 0, (0, 0))
        first, last = self._block
        times[last + 1 :] -= self._repeats * (times[last] - times[first])
        # The difference of late times has lost digits, which the controller's clock has not.
        step = self._short.step
        if step is not None:
            exact = np.append(times[: last + 1], step * np.rint(times[last + 1 :] / step))
        else:
            exact = self._short.form.written_times(times, self._short)
        times = np.where(np.abs(times - exact) < _LOST_DIGITS, exact, times)
        return Collected(times, values, self._repeats, self._block)

    @property
    def _expected(self) -> int:
        """Number of the rows that repeat the period."""
        return self._repeats * (self._block[1] - self._block[0])

    def _joined(self) -> tuple[Array, Array]:
        times, values = (np.concatenate(part) for part in zip(*self._parts, strict=True))
        return times, values

    def _begin(self) -> None:
        """Find the two periods among the rows so far."""
        times, values = self._joined()
        self._parts = [(times, values)]
        found = _find_periods(times, self._short)
        if found is not None:
            first, middle, last = found
            if np.array_equal(values[first + 1 : middle], values[middle + 1 : last]):
                # The first and the last row of the window may differ: what is before or after them.
                self._block = middle - 1, last - 1
                self._period = np.diff(times[middle - 1 : last]), values[middle:last]
                self._parts = [(times[:last], values[:last])]
                self._count, self._time = last, float(times[last - 1])
                self.add(times[last:], values[last:])
                return
        self._repeats = 0

    def _take(self, times: Array, values: Array) -> tuple[Array, Array]:
        """Count the rows that repeat the period; return the others."""
        most = min(len(times), self._expected - self._taken)
        if not most:
            return times, values
        steps, repeated = self._period
        place = (self._taken + np.arange(most)) % len(steps)
        found = np.diff(times[:most], prepend=self._time)
        same = np.all(values[:most] == repeated[place], axis=1)
        same &= np.abs(found - steps[place]) <= _SAME_STEP
        equal = most if np.all(same) else int(np.argmin(same))
        self._taken += equal
        if equal:
            self._time = float(times[equal - 1])
        if equal < most:
            self._expand()
        return times[equal:], values[equal:]

    def _expand(self) -> None:
        """Keep the rows that were only counted: the table repeats the period less often."""
        if self._taken + self._count > MOST_ROWS:
            raise TableError(f"more than {MOST_ROWS} rows do not repeat a period")
        steps, repeated = self._period
        place = np.arange(self._taken) % max(1, len(steps))
        begin = self._parts[-1][0][-1]
        self._parts.append((begin + np.cumsum(steps[place]), repeated[place]))
        self._count += self._taken
        self._repeats = self._taken = 0
        self._block = (0, 0)
