"""How much of every limit several designs use."""

from __future__ import annotations

from results.report.comparison.designs import ComparedDesign
from results.report.table import Column, ReportTable


def limits_table(designs: tuple[ComparedDesign, ...]) -> ReportTable:
    """Return the used share of every limit, one column per design."""
    checks = [{check.key: check for check in design.record.checks} for design in designs]
    titles = {check.key: check.title for own in checks for check in own.values()}
    columns = [Column("limit", kind="text"), *(Column(design.label, "%") for design in designs)]
    rows = [
        (title, *(100 * own[key].used if key in own else None for own in checks))
        for key, title in titles.items()
    ]
    return ReportTable.of("compared_limits", "Used share of every limit", columns, rows)
