"""Robots from files: built, and refused when they are not at rest within their limits."""

from __future__ import annotations

from os import PathLike

import numpy as np

from expdesign.configuration import (
    ConfigurationError,
    Problem,
    ResolvedRobot,
    load_robot_description,
)
from expdesign.robot.exact_limits import ExactModel
from expdesign.robot.robot import Robot


def load_robot(source: str | PathLike[str]) -> Robot:
    """Load a robot that ships by its name, or one from a YAML file.

    Raises
    ------
    ConfigurationError
        The file is not a valid robot, or its home pose breaks a limit: what is wrong, where,
        and what is allowed.
    """
    return robot_from(load_robot_description(source))


def robot_from(description: ResolvedRobot) -> Robot:
    """Build a robot from its description; refuse it when its home pose breaks a limit at rest.

    Raises
    ------
    ConfigurationError
        Every limit that is broken at home, with its value and bound.
    """
    robot = Robot.of(description)
    model = ExactModel(robot, robot.limits)
    state = np.concatenate([robot.home, np.zeros(12)])[None, :]
    values = model.values(state)[0]
    problems = []
    for limit, columns in zip(model.limits, model.columns(), strict=True):
        for row, value in enumerate(values[columns]):
            if limit.violation_of(row, float(value)) <= 0:
                continue
            label = f" of {limit.labels[row]}" if limit.labels[row] else ""
            problems.append(
                Problem(
                    f"the home pose breaks this limit: {limit.definition.title}{label} is "
                    f"{value:.6g} {limit.unit}",
                    file=description.limits[limit.key].file,
                    line=description.limits[limit.key].line,
                    key=f"limits.{limit.key}",
                    allowed=_allowed(limit.lower[row], limit.upper[row], limit.unit),
                )
            )
    if problems:
        raise ConfigurationError(problems)
    return robot


def _allowed(lower: float, upper: float, unit: str) -> str:
    if np.isfinite(lower) and np.isfinite(upper):
        return f"{lower:.6g} to {upper:.6g} {unit}"
    return f"at most {upper:.6g} {unit}" if np.isfinite(upper) else f"at least {lower:.6g} {unit}"
