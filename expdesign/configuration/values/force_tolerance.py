"""A tolerance on forces: so many newtons, or a share of the range that a force has."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import BeforeValidator, PlainSerializer

from expdesign.configuration.problem import refusal, shown
from expdesign.configuration.values.quantity import FORCE, SHARE

_ALLOWED = 'a force above 0 such as "5 N", or a share of the range such as "3 %", 100 % at most'


@dataclass(frozen=True)
class ForceTolerance:
    """An error that is good enough."""

    value: float
    relative: bool
    """The value is a share of the range, and no force in N."""

    def force(self, span: float) -> float:
        """Return it in N for a force that has this range, N."""
        return self.value * span if self.relative else self.value

    @property
    def text(self) -> str:
        """As a user writes it."""
        return f"{100 * self.value:.15g} %" if self.relative else f"{self.value:.15g} N"


def _read(value: object) -> ForceTolerance | None:
    if value is None or isinstance(value, ForceTolerance):
        return value
    relative = isinstance(value, str) and value.rstrip().endswith("%")
    try:
        number = (SHARE if relative else FORCE).parse(value)
    except ValueError as error:
        raise refusal(f"{shown(value)} is no tolerance of a force", _ALLOWED) from error
    if number <= 0:
        raise refusal(f"{shown(value)} is not positive", _ALLOWED)
    if relative and number > 1:
        raise refusal(f"{shown(value)} is more than the whole range of the force", _ALLOWED)
    return ForceTolerance(number, relative)


ToleranceOfForce = Annotated[
    ForceTolerance | None,
    BeforeValidator(_read),
    PlainSerializer(lambda found: None if found is None else found.text),
]
"""None: there is none."""
