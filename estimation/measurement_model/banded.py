"""Inverse of the normal equations of a spline, which have a narrow band, and a part of low rank.

With N = L Lᵀ, L of the same band, N⁻¹ is full, but equations are solved with L alone. Its blocks
about the diagonal, which the variance of a sample takes, follow from the last one backwards, in
blocks that are as wide as the band, with j = i + 1 (Takahashi, 1973):

    (N⁻¹)_ii = L_ii⁻ᵀ (1 + L_jiᵀ (N⁻¹)_jj L_ji) L_ii⁻¹,   (N⁻¹)_ji = −(N⁻¹)_jj L_ji L_ii⁻¹
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self, TypeAlias

import numpy as np
import scipy.linalg as sla
from scipy import sparse

from constraints.arrays import Array

Matrix: TypeAlias = Array | sparse.csr_array


def dense(values: Matrix) -> Array:
    """Return a matrix as an array."""
    return np.asarray(values.toarray() if isinstance(values, sparse.sparray) else values)


@dataclass(frozen=True, eq=False)
class BandedInverse:
    """N⁻¹ + R Rᵀ, (x, x), of a positive definite N with a band."""

    factor: Array
    """(b + 1, x), L by its diagonals."""
    root: Array
    """(x, r), R."""

    @classmethod
    def of(cls, matrix: Matrix, damping: float = 0.0) -> Self:
        """Factorise N, (x, x), with a diagonal that is larger by a share.

        Raises
        ------
        numpy.linalg.LinAlgError
            N is not positive definite.
        """
        entries = sparse.coo_array(matrix)
        row, column = entries.coords
        below = row >= column
        band = np.zeros((int(np.max(row - column)) + 1, matrix.shape[0]))
        band[(row - column)[below], column[below]] = entries.data[below]
        band[0] *= 1 + damping
        return cls(sla.cholesky_banded(band, lower=True), np.zeros((matrix.shape[0], 0)))

    def __matmul__(self, right: Array) -> Array:
        """Return the product with a vector, (x,), or columns, (x, t)."""
        solved = sla.cho_solve_banded((self.factor, True), right)
        return np.asarray(solved + self.root @ (self.root.T @ right))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        """Return all elements."""
        return self @ np.eye(len(self.root))

    def colour(self, white: Array) -> Array:
        """Return L⁻ᵀ z of white noise, (x, t): its covariance is N⁻¹."""
        return np.asarray(sla.lapack.dtbtrs(self.factor, white, uplo="L", trans="T")[0])

    def blocks(self, width: int, step: int) -> Array:
        """Return the blocks about the diagonal, (n, width, width), one every `step` unknowns."""
        size, wide = len(self.root), max(len(self.factor), width)
        diagonals = self.factor, -np.arange(len(self.factor))
        lower = sparse.dia_array(diagonals, shape=(size, size)).tocsr()
        result, later = np.empty(((size - width) // step + 1, width, width)), np.zeros((0, 0))
        for begin in reversed(range(0, size, wide)):
            own, after = slice(begin, begin + wide), slice(begin + wide, begin + 2 * wide)
            corner = lower[own, own].toarray()
            inverse = sla.solve_triangular(corner, np.eye(len(corner)), lower=True)
            gain = lower[after, own].toarray() @ inverse
            cross = -later @ gain
            present = inverse.T @ inverse - gain.T @ cross
            both = np.block([[present, cross.T], [cross, later]])
            for place in range(-(-begin // step), min(-(-own.stop // step), len(result))):
                part = slice(place * step - begin, place * step - begin + width)
                result[place] = both[part, part]
            later = present
        rows = step * np.arange(len(result))[:, None] + np.arange(width)
        return result + self.root[rows] @ self.root[rows].transpose(0, 2, 1)
