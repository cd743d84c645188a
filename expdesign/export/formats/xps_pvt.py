"""Newport XPS: a PVT trajectory file, one row `dt, dP1, v1, …, dP6, v6` per element."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from constraints.arrays import Array
from expdesign.export.definition import POSE_AXES, Settings, TableFormat
from expdesign.export.interpolation import Interpolation
from expdesign.export.rows import Rows, TableError
from expdesign.export.text_table import lines, numbers

_TIME_DIGITS = 8
_CELLS = 13


def _written_times(times: Array) -> Array:
    return np.round(times, _TIME_DIGITS)


def _write(path: Path, rows: Rows, settings: Settings) -> None:
    if rows.rate is None or settings.digits is None:
        raise ValueError("a PVT table needs velocities and a number of digits")
    # Displacements are relative: those of rounded positions add up to rounded positions.
    positions = np.round(rows.position, settings.digits)
    elements = []
    for k in range(1, len(rows.times)):
        cells = [f"{rows.times[k] - rows.times[k - 1]:.{_TIME_DIGITS}f}"]
        for axis in range(6):
            cells.append(settings.number(positions[k, axis] - positions[k - 1, axis]))
            cells.append(settings.number(rows.rate[k, axis]))
        elements.append(", ".join(cells))
    path.write_text("\n".join(elements) + "\n", encoding="ascii")


def _read(path: Path, settings: Settings) -> Rows:
    table = np.array(
        [
            numbers(line.split(","), _CELLS, k, "cells")
            for k, line in enumerate(lines(path), start=1)
        ]
    )
    if not len(table):
        raise TableError("the table has no elements")
    if np.any(table[-1, 2::2] != 0):
        raise TableError(f"line {len(table)}: the last velocities are not 0")
    times = np.round(np.concatenate([[0.0], np.cumsum(table[:, 0])]), _TIME_DIGITS)
    steps = np.concatenate([settings.start[None, :], table[:, 1::2]])
    rates = np.concatenate([np.zeros((1, 6)), table[:, 2::2]])
    return Rows(times, np.cumsum(steps, axis=0), rates).checked()


FORMAT = TableFormat(
    name="xps-pvt",
    title="Newport XPS, PVT trajectory",
    suffix=".trj",
    interpolation=Interpolation.CUBIC,
    write=_write,
    read=_read,
    guide=(
        "Copy the file into the controller's folder of trajectories. Make one positioner group of "
        "the axes {axes}, in this order. Move the group to the start below, wait until it has "
        "settled, and let the controller check the file against its own limits with "
        "MultipleAxesPVTVerification. Set the gathering to the event of the trajectory, then run "
        "it with MultipleAxesPVTExecution, velocity 100 %. Displacements in the file are relative "
        "to the row before, velocities are those at the end of the row."
    ),
    digits=8,
    axes={"strut": tuple(f"S{j}" for j in range(1, 7)), "pose": POSE_AXES},
    written_times=_written_times,
)
