"""What is proved of a table: how far its path uses each limit, at and between all rows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from constraints import Limit
from expdesign.enclosure.forward import StrutPath
from expdesign.export.definition import Interpolation
from expdesign.export.enclosed_table import enclosed
from expdesign.export.execution import ExecutedTable, blocks, refined
from expdesign.progress import track
from expdesign.recheck.certificate import MOST_CELLS, certify
from expdesign.recheck.limit_check import LimitCheck, worst_of_each, worst_sampled
from expdesign.robot import LimitModel

_DYNAMIC = frozenset({"strut_acceleration", "actuator_force", "strut_jerk"})
LIMIT_SHARE = 1e-3
"""Largest excess over a limit, as a share of its range, that an executed table may have."""

_CELLS_OF_A_PIECE = 4
"""How many are enclosed for each piece of the path, beside those of any motion."""
_POINTS = 10
"""To a row, where nothing can be proved."""


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
        """Whether all limits that the path defines are proved to be kept, and no other broken."""
        return not self.broken and not self.open


def certified(table: ExecutedTable) -> PathCertificate:
    """Return what is proved of every limit of the robot, and the worst moments that were found.

    The path is that of the rows as they are read, in real numbers, as the controller's interpolator
    is described. On straight lines the speed of a strut is its mean over a row.

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
    motion = enclosed(table)
    until = motion.known_until if isinstance(motion, StrutPath) else np.inf
    # Where a pose is not known nothing can be proved of what comes behind it.
    checks: list[LimitCheck] = []
    if not np.isfinite(until):
        most = MOST_CELLS + _CELLS_OF_A_PIECE * len(motion.breaks)
        checks = list(certify(model, motion, most=most))
    open_ones = {check.key for check in checks if not np.isfinite(check.proved)}
    if not checks or open_ones:
        left = [one for one in model.limits if not checks or one.key in open_ones]
        found = _sampled(table, LimitModel(robot, tuple(left)))
        checks = [check for check in checks if check.key not in open_ones]
        checks += [replace(check, proved=np.inf) for check in found]
    if undefined:
        checks += _at_rows(table, LimitModel(robot, tuple(undefined)))
    by_key = {check.key: check for check in checks}
    ordered = tuple(by_key[limit.key] for limit in every)
    return PathCertificate(ordered, tuple(limit.key for limit in undefined), until)


def _is_dynamic(limit: Limit) -> bool:
    return not _DYNAMIC.isdisjoint(limit.definition.requires)


def _sampled(table: ExecutedTable, model: LimitModel) -> tuple[LimitCheck, ...]:
    """Return the worst of a grid ten times as fine as the rows."""
    checks: list[LimitCheck] = []
    for times in track("judging the table", tuple(blocks(refined(table.rows.times, _POINTS)))):
        checks += worst_sampled(model, times, model.values(np.hstack(table.between(times).states)))
    return worst_of_each(checks)


def _at_rows(table: ExecutedTable, model: LimitModel) -> tuple[LimitCheck, ...]:
    """Return the worst of the rows, where second differences stand for accelerations."""
    checks: list[LimitCheck] = []
    for times in track("judging the table at its rows", tuple(blocks(table.rows.times))):
        checks += worst_sampled(model, times, model.values(np.hstack(table.smoothed(times).states)))
    return worst_of_each(checks)
