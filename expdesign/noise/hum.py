"""Hum: sinusoids of known frequencies, such as 50 Hz and its multiples from the mains.

The phase is random in every record and continuous through it. In a record of n samples
such a line is as narrow as the record resolves. Its shape is that of noise which remembers its
phase for the record's length (a Lorentzian folded at the sampling): height and content are those of
the sinusoid, and it has no zeros beside it, since no hum keeps its frequency exactly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from constraints.arrays import Array
from expdesign.noise.spectrum import SpectralValues


@dataclass(frozen=True, eq=False)
class Hum:
    """Lines at some frequencies."""

    frequencies: Array
    """(K,), Hz."""
    variances: Array
    """(K, 6, 6), covariance of one sample of each line: half of the amplitudes squared on the
    diagonal where the channels' phases have nothing to do with each other."""

    @classmethod
    def of(cls, frequencies: Array, amplitudes: Array) -> Hum:
        """Return lines of these amplitudes, (K, 6), with independent phases."""
        return cls(frequencies, np.eye(amplitudes.shape[1]) * amplitudes[:, None, :] ** 2 / 2)

    @property
    def covariance(self) -> Array:
        """(6, 6), of one sample."""
        return np.sum(self.variances, axis=0)

    @property
    def highest(self) -> float:
        """Every sampling will do."""
        return np.inf

    def transformed(self, matrix: Array) -> Hum:
        """Return the lines of T x for a matrix T, (6, 6)."""
        return replace(self, variances=matrix @ self.variances @ matrix.T)

    def values(self, frequencies: Array, sampling: float, samples: float) -> SpectralValues:
        """Return S and its derivatives."""
        level = by_angle = by_samples = np.zeros((len(frequencies), len(self.frequencies)))
        for sign in (-1.0, 1.0):
            angle = 2 * np.pi * (frequencies[:, None] + sign * self.frequencies) / sampling
            one, angle_slope, samples_slope = _line(angle, samples)
            level, by_angle = level + one / 2, by_angle + angle_slope / 2
            by_samples = by_samples + samples_slope / 2
        weighted = (
            np.tensordot(each, self.variances, axes=(1, 0)).astype(complex)
            for each in (level, by_angle * 2 * np.pi / sampling, by_samples)
        )
        return SpectralValues(*weighted)


def _line(angle: Array, samples: float) -> tuple[Array, Array, Array]:
    """Return Poisson's kernel with r = exp(−2/n), and its derivatives to angle and n.

    Its mean over a turn is one, its height n for a large n.
    """
    r = float(np.exp(-2 / samples))
    content, cosine = -float(np.expm1(-4 / samples)), np.cos(angle)
    below = float(np.expm1(-2 / samples)) ** 2 + 4 * r * np.sin(angle / 2) ** 2
    by_angle = -content * 2 * r * np.sin(angle) / below**2
    by_r = (-2 * r * below + content * 2 * (cosine - r)) / below**2
    return content / below, by_angle, by_r * r * 2 / samples**2
