"""The spectrum of sampled noise: a covariance of one sample, spread over the frequencies.

With Z_j = rfft(x)/√N of N samples x, (N, 6), at the frequency f_j = j/N of the sampling,
E Z_j Z_jᴴ = S(f_j), Hermitian; the mean of S over all N lines is the covariance of one sample.
White noise has S = Σ at every frequency. It is the spectrum of what was sampled: whatever an
analogue noise has above half of the sampling is folded into it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from constraints.arrays import Array, ComplexArray

Hermitian = ComplexArray
"""Complex Hermitian matrices, (L, 6, 6)."""


class SpectralValues(NamedTuple):
    """A spectrum at L frequencies and its derivatives, (L, 6, 6) each."""

    value: Hermitian
    """S, the square of the channels' unit."""
    by_frequency: Hermitian
    """∂S/∂f, per Hz."""
    by_samples: Hermitian
    """∂S/∂n for the number n of samples of the record, which hum lines depend on."""


class SpectralPart(Protocol):
    """A summand of a spectrum; the parts are independent of each other."""

    @property
    def covariance(self) -> Array:
        """(6, 6), of one sample."""

    @property
    def highest(self) -> float:
        """Largest sampling frequency for which the part is known, Hz; infinite for most."""

    def values(self, frequencies: Array, sampling: float, samples: float) -> SpectralValues:
        """Return S and its derivatives; the arguments are those of `NoiseSpectrum.at`."""


@dataclass(frozen=True, eq=False)
class NoiseSpectrum:
    """Spectrum of the noise of six channels: forces in N, or lengths in m."""

    parts: tuple[SpectralPart, ...]

    @property
    def covariance(self) -> Array:
        """(6, 6), of one sample: Σ in N², or Δ in m²."""
        return np.sum([part.covariance for part in self.parts], axis=0)

    @property
    def highest(self) -> float:
        """Largest sampling frequency for which the spectrum is known, Hz."""
        return min(part.highest for part in self.parts)

    def covers(self, sampling: float) -> bool:
        """Tell whether the spectrum is known up to half of a sampling, Hz."""
        return sampling <= self.highest * (1 + 1e-9)

    def at(self, frequencies: Array, sampling: float, samples: float) -> Hermitian:
        """Return S, (L, 6, 6), the square of the channels' unit.

        Parameters
        ----------
        frequencies : (L,)
            Hz, of either sign.
        sampling : float
            Of the samples, Hz.
        samples : float
            Of the whole record: a hum is as narrow a line as the record resolves, and as high.

        Raises
        ------
        ValueError
            The spectrum is not known up to half of the sampling.
        """
        return self.values(frequencies, sampling, samples).value

    def values(self, frequencies: Array, sampling: float, samples: float) -> SpectralValues:
        """Return S and its derivatives, as `at`."""
        if not self.covers(sampling):
            raise ValueError(
                f"the spectrum of the noise is known for a sampling of {self.highest:g} Hz at "
                f"most, not of {sampling:g} Hz"
            )
        found = [part.values(frequencies, sampling, samples) for part in self.parts]
        return SpectralValues(*(np.sum(each, axis=0) for each in zip(*found, strict=True)))

    def harmonics(self, base: float, count: int, sampling: float, samples: float) -> SpectralValues:
        """Return S at the multiples 0 … count − 1 of a base frequency, Hz.

        `by_frequency` is then the derivative to the base frequency. The number of samples is taken
        as it is; whoever changes it with the frequency adds `by_samples`.
        """
        orders = np.arange(count, dtype=np.float64)
        found = self.values(orders * base, sampling, samples)
        return found._replace(by_frequency=found.by_frequency * orders[:, None, None])
