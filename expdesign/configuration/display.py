"""SI values in messages, in units that users write themselves."""

from __future__ import annotations

import math

_SHOWN_AS = {
    "rad": ("deg", math.degrees(1.0)),
    "rad/s": ("deg/s", math.degrees(1.0)),
    "1": ("", 1.0),
}


def quantity_text(value: float, unit: str, digits: int = 6) -> str:
    """Return an SI value with its unit, angles in degrees: ``"15 deg"``, ``"0.33 m"``, ``"12"``.

    Parameters
    ----------
    value : float
    unit : str
        SI unit of the value, ``"1"`` for a bare number.
    digits : int
    """
    symbol, factor = _SHOWN_AS.get(unit, (unit, 1.0))
    return f"{value * factor:.{digits}g} {symbol}".rstrip()
