"""Matrices of Taylor models: products, and inverses that are proved.

The systems of the mechanism are solved here and not by the graph's own elimination: its pivots,
computed with bounds, would be bounds many times too wide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from expdesign.enclosure.taylor_model import EPS, TERMS, TINY, TaylorModel

_UP = 1 + 2.0**-40


@dataclass(frozen=True, eq=False)
class TaylorMatrix:
    """A matrix of models over each of N cells."""

    coefficients: Array
    """(`TERMS`, N, n, m), of τ⁰, τ¹, …"""
    radius: Array
    """(N, n, m)."""

    @classmethod
    def of(cls, models: Sequence[TaylorModel], rows: int, cells: int) -> TaylorMatrix:
        """Return the matrix of models listed column by column, as CasADi lists them."""
        columns = len(models) // rows
        coefficients = np.zeros((TERMS, cells, rows, columns))
        radius = np.zeros((cells, rows, columns))
        for k, model in enumerate(models):
            column, row = divmod(k, rows)
            coefficients[: len(model.coefficients), :, row, column] = model.coefficients
            radius[:, row, column] = model.radius
        return cls(coefficients, radius)

    def models(self) -> list[TaylorModel]:
        """Return its models column by column."""
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
        """(N, n, m), what no entry is larger than in size."""
        return np.asarray((np.sum(np.abs(self.coefficients), axis=0) + self.radius) * _UP)

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
        return TaylorMatrix(product, _known(beyond * _UP))

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
        off = (product.size + EPS) * _UP
        # Each entry of X R (1 + R + …) by sizes; the largest sum of a column is R's norm.
        norm = np.max(np.sum(off, axis=1), axis=1) * _UP
        wrong = close.size @ off * _UP
        with np.errstate(all="ignore"):
            more = np.where(norm < 1, norm / (1 - norm) * _UP, np.inf)
        radius = wrong + np.sum(wrong, axis=2, keepdims=True) * more[:, None, None]
        radius = np.where(usable[:, None, None], radius * _UP, np.inf)
        return TaylorMatrix(x, _known(radius))


def _known(radius: Array) -> Array:
    return np.where(np.isnan(radius), np.inf, radius)
