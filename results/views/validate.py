"""View of a validation: predicted against measured forces."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np

from estimation.validation.prediction_error import Kept
from estimation.validation.validate import PredictedMotion, ValidationResult
from results.figures.residuals import prediction_figure
from results.notation import counted
from results.views.estimate import NAMES
from results.views.findings import contradictions, count_findings, findings_block, verdict_level
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
    record = folder.result(ValidationResult)
    passed = f"{sum(row.verdict == 'passes' for row in record.rows)} of {len(record.rows)}"
    blocks: list[Block] = []
    if record.errors:
        blocks.append(_errors_table(record))
    blocks.append(_actuators_table(record))
    for number, motion in enumerate(record.motions, start=1):
        verdict = motion.diagnostics.verdict
        how = "simulated" if motion.simulated else "measured"
        finding = contradictions(verdict)
        finding = f"{count_findings(verdict)}: {finding}" if finding else verdict.summary
        text = f"Motion {number}, {motion.name} ({how}): {finding}."
        if motion.tolerance_words:
            text += f" It is {motion.tolerance_words}."
        blocks.append(TextBlock(text, verdict_level(verdict), screen=True))
        if motion.errors:
            blocks.append(_accuracy(motion))
        blocks.append(Drawing(prediction_figure, record.predictions[number - 1], number))
        subject = f"the prediction of motion {number}"
        blocks.append(findings_block(f"findings_{number}", verdict.findings, subject))
    motions = counted(len(record.motions), "motion")
    sentence = (
        f"The {NAMES.get(record.estimator, record.estimator)} estimate predicts the forces of "
        f"{motions} ({'; '.join(motion.name for motion in record.motions)}): {passed} actuator "
        "tests pass."
    )
    failed = [
        str(number)
        for number, motion in enumerate(record.motions, start=1)
        if motion.tolerance is None and verdict_level(motion.diagnostics.verdict) is Level.BAD
    ]
    if failed:
        several = len(failed) > 1
        which = f"Motions {', '.join(failed)}" if several else f"Motion {failed[0]}"
        sentence += f" {which} {'contradict' if several else 'contradicts'} the model."
    judged_by_size = [motion for motion in record.motions if motion.tolerance is not None]
    if judged_by_size:
        kept = sum(motion.within is True for motion in judged_by_size)
        sentence += (
            f" {kept} of {counted(len(judged_by_size), 'motion')} with a tolerance "
            f"{'keeps' if kept == 1 else 'keep'} it."
        )
    undecided = any(motion.within is None for motion in judged_by_size)
    level, word = (Level.GOOD, "accepted") if record.accepted else (Level.BAD, "doubtful")
    if record.accepted and undecided:
        level, word = Level.CAUTION, "not decided"
    facts = (Fact("actuator tests passed", passed, f"lack of fit on {motions}"),)
    judged = StageVerdict("Validation", level, word, sentence, "validation")
    return StageView(judged, tuple(blocks), facts, record.warnings)


def _accuracy(motion: PredictedMotion) -> TextBlock:
    """Return a text on the size of the error and the meaning of a failed test."""
    worst = max(motion.errors, key=lambda each: each.error_high)
    text = (
        f"The error of the prediction is at most {worst.error_high:.3g} N rms (actuator "
        f"{worst.actuator}, 95 %), {100 * worst.error_high / worst.range:.2g} % of the range of "
        "its force, noise subtracted."
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


def _errors_table(record: ValidationResult) -> ReportTable:
    judged = any(np.isfinite(row.tolerance) for row in record.errors)
    columns = (
        TableColumn("no.", of="number"),
        TableColumn("motion", kind="text", of="motion"),
        TableColumn("actuator", of="actuator"),
        TableColumn("rms error", "N", digits=3, of="error"),
        TableColumn("95 % from", "N", digits=3, of="error_low"),
        TableColumn("to", "N", digits=3, of="error_high"),
        TableColumn("of the range", "%", digits=2, of=lambda row: 100 * row.error / row.range),
        TableColumn("largest residual", "N", digits=3, of="largest_residual", screen=False),
        TableColumn("no noise", "N", digits=3, of="largest_error", screen=False),
        TableColumn("tolerance", "N", digits=3, of="tolerance", screen=judged),
        TableColumn("kept", kind="text", of=lambda row: str(row.kept.value), screen=judged),
    )
    caption = "Error of the prediction, noise subtracted"
    return ReportTable.of("prediction_errors", caption, columns, record.errors, screen=True)


def _actuators_table(record: ValidationResult) -> ReportTable:
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
    rows = map(astuple, record.rows)
    return ReportTable.of("validation", caption, columns, rows, screen=True, latex=True)
