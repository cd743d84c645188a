"""ROS 2 messages as the YAML that `ros2 topic pub` takes."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from expdesign.export.definition import Settings
from expdesign.export.ros_messages import FRAME, message_type
from expdesign.export.rows import TableError
from expdesign.export.text_table import write_lines

_FINER = 3
"""More digits for rotations: what is computed back from them keeps the digits asked for."""

_ROTATIONS = frozenset({"rotation", "angular"})

# ruamel.yaml meets malformed input with these, too.
_READER_FAILURES = (YAMLError, ValueError, LookupError, AttributeError, TypeError, AssertionError)


def write(path: Path, message: Mapping[str, Any], settings: Settings) -> None:
    """Write a message."""
    first, last = settings.window
    names = ", ".join(f'"{name}"' for name in message["joint_names"])
    text = [
        f"# {message_type(settings)}: {settings.name}, m and rad",
        f"# measurement window from {first:.9f} s to {last:.9f} s",
        f"header: {{frame_id: {FRAME}}}",
        f"joint_names: [{names}]",
        "points:",
    ]
    finer = dataclasses.replace(settings, digits=(settings.digits or 0) + _FINER)
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


def read(path: Path, _settings: Settings) -> Mapping[str, Any]:
    """Read a message.

    Raises
    ------
    TableError
        It is no message.
    """
    try:
        data = YAML(typ="safe", pure=True).load(path.read_text(encoding="ascii"))
    except RecursionError:
        raise TableError("no YAML of a message: it is nested too deeply") from None
    except _READER_FAILURES as error:
        reason, *_ = str(error).split("\n")
        raise TableError(f"no YAML: {reason}") from error
    keys = {"header", "joint_names", "points"}
    if not isinstance(data, dict) or set(data) != keys or not isinstance(data["points"], list):
        raise TableError(f"no message with {', '.join(sorted(keys))}")
    names = data["joint_names"]
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise TableError("joint_names is no list of names")
    return data
