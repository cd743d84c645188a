"""Description of a machine by its user, in the terms of drawings and data sheets."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np

from expdesign.configuration import geometry as geo
from expdesign.configuration.document import Located
from expdesign.configuration.errors import InputError, Problem
from expdesign.configuration.fields import Ascending, Name, Pair, Point, exactly, one_of
from expdesign.configuration.geometry import HalfAngle, JointRing, PairedStruts
from expdesign.configuration.parameters import DIRECT, Drive, Gear, Screw
from expdesign.configuration.quantity import (
    Acceleration,
    Force,
    Inertia,
    Length,
    Mass,
    NotNegative,
    Positive,
    Speed,
    quantity_text,
)
from expdesign.configuration.section import Section
from expdesign.machines.assumed import points
from expdesign.machines.machine import MachineDraft, Points, Question
from expdesign.machines.writing import INERTIA
from expdesign.mechanism.hexapod import ACTUATORS

DriveKind = Literal["direct", "screw", "gear"]

_Joints = Annotated[tuple[Point, ...], exactly(ACTUATORS, "joints")]
_PAIRS: dict[str, PairedStruts] = {"base": "1-2", "platform": "2-3"}
_ANSWERS = {
    "base_radius": "base_joints",
    "platform_radius": "platform_joints",
    "home_height": "home",
    "stroke": "strut_length",
    "mass": "moved_mass",
}
"""Keys of the robot file whose questions an answer with another name settles."""
_HOME_IN_THE_MIDDLE = "Is home in the middle of the stroke? This is assumed."
_LEAD = "By how much does one turn of the motor move the strut? With it: drive: {%s: {lead: 5 mm}}."


class MachineDescription(Section):
    """Answers to the questions about a machine, SI; None: no answer."""

    name: Name
    base_radius: Annotated[Length, Positive] | None = None
    base_half_angle: HalfAngle | None = None
    base_joints: _Joints | None = None
    platform_radius: Annotated[Length, Positive] | None = None
    platform_half_angle: HalfAngle | None = None
    platform_joints: _Joints | None = None
    platform_z: Length | None = None
    home_height: Length | None = None
    strut_length: Annotated[tuple[Annotated[Length, Positive], ...], Ascending, Pair] | None = None
    stroke: Annotated[Length, Positive] | None = None
    strut_speed: Annotated[Speed, Positive] | None = None
    strut_acceleration: Annotated[Acceleration, Positive] | None = None
    actuator_force: Annotated[Force, Positive] | None = None
    mass: Annotated[Mass, Positive] | None = None
    drive: Annotated[DriveKind, one_of(DriveKind)] | None = None
    lead: Annotated[Length, Positive] | None = None
    inertia: Annotated[Inertia, NotNegative] | None = None
    force_std: Annotated[Force, Positive] | None = None
    length_std: Annotated[Length, Positive] | None = None


def machine_from_answers(
    answers: Located[MachineDescription], known: MachineDraft | None = None
) -> MachineDraft:
    """Return the machine by the answers, completed by what is known already.

    Raises
    ------
    InputError
        Answers contradict each other or are incomplete.
    """
    if problems := list(_contradictions(answers)):
        raise InputError(problems)
    one = answers.value
    known = replace(known or MachineDraft(one.name), name=one.name)
    home = known.home
    if one.home_height is not None:
        home = (0.0, 0.0, one.home_height, 0.0, 0.0, 0.0)
    machine = replace(
        known,
        base_joints=_joints(one, "base") or known.base_joints,
        platform_joints=_joints(one, "platform") or known.platform_joints,
        home=home,
        moved_mass=known.moved_mass if one.mass is None else one.mass,
        drive=_drive(one) or known.drive,
        force_std=known.force_std if one.force_std is None else (one.force_std,) * ACTUATORS,
        length_std=known.length_std if one.length_std is None else (one.length_std,) * ACTUATORS,
    )
    limits = dict(known.limits)
    for key in ("strut_speed", "strut_acceleration", "actuator_force"):
        if (value := getattr(one, key)) is not None:
            limits[key] = value
    answered = {_ANSWERS.get(key, key) for key, value in vars(one).items() if value is not None}
    questions = [q for q in known.questions if q.key.removeprefix("limits.") not in answered]
    if one.strut_length is not None:
        limits["strut_length"] = list(one.strut_length)
    if one.stroke is not None:
        limits["strut_length"] = _about_home(machine, one.stroke, answers)
        questions.append(Question("limits.strut_length", _HOME_IN_THE_MIDDLE))
    if one.drive in ("screw", "gear") and one.lead is None:
        questions.append(Question("drive", _LEAD % one.drive))
    elif machine.drive is not None and (geared := machine.drive.geared) is not None:
        unknown = geared.inertia is None
        questions += [Question("drive", INERTIA)] if unknown else []
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


def _drive(one: MachineDescription) -> Drive | None:
    """Return the drive; None if the answers do not determine it."""
    if one.drive == "direct":
        return DIRECT
    if one.lead is None or one.drive is None:
        return None
    if one.drive == "gear":
        return Drive(gear=Gear(lead=one.lead, inertia=one.inertia))
    return Drive(screw=Screw(lead=one.lead, inertia=one.inertia))


def _about_home(
    machine: MachineDraft, stroke: float, answers: Located[MachineDescription]
) -> list[float]:
    """Return the range of strut lengths whose middle is home, m."""
    if machine.base_joints is None or machine.platform_joints is None or machine.home is None:
        message = "a stroke needs the joints and the height of home"
        raise InputError(answers.problem(("stroke",), message, "strut_length, or these with it"))
    base, platform = points(machine.base_joints), points(machine.platform_joints)
    lengths = geo.geometry_at(np.array(machine.home), base, platform).lengths
    low, high = float(np.min(lengths)) - stroke / 2, float(np.max(lengths)) + stroke / 2
    if low <= 0:
        message = f"the struts have {quantity_text(float(np.min(lengths)), 'm', 4)} at home"
        allowed = "a stroke that is less than twice as long"
        raise InputError(answers.problem(("stroke",), message, allowed))
    return [float(f"{low:.6g}"), float(f"{high:.6g}")]
