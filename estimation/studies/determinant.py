"""Which of two experiments is the more precise: the determinants of two achieved covariances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from constraints.arrays import Array


@dataclass(frozen=True)
class DeterminantComparison:
    """Log-determinants of the covariances of two sets of repeated estimates.

    Attributes
    ----------
    first, second : float
        Unbiased estimates of log det Cov; parameters in units of their scale.
    difference : float
        Second minus first.
    std_error : float
        Of the difference, from the numbers of repetitions alone.
    """

    first: float
    second: float
    difference: float
    std_error: float

    @property
    def ratio(self) -> float:
        """How many standard errors the difference is."""
        return self.difference / self.std_error


def compare_determinants(first: Array, second: Array, scales: Array) -> DeterminantComparison:
    """Compare two sets of estimates, (K, m) each.

    Parameters
    ----------
    scales : (m,)
        Units; they shift both alike.

    Notes
    -----
    For normal estimates ν Ĉ is Wishart with ν = K − 1 degrees of freedom: log det Ĉ − log det C
    has the mean Σ ψ((ν − i + 1)/2) + m log(2/ν) and the variance Σ ψ₁((ν − i + 1)/2), i = 1 … m,
    whatever C is.

    Raises
    ------
    ValueError
        K ≤ m: the covariance of so few estimates is singular.
    """
    one, one_variance = _log_det(first / scales)
    two, two_variance = _log_det(second / scales)
    return DeterminantComparison(one, two, two - one, float(np.sqrt(one_variance + two_variance)))


def _log_det(values: Array) -> tuple[float, float]:
    count, size = values.shape
    freedom = count - 1
    if freedom < size:
        raise ValueError(
            f"{count} estimates of {size} parameters have a singular covariance: more than "
            f"{size} are needed"
        )
    halves = (freedom - np.arange(size)) / 2
    bias = float(np.sum(special.digamma(halves)) + size * np.log(2 / freedom))
    _, value = np.linalg.slogdet(np.cov(values, rowvar=False))
    return float(value) - bias, float(np.sum(special.polygamma(1, halves)))
