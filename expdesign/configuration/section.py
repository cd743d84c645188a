"""Sections of a file: pydantic models, and validation with a user's problems as the result."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from typing import Any, ClassVar, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from expdesign.configuration.document import Document
from expdesign.configuration.errors import (
    MOST_REPORTED,
    Key,
    Problem,
    nearest_name,
    quote,
    remaining_problems,
    value_problem,
)


class Section(BaseModel):
    """A mapping of the YAML with a fixed set of keys; frozen, plain data in SI units."""

    model_config = ConfigDict(extra="forbid", frozen=True, protected_namespaces=())


class StageSection(Section):
    """Section of a stage from a plug-in; the key of the run file is a class variable."""

    key: ClassVar[str]


RESOLVED = object()
"""Mark of a key in resolved configurations only, which messages do not offer."""


@dataclass(frozen=True)
class ShortForm:
    """Mark of a key with a shorter notation, a section that the key's validator converts."""

    section: type[BaseModel]


Model = TypeVar("Model", bound=BaseModel)

_TAGS = ("[key]", "(inline)", "(name)", "(names)")
"""Steps of pydantic's locations that are not keys of the document."""


def validate(
    model: type[Model], data: object, document: Document, prefix: Key = ()
) -> tuple[Model | None, list[Problem]]:
    """Validate the value at a key of a document against a section.

    Returns
    -------
    instance : model or None
        None when there are problems.
    problems : list of Problem
        In the order of the model's keys.
    """
    try:
        return model.model_validate(data), []
    except ValidationError as error:
        found = error.errors(include_url=False)
        problems = [_problem(model, one, document, prefix) for one in found[:MOST_REPORTED]]
        return None, [*problems, *remaining_problems(len(found) - MOST_REPORTED)]


def _problem(
    model: type[BaseModel], details: ErrorDetails, document: Document, prefix: Key
) -> Problem:
    context, kind = details.get("ctx", {}), details["type"]
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
    if kind == "refused":
        key = (*key, context["key"]) if context["key"] else key
        meant = context["nearest"]
        meant = meant() if callable(meant) else meant
        return document.problem(key, context["reason"], context["allowed"], meant or None)
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
