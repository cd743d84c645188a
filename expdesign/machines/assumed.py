"""Default values for everything unknown about a machine, scaled by its size.

They pass `expdesign check` and carry no information about the machine: each is marked as assumed.
The bodies are a disc for the platform, and in every strut two thin rods, the stator with its end
at the base joint, the slider with its end at the platform joint, and a ring as heavy as the slider.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import brentq

from constraints import Limit, limit_definitions
from constraints.arrays import Array
from expdesign.configuration import geometry as geo
from expdesign.configuration.bodies import Bodies, BodyDescription
from expdesign.configuration.document import Located, document_from_mapping
from expdesign.configuration.errors import InputError
from expdesign.configuration.geometry import JointRing, rms_radius
from expdesign.configuration.limits import (
    CHARACTERISTIC_LENGTH,
    LIFTED,
    Limits,
    resolve_limits,
    shared_rows,
)
from expdesign.configuration.quantity import quantity_text
from expdesign.configuration.robot import EARTH_GRAVITY, RobotDescription, resolve_robot
from expdesign.configuration.schema import Section, validate
from expdesign.machines.machine import MachineDraft, Points, round_digits
from expdesign.mechanism.hexapod import ACTUATORS, actuator_names
from expdesign.mechanism.terms import rigid_platform, struts
from expdesign.robot import LimitModel, Robot

MASS = "moved_mass"
"""Key of the moved mass in `Complete.assumed`."""
_BASE = JointRing(radius=0.3, half_angle=math.radians(10), pairs="1-2")
_PLATFORM = JointRing(radius=0.15, half_angle=math.radians(10), pairs="2-3")
_HEIGHT = 1.2
"""Height of the platform above the base, as a share of the base joints' radius."""
_MASS = 10.0
_LEAST_MASS, _LARGEST_MASS = 1e-6, 1e9
_STRUT = {parameter.name for parameter in struts.TERM.parameters}
_PLATFORM_BODY = {parameter.name for parameter in rigid_platform.SYMMETRIC.parameters}
_STROKE = 0.2
"""Share of the struts' length at home."""
_POSITION = 0.25
"""Travel from home along each axis, as a share of the stroke."""
_ROTATION = math.radians(15)
_JOINT = math.radians(20)
_STEEPEST = math.radians(89)
_SPEED = 0.5
"""Strokes per second."""
_SLOWEST = 5
"""Ratio of the fastest to the slowest motion."""
_ACCELERATION = 5.0
"""Strokes per second squared."""
_FORCE = 3.0
"""Times the largest at home."""
_CONDITION = 3.0
_CLEARANCE = 0.5
_FORCE_STD = 0.02
"""Share of the largest force."""
_LENGTH_STD = 5e-5
"""Share of the struts' length at home."""


class _Bounded(Section):
    """Limits that are needed before there is a robot."""

    limits: Limits


@dataclass(frozen=True)
class Complete:
    """A machine with every value known or assumed."""

    machine: MachineDraft
    """The machine with limits, noise, bodies, and the parameters that bodies do not determine."""
    assumed: frozenset[str]
    """Keys of assumed values: of the robot file, of single limits and parameters,
    ``position.y`` for a component, ``bodies.stator`` for a part, and `MASS`."""
    general: bool
    """True if the platform needs the parameters of `platform: general`."""
    lengths: Array
    """(6,), of the struts at home, m."""
    frequency: tuple[float, float]
    """Slowest and fastest repetition of a motion, Hz: the fastest takes the full speed over half
    of the stroke."""


def complete_machine(machine: MachineDraft) -> Complete:
    """Fill in all unknown values."""
    known, given = machine, dict(vars(machine))
    document = document_from_mapping({"limits": machine.limits})
    validate(_Bounded, document.data, document)
    machine = _with_geometry(machine)
    base, platform = points(machine.base_joints), points(machine.platform_joints)
    lengths = geo.geometry_at(np.array(machine.home), base, platform).lengths
    if machine.bodies is None or not {"platform", "payload"} & set(_parts(machine)):
        general = bool(geo.asymmetric_sums(platform))
    else:
        general = bool(machine.bodies.lateral(machine.bodies.parameters(platform)))
    mass, limits = machine.moved_mass, dict(machine.limits)
    if mass is None:
        mass = _mass(machine, lengths, limits, general)
    if not _LEAST_MASS <= mass <= _LARGEST_MASS:
        message = f"{mass:.3g} kg is not a plausible mass: the value is damaged or in another unit"
        allowed = f"{_LEAST_MASS:g} kg to {_LARGEST_MASS:g} kg"
        raise InputError(message, key="mass", allowed=allowed)
    machine = _with_dynamics(machine, mass, lengths, limits)
    robot = _robot(machine, general)
    values = LimitModel.boundless(robot).at_home()
    limits, open_limits = _merge(_limits(limits, values, robot), limits)
    machine = replace(
        machine,
        moved_mass=mass,
        limits=limits,
        force_std=machine.force_std
        or (round_digits(_FORCE_STD * _size(limits, "actuator_force"), 1),) * ACTUATORS,
        length_std=machine.length_std
        or (round_digits(_LENGTH_STD * float(np.mean(lengths)), 1),) * ACTUATORS,
    )
    keys = ("base_joints", "platform_joints", "home", "force_std", "length_std", MASS)
    assumed = {key for key in keys if given[key] is None}
    assumed |= open_limits | set(machine.parameters) - set(given["parameters"])
    assumed |= {f"bodies.{part}" for part in _parts(machine) if part not in _parts(known)}
    amplitude = _stroke(limits, float(np.mean(lengths))) / 4
    fastest = round_digits(_size(limits, "strut_speed") / (2 * math.pi * amplitude), 1)
    frequency = (round_digits(fastest / _SLOWEST, 2), fastest)
    return Complete(machine, frozenset(assumed), general, lengths, frequency)


def points(joints: JointRing | Points | None) -> Array:
    """Return joints as points, (6, 3), m."""
    return np.array(joints.points if isinstance(joints, JointRing) else joints, dtype=np.float64)


def _with_geometry(machine: MachineDraft) -> MachineDraft:
    base, platform = machine.base_joints, machine.platform_joints
    if (base is None) != (platform is None):
        there, lacking = ("base", "platform") if platform is None else ("platform", "base")
        key = f"{lacking}_joints"
        message = f"the joints of the {there} are given, those of the {lacking} are not"
        reasons = [question.text for question in machine.questions if question.key == key]
        allowed = f"both, or neither; --{lacking}-joints, or --{lacking}-radius with its half-angle"
        raise InputError(" ".join([*reasons, message]), key=key, allowed=allowed)
    base, platform = base or _BASE, platform or _PLATFORM
    home = machine.home or (0.0, 0.0, _height(machine, points(base), points(platform)), 0, 0, 0)
    return replace(machine, base_joints=base, platform_joints=platform, home=tuple(home))


def _height(machine: MachineDraft, base: Array, platform: Array) -> float:
    """Return the height with the struts at mid-stroke.

    Without a known stroke the height follows from the radius of the base.
    """
    radius = float(np.max(np.hypot(base[:, 0], base[:, 1])))
    gap = float(np.mean(base[:, 2]) - np.mean(platform[:, 2]))
    height = _HEIGHT * radius
    if "strut_length" in machine.limits:
        bounds = _bounds(machine.limits, "strut_length")
        middle = float(np.mean((bounds.lower + bounds.upper) / 2))
        refuse_short_struts(float(np.min(bounds.upper)), platform - base)
        height = height_at(middle, platform - base) or height
    return round_digits(height + gap, 3) if height + gap else height


def refuse_short_struts(longest: float, struts: Array) -> None:
    """Refuse struts, (6, 3), m, that are too short for any height of home."""
    if height_at(longest, struts) is not None:
        return
    across = float(np.mean(np.hypot(struts[:, 0], struts[:, 1])))
    message = (
        f"no height of home fits: struts of at most {quantity_text(longest, 'm')} are too short "
        f"for joints of base and platform that are {quantity_text(across, 'm', 3)} apart across"
    )
    raise InputError(message, key="strut_length", allowed="longer struts, or other joints")


def height_at(length: float, struts: Array) -> float | None:
    """Return the mean height of struts with a mean length, m; None for a length that is too short.

    The struts, (6, 3), m, are given at any height.

    >>> height_at(0.5, np.array([[0.3, 0, 0], [0, 0.3, 0], [0.3, 0, 0]]))
    0.4
    """
    across, above = np.hypot(struts[:, 0], struts[:, 1]), struts[:, 2] - np.mean(struts[:, 2])

    def excess(height: float) -> float:
        return float(np.mean(np.hypot(across, above + height))) - length

    if excess(0.0) >= 0:
        return None
    return round_digits(float(brentq(excess, 0.0, length + float(np.ptp(above)))))


def _bounds(limits: Mapping[str, Any], key: str) -> Limit:
    """Return the bounds of a known limit."""
    document = document_from_mapping({key: limits[key]})
    return resolve_limits([Located(document.data, document, ("limits",))])[0][key]


def _size(limits: Mapping[str, Any], key: str) -> float:
    """Return the largest magnitude that a limit admits in every strut, SI."""
    bounds = _bounds(limits, key)
    return float(np.min(np.maximum(np.abs(bounds.lower), np.abs(bounds.upper))))


def _parts(machine: MachineDraft) -> dict[str, tuple[BodyDescription, ...]]:
    """Return the bodies of a machine by part; empty parts are left out."""
    given = {} if machine.bodies is None else dict(machine.bodies)
    return {part: bodies for part, bodies in given.items() if bodies}


def _with_dynamics(
    machine: MachineDraft, mass: float, lengths: Array, limits: Mapping[str, Any]
) -> MachineDraft:
    """Add assumed bodies and friction to a machine without values."""
    strut = float(np.mean(lengths))
    known = "strut_speed" in limits
    speed = _size(limits, "strut_speed") if known else _SPEED * _stroke(limits, strut)
    assumed = assumed_bodies(mass, strut, points(machine.platform_joints))
    parts, given = _parts(machine), set(machine.parameters)
    if not {"stator", "slider"} & set(parts) and not given >= _STRUT:
        parts |= {part: (assumed[part],) for part in ("ring", "stator", "slider")}
    if not {"platform", "payload"} & set(parts) and not given >= _PLATFORM_BODY:
        parts["platform"] = (assumed["platform"],)
    weight = mass * float(np.linalg.norm(machine.gravity or EARTH_GRAVITY)) / ACTUATORS or mass
    return replace(
        machine,
        bodies=Bodies(**parts) if parts else None,
        parameters=assumed_friction(strut, weight, speed) | dict(machine.parameters),
    )


def _robot(machine: MachineDraft, general: bool) -> Robot:
    """Return the machine as a robot without limits."""
    mapping = {
        "name": machine.name,
        "home": machine.home,
        "gravity": machine.gravity or EARTH_GRAVITY,
        "base_joints": points(machine.base_joints),
        "platform_joints": points(machine.platform_joints),
        "platform": "general" if general else "symmetric",
        "parameters": {
            name: value
            for name, value in machine.parameters.items()
            if general or name not in rigid_platform.LATERAL
        },
        "limits": {CHARACTERISTIC_LENGTH: _length(machine), "rotation": LIFTED},
    }
    for key in ("alpha_axes", "platform_joint_axes", "platform_cardan_axes", "drive", "bodies"):
        if getattr(machine, key) is not None:
            mapping[key] = getattr(machine, key)
    document = document_from_mapping(mapping)
    description = validate(RobotDescription, document.data, document)
    return Robot(resolve_robot(Located(description, document)))


def _length(machine: MachineDraft) -> float:
    given = machine.limits.get(CHARACTERISTIC_LENGTH)
    radius = geo.rms_radius(points(machine.platform_joints))
    if radius == 0:
        message, allowed = "all joints are at the TCP", "points around it"
        raise InputError(message, key="platform_joints", allowed=allowed)
    return round_digits(radius, 2) if given is None else given


def _mass(machine: MachineDraft, lengths: Array, limits: Mapping[str, Any], general: bool) -> float:
    """Return a mass that the actuators can carry, if their force is known."""
    if "p10" in machine.parameters:
        return machine.parameters["p10"]
    if "actuator_force" not in limits:
        return _MASS
    robot = _robot(_with_dynamics(machine, _MASS, lengths, limits), general)
    at_home = float(np.max(np.abs(LimitModel.boundless(robot).at_home()["actuator_force"])))
    if at_home == 0:
        return _MASS
    mass = _MASS * _size(limits, "actuator_force") / _FORCE / at_home
    return max(round_digits(mass, 1), _LEAST_MASS)


def _stroke(limits: Mapping[str, Any], strut: float) -> float:
    if "strut_length" in limits:
        bounds = _bounds(limits, "strut_length")
        return float(np.min(bounds.upper - bounds.lower))
    return _STROKE * strut


def _limits(given: Mapping[str, Any], values: Mapping[str, Array], robot: Robot) -> dict[str, Any]:
    """Return a bound for every limit, conservative around home."""
    lengths = values["strut_length"]
    strut = float(np.mean(lengths))
    stroke = _stroke(given, strut)
    travel = round_digits(_POSITION * stroke, 2)
    directions, turns = (limit_definitions()[key].components for key in ("position", "rotation"))
    found: dict[str, Any] = {
        "strut_length": [
            round_digits(float(np.min(lengths)) - stroke / 2, 3),
            round_digits(float(np.max(lengths)) + stroke / 2, 3),
        ],
        "strut_speed": round_digits(_SPEED * stroke, 1),
        "strut_acceleration": round_digits(_ACCELERATION * stroke, 1),
        "position": {
            name: [round_digits(value - travel), round_digits(value + travel)]
            for name, value in zip(directions, values["position"].tolist(), strict=True)
        },
        "rotation": {
            name: [-_degrees(_ROTATION - angle), _degrees(angle + _ROTATION)]
            for name, angle in zip(turns, values["rotation"].tolist(), strict=True)
        },
        "tilt": _degrees(float(np.max(values["tilt"])) + _ROTATION),
        "alpha": _spread(values["alpha"]),
        "beta": _spread(values["beta"]),
        "platform_joint_angle": _degrees(float(np.max(values["platform_joint_angle"])) + _JOINT),
        "jacobian_condition": round_digits(_CONDITION * float(values["jacobian_condition"][0]), 2),
        CHARACTERISTIC_LENGTH: robot.characteristic_length,
    }
    force = _FORCE * float(np.max(np.abs(values["actuator_force"])))
    found["actuator_force"] = round_digits(force, 2) if force > 0 else 1.0
    shared = shared_rows(
        limit_definitions()["strut_clearance"], robot.description.shared_joint_pairs
    )
    clearance = _CLEARANCE * float(np.min(values["strut_clearance"][~shared]))
    if clearance > 0:
        found["strut_clearance"] = round_digits(clearance, 1)
    return found


def _merge(assumed: Mapping[str, Any], given: Mapping[str, Any]) -> tuple[dict[str, Any], set[str]]:
    """Return all limits and the keys of the assumed ones, single components included."""
    merged, found = dict(assumed) | dict(given), {key for key in assumed if key not in given}
    for key, value in given.items():
        if isinstance(value, Mapping) and key in assumed:
            merged[key] = {**assumed[key], **value}
            found |= {f"{key}.{name}" for name in assumed[key] if name not in value}
    return merged, found


def _spread(angles: Array) -> list[float]:
    low = max(float(np.min(angles)) - _JOINT, -_STEEPEST)
    return [-_degrees(-low), _degrees(min(float(np.max(angles)) + _JOINT, _STEEPEST))]


def _degrees(angle: float) -> float:
    """Round an angle up to a whole number of degrees, rad."""
    return math.radians(math.ceil(round(math.degrees(angle), 6)))


_STATOR, _SLIDER = 0.08, 0.04
"""Masses as shares of the moved mass."""
_ROD = 0.6
"""Length of a rod as a share of the strut's."""
_SLENDER = 0.04
"""Radius of a rod as a share of its length."""
_THICK = 0.2
"""Height of the disc as a share of its radius."""
_FRICTION = 0.05
"""Dry friction of an actuator as a share of the weight that it carries."""
_JOINT_FRICTION = 2e-3
"""Dry friction of a joint, N m, per N of that weight and m of the strut."""
_DIGITS = 4
_NOTHING = 1e-12


def assumed_bodies(mass: float, strut: float, joints: Array) -> dict[str, BodyDescription]:
    """Return assumed bodies: ring, stator, slider and platform.

    For a mass of the platform with its load, kg, a mean length of the struts at home, m, and
    platform joints (6, 3), platform frame, m.
    """
    rod = _ROD * strut
    across, along = rod**2 / 12, (_SLENDER * rod) ** 2 / 2
    centre = np.mean(joints, axis=0)
    radius = rms_radius(joints - centre)
    disc = radius**2 * np.array([1 / 4 + _THICK**2 / 12] * 2 + [1 / 2])
    # About a diameter the ring has as much as both rods about their axis.
    ring = (_STATOR + _SLIDER) / _SLIDER * along * np.array([1, 1, 2])
    half, thin = np.array([0, 0, rod / 2]), np.array([across, across, along])
    return {
        "ring": _body(_SLIDER * mass, np.zeros(3), ring),
        "stator": _body(_STATOR * mass, half, thin),
        "slider": _body(_SLIDER * mass, -half, thin),
        "platform": _body(mass, centre, disc),
    }


def assumed_friction(strut: float, weight: float, speed: float) -> dict[str, float]:
    """Return the friction of joints and actuators, SI.

    For the mean length of the struts, m, the weight on one actuator, N, and the speed at which
    viscous friction equals dry friction, m/s.
    """
    joint = _round_value(_JOINT_FRICTION * weight * strut)
    return {
        "r_alpha": joint,
        "r_beta": joint,
        **dict.fromkeys(actuator_names("r"), _round_value(_FRICTION * weight)),
        **dict.fromkeys(actuator_names("v"), _round_value(_FRICTION * weight / speed)),
    }


def _body(mass: float, centre: Array, per_mass: Array) -> BodyDescription:
    """Return a body from its inertia about its centre for 1 kg, m²."""
    return BodyDescription(
        mass=_round_value(mass),
        centre=tuple(_round_value(value) for value in centre),
        inertia=tuple(_round_value(mass * value) for value in per_mass),
    )


def _round_value(value: float) -> float:
    return round_digits(value, _DIGITS) if abs(value) > _NOTHING else 0.0
