"""What makes a recording unusable, told by file, column and row."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from constraints.arrays import Array
from estimation.data.plausibility import (
    fitting_unit,
    length_range,
    out_of_reach,
    out_of_scale,
)
from estimation.data.table import RawTable
from estimation.data.timebase import TimeBase, gaps, not_increasing
from estimation.data.units import unit_factor
from expdesign.configuration import (
    LENGTH_CHANNELS,
    DataSection,
    InputError,
    Problem,
    ResolvedRobot,
    shown,
)

_MOST = 5
"""Defects of a kind that are told one by one."""

_HALF = 0.5


def refuse(problems: Sequence[Problem], table: RawTable, what: str) -> None:
    """Raise when there are problems: the first ones, and how many more `what` there are."""
    if not problems:
        return
    more = len(problems) - _MOST
    rest = [Problem(f"{more} more {what}", table.file)] if more > 0 else []
    raise InputError([*problems[:_MOST], *rest])


def refuse_different_lengths(table: RawTable) -> None:
    """Refuse columns that are no vectors, or of another length than time is."""
    count = len(table.values["t"])
    bad = [
        table.problem(
            f"the column has {len(values)} samples, '{table.column_name('t')}' has {count}", channel
        )
        for channel, values in table.values.items()
        if len(values) != count
    ]
    if bad:
        raise InputError(bad)


def refuse_few_rows(table: RawTable, parameters: int) -> None:
    """Refuse fewer rows than the robot has parameters."""
    if len(table) < parameters:
        rows = f"{len(table)} row{'' if len(table) == 1 else 's'}"
        message = f"{rows} of data, but the robot has {parameters} parameters"
        raise InputError(Problem(message, table.file, allowed=f"at least {parameters} rows"))


def refuse_cells(table: RawTable, channels: Sequence[str], decimal: str) -> None:
    """Refuse cells of these channels that are no finite numbers."""
    bad = sorted(
        (int(row), place)
        for place, channel in enumerate(channels)
        for row in np.flatnonzero(~np.isfinite(table.values[channel]))
    )
    problems = [_cell(table, channels[place], row, decimal) for row, place in bad[:_MOST]]
    problems += [Problem("")] * max(0, len(bad) - _MOST)
    refuse(problems, table, "cells are no finite numbers")


def _cell(table: RawTable, channel: str, row: int, decimal: str) -> Problem:
    text = table.texts.get((channel, row))
    if text is None:
        found = table.values[channel][row]
        return table.problem("NaN" if np.isnan(found) else "an infinite value", channel, row)
    if not text:
        return table.problem("the cell is empty", channel, row)
    mark = "," if decimal == "." else "."
    digits = text.replace(mark, "", 1).lstrip("+-")
    allowed = f"numbers, or data.decimal: '{mark}'" if mark in text and digits.isdigit() else None
    return table.problem(f"{shown(text)} is no finite number", channel, row, allowed)


def refuse_periods(table: RawTable) -> None:
    """Refuse numbers of periods that are not whole, or that fall."""
    values = table.values.get("period")
    if values is None:
        return
    fractions = np.flatnonzero(values != np.round(values))
    refuse(
        [
            table.problem(f"{values[row]:g} is no number of a period", "period", int(row))
            for row in fractions
        ],
        table,
        "rows are like that",
    )
    falls = np.flatnonzero(np.diff(values) < 0) + 1
    refuse(
        [
            table.problem(
                f"period {values[row]:.0f} after period {values[row - 1]:.0f}", "period", int(row)
            )
            for row in falls
        ],
        table,
        "rows are like that",
    )


def refuse_time(table: RawTable) -> None:
    """Refuse time that does not increase."""
    time = table.values["t"]
    problems = []
    for row in not_increasing(time):
        before = table.row_name(int(row) - 1)
        same = time[row] == time[row - 1]
        what = f"the same time as {before}" if same else f"time goes back from {before}"
        problems.append(
            table.problem(f"{what}: {time[row - 1]:.9g} s, then {time[row]:.9g} s", "t", int(row))
        )
    refuse(problems, table, "rows are not later than the one before")


def refuse_gaps(table: RawTable) -> None:
    """Refuse missing samples; the row named is the one after the gap."""
    time = table.values["t"]
    problems = []
    for row, missing in gaps(time):
        count = f"{missing} sample{'' if missing == 1 else 's'}"
        message = (
            f"a gap of {count} after {table.row_name(row - 1)}: "
            f"{time[row - 1]:.9g} s, then {time[row]:.9g} s"
        )
        problems.append(table.problem(message, "t", row))
    refuse(problems, table, "gaps")


def refuse_uneven(table: RawTable, grid: TimeBase, tolerance: float) -> None:
    """Refuse time that deviates from its uniform grid by more than a share of a step.

    Missing samples are told as such.
    """
    if grid.jitter <= tolerance:
        return
    refuse_gaps(table)
    message = (
        f"time is not uniform: {100 * grid.jitter:.3g} % of a step ({grid.step:.6g} s) off the "
        "fitted grid"
    )
    wider = f", or a time_tolerance above {grid.jitter:.3g}" if grid.jitter < _HALF else ""
    allowed = f"up to {100 * tolerance:g} %; data.time: stamped{wider}"
    raise InputError(table.problem(message, "t", grid.worst, allowed))


def refuse_implausible_lengths(
    table: RawTable, lengths: Array, robot: ResolvedRobot, section: DataSection
) -> None:
    """Refuse strut lengths that this robot cannot have: mistaken units, and wild values."""
    allowed = length_range(robot)
    problems = []
    for strut in out_of_scale(lengths, allowed):
        channel = LENGTH_CHANNELS[strut]
        unit = fitting_unit(lengths, strut, unit_factor(channel, table, section), allowed)
        hint = f"; it would fit if the file were in {unit}: data.units: {{q: {unit}}}"
        problems.append(
            table.problem(
                f"strut {strut + 1} is around {np.median(lengths[:, strut]):.4g} m long, out of "
                f"this robot's range{hint if unit else ''}",
                channel,
                _first_outside(lengths[:, strut], allowed.lower[strut], allowed.upper[strut]),
                _span(allowed.lower[strut], allowed.upper[strut], allowed.origin),
            )
        )
    if problems:
        raise InputError(problems)
    refuse(
        [
            table.problem(
                f"strut {strut + 1} is {lengths[row, strut]:.4g} m long, far out of this robot's "
                "range",
                LENGTH_CHANNELS[strut],
                row,
                _span(allowed.lower[strut], allowed.upper[strut], allowed.origin),
            )
            for row, strut in out_of_reach(lengths, allowed)
        ],
        table,
        "lengths are like that",
    )


def _first_outside(values: Array, lower: float, upper: float) -> int:
    return int(np.argmax((values < lower) | (values > upper)))


def _span(lower: float, upper: float, origin: str) -> str:
    return f"{lower:.4g} to {upper:.4g} m, {origin}"
