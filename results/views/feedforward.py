"""View of the comparison of feed-forwards."""

from __future__ import annotations

import numpy as np

from estimation.feedforward.result import MEANINGS, FeedforwardResult
from results.figures.feedforward import feedforward_figure
from results.notation import percent, readable
from results.views.estimate import NAMES
from results.views.folder import RunFolder
from results.views.view import (
    Block,
    Drawing,
    Fact,
    Level,
    ReportTable,
    StageVerdict,
    StageView,
    TableColumn,
    TextBlock,
)

_DEGREES = float(np.degrees(1))


def feedforward_view(folder: RunFolder) -> StageView:
    """Return the view of the comparison in a folder."""
    summary = folder.result(FeedforwardResult)
    best, without = summary.case("identified"), summary.case("none")
    good = best.reduction > 1
    sentence = (
        f"With the forces of the {NAMES.get(summary.estimator, summary.estimator)} estimate fed "
        f"forward, the struts follow the motion ({summary.motion}) with {_micro(best.rms_struts)} "
        f"instead of {_micro(without.rms_struts)} rms: "
        f"{readable(best.reduction, 3)} times better. "
        f"The true model would leave {_micro(summary.case('true').rms_struts)}."
    )
    blocks: list[Block] = [
        TextBlock(_machine(summary)),
        Drawing(feedforward_figure, summary),
        _cases(summary),
        _struts(summary),
        _controller(summary),
        TextBlock(_integration(summary)),
    ]
    if any(each.limited > 0 for each in summary.cases):
        text = (
            "Forces reach their limits: the comparison is then one of the machine's strength and "
            "not of the model."
        )
        blocks.insert(3, TextBlock(text, Level.CAUTION, screen=True))
    level, word = (Level.GOOD, "smaller error") if good else (Level.BAD, "no smaller error")
    if good and not summary.within_limits:
        level, word = Level.CAUTION, "smaller error, in a motion beyond the limits"
    fact = Fact(
        "tracking error",
        f"÷ {readable(best.reduction, 3)}",
        f"struts' rms by feed-forward of the identified model, {summary.motion}",
    )
    judged = StageVerdict("Feed-forward", level, word, sentence, "feedforward")
    heading = "Feed-forward of the identified model"
    return StageView(judged, tuple(blocks), (fact,), summary.warnings, heading)


def _micro(length: float) -> str:
    return f"{readable(1e6 * length, 3)} µm"


def _machine(summary: FeedforwardResult) -> str:
    who = "The digital twin, with the noise of its lengths in the loop,"
    if summary.machine == "drawn":
        who = (
            "A machine drawn from the estimate's covariance (parameters together with inexact "
            "constants, geometry and force constants), because the measured one is not known,"
        )
    return (
        f"{who} follows the motion under the same controller in every case; the cases differ in "
        "the force added to the controller's: the inverse dynamics along the wanted motion. "
        "The identified model keeps the struts within "
        f"{_micro(summary.case('identified').rms_from_true)} rms of their motion with the true "
        "one, "
        f"{percent(summary.left, 2)} of the error without feed-forward; the rest of the error is "
        "the controller's response to sensor noise and to effects that both models lack."
    )


def _integration(summary: FeedforwardResult) -> str:
    numbers = summary.integration
    return (
        f"Simulated in steps of {readable(1e3 * numbers.step, 3)} ms, with the sign of dry "
        f"friction smoothed over {readable(1e3 * numbers.width, 3)} mm/s. Half of both changes no "
        f"rms error by more than {percent(numbers.change, 2)} of the one without feed-forward."
    )


def _cases(summary: FeedforwardResult) -> ReportTable:
    columns = (
        TableColumn("feed-forward", kind="text", of=lambda each: MEANINGS[each.case]),
        TableColumn("struts, rms", "µm", digits=3, of="rms_struts", factor=1e6),
        TableColumn("largest", "µm", digits=3, of="max_struts", factor=1e6),
        TableColumn("TCP, rms", "µm", digits=3, of="rms_position", factor=1e6),
        TableColumn("largest", "µm", digits=3, of="max_position", factor=1e6),
        TableColumn("turned, rms", "°", digits=3, of="rms_rotation", factor=_DEGREES, screen=False),
        TableColumn(
            "from the true model's", "µm", digits=3, of="rms_from_true", factor=1e6, screen=False
        ),
        TableColumn("feedback, rms", "N", digits=3, of="rms_feedback"),
        TableColumn("at limit", "%", digits=2, of="limited", factor=100, screen=False),
        TableColumn("times better", digits=3, of="reduction"),
    )
    caption = "Tracking error with each feed-forward"
    return ReportTable.of("feedforward_cases", caption, columns, summary.cases, screen=True)


def _struts(record: FeedforwardResult) -> ReportTable:
    columns = (
        TableColumn("feed-forward", kind="text", of="case"),
        TableColumn("strut", of="strut"),
        TableColumn("rms error", "µm", digits=3, of="rms", factor=1e6),
        TableColumn("largest", "µm", digits=3, of="max", factor=1e6),
        TableColumn("feedback, rms", "N", digits=3, of="rms_feedback"),
    )
    caption = "Tracking error strut by strut"
    return ReportTable.of("feedforward", caption, columns, record.rows, folded=True)


def _controller(summary: FeedforwardResult) -> ReportTable:
    own = summary.controller
    columns = (
        TableColumn("strut", of=range(1, len(own.mass) + 1)),
        TableColumn("mass", "kg", digits=3, of=own.mass),
        TableColumn("k", "N/m", digits=3, of=own.stiffness),
        TableColumn("d", "N s/m", digits=3, of=own.damping),
        TableColumn("k_i", "N/(m s)", digits=3, of=own.integral),
    )
    caption = (
        f"The controller of each strut: {own.bandwidth:g} Hz, damping ratio "
        f"{own.damping_ratio:g}, integral action from {own.integral_corner:g} Hz, filter of the "
        f"error's rate {own.filter:g} Hz, sampled at {own.sampling:g} Hz"
    )
    return ReportTable.of("feedforward_controller", caption, columns)
