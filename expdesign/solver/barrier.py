"""The bounds of slacks, from below and from above, and the barrier that keeps off them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array, Mask
from expdesign.problem.design_problem import LimitedProgram

Pair = tuple[Array, Array]
"""Of the lower and of the upper bounds, each (b,)."""

_INSIDE = 1e-2
"""How far the first slacks are from their bounds, of the bound or of the distance of both."""
_FAR = 1e30


@dataclass(frozen=True)
class Bounds:
    """Bounds of everything that is bounded, (b,): variables first, then the program's rows."""

    lower: Array
    upper: Array
    variables: NDArray[np.intp]
    """Indices of the bounded variables."""
    sides: tuple[Mask, Mask]
    """Where there is a lower bound, and where there is an upper one."""

    @classmethod
    def of(cls, program: LimitedProgram) -> Bounds:
        """Return the bounds of a program."""
        bounded = np.flatnonzero(np.isfinite(program.lower) | np.isfinite(program.upper))
        lower = np.concatenate([program.lower[bounded], program.row_lower])
        upper = np.concatenate([program.upper[bounded], program.row_upper])
        # Between bounds that are one there is no inside.
        width = 1e-8 * np.maximum(1.0, np.abs(np.where(np.isfinite(lower), lower, 1.0)))
        room = np.where(upper - lower < width, width, 0.0)
        lower, upper = lower - room, upper + room
        return cls(lower, upper, bounded, (np.isfinite(lower), np.isfinite(upper)))

    def gaps(self, slacks: Array) -> Pair:
        """Return the distances to the bounds."""
        lower, upper = self.sides
        return (
            np.where(lower, slacks - self.lower, _FAR),
            np.where(upper, self.upper - slacks, _FAR),
        )

    def following(self, values: Array, slacks: Array, gaps: Pair, close: float) -> Array:
        """Return slacks that are the values themselves where these stay inside.

        There they use up no larger a share `close` of their distances (`gaps`) from the bounds.
        """
        stays = (values - self.lower >= (1 - close) * gaps[0]) | ~self.sides[0]
        stays &= (self.upper - values >= (1 - close) * gaps[1]) | ~self.sides[1]
        return np.where(stays, values, slacks)

    def off(self, slacks: Array) -> Array:
        """Return slacks that rounding may have put on a bound, taken off it."""
        near = [1e-13 * size for size in self._sizes]
        return np.clip(slacks, self.lower + near[0], self.upper - near[1])

    def inside(self, values: Array) -> Array:
        """Return the values that are nearest to given ones, a little within the bounds."""
        width = np.where(np.isfinite(self.upper - self.lower), self.upper - self.lower, np.inf)
        shift = [_INSIDE * np.minimum(size, width) for size in self._sizes]
        return np.clip(values, self.lower + shift[0], self.upper - shift[1])

    def pushes(self, gaps: Pair, barrier: float) -> Pair:
        """Return how the barrier pushes away from the bounds; 0 where there is none."""
        lower, upper = self.sides
        return np.where(lower, barrier / gaps[0], 0.0), np.where(upper, barrier / gaps[1], 0.0)

    def logarithms(self, slacks: Array) -> float:
        """Return the sum of the logarithms of the distances: the barrier is −μ times this."""
        gaps = zip(self.gaps(slacks), self.sides, strict=True)
        return sum(float(np.sum(np.log(gap), where=side)) for gap, side in gaps)

    def longest(self, close: float, distances: Pair, ways: Pair) -> float:
        """Return how far one may go, 1 at most, until so large a share of a distance is used up."""
        share = 1.0
        for side, distance, way in zip(self.sides, distances, ways, strict=True):
            nearer = side & (way < 0)
            shares = np.divide(-close * distance, way, where=nearer, out=np.ones_like(way))
            share = min(share, float(np.min(shares, initial=1.0)))
        return share

    @cached_property
    def _sizes(self) -> Pair:
        """What distances from the bounds are small compared to."""
        lower, upper = (
            np.maximum(1.0, np.abs(np.where(there, bound, 0.0)))
            for there, bound in zip(self.sides, (self.lower, self.upper), strict=True)
        )
        return lower, upper
