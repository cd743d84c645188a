"""Studies on the digital twin side by side: what each was to show, and what it showed."""

from __future__ import annotations

from estimation.studies import StudySummary
from results.report.content import StageReport, TextBlock, Verdict
from results.report.folder import RunFolder
from results.report.numerals import counted
from results.report.stages.study import CLAIM_COLUMNS, SIMULATED, claim_row, judgement
from results.report.table import Column, ReportTable


def claims_report(studies: dict[str, RunFolder]) -> StageReport:
    """Return the claims of every study in one table; those that fail are named first."""
    claims = [
        (label, claim)
        for label, folder in studies.items()
        for claim in StudySummary.read(folder.path).claims
    ]
    level, word, sentence, fact = judgement([claim for _, claim in claims])
    sentence = f"{counted(len(studies), 'study', 'studies')} on the digital twin: {sentence}"
    table = ReportTable.of(
        "claims",
        "What the studies show; all numbers found are simulated",
        (Column("study", kind="text"), *CLAIM_COLUMNS),
        [(label, *claim_row(claim)) for label, claim in claims],
    )
    blocks = (TextBlock(SIMULATED), table)
    verdict = Verdict("Studies", level, word, sentence, "claims")
    return StageReport(verdict, blocks, (fact,), heading="Studies on the digital twin")
