"""A controller table that was written before, read again as its controller executes it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from expdesign.configuration import ExportSection, InputError, Problem
from expdesign.export.definition import Settings, Task
from expdesign.export.execution import ExecutedTable
from expdesign.export.exporting import refuse_missing_library
from expdesign.export.record import RECORD, read_record, record_of_one
from expdesign.export.rows import TableError
from expdesign.export.settling import settled
from expdesign.motion import motion_from_record
from expdesign.robot import Robot
from expdesign.runfolder.manifest import file_hash
from expdesign.trajectory import FourierTrajectory

_AGAIN = "a table as `expdesign export` wrote it, with the record beside it; export it again"


@dataclass(frozen=True, eq=False)
class TableFile:
    """A table in a file, on its way through the controller's interpolator.

    Attributes
    ----------
    path : Path
    digest : str
        SHA-256 of the file.
    settings : Settings
        With which it was written.
    executed : ExecutedTable
    changed : bool
        Whether it is another file than the one that was exported and checked.
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


def read_table_file(path: Path, task: Task, settings: Settings) -> TableFile:
    """Read a table as its controller does.

    Parameters
    ----------
    path : Path
    task : Task
        The motion that it holds.
    settings : Settings
        With which it was written.

    Raises
    ------
    TableError
        The controller would not read it.
    """
    form = settings.form
    rows = form.read(path, settings)
    executed = ExecutedTable(task.robot, task.motion, settings.axes, rows, form.interpolation)
    return TableFile(path, file_hash(path), settings, executed)


def find_table_file(path: Path, robot: Robot, trajectory: FourierTrajectory) -> TableFile:
    """Read a table with what `expdesign export` wrote beside it about its axes and its motion.

    Parameters
    ----------
    path : Path
    robot : Robot
        That executes it.
    trajectory : FourierTrajectory
        The design that it was made of.

    Raises
    ------
    InputError
        There is no such file, nothing tells what it holds, it cannot be read, or it was made of
        another design.
    """
    if not path.is_file():
        raise InputError(
            Problem("there is no such table", path, allowed="a file that `expdesign export` wrote")
        )
    place, motion, about = _record(path)
    changed = about["sha256"] != file_hash(path)
    try:
        section = ExportSection.model_validate(about["options"])
        name, ways = str(motion["name"]), motion["ways"]
        period, sampling = (_positive(motion[key]) for key in ("controller_period", "sampling"))
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InputError(
            Problem("what it says of the table cannot be used", place, allowed=_AGAIN)
        ) from error
    try:
        found_motion = motion_from_record(ways, trajectory, robot.home)
    except ValueError as error:
        raise InputError(
            Problem(f"its motion is not that of the design: {error}", path, allowed=_AGAIN)
        ) from error
    task = Task(name, robot, found_motion, period, sampling, parameters=())
    refuse_missing_library(section)
    try:
        found = read_table_file(path, task, settled(section, task))
    except (TableError, OSError) as error:
        since = "; it was changed after it was exported" if changed else ""
        raise InputError(
            Problem(
                f"the controller would not read this table: {error}{since}", path, allowed=_AGAIN
            )
        ) from error
    return replace(found, changed=changed)


def _positive(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError("no number")
    number = float(value)
    if not 0 < number < np.inf:
        raise ValueError("no positive number")
    return number


def _record(path: Path) -> tuple[Path, dict[str, Any], dict[str, Any]]:
    """Return where it is told what a table holds, what of its motion and what of the file.

    A table may have been replaced after one of the records was written: the one with its digest
    is taken. Where none has it, the table was changed by hand, and the only record is taken.
    """
    places = (path.with_name(RECORD), record_of_one(path))
    found: list[tuple[Path, dict[str, Any], dict[str, Any]]] = []
    for place in places:
        data = read_record(place)
        about = data.get("files", {}).get(path.name)
        if isinstance(about, dict):
            found.append((place, data["motion"], about))
    if not found:
        names = " nor ".join(place.name for place in places)
        raise InputError(
            Problem(
                f"nothing tells what the columns of this table are: neither {names} beside it "
                "names it",
                path,
                allowed=_AGAIN,
            )
        )
    for place, _, about in found:
        if not isinstance(about.get("sha256"), str):
            raise InputError(
                Problem("it does not tell which file it is about", place, allowed=_AGAIN)
            )
    digest = file_hash(path)
    own = [record for record in found if record[2]["sha256"] == digest]
    if not own and len(found) > 1:
        names = " and ".join(place.name for place in places)
        raise InputError(
            Problem(
                f"this table was changed after it was exported, and {names} both name it: which "
                "of them holds for it cannot be told",
                path,
                allowed=_AGAIN,
            )
        )
    return (own or found)[0]
