"""LinuxCNC's configuration of a hexapod: the INI file, and ``setp`` lines of genhexkins in HAL.

Source: LinuxCNC, genhexkins(9) and INI configuration.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from constraints.arrays import Array
from expdesign.configuration.document import read_text
from expdesign.configuration.errors import InputError, quote
from expdesign.configuration.geometry import geometry_at
from expdesign.configuration.parameters import Drive, Screw
from expdesign.configuration.plausibility import FASTEST
from expdesign.machines import genhexkins
from expdesign.machines.machine import (
    MachineDraft,
    MachineFormat,
    Question,
    format_flow,
    format_quantity,
    rows,
)
from expdesign.machines.writing import INERTIA
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.strut import ANGLES, FIXED_AXES

_KINEMATICS = "genhexkins"
_PREFIX = f"{_KINEMATICS}."
_MOST_FILES = 20
_MM = 1e-3
_UNITS = {"mm": _MM, "metric": _MM, "in": 0.0254, "inch": 0.0254, "imperial": 0.0254}
_DEGREES = ("degree", "deg")
_KEYS = {"base-n": "alpha_axes", "platform-n": "platform_cardan_axes"}
_RANGE = ("MIN_LIMIT", "MAX_LIMIT")
_HALF_TURN = 180.0
"""Degrees."""
_POSES, _MOVED, _TURNED, _EXACT = 200, 0.3, math.radians(15), 1e-6
"""Poses about home, their distances as a share of the platform's radius and in rad, and m."""
_SMALLER = 50.0
"""A platform or base that is smaller by this factor is doubted."""
_FAR = 5.0
"""A limit that is beyond so many times the machine's size limits nothing."""
_JOINTS = [f"JOINT_{j}" for j in range(ACTUATORS)]
_RATES = {"MAX_VELOCITY": "strut_speed", "MAX_ACCELERATION": "strut_acceleration"}
_HIGHEST = {"strut_speed": (FASTEST, "m/s"), "strut_acceleration": (1e4, "m/s^2")}
"""A higher limit is a placeholder."""
_HOMED = 1e-3
"""Relative difference of a joint's HOME from the length at the home pose that is rounding."""


def _read(name: str, files: tuple[Path, ...]) -> MachineDraft:
    inis = [path for path in files if path.suffix.lower() == ".ini"]
    if len(inis) != 1:
        message = "LinuxCNC's INI file is needed: it says the units"
        if inis:
            message = "two INI files are two machines"
        raise InputError(message, files[0] if not inis else inis[1], allowed="one INI file")
    ini = read_ini(inis[0])
    kinematics = ini.entry("KINS", "KINEMATICS")
    if kinematics is not None and kinematics.value.split()[:1] != [_KINEMATICS]:
        raise kinematics.refusal("these kinematics are not read", _KINEMATICS)
    given = [path for path in files if path not in inis]
    found, missing = _hal_files(ini, given)
    named = given or found
    pins = _Pins(ini)
    for path in named:
        pins.read(path)
    # LinuxCNC executes these lines after the files.
    for entry in ini.entries("HAL", "HALCMD"):
        pins.execute(entry.file, [(entry.line, entry.value)])
    if not pins.values and kinematics is None:
        message = f"neither '{_KINEMATICS}' in [KINS]KINEMATICS nor a line 'setp {_KINEMATICS}.…'"
        raise InputError(message, ini.file, allowed="the configuration of a hexapod")
    return _Hexapod(ini, pins, missing).machine(name, (*inis, *named))


def _hal_files(ini: IniFile, given: Sequence[Path]) -> tuple[list[Path], list[Question]]:
    """Return the HAL files that LinuxCNC executes, and questions about those that are not read.

    Files of LinuxCNC's own library (``LIB:``) set no pins of the kinematics.
    """
    paths, questions = [], []
    known = {path.name for path in given}
    for key in ("HALFILE", "POSTGUI_HALFILE"):
        for entry in ini.entries("HAL", key):
            name = entry.value.split()[0] if entry.value.split() else ""
            path = ini.file.parent / name
            if name.startswith("LIB:") or path.name in known:
                continue
            if path.suffix == ".tcl" and path.is_file():
                if _PREFIX in read_text(path, "LinuxCNC's Tcl file"):
                    message = f"{name} names pins of {_KINEMATICS}: Tcl is not executed here"
                    raise entry.refusal(message, "setp lines in a HAL file")
            elif path.is_file() and not given:
                paths.append(path)
            else:
                text = f"{entry.key} = {name} is not read: does it set pins of {_KINEMATICS}?"
                questions.append(Question("", text))
    return paths, questions


Metres = Callable[[float], float]


class _Hexapod:
    """Machine by the INI and HAL files together."""

    def __init__(self, ini: IniFile, pins: _Pins, questions: Sequence[Question] = ()) -> None:
        self.ini, self.pins = ini, pins
        self.unit = self._unit()
        self.questions = list(questions)

    def machine(self, name: str, files: tuple[Path, ...]) -> MachineDraft:
        base, platform = self._joints("base"), self._joints("platform")
        self._doubt_sizes(base, platform)
        home = self._home()
        size = float(
            max(np.linalg.norm(base, axis=1).max(), np.linalg.norm(platform, axis=1).max())
        )
        if home is not None:
            size = max(size, float(np.linalg.norm(home[:3])))
            self._compare_homes(base, platform, home)
        limits, unknown = strut_limits(self.ini, _JOINTS, _RATES, self._metres, size)
        self.questions += unknown
        self._add_position(limits, size)
        drive, axes, turning = self._drive(base, platform, home)
        names = ", ".join(path.name for path in files)
        return MachineDraft(
            name=name,
            source=f"LinuxCNC, {_KINEMATICS}: {names}",
            base_joints=rows(base),
            platform_joints=rows(platform),
            home=home,
            alpha_axes=None if axes is None else rows(axes),
            platform_cardan_axes=None if turning is None else rows(turning),
            limits=limits,
            drive=drive,
            table=self._table(),
            questions=tuple(self.questions),
        )

    def _table(self) -> str:
        """Return the options of G-code that are limits of the planner in the INI file."""
        options = {}
        if (period := self.ini.entry("EMCMOT", "SERVO_PERIOD")) is not None:
            options["servo_period"] = format_quantity(1e-9 * period.number(), "s")
        metre, radian = self.unit, math.radians(1.0)
        for name, letters, key, unit, factor in (
            ("linear_speed", "XYZ", "MAX_VELOCITY", "m/s", metre),
            ("angular_speed", "ABC", "MAX_VELOCITY", "rad/s", radian),
            ("linear_acceleration", "XYZ", "MAX_ACCELERATION", "m/s^2", metre),
            ("angular_acceleration", "ABC", "MAX_ACCELERATION", "rad/s^2", radian),
        ):
            entries = [self.ini.entry(f"AXIS_{letter}", key) for letter in letters]
            values = [factor * entry.number() for entry in entries if entry is not None]
            if len(values) == len(letters):
                options[name] = format_flow(values, unit)
        if (speed := self.ini.entry("TRAJ", "MAX_LINEAR_VELOCITY")) is not None:
            options["path_speed"] = format_quantity(metre * speed.number(), "m/s")
        named = "".join(f", {key}: {value}" for key, value in options.items())
        return f"{{format: linuxcnc-gcode{named}}}"

    def ask(self, key: str, text: str) -> None:
        self.questions.append(Question(key, text))

    def _unit(self) -> float:
        entry = self.ini.entry("TRAJ", "LINEAR_UNITS")
        allowed = f"{', '.join(_UNITS)}, or the number of units in a millimetre"
        if entry is None:
            message = "the unit of length is missing"
            raise InputError(message, self.ini.file, key="[TRAJ]LINEAR_UNITS", allowed=allowed)
        if (unit := _UNITS.get(entry.value.lower())) is not None:
            return unit
        try:
            number = float(entry.value)
        except ValueError:
            number = math.nan
        if not (math.isfinite(number) and number > 0):
            raise entry.refusal(f"'{entry.value}' is no unit of length", allowed)
        return _MM / number

    def _joints(self, kind: str) -> Array:
        """Return the joints on the base or the platform, (6, 3), m."""
        built_in = np.column_stack([genhexkins.BUILT_IN_JOINTS[kind], np.zeros(ACTUATORS)])
        joints = np.empty((ACTUATORS, 3))
        missing = []
        for j in range(ACTUATORS):
            for k, letter in enumerate("xyz"):
                pin = f"{kind}.{j}.{letter}"
                value = self.pins.number(pin)
                if value is None:
                    missing.append(pin)
                joints[j, k] = built_in[j, k] if value is None else value
        mixed = [
            str(j)
            for j in range(ACTUATORS)
            if 0 < sum(pin.startswith(f"{kind}.{j}.") for pin in missing) < joints.shape[1]
        ]
        if mixed:
            self.ask(
                "",
                f"The joints {', '.join(mixed)} of {kind} mix coordinates that are set with values "
                f"built into {_KINEMATICS}: which lines are missing?",
            )
        if missing:
            pins = ", ".join(missing[:3]) + (f" and {len(missing) - 3} more" if missing[3:] else "")
            self.ask(
                f"{kind}_joints",
                f"No line sets {pins}: the values built into {_KINEMATICS} are used, as on the "
                "machine.",
            )
        for offset in ("spindle-offset", "tool-offset"):
            joints[:, 2] += self._offset(offset, ask=kind == "platform")
        return joints * self.unit

    def _doubt_sizes(self, base: Array, platform: Array) -> None:
        """Ask about a platform that is much smaller than the base, or much larger."""
        radii = [
            float(np.linalg.norm(joints - joints.mean(axis=0), axis=1).max())
            for joints in (base, platform)
        ]
        if min(radii) * _SMALLER < max(radii):
            self.ask(
                "",
                f"The joints of the base lie within {1e3 * radii[0]:.4g} mm of their centre, those "
                f"of the platform within {1e3 * radii[1]:.4g} mm: are all of them set, and in the "
                "same unit?",
            )

    def _offset(self, pin: str, ask: bool) -> float:
        value = self.pins.number(pin)
        if pin in self.pins.linked and ask:
            self.ask(
                "platform_joints",
                f"{pin} follows a signal of the controller; here it is {value or 0:g}. Is it so on "
                "the day of the experiment?",
            )
        elif value and ask:
            self.ask(
                "platform_joints",
                f"{pin} = {value:g} is added to z of all joints, as {_KINEMATICS} does: the TCP is "
                "where the controller has it.",
            )
        return value or 0.0

    def _axes(self, kind: str, *, used: bool) -> Array | None:
        """Return the axes of all joints, (6, 3); None where they are not all known.

        What genhexkins has built in counts where it is `used`.
        """
        numbers = [self.pins.number(f"{kind}.{j}.{k}") for j in range(ACTUATORS) for k in "xyz"]
        if not used and all(number is None for number in numbers):
            return None
        given = np.array([np.nan if number is None else number for number in numbers])
        given = given.reshape(ACTUATORS, -1)
        missing = np.isnan(given)
        axes = np.where(missing, np.array(genhexkins.BUILT_IN_AXES[kind]) if used else 0.0, given)
        key = _KEYS[kind]
        if used and np.any(missing):
            self.ask(
                key,
                f"{kind} is not set for every strut: these are the defaults of {_KINEMATICS}, as "
                "on the machine.",
            )
        if not np.all(np.linalg.norm(axes, axis=1) > 0):
            self.ask(key, f"{kind} is not set for every strut: left out.")
            return None
        return axes

    def _drive(
        self, base: Array, platform: Array, home: tuple[float, ...] | None
    ) -> tuple[Drive | None, Array | None, Array | None]:
        """Return the drive, the axes at the base, and those at the platform that turn screws."""
        lead = self.pins.number("screw-lead")
        lower = self._axes("base-n", used=bool(lead))
        if not lead:
            return None, lower, None
        upper = self._axes("platform-n", used=True)
        thread = None
        if home is not None and lower is not None and upper is not None:
            thread = genhexkins.find_thread(
                lead, lower, upper, geometry_at(np.array(home), base, platform)
            )
        corrected = f"{_KINEMATICS} corrects the lengths for the turn of the struts on their screws"
        if thread is None:
            upper = None
            self.ask(
                "drive",
                f"{corrected}, with axes of opposite sense in some struts, or at an unknown "
                "home: left out. Is the thread right- or left-handed, and which first axes do the "
                "joints at the platform have (platform_cardan_axes)?",
            )
        else:
            if home is not None and lower is not None and upper is not None:
                self._doubt_turns(lead, lower, upper, np.array(home), base, platform)
            self.ask(
                "platform_cardan_axes",
                f"{corrected}, and so does the model. With these axes its thread is {thread}-handed"
                ": is that of the machine?",
            )
        self.ask("drive", INERTIA)
        screw = Screw(lead=abs(lead) * self.unit, thread=thread or "right")
        return Drive(screw=screw), lower, upper

    def _doubt_turns(
        self, lead: float, lower: Array, upper: Array, home: Array, base: Array, platform: Array
    ) -> None:
        """Ask about axes with which genhexkins' arc sine is ambiguous near home."""
        rng = np.random.default_rng(0)
        radius = float(np.linalg.norm(platform - platform.mean(axis=0), axis=1).max())
        ranges = np.repeat([_MOVED * radius, _TURNED], 3)
        poses = home + ranges * rng.uniform(-1, 1, (_POSES, len(ranges)))
        errors = genhexkins.turn_errors(lead * self.unit, lower, upper, home, poses, base, platform)
        if np.max(errors) > _EXACT:
            share = float(np.mean(np.max(errors, axis=1) > _EXACT))
            self.ask(
                "",
                f"{_KINEMATICS} takes the turn of the struts on their screws from an arc sine, "
                "which is ambiguous beyond a quarter turn. With these base-n and platform-n its "
                f"lengths are off by up to {1e3 * np.max(errors):.3g} mm in {100 * share:.0f} % of "
                f"the poses within {1e3 * ranges[0]:.3g} mm and {math.degrees(_TURNED):.0f} deg of "
                "home, on the machine as well; the model has the turns themselves. Are these axes "
                "right?",
            )

    def _home(self) -> tuple[float, ...] | None:
        entry = self.ini.entry("TRAJ", "HOME")
        if entry is None:
            self.ask(
                "home", "[TRAJ]HOME is missing: where is the platform when the axes are homed?"
            )
            return None
        words = entry.value.split()
        numbers = [entry.number(word) for word in words]
        if not 0 < len(numbers) <= ACTUATORS:
            raise entry.refusal(f"{len(numbers)} numbers are no pose", "x y z a b c")
        pose = np.zeros(6)
        pose[: len(numbers)] = numbers
        angular = self.ini.entry("TRAJ", "ANGULAR_UNITS")
        if np.any(pose[3:]) and angular is not None and angular.value.lower() not in _DEGREES:
            raise angular.refusal(f"{_KINEMATICS} takes degrees", ", ".join(_DEGREES))
        angles = Rotation.from_euler(FIXED_AXES, pose[3:], degrees=True).as_euler(ANGLES)
        return tuple(np.concatenate([pose[:3] * self.unit, angles + 0.0]).tolist())

    def _compare_homes(self, base: Array, platform: Array, home: tuple[float, ...]) -> None:
        lengths = geometry_at(np.array(home), base, platform).lengths
        entries = [self.ini.entry(joint, "HOME") for joint in _JOINTS]
        if any(entry is None for entry in entries):
            return
        homes = np.array([entry.number() for entry in entries if entry is not None]) * self.unit
        apart = np.abs(homes - lengths)
        if np.any(apart > _HOMED * lengths + abs(self.pins.number("screw-lead") or 0) * self.unit):
            j = int(np.argmax(apart))
            self.ask(
                "home",
                f"[JOINT_{j}]HOME is {homes[j] * 1e3:.6g} mm, at [TRAJ]HOME the strut has "
                f"{lengths[j] * 1e3:.6g} mm. Which of the two is right?",
            )

    def _metres(self, value: float) -> float:
        return value * self.unit

    def _add_position(self, limits: dict[str, object], size: float) -> None:
        position = {}
        for letter in "XYZ":
            low, high = _range(self.ini, f"AXIS_{letter}", self._metres, size)
            if low is not None and high is not None:
                position[letter.lower()] = (low, high)
        if position:
            limits["position"] = position
        elif "AXIS_X" in self.ini.sections:
            self.ask(
                "limits.position",
                "The limits of the axes are missing or placeholders such as ±1000, which limit "
                "nothing. How far may the platform go?",
            )
        angles = []
        for letter in "ABC":
            ends = [self.ini.entry(f"AXIS_{letter}", key) for key in _RANGE]
            given = [end for end in ends if end is not None and abs(end.number()) < _HALF_TURN]
            angles += [f"{end.key} = {end.number():g}" for end in given]
        if angles:
            self.ask(
                "limits.rotation",
                f"{', '.join(angles)}: LinuxCNC turns in another order than phi, theta, "
                "psi. Which rotations may the platform make?",
            )


def strut_limits(
    ini: IniFile, sections: Sequence[str], rates: Mapping[str, str], metres: Metres, size: float
) -> tuple[dict[str, object], list[Question]]:
    """Return the limits of the struts, and questions about those that limit nothing.

    `rates` maps keys of the six sections for a largest speed or acceleration to limits of the robot
    file; `metres` converts a length of the file to m. The size of the machine is in m.
    """
    limits, questions = dict[str, object](), list[Question]()
    pairs = [_range(ini, section, metres, size, lowest=0.0) for section in sections]
    real = [pair for pair in pairs if None not in pair]
    if len(real) == ACTUATORS:
        limits["strut_length"] = one_or_all([tuple(v for v in pair) for pair in real])
    else:
        ends = [value for pair in pairs for value in pair if value is not None]
        found = f"; it has {', '.join(f'{v * 1e3:g} mm' for v in sorted(set(ends)))}"
        text = (
            "MIN_LIMIT and MAX_LIMIT of the joints are missing or placeholders such as ±1000, "
            f"which limit nothing{found if ends else ''}. What are the shortest and the "
            "longest length between the joints?"
        )
        questions.append(Question("limits.strut_length", text))
    for key, limit in rates.items():
        values = []
        for entry in (ini.entry(section, key) for section in sections):
            if entry is None:
                continue
            value = entry.number()
            if value <= 0:
                raise entry.refusal(f"{value:g} is no limit", "more than zero")
            values.append(metres(value))
        if len(values) < ACTUATORS:
            text = f"{key} is not set for every joint."
            questions.append(Question(f"limits.{limit}", text))
        elif max(values) > _HIGHEST[limit][0]:
            text = (
                f"{key} is a placeholder, {max(values):.4g} {_HIGHEST[limit][1]}, which limits "
                "nothing. What is the largest value of a strut?"
            )
            questions.append(Question(f"limits.{limit}", text))
        else:
            limits[limit] = one_or_all(values)
    return limits, questions


def _range(
    ini: IniFile, section: str, metres: Metres, size: float, lowest: float = -math.inf
) -> tuple[float | None, float | None]:
    """Return the ends of a range in m; None for one that is missing or a placeholder.

    Of a strut's length, equal ends and ±1000 are placeholders.
    """
    entries = [ini.entry(section, key) for key in _RANGE]
    low, high = (None if e is None else metres(e.number()) for e in entries)
    if lowest == 0.0 and low is not None and high is not None and low in (high, -high):
        return None, None
    low, high = real_end(low, size, lowest), real_end(high, size)
    if low is not None and high is not None and low >= high and entries[0] is not None:
        raise entries[0].refusal("MIN_LIMIT is not below MAX_LIMIT", "a range")
    return low, high


def real_end(value: float | None, size: float, lowest: float = -math.inf) -> float | None:
    """Return the end of a range, m; None for one that is far beyond the size of the machine."""
    return None if value is None or value <= lowest or abs(value) > _FAR * size else value


def one_or_all(values: Sequence[object]) -> object:
    """Return the value that all struts have, or one for each."""
    return values[0] if all(value == values[0] for value in values) else tuple(values)


FORMAT = MachineFormat("LinuxCNC's INI and HAL", (".ini", ".hal"), _read, most_files=_MOST_FILES)


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


def read_ini(file: Path) -> IniFile:
    """Return the entries of an INI file; refuse a line that is none."""
    text = read_text(file, "an INI file")
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


class _Pins:
    """Pins of genhexkins that HAL files set, by name; the last line that sets a pin counts."""

    def __init__(self, ini: IniFile) -> None:
        self._ini = ini
        self.values = dict[str, Entry]()
        self.linked = set[str]()
        """Pins that follow a signal."""

    def number(self, pin: str) -> float | None:
        """Return what a pin is set to; None where no line sets it."""
        return self.values[pin].number() if pin in self.values else None

    def read(self, file: Path, above: tuple[Path, ...] = ()) -> None:
        """Execute a HAL file; `above` are the files that execute it."""
        text = read_text(file, "LinuxCNC's HAL file")
        self.execute(file, _lines(text), (*above, file.resolve()))

    def execute(
        self, file: Path, lines: Sequence[tuple[int, str]], above: tuple[Path, ...] = ()
    ) -> None:
        """Execute the numbered lines of a file."""
        for number, line in lines:
            words = line.partition("#")[0].strip()
            command = words.split()[0] if words else ""
            if command == "source":
                self.read(self._sourced(words, file, number, above), above)
            elif command in ("net", "linkps", "linksp"):
                linked = (word for word in words.split() if word.startswith(_PREFIX))
                self.linked |= {pin.removeprefix(_PREFIX) for pin in linked}
            elif command in ("loadusr", "alias"):
                if any(name in words for name in (_PREFIX, "halcmd", "haltcl")):
                    message = f"{quote(words)} may set pins of {_KINEMATICS}"
                    allowed = "setp lines in the HAL file"
                    raise InputError(message, file, number, command, allowed)
            else:
                self._set(words, file, number)

    def _sourced(self, words: str, file: Path, number: int, above: tuple[Path, ...]) -> Path:
        """Return the file that a line `source FILE` executes; refuse one that cannot be read."""
        name = words.removeprefix("source").strip().strip("\"'")
        places = [folder / name for folder in (self._ini.file.parent, file.parent)]
        path = next((place for place in places if place.is_file()), None)
        if path is None:
            message = f"the file {quote(name)} is not here"
        elif path.resolve() in above:
            message = f"{quote(name)} executes itself"
        elif path.suffix == ".tcl":
            message = f"{quote(name)} is Tcl, which is not executed here"
        else:
            return path
        allowed = "a HAL file in the folder of the INI file"
        raise InputError(message, file, number, "source", allowed)

    def _set(self, words: str, file: Path, number: int) -> None:
        """Set a pin to a number, or to the value of a key of the INI file: ``[TRAJ]LEAD``."""
        key = next(iter(words.removeprefix("setp").split("=")[0].split()), "")
        if not key.startswith(_PREFIX):
            return
        found = _SET.fullmatch(words)
        if found is None:
            message = f"{quote(words)} sets no pin"
            raise InputError(message, file, number, key, f"setp {key} NUMBER")
        entry = Entry(found[2], file, number, key)
        if (reference := _REFERENCE.fullmatch(entry.value)) is not None:
            referred = self._ini.entry(reference[1], reference[2])
            if referred is None:
                message = f"{self._ini.file.name} has no {entry.value}"
                raise entry.refusal(message, "a key of the INI file")
            entry = referred
        self.values[key.removeprefix(_PREFIX)] = entry


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
