"""Views of the files for a controller: tables of the motion, and control models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from constraints import limit_definitions
from estimation.controlmodel import FOLDER
from estimation.controlmodel.formats import ControlModelFile
from expdesign.configuration.tolerances import IDENTIFIED_ROBOT as IDENTIFIED
from expdesign.experiment import DesignResult
from expdesign.export.result import README, RECORD, ExportedTable, ExportResult
from expdesign.export.table_file import unlisted_files
from expdesign.runfolder.manifest import file_hash
from results.figures.motion import RestToRestMotion, motion_figure
from results.notation import count_text, percent, readable
from results.views.blocks import motor_columns
from results.views.folder import RunFolder
from results.views.view import (
    Block,
    Drawing,
    Fact,
    Facts,
    Level,
    ListingBlock,
    PageSection,
    ReportTable,
    StageVerdict,
    StageView,
    TableColumn,
    TextBlock,
    Value,
    text_columns,
)


def export_view(folder: RunFolder) -> StageView:
    """Return the view of the controller tables in a folder."""
    result = folder.result(ExportResult)
    motion, files = result.motion, result.files
    place = folder.stage_file("export").parent
    # The tables of a command have just been written, perhaps elsewhere.
    listed_files = {} if folder.brief else files
    missing = [name for name in listed_files if not (place / name).is_file()]
    changed = [
        name
        for name, entry in listed_files.items()
        if name not in missing and file_hash(place / name) != entry.sha256
    ]
    scales = list(dict.fromkeys(entry.scale for entry in files.values()))
    # Tables of one scale last as long; others state their own times in the README.
    slower = 1 / scales[0] if len(scales) == 1 else 1.0
    begin, end = (slower * time for time in motion.window)
    duration = f"{readable(slower * motion.duration)} s"
    beyond = any(entry.read_back.broken for entry in files.values())
    kept = "" if beyond else ", and kept every tolerance"
    sentence = (
        f"{count_text(len(files), 'table')} of a motion of {duration} from rest to rest. Each was "
        f"read back and executed as its controller does{kept}."
    )
    for name, entry in files.items():
        controller, limits = entry.read_back.controller, entry.read_back.limits
        if controller is not None:
            sentence += (
                f" {name}: the controller's planner takes {readable(controller.duration)} s for "
                f"{readable(entry.duration)} s, and its struts accelerate by up to "
                f"{readable(controller.acceleration, 3)} m/s² in single cycles, where the design "
                f"has {readable(controller.designed_acceleration, 3)} m/s²."
            )
        if broken := entry.read_back.broken:
            sentence += f" {name} breaks limits: {'; '.join(broken)}."
        elif not all(limit.kept for limit in limits):
            sentence += f" {name}: {entry.read_back.limits_in_words}."
    if missing:
        sentence += f" No longer in the folder: {', '.join(missing)}."
    if changed:
        sentence += f" Changed since the check: {', '.join(changed)}."
    level, word = (Level.BAD, "beyond limits") if beyond else (Level.GOOD, "checked")
    # The result of a command has its own tables only.
    unlisted, others = ([], []) if folder.brief else unlisted_files(place, result)
    if unlisted and not beyond:
        level, word = Level.CAUTION, "checked in part"
    if changed and not beyond:
        level, word = Level.CAUTION, "changed"
    verdict = StageVerdict(
        "Controller tables",
        Level.BAD if missing else level,
        "missing" if missing else word,
        sentence,
        "export",
    )
    details = Facts(
        (
            Fact("whole motion", duration, "from rest to rest"),
            Fact(
                "measurement window",
                f"{begin:.6g} to {end:.6g} s",
                f"{motion.periods} periods of {readable(slower * motion.period)} s",
            ),
            Fact("record at", f"{readable(motion.sampling)} Hz"),
        ),
        screen=True,
    )
    listed = [_File(name, entry) for name, entry in files.items()]
    undescribed = f"Not described in {RECORD}, and not checked: {', '.join(unlisted + others)}."
    blocks: list[Block] = [
        details,
        *([TextBlock(undescribed, Level.CAUTION)] if unlisted or others else []),
        *_motion_drawings(folder, result),
        _files_table(listed),
        _read_back_table(listed),
        _axes_table(files),
    ]
    readme = place / README
    if readme.is_file():
        title = f"{README}: how to run each table, and what to record"
        blocks.append(ListingBlock(title, readme.read_text(encoding="utf-8", errors="replace")))
    return StageView(verdict, tuple(blocks))


def _motion_drawings(folder: RunFolder, result: ExportResult) -> tuple[Drawing, ...]:
    """Return the figure of the whole motion; nothing where the tables are of another design.

    It is renewed for every report: a table exported later may be of another motion.
    """
    if result.motion.leads is None or not folder.has("design"):
        return ()
    design = folder.result(DesignResult)
    try:
        motion = result.motion.leads.motion(design.trajectory, design.robot.home)
    except ValueError:
        return ()
    return (Drawing(motion_figure, RestToRestMotion(design.configuration, motion), renewed=True),)


@dataclass(frozen=True)
class _File:
    name: str
    entry: ExportedTable


def _files_table(files: Sequence[_File]) -> ReportTable:
    columns = (
        TableColumn("file", kind="text", of="name"),
        TableColumn("format", kind="text", of="entry.title"),
        TableColumn("scale", of="entry.scale"),
        TableColumn("rows", of="entry.rows"),
        TableColumn("shortest step", "ms", of="entry.shortest_step", factor=1e3),
        TableColumn("longest step", "ms", of="entry.longest_step", factor=1e3),
        TableColumn("between rows", kind="text", of="entry.interpolation", screen=False),
        TableColumn("decimals", of="entry.digits", screen=False),
    )
    return ReportTable.of("exports", "Files in exports/", columns, files, screen=True)


def _read_back_table(files: Sequence[_File]) -> ReportTable:
    check, change = "entry.read_back", "entry.read_back.information"
    acceleration, force = f"{check}.acceleration_error_share", f"{check}.force_error_share"

    def decisive(file: _File) -> str:
        information = file.entry.read_back.information
        return "–" if information is None else information.parameter

    def proved(file: _File) -> str:
        check = file.entry.read_back
        titles = [limit_definitions()[key].title for key in check.sampled]
        but = f"; at the rows only: {', '.join(titles)}" if titles else ""
        return f"{'yes' if check.certified else 'no'}{but}"

    columns = (
        TableColumn("file", kind="text", of="name"),
        TableColumn("struts off by", "µm", digits=3, of=f"{check}.position_error", factor=1e6),
        TableColumn("allowed", "µm", digits=3, of=f"{check}.tolerances.position", factor=1e6),
        TableColumn("speed off by", "mm/s", digits=3, of=f"{check}.velocity_error", factor=1e3),
        TableColumn(
            "acceleration off by", "%", digits=2, of=acceleration, factor=100, screen=False
        ),
        TableColumn("force off by", "%", digits=2, of=force, factor=100, screen=False),
        TableColumn("tightest limit, used", kind="text", of=_tightest),
        TableColumn("limits proved", kind="text", of=proved, proof=True),
        TableColumn("change of log det F", digits=2, of=f"{change}.log_det_change", screen=False),
        TableColumn(
            "change of σ", "%", digits=2, of=f"{change}.std_change", factor=100, screen=False
        ),
        TableColumn("largest for", kind="parameter", of=decisive, screen=False),
    )
    caption = (
        "Execution of the files against the design: largest deviations "
        "(acceleration and force in percent of their limits' range), tightest limit, whether every "
        "limit is proved to be kept at every instant, but for those that straight lines between "
        "rows leave undefined, which are judged at the rows, and the changes of "
        "log det F and of the predicted standard deviations σ over the measurement window by "
        "resampling and rounding"
    )
    return ReportTable.of("read_back", caption, columns, files, screen=True)


def _tightest(file: _File) -> str:
    definitions = limit_definitions()
    shares = {
        definitions[check.key].title: check.used
        for check in file.entry.read_back.limits
        if check.key in definitions
    }
    if not shares:
        return "–"
    title = max(shares, key=lambda name: shares[name])
    return f"{title}, {percent(shares[title], 4)}"


def _axes_table(files: Mapping[str, ExportedTable]) -> ReportTable:
    rows = [
        (name, axis.name, axis.moves, axis.unit, axis.start)
        for name, entry in files.items()
        for axis in entry.axes
    ]
    columns = (*text_columns("file", "axis", "moves", "unit"), TableColumn("start", digits=9))
    caption = "Axes of every file and their positions at the start"
    return ReportTable.of("export_axes", caption, columns, rows, folded=True)


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
        *(
            TextBlock(f"{text[0].upper()}{text[1:]}.", Level.CAUTION)
            for text in dict.fromkeys(text for one in models.values() for text in one.doubts)
        ),
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
            (
                *(name, one.title, t.precision, t.compiler, t.states),
                *(t.deviation, t.median, t.most, t.worst),
            )
            for t in one.tests
        ] or [(name, one.title, None, one.untested, *[None] * 5)]
    times = ("call, median", "99.9 % of calls", "longest call")
    columns = (
        *text_columns("folder", "format", "precision", "tested by"),
        TableColumn("states"),
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
        TableColumn("limit", "N", of=lambda row: abs(row.bound)),
        *motor_columns(model.torque_per_force, {"σ, rms": "rms", "largest": "largest_force"}),
    )
    caption = (
        f"Standard deviation σ of the model's forces along {model.motion}, from the covariance of "
        "the parameters"
    )
    rows = model.uncertainty
    return ReportTable.of("force_uncertainty", caption, columns, rows, screen=True)
