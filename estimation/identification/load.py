"""The load of the actuators at what was estimated, for terms that depend on it.

Friction in proportion to the load makes the forces a product of two unknowns. With the load held
they are linear again; held at the nominal parameters, the estimate would carry their error. Here
the load is taken at a Gauss–Markov estimate, and once more at the next: each round leaves the
share μ of the load's error, a few per cent. What the load's own error, an estimate's standard
deviation, adds to the covariance is of the same relative size and is neglected.
"""

from __future__ import annotations

from collections.abc import Sequence

from estimation.estimators import Experiment, Knowledge, linear_estimate
from expdesign.robot import Robot

_ROUNDS = 2


def at_estimated_load(
    robot: Robot, experiments: Sequence[Experiment], knowledge: Knowledge
) -> tuple[Robot, tuple[Experiment, ...]]:
    """Return the robot with the load that it was found to bear, and the experiments with its A.

    Both are what they were where no term depends on the load.

    Raises
    ------
    UnidentifiableError
        The data do not determine some parameters at all.
    """
    present = tuple(experiments)
    if not robot.graph.loaded:
        return robot, present
    for _ in range(_ROUNDS):
        robot = robot.with_load_at(linear_estimate(robot, present, knowledge, "gm").values)
        present = tuple(experiment.of_robot(robot) for experiment in present)
    return robot, present
