"""How far the execution of a table is from the design: in motion, and in information."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from expdesign.export.definition import Task
from expdesign.export.execution import Executed, ExecutedTable
from expdesign.information.fisher import (
    SingularInformationError,
    information_matrix,
    log_det,
    parameter_covariance,
)
from expdesign.robot import Robot
from expdesign.trajectory import PoseSamples

BLOCK = 20_000
"""Times that are computed at once."""


@dataclass(frozen=True)
class Deviation:
    """Largest deviations of the struts."""

    position: float = 0.0
    position_time: float = 0.0
    """Deviation of a length, m, and when it is so large, s."""
    velocity: float = 0.0
    """Of a strut, m/s."""
    acceleration: float = np.nan
    force: float = np.nan
    """Both as a share of the range that the limits give, NaN where there is no such limit; forces
    without dry friction, which jumps wherever a velocity changes its sign."""

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

    `executed` is the machine then; `forces` compares accelerations and forces too.
    """
    robot = table.robot
    design = table.motion.sample(times)
    struts = robot.strut_motion(*design)
    off = np.abs(executed.length - struts.length).max(axis=1)
    worst = int(np.argmax(off))
    shares = []
    if forces:
        parameters = np.where(robot.graph.jumping, 0.0, robot.parameters)
        accelerated = executed.length_acceleration - struts.length_acceleration
        force = robot.actuator_forces(*executed.states, parameters)
        force -= robot.actuator_forces(*design, parameters)
        shares = [
            _share(robot, "strut_acceleration", accelerated),
            _share(robot, "actuator_force", force),
        ]
    speed = float(np.max(np.abs(executed.length_rate - struts.length_rate)))
    return Deviation(float(off[worst]), float(times[worst]), speed, *shares)


def _share(robot: Robot, key: str, difference: Array) -> float:
    limit = next((limit for limit in robot.limits if limit.key == key), None)
    if limit is None:
        return float("nan")
    return float(np.max(np.abs(difference) / limit.range))


@dataclass(frozen=True)
class InformationChange:
    """F over the measurement window, of the table as executed against the design."""

    samples: int
    """Of the measurement."""
    log_det_design: float
    log_det_change: float
    """Of the design, and by how much that of the table is larger."""
    std_change: float
    """The largest relative change of a predicted standard deviation."""
    parameter: str
    """Whose standard deviation that is."""


def information_change(table: ExecutedTable, task: Task) -> InformationChange | None:
    """Compare the information of executed table and design, sampled as it will be measured.

    None without a covariance of the forces, and for a design that leaves parameters undetermined.

    Raises
    ------
    ForwardKinematicsError
        The struts' lengths belong to no pose.
    """
    covariance = task.force_covariance
    if covariance is None:
        return None
    first, last = task.motion.window
    count = max(1, int(np.floor((last - first) * task.sampling * (1 + 1e-12))))
    times = first + np.arange(count) / task.sampling

    names = task.parameters
    try:
        design = _information(task, covariance, times, task.motion.sample)
        reference = log_det(design, names)
        before = np.sqrt(np.diag(parameter_covariance(design, names)))
    except SingularInformationError:
        return None
    try:
        found = _information(task, covariance, times, lambda at: table.smoothed(at).states)
        change = log_det(found, names) - reference
        after = np.sqrt(np.diag(parameter_covariance(found, names)))
    except SingularInformationError:
        return InformationChange(count, reference, -np.inf, np.inf, names[0])
    relative = after / before - 1
    worst = int(np.argmax(np.abs(relative)))
    return InformationChange(count, reference, change, float(relative[worst]), names[worst])


def _information(
    task: Task, covariance: Array, times: Array, sample: Callable[[Array], PoseSamples]
) -> Array:
    every = task.robot.parameter_names
    columns = [every.index(name) for name in task.parameters]
    total = np.zeros((len(columns), len(columns)))
    for part in blocks(times):
        regressors = task.robot.regressor(*sample(part))
        total += information_matrix(regressors[:, :, columns], covariance)
    return total
