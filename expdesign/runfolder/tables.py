"""CSV files of a run folder: rows, arrays or matrices, with columns described in `columns.json`."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from pathlib import Path
from typing import Any, ClassVar, Generic, Self, TypeVar

import numpy as np
from pydantic import ValidationError

from constraints.arrays import Array, Mask
from expdesign.configuration import InputError, quote
from expdesign.configuration.errors import value_problem
from expdesign.configuration.estimate import Header
from expdesign.runfolder.fields import Column, checker, field_columns
from expdesign.runfolder.files import (
    FORMAT,
    LARGEST_NUMBER,
    MissingFileError,
    atomic_write,
    check_format,
    read_mapping,
    write_json,
)

COLUMNS_FILE = "columns.json"
"""Unit and meaning of every column of every table of a folder, and the tables' formats."""

_COLUMNS_FORMAT = 1
_FORMATS = "formats"
_FIRST_LINE = 2
"""Line of a table's first row in its file."""

Row = TypeVar("Row")
Block = TypeVar("Block")
Written = TypeVar("Written")
Found = TypeVar("Found")
Cells = Mapping[str, Sequence[str]]
Matrix = tuple[tuple[tuple[str, ...], ...], tuple[str, ...], Array]
"""Cells of the columns on the left, row by row; names of the further columns; their numbers."""


@dataclass(frozen=True)
class CsvFile(Generic[Written, Found]):
    """Base of the CSV files: path, columns and format."""

    FORMAT: ClassVar[int] = 1
    """Number of the format of every table, in `columns.json`."""

    file: str
    """Path in the run folder."""
    written_by: str
    """Command that writes it, for the message about a missing file."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """The columns in their order."""
        raise NotImplementedError

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the columns."""
        return tuple(column.name for column in self.columns)

    def write(self, folder: Path, content: Written) -> list[Path]:
        """Write the table into a run folder; return its path and that of `columns.json`."""
        raise NotImplementedError

    def read(self, folder: Path) -> Found:
        """Read the table of a run folder.

        A missing file is a `MissingFileError`. Another version, missing columns or rows, and a cell
        that is not of its kind are an `InputError`, with line and column.
        """
        raise NotImplementedError

    def numbered(self, number: int | None) -> Self:
        """Return one of several tables: ``tables/motion_2.csv``; None: there is only one."""
        if number is None:
            return self
        stem, ending = self.file.rsplit(".", 1)
        return replace(self, file=f"{stem}_{number}.{ending}")

    def is_in(self, folder: Path) -> bool:
        """Return whether a folder has the file."""
        return (folder / self.file).is_file()

    def write_rows(
        self, folder: Path, rows: Iterable[Sequence[object]], more: Iterable[str] = ()
    ) -> list[Path]:
        """Write the file and describe its columns in `columns.json`; return both paths.

        `more` are the names of further columns.
        """
        path = folder / self.file
        write_csv(path, [*self.names, *more], rows)
        return [path, describe_tables(folder, [self])]

    def _read(self, folder: Path, *, some: bool = False) -> tuple[Cells, dict[str, Array]]:
        """Return the cells of the file as texts, and its columns as numbers, NaN for others.

        Unknown columns are kept; with `some` a table without rows is refused.
        """
        path = folder / self.file
        if not path.is_file():
            raise MissingFileError(path, self.written_by)
        formats = _known_columns(folder).get(_FORMATS)
        if isinstance(formats, dict) and self.file in formats:
            check_format(path, formats[self.file], self.FORMAT)
        try:
            with path.open(encoding="utf-8-sig", newline="") as file:
                names, *rows = [*filter(None, csv.reader(file, strict=True))] or [[]]
        except (OSError, ValueError, csv.Error) as error:
            raise InputError(f"not a table that can be read: {error}", path) from error
        for line, row in enumerate(rows, start=_FIRST_LINE):
            if len(row) != len(names):
                allowed = f"{len(names)}, as many as columns"
                raise InputError(f"a row of {len(row)} cells", path, line, allowed=allowed)
        columns = zip(*rows, strict=True) if rows else [()] * len(names)
        cells = dict(zip(names, columns, strict=True))
        missing = [name for name in self.names if name not in cells]
        if missing:
            raise InputError(f"columns are missing: {', '.join(missing)}", path)
        if some and not rows:
            raise InputError("the table has no rows", path, allowed="at least one")
        numbers = {name: _as_numbers(column) for name, column in cells.items()}
        allowed = f"numbers up to {LARGEST_NUMBER:g}"
        for name, values in numbers.items():
            # A broken limit may have an infinite excess.
            large = np.isfinite(values) & (np.abs(values) > LARGEST_NUMBER)
            _refuse_cells(path, cells, name, large, "number of a result", allowed)
        return cells, numbers


@dataclass(frozen=True)
class RowTable(CsvFile[Iterable[Row], tuple[Row, ...]], Generic[Row]):
    """A table with a frozen dataclass of described fields for every row.

    A cell may be empty where the field is `OpenNumber` or `MAY_BE_EMPTY`.
    """

    row: type[Row]
    some: bool = field(default=False, kw_only=True)
    """Refuse a table without rows."""
    rows_of: tuple[str, ...] = field(default=(), kw_only=True)
    """The fields that identify a row, compared by `refuse_other_rows`."""
    by: Column | None = field(default=None, kw_only=True)
    """First column, with the keys of a mapping of rows, which is written and not read."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """One for every field of the row, after that of the keys."""
        own = (column for _, columns in field_columns(self.row) for column in columns)
        return (*((self.by,) if self.by else ()), *own)

    def write(self, folder: Path, content: Any) -> list[Path]:
        """Write the rows."""
        attributes = [name for name, _ in field_columns(self.row)]
        blocks = {(key,): rows for key, rows in content.items()} if self.by else {(): content}
        cells = [
            [*key, *(getattr(row, name) for name in attributes)]
            for key, rows in blocks.items()
            for row in rows
        ]
        return self.write_rows(folder, cells)

    def read(self, folder: Path) -> tuple[Row, ...]:
        """Read the rows."""
        texts, _ = self._read(folder, some=self.some)
        attributes = [name for name, _ in field_columns(self.row)]
        cells = [
            dict(zip(attributes, row, strict=True))
            for row in zip(*(texts[name] for name in self.names), strict=True)
        ]
        try:
            return checker(tuple[self.row, ...]).validate_python(cells)  # type: ignore[name-defined]
        except ValidationError as error:
            details = error.errors(include_url=False)[0]
            number, *place = details["loc"]
            column = self.names[attributes.index(str(place[0]))] if place else ""
            message, allowed, _ = value_problem(details)
            line = int(number) + _FIRST_LINE
            raise InputError(
                message, folder / self.file, line, f"column {column}", allowed
            ) from error

    def refuse_other_rows(
        self, folder: Path, rows: Sequence[Row], wanted: Sequence[tuple[object, ...]], source: str
    ) -> None:
        """Refuse rows that contradict another file, at the first difference, with line and column.

        `wanted` has the values of `rows_of`, row by row, as the file `source` states them.
        """
        names = [c.name for name, (c,) in field_columns(self.row) if name in self.rows_of]
        found = [tuple(getattr(row, name) for name in self.rows_of) for row in rows]
        allowed = f"{len(wanted)} rows, as {source} has {', '.join(names)}, in the same order"
        for line, (here, there) in enumerate(zip_longest(found, wanted), start=_FIRST_LINE):
            if here == there:
                continue
            key, message = "", f"the table has {len(rows)} rows"
            if here is not None and there is not None:
                place = next(k for k, value in enumerate(here) if value != there[k])
                key = f"column {names[place]}"
                message = f"expected {quote(there[place])}, found {quote(here[place])}"
            raise InputError(message, folder / self.file, line, key, allowed)


@dataclass(frozen=True)
class ArrayTable(CsvFile[Block, Block], Generic[Block]):
    """A table of numbers: a frozen dataclass of described arrays (N,) and (N, k)."""

    block: type[Block]
    some: bool = field(default=True, kw_only=True)
    """Refuse a table without rows."""
    headings: Mapping[str, tuple[str, str]] = field(default_factory=dict, kw_only=True)
    """Names and units of columns in the file, where they are others."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """Those of all arrays, from left to right."""
        own = (column for _, columns in field_columns(self.block) for column in columns)
        named = ((one, self.headings.get(one.name, (one.name, one.unit))) for one in own)
        return tuple(replace(one, name=name, unit=unit) for one, (name, unit) in named)

    def write(self, folder: Path, content: Block) -> list[Path]:
        """Write the arrays."""
        parts = [
            np.asarray(getattr(content, name), dtype=np.float64).reshape(-1, len(columns))
            for name, columns in field_columns(self.block)
        ]
        return self.write_rows(folder, np.concatenate(parts, axis=1).tolist())

    def read(self, folder: Path) -> Block:
        """Read the arrays; every number is finite."""
        cells, numbers = self._read(folder, some=self.some)
        for name in self.names:
            infinite = ~np.isfinite(numbers[name])
            _refuse_cells(folder / self.file, cells, name, infinite, "finite number")
        parts: dict[str, Array] = {}
        for name, columns in field_columns(self.block):
            values = [numbers[column.name] for column in columns]
            parts[name] = values[0] if len(columns) == 1 else np.column_stack(values)
        return self.block(**parts)


@dataclass(frozen=True)
class MatrixTable(CsvFile[Matrix, Matrix]):
    """A table of matrices, one below the other, with the parameters' names as columns."""

    keys: tuple[Column, ...]
    """The columns on the left, texts."""
    entry: Column
    """Description of all further columns; its name is a placeholder, ``"<parameter>"``."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """The columns on the left; `entry` describes the others."""
        return self.keys

    def write(self, folder: Path, content: Matrix) -> list[Path]:
        """Write the matrices."""
        keys, names, matrix = content
        rows = [[*key, *row] for key, row in zip(keys, matrix.tolist(), strict=True)]
        return self.write_rows(folder, rows, names)

    def read(self, folder: Path) -> Matrix:
        """Read the matrices; every number is finite."""
        cells, numbers = self._read(folder)
        keys = tuple(zip(*(cells[name] for name in self.names), strict=True))
        names = tuple(name for name in cells if name not in self.names)
        for name in names:
            infinite = ~np.isfinite(numbers[name])
            _refuse_cells(folder / self.file, cells, name, infinite, "finite number")
        columns = [numbers[name] for name in names]
        return keys, names, np.column_stack(columns) if columns else np.empty((len(keys), 0))


def _as_numbers(cells: Sequence[str]) -> Array:
    """Return cells as numbers, NaN for those that are none."""
    try:
        return np.array(cells, dtype=np.float64)
    except ValueError:
        return np.array([_as_number(cell) for cell in cells])


def _as_number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return math.nan


def _refuse_cells(
    path: Path, cells: Cells, name: str, wrong: Mask, number: str, allowed: str | None = None
) -> None:
    """Refuse the first wrong cell of a column."""
    if np.any(wrong):
        row = int(np.argmax(wrong))
        message = f"{quote(cells[name][row])} is not a {number}"
        raise InputError(message, path, row + _FIRST_LINE, f"column {name}", allowed)


def write_csv(
    path: Path,
    names: Sequence[str],
    rows: Iterable[Sequence[object]],
    delimiter: str = ",",
    decimal: str = ".",
    header: Header | None = None,
) -> None:
    """Write a table with all digits of its numbers (`repr`), by default comma-separated.

    Cells without a value (None or NaN) are empty, and so are lines of a header other than that of
    the names.
    """
    header = header or Header()
    with atomic_write(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, delimiter=delimiter, lineterminator="\n")
        file.write("\n" * header.before)
        if header.names is None:
            writer.writerow(names)
        file.write("\n" * header.after)
        writer.writerows([_cell(value, decimal) for value in row] for row in rows)


def _cell(value: Any, decimal: str) -> Any:
    if value is None or value != value:  # noqa: PLR0124 - NaN
        return ""
    commas = decimal != "." and isinstance(value, float)
    return str(value).replace(".", decimal) if commas else value


def describe_tables(folder: Path, tables: Iterable[CsvFile[Any, Any]]) -> Path:
    """Add unit and meaning of the tables' columns to `columns.json`; return its path."""
    path = folder / COLUMNS_FILE
    known = dict(_known_columns(folder))
    formats = known.pop(_FORMATS, {})
    formats = dict(formats) if isinstance(formats, dict) else {}
    for table in tables:
        formats[table.file] = table.FORMAT
        columns = [*table.columns, *([table.entry] if isinstance(table, MatrixTable) else [])]
        known[table.file] = [
            {"name": c.name, "unit": c.unit, "meaning": c.meaning} for c in columns
        ]
    known.pop(FORMAT, None)
    write_json(path, {FORMAT: _COLUMNS_FORMAT, _FORMATS: formats, **known})
    return path


def tables_described(folder: Path) -> set[str]:
    """Return the paths of the tables in `columns.json`."""
    return set(_known_columns(folder)) - {FORMAT, _FORMATS}


def _known_columns(folder: Path) -> Mapping[str, Any]:
    """Return the content of `columns.json`, nothing where it is missing or unusable."""
    path = folder / COLUMNS_FILE
    if not path.is_file():
        return {}
    try:
        return read_mapping(path)
    except InputError:
        return {}
