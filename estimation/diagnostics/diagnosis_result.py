"""Diagnosis of an estimate: tests and verdict in JSON files, residuals in tables."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from estimation.diagnostics.attribution import Attribution, Effect
from estimation.diagnostics.finding import DiagnosisVerdict
from estimation.diagnostics.gain_drift import GainDriftTest
from estimation.diagnostics.hypothesis import HypothesisResult, PeriodicForce
from estimation.diagnostics.noise_result import Histogram, NoiseCovariances, Quantiles
from estimation.diagnostics.noise_tests import Drifts, Normalities, Normality, Whitenesses
from estimation.diagnostics.reliability import CandidateReliability, UndetectedEffect
from estimation.diagnostics.residuals import (
    BinRow,
    ChiSquare,
    ForceResiduals,
    HarmonicLackOfFit,
    LackOfFit,
    VarianceComparison,
)
from estimation.diagnostics.significance import Strut
from expdesign.runfolder import OpenNumber, Table, described


@dataclass(frozen=True, eq=False)
class ChiSquares:
    """Sums of squares of the residuals."""

    forces: Annotated[ChiSquare, described("", "of the forces")]
    forces_with_effects: Annotated[
        ChiSquare, described("", "of the forces, given the effects found")
    ]
    lengths: Annotated[ChiSquare | None, described("", "null after pointwise differentiation")]


@dataclass(frozen=True, eq=False)
class PitchResult:
    """Scan of the pitches of one strut."""

    strut: Annotated[Strut, described("1", "number of the strut")]
    pitches_scanned: Annotated[int, described("1", "0: it moves too little or too fast")]
    log_p: Annotated[OpenNumber, described("1", "logarithm of p over all pitches of the strut")]
    log_p_with_effects: Annotated[
        OpenNumber, described("1", "logarithm of p, given the effects found")
    ]
    best: Annotated[PeriodicForce | None, described("", "best-fitting force")]
    critical: Annotated[
        OpenNumber, described("1", "statistic that is significant over all struts and pitches")
    ]


@dataclass(frozen=True, eq=False, kw_only=True)
class RecordingTests:
    """Tests of one recording, by their assumptions."""

    held_out: Annotated[bool, described("", "the parameters were not estimated from it")]
    harmonics_left_out: Annotated[
        int, described("1", "harmonics that the forces show, but not the estimate's motion")
    ]
    settled: Annotated[
        bool, described("", "motion and noise agree; always with a motion that has a period")
    ]
    chi_square: Annotated[ChiSquares, described("", "size of the residuals")]
    lack_of_fit: Annotated[LackOfFit, described("", "bias of each actuator")]
    lack_of_fit_with_effects: Annotated[
        LackOfFit, described("", "bias of each actuator, given the effects found")
    ]
    harmonic_lack_of_fit: Annotated[
        HarmonicLackOfFit, described("", "bias of all actuators in the low harmonics of the motion")
    ]
    harmonic_lack_of_fit_with_effects: Annotated[
        HarmonicLackOfFit, described("", "the same, given the effects found")
    ]
    variance_comparison: Annotated[VarianceComparison, described("", "the paper's comparison")]
    effects: Annotated[
        tuple[Effect, ...], described("", "unmodelled effects, most significant first")
    ]
    position_periodic: Annotated[tuple[PitchResult, ...], described("", "strut by strut")]
    causes: Annotated[
        tuple[HypothesisResult, ...],
        described("", "tests of hypotheses on unmodelled effects, by family"),
    ]
    causes_with_effects: Annotated[
        tuple[HypothesisResult, ...], described("", "the same, given the effects found")
    ]
    gain_drift: Annotated[
        GainDriftTest, described("", "drift of the forces' gains between periods")
    ]
    whiteness: Annotated[Whitenesses, described("", "autocorrelation")]
    normality: Annotated[Normalities, described("", "distribution of the noise")]
    drift: Annotated[Drifts, described("", "drift between periods")]


@dataclass(frozen=True)
class PitchRow:
    """Scan of position-periodic forces at one pitch."""

    strut: Annotated[int, described("1", "number of the strut")]
    pitch: Annotated[float, described("m", "period in the strut's length")]
    statistic: Annotated[float, described("1", "χ² of sine and cosine")]
    statistic_with_effects: Annotated[float, described("1", "χ², given the effects found")]


@dataclass(frozen=True, eq=False, kw_only=True)
class RecordingTables:
    """Tables of the residuals of one recording."""

    residuals: Annotated[ForceResiduals, Table("tables/residuals.csv")]
    dependence: Annotated[tuple[BinRow, ...], Table("tables/residual_dependence.csv")]
    pitches: Annotated[tuple[PitchRow, ...], Table("tables/position_periodic.csv")]
    histogram: Annotated[Histogram, Table("tables/estimate_noise_histogram.csv")]
    quantiles: Annotated[Quantiles, Table("tables/estimate_noise_quantiles.csv")]


@dataclass(frozen=True, eq=False, kw_only=True)
class RecordingDiagnosis(RecordingTables):
    """Diagnosis of one recording."""

    tests: RecordingTests
    noise: NoiseCovariances

    @property
    def force_normality(self) -> Normality:
        """Test of the distribution of the forces' noise."""
        return self.tests.normality.forces


@dataclass(frozen=True, eq=False, kw_only=True)
class AttributedDiagnosis(RecordingDiagnosis):
    """Diagnosis of one recording, with the search for effects that it comes from."""

    pointwise: bool
    """The motion was differentiated sample by sample: its error is in the residuals."""
    attribution: Attribution
    reliability: tuple[CandidateReliability, ...]
    """What each candidate may do undetected; empty for held-out data."""


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Goodness of fit of an estimate."""

    estimator: Annotated[str, described("", "ls, gm or ml")]
    verdict: Annotated[DiagnosisVerdict, described("", "verdict with all findings")]
    experiments: Annotated[tuple[RecordingTests, ...], described("", "recording by recording")]
    undetected: Annotated[
        tuple[UndetectedEffect, ...],
        described(
            "",
            "effects of the size that the tests detect with a probability of 80 %, and the "
            "errors that they would cause, the largest first; empty for a prediction",
        ),
    ]


@dataclass(frozen=True, eq=False)
class ResidualDiagnosis(Diagnosis):
    """Goodness of fit of an estimate, with the residuals and searches behind the tests."""

    recordings: tuple[AttributedDiagnosis, ...]
