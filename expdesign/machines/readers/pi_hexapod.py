"""PI's description of a hexapod in YAML, as its ROS driver has one for the H-811.

Metres and radians. Base anchors are given in the frame of the zero pose, platform anchors in the
platform frame, and the orientation is R = Rx(u) Ry(v) Rz(w): the angles of the pose. Source:
PI_ROS_Driver, pi_hexapod_description and pi_hexapod_control.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from constraints.arrays import Array
from expdesign.configuration.document import Document, read_yaml
from expdesign.configuration.errors import InputError, Key, Problem, quote
from expdesign.machines.machine import MachineDraft, MachineFormat, Question, rows
from expdesign.mechanism.hexapod import ACTUATORS

_TRANSLATIONS = {"x": "x", "y": "y", "z": "z"}
_ROTATIONS = {"u": "phi", "v": "theta", "w": "psi"}
_NUMBER = "a number, in metres and radians"


def _read(name: str, files: tuple[Path, ...]) -> MachineDraft:
    description = _Description(read_yaml(files[0]))
    base, platform = description.anchors("base_anchor"), description.anchors("platform_anchor")
    limits: dict[str, Any] = {}
    for key, axes in (("position", _TRANSLATIONS), ("rotation", _ROTATIONS)):
        if ranges := description.ranges(axes):
            limits[key] = ranges
    if description.problems:
        raise InputError(description.problems)
    questions = [
        Question(
            "limits.strut_length",
            "PI's file limits the pose and not the struts: how short and how long can they be?",
        )
    ]
    per_axis = {
        "vel_max_xyz": ("limits.strut_speed", "m/s along the axes"),
        "vel_max_uvw": ("limits.strut_speed", "rad/s about the axes"),
        "effort_limit": ("limits.actuator_force", "for the axes of the platform"),
    }
    for key, (place, words) in per_axis.items():
        value = description.document.data.get(key)
        if value is not None:
            text = f"PI's file has {key} = {quote(value)}, {words}: what can one strut do?"
            questions.append(Question(place, text))
    return MachineDraft(
        name=name,
        source=f"PI hexapod, {files[0].name}",
        base_joints=rows(base),
        platform_joints=rows(platform),
        home=(0.0,) * ACTUATORS,
        limits=limits,
        questions=tuple(questions),
    )


class _Description:
    """The file, and its faults."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.problems: list[Problem] = []

    def anchors(self, kind: str) -> Array:
        """Return the joints of one end of the struts, (6, 3), m."""
        return np.array(
            [
                [self.number((f"axis_{j}", kind, letter)) for letter in "xyz"]
                for j in range(ACTUATORS)
            ]
        )

    def ranges(self, axes: dict[str, str]) -> dict[str, tuple[float, float]]:
        """Return the ranges of axes by the names that the pose's components have."""
        found = {}
        for axis, component in axes.items():
            if axis not in self.document.data:
                continue
            low, high = (self.number((axis, f"{end}_limit")) for end in ("lower", "upper"))
            if low >= high:
                self.report((axis,), "lower_limit is not below upper_limit", "a range")
            found[component] = (low, high)
        return found

    def number(self, key: Key) -> float:
        """Return a number; anything else is a problem, and NaN."""
        value: Any = self.document.data
        for depth, part in enumerate(key):
            if not isinstance(value, dict) or part not in value:
                self.report(key[: depth + 1], "the key is missing", _NUMBER)
                return math.nan
            value = value[part]
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not math.isfinite(value):
            self.report(key, f"{quote(value)} is no number", _NUMBER)
            return math.nan
        return float(value)

    def report(self, key: Key, message: str, allowed: str) -> None:
        """Collect a problem; the same one is reported once."""
        problem = self.document.problem(key, message, allowed)
        if problem not in self.problems:
            self.problems.append(problem)


def _claims(path: Path) -> bool:
    data = read_yaml(path).data
    return any(
        isinstance(axis := data.get(f"axis_{j}"), dict)
        and ("base_anchor" in axis or "platform_anchor" in axis)
        for j in range(ACTUATORS)
    )


FORMAT = MachineFormat("PI's hexapod description", (".yaml", ".yml"), _claims, _read)
