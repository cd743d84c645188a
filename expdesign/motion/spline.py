"""A ramp: a quintic spline of every pose coordinate between two states of motion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
import scipy

from constraints.arrays import Array
from expdesign.mechanism.hexapod import COORDINATES
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
    """Return the basis and its first three derivatives, (4, K, intervals + 5), at shares of it.

    The knots are equidistant on [0, 1] and clamped at both ends.
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
    """Return the state as a film that runs backwards shows it."""
    return MotionState(state.pose, -state.rate, state.acceleration)


@cache
def _end_inverse(intervals: int) -> Array:
    """Return the matrix from pose, rate and acceleration at the start to the coefficients there."""
    matrix = derivatives(intervals, np.zeros(1))[:FIXED, 0, :FIXED]
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


@cache
def _bases(intervals: int) -> tuple[scipy.interpolate.BSpline, ...]:
    """Return splines of degree 5, 4, 3 and 2 whose values are all their basis functions."""
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
    """A segment whose pose is a clamped quintic B-spline; its jerk is continuous inside."""

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
