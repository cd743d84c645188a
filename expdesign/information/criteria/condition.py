"""Condition number of F: the paper's deterministic design."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from expdesign.information.spectral import log_sum_exp


class ConditionNumber:
    """Minimise the condition number of F, by ½p⁻¹[log tr Fᵖ + log tr F⁻ᵖ]."""

    key = "condition"
    title = "condition number of F"
    larger_is_better = False
    invariant = False
    flat = False
    levels = (1.0, 4.0, 16.0)

    def value(self, eigenvalues: Array) -> float:
        """Return the ratio of the extreme eigenvalues."""
        return float(np.max(eigenvalues) / np.min(eigenvalues))

    def cost(self, logs: Array, level: float) -> tuple[float, Array, Array]:
        """Return the surrogate for p = level and its derivatives to the logarithms."""
        high, high_slope, high_curvature = log_sum_exp(logs, level)
        low, low_slope, low_curvature = log_sum_exp(logs, -level)
        return (
            (high + low) / 2,
            (high_slope + low_slope) / 2,
            (high_curvature + low_curvature) / 2,
        )

    def from_cost(self, cost: float, count: int, samples: int, log_scale: float) -> float:  # noqa: ARG002
        """Return the condition number, up to the surrogate's bluntness."""
        return float(np.exp(2 * cost))


CRITERION = ConditionNumber()
