"""The ratio of the largest to the smallest singular value of a matrix in time, from above.

Turned into the singular vectors V of the middle of the cell, S = Vᵀ MᵀM V is almost diagonal. Of
its last diagonal entry s with the column b beside it and the rest C, μ is no larger than the
smallest eigenvalue where C > μ and s − μ − bᵀ(C − μ)⁻¹b ≥ 0 (Schur's complement), and the same of
the largest with the signs turned. With the gaps d of the middle, bᵀ(C − μ)⁻¹b ≤ Σ bᵢ²/dᵢ/(1 − η),
where η is by how much C − μ changes in the cell as a share of the smallest gap.

Any V will do, only that the bounds are close for those vectors. Where VᵀV is off 1 by d in norm, an
eigenvalue of S is that of MᵀM times a number between 1 − d and 1 + d (Ostrowski).
"""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from expdesign.enclosure.functions import chosen, reciprocal, root
from expdesign.enclosure.matrices import TaylorMatrix
from expdesign.enclosure.taylor_model import EPS, TaylorModel

_SMALL = 0.5


def condition_bound(matrix: TaylorMatrix) -> TaylorModel:
    """Return a model of which the condition number of a square matrix is never above its upper end.

    Its lower end says nothing. Unknown in cells where the matrix may be singular.
    """
    middle = matrix.coefficients[0]
    usable = np.all(np.isfinite(middle), axis=(1, 2))
    _, _, rows = np.linalg.svd(np.where(usable[:, None, None], middle, np.eye(middle.shape[1])))
    turn = TaylorMatrix(np.zeros_like(matrix.coefficients), np.zeros_like(matrix.radius))
    turn.coefficients[0] = rows.swapaxes(1, 2)
    off = _off_orthogonal(rows)
    turned = matrix @ turn
    gram = turned.transposed @ turned
    with np.errstate(all="ignore"):
        largest = _extreme(gram, 0, 1.0)
        smallest = _extreme(gram, middle.shape[1] - 1, -1.0)
        ratio = root(largest * reciprocal(smallest))
    # √((1 + d)/(1 − d)) ≤ 1 + 2 d for d up to a half
    grown = ratio.radius + 2 * off * ratio.size
    return TaylorModel(ratio.coefficients, np.where(usable & (off < _SMALL), grown, np.inf))


def _off_orthogonal(matrices: Array) -> Array:
    """Return how far V Vᵀ of square matrices V (N, n, n) is off 1 at most, in norm, (N,)."""
    count = matrices.shape[1]
    off = np.abs(matrices @ matrices.swapaxes(1, 2) - np.eye(count))
    return np.max(np.sum(off, axis=2), axis=1) + 8 * count**2 * EPS


def _extreme(gram: TaylorMatrix, place: int, sign: float) -> TaylorModel:
    """Return a model above the largest eigenvalue (sign 1), or below the smallest (sign −1)."""
    count = gram.radius.shape[1]
    others = [k for k in range(count) if k != place]
    own = gram[place, place]
    columns = [gram[k, place] for k in others]
    # Gaps of the middle, (N, n − 1), and by how much they change.
    diagonal = gram.coefficients[0][:, range(count), range(count)]
    gaps = sign * (diagonal[:, [place]] - diagonal[:, others])
    least = np.min(gaps, axis=1)
    inside = gram.size.copy()
    inside[:, range(count), range(count)] -= np.abs(diagonal)
    block = np.abs(inside[:, others][:, :, others])
    change = np.max(np.sum(block, axis=2), axis=1) * (1 + 1e-10) + EPS * np.max(gaps, axis=1)
    moved = TaylorModel(own.coefficients.copy(), own.radius)
    moved.coefficients[0] = 0.0
    added = TaylorModel.number(0.0)
    for k, column in enumerate(columns):
        gap = TaylorModel(np.where(gaps[:, k] > 0, gaps[:, k], 1.0)[None, :], np.zeros(1))
        added = added + column.squared() * reciprocal(gap)
    most = added.size
    share = (moved.size + 2 * most + change) / np.where(least > 0, least, np.nan)
    good = share < _SMALL
    beyond = np.where(good, most * share / (1 - np.where(good, share, 0.0)), np.inf)
    beyond *= 1 + 1e-10
    total = own + (added if sign > 0 else -added)
    isolated = total + TaylorModel((sign * np.where(good, beyond, 0.0))[None, :], np.zeros(1))
    # Gershgorin's discs, where the extreme one does not stand alone.
    beside = gram.size.copy()
    beside[:, range(count), range(count)] = 0.0
    sums = np.sum(beside, axis=2)
    discs = []
    for k in range(count):
        low, high = gram[k, k].bounds()
        discs.append(high + sums[:, k] if sign > 0 else low - sums[:, k])
    edge = np.max(discs, axis=0) if sign > 0 else np.min(discs, axis=0)
    edge += sign * 1e-13 * np.abs(edge)
    return chosen(good, isolated, TaylorModel(edge[None, :], np.zeros(1)))
