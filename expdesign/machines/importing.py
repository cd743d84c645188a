"""Import of machine descriptions from the files of other programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from constraints.plugins import declarations
from expdesign.configuration.errors import InputError
from expdesign.configuration.geometry import geometry_at
from expdesign.machines import readers
from expdesign.machines.assumed import points
from expdesign.machines.machine import MachineDraft, MachineFormat, Question
from expdesign.mechanism.hexapod import COORDINATE_NAMES

_FARTHEST = 1000.0
"""Largest distance of a joint or of home from the origin of its frame, m."""


@cache
def machine_formats() -> tuple[MachineFormat, ...]:
    """Return every format; a new one is one file in `expdesign.machines.readers`, or a plug-in."""
    return declarations(MachineFormat, readers, "FORMAT")


def read_machine(name: str, files: Sequence[Path]) -> MachineDraft:
    """Read one machine from files, SI units; missing values become questions.

    Parameters
    ----------
    name : str
        Name of the robot.
    files : sequence of Path
        All of one format; LinuxCNC's INI and HAL files belong together.

    Raises
    ------
    InputError
        A file is missing, of no known format, damaged, or describes no hexapod with struts whose
        lengths change.
    """
    if not files:
        raise InputError("no file is named", allowed="the files that describe the machine")
    found = [_format_of(path) for path in files]
    first = found[0]
    for path, each in zip(files, found, strict=True):
        if each is not first:
            message = f"this is {each.title}, {files[0]} is {first.title}"
            raise InputError(message, path, allowed="files of one format")
    if len(files) > first.most_files:
        message = f"one machine is described by at most {first.most_files} file of {first.title}"
        raise InputError(message, files[first.most_files])
    machine = drop_contradicting_ranges(first.read(name, tuple(files)))
    for key in ("base_joints", "platform_joints", "home"):
        value = getattr(machine, key)
        farthest = float(np.max(np.abs(value))) if isinstance(value, tuple) else 0.0
        if farthest > _FARTHEST:
            message = f"{farthest:.3g} m away: a length is damaged, or in another unit"
            raise InputError(message, files[0], key=key, allowed=f"{_FARTHEST:g} m at most")
    return machine


def _format_of(path: Path) -> MachineFormat:
    if not path.exists():
        raise InputError("there is no such file", path)
    if path.is_dir():
        raise InputError("this is a folder, not a file", path)
    suffix = path.suffix.lower()
    candidates = [each for each in machine_formats() if suffix in each.extensions]
    for each in candidates:
        if each.claims(path):
            return each
    if candidates:
        titles = " or ".join(each.title for each in candidates)
        raise InputError("the file's content is not known", path, allowed=titles)
    known = ", ".join(f"{each.title} ({', '.join(each.extensions)})" for each in machine_formats())
    raise InputError(f"'{path.suffix}' is no known extension", path, allowed=known)


_ROUNDING = 1e-4
"""Relative excess over a range that the rounding of a file explains."""


def drop_contradicting_ranges(machine: MachineDraft) -> MachineDraft:
    """Replace ranges that the machine's own home pose violates by questions."""
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
        if not low - _ROUNDING * length <= length <= high + _ROUNDING * length:
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
