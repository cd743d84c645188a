"""The report of one run folder: every stage it holds, summary and verdict first."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from constraints.arrays import Array
from estimation.identification.record import EstimateRecord
from estimation.montecarlo.record import MonteCarloRecord
from estimation.validation.record import ValidationRecord
from expdesign.configuration import RunConfiguration
from expdesign.experiment import DesignRecord
from expdesign.export.record import ExportsRecord
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.progress import tell, told
from expdesign.runfolder.atomic import write_text
from results.notation import duration
from results.report.content import (
    Block,
    Fact,
    Facts,
    FigureBlock,
    Level,
    ListingBlock,
    Page,
    Section,
    StageReport,
    TextBlock,
    Verdict,
    ViewBlock,
)
from results.report.folder import ReportedStage, RunFolder
from results.report.rendering import latex_table, rendered
from results.report.table import Column, ReportTable, text_columns
from results.saving import record_figures, whole_motion_figure

NAME = "report.html"
OWN_STAGE = "report"
"""Stage of the manifest that tells of the report itself: a report says nothing of it."""

LATEX_TABLES = (
    "limits",
    "parameters",
    "estimates",
    "estimators",
    "validation",
    "montecarlo",
    "study_claims",
)
"""Tables that are written as LaTeX too."""

_FRAMES = 240
"""Most instants of one period in the view: finer than the eye at the speed of the machine."""

_DRAWN: dict[str, tuple[type[Any], str]] = {
    "design": (DesignRecord, "excitation"),
    "montecarlo": (MonteCarloRecord, "montecarlo_bias"),
    "estimate": (EstimateRecord, "estimates"),
    "validate": (ValidationRecord, "prediction_1"),
}
"""What a stage leaves, and a figure of it: where that is missing, all of them are drawn."""


def write_report(
    path: Path,
    stages: Mapping[str, ReportedStage],
    configuration: RunConfiguration | None = None,
    records: Iterable[Any] = (),
) -> list[Path]:
    """Write `report.html` and `tables/*.tex` into a run folder; return the files.

    The same folder gives the same bytes. Figures that are missing in a format of `report.figures`
    are drawn.

    Parameters
    ----------
    stages : mapping of str to ReportedStage
        Those that are reported, in the order of their sections.
    configuration : RunConfiguration, optional
        Whose `report` section counts; the folder's `run.yaml` by default, which the stage that
        wrote last has left.
    records : iterable
        What is in memory of the folder, such as a `DesignRecord`; it is not read again.

    Raises
    ------
    InputError
        It is no run folder, or a file of it is missing or does not hold what it should.
    """
    folder = RunFolder.open(path, stages, records)
    if configuration is not None:
        run = folder.configuration.run.model_copy(update={"report": configuration.run.report})
        folder = replace(folder, configuration=replace(folder.configuration, run=run))
    written = _missing_figures(folder)
    page = run_page(folder)
    for table in page.tables:
        if table.key in LATEX_TABLES and table.rows:
            file = path / "tables" / f"{table.key}.tex"
            write_text(file, latex_table(table))
            written.append(file)
    tell("writing the page")
    write_text(path / NAME, rendered(page))
    return [*written, path / NAME]


def run_page(folder: RunFolder) -> Page:
    """Return what the report of a folder says."""
    held = [key for key in folder.stages if folder.has(key)]
    reports = {key: folder.stages[key].report(folder) for key in told("sections", held)}
    run = folder.configuration.run
    view = _robot_view(folder)
    sections = [report.section for report in reports.values()]
    if view is not None:
        sections.insert(0, Section("motion", "Robot in motion", (view,)))
    blocks = (block for section in sections for block in section.blocks)
    further = folder.other_figures({b.key for b in blocks if isinstance(b, FigureBlock)})
    if further:
        sections.append(Section("further", "Further figures", further))
    sections.append(_provenance(folder))
    warnings = [text for report in reports.values() for text in report.warnings]
    return Page(
        title=run.report.title or run.name,
        subtitle=f"Run {run.name}, robot {folder.configuration.robot.name}",
        description=run.description,
        verdicts=tuple(_with_failures(folder, reports)),
        facts=tuple(fact for report in reports.values() for fact in report.facts),
        sections=tuple(sections),
        warnings=tuple(dict.fromkeys(warnings or folder.configuration.warnings)),
    )


def _robot_view(folder: RunFolder) -> ViewBlock | None:
    """Return the motion of a folder: of its design, else of its estimate; None without either."""
    if folder.has("design"):
        motion = folder.record(DesignRecord).motion
        time, pose, force = motion.time, motion.pose, motion.force
        what, model = "The designed trajectory", "at the nominal parameters"
    else:
        motions = folder.record(EstimateRecord).motions if folder.has("estimate") else {}
        if 1 not in motions or len(motions[1].time) < 2:  # noqa: PLR2004 - it begins and ends
            return None
        executed = motions[1]
        time, force = executed.time, executed.forces_model
        pose = executed.state[:, :COORDINATES]
        what, model = "The executed motion as it was estimated,", "of the estimated model"
    caption = (
        f"{what} over one period, struts coloured by the actuator force {model}; positive extends. "
        "Drag to rotate, scroll to zoom."
    )
    robot = folder.configuration.robot
    period = float(time[-1] - time[0]) * time.size / (time.size - 1)
    chosen = np.unique(np.linspace(0, time.size, _FRAMES, endpoint=False).astype(int))
    joints = np.stack([robot.struts_at(place).joints for place in pose[chosen]])
    largest = float(np.max(np.abs(force)))
    data = {
        "period": round(period, 9),
        "time": _rounded(time[chosen] - time[0], 5),
        "base": _rounded(1e3 * robot.base_joints, 2),
        "joints": _rounded(1e3 * joints, 2),
        "tool": _rounded(1e3 * pose[chosen, :3], 2),
        "force": _rounded(force[chosen], 2),
        "largest": largest if largest > 0 else 1.0,
    }
    return ViewBlock("robot", caption, data)


def _rounded(values: Array, digits: int) -> Any:
    # Adding zero turns −0.0 into 0.0.
    return (np.round(values, digits) + 0.0).tolist()


def _with_failures(folder: RunFolder, reports: dict[str, StageReport]) -> list[Verdict]:
    """Return the stages' verdicts, and what the manifest says of stages that failed."""
    verdicts = [report.verdict for report in reports.values()]
    stages = {} if folder.manifest is None else folder.manifest.stages
    for name, entry in stages.items():
        if entry.status == "failed" and name != OWN_STAGE:
            sentence = f"The last attempt failed: {entry.message}"
            if name in reports:
                sentence += " What is shown here is of an earlier one."
            verdicts.append(Verdict(f"Stage {name}", Level.BAD, "failed", sentence))
    return verdicts


def _provenance(folder: RunFolder) -> Section:
    """Return what made a run folder: stages, versions, seeds, files and the configuration."""
    blocks: list[Block] = []
    manifest = folder.manifest
    if manifest is None:
        known = ", ".join(stage.file for stage in folder.stages.values())
        text = f"The folder has no manifest.json: a stage is there when its file is, of {known}."
        blocks.append(TextBlock(text, Level.CAUTION))
    else:
        stages = {name: entry for name, entry in manifest.stages.items() if name != OWN_STAGE}
        columns = (
            Column("stage", kind="text"),
            Column("status", kind="outcome"),
            *text_columns("time", "finished (UTC)", "message"),
        )
        rows = [
            (name, entry.status, duration(entry.seconds), entry.finished, entry.message)
            for name, entry in stages.items()
        ]
        blocks.append(ReportTable.of("stages", "Stages of the run", columns, rows))
        blocks.append(
            Facts(tuple(Fact(name, str(value)) for name, value in manifest.versions.items()))
        )
        seeds = ", ".join(f"{name} {seed}" for name, seed in manifest.seeds.items())
        blocks.append(TextBlock(f"Seeds: {seeds}. Evaluation: {manifest.evaluation}."))
        files = [
            (file, name, digest)
            for name, entry in stages.items()
            for file, digest in entry.files.items()
        ]
        heads = text_columns("file", "stage", "SHA-256")
        blocks.append(ReportTable.of("files", "Files of the run folder", heads, files, folded=True))
    resolved = folder.text(folder.path / "run.yaml")
    blocks.append(ListingBlock("run.yaml: the resolved configuration", resolved))
    return Section("provenance", "Configuration and versions", tuple(blocks))


def _missing_figures(folder: RunFolder) -> list[Path]:
    """Draw what is missing in a format that is wanted, and the motion of controller tables."""
    formats = folder.configuration.run.report.figures

    def missing(stem: str) -> bool:
        place = folder.path / "figures"
        return any(not (place / f"{stem}.{ending}").is_file() for ending in {*formats, "svg"})

    drawn: list[Path] = []
    tell("looking for figures")
    for stage, (kind, figure) in _DRAWN.items():
        if folder.has(stage) and missing(figure):
            drawn += record_figures(folder.record(kind), folder.path, formats)
    if folder.has("design") and folder.has("export"):
        # Always: a table that was exported by hand may be of another motion than the figure.
        record, exports = folder.record(DesignRecord), folder.record(ExportsRecord)
        drawn += whole_motion_figure(record, exports, folder.path, formats)
    return drawn
