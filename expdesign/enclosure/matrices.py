"""Matrices of Taylor models: products, proved inverses and condition numbers.

The systems of the mechanism are solved here instead of by elimination in the graph, whose pivots
would have bounds that are many times too wide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from expdesign.enclosure.arithmetic import EPS, TERMS, TINY, UP
from expdesign.enclosure.taylor_model import TaylorModel, reciprocal, root, select_cells


@dataclass(frozen=True, eq=False)
class TaylorMatrix:
    """A matrix of models over each of N cells."""

    coefficients: Array
    """(`TERMS`, N, n, m), of τ⁰, τ¹, …"""
    radius: Array
    """(N, n, m)."""

    @classmethod
    def of(cls, models: Sequence[TaylorModel], rows: int, cells: int) -> TaylorMatrix:
        """Return the matrix of models in CasADi's order, column by column."""
        columns = len(models) // rows
        coefficients = np.zeros((TERMS, cells, rows, columns))
        radius = np.zeros((cells, rows, columns))
        for k, model in enumerate(models):
            column, row = divmod(k, rows)
            coefficients[: len(model.coefficients), :, row, column] = model.coefficients
            radius[:, row, column] = model.radius
        return cls(coefficients, radius)

    def models(self) -> list[TaylorModel]:
        """Return the models column by column."""
        _, _, rows, columns = self.coefficients.shape
        return [self[row, column] for column in range(columns) for row in range(rows)]

    def __getitem__(self, place: tuple[int, int]) -> TaylorModel:
        row, column = place
        coefficients = np.ascontiguousarray(self.coefficients[:, :, row, column])
        return TaylorModel(coefficients, self.radius[:, row, column].copy())

    @property
    def transposed(self) -> TaylorMatrix:
        """The transpose."""
        return TaylorMatrix(self.coefficients.swapaxes(2, 3), self.radius.swapaxes(1, 2))

    @property
    def size(self) -> Array:
        """(N, n, m), upper bounds of the absolute entries."""
        return np.asarray((np.sum(np.abs(self.coefficients), axis=0) + self.radius) * UP)

    def __matmul__(self, other: TaylorMatrix) -> TaylorMatrix:
        a, b = self.coefficients, other.coefficients
        product = np.zeros((TERMS, *a.shape[1:3], b.shape[3]))
        beyond = np.zeros(product.shape[1:])
        size_a, size_b = np.abs(a), np.abs(b)
        # (k, N, n, m): sums of sizes from each power on
        rest = np.cumsum(size_b[::-1], axis=0)[::-1]
        for i in range(TERMS):
            for j in range(TERMS - i):
                product[i + j] += a[i] @ b[j]
            if i > 0:
                beyond += size_a[i] @ rest[TERMS - i]
        whole_a, whole_b = size_a.sum(axis=0), rest[0]
        rounding = 4 * TERMS * a.shape[3] * EPS
        beyond += whole_a @ other.radius + self.radius @ (whole_b + other.radius)
        beyond += rounding * (whole_a @ whole_b) + TINY
        return TaylorMatrix(product, _is_finite(beyond * UP))

    def inverse(self) -> TaylorMatrix:
        """Return the inverse of square matrices; unknown in cells where one may be singular.

        With X close to the inverse and R = 1 − G X: G⁻¹ = X (1 + R + R² + …).
        """
        g = self.coefficients
        count = g.shape[2]
        usable = np.all(np.isfinite(g), axis=(0, 2, 3)) & (
            np.linalg.det(np.where(np.isfinite(g[0]), g[0], 0.0)) != 0
        )
        first = np.where(usable[:, None, None], g[0], np.eye(count))
        x = np.zeros_like(g)
        x[0] = np.linalg.inv(first)
        for k in range(1, TERMS):
            found = sum((g[j] @ x[k - j] for j in range(1, k + 1)), np.zeros_like(first))
            x[k] = -x[0] @ found
        x = np.where(np.isfinite(x), x, 0.0)
        close = TaylorMatrix(x, np.zeros_like(self.radius))
        product = self @ close
        product.coefficients[0] -= np.eye(count)
        off = (product.size + EPS) * UP
        # Each entry of X R (1 + R + …) by sizes; the largest sum of a column is R's norm.
        norm = np.max(np.sum(off, axis=1), axis=1) * UP
        wrong = close.size @ off * UP
        with np.errstate(all="ignore"):
            more = np.where(norm < 1, norm / (1 - norm) * UP, np.inf)
        radius = wrong + np.sum(wrong, axis=2, keepdims=True) * more[:, None, None]
        radius = np.where(usable[:, None, None], radius * UP, np.inf)
        return TaylorMatrix(x, _is_finite(radius))


def _is_finite(radius: Array) -> Array:
    return np.where(np.isnan(radius), np.inf, radius)


_SMALL = 0.5


def condition_bound(matrix: TaylorMatrix) -> TaylorModel:
    """Return a model whose upper bound is one of the condition number of a square matrix.

    Its lower bound means nothing. Unknown in cells where the matrix may be singular.
    """
    middle = matrix.coefficients[0]
    usable = np.all(np.isfinite(middle), axis=(1, 2))
    _, _, rows = np.linalg.svd(np.where(usable[:, None, None], middle, np.eye(middle.shape[1])))
    turn = TaylorMatrix(np.zeros_like(matrix.coefficients), np.zeros_like(matrix.radius))
    turn.coefficients[0] = rows.swapaxes(1, 2)
    # Upper bound of the norm of V Vᵀ − 1
    excess = np.abs(rows @ rows.swapaxes(1, 2) - np.eye(rows.shape[1]))
    off = np.max(np.sum(excess, axis=2), axis=1) + 8 * rows.shape[1] ** 2 * EPS
    turned = matrix @ turn
    gram = turned.transposed @ turned
    with np.errstate(all="ignore"):
        largest = _extreme(gram, 0, 1.0)
        smallest = _extreme(gram, middle.shape[1] - 1, -1.0)
        ratio = root(largest * reciprocal(smallest))
    # √((1 + d)/(1 − d)) ≤ 1 + 2 d for d up to a half
    grown = ratio.radius + 2 * off * ratio.size
    return TaylorModel(ratio.coefficients, np.where(usable & (off < _SMALL), grown, np.inf))


def _extreme(gram: TaylorMatrix, place: int, sign: float) -> TaylorModel:
    """Return a model above the largest eigenvalue (sign 1), or below the smallest (sign −1)."""
    count = gram.radius.shape[1]
    others = [k for k in range(count) if k != place]
    own = gram[place, place]
    columns = [gram[k, place] for k in others]
    # Gaps of the middle, (N, n − 1), and their changes.
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
    # Gershgorin's discs, if the extreme one is not isolated.
    outside = gram.size.copy()
    outside[:, range(count), range(count)] = 0.0
    sums = np.sum(outside, axis=2)
    discs = []
    for k in range(count):
        low, high = gram[k, k].bounds()
        discs.append(high + sums[:, k] if sign > 0 else low - sums[:, k])
    edge = np.max(discs, axis=0) if sign > 0 else np.min(discs, axis=0)
    edge += sign * 1e-13 * np.abs(edge)
    return select_cells(good, isolated, TaylorModel(edge[None, :], np.zeros(1)))
