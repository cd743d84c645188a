"""Delimited text: CSV and TSV, quickly when all is well, cell by cell when it is not."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.data.columns import header_column, pick
from estimation.data.formats import FileFormat
from estimation.data.table import HEADER_LINE, RawTable, refuse
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
        raise InputError(message, path, HEADER_LINE)
    delimiter = _delimiter(path, section, header)
    names = next(csv.reader([header], delimiter=delimiter))
    columns = [header_column(name, position) for position, name in enumerate(names)]
    try:
        picked = pick(columns, section.columns, path, HEADER_LINE)
    except InputError as error:
        raise _with_delimiter_hint(error, path, header, delimiter) from None
    lines = body.rstrip().split("\n") if body.strip() else []
    positions = {channel: columns.index(column) for channel, column in picked.items()}
    if _QUOTE not in body and all(line.count(delimiter) == len(names) - 1 for line in lines):
        values = _fast(lines, positions, delimiter, section.decimal)
        if values is not None:
            return RawTable(path, values, picked, "line", HEADER_LINE + 1)
    values, numbers, texts = _slow(
        lines, positions, delimiter, section.decimal, width=len(names), path=path
    )
    return RawTable(path, values, picked, "line", HEADER_LINE + 1, numbers, texts)


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
    raise InputError("the file is no text", path, allowed="text in UTF-8")


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


def _slow(
    lines: Sequence[str],
    positions: Mapping[str, int],
    delimiter: str,
    decimal: str,
    *,
    width: int,
    path: Path,
) -> tuple[dict[str, Array], NDArray[np.int64], dict[tuple[str, int], str]]:
    """Return the columns, the lines where rows begin, and the cells that are no finite numbers."""
    mark = re.escape(decimal)
    number = re.compile(rf"[+-]?(?:[0-9]+(?:{mark}[0-9]*)?|{mark}[0-9]+)(?:[eE][+-]?[0-9]+)?")
    values: dict[str, list[float]] = {channel: [] for channel in positions}
    texts: dict[tuple[str, int], str] = {}
    numbers: list[int] = []
    ragged = []
    rows = csv.reader((f"{line}\n" for line in lines), delimiter=delimiter)
    begin = HEADER_LINE + 1
    for index, row in enumerate(rows):
        numbers.append(begin)
        if len(row) != width:
            count = f"{len(row)} column{'s' if len(row) > 1 else ''}"
            message = f"the line has {count}, the header has {width}" if any(row) else "empty line"
            ragged.append(Problem(message, path, begin))
        else:
            for channel, position in positions.items():
                text = row[position].strip()
                value = float(text.replace(decimal, ".")) if number.fullmatch(text) else np.nan
                if not np.isfinite(value):
                    value, texts[channel, index] = np.nan, text
                values[channel].append(value)
        begin = HEADER_LINE + 1 + rows.line_num
    refuse(ragged, path, "lines are like that")
    arrays = {channel: np.array(column) for channel, column in values.items()}
    return arrays, np.array(numbers, dtype=np.int64), texts


FORMATS = (FileFormat(title="CSV, TSV", extensions=(".csv", ".tsv", ".txt"), read=read),)
