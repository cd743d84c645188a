"""Diagnoses as a run folder keeps them: their keys in JSON files, and the tables of the figures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Self

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.attribution import Effect
from estimation.diagnostics.channel_test import Strut
from estimation.diagnostics.chi_square import ChiSquare
from estimation.diagnostics.column_test import POWER, ColumnTest, DelayTest
from estimation.diagnostics.diagnosis import ExperimentDiagnosis
from estimation.diagnostics.lack_of_fit import LackOfFit
from estimation.diagnostics.noise_record import (
    Drifts,
    Histogram,
    NoiseKeys,
    NoisePictures,
    Normalities,
    Quantiles,
    Whitenesses,
)
from estimation.diagnostics.position_periodic import PeriodicForce
from estimation.diagnostics.residuals import VarianceComparison
from estimation.diagnostics.verdict import Diagnosis, Verdict
from expdesign.runfolder import (
    ArrayTable,
    Column,
    OpenNumber,
    RowTable,
    array_columns,
    described,
)
from expdesign.runfolder.columns import strutwise


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


@dataclass(frozen=True, eq=False)
class ColumnResult:
    """t-test of the residuals on one column of the regressor."""

    parameter: Annotated[str, described("", "whose column it is")]
    actuator: Annotated[Strut, described("1", "number of the actuator; null: all of them")]
    t: Annotated[OpenNumber, described("1", "null where the model leaves nothing to test")]
    log_p: Annotated[OpenNumber, described("1", "logarithm of the two-sided p of this test")]
    coefficient: Annotated[OpenNumber, described("SI", "change of the parameter that is asked for")]
    std: Annotated[OpenNumber, described("SI", "standard deviation of the coefficient")]
    detectable: Annotated[OpenNumber, described("SI", "smallest error that is found with `power`")]
    failed: Annotated[bool, described("", "residuals lie along the column")]


@dataclass(frozen=True, eq=False)
class ColumnResults:
    """t-tests of all columns."""

    power: Annotated[float, described("1", "of the test")]
    family_level: Annotated[float, described("1", "level of all columns together")]
    tested: Annotated[int, described("1", "number of columns that leave something to test")]
    columns: Annotated[tuple[ColumnResult, ...], described("", "one by one")]

    @classmethod
    def of(cls, test: ColumnTest) -> Self:
        """Take the tests one by one."""
        numbers = zip(
            test.statistic.tolist(),
            test.log_p.tolist(),
            test.coefficients.tolist(),
            test.std.tolist(),
            test.detectable().tolist(),
            test.failed.tolist(),
            strict=True,
        )
        columns = [
            ColumnResult(*label, *row) for label, row in zip(test.labels, numbers, strict=True)
        ]
        return cls(POWER, test.level, test.tested, tuple(columns))


@dataclass(frozen=True, eq=False)
class ExperimentTests:
    """The tests of one experiment, by what they assume."""

    held_out: Annotated[bool, described("", "the parameters were not estimated from it")]
    chi_square: Annotated[ChiSquares, described("", "size of the residuals")]
    lack_of_fit: Annotated[LackOfFit, described("", "bias of each actuator")]
    lack_of_fit_with_effects: Annotated[
        LackOfFit, described("", "the same with the effects found taken as known")
    ]
    variance_comparison: Annotated[VarianceComparison, described("", "the paper's comparison")]
    effects: Annotated[tuple[Effect, ...], described("", "what the model lacks, strongest first")]
    position_periodic: Annotated[tuple[PitchResult, ...], described("", "strut by strut")]
    columns: Annotated[ColumnResults, described("", "errors of parameters")]
    columns_with_effects: Annotated[ColumnResults, described("", "with the effects as known")]
    delay: Annotated[DelayTest, described("", "between forces and lengths")]
    delay_with_effects: Annotated[DelayTest, described("", "with the effects as known")]
    whiteness: Annotated[Whitenesses, described("", "autocorrelation")]
    normality: Annotated[Normalities, described("", "distribution of the noise")]
    drift: Annotated[Drifts, described("", "change from period to period")]

    @classmethod
    def of(cls, diagnosis: ExperimentDiagnosis) -> Self:
        """Collect the tests of a diagnosis."""
        found = diagnosis.attribution
        scans = zip(found.scans, found.last_scans, found.best_forces, strict=True)
        return cls(
            held_out=diagnosis.held_out,
            chi_square=ChiSquares(
                diagnosis.force_chi_square,
                diagnosis.force_chi_square_left,
                diagnosis.length_chi_square,
            ),
            lack_of_fit=diagnosis.lack_of_fit,
            lack_of_fit_with_effects=diagnosis.lack_of_fit_left,
            variance_comparison=diagnosis.variances,
            effects=found.effects,
            position_periodic=tuple(
                PitchResult(
                    first.strut, len(first.pitches), first.log_p, last.log_p, best, first.critical
                )
                for first, last, best in scans
            ),
            columns=ColumnResults.of(found.columns),
            columns_with_effects=ColumnResults.of(found.last_columns),
            delay=found.delay,
            delay_with_effects=found.last_delay,
            whiteness=Whitenesses(
                diagnosis.force_noise_whiteness,
                diagnosis.length_noise_whiteness,
                diagnosis.force_whiteness,
                diagnosis.length_whiteness,
            ),
            normality=Normalities.of(diagnosis),
            drift=Drifts(diagnosis.force_drift, diagnosis.length_drift),
        )


@dataclass(frozen=True, eq=False)
class DiagnosisKeys:
    """How well an estimate fits."""

    estimator: Annotated[str, described("", "ls, gm or ml")]
    verdict: Annotated[Verdict, described("", "what holds and what does not")]
    experiments: Annotated[tuple[ExperimentTests, ...], described("", "recording by recording")]

    @classmethod
    def of(cls, diagnosis: Diagnosis) -> Self:
        """Collect what a diagnosis found."""
        tests = tuple(ExperimentTests.of(experiment) for experiment in diagnosis.experiments)
        return cls(diagnosis.estimator, diagnosis.verdict, tests)


@dataclass(frozen=True, eq=False)
class ForceResiduals:
    """Measured minus predicted forces along a motion."""

    time: Annotated[Array, array_columns(Column("t", "s", "time"))]
    forces: Annotated[
        Array,
        array_columns(*strutwise("e", "N", "residual force, mean over the periods,")),
    ]
    std: Annotated[
        Array,
        array_columns(
            *strutwise("e", "N", "what the noise alone makes of the residual force", suffix="_std")
        ),
    ]

    @classmethod
    def of(cls, diagnosis: ExperimentDiagnosis) -> Self:
        """Take them in the order of time."""
        rest = diagnosis.residuals
        order = np.argsort(rest.times)
        return cls(rest.times[order], rest.forces[order], rest.force_std[order])


@dataclass(frozen=True)
class BinRow:
    """Mean residual of one actuator in one bin of its strut's length or speed."""

    strut: Annotated[int, described("1", "number of the strut")]
    over: Annotated[str, described("", "length or speed")]
    centre: Annotated[float, described("m or m/s", "mean length or speed in the bin")]
    mean: Annotated[float, described("N", "weighted mean residual force")]
    half_width: Annotated[float, described("N", "of its 95 % interval, from the forces' noise")]


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
RESIDUALS = ArrayTable("tables/residuals.csv", _ESTIMATE, ForceResiduals)
DEPENDENCE = RowTable("tables/residual_dependence.csv", _ESTIMATE, BinRow)
PITCHES = RowTable("tables/position_periodic.csv", _ESTIMATE, PitchRow)
HISTOGRAM = ArrayTable("tables/estimate_noise_histogram.csv", _ESTIMATE, Histogram)
QUANTILES = ArrayTable("tables/estimate_noise_quantiles.csv", _ESTIMATE, Quantiles)
"""Tables of a diagnosis; they are numbered when there are several recordings."""


@dataclass(frozen=True, eq=False)
class ExperimentRecord:
    """One experiment of a diagnosis: what its figures are drawn from."""

    tests: ExperimentTests
    residuals: ForceResiduals
    dependence: tuple[BinRow, ...]
    pitches: tuple[PitchRow, ...]
    pictures: NoisePictures

    @classmethod
    def of(cls, diagnosis: ExperimentDiagnosis) -> Self:
        """Take it from a diagnosis."""
        attribution = diagnosis.attribution
        return cls(
            ExperimentTests.of(diagnosis),
            ForceResiduals.of(diagnosis),
            tuple(
                BinRow(strut, over, *numbers)
                for over, parts in (
                    ("length", diagnosis.dependence.position),
                    ("speed", diagnosis.dependence.speed),
                )
                for strut, bins in enumerate(parts, start=1)
                for numbers in zip(
                    bins.centres.tolist(),
                    bins.means.tolist(),
                    bins.half_widths.tolist(),
                    strict=True,
                )
            ),
            tuple(
                PitchRow(first.strut + 1, *numbers)
                for first, last in zip(attribution.scans, attribution.last_scans, strict=True)
                for numbers in zip(
                    first.pitches.tolist(),
                    first.statistic.tolist(),
                    last.statistic.tolist(),
                    strict=True,
                )
            ),
            NoisePictures.of(diagnosis),
        )

    @classmethod
    def read(
        cls, folder: Path, tests: ExperimentTests, noise: NoiseKeys, number: int | None
    ) -> Self:
        """Read the tables of a run folder.

        Parameters
        ----------
        tests, noise
            What `estimate.json` says of the experiment.
        number : int or None
            Of the recording; None when it is the only one.

        Raises
        ------
        InputError
            A table is missing or not what it should be.
        """
        pictures = NoisePictures(
            noise,
            tests.normality.forces,
            HISTOGRAM.numbered(number).read(folder),
            QUANTILES.numbered(number).read(folder),
        )
        return cls(
            tests,
            RESIDUALS.numbered(number).read(folder),
            DEPENDENCE.numbered(number).read(folder),
            PITCHES.numbered(number).read(folder),
            pictures,
        )

    def write(self, folder: Path, number: int | None) -> list[Path]:
        """Write the tables; return the files."""
        return [
            *RESIDUALS.numbered(number).write(folder, self.residuals),
            *DEPENDENCE.numbered(number).write(folder, self.dependence),
            *PITCHES.numbered(number).write(folder, self.pitches),
            *HISTOGRAM.numbered(number).write(folder, self.pictures.histogram),
            *QUANTILES.numbered(number).write(folder, self.pictures.quantiles),
        ]
