"""The motion ξ, a Fourier series of the pose, its columns, and weighted normal equations.

Rows are residuals r with columns U and noise of the covariance Σ, each the mean of c samples. In
the equations of (p, ξ) the parameters are coupled with the motion of every experiment, but the
motions not with each other: over several experiments the matrix is an arrow, and the motions are
eliminated one experiment at a time.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.linalg as sla
from numpy.typing import NDArray
from scipy import sparse

from constraints.arrays import Array, ComplexArray
from estimation.measurement_model import spline
from estimation.measurement_model.banded import BandedInverse, Matrix, dense
from estimation.processing.spectrum import WhiteningFilter
from expdesign.information.fisher import ScaledInformation, whitening
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.trajectory import FourierTrajectory, PhaseBasis


@dataclass(frozen=True, eq=False)
class HarmonicMotion:
    """The kinematic unknowns ξ of one experiment."""

    table: Array
    """(6, 2 H + 1), centre, sine and cosine amplitudes of each pose coordinate: m, rad."""
    omega: float
    """rad/s."""
    free_frequency: bool = False
    """ω is one of the unknowns: ξ is the table row by row, then ω."""

    @property
    def harmonics(self) -> int:
        """H."""
        return (self.table.shape[1] - 1) // 2

    @property
    def unknowns(self) -> int:
        """Length x of ξ."""
        return self.table.size + int(self.free_frequency)

    @property
    def trajectory(self) -> FourierTrajectory:
        """The same motion in the paper's coefficients."""
        h = self.harmonics
        return FourierTrajectory.from_displacements(
            self.omega, self.table[:, 0], self.table[:, 1 : h + 1], self.table[:, h + 1 :]
        )

    @classmethod
    def of(cls, trajectory: FourierTrajectory, *, free_frequency: bool = False) -> HarmonicMotion:
        """Build the motion of a trajectory."""
        table = np.concatenate(
            [trajectory.lambda0[:, None], trajectory.sine, trajectory.cosine], axis=1
        )
        return cls(table, trajectory.omega, free_frequency)

    def with_harmonics(self, harmonics: int) -> HarmonicMotion:
        """Return the motion with more harmonics, the new ones zero, or with fewer."""
        old = self.harmonics
        few = min(old, harmonics)
        table = np.zeros((COORDINATES, 2 * harmonics + 1))
        table[:, 0] = self.table[:, 0]
        table[:, 1 : few + 1] = self.table[:, 1 : few + 1]
        table[:, harmonics + 1 : harmonics + 1 + few] = self.table[:, old + 1 : old + 1 + few]
        return replace(self, table=table)

    def delay_by(self, time: float) -> HarmonicMotion:
        """Return the motion delayed by a time, s."""
        h = self.harmonics
        phases = self.omega * time * np.arange(1, h + 1)
        cos, sin = np.cos(phases), np.sin(phases)
        sines, cosines = self.table[:, 1 : h + 1], self.table[:, h + 1 :]
        parts = [self.table[:, :1], sines * cos + cosines * sin, cosines * cos - sines * sin]
        return replace(self, table=np.concatenate(parts, axis=1))

    def add_step(self, step: Array) -> HarmonicMotion:
        """Return the motion with ξ + step."""
        size = self.table.size
        omega = self.omega + float(step[size]) if self.free_frequency else self.omega
        table = self.table + step[:size].reshape(self.table.shape)
        return replace(self, table=table, omega=omega)

    def poses(self, times: Array) -> Array:
        """Return λ, (S, 6), at the times given, s."""
        return PhaseBasis.at(self.omega * times, self.harmonics).value @ self.table.T

    def factor(self, covariance: spline.MotionCovariance) -> Array:
        """Return the root of Cov(ξ) that `MotionSamples.spread` takes, (x, x)."""
        return np.linalg.cholesky(np.asarray(covariance))

    def at(self, times: Array) -> MotionSamples:
        """Return the motion at the times given, s."""
        angle = np.multiply.outer(self.omega * times, np.arange(self.harmonics + 1))
        waves = np.empty(angle.shape, dtype=np.complex128)
        waves.real, waves.imag = np.cos(angle), np.sin(angle)
        return MotionSamples(self, times, waves)


@dataclass(frozen=True, eq=False)
class MotionSamples:
    """A motion at S instants, s."""

    motion: HarmonicMotion
    times: Array
    waves: ComplexArray
    """(S, H + 1), e^{ikωt}, k = 0 … H."""

    def rates(self, orders: int) -> ComplexArray:
        """Return (ikω)^d, the factors of the waves' derivatives d < `orders`, (orders, H + 1)."""
        rate = 1j * self.motion.omega * np.arange(self.motion.harmonics + 1)
        return np.asarray(np.vander(rate, orders, increasing=True).T, dtype=np.complex128)

    def pose(self) -> Array:
        """Return λ, (S, 6)."""
        return self._derivatives(self.motion.table, 0, 1)

    def state(self, first: int = 0) -> Array:
        """Return λ, λ̇, λ̈, or from another derivative on, (S, 18)."""
        return self._derivatives(self.motion.table, first, 3) if first else self._state

    @cached_property
    def _state(self) -> Array:
        return self._derivatives(self.motion.table, 0, 3)

    def _derivatives(self, rows: Array, first: int, count: int) -> Array:
        """Return derivatives of series with rows of a table, (R, 2 H + 1): (S, count R)."""
        h = self.motion.harmonics
        # a sin kφ + b cos kφ is the real part of (b − i a) e^{ikφ}: here of its conjugate.
        series = np.empty((len(rows), h + 1), dtype=np.complex128)
        series.real, series.imag[:, 0] = rows[:, [0, *range(h + 1, 2 * h + 1)]], 0.0
        series.imag[:, 1:] = rows[:, 1 : h + 1]
        wanted = self.rates(first + count)[first:, None].conj() * series
        return self.waves.view(np.float64) @ wanted.reshape(-1, h + 1).view(np.float64).T

    def chain(self, slope: Array) -> Array:
        """Convert slopes to the pose and n − 1 derivatives, (S, r, 6 n), to slopes to ξ."""
        count, rows, depth = slope.shape
        table, orders = self.motion.table, depth // COORDINATES
        by_order = slope.reshape(count, rows, orders, COORDINATES).transpose(0, 1, 3, 2)
        basis = of_table(self.waves[:, None, :] * self.rates(orders))
        carried = np.matmul(by_order.reshape(count, rows * COORDINATES, orders), basis)
        result = carried.reshape(count, rows, table.size)
        if not self.motion.free_frequency:
            return result
        return np.concatenate([result, self.frequency_column(slope)], axis=2)

    def apply_steps(self, slope: Array, steps: Array) -> Array:
        """Return the effect of steps of ξ, (x, t), on quantities with these slopes: (S, r, t)."""
        return np.matmul(slope, self._state_changes(slope.shape[2], steps))

    def spread(self, slope: Array, factor: Array) -> Array:
        """Return the standard deviations of quantities with these slopes, (S, r)."""
        states = self._state_changes(slope.shape[2], factor)
        covariance = np.matmul(states, states.transpose(0, 2, 1))
        variance = np.sum(np.matmul(slope, covariance) * slope, axis=2)
        return np.sqrt(np.maximum(variance, 0.0))

    def _state_changes(self, depth: int, steps: Array) -> Array:
        """Return the effect of steps of ξ on the pose and its derivatives, (S, depth, t)."""
        table, count = self.motion.table, steps.shape[1]
        rows = steps[: table.size].reshape(*table.shape, count).transpose(0, 2, 1)
        states = self._derivatives(rows.reshape(-1, table.shape[1]), 0, depth // COORDINATES)
        states = states.reshape(len(states), depth, count)
        if self.motion.free_frequency:
            states += self._frequency_change(depth)[:, :, None] * steps[table.size]
        return states

    def products(self, dense: Array, slope: Array, weights: Array) -> Array:
        """Return UᵀWU of the columns U: dense ones, (S, 6, u), then those of ξ.

        `slope` are the slopes to the pose and its derivatives, (S, 6, 6 n); `weights` are D with
        W = DᵀD, (6, 6) or (S, 6, 6).
        """
        width, columns = dense.shape[2], [dense]
        if self.motion.free_frequency:
            columns.append(self.frequency_column(slope))
        white = np.matmul(weights, np.concatenate([*columns, slope], axis=2))
        dense, slope = np.split(white, [white.shape[2] - slope.shape[2]], axis=2)
        turned = slope.transpose(0, 2, 1)
        rows = dense.reshape(-1, dense.shape[2])
        inner, outer = _table_products(np.matmul(turned, slope), self), rows.T @ rows
        crossed = _sums(np.matmul(turned, dense), self.waves)
        orders = len(crossed) // COORDINATES
        by_order = crossed.reshape(orders, COORDINATES, *crossed.shape[1:])
        carried = np.sum(by_order * self.rates(orders)[:, None, None], axis=0)
        cross = of_table(carried).transpose(1, 0, 2).reshape(len(outer), len(inner))
        # Dense columns, the table, ω.
        size = len(outer) + len(inner)
        table = slice(width, width + len(inner))
        others = np.r_[0:width, table.stop : size]
        result = np.empty((size, size))
        result[table, table] = inner
        result[others[:, None], others] = outer
        result[others, table] = cross
        result[table, others] = cross.T
        return result

    def frequency_column(self, slope: Array) -> Array:
        """Convert the same slopes to those to ω, (S, r, 1)."""
        return np.matmul(slope, self._frequency_change(slope.shape[2])[:, :, None])

    def _frequency_change(self, depth: int) -> Array:
        """Return the effect of ω on the pose and its derivatives, (S, depth)."""
        # A higher frequency reaches the same phases earlier.
        omega, derivatives = self.motion.omega, self.state(first=1)
        rate, acceleration, jerk = np.split(derivatives, 3, axis=1)
        stretch = self.times[:, None] / omega
        change = [
            stretch * rate,
            rate / omega + stretch * acceleration,
            2 * acceleration / omega + stretch * jerk,
        ]
        return np.concatenate(change, axis=1)[:, :depth]


def of_table(waves: ComplexArray) -> Array:
    """Convert coefficients of e^{ikφ}, (…, H + 1), to those of 1, sin kφ, cos kφ, (…, 2 H + 1)."""
    one, others = waves[..., :1].real, waves[..., 1:]
    return np.concatenate([one, others.imag, others.real], axis=-1)


Motion = HarmonicMotion | spline.SplineMotion
Samples = MotionSamples | spline.SplineSamples


@dataclass(frozen=True, eq=False)
class MotionColumns:
    """Columns U of k + x unknowns, ξ last, at S samples of six channels."""

    others: Array
    """(S, 6, k), of the other unknowns."""
    slope: Array
    """(S, 6, 6 n), slope to the pose and its n − 1 first derivatives."""
    sampled: Samples
    """The motion at the samples."""

    def dense(self) -> Array:
        """Return U, (S, 6, k + x)."""
        return np.concatenate([self.others, self.sampled.chain(self.slope)], axis=2)

    def times(self, steps: Array) -> Array:
        """Return U s, (S, 6, t), of steps of the unknowns, (k + x, t)."""
        own = self.others.shape[2]
        return self.others @ steps[:own] + self.sampled.apply_steps(self.slope, steps[own:])

    def products(
        self, residuals: Array, weights: Array, whitening_filter: WhiteningFilter | None = None
    ) -> Matrix:
        """Return (r, U)ᵀ W (r, U), (1 + k + x, 1 + k + x), with residuals r, (S, 6).

        `weights` are D with W = DᵀD, (6, 6) or (S, 6, 6). Only a spline's columns are filtered.
        """
        dense = np.concatenate([residuals[:, :, None], self.others], axis=2)
        if whitening_filter is None or isinstance(self.sampled, MotionSamples):
            return self.sampled.products(dense, self.slope, weights)
        return self.sampled.products(dense, self.slope, weights, whitening_filter)


def _table_products(each: Array, sampled: MotionSamples) -> Array:
    """Return the products of the columns of the table, from those of the slopes, (S, 6 n, 6 n)."""
    h, waves = sampled.motion.harmonics, sampled.waves
    orders = each.shape[1] // COORDINATES
    sums = _sums(each, np.concatenate([waves, waves[:, 1:] * waves[:, -1:]], axis=1))
    sums = np.concatenate([sums[:, :, :0:-1].conj(), sums], axis=2)
    sums = sums.reshape(orders, COORDINATES, orders, COORDINATES, -1)
    harmonics = np.arange(h + 1)
    difference = 2 * h + harmonics - harmonics[:, None]
    total = 2 * h + harmonics + harmonics[:, None]
    rates = sampled.rates(orders)
    size = (COORDINATES, COORDINATES, h + 1, h + 1)
    along, against = np.zeros(size, np.complex128), np.zeros(size, np.complex128)
    for left, of_order in zip(rates, sums, strict=True):
        weights = left[:, None] * rates[:, None]
        opposite = left.conj()[:, None] * rates[:, None]
        along += np.einsum("abckl,bkl->ackl", of_order[..., difference], opposite)
        against += np.einsum("abckl,bkl->ackl", of_order[..., total], weights)
    plus, minus = (along + against) / 2, (along - against) / 2
    result = np.empty((COORDINATES, 2 * h + 1, COORDINATES, 2 * h + 1))
    cos, sin = np.r_[0, h + 1 : 2 * h + 1], slice(1, h + 1)
    tables = result.transpose(0, 2, 1, 3)
    tables[:, :, cos[:, None], cos] = plus.real
    tables[:, :, sin, sin] = minus[:, :, 1:, 1:].real
    tables[:, :, sin, cos] = -minus[:, :, 1:].imag
    tables[:, :, cos, sin] = plus[:, :, :, 1:].imag
    return result.reshape(2 * (COORDINATES * (2 * h + 1),))


def _sums(values: Array, waves: ComplexArray) -> ComplexArray:
    """Return Σ_s v(s) e^{imφ(s)}, (a, b, M), of values (S, a, b) and waves (S, M)."""
    flat = values.reshape(len(values), -1)
    return (flat.T @ waves.view(np.float64)).view(np.complex128).reshape(*values.shape[1:], -1)


Rows = tuple[Array, Array | MotionColumns, Array]
"""Residuals (S, 6), columns (S, 6, u), explicit or not, and counts (S,)."""


def filter_rows(parts: Iterable[Rows], whitening_filter: WhiteningFilter) -> Rows:
    """Concatenate and filter parts with equal counts."""
    written = (
        (rest, columns.dense() if isinstance(columns, MotionColumns) else columns, counts)
        for rest, columns, counts in parts
    )
    residuals, columns, counts = (np.concatenate(each) for each in zip(*written, strict=True))
    rest, rows = whitening_filter.rows(residuals), whitening_filter.rows(columns)
    return rest, rows, np.full(len(rest), counts[0])


def _join_rows(parts: Iterable[Rows]) -> Rows:
    """Concatenate parts of one recording without a period."""
    residuals, columns, counts = zip(*parts, strict=True)
    joined = np.concatenate(
        [each for each in columns if not isinstance(each, MotionColumns)] or [np.zeros(0)]
    )
    motion = [each for each in columns if isinstance(each, MotionColumns)]
    whole: Array | MotionColumns = joined
    if motion:
        sampled = motion[0].sampled
        whole = MotionColumns(
            np.concatenate([each.others for each in motion]),
            np.concatenate([each.slope for each in motion]),
            sampled.motion.at(np.concatenate([each.sampled.times for each in motion])),
        )
    return np.concatenate(residuals), whole, np.concatenate(counts)


def whiten_rows(values: Array, white: Array, counts: Array) -> Array:
    """Scale residuals (S, 6) or columns (S, 6, u) to unit covariance by S: S Σ Sᵀ = 1."""
    columns = values.reshape(*values.shape[:2], int(np.prod(values.shape[2:])))
    if len(counts) and np.all(counts == counts[0]):  # one pass over large columns less
        return np.matmul(white * np.sqrt(counts[0]), columns).reshape(values.shape)
    return (np.matmul(white, columns) * np.sqrt(counts)[:, None, None]).reshape(values.shape)


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Weighted sum of squares about a point: cost − 2 gᵀs + sᵀ N s."""

    cost: float
    """Σ c rᵀ Σ⁻¹ r."""
    matrix: Matrix
    """(u, u), N = Σ c Uᵀ Σ⁻¹ U; sparse with a spline, whose part has a band."""
    gradient: Array
    """(u,), g = Σ c Uᵀ Σ⁻¹ r."""

    @classmethod
    def of(
        cls,
        parts: Iterable[Rows],
        covariance: Array,
        whitening_filter: WhiteningFilter | None = None,
    ) -> NormalEquations:
        """Sum over the rows of one kind of channel, part by part (at least one).

        A filter whitens their noise first; it needs all samples of a period.
        """
        white = whitening(covariance)
        products: Matrix = np.zeros(())
        local = None
        if whitening_filter is not None and whitening_filter.lag is not None:
            parts, local = [_join_rows(parts)], whitening_filter
        elif whitening_filter is not None:
            parts = [filter_rows(parts, whitening_filter)]
        for residuals, columns, counts in parts:
            if isinstance(columns, MotionColumns):
                weights = white * np.sqrt(counts)[:, None, None]
                products = products + columns.products(residuals, weights, local)
                continue
            both = np.concatenate([residuals[:, :, None], columns], axis=2)
            if local is not None:
                both = local(both)
            rows = whiten_rows(both, white, counts).reshape(-1, both.shape[2])
            products = products + rows.T @ rows
        first = dense(products[:1])[0]
        return cls(float(first[0]), products[1:, 1:], first[1:])

    def __add__(self, other: NormalEquations) -> NormalEquations:
        """Add independent information on the same unknowns, or on the first of them."""
        return self.add_block(other, slice(len(other.gradient)))

    def with_motion(self, motion: NormalEquations) -> NormalEquations:
        """Add the information of the lengths on ξ, the last unknowns."""
        return self.add_block(motion, slice(len(self.gradient) - len(motion.gradient), None))

    def add_block(self, other: NormalEquations, own: slice) -> NormalEquations:
        """Add independent information on some of the unknowns."""
        matrix, gradient = self.matrix.copy(), self.gradient.copy()
        gradient[own] += other.gradient
        if isinstance(matrix, sparse.sparray):
            block, places = sparse.coo_array(other.matrix), np.arange(len(gradient))[own]
            at = tuple(places[each] for each in block.coords)
            matrix = matrix + sparse.csr_array((block.data, at), shape=matrix.shape)
        else:
            matrix[own, own] += other.matrix
        return NormalEquations(self.cost + other.cost, matrix, gradient)

    def select(self, unknowns: Sequence[int] | NDArray[np.intp] | slice) -> NormalEquations:
        """Return the equations of some unknowns; the others keep their values."""
        matrix = self.matrix[unknowns][:, unknowns]
        return NormalEquations(self.cost, matrix, self.gradient[unknowns])

    def eliminate(self, kept: int, damping: float = 0.0) -> Elimination:
        """Eliminate all unknowns but the first `kept`.

        Raises
        ------
        numpy.linalg.LinAlgError
            ξ is not determined.
        """
        inner = self.matrix[kept:, kept:]
        outer, cross = (
            dense(self.matrix[part, :kept]) for part in (slice(kept), slice(kept, None))
        )
        if not inner.shape[0]:
            return Elimination(0.0, outer, self.gradient, cross, self.gradient[kept:])
        right = np.column_stack([cross, self.gradient[kept:]])
        if isinstance(inner, sparse.sparray):
            solved = BandedInverse.of(inner, damping) @ right
        else:
            size = np.sqrt(np.diag(inner))
            scaled = inner / np.multiply.outer(size, size) + damping * np.eye(len(size))
            solved = sla.cho_solve(sla.cho_factor(scaled), right / size[:, None]) / size[:, None]
        slope, offset = solved[:, :-1], solved[:, -1]
        gradient = self.gradient[:kept] - cross.T @ offset
        return Elimination(0.0, outer - cross.T @ slope, gradient, slope, offset)


@dataclass(frozen=True, eq=False)
class Elimination(NormalEquations):
    """Equations of the k parameters alone, and the optimal motion for a step s of them.

    Their matrix is F_pp − F_pξ F_ξξ⁻¹ F_ξp; the cost is left out.
    """

    slope: Array
    offset: Array
    """(x, k) and (x,), the motion's step is offset − slope s."""


_CLEARLY = 100.0
"""Error of an estimated condition number, at most."""


def root_of_pseudo_inverse(information: Array, least: float) -> Array:
    """Return R, (u, r), with R Rᵀ = F⁺ on the determined combinations of F, (u, u).

    `least` is the smallest eigenvalue of the scaled F, relative to the largest, that counts.

    Examples
    --------
    >>> root_of_pseudo_inverse(np.diag([4.0, 0.0]), 1e-9).tolist()
    [[0.5], [0.0]]
    """
    scaled = ScaledInformation.of(information)
    scales = np.where(scaled.scales > 0, scaled.scales, 1.0)
    factor, failed = sla.lapack.dpotrf(scaled.matrix)
    if not failed:
        norm = np.linalg.norm(scaled.matrix, 1)
        if sla.lapack.dpocon(factor, norm)[0] > _CLEARLY * least:
            # All combinations are determined: the ratio of the eigenvalues is no smaller.
            return np.asarray(sla.lapack.dtrtri(factor)[0] / scales[:, None])
    values, vectors = np.linalg.eigh(scaled.matrix)
    kept = values > least * values[-1]
    return np.asarray(vectors[:, kept] / np.sqrt(values[kept]) / scales[:, None])
