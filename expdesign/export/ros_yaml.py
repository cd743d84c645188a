"""ROS 2 messages as the YAML that `ros2 topic pub` takes."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from expdesign.export.definition import Settings
from expdesign.export.ros_messages import (
    FRAME,
    NANOSECONDS,
    PLATFORM,
    Points,
    message_type,
)
from expdesign.export.rows import TableError

_FINER = 3
"""More digits for rotations: what is computed back from them keeps the digits asked for."""

_LATEST = 2**31 - 1
"""s: `sec` of builtin_interfaces/Duration has 32 bits."""

# ruamel.yaml meets malformed input with these, too.
_READER_FAILURES = (YAMLError, ValueError, LookupError, AttributeError, TypeError, AssertionError)

_XYZ, _XYZW = ("x", "y", "z"), ("x", "y", "z", "w")


def write(path: Path, points: Points, settings: Settings) -> None:
    """Write a message."""
    first, last = settings.window
    kind = message_type(settings)
    text = [
        f"# {kind}: {settings.name}, m and rad",
        f"# measurement window from {first:.9f} s to {last:.9f} s",
        f"header: {{frame_id: {FRAME}}}",
        f"joint_names: [{', '.join(_quoted(name) for name in points.names)}]",
        "points:",
    ]
    point = _platform_point if kind == PLATFORM else _joint_point
    for k, time in enumerate(points.nanoseconds.tolist()):
        text += point(points, k, settings)
        seconds, rest = divmod(time, NANOSECONDS)
        text.append(f"  time_from_start: {{sec: {seconds}, nanosec: {rest}}}")
    path.write_text("\n".join(text) + "\n", encoding="ascii")


def read(path: Path, settings: Settings) -> Points:
    """Read a message.

    Raises
    ------
    TableError
        It is no message of this type.
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
    taken = _platform_cells if message_type(settings) == PLATFORM else _joint_cells
    cells, times = [], []
    for k, point in enumerate(data["points"], start=1):
        try:
            times.append(_nanoseconds(point["time_from_start"]))
            cells.append([_floats(part) for part in taken(point)])
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise TableError(
                f"point {k} is not complete, or holds what is no number or out of range"
            ) from error
    sizes = {tuple(len(part) for part in row) for row in cells}
    wanted = (7, 6, 6) if message_type(settings) == PLATFORM else (6, 6, 6)
    if sizes != {wanted}:
        raise TableError(f"a point has not {wanted} positions, velocities and accelerations")
    columns = (np.array(part, dtype=float) for part in zip(*cells, strict=True))
    return Points(tuple(names), np.array(times, dtype=np.int64), *columns)


def _joint_point(points: Points, k: int, settings: Settings) -> list[str]:
    named = ("positions", "velocities", "accelerations")
    return [
        f"{'- ' if name == named[0] else '  '}{name}: [{_list(getattr(points, name)[k], settings)}]"
        for name in named
    ]


def _platform_point(points: Points, k: int, settings: Settings) -> list[str]:
    place = points.positions[k]
    finer = dataclasses.replace(settings, digits=(settings.digits or 0) + _FINER)
    lines = [
        f"- transforms: [{{translation: {_map(_XYZ, place[:3], settings)}, "
        f"rotation: {_map(_XYZW, place[3:], finer)}}}]"
    ]
    for name in ("velocities", "accelerations"):
        values = getattr(points, name)[k]
        lines.append(
            f"  {name}: [{{linear: {_map(_XYZ, values[:3], settings)}, "
            f"angular: {_map(_XYZ, values[3:], finer)}}}]"
        )
    return lines


def _joint_cells(point: Any) -> list[Sequence[Any]]:
    _refuse_other(point, {"positions", "velocities", "accelerations", "time_from_start"})
    return [point[name] for name in ("positions", "velocities", "accelerations")]


def _platform_cells(point: Any) -> list[Sequence[Any]]:
    _refuse_other(point, {"transforms", "velocities", "accelerations", "time_from_start"})
    (place,), (rate,), (second,) = (
        point[name] for name in ("transforms", "velocities", "accelerations")
    )
    return [
        [*_vector(place["translation"], _XYZ), *_vector(place["rotation"], _XYZW)],
        *(
            [*_vector(part["linear"], _XYZ), *_vector(part["angular"], _XYZ)]
            for part in (rate, second)
        ),
    ]


def _refuse_other(mapping: Any, keys: set[str]) -> None:
    if not isinstance(mapping, dict) or set(mapping) != keys:
        raise ValueError("other keys")


def _vector(mapping: Any, keys: tuple[str, ...]) -> list[Any]:
    _refuse_other(mapping, set(keys))
    return [mapping[key] for key in keys]


def _floats(values: Any) -> list[float]:
    # `ros2 topic pub` takes no whole number for a float64.
    if not isinstance(values, list) or not all(isinstance(value, float) for value in values):
        raise ValueError("not all are floating-point numbers")
    return values


def _nanoseconds(stamp: Any) -> int:
    _refuse_other(stamp, {"sec", "nanosec"})
    parts = (stamp["sec"], stamp["nanosec"])
    if not all(isinstance(part, int) and not isinstance(part, bool) for part in parts):
        raise ValueError("not whole numbers")
    if not (0 <= parts[0] <= _LATEST and 0 <= parts[1] < NANOSECONDS):
        raise ValueError("sec or nanosec is out of range")
    return int(parts[0]) * NANOSECONDS + int(parts[1])


def _list(values: Any, settings: Settings) -> str:
    return ", ".join(_float(value, settings) for value in values)


def _map(keys: tuple[str, ...], values: Any, settings: Settings) -> str:
    pairs = zip(keys, values, strict=True)
    return "{" + ", ".join(f"{key}: {_float(value, settings)}" for key, value in pairs) + "}"


def _float(value: float, settings: Settings) -> str:
    text = settings.number(value)
    return text if "." in text else f"{text}.0"


def _quoted(name: str) -> str:
    return f'"{name}"'
