"""CSV with the whole motion, all digits, and the unit in every column's name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Annotated

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import schema
from expdesign.configuration.export import MOTOR_UNITS, STRUT_ONLY, ExportSection
from expdesign.export.definition import (
    LENGTH_UNITS,
    Axes,
    Interpolation,
    Rows,
    Settings,
    TableFormat,
)
from expdesign.export.repetition import collect
from expdesign.export.row_times import COLUMNS
from expdesign.export.text_table import every_line, lines_after, numbers, write_lines
from expdesign.mechanism.hexapod import ACTUATORS, actuator_names
from expdesign.runfolder.fields import Column

_KINDS = tuple(dict.fromkeys(column.name.rstrip("123456") for column in COLUMNS))
"""Names of the columns without the numbers of struts."""
_ALWAYS = ("t", "q")
_PER_TIME = dict(zip(("", "d", "dd"), ("", "/s", "/s^2"), strict=True))
"""Units of derivatives by the prefixes of their names."""
_DERIVATIVES = tuple(f"{prefix}q" for prefix in _PER_TIME)
_POSITIONS = tuple(f"{prefix}{axis}" for prefix in _PER_TIME for axis in "xyz")
_ANGLES = ("alpha", "beta")
"""Columns of struts that have the axes' order, but neither unit nor sign."""


class CsvOptions(ExportSection):
    """Options of a CSV file with the whole motion."""

    spaces = ("strut",)
    shared = ("units", *STRUT_ONLY)

    columns: (
        Annotated[
            tuple[Annotated[str, schema.one_of(_KINDS, "column")], ...],
            schema.at_least(1, "columns"),
            schema.Distinct,
        ]
        | None
    ) = None
    """Columns in addition to time and lengths, without the numbers of struts; None: all, ``q``:
    none."""


def _columns(settings: Settings) -> tuple[Column, ...]:
    """Return the columns of the file with their units."""
    unit, chosen = settings.axes.units[0], getattr(settings.section, "columns", None)
    names = "qxyz" if unit in LENGTH_UNITS else "q"
    units = {f"{d}{name}": f"{unit}{per}" for d, per in _PER_TIME.items() for name in names}
    if unit in MOTOR_UNITS:
        units["Q"] = "N m"
    return tuple(
        replace(column, unit=units.get(kind, column.unit))
        for column in COLUMNS
        if (kind := column.name.rstrip("123456")) in (*_ALWAYS, *(chosen or _KINDS))
    )


def _force_axes(settings: Settings) -> Axes:
    """Return the axes with their forces, or the torques of motors, as coordinates."""
    axes, units = settings.axes, settings.section.actuator_units(settings.task.robot.description)
    per_newton = 1 / np.array(units.si_values("N m" if axes.units[0] in MOTOR_UNITS else "N"))
    return replace(axes, factor=np.sign(axes.factor) * per_newton, zero=np.zeros(ACTUATORS))


def _scaled_positions(values: Mapping[str, Array], factor: float) -> dict[str, Array]:
    """Return the columns of the pose's positions and their derivatives, times a factor."""
    return {name: factor * values[name] for name in _POSITIONS if name in values}


def _per_metre(settings: Settings) -> float:
    """Return the file's units of length in one metre; 1 where struts have those of motors."""
    return LENGTH_UNITS.get(settings.axes.units[0], 1.0)


def _header(settings: Settings) -> str:
    return ",".join(f"{column.name} [{column.unit}]" for column in _columns(settings))


def _write(path: Path, rows: Rows, settings: Settings) -> None:
    names = [column.name for column in _columns(settings)[1:]]

    def lines_of(part: Rows) -> Iterator[str]:
        """Yield the lines of rows without their times."""
        values = dict(part.columns) | _scaled_positions(part.columns, _per_metre(settings))
        forces = np.column_stack([values[name] for name in actuator_names("Q")])
        for prefix, six in (
            *zip(_DERIVATIVES, (part.position, part.velocities, part.accelerations), strict=True),
            ("Q", _force_axes(settings).rows(part.times, forces).position),
        ):
            values |= zip(actuator_names(prefix), six.T, strict=True)
        for prefix in _ANGLES:
            struts = [values[name] for name in actuator_names(prefix)]
            ordered = (struts[strut] for strut in settings.axes.source)
            values |= zip(actuator_names(prefix), ordered, strict=True)
        for row in np.column_stack([values[name] for name in names]):
            yield ",".join(map(repr, row.tolist()))

    text = zip(rows.every_time(), every_line(rows, lines_of), strict=True)
    write_lines(path, chain([_header(settings)], (f"{time!r},{line}" for time, line in text)))


def _read(path: Path, settings: Settings) -> Rows:
    columns, axes = _columns(settings), settings.axes
    text = lines_after(path, _header(settings), "other columns than were written")
    blocks = numbers(text, len(columns), "cells", ",", first=2, timed=True)
    found = collect(((block[:, 0], block[:, 1:]) for block in blocks), settings)
    record = {column.name: found.values[:, k] for k, column in enumerate(columns[1:])}
    record |= _scaled_positions(record, 1 / _per_metre(settings))
    six = {
        kind: np.stack([record[name] for name in actuator_names(kind)], axis=1)
        for kind in (*_DERIVATIVES, *_ANGLES, "Q")
        if f"{kind}1" in record
    }
    struts = {kind: axes.derivatives(values) for kind, values in six.items()}
    struts["q"] = axes.coordinates(six["q"])
    for kind in _ANGLES:
        if kind in six:
            struts[kind] = six[kind][:, np.argsort(axes.source)]
    if "Q" in six:
        struts["Q"] = _force_axes(settings).derivatives(six["Q"])
    for kind, values in struts.items():
        record |= zip(actuator_names(kind), values.T, strict=True)
    rows = found.rows(six["q"], six.get("dq"), six.get("ddq"))
    return replace(rows, columns={"t": found.times} | record).checked()


FORMAT = TableFormat(
    name="csv",
    title="CSV with the whole motion",
    suffix=".csv",
    interpolation=Interpolation.LINEAR,
    write=_write,
    read=_read,
    options=CsvOptions,
    guide='{% extends "guides/csv.txt.j2" %}',
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
