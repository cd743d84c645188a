"""Taylor models in time: polynomials with a bound on their remainder.

A model of a function f over a cell of time is a polynomial P and a radius r with
|f(τ) − P(τ)| ≤ r for every τ in [−1, 1], the time scaled to the cell. Sums and products of models
are models again: the powers of a product beyond the highest one and all rounding errors are added
to the radius (Makino, Berz, Taylor models and other validated functional inclusion methods, 2003).
N cells are computed at once.

Rounding: an operation of IEEE 754 is wrong by at most `EPS`/2 of its result. Every operation adds
a multiple of `EPS` times the sum of the magnitudes of its operands, more than all its roundings
together, and every radius is enlarged by a factor for the roundings of its computation.

A function g of a model is a polynomial close to it, computed in floating point, and a proof of the
distance: of reciprocal and root by the residual of their equation, of the others by the remainder
of their Taylor series.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from constraints.arrays import Array, Mask
from expdesign.enclosure import arithmetic
from expdesign.enclosure.arithmetic import EPS, TERMS, TINY, invert, take_root

_NEWTON_STEPS = 2


class TaylorModel:
    """A model over each of N cells.

    Attributes
    ----------
    coefficients : (k, N) or (k, 1)
        Coefficients of τ⁰ … τᵏ⁻¹, k ≤ `TERMS`; a single column applies to all cells.
    radius : (N,) or (1,)
        Infinite where nothing is known.

    Examples
    --------
    >>> import numpy as np
    >>> time = TaylorModel(np.array([[0.0], [1.0]]), np.zeros(1))
    >>> low, high = (sine(time) - time).bounds()
    >>> bool(low <= np.sin(1) - 1), bool(high >= 1 - np.sin(1))
    (True, True)
    """

    __slots__ = ("_packed", "coefficients", "radius")

    def __init__(self, coefficients: Array, radius: Array, packed: Array | None = None) -> None:
        self.coefficients = coefficients
        self.radius = radius
        self._packed = packed

    @classmethod
    def number(cls, value: float) -> TaylorModel:
        """Return the model of an exact number in all cells."""
        return cls(np.full((1, 1), float(value)), np.zeros(1))

    @classmethod
    def unknown(cls) -> TaylorModel:
        """Return the model without any information, in all cells."""
        return cls(np.zeros((1, 1)), np.full(1, np.inf))

    @classmethod
    def within(cls, low: Array, high: Array) -> TaylorModel:
        """Return the model of the interval between two numbers, (N,) each, in every cell."""
        middle = low + (high - low) / 2
        radius = np.maximum(high - middle, middle - low)
        return cls(middle[None, :], arithmetic.all_outward(radius + EPS * np.abs(middle)))

    @classmethod
    def unpacked(cls, packed: Array, count: int) -> TaylorModel:
        """Return a view of a packed model, (TERMS + 1, N), with this number of coefficients."""
        return cls(packed[:count], packed[TERMS], packed)

    def write(self, packed: Array) -> int:
        """Write it into a packed model, (TERMS + 1, N); return the number of coefficients."""
        count = len(self.coefficients)
        packed[:count] = self.coefficients
        packed[TERMS] = self.radius
        return count

    @property
    def cells(self) -> int:
        """Number of cells; 1 if the model applies to all."""
        return max(self.coefficients.shape[1], len(self.radius))

    def packed(self, cells: int) -> tuple[Array, int]:
        """Return the packed model, (TERMS + 1, cells), read-only, and its number of coefficients.

        A view of a packed model is not packed again.
        """
        if self._packed is not None and self._packed.shape[1] == cells:
            return self._packed, len(self.coefficients)
        packed = np.empty((TERMS + 1, cells))
        return packed, self.write(packed)

    @property
    def size(self) -> Array:
        """(N,), upper bound of the absolute value."""
        return arithmetic.size(*self.packed(self.cells))

    def bounds(self) -> tuple[Array, Array]:
        """Return lower and upper bounds, (N,) each; infinite after an overflow.

        The range of the first three powers is exact; each further one adds its absolute value.
        """
        return arithmetic.bounds(*self.packed(self.cells))

    def extremes(self) -> list[Array]:
        """Return candidates for the extremes of the polynomial in each cell, τ, (N,) each.

        They are the middle, both ends and a zero of the slope, found by Newton's method from the
        vertex of the first three powers: good values without a proof.
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
        """Return a sign change of the polynomial in each cell, τ, (N,), or NaN; without proof."""
        return arithmetic.roots(*self.packed(self.cells))

    def at(self, instants: Array) -> Array:
        """Return the polynomial's values at τ, (N,); the function is within the radius of them."""
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


_POWERS = TERMS + 2
"""Powers of a series in the model itself: its range within a cell is small."""


def reciprocal(a: TaylorModel) -> TaylorModel:
    """Return 1/a; unknown in cells where a may be zero."""
    return _build_model(invert, a)


def divide(a: TaylorModel, b: TaylorModel) -> TaylorModel:
    """Return a/b; unknown in cells where b may be zero."""
    return a * reciprocal(b)


def root(a: TaylorModel) -> TaylorModel:
    """Return √a for a ≥ 0; near zero a constant interval."""
    return _build_model(take_root, a)


def _build_model(write: Callable[[Array, int, Array, Array], int], a: TaylorModel) -> TaylorModel:
    """Return the model written by a function of packed models."""
    room = np.empty((4, TERMS + 1, a.cells))
    return TaylorModel.unpacked(room[0], write(*a.packed(a.cells), room[0], room[1:]))


def sine(a: TaylorModel) -> TaylorModel:
    """Return sin a, a in rad."""
    middle = a.coefficients[0]
    sin, cos = np.sin(middle), np.cos(middle)
    return _series(a, [sin, cos, -sin, -cos], np.ones(1), 8 * EPS)


def cosine(a: TaylorModel) -> TaylorModel:
    """Return cos a, a in rad."""
    middle = a.coefficients[0]
    sin, cos = np.sin(middle), np.cos(middle)
    return _series(a, [cos, -sin, -cos, sin], np.ones(1), 8 * EPS)


def exponential(a: TaylorModel) -> TaylorModel:
    """Return eᵃ."""
    value = np.exp(a.coefficients[0])
    return _series(a, [value], np.exp(a.bounds()[1]) * (1 + 8 * EPS))


def arc_tangent(y: TaylorModel, x: TaylorModel) -> TaylorModel:
    """Return the angle of the point (x, y), rad; any angle where it may jump by a turn.

    Relative to the angle at the middle of the cell it is small, and its series is short.
    """
    angle = np.arctan2(y.coefficients[0], x.coefficients[0])
    # NumPy's sine and cosine are accurate to four units of the last digit of 1, also near zeros.
    c, s = (
        TaylorModel(part[None, :], 8 * EPS * np.abs(part) + TINY + 8 * EPS)
        for part in (np.cos(angle), np.sin(angle))
    )
    along, across = x * c + y * s, y * c - x * s
    tangent = across * reciprocal(along)
    square = tangent.squared()
    # q (1 − q²/3 + q⁴/5 − …): alternating, so that the next term bounds the rest where |q| < 1.
    last = _POWERS // 2
    values = [np.full(1, (-1.0) ** k / (2 * k + 1)) for k in range(last + 1)]
    total = _polynomial(square, values, [0.0] * (last + 1)) * tangent
    largest = tangent.size
    radius = total.radius + np.where(
        largest < 1, largest ** (2 * last + 3) / (2 * last + 3), np.inf
    )
    small = TaylorModel(total.coefficients, radius)
    # The accuracy of the angle does not matter: the point was rotated by this very number.
    found = small + TaylorModel(angle[None, :], np.zeros(1))
    low, high = found.bounds()
    good = (low > -np.pi) & (high < np.pi) & (along.bounds()[0] > 0)
    if np.all(good):
        return found
    turn = np.full(good.shape, np.nextafter(np.pi, 4))
    return select_cells(good, found, TaylorModel.within(-turn, turn))


def arc_sine(a: TaylorModel) -> TaylorModel:
    """Return the angle between −π/2 and π/2 whose sine is a."""
    return arc_tangent(a, root(TaylorModel.number(1.0) - a.squared()))


def arc_cosine(a: TaylorModel) -> TaylorModel:
    """Return the angle between 0 and π whose cosine is a."""
    return arc_tangent(root(TaylorModel.number(1.0) - a.squared()), a)


def sign(a: TaylorModel) -> TaylorModel:
    """Return the sign; anything from −1 to 1 in cells where a may be zero."""
    low, high = a.bounds()
    known = np.where(low > 0, 1.0, np.where(high < 0, -1.0, 0.0))
    return TaylorModel(known[None, :], np.where(known == 0, 1.0, 0.0))


def absolute(a: TaylorModel) -> TaylorModel:
    """Return the absolute value."""
    low, high = a.bounds()
    flipped = select_cells(high <= 0, -a, a)
    known = (low >= 0) | (high <= 0)
    if np.all(known):
        return flipped
    return select_cells(
        known, flipped, TaylorModel.within(np.zeros_like(high), np.maximum(-low, high))
    )


def select_cells(which: Mask, a: TaylorModel, b: TaylorModel) -> TaylorModel:
    """Return a in the cells of a mask (N,), b in the others."""
    if np.all(which):
        return a
    if not np.any(which):
        return b
    cells = len(which)
    coefficients = np.zeros((max(len(a.coefficients), len(b.coefficients)), cells))
    coefficients[: len(a.coefficients)] = np.where(which, a.coefficients, 0.0)
    coefficients[: len(b.coefficients)] += np.where(which, 0.0, b.coefficients)
    return TaylorModel(coefficients, np.where(which, a.radius, b.radius))


def _series(
    a: TaylorModel, derivatives: list[Array], largest: Array, rounding: float = 0.0
) -> TaylorModel:
    """Return g(a) by the Taylor series of g about the middle of each cell.

    `derivatives` are g, g′, g″, … there, repeated periodically; `largest` bounds them in the cell.
    Their errors are at most `rounding` and a few units of the last digit.
    """
    distance = TaylorModel(a.coefficients.copy(), a.radius)
    distance.coefficients[0] = 0.0
    count, shares = len(derivatives), [math.factorial(k) for k in range(_POWERS + 1)]
    values = [derivatives[k % count] / share for k, share in enumerate(shares)]
    total = _polynomial(distance, values, [rounding / share for share in shares])
    beyond = distance.size ** (_POWERS + 1) / math.factorial(_POWERS + 1)
    radius = total.radius + largest * beyond * (1 + 16 * EPS)
    radius = np.where(np.isnan(radius), np.inf, radius) * (1 + 16 * EPS)
    return TaylorModel(total.coefficients, radius)


def _polynomial(a: TaylorModel, values: list[Array], more: list[float]) -> TaylorModel:
    """Return c₀ + c₁ a + c₂ a² + … for computed numbers c, (N,) each."""
    numbers, room = np.empty((len(values), a.cells)), np.empty((4, TERMS + 1, a.cells))
    for k, value in enumerate(values):
        numbers[k] = value
    count = arithmetic.horner(*a.packed(a.cells), numbers, np.array(more), room[0], room[1:])
    return TaylorModel.unpacked(room[0], count)
