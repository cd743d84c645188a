"""What a report says of the controller tables of a folder."""

from __future__ import annotations

from collections.abc import Mapping

from constraints import limit_definitions
from expdesign.export.record import CheckEntry, ExportsRecord, FileEntry
from expdesign.runfolder.manifest import file_hash
from results.report.content import (
    Block,
    Fact,
    Facts,
    Level,
    ListingBlock,
    StageReport,
    Verdict,
)
from results.report.folder import RunFolder
from results.report.numerals import counted, percent, readable
from results.report.table import Column, ReportTable, Value


def export_report(folder: RunFolder) -> StageReport:
    """Return what is to be said of the controller tables in a folder."""
    record = folder.record(ExportsRecord)
    motion, files = record.motion, record.files
    place = folder.stage_file("export").parent
    missing = [name for name in files if not (place / name).is_file()]
    changed = [
        name
        for name, entry in files.items()
        if name not in missing and file_hash(place / name) != entry.sha256
    ]
    begin, end = motion.window
    duration = f"{readable(motion.duration)} s"
    sentence = (
        f"{counted(len(files), 'table')} of a motion of {duration} from rest to rest. Each was "
        "read again, executed as its controller would, and kept every tolerance."
    )
    for name, entry in files.items():
        if any(limit.kept is False for limit in entry.read_back.limits.values()):
            sentence += f" {name}: {entry.read_back.limits_in_words}."
    if missing:
        sentence += f" No longer in the folder: {', '.join(missing)}."
    if changed:
        sentence += f" Changed since, and not checked as they are now: {', '.join(changed)}."
    level, word = (Level.CAUTION, "changed") if changed else (Level.GOOD, "checked")
    verdict = Verdict(
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
                f"{motion.periods} periods of {readable(motion.period)} s",
            ),
            Fact("record at", f"{readable(motion.sampling)} Hz"),
        )
    )
    blocks: list[Block] = [
        details,
        *folder.figures("motion"),
        _files_table(files),
        _read_back_table(files),
        _axes_table(files),
    ]
    readme = place / "README.txt"
    if readme.is_file():
        title = "README.txt: how to run each table, and what to record"
        blocks.append(ListingBlock(title, folder.text(readme)))
    return StageReport(verdict, tuple(blocks))


def _files_table(files: Mapping[str, FileEntry]) -> ReportTable:
    rows: list[tuple[Value, ...]] = [
        (
            name,
            entry.title,
            entry.rows,
            1e3 * entry.shortest_step,
            1e3 * entry.longest_step,
            entry.interpolation,
            entry.digits,
        )
        for name, entry in files.items()
    ]
    columns = (
        Column("file", kind="text"),
        Column("format", kind="text"),
        Column("rows"),
        Column("shortest step", "ms"),
        Column("longest step", "ms"),
        Column("between rows", kind="text"),
        Column("decimals"),
    )
    return ReportTable.of("exports", "Files in exports/", columns, rows)


def _read_back_table(files: Mapping[str, FileEntry]) -> ReportTable:
    rows: list[tuple[Value, ...]] = []
    for name, entry in files.items():
        found, change = entry.read_back, entry.read_back.information
        rows.append(
            (
                name,
                1e6 * found.position_error,
                1e6 * found.tolerances.position,
                1e3 * found.velocity_error,
                100 * found.acceleration_error_share,
                100 * found.force_error_share,
                _tightest(found),
                None if change is None else change.log_det_change,
                None if change is None else 100 * change.std_change,
                "–" if change is None else change.parameter,
            )
        )
    columns = (
        Column("file", kind="text"),
        Column("struts off by", "µm", digits=3),
        Column("allowed", "µm", digits=3),
        Column("speed off by", "mm/s", digits=3),
        Column("acceleration off by", "%", digits=2),
        Column("force off by", "%", digits=2),
        Column("tightest limit, used", kind="text"),
        Column("change of log det F", digits=2),
        Column("change of σ", "%", digits=2),
        Column("largest for", kind="parameter"),
    )
    caption = (
        "What the files do when they are executed, against the design: largest deviations "
        "(acceleration and force in percent of their limits' range), tightest limit, and what "
        "resampling and rounding change in log det F and in the predicted standard deviations σ "
        "over the measurement window"
    )
    return ReportTable.of("read_back", caption, columns, rows)


def _tightest(found: CheckEntry) -> str:
    """Return the limit that is used most, and its share, 100 % at the bound."""
    definitions = limit_definitions()
    shares = {
        definitions[key].title: definitions[key].share_used(
            entry.value, entry.bound, entry.violation
        )
        for key, entry in found.limits.items()
        if key in definitions
    }
    if not shares:
        return "–"
    title = max(shares, key=lambda name: shares[name])
    return f"{title}, {percent(shares[title], 4)}"


def _axes_table(files: Mapping[str, FileEntry]) -> ReportTable:
    rows = [
        (name, axis.name, axis.moves, axis.unit, axis.start)
        for name, entry in files.items()
        for axis in entry.axes
    ]
    columns = (
        Column("file", kind="text"),
        Column("axis", kind="text"),
        Column("moves", kind="text"),
        Column("unit", kind="text"),
        Column("start", digits=9),
    )
    caption = "Axes of every file, and where they stand at the start"
    return ReportTable.of("export_axes", caption, columns, rows, folded=True)
