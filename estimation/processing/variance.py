"""Noise whose size depends on speed, force or phase, from the scatter between periods.

Levene's test (in: Olkin, *Contributions to Probability and Statistics*, 1960) compares the mean
absolute contrasts of bins of equal numbers of samples. It is robust to outliers, and these are
judged after the noise has been scaled to one size.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc

from constraints.arrays import Array
from estimation.processing.noise import NORMAL_MEDIAN
from estimation.processing.spectrum import contrasts

_LEVEL = 3e-4
"""Level over all channels, for one of the three quantities."""
_NOTICEABLE = 1.25
"""Smallest relevant ratio of the largest to the smallest standard deviation."""
_REMAINING = 1.6
"""Smallest relevant ratio over the phase, after scaling."""
_MOST_BINS, _BINS_OF_PHASE, _PER_BIN = 8, 24, 100
_CUT = 6.0
"""Normalised size at which outliers are cut off."""
_SMALLEST = 0.1
"""Smallest size, relative to its root mean square: weights stay bounded."""
_ENOUGH = 0.2
"""Largest share of the harmonics of a period that describe the motion."""
_MOST_HARMONICS = 12


@dataclass(frozen=True, eq=False)
class VarianceProfile:
    """Standard deviation of the noise over a period, relative to its root mean square."""

    over: str
    """Quantity on which it depends: speed, force or phase."""
    std: Array
    """(N, 6), with a mean square of one; all one in channels without a significant change."""

    @property
    def ratio(self) -> Array:
        """(6,), largest over smallest standard deviation."""
        return np.asarray(np.max(self.std, axis=0) / np.min(self.std, axis=0))


def variance_profile(
    periods: Array, quantities: Mapping[str, Array], ends: int = 0
) -> VarianceProfile | None:
    """Return the size of the noise over the quantity that explains its changes.

    It is the quantity with the most significant changes, or the phase if changes over the phase
    remain after scaling. None if the size does not change to a relevant extent. A channel with
    more than half of its contrasts at zero has no profile.

    Parameters
    ----------
    periods : (M, N, 6)
        Repeated periods of white noise and any signal that repeats.
    quantities : mapping of str to (N, 6)
        Candidates, by their names.
    ends : int
        Number of samples at both ends of a period that are left out.

    Examples
    --------
    >>> rng, speed = np.random.default_rng(0), np.sin(np.linspace(0, 6, 500))[:, None] * np.ones(6)
    >>> noise = rng.standard_normal((5, 500, 6)) * (1 + 2 * np.abs(speed))
    >>> profile = variance_profile(noise, {"speed": np.abs(speed)})
    >>> profile.over, bool(np.all((profile.ratio > 2) & (profile.ratio < 3.5)))
    ('speed', True)
    """
    inside = slice(ends, periods.shape[1] - ends)
    size = np.abs(contrasts(periods)[:, inside])
    middle = np.median(size, axis=(0, 1))
    # With more than half exactly zero, as after coarse quantisation, nothing is an outlier.
    size = np.minimum(size, np.where(middle > 0, _CUT / NORMAL_MEDIAN * middle, np.inf))
    tests = {over: _changes(size, values[inside]) for over, values in quantities.items()}
    over = min(tests, key=lambda each: float(np.sum(tests[each])))
    found = None
    if np.any(tests[over]):
        std = _shape(size, quantities[over], inside, tests[over] < 0, _MOST_BINS)
        found = VarianceProfile(over, std)
    phase = np.broadcast_to(
        np.arange(periods.shape[1], dtype=np.float64)[:, None], periods[0].shape
    )
    scaled = size if found is None else size / found.std[inside]
    if np.any(_changes(scaled, phase[inside], _NOTICEABLE if found is None else _REMAINING)):
        changing = _changes(size, phase[inside]) < 0
        found = VarianceProfile("phase", _shape(size, phase, inside, changing, _BINS_OF_PHASE))
    return found


def _changes(size: Array, values: Array, least: float = _NOTICEABLE) -> Array:
    """Return log p of equal sizes over values, (6,); zero for changes that do not matter.

    `size` are the absolute contrasts, (K, n, 6), `values` those of a quantity, (n, 6), `least` the
    smallest ratio that matters.
    """
    count, samples, channels = size.shape
    bins = min(_MOST_BINS, count * samples // _PER_BIN)
    if bins <= 1:
        return np.zeros(channels)
    order = np.argsort(values, axis=0, kind="stable")
    size = np.take_along_axis(size, order[None], axis=1)
    lengths = np.array([len(part) for part in np.array_split(np.arange(samples), bins)])
    starts = np.cumsum(lengths) - lengths
    means = np.add.reduceat(np.mean(size, axis=0), starts, axis=0) / lengths[:, None]
    # The F statistic of a one-way analysis of variance.
    between = count * lengths @ (means - np.mean(size, axis=(0, 1))) ** 2 / (bins - 1)
    rest = count * samples - bins
    within = np.sum((size - np.repeat(means, lengths, axis=0)) ** 2, axis=(0, 1)) / rest
    with np.errstate(divide="ignore", invalid="ignore"):  # sizes without scatter, p = 0
        log_p = np.log(fdtrc(bins - 1, rest, between / within))
    changing = (log_p < np.log(_LEVEL / channels)) & (np.median(size, axis=(0, 1)) > 0)
    changing &= np.max(means, axis=0) > least * np.min(means, axis=0)
    return np.where(changing, log_p, 0.0)


def _shape(
    size: Array, values: Array, inside: slice, changing: NDArray[np.bool_], most: int
) -> Array:
    """Return the relative size of the noise over values, (N, 6); one in all other channels."""
    bins = min(most, size.shape[0] * size.shape[1] // _PER_BIN)
    std = np.ones_like(values)
    for j in np.flatnonzero(changing):
        seen = values[inside, j]
        parts = np.array_split(np.argsort(seen, kind="stable"), bins)
        means = [size[:, part, j].mean() for part in parts]
        std[:, j] = np.interp(values[:, j], [seen[part].mean() for part in parts], means)
    std = np.maximum(std, _SMALLEST * np.sqrt(np.mean(std**2, axis=0)))
    return std / np.sqrt(np.mean(std**2, axis=0))


def low_harmonics(values: Array, *, rate: bool = False) -> Array:
    """Return the low harmonics of one period of means, (N, 6), or of their derivatives to phase.

    The means themselves are no quantity for a profile: weights would depend on their noise.
    """
    lines = np.fft.rfft(values, axis=0)
    order = np.arange(len(lines))
    lines[order > min(_MOST_HARMONICS, _ENOUGH * len(lines))] = 0.0
    return np.fft.irfft(lines * (1j * order[:, None] if rate else 1.0), len(values), axis=0)
