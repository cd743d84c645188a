"""Deviations θ of a machine from its description, and robots with given deviations.

θ is zero for the machine that the robot file describes. Its standard deviations are those of the
file's `tolerances`; an entry without one has 0: it is exact.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from constraints.arrays import Array
from expdesign.configuration.fields import read_only
from expdesign.configuration.robot import ResolvedRobot, RobotDescription
from expdesign.configuration.tolerances import ForceConstantTolerance, RobotTolerances
from expdesign.mechanism.hexapod import ACTUATORS, actuator_names
from expdesign.robot.robot import Robot

FORCE_CONSTANT = "force_constant"
"""Of all forces in common; ``force_constant_1`` … of one actuator."""
_AXES = ("x", "y", "z")
JOINT_ENTRIES = len(_AXES) * ACTUATORS
"""Of the base, and of the platform: joint by joint."""
TILTS = 2
_ALONG = 0.9
_MOST_OFF = 0.9
"""Share of a positive constant by which it may be too large."""


@dataclass(frozen=True)
class Deviation:
    """One entry of θ."""

    name: str
    """``base_joint_3_x``, ``force_constant_2``, ``delay``, ``stribeck_velocity``."""
    group: str
    """Key of its tolerance: ``base_joints``, ``force_constant.each``."""
    unit: str
    """SI, as in files."""
    std: float
    """Its tolerance, in that unit; 0: exact."""
    place: int
    """Among all entries of the robot, from 0."""
    lower: float = -np.inf
    """What θ is never below: of a constant that only makes sense above zero."""

    @property
    def of_the_machine(self) -> bool:
        """True for what moves the model itself, false for errors of the measurement."""
        return self.group not in _MEASURED


_MEASURED = ("strut_length", "force_constant.common", "force_constant.each", "delay", "clock")


def deviations(robot: Robot) -> tuple[Deviation, ...]:
    """Return every entry of θ, with its standard deviation by the robot's tolerances.

    In this order: ``base_joint_1_x`` … ``base_joint_6_z`` (m, base frame), ``platform_joint_1_x``
    … (m, platform frame), ``gravity_1`` and ``gravity_2`` (rad: its direction turned about two
    axes across it), the constants of the terms (``<term>_<constant>``), ``strut_length_1`` … (m:
    a length is measured too long), ``force_constant`` (a share: all forces are measured too
    large), ``force_constant_1`` … (one of them is), ``delay`` (s: forces lag behind the lengths),
    ``clock`` (a share: stamps run fast).
    """
    places = count()
    return tuple(
        Deviation(name, group, unit, float(std or 0.0), next(places))
        for name, group, unit, std in _entries(
            robot, robot.description.tolerances or RobotTolerances()
        )
    )


def toleranced_deviations(robot: Robot) -> tuple[Deviation, ...]:
    """Return the entries of θ that have a tolerance: none where everything is exact."""
    return tuple(each for each in deviations(robot) if each.std > 0)


def estimated_constants(robot: Robot) -> tuple[Deviation, ...]:
    """Return the constants of terms that the robot file says to estimate.

    Their standard deviation is their tolerance, and endless without one: nothing is known of them
    but where the search begins. A constant that is positive stays above a tenth of that.
    """
    about = robot.description
    flagged = {f"terms.{name}" for name in about.estimated_constants}
    if not flagged:
        return ()
    values = iter(about.constants)
    least = {
        f"terms.{term.name}.{constant.name}": -_MOST_OFF * value if constant.positive else -np.inf
        for term in robot.terms
        for constant, value in zip(term.constants, values, strict=False)
    }
    return tuple(
        replace(one, std=one.std or np.inf, lower=least[one.group])
        for one in deviations(robot)
        if one.group in flagged
    )


def _entries(robot: Robot, given: RobotTolerances) -> Iterator[tuple[str, str, str, float | None]]:
    for group, values in (
        ("base_joints", given.base_joints),
        ("platform_joints", given.platform_joints),
    ):
        std = np.zeros((ACTUATORS, len(_AXES))) if values is None else np.array(values)
        for name, row in zip(actuator_names(f"{group[:-1]}_"), std.tolist(), strict=True):
            yield from (
                (f"{name}_{axis}", group, "m", value)
                for axis, value in zip(_AXES, row, strict=True)
            )
    for name in ("gravity_1", "gravity_2"):
        yield name, "gravity", "rad", given.gravity
    for term in robot.terms:
        own = (given.terms or {}).get(term.name, {})
        for constant in term.constants:
            group = f"terms.{term.name}.{constant.name}"
            yield f"{term.name}_{constant.name}", group, constant.unit, own.get(constant.name)
    forces = given.force_constant or ForceConstantTolerance()
    yield from _numbered_entries("strut_length", "strut_length", "m", given.strut_length)
    yield FORCE_CONSTANT, "force_constant.common", "1", forces.common
    yield from _numbered_entries(FORCE_CONSTANT, "force_constant.each", "1", forces.each)
    yield "delay", "delay", "s", given.delay
    yield "clock", "clock", "1", given.clock


def _numbered_entries(
    name: str, group: str, unit: str, values: Sequence[float] | None
) -> Iterator[tuple[str, str, str, float]]:
    std = [0.0] * ACTUATORS if values is None else values
    yield from (
        (n, group, unit, value) for n, value in zip(actuator_names(f"{name}_"), std, strict=True)
    )


def tilt_axes(gravity: Array) -> Array:
    """Return the two axes about which gravity's direction is turned, (2, 3), unit vectors.

    They are across it, in the base frame: x and y for a base that lies level. Zeros without
    gravity.
    """
    size = float(np.linalg.norm(gravity))
    if size == 0:
        return np.zeros((TILTS, 3))
    up = -gravity / size
    # The same axes for gravity a little turned: nothing that depends on the smallest component.
    start = np.eye(3)[0 if abs(up[0]) < _ALONG else 1]
    first = start - (start @ up) * up
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(up, first)])


def apply_deviations(robot: Robot, chosen: Sequence[Deviation], values: Array) -> Robot:
    """Return the robot whose joints, gravity and constants deviate by θ.

    Errors of the measurement among the entries do not change the robot. Its cardan axes keep
    their directions.

    Parameters
    ----------
    chosen : sequence of Deviation
        Of this robot.
    values : (t,)
        θ of these, SI.
    """
    about = robot.description
    theta = np.zeros(len(deviations(robot)))
    np.add.at(theta, [each.place for each in chosen], values)
    ends = np.cumsum([JOINT_ENTRIES, JOINT_ENTRIES, TILTS, len(about.constants)])
    base, platform, tilts, constants, _ = np.split(theta, ends)
    turn = tilts @ tilt_axes(about.gravity)
    angle = float(np.linalg.norm(turn))
    gravity = about.gravity
    if angle:
        axis = turn / angle  # across gravity: Rodrigues' formula without its part along the axis
        gravity = np.cos(angle) * gravity + np.sin(angle) * np.cross(axis, gravity)
    moved = replace(
        about,
        base_joints=read_only(about.base_joints + base.reshape(ACTUATORS, -1)),
        platform_joints=read_only(about.platform_joints + platform.reshape(ACTUATORS, -1)),
        gravity=read_only(gravity),
        constants=tuple((np.array(about.constants) + constants).tolist()),
    )
    return replace(robot, description=moved)


def as_in_a_file(robot: ResolvedRobot) -> RobotDescription:
    """Return the robot file's description of a robot with deviations."""
    constants = iter(robot.constants)
    terms = tuple(
        term.model_copy(
            update={
                "constants": {
                    name: constant.model_copy(update={"value": next(constants)})
                    for name, constant in term.constants.items()
                }
            }
        )
        for term in robot.description.terms
    )
    names = ("base_joints", "platform_joints")
    joints = {name: tuple(map(tuple, getattr(robot, name).tolist())) for name in names}
    gravity = tuple(robot.gravity.tolist())
    return robot.description.model_copy(update=joints | {"gravity": gravity, "terms": terms})
