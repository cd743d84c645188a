"""The noise of a recording by itself, without model or parameters (the paper's Figs. 4, 5).

Everything comes from contrasts between the periods.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.drift import Drift, drift
from estimation.diagnostics.finding import Finding
from estimation.diagnostics.findings import noise_findings
from estimation.diagnostics.noise_samples import ChannelNoise, NoiseSamples, noise_samples
from estimation.diagnostics.normality import Normality, normality
from estimation.diagnostics.whiteness import Whiteness, whiteness
from estimation.processing import NoiseModel, Record
from estimation.processing.noise import scatter_about_series, series_harmonics


@dataclass(frozen=True, eq=False)
class NoiseAnalysis:
    """Size, distribution and memory of the noise of forces and lengths.

    Attributes
    ----------
    record : Record
    noise : NoiseModel
        Σ and Δ of one sample from the scatter.
    samples : ChannelNoise
        The noise itself, N and m.
    force_normality, length_normality : Normality
    force_noise_whiteness, length_noise_whiteness : Whiteness or None
        None where periods cannot be compared sample by sample.
    force_drift, length_drift : Drift
    findings : tuple of Finding
    """

    record: Record
    noise: NoiseModel
    samples: ChannelNoise
    force_normality: Normality
    length_normality: Normality
    force_noise_whiteness: Whiteness | None
    length_noise_whiteness: Whiteness | None
    force_drift: Drift
    length_drift: Drift

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What holds and what does not, in words."""
        return noise_findings(self)


def analyse_noise(record: Record) -> NoiseAnalysis:
    """Analyse the noise of a recording of two periods or more.

    Raises
    ------
    ValueError
        Fewer periods show no scatter.
    """
    if record.force_scatter is None or record.length_scatter is None:
        raise ValueError(
            f"{record.periods:.3g} periods show no scatter between periods: the noise of a "
            "recording takes two periods or more"
        )
    noise = NoiseModel(
        record.force_scatter.covariance,
        record.length_scatter.covariance,
        "estimated",
        "estimated",
        record.force_scatter.freedom,
        record.length_scatter.freedom,
    )
    forces = _samples(record, record.force_periods, record.force_times, record.forces)
    lengths = _samples(record, record.length_periods, record.length_times, record.lengths)
    compared = forces.source == "periods"
    return NoiseAnalysis(
        record=record,
        noise=noise,
        samples=ChannelNoise(forces, lengths),
        force_normality=normality(forces.values),
        length_normality=normality(lengths.values),
        force_noise_whiteness=whiteness(forces.values) if compared else None,
        length_noise_whiteness=whiteness(lengths.values) if compared else None,
        force_drift=_drift(record, record.force_periods, forces),
        length_drift=_drift(record, record.length_periods, lengths),
    )


def _samples(record: Record, periods: Array | None, times: Array, values: Array) -> NoiseSamples:
    if periods is not None:
        return noise_samples(periods, values)
    harmonics = series_harmonics(len(values), record.period / record.step)
    _, rest = scatter_about_series(times, values, record.omega, harmonics)
    return noise_samples(None, rest)


def _drift(record: Record, periods: Array | None, samples: NoiseSamples) -> Drift:
    if periods is not None:
        count, phases, _ = periods.shape
        values = (periods - periods.mean(axis=0)).reshape(-1, periods.shape[2])
        return drift(values, np.repeat(np.arange(count), phases), phases)
    rows = samples.pooled
    block = np.arange(len(rows)) * max(1, round(record.periods)) // len(rows)
    return drift(rows, block, 0)
