"""From a file's columns to lengths and forces of the struts: units, signs, zeros and order."""

from __future__ import annotations

from dataclasses import replace

from constraints.arrays import Array
from estimation.data.columns import Column
from estimation.data.table import RawTable
from expdesign.configuration import (
    FORCE_CHANNELS,
    LENGTH_CHANNELS,
    DataSection,
    InputError,
    Problem,
    shown,
)
from expdesign.configuration.quantity import CURRENT, Dimension, unit_dimension
from expdesign.configuration.sections.data import CHANNEL_UNITS


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
            name: table.columns.get(file := _in_file(name, section), Column(file))
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
