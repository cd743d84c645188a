"""The stages that take a recording: the estimate of the parameters, and the noise alone."""

from __future__ import annotations

from typing import Any

from numpy.linalg import LinAlgError

from estimation import diagnostics, identification
from estimation.diagnostics import Diagnosis
from estimation.identification import EstimationResult
from estimation.identification.period_choice import choose_omega
from estimation.identification.record import EstimateRecord
from estimation.processing import PeriodError, make_record
from expdesign.configuration import InputError
from expdesign.stages.outcome import Outcome, StageFailed
from expdesign.stages.workspace import Workspace
from results import record_figures


def perform(work: Workspace) -> Outcome:
    """Estimate, judge the estimate, and write the run folder.

    The result is the `EstimationResult` and the `Diagnosis`, which is None where the intervals
    do not cover.

    Raises
    ------
    InputError
        Run, data or design do not fit.
    ComputationError
        The data have no motion, or do not determine the parameters.
    """
    configuration, folder = work.configuration, work.folder
    files = work.data_files()
    designs = work.recorded_designs(len(files))
    recordings = [work.recording(file) for file in files]
    try:
        result = identification.estimate(configuration, recordings, designs)
    except LinAlgError as error:
        raise StageFailed(
            f"the data cannot be estimated from ({error}): is a channel constant?"
        ) from error
    diagnosis = None
    if result.intervals_cover:
        diagnosis = diagnostics.diagnose(
            result.robot, result.experiments, result.knowledge, result.best
        )
    record = EstimateRecord.of(result, diagnosis)
    figures = configuration.run.report.figures
    summary = _summary(result, diagnosis)
    return Outcome(
        "estimate",
        folder,
        (result, diagnosis),
        (*record.write(folder), *record_figures(record, folder, figures)),
        summary=summary,
        record=record,
        message="; ".join(f"{name}: {e.status}" for name, e in result.estimates.items()),
        warnings=result.warnings[len(configuration.warnings) :],
        doubt="" if summary["verdict"] == "accepted" else "a diagnostic failed",
    )


def analyse_noise(work: Workspace) -> Outcome:
    """Analyse the noise of a recording without any model, and write the run folder.

    Raises
    ------
    InputError
        The recording cannot be read, or has fewer than two periods.
    """
    configuration, folder = work.configuration, work.folder
    (file,) = work.data_files()
    (trajectory,) = work.recorded_designs(1)
    recording = work.recording(file)
    for warning in recording.warnings:
        work.progress.warn(warning)
    omega, source = choose_omega(configuration, recording, trajectory)
    try:
        samples = make_record(recording, omega, source)
        record = diagnostics.analyse_noise(samples, str(file))
    except (PeriodError, ValueError) as error:
        raise InputError(
            str(error), file=file, key="--data", allowed="two periods or more"
        ) from error
    figures = record_figures(record, folder, configuration.run.report.figures)
    return Outcome(
        "noise",
        folder,
        samples,
        (*record.write(folder), *figures),
        summary=record.summary.as_data(),
        record=record.summary,
    )


def _summary(result: EstimationResult, diagnosis: Diagnosis | None) -> dict[str, Any]:
    verdict = None if diagnosis is None else diagnosis.verdict
    best = [row for row in result.rows if row.estimator == result.best.estimator]
    return {
        "best": result.best.estimator,
        "estimates": {
            row.parameter: {"value": row.value, "std": row.std, "unit": row.unit} for row in best
        },
        "not_identified": [row.parameter for row in best if row.identified is False],
        "verdict": "not judged" if verdict is None else verdict.status.value,
        "findings": [] if verdict is None else [finding.sentence for finding in verdict.failed],
        "seconds": result.seconds,
        "warnings": list(result.warnings),
    }
