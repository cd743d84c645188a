"""The result of the stage `noise`: covariances, tests, spectra and lines for the robot file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Protocol, Self

import numpy as np
import scipy
from pydantic import BeforeValidator

from constraints.arrays import Array
from estimation.diagnostics.finding import Finding
from estimation.diagnostics.noise_density import NoiseDensity
from estimation.diagnostics.noise_tests import Drifts, Normalities, Normality, Whitenesses
from estimation.processing import NoiseModel
from estimation.processing.noise import NoiseEstimate
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.runfolder import (
    Column,
    Covariance,
    Numbers,
    StageResult,
    Table,
    Text,
    described,
    sized,
    strutwise,
)


def _infinite(value: object) -> object:
    return np.inf if value is None else value


Freedom = Annotated[float, BeforeValidator(_infinite)]
"""Degrees of freedom of a covariance; infinite for a given one, null in a file."""


@dataclass(frozen=True, eq=False, kw_only=True)
class NoiseCovariances:
    """Covariances Σ and Δ of one sample."""

    source: Annotated[str, described("", "estimated, given or residuals")]
    force_covariance: Annotated[Covariance, described("N^2", "Σ, 6 × 6")]
    length_covariance: Annotated[Covariance, described("m^2", "Δ, 6 × 6")]
    force_freedom: Annotated[Freedom, described("1", "degrees of freedom of Σ; null when given")]
    length_freedom: Annotated[Freedom, described("1", "degrees of freedom of Δ; null when given")]


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
    std = np.sqrt(np.diag(covariance))
    size = np.multiply.outer(std, std)
    correlation: Array = np.divide(covariance, size, out=np.zeros_like(size), where=size > 0)
    np.fill_diagonal(correlation, 1.0)
    return correlation


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


class NoisePictures(Protocol):
    """Data of the figures of the noise."""

    @property
    def noise(self) -> NoiseCovariances:
        """Covariances of forces and lengths."""

    @property
    def force_normality(self) -> Normality:
        """Test of the distribution of the forces' noise."""

    @property
    def histogram(self) -> Histogram:
        """Distribution of the forces' noise."""

    @property
    def quantiles(self) -> Quantiles:
        """Quantiles of the forces' noise."""


@dataclass(frozen=True, eq=False)
class HumComponent:
    """HumComponent in the noise."""

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
