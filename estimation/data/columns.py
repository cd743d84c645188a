"""Which column of a file is which channel: names, units in headers, what is missing."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from constraints.arrays import Array
from estimation.data.table import RawTable
from expdesign.configuration import (
    FORCE_CHANNELS,
    LENGTH_CHANNELS,
    DataSection,
    InputError,
    Problem,
    shown,
)
from expdesign.configuration.errors import nearest
from expdesign.configuration.quantity import CURRENT, Dimension, unit_dimension
from expdesign.configuration.sections.data import CHANNEL_UNITS, CHANNELS

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
        """What it may be called, the most exact first."""
        return self.text, self.name, self.short


def label(text: str) -> str:
    """Return a text from a file as messages show it: without quotes unlike `shown`."""
    return shown(text).removeprefix("'").removesuffix("'")


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
        matches = next((some for n in wanted if (some := _called(n.strip(), columns))), ())
        if len(matches) == 1:
            found[channel] = matches[0]
        elif matches:
            problems.append(_ambiguous(channel, wanted[0], matches, place))
        elif channel in names or channel not in optional:
            missing[channel] = wanted[0]
    free = [column for column in columns if column not in found.values()]
    problems += [_missing(*one, columns, free, place) for one in missing.items()]
    problems += _shared(found, place)
    if problems:
        raise InputError(problems)
    return found


def _default_names(channel: str) -> tuple[str, ...]:
    return (channel, f"{channel[0]}(:,{channel[1]})") if len(channel) == 2 else (channel,)  # noqa: PLR2004 - q1…Q6


def _called(name: str, columns: Sequence[RecordedColumn]) -> Sequence[RecordedColumn]:
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
    meant = nearest(name, texts) or (
        nearest(name, [label(column.short) for column in free])
        if channel != "t"
        else next((text for text in texts if text.lower().startswith("t")), None)
    )
    message = f"there is no column {shown(name)} for {channel}"
    taken = f"data.columns: {{{channel}: …}} with a column that no other channel has: none is left"
    allowed = _one_of(channel, texts) if texts else taken
    return replace(place, message=message, key=name, allowed=allowed, nearest=meant)


def _shared(found: Mapping[str, RecordedColumn], place: Problem) -> Iterator[Problem]:
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


def in_si(
    table: RawTable, section: DataSection, home: Array | None = None
) -> tuple[RawTable, tuple[str, ...]]:
    """Return the table in s, m and N by the struts' channels, and warnings.

    A column's unit is that of the file, else that of `section.units` for the channel or its
    group, else SI. Currents are multiplied by the force constants. Then a length or force is
    sign · channel + offset, and what stands in the file as q1 is the length of the first strut of
    `section.order`.

    Parameters
    ----------
    home : (6,), optional
        Lengths at home, m: for offsets that are called so.

    Raises
    ------
    InputError
        The file names a unit that is unknown, of another quantity, or not that of
        `section.units`; currents without force constants, or these without currents.
    """
    values = dict(table.values)
    problems: list[Problem] = []
    warnings: list[str] = []
    currents = False
    for channel in (name for name in table.values if name != "period"):
        try:
            factor, dimension, found = _factor(channel, channel, table, section)
        except InputError as error:
            problems += error.problems
            continue
        warnings += found
        if dimension is CURRENT:
            currents = True
            if section.force_constants is None:
                message = f"{channel} is a current, but no force constants are given"
                allowed = "data.force_constants: one value or six, in N/A"
                problems.append(table.header_problem(message, channel, allowed))
                continue
            factor *= section.force_constants[_strut(channel, section)]
        if factor != 1:
            values[channel] = values[channel] * factor
    if section.force_constants is not None and not currents and not problems:
        message = "data.force_constants are given, but no channel is a current"
        allowed = "data.units: {Q: A} if the file holds currents, or no data.force_constants"
        problems.append(table.header_problem(message, FORCE_CHANNELS[0], allowed))
    if problems:
        raise InputError(problems)
    table = replace(table, values=values)
    return _by_strut(_signed(table, section, home), section), tuple(warnings)


def _signed(table: RawTable, section: DataSection, home: Array | None) -> RawTable:
    """Return sign · channel + offset of lengths and forces."""
    offsets = {"q": section.length_offsets, "Q": section.force_offsets}
    if offsets["q"] == "home":
        if home is None:
            raise ValueError("offsets at home need the lengths there")
        offsets["q"] = tuple(home.tolist())
    values = dict(table.values)
    for channel in (*LENGTH_CHANNELS, *FORCE_CHANNELS):
        strut, group = _strut(channel, section), channel[0]
        sign, offset = section.channel_signs(group)[strut], float(offsets[group][strut])
        if sign != 1:
            values[channel] = -values[channel]
        if offset != 0:
            values[channel] = values[channel] + offset
    return replace(table, values=values)


def _by_strut(table: RawTable, section: DataSection) -> RawTable:
    """Return the table with the channels of the struts where those of the file stood."""
    names = {
        channel: f"{channel[0]}{_strut(channel, section) + 1}"
        for channel in (*LENGTH_CHANNELS, *FORCE_CHANNELS)
    }
    if all(channel == name for channel, name in names.items()):
        return table
    return replace(
        table,
        # Columns in their usual order, whatever that of the struts.
        values={name: table.values[_in_file(name, section)] for name in table.values},
        columns={
            name: table.columns.get(file := _in_file(name, section), RecordedColumn(file))
            for name in table.values
        },
        texts={(names.get(name, name), row): text for (name, row), text in table.texts.items()},
    )


def _strut(channel: str, section: DataSection) -> int:
    """Return the strut, from zero, that a length or force of the file is of."""
    return section.channel_order(channel[0])[int(channel[1]) - 1] - 1


def _in_file(channel: str, section: DataSection) -> str:
    """Return what the channel of a strut is called in the file."""
    if channel not in LENGTH_CHANNELS and channel not in FORCE_CHANNELS:
        return channel
    return f"{channel[0]}{section.channel_order(channel[0]).index(int(channel[1])) + 1}"


def unit_factor(channel: str, table: RawTable, section: DataSection) -> float:
    """Return what one unit of a strut's length is in SI, for a table that `in_si` took."""
    return _factor(_in_file(channel, section), channel, table, section)[0]


def _factor(
    channel: str, place: str, table: RawTable, section: DataSection
) -> tuple[float, Dimension | None, list[str]]:
    """Return what a column's unit is in SI and of which quantity, None without one; warnings.

    `channel` is that of the file, `place` where it stands in the table.
    """
    stated = section.units.get(channel, section.units.get(channel[0]))
    given = table.columns[place].unit if place in table.columns else None
    stated_dimension = None if stated is None else unit_dimension(stated)
    factor = 1.0 if stated_dimension is None else stated_dimension.parse(f"1 {stated}")
    if given is None:
        return factor, stated_dimension, []

    def refused(message: str, allowed: str) -> InputError:
        return InputError(table.header_problem(message, place, allowed))

    _, admitted = CHANNEL_UNITS[channel[0]]
    found = unit_dimension(given)
    if found is None:
        message = f"the file's unit {shown(given)} is not known"
        if stated is None:
            raise refused(message, f"a known unit, or data.units: {{{channel}: …}}")
        return factor, stated_dimension, [f"{channel}: {message}, '{stated}' used"]
    if found not in admitted:
        message = f"the file's unit {shown(given)} is that of {found.name}"
        raise refused(message, " or ".join(dimension.name for dimension in admitted))
    given_factor = found.parse(f"1 {given}")
    if stated is not None and (found, given_factor) != (stated_dimension, factor):
        message = f"the file says that {channel} is in {shown(given)}, data.units says '{stated}'"
        raise refused(message, "the same unit, or none in data.units")
    return given_factor, found, []
