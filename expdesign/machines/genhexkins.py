"""LinuxCNC's kinematics genhexkins: its pins for a robot, and the turn of its screws.

The controlled point's pose is (x, y, z, a, b, c) with R = Rz(c) Ry(b) Rx(a) and degrees. A strut
goes from ``base.N`` in the world to ``platform.N`` on the platform; `spindle-offset` and
`tool-offset` are added to z of both. Source: LinuxCNC, genhexkins(9) and genhexkins.c.
"""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import ResolvedRobot
from expdesign.configuration.geometry import StrutGeometry, geometry_at
from expdesign.configuration.parameters import Thread
from expdesign.mechanism.hexapod import ACTUATORS

_UNITS = {"mm": ("mm", 1e3), "in": ("inch", 1 / 0.0254)}


def setp_lines(robot: ResolvedRobot, unit: str) -> list[str]:
    """Return the lines of a HAL file for a robot, with lengths in mm or in."""
    name, scale = _UNITS[unit]
    points = {"base": robot.base_joints * scale, "platform": robot.platform_joints * scale}
    lead = 0.0
    if robot.platform_cardan_axes is not None:
        # With axes against each other a lead above zero is right-handed.
        points |= {"base-n": robot.alpha_axes, "platform-n": -robot.platform_cardan_axes}
        lead = robot.thread_lead * scale
    return [
        f"# {robot.name} for genhexkins, where [TRAJ]LINEAR_UNITS = {name}.",
        "# spindle-offset and tool-offset stay zero: the controlled point is the robot file's.",
        *(
            f"setp genhexkins.{kind}.{j}.{letter} {value + 0.0:.12g}"
            for kind, rows in points.items()
            for j, row in enumerate(rows)
            for letter, value in zip("xyz", row, strict=True)
        ),
        f"setp genhexkins.screw-lead {lead:.12g}",
    ]


BUILT_IN_JOINTS: dict[str, tuple[tuple[float, float], ...]] = {
    "base": (
        (-22.95, 13.25),
        (22.95, 13.25),
        (22.95, 13.25),
        (0, -26.5),
        (0, -26.5),
        (-22.95, 13.25),
    ),
    "platform": (
        (-1, 11.5),
        (1, 11.5),
        (10.459, -4.884),
        (9.459, -6.616),
        (-9.459, -6.616),
        (-10.459, -4.884),
    ),
}
"""x and y of the joints that genhexkins has where no line sets them; z is zero. Machine units."""
BUILT_IN_AXES: dict[str, tuple[tuple[float, float, float], ...]] = {
    "base-n": (
        (0.707107, 0, 0.707107),
        (0, -0.707107, 0.707107),
        (-0.707107, 0, 0.707107),
        (-0.707107, 0, 0.707107),
        (0, 0.707107, 0.707107),
        (0.707107, 0, 0.707107),
    ),
    "platform-n": (
        (-1, 0, 0),
        (0.866025, 0.5, 0),
        (0.866025, 0.5, 0),
        (0.866025, -0.5, 0),
        (0.866025, -0.5, 0),
        (-1, 0, 0),
    ),
}
"""The axes of its joints where no line sets them."""


def find_thread(
    lead: float, base_axes: Array, platform_axes: Array, home: StrutGeometry
) -> Thread | None:
    """Return the hand of genhexkins' threads; None if it differs between the struts.

    With axes of base and platform, (6, 3) in their frames, against each other at home a lead above
    zero is a right-handed thread, with both alike a left-handed one.
    """
    lower = np.cross(base_axes, home.directions)
    upper = np.cross(platform_axes @ home.rotation.T, home.directions)
    alike = np.sum(lower * upper, axis=1) * lead
    if np.all(alike < 0):
        return "right"
    return "left" if np.all(alike > 0) else None


def turn_errors(
    lead: float,
    base_axes: Array,
    platform_axes: Array,
    home: Array,
    poses: Array,
    base: Array,
    platform: Array,
) -> Array:
    """Return the errors of genhexkins' lengths at poses, (N, 6), m.

    It corrects the lengths by screw-lead / 2π · arcsin of the turns' sine. The arc sine is that of
    another turn where the axes, (6, 3) in the frames of base and platform, are more than a right
    angle from their sense at home, seen along the strut. Lead in m, home (6,) and poses (N, 6) in m
    and rad, joints of base and platform (6, 3) in m.
    """
    _, sense = screw_turns(base_axes, platform_axes, geometry_at(home, base, platform))
    errors = np.zeros((len(poses), ACTUATORS))
    for row, pose in zip(errors, poses, strict=True):
        sine, cosine = screw_turns(base_axes, platform_axes, geometry_at(pose, base, platform))
        beyond = np.pi - 2 * np.abs(np.arcsin(np.clip(sine, -1, 1)))
        row[:] = np.where(cosine * sense < 0, abs(lead) * beyond / (2 * np.pi), 0.0)
    return errors


def screw_turns(
    base_axes: Array, platform_axes: Array, struts: StrutGeometry
) -> tuple[Array, Array]:
    """Return sine and cosine of the angle between the axes, seen along each strut, (6,)."""
    along = struts.directions
    lower, upper = base_axes, platform_axes @ struts.rotation.T
    parts = [axes - np.sum(axes * along, axis=1)[:, None] * along for axes in (lower, upper)]
    lower, upper = (part / np.linalg.norm(part, axis=1)[:, None] for part in parts)
    return np.sum(along * np.cross(lower, upper), axis=1), np.sum(lower * upper, axis=1)
