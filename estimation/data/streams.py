"""Lengths and forces of two files, with stamps and rates of their own, at common times."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from constraints.arrays import Array, Mask
from estimation.data.measurement import time_base
from estimation.data.stamps import EARLIEST
from estimation.data.table import RawTable, RecordedColumn, refuse_cells, trim
from expdesign.configuration import DataSection, InputError

_DEGREE = 3
_FEWEST = 10
"""Smallest number of rows of each file."""
_GAP = 1.5
"""Largest interval between two samples, in steps of the slower file, that is bridged."""
_LATE = 10
"""Difference of the first stamps, in steps of the slower file, from which a clock is doubted."""
_EQUAL = 1e-9
"""Rounding of equal times, s: those of fitted grids have it."""
_SHOWN = 1e-3
"""Smallest jitter that is reported, in steps."""


def join_tables(
    lengths: tuple[RawTable, float], forces: tuple[RawTable, float], section: DataSection
) -> tuple[RawTable, str]:
    """Return one table at the times of the file with the lower rate, and a remark on both.

    The faster file is reduced by `resample`. Tables come with their times in s, and the time from
    which these count, since 1970 if it is a date.

    Raises
    ------
    InputError
        A time is unusable, cells have no numbers, or the files have no time in common.
    """
    (table, begin), (other, later) = lengths, forces
    if (begin >= EARLIEST) != (later >= EARLIEST):
        message = "its stamps have a date, those of the other file have none"
        raise InputError(message, (table if begin else other).file, allowed="stamps of one clock")
    times = other.values["t"] + (later - begin)
    other = replace(other, values={**other.values, "t": times})
    table, other = (trim(each, section) for each in (table, other))
    for each in table, other:
        if len(each) < _FEWEST:
            problem = each.problem(f"{len(each)} rows", "t", allowed=f"{_FEWEST} rows or more")
            raise InputError(problem)
        refuse_cells(each, tuple(each.values), section.decimal)
    bases = [time_base(each, section) for each in (table, other)]
    slow = int(bases[1].step > bases[0].step * (1 + 1e-6))
    base, fast = bases[slow], bases[1 - slow]
    inside = _supported(base.time, fast.time, _GAP * base.step)
    if not np.any(inside):
        spans = [f"{one.time[0]:.6g} to {one.time[-1]:.6g} s" for one in bases]
        message = f"the files have no time in common: lengths {spans[0]}, forces {spans[1]}"
        raise InputError(message, other.file, allowed="stamps of one clock")
    kept, source = (table, other)[slow], (other, table)[slow]
    channels = [name for name in source.values if name not in ("t", "period")]
    reduced = resample(
        fast.time, np.column_stack([source.values[name] for name in channels]), base.time[inside]
    )
    rows = np.flatnonzero(inside)
    values = dict(zip(channels, reduced.T, strict=True))
    values |= {name: column[rows] for name, column in kept.values.items() if name != "t"}
    if slow and "period" in table.values:
        before = np.searchsorted(fast.time, base.time[rows] + _EQUAL, side="right") - 1
        values["period"] = table.values["period"][np.maximum(before, 0)]
    order = ["t", *(name for one in (table, other) for name in one.values if name != "t")]
    columns = {name: replace(one, file=source.file) for name, one in source.columns.items()}
    columns |= kept.columns
    values["t"] = base.time[rows]
    joint = replace(
        kept,
        values={name: values[name] for name in order},
        columns=columns | {"t": RecordedColumn("t", unit="s")},
        rows=np.array([kept.row_number(row) for row in rows.tolist()]),
        texts={},
        origin=0.0,
    )
    about = [
        f"{name} at {1 / one.step:.6g} Hz"
        + (f" with a jitter of {one.jitter:.2g} steps" if one.jitter > _SHOWN else "")
        for name, one in zip(("lengths", "forces"), bases, strict=True)
    ]
    lag = 1e3 * (bases[1].time[0] - bases[0].time[0])
    reduction = f"; combined at the times of the {('lengths', 'forces')[slow]}"
    if abs(lag) > 1e3 * _LATE * base.step:
        reduction += (
            ". If both programs started together, their clocks differ by this: see "
            "`expdesign check --data --design`, and state a difference as data.delay"
        )
    late = "later" if lag >= 0 else "earlier"
    return joint, f"{', '.join(about)}, forces begin {abs(lag):.4g} ms {late}{reduction}"


def _supported(at: Array, times: Array, most: float) -> Mask:
    """Return which times lie between two samples that are not further apart than `most`."""
    later = np.searchsorted(times, at)
    later = np.where((later == 0) & np.isclose(at, times[0], rtol=0, atol=_EQUAL), 1, later)
    inside = (later > 0) & (later < len(times))
    ends = np.clip(later, 1, len(times) - 1)
    return inside & (times[ends] - times[ends - 1] <= most)


def resample(times: Array, values: Array, at: Array) -> Array:
    """Return values (T, c) at other times (S,), which are not denser: (S, c).

    A cubic spline with knots at these times, and as close before, between and after them, is fitted
    by least squares: slow components stay, up to a fourth order in frequency over rate; the noise
    is averaged, and stays nearly white. Between equal times it interpolates.

    Examples
    --------
    >>> times = np.linspace(0, 1, 1001)
    >>> at = np.linspace(0, 1, 101)
    >>> float(
    ...     np.max(np.abs(resample(times, np.sin(20 * times)[:, None], at)[:, 0] - np.sin(20 * at)))
    ... ) < 1e-5
    True
    """
    start = times[0]
    knots = _fill_gaps(np.concatenate([times[:1], at, times[-1:]]))
    knots = knots[(knots >= times[2]) & (knots <= times[-3])]
    # One sample or more between two knots.
    places: NDArray[np.intp] = np.searchsorted(times, knots)
    knots = knots[np.unique(places, return_index=True)[1]]
    ends = (np.full(_DEGREE + 1, 0.0), np.full(_DEGREE + 1, times[-1] - start))
    spline = scipy.interpolate.make_lsq_spline(
        times - start, values, np.concatenate([ends[0], knots - start, ends[1]]), k=_DEGREE
    )
    return np.asarray(spline(np.clip(at - start, 0.0, times[-1] - start)), np.float64)


def _fill_gaps(knots: Array) -> Array:
    """Return knots (K,) with further ones where two are further apart than most.

    One cubic for seconds without a knot would be wrong at both of its ends.
    """
    step = float(np.median(np.diff(knots)))
    places = np.cumsum(np.maximum(np.rint(np.diff(knots, prepend=knots[:1]) / step), 1))
    return np.interp(np.arange(places[0], places[-1] + 1), places, knots)
