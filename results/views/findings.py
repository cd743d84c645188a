"""What tests of an estimate found: assumptions, the model, differences between estimates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.finding import DiagnosisVerdict, Finding, FindingOutcome, Status
from estimation.identification.estimate_file import EstimateFile
from estimation.uncertainty.differences import FAMILY_LEVEL, Differences, difference_test
from results.views.view import Level, ReportTable, TableColumn


def verdict_level(verdict: DiagnosisVerdict) -> Level:
    """Return how a verdict is to be taken."""
    return Level.GOOD if verdict.status is Status.ACCEPTED else Level.BAD


def findings_table(key: str, findings: Sequence[Finding], what: str) -> ReportTable:
    """Return every assumption with its outcome."""
    columns = (
        TableColumn("assumption", kind="text", of="assumption"),
        TableColumn("outcome", kind="outcome", of="outcome.value"),
        TableColumn("what was seen", kind="text", of="sentence"),
        TableColumn("what to do", kind="text", of="advice"),
    )
    return ReportTable.of(key, f"Assumptions of {what} and what became of them", columns, findings)


def against(verdict: DiagnosisVerdict) -> str:
    """Return what speaks against the model, and where; empty when nothing does.

    How large it is, and what to do, stands with the finding.
    """
    serious = [finding for finding in verdict.failed if finding.serious]
    return "; ".join(finding.contradiction or finding.sentence for finding in serious)


def failures(findings: Sequence[Finding]) -> tuple[str, ...]:
    """Return what was seen where an assumption fails."""
    return tuple(f.sentence for f in findings if f.outcome is FindingOutcome.FAILS)


def estimated_values(summary: EstimateFile, estimator: str) -> Array:
    """Return the parameters of one estimator of an `estimate.json`, (m,), SI."""
    values = summary.estimators[estimator].values
    return np.array([values[name] for name in summary.parameters])


def information_test(summary: EstimateFile) -> Differences | str | None:
    """Return the Hausman-type test of ML − GM, or why there is none; None without both."""
    covariance = summary.covariance_ml_less_gm
    if covariance is None or not {"gm", "ml"} <= set(summary.estimators):
        return None
    seen = [(each.harmonics, each.harmonics_of_forces) for each in summary.recordings]
    if any(forces not in {None, lengths} for lengths, forces in seen):
        return "ML takes harmonics of the motion that only the forces show, GM does without"
    efficient, robust = (estimated_values(summary, name) for name in ("gm", "ml"))
    return difference_test(efficient, robust, covariance, summary.estimators["ml"].covariance)


def information_sentence(test: Differences | str) -> str:
    """Return what the test of ML − GM says, in words."""
    if not isinstance(test, str) and not test.freedom and not test.differ_jointly:
        test = "GM and ML differ by less than a sixth of their standard deviations"
    if isinstance(test, str):
        return f"Whether errors of the measured motion bias GM is not tested: {test}"
    which = int(np.sum(test.differs))
    outcome = (
        "Errors of the measured motion bias GM: take ML, whose values differ"
        if test.differ_jointly or which
        else "GM is as good as ML: errors of the measured motion do not bias it"
    )
    largest = float(np.nanmax(np.abs(test.z))) if np.any(np.isfinite(test.z)) else 0.0
    return (
        f"{outcome} (Hausman-type test of ML − GM: "
        f"χ² = {test.statistic:.4g} with {test.freedom:.3g} degrees of freedom, "
        f"p = {test.p_joint:.2g}; {which} of {test.difference.size} parameters differ at the "
        f"family level of {100 * FAMILY_LEVEL:g} %, the largest by {largest:.2g} σ)"
    )


def differences_table(
    key: str, caption: str, names: tuple[str, ...], test: Differences, *, folded: bool = False
) -> ReportTable:
    """Return a test parameter by parameter."""
    judged = np.where(test.differs, "differs", "agrees")
    outcome = np.where(np.isfinite(test.z), judged, "not tested")
    columns = (
        TableColumn("parameter", kind="parameter", of=names),
        TableColumn("difference", of=test.difference),
        TableColumn("σ of difference", digits=3, of=test.std),
        TableColumn("z", digits=3, of=test.z),
        TableColumn("p (Holm)", digits=2, of=test.p_values),
        TableColumn("outcome", kind="outcome", of=outcome),
    )
    return ReportTable.of(key, caption, columns, folded=folded)
