"""The noise of a recording as a run folder keeps it: `noise.json`, tables, and its pictures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
import scipy
from pydantic import BeforeValidator

from constraints.arrays import Array
from estimation.diagnostics.finding import Finding
from estimation.diagnostics.noise_density import NoiseDensity
from estimation.diagnostics.noise_tests import (
    Drifts,
    NoiseTests,
    Normalities,
    Normality,
    Whitenesses,
)
from estimation.processing import NoiseModel
from estimation.processing.noise import NoiseEstimate
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.runfolder import (
    ArrayTable,
    Column,
    Covariance,
    FolderRecord,
    JsonFile,
    Numbers,
    RowTable,
    described,
    sized,
    strutwise,
)
from expdesign.runfolder.files import write_text


def _infinite(value: object) -> object:
    return np.inf if value is None else value


Freedom = Annotated[float, BeforeValidator(_infinite)]
"""Degrees of freedom behind a covariance; infinitely many, null in a file, when it was given."""


@dataclass(frozen=True, eq=False)
class NoiseKeys:
    """Size of the noise: Σ and Δ of one sample."""

    source: Annotated[str, described("", "estimated, given or residuals")]
    force_covariance: Annotated[Covariance, described("N^2", "Σ, 6 × 6")]
    length_covariance: Annotated[Covariance, described("m^2", "Δ, 6 × 6")]
    force_freedom: Annotated[Freedom, described("1", "degrees of freedom of Σ; null when given")]
    length_freedom: Annotated[Freedom, described("1", "degrees of freedom of Δ; null when given")]


def noise_keys(noise: NoiseModel) -> dict[str, Any]:
    """Return the values of `NoiseKeys`, for the types that have further ones."""
    forces, lengths = noise.forces, noise.lengths
    return {
        "source": noise.source,
        "force_covariance": forces.covariance,
        "length_covariance": lengths.covariance,
        "force_freedom": forces.freedom,
        "length_freedom": lengths.freedom,
    }


NOISE_BLOCK = "noise.yaml"
"""`noise:` with units, to be pasted into a robot or run file."""

_HISTOGRAM_REACH = 4.2
"""Half the width of the histograms, in standard deviations."""
_MOST_BINS, _FEWEST_BINS = 60, 12
_POINTS, _TAIL = 400, 40
"""Quantiles over the whole distribution, and in each of its tails."""


@dataclass(frozen=True, eq=False)
class Histogram:
    """Distribution of the forces' noise; what lies further out is counted in the outer bins."""

    low: Annotated[Array, Column("low", "N", "beginning of the bin")]
    high: Annotated[Array, Column("high", "N", "end of the bin")]
    counts: Annotated[Array, strutwise("n", "1", "samples in the bin,")]

    @classmethod
    def of(cls, samples: Array, std: Array) -> Self:
        """Count the samples of the forces' noise, (N, 6), of these standard deviations, (6,)."""
        reach = _HISTOGRAM_REACH * float(np.max(std))
        bins = int(np.clip(np.sqrt(len(samples)), _FEWEST_BINS, _MOST_BINS))
        edges = np.linspace(-reach, reach, bins + 1)
        counts = [np.histogram(np.clip(x, -reach, reach), edges)[0] for x in samples.T]
        return cls(edges[:-1], edges[1:], np.stack(counts, axis=1).astype(float))


@dataclass(frozen=True, eq=False)
class Quantiles:
    """Quantiles of the forces' noise in standard deviations, dense in the tails."""

    normal: Annotated[Array, Column("normal", "1", "of the normal distribution")]
    low: Annotated[Array, Column("low", "1", "lower end of the 95 % band of normal noise")]
    high: Annotated[Array, Column("high", "1", "upper end of the 95 % band of normal noise")]
    noise: Annotated[Array, strutwise("z", "1", "of the noise")]

    @classmethod
    def of(cls, samples: Array) -> Self:
        """Order the samples of the forces' noise, (N, 6)."""
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


@dataclass(frozen=True, eq=False, kw_only=True)
class NoisePictures(FolderRecord):
    """What the figures of the noise are drawn from."""

    noise: NoiseKeys
    normality: Normality
    histogram: Histogram
    quantiles: Quantiles

    @staticmethod
    def parts(noise: NoiseModel, tests: NoiseTests) -> dict[str, Any]:
        """Take them from the tests of the noise."""
        normality = tests.normality.forces
        return {
            "noise": NoiseKeys(**noise_keys(noise)),
            "normality": normality,
            "histogram": Histogram.of(tests.samples, normality.std),
            "quantiles": Quantiles.of(tests.samples),
        }


@dataclass(frozen=True)
class CovarianceRow:
    """One element of Σ or Δ."""

    quantity: Annotated[str, described("", "force or length")]
    row: Annotated[int, described("1", "strut")]
    column: Annotated[int, described("1", "strut")]
    covariance: Annotated[float, described("N^2 or m^2", "of one sample")]
    std_error: Annotated[
        float, described("N^2 or m^2", "standard error of the covariance; 0 when it was given")
    ]
    correlation: Annotated[float, described("1", "of one sample")]


def correlation_of(covariance: Array) -> Array:
    """Return the correlation, (6, 6); zeros beside a channel without noise."""
    std = np.sqrt(np.diag(covariance))
    size = np.multiply.outer(std, std)
    correlation: Array = np.divide(covariance, size, out=np.zeros_like(size), where=size > 0)
    np.fill_diagonal(correlation, 1.0)
    return correlation


def covariance_rows(noise: NoiseKeys) -> tuple[CovarianceRow, ...]:
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


@dataclass(frozen=True, eq=False)
class HumKeys:
    """A hum in the noise."""

    quantity: Annotated[str, described("", "force or length")]
    frequency: Annotated[float, described("Hz", "of the sinusoid")]
    amplitude: Annotated[Numbers, sized(ACTUATORS), described("N or m", "in every actuator")]


@dataclass(frozen=True, eq=False, kw_only=True)
class NoiseFile(NoiseKeys, JsonFile):
    """`noise.json`; its covariances can be copied into a robot or run file."""

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
    ] = False
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
        tuple[HumKeys, ...],
        described("", "sinusoids of the mains: quantity, frequency and amplitude of each"),
    ] = ()
    findings: Annotated[tuple[Finding, ...], described("", "what holds and what does not")]


@dataclass(frozen=True, eq=False, kw_only=True)
class NoiseRecord(NoisePictures):
    """An analysis of the noise of one recording, from memory or from its run folder."""

    TABLES: ClassVar = {
        "covariance": RowTable("tables/noise_covariance.csv", NoiseFile.WRITTEN_BY, CovarianceRow),
        "histogram": ArrayTable("tables/noise_histogram.csv", NoiseFile.WRITTEN_BY, Histogram),
        "quantiles": ArrayTable("tables/noise_quantiles.csv", NoiseFile.WRITTEN_BY, Quantiles),
        "force_density": ArrayTable(
            "tables/force_spectrum.csv", NoiseFile.WRITTEN_BY, NoiseDensity, some=False
        ),
        "length_density": ArrayTable(
            "tables/length_spectrum.csv", NoiseFile.WRITTEN_BY, NoiseDensity, some=False
        ),
    }
    summary: NoiseFile
    force_density: NoiseDensity
    length_density: NoiseDensity
    """Spectra, which `noise.force_spectrum` and `noise.length_spectrum` take; without rows where no
    two periods can be compared sample by sample."""
    block: str | None = None
    """`noise:` for a robot file, as text; None in a folder whose version did not write it."""

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read it; noise and normality stand in `noise.json`."""
        found = cls.fields_in(folder)
        summary: NoiseFile = found["summary"]
        file = folder / NOISE_BLOCK
        block = file.read_text(encoding="utf-8") if file.is_file() else None
        return cls(**found, noise=summary, normality=summary.normality.forces, block=block)

    def write(self, folder: Path) -> list[Path]:
        """Write the files, and the lines for the robot file."""
        written = super().write(folder)
        if self.block is not None:
            write_text(folder / NOISE_BLOCK, self.block)
            written.append(folder / NOISE_BLOCK)
        return written

    @property
    def covariance(self) -> tuple[CovarianceRow, ...]:
        """Σ and Δ element by element."""
        return covariance_rows(self.summary)
