"""The geometry that LinuxCNC's kinematics genhexkins has to have: ``setp`` lines for a HAL file.

Only with these the controller makes the strut lengths of the robot from the poses of its table.
Source: LinuxCNC, kins(9) and the HAL pins of genhexkins, which are in machine units.
"""

from __future__ import annotations

from collections.abc import Iterator

from constraints.arrays import Array
from expdesign.configuration import ResolvedRobot
from expdesign.export.definition import LENGTH_UNITS, Rows, Settings

ENDING = ".genhexkins.hal"

_LETTERS = "xyz"
_INI_UNITS = {"mm": "mm", "in": "inch"}


def geometry_lines(_rows: Rows, settings: Settings) -> list[str]:
    """Return the lines that give genhexkins the robot's joints, in the table's unit of length."""
    return setp_lines(settings.task.robot.description, settings.axes.units[0])


def setp_lines(robot: ResolvedRobot, unit: str) -> list[str]:
    """Return the lines for a robot, with lengths in mm or in."""
    return [
        f"# {robot.name} for genhexkins, where [TRAJ]LINEAR_UNITS = {_INI_UNITS[unit]}.",
        "# spindle-offset and tool-offset stay zero: the controlled point is the robot file's.",
        *_points("base", robot.base_joints * LENGTH_UNITS[unit]),
        *_points("platform", robot.platform_joints * LENGTH_UNITS[unit]),
        *_thread(robot, unit),
    ]


def _thread(robot: ResolvedRobot, unit: str) -> Iterator[str]:
    """Yield the axes and the lead for the turn of the struts on their screws."""
    if robot.platform_cardan_axes is None:
        yield "setp genhexkins.screw-lead 0"
        return
    # With axes against each other a lead above zero is right-handed.
    yield from _points("base-n", robot.alpha_axes)
    yield from _points("platform-n", -robot.platform_cardan_axes)
    yield f"setp genhexkins.screw-lead {robot.thread_lead * LENGTH_UNITS[unit]:.12g}"


def _points(kind: str, joints: Array) -> Iterator[str]:
    for number, joint in enumerate(joints):
        for letter, value in zip(_LETTERS, joint, strict=True):
            yield f"setp genhexkins.{kind}.{number}.{letter} {value + 0.0:.12g}"
