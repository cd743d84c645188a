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

TERMS = 6
"""Coefficients of a polynomial at most: powers of τ from 0 to 5."""
EPS = 2.0**-52
TINY = 1e-300
"""More than what a few operations can lose below the smallest normal number."""
_UP = 1 + 2.0**-44
_NEWTON_STEPS = 2
_BISECTIONS = 50
_ROUNDED = 4 * TERMS * EPS


class TaylorModel:
    """A model over each of N cells.

    Attributes
    ----------
    coefficients : (k, N) or (k, 1)
        Of τ⁰ … τᵏ⁻¹, k ≤ `TERMS`; one column stands for all cells.
    radius : (N,) or (1,)
        Infinite where nothing is known.
    """

    __slots__ = ("_sizes", "coefficients", "radius")

    def __init__(self, coefficients: Array, radius: Array) -> None:
        self.coefficients = coefficients
        self.radius = radius
        self._sizes: Array | None = None

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
        return cls(middle[None, :], _outward(radius + EPS * np.abs(middle)))

    @property
    def sizes(self) -> Array:
        """(k + 1, N): at i the sum of the sizes of the coefficients from i on."""
        if self._sizes is None:
            count, cells = self.coefficients.shape
            sizes = np.empty((count + 1, cells))
            sizes[count] = 0.0
            np.abs(self.coefficients, out=sizes[:count])
            for i in range(count - 2, -1, -1):
                sizes[i] += sizes[i + 1]
            self._sizes = sizes
        return self._sizes

    @property
    def size(self) -> Array:
        """(N,) what no value is larger than in size."""
        return _outward(self.sizes[0] + self.radius)

    def bounds(self) -> tuple[Array, Array]:
        """Return what no value is below and none above, (N,) each.

        That of the first three powers together is exact, each further one counts with its size.
        Where a coefficient is too large for a number, nothing is known.
        """
        low, high = self._bounds()
        return np.fmax(low, -np.inf), np.fmin(high, np.inf)

    def _bounds(self) -> tuple[Array, Array]:
        """Return the same; NaN where a coefficient is not a number."""
        c, outside = self.coefficients, 4 * EPS * self.sizes[0] + TINY
        if len(c) > 3:  # noqa: PLR2004 - powers beyond the square
            outside = outside + self.sizes[3]
        rest = _outward(self.radius + outside)
        low, high = c[0] - rest, c[0] + rest
        if len(c) == 1:
            return low, high
        slope = np.abs(c[1])
        if len(c) == 2:  # noqa: PLR2004 - a straight line
            return low - slope, high + slope
        with np.errstate(all="ignore"):
            # The vertex of c₁ τ + c₂ τ², where it lies within the cell.
            # c₁² may vanish below the smallest number where c₁² / c₂ does not.
            vertex = np.where(slope < 2 * np.abs(c[2]), -slope * (slope / (4 * c[2])), 0.0)
            most = np.maximum(c[2] + slope, np.where(c[2] < 0, vertex, -np.inf))
            least = np.minimum(c[2] - slope, np.where(c[2] > 0, vertex, np.inf))
            return low + least, high + most

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
        ends = np.full(self.coefficients.shape[1], -1.0), np.ones(self.coefficients.shape[1])
        changes = self.at(ends[0]) * self.at(ends[1]) < 0
        found = np.full(changes.shape, np.nan)
        if not np.any(changes):
            return found
        there = TaylorModel(self.coefficients[:, changes], np.zeros(1))
        low, high = (end[changes] for end in ends)
        start = there.at(low)
        for _ in range(_BISECTIONS):
            middle = (low + high) / 2
            same = there.at(middle) * start > 0
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        found[changes] = (low + high) / 2
        return found

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
        a, b = self.coefficients, other.coefficients
        if len(a) == len(b):
            total = a + b if sign > 0 else a - b
        else:
            cells = max(a.shape[1], b.shape[1])
            both, add = min(len(a), len(b)), np.add if sign > 0 else np.subtract
            total = np.empty((max(len(a), len(b)), cells))
            add(a[:both], b[:both], out=total[:both])
            if len(a) > both:
                total[both:] = a[both:]
            else:
                np.multiply(b[both:], sign, out=total[both:])
        found = TaylorModel(total, self.radius)
        found.radius = _outward(self.radius + other.radius + EPS * found.sizes[0])
        return found

    def __neg__(self) -> TaylorModel:
        found = TaylorModel(-self.coefficients, self.radius)
        found._sizes = self._sizes
        return found

    def __mul__(self, other: TaylorModel) -> TaylorModel:
        if len(self.coefficients) > len(other.coefficients):
            return other * self
        a, b = self.coefficients, other.coefficients
        own, others = self.sizes, other.sizes
        product = a * b if len(a) == 1 else _product(a, b)
        # The product of the sizes first: where that is too large for a number, nothing is known.
        radius = own[0] * other.radius + _ROUNDED * (own[0] * others[0])
        radius = radius + self.radius * (others[0] + other.radius) + TINY
        first = max(1, TERMS + 1 - len(b))
        if first < len(a):
            # Powers from TERMS on: aᵢ with every bⱼ for which i + j ≥ TERMS.
            rest = others[TERMS - first : TERMS - len(a) : -1]
            radius = radius + np.einsum("in,in->n", np.abs(a[first:]), rest)
        return TaylorModel(product, _outward(radius))

    def squared(self) -> TaylorModel:
        """Return the square."""
        return self * self

    def scaled(self, factor: float) -> TaylorModel:
        """Return the model times a number that is known exactly."""
        return TaylorModel.number(factor) * self


def _product(a: Array, b: Array) -> Array:
    """Return the product of polynomials, up to the highest power that is kept.

    Its power k is the sum of aᵢ bₖ₋ᵢ: in one operation, on a view of b in which it lies at [i, k],
    zero where b has no such power.
    """
    count = min(TERMS, len(a) + len(b) - 1)
    padded = np.zeros((len(a) - 1 + count, b.shape[1]))
    padded[len(a) - 1 : len(a) - 1 + len(b)] = b
    row, cell = padded.strides
    shifted = np.ndarray(
        (len(a), count, b.shape[1]), np.float64, padded, (len(a) - 1) * row, (-row, row, cell)
    )
    return np.einsum("in,ikn->kn", a, shifted)


def _outward(radius: Array) -> Array:
    """Return a radius that was computed, enlarged by more than its own roundings; NaN is ∞."""
    return np.fmin(radius * _UP, np.inf)
