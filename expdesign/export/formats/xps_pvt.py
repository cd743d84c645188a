"""Newport XPS: a PVT trajectory file, one row `dt, dP1, v1, …, dP6, v6` per element."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from expdesign.export.definition import POSE_AXES, Interpolation, Rows, Settings, TableFormat
from expdesign.export.text_table import lines, numbers, refuse_motion_at_end, write_lines
from expdesign.mechanism.hexapod import ACTUATORS, numbered

_TIME_DIGITS = 8
_CELLS = 1 + 2 * ACTUATORS


def _write(path: Path, rows: Rows, settings: Settings) -> None:
    if settings.digits is None:
        raise ValueError("the table needs a number of digits")
    # Displacements are relative: those of rounded positions add up to rounded positions.
    moved = np.diff(np.round(rows.position, settings.digits), axis=0)
    steps = np.diff(rows.times)
    cells = np.stack([moved, rows.velocities[1:]], axis=2).reshape(len(steps), -1)
    text = (
        ", ".join([f"{step:.{_TIME_DIGITS}f}", *settings.numbers(row)])
        for step, row in zip(steps, cells, strict=True)
    )
    write_lines(path, text)


def _read(path: Path, settings: Settings) -> Rows:
    table = numbers(lines(path), _CELLS, "cells", ",")
    refuse_motion_at_end(table[-1, 2::2], len(table))
    times = np.round(np.concatenate([[0.0], np.cumsum(table[:, 0])]), _TIME_DIGITS)
    steps = np.concatenate([settings.start[None, :], table[:, 1::2]])
    rates = np.concatenate([np.zeros((1, ACTUATORS)), table[:, 2::2]])
    return Rows(times, np.cumsum(steps, axis=0), rates).checked()


FORMAT = TableFormat(
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
    axes={"strut": numbered("S"), "pose": POSE_AXES},
    written_times=lambda times: np.round(times, _TIME_DIGITS),
)
