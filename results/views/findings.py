"""Findings of tests: assumptions of an estimate, the model, differences between estimates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.finding import DiagnosisVerdict, Finding, Status
from estimation.identification.result import EstimateFile
from estimation.uncertainty.differences import FAMILY_LEVEL, Differences, difference_test
from results.views.view import FindingLine, FindingsBlock, Level, ReportTable, TableColumn


def verdict_level(verdict: DiagnosisVerdict) -> Level:
    """Return the level of a verdict."""
    return Level.GOOD if verdict.status is Status.ACCEPTED else Level.BAD


def findings_block(
    key: str, findings: Sequence[Finding], subject: str, *, every: bool = False
) -> FindingsBlock:
    """Return the findings on a subject, such as ``"the estimate"``.

    The terminal lists the failed ones with their advice, or with `every` all of them with their
    outcomes.
    """
    columns = (
        TableColumn("assumption", kind="text", of="assumption"),
        TableColumn("outcome", kind="outcome", of="outcome.value"),
        TableColumn("observation", kind="text", of="sentence"),
        TableColumn("advice", kind="text", of="advice"),
    )
    table = ReportTable.of(key, f"Assumptions of {subject} and their tests", columns, findings)
    shown = findings if every else [finding for finding in findings if finding.failed]
    return FindingsBlock(subject, table, tuple(_line(finding, every) for finding in shown))


def _line(finding: Finding, every: bool) -> FindingLine:
    begin = ""
    if every:
        begin = f"{finding.assumption}: {finding.outcome.value}. "
        if finding.failed:
            # A failed assumption that denies something would have to be decoded.
            begin = f"{finding.contradiction}. "
    return FindingLine(f"{begin}{finding.sentence}", finding.advice)


def contradictions(verdict: DiagnosisVerdict) -> str:
    """Return the serious contradictions to the model and their places; empty without any.

    Their sizes and the advice are with the findings.
    """
    serious = [finding for finding in verdict.failed if finding.serious]
    return "; ".join(finding.contradiction or finding.sentence for finding in serious)


def count_findings(verdict: DiagnosisVerdict) -> str:
    """Return the verdict with the number of serious findings: ``"doubtful: 2 findings …"``."""
    serious = sum(finding.serious for finding in verdict.failed)
    if not serious:
        return verdict.summary
    count = "1 finding contradicts" if serious == 1 else f"{serious} findings contradict"
    return f"{verdict.status.value}: {count} the model"


def estimated_values(summary: EstimateFile, estimator: str) -> Array:
    """Return the parameters of one estimator of an `estimate.json`, (m,), SI."""
    values = summary.estimators[estimator].values
    return np.array([values[name] for name in summary.parameters])


def information_test(summary: EstimateFile) -> Differences | str | None:
    """Return the Hausman-type test of ML − GM, or the reason against it; None without both."""
    covariance = summary.covariance_ml_less_gm
    if covariance is None or not {"gm", "ml"} <= set(summary.estimators):
        return None
    seen = [(each.harmonics, each.harmonics_of_forces) for each in summary.recordings]
    if any(forces not in {None, lengths} for lengths, forces in seen):
        return "ML takes harmonics of the motion that only the forces show, GM does without"
    efficient, robust = (estimated_values(summary, name) for name in ("gm", "ml"))
    return difference_test(efficient, robust, covariance, summary.estimators["ml"].covariance)


def information_sentence(test: Differences | str) -> str:
    """Return the result of the test of ML − GM in words."""
    if not isinstance(test, str) and not test.freedom and not test.differ_jointly:
        test = "GM and ML differ by less than a sixth of their standard deviations"
    if isinstance(test, str):
        return f"Bias of GM from errors of the measured motion is not tested: {test}"
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
