"""Results of stages in a run folder: stored and read by the annotations of their fields.

A field states its unit, its meaning and its place once, at its declaration::

    @dataclass(frozen=True, eq=False, kw_only=True)
    class SwingResult(StageResult):
        FILE: ClassVar[str] = "swing.json"
        WRITTEN_BY: ClassVar[str] = "`expdesign swing`"
        omega: Annotated[float, described("rad/s", "base frequency")]
        checks: Annotated[tuple[LimitCheck, ...], Table("tables/limits.csv")]

`StageResult` writes and reads the files from that; `expdesign.runfolder.documentation` prints the
same as tables of the manual.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass, fields, make_dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, get_args, get_origin, get_type_hints

from pydantic import ConfigDict, ValidationError

from expdesign.configuration import InputError, Problem, quote
from expdesign.configuration.errors import (
    MOST_REPORTED,
    Key,
    key_path,
    remaining_problems,
    value_problem,
)
from expdesign.runfolder.fields import Column, cached_by_type, checker, described
from expdesign.runfolder.files import (
    FORMAT,
    LARGEST_NUMBER,
    MissingFileError,
    check_format,
    read_mapping,
    write_json,
)
from expdesign.runfolder.places import Place, Table


@dataclass(frozen=True)
class Member:
    """A field of a result, or a property that is stored but not read."""

    attribute: str
    kind: Any
    """Its type without annotations."""
    hint: Any
    """Its type with annotations."""
    marks: tuple[Any, ...]
    field: dataclasses.Field[Any] | None
    """None for a property."""

    @property
    def column(self) -> Column | None:
        """Its name, unit and meaning as a key of the JSON file; None outside that file."""
        found = next((mark for mark in self.marks if isinstance(mark, Column)), None)
        return found and replace(found, name=found.name or self.attribute)

    @property
    def place(self) -> Place | None:
        """Its further files."""
        return next((mark for mark in self.marks if isinstance(mark, Place)), None)


class JsonFile:
    """Base of frozen dataclasses that are stored in a JSON file.

    Each field is ``Annotated`` with `described`: its key, unit and meaning. A property with such a
    return type is written and checked, but not read: its value follows from the fields. Unknown
    keys are ignored.
    """

    FILE: ClassVar[str]
    """Path in the run folder."""
    FORMAT: ClassVar[int] = 1
    """Number of the format; a file with another number is refused."""
    WRITTEN_BY: ClassVar[str]
    """Command that writes it, for the message about a missing file."""
    WRITTEN_BY_HAND: ClassVar[bool] = False
    """A file without the key ``format`` is accepted."""

    def contradictions(self) -> Iterator[Problem]:
        """Yield the contradictions between the values: key, value found, values allowed.

        Types and shapes are checked before. A problem without a file is one of the JSON file, a
        relative path is one in the run folder. See `wrong_shape`, `unknown_names` and others in
        `expdesign.runfolder.fields`.
        """
        yield from ()

    @classmethod
    def read(cls, place: Path) -> Self:
        """Read the file, of a run folder or at its own path.

        Every problem, such as another version, a missing key, a wrong value or a contradiction, is
        in one `InputError` with file and key; a missing file is a `MissingFileError`.
        """
        path = place / cls.FILE if place.is_dir() else place
        found = cls(**stored_values(cls, read_keys(cls, path)))
        found.refuse_contradictions(path, path.parent)
        return found

    def refuse_contradictions(self, path: Path, folder: Path) -> None:
        """Raise the contradictions as an `InputError`."""
        wrong = [
            replace(problem, file=path if problem.file is None else folder / problem.file)
            for problem in self.contradictions()
        ]
        if wrong:
            raise InputError(wrong)

    @classmethod
    def known(cls, place: Path) -> Self | None:
        """Read the file; return None where it is missing or unusable; refuse another version."""
        try:
            return cls.read(place)
        except InputError as error:
            if any(problem.key == FORMAT for problem in error.problems):
                raise
            return None

    def write(self, folder: Path) -> list[Path]:
        """Write the files into a run folder; return them. NaN and ±inf become null in JSON."""
        return [self.write_as(folder / self.FILE)]

    def write_as(self, path: Path) -> Path:
        """Write the JSON file under another name."""
        write_json(path, {FORMAT: self.FORMAT, **self.as_data()})
        return path

    def as_data(self) -> dict[str, Any]:
        """Return the keys of the file and their values."""
        keys = json_keys(type(self))
        values = {key: getattr(self, member.attribute) for key, member in keys.items()}
        kind = json_type(type(self))
        return checker(kind).dump_python(kind(**values), by_alias=True)


@dataclass(frozen=True, eq=False, kw_only=True)
class RunFile(JsonFile):
    """Base of the JSON files of a run: units, name of the run, name of the robot."""

    units: Annotated[str, described("", "of all values")] = "SI and radians"
    name: Annotated[str, described("", "name of the run")]
    robot: Annotated[str, described("", "name of the robot")]


class StageResult(JsonFile):
    """Base of the results of stages: a frozen dataclass that is stored in several files.

    Each field is annotated with `described`, a key of the JSON file ``FILE``, or with a `Place`:
    `Table`, `Matrix`, `Numbered`, `Text`, `StoredConfiguration`. A property with such a return type
    is written and not read. Fields are read in the order of their declaration, keys first, so that
    a table may depend on properties of fields before it.
    """

    view: ClassVar[Any]
    """Content of the result, a `results.render.notebook.ResultView`: given by its stage."""

    @classmethod
    def read(cls, place: Path) -> Self:
        """Read the result from its run folder; nothing is computed.

        Raises
        ------
        InputError
            A file is missing (`MissingFileError`), has a wrong content, or contradicts another one.
        """
        keys = read_keys(cls, place / cls.FILE)
        partial = object.__new__(cls)
        values = vars(partial)
        values |= stored_values(cls, keys)
        for each in members(cls):
            if each.place is not None and each.field is not None and each.column is None:
                values[each.attribute] = each.place.read(partial, each.kind, place)
        names = {field.name for field in fields(cls)}  # type: ignore[arg-type]
        found = cls(**{name: value for name, value in values.items() if name in names})
        found.refuse_contradictions(place / cls.FILE, place)
        for each in members(cls):
            if isinstance(each.place, Table) and each.place.as_in:
                rows = None if each.field is None else getattr(found, each.attribute)
                each.place.refuse_other_rows(found, keys, each.kind, rows, place)
        return found

    def write(self, folder: Path) -> list[Path]:
        """Write the files into a run folder; return them."""
        written = [
            path
            for each in members(type(self))
            if each.place is not None
            for path in each.place.write(self, each.kind, getattr(self, each.attribute), folder)
        ]
        written += super().write(folder)
        return list(dict.fromkeys(written))


@cached_by_type
def members(kind: type[Any]) -> tuple[Member, ...]:
    """Return the annotated fields of a result and its annotated properties, in their order."""
    hints, found = get_type_hints(kind, include_extras=True), []
    for field in fields(kind):
        marks = _marks(hints[field.name])
        if not any(isinstance(mark, Column | Place) for mark in marks):
            raise TypeError(f"{kind.__name__}.{field.name}: neither unit nor meaning is given")
        found.append(Member(field.name, _plain(hints[field.name]), hints[field.name], marks, field))
    for name in dict.fromkeys(name for each in reversed(kind.__mro__) for name in vars(each)):
        member = getattr(kind, name, None)
        getter = member.fget if isinstance(member, property) else getattr(member, "func", None)
        if not isinstance(member, property | cached_property) or getter is None:
            continue
        returned: Any = getter.__annotations__.get("return", "")
        # Other return types may name what is imported for type checking only.
        if get_origin(returned) is Annotated or str(returned).startswith("Annotated["):
            hint = get_type_hints(getter, include_extras=True)["return"]
            found.append(Member(name, _plain(hint), hint, _marks(hint), None))
    return tuple(found)


def _marks(hint: Any) -> tuple[Any, ...]:
    return tuple(getattr(hint, "__metadata__", ()))


def _plain(hint: Any) -> Any:
    return get_args(hint)[0] if get_origin(hint) is Annotated else hint


@cached_by_type
def json_keys(kind: type[Any]) -> dict[str, Member]:
    """Return the members that are keys of the JSON file, by key."""
    return {each.column.name: each for each in members(kind) if each.column is not None}


@cached_by_type
def json_type(kind: type[Any]) -> type[Any]:
    """Return a dataclass of the keys of a JSON file, which checks and serialises them."""
    keys = [
        (
            key,
            member.hint,
            dataclasses.field()
            if member.field is None
            else dataclasses.field(
                default=member.field.default, default_factory=member.field.default_factory
            ),
        )
        for key, member in json_keys(kind).items()
    ]
    config = ConfigDict(arbitrary_types_allowed=True, extra="ignore")
    return make_dataclass(
        kind.__name__, keys, kw_only=True, namespace={"__pydantic_config__": config}
    )


_MISSING = "the key is missing"


def read_keys(kind: type[JsonFile], path: Path) -> Any:
    """Read and check the keys of a JSON file; return them as attributes."""
    if not path.is_file():
        raise MissingFileError(path, kind.WRITTEN_BY)
    data = read_mapping(path, f"a file written by {kind.WRITTEN_BY}")
    if FORMAT in data or not kind.WRITTEN_BY_HAND:
        check_format(path, data.get(FORMAT), kind.FORMAT)
    try:
        keys = checker(json_type(kind)).validate_python(data)
    except ValidationError as error:
        found = list(_problems(path, data, error))
        lacking = [problem.key for problem in found if problem.message == _MISSING]
        if lacking and not kind.WRITTEN_BY_HAND:
            message = "the key is missing: made by an earlier version, or edited; run it again"
            raise InputError(message, path, key=lacking[0]) from error
        raise InputError(found) from error
    wrong = [
        Problem(f"{quote(value)} is not a number of a result", path, key=key_path(key), allowed=to)
        for to in [f"numbers up to {LARGEST_NUMBER:g}, null for a missing one"]
        for key, value in _large_numbers(data, ())
    ]
    if wrong:
        raise InputError(wrong[:MOST_REPORTED])
    return keys


_NUMBERS, _NESTED = frozenset({int, float}), frozenset({dict, list})


def _large_numbers(data: dict[str, Any] | list[Any], key: Key) -> Iterator[tuple[Key, float]]:
    """Yield the numbers beyond `LARGEST_NUMBER` in JSON data with their keys."""
    for name, part in data.items() if isinstance(data, dict) else enumerate(data):
        kind = type(part)  # of JSON data: no subclasses
        if kind in _NUMBERS:
            if not abs(part) <= LARGEST_NUMBER:
                yield (*key, name), part
        elif kind in _NESTED:
            yield from _large_numbers(part, (*key, name))


def stored_values(kind: type[JsonFile], keys: Any) -> dict[str, Any]:
    """Return the values of the fields among the keys, by attribute."""
    return {
        member.attribute: getattr(keys, key)
        for key, member in json_keys(kind).items()
        if member.field is not None
    }


def _problems(path: Path, data: object, error: ValidationError) -> Iterator[Problem]:
    every, found = error.errors(include_url=False), dict[Key, Problem]()
    for details in every[:MOST_REPORTED]:
        missing = details["type"] == "missing"
        key = _key_in(data, details["loc"][:-1] if missing else details["loc"])
        key += details["loc"][-1:] if missing else ()
        message, allowed, _ = (_MISSING, None, None) if missing else value_problem(details)
        # Of the alternatives that one value may be, the last is the widest.
        found[key] = Problem(message, path, key=key_path(key), allowed=allowed)
    yield from found.values()
    yield from remaining_problems(len(every) - MOST_REPORTED)


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
