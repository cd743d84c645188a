"""Units in which SI values are shown."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from constraints.arrays import Array


@dataclass(frozen=True)
class DisplayUnit:
    """A unit on an axis: shown value = factor · SI value; no symbol for numbers without a unit."""

    symbol: str
    factor: float

    def shown(self, values: ArrayLike) -> Array:
        """Convert SI values."""
        return self.factor * np.asarray(values, dtype=np.float64)

    def label(self, text: str) -> str:
        """Return the text of an axis: ``"Strut length (mm)"``."""
        return f"{text} ({self.symbol})" if self.symbol else text

    def number(self, value: float, digits: int = 4) -> str:
        """Return one SI value as text, without the unit: ``"450"``."""
        return plain_number(self.factor * value, digits)

    def quantity(self, value: float, digits: int = 4) -> str:
        """Return one SI value as text, with the unit: ``"450 mm"``."""
        space = "" if self.symbol in ("", "°") else " "
        return f"{self.number(value, digits)}{space}{self.symbol}"


def plain_number(value: float, digits: int = 4) -> str:
    """Return a number with a true minus sign."""
    return f"{value:.{digits}g}".replace("-", "−")


# By SI unit, from large to small: the smallest magnitude for which each unit is taken.
_LADDERS: dict[str, tuple[tuple[float, DisplayUnit], ...]] = {
    "m": (
        (5.0, DisplayUnit("m", 1.0)),
        (1e-3, DisplayUnit("mm", 1e3)),
        (0.0, DisplayUnit("µm", 1e6)),
    ),
    "m/s": (
        (0.1, DisplayUnit("m/s", 1.0)),
        (1e-4, DisplayUnit("mm/s", 1e3)),
        (0.0, DisplayUnit("µm/s", 1e6)),
    ),
    "m/s^2": (
        (0.1, DisplayUnit("m/s²", 1.0)),
        (1e-4, DisplayUnit("mm/s²", 1e3)),
        (0.0, DisplayUnit("µm/s²", 1e6)),
    ),
    "N": (
        (5e3, DisplayUnit("kN", 1e-3)),
        (0.1, DisplayUnit("N", 1.0)),
        (0.0, DisplayUnit("mN", 1e3)),
    ),
    "rad": ((0.0, DisplayUnit("°", float(180 / np.pi))),),
    "s": ((0.0, DisplayUnit("s", 1.0)),),
    "1": ((0.0, DisplayUnit("", 1.0)),),
}


def handy_unit(unit: str, values: ArrayLike | Iterable[float]) -> DisplayUnit:
    """Choose the unit in which values are easy to read: the largest magnitude decides.

    The unit given is the SI unit of the values, as limits state it (``"m/s^2"``); one that is not
    known is kept.
    """
    magnitudes = np.abs(np.asarray(values, dtype=np.float64))
    largest = float(np.max(magnitudes[np.isfinite(magnitudes)], initial=0.0))
    if unit not in _LADDERS:
        return DisplayUnit(unit, 1.0)
    ladder = _LADDERS[unit]
    if largest == 0:
        return next((rung for _, rung in ladder if rung.factor == 1.0), ladder[0][1])
    return next(rung for least, rung in ladder if largest >= least)
