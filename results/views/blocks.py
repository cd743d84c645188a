"""Blocks of several views: findings of tests, and quantities that only some estimates have."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.finding import DiagnosisVerdict, Finding, Status
from estimation.diagnostics.linearisation import GENERAL_PLATFORM
from estimation.diagnostics.reliability import UndetectedEffect
from estimation.diagnostics.tolerance_test import hidden_error, shown_unit
from estimation.estimators.result import ABOUT_CENTRE, TEN
from estimation.identification.estimator_result import PayloadRow
from estimation.identification.result import EstimateFile, EstimationResult
from estimation.selection import SelectionRow
from estimation.uncertainty.intervals import (
    FAMILY_LEVEL,
    Differences,
    ParameterRow,
    difference_test,
)
from expdesign.configuration import quantity_text
from expdesign.information.identifiable import IDENTIFIABLE, listed
from expdesign.mechanism.bodies import about_centre
from expdesign.mechanism.terms.rigid_platform import OF_A_BODY
from results.figures.parameters import WORTH, selection_figure
from results.notation import count_text, readable
from results.views.view import (
    Block,
    Drawing,
    FindingsBlock,
    Kind,
    Level,
    ReportTable,
    TableColumn,
    TextBlock,
)


def verdict_level(verdict: DiagnosisVerdict) -> Level:
    """Return the level of a verdict."""
    return Level.GOOD if verdict.status is Status.ACCEPTED else Level.BAD


def findings_block(
    key: str, findings: Sequence[Finding], subject: str, *, again: str = "", advice: str = ""
) -> FindingsBlock:
    """Return the findings on a subject, such as ``"the estimate"``.

    The terminal lists all of them with their outcomes; with the word for repeating the stage,
    `again`, it lists the first causes of a failure, which the verdict names, and counts the others.
    What to do about a failure precedes what was observed. `advice` is that without a failure.
    """
    columns = (
        TableColumn("assumption", kind="text", of="assumption"),
        TableColumn("outcome", kind="outcome", of="outcome.value"),
        TableColumn("advice", kind="text", of="advice"),
        TableColumn("observation", kind="text", of="sentence"),
    )
    table = ReportTable.of(key, f"Assumptions of {subject} and their tests", columns, findings)
    causes = [finding for finding in findings if finding.first]
    lines = [advice] if advice and not causes else []
    for finding in causes if again else findings:
        # A failed assumption that denies something would have to be decoded.
        outcome = finding.contradiction or f"{finding.assumption}: {finding.outcome.value}"
        remedy = f"What to do: {finding.advice}" if finding.advice else ""
        repeat = f"Then {again} again" if again and finding is causes[-1] else ""
        parts = ["" if again else outcome, remedy, repeat, f"Observed: {finding.sentence}"]
        if not finding.failed:
            parts = [outcome, finding.sentence, remedy]
        lines.append(". ".join(filter(None, parts)))
    others = sum(finding.failed for finding in findings) - len(causes)
    if again and causes and others:
        verb = "may be a consequence" if others == 1 else "may be consequences"
        lines.append(f"{count_text(others, 'other finding')} in the report {verb}")
    return FindingsBlock(subject, table, tuple(lines))


def undetected_advice(effects: Sequence[UndetectedEffect], rows: Sequence[ParameterRow]) -> str:
    """Return what to do about undetected effects, and the parameters that they make uncertain.

    `rows` are the parameters of the diagnosed estimator. Empty without effects.
    """
    if not effects:
        return ""
    return (
        "What to do: state undetected effects under `tolerances.terms`, zero if the machine has "
        f"none, or record another motion. They {_uncertain_parameters(rows)}"
    )


def undetected_blocks(
    effects: Sequence[UndetectedEffect], rows: Sequence[ParameterRow]
) -> list[Block]:
    """Return the effects that are not excluded: the worst undetected one of every family."""
    if not effects:
        return []
    worst: dict[str, UndetectedEffect] = {}
    for one in effects:  # the largest change first
        worst.setdefault(one.kind, one)
    more = (
        "σ includes a stated effect. The column std_undetected of estimates.csv contains what "
        "remains."
    )
    if GENERAL_PLATFORM in worst:
        more += " An asymmetry of the platform has no tolerance: state `platform: general`."
    columns = (
        TableColumn("effect and size", kind="text", of="text"),
        TableColumn("moves most", kind="parameter", of="worst"),
        TableColumn("by, in σ", digits=2, of="sigmas"),
        TableColumn("predicted forces", "N", digits=2, of="forces"),
    )
    caption = "Effects that the tests may miss, and the errors that they would cause"
    return [
        TextBlock(f"{undetected_advice(effects, rows)}. {more}"),
        ReportTable.of("undetected", caption, columns, list(worst.values())),
    ]


def _uncertain_parameters(rows: Sequence[ParameterRow]) -> str:
    """Name the parameters of which undetected effects may change half of the a-priori value."""
    known = [row for row in rows if abs(row.a_priori) > _ROUNDING * row.std_undetected]
    shares = np.array([row.std_undetected / abs(row.a_priori) for row in known])
    order = [k for k in np.argsort(-shares) if shares[k] >= IDENTIFIABLE]
    named = [
        f"{known[k].parameter} by {quantity_text(known[k].std_undetected, known[k].unit, 2)} "
        f"({'' if number else 'a priori '}{known[k].a_priori:.2g})"
        for number, k in enumerate(order[:_MOST_NAMED])
    ]
    if len(order) > _MOST_NAMED:
        named.append(f"{len(order) - _MOST_NAMED} more by over half")
    return f"make uncertain: {listed(named)}" if named else "are in the report"


_MOST_NAMED = 3
"""Largest number of parameters, or of limits, that a sentence names."""
_ROUNDING = 1e-9
"""Largest a-priori value, relative to an error of the parameter, that is zero."""


def motor_columns(
    torque_per_force: float | None, quantities: Mapping[str, Any]
) -> tuple[TableColumn, ...]:
    """Return columns of forces, by title and attribute or values, as torques of the motors, N m.

    There are none without a lead of the drives.
    """
    if torque_per_force is None:
        return ()
    return tuple(
        TableColumn(f"motor, {title}", "N m", digits=3, of=of, factor=torque_per_force)
        for title, of in quantities.items()
    )


def first_contradictions(verdict: DiagnosisVerdict) -> str:
    """Return what contradicts the model first, with its place; empty without a serious failure.

    Sizes and advice are with the findings.
    """
    return "; ".join(finding.contradiction or finding.sentence for finding in verdict.causes)


def estimated_values(summary: EstimateFile, estimator: str) -> Array:
    """Return the parameters of one estimator of an `estimate.json`, (m,), SI."""
    values = summary.estimators[estimator].values
    return np.array([values[name] for name in summary.parameters])


def information_test(summary: EstimateFile) -> Differences | str | None:
    """Return the Hausman-type test of ML − GM, or the reason against it; None without both."""
    covariance = summary.covariance_ml_less_gm
    if covariance is None or not {"gm", "ml"} <= set(summary.estimators):
        return None
    seen = [(each.harmonics, each.harmonics_of_forces) for each in summary.recordings]
    if any(forces not in {None, lengths} for lengths, forces in seen):
        return "ML takes harmonics of the motion that only the forces show, GM does without"
    efficient, robust = (estimated_values(summary, name) for name in ("gm", "ml"))
    return difference_test(efficient, robust, covariance, summary.estimators["ml"].covariance)


def information_sentence(test: Differences | str) -> str:
    """Return the result of the test of ML − GM in words."""
    if not isinstance(test, str) and not test.freedom and not test.differ_jointly:
        test = "GM and ML differ by less than a sixth of their standard deviations"
    if isinstance(test, str):
        return f"Bias of GM from errors of the measured motion is not tested: {test}"
    which = int(np.sum(test.differs))
    outcome = (
        "Errors of the measured motion bias GM: take ML, whose values differ"
        if test.differ_jointly or which
        else "GM is as good as ML: errors of the measured motion do not bias it"
    )
    largest = float(np.nanmax(np.abs(test.z))) if np.any(np.isfinite(test.z)) else 0.0
    return (
        f"{outcome} (Hausman-type test of ML − GM: "
        f"χ² = {test.statistic:.4g} with {test.freedom:.3g} degrees of freedom, "
        f"p = {test.p_joint:.2g}; {which} of {test.difference.size} parameters differ at the "
        f"family level of {100 * FAMILY_LEVEL:g} %, the largest by {largest:.2g} σ)"
    )


def differences_table(
    key: str, caption: str, names: tuple[str, ...], test: Differences, *, folded: bool = False
) -> ReportTable:
    """Return a test parameter by parameter."""
    judged = np.where(test.differs, "differs", "agrees")
    outcome = np.where(np.isfinite(test.z), judged, "not tested")
    columns = (
        TableColumn("parameter", kind="parameter", of=names),
        TableColumn("difference", of=test.difference),
        TableColumn("σ of difference", digits=3, of=test.std),
        TableColumn("z", digits=3, of=test.z),
        TableColumn("p (Holm)", digits=2, of=test.p_values),
        TableColumn("outcome", kind="outcome", of=outcome),
    )
    return ReportTable.of(key, caption, columns, folded=folded)


def share_columns(result: EstimationResult) -> list[TableColumn]:
    """Return the columns of the random and the systematic share, where there are both."""
    found = result.best_estimator.systematic
    return [] if found is None or not found.groups else list(_SHARES)


_SHARES = (
    TableColumn("σ random", digits=3, of="std_random", screen=False),
    TableColumn("σ systematic", digits=3, of="std_systematic", screen=False),
)
UNDETECTED = TableColumn("σ undetected", digits=3, of="std_undetected", screen=False)
INTERVAL = (
    TableColumn("95 % from", digits=5, of="ci_low"),
    TableColumn("95 % to", digits=5, of="ci_high"),
)


def truth_columns(truth: Mapping[str, float], name: str) -> list[TableColumn]:
    """Return the true values of rows by the attribute with their names, and the errors."""

    def error(row: Any) -> float | None:
        return (row.value - truth[getattr(row, name)]) / row.std if row.std > 0 else None

    return [
        TableColumn("truth", of=lambda row: truth[getattr(row, name)]),
        TableColumn("error / σ", digits=2, of=error),
    ]


def budget_blocks(result: EstimationResult) -> list[Block]:
    """Return the share of every tolerance in the variance of every parameter."""
    found = result.best_estimator.systematic
    if found is None or not found.groups:
        if not result.intervals_cover:
            return []
        return [TextBlock(f"Intervals: {result.intervals_note}.", Level.NEUTRAL)]
    rows = result.budget[result.best]
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
        shown = result.deviations[result.best]
        columns = [
            TableColumn("deviation", kind="text", of="deviation"),
            _SHOWN_UNIT,
            _in_shown_unit("tolerance", lambda row: row.tolerance),
            _in_shown_unit("estimate", lambda row: row.value),
            _in_shown_unit("σ", lambda row: row.std),
            TableColumn("σ / tolerance", digits=2, of="ratio"),
            TableColumn("z", digits=2, of="z"),
            _in_shown_unit(
                "hides up to", lambda row: hidden_error(row.tolerance, row.std, len(shown)), 2
            ),
        ]
        caption = (
            "Inexactly known quantities: tolerance, estimate from the data, z, the estimate "
            "over its scatter in machines within the tolerances, and the largest error of the "
            "quantity that is taken for a deviation within its tolerance in one of five recordings"
        )
        blocks.append(ReportTable.of("deviations", caption, columns, shown, folded=True))
    return blocks


_SHOWN_UNIT = TableColumn("unit", kind="text", of=lambda row: shown_unit(row.unit)[1])


def _in_shown_unit(
    title: str, value: Callable[[Any], float], digits: int = 3, kind: Kind = "number"
) -> TableColumn:
    """Return a column of the values of rows in the unit in which deviations are displayed."""
    return TableColumn(
        title, kind=kind, digits=digits, of=lambda row: shown_unit(row.unit)[0] * value(row)
    )


def constants_blocks(result: EstimationResult) -> list[Block]:
    """Return the table of estimated constants of terms; nothing without any."""
    rows = result.best_estimator.constants
    if not rows:
        return []
    columns = [
        TableColumn("constant", kind="text", of="constant"),
        _SHOWN_UNIT,
        _in_shown_unit("in the robot file", lambda row: row.stated, 5),
        _in_shown_unit("tolerance", lambda row: row.tolerance),
        _in_shown_unit("estimate", lambda row: row.value, 5),
        _in_shown_unit("σ", lambda row: row.std, kind="error"),
    ]
    caption = "Constants of terms, estimated together with the parameters"
    return [ReportTable.of("constants", caption, columns, rows, screen=True)]


_MOVED = 0.005
"""Standard deviations from which on a parameter is in the table."""


def consistency_blocks(result: EstimationResult) -> list[Block]:
    """Return the physical consistency of the best estimate, and the nearest consistent one."""
    found = result.best_estimator.consistent
    if found is None:
        return []
    level = Level.CAUTION if found.significant else Level.NEUTRAL
    text = f"{found.text[0].upper()}{found.text[1:]}."
    first = ", ".join(found.active[:_MOST_NAMED])
    more = len(found.active) - _MOST_NAMED
    short = text.replace(", ".join(found.active), f"{first} and {more} more") if more > 0 else ""
    # The cause of a doubt decides on everything else.
    accepted = result.diagnostics is None or (result.diagnostics.verdict.status is Status.ACCEPTED)
    screen = found.significant and accepted
    blocks: list[Block] = [TextBlock(text, level, screen=screen, short=short)]
    if found.distance == 0:
        return blocks
    rows = result.consistent[result.best]
    shown = [row for row in rows if abs(row.moved) >= _MOVED or row.parameter in found.exchanged]
    columns = [
        TableColumn("parameter", kind="parameter", of="parameter"),
        TableColumn("unit", kind="text", of="unit"),
        TableColumn("estimate", digits=5, of="estimate"),
        TableColumn("σ", digits=3, of="std"),
        TableColumn("consistent", digits=5, of="consistent"),
        TableColumn("moved / σ", digits=2, of="moved"),
        *INTERVAL,
        TableColumn("spread", digits=3, of="spread"),
    ]
    caption = (
        "The nearest physically consistent parameters, where they differ from the estimate; "
        "intervals have the estimate's width"
    )
    return [*blocks, ReportTable.of("consistent", caption, columns, shown)]


def payload_blocks(result: EstimationResult, truth: Mapping[str, float] | None) -> list[Block]:
    """Return the payload of the best estimate, with the true one where it is known.

    `truth` are the payload's shares of the platform's parameters.
    """
    rows = result.payload.get(result.best)
    if not rows:
        return []
    columns = [
        TableColumn("quantity", kind="text", of="quantity"),
        TableColumn("unit", kind="text", of="unit"),
        TableColumn("estimate", digits=5, of="value"),
        TableColumn("σ", kind="error", digits=3, of="std"),
        *INTERVAL,
    ]
    for estimator, others in result.payload.items():
        if estimator != result.best:
            columns += _other_payload(estimator, {row.quantity: row for row in others})
    if any(row.std_systematic > 0 for row in rows):
        columns[4:4] = _SHARES
    if truth is not None:
        values = np.array([truth[name] for name in OF_A_BODY.values()])
        derived = np.concatenate([values, about_centre(values)[0]])
        known = dict(zip((*TEN, *ABOUT_CENTRE), derived.tolist(), strict=True))
        columns += truth_columns(known, "quantity")
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


def selection_blocks(result: EstimationResult) -> Iterator[Block]:
    """Yield the terms that were added, the criterion, and the consequence for the intervals."""
    found = result.selection
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
    yield Drawing(selection_figure, result)
    columns = [
        TableColumn("step", of="step"),
        TableColumn("direction", kind="text", of="direction"),
        TableColumn("term", kind="text", of="term"),
        TableColumn("parameters", of="parameters"),
        TableColumn("χ²", of="statistic"),
        TableColumn("log₁₀ p", digits=3, of=lambda row: row.log_p / float(np.log(10))),
        TableColumn("ΔBIC", of="bic"),
        *([TableColumn("Δ held out", of="held_out")] if found.by == "holdout" else []),
        TableColumn("chosen", kind="text", of=_outcome),
    ]
    caption = f"Every term that was tried; judged by: {WORTH[found.by]}"
    yield ReportTable.of("selection", caption, columns, found.steps, folded=True)
    for text in (*(finding.sentence for finding in found.findings), *found.notes):
        yield TextBlock(f"{text[0].upper()}{text[1:]}.", Level.CAUTION)
    yield TextBlock(found.caveat, Level.CAUTION)


def _outcome(row: SelectionRow) -> str:
    if not row.possible:
        return "impossible"
    return "yes" if row.chosen else ""
