"""From a file to the columns in it, with every failure told as bad input."""

from __future__ import annotations

import importlib.util
import warnings
from pathlib import Path

from estimation.data.defects import refuse_different_lengths
from estimation.data.file_format import FileFormat
from estimation.data.table import RawTable
from expdesign.configuration import DataSection, InputError, Problem

_LONGEST_REASON = 200


def require_library(file_format: FileFormat, path: Path) -> None:
    """Refuse a file whose format needs a library that is not installed.

    Raises
    ------
    InputError
        How to install it.
    """
    if file_format.library is None or _installed(file_format.library):
        return
    message = f"{file_format.title} is read with {file_format.library}, which is not installed"
    install = f"after: pip install expdesign[{file_format.extra}]"
    raise InputError(Problem(message, path, allowed=install))


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
        raise InputError(Problem("there is no such file", path)) from None
    except PermissionError:
        raise InputError(Problem("there is no permission to read it", path)) from None
    except Exception as error:  # noqa: BLE001 - the libraries raise anything on damaged files
        said = " ".join(str(error).split())[:_LONGEST_REASON]
        reason = "".join(mark if mark.isprintable() else "?" for mark in said)
        raise InputError(damaged(file_format, path, reason or type(error).__name__)) from None
    refuse_different_lengths(table)
    return table


def damaged(file_format: FileFormat, path: Path, reason: str) -> Problem:
    """Return the record of a file that its library cannot read."""
    return Problem(f"the file is damaged or not of the format {file_format.title}: {reason}", path)
