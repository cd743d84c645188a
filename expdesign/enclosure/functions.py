"""Functions of Taylor models: reciprocal, root, sine, arc tangent, signs, the larger of two.

A function g of a model is a polynomial that is close to it, found with the computer's numbers as
they come, and a proof of how close: of the reciprocal and the root by putting the polynomial into
their equation, of the others by the remainder of their Taylor series.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from constraints.arrays import Array, Mask
from expdesign.enclosure import arithmetic
from expdesign.enclosure.arithmetic import EPS, TERMS, TINY, invert, take_root
from expdesign.enclosure.taylor_model import TaylorModel

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
    """Return the model that a function of packed models writes."""
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
    """Return the angle of the point (x, y), rad; any angle where that may jump by a turn.

    Turned back by the angle at the middle of the cell it is small, and its series is short.
    """
    angle = np.arctan2(y.coefficients[0], x.coefficients[0])
    c, s = (_of_circle(part) for part in (np.cos(angle), np.sin(angle)))
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
    # However well the angle was computed: it is by this number that the point was turned.
    found = small + TaylorModel(angle[None, :], np.zeros(1))
    low, high = found.bounds()
    good = (low > -np.pi) & (high < np.pi) & (along.bounds()[0] > 0)
    if np.all(good):
        return found
    turn = np.full(good.shape, np.nextafter(np.pi, 4))
    return chosen(good, found, TaylorModel.within(-turn, turn))


def arc_sine(a: TaylorModel) -> TaylorModel:
    """Return the angle between −π/2 and π/2 whose sine is a."""
    return arc_tangent(a, root(TaylorModel.number(1.0) - a.squared()))


def arc_cosine(a: TaylorModel) -> TaylorModel:
    """Return the angle between 0 and π whose cosine is a."""
    return arc_tangent(root(TaylorModel.number(1.0) - a.squared()), a)


def power(a: TaylorModel, exponent: int) -> TaylorModel:
    """Return aⁿ of a whole number n."""
    if exponent < 0:
        return reciprocal(power(a, -exponent))
    found = TaylorModel.number(1.0)
    for _ in range(exponent):
        found = found * a
    return found


def sign(a: TaylorModel) -> TaylorModel:
    """Return the sign; anything from −1 to 1 in cells where a may be zero."""
    low, high = a.bounds()
    known = np.where(low > 0, 1.0, np.where(high < 0, -1.0, 0.0))
    return TaylorModel(known[None, :], np.where(known == 0, 1.0, 0.0))


def absolute(a: TaylorModel) -> TaylorModel:
    """Return the size."""
    low, high = a.bounds()
    flipped = chosen(high <= 0, -a, a)
    known = (low >= 0) | (high <= 0)
    if np.all(known):
        return flipped
    return chosen(known, flipped, TaylorModel.within(np.zeros_like(high), np.maximum(-low, high)))


def larger(a: TaylorModel, b: TaylorModel) -> TaylorModel:
    """Return the larger of two."""
    cells = max(a.cells, b.cells)
    room = np.empty((5, TERMS + 1, cells))
    count = arithmetic.larger(*a.packed(cells), *b.packed(cells), room[0], room[1:])
    return TaylorModel.unpacked(room[0], count)


def smaller(a: TaylorModel, b: TaylorModel) -> TaylorModel:
    """Return the smaller of two."""
    return -larger(-a, -b)


def chosen(which: Mask, a: TaylorModel, b: TaylorModel) -> TaylorModel:
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

    `derivatives` are g, g′, g″, … there, which come again in this order; none is larger than
    `largest` in the cell. They are wrong by `rounding` and a few units of the last digit.
    """
    distance = TaylorModel(a.coefficients.copy(), a.radius)
    distance.coefficients[0] = 0.0
    count, shares = len(derivatives), [math.factorial(k) for k in range(_POWERS + 1)]
    values = [derivatives[k % count] / share for k, share in enumerate(shares)]
    total = _polynomial(distance, values, [rounding / share for share in shares])
    beyond = distance.size ** (_POWERS + 1) / math.factorial(_POWERS + 1)
    return _with_radius(total, total.radius + largest * beyond * (1 + 16 * EPS))


def _polynomial(a: TaylorModel, values: list[Array], more: list[float]) -> TaylorModel:
    """Return c₀ + c₁ a + c₂ a² + … for numbers c, (N,) each, rounded as in `_with_rounding`."""
    numbers, room = np.empty((len(values), a.cells)), np.empty((4, TERMS + 1, a.cells))
    for k, value in enumerate(values):
        numbers[k] = value
    count = arithmetic.horner(*a.packed(a.cells), numbers, np.array(more), room[0], room[1:])
    return TaylorModel.unpacked(room[0], count)


def _with_rounding(values: Array, more: Array | float = 0.0) -> TaylorModel:
    """Return the model of numbers (N,) that were computed, wrong by a few units of the last digit.

    The exponential of NumPy is within four of them. `more` is added to the radius.
    """
    return TaylorModel(values[None, :], 8 * EPS * np.abs(values) + TINY + more)


def _of_circle(values: Array) -> TaylorModel:
    """Return the model of sines or cosines (N,) that were computed.

    Near their zeros nothing is asked of the last digit: NumPy's are within four units of that of 1.
    """
    return _with_rounding(values, 8 * EPS)


def _with_radius(model: TaylorModel, radius: Array) -> TaylorModel:
    radius = np.where(np.isnan(radius), np.inf, radius) * (1 + 16 * EPS)
    return TaylorModel(model.coefficients, radius)
