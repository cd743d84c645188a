"""The catalogue of limits: all that :mod:`constraints.limits` and the plug-ins declare."""

from __future__ import annotations

import copyreg
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Any

from constraints import limits
from constraints.definition import LimitDefinition, plain_limit
from constraints.plugins import declarations


@cache
def limit_definitions() -> Mapping[str, LimitDefinition]:
    """Return every limit by its YAML key, in alphabetical order.

    A new limit is one file in ``constraints/limits`` or one module of a plug-in.
    """
    found: dict[str, LimitDefinition] = {}
    for definition in declarations(LimitDefinition, limits):
        if definition.key in found:
            raise ValueError(f"the limit '{definition.key}' is declared twice")
        found[definition.key] = definition
    return MappingProxyType(dict(sorted(found.items())))


def _by_key(key: str) -> LimitDefinition:
    return limit_definitions()[key]


def _reduce(definition: LimitDefinition) -> str | tuple[Any, ...]:
    if limit_definitions().get(definition.key) is definition:
        return _by_key, (definition.key,)
    stated = definition.key, definition.title, definition.unit, definition.kind
    if plain_limit(*stated) is definition:
        return plain_limit, stated
    return definition.__reduce_ex__(2)


# A worker process has the same files: a definition goes there by its name, since the functions
# that it holds may be lambdas.
copyreg.pickle(LimitDefinition, _reduce)
