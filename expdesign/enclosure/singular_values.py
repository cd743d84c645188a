"""The ratio of the largest to the smallest singular value of a matrix in time, from above.

Turned into the singular vectors V of the middle of the cell, S = Vᵀ MᵀM V is almost diagonal. Of
its last diagonal entry s with the column b beside it and the rest C, μ is no larger than the
smallest eigenvalue where C > μ and s − μ − bᵀ(C − μ)⁻¹b ≥ 0 (Schur's complement), and the same of
the largest with the signs turned. With the gaps d of the middle, bᵀ(C − μ)⁻¹b ≤ Σ bᵢ²/dᵢ/(1 − η),
where η is by how much C − μ changes in the cell as a share of the smallest gap.
"""

from __future__ import annotations

import numpy as np

from expdesign.enclosure.functions import chosen, reciprocal, root
from expdesign.enclosure.matrices import TaylorMatrix
from expdesign.enclosure.taylor_model import TaylorModel

_SMALL = 0.5
_TURNED = 1e-12
"""Share by which turning with rounded singular vectors changes an eigenvalue at most."""


def condition_bound(matrix: TaylorMatrix) -> TaylorModel:
    """Return a model of which the condition number of a square matrix is never above its upper end.

    Its lower end says nothing. Unknown in cells where the matrix may be singular.
    """
    middle = matrix.coefficients[0]
    usable = np.all(np.isfinite(middle), axis=(1, 2))
    _, _, rows = np.linalg.svd(np.where(usable[:, None, None], middle, np.eye(middle.shape[1])))
    turn = TaylorMatrix(np.zeros_like(matrix.coefficients), np.zeros_like(matrix.radius))
    turn.coefficients[0] = rows.swapaxes(1, 2)
    turned = matrix @ turn
    gram = turned.transposed @ turned
    with np.errstate(all="ignore"):
        largest = _extreme(gram, 0, 1.0)
        smallest = _extreme(gram, middle.shape[1] - 1, -1.0)
        ratio = root(largest * reciprocal(smallest))
    grown = ratio.radius + _TURNED * ratio.sizes[0]
    return TaylorModel(ratio.coefficients, np.where(usable, grown, np.inf))


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
    change = np.max(np.sum(block, axis=2), axis=1) * (1 + 1e-10)
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
    size = gram.size
    sums = np.sum(size, axis=2) - size[:, range(count), range(count)]
    discs = []
    for k in range(count):
        low, high = gram[k, k].bounds()
        discs.append(high + sums[:, k] if sign > 0 else low - sums[:, k])
    edge = np.max(discs, axis=0) if sign > 0 else np.min(discs, axis=0)
    edge += sign * 1e-13 * np.abs(edge)
    return chosen(good, isolated, TaylorModel(edge[None, :], np.zeros(1)))
