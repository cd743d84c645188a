"""The report of one run folder: a page with the view of every stage, summary and verdicts first."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.identification.result import EstimationResult
from expdesign.configuration import RunConfiguration
from expdesign.experiment import DesignResult
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.progress import report_progress, track
from expdesign.recheck.limit_check import REACHED, reached_limits
from expdesign.robot import LimitModel, Robot
from expdesign.runfolder.files import write_text
from results.notation import duration
from results.render.figures import draw_figures, embed_drawings, embedded_format, other_figures
from results.render.markup import html_page, latex_table
from results.views.export import control_models_section
from results.views.folder import RunFolder, ViewedStage
from results.views.view import (
    Animation,
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
    drawn. The `report` section is by default that of the folder's `run.yaml`, which the last stage
    has written. Stages are in the order of their sections; results in memory are not read again.
    """
    folder = RunFolder.open(path, stages, results)
    if configuration is not None:
        run = folder.configuration.run.model_copy(update={"report": configuration.run.report})
        folder = replace(folder, configuration=replace(folder.configuration, run=run))
    formats = folder.configuration.run.report.figures
    views = {name: folder.view(name) for name in track("sections", folder.held)}
    report_progress("drawing missing figures")
    written = [
        file for view in views.values() for file in draw_figures(view, path, formats, missing=True)
    ]
    with TemporaryDirectory() as own:
        pictures = path
        if embedded_format(formats) not in formats:  # PDF, which no page can show
            pictures = Path(own)
            for view in views.values():
                draw_figures(view, pictures, ("svg",))
        page = run_page(folder, views, pictures)
    for table in page.tables:
        if table.latex and table.rows:
            file = path / "tables" / f"{table.key}.tex"
            write_text(file, latex_table(table))
            written.append(file)
    report_progress("writing the page")
    write_text(path / NAME, html_page(page))
    return [*written, path / NAME]


def run_page(
    folder: RunFolder, views: Mapping[str, StageView], pictures: Path | None = None
) -> Page:
    """Return the page of a folder with the views of its stages.

    The figures are those of the folder, or of another one for `pictures`.
    """
    run, place = folder.configuration.run, pictures or folder.path
    ending = embedded_format(run.report.figures)
    sections = [view.section for view in views.values()]
    animation = robot_animation(folder)
    if animation is not None:
        sections.insert(0, PageSection("motion", "Robot in motion", (animation,)))
    models = control_models_section(folder)
    if models is not None:
        sections.append(models)
    sections = [page_section(section, place, ending) for section in sections]
    blocks = (block for section in sections for block in section.blocks)
    known = {block.key for block in blocks if isinstance(block, EmbeddedFigure)}
    if further := other_figures(place, known, ending):
        sections.append(PageSection("further", "Further figures", further))
    sections.append(_provenance(folder))
    changed = (*folder.changes.folder, *folder.changes.pages)
    warnings = [text for view in views.values() for text in view.warnings]
    return Page(
        title=run.report.title or run.name,
        subtitle=f"Run {run.name}, robot {folder.configuration.robot.name}",
        description=run.description,
        verdicts=tuple(_with_failures(folder, views)),
        facts=tuple(fact for view in views.values() for fact in view.facts),
        sections=tuple(sections),
        warnings=tuple(dict.fromkeys((*changed, *(warnings or folder.configuration.warnings)))),
    )


def page_section(section: PageSection, folder: Path, ending: str = "svg") -> PageSection:
    """Return a section for a page: figures from files of the folder, findings as tables."""
    blocks = (b.table if isinstance(b, FindingsBlock) else b for b in section.blocks)
    return replace(section, blocks=embed_drawings(blocks, folder, ending))


def _with_failures(folder: RunFolder, views: Mapping[str, StageView]) -> list[StageVerdict]:
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
    resolved = (folder.path / "run.yaml").read_text(encoding="utf-8")
    blocks.append(ListingBlock("run.yaml: the resolved configuration", resolved))
    return PageSection("provenance", "Configuration and versions", tuple(blocks))


_FRAMES = 240
"""Most instants of one period in the view: finer than the eye at the speed of the machine."""
_LIMITED_FORCE = "actuator_force"


@dataclass(frozen=True, eq=False)
class _Motion:
    """A motion of one period: states (N, 18) and forces (N, 6) at times (N,), SI."""

    what: str
    model: str
    """Of the forces."""
    time: Array
    states: Array
    force: Array


def robot_animation(folder: RunFolder) -> Animation | None:
    """Return the moving robot of a folder's design, else of its estimate; None without either."""
    motion = _motion(folder)
    if motion is None:
        return None
    caption = (
        f"{motion.what} over one period, struts coloured by the actuator force {motion.model}; "
        "positive extends. In magenta: struts, and the platform, that use "
        f"{100 * REACHED:g} % of a limit or more at the moment shown; the bar below the slider "
        "shows the times. Drag to rotate, scroll to zoom."
    )
    robot, time, pose = folder.configuration.robot, motion.time, motion.states[:, :COORDINATES]
    period = float(time[-1] - time[0]) * time.size / (time.size - 1)
    chosen = np.unique(np.linspace(0, time.size, _FRAMES, endpoint=False).astype(np.intp))
    joints = np.stack([robot.struts_at(place).joints for place in pose[chosen]])
    largest = float(np.max(np.abs(motion.force)))
    data = {
        "period": round(period, 9),
        "time": _round(time[chosen] - time[0], 5),
        "base": _round(1e3 * robot.base_joints, 2),
        "joints": _round(1e3 * joints, 2),
        "tool": _round(1e3 * pose[chosen, :3], 2),
        "force": _round(motion.force[chosen], 2),
        "largest": largest if largest > 0 else 1.0,
        **_limits(Robot(robot), motion, chosen),
    }
    return Animation("robot", caption, data)


def _motion(folder: RunFolder) -> _Motion | None:
    if folder.has("design"):
        one = folder.result(DesignResult).motion
        states = np.concatenate([one.pose, one.pose_rate, one.pose_acceleration], axis=1)
        what, model = "The designed trajectory", "at the nominal parameters"
        return _Motion(what, model, one.time, states, one.force)
    motions = folder.result(EstimationResult).motions if folder.has("estimate") else {}
    if 1 not in motions or len(motions[1].time) < 2:  # noqa: PLR2004 - it begins and ends
        return None
    executed = motions[1]
    what, model = "The executed motion as it was estimated,", "of the estimated model"
    return _Motion(what, model, executed.time, executed.state, executed.forces_model)


def _limits(robot: Robot, motion: _Motion, chosen: NDArray[np.intp]) -> dict[str, Any]:
    """Return the limits that are reached, and the reached ones of every frame.

    `limits` has title, row, struts (from zero), and whether the limit belongs to the platform;
    `reached` has positions in it, frame by frame, for the time until the next frame.
    """
    model = LimitModel.of(robot)
    values = model.values(motion.states)
    for limit, columns in zip(model.limits, model.columns, strict=True):
        if limit.key == _LIMITED_FORCE:
            # Those that are shown, which may be of an estimate.
            values[:, columns] = motion.force
    at = reached_limits(model, values)
    by_frame = np.logical_or.reduceat(at, chosen, axis=0)
    rows = np.flatnonzero(np.any(by_frame, axis=0))
    position = {row: k for k, row in enumerate(rows.tolist())}
    named = [(limit.definition.title, label) for limit in model.limits for label in limit.labels]
    return {
        "limits": [_limit_entry(*named[row]) for row in rows],
        "reached": [
            [position[row] for row in np.flatnonzero(frame).tolist()] for frame in by_frame
        ],
    }


def _limit_entry(title: str, row: str) -> dict[str, Any]:
    word, _, numbers = row.partition(" ")
    of_struts = word in ("strut", "struts")
    struts = [int(number) - 1 for number in numbers.split("-")] if of_struts else []
    return {"title": title, "row": row, "struts": struts, "platform": not of_struts}


def _round(values: Array, digits: int) -> Any:
    # Adding zero turns −0.0 into 0.0.
    return (np.round(values, digits) + 0.0).tolist()
