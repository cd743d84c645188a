"""Delta Tau and Omron PMAC: a motion program of PVT moves."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from itertools import chain, islice
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import model_validator

from constraints.arrays import Array
from expdesign.configuration.errors import refusal
from expdesign.configuration.export import PVT_OPTIONS, ExportSection
from expdesign.export.definition import (
    Interpolation,
    Rows,
    Settings,
    TableError,
    TableFormat,
    round_to_clock,
    switched_at,
    switching,
)
from expdesign.export.repetition import collect, split_rows
from expdesign.export.text_table import (
    Loop,
    every_line,
    lines,
    mark_window,
    number,
    refuse_motion_at_end,
    write_lines,
)
from expdesign.mechanism.hexapod import ACTUATORS

LETTERS = ("X", "Y", "Z", "A", "B", "C")
LONGEST, LONGEST_OF_TA = 4095.9998, 8_388_607
"""Of a move, ms: on a Turbo PMAC, and of a clock of whole milliseconds."""

_TICKS = 4_096_000
"""Of a second: a Turbo PMAC keeps the time of a move in 1/4096 ms."""
_PROGRAM = 10
_NO_PROGRAM = (
    "no program of PVT times and moves between OPEN PROG … CLEAR, ABS and CLOSE, and nothing else"
)
_LOOP = Loop("Q100=0 WHILE(Q100<{})", "Q100=Q100+1 ENDWHILE", "; {}")
_MOVE = re.compile(r"([A-Z])([^:\s]*):(\S*)")


def _write(path: Path, rows: Rows, settings: Settings) -> None:
    axes = settings.axes

    def lines_of(part: Rows) -> Iterator[str]:
        steps = np.diff(np.rint(part.times * _ticks(settings)), prepend=0)
        pairs = zip(part.position, part.velocities, strict=True)
        for step, (position, velocity) in zip(steps, pairs, strict=True):
            moves = zip(
                axes.names, settings.numbers(position), settings.numbers(velocity), strict=True
            )
            words = " ".join(f"{axis}{place}:{speed}" for axis, place, speed in moves)
            # All digits of the time, so that cutting it changes nothing.
            time = f"{1000 * step / _ticks(settings):.12f}".rstrip("0").rstrip(".")
            yield f"PVT{time}\n{words}"

    behind = switching(rows, settings, _commands(settings))
    if settings.section.looped:
        parts = (islice(lines_of(part), 1, None) for part in split_rows(rows))
        text = _LOOP.lines(parts, settings.task.motion.periods, [*behind.values()])
    else:
        moves = mark_window(every_line(rows, lines_of), rows, settings, "; {}", ends=True)
        first = [behind[0]] if 0 in behind else []
        text = chain(first, islice(_switched(moves, behind), 1, None))
    write_lines(path, chain(_head(settings), text, ["CLOSE"]))


def _switched(moves: Iterable[str], behind: Mapping[int, str]) -> Iterator[str]:
    """Yield the lines of the rows, comments among them, with the commands that follow a row."""
    number = -1
    for line in moves:
        comment = line.startswith(";")
        if number in behind and number > 0 and not comment:
            yield behind[number]
        number += not comment
        yield line


def _head(settings: Settings) -> list[str]:
    axes, start = settings.axes, settings.numbers(settings.start)
    units = ", ".join(f"{a} [{u}]" for a, u in zip(axes.names, axes.units, strict=True))
    places = " ".join(f"{a}{place}" for a, place in zip(axes.names, start, strict=True))
    return [
        f"; {settings.title}: {units}",
        "; velocities per second: Isx90 = 1000",
        f"; start: {places}",
        f"OPEN PROG {_PROGRAM} CLEAR",
        "ABS",
    ]


def _ticks(settings: Settings) -> int:
    """Return the ticks of the controller's clock in a second."""
    return 1000 if getattr(settings.section, "clock", None) == "1 ms" else _TICKS


def _written_times(times: Array, settings: Settings) -> Array:
    return round_to_clock(times, settings, ticks=_ticks(settings))


def _commands(settings: Settings) -> tuple[str, str]:
    """Return the assignments that wait for the beginning of the next move."""
    return f"M{settings.section.trigger}==1", f"M{settings.section.trigger}==0"


def _read(path: Path, settings: Settings) -> Rows:
    switched: list[tuple[int, bool]] = []
    found = collect(_moves(path, settings, switched), settings)
    count = len(settings.axes.names)
    rows = found.rows(found.values[:, :count], found.values[:, count:])
    refuse_motion_at_end(rows.velocities[-1], 2 * rows.count)
    return switched_at(switched, rows)


def _moves(
    path: Path, settings: Settings, switched: list[tuple[int, bool]]
) -> Iterator[tuple[Array, Array]]:
    """Yield times, s, with positions and velocities, (N, 12), in blocks; the first is the start.

    Rows before which an output is switched are added to `switched`.
    """
    commands = None if settings.section.trigger is None else _commands(settings)
    read = partial(_read_move, names=settings.axes.names, clock=_ticks(settings))
    yield np.zeros(1), np.concatenate([settings.start, np.zeros(len(LETTERS))])[None, :]
    for ticks, values in _LOOP.moves(_code(path, settings), read, commands, switched):
        yield ticks / _ticks(settings), values


def _code(path: Path, settings: Settings) -> Iterator[tuple[int, str]]:
    """Yield the moves with their times, and other lines of the program, with their numbers.

    Comments of the head have to be ours.
    """
    known = _head(settings)[1:3]
    expected = [f"OPEN PROG {_PROGRAM} CLEAR", "ABS"]
    ended, time, last, clock = False, "", "", _ticks(settings)
    for k, line in enumerate(lines(path), start=1):
        bare = line.partition(";")[0].strip()
        for own in known:
            about, _, _ = own.partition(":")
            if line.startswith(about) and line.rstrip() != own:
                raise TableError(f"line {k}: '{line[:60]}' where the table says '{own}'")
        if not bare:
            continue
        if ended or (expected and bare != expected.pop(0)):
            raise TableError(_NO_PROGRAM)
        ended = bare == "CLOSE"
        if bare.startswith("PVT") or ended:
            if time:
                names = " ".join(settings.axes.names)
                raise TableError(f"line {k}: not one word for each of {names}")
            time = bare.removesuffix("CLOSE")
            if time and time != last:
                _read_ticks(time, k, clock)
                last = time
        elif not (bare == "ABS" or bare.startswith("OPEN")):
            yield k, f"{time} {bare}".lstrip()
            time = ""
    if not ended:
        raise TableError(_NO_PROGRAM)


def _read_move(words: str, line: int, names: tuple[str, ...], clock: int) -> list[float]:
    """Return the ticks that the controller makes of a move's time, positions and velocities."""
    time, *moves = words.split()
    ticks = _read_ticks(time, line, clock)
    found = [match for word in moves if (match := _MOVE.fullmatch(word))]
    if tuple(match[1] for match in found) != names or len(found) < len(moves):
        raise TableError(f"line {line}: not one word for each of {' '.join(names)}")
    position = [number(match[2], line, "position") for match in found]
    return [ticks, *position, *(number(match[3], line, "velocity") for match in found)]


def _read_ticks(time: str, line: int, clock: int) -> int:
    """Return the ticks that the controller makes of the time of a line."""
    if not time.startswith("PVT"):
        raise TableError(f"line {line}: '{time[:40]}' is no PVT time")
    milliseconds = number(time.removeprefix("PVT"), line, "time")
    longest = LONGEST if clock == _TICKS else LONGEST_OF_TA
    # The controller cuts what its clock cannot keep.
    ticks = math.floor(milliseconds * clock / 1000)
    if not (ticks > 0 and milliseconds <= longest):
        raise TableError(f"line {line}: {milliseconds:g} ms is not between 0 and {longest} ms")
    return ticks


_LETTERS = tuple("ABCUVWXYZ")
Clock = Literal["1/4096 ms", "1 ms"]


class PmacOptions(ExportSection):
    """Options of a PVT motion program of the PMAC."""

    spaces = ("strut", "pose")
    shared = (*PVT_OPTIONS, "repeat")
    outputs = (0, 8191)
    """M-variable."""

    clock: Clock | None = None
    """Resolution of the controller's row times; 1 ms for a PMAC that is no Turbo or has I42 = 1."""

    @model_validator(mode="after")
    def _check_axes(self) -> PmacOptions:
        unknown = [name for name in self.axes or () if name not in _LETTERS]
        if unknown:
            allowed = f"{ACTUATORS} of the letters {' '.join(_LETTERS)}"
            raise refusal(f"'{unknown[0]}' is not an axis of a PMAC", allowed, key="axes")
        return self


FORMAT = TableFormat(
    name="pmac-pvt",
    title="Delta Tau and Omron PMAC, PVT motion program",
    suffix=".pmc",
    interpolation=Interpolation.CUBIC,
    write=_write,
    read=_read,
    options=PmacOptions,
    guide='{% extends "guides/pmac-pvt.txt.j2" %}',
    clock="1/4096 ms (Turbo PMAC, I42 = 0), 1 ms with `clock: 1 ms`",
    capacity="4095.9998 ms of a move; the program's memory",
    executed="a model of the clock and of the polynomials",
    digits=8,
    axes={"strut": LETTERS, "pose": LETTERS},
    repeats=True,
    written_times=_written_times,
)
