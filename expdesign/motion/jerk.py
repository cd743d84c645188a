"""Jerk of the struts: the third derivative of their lengths, which no limit of the design knows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from constraints.arrays import Array
from expdesign.configuration import InputError, Problem, RunConfiguration
from expdesign.mechanism.graph import hexapod_graph
from expdesign.motion.periods import Periods
from expdesign.robot import Robot
from expdesign.robot.batch import BatchFunction

RISE = 0.02
"""Time in which a strut may reach its largest acceleration from zero, s, by the default bound."""
OWN = 1.2
"""The default bound is at least this multiple of the designed motion's own jerk."""
_POINTS = 4000


@cache
def strut_jerk_kernel() -> BatchFunction:
    """Return strut jerk (6,), m/s³, and its Jacobian (6, 24), of (pose … jerk) and geometry."""
    graph = hexapod_graph()
    third = ca.SX.sym("pose_jerk", 6)
    moving = ca.vertcat(graph.rate, graph.acceleration, third)
    jerk = ca.jtimes(graph.kinematic["strut_acceleration"], graph.state, moving)
    state = ca.vertcat(graph.state, third)
    outputs = [ca.densify(jerk), ca.densify(ca.cse(ca.jacobian(jerk, state)))]
    return BatchFunction("strut_jerk", [state], [graph.geometry.vector], outputs)


def strut_jerk(geometry: Array, states: Array, third: Array) -> Array:
    """Return the jerk of the struts, (N, 6), m/s³.

    Parameters
    ----------
    geometry : (g,)
        The graph's geometry input.
    states : (N, 18)
        Pose, rate and acceleration.
    third : (N, 6)
        Third derivative of the pose.
    """
    return strut_jerk_kernel()(np.concatenate([states, third], axis=1), geometry)[0]


@dataclass(frozen=True, eq=False)
class JerkBound:
    """Largest jerk of each strut, and where it comes from.

    Attributes
    ----------
    values : (6,)
        m/s³.
    origin : str
        The key of the run file, or how the default follows.
    """

    values: Array
    origin: str


def jerk_bound(configuration: RunConfiguration, robot: Robot, orbit: Periods) -> JerkBound:
    """Return `motion.jerk`, or the default: the struts' acceleration limit within 20 ms.

    Without such a limit the largest acceleration of the designed motion takes its place; and the
    default is at least 1.2 times the jerk of the designed motion.

    Raises
    ------
    InputError
        The designed motion itself exceeds `motion.jerk`.
    """
    times = np.linspace(0.0, orbit.trajectory.period, _POINTS)
    motion = orbit.sample(times)
    states = np.concatenate([motion.pose, motion.rate, motion.acceleration], axis=1)
    own = np.max(np.abs(strut_jerk(robot.geometry_vector, states, orbit.jerk(times))), axis=0)
    given = configuration.run.motion.jerk
    if given is not None:
        if np.max(own) > given:
            raise InputError(
                Problem(
                    f"the designed motion itself has a strut jerk of {np.max(own):.4g} m/s^3",
                    file=configuration.file,
                    key="motion.jerk",
                    allowed=f"at least {np.max(own):.4g} m/s^3, or a calmer design",
                )
            )
        return JerkBound(np.full(6, given), "motion.jerk")
    limit = next((item for item in robot.limits if item.key == "strut_acceleration"), None)
    if limit is None:
        struts = robot.strut_motion(motion.pose, motion.rate, motion.acceleration)
        largest = np.max(np.abs(struts.length_acceleration), axis=0)
    else:
        largest = np.minimum(np.abs(limit.lower), np.abs(limit.upper))
    return JerkBound(np.maximum(largest / RISE, OWN * own), "default of motion.jerk")
