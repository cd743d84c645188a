"""The noise of a recording by itself, without model or parameters (the paper's Figs. 4, 5).

Everything comes from contrasts between the periods.
"""

from __future__ import annotations

from dataclasses import dataclass

from constraints.arrays import Array
from estimation.diagnostics.finding import Finding
from estimation.diagnostics.findings import noise_findings
from estimation.diagnostics.noise_tests import NoiseTests, noise_tests
from estimation.processing import NoiseModel, Record
from estimation.processing.noise import scatter_about_series, series_harmonics


@dataclass(frozen=True, eq=False, kw_only=True)
class NoiseAnalysis(NoiseTests):
    """Size, distribution and memory of the noise of forces and lengths."""

    record: Record

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
    forces, lengths = record.force_scatter, record.length_scatter
    if forces is None or lengths is None:
        raise ValueError(
            f"{record.periods:.3g} periods show no scatter between periods: the noise of a "
            "recording takes two periods or more"
        )
    noise = NoiseModel(
        forces.covariance,
        lengths.covariance,
        "estimated",
        "estimated",
        forces.freedom,
        lengths.freedom,
    )
    tests = noise_tests(
        record,
        noise,
        _residuals(record, record.force_times, record.forces),
        _residuals(record, record.length_times, record.lengths),
    )
    return NoiseAnalysis(record=record, **vars(tests))


def _residuals(record: Record, times: Array, values: Array) -> Array:
    """Return what a long Fourier series leaves; the periods serve where there are any."""
    if record.averaged:
        return values
    harmonics = series_harmonics(len(values), record.period / record.step)
    return scatter_about_series(times, values, record.omega, harmonics)[1]
