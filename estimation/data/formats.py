"""The formats that exist, and reading with their libraries: every failure is bad input."""

from __future__ import annotations

import importlib.util
import warnings
from functools import cache
from pathlib import Path

from constraints.modules import modules_of
from estimation.data import readers
from estimation.data.table import FileFormat, RawTable
from expdesign.configuration import DataSection, InputError

_LONGEST_REASON = 200


@cache
def file_formats() -> tuple[FileFormat, ...]:
    """Return every format: a module in ``estimation/data/readers`` is all that a new one needs."""
    return tuple(found for module in modules_of(readers).values() for found in module.FORMATS)


def format_of(path: Path) -> FileFormat:
    """Return the format of a file or folder.

    Raises
    ------
    InputError
        There is no such file, no format claims it, or its library is not installed.
    """
    if not path.exists():
        raise InputError("there is no such file", path)
    found = next((each for each in file_formats() if each.claims(path)), None)
    if found is None:
        known = ", ".join(sorted({suffix for each in file_formats() for suffix in each.extensions}))
        message = f"this file has no known extension: '{path.suffix}'"
        if path.is_dir():
            message = "this folder is no rosbag2 recording"
        allowed = f"{known}, or the folder of a rosbag2 recording"
        raise InputError(message, path, allowed=allowed)
    if found.library is not None and not _installed(found.library):
        message = f"{found.title} is read with {found.library}, which is not installed"
        install = f"after: pip install expdesign[{found.extra}]"
        raise InputError(message, path, allowed=install)
    return found


def _installed(library: str) -> bool:
    try:
        return importlib.util.find_spec(library) is not None
    except ValueError:  # a module without a specification, such as one that was blocked
        return False


def load_table(file_format: FileFormat, path: Path, section: DataSection) -> RawTable:
    """Read a file with its format's library, whose own warnings are for its developers.

    Raises
    ------
    InputError
        The file cannot be read, is damaged, or does not have the columns.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            table = file_format.read(path, section)
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError("there is no such file", path) from None
    except PermissionError:
        raise InputError("there is no permission to read it", path) from None
    except Exception as error:  # noqa: BLE001 - the libraries raise anything on damaged files
        said = " ".join(str(error).split())[:_LONGEST_REASON]
        reason = "".join(mark if mark.isprintable() else "?" for mark in said)
        raise damaged(file_format, path, reason or type(error).__name__) from None
    count = len(table.values["t"])
    time = table.column_name("t")
    uneven = [
        table.problem(f"the column has {len(values)} samples, '{time}' has {count}", channel)
        for channel, values in table.values.items()
        if len(values) != count
    ]
    if uneven:
        raise InputError(uneven)
    return table


def damaged(file_format: FileFormat, path: Path, reason: str) -> InputError:
    """Return the error of a file that its library cannot read."""
    message = f"the file is damaged or not of the format {file_format.title}: {reason}"
    return InputError(message, path)
