"""What a report says of the control models in a folder."""

from __future__ import annotations

from collections.abc import Mapping

from estimation.controlmodel import FOLDER
from estimation.controlmodel.formats import ControlModelFile
from estimation.identification.identified_robot import FILE as IDENTIFIED
from expdesign.runfolder.manifest import file_hash
from results.views.folder import RunFolder
from results.views.view import (
    Block,
    Level,
    ReportSection,
    ReportTable,
    TableColumn,
    TextBlock,
    Value,
    text_columns,
)


def control_model_section(folder: RunFolder) -> ReportSection | None:
    """Return the models that `expdesign model` wrote into a run folder; None without any."""
    places = sorted(folder.path.glob(f"{FOLDER}/*/{ControlModelFile.FILE}"))
    models = {f"{FOLDER}/{one.parent.name}": ControlModelFile.read(one) for one in places}
    if not models:
        return None
    blocks: list[Block] = [TextBlock(f"The identified robot for a controller: {_origins(models)}.")]
    robot = folder.path / IDENTIFIED
    digest = file_hash(robot) if robot.is_file() else ""
    old = [name for name, one in models.items() if one.origin.sha256 != digest]
    if old:
        text = f"Not of the robot that the folder holds now: {', '.join(old)}. Write them again."
        blocks.append(TextBlock(text, Level.CAUTION))
    blocks.append(_tests_table(models))
    stated = [one for one in models.values() if one.uncertainty]
    if stated:
        # That of all formats, unless some are of an earlier estimate, which is said.
        blocks.append(_uncertainty_table(stated[0]))
    return ReportSection("model", "Control models", tuple(blocks))


def _origins(models: Mapping[str, ControlModelFile]) -> str:
    return "; ".join(dict.fromkeys(one.origin.sentence for one in models.values()))


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
        "What the self-tests showed on the machine that wrote the models: worst deviation from the "
        "identified robot's forces, and the time of one call of the inverse dynamics"
    )
    return ReportTable.of("control_models", caption, columns, rows)


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
    return ReportTable.of("force_uncertainty", caption, columns, model.uncertainty)
