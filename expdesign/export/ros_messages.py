"""The messages of ROS 2 as nested data: JointTrajectory, MultiDOFJointTrajectory for the platform.

A point of the first has six positions, velocities and accelerations; a point of the second a
translation with a quaternion, and twice a linear with an angular vector.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from constraints.arrays import Array
from expdesign.export.definition import Rows, Settings, TableError
from expdesign.export.repetition import Collected
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

_TIME = "time_from_start"
_XYZ, _XYZW = dict.fromkeys("xyz"), dict.fromkeys("xyzw")
_TWIST = [{"linear": _XYZ, "angular": _XYZ}]

# What a point holds of position, velocity and acceleration; None is a number.
_POINT: dict[str, dict[str, Any]] = {
    JOINTS: dict.fromkeys(("positions", "velocities", "accelerations"), [None] * ACTUATORS),
    PLATFORM: {
        "transforms": [{"translation": _XYZ, "rotation": _XYZW}],
        "velocities": _TWIST,
        "accelerations": _TWIST,
    },
}


def message_type(settings: Settings) -> str:
    """Return the type of the message for the coordinates asked for."""
    return JOINTS if settings.axes.space == "strut" else PLATFORM


def joint_names(settings: Settings) -> list[str]:
    """Return the names of the message's joints."""
    return list(settings.axes.names) if settings.axes.space == "strut" else [PLATFORM_JOINT]


def message_rows(rows: Rows, settings: Settings) -> Rows:
    """Return the rows with all numbers of a point as its position, (N, 18) or (N, 19)."""
    parts: tuple[Array, ...] = (rows.position, rows.velocities, rows.accelerations)
    if settings.axes.space == "pose":
        angles = rows.position[:, 3:]
        turned = (quaternions(angles), *angular_motion(*(part[:, 3:] for part in parts)))
        parts = tuple(
            np.concatenate([part[:, :3], turn], axis=1)
            for part, turn in zip(parts, turned, strict=True)
        )
    cells = np.concatenate(parts, axis=1)
    return Rows(rows.times, cells, repeated=rows.repeated, block=rows.block)


def point_values(cells: Array, settings: Settings) -> dict[str, Any]:
    """Return a point without its time, of its numbers (18,) or (19,)."""
    found = _nest_values(_POINT[message_type(settings)], iter(cells.tolist()))
    return dict(found)


def point_time(time: float) -> dict[str, int]:
    """Return a time, s, in a message."""
    sec, nanosec = divmod(round(time * NANOSECONDS), NANOSECONDS)
    return {"sec": sec, "nanosec": nanosec}


def _nest_values(shape: Any, values: Iterator[float]) -> Any:
    """Return the next values in nested data of a shape."""
    if shape is None:
        return next(values)
    if isinstance(shape, list):
        return [_nest_values(part, values) for part in shape]
    return {key: _nest_values(part, values) for key, part in shape.items()}


def _flat(shape: Any, found: Any) -> list[float]:
    """Return the numbers of nested data, which has to have the shape."""
    if shape is None:
        # `ros2 topic pub` takes no whole number for a float64.
        if not isinstance(found, float):
            raise ValueError("no floating-point number")
        return [found]
    if not isinstance(found, type(shape)):
        raise ValueError("neither a list nor a mapping")
    values = _values(found, tuple(shape)) if isinstance(shape, dict) else found
    parts = shape.values() if isinstance(shape, dict) else shape
    return [
        number for part, value in zip(parts, values, strict=True) for number in _flat(part, value)
    ]


def numbers_of(blocks: Iterable[list[Any]], settings: Settings) -> Iterator[tuple[Array, Array]]:
    """Yield times, s, and numbers of points, (N, 18) or (N, 19), in blocks.

    A `TableError` names the first point that deviates from the written form.
    """
    shape = _POINT[message_type(settings)]
    count = 0
    for points in blocks:
        times, cells = [], []
        for point in points:
            count += 1
            try:
                *state, stamp = _values(point, (*shape, _TIME))
                cells.append(_flat(list(shape.values()), state))
                times.append(_nanoseconds(stamp))
            except (KeyError, TypeError, ValueError) as error:
                raise TableError(
                    f"point {count} is incomplete or holds a value that is not a number or out of "
                    "range"
                ) from error
        if times:
            yield np.array(times, dtype=np.int64) / NANOSECONDS, np.array(cells)


def rows_of(found: Collected, settings: Settings) -> Rows:
    """Return the rows of the numbers of a message's points."""
    # A rotation that is a quaternion makes the position one longer.
    raw = found.rows(*np.split(found.values, [-2 * ACTUATORS, -ACTUATORS], axis=1))
    return raw if settings.axes.space == "strut" else _with_angles(raw)


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
    return replace(raw, position=position, rate=rate, acceleration=acceleration)


def _values(mapping: Any, keys: tuple[str, ...]) -> list[Any]:
    if not isinstance(mapping, dict) or set(mapping) != set(keys):
        raise ValueError("other keys")
    return [mapping[key] for key in keys]


def _nanoseconds(stamp: Any) -> int:
    sec, nanosec = _values(stamp, ("sec", "nanosec"))
    if any(not isinstance(part, int) or isinstance(part, bool) for part in (sec, nanosec)):
        raise ValueError("not whole numbers")
    if not (0 <= sec <= _LATEST and 0 <= nanosec < NANOSECONDS):
        raise ValueError("sec or nanosec is out of range")
    return int(sec) * NANOSECONDS + int(nanosec)
