"""`terms`, `drive` and `parameters` of a robot file: the terms of its model with their values."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, ValidationInfo, model_serializer, model_validator
from pydantic_core import PydanticCustomError

from expdesign.configuration.errors import nearest_name, quote, refusal
from expdesign.configuration.quantity import (
    ForceConstant,
    Inertia,
    Length,
    MotorConstant,
    NotNegative,
    Number,
    Positive,
    Resistance,
    Voltage,
    quantity_in,
)
from expdesign.configuration.schema import PerStrut, Section, check_choice, read_entries
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.term import Constant, Parameter, Term, parameters_of
from expdesign.mechanism.terms import (
    DEFAULT,
    known_parameters,
    rigid_platform,
    term_definitions,
    terms_named,
)
from expdesign.mechanism.terms.actuator_forces import DRIVE_INERTIA, DRIVE_MASS

# --- names and values of parameters ---------------------------------------------------------------


def check_parameter(value: object) -> str:
    """Return the name of a parameter of some term; refuse others with the nearest name."""
    return check_choice(known_parameters, "parameter")(value)


ParameterName = Annotated[str, BeforeValidator(check_parameter)]


def parse_parameter(name: str, value: object) -> float:
    """Convert a value of the file to the parameter's SI unit."""
    return quantity_in(known_parameters()[name].unit).parse(value)


def term_hint(name: object) -> str:
    """Return a suffix for a message about a parameter that a robot lacks: the term that has it."""
    for term in term_definitions().values():
        if name in {parameter.name for parameter in term.parameters}:
            kind = " with platform: general" if term is rigid_platform.GENERAL else ""
            return f": it belongs to the term {term.name}{kind}"
    return ""


# --- drive ----------------------------------------------------------------------------------------

Thread = Literal["right", "left"]


class Gear(Section):
    """A motor with a constant ratio of turn to strut length: a rack, a belt, a rope."""

    lead: Annotated[Length, Positive]
    """Travel of the strut in one turn of the motor, m."""
    inertia: Annotated[Inertia, NotNegative] | None = None
    """Inertia of all parts that turn with the motor, about its axis, kg m²; None: unknown."""

    @property
    def travel(self) -> float:
        """Travel of the strut in one turn of the motor, m."""
        return self.lead

    @property
    def mass(self) -> float:
        """Mass equivalent to the inertia along the strut, kg; zero for an unknown inertia."""
        return (self.inertia or 0.0) / self.torque_per_force**2

    @property
    def torque_per_force(self) -> float:
        """Torque of the motor per force along the strut, N m/N, and travel per angle, m/rad."""
        return self.travel / (2 * math.pi)


class Screw(Gear):
    """A motor on a screw or its nut, or a screw behind a gear."""

    lead: Annotated[Length, Positive]
    """Travel of the strut in one turn of the screw, m."""
    ratio: Annotated[Number, Positive] = 1.0
    """Turns of the motor in one turn of the screw."""
    thread: Thread = "right"

    @property
    def travel(self) -> float:
        """Travel of the strut in one turn of the motor, m."""
        return self.lead / self.ratio

    @property
    def signed_lead(self) -> float:
        """Lead, m per turn, negative for a left-handed thread."""
        return self.lead if self.thread == "right" else -self.lead


class Motor(Section):
    """Electric constants of the six motors, one value or six, for recordings of voltages."""

    constant: PerStrut[Annotated[MotorConstant, Positive]] | None = None
    """Torque per current, and voltage per angular speed, N m/A = V s."""
    force_constant: PerStrut[Annotated[ForceConstant, Positive]] | None = None
    """The same along the strut, N/A = V s/m, instead of `constant`."""
    resistance: PerStrut[Annotated[Resistance, Positive]]
    """Between the terminals, with that of the lines, ohm."""
    supply: Annotated[Voltage, Positive] | None = None
    """Voltage of the bridges, V, for recordings of duty cycles."""

    @model_validator(mode="after")
    def _check_constants(self) -> Motor:
        if (self.constant is None) == (self.force_constant is None):
            allowed = "constant in N m/A, or force_constant along the strut in N/A"
            raise refusal("a motor needs one of two constants", allowed, key="constant")
        return self


_ONES = (1.0,) * ACTUATORS


class Drive(Section):
    """The kind of drive of all struts: a screw, a gear, or a direct drive with neither."""

    screw: Screw | None = None
    gear: Gear | None = None
    motor: Motor | None = None
    """Electric constants; None: unknown."""

    @model_validator(mode="after")
    def _check_motor(self) -> Drive:
        if self.motor is not None and self.motor.constant is not None and self.geared is None:
            message = "a torque constant needs the lead of a screw or gear"
            allowed = "screw: {lead: …}, gear: {lead: …}, or force_constant in N/A"
            raise refusal(message, allowed, key="motor")
        return self

    @property
    def geared(self) -> Gear | None:
        """The screw or gear; None for a direct drive."""
        return self.screw or self.gear

    def length_of_turns(self, text: str) -> float | None:
        """Return the travel, m, in turns of the motor or screw; None for any other text.

        Examples
        --------
        >>> Drive(screw=Screw(lead="6 mm", ratio=3)).length_of_turns("1 rev")
        0.002
        >>> Drive(screw=Screw(lead="6 mm", ratio=3)).length_of_turns("1 screw rev")
        0.006
        """
        match = re.fullmatch(r"\s*(\S+?)\s*(screw\s+)?rev\s*", text)
        if match is None:
            return None
        gear = self.screw if match[2] else self.geared
        if gear is None:
            allowed = "a length, or turns with drive: {screw: {lead: …}} in the robot file"
            raise refusal(f"{quote(text)} needs the lead of the drive", allowed)
        return float(quantity_in("1").parse(match[1])) * (gear.lead if match[2] else gear.travel)

    @property
    def torque_per_force(self) -> float | None:
        """Torque of the motors per force, N m/N; None without a lead."""
        return None if self.geared is None else self.geared.torque_per_force

    def with_motors(
        self, other: Drive, constants: Sequence[float] = _ONES, resistances: Sequence[float] = _ONES
    ) -> Drive:
        """Return the drive with another one's motors, their constants multiplied by factors."""
        if other.motor is None or other.force_constants is None:
            return self
        pairs = (other.force_constants, constants), (other.motor.resistance, resistances)
        along, resistance = (tuple(a * b for a, b in zip(*each, strict=True)) for each in pairs)
        motor = Motor(force_constant=along, resistance=resistance, supply=other.motor.supply)
        return self.model_copy(update={"motor": motor})

    @property
    def force_constants(self) -> tuple[float, ...] | None:
        """Force K along each strut per current of its motor, N/A; None without a motor."""
        if self.motor is None:
            return None
        ratio = self.torque_per_force
        if self.motor.constant is None or ratio is None:
            return self.motor.force_constant
        return tuple(one / ratio for one in self.motor.constant)

    @property
    def forces_per_volt(self) -> tuple[float, ...]:
        """Force along each strut per voltage of its motor at rest, N/V: K/R; nan without one."""
        if self.motor is None or self.force_constants is None:
            return (math.nan,) * ACTUATORS
        pairs = zip(self.force_constants, self.motor.resistance, strict=True)
        return tuple(constant / resistance for constant, resistance in pairs)

    @property
    def back_emf(self) -> tuple[float, ...]:
        """Damping along each strut by the induced voltage, N s/m: K²/R; nan without a motor."""
        pairs = zip(self.force_constants or self.forces_per_volt, self.forces_per_volt, strict=True)
        return tuple(constant * per_volt for constant, per_volt in pairs)

    @property
    def supply(self) -> float:
        """Supply voltage of the motors, V; nan if it is not stated."""
        return self.motor.supply if self.motor and self.motor.supply else math.nan

    @model_serializer
    def _serialize(self) -> str | dict[str, Any]:
        parts = {"screw": self.screw, "gear": self.gear, "motor": self.motor}
        return {key: part.model_dump() for key, part in parts.items() if part} or _DIRECT


DIRECT = Drive()
_DIRECT = "direct"
_DRIVES = (
    f"{_DIRECT}, {{screw: {{lead: 5 mm, inertia: 6.3e-5}}}} or {{gear: {{lead: …}}}}, each also "
    "with motor: {constant: 0.05 N m/A, resistance: 1.2 ohm}"
)


def _read_drive(value: object) -> object:
    if isinstance(value, Drive):
        return value
    if value == _DIRECT:
        return {}
    if not isinstance(value, Mapping):
        raise refusal(f"{quote(value)} is not a drive", _DRIVES)
    kinds = len(set(value) - {"motor"})
    if kinds > 1 or not value:
        raise refusal(f"there are {kinds} kinds of drive where one is needed", _DRIVES)
    if None in value.values():
        raise refusal(f"the {next(iter(value))} has no lead", _DRIVES)
    return value


DriveOrDirect = Annotated[Drive, BeforeValidator(_read_drive)]

# --- terms ----------------------------------------------------------------------------------------


class ConstantDescription(Section):
    """Value of a term's constant, SI, and the choice to estimate it with the parameters."""

    value: float
    estimate: bool = False


class TermDescription(Section):
    """A term by its name in the catalogue, with its constants."""

    name: str
    constants: dict[str, ConstantDescription] = Field(default_factory=dict)

    @property
    def definition(self) -> Term:
        """The term of the catalogue."""
        return term_definitions()[self.name]

    def with_constants(self, values: Mapping[str, float], **changes: bool) -> Self:
        """Return the term with values of constants and changes of all of them."""
        constants = {
            key: one.model_copy(update={"value": values.get(key, one.value), **changes})
            for key, one in self.constants.items()
        }
        return self.model_copy(update={"constants": constants})

    @model_serializer
    def _serialize(self) -> str | dict[str, Any]:
        if not self.constants:
            return self.name
        return {
            self.name: {
                key: constant.model_dump() if constant.estimate else constant.value
                for key, constant in self.constants.items()
            }
        }


def _read_terms(
    value: object, *, complete: bool = True, drive: Drive | None = None
) -> tuple[TermDescription, ...]:
    """Read a list of terms; one that is complete has the terms that others take constants from.

    With a drive, lengths among the constants may be its turns.
    """
    if not isinstance(value, list | tuple) or not value:
        raise refusal(f"{quote(value)} is not a list of terms", _terms_allowed())
    found: dict[str, TermDescription] = {}
    for item in value:
        term = item if isinstance(item, TermDescription) else _read_term(item, drive)
        if term.name in found:
            raise refusal(f"the term '{term.name}' is listed twice", "each one once")
        partner = term.definition.constants_of
        if complete and partner and partner not in found:
            reason = f"the term '{term.name}' takes the constants of '{partner}'"
            raise refusal(reason, f"{partner} listed before {term.name}")
        found[term.name] = term
    return tuple(found.values())


def _read_term(item: object, drive: Drive | None) -> TermDescription:
    name: object = item
    given: object = {}
    if isinstance(item, Mapping) and len(item) == 1:
        ((name, given),) = item.items()
    terms = term_definitions()
    if not isinstance(name, str) or name not in terms:
        meant = partial(nearest_name, name, terms)
        raise refusal(f"{quote(name)} is not a term", _terms_allowed(), meant)
    if not isinstance(given, Mapping):
        reason = f"{quote(given)} is not a mapping of constants"
        raise refusal(reason, "constants with their values")
    stated = {key: _read_constant(f"{name}.{key}", item) for key, item in given.items()}
    values = _read_quantities(
        {key: value for key, (value, _) in stated.items()},
        {constant.name: constant for constant in terms[name].constants},
        lambda key: f"the term {name} has no constant {quote(key)}",
        (name,),
        drive,
    )
    constants = {
        key: ConstantDescription(value=value, estimate=key in stated and stated[key][1])
        for key, value in values.items()
    }
    return TermDescription(name=name, constants=constants)


def _terms_allowed() -> str:
    return f"a list of terms: {', '.join(term_definitions())}"


def _read_constant(key: str, given: object) -> tuple[object, bool]:
    """Return the value as in the file, and the choice to estimate the constant."""
    if not isinstance(given, Mapping):
        return given, False
    parts = ("value", "estimate")
    for part in given:
        if part not in parts:
            meant = partial(nearest_name, part, parts)
            raise refusal(f"a constant has no {quote(part)}", ", ".join(parts), meant, key)
    if "value" not in given:
        raise refusal("the value is missing", "{value: …, estimate: true}", key=key)
    estimate = given.get("estimate", False)
    if not isinstance(estimate, bool):
        reason = f"{quote(estimate)} is not a valid choice"
        raise refusal(reason, "true, false", key=f"{key}.estimate")
    return given["value"], estimate


def _read_quantities(
    given: Mapping[str, object],
    expected: Mapping[str, Parameter | Constant],
    unknown: Callable[[str], str],
    place: tuple[str, ...] = (),
    drive: Drive | None = None,
) -> dict[str, float]:
    """Return the values of exactly the expected names, SI; raise all problems together."""

    def read(name: str, value: object) -> float:
        if name not in expected:
            allowed = ", ".join(expected) or "none"
            raise refusal(unknown(name), allowed, partial(nearest_name, name, expected))
        one = expected[name]
        if value is None and one.default is not None:
            return one.default
        if name not in given:
            raise PydanticCustomError("missing", "the key is missing")
        number = None
        if drive is not None and one.unit == "m" and isinstance(value, str):
            number = drive.length_of_turns(value)
        if number is None:
            number = quantity_in(one.unit).parse(value)
        if isinstance(one, Constant) and one.positive and number <= 0:
            raise refusal(f"{number:g} is not positive", "a value above 0")
        return number

    return read_entries(dict.fromkeys(expected) | dict(given), read, place)


def _read_terms_of_robot(value: object, info: ValidationInfo) -> tuple[TermDescription, ...]:
    return _read_terms(value, drive=info.data.get("drive"))


Terms = Annotated[tuple[TermDescription, ...], BeforeValidator(_read_terms_of_robot)]
FurtherTerms = Annotated[
    tuple[TermDescription, ...], BeforeValidator(partial(_read_terms, complete=False))
]
"""Terms in addition to those of a robot."""


def default_terms() -> tuple[TermDescription, ...]:
    """Return the terms of a robot file without `terms`."""
    return _read_terms(DEFAULT)


def chosen_terms(
    described: Sequence[TermDescription],
    platform: str,
    drive: Drive = DIRECT,
    *,
    turning: bool = False,
) -> tuple[Term, ...]:
    """Return the terms of a robot's model, in the order of the regressor's columns.

    A screw or gear adds the term of its inertia before the first term with friction, unless the
    file lists it. `turning` screws are turned by the platform.
    """
    names = [term.name for term in described]
    if drive.geared is not None and DRIVE_INERTIA.name not in names:
        friction = (k for k, term in enumerate(described) if term.definition.is_friction)
        names.insert(next(friction, len(names)), DRIVE_INERTIA.name)
    return terms_named(names, general=platform == "general", turning=turning)


def insert_terms(
    own: Sequence[TermDescription], added: Sequence[TermDescription]
) -> tuple[TermDescription, ...]:
    """Return a robot's terms with further ones in their places.

    Terms without dry friction precede the first with it, since they contribute to the actuators'
    load; a term follows the one whose constants it takes.
    """
    found = list(own)
    for term in sorted(added, key=lambda one: one.definition.is_friction):
        names, place = [one.name for one in found], len(found)
        if not term.definition.is_friction:
            place = next((k for k, one in enumerate(found) if one.definition.is_friction), place)
        if (partner := term.definition.constants_of) in names:
            place = max(place, names.index(partner) + 1)
        found.insert(place, term)
    return tuple(found)


# --- parameters -----------------------------------------------------------------------------------


def _read_parameters(value: object, info: ValidationInfo) -> dict[str, float]:
    """Read exactly the parameters of the robot's terms, in their order."""
    if not isinstance(value, Mapping):
        raise refusal(f"{quote(value)} is not a mapping", "parameters with their values")
    if not {"terms", "platform", "drive", "bodies", "platform_joints"} <= set(info.data):
        return {}  # these keys are refused: the parameters of the robot are unknown
    drive = info.data["drive"]
    terms = chosen_terms(info.data["terms"], info.data["platform"], drive)
    implied = {} if drive.geared is None else {DRIVE_MASS: drive.geared.mass}
    if (bodies := info.data["bodies"]) is not None:
        implied |= bodies.parameters(np.array(info.data["platform_joints"]))
    return _read_quantities(
        value,
        {p.name: replace(p, default=implied.get(p.name, p.default)) for p in parameters_of(terms)},
        lambda name: f"no term of this robot has the parameter {quote(name)}{term_hint(name)}",
    )


Parameters = Annotated[dict[str, float], BeforeValidator(_read_parameters)]
