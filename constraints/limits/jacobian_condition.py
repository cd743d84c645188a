"""Condition number of the inverse Jacobian: distance from a singular pose."""

import itertools

import casadi as ca
import numpy as np

from constraints.definition import LimitDefinition, Quantities

_SWEEPS = 9
_POWER_DOUBLINGS = 4


def _singular_value_ratio(q: Quantities) -> ca.SX:
    """Largest over smallest singular value, by one-sided Jacobi rotations (Hestenes).

    The number of sweeps is fixed; convergence is quadratic and nine leave nothing but rounding
    for 6 × 6 matrices of condition up to 1e6 (tested against LAPACK).
    """
    matrix = q["inverse_jacobian"]
    columns = [matrix[:, k] for k in range(matrix.shape[1])]
    for _ in range(_SWEEPS):
        for i, j in itertools.combinations(range(len(columns)), 2):
            a, b = columns[i], columns[j]
            cross = ca.dot(a, b)
            difference = ca.dot(a, a) - ca.dot(b, b)
            # The smaller rotation angle that makes both columns orthogonal.
            angle = ca.atan2(2 * cross, ca.fabs(difference)) / 2
            angle = ca.if_else(difference < 0, -angle, angle)
            cosine, sine = ca.cos(angle), ca.sin(angle)
            columns[i], columns[j] = cosine * a + sine * b, cosine * b - sine * a
    norms = ca.vertcat(*(ca.dot(c, c) for c in columns))
    return ca.sqrt(ca.mmax(norms) / ca.mmin(norms))


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
    natural=_singular_value_ratio,
    smooth=_power_norm_bound,
    transform=lambda bound: 2 * np.log(bound),
    conservative=True,
)
