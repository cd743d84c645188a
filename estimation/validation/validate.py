"""Measured against predicted forces on motions that were not used for the estimate."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from estimation.data.reading import read_measurement
from estimation.diagnostics.diagnosis import diagnose
from estimation.diagnostics.finding import Verdict
from estimation.diagnostics.record import Diagnosis
from estimation.estimators import DeviatingMachine, Experiment
from estimation.identification import prepare_experiment
from estimation.identification.corrected import corrected, estimated_machine
from estimation.identification.saved import SavedEstimate
from estimation.twin import Twin
from estimation.validation.motions import broken_limits, motion_name, motion_of_run
from estimation.validation.prediction_error import prediction_errors
from estimation.validation.record import (
    ActuatorRow,
    MotionKeys,
    MotionRecord,
    PredictedForces,
    ValidationFile,
    ValidationRecord,
)
from expdesign.configuration import InputError, RunConfiguration, ValidationMotion
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.progress import progress_prefix, report_progress
from expdesign.robot import robot_from
from expdesign.trajectory import FourierTrajectory

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
    machine: DeviatingMachine,
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
    data = corrected(data, machine)
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


def _after_the_estimate(verdict: Verdict) -> Verdict:
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
