"""Comparison of repeated estimates: determinants of their covariances, and their means."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from scipy import special

from constraints.arrays import Array
from estimation.montecarlo.result import share_interval
from estimation.uncertainty.intervals import Differences, holm


@dataclass(frozen=True)
class Share:
    """A share of repeated runs, with the 95 % interval of its probability."""

    hits: int
    trials: int
    low: float
    high: float

    @classmethod
    def of(cls, outcomes: Sequence[bool]) -> Share:
        """Count the runs with this outcome."""
        hits, trials = sum(outcomes), len(outcomes)
        return cls(hits, trials, *share_interval(hits / trials, trials))

    def __str__(self) -> str:
        low, high = 100 * self.low, 100 * self.high
        return f"{self.hits} of {self.trials} runs (95 %: {low:.0f} … {high:.0f} %)"


class DeterminantComparison(NamedTuple):
    """Unbiased estimates of log det Cov of two sets of repeated estimates, in units of the scales.

    The standard error of their difference, second minus first, comes from the numbers of
    repetitions alone.
    """

    log_det_first: float
    log_det_second: float
    difference: float
    std_error: float


def compare_determinants(first: Array, second: Array, scales: Array) -> DeterminantComparison:
    """Compare the covariances of two sets of estimates, (K, m) each, in units of `scales`, (m,).

    The units shift both determinants alike.

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
    """Return an unbiased estimate of log det Cov, and its variance."""
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


def mean_difference(first: Array, second: Array) -> Differences:
    """Test the difference of two means of independent estimates, (K, m) with K > m each.

    Notes
    -----
    Every parameter by Welch's t (1947), jointly by Hotelling's T² with the degrees of freedom of
    Nel and Van der Merwe (1986): the covariances differ and are themselves estimated.
    """
    parts = [np.cov(one, rowvar=False) / len(one) for one in (first, second)]
    freedoms = [len(one) - 1 for one in (first, second)]
    total = parts[0] + parts[1]
    difference = second.mean(axis=0) - first.mean(axis=0)
    variances = [np.diag(part) for part in parts]
    std = np.sqrt(variances[0] + variances[1])
    z = difference / std
    welch = std**4 / sum(v**2 / nu for v, nu in zip(variances, freedoms, strict=True))
    p_values = holm(2 * scipy.stats.t.sf(np.abs(z), welch))
    root = np.linalg.inv(np.linalg.cholesky(total))
    size = len(difference)
    scaled = [root @ part @ root.T for part in parts]
    joint = (size + size**2) / sum(
        (float(np.sum(part**2)) + float(np.trace(part)) ** 2) / nu
        for part, nu in zip(scaled, freedoms, strict=True)
    )
    statistic = float(np.sum((root @ difference) ** 2))
    rest = joint - size + 1
    p_joint = float(scipy.stats.f.sf(statistic * rest / (joint * size), size, rest))
    return Differences(difference, std, z, p_values, statistic, size, p_joint)
