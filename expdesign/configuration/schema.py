"""Schema of YAML files: sections as pydantic models, their validation, and types of keys."""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeVar, get_args

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    PlainSerializer,
    Tag,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)
from pydantic_core import ErrorDetails, InitErrorDetails, PydanticCustomError

from constraints.arrays import Array
from expdesign.configuration.document import Document
from expdesign.configuration.errors import (
    MOST_REPORTED,
    InputError,
    Key,
    Problem,
    nearest_name,
    quote,
    refusal,
    remaining_problems,
    require,
    value_problem,
)
from expdesign.configuration.quantity import Angle, Force, Length, Number, Positive
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATE_NAMES, COORDINATES


class Section(BaseModel):
    """A mapping of the YAML with a fixed set of keys; frozen, plain data in SI units."""

    model_config = ConfigDict(extra="forbid", frozen=True, protected_namespaces=())


class StageSection(Section):
    """Section of a stage from a plug-in; the key of the run file is a class variable."""

    key: ClassVar[str]


RESOLVED = object()
"""Mark of a key in resolved configurations only; messages do not offer it."""


@dataclass(frozen=True)
class ShortForm:
    """Mark of a key with a shorter notation, a section that the key's validator converts."""

    section: type[BaseModel]


Model = TypeVar("Model", bound=BaseModel)
_TAGS = ("[key]", "(inline)", "(name)", "(names)")
"""Steps of pydantic's locations that are not keys of the document."""


def validate(model: type[Model], data: object, document: Document, prefix: Key = ()) -> Model:
    """Validate the value at a key of a document; refuse it with all of its problems."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        found = error.errors(include_url=False)
        problems = [_problem(model, one, document, prefix) for one in found[:MOST_REPORTED]]
        more = remaining_problems(len(found) - MOST_REPORTED)
        raise InputError([*problems, *more]) from None


def _problem(
    model: type[BaseModel], details: ErrorDetails, document: Document, prefix: Key
) -> Problem:
    kind = details["type"]
    if kind == "extra_forbidden":
        # The last step is the user's key, even one that is spelt like a tag.
        *steps, name = details["loc"]
        location = tuple(step for step in steps if step not in _TAGS)
        valid = offered_keys(_model_at(model, location))
        key, meant = (*prefix, *location, name), nearest_name(name, valid)
        return document.problem(key, f"unknown key {quote(name)}", ", ".join(valid), meant)
    location = tuple(step for step in details["loc"] if step not in _TAGS)
    key = (*prefix, *location)
    if kind == "missing":
        return document.problem(key, f"the key '{location[-1]}' is missing")
    if kind in ("model_type", "model_attributes_type"):
        valid = offered_keys(_model_at(model, location))
        message = f"{quote(details['input'])} is not a mapping"
        return document.problem(key, message, f"the keys {', '.join(valid)}")
    if kind == "refused" and (inner := details["ctx"]["key"]):
        key = (*key, inner)
    return document.problem(key, *value_problem(details))


def offered_keys(model: type[BaseModel]) -> list[str]:
    """Return the keys that a user may write, in alphabetical order."""
    fields = model.model_fields.items()
    return sorted(info.alias or name for name, info in fields if RESOLVED not in info.metadata)


def _model_at(model: type[BaseModel], location: Key) -> type[BaseModel]:
    """Return the section at a location of the data."""
    for step in location:
        for name, info in model.model_fields.items():
            if step == (info.alias or name):
                short = (mark.section for mark in info.metadata if isinstance(mark, ShortForm))
                model = next(chain(_sections(info.annotation), short), model)
    return model


def _sections(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _sections(argument)


# --- texts and choices ----------------------------------------------------------------------------

LONGEST_NAME = 100
_NAME = re.compile(r"[A-Za-z0-9._-]+")


def _check_name(value: object) -> str:
    allowed = "letters, digits, '.', '_' and '-'"
    if not isinstance(value, str):
        raise refusal(f"{quote(value)} is not a text; put a name in quotes", allowed)
    if not _NAME.fullmatch(value) or value.strip(".") == "":
        raise refusal(f"{quote(value)} is not a name", allowed)
    if len(value) > LONGEST_NAME:
        message = f"a name of {len(value)} characters is too long"
        raise refusal(message, f"{LONGEST_NAME} characters")
    return value


Name = Annotated[str, BeforeValidator(_check_name)]
"""A name that is also a valid folder name."""
FilledText = Annotated[str, require(str.strip, "the text is empty", "a text")]


def check_choice(
    choices: Sequence[str] | Callable[[], Iterable[str]], kind: str
) -> Callable[[object], str]:
    """Return a check of a text against choices, or against those that a function returns."""

    def check(value: object) -> str:
        names = tuple(choices() if callable(choices) else choices)
        if not isinstance(value, str) or value not in names:
            message, allowed = f"{quote(value)} is not a {kind}", " | ".join(names)
            raise refusal(message, allowed, partial(nearest_name, value, names))
        return value

    return check


def one_of(
    choices: Sequence[str] | Callable[[], Iterable[str]], kind: str = "choice"
) -> BeforeValidator:
    """Return a validator for the texts of a tuple, or from a function."""
    return BeforeValidator(check_choice(choices, kind))


def word_for_none(
    word: str, otherwise: BeforeValidator | WrapValidator
) -> tuple[WrapValidator, PlainSerializer]:
    """Return validator and serializer of a value that is None in Python and a word in the file."""
    accepted: Callable[..., Any] = otherwise.func

    def check(value: object, handler: ValidatorFunctionWrapHandler) -> Any:
        if value == word:
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
    """Return a validator that accepts a word, and other values as another validator does."""
    accepted: Callable[..., Any] = otherwise.func

    def check(value: object) -> Any:
        if value == word:
            return value
        try:
            return accepted(value)
        except PydanticCustomError as error:
            allowed = f"{word}, or {(error.context or {})['allowed']}"
            meant = partial(nearest_name, value, (word,))
            raise refusal(error.message(), allowed, meant) from None

    return BeforeValidator(check)


# --- whole numbers --------------------------------------------------------------------------------

LARGEST_COUNT = 1_000_000
MOST_SAMPLES = 4_000_000
"""Samples of one recording: four gigabytes with spectra and all channels."""
MOST_ROWS = 1_000_000
"""Rows of one table: four gigabytes."""
_LARGEST_WHOLE = 2**63 - 1


def whole(minimum: int, maximum: int = LARGEST_COUNT) -> BeforeValidator:
    """Return a validator for whole numbers; booleans, texts and fractions are refused."""

    def check(value: object) -> int:
        allowed = f"a whole number from {minimum} to {maximum}"
        if isinstance(value, bool) or not isinstance(value, int):
            if isinstance(value, float) and value.is_integer():
                allowed += ", written without point and exponent"
            raise refusal(f"{quote(value)} is not a whole number", allowed)
        if not minimum <= value <= maximum:
            raise refusal(f"{quote(value)} is out of range", allowed)
        return value

    return BeforeValidator(check)


def require_at_most(
    count: float, most: int, content: str, file: Path | None = None, key: str = ""
) -> None:
    """Refuse a computation with more samples or rows than memory holds.

    Examples
    --------
    >>> require_at_most(10, MOST_SAMPLES, "10 periods of 1 s at 1 Hz")
    """
    if count > most:
        message = f"{content}: {count:.4g} samples are too many"
        raise InputError(message, file, key=key, allowed=f"{most} at most")


Count = Annotated[int, whole(1)]
Seed = Annotated[int, whole(0, _LARGEST_WHOLE)]

# --- mappings -------------------------------------------------------------------------------------


def by_key(
    read: Callable[[str, Any], Any], wanted: str, check_key: Callable[[object], str] = str
) -> BeforeValidator:
    """Return a validator of a mapping that reads each entry and reports all problems."""

    def check(value: object) -> dict[str, Any]:
        if value is None:
            return {}
        if not isinstance(value, dict):
            raise refusal(f"{quote(value)} is not a mapping", wanted)
        return read_entries(value, lambda key, item: read(check_key(key), item))

    return BeforeValidator(check)


def read_entries(
    given: Mapping[str, Any], read: Callable[[str, Any], Any], place: tuple[str, ...] = ()
) -> dict[str, Any]:
    """Return a mapping with the results of `read`; raise all problems together."""
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


# --- lists ----------------------------------------------------------------------------------------

_ENDS = 2
_LONGEST_EXAMPLE = 20


def exactly(count: int, items: str) -> BeforeValidator:
    """Return a validator for a list of `count` items, a noun in the plural."""
    wanted = f"a list of {count} {items}"

    def check(value: object) -> Sequence[Any]:
        if isinstance(value, list | tuple):
            return _counted(value, count, items, wanted)
        text, hint = quote(value).strip("'"), ""
        if count == _ENDS and len(text) <= _LONGEST_EXAMPLE and not isinstance(value, bool):
            hint = f"; to fix it: [{text}, {text}]" if isinstance(value, str | int | float) else ""
        raise refusal(f"{quote(value)} is not a list", wanted + hint)

    return BeforeValidator(check)


def _counted(found: Sequence[Any], count: int, items: str, wanted: str) -> Sequence[Any]:
    if len(found) != count:
        raise refusal(f"there are {len(found)} {items} where {count} are needed", wanted)
    return found


def at_least(count: int, items: str, most: int = 100) -> BeforeValidator:
    """Return a validator for a list of `count` to `most` items, a noun in the plural."""
    wanted = f"a list of {count} or more {items}"

    def check(value: object) -> Sequence[Any]:
        if not isinstance(value, list | tuple):
            raise refusal(f"{quote(value)} is not a list", wanted)
        if not count <= len(value) <= most:
            allowed = wanted if len(value) < count else f"{most} at most"
            raise refusal(f"the list has {len(value)} {items}", allowed)
        return value

    return BeforeValidator(check)


def repeated(count: int, items: str, single: str) -> WrapValidator:
    """Return a validator for a list of `count` items, or for a single value that all share.

    A fault of a single value is reported once.
    """
    wanted = f"{single}, or a list of {count}"

    def check(value: object, handler: ValidatorFunctionWrapHandler) -> Any:
        if isinstance(value, list | tuple):
            return handler(_counted(value, count, items, wanted))
        try:
            (one,) = handler([value])
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            found = first.get("ctx", {})
            allowed, meant = found.get("allowed", wanted), found.get("nearest")
            raise refusal(found.get("reason", first["msg"]), allowed, meant) from None
        return (one,) * count

    return WrapValidator(check)


One = TypeVar("One")
per_strut = repeated(ACTUATORS, "values", "one value for all struts")
PerStrut = Annotated[tuple[One, ...], per_strut]
"""One value for all struts, or a list with one for each."""


def _check_distinct(items: tuple[Hashable, ...]) -> tuple[Hashable, ...]:
    seen = set[Hashable]()
    for item in items:
        if item in seen:
            raise refusal(f"{quote(item)} is listed twice", "each one once")
        seen.add(item)
    return items


Distinct = AfterValidator(_check_distinct)
Ascending = require(
    lambda pair: pair[0] <= pair[1],
    "min {value[0]:g} is above max {value[1]:g}",
    "[min, max] with min ≤ max",
)
Pair = exactly(_ENDS, "values [min, max]")
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

Plain = TypeVar("Plain")
Inline = TypeVar("Inline")
PlainOrSection = Annotated[
    Annotated[Plain, Tag("(name)")] | Annotated[Inline, Tag("(inline)")],
    Discriminator(lambda v: "(inline)" if isinstance(v, dict | Section) else "(name)"),
]
"""A plain value such as a name, or a section."""

# --- assignment of axes and channels to the struts ------------------------------------------------


def _check_sign(value: object) -> object:
    if isinstance(value, bool) or value not in (1, -1):
        raise refusal(f"{quote(value)} is not a sign", "1 or -1")
    return value


Order = Annotated[
    tuple[Annotated[int, whole(1, ACTUATORS)], ...],
    exactly(ACTUATORS, "numbers of struts"),
    require(
        lambda order: sorted(order) == list(range(1, ACTUATORS + 1)),
        f"{{value}} is not an order of the {ACTUATORS} struts",
        f"the numbers 1 to {ACTUATORS}, each once: the strut on the first axis comes first",
    ),
]
"""Number of the strut on each axis."""
Signs = PerStrut[Annotated[int, BeforeValidator(_check_sign)]]
"""1 or −1 for each strut by its number."""
Offsets = Annotated[
    Annotated[Literal["home"], Tag("(name)")] | Annotated[PerStrut[Length], Tag("(inline)")],
    Discriminator(lambda value: "(name)" if value == "home" else "(inline)"),
]
"""Lengths of the struts at readings of zero, m; ``"home"``: their lengths at home."""
Counts = PerStrut[Annotated[Number, Positive]]
"""Counts of a length or turn for each strut by its number."""
ForceOffsets = PerStrut[Force]
"""Forces of the struts at readings of zero, N."""


def read_only(values: object) -> Array:
    """Return a copy of the values as a read-only array of floats.

    Examples
    --------
    >>> read_only([1, 2]).flags.writeable
    False
    """
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    return array
