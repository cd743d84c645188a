"""The noise of repeated periods, line by line of their DFT.

Contrasts between the periods hold noise and no signal, whatever the model. With Z = rfft(x)/√N of
a contrast x of N samples, the mean of Z Zᴴ over the contrasts is the 6 × 6 spectrum of the noise at
every multiple of the base frequency; it is Σ at all of them when the noise is white (Pintelon and
Schoukens, *System Identification*, 2012, chapter 2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array, ComplexArray
from expdesign.noise.fourier_lines import multiplicity


def contrasts(periods: Array) -> Array:
    """Return pure noise out of repeated periods, (M, N, 6): (M − 1, N, 6).

    Every period less the mean of those before it, scaled to the variance of one sample: no model
    takes part, and the series are independent of each other for independent noise, unlike
    deviations from the mean over all periods.
    """
    before = np.cumsum(periods, axis=0)[:-1]
    number = np.arange(1, len(periods), dtype=float)[:, None, None]
    return (periods[1:] - before / number) * np.sqrt(number / (number + 1))


@dataclass(frozen=True, eq=False)
class NoiseLines:
    """The spectrum of the noise of one sample of six channels at the lines of a period."""

    matrices: ComplexArray
    """(N // 2 + 1, 6, 6), Hermitian; their mean over all N lines is the covariance of a sample."""
    samples: int
    """N, of a period."""
    freedom: float
    """Complex degrees of freedom behind every line: contrasts; inf when it was given."""

    @classmethod
    def of(cls, periods: Array) -> NoiseLines:
        """Estimate it from repeated periods, (M, N, 6), M ≥ 2."""
        noise = contrasts(periods)
        lines = np.fft.rfft(noise, axis=1) / np.sqrt(noise.shape[1])
        matrices = np.einsum("mli,mlj->lij", lines, lines.conj()) / len(noise)
        return cls(matrices, noise.shape[1], float(len(noise)))

    @property
    def covariance(self) -> Array:
        """(6, 6), of one sample: the mean over all N lines."""
        times = multiplicity(self.samples) / self.samples
        return np.asarray(np.einsum("l,lij->ij", times, self.matrices.real))

    def spread(self, columns: ComplexArray) -> tuple[Array, Array]:
        """Return Σ Re vᴴ C v over all N lines for columns v, (L, 6, k): (k, k); its shares.

        These are those of every line in the diagonal, (L, k).
        """
        mixed = np.matmul(self.matrices, columns) * multiplicity(self.samples)[:, None, None]
        flat, other = (each.reshape(-1, columns.shape[2]) for each in (columns, mixed))
        spread = flat.real.T @ other.real + flat.imag.T @ other.imag
        return spread, np.einsum("lik,lik->lk", columns.conj(), mixed).real

    def variance_of(self, shares: Array) -> Array:
        """Return the variance of the sum over the lines of `shares`, (L, k): (k,)."""
        if not np.isfinite(self.freedom):
            return np.zeros(shares.shape[1])
        # The two real lines have half the freedom of the others.
        relative = 2 / multiplicity(self.samples)[:, None] / self.freedom
        return np.sum(shares**2 * relative / (1 + relative), axis=0)
