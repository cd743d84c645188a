"""How a value is refused: what was wrong, what is allowed, and what was probably meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

from pydantic_core import PydanticCustomError

_LONGEST_SHOWN = 60


def refusal(
    reason: str, allowed: str, nearest: str | None = None, key: str = ""
) -> PydanticCustomError:
    """Make the exception that a validator raises.

    Parameters
    ----------
    reason : str
        What is wrong with the value that was given.
    allowed : str
        What would be accepted instead.
    nearest : str, optional
        The valid spelling closest to what was given.
    key : str, optional
        The key that is to be changed, when the validator is that of a whole section.
    """
    context = {"reason": reason, "allowed": allowed, "nearest": nearest or "", "key": key}
    return PydanticCustomError("refused", "{reason}", context)


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
    text = f"'{value}'" if text is None else text
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
