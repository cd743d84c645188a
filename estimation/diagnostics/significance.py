"""Significance levels, tail probabilities, and the common base of tests of six channels.

A level is the share of sound experiments that each family of tests may reject.

Tail probabilities are returned as logarithms where they would underflow. `ratio_tail` treats sums
of squares with unequal variances, P(Σ λ_i z_i² / (χ²_ν / ν) > x) for independent standard normal z,
which is the F distribution if all λ are one. With poorly known parameters the residuals of a
prediction have a few large λ, and an F distribution of matched moments rejects too often. The
saddlepoint approximation of Lugannani and Rice (1980), applied to quadratic forms by Kuonen
(Biometrika 86, 1999), has relative errors of about a percent.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from typing import Annotated, Any

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, PlainSerializer, model_serializer
from scipy.optimize import brentq
from scipy.special import chdtrc, fdtrc, gammaln

from constraints.arrays import Array
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.runfolder import OpenNumbers, described, sized

LACK_OF_FIT = 0.01
"""Level over the six actuators."""
HARMONIC_LACK_OF_FIT = 0.001
"""Level of the test of all actuators together."""
HYPOTHESES = 0.02
"""Level over all families of hypotheses together."""
POSITION_PERIODIC = 0.001
"""Level over six struts and all pitches."""
GAIN_DRIFT = 0.002
"""Level over all gains."""
NOISE = 0.001
"""Level of whiteness, normality, outliers and drift, each over six channels. In long recordings
every relevant deviation is highly significant; marginal ones need no alarm."""
TOLERANCES = 0.001
"""Level over all estimated deviations, their groups, and all of them together."""
CHI_SQUARE = 0.001
"""Level over both tails of forces and lengths."""

POWER = 0.8
"""Power of the tests at the smallest detectable sizes."""

OfEach = Annotated[OpenNumbers, sized(ACTUATORS)]
"""One number per channel, of which some may be missing."""
Bound = float | Array
_SIGMAS = 3.0
"""Distance from a bound, in standard deviations, from which a value is impossible."""
_SMALLEST = 1e-280
_NEAR_MEAN = 1e-2
"""Distance from the mean, in standard deviations, below which digits cancel."""


Strut = Annotated[
    int | None,
    BeforeValidator(lambda number: number - 1 if isinstance(number, int) else number),
    PlainSerializer(lambda j: None if j is None else j + 1, return_type=int | None),
]
"""Index of a strut: from 0 in memory, from 1 in a file; None: all of them."""


def no_numbers() -> Array:
    """Return six missing numbers."""
    return np.full(ACTUATORS, np.nan)


@dataclass(frozen=True, eq=False, kw_only=True)
class OmissibleTest:
    """Base of the tests that some recordings do not allow: a file then has only the reason."""

    refused: Annotated[str, described("", "reason for an omitted test; otherwise empty")] = ""

    @model_serializer(mode="wrap")
    def _in_a_file(self, fields: Any) -> dict[str, Any]:
        return {"refused": self.refused} if self.refused else self._stored(fields(self))

    def _stored(self, fields: dict[str, Any]) -> dict[str, Any]:
        """Return the fields of a file, with those that follow from others."""
        return fields


@dataclass(frozen=True, eq=False, kw_only=True)
class ChannelTest(OmissibleTest):
    """Base of the tests of six channels; a file lists the numbers of those that fail."""

    p_values: Annotated[OfEach, Field(alias="p"), described("1", "p-value of each channel")] = (
        field(default_factory=no_numbers)
    )
    level: Annotated[
        float, Field(alias="family_level"), described("1", "level of each family of six")
    ] = NOISE

    @property
    def significant(self) -> NDArray[np.bool_]:
        """(6,), channels whose assumption is rejected."""
        return below_level(self.p_values, self.level)

    @property
    def failed(self) -> NDArray[np.bool_]:
        """(6,), channels that violate the assumption to a relevant extent."""
        return self.significant

    def _stored(self, fields: dict[str, Any]) -> dict[str, Any]:
        return {**fields, "failed": (np.flatnonzero(self.failed) + 1).tolist()}


def are_possible(values: Array, covariance: Array, lower: Bound, upper: Bound) -> bool:
    """Return whether estimates, (n,), are within their bounds, or at most three σ beyond them.

    Examples
    --------
    >>> are_possible(np.array([-1.0]), np.eye(1), 0.0, np.inf)
    True
    >>> are_possible(np.array([-4.0]), np.eye(1), 0.0, np.inf)
    False
    """
    gaps = np.maximum(lower - values, values - upper)
    return bool(np.all(gaps <= _SIGMAS * np.sqrt(np.diag(covariance))))


def below_level(p_values: Array, level: float) -> NDArray[np.bool_]:
    """Return which tests of one family are significant, after Bonferroni's correction.

    Examples
    --------
    >>> below_level(np.array([0.004, 0.02]), 0.01).tolist()
    [True, False]
    """
    return p_values < level / len(p_values)


def log_tail(statistic: Array, count: Array, freedom: float) -> Array:
    """Return log P(T > statistic) of χ² with `count` ≥ 1 degrees of freedom.

    With an estimated Σ of ν degrees of freedom, `freedom`, T is `count` times an F of (count, ν).

    Examples
    --------
    >>> float(log_tail(np.array(9.21), np.array(2), np.inf).round(3))
    -4.605
    """
    half = np.asarray(count) / 2
    if np.isfinite(freedom):
        direct = fdtrc(2 * half, freedom, statistic / (2 * half))
        size = freedom * np.log1p(statistic / freedom) / 2
    else:
        direct, size = chdtrc(2 * half, statistic), np.asarray(statistic) / 2
    # Beyond the range of floating-point numbers, the leading term of the tail.
    far = (half - 1) * np.log(np.maximum(size, 1.0)) - size - gammaln(half)
    return np.where(direct > _SMALLEST, np.log(np.maximum(direct, _SMALLEST)), far)


@cache
def noncentrality(log_level: float, count: int, freedom: float) -> float:
    """Return λ of a noncentral χ² that is significant at this level with `POWER`.

    With an estimated Σ of ν degrees of freedom, `freedom`, it is `count` times a noncentral F.
    """
    known = not np.isfinite(freedom)
    shape = (count,) if known else (count, freedom)
    central, noncentral = (
        (scipy.stats.chi2, scipy.stats.ncx2) if known else (scipy.stats.f, scipy.stats.ncf)
    )
    critical = central.isf(np.exp(log_level), *shape)

    def lacking(value: float) -> float:
        return float(noncentral.sf(critical, *shape, value)) - POWER

    return float(brentq(lacking, 1e-6, 10 * count * critical + 100))


def trace_as_f(value: float, count: float, freedom: float) -> tuple[float, float, float]:
    """Return the F and its degrees of freedom of a sum of squares weighted with an estimated Σ.

    Σ xᵀ Σ̂⁻¹ x with `count` degrees of freedom in six channels is a Lawley–Hotelling trace if Σ̂ has
    ν degrees of freedom, `freedom`; the F approximation is McKeon's (Biometrika 61, 1974).

    Examples
    --------
    >>> f, a, b = trace_as_f(200.0, 180.0, 1e9)
    >>> round(f * a, 3), a, b > 1e8
    (200.0, 180.0, True)
    """
    # Below ν = 10 the mean of the inverse's square does not exist.
    p, h, nu = ACTUATORS, count / ACTUATORS, max(freedom, ACTUATORS + 4.0)
    big = (nu + h - p - 1) * (nu - 1) / ((nu - p - 3) * (nu - p))
    b = 4 + (count + 2) / (big - 1)
    return value / nu * b * (nu - p - 1) / (count * (b - 2)), count, b


def ratio_tail(value: float, weights: Array, freedom: float) -> float:
    """Return P(Σ λ_i z_i² / (χ²_ν / ν) > value).

    Parameters
    ----------
    weights : (n,)
        λ, not negative, not all zero.
    freedom : float
        ν; inf for a known denominator.

    Examples
    --------
    >>> round(ratio_tail(8.2, np.ones(2), 10.0), 2), round(ratio_tail(5.99, np.ones(2), np.inf), 2)
    (0.05, 0.05)
    """
    known = not np.isfinite(freedom)
    terms, counts = np.unique(weights[weights > 0], return_counts=True)
    below = 0.0 if known else -value / freedom
    shift = float(value) if known else 0.0

    def slopes(s: float) -> tuple[float, float, float]:
        """K(s) − s·shift and its first two derivatives, K the cumulants of the difference."""
        up = 1 - 2 * s * terms
        total = float(-0.5 * (counts @ np.log(up)) - s * shift)
        first = float(counts @ (terms / up) - shift)
        second = float(2 * (counts @ (terms / up) ** 2))
        if not known:
            down = 1 - 2 * s * below
            total -= 0.5 * freedom * float(np.log(down))
            first += freedom * below / down
            second += 2 * freedom * (below / down) ** 2
        return total, first, second

    largest = float(np.max(terms))
    highest, lowest = (1 - 1e-12) / (2 * largest), -1.0 / largest
    if not known:
        lowest = max(lowest, (1 - 1e-12) / (2 * below))
    while slopes(lowest)[1] > 0 and known:
        lowest *= 2
    while slopes(lowest)[1] > 0:
        # Between the current end and the pole.
        lowest = (lowest + 1 / (2 * below)) / 2
    point = float(brentq(lambda s: slopes(s)[1], lowest, highest, xtol=1e-15, rtol=1e-12))
    cumulant, _, curvature = slopes(point)
    w = np.sign(point) * np.sqrt(max(-2 * cumulant, 0.0))
    if abs(w) < _NEAR_MEAN:
        third = 8 * (counts @ terms**3) + (0.0 if known else 8 * freedom * below**3)
        return float(scipy.stats.norm.sf(w + third / (6 * curvature**1.5)))
    v = point * np.sqrt(curvature)
    return float(np.clip(scipy.stats.norm.sf(w + np.log(v / w) / w), 0.0, 1.0))
