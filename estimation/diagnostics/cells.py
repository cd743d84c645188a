"""Samples of equal phase: what repeats from period to period, and what does not.

Averaged records have the same phases in every period. In the others a cell takes the samples of
one controller step of the phase, near replicates in the sense of the lack-of-fit test. Residuals
and the columns of the model are averaged over the same cells with the same weights, so that
nothing is approximated but that the model error hardly changes within a step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from constraints.arrays import Array
from estimation.processing import NoiseEstimate


@dataclass(frozen=True, eq=False)
class PhaseCells:
    """Which cell every row belongs to.

    Attributes
    ----------
    index : (T,) of int or None
        Cell of each row; None: every row is its own cell (averaged records).
    weights : (T,)
        How many samples (or how much weight) each row stands for.
    totals : (R,)
        Weight of each cell.
    """

    index: NDArray[np.intp] | None
    weights: Array
    totals: Array

    @classmethod
    def rows(cls, weights: Array) -> PhaseCells:
        """Leave the rows as they are."""
        return cls(None, weights, weights)

    @classmethod
    def of(cls, times: Array, weights: Array, period: float, step: float) -> PhaseCells:
        """Sort rows by their phase into cells that are one step wide; s."""
        count = max(1, round(period / step))
        cell = np.floor(np.mod(times / period, 1.0) * count).astype(np.intp) % count
        used, index = np.unique(cell, return_inverse=True)
        totals = np.bincount(index, weights, minlength=len(used)).astype(np.float64)
        return cls(index, weights, totals)

    def mean(self, values: Array) -> Array:
        """Return the weighted mean in every cell, (R, …), of values (T, …)."""
        if self.index is None:
            return values
        flat = (values * self.weights.reshape(-1, *[1] * (values.ndim - 1))).reshape(
            len(values), -1
        )
        count = len(values)
        ones = np.ones(count)
        gather = sparse.csr_array((ones, (self.index, np.arange(count))), (len(self.totals), count))
        return (gather @ flat / self.totals[:, None]).reshape(-1, *values.shape[1:])

    def scatter(self, values: Array) -> NoiseEstimate | None:
        """Return the covariance of the scatter in the cells; None when no cell has two rows."""
        if self.index is None:
            return None
        freedom = float(np.sum(self.weights) - len(self.totals))
        if freedom < 1:
            return None
        rest = (values - self.mean(values)[self.index]) * np.sqrt(self.weights)[:, None]
        return NoiseEstimate(rest.T @ rest / freedom, freedom)
