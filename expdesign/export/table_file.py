"""A controller table that was written before, read again as its controller executes it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from expdesign.apart import EndlessError, output_of
from expdesign.configuration import ExportSection, InputError, Problem
from expdesign.export.definition import Settings, TableError, Task
from expdesign.export.execution import ExecutedTable
from expdesign.export.exporting import refuse_missing_library, settled
from expdesign.export.record import RECORD, ExportsRecord, FileEntry, record_of_one
from expdesign.robot import Robot
from expdesign.runfolder import MissingFileError
from expdesign.runfolder.manifest import file_hash
from expdesign.trajectory import FourierTrajectory

_AGAIN = "a table as `expdesign export` wrote it, with the record beside it; export it again"


@dataclass(frozen=True, eq=False)
class TableFile:
    """A table in a file, on its way through the controller's interpolator.

    `settings` are those with which it was written, `digest` is the SHA-256 of the file; it is
    `changed` when that is not the one that was exported and checked.
    """

    path: Path
    digest: str
    settings: Settings
    executed: ExecutedTable
    changed: bool = False

    @property
    def window(self) -> tuple[float, float]:
        """When the measurement window begins and ends, s from the start of the table."""
        return self.executed.motion.window

    @property
    def periods(self) -> int:
        """Periods in the measurement window."""
        return self.executed.motion.periods

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
            read = output_of(settings.form.may_crash, path) is not None
        except EndlessError:
            read = False
        if not read:
            raise TableError("the file is damaged")


def find_table_file(path: Path, robot: Robot, trajectory: FourierTrajectory) -> TableFile:
    """Read a table with what `expdesign export` wrote beside it about its axes and its motion.

    The robot executes it; the trajectory is the design that it was made of. An `InputError` tells
    that there is no such file, that nothing tells what it holds, that it cannot be read or was made
    of another design.
    """
    if not path.is_file():
        raise _refusal("there is no such table", path, "a file that `expdesign export` wrote")
    record, entry = _record(path)
    motion, changed = record.motion, entry.sha256 != file_hash(path)
    try:
        section = ExportSection.model_validate(entry.options)
    except ValueError as error:
        raise _refusal("the options of its export cannot be used", path) from error
    try:
        if motion.ways is None:
            raise ValueError("its ramps are not recorded")
        found_motion = motion.ways.motion(trajectory, robot.home)
    except ValueError as error:
        raise _refusal(f"its motion is not that of the design: {error}", path) from error
    task = Task(
        motion.name, robot, found_motion, motion.controller_period, motion.sampling, parameters=()
    )
    refuse_missing_library(section)
    try:
        found = read_table_file(path, settled(section, task))
    except (TableError, OSError) as error:
        since = "; it was changed after it was exported" if changed else ""
        message = f"the controller would not read this table: {error}{since}"
        raise _refusal(message, path) from error
    return replace(found, changed=changed)


def _refusal(message: str, path: Path, allowed: str = _AGAIN) -> InputError:
    return InputError(message, path, allowed=allowed)


def _record(path: Path) -> tuple[ExportsRecord, FileEntry]:
    """Return the record that tells what a table holds, and what it says of this file.

    A table may have been replaced after one of the records was written: the one with its digest
    is taken. Where none has it, the table was changed by hand, and the only record is taken.
    """
    places = (path.with_name(RECORD), record_of_one(path))
    found: list[tuple[ExportsRecord, FileEntry]] = []
    unreadable: list[Problem] = []
    for place in places:
        try:
            record = ExportsRecord.read(place)
        except MissingFileError:
            continue
        except InputError as error:
            unreadable += error.problems
            continue
        if path.name in record.files:
            found.append((record, record.files[path.name]))
    if not found:
        if unreadable:
            raise InputError(unreadable)
        names = " nor ".join(place.name for place in places)
        raise _refusal(
            f"nothing tells what the columns of this table are: neither {names} beside it names it",
            path,
        )
    digest = file_hash(path)
    own = [(record, entry) for record, entry in found if entry.sha256 == digest]
    if not own and len(found) > 1:
        names = " and ".join(place.name for place in places)
        raise _refusal(
            f"this table was changed after it was exported, and {names} both name it: which of "
            "them holds for it is unknown",
            path,
        )
    return (own or found)[0]
