"""Columns that several tables have: time, pose, and what there is of every strut."""

from __future__ import annotations

from expdesign.mechanism.hexapod import POSE, numbered
from expdesign.runfolder.described import Column


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
