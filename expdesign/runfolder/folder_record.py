"""Records: what a stage leaves in its run folder, written and read as a whole."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, ClassVar, Self, get_type_hints

from expdesign.runfolder.json_file import JsonFile
from expdesign.runfolder.table import RowTable, Table

Contents = Iterator[tuple[Table[Any, Any], Any]]
RowKeys = Mapping[str, Iterable[tuple[object, ...]]]


class FolderRecord:
    """Base of the frozen dataclasses that stand in several files of a run folder.

    A field whose type is a `JsonFile` is that file. What stands in tables is named in `TABLES`,
    in the order in which they are written. Files that contradict each other are refused when they
    are read, so that who takes a record can rely on `row_keys`.

    Attributes
    ----------
    TABLES : dict of Table
        By attribute. A property is written, and not read: it follows from the fields.
    """

    TABLES: ClassVar[Mapping[str, Table[Any, Any]]] = {}

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read it from a run folder; nothing is computed.

        Raises
        ------
        InputError
            A file is missing (`MissingFileError`), does not hold what it should, or contradicts
            another one.
        """
        return cls(**cls.fields_in(folder))

    @classmethod
    def fields_in(cls, folder: Path, number: int | None = None) -> dict[str, Any]:
        """Read the fields that are files; `number` as in `Table.numbered`."""
        names = {field.name for field in fields(cls)}  # type: ignore[arg-type]
        found: dict[str, Any] = {name: file.read(folder) for name, file in cls.files().items()}
        for name, table in cls.TABLES.items():
            if name in names:
                found[name] = table.numbered(number).read(folder)
        told_by = ", ".join(file.FILE for file in cls.files().values())
        for name, keys in cls.row_keys(found).items():
            table = cls.TABLES[name].numbered(number)
            if not isinstance(table, RowTable):
                raise TypeError(f"{table.file}: only rows with fields are counted by names")
            table.refuse_other_rows(folder, found[name], tuple(keys), told_by)
        return found

    @classmethod
    def row_keys(cls, found: Mapping[str, Any]) -> RowKeys:
        """Return what the rows of its tables are of, as its JSON files tell it.

        Parameters
        ----------
        found : dict
            The fields that were read.

        Returns
        -------
        dict
            By attribute of a `RowTable`: the values of its `rows_of`, row by row.
        """
        del found
        return {}

    def contents(self) -> Contents:
        """Yield every table with what is written into it."""
        for name, table in self.TABLES.items():
            yield table, getattr(self, name)

    def write(self, folder: Path) -> list[Path]:
        """Write the files into a run folder; return them."""
        written = [path for table, rows in self.contents() for path in table.write(folder, rows)]
        written += [getattr(self, name).write(folder) for name in self.files()]
        return list(dict.fromkeys(written))

    @classmethod
    def files(cls) -> dict[str, type[JsonFile]]:
        """Return the fields that are JSON files, with their types."""
        return {
            name: kind
            for name, kind in get_type_hints(cls).items()
            if isinstance(kind, type) and issubclass(kind, JsonFile)
        }
