"""How the axes of a controller, or the channels of a file, belong to the struts."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Discriminator, Tag

from expdesign.configuration.problem import refusal, shown
from expdesign.configuration.values.quantity import Force, Length
from expdesign.configuration.values.scalars import exactly, per_strut, whole
from expdesign.mechanism.hexapod import ACTUATORS


def _order(value: tuple[int, ...]) -> tuple[int, ...]:
    if sorted(value) != list(range(1, ACTUATORS + 1)):
        raise refusal(
            f"{list(value)} is no order of the {ACTUATORS} struts",
            f"the numbers 1 to {ACTUATORS}, each once: the strut on the first axis comes first",
        )
    return value


def _sign(value: object) -> object:
    if isinstance(value, bool) or value not in (1, -1):
        raise refusal(f"{shown(value)} is not a sign", "1 or -1")
    return value


def _home_or_lengths(value: object) -> str:
    return "(name)" if value == "home" else "(inline)"


Order = Annotated[
    tuple[Annotated[int, whole(1, ACTUATORS)], ...],
    exactly(ACTUATORS, "numbers of struts"),
    AfterValidator(_order),
]
"""Number of the strut on each axis."""

Signs = Annotated[tuple[Annotated[int, BeforeValidator(_sign)], ...], per_strut("signs")]
"""Of the struts by their number: 1 or −1."""

Offsets = Annotated[
    Annotated[Literal["home"], Tag("(name)")]
    | Annotated[tuple[Length, ...], per_strut("offsets"), Tag("(inline)")],
    Discriminator(_home_or_lengths),
]
"""Lengths, m, at which the axes of the struts read zero; ``"home"``: the lengths at home."""

ForceOffsets = Annotated[tuple[Force, ...], per_strut("offsets")]
"""Forces of the struts, N, at which their channels read zero."""
