"""Common parts of text formats: rows, marks of the window, and their strict readers.

The readers raise `TableError`, which names the line.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from constraints.arrays import Array
from expdesign.configuration.schema import LARGEST_COUNT
from expdesign.export.definition import Rows, Settings, TableError, edge_rows, in_window
from expdesign.export.repetition import collect
from expdesign.runfolder.files import LARGEST_NUMBER

_KNOWN = 50_000
"""Lines whose numbers are remembered: those of a period are."""
_ROWS = 20_000
"""Rows of a block of numbers."""
_MOST_TICKS = 2.0**53
"""Of a clock: floating-point numbers count further ones in steps."""
_PLAIN = r"[-+0-9.,\s]*"
_ORDINARY = re.compile(rf"{_PLAIN}(?:[eE][-+]?\d{{1,3}}(?!\d){_PLAIN})*")
"""Of these characters Python reads as numbers what `_NUMBER` says, however long."""
_LONGEST = 30
_NUMBER = re.compile(r"[+-]?(?:\d{1,30}(?:\.\d{0,30})?|\.\d{1,30})(?:[eE][+-]?\d{1,3})?")


def write_lines(path: Path, text: Iterable[str]) -> None:
    """Write lines of ASCII, one by one."""
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.writelines(f"{line}\n" for line in text)


def every_line(rows: Rows, lines_of: Callable[[Rows], Iterable[str]]) -> Iterator[str]:
    """Yield one line for every row of a table; those of a repeated period are made once.

    `lines_of` returns a line for each row of a part of the table. The line of the first row counts
    only in the first part; in the others this row is the last one of the part before. The times of
    the part are those of the first of the periods.
    """
    made: list[str] | None = None
    for number, part in enumerate(rows.parts()):
        repeated = 0 < number <= rows.repeated
        if repeated and made is not None:
            yield from made
            continue
        text: Iterable[str] = islice(lines_of(part), 1 if number else 0, None)
        if repeated:
            text = made = list(text)
        yield from text


def mark_window(
    text: Iterable[str], rows: Rows, settings: Settings, comment: str, *, ends: bool = False
) -> Iterator[str]:
    """Yield the lines of rows, with comments where the measurement window begins and ends.

    A comment of the format has ``{}`` for its text. A line that `ends` at its row is a move: the
    window begins behind the line of its first row. Otherwise it begins before that line.
    """
    edges = edge_rows(rows, settings.window)
    if not ends:
        inside = np.flatnonzero(in_window(rows.times, rows.short_window(settings.window)))
        edges = (
            (int(inside[0]) - 1, int(inside[-1]) + rows.left_out[0]) if inside.size else (-2, -2)
        )
    marks = dict(zip(edges, ("measurement window begins", "measurement window ends"), strict=True))
    if -1 in marks:
        yield comment.format(marks[-1])
    for number, line in enumerate(text):
        yield line
        if number in marks:
            yield comment.format(marks[number])


@dataclass(frozen=True)
class Loop:
    """Statements of a controller's language that repeat the lines of a period."""

    begin: str
    """With ``{}`` for the number of repetitions."""
    end: str
    comment: str
    """A comment, with ``{}`` for its text."""

    def lines(
        self, parts: Iterable[Iterable[str]], count: int, switches: Sequence[str]
    ) -> Iterator[str]:
        """Yield the lines of a program of lead-in, a period that is repeated, and lead-out.

        The switches of an output are before and after the loop.
        """
        lead_in, period, lead_out = parts
        yield from lead_in
        yield self.comment.format("measurement window begins")
        yield from switches[:1]
        yield self.begin.format(count)
        yield from period
        yield self.end
        yield self.comment.format("measurement window ends")
        yield from switches[1:]
        yield from lead_out

    def moves(
        self,
        code: Iterable[tuple[int, str]],
        read: Callable[[str, int], list[float]],
        commands: tuple[str, str] | None,
        switched: list[tuple[int, bool]],
    ) -> Iterator[tuple[Array, Array]]:
        """Yield the ticks at which moves end, (N,), and their values, (N, K), in blocks.

        `read` returns the ticks of a numbered line and its values. The two commands switch an
        output on and off; `switched` gets the row before each, and whether it switches on. A loop
        in a loop, or one without begin or end, is a `TableError`.
        """
        known: dict[str, list[float]] = {}
        total = number = 0
        for count, block in self._stretches(code):
            found: list[list[float]] = []
            for k, line in block:
                if count == 1 and commands and line in commands:
                    switched.append((number + len(found), line == commands[0]))
                    continue
                move = known.get(line) or read(line, k)
                if len(known) < _KNOWN:
                    known[line] = move
                found.append(move)
            if found:
                table = np.array(found)
                ticks = np.cumsum(table[:, 0])
                for _ in range(count):
                    yield total + ticks, table[:, 1:]
                    total += int(ticks[-1])
                number += count * len(found)

    def _stretches(
        self, code: Iterable[tuple[int, str]]
    ) -> Iterator[tuple[int, list[tuple[int, str]]]]:
        """Yield blocks of numbered lines, and how often the program executes each."""
        begin = re.compile(re.escape(self.begin).replace(r"\{\}", r"(\d{1,7})"))
        block: list[tuple[int, str]] = []
        count = 0
        for k, word in code:
            begins = begin.fullmatch(word)
            if begins or word == self.end:
                if bool(begins) == bool(count):
                    raise TableError(f"line {k}: '{word[:40]}' is not that of a single loop")
                yield max(1, count), block
                block, count = [], int(begins[1]) if begins else 0
                if begins and not 1 <= count <= LARGEST_COUNT:
                    raise TableError(f"line {k}: {count} repetitions")
                continue
            block.append((k, word))
            if not count and len(block) > _ROWS:
                yield 1, block
                block = []
        if count:
            raise TableError(f"the program has no '{self.end}'")
        yield 1, block


def lines(path: Path) -> Iterator[str]:
    """Yield the lines of a file of ASCII."""
    try:
        with path.open(encoding="ascii") as file:
            for line in file:
                yield line.rstrip("\n")
    except UnicodeDecodeError as error:
        raise TableError("the file is no plain text") from error


def lines_after(path: Path, head: str, message: str) -> Iterator[str]:
    """Return the lines after the first one, which has to be `head`."""
    found = lines(path)
    if next(found, "") != head:
        raise TableError(f"line 1: {message}")
    return found


def number(text: str, line: int, what: str) -> float:
    """Return a plain decimal number."""
    if not _NUMBER.fullmatch(text):
        raise TableError(f"line {line}: the {what} '{text[:40]}' is not a number")
    value = float(text)
    if not abs(value) <= LARGEST_NUMBER:
        raise TableError(f"line {line}: the {what} '{text[:40]}' is beyond {LARGEST_NUMBER:g}")
    return value


def numbers(
    text: Iterable[str],
    count: int,
    what: str,
    separator: str | None = None,
    *,
    first: int = 1,
    comment: str = "",
    timed: bool = False,
) -> Iterator[Array]:
    """Yield the numbers of a table in blocks of rows, (N, count); there is at least one row.

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
    timed : bool
        Whether the first number is a time, which differs where the others are repeated.
    """
    table: list[list[float]] = []
    known: dict[str, list[float]] = {}
    empty, one = True, what.removesuffix("s")
    for k, line in enumerate(text, start=first):
        code = line.partition(comment)[0].strip() if comment else line
        if comment and not code:
            continue
        time, _, key = code.partition(separator or " ") if timed else ("", "", code)
        row = known.get(key)
        if row is None:
            cells = code.split(separator)
            if len(cells) != count:
                raise TableError(f"line {k}: {len(cells)} {what} where there are {count}")
            row = _ordinary(code, cells) or [number(cell.strip(), k, one) for cell in cells]
            if len(known) < _KNOWN:
                known[key] = row
        elif timed:
            row = [number(time, k, one), *row[1:]]
        table.append(row)
        if len(table) == _ROWS:
            yield np.array(table)
            empty = False
            table.clear()
    if table:
        yield np.array(table)
    elif empty:
        raise TableError("the table has no rows")


def _ordinary(row: str, cells: Sequence[str]) -> list[float] | None:
    """Return a row of ordinary numbers, ten times faster than one by one; None for another."""
    if _ORDINARY.fullmatch(row) and max(map(len, cells)) <= _LONGEST:
        with contextlib.suppress(ValueError):
            values = list(map(float, cells))
            return values if max(map(abs, values)) <= LARGEST_NUMBER else None
    return None


def uniform_rows(blocks: Iterable[Array], settings: Settings) -> Rows:
    """Return the rows of a table that states neither times nor velocities, from blocks (N, 6)."""
    step = settings.step
    if step is None:
        raise ValueError("the table needs a step")

    def timed() -> Iterator[tuple[Array, Array]]:
        first = 0
        for block in blocks:
            yield step * np.arange(first, first + len(block), dtype=np.float64), block
            first += len(block)

    found = collect(timed(), settings)
    return found.rows(found.values)


def add_times(
    blocks: Iterable[Array], ticks_per_cell: float, ticks: int
) -> Iterator[tuple[Array, Array]]:
    """Yield times, s, and blocks of rows (N, K) whose first column is the time of each move.

    A unit of the column has `ticks_per_cell` of the file's clock, a second has `ticks`. Whole ticks
    are added, so that rounding errors do not accumulate; times that are too long for the clock are
    a `TableError`.
    """
    total = 0
    for block in blocks:
        steps = np.rint(block[:, 0] * ticks_per_cell)
        if not abs(total) + np.sum(np.abs(steps)) <= _MOST_TICKS:
            raise TableError(f"the times add up to more than {_MOST_TICKS / ticks:.3g} s")
        counted = total + np.cumsum(steps.astype(np.int64))
        total = int(counted[-1])
        yield counted / ticks, block


def refuse_motion_at_end(velocities: Array, line: int) -> None:
    """Refuse a table after which the axes go on moving: the last velocities, (6,), are zero."""
    if np.any(velocities != 0):
        raise TableError(f"line {line}: the last velocities are not 0")
