"""Coloured noise as a periodic motion meets it: at the multiples of its frequency, and only there.

With Ã_j = rfft(A)/√n over n samples of one period, w_j = 2 (1 at j = 0 and n/2) and the spectrum
S_j of the noise at j ω/2π, per sample of the experiment,

    F = Σ_j w_j Re(Ã_jᴴ S_j⁻¹ Ã_j)

is the information of one period (Pintelon and Schoukens, *System Identification*, 2012, chapter 9);
for S_j = Σ it is Σ_t A_tᵀ Σ⁻¹ A_t. Of n samples that are fewer or more than the experiment's N in
a period it is what n samples of that noise would tell: A's Fourier coefficients do not depend on
n, so F grows with n as it does with white noise, and n F / N is the same for every n that resolves
A.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array, ComplexArray
from expdesign.noise.fourier_lines import lines_of, multiplicity, series_of
from expdesign.noise.spectrum import NoiseSpectrum


@dataclass(frozen=True, eq=False)
class PeriodicNoise:
    """The noise of an experiment, whose samples a motion of any frequency meets."""

    spectrum: NoiseSpectrum
    """Of the forces, N²."""
    sampling: float
    """Hz."""
    periods: float
    """Of the whole record, which decides how narrow a hum is."""

    def information(self, regressors: Array, omega: float) -> Array:
        """Return F of one period, (m, m), of A at n equal phases, (n, 6, m); ω in rad/s."""
        lines = lines_of(regressors)
        matrices, _ = self._at(omega, len(lines))
        white = np.linalg.solve(np.linalg.cholesky(matrices), lines)
        white *= np.sqrt(multiplicity(len(regressors)))[:, None, None]
        flat = white.reshape(-1, white.shape[2])
        stacked = np.concatenate([flat.real, flat.imag])
        return stacked.T @ stacked

    def weighted(self, regressors: Array, omega: float) -> Array:
        """Return what makes F of A: (n, 6, m) with Σ_t A_tᵀ (·)_t = F, and dF as twice as much."""
        lines = lines_of(regressors)
        matrices, _ = self._at(omega, len(lines))
        weighted: ComplexArray = np.linalg.solve(matrices, lines).astype(np.complex128, copy=False)
        return series_of(weighted, len(regressors))

    def spread(self, regressors: Array, omega: float) -> Array:
        """Return the covariance of Σ_t A_tᵀ η_t over one period, (m, m): unweighted sums of noise.

        It is what makes the covariance of least squares.
        """
        lines = lines_of(regressors)
        matrices, _ = self._at(omega, len(lines))
        mixed = np.matmul(matrices, lines) * multiplicity(len(regressors))[:, None, None]
        flat = lines.reshape(-1, lines.shape[2])
        found = (flat.conj().T @ mixed.reshape(flat.shape)).real
        return (found + found.T) / 2

    def slope(self, weighted: Array, omega: float) -> Array:
        """Return ∂F/∂ω, (m, m), of A as it is: the lines move over the spectrum.

        `weighted` is what the method of this name returns.
        """
        lines = lines_of(weighted)
        _, by_omega = self._at(omega, len(lines))
        mixed = np.matmul(by_omega, lines) * multiplicity(len(weighted))[:, None, None]
        flat = lines.reshape(-1, lines.shape[2])
        change = -(flat.conj().T @ mixed.reshape(flat.shape)).real
        return (change + change.T) / 2

    def _at(self, omega: float, count: int) -> tuple[ComplexArray, ComplexArray]:
        """Return S at the multiples 0 … count − 1 of ω, (count, 6, 6), and its derivative to ω."""
        base = omega / (2 * np.pi)
        samples = self.periods * self.sampling / base
        found = self.spectrum.harmonics(base, count, self.sampling, samples)
        slope = found.by_frequency - found.by_samples * (samples / base)
        return found.value, slope / (2 * np.pi)
