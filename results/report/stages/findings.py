"""The findings of the diagnostics as a table, and the level of a verdict."""

from __future__ import annotations

from collections.abc import Sequence

from estimation.diagnostics import Finding, Outcome, Status, Verdict
from results.report.content import Level
from results.report.table import Column, ReportTable


def verdict_level(verdict: Verdict) -> Level:
    """Return how a verdict is to be taken."""
    return Level.GOOD if verdict.status is Status.ACCEPTED else Level.BAD


def findings_table(key: str, findings: Sequence[Finding], what: str) -> ReportTable:
    """Return every assumption with its outcome."""
    columns = (
        Column("assumption", kind="text", of="assumption"),
        Column("outcome", kind="outcome", of="outcome.value"),
        Column("what was seen", kind="text", of="sentence"),
        Column("what to do", kind="text", of="advice"),
    )
    return ReportTable.of(key, f"Assumptions of {what} and what became of them", columns, findings)


def against(verdict: Verdict) -> str:
    """Return what speaks against the model, as the diagnostics put it; empty when nothing does."""
    return "; ".join(failures([finding for finding in verdict.findings if finding.serious]))


def failures(findings: Sequence[Finding]) -> tuple[str, ...]:
    """Return what was seen where an assumption fails."""
    return tuple(f.sentence for f in findings if f.outcome is Outcome.FAILS)
