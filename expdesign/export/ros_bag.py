"""ROS 2 messages in an MCAP bag, by the library rosbags."""

from __future__ import annotations

import struct
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from expdesign.configuration import InputError, Problem
from expdesign.export.definition import Settings
from expdesign.export.ros_messages import FRAME, NANOSECONDS, PLATFORM, Points, message_type
from expdesign.export.rows import TableError

TOPICS = {
    "trajectory_msgs/msg/JointTrajectory": "/joint_trajectory_controller/joint_trajectory",
    PLATFORM: "/platform_trajectory",
}
_BAG_VERSION = 9

# rosbags meets bytes that are damaged with these, too.
_READER_FAILURES = (
    struct.error,
    ValueError,
    LookupError,
    ArithmeticError,
    AssertionError,
    AttributeError,
    EOFError,
    MemoryError,
    RuntimeError,
    TypeError,
)


def refuse_without_library(key: str = "encoding") -> None:
    """Refuse a bag where rosbags is not installed.

    Raises
    ------
    InputError
        It tells how to install it.
    """
    if find_spec("rosbags") is None:
        raise InputError(
            Problem(
                "MCAP bags are written with the library rosbags, which is not installed",
                key=key,
                allowed="pip install expdesign[ros], or encoding: yaml",
            )
        )


def write(path: Path, points: Points, settings: Settings) -> None:
    """Write a message into a bag of one file."""
    rosbag2 = import_module("rosbags.rosbag2")
    store = _store()
    kind = message_type(settings)
    message = _message(store, kind, points)
    with TemporaryDirectory(dir=path.parent) as folder:
        bag_folder = Path(folder) / "bag"
        plugin = rosbag2.StoragePlugin.MCAP
        with rosbag2.Writer(bag_folder, version=_BAG_VERSION, storage_plugin=plugin) as bag:
            connection = bag.add_connection(TOPICS[kind], kind, typestore=store)
            bag.write(connection, 0, store.serialize_cdr(message, kind))
        next(bag_folder.glob("*.mcap")).replace(path)


def read(path: Path, settings: Settings) -> Points:
    """Read the message of a bag.

    Raises
    ------
    TableError
        It is no bag with one message of this type.
    """
    highlevel = import_module("rosbags.highlevel")
    errors = import_module("rosbags.rosbag2.errors")
    kind = message_type(settings)
    try:
        with highlevel.AnyReader([path], default_typestore=_store()) as bag:
            found = [
                bag.deserialize(raw, connection.msgtype)
                for connection, _, raw in bag.messages()
                if connection.msgtype == kind and connection.topic == TOPICS[kind]
            ]
    except (highlevel.AnyReaderError, errors.ReaderError, *_READER_FAILURES) as error:
        raise TableError(f"no bag that can be read: {error}") from error
    if len(found) != 1:
        raise TableError(f"{len(found)} messages {kind} where there is one")
    return _points(kind, found[0])


def _store() -> Any:
    typesys = import_module("rosbags.typesys")
    return typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)


def _message(store: Any, kind: str, points: Points) -> Any:
    types = store.types
    stamp, duration = (types[f"builtin_interfaces/msg/{name}"] for name in ("Time", "Duration"))
    header = types["std_msgs/msg/Header"](stamp=stamp(sec=0, nanosec=0), frame_id=FRAME)
    point_type = types[f"{kind}Point"]
    vector, quaternion, transform, twist = (
        types[f"geometry_msgs/msg/{name}"]
        for name in ("Vector3", "Quaternion", "Transform", "Twist")
    )
    made = []
    for k, time in enumerate(points.nanoseconds.tolist()):
        sec, nanosec = divmod(time, NANOSECONDS)
        p, v, a = (
            np.ascontiguousarray(x[k])
            for x in (points.positions, points.velocities, points.accelerations)
        )
        stamped = {"time_from_start": duration(sec=sec, nanosec=nanosec)}
        if kind == PLATFORM:
            made.append(
                point_type(
                    transforms=[transform(vector(*p[:3]), quaternion(*p[3:]))],
                    velocities=[twist(vector(*v[:3]), vector(*v[3:]))],
                    accelerations=[twist(vector(*a[:3]), vector(*a[3:]))],
                    **stamped,
                )
            )
        else:
            made.append(
                point_type(
                    positions=p, velocities=v, accelerations=a, effort=np.zeros(0), **stamped
                )
            )
    return types[kind](header=header, joint_names=list(points.names), points=made)


def _points(kind: str, message: Any) -> Points:
    rows: list[tuple[Any, ...]] = []
    for k, point in enumerate(message.points, start=1):
        if kind == PLATFORM:
            parts = (point.transforms, point.velocities, point.accelerations)
            if any(len(part) != 1 for part in parts):
                raise TableError(f"point {k} is not about one body")
            place = point.transforms[0]
            first = [*_vector(place.translation), *_vector(place.rotation), place.rotation.w]
            rates = (point.velocities[0], point.accelerations[0])
            twists = ([*_vector(t.linear), *_vector(t.angular)] for t in rates)
            rows.append((first, *twists))
        else:
            cells = (point.positions, point.velocities, point.accelerations)
            if any(len(cell) != 6 for cell in cells):  # noqa: PLR2004 - six struts
                raise TableError(f"point {k} has not 6 positions, velocities and accelerations")
            rows.append(cells)
    if not rows:
        raise TableError("the message has no points")
    times = [
        p.time_from_start.sec * NANOSECONDS + p.time_from_start.nanosec for p in message.points
    ]
    columns = (np.array(part, dtype=float) for part in zip(*rows, strict=True))
    return Points(tuple(message.joint_names), np.array(times, dtype=np.int64), *columns)


def _vector(value: Any) -> list[float]:
    return [value.x, value.y, value.z]
