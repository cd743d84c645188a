"""From a file's columns to lengths and forces of the struts: units, signs, zeros and order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.data.columns import RecordedColumn
from estimation.data.table import MOST_PROBLEMS, RawTable, refuse, refuse_rows
from expdesign.configuration import (
    FORCE_CHANNELS,
    LENGTH_CHANNELS,
    DataSection,
    InputError,
    Problem,
    ResolvedRobot,
    quote,
)
from expdesign.configuration.quantity import CURRENT, LENGTH, Quantity, quantity_of_unit
from expdesign.configuration.sections.data import CHANNEL_UNITS


def in_si(
    table: RawTable, section: DataSection, home: Array | None = None
) -> tuple[RawTable, tuple[str, ...]]:
    """Return the table in s, m and N by the struts' channels, and warnings.

    A column's unit is that of the file, else that of `section.units` for the channel or its
    group, else SI. Currents are multiplied by the force constants. Then a length or force is
    sign · channel + offset, and q1 of the file is the length of the first strut of
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
) -> tuple[float, Quantity | None, list[str]]:
    """Return the SI factor and quantity of a column's unit, None without a unit; warnings.

    `channel` is that of the file, `place` its position in the table.
    """
    stated = section.units.get(channel, section.units.get(channel[0]))
    given = table.columns[place].unit if place in table.columns else None
    stated_dimension = None if stated is None else quantity_of_unit(stated)
    factor = 1.0 if stated_dimension is None else stated_dimension.parse(f"1 {stated}")
    if given is None:
        return factor, stated_dimension, []

    def refused(message: str, allowed: str) -> InputError:
        return InputError(table.header_problem(message, place, allowed))

    _, admitted = CHANNEL_UNITS[channel[0]]
    found = quantity_of_unit(given)
    if found is None:
        message = f"the file's unit {quote(given)} is not known"
        if stated is None:
            raise refused(message, f"a known unit, or data.units: {{{channel}: …}}")
        return factor, stated_dimension, [f"{channel}: {message}, '{stated}' used"]
    if found not in admitted:
        message = f"the file's unit {quote(given)} is that of {found.name}"
        raise refused(message, " or ".join(dimension.name for dimension in admitted))
    given_factor = found.parse(f"1 {given}")
    if stated is not None and (found, given_factor) != (stated_dimension, factor):
        message = f"the file says that {channel} is in {quote(given)}, data.units says '{stated}'"
        raise refused(message, "the same unit, or none in data.units")
    return given_factor, found, []


_UNITS = ("m", "mm", "cm", "in", "ft", "µm", "dm", "km")
"""Units that are tried when the lengths do not fit, the likeliest first."""
_ZERO_AT_HOME = "; it would fit if the channel read zero at home: data.offset: home"
_NEAR_HOME = 0.25
"""Share of the stroke within which a motion about home has its middle."""
_MARGIN = 0.1
"""By how much of the longest length the middle of a recording may be out of range: limits may be
stated for the design only, a unit is wrong by a factor of 2.5 at least."""


def refuse_few_rows(table: RawTable, parameters: int) -> None:
    """Refuse fewer rows than the robot has parameters."""
    if len(table) < parameters:
        rows = f"{len(table)} row{'' if len(table) == 1 else 's'}"
        message = f"{rows} of data, but the robot has {parameters} parameters"
        raise InputError(message, table.file, allowed=f"at least {parameters} rows")


def refuse_cells(table: RawTable, channels: Sequence[str], decimal: str) -> None:
    """Refuse cells of these channels that are no finite numbers."""
    found, count = list[tuple[int, int]](), 0
    for place, channel in enumerate(channels):
        rows = np.flatnonzero(~np.isfinite(table.values[channel]))
        found += [(int(row), place) for row in rows[:MOST_PROBLEMS]]
        count += len(rows)
    problems = [
        _cell(table, channels[place], row, decimal) for row, place in sorted(found)[:MOST_PROBLEMS]
    ]
    refuse(problems, table.file, "cells are no finite numbers", count)


def _cell(table: RawTable, channel: str, row: int, decimal: str) -> Problem:
    text = table.texts.get((channel, row))
    if text is None:
        if table.row_noun == "line":  # one of very many, whose texts are not kept
            return table.problem("the cell is no finite number", channel, row)
        found = table.values[channel][row]
        return table.problem("NaN" if np.isnan(found) else "an infinite value", channel, row)
    if not text:
        return table.problem("the cell is empty", channel, row)
    mark = "," if decimal == "." else "."
    digits = text.replace(mark, "", 1).lstrip("+-")
    allowed = f"numbers, or data.decimal: '{mark}'" if mark in text and digits.isdigit() else None
    return table.problem(f"{quote(text)} is no finite number", channel, row, allowed)


def refuse_periods(table: RawTable) -> None:
    """Refuse numbers of periods that are not whole, or that fall."""
    values = table.values.get("period")
    if values is None:
        return
    name = "rows are like that"

    def fraction(row: int) -> Problem:
        return table.problem(f"{values[row]:g} is no number of a period", "period", row)

    def fall(row: int) -> Problem:
        message = f"period {values[row]:.0f} after period {values[row - 1]:.0f}"
        return table.problem(message, "period", row)

    refuse_rows(np.flatnonzero(values != np.round(values)), fraction, table.file, name)
    refuse_rows(np.flatnonzero(np.diff(values) < 0) + 1, fall, table.file, name)


@dataclass(frozen=True, eq=False)
class LengthRange:
    """Lengths that a robot's struts can have: (6,) each, m, and where they are from."""

    lower: Array
    upper: Array
    origin: str

    @classmethod
    def of(cls, robot: ResolvedRobot) -> LengthRange:
        """Return the limits on the strut lengths; where there are none, the scale of the robot.

        That is half to twice the length at home, more than a telescope can do.
        """
        home = robot.struts_at(robot.home).lengths
        limit = robot.limits.get("strut_length")
        if limit is None:
            return cls(home / 2, home * 2, "half to twice the lengths at home")
        # What is kept free is for motions as they are driven: a recording may go there.
        low, high = limit.stated_bounds
        lower = np.where(np.isfinite(low) & (low > 0), low, home / 2)
        return cls(lower, np.where(np.isfinite(high), high, home * 2), limit.origin)

    def fits(self, middle: Array) -> NDArray[np.bool_]:
        """Return for which struts a median length, (6,), m, is plausible."""
        margin = _MARGIN * self.upper
        return (middle >= self.lower - margin) & (middle <= self.upper + margin)

    def problem(self, table: RawTable, strut: int, row: int, message: str) -> Problem:
        """Return the record of a length that this strut cannot have."""
        span = f"{self.lower[strut]:.4g} to {self.upper[strut]:.4g} m, {self.origin}"
        return table.problem(f"strut {strut + 1} is {message}", LENGTH_CHANNELS[strut], row, span)


def refuse_implausible_lengths(
    table: RawTable, lengths: Array, robot: ResolvedRobot, section: DataSection
) -> None:
    """Refuse strut lengths, (T, 6), m, that this robot cannot have: wrong units, wild values."""
    allowed = LengthRange.of(robot)
    middle = np.median(lengths, axis=0)
    outside = (lengths < allowed.lower) | (lengths > allowed.upper)
    problems = []
    for strut in np.flatnonzero(~allowed.fits(middle)).tolist():
        message = f"around {middle[strut]:.4g} m long, out of this robot's range"
        row = int(np.argmax(outside[:, strut]))
        hint = _hint(middle, strut, table, section, robot)
        problems.append(allowed.problem(table, strut, row, message + hint))
    if problems:
        raise InputError(problems)
    stroke = allowed.upper - allowed.lower
    wild = (lengths <= np.maximum(allowed.lower - stroke, 0)) | (lengths > allowed.upper + stroke)
    places = np.argwhere(wild)
    for row, strut in places[:MOST_PROBLEMS].tolist():
        message = f"{lengths[row, strut]:.4g} m long, far out of this robot's range"
        problems.append(allowed.problem(table, strut, row, message))
    refuse(problems, table.file, "lengths are like that", len(places))


def _hint(
    middle: Array, strut: int, table: RawTable, section: DataSection, robot: ResolvedRobot
) -> str:
    """Return how a strut's median length would fit: in another unit, counted otherwise."""
    allowed, home = LengthRange.of(robot), robot.struts_at(robot.home).lengths
    signs = np.array(section.channel_signs("q"))
    offsets = home if section.length_offsets == "home" else np.array(section.length_offsets)
    positions = signs * (middle - offsets)
    in_file = positions / [unit_factor(each, table, section) for each in LENGTH_CHANNELS]
    units = {u: allowed.fits(offsets + signs * in_file * LENGTH.parse(f"1 {u}")) for u in _UNITS}
    from_home = not np.any(offsets)
    stroke = allowed.upper - allowed.lower
    if (
        from_home
        and abs(np.mean(positions)) < _NEAR_HOME * np.min(stroke)
        and np.all(allowed.fits(home + signs * positions))
        and not any(map(np.all, units.values()))
    ):
        # One cause for all six goes before units that fit single struts by chance.
        return _ZERO_AT_HOME
    for unit, fits in units.items():
        if fits[strut]:
            return f"; it would fit if the file were in {unit}: data.units: {{q: {unit}}}"
    if allowed.fits(offsets - signs * positions)[strut]:
        hint = f"data.sign: {{q: {-signs[strut]}}}"
        return f"; it would fit if the channel counted the other way: {hint}"
    if from_home and np.abs(positions)[strut] < _NEAR_HOME * stroke[strut]:
        return _ZERO_AT_HOME
    return ""
