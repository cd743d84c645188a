"""What `expdesign export` was asked for: its options over those of the run file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from expdesign.configuration import RunConfiguration
    from expdesign.schema import ExportSection

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
    """Return what is asked for: the run's own options for the format, overridden by these."""
    from dataclasses import replace

    from expdesign.configuration import ConfigurationError
    from expdesign.configuration.document import document_from_mapping
    from expdesign.configuration.validation import validate
    from expdesign.schema import ExportSection

    named = (entry for entry in configuration.run.export if entry.format == name)
    stated = next(named, None)
    data = {} if stated is None else stated.model_dump(exclude_none=True)
    if "counts_per_metre" in given:
        data.pop("units", None)
    if "units" in given:
        data.pop("counts_per_metre", None)
    data |= {"format": name, **given}
    found, problems = validate(ExportSection, data, document_from_mapping(data))
    if found is None:
        raise ConfigurationError(
            replace(problem, key=f"--{problem.key.replace('_', '-')}") for problem in problems
        )
    return found


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
