"""Noise in a band about one frequency: a resonance of the frame, a loop that nearly oscillates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from expdesign.noise.spectrum import SpectralValues

_HALF_MAXIMUM = 2 * np.sqrt(2 * np.log(2))
"""Full width at half maximum of a normal density, over its standard deviation."""

_REACH = 9.0
"""Standard deviations beyond which there is nothing of it in double precision."""


@dataclass(frozen=True, eq=False)
class Band:
    """A density that falls off on both sides of a frequency like a normal distribution."""

    variance: Array
    """(6, 6), covariance of one sample of it."""
    frequency: float
    """Where it is largest, Hz."""
    width: float
    """Where it has half of that, from one side to the other, Hz."""

    @property
    def covariance(self) -> Array:
        """(6, 6), of one sample."""
        return self.variance

    @property
    def highest(self) -> float:
        """Every sampling will do."""
        return np.inf

    def values(self, frequencies: Array, sampling: float, samples: float) -> SpectralValues:
        """Return S, folded at half of the sampling, and its derivatives."""
        del samples
        spread = self.width / _HALF_MAXIMUM
        height = sampling / (2 * spread * np.sqrt(2 * np.pi))
        folds = int(np.ceil(_REACH * spread / sampling))
        level, slope = np.zeros(len(frequencies)), np.zeros(len(frequencies))
        for sign in (-1.0, 1.0):
            off = frequencies + sign * self.frequency
            off = off - sampling * np.round(off / sampling)
            for fold in range(-folds, folds + 1):
                far = (off + fold * sampling) / spread
                one = height * np.exp(-(far**2) / 2)
                level, slope = level + one, slope - one * far / spread
        value, rise = (
            np.multiply.outer(each, self.variance).astype(complex) for each in (level, slope)
        )
        return SpectralValues(value, rise, np.zeros_like(value))
