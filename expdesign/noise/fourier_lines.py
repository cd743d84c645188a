"""Series of one period and the lines of their discrete Fourier transform, which keeps sums."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array, ComplexArray


def lines_of(series: Array) -> ComplexArray:
    """Return the lines Z = rfft(x)/√n of series, (n, …): (n // 2 + 1, …)."""
    return np.fft.rfft(series, axis=0) / np.sqrt(len(series))


def series_of(lines: ComplexArray, samples: int) -> Array:
    """Return the series, (n, …), that have these lines."""
    return np.fft.irfft(lines * np.sqrt(samples), samples, axis=0)


def multiplicity(samples: int) -> Array:
    """Return how often each line stands in a sum over all n lines, (n // 2 + 1,): 1 or 2."""
    times = np.full(samples // 2 + 1, 2.0)
    times[0] = 1.0
    if samples % 2 == 0:
        times[-1] = 1.0
    return times
