"""Machines that are not the model: what estimates and diagnostics say of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pandas as pd

from benchmarks import coverage
from benchmarks.attribution import attribution, clean

TITLE = "Departures from the model"

Row = dict[str, Any]


def rows(section: str, repetitions: int | None = None) -> Iterator[Row]:
    """Yield the rows of a section; `repetitions` instead of what the claim is about."""
    measure, wanted = SECTIONS[section]
    return measure(repetitions or wanted)


def summary(table: pd.DataFrame) -> str:
    """Return how many claims hold."""
    held = int((table["holds"] == "yes").sum())
    broken = table[table["holds"] == "no"]
    text = f"{held} of {held + len(broken)} claims hold"
    return text if not len(broken) else f"{text}; not: " + "; ".join(broken.iloc[:, 0])


SECTIONS: dict[str, tuple[Callable[[int], Iterator[Row]], int]] = {
    "attribution": (attribution, 100),
    "attribution-clean": (clean, 200),
    **coverage.SECTIONS,
}
"""How each section is measured, and with how many repetitions."""
