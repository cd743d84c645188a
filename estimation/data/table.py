"""What is read of a file: the channels' columns as they stand there."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.data.columns import RecordedColumn, unit_factor
from expdesign.configuration import (
    LENGTH_CHANNELS,
    DataSection,
    InputError,
    Problem,
    ResolvedRobot,
    shown,
)
from expdesign.configuration.quantity import LENGTH
from expdesign.configuration.sizes import SAMPLES

RowNoun = Literal["line", "sample", "message"]
HEADER_LINE = 1
"""Of text files, as an editor counts."""
NUMERIC = "biuf"
"""Kinds of NumPy's types that are numbers."""
MOST_PROBLEMS = 5
"""Defects of a kind that are shown one by one."""


@dataclass(frozen=True, eq=False)
class RawTable:
    """Columns of a file by channel."""

    file: Path
    values: Mapping[str, Array]
    """Channel → (T,), numbers in the file's unit; NaN where there is no number."""
    columns: Mapping[str, RecordedColumn]
    """Channel → what the file calls the column, and its unit."""
    row_noun: RowNoun = "sample"
    """What the rows are to the user. Lines are those of an editor, the header being line 1; samples
    and messages count from one."""
    first_row: int = 1
    """Number of the first row."""
    rows: NDArray[np.int64] | None = None
    """(T,), numbers of the rows where they do not follow each other."""
    texts: Mapping[tuple[str, int], str] = field(default_factory=dict)
    """(channel, row from zero) → what stands in a cell that is no finite number."""

    def __len__(self) -> int:
        """Return the number of rows T."""
        return len(next(iter(self.values.values())))

    def row_number(self, row: int) -> int:
        """Return the user's number of a row that counts from zero."""
        return int(self.rows[row]) if self.rows is not None else self.first_row + row

    def row_name(self, row: int) -> str:
        """Return the user's name of a row that counts from zero: ``line 17``."""
        return f"{self.row_noun} {self.row_number(row)}"

    def column_name(self, channel: str) -> str:
        """Return what the file calls a channel."""
        return self.columns[channel].label if channel in self.columns else channel

    def problem(
        self, message: str, channel: str, row: int | None = None, allowed: str | None = None
    ) -> Problem:
        """Return the record of what is wrong with a column, or with one of its cells."""
        if row is None or self.row_noun == "line":
            line = None if row is None else self.row_number(row)
            return Problem(message, self.file, line, self.column_name(channel), allowed)
        key = f"{self.column_name(channel)}, {self.row_name(row)}"
        return Problem(message, self.file, key=key, allowed=allowed)

    def header_problem(self, message: str, channel: str, allowed: str | None = None) -> Problem:
        """Return the record of what is wrong with what the file says about a column."""
        line = HEADER_LINE if self.row_noun == "line" else None
        return Problem(message, self.file, line, self.column_name(channel), allowed)

    def part(self, first: int, end: int) -> RawTable:
        """Return the rows from `first` on and before `end`."""
        if first == 0 and end == len(self):
            return self
        return replace(
            self,
            values={channel: values[first:end] for channel, values in self.values.items()},
            first_row=self.first_row + first,
            rows=None if self.rows is None else self.rows[first:end],
            texts={
                (channel, row - first): text
                for (channel, row), text in self.texts.items()
                if first <= row < end
            },
        )


def refuse_long(count: int, file: Path) -> None:
    """Refuse a recording with more rows than are read."""
    if excess := SAMPLES.excess(count, "the recording is too long"):
        allowed = f"{excess.allowed}: a part of it, or a lower sampling"
        raise InputError(excess.message, file, allowed=allowed)


def refuse(problems: Sequence[Problem], file: Path, what: str, count: int | None = None) -> None:
    """Raise when there are problems: the first ones, and how many more `what` there are.

    `count` is their number where only the first ones were made.
    """
    if not problems:
        return
    more = (len(problems) if count is None else count) - MOST_PROBLEMS
    rest = [Problem(f"{more} more {what}", file)] if more > 0 else []
    raise InputError([*problems[:MOST_PROBLEMS], *rest])


def refuse_rows(
    rows: NDArray[np.intp], problem: Callable[[int], Problem], file: Path, what: str
) -> None:
    """Raise when there are rows with a problem, as `refuse`; only the first ones are made."""
    refuse([problem(int(row)) for row in rows[:MOST_PROBLEMS]], file, what, len(rows))


_UNITS = ("m", "mm", "cm", "in", "ft", "µm", "dm", "km")
"""Units that are tried when the lengths do not fit, the likeliest first."""
_ZERO_AT_HOME = "; it would fit if the channel read zero at home: data.offset: home"
_NEAR_HOME = 0.25
"""Share of the stroke within which a motion about home has its middle."""
_MARGIN = 0.1
"""By how much of the longest length the middle of a recording may be out of range: limits may be
stated for the design only, a unit is wrong by a factor of 2.5 at least."""


def refuse_few_rows(table: RawTable, parameters: int) -> None:
    """Refuse fewer rows than the robot has parameters."""
    if len(table) < parameters:
        rows = f"{len(table)} row{'' if len(table) == 1 else 's'}"
        message = f"{rows} of data, but the robot has {parameters} parameters"
        raise InputError(message, table.file, allowed=f"at least {parameters} rows")


def refuse_cells(table: RawTable, channels: Sequence[str], decimal: str) -> None:
    """Refuse cells of these channels that are no finite numbers."""
    found, count = list[tuple[int, int]](), 0
    for place, channel in enumerate(channels):
        rows = np.flatnonzero(~np.isfinite(table.values[channel]))
        found += [(int(row), place) for row in rows[:MOST_PROBLEMS]]
        count += len(rows)
    problems = [
        _cell(table, channels[place], row, decimal) for row, place in sorted(found)[:MOST_PROBLEMS]
    ]
    refuse(problems, table.file, "cells are no finite numbers", count)


def _cell(table: RawTable, channel: str, row: int, decimal: str) -> Problem:
    text = table.texts.get((channel, row))
    if text is None:
        if table.row_noun == "line":  # one of very many, whose texts are not kept
            return table.problem("the cell is no finite number", channel, row)
        found = table.values[channel][row]
        return table.problem("NaN" if np.isnan(found) else "an infinite value", channel, row)
    if not text:
        return table.problem("the cell is empty", channel, row)
    mark = "," if decimal == "." else "."
    digits = text.replace(mark, "", 1).lstrip("+-")
    allowed = f"numbers, or data.decimal: '{mark}'" if mark in text and digits.isdigit() else None
    return table.problem(f"{shown(text)} is no finite number", channel, row, allowed)


def refuse_periods(table: RawTable) -> None:
    """Refuse numbers of periods that are not whole, or that fall."""
    values = table.values.get("period")
    if values is None:
        return
    name = "rows are like that"

    def fraction(row: int) -> Problem:
        return table.problem(f"{values[row]:g} is no number of a period", "period", row)

    def fall(row: int) -> Problem:
        message = f"period {values[row]:.0f} after period {values[row - 1]:.0f}"
        return table.problem(message, "period", row)

    refuse_rows(np.flatnonzero(values != np.round(values)), fraction, table.file, name)
    refuse_rows(np.flatnonzero(np.diff(values) < 0) + 1, fall, table.file, name)


@dataclass(frozen=True, eq=False)
class LengthRange:
    """Lengths that a robot's struts can have: (6,) each, m, and where they are from."""

    lower: Array
    upper: Array
    origin: str

    @classmethod
    def of(cls, robot: ResolvedRobot) -> LengthRange:
        """Return the limits on the strut lengths; where there are none, the scale of the robot.

        That is half to twice the length at home, more than a telescope can do.
        """
        home = robot.struts_at(robot.home).lengths
        limit = robot.limits.get("strut_length")
        if limit is None:
            return cls(home / 2, home * 2, "half to twice the lengths at home")
        # What is kept free is for motions as they are driven: a recording may go there.
        low, high = limit.stated_bounds
        lower = np.where(np.isfinite(low) & (low > 0), low, home / 2)
        return cls(lower, np.where(np.isfinite(high), high, home * 2), limit.origin)

    def fits(self, middle: Array) -> NDArray[np.bool_]:
        """Tell for which struts a median length, (6,), m, is plausible."""
        margin = _MARGIN * self.upper
        return (middle >= self.lower - margin) & (middle <= self.upper + margin)

    def problem(self, table: RawTable, strut: int, row: int, message: str) -> Problem:
        """Return the record of a length that this strut cannot have."""
        span = f"{self.lower[strut]:.4g} to {self.upper[strut]:.4g} m, {self.origin}"
        return table.problem(f"strut {strut + 1} is {message}", LENGTH_CHANNELS[strut], row, span)


def refuse_implausible_lengths(
    table: RawTable, lengths: Array, robot: ResolvedRobot, section: DataSection
) -> None:
    """Refuse strut lengths, (T, 6), m, that this robot cannot have: wrong units, wild values."""
    allowed = LengthRange.of(robot)
    middle = np.median(lengths, axis=0)
    outside = (lengths < allowed.lower) | (lengths > allowed.upper)
    problems = []
    for strut in np.flatnonzero(~allowed.fits(middle)).tolist():
        message = f"around {middle[strut]:.4g} m long, out of this robot's range"
        row = int(np.argmax(outside[:, strut]))
        hint = _hint(middle, strut, table, section, robot)
        problems.append(allowed.problem(table, strut, row, message + hint))
    if problems:
        raise InputError(problems)
    stroke = allowed.upper - allowed.lower
    wild = (lengths <= np.maximum(allowed.lower - stroke, 0)) | (lengths > allowed.upper + stroke)
    places = np.argwhere(wild)
    for row, strut in places[:MOST_PROBLEMS].tolist():
        message = f"{lengths[row, strut]:.4g} m long, far out of this robot's range"
        problems.append(allowed.problem(table, strut, row, message))
    refuse(problems, table.file, "lengths are like that", len(places))


def _hint(
    middle: Array, strut: int, table: RawTable, section: DataSection, robot: ResolvedRobot
) -> str:
    """Return how a strut's median length would fit: in another unit, counted otherwise."""
    allowed, home = LengthRange.of(robot), robot.struts_at(robot.home).lengths
    signs = np.array(section.channel_signs("q"))
    offsets = home if section.length_offsets == "home" else np.array(section.length_offsets)
    positions = signs * (middle - offsets)
    in_file = positions / [unit_factor(each, table, section) for each in LENGTH_CHANNELS]
    units = {u: allowed.fits(offsets + signs * in_file * LENGTH.parse(f"1 {u}")) for u in _UNITS}
    from_home = not np.any(offsets)
    stroke = allowed.upper - allowed.lower
    if (
        from_home
        and abs(np.mean(positions)) < _NEAR_HOME * np.min(stroke)
        and np.all(allowed.fits(home + signs * positions))
        and not any(map(np.all, units.values()))
    ):
        # One cause for all six goes before units that fit single struts by chance.
        return _ZERO_AT_HOME
    for unit, fits in units.items():
        if fits[strut]:
            return f"; it would fit if the file were in {unit}: data.units: {{q: {unit}}}"
    if allowed.fits(offsets - signs * positions)[strut]:
        hint = f"data.sign: {{q: {-signs[strut]}}}"
        return f"; it would fit if the channel counted the other way: {hint}"
    if from_home and np.abs(positions)[strut] < _NEAR_HOME * stroke[strut]:
        return _ZERO_AT_HOME
    return ""
