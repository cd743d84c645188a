"""A validation as its run folder keeps it: `validation.json`, the tables and the residuals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

from constraints.arrays import Array
from estimation.diagnostics.finding import Status
from estimation.diagnostics.record import Diagnosis, DiagnosisKeys, ExperimentTests
from estimation.diagnostics.residuals import ForceResiduals
from estimation.validation.prediction_error import Accuracy, Kept
from expdesign.configuration import Problem
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.runfolder import (
    ArrayTable,
    Column,
    Contents,
    FolderRecord,
    OpenNumber,
    RowKeys,
    RowTable,
    RunFile,
    described,
    strutwise,
)
from expdesign.runfolder.contradiction import other_count

_WRITTEN_BY = "`expdesign validate`"


@dataclass(frozen=True, eq=False)
class MotionKeys:
    """The prediction of one motion."""

    name: Annotated[str, described("", "which motion")]
    simulated: Annotated[bool, described("", "measured on the digital twin")]
    period: Annotated[float, described("s", "duration of a period")]
    periods: Annotated[float, described("1", "number of periods")]
    diagnostics: Annotated[DiagnosisKeys, described("", "what the residuals say")]
    tolerance: Annotated[
        str | None, described("", "error that is good enough, as stated; null: none is")
    ] = None
    errors: Annotated[
        tuple[Accuracy, ...], described("", "how large the error is, actuator by actuator")
    ] = ()

    @property
    def within(self) -> bool | None:
        """Whether every actuator keeps the tolerance, for sure; None: not decided, or no tolerance.

        One actuator beyond it decides.
        """
        kept = {each.kept for each in self.errors} if self.tolerance is not None else set()
        if Kept.BEYOND in kept:
            return False
        return True if kept == {Kept.WITHIN} else None

    @property
    def tolerance_words(self) -> str:
        """How the tolerance is kept; empty without one."""
        if self.tolerance is None:
            return ""
        how = {True: "within", False: "beyond", None: "not decided to be within"}[self.within]
        return f"{how} its tolerance of {self.tolerance}"

    @property
    def good(self) -> bool:
        """Whether it is not beyond its tolerance or, without one, not against the model."""
        if self.tolerance is not None:
            return self.within is not False
        return self.diagnostics.verdict.status is Status.ACCEPTED


@dataclass(frozen=True, eq=False, kw_only=True)
class ValidationFile(RunFile):
    """`validation.json`."""

    FILE: ClassVar[str] = "validation.json"
    WRITTEN_BY: ClassVar[str] = _WRITTEN_BY
    estimate: Annotated[str, described("", "the `estimate.json` that predicted")]
    estimator: Annotated[str, described("", "ls, gm or ml")]
    accepted: Annotated[
        bool,
        described(
            "",
            "every motion keeps its tolerance or, without one, does not speak against the model",
        ),
    ]
    motions: Annotated[tuple[MotionKeys, ...], described("", "motion by motion")]
    seconds: Annotated[float, described("s", "how long it took")]
    warnings: Annotated[tuple[str, ...], described("", "in words")]

    def contradictions(self) -> Iterator[Problem]:
        """Yield motions that are not diagnosed once."""
        for number, motion in enumerate(self.motions, start=1):
            key = f"motions[{number}].diagnostics.experiments"
            yield from other_count(key, motion.diagnostics.experiments, 1, "the motion")


@dataclass(frozen=True)
class ActuatorRow:
    """The prediction of one actuator's force on one motion."""

    number: Annotated[int, described("1", "number of the motion")]
    motion: Annotated[str, described("", "which motion")]
    actuator: Annotated[int, described("1", "actuator")]
    rms_measured: Annotated[float, described("N", "rms of the measured force about its mean")]
    rms_residual: Annotated[
        float, described("N", "rms of measured minus predicted force, mean over the periods")
    ]
    variance_model_error: Annotated[
        float, described("N^2", "of single samples about the prediction")
    ]
    variance_measurement_error: Annotated[
        float, described("N^2", "of single samples about the mean over periods")
    ]
    statistic: Annotated[
        OpenNumber, described("1", "F of the lack-of-fit test; empty where it was refused")
    ]
    p_value: Annotated[OpenNumber, described("1", "of that test")]
    verdict: Annotated[str, described("", "passes, fails or not tested")]


@dataclass(frozen=True, eq=False)
class PredictedForces:
    """Measured and predicted forces of one motion."""

    time: Annotated[Array, Column("t", "s", "time")]
    measured: Annotated[Array, strutwise("Q", "N", "measured force, mean over periods,")]
    predicted: Annotated[Array, strutwise("Q", "N", "predicted force", suffix="_predicted")]


@dataclass(frozen=True)
class _OfMotion:
    number: Annotated[int, described("1", "number of the motion")]
    motion: Annotated[str, described("", "which motion")]


@dataclass(frozen=True)
class AccuracyRow(Accuracy, _OfMotion):
    """The error with which one actuator's force is predicted on one motion."""


FORCES = ArrayTable("tables/validation_forces.csv", _WRITTEN_BY, PredictedForces)
RESIDUALS = ArrayTable("tables/validation_residuals.csv", _WRITTEN_BY, ForceResiduals)


@dataclass(frozen=True, eq=False)
class MotionRecord:
    """What the figure of a prediction is drawn from; the forces themselves are written only."""

    name: str
    tests: ExperimentTests
    residuals: ForceResiduals
    forces: PredictedForces | None = None

    @classmethod
    def of(cls, name: str, diagnosis: Diagnosis, forces: PredictedForces | None = None) -> Self:
        """Take it from the diagnosis of a prediction."""
        (only,) = diagnosis.experiments
        return cls(name, only.tests, only.residuals, forces)


@dataclass(frozen=True, eq=False)
class ValidationRecord(FolderRecord):
    """A validation, from memory or from its run folder: what figures and reports are made from.

    There are no motions in a folder whose version did not keep the residuals.
    """

    TABLES: ClassVar = {
        "rows": RowTable(
            "tables/validation.csv",
            _WRITTEN_BY,
            ActuatorRow,
            rows_of=("number", "motion", "actuator"),
        ),
        "errors": RowTable("tables/prediction_errors.csv", _WRITTEN_BY, AccuracyRow),
    }
    summary: ValidationFile
    rows: tuple[ActuatorRow, ...]
    motions: tuple[MotionRecord, ...]

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read it from a run folder."""
        found = cls.fields_in(folder)
        summary: ValidationFile = found["summary"]
        motions = [
            MotionRecord(motion.name, motion.diagnostics.experiments[0], table.read(folder))
            for n, motion in enumerate(summary.motions, start=1)
            if (table := RESIDUALS.numbered(n)).is_in(folder)
        ]
        return cls(**found, motions=tuple(motions))

    @classmethod
    def row_keys(cls, found: Mapping[str, Any]) -> RowKeys:
        """Return the motions, and of each the actuators."""
        summary: ValidationFile = found["summary"]
        return {
            "rows": [
                (number, motion.name, actuator)
                for number, motion in enumerate(summary.motions, start=1)
                for actuator in range(1, ACTUATORS + 1)
            ]
        }

    @property
    def errors(self) -> list[AccuracyRow]:
        """The errors of all motions."""
        return [
            AccuracyRow(number, motion.name, *astuple(each))
            for number, motion in enumerate(self.summary.motions, start=1)
            for each in motion.errors
        ]

    def contents(self) -> Contents:
        """Yield the tables, those of each motion after the others."""
        yield from super().contents()
        for n, motion in enumerate(self.motions, start=1):
            yield FORCES.numbered(n), motion.forces
            yield RESIDUALS.numbered(n), motion.residuals
