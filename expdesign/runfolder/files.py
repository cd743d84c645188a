"""Files of a run folder: complete or absent when written, checked for their format when read.

A file is written under a temporary name in the same folder and then renamed. A command with the
lock of a run folder removes the temporary files of earlier commands that were killed.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from pydantic_core import PydanticCustomError, to_json

from expdesign.configuration import InputError, Problem
from expdesign.configuration.document import read_text
from expdesign.configuration.errors import format_number

FORMAT = "format"
"""The key of the format number in a JSON file."""

RUN_FILE = "run.yaml"
"""The resolved configuration, which every stage writes."""

LARGEST_FILE = 64 * 1024 * 1024
"""Largest number of bytes read from a file."""

LARGEST_NUMBER = 1e150
"""Largest size of a number in a file: its square is still a number."""

TEMPORARY = ".expdesign-temporary-"
"""Beginning of the names of temporary files and folders."""

_ABANDONED = 24 * 3600.0
"""s. Files are written in seconds: a temporary file that is a day old is abandoned."""


@contextmanager
def atomic_write(path: Path, mode: int = 0o666) -> Iterator[Path]:
    """Provide a temporary path in the folder of `path`; rename it to `path` on success.

    Abandoned temporary files are removed from the folder first. The umask restricts the `mode`. A
    failure is an `OSError` with the name of `path`.
    """
    with errors_naming(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        remove_leftovers(path.parent)
        handle, name = tempfile.mkstemp(prefix=TEMPORARY, dir=path.parent)
        os.close(handle)
        temporary = Path(name)
        try:
            yield temporary
            # mkstemp makes files that only the owner reads; results are ordinary files.
            temporary.chmod(mode & ~_umask())
            temporary.replace(path)
        except BaseException:
            with suppress(OSError):
                temporary.unlink()
            raise


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


@contextmanager
def errors_naming(path: Path) -> Iterator[None]:
    """Replace the temporary file's name in an error of the operating system by `path`."""
    try:
        yield
    except OSError as error:
        name = error.filename
        if error.errno is None:
            raise
        if name is not None and path.parent not in Path(os.fsdecode(name)).parents:
            raise  # of another file, which was read meanwhile
        raise OSError(error.errno, os.strerror(error.errno), str(path)) from error


def write_text(path: Path, text: str) -> None:
    """Write a text file, UTF-8."""
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, data: Any) -> None:
    """Write JSON, as `json_text`."""
    write_text(path, json_text(data) + "\n")


def json_text(data: Any, **options: Any) -> str:
    r"""Return JSON, arrays as lists; numbers that JSON does not have (NaN, ±inf) become null.

    `options` are further ones of `pydantic_core.to_json`. Anything else, such as a set, whose order
    would change from run to run, is a `TypeError`.

    >>> import numpy as np
    >>> print(json_text({"rate": np.array([1.0, np.nan])}).replace("\n", ""))
    {  "rate": [    1.0,    null  ]}
    """
    # json.dumps refuses what is not JSON, and with an indent takes ten times as long as to_json.
    json.dumps(data, default=_as_list)
    options = {"indent": 2, "inf_nan_mode": "null", **options}
    return to_json(data, fallback=_as_list, **options).decode()


def _as_list(value: Any) -> Any:
    if not hasattr(value, "tolist"):
        raise TypeError(f"a {type(value).__name__} has no form in JSON")
    return value.tolist()


class MissingFileError(InputError):
    """A required file is missing from the run folder; the remedy is the command that writes it."""

    def __init__(self, path: Path, remedy: str) -> None:
        super().__init__(Problem("there is no such file", path, allowed=remedy))
        self.path, self.remedy = path, remedy

    def __reduce__(self) -> tuple[type[MissingFileError], tuple[Path, str]]:  # type: ignore[override]
        return type(self), (self.path, self.remedy)


def read_mapping(path: Path, allowed: str = "a JSON file that expdesign wrote") -> dict[str, Any]:
    """Read a JSON file with a mapping at its top; anything else is an `InputError`."""
    text = read_text(path, allowed, LARGEST_FILE)

    def mapping(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) < len(pairs):
            names = [name for name, _ in pairs]
            twice = next(name for name in names if names.count(name) > 1)
            raise InputError("the key occurs twice", path, key=twice)
        return found

    try:
        data = json.loads(text, object_pairs_hook=mapping)
    except json.JSONDecodeError as error:
        raise InputError(f"not JSON: {error.msg}", path, error.lineno, allowed=allowed) from error
    except (ValueError, RecursionError) as error:
        # A number of very many digits, or brackets without end.
        raise InputError("not JSON that can be read", path, allowed=allowed) from error
    if not isinstance(data, dict):
        raise InputError("the file holds no mapping", path, 1, allowed=allowed)
    return data


def check_format(path: Path, found: object, current: int) -> None:
    """Refuse a file of another version by its format number."""
    try:
        format_number(found, current)
    except PydanticCustomError as refused:
        raise InputError(refused.message(), path, key=FORMAT) from refused


def foreign_access(status: os.stat_result, *, above: bool = False) -> str:
    """Return the reason why another user than this one and root may change a file or folder.

    The rules are those of ssh for its keys. In a folder `above` the one in question the sticky bit
    protects what belongs to this user. The reason is empty if no other user may write.
    """
    if status.st_uid not in {os.geteuid(), 0}:
        return f"belongs to the user {status.st_uid}"
    by_others = stat.S_IWOTH if above else stat.S_IWOTH | stat.S_IWGRP
    if status.st_mode & by_others and not (above and status.st_mode & stat.S_ISVTX):
        return f"may be written to by others (mode {stat.S_IMODE(status.st_mode):04o})"
    return ""


def foreign_folder(folder: Path) -> str:
    """Return the reason why another user may put files into a folder; empty: only this user may."""
    place = folder.resolve()
    if reason := foreign_access(place.stat()):
        return f"{place} {reason}"
    for parent in place.parents:
        if reason := foreign_access(parent.stat(), above=True):
            return f"{parent} {reason}"
    return ""


def remove_leftovers(folder: Path, *, locked: bool = False) -> None:
    """Remove the abandoned temporary files and folders in a folder: those that are a day old.

    All of them are abandoned in a folder whose lock this process has, before it writes itself. A
    file that cannot be removed stays.
    """
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            age = time.time() - entry.stat(follow_symlinks=False).st_mtime
            if not (entry.name.startswith(TEMPORARY) and (locked or age > _ABANDONED)):
                continue
            if entry.is_dir(follow_symlinks=False):
                shutil.rmtree(entry.path, ignore_errors=True)
            else:
                with contextlib.suppress(OSError):
                    Path(entry.path).unlink()
