"""Taylor models of a ramp over cells of time: de Boor's recursion, done with models."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from expdesign.enclosure.taylor_model import EPS, TaylorModel
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.motion.spline import DEGREE, SplineRamp, knot_shares


@dataclass(frozen=True)
class EnclosedSpline:
    """A ramp over cells of time, from its own start."""

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
            # A break is a knot but for its rounding: that often the next derivative.
            off = 4 * EPS * np.max(np.abs(controls[order + 1][0]), axis=0)
            scale = TaylorModel.number(1.0)
            for _ in range(order):
                scale = scale * _quotient(duration)
            weights = _weights(share, span, places, degree)
            for axis in range(COORDINATES):
                known = [
                    TaylorModel(
                        points[span + k, axis][None, :], rounding[span + k, axis] + off[axis]
                    )
                    for k in ends
                ]
                found.append(_de_boor(known, weights) * scale)
        return found


def _control_points(coefficients: Array) -> list[tuple[Array, Array]]:
    """Return the control points of a spline and of its derivatives, each with its rounding.

    Derivatives are to the share of the duration. Differences of neighbours lose no more than their
    own last digit, unlike a matrix that makes all steps at once.
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


def _quotient(duration: float) -> TaylorModel:
    return TaylorModel(np.full((1, 1), 1 / duration), np.full(1, EPS / duration))


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


def _de_boor(points: list[TaylorModel], levels: list[list[TaylorModel]]) -> TaylorModel:
    for row in levels:
        points = [
            before + weight * (after - before)
            for before, after, weight in zip(points[:-1], points[1:], row, strict=True)
        ]
    return points[0]
