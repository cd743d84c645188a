"""The criteria that exist: D, A, E and the condition number, as functions of F's eigenvalues."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from constraints.arrays import Array
from expdesign.information.spectral import Criterion, log_sum_exp


def _inverse_power(logs: Array, level: float) -> tuple[float, Array, Array]:
    """Return log tr(F⁻ᵖ)/p, p = level."""
    return log_sum_exp(logs, -level)


def _mean_log(logs: Array, _level: float) -> tuple[float, Array, Array]:
    """Return −log det F / m."""
    m = logs.size
    return -float(np.mean(logs)), np.full(m, -1 / m), np.zeros((m, m))


def _spread(logs: Array, level: float) -> tuple[float, Array, Array]:
    """Return ½p⁻¹[log tr Fᵖ + log tr F⁻ᵖ], p = level."""
    high, high_slope, high_curvature = log_sum_exp(logs, level)
    low, low_slope, low_curvature = log_sum_exp(logs, -level)
    return (
        (high + low) / 2,
        (high_slope + low_slope) / 2,
        (high_curvature + low_curvature) / 2,
    )


OF_A_CHANGE = (
    "S is the information of what design.parameters have changed by since the machine of "
    "design.prior was identified"
)

CRITERIA = MappingProxyType(
    {
        criterion.key: criterion
        for criterion in (
            # The sum of the parameters' variances in the stated scaling.
            Criterion(
                key="a",
                title="trace of F⁻¹",
                larger_is_better=False,
                flat=True,
                levels=(1.0,),
                value=lambda eigenvalues: float(np.sum(1 / eigenvalues)),
                cost=_inverse_power,
                from_cost=lambda cost, _, samples, __: float(np.exp(cost) / samples),
            ),
            # The paper's deterministic design.
            Criterion(
                key="condition",
                title="condition number of F",
                larger_is_better=False,
                levels=(1.0, 4.0, 16.0),
                value=lambda eigenvalues: float(np.max(eigenvalues) / np.min(eigenvalues)),
                cost=_spread,
                from_cost=lambda cost, *_: float(np.exp(2 * cost)),
            ),
            # The volume of the confidence ellipsoid: no scaling of the parameters matters.
            Criterion(
                key="d",
                title="log det F",
                larger_is_better=True,
                invariant=True,
                levels=(0.0,),
                value=lambda eigenvalues: float(np.sum(np.log(eigenvalues))),
                cost=_mean_log,
                from_cost=lambda cost, count, samples, log_scale: float(
                    count * (np.log(samples) - cost) - 2 * log_scale
                ),
            ),
            # The worst known combination of parameters in the stated scaling.
            Criterion(
                key="e",
                title="smallest eigenvalue of F",
                larger_is_better=True,
                flat=True,
                levels=(1.0, 4.0, 16.0),
                value=lambda eigenvalues: float(np.min(eigenvalues)),
                cost=_inverse_power,
                from_cost=lambda cost, _, samples, __: float(np.exp(-cost) * samples),
            ),
        )
    }
)
"""By key, in alphabetical order."""
