"""Delimited text: CSV and TSV, block by block, quickly; cell by cell where all is not well."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.data.columns import Column, header_column, pick
from estimation.data.formats import FileFormat
from estimation.data.table import HEADER_LINE, MOST_PROBLEMS, RawTable, refuse, refuse_long
from estimation.data.text_lines import line_blocks
from expdesign.configuration import DataSection, InputError, Problem

_QUOTE = '"'
_OF_NUMBERS = frozenset("0123456789+-.eE \t")
"""Of these marks Python and this reader make the same numbers."""

_MOST_TEXTS = 100_000
"""Cells that are no numbers and of which it is kept what stands there."""

_OTHER_DELIMITERS = {";": "';'", "\t": "'\\t'", ",": "','", "|": "'|'"}


def read(path: Path, section: DataSection) -> RawTable:
    """Read a text file whose first line names the columns.

    Raises
    ------
    InputError
        It is no text, columns are missing, or lines have more or fewer columns than the header.
        Cells that are no numbers become NaN, their text is in the table.
    """
    blocks = line_blocks(path)
    header, *first = next(blocks, [""])
    if not header.strip():
        message = "the first line names no columns" if first else "the file is empty"
        raise InputError(message, path, HEADER_LINE)
    delimiter = _delimiter(path, section, header)
    names = next(csv.reader([header], delimiter=delimiter))
    columns = [header_column(name, position) for position, name in enumerate(names)]
    try:
        picked = pick(columns, section.columns, path, HEADER_LINE)
    except InputError as error:
        raise _with_delimiter_hint(error, path, header, delimiter) from None
    positions = {channel: columns.index(column) for channel, column in picked.items()}
    form = _Form(positions, len(names), delimiter, section.decimal)
    return _gathered(path, picked, form, _whole_rows(chain([first], blocks)))


@dataclass(frozen=True)
class _Form:
    """How the rows of a file are written: which of its columns are which channels."""

    positions: Mapping[str, int]
    width: int
    """Number of columns."""
    delimiter: str
    decimal: str


def _whole_rows(blocks: Iterator[list[str]]) -> Iterator[list[str]]:
    """Put the next block to one that may end within a quoted cell.

    One is enough: a block is longer than any cell.
    """
    for lines in blocks:
        if sum(line.count(_QUOTE) for line in lines) % 2:
            yield lines + next(blocks, [])
        else:
            yield lines


def _gathered(
    path: Path, picked: dict[str, Column], form: _Form, blocks: Iterator[list[str]]
) -> RawTable:
    """Return the table of all rows; refuse it when lines have other columns than the header."""
    parts: dict[str, list[Array]] = {channel: [] for channel in picked}
    numbers: list[NDArray[np.int64]] = []
    texts: dict[tuple[str, int], str] = {}
    ragged, count = list[Problem](), 0
    line, rows, follow = HEADER_LINE + 1, 0, True
    for lines in blocks:
        values = _fast(lines, form)
        begins = np.arange(line, line + len(lines))
        if values is None:
            values, begins, wrong = _slow(lines, form, line, rows, texts)
            follow = follow and len(begins) == len(lines)
            count += len(wrong)
            ragged += [Problem(text, path, n) for n, text in wrong[:MOST_PROBLEMS]]
        for channel, column in values.items():
            parts[channel].append(column)
        numbers.append(begins)
        line, rows = line + len(lines), rows + len(begins)
        refuse_long(rows, path)
    refuse(ragged, path, "lines are like that", count)
    return RawTable(
        path,
        {channel: np.concatenate([np.empty(0), *found]) for channel, found in parts.items()},
        picked,
        "line",
        HEADER_LINE + 1,
        None if follow else np.concatenate(numbers),
        texts,
    )


def _delimiter(path: Path, section: DataSection, header: str) -> str:
    """Return the delimiter: that of the section, for .tsv a tab when the section has the default.

    Resolved run files state the default too, so it does not count that it was stated.
    """
    if path.suffix.lower() == ".tsv" and section.delimiter == "," and "\t" in header:
        return "\t"
    return section.delimiter


def _with_delimiter_hint(error: InputError, path: Path, header: str, delimiter: str) -> InputError:
    if delimiter in header:
        return error
    other = next((shown for mark, shown in _OTHER_DELIMITERS.items() if mark in header), None)
    if other is None:
        return error
    return InputError(
        f"the header has no delimiter '{delimiter}'",
        path,
        HEADER_LINE,
        allowed=f"data.delimiter: the one of the file, perhaps {other}",
    )


def _fast(lines: Sequence[str], form: _Form) -> dict[str, Array] | None:
    """Return the columns when every cell is a number, else None."""
    channels = list(form.positions)
    if not lines:
        return {channel: np.empty(0) for channel in channels}
    if any(_QUOTE in line or line.count(form.delimiter) != form.width - 1 for line in lines):
        return None
    if form.decimal != ".":
        text = "\n".join(lines)
        if "." in text:
            return None  # it would pass for a decimal point
        lines = text.replace(form.decimal, ".").split("\n")
    try:
        table = np.loadtxt(
            lines,
            delimiter=form.delimiter,
            usecols=[form.positions[channel] for channel in channels],
            comments=None,
            ndmin=2,
        )
    except ValueError:
        return None
    # Words such as "nan" are numbers to NumPy, and lines of spaces are none: the slow path tells.
    if len(table) != len(lines) or not np.isfinite(table).all():
        return None
    return {channel: np.ascontiguousarray(table[:, k]) for k, channel in enumerate(channels)}


def _slow(
    lines: Sequence[str], form: _Form, line: int, row: int, texts: dict[tuple[str, int], str]
) -> tuple[dict[str, Array], NDArray[np.int64], list[tuple[int, str]]]:
    """Return the columns, the lines where rows begin, and the lines with other columns.

    The first of the lines has the number `line`, its row is number `row` of the table. Cells that
    are no finite numbers become NaN; `texts` takes what stands there.
    """
    rows: list[list[str]] = []
    numbers: list[int] = []
    ragged: list[tuple[int, str]] = []
    reader = csv.reader((f"{text}\n" for text in lines), delimiter=form.delimiter)
    begin = line
    for cells in reader:
        numbers.append(begin)
        if len(cells) != form.width:
            count = f"{len(cells)} column{'s' if len(cells) > 1 else ''}"
            message = f"the line has {count}, the header has {form.width}"
            ragged.append((begin, message if any(cells) else "empty line"))
        rows.append(cells)
        begin = line + reader.line_num
    values: dict[str, Array] = {}
    if not ragged:
        columns = list(zip(*rows, strict=True)) or [()] * form.width
        for channel, position in form.positions.items():
            values[channel], wrong = _numbers(columns[position], form.decimal)
            room = _MOST_TEXTS - len(texts)
            texts |= {(channel, row + n): text for n, text in wrong[: max(room, 0)]}
    return values, np.array(numbers, dtype=np.int64), ragged


def _numbers(cells: Sequence[str], decimal: str) -> tuple[Array, list[tuple[int, str]]]:
    """Return cells as numbers, NaN where there is none; and where that is, with what is there."""
    if decimal == "." and _OF_NUMBERS.issuperset("".join(cells)):
        with suppress(ValueError):
            values = np.array(list(map(float, cells)))
            if np.isfinite(values).all():
                return values, []
    mark = re.escape(decimal)
    number = re.compile(rf"[+-]?(?:[0-9]+(?:{mark}[0-9]*)?|{mark}[0-9]+)(?:[eE][+-]?[0-9]+)?")
    values, wrong = np.empty(len(cells)), []
    for n, cell in enumerate(cells):
        text = cell.strip()
        value = float(text.replace(decimal, ".")) if number.fullmatch(text) else math.nan
        if not math.isfinite(value):
            value = math.nan
            wrong.append((n, text))
        values[n] = value
    return values, wrong


FORMATS = (FileFormat(title="CSV, TSV", extensions=(".csv", ".tsv", ".txt"), read=read),)
