"""The messages of ROS 2 as nested data: JointTrajectory, MultiDOFJointTrajectory for the platform.

A point of the first has six positions, velocities and accelerations; a point of the second a
translation with a quaternion, and twice a linear with an angular vector.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from constraints.arrays import Array
from expdesign.export.definition import Rows, Settings, TableError
from expdesign.export.rotation import (
    angle_derivatives,
    angular_motion,
    from_quaternions,
    quaternions,
)
from expdesign.mechanism.hexapod import ACTUATORS

JOINTS = "trajectory_msgs/msg/JointTrajectory"
PLATFORM = "trajectory_msgs/msg/MultiDOFJointTrajectory"
FRAME, PLATFORM_JOINT = "base", "platform"
NANOSECONDS = 1_000_000_000

_UNIT_LENGTH = 1e-6
_LATEST = 2**31 - 1
"""s: `sec` of builtin_interfaces/Duration has 32 bits."""

_XYZ, _XYZW = ("x", "y", "z"), ("x", "y", "z", "w")
_STATE = ("positions", "velocities", "accelerations")
_TIME = "time_from_start"

# What a point holds of each part of the state: its key, and the vectors below it.
_TWIST: dict[str, tuple[str, ...]] = {"linear": _XYZ, "angular": _XYZ}
_BODY: tuple[tuple[str, dict[str, tuple[str, ...]]], ...] = (
    ("transforms", {"translation": _XYZ, "rotation": _XYZW}),
    ("velocities", _TWIST),
    ("accelerations", _TWIST),
)


def message_type(settings: Settings) -> str:
    """Return the type of the message for the coordinates asked for."""
    return JOINTS if settings.axes.space == "strut" else PLATFORM


def message_of(rows: Rows, settings: Settings) -> dict[str, Any]:
    """Return names and points of the message for rows with velocities and accelerations."""
    parts: tuple[Array, ...] = (rows.position, rows.velocities, rows.accelerations)
    strut = settings.axes.space == "strut"
    names = settings.axes.names if strut else (PLATFORM_JOINT,)
    if not strut:
        angles = rows.position[:, 3:]
        turned = (quaternions(angles), *angular_motion(*(part[:, 3:] for part in parts)))
        parts = tuple(
            np.concatenate([part[:, :3], turn], axis=1)
            for part, turn in zip(parts, turned, strict=True)
        )
    point = _joint_point if strut else _body_point
    points = []
    for time, *state in zip(np.rint(rows.times * NANOSECONDS), *parts, strict=True):
        sec, nanosec = divmod(int(time), NANOSECONDS)
        points.append({**point(state), _TIME: {"sec": sec, "nanosec": nanosec}})
    return {"joint_names": list(names), "points": points}


def _joint_point(state: Iterable[Array]) -> dict[str, Any]:
    return {key: values.tolist() for key, values in zip(_STATE, state, strict=True)}


def _body_point(state: Iterable[Array]) -> dict[str, Any]:
    point = {}
    for (key, vectors), values in zip(_BODY, state, strict=True):
        left = iter(values.tolist())
        point[key] = [{name: {c: next(left) for c in axes} for name, axes in vectors.items()}]
    return point


def rows_of(message: Mapping[str, Any], settings: Settings) -> Rows:
    """Return the rows that a message states.

    Raises
    ------
    TableError
        Other joints, a point with other values, a rotation that is none, or rows that are not
        complete.
    """
    strut = settings.axes.space == "strut"
    names = settings.axes.names if strut else (PLATFORM_JOINT,)
    if tuple(message["joint_names"]) != names:
        found = ", ".join(message["joint_names"])
        raise TableError(f"the joints are {found}, not {', '.join(names)}")
    values = _joint_values if strut else _body_values
    times, cells = [], []
    for k, point in enumerate(message["points"], start=1):
        try:
            cells.append([_floats(part) for part in values(point)])
            times.append(_nanoseconds(point[_TIME]))
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise TableError(
                f"point {k} is not complete, or holds what is no number or out of range"
            ) from error
    body = tuple(sum(map(len, vectors.values())) for _, vectors in _BODY)
    wanted = (ACTUATORS,) * len(_STATE) if strut else body
    if {tuple(len(part) for part in row) for row in cells} != {wanted}:
        raise TableError(f"a point has not {wanted} positions, velocities and accelerations")
    position, rate, acceleration = (np.array(part) for part in zip(*cells, strict=True))
    seconds = np.array(times, dtype=np.int64) / NANOSECONDS
    raw = Rows(seconds, position, rate, acceleration).checked()
    return raw if strut else _with_angles(raw)


def _with_angles(raw: Rows) -> Rows:
    turned = raw.position[:, 3:]
    off = np.flatnonzero(np.abs(np.linalg.norm(turned, axis=1) - 1) > _UNIT_LENGTH)
    if off.size:
        raise TableError(f"row {off[0] + 1}: the rotation is no unit quaternion")
    angles = from_quaternions(turned)
    rates = angle_derivatives(angles, raw.velocities[:, 3:], raw.accelerations[:, 3:])
    position, rate, acceleration = (
        np.concatenate([part[:, :3], turn], axis=1)
        for part, turn in zip(
            (raw.position, raw.velocities, raw.accelerations), (angles, *rates), strict=True
        )
    )
    return Rows(raw.times, position, rate, acceleration)


def _joint_values(point: Any) -> list[Any]:
    return _values(point, (*_STATE, _TIME))[:-1]


def _body_values(point: Any) -> list[list[Any]]:
    keys = tuple(key for key, _ in _BODY)
    bodies = _values(point, (*keys, _TIME))[:-1]
    found = []
    for (_, vectors), (body,) in zip(_BODY, bodies, strict=True):
        parts = zip(_values(body, tuple(vectors)), vectors.values(), strict=True)
        found.append([value for part, axes in parts for value in _values(part, axes)])
    return found


def _values(mapping: Any, keys: tuple[str, ...]) -> list[Any]:
    if not isinstance(mapping, dict) or set(mapping) != set(keys):
        raise ValueError("other keys")
    return [mapping[key] for key in keys]


def _floats(values: Any) -> list[float]:
    # `ros2 topic pub` takes no whole number for a float64.
    if not isinstance(values, list) or not all(isinstance(value, float) for value in values):
        raise ValueError("not all are floating-point numbers")
    return values


def _nanoseconds(stamp: Any) -> int:
    sec, nanosec = _values(stamp, ("sec", "nanosec"))
    if any(not isinstance(part, int) or isinstance(part, bool) for part in (sec, nanosec)):
        raise ValueError("not whole numbers")
    if not (0 <= sec <= _LATEST and 0 <= nanosec < NANOSECONDS):
        raise ValueError("sec or nanosec is out of range")
    return int(sec) * NANOSECONDS + int(nanosec)
