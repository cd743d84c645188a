"""Descriptions of machines: by their users, and from the files of other programs."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator

from constraints.plugins import declarations
from expdesign.configuration import quantity
from expdesign.configuration.bodies import Bodies
from expdesign.configuration.document import Located
from expdesign.configuration.errors import InputError, Problem, refusal
from expdesign.configuration.geometry import HalfAngle, JointRing, PairedStruts, geometry_at
from expdesign.configuration.parameters import DIRECT, Drive
from expdesign.configuration.quantity import quantity_in
from expdesign.configuration.schema import Ascending, Name, Pair, Section, exactly
from expdesign.machines import readers
from expdesign.machines.assumed import height_at, points, refuse_short_struts
from expdesign.machines.machine import MachineDraft, MachineFormat, Points, Question, round_digits
from expdesign.machines.readers.joint_list import draft_of_points, with_height
from expdesign.machines.writing import INERTIA
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATE_NAMES


def _plausible(
    smallest: str,
    largest: str,
    meant: str = "",
    plain: float = math.inf,
    sign: Callable[..., Any] | None = quantity.Positive.func,
) -> BeforeValidator:
    """Return a reader of a magnitude; plain numbers from `plain` on are asked for their unit."""

    def read(raw: object) -> float:
        text, unit = str(raw).strip(), smallest.partition(" ")[2]
        if _PLAIN.fullmatch(text) and abs(float(text)) >= plain:
            message = f"{text} without a unit is {text} {unit}".rstrip()
            allowed = f'a text with its unit, such as "{text} {meant}"'
            raise refusal(message, allowed, f"{text} {meant}")
        kind = quantity_in(unit) if unit else quantity.SHARE
        value, low, high = map(kind.parse, (raw, smallest, largest))
        if sign is not None:
            sign(value)
        if value and not low <= abs(value) <= high:
            message = f"{quantity.quantity_text(value, unit or '1')} is not plausible for a machine"
            raise refusal(message, f"{smallest} to {largest}")
        return value

    return BeforeValidator(read)


_PLAIN = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_Coordinate = Annotated[float, _plausible("1e-9 m", "100 m", "mm", 5, None)]
_Size = Annotated[float, _plausible("1e-4 m", "100 m", "mm", 5)]
_Tolerance = Annotated[float, _plausible("1e-12 m", "0.1 m", "mm", 0.05)]
_ShareTolerance = Annotated[float, _plausible("1e-9", "1", "%", 0.5)]
_Force = Annotated[float, _plausible("1e-9 N", "1e9 N")]
_Inertia = Annotated[
    float, _plausible("1e-12 kg m^2", "1e6 kg m^2", sign=quantity.NotNegative.func)
]
_Joints = Annotated[
    tuple[Annotated[tuple[_Coordinate, ...], exactly(3, "coordinates [x, y, z]")], ...],
    exactly(ACTUATORS, "joints"),
]
_Angle = Annotated[HalfAngle, _plausible("0 rad", "1e9 rad", "deg", 1, None)]
"""`HalfAngle` states what is too large, and what to do."""
_PAIRS: dict[str, PairedStruts] = {"base": "1-2", "platform": "2-3"}
_ANSWERS = {
    "base_radius": "base_joints",
    "platform_radius": "platform_joints",
    "home_height": "home",
    "stroke": "strut_length",
    "mass": "moved_mass",
}
"""Keys of the robot file by answers with another name."""
_HOME_IN_THE_MIDDLE = "Is home in the middle of the stroke? This is assumed."
_LEAD = "By how much does one turn of the motor move the strut? With it: drive: {%s: {lead: 5 mm}}."


class MachineDescription(Section):
    """Answers to the questions about a machine, SI; None: no answer."""

    name: Name
    base_radius: _Size | None = None
    base_half_angle: _Angle | None = None
    base_joints: _Joints | None = None
    platform_radius: _Size | None = None
    platform_half_angle: _Angle | None = None
    platform_joints: _Joints | None = None
    platform_z: _Coordinate | None = None
    home_height: _Coordinate | None = None
    strut_length: Annotated[tuple[_Size, ...], Ascending, Pair] | None = None
    stroke: _Size | None = None
    strut_speed: Annotated[float, _plausible("1e-9 m/s", "100 m/s", "mm/s", 5)] | None = None
    strut_acceleration: Annotated[float, _plausible("1e-9 m/s^2", "1e5 m/s^2")] | None = None
    actuator_force: _Force | None = None
    mass: Annotated[quantity.Mass, quantity.Positive] | None = None
    drive: Literal["direct", "screw", "gear"] | None = None
    lead: Annotated[float, _plausible("1e-6 m", "10 m", "mm", 1)] | None = None
    inertia: _Inertia | None = None
    force_std: _Force | None = None
    length_std: Annotated[float, _plausible("1e-12 m", "1 m", "um", 0.1)] | None = None
    joint_tolerance: _Tolerance | None = None
    length_tolerance: _Tolerance | None = None
    force_tolerance: _ShareTolerance | None = None
    force_tolerance_each: _ShareTolerance | None = None
    gravity_tolerance: Annotated[float, _plausible("1e-9 rad", "0.2 rad", "deg", 0.1)] | None = None
    delay_tolerance: Annotated[float, _plausible("1e-9 s", "0.1 s", "ms", 0.1)] | None = None


def machine_from_answers(
    answers: Located[MachineDescription], known: MachineDraft | None = None
) -> MachineDraft:
    """Return the machine by the answers, completed by the known values."""
    if problems := list(_contradictions(answers)):
        raise InputError(problems)
    one = answers.value
    known = replace(known or MachineDraft(one.name), name=one.name)
    height = one.home_height
    known = known if height is None else with_height(known, height)
    without_screw = one.drive in ("direct", "gear")
    bodies, about_bodies = _scale_bodies(known.bodies, one.mass)
    machine = replace(
        known,
        base_joints=_joints(one, "base") or known.base_joints,
        platform_joints=_joints(one, "platform") or known.platform_joints,
        moved_mass=known.moved_mass if one.mass is None else one.mass,
        bodies=bodies,
        platform_cardan_axes=None if without_screw else known.platform_cardan_axes,
        drive=_drive(one, known.drive) or known.drive,
        force_std=known.force_std if one.force_std is None else (one.force_std,) * ACTUATORS,
        length_std=known.length_std if one.length_std is None else (one.length_std,) * ACTUATORS,
        tolerances=_tolerances(one),
    )
    limits = dict(known.limits)
    for key in ("strut_speed", "strut_acceleration", "actuator_force"):
        if (value := getattr(one, key)) is not None:
            limits[key] = value
    answered = {_ANSWERS.get(key, key) for key, value in vars(one).items() if value is not None}
    answered |= {"platform_cardan_axes"} if without_screw else set()
    questions = [q for q in known.questions if q.key.removeprefix("limits.") not in answered]
    questions += about_bodies
    if one.strut_length is not None:
        limits["strut_length"] = list(one.strut_length)
    if one.stroke is not None:
        limits["strut_length"] = _about_home(machine, one.stroke, answers)
        questions.append(Question("limits.strut_length", _HOME_IN_THE_MIDDLE))
    elif height is not None and "strut_length" in limits:
        _refuse_home(replace(machine, limits=limits), answers)
    if one.drive in ("screw", "gear") and one.lead is None:
        questions.append(Question("drive", _LEAD % one.drive))
    elif machine.drive and machine.drive.geared and machine.drive.geared.inertia is None:
        asked = Question("drive", INERTIA)
        questions += [] if asked in questions else [asked]
    return replace(machine, limits=limits, questions=tuple(questions))


def _contradictions(answers: Located[MachineDescription]) -> Iterator[Problem]:
    one = answers.value

    def there(*keys: str) -> list[str]:
        return [key for key in keys if getattr(one, key) is not None]

    for end in _PAIRS:
        listed, circle = f"{end}_joints", (f"{end}_radius", f"{end}_half_angle")
        also = there(*circle, *(["platform_z"] if end == "platform" else []))
        if also and there(listed):
            message = "the joints are given as a list and by a circle"
            yield answers.problem((also[0],), message, "a circle or a list, not both")
        elif len(there(*circle)) == 1:
            (missing,) = set(circle) - set(there(*circle))
            message = f"a circle of joints needs radius and half-angle: of the {end} one is missing"
            yield answers.problem((missing,), message, "both, or neither")
    if there("platform_z") and not there("platform_radius", "platform_joints"):
        message = "it is the height of a circle that is not given"
        yield answers.problem(("platform_z",), message, "a platform_radius with it")
    if len(there("strut_length", "stroke")) > 1:
        message = "lengths and a stroke are both given"
        yield answers.problem(("stroke",), message, "strut_length or stroke, not both")
    for key in there("lead", "inertia"):
        if one.drive not in ("screw", "gear"):
            yield answers.problem(
                (key,), f"only a screw or gear has a {key}", "drive: screw or gear"
            )
    if there("inertia") and not there("lead"):
        yield answers.problem(("inertia",), "an inertia needs the lead", "lead with it")


def _joints(one: MachineDescription, end: str) -> JointRing | Points | None:
    listed: Points | None = getattr(one, f"{end}_joints")
    radius = getattr(one, f"{end}_radius")
    if radius is None:
        return listed
    ring: dict[str, Any] = {"radius": radius, "half_angle": getattr(one, f"{end}_half_angle")}
    if end == "platform" and one.platform_z is not None:
        ring["z"] = one.platform_z
    return JointRing(**ring, pairs=_PAIRS[end])


def _scale_bodies(
    bodies: Bodies | None, mass: float | None
) -> tuple[Bodies | None, list[Question]]:
    """Return the bodies with a mass of platform and payload together, and a question about it."""
    known = 0.0 if bodies is None else bodies.part("platform", "payload").mass
    if bodies is None or mass is None or known in (0.0, mass):
        return bodies, []
    scaled = {
        part: tuple(
            body.model_copy(
                update={
                    "mass": round_digits(body.mass * mass / known),
                    "inertia": tuple(round_digits(one * mass / known) for one in body.inertia),
                }
            )
            for body in getattr(bodies, part)
        )
        for part in ("platform", "payload")
    }
    text = (
        f"The file has {quantity.quantity_text(known, 'kg')} for the platform: its masses and "
        f"inertias are scaled to {quantity.quantity_text(mass, 'kg')}. Are they right?"
    )
    return bodies.model_copy(update=scaled), [Question("bodies", text)]


def _drive(one: MachineDescription, known: Drive | None) -> Drive | None:
    """Return the drive; None if the answers do not determine it. A known thread is kept."""
    if one.drive == "direct":
        return DIRECT
    if one.lead is None or one.drive is None:
        return None
    stated: dict[str, Any] = {"lead": one.lead, "inertia": one.inertia}
    if one.drive == "screw" and known is not None and known.screw is not None:
        stated["thread"] = known.screw.thread
    return Drive.model_validate({one.drive: stated})


def _tolerances(one: MachineDescription) -> dict[str, Any]:
    forces = {"common": one.force_tolerance, "each": one.force_tolerance_each}
    found = {
        "base_joints": one.joint_tolerance,
        "platform_joints": one.joint_tolerance,
        "strut_length": one.length_tolerance,
        "force_constant": {key: value for key, value in forces.items() if value} or None,
        "gravity": one.gravity_tolerance,
        "delay": one.delay_tolerance,
    }
    return {key: value for key, value in found.items() if value is not None}


def _refuse_home(machine: MachineDraft, answers: Located[MachineDescription]) -> None:
    """Refuse a stated height at which the struts are shorter or longer than they can be."""
    base, platform, home = machine.base_joints, machine.platform_joints, machine.home
    if base is None or platform is None or home is None:
        return
    low, high = np.broadcast_to(machine.limits["strut_length"], (ACTUATORS, 2)).T
    struts = geometry_at(np.array(home), points(base), points(platform))
    if np.all((low <= struts.lengths) & (struts.lengths <= high)):
        return
    shortest, longest = (
        quantity.quantity_text(float(end(struts.lengths)), "m", 4) for end in (np.min, np.max)
    )
    vectors = struts.lengths[:, None] * struts.directions
    above = float(np.mean(vectors[:, 2]))
    refuse_short_struts(float(np.min(high)), vectors)
    ends = (height_at(float(end), vectors) or 0.0 for end in (np.max(low), np.min(high)))
    heights = sorted(home[2] - above + math.copysign(end, above) for end in ends)
    message = f"the struts have {shortest} to {longest} there, outside their lengths"
    allowed = " to ".join(quantity.quantity_text(one, "m", 3) for one in heights)
    raise InputError(answers.problem(("home_height",), message, allowed))


def _about_home(
    machine: MachineDraft, stroke: float, answers: Located[MachineDescription]
) -> list[float]:
    """Return the range of strut lengths about home, m."""
    if machine.base_joints is None or machine.platform_joints is None or machine.home is None:
        message = "a stroke needs the joints and the height of home"
        raise InputError(answers.problem(("stroke",), message, "strut_length, or these with it"))
    base, platform = points(machine.base_joints), points(machine.platform_joints)
    lengths = geometry_at(np.array(machine.home), base, platform).lengths
    low, high = float(np.min(lengths)) - stroke / 2, float(np.max(lengths)) + stroke / 2
    if low <= 0:
        message = (
            f"the struts have {quantity.quantity_text(float(np.min(lengths)), 'm', 4)} at home"
        )
        allowed = "a stroke that is less than twice as long"
        raise InputError(answers.problem(("stroke",), message, allowed))
    return [float(f"{low:.6g}"), float(f"{high:.6g}")]


_FARTHEST = 1000.0
"""Largest distance of a joint or of home from the origin of its frame, m."""


@cache
def machine_formats() -> tuple[MachineFormat, ...]:
    """Return every format; a new one is one file in `expdesign.machines.readers`, or a plug-in."""
    return declarations(MachineFormat, readers, "FORMAT")


def read_machine(
    name: str, files: Sequence[Path], joints: Mapping[str, str] | None = None
) -> MachineDraft:
    """Read one machine from files of one format, SI units; missing values become questions.

    `joints` has the names of the file's sets of joints by ``base`` and ``platform``, for a list of
    joints whose names do not say it.
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
    if joints and first.points is None:
        keys = " and ".join(f"--{end}-joints" for end in joints)
        allowed = "six points; the name of a set of points where the file is a list of joints"
        raise InputError(
            f"{first.title} has no sets of points with names", key=keys, allowed=allowed
        )
    if joints and first.points is not None:
        source = f"{first.title.removeprefix('a ')}, {files[0].name}"
        draft = draft_of_points(name, source, first.points(files[0]), files[0], joints)
    else:
        draft = first.read(name, tuple(files))
    machine = move_to_mid_stroke(drop_contradicting_ranges(draft))
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


_STROKE_END = 0.02
"""Distance of a strut from the end of its stroke, as a share of it, that leaves no room to move."""


def move_to_mid_stroke(machine: MachineDraft) -> MachineDraft:
    """Move a home with the struts at an end of their strokes along z to mid-stroke."""
    base, platform, home = machine.base_joints, machine.platform_joints, machine.home
    if base is None or platform is None or home is None or "strut_length" not in machine.limits:
        return machine
    struts = geometry_at(np.array(home), points(base), points(platform))
    low, high = np.broadcast_to(machine.limits["strut_length"], (ACTUATORS, 2)).T
    share = (struts.lengths - low) / (high - low)
    if np.all(np.abs(share - 0.5) <= 0.5 - _STROKE_END):
        return machine
    vectors = struts.lengths[:, None] * struts.directions
    height = height_at(float(np.mean(low + high)) / 2, vectors)
    above = float(np.mean(vectors[:, 2]))
    if height is None:
        return machine
    z = round_digits(home[2] - above + math.copysign(height, above), 4)
    lowest, highest = machine.limits.get("position", {}).get("z", (z, z))
    if not lowest <= z <= highest:
        return machine
    text = (
        f"In the file's pose, z = {home[2] * 1e3:.6g} mm, the struts are at an end of their stroke:"
        " here they are at mid-stroke. Is that home?"
    )
    questions = (*machine.questions, Question("home", text))
    return replace(machine, home=(*home[:2], z, *home[3:]), questions=questions)


_ROUNDING = 1e-4
"""Relative excess over a range that the rounding of a file explains."""


def drop_contradicting_ranges(machine: MachineDraft) -> MachineDraft:
    """Replace ranges that the machine's own home pose violates by questions."""
    if machine.home is None or machine.base_joints is None or machine.platform_joints is None:
        return machine
    limits, questions = dict(machine.limits), list(machine.questions)
    if "strut_length" in limits:
        base, platform = points(machine.base_joints), points(machine.platform_joints)
        lengths = geometry_at(np.array(machine.home), base, platform).lengths
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
    """Widen the range of lengths to home within the rounding; else ask for it."""
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
