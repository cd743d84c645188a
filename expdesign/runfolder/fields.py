"""Fields of stored data: unit and meaning as annotations, and the checks of their values."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Annotated, Any, TypeVar, get_type_hints

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, TypeAdapter

from constraints.arrays import Array
from expdesign.configuration import Problem, quote
from expdesign.configuration.errors import refusal
from expdesign.mechanism.hexapod import ACTUATORS, POSE, actuator_names

Value = TypeVar("Value")


@dataclass(frozen=True)
class Column:
    """One column of a table, or one key of a JSON file. Values are SI and radians."""

    name: str
    """Name in the file; empty in an annotation: the name of the field."""
    unit: str
    """``"1"`` for a pure number, empty for a text, ``"see unit"``: in the column `unit`."""
    meaning: str
    """In words."""


def described(unit: str, meaning: str, name: str = "") -> Column:
    """Describe a field: ``omega: Annotated[float, described("rad/s", "base frequency")]``.

    An array of a table may have several columns: ``Annotated[Array, TIME, POSE_COLUMNS]``.
    """
    return Column(name, unit, meaning)


def strutwise(prefix: str, unit: str, meaning: str, suffix: str = "") -> tuple[Column, ...]:
    """Return a column for every strut.

    >>> [column.name for column in strutwise("q", "m", "length")]
    ['q1', 'q2', 'q3', 'q4', 'q5', 'q6']
    """
    names = enumerate(actuator_names(prefix, suffix), start=1)
    return tuple(Column(name, unit, f"{meaning} of strut {number}") for number, name in names)


def _derived(prefix: str, per: str, word: str) -> tuple[Column, ...]:
    return tuple(
        Column(f"{prefix}{c.name}", f"{c.unit}/{per}", f"{word} of {c.name}") for c in POSE
    )


TIME = Column("t", "s", "time from the start of the period")
POSE_COLUMNS = tuple(Column(c.name, c.unit, c.meaning) for c in POSE)
RATE_COLUMNS = _derived("d", "s", "rate")
ACCELERATION_COLUMNS = _derived("dd", "s^2", "second time derivative")


JSON_ONLY = object()
"""Mark of a field of a row that is a key where rows are in a JSON file, and no column."""


def cached_by_type(function: Callable[[Any], Value]) -> Callable[[Any], Value]:
    """Decorate a function of a type that is to be called once for each."""
    return cache(function)


@cached_by_type
def field_columns(record: type[Any]) -> tuple[tuple[str, tuple[Column, ...]], ...]:
    """Return every field of a frozen dataclass, each described, with its columns."""
    hints, columns = get_type_hints(record, include_extras=True), []
    for name in (field.name for field in fields(record)):
        found: list[Column] = []
        marks = getattr(hints[name], "__metadata__", ())
        if JSON_ONLY in marks:
            continue
        for entry in marks:
            if isinstance(entry, Column):
                found.append(replace(entry, name=entry.name or name))
            elif isinstance(entry, tuple):
                found += entry
        if not found:
            raise TypeError(f"{record.__name__}.{name}: neither unit nor meaning is given")
        columns.append((name, tuple(found)))
    return tuple(columns)


checker: Callable[[Any], TypeAdapter[Any]] = cache(TypeAdapter)
"""Validator of a type, which takes long to build and is built once for each."""


def _numbers(value: object) -> Array:
    array = _open_numbers(value)
    if not np.all(np.isfinite(array)):
        raise ValueError("expected finite numbers")
    return array


def _open_number(value: object) -> object:
    return np.nan if value is None or value == "" else value


def _none_if_empty(value: object) -> object:
    return None if value == "" else value


def _open_numbers(value: object) -> Array:
    try:
        return np.array(value, dtype=np.float64)  # None becomes NaN
    except (TypeError, ValueError, OverflowError):
        raise ValueError("expected numbers in lists of equal length") from None


def _infinite(value: object) -> object:
    return np.inf if value is None else value


def _infinite_numbers(value: object) -> Array:
    array = _open_numbers(value)
    return np.where(np.isnan(array), np.inf, array)


def _whole_numbers(value: object) -> NDArray[np.int64]:
    array = np.array(value)
    if array.dtype.kind != "i":
        raise ValueError("expected whole numbers")
    return array.astype(np.int64)


def sized(*shape: int | None) -> AfterValidator:
    """Return the check of an array's shape; None: any number, at least one."""
    wanted = " × ".join("any number of" if size is None else str(size) for size in shape)

    def check(array: Array) -> Array:
        fits = len(shape) == array.ndim and all(
            there > 0 if size is None else there == size
            for size, there in zip(shape, array.shape, strict=True)
        )
        if not fits:
            found = " × ".join(map(str, array.shape)) or "no lists of"
            raise refusal(f"there are {found} numbers", wanted)
        return array

    return AfterValidator(check)


Numbers = Annotated[Array, BeforeValidator(_numbers)]
"""Finite numbers, in a JSON file lists of them."""

OpenNumbers = Annotated[Array, BeforeValidator(_open_numbers)]
"""Numbers, some of them missing: NaN, null in a JSON file."""


def _variances(covariance: Array) -> Array:
    place = negative_variance(covariance)
    if place is not None:
        variance = covariance[place, place]
        raise refusal(f"{variance:g} is a negative variance", "a diagonal of zeros and more")
    return covariance


def negative_variance(covariance: Array) -> int | None:
    """Return the place of the first negative number on the diagonal, None without one."""
    places = np.flatnonzero(np.diag(covariance) < 0)
    return int(places[0]) if places.size else None


Covariance = Annotated[Numbers, sized(ACTUATORS, ACTUATORS), AfterValidator(_variances)]
"""Covariance of six channels, (6, 6)."""

WholeNumbers = Annotated[NDArray[np.int64], BeforeValidator(_whole_numbers)]
"""Whole numbers, in a JSON file a list of them."""

UnboundedNumber = Annotated[float, BeforeValidator(_infinite)]
"""A number that may be infinite: null in a JSON file."""

UnboundedNumbers = Annotated[Array, BeforeValidator(_infinite_numbers)]
"""Numbers, some of them infinite: null in a JSON file."""

OpenNumber = Annotated[float, BeforeValidator(_open_number)]
"""A number that may be missing: NaN, null in a JSON file, an empty cell in a table."""

MAY_BE_EMPTY = BeforeValidator(_none_if_empty)
"""An empty cell of a table is None: ``Annotated[int | None, MAY_BE_EMPTY, described(…)]``."""


def wrong_shape(
    key: str, numbers: Array | None, shape: tuple[int, ...], of: str
) -> Iterator[Problem]:
    """Yield a problem for an array of another shape than the file requires; none for None.

    `of` are the entries that determine the shape, in words.
    """
    if numbers is not None and numbers.shape != shape:
        found, wanted = (" × ".join(map(str, each)) for each in (numbers.shape, shape))
        yield Problem(f"there are {found} numbers", key=key, allowed=f"{wanted}, as of {of}")


def wrong_covariance(key: str, numbers: Array | None, count: int, of: str) -> Iterator[Problem]:
    """Yield a problem for a matrix of another size or with a negative variance."""
    wrong = list(wrong_shape(key, numbers, (count, count), of))
    yield from wrong
    place = None if wrong or numbers is None else negative_variance(numbers)
    if numbers is not None and place is not None:
        at = f"{key}[{place + 1}][{place + 1}]"
        message = f"{numbers[place, place]:g} is a negative variance"
        yield Problem(message, key=at, allowed="zero and more")


def wrong_count(key: str, entries: Collection[object], count: int, of: str) -> Iterator[Problem]:
    """Yield a problem for a list with another number of entries than the file requires."""
    if len(entries) != count:
        yield Problem(
            f"the list has {len(entries)}", key=key, allowed=f"{count}, one for each of {of}"
        )


def unknown_names(
    key: str, names: Iterable[str], known: Collection[str], of: str
) -> Iterator[Problem]:
    """Yield a problem for the first name that is missing elsewhere; `of`: where, in words."""
    for name in names:
        if name not in known:
            yield Problem(
                f"there is no {quote(name)} among {of}", key=key, allowed=", ".join(known)
            )
            return


def wrong_names(
    key: str, names: Collection[str], wanted: Collection[str], of: str
) -> Iterator[Problem]:
    """Yield a problem for an unknown or missing name; `of`: where the names are, in words."""
    yield from unknown_names(key, names, wanted, of)
    missing = [name for name in wanted if name not in names]
    if missing:
        yield Problem(f"{quote(missing[0])} of {of} is missing", key=key, allowed=", ".join(wanted))
