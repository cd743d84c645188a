"""The recheck of an executable motion, ramps included; it shares nothing with their search."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import RunConfiguration
from expdesign.motion.executable import ExecutableMotion
from expdesign.motion.jerk import JerkBound, jerk_bound, strut_jerk
from expdesign.motion.periods import PERIODS, Periods
from expdesign.motion.ramp_limits import JERK
from expdesign.recheck import LimitCheck, Recheck, check_limits, grid_points, states_at
from expdesign.robot import ExactModel, Robot, robot_from


def check_motion(configuration: RunConfiguration, motion: ExecutableMotion) -> Recheck:
    """Check every limit, and the bound on the struts' jerk, from rest to rest.

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
    model = ExactModel(robot, robot.limits)
    bound = jerk_bound(configuration, robot, Periods(motion.trajectory, motion.periods))
    points = grid_points(configuration.run.trajectory.samples)
    worst: dict[str, LimitCheck] = {}
    starts = motion.starts
    for k, segment in enumerate(motion.segments):
        once = motion.trajectory.period if segment.name == PERIODS else segment.duration
        times = np.linspace(starts[k], starts[k] + once, points)
        found = check_limits(model, motion, times, periodic=False)
        # The jerk jumps at the junctions: each segment answers for its own ends.
        third = segment.jerk(times - starts[k])
        found = (*found, _jerk_check(robot, bound, motion, times, third))
        for check in found:
            if check.key not in worst or check.violation > worst[check.key].violation:
                worst[check.key] = check
    return Recheck(
        tuple(worst.values()), points * len(motion.segments), "the motion from rest to rest"
    )


def _jerk_check(
    robot: Robot, bound: JerkBound, motion: ExecutableMotion, times: Array, third: Array
) -> LimitCheck:
    jerk = strut_jerk(robot.geometry_vector, states_at(motion, times), third)
    excess = (np.abs(jerk) - bound.values) / (2 * bound.values)
    excess = np.nan_to_num(excess, nan=np.inf)
    moment, strut = np.unravel_index(int(np.argmax(excess)), excess.shape)
    value = float(jerk[moment, strut])
    return LimitCheck(
        key=JERK,
        title="strut jerk",
        unit="m/s^3",
        origin=bound.origin,
        row=f"strut {strut + 1}",
        value=value,
        bound=float(np.copysign(bound.values[strut], value)),
        violation=float(excess[moment, strut]),
        time=float(times[moment]),
    )
