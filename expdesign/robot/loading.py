"""Robots from files: built, and refused when they are not at rest within their limits."""

from __future__ import annotations

from os import PathLike

import numpy as np

from constraints import Limit
from constraints.arrays import Array
from expdesign.configuration import InputError, Problem, ResolvedRobot, quantity_text
from expdesign.configuration.robot import load_robot_description
from expdesign.robot.limit_model import LimitModel
from expdesign.robot.robot import Robot

_ANOTHER_UNIT = 30.0
"""Bounds this much larger than what they bound are taken for millimetres."""


def load_robot(source: str | PathLike[str]) -> Robot:
    """Load a robot that ships by its name, or one from a YAML file.

    Raises `InputError` with the place, the fault and the allowed values.
    """
    return robot_from(load_robot_description(source))


def robot_from(description: ResolvedRobot) -> Robot:
    """Build a robot from its description; refuse it when its home pose breaks a limit at rest.

    The `InputError` has every limit that is broken there, with its value and bound.
    """
    robot = Robot(description)
    model = LimitModel.of(robot)
    values = model.at_home()
    problems = []
    for limit in model.limits:
        problems += _broken(limit, values[limit.key], description)
    if problems:
        raise InputError(problems)
    return robot


def _broken(limit: Limit, values: Array, robot: ResolvedRobot) -> list[Problem]:
    """Return what is wrong with the rows of a limit at home: rows with the same bounds at once."""
    # Of a limit that nobody has given it is the robot's home that does not fit.
    file, line = (robot.source, None) if limit.is_default else (limit.file, limit.line)
    remedy = f"Let home lie elsewhere, or {_widen(limit)}"
    if limit.reserve:
        remedy = (
            f"{100 * limit.reserve:.4g} % of its range are kept free (limits.reserve). Let home "
            f"lie elsewhere, keep less free, or {_widen(limit)}"
        )
    remedy += f". {limit.definition.remedy}" if limit.definition.remedy else ""
    groups: dict[tuple[float, float], list[int]] = {}
    for row, value in enumerate(values):
        if limit.violation_of(row, float(value)) > 0:
            groups.setdefault((float(limit.lower[row]), float(limit.upper[row])), []).append(row)
    return [
        Problem(
            f"the home pose breaks this limit: {limit.definition.title}{_where(limit, rows)} is "
            f"{_span(values[rows], limit.unit)} there. {remedy}",
            file=file,
            line=line,
            key=f"limits.{limit.key}",
            allowed=_allowed_range(*bounds, limit.unit),
            nearest=_in_millimetres(*bounds, values[rows], limit.unit),
        )
        for bounds, rows in groups.items()
    ]


def _widen(limit: Limit) -> str:
    """Return the advice to widen a limit, with its key and the needed bound.

    The key of a default is spelled out, since the user has not written it.
    """
    which = "the limit, which is a default" if limit.is_default else "the limit"
    widest = limit.definition.widest
    if widest is None:
        return f"widen {which}"
    return f"widen {which}, with limits.{limit.key}: {quantity_text(widest, limit.unit)} at most"


def _where(limit: Limit, rows: list[int]) -> str:
    named = [limit.labels[row] for row in rows if limit.labels[row]]
    if len(named) > 1 and len(named) == len(limit.labels):
        return " of all struts" if limit.definition.per_actuator else ""
    return f" of {', '.join(named)}" if named else ""


def _span(values: Array, unit: str) -> str:
    low, high = (quantity_text(float(end(values)), unit) for end in (np.min, np.max))
    return low if low == high else f"{low} to {high}"


def _allowed_range(lower: float, upper: float, unit: str) -> str:
    if np.isfinite(lower) and np.isfinite(upper):
        return f"{quantity_text(lower, unit)} to {quantity_text(upper, unit)}"
    if np.isfinite(upper):
        return f"at most {quantity_text(upper, unit)}"
    return f"at least {quantity_text(lower, unit)}"


def _in_millimetres(lower: float, upper: float, values: Array, unit: str) -> str | None:
    """Return the bounds in millimetres when home keeps those: plain numbers are metres."""
    if unit != "m" or not np.all((1e3 * values >= lower) & (1e3 * values <= upper)):
        return None
    bounds = np.abs([bound for bound in (lower, upper) if np.isfinite(bound) and bound])
    if np.min(bounds, initial=np.inf) < _ANOTHER_UNIT * np.max(np.abs(values)):
        return None  # as large as what it bounds: no slip of the unit
    ends = [f"{bound:g} mm" for bound in (lower, upper) if np.isfinite(bound)]
    return f"[{', '.join(ends)}]" if len(ends) > 1 else ends[0]
