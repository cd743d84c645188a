"""How far a motion's frequency keeps the multiples of it from a hum.

A hum at a multiple of the motion's frequency is the same in every period: nothing tells it from the
motion's own forces, and it biases the parameters. One line of the record's spectrum away, which is
one over the record's duration, it has a whole turn more or less in the record and averages out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array, Mask

_ROUNDING = 1e-9


@dataclass(frozen=True)
class HumDistance:
    """A hum and the multiple of a motion's frequency that is next to it."""

    frequency: float
    """Of the hum, Hz."""
    multiple: int
    distance: float
    """Hz, without a sign."""
    lines: float
    """The same in lines of the record."""

    @property
    def kept(self) -> bool:
        """True when it is one line of the record away, or more."""
        return self.lines >= 1 - _ROUNDING


@dataclass(frozen=True)
class KnownHum:
    """Frequencies that hum, and the number of periods of the record that they disturb."""

    frequencies: tuple[float, ...]
    """Hz."""
    periods: float

    def distances(self, omega: float) -> tuple[HumDistance, ...]:
        """Return how near each is to a multiple of ω, rad/s."""
        base = omega / (2 * np.pi)
        found = []
        for frequency in self.frequencies:
            turns = frequency / base
            off = abs(turns - round(turns))
            found.append(HumDistance(frequency, round(turns), off * base, off * self.periods))
        return tuple(found)

    def avoided(self, periods: Array) -> Mask:
        """Tell which lengths of a period, (K,), s, keep every hum a line away: (K,) of bool."""
        turns = np.multiply.outer(periods, np.array(self.frequencies))
        off = np.abs(turns - np.round(turns)) * self.periods
        return np.asarray(np.all(off >= 1 - _ROUNDING, axis=1))
