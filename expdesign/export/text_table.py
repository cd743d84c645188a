"""Reading tables of text strictly: what is no plain decimal number is refused."""

from __future__ import annotations

import re
from pathlib import Path

from expdesign.export.rows import TableError

LARGEST_FILE = 1 << 30
_NUMBER = re.compile(r"[+-]?(?:\d{1,30}(?:\.\d{0,30})?|\.\d{1,30})(?:[eE][+-]?\d{1,3})?")


def lines(path: Path) -> list[str]:
    """Return the lines of a text file.

    Raises
    ------
    TableError
        It is no text in ASCII, or too large.
    """
    if path.stat().st_size > LARGEST_FILE:
        raise TableError(f"the file is larger than {LARGEST_FILE >> 20} MiB")
    try:
        return path.read_bytes().decode("ascii").splitlines()
    except UnicodeDecodeError as error:
        raise TableError("the file is no plain text") from error


def number(text: str, line: int, what: str) -> float:
    """Return a decimal number.

    Raises
    ------
    TableError
        Naming the line.
    """
    if not _NUMBER.fullmatch(text):
        raise TableError(f"line {line}: the {what} '{text[:40]}' is not a number")
    return float(text)


def numbers(cells: list[str], count: int, line: int, what: str) -> list[float]:
    """Return the numbers of a row that has to have `count` of them.

    Raises
    ------
    TableError
        Naming the line.
    """
    if len(cells) != count:
        raise TableError(f"line {line}: {len(cells)} {what} where there are {count}")
    return [number(cell.strip(), line, what) for cell in cells]
