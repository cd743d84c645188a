"""Delimited text: CSV and TSV, block by block, quickly; cell by cell where all is not well."""

from __future__ import annotations

import codecs
import csv
import math
import re
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.data.formats import FileFormat
from estimation.data.table import (
    HEADER_LINE,
    MOST_PROBLEMS,
    RawTable,
    RecordedColumn,
    header_column,
    pick,
    refuse,
    refuse_long,
)
from expdesign.configuration import DataSection, InputError, Problem

BLOCK = 4 * 1024 * 1024
"""Characters of a block, but for its last line."""
LONGEST_LINE = 1024 * 1024
"""Characters."""
_ENCODINGS = ("utf-8-sig", "cp1252")
_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def encoding_of(path: Path) -> str:
    """Return the encoding of a text: UTF-8, UTF-16 by its mark, or Windows-1252.

    Raises
    ------
    InputError
        It is no text.
    """
    with path.open("rb") as stream:
        marked = stream.read(len(_MARKS[0])) in _MARKS
    for encoding in ("utf-16",) if marked else _ENCODINGS:
        try:
            with path.open(encoding=encoding) as stream:
                while text := stream.read(BLOCK):
                    if "\0" in text:
                        raise _no_text(path)
        except UnicodeError:
            continue
        return encoding
    raise _no_text(path)


def _no_text(path: Path) -> InputError:
    return InputError("the file is no text", path, allowed="text in UTF-8")


def line_blocks(path: Path) -> Iterator[list[str]]:
    """Yield the lines of a text without their ends, some tens of thousands at once.

    Lines that are blank to the end of the file are none.

    Raises
    ------
    InputError
        It is no text, or a line is longer than any of a table.
    """
    with path.open(encoding=encoding_of(path)) as stream:
        # Blank lines are told when text follows: only their number is kept until then.
        number, blank = 0, 0
        before: list[str] = []
        while text := stream.read(BLOCK):
            if not text.endswith("\n"):
                text += stream.readline(LONGEST_LINE + 1)
            lines = text.split("\n")
            if not lines[-1]:
                lines.pop()
            for n, line in enumerate(lines, number + 1):
                if len(line) > LONGEST_LINE:
                    allowed = f"{LONGEST_LINE} characters"
                    raise InputError("the line is too long", path, n, allowed=allowed)
            number += len(lines)
            filled = next((n for n in range(len(lines), 0, -1) if lines[n - 1].strip()), 0)
            if not filled:
                blank += len(lines)
                continue
            if before:
                yield before
            for begin in range(0, blank, BLOCK):
                yield [""] * min(BLOCK, blank - begin)
            before, blank = lines[:filled], len(lines) - filled
        if before:
            before[-1] = before[-1].rstrip()
            yield before


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
    try:
        names = next(csv.reader([header], delimiter=delimiter))
    except csv.Error:
        raise InputError(_too_long(), path, HEADER_LINE) from None
    columns = [header_column(name, position) for position, name in enumerate(names)]
    try:
        picked = pick(columns, section.columns, path, HEADER_LINE)
    except InputError as error:
        raise _with_delimiter_hint(error, path, header, delimiter) from None
    positions = {channel: columns.index(column) for channel, column in picked.items()}
    form = _Form(positions, len(names), delimiter, section.decimal)
    return _gather_rows(path, picked, form, _Blocks(chain([first], blocks)))


@dataclass(frozen=True)
class _Form:
    """How the rows of a file are written: which of its columns are which channels."""

    positions: Mapping[str, int]
    width: int
    """Number of columns."""
    delimiter: str
    decimal: str


class _Blocks:
    """Blocks of lines, one after the other; the last row of one may take lines of those behind."""

    def __init__(self, blocks: Iterator[list[str]]) -> None:
        self._blocks, self._rest = blocks, deque[str]()

    def __iter__(self) -> Iterator[list[str]]:
        for lines in self._blocks:
            yield lines
            while self._rest:
                rest, self._rest = self._rest, deque()
                yield list(rest)

    def further(self) -> Iterator[str]:
        """Yield lines of the blocks behind, where they are missing then.

        Raises
        ------
        csv.Error
            They are longer than any line: a row that does not end would be the rest of the file.
        """
        length = 0
        while length <= LONGEST_LINE:
            while not self._rest:
                lines = next(self._blocks, None)
                if lines is None:
                    return
                self._rest.extend(lines)
            yield (line := self._rest.popleft())
            length += len(line) + 1
        raise csv.Error


def _too_long() -> str:
    longest = csv.field_size_limit()
    return f"a cell has more than {longest} characters: perhaps a shown has no end"


def _gather_rows(
    path: Path, picked: dict[str, RecordedColumn], form: _Form, blocks: _Blocks
) -> RawTable:
    """Return the table of all rows; refuse it when lines have other columns than the header."""
    parts: dict[str, list[Array]] = {channel: [] for channel in picked}
    numbers: list[NDArray[np.int64]] = []
    texts: dict[tuple[str, int], str] = {}
    ragged, count = list[Problem](), 0
    line, rows, follow = HEADER_LINE + 1, 0, True
    for lines in blocks:
        values = _fast(lines, form)
        begins, used = np.arange(line, line + len(lines)), len(lines)
        if values is None:
            further = blocks.further()
            values, begins, used, wrong = _slow(lines, further, form, line, rows, texts)
            follow = follow and len(begins) == used
            count += len(wrong)
            ragged += [Problem(text, path, n) for n, text in wrong[:MOST_PROBLEMS]]
        for channel, column in values.items():
            parts[channel].append(column)
        numbers.append(begins)
        line, rows = line + used, rows + len(begins)
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
    lines: Sequence[str],
    further: Iterator[str],
    form: _Form,
    line: int,
    row: int,
    texts: dict[tuple[str, int], str],
) -> tuple[dict[str, Array], NDArray[np.int64], int, list[tuple[int, str]]]:
    """Return the columns, the lines where rows begin, how many lines, and those that are wrong.

    The last row may take `further` lines. The first line has the number `line`, its row is number
    `row` of the table. Cells that are no finite numbers become NaN; `texts` takes what stands
    there. Wrong are lines with other columns than the header.
    """
    rows: list[list[str]] = []
    numbers: list[int] = []
    ragged: list[tuple[int, str]] = []
    reader = csv.reader((f"{text}\n" for text in chain(lines, further)), delimiter=form.delimiter)
    begin = line
    try:
        for cells in reader:
            numbers.append(begin)
            if len(cells) != form.width:
                count = f"{len(cells)} column{'s' if len(cells) > 1 else ''}"
                message = f"the line has {count}, the header has {form.width}"
                ragged.append((begin, message if any(cells) else "empty line"))
            rows.append(cells)
            begin = line + reader.line_num
            if reader.line_num >= len(lines):
                break
    except csv.Error:
        ragged.append((begin, _too_long()))
    values: dict[str, Array] = {}
    if not ragged:
        columns = list(zip(*rows, strict=True)) or [()] * form.width
        for channel, position in form.positions.items():
            values[channel], wrong = _numbers(columns[position], form.decimal)
            room = _MOST_TEXTS - len(texts)
            texts |= {(channel, row + n): text for n, text in wrong[: max(room, 0)]}
    used = max(len(lines), reader.line_num)
    return values, np.array(numbers, dtype=np.int64), used, ragged


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
