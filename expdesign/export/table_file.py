"""A controller table that was written before, read again as its controller executes it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import InputError, Problem, export_section
from expdesign.export.certification import PathCertificate, certify_table, single_cycle_faults
from expdesign.export.definition import Settings, TableError, Task
from expdesign.export.execution import Executed, ExecutedTable
from expdesign.export.exporting import BAG, refuse_missing_library, resolve_settings
from expdesign.export.formats import table_formats
from expdesign.export.result import README, RECORD, ExportedTable, ExportResult, result_file
from expdesign.export.whole_table import (
    controller_faults,
    departure,
    executed_settings,
    find_faults,
    piece_in_words,
    wrong_columns,
    wrong_companions,
)
from expdesign.robot import Robot
from expdesign.runfolder import MissingFileError
from expdesign.runfolder.files import TEMPORARY
from expdesign.runfolder.lock import LOCK
from expdesign.runfolder.manifest import file_hash
from expdesign.trajectory import FourierTrajectory
from expdesign.workers.local import EndlessError, run_isolated

_AGAIN = "a table as `expdesign export` wrote it, with its exports.json; export it again"
_LOCK = re.compile(rf"{re.escape(LOCK)}(-[0-9a-f]{{8}})?(\.json)?")


@dataclass(frozen=True, eq=False)
class TableFile:
    """A table in a file, as the controller interpolates it.

    `settings` are those with which it was written, `digest` is the SHA-256 of the file; it is
    `changed` when that is not the one that was exported and checked. `described_in` is the file
    that describes the table, and `exported_as` its name there; `longest_step` is the longest time
    between two rows as exported, s.
    """

    path: Path
    digest: str
    settings: Settings
    executed: ExecutedTable
    changed: bool = False
    described_in: Path | None = None
    exported_as: str = ""
    longest_step: float = np.inf

    @property
    def window(self) -> tuple[float, float]:
        """When the measurement window begins and ends, s from the start of the table."""
        return self.settings.window

    @property
    def periods(self) -> int:
        """Periods in the measurement window."""
        return self.settings.task.motion.periods

    def smoothed(self, times: Array) -> Executed:
        """Return the machine at times in the measurement window, s, as `ExecutedTable.smoothed`."""
        return self.executed.smoothed(self.executed.rows.short_times(self.window[0] + times))

    def lengths(self, times: Array) -> Array:
        """Return the struts' lengths, (N, 6), m, at times in the measurement window, s."""
        return self.executed.lengths(self.executed.rows.short_times(self.window[0] + times))

    @property
    def design(self) -> FourierTrajectory:
        """The designed motion, its t = 0 at the beginning of the measurement window."""
        motion = self.executed.motion
        return motion.trajectory if motion.phase == 0 else motion.trajectory.shifted(motion.phase)


def read_table_file(path: Path, settings: Settings) -> TableFile:
    """Read a table as its controller does; raises `TableError` for what that would not read."""
    _refuse_crashing(path, settings)
    executed = ExecutedTable.of(settings, settings.form.read(path, settings))
    return TableFile(path, file_hash(path), settings, executed)


def _refuse_crashing(path: Path, settings: Settings) -> None:
    if settings.form.may_crash:
        try:
            read = run_isolated(settings.form.may_crash, path) is not None
        except EndlessError:
            read = False
        if not read:
            raise TableError("the file is damaged")


def find_table_file(
    path: Path, robot: Robot, trajectory: FourierTrajectory, exports: Path | None = None
) -> TableFile:
    """Read a table with the description of its axes and motion by `expdesign export`.

    Parameters
    ----------
    path : Path
    robot : Robot
        It executes the table.
    trajectory : FourierTrajectory
        The design that the table was made of.
    exports : Path, optional
        An `exports.json` that lists the table by its SHA-256, for a table in another folder.

    Raises
    ------
    InputError
        The file is missing, has no description, cannot be read or belongs to another design.
    """
    if not path.is_file():
        raise _refusal("there is no such table", path, "a file that `expdesign export` wrote")
    described = _find_description(path, exports)
    motion, entry = described.result.motion, described.entry
    changed = entry.sha256 != file_hash(path)
    try:
        section = export_section(**entry.options)
    except ValueError as error:
        raise _refusal("the options of its export cannot be used", path) from error
    try:
        if motion.leads is None:
            raise ValueError("its ramps are not recorded")
        found_motion = motion.leads.motion(trajectory, robot.home)
    except ValueError as error:
        raise _refusal(f"its motion is not that of the design: {error}", path) from error
    task = Task(
        motion.name, robot, found_motion, motion.controller_period, motion.sampling, parameters=()
    )
    refuse_missing_library(section)
    try:
        found = read_table_file(path, resolve_settings(section, task))
    except (TableError, OSError) as error:
        since = "; it was changed after it was exported" if changed else ""
        message = f"the controller would not read this table: {error}{since}"
        raise _refusal(message, path) from error
    return replace(
        found,
        changed=changed,
        described_in=described.place,
        exported_as=described.name,
        longest_step=entry.longest_step,
    )


def certify_file(file: TableFile, *, piece: bool = False) -> PathCertificate:
    """Return the certificate of a table as a whole: its limits, ends, rows, columns and files.

    A piece may have any begin, end and duration, which the remarks state. Raises
    `ForwardKinematicsError` where the struts' lengths belong to no pose.
    """
    table = file.executed
    settings, rows = executed_settings(file.settings, table), table.as_written.rows
    faults = find_faults(settings, table, file.longest_step, piece=piece)
    if not faults:
        faults = controller_faults(table, piece=piece) + single_cycle_faults(table, piece=piece)
    unchecked = wrong_companions(file.settings, rows, file.path)
    if piece:
        if rows.columns:
            unchecked.append("its further columns: a piece has no place in the design")
        if settings.section.trigger is not None:
            unchecked.append("the times at which it switches the output")
        return replace(
            certify_table(table, piece=True),
            faults=tuple(faults),
            unchecked=tuple(unchecked),
            remarks=(piece_in_words(table),),
        )
    unchecked += wrong_columns(settings, rows)
    off, time = departure(settings, table)
    remarks: list[str] = []
    if off > settings.tolerance + settings.half_unit / np.min(np.abs(settings.axes.factor)):
        text = f"its rows are up to {1e6 * off:.4g} µm from the design (at {time:.4f} s)"
        (remarks if file.changed else unchecked).append(text)
    return replace(
        certify_table(table),
        faults=tuple(faults),
        unchecked=tuple(unchecked),
        remarks=tuple(remarks),
    )


def unlisted_files(place: Path, result: ExportResult | None) -> tuple[list[str], list[str]]:
    """Return the files in `exports/` and its folders that its `exports.json` does not describe.

    The first ones have the ending of a table, in capitals or not, the others do not.
    """
    known = {RECORD, README}
    for name, entry in {} if result is None else result.files.items():
        known |= {name, *entry.companions}
    found = sorted(
        name
        for path in place.rglob("*")
        if path.is_file()
        and (name := path.relative_to(place).as_posix()) not in known
        and not (name.startswith(TEMPORARY) or _LOCK.fullmatch(name))
    )
    endings = (BAG, *(form.suffix for form in table_formats().values()))
    tables = [name for name in found if name.casefold().endswith(endings)]
    return tables, [name for name in found if name not in tables]


def _refusal(message: str, path: Path, allowed: str = _AGAIN) -> InputError:
    return InputError(message, path, allowed=allowed)


@dataclass(frozen=True, eq=False)
class _Described:
    """Entry of a table in an `exports.json`, with its name."""

    place: Path
    result: ExportResult
    name: str

    @property
    def entry(self) -> ExportedTable:
        return self.result.files[self.name]


def _find_description(path: Path, exports: Path | None) -> _Described:
    """Return the description of a table and its entry there.

    A table may have been replaced after a description was written: the description with the
    table's digest counts. Without one, the table was changed by hand, and the only one counts.
    """
    places = (path.with_name(RECORD), result_file(path))
    found: list[_Described] = []
    unreadable: list[Problem] = []
    for place in places:
        try:
            result = ExportResult.read(place)
        except MissingFileError:
            continue
        except InputError as error:
            unreadable += error.problems
            continue
        if path.name in result.files:
            found.append(_Described(place, result, path.name))
    digest = file_hash(path)
    if not found:
        if unreadable:
            raise InputError(unreadable)
        found += _copied_from(exports, digest)
    if not found:
        names = " nor ".join(place.name for place in places)
        elsewhere = f", and {exports} has none with its SHA-256" if exports is not None else ""
        raise _refusal(
            "the columns of this table are not described: neither "
            f"{names} in its folder names it{elsewhere}",
            path,
        )
    own = [one for one in found if one.entry.sha256 == digest]
    if not own and len(found) > 1:
        names = " and ".join(place.name for place in places)
        raise _refusal(
            f"this table was changed after it was exported, and {names} both name it: which of "
            "them holds for it is unknown",
            path,
        )
    return (own or found)[0]


def _copied_from(exports: Path | None, digest: str) -> Iterator[_Described]:
    """Yield what a record says of the table with this digest, whatever the copy is called."""
    if exports is None or not exports.is_file():
        return
    result = ExportResult.read(exports)
    for name, entry in result.files.items():
        if entry.sha256 == digest:
            yield _Described(exports, result, name)
            return
