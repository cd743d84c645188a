"""A controller table over cells of time: where it certainly leads the platform."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.enclosure.forward import StrutPath
from expdesign.enclosure.instructions import EnclosedFunction
from expdesign.enclosure.kinematics import EnclosedKinematics
from expdesign.enclosure.polynomials import PiecewisePolynomials, PosePath, between_rows
from expdesign.enclosure.taylor_model import EPS, TaylorModel
from expdesign.export.definition import Interpolation
from expdesign.export.execution import ExecutedTable
from expdesign.export.rotation import moving_angles
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.recheck.certificate import EnclosedMotion
from expdesign.robot import Robot


def enclosed(table: ExecutedTable) -> EnclosedMotion:
    """Return the motion of a table between and at its rows, which are taken as they are read."""
    axes, rows = table.axes, table.rows
    linear = table.interpolation is Interpolation.LINEAR
    rate = None if linear else rows.velocities
    acceleration = rows.accelerations if table.interpolation is Interpolation.QUINTIC else None
    places: NDArray[np.intp] = np.argsort(axes.source)
    path = between_rows(rows.times, rows.position, rate, acceleration)
    path = path.mapped(places, axes.factor[places], axes.zero)
    if axes.space == "strut":
        return StrutPath(table.robot, path, lambda times: table.motion.sample(times).pose)
    turns = table.turns
    if linear:
        return PoseLines(table.robot, path, turns, fixed=axes.fixed)
    return PosePath(path.moved(turns))


@dataclass(frozen=True, eq=False)
class PoseLines:
    """A platform that is led along straight lines of position and angles, row by row.

    Its speed is the one that a row has in the mean: the rate with which the struts move by their
    way over the row in the row's time. Nothing is known of its acceleration and jerk.
    """

    robot: Robot
    path: PiecewisePolynomials
    """m and rad, the angles as the controller counts them."""
    turns: Array
    """(6,), whole turns of the pose's angles that the controller does not count, rad."""
    fixed: bool
    """Whether the angles are roll, pitch and yaw about fixed axes."""

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
        if self.fixed:
            models[3:] = _moving_angles()([models[3:]])[0]
        turns = [
            TaylorModel(np.full((1, 1), turn), np.full(1, 2 * EPS * abs(turn)))
            for turn in self.turns
        ]
        return [a + b for a, b in zip(models, turns, strict=True)]

    @cached_property
    def _mean_speeds(self) -> list[TaylorModel]:
        """Of the six struts over each row, m/s."""
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
    fixed, angles = moving_angles()
    return EnclosedFunction([fixed], [angles])
