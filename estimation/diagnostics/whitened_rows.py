"""Whitening of the rows of forces and lengths, and elimination of unknown signs of friction.

Near its reversals every rate of dry friction has unknown signs, together as many unknowns as
samples. With their whitened columns S and prior precisions P, N = SᵀS + P = L Lᵀ, Q = S L⁻ᵀ and
B = P^½ L⁻ᵀ, the elimination of the signs replaces whitened rows z by

    (z − Q Qᵀ z, B Qᵀ z):

what the signs leave of z, and the pull of their priors. The inner products of these rows are those
of the Schur complement, zᵀ (1 − Q Qᵀ) z', and their least squares leave the residuals of the joint
fit. Different reversals have no sample in common: N consists of small blocks. Behind a filter of
coloured noise it is one block.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Self, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from constraints.arrays import Array
from estimation.measurement_model.motion import whiten_rows
from estimation.processing import NoiseEstimate
from estimation.processing.spectrum import WhiteningFilter
from expdesign.information.fisher import whitening
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.noise import lines_of, multiplicity

Matrix: TypeAlias = Array | sparse.csr_array


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
    explained: Matrix
    """(6 R, s), Q."""
    pull: Matrix
    """(s, s), B."""

    @classmethod
    def of(cls, rows: RowWhitening, errors: Matrix, precision: Array) -> Self:
        """Build it from the errors of the forces by each sign, (6 R, s), N, and P, (s,)."""
        columns = _through(rows, errors if rows.filter is None else dense(errors))
        prior = sparse.diags_array(precision)
        root = _inverse_root(columns.T @ columns + prior)
        return cls(rows, columns @ root, prior.sqrt() @ root)

    def __call__(self, rows: Array) -> Array:
        """Eliminate the signs from whitened rows, (n, …), in place; the last s are zero before."""
        touched, explained = self._touched
        known = explained.T @ rows[touched]
        rows[touched] -= explained @ known
        rows[len(rows) - self.count :] = self.pull @ known
        return rows

    @property
    def count(self) -> int:
        """Number s of signs."""
        return self.pull.shape[0]

    @cached_property
    def _touched(self) -> tuple[NDArray[np.intp], Matrix]:
        """Rows with unknown signs, and these rows of Q."""
        touched = np.flatnonzero((self.explained**2).sum(axis=1))
        return touched, self.explained[touched]

    @cached_property
    def of_one_sample(self) -> list[Matrix]:
        """(R, s) of each actuator, Q in N if every row were one sample."""
        return by_actuator(_through(self.rows.of_one_sample, self.explained))

    @cached_property
    def weighted(self) -> list[Matrix]:
        """(R, s) of each actuator, Q for inner products with unwhitened columns."""
        return by_actuator(_through(self.rows.apply_weights, self.explained))


def by_actuator(values: Matrix) -> list[Matrix]:
    """Split rows, (6 R, s), into those of each actuator, (R, s)."""
    return [values[actuator::ACTUATORS] for actuator in range(ACTUATORS)]


def dense(values: Matrix) -> Array:
    """Return columns as a full array."""
    return values.toarray() if isinstance(values, sparse.sparray) else values


def _through(operation: Callable[[Array], Array], values: Matrix) -> Matrix:
    """Apply an operation on rows (R, 6, s), linear in each, to columns (6 R, s)."""
    count = values.shape[0] // ACTUATORS
    if not isinstance(values, sparse.sparray):
        return operation(values.reshape(count, ACTUATORS, -1)).reshape(-1, values.shape[1])
    each = operation(np.broadcast_to(np.eye(ACTUATORS), (count, ACTUATORS, ACTUATORS)))
    places = np.arange(count + 1)
    return sparse.bsr_array((each, places[:-1], places)).tocsr() @ values


def _inverse_root(matrix: Matrix) -> Matrix:
    """Return R with R Rᵀ = N⁻¹ of a positive definite matrix, block by block."""
    whole = sparse.csr_array(matrix)
    count, block = connected_components(whole, directed=False)
    if count == 1:
        return whitening(whole.toarray()).T
    order = np.argsort(block, kind="stable")
    parts = np.split(order, np.cumsum(np.bincount(block))[:-1])
    roots = [whitening(whole[own][:, own].toarray()).T for own in parts]
    places = np.argsort(order)
    return sparse.block_diag(roots, format="csr")[places]
