"""Hum of the mains in repeated periods: sinusoids at 50 or 60 Hz and their multiples.

The mean over the periods, and with it the motion, is removed first. A sinusoid of frequency f
keeps the share g = 1 − |D|² of its power, D being the mean of its phase factors over the periods;
at a multiple of the base frequency g = 0, and no contrast between periods shows it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy
from scipy.optimize import minimize_scalar

from constraints.arrays import Array, ComplexArray

MAINS = (50.0, 60.0)
"""Hz."""
HUM = 0.001
"""Level of the search over all frequencies."""

_MULTIPLES = 10
_WANDER = 1e-3
"""Largest relative deviation of the mains frequency."""
_OVERSAMPLING = 4
_SEEN = 0.2
"""Smallest visible share of a sinusoid's power."""
_NEAR, _FAR = 8, 24
"""Range of neighbouring lines, for the spectrum without hum."""


@dataclass(frozen=True, eq=False)
class HumLine:
    """A sinusoid in six channels."""

    frequency: float
    """Hz."""
    coefficients: ComplexArray
    """(6,), c of Re c exp(2πi f t), t from the first sample."""
    amplitudes: Array
    """(6,), corrected for the noise, N or m."""

    def values(self, samples: int, step: float) -> Array:
        """Return the sinusoid at the samples of a recording, (samples, 6)."""
        turns = np.exp(2j * np.pi * self.frequency * step * np.arange(samples))
        return np.multiply.outer(turns, self.coefficients).real


@dataclass(frozen=True, eq=False)
class HumSearch:
    """Detected hum, and the frequencies at which hum is invisible."""

    lines: tuple[HumLine, ...]
    """In the order of their frequencies."""
    hidden: tuple[float, ...]
    """Multiples of the mains, Hz, too close to a multiple of the base frequency to be visible."""
    p: float
    """Smallest p, corrected for all frequencies; 1 without any."""

    def values(self, samples: int, step: float) -> Array:
        """Return the detected hum at the samples of a recording, (samples, 6)."""
        return sum((line.values(samples, step) for line in self.lines), np.zeros((samples, 1)))


def mains_frequencies(sampling: float, multiples: int = _MULTIPLES) -> Iterator[float]:
    """Yield the multiples of the mains up to half of the sampling frequency, Hz, ascending."""
    every = {mains * k for mains in MAINS for k in range(1, multiples + 1)}
    yield from sorted(frequency for frequency in every if 2 * frequency < sampling)


def find_hum(periods: Array, step: float, spectrum: ComplexArray, freedom: float) -> HumSearch:
    """Search repeated periods for a hum of the mains.

    Parameters
    ----------
    periods : (M, N, 6)
        Repeated periods, M ≥ 2.
    step : float
        Time between two samples, s.
    spectrum : (N // 2 + 1, 6, 6)
        Smoothed spectrum of one sample's noise at the lines of a period.
    freedom : float
        Degrees of freedom of the spectrum, finite.
    """
    count, samples, channels = periods.shape
    rest = (periods - periods.mean(axis=0)).reshape(count * samples, channels)
    hidden, tried, largest = [], 0, 0.0
    peaks: list[tuple[float, float, _Periodogram]] = []
    for centre in mains_frequencies(1 / step):
        grid = _grid(centre, count * samples * step)
        left = _share_left(grid * samples * step, count)
        if left[len(left) // 2] < _SEEN:
            hidden.append(centre)
        grid = grid[left >= _SEEN]
        if not len(grid):
            continue
        tried += len(grid)
        local = _Periodogram(rest, samples, _background(spectrum, centre * samples * step))
        statistic = local.statistic(grid * step)
        top = int(np.argmax(statistic))
        peaks.append((float(statistic[top]), float(grid[top]), local))
        largest = max(largest, float(statistic[top]))
    freedoms = (2 * channels, freedom)
    critical = float(scipy.stats.f.isf(HUM / max(tried, 1), *freedoms))
    p = min(1.0, tried * float(scipy.stats.f.sf(largest, *freedoms))) if tried else 1.0
    reach = 1 / (_OVERSAMPLING * count * samples * step)
    lines = tuple(
        local.line(frequency, reach, step) for value, frequency, local in peaks if value > critical
    )
    return HumSearch(lines, tuple(hidden), p)


@dataclass(frozen=True, eq=False)
class _Periodogram:
    """Sinusoids in the deviations from the mean period, and their significance."""

    rest: Array
    """(M N, 6)."""
    samples: int
    """N."""
    spectrum: ComplexArray
    """(6, 6), of the noise at neighbouring frequencies."""

    def coefficients(self, cycles: Array) -> ComplexArray:
        """Return c of Re c exp(2πi n cycles) at sample n, (K, 6), of cycles per sample, (K,)."""
        turns = np.exp(-2j * np.pi * np.multiply.outer(cycles, np.arange(len(self.rest))))
        left = self._left(cycles)
        return np.asarray(2 * (turns @ self.rest) / (len(self.rest) * left)[:, None])

    def statistic(self, cycles: Array) -> Array:
        """Return F of all channels together, (K,)."""
        found = self.coefficients(cycles)
        inverse = np.linalg.inv(self.spectrum)
        power = np.einsum("ki,ij,kj->k", found.conj(), inverse, found).real
        return power * len(self.rest) * self._left(cycles) / 4 / self.rest.shape[1]

    def line(self, frequency: float, reach: float, step: float) -> HumLine:
        """Return the sinusoid with the largest statistic at most `reach` from a frequency, Hz."""
        best = minimize_scalar(
            lambda f: -float(self.statistic(np.array([f * step]))[0]),
            bounds=(frequency - reach, frequency + reach),
            method="bounded",
        )
        cycles = np.array([best.x * step])
        found = self.coefficients(cycles)[0]
        noise = 4 * np.diag(self.spectrum).real / (len(self.rest) * self._left(cycles))
        amplitudes = np.sqrt(np.maximum(np.abs(found) ** 2 - noise, 0.0))
        return HumLine(float(best.x), found, amplitudes)

    def _left(self, cycles: Array) -> Array:
        return _share_left(cycles * self.samples, len(self.rest) // self.samples)


def _grid(centre: float, duration: float) -> Array:
    """Return the resolved frequencies around a multiple of the mains frequency, Hz."""
    steps = int(np.ceil(_WANDER * centre * duration * _OVERSAMPLING))
    return centre + np.arange(-steps, steps + 1) / (_OVERSAMPLING * duration)


def _share_left(turns: Array, count: int) -> Array:
    """Return 1 − |mean over `count` periods of the phase factor|², of turns per period, (K,)."""
    factors = np.exp(2j * np.pi * np.multiply.outer(turns, np.arange(count)))
    return 1 - np.abs(factors.mean(axis=1)) ** 2


def _background(spectrum: ComplexArray, line: float) -> ComplexArray:
    """Return the mean spectrum of the neighbours of a line, (6, 6)."""
    distance = np.abs(np.arange(len(spectrum)) - line)
    chosen = (distance >= _NEAR) & (distance <= _FAR)
    if not np.any(chosen):
        chosen = distance == np.max(distance)
    return np.asarray(spectrum[chosen].mean(axis=0))
