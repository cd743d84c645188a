"""The terms of a robot's model and their parameters, as the robot file names them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache, partial
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, ValidationInfo, model_serializer
from pydantic_core import PydanticCustomError

from expdesign.configuration.errors import nearest, refusal, shown
from expdesign.configuration.fields import each_read, known, one_of
from expdesign.configuration.quantity import Inertia, Length, NotNegative, Positive, dimension_of
from expdesign.configuration.section import Section
from expdesign.mechanism.catalogue import DEFAULT, known_parameters, term_definitions, terms_named
from expdesign.mechanism.term import Constant, Parameter, Term, parameters_of
from expdesign.mechanism.terms import drive_inertia, rigid_platform

Thread = Literal["right", "left"]
_DIRECT = "direct"
_ALLOWED = f"{_DIRECT}, {{screw: {{lead: 5 mm, inertia: 6.3e-5}}}} or {{gear: {{lead: …}}}}"


class Gear(Section):
    """A motor that turns once for so much of a strut: a rack, a belt, a rope."""

    lead: Annotated[Length, Positive]
    """Of the strut in one turn of the motor, m."""
    inertia: Annotated[Inertia, NotNegative] | None = None
    """Of all that turns with the motor, about its axis, kg m²; None: not known."""

    @property
    def mass(self) -> float:
        """What the inertia is along the strut, kg; zero where it is not known."""
        return (self.inertia or 0.0) * (2 * math.pi / self.lead) ** 2


class Screw(Gear):
    """A motor on a screw or its nut."""

    thread: Annotated[Thread, one_of(Thread)] = "right"

    @property
    def signed_lead(self) -> float:
        """Lead, m per turn, below zero for a left-handed thread."""
        return self.lead if self.thread == "right" else -self.lead


class Drive(Section):
    """One kind of drive for all struts: a screw, a gear, or neither of them."""

    screw: Screw | None = None
    gear: Gear | None = None

    @property
    def geared(self) -> Gear | None:
        """The screw or gear; None: the drive moves the strut directly."""
        return self.screw or self.gear

    @model_serializer
    def _as_written(self) -> str | dict[str, Any]:
        if self.screw is not None:
            return {"screw": self.screw.model_dump()}
        return _DIRECT if self.gear is None else {"gear": self.gear.model_dump()}


def _drive(value: object) -> object:
    if isinstance(value, Drive):
        return value
    if isinstance(value, str) and value == _DIRECT:
        return {}
    if not isinstance(value, Mapping):
        raise refusal(f"{shown(value)} is no drive", _ALLOWED)
    if len(value) != 1:
        raise refusal(f"there are {len(value)} kinds of drive where one is needed", _ALLOWED)
    if None in value.values():
        raise refusal(f"nothing is told of the {next(iter(value))}", _ALLOWED)
    return value


DriveOrDirect = Annotated[Drive, BeforeValidator(_drive)]
DIRECT = Drive()


def known_parameter(value: object) -> str:
    """Check that a text is a parameter of some term, naming the nearest when it is not."""
    return known(tuple(known_parameters()), "parameter")(value)


ParameterName = Annotated[str, BeforeValidator(known_parameter)]


def parsed_parameter(name: str, value: object) -> float:
    """Convert what stands in a file to the parameter's SI unit.

    Raises
    ------
    pydantic_core.PydanticCustomError
        If it is no such quantity.
    """
    return dimension_of(known_parameters()[name].unit).parse(value)


class ConstantDescription(Section):
    """The value of a term's constant, SI, and whether it shall be estimated too."""

    value: float
    estimate: bool = False


class TermDescription(Section):
    """A term by its name in the catalogue, with the constants that it has."""

    name: str
    constants: dict[str, ConstantDescription] = Field(default_factory=dict)

    @model_serializer
    def _as_written(self) -> str | dict[str, Any]:
        if not self.constants:
            return self.name
        return {
            self.name: {
                key: constant.model_dump() if constant.estimate else constant.value
                for key, constant in self.constants.items()
            }
        }


def _terms(value: object, *, alone: bool = True) -> tuple[TermDescription, ...]:
    """Judge the list as a whole: each term once, constants of those that have them.

    Beside a robot's terms, which are not `alone`, some may take constants of these.
    """
    wanted = f"a list of terms: {', '.join(term_definitions())}"
    if not isinstance(value, list | tuple) or not value:
        raise refusal(f"{shown(value)} is no list of terms", wanted)
    found: dict[str, TermDescription] = {}
    for item in value:
        described = item if isinstance(item, TermDescription) else _term(item, wanted)
        if described.name in found:
            raise refusal(f"the term '{described.name}' is listed twice", "each one once")
        beside = term_definitions()[described.name].beside
        if alone and beside and beside not in found:
            reason = f"the term '{described.name}' takes the constants of '{beside}'"
            raise refusal(reason, f"{beside} listed before {described.name}")
        found[described.name] = described
    return tuple(found.values())


def _term(item: object, wanted: str) -> TermDescription:
    name: object = item
    given: object = {}
    if isinstance(item, Mapping) and len(item) == 1:
        ((name, given),) = item.items()
    if not isinstance(name, str) or name not in term_definitions():
        raise refusal(
            f"{shown(name)} is no term", wanted, partial(nearest, name, term_definitions())
        )
    if not isinstance(given, Mapping):
        raise refusal(f"{shown(given)} is no mapping of constants", "constants with their values")
    stated = {key: _constant(f"{name}.{key}", item) for key, item in given.items()}
    values = _quantities(
        {key: value for key, (value, _) in stated.items()},
        {constant.name: constant for constant in term_definitions()[name].constants},
        lambda key: f"the term {name} has no constant {shown(key)}",
        (name,),
    )
    constants = {
        key: ConstantDescription(value=value, estimate=key in stated and stated[key][1])
        for key, value in values.items()
    }
    return TermDescription(name=name, constants=constants)


def _constant(key: str, given: object) -> tuple[object, bool]:
    """Return what stands for the value, and whether the constant shall be estimated."""
    if not isinstance(given, Mapping):
        return given, False
    parts = ("value", "estimate")
    for part in given:
        if part not in parts:
            reason = f"a constant has no {shown(part)}"
            raise refusal(reason, ", ".join(parts), partial(nearest, part, parts), key=key)
    if "value" not in given:
        raise refusal("the value is missing", "{value: …, estimate: true}", key=key)
    estimate = given.get("estimate", False)
    if not isinstance(estimate, bool):
        raise refusal(f"{shown(estimate)} is no choice", "true, false", key=f"{key}.estimate")
    return given["value"], estimate


def _quantities(
    given: Mapping[str, object],
    expected: Mapping[str, Parameter | Constant],
    unknown: Callable[[str], str],
    place: tuple[str, ...] = (),
) -> dict[str, float]:
    """Return the values of exactly the names expected, SI; raise everything that is wrong."""

    def read(name: str, value: object) -> float:
        if name not in expected:
            allowed = ", ".join(expected) or "none"
            raise refusal(unknown(name), allowed, partial(nearest, name, expected))
        default = expected[name].default
        if value is None and default is not None:
            return default
        if name not in given:
            raise PydanticCustomError("missing", "the key is missing")
        number = dimension_of(expected[name].unit).parse(value)
        if isinstance(one := expected[name], Constant) and one.positive and number <= 0:
            raise refusal(f"{number:g} is not positive", "a value above 0")
        return number

    return each_read(dict.fromkeys(expected) | dict(given), read, place)


def whose(name: object) -> str:
    """Return, to be appended to a message, in which term a parameter is that a robot lacks."""
    for term in term_definitions().values():
        if name in {parameter.name for parameter in term.parameters}:
            kind = " with platform: general" if term is rigid_platform.GENERAL else ""
            return f": it belongs to the term {term.name}{kind}"
    return ""


Terms = Annotated[tuple[TermDescription, ...], BeforeValidator(_terms)]
FurtherTerms = Annotated[tuple[TermDescription, ...], BeforeValidator(partial(_terms, alone=False))]
"""Terms that come to those of a robot."""


@cache
def default_terms() -> tuple[TermDescription, ...]:
    """Return the terms of a robot whose file lists none."""
    return _terms(DEFAULT)


def chosen_terms(
    described: tuple[TermDescription, ...],
    platform: str,
    drive: Drive = DIRECT,
    *,
    turning: bool = False,
) -> tuple[Term, ...]:
    """Return the blocks that a robot file names, with its kind of platform.

    That of the inertia of a screw or gear comes before friction when it is not listed. `turning`
    screws are turned by the platform.
    """
    names = [term.name for term in described]
    if drive.geared is not None and drive_inertia.TERM.name not in names:
        first = next(
            (k for k, name in enumerate(names) if term_definitions()[name].rates), len(names)
        )
        names.insert(first, drive_inertia.TERM.name)
    return terms_named(names, general=platform == "general", turning=turning)


def _parameters(value: object, info: ValidationInfo) -> dict[str, float]:
    """Read exactly the parameters of the robot's terms, in their order."""
    if not isinstance(value, Mapping):
        raise refusal(f"{shown(value)} is not a mapping", "parameters with their values")
    if not {"terms", "platform", "drive", "bodies", "platform_joints"} <= set(info.data):
        return {}  # refused themselves: which parameters there are is not known
    drive = info.data["drive"]
    terms = chosen_terms(info.data["terms"], info.data["platform"], drive)
    follows = {} if drive.geared is None else {drive_inertia.MASS: drive.geared.mass}
    if (bodies := info.data["bodies"]) is not None:
        follows |= bodies.parameters(np.array(info.data["platform_joints"]))
    return _quantities(
        value,
        {p.name: replace(p, default=follows.get(p.name, p.default)) for p in parameters_of(terms)},
        lambda name: f"no term of this robot has the parameter {shown(name)}{whose(name)}",
    )


Parameters = Annotated[dict[str, float], BeforeValidator(_parameters)]
