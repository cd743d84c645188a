"""What a value in a file is: its unit and its meaning, beside its type."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import cache
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import BeforeValidator, TypeAdapter

from constraints.arrays import Array

Record = TypeVar("Record")


@dataclass(frozen=True)
class Column:
    """One column of a table, or one key of a JSON file. Values are SI and radians.

    Attributes
    ----------
    name : str
        As it stands in the file; empty in an annotation: the name of the field.
    unit : str
        ``"1"`` for a pure number, empty for a text, ``"see unit"`` where another column tells it.
    meaning : str
        In words.
    """

    name: str
    unit: str
    meaning: str


def described(unit: str, meaning: str, name: str = "") -> Column:
    """Describe a field: ``omega: Annotated[float, described("rad/s", "base frequency")]``."""
    return Column(name, unit, meaning)


@dataclass(frozen=True)
class Columns:
    """The columns that an array of a table fills: one for (N,), k for (N, k)."""

    columns: tuple[Column, ...]


def array_columns(*columns: Column) -> Columns:
    """Describe an array by its columns: ``pose: Annotated[Array, array_columns(*POSE)]``."""
    return Columns(columns)


def field_columns(record: type[Any]) -> Iterator[tuple[str, tuple[Column, ...]]]:
    """Yield every field of a frozen dataclass with what it is called and means in its file.

    Raises
    ------
    TypeError
        A field is not described.
    """
    hints = get_type_hints(record, include_extras=True)
    for field in fields(record):
        yield field.name, _columns(record, field.name, hints[field.name])


def _columns(record: type[Any], name: str, hint: Any) -> tuple[Column, ...]:
    for entry in get_args(hint)[1:] if get_origin(hint) is Annotated else ():
        if isinstance(entry, Columns):
            return entry.columns
        if isinstance(entry, Column):
            return (Column(entry.name or name, entry.unit, entry.meaning),)
    raise TypeError(f"{record.__name__}.{name}: neither unit nor meaning is given")


def copied(kind: type[Record], source: object, **others: Any) -> Record:
    """Make a record of what `source` has under the names of its fields, and of `others`."""
    names = [field.name for field in fields(kind) if field.name not in others]  # type: ignore[arg-type]
    return kind(**{name: getattr(source, name) for name in names}, **others)


def checker(kind: Any) -> TypeAdapter[Any]:
    """Return what checks data against a type; made once for each, since that takes long."""
    return _checker(kind)


@cache
def _checker(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def _numbers(value: object) -> Array:
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError("expected numbers in lists of equal length") from None
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
    except (TypeError, ValueError):
        raise ValueError("expected numbers in lists of equal length") from None


Numbers = Annotated[Array, BeforeValidator(_numbers)]
"""Finite numbers, in a JSON file lists of them."""

OpenNumbers = Annotated[Array, BeforeValidator(_open_numbers)]
"""Numbers of which some may be missing: NaN, null in a JSON file."""

OpenNumber = Annotated[float, BeforeValidator(_open_number)]
"""A number that may be missing: NaN, null in a JSON file, an empty cell in a table."""

MAY_BE_EMPTY = BeforeValidator(_none_if_empty)
"""An empty cell of a table is None: ``Annotated[int | None, MAY_BE_EMPTY, described(…)]``."""
