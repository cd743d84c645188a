"""A filter that makes the noise of a period white, from its spectrum.

Weighting every line of the DFT with the inverse of its own 6 × 6 spectrum C̄ is the same as
filtering measurement and model alike with H, H C̄ Hᴴ = Σ, and weighting with Σ⁻¹ afterwards
(Pintelon and Schoukens, *System Identification*, 2012, chapter 9): every method for
white noise is valid behind the filter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array, ComplexArray
from estimation.processing.smoothing import NoiseLines, smoothed_spectrum
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.noise import lines_of, multiplicity, series_of

_SHOWN = 0.1
"""Share of a jump up to which a filter may still show it."""


@dataclass(frozen=True, eq=False)
class WhiteningFilter:
    """Filters series of one period, circularly; the noise behind it is white."""

    gain: ComplexArray
    """(N // 2 + 1, 6, 6), H, Hermitian."""
    samples: int
    """N."""
    spectrum: ComplexArray
    """(N // 2 + 1, 6, 6), C̄ of one sample's noise."""
    smoothing: str
    """How the spectrum was found, in words."""
    freedom: float
    """Degrees of freedom behind one line's spectrum; inf when it was given."""
    loss: float
    """Variance of an estimate relative to the one stated by weights from this spectrum."""

    def __call__(self, values: Array) -> Array:
        """Return series, (N, 6, …), filtered."""
        return self._through(self.gain, values)

    def undone(self, values: Array) -> Array:
        """Return the series, (N, 6, …), that the filter makes these of."""
        return self._through(np.asarray(np.linalg.inv(self.gain), dtype=np.complex128), values)

    def rows(self, values: Array) -> Array:
        """Return real and imaginary parts of the filtered lines, (2 (N // 2 + 1), 6, …).

        Their inner products are those of the filtered series.
        """
        lines = _moved(self.gain, lines_of(values))
        lines *= np.sqrt(multiplicity(self.samples)).reshape(-1, *(1,) * (lines.ndim - 1))
        return np.concatenate([lines.real, lines.imag])

    def reach(self, std: Array) -> int:
        """Return how far from a jump it is seen, in samples: a quarter of the period at most.

        The jump has the size of the noise's standard deviation, (6,), in one channel, and its
        remainder is the sum of the impulse response from there on. (A share of the response itself
        will not do: with more memory it falls off alike, but is larger.)
        """
        impulse = np.zeros((self.samples, ACTUATORS, ACTUATORS))
        impulse[0] = np.diag(std)
        left = np.abs(np.cumsum(self(impulse)[self.samples // 2 : 0 : -1], axis=0))[::-1]
        shown = np.any(left > _SHOWN * std[:, None], axis=(1, 2))
        return min(int(np.max(np.flatnonzero(shown) + 1, initial=0)), self.samples // 4)

    def _through(self, gain: ComplexArray, values: Array) -> Array:
        return series_of(_moved(gain, lines_of(values)), self.samples)


def _moved(gain: ComplexArray, lines: ComplexArray) -> ComplexArray:
    """Return the gain's product with lines, (L, 6, …), of any further dimensions."""
    flat = np.matmul(gain, lines.reshape(*lines.shape[:2], -1))
    return np.asarray(flat.reshape(lines.shape), dtype=np.complex128)


def filter_to(covariance: Array, spectrum: ComplexArray) -> ComplexArray:
    """Return the Hermitian H with H C̄ Hᴴ = Σ of every line: the one that is nearest to unity."""
    values, vectors = np.linalg.eigh(spectrum)
    root = np.einsum("lij,lj,lkj->lik", vectors, np.sqrt(values), vectors.conj())
    inverse = np.einsum("lij,lj,lkj->lik", vectors, 1 / np.sqrt(values), vectors.conj())
    inner, basis = np.linalg.eigh(root @ covariance @ root)
    middle = np.einsum("lij,lj,lkj->lik", basis, np.sqrt(inner), basis.conj())
    return np.asarray(inverse @ middle @ inverse)


def given_filter(covariance: Array, spectrum: ComplexArray, samples: int) -> WhiteningFilter:
    """Return the filter of noise whose spectrum at the lines of a period is known."""
    gain = filter_to(covariance, spectrum)
    return WhiteningFilter(gain, samples, spectrum, "the spectrum given", freedom=np.inf, loss=1.0)


def estimated_filter(
    lines: NoiseLines, covariance: Array, *, always: bool = False
) -> WhiteningFilter | None:
    """Return the filter for measured lines; None if white noise is not rejected.

    With `always` the best one is returned even so; None is then left for periods of too few
    samples to smooth over.
    """
    found = smoothed_spectrum(lines, covariance, always=always)
    if found is None:
        return None
    gain, freedom = filter_to(covariance, found.matrices), found.freedom
    return WhiteningFilter(
        gain, lines.samples, found.matrices, found.words, 2 * freedom, _loss(freedom)
    )


def _loss(freedom: float, channels: int = ACTUATORS) -> float:
    """Return E[C̄⁻¹ C C̄⁻¹] / E[C̄⁻¹] of a complex Wishart matrix C̄: 1 for endless freedom."""
    if np.isinf(freedom):
        return 1.0
    # Fewer leave no mean of the inverse.
    nu = max(freedom, channels + 2.0)
    return nu**2 / ((nu - channels) ** 2 - 1)
