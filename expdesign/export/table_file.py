"""A controller table that was written before, read again as its controller executes it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from expdesign.export.catalogue import table_formats
from expdesign.export.definition import Settings, Task
from expdesign.export.execution import ExecutedTable
from expdesign.runfolder.manifest import file_hash
from expdesign.trajectory import FourierTrajectory


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
    """

    path: Path
    digest: str
    settings: Settings
    executed: ExecutedTable

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
    form = table_formats()[settings.section.format]
    rows = form.read(path, settings)
    executed = ExecutedTable(task.robot, task.motion, settings.axes, rows, form.interpolation)
    return TableFile(path, file_hash(path), settings, executed)
