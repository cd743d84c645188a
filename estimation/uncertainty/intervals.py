"""Confidence intervals of single parameters, and which of them the data identify."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy import stats

from constraints.arrays import Array
from estimation.estimators import Knowledge, ParameterEstimate
from expdesign.mechanism.catalogue import parameter_unit
from expdesign.robot import Robot
from expdesign.runfolder import MAY_BE_EMPTY, OpenNumber, described

LEVEL = 0.95
"""Coverage of the intervals."""

IDENTIFIED = 0.5
"""A parameter is identified when its standard deviation is less than this share of its scale."""


@dataclass(frozen=True)
class ParameterRow:
    """One parameter of one estimator: a row of `estimates.csv`."""

    estimator: Annotated[str, described("", "ls, gm or ml")]
    parameter: Annotated[str, described("", "name")]
    unit: Annotated[str, described("", "SI unit of value, std, ci_low, ci_high and a_priori")]
    value: Annotated[float, described("see unit", "estimate")]
    std: Annotated[
        OpenNumber, described("see unit", "standard deviation; empty for a fixed parameter")
    ]
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
    robot: Robot, estimate: ParameterEstimate, knowledge: Knowledge, freedom: float
) -> list[ParameterRow]:
    """Return the rows of all parameters.

    Parameters
    ----------
    freedom : float
        Degrees of freedom behind the noise covariance; inf when it was given.
    """
    scales = robot.scales
    width = interval_width(freedom)
    rows = []
    for k, name in enumerate(knowledge.names):
        value, prior = float(estimate.values[k]), float(knowledge.nominal[k])
        free = bool(knowledge.free[k])
        std = float(estimate.std[k]) if free else np.nan
        rows.append(
            ParameterRow(
                estimator=estimate.estimator,
                parameter=name,
                unit=parameter_unit(name),
                value=value,
                std=std,
                ci_low=value - width * std,
                ci_high=value + width * std,
                rel_std_percent=100 * std / abs(prior) if prior else np.nan,
                a_priori=prior,
                identified=bool(std < IDENTIFIED * scales[k]) if free else None,
            )
        )
    return rows


def interval_width(freedom: float) -> float:
    """Return half the width of a 95 % interval in standard deviations.

    Parameters
    ----------
    freedom : float
        Degrees of freedom behind the standard deviation; inf when it is known.
    """
    tail = 0.5 + LEVEL / 2
    return float(stats.t.ppf(tail, freedom) if np.isfinite(freedom) else stats.norm.ppf(tail))


def correlation(covariance: Array) -> Array:
    """Return the correlation matrix, (m, m); zero where a parameter does not vary."""
    std = np.sqrt(np.diag(covariance))
    product = np.multiply.outer(std, std)
    return np.divide(covariance, product, out=np.zeros_like(covariance), where=product > 0)
