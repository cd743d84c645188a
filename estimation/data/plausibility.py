"""Are the lengths those of this robot? Units are what is mistaken most often."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.configuration import LENGTH, ResolvedRobot

UNITS = ("m", "mm", "cm", "in", "ft", "µm", "dm", "km")
"""Units that are tried when the lengths do not fit, the likeliest first."""

_MARGIN = 0.1
"""By how much of the longest length the middle of a recording may be out of range: limits may be
stated for the design only, a unit is wrong by a factor of 2.5 at least."""

_LIMIT = "strut_length"


@dataclass(frozen=True, eq=False)
class LengthRange:
    """Lengths that a robot's struts can have.

    Attributes
    ----------
    lower, upper : (6,)
        m.
    origin : str
        Where they are from, for messages.
    """

    lower: Array
    upper: Array
    origin: str

    @property
    def stroke(self) -> Array:
        """(6,) m."""
        return self.upper - self.lower


def length_range(robot: ResolvedRobot) -> LengthRange:
    """Return the limits on the strut lengths; where there are none, the scale of the robot.

    That is half to twice the length at home, more than a telescope can do.
    """
    home = robot.struts_at(robot.home).lengths
    limit = robot.limits.get(_LIMIT)
    if limit is None:
        return LengthRange(home / 2, home * 2, "half to twice the lengths at home")
    lower = np.where(np.isfinite(limit.lower) & (limit.lower > 0), limit.lower, home / 2)
    upper = np.where(np.isfinite(limit.upper), limit.upper, home * 2)
    return LengthRange(lower, upper, limit.origin)


def out_of_scale(lengths: Array, allowed: LengthRange) -> NDArray[np.int64]:
    """Return the struts (from zero) whose lengths (T, 6), m, are in the middle out of range."""
    middle = np.median(lengths, axis=0)
    margin = _MARGIN * allowed.upper
    return np.flatnonzero((middle < allowed.lower - margin) | (middle > allowed.upper + margin))


def out_of_reach(lengths: Array, allowed: LengthRange) -> list[tuple[int, int]]:
    """Return (row, strut) of lengths (T, 6), m, that are beyond their range by a whole stroke."""
    lower = np.maximum(allowed.lower - allowed.stroke, 0)
    bad = (lengths <= lower) | (lengths > allowed.upper + allowed.stroke)
    return [(int(row), int(strut)) for row, strut in np.argwhere(bad)]


def fitting_unit(lengths: Array, strut: int, factor: float, allowed: LengthRange) -> str | None:
    """Return the unit that a strut's lengths would fit in, None when there is none.

    Parameters
    ----------
    lengths : (T, 6)
        m, as they are understood now.
    strut : int
        From zero.
    factor : float
        What one unit of the file is understood to be, m.
    """
    margin = _MARGIN * allowed.upper[strut]
    middle = float(np.median(lengths[:, strut])) / factor
    for unit in UNITS:
        length = middle * LENGTH.parse(f"1 {unit}")
        if allowed.lower[strut] - margin <= length <= allowed.upper[strut] + margin:
            return unit
    return None
