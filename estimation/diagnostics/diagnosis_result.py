"""Diagnoses, in memory and in a run folder: keys of JSON files, and tables of the figures."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

import numpy as np

from estimation.diagnostics.attribution import Attribution, Effect
from estimation.diagnostics.finding import DiagnosisVerdict
from estimation.diagnostics.gain_drift import GainDriftTest
from estimation.diagnostics.hypothesis import DelayTest, HypothesisResult
from estimation.diagnostics.noise_result import Histogram, NoisePictures, Quantiles
from estimation.diagnostics.noise_tests import Drifts, Normalities, Whitenesses
from estimation.diagnostics.periodic_forces import PeriodicForce
from estimation.diagnostics.residuals import (
    BinRow,
    ChiSquare,
    ForceResiduals,
    LackOfFit,
    VarianceComparison,
)
from estimation.diagnostics.significance import Strut
from expdesign.runfolder import ArrayTable, OpenNumber, RowTable, described


@dataclass(frozen=True, eq=False)
class ChiSquares:
    """Sizes of the residuals."""

    forces: Annotated[ChiSquare, described("", "of the forces")]
    forces_with_effects: Annotated[ChiSquare, described("", "with the effects taken as known")]
    lengths: Annotated[ChiSquare | None, described("", "null after pointwise differentiation")]


@dataclass(frozen=True, eq=False)
class PitchResult:
    """What the scan of the pitches of one strut found."""

    strut: Annotated[Strut, described("1", "number of the strut")]
    pitches_scanned: Annotated[int, described("1", "0: it moves too little or too fast")]
    log_p: Annotated[OpenNumber, described("1", "logarithm of p over all pitches of the strut")]
    log_p_with_effects: Annotated[
        OpenNumber, described("1", "with the effects found taken as known")
    ]
    best: Annotated[PeriodicForce | None, described("", "the force that fits best")]
    critical: Annotated[
        OpenNumber, described("1", "statistic that is significant over all struts and pitches")
    ] = np.nan


@dataclass(frozen=True, eq=False, kw_only=True)
class ExperimentTests:
    """The tests of one experiment, by what they assume."""

    held_out: Annotated[bool, described("", "the parameters were not estimated from it")]
    harmonics_left_out: Annotated[
        int, described("1", "harmonics that the forces show and the estimate's motion has not")
    ] = 0
    chi_square: Annotated[ChiSquares, described("", "size of the residuals")]
    lack_of_fit: Annotated[LackOfFit, described("", "bias of each actuator")]
    lack_of_fit_with_effects: Annotated[
        LackOfFit, described("", "the same with the effects found taken as known")
    ]
    variance_comparison: Annotated[VarianceComparison, described("", "the paper's comparison")]
    effects: Annotated[tuple[Effect, ...], described("", "what the model lacks, strongest first")]
    position_periodic: Annotated[tuple[PitchResult, ...], described("", "strut by strut")]
    causes: Annotated[
        tuple[HypothesisResult, ...], described("", "what the model may lack, family by family")
    ] = ()
    causes_with_effects: Annotated[
        tuple[HypothesisResult, ...], described("", "with the effects as known")
    ] = ()
    delay: Annotated[DelayTest, described("", "between forces and lengths")]
    delay_with_effects: Annotated[DelayTest, described("", "with the effects as known")]
    gain_drift: Annotated[
        GainDriftTest, described("", "of the forces' gains, from period to period")
    ] = field(default_factory=lambda: GainDriftTest("it was not looked for"))
    whiteness: Annotated[Whitenesses, described("", "autocorrelation")]
    normality: Annotated[Normalities, described("", "distribution of the noise")]
    drift: Annotated[Drifts, described("", "change from period to period")]


@dataclass(frozen=True, eq=False)
class DiagnosisKeys:
    """How well an estimate fits."""

    estimator: Annotated[str, described("", "ls, gm or ml")]
    verdict: Annotated[DiagnosisVerdict, described("", "what holds and what does not")]
    experiments: Annotated[tuple[ExperimentTests, ...], described("", "recording by recording")]


@dataclass(frozen=True)
class PitchRow:
    """The scan of forces that are periodic in a strut's length, at one pitch."""

    strut: Annotated[int, described("1", "number of the strut")]
    pitch: Annotated[float, described("m", "period in the strut's length")]
    statistic: Annotated[float, described("1", "χ² of sine and cosine")]
    statistic_with_effects: Annotated[
        float, described("1", "with the effects found taken as known")
    ]


_ESTIMATE = "`expdesign estimate`"


@dataclass(frozen=True, eq=False, kw_only=True)
class ExperimentRecord(NoisePictures):
    """One experiment of a diagnosis: what its figures are drawn from.

    Its tables are numbered when there are several recordings.
    """

    TABLES: ClassVar = {
        "residuals": ArrayTable("tables/residuals.csv", _ESTIMATE, ForceResiduals),
        "dependence": RowTable("tables/residual_dependence.csv", _ESTIMATE, BinRow),
        "pitches": RowTable("tables/position_periodic.csv", _ESTIMATE, PitchRow),
        "histogram": ArrayTable("tables/estimate_noise_histogram.csv", _ESTIMATE, Histogram),
        "quantiles": ArrayTable("tables/estimate_noise_quantiles.csv", _ESTIMATE, Quantiles),
    }
    tests: ExperimentTests
    residuals: ForceResiduals
    dependence: tuple[BinRow, ...]
    pitches: tuple[PitchRow, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class ExperimentDiagnosis(ExperimentRecord):
    """Diagnostics of one experiment, with what stands in no file."""

    pointwise: bool
    """Its motion was differentiated sample by sample: its error is in the residuals."""
    attribution: Attribution


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Everything that is known of how well an estimate fits."""

    estimator: str
    experiments: tuple[ExperimentDiagnosis, ...]
    verdict: DiagnosisVerdict

    @property
    def keys(self) -> DiagnosisKeys:
        """What a JSON file keeps of it."""
        tests = tuple(experiment.tests for experiment in self.experiments)
        return DiagnosisKeys(self.estimator, self.verdict, tests)
