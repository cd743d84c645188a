"""Lists of joints in JSON, YAML or CSV: two sets of six points, known by their names."""

from __future__ import annotations

import csv
import json
import re
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic_core import PydanticCustomError

from constraints.arrays import Array
from expdesign.configuration.delimited import split_table
from expdesign.configuration.document import read_text, read_yaml
from expdesign.configuration.errors import InputError
from expdesign.configuration.quantity import LENGTH
from expdesign.machines.machine import MachineDraft, MachineFormat, Question, rows
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATE_NAMES

_DEEPEST = 8
_NAMES = {
    "base": re.compile(r"base|lower|bottom|fixed|ground|\b(a|aa|fa)\b"),
    "platform": re.compile(r"platform|plate|top|upper|moving|mobile|effector|\b(b|bb|mb)\b"),
}
_HEIGHT = re.compile(r"\b(height|h)\b")
_UNIT = re.compile(r"\bunits?\b")
_MILLIMETRES = 5.0
"""Coordinates from here on are taken as millimetres in a file without a unit."""
_RAISED = 0.1
"""Height of the platform's points over those of the base, as a share of the base's size, from which
both are in one frame."""
_AS_HIGH = 0.1
"""Relative difference up to which that height is the stated one, of a TCP near the joints."""
_ALLOWED = (
    "two sets of six points [x, y, z], base_joints and platform_joints, and optionally height and "
    "unit; CSV has the columns base_x … platform_z, or name, x, y, z; a column with the same cell "
    "in every row, or a row with one, is a value"
)


def draft_of_points(
    name: str,
    source: str,
    values: Mapping[str, Any],
    file: Path,
    names: Mapping[str, str] | None = None,
) -> MachineDraft:
    """Return the machine with the two sets of six points among named values.

    Parameters
    ----------
    name, source : str
    values : mapping
        Arrays, numbers and texts by dotted names; without one named ``unit`` lengths are metres or
        millimetres by their size.
    file : Path
    names : mapping of str to str, optional
        Names of the sets, by ``base`` and ``platform``, where their own do not say it.

    Raises
    ------
    InputError
        There is no set for base or platform, or several.
    """
    sets = {key: points for key, value in values.items() if (points := _six(value)) is not None}
    questions, names = [], names or {}
    if not names and (letters := _by_letters(list(sets))) is not None:
        text = f"Taken as base: {letters[0]}; as platform: {letters[1]}. Is it so?"
        questions.append(Question("", text))
        sets = {"base": sets[letters[0]], "platform": sets[letters[1]]}
    chosen = {}
    for end, pattern in _NAMES.items():
        others = [one for key, one in _NAMES.items() if key != end]
        found = [
            key
            for key in sets
            if (
                key == names[end]
                if end in names
                else pattern.search(_words(key)) and not any(o.search(_words(key)) for o in others)
            )
        ]
        if len(found) != 1:
            listed = ", ".join(sets) or "none"
            message = f"{len(found)} sets of joints of the {end}; sets of six points: {listed}"
            by_name = f". Name them: {_options(list(sets))}" if len(sets) > 1 else ""
            raise InputError(message, file, allowed=f"{_ALLOWED}{by_name}")
        chosen[end] = sets[found[0]]
    stated = [value for key, value in values.items() if _UNIT.search(_words(key))]
    unit = str(stated[0]) if stated else ""
    if not stated:
        largest = max(float(np.max(np.abs(points))) for points in chosen.values())
        unit = "mm" if largest >= _MILLIMETRES else "m"
        text = f"The file has no unit: its lengths are taken as {unit}. Are they?"
        questions.append(Question("base_joints", text))
    try:
        scale = LENGTH.parse(f"1 {unit}")
    except PydanticCustomError as error:
        raise InputError(error.message(), file, key="unit", allowed="such as mm") from None
    values = {key: _in_unit(value, scale) for key, value in values.items()}
    given = [value for key, value in values.items() if _HEIGHT.search(_words(key))]
    heights = [float(one) for one in given if isinstance(one, int | float)]
    base, platform = (scale * points for points in (chosen["base"], chosen["platform"]))
    home = np.array([0.0, 0.0, scale * heights[0]]) if heights else None
    raised = float(np.mean(platform[:, 2]) - np.mean(base[:, 2]))
    if abs(raised) > _RAISED * float(np.ptp(base, axis=0).max()):
        if home is None:
            home = platform.mean(axis=0)
            platform = platform - home
            questions.append(_AMID)
        elif abs(raised - home[2]) < _AS_HIGH * abs(raised):
            platform = platform - home
            questions.append(_in_base_frame(raised, home[2]))
    lengths, unread = _strut_lengths(values)
    if unread:
        text = f"Not read from the file: {', '.join(unread)}. Enter what is a limit below."
        questions.append(Question("", text))
    return MachineDraft(
        name=name,
        source=source,
        base_joints=rows(base),
        platform_joints=rows(platform),
        home=None if home is None else (*rows(home[None])[0], 0.0, 0.0, 0.0),
        limits={"strut_length": [scale * one for one in lengths]} if lengths else {},
        questions=tuple(questions),
    )


def with_height(draft: MachineDraft, height: float) -> MachineDraft:
    """Return a draft with home at a height, m, that the list does not have.

    If it is about that of the platform's joints, they keep their place over the base.
    """
    home, joints = draft.home or (0.0,) * len(COORDINATE_NAMES), draft.platform_joints
    draft = replace(draft, home=(*home[:2], height, *home[3:]))
    if _AMID not in draft.questions or not isinstance(joints, tuple):
        return draft
    if abs(height - home[2]) >= _AS_HIGH * abs(home[2]):
        return draft
    others = (one for one in draft.questions if one != _AMID)
    return replace(
        draft,
        platform_joints=rows(np.array(joints) - [0.0, 0.0, height - home[2]]),
        questions=(*others, _in_base_frame(home[2], height)),
    )


_AMID = Question(
    "home", "The joints of the platform are given over the base: the TCP is put amid them."
)


def _in_base_frame(raised: float, height: float) -> Question:
    return Question(
        "platform_joints",
        f"The joints of the platform are {raised * 1e3:.6g} mm over those of the base, about the "
        f"stated height, {height * 1e3:.6g} mm: they are taken as given in the base frame. Are "
        "they?",
    )


def _in_unit(value: Any, scale: float) -> Any:
    """Return texts with a unit of length, also in lists, as numbers in a unit of `scale` m."""
    if isinstance(value, list):
        return [_in_unit(one, scale) for one in value]
    if not isinstance(value, str) or not re.search(r"\d\s*[^\W\d_]", value):
        return value
    try:
        return LENGTH.parse(value) / scale
    except PydanticCustomError:
        return value


def _strut_lengths(values: Mapping[str, Any]) -> tuple[list[float], list[str]]:
    """Return the shortest and longest length, nothing without them, and other limits' names."""
    numbers = {
        key: np.ravel(value).astype(float).tolist()
        for key, value in values.items()
        if _LIMIT.search(_words(key)) and np.asarray(value).dtype.kind in "iuf"
    }
    found = {
        kind: (key, one[0])
        for kind, pattern in _LENGTHS.items()
        for key, one in numbers.items()
        if len(one) == 1 and pattern.search(_words(key))
    }
    for key, one in numbers.items():
        if len(one) == 2 and _words(key) in ("strut length", "strut lengths"):  # noqa: PLR2004
            found = {"low": (key, one[0]), "high": (key, one[1])}
    ends = {kind: value for kind, (_, value) in found.items()}
    if "low" in ends and "stroke" in ends:
        ends.setdefault("high", ends["low"] + ends["stroke"])
    if "high" in ends and "stroke" in ends:
        ends.setdefault("low", ends["high"] - ends["stroke"])
    texts = [
        key
        for key, value in values.items()
        if isinstance(value, str) and _LIMIT.search(_words(key)) and re.search(r"\d", value)
    ]
    if not 0 < ends.get("low", 0) < ends.get("high", 0):
        return [], [*numbers, *texts]
    agree = abs(ends.get("stroke", 0) - (ends["high"] - ends["low"])) < _AGREE * ends["high"]
    read = {key for kind, (key, _) in found.items() if kind != "stroke" or agree}
    unread = [*(key for key in numbers if key not in read), *texts]
    return [ends["low"], ends["high"]], unread


_LIMIT = re.compile(r"stroke|length|speed|veloc|accel|force|mass")
_LENGTHS = {
    "low": re.compile(r"\b(min|minimum|shortest)\b.*\blength|\blength (min|minimum)\b"),
    "high": re.compile(r"\b(max|maximum|longest)\b.*\blength|\blength (max|maximum)\b"),
    "stroke": re.compile(r"\bstroke\b"),
}
_AGREE = 1e-6
"""Relative difference up to which a stroke is that between the lengths."""


def _options(names: list[str]) -> str:
    chosen = zip(("base", "platform"), names, strict=False)
    return " ".join(f"--{end}-joints {shlex.quote(name)}" for end, name in chosen)


def _by_letters(keys: list[str]) -> list[str] | None:
    """Return the names of base and platform that differ in a letter: A and B, or B and P."""
    words = sorted(map(_words, keys))
    if len(words) != 2 or words[0][1:] != words[1][1:]:  # noqa: PLR2004 - base and platform
        return None
    return sorted(keys, key=_words) if words[0][:1] + words[1][:1] in ("ab", "bp") else None


def _words(key: str) -> str:
    """Return a name in lower case, its words separated: ``basePoints`` → ``base points``."""
    return re.sub(r"[^a-z0-9]+", " ", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", key).lower())


def _six(value: Any) -> Array | None:
    """Return six finite points, (6, 3), in rows or columns; None for anything else.

    Homogeneous coordinates lose their fourth number, which is 1.
    """
    try:
        points = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        return None
    points = points.T if points.shape in ((3, ACTUATORS), (4, ACTUATORS)) else points
    if points.shape == (ACTUATORS, 4) and np.all(points[:, 3] == 1):
        points = points[:, :3]
    return points if points.shape == (ACTUATORS, 3) and np.all(np.isfinite(points)) else None


def _flat(value: Any, name: str = "", depth: int = 0) -> Iterator[tuple[str, Any]]:
    """Yield the values of nested mappings by dotted names; x, y, z of points become lists."""
    if isinstance(value, list) and value and all(isinstance(one, dict) for one in value):
        points = [[_coordinate(one, axis) for axis in "xyz"] for one in value]
        if all(number is not None for point in points for number in point):
            value = points
        else:  # a list of struts, each with the points of its ends
            keys = [key for key in value[0] if all(key in one for one in value)]
            value = {key: [one[key] for one in value] for key in keys}
    if isinstance(value, dict) and depth < _DEEPEST:
        if all(_coordinate(value, axis) is not None for axis in "xyz"):
            yield name, [_coordinate(value, axis) for axis in "xyz"]
            return
        for key, item in value.items():
            yield from _flat(item, f"{name}.{key}" if name else str(key), depth + 1)
    else:
        yield name, value


def _grouped(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values with the points of equal names but for their numbers as one list, by these."""
    found: dict[str, Any] = {}
    numbered: dict[str, list[tuple[list[int], Any]]] = {}
    for key, value in values.items():
        group = re.sub(r"[\s_.-]*\d+", "", key)
        if isinstance(value, list) and len(value) == 3 and group != key:  # noqa: PLR2004 - x, y, z
            numbered.setdefault(group, []).append(([*map(int, re.findall(r"\d{1,9}", key))], value))
        else:
            found[key] = value
    for group, points in numbered.items():
        found[group] = [value for _, value in sorted(points, key=lambda one: one[0])]
    return found


def _coordinate(point: Mapping[str, Any], axis: str) -> Any:
    found = point.get(axis, point.get(axis.upper()))
    return None if isinstance(found, dict) else found


def _table(text: str) -> dict[str, Any]:
    """Return the sets of points in a CSV table, by columns ``base_x`` … or by rows with a name."""
    lines = [line for line in text.splitlines() if line.strip()]
    form, (header, *table) = split_table(lines)
    if form.decimal != ".":
        table = [[cell.replace(form.decimal, ".") for cell in row] for row in table]
    header = [cell.strip() for cell in header]
    units = re.findall(r"[\[(]\s*(\w+)\s*[\])]", lines[0])
    names = [re.sub(r"\s*[\[(].*", "", cell) for cell in header]
    columns = {name: [row[k].strip() for row in table] for k, name in enumerate(names)}
    found: dict[str, Any] = {"unit": units[0]} if units else {}
    axes = {_words(name): name for name in names}
    by_joint = {"x", "y", "z"} <= set(axes)
    for name in names:
        match = re.fullmatch(r"(.*?)[\s_.]*([xyzXYZ])", name)
        if match is None and len(set(columns[name])) == 1:
            found[name] = _value(columns[name][0])
        elif match is not None and not by_joint:
            found.setdefault(match[1], {})[match[2].lower()] = columns[name]
    if by_joint:
        labels = next(iter(columns.values()))
        points = zip(*(columns[axes[axis]] for axis in "xyz"), strict=True)
        for label, one in zip(labels, points, strict=True):
            given = [cell for cell in one if cell]
            found[label] = _value(given[0]) if len(given) == 1 else list(one)
    return {key: list(one.values()) if isinstance(one, dict) else one for key, one in found.items()}


def _value(cell: str) -> float | str:
    """Return the number, or the text with its unit, of a row or column with one value."""
    try:
        return float(cell)
    except ValueError:
        return cell


def _values(file: Path) -> dict[str, Any]:
    return _grouped(_ungrouped(file))


def _ungrouped(file: Path) -> dict[str, Any]:
    suffix = file.suffix.lower()
    if suffix in (".yaml", ".yml"):
        return dict(_flat(read_yaml(file).data))
    text = read_text(file, "text in UTF-8")
    if suffix == ".csv":
        try:
            return _table(text)
        except (IndexError, ValueError, csv.Error) as error:
            raise InputError(f"not a table: {error}", file, allowed=_ALLOWED) from None
    try:
        return dict(_flat(json.loads(text)))
    except (ValueError, RecursionError) as error:
        raise InputError(f"not valid JSON: {error}", file) from None


def _read(name: str, files: tuple[Path, ...]) -> MachineDraft:
    return draft_of_points(name, f"list of joints, {files[0].name}", _values(files[0]), files[0])


def _claims(path: Path) -> bool:
    # PI's YAML has its own reader.
    return not any(re.search(r"\baxis_\d\.", key) for key in _ungrouped(path))


FORMAT = MachineFormat(
    "a list of joints", (".json", ".csv", ".yaml", ".yml"), _read, _claims, points=_values
)
