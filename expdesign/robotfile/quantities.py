"""Numbers as people write them: with a unit, and the same to the last bit when they are read."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from expdesign.configuration.values.quantity import dimension_of

_WRITTEN_IN = {"m": ("mm", 1e3), "m/s": ("mm/s", 1e3), "rad": ("deg", math.degrees(1.0))}
_DIGITS = (6, 9, 12, 15, 17)


def written(value: float, unit: str) -> str:
    """Return an SI value as it can stand in a YAML file: ``150 mm``, ``30 deg``, ``0.0517``."""
    number = float(value)
    if not math.isfinite(number):
        return str(number)  # which no file takes: the message is that of the key
    if number == 0 or unit == "1":
        return f"{number:g}" if number == 0 else _shortest(number)
    dimension = dimension_of(unit)
    symbol, factor = _WRITTEN_IN.get(unit, (unit, 1.0))
    for digits in _DIGITS:
        text = f"{number * factor:.{digits}g} {symbol}"
        if dimension.parse(text) == number:
            return text
    return _shortest(number)


def _shortest(number: float) -> str:
    """Return all digits of a number in a form that YAML takes for one: with a point before an e."""
    text = repr(number)
    if "e" in text and "." not in text:
        return text.replace("e", ".0e")
    return text.removesuffix(".0")


def rounded(value: float, digits: int = 12) -> float:
    """Return a number to so many digits: the default takes the noise of the last ones away."""
    return float(f"{value:.{digits}g}")


def flow(value: Any, unit: str) -> str:
    """Return numbers, or lists and mappings of them, on one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {flow(item, unit)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(flow(item, unit) for item in value) + "]"
    return value if isinstance(value, str) else written(value, unit)
