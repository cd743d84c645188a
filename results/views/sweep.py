"""What a report says of a sweep: designs over a grid."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from expdesign.configuration import RunConfiguration
from expdesign.configuration.grid import short_path, value_text
from expdesign.experiment.sweep import FAILED, SweepResult, SweptDesign
from expdesign.information.criteria import CRITERIA
from results.figures.sweep import sweep_figure
from results.notation import counted, duration, readable
from results.views.folder import RunFolder
from results.views.view import (
    Block,
    Fact,
    Level,
    ReportTable,
    StageVerdict,
    StageView,
    TableColumn,
    TextBlock,
)

_READ = (
    "Every design is a run folder of its own: expdesign run FOLDER/run.yaml --out FOLDER goes on "
    "with one, expdesign compare sets some side by side. σ is the standard deviation that the "
    "noise makes in the whole experiment, as predicted, over the nominal value."
)


def sweep_report(folder: RunFolder) -> StageView:
    """Return what is to be said of the sweep in a folder."""
    record = folder.record(SweepResult)
    blocks: tuple[Block, ...] = (
        TextBlock(_READ),
        *folder.figures(sweep_figure),
        _table(record, "sweep", _CAPTION, _promised(folder.configuration)),
        _table(record, "sweep_searches", "The searches, and where the designs are", _SEARCHED),
    )
    return StageView(_verdict(record), blocks, _facts(record), heading="Designs over a grid")


_CAPTION = (
    "The designs: median of σ over the parameters, the worst and whose it is, time of measuring, "
    "processor time of the search, whether every limit is proved to be kept"
)


def _promised(configuration: RunConfiguration) -> tuple[TableColumn, ...]:
    log_det = CRITERIA["d"].named(configuration.run.design.information)
    return (
        TableColumn("status", kind="outcome", of="status"),
        TableColumn(log_det, digits=5, of="log_det_information"),
        TableColumn("σ, median", "%", digits=3, of="median_rel_std_percent"),
        TableColumn("σ, worst", "%", digits=3, of="worst_rel_std_percent"),
        TableColumn("of", kind="parameter", of="worst_parameter"),
        TableColumn("measuring", "s", of="measuring_time"),
        TableColumn("search", "s", digits=3, of="cpu_seconds"),
        TableColumn("proved", of="certified"),
    )


_SEARCHED = (
    TableColumn("criterion value", digits=5, of="criterion_value"),
    TableColumn("period", "s", of="period"),
    TableColumn("iterations", of="iterations"),
    TableColumn("evaluations", of="evaluations"),
    TableColumn("folder", kind="text", of="folder"),
    TableColumn("reason", kind="text", of="reason"),
)


def _table(
    record: SweepResult, key: str, caption: str, columns: Iterable[TableColumn]
) -> ReportTable:
    """Return a table of the designs, the values of the grid in front."""
    points = {one.number: point for one, point in zip(record.designs, record.points, strict=True)}

    def value_at(path: str) -> Callable[[SweptDesign], str]:
        return lambda one: value_text(points[one.number][path])

    front = (TableColumn(short_path(path), kind="text", of=value_at(path)) for path in record.grid)
    every = (TableColumn("design", of="number"), *front, *columns)
    return ReportTable.of(key, caption, every, record.designs, folded=key != "sweep")


def _verdict(record: SweepResult) -> StageVerdict:
    total, complete = len(record.designs), sum(one.complete for one in record.designs)
    sentence = f"{complete} of {counted(total, 'design')}"
    wrong = [
        f"{label} ({one.reason if one.status == FAILED else one.status})"
        for label, one in zip(record.labels, record.designs, strict=True)
        if one.wrong
    ]
    sentence += f" over {', '.join(record.grid)}."
    if wrong:
        sentence += f" Failed: {'; '.join(wrong)}."
    if record.interrupted:
        sentence += " The sweep was interrupted: the same command goes on from there."
        return StageVerdict("Sweep", Level.BAD, "interrupted", sentence, "sweep")
    level, word = (Level.BAD, "incomplete") if wrong else (Level.GOOD, "complete")
    return StageVerdict("Sweep", level, word, sentence, "sweep")


def _facts(record: SweepResult) -> tuple[Fact, ...]:
    best = record.most_precise
    if best is None:
        return ()
    label = dict(zip(record.designs, record.labels, strict=True))[best]
    spent = sum(one.cpu_seconds for one in record.designs if one.made)
    value = f"{readable(best.median_rel_std_percent, 3)} %"
    return (
        Fact("most precise design", value, f"median predicted σ, with {label}"),
        Fact("searches", duration(spent), f"processor time of {len(record.designs)} designs"),
    )
