"""Units of a file's columns: what the header says, what `data.units` says, and SI."""

from __future__ import annotations

from dataclasses import replace

from estimation.data.table import RawTable
from expdesign.configuration import DataSection, InputError, Problem, shown
from expdesign.configuration.sections.data import CHANNEL_UNITS
from expdesign.configuration.values.quantity import CURRENT, Dimension, unit_dimension


def in_si(table: RawTable, section: DataSection) -> tuple[RawTable, tuple[str, ...]]:
    """Return the table in s, m and N, and warnings.

    A column's unit is that of the file, else that of `section.units` for the channel or its
    group, else SI. Currents are multiplied by the force constants.

    Raises
    ------
    InputError
        The file names a unit that is unknown, of another quantity, or not that of
        `section.units`; or currents without force constants.
    """
    values = dict(table.values)
    problems: list[Problem] = []
    warnings: list[str] = []
    currents = False
    for channel in (name for name in table.values if name != "period"):
        try:
            factor, dimension, found = _factor(channel, table, section)
        except InputError as error:
            problems += error.problems
            continue
        warnings += found
        if dimension is CURRENT:
            if section.force_constants is None:
                message = f"{channel} is a current, but no force constants are given"
                allowed = "data.force_constants: one value or six, in N/A"
                problems.append(table.header_problem(message, channel, allowed))
                continue
            currents = True
            factor *= section.force_constants[int(channel[1]) - 1]
        if factor != 1:
            values[channel] = values[channel] * factor
    if problems:
        raise InputError(problems)
    if section.force_constants is not None and not currents:
        warnings.append("data.force_constants are not used: the file holds forces, not currents")
    return replace(table, values=values), tuple(warnings)


def unit_factor(channel: str, table: RawTable, section: DataSection) -> float:
    """Return what one unit of a length or time column is in SI, for a table that `in_si` took."""
    return _factor(channel, table, section)[0]


def _factor(
    channel: str, table: RawTable, section: DataSection
) -> tuple[float, Dimension | None, list[str]]:
    """Return what a column's unit is in SI and of which quantity, None without one; warnings."""
    stated = section.units.get(channel, section.units.get(channel[0]))
    given = table.columns[channel].unit if channel in table.columns else None
    stated_dimension = None if stated is None else unit_dimension(stated)
    factor = 1.0 if stated_dimension is None else stated_dimension.parse(f"1 {stated}")
    if given is None:
        return factor, stated_dimension, []

    def refused(message: str, allowed: str) -> InputError:
        return InputError(table.header_problem(message, channel, allowed))

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
