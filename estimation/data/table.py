"""Raw table of a recording: its columns, their assignment to channels, and their defects."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.data.stamps import EXAMPLE
from expdesign.configuration import DataSection, InputError, Problem, quote
from expdesign.configuration.errors import nearest_name
from expdesign.configuration.estimate import CHANNELS, SUPPLY
from expdesign.configuration.schema import MOST_SAMPLES, require_at_most

OPTIONAL = frozenset({"period", SUPPLY})
"""Channels that a file may lack."""
_WITH_UNIT = re.compile(r"(.*?\S)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))")
_MOST_SHOWN = 30


@dataclass(frozen=True)
class RecordedColumn:
    """A column under the names in its file; each name defaults to the one before."""

    text: str
    """Full name, for messages and `data.columns`."""
    place: Any = None
    """Position or path in the file, different for each column."""
    name: str = ""
    """Full name without the unit."""
    short: str = ""
    """Name without the unit and without the struct or group."""
    unit: str | None = None
    file: Path | None = None
    """File of the column if the table has rows of another one."""

    def __post_init__(self) -> None:
        """Fill in the shorter names."""
        object.__setattr__(self, "name", self.name or self.text)
        object.__setattr__(self, "short", self.short or self.name)

    @property
    def label(self) -> str:
        """Full name for messages: short, on one line, without control codes."""
        return label(self.text)

    @property
    def spellings(self) -> tuple[str, str, str]:
        """Accepted names of the column, the most exact first."""
        return self.text, self.name, self.short


def label(text: str) -> str:
    """Return a text from a file for messages, without quotation marks."""
    return quote(text).removeprefix("'").removesuffix("'")


def header_column(text: str, place: Any) -> RecordedColumn:
    """Read a header such as ``q1 [mm]`` or ``q1 (mm)``; brackets around digits are not a unit."""
    text = text.strip()
    match = _WITH_UNIT.fullmatch(text)
    if match is None:
        return RecordedColumn(text, place)
    unit = (match.group(2) if match.group(2) is not None else match.group(3)).strip()
    if unit[:1].isdigit():
        return RecordedColumn(text, place)
    return RecordedColumn(
        text, place, name=match.group(1), unit=None if unit in ("", "-") else unit
    )


@dataclass(frozen=True)
class FileContent:
    """Columns of a file, and the keys of `data` that follow from its text."""

    columns: Sequence[RecordedColumn]
    settings: Mapping[str, Any] = field(default_factory=dict)
    questions: Sequence[str] = ()
    """What prevents reading it, with advice."""
    has_time: bool = False
    """True if the format has the time without a column."""


def pick_columns(
    columns: Sequence[RecordedColumn],
    names: Mapping[str, str],
    file: Path,
    line: int | None = None,
    optional: Collection[str] = OPTIONAL,
    channels: Sequence[str] = CHANNELS,
) -> dict[str, RecordedColumn]:
    """Pick the column of every channel.

    A column is found by its full name, its name without the unit, or its name without struct or
    group, if that is unique. By default its name is that of the channel, or that of the column of a
    matrix: q3 is ``q3`` or ``q(:,3)``.

    Parameters
    ----------
    names : mapping
        Channel → name, from `data.columns`.
    file, line
        For messages.
    optional : collection of str
        Channels that may be missing, unless `names` contains them.
    channels : sequence of str
        Channels that the file may contain.

    Raises
    ------
    InputError
        Columns are missing (with the nearest name), ambiguous, or assigned to two channels.
    """
    place = Problem("", file, line)
    found: dict[str, RecordedColumn] = {}
    missing: dict[str, str] = {}
    problems: list[Problem] = []
    for channel in (one for one in channels if one != SUPPLY or one in names):
        wanted = [names.get(channel, channel)]
        if channel not in names and channel[1:].isdigit():
            wanted.append(f"{channel[0]}(:,{channel[1]})")
        # The most exact spelling that any column has.
        matches = next(
            (
                some
                for name in wanted
                for level in range(3)
                if (some := [c for c in columns if c.spellings[level] == name.strip()])
            ),
            [],
        )
        if len(matches) == 1:
            found[channel] = matches[0]
        elif matches:
            problems.append(_ambiguous(channel, wanted[0], matches, place))
        elif channel in names or channel not in optional:
            missing[channel] = wanted[0]
    free = [column for column in columns if column not in found.values()]
    if columns and len(missing) > 1 and not (found or problems):
        sought = ", ".join(quote(name) for name in missing.values())
        message = f"this is not a recording, or its columns have other names: none of {sought}"
        named = _one_of("t", [column.label for column in free])
        allowed = f"{named}; `expdesign init-data FILE` proposes the section"
        raise InputError(replace(place, message=message, allowed=allowed))
    problems += [_missing(*one, columns, free, place) for one in missing.items()]
    problems += _shared_columns(found, place)
    if problems:
        raise InputError(problems)
    return found


def _ambiguous(
    channel: str, name: str, matches: Sequence[RecordedColumn], place: Problem
) -> Problem:
    texts = list(dict.fromkeys(column.label for column in matches))
    if len(texts) == 1:
        message = f"{len(matches)} columns have the name of {channel}"
        return replace(place, message=message, key=texts[0], allowed="one column")
    message = f"several columns could be {channel}"
    return replace(place, message=message, key=name, allowed=_one_of(channel, texts))


def _missing(
    channel: str,
    name: str,
    columns: Sequence[RecordedColumn],
    free: Sequence[RecordedColumn],
    place: Problem,
) -> Problem:
    if not columns:
        return replace(place, message=f"no column for {channel}: the file has none", key=name)
    texts = [column.label for column in free if column.text]
    meant = nearest_name(name, texts) or (
        nearest_name(name, [label(column.short) for column in free])
        if channel != "t"
        else next((text for text in texts if text.lower().startswith("t")), None)
    )
    message = f"there is no column {quote(name)} for {channel}"
    taken = f"data.columns: {{{channel}: …}} with a column that no other channel has: none is left"
    allowed = _one_of(channel, texts) if texts else taken
    return replace(place, message=message, key=name, allowed=allowed, nearest=meant)


def _shared_columns(found: Mapping[str, RecordedColumn], place: Problem) -> Iterator[Problem]:
    seen: dict[Any, str] = {}
    for channel, column in found.items():
        if column.place in seen:
            message = f"one column for both {seen[column.place]} and {channel}"
            allowed = "data.columns: one for each channel"
            yield replace(place, message=message, key=column.label, allowed=allowed)
        seen[column.place] = channel


def _one_of(channel: str, texts: Sequence[str]) -> str:
    some = ", ".join(f"'{text}'" for text in texts[:_MOST_SHOWN])
    more = len(texts) - _MOST_SHOWN
    listed = f"{some} and {more} more" if more > 0 else some
    return f"data.columns: {{{channel}: …}} with one of {listed}"


RowNoun = Literal["line", "sample", "message"]
HEADER_LINE = 1
"""Of text files, as an editor counts."""
NUMERIC = "biuf"
"""Kinds of NumPy's types that are numbers."""
MOST_PROBLEMS = 5
"""Defects of a kind that are shown one by one."""


@dataclass(frozen=True, eq=False)
class RawTable:
    """Columns of a file, by channel."""

    file: Path
    values: Mapping[str, Array]
    """Channel → (T,), numbers in the file's unit; NaN without a number."""
    columns: Mapping[str, RecordedColumn]
    """Channel → its column in the file."""
    row_noun: RowNoun = "sample"
    """Noun for a row. Lines count as in an editor, the header being line 1; samples and messages
    count from one."""
    first_row: int = 1
    """Number of the first row."""
    rows: NDArray[np.int64] | None = None
    """(T,), numbers of the rows if they are not consecutive."""
    texts: Mapping[tuple[str, int], str] = field(default_factory=dict)
    """(channel, row from zero) → text of a cell without a finite number."""
    header_line: int = HEADER_LINE
    """Line of the names in a text."""
    origin: float = 0.0
    """First time of a column that counts from its first row, in the file's unit: it is
    subtracted."""

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
        """Return the file's name for a channel."""
        return self.columns[channel].label if channel in self.columns else channel

    def problem(
        self, message: str, channel: str, row: int | None = None, allowed: str | None = None
    ) -> Problem:
        """Describe a defect of a column, or of one of its cells."""
        if self._other_file(channel):
            return self.header_problem(message, channel, allowed)
        if row is None or self.row_noun == "line":
            line = None if row is None else self.row_number(row)
            return Problem(message, self.file, line, self.column_name(channel), allowed)
        key = f"{self.column_name(channel)}, {self.row_name(row)}"
        return Problem(message, self.file, key=key, allowed=allowed)

    def header_problem(self, message: str, channel: str, allowed: str | None = None) -> Problem:
        """Describe a defect in the header of a column."""
        other = self._other_file(channel)
        line = self.header_line if self.row_noun == "line" and other is None else None
        return Problem(message, other or self.file, line, self.column_name(channel), allowed)

    def _other_file(self, channel: str) -> Path | None:
        """Return the file of a column whose rows are not those of this table."""
        return self.columns[channel].file if channel in self.columns else None

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


def trim(table: RawTable, section: DataSection) -> RawTable:
    """Return the rows from `data.start` to `data.end`; the others are not checked."""
    time = table.values["t"]
    finite = time[np.isfinite(time)]
    if (section.start is None and section.end is None) or len(finite) == 0:
        return table
    # A stamp slightly before a limit, due to jitter, counts as the first one after it.
    slack = section.time_tolerance * float(np.median(np.diff(finite))) if len(finite) > 1 else 0.0
    first, end = 0, len(table)
    if section.start is not None:
        first = int(np.argmax(np.append(time >= section.start - slack, True)))
    if section.end is not None:
        end = first + int(np.argmax(np.append(time[first:] >= section.end - slack, True)))
    if first >= end:
        late = first == len(table)
        key, limit = ("start", section.start) if late else ("end", section.end)
        message = f"no rows {'at or after' if late else 'before'} data.{key}, {limit:g} s"
        span = f"the file has {finite.min():g} to {finite.max():g} s"
        raise InputError(table.problem(message, "t", allowed=span))
    return table.part(first, end)


def refuse_long(count: int, file: Path) -> None:
    """Refuse a recording with too many rows."""
    require_at_most(count, MOST_SAMPLES, "the recording is too long", file)


def refuse(problems: Sequence[Problem], file: Path, what: str, count: int | None = None) -> None:
    """Raise the first of the problems, if any, and the number of further ones, `what`.

    `count` is their total number if only the first ones were created.
    """
    if not problems:
        return
    more = (len(problems) if count is None else count) - MOST_PROBLEMS
    rest = [Problem(f"{more} more {what}", file)] if more > 0 else []
    raise InputError([*problems[:MOST_PROBLEMS], *rest])


def refuse_rows(
    rows: NDArray[np.intp], problem: Callable[[int], Problem], file: Path, what: str
) -> None:
    """Raise the problems of rows, as `refuse`; only the first ones are created."""
    refuse([problem(int(row)) for row in rows[:MOST_PROBLEMS]], file, what, len(rows))


def refuse_cells(table: RawTable, channels: Sequence[str], decimal: str) -> None:
    """Refuse cells of these channels without a finite number."""
    found, count = list[tuple[int, int]](), 0
    for place, channel in enumerate(channels):
        rows = np.flatnonzero(~np.isfinite(table.values[channel]))
        if 1 < len(rows) == len(table):
            rows = rows[:1]  # one fault of the whole column
        found += [(int(row), place) for row in rows[:MOST_PROBLEMS]]
        count += len(rows)
    problems = [
        _cell(table, channels[place], row, decimal) for row, place in sorted(found)[:MOST_PROBLEMS]
    ]
    refuse(problems, table.file, "cells are not finite numbers", count)


def _cell(table: RawTable, channel: str, row: int, decimal: str) -> Problem:
    text = table.texts.get((channel, row))
    if text is None:
        if table.row_noun == "line":  # one of very many, without a stored text
            return table.problem("the cell is not a finite number", channel, row)
        found = table.values[channel][row]
        return table.problem("NaN" if np.isnan(found) else "an infinite value", channel, row)
    if not text:
        return table.problem("the cell is empty", channel, row)
    mark = "," if decimal == "." else "."
    digits = text.replace(mark, "", 1).lstrip("+-")
    allowed = f"numbers, or data.decimal: '{mark}'" if mark in text and digits.isdigit() else None
    if channel == "t" and allowed is None:
        allowed = f"numbers, or dates with times of ISO 8601 such as {EXAMPLE}, all in one form"
    return table.problem(f"{quote(text)} is not a finite number", channel, row, allowed)


_ISLANDS = 3
"""Number of separate runs of rows without any force that shows a second source of rows."""
_QUANTA = 5
"""Size of the forces before these rows, in steps of the sensor: smaller ones round to zero."""


def refuse_empty_rows(table: RawTable, channels: Sequence[str]) -> None:
    """Refuse rows without any force, zero in all channels, again and again between others.

    A second publisher of the topic, or a second program that writes into the file, causes them.
    """
    sizes = np.abs([table.values[channel] for channel in channels])
    empty, largest = np.all(sizes == 0, axis=0), np.max(sizes, axis=0)
    begins = np.flatnonzero(empty[1:-1] & ~empty[:-2]) + 1
    if len(begins) < _ISLANDS or np.all(empty[begins[-1] :]):
        return
    if np.median(largest[begins - 1]) < _QUANTA * np.min(sizes[sizes > 0]):
        return
    message = f"all forces are zero here and in {np.sum(empty) - 1} other rows between the others"
    allowed = "rows of one source: perhaps a second one writes its own, without forces, in between"
    raise InputError(table.problem(message, channels[0], int(begins[0]), allowed))


def refuse_periods(table: RawTable) -> None:
    """Refuse period numbers that are not whole, or that decrease."""
    values = table.values.get("period")
    if values is None:
        return
    name = "rows are like that"

    def fraction(row: int) -> Problem:
        return table.problem(f"{values[row]:g} is not a period number", "period", row)

    def fall(row: int) -> Problem:
        message = f"period {values[row]:.0f} after period {values[row - 1]:.0f}"
        return table.problem(message, "period", row)

    refuse_rows(np.flatnonzero(values != np.round(values)), fraction, table.file, name)
    refuse_rows(np.flatnonzero(np.diff(values) < 0) + 1, fall, table.file, name)
