"""PVT points as CSV with a header, in Zaber's grammar."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import chain, islice
from pathlib import Path

import numpy as np

from constraints.arrays import Array
from expdesign.configuration.export import STRUT_AXES, ExportSection
from expdesign.export.definition import (
    Interpolation,
    Rows,
    Settings,
    TableError,
    TableFormat,
    round_to_clock,
)
from expdesign.export.repetition import (
    collect,
    lead_files,
    read_looped,
    split_rows,
)
from expdesign.export.text_table import (
    add_times,
    every_line,
    lines_after,
    numbers,
    refuse_motion_at_end,
    write_lines,
)
from expdesign.mechanism.hexapod import ACTUATORS, actuator_names

_TIME_DIGITS = 9
_CELLS = 1 + 2 * ACTUATORS


def _header(settings: Settings) -> str:
    axes = zip(settings.axes.names, settings.axes.units, strict=True)
    return ",".join(["Time (ms)", *(f"{n} Position ({u}),{n} Velocity ({u}/s)" for n, u in axes)])


def _write(path: Path, rows: Rows, settings: Settings) -> None:
    text = every_line(rows, partial(_lines, settings=settings))
    if settings.section.looped:
        text = islice(_lines(split_rows(rows)[1], settings), 1, None)
    write_lines(path, chain([_header(settings)], text))


def _lines(part: Rows, settings: Settings) -> Iterator[str]:
    steps = 1e3 * np.diff(part.times, prepend=part.times[0])
    cells = np.stack([part.position, part.velocities], axis=2).reshape(len(steps), -1)
    for step, row in zip(steps, cells, strict=True):
        yield ",".join([f"{step:.{_TIME_DIGITS - 3}f}", *settings.numbers(row)])


def _lead(part: Rows, settings: Settings) -> Iterator[str]:
    """Yield the lines of a lead-in; those of a lead-out lack the row before it."""
    text = _lines(part, settings)
    header = _header(settings)
    return chain([header], text) if part.times[0] == 0 else chain([next(text), header], text)


def _read(path: Path, settings: Settings) -> Rows:
    message = "the header does not name time, positions and velocities"

    def read(file: Path) -> Iterator[Array]:
        return numbers(lines_after(file, _header(settings), message), _CELLS, "cells", ",", first=2)

    blocks = read_looped(path, settings, read) if settings.section.looped else read(path)
    ticks = 10**_TIME_DIGITS
    found = collect(add_times(blocks, ticks / 1000, ticks), settings)
    if found.values[0, 0] != 0:
        raise TableError("line 2: no start position at the time 0")
    rows = found.rows(found.values[:, 1::2], found.values[:, 2::2])
    refuse_motion_at_end(rows.velocities[-1], rows.count + 1)
    return rows


class PvtCsvOptions(ExportSection):
    """Options of PVT points as CSV."""

    spaces = ("strut",)
    shared = ("digits", "units", "axes", *STRUT_AXES, "repeat")


FORMAT = TableFormat(
    name="pvt-csv",
    title="PVT points as CSV (Zaber's grammar)",
    suffix=".csv",
    interpolation=Interpolation.CUBIC,
    write=_write,
    read=_read,
    options=PvtCsvOptions,
    guide='{% extends "guides/pvt-csv.txt.j2" %}',
    clock="1 ns in the file; the controller's is not known",
    capacity="points are queued as they are executed",
    executed="Zaber's `PvtSequence` reads it; a model of the polynomials",
    axes={"strut": actuator_names("S")},
    digits=8,
    repeats=True,
    companions=lead_files(".csv", _lead),
    written_times=partial(round_to_clock, ticks=10**_TIME_DIGITS),
)
