"""The trajectory in a `design.json`, whoever wrote it."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from expdesign.configuration import InputError, Problem, shown
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.trajectory.fourier import FourierTrajectory

NAME = "design.json"
LARGEST_FILE = 64 * 1024 * 1024
"""Bytes; a design of a hundred harmonics with the record of its search is far smaller."""

_MOST_SHOWN = 5
_KEYS = {
    "harmonics": "a whole number n ≥ 1",
    "omega": "a number above 0, rad/s",
    "lambda0": "6 numbers: m, rad",
    "mu": "6 lists of n numbers: m/s, rad/s",
    "nu": "6 lists of n numbers: m/s, rad/s",
}


@dataclass(frozen=True)
class DesignFile:
    """What other stages use of a `design.json`.

    Attributes
    ----------
    path : Path
    trajectory : FourierTrajectory
    robot : str or None
        Name of the robot that it was designed for, when the file states it.
    status : str or None
        How the design ended, when the file states it.
    """

    path: Path
    trajectory: FourierTrajectory
    robot: str | None = None
    status: str | None = None


def read_design_file(source: str | PathLike[str]) -> DesignFile:
    """Read the trajectory of a design.

    Parameters
    ----------
    source : path
        A `design.json`, or a folder that has one. Only the keys `harmonics`, `omega`, `lambda0`,
        `mu` and `nu` are needed; what else stands there is left alone.

    Raises
    ------
    InputError
        There is no such file, it is no JSON, or a key is missing or not what it should be; every
        problem with file and key.
    """
    path = _found(Path(source))
    data = _parsed(path)
    problems = list(_problems(path, data))
    if problems:
        raise InputError(problems)
    trajectory = FourierTrajectory(
        float(data["omega"]), *(np.array(data[key], float) for key in ("lambda0", "mu", "nu"))
    )
    robot, status = (
        data[key] if isinstance(data.get(key), str) else None for key in ("robot", "status")
    )
    return DesignFile(path, trajectory, robot, status)


def _found(source: Path) -> Path:
    path = source / NAME if source.is_dir() else source
    if not path.exists():
        where = "the folder has none" if source.is_dir() else "there is no such file or folder"
        raise InputError(
            Problem(where, path, allowed=f"a {NAME}, or a folder that `expdesign design` wrote")
        )
    return path


def _parsed(path: Path) -> dict[str, Any]:
    allowed = f"a {NAME}: JSON with the keys {', '.join(_KEYS)}"
    try:
        with path.open("rb") as stream:
            raw = stream.read(LARGEST_FILE + 1)
    except OSError as error:
        raise InputError(
            Problem(f"cannot be read: {error.strerror or error}", path, allowed=allowed)
        ) from error
    if len(raw) > LARGEST_FILE:
        raise InputError(
            Problem(f"larger than {LARGEST_FILE // 1024**2} MiB", path, allowed=allowed)
        )
    try:
        data = json.loads(raw.decode("utf-8"))
    except json.JSONDecodeError as error:
        problem = Problem(f"not JSON: {error.msg}", path, error.lineno, allowed=allowed)
        raise InputError(problem) from error
    except (ValueError, RecursionError) as error:
        # Not UTF-8, a number of very many digits, or brackets without end.
        raise InputError(Problem("not JSON that can be read", path, allowed=allowed)) from (error)
    if not isinstance(data, dict):
        raise InputError(Problem(f"holds {shown(data)}", path, 1, allowed=allowed))
    return data


def _problems(path: Path, data: dict[str, Any]) -> Iterator[Problem]:
    for key, allowed in _KEYS.items():
        if key not in data:
            yield Problem(f"the key '{key}' is missing", path, key=key, allowed=allowed)
    harmonics = data.get("harmonics")
    known = isinstance(harmonics, int) and not isinstance(harmonics, bool) and harmonics >= 1
    if "harmonics" in data and not known:
        yield Problem(
            f"{shown(harmonics)} is no number of harmonics",
            path,
            key="harmonics",
            allowed=_KEYS["harmonics"],
        )
    if "omega" in data:
        omega = data["omega"]
        if not _is_number(omega) or omega <= 0:
            yield Problem(
                f"{shown(omega)} is no frequency", path, key="omega", allowed=_KEYS["omega"]
            )
    if "lambda0" in data:
        yield from _wrong_numbers(path, "lambda0", data["lambda0"], (COORDINATES,))
    for key in ("mu", "nu"):
        if key in data and isinstance(harmonics, int) and known:
            yield from _wrong_numbers(path, key, data[key], (COORDINATES, harmonics))


def _wrong_numbers(
    path: Path, key: str, value: object, shape: tuple[int, ...]
) -> Iterator[Problem]:
    """Yield the first things that keep a value from being numbers in lists of this shape."""
    for place, message in islice(_faults(key, value, shape), _MOST_SHOWN):
        yield Problem(message, path, key=place, allowed=_KEYS[key])


def _faults(place: str, value: object, shape: tuple[int, ...]) -> Iterator[tuple[str, str]]:
    if not shape:
        if not _is_number(value):
            yield place, f"{shown(value)} is no finite number"
        return
    if not isinstance(value, list):
        yield place, f"{shown(value)} is not a list of {shape[0]}"
    elif len(value) != shape[0]:
        yield place, f"there are {len(value)} entries where {shape[0]} are needed"
    else:
        for number, entry in enumerate(value, start=1):
            yield from _faults(f"{place}[{number}]", entry, shape[1:])


def _is_number(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, Real):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False
