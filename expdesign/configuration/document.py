"""Plain data with the line of every key, of a file or of a mapping in its place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from numbers import Integral, Real
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from expdesign.configuration.problem import InputError, Key, Problem, key_path, shown

LARGEST_MAPPING = 100_000
"""Values of a mapping that a program hands over."""

DEEPEST = 40
"""Levels of mappings and lists in each other."""

HALF_PAIR = "the text holds half of a surrogate pair"
"""What is wrong with a text that no file in UTF-8 can hold."""


@dataclass(frozen=True)
class Document:
    """Plain data (dict, list, str, int, float, bool, None) and where it comes from.

    `file` is None for a mapping that was handed over by a program; `lines` gives the line, from
    one, of every key and list item by its path, `texts` numbers and texts as they are written.
    """

    data: dict[str, Any]
    file: Path | None = None
    lines: Mapping[Key, int] = field(default_factory=dict)
    texts: Mapping[Key, str] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """The file's name, or ``configuration``."""
        return "configuration" if self.file is None else self.file.name

    @property
    def folder(self) -> Path:
        """The folder that paths in the document are relative to."""
        return Path.cwd() if self.file is None else self.file.parent

    def line(self, key: Key) -> int | None:
        """Return the line of a key, or of what contains it."""
        for length in range(len(key), 0, -1):
            if key[:length] in self.lines:
                return self.lines[key[:length]]
        return None

    def problem(
        self, key: Key, message: str, allowed: str | None = None, nearest: str | None = None
    ) -> Problem:
        """Return a problem with the value at a key."""
        return Problem(message, self.file, self.line(key), key_path(key), allowed, nearest)


Value_co = TypeVar("Value_co", covariant=True)


@dataclass(frozen=True)
class Placed(Generic[Value_co]):
    """A value of a document, and where it stands there."""

    value: Value_co
    document: Document
    key: Key = ()

    def problem(self, key: Key, message: str, allowed: str | None = None) -> Problem:
        """Return a problem with what stands at a key of the value."""
        return self.document.problem((*self.key, *key), message, allowed)


def document_from_mapping(mapping: Mapping[Any, Any]) -> Document:
    """Copy a mapping to plain data: tuples and arrays become lists, NumPy numbers Python's.

    Refuse one with a key that is no text, that contains itself or far too many values.
    """
    copier = _Copier()
    data = copier.copy(mapping, (), 0)
    if copier.problems:
        raise InputError(copier.problems)
    return Document(data)


class _Copier:
    def __init__(self) -> None:
        self.problems: list[Problem] = []
        self.count = 0

    def copy(self, value: Any, key: Key, depth: int) -> Any:
        self.count += 1
        if depth > DEEPEST or self.count > LARGEST_MAPPING:
            raise InputError("the mapping is nested too deeply or too large", key=key_path(key[:4]))
        if isinstance(value, np.ndarray | np.generic):
            value = value.tolist()
        if isinstance(value, Mapping):
            return self._mapping(value, key, depth)
        if isinstance(value, list | tuple):
            return [self.copy(item, (*key, i), depth + 1) for i, item in enumerate(value)]
        if isinstance(value, str | Path):
            return self._text(str(value), key)
        if isinstance(value, Integral) and not isinstance(value, bool):
            return int(value)
        # What is no plain data is left to the schema, which refuses it.
        return float(value) if isinstance(value, Real) and not isinstance(value, bool) else value

    def _text(self, value: str, key: Key) -> str:
        if any("\ud800" <= character <= "\udfff" for character in value):
            self.problems.append(Problem(HALF_PAIR, key=key_path(key)))
        return value

    def _mapping(self, value: Mapping[Any, Any], key: Key, depth: int) -> dict[str, Any]:
        copied = {}
        for name, item in value.items():
            if isinstance(name, str):
                self._text(name, key)
                copied[name] = self.copy(item, (*key, name), depth + 1)
            else:
                problem = Problem(f"the key {shown(name)} is no text", key=key_path(key))
                self.problems.append(problem)
        return copied
