"""What resampling and rounding cost in information about the parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from expdesign.export.definition import Task
from expdesign.export.deviation import blocks
from expdesign.export.execution import ExecutedTable
from expdesign.information.fisher import (
    SingularInformationError,
    information_matrix,
    log_det,
    parameter_covariance,
)


@dataclass(frozen=True)
class InformationChange:
    """F over the measurement window, of the table as executed against the design.

    Attributes
    ----------
    samples : int
        Of the measurement.
    log_det_design, log_det_change : float
        log det F of the design, and by how much that of the table is larger.
    std_change : float
        The largest relative change of a predicted standard deviation.
    parameter : str
        Whose.
    """

    samples: int
    log_det_design: float
    log_det_change: float
    std_change: float
    parameter: str


def information_change(table: ExecutedTable, task: Task) -> InformationChange | None:
    """Compare the information of executed table and design, sampled as it will be measured.

    Returns
    -------
    InformationChange or None
        None without a covariance of the forces, and for a design that leaves parameters
        undetermined.

    Raises
    ------
    ForwardKinematicsError
        The struts' lengths belong to no pose.
    """
    if task.force_covariance is None:
        return None
    first, last = task.motion.window
    count = max(1, int(np.floor((last - first) * task.sampling * (1 + 1e-12))))
    times = first + np.arange(count) / task.sampling

    def designed(at: Array) -> Array:
        states = task.motion.sample(at)
        return np.concatenate([states.pose, states.rate, states.acceleration], axis=1)

    def executed(at: Array) -> Array:
        return table.smoothed(at).states

    names = task.parameters
    try:
        design = _information(task, times, designed)
        reference = log_det(design, names)
        before = np.sqrt(np.diag(parameter_covariance(design, names)))
    except SingularInformationError:
        return None
    try:
        found = _information(task, times, executed)
        change = log_det(found, names) - reference
        after = np.sqrt(np.diag(parameter_covariance(found, names)))
    except SingularInformationError:
        return InformationChange(count, reference, -np.inf, np.inf, names[0])
    relative = after / before - 1
    worst = int(np.argmax(np.abs(relative)))
    return InformationChange(count, reference, change, float(relative[worst]), names[worst])


def _information(task: Task, times: Array, states: Callable[[Array], Array]) -> Array:
    every = task.robot.parameter_names
    columns = [every.index(name) for name in task.parameters]
    total = np.zeros((len(columns), len(columns)))
    if task.force_covariance is None:
        raise ValueError("no covariance of the forces")
    for part in blocks(times):
        regressors = task.robot.regressor(*np.split(states(part), 3, axis=1))
        total += information_matrix(regressors[:, :, columns], task.force_covariance)
    return total
