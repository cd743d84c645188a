"""From what a user writes for a robot or a run to a file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from os import PathLike
from pathlib import Path

from expdesign.configuration.failure import nearest, shown
from expdesign.configuration.problem import InputError, Problem
from expdesign.library import robot_file, robot_names, run_file, run_names

_SUFFIXES = (".yaml", ".yml")


def find_robot(name_or_path: str | PathLike[str], folder: Path | None = None) -> Path:
    """Return the file of a robot.

    Parameters
    ----------
    name_or_path : str or path-like
        The name of a robot that ships, or a path.
    folder : Path, optional
        The folder that a relative path starts from; default: the current one.

    Raises
    ------
    InputError
        If a name is not known; a path is not looked at.
    """
    return _find(name_or_path, folder, "robot", robot_names(), robot_file)


def find_run(name_or_path: str | PathLike[str]) -> Path:
    """Return the file of a run, by the name of one that ships or by its path.

    Raises
    ------
    InputError
        If a name is not known; a path is not looked at.
    """
    return _find(name_or_path, None, "run", run_names(), run_file)


def absolute(path: str | PathLike[str], folder: Path | None = None) -> Path:
    """Return a path as absolute, ``~`` expanded, relative ones starting from a folder."""
    try:
        expanded = Path(path).expanduser()
    except RuntimeError:  # no such user
        expanded = Path(path)
    return (folder or Path.cwd()).absolute() / expanded


def _find(
    name_or_path: str | PathLike[str],
    folder: Path | None,
    kind: str,
    names: Sequence[str],
    file_of: Callable[[str], Path],
) -> Path:
    if isinstance(name_or_path, str) and name_or_path in names:
        return file_of(name_or_path)
    path = absolute(name_or_path, folder)
    is_path = not isinstance(name_or_path, str) or _looks_like_path(name_or_path)
    if is_path or _exists(path):
        return path
    name = str(name_or_path)
    message = f"no {kind} {shown(name)} ships, and there is no such file"
    allowed = f"{', '.join(names)}, or the path of a {kind} file"
    raise InputError(Problem(message, allowed=allowed, nearest=nearest(name, names)))


def _looks_like_path(text: str) -> bool:
    return "/" in text or "\\" in text or text.lower().endswith(_SUFFIXES)


def _exists(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False
