"""What a motion from rest to rest has to keep: the robot's limits and the jerk of its struts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from constraints import Limit, plain_limit
from constraints.arrays import Array
from expdesign.configuration import InputError, RunConfiguration
from expdesign.configuration.limits import row_labels
from expdesign.enclosure.series import EnclosedSeries
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.motion.enclosed_spline import EnclosedSpline
from expdesign.motion.executable import ExecutableMotion, Periods, Segment
from expdesign.motion.spline import SplineRamp
from expdesign.recheck.certificate import EnclosedMotion, certify
from expdesign.recheck.limit_check import LimitCheck, Recheck, states_at, worst_of_each
from expdesign.robot import LimitModel, Robot, robot_from

STRUT_JERK = plain_limit("strut_jerk", "strut jerk", "m/s^3", "symmetric")
"""Not in the catalogue: a design has no bound on it, the key is `motion.jerk` of the run file."""

RISE = 0.02
"""Time in which a strut may reach its largest acceleration from zero, s, by the default bound."""
OWN = 1.2
"""The default bound is at least this multiple of the designed motion's own jerk."""
_POINTS = 4000


def moving_states(segment: Segment, times: Array) -> Array:
    """Return pose, rate, acceleration and jerk of the pose, (N, 24), at times from its start, s."""
    return np.concatenate([states_at(segment, times), segment.jerk(times)], axis=1)


def jerk_limit(configuration: RunConfiguration, robot: Robot, orbit: Periods) -> Limit:
    """Return `motion.jerk`, or the default: the struts' acceleration limit within 20 ms.

    Without such a limit the largest acceleration of the designed motion takes its place; and the
    default is at least 1.2 times the jerk of the designed motion.

    Raises
    ------
    InputError
        The designed motion itself exceeds `motion.jerk`.
    """
    times = np.linspace(0.0, orbit.trajectory.period, _POINTS)
    states = moving_states(orbit, times)
    given = configuration.run.motion.jerk
    if given is not None:
        limit = _within(np.full(ACTUATORS, given), "motion.jerk")
        (check,) = certify(LimitModel(robot, (limit,)), enclosed(orbit))
        if not check.kept:
            largest = f"{abs(check.value):.4g} m/s^3"
            raise InputError(
                f"the designed motion itself has a strut jerk of {largest}",
                file=configuration.file,
                key="motion.jerk",
                allowed=f"at least {largest}, or a calmer design",
            )
        return limit
    unbounded = _within(np.full(ACTUATORS, np.inf), "")
    own = np.max(np.abs(LimitModel(robot, (unbounded,)).values(states)), axis=0)
    bound = robot.limit("strut_acceleration")
    if bound is None:
        struts = robot.strut_motion(*np.split(states[:, : 3 * COORDINATES], 3, axis=1))
        largest_acceleration = np.max(np.abs(struts.length_acceleration), axis=0)
    else:
        largest_acceleration = np.minimum(np.abs(bound.lower), np.abs(bound.upper))
    return _within(np.maximum(largest_acceleration / RISE, OWN * own), "default of motion.jerk")


def _within(largest: Array, origin: str) -> Limit:
    return Limit(STRUT_JERK, -largest, largest, row_labels(STRUT_JERK), origin)


def enclosed(segment: Segment) -> EnclosedMotion:
    """Return what encloses a segment from its own start; of the periods the first."""
    if isinstance(segment, Periods):
        return EnclosedSeries(segment.trajectory)
    return EnclosedSpline(segment)


def has_enclosure(motion: ExecutableMotion) -> bool:
    """Return whether each segment is of a kind that can be enclosed."""
    return all(isinstance(segment, Periods | SplineRamp) for segment in motion.segments)


def check_motion(configuration: RunConfiguration, motion: ExecutableMotion) -> Recheck:
    """Judge every limit, and that on the struts' jerk, from rest to rest, at every instant.

    Of the periods, which repeat, one is looked at, as the trajectory has it. Times are from the
    start of the motion.
    """
    robot = robot_from(configuration.robot)
    orbit = Periods(motion.trajectory, motion.periods)
    limits = LimitModel.of(robot, jerk_limit(configuration, robot, orbit))
    checks: list[LimitCheck] = []
    for start, segment in zip(motion.starts[:-1], motion.segments, strict=True):
        found = certify(limits, enclosed(segment))
        if isinstance(segment, Periods):
            period = segment.trajectory.period
            found = tuple(
                replace(check, time=(check.time - segment.phase) % period) for check in found
            )
        checks += [replace(check, time=float(start) + check.time) for check in found]
    return Recheck(worst_of_each(checks), "the motion from rest to rest")
