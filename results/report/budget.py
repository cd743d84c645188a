"""The uncertainty budget in a report: which tolerance costs which parameter how much."""

from __future__ import annotations

from collections.abc import Sequence

from estimation.identification.estimator_result import DeviationRow
from estimation.identification.record import EstimateRecord
from results.notation import readable
from results.report.content import Block, Level, TextBlock
from results.report.table import Column, ReportTable


def share_columns(record: EstimateRecord) -> list[Column]:
    """Return the shares of the standard deviation, where there are two."""
    found = record.summary.best_estimator.systematic
    if found is None or not found.groups:
        return []
    return [
        Column("σ random", digits=3, of="std_random"),
        Column("σ systematic", digits=3, of="std_systematic"),
    ]


def budget_blocks(record: EstimateRecord) -> list[Block]:
    """Say which tolerance costs which parameter how much."""
    summary = record.summary
    found = summary.best_estimator.systematic
    if found is None or not found.groups:
        if not summary.intervals_cover:
            return []
        return [TextBlock(f"Intervals: {summary.intervals_note}.", Level.NEUTRAL)]
    rows = [row for row in record.budget if row.estimator == summary.best]
    sources = list(dict.fromkeys(row.source for row in rows))
    names = list(dict.fromkeys(row.parameter for row in rows))
    share = {(row.parameter, row.source): row.share_percent for row in rows}
    columns = [Column("parameter", kind="parameter", of=names)]
    columns += [
        Column(source, "%", digits=2, of=[share[name, source] for name in names])
        for source in sources
    ]
    caption = (
        "Uncertainty budget: what noise and each tolerance contribute to the variance of each "
        "parameter"
    )
    costly = max(rows, key=lambda row: row.share_percent if row.source != "noise" else -1.0)
    text = (
        "What is not known exactly was estimated with its tolerance as prior; what the data leave "
        "of it is counted."
        if found.with_priors
        else "What is not known exactly is counted by its tolerance, shared by all recordings of "
        "this machine: more data do not make it smaller."
    )
    text += (
        f" The largest share is that of {costly.source} in {costly.parameter}: "
        f"{readable(costly.share_percent, 2)} % of its variance."
    )
    blocks: list[Block] = [
        TextBlock(text, Level.NEUTRAL),
        ReportTable.of("budget", caption, columns),
    ]
    if found.with_priors:
        shown = [row for row in record.deviations if row.estimator == summary.best]
        blocks.append(_deviations_table(shown))
    return blocks


def constants_blocks(record: EstimateRecord) -> list[Block]:
    """Show the constants of terms that were estimated; nothing where none was."""
    rows = [row for row in record.constants if row.estimator == record.summary.best]
    if not rows:
        return []
    columns = [
        Column("constant", kind="text", of="constant"),
        Column("unit", kind="text", of="unit"),
        Column("in the robot file", digits=5, of="stated"),
        Column("tolerance", digits=3, of="tolerance"),
        Column("estimate", digits=5, of="value"),
        Column("σ", digits=3, of="std"),
    ]
    caption = "Constants of terms, estimated together with the parameters"
    return [ReportTable.of("constants", caption, columns, rows)]


def _deviations_table(rows: Sequence[DeviationRow]) -> ReportTable:
    columns = [
        Column("deviation", kind="text", of="deviation"),
        Column("unit", kind="text", of="unit"),
        Column("tolerance", digits=3, of="tolerance"),
        Column("estimate", digits=3, of="value"),
        Column("σ", digits=3, of="std"),
    ]
    caption = "What is not known exactly: its tolerance, and what the data say of it"
    return ReportTable.of("deviations", caption, columns, rows, folded=True)
