"""The report of one run folder: a page with the view of every stage, summary and verdicts first."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from expdesign.configuration import RunConfiguration
from expdesign.progress import report_progress, track
from expdesign.runfolder.files import write_text
from results.notation import duration
from results.render.figures import draw_figures, embed_drawings, other_figures
from results.render.html import html_page
from results.render.latex import latex_table
from results.views.control_models import control_models_section
from results.views.folder import RunFolder, ViewedStage
from results.views.robot_motion import robot_animation
from results.views.view import (
    Block,
    EmbeddedFigure,
    Fact,
    Facts,
    FindingsBlock,
    Level,
    ListingBlock,
    Page,
    PageSection,
    ReportTable,
    StageVerdict,
    StageView,
    TableColumn,
    TextBlock,
    text_columns,
)

NAME = "report.html"
OWN_STAGE = "report"
"""Stage of the report itself in the manifest, without a section."""


def write_report(
    path: Path,
    stages: Mapping[str, ViewedStage],
    configuration: RunConfiguration | None = None,
    results: Iterable[Any] = (),
) -> list[Path]:
    """Write `report.html` and `tables/*.tex` into a run folder; return the files.

    The same folder gives the same bytes. Figures without a file in a format of `report.figures` are
    drawn.

    Parameters
    ----------
    path : Path
    stages : mapping of str to ViewedStage
        Stages in the order of their sections.
    configuration : RunConfiguration, optional
        Run whose `report` section is used; by default the folder's `run.yaml`, which the last stage
        has written.
    results : iterable
        Results in memory, such as a `DesignResult`; they are not read again.

    Raises
    ------
    InputError
        The folder is no run folder, or a file of it is missing or invalid.
    """
    folder = RunFolder.open(path, stages, results)
    if configuration is not None:
        run = folder.configuration.run.model_copy(update={"report": configuration.run.report})
        folder = replace(folder, configuration=replace(folder.configuration, run=run))
    formats = folder.configuration.run.report.figures
    views = {name: stages[name].view(folder) for name in track("sections", folder.held)}
    report_progress("drawing missing figures")
    written = [
        file for view in views.values() for file in draw_figures(view, path, formats, missing=True)
    ]
    page = run_page(folder, views)
    for table in page.tables:
        if table.latex and table.rows:
            file = path / "tables" / f"{table.key}.tex"
            write_text(file, latex_table(table))
            written.append(file)
    report_progress("writing the page")
    write_text(path / NAME, html_page(page))
    return [*written, path / NAME]


def run_page(folder: RunFolder, views: Mapping[str, StageView]) -> Page:
    """Return the page of a folder with the views of its stages."""
    run = folder.configuration.run
    sections = [view.section for view in views.values()]
    animation = robot_animation(folder)
    if animation is not None:
        sections.insert(0, PageSection("motion", "Robot in motion", (animation,)))
    models = control_models_section(folder)
    if models is not None:
        sections.append(models)
    sections = [page_section(section, folder.path) for section in sections]
    blocks = (block for section in sections for block in section.blocks)
    known = {block.key for block in blocks if isinstance(block, EmbeddedFigure)}
    if further := other_figures(folder.path, known):
        sections.append(PageSection("further", "Further figures", further))
    sections.append(_provenance(folder))
    warnings = [text for view in views.values() for text in view.warnings]
    return Page(
        title=run.report.title or run.name,
        subtitle=f"Run {run.name}, robot {folder.configuration.robot.name}",
        description=run.description,
        verdicts=tuple(_with_failures(folder, views)),
        facts=tuple(fact for view in views.values() for fact in view.facts),
        sections=tuple(sections),
        warnings=tuple(dict.fromkeys(warnings or folder.configuration.warnings)),
    )


def page_section(section: PageSection, folder: Path) -> PageSection:
    """Return a section for a page: figures from files of the folder, findings as tables."""
    blocks = (b.table if isinstance(b, FindingsBlock) else b for b in section.blocks)
    return replace(section, blocks=embed_drawings(blocks, folder))


def _with_failures(folder: RunFolder, views: Mapping[str, StageView]) -> list[StageVerdict]:
    """Return the stages' verdicts, and the manifest's entries of failed stages."""
    verdicts = [view.verdict for view in views.values()]
    stages = {} if folder.manifest is None else folder.manifest.stages
    for name, entry in stages.items():
        if entry.status == "failed" and name != OWN_STAGE:
            sentence = f"The last attempt failed: {entry.message}"
            if name in views:
                sentence += " The section shows an earlier one."
            verdicts.append(StageVerdict(f"Stage {name}", Level.BAD, "failed", sentence))
    return verdicts


def _provenance(folder: RunFolder) -> PageSection:
    """Return the origin of a run folder: stages, versions, seeds, files and the configuration."""
    blocks: list[Block] = []
    manifest = folder.manifest
    if manifest is None:
        known = ", ".join(stage.file for stage in folder.stages.values())
        text = f"The folder has no manifest.json; its stages are known by their files: {known}."
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
    return PageSection("provenance", "Configuration and versions", tuple(blocks))
