"""Delimited text: CSV and TSV, quickly when all is well, cell by cell when it is not."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from constraints.arrays import Array
from estimation.data.columns import header_column, pick
from estimation.data.table import HEADER_LINE, FileFormat, RawTable, refuse
from expdesign.configuration import DataSection, InputError, Problem

_QUOTE = '"'
_OTHER_DELIMITERS = {";": "';'", "\t": "'\\t'", ",": "','", "|": "'|'"}


def read(path: Path, section: DataSection) -> RawTable:
    """Read a text file whose first line names the columns.

    Raises
    ------
    InputError
        It is no text, columns are missing, or lines have more or fewer columns than the header.
        Cells that are no numbers become NaN, their text is in the table.
    """
    header, _, body = _decoded(path).partition("\n")
    if not header.strip():
        message = "the file is empty" if not body.strip() else "the first line names no columns"
        raise InputError(Problem(message, path, HEADER_LINE))
    delimiter = _delimiter(path, section, header)
    names = next(csv.reader([header], delimiter=delimiter))
    columns = [header_column(name, position) for position, name in enumerate(names)]
    try:
        picked = pick(columns, section.columns, path, HEADER_LINE)
    except InputError as error:
        raise _with_delimiter_hint(error, path, header, delimiter) from None
    lines = body.rstrip().split("\n") if body.strip() else []
    cells, numbers = _Cells(lines, delimiter), None
    if _QUOTE in body:
        rows, numbers = _quoted_rows(lines, delimiter)
        cells = _Cells(rows, delimiter)
    _refuse_ragged(cells, numbers, len(names), path)
    positions = {channel: columns.index(column) for channel, column in picked.items()}
    values = None if _QUOTE in body else _fast(lines, positions, delimiter, section.decimal)
    if values is None:
        values = _slow(cells, positions, section.decimal)
    return RawTable(
        path,
        values,
        picked,
        "line",
        HEADER_LINE + 1,
        None if numbers is None else np.array(numbers, dtype=np.int64),
        _texts(cells, values, positions),
    )


class _Cells:
    """Cells of lines that are split when they are asked for, or of rows that were split."""

    def __init__(self, rows: Sequence[str] | Sequence[list[str]], delimiter: str) -> None:
        self._rows = rows
        self._delimiter = delimiter

    def __len__(self) -> int:
        return len(self._rows)

    def row(self, index: int) -> list[str]:
        row = self._rows[index]
        return row.split(self._delimiter) if isinstance(row, str) else row

    def width(self, index: int) -> int:
        row = self._rows[index]
        return row.count(self._delimiter) + 1 if isinstance(row, str) else len(row)


def _decoded(path: Path) -> str:
    """Return the text with Unix newlines: UTF-8, UTF-16 by its mark, or Windows-1252."""
    data = path.read_bytes()
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        encodings = ["utf-16"]
    else:
        encodings = ["utf-8-sig", "cp1252"]
    for encoding in encodings:
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text
        break
    raise InputError(Problem("the file is no text", path, allowed="text in UTF-8"))


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
        Problem(
            f"the header has no delimiter '{delimiter}'",
            path,
            HEADER_LINE,
            allowed=f"data.delimiter: the one of the file, perhaps {other}",
        )
    )


def _quoted_rows(lines: Sequence[str], delimiter: str) -> tuple[list[list[str]], list[int]]:
    """Split lines with quoted cells; also return the number of the line where each row begins."""
    reader = csv.reader((f"{line}\n" for line in lines), delimiter=delimiter)
    rows, numbers, begins = [], [], HEADER_LINE + 1
    for row in reader:
        rows.append(row)
        numbers.append(begins)
        begins = HEADER_LINE + 1 + reader.line_num
    return rows, numbers


def _refuse_ragged(cells: _Cells, numbers: Sequence[int] | None, width: int, path: Path) -> None:
    problems = []
    for row in range(len(cells)):
        if cells.width(row) == width:
            continue
        line = HEADER_LINE + 1 + row if numbers is None else numbers[row]
        found = cells.row(row)
        count = f"{len(found)} column{'s' if len(found) > 1 else ''}"
        message = f"the line has {count}, the header has {width}" if any(found) else "empty line"
        problems.append(Problem(message, path, line))
    refuse(problems, path, "lines are like that")


def _fast(
    lines: Sequence[str], positions: Mapping[str, int], delimiter: str, decimal: str
) -> dict[str, Array] | None:
    """Return the columns when every cell is a number, else None."""
    if not lines:
        return {channel: np.empty(0) for channel in positions}
    if decimal != ".":
        text = "\n".join(lines)
        if "." in text:
            return None  # it would pass for a decimal point
        lines = text.replace(decimal, ".").split("\n")
    channels = list(positions)
    try:
        table = np.loadtxt(
            lines,
            delimiter=delimiter,
            usecols=[positions[channel] for channel in channels],
            comments=None,
            ndmin=2,
        )
    except ValueError:
        return None
    # Words such as "nan" are numbers to NumPy, and lines of spaces are none: the slow path tells.
    if len(table) != len(lines) or not np.isfinite(table).all():
        return None
    return {channel: np.ascontiguousarray(table[:, k]) for k, channel in enumerate(channels)}


def _slow(cells: _Cells, positions: Mapping[str, int], decimal: str) -> dict[str, Array]:
    """Return the columns with NaN where a cell is no finite number."""
    mark = re.escape(decimal)
    number = re.compile(rf"[+-]?(?:[0-9]+(?:{mark}[0-9]*)?|{mark}[0-9]+)(?:[eE][+-]?[0-9]+)?")
    values = {channel: np.full(len(cells), np.nan) for channel in positions}
    for index in range(len(cells)):
        row = cells.row(index)
        for channel, position in positions.items():
            text = row[position].strip()
            if number.fullmatch(text):
                value = float(text.replace(decimal, "."))
                values[channel][index] = value if np.isfinite(value) else np.nan
    return values


def _texts(
    cells: _Cells, values: Mapping[str, Array], positions: Mapping[str, int]
) -> dict[tuple[str, int], str]:
    return {
        (channel, int(row)): cells.row(int(row))[positions[channel]].strip()
        for channel, column in values.items()
        for row in np.flatnonzero(~np.isfinite(column))
    }


FORMATS = (FileFormat(title="CSV, TSV", extensions=(".csv", ".tsv", ".txt"), read=read),)
