"""The smooth extreme of a set of logarithms."""

from __future__ import annotations

import numpy as np
from scipy.special import logsumexp, softmax

from constraints.arrays import Array


def log_sum_exp(logs: Array, power: float) -> tuple[float, Array, Array]:
    """Return log(Σ exp(p x))/|p| with gradient and Hessian with respect to x, (m,).

    For p → +∞ it tends to the largest x, for p → −∞ to minus the smallest.
    """
    value = float(logsumexp(power * logs)) / abs(power)
    weights = softmax(power * logs)
    sign = np.sign(power)
    hessian = abs(power) * (np.diag(weights) - np.multiply.outer(weights, weights))
    return value, sign * weights, hessian
