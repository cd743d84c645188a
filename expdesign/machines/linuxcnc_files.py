"""Values in LinuxCNC's INI and HAL files with their file and line, and genhexkins' defaults."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from constraints.arrays import Array
from expdesign.configuration.errors import InputError, quote
from expdesign.configuration.geometry import StrutGeometry
from expdesign.configuration.parameters import Thread

_SECTION = re.compile(r"\[(\w+)\]\s*(?:[#;].*)?")
_ASSIGNED = re.compile(r"(\w+)\s*=\s*(.*)")
_REFERENCE = re.compile(r"\[(\w+)\]\(?(\w+)\)?")
_SET = re.compile(r"(?:setp\s+)?([\w.\-]+)(?:\s*=\s*|\s+)(\S+)")


@dataclass(frozen=True)
class Entry:
    """A value as it is written."""

    value: str
    file: Path
    line: int
    key: str
    """As the user reads it: ``[TRAJ]HOME``, ``genhexkins.base.0.x``."""

    def refusal(self, message: str, allowed: str) -> InputError:
        """Return the error that says what is wrong with the value."""
        return InputError(message, self.file, self.line, self.key, allowed)

    def number(self, word: str | None = None) -> float:
        """Return the first word of the value, or another one, as a finite number.

        What follows in the line may be a comment.
        """
        words = (self.value if word is None else word).split()
        try:
            number = float(words[0]) if words else math.nan
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise self.refusal(f"{quote(self.value)} is no number", "a number with a point")
        return number


@dataclass(frozen=True)
class IniFile:
    """An INI file of LinuxCNC: every entry of every section, in the order of the lines."""

    file: Path
    sections: Mapping[str, Mapping[str, tuple[Entry, ...]]]

    def entries(self, section: str, key: str) -> tuple[Entry, ...]:
        """Return all entries of a key."""
        return self.sections.get(section, {}).get(key, ())

    def entry(self, section: str, key: str) -> Entry | None:
        """Return the entry that counts, the first; None for a key that is missing."""
        return next(iter(self.entries(section, key)), None)


@dataclass(frozen=True)
class Pins:
    """Pins of a component that HAL files set, by name without the component's prefix."""

    values: Mapping[str, Entry]
    linked: frozenset[str] = field(default_factory=frozenset)
    """Pins that follow a signal."""

    def number(self, pin: str) -> float | None:
        """Return what a pin is set to; None where no line sets it."""
        return self.values[pin].number() if pin in self.values else None

    def joined(self, later: Pins) -> Pins:
        """Return these and those of a later file, which count where both set a pin."""
        return Pins({**self.values, **later.values}, self.linked | later.linked)


def read_ini(file: Path, text: str) -> IniFile:
    """Return the entries of an INI file; refuse a line that is none."""
    sections: dict[str, dict[str, tuple[Entry, ...]]] = {}
    section: dict[str, tuple[Entry, ...]] | None = None
    name = ""
    for number, line in _lines(text):
        if line.upper().startswith("#INCLUDE"):
            message = "a file that is included is not followed"
            raise InputError(message, file, number, allowed="all sections in one INI file")
        if line[:1] in "#;":
            continue
        if found := _SECTION.fullmatch(line):
            name = found[1]
            section = sections.setdefault(name, {})
        elif (found := _ASSIGNED.fullmatch(line)) and section is not None:
            entry = Entry(found[2].strip(), file, number, f"[{name}]{found[1]}")
            section[found[1]] = (*section.get(found[1], ()), entry)
        else:
            allowed = "[SECTION], KEY = VALUE, or a comment after # or ;"
            raise InputError(f"{quote(line)} is no line of an INI file", file, number, "", allowed)
    return IniFile(file, sections)


def read_hal(file: Path, text: str, component: str, ini: IniFile) -> Pins:
    """Return what a HAL file sets of the pins whose names begin with `component`.

    A value such as ``[TRAJ]LEAD`` is looked up in the INI file.
    """
    values: dict[str, Entry] = {}
    linked: set[str] = set()
    for number, line in _lines(text):
        words = line.partition("#")[0].strip()
        if words.startswith(("net ", "linkps ", "linksp ")):
            pins = [word for word in words.split() if word.startswith(component)]
            linked.update(pin.removeprefix(component) for pin in pins)
            continue
        pin = words.removeprefix("setp").split("=")[0].split()
        if not pin or not pin[0].startswith(component):
            continue
        found = _SET.fullmatch(words)
        key = pin[0]
        if found is None:
            message = f"{quote(words)} sets no pin"
            raise InputError(message, file, number, key, f"setp {key} NUMBER")
        entry = Entry(found[2], file, number, key)
        values[key.removeprefix(component)] = _looked_up(entry, ini)
    return Pins(values, frozenset(linked))


def _looked_up(entry: Entry, ini: IniFile) -> Entry:
    if (found := _REFERENCE.fullmatch(entry.value)) is None:
        return entry
    referred = ini.entry(found[1], found[2])
    if referred is None:
        raise entry.refusal(f"{ini.file.name} has no {entry.value}", "a key of the INI file")
    return referred


def _lines(text: str) -> list[tuple[int, str]]:
    """Return the lines that are not empty with their numbers; a backslash joins two."""
    lines: list[tuple[int, str]] = []
    open_line: tuple[int, str] | None = None
    for number, line in enumerate(text.splitlines(), 1):
        start, before = open_line or (number, "")
        whole = before + line
        open_line = (start, whole[:-1] + " ") if whole.endswith("\\") else None
        if open_line is None and whole.strip():
            lines.append((start, whole.strip()))
    if open_line is not None:
        lines.append((open_line[0], open_line[1].strip()))
    return lines


BUILT_IN_JOINTS: dict[str, tuple[tuple[float, float], ...]] = {
    "base": (
        (-22.95, 13.25),
        (22.95, 13.25),
        (22.95, 13.25),
        (0, -26.5),
        (0, -26.5),
        (-22.95, 13.25),
    ),
    "platform": (
        (-1, 11.5),
        (1, 11.5),
        (10.459, -4.884),
        (9.459, -6.616),
        (-9.459, -6.616),
        (-10.459, -4.884),
    ),
}
"""x and y of the joints that genhexkins has where no line sets them; z is zero. Machine units."""
BUILT_IN_AXES: dict[str, tuple[tuple[float, float, float], ...]] = {
    "base-n": (
        (0.707107, 0, 0.707107),
        (0, -0.707107, 0.707107),
        (-0.707107, 0, 0.707107),
        (-0.707107, 0, 0.707107),
        (0, 0.707107, 0.707107),
        (0.707107, 0, 0.707107),
    ),
    "platform-n": (
        (-1, 0, 0),
        (0.866025, 0.5, 0),
        (0.866025, 0.5, 0),
        (0.866025, -0.5, 0),
        (0.866025, -0.5, 0),
        (-1, 0, 0),
    ),
}
"""The axes of its joints, likewise."""


def hand(lead: float, base_axes: Array, platform_axes: Array, home: StrutGeometry) -> Thread | None:
    """Return the hand of the thread that it computes with, None where that is not the same for all.

    With axes of base and platform against each other a lead above zero is a right-handed thread,
    with both alike a left-handed one.

    Parameters
    ----------
    lead : float
        ``screw-lead``.
    base_axes, platform_axes : (6, 3)
        ``base-n``, ``platform-n``: base frame, platform frame.
    home : StrutGeometry
        Of the pose at which the axes are compared.
    """
    lower = np.cross(base_axes, home.directions)
    upper = np.cross(platform_axes @ home.rotation.T, home.directions)
    alike = np.sum(lower * upper, axis=1) * lead
    if np.all(alike < 0):
        return "right"
    return "left" if np.all(alike > 0) else None
