"""ROS 2: JointTrajectory of the struts or MultiDOFJointTrajectory of the platform.

As the YAML that `ros2 topic pub` takes, or in an MCAP bag by the library rosbags.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import model_validator
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from expdesign.configuration.errors import refusal
from expdesign.configuration.export import STRUT_AXES, ExportSection
from expdesign.configuration.schema import one_of
from expdesign.export.definition import (
    POSE_AXES,
    Guide,
    Interpolation,
    Rows,
    Settings,
    TableError,
    TableFormat,
    on_grid,
)
from expdesign.export.ros_messages import (
    FRAME,
    JOINTS,
    NANOSECONDS,
    PLATFORM,
    message_of,
    message_type,
    rows_of,
)
from expdesign.export.text_table import write_lines
from expdesign.mechanism.hexapod import actuator_names

_FINER = 3
"""More digits for rotations: what is computed back from them keeps the digits asked for."""

_ROTATIONS = frozenset({"rotation", "angular"})

# ruamel.yaml meets malformed input with these, too.
_YAML_FAILURES = (YAMLError, ValueError, LookupError, AttributeError, TypeError, AssertionError)

TOPICS = {
    JOINTS: "/joint_trajectory_controller/joint_trajectory",
    PLATFORM: "/platform_trajectory",
}
_BAG_VERSION = 9

_POINTS = "\npoints:"
_LINE = re.compile(r"(- |  )([a-z_]+: [-a-z_0-9., :\[\]{}]+)")
_KEY = re.compile(r"\b(?!(?:null|true|false):)([a-z_]+): ")

# rosbags meets bytes that are damaged with these, too.
_BAG_FAILURES = (
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


def _write(path: Path, rows: Rows, settings: Settings) -> None:
    write = _write_bag if settings.section.binary_suffix else _write_yaml
    write(path, message_of(rows, settings), settings)


def _read(path: Path, settings: Settings) -> Rows:
    bag = settings.section.binary_suffix
    return rows_of(_read_bag(path, settings) if bag else _read_yaml(path), settings)


def _write_yaml(path: Path, message: Mapping[str, Any], settings: Settings) -> None:
    first, last = settings.window
    names = ", ".join(f'"{name}"' for name in message["joint_names"])
    text = [
        f"# {message_type(settings)}: {settings.title}, m and rad",
        f"# measurement window from {first:.9f} s to {last:.9f} s",
        f"header: {{frame_id: {FRAME}}}",
        f"joint_names: [{names}]",
        "points:",
    ]
    finer = replace(settings, digits=(settings.digits or 0) + _FINER)
    for point in message["points"]:
        keys = [f"{key}: {_flow(value, settings, finer)}" for key, value in point.items()]
        text += [f"{'  ' if k else '- '}{line}" for k, line in enumerate(keys)]
    write_lines(path, text)


def _flow(value: Any, settings: Settings, finer: Settings) -> str:
    """Return nested data in one line; rotations with more digits."""
    if isinstance(value, dict):
        pairs = (
            f"{key}: {_flow(part, finer if key in _ROTATIONS else settings, finer)}"
            for key, part in value.items()
        )
        return "{" + ", ".join(pairs) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(_flow(part, settings, finer) for part in value) + "]"
    if isinstance(value, int):
        return str(value)
    text = settings.number(value)
    return text if "." in text else f"{text}.0"


def _read_yaml(path: Path) -> Mapping[str, Any]:
    """Return the message of a YAML file."""
    try:
        text = path.read_text(encoding="ascii")
        data = _of_lines(text) or _load_yaml(text)
    except RecursionError:
        raise TableError("no YAML of a message: it is nested too deeply") from None
    except _YAML_FAILURES as error:
        reason, *_ = str(error).split("\n")
        raise TableError(f"no YAML: {reason}") from error
    keys = {"header", "joint_names", "points"}
    if not isinstance(data, dict) or set(data) != keys or not isinstance(data["points"], list):
        raise TableError(f"no message with {', '.join(sorted(keys))}")
    names = data["joint_names"]
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise TableError("joint_names is no list of names")
    return data


def _load_yaml(text: str) -> Any:
    return YAML(typ="safe", pure=True).load(text)


def _of_lines(text: str) -> dict[str, Any] | None:
    """Return a message whose points are plain lines, as JSON reads them; None of another.

    Of these lines JSON reads what YAML does, or nothing, and a hundred times as fast.
    """
    head, _, body = text.partition(f"{_POINTS}\n")
    found = [_LINE.fullmatch(line) for line in body.removesuffix("\n").split("\n")]
    lines = [("}, {" if m[1] == "- " else ", ") + _KEY.sub(r'"\1": ', m[2]) for m in found if m]
    if len(lines) < len(found) or not lines[0].startswith("}, {"):
        return None
    try:
        points = json.loads(f"[{''.join(lines)[3:]}}}]", object_pairs_hook=_unique)
    except ValueError:
        return None
    data = _load_yaml(f"{head}{_POINTS} []\n")
    return (
        data | {"points": points} if isinstance(data, dict) and data.get("points") == [] else None
    )


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return a mapping; refuse a repeated key."""
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a key is repeated")
    return found


def _write_bag(path: Path, message: Mapping[str, Any], settings: Settings) -> None:
    """Write a bag of one file."""
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


def _read_bag(path: Path, settings: Settings) -> Mapping[str, Any]:
    """Return the only message of its type in a bag."""
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
    except (highlevel.AnyReaderError, errors.ReaderError, *_BAG_FAILURES) as error:
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


Encoding = Literal["yaml", "mcap"]


class Ros2Options(ExportSection):
    """Options of a ROS 2 trajectory."""

    spaces = ("strut", "pose")
    shared = ("space", "digits", "axes", *STRUT_AXES)

    encoding: Annotated[Encoding, one_of(Encoding)] | None = None

    @model_validator(mode="after")
    def _check_digits(self) -> Ros2Options:
        if self.binary_suffix and self.digits is not None:
            message = "a bag holds numbers with all their digits"
            raise refusal(message, "with encoding: yaml only", key="digits")
        return self

    @property
    def binary_suffix(self) -> str:
        """Suffix of an MCAP bag; empty for YAML."""
        return ".mcap" if self.encoding == "mcap" else ""


_CLIENT = ".publish.py"
_CLIENT_LINES = """\
#!/usr/bin/env python3
\"""Publish a message of a YAML file once: {client} FILE [--check]

With --check the message is built and its points are counted, but nothing is published.
\"""

import sys

import rclpy
import yaml
from rosidl_runtime_py import set_message_fields
from rosidl_runtime_py.utilities import get_message

TYPE, TOPIC = "{type}", "{topic}"
with open(sys.argv[1], encoding="ascii") as file:
    values = yaml.load(file, getattr(yaml, "CSafeLoader", yaml.SafeLoader))
message = get_message(TYPE)()
set_message_fields(message, values)
print(f"{{len(message.points)}} points of {{TYPE}}")
if "--check" not in sys.argv[2:]:
    rclpy.init()
    node = rclpy.create_node("expdesign")
    publisher = node.create_publisher(type(message), TOPIC, 1)
    while not publisher.get_subscription_count():
        print(f"waiting for a subscriber of {{TOPIC}}")
        rclpy.spin_once(node, timeout_sec=1.0)
    publisher.publish(message)
    publisher.wait_for_all_acked()
    rclpy.shutdown()
"""


def _client(_rows: Rows, settings: Settings) -> list[str]:
    """Return the program that publishes a YAML file; a bag needs none."""
    if settings.section.binary_suffix:
        return []
    kind = message_type(settings)
    client = f"{settings.section.stem}{_CLIENT}"
    return _CLIENT_LINES.format(client=client, type=kind, topic=TOPICS[kind]).splitlines()


def _guide_values(settings: Settings) -> dict[str, str]:
    """Return the topic and the commands for a YAML file or a bag."""
    topic = TOPICS[message_type(settings)]
    if settings.section.binary_suffix:
        return {
            "topic": topic,
            "load": "The file is a bag with one message.\n\n    ros2 bag info -s mcap {file}",
            "run": "ros2 bag play -s mcap {file}",
        }
    return {
        "topic": topic,
        "load": "The file is one message, too long for an argument of `ros2 topic pub`; {beside} "
        "publishes it. It needs nothing but a sourced ROS 2.\n\n"
        "    python3 {beside} {file} --check",
        "run": "python3 {beside} {file}",
    }


FORMAT = TableFormat(
    name="ros2",
    title="ROS 2, trajectory_msgs",
    suffix=".yaml",
    interpolation=Interpolation.QUINTIC,
    write=_write,
    read=_read,
    options=Ros2Options,
    guide=Guide(
        before=(
            "Points have position, velocity and acceleration: the controller has to interpolate "
            "with quintic polynomials (joint_trajectory_controller does, with "
            "interpolation_method: splines). For a platform the message contains the TCP's "
            "position, a quaternion (x, y, z, w), and twists in the base frame. The controller "
            "has to listen:\n\n"
            "    ros2 topic info {topic}"
        ),
        load="{load}",
        run="Move the robot to the start with your planner, then publish the message once:\n\n"
        "    {run}\n\n"
        "A message without points stops the joints.",
        record="    ros2 bag record /joint_states /dynamic_joint_states",
    ),
    guide_values=_guide_values,
    clock="1 ns (`time_from_start`); the controller's update rate",
    capacity="4 GiB of a message; a trajectory before 2³¹ s",
    executed="rosbags reads it; a model of the polynomials",
    units="m",
    angles="rad",
    axes={"strut": actuator_names("strut_"), "pose": POSE_AXES},
    digits=8,
    beside={_CLIENT: _client},
    written_times=on_grid(NANOSECONDS),
)
