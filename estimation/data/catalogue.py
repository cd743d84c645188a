"""The formats that exist: every module of :mod:`estimation.data.readers` declares a ``FORMAT``."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache
from pathlib import Path

from estimation.data import readers
from estimation.data.file_format import FileFormat
from expdesign.configuration import InputError, Problem


@cache
def file_formats() -> tuple[FileFormat, ...]:
    """Return every format, in alphabetical order of the modules.

    A file dropped into ``estimation/data/readers`` is all that a new format needs.
    """
    found = []
    for module in sorted(pkgutil.iter_modules(readers.__path__), key=lambda item: item.name):
        found_format = importlib.import_module(f"{readers.__name__}.{module.name}").FORMAT
        if not isinstance(found_format, FileFormat):
            raise TypeError(f"estimation/data/readers/{module.name}.py: FORMAT is no FileFormat")
        found.append(found_format)
    return tuple(found)


def format_of(path: Path) -> FileFormat:
    """Return the format of a file or folder.

    Raises
    ------
    InputError
        There is no such file, or no format claims it.
    """
    if not path.exists():
        raise InputError(Problem("there is no such file", path))
    for found in file_formats():
        if found.claims(path):
            return found
    known = ", ".join(sorted({suffix for found in file_formats() for suffix in found.extensions}))
    what = "this folder is" if path.is_dir() else "this file has"
    ending = "no rosbag2 recording" if path.is_dir() else f"no known extension: '{path.suffix}'"
    raise InputError(
        Problem(f"{what} {ending}", path, allowed=f"{known}, or the folder of a rosbag2 recording")
    )
