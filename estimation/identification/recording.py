"""Preparation of a recording for the estimators: period, means, noise and motion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from estimation.data.measurement import Measurement
from estimation.estimators import Experiment, ParameterPriors
from estimation.identification.harmonics import whole_motion
from estimation.identification.noise_choice import choose_noise, residual_noise
from estimation.identification.periods import (
    UnsuitableDataError,
    choose_omega,
    period_warning,
)
from estimation.kinematics.fourier_fit import (
    MotionFit,
    MotionFitError,
    NoMotionFoundError,
    choose_harmonics,
    fit_motion,
    start_motion,
)
from estimation.kinematics.pointwise import pointwise_motion
from estimation.measurement_model import HarmonicMotion
from estimation.processing import NoiseModel, PeriodError, PeriodicRecording, fold_recording
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
    *,
    held_out: bool = False,
) -> Experiment:
    """Return one recording with its noise and motion, ready for the estimators.

    With held-out forces, which are predicted, the motion comes from the lengths alone.
    """
    return prepare_recording(configuration, robot, data, design, held_out=held_out).experiment


def prepare_recording(
    configuration: RunConfiguration,
    robot: Robot,
    data: Measurement,
    design: FourierTrajectory | None,
    *,
    held_out: bool = False,
) -> PreparedRecording:
    """Return one recording ready for the estimators, with warnings.

    With held-out forces, which are predicted, the motion comes from the lengths alone.

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
        record = fold_recording(
            data, omega, source, average=not free, robust=section.loss == "huber"
        )
    except PeriodError as error:
        file = Path(data.source) if data.source else None
        raise UnsuitableDataError(str(error), file) from error
    noise = choose_noise(configuration, record, data.source)
    record = record.behind(noise)
    if section.differentiation != "fourier":
        motion = pointwise_motion(robot, record, cutoff=_cutoff(configuration, record, design))
        # Pointwise differentiation does not use the spectrum.
        experiment = Experiment.from_points(robot, record, noise.taken_for_white(), motion)
        return PreparedRecording(data.source, experiment, None, data.jitter)
    noise, fit = _fitted(configuration, robot, record, noise, design)
    warnings = []
    if not free:
        own = noise.lengths.covariance
        warnings.append(period_warning(robot, data, record, fit.motion, own))
    if fit.wanted is not None:
        warnings.append(
            f"the lengths show {fit.wanted} harmonics, but no motion of the machine described has "
            "so many: joints or zeros of lengths are elsewhere than stated. The motion is taken "
            f"with {fit.motion.harmonics}"
        )
    experiment = Experiment.from_fit(robot, record, noise, fit)
    if section.harmonics is None and not held_out:
        whole = whole_motion(robot, experiment, ParameterPriors.of(robot, section))
        experiment = replace(experiment, refined_motion=whole)
    return PreparedRecording(
        data.source,
        experiment,
        _least(design) if section.harmonics is None else None,
        data.jitter,
        tuple(filter(None, warnings)),
    )


@dataclass(frozen=True, eq=False)
class PreparedRecording:
    """One recording, ready for the estimators."""

    source: str
    experiment: Experiment
    least_harmonics: int | None
    """The fewest harmonics that were tried; None for a given number."""
    jitter: float
    """Of the time stamps, as a share of a step."""
    warnings: tuple[str, ...] = ()

    @property
    def harmonics(self) -> int | None:
        """Harmonics of the fitted motion; None after pointwise differentiation."""
        fit = self.experiment.fit
        return None if fit is None else fit.motion.harmonics

    @property
    def harmonics_of_forces(self) -> int | None:
        """Harmonics of the motion that ML estimates, supported by forces and lengths together."""
        return self.experiment.harmonics


def _least(design: FourierTrajectory | None) -> int:
    """Return the least number of harmonics of the motion."""
    return 1 if design is None else design.harmonics


def _cutoff(
    configuration: RunConfiguration, record: PeriodicRecording, design: FourierTrajectory | None
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
    record: PeriodicRecording,
    noise: NoiseModel,
    design: FourierTrajectory | None,
) -> tuple[NoiseModel, MotionFit]:
    section = configuration.run.estimate
    expected = configuration.run.trajectory.harmonics if design is None else design.harmonics
    fitting = partial(choose_harmonics, least=_least(design), expected=expected)
    if section.harmonics is not None:
        fitting = partial(fit_motion, harmonics=section.harmonics)
    start = _start(robot, record, design, expected)
    # An unknown Δ comes from the fit that it weights: a few iterations settle both.
    rounds = _RESIDUAL_ROUNDS if noise.lengths.includes_model_error else 1
    for remaining in reversed(range(rounds)):
        fitted = partial(
            fitting,
            robot,
            record,
            noise.lengths.covariance,
            start=start,
            free_frequency=section.frequency == "estimated",
        )
        try:
            fit = fitted(noise_filter=noise.lengths.filter)
        except NoMotionFoundError:
            if noise.lengths.filter is None:
                raise
            # What repeats in no period, as with a clock that is off, is no noise: its spectrum
            # is nothing to weight with.
            noise = noise.taken_for_white()
            fit = fitted()
        if noise.lengths.includes_model_error:
            found = residual_noise(fit.residuals, record.lengths.counts, len(fit.covariance))
            noise = replace(noise, lengths=found)
        if remaining:
            start = fit.motion
    return noise, fit


def _start(
    robot: Robot, record: PeriodicRecording, design: FourierTrajectory | None, harmonics: int
) -> HarmonicMotion:
    try:
        return start_motion(robot, record, harmonics)
    except MotionFitError:
        if design is None:
            raise
        # Lengths this noisy may have no pose one by one; the designed motion is near.
        return HarmonicMotion.of(design)
