"""Studies side by side: claims on the digital twin, and what Monte-Carlo studies achieved."""

from __future__ import annotations

from estimation.montecarlo.record import MonteCarloRecord
from estimation.studies import StudySummary
from results.report.content import Level, StageReport, TextBlock, Verdict
from results.report.folder import RunFolder
from results.report.numerals import counted
from results.report.stages.estimate import NAMES
from results.report.stages.study import CLAIM_COLUMNS, SIMULATED, claim_row, judgement
from results.report.table import Column, ReportTable, Value


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


def achieved_report(folders: dict[str, RunFolder]) -> StageReport:
    """Return what is to be said of Monte-Carlo studies side by side."""
    number = counted(len(folders), "study", "studies")
    sentence = f"{number}: achieved standard deviations beside the bound."
    title = "Monte-Carlo studies"
    verdict = Verdict(title, Level.NEUTRAL, "compared", sentence, "studies")
    return StageReport(verdict, (achieved_table(folders),))


def achieved_table(folders: dict[str, RunFolder]) -> ReportTable:
    """Return bound and spread of every estimator in every folder, one row per parameter."""
    columns = [Column("parameter", kind="parameter"), Column("unit", kind="text")]
    cells: dict[tuple[str, str], list[Value]] = {}
    width = 0
    for label, folder in folders.items():
        rows = folder.record(MonteCarloRecord).rows
        estimators = tuple(dict.fromkeys(row.estimator for row in rows))
        columns.append(Column(f"bound, {label}", digits=3))
        columns += [Column(f"{NAMES.get(e, e)}, {label}", digits=3) for e in estimators]
        for found in rows:
            row = cells.setdefault((found.parameter, found.unit), [])
            row += [None] * (width + 1 + len(estimators) - len(row))
            row[width] = found.bound
            row[width + 1 + estimators.index(found.estimator)] = found.spread
        width += 1 + len(estimators)
    table = [(*key, *row, *[None] * (width - len(row))) for key, row in cells.items()]
    caption = (
        "Standard deviations that the estimators achieved in simulated experiments, beside the "
        "Cramér–Rao bound of each, SI units"
    )
    return ReportTable.of("achieved", caption, columns, table)
