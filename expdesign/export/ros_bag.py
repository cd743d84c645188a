"""ROS 2 messages in an MCAP bag, by the library rosbags."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from expdesign.configuration import InputError, Problem
from expdesign.export.definition import Settings
from expdesign.export.ros_messages import FRAME, JOINTS, PLATFORM, message_type
from expdesign.export.rows import TableError

TOPICS = {
    JOINTS: "/joint_trajectory_controller/joint_trajectory",
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


def write(path: Path, message: Mapping[str, Any], settings: Settings) -> None:
    """Write a message into a bag of one file."""
    rosbag2 = import_module("rosbags.rosbag2")
    store = _store()
    kind = message_type(settings)
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": FRAME}
    # No efforts are commanded; points of a platform have none.
    points = [{"effort": [], **point} for point in message["points"]]
    data = {"header": header, "joint_names": message["joint_names"], "points": points}
    built = _built(store, kind, data)
    with TemporaryDirectory(dir=path.parent) as folder:
        bag_folder = Path(folder) / "bag"
        plugin = rosbag2.StoragePlugin.MCAP
        with rosbag2.Writer(bag_folder, version=_BAG_VERSION, storage_plugin=plugin) as bag:
            connection = bag.add_connection(TOPICS[kind], kind, typestore=store)
            bag.write(connection, 0, store.serialize_cdr(built, kind))
        next(bag_folder.glob("*.mcap")).replace(path)


def read(path: Path, settings: Settings) -> Mapping[str, Any]:
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
    message = _plain(found[0])
    for point in message["points"]:
        point.pop("effort", None)
    return message


def _store() -> Any:
    typesys = import_module("rosbags.typesys")
    return typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)


def _built(store: Any, kind: str, data: Any) -> Any:
    """Return a message of a type from nested data."""
    made = {}
    for name, (node, about) in store.fielddefs[kind][1]:
        value = data[name]
        if node.name == "NAME":
            value = _built(store, about, value)
        elif node.name == "SEQUENCE":
            (item, of), _ = about
            if item.name == "NAME":
                value = [_built(store, of, one) for one in value]
            elif of[0] == "float64":
                value = np.array(value, dtype=np.float64)
        made[name] = value
    return store.types[kind](**made)


def _plain(value: Any) -> Any:
    """Return a message as nested data."""
    if is_dataclass(value):
        names = (field.name for field in fields(value) if not field.name.startswith("_"))
        return {name: _plain(getattr(value, name)) for name in names}
    if isinstance(value, np.ndarray):
        return value.tolist()
    return [_plain(one) for one in value] if isinstance(value, list) else value
