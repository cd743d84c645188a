"""Monte-Carlo studies side by side: the standard deviations that were achieved."""

from __future__ import annotations

from results.reading.table import Table
from results.report.folder import RunFolder
from results.report.stages.estimate import NAMES
from results.report.table import Column, ReportTable, Value


def achieved_table(folders: dict[str, RunFolder]) -> ReportTable:
    """Return bound and spread of every estimator in every folder, one row per parameter."""
    columns = [Column("parameter", kind="parameter"), Column("unit", kind="text")]
    cells: dict[tuple[str, str], list[Value]] = {}
    width = 0
    for label, folder in folders.items():
        table = Table.read(
            folder.table_file("montecarlo"), ["estimator", "parameter", "unit", "bound", "spread"]
        )
        bound, spread = (table.numbers(name, blank=True).tolist() for name in ("bound", "spread"))
        estimators = tuple(dict.fromkeys(table.columns["estimator"]))
        columns.append(Column(f"bound, {label}", digits=3))
        columns += [Column(f"{NAMES.get(e, e)}, {label}", digits=3) for e in estimators]
        for k, key in enumerate(
            zip(table.columns["parameter"], table.columns["unit"], strict=True)
        ):
            row = cells.setdefault(key, [])
            row += [None] * (width + 1 + len(estimators) - len(row))
            row[width] = bound[k]
            row[width + 1 + estimators.index(table.columns["estimator"][k])] = spread[k]
        width += 1 + len(estimators)
    rows = [(*key, *row, *[None] * (width - len(row))) for key, row in cells.items()]
    caption = (
        "Standard deviations that the estimators achieved in simulated experiments, beside the "
        "Cramér–Rao bound of each, SI units"
    )
    return ReportTable.of("achieved", caption, columns, rows)
