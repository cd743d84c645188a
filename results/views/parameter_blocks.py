"""What a report says of combinations of parameters, of a design and of an estimate."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from estimation.estimators.payload import ABOUT_CENTRE, TEN, about_centre
from estimation.identification.estimator_result import DeviationRow, PayloadRow
from estimation.identification.record import EstimateRecord
from estimation.identification.term_selection import SAME_MOTION, UNSETTLED, without_bounds
from expdesign.experiment.combinations import KnownCombination
from expdesign.mechanism.terms.rigid_platform import OF_A_BODY
from results.figures.parameters import WORTH, selection_figure
from results.notation import counted, readable
from results.views.folder import RunFolder
from results.views.view import Block, Level, ReportTable, TableColumn, TextBlock


def combination_blocks(
    key: str, found: Sequence[KnownCombination], asked: Iterable[str]
) -> tuple[Block, ...]:
    """Return the combinations in which others matter; nothing of a folder that has none.

    Parameters
    ----------
    key : str
        Name of the table in the page.
    found : sequence of KnownCombination
    asked : iterable of str
        The parameters that a design judges, or that were estimated.
    """
    together = [row for row in found if row.together]
    if not found:
        return ()
    regrouped = (name for row in found for name in row.regrouped.split(", ") if name)
    parameters = len({*asked, *regrouped})
    if not together:
        if len(found) == parameters:
            text = f"All {counted(parameters, 'parameter')} are identified each for itself."
        else:
            text = (
                f"{len(found)} of {counted(parameters, 'parameter')} are identified, each for "
                "itself; the others tell nothing that matters to these."
            )
        return (TextBlock(text),)
    columns = (
        TableColumn("combination", kind="text", of="combination"),
        TableColumn("unit", kind="text", of="unit"),
        TableColumn("value", digits=5, of="value"),
        TableColumn("σ", digits=3, of="std"),
        TableColumn("σ / scale", "%", digits=3, of="rel_std_percent"),
        TableColumn("σ of the first alone", digits=3, of="std_alone"),
        TableColumn("regrouped into it", kind="text", of="regrouped"),
    )
    caption = (
        f"What is known only together: {len(found)} combinations of "
        f"{counted(parameters, 'parameter')} are identified, {len(found) - len(together)} of them "
        "single parameters as far as it matters. The first parameter of a combination gives it its "
        "unit; by itself it is known less well, or not at all"
    )
    return (ReportTable.of(key, caption, columns, together),)


def share_columns(record: EstimateRecord) -> list[TableColumn]:
    """Return the shares of the standard deviation, where there are two."""
    found = record.summary.best_estimator.systematic
    if found is None or not found.groups:
        return []
    return [
        TableColumn("σ random", digits=3, of="std_random"),
        TableColumn("σ systematic", digits=3, of="std_systematic"),
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
    columns = [TableColumn("parameter", kind="parameter", of=names)]
    columns += [
        TableColumn(source, "%", digits=2, of=[share[name, source] for name in names])
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
        TableColumn("constant", kind="text", of="constant"),
        TableColumn("unit", kind="text", of="unit"),
        TableColumn("in the robot file", digits=5, of="stated"),
        TableColumn("tolerance", digits=3, of="tolerance"),
        TableColumn("estimate", digits=5, of="value"),
        TableColumn("σ", digits=3, of="std"),
    ]
    caption = "Constants of terms, estimated together with the parameters"
    return [ReportTable.of("constants", caption, columns, rows)]


def _deviations_table(rows: Sequence[DeviationRow]) -> ReportTable:
    columns = [
        TableColumn("deviation", kind="text", of="deviation"),
        TableColumn("unit", kind="text", of="unit"),
        TableColumn("tolerance", digits=3, of="tolerance"),
        TableColumn("estimate", digits=3, of="value"),
        TableColumn("σ", digits=3, of="std"),
    ]
    caption = "What is not known exactly: its tolerance, and what the data say of it"
    return ReportTable.of("deviations", caption, columns, rows, folded=True)


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
        TableColumn("parameter", kind="parameter", of="parameter"),
        TableColumn("unit", kind="text", of="unit"),
        TableColumn("estimate", digits=5, of="estimate"),
        TableColumn("σ", digits=3, of="std"),
        TableColumn("consistent", digits=5, of="consistent"),
        TableColumn("moved / σ", digits=2, of="moved"),
        TableColumn("95 % from", digits=5, of="ci_low"),
        TableColumn("95 % to", digits=5, of="ci_high"),
        TableColumn("spread", digits=3, of="spread"),
    ]
    caption = (
        "The nearest parameters that some set of bodies has, where they are not the estimate's; "
        "intervals have the estimate's width"
    )
    return [*blocks, ReportTable.of("consistent", caption, columns, shown)]


def payload_blocks(record: EstimateRecord, truth: Mapping[str, float] | None) -> list[Block]:
    """Return the payload of the best estimate, beside the true one where it is known.

    `truth` are the payload's shares of the platform's parameters.
    """
    rows = [row for row in record.payload if row.estimator == record.summary.best]
    if not rows:
        return []
    columns = [
        TableColumn("quantity", kind="text", of="quantity"),
        TableColumn("unit", kind="text", of="unit"),
        TableColumn("estimate", digits=5, of="value"),
        TableColumn("σ", digits=3, of="std"),
        TableColumn("95 % from", digits=5, of="ci_low"),
        TableColumn("95 % to", digits=5, of="ci_high"),
    ]
    if any(row.std_systematic > 0 for row in rows):
        columns[4:4] = [
            TableColumn("σ random", digits=3, of="std_random"),
            TableColumn("σ systematic", digits=3, of="std_systematic"),
        ]
    if truth is not None:
        values = np.array([truth[name] for name in OF_A_BODY.values()])
        derived = np.concatenate([values, about_centre(values)[0]])
        known = dict(zip((*TEN, *ABOUT_CENTRE), derived.tolist(), strict=True))

        def error(row: PayloadRow) -> float | None:
            return (row.value - known[row.quantity]) / row.std if row.std > 0 else None

        columns += [
            TableColumn("truth", of=lambda row: known[row.quantity]),
            TableColumn("error / σ", digits=2, of=error),
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
        TableColumn("step", of="step"),
        TableColumn("direction", kind="text", of="direction"),
        TableColumn("term", kind="text", of="term"),
        TableColumn("parameters", of="parameters"),
        TableColumn("χ²", of="statistic"),
        TableColumn("log₁₀ p", digits=3, of=lambda row: row.log_p / float(np.log(10))),
        TableColumn("ΔBIC", of="bic"),
        *([TableColumn("Δ held out", of="held_out")] if found.by == "holdout" else []),
        TableColumn("chosen", kind="text", of=lambda row: "yes" if row.chosen else ""),
    ]
    caption = f"Every term that was tried; judged by: {WORTH[found.by]}"
    yield ReportTable.of("selection", caption, columns, found.steps, folded=True)
    told = [SAME_MOTION] if found.held_out == "periods" else []
    told += [] if found.settled else [UNSETTLED]
    told += [without_bounds(found.bounded)] if found.bounded else []
    for text in told:
        yield TextBlock(f"{text[0].upper()}{text[1:]}.", Level.CAUTION)
    yield TextBlock(found.caveat, Level.CAUTION)
