"""Errors for users: file, line, key, fault, allowed values, and the nearest valid name."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import AfterValidator
from pydantic_core import ErrorDetails, PydanticCustomError

MOST_REPORTED = 20
"""Largest number of problems that an error lists one by one."""

_LONGEST_QUOTE = 60

Key = tuple[str | int, ...]
"""Path to a value: keys of mappings and positions in lists, counted from zero."""


@dataclass(frozen=True)
class Problem:
    """One problem of an input."""

    message: str
    file: Path | None = None
    """The faulty file; None for an input from a program."""
    line: int | None = None
    """From one."""
    key: str = ""
    """Path to the value, as from `key_path`; empty for the file as a whole."""
    allowed: str | None = None
    """Description of the accepted values."""
    nearest: str | None = None
    """Valid name with the most similar spelling."""
    more: int = 0
    """Number of further problems in this entry."""

    @property
    def place(self) -> str:
        """Known parts of file, line and key: ``run.yaml:4: trajectory.harmonics``."""
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


class InputError(Exception):
    """Invalid input, with at least one problem and at most `MOST_REPORTED` listed ones.

    Parameters
    ----------
    problems : str, Problem or iterable of Problem
        A text is the message of a single problem.
    file, line, key, allowed, nearest
        Further fields of the single problem, as of `Problem`.

    Examples
    --------
    >>> print(InputError("the value is negative", key="design.starts", allowed="1 or more"))
    design.starts: the value is negative (allowed: 1 or more)
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
        listed = [problem for problem in found if not problem.more]
        rest = sum(problem.more for problem in found) + len(listed[MOST_REPORTED:])
        self.problems = (*listed[:MOST_REPORTED], *remaining_problems(rest))
        super().__init__("\n".join(str(problem) for problem in self.problems))

    def __reduce__(self) -> tuple[type[InputError], tuple[tuple[Problem, ...]]]:
        return type(self), (self.problems,)


def remaining_problems(count: int) -> tuple[Problem, ...]:
    """Return one entry for problems that are only counted; nothing for none."""
    words = f"and {count} more problem{'' if count == 1 else 's'}"
    return (Problem(words, more=count),) if count > 0 else ()


@contextmanager
def collect(problems: list[Problem]) -> Iterator[None]:
    """Add the problems of an `InputError` inside to a list, and go on."""
    try:
        yield
    except InputError as error:
        problems += error.problems


class ComputationError(Exception):
    """A computation fails although its input is valid: base class of all such errors.

    `details` has the message for programs.
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
    """Return the exception for a validator to raise, with the fault and the accepted values.

    `nearest` is the valid name with the most similar spelling, or the (slow) function that finds
    it; `key` is the key to change, for a validator of a whole section.
    """
    context = {"reason": reason, "allowed": allowed, "nearest": nearest or "", "key": key}
    return PydanticCustomError("refused", "{reason}", context)


def require(condition: Callable[[Any], object], reason: str, allowed: str) -> AfterValidator:
    """Return a validator of a condition; `reason` may contain ``{value}`` and ``{quoted}``."""

    def check(value: Any) -> Any:
        if not condition(value):
            shown = list(value) if isinstance(value, tuple) else value
            raise refusal(reason.format(value=shown, quoted=quote(value)), allowed)
        return value

    return AfterValidator(check)


_KINDS = {
    "finite_number": "a finite number",
    **dict.fromkeys(("float_type", "float_parsing"), "a number"),
    **dict.fromkeys(
        ("int_type", "int_parsing", "int_parsing_size", "int_from_float"), "a whole number"
    ),
    **dict.fromkeys(("bool_type", "bool_parsing"), "true or false"),
    "string_type": "a text",
    **dict.fromkeys(("list_type", "tuple_type"), "a list"),
    **dict.fromkeys(("dict_type", "mapping_type", "dataclass_type", "model_type"), "a mapping"),
}
_BOUNDS = {
    "greater_than": ("gt", "above"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "below"),
    "less_than_equal": ("le", "at most"),
}


def value_problem(details: ErrorDetails) -> tuple[str, str | None, str | None]:
    """Return message, allowed values and nearest valid name for an error of pydantic."""
    kind, given, context = details["type"], details["input"], details.get("ctx", {})
    value, allowed = quote(given), None
    if kind == "refused":
        meant = context["nearest"]
        meant = meant() if callable(meant) else meant
        return context["reason"], context["allowed"], meant or None
    if kind == "literal_error":
        choices = re.findall(r"'([^']*)'", context["expected"])
        return f"{value} is not a choice", " | ".join(choices), nearest_name(given, choices)
    if kind in _KINDS:
        if kind == "string_type":
            allowed = "text; put it in quotes"
        elif isinstance(given, float) and given.is_integer():
            allowed = "one written without point and exponent"
        message = f"{value} is not {_KINDS[kind]}"
    elif kind in _BOUNDS:
        key, words = _BOUNDS[kind]
        message, allowed = f"{value} is out of range", f"{words} {context[key]:g}"
    elif kind in ("too_short", "too_long"):
        needed = context["min_length" if kind == "too_short" else "max_length"]
        message = f"there are {context['actual_length']} entries where {needed} are needed"
    else:
        message = f"{value}: {details['msg'].removeprefix('Value error, ')}"
    return message, allowed, None


def format_number(found: object, newest: int) -> int:
    """Return a file's format number; refuse any other than that of this version.

    A file without a number was made by an earlier version.
    """
    number = 0 if found is None else found
    if isinstance(number, bool) or not isinstance(number, int) or number < 0:
        raise refusal(f"{quote(found)} is not a format number", f"the whole number {newest}")
    if number != newest:
        made = "a newer version" if number > newest else "an earlier version; run it again"
        raise refusal(f"the file was made by {made}", f"format {newest}")
    return number


def key_path(key: Key) -> str:
    """Return a key in the user's notation, with list positions from one.

    Examples
    --------
    >>> key_path(("base_joints", 2, 0))
    'base_joints[3][1]'
    """
    text = ""
    for part in key:
        if isinstance(part, int):
            text += f"[{part + 1}]"
        else:
            name = _shorten(part if part.isprintable() else ascii(part))
            text += f".{name}" if text else name
    return text


def quote(value: object) -> str:
    """Return a value for a message: short, on one line, without control characters.

    Examples
    --------
    >>> quote("5 mm"), quote([1, 2]), quote(None)
    ("'5 mm'", 'a list of 2', 'nothing')
    """
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
    return _shorten(f"'{value}'" if text is None else text)


def _shorten(text: str) -> str:
    return text if len(text) <= _LONGEST_QUOTE else f"{text[: _LONGEST_QUOTE - 1]}…"


def nearest_name(given: object, valid: Iterable[str]) -> str | None:
    """Return the valid name with the most similar spelling, None without a similar one.

    Examples
    --------
    >>> nearest_name("harmonic", ["samples", "harmonics"])
    'harmonics'
    """
    if not isinstance(given, str):
        return None
    by_lower_case = {name.lower(): name for name in reversed(list(valid))}
    # The comparison takes quadratic time, and a long text is no misspelling.
    wanted = given.lower()[:_LONGEST_QUOTE]
    found = difflib.get_close_matches(wanted, by_lower_case, n=1, cutoff=0.5)
    return by_lower_case[found[0]] if found else None
