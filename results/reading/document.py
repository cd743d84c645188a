"""JSON files of a run folder: values of the kind that is asked for, or an error that says where."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import InputError, Problem
from expdesign.runfolder import MissingFileError

_LONGEST = 60


class Document:
    """A mapping of a JSON file that says where it stands when something is wrong.

    Parameters
    ----------
    path : Path
        The file.
    key : str
        Where in it the mapping stands; empty for the file as a whole.
    data : object
        What stands there.

    Raises
    ------
    InputError
        It is no mapping.
    """

    def __init__(self, path: Path, key: str, data: object) -> None:
        self.path, self._key = path, key
        if not isinstance(data, dict):
            raise InputError(Problem("expected a mapping", path, key=key))
        self._data: Mapping[str, Any] = data

    @classmethod
    def read(cls, path: Path) -> Document:
        """Read a file; keys that nobody asks for are left alone.

        Raises
        ------
        InputError
            It is missing (`MissingFileError`), no JSON or no mapping.
        """
        if not path.is_file():
            raise MissingFileError(path, "what `expdesign` wrote into a run folder")
        try:
            document = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise InputError(Problem(f"not JSON that can be read: {error}", path)) from error
        return cls(path, "", document)

    def __contains__(self, key: str) -> bool:
        return self._data.get(key) is not None

    def keys(self) -> tuple[str, ...]:
        """Return the keys in the order of the file."""
        return tuple(self._data)

    def optional(self, key: str) -> Any:
        """Return what stands under a key, None when there is nothing."""
        return self._data.get(key)

    def section(self, key: str) -> Document:
        """Return a mapping inside this one."""
        return Document(self.path, self._name(key), self._get(key))

    def sections(self, key: str) -> tuple[Document, ...]:
        """Return a list of mappings."""
        return tuple(
            Document(self.path, f"{self._name(key)}[{number}]", entry)
            for number, entry in enumerate(self._list(key), start=1)
        )

    def items(self) -> Iterator[tuple[str, Document]]:
        """Go through a mapping of mappings."""
        return ((key, self.section(key)) for key in self._data)

    def texts(self, key: str) -> tuple[str, ...]:
        """Return a list of texts; nothing there is an empty one."""
        if self._data.get(key) is None:
            return ()
        return tuple(str(entry) for entry in self._list(key))

    def text(self, key: str) -> str:
        """Return a text."""
        value = self._get(key)
        if not isinstance(value, str):
            raise self._wrong(key, "a text", value)
        return value

    def flag(self, key: str) -> bool:
        """Return true or false."""
        value = self._get(key)
        if not isinstance(value, bool):
            raise self._wrong(key, "true or false", value)
        return value

    def integer(self, key: str) -> int:
        """Return a whole number."""
        value = self._get(key)
        if isinstance(value, bool) or not isinstance(value, int):
            raise self._wrong(key, "a whole number", value)
        return value

    def number(self, key: str) -> float:
        """Return a finite number."""
        value = self._get(key)
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
            raise self._wrong(key, "a finite number", value)
        return float(value)

    def number_or_none(self, key: str) -> float | None:
        """Return a finite number, None where the file has null."""
        return None if self._get(key) is None else self.number(key)

    def array(self, key: str, shape: tuple[int, ...]) -> Array:
        """Return finite numbers in the shape given."""
        value = self._get(key)
        expected = f"{' × '.join(map(str, shape))} finite numbers"
        try:
            array = np.array(value, dtype=np.float64)
        except (TypeError, ValueError):
            raise self._wrong(key, expected, value) from None
        if array.shape != shape or not np.all(np.isfinite(array)):
            raise self._wrong(key, expected, value)
        return array

    def _list(self, key: str) -> list[Any]:
        value = self._get(key)
        if not isinstance(value, list):
            raise self._wrong(key, "a list", value)
        return value

    def _get(self, key: str) -> Any:
        if key not in self._data:
            raise InputError(Problem("the key is missing", self.path, key=self._name(key)))
        return self._data[key]

    def _name(self, key: str) -> str:
        return f"{self._key}.{key}" if self._key else key

    def _wrong(self, key: str, expected: str, value: object) -> InputError:
        shown = repr(value)
        shown = shown if len(shown) <= _LONGEST else f"{shown[:_LONGEST]}…"
        return InputError(
            Problem(f"expected {expected}, not {shown}", self.path, key=self._name(key))
        )
