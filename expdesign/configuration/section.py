"""Sections of a file: pydantic models, and their errors as problems that a user can act on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from expdesign.configuration.document import Document, FileKind
from expdesign.configuration.errors import (
    MOST_TOLD,
    Key,
    Problem,
    nearest,
    shown,
    untold,
    wrong_value,
)


class Section(BaseModel):
    """A mapping of the YAML with a fixed set of keys; frozen, plain data in SI units."""

    model_config = ConfigDict(extra="forbid", frozen=True, protected_namespaces=())


LATER = object()
"""Mark of a key that earlier versions did not have: ``Annotated[float, LATER] = 0.0``. What was
made without it is as it would be made with its default now."""

RESOLVED = object()
"""Mark of a key that stands in resolved configurations only: it is read, but nobody is told to
write it."""


@dataclass(frozen=True)
class LaterEntries:
    """Mark of a mapping that may say what was so for earlier versions, which could not say it.

    `of` returns which of its entries these are, nested as they are, with True for each.
    """

    of: Callable[[Mapping[str, Any]], dict[str, Any]]


@dataclass(frozen=True)
class ShortForm:
    """Mark of a key that takes a section which becomes something else: its validator does it."""

    section: type[BaseModel]


Model = TypeVar("Model", bound=BaseModel)

# Steps of pydantic's location that are no key of the document.
_MARKS = ("[key]", "(inline)", "(name)", "(names)")


def validate(
    model: type[Model], data: object, document: Document, prefix: Key = ()
) -> tuple[Model | None, list[Problem]]:
    """Validate what stands at `prefix` of a document against a section.

    Returns
    -------
    instance : model or None
        None when there are problems.
    problems : list of Problem
        What is wrong, in the order of the model's keys.
    """
    try:
        return model.model_validate(data), []
    except ValidationError as error:
        # To look for what was meant takes time: only for those that are told.
        found = error.errors(include_url=False)
        problems = [_problem(model, details, document, prefix) for details in found[:MOST_TOLD]]
        return None, problems + untold(len(found) - MOST_TOLD)


def _problem(
    model: type[BaseModel], details: ErrorDetails, document: Document, prefix: Key
) -> Problem:
    context = details.get("ctx", {})
    kind = details["type"]
    location = tuple(step for step in details["loc"] if step not in _MARKS)
    if kind == "extra_forbidden":
        # The last step is the user's key, however it is spelt.
        *steps, name = details["loc"]
        location = tuple(step for step in steps if step not in _MARKS)
        valid = _offered(_model_at(model, location))
        message, meant = f"unknown key {shown(name)}", nearest(name, valid)
        return document.problem((*prefix, *location, name), message, ", ".join(valid), meant)
    key = (*prefix, *location)
    if kind == "missing":
        return document.problem(key, f"the key '{location[-1]}' is missing")
    if kind in ("model_type", "model_attributes_type"):
        valid = _offered(_model_at(model, location))
        message = f"{shown(details['input'])} is not a mapping"
        return document.problem(key, message, f"the keys {', '.join(valid)}")
    if kind == "refused":
        key = (*key, context["key"]) if context["key"] else key
        meant = context["nearest"]
        meant = meant() if callable(meant) else meant
        return document.problem(key, context["reason"], context["allowed"], meant or None)
    return document.problem(key, *wrong_value(details))


def unstated(section: BaseModel) -> dict[str, Any]:
    """Return which keys earlier versions did not have and the section leaves at their default.

    As `model_dump(exclude=…)` takes them, the sections inside it included.
    """
    found: dict[str, Any] = {}
    for name, info in type(section).model_fields.items():
        value = getattr(section, name)
        if LATER in info.metadata and value == info.get_default(call_default_factory=True):
            found[name] = True
        elif marks := [mark for mark in info.metadata if isinstance(mark, LaterEntries)]:
            entries = marks[0].of(value)
            found |= {name: entries} if entries else {}
        elif isinstance(value, BaseModel) and (inner := unstated(value)):
            found[name] = inner
        elif isinstance(value, tuple):
            each = {n: unstated(v) for n, v in enumerate(value) if isinstance(v, BaseModel)}
            if any(each.values()):
                found[name] = {n: inner for n, inner in each.items() if inner}
    return found


def file_kind(name: str, model: type[BaseModel]) -> FileKind:
    """Return what a file is that holds such a section."""
    return FileKind(name, _offered(model))


def _offered(model: type[BaseModel]) -> list[str]:
    """Return the keys that a user may write, in alphabetical order."""
    fields = model.model_fields.items()
    return sorted(info.alias or name for name, info in fields if RESOLVED not in info.metadata)


def _model_at(model: type[BaseModel], location: Key) -> type[BaseModel]:
    """Return the section that a location in the data belongs to."""
    for step in location:
        for name, info in model.model_fields.items():
            if step == (info.alias or name):
                also = (mark.section for mark in info.metadata if isinstance(mark, ShortForm))
                model = next(chain(_sections(info.annotation), also), model)
    return model


def _sections(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _sections(argument)
