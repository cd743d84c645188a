"""Measured against predicted forces on motions that were not used for the estimate."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from threadpoolctl import threadpool_limits

from constraints.arrays import Array
from estimation.data.reading import read_measurement
from estimation.diagnostics.diagnosis import diagnose
from estimation.diagnostics.diagnosis_result import Diagnosis, DiagnosisKeys, ExperimentTests
from estimation.diagnostics.finding import DiagnosisVerdict, Status
from estimation.diagnostics.residuals import ForceResiduals
from estimation.estimators import Experiment, PerturbedMachine
from estimation.identification import prepare_experiment
from estimation.identification.estimated_machine import apply_calibration, estimated_machine
from estimation.identification.saved import SavedEstimate
from estimation.twin import Twin
from estimation.validation.motions import broken_limits, motion_name, motion_of_run
from estimation.validation.prediction_error import Accuracy, Kept, prediction_errors
from expdesign.configuration import InputError, Problem, RunConfiguration, ValidationMotion
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.progress import progress_prefix, report_progress
from expdesign.robot import robot_from
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
from expdesign.runfolder.fields import wrong_count
from expdesign.trajectory import FourierTrajectory

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
            "every motion keeps its tolerance or, without one, does not contradict the model",
        ),
    ]
    motions: Annotated[tuple[MotionKeys, ...], described("", "motion by motion")]
    seconds: Annotated[float, described("s", "how long it took")]
    warnings: Annotated[tuple[str, ...], described("", "in words")]

    def contradictions(self) -> Iterator[Problem]:
        """Yield motions that are not diagnosed once."""
        for number, motion in enumerate(self.motions, start=1):
            key = f"motions[{number}].diagnostics.experiments"
            yield from wrong_count(key, motion.diagnostics.experiments, 1, "the motion")


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


FIRST_REPETITION = 100_001
"""Number of the first motion's draw of noise: beyond those of any repetition of the experiment."""
_ESTIMATE_FIRST = (
    "mend first what the estimate names, which is doubtful itself, then estimate and validate "
    "again: this may be a trace of it"
)


@dataclass(frozen=True, eq=False)
class _Prediction:
    """The prediction of one motion, and what to warn of: a limit that the motion breaks."""

    keys: MotionKeys
    record: MotionRecord
    rows: list[ActuatorRow]
    warnings: list[str]


def validate(configuration: RunConfiguration, saved: SavedEstimate) -> ValidationRecord:
    """Predict every motion of the run's `validate:` and judge the prediction.

    Computed motions are measured on the digital twin, with the disturbances of `experiment:` but
    for lost samples; recorded ones are read as `data:` says.

    Raises
    ------
    InputError
        The run names no motion, or one that cannot be made or read.
    """
    began = time.perf_counter()
    if not configuration.run.validation:
        raise InputError(
            "the run names no motion to validate on",
            file=configuration.file,
            key="validate",
            allowed="a list such as [{motion: circle}, {motion: circle, mirror: xz}]",
        )
    machine = estimated_machine(robot_from(configuration.robot), saved.estimate.systematic)
    robot = machine.robot
    with threadpool_limits(limits=1, user_api="blas"):
        predictions = []
        motions = configuration.run.validation
        for number, motion in enumerate(motions, start=1):
            with progress_prefix(f"{motion_name(motion)}, motion {number} of {len(motions)}"):
                report_progress("measuring" if motion.motion != "file" else "reading")
                predictions.append(_predicted(configuration, machine, saved, number, motion))
    warnings = list(configuration.warnings)
    if saved.doubt:
        warnings.append(
            f"the estimate that predicts is doubtful itself: {saved.doubt}. What the predictions "
            "show may come from that, by whatever name"
        )
    if saved.estimate.covariance_kinematics is None:
        warnings.append(
            "the estimate comes from pointwise differentiation: it is biased and its covariance "
            "too small, so that the tests may fail for the estimate's sake"
        )
    summary = ValidationFile(
        name=configuration.run.name,
        robot=robot.name,
        estimate=str(saved.path),
        estimator=saved.estimate.estimator,
        accepted=all(prediction.keys.good for prediction in predictions),
        motions=tuple(prediction.keys for prediction in predictions),
        seconds=time.perf_counter() - began,
        warnings=(*warnings, *(text for each in predictions for text in each.warnings)),
    )
    return ValidationRecord(
        summary,
        tuple(row for prediction in predictions for row in prediction.rows),
        tuple(prediction.record for prediction in predictions),
    )


def _predicted(
    configuration: RunConfiguration,
    machine: PerturbedMachine,
    saved: SavedEstimate,
    number: int,
    motion: ValidationMotion,
) -> _Prediction:
    trajectory: FourierTrajectory | None = None
    warnings: list[str] = []
    robot, name = machine.robot, motion_name(motion)
    if motion.motion == "file":
        path = Path(str(motion.file))
        data = read_measurement(path, configuration.run.data, configuration.robot)
    else:
        trajectory = motion_of_run(configuration, motion, robot.home, f"validate[{number}]")
        changed = configuration.with_section("experiment", periods=motion.periods, lost=None)
        data = Twin.of(changed, trajectory).measurement(FIRST_REPETITION + number - 1)
        warnings += broken_limits(robot, trajectory, name)
    loaded = robot.with_load_at(saved.estimate.values)
    data = apply_calibration(data, machine)
    experiment = prepare_experiment(configuration, loaded, data, trajectory, held_out=True)
    diagnosis = diagnose(loaded, [experiment], saved.knowledge, saved.estimate, held_out=True)
    if saved.doubt:
        diagnosis = replace(diagnosis, verdict=_after_the_estimate(diagnosis.verdict))
    record = experiment.record
    predicted = experiment.fitted_regressors @ saved.estimate.values
    return _Prediction(
        MotionKeys(
            name,
            motion.motion != "file",
            record.period,
            float(record.periods),
            diagnosis.keys,
            None if motion.tolerance is None else motion.tolerance.text,
            prediction_errors(loaded, experiment, saved.estimate.values, motion.tolerance),
        ),
        MotionRecord.of(
            name, diagnosis, PredictedForces(experiment.times, experiment.forces, predicted)
        ),
        _actuator_rows(number, name, experiment, diagnosis),
        warnings,
    )


def _after_the_estimate(verdict: DiagnosisVerdict) -> DiagnosisVerdict:
    """Return a verdict whose advice is to mend a doubtful estimate first.

    What is wrong there has moved the parameters: the prediction shows its traces, and other causes
    may explain these better.
    """
    findings = [
        replace(each, advice=_ESTIMATE_FIRST) if each.failed and each.serious else each
        for each in verdict.findings
    ]
    return replace(verdict, findings=tuple(findings))


def _actuator_rows(
    number: int, name: str, experiment: Experiment, diagnosis: Diagnosis
) -> list[ActuatorRow]:
    (only,) = diagnosis.experiments
    test, variances = only.tests.lack_of_fit, only.tests.variance_comparison
    forces, rest = experiment.forces, only.residuals.forces
    words = ["not tested" if test.refused else "fails" if f else "passes" for f in test.failed]
    return [
        ActuatorRow(
            number=number,
            motion=name,
            actuator=j + 1,
            rms_measured=float(np.std(forces[:, j])),
            rms_residual=float(np.sqrt(np.mean(rest[:, j] ** 2))),
            variance_model_error=float(variances.model_error[j]),
            variance_measurement_error=float(variances.measurement_error[j]),
            statistic=float(test.statistic[j]),
            p_value=float(test.p_values[j]),
            verdict=words[j],
        )
        for j in range(ACTUATORS)
    ]
