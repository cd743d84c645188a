"""`drive` of the robot file: what moves a strut, and the mass that its inertia makes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, model_serializer

from expdesign.configuration.problem import refusal, shown
from expdesign.configuration.section import Section
from expdesign.configuration.values.quantity import Inertia, Length, NotNegative, Positive
from expdesign.configuration.values.scalars import one_of

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
