"""Confidence intervals of parameters, and tests of differences between estimates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import scipy
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.estimators import ParameterEstimate, ParameterPriors
from expdesign.information.identifiable import IDENTIFIABLE
from expdesign.mechanism.terms import parameter_unit
from expdesign.robot import Robot
from expdesign.runfolder import MAY_BE_EMPTY, OpenNumber, described

LEVEL = 0.95
"""Coverage of the intervals."""


@dataclass(frozen=True, kw_only=True)
class ParameterRow:
    """Row of `estimates.csv`: one parameter of one estimator."""

    estimator: Annotated[str, described("", "ls, gm or ml")]
    parameter: Annotated[str, described("", "name")]
    unit: Annotated[str, described("", "SI unit of value, std, ci_low, ci_high and a_priori")]
    value: Annotated[float, described("see unit", "estimate")]
    std: Annotated[
        OpenNumber, described("see unit", "standard deviation; empty for a fixed parameter")
    ]
    std_random: Annotated[
        OpenNumber, described("see unit", "random part of std: independent in another recording")
    ] = np.nan
    std_systematic: Annotated[
        OpenNumber, described("see unit", "part of std due to the robot's tolerances")
    ] = np.nan
    std_undetected: Annotated[
        OpenNumber,
        described(
            "see unit",
            "what an effect that no test would find may add to std, see `undetected`; empty for "
            "an estimate that was not diagnosed",
        ),
    ] = np.nan
    ci_low: Annotated[OpenNumber, described("see unit", "lower end of the 95 % interval")]
    ci_high: Annotated[OpenNumber, described("see unit", "upper end of the 95 % interval")]
    rel_std_percent: Annotated[
        OpenNumber, described("%", "std over the a-priori value; empty without one")
    ]
    a_priori: Annotated[float, described("see unit", "value in the robot file, no prior")]
    identified: Annotated[
        bool | None,
        MAY_BE_EMPTY,
        described("", "std below half the parameter's scale; empty for a fixed one"),
    ]


def parameter_rows(
    robot: Robot, estimate: ParameterEstimate, priors: ParameterPriors
) -> list[ParameterRow]:
    """Return one row per parameter."""
    scales, widths = robot.scales, interval_widths(estimate.freedom)
    random, systematic = (
        np.sqrt(np.maximum(np.diag(share), 0.0))
        for share in (estimate.covariance_random, estimate.covariance_systematic)
    )
    rows = []
    for k, name in enumerate(priors.names):
        value, prior = float(estimate.values[k]), float(priors.nominal[k])
        free = bool(priors.free[k])
        std = float(estimate.std[k]) if free else np.nan
        width = float(widths[k])
        rows.append(
            ParameterRow(
                estimator=estimate.estimator,
                parameter=name,
                unit=parameter_unit(name),
                value=value,
                std=std,
                std_random=float(random[k]) if free else np.nan,
                std_systematic=float(systematic[k]) if free else np.nan,
                ci_low=value - width * std,
                ci_high=value + width * std,
                rel_std_percent=100 * std / abs(prior) if prior else np.nan,
                a_priori=prior,
                identified=bool(std < IDENTIFIABLE * scales[k]) if free else None,
            )
        )
    return rows


def interval_widths(freedom: Array) -> Array:
    """Return half the widths of 95 % intervals in standard deviations, by degrees of freedom.

    Examples
    --------
    >>> np.round(interval_widths(np.array([4.0, np.inf])), 3).tolist()
    [2.776, 1.96]
    """
    tail = 0.5 + LEVEL / 2
    known = np.isinf(freedom)
    student = scipy.stats.t.ppf(tail, np.where(known, 1.0, freedom))
    return np.where(known, scipy.stats.norm.ppf(tail), student)


def correlation(covariance: Array) -> Array:
    """Return the correlation matrix, (m, m); zeros for parameters without variance.

    Examples
    --------
    >>> correlation(np.array([[4.0, 1.0], [1.0, 1.0]])).tolist()
    [[1.0, 0.5], [0.5, 1.0]]
    """
    std = np.sqrt(np.diag(covariance))
    product = np.multiply.outer(std, std)
    return np.divide(covariance, product, out=np.zeros_like(covariance), where=product > 0)


FAMILY_LEVEL = 0.01
"""Probability of a false alarm for any parameter (Holm's correction)."""
_RANK = 1e-10
"""Smallest eigenvalue of the difference's correlation that counts, relative to the largest."""
_LEAST_VARIANCE = 3e-2
"""Smallest variance of a difference of estimates from the same data, relative to the estimates'.
Products of the noise of forces and lengths, which the linear theory neglects, reach 0.005 at 3 mm
of length noise on `palida`; and a shift of less than a sixth of the standard deviation hardly
affects the coverage of intervals."""


@dataclass(frozen=True, eq=False)
class Differences:
    """Test of a difference against its covariance."""

    difference: Array
    std: Array
    z: Array
    """(m,), second estimate minus first, its standard deviation, and their ratio; NaN if not
    tested."""
    p_values: Array
    """(m,), two-sided, corrected for the family (Holm); NaN if not tested."""
    statistic: float
    freedom: float
    p_joint: float
    """Wald statistic of all parameters jointly, its degrees of freedom and p-value; 0, 0 and NaN if
    there is no test."""

    @property
    def differs(self) -> NDArray[np.bool_]:
        """(m,), parameters with a significant difference at the family level."""
        return np.nan_to_num(self.p_values, nan=1.0) < FAMILY_LEVEL

    @property
    def differ_jointly(self) -> bool:
        """Whether the parameters differ jointly at the family level."""
        return bool(self.p_joint < FAMILY_LEVEL)

    @property
    def differ(self) -> bool:
        """Whether the parameters differ jointly, or any of them does."""
        return self.differ_jointly or bool(np.any(self.differs))


def difference_test(
    first: Array, second: Array, covariance: Array, own: Array | None = None
) -> Differences:
    """Test whether two estimates have the same expectation.

    Parameters
    ----------
    first, second : (m,)
    covariance : (m, m)
        Covariance of second − first under that hypothesis: for independent data the sum of both
        covariances. Rows of zeros belong to fixed parameters, which are not tested.
    own : (m, m), optional
        For estimates from the same data: the covariance of one of them. Every combination of
        parameters may then differ by a sixth of its standard deviation; combinations with smaller
        random differences do not count as degrees of freedom, and without any degrees of freedom
        a small difference is not significant.

    Notes
    -----
    Gauss–Markov against maximum likelihood is the test of Hausman (1978) for the effect of motion
    errors on the information matrix. Both use the same data, and the covariance of their difference
    follows from their influences (`estimation.estimators.covariance`); for white noise it is
    Cov GM − Cov ML.

    Examples
    --------
    >>> test = difference_test(np.zeros(2), np.array([0.1, 5.0]), np.eye(2))
    >>> test.differs.tolist(), test.differ
    ([False, True], True)
    """
    difference = np.asarray(second, dtype=np.float64) - np.asarray(first, dtype=np.float64)
    variance = np.diag(covariance)
    tested = np.isfinite(variance) & (variance > 0)
    if own is not None:
        tested &= np.diag(own) > 0
        variance = np.maximum(variance, _LEAST_VARIANCE * np.diag(own))
    std = np.sqrt(np.where(tested, variance, np.nan))
    z = difference / std
    p_values = np.full(difference.size, np.nan)
    p_values[tested] = holm(2 * scipy.stats.norm.sf(np.abs(z[tested])))
    statistic, freedom, p_joint = 0.0, 0.0, float("nan")
    if np.any(tested):
        unit = std[tested] if own is None else np.sqrt(np.diag(own)[tested])
        block = covariance[np.ix_(tested, tested)] / np.multiply.outer(unit, unit)
        values, vectors = np.linalg.eigh((block + block.T) / 2)
        along = vectors.T @ (difference[tested] / unit)
        least = _RANK * values[-1] if own is None else _LEAST_VARIANCE
        distinct = values > least
        if own is None:
            values, along = values[distinct], along[distinct]
        # Weights of χ²₁ terms: 1 for differences due to chance, nearly 0 for negligible ones.
        shares = np.clip(values / least, 0.0, 1.0)
        size, square = float(np.sum(shares)), float(np.sum(shares**2))
        if square > 0:
            statistic = float(np.sum(along**2 / np.maximum(values, least))) * size / square
            p_joint = float(scipy.stats.chi2.sf(statistic, size**2 / square))
            freedom = size**2 / square if np.any(distinct) else 0.0
    return Differences(difference, std, z, p_values, statistic, freedom, p_joint)


def holm(p_values: Array) -> Array:
    """Correct p-values for their number after Holm (1979).

    Examples
    --------
    >>> holm(np.array([0.04, 0.01])).tolist()
    [0.04, 0.02]
    """
    count = p_values.size
    order = np.argsort(p_values)
    raised = np.maximum.accumulate(p_values[order] * np.arange(count, 0, -1))
    corrected = np.empty(count)
    corrected[order] = np.minimum(raised, 1.0)
    return corrected
