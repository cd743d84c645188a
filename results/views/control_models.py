"""View of control models: self-tests and uncertainty of the forces."""

from __future__ import annotations

from collections.abc import Mapping

from estimation.controlmodel import FOLDER
from estimation.controlmodel.formats import ControlModelFile
from expdesign.configuration.identification import IDENTIFIED_ROBOT as IDENTIFIED
from expdesign.runfolder.manifest import file_hash
from results.views.folder import RunFolder
from results.views.view import (
    Block,
    Level,
    PageSection,
    ReportTable,
    StageVerdict,
    StageView,
    TableColumn,
    TextBlock,
    Value,
    text_columns,
)


def control_models_section(folder: RunFolder) -> PageSection | None:
    """Return the section on a run folder's control models; None without any."""
    places = sorted(folder.path.glob(f"{FOLDER}/*/{ControlModelFile.FILE}"))
    models = {f"{FOLDER}/{one.parent.name}": ControlModelFile.read(one) for one in places}
    if not models:
        return None
    blocks = list(control_models_view(models).blocks)
    robot = folder.path / IDENTIFIED
    digest = file_hash(robot) if robot.is_file() else ""
    old = [name for name, one in models.items() if one.origin.sha256 != digest]
    if old:
        text = f"Made from another robot than the folder's: {', '.join(old)}. Write them again."
        blocks.insert(1, TextBlock(text, Level.CAUTION))
    return PageSection("model", "Control models", tuple(blocks))


def control_models_view(models: Mapping[str, ControlModelFile]) -> StageView:
    """Return the view of control models, by their folders."""
    first = next(iter(models.values()))
    origins = "; ".join(dict.fromkeys(one.origin.sentence for one in models.values()))
    verdict = StageVerdict("Control model", Level.NEUTRAL, first.title, f"From {origins}.", "model")
    blocks: list[Block] = [
        TextBlock(f"The identified robot for a controller: {origins}."),
        _tests_table(models),
    ]
    stated = [one for one in models.values() if one.uncertainty]
    if stated:
        # One table for all formats; models of an earlier estimate are named.
        blocks.append(_uncertainty_table(stated[0]))
    return StageView(verdict, tuple(blocks))


def _tests_table(models: Mapping[str, ControlModelFile]) -> ReportTable:
    rows: list[tuple[Value, ...]] = []
    for name, one in models.items():
        rows += [
            (name, one.title, t.precision, t.compiler, t.deviation, t.median, t.most, t.worst)
            for t in one.tests
        ] or [(name, one.title, None, one.untested, *[None] * 4)]
    times = ("call, median", "99.9 % of calls", "longest call")
    columns = (
        *text_columns("folder", "format", "precision", "tested by"),
        TableColumn("forces off by", "N", digits=2),
        *(TableColumn(title, "µs", digits=3, factor=1e6) for title in times),
    )
    caption = (
        "Self-tests on the computer that wrote the models: largest deviation from the identified "
        "robot's forces, and the time of one call of the inverse dynamics"
    )
    return ReportTable.of("control_models", caption, columns, rows, screen=True)


def _uncertainty_table(model: ControlModelFile) -> ReportTable:
    columns = (
        TableColumn("actuator", of="actuator"),
        TableColumn("σ, rms", "N", digits=3, of="rms"),
        TableColumn("σ, largest", "N", digits=3, of="largest"),
        TableColumn("random share, rms", "N", digits=3, of="rms_random"),
        TableColumn("largest force", "N", of="largest_force"),
    )
    caption = (
        f"Standard deviation σ of the model's forces along {model.motion}, from the covariance of "
        "the parameters"
    )
    rows = model.uncertainty
    return ReportTable.of("force_uncertainty", caption, columns, rows, screen=True)
