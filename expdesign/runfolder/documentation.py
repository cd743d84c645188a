"""Tables of the manual: keys and columns of the files of a run folder, from the annotations.

``python -m expdesign.runfolder.documentation PAGE`` writes them between the markers of a page::

    <!-- design.json -->
    <!-- end -->

Files without markers are written between ``<!-- further files -->`` and ``<!-- end of further files
-->``. With ``--check`` nothing is written; the exit status is 1 where the page is outdated.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib
import inspect
import pkgutil
import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, get_args, get_type_hints

from pydantic.fields import FieldInfo

from constraints.plugins import plugin_modules
from expdesign.runfolder.fields import Column
from expdesign.runfolder.places import Text
from expdesign.runfolder.store import JsonFile, members
from expdesign.runfolder.tables import ArrayTable, CsvFile, MatrixTable, RowTable

_PACKAGES = ("expdesign", "estimation")
_BLOCK = re.compile(r"<!-- (?P<file>\S+\.\w+) -->\n.*?<!-- end -->", re.DOTALL)
_FURTHER = re.compile(r"<!-- further files -->\n.*?<!-- end of further files -->", re.DOTALL)


def documented_page(page: str, results: Iterable[type[JsonFile]]) -> str:
    """Return a page in Markdown, with markers, with the tables of all files of the results."""
    tables = dict(file_tables(results))
    named = {found["file"] for found in _BLOCK.finditer(page)}
    further = "".join(f"### {file}\n\n{tables[file]}\n" for file in tables if file not in named)
    page = _BLOCK.sub(
        lambda found: f"<!-- {found['file']} -->\n{tables[found['file']]}<!-- end -->", page
    )
    return _FURTHER.sub(
        lambda _: f"<!-- further files -->\n{further}<!-- end of further files -->", page
    )


def file_tables(results: Iterable[type[JsonFile]]) -> Iterator[tuple[str, str]]:
    """Yield every file of the results with the table of its keys or columns, in Markdown."""
    for kind in results:
        form = Column("format", "1", "number of the format")
        yield kind.FILE, markdown_table("key", [form, *_keys(kind)])
        for table in result_tables(kind):
            further = [table.entry] if isinstance(table, MatrixTable) else []
            columns = markdown_table("column", [*table.columns, *further])
            yield table.file, f"{_content(table)}{columns}"


def result_tables(kind: type[JsonFile]) -> tuple[CsvFile[Any, Any], ...]:
    """Return the CSV files of a result as they are declared."""
    return tuple(
        table
        for member in members(kind)
        if member.place is not None and not isinstance(member.place, Text)
        for table in member.place.tables(member.kind, kind.WRITTEN_BY)
    )


def _content(table: CsvFile[Any, Any]) -> str:
    kind = getattr(table, "row", None) or getattr(table, "block", None)
    if not isinstance(table, RowTable | ArrayTable) or kind is None:
        return ""
    first = inspect.cleandoc(kind.__doc__ or "").partition("\n\n")[0]
    rows = "One row each. " if isinstance(table, RowTable) else ""
    return f"{rows}{' '.join(first.split())}\n\n"


def _keys(kind: type[JsonFile]) -> Iterator[Column]:
    """Yield the keys of a file, each with those of the dataclasses in its value."""
    for member in members(kind):
        if member.column is None:
            continue
        yield member.column
        for name, column in _inner_keys(member.kind):
            yield dataclasses.replace(column, name=f"{member.column.name}{name}")


def _inner_keys(kind: Any) -> Iterator[tuple[str, Column]]:
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        hints = get_type_hints(kind, include_extras=True)
        for field in dataclasses.fields(kind):
            marks = getattr(hints[field.name], "__metadata__", ())
            column = next((mark for mark in marks if isinstance(mark, Column)), None)
            alias = next((mark.alias for mark in marks if isinstance(mark, FieldInfo)), None)
            if column is not None:
                yield f".{alias or field.name}", column
        return
    for each in get_args(kind):
        several = "[]" if getattr(kind, "__origin__", None) is tuple else ""
        several = ".*" if getattr(kind, "__origin__", None) is dict else several
        yield from ((f"{several}{name}", column) for name, column in _inner_keys(each))


def markdown_table(head: str, columns: Iterable[Column]) -> str:
    """Return keys or columns as a table; equal columns of six struts are one row.

    >>> print(markdown_table("key", [Column("omega", "rad/s", "base frequency")]), end="")
    | key | unit | meaning |
    |---|---|---|
    | `omega` | rad/s | base frequency |
    """
    rows = [
        f"| {names} | {unit} | {meaning.replace('|', '&#124;')} |\n"
        for names, unit, meaning in _grouped(list(columns))
    ]
    return f"| {head} | unit | meaning |\n|---|---|---|\n{''.join(rows)}"


def _grouped(columns: list[Column]) -> Iterator[tuple[str, str, str]]:
    """Yield names, unit and meaning; one row for the columns of six struts."""
    while columns:
        first, last = columns[0], columns[min(5, len(columns) - 1)]
        if first.meaning.endswith("strut 1") and last.meaning == f"{first.meaning[:-1]}6":
            yield f"`{first.name}` … `{last.name}`", first.unit, f"{first.meaning} … 6"
            del columns[:6]
        else:
            yield f"`{first.name}`", first.unit, first.meaning
            del columns[0]


def all_results() -> list[type[JsonFile]]:
    """Return the classes of all JSON files, those of plug-ins too, in the order of their files."""
    for name in _PACKAGES:
        package = importlib.import_module(name)
        for module in pkgutil.walk_packages(package.__path__, f"{name}."):
            if not module.name.endswith("__main__"):
                importlib.import_module(module.name)
    plugins = {module.__name__ for module in plugin_modules().values()}
    found = {
        kind.FILE: kind
        for kind in _subclasses(JsonFile)
        if "FILE" in vars(kind)
        and not kind.WRITTEN_BY_HAND
        and (kind.__module__.partition(".")[0] in _PACKAGES or kind.__module__ in plugins)
    }
    return [found[file] for file in sorted(found)]


def _subclasses(kind: type[Any]) -> Iterator[type[Any]]:
    for each in kind.__subclasses__():
        yield each
        yield from _subclasses(each)


def main(arguments: list[str] | None = None) -> int:
    """Write the tables into a page, or check that they are up to date."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("page", type=Path)
    parser.add_argument("--check", action="store_true")
    options = parser.parse_args(arguments)
    page = options.page.read_text(encoding="utf-8")
    wanted = documented_page(page, all_results())
    if options.check:
        return int(page != wanted)
    options.page.write_text(wanted, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
