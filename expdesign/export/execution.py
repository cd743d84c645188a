"""Execution of a table by a controller: the machine's motion and its deviation from the design."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy.interpolate import PPoly

from constraints.arrays import Array
from expdesign.configuration.schema import MOST_SAMPLES
from expdesign.export.definition import Axes, Interpolation, Rows, Settings, Task
from expdesign.export.repetition import shorten_task
from expdesign.information.fisher import (
    SingularInformationError,
    information_matrix,
    log_det,
    parameter_covariance,
)
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.motion.executable import ExecutableMotion
from expdesign.progress import track
from expdesign.robot import Robot
from expdesign.robot.robot import solve_rows
from expdesign.trajectory import PoseSamples


def interpolate_rows(kind: Interpolation, rows: Rows) -> PPoly:
    """Return the path of the axes, (N,) times → (N, 6) in their units, as a piecewise polynomial.

    The rows have the velocities that a cubic path needs, and the accelerations of a quintic one.
    """
    h = np.diff(rows.times)[:, None]
    p0, p1 = rows.position[:-1], rows.position[1:]
    if kind is Interpolation.LINEAR:
        return PPoly(np.stack([(p1 - p0) / h, p0]), rows.times)
    v0, v1 = rows.velocities[:-1], rows.velocities[1:]
    if kind is Interpolation.CUBIC:
        slope = (p1 - p0) / h
        third = (v0 + v1 - 2 * slope) / h**2
        second = (3 * slope - 2 * v0 - v1) / h
        return PPoly(np.stack([third, second, v0, p0]), rows.times)
    a0, a1 = rows.accelerations[:-1], rows.accelerations[1:]
    # What a parabola from the first row leaves over at the second one.
    position = p1 - p0 - v0 * h - a0 * h**2 / 2
    rate = v1 - v0 - a0 * h
    acceleration = a1 - a0
    cubic = (10 * position - 4 * rate * h + acceleration * h**2 / 2) / h**3
    quartic = (-15 * position + 7 * rate * h - acceleration * h**2) / h**4
    quintic = (6 * position - 3 * rate * h + acceleration * h**2 / 2) / h**5
    return PPoly(np.stack([quintic, quartic, cubic, a0 / 2, v0, p0]), rows.times)


def refine_times(times: Array, points: int) -> Array:
    """Return a grid with this many points to a step, the steps' beginnings and the end in it."""
    shares = np.arange(points) / points
    inner = times[:-1, None] + np.diff(times)[:, None] * shares
    return np.append(inner.ravel(), times[-1])


def differences(times: Array, values: Array, stride: int = 1) -> tuple[Array, Array]:
    """Return first and second derivatives of values (N, 6) at times (N,), at rest at both ends.

    With a `stride` they are means over so many equal steps to both sides.
    """
    if stride > 1:
        step = stride * (times[1] - times[0])
        around = np.concatenate(
            [np.repeat(values[:1], stride, 0), values, np.repeat(values[-1:], stride, 0)]
        )
        before, behind = around[: -2 * stride], around[2 * stride :]
        return (behind - before) / (2 * step), (behind - 2 * values + before) / step**2
    h = np.diff(times)[:, None]
    slopes = np.diff(values, axis=0) / h
    first, second = np.zeros_like(values), np.zeros_like(values)
    both = h[1:] + h[:-1]
    first[1:-1] = (slopes[:-1] * h[1:] + slopes[1:] * h[:-1]) / both
    second[1:-1] = 2 * np.diff(slopes, axis=0) / both
    return first, second


@dataclass(frozen=True, eq=False)
class Executed:
    """The machine at N times, SI: pose with rate and acceleration, and the struts, (N, 6) each."""

    states: PoseSamples
    length: Array
    length_rate: Array
    length_acceleration: Array


LONGER = 0.01
"""Largest relative difference of the measurement window's duration when a controller plans between
the rows itself."""


@dataclass(frozen=True, eq=False)
class ExecutedTable:
    """A table as the controller interpolates it."""

    robot: Robot
    motion: ExecutableMotion
    """The design: it determines the assembly mode of the machine and the turns of its angles."""
    axes: Axes
    rows: Rows
    """Of the table, or in every cycle of a controller that plans between them itself."""
    interpolation: Interpolation
    written: Rows | None = None
    """The table's rows for such a controller; None for others."""
    row_times: Array | None = None
    """(N,), s: when it reaches them; the clock is that of the design."""
    stride: int = 1
    """Its cycles in a row, over which accelerations are means to both sides."""

    @classmethod
    def of(cls, settings: Settings, rows: Rows) -> ExecutedTable:
        """Return the executed rows of an export; of repeated periods the two in the rows."""
        form = settings.form
        task = shorten_task(settings.task) if rows.repeated else settings.task
        given = task.robot, task.motion, settings.axes
        if form.controller is None:
            return cls(*given, rows, form.interpolation)
        cycles, times = form.controller.execute(rows, settings)
        step = cycles.times[1] - cycles.times[0]
        stride = max(1, round(float(np.median(np.diff(rows.times))) / step))
        return cls(*given, cycles, form.interpolation, rows, times, stride)

    @property
    def executed_window(self) -> tuple[float, float]:
        """Begin and end of the measurement window in the commanded motion, s."""
        if self.written is None or self.row_times is None:
            return self.motion.window
        begin, end = np.interp(self.motion.window, self.written.times, self.row_times)
        return float(begin), float(end)

    @property
    def stretch(self) -> float:
        """Relative increase of the measurement window's duration."""
        (first, last), (begin, end) = self.motion.window, self.executed_window
        return (end - begin) / (last - first) - 1

    @property
    def as_written(self) -> ExecutedTable:
        """The table on straight lines between its rows, for a controller that plans itself."""
        if self.written is None:
            return self
        return replace(self, rows=self.written, written=None, row_times=None, stride=1)

    def between(self, times: Array) -> Executed:
        """Return the machine between the rows as well; times (N,), s.

        On straight lines the speed is the struts' mean speed over a row, the acceleration that
        of `smoothed`: the lines have none.

        Raises
        ------
        ForwardKinematicsError
            The struts' lengths belong to no pose.
        """
        values = self._coordinates(self._path(times), times)
        if self.interpolation is not Interpolation.LINEAR:
            rate, acceleration = (self.axes.derivatives(self._path(times, k)) for k in (1, 2))
            return self._machine(times, values, rate, acceleration)
        place = np.clip(
            np.searchsorted(self.rows.times, times, side="right") - 1, 0, len(self.rows.times) - 2
        )
        rows, _, second = self._differences
        steps = np.diff(self.rows.times)[:, None]
        if self.axes.space == "strut":
            rate = (np.diff(rows, axis=0) / steps)[place]
        else:
            # The struts' mean speed over each row, as a pose's rate.
            lengths = self.robot.inverse_kinematics(rows)
            speed = (np.diff(lengths, axis=0) / steps)[place]
            rate = solve_rows(self.robot.length_jacobian(values), speed)
        return self._machine(times, values, rate, self._at(second, times))

    def lengths(self, times: Array) -> Array:
        """Return the struts' lengths, (N, 6), m, on the controller's path at times (N,), s."""
        values = self._coordinates(self._path(times), times)
        return values if self.axes.space == "strut" else self.robot.inverse_kinematics(values)

    def smoothed(self, times: Array) -> Executed:
        """Return the machine as its own inertia smooths it: states of the rows, interpolated.

        For Hermite paths this is the path itself.
        """
        if self.interpolation is not Interpolation.LINEAR:
            return self.between(times)
        _, first, second = self._differences
        values = self._coordinates(self._path(times), times)
        return self._machine(times, values, self._at(first, times), self._at(second, times))

    def _at(self, values: Array, times: Array) -> Array:
        return np.stack([np.interp(times, self.rows.times, column) for column in values.T], axis=1)

    @cached_property
    def turns(self) -> Array:
        """(6,), rad: what the pose has more than the table at the first row, in whole turns."""
        found = np.zeros(COORDINATES)
        if self.axes.space == "pose":
            first = self.axes.coordinates(self.rows.position[:1])[0]
            home = self.motion.sample(self.rows.times[:1]).pose[0]
            found[3:] = 2 * np.pi * np.round((home - first)[3:] / (2 * np.pi))
        return found

    @cached_property
    def _path(self) -> PPoly:
        return interpolate_rows(self.interpolation, self.rows)

    @cached_property
    def _differences(self) -> tuple[Array, Array, Array]:
        """Coordinates at the rows with their first and second derivatives from differences."""
        rows = self._coordinates(self.rows.position, self.rows.times)
        return (rows, *differences(self.rows.times, rows, self.stride))

    def _coordinates(self, position: Array, times: Array) -> Array:
        values = self.axes.coordinates(position)
        if self.axes.space == "pose":
            expected = self.motion.sample(times).pose[:, 3:]
            turns = np.round((expected - values[:, 3:]) / (2 * np.pi))
            values[:, 3:] += 2 * np.pi * turns
        return values

    def _machine(self, times: Array, values: Array, first: Array, second: Array) -> Executed:
        if self.axes.space == "pose":
            struts = self.robot.strut_motion(values, first, second)
            lengths = struts.length, struts.length_rate, struts.length_acceleration
            return Executed(PoseSamples(values, first, second), *lengths)
        pose = self.robot.forward_kinematics(values, self.motion.sample(times).pose)
        states = PoseSamples(pose, *self.robot.pose_motion(pose, first, second))
        return Executed(states, values, first, second)


_WHOLE = 1e-6
"""Samples by which a period may differ from a whole number of them."""
BLOCK = 20_000
"""Times that are computed at once."""


@dataclass(frozen=True)
class TableDeviation:
    """Largest deviations of the struts."""

    position: float = 0.0
    position_time: float = 0.0
    """Deviation of a length, m, and when it is so large, s."""
    velocity: float = 0.0
    """Of a strut, m/s."""
    acceleration: float = np.nan
    force: float = np.nan
    """Both as a share of the range that the limits give, NaN where there is no such limit; forces
    without dry friction, which jumps wherever a velocity changes its sign."""

    def with_worse(self, other: TableDeviation) -> TableDeviation:
        """Return the larger of each."""
        first = self if self.position >= other.position else other
        return TableDeviation(
            first.position,
            first.position_time,
            max(self.velocity, other.velocity),
            float(np.fmax(self.acceleration, other.acceleration)),
            float(np.fmax(self.force, other.force)),
        )


def blocks(times: Array) -> Iterator[Array]:
    """Yield the times in blocks."""
    for start in range(0, len(times), BLOCK):
        yield times[start : start + BLOCK]


def deviation(
    table: ExecutedTable, times: Array, executed: Executed, *, forces: bool
) -> TableDeviation:
    """Return the largest deviations from the design at the times (N,), s.

    `executed` is the machine then; `forces` compares accelerations and forces too.
    """
    robot = table.robot
    design = table.motion.sample(times)
    struts = robot.strut_motion(*design)
    off = np.abs(executed.length - struts.length).max(axis=1)
    worst = int(np.argmax(off))
    shares = []
    if forces:
        parameters = np.where(robot.graph.jumping, 0.0, robot.parameters)
        accelerated = executed.length_acceleration - struts.length_acceleration
        force = robot.actuator_forces(*executed.states, parameters)
        force -= robot.actuator_forces(*design, parameters)
        shares = [
            _share(robot, "strut_acceleration", accelerated),
            _share(robot, "actuator_force", force),
        ]
    speed = float(np.max(np.abs(executed.length_rate - struts.length_rate)))
    return TableDeviation(float(off[worst]), float(times[worst]), speed, *shares)


def _share(robot: Robot, key: str, difference: Array) -> float:
    limit = robot.limit(key)
    if limit is None:
        return float("nan")
    return float(np.max(np.abs(difference) / limit.range))


@dataclass(frozen=True)
class InformationChange:
    """F over the measurement window, of the table as executed against the design."""

    samples: int
    """Of the measurement."""
    log_det_design: float
    log_det_change: float
    """Of the design, and by how much that of the table is larger."""
    std_change: float
    """The largest relative change of a predicted standard deviation."""
    parameter: str
    """Whose standard deviation that is."""


def information_change(table: ExecutedTable, task: Task) -> InformationChange | None:
    """Compare the information of executed table and design, sampled as it will be measured.

    None without a covariance of the forces, and for a design that leaves parameters undetermined.

    Raises
    ------
    ForwardKinematicsError
        The struts' lengths belong to no pose.
    """
    if task.force_covariance is None:
        return None
    names, count = task.parameters, _sample_count(task)
    repeats = table.rows.repeated
    try:
        reference, before = _predicted_by_design(task, repeats)
    except SingularInformationError:
        return None
    try:
        found, after = _predict_precision(task, repeats, lambda at: table.smoothed(at).states)
    except SingularInformationError:
        return InformationChange(count, reference, -np.inf, np.inf, names[0])
    relative = after / before - 1
    worst = int(np.argmax(np.abs(relative)))
    change, largest = found - reference, float(relative[worst])
    return InformationChange(count, reference, change, largest, names[worst])


def _sample_count(task: Task) -> int:
    first, last = task.motion.window
    return max(1, int(np.floor((last - first) * task.sampling * (1 + 1e-12))))


def _weighted_times(task: Task, repeats: int) -> list[tuple[Array, int]]:
    """Return times of samples, (N,), s, each with the number of its samples.

    With repeated periods all times are in the first two. Between the middles of both nothing
    depends on lead-in and lead-out: these samples count for all periods between. Of more samples
    than memory holds, periods have whole numbers of them.
    """
    total, sampling = _sample_count(task), task.sampling
    begin, period = task.motion.window[0], task.motion.trajectory.period
    count = max(1, round(period * sampling))
    whole = abs(period * sampling - count) < _WHOLE
    if repeats and total > MOST_SAMPLES and not whole:
        sampling, whole = count / period, True
    times = begin + np.arange(2 * count if repeats and whole else total) / sampling
    if not repeats:
        return [(times, 1)]
    if whole:
        return [(times, 1), (times[count // 2 : count // 2 + count], repeats)]
    later = begin + period + np.mod(times - begin, period)
    return [(np.where(times < begin + period, times, later), 1)]


@lru_cache(maxsize=1)
def _predicted_by_design(task: Task, repeats: int) -> tuple[float, Array]:
    """Return `_predict_precision` of the design itself, which several tables of it share."""
    return _predict_precision(task, repeats, task.motion.sample)


def _predict_precision(
    task: Task,
    repeats: int,
    sample: Callable[[Array], PoseSamples],
) -> tuple[float, Array]:
    """Return log det F and the predicted standard deviations of a motion."""
    if task.force_covariance is None:
        raise ValueError("nothing is known of the noise")
    every = task.robot.parameter_names
    columns = [every.index(name) for name in task.parameters]
    total = np.zeros((len(columns), len(columns)))
    parts = [
        (part, weight) for times, weight in _weighted_times(task, repeats) for part in blocks(times)
    ]
    for part, weight in track("reading back: information on the parameters", parts):
        regressors = task.robot.regressor(*sample(part))[:, :, columns]
        total += weight * information_matrix(regressors, task.force_covariance)
    std = np.sqrt(np.diag(parameter_covariance(total, task.parameters)))
    return log_det(total, task.parameters), std
