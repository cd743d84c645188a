"""What a report says of a validation."""

from __future__ import annotations

from dataclasses import astuple

from estimation.validation.record import ValidationRecord
from results.notation import counted
from results.report.content import (
    Block,
    Fact,
    Level,
    StageReport,
    TextBlock,
    Verdict,
)
from results.report.findings import against, findings_table, verdict_level
from results.report.folder import RunFolder
from results.report.stages.estimate import NAMES
from results.report.table import Column, ReportTable


def validation_report(folder: RunFolder) -> StageReport:
    """Describe the validation in a folder."""
    record = folder.record(ValidationRecord)
    summary = record.summary
    passed = f"{sum(row.verdict == 'passes' for row in record.rows)} of {len(record.rows)}"
    blocks: list[Block] = [_actuators_table(record)]
    for number, motion in enumerate(summary.motions, start=1):
        verdict = motion.diagnostics.verdict
        how = "simulated" if motion.simulated else "measured"
        text = f"Motion {number}, {motion.name} ({how}): {against(verdict) or verdict.summary}."
        blocks.append(TextBlock(text, verdict_level(verdict)))
        blocks += folder.figures(f"prediction_{number}")
        title = f"the prediction of motion {number}"
        blocks.append(findings_table(f"findings_{number}", verdict.findings, title))
    motions = counted(len(summary.motions), "motion")
    sentence = (
        f"The {NAMES.get(summary.estimator, summary.estimator)} estimate predicts the forces of "
        f"{motions} ({'; '.join(motion.name for motion in summary.motions)}): {passed} actuator "
        "tests pass."
    )
    failed = [
        str(number)
        for number, motion in enumerate(summary.motions, start=1)
        if verdict_level(motion.diagnostics.verdict) is Level.BAD
    ]
    if failed:
        several = len(failed) > 1
        which = f"Motions {', '.join(failed)} speak" if several else f"Motion {failed[0]} speaks"
        sentence += f" {which} against the model."
    level, word = (Level.GOOD, "accepted") if summary.accepted else (Level.BAD, "doubtful")
    facts = (Fact("actuator tests passed", passed, f"lack of fit on {motions}"),)
    judged = Verdict("Validation", level, word, sentence, "validation")
    return StageReport(judged, tuple(blocks), facts, summary.warnings)


def _actuators_table(record: ValidationRecord) -> ReportTable:
    columns = (
        Column("no."),
        Column("motion", kind="text"),
        Column("actuator"),
        Column("rms force", "N", digits=3),
        Column("rms error", "N", digits=3),
        Column("variance about prediction", "N^2"),
        Column("variance of noise", "N^2"),
        Column("F"),
        Column("p", digits=2),
        Column("verdict", kind="outcome"),
    )
    caption = "Measured against predicted forces: lack-of-fit test of each actuator"
    return ReportTable.of("validation", caption, columns, map(astuple, record.rows))
