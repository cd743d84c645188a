"""Physical consistency in a report: the estimate beside the nearest that some set of bodies has."""

from __future__ import annotations

from estimation.identification.record import EstimateRecord
from results.report.content import Block, Level, TextBlock
from results.report.table import Column, ReportTable

_MOVED = 0.005
"""Standard deviations from which on a parameter is in the table."""


def consistency_blocks(record: EstimateRecord) -> list[Block]:
    """Say whether bodies have the best estimate, and which parameters are nearest if not."""
    summary = record.summary
    found = summary.best_estimator.consistent
    if found is None:
        return []
    level = Level.CAUTION if found.significant else Level.NEUTRAL
    blocks: list[Block] = [TextBlock(f"{found.text[0].upper()}{found.text[1:]}.", level)]
    if found.distance == 0:
        return blocks
    rows = [row for row in record.consistent if row.estimator == summary.best]
    shown = [row for row in rows if abs(row.moved) >= _MOVED or row.parameter in found.exchanged]
    columns = [
        Column("parameter", kind="parameter", of="parameter"),
        Column("unit", kind="text", of="unit"),
        Column("estimate", digits=5, of="estimate"),
        Column("σ", digits=3, of="std"),
        Column("consistent", digits=5, of="consistent"),
        Column("moved / σ", digits=2, of="moved"),
        Column("95 % from", digits=5, of="ci_low"),
        Column("95 % to", digits=5, of="ci_high"),
        Column("spread", digits=3, of="spread"),
    ]
    caption = (
        "The nearest parameters that some set of bodies has, where they are not the estimate's; "
        "intervals have the estimate's width"
    )
    return [*blocks, ReportTable.of("consistent", caption, columns, shown)]
