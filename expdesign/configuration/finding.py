"""The file of a robot or a run: by the name of one that ships, or by a path."""

from __future__ import annotations

import os
from os import PathLike
from pathlib import Path

from expdesign.configuration.problem import InputError, nearest, shown

_SUFFIXES = (".yaml", ".yml")


def absolute(path: str | PathLike[str], folder: Path | None = None) -> Path:
    """Return a path as absolute, ``~`` expanded, relative ones starting from a folder."""
    expanded = os.path.expanduser(Path(path))  # noqa: PTH111 - leaves unknown users as they are
    return (folder or Path.cwd()).absolute() / expanded


def find_file(
    name_or_path: str | PathLike[str],
    kind: str,
    shipped: dict[str, Path],
    folder: Path | None = None,
) -> Path:
    """Return the file of a robot or a run that ships, or that a path leads to.

    `kind` is ``robot`` or ``run``, `shipped` are files by their names; relative paths start from
    `folder`, by default the current one.

    Raises
    ------
    InputError
        If a name is not known; whether a path leads to a file is not checked.
    """
    path = absolute(name_or_path, folder)
    if not isinstance(name_or_path, str):
        return path
    if name_or_path in shipped:
        return shipped[name_or_path]
    is_path = any(mark in name_or_path for mark in "/\\")
    if is_path or name_or_path.lower().endswith(_SUFFIXES) or os.path.isfile(path):  # noqa: PTH113 - whatever the text is
        return path
    message = f"no {kind} {shown(name_or_path)} ships, and there is no such file"
    allowed = f"{', '.join(shipped)}, or the path of a {kind} file"
    raise InputError(message, allowed=allowed, nearest=nearest(name_or_path, shipped))
