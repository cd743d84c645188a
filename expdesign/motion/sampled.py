"""A motion at many instants: the pose, what every strut does for it, and the columns of it all."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated

import numpy as np

from constraints.arrays import Array
from expdesign.recheck.limit_check import Motion
from expdesign.robot import Robot
from expdesign.runfolder.fields import (
    ACCELERATION_COLUMNS,
    POSE_COLUMNS,
    RATE_COLUMNS,
    TIME,
    strutwise,
)

_AT_ONCE = 20_000
"""Instants."""


@dataclass(frozen=True, eq=False)
class SampledMotion:
    """Pose, struts and forces, (N, 6) each, at N instants; base frame, SI units and radians."""

    time: Annotated[Array, TIME]
    pose: Annotated[Array, POSE_COLUMNS]
    pose_rate: Annotated[Array, RATE_COLUMNS]
    pose_acceleration: Annotated[Array, ACCELERATION_COLUMNS]
    length: Annotated[Array, strutwise("q", "m", "length")]
    speed: Annotated[Array, strutwise("dq", "m/s", "speed")]
    acceleration: Annotated[Array, strutwise("ddq", "m/s^2", "acceleration")]
    alpha: Annotated[Array, strutwise("alpha", "rad", "first cardan angle")]
    beta: Annotated[Array, strutwise("beta", "rad", "second cardan angle")]
    force: Annotated[
        Array, strutwise("Q", "N", "actuator force at the nominal parameters, positive extends,")
    ]

    @classmethod
    def of(cls, robot: Robot, motion: Motion, times: Array) -> SampledMotion:
        """Sample a motion of a robot at the times (N,), s."""
        # What is computed on the way takes ten times the memory of what stays.
        parts = [
            cls._at_once(robot, motion, times[begin : begin + _AT_ONCE])
            for begin in range(0, max(len(times), 1), _AT_ONCE)
        ]
        if len(parts) == 1:
            return parts[0]
        names = [field.name for field in fields(cls)]
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    @classmethod
    def _at_once(cls, robot: Robot, motion: Motion, times: Array) -> SampledMotion:
        state = motion.sample(times)
        struts = robot.strut_motion(*state)
        return cls(
            times,
            *state,
            struts.length,
            struts.length_rate,
            struts.length_acceleration,
            struts.alpha,
            struts.beta,
            robot.actuator_forces(*state),
        )

    @property
    def period(self) -> float:
        """Duration of one period of equidistant samples whose end is left out, s."""
        steps = self.time.size - 1
        return float((self.time[-1] - self.time[0]) * (steps + 1) / steps)

    @property
    def increases(self) -> bool:
        """Whether there are two instants at least, each after the one before."""
        return self.time.size > 1 and bool(np.all(np.diff(self.time) > 0))
