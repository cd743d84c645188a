"""What is wrong with an input, said for people: file, line, key, what is allowed, nearest name."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import AfterValidator
from pydantic_core import ErrorDetails, PydanticCustomError

_LONGEST_SHOWN = 60
MOST_TOLD = 20
"""Problems of an input that are told one by one."""
Key = tuple[str | int, ...]
"""Path to a value: keys of mappings and (from zero) positions in lists."""


def key_path(key: Key) -> str:
    """Return a key as the user reads it: ``base_joints[3][1]``, positions counted from one."""
    text = ""
    for part in key:
        if isinstance(part, int):
            text += f"[{part + 1}]"
        else:
            name = _cut(part if part.isprintable() else ascii(part))
            text += f".{name}" if text else name
    return text


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong with an input."""

    message: str
    """What is wrong, in words."""
    file: Path | None = None
    """The file that it stands in; None when the input is no file."""
    line: int | None = None
    """From one."""
    key: str = ""
    """Path to the value, as of `key_path`; empty for the file as a whole."""
    allowed: str | None = None
    """What would be accepted."""
    nearest: str | None = None
    """The valid name that was probably meant."""
    more: int = 0
    """How many problems it stands for that are not told one by one."""

    @property
    def place(self) -> str:
        """File, line and key, as far as they are known: ``run.yaml:4: trajectory.harmonics``."""
        file = "" if self.file is None else str(self.file)
        line = "" if self.line is None else f":{self.line}"
        return ": ".join(part for part in (f"{file}{line}", self.key) if part)

    def __str__(self) -> str:
        text = f"{self.place}: {self.message}" if self.place else self.message
        if self.nearest:
            text += f"; did you mean '{self.nearest}'?"
        if self.allowed:
            text += f" (allowed: {self.allowed})"
        return text


def untold(count: int) -> list[Problem]:
    """Return what stands for problems that are not told one by one; nothing for none."""
    words = f"and {count} more problem{'' if count == 1 else 's'}"
    return [Problem(words, more=count)] if count > 0 else []


class InputError(Exception):
    """Bad input: what is wrong with it, at least one problem.

    Of one problem the words are enough, with what `Problem` takes beside them. Of very many the
    first `MOST_TOLD` are told, and how many more there are.
    """

    def __init__(
        self,
        problems: str | Problem | Iterable[Problem],
        file: Path | None = None,
        line: int | None = None,
        key: str = "",
        allowed: str | None = None,
        nearest: str | None = None,
    ) -> None:
        if isinstance(problems, str):
            problems = Problem(problems, file, line, key, allowed, nearest)
        found = (problems,) if isinstance(problems, Problem) else tuple(problems)
        if not found:
            raise ValueError("an InputError needs a problem")
        told = [problem for problem in found if not problem.more]
        rest = sum(problem.more for problem in found) + len(told[MOST_TOLD:])
        self.problems: tuple[Problem, ...] = (*told[:MOST_TOLD], *untold(rest))
        super().__init__("\n".join(str(problem) for problem in self.problems))

    def __reduce__(self) -> tuple[type[InputError], tuple[tuple[Problem, ...]]]:
        return type(self), (self.problems,)


class ComputationError(Exception):
    """A computation has no result, though its input is valid: root of all such errors.

    Parameters
    ----------
    message : str
        What happened, and what can be done about it.
    details : dict, optional
        The same for machines.
    """

    def __init__(self, message: str, details: dict[str, Any] | None = None) -> None:
        super().__init__(message)
        self.message, self.details = message, details or {}


def refusal(
    reason: str,
    allowed: str,
    nearest: str | Callable[[], str | None] | None = None,
    key: str = "",
) -> PydanticCustomError:
    """Return the exception that a validator raises.

    Parameters
    ----------
    reason : str
        What is wrong with the value that was given.
    allowed : str
        What would be accepted instead.
    nearest : str or callable, optional
        The valid spelling closest to what was given, or what looks for it: that takes time, and is
        done where the problem is told.
    key : str, optional
        The key that is to be changed, when the validator is that of a whole section.
    """
    context = {"reason": reason, "allowed": allowed, "nearest": nearest or "", "key": key}
    return PydanticCustomError("refused", "{reason}", context)


def require(holds: Callable[[Any], object], reason: str, allowed: str) -> AfterValidator:
    """Return a validator of what must hold; `reason` is a format of ``value`` and of ``shown``."""

    def check(value: Any) -> Any:
        if not holds(value):
            raise refusal(reason.format(value=value, shown=shown(value)), allowed)
        return value

    return AfterValidator(check)


def format_number(found: object, newest: int) -> int:
    """Return the format number of a file; refuse what is none, or newer than this version reads."""
    if isinstance(found, bool) or not isinstance(found, int) or found < 0:
        raise refusal(f"{shown(found)} is no format number", f"a whole number up to {newest}")
    if found > newest:
        raise refusal(
            f"the file has format {found}, this version of expdesign reads up to {newest}",
            "a newer version of expdesign, or a file that this one wrote",
        )
    return found


def shown(value: object) -> str:
    """Return a value as it can stand in a message: short, on one line, without control codes."""
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}"
    if value is None:
        return "nothing"
    try:
        text = ascii(value) if not isinstance(value, str) or not value.isprintable() else None
    except ValueError:  # an integer with more digits than Python converts
        return "a number of very many digits"
    return _cut(f"'{value}'" if text is None else text)


def _cut(text: str) -> str:
    return text if len(text) <= _LONGEST_SHOWN else f"{text[: _LONGEST_SHOWN - 1]}…"


def nearest(given: object, valid: Iterable[str]) -> str | None:
    """Return the valid name that is spelt most like the one given, None when none is alike."""
    if not isinstance(given, str):
        return None
    by_lower_case = {name.lower(): name for name in reversed(list(valid))}
    # Long strings are no misspelling, and the comparison takes quadratic time.
    wanted = given.lower()[:_LONGEST_SHOWN]
    found = difflib.get_close_matches(wanted, by_lower_case, n=1, cutoff=0.5)
    return by_lower_case[found[0]] if found else None


_NEEDED = {
    "a finite number": ("finite_number",),
    "a number": ("float_type", "float_parsing"),
    "a whole number": ("int_type", "int_parsing", "int_parsing_size", "int_from_float"),
    "true or false": ("bool_type", "bool_parsing"),
    "a text": ("string_type",),
    "a list": ("list_type", "tuple_type"),
    "a mapping": ("dict_type", "mapping_type", "dataclass_type", "model_type"),
}
_KINDS = {kind: needed for needed, kinds in _NEEDED.items() for kind in kinds}
_BOUNDS = {
    "greater_than": ("gt", "above"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "below"),
    "less_than_equal": ("le", "at most"),
}


def wrong_value(details: ErrorDetails) -> tuple[str, str | None]:
    """Return what is wrong with a value and what is allowed, None where the first tells that.

    What is in no list here was raised by a validator of this package, whose words are kept.
    """
    kind, value, context = details["type"], shown(details["input"]), details.get("ctx", {})
    if kind == "refused":
        return context["reason"], context["allowed"]
    if kind in _KINDS:
        whole = isinstance(details["input"], float) and details["input"].is_integer()
        allowed = "one written without point and exponent" if whole else None
        return f"{value} is not {_KINDS[kind]}", allowed
    if kind in _BOUNDS:
        key, words = _BOUNDS[kind]
        return f"{value} is out of range", f"{words} {context[key]:g}"
    if kind in ("too_short", "too_long"):
        needed = context["min_length" if kind == "too_short" else "max_length"]
        return f"there are {context['actual_length']} entries where {needed} are needed", None
    if kind in ("literal_error", "enum"):
        return f"{value} is no choice", context["expected"]
    return f"{value}: {details['msg'].removeprefix('Value error, ')}", None
