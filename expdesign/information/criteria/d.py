"""D: log det F, the volume of the confidence ellipsoid. No scaling of the parameters matters."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array


class DOptimality:
    """Maximise log det F."""

    key = "d"
    title = "log det F"
    larger_is_better = True
    invariant = True
    flat = False
    levels = (0.0,)

    def value(self, eigenvalues: Array) -> float:
        """Return log det F."""
        return float(np.sum(np.log(eigenvalues)))

    def cost(self, logs: Array, level: float) -> tuple[float, Array, Array]:  # noqa: ARG002
        """Return −log det F / m with its derivatives with respect to the logarithms."""
        m = logs.size
        return -float(np.mean(logs)), np.full(m, -1 / m), np.zeros((m, m))

    def from_cost(self, cost: float, count: int, samples: int, log_scale: float) -> float:
        """Return log det F in SI units."""
        return float(count * (np.log(samples) - cost) - 2 * log_scale)


CRITERION = DOptimality()
