"""The rows of a table before they are rounded: at which times, and what the design does then."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import InputError
from expdesign.configuration.schema import MOST_ROWS, require_at_most
from expdesign.export.definition import Rows, Settings, Task, in_window
from expdesign.export.execution import (
    ExecutedTable,
    TableDeviation,
    blocks,
    deviation,
    refine_times,
)
from expdesign.export.repetition import repeat_rows, shorten
from expdesign.motion.executable import ExecutableMotion, SampledMotion
from expdesign.progress import track
from expdesign.robot import ForwardKinematicsError, LimitModel
from expdesign.runfolder.fields import Column, field_columns

SHARE = 1e-3
"""Largest deviation of accelerations and forces, as a share of their limits' range."""

STEPS = (0.1, 0.05, 0.025, 0.02, 0.01, 0.005, 0.004, 0.0025, 0.002, 0.001, 0.0005, 0.00025)
"""Times between two rows that are tried, s, the longest first."""

WINDOW = Column("window", "1", "1 in the measurement window, 0 in lead-in and lead-out")
_SAMPLED = field_columns(SampledMotion)
COLUMNS = (
    Column("t", "s", "time from the start of the motion"),
    *[column for _, columns in _SAMPLED[1:] for column in columns],
    WINDOW,
)
"""The whole motion in SI units, as tables that engineers read hold it."""

CLOSEST = 1e-3
"""s; rows that keep the tolerances are put no closer for the sake of the limits."""

_RESERVE, _KEPT = 0.8, 0.98
_FRACTIONS = (1, 2, 4, 5, 8, 10)
_ROOM = 1e-5
"""Share of a limit's range that is left for the rounding of the rows, where there is so much."""
_LEAST_ROOM = 2e-6
_ROUNDING = 1e-9
_POINTS = 10


def designed_rows(settings: Settings, place: str = "") -> Rows:
    """Return the rows of a table before they are rounded.

    Formats that know repeated periods get two of them, with the number of the others.
    """
    short = shorten(settings) if settings.form.repeats else settings
    rows = _rows_of(short, place)
    if short.task is settings.task:
        return rows
    return repeat_rows(rows, settings) or _rows_of(settings, place)


def _rows_of(settings: Settings, place: str) -> Rows:
    times = chosen_times(settings, place)
    rows = ideal_rows(settings, times)
    return (
        replace(rows, columns=whole_motion(settings.task, times)) if settings.form.whole else rows
    )


def ideal_rows(settings: Settings, times: Array) -> Rows:
    """Return the design at the times (N,), s, in the controller's coordinates, unrounded."""
    axes, states = settings.axes, settings.task.motion.sample(times)
    if axes.space == "pose":
        return axes.rows(times, *states)
    struts = settings.task.robot.strut_motion(*states)
    return axes.rows(times, struts.length, struts.length_rate, struts.length_acceleration)


def whole_motion(task: Task, times: Array) -> dict[str, Array]:
    """Return every column of `COLUMNS` by its name at the times (N,), s."""
    sampled = SampledMotion.of(task.robot, task.motion, times)
    window = in_window(times, task.motion.window).astype(float)
    table = np.column_stack([*(getattr(sampled, name) for name, _ in _SAMPLED), window])
    return {column.name: table[:, k] for k, column in enumerate(COLUMNS)}


def uniform_times(motion: ExecutableMotion, step: float) -> Array:
    """Return multiples of the step up to the first at which the motion is over."""
    return step * np.arange(np.ceil(motion.duration / step - _ROUNDING) + 1)


def divided_times(motion: ExecutableMotion, longest: Sequence[float]) -> Array:
    """Return times that divide every part of the motion, and every period, into equal steps.

    `longest` is the longest step in each segment of the motion, s.
    """
    parts = [_divide_segment(motion, k, step) for k, step in enumerate(longest)]
    return np.array([*itertools.chain.from_iterable(part[:-1] for part in parts), motion.duration])


def _divide_segment(motion: ExecutableMotion, segment: int, longest: float) -> Array:
    """Return the times of one segment, its end included."""
    begin, end = motion.starts[segment : segment + 2]
    parts = motion.periods if motion.segments[segment].name == "periods" else 1
    steps = max(1, int(np.ceil((end - begin) / parts / longest - _ROUNDING)))
    return np.linspace(begin, end, parts * steps + 1)


def sufficient_step(settings: Settings) -> float | None:
    """Return the time between the rows of a table, s, with which straight lines keep the tolerance.

    Without a segment time it is the default, or the longest whole fraction of it that is short
    enough; None for rows at individual times.
    """
    if settings.step is None or settings.section.segment is not None:
        return settings.step
    short = shorten(settings)
    motion, robot = short.task.motion, short.task.robot
    for parts in _FRACTIONS:
        step = settings.step / parts
        if motion.duration / step > MOST_ROWS:
            break
        times = uniform_times(motion, step)
        table = ExecutedTable.of(short, ideal_rows(short, times))
        off = 0.0
        for middles in blocks((times[1:] + times[:-1]) / 2):
            design = robot.inverse_kinematics(motion.sample(middles).pose)
            off = max(off, float(np.max(np.abs(table.lengths(middles) - design))))
        if off <= _KEPT * settings.tolerance:
            return step
    return settings.step


def chosen_times(settings: Settings, place: str = "") -> Array:
    """Return the times of the rows, as the file can state them.

    Without a segment time every segment of the motion gets the longest of `STEPS` with which the
    controller's path keeps to the design there: the struts' lengths within 80 % of the tolerance,
    their accelerations and forces within 80 % of `SHARE`. The rest is for the rounding of the
    numbers. Where no step is short enough, the section is refused.

    Where the motion leaves room in every limit, rows are put closer, down to `CLOSEST`, until the
    path leaves half of it: then it can be proved that the table keeps the limits.
    """
    form, motion = settings.form, settings.task.motion
    if form.controller is not None:
        return form.controller.choose_times(settings, place)
    longest = settings.step or settings.section.segment or STEPS[0]
    made = f"{motion.duration:.4g} s in steps of {longest:g} s"
    key = f"{place}.segment" if place else "segment"
    require_at_most(motion.duration / longest, MOST_ROWS, made, key=key)
    if settings.step is not None:
        return form.written_times(uniform_times(motion, settings.step), settings)
    given = settings.section.segment
    if given is not None:
        return _distinct(settings, divided_times(motion, [given] * len(motion.segments)))
    numbers = track("how far rows may be apart", range(len(motion.segments)))
    steps = [_step(settings, k, place) for k in numbers]
    return _distinct(settings, divided_times(motion, steps))


def _distinct(settings: Settings, times: Array) -> Array:
    """Return the times as the controller keeps them; those of one tick are one."""
    return np.unique(settings.form.written_times(times, settings))


def _step(settings: Settings, segment: int, place: str) -> float:
    motion = settings.task.motion
    found = TableDeviation()
    chosen: float | None = None
    for step in STEPS:
        if motion.duration / step > MOST_ROWS or (chosen and step < CLOSEST):
            break
        times = _divide_segment(motion, segment, step)
        if motion.segments[segment].name == "periods":
            # All periods have the same rows.
            times = times[: (len(times) - 1) // motion.periods + 1]
        table = ExecutedTable.of(settings, ideal_rows(settings, _distinct(settings, times)))
        found = _deviation(settings, table)
        shares = (found.position / settings.tolerance, found.acceleration / SHARE)
        if not np.nanmax([*shares, found.force / SHARE]) <= _RESERVE:
            continue
        room, left = (-_excess(table, of_table=which) for which in (False, True))
        if left >= min(_ROOM, room / 2):
            return step
        if room < _LEAST_ROOM:
            # However close the rows are, the table cannot leave more than the motion does.
            return step if chosen is None else chosen
        chosen = chosen or step
    if chosen is not None:
        return chosen
    raise InputError(
        f"with rows {1e3 * step:g} ms apart the controller's path is still "
        f"{1e6 * found.position:.3g} µm from the design in the {motion.segments[segment].name},"
        f" its accelerations {100 * found.acceleration:.2g} % of their limits' range",
        key=f"{place}.tolerance" if place else "tolerance",
        allowed="a larger tolerance, or a segment: of your own",
    )


def _deviation(settings: Settings, table: ExecutedTable) -> TableDeviation:
    worst = TableDeviation()
    for part in blocks(refine_times(table.rows.times, _POINTS)):
        try:
            between = table.between(part)
        except ForwardKinematicsError:
            # Rows so far apart that the lengths between them belong to no pose.
            return TableDeviation(np.inf)
        worst = worst.with_worse(deviation(table, part, between, forces=True))
        if worst.position > settings.tolerance or worst.acceleration > SHARE:
            break
    return worst


def _excess(table: ExecutedTable, *, of_table: bool) -> float:
    """Return by how much the table, or the motion that it holds, exceeds the limits at most."""
    limits = LimitModel.of(table.robot)
    sample = (lambda at: table.between(at).states) if of_table else table.motion.sample
    parts = (np.hstack(sample(part)) for part in blocks(refine_times(table.rows.times, _POINTS)))
    return max(float(np.max(limits.violations(part), initial=-np.inf)) for part in parts)
