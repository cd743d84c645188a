"""The findings of the diagnostics as a table, and the level of a verdict."""

from __future__ import annotations

from collections.abc import Sequence

from results.reading.document import Document
from results.report.content import Level
from results.report.table import Column, ReportTable


def verdict_level(diagnostics: Document) -> Level:
    """Return how a verdict is to be taken."""
    status = diagnostics.section("verdict").text("status")
    return {"accepted": Level.GOOD, "doubtful": Level.BAD}.get(status, Level.CAUTION)


def model_findings(diagnostics: Document) -> tuple[Document, ...]:
    """Return the findings of the diagnostics of an estimate or a prediction."""
    return diagnostics.section("verdict").sections("findings")


def findings_table(key: str, findings: Sequence[Document], what: str) -> ReportTable:
    """Return every assumption with what became of it."""
    rows = [
        (
            finding.text("assumption"),
            finding.text("outcome"),
            finding.text("sentence"),
            finding.text("advice"),
        )
        for finding in findings
    ]
    columns = (
        Column("assumption", kind="text"),
        Column("outcome", kind="outcome"),
        Column("what was seen", kind="text"),
        Column("what to do", kind="text"),
    )
    return ReportTable.of(key, f"Assumptions of {what} and what became of them", columns, rows)


def against(diagnostics: Document) -> str:
    """Return what speaks against the model, as the diagnostics put it; empty when nothing does."""
    return "; ".join(
        failures([f for f in model_findings(diagnostics) if f.flag("serious")]),
    )


def failures(findings: Sequence[Document]) -> tuple[str, ...]:
    """Return what was seen where an assumption fails."""
    return tuple(f.text("sentence") for f in findings if f.text("outcome") == "fails")
