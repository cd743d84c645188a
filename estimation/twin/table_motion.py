"""Motion of a machine in the measurement window of a controller table."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import InputError
from expdesign.export.definition import ON_THE_EDGE
from expdesign.export.execution import blocks
from expdesign.export.table_file import TableFile
from expdesign.trajectory import FourierTrajectory, PoseSamples

_ROUNDING = 1.01
"""Of the tolerance that the table was written with."""


@dataclass(frozen=True, eq=False)
class TableMotion:
    """The motion that controller and machine make of a table, t = 0 where the window begins.

    The controller interpolates the rows; the machine follows with the same tracking error as it
    follows the design itself: `executed` is the design with that error.
    """

    file: TableFile
    design: FourierTrajectory
    executed: FourierTrajectory

    def sample(self, times: Array) -> PoseSamples:
        """Return pose, rate and acceleration at times in the window, s.

        Raises
        ------
        ForwardKinematicsError
            The struts' lengths belong to no pose.
        """
        states = self.file.executed.smoothed(self.file.window[0] + np.asarray(times)).states
        if self.executed is self.design:
            return states
        parts = zip(states, self.executed.sample(times), self.design.sample(times), strict=True)
        return PoseSamples(*(part + made - wanted for part, made, wanted in parts))


def refuse_short_window(table: TableFile, periods: int, configuration_file: Path | None) -> None:
    """Refuse an experiment that is longer than the table.

    Raises
    ------
    InputError
        The window has fewer periods than are to be measured, or the rows end inside it.
    """
    if periods > table.periods:
        raise InputError(
            f"{periods} periods are to be measured, and the table has {table.periods}",
            file=configuration_file,
            key="experiment.periods",
            allowed=f"at most {table.periods}, or a table with more",
        )
    end = table.executed.rows.times[-1]
    if end < table.window[1] - ON_THE_EDGE:
        raise InputError(
            f"the table ends at {end:.6f} s, inside the measurement window that lasts until "
            f"{table.window[1]:.6f} s",
            file=table.path,
            allowed="the whole table as `expdesign export` wrote it",
        )


def window_error(table: TableFile, times: Array) -> float:
    """Return how far the struts are from the design at most, m, at times in the window, s.

    Raises
    ------
    InputError
        The table is none of this design: a strut is further away than the table's tolerance.
    """
    robot, design = table.executed.robot, table.design
    parts = []
    for part in blocks(times):
        wanted = robot.inverse_kinematics(design.sample(part).pose)
        off = table.executed.lengths(table.window[0] + part) - wanted
        parts.append(np.abs(off).max(axis=1))
    off = np.concatenate(parts)
    worst = int(np.argmax(np.nan_to_num(off, nan=np.inf)))
    # Written so that NaN is refused.
    if not off[worst] <= table.settings.tolerance * _ROUNDING:
        since = "; it was changed after it was exported" if table.changed else ""
        raise InputError(
            "the table does not hold the design that is to be executed: a strut is "
            f"{1e6 * off[worst]:.4g} µm from it {times[worst]:.4f} s after the beginning of "
            "the measurement window, and the table was written to within "
            f"{1e6 * table.settings.tolerance:.4g} µm{since}",
            file=table.path,
            allowed="a table that `expdesign export` made of this design for this robot",
        )
    return float(off[worst])
