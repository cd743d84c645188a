"""Noise whose density is known at some frequencies, as a measurement shows it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as sla

from constraints.arrays import Array
from expdesign.noise.spectrum import Hermitian, SpectralValues

_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Tabulated:
    """A density between whose frequencies one interpolates linearly."""

    frequencies: Array
    """(K,), Hz, increasing, from 0 to half of the sampling that the density was measured at."""
    density: Hermitian
    """(K, 6, 6), one-sided, the square of the channels' unit per Hz, positive definite: its real
    part integrates to the covariance of one sample."""

    @property
    def covariance(self) -> Array:
        """(6, 6), of one sample."""
        steps = np.diff(self.frequencies)[:, None, None]
        return np.sum((self.density[1:] + self.density[:-1]).real * steps / 2, axis=0)

    @property
    def highest(self) -> float:
        """Sampling that the density was measured at, Hz; more slowly sampled, it is folded."""
        return 2 * float(self.frequencies[-1])

    def transformed(self, matrix: Array) -> Tabulated:
        """Return the density of T x for a matrix T, (6, 6)."""
        return replace(self, density=matrix @ self.density @ matrix.T)

    def values(self, frequencies: Array, sampling: float, samples: float) -> SpectralValues:
        """Return S, folded at half of the sampling, and its derivatives."""
        del samples
        shape = (len(frequencies), *self.density.shape[1:])
        value: Hermitian = np.zeros(shape, dtype=np.complex128)
        slope: Hermitian = np.zeros(shape, dtype=np.complex128)
        last = float(self.frequencies[-1])
        if abs(sampling - 2 * last) <= _ROUNDING * sampling:
            last = sampling / 2
        folded = frequencies - sampling * np.round(frequencies / sampling)
        folds = int(np.ceil(last / sampling + 0.5))
        for fold in range(-folds, folds + 1):
            place = folded + fold * sampling
            # Both ends are the same frequency when nothing is folded: one of them counts.
            inside = (place >= -last) & (place < last)
            level, rise = self._interpolated(np.abs(place[inside]))
            back = (place[inside] < 0)[:, None, None]
            value[inside] += np.where(back, level.conj(), level)
            slope[inside] += np.where(back, -rise.conj(), rise)
        value *= sampling / 2
        slope *= sampling / 2
        return SpectralValues(value, slope, np.zeros_like(value))

    def _interpolated(self, frequencies: Array) -> tuple[Hermitian, Hermitian]:
        """Return density and its slope, (L, 6, 6) each."""
        knots = self.frequencies
        left = np.clip(np.searchsorted(knots, frequencies, side="right") - 1, 0, len(knots) - 2)
        rise = np.diff(self.density, axis=0) / np.diff(knots)[:, None, None]
        step = (frequencies - knots[left])[:, None, None]
        return self.density[left] + rise[left] * step, rise[left]


def between(own: Array, wanted: Array) -> Array:
    """Return the symmetric positive definite T with T C T = Σ, (6, 6), for two covariances.

    It changes the channels least: a diagonal rescaling where that is enough, the identity where
    nothing is to be changed.
    """
    root = _root(own)
    inverse = np.linalg.inv(root)
    matrix = inverse @ _root(root @ wanted @ root) @ inverse
    return (matrix + matrix.T) / 2


def _root(matrix: Array) -> Array:
    values, vectors = sla.eigh((matrix + matrix.T) / 2)
    return (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
