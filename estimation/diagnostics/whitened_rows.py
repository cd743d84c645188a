"""Whitening of the rows of forces and lengths, and elimination of unknown signs of friction.

Near its reversals every rate of dry friction has unknown signs, together as many unknowns as
samples. With their whitened columns S and prior precisions P, N = SᵀS + P = L Lᵀ and y = N⁻¹ Sᵀ z,
the elimination of the signs replaces whitened rows z by

    (z − S y, P^½ y):

what the signs leave of z, and the pull of their priors. The inner products of these rows are those
of the Schur complement, zᵀ (1 − S N⁻¹ Sᵀ) z', and their least squares leave the residuals of the
joint fit. Different reversals have no sample in common: N consists of blocks. Behind a filter of
coloured noise it is one block.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np
import scipy.linalg as sla
from numpy.typing import NDArray
from scipy import sparse

from constraints.arrays import Array
from estimation.measurement_model.banded import Matrix, dense
from estimation.measurement_model.motion import whiten_rows
from estimation.processing import NoiseEstimate
from estimation.processing.spectrum import WhiteningFilter
from expdesign.information.fisher import whitening
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.noise import lines_of, multiplicity

Places = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class RowWhitening:
    """Scaling of the rows of forces or lengths to unit covariance."""

    white: Array
    """(6, 6), S with S Σ Sᵀ = 1; Σ is increased by the loss due to its estimation."""
    counts: Array
    """(R,), number of samples averaged in each whitened row."""
    filter: WhiteningFilter | None
    """Filter applied first, if the noise is coloured."""

    @classmethod
    def of(cls, noise: NoiseEstimate, counts: Array) -> RowWhitening:
        """Build the scaling from the noise of one sample."""
        white = whitening(noise.covariance * noise.weighting_loss)
        filtered = counts if noise.filter is None else counts[: noise.filter.count]
        return cls(white, filtered, noise.filter)

    def __call__(self, values: Array) -> Array:
        """Whiten residuals, (R, 6), or columns, (R, 6, q)."""
        rows = values if self.filter is None else self.filter(values)
        return whiten_rows(rows, self.white, self.counts)

    def of_one_sample(self, rows: Array) -> Array:
        """Return whitened rows, (R, 6) or (R, 6, q), N or m, if every row were one sample.

        They remain filtered.
        """
        flat = rows.reshape(*rows.shape[:2], -1)
        return np.asarray(np.linalg.solve(self.white, flat)).reshape(rows.shape)

    def unscale(self, rows: Array) -> Array:
        """Return whitened rows, (R, 6), in N or m; they remain filtered."""
        return self.of_one_sample(rows / np.sqrt(self.counts)[:, None])

    def apply_weights(self, rows: Array) -> Array:
        """Return the weighted rows, (R, 6, q), for inner products with unwhitened columns.

        zᵀ times the result is zᵀ W u, for a column z and the whitened rows of u.
        """
        values = np.matmul(self.white.T, rows) * np.sqrt(self.counts)[:, None, None]
        return values if self.filter is None else self.filter.adjoint(values)

    def quadratic(self, actuator: int) -> Callable[[Array, Array], Array]:
        """Return a function for zᵀ W y of pairs of series in one actuator, (q, R) each: (q,)."""
        if self.filter is None:
            column = self.white[:, actuator]
            weight = float(column @ column) * self.counts
            return lambda z, y: (z * y) @ weight
        noise_filter, count = self.filter, float(self.counts[0])
        gains = np.linalg.norm(self.white @ noise_filter.gain[:, :, actuator].T, axis=0) ** 2
        weights = np.zeros(noise_filter.samples // 2 + 1)
        weights[: len(gains)] = count * gains * multiplicity(noise_filter.count)
        size = 1.0 if noise_filter.size is None else noise_filter.size[:, actuator]
        return lambda z, y: weights @ (lines_of((z / size).T).conj() * lines_of((y / size).T)).real


@dataclass(frozen=True, eq=False)
class SignElimination:
    """Elimination of the unknown signs of friction from the rows of an experiment."""

    rows: RowWhitening
    """Of the forces, the first rows."""
    columns: Matrix
    """(6 R, s), S."""
    precision: Array
    """(s,), P."""
    blocks: Sequence[tuple[slice, Places, Array]]
    """Samples and signs of each block of N, and its L."""

    @classmethod
    def of(cls, rows: RowWhitening, errors: Matrix, precision: Array) -> Self:
        """Build it from the errors of the forces by each sign, (6 R, s), N, and P, (s,)."""
        columns = _through(rows, errors if rows.filter is None else dense(errors))
        blocks = []
        for times, own in overlapping_signs(columns):
            part = columns_of_signs(columns, times, own).reshape(-1, len(own))
            factor = np.linalg.cholesky(part.T @ part + np.diag(precision[own]))
            blocks.append((times, own, np.asfortranarray(factor)))
        return cls(rows, columns, precision, blocks)

    def __call__(self, rows: Array) -> Array:
        """Eliminate the signs from whitened rows, (n, …), in place; the last s are zero before."""
        touched, columns = self._touched
        found = columns.T @ rows[touched]
        for _, own, factor in self.blocks:
            found[own] = sla.cho_solve((factor, True), found[own], check_finite=False)
        rows[touched] -= columns @ found
        rows[len(rows) - self.count :] = (np.sqrt(self.precision) * found.T).T
        return rows

    @property
    def count(self) -> int:
        """Number s of signs."""
        return len(self.precision)

    @cached_property
    def _touched(self) -> tuple[Places, Matrix]:
        """Rows with unknown signs, and these rows of S."""
        touched = np.flatnonzero((self.columns**2).sum(axis=1))
        return touched, self.columns[touched]

    @cached_property
    def of_one_sample(self) -> SignRoots:
        """Roots of what the signs explain of the forces, N, if every row were one sample."""
        return SignRoots.of(
            (times, self._rows_of(times).of_one_sample(root)) for times, root in self._roots()
        )

    def explain(self, actuator: int, waves: Array) -> Array:
        """Return zᵀ F of unwhitened series in one actuator, (q, R): Σ |zᵀ F|² is explained."""
        own = [waves[:, times] @ root[actuator] for times, root in self._of_series.blocks]
        return np.hstack(own)

    @cached_property
    def _of_series(self) -> SignRoots:
        return SignRoots.of(
            (times, self._rows_of(times).apply_weights(root)) for times, root in self._roots()
        )

    def _rows_of(self, times: slice) -> RowWhitening:
        return replace(self.rows, counts=self.rows.counts[times])

    def _roots(self) -> Iterator[tuple[slice, Array]]:
        """Yield S L⁻ᵀ at the samples of each block, (T, 6, s)."""
        for times, own, factor in self.blocks:
            columns = columns_of_signs(self.columns, times, own)
            flat = columns.reshape(-1, len(own)).T
            root = sla.solve_triangular(factor, flat, lower=True).T
            yield times, root.reshape(columns.shape)


@dataclass(frozen=True, eq=False)
class SignRoots:
    """Roots R of the covariance R Rᵀ that unknown signs of friction add to each actuator."""

    blocks: Sequence[tuple[slice, Array]] = ()
    """Samples of reversals that overlap, and R, (6, T, ≤ T)."""
    total: Array = field(default_factory=lambda: np.zeros((ACTUATORS, ACTUATORS)))
    """(6, 6), covariance of the actuators, summed over the samples."""

    @classmethod
    def of(cls, columns: Iterable[tuple[slice, Array]]) -> Self:
        """Build them from independent columns, (T, 6, s), of samples that overlap."""
        blocks, total = [], np.zeros((ACTUATORS, ACTUATORS))
        for times, whole in columns:
            roots = whole.transpose(1, 0, 2)
            flat = roots.reshape(ACTUATORS, -1)
            total += flat @ flat.T
            if roots.shape[2] > roots.shape[1]:
                grams = np.matmul(roots, roots.transpose(0, 2, 1))
                least = _ROUNDING * np.max(grams, axis=(1, 2)) + np.finfo(np.float64).tiny
                roots = np.linalg.cholesky(grams + least[:, None, None] * np.eye(len(whole)))
            blocks.append((slice(times.start, times.start + len(whole)), roots))
        return cls(blocks, total)


_ROUNDING = 1e-12
"""Least eigenvalue of a product of columns, relative to its largest element."""


def overlapping_signs(columns: Matrix) -> list[tuple[slice, Places]]:
    """Return samples and signs of groups that have no sample in common, of columns (6 R, s)."""
    size, count = columns.shape
    if not isinstance(columns, sparse.sparray):
        return [(slice(0, size // ACTUATORS), np.arange(count))]
    entries = sparse.coo_array(columns)
    row, column = entries.coords
    first, last = np.full(count, size), np.zeros(count, dtype=np.intp)
    np.minimum.at(first, column, row)
    np.maximum.at(last, column, row)
    first, last = np.minimum(first, last) // ACTUATORS, last // ACTUATORS
    order = np.argsort(first, kind="stable")
    cuts = 1 + np.flatnonzero(first[order][1:] > np.maximum.accumulate(last[order])[:-1])
    groups = np.split(order, cuts) if count else []
    return [(slice(first[own[0]], np.max(last[own]) + 1), own) for own in groups]


def columns_of_signs(columns: Matrix, times: slice, signs: Places) -> Array:
    """Return the columns of some signs at some samples, (T, 6, s), of columns (6 R, s)."""
    rows = columns[ACTUATORS * times.start : ACTUATORS * times.stop]
    return dense(rows[:, signs]).reshape(-1, ACTUATORS, len(signs))


def _through(operation: Callable[[Array], Array], values: Matrix) -> Matrix:
    """Apply an operation on rows (R, 6, s), linear in each, to columns (6 R, s)."""
    count = values.shape[0] // ACTUATORS
    if not isinstance(values, sparse.sparray):
        return operation(values.reshape(count, ACTUATORS, -1)).reshape(-1, values.shape[1])
    each = operation(np.broadcast_to(np.eye(ACTUATORS), (count, ACTUATORS, ACTUATORS)))
    places = np.arange(count + 1)
    return sparse.bsr_array((each, places[:-1], places)).tocsr() @ values
