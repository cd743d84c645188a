"""The report of one run folder: every stage it holds, summary and verdict first."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from estimation.controlmodel import FOLDER
from expdesign.configuration import RunConfiguration
from expdesign.progress import report_progress, track
from expdesign.runfolder.files import write_text
from results.notation import duration
from results.render.html import latex_table, rendered
from results.views.folder import ReportedStage, RunFolder
from results.views.robot_motion import robot_view
from results.views.view import (
    Block,
    Fact,
    Facts,
    FigureBlock,
    Level,
    ListingBlock,
    Page,
    ReportSection,
    ReportTable,
    StageVerdict,
    StageView,
    TableColumn,
    TextBlock,
    text_columns,
)

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
    "sweep",
)
"""Tables that are written as LaTeX too."""

_DRAWN = {
    "design": ("expdesign.experiment:DesignResult", "excitation"),
    "montecarlo": ("estimation.montecarlo.result:MonteCarloResult", "montecarlo_bias"),
    "estimate": ("estimation.identification.record:EstimateRecord", "estimates"),
    "validate": ("estimation.validation.validate:ValidationRecord", "prediction_1"),
    "feedforward": ("estimation.feedforward.result:FeedforwardResult", "feedforward"),
    "sweep": ("expdesign.experiment.sweep:SweepResult", "sweep"),
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
        What is in memory of the folder, such as a `DesignResult`; it is not read again.

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
    report_progress("writing the page")
    write_text(path / NAME, rendered(page))
    return [*written, path / NAME]


def run_page(folder: RunFolder) -> Page:
    """Return what the report of a folder says."""
    held = [key for key in folder.stages if folder.has(key)]
    reports = {key: folder.stages[key].report(folder) for key in track("sections", held)}
    run = folder.configuration.run
    view = robot_view(folder)
    sections = [report.section for report in reports.values()]
    if view is not None:
        sections.insert(0, ReportSection("motion", "Robot in motion", (view,)))
    if (folder.path / FOLDER).is_dir():
        from results.views.control_models import control_model_section

        models = control_model_section(folder)
        if models is not None:
            sections.append(models)
    blocks = (block for section in sections for block in section.blocks)
    further = folder.other_figures({b.key for b in blocks if isinstance(b, FigureBlock)})
    if further:
        sections.append(ReportSection("further", "Further figures", further))
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


def _with_failures(folder: RunFolder, reports: dict[str, StageView]) -> list[StageVerdict]:
    """Return the stages' verdicts, and what the manifest says of stages that failed."""
    verdicts = [report.verdict for report in reports.values()]
    stages = {} if folder.manifest is None else folder.manifest.stages
    for name, entry in stages.items():
        if entry.status == "failed" and name != OWN_STAGE:
            sentence = f"The last attempt failed: {entry.message}"
            if name in reports:
                sentence += " What is shown here is of an earlier one."
            verdicts.append(StageVerdict(f"Stage {name}", Level.BAD, "failed", sentence))
    return verdicts


def _provenance(folder: RunFolder) -> ReportSection:
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
            TableColumn("stage", kind="text"),
            TableColumn("status", kind="outcome"),
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
    return ReportSection("provenance", "Configuration and versions", tuple(blocks))


def _missing_figures(folder: RunFolder) -> list[Path]:
    """Draw what is missing in a format that is wanted, and the motion of controller tables."""
    formats = folder.configuration.run.report.figures

    def missing(stem: str) -> bool:
        place = folder.path / "figures"
        return any(not (place / f"{stem}.{ending}").is_file() for ending in {*formats, "svg"})

    drawn: list[Path] = []
    report_progress("looking for figures")
    for stage, (kind, figure) in _DRAWN.items():
        if folder.has(stage) and missing(figure):
            from results.saving import record_figures

            record = folder.record(resolve_name(kind))
            drawn += record_figures(record, folder.path, formats)
    if folder.has("design") and folder.has("export"):
        # Always: a table that was exported by hand may be of another motion than the figure.
        from expdesign.experiment import DesignResult
        from expdesign.export.result import ExportResult
        from results.saving import whole_motion_figure

        design, exports = folder.record(DesignResult), folder.record(ExportResult)
        drawn += whole_motion_figure(design, exports, folder.path, formats)
    return drawn
