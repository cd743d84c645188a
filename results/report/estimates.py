"""Estimates of a run folder with their covariances, and the tests between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from estimation.identification.record import EstimateFile
from estimation.uncertainty.differences import FAMILY_LEVEL, Differences, hausman_test
from results.report.table import Column, ReportTable


@dataclass(frozen=True, eq=False)
class EstimatedParameters:
    """One estimator of `estimate.json`.

    Attributes
    ----------
    estimator : str
    names : tuple of str
    values : (m,)
    covariance : (m, m)
    kinematic : (m, m) or None
        The share of the covariance that comes from the motion; None where it is not known.
    """

    estimator: str
    names: tuple[str, ...]
    values: Array
    covariance: Array
    kinematic: Array | None

    @classmethod
    def of(cls, summary: EstimateFile, estimator: str) -> EstimatedParameters:
        """Take one estimator of an `estimate.json`."""
        entry = summary.estimators[estimator]
        values = np.array([entry.values[name] for name in summary.parameters])
        return cls(
            estimator, summary.parameters, values, entry.covariance, entry.covariance_kinematics
        )


def information_test(summary: EstimateFile) -> Differences | None:
    """Return the Hausman-type test of ML − GM; None where the folder has not both."""
    if not {"gm", "ml"} <= set(summary.estimators):
        return None
    efficient, robust = (EstimatedParameters.of(summary, name) for name in ("gm", "ml"))
    if robust.kinematic is None:
        return None
    return hausman_test(efficient.values, robust.values, robust.kinematic)


def information_sentence(test: Differences) -> str:
    """Return what the test of ML − GM says, in words."""
    which = int(np.sum(test.differs))
    outcome = "yes" if test.differ_jointly or which else "no"
    largest = float(np.nanmax(np.abs(test.z))) if np.any(np.isfinite(test.z)) else 0.0
    return (
        f"The information matrix is disturbed: {outcome} (Hausman-type test of ML − GM: "
        f"χ² = {test.statistic:.4g} with {test.freedom} degrees of freedom, "
        f"p = {test.p_joint:.2g}; {which} of {test.difference.size} parameters differ at the "
        f"family level of {100 * FAMILY_LEVEL:g} %, the largest by {largest:.2g} σ)"
    )


def differences_table(
    key: str, caption: str, names: tuple[str, ...], test: Differences, *, folded: bool = False
) -> ReportTable:
    """Return a test parameter by parameter."""
    judged = np.where(test.differs, "differs", "agrees")
    outcome = np.where(np.isfinite(test.z), judged, "not tested")
    numbers = (test.difference, test.std, test.z, test.p_values, outcome)
    columns = (
        Column("parameter", kind="parameter"),
        Column("difference"),
        Column("σ of difference", digits=3),
        Column("z", digits=3),
        Column("p (Holm)", digits=2),
        Column("outcome", kind="outcome"),
    )
    rows = zip(names, *(values.tolist() for values in numbers), strict=True)
    return ReportTable.of(key, caption, columns, rows, folded=folded)
