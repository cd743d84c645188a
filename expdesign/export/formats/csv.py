"""CSV with the whole motion, all digits, and the unit in every column's name."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np

from expdesign.configuration.export import ExportSection
from expdesign.export.definition import Guide, Interpolation, Rows, Settings, TableFormat
from expdesign.export.repetition import collect
from expdesign.export.row_times import COLUMNS
from expdesign.export.text_table import every_line, lines_after, numbers, write_lines
from expdesign.mechanism.hexapod import actuator_names

_HEADER = [f"{column.name} [{column.unit}]" for column in COLUMNS]


def _write(path: Path, rows: Rows, _settings: Settings) -> None:
    text = zip(rows.every_time(), every_line(rows, _lines), strict=True)
    write_lines(path, chain([",".join(_HEADER)], (f"{time!r},{line}" for time, line in text)))


def _lines(part: Rows) -> Iterator[str]:
    """Yield the lines of rows without their times."""
    for row in np.column_stack([part.columns[column.name] for column in COLUMNS[1:]]):
        yield ",".join(map(repr, row.tolist()))


def _read(path: Path, settings: Settings) -> Rows:
    text = lines_after(path, ",".join(_HEADER), "other columns than were written")
    blocks = numbers(text, len(COLUMNS), "cells", ",", first=2, timed=True)
    found = collect(((block[:, 0], block[:, 1:]) for block in blocks), settings)
    record = {"t": found.times}
    record |= {column.name: found.values[:, k] for k, column in enumerate(COLUMNS[1:])}
    length, rate, acceleration = (
        np.stack([record[name] for name in actuator_names(prefix)], axis=1)
        for prefix in ("q", "dq", "ddq")
    )
    return replace(found.rows(length, rate, acceleration), columns=record).checked()


class CsvOptions(ExportSection):
    """Options of a CSV file with the whole motion."""

    spaces = ("strut",)


FORMAT = TableFormat(
    name="csv",
    title="CSV with the whole motion",
    suffix=".csv",
    interpolation=Interpolation.LINEAR,
    write=_write,
    read=_read,
    options=CsvOptions,
    guide=Guide(
        before=(
            "The file is for your own program, which commands the strut lengths q1…q6 of a row at "
            "its time t and nothing between: run it in a loop of {step}."
        ),
        load=(
            "One row every {step}, comma-separated, the unit in every column's name, SI units and "
            "radians, all digits. t, pose (x y z phi theta psi), its first (d…) and second (dd…) "
            "derivatives, strut lengths q1…q6 with theirs, cardan angles, expected actuator forces "
            "Q1…Q6 at the nominal parameters (positive extends).\n\n"
            "    python3 -c \"import pandas; print(pandas.read_csv('{file}').describe())\""
        ),
        run="Move the struts slowly to the first row, then begin with t = 0.",
        record="The column window is 1 in the measurement window.",
    ),
    clock="none: all digits of a double",
    capacity="that of your program",
    executed="pandas reads it; a model of the lines",
    digits=None,
    units="m",
    angles="rad",
    axes={"strut": actuator_names("q")},
    repeats=True,
    uniform=True,
    whole=True,
)
