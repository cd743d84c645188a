"""Taylor models in time: polynomials with a bound on their remainder.

A model of a function f over a cell of time is a polynomial P and a radius r with
|f(τ) − P(τ)| ≤ r for every τ in [−1, 1], the cell's own time. Sums and products of models are
models again: what a product has beyond the highest power, and every rounding of the computer's
numbers, is added to the radius (Makino, Berz, Taylor models and other validated functional
inclusion methods, 2003). N cells are computed at once.

Rounding: an operation of IEEE 754 is wrong by at most `EPS`/2 of its result. Every operation adds
a multiple of `EPS` times the sum of the sizes that it met, which is more than all its roundings
together, and every radius is enlarged by `_UP` for those of its own computation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from math import comb

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.enclosure import arithmetic
from expdesign.enclosure.arithmetic import EPS, TERMS
from expdesign.trajectory import FourierTrajectory

_UP = 1 + 2.0**-40
_ROUNDED = 64 * EPS
"""More than what is lost where a polynomial is taken to a part of its piece."""
# Coefficients of τ⁰, τ¹, … from what a piece is made of. All numbers are exact in binary.
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
    """(N + 1,), s: where the pieces begin, and where the last one ends."""
    coefficients: Array
    """(K, m, N), of τ⁰, τ¹, …"""
    error: Array
    """(K, m, N), by how much a coefficient may differ from that of the path; ∞: not known."""

    @property
    def derivative(self) -> PiecewisePolynomials:
        """The derivative in time, per s."""
        if len(self.coefficients) == 1:
            nothing = np.zeros_like(self.coefficients)
            return PiecewisePolynomials(self.times, nothing, nothing)
        half = np.diff(self.times) / 2
        power = np.arange(1, len(self.coefficients))[:, None, None]
        found = self.coefficients[1:] * power / half
        error = self.error[1:] * power / half + 4 * EPS * np.abs(found)
        return PiecewisePolynomials(self.times, found, error * _UP)

    def mapped(self, source: NDArray[np.intp], factor: Array, zero: Array) -> PiecewisePolynomials:
        """Return the coordinates p / factor + zero of a path p: that of `source` for each."""
        found = self.coefficients[:, source] / factor[:, None]
        error = self.error[:, source] / np.abs(factor[:, None]) + 2 * EPS * np.abs(found)
        return PiecewisePolynomials(self.times, found, error * _UP).moved(zero)

    def moved(self, way: Array) -> PiecewisePolynomials:
        """Return the path p + way, (m,), whose last digit may be wrong."""
        found, error = self.coefficients.copy(), self.error.copy()
        found[0] += way[:, None]
        error[0] += 2 * EPS * (np.abs(found[0]) + np.abs(way[:, None]))
        return PiecewisePolynomials(self.times, found, error * _UP)

    def over(self, edges: Array) -> list[TaylorModel]:
        """Return the m models over cells, (N', 2), s, none of which reaches beyond a piece."""
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
        # Where the cell lies in its piece is rounded too: by what the slope makes of that.
        weights = 1 + np.arange(count)[:, None, None]
        radius = (error.sum(axis=0) + _ROUNDED * np.sum(weights * np.abs(own), axis=0)) * _UP
        return [
            TaylorModel(np.ascontiguousarray(found[:, i]), radius[i]) for i in range(own.shape[1])
        ]


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
    return PiecewisePolynomials(times, coefficients, error * _UP)


@dataclass(frozen=True, eq=False)
class PosePath:
    """A motion of the pose that is polynomials in time."""

    poses: PiecewisePolynomials
    """m and rad."""

    @property
    def breaks(self) -> Array:
        """(K,), s: when the pieces begin and end."""
        return self.poses.times

    def models(self, edges: Array) -> list[TaylorModel]:
        """Return the models of pose, rate, acceleration and jerk, 24, over cells (N, 2), s."""
        return [model for part in self._derivatives for model in part.over(edges)]

    @cached_property
    def _derivatives(self) -> list[PiecewisePolynomials]:
        found = [self.poses]
        for _ in range(3):
            found.append(found[-1].derivative)
        return found


_NEWTON_STEPS = 2


class TaylorModel:
    """A model over each of N cells.

    Attributes
    ----------
    coefficients : (k, N) or (k, 1)
        Coefficients of τ⁰ … τᵏ⁻¹, k ≤ `TERMS`; a single column applies to all cells.
    radius : (N,) or (1,)
        Infinite where nothing is known.
    """

    __slots__ = ("_packed", "coefficients", "radius")

    def __init__(self, coefficients: Array, radius: Array, packed: Array | None = None) -> None:
        self.coefficients = coefficients
        self.radius = radius
        self._packed = packed

    @classmethod
    def number(cls, value: float) -> TaylorModel:
        """Return the model of a number that is known exactly, in all cells."""
        return cls(np.full((1, 1), float(value)), np.zeros(1))

    @classmethod
    def unknown(cls) -> TaylorModel:
        """Return the model of what may be anything, in all cells."""
        return cls(np.zeros((1, 1)), np.full(1, np.inf))

    @classmethod
    def within(cls, low: Array, high: Array) -> TaylorModel:
        """Return the model of what lies between two numbers, (N,) each, in every cell."""
        middle = low + (high - low) / 2
        radius = np.maximum(high - middle, middle - low)
        return cls(middle[None, :], arithmetic.all_outward(radius + EPS * np.abs(middle)))

    @classmethod
    def unpacked(cls, packed: Array, count: int) -> TaylorModel:
        """Return the model of a packed one, (TERMS + 1, N), with so many coefficients: a view."""
        return cls(packed[:count], packed[TERMS], packed)

    def write(self, packed: Array) -> int:
        """Write it into a packed model, (TERMS + 1, N); return how many coefficients it has."""
        count = len(self.coefficients)
        packed[:count] = self.coefficients
        packed[TERMS] = self.radius
        return count

    @property
    def cells(self) -> int:
        """Number of cells; 1 if the model applies to all."""
        return max(self.coefficients.shape[1], len(self.radius))

    def packed(self, cells: int) -> tuple[Array, int]:
        """Return it packed, (TERMS + 1, cells), only to be read, and how many coefficients it has.

        A model that is a view of a packed one is not packed again.
        """
        if self._packed is not None and self._packed.shape[1] == cells:
            return self._packed, len(self.coefficients)
        packed = np.empty((TERMS + 1, cells))
        return packed, self.write(packed)

    @property
    def size(self) -> Array:
        """(N,) what no value is larger than in size."""
        return arithmetic.size(*self.packed(self.cells))

    def bounds(self) -> tuple[Array, Array]:
        """Return what no value is below and none above, (N,) each.

        That of the first three powers together is exact, each further one counts with its size.
        Where a coefficient is too large for a number, nothing is known.
        """
        return arithmetic.bounds(*self.packed(self.cells))

    def extremes(self) -> list[Array]:
        """Return where in each cell the polynomial may be largest or smallest, τ, (N,) each.

        The middle, both ends, and where the slope is zero: found by Newton's method from the
        vertex of the first three powers, which is enough to find a good value, and proves nothing.
        """
        c = self.coefficients
        places = [np.full(c.shape[1], tau) for tau in (0.0, -1.0, 1.0)]
        if len(c) < 3:  # noqa: PLR2004 - a straight line has no vertex
            return places
        powers = np.arange(1, len(c))
        first = TaylorModel(powers[:, None] * c[1:], self.radius)
        second = TaylorModel((powers * (powers - 1))[1:, None] * c[2:], self.radius)
        with np.errstate(all="ignore"):
            place = np.clip(np.nan_to_num(-c[1] / (2 * c[2])), -1, 1)
            for _ in range(_NEWTON_STEPS):
                step = first.at(place) / second.at(place)
                place = np.clip(place - np.nan_to_num(step), -1, 1)
        return [*places, place]

    def root(self) -> Array:
        """Return where the polynomial changes its sign in each cell, τ, (N,); NaN where not sure.

        Like `extremes` this is a good place, no proof.
        """
        return arithmetic.roots(*self.packed(self.cells))

    def at(self, instants: Array) -> Array:
        """Return the polynomial's values at τ, (N,); the function's are within the radius."""
        value = np.zeros(np.broadcast_shapes(self.coefficients.shape[1:], instants.shape))
        for coefficient in self.coefficients[::-1]:
            value = value * instants + coefficient
        return value

    def __add__(self, other: TaylorModel) -> TaylorModel:
        return self._sum(other, 1.0)

    def __sub__(self, other: TaylorModel) -> TaylorModel:
        return self._sum(other, -1.0)

    def _sum(self, other: TaylorModel, sign: float) -> TaylorModel:
        cells = max(self.cells, other.cells)
        out = np.empty((TERMS + 1, cells))
        count = arithmetic.add(*self.packed(cells), *other.packed(cells), sign, out)
        return TaylorModel.unpacked(out, count)

    def __neg__(self) -> TaylorModel:
        return TaylorModel(-self.coefficients, self.radius)

    def __mul__(self, other: TaylorModel) -> TaylorModel:
        cells = max(self.cells, other.cells)
        out, room = np.empty((2, TERMS + 1, cells))
        count = arithmetic.multiply(*self.packed(cells), *other.packed(cells), out, room)
        return TaylorModel.unpacked(out, count)

    def squared(self) -> TaylorModel:
        """Return the square."""
        return self * self

    def scaled(self, factor: float) -> TaylorModel:
        """Return the model times a number that is known exactly."""
        return TaylorModel.number(factor) * self


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
        """Return the models of pose, rate, acceleration and jerk, 24, over cells (N, 2), s."""
        return fourier_models(self.trajectory, edges)


def fourier_models(trajectory: FourierTrajectory, edges: Array) -> list[TaylorModel]:
    """Return the models of pose, rate, acceleration and jerk, 24, over cells of time.

    The derivatives of a series are known in closed form, and no derivative of a harmonic is larger
    than its amplitude times the power of its frequency.

    Parameters
    ----------
    edges : (N, 2)
        When each cell begins and ends, s; every instant between the two is in the cell.
    """
    middle = edges.mean(axis=1)
    half = np.max(np.abs(edges - middle[:, None]), axis=1) * (1 + 4 * EPS)
    orders = trajectory.omega * np.arange(1, trajectory.harmonics + 1)
    phases = np.multiply.outer(middle, orders)
    basis = np.sin(phases), np.cos(phases)
    amplitude = np.abs(trajectory.sine) + np.abs(trajectory.cosine)
    # (n, N), how wrong a sine may be whose phase was rounded, in a sum of 2 n of them
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
        radius *= 1 + 2.0**-40
        found += [
            TaylorModel(np.ascontiguousarray(coefficients[:, i]), radius[i]) for i in range(6)
        ]
    return found
