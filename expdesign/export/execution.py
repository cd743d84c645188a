"""What the machine does when a controller executes a table."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import PPoly

from constraints.arrays import Array
from expdesign.export.axes import Axes
from expdesign.export.interpolation import Interpolation, differences, interpolated
from expdesign.export.rows import Rows
from expdesign.motion import ExecutableMotion
from expdesign.robot import Robot


@dataclass(frozen=True, eq=False)
class Executed:
    """The machine at N times: pose state and struts, SI.

    Attributes
    ----------
    states : (N, 18)
        Pose, its rate and acceleration.
    length, length_rate, length_acceleration : (N, 6)
    """

    states: Array
    length: Array
    length_rate: Array
    length_acceleration: Array


@dataclass(frozen=True, eq=False)
class ExecutedTable:
    """A table on its way through the controller's interpolator.

    Attributes
    ----------
    robot : Robot
    motion : ExecutableMotion
        The design; it only tells which way the machine is assembled and how many turns an angle
        has.
    axes : Axes
    rows : Rows
    interpolation : Interpolation
    """

    robot: Robot
    motion: ExecutableMotion
    axes: Axes
    rows: Rows
    interpolation: Interpolation

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
            rate = _solved(self.robot.length_jacobian(values), speed)
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
    def _path(self) -> PPoly:
        return interpolated(self.interpolation, self.rows)

    @cached_property
    def _differences(self) -> tuple[Array, Array, Array]:
        """Coordinates at the rows with their first and second derivatives from differences."""
        rows = self._coordinates(self.rows.position, self.rows.times)
        return (rows, *differences(self.rows.times, rows))

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
            return Executed(
                np.concatenate([values, first, second], axis=1),
                struts.length,
                struts.length_rate,
                struts.length_acceleration,
            )
        pose = self.robot.forward_kinematics(values, self.motion.sample(times).pose)
        jacobian = self.robot.length_jacobian(pose)
        rate = _solved(jacobian, first)
        # q̈ = J λ̈ + J̇ λ̇; the graph gives the second part at λ̈ = 0.
        rest = self.robot.strut_motion(pose, rate, np.zeros_like(rate)).length_acceleration
        acceleration = _solved(jacobian, second - rest)
        return Executed(np.concatenate([pose, rate, acceleration], axis=1), values, first, second)


def _solved(matrices: Array, vectors: Array) -> Array:
    return np.asarray(np.linalg.solve(matrices, vectors[:, :, None])[:, :, 0], dtype=np.float64)
