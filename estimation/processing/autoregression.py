"""Noise with memory from the residuals of a fit: autoregressive models and their filters.

Each channel is an autoregressive process, y(t) = Σ a_k y(t − k) + e(t), and the prediction errors e
of the six channels are correlated. The residuals of a fit contain less than the noise: the fit took
a share of it. By the expectation of the noise given the residuals, E[ε εᵀ] = r rᵀ + U F⁻¹ Uᵀ, the
moments are those of restricted maximum likelihood (Harville, JASA 72, 1977).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as sla

from constraints.arrays import Array, Mask
from estimation.processing.noise import NoiseEstimate
from estimation.processing.spectrum import NoiseLines, WhiteningFilter, filter_to
from expdesign.configuration.estimate import SpectrumOrigin

_ORDERS = (0, 1, 2, 4, 8, 16)
_CLEARLY_BETTER = 10.0
"""Gain in twice the log likelihood, less two per coefficient, below which noise counts as white."""
_KNOWN = 0.5
"""Least certainty of a sample that shows the noise."""


def autoregressive_noise(
    residuals: Array,
    fitted: Array,
    certainty: Array,
    origin: SpectrumOrigin = "auto",
    *,
    always: bool = False,
) -> NoiseEstimate:
    """Return the noise of a recording from the residuals of a fit.

    The order of the model has the least information criterion (Akaike).

    Parameters
    ----------
    residuals : (N, 6)
        Measured minus predicted.
    fitted : (N, 6, k)
        Columns of the fitted unknowns times a root of their covariance.
    certainty : (N,)
        Weights, 0 to 1: samples below a half, whose errors are not noise, are left out.
    origin : SpectrumOrigin
        Model in the weights: ``white`` is white whatever the noise is.
    always : bool
        Have a filter, with the weights of the samples, for white noise, too.
    """
    values = np.concatenate([residuals[:, :, None], fitted], axis=2)
    known = np.asarray(certainty >= _KNOWN)
    models = [_Model.of(values, known, order) for order in _ORDERS if 8 * order < len(residuals)]
    white, *others = models
    best = min(others, key=lambda each: each.criterion, default=white)
    if origin != "estimated" and white.criterion < best.criterion + _CLEARLY_BETTER:
        best = white
    if origin == "white" and always:
        best = white
    freedom = max(float(np.count_nonzero(known)) - fitted.shape[2] / residuals.shape[1], 1.0)
    if best is white and not always:
        return NoiseEstimate(white.errors, freedom, "residuals")
    count = len(residuals)
    response = np.fft.rfft(best.coefficients, count, axis=0)
    spectrum = best.errors / response[:, :, None] / response.conj()[:, None, :]
    lines = NoiseLines(spectrum, count, np.inf)
    covariance = lines.covariance
    if origin == "white" and not always:
        return NoiseEstimate(covariance, freedom, "residuals", lines)
    whitening_filter = AutoregressiveFilter(
        gain=filter_to(covariance, spectrum),
        samples=count,
        spectrum=spectrum,
        smoothing=f"autoregressive model of order {len(best.coefficients) - 1}",
        freedom=np.inf,
        loss=1.0,
        coefficients=best.coefficients,
        root=filter_to(covariance, best.errors[None].astype(np.complex128))[0].real,
        certainty=certainty,
    )
    return NoiseEstimate(covariance, freedom, "residuals", lines, whitening_filter)


@dataclass(frozen=True, eq=False)
class _Model:
    coefficients: Array
    """(p + 1, 6), from samples to prediction errors."""
    errors: Array
    """(6, 6), covariance of the prediction errors."""
    criterion: float

    @classmethod
    def of(cls, values: Array, known: Mask, order: int) -> _Model:
        """Fit a model to the moments of the values, (N, 6, 1 + k), by Yule and Walker."""
        count, channels = values.shape[:2]
        masked = values * known[:, None, None]
        moments = [
            np.einsum("tjk,tjk->j", masked[lag:], masked[: count - lag]) for lag in range(order + 1)
        ]
        pairs = [np.count_nonzero(known[lag:] & known[: count - lag]) for lag in range(order + 1)]
        # Less the bias of missing pairs, but not that of the ends, which keeps the model stable.
        ends = 1 - np.arange(order + 1) / count
        share = np.array(pairs) / pairs[0] / ends
        correlation = np.array(moments) / np.maximum(share, 1 / count)[:, None]
        coefficients = np.zeros((order + 1, channels))
        coefficients[0] = 1.0
        for j, own in enumerate(correlation.T if order else ()):
            coefficients[1:, j] = -sla.solve_toeplitz(own[:-1], own[1:])
        rows = filter_series(coefficients, values)[order:]
        whole = np.min([known[order - lag : count - lag] for lag in range(order + 1)], axis=0)
        rows = rows[whole > 0]
        errors = np.einsum("tik,tjk->ij", rows, rows) / len(rows)
        _, logarithm = np.linalg.slogdet(errors)
        return cls(coefficients, errors, pairs[0] * float(logarithm) + 2 * order * channels)


def filter_series(coefficients: Array, values: Array) -> Array:
    """Return Σ a_k y(t − k) of series, (N, 6, …), that are zero before they begin."""
    shape = (values.shape[1], *(1,) * (values.ndim - 2))
    result = values * coefficients[0].reshape(shape)
    for lag in range(1, len(coefficients)):
        result[lag:] += values[:-lag] * coefficients[lag].reshape(shape)
    return np.asarray(result)


@dataclass(frozen=True, eq=False, kw_only=True)
class AutoregressiveFilter(WhiteningFilter):
    """Prediction errors of a recording without a period, scaled to the noise's covariance.

    The first rows, whose past is not known, are zero. Its inherited gain is that of a circular
    filter with the same spectrum.
    """

    coefficients: Array
    """(p + 1, 6)."""
    root: Array
    """(6, 6), symmetric, from prediction errors to noise of the covariance Σ."""
    certainty: Array
    """(N,), weights of the samples."""

    @property
    def lag(self) -> int:
        """Samples before a sample that its filtered value depends on, p."""
        return len(self.coefficients) - 1

    @property
    def _row_weights(self) -> Array:
        """(N,), roots of the weights of the filtered rows, of the least certain sample in each."""
        lag, count = self.lag, self.samples
        weights = self.certainty.copy()
        for past in range(1, lag + 1):
            weights[past:] = np.minimum(weights[past:], self.certainty[: count - past])
        weights[:lag] = 0.0
        return np.sqrt(weights)

    def __call__(self, values: Array) -> Array:
        """Return the filtered series, (N, 6, …)."""
        return self.block(values, slice(0, len(values)), 0)

    def block(self, values: Array, rows: slice, before: int) -> Array:
        """Return filtered rows, (n, 6, …), from values that have `before` more rows, up to p."""
        filtered = filter_series(self.coefficients, values)[before:]
        weights = self._row_weights[rows]
        return self._scaled(filtered) * weights.reshape(-1, *(1,) * (values.ndim - 1))

    def adjoint(self, values: Array) -> Array:
        """Return Fᵀ y of series, (N, 6, …)."""
        weighted = values * self._row_weights.reshape(-1, *(1,) * (values.ndim - 1))
        return filter_series(self.coefficients, self._scaled(weighted)[::-1])[::-1]

    def rows(self, values: Array) -> Array:
        """Return the filtered series."""
        return self(values)

    def _scaled(self, values: Array) -> Array:
        flat = np.matmul(self.root, values.reshape(*values.shape[:2], -1))
        return np.asarray(flat.reshape(values.shape))
