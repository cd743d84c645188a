"""Views of the uses of an estimate: prediction of other motions, and feed-forward."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np

from estimation.feedforward.result import MEANINGS, FeedforwardResult
from estimation.validation.prediction_error import Kept
from estimation.validation.validate import PredictedMotion, ValidationResult
from results.figures.residuals import feedforward_figure, prediction_figure
from results.notation import count_text, percent, readable
from results.views.blocks import (
    findings_block,
    first_contradictions,
    motor_columns,
    verdict_level,
)
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


def validation_view(folder: RunFolder) -> StageView:
    """Return the view of the validation in a folder."""
    result = folder.result(ValidationResult)
    passed = f"{sum(row.verdict == 'passes' for row in result.rows)} of {len(result.rows)}"
    blocks: list[Block] = []
    if result.errors:
        blocks.append(_errors_table(result, folder.torque_per_force))
    blocks.append(_actuators_table(result))
    for number, motion in enumerate(result.motions, start=1):
        verdict = motion.diagnostics.verdict
        how = "simulated" if motion.simulated else "measured"
        finding = first_contradictions(verdict)
        finding = f"{verdict.status.value}: {finding}" if finding else verdict.summary
        text = f"Motion {number}, {motion.name} ({how}): {finding}."
        if motion.tolerance_words:
            text += f" It is {motion.tolerance_words}."
        blocks.append(TextBlock(text, verdict_level(verdict), screen=True))
        if motion.errors:
            blocks.append(_accuracy(motion))
        blocks.append(Drawing(prediction_figure, result.predictions[number - 1], number))
        subject = f"the prediction of motion {number}"
        blocks.append(
            findings_block(f"findings_{number}", verdict.findings, subject, again="validate")
        )
    motions = count_text(len(result.motions), "motion")
    sentence = (
        f"The {result.estimator.upper()} estimate predicts the forces of "
        f"{motions} ({'; '.join(motion.name for motion in result.motions)}): {passed} actuator "
        "tests pass."
    )
    failed = [
        str(number)
        for number, motion in enumerate(result.motions, start=1)
        if motion.tolerance is None and verdict_level(motion.diagnostics.verdict) is Level.BAD
    ]
    if failed:
        several = len(failed) > 1
        which = f"Motions {', '.join(failed)}" if several else f"Motion {failed[0]}"
        sentence += f" {which} {'contradict' if several else 'contradicts'} the model."
    judged_by_size = [motion for motion in result.motions if motion.tolerance is not None]
    if judged_by_size:
        kept = sum(motion.within is True for motion in judged_by_size)
        sentence += (
            f" {kept} of {count_text(len(judged_by_size), 'motion')} with a tolerance "
            f"{'keeps' if kept == 1 else 'keep'} it."
        )
    undecided = any(motion.within is None for motion in judged_by_size)
    level, word = (Level.GOOD, "accepted") if result.accepted else (Level.BAD, "doubtful")
    if result.accepted and undecided:
        level, word = Level.CAUTION, "not decided"
    facts = (Fact("actuator tests passed", passed, f"lack of fit on {motions}"),)
    judged = StageVerdict("Validation", level, word, sentence, "validation")
    return StageView(judged, tuple(blocks), facts, result.warnings)


def _accuracy(motion: PredictedMotion) -> TextBlock:
    """Return a text on the size of the error and the meaning of a failed test."""
    worst = max(motion.errors, key=lambda each: each.error_high)
    known = np.isfinite(worst.detectable)
    noise = "noise subtracted" if known else "with the noise, which is not known"
    text = (
        f"The error of the prediction is at most {worst.error_high:.3g} N rms (actuator "
        f"{worst.actuator}, 95 %), {100 * worst.error_high / worst.range:.2g} % of the range of "
        f"its force, {noise}."
    )
    level = Level.NEUTRAL
    if motion.tolerance is not None:
        level = Level.GOOD if motion.within else Level.BAD
        beyond = [str(each.actuator) for each in motion.errors if each.kept is Kept.BEYOND]
        undecided = [str(each.actuator) for each in motion.errors if each.kept is Kept.OPEN]
        text += f" Tolerance {motion.tolerance}:"
        text += " every actuator is within." if motion.within else ""
        text += f" beyond it in actuator {', '.join(beyond)}." if beyond else ""
        if undecided:
            text += (
                f" Not decided in actuator {', '.join(undecided)}, where noise hides it: measure "
                "more periods."
            )
            level = Level.BAD if beyond else Level.CAUTION
    if np.any(motion.diagnostics.experiments[0].lack_of_fit.failed):
        seen = min(each.detectable for each in motion.errors)
        text += (
            " The lack-of-fit test detects an error and does not measure its size: with these data "
            f"it detects errors from {seen:.2g} N rms on, and with enough data every model of a "
            "real machine fails it."
        )
    return TextBlock(text, level)


def _errors_table(result: ValidationResult, torque_per_force: float | None) -> ReportTable:
    judged = any(np.isfinite(row.tolerance) for row in result.errors)
    columns = (
        TableColumn("no.", of="number"),
        TableColumn("motion", kind="text", of="motion"),
        TableColumn("actuator", of="actuator"),
        TableColumn("rms error", "N", digits=3, of="error"),
        TableColumn("95 % from", "N", digits=3, of="error_low"),
        TableColumn("to", "N", digits=3, of="error_high"),
        *motor_columns(torque_per_force, {"rms error": "error"}),
        TableColumn("of the range", "%", digits=2, of=lambda row: 100 * row.error / row.range),
        TableColumn("largest residual", "N", digits=3, of="largest_residual", screen=False),
        TableColumn("no noise", "N", digits=3, of="largest_error", screen=False),
        TableColumn("tolerance", "N", digits=3, of="tolerance", screen=judged),
        TableColumn("kept", kind="text", of=lambda row: str(row.kept.value), screen=judged),
    )
    caption = "Error of the prediction, noise subtracted where it is known"
    return ReportTable.of("prediction_errors", caption, columns, result.errors, screen=True)


def _actuators_table(result: ValidationResult) -> ReportTable:
    columns = (
        TableColumn("no."),
        TableColumn("motion", kind="text"),
        TableColumn("actuator"),
        TableColumn("rms force", "N", digits=3, screen=False),
        TableColumn("rms error", "N", digits=3, screen=False),
        TableColumn("variance about prediction", "N^2"),
        TableColumn("variance of noise", "N^2"),
        TableColumn("F"),
        TableColumn("p", digits=2, screen=False),
        TableColumn("verdict", kind="outcome"),
    )
    caption = "Measured against predicted forces: lack-of-fit test of each actuator"
    rows = map(astuple, result.rows)
    return ReportTable.of("validation", caption, columns, rows, screen=True, latex=True)


_DEGREES = float(np.degrees(1))


def feedforward_view(folder: RunFolder) -> StageView:
    """Return the view of the comparison in a folder."""
    summary = folder.result(FeedforwardResult)
    best, without = summary.case("identified"), summary.case("none")
    good = best.reduction > 1
    sentence = (
        f"With the forces of the {summary.estimator.upper()} estimate fed "
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


def _struts(result: FeedforwardResult) -> ReportTable:
    columns = (
        TableColumn("feed-forward", kind="text", of="case"),
        TableColumn("strut", of="strut"),
        TableColumn("rms error", "µm", digits=3, of="rms", factor=1e6),
        TableColumn("largest", "µm", digits=3, of="max", factor=1e6),
        TableColumn("feedback, rms", "N", digits=3, of="rms_feedback"),
    )
    caption = "Tracking error strut by strut"
    return ReportTable.of("feedforward", caption, columns, result.rows, folded=True)


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
