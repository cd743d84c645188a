"""What a report says of terms that the data chose."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from estimation.identification.record import EstimateRecord
from estimation.identification.term_selection import SAME_MOTION, UNSETTLED, without_bounds
from results.figures.selection import WORTH, selection_figure
from results.notation import readable
from results.report.content import Block, Level, TextBlock
from results.report.folder import RunFolder
from results.report.table import Column, ReportTable

_RULES = {
    "bic": "Schwarz's criterion",
    "f": "F tests",
    "holdout": "the prediction of what was not fitted",
}


def selection_blocks(folder: RunFolder, record: EstimateRecord) -> Iterator[Block]:
    """Yield which terms were added and how, and what that means for the intervals."""
    found = record.summary.selection
    if found is None:
        return
    added = ", ".join(found.chosen) or "none"
    text = (
        f"Of {len(found.candidates)} candidate terms the data support, by {_RULES[found.by]}: "
        f"{added}."
    )
    if found.dispersion > 1:
        text += (
            " All of them together leave "
            f"{readable(found.dispersion, 4)} times the noise; χ² was divided by it."
        )
    yield TextBlock(text)
    yield from folder.figures(selection_figure)
    columns = [
        Column("step", of="step"),
        Column("direction", kind="text", of="direction"),
        Column("term", kind="text", of="term"),
        Column("parameters", of="parameters"),
        Column("χ²", of="statistic"),
        Column("log₁₀ p", digits=3, of=lambda row: row.log_p / float(np.log(10))),
        Column("ΔBIC", of="bic"),
        *([Column("Δ held out", of="held_out")] if found.by == "holdout" else []),
        Column("chosen", kind="text", of=lambda row: "yes" if row.chosen else ""),
    ]
    caption = f"Every term that was tried; judged by: {WORTH[found.by]}"
    yield ReportTable.of("selection", caption, columns, found.steps, folded=True)
    told = [SAME_MOTION] if found.held_out == "periods" else []
    told += [] if found.settled else [UNSETTLED]
    told += [without_bounds(found.bounded)] if found.bounded else []
    for text in told:
        yield TextBlock(f"{text[0].upper()}{text[1:]}.", Level.CAUTION)
    yield TextBlock(found.caveat, Level.CAUTION)
