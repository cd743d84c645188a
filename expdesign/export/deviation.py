"""How far the execution of a table is from the design."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from expdesign.export.execution import Executed, ExecutedTable
from expdesign.robot import Robot

BLOCK = 20_000
"""Times that are computed at once."""


@dataclass(frozen=True)
class Deviation:
    """Largest deviations of the struts.

    Attributes
    ----------
    position, position_time : float
        Of a length, m, and when, s.
    velocity : float
        m/s.
    acceleration, force : float
        As a share of the range that the limits give; NaN where there is no such limit. The forces
        are those without dry friction, which jumps wherever a velocity changes its sign.
    """

    position: float = 0.0
    position_time: float = 0.0
    velocity: float = 0.0
    acceleration: float = np.nan
    force: float = np.nan

    def with_worse(self, other: Deviation) -> Deviation:
        """Return the larger of each."""
        first = self if self.position >= other.position else other
        return Deviation(
            first.position,
            first.position_time,
            max(self.velocity, other.velocity),
            float(np.fmax(self.acceleration, other.acceleration)),
            float(np.fmax(self.force, other.force)),
        )


def blocks(times: Array) -> Iterator[Array]:
    """Yield the times in blocks."""
    for start in range(0, len(times), BLOCK):
        yield times[start : start + BLOCK]


def deviation(table: ExecutedTable, times: Array, executed: Executed, *, forces: bool) -> Deviation:
    """Return the largest deviations from the design at the times (N,), s.

    Parameters
    ----------
    table : ExecutedTable
    times : (N,)
    executed : Executed
        The machine at these times.
    forces : bool
        Whether accelerations and forces are compared too.
    """
    robot = table.robot
    design = table.motion.sample(times)
    parts = (design.pose, design.rate, design.acceleration)
    struts = robot.strut_motion(*parts)
    off = np.abs(executed.length - struts.length).max(axis=1)
    worst = int(np.argmax(off))
    found = Deviation(
        float(off[worst]),
        float(times[worst]),
        float(np.max(np.abs(executed.length_rate - struts.length_rate))),
    )
    if not forces:
        return found
    parameters = np.where(robot.graph.jumping, 0.0, robot.parameters)
    pose, rate, acceleration = np.split(executed.states, 3, axis=1)
    force = robot.actuator_forces(pose, rate, acceleration, parameters) - robot.actuator_forces(
        *parts, parameters
    )
    return Deviation(
        found.position,
        found.position_time,
        found.velocity,
        _share(
            robot,
            "strut_acceleration",
            executed.length_acceleration - struts.length_acceleration,
        ),
        _share(robot, "actuator_force", force),
    )


def _share(robot: Robot, key: str, difference: Array) -> float:
    limit = next((limit for limit in robot.limits if limit.key == key), None)
    if limit is None:
        return float("nan")
    return float(np.max(np.abs(difference) / limit.range))
