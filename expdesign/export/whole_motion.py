"""The whole motion in SI units, as tables that engineers read hold it."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from expdesign.export.rows import in_window
from expdesign.motion import ExecutableMotion
from expdesign.robot import Robot
from expdesign.runfolder.columns import TRAJECTORY
from expdesign.runfolder.described import Column

WINDOW = Column("window", "1", "1 in the measurement window, 0 on the way to and from it")
COLUMNS = (Column("t", "s", "time from the start of the motion"), *TRAJECTORY[1:], WINDOW)


def whole_motion(robot: Robot, motion: ExecutableMotion, times: Array) -> dict[str, Array]:
    """Return every column of `COLUMNS` by its name at the times (N,), s."""
    states = motion.sample(times)
    parts = (states.pose, states.rate, states.acceleration)
    struts = robot.strut_motion(*parts)
    blocks = [
        times[:, None],
        *parts,
        struts.length,
        struts.length_rate,
        struts.length_acceleration,
        struts.alpha,
        struts.beta,
        robot.actuator_forces(*parts),
        in_window(times, motion.window).astype(float)[:, None],
    ]
    table = np.concatenate(blocks, axis=1)
    return {column.name: table[:, k] for k, column in enumerate(COLUMNS)}
