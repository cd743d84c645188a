"""Limits on angles between two directions: tilt of the platform, deflection of its joints."""

import casadi as ca
import numpy as np

from constraints.definition import LimitDefinition, Quantities


def _tilt(q: Quantities) -> ca.SX:
    # atan2 of sine and cosine: the arc cosine alone loses half its digits near zero.
    rotation = q["rotation_matrix"]
    return ca.atan2(ca.hypot(rotation[0, 2], rotation[1, 2]), rotation[2, 2])


def _cosines(q: Quantities) -> ca.SX:
    return ca.sum1(q["strut_direction"] * q["platform_joint_axes"]).T


def _angles(q: Quantities) -> ca.SX:
    directions, axes = q["strut_direction"], q["platform_joint_axes"]
    sines = [ca.norm_2(ca.cross(directions[:, j], axes[:, j])) for j in range(directions.shape[1])]
    return ca.atan2(ca.vertcat(*sines), _cosines(q))


LIMITS = (
    LimitDefinition(
        key="tilt",
        title="tilt of the platform",
        unit="rad",
        kind="upper",
        requires=("rotation_matrix",),
        natural=_tilt,
        smooth=lambda q: q["rotation_matrix"][2, 2],
        transform=np.cos,
        decreasing=True,
    ),
    LimitDefinition(
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
    ),
)
