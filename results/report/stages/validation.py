"""What a report says of a validation."""

from __future__ import annotations

from results.reading.document import Document
from results.reading.table import Table
from results.report.content import (
    Block,
    Fact,
    Level,
    Section,
    StageReport,
    TableBlock,
    TextBlock,
    Verdict,
)
from results.report.folder import RunFolder
from results.report.stages.estimate import NAMES
from results.report.stages.findings import (
    against,
    findings_table,
    model_findings,
    verdict_level,
)
from results.report.table import Column, ReportTable


def validation_report(folder: RunFolder) -> StageReport:
    """Return what is to be said of the validation in a folder."""
    document = folder.document("validate")
    motions = document.sections("motions")
    table, outcomes = _actuators_table(folder)
    passed = sum(outcome == "passes" for outcome in outcomes)
    estimator = document.text("estimator")
    blocks: list[Block] = [TableBlock(table)]
    for number, motion in enumerate(motions, start=1):
        diagnostics = motion.section("diagnostics")
        told = against(diagnostics) or diagnostics.section("verdict").text("summary")
        told = f"{_title(number, motion)}: {told}."
        blocks.append(TextBlock((told,), verdict_level(diagnostics)))
        blocks += folder.figures(f"prediction_{number}")
        blocks.append(
            TableBlock(
                findings_table(
                    f"findings_{number}",
                    model_findings(diagnostics),
                    f"the prediction of motion {number}",
                )
            )
        )
    accepted = document.flag("accepted")
    names = "; ".join(motion.text("name") for motion in motions)
    failed = [
        str(number)
        for number, motion in enumerate(motions, start=1)
        if verdict_level(motion.section("diagnostics")) is Level.BAD
    ]
    sentence = (
        f"The {NAMES.get(estimator, estimator)} estimate predicts the forces of {len(motions)} "
        f"motion{'s' if len(motions) > 1 else ''} ({names}): {passed} of {len(outcomes)} actuator "
        "tests pass."
    )
    if failed:
        which = (
            f"motions {', '.join(failed)} speak"
            if len(failed) > 1
            else f"motion {failed[0]} speaks"
        )
        sentence += f" {which[0].upper()}{which[1:]} against the model."
    verdict = Verdict(
        "Validation",
        Level.GOOD if accepted else Level.BAD,
        "accepted" if accepted else "doubtful",
        sentence,
        "validation",
    )
    return StageReport(
        verdict,
        (
            Fact(
                "actuator tests passed",
                f"{passed} of {len(outcomes)}",
                f"lack of fit on {len(motions)} motion{'s' if len(motions) > 1 else ''}",
            ),
        ),
        (Section("validation", "Validation", tuple(blocks)),),
        document.texts("warnings"),
    )


def _title(number: int, motion: Document) -> str:
    simulated = "simulated" if motion.flag("simulated") else "measured"
    return f"Motion {number}, {motion.text('name')} ({simulated})"


def _actuators_table(folder: RunFolder) -> tuple[ReportTable, list[str]]:
    numbers = (
        "number",
        "actuator",
        "rms_measured",
        "rms_residual",
        "variance_model_error",
        "variance_measurement_error",
        "statistic",
        "p_value",
    )
    table = Table.read(folder.table_file("validation"), [*numbers, "motion", "verdict"])
    cells = {name: table.numbers(name, blank=True).tolist() for name in numbers}
    verdicts = list(table.columns["verdict"])
    rows = [
        (
            cells["number"][k],
            table.columns["motion"][k],
            *(cells[name][k] for name in numbers[1:]),
            verdicts[k],
        )
        for k in range(len(table))
    ]
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
    return ReportTable.of("validation", caption, columns, rows), verdicts
