"""Validation: measured against predicted forces on motions that were not used for the estimate."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import astuple, dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
from threadpoolctl import threadpool_limits

from constraints.arrays import Array
from estimation.data.reading import read_measurement
from estimation.diagnostics.diagnosis import diagnose
from estimation.diagnostics.diagnosis_result import Diagnosis, RecordingTests, ResidualDiagnosis
from estimation.diagnostics.finding import DiagnosisVerdict, Status
from estimation.diagnostics.residuals import ForceResiduals
from estimation.estimators import Experiment, PerturbedMachine
from estimation.identification import prepare_experiment
from estimation.identification.calibration import apply_calibration, estimated_machine
from estimation.identification.estimate import IdentifiedModel
from estimation.twin import Twin
from estimation.validation.prediction_error import Accuracy, Kept, prediction_errors
from expdesign.configuration import InputError, Problem, RunConfiguration, ValidationMotion
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.motion.benchmark import broken_limits, motion_name, motion_of_run
from expdesign.progress import progress_prefix, report_progress
from expdesign.robot import robot_from
from expdesign.runfolder import (
    Column,
    OpenNumber,
    RunFile,
    StageResult,
    Table,
    described,
    strutwise,
)
from expdesign.runfolder.fields import wrong_count
from expdesign.trajectory import FourierTrajectory

FIRST_REPETITION = 100_001
"""Number of the first motion's noise: beyond those of all repetitions of the experiment."""
_ESTIMATE_FIRST = (
    "resolve the findings of the estimate first, which is doubtful itself: this may be a "
    "consequence. Estimate again"
)


def validate(configuration: RunConfiguration, saved: IdentifiedModel) -> ValidationResult:
    """Predict the forces of every motion of `validate:` and test the predictions.

    Computed motions are measured on the digital twin, with the disturbances of `experiment:` except
    lost samples; recorded motions are read according to `data:`.

    Raises
    ------
    InputError
        The run names no motion, or one that cannot be executed or read.
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
    with threadpool_limits(limits=1, user_api="blas"):
        predictions = []
        motions = configuration.run.validation
        for number, motion in enumerate(motions, start=1):
            with progress_prefix(f"{motion_name(motion)}, motion {number} of {len(motions)}"):
                report_progress("measuring" if motion.motion != "file" else "reading")
                predictions.append(_predict_motion(configuration, machine, saved, number, motion))
    predicted, rows, forces, residuals, broken = zip(*predictions, strict=True)
    warnings = list(configuration.warnings)
    if saved.doubt:
        warnings.append(
            f"the estimate itself is doubtful: {saved.doubt}. This may cause deviations of the "
            "predictions, whatever the tests name as their cause"
        )
    if saved.estimate.covariance_kinematics is None:
        warnings.append(
            "the estimate comes from pointwise differentiation: it is biased and its covariance "
            "too small, so that the tests may fail because of the estimate"
        )
    return ValidationResult(
        name=configuration.run.name,
        robot=machine.robot.name,
        estimate=str(saved.path),
        estimator=saved.estimate.estimator,
        accepted=all(motion.good for motion in predicted),
        motions=predicted,
        seconds=time.perf_counter() - began,
        warnings=(*warnings, *chain(*broken)),
        rows=tuple(chain(*rows)),
        forces=forces,
        residuals=residuals,
    )


def _predict_motion(
    configuration: RunConfiguration,
    machine: PerturbedMachine,
    saved: IdentifiedModel,
    number: int,
    motion: ValidationMotion,
) -> tuple[PredictedMotion, list[ActuatorRow], PredictedForces, ForceResiduals, list[str]]:
    """Return the prediction of one motion, with warnings about limits that it breaks."""
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
    saved = saved.with_motors(data, machine)
    loaded = robot.with_load_at(saved.estimate.values)
    data = apply_calibration(configuration, data, trajectory, machine)
    experiment = prepare_experiment(configuration, loaded, data, trajectory, held_out=True)
    diagnosis = diagnose(loaded, [experiment], saved.priors, saved.estimate, held_out=True)
    verdict = _advise_estimate_first(diagnosis.verdict) if saved.doubt else diagnosis.verdict
    recording = experiment.recording
    shown = experiment.forces, experiment.fitted_regressors @ saved.estimate.values
    return (
        PredictedMotion(
            name,
            motion.motion != "file",
            recording.period,
            float(recording.periods),
            Diagnosis(diagnosis.estimator, verdict, diagnosis.experiments, ()),
            None if motion.tolerance is None else motion.tolerance.text,
            prediction_errors(loaded, experiment, saved.estimate.values, motion.tolerance),
        ),
        _actuator_rows(number, name, experiment, diagnosis),
        PredictedForces(
            experiment.times + recording.origin, *map(recording.forces.as_recorded, shown)
        ),
        diagnosis.recordings[0].residuals,
        warnings,
    )


def _advise_estimate_first(verdict: DiagnosisVerdict) -> DiagnosisVerdict:
    """Return the verdict with the advice to repair a doubtful estimate first.

    The cause of the doubt has biased the parameters; other causes may explain the resulting
    prediction errors better.
    """
    findings = [
        replace(each, advice=_ESTIMATE_FIRST) if each.failed and each.serious else each
        for each in verdict.findings
    ]
    return replace(verdict, findings=tuple(findings))


def _actuator_rows(
    number: int, name: str, experiment: Experiment, diagnosis: ResidualDiagnosis
) -> list[ActuatorRow]:
    (only,) = diagnosis.recordings
    test, variances = only.tests.lack_of_fit, only.tests.variance_comparison
    forces = experiment.recording.forces.as_recorded(experiment.forces)
    rest = only.residuals.forces
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


@dataclass(frozen=True, eq=False)
class PredictedMotion:
    """The prediction of one motion."""

    name: Annotated[str, described("", "which motion")]
    simulated: Annotated[bool, described("", "measured on the digital twin")]
    period: Annotated[float, described("s", "duration of a period")]
    periods: Annotated[float, described("1", "number of periods")]
    diagnostics: Annotated[Diagnosis, described("", "diagnosis of the residuals")]
    tolerance: Annotated[
        str | None, described("", "error that is good enough, as stated; null: none is")
    ]
    errors: Annotated[
        tuple[Accuracy, ...], described("", "how large the error is, actuator by actuator")
    ]

    @property
    def within(self) -> bool | None:
        """True where every actuator certainly keeps the tolerance; None: not decided, or none.

        A single actuator beyond the tolerance gives False.
        """
        kept = {each.kept for each in self.errors} if self.tolerance is not None else set()
        if Kept.BEYOND in kept:
            return False
        return True if kept == {Kept.WITHIN} else None

    @property
    def tolerance_words(self) -> str:
        """The comparison with the tolerance in words; empty without one."""
        if self.tolerance is None:
            return ""
        how = {True: "within", False: "beyond", None: "not decided to be within"}[self.within]
        return f"{how} its tolerance of {self.tolerance}"

    @property
    def good(self) -> bool:
        """True where the tolerance is not exceeded or, without one, the diagnosis accepts."""
        if self.tolerance is not None:
            return self.within is not False
        return self.diagnostics.verdict.status is Status.ACCEPTED


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


@dataclass(frozen=True)
class _OfMotion:
    number: Annotated[int, described("1", "number of the motion")]
    motion: Annotated[str, described("", "which motion")]


@dataclass(frozen=True)
class AccuracyRow(Accuracy, _OfMotion):
    """The error of the predicted force of one actuator on one motion."""


@dataclass(frozen=True, eq=False)
class PredictedForces:
    """Measured and predicted forces of one motion."""

    time: Annotated[Array, Column("t", "s", "time")]
    measured: Annotated[Array, strutwise("Q", "N", "measured force, mean over periods,")]
    predicted: Annotated[Array, strutwise("Q", "N", "predicted force", suffix="_predicted")]


@dataclass(frozen=True, eq=False)
class PredictionResiduals:
    """Residuals of the prediction of one motion, with their tests: the data of its figure."""

    name: str
    tests: RecordingTests
    residuals: ForceResiduals


@dataclass(frozen=True, eq=False, kw_only=True)
class ValidationResult(RunFile, StageResult):
    """Predictions of motions that were not used for the estimate, and their tests."""

    FILE: ClassVar[str] = "validation.json"
    WRITTEN_BY: ClassVar[str] = "`expdesign validate`"
    estimate: Annotated[str, described("", "the `estimate.json` that predicted")]
    estimator: Annotated[str, described("", "ls, gm or ml")]
    accepted: Annotated[
        bool,
        described(
            "",
            "every motion keeps its tolerance or, without one, does not contradict the model",
        ),
    ]
    motions: Annotated[tuple[PredictedMotion, ...], described("", "motion by motion")]
    seconds: Annotated[float, described("s", "how long it took")]
    warnings: Annotated[tuple[str, ...], described("", "in words")]
    rows: Annotated[
        tuple[ActuatorRow, ...],
        Table(
            "tables/validation.csv", rows_of=("number", "motion", "actuator"), as_in=("subjects",)
        ),
    ]
    forces: Annotated[
        tuple[PredictedForces, ...], Table("tables/validation_forces.csv", numbered="numbers")
    ]
    residuals: Annotated[
        tuple[ForceResiduals, ...], Table("tables/validation_residuals.csv", numbered="numbers")
    ]

    @property
    def errors(
        self,
    ) -> Annotated[tuple[AccuracyRow, ...], Table("tables/prediction_errors.csv")]:
        """Errors of all predicted forces."""
        return tuple(
            AccuracyRow(number, motion.name, *astuple(each))
            for number, motion in zip(self.numbers, self.motions, strict=True)
            for each in motion.errors
        )

    @property
    def numbers(self) -> range:
        """Numbers of the motions in the names of their tables."""
        return range(1, len(self.motions) + 1)

    @property
    def subjects(self) -> tuple[tuple[int, str, int], ...]:
        """Number and name of the motion and actuator of every row."""
        return tuple(
            (number, motion.name, actuator)
            for number, motion in zip(self.numbers, self.motions, strict=True)
            for actuator in range(1, ACTUATORS + 1)
        )

    @property
    def predictions(self) -> tuple[PredictionResiduals, ...]:
        """Residuals of every motion with their tests."""
        return tuple(
            PredictionResiduals(motion.name, motion.diagnostics.experiments[0], residuals)
            for motion, residuals in zip(self.motions, self.residuals, strict=True)
        )

    def contradictions(self) -> Iterator[Problem]:
        """Yield motions that are not diagnosed once."""
        for number, motion in zip(self.numbers, self.motions, strict=True):
            key = f"motions[{number}].diagnostics.experiments"
            yield from wrong_count(key, motion.diagnostics.experiments, 1, "the motion")
