"""JSON files of a run folder: one frozen type each, which writes and reads its file."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

from pydantic import ConfigDict, ValidationError
from pydantic_core import PydanticCustomError

from expdesign.configuration import InputError, Problem
from expdesign.configuration.problem import MOST_TOLD, Key, format_number, key_path, untold
from expdesign.configuration.text_file import read_text
from expdesign.configuration.wrong_value import wrong_value
from expdesign.runfolder.atomic import write_json
from expdesign.runfolder.described import checker, described

LARGEST_FILE = 64 * 1024 * 1024
"""Bytes that are read of a file at most."""

FORMAT = "format"
"""The key of the format number; a file without it was written before there was one: format 0."""


class MissingFileError(InputError):
    """A file that is needed is not in the run folder.

    Parameters
    ----------
    path : Path
    remedy : str
        What writes it.
    """

    def __init__(self, path: Path, remedy: str) -> None:
        super().__init__(Problem("there is no such file", path, allowed=remedy))
        self.path, self.remedy = path, remedy

    def __reduce__(self) -> tuple[type[MissingFileError], tuple[Path, str]]:  # type: ignore[override]
        return type(self), (self.path, self.remedy)


class JsonFile:
    """Base of the frozen dataclasses that are a JSON file each.

    Every field is ``Annotated`` with `described`: that is the documentation of its key. Keys that
    are not known are left alone, so that a later version may add some within a format.

    Attributes
    ----------
    FILE : str
        Path in the run folder.
    FORMAT : int
        Number of the format, one more whenever a reader of the number before would go wrong.
    WRITTEN_BY : str
        What writes it, for the message that it is missing.
    """

    FILE: ClassVar[str]
    FORMAT: ClassVar[int] = 1
    WRITTEN_BY: ClassVar[str]
    __pydantic_config__ = ConfigDict(arbitrary_types_allowed=True, extra="ignore")

    @classmethod
    def upgraded(cls, data: dict[str, Any], written: int) -> dict[str, Any]:
        """Return what a file of an earlier format holds in the form of today's.

        Parameters
        ----------
        data : dict
            What stands in the file.
        written : int
            Its format, below `FORMAT`; 0 before formats had numbers.
        """
        del written
        return data

    def contradictions(self) -> Iterator[Problem]:
        """Yield what in the file does not fit the rest of it: key, what is there, what is allowed.

        What a type alone tells is checked by then; see `expdesign.runfolder.contradiction`.
        """
        yield from ()

    @classmethod
    def read(cls, place: Path) -> Self:
        """Read the file.

        Parameters
        ----------
        place : Path
            A run folder, or the file itself.

        Raises
        ------
        MissingFileError
            There is none.
        InputError
            It is not JSON, of a newer format, a key is missing or not of its kind, or keys
            contradict each other; every problem with file and key.
        """
        path = place / cls.FILE if place.is_dir() else place
        if not path.is_file():
            raise MissingFileError(path, cls.WRITTEN_BY)
        data = read_mapping(path, f"what is written by {cls.WRITTEN_BY}")
        written = known_format(path, data.get(FORMAT, 0), cls.FORMAT)
        data = cls.upgraded(data, written) if written < cls.FORMAT else data
        try:
            found: Self = checker(cls).validate_python(data)
        except ValidationError as error:
            raise InputError(_problems(path, data, error)) from error
        if wrong := [replace(problem, file=path) for problem in found.contradictions()]:
            raise InputError(wrong)
        return found

    @classmethod
    def known(cls, place: Path) -> Self | None:
        """Read the file; None when there is none, or none that can be used.

        Raises
        ------
        InputError
            It is of a newer format.
        """
        try:
            return cls.read(place)
        except InputError as error:
            if any(problem.key == FORMAT for problem in error.problems):
                raise
            return None

    def write(self, folder: Path) -> Path:
        """Write the file into a run folder; NaN and ±inf become null."""
        return self.write_as(folder / self.FILE)

    def write_as(self, path: Path) -> Path:
        """Write it under another name, where there are several of them."""
        write_json(path, {FORMAT: self.FORMAT, **self.as_data()})
        return path

    def as_data(self) -> dict[str, Any]:
        """Return the keys of the file and their values."""
        return checker(type(self)).dump_python(self, by_alias=True)


@dataclass(frozen=True, eq=False, kw_only=True)
class RunFile(JsonFile):
    """Base of those that say what a stage found, and of what."""

    units: Annotated[str, described("", "of all values")] = "SI and radians"
    name: Annotated[str, described("", "name of the run")]
    robot: Annotated[str, described("", "name of the robot")]


def read_mapping(path: Path, allowed: str = "a JSON file that expdesign wrote") -> dict[str, Any]:
    """Read a JSON file that holds a mapping.

    Raises
    ------
    InputError
        It cannot be read, is too large, is not JSON, or holds something else.
    """
    text = read_text(path, LARGEST_FILE, allowed)
    try:
        data = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(f"not JSON: {error.msg}", path, error.lineno, allowed=allowed) from error
    except (ValueError, RecursionError) as error:
        # A number of very many digits, or brackets without end.
        raise InputError("not JSON that can be read", path, allowed=allowed) from error
    if not isinstance(data, dict):
        raise InputError("the file holds no mapping", path, 1, allowed=allowed)
    return data


def known_format(path: Path, found: object, newest: int) -> int:
    """Return the format number of a file.

    Raises
    ------
    InputError
        It is no number, or newer than what this version reads.
    """
    try:
        return format_number(found, newest)
    except PydanticCustomError as error:
        allowed = (error.context or {})["allowed"]
        raise InputError(error.message(), path, key=FORMAT, allowed=allowed) from None


def _problems(path: Path, data: object, error: ValidationError) -> Iterator[Problem]:
    every, found = error.errors(include_url=False), dict[Key, Problem]()
    for details in every[:MOST_TOLD]:
        missing = details["type"] == "missing"
        key = _key_in(data, details["loc"][:-1] if missing else details["loc"])
        key += details["loc"][-1:] if missing else ()
        message, allowed = ("the key is missing", None) if missing else wrong_value(details)
        # Of the alternatives that one value may be, the last is the widest.
        found[key] = Problem(message, path, key=key_path(key), allowed=allowed)
    yield from found.values()
    yield from untold(len(every) - MOST_TOLD)


def _key_in(data: object, location: Key) -> Key:
    """Return a location of pydantic without its names of alternatives, which no file has."""
    key: Key = ()
    for step in location:
        match data, step:
            case dict(), str() if step in data:
                data = data[step]
            case list(), int() if step < len(data):
                data = data[step]
            case _:
                continue
        key = (*key, step)
    return key
