"""Covariances of one sample: as given, or from the scatter of repeated periods."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array


@dataclass(frozen=True, eq=False)
class NoiseEstimate:
    """The covariance of one kind of channel.

    Attributes
    ----------
    covariance : (6, 6)
        Of one sample.
    freedom : float
        Degrees of freedom that it rests on; inf when it was given.
    source : str
        ``"estimated"`` (scatter between periods), ``"given"`` (robot or run file) or
        ``"residuals"`` (of the fit itself: it includes the error of the model).
    """

    covariance: Array
    freedom: float
    source: str = "estimated"

    @property
    def includes_model_error(self) -> bool:
        """True when it comes from the residuals of the model of these channels itself."""
        return self.source == "residuals"

    def std_error(self) -> Array:
        """Return the standard error of each element, (6, 6), for normal noise (Wishart)."""
        diagonal = np.diag(self.covariance)
        spread = self.covariance**2 + np.multiply.outer(diagonal, diagonal)
        return np.sqrt(spread / self.freedom)


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """What the estimators weight with: Σ of the forces, N², and Δ of the lengths, m²."""

    forces: NoiseEstimate
    lengths: NoiseEstimate

    @classmethod
    def given(cls, forces: Array, lengths: Array) -> NoiseModel:
        """Take covariances that are known."""
        return cls(NoiseEstimate(forces, np.inf, "given"), NoiseEstimate(lengths, np.inf, "given"))

    @property
    def source(self) -> str:
        """Where both come from."""
        forces, lengths = self.forces.source, self.lengths.source
        return forces if forces == lengths else f"forces {forces}, lengths {lengths}"


def scatter_between_periods(values: Array, weights: Array | None = None) -> NoiseEstimate:
    """Return the covariance of the scatter about the mean over the periods.

    Parameters
    ----------
    values : (M, N, 6)
        M ≥ 2 periods of N samples.
    weights : (M, N), optional
        Between 0 and 1; samples that count less.

    Notes
    -----
    With (M − 1) N degrees of freedom for full weights. Squares count with the square of their
    weight: what is far off enough to lose weight is no noise.
    """
    w = np.ones(values.shape[:2]) if weights is None else weights
    total = w.sum(axis=0)
    mean = np.einsum("mn,mnj->nj", w, values) / total[:, None]
    residuals = (values - mean) * w[:, :, None]
    flat = residuals.reshape(-1, values.shape[2])
    freedom = float(np.sum(w**2) - np.count_nonzero(total > 0))
    return NoiseEstimate(flat.T @ flat / freedom, freedom)


def series_basis(phases: Array, harmonics: int) -> Array:
    """Return 1, sin kφ, cos kφ at phases (T,), rad: (T, 2 H + 1)."""
    angle = np.multiply.outer(phases, np.arange(1, harmonics + 1))
    return np.concatenate([np.ones((len(angle), 1)), np.sin(angle), np.cos(angle)], axis=1)


def scatter_about_series(
    times: Array, values: Array, omega: float, harmonics: int, weights: Array | None = None
) -> tuple[NoiseEstimate, Array]:
    """Return the covariance of the scatter about a Fourier series, and the residuals (T, 6).

    Parameters
    ----------
    weights : (T,), optional
        Between 0 and 1; samples that count less.

    Notes
    -----
    For periods that are not a whole number of samples, or stamps that jitter: there are no equal
    phases whose scatter could be taken. The series is long enough to follow the jumps of dry
    friction to well below the noise.
    """
    size = 2 * harmonics + 1
    w = np.ones(len(times)) if weights is None else weights
    chunk = max(1, 2_000_000 // size)
    normal, right = np.zeros((size, size)), np.zeros((size, values.shape[1]))

    parts = [slice(first, first + chunk) for first in range(0, len(times), chunk)]
    for part in parts:
        rows = series_basis(omega * times[part], harmonics)
        weighted = rows * w[part][:, None]
        normal += weighted.T @ rows
        right += weighted.T @ values[part]
    coefficients = np.linalg.solve(normal, right)
    residuals = np.concatenate(
        [
            values[part] - series_basis(omega * times[part], harmonics) @ coefficients
            for part in parts
        ]
    )
    freedom = float(np.sum(w**2) - size)
    weighted = residuals * w[:, None]
    return NoiseEstimate(weighted.T @ weighted / freedom, freedom), residuals


def series_harmonics(rows: int, rows_per_period: float) -> int:
    """Return how many harmonics the series of `scatter_about_series` has.

    At most a tenth of the rows may be spent on it, and less than a third of what the sampling of
    a period resolves.
    """
    return int(max(1, min(160, rows // 20, rows_per_period // 3)))
