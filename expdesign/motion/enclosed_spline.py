"""Taylor models of a ramp over cells of time: de Boor's recursion, done with models."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from expdesign.enclosure.taylor_model import EPS, TaylorModel
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.motion.spline import DEGREE, SplineRamp, control_points, knot_shares


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
            np.stack([shares, half / duration]), 8 * EPS * (np.abs(shares) + half / duration)
        )
        span = np.clip((shares * self._intervals).astype(np.intp), 0, self._intervals - 1)
        found = []
        for order in range(4):
            degree = DEGREE - order
            places, ends = knot_shares(self._intervals, degree), np.arange(degree + 1)
            points = control_points(self.ramp.coefficients, order)
            # Their own rounding, and that of the knots: the next derivative times a few of it.
            most = np.max(np.abs(self.ramp.coefficients), axis=0)
            rounding = 64 * EPS * most * (2 * DEGREE * self._intervals) ** (order + 1)
            scale = TaylorModel.number(1.0)
            for _ in range(order):
                scale = scale * _quotient(duration)
            weights = _weights(share, span, places, degree)
            for axis in range(COORDINATES):
                known = [
                    TaylorModel(points[span + k, axis][None, :], np.full(1, rounding[axis]))
                    for k in ends
                ]
                found.append(_de_boor(known, weights) * scale)
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
            start = TaylorModel(low[None, :], EPS * np.ones(1))
            row.append((share - start) * TaylorModel(width[None, :], 8 * EPS * width**2))
        levels.append(row)
    return levels


def _de_boor(points: list[TaylorModel], levels: list[list[TaylorModel]]) -> TaylorModel:
    for row in levels:
        points = [
            before + weight * (after - before)
            for before, after, weight in zip(points[:-1], points[1:], row, strict=True)
        ]
    return points[0]
