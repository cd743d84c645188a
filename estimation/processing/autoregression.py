"""Noise with memory from the residuals of a fit: autoregressive models and their filters.

Each channel is an autoregressive process, y(t) = Σ a_k y(t − k) + e(t), and the prediction errors e
of the six channels are correlated. The residuals of a fit contain less than the noise: the fit took
a share of it. By the expectation of the noise given the residuals, E[ε εᵀ] = r rᵀ + U F⁻¹ Uᵀ, the
sums of squares are those of restricted maximum likelihood (Harville, JASA 72, 1977).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array, ComplexArray, Mask
from estimation.processing.noise import NoiseEstimate
from estimation.processing.spectrum import NoiseLines, WhiteningFilter, filter_to
from expdesign.configuration.estimate import SpectrumOrigin

_ORDERS = (0, 1, 2, 4, 8, 16)
_CLEARLY_BETTER = 10.0
"""Gain in twice the log likelihood, less two per coefficient, below which noise counts as white."""
KNOWN = 0.5
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
    known = np.asarray(certainty >= KNOWN)
    orders = [p for p in _ORDERS if np.count_nonzero(_known_windows(known, p)) >= 8 * p]
    white, *others = _fit_models(values, known, orders)
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
    lines = AutoregressiveLines(spectrum, count, freedom, coefficients=best.coefficients)
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
        errors=best.errors,
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


def _fit_models(values: Array, known: Mask, orders: Sequence[int]) -> Iterator[_Model]:
    """Yield the models of ascending orders that predict the values, (N, 6, 1 + k), best.

    Only errors count whose samples are all known: the weights of the fit contain no others. The
    errors of predictions in both directions have the least sum of squares (Burg, 1975), which
    keeps the models stable. All orders are compared by the same errors.
    """
    forward = backward = values
    rows, most = known, orders[-1]
    alike = _known_windows(known, most)
    coefficients = np.ones((1, values.shape[1]))
    for order in range(most + 1):
        if order:
            forward, backward = forward[1:], backward[:-1]
            rows = _known_windows(known, order)
            ahead, back = forward[rows], backward[rows]
            product, squares = (
                np.einsum("tjk,tjk->j", *pair) for pair in ((ahead, back), (ahead, ahead))
            )
            squares = squares + np.einsum("tjk,tjk->j", back, back)
            share = np.divide(-2 * product, squares, out=np.zeros_like(product), where=squares > 0)
            step = share[:, None]
            forward, backward = forward + step * backward, backward + step * forward
            longer = np.pad(coefficients, ((0, 1), (0, 0)))
            coefficients = longer + share * longer[::-1]
        if order in orders:
            _, logarithm = np.linalg.slogdet(_mean_product(forward[most - order :][alike]))
            criterion = np.count_nonzero(alike) * logarithm + 2 * order * values.shape[1]
            yield _Model(coefficients, _mean_product(forward[rows]), float(criterion))


def _known_windows(known: Mask, order: int) -> Mask:
    """Return whether a sample and those before it, so many, are known: (N − order,)."""
    windows = np.lib.stride_tricks.sliding_window_view(known, min(order, len(known) - 1) + 1)
    return np.asarray(windows.all(axis=1))


def _mean_product(values: Array) -> Array:
    """Return the covariance of values, (N, 6, k): (6, 6)."""
    return np.asarray(np.einsum("tik,tjk->ij", values, values) / max(len(values), 1))


def filter_series(coefficients: Array, values: Array) -> Array:
    """Return Σ a_k y(t − k) of series, (N, 6, …), that are zero before they begin."""
    shape = (values.shape[1], *(1,) * (values.ndim - 2))
    result = values * coefficients[0].reshape(shape)
    for lag in range(1, len(coefficients)):
        result[lag:] += values[:-lag] * coefficients[lag].reshape(shape)
    return np.asarray(result)


@dataclass(frozen=True, eq=False, kw_only=True)
class AutoregressiveLines(NoiseLines):
    """Spectrum of autoregressive channels; its freedom is that of their prediction errors."""

    coefficients: Array
    """(p + 1, 6)."""

    def _variance(self, shares: ComplexArray) -> Array:
        """Return the variance of a sum over lines and channels, (L, 6, k): (k,).

        The covariance of the coefficients of channels i and j is σ_ij Γ_i⁻¹ Γ_ij Γ_j⁻¹ over the
        number of samples, with the covariances σ of the prediction errors and Γ of past samples
        (for one channel Mann and Wald, Econometrica 11, 1943). Like that of a line the variance is
        at most the square of the sum, however long the memory is.
        """
        square = np.sum(shares.real, axis=(0, 1)) ** 2
        result = 2 * square / self.freedom
        order = len(self.coefficients) - 1
        response = np.fft.rfft(self.coefficients, self.samples, axis=0)
        frequencies = np.arange(len(self.matrices)) / self.samples
        past = np.exp(-2j * np.pi * np.outer(np.arange(1, order + 1), frequencies))
        slope = 2 * np.einsum("pl,li,lik->ipk", past, 1 / response, shares, optimize=True).real
        errors = (self.matrices[0] * np.multiply.outer(response[0], response[0].conj())).real
        # Channel i, k samples ago, with channel j, l samples ago: it depends on l − k, of any sign.
        lags = np.arange(order)
        memory = np.fft.irfft(self.matrices, self.samples, axis=0)[lags - lags[:, None]]
        moved = np.linalg.solve(np.einsum("klii->ikl", memory), slope)
        terms = "ij,ipk,pqij,jqk->k"
        result += np.einsum(terms, errors, moved, memory, moved, optimize=True) / self.freedom
        return np.asarray(result * square / np.maximum(square + result, np.finfo(float).tiny))


@dataclass(frozen=True, eq=False, kw_only=True)
class AutoregressiveFilter(WhiteningFilter):
    """Prediction errors of a recording without a period, scaled to the noise's covariance.

    The first rows, whose past is not known, are zero. Its inherited gain is that of a circular
    filter with the same spectrum.
    """

    coefficients: Array
    """(p + 1, 6)."""
    errors: Array
    """(6, 6), covariance of the prediction errors."""
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
