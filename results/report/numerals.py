"""Numbers as people read them: few digits, powers of ten, a true minus sign."""

from __future__ import annotations

import math
from decimal import Decimal

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


def duration(seconds: float) -> str:
    """Return a time as text: ``"2 min 40 s"``."""
    if seconds < _MINUTE:
        return f"{readable(seconds, 3)} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < _MINUTE:
        return f"{minutes} min {rest} s"
    return f"{minutes // 60} h {minutes % 60} min"


_MINUTE = 60


def counted(number: int, one: str, more: str = "") -> str:
    """Return a number of things as text: ``"1 design"``, ``"2 designs"``."""
    return f"{number} {one if number == 1 else more or one + 's'}"
