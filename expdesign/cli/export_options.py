"""What `expdesign export` was asked for: its options over those of the run file."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

from expdesign.cli.output import note

if TYPE_CHECKING:
    from expdesign.configuration import ExportSection, RunConfiguration

_LISTS = ("axes",)
_NUMBERS = ("order",)
_ONE_OR_SIX = ("offset", "counts_per_metre")


def given_options(**texts: str | None) -> dict[str, Any]:
    """Return the options that are given, as the run file would state them.

    Parameters
    ----------
    **texts : str or None
        By key of `export:`; None where the option is not given.
    """
    given: dict[str, Any] = {}
    for key, text in texts.items():
        if text is None:
            continue
        if key == "digits":
            given[key] = _whole(text)
        elif key in _LISTS:
            given[key] = _items(text)
        elif key in _NUMBERS:
            given[key] = _wholes(text)
        elif key == "sign":
            given[key] = _one_or_list(_wholes(text))
        elif key in _ONE_OR_SIX:
            given[key] = _one_or_list(_items(text))
        else:
            given[key] = text
    return given


def export_section(
    name: str, given: dict[str, Any], configuration: RunConfiguration
) -> ExportSection:
    """Return what is asked for: the run's own options for the format, overridden by these.

    Options of the run that do not go with what is given are left out, and named.

    Raises
    ------
    InputError
        An option cannot be kept, or the run has several tables of the format and none is named.
    """
    from dataclasses import replace

    from expdesign.configuration import (
        ExportSection,
        InputError,
        document_from_mapping,
        validate,
    )

    stated = _stated(name, given.get("file"), configuration)
    data = {} if stated is None else stated.model_dump(exclude_none=True)
    left_out = {} if stated is None else _left_out(given, stated)
    for key in itertools.chain.from_iterable(left_out.values()):
        del data[key]
    data |= {"format": name, **given}
    found, problems = validate(ExportSection, data, document_from_mapping(data))
    if found is None:
        raise InputError(replace(problem, key=_option(problem.key)) for problem in problems)
    for option, keys in left_out.items():
        note(f"left out, since {option} is given: {', '.join(keys)} of the run's export")
    return found


def _option(key: str) -> str:
    return f"--{key.replace('_', '-')}"


def _stated(name: str, file: str | None, configuration: RunConfiguration) -> ExportSection | None:
    """Return the table of this format that the run names; of several the one with this file."""
    from expdesign.configuration import InputError, Problem

    named = [entry for entry in configuration.run.export if entry.format == name]
    if len(named) > 1:
        named = [entry for entry in named if entry.stem == file] or named
    if len(named) > 1:
        stems = [entry.stem for entry in named]
        raise InputError(
            Problem(
                f"the run has {len(named)} tables of {name}, each with options of its own"
                + ("" if file is None else f", and none of them is '{file}'"),
                file=configuration.file,
                key="--file",
                allowed=" | ".join(stems),
            )
        )
    return named[0] if named else None


def _left_out(given: dict[str, Any], stated: ExportSection) -> dict[str, list[str]]:
    """Return which options of the run do not go with those given, by the option given."""
    from expdesign.configuration import STRUT_ONLY

    against: dict[str, tuple[str, ...]] = {}
    if "counts_per_metre" in given:
        against["counts_per_metre"] = ("units",)
    if "units" in given:
        against["units"] = ("counts_per_metre",)
    if given.get("space", stated.coordinates) != stated.coordinates:
        # Its axes are those of the other coordinates.
        against["space"] = ("axes", *(STRUT_ONLY if given["space"] == "pose" else ()))
    if given.get("encoding") == "mcap":
        against["encoding"] = ("digits",)
    gone: dict[str, list[str]] = {}
    for option, keys in against.items():
        found = [
            key
            for key in keys
            if getattr(stated, key) is not None and not any(key in known for known in gone.values())
        ]
        if found:
            gone[_option(option)] = found
    return gone


def _items(text: str) -> list[str]:
    return [item.strip() for item in text.split(",")]


def _whole(text: str) -> int | str:
    """Return a whole number; text that is none is left to the schema, which refuses it."""
    try:
        return int(text)
    except ValueError:
        return text


def _wholes(text: str) -> list[int | str]:
    return [_whole(item) for item in _items(text)]


def _one_or_list(items: list[Any]) -> Any:
    return items[0] if len(items) == 1 else items
