"""A filter that makes the noise of a period white, from a smoothed spectrum.

Weighting every line of the DFT with the inverse of its own 6 × 6 spectrum C̄ is the same as
filtering measurement and model alike with H, H C̄ Hᴴ = Σ, and weighting with Σ⁻¹ afterwards
(Pintelon and Schoukens, *System Identification*, 2012, chapter 9): everything that is right for
white noise is right behind the filter.

C̄ at a line is the mean over its neighbours without the line itself. The weights are then
independent of the line's own contrasts, and a variance that is computed from these (a sandwich) is
right whatever the weights are. How many neighbours is decided by how well they predict the line
that was left out (Beltrão and Bloomfield, J. Time Series Analysis 8, 1987). A line that stands out
of its neighbours, such as a drive's hum, keeps its own size.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from constraints.arrays import Array, ComplexArray, Mask
from estimation.processing.noise_lines import NoiseLines, lines_of, multiplicity
from expdesign.mechanism.hexapod import ACTUATORS

_HALF_WIDTHS = (4, 8, 16, 32, 64, 128, 256)
_FEWEST_FREEDOM = 24.0
"""Complex degrees of freedom of a smoothed 6 × 6 spectrum, at the least."""

_CLEARLY_BETTER = 5.0
"""Gain in log likelihood below which noise counts as white."""

_STANDING_OUT = 0.01
"""Probability that any line of white noise is taken for one that stands out."""

_ROUNDS = 2


@dataclass(frozen=True, eq=False)
class WhiteningFilter:
    """Filters series of one period, circularly; the noise behind it is white."""

    gain: ComplexArray
    """(N // 2 + 1, 6, 6), H, Hermitian."""
    samples: int
    """N."""
    spectrum: ComplexArray
    """(N // 2 + 1, 6, 6), C̄ of one sample's noise."""
    half_width: int | None
    """Neighbours to either side that a line's spectrum is the mean of; None: all of them."""
    freedom: float
    """Degrees of freedom behind one line's spectrum; inf when it was given."""

    def __call__(self, values: Array) -> Array:
        """Return series, (N, 6, …), filtered."""
        lines = lines_of(values)
        flat = np.matmul(self.gain, lines.reshape(*lines.shape[:2], -1)).reshape(lines.shape)
        return np.fft.irfft(flat * np.sqrt(self.samples), self.samples, axis=0)

    def powers(self, series: Array, channel: int) -> Array:
        """Return |H z|², the sum over channels, of series z in one channel: (N, q) → (L, q)."""
        gains = np.sum(np.abs(self.gain[:, :, channel]) ** 2, axis=1)
        return np.abs(lines_of(series)) ** 2 * gains[:, None]


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
    return WhiteningFilter(
        filter_to(covariance, spectrum), samples, spectrum, half_width=None, freedom=np.inf
    )


def estimated_filter(
    lines: NoiseLines, covariance: Array, *, always: bool = False
) -> WhiteningFilter | None:
    """Return the filter that fits measured lines best; None when nothing speaks against white.

    With `always` the best one is returned even so; None is then left for periods of too few
    samples to smooth over.
    """
    flat = np.broadcast_to(covariance, lines.matrices.shape).astype(np.complex128)
    white = _smoothed(lines, None, flat)
    tried = [_smoothed(lines, width, flat) for width in _HALF_WIDTHS if _usable(lines, width)]
    best = max(tried, key=lambda each: _likelihood(lines, each), default=white)
    gain = _likelihood(lines, best) - _likelihood(lines, white)
    if gain < _CLEARLY_BETTER and not always:
        best = white
    if best is white and not white.stands_out:
        return None
    stated = best.spectrum * _loss(best.freedom)[:, None, None]
    freedom = 2 * float(np.median(best.freedom))
    return WhiteningFilter(
        filter_to(covariance, stated), lines.samples, best.spectrum, best.half_width, freedom
    )


@dataclass(frozen=True, eq=False)
class _Smoothed:
    half_width: int | None
    spectrum: ComplexArray
    freedom: Array
    """(L,), complex degrees of freedom."""
    stands_out: bool
    """Whether any line does so among its neighbours."""


def _usable(lines: NoiseLines, width: int) -> bool:
    return 2 * width + 1 < lines.samples // 2 and lines.freedom * width >= _FEWEST_FREEDOM


def _smoothed(lines: NoiseLines, width: int | None, flat: ComplexArray) -> _Smoothed:
    """Return the mean over the neighbours of every line; lines that stand out count in none."""
    count = len(lines.matrices)
    kept = np.ones(count)
    own = np.ones((count, flat.shape[1]))
    spectrum, freedom = flat, np.full(count, np.inf)
    for _ in range(_ROUNDS):
        if width is not None:
            spectrum, freedom = _neighbours(lines, width, kept)
        own = _own_size(lines, spectrum, freedom)
        kept = np.where(np.any(own != 1.0, axis=1), 0.0, 1.0)
        if np.all(kept):
            break
    spectrum = spectrum * own[:, :, None] * own[:, None, :]
    return _Smoothed(width, spectrum, freedom, not np.all(kept))


def _neighbours(lines: NoiseLines, width: int, kept: Array) -> tuple[ComplexArray, Array]:
    """Return the mean over ± width lines without the line itself, and its freedom."""
    samples, count = lines.samples, len(kept)
    own = np.arange(count)
    # Beyond zero and N/2 stand the conjugates of the lines: of the line itself, too.
    place = np.mod(own[:, None] + np.arange(-width, width + 1), samples)
    folded = np.minimum(place, samples - place)
    weights = np.where(folded == own[:, None], 0.0, kept[folded])
    total = weights.sum(axis=1)
    # A line and its conjugate, both of them inside, are one line.
    mirrored = _inside(np.mod(-place, samples), own[:, None], width, samples)
    distinct = np.sum(np.where(mirrored & (folded != place), 0.0, weights), axis=1)
    whole = lines.matrices * kept[:, None, None]
    circle = np.concatenate([whole, whole[1 : samples - count + 1].conj()[::-1]])
    circle = np.concatenate([circle[samples - width :], circle, circle[:width]])
    sums = np.cumsum(np.concatenate([np.zeros_like(circle[:1]), circle]), axis=0)
    window = (sums[2 * width + 1 :] - sums[: -2 * width - 1])[:count]
    itself = whole.copy()
    conjugate = (own > 0) & (2 * own < samples) & _inside(samples - own, own, width, samples)
    itself[conjugate] += whole[conjugate].conj()
    return (window - itself) / total[:, None, None], lines.freedom * distinct


def _inside(place: NDArray[np.intp], centre: NDArray[np.intp], width: int, samples: int) -> Mask:
    """Tell which places are within ± width lines of their centres, on the circle of all lines."""
    distance = np.mod(place - centre, samples)
    return np.minimum(distance, samples - distance) <= width


def _own_size(lines: NoiseLines, spectrum: ComplexArray, freedom: Array) -> Array:
    """Return what the lines that stand out are scaled with, (L, 6): 1 for all others."""
    count, channels = len(lines.matrices), spectrum.shape[1]
    doubled = multiplicity(lines.samples) * lines.freedom
    level = _STANDING_OUT / count / 2
    each = np.einsum("lii->li", lines.matrices).real / np.einsum("lii->li", spectrum).real
    whole = np.einsum("lii->l", np.linalg.solve(spectrum, lines.matrices)).real / channels
    line_out = stats.f.sf(whole, channels * doubled, 2 * freedom) < level
    channel_out = stats.f.sf(each, doubled[:, None], 2 * freedom[:, None]) < level / channels
    size = np.where(line_out[:, None], whole[:, None], 1.0)
    return np.sqrt(np.where(channel_out, each, size))


def _likelihood(lines: NoiseLines, smoothed: _Smoothed) -> float:
    """Return Whittle's log likelihood of the lines, each predicted by its smoothed neighbours."""
    _, logarithm = np.linalg.slogdet(smoothed.spectrum)
    ratio = np.einsum("lii->l", np.linalg.solve(smoothed.spectrum, lines.matrices)).real
    weight = multiplicity(lines.samples) / 2 * lines.freedom
    return float(-np.sum(weight * (logarithm + ratio)))


def _loss(freedom: Array, channels: int = ACTUATORS) -> Array:
    """Return E[C̄⁻¹ C C̄⁻¹] / E[C̄⁻¹] of a complex Wishart matrix C̄: 1 for endless freedom.

    An estimated spectrum that is larger by this factor states the variance that the weights have
    which are made of it.
    """
    ratio = freedom**2 / ((freedom - channels) ** 2 - 1)
    return np.where(np.isfinite(freedom), ratio, 1.0)
