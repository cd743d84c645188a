"""Certificate of a controller table: use of each limit at and between all rows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from constraints import Limit
from constraints.arrays import Array
from expdesign.enclosure.arithmetic import EPS
from expdesign.enclosure.forward import EnclosedKinematics, StrutPath
from expdesign.enclosure.instructions import EnclosedFunction
from expdesign.enclosure.paths import PiecewisePolynomials, PosePath, between_rows
from expdesign.enclosure.taylor_model import TaylorModel
from expdesign.export.definition import Interpolation
from expdesign.export.execution import ExecutedTable, blocks, refine_times
from expdesign.export.rotation import moving_angles
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.progress import track
from expdesign.recheck.certificate import MOST_CELLS, EnclosedMotion, certify
from expdesign.recheck.limit_check import (
    LimitCheck,
    range_share_in_words,
    worst_of_each,
    worst_sampled,
)
from expdesign.robot import LimitModel, Robot

_DYNAMIC = frozenset({"strut_acceleration", "actuator_force", "strut_jerk"})
LIMIT_SHARE = 1e-3
"""Largest excess over a limit, as a share of its range, that an executed table may have."""
_CELLS_OF_A_PIECE = 4
"""Further cells for each piece of the path."""
_POINTS = 10
"""To a row, where nothing can be proved."""
AT_HOME = 1e-5
"""Largest distance of the first and last row from the stated pose, m and rad, beyond rounding."""
_LEAD = 65
"""Poses of the lines from home to the begin of a piece."""
PROVED, IN_PART, BROKEN = "proved", "proved in part", "broken"
"""The verdicts on a motion."""


@dataclass(frozen=True)
class PathCertificate:
    """The limits along a path, and what is proved of them."""

    limits: tuple[LimitCheck, ...]
    """In the order of the robot's; those that are `sampled` have no proved excess."""
    sampled: tuple[str, ...] = ()
    """Keys of limits that the path between rows leaves undefined: of straight lines those on
    accelerations and forces, which are judged by second differences at the rows."""
    unproved_from: float = np.inf
    """When the first pose of the struts' lengths could not be proved, s; ∞: all were."""
    faults: tuple[str, ...] = ()
    """Reasons against the table as the whole motion, in words."""
    unchecked: tuple[str, ...] = ()
    """Parts of the table outside the proof, in words."""
    remarks: tuple[str, ...] = ()
    """Differences from the export that break nothing, in words."""

    @property
    def broken(self) -> tuple[LimitCheck, ...]:
        """The limits that are exceeded; `sampled` ones by more than `LIMIT_SHARE`.

        Differences of rounded rows exceed a limit by a little where the motion itself does not.
        """
        return tuple(
            check
            for check in self.limits
            if not (check.violation <= LIMIT_SHARE if check.key in self.sampled else check.kept)
        )

    @property
    def open(self) -> tuple[LimitCheck, ...]:
        """The limits of the path that are neither proved to be kept nor found to be exceeded."""
        path = [check for check in self.limits if check.key not in self.sampled]
        return tuple(check for check in path if check.kept and not check.certified)

    @property
    def certified(self) -> bool:
        """Whether all limits that the path defines are proved to be kept, and nothing is wrong."""
        return self.verdict == PROVED

    @property
    def verdict(self) -> str:
        """`PROVED`, `IN_PART` if something is neither proved nor broken, or `BROKEN`."""
        if self.broken or self.faults:
            return BROKEN
        return IN_PART if self.open or self.unchecked else PROVED


def certify_table(table: ExecutedTable, *, piece: bool = False) -> PathCertificate:
    """Return what is proved of every limit of the robot, and the worst moments that were found.

    The path is that of the rows as they are read, in real numbers, as the controller's interpolator
    is described. On straight lines the speed of a strut is its mean over a row. A `piece` may begin
    and end anywhere.

    Raises
    ------
    ForwardKinematicsError
        The struts' lengths belong to no pose.
    """
    robot = table.robot
    linear = table.interpolation is Interpolation.LINEAR
    every = LimitModel.of(robot).limits
    undefined = [limit for limit in every if linear and _is_dynamic(limit)]
    model = LimitModel(robot, tuple(limit for limit in every if limit not in undefined))
    motion = enclose_table(table, piece=piece)
    until = motion.known_until if isinstance(motion, StrutPath) else np.inf
    # Where a pose is not known nothing can be proved of what comes behind it.
    checks: list[LimitCheck] = []
    if not np.isfinite(until):
        most = MOST_CELLS + _CELLS_OF_A_PIECE * len(motion.breaks)
        checks = list(certify(model, motion, most=most))
    open_ones = {check.key for check in checks if not np.isfinite(check.proved)}
    if not checks or open_ones:
        left = [one for one in model.limits if not checks or one.key in open_ones]
        found = _sample_limits(table, LimitModel(robot, tuple(left)))
        checks = [check for check in checks if check.key not in open_ones]
        checks += [replace(check, proved=np.inf) for check in found]
    if undefined:
        checks += _at_rows(table, LimitModel(robot, tuple(undefined)), piece=piece)
    true_times = table.rows.true_times
    checks = [replace(check, time=float(true_times(check.time))) for check in checks]
    by_key = {check.key: check for check in checks}
    ordered = tuple(by_key[limit.key] for limit in every)
    return PathCertificate(
        ordered, tuple(limit.key for limit in undefined), float(true_times(until))
    )


def _is_dynamic(limit: Limit) -> bool:
    return not _DYNAMIC.isdisjoint(limit.definition.requires)


def _sample_limits(table: ExecutedTable, model: LimitModel) -> tuple[LimitCheck, ...]:
    """Return the worst of a grid ten times as fine as the rows."""
    checks: list[LimitCheck] = []
    for times in track("judging the table", tuple(blocks(refine_times(table.rows.times, _POINTS)))):
        checks += worst_sampled(model, times, model.values(np.hstack(table.between(times).states)))
    return worst_of_each(checks)


def single_cycle_faults(table: ExecutedTable, *, piece: bool = False) -> list[str]:
    """Describe the limits on accelerations and forces that are exceeded in single servo cycles.

    Of a controller that plans between the rows; `certify_table` judges means over a row, which
    level a motion of one servo cycle.
    """
    if table.row_times is None:
        return []
    limits = tuple(limit for limit in LimitModel.of(table.robot).limits if _is_dynamic(limit))
    if not limits:
        return []
    checks = _at_rows(replace(table, stride=1), LimitModel(table.robot, limits), piece=piece)
    return [
        f"in single servo cycles {excess_in_words(check)}" for check in checks if not check.kept
    ]


def excess_in_words(check: LimitCheck) -> str:
    """Describe an exceeded limit and its excess."""
    return f"{check}, exceeded by {range_share_in_words(check.violation)}"


def _at_rows(table: ExecutedTable, model: LimitModel, *, piece: bool) -> tuple[LimitCheck, ...]:
    """Return the worst row of each limit; second differences approximate accelerations.

    The ends of a piece have none.
    """
    checks: list[LimitCheck] = []
    rows = table.rows.times[1:-1] if piece and len(table.rows.times) > 2 else table.rows.times  # noqa: PLR2004
    for times in track("judging the table at its rows", tuple(blocks(rows))):
        checks += worst_sampled(model, times, model.values(np.hstack(table.smoothed(times).states)))
    return worst_of_each(checks)


def enclose_table(table: ExecutedTable, *, piece: bool = False) -> EnclosedMotion:
    """Return the motion of a table between and at its rows, which are taken as they are read."""
    axes, rows = table.axes, table.rows
    linear = table.interpolation is Interpolation.LINEAR
    rate = None if linear else rows.velocities
    acceleration = rows.accelerations if table.interpolation is Interpolation.QUINTIC else None
    places: NDArray[np.intp] = np.argsort(axes.source)
    path = between_rows(rows.times, rows.position, rate, acceleration)
    path = path.map_coordinates(places, axes.factor[places], axes.zero)
    if axes.space == "strut":
        if piece or np.any(np.abs(table.motion.sample(0.0).pose[0] - table.robot.home) > AT_HOME):
            return _led_from_home(table, path)
        return StrutPath(table.robot, path, lambda times: table.motion.sample(times).pose)
    if linear and axes.fixed:
        begin = table.motion.sample(rows.times[:1]).pose[0]
        return PoseLines(table.robot, path, middle=begin[3:])
    path = path.translate(table.turns)
    return PoseLines(table.robot, path) if linear else PosePath(path)


def _led_from_home(table: ExecutedTable, path: PiecewisePolynomials) -> StrutPath:
    """Return a path of struts with lines from home to its begin, which identify its poses."""
    robot, times = table.robot, table.rows.times
    begin = table.motion.sample(times[:1]).pose[0]
    first = robot.forward_kinematics(table.lengths(times[:1]), begin[None, :])[0]
    shares = np.linspace(0.0, 1.0, _LEAD)[:, None]
    poses = robot.home + shares * (first - robot.home)
    lengths = robot.inverse_kinematics(poses)
    # The path begins with the lengths of its own polynomials, whose roundings are small.
    lengths[-1] = [float(model.at(-np.ones(1))[0]) for model in path.over(times[None, :2])]
    before = times[0] - 1 + shares[:, 0]
    lead = between_rows(before, lengths)
    missing = np.zeros((len(path.coefficients) - len(lead.coefficients), *lead.error.shape[1:]))
    joined = [
        np.concatenate([np.concatenate([ahead, missing]), own], axis=2)
        for ahead, own in ((lead.coefficients, path.coefficients), (lead.error, path.error))
    ]

    def guess(at: Array) -> Array:
        share = np.clip(at - before[0], 0.0, 1.0)[:, None]
        return np.where(
            share < 1, robot.home + share * (first - robot.home), table.motion.sample(at).pose
        )

    whole = PiecewisePolynomials(np.concatenate([before[:-1], path.times]), *joined)
    return StrutPath(robot, whole, guess, begin=float(times[0]))


@dataclass(frozen=True, eq=False)
class PoseLines:
    """A platform that is led along straight lines of position and angles, row by row.

    Its speed is the mean over a row: the change of the struts' lengths over the row's duration. Its
    acceleration and jerk are unknown.
    """

    robot: Robot
    path: PiecewisePolynomials
    """m and rad."""
    middle: Array | None = None
    """(3,), rad, of angles that are roll, pitch and yaw about fixed axes: φ, θ, ψ are within half
    a turn of it. None: they are φ, θ, ψ."""

    @property
    def breaks(self) -> Array:
        """(K,), s: the times of the rows."""
        return self.path.times

    def models(self, edges: Array) -> list[TaylorModel]:
        """Return the models of pose, rate, acceleration and jerk, 24, over cells (N, 2), s."""
        pose = self._pose(edges)
        place = np.searchsorted(self.breaks, edges.mean(axis=1), side="right") - 1
        speed = [_among(mean, place) for mean in self._mean_speeds]
        rate, _ = self._kinematics.rate(pose, speed)
        return [*pose, *rate, *[TaylorModel.unknown()] * (2 * COORDINATES)]

    def _pose(self, edges: Array) -> list[TaylorModel]:
        models = self.path.over(edges)
        if self.middle is not None:
            middle = [TaylorModel.number(angle) for angle in self.middle]
            models[3:] = _moving_angles()([models[3:], middle])[0]
        return models

    @cached_property
    def _mean_speeds(self) -> list[TaylorModel]:
        """Return the mean speeds of the six struts over each row, m/s."""
        at_rows = self._kinematics.lengths(self._pose(np.repeat(self.breaks[:, None], 2, axis=1)))
        steps = 1 / np.diff(self.breaks)
        per_second = TaylorModel(steps[None, :], 2 * EPS * steps)
        return [
            (_among(model, slice(1, None)) - _among(model, slice(-1))) * per_second
            for model in at_rows
        ]

    @cached_property
    def _kinematics(self) -> EnclosedKinematics:
        return EnclosedKinematics(self.robot)


def _among(model: TaylorModel, cells: NDArray[np.intp] | slice) -> TaylorModel:
    return TaylorModel(model.coefficients[:, cells], model.radius[cells])


@cache
def _moving_angles() -> EnclosedFunction:
    fixed, middle, angles = moving_angles()
    return EnclosedFunction([fixed, middle], [angles])
