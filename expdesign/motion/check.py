"""The recheck of an executable motion, ramps included; it shares nothing with their search."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from expdesign.configuration import RunConfiguration
from expdesign.motion.executable import ExecutableMotion
from expdesign.motion.jerk import jerk_limit, moving_states
from expdesign.motion.periods import PERIODS, Periods
from expdesign.recheck import LimitCheck, Recheck, grid_points, judge, worst_of_each
from expdesign.robot import LimitModel, robot_from


def check_motion(configuration: RunConfiguration, motion: ExecutableMotion) -> Recheck:
    """Judge every limit, and that on the struts' jerk, from rest to rest.

    Every segment has a grid of its own of at least 4000 points, both ends included; of the
    periods, which repeat, the first is looked at. The worst moment of each limit is searched
    between the points as for a design.

    Parameters
    ----------
    configuration : RunConfiguration
    motion : ExecutableMotion

    Returns
    -------
    Recheck
        Times are from the start of the motion.
    """
    robot = robot_from(configuration.robot)
    orbit = Periods(motion.trajectory, motion.periods)
    limits = LimitModel.of(robot, jerk_limit(configuration, robot, orbit))
    points = grid_points(configuration.run.trajectory.samples)
    checks: list[LimitCheck] = []
    # The jerk jumps at the junctions: each segment answers for its own ends.
    for start, segment in zip(motion.starts[:-1], motion.segments, strict=True):
        between = partial(moving_states, segment)
        once = motion.trajectory.period if segment.name == PERIODS else segment.duration
        times = np.linspace(0.0, once, points)
        found = judge(limits, times, between(times), between)
        checks += [replace(check, time=float(start) + check.time) for check in found]
    return Recheck(
        worst_of_each(checks), points * len(motion.segments), "the motion from rest to rest"
    )
