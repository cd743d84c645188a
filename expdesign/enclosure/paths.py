"""Motions in time as Taylor models over cells: piecewise polynomials and Fourier series."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from math import comb

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.enclosure.arithmetic import EPS, TERMS, UP
from expdesign.enclosure.taylor_model import TaylorModel
from expdesign.trajectory import FourierTrajectory

_ROUNDED = 64 * EPS
"""Bound on the loss where a polynomial is restricted to a part of its piece."""
# Coefficients of τ⁰, τ¹, … from the data of a piece. All numbers are exact in binary.
_LINE = np.array([[1, 1 / 2], [0, 1 / 2]])
_CUBIC = np.array(
    [
        [1, 1 / 2, 1 / 4, -1 / 4],
        [0, 3 / 4, -1 / 4, -1 / 4],
        [0, 0, -1 / 4, 1 / 4],
        [0, -1 / 4, 1 / 4, 1 / 4],
    ]
)
_QUINTIC = (
    np.array(
        [
            [16, 8, 5, -5, 1, 1],
            [0, 15, -7, -7, -1, 1],
            [0, 0, -6, 6, -2, -2],
            [0, -10, 10, 10, 2, -2],
            [0, 0, 1, -1, 1, 1],
            [0, 3, -3, -3, -1, 1],
        ]
    )
    / 16
)


@dataclass(frozen=True, eq=False)
class PiecewisePolynomials:
    """Polynomials of m coordinates on each of N pieces of time."""

    times: Array
    """(N + 1,), s, beginnings of the pieces and end of the last."""
    coefficients: Array
    """(K, m, N), of τ⁰, τ¹, …"""
    error: Array
    """(K, m, N), bound of each coefficient's error; ∞: unknown."""

    @cached_property
    def derivative(self) -> PiecewisePolynomials:
        """The derivative in time, per s."""
        if len(self.coefficients) == 1:
            nothing = np.zeros_like(self.coefficients)
            return PiecewisePolynomials(self.times, nothing, nothing)
        half = np.diff(self.times) / 2
        power = np.arange(1, len(self.coefficients))[:, None, None]
        found = self.coefficients[1:] * power / half
        error = self.error[1:] * power / half + 4 * EPS * np.abs(found)
        return PiecewisePolynomials(self.times, found, error * UP)

    def map_coordinates(
        self, source: NDArray[np.intp], factor: Array, zero: Array
    ) -> PiecewisePolynomials:
        """Return the coordinates p[source] / factor + zero of the path p."""
        found = self.coefficients[:, source] / factor[:, None]
        error = self.error[:, source] / np.abs(factor[:, None]) + 2 * EPS * np.abs(found)
        return PiecewisePolynomials(self.times, found, error * UP).translate(zero)

    def translate(self, way: Array) -> PiecewisePolynomials:
        """Return the path moved by a vector (m,), with the rounding in its error."""
        found, error = self.coefficients.copy(), self.error.copy()
        found[0] += way[:, None]
        error[0] += 2 * EPS * (np.abs(found[0]) + np.abs(way[:, None]))
        return PiecewisePolynomials(self.times, found, error * UP)

    def over(self, edges: Array) -> list[TaylorModel]:
        """Return the m models over cells, (N', 2), s, each within one piece."""
        place = np.searchsorted(self.times, edges.mean(axis=1), side="right") - 1
        place = np.clip(place, 0, len(self.times) - 2)
        begin = self.times[place]
        half = (self.times[place + 1] - begin) / 2
        first, last = ((edges[:, k] - begin) / half - 1 for k in (0, 1))
        middle, width = (first + last) / 2, (last - first) / 2
        own, error = self.coefficients[..., place], self.error[..., place]
        count = len(own)
        found = np.zeros_like(own)
        for j in range(count):
            for k in range(count - 1, j - 1, -1):
                found[j] *= middle
                found[j] += comb(k, j) * own[k]
            found[j] *= width**j
        # The place of the cell in its piece is rounded too: times the slope.
        weights = 1 + np.arange(count)[:, None, None]
        radius = (error.sum(axis=0) + _ROUNDED * np.sum(weights * np.abs(own), axis=0)) * UP
        return [
            TaylorModel(np.ascontiguousarray(found[:, i]), radius[i]) for i in range(own.shape[1])
        ]

    def with_rates(self, edges: Array) -> list[list[TaylorModel]]:
        """Return the models of the path and its first two derivatives over cells, (N', 2), s."""
        first = self.derivative
        return [part.over(edges) for part in (self, first, first.derivative)]


def between_rows(
    times: Array, position: Array, rate: Array | None = None, acceleration: Array | None = None
) -> PiecewisePolynomials:
    """Return the path through rows: straight lines, cubic or quintic Hermite polynomials.

    Parameters
    ----------
    times : (N,)
        s.
    position, rate, acceleration : (N, m)
        At those times, per s and per s². Without accelerations the polynomials are cubic, without
        rates straight lines.
    """
    half = np.diff(times)[:, None] / 2
    data, matrix = [position[:-1], np.diff(position, axis=0)], _LINE
    if rate is not None:
        data += [rate[:-1] * half, rate[1:] * half]
        matrix = _CUBIC
        if acceleration is not None:
            data += [acceleration[:-1] * half**2, acceleration[1:] * half**2]
            matrix = _QUINTIC
    stacked = np.stack(data).swapaxes(1, 2)
    coefficients = np.tensordot(matrix, stacked, 1)
    error = 16 * EPS * np.tensordot(np.abs(matrix), np.abs(stacked), 1)
    # The position at the middle is that of a row, which is exact, and differences.
    return PiecewisePolynomials(times, coefficients, error * UP)


@dataclass(frozen=True, eq=False)
class PosePath:
    """A motion of the pose as polynomials in time."""

    poses: PiecewisePolynomials
    """m and rad."""

    @property
    def breaks(self) -> Array:
        """(K,), s, beginnings and ends of the pieces."""
        return self.poses.times

    def models(self, edges: Array) -> list[TaylorModel]:
        """Return the models of pose, rate, acceleration and jerk, 24, over cells (N, 2), s."""
        third = self.poses.derivative.derivative.derivative
        parts = [*self.poses.with_rates(edges), third.over(edges)]
        return [model for part in parts for model in part]


DERIVATIVES = 4
"""Pose, rate, acceleration and jerk."""


@dataclass(frozen=True)
class EnclosedSeries:
    """One period of a Fourier series over cells of time."""

    trajectory: FourierTrajectory

    @property
    def breaks(self) -> Array:
        """(2,) beginning and end of the period, s; the end is rounded up."""
        return np.array([0.0, self.trajectory.period * (1 + 4 * EPS)])

    def models(self, edges: Array) -> list[TaylorModel]:
        """Return the models of pose, rate, acceleration and jerk, 24, over cells (N, 2), s.

        The derivatives of a series are known in closed form, and no derivative of a harmonic is
        larger than its amplitude times the power of its frequency.
        """
        trajectory = self.trajectory
        middle = edges.mean(axis=1)
        half = np.max(np.abs(edges - middle[:, None]), axis=1) * (1 + 4 * EPS)
        orders = trajectory.omega * np.arange(1, trajectory.harmonics + 1)
        phases = np.multiply.outer(middle, orders)
        basis = np.sin(phases), np.cos(phases)
        amplitude = np.abs(trajectory.sine) + np.abs(trajectory.cosine)
        # (n, N), error of a sine with a rounded phase, in a sum of 2 n of them
        rounding = (16 + 2 * trajectory.harmonics + 4 * np.abs(phases.T)) * EPS
        signs = ((1, 0), (1, 1), (-1, 0), (-1, 1))
        found = []
        for derivative in range(DERIVATIVES):
            coefficients = np.zeros((TERMS, 6, len(middle)))
            radius = np.zeros((6, len(middle)))
            for k in range(TERMS):
                step = half**k / math.factorial(k)
                grown = orders ** (derivative + k)
                (sign_a, which_a), (sign_b, which_b) = (
                    signs[(derivative + k + shift) % 4] for shift in (0, 1)
                )
                values = basis[which_a] @ (sign_a * grown * trajectory.sine).T
                values += basis[which_b] @ (sign_b * grown * trajectory.cosine).T
                coefficients[k] = (values * step[:, None]).T
                radius += (amplitude * grown) @ rounding * step
            if derivative == 0:
                coefficients[0] += trajectory.lambda0[:, None]
                radius += 2 * EPS * np.abs(trajectory.lambda0[:, None])
            beyond = amplitude @ (orders ** (derivative + TERMS))
            radius += beyond[:, None] * half**TERMS / math.factorial(TERMS)
            radius *= UP
            found += [
                TaylorModel(np.ascontiguousarray(coefficients[:, i]), radius[i]) for i in range(6)
            ]
        return found
