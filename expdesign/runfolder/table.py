"""CSV files of a run folder: their columns, how they are written and read, each in one place."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import MISSING, dataclass, field, fields, replace
from itertools import zip_longest
from pathlib import Path
from typing import Any, Generic, Self, TypeVar

import numpy as np
import pandas as pd
from pydantic import ValidationError

from constraints.arrays import Array
from expdesign.configuration import InputError, shown
from expdesign.configuration.wrong_value import wrong_value
from expdesign.runfolder.atomic import write_csv, write_json
from expdesign.runfolder.described import Column, checker, field_columns
from expdesign.runfolder.json_file import (
    FORMAT,
    MissingFileError,
    known_format,
    read_mapping,
)

COLUMNS_FILE = "columns.json"
"""Unit and meaning of every column of every table of a folder, and the tables' formats."""

_COLUMNS_FORMAT = 1
_FORMATS = "formats"
_FIRST_LINE = 2
"""The first row of a table stands in the file's second line."""

Row = TypeVar("Row")
Block = TypeVar("Block")
Written = TypeVar("Written")
Found = TypeVar("Found")
Matrices = Iterable[tuple[Sequence[Sequence[str]], Sequence[str], Array]]


@dataclass(frozen=True)
class Table(Generic[Written, Found]):
    """A CSV file: its place, its columns and its format."""

    file: str
    """Path in the run folder."""
    written_by: str
    """What writes it, for the message that it is missing."""
    format: int = field(default=1, kw_only=True)
    """Number of the format, one more whenever a reader of the number before would go wrong."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """The columns in their order."""
        raise NotImplementedError

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the columns."""
        return tuple(column.name for column in self.columns)

    @property
    def required(self) -> tuple[str, ...]:
        """Columns that it always has."""
        return self.names

    def write(self, folder: Path, content: Written) -> list[Path]:
        """Write the table into a run folder; return its path and that of `columns.json`."""
        raise NotImplementedError

    def read(self, folder: Path) -> Found:
        """Read the table of a run folder.

        Raises
        ------
        InputError
            As `read_frame`, or a cell is not of its kind: with line and column.
        """
        raise NotImplementedError

    def numbered(self, number: int | None) -> Self:
        """Return the table of one of several: ``tables/motion_2.csv``; None: there is just one."""
        if number is None:
            return self
        stem, ending = self.file.rsplit(".", 1)
        return replace(self, file=f"{stem}_{number}.{ending}")

    def is_in(self, folder: Path) -> bool:
        """Tell whether a folder has the file."""
        return (folder / self.file).is_file()

    def write_frame(self, folder: Path, frame: pd.DataFrame) -> list[Path]:
        """Write the file and tell of its columns in `columns.json`; return both paths."""
        path = folder / self.file
        write_csv(path, frame)
        return [path, describe_tables(folder, [self])]

    def read_frame(self, folder: Path) -> pd.DataFrame:
        """Read the file, every cell as text; columns that are not known stay.

        Raises
        ------
        MissingFileError
            There is none.
        InputError
            It is no table, of a newer format, or columns are missing.
        """
        path = folder / self.file
        if not path.is_file():
            raise MissingFileError(path, self.written_by)
        formats = _known_columns(folder).get(_FORMATS)
        if isinstance(formats, dict):
            known_format(path, formats.get(self.file, 0), self.format)
        try:
            frame = pd.read_csv(path, dtype=str, keep_default_na=False, encoding="utf-8")
        except (OSError, ValueError) as error:
            raise InputError(f"not a table that can be read: {error}", path) from error
        missing = [name for name in self.required if name not in frame.columns]
        if missing:
            raise InputError(f"columns are missing: {', '.join(missing)}", path)
        return frame

    def refuse_empty(self, folder: Path, frame: pd.DataFrame) -> None:
        """Refuse a table without rows."""
        if frame.empty:
            raise InputError("the table has no rows", folder / self.file, allowed="at least one")


@dataclass(frozen=True)
class RowTable(Table[Iterable[Row], tuple[Row, ...]], Generic[Row]):
    """A table with a frozen dataclass for every row, whose fields are `described`.

    Cells may be empty where the field is `OpenNumber` or `MAY_BE_EMPTY`; where there are always
    `some` rows, a table without any is refused. A column that tables of earlier versions lack is a
    field with a default.
    """

    row: type[Row]
    some: bool = field(default=False, kw_only=True)
    rows_of: tuple[str, ...] = field(default=(), kw_only=True)
    """The fields that tell what a row is of, which `refuse_other_rows` looks at."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """One for every field of the row."""
        return tuple(column for _, columns in field_columns(self.row) for column in columns)

    @property
    def required(self) -> tuple[str, ...]:
        """Those of fields without a default."""
        later = {each.name for each in fields(self.row) if each.default is not MISSING}  # type: ignore[arg-type]
        return tuple(
            c.name for name, found in field_columns(self.row) for c in found if name not in later
        )

    def write(self, folder: Path, content: Iterable[Row]) -> list[Path]:
        """Write the rows."""
        attributes = [name for name, _ in field_columns(self.row)]
        cells = [[getattr(row, name) for name in attributes] for row in content]
        return self.write_frame(folder, pd.DataFrame(cells, columns=list(self.names), dtype=object))

    def read(self, folder: Path) -> tuple[Row, ...]:
        """Read the rows."""
        frame = self.read_frame(folder)
        if self.some:
            self.refuse_empty(folder, frame)
        described = [(name, column.name) for name, (column,) in field_columns(self.row)]
        attributes, names = zip(*(d for d in described if d[1] in frame.columns), strict=True)
        cells = [
            dict(zip(attributes, row, strict=True))
            for row in frame[list(names)].itertuples(index=False, name=None)
        ]
        try:
            return checker(tuple[self.row, ...]).validate_python(cells)  # type: ignore[name-defined]
        except ValidationError as error:
            details = error.errors(include_url=False)[0]
            number, *place = details["loc"]
            column = names[attributes.index(str(place[0]))] if place else ""
            message, allowed = wrong_value(details)
            line = int(number) + _FIRST_LINE
            raise InputError(
                message, folder / self.file, line, f"column {column}", allowed
            ) from error

    def refuse_other_rows(
        self, folder: Path, rows: Sequence[Row], wanted: Sequence[tuple[object, ...]], told_by: str
    ) -> None:
        """Refuse rows of something else than a file beside the table says, at the first of them.

        Parameters
        ----------
        folder : Path
            The run folder that they were read from.
        rows : sequence
        wanted : sequence of tuple
            The values of `rows_of`, row by row.
        told_by : str
            The file that says so.

        Raises
        ------
        InputError
            There are others, more or fewer, or they have another order: with line and column.
        """
        names = [c.name for name, (c,) in field_columns(self.row) if name in self.rows_of]
        found = [tuple(getattr(row, name) for name in self.rows_of) for row in rows]
        allowed = f"{len(wanted)} rows, as {told_by} has {', '.join(names)}, in the same order"
        for line, (here, there) in enumerate(zip_longest(found, wanted), start=_FIRST_LINE):
            if here == there:
                continue
            key = ""
            if here is None:
                message = f"the table ends after {len(rows)} rows"
            elif there is None:
                message = f"the table goes on, to {len(rows)} rows"
            else:
                place = next(k for k, value in enumerate(here) if value != there[k])
                key = f"column {names[place]}"
                message = f"{shown(here[place])} stands in the place of {shown(there[place])}"
            raise InputError(message, folder / self.file, line, key, allowed)


@dataclass(frozen=True)
class ArrayTable(Table[Block, Block], Generic[Block]):
    """A table of numbers alone: a frozen dataclass of arrays (N,) and (N, k), `described`.

    Where there are always `some` rows, a table without any is refused.
    """

    block: type[Block]
    some: bool = field(default=True, kw_only=True)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Those of all arrays, side by side."""
        return tuple(column for _, columns in field_columns(self.block) for column in columns)

    def write(self, folder: Path, content: Block) -> list[Path]:
        """Write the arrays."""
        parts = [
            np.asarray(getattr(content, name), dtype=np.float64).reshape(-1, len(columns))
            for name, columns in field_columns(self.block)
        ]
        frame = pd.DataFrame(np.concatenate(parts, axis=1), columns=list(self.names))
        return self.write_frame(folder, frame)

    def read(self, folder: Path) -> Block:
        """Read the arrays; every number is finite."""
        frame = self.read_frame(folder)
        if self.some:
            self.refuse_empty(folder, frame)
        parts: dict[str, Array] = {}
        for name, columns in field_columns(self.block):
            values = [_numbers(folder / self.file, frame, column.name) for column in columns]
            parts[name] = values[0] if len(columns) == 1 else np.column_stack(values)
        return self.block(**parts)


@dataclass(frozen=True)
class MatrixTable(Table[Matrices, tuple[tuple[tuple[str, ...], ...], tuple[str, ...], Array]]):
    """A table with further columns whose names are data: one for every parameter."""

    keys: tuple[Column, ...]
    """The columns in front, texts."""
    entry: Column
    """What all the further columns hold; its name stands for theirs, ``"<parameter>"``."""

    @property
    def columns(self) -> tuple[Column, ...]:
        """The columns in front; `entry` tells of the others."""
        return self.keys

    def write(self, folder: Path, content: Matrices) -> list[Path]:
        """Write matrices below each other.

        Each is the cells of the columns in front, row by row; the names of the further columns;
        and their numbers.
        """
        frames = []
        for keys, names, matrix in content:
            front = pd.DataFrame(list(keys), columns=list(self.names))
            frames.append(pd.concat([front, pd.DataFrame(matrix, columns=list(names))], axis=1))
        return self.write_frame(folder, pd.concat(frames, ignore_index=True))

    def read(self, folder: Path) -> tuple[tuple[tuple[str, ...], ...], tuple[str, ...], Array]:
        """Return the cells in front row by row, the names of the further columns, the numbers."""
        frame = self.read_frame(folder)
        keys = tuple(frame[list(self.names)].itertuples(index=False, name=None))
        names = tuple(str(name) for name in frame.columns if name not in self.names)
        columns = [_numbers(folder / self.file, frame, name) for name in names]
        return keys, names, np.column_stack(columns) if columns else np.empty((len(keys), 0))


def describe_tables(folder: Path, tables: Iterable[Table[Any, Any]]) -> Path:
    """Tell unit and meaning of the tables' columns in `columns.json`, beside what stands there."""
    path = folder / COLUMNS_FILE
    known = _known_columns(folder)
    formats = known.pop(_FORMATS, {})
    formats = dict(formats) if isinstance(formats, dict) else {}
    for table in tables:
        formats[table.file] = table.format
        columns = [*table.columns, *([table.entry] if isinstance(table, MatrixTable) else [])]
        known[table.file] = [
            {"name": c.name, "unit": c.unit, "meaning": c.meaning} for c in columns
        ]
    known.pop(FORMAT, None)
    write_json(path, {FORMAT: _COLUMNS_FORMAT, _FORMATS: formats, **known})
    return path


def described_tables(folder: Path) -> set[str]:
    """Return the tables that `columns.json` describes, as it names them."""
    return set(_known_columns(folder)) - {FORMAT, _FORMATS}


def _known_columns(folder: Path) -> dict[str, Any]:
    """Return what `columns.json` says, nothing when there is none or it cannot be used."""
    path = folder / COLUMNS_FILE
    if not path.is_file():
        return {}
    try:
        return read_mapping(path)
    except InputError:
        return {}


def _numbers(path: Path, frame: pd.DataFrame, name: str) -> Array:
    cells = frame[name]
    values = pd.to_numeric(cells, errors="coerce").to_numpy(dtype=np.float64)
    wrong = np.flatnonzero(~np.isfinite(values))
    if wrong.size:
        row = int(wrong[0])
        message = f"{shown(cells.iloc[row])} is no finite number"
        raise InputError(message, path, row + _FIRST_LINE, f"column {name}")
    return values
