"""Condition number of the inverse Jacobian: distance from a singular pose."""

import math

import casadi as ca
import numpy as np

from constraints.arrays import Array
from constraints.definition import LimitDefinition, Quantities

_FAR_FROM_SINGULAR = 1e3
"""Ratio below which it is known to nine digits by the eigenvalues of the squares."""
_SQUARINGS = 3
"""Of the scaled matrices: p is twice 2 to this."""


def _singular_value_ratio(entries: Array) -> Array:
    """Return largest over smallest singular value, (N, 1), of matrices (N, n²); NaN stays."""
    size = math.isqrt(entries.shape[1])
    ratio = np.full(len(entries), np.nan)
    finite = np.flatnonzero(np.all(np.isfinite(entries), axis=1))
    matrices = entries[finite].reshape(-1, size, size)
    # Eigenvalues of the squares take two thirds as long, and lose digits where the ratio is large.
    squares = np.linalg.eigvalsh(matrices.swapaxes(1, 2) @ matrices)
    smallest, largest = squares[:, 0], squares[:, -1]
    far = smallest * _FAR_FROM_SINGULAR**2 > largest
    ratio[finite[far]] = np.sqrt(largest[far] / smallest[far])
    ratio[finite[~far]] = np.linalg.cond(matrices[~far])
    return ratio[:, None]


def _power_norm_bound(q: Quantities) -> ca.SX:
    """Log of the squared condition number from above: log tr(Mᵖ)^(1/p) tr(M⁻ᵖ)^(1/p), p = 16.

    With M = JᵀJ it exceeds the true value by at most 2 log(6)/p and by almost nothing when the
    extreme singular values stand alone; unlike the ratio it has derivatives everywhere.
    """
    scales, traces = ca.SX(1), ca.SX(1)
    for matrix in (q["inverse_jacobian"], q["jacobian"]):
        gram = _symmetric(matrix.T @ matrix)
        scale = ca.sqrt(1 / ca.sumsqr(gram))
        power = gram * scale
        for _ in range(_SQUARINGS):
            power = _symmetric(power @ power)
        # The trace of its square.
        scales, traces = scales * scale, traces * ca.sumsqr(power)
    return ca.log(traces) / 2 ** (_SQUARINGS + 1) - ca.log(scales)


def _symmetric(matrix: ca.SX) -> ca.SX:
    """Return a matrix that is symmetric, with each entry off the diagonal computed once."""
    return ca.triu2symm(ca.triu(matrix))


LIMIT = LimitDefinition(
    key="jacobian_condition",
    title="condition of the inverse Jacobian",
    unit="1",
    kind="upper",
    requires=("inverse_jacobian", "jacobian"),
    natural=lambda quantities: ca.vec(quantities["inverse_jacobian"]),
    numerical=_singular_value_ratio,
    smooth=_power_norm_bound,
    transform=lambda bound: 2 * np.log(bound),
    conservative=True,
)
