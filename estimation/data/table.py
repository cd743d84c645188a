"""Raw table: the columns of the channels as the file has them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.data.columns import RecordedColumn
from expdesign.configuration import InputError, Problem
from expdesign.configuration.fields import MOST_SAMPLES, require_at_most

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
    require_at_most(count, MOST_SAMPLES, "the recording is too long", file)


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
