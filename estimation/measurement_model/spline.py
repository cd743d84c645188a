"""Motion without a period: B-splines of the pose on equidistant knots.

The coefficients of the quintic B-splines are the unknowns ξ. A sample depends on six of them per
coordinate: normal equations have a band, and are summed over blocks of neighbouring samples.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.interpolate import BSpline, PPoly

from constraints.arrays import Array
from estimation.measurement_model.banded import BandedInverse, Matrix
from estimation.processing.spectrum import WhiteningFilter
from expdesign.mechanism.hexapod import COORDINATES

MotionCovariance = Array | BandedInverse
"""Of ξ; that of a spline is not written down."""
DEGREE = 5
"""Of the polynomials between knots: the accelerations are cubic and smooth."""
_ACTIVE = DEGREE + 1
_ORDERS = 4
"""λ and three derivatives."""
_BLOCK = 128
"""Fewest samples of a block."""


@dataclass(frozen=True, eq=False)
class SplineMotion:
    """The kinematic unknowns ξ of a recording without a period: the table column by column."""

    table: Array
    """(6, K), coefficients of each pose coordinate: m, rad."""
    start: float
    """First knot with K − 5 intervals behind it, s."""
    spacing: float
    """Distance of the knots, s."""

    free_frequency = False
    harmonics = None

    @classmethod
    def over(cls, times: Array, intervals: int) -> SplineMotion:
        """Build a motion of zeros with a number of intervals over the times given, s."""
        first, last = float(np.min(times)), float(np.max(times))
        table = np.zeros((COORDINATES, intervals + DEGREE))
        return cls(table, first, (last - first) / intervals)

    @property
    def intervals(self) -> int:
        """Number of intervals between the first and the last knot."""
        return self.table.shape[1] - DEGREE

    @property
    def unknowns(self) -> int:
        """Length x of ξ."""
        return self.table.size

    def delay_by(self, time: float) -> SplineMotion:
        """Return the motion delayed by a time, s."""
        return replace(self, start=self.start + time)

    def add_step(self, step: Array) -> SplineMotion:
        """Return the motion with ξ + step."""
        return replace(self, table=self.table + step.reshape(-1, COORDINATES).T)

    def poses(self, times: Array) -> Array:
        """Return λ, (S, 6), at the times given, s."""
        return self.at(times).pose()

    def factor(self, covariance: MotionCovariance) -> Array:
        """Return the blocks of Cov(ξ) that `SplineSamples.spread` takes, those of each interval."""
        if not isinstance(covariance, BandedInverse):
            raise TypeError("the covariance of a spline is that of banded equations")
        return covariance.blocks(_ACTIVE * COORDINATES, COORDINATES)

    def at(self, times: Array) -> SplineSamples:
        """Return the motion at the times given, s; beyond the knots the polynomials continue."""
        place = (times - self.start) / self.spacing
        first = np.clip(np.floor(place), 0, self.intervals - 1).astype(np.intp)
        powers = np.vander(place - first, _ACTIVE, increasing=True)
        scale = self.spacing ** -np.arange(_ORDERS, dtype=float)
        basis = np.einsum("sp,dpk,d->sdk", powers, _polynomials(), scale)
        return SplineSamples(self, times, first, basis)


@cache
def _polynomials() -> Array:
    """Return coefficients of u^p, u in (0, 1), of each order and active function, (4, 6, 6)."""
    piecewise = PPoly.from_spline(BSpline.basis_element(np.arange(_ACTIVE + 1.0)))
    inside = slice(DEGREE, DEGREE + _ACTIVE)  # beyond the repeated knots
    result = np.zeros((_ORDERS, _ACTIVE, _ACTIVE))
    for order in range(_ORDERS):
        pieces = piecewise.derivative(order) if order else piecewise
        # In the interval at hand the function that began last is in its first piece.
        result[order, : _ACTIVE - order] = pieces.c[::-1, inside][:, ::-1]
    return result


@dataclass(frozen=True, eq=False)
class SplineSamples:
    """A motion at S instants, s, in ascending order."""

    motion: SplineMotion
    times: Array
    first: NDArray[np.intp]
    """(S,), first of the six functions that are active."""
    basis: Array
    """(S, 4, 6), the active functions and three derivatives."""

    def pose(self) -> Array:
        """Return λ, (S, 6)."""
        return self._motion_derivatives(0, 1)

    def state(self, first: int = 0) -> Array:
        """Return λ, λ̇, λ̈, or from another derivative on, (S, 18)."""
        return self._motion_derivatives(first, 3) if first else self._state

    @cached_property
    def _state(self) -> Array:
        return self._motion_derivatives(0, 3)

    def _motion_derivatives(self, first: int, count: int) -> Array:
        return self._derivatives(self.motion.table[:, :, None], first, count)[:, :, 0]

    def _derivatives(self, tables: Array, first: int, count: int) -> Array:
        """Return derivatives with t tables, (6, K, t): (S, 6 count, t)."""
        total = np.zeros((len(self.times), count, COORDINATES, tables.shape[2]))
        for k in range(_ACTIVE):
            coefficients = tables[:, self.first + k].transpose(1, 0, 2)
            total += self.basis[:, first : first + count, k, None, None] * coefficients[:, None]
        return total.reshape(len(self.times), count * COORDINATES, -1)

    def chain(self, slope: Array) -> Array:
        """Convert slopes to the pose and n − 1 derivatives, (S, r, 6 n), to slopes to ξ."""
        return self._local(slope, slice(None), 0, self.motion.table.shape[1])

    def apply_steps(self, slope: Array, steps: Array) -> Array:
        """Return the effect of steps of ξ, (x, t), on quantities with these slopes: (S, r, t)."""
        tables = steps.reshape(-1, COORDINATES, steps.shape[1]).transpose(1, 0, 2)
        return slope @ self._derivatives(tables, 0, slope.shape[2] // COORDINATES)

    def spread(self, slope: Array, factor: Array) -> Array:
        """Return the standard deviations of quantities with these slopes, (S, r)."""
        local = self._active(slope).reshape(*slope.shape[:2], -1)
        return np.sqrt(np.sum(np.matmul(local, factor[self.first]) * local, axis=2))

    def products(
        self,
        dense: Array,
        slope: Array,
        weights: Array,
        whitening_filter: WhiteningFilter | None = None,
    ) -> Matrix:
        """Return UᵀWU of the filtered columns U: dense ones, (S, 6, u), then those of ξ.

        `slope` are the slopes to the pose and its derivatives, (S, 6, 6 n); `weights` are D with
        W = DᵀD, (6, 6) or (S, 6, 6). The products of ξ have a band.
        """
        count, lag = dense.shape[2], 0
        if whitening_filter is not None:
            lag = whitening_filter.lag or 0
        weights = np.broadcast_to(weights, (len(self.times), *weights.shape[-2:]))
        size, blocks = count + self.motion.unknowns, []
        for rows in self._blocks(lag):
            window = slice(max(rows.start - lag, 0), rows.stop)
            begin = int(self.first[window.start])
            active = int(self.first[rows.stop - 1]) + _ACTIVE - begin
            both = np.concatenate(
                [dense[window], self._local(slope, window, begin, active)], axis=2
            )
            if whitening_filter is not None:
                both = whitening_filter.block(both, rows, rows.start - window.start)
            white = np.matmul(weights[rows], both).reshape(-1, both.shape[2])
            own = np.arange(count, both.shape[2]) + COORDINATES * begin
            places = np.broadcast_to(np.append(np.arange(count), own), (both.shape[2],) * 2)
            blocks.append((white.T @ white, places.T, places))
        data, row, column = (
            np.concatenate([each.ravel() for each in k]) for k in zip(*blocks, strict=True)
        )
        result = sparse.csr_array((data, (row, column)), shape=(size, size))
        result.eliminate_zeros()
        return result

    def _blocks(self, lag: int) -> Iterator[slice]:
        """Yield blocks of neighbouring samples, longer where a whitening filter is long."""
        least, total, begin = max(_BLOCK, 4 * lag), len(self.times), 0
        while begin < total:
            end = int(
                np.searchsorted(self.first, self.first[min(begin + least, total) - 1], "right")
            )
            yield slice(begin, end)
            begin = end

    def _active(self, slope: Array, window: slice = slice(None)) -> Array:
        """Return the columns of the active functions, (n, r, 6, 6), for samples of a window."""
        own = slope[window]
        by_order = own.reshape(*own.shape[:2], -1, COORDINATES)
        basis = self.basis[window, : by_order.shape[2]]
        return np.einsum("srdc,sdk->srkc", by_order, basis)

    def _local(self, slope: Array, window: slice, begin: int, active: int) -> Array:
        """Return the columns of the functions from `begin` on, (n, r, 6 active)."""
        narrow, first = self._active(slope, window), self.first[window] - begin
        wide = np.zeros((*narrow.shape[:2], active, COORDINATES))
        places = (first[:, None] + np.arange(_ACTIVE))[:, None, :, None]
        np.put_along_axis(wide, places, narrow, axis=2)
        return wide.reshape(*narrow.shape[:2], -1)
