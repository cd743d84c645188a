"""The stages of a recording: the estimate of the parameters, its validation, the noise alone."""

from __future__ import annotations

from typing import Any

from numpy.linalg import LinAlgError

from estimation import identification
from estimation.data.measurement import Measurement
from estimation.diagnostics import noise_analysis
from estimation.diagnostics.diagnosis import diagnose
from estimation.diagnostics.diagnosis_result import Diagnosis
from estimation.identification import EstimationResult
from estimation.identification.periods import fold_noise_recording
from estimation.identification.record import EstimateRecord
from estimation.validation.validate import ValidationFile, validate
from expdesign.configuration import InputError
from expdesign.configuration.sizes import SAMPLES
from expdesign.progress import report_progress, track
from expdesign.stages.outcome import Outcome, StageFailed
from expdesign.stages.workspace import Workspace


def perform(work: Workspace) -> Outcome:
    """Estimate, and judge the estimate.

    The result is the `EstimationResult` and the `Diagnosis`, which is None where the intervals
    do not cover.
    """
    configuration, files = work.configuration, work.data_files()
    designs = work.recorded_designs(len(files))
    recordings: list[Measurement] = []
    for file in track("reading recordings", files):
        recordings.append(work.recording(file))
        count = sum(len(recording.time) for recording in recordings)
        if excess := SAMPLES.excess(count, f"{len(recordings)} recordings"):
            raise InputError(excess.message, key="--data", allowed=excess.allowed)
    try:
        result = identification.estimate(configuration, recordings, designs)
    except LinAlgError as error:
        raise StageFailed(
            f"no parameters follow from these data: is a channel constant? ({error})"
        ) from error
    diagnosis = None
    if result.intervals_cover:
        diagnosis = diagnose(result.robot, result.experiments, result.knowledge, result.best)
    summary = _summary(result, diagnosis)
    return Outcome(
        result=(result, diagnosis),
        record=EstimateRecord.of(result, diagnosis),
        summary=summary,
        message="; ".join(f"{name}: {e.status}" for name, e in result.estimates.items()),
        warnings=result.warnings[len(configuration.warnings) :],
        doubt="" if summary["verdict"] == "accepted" else "a diagnostic failed",
    )


def analyse_noise(work: Workspace) -> Outcome:
    """Analyse the noise of a recording without any model."""
    (file,) = work.data_files()
    (trajectory,) = work.recorded_designs(1)
    report_progress("reading the recording")
    recording = work.recording(file)
    for warning in recording.warnings:
        work.progress.warn(warning)
    samples = fold_noise_recording(
        work.configuration, recording, trajectory, certain=bool(work.sources.designs)
    )
    try:
        record = noise_analysis.analyse_noise(samples, str(file))
    except LinAlgError as error:
        raise StageFailed(
            "no noise follows from these data: are channels sums of others, or is one constant? "
            f"({error})"
        ) from error
    return Outcome(
        result=samples,
        record=record,
        summary={**record.summary.as_data(), "for_the_robot_file": record.block},
    )


def predict(work: Workspace) -> Outcome:
    """Predict motions that were not used for the estimate, and compare with what was measured."""
    configuration, saved = work.estimate()
    record = validate(configuration, saved)
    summary, warnings = record.summary, record.summary.warnings
    return Outcome(
        result=record,
        record=record,
        summary={
            "accepted": summary.accepted,
            "motions": {each.name: each.diagnostics.verdict.summary for each in summary.motions},
            "within_tolerance": {each.name: each.within for each in summary.motions},
            "seconds": summary.seconds,
            "warnings": list(warnings),
        },
        message="accepted" if summary.accepted else "doubtful",
        warnings=warnings[len(configuration.warnings) :],
        doubt="" if summary.accepted else _doubt(summary),
    )


def _doubt(summary: ValidationFile) -> str:
    if any(each.within is False for each in summary.motions):
        return "a motion is not predicted within its tolerance"
    return "a motion speaks against the model"


def _summary(result: EstimationResult, diagnosis: Diagnosis | None) -> dict[str, Any]:
    verdict = None if diagnosis is None else diagnosis.verdict
    near = result.consistent[result.best.estimator]
    best = [row for row in result.rows if row.estimator == result.best.estimator]
    return {
        "best": result.best.estimator,
        "estimates": {
            row.parameter: {"value": row.value, "std": row.std, "unit": row.unit} for row in best
        },
        **({} if result.selection is None else {"terms_added": list(result.selection.chosen)}),
        "not_identified": [row.parameter for row in best if row.identified is False],
        "consistent": None
        if near is None
        else {
            "distance": near.distance,
            "p": near.p,
            "values": dict(zip(result.knowledge.names, near.values.tolist(), strict=True)),
        },
        "verdict": "not judged" if verdict is None else verdict.status.value,
        "findings": [] if verdict is None else [finding.sentence for finding in verdict.failed],
        "seconds": result.seconds,
        "warnings": list(result.warnings),
    }
