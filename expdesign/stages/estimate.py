"""Recordings and estimates: noise, estimation, validation, and feed-forward of the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from os import PathLike
from typing import Any

import numpy as np
from numpy.linalg import LinAlgError

from estimation import identification
from estimation.channels.check import ChannelCheck
from estimation.data.measurement import Measurement, add_motors
from estimation.diagnostics import noise_analysis
from estimation.diagnostics.noise_result import NoiseResult
from estimation.feedforward.comparison import compare_feedforward
from estimation.feedforward.result import FeedforwardResult
from estimation.identification.estimate import IdentifiedModel, identified_model
from estimation.identification.periods import (
    fold_noise_recording,
    leave_out_ramps,
    window_keys,
    with_clock,
)
from estimation.identification.recording import (
    check_recording,
    fold_measurement,
    prepare_recording,
)
from estimation.identification.result import EstimateFile, EstimationResult
from estimation.kinematics import MotionFitError
from estimation.processing import PeriodSource
from estimation.validation.validate import ValidationResult, validate
from expdesign.configuration import ConfigurationLike, InputError, RunConfiguration, load_run
from expdesign.configuration.run import add_back_emf, add_terms
from expdesign.experiment import DesignResult
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.terms.actuator_forces import BACK_EMF
from expdesign.robot import robot_from
from expdesign.stages.execution import Place
from expdesign.stages.experiment import trajectory_of
from expdesign.stages.recordings import load_measurement, recordings_of
from expdesign.stages.stage import (
    ESTIMATE_FILE,
    MEASUREMENT_FILE,
    Outcome,
    StageFailed,
    StageFunctions,
    Workspace,
    short,
)
from expdesign.trajectory import FourierTrajectory
from results.comparison.estimates import compare_estimates
from results.views.estimate import estimate_view
from results.views.folder import StageViews
from results.views.noise import noise_view
from results.views.validate import feedforward_view, validation_view

Executed = DesignResult | FourierTrajectory | Place


def run_noise(work: Workspace) -> Outcome:
    """Analyse the noise of a recording."""
    files = work.data_files()
    if len(files) > 1:
        raise InputError(
            f"the noise of one recording is analysed, and there are {len(files)}",
            key="--data",
            allowed=f"one of {', '.join(map(short, files))}",
        )
    (file,) = files
    (trajectory,) = work.recorded_designs(1)
    (recording,) = recordings_of(work)
    for warning in recording.warnings:
        work.progress.warn(warning)
    samples = fold_noise_recording(
        work.configuration, recording, trajectory, certain=bool(work.sources.designs)
    )
    try:
        result = noise_analysis.analyse_noise(samples, str(file))
    except LinAlgError as error:
        raise StageFailed(
            "the noise cannot be determined from these data: a channel is constant, or the sum "
            f"of others ({error})"
        ) from error
    return Outcome(
        result=result,
        summary={**result.as_data(), "for_the_robot_file": result.block},
    )


def run_estimate(work: Workspace) -> Outcome:
    """Estimate the parameters and diagnose the estimate."""
    configuration, files = work.configuration, work.data_files()
    designs = work.recorded_designs(len(files))
    # The twin's own recording has the channels of the struts.
    own = [place / MEASUREMENT_FILE for place in work.motion_folders]
    simulated = not work.sources.data and files == own
    try:
        result = identification.estimate(
            configuration,
            recordings_of(work),
            designs,
            refuse_channels=not (work.sources.force or simulated),
        )
    except LinAlgError as error:
        still = {
            f"{group}{strut}"
            for data in recordings_of(work)
            for group, values in (("q", data.lengths), ("Q", data.forces))
            for strut in np.flatnonzero(np.ptp(values, axis=0) == 0) + 1
        }
        reason = (
            f"constant channels: {', '.join(sorted(still))}"
            if still
            else "no channel is constant, but the noise of one may be that of others, or next to "
            "none. State `noise` in the robot file and `estimate: {noise: given}`, and compare "
            "`data.filter` with the filter of the recording"
        )
        message = f"the parameters cannot be determined from these data: {reason} ({error})"
        raise StageFailed(message) from error
    summary = _summary(result)
    return Outcome(
        result=result,
        summary=summary,
        message="; ".join(f"{name}: {e.status}" for name, e in result.estimators.items()),
        warnings=result.warnings[len(configuration.warnings) :],
        doubt="" if summary["verdict"] == "accepted" else f"the verdict is {summary['verdict']}",
    )


def check_channels_of(work: Workspace, data: Measurement) -> tuple[ChannelCheck, list[str], str]:
    """Check the channels of the recording of a workspace.

    The check comes with remarks on the time and the motion, and the reason if no motion has the
    lengths.
    """
    configuration = work.configuration
    (file,), (design,) = work.data_files(), work.recorded_designs(1)
    configuration = add_motors(configuration, [data])
    robot = robot_from(configuration.robot)
    recorded, data = data, leave_out_ramps(configuration, data, design)
    configuration, clock = with_clock(configuration, data, design)
    folded = fold_measurement(configuration, data, design)
    found = check_recording(configuration, robot, folded, design, has_units=data.has_units)
    found = replace(found, clock=clock)
    recording = folded[0]
    if data is not recorded:
        found = replace(found, keys=window_keys(data) | found.keys)
    motion = f"{recording.periods:.4g} periods of {recording.period:.6g} s, from the "
    motion += recording.source.value
    if recording.source is PeriodSource.NONE:
        motion = f"{recording.period:.6g} s of a motion without a period"
    left_out = f"; {recording.rows_left_out}" if recording.rows_left_out else ""
    if found.unchecked:
        motion += f", channels not checked ({found.unchecked})"
    remarks = [
        f"{file.name} of the robot {robot.name}: {motion}, at {1 / data.step:.6g} Hz{left_out}",
        *data.warnings,
    ]
    if recording.motion_onset is not None:
        remarks.append(f"the struts do not move before {recording.motion_onset:.4g} s: data.start")
    if found.faults:
        return found, remarks, ""
    try:
        prepared = prepare_recording(configuration, robot, data, design, folded=folded)
    except MotionFitError as error:
        if design is None and not found.unchecked:
            remarks.append(
                "order, sign, unit or zero of the lengths may be wrong: --design DIR determines "
                "order and sign from the motion of the design"
            )
        return found, remarks, str(error)
    return found, [*remarks, *prepared.warnings], ""


def _summary(result: EstimationResult) -> dict[str, Any]:
    verdict = None if result.diagnostics is None else result.diagnostics.verdict
    near = result.best_estimator.consistent
    best = result.by_estimator()[result.best]
    return {
        "best": result.best,
        "estimates": {
            row.parameter: {"value": row.value, "std": row.std, "unit": row.unit} for row in best
        },
        **({} if result.selection is None else {"terms_added": list(result.selection.chosen)}),
        "not_identified": [row.parameter for row in best if row.identified is False],
        "consistent": None
        if near is None
        else {"distance": near.distance, "p": near.p, "values": near.values},
        "verdict": "not judged" if verdict is None else verdict.status.value,
        "findings": [] if verdict is None else [finding.sentence for finding in verdict.failed],
        "seconds": result.seconds,
        "warnings": list(result.warnings),
    }


def estimate(
    config: ConfigurationLike,
    data: Measurement | Place | Sequence[Measurement | Place] | None = None,
    design: Executed | Sequence[Executed] | None = None,
) -> EstimationResult:
    """Estimate the parameters from recordings.

    Parameters
    ----------
    config : path, mapping or RunConfiguration
    data : Measurement, path or sequence of them, optional
        Recordings, combined in one estimate; the run's `data.file` by default.
    design : DesignResult, FourierTrajectory or path, or sequence of them, optional
        Executed motion of all recordings, or of each; without it the period comes from the
        recording.

    Raises
    ------
    InputError
        Run, recording or design cannot be used, or do not fit.
    ComputationError
        No motion has the measured lengths, or the data do not determine some parameters.
    """
    configuration = load_run(config)
    given = configuration.run.data.recording if data is None else data
    if given is None:
        raise InputError("no recording is given", configuration.file, key="data.file")
    recordings = [
        one if isinstance(one, Measurement) else load_measurement(configuration, one)
        for one in ([given] if isinstance(given, str | PathLike | Measurement) else given)
    ]
    if design is None:
        return identification.estimate(configuration, recordings)
    if isinstance(design, str | PathLike | DesignResult | FourierTrajectory):
        return identification.estimate(configuration, recordings, trajectory_of(design))
    return identification.estimate(configuration, recordings, [trajectory_of(d) for d in design])


def run_validation(work: Workspace) -> Outcome:
    """Predict motions, and compare with the measured forces."""
    configuration, saved = _identified(work)
    result = validate(configuration, saved)
    doubt = ""
    if not result.accepted:
        doubt = "a motion contradicts the model"
        if any(each.within is False for each in result.motions):
            doubt = "a motion is not predicted within its tolerance"
    return Outcome(
        result=result,
        summary={
            "accepted": result.accepted,
            "motions": {each.name: each.diagnostics.verdict.summary for each in result.motions},
            "within_tolerance": {each.name: each.within for each in result.motions},
            "seconds": result.seconds,
            "warnings": list(result.warnings),
        },
        message="accepted" if result.accepted else "doubtful",
        warnings=result.warnings[len(configuration.warnings) :],
        doubt=doubt,
    )


def run_feedforward(work: Workspace) -> Outcome:
    """Compare the tracking errors with each feed-forward."""
    configuration, saved = _identified(work)
    designed = configuration.run.feedforward.motion == "design"
    design = work.design().trajectory if designed else None
    result = compare_feedforward(configuration, saved, design)
    reduction = result.case("identified").reduction
    return Outcome(
        result=result,
        summary={
            "machine": result.machine,
            "motion": result.motion,
            "cases": [asdict(each) for each in result.cases],
            "left": result.left,
            "warnings": list(result.warnings),
        },
        message=f"error {reduction:.3g} times smaller with the identified model",
        warnings=result.warnings[len(configuration.warnings) :],
        doubt="" if reduction > 1 else "the identified model does not make the error smaller",
    )


def _identified(work: Workspace) -> tuple[RunConfiguration, IdentifiedModel]:
    """Return the run with the terms that the estimate added, and the estimate."""
    place, made = work.estimate_place, work.made.get("estimate")
    found: EstimateFile
    if work.sources.estimate is None and made is not None and made.result is not None:
        found = made.result
    else:
        found = EstimateFile.read(place)
    added = () if found.selection is None else found.selection.added
    configuration = add_terms(work.configuration, added)
    if BACK_EMF.parameters[0].name in found.parameters:
        configuration = add_back_emf(configuration, (0.0,) * ACTUATORS)
    path = place if place.is_file() else place / ESTIMATE_FILE
    return configuration, identified_model(found, path, robot_from(configuration.robot))


FUNCTIONS = {
    "noise": StageFunctions(run_noise, StageViews(NoiseResult, noise_view)),
    "estimate": StageFunctions(
        run_estimate, StageViews(EstimationResult, estimate_view, compare_estimates)
    ),
    "validate": StageFunctions(run_validation, StageViews(ValidationResult, validation_view)),
    "feedforward": StageFunctions(run_feedforward, StageViews(FeedforwardResult, feedforward_view)),
}
"""Functions of the stages by name."""
