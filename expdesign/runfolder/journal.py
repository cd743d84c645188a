"""Journal of a long computation: its finished parts on disk, from which it continues."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Hashable
from pathlib import Path
from typing import Any, Generic, TypeVar

from expdesign.runfolder.fields import checker
from expdesign.runfolder.files import FORMAT, check_format, errors_naming, json_text, write_text

Entry = TypeVar("Entry")
Key = TypeVar("Key", bound=Hashable)

_FORMAT = 1
_CHECK = "check"


def _check(data: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:16]


class Journal(Generic[Entry, Key]):
    """Finished parts of a computation, one line each, in the order of their ends.

    Numbers that JSON does not have are texts. The first line has a hash of the inputs, each other
    line one of its content. From an incomplete or changed line on, the parts are done again. A
    journal of other inputs, or one not to be kept, counts as empty: the first part that is added
    replaces it.

    A part is of the frozen dataclass `kind`; `done` has the parts by their `key`.
    """

    def __init__(
        self,
        path: Path,
        inputs: str,
        kind: type[Entry],
        key: Callable[[Entry], Key],
        *,
        keep: bool = True,
    ) -> None:
        self.path = path
        self.done: dict[Key, Entry] = {}
        self._kind, self._key = kind, key
        self._header = json.dumps({FORMAT: _FORMAT, "inputs": inputs}) + "\n"
        self._inputs = inputs
        self._valid = self._read() if keep else 0

    def _read(self) -> int:
        """Read the parts; return the size of the complete lines of this computation, bytes."""
        if not self.path.is_file():
            return 0
        lines = self.path.read_bytes().splitlines(keepends=True)
        if not lines or not self._has_same_inputs(lines[0]):
            return 0
        size = len(lines[0])
        for line in lines[1:]:
            try:
                data = json.loads(line)
                is_whole = data.pop(_CHECK) == _check(data) and line.endswith(b"\n")
                part = checker(self._kind).validate_python(data)
            except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
                break
            if not is_whole:
                break
            self.done[self._key(part)] = part
            size += len(line)
        return size

    def _has_same_inputs(self, line: bytes) -> bool:
        try:
            header = json.loads(line)
        except (ValueError, RecursionError):
            return False
        if not isinstance(header, dict) or header.get("inputs") != self._inputs:
            return False
        check_format(self.path, header.get(FORMAT), _FORMAT)
        return True

    def add(self, part: Entry) -> None:
        """Append a part; it is on disk when this returns."""
        if not self._valid:
            write_text(self.path, self._header)
            self._valid = len(self._header)
        values = checker(self._kind).dump_python(part)
        data = json.loads(json_text(values, inf_nan_mode="strings"))
        line = (json.dumps({**data, _CHECK: _check(data)}) + "\n").encode()
        with errors_naming(self.path), self.path.open("r+b") as stream:
            stream.truncate(self._valid)
            stream.seek(self._valid)
            stream.write(line)
            stream.flush()
            os.fsync(stream.fileno())
        self._valid += len(line)
        self.done[self._key(part)] = part
