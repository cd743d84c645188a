"""Studies on the digital twin side by side: what each was to show, and what it showed."""

from __future__ import annotations

from results.report.content import Fact, Level, Section, StageReport, TableBlock, TextBlock, Verdict
from results.report.folder import RunFolder
from results.report.numerals import counted
from results.report.stages.study import SIMULATED, claim_columns, claim_row
from results.report.table import Column, ReportTable


def claims_report(studies: dict[str, RunFolder]) -> StageReport:
    """Return the claims of every study in one table; those that fail are named first."""
    claims = [
        (label, claim)
        for label, folder in studies.items()
        for claim in folder.document("study").sections("claims")
    ]
    judged = [claim for _, claim in claims if claim.optional("holds") is not None]
    broken = [claim for claim in judged if not claim.flag("holds")]
    sentence = (
        f"{counted(len(studies), 'study', 'studies')} on the digital twin: "
        f"{len(judged) - len(broken)} of {len(judged)} claims hold."
    )
    if broken:
        sentence += " Not: " + "; ".join(claim.text("statement") for claim in broken) + "."
    table = ReportTable.of(
        "claims",
        "What the studies show; all numbers found are simulated",
        (Column("study", kind="text"), *claim_columns()),
        [(label, *claim_row(claim)) for label, claim in claims],
    )
    return StageReport(
        Verdict(
            "Studies",
            Level.CAUTION if broken else Level.GOOD,
            "not all hold" if broken else "all hold",
            sentence,
            "claims",
        ),
        (Fact("claims that hold", f"{len(judged) - len(broken)} of {len(judged)}", "simulated"),),
        (
            Section(
                "claims",
                "Studies on the digital twin",
                (TextBlock((SIMULATED,)), TableBlock(table)),
            ),
        ),
    )
