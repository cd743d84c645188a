"""Deflection of every platform joint: angle between its strut and its reference axis."""

import casadi as ca
import numpy as np

from constraints.definition import LimitDefinition, Quantities


def _cosines(q: Quantities) -> ca.SX:
    return ca.sum1(q["strut_direction"] * q["platform_joint_axes"]).T


def _angles(q: Quantities) -> ca.SX:
    directions, axes = q["strut_direction"], q["platform_joint_axes"]
    sines = [ca.norm_2(ca.cross(directions[:, j], axes[:, j])) for j in range(directions.shape[1])]
    return ca.atan2(ca.vertcat(*sines), _cosines(q))


LIMIT = LimitDefinition(
    key="platform_joint_angle",
    title="platform joint angle",
    unit="rad",
    kind="upper",
    per_actuator=True,
    requires=("strut_direction", "platform_joint_axes"),
    natural=_angles,
    smooth=_cosines,
    transform=np.cos,
    decreasing=True,
)
