"""Places of a result's fields outside its JSON file: tables, matrices, texts, the run file."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import numpy as np

from expdesign.configuration import InputError, RunConfiguration, load_run, resolved_yaml
from expdesign.runfolder.fields import Column
from expdesign.runfolder.files import RUN_FILE, MissingFileError, write_text
from expdesign.runfolder.tables import ArrayTable, CsvFile, MatrixTable, RowTable


class Place:
    """Base of the annotations that name the files of a field.

    `result` is the result with at least the fields that are declared before, `kind` the type of the
    field without annotations.
    """

    def read(self, result: Any, kind: Any, folder: Path) -> Any:
        """Return the value of the field."""
        raise NotImplementedError

    def write(self, result: Any, kind: Any, value: Any, folder: Path) -> Iterator[Path]:
        """Write the value of the field; yield the files."""
        raise NotImplementedError

    def tables(self, kind: Any, written_by: str) -> Iterator[CsvFile[Any, Any]]:
        """Yield the tables as declared, for the documentation."""
        del kind, written_by
        yield from ()


@dataclass(frozen=True)
class Table(Place):
    """A field in a CSV file.

    The type of the field decides on the table: ``tuple[Row, ...]``, rows of a frozen dataclass of
    described fields (`RowTable`); a frozen dataclass of described arrays (`ArrayTable`). With
    `numbered` the field is a tuple of these, one table each, or a dict by position from 1 where
    some have no file. With `by` a property is a mapping of rows, all in one table.
    """

    file: str
    _: KW_ONLY
    rows_of: tuple[str, ...] = ()
    """Fields that identify a row."""
    as_in: tuple[str, ...] = ()
    """Keys or attributes whose combinations are `rows_of` row by row: other rows are refused."""
    some: bool | None = None
    """Refuse a table without rows; default: in a table of arrays."""
    optional: bool = False
    """Write no file for an empty value or None, and read a missing file as such."""
    numbered: str = ""
    """Attribute with the numbers in the names of the files; None for a single one."""
    by: Column | None = None
    """Column with the keys of the mapping."""
    form: Callable[[Any], CsvFile[Any, Any]] | None = None
    """Function that returns the table of a result whose columns depend on its fields."""

    def read(self, result: Any, kind: Any, folder: Path) -> Any:
        """Read the table or tables."""
        table = self.table(kind, result.WRITTEN_BY, result)
        if not self.numbered:
            if self.optional and not table.is_in(folder):
                return () if get_origin(kind) is tuple else None
            return table.read(folder)
        tables = [table.numbered(number) for number in getattr(result, self.numbered)]
        if get_origin(kind) is dict:
            found = enumerate(tables, start=1)
            return {place: one.read(folder) for place, one in found if one.is_in(folder)}
        return tuple(one.read(folder) for one in tables)

    def write(self, result: Any, kind: Any, value: Any, folder: Path) -> Iterator[Path]:
        """Write the table or tables."""
        table = self.table(kind, result.WRITTEN_BY, result)
        if not self.numbered:
            if not (self.optional and _is_empty(value)):
                yield from table.write(folder, value)
            return
        numbers = tuple(getattr(result, self.numbered))
        parts = value if isinstance(value, Mapping) else dict(enumerate(value, start=1))
        for place, part in parts.items():
            yield from table.numbered(numbers[place - 1]).write(folder, part)

    def tables(self, kind: Any, written_by: str) -> Iterator[CsvFile[Any, Any]]:
        """Yield the table."""
        yield self.table(kind, written_by)

    def table(self, kind: Any, written_by: str, result: Any = None) -> CsvFile[Any, Any]:
        """Return the table of a type of field; that of the result where it has a `form`."""
        if self.form is not None and result is not None:
            return self.form(result)
        if self.numbered or self.by:
            kind = _entry(kind)
        kind = _without_none(kind)
        if isinstance(kind, type) and dataclasses.is_dataclass(kind):
            return ArrayTable(self.file, written_by, kind, some=self.some is not False)
        row, some = _entry(kind), bool(self.some)
        return RowTable(self.file, written_by, row, some=some, rows_of=self.rows_of, by=self.by)

    def refuse_other_rows(
        self, result: Any, keys: object, kind: Any, rows: Sequence[Any] | None, folder: Path
    ) -> None:
        """Refuse rows that do not follow `as_in`; `rows` None: read them, they are derived."""
        table = self.table(kind, result.WRITTEN_BY, result)
        if not isinstance(table, RowTable):
            raise TypeError(f"{table.file}: only rows can be compared with keys")
        sources = [getattr(keys if hasattr(keys, name) else result, name) for name in self.as_in]
        wanted = [each[0] if isinstance(each[0], tuple) else each for each in product(*sources)]
        found = table.read(folder) if rows is None else rows
        table.refuse_other_rows(folder, found, wanted, result.FILE)


def _is_empty(value: Any) -> bool:
    return value is None or (isinstance(value, Sequence | Mapping) and not value)


def _without_none(kind: Any) -> Any:
    parts = [part for part in get_args(kind) if part is not type(None)]
    return parts[0] if type(None) in get_args(kind) and len(parts) == 1 else kind


def _entry(kind: Any) -> Any:
    """Return the type of an entry of a tuple or list, or of a value of a dict."""
    arguments = get_args(kind)
    return arguments[1] if get_origin(kind) is dict else arguments[0]


@dataclass(frozen=True)
class Numbered(Place):
    """A tuple of frozen dataclasses whose fields are tables, all numbered alike."""

    numbers: str
    """Attribute with the numbers, as in `Table.numbered`."""

    def read(self, result: Any, kind: Any, folder: Path) -> Any:
        """Read the tables of every entry."""
        part, tables = _entry(kind), self._tables(kind, result.WRITTEN_BY)
        return tuple(
            part(**{name: table.numbered(n).read(folder) for name, table in tables.items()})
            for n in getattr(result, self.numbers)
        )

    def write(self, result: Any, kind: Any, value: Any, folder: Path) -> Iterator[Path]:
        """Write the tables of every entry."""
        tables = self._tables(kind, result.WRITTEN_BY)
        for number, part in zip(getattr(result, self.numbers), value, strict=True):
            for name, table in tables.items():
                yield from table.numbered(number).write(folder, getattr(part, name))

    def tables(self, kind: Any, written_by: str) -> Iterator[CsvFile[Any, Any]]:
        """Yield the tables of an entry."""
        yield from self._tables(kind, written_by).values()

    @staticmethod
    def _tables(kind: Any, written_by: str) -> dict[str, CsvFile[Any, Any]]:
        hints = get_type_hints(_entry(kind), include_extras=True)
        return {
            name: mark.table(get_args(hint)[0], written_by)
            for name, hint in hints.items()
            for mark in getattr(hint, "__metadata__", ())
            if isinstance(mark, Table)
        }


@dataclass(frozen=True)
class Matrix(Place):
    """A matrix over parameters, or a dict of such matrices, in a CSV file."""

    file: str
    unit: str
    meaning: str
    _: KW_ONLY
    names: str
    """Attribute with the names of rows and columns."""
    row: str = "name of the row"
    """Meaning of the column with the rows' names."""
    by: Column | None = None
    """Column with the keys of a dict."""

    def read(self, result: Any, kind: Any, folder: Path) -> Any:
        """Read the matrix or matrices."""
        (table,) = self.tables(kind, result.WRITTEN_BY)
        keys, columns, matrix = table.read(folder)
        names, blocks = tuple(getattr(result, self.names)), dict.fromkeys(key[:-1] for key in keys)
        if [key[-1] for key in keys] != list(names) * len(blocks) or columns != names:
            message = f"rows and columns are not the parameters of {result.FILE}"
            raise InputError(message, folder / table.file)
        if self.by is None:
            return matrix
        parts = matrix.reshape(len(blocks), len(names), len(names))
        return {key: part for (key,), part in zip(blocks, parts, strict=True)}

    def write(self, result: Any, kind: Any, value: Any, folder: Path) -> Iterator[Path]:
        """Write the matrix, or the matrices one below the other."""
        (table,), names = self.tables(kind, result.WRITTEN_BY), tuple(getattr(result, self.names))
        blocks = {(): value} if self.by is None else {(key,): part for key, part in value.items()}
        keys = tuple((*key, name) for key in blocks for name in names)
        yield from table.write(folder, (keys, names, np.concatenate([*blocks.values()])))

    def tables(self, kind: Any, written_by: str) -> Iterator[CsvFile[Any, Any]]:
        """Yield the table."""
        del kind
        keys = (*((self.by,) if self.by else ()), Column("parameter", "", self.row))
        entry = Column("<parameter>", self.unit, self.meaning)
        yield MatrixTable(self.file, written_by, keys, entry)


@dataclass(frozen=True)
class Text(Place):
    """A text in a file; None without the file."""

    file: str
    meaning: str

    def read(self, result: Any, kind: Any, folder: Path) -> str | None:
        """Read the text."""
        del result, kind
        path = folder / self.file
        return path.read_text(encoding="utf-8") if path.is_file() else None

    def write(self, result: Any, kind: Any, value: Any, folder: Path) -> Iterator[Path]:
        """Write the text."""
        del result, kind
        if value is not None:
            write_text(folder / self.file, value)
            yield folder / self.file


class _RunYaml(Place):
    """The resolved configuration in `run.yaml`."""

    def read(self, result: Any, kind: Any, folder: Path) -> RunConfiguration:
        """Read the configuration."""
        del kind
        if not (folder / RUN_FILE).is_file():
            raise MissingFileError(folder / RUN_FILE, result.WRITTEN_BY)
        return load_run(folder / RUN_FILE)

    def write(self, result: Any, kind: Any, value: Any, folder: Path) -> Iterator[Path]:
        """Write the configuration."""
        del result, kind
        write_text(folder / RUN_FILE, resolved_yaml(value))
        yield folder / RUN_FILE


StoredConfiguration = Annotated[RunConfiguration, _RunYaml()]
"""Configuration of a result, in `run.yaml`."""
