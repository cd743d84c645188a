"""What pydantic finds wrong with a value, in the words of all other messages."""

from __future__ import annotations

from pydantic_core import ErrorDetails

from expdesign.configuration.problem import shown

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
