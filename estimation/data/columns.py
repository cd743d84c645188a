"""Assignment of a file's columns to channels: names, units in headers, missing columns."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from expdesign.configuration import InputError, Problem, quote
from expdesign.configuration.errors import nearest_name
from expdesign.configuration.sections.data import CHANNELS

OPTIONAL = frozenset({"period"})
"""Channels that a file need not have."""

_WITH_UNIT = re.compile(r"(.*?\S)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))")
_MOST_SHOWN = 30


@dataclass(frozen=True)
class RecordedColumn:
    """A column as the file names it.

    `text` is its full name, as messages show it and `data.columns` may give it, `name` the same
    without a unit, and `short` without the struct or group that it is in; each is the one before
    unless given. By its place the reader finds it: a position or path, different for each column.
    """

    text: str
    place: Any = None
    name: str = ""
    short: str = ""
    unit: str | None = None

    def __post_init__(self) -> None:
        """Fill in the shorter names."""
        object.__setattr__(self, "name", self.name or self.text)
        object.__setattr__(self, "short", self.short or self.name)

    @property
    def label(self) -> str:
        """Its full name as messages show it: short, on one line, without control codes."""
        return label(self.text)

    @property
    def spellings(self) -> tuple[str, str, str]:
        """Accepted names of the column, the most exact first."""
        return self.text, self.name, self.short


def label(text: str) -> str:
    """Return a text from a file as messages show it: without quotes unlike `shown`."""
    return quote(text).removeprefix("'").removesuffix("'")


def header_column(text: str, place: Any) -> RecordedColumn:
    """Read a header such as ``q1 [mm]`` or ``q1 (mm)``; brackets around digits are no unit."""
    text = text.strip()
    match = _WITH_UNIT.fullmatch(text)
    if match is None:
        return RecordedColumn(text, place)
    unit = (match.group(2) if match.group(2) is not None else match.group(3)).strip()
    if unit[:1].isdigit():
        return RecordedColumn(text, place)
    return RecordedColumn(
        text, place, name=match.group(1), unit=None if unit in ("", "-") else unit
    )


def pick(
    columns: Sequence[RecordedColumn],
    names: Mapping[str, str],
    file: Path,
    line: int | None = None,
    optional: Collection[str] = OPTIONAL,
) -> dict[str, RecordedColumn]:
    """Return the column of every channel.

    A name is the full one, the one without its unit, or the one without its struct or group when
    that is unique. Without a name in `names`, a channel's column is called like the channel, or is
    the column of a matrix: q3 is ``q3`` or ``q(:,3)``.

    Parameters
    ----------
    names : mapping
        Channel → name, from `data.columns`.
    file, line
        For messages.
    optional : collection of str
        Channels that may be missing when `names` does not name them.

    Raises
    ------
    InputError
        Columns that are missing, with the nearest name; that several have the name of; or that
        would be two channels at once.
    """
    place = Problem("", file, line)
    found: dict[str, RecordedColumn] = {}
    missing: dict[str, str] = {}
    problems: list[Problem] = []
    for channel in CHANNELS:
        wanted = (names[channel],) if channel in names else _default_names(channel)
        matches = next((some for n in wanted if (some := _columns_named(n.strip(), columns))), ())
        if len(matches) == 1:
            found[channel] = matches[0]
        elif matches:
            problems.append(_ambiguous(channel, wanted[0], matches, place))
        elif channel in names or channel not in optional:
            missing[channel] = wanted[0]
    free = [column for column in columns if column not in found.values()]
    problems += [_missing(*one, columns, free, place) for one in missing.items()]
    problems += _shared_columns(found, place)
    if problems:
        raise InputError(problems)
    return found


def _default_names(channel: str) -> tuple[str, ...]:
    return (channel, f"{channel[0]}(:,{channel[1]})") if len(channel) == 2 else (channel,)  # noqa: PLR2004 - q1…Q6


def _columns_named(name: str, columns: Sequence[RecordedColumn]) -> Sequence[RecordedColumn]:
    """Return the columns of a name, in the most exact of its spellings that any has."""
    levels = ([c for c in columns if c.spellings[level] == name] for level in range(3))
    return next((level for level in levels if level), [])


def _ambiguous(
    channel: str, name: str, matches: Sequence[RecordedColumn], place: Problem
) -> Problem:
    texts = list(dict.fromkeys(column.label for column in matches))
    if len(texts) == 1:
        message = f"{len(matches)} columns have the name of {channel}"
        return replace(place, message=message, key=texts[0], allowed="one column")
    message = f"several columns could be {channel}"
    return replace(place, message=message, key=name, allowed=_one_of(channel, texts))


def _missing(
    channel: str,
    name: str,
    columns: Sequence[RecordedColumn],
    free: Sequence[RecordedColumn],
    place: Problem,
) -> Problem:
    if not columns:
        return replace(place, message=f"no column for {channel}: the file has none", key=name)
    texts = [column.label for column in free if column.text]
    meant = nearest_name(name, texts) or (
        nearest_name(name, [label(column.short) for column in free])
        if channel != "t"
        else next((text for text in texts if text.lower().startswith("t")), None)
    )
    message = f"there is no column {quote(name)} for {channel}"
    taken = f"data.columns: {{{channel}: …}} with a column that no other channel has: none is left"
    allowed = _one_of(channel, texts) if texts else taken
    return replace(place, message=message, key=name, allowed=allowed, nearest=meant)


def _shared_columns(found: Mapping[str, RecordedColumn], place: Problem) -> Iterator[Problem]:
    seen: dict[Any, str] = {}
    for channel, column in found.items():
        if column.place in seen:
            message = f"one column for both {seen[column.place]} and {channel}"
            allowed = "data.columns: one for each channel"
            yield replace(place, message=message, key=column.label, allowed=allowed)
        seen[column.place] = channel


def _one_of(channel: str, texts: Sequence[str]) -> str:
    some = ", ".join(f"'{text}'" for text in texts[:_MOST_SHOWN])
    more = len(texts) - _MOST_SHOWN
    listed = f"{some} and {more} more" if more > 0 else some
    return f"data.columns: {{{channel}: …}} with one of {listed}"
