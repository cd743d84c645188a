"""The file of a robot or a run: by the name of one that ships, or by a path."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from expdesign.configuration.problem import InputError, Problem, nearest, shown
from expdesign.library import robot_files, run_files

_SUFFIXES = (".yaml", ".yml")


def find_robot(name_or_path: str | PathLike[str], folder: Path | None = None) -> Path:
    """Return the file of a robot that ships or that a path leads to, from `folder` if relative.

    Raises
    ------
    InputError
        If a name is not known; whether a path leads to a file is not checked.
    """
    return _find(name_or_path, "robot", robot_files(), folder)


def find_run(name_or_path: str | PathLike[str]) -> Path:
    """Return the file of a run that ships or that a path leads to; errors as of `find_robot`."""
    return _find(name_or_path, "run", run_files(), None)


def absolute(path: str | PathLike[str], folder: Path | None = None) -> Path:
    """Return a path as absolute, ``~`` expanded, relative ones starting from a folder."""
    try:
        expanded = Path(path).expanduser()
    except RuntimeError:  # no such user
        expanded = Path(path)
    return (folder or Path.cwd()).absolute() / expanded


def _find(
    name_or_path: str | PathLike[str], kind: str, shipped: dict[str, Path], folder: Path | None
) -> Path:
    path = absolute(name_or_path, folder)
    if not isinstance(name_or_path, str):
        return path
    if name_or_path in shipped:
        return shipped[name_or_path]
    if _looks_like_path(name_or_path) or _is_file(path):
        return path
    message = f"no {kind} {shown(name_or_path)} ships, and there is no such file"
    allowed = f"{', '.join(shipped)}, or the path of a {kind} file"
    raise InputError(Problem(message, allowed=allowed, nearest=nearest(name_or_path, shipped)))


def _looks_like_path(text: str) -> bool:
    return "/" in text or "\\" in text or text.lower().endswith(_SUFFIXES)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False
