"""PVT points as CSV with a header, in Zaber's grammar."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from constraints.arrays import Array
from expdesign.export.definition import Settings, TableFormat
from expdesign.export.interpolation import Interpolation
from expdesign.export.rows import Rows, TableError
from expdesign.export.text_table import lines, numbers

_TIME_DIGITS = 9
_CELLS = 13


def _written_times(times: Array) -> Array:
    return np.round(times, _TIME_DIGITS)


def _header(settings: Settings) -> str:
    axes = zip(settings.axes.names, settings.axes.units, strict=True)
    return ",".join(["Time (ms)", *(f"{n} Position ({u}),{n} Velocity ({u}/s)" for n, u in axes)])


def _write(path: Path, rows: Rows, settings: Settings) -> None:
    if rows.rate is None:
        raise ValueError("a PVT table needs velocities")
    text = [_header(settings)]
    steps = np.diff(rows.times, prepend=0.0)
    for step, position, rate in zip(steps, rows.position, rows.rate, strict=True):
        cells = [f"{1e3 * step:.{_TIME_DIGITS - 3}f}"]
        for p, v in zip(position, rate, strict=True):
            cells += [settings.number(p), settings.number(v)]
        text.append(",".join(cells))
    path.write_text("\n".join(text) + "\n", encoding="ascii")


def _read(path: Path, settings: Settings) -> Rows:
    head, *rest = lines(path) or [""]
    if head != _header(settings):
        raise TableError("line 1: the header does not name time, positions and velocities")
    table = np.array(
        [numbers(line.split(","), _CELLS, k, "cells") for k, line in enumerate(rest, start=2)]
    ).reshape(-1, _CELLS)
    if not len(table) or table[0, 0] != 0:
        raise TableError("line 2: no start position at the time 0")
    if np.any(table[-1, 2::2] != 0):
        raise TableError(f"line {len(table) + 1}: the last velocities are not 0")
    times = np.round(np.cumsum(table[:, 0]) / 1e3, _TIME_DIGITS)
    return Rows(times, table[:, 1::2], table[:, 2::2]).checked()


FORMAT = TableFormat(
    name="pvt-csv",
    title="PVT points as CSV (Zaber's grammar)",
    suffix=".csv",
    interpolation=Interpolation.CUBIC,
    write=_write,
    read=_read,
    guide=(
        "For controllers that take position, velocity and time. With a Zaber controller: "
        "`PvtSequence.load_sequence_data` reads the file. The first row, at time 0, is the start: "
        "move the axes there and let them come to rest before the sequence is submitted. "
        "Positions are absolute, times count from the row before, velocities are those at the "
        "row."
    ),
    axes={"strut": tuple(f"S{j}" for j in range(1, 7))},
    written_times=_written_times,
)
