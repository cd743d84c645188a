"""Description of a machine before it has a robot file, and the formats that it is read from."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from constraints.arrays import Array
from expdesign.configuration.bodies import Bodies
from expdesign.configuration.geometry import JointRing
from expdesign.configuration.parameters import Drive
from expdesign.configuration.quantity import quantity_in

Points = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Question:
    """A value that the user has to look up or to confirm."""

    key: str
    """Key below the question in the robot file: ``home``, ``limits.strut_length``; empty for a
    question about the machine as a whole."""
    text: str
    """A sentence."""


@dataclass(frozen=True)
class MachineDraft:
    """A partly known hexapod, SI units and radians; None or a missing entry: unknown."""

    name: str
    """Name of the robot and of both files."""
    source: str = ""
    """Origin of the numbers, for the robot file's `description`."""
    base_joints: JointRing | Points | None = None
    """(6, 3), base frame, m."""
    platform_joints: JointRing | Points | None = None
    """(6, 3), platform frame, m."""
    home: tuple[float, ...] | None = None
    """(6,): x, y, z [m], phi, theta, psi [rad]."""
    gravity: tuple[float, ...] | None = None
    """(3,), base frame, m/s²."""
    alpha_axes: Points | None = None
    """(6, 3), first cardan axes, base frame."""
    platform_joint_axes: Points | None = None
    """(6, 3), platform frame."""
    limits: Mapping[str, Any] = field(default_factory=dict)
    """By key, as under `limits:` of a robot file: a number, a pair, six of these, or a mapping of
    components."""
    moved_mass: float | None = None
    """Mass of the platform with everything on it, without the struts, kg."""
    bodies: Bodies | None = None
    """The known bodies."""
    parameters: Mapping[str, float] = field(default_factory=dict)
    """Known nominal values by name; they override those of the bodies."""
    platform_cardan_axes: Points | None = None
    """(6, 3), platform frame, of joints that turn the screws."""
    drive: Drive | None = None
    force_std: tuple[float, ...] | None = None
    """(6,), of one sample, N."""
    length_std: tuple[float, ...] | None = None
    """(6,), of one sample, m."""
    tolerances: Mapping[str, Any] = field(default_factory=dict)
    """By key, as under `tolerances:` of a robot file."""
    table: str = "csv"
    """Controller table that the run file proposes: a format, or its options as a YAML mapping."""
    questions: tuple[Question, ...] = ()
    """Questions of the reader; those about unknown values are added when the file is written."""


_DECIMALS = 12


@dataclass(frozen=True)
class MachineFormat:
    """A file format of machine descriptions, declared in :mod:`expdesign.machines.readers`."""

    title: str
    """For messages and the documentation."""
    extensions: tuple[str, ...]
    """Lower case, with the dot."""
    read: Callable[[str, tuple[Path, ...]], MachineDraft]
    """``read(name, files)``: the machine under the name of the future robot. Raises `InputError`
    for files that cannot be used."""
    claims: Callable[[Path], bool] = lambda _path: True
    """``claims(path)``: True for an existing file in this format with one of its extensions.
    Formats that share an extension do not claim an unreadable file."""
    most_files: int = 1
    """Largest number of files that describe one machine together."""
    points: Callable[[Path], Mapping[str, Any]] | None = None
    """``points(file)``: its values by name, among which users may choose the sets of six joints.
    None: a format that states them otherwise."""


def rows(points: Array) -> Points:
    """Return points (n, 3), m, as tuples, rounded to 1e-12 m: unit conversions leave less."""
    return tuple(tuple(float(v) + 0.0 for v in row) for row in np.round(points, _DECIMALS))


_WRITTEN_IN = {"m": ("mm", 1e3), "m/s": ("mm/s", 1e3), "rad": ("deg", math.degrees(1.0))}
_DIGITS = (6, 9, 12, 15, 17)


def format_quantity(value: float, unit: str) -> str:
    """Return an SI value as YAML text that loads to the same number.

    >>> format_quantity(0.15, "m"), format_quantity(0.0517, "1")
    ('150 mm', '0.0517')
    """
    number = float(value)
    if not math.isfinite(number):
        return str(number)  # refused by the file's own check, with the key
    if number == 0 or unit == "1":
        return f"{number:g}" if number == 0 else _shortest(number)
    dimension = quantity_in(unit)
    symbol, factor = _WRITTEN_IN.get(unit, (unit, 1.0))
    for digits in _DIGITS:
        text = f"{number * factor:.{digits}g} {symbol}"
        if dimension.parse(text) == number:
            return text
    return _shortest(number)


def _shortest(number: float) -> str:
    """Return all digits of a number; YAML needs a point before an exponent."""
    text = repr(number)
    if "e" in text and "." not in text:
        return text.replace("e", ".0e")
    return text.removesuffix(".0")


def round_digits(value: float, digits: int = 12) -> float:
    """Round a number to significant digits; the default removes rounding errors.

    >>> round_digits(0.1 + 0.2)
    0.3
    """
    return float(f"{value:.{digits}g}")


def format_flow(value: Any, unit: str | Mapping[str, str]) -> str:
    """Format numbers, or lists and mappings of them, as one line of YAML.

    `unit` is that of all numbers, or those by key, 1 for other keys.

    >>> format_flow([0.1, 0.2], "m"), format_flow({"mass": 2.0, "ratio": 3.0}, {"mass": "kg"})
    ('[100 mm, 200 mm]', '{mass: 2 kg, ratio: 3}')
    """
    if isinstance(value, Mapping):
        units = {key: unit if isinstance(unit, str) else unit.get(key, "1") for key in value}
        entries = (f"{key}: {format_flow(item, units[key])}" for key, item in value.items())
        return f"{{{', '.join(entries)}}}"
    one = unit if isinstance(unit, str) else "1"
    if isinstance(value, list | tuple):
        return f"[{', '.join(format_flow(item, one) for item in value)}]"
    return value if isinstance(value, str) else format_quantity(value, one)
