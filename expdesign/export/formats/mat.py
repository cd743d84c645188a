"""MATLAB: a matrix for From Workspace and a struct with the whole motion."""

from __future__ import annotations

import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat, savemat
from scipy.io.matlab import MatReadError

from expdesign.configuration.export import STRUT_ONLY, ExportSection
from expdesign.export.definition import (
    POSE_AXES,
    Interpolation,
    Rows,
    Settings,
    TableError,
    TableFormat,
)
from expdesign.export.repetition import collect
from expdesign.export.row_times import COLUMNS
from expdesign.mechanism.hexapod import actuator_names

_AXES = 6
_UNITS = {column.name: column.unit for column in COLUMNS}
_EDGE = 1e-9
"""s; largest difference of an edge of the window."""


def _write(path: Path, rows: Rows, settings: Settings) -> None:
    axes, rows = settings.axes, rows.expanded()
    data = {
        "command": np.column_stack([rows.times, rows.position]),
        "command_axes": np.array(["t", *axes.names], dtype=object),
        "command_units": np.array(["s", *axes.units], dtype=object),
        "window": np.array([settings.window]),
        "title": settings.title,
        "motion": {name: values[:, None] for name, values in rows.columns.items()},
        "units": _UNITS,
    }
    savemat(path, data, appendmat=False, oned_as="column")


def _read(path: Path, settings: Settings) -> Rows:
    try:
        data = loadmat(path, appendmat=False)
        command, motion = data["command"], data["motion"][0, 0]
        names, units = _texts(data["command_axes"]), _texts(data["command_units"])
        record = {c.name: _column(motion[c.name]) for c in COLUMNS}
        values = np.column_stack([command[:, 1:], *[record[c.name] for c in COLUMNS[1:]]])
    except (
        MatReadError,
        zlib.error,
        OSError,
        ValueError,
        TypeError,
        KeyError,
        IndexError,
        NotImplementedError,
    ) as error:
        raise TableError(f"no MATLAB file with command and motion: {error}") from error
    if command.dtype != np.float64 or command.shape[1:] != (_AXES + 1,):
        raise TableError(f"command is no double matrix of {_AXES + 1} columns")
    if (names, units) != (["t", *settings.axes.names], ["s", *settings.axes.units]):
        raise TableError("command_axes and command_units are others than were written")
    windows = np.asarray(data.get("window"), dtype=float).ravel()
    if windows.shape != (2,) or np.any(np.abs(windows - settings.window) > _EDGE):
        raise TableError("window differs from the one that was written")
    if {name: str(unit.item()) for name, unit in _fields(data.get("units"))} != _UNITS:
        raise TableError("units are others than were written")
    if not np.array_equal(record["t"], command[:, 0]):
        raise TableError("the times of command and motion differ")
    found = collect([(command[:, 0], values)], settings)
    columns = {"t": found.times}
    columns |= {c.name: found.values[:, _AXES + k] for k, c in enumerate(COLUMNS[1:])}
    return replace(found.rows(found.values[:, :_AXES]), columns=columns).checked()


def _fields(found: Any) -> list[tuple[str, Any]]:
    """Return the fields of a struct; none of anything else."""
    names = getattr(getattr(found, "dtype", None), "names", None) or ()
    return [(name, found[0, 0][name]) for name in names]


def _texts(cells: Any) -> list[str]:
    return [str(cell.item()) for cell in cells.ravel()]


def _column(values: Any) -> Any:
    return np.asarray(values, dtype=float)[:, 0]


class MatOptions(ExportSection):
    """Options of a MAT-file."""

    spaces = ("strut", "pose")
    shared = ("space", "units", "angles", "axes", *STRUT_ONLY)


FORMAT = TableFormat(
    name="mat",
    title="MATLAB, Simulink and dSPACE",
    suffix=".mat",
    interpolation=Interpolation.LINEAR,
    write=_write,
    read=_read,
    options=MatOptions,
    guide='{% extends "guides/mat.txt.j2" %}',
    clock="none: all digits of a double",
    capacity="2 GiB of a variable: 38 million rows",
    executed="scipy.io.loadmat reads it; a model of the lines",
    digits=None,
    axes={"strut": actuator_names("S"), "pose": POSE_AXES},
    may_crash="from scipy.io import loadmat; loadmat(sys.argv[1], appendmat=False)",
    uniform=True,
    repeats=True,
    whole=True,
)
