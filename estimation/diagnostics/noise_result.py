"""The result of the stage `noise`: covariances, tests, spectra and lines for the robot file.

The spectrum, a table for `noise.force_spectrum`, is the smoothed spectrum of the contrasts between
periods without the hum of the mains, whose lines have separate columns. Rows are added until linear
interpolation between them is accurate.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self

import numpy as np
import scipy

from constraints.arrays import Array, ComplexArray
from estimation.diagnostics.finding import Finding
from estimation.diagnostics.noise_tests import Drifts, Normalities, Normality, Whitenesses
from estimation.processing import Channels, NoiseModel
from estimation.processing.hum import HumSearch, find_hum
from estimation.processing.noise import NoiseEstimate
from estimation.processing.spectrum import NoiseLines, smoothed_spectrum
from estimation.uncertainty.intervals import correlation
from expdesign.configuration.noise import COHERENCIES, FREQUENCY, PAIRS
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.runfolder import (
    Column,
    Covariance,
    Numbers,
    StageResult,
    Table,
    Text,
    UnboundedNumber,
    described,
    sized,
    strutwise,
)


@dataclass(frozen=True, eq=False, kw_only=True)
class NoiseCovariances:
    """Covariances Σ and Δ of one sample."""

    source: Annotated[str, described("", "estimated, given or residuals")]
    force_covariance: Annotated[Covariance, described("N^2", "Σ, 6 × 6")]
    length_covariance: Annotated[Covariance, described("m^2", "Δ, 6 × 6")]
    force_freedom: Annotated[
        UnboundedNumber, described("1", "degrees of freedom of Σ; null when given")
    ]
    length_freedom: Annotated[
        UnboundedNumber, described("1", "degrees of freedom of Δ; null when given")
    ]


def covariance_fields(noise: NoiseModel) -> dict[str, Any]:
    """Return the fields of `NoiseCovariances`, for that type and those derived from it."""
    forces, lengths = noise.forces, noise.lengths
    return {
        "source": noise.source,
        "force_covariance": forces.covariance,
        "length_covariance": lengths.covariance,
        "force_freedom": forces.freedom,
        "length_freedom": lengths.freedom,
    }


@dataclass(frozen=True)
class CovarianceRow:
    """Element of Σ or Δ."""

    quantity: Annotated[str, described("", "force or length")]
    row: Annotated[int, described("1", "strut")]
    column: Annotated[int, described("1", "strut")]
    covariance: Annotated[float, described("N^2 or m^2", "of one sample")]
    std_error: Annotated[
        float, described("N^2 or m^2", "standard error of the covariance; 0 when it was given")
    ]
    correlation: Annotated[float, described("1", "of one sample")]


def covariance_rows(noise: NoiseCovariances) -> tuple[CovarianceRow, ...]:
    """Return Σ and Δ element by element."""
    rows = []
    for quantity, covariance, freedom in (
        ("force", noise.force_covariance, noise.force_freedom),
        ("length", noise.length_covariance, noise.length_freedom),
    ):
        parts = (
            covariance,
            NoiseEstimate(covariance, freedom).std_error(),
            correlation_of(covariance),
        )
        rows += [
            CovarianceRow(quantity, i + 1, j + 1, *(float(part[i, j]) for part in parts))
            for i, j in np.ndindex(covariance.shape)
        ]
    return tuple(rows)


def correlation_of(covariance: Array) -> Array:
    """Return the correlation, (6, 6); zero for a channel without noise."""
    found = correlation(covariance)
    np.fill_diagonal(found, 1.0)
    return found


_HISTOGRAM_REACH = 4.2
"""Half the width of the histograms, in standard deviations."""
_MOST_BINS, _FEWEST_BINS = 60, 12
_POINTS, _TAIL = 400, 40
"""Quantiles over the whole distribution, and in each of its tails."""


@dataclass(frozen=True, eq=False)
class Histogram:
    """Distribution of the forces' noise; outliers are counted in the outer bins."""

    low: Annotated[Array, Column("low", "N", "beginning of the bin")]
    high: Annotated[Array, Column("high", "N", "end of the bin")]
    counts: Annotated[Array, strutwise("n", "1", "samples in the bin,")]

    @classmethod
    def of(cls, samples: Array, std: Array) -> Self:
        """Count samples of the forces' noise, (N, 6), with standard deviations (6,)."""
        reach = _HISTOGRAM_REACH * float(np.max(std))
        bins = int(np.clip(np.sqrt(len(samples)), _FEWEST_BINS, _MOST_BINS))
        edges = np.linspace(-reach, reach, bins + 1)
        counts = [np.histogram(np.clip(x, -reach, reach), edges)[0] for x in samples.T]
        return cls(edges[:-1], edges[1:], np.stack(counts, axis=1).astype(float))


@dataclass(frozen=True, eq=False)
class Quantiles:
    """Quantiles of the forces' noise in standard deviations, dense in the tails."""

    normal: Annotated[Array, Column("normal", "1", "quantile of the normal distribution")]
    low: Annotated[Array, Column("low", "1", "lower end of the 95 % band of normal noise")]
    high: Annotated[Array, Column("high", "1", "upper end of the 95 % band of normal noise")]
    noise: Annotated[Array, strutwise("z", "1", "quantile of the noise")]

    @classmethod
    def of(cls, samples: Array) -> Self:
        """Sort samples of the forces' noise, (N, 6)."""
        count = len(samples)
        tail = np.arange(min(count, _TAIL))
        middle = np.linspace(0, count - 1, _POINTS).astype(int)
        rank = np.unique(np.concatenate([tail, middle, count - 1 - tail]))
        centred = samples - samples.mean(axis=0)
        return cls(
            scipy.stats.norm.ppf((rank + 0.5) / count),
            scipy.stats.norm.ppf(scipy.stats.beta.ppf(0.025, rank + 1, count - rank)),
            scipy.stats.norm.ppf(scipy.stats.beta.ppf(0.975, rank + 1, count - rank)),
            np.sort(centred / centred.std(axis=0, ddof=1), axis=0)[rank],
        )


@dataclass(frozen=True, eq=False)
class HumComponent:
    """Sinusoid of the mains in the noise."""

    quantity: Annotated[str, described("", "force or length")]
    frequency: Annotated[float, described("Hz", "frequency of the sinusoid")]
    amplitude: Annotated[
        Numbers, sized(ACTUATORS), described("N or m", "amplitude in every actuator")
    ]


@dataclass(frozen=True, eq=False, kw_only=True)
class NoiseResult(NoiseCovariances, StageResult):
    """The noise of one recording; its covariances can be copied into a robot or run file."""

    FILE: ClassVar[str] = "noise.json"
    WRITTEN_BY: ClassVar[str] = "`expdesign noise`"

    units: Annotated[str, described("", "of all values")] = "SI and radians"
    recording: Annotated[str, described("", "file that was analysed")]
    rows: Annotated[int, described("1", "number of samples")]
    periods: Annotated[float, described("1", "number of periods")]
    period: Annotated[float, described("s", "duration of a period")]
    averaged: Annotated[bool, described("", "the periods are a whole number of samples")]
    at_rest: Annotated[
        bool, described("", "the machine did not move: the periods are parts of the recording")
    ]
    force_std: Annotated[
        Numbers, sized(ACTUATORS), described("N", "standard deviation of each force")
    ]
    length_std: Annotated[
        Numbers, sized(ACTUATORS), described("m", "standard deviation of each length")
    ]
    whiteness: Annotated[Whitenesses, described("", "autocorrelation")]
    normality: Annotated[Normalities, described("", "distribution")]
    drift: Annotated[Drifts, described("", "change from period to period")]
    hum: Annotated[
        tuple[HumComponent, ...],
        described("", "sinusoids of the mains: quantity, frequency and amplitude of each"),
    ]
    findings: Annotated[
        tuple[Finding, ...], described("", "findings on the noise, one per assumption")
    ]
    histogram: Annotated[Histogram, Table("tables/noise_histogram.csv")]
    quantiles: Annotated[Quantiles, Table("tables/noise_quantiles.csv")]
    force_density: Annotated[NoiseDensity, Table("tables/force_spectrum.csv", some=False)]
    length_density: Annotated[NoiseDensity, Table("tables/length_spectrum.csv", some=False)]
    """Spectra for `noise.force_spectrum` and `noise.length_spectrum`; without rows where no two
    periods can be compared sample by sample."""
    block: Annotated[str | None, Text("noise.yaml", "`noise:` with units, for a robot or run file")]

    @property
    def covariance(
        self,
    ) -> Annotated[tuple[CovarianceRow, ...], Table("tables/noise_covariance.csv")]:
        """Σ and Δ element by element."""
        return covariance_rows(self)

    @property
    def noise(self) -> NoiseCovariances:
        """The covariances."""
        return self

    @property
    def force_normality(self) -> Normality:
        """Test of the distribution of the forces' noise."""
        return self.normality.forces


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
    columns = [np.interp(every, frequencies, each) for each in density.reshape(len(density), -1).T]
    density = np.stack(columns, axis=1).reshape(-1, *density.shape[1:])
    # There are fewer rows than lines: the densities are scaled to the exact variance.
    diagonal = np.einsum("kii->ki", density).real
    steps = np.diff(every)[:, None]
    variance = np.sum((diagonal[1:] + diagonal[:-1]) / 2 * steps, axis=0)
    size = np.sqrt(np.diag(lines.covariance) / variance)
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
        frequencies = np.append(frequencies, 0.5 / step)
        density = np.concatenate([density, density[-1:]])
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


def _round_digits(values: Array) -> Array:
    """Round to a number of digits that is convenient in a run file."""
    with np.errstate(divide="ignore"):
        digits = _DIGITS - 1 - np.floor(np.log10(np.abs(values)))
    scale = 10.0 ** np.where(np.isfinite(digits), digits, 0)
    return np.round(values * scale) / scale
