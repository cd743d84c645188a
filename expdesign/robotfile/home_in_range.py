"""Ranges that a file states and its own home pose is not in: they are asked about, not written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from expdesign.configuration.geometry import geometry_at
from expdesign.mechanism.hexapod import COORDINATE_NAMES
from expdesign.robotfile.assumed import points
from expdesign.robotfile.machine import Machine, Question

_BESIDE = 1e-4
"""So much of a length beside its range is what a file's own digits leave."""


def without_contradictions(machine: Machine) -> Machine:
    """Return a machine whose home keeps the ranges that are known of struts and platform."""
    if machine.home is None or machine.base_joints is None or machine.platform_joints is None:
        return machine
    limits, questions = dict(machine.limits), list(machine.questions)
    if "strut_length" in limits:
        lengths = geometry_at(
            np.array(machine.home), points(machine.base_joints), points(machine.platform_joints)
        ).lengths
        _check_lengths(limits, lengths.tolist(), questions)
    home = dict(zip(COORDINATE_NAMES, machine.home, strict=True))
    for key in ("position", "rotation"):
        if isinstance(ranges := limits.get(key), Mapping):
            outside = [n for n, (low, high) in ranges.items() if not low <= home[n] <= high]
            limits[key] = {n: pair for n, pair in ranges.items() if n not in outside}
            if not limits[key]:
                del limits[key]
            for name in outside:
                low, high = ranges[name]
                text = (
                    f"The file has {name} from {low:.6g} to {high:.6g}, and {home[name]:.6g} at "
                    "home [m, rad]: which range is it?"
                )
                questions.append(Question(f"limits.{key}", text))
    return replace(machine, limits=limits, questions=tuple(questions))


def _check_lengths(limits: dict[str, Any], home: list[float], questions: list[Question]) -> None:
    given = limits["strut_length"]
    pairs = [given] * len(home) if np.ndim(given) == 1 else list(given)
    if all(low <= length <= high for (low, high), length in zip(pairs, home, strict=True)):
        return
    widened = []
    for j, ((low, high), length) in enumerate(zip(pairs, home, strict=True), 1):
        if not low - _BESIDE * length <= length <= high + _BESIDE * length:
            text = (
                f"The file's range of strut {j} is {low * 1e3:.6g} to {high * 1e3:.6g} mm, its "
                f"length at home is {length * 1e3:.6g} mm: from where to where are the lengths "
                "counted?"
            )
            questions.append(Question("limits.strut_length", text))
            del limits["strut_length"]
            return
        widened.append((min(low, length), max(high, length)))
    limits["strut_length"] = tuple(widened)
