"""Estimates of a run folder with their covariances, and the tests between them."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from estimation.identification.record import EstimateFile
from estimation.uncertainty.differences import FAMILY_LEVEL, Differences, difference_test
from results.report.table import Column, ReportTable


def estimated_values(summary: EstimateFile, estimator: str) -> Array:
    """Return the parameters of one estimator of an `estimate.json`, (m,), SI."""
    values = summary.estimators[estimator].values
    return np.array([values[name] for name in summary.parameters])


def information_test(summary: EstimateFile) -> Differences | None:
    """Return the Hausman-type test of ML − GM; None where the folder has not both."""
    if not {"gm", "ml"} <= set(summary.estimators):
        return None
    from_the_motion = summary.estimators["ml"].covariance_kinematics
    if from_the_motion is None:
        return None
    efficient, robust = (estimated_values(summary, name) for name in ("gm", "ml"))
    return difference_test(efficient, robust, from_the_motion)


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
