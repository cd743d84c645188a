"""Spectrum of a recording's noise as a table for `noise.force_spectrum`.

It is the smoothed spectrum of the contrasts between periods, without the hum of the mains, whose
lines have separate columns. Rows are added until linear interpolation between them is accurate.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Self

import numpy as np
import scipy

from constraints.arrays import Array, ComplexArray
from estimation.processing import Channels
from estimation.processing.hum import HumSearch, find_hum
from estimation.processing.smoothing import NoiseLines, smoothed_spectrum
from expdesign.configuration.noise_spectrum import COHERENCIES, FREQUENCY, PAIRS
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.runfolder import Column, strutwise

_UNIT = "N^2/Hz or m^2/Hz"
_AT_FIRST = 40
_MOST_ROWS = 160
_CLOSE = 0.5
"""Largest interpolation error, relative to the standard deviation of the density."""
_DIGITS = 7

_COHERENCY_COLUMNS = tuple(
    Column(name, "1", f"{name.split('_', maxsplit=1)[0]} part of the coherency of two actuators")
    for name in COHERENCIES
)


@dataclass(frozen=True, eq=False)
class NoiseDensity:
    """One-sided density of six channels at increasing frequencies, to half of the sampling.

    A row at the frequency of a hum contains its amplitudes. Without contrasts there are no rows.
    """

    frequency: Annotated[Array, Column(FREQUENCY, "Hz", "to half of the sampling")]
    density: Annotated[Array, strutwise("density_", _UNIT, "one-sided density of the noise")]
    amplitude: Annotated[Array, strutwise("amplitude_", "N or m", "amplitude of a hum")]
    freedom: Annotated[
        Array, Column("freedom", "1", "degrees of freedom of a density; 0: infinite")
    ]
    coherency: Annotated[Array, _COHERENCY_COLUMNS]

    @classmethod
    def none(cls) -> Self:
        """Return a table without rows."""
        six, pairs = np.zeros((0, ACTUATORS)), np.zeros((0, len(COHERENCIES)))
        return cls(np.zeros(0), six, six, np.zeros(0), pairs)

    @property
    def white(self) -> Array:
        """(6,), density of white noise with the same variance, without the hum."""
        steps = np.diff(self.frequency)[:, None]
        middle = (self.density[1:] + self.density[:-1]) / 2
        return np.sum(middle * steps, axis=0) / self.frequency[-1]

    def band(self) -> tuple[Array, Array]:
        """Return the lower and upper ends of the densities' 95 % intervals, (K, 6) each."""
        freedom = np.where(self.freedom > 0, self.freedom, np.inf)[:, None]
        with np.errstate(invalid="ignore"):
            ends = [freedom / scipy.stats.chi2.isf(p, freedom) for p in (0.025, 0.975)]
        low, high = (np.where(np.isfinite(freedom), end, 1.0) for end in ends)
        return self.density * low, self.density * high


def noise_density(channels: Channels, step: float) -> tuple[NoiseDensity, HumSearch | None]:
    """Estimate the spectrum of the noise of forces or lengths, and search it for a hum.

    Without two periods that can be compared sample by sample, the table has no rows and the search
    is None.
    """
    periods = channels.periods
    if periods is None or len(periods) < 2:  # noqa: PLR2004 - a contrast takes two
        return NoiseDensity.none(), None
    found, freedom = _smooth(NoiseLines.of(periods))
    hum = find_hum(periods, step, found, freedom)
    if hum.lines:
        sinusoids = hum.values(periods.shape[0] * periods.shape[1], step)
        periods = periods - sinusoids.reshape(periods.shape)
    lines = NoiseLines.of(periods)
    found, freedom = _smooth(lines)
    frequencies, density = _extend_to_nyquist(found * 2 * step, lines.samples, step)
    close = _CLOSE * np.sqrt(2 / freedom)
    rows = _select_rows(frequencies, np.einsum("kii->ki", density).real, close)
    frequencies, density = frequencies[rows], density[rows]
    extra = np.array([line.frequency for line in hum.lines])
    every = np.union1d(frequencies, extra)
    density = _interpolate(every, frequencies, density)
    # There are fewer rows than lines: the densities are scaled to the exact variance.
    size = np.sqrt(np.diag(lines.covariance) / _integrate(every, density))
    density = density * size[:, None] * size
    diagonal = np.einsum("kii->ki", density).real
    root = np.sqrt(diagonal)
    coherency = density / (root[:, :, None] * root[:, None, :])
    parts = [part for i, j in PAIRS for part in (coherency[:, i, j].real, coherency[:, i, j].imag)]
    amplitude = np.zeros_like(diagonal)
    for line in hum.lines:
        amplitude[np.searchsorted(every, line.frequency)] = line.amplitudes
    return (
        NoiseDensity(
            every,
            _round_digits(diagonal),
            _round_digits(amplitude),
            np.full(len(every), freedom if np.isfinite(freedom) else 0.0),
            np.round(np.stack(parts, axis=1), _DIGITS),
        ),
        hum,
    )


def _smooth(lines: NoiseLines) -> tuple[ComplexArray, float]:
    """Return the smoothed spectrum at every line, and its degrees of freedom."""
    covariance = lines.covariance
    found = smoothed_spectrum(lines, covariance)
    if found is not None:
        # The model's coefficients reduce the freedom, on average over frequencies (Berk, 1974).
        spent = found.order / (lines.freedom * lines.samples)
        return found.matrices, 1 / (1 / (2 * found.freedom) + spent)
    flat = np.broadcast_to(covariance, lines.matrices.shape).astype(np.complex128)
    return flat, lines.freedom * lines.samples


def _extend_to_nyquist(
    density: ComplexArray, samples: int, step: float
) -> tuple[Array, ComplexArray]:
    """Return frequencies up to half of the sampling, and densities that are real at the ends."""
    frequencies = np.arange(len(density)) / (samples * step)
    if samples % 2:
        frequencies, density = (
            np.append(frequencies, 0.5 / step),
            np.concatenate([density, density[-1:]]),
        )
    else:
        frequencies[-1] = 0.5 / step
    density = density.copy()
    density[[0, -1]] = density[[0, -1]].real
    return frequencies, density


def _select_rows(frequencies: Array, density: Array, close: float) -> Array:
    """Return rows, (K,), between which linear interpolation of the density is accurate."""
    last = len(frequencies) - 1
    first = np.unique(np.round(np.geomspace(1, last, _AT_FIRST)).astype(int))
    rows = np.union1d([0], first)
    while len(rows) < _MOST_ROWS:
        interpolated = np.stack(
            [np.interp(frequencies, frequencies[rows], each[rows]) for each in density.T], axis=1
        )
        off = np.max(np.abs(np.log(interpolated / density)), axis=1)
        worst = int(np.argmax(off))
        if off[worst] <= close:
            break
        rows = np.union1d(rows, [worst])
    return rows


def _interpolate(places: Array, frequencies: Array, density: ComplexArray) -> ComplexArray:
    flat = density.reshape(len(density), -1)
    columns = [np.interp(places, frequencies, column) for column in flat.T]
    return np.stack(columns, axis=1).reshape(-1, *density.shape[1:])


def _integrate(frequencies: Array, density: ComplexArray) -> Array:
    steps = np.diff(frequencies)[:, None]
    diagonal = np.einsum("kii->ki", density).real
    return np.sum((diagonal[1:] + diagonal[:-1]) / 2 * steps, axis=0)


def _round_digits(values: Array) -> Array:
    """Round to a number of digits that is convenient in a run file."""
    with np.errstate(divide="ignore"):
        digits = _DIGITS - 1 - np.floor(np.log10(np.abs(values)))
    scale = 10.0 ** np.where(np.isfinite(digits), digits, 0)
    return np.round(values * scale) / scale
