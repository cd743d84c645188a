"""Validators of what is no physical quantity: names, counts, choices and lists of fixed length."""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Sequence
from typing import Annotated, Any, get_args

from pydantic import AfterValidator, BeforeValidator

from expdesign.configuration.failure import nearest, refusal, shown

_NAME = re.compile(r"[A-Za-z0-9._-]+")
_LONGEST_NAME = 100
_LARGEST_SEED = 2**63 - 1
_ENDS = 2
_LONGEST_EXAMPLE = 20


def _name(value: object) -> str:
    allowed = "letters, digits, '.', '_' and '-'"
    if not isinstance(value, str):
        raise refusal(f"{shown(value)} is no text; put a name in quotes", allowed)
    if not _NAME.fullmatch(value) or value.strip(".") == "":
        raise refusal(f"{shown(value)} is not a name", allowed)
    if len(value) > _LONGEST_NAME:
        raise refusal(
            f"a name of {len(value)} characters is too long", f"{_LONGEST_NAME} characters"
        )
    return value


def _text(value: object) -> str:
    if not isinstance(value, str):
        raise refusal(f"{shown(value)} is no text", "text; put it in quotes")
    return value


def _filled(value: str) -> str:
    if not value.strip():
        raise refusal("the text is empty", "a text")
    return value


Name = Annotated[str, BeforeValidator(_name)]
"""A name that is safe as a folder on every system."""

Text = Annotated[str, BeforeValidator(_text)]
FilledText = Annotated[Text, AfterValidator(_filled)]


def whole(minimum: int, maximum: int) -> BeforeValidator:
    """Return a validator for whole numbers; booleans, texts and fractions are refused."""

    def check(value: object) -> int:
        allowed = f"a whole number from {minimum} to {maximum}"
        if isinstance(value, bool) or not isinstance(value, int):
            raise refusal(f"{shown(value)} is not a whole number", allowed)
        if not minimum <= value <= maximum:
            raise refusal(f"{shown(value)} is out of range", allowed)
        return value

    return BeforeValidator(check)


Seed = Annotated[int, whole(0, _LARGEST_SEED)]


def one_of(choice: Any) -> BeforeValidator:
    """Return a validator that admits a `Literal`'s texts, or those given, and names the nearest."""
    choices: tuple[str, ...] = choice if isinstance(choice, tuple) else get_args(choice)
    allowed = " | ".join(choices)

    def check(value: object) -> str:
        if not isinstance(value, str) or value not in choices:
            raise refusal(f"{shown(value)} is not a choice", allowed, nearest(value, choices))
        return value

    return BeforeValidator(check)


def _sequence(value: object, wanted: str) -> Sequence[Any]:
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
        items = _sequence(value, wanted + _as_pair(value, count))
        if len(items) != count:
            raise refusal(f"there are {len(items)} {what} where {count} are needed", wanted)
        return items

    return BeforeValidator(check)


def one_or_six(what: str) -> BeforeValidator:
    """Return a validator for one value for all struts or a list of six, one per strut."""

    def check(value: object) -> Sequence[Any]:
        if isinstance(value, list | tuple):
            if len(value) != 6:  # noqa: PLR2004 - the struts of a hexapod
                raise refusal(
                    f"there are {len(value)} {what} where 6 are needed", f"one of the {what} or six"
                )
            return value
        return [value] * 6

    return BeforeValidator(check)


def at_least(count: int, what: str) -> BeforeValidator:
    """Return a validator for a list of `count` items or more."""

    def check(value: object) -> Sequence[Any]:
        wanted = f"a list of {count} or more {what}"
        items = _sequence(value, wanted)
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

Pair: BeforeValidator = exactly(2, "values [min, max]")


def known_key(valid: Sequence[str], kind: str) -> Callable[[object], str]:
    """Return a check that a text is one of the valid names, naming the nearest when it is not."""

    def check(value: object) -> str:
        if not isinstance(value, str) or value not in valid:
            raise refusal(f"{shown(value)} is no {kind}", ", ".join(valid), nearest(value, valid))
        return value

    return check
