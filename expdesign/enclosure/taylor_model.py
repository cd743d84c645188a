"""Taylor models in time: polynomials with a bound on all that they leave out.

A model of a function f over a cell of time is a polynomial P and a radius r with
|f(τ) − P(τ)| ≤ r for every τ in [−1, 1], the cell's own time. Sums and products of models are
models again: what a product has beyond the highest power, and every rounding of the computer's
numbers, is added to the radius (Makino, Berz, Taylor models and other validated functional
inclusion methods, 2003). N cells are computed at once.

Rounding: an operation of IEEE 754 is wrong by at most `EPS`/2 of its result. Every operation adds
a multiple of `EPS` times the sum of the sizes that it met, which is more than all its roundings
together, and every radius is enlarged by `_UP` for those of its own computation.
"""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from expdesign.enclosure import arithmetic
from expdesign.enclosure.arithmetic import EPS, TERMS, TINY

__all__ = ["EPS", "TERMS", "TINY", "TaylorModel"]

_NEWTON_STEPS = 2


class TaylorModel:
    """A model over each of N cells.

    Attributes
    ----------
    coefficients : (k, N) or (k, 1)
        Of τ⁰ … τᵏ⁻¹, k ≤ `TERMS`; one column stands for all cells.
    radius : (N,) or (1,)
        Infinite where nothing is known.
    """

    __slots__ = ("_packed", "coefficients", "radius")

    def __init__(self, coefficients: Array, radius: Array, packed: Array | None = None) -> None:
        self.coefficients = coefficients
        self.radius = radius
        self._packed = packed

    @classmethod
    def number(cls, value: float) -> TaylorModel:
        """Return the model of a number that is known exactly, in all cells."""
        return cls(np.full((1, 1), float(value)), np.zeros(1))

    @classmethod
    def unknown(cls) -> TaylorModel:
        """Return the model of what may be anything, in all cells."""
        return cls(np.zeros((1, 1)), np.full(1, np.inf))

    @classmethod
    def within(cls, low: Array, high: Array) -> TaylorModel:
        """Return the model of what lies between two numbers, (N,) each, in every cell."""
        middle = low + (high - low) / 2
        radius = np.maximum(high - middle, middle - low)
        return cls(middle[None, :], arithmetic.all_outward(radius + EPS * np.abs(middle)))

    @classmethod
    def unpacked(cls, packed: Array, count: int) -> TaylorModel:
        """Return the model of a packed one, (TERMS + 1, N), with so many coefficients: a view."""
        return cls(packed[:count], packed[TERMS], packed)

    def write(self, packed: Array) -> int:
        """Write it into a packed model, (TERMS + 1, N); return how many coefficients it has."""
        count = len(self.coefficients)
        packed[:count] = self.coefficients
        packed[TERMS] = self.radius
        return count

    @property
    def cells(self) -> int:
        """Number of cells; 1 may stand for all."""
        return max(self.coefficients.shape[1], len(self.radius))

    def packed(self, cells: int) -> tuple[Array, int]:
        """Return it packed, (TERMS + 1, cells), only to be read, and how many coefficients it has.

        A model that is a view of a packed one is not packed again.
        """
        if self._packed is not None and self._packed.shape[1] == cells:
            return self._packed, len(self.coefficients)
        packed = np.empty((TERMS + 1, cells))
        return packed, self.write(packed)

    @property
    def size(self) -> Array:
        """(N,) what no value is larger than in size."""
        return arithmetic.size(*self.packed(self.cells))

    def bounds(self) -> tuple[Array, Array]:
        """Return what no value is below and none above, (N,) each.

        That of the first three powers together is exact, each further one counts with its size.
        Where a coefficient is too large for a number, nothing is known.
        """
        return arithmetic.bounds(*self.packed(self.cells))

    def extremes(self) -> list[Array]:
        """Return where in each cell the polynomial may be largest or smallest, τ, (N,) each.

        The middle, both ends, and where the slope is zero: found by Newton's method from the
        vertex of the first three powers, which is enough to find a good value, and proves nothing.
        """
        c = self.coefficients
        places = [np.full(c.shape[1], tau) for tau in (0.0, -1.0, 1.0)]
        if len(c) < 3:  # noqa: PLR2004 - a straight line has no vertex
            return places
        powers = np.arange(1, len(c))
        first = TaylorModel(powers[:, None] * c[1:], self.radius)
        second = TaylorModel((powers * (powers - 1))[1:, None] * c[2:], self.radius)
        with np.errstate(all="ignore"):
            place = np.clip(np.nan_to_num(-c[1] / (2 * c[2])), -1, 1)
            for _ in range(_NEWTON_STEPS):
                step = first.at(place) / second.at(place)
                place = np.clip(place - np.nan_to_num(step), -1, 1)
        return [*places, place]

    def root(self) -> Array:
        """Return where the polynomial changes its sign in each cell, τ, (N,); NaN where not sure.

        Like `extremes` this is a good place, no proof.
        """
        return arithmetic.roots(*self.packed(self.cells))

    def at(self, instants: Array) -> Array:
        """Return the polynomial's values at τ, (N,); the function's are within the radius."""
        value = np.zeros(np.broadcast_shapes(self.coefficients.shape[1:], instants.shape))
        for coefficient in self.coefficients[::-1]:
            value = value * instants + coefficient
        return value

    def __add__(self, other: TaylorModel) -> TaylorModel:
        return self._sum(other, 1.0)

    def __sub__(self, other: TaylorModel) -> TaylorModel:
        return self._sum(other, -1.0)

    def _sum(self, other: TaylorModel, sign: float) -> TaylorModel:
        cells = max(self.cells, other.cells)
        out = np.empty((TERMS + 1, cells))
        count = arithmetic.add(*self.packed(cells), *other.packed(cells), sign, out)
        return TaylorModel.unpacked(out, count)

    def __neg__(self) -> TaylorModel:
        return TaylorModel(-self.coefficients, self.radius)

    def __mul__(self, other: TaylorModel) -> TaylorModel:
        cells = max(self.cells, other.cells)
        out, room = np.empty((2, TERMS + 1, cells))
        count = arithmetic.multiply(*self.packed(cells), *other.packed(cells), out, room)
        return TaylorModel.unpacked(out, count)

    def squared(self) -> TaylorModel:
        """Return the square."""
        return self * self

    def scaled(self, factor: float) -> TaylorModel:
        """Return the model times a number that is known exactly."""
        return TaylorModel.number(factor) * self
