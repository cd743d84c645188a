"""Weighted normal equations: what every fit solves, and how the motion is eliminated from them.

Rows are residuals r with columns U, of noise with the covariance Σ, each the mean of c samples.
In the equations of (p, ξ) the parameters meet the motion of every experiment and the motions do
not meet each other: over several experiments the matrix is an arrow, and the ξ are eliminated one
experiment at a time.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.linalg as sla

from constraints.arrays import Array
from estimation.measurement_model.motion import MotionColumns
from expdesign.information.fisher import whitening

Rows = tuple[Array, Array | MotionColumns, Array]
"""Residuals (S, 6), columns (S, 6, u), written down or not, and counts (S,)."""


class Filter(Protocol):
    """Filters series of one period, (N, 6, …)."""

    def __call__(self, values: Array) -> Array:
        """Return the filtered series."""

    def rows(self, values: Array) -> Array:
        """Return rows, (R, 6, …), with the inner products of the filtered series."""


def filtered(parts: Iterable[Rows], whitening_filter: Filter) -> Rows:
    """Put parts together and filter them; every sample is the mean of as many."""
    written = ((rest, _written(columns), counts) for rest, columns, counts in parts)
    residuals, columns, counts = (np.concatenate(each) for each in zip(*written, strict=True))
    rest, rows = whitening_filter.rows(residuals), whitening_filter.rows(columns)
    return rest, rows, np.full(len(rest), counts[0])


def _written(columns: Array | MotionColumns) -> Array:
    return columns.dense() if isinstance(columns, MotionColumns) else columns


def whitened(values: Array, white: Array, counts: Array) -> Array:
    """Return residuals (S, 6) or columns (S, 6, u) scaled to unit covariance by S: S Σ Sᵀ = 1."""
    columns = values.reshape(*values.shape[:2], int(np.prod(values.shape[2:])))
    if len(counts) and np.all(counts == counts[0]):  # one pass over large columns less
        return np.matmul(white * np.sqrt(counts[0]), columns).reshape(values.shape)
    return (np.matmul(white, columns) * np.sqrt(counts)[:, None, None]).reshape(values.shape)


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """The weighted sum of squares around where its rows were taken: cost − 2 gᵀs + sᵀ N s."""

    cost: float
    """Σ c rᵀ Σ⁻¹ r."""
    matrix: Array
    """(u, u), N = Σ c Uᵀ Σ⁻¹ U."""
    gradient: Array
    """(u,), g = Σ c Uᵀ Σ⁻¹ r."""

    @classmethod
    def of(
        cls, parts: Iterable[Rows], covariance: Array, whitening_filter: Filter | None = None
    ) -> NormalEquations:
        """Sum over the rows of one kind of channel, part by part (at least one).

        A filter makes their noise white first; it takes all samples of a period.
        """
        white = whitening(covariance)
        products = np.zeros(())
        if whitening_filter is not None:
            parts = [filtered(parts, whitening_filter)]
        for residuals, columns, counts in parts:
            if isinstance(columns, MotionColumns):
                weights = white * np.sqrt(counts)[:, None, None]
                products = products + columns.products(residuals, weights)
                continue
            both = np.concatenate([residuals[:, :, None], columns], axis=2)
            rows = whitened(both, white, counts).reshape(-1, both.shape[2])
            products = products + rows.T @ rows
        return cls(float(products[0, 0]), products[1:, 1:], products[1:, 0])

    def with_motion(self, motion: NormalEquations) -> NormalEquations:
        """Add what the lengths say of ξ, the last of the unknowns."""
        first = len(self.gradient) - len(motion.gradient)
        matrix, gradient = self.matrix.copy(), self.gradient.copy()
        matrix[first:, first:] += motion.matrix
        gradient[first:] += motion.gradient
        return NormalEquations(self.cost + motion.cost, matrix, gradient)

    def with_prior(self, precision: Array, off: Array) -> NormalEquations:
        """Add a prior of the first unknowns: its precision, (k, k), and its mean less theirs."""
        own = slice(len(off))
        matrix, gradient = self.matrix.copy(), self.gradient.copy()
        matrix[own, own] += precision
        gradient[own] += precision @ off
        return NormalEquations(self.cost + float(off @ precision @ off), matrix, gradient)

    def eliminated(self, kept: int, damping: float = 0.0) -> Elimination:
        """Eliminate all unknowns but the first `kept`.

        Raises
        ------
        numpy.linalg.LinAlgError
            ξ is not determined.
        """
        inner = self.matrix[kept:, kept:]
        outer, cross = self.matrix[:kept, :kept], self.matrix[kept:, :kept]
        if not len(inner):
            return Elimination(outer, self.gradient, cross, self.gradient[kept:])
        diagonal = np.sqrt(np.diag(inner))
        scaled = inner / np.multiply.outer(diagonal, diagonal) + damping * np.eye(len(diagonal))
        right = np.column_stack([cross, self.gradient[kept:]]) / diagonal[:, None]
        solved = sla.cho_solve(sla.cho_factor(scaled), right) / diagonal[:, None]
        slope, offset = solved[:, :-1], solved[:, -1]
        return Elimination(
            outer - cross.T @ slope, self.gradient[:kept] - cross.T @ offset, slope, offset
        )


@dataclass(frozen=True, eq=False)
class Elimination:
    """Normal equations of the parameters alone, and the motion that goes with a step s of them."""

    information: Array
    """(k, k), F_pp − F_pξ F_ξξ⁻¹ F_ξp."""
    gradient: Array
    """(k,)."""
    slope: Array
    offset: Array
    """(x, k) and (x,), the motion's step is offset − slope s."""
