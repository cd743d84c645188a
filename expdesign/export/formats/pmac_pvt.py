"""Delta Tau and Omron PMAC: a motion program of PVT moves."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import numpy as np
from pydantic import model_validator

from expdesign.configuration.errors import refusal
from expdesign.configuration.sections.export import PVT_OPTIONS, ExportSection
from expdesign.export.definition import (
    Interpolation,
    Rows,
    Settings,
    TableError,
    TableFormat,
    edge_rows,
    round_times,
    switched_at,
    switching,
)
from expdesign.export.text_table import lines, number, refuse_motion_at_end, write_lines
from expdesign.mechanism.hexapod import ACTUATORS

LETTERS = ("X", "Y", "Z", "A", "B", "C")
LONGEST = 4095.9998
"""Of a move on a Turbo PMAC, ms."""

_TIME_DIGITS = 7
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
    for k in range(1, len(rows.times)):
        milliseconds = 1e3 * (rows.times[k] - rows.times[k - 1])
        text.append(f"PVT{milliseconds:.{_TIME_DIGITS - 3}f}")
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
    times, positions, rates = [0.0], [settings.start], [np.zeros(len(LETTERS))]
    for (k, time), (m, move) in zip(moves[::2], moves[1::2], strict=True):
        if not time.startswith("PVT"):
            raise TableError(f"line {k}: '{time[:40]}' is no PVT time")
        milliseconds = number(time.removeprefix("PVT"), k, "time")
        if not 0 < milliseconds <= LONGEST:
            raise TableError(f"line {k}: {milliseconds:g} ms is not between 0 and {LONGEST} ms")
        found = [_MOVE.fullmatch(word) for word in move.split()]
        if tuple(word[1] if word else "" for word in found) != settings.axes.names:
            raise TableError(f"line {m}: not one word for each of {' '.join(settings.axes.names)}")
        pairs = [(word[2], word[3]) for word in found if word]
        times.append(times[-1] + milliseconds / 1e3)
        positions.append(np.array([number(p, m, "position") for p, _ in pairs]))
        rates.append(np.array([number(v, m, "velocity") for _, v in pairs]))
    refuse_motion_at_end(rates[-1], moves[-1][0])
    stamps = np.round(times, _TIME_DIGITS)
    trigger = switched_at(switched, stamps)
    return Rows(stamps, np.array(positions), np.array(rates), trigger=trigger).checked()


_LETTERS = tuple("ABCUVWXYZ")


class PmacOptions(ExportSection):
    """Options of a PVT motion program of the PMAC."""

    spaces = ("strut", "pose")
    shared = PVT_OPTIONS
    outputs = (0, 8191)
    """M-variable."""

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
    guide=(
        "Define a coordinate system with the axes {axes}, scaled to the units below, and the time "
        "unit of one second (Isx90 = 1000) for the velocities. Download the file, move the axes "
        "to the start below, and run the program (`&1 B10 R`). Every row is a PVT move: its time "
        "in ms, then position and velocity at its end. Cubic interpolation must not be smoothed "
        "further (Isx50 as it is). For a table of poses the coordinate system needs your "
        "kinematic programs."
    ),
    digits=8,
    axes={"strut": LETTERS, "pose": LETTERS},
    written_times=partial(round_times, digits=_TIME_DIGITS),
    trigger=(
        "M{number} is 1 from {on} s to {off} s after the start, else 0: it is assigned (==) when "
        "the move at that time begins. Let M{number} point to a digital output, as the suggested "
        "definitions of M1 to M8 do, and connect that to what records."
    ),
)
