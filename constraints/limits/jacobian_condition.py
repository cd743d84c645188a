"""Condition number of the inverse Jacobian: distance from a singular pose."""

import math

import casadi as ca
import numpy as np

from constraints.arrays import Array
from constraints.definition import LimitDefinition, Quantities

_POWER_DOUBLINGS = 4


def _singular_value_ratio(entries: Array) -> Array:
    """Return largest over smallest singular value, (N, 1), of matrices (N, n²); NaN stays."""
    size = math.isqrt(entries.shape[1])
    ratio = np.full((len(entries), 1), np.nan)
    finite = np.all(np.isfinite(entries), axis=1)
    ratio[finite, 0] = np.linalg.cond(entries[finite].reshape(-1, size, size))
    return ratio


def _power_norm_bound(q: Quantities) -> ca.SX:
    """Log of the squared condition number from above: log tr(Mᵖ)^(1/p) tr(M⁻ᵖ)^(1/p), p = 16.

    With M = JᵀJ it exceeds the true value by at most 2 log(6)/p and by almost nothing when the
    extreme singular values stand alone; unlike the ratio it has derivatives everywhere.
    """
    matrix = q["inverse_jacobian"]
    gram = matrix.T @ matrix
    inverse = ca.inv(matrix)
    total = ca.SX(0)
    for factor in (gram, inverse @ inverse.T):
        scale = ca.trace(factor)
        power = factor / scale
        for _ in range(_POWER_DOUBLINGS):
            power = power @ power
        total += ca.log(scale) + ca.log(ca.trace(power)) / 2**_POWER_DOUBLINGS
    return total


LIMIT = LimitDefinition(
    key="jacobian_condition",
    title="condition of the inverse Jacobian",
    unit="1",
    kind="upper",
    requires=("inverse_jacobian",),
    natural=lambda quantities: ca.vec(quantities["inverse_jacobian"]),
    numerical=_singular_value_ratio,
    smooth=_power_norm_bound,
    transform=lambda bound: 2 * np.log(bound),
    conservative=True,
)
