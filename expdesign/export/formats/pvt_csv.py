"""PVT points as CSV with a header, in Zaber's grammar."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import chain
from pathlib import Path

import numpy as np

from expdesign.configuration.export import STRUT_AXES, ExportSection
from expdesign.export.definition import (
    Guide,
    Interpolation,
    Rows,
    Settings,
    TableError,
    TableFormat,
    round_to_clock,
)
from expdesign.export.repetition import collect
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
    def lines_of(part: Rows) -> Iterator[str]:
        steps = 1e3 * np.diff(part.times, prepend=part.times[0])
        cells = np.stack([part.position, part.velocities], axis=2).reshape(len(steps), -1)
        for step, row in zip(steps, cells, strict=True):
            yield ",".join([f"{step:.{_TIME_DIGITS - 3}f}", *settings.numbers(row)])

    write_lines(path, chain([_header(settings)], every_line(rows, lines_of)))


def _read(path: Path, settings: Settings) -> Rows:
    message = "the header does not name time, positions and velocities"
    blocks = numbers(lines_after(path, _header(settings), message), _CELLS, "cells", ",", first=2)
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
    shared = ("digits", "units", "axes", *STRUT_AXES)


FORMAT = TableFormat(
    name="pvt-csv",
    title="PVT points as CSV (Zaber's grammar)",
    suffix=".csv",
    interpolation=Interpolation.CUBIC,
    write=_write,
    read=_read,
    options=PvtCsvOptions,
    guide=Guide(
        before=(
            "For controllers that take position, velocity and time, here in Zaber's grammar and "
            "with Zaber's Python library (pip install zaber-motion). Positions are absolute, times "
            "count from the row before, velocities are those at the row. Home the axes {axes}."
        ),
        load=(
            "    from zaber_motion.ascii import PvtSequence\n"
            "    data = PvtSequence.load_sequence_data('{file}').sequence_data\n"
            "    start, points = data[0], data[1:]"
        ),
        run=(
            "The first row, at time 0, is the start. Move the axes there, one by one and slowly, "
            "and let them come to rest; then submit the others. `device` is the controller of the "
            "six axes.\n\n"
            "    for k, place in enumerate(start.positions, start=1):\n"
            "        device.get_axis(k).move_absolute(place.value, place.unit)\n"
            "    sequence = device.pvt.get_sequence(1)\n"
            "    sequence.setup_live(1, 2, 3, 4, 5, 6)\n"
            "    sequence.submit_sequence_data(points)\n"
            "    sequence.wait_until_idle()\n\n"
            "`device.all_axes.stop()` stops the axes."
        ),
    ),
    clock="1 ns in the file; the controller's is not known",
    capacity="points are queued as they are executed",
    executed="Zaber's `PvtSequence` reads it; a model of the polynomials",
    axes={"strut": actuator_names("S")},
    digits=8,
    repeats=True,
    written_times=partial(round_to_clock, ticks=10**_TIME_DIGITS),
)
