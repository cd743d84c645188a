"""A table of a report: values with the way in which they are shown on a page and in LaTeX."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, cast

import numpy as np
from numpy.typing import NDArray

from results.notation import readable

Value = str | float | bool | None

Kind = Literal["text", "number", "parameter", "outcome"]


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Of the kinds, ``"parameter"`` holds names that are set as formulas, ``"outcome"`` words that are
    coloured by what they say; `digits` are the significant ones of numbers. The cell of a record is
    its attribute `of`, a path such as ``"read_back.position_error"`` (nothing when a part of it is
    None), or what `of` returns for it; of a tuple the value in the column's place. In a table of
    columns `of` has the values themselves. Numbers are shown times `factor`, for a handier unit.
    """

    title: str
    unit: str = ""
    kind: Kind = "number"
    digits: int = 4
    of: str | Callable[[Any], Value] | Sequence[Value] | NDArray[Any] = ""
    factor: float = 1

    @property
    def heading(self) -> str:
        """Title and unit, as the head of the column shows them."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title

    def cell(self, record: Any, place: int) -> Value:
        """Return the value of a record in this column, which is the one in this place."""
        if callable(self.of):
            value = self.of(record)
        elif not isinstance(self.of, str):
            value = self.of[record]
            value = value.item() if isinstance(value, np.generic) else value
        else:
            value = record if self.of else record[place]
            for name in self.of.split(".") if self.of else ():
                value = None if value is None else getattr(value, name)
        return self.factor * value if self.factor != 1 and isinstance(value, float) else value


def text_columns(*titles: str) -> tuple[Column, ...]:
    """Return columns of text, of tuples."""
    return tuple(Column(title, kind="text") for title in titles)


@dataclass(frozen=True)
class ReportTable:
    """A table by its name in the page, which is that of its file without the ending.

    Each row has a value for every column: text, number, truth value, or None where there is
    nothing. The page shows a folded one on request only.
    """

    kind: ClassVar[str] = "table"
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
        records: Iterable[Any] | None = None,
        *,
        folded: bool = False,
    ) -> ReportTable:
        """Make a table with a row for every record, or for every tuple of values.

        Without records the columns have their values, all of the first one's length.

        Raises
        ------
        ValueError
            A tuple has more or fewer values than there are columns.
        """
        if records is None:
            records = range(len(cast("Sequence[Value]", columns[0].of)))
        rows = []
        for record in records:
            if isinstance(record, tuple) and len(record) != len(columns):
                raise ValueError(f"{key}: every row needs {len(columns)} values")
            rows.append(tuple(column.cell(record, k) for k, column in enumerate(columns)))
        return cls(key, caption, tuple(columns), tuple(rows), folded)


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
