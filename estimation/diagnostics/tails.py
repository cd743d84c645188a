"""Logarithms of tail probabilities, also where the probabilities underflow."""

from __future__ import annotations

import numpy as np
from scipy import stats

from constraints.arrays import Array

_SMALLEST = 1e-280


def log_two_sided(values: Array, freedom: float) -> Array:
    """Return log P(|t| > |value|) for Student's t, or the normal one for infinite freedom."""
    size = np.abs(values)
    normal = np.log(2) + stats.norm.logsf(size)
    if not np.isfinite(freedom):
        return normal
    direct = 2 * stats.t.sf(size, freedom)
    # Beyond what numbers hold, the leading term of the tail.
    far = np.log(2 / np.sqrt(2 * np.pi)) - np.log(np.maximum(size, 1.0))
    far = far - 0.5 * freedom * np.log1p(size**2 / freedom)
    return np.where(direct > _SMALLEST, np.log(np.maximum(direct, _SMALLEST)), far)


def log_pair_tail(statistic: Array, freedom: float) -> Array:
    """Return log P(T > statistic), T of two degrees of freedom: χ², or 2 F with an estimated Σ."""
    if not np.isfinite(freedom):
        return -0.5 * statistic
    return -0.5 * freedom * np.log1p(statistic / freedom)
