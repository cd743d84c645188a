"""At which times a table has its rows."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from expdesign.configuration import ConfigurationError, Problem
from expdesign.export.definition import Settings, TableFormat, Task
from expdesign.export.deviation import Deviation, blocks, deviation
from expdesign.export.execution import ExecutedTable
from expdesign.export.interpolation import refined
from expdesign.export.rows import Rows
from expdesign.motion import ExecutableMotion

Array = NDArray[np.float64]

SHARE = 1e-3
"""Largest deviation of accelerations and forces, as a share of their limits' range."""

SEGMENTS = (0.1, 0.05, 0.025, 0.02, 0.01, 0.005, 0.0025, 0.002, 0.001, 0.0005)
"""Times between two rows that are tried, s, the longest first."""

_RESERVE = 0.8
_ROUNDING = 1e-9
_POINTS = 10


def ideal_rows(task: Task, settings: Settings, times: Array) -> Rows:
    """Return the design at the times (N,), s, in the controller's coordinates, unrounded."""
    robot, axes = task.robot, settings.axes
    states = task.motion.sample(times)
    if axes.space == "pose":
        return axes.rows(times, states.pose, states.rate, states.acceleration)
    struts = robot.strut_motion(states.pose, states.rate, states.acceleration)
    return axes.rows(times, struts.length, struts.length_rate, struts.length_acceleration)


def uniform_times(motion: ExecutableMotion, step: float) -> Array:
    """Return multiples of the step up to the first at which the motion is over."""
    return step * np.arange(np.ceil(motion.duration / step - _ROUNDING) + 1)


def divided_times(motion: ExecutableMotion, longest: float) -> Array:
    """Return times that divide every part of the motion, and every period, into equal steps."""
    edges: list[float] = []
    for k, segment in enumerate(motion.segments):
        parts = motion.periods if segment.name == "periods" else 1
        begin, end = motion.starts[k], motion.starts[k + 1]
        if end <= begin:
            continue
        ends = np.linspace(begin, end, parts + 1)
        steps = max(1, int(np.ceil((end - begin) / parts / longest - _ROUNDING)))
        for a, b in itertools.pairwise(ends):
            edges += np.linspace(a, b, steps, endpoint=False).tolist()
    return np.array([*edges, motion.duration])


def chosen_times(form: TableFormat, task: Task, settings: Settings, place: str = "") -> Array:
    """Return the times of the rows, as the file can state them.

    Without a segment time a Hermite table gets the longest of `SEGMENTS` with which the
    controller's path keeps to the design: the struts' lengths within 80 % of the tolerance, their
    accelerations and forces within 80 % of `SHARE`. The rest is for the rounding of the numbers.

    Raises
    ------
    ConfigurationError
        No segment time is short enough.
    """
    if settings.step is not None:
        return form.written_times(uniform_times(task.motion, settings.step))
    if settings.section.segment is not None:
        return form.written_times(divided_times(task.motion, settings.section.segment))
    for longest in SEGMENTS:
        times = form.written_times(divided_times(task.motion, longest))
        found = _deviation(form, task, settings, times)
        shares = (found.position / settings.tolerance, found.acceleration / SHARE)
        if np.nanmax([*shares, found.force / SHARE]) <= _RESERVE:
            return times
    raise ConfigurationError(
        Problem(
            f"with rows {1e3 * SEGMENTS[-1]:g} ms apart the controller's path is still "
            f"{1e6 * found.position:.3g} µm from the design, its accelerations "
            f"{100 * found.acceleration:.2g} % of their limits' range",
            key=f"{place}.tolerance" if place else "tolerance",
            allowed="a larger tolerance, or a segment: of your own",
        )
    )


def _deviation(form: TableFormat, task: Task, settings: Settings, times: Array) -> Deviation:
    rows = ideal_rows(task, settings, times)
    table = ExecutedTable(task.robot, task.motion, settings.axes, rows, form.interpolation)
    worst = Deviation()
    for part in blocks(refined(times, _POINTS)):
        worst = worst.with_worse(deviation(table, part, table.between(part), forces=True))
        if worst.position > settings.tolerance or worst.acceleration > SHARE:
            break
    return worst
