"""The messages of ROS 2 as arrays: JointTrajectory, and MultiDOFJointTrajectory for the platform.

A point of the first has six positions, velocities and accelerations; a point of the second a
translation with a quaternion (7), and twice a linear with an angular vector (6).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.export.definition import Settings
from expdesign.export.rotation import (
    angle_derivatives,
    angular_motion,
    from_quaternions,
    quaternions,
)
from expdesign.export.rows import Rows, TableError

JOINTS = "trajectory_msgs/msg/JointTrajectory"
PLATFORM = "trajectory_msgs/msg/MultiDOFJointTrajectory"
FRAME, PLATFORM_JOINT = "base", "platform"
NANOSECONDS = 1_000_000_000
_TIME_DIGITS = 9
_UNIT_LENGTH = 1e-6


@dataclass(frozen=True, eq=False)
class Points:
    """The points of a message.

    Attributes
    ----------
    names : tuple of str
        Joints.
    nanoseconds : (N,)
        Time from start, whole numbers.
    positions, velocities, accelerations : (N, 6), or (N, 7) and twice (N, 6)
    """

    names: tuple[str, ...]
    nanoseconds: NDArray[np.int64]
    positions: Array
    velocities: Array
    accelerations: Array


def written_times(times: Array) -> Array:
    """Return times as the message states them, in whole nanoseconds."""
    return np.round(times, _TIME_DIGITS)


def message_type(settings: Settings) -> str:
    """Return the type of the message for the coordinates asked for."""
    return JOINTS if settings.axes.space == "strut" else PLATFORM


def points_of(rows: Rows, settings: Settings) -> Points:
    """Return the message for rows with velocities and accelerations."""
    if rows.rate is None or rows.acceleration is None:
        raise ValueError("a trajectory needs velocities and accelerations")
    nanoseconds = np.rint(rows.times * NANOSECONDS).astype(np.int64)
    if settings.axes.space == "strut":
        names = settings.axes.names
        return Points(names, nanoseconds, rows.position, rows.rate, rows.acceleration)
    angles, rates, accelerations = (
        part[:, 3:] for part in (rows.position, rows.rate, rows.acceleration)
    )
    velocity, acceleration = angular_motion(angles, rates, accelerations)
    return Points(
        (PLATFORM_JOINT,),
        nanoseconds,
        np.concatenate([rows.position[:, :3], quaternions(angles)], axis=1),
        np.concatenate([rows.rate[:, :3], velocity], axis=1),
        np.concatenate([rows.acceleration[:, :3], acceleration], axis=1),
    )


def rows_of(points: Points, settings: Settings) -> Rows:
    """Return the rows that a message states.

    Raises
    ------
    TableError
        Other joints, a rotation that is none, or rows that are not complete.
    """
    strut = settings.axes.space == "strut"
    names = settings.axes.names if strut else (PLATFORM_JOINT,)
    if points.names != names:
        raise TableError(f"the joints are {', '.join(points.names)}, not {', '.join(names)}")
    times = points.nanoseconds / NANOSECONDS
    raw = Rows(times, points.positions, points.velocities, points.accelerations).checked()
    if strut or raw.rate is None or raw.acceleration is None:
        return raw
    turned = raw.position[:, 3:]
    off = np.flatnonzero(np.abs(np.linalg.norm(turned, axis=1) - 1) > _UNIT_LENGTH)
    if off.size:
        raise TableError(f"row {off[0] + 1}: the rotation is no unit quaternion")
    angles = from_quaternions(turned)
    rates, accelerations = angle_derivatives(angles, raw.rate[:, 3:], raw.acceleration[:, 3:])
    return Rows(
        times,
        np.concatenate([raw.position[:, :3], angles], axis=1),
        np.concatenate([raw.rate[:, :3], rates], axis=1),
        np.concatenate([raw.acceleration[:, :3], accelerations], axis=1),
    )
