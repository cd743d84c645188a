"""Units of a file's columns: what the header says, what `data.units` says, and SI."""

from __future__ import annotations

from dataclasses import replace

from estimation.data.table import RawTable
from expdesign.configuration import (
    CURRENT,
    DURATION,
    FORCE,
    LENGTH,
    DataSection,
    Dimension,
    InputError,
    Problem,
    shown,
    unit_dimension,
)

_DIMENSIONS = {"t": (DURATION,), "q": (LENGTH,), "Q": (FORCE, CURRENT)}


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
    currents = 0
    for channel in table.values:
        if channel == "period":
            continue
        unit, found = _unit(channel, table, section)
        if isinstance(found, Problem):
            problems.append(found)
            continue
        warnings += found
        if unit is None:
            continue
        dimension = unit_dimension(unit)
        assert dimension is not None  # _unit saw to it
        factor = dimension.parse(f"1 {unit}")
        if dimension is CURRENT:
            if section.force_constants is None:
                problems.append(
                    table.header_problem(
                        f"{channel} is a current, but no force constants are given",
                        channel,
                        allowed="data.force_constants: one value or six, in N/A",
                    )
                )
                continue
            currents += 1
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
    unit, _ = _unit(channel, table, section)
    dimension = None if unit is None else unit_dimension(unit)
    return 1.0 if dimension is None else dimension.parse(f"1 {unit}")


def _unit(
    channel: str, table: RawTable, section: DataSection
) -> tuple[str | None, Problem | tuple[str, ...]]:
    """Return a column's unit (None: SI) with warnings, or what is wrong with it."""
    stated = section.units.get(channel, section.units.get(channel[0]))
    given = table.columns[channel].unit if channel in table.columns else None
    if given is None:
        return stated, ()
    admitted = _DIMENSIONS[channel[0]]
    found = unit_dimension(given)
    if found is None:
        if stated is not None:
            return stated, (
                f"{channel}: the file's unit {shown(given)} is not known, '{stated}' used",
            )
        return None, table.header_problem(
            f"the file's unit {shown(given)} is not known",
            channel,
            allowed=f"a known unit, or data.units: {{{channel}: …}}",
        )
    if found not in admitted:
        return None, table.header_problem(
            f"the file's unit {shown(given)} is that of {found.name}",
            channel,
            allowed=_names(admitted),
        )
    if stated is not None and not _same(given, stated, found):
        return None, table.header_problem(
            f"the file says that {channel} is in {shown(given)}, data.units says '{stated}'",
            channel,
            allowed="the same unit, or none in data.units",
        )
    return given, ()


def _same(first: str, second: str, dimension: Dimension) -> bool:
    return unit_dimension(second) is dimension and dimension.parse(f"1 {first}") == dimension.parse(
        f"1 {second}"
    )


def _names(dimensions: tuple[Dimension, ...]) -> str:
    return " or ".join(dimension.name for dimension in dimensions)
