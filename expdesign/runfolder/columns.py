"""The columns of the tables: name, unit and meaning of each, for `columns.json`."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from expdesign.runfolder.atomic import write_json

NAME = "columns.json"


@dataclass(frozen=True)
class Column:
    """One column of a table. Values are SI and radians."""

    name: str
    unit: str
    meaning: str


_POSE = (
    ("x", "m", "TCP position x, base frame"),
    ("y", "m", "TCP position y, base frame"),
    ("z", "m", "TCP position z, base frame"),
    ("phi", "rad", "rotation φ about x"),
    ("theta", "rad", "rotation θ about the moved y"),
    ("psi", "rad", "rotation ψ about the moved z"),
)
_STRUTS = range(1, 7)


def _derived(prefix: str, per: str, word: str) -> list[Column]:
    return [
        Column(f"{prefix}{name}", f"{unit}/{per}", f"{word} of {name}") for name, unit, _ in _POSE
    ]


def _strutwise(prefix: str, unit: str, meaning: str) -> list[Column]:
    return [Column(f"{prefix}{j}", unit, f"{meaning} of strut {j}") for j in _STRUTS]


TIME = Column("t", "s", "time from the start of the period")

TRAJECTORY = (
    TIME,
    *(Column(*entry) for entry in _POSE),
    *_derived("d", "s", "rate"),
    *_derived("dd", "s^2", "second time derivative"),
    *_strutwise("q", "m", "length"),
    *_strutwise("dq", "m/s", "speed"),
    *_strutwise("ddq", "m/s^2", "acceleration"),
    *_strutwise("alpha", "rad", "first cardan angle"),
    *_strutwise("beta", "rad", "second cardan angle"),
    *_strutwise("Q", "N", "actuator force at the nominal parameters, positive extends,"),
)
"""Columns of `trajectory.csv`."""

MEASUREMENT = (
    Column("t", "s", "time from the start of the experiment"),
    *_strutwise("q", "m", "measured length"),
    *_strutwise("Q", "N", "measured actuator force, positive extends,"),
    Column("period", "1", "number of the period, from 1"),
)
"""Columns of `measurement.csv`; the last one is optional in a file that is read."""


def column_index(tables: dict[str, tuple[Column, ...]]) -> dict[str, list[dict[str, str]]]:
    """Return unit and meaning of every column of every table, as `columns.json` states them."""
    return {
        table: [{"name": c.name, "unit": c.unit, "meaning": c.meaning} for c in columns]
        for table, columns in tables.items()
    }


def add_columns(folder: Path, tables: dict[str, tuple[Column, ...]]) -> Path:
    """Write the columns of these tables to `columns.json`, beside those that stand there already.

    Returns
    -------
    Path
        The file.
    """
    path = folder / NAME
    write_json(path, _known(path) | column_index(tables))
    return path


def _known(path: Path) -> dict[str, Any]:
    """Return what the file says, nothing when it cannot be used."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return data if isinstance(data, dict) else {}
