"""Blocks on parameters that several views or few runs have.

Combinations, the uncertainty budget, estimated constants, physical consistency, the payload and the
selection of terms.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from estimation.estimators.payload import ABOUT_CENTRE, TEN, about_centre
from estimation.identification.estimator_result import DeviationRow, PayloadRow
from estimation.identification.result import EstimationResult
from estimation.identification.term_selection import SAME_MOTION, UNSETTLED, without_bounds
from expdesign.experiment.combinations import KnownCombination
from expdesign.mechanism.terms.rigid_platform import OF_A_BODY
from results.figures.parameters import WORTH, selection_figure
from results.notation import counted, readable
from results.views.view import Block, Drawing, Level, ReportTable, TableColumn, TextBlock


def combination_blocks(
    key: str, found: Sequence[KnownCombination], asked: Iterable[str]
) -> tuple[Block, ...]:
    """Return the combinations of several parameters; nothing for a result that has none.

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
            text = f"All {counted(parameters, 'parameter')} are identified individually."
        else:
            text = (
                f"{len(found)} of {counted(parameters, 'parameter')} are identified individually; "
                "the others do not affect these."
            )
        return (TextBlock(text),)
    columns = (
        TableColumn("combination", kind="text", of="combination"),
        TableColumn("unit", kind="text", of="unit"),
        TableColumn("value", digits=5, of="value"),
        TableColumn("σ", kind="error", digits=3, of="std"),
        TableColumn("σ / scale", "%", digits=3, of="rel_std_percent"),
        TableColumn("σ of the first alone", digits=3, of="std_alone", screen=False),
        TableColumn("regrouped into it", kind="text", of="regrouped", screen=False),
    )
    caption = (
        f"Combinations: {len(found)} combinations of {counted(parameters, 'parameter')} are "
        f"identified, {len(found) - len(together)} of them single parameters. A combination has "
        "the unit of its first parameter, which alone is known less precisely or not at all"
    )
    return (ReportTable.of(key, caption, columns, together, screen=True),)


def share_columns(record: EstimationResult) -> list[TableColumn]:
    """Return the columns of the random and the systematic share, where there are both."""
    found = record.best_estimator.systematic
    if found is None or not found.groups:
        return []
    return [
        TableColumn("σ random", digits=3, of="std_random", screen=False),
        TableColumn("σ systematic", digits=3, of="std_systematic", screen=False),
    ]


def budget_blocks(record: EstimationResult) -> list[Block]:
    """Return the share of every tolerance in the variance of every parameter."""
    found = record.best_estimator.systematic
    if found is None or not found.groups:
        if not record.intervals_cover:
            return []
        return [TextBlock(f"Intervals: {record.intervals_note}.", Level.NEUTRAL)]
    rows = [row for row in record.budget if row.estimator == record.best]
    sources = list(dict.fromkeys(row.source for row in rows))
    names = list(dict.fromkeys(row.parameter for row in rows))
    share = {(row.parameter, row.source): row.share_percent for row in rows}
    columns = [TableColumn("parameter", kind="parameter", of=names)]
    columns += [
        TableColumn(source, "%", digits=2, of=[share[name, source] for name in names])
        for source in sources
    ]
    caption = (
        "Uncertainty budget: contribution of the noise and of each tolerance to the variance of "
        "each parameter"
    )
    costly = max(rows, key=lambda row: row.share_percent if row.source != "noise" else -1.0)
    text = (
        "Inexactly known quantities were estimated with their tolerances as priors; their "
        "remaining uncertainty is counted."
        if found.with_priors
        else "Inexactly known quantities are counted by their tolerances, shared by all recordings "
        "of this machine: more data do not reduce them."
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
        shown = [row for row in record.deviations if row.estimator == record.best]
        blocks.append(_deviations_table(shown))
    return blocks


def constants_blocks(record: EstimationResult) -> list[Block]:
    """Return the table of estimated constants of terms; nothing without any."""
    rows = [row for row in record.constants if row.estimator == record.best]
    if not rows:
        return []
    columns = [
        TableColumn("constant", kind="text", of="constant"),
        TableColumn("unit", kind="text", of="unit"),
        TableColumn("in the robot file", digits=5, of="stated"),
        TableColumn("tolerance", digits=3, of="tolerance"),
        TableColumn("estimate", digits=5, of="value"),
        TableColumn("σ", kind="error", digits=3, of="std"),
    ]
    caption = "Constants of terms, estimated together with the parameters"
    return [ReportTable.of("constants", caption, columns, rows, screen=True)]


def _deviations_table(rows: Sequence[DeviationRow]) -> ReportTable:
    columns = [
        TableColumn("deviation", kind="text", of="deviation"),
        TableColumn("unit", kind="text", of="unit"),
        TableColumn("tolerance", digits=3, of="tolerance"),
        TableColumn("estimate", digits=3, of="value"),
        TableColumn("σ", digits=3, of="std"),
    ]
    caption = "Inexactly known quantities: tolerance, and estimate from the data"
    return ReportTable.of("deviations", caption, columns, rows, folded=True)


_MOVED = 0.005
"""Standard deviations from which on a parameter is in the table."""


def consistency_blocks(record: EstimationResult) -> list[Block]:
    """Return the physical consistency of the best estimate, and the nearest consistent one."""
    found = record.best_estimator.consistent
    if found is None:
        return []
    level = Level.CAUTION if found.significant else Level.NEUTRAL
    blocks: list[Block] = [
        TextBlock(f"{found.text[0].upper()}{found.text[1:]}.", level, screen=True)
    ]
    if found.distance == 0:
        return blocks
    rows = [row for row in record.consistent if row.estimator == record.best]
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
        "The nearest physically consistent parameters, where they differ from the estimate; "
        "intervals have the estimate's width"
    )
    return [*blocks, ReportTable.of("consistent", caption, columns, shown)]


def payload_blocks(record: EstimationResult, truth: Mapping[str, float] | None) -> list[Block]:
    """Return the payload of the best estimate, with the true one where it is known.

    `truth` are the payload's shares of the platform's parameters.
    """
    rows = [row for row in record.payload if row.estimator == record.best]
    if not rows:
        return []
    columns = [
        TableColumn("quantity", kind="text", of="quantity"),
        TableColumn("unit", kind="text", of="unit"),
        TableColumn("estimate", digits=5, of="value"),
        TableColumn("σ", kind="error", digits=3, of="std"),
        TableColumn("95 % from", digits=5, of="ci_low"),
        TableColumn("95 % to", digits=5, of="ci_high"),
    ]
    for estimator in record.estimators:
        if estimator != record.best:
            own = {row.quantity: row for row in record.payload if row.estimator == estimator}
            columns += _other_payload(estimator, own)
    if any(row.std_systematic > 0 for row in rows):
        columns[4:4] = [
            TableColumn("σ random", digits=3, of="std_random", screen=False),
            TableColumn("σ systematic", digits=3, of="std_systematic", screen=False),
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
        "The payload is the difference between the platform and the machine identified before. Its "
        "standard deviations include the noise of these recordings and the uncertainty of that "
        "identification, with the correlation of all parameters."
    )
    caption = "Payload in the platform frame: about the TCP, its centre of mass, and about that"
    return [
        TextBlock(text, Level.NEUTRAL),
        ReportTable.of("payload", caption, columns, rows, screen=True),
    ]


def _other_payload(estimator: str, rows: Mapping[str, PayloadRow]) -> list[TableColumn]:
    return [
        TableColumn(estimator.upper(), digits=5, of=lambda row: rows[row.quantity].value),
        TableColumn("σ", kind="error", digits=3, of=lambda row: rows[row.quantity].std),
    ]


_DONE = {"add": "Added", "drop": "Dropped"}
_RULES = {
    "bic": "Schwarz's criterion",
    "f": "F tests",
    "holdout": "the prediction of held-out data",
}


def selection_blocks(record: EstimationResult) -> Iterator[Block]:
    """Yield the terms that were added, the criterion, and the consequence for the intervals."""
    found = record.selection
    if found is None:
        return
    added = ", ".join(found.chosen) or "none"
    text = (
        f"Of {len(found.candidates)} candidate terms the data support, by {_RULES[found.by]}: "
        f"{added}."
    )
    if found.dispersion > 1:
        text += (
            " With all of them the residuals are "
            f"{readable(found.dispersion, 4)} times the noise; χ² was divided by it."
        )
    for row in found.steps:
        if row.chosen:
            text += (
                f" {_DONE[row.direction]}: {row.term}, χ² {readable(row.statistic)} of "
                f"{row.parameters}, {found.by} in favour by {readable(row.worth)}."
            )
    yield TextBlock(text, screen=True)
    yield Drawing(selection_figure, record)
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
    cautions = [SAME_MOTION] if found.held_out == "periods" else []
    cautions += [] if found.settled else [UNSETTLED]
    cautions += [without_bounds(found.bounded)] if found.bounded else []
    for text in cautions:
        yield TextBlock(f"{text[0].upper()}{text[1:]}.", Level.CAUTION)
    yield TextBlock(found.caveat, Level.CAUTION)
