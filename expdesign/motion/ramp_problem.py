"""A ramp as a nonlinear program: the shortest spline between two states that keeps all limits."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from constraints import Limit, plain_limit
from constraints.arrays import Array, Mask
from expdesign.configuration import InputError, RunConfiguration
from expdesign.configuration.limits import row_labels
from expdesign.enclosure.taylor_model import EnclosedSeries
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.motion.executable import ExecutableMotion, Periods, Segment
from expdesign.motion.spline import (
    DEGREE,
    FIXED,
    EnclosedSpline,
    MotionState,
    SplineRamp,
    derivatives,
    end_coefficients,
    reversed_in_time,
    scaled_derivatives,
)
from expdesign.problem.design_problem import Program
from expdesign.problem.path_slope import PathSlope
from expdesign.recheck.certificate import EnclosedMotion, certify
from expdesign.recheck.limit_check import LimitCheck, Recheck, states_at, worst_of_each
from expdesign.robot import LimitModel, Robot, robot_from

_SHORTEST, _LONGEST = 0.02, 10.0
"""Bounds on the scaled duration."""


@dataclass(frozen=True, eq=False)
class RampProblem:
    """Two ends, a grid of polynomial pieces and what is to be kept between them.

    The variables are the free control points, measured from the start's pose, and the duration,
    each scaled to order one.
    """

    limits: LimitModel
    """With the one on the struts' jerk: states have the pose's third derivative."""
    start: MotionState
    end: MotionState
    intervals: int
    scale: Array
    """(6,), what counts as one in each coordinate: m, rad."""
    time_scale: float
    """What counts as one in the duration, s."""

    @property
    def free(self) -> int:
        """Free control points of each coordinate."""
        return self.intervals + DEGREE - 2 * FIXED

    @property
    def size(self) -> int:
        """Number of variables."""
        return COORDINATES * self.free + 1

    def coefficients(self, x: Array) -> tuple[Array, Array]:
        """Return all control points, (N, 6), and their slope to the duration."""
        duration = self.duration(x)
        first, first_slope = end_coefficients(self.intervals, duration, self.start)
        backwards = reversed_in_time(self.end)
        last, last_slope = end_coefficients(self.intervals, duration, backwards)
        inner = x[:-1].reshape(COORDINATES, self.free).T * self.scale + self.start.pose
        none = np.zeros_like(inner)
        return (
            np.concatenate([first, inner, last[::-1]]),
            np.concatenate([first_slope, none, last_slope[::-1]]),
        )

    def at_duration(self, duration: float) -> Array:
        """Return control points, (N, 6), in which only the fixed ones mean something."""
        return self.coefficients(np.append(np.zeros(self.size - 1), duration / self.time_scale))[0]

    def duration(self, x: Array) -> float:
        """Return the ramp's duration, s."""
        return float(x[-1] * self.time_scale)

    def ramp(self, x: Array, name: str) -> SplineRamp:
        """Return the ramp of scaled variables."""
        return SplineRamp(name, self.duration(x), self.coefficients(x)[0])

    def pack(self, ramp: SplineRamp) -> Array:
        """Return the scaled variables of a ramp between the same ends."""
        inner = ramp.coefficients[FIXED:-FIXED]
        shares = (inner - self.start.pose) / self.scale
        return np.append(shares.T.ravel(), ramp.duration / self.time_scale)

    def basis(self, shares: Array) -> Array:
        """Return what states at shares (K,) of the duration are made with, (4, K, N)."""
        return derivatives(self.intervals, shares)

    def states(self, x: Array, basis: Array) -> Array:
        """Return states with jerk, (K, 24), at the instants of a basis."""
        coefficients, _ = self.coefficients(x)
        return np.hstack(list(scaled_derivatives(basis, coefficients, self.duration(x))))

    def slope(self, x: Array, basis: Array) -> PathSlope:
        """Return the derivatives of those states to the variables."""
        coefficients, drift = self.coefficients(x)
        duration = self.duration(x)
        orders = np.arange(4.0)
        scaled = basis * (duration**-orders)[:, None, None]
        by_duration = scaled @ drift - (scaled @ coefficients) * (orders / duration)[:, None, None]
        inner, timed = (part.transpose(1, 0, 2) for part in (scaled, by_duration))
        own = np.ascontiguousarray(inner[:, :, FIXED:-FIXED])
        return PathSlope(own, self.scale, timed * self.time_scale)


class RampProgram(Program):
    """One nonlinear program of a ramp.

    Minimised is the duration plus a little of the squared third derivative over the spline's own
    parameter, which chooses among motions of the same duration; with the duration fixed it is the
    latter alone.
    """

    def __init__(
        self,
        problem: RampProblem,
        shares: Array,
        mask: Mask,
        margins: Array,
        width: float,
        smoothness: float,
    ) -> None:
        used = np.any(mask, axis=1)
        lower, upper = np.full(problem.size, -np.inf), np.full(problem.size, np.inf)
        lower[-1], upper[-1] = _SHORTEST, _LONGEST
        super().__init__(
            problem.limits,
            problem,
            problem.basis(shares[used]),
            mask[used],
            width,
            (lower, upper),
            margins[used],
        )
        self._problem = problem
        pieces = problem.intervals
        self._middle = derivatives(pieces, (np.arange(2 * pieces) + 0.5) / (2 * pieces))[3]
        # A cubic over the whole ramp has a third derivative of 60 times what it moves.
        self._weight = smoothness / (60.0**2 * len(self._middle))

    def smoothest(self, x: Array) -> RampProgram:
        """Fix the duration at that of `x`; what counts as one is the roughness there."""
        self.lower[-1] = self.upper[-1] = x[-1]
        self._weight /= max(self.cost(x) - x[-1], 1e-12)
        return self

    def cost(self, x: Array) -> float:
        """Return the scaled duration and the weighted roughness."""
        return self.cost_gradient(x)[0]

    def cost_gradient(self, x: Array) -> tuple[float, Array]:
        """Return the cost and its gradient."""
        problem = self._problem
        coefficients, drift = problem.coefficients(x)
        rough = self._middle @ coefficients / problem.scale
        gradient = np.empty(problem.size)
        back = 2 * self._weight * (self._middle.T @ rough)
        gradient[:-1] = back[FIXED:-FIXED].T.ravel()
        gradient[-1] = 1 + np.sum(back / problem.scale * drift) * problem.time_scale
        return float(x[-1] + self._weight * np.sum(rough**2)), gradient

    def cost_derivatives(self, x: Array) -> tuple[float, Array, Array]:
        """Return the cost, its gradient and Gauss–Newton Hessian."""
        problem = self._problem
        value, gradient = self.cost_gradient(x)
        _, drift = problem.coefficients(x)
        inner = np.einsum("kf,cd->kcdf", self._middle[:, FIXED:-FIXED], np.eye(COORDINATES))
        timed = (self._middle @ drift / problem.scale * problem.time_scale)[:, :, None]
        slope = np.concatenate([inner.reshape(*timed.shape[:2], -1), timed], axis=2)
        flat = slope.reshape(-1, problem.size)
        return value, gradient, 2 * self._weight * flat.T @ flat


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
        (check,) = certify(LimitModel(robot, (limit,)), enclose_segment(orbit))
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


def enclose_segment(segment: Segment) -> EnclosedMotion:
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
        found = certify(limits, enclose_segment(segment))
        if isinstance(segment, Periods):
            period = segment.trajectory.period
            found = tuple(
                replace(check, time=(check.time - segment.phase) % period) for check in found
            )
        checks += [replace(check, time=float(start) + check.time) for check in found]
    return Recheck(worst_of_each(checks), "the motion from rest to rest")
