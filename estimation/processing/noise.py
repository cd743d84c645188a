"""Covariances of one sample, given or from repeated periods, and weights against outliers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from constraints.arrays import Array, ComplexArray, Mask
from estimation.processing.spectrum import (
    NoiseLines,
    WhiteningFilter,
    divide_spectrum,
    filter_to,
    scaling_filter,
)

NORMAL_MEDIAN = 0.6745
"""Median of |x| for a standard normal x: ratio of a median absolute deviation to a std."""

_CUT = 4.0
"""Normalised distance up to which a sample has full weight. One in 16 000 normal samples of a
channel exceeds it, so that clean data keep their efficiency and covariance."""

ENOUGH_FREEDOM = 250.0
"""Degrees of freedom from which on the scatter between periods is preferred to a given covariance.
The inverse of a 6 × 6 covariance is then 3 % too large on average (ν / (ν − 7)), which the standard
deviations include, and the weights lose as little efficiency."""

FEWEST_PERIODS = 3
"""Smallest number of periods whose median identifies an outlier."""

_STILL = 1e-12
"""Smallest variance, relative to the largest, and eigenvalue of a correlation that is noise."""
_EXACT = 1e-24
"""Variance of rounding errors, N² or m²."""

_MOST_PAIRS = 20
_ROUNDS = 3
_NEARLY_ALL = 0.95


@dataclass(frozen=True, eq=False)
class NoiseEstimate:
    """Noise of the forces or of the lengths."""

    covariance: Array
    """(6, 6), of one sample."""
    freedom: float
    """Degrees of freedom of the covariance; inf if it was given."""
    source: str = "estimated"
    """``"estimated"`` (scatter between periods), ``"given"`` (robot or run file) or ``"residuals"``
    (of the fit itself: it includes the error of the model)."""
    lines: NoiseLines | None = None
    """Spectrum at the lines of a period; None: the noise counts as white."""
    filter: WhiteningFilter | None = None
    """Whitening filter, applied before weighting; None: the noise is white, or its colour
    unknown."""

    @property
    def variances(self) -> Array:
        """(6,), of one sample, without the share of lines that have no weight."""
        share = 1.0 if self.filter is None else self.filter.count / self.filter.samples
        return np.diag(self.covariance) * share

    @property
    def weights_freedom(self) -> float:
        """Degrees of freedom of the weights (with a filter, of one line); inf if given."""
        return self.freedom if self.filter is None else min(self.freedom, self.filter.freedom)

    @property
    def spectrum_words(self) -> str:
        """Description of the spectrum that the weights assume."""
        if self.lines is None:
            return "taken for white"
        weights = "white" if self.filter is None else self.filter.smoothing
        known = "given" if np.isinf(self.lines.freedom) else "seen between the periods"
        if self.includes_model_error:
            known = "seen in the residuals"
        return f"{known}; weights: {weights}"

    def as_weighted_with(self) -> NoiseEstimate:
        """Return the noise with optimal weights: white, or of the filter's spectrum."""
        if self.filter is None:
            return replace(self, lines=None)
        return replace(self, lines=NoiseLines(self.filter.spectrum, self.filter.samples, np.inf))

    def as_white(self) -> NoiseEstimate:
        """Return white noise of the same covariance, for rows that are not samples of a period."""
        return replace(self, lines=None, filter=None)

    def before_sensors(
        self, response: ComplexArray, samples: int, kept: int | None = None
    ) -> NoiseEstimate:
        """Return the noise of series whose lines are divided by a response, (L, 6).

        The covariance stays that of a recorded sample; the filter takes the values to it. Lines
        after those `kept` have neither weight nor noise.
        """
        white = scaling_filter(self.covariance, samples)
        lines = self.lines or NoiseLines(white.spectrum, samples, self.freedom)
        found = self.filter or replace(white, loss=self.weighting_loss)
        matrices, spectrum = divide_spectrum(lines.matrices, response), white.spectrum.copy()
        spectrum[: len(found.spectrum)] = found.spectrum
        spectrum = divide_spectrum(spectrum, response)
        gain = filter_to(self.covariance, spectrum)[:kept]
        matrices[len(gain) :] = 0.0
        return replace(
            self,
            lines=replace(lines, matrices=matrices),
            filter=replace(found, gain=gain, samples=samples, spectrum=spectrum),
        )

    @property
    def weighting_loss(self) -> float:
        """Ratio of the actual variance of an estimate to that stated by the estimated weights.

        Notes
        -----
        E[Σ̂⁻¹ Σ Σ̂⁻¹] / E[Σ̂⁻¹] of a Wishart matrix: 1 for a covariance that was given.
        """
        if self.filter is not None:
            return self.filter.loss
        if not np.isfinite(self.freedom):
            return 1.0
        channels = len(self.covariance)
        nu = max(self.freedom, channels + 4.0)
        return float(nu * (nu - 1) / ((nu - channels) * (nu - channels - 3)))

    @property
    def includes_model_error(self) -> bool:
        """True if it comes from residuals of the model of these channels."""
        return self.source == "residuals"

    @property
    def still(self) -> Mask:
        """(6,), channels without noise."""
        variances = np.diag(self.covariance)
        return np.asarray(variances <= max(_STILL * np.max(variances), _EXACT))

    @property
    def is_singular(self) -> bool:
        """Whether a channel has no noise, or the noise of others."""
        if np.any(self.still):
            return True
        std = np.sqrt(np.diag(self.covariance))
        correlation = self.covariance / np.multiply.outer(std, std)
        return bool(np.linalg.eigvalsh(correlation)[0] <= _STILL)

    def std_error(self) -> Array:
        """Return the standard error of each element, (6, 6), for normal noise (Wishart)."""
        diagonal = np.diag(self.covariance)
        spread = self.covariance**2 + np.multiply.outer(diagonal, diagonal)
        return np.sqrt(spread / self.freedom)


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Weights of the estimators: Σ of the forces, N², and Δ of the lengths, m²."""

    forces: NoiseEstimate
    lengths: NoiseEstimate

    def as_white(self) -> NoiseModel:
        """Return white noise of the same covariances."""
        return NoiseModel(self.forces.as_white(), self.lengths.as_white())

    @property
    def source(self) -> str:
        """Source of both."""
        forces, lengths = self.forces.source, self.lengths.source
        return forces if forces == lengths else f"forces {forces}, lengths {lengths}"


def scatter_between_periods(values: Array, weights: Array) -> NoiseEstimate:
    """Return the covariance of M ≥ 2 periods, (M, N, 6), about their mean.

    Weights, (M, N), from 0 to 1, reduce the influence of single samples.

    Notes
    -----
    With full weights it has (M − 1) N degrees of freedom. Squares are multiplied by the square of
    their weights: outliers are not noise.
    """
    total = weights.sum(axis=0)
    mean = np.einsum("mn,mnj->nj", weights, values) / total[:, None]
    residuals = (values - mean) * weights[:, :, None]
    flat = residuals.reshape(-1, values.shape[2])
    freedom = float(np.sum(weights**2) - np.count_nonzero(total > 0))
    return NoiseEstimate(flat.T @ flat / freedom, freedom)


def series_basis(phases: Array, harmonics: int) -> Array:
    """Return 1, sin kφ, cos kφ at phases (T,), rad: (T, 2 H + 1)."""
    angle = np.multiply.outer(phases, np.arange(1, harmonics + 1))
    return np.concatenate([np.ones((len(angle), 1)), np.sin(angle), np.cos(angle)], axis=1)


def scatter_about_series(
    times: Array, values: Array, omega: float, harmonics: int, weights: Array | None = None
) -> tuple[NoiseEstimate, Array]:
    """Return the covariance of the scatter about a Fourier series, and the residuals (T, 6).

    Weights, (T,), from 0 to 1, reduce the influence of single samples.

    Notes
    -----
    For periods that are not a whole number of samples, or stamps with jitter: no phase occurs
    twice. The series is long enough to follow the jumps of dry friction to well below the noise.
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
    """Return the number of harmonics for `scatter_about_series`.

    Its coefficients are at most a tenth of the rows, its harmonics less than a third of those that
    the sampling of a period resolves.
    """
    return int(max(1, min(160, rows // 20, rows_per_period // 3)))


def huber_weights(values: Array) -> Array:
    """Return a weight in (0, 1] for every sample of periods, (M, N, 6): (M, N).

    Notes
    -----
    The weight is min(1, (4/d)²), d being the largest distance among the six channels from the
    median over the periods, in robust standard deviations: the square bounds an outlier's influence
    on means and on covariances. The scale comes from differences of periods, with twice the
    variance for any M; distances from the median of few periods would be too small.

    Raises
    ------
    ValueError
        Fewer than three periods: their median does not identify an outlier.
    """
    periods = len(values)
    if periods < FEWEST_PERIODS:
        raise ValueError(f"distances from a median need {FEWEST_PERIODS} periods, not {periods}")
    firsts = range(0, periods, max(1, periods // _MOST_PAIRS))
    differences = np.concatenate([values[i] - values[i - 1] for i in firsts])
    scale = _robust_std(differences) / np.sqrt(2)
    # Standard deviation of a sample's distance from the mean of all others.
    return _weights(values - np.median(values, axis=0), scale * np.sqrt(periods / (periods - 1)))


def series_weights(
    times: Array, values: Array, omega: float, harmonics: int
) -> tuple[NoiseEstimate, Array]:
    """Return the covariance about a Fourier series and a weight for every sample, (T,).

    As `huber_weights`, with distances from the series, which is refitted with the weights.
    """
    weights = np.ones(len(times))
    scatter, residuals = scatter_about_series(times, values, omega, harmonics)
    for _ in range(_ROUNDS):
        weights = _weights(residuals, _robust_std(residuals))
        scatter, residuals = scatter_about_series(times, values, omega, harmonics, weights)
    return scatter, weights


def _robust_std(values: Array) -> Array:
    """Return a standard deviation of each column, (6,), that is robust against a few outliers."""
    size = np.abs(values)
    middle = np.median(size, axis=0) / NORMAL_MEDIAN
    # With more than half exactly zero, as after coarse quantisation, the median is useless.
    most = np.minimum(size, np.quantile(size, _NEARLY_ALL, axis=0))
    return np.where(middle > 0, middle, np.sqrt(np.mean(most**2, axis=0)))


def _weights(distances: Array, scale: Array) -> Array:
    scale = np.where(scale > 0, scale, np.inf)
    distance = np.max(np.abs(distances) / scale, axis=-1)
    return np.minimum(1.0, (_CUT / np.maximum(distance, _CUT)) ** 2)
