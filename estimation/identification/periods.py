"""Choice of the period of a recording: from the design, the file, the run, or the data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from constraints.arrays import Array
from estimation.data.measurement import Measurement
from estimation.measurement_model import HarmonicMotion
from estimation.processing import PeriodicRecording, fold_recording
from estimation.processing.period import (
    NotRepeatedError,
    PeriodError,
    PeriodSource,
    changes_after,
    choose_omega_at_rest,
    find_motion_onset,
    find_periodic_window,
    find_settled_window,
    is_at_rest,
    omega_error,
    omega_from_column,
    omega_from_data,
    refine_omega,
    resolution_only,
)
from expdesign.configuration import InputError, RunConfiguration
from expdesign.robot import Robot
from expdesign.trajectory import FourierTrajectory


class UnsuitableDataError(InputError):
    """The recording cannot be used; another one may be."""


class NoPeriodError(UnsuitableDataError):
    """The lengths do not repeat, and no period is stated."""


_FREQUENCY_REACH = 0.02
"""Largest relative clock error for which the frequency is estimated."""
_CLEARLY_OFF = 5.0
"""Standard errors of a clock error that is examined."""
_LOOK = 0.05
"""Relative range of the search for a clock error."""
_FEWEST_MARKED = 3
"""Fewest numbers in a period column: fewer do not mark both ends of a period."""
_MOST = 0.9
_REPEATS = 0.5
"""Largest difference between a sample and the one a period later, as a share of the motion."""
_COARSEST = 0.5
"""Largest step of the samples, as a share of the period."""
_ON_TIME = 1e-9
"""Rounding of a sample time, as a share of a period."""


def leave_out_ramps(
    configuration: RunConfiguration, data: Measurement, design: FourierTrajectory | None
) -> Measurement:
    """Return the whole periods of a recording between lead-in and lead-out, with a warning.

    A recording without such ramps, or without a period, is returned as it is, and all of it for
    a spline. So are whole periods at the ends of a recording that a stated filter has spoilt.
    """
    if configuration.run.estimate.differentiation == "spline":
        return data
    try:
        omega, _ = choose_omega(configuration, data, design, ramps=True)
    except UnsuitableDataError:
        return data
    window, what = find_periodic_window(data, omega), "rows of lead-in, lead-out or rests"
    if window is None and data.has_sensors:
        window = find_settled_window(data, omega)
        what = "periods at the ends, at which the filter of the recording had not settled,"
    if window is None:
        return data
    periods = data.between(*window)
    keys = " and ".join(f"`data.{key}: {value}`" for key, value in window_keys(periods).items())
    warning = f"{what} are left out: {keys}"
    return replace(periods, content=data.content, warnings=(*periods.warnings, warning))


def window_keys(periods: Measurement) -> dict[str, str]:
    """Return the keys of `data` that select the rows of a measurement."""
    window = {"start": periods.time[0], "end": periods.time[-1] + periods.step}
    return {key: f"{round(float(value), 6):.12g} s" for key, value in window.items()}


def choose_omega(
    configuration: RunConfiguration,
    data: Measurement,
    design: FourierTrajectory | None,
    *,
    ramps: bool = False,
) -> tuple[float, PeriodSource]:
    """Return the base frequency ω, rad/s, and its source.

    With `ramps` it suffices that the data repeat between lead-in and lead-out.

    Raises
    ------
    UnsuitableDataError
        No period is known or found, or the data do not repeat with it.
    """
    low, high = configuration.run.trajectory.frequency
    try:
        if design is not None:
            omega, source = design.omega, PeriodSource.DESIGN
        elif data.period is not None and len(np.unique(data.period)) >= _FEWEST_MARKED:
            omega, source = omega_from_column(data), PeriodSource.COLUMN
        elif low == high:
            omega, source = 2 * np.pi * low, PeriodSource.FREQUENCY
        else:
            omega, source = omega_from_data(data), PeriodSource.DATA
    except NotRepeatedError as error:
        raise _unsuitable(data, str(error), NoPeriodError) from error
    except PeriodError as error:
        raise _unsuitable(data, str(error)) from error
    period = 2 * np.pi / omega
    if data.step > _COARSEST * period:
        message = (
            f"samples every {data.step:.4g} s are too far apart for the {source.value}'s period of "
            f"{period:.6g} s: the time has another unit"
        )
        allowed = "data.units: {t: …}, its unit in the file"
        raise UnsuitableDataError(message, data.file, allowed=allowed)
    if configuration.run.estimate.frequency == "estimated" and source is not PeriodSource.DATA:
        omega = refine_omega(data, omega, _FREQUENCY_REACH)
    if source is not PeriodSource.DATA and not (ramps and find_periodic_window(data, omega)):
        _refuse_other_period(data, omega, source)
    return float(omega), source


def _refuse_other_period(data: Measurement, omega: float, source: PeriodSource) -> None:
    """Refuse a period if the lengths do not repeat with it."""
    period = 2 * np.pi / omega
    difference = changes_after(data, period)
    if len(difference) < max(2, 0.1 * period / data.step):
        return
    # Quantiles: robust against outliers, and against a machine that rests for most of the period.
    off = np.quantile(np.abs(difference - np.median(difference, axis=0)), _MOST, axis=0)
    moving = np.quantile(np.abs(data.lengths - np.median(data.lengths, axis=0)), _MOST, axis=0)
    if np.median(off) <= _REPEATS * np.median(moving):
        return
    try:
        seen = f"; the lengths repeat after {2 * np.pi / omega_from_data(data):.6g} s"
    except PeriodError:
        seen = "; no other period was found either"
    raise _unsuitable(
        data, f"the lengths do not repeat with the {source.value}'s period of {period:.6g} s{seen}"
    )


def period_warning(
    robot: Robot,
    data: Measurement,
    recording: PeriodicRecording,
    motion: HarmonicMotion,
    covariance: Array,
) -> str:
    """Return a warning about a wrong period of the design or the run; empty without one.

    The motion was fitted with that period; the covariance is Δ of one sample, (6, 6), m².

    Raises
    ------
    UnsuitableDataError
        The difference is too large for a clock error.
    """
    if recording.source not in (PeriodSource.DESIGN, PeriodSource.FREQUENCY):
        return ""
    error, std = clock_error(robot, recording, motion, covariance)
    duration = recording.periods * recording.period
    if abs(error) < _CLEARLY_OFF * std or abs(error) * duration < recording.step:
        return ""
    off = refine_omega(data, recording.omega, _LOOK) / recording.omega - 1
    if abs(off) * duration < recording.step:
        return ""
    seen = _repeats_in_words(recording.period, off, recording.source)
    if abs(off) > _FREQUENCY_REACH:
        raise _unsuitable(data, seen)
    return f"{seen} ({100 * off:+.3g} % in frequency): use `estimate.frequency: estimated`"


def _repeats_in_words(period: float, off: float, source: PeriodSource) -> str:
    """Return the period of the lengths and that of the source, whose frequency they exceed."""
    return (
        f"the lengths repeat after {period / (1 + off):.7g} s, the {source.value}'s period is "
        f"{period:.7g} s"
    )


def with_clock(
    configuration: RunConfiguration, data: Measurement, design: FourierTrajectory | None
) -> tuple[RunConfiguration, str]:
    """Return the run with the frequency that the lengths have, and a sentence on the difference.

    The sentence is empty where the lengths do not contradict the frequency of the design or the
    run, by more than a step within the recording, or where they contradict more than a clock.
    """
    try:
        omega, source = choose_omega(configuration, data, design)
    except UnsuitableDataError:
        return configuration, ""
    section = configuration.run.estimate
    stated = source in (PeriodSource.DESIGN, PeriodSource.FREQUENCY)
    if section.frequency == "estimated" or section.differentiation == "spline" or not stated:
        return configuration, ""
    refined = refine_omega(data, omega, _LOOK)
    off, error = refined / omega - 1, omega_error(data, refined) / omega
    least = max(_CLEARLY_OFF * error, data.step / float(np.ptp(data.time)))
    if not least < abs(off) <= _FREQUENCY_REACH:
        return configuration, ""
    sentence = (
        f"the clocks of the recording and of the {source.value} differ by {100 * abs(off):.3g} ± "
        f"{100 * error:.1g} %: {_repeats_in_words(2 * np.pi / omega, off, source)}"
    )
    return configuration.with_section("estimate", frequency="estimated"), sentence


def clock_error(
    robot: Robot, recording: PeriodicRecording, motion: HarmonicMotion, covariance: Array
) -> tuple[float, float]:
    """Return the relative clock error of the recording against `motion`, and its std.

    With a frequency error of the share ε the periods are shifted against each other: at time t the
    lengths are l(t) + ε t l̇(t). The part that grows from period to period remains in the residuals
    of a fitted motion; its slope is ε. The motion was fitted with the frequency in question; the
    covariance is Δ of one sample, (6, 6), m².

    Notes
    -----
    First order: valid for shifts of a small part of a period. With less than two periods the std is
    inf.
    """
    pose, rate, _ = np.split(motion.at(recording.lengths.times).state(), 3, axis=1)
    lengths, jacobian = robot.lengths_and_jacobian(pose)
    speeds = np.einsum("sij,sj->si", jacobian, rate)
    weighted = speeds @ np.linalg.inv(covariance)
    if recording.lengths.periods is not None:
        count = len(recording.lengths.periods)
        late = (np.arange(count) - (count - 1) / 2) * recording.period
        moved = np.tensordot(late, recording.lengths.periods, axes=1)
        known = float(np.sum(late**2) * np.sum(speeds * weighted))
        right = float(np.sum(moved * weighted))
    else:
        # Whole periods: the periodic part of ε t l̇ is in the fitted motion already.
        elapsed = recording.lengths.times - np.min(recording.lengths.times)
        late = np.floor(elapsed / recording.period + _ON_TIME) * recording.period
        late -= np.average(late, weights=recording.lengths.counts)
        counted = late * recording.lengths.counts
        known = float(np.sum((counted * late)[:, None] * speeds * weighted))
        right = float(np.sum(counted[:, None] * (recording.lengths.values - lengths) * weighted))
    if recording.periods < 2 or known <= 0:  # noqa: PLR2004 - a slope takes two
        return 0.0, np.inf
    return right / known, float(1 / np.sqrt(known))


def _unsuitable(
    data: Measurement, message: str, kind: type[UnsuitableDataError] = UnsuitableDataError
) -> UnsuitableDataError:
    allowed = (
        "a design (--design), a period column, a fixed trajectory.frequency, or data that repeat"
    )
    if (begin := find_motion_onset(data)) is not None:
        message = f"{message}; the struts do not move before {begin:.4g} s"
        allowed = f"data.start: {begin:.4g} s, which leaves the rows at rest out"
    allowed = f"{allowed}; or estimate.differentiation: spline, for a motion without a period"
    return kind(message, file=data.file, allowed=allowed)


_TWO = 2 - 1e-9
_SAME = 1 - 1e-9
"""Correlation of the differences of two channels that are the same recording."""


def fold_noise_recording(
    configuration: RunConfiguration,
    data: Measurement,
    design: FourierTrajectory | None,
    *,
    certain: bool,
) -> PeriodicRecording:
    """Fold a recording whose noise is analysed: by the period of the design, the run or the data.

    A recording at rest is divided into equal parts. If it is `certain` that the design was
    executed, another period is an error.

    Raises
    ------
    UnsuitableDataError
        The motion is not periodic, or less than two periods were recorded.
    """
    # The noise as it was recorded.
    data = replace(data, force_sensors=None, length_sensors=None)
    dead = np.flatnonzero(np.ptp(data.forces, axis=0) == 0) + 1
    if len(dead):
        where = f"actuator{'s' * (len(dead) > 1)} {', '.join(map(str, dead))}"
        raise _without_periods(
            data, f"the forces do not change at all ({where}): are they connected?"
        )
    same = np.triu(np.abs(np.corrcoef(np.diff(data.forces, axis=0).T)) > _SAME, 1)
    if np.any(same):
        first, second = np.argwhere(same)[0] + 1
        message = f"the forces of actuators {first} and {second} are the same recording"
        raise _without_periods(data, f"{message}: look at `data.columns` and the cables")

    def fold(find_omega: Callable[[Measurement], float], source: PeriodSource) -> PeriodicRecording:
        try:
            return fold_recording(data, find_omega(data), source)
        except PeriodError as error:
            note = "" if source is PeriodSource.REST else ", and the machine is not at rest"
            raise _without_periods(data, f"{error}{note}") from error

    if all(resolution_only(column) for column in data.lengths.T):
        return fold(choose_omega_at_rest, PeriodSource.REST)
    try:
        omega, source = choose_omega(configuration, data, design)
        recording = fold_recording(data, omega, source)
    except (UnsuitableDataError, PeriodError) as error:
        if is_at_rest(data):
            return fold(choose_omega_at_rest, PeriodSource.REST)
        if certain:
            raise _without_periods(data, str(error)) from error
        recording = fold(omega_from_data, PeriodSource.DATA)
    if recording.periods >= _TWO:
        return recording
    if is_at_rest(data):
        return fold(choose_omega_at_rest, PeriodSource.REST)
    raise _without_periods(
        data,
        f"{recording.periods:.3g} periods show no scatter between periods: the noise of a "
        "recording takes two periods or more, or a machine at rest",
    )


def _without_periods(data: Measurement, message: str) -> UnsuitableDataError:
    return UnsuitableDataError(
        message,
        file=data.file,
        key="--data",
        allowed="two periods or more of a motion that repeats, or some seconds at rest",
    )
