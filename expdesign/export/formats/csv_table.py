"""CSV with the whole motion, all digits, and the unit in every column's name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from expdesign.export.definition import Settings, TableFormat
from expdesign.export.interpolation import Interpolation
from expdesign.export.rows import Rows, TableError
from expdesign.export.text_table import lines, numbers
from expdesign.export.whole_motion import COLUMNS

_HEADER = [f"{column.name} [{column.unit}]" for column in COLUMNS]


def _write(path: Path, rows: Rows, _settings: Settings) -> None:
    table = pd.DataFrame(
        {head: rows.record[column.name] for head, column in zip(_HEADER, COLUMNS, strict=True)}
    )
    table.to_csv(path, index=False, lineterminator="\n")


def _read(path: Path, _settings: Settings) -> Rows:
    head, *rest = lines(path) or [""]
    if head != ",".join(_HEADER):
        raise TableError("line 1: other columns than were written")
    cells = [numbers(line.split(","), len(COLUMNS), k, "cells") for k, line in enumerate(rest, 2)]
    values = np.array(cells, dtype=float).reshape(-1, len(COLUMNS))
    record = {column.name: values[:, k] for k, column in enumerate(COLUMNS)}
    lengths, rates, accelerations = (
        np.stack([record[f"{name}{j}"] for j in range(1, 7)], axis=1) for name in ("q", "dq", "ddq")
    )
    return Rows(record["t"], lengths, rates, accelerations, record).checked()


FORMAT = TableFormat(
    name="csv",
    title="CSV with the whole motion",
    suffix=".csv",
    interpolation=Interpolation.LINEAR,
    write=_write,
    read=_read,
    guide=(
        "For your own tools: one row every {step}, comma-separated, the unit in every column's "
        "name, SI units and radians, all digits. t, pose (x y z phi theta psi), its first (d…) "
        "and second (dd…) derivatives, strut lengths q1…q6 with theirs, cardan angles, expected "
        "actuator forces Q1…Q6 at the nominal parameters (positive extends). window is 1 in the "
        "measurement window."
    ),
    digits=None,
    units="m",
    angles="rad",
    axes={"strut": tuple(f"q{j}" for j in range(1, 7))},
    uniform=True,
    whole=True,
)
