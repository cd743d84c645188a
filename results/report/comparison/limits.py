"""How much of every limit several designs use."""

from __future__ import annotations

from constraints import limit_definitions
from results.report.comparison.designs import ComparedDesign
from results.report.stages.design import used_shares
from results.report.table import Column, ReportTable, Value


def limits_table(designs: tuple[ComparedDesign, ...]) -> ReportTable:
    """Return the used share of every limit, one column per design."""
    shares = {design.label: used_shares(design.record) for design in designs}
    keys = dict.fromkeys(key for share in shares.values() for key in share)
    columns = [Column("limit", kind="text")]
    columns += [Column(label, "%") for label in shares]
    rows: list[tuple[Value, ...]] = [
        (
            limit_definitions()[key].title,
            *(100 * share[key] if key in share else None for share in shares.values()),
        )
        for key in keys
    ]
    return ReportTable.of("compared_limits", "Used share of every limit", columns, rows)
