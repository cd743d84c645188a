"""A table of a report: values with the way in which they are shown on a page and in LaTeX."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from results.report.numerals import readable

Value = str | float | bool | None

Kind = Literal["text", "number", "parameter", "outcome"]


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Of the kinds, ``"parameter"`` holds names that are set as formulas, ``"outcome"`` words that are
    coloured by what they say; `digits` are the significant ones of numbers.
    """

    title: str
    unit: str = ""
    kind: Kind = "number"
    digits: int = 4

    @property
    def heading(self) -> str:
        """Title and unit, as the head of the column shows them."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title


@dataclass(frozen=True)
class ReportTable:
    """A table by its name in the page, which is that of its file without the ending.

    Each row has a value for every column: text, number, truth value, or None where there is
    nothing. The page shows a folded one on request only.
    """

    key: str
    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Value, ...], ...]
    folded: bool = False

    @classmethod
    def of(
        cls,
        key: str,
        caption: str,
        columns: Sequence[Column],
        rows: Sequence[Sequence[Value]],
        *,
        folded: bool = False,
    ) -> ReportTable:
        """Make a table of rows; each must have a value for every column.

        Raises
        ------
        ValueError
            A row has more or fewer values than there are columns.
        """
        if any(len(row) != len(columns) for row in rows):
            raise ValueError(f"{key}: every row needs {len(columns)} values")
        return cls(key, caption, tuple(columns), tuple(tuple(row) for row in rows), folded)


def cell_text(column: Column, value: Value) -> str:
    """Return what a cell shows: numbers with the column's digits, nothing for what is missing."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return readable(value, column.digits)
    return value


def sort_key(value: Value) -> str:
    """Return what a page sorts a cell by: all digits of a number, nothing for what is missing."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    if isinstance(value, bool):
        return str(int(value))
    return repr(value) if isinstance(value, float) else str(value)
