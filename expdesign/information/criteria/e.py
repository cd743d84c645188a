"""E: smallest eigenvalue of F, the worst known combination in the stated scaling."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from expdesign.information.spectral import log_sum_exp


class EOptimality:
    """Maximise the smallest eigenvalue, by the power norm log tr(F⁻ᵖ)/p."""

    key = "e"
    title = "smallest eigenvalue of F"
    larger_is_better = True
    invariant = False
    flat = True
    levels = (1.0, 4.0, 16.0)

    def value(self, eigenvalues: Array) -> float:
        """Return the smallest eigenvalue."""
        return float(np.min(eigenvalues))

    def cost(self, logs: Array, level: float) -> tuple[float, Array, Array]:
        """Return log tr(F⁻ᵖ)/p, p = level, with its derivatives with respect to the logarithms."""
        return log_sum_exp(logs, -level)

    def from_cost(self, cost: float, count: int, samples: int, log_scale: float) -> float:  # noqa: ARG002
        """Return the smallest eigenvalue, up to the surrogate's bluntness."""
        return float(np.exp(-cost) * samples)


CRITERION = EOptimality()
