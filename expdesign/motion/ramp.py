"""A ramp: a quintic spline of every pose coordinate between two states of motion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
import scipy

from constraints.arrays import Array, Mask
from expdesign.enclosure.arithmetic import EPS
from expdesign.enclosure.taylor_model import TaylorModel
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.problem.program import PathSlope, Program
from expdesign.robot import LimitModel
from expdesign.trajectory import PoseSamples

DEGREE = 5
FIXED = 3
"""Coefficients at each end that pose, rate and acceleration there determine."""


class MotionState(NamedTuple):
    """Pose, rate and acceleration of one instant: (6,) each; m, rad, s."""

    pose: Array
    rate: Array
    acceleration: Array

    @classmethod
    def at_rest(cls, pose: Array) -> MotionState:
        """Return the state of a machine that stands still."""
        return cls(np.array(pose, dtype=float), np.zeros(COORDINATES), np.zeros(COORDINATES))

    @classmethod
    def of(cls, samples: PoseSamples) -> MotionState:
        """Return the first of the samples."""
        return cls(*(part[0] for part in samples))


def derivatives(intervals: int, shares: Array) -> Array:
    """Return the B-spline basis and three derivatives, (4, K, intervals + 5), at K parameters.

    The parameters are shares of the duration, with equidistant knots on [0, 1], clamped at both
    ends.
    """
    inside = np.clip(shares, 0.0, 1.0)
    bases = enumerate(_bases(intervals))
    return np.stack([basis(inside) @ _reduction(intervals, order) for order, basis in bases])


def scaled_derivatives(basis: Array, coefficients: Array, duration: float) -> Array:
    """Return pose, rate, acceleration and jerk, (4, K, 6), of `derivatives` and a duration, s."""
    return (basis @ coefficients) * (duration ** -np.arange(4.0))[:, None, None]


def end_coefficients(intervals: int, duration: float, state: MotionState) -> tuple[Array, Array]:
    """Return the first three coefficients (3, 6) of a start, and their slope to the duration."""
    values = np.array([state.pose, duration * state.rate, duration**2 * state.acceleration])
    slopes = np.array([np.zeros(COORDINATES), state.rate, 2 * duration * state.acceleration])
    inverse = _end_inverse(intervals)
    return inverse @ values, inverse @ slopes


def reversed_in_time(state: MotionState) -> MotionState:
    """Return the state of the motion in reversed time."""
    return MotionState(state.pose, -state.rate, state.acceleration)


@cache
def _end_inverse(intervals: int) -> Array:
    """Return the matrix from pose, rate and acceleration at the start to the coefficients there."""
    matrix = derivatives(intervals, np.zeros(1))[:FIXED, 0, :FIXED]
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


@cache
def _bases(intervals: int) -> tuple[scipy.interpolate.BSpline, ...]:
    """Return the bases of degree 5, 4, 3 and 2 as vector-valued splines."""
    make = scipy.interpolate.BSpline
    return tuple(
        make(knot_shares(intervals, degree), np.eye(intervals + degree), degree)
        for degree in range(DEGREE, DEGREE - 4, -1)
    )


def knot_shares(intervals: int, degree: int) -> Array:
    """Return the knots on [0, 1], clamped at both ends."""
    inner = np.linspace(0.0, 1.0, intervals + 1)
    return np.concatenate([np.zeros(degree), inner, np.ones(degree)])


@cache
def _reduction(intervals: int, order: int) -> Array:
    """Return the matrix from coefficients of degree 5 to those of a derivative."""
    matrix = np.eye(intervals + DEGREE)
    for step in range(order):
        degree = DEGREE - step
        knots, count = knot_shares(intervals, degree), intervals + degree
        spans = knots[degree + 1 : degree + count] - knots[1:count]
        matrix = (degree / spans)[:, None] * np.diff(matrix, axis=0)
    return matrix


@dataclass(frozen=True, eq=False)
class SplineRamp:
    """A segment with a clamped quintic B-spline as pose, of continuous jerk."""

    name: str
    duration: float
    coefficients: Array
    """(N, 6), control points: m, rad."""

    def __post_init__(self) -> None:
        """Freeze the control points."""
        values = np.array(self.coefficients, dtype=float)
        values.setflags(write=False)
        object.__setattr__(self, "coefficients", values)

    def sample(self, times: Array) -> PoseSamples:
        """Return pose, rate and acceleration at times from the ramp's start, s."""
        return PoseSamples(*self._derivatives(times)[:3])

    def jerk(self, times: Array) -> Array:
        """Return the third derivative of the pose, (N, 6), at times from the ramp's start, s."""
        return self._derivatives(times)[3]

    def scaled(self, factor: float, home: Array) -> SplineRamp:
        """Return home + F (λ(F t) − home) for the factor F and the pose home, (6,): m, rad."""
        points = home + factor * (self.coefficients - home)
        return SplineRamp(self.name, self.duration / factor, points)

    def _derivatives(self, times: Array) -> Array:
        shares = np.asarray(times, dtype=float) / self.duration
        basis = derivatives(len(self.coefficients) - DEGREE, shares)
        return scaled_derivatives(basis, self.coefficients, self.duration)


@dataclass(frozen=True)
class EnclosedSpline:
    """Enclosure of a ramp over cells of time, from its own start."""

    ramp: SplineRamp

    @property
    def breaks(self) -> Array:
        """(K,) the knots, s; the last is rounded up."""
        found = self.ramp.duration * np.linspace(0.0, 1.0, self._intervals + 1)
        found[-1] *= 1 + 4 * EPS
        return found

    @property
    def _intervals(self) -> int:
        return len(self.ramp.coefficients) - DEGREE

    def models(self, edges: Array) -> list[TaylorModel]:
        """Return the models of pose, rate, acceleration and jerk, 24, over cells (N, 2), s.

        Every cell lies between two knots.
        """
        middle = edges.mean(axis=1)
        half = np.max(np.abs(edges - middle[:, None]), axis=1) * (1 + 4 * EPS)
        duration = self.ramp.duration
        shares = middle / duration
        share = TaylorModel(
            np.stack([shares, half / duration]), 2 * EPS * (np.abs(shares) + half / duration)
        )
        span = np.clip((shares * self._intervals).astype(np.intp), 0, self._intervals - 1)
        found = []
        controls = _control_points(self.ramp.coefficients)
        for order in range(4):
            degree = DEGREE - order
            places, ends = knot_shares(self._intervals, degree), np.arange(degree + 1)
            points, rounding = controls[order]
            # A break is a knot except for its rounding, times the next derivative.
            off = 4 * EPS * np.max(np.abs(controls[order + 1][0]), axis=0)
            scale, quotient = TaylorModel.number(1.0), np.full(1, 1 / duration)
            for _ in range(order):
                scale = scale * TaylorModel(quotient[None, :], EPS * quotient)
            weights = _weights(share, span, places, degree)
            for axis in range(COORDINATES):
                known = [
                    TaylorModel(
                        points[span + k, axis][None, :], rounding[span + k, axis] + off[axis]
                    )
                    for k in ends
                ]
                for row in weights:  # de Boor's recursion
                    known = [
                        before + weight * (after - before)
                        for before, after, weight in zip(known[:-1], known[1:], row, strict=True)
                    ]
                found.append(known[0] * scale)
        return found


def _control_points(coefficients: Array) -> list[tuple[Array, Array]]:
    """Return the control points of a spline and of its derivatives, each with its rounding.

    Derivatives are with respect to the share of the duration. Repeated differences of neighbours
    are more accurate than one matrix for all steps.
    """
    intervals = len(coefficients) - DEGREE
    points, rounding = coefficients, np.zeros_like(coefficients)
    found = [(points, rounding)]
    for degree in range(DEGREE, 1, -1):
        places, count = knot_shares(intervals, degree), intervals + degree
        factor = (degree / (places[degree + 1 : degree + count] - places[1:count]))[:, None]
        steps = np.diff(points, axis=0)
        rounding = factor * (rounding[1:] + rounding[:-1] + EPS * np.abs(steps))
        points = factor * steps
        rounding = (rounding + 4 * EPS * np.abs(points)) * (1 + 8 * EPS)
        found.append((points, rounding))
    return found


def _weights(
    share: TaylorModel, span: Array, places: Array, degree: int
) -> list[list[TaylorModel]]:
    """Return the weights of each level of the recursion, between 0 and 1."""
    levels = []
    for level in range(1, degree + 1):
        row = []
        for k in range(level, degree + 1):
            low, high = places[span + k], places[span + k + degree + 1 - level]
            width = 1 / (high - low)
            start = TaylorModel(low[None, :], np.zeros(1))
            row.append((share - start) * TaylorModel(width[None, :], 2 * EPS * width))
        levels.append(row)
    return levels


_SHORTEST, _LONGEST = 0.02, 10.0
"""Bounds on the scaled duration."""


@dataclass(frozen=True, eq=False)
class RampProblem:
    """Both ends of a ramp, its polynomial pieces and its limits.

    The variables are the free control points relative to the pose of the start, and the duration,
    each scaled to order one.
    """

    limits: LimitModel
    """With the limit of the struts' jerk: states include the pose's third derivative."""
    start: MotionState
    end: MotionState
    intervals: int
    scale: Array
    """(6,), scale of each coordinate: m, rad."""
    time_scale: float
    """Scale of the duration, s."""

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
        """Return control points, (N, 6), of which only the fixed ones are meaningful."""
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
        """Return the basis of states at shares (K,) of the duration, (4, K, N)."""
        return derivatives(self.intervals, shares)

    def states(self, x: Array, basis: Array) -> Array:
        """Return states with jerk, (K, 24), at the instants of a basis."""
        coefficients, _ = self.coefficients(x)
        return np.hstack(list(scaled_derivatives(basis, coefficients, self.duration(x))))

    def slope(self, x: Array, basis: Array) -> PathSlope:
        """Return the derivatives of those states with respect to the variables."""
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

    The cost is the duration plus a small weight times the roughness: the squared third derivative
    with respect to the spline's parameter, which decides among motions of the same duration.
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
        # A cubic over the whole ramp has a third derivative of 60 times its displacement.
        self._weight = smoothness / (60.0**2 * len(self._middle))

    def smoothest(self, x: Array) -> RampProgram:
        """Fix the duration at that of `x`; the cost is the roughness relative to that of `x`."""
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
