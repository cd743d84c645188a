"""An executable motion as figures show it: what the struts do at every controller step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints import Limit
from constraints.arrays import Array
from expdesign.configuration import RunConfiguration
from expdesign.motion import ExecutableMotion
from expdesign.robot import robot_from


@dataclass(frozen=True, eq=False)
class MotionRecord:
    """The motion from rest to rest at the controller's steps, both ends included; SI units.

    Attributes
    ----------
    time : (N,)
        s, from 0.
    length, speed, acceleration, force : (N, 6)
        Of the struts; forces at the nominal parameters.
    names : tuple of str
        Of the segments.
    starts : (K + 1,)
        When each segment begins, and the end of the last, s.
    limits : tuple of Limit
    """

    time: Array
    length: Array
    speed: Array
    acceleration: Array
    force: Array
    names: tuple[str, ...]
    starts: Array
    limits: tuple[Limit, ...]

    @classmethod
    def of(cls, configuration: RunConfiguration, motion: ExecutableMotion) -> MotionRecord:
        """Sample a motion of a run."""
        run = configuration.run
        step = run.trajectory.controller_period or run.experiment.step
        robot = robot_from(configuration.robot)
        time = step * np.arange(sum(motion.steps(step)) + 1, dtype=np.float64)
        states = motion.sample(np.minimum(time, motion.duration))
        struts = robot.strut_motion(states.pose, states.rate, states.acceleration)
        return cls(
            time=time,
            length=struts.length,
            speed=struts.length_rate,
            acceleration=struts.length_acceleration,
            force=robot.actuator_forces(states.pose, states.rate, states.acceleration),
            names=tuple(segment.name for segment in motion.segments),
            starts=motion.starts,
            limits=robot.limits,
        )

    def limit(self, key: str) -> Limit | None:
        """Return a limit of the run by its key, None when there is none."""
        return next((limit for limit in self.limits if limit.key == key), None)
