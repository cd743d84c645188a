"""Numbers, units and names as people read them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from decimal import Decimal

import numpy as np
from numpy.typing import ArrayLike

from constraints.arrays import Array

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_FEWEST, _MOST = -4, 6
"""Exponents between which a number is written without a power of ten."""


def readable(value: float, digits: int = 4) -> str:
    """Return a number as text: ``"−0.01234"``, ``"6.704·10⁻⁷"``, ``"1667"``.

    Whole numbers keep all their digits up to six.
    """
    mantissa, exponent = parts(value, digits)
    mantissa = mantissa.replace("-", "−")
    if exponent is None:
        return mantissa
    return f"{mantissa}·10{str(exponent).translate(_SUPERSCRIPTS)}"


def parts(value: float, digits: int) -> tuple[str, int | None]:
    """Return a number's mantissa and its power of ten, None where it is written without one."""
    number = float(value)
    if not math.isfinite(number):
        return ("∞" if number > 0 else "-∞", None) if math.isinf(number) else ("–", None)
    if number == 0:
        return "0", None
    if number.is_integer() and abs(number) < 10**_MOST:
        return str(int(number)), None
    # A number that was given with fewer digits is not padded: 0.005, not 0.005000.
    given = f"{Decimal(repr(number)).normalize():e}".partition("e")[0]
    digits = min(digits, sum(letter.isdigit() for letter in given))
    scientific = f"{number:.{digits - 1}e}"
    mantissa, exponent = scientific.split("e")
    power = int(exponent)
    if _FEWEST < power < _MOST:
        return f"{number:.{max(digits - 1 - power, 0)}f}", None
    return mantissa, power


def percent(share: float, digits: int = 3) -> str:
    """Return a share as text: ``"94.6 %"``."""
    return f"{readable(100 * share, digits)} %"


def concise(value: object, std: object) -> str:
    """Return a value with its standard deviation in the last digits, or marked as fixed.

    Examples
    --------
    >>> concise(1.23451, 0.0067)
    '1.2345(67)'
    >>> concise(2.5, float("nan"))
    '2.5 fixed'
    """
    if not isinstance(value, float) or not isinstance(std, float):
        return "–" if value is None else f"{value}"
    if math.isnan(std):
        text = f"{value:.5g} fixed"
    elif not std > 0:
        text = f"{value:.6g}"
    elif (digits := 1 - math.floor(math.log10(std))) <= 0:
        text = f"{value:.0f}({std:.0f})"
    else:
        text = f"{value:.{digits}f}({std * 10**digits:.0f})"
    return text.replace("-", "−")


def duration(seconds: float) -> str:
    """Return a time as text: ``"2 min 40 s"``."""
    if seconds < _MINUTE:
        return f"{readable(seconds, 3)} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < _MINUTE:
        return f"{minutes} min {rest} s"
    return f"{minutes // 60} h {minutes % 60} min"


_MINUTE = 60


def count_text(number: int, one: str, more: str = "") -> str:
    """Return a number of things as text: ``"1 design"``, ``"2 designs"``."""
    return f"{number} {one if number == 1 else more or one + 's'}"


def range_text(row: tuple[float, float]) -> str:
    """Return bounds as text.

    Examples
    --------
    >>> range_text((-2.0, 2.0)), range_text((0.45, 0.95)), range_text((-np.inf, 10.0))
    ('±2', '0.45 … 0.95', '≤ 10')
    """
    low, high = row
    if np.isinf(low) and np.isinf(high):
        return "free"
    if np.isinf(low):
        return f"≤ {high:.6g}"
    if np.isinf(high):
        return f"≥ {low:.6g}"
    return f"±{high:.6g}" if low == -high else f"{low:.6g} … {high:.6g}"


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


# By SI unit, from large to small: smallest magnitude for which each unit is taken, symbol, factor.
_LADDERS: dict[str, tuple[tuple[float, str, float], ...]] = {
    "m": ((5.0, "m", 1.0), (1e-3, "mm", 1e3), (0.0, "µm", 1e6)),
    "m/s": ((0.1, "m/s", 1.0), (1e-4, "mm/s", 1e3), (0.0, "µm/s", 1e6)),
    "m/s^2": ((0.1, "m/s²", 1.0), (1e-4, "mm/s²", 1e3), (0.0, "µm/s²", 1e6)),
    "N": ((5e3, "kN", 1e-3), (0.1, "N", 1.0), (0.0, "mN", 1e3)),
    "rad": ((0.0, "°", float(180 / np.pi)),),
    "s": ((0.0, "s", 1.0),),
    "1": ((0.0, "", 1.0),),
}


def handy_unit(unit: str, values: ArrayLike | Iterable[float]) -> DisplayUnit:
    """Choose the unit in which values are easy to read: the largest magnitude decides.

    The unit given is the SI unit of the values, as limits state it (``"m/s^2"``); one that is not
    known is kept.

    Examples
    --------
    >>> handy_unit("m", [0.45, -0.012]).quantity(0.45)
    '450 mm'
    """
    magnitudes = np.abs(np.asarray(values, dtype=np.float64))
    largest = float(np.max(magnitudes[np.isfinite(magnitudes)], initial=0.0))
    ladder = _LADDERS.get(unit, ((0.0, unit, 1.0),))
    suitable = (rung for rung in ladder if largest >= rung[0])
    if largest == 0:
        suitable = (rung for rung in ladder if rung[2] == 1.0 or len(ladder) == 1)
    _, symbol, factor = next(suitable)
    return DisplayUnit(symbol, factor)


GREEK = {
    "alpha": (r"\alpha", "α"),
    "beta": (r"\beta", "β"),
    "phi": (r"\varphi", "φ"),
    "theta": (r"\theta", "θ"),
    "psi": (r"\psi", "ψ"),
}
"""Letters by their names: in LaTeX, and as they are."""

_INDEXED = re.compile(r"([A-Za-z])_?([A-Za-z]+|[A-Za-z]?\d+)")


def symbol(name: str) -> str:
    r"""Return a name as Matplotlib's mathematics: ``r_alpha`` → ``$r_{\alpha}$``.

    Names that are neither parameters (``p10``, ``Ixy``) nor coordinates are returned as they are.
    """
    letter, index = (GREEK.get(part, (part, part))[0] for part in symbol_parts(name))
    if index:
        return f"${letter}_{{{index}}}$"
    return f"${letter}$" if letter else name


def symbol_parts(name: str) -> tuple[str, str]:
    """Return letter and index of a name, empty where there are none: ``("r", "alpha")``."""
    if name in GREEK or (len(name) == 1 and name.isalpha()):
        return name, ""
    found = _INDEXED.fullmatch(name)
    return ("", "") if found is None else (found[1], found[2])
