"""`tables/limits.csv`: the worst moment of every limit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from results.reading.table import Table


@dataclass(frozen=True)
class LimitCheck:
    """How close a limit was come to.

    Attributes
    ----------
    key : str
        The limit.
    row : str
        Component, strut or pair of struts; empty when the limit has a single row.
    unit : str
        SI unit of value and bound.
    value, bound : float
        Worst value and the bound that it comes closest to, or breaks; NaN if not finite.
    violation : float
        Excess over the bound as a share of the limit's range; negative: what is left.
    time : float
        When, s; NaN if unknown.
    """

    key: str
    row: str
    unit: str
    value: float
    bound: float
    violation: float
    time: float


def read_limit_checks(path: Path) -> tuple[LimitCheck, ...]:
    """Read the checks in the order of the file.

    Raises
    ------
    RunFolderError
        The file is missing or no such table.
    """
    names = ("value", "bound", "violation", "time")
    table = Table.read(path, ["limit", "row", "unit", *names])
    value, bound, violation, time = (table.numbers(name, blank=True).tolist() for name in names)
    texts = (table.columns[name] for name in ("limit", "row", "unit"))
    return tuple(
        LimitCheck(*row) for row in zip(*texts, value, bound, violation, time, strict=True)
    )
