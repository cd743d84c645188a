"""Tables of the manual: keys and columns of the files of a run folder, from the annotations.

``python -m expdesign.runfolder.documentation PAGE`` writes them between the markers of a page::

    <!-- design.json -->
    <!-- end -->

A file without markers is appended to the last section of the page. With ``--check`` nothing is
written; the exit status is 1 where the page is not up to date.
"""

from __future__ import annotations

import argparse
import importlib
import pkgutil
import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from constraints.plugins import plugin_modules
from expdesign.runfolder.fields import Column
from expdesign.runfolder.places import Place, Text
from expdesign.runfolder.store import JsonFile, members
from expdesign.runfolder.tables import CsvFile, MatrixTable

_BLOCK = re.compile(r"<!-- (?P<file>[^\s>]+\.(?:json|csv|yaml)) -->\n.*?<!-- end -->", re.DOTALL)
_FURTHER = "<!-- further files -->"
_PACKAGES = ("expdesign", "estimation")


def documented_page(page: str, results: Iterable[type[JsonFile]]) -> str:
    """Return a page of the manual with the tables of all files of the results.

    Parameters
    ----------
    page : str
        The page in Markdown, with markers.
    results : iterable of type
    """
    tables = dict(file_tables(results))
    named = {found["file"] for found in _BLOCK.finditer(page)}
    page = _BLOCK.sub(lambda found: _block(found["file"], tables.get(found["file"], "")), page)
    head, marker, _ = page.partition(_FURTHER)
    further = [
        f"### {file}\n\n{_block(file, text)}" for file, text in tables.items() if file not in named
    ]
    return "\n\n".join([f"{head}{marker}", *further]).rstrip("\n") + "\n" if marker else page


def _block(file: str, text: str) -> str:
    return f"<!-- {file} -->\n{text}<!-- end -->"


def file_tables(results: Iterable[type[JsonFile]]) -> Iterator[tuple[str, str]]:
    """Yield every file of the results with the table of its keys or columns, in Markdown."""
    for kind in results:
        keys = [each.column for each in members(kind) if each.column is not None]
        form = Column("format", "1", "number of the format, see [formats](#formats)")
        yield kind.FILE, markdown_table("key", [form, *keys])
        for table in result_tables(kind):
            further = [table.entry] if isinstance(table, MatrixTable) else []
            yield table.file, markdown_table("column", [*table.columns, *further])


def result_tables(kind: type[JsonFile]) -> tuple[CsvFile[Any, Any], ...]:
    """Return the CSV files of a result as they are declared."""
    return tuple(
        table
        for member in members(kind)
        if isinstance(member.place, Place) and not isinstance(member.place, Text)
        for table in member.place.tables(member.kind, kind.WRITTEN_BY)
    )


def markdown_table(head: str, columns: Iterable[Column]) -> str:
    """Return keys or columns as a table; equal columns of six struts are one row.

    >>> print(markdown_table("key", [Column("omega", "rad/s", "base frequency")]), end="")
    | key | unit | meaning |
    |---|---|---|
    | `omega` | rad/s | base frequency |
    """
    rows = [
        f"| {names} | {unit} | {meaning.replace('|', '&#124;')} |\n"
        for names, unit, meaning in _grouped(columns)
    ]
    return f"| {head} | unit | meaning |\n|---|---|---|\n{''.join(rows)}"


def _grouped(columns: Iterable[Column]) -> Iterator[tuple[str, str, str]]:
    """Yield names, unit and meaning; the first and last strut stand for six columns."""
    columns = list(columns)
    while columns:
        first, last = columns[0], columns[min(5, len(columns) - 1)]
        one, six = (re.sub(r"\d+ *$", "", each.meaning) for each in (first, last))
        if one == six != first.meaning and last.meaning.endswith("6"):
            yield f"`{first.name}` … `{last.name}`", first.unit, f"{one.rstrip()} 1 … 6"
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
    plugin_modules()
    found = {kind.FILE: kind for kind in _subclasses(JsonFile) if "FILE" in vars(kind)}
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
