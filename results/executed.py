"""An executable motion as figures show it: what the struts do at every controller step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints import Limit
from constraints.arrays import Array
from expdesign.configuration import RunConfiguration
from expdesign.experiment.design import controller_period
from expdesign.motion.executable import ExecutableMotion
from expdesign.motion.sampled import SampledMotion
from expdesign.robot import robot_from


@dataclass(frozen=True, eq=False)
class MotionRecord:
    """The motion from rest to rest at the controller's steps, both ends included.

    Attributes
    ----------
    motion : SampledMotion
    names : tuple of str
        Of the segments.
    starts : (K + 1,)
        When each segment begins, and the end of the last, s.
    limits : tuple of Limit
    """

    motion: SampledMotion
    names: tuple[str, ...]
    starts: Array
    limits: tuple[Limit, ...]

    @classmethod
    def of(cls, configuration: RunConfiguration, motion: ExecutableMotion) -> MotionRecord:
        """Sample a motion of a run."""
        step = controller_period(configuration)
        robot = robot_from(configuration.robot)
        time = np.minimum(step * np.arange(sum(motion.steps(step)) + 1.0), motion.duration)
        names = tuple(segment.name for segment in motion.segments)
        return cls(SampledMotion.of(robot, motion, time), names, motion.starts, robot.limits)

    def limit(self, key: str) -> Limit | None:
        """Return a limit of the run by its key, None when there is none."""
        return next((limit for limit in self.limits if limit.key == key), None)
