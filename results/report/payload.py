"""The payload in a report: what the platform carries beyond the machine identified before."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from estimation.estimators.payload import ABOUT_CENTRE, TEN, about_centre
from estimation.identification.estimator_result import PayloadRow
from estimation.identification.record import EstimateRecord
from expdesign.mechanism.terms.rigid_platform import OF_A_BODY
from results.report.content import Block, Level, TextBlock
from results.report.table import Column, ReportTable


def payload_blocks(record: EstimateRecord, truth: Mapping[str, float] | None) -> list[Block]:
    """Return the payload of the best estimate, beside the true one where it is known.

    `truth` are the payload's shares of the platform's parameters.
    """
    rows = [row for row in record.payload if row.estimator == record.summary.best]
    if not rows:
        return []
    columns = [
        Column("quantity", kind="text", of="quantity"),
        Column("unit", kind="text", of="unit"),
        Column("estimate", digits=5, of="value"),
        Column("σ", digits=3, of="std"),
        Column("95 % from", digits=5, of="ci_low"),
        Column("95 % to", digits=5, of="ci_high"),
    ]
    if any(row.std_systematic > 0 for row in rows):
        columns[4:4] = [
            Column("σ random", digits=3, of="std_random"),
            Column("σ systematic", digits=3, of="std_systematic"),
        ]
    if truth is not None:
        values = np.array([truth[name] for name in OF_A_BODY.values()])
        derived = np.concatenate([values, about_centre(values)[0]])
        known = dict(zip((*TEN, *ABOUT_CENTRE), derived.tolist(), strict=True))

        def error(row: PayloadRow) -> float | None:
            return (row.value - known[row.quantity]) / row.std if row.std > 0 else None

        columns += [
            Column("truth", of=lambda row: known[row.quantity]),
            Column("error / σ", digits=2, of=error),
        ]
    text = (
        "The payload is what the platform has beyond the machine that was identified before. Its "
        "standard deviations count the noise of these recordings and what that identification left "
        "open, with the correlation of all parameters."
    )
    caption = "Payload in the platform frame: about the TCP, its centre of mass, and about that"
    return [
        TextBlock(text, Level.NEUTRAL),
        ReportTable.of("payload", caption, columns, rows),
    ]
