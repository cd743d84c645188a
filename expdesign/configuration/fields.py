"""Validators of what is no physical quantity: names, whole numbers, choices, mappings, lists."""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from functools import partial
from typing import Annotated, Any, Literal, get_args

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    PlainSerializer,
    Tag,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError

from constraints.arrays import Array
from expdesign.configuration.errors import nearest, refusal, require, shown
from expdesign.configuration.quantity import Angle, Force, Length, Number
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATE_NAMES, COORDINATES

_NAME = re.compile(r"[A-Za-z0-9._-]+")
LONGEST_NAME = 100
_LARGEST_WHOLE = 2**63 - 1
_LARGEST_COUNT = 100_000


def _name(value: object) -> str:
    allowed = "letters, digits, '.', '_' and '-'"
    if not isinstance(value, str):
        raise refusal(f"{shown(value)} is no text; put a name in quotes", allowed)
    if not _NAME.fullmatch(value) or value.strip(".") == "":
        raise refusal(f"{shown(value)} is not a name", allowed)
    if len(value) > LONGEST_NAME:
        raise refusal(
            f"a name of {len(value)} characters is too long", f"{LONGEST_NAME} characters"
        )
    return value


def _text(value: object) -> str:
    if not isinstance(value, str):
        raise refusal(f"{shown(value)} is no text", "text; put it in quotes")
    return value


Name = Annotated[str, BeforeValidator(_name)]
"""A name that is safe as a folder on every system."""
Text = Annotated[str, BeforeValidator(_text)]
FilledText = Annotated[Text, require(str.strip, "the text is empty", "a text")]


def whole(minimum: int | None, maximum: int | None = _LARGEST_COUNT) -> BeforeValidator:
    """Return a validator for whole numbers; booleans, texts and fractions are refused.

    A bound that is None follows from other keys, and is told where these are known: by the section,
    or by `expdesign.configuration.sizes`.
    """
    least = -_LARGEST_WHOLE if minimum is None else minimum
    most = _LARGEST_WHOLE if maximum is None else maximum
    bounds = "" if minimum is None else f" of {minimum} or more, as memory allows"
    if minimum is not None and maximum is not None:
        bounds = f" from {minimum} to {maximum}"

    def check(value: object) -> int:
        allowed = f"a whole number{bounds}"
        if isinstance(value, bool) or not isinstance(value, int):
            if isinstance(value, float) and value.is_integer():
                allowed += ", written without point and exponent"
            raise refusal(f"{shown(value)} is not a whole number", allowed)
        if not least <= value <= most:
            raise refusal(f"{shown(value)} is out of range", allowed)
        return value

    return BeforeValidator(check)


Sized = Annotated[int, whole(1, None)]
"""How many there may be at most follows from what they take."""
Seed = Annotated[int, whole(0, _LARGEST_WHOLE)]


def known(
    choices: Sequence[str] | Callable[[], Iterable[str]], kind: str
) -> Callable[[object], str]:
    """Return a check that a text is one of the choices, which names the nearest when it is not."""

    def check(value: object) -> str:
        names = tuple(choices() if callable(choices) else choices)
        if not isinstance(value, str) or value not in names:
            allowed = " | ".join(names)
            raise refusal(
                f"{shown(value)} is not a {kind}", allowed, partial(nearest, value, names)
            )
        return value

    return check


def one_of(choice: Any, kind: str = "choice") -> BeforeValidator:
    """Return a validator for the texts of a `Literal`, or for those given in a tuple."""
    return BeforeValidator(known(choice if isinstance(choice, tuple) else get_args(choice), kind))


def word_for_none(
    word: str, otherwise: BeforeValidator | WrapValidator
) -> tuple[WrapValidator, PlainSerializer]:
    """Return validator and serializer of a value that is None in Python and a word in the file."""
    accepted: Callable[..., Any] = otherwise.func

    def check(value: object, handler: ValidatorFunctionWrapHandler) -> Any:
        if isinstance(value, str) and value == word:
            return None
        try:
            if isinstance(otherwise, WrapValidator):
                return accepted(value, handler)
            read = accepted(value)
        except PydanticCustomError as error:
            found = error.context or {}
            allowed = f"{word}, or {found['allowed']}"
            raise refusal(error.message(), allowed, found["nearest"]) from None
        return handler(read)

    return WrapValidator(check), PlainSerializer(lambda value: word if value is None else value)


def word_or(word: str, otherwise: BeforeValidator) -> BeforeValidator:
    """Return a validator that lets a word through, and anything else if the other one does."""
    accepted: Callable[..., Any] = otherwise.func

    def check(value: object) -> Any:
        if isinstance(value, str) and value == word:
            return value
        try:
            return accepted(value)
        except PydanticCustomError as error:
            allowed = f"{word}, or {(error.context or {})['allowed']}"
            meant = partial(nearest, value, (word,))
            raise refusal(error.message(), allowed, meant) from None

    return BeforeValidator(check)


def by_key(
    read: Callable[[str, Any], Any], wanted: str, name: Callable[[object], str] = str
) -> BeforeValidator:
    """Return a validator of a mapping that reads key by key, and refuses all that is wrong.

    `name` checks a key before it is read.
    """

    def check(value: object) -> dict[str, Any]:
        if value is None:
            return {}
        if not isinstance(value, dict):
            raise refusal(f"{shown(value)} is not a mapping", wanted)
        return each_read(value, lambda key, item: read(name(key), item))

    return BeforeValidator(check)


def each_read(
    given: Mapping[str, Any], read: Callable[[str, Any], Any], place: tuple[str, ...] = ()
) -> dict[str, Any]:
    """Return what `read` makes of each entry of a mapping; raise everything that is wrong."""
    found: dict[str, Any] = {}
    problems: list[InitErrorDetails] = []
    for key, item in given.items():
        try:
            found[key] = read(key, item)
        except PydanticCustomError as error:
            problems.append({"type": error, "loc": (*place, key), "input": item})
    if problems:
        raise ValidationError.from_exception_data("mapping", problems)
    return found


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
    wanted = f"a list of {count} {what}"

    def check(value: object) -> Sequence[Any]:
        return _counted(_listed(value, wanted + _as_pair(value, count)), count, what, wanted)

    return BeforeValidator(check)


def _counted(items: Sequence[Any], count: int, what: str, wanted: str) -> Sequence[Any]:
    if len(items) != count:
        raise refusal(f"there are {len(items)} {what} where {count} are needed", wanted)
    return items


def per_strut(what: str) -> WrapValidator:
    """Return a validator for one value for all struts, or a list with one for each.

    What is wrong with one value for all is said once.
    """
    wanted = f"one of the {what} for all struts, or a list of {ACTUATORS}"

    def check(value: object, handler: ValidatorFunctionWrapHandler) -> Any:
        if isinstance(value, list | tuple):
            return handler(_counted(value, ACTUATORS, what, wanted))
        try:
            (one,) = handler([value])
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            found = first.get("ctx", {})
            allowed, meant = found.get("allowed", wanted), found.get("nearest")
            raise refusal(found.get("reason", first["msg"]), allowed, meant) from None
        return (one,) * ACTUATORS

    return WrapValidator(check)


def at_least(count: int, what: str, most: int = 100) -> BeforeValidator:
    """Return a validator for a list of `count` items or more, up to a number that is enough."""

    def check(value: object) -> Sequence[Any]:
        wanted = f"a list of {count} or more {what}"
        items = _listed(value, wanted)
        if len(items) > most:
            raise refusal(f"the list has {len(items)} {what}", f"{most} at most")
        if len(items) < count:
            raise refusal(f"the list has {len(items)} {what}", wanted)
        return items

    return BeforeValidator(check)


def _distinct(items: tuple[Hashable, ...]) -> tuple[Hashable, ...]:
    seen = set[Hashable]()
    for item in items:
        if item in seen:
            raise refusal(f"{shown(item)} is listed twice", "each one once")
        seen.add(item)
    return items


Distinct = AfterValidator(_distinct)


def _ascending(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] > pair[1]:
        raise refusal(f"min {pair[0]:g} is above max {pair[1]:g}", "[min, max] with min ≤ max")
    return pair


Ascending = AfterValidator(_ascending)
Pair: BeforeValidator = exactly(_ENDS, "values [min, max]")

Point = Annotated[tuple[Length, ...], exactly(3, "coordinates [x, y, z]")]
Direction = Annotated[
    tuple[Number, ...],
    exactly(3, "components [x, y, z]"),
    require(any, "the vector is zero", "a direction [x, y, z]"),
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
