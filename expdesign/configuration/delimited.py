"""Form of a table as text: its delimiter and its decimal mark."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Sequence
from typing import NamedTuple

DELIMITERS = (";", "\t", ",", "|", " ")
_NUMBER = re.compile(r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?")


class TableForm(NamedTuple):
    """Marks between and within the numbers of a table."""

    delimiter: str
    decimal: str


def is_number(cell: str) -> bool:
    """Return whether a cell is a number, with either decimal mark."""
    return _NUMBER.fullmatch(cell.strip()) is not None


def split_table(
    lines: Sequence[str], further: Callable[[str], bool] = lambda _: False
) -> tuple[TableForm, list[list[str]]]:
    """Return the form of a table, whose delimiter leaves most numbers, and its cells.

    `further` returns whether a cell counts as a number of another kind, such as a date.

    >>> split_table(["a;b", "1,5;2"])
    (TableForm(delimiter=';', decimal=','), [['a', 'b'], ['1,5', '2']])
    """
    found = {
        mark: list(csv.reader([f"{line}\n" for line in lines], delimiter=mark))
        for mark in DELIMITERS
    }

    def numbers(mark: str) -> int:
        return sum(is_number(cell) or further(cell) for row in found[mark] for cell in row)

    delimiter = max(found, key=numbers)
    cells = (cell for row in found[delimiter] for cell in row)
    comma = any("," in cell and is_number(cell) and not further(cell) for cell in cells)
    return TableForm(delimiter, "," if comma else "."), found[delimiter]
