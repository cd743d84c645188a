"""Arithmetic of Taylor models over N cells at once, compiled by Numba.

A packed model is an array (TERMS + 1, N): the coefficients of τ⁰ … τ⁵, then the radius. The
number of coefficients that may differ from zero is passed with it; later ones are ignored. The
rounding errors that each function adds to a radius are derived in
`expdesign.enclosure.taylor_model`.

For a short compilation, rows are assigned in loops, not as a whole.
"""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from expdesign.evaluation.compiled import compiled

TERMS = 6
"""Coefficients of a polynomial at most: powers of τ from 0 to 5."""
EPS = 2.0**-52
TINY = 1e-300
"""Bound on the loss of a few operations below the smallest normal number."""
UP = 1 + 2.0**-40
"""Factor that exceeds the roundings of a radius's own computation by NumPy."""
_UP = 1 + 2.0**-44
_ROUNDED = 4 * TERMS * EPS
_FUNCTION = 1 + 16 * EPS
_BISECTIONS = 50


@compiled
def _one() -> int:
    """Return the count 1; for a literal argument Numba compiles a function again."""
    return int(np.int64(1))


@compiled
def outward(radius: float) -> float:
    """Return a computed radius, enlarged by more than its own roundings; NaN becomes ∞."""
    grown = radius * _UP
    return grown if grown <= np.inf else np.inf


@compiled
def all_outward(radii: Array) -> Array:
    """Return radii (N,), each enlarged by more than its own roundings."""
    found = np.empty(len(radii))
    for n in range(len(radii)):
        found[n] = outward(radii[n])
    return found


@compiled
def copy(x: Array, kx: int, sign: float, out: Array) -> None:
    """Write sign x, sign ±1."""
    for k in range(kx):
        for n in range(x.shape[1]):
            out[k, n] = sign * x[k, n]
    for n in range(x.shape[1]):
        out[TERMS, n] = x[TERMS, n]


@compiled
def add(x: Array, kx: int, y: Array, ky: int, sign: float, out: Array) -> int:
    """Write x + sign y, sign ±1; return its number of coefficients."""
    cells, count, both = x.shape[1], max(kx, ky), min(kx, ky)
    radius = out[TERMS]
    radius[:] = 0.0
    # From the highest power on, as sizes are summed.
    for k in range(count - 1, -1, -1):
        row = out[k]
        if k < both:
            for n in range(cells):
                row[n] = x[k, n] + sign * y[k, n]
        elif k < kx:
            for n in range(cells):
                row[n] = x[k, n]
        else:
            for n in range(cells):
                row[n] = sign * y[k, n]
        for n in range(cells):
            radius[n] += abs(row[n])
    for n in range(cells):
        radius[n] = outward(x[TERMS, n] + y[TERMS, n] + EPS * radius[n])
    return count


@compiled
def multiply(x: Array, kx: int, y: Array, ky: int, out: Array, sizes: Array) -> int:
    """Write the product; return its number of coefficients.

    `sizes` (TERMS + 1, N) is overwritten.
    """
    if kx > ky:
        x, kx, y, ky = y, ky, x, kx
    _product_radius(x, kx, y, ky, out[TERMS], sizes)
    count = min(TERMS, kx + ky - 1)
    for k in range(count):
        row = out[k]
        first, last = max(0, k - ky + 1), min(k, kx - 1)
        for n in range(len(row)):
            row[n] = x[first, n] * y[k - first, n]
        for i in range(first + 1, last + 1):
            for n in range(len(row)):
                row[n] += x[i, n] * y[k - i, n]
    return count


@compiled
def _product_radius(x: Array, kx: int, y: Array, ky: int, radius: Array, sizes: Array) -> None:
    """Write the radius of a product, (N,).

    Powers from TERMS on are bounded: xᵢ with every yⱼ for which i + j ≥ TERMS.
    """
    cells = len(radius)
    # At j the sum of the sizes of the coefficients of y from j on; last the sum of those of x.
    for j in range(ky - 1, -1, -1):
        for n in range(cells):
            sizes[j, n] = abs(y[j, n]) + (sizes[j + 1, n] if j + 1 < ky else 0.0)
    own = sizes[TERMS]
    own[:] = 0.0
    radius[:] = 0.0
    for i in range(kx):
        if i > 0 and i + ky > TERMS:
            for n in range(cells):
                radius[n] += abs(x[i, n]) * sizes[TERMS - i, n]
        for n in range(cells):
            own[n] += abs(x[i, n])
    # The product of the sizes: after an overflow the radius is infinite.
    for n in range(cells):
        whole = sizes[0, n]
        apart = own[n] * y[TERMS, n] + _ROUNDED * (own[n] * whole)
        apart += x[TERMS, n] * (whole + y[TERMS, n]) + TINY
        radius[n] = outward(apart + radius[n])


@compiled
def horner(x: Array, kx: int, values: Array, more: Array, out: Array, room: Array) -> int:
    """Write c₀ + c₁ x + … + cₙ xⁿ; return its number of coefficients.

    `values` (n + 1, N) are computed c, with errors of a few units of the last digit and `more`,
    (n + 1,). `room` (3, TERMS + 1, N) is overwritten.
    """
    last, count = len(values) - 1, _one()
    _write_rounding(values[last], more[last], out)
    for k in range(last - 1, -1, -1):
        width = multiply(out, count, x, kx, room[0], room[1])
        _write_rounding(values[k], more[k], room[2])
        count = add(room[0], width, room[2], _one(), 1.0, out)
    return count


@compiled
def _write_rounding(values: Array, more: float, out: Array) -> None:
    for n in range(len(values)):
        out[0, n] = values[n]
        out[TERMS, n] = 8 * EPS * abs(values[n]) + TINY + more


@compiled
def roots(x: Array, kx: int) -> Array:
    """Return a sign change of each polynomial, τ, (N,), by bisection; NaN without one for sure."""
    found = np.full(x.shape[1], np.nan)
    for n in range(x.shape[1]):
        low, high, start = -1.0, 1.0, _value(x, kx, n, -1.0)
        if not start * _value(x, kx, n, 1.0) < 0:
            continue
        for _ in range(_BISECTIONS):
            middle = (low + high) / 2
            if _value(x, kx, n, middle) * start > 0:
                low = middle
            else:
                high = middle
        found[n] = (low + high) / 2
    return found


@compiled
def _value(x: Array, kx: int, n: int, tau: float) -> float:
    value = 0.0
    for k in range(kx - 1, -1, -1):
        value = value * tau + x[k, n]
    return value


@compiled
def cell_bounds(x: Array, kx: int, n: int) -> tuple[float, float]:
    """Return lower and upper bounds in cell n; infinite after an overflow.

    The range of the first three powers is exact; each further one adds its absolute value.
    """
    size, beyond = 0.0, 0.0
    for k in range(kx - 1, -1, -1):
        size += abs(x[k, n])
        if k == 3:  # noqa: PLR2004 - powers beyond the square
            beyond = size
    rest = outward(x[TERMS, n] + (4 * EPS * size + TINY + beyond))
    low, high = x[0, n] - rest, x[0, n] + rest
    slope = abs(x[1, n]) if kx > 1 else 0.0
    most, least = slope, -slope
    if kx > 2:  # noqa: PLR2004 - more than a straight line
        square = x[2, n]
        # The vertex of c₁ τ + c₂ τ², where it lies within the cell.
        # c₁² may vanish below the smallest number where c₁² / c₂ does not.
        vertex = -slope * (slope / (4 * square)) if slope < 2 * abs(square) else 0.0
        most, least = square + slope, square - slope
        if square < 0:
            most = max(most, vertex)
        elif square > 0:
            least = min(least, vertex)
    low, high = low + least, high + most
    return (low if low >= -np.inf else -np.inf), (high if high <= np.inf else np.inf)


@compiled
def bounds(x: Array, kx: int) -> tuple[Array, Array]:
    """Return lower and upper bounds, (N,) each."""
    low, high = np.empty(x.shape[1]), np.empty(x.shape[1])
    for n in range(x.shape[1]):
        low[n], high[n] = cell_bounds(x, kx, n)
    return low, high


@compiled
def size(x: Array, kx: int) -> Array:
    """Return upper bounds of the absolute values, (N,)."""
    found = np.empty(x.shape[1])
    for n in range(x.shape[1]):
        found[n] = outward(_size(x, kx, n) + x[TERMS, n])
    return found


@compiled
def _with_radius(out: Array, radius: float, n: int) -> None:
    out[TERMS, n] = np.inf if np.isnan(radius) else radius * _FUNCTION


@compiled
def _finite(out: Array, count: int) -> None:
    """Replace NaN and set its radius to zero."""
    for k in range(count):
        for n in range(out.shape[1]):
            if not np.isfinite(out[k, n]):
                out[k, n] = 0.0
    for n in range(out.shape[1]):
        out[TERMS, n] = 0.0


@compiled
def _size(x: Array, kx: int, n: int) -> float:
    """Return the sum of the absolute coefficients in cell n."""
    size = 0.0
    for k in range(kx - 1, -1, -1):
        size += abs(x[k, n])
    return size


@compiled
def invert(x: Array, kx: int, out: Array, room: Array) -> int:
    """Write 1/x, unknown in cells where x may be zero; return its number of coefficients.

    With y close to 1/x and e = 1 − x y: 1/x = y/(1 − e). `room` (3, TERMS + 1, N) is overwritten.
    """
    cells, count = x.shape[1], 1 if kx == 1 else TERMS
    for n in range(cells):
        first = 1 / x[0, n]
        out[0, n] = first
        for k in range(1, count):
            value = 0.0
            for j in range(1, min(k, kx - 1) + 1):
                value -= x[j, n] * out[k - j, n]
            out[k, n] = value * first
    _finite(out, count)
    product, error = room[0], room[1]
    width = multiply(x, kx, out, count, product, room[2])
    for n in range(cells):
        error[0, n], error[TERMS, n] = 1.0, 0.0
    # 1 − x y; x y in room[0] is not needed again.
    errors = size(room[2], add(error, _one(), product, width, -1.0, room[2]))
    for n in range(cells):
        e = errors[n]
        bound = _size(out, count, n) * e / (1 - e) if e < 1 else np.inf
        _with_radius(out, bound + TINY, n)
    return count


@compiled
def take_root(x: Array, kx: int, out: Array, room: Array) -> int:
    """Write an enclosure of √x for x ≥ 0; near zero a constant interval.

    With y close to √x: √x − y = (x − y²)/(√x + y). `room` (3, TERMS + 1, N) is overwritten.
    """
    cells, count = x.shape[1], 1 if kx == 1 else TERMS
    for n in range(cells):
        first = np.sqrt(x[0, n] if x[0, n] > 0 else 1.0)
        out[0, n] = first
        for k in range(1, count):
            value = x[k, n] if k < kx else 0.0
            for j in range(1, k):
                value -= out[j, n] * out[k - j, n]
            out[k, n] = value / (2 * first)
    _finite(out, count)
    square = room[0]
    width = multiply(out, count, out, count, square, room[2])
    errors = size(room[1], add(x, kx, square, width, -1.0, room[1]))
    for n in range(cells):
        low, high = cell_bounds(x, kx, n)
        least = cell_bounds(out, count, n)[0] + np.sqrt(max(low, 0.0)) * (1 - 2 * EPS)
        bound = errors[n] / least if low > 0 and least > 0 else np.inf
        _with_radius(out, bound + TINY, n)
        if not np.isfinite(out[TERMS, n]):
            largest = np.inf
            if high >= 0:
                largest = np.sqrt(high) * (1 + 4 * EPS) + TINY
            for k in range(1, count):
                out[k, n] = 0.0
            out[0, n] = largest / 2
            out[TERMS, n] = outward(largest - largest / 2 + EPS * (largest / 2))
    return count


@compiled
def take_larger(x: Array, kx: int, y: Array, ky: int, out: Array, room: Array) -> int:
    """Write the larger of two; return its number of coefficients.

    If neither is always larger, (x + y)/2 + |x − y|/2 with 0 ≤ |x − y| ≤ most. `room`
    (4, TERMS + 1, N) is overwritten.
    """
    cells, either, ends = x.shape[1], room[1], room[3]
    width = add(x, kx, y, ky, -1.0, room[0])
    count = add(x, kx, y, ky, 1.0, either)
    for n in range(cells):
        out[0, n], out[TERMS, n] = 0.5, 0.0
    multiply(out, _one(), either, count, room[2], ends)
    for n in range(cells):
        low, high = cell_bounds(room[0], width, n)
        most = max(-low, high)
        out[0, n], out[TERMS, n] = most / 4, most / 4 * (1 + 4 * EPS)
        ends[0, n], ends[1, n] = low, high
    add(room[2], count, out, _one(), 1.0, either)
    for n in range(cells):
        chosen, own = either, count
        if ends[0, n] >= 0:
            chosen, own = x, kx
        elif ends[1, n] <= 0:
            chosen, own = y, ky
        for k in range(count):
            out[k, n] = chosen[k, n] if k < own else 0.0
        out[TERMS, n] = chosen[TERMS, n]
    return count
