"""Physik Instrumente C-887: points of a wave table, one row of X Y Z U V W each."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from expdesign.export.definition import POSE_AXES, Settings, TableFormat
from expdesign.export.interpolation import Interpolation
from expdesign.export.rows import Rows, TableError
from expdesign.export.text_table import lines, numbers


def _write(path: Path, rows: Rows, settings: Settings) -> None:
    text = ("\t".join(settings.number(value) for value in row) for row in rows.position)
    path.write_text("\n".join(text) + "\n", encoding="ascii")


def _read(path: Path, settings: Settings) -> Rows:
    if settings.step is None:
        raise ValueError("the table needs a step")
    table = [
        numbers(line.split(), 6, k, "coordinates") for k, line in enumerate(lines(path), start=1)
    ]
    if not table:
        raise TableError("the table has no rows")
    return Rows(
        np.multiply(settings.step, range(len(table)), dtype=np.float64), np.array(table)
    ).checked()


FORMAT = TableFormat(
    name="pi-wave",
    title="Physik Instrumente C-887, wave generator",
    suffix=".txt",
    interpolation=Interpolation.LINEAR,
    write=_write,
    read=_read,
    guide=(
        "Load the columns into wave tables 1 to 6 (WAV … PNT) and connect them with WSL to the "
        "axes {axes}. Set the wave table rate (WTR) so that a row lasts {step}, which is the "
        "rate times the servo cycle. Move the hexapod to the start below, which is the first "
        "row, then start the generator once (WGO with one cycle, WGC 1). U, V, W are rotations "
        "about the moving axes x, y, z in this order; the pivot point is the TCP of the robot "
        "file."
    ),
    axes={"pose": POSE_AXES},
    uniform=True,
)
