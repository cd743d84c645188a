"""The columns of the tables: name, unit and meaning of each, for `columns.json`."""

from __future__ import annotations

from dataclasses import dataclass


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


def column_index(tables: dict[str, tuple[Column, ...]]) -> dict[str, list[dict[str, str]]]:
    """Return unit and meaning of every column of every table, as `columns.json` states them."""
    return {
        table: [{"name": c.name, "unit": c.unit, "meaning": c.meaning} for c in columns]
        for table, columns in tables.items()
    }
