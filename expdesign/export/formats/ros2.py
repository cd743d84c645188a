"""ROS 2: JointTrajectory of the struts or MultiDOFJointTrajectory of the platform.

As the YAML that `ros2 topic pub` takes, or in an MCAP bag by the library rosbags.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from functools import partial
from importlib import import_module
from itertools import chain, islice, takewhile
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import model_validator
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from expdesign.configuration.errors import refusal
from expdesign.configuration.export import STRUT_AXES, ExportSection
from expdesign.export.definition import (
    POSE_AXES,
    Interpolation,
    Rows,
    Settings,
    TableError,
    TableFormat,
    round_to_clock,
)
from expdesign.export.repetition import collect
from expdesign.export.ros_messages import (
    FRAME,
    JOINTS,
    NANOSECONDS,
    PLATFORM,
    joint_names,
    message_rows,
    message_type,
    numbers_of,
    point_time,
    point_values,
    rows_of,
)
from expdesign.export.text_table import every_line, lines, write_lines
from expdesign.mechanism.hexapod import actuator_names
from expdesign.templates import text_templates

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

_NOW = {"sec": 0, "nanosec": 0}
_POINTS = "points:"
NEXT_KEY = "\n  "
_HEAD, _BLOCK = 100, 5000
"""Most lines before the points, and points that are read at once."""
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
    found = message_rows(rows, settings)
    write(path, found.expanded() if settings.section.binary_suffix else found, settings)


def _read(path: Path, settings: Settings) -> Rows:
    if settings.section.binary_suffix:
        return _read_message(_read_bag(path, settings), settings)
    try:
        return rows_of(
            collect(numbers_of(_plain_points(path, settings), settings), settings), settings
        )
    except _NotPlainError:
        return _read_message(_read_yaml(path), settings)


def _read_message(message: Mapping[str, Any], settings: Settings) -> Rows:
    _check_head(message, settings)
    return rows_of(collect(numbers_of([message["points"]], settings), settings), settings)


def _check_head(message: Mapping[str, Any], settings: Settings) -> None:
    """Refuse a message that the controller would read otherwise: its header and joints."""
    names = message["joint_names"]
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise TableError("joint_names is no list of names")
    if names != joint_names(settings):
        wanted = ", ".join(joint_names(settings))
        raise TableError(f"the joints are {', '.join(names)}, not {wanted}")
    header = message["header"]
    stamp = header.get("stamp", _NOW) if isinstance(header, dict) else None
    if stamp != _NOW or set(header) - {"stamp"} != {"frame_id"} or header["frame_id"] != FRAME:
        raise TableError(f"the header is not that of a message to be executed at once in {FRAME}")


def _write_yaml(path: Path, rows: Rows, settings: Settings) -> None:
    first, last = settings.window
    names = ", ".join(f'"{name}"' for name in joint_names(settings))
    head = [
        f"# {message_type(settings)}: {settings.title}, m and rad",
        f"# measurement window from {first:.9f} s to {last:.9f} s",
        f"header: {{frame_id: {FRAME}}}",
        f"joint_names: [{names}]",
        "points:",
    ]
    finer = replace(settings, digits=(settings.digits or 0) + _FINER)

    def lines_of(part: Rows) -> Iterator[str]:
        for cells in part.position:
            values = point_values(cells, settings)
            keys = (f"{key}: {_flow(value, settings, finer)}" for key, value in values.items())
            yield f"- {NEXT_KEY.join(keys)}"

    stamps = (_flow(point_time(time), settings, finer) for time in rows.every_time())
    points = zip(every_line(rows, lines_of), stamps, strict=True)
    text = (f"{point}{NEXT_KEY}time_from_start: {stamp}" for point, stamp in points)
    write_lines(path, chain(head, text))


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
        data = _load_yaml(path.read_text(encoding="ascii"))
    except RecursionError:
        raise TableError("no YAML of a message: it is nested too deeply") from None
    except _YAML_FAILURES as error:
        reason, *_ = str(error).split("\n")
        raise TableError(f"no YAML: {reason}") from error
    keys = {"header", "joint_names", "points"}
    if not isinstance(data, dict) or set(data) != keys or not isinstance(data["points"], list):
        raise TableError(f"no message with {', '.join(sorted(keys))}")
    return data


def _load_yaml(text: str) -> Any:
    return YAML(typ="safe", pure=True).load(text)


class _NotPlainError(Exception):
    """The file is YAML of another form than it was written in."""


def _plain_points(path: Path, settings: Settings) -> Iterator[list[Any]]:
    """Yield the points of a message in blocks, if they are plain lines, as JSON reads them.

    Of these lines JSON reads what YAML does, or nothing, and a hundred times as fast.
    """
    text = lines(path)
    head = list(takewhile(_POINTS.__ne__, islice(text, _HEAD)))
    try:
        data = _load_yaml("\n".join([*head, f"{_POINTS} []"]))
        if not isinstance(data, dict) or set(data) != {"header", "joint_names", "points"}:
            raise _NotPlainError
        _check_head(data, settings)
        yield from _parse_points(text)
    except (*_YAML_FAILURES, RecursionError) as error:
        if isinstance(error, TableError):
            raise
        raise _NotPlainError from error


def _parse_points(text: Iterable[str]) -> Iterator[list[Any]]:
    points: list[str] = []
    for line in text:
        found = _LINE.fullmatch(line)
        if found is None:
            raise _NotPlainError
        values = _KEY.sub(r'"\1": ', found[2])
        if found[1] == "- ":
            if len(points) == _BLOCK:
                yield json.loads(
                    f"[{','.join(f'{{{point}}}' for point in points)}]", object_pairs_hook=_unique
                )
                points.clear()
            points.append(values)
        elif points:
            points[-1] += f", {values}"
        else:
            raise _NotPlainError
    yield json.loads(f"[{','.join(f'{{{point}}}' for point in points)}]", object_pairs_hook=_unique)


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return a mapping; refuse a repeated key."""
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a key is repeated")
    return found


def _write_bag(path: Path, rows: Rows, settings: Settings) -> None:
    """Write a bag of one file."""
    rosbag2 = import_module("rosbags.rosbag2")
    store = _store()
    kind = message_type(settings)
    # No efforts are commanded; points of a platform have none.
    points = [
        {"effort": [], **point_values(cells, settings), "time_from_start": point_time(time)}
        for cells, time in zip(rows.position, rows.times, strict=True)
    ]
    header = {"stamp": _NOW, "frame_id": FRAME}
    data = {"header": header, "joint_names": joint_names(settings), "points": points}
    built = _built(store, kind, data)
    with TemporaryDirectory(dir=path.parent) as folder:
        bag_folder = Path(folder) / "bag"
        plugin = rosbag2.StoragePlugin.MCAP
        with rosbag2.Writer(bag_folder, version=_BAG_VERSION, storage_plugin=plugin) as bag:
            connection = bag.add_connection(TOPICS[kind], kind, typestore=store)
            bag.write(connection, 0, store.serialize_cdr(built, kind))
        next(bag_folder.glob("*.mcap")).replace(path)


def _read_bag(path: Path, settings: Settings) -> Mapping[str, Any]:
    """Return the only message of a bag."""
    highlevel = import_module("rosbags.highlevel")
    errors = import_module("rosbags.rosbag2.errors")
    kind = message_type(settings)
    try:
        with highlevel.AnyReader([path], default_typestore=_store()) as bag:
            found = [(connection, raw) for connection, _, raw in bag.messages()]
            if len(found) != 1:
                raise TableError(f"{len(found)} messages where there is one")
            ((connection, raw),) = found
            if (connection.msgtype, connection.topic) != (kind, TOPICS[kind]):
                raise TableError(f"the message is not a {kind} of {TOPICS[kind]}")
            message = _plain(bag.deserialize(raw, connection.msgtype))
    except TableError:
        raise
    except (highlevel.AnyReaderError, errors.ReaderError, *_BAG_FAILURES) as error:
        raise TableError(f"no bag that can be read: {error}") from error
    for number, point in enumerate(message["points"], start=1):
        if point.pop("effort", []):
            raise TableError(f"point {number} commands efforts")
    return {key: message[key] for key in ("header", "joint_names", "points")}


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
    reasons: ClassVar = {"units": "trajectories of ROS are in m and rad by definition (REP 103)"}

    encoding: Encoding | None = None

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


def _client(_rows: Rows, settings: Settings) -> list[str]:
    """Return the program that publishes a YAML file; a bag needs none."""
    if settings.section.binary_suffix:
        return []
    kind = message_type(settings)
    client = f"{settings.section.stem}{_CLIENT}"
    template = text_templates("expdesign.export").get_template("publish.py.j2")
    return template.render(client=client, type=kind, topic=TOPICS[kind]).splitlines()


def _guide_values(settings: Settings) -> dict[str, str]:
    return {"topic": TOPICS[message_type(settings)]}


FORMAT = TableFormat(
    name="ros2",
    title="ROS 2, trajectory_msgs",
    suffix=".yaml",
    interpolation=Interpolation.QUINTIC,
    write=_write,
    read=_read,
    options=Ros2Options,
    guide='{% extends "guides/ros2.txt.j2" %}',
    guide_values=_guide_values,
    clock="1 ns (`time_from_start`); the controller's update rate",
    capacity="4 GiB of a message; a trajectory before 2³¹ s",
    executed="rosbags reads it; a model of the polynomials",
    units="m",
    angles="rad",
    axes={"strut": actuator_names("strut_"), "pose": POSE_AXES},
    digits=8,
    repeats=True,
    companions={_CLIENT: _client},
    written_times=partial(round_to_clock, ticks=NANOSECONDS),
)
