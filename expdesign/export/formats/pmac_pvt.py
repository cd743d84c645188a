"""Delta Tau and Omron PMAC: a motion program of PVT moves."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import model_validator

from constraints.arrays import Array
from expdesign.configuration.errors import refusal
from expdesign.configuration.export import PVT_OPTIONS, ExportSection
from expdesign.configuration.schema import one_of
from expdesign.export.definition import (
    Guide,
    Interpolation,
    Rows,
    Settings,
    TableError,
    TableFormat,
    edge_rows,
    on_grid,
    switched_at,
    switching,
)
from expdesign.export.text_table import lines, number, refuse_motion_at_end, write_lines
from expdesign.mechanism.hexapod import ACTUATORS

LETTERS = ("X", "Y", "Z", "A", "B", "C")
LONGEST, LONGEST_OF_TA = 4095.9998, 8_388_607
"""Of a move, ms: on a Turbo PMAC, and of a clock of whole milliseconds."""

_TICKS = 4_096_000
"""Of a second: a Turbo PMAC keeps the time of a move in 1/4096 ms."""
_PROGRAM = 10
_MOVE = re.compile(r"([A-Z])([^:\s]*):(\S*)")


def _write(path: Path, rows: Rows, settings: Settings) -> None:
    begins, ends = edge_rows(rows.times, settings.window)
    behind = switching(rows, settings, _commands(settings))
    axes = settings.axes
    start = " ".join(
        f"{a}{settings.number(v)}" for a, v in zip(axes.names, settings.start, strict=True)
    )
    units = ", ".join(f"{a} [{u}]" for a, u in zip(axes.names, axes.units, strict=True))
    text = [
        f"; {settings.title}: {units}",
        "; velocities per second: Isx90 = 1000",
        f"; start: {start}",
        f"OPEN PROG {_PROGRAM} CLEAR",
        "ABS",
        *([behind[0]] if 0 in behind else []),
    ]
    steps = np.diff(np.rint(rows.times * _ticks(settings)))
    for k, step in enumerate(steps, start=1):
        text.append(f"PVT{_milliseconds(step, settings)}")
        text.append(
            " ".join(
                f"{a}{settings.number(p)}:{settings.number(v)}"
                for a, p, v in zip(axes.names, rows.position[k], rows.velocities[k], strict=True)
            )
        )
        if k == begins:
            text.append("; measurement window begins")
        if k == ends:
            text.append("; measurement window ends")
        if k in behind:
            text.append(behind[k])
    write_lines(path, [*text, "CLOSE"])


def _ticks(settings: Settings) -> int:
    """Return the ticks of the controller's clock in a second."""
    return 1000 if getattr(settings.section, "clock", None) == "1 ms" else _TICKS


def _written_times(times: Array, settings: Settings) -> Array:
    return on_grid(_ticks(settings))(times, settings)


def _milliseconds(ticks: float, settings: Settings) -> str:
    """Return the time of a move with all its digits, so that cutting it changes nothing."""
    return f"{1000 * ticks / _ticks(settings):.12f}".rstrip("0").rstrip(".")


def _commands(settings: Settings) -> tuple[str, str]:
    """Return the assignments that wait for the beginning of the next move."""
    return f"M{settings.section.trigger}==1", f"M{settings.section.trigger}==0"


def _read(path: Path, settings: Settings) -> Rows:
    code = [
        (k, bare)
        for k, line in enumerate(lines(path), start=1)
        if (bare := line.partition(";")[0].strip())
    ]
    words = [bare for _, bare in code]
    if words[:2] != [f"OPEN PROG {_PROGRAM} CLEAR", "ABS"] or words[-1:] != ["CLOSE"]:
        raise TableError("no program: it begins with OPEN PROG … CLEAR and ABS and ends with CLOSE")
    moves: list[tuple[int, str]] = []
    switched: list[tuple[int, bool]] = []
    on, off = _commands(settings)
    for k, bare in code[2:-1]:
        if settings.section.trigger is not None and bare in (on, off):
            # Two lines a row, and the first row is the start; between them there is no command.
            switched.append((len(moves) // 2 if len(moves) % 2 == 0 else -1, bare == on))
        else:
            moves.append((k, bare))
    if not moves or len(moves) % 2:
        raise TableError("the PVT times and the moves are not as many")
    ticks = _ticks(settings)
    longest = LONGEST if ticks == _TICKS else LONGEST_OF_TA
    times, positions, rates = [0], [settings.start], [np.zeros(len(LETTERS))]
    for (k, time), (m, move) in zip(moves[::2], moves[1::2], strict=True):
        if not time.startswith("PVT"):
            raise TableError(f"line {k}: '{time[:40]}' is no PVT time")
        milliseconds = number(time.removeprefix("PVT"), k, "time")
        # The controller cuts what its clock cannot keep.
        step = math.floor(milliseconds * ticks / 1000)
        if not (step > 0 and milliseconds <= longest):
            raise TableError(f"line {k}: {milliseconds:g} ms is not between 0 and {longest} ms")
        found = [_MOVE.fullmatch(word) for word in move.split()]
        if tuple(word[1] if word else "" for word in found) != settings.axes.names:
            raise TableError(f"line {m}: not one word for each of {' '.join(settings.axes.names)}")
        pairs = [(word[2], word[3]) for word in found if word]
        times.append(times[-1] + step)
        positions.append(np.array([number(p, m, "position") for p, _ in pairs]))
        rates.append(np.array([number(v, m, "velocity") for _, v in pairs]))
    refuse_motion_at_end(rates[-1], moves[-1][0])
    stamps = np.array(times) / ticks
    trigger = switched_at(switched, stamps)
    return Rows(stamps, np.array(positions), np.array(rates), trigger=trigger).checked()


_LETTERS = tuple("ABCUVWXYZ")
Clock = Literal["1/4096 ms", "1 ms"]


class PmacOptions(ExportSection):
    """Options of a PVT motion program of the PMAC."""

    spaces = ("strut", "pose")
    shared = PVT_OPTIONS
    outputs = (0, 8191)
    """M-variable."""

    clock: Annotated[Clock, one_of(Clock)] | None = None
    """Resolution of the controller's row times; 1 ms for a PMAC that is no Turbo or has I42 = 1."""

    @model_validator(mode="after")
    def _check_axes(self) -> PmacOptions:
        unknown = [name for name in self.axes or () if name not in _LETTERS]
        if unknown:
            allowed = f"{ACTUATORS} of the letters {' '.join(_LETTERS)}"
            raise refusal(f"'{unknown[0]}' is not an axis of a PMAC", allowed, key="axes")
        return self


def _clock_values(settings: Settings) -> dict[str, str]:
    """Return the settings of the controller's clock and their reason."""
    if _ticks(settings) == _TICKS:
        return {
            "i42": "0",
            "clock": "the times of the moves have to be those of a Turbo PMAC with I42 = 0, which "
            "keeps 1/4096 ms: all are multiples of it. With I42 = 1, or another PMAC than a Turbo "
            "or Power PMAC, export with clock: 1 ms.",
        }
    return {
        "i42": "1",
        "clock": "the times of the moves are whole milliseconds. A PMAC that is no Turbo has no "
        "I42 and needs no other setting.",
    }


FORMAT = TableFormat(
    name="pmac-pvt",
    title="Delta Tau and Omron PMAC, PVT motion program",
    suffix=".pmc",
    interpolation=Interpolation.CUBIC,
    write=_write,
    read=_read,
    options=PmacOptions,
    guide=Guide(
        before=(
            "Define a coordinate system, here &1, with the axes {axes}, scaled to the units below. "
            "For a table of poses it needs your kinematic programs. Every row is a PVT move: its "
            "time in ms, then position and velocity at its end. The time unit of the velocities "
            "has to be the second, and {clock}\n\n"
            "    I5190=1000\n"
            "    I42={i42}"
        ),
        load=(
            "Download the file: it opens program 10. A Power PMAC takes it without CLEAR and with "
            "Coord[1].FeedTime=1000 instead of the settings above."
        ),
        run=(
            "Move the axes to the start one by one, wait until they are in position, and run the "
            "program:\n\n"
            "    &1 B10 R\n\n"
            "`A` aborts it."
        ),
    ),
    clock="1/4096 ms (Turbo PMAC, I42 = 0), 1 ms with `clock: 1 ms`",
    capacity="4095.9998 ms of a move; the program's memory",
    executed="a model of the clock and of the polynomials",
    digits=8,
    axes={"strut": LETTERS, "pose": LETTERS},
    written_times=_written_times,
    guide_values=_clock_values,
    trigger=(
        "M{number} is 1 from {on} s to {off} s after the start, else 0: it is assigned (==) when "
        "the move at that time begins. Let M{number} point to a digital output, as the suggested "
        "definitions of M1 to M8 do, and connect that to what records."
    ),
)
