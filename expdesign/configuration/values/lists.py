"""Lists of values: validators of their length, points and poses; arrays that stay as they are."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BeforeValidator

from constraints.arrays import Array
from expdesign.configuration.problem import refusal, shown
from expdesign.configuration.values.quantity import Angle, Length, Number
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATE_NAMES, COORDINATES

_ENDS = 2
_LONGEST_EXAMPLE = 20


def _listed(value: object, wanted: str) -> Sequence[Any]:
    if not isinstance(value, list | tuple):
        raise refusal(f"{shown(value)} is not a list", wanted)
    return value


def _as_pair(value: object, count: int) -> str:
    """Return how a single value is written where two are wanted: both ends alike."""
    one = isinstance(value, str | int | float) and not isinstance(value, bool)
    text = shown(value).strip("'")
    if count != _ENDS or not one or len(text) > _LONGEST_EXAMPLE:
        return ""
    return f"; to fix it: [{text}, {text}]"


def exactly(count: int, what: str) -> BeforeValidator:
    """Return a validator for a list of `count` items, which `what` describes in the plural."""

    def check(value: object) -> Sequence[Any]:
        wanted = f"a list of {count} {what}"
        items = _listed(value, wanted + _as_pair(value, count))
        if len(items) != count:
            raise refusal(f"there are {len(items)} {what} where {count} are needed", wanted)
        return items

    return BeforeValidator(check)


def per_strut(what: str) -> BeforeValidator:
    """Return a validator for one value for all struts, or a list with one for each."""

    def check(value: object) -> Sequence[Any]:
        if not isinstance(value, list | tuple):
            return [value] * ACTUATORS
        if len(value) != ACTUATORS:
            raise refusal(
                f"there are {len(value)} {what} where {ACTUATORS} are needed",
                f"one of the {what} for all struts, or a list of {ACTUATORS}",
            )
        return value

    return BeforeValidator(check)


def at_least(count: int, what: str) -> BeforeValidator:
    """Return a validator for a list of `count` items or more."""

    def check(value: object) -> Sequence[Any]:
        wanted = f"a list of {count} or more {what}"
        items = _listed(value, wanted)
        if len(items) < count:
            raise refusal(f"the list has {len(items)} {what}", wanted)
        return items

    return BeforeValidator(check)


def _distinct(items: tuple[Hashable, ...]) -> tuple[Hashable, ...]:
    for position, item in enumerate(items):
        if item in items[:position]:
            raise refusal(f"{shown(item)} is listed twice", "each one once")
    return items


Distinct = AfterValidator(_distinct)


def _ascending(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] > pair[1]:
        raise refusal(f"min {pair[0]:g} is above max {pair[1]:g}", "[min, max] with min ≤ max")
    return pair


Ascending = AfterValidator(_ascending)

Pair: BeforeValidator = exactly(_ENDS, "values [min, max]")


def _not_zero(vector: tuple[float, ...]) -> tuple[float, ...]:
    if not any(vector):
        raise refusal("the vector is zero", "a direction [x, y, z]")
    return vector


Point = Annotated[tuple[Length, ...], exactly(3, "coordinates [x, y, z]")]
Direction = Annotated[
    tuple[Number, ...], exactly(3, "components [x, y, z]"), AfterValidator(_not_zero)
]
"""A vector of any length but zero."""
Pose = Annotated[
    tuple[Length, Length, Length, Angle, Angle, Angle],
    exactly(COORDINATES, f"coordinates [{', '.join(COORDINATE_NAMES)}]"),
]


def read_only(values: object) -> Array:
    """Return a copy of the values as an array of floats that cannot be written to."""
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    return array
