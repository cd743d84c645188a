"""Common parts of text formats: rows, marks of the window, and their strict readers.

The readers raise `TableError`, which names the line.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from constraints.arrays import Array
from expdesign.export.definition import Rows, Settings, TableError, in_window

LARGEST_FILE = 1 << 30
_PLAIN = r"[-+0-9.,\s]*"
_ORDINARY = re.compile(rf"{_PLAIN}(?:[eE][-+]?\d{{1,3}}(?!\d){_PLAIN})*")
"""Of these characters Python reads as numbers what `_NUMBER` says, however long."""
_LONGEST = 30
_NUMBER = re.compile(r"[+-]?(?:\d{1,30}(?:\.\d{0,30})?|\.\d{1,30})(?:[eE][+-]?\d{1,3})?")


def write_lines(path: Path, text: Iterable[str]) -> None:
    """Write lines of ASCII."""
    path.write_text("\n".join(text) + "\n", encoding="ascii")


def mark_window(
    text: Iterable[str], times: Array, settings: Settings, comment: str
) -> Iterator[str]:
    """Yield the lines of rows, with comments where the measurement window begins and ends.

    Parameters
    ----------
    text : iterable of str
        One line for every row, at the times (N,), s.
    comment : str
        A comment of the format, with ``{}`` for its text.
    """
    inside = in_window(times, settings.window)
    edges = np.diff(inside.astype(int), prepend=0, append=0)
    for line, before, after in zip(text, edges[:-1], edges[1:], strict=True):
        if before > 0:
            yield comment.format("measurement window begins")
        yield line
        if after < 0:
            yield comment.format("measurement window ends")


def lines(path: Path) -> list[str]:
    """Return the lines of a file of ASCII."""
    if path.stat().st_size > LARGEST_FILE:
        raise TableError(f"the file is larger than {LARGEST_FILE >> 20} MiB")
    try:
        return path.read_bytes().decode("ascii").splitlines()
    except UnicodeDecodeError as error:
        raise TableError("the file is no plain text") from error


def lines_after(path: Path, head: str, message: str) -> list[str]:
    """Return the lines after the first one, which has to be `head`."""
    first, *rest = lines(path) or [""]
    if first != head:
        raise TableError(f"line 1: {message}")
    return rest


def number(text: str, line: int, what: str) -> float:
    """Return a plain decimal number."""
    if not _NUMBER.fullmatch(text):
        raise TableError(f"line {line}: the {what} '{text[:40]}' is not a number")
    return float(text)


def numbers(
    text: Iterable[str],
    count: int,
    what: str,
    separator: str | None = None,
    *,
    first: int = 1,
    comment: str = "",
) -> Array:
    """Return the numbers of a table, (N, count), of which there has to be a row at least.

    Parameters
    ----------
    what : str
        What the numbers are, for messages.
    separator : str, optional
        Between them; white space by default.
    first : int
        Number of the first line in its file.
    comment : str
        What a comment begins with; lines without anything else are left out. None by default.
    """
    table = []
    for k, line in enumerate(text, start=first):
        code = line.partition(comment)[0].strip() if comment else line
        if comment and not code:
            continue
        cells = code.split(separator)
        if len(cells) != count:
            raise TableError(f"line {k}: {len(cells)} {what} where there are {count}")
        table.append(_ordinary(code, cells) or _finite_numbers(cells, k, what.removesuffix("s")))
    if not table:
        raise TableError("the table has no rows")
    return np.array(table)


def _ordinary(row: str, cells: Sequence[str]) -> list[float] | None:
    """Return a row of ordinary numbers, ten times faster than one by one; None for another."""
    if _ORDINARY.fullmatch(row) and max(map(len, cells)) <= _LONGEST:
        with contextlib.suppress(ValueError):
            return list(map(float, cells))
    return None


def _finite_numbers(cells: Sequence[str], line: int, what: str) -> list[float]:
    return [number(cell.strip(), line, what) for cell in cells]


def uniform_rows(positions: Array, settings: Settings) -> Rows:
    """Return the rows of a table that states neither times nor velocities, (N, 6)."""
    if settings.step is None:
        raise ValueError("the table needs a step")
    times = np.multiply(settings.step, range(len(positions)), dtype=np.float64)
    return Rows(times, positions).checked()


def refuse_motion_at_end(velocities: Array, line: int) -> None:
    """Refuse a table after which the axes go on moving: the last velocities, (6,), are zero."""
    if np.any(velocities != 0):
        raise TableError(f"line {line}: the last velocities are not 0")
