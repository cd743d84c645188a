"""Preparation of a recording for the estimators: period, means, noise and motion.

Friction proportional to the load makes the forces a product of two unknowns. With a given load they
are linear; with the load of the nominal parameters, the estimate would contain their error.
`linearise_at_load` therefore takes the load of a Gauss–Markov estimate, and once more that of the
next: each round reduces the load's error by the factor μ, a few per cent. The remaining error, that
of an estimate, adds a share of the same relative size to the covariance; it is neglected.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from constraints.arrays import Array
from estimation.channels.check import ChannelCheck, check_channels
from estimation.channels.lag import slow_low_pass_warning
from estimation.data.measurement import Measurement
from estimation.estimators import Experiment, ParameterPriors, linear_estimate
from estimation.estimators.experiment import MotionEstimate
from estimation.identification import periods
from estimation.identification.harmonics import recorded_noise, refine_motion, weigh_signs
from estimation.identification.single_shot import estimate_noise, fit_spline
from estimation.kinematics import (
    MotionFit,
    MotionFitError,
    NoMotionFoundError,
    choose_harmonics,
    fit_motion,
    length_equations,
    pointwise_motion,
    start_motion,
)
from estimation.measurement_model import HarmonicMotion, Motion
from estimation.processing import (
    NoiseEstimate,
    NoiseModel,
    PeriodError,
    PeriodicRecording,
    PeriodSource,
    fold_recording,
    single_recording,
)
from estimation.processing.noise import ENOUGH_FREEDOM
from estimation.processing.spectrum import NoiseLines, given_filter
from estimation.splines import smooth_channels
from expdesign.configuration import InputError, RunConfiguration
from expdesign.configuration.estimate import SpectrumOrigin
from expdesign.noise import NoiseSpectrum
from expdesign.recheck.followed_lengths import raised_harmonics, sampled_harmonics
from expdesign.robot import Robot
from expdesign.robot.deviation import low_passes, toleranced_deviations
from expdesign.trajectory import FourierTrajectory

_CUTOFF = 3.0
"""Cutoff of the Butterworth filter in units of the highest frequency of the motion."""
_COPIED = 1 - 1e-6
"""Correlation of the noise of two channels from which on one is a copy of the other."""
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
    folded: tuple[PeriodicRecording, NoiseModel] | None = None,
    estimated: Motion | None = None,
) -> PreparedRecording:
    """Return one recording ready for the estimators, with warnings.

    With held-out forces, which are predicted, the motion comes from the lengths alone. `folded` is
    the result of `fold_measurement`, if it is known. The fit begins at an `estimated` motion
    and has as many harmonics.

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
    recording, noise = folded or fold_measurement(configuration, data, design)
    if recording.source is PeriodSource.NONE:
        known = None if noise.lengths.includes_model_error else noise.lengths
        fit, lengths = fit_spline(robot, recording, known)
        noise = replace(noise, lengths=lengths)
        experiment = Experiment.from_fit(robot, recording, noise, fit).without_lacking_terms(robot)
        if not held_out:
            priors = ParameterPriors.of(robot, section)
            experiment = estimate_noise(robot, experiment, priors, section.spectrum)
        return PreparedRecording(data.source, experiment, None, data.jitter)
    if section.pointwise:
        motion = pointwise_motion(
            robot, recording, cutoff=_cutoff(configuration, recording, design)
        )
        # Pointwise differentiation does not use the spectrum.
        experiment = Experiment.from_points(robot, recording, noise.as_white(), motion)
        return PreparedRecording(data.source, experiment, None, data.jitter)
    at = estimated if isinstance(estimated, HarmonicMotion) else None
    experiment, fit, fewest, scarce = _fit_motion(
        configuration, robot, recording, noise, design, at
    )
    warnings = [scarce]
    if section.frequency != "estimated":
        own = experiment.noise.lengths.covariance
        warnings.append(periods.period_warning(robot, data, recording, fit.series, own))
    if fit.wanted is not None:
        warnings.append(
            f"no motion of the machine described has the {fit.wanted} harmonics that lengths or "
            "tolerances ask for: joints or zeros of lengths are elsewhere than stated. The motion "
            f"is taken with {fit.motion.harmonics}"
        )
    warnings += [
        f"the noise of the {name} has passed the filter that `data` states: from "
        f"{channels.kept / recording.period:.3g} Hz on they are left out"
        for name, channels in (("forces", recording.forces), ("lengths", recording.lengths))
        if channels.kept is not None
    ]
    stated = {each.name: each.tolerance for each in low_passes(robot)}
    warnings.append(slow_low_pass_warning(robot, fit.series, stated))
    if held_out:
        experiment = experiment.for_estimator("gm")
    else:
        priors = ParameterPriors.of(robot, section)
        experiment = weigh_signs(robot, experiment, priors)
        if fewest is not None:
            whole = refine_motion(robot, experiment, priors)
            experiment = replace(experiment, refined_motion=whole)
    found = tuple(filter(None, warnings))
    return PreparedRecording(data.source, experiment, fewest, data.jitter, found)


def fold_measurement(
    configuration: RunConfiguration, data: Measurement, design: FourierTrajectory | None
) -> tuple[PeriodicRecording, NoiseModel]:
    """Fold a recording into periods, and choose the noise of its channels.

    A recording without a period remains as it is, if the run's settings do not need one.
    """
    recording = fold_periods(configuration, data, design)
    noise = choose_noise(configuration, recording, data.file)
    return recording.as_weighted(noise), noise


def fold_periods(
    configuration: RunConfiguration, data: Measurement, design: FourierTrajectory | None
) -> PeriodicRecording:
    """Fold a recording into periods, without its noise; see `fold_measurement`."""
    section = configuration.run.estimate
    average, robust = section.frequency != "estimated", section.loss == "huber"
    optional = section.differentiation == "auto" and average and not robust
    optional = optional and section.harmonics is None and not data.has_sensors
    try:
        if section.differentiation == "spline":
            return single_recording(data)
        try:
            omega, source = periods.choose_omega(configuration, data, design)
            return fold_recording(data, omega, source, average=average, robust=robust)
        except (periods.NoPeriodError, PeriodError):
            if not optional:
                raise
            return single_recording(data)
    except PeriodError as error:
        raise periods.UnsuitableDataError(str(error), data.file) from error


def check_recording(
    configuration: RunConfiguration,
    robot: Robot,
    folded: tuple[PeriodicRecording, NoiseModel],
    design: FourierTrajectory | None,
    *,
    has_units: Collection[str] = (),
) -> ChannelCheck:
    """Check the channels of a folded recording.

    `has_units` are the groups of channels whose units the recording's file has. A recording without
    a period is not compared with a design.
    """
    planned = configuration.run.trajectory.harmonics if design is None else design.harmonics
    harmonics: int | None = configuration.run.estimate.harmonics or planned
    if folded[0].source is PeriodSource.NONE:
        harmonics, design = None, None
    section = configuration.run.data
    return check_channels(robot, section, *folded, harmonics, design, has_units=has_units)


@dataclass(frozen=True, eq=False)
class PreparedRecording:
    """One recording, ready for the estimators."""

    source: str
    experiment: Experiment
    fewest_harmonics: int | None
    """The fewest harmonics that were tried; None for a given number."""
    jitter: float
    """Of the time stamps, as a share of a step."""
    warnings: tuple[str, ...] = ()

    @property
    def harmonics(self) -> int | None:
        """Harmonics of the fitted motion, with raised ones; None if it is no Fourier series."""
        fit = self.experiment.fit
        return None if fit is None else fit.motion.harmonics


def _cutoff(
    configuration: RunConfiguration, recording: PeriodicRecording, design: FourierTrajectory | None
) -> float | None:
    section = configuration.run.estimate
    if section.differentiation != "butterworth":
        return None
    highest = configuration.run.trajectory.harmonics if design is None else design.harmonics
    cutoff = section.cutoff or _CUTOFF * highest / recording.period
    if cutoff >= 0.5 / recording.step:
        raise InputError(
            f"a cutoff of {cutoff:.4g} Hz is not below half the sampling rate, "
            f"{0.5 / recording.step:.4g} Hz",
            file=configuration.file,
            key="estimate.cutoff",
            allowed="a lower frequency, or faster sampling",
        )
    return cutoff


def _fit_motion(
    configuration: RunConfiguration,
    robot: Robot,
    recording: PeriodicRecording,
    noise: NoiseModel,
    design: FourierTrajectory | None,
    estimated: HarmonicMotion | None,
) -> tuple[Experiment, MotionFit, int | None, str]:
    """Return the experiment along its motion, with the harmonics that lengths and tolerances need.

    A motion that is estimated already is where the fit begins, and has its number. Returned with
    the fit to the lengths, the fewest harmonics that were tried (those of the design, or more where
    tolerances of joints allow them; None for a given number), and a warning if a period has too few
    samples for these harmonics, otherwise empty.
    """
    section = configuration.run.estimate
    expected = configuration.run.trajectory.harmonics if design is None else design.harmonics
    free = section.frequency == "estimated"
    start = estimated or _start(robot, recording, design, expected)
    start = replace(start, free_frequency=free)
    least, scarce = 1 if design is None else expected, ""
    given = section.harmonics if estimated is None else estimated.harmonics
    fitting: Callable[..., MotionFit]
    if estimated is not None:
        fitting = _fit_near
    elif given is not None:
        fitting = partial(fit_motion, harmonics=given)
    else:
        raised = least
        if section.systematic != "none" and toleranced_deviations(robot):
            raised = _raised_harmonics(robot, recording, noise, design, start)
        most = sampled_harmonics(recording.period / recording.step)
        if raised > max(least, most):
            scarce = (
                f"within the tolerances of the robot the motion may have {raised} harmonics, and "
                f"{recording.period / recording.step:.0f} samples of a period show {most}: "
                f"measure with at least {4 * raised + 1} samples of a period"
            )
        fewest, least = least, max(least, min(raised, most))
        fitting = partial(_choose_motion, fewest=fewest, least=least, expected=expected)
    # An unknown Δ comes from the fit that it weights: a few iterations settle both.
    rounds = _RESIDUAL_ROUNDS if noise.lengths.includes_model_error else 1
    for remaining in reversed(range(rounds)):
        try:
            fit = fitting(robot, recording, noise.lengths, start=start)
        except NoMotionFoundError:
            if noise.lengths.filter is None:
                raise
            # Deviations that repeat in no period, as with a wrong clock, are not noise: their
            # spectrum is no weight.
            noise = noise.as_white()
            fit = fitting(robot, recording, noise.lengths, start=start)
        if noise.lengths.includes_model_error:
            lengths = recording.lengths
            rest = lengths.as_recorded(fit.residuals)
            found = residual_noise(rest, lengths.counts, fit.motion.unknowns)
            noise = replace(noise, lengths=lengths.noise_before_sensors(found))
        if remaining:
            start = fit.series
    experiment = Experiment.from_fit(robot, recording, noise, fit).without_lacking_terms(robot)
    if given is None and fewest < least <= fit.series.harmonics:
        known = _fit_lengths(robot, recording, noise.lengths, fit, fewest, expected)
        if known is not None:
            linear = MotionEstimate.of(robot, recording, known.motion, known.covariance)
            experiment = replace(experiment, linear_motion=linear).of_robot(robot)
    tried = None if given else min(least, fit.series.harmonics)
    return experiment, fit, tried, scarce


def _fit_lengths(
    robot: Robot,
    recording: PeriodicRecording,
    noise: NoiseEstimate,
    fit: MotionFit,
    fewest: int,
    expected: int,
) -> MotionFit | None:
    """Fit the motion of LS and GM, with the harmonics that the lengths show; None: all of them."""
    shorter = fit.series.with_harmonics(expected)
    try:
        found = choose_harmonics(robot, recording, noise, fewest, expected=expected, start=shorter)
    except NoMotionFoundError:
        there = length_equations(robot, recording, noise, shorter)
        return MotionFit.of(robot, recording, shorter, there)
    return found if found.series.harmonics < fit.series.harmonics else None


def _fit_near(
    robot: Robot,
    recording: PeriodicRecording,
    noise: NoiseEstimate,
    *,
    start: HarmonicMotion,
) -> MotionFit:
    """Fit a motion near an estimated one; without success, as after ML without, return this one."""
    try:
        return fit_motion(robot, recording, noise, start.harmonics, start=start)
    except NoMotionFoundError:
        there = length_equations(robot, recording, noise, start)
        return MotionFit.of(robot, recording, start, there)


def _choose_motion(
    robot: Robot,
    recording: PeriodicRecording,
    noise: NoiseEstimate,
    *,
    fewest: int,
    least: int,
    **options: Any,
) -> MotionFit:
    """Fit a motion with at least `least` harmonics, or with the fewest if there is none."""
    choose = partial(choose_harmonics, robot, recording, noise, **options)
    try:
        return choose(least=least)
    except NoMotionFoundError:
        if least == fewest:
            raise
    fit = choose(least=fewest)
    return replace(fit, wanted=max(least, fit.wanted or 0))


def _raised_harmonics(
    robot: Robot,
    recording: PeriodicRecording,
    noise: NoiseModel,
    design: FourierTrajectory | None,
    start: HarmonicMotion,
) -> int:
    """Return the harmonics of the motion, with those that the robot's tolerances can raise."""
    if design is None:
        white, known = noise.lengths.as_white(), replace(start, free_frequency=False)
        expected = start.harmonics
        start = choose_harmonics(robot, recording, white, 1, expected=expected, start=known).series
    return raised_harmonics(robot, start.trajectory, recorded_noise(recording, noise))


def _start(
    robot: Robot, recording: PeriodicRecording, design: FourierTrajectory | None, harmonics: int
) -> HarmonicMotion:
    try:
        return start_motion(robot, recording, harmonics)
    except MotionFitError:
        if design is None:
            raise
        # Lengths this noisy may have no pose one by one; the designed motion is near.
        return HarmonicMotion.of(design)


_FEWEST_FREEDOM = 14.0
"""Fewest degrees of freedom of a scatter as weight: with less its inverse is twice too large."""


def choose_noise(
    configuration: RunConfiguration, recording: PeriodicRecording, file: Path | None = None
) -> NoiseModel:
    """Choose Σ and Δ of one sample.

    In this order: the scatter between periods, if it has 250 degrees of freedom, (M − 1) N; the
    noise of robot or run; the scatter with fewer degrees of freedom; the residuals about a Fourier
    series, preliminary covariances that the residuals of the fits replace (`residual_noise`).
    Forces and lengths are treated separately. A recording without a period shows its noise in the
    residuals about splines; a stated one counts with ``given`` alone.

    Raises
    ------
    InputError
        The noise that `estimate.noise` asks for is not available.
    UnsuitableDataError
        A channel does not vary.
    """
    section, noise = configuration.run.estimate, configuration.robot.noise
    measured = {"force": recording.forces, "length": recording.lengths}
    single = recording.source is PeriodSource.NONE
    given = {kind: getattr(noise, f"{kind}_covariance", None) for kind in measured}
    missing = [f"{kind}s" for kind, covariance in given.items() if covariance is None]
    if section.noise == "given" and missing:
        raise InputError(
            "estimate.noise is 'given', but robot and run do not state the noise of "
            f"the {missing[0]}",
            file=configuration.file,
            key="noise",
            allowed="force_std and length_std, or force_covariance and length_covariance",
        )
    if section.noise == "estimated" and any(each.scatter is None for each in measured.values()):
        raise InputError(
            f"estimate.noise is 'estimated', but {recording.periods:.3g} periods do not show the "
            "scatter between periods",
            file=configuration.file,
            key="estimate.noise",
            allowed="at least 2 periods, or noise: given",
        )

    def choose(kind: str, letter: str) -> NoiseEstimate:
        channels, stated = measured[kind], given[kind]
        repeated, least = channels.scatter, _FEWEST_FREEDOM if stated is None else ENOUGH_FREEDOM
        if repeated is not None and (
            section.noise == "estimated" or (section.noise != "given" and repeated.freedom >= least)
        ):
            _refuse_singular(letter, repeated, file)
            return channels.noise(section.spectrum) or repeated
        if stated is not None and (not single or section.noise == "given"):
            found = NoiseEstimate(stated, np.inf, "given")
        elif single:
            found = smooth_channels(channels.times, channels.values).scatter
        else:
            # Means over periods scatter less than single samples, whose covariance this is.
            seen = replace(channels, values=channels.as_recorded(channels.values))
            first, _ = recording.fit_series(seen)
            covariance = first.covariance * float(np.mean(channels.counts))
            found = NoiseEstimate(covariance, first.freedom, "residuals")
        _refuse_singular(letter, found, file)
        spectrum = getattr(noise, f"{kind}_spectrum", None)
        if stated is not None and spectrum is not None and channels.repeats is not None:
            found = with_stated_spectrum(found, spectrum, recording, section.spectrum)
        return channels.noise_before_sensors(found)

    lengths = choose("length", "q")
    return NoiseModel(choose("force", "Q"), lengths)


def with_stated_spectrum(
    noise: NoiseEstimate,
    stated: NoiseSpectrum,
    recording: PeriodicRecording,
    origin: SpectrumOrigin = "auto",
) -> NoiseEstimate:
    """Add a known spectrum to the noise, at the multiples of the motion's ω.

    Raises
    ------
    UnsuitableDataError
        The spectrum ends below half of the sampling frequency.
    """
    sampling, samples = 1 / recording.step, recording.samples
    if not stated.covers(sampling):
        raise periods.UnsuitableDataError(
            f"the spectrum given for the noise ends at a sampling of {stated.highest:g} Hz, the "
            f"recording has {sampling:g} Hz",
            allowed="a spectrum of this sampling, or estimate.noise: estimated",
        )
    count = samples // 2 + 1
    matrices = stated.harmonics(1 / recording.period, count, sampling, recording.rows).value
    lines = NoiseLines(matrices.astype(np.complex128), samples, np.inf)
    weights = None if origin == "white" else given_filter(noise.covariance, lines.matrices, samples)
    return replace(noise, lines=lines, filter=weights)


def _refuse_singular(letter: str, noise: NoiseEstimate, file: Path | None) -> None:
    """Refuse channels without noise, or with the noise of another channel."""
    if still := [f"{letter}{j + 1}" for j in np.flatnonzero(noise.still)]:
        message = f"{', '.join(still)}: the recording shows no noise at all in this channel"
    elif noise.is_singular:
        std = np.sqrt(np.diag(noise.covariance))
        alike = np.abs(noise.covariance) > _COPIED * np.outer(std, std)
        pairs = [f"{letter}{i + 1} and {letter}{j + 1}" for i, j in np.argwhere(np.triu(alike, 1))]
        message = (
            f"{', '.join(pairs)} have the same noise"
            if pairs
            else f"the noise of {letter}1 … {letter}6 is not that of six independent sensors"
        )
    else:
        return
    allowed = "six channels that were measured, or noise: given"
    raise periods.UnsuitableDataError(message, file, allowed=allowed)


def residual_noise(residuals: Array, counts: Array, used: int) -> NoiseEstimate:
    """Return the covariance of the residuals, (R, 6), of a fit with `used` parameters.

    `counts` are the numbers of samples in the rows, (R,), or in those of the recording, (S,).
    """
    freedom = max(len(residuals) - used / residuals.shape[1], 1.0)
    weights = counts if len(counts) == len(residuals) else np.full(len(residuals), np.mean(counts))
    covariance = (residuals * weights[:, None]).T @ residuals / freedom
    return NoiseEstimate(covariance, freedom, "residuals")


_ROUNDS = 2


def linearise_at_load(
    robot: Robot, experiments: Sequence[Experiment], priors: ParameterPriors
) -> tuple[Robot, tuple[Experiment, ...]]:
    """Return the robot with its friction at the estimated load, and the experiments with its A.

    Without a term that depends on the load both are returned unchanged.
    """
    present = tuple(experiments)
    if not robot.extended.graph.loaded:
        return robot, present
    for _ in range(_ROUNDS):
        robot = robot.with_load_at(linear_estimate(robot, present, priors, "gm").values)
        present = tuple(experiment.of_robot(robot) for experiment in present)
    return robot, present


def with_residual_noise(
    robot: Robot,
    experiments: Sequence[Experiment],
    priors: ParameterPriors,
    origin: SpectrumOrigin = "auto",
) -> tuple[Experiment, ...]:
    """Return the experiments with an unknown Σ estimated from Gauss–Markov residuals."""
    present = [
        estimate_noise(robot, each, priors, origin)
        if each.recording.source is PeriodSource.NONE
        else each
        for each in experiments
    ]
    used = int(np.count_nonzero(priors.free)) // len(present)
    unknown = [
        n
        for n, e in enumerate(present)
        if e.noise.forces.includes_model_error and e.recording.source is not PeriodSource.NONE
    ]
    for _ in range(_ROUNDS if unknown else 0):
        values = linear_estimate(robot, present, priors, "gm").values
        for number in unknown:
            experiment = present[number]
            rest = experiment.forces - experiment.fitted_regressors @ values
            forces = experiment.recording.forces
            own = residual_noise(forces.as_recorded(rest), forces.counts, used)
            noise = replace(experiment.noise, forces=forces.noise_before_sensors(own))
            present[number] = replace(experiment, noise=noise)
    return tuple(present)
