"""Columns that several tables have: time, pose, and what there is of every strut."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from expdesign.mechanism.hexapod import POSE, numbered
from expdesign.runfolder.atomic import write_json
from expdesign.runfolder.described import Column

NAME = "columns.json"


def strutwise(prefix: str, unit: str, meaning: str, suffix: str = "") -> tuple[Column, ...]:
    """Return a column for every strut: ``q1`` … ``q6``."""
    names = enumerate(numbered(prefix, suffix), start=1)
    return tuple(Column(name, unit, f"{meaning} of strut {number}") for number, name in names)


def _derived(prefix: str, per: str, word: str) -> tuple[Column, ...]:
    return tuple(
        Column(f"{prefix}{c.name}", f"{c.unit}/{per}", f"{word} of {c.name}") for c in POSE
    )


TIME = Column("t", "s", "time from the start of the period")
POSE_COLUMNS = tuple(Column(c.name, c.unit, c.meaning) for c in POSE)
RATE_COLUMNS = _derived("d", "s", "rate")
ACCELERATION_COLUMNS = _derived("dd", "s^2", "second time derivative")

TRAJECTORY = (
    TIME,
    *POSE_COLUMNS,
    *RATE_COLUMNS,
    *ACCELERATION_COLUMNS,
    *strutwise("q", "m", "length"),
    *strutwise("dq", "m/s", "speed"),
    *strutwise("ddq", "m/s^2", "acceleration"),
    *strutwise("alpha", "rad", "first cardan angle"),
    *strutwise("beta", "rad", "second cardan angle"),
    *strutwise("Q", "N", "actuator force at the nominal parameters, positive extends,"),
)
"""Columns of `trajectory.csv`."""

MEASUREMENT = (
    Column("t", "s", "time from the start of the experiment"),
    *strutwise("q", "m", "measured length"),
    *strutwise("Q", "N", "measured actuator force, positive extends,"),
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
