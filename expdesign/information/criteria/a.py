"""A: trace of F⁻¹, the sum of the parameters' variances in the stated scaling."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from expdesign.information.spectral import log_sum_exp


class AOptimality:
    """Minimise tr F⁻¹; the optimiser sees its logarithm."""

    key = "a"
    title = "trace of F⁻¹"
    larger_is_better = False
    invariant = False
    flat = True
    levels = (1.0,)

    def value(self, eigenvalues: Array) -> float:
        """Return tr F⁻¹."""
        return float(np.sum(1 / eigenvalues))

    def cost(self, logs: Array, level: float) -> tuple[float, Array, Array]:
        """Return log tr F⁻¹ with its derivatives with respect to the logarithms."""
        return log_sum_exp(logs, -level)

    def from_cost(self, cost: float, count: int, samples: int, log_scale: float) -> float:  # noqa: ARG002
        """Return tr F⁻¹ in the stated scaling."""
        return float(np.exp(cost) / samples)


CRITERION = AOptimality()
