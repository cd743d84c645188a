"""Delimited text, CSV and TSV: blocks of numbers by NumPy, all others cell by cell."""

from __future__ import annotations

import codecs
import csv
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.data.formats import FileFormat
from estimation.data.stamps import TimeCells, is_stamp
from estimation.data.table import (
    MOST_PROBLEMS,
    FileContent,
    RawTable,
    RecordedColumn,
    header_column,
    pick_columns,
    refuse,
    refuse_long,
)
from expdesign.configuration import (
    FORCE_CHANNELS,
    LENGTH_CHANNELS,
    DataSection,
    InputError,
    Problem,
)
from expdesign.configuration.delimited import is_number, split_table
from expdesign.configuration.estimate import Header
from expdesign.configuration.quantity import quantity_of_unit

BLOCK = 4 * 1024 * 1024
"""Characters of a block, without its last line."""
LONGEST_LINE = 1024 * 1024
"""Characters."""
_ENCODINGS = ("utf-8-sig", "cp1252")
_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def encoding_of(path: Path) -> str:
    """Return the encoding of a text: UTF-8, UTF-16 by its mark, or Windows-1252.

    Raises
    ------
    InputError
        It is not text.
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
    return InputError("the file is not text", path, allowed="text in UTF-8")


def line_blocks(path: Path) -> Iterator[list[str]]:
    """Yield the lines of a text without their ends, tens of thousands at once.

    Blank lines at the end of the file are omitted.

    Raises
    ------
    InputError
        It is not text, or a line is too long for a table.
    """
    with path.open(encoding=encoding_of(path)) as stream:
        number = 0
        pending: list[str] = []
        while lines := [line.removesuffix("\n") for line in stream.readlines(BLOCK)]:
            for n, line in enumerate(lines, number + 1):
                if len(line) > LONGEST_LINE:
                    allowed = f"{LONGEST_LINE} characters"
                    raise InputError("the line is too long", path, n, allowed=allowed)
            number += len(lines)
            if pending and any(line.strip() for line in lines):
                yield pending
                pending = []
            pending += lines
        while pending and not pending[-1].strip():
            pending.pop()
        if pending:
            yield [*pending[:-1], pending[-1].rstrip()]


_QUOTE = '"'
_OF_NUMBERS = frozenset("0123456789+-.eE \t")
"""Characters of numbers that Python and this reader read alike."""
_MOST_TEXTS = 100_000
"""Largest number of cells without a number whose text is stored."""
_OTHER_DELIMITERS = {";": "';'", "\t": "'\\t'", ",": "','", "|": "'|'"}


def read(path: Path, section: DataSection) -> RawTable:
    """Read a text file with a line of names, or names by the section.

    Raises
    ------
    InputError
        It is not text, columns are missing, or lines have more or fewer columns than the header.
        Cells without a number become NaN; their text is in the table.
    """
    about, blocks = section.header, line_blocks(path)
    lines, number = next(blocks, []), about.before + 1
    line, first = "".join(lines[about.before : number]), lines[about.lines :]
    if about.names is None and not line.strip():
        which = f"line {number}" if about.before else "the first line"
        message = f"{which} names no columns" if first else "the file is empty"
        raise InputError(message, path, number)
    delimiter = section.delimiter
    # A comma may be the default, which resolved run files contain as well.
    if path.suffix.lower() == ".tsv" and delimiter == "," and "\t" in line:
        delimiter = "\t"
    try:
        names = about.names or next(csv.reader([line], delimiter=delimiter))
    except csv.Error:
        raise InputError(_too_long(), path, number) from None
    columns = [header_column(name, position) for position, name in enumerate(names)]
    try:
        picked = pick_columns(columns, section.columns, path, number, channels=section.channels)
    except InputError:
        other = next((shown for mark, shown in _OTHER_DELIMITERS.items() if mark in line), None)
        if delimiter in line or other is None:
            raise
        message = f"the header has no delimiter '{delimiter}'"
        allowed = f"data.delimiter: the one of the file, perhaps {other}"
        raise InputError(message, path, number, allowed=allowed) from None
    positions = {channel: columns.index(column) for channel, column in picked.items()}
    row = next(csv.reader(first[:1], delimiter=delimiter), [])
    timed = positions.get("t", len(row)) < len(row)
    clock = TimeCells.starting_with(row[positions["t"]]) if timed else None
    if clock is not None and clock.stamps:
        picked["t"] = replace(picked["t"], unit="s")
    form = _Form(positions, len(names), delimiter, section.decimal, about, clock)
    return _gather_rows(path, picked, form, chain([first], blocks))


@dataclass(frozen=True)
class _Form:
    """Format of the rows of a file, with the positions of the channels."""

    positions: Mapping[str, int]
    width: int
    """Number of columns."""
    delimiter: str
    decimal: str
    header: Header = field(default_factory=Header)
    clock: TimeCells | None = None
    """Reader of the time if it counts from a date."""


def _too_long() -> str:
    longest = csv.field_size_limit()
    return f"a cell has more than {longest} characters: perhaps a quote has no end"


def _gather_rows(
    path: Path, picked: dict[str, RecordedColumn], form: _Form, blocks: Iterator[list[str]]
) -> RawTable:
    """Return the table of all rows; refuse lines with other columns than the header."""
    parts: dict[str, list[Array]] = {channel: [] for channel in picked}
    numbers: list[NDArray[np.int64]] = []
    texts: dict[tuple[str, int], str] = {}
    ragged, count = list[Problem](), 0
    line, rows, follow = form.header.lines + 1, 0, True
    for lines in blocks:
        values = _read_numbers(lines, form)
        begins, used = np.arange(line, line + len(lines)), len(lines)
        if values is None:
            values, begins, used, wrong = _read_cells(lines, blocks, form, line, rows, texts)
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
        form.header.lines + 1,
        None if follow else np.concatenate(numbers),
        texts,
        form.header.before + 1,
        0.0 if form.clock is None else form.clock.origin,
    )


_SAMPLE = 200
"""Lines that show the format."""


def list_columns(path: Path) -> FileContent:
    """Guess delimiter and decimal mark, and list the columns with the units of a row of units."""
    lines = next(line_blocks(path), [])[:_SAMPLE]
    form, rows = split_table(lines, is_stamp)
    width = len(rows[-1]) if rows else 0
    first = next((n for n, row in enumerate(rows) if _is_data(row, width)), len(rows))
    header, units, stated = first - 1, list[str](), dict[str, Any]()
    if first == len(rows) or width < 2:  # noqa: PLR2004 - time and a value
        return FileContent((), questions=("no table of numbers is in the file",))
    if header > 0 and len(rows[header - 1]) == width and _are_units(rows[header]):
        units, header = rows[header], header - 1
        stated["after"] = 1
    names, questions = rows[header], list[str]()
    if first == 0 or len(names) != width:
        usual = ["t", *LENGTH_CHANNELS, *FORCE_CHANNELS]
        names = usual if width == len(usual) else [f"column {k}" for k in range(1, width + 1)]
        stated, header = {"names": names}, first
        questions.append(f"header: {{names: …}}: the file has none for its {width} columns")
    if header > 0:
        stated["before"] = header
    columns = [header_column(name, place) for place, name in enumerate(names)]
    columns = [
        replace(column, name=column.name, unit=column.unit or unit.strip("[]() ") or None)
        for column, unit in zip(columns, units or [""] * len(columns), strict=False)
    ]
    settings = form._asdict()
    defaults = {"delimiter": "\t" if path.suffix.lower() == ".tsv" else ",", "decimal": "."}
    changed = {key: value for key, value in settings.items() if value != defaults[key]}
    return FileContent(columns, {"header": stated, **changed} if stated else changed, questions)


def _is_data(row: Sequence[str], width: int) -> bool:
    """Return whether a row has the width of the table and mostly numbers."""
    numbers = sum(is_stamp(cell) or is_number(cell) for cell in row)
    return len(row) == width and numbers > width / 2


def _are_units(row: Sequence[str]) -> bool:
    """Return whether most cells of a row are known units."""
    found = [text for cell in row if (text := cell.strip("[]() "))]
    return (
        bool(found) and sum(quantity_of_unit(text) is not None for text in found) > len(found) / 2
    )


def _read_numbers(lines: Sequence[str], form: _Form) -> dict[str, Array] | None:
    """Return the columns if every cell is a number, else None."""
    channels, clock = list(form.positions), form.clock
    if not lines:
        return {channel: np.empty(0) for channel in channels}
    if clock is not None:
        channels.remove("t")
    if any(_QUOTE in line or line.count(form.delimiter) != form.width - 1 for line in lines):
        return None
    if form.decimal != ".":
        text = "\n".join(lines)
        if "." in text:
            return None  # it would be read as a decimal point
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
    # NumPy reads words such as "nan" as numbers, and skips lines of spaces.
    if len(table) != len(lines) or not np.isfinite(table).all():
        return None
    values = {channel: np.ascontiguousarray(table[:, k]) for k, channel in enumerate(channels)}
    if clock is not None:
        place = form.positions["t"]
        cells = [line.split(form.delimiter, place + 1)[place] for line in lines]
        values["t"] = clock.read(cells)
    return values if clock is None or np.isfinite(values["t"]).all() else None


def _read_cells(
    lines: Sequence[str],
    blocks: Iterator[list[str]],
    form: _Form,
    line: int,
    row: int,
    texts: dict[tuple[str, int], str],
) -> tuple[dict[str, Array], NDArray[np.int64], int, list[tuple[int, str]]]:
    """Return the columns, first line of each row, number of lines, and lines with wrong columns.

    The next of the blocks are read, too, if the last row continues there. The first line has the
    number `line`, its row the index `row` in the table. Cells without a finite number become NaN;
    their text is added to `texts`.
    """
    rows: list[list[str]] = []
    numbers: list[int] = []
    ragged: list[tuple[int, str]] = []
    used = 0

    def feed() -> Iterator[str]:
        nonlocal used
        for block in chain([lines], blocks):
            used += len(block)
            yield from (f"{text}\n" for text in block)

    reader, begin = csv.reader(feed(), delimiter=form.delimiter), line
    try:
        for cells in reader:
            numbers.append(begin)
            if len(cells) != form.width:
                count = f"{len(cells)} column{'s' if len(cells) > 1 else ''}"
                message = f"the line has {count}, the header has {form.width}"
                ragged.append((begin, message if any(cells) else "empty line"))
            rows.append(cells)
            begin = line + reader.line_num
            if reader.line_num >= used:
                break
    except csv.Error:
        ragged.append((begin, _too_long()))
    values: dict[str, Array] = {}
    if not ragged:
        columns = list(zip(*rows, strict=True)) or [()] * form.width
        for channel, position in form.positions.items():
            clock = form.clock if channel == "t" else None
            values[channel], wrong = _parse_cells(columns[position], form.decimal, clock)
            room = _MOST_TEXTS - len(texts)
            texts |= {(channel, row + n): text for n, text in wrong[: max(room, 0)]}
    return values, np.array(numbers, dtype=np.int64), used, ragged


def _parse_cells(
    cells: Sequence[str], decimal: str, clock: TimeCells | None
) -> tuple[Array, list[tuple[int, str]]]:
    """Return the numbers of cells, NaN without one; and index and text of the cells without one.

    Times that count from a date are those from the first one on.
    """
    if clock is not None:
        times = clock.read(cells)
        return times, [(n, cells[n].strip()) for n in np.flatnonzero(np.isnan(times)).tolist()]
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


FORMATS = (
    FileFormat(
        title="CSV, TSV",
        extensions=(".csv", ".tsv", ".txt"),
        read=read,
        list_columns=list_columns,
    ),
)
