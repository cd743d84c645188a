"""How rows of one kind of channel are scaled to unit covariance, so that least squares fit them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from estimation.measurement_model.normal_equations import NormalEquations, whitened
from estimation.processing import NoiseEstimate
from estimation.processing.whitening_filter import WhiteningFilter
from expdesign.information.fisher import whitening
from expdesign.noise.fourier_lines import lines_of, multiplicity


@dataclass(frozen=True, eq=False)
class RowWhitening:
    """Filter, covariance and counts of the rows of forces or lengths."""

    white: Array
    """(6, 6), S: S Σ Sᵀ = 1, with Σ larger by what its estimation adds to a variance."""
    counts: Array
    """(R,), samples that each row is the mean of."""
    filter: WhiteningFilter | None
    """What the rows go through first, where the noise is not white."""

    @classmethod
    def of(cls, noise: NoiseEstimate, counts: Array) -> RowWhitening:
        """Take it from the noise of one sample."""
        white = whitening(noise.covariance * noise.weighting_loss)
        return cls(white, counts, noise.filter)

    def __call__(self, values: Array) -> Array:
        """Return residuals, (R, 6), or columns, (R, 6, q), as rows of the regression."""
        rows = values if self.filter is None else self.filter(values)
        return whitened(rows, self.white, self.counts)

    def equations(self, residuals: Array, columns: Array) -> NormalEquations:
        """Return what residuals, (R, 6), say of the unknowns of their columns, (R, 6, u)."""
        rest, rows = self(residuals).ravel(), self(columns).reshape(residuals.size, -1)
        return NormalEquations(float(rest @ rest), rows.T @ rows, rows.T @ rest)

    def unscaled(self, rows: Array) -> Array:
        """Return rows, (R, 6) or (R, 6, q), in N or m again, behind the filter still."""
        flat = rows.reshape(*rows.shape[:2], -1) / np.sqrt(self.counts)[:, None, None]
        return np.asarray(np.linalg.solve(self.white, flat)).reshape(rows.shape)

    def weighted(self, rows: Array) -> Array:
        """Return what the inner products of columns with rows, (R, 6, q), are taken with.

        zᵀ W u of a column z and a whitened row of u is zᵀ times this.
        """
        values = np.matmul(self.white.T, rows) * np.sqrt(self.counts)[:, None, None]
        return values if self.filter is None else self.filter(values)

    def quadratic(self, actuator: int) -> Callable[[Array, Array], Array]:
        """Return zᵀ W y of pairs of series in one actuator, (q, R) each: (q,)."""
        if self.filter is None:
            column = self.white[:, actuator]
            weight = float(column @ column) * self.counts
            return lambda z, y: (z * y) @ weight
        noise_filter, count = self.filter, float(self.counts[0])
        gains = np.linalg.norm(self.white @ noise_filter.gain[:, :, actuator].T, axis=0) ** 2
        weights = count * gains * multiplicity(noise_filter.samples)
        return lambda z, y: weights @ (lines_of(z.T).conj() * lines_of(y.T)).real
