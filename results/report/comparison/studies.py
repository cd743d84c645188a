"""Monte-Carlo studies side by side: the standard deviations that were achieved."""

from __future__ import annotations

from estimation.montecarlo.record import MonteCarloRecord
from results.report.content import Level, StageReport, Verdict
from results.report.folder import RunFolder
from results.report.numerals import counted
from results.report.stages.estimate import NAMES
from results.report.table import Column, ReportTable, Value


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
