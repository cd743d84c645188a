"""One recording made ready for the estimators: its period, means, noise and motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from estimation.data.measurement import Measurement
from estimation.estimators import Experiment
from estimation.identification.noise_choice import choose_noise, residual_noise
from estimation.identification.period_choice import (
    UnsuitableDataError,
    choose_omega,
    period_warning,
)
from estimation.identification.result import RecordSummary
from estimation.kinematics.fourier_fit import (
    MotionFit,
    MotionFitError,
    choose_harmonics,
    fit_motion,
    start_motion,
)
from estimation.kinematics.pointwise import pointwise_motion
from estimation.measurement_model import HarmonicMotion
from estimation.processing import NoiseModel, PeriodError, Record, make_record
from expdesign.configuration import InputError, RunConfiguration
from expdesign.robot import Robot
from expdesign.trajectory import FourierTrajectory

_CUTOFF = 3.0
"""Cutoff of the Butterworth filter in units of the highest frequency of the motion."""

_RESIDUAL_ROUNDS = 3


def prepare_experiment(
    configuration: RunConfiguration,
    robot: Robot,
    data: Measurement,
    design: FourierTrajectory | None,
) -> Experiment:
    """Return one recording with its noise and motion, ready for the estimators."""
    return prepare_recording(configuration, robot, data, design).experiment


def prepare_recording(
    configuration: RunConfiguration,
    robot: Robot,
    data: Measurement,
    design: FourierTrajectory | None,
) -> RecordSummary:
    """Return one recording ready for the estimators, and how it was made so.

    Raises
    ------
    InputError
        The configuration does not fit the recording.
    UnsuitableDataError
        The recording cannot be used: no period, a dead channel.
    MotionFitError
        No motion has the measured lengths.
    """
    section = configuration.run.estimate
    omega, source = choose_omega(configuration, data, design)
    free = section.frequency == "estimated"
    try:
        record = make_record(data, omega, source, average=not free, robust=section.loss == "huber")
    except PeriodError as error:
        file = Path(data.source) if data.source else None
        raise UnsuitableDataError(str(error), file) from error
    noise = choose_noise(configuration, record, data.source)
    if section.differentiation != "fourier":
        motion = pointwise_motion(robot, record, cutoff=_cutoff(configuration, record, design))
        # Differences of neighbours end with the samples that they have.
        experiment = Experiment.from_points(robot, record, noise.taken_for_white(), motion)
        return RecordSummary(data.source, experiment, None, data.jitter)
    least = 1 if design is None else design.harmonics
    noise, fit = _fitted(configuration, robot, record, noise, design, least)
    warning = (
        "" if free else period_warning(robot, data, record, fit.motion, noise.lengths.covariance)
    )
    return RecordSummary(
        data.source,
        Experiment.from_fit(robot, record, noise, fit),
        least if section.harmonics is None else None,
        data.jitter,
        (warning,) if warning else (),
    )


def _cutoff(
    configuration: RunConfiguration, record: Record, design: FourierTrajectory | None
) -> float | None:
    section = configuration.run.estimate
    if section.differentiation != "butterworth":
        return None
    highest = configuration.run.trajectory.harmonics if design is None else design.harmonics
    cutoff = section.cutoff or _CUTOFF * highest / record.period
    if cutoff >= 0.5 / record.step:
        raise InputError(
            f"a cutoff of {cutoff:.4g} Hz is not below half the sampling rate, "
            f"{0.5 / record.step:.4g} Hz",
            file=configuration.file,
            key="estimate.cutoff",
            allowed="a lower frequency, or faster sampling",
        )
    return cutoff


def _fitted(
    configuration: RunConfiguration,
    robot: Robot,
    record: Record,
    noise: NoiseModel,
    design: FourierTrajectory | None,
    least: int,
) -> tuple[NoiseModel, MotionFit]:
    section = configuration.run.estimate
    fitting = choose_harmonics if section.harmonics is None else fit_motion
    start = _start(robot, record, design)
    # A Δ that nobody knows comes from the fit that it weights: a few rounds settle both.
    rounds = _RESIDUAL_ROUNDS if noise.lengths.includes_model_error else 1
    for remaining in reversed(range(rounds)):
        fit = fitting(
            robot,
            record,
            noise.lengths.covariance,
            section.harmonics or least,
            start=start,
            free_frequency=section.frequency == "estimated",
            noise_filter=noise.lengths.filter,
        )
        if noise.lengths.includes_model_error:
            found = residual_noise(fit.residuals, record.lengths.counts, len(fit.covariance))
            noise = replace(noise, lengths=found)
        if remaining:
            start = fit.motion
    return noise, fit


def _start(robot: Robot, record: Record, design: FourierTrajectory | None) -> HarmonicMotion:
    harmonics = 5 if design is None else design.harmonics
    try:
        return start_motion(robot, record, harmonics)
    except MotionFitError:
        if design is None:
            raise
        # Lengths this noisy may have no pose one by one; the designed motion is near.
        return HarmonicMotion.of(design)
