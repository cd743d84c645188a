"""A ramp as a nonlinear program: the shortest spline between two states that keeps all limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array, Mask
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.motion.spline import (
    DEGREE,
    FIXED,
    MotionState,
    SplineRamp,
    derivatives,
    end_coefficients,
    reversed_in_time,
    scaled_derivatives,
)
from expdesign.problem.design_problem import Program
from expdesign.problem.path_slope import PathSlope
from expdesign.robot import LimitModel

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
