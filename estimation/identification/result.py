"""The result of an estimation: recordings, estimates with their covariances, and the diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields
from operator import attrgetter
from typing import Annotated, Any, ClassVar, TypeVar

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.diagnosis_result import Diagnosis, RecordingDiagnosis, RecordingTables
from estimation.diagnostics.noise_result import CovarianceRow, NoiseCovariances, covariance_rows
from estimation.estimators.result import TEN
from estimation.identification import estimator_result
from estimation.identification.term_selection import Selection
from estimation.selection import SelectionRow
from estimation.uncertainty.forces import ActuatorForce
from estimation.uncertainty.intervals import ParameterRow, correlation
from expdesign.configuration import Problem
from expdesign.configuration.tolerances import IDENTIFIED_ROBOT
from expdesign.information.identifiable import KnownCombination
from expdesign.runfolder import (
    Column,
    Matrix,
    Numbered,
    Numbers,
    RunFile,
    StageResult,
    Table,
    Text,
    described,
)
from expdesign.runfolder.fields import (
    ACCELERATION_COLUMNS,
    POSE_COLUMNS,
    RATE_COLUMNS,
    TIME,
    strutwise,
    unknown_names,
    wrong_count,
    wrong_covariance,
    wrong_names,
    wrong_shape,
)

Row = TypeVar("Row")
_ESTIMATOR = Column("estimator", "", "ls, gm or ml")
_Rows = dict[str, tuple[Row, ...]]
"""Rows by estimator; estimators without any are left out."""


def _table(name: str, *, optional: bool = True) -> Table:
    return Table(f"tables/{name}.csv", optional=optional, by=_ESTIMATOR)


_RECORDING = Column("recording", "1", "number of the recording")


@dataclass(frozen=True, eq=False, kw_only=True)
class WeightingNoise(NoiseCovariances):
    """Noise model of the weights of the estimators."""

    force_source: Annotated[str, described("", "estimated, given or residuals")]
    length_source: Annotated[str, described("", "estimated, given or residuals")]
    includes_model_error: Annotated[bool, described("", "Σ comes from the model's residuals")]
    force_spectrum: Annotated[
        str, described("", "how the forces' noise is spread over the frequencies, in words")
    ]
    length_spectrum: Annotated[str, described("", "how that of the lengths is, in words")]


@dataclass(frozen=True, eq=False, kw_only=True)
class EstimatedRecording:
    """One recording of an estimate."""

    source: Annotated[str, described("", "its file")]
    fingerprint: Annotated[str, described("", "SHA-256 of what was measured, for any units")] = ""
    rows: Annotated[int, described("1", "rows that were used")]
    dropped_rows: Annotated[int, described("1", "rows of incomplete periods that were not")]
    lost_samples: Annotated[
        int, described("1", "samples that are missing among the rows that were used")
    ]
    samples: Annotated[int, described("1", "means over the periods, or rows")]
    averaged: Annotated[bool, described("", "the samples are means over the periods")]
    periods: Annotated[float, described("1", "number of periods")]
    omega: Annotated[float, described("rad/s", "base frequency")]
    omega_std: Annotated[
        float | None, described("rad/s", "its standard deviation; null when it was not estimated")
    ]
    period_source: Annotated[str, described("", "where the period came from")]
    jitter: Annotated[float, described("1", "of the time stamps, as a share of a step")]
    harmonics: Annotated[
        int | None,
        described(
            "1",
            "of the motion fitted to the lengths, with those that tolerances can raise (LS and GM "
            "take only those that the lengths show); null if it is no Fourier series",
        ),
    ]
    harmonics_of_forces: Annotated[
        int | None,
        described("1", "of ML's motion, from forces and lengths together; null as before"),
    ]
    fewest_harmonics: Annotated[
        int | None, described("1", "fewest that were tried; null when the number was given")
    ]
    knot_spacing: Annotated[
        float | None, described("s", "of the spline of a motion without a period; otherwise null")
    ] = None
    noise: Annotated[WeightingNoise, described("", "noise that the estimators weighted with")]


@dataclass(frozen=True, eq=False)
class EstimatedMotion:
    """Measured and modelled quantities at the samples of one recording."""

    time: Annotated[Array, TIME]
    state: Annotated[Array, POSE_COLUMNS, RATE_COLUMNS, ACCELERATION_COLUMNS]
    lengths: Annotated[Array, strutwise("q", "m", "measured length, mean over periods,")]
    lengths_model: Annotated[
        Array, strutwise("q", "m", "length on the estimated motion", suffix="_model")
    ]
    forces: Annotated[Array, strutwise("Q", "N", "measured force, mean over periods,")]
    forces_model: Annotated[Array, strutwise("Q", "N", "force by the estimate", suffix="_model")]


@dataclass(frozen=True, eq=False, kw_only=True)
class EstimateFile(RunFile):
    """The keys of `estimate.json`: estimates with their covariances, and the diagnosis."""

    FILE: ClassVar[str] = "estimate.json"
    WRITTEN_BY: ClassVar[str] = "`expdesign estimate`"
    parameters: Annotated[tuple[str, ...], described("", "order of rows and columns")]
    fixed: Annotated[tuple[str, ...], described("", "parameters that were not estimated")]
    best: Annotated[str, described("", "the estimator to use")]
    recordings: Annotated[
        tuple[EstimatedRecording, ...], described("", "recordings of the estimate")
    ]
    prior_recordings: Annotated[
        tuple[str, ...], described("", "fingerprints of the recordings in the prior estimate")
    ] = ()
    estimators: Annotated[
        dict[str, estimator_result.EstimatorResult], described("", "results by estimator")
    ]
    cramer_rao_covariance: Annotated[
        Numbers | None, described("SI", "the bound with noise in forces and lengths, m × m")
    ]
    covariance_ml_less_gm: Annotated[
        Numbers | None,
        described("SI", "of the difference of these estimates, m × m; null without both"),
    ]
    intervals_cover: Annotated[
        bool, described("", "the intervals count the lengths' noise, and the estimator converged")
    ]
    intervals_note: Annotated[str, described("", "contents of the intervals, in words")]
    diagnostics: Annotated[
        Diagnosis | None, described("", "diagnosis of the residuals; null if not requested")
    ]
    selection: Annotated[
        Selection | None,
        described("", "terms that were added to those of the robot file; null: none was tried"),
    ]
    seconds: Annotated[float, described("s", "how long it took")]
    warnings: Annotated[tuple[str, ...], described("", "in words")]
    forces: Annotated[
        tuple[ActuatorForce, ...],
        described(
            "",
            "of the identified machine on the motions of all recordings, by actuator; empty after "
            "pointwise differentiation",
        ),
    ] = ()

    @property
    def best_estimator(self) -> estimator_result.EstimatorResult:
        """The result of the estimator to use."""
        return self.estimators[self.best]

    def contradictions(self) -> Iterator[Problem]:
        """Yield contents that contradict the parameters, estimators and recordings."""
        names = self.parameters
        count, of, of_both = len(names), "parameters", "parameters and deviations"
        square = (count, count)
        yield from unknown_names("best", [self.best], self.estimators, "estimators")
        yield from unknown_names("fixed", self.fixed, names, of)
        yield from wrong_covariance("cramer_rao_covariance", self.cramer_rao_covariance, count, of)
        # Place in the file, object, shape, owner of the rows, and names of arrays.
        shapes: list[tuple[str, Any, tuple[int, ...], str, tuple[str, ...]]] = [
            ("", self, square, of, ("covariance_ml_less_gm",))
        ]
        for name, found in self.estimators.items():
            place, system = f"estimators.{name}.", found.systematic
            others = 0 if system is None else len(system.deviations)
            yield from wrong_names(f"{place}values", found.values, names, of)
            for key in ("covariance", "covariance_forces"):
                yield from wrong_covariance(f"{place}{key}", getattr(found, key), count, of)
            # Rounding may make these shares negative.
            shares = "covariance_kinematics", "covariance_systematic"
            shapes.append((place, found, square, of, shares))
            shapes.append((place, found, (count,), of, ("freedom", "colour")))
            if (payload := found.payload) is not None:
                own, size = f"{place}payload.", len(TEN)
                yield from wrong_names(f"{own}values", payload.values, TEN, "a payload")
                shares = "covariance", "covariance_systematic"
                shapes.append((own, payload, (size, size), "a payload", shares))
                shapes.append((own, payload, (size,), "a payload", ("freedom",)))
            if (near := found.consistent) is not None:
                own = f"{place}consistent."
                yield from wrong_names(f"{own}values", near.values, names, of)
                shapes.append((own, near, (count,), of, ("moved", "spread", "low", "high")))
            if system is not None:
                own = f"{place}systematic."
                shapes.append((own, system, (count, others), of_both, ("response",)))
                shapes.append((own, system, (others, others), of_both, ("left",)))
            if (joint := found.covariance_joint) is not None:
                size = min(max(len(joint), count), count + others)
                yield from wrong_covariance(f"{place}covariance_joint", joint, size, of_both)
        for place, part, shape, owner, keys in shapes:
            for key in keys:
                yield from wrong_shape(f"{place}{key}", getattr(part, key), shape, owner)
        if self.diagnostics is not None:
            tested, recordings = self.diagnostics.experiments, len(self.recordings)
            yield from wrong_count("diagnostics.experiments", tested, recordings, "recordings")


@dataclass(frozen=True, eq=False, kw_only=True)
class EstimationResult(EstimateFile, StageResult):
    """Parameters with their uncertainty, by estimator, and the diagnosis of the best estimate."""

    FILE: ClassVar[str] = EstimateFile.FILE
    rows: Annotated[
        tuple[ParameterRow, ...],
        Table(
            "estimates.csv",
            some=True,
            rows_of=("estimator", "parameter"),
            as_in=("estimators", "parameters"),
        ),
    ]
    motions: Annotated[
        dict[int, EstimatedMotion], Table("tables/estimated_motion.csv", numbered="numbers")
    ]
    """By number of the recording, from 1; none after pointwise differentiation."""
    tables: Annotated[tuple[RecordingTables, ...], Numbered("diagnosed")]
    """Residuals of every recording; empty without a diagnosis."""
    identified: Annotated[
        str | None, Text(IDENTIFIED_ROBOT, "robot file with the parameters that were found")
    ]

    @property
    def numbers(self) -> tuple[int | None, ...]:
        """Numbers of the recordings in the names of their tables; None for a single recording."""
        count = len(self.recordings)
        return tuple(range(1, count + 1)) if count > 1 else (None,)

    @property
    def diagnosed(self) -> tuple[int | None, ...]:
        """Numbers of the recordings with a diagnosis."""
        return () if self.diagnostics is None else self.numbers

    @property
    def diagnoses(self) -> tuple[RecordingDiagnosis, ...]:
        """The diagnosis of every recording with its tables; empty without a diagnosis."""
        if self.diagnostics is None:
            return ()
        parts = zip(self.tables, self.diagnostics.experiments, self.recordings, strict=True)
        names = [field.name for field in fields(RecordingTables)]
        return tuple(
            RecordingDiagnosis(
                **{name: getattr(tables, name) for name in names},
                tests=tests,
                noise=recording.noise,
            )
            for tables, tests, recording in parts
        )

    def __getitem__(self, estimator: str) -> estimator_result.EstimatorResult:
        """Return the result of one estimator: ``result["ml"].values["p10"]``."""
        return self.estimators[estimator]

    def by_estimator(self) -> dict[str, tuple[ParameterRow, ...]]:
        """Return the rows of each estimator, in the order of the parameters."""
        return {
            name: tuple(row for row in self.rows if row.estimator == name)
            for name in dict.fromkeys(row.estimator for row in self.rows)
        }

    @property
    def covariances(
        self,
    ) -> Annotated[
        dict[str, Array],
        Matrix("tables/covariance.csv", "SI", "covariance", names="parameters", by=_ESTIMATOR),
    ]:
        """The covariance of every estimator, (m, m)."""
        return {name: entry.covariance for name, entry in self.estimators.items()}

    @property
    def correlations(
        self,
    ) -> Annotated[
        dict[str, Array],
        Matrix("tables/correlation.csv", "1", "correlation", names="parameters", by=_ESTIMATOR),
    ]:
        """The correlation of every estimator, (m, m)."""
        return {name: correlation(matrix) for name, matrix in self.covariances.items()}

    @property
    def precision(
        self,
    ) -> Annotated[_Rows[estimator_result.PrecisionRow], _table("precision", optional=False)]:
        """The shares of every standard deviation."""
        unknown = np.full(len(self.parameters), np.nan)
        bound = self.cramer_rao_covariance

        def rows(
            entry: estimator_result.EstimatorResult,
        ) -> Iterator[estimator_result.PrecisionRow]:
            share = entry.covariance_kinematics
            columns = (
                np.sqrt(np.diag(entry.covariance)),
                np.sqrt(np.diag(entry.covariance_forces)),
                unknown if share is None else np.sqrt(np.maximum(np.diag(share), 0.0)),
                unknown if bound is None else np.sqrt(np.diag(bound)),
            )
            for name, *numbers in zip(self.parameters, *(c.tolist() for c in columns), strict=True):
                yield estimator_result.PrecisionRow(name, *numbers)

        return self._by_estimator(rows)

    def _by_estimator(
        self, rows: Callable[[estimator_result.EstimatorResult], Iterable[Row]]
    ) -> _Rows[Row]:
        found = {name: tuple(rows(entry)) for name, entry in self.estimators.items()}
        return {name: own for name, own in found.items() if own}

    @property
    def base_parameters(
        self,
    ) -> Annotated[_Rows[KnownCombination], _table("estimate_combinations", optional=False)]:
        """Identified combinations of every estimator."""
        return self._by_estimator(attrgetter("base_parameters"))

    @property
    def derived(
        self,
    ) -> Annotated[_Rows[estimator_result.EstimatedQuantity], _table("estimate_derived")]:
        """Derived quantities of every estimator."""
        return self._by_estimator(attrgetter("derived"))

    @property
    def budget(self) -> Annotated[_Rows[estimator_result.BudgetRow], _table("budget")]:
        """Shares of every tolerance in every variance; empty without tolerances."""
        return self._by_estimator(estimator_result.budget_rows)

    @property
    def deviations(self) -> Annotated[_Rows[estimator_result.DeviationRow], _table("deviations")]:
        """Tolerances and estimates of all deviations; empty without tolerances."""
        return self._by_estimator(estimator_result.deviation_rows) if self.budget else {}

    @property
    def constants(self) -> Annotated[_Rows[estimator_result.ConstantResult], _table("constants")]:
        """Estimated constants of terms; empty without any."""
        return self._by_estimator(attrgetter("constants"))

    @property
    def payload(self) -> Annotated[_Rows[estimator_result.PayloadRow], _table("payload")]:
        """The payload by every estimator; empty without a prior identification."""
        return self._by_estimator(estimator_result.payload_rows)

    @property
    def consistent(self) -> Annotated[_Rows[estimator_result.ConsistentRow], _table("consistent")]:
        """Every estimate and the nearest physically consistent parameters."""
        return self._by_estimator(estimator_result.consistent_rows)

    @property
    def selection_steps(
        self,
    ) -> Annotated[tuple[SelectionRow, ...], Table("tables/selection.csv", optional=True)]:
        """Every term that was tried; empty without a selection."""
        return () if self.selection is None else self.selection.steps

    @property
    def noise(
        self,
    ) -> Annotated[dict[int, tuple[CovarianceRow, ...]], Table("tables/noise.csv", by=_RECORDING)]:
        """Σ and Δ of every recording, element by element."""
        return {
            number: covariance_rows(recording.noise)
            for number, recording in enumerate(self.recordings, start=1)
        }
