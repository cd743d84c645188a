"""Periodic recording, the input of the estimators: samples, averaged over periods if possible.

A period of a whole number of samples repeats the same phases: their mean and scatter are sufficient
statistics, even with lost samples. Otherwise, and for stamps with jitter, every sample keeps its
time and nothing is rounded.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from constraints.arrays import Array, ComplexArray, Mask
from estimation.data.measurement import Measurement
from estimation.data.sensors import SensorResponse
from estimation.processing.noise import (
    FEWEST_PERIODS,
    NoiseEstimate,
    NoiseModel,
    huber_weights,
    scatter_about_series,
    scatter_between_periods,
    series_harmonics,
    series_weights,
)
from estimation.processing.period import PeriodError, PeriodSource, find_motion_onset, whole_samples
from estimation.processing.spectrum import (
    NoiseLines,
    WhiteningFilter,
    divide_spectrum,
    estimated_filter,
    scaling_filter,
)
from estimation.processing.variance import VarianceProfile, low_harmonics, variance_profile
from expdesign.configuration.estimate import SpectrumOrigin
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.noise import lines_of, series_of

_REPEATED = 2
_MOST_SAMPLES = 20_000
"""Of a motion without a period."""
_MOST_LOST = 0.1
"""Largest share of missing samples, or of lost weight, for a spectrum of the noise."""

_DAMPED = 0.5
"""Share of the power that a filter leaves at a line, below which it is damped."""
_LACKING, _NEAR = 0.5, 17
"""Share of the usual noise below which a damped line has lost its own; lines in its mean."""

_SENSORS = (
    "filters, and delays of single channels, are taken back for whole periods of the motion that "
    "are a whole number of samples, without a phase that is always missing"
)

_Collected = tuple[Array, Array, NoiseEstimate | None, Array | None, Array | None]
"""Values, counts, scatter, periods and repeats of `Channels`."""


@dataclass(frozen=True, eq=False)
class Channels:
    """Forces (N) or lengths (m) of a recording."""

    times: Array
    """(S,), s: time stamps minus the delay of the channels."""
    values: Array
    """(S, 6), means over the periods, or single samples."""
    counts: Array
    """(S,), number of samples (or weight) of each mean."""
    scatter: NoiseEstimate | None
    """Covariance of one sample from the repetition; None with fewer than two periods."""
    periods: Array | None
    """(M, N, 6), single periods, if they were averaged and no sample is missing."""
    repeats: Array | None = None
    """(M, N, 6), the same with missing samples, and the lost weight of outliers, replaced by the
    mean. None if too many are missing, or all samples at a phase."""
    profile: VarianceProfile | None = None
    """Size of the noise over a period; None: it is constant, or cannot be seen."""
    response: ComplexArray | None = None
    """(N // 2 + 1, 6), of the sensors, by which the lines of values and periods are divided; None:
    they are as recorded."""
    kept: int | None = None
    """Number of lines with weight: the noise of those from there on has passed the filter of the
    sensors. None: all lines."""

    def before_sensors(self, sensors: SensorResponse | None, step: float) -> Channels:
        """Return the channels before filters and delays of their sensors, (N, 6) values."""
        if sensors is None:
            return self
        response, repeats, single = sensors.lines(len(self.values), step), self.repeats, None
        kept, scatter = self._leave_out(np.abs(response) ** 2 < _DAMPED)
        if repeats is not None and self.periods is not None:
            # Each by itself: a weighting filter, applied to each, takes exactly this back.
            single = np.stack([sensors.undo(each, step) for each in repeats])
        if repeats is not None:
            repeats = sensors.undo(repeats.reshape(-1, ACTUATORS), step).reshape(repeats.shape)
        return replace(
            self,
            values=sensors.undo(self.values, step),
            scatter=scatter,
            repeats=repeats,
            periods=single,
            response=response,
            kept=kept,
        )

    def _leave_out(self, damped: Mask) -> tuple[int | None, NoiseEstimate | None]:
        """Return the number of lines with weight, and the covariance from these.

        Noise that has passed the filter vanishes with the signal at damped lines, (L, 6). Rounding,
        the filter's true response and jumps between two samples remain; their weight would be the
        inverse of next to nothing.
        """
        scatter = self.scatter
        if self.repeats is None or scatter is None or not np.any(damped):
            return None, scatter
        own = np.einsum("lii->li", NoiseLines.of(self.repeats).matrices).real
        usual = np.nanmedian(np.where(damped, np.nan, own), axis=0)
        near = uniform_filter1d(own, _NEAR, axis=0, mode="nearest")
        seen = np.all(~damped | (near >= _LACKING * usual), axis=1)
        kept = int(np.flatnonzero(seen)[-1]) + 1
        if kept == len(seen):
            return None, scatter
        samples = 2 * kept - 1
        periods = np.stack([series_of(lines_of(each)[:kept], samples) for each in self.repeats])
        found = scatter_between_periods(periods, np.ones(periods.shape[:2]))
        share = scatter.freedom / len(self.values) / (len(periods) - 1)
        return kept, NoiseEstimate(found.covariance / share, found.freedom * share)

    def as_recorded(self, values: Array) -> Array:
        """Return series of these channels, (N, 6, …), after filters and delays of their sensors."""
        if self.response is None:
            return values
        response = self.response.reshape(*self.response.shape, *(1,) * (values.ndim - 2))
        return series_of(lines_of(values) * response, len(values))

    def noise_before_sensors(self, noise: NoiseEstimate) -> NoiseEstimate:
        """Return the noise of the values, given that of a recorded sample."""
        if self.response is None:
            return noise
        return noise.before_sensors(self.response, len(self.values), self.kept)

    def as_weighted(self, noise_filter: WhiteningFilter | None) -> Channels:
        """Return the channels with equal counts, as a whitening filter requires.

        The counts differ little: see `repeats`.
        """
        if noise_filter is None:
            return self
        return replace(self, counts=np.full_like(self.counts, np.mean(self.counts)))

    def noise(self, spectrum: SpectrumOrigin = "auto") -> NoiseEstimate | None:
        """Return the scatter with its spectrum and filter, according to `estimate.spectrum`.

        With too few periods for a spectrum, without `repeats`, or if the covariance is singular,
        the noise counts as white.
        """
        empirical = self.empirical_noise
        if spectrum == "auto" or empirical is None or self.repeats is None:
            return empirical
        if spectrum == "estimated" or empirical.lines is None:
            return self._estimate_noise(always=True)
        white = replace(
            empirical,
            lines=self.recorded_lines(self._lines_of(self.repeats, empirical)),
            filter=None,
        )
        return self.noise_before_sensors(white)

    @cached_property
    def empirical_noise(self) -> NoiseEstimate | None:
        """Noise estimated from the repetition, with a filter if it is coloured or changes."""
        return self._estimate_noise(always=False)

    def _estimate_noise(self, *, always: bool) -> NoiseEstimate | None:
        repeated, repeats = self.scatter, self.repeats
        if repeated is None:
            return None
        if repeats is None or len(repeats) < FEWEST_PERIODS or repeated.is_singular:
            return self.noise_before_sensors(repeated)
        lines, size = self.recorded_lines(self._lines_of(repeats, repeated)), None
        covariance = repeated.covariance
        if self.profile is not None:
            size = self.profile.std
            scaled = self._lines_of(repeats / size, repeated).covariance
            # The variances of the scaled noise are those of the scatter.
            size = size * np.sqrt(np.diag(scaled) / np.diag(covariance))
            lines = self._lines_of(repeats / size, repeated)
            covariance = lines.covariance
        found = estimated_filter(lines.first(self.kept), covariance, always=always)
        if size is not None and self.profile is not None:
            white = scaling_filter(covariance, lines.samples)
            found = found or replace(white, loss=repeated.weighting_loss)
            words = f"{found.smoothing}, scaled over the {self.profile.over}"
            found = replace(found, size=size, smoothing=words)
        estimate = replace(repeated, covariance=covariance, lines=lines, filter=found)
        return self.noise_before_sensors(estimate)

    def _lines_of(self, repeats: Array, scatter: NoiseEstimate) -> NoiseLines:
        """Return the spectrum of repeats with the degrees of freedom of their scatter.

        Samples that the mean replaces, and weight that outliers lost, show no noise.
        """
        lines = NoiseLines.of(repeats)
        freedom = scatter.freedom / lines.first(self.kept).samples
        matrices = lines.matrices * (lines.freedom / freedom)
        return replace(lines, matrices=matrices, freedom=freedom)

    def recorded_lines(self, lines: NoiseLines) -> NoiseLines:
        """Return the spectrum of the recorded noise, given that of the values."""
        if self.response is None:
            return lines
        return replace(lines, matrices=divide_spectrum(lines.matrices, 1 / self.response))

    def with_profile(self, quantities: Mapping[str, Array]) -> Channels:
        """Return the channels with the size of their noise over one of these quantities.

        Coarse rounding hides the noise wherever the signal is far from a rounding threshold: its
        scatter is no size of the noise. A channel with mostly equal samples in successive periods
        is left out.
        """
        periods, ends, noise = self.repeats, 0, self.empirical_noise
        if noise is None or noise.lines is None or periods is None:
            return self
        rounded = np.median(np.abs(np.diff(periods, axis=0)), axis=(0, 1)) == 0
        if noise.filter is not None:
            periods = np.stack([noise.filter(period) for period in periods])
            ends = noise.filter.reach(np.sqrt(np.diag(noise.covariance)))
        profile = variance_profile(np.where(rounded, 0.0, periods), quantities, ends)
        return self if profile is None else replace(self, profile=profile)


@dataclass(frozen=True, eq=False)
class PeriodicRecording:
    """Samples of one periodic motion."""

    omega: float
    """rad/s."""
    source: PeriodSource
    """Source of ω."""
    forces: Channels
    lengths: Channels
    periods: float
    rows: int
    dropped: int
    """Number of rows in use, and of those in incomplete periods, which are left out."""
    step: float
    """Between two rows of the recording, s."""
    stamped: bool
    averaged: bool
    """True if the samples are means over whole periods."""
    robust: bool = False
    """True if outliers have less weight (Huber)."""
    lost: int = 0
    """Number of missing samples among the rows in use."""
    origin: float = 0.0
    """Time subtracted from the recording's times, s: whole periods, which keeps the phases. Far
    from the origin, phases and ω would be correlated."""
    motion_onset: float | None = None
    """Beginning of the motion, s, in the recording's time; None: the first row."""

    @property
    def samples(self) -> int:
        """S."""
        return len(self.lengths.values)

    @property
    def jump_spread(self) -> float:
        """Standard deviation of the time of a jump in the forces, s.

        Behind a filter of the sensors a jump shows where it is between two samples, and its samples
        before the filter do not: spread over a step, they are right on average.
        """
        return 0.0 if self.forces.response is None else self.step / float(np.sqrt(12))

    @property
    def own_clock(self) -> bool:
        """True if ω comes from the recording, in the recorder's clock."""
        return self.source in (PeriodSource.COLUMN, PeriodSource.DATA)

    @property
    def weight_taken(self) -> float:
        """Weight lost by outliers of forces and lengths, in samples."""
        kept = self.forces.counts.sum() + self.lengths.counts.sum()
        return float(max(2 * self.rows - kept, 0.0))

    @property
    def period(self) -> float:
        """Length of a period, s."""
        return float(2 * np.pi / self.omega)

    @property
    def rows_left_out(self) -> str:
        """Sentence on the rows of incomplete periods or means; empty: there are none."""
        if not self.dropped:
            return ""
        if self.source is PeriodSource.NONE:
            return f"{self.dropped} rows at the end were left out of means of neighbours"
        whole = round(self.period / self.step)
        return f"{self.dropped} rows of incomplete periods were left out: a whole one has {whole}"

    def as_weighted(self, noise: NoiseModel) -> PeriodicRecording:
        """Return the recording with the counts that the filters of this noise require."""
        forces, lengths = noise.forces.filter, noise.lengths.filter
        return replace(
            self, forces=self.forces.as_weighted(forces), lengths=self.lengths.as_weighted(lengths)
        )

    def fit_series(self, channels: Channels) -> tuple[NoiseEstimate, Array]:
        """Return the scatter of the channels about a long Fourier series, and the residuals."""
        per_period = self.samples if self.averaged else self.period / self.step
        harmonics = series_harmonics(self.samples, per_period)
        return scatter_about_series(channels.times, channels.values, self.omega, harmonics)


def fold_recording(
    data: Measurement,
    omega: float,
    source: PeriodSource,
    *,
    average: bool = True,
    robust: bool = False,
) -> PeriodicRecording:
    """Fold a recording into periods with ω in rad/s, for the estimators.

    It is averaged over the periods if these are a whole number of samples. A `robust` mean reduces
    the weight of outliers (Huber).

    Raises
    ------
    PeriodError
        The recording is shorter than one period.
    """
    per_period = 2 * np.pi / (omega * data.step)
    start = _first_row(data)
    places = data.places[start:] - data.places[start]
    available = int(places[-1]) + 1
    # A last period is complete if less than a sample is missing.
    complete = int(np.floor(available / per_period + (1 - 1e-9) / per_period))
    if complete < 1:
        raise PeriodError(
            f"the recording has {available} rows, a period of {2 * np.pi / omega:.6g} s needs "
            f"{per_period:.6g}"
        )
    exact = average and not data.stamped
    whole = whole_samples(omega, data.step, complete) if exact else None
    span = complete * (whole or per_period)
    rows = int(np.searchsorted(places, min(int(np.ceil(span * (1 - 1e-12))), available)))
    used = slice(start, start + rows)
    collected: Callable[..., _Collected]
    if whole is not None:
        origin, periods = 0.0, float(complete)
        phases = _Phases(places[:rows], complete, whole)
        times = data.time[start] + data.step * np.flatnonzero(phases.seen)
        collected = partial(_mean_period, data.time[used], omega, phases)
    else:
        middle = 0.5 * (data.time[used][0] + data.time[used][-1])
        period = 2 * np.pi / omega
        origin = float(np.floor(middle / period) * period)
        times = data.time[used] - origin
        # A last period counts as whole if less than a sample is missing.
        reach = (int(places[rows - 1]) + 1) / per_period
        nearest = round(reach)
        periods = nearest if abs(reach - nearest) * per_period < 1 else reach
        repeated = periods >= _REPEATED - 0.5 / per_period
        collected = partial(
            _single_samples, times, omega, per_period, repeated=repeated, robust=robust
        )

    def channels(delay: float, values: Array, **options: Any) -> Channels:
        return Channels(times - delay, *collected(values[used], **options))

    both = ((data.force_delay, data.forces), (data.length_delay, data.lengths))
    forces, lengths = (channels(*each) for each in both)
    sensors = data.force_sensors, data.length_sensors
    if any(sensors):
        if whole is None or min(len(forces.values), len(lengths.values)) < whole:
            raise PeriodError(_SENSORS)
        forces, lengths = (
            each.before_sensors(one, data.step)
            for each, one in zip((forces, lengths), sensors, strict=True)
        )
    elif whole is not None:
        forces, lengths = _with_profiles(forces, lengths)
        if robust:
            forces, lengths = (
                replace(channels(*each, robust=True, profile=found), profile=found)
                for each, found in zip(both, (forces.profile, lengths.profile), strict=True)
            )
    return PeriodicRecording(
        omega=omega,
        motion_onset=find_motion_onset(data),
        source=source,
        forces=forces,
        lengths=lengths,
        periods=float(periods),
        rows=rows,
        dropped=len(data) - rows,
        step=data.step,
        stamped=data.stamped,
        averaged=whole is not None,
        robust=robust,
        lost=int(places[rows - 1]) + 1 - rows if data.lost else 0,
        origin=origin,
    )


def single_recording(data: Measurement) -> PeriodicRecording:
    """Return all samples of a motion without a period, which counts as one of its duration.

    Neighbours are averaged if there are very many samples; their means are the samples then.

    Raises
    ------
    PeriodError
        Filters or delays of single channels are stated.
    """
    if data.has_sensors:
        raise PeriodError(_SENSORS)
    width = -(-len(data) // _MOST_SAMPLES)
    rows = len(data) // width * width

    def average(values: Array) -> Array:
        return values[:rows].reshape(-1, width, *values.shape[1:]).mean(axis=1)

    times = average(data.time)
    forces, lengths = (
        Channels(times - delay, average(values), np.ones(len(times)), None, None)
        for delay, values in ((data.force_delay, data.forces), (data.length_delay, data.lengths))
    )
    return PeriodicRecording(
        omega=float(2 * np.pi / (data.time[-1] - data.time[0] + data.step)),
        source=PeriodSource.NONE,
        forces=forces,
        lengths=lengths,
        periods=1.0,
        rows=rows,
        dropped=len(data) - rows,
        step=width * data.step,
        stamped=data.stamped,
        averaged=False,
        lost=int(data.places[-1] - data.places[0]) + 1 - len(data) if data.lost else 0,
    )


def _with_profiles(forces: Channels, lengths: Channels) -> tuple[Channels, Channels]:
    """Look for noise whose size depends on the struts' speeds or the forces, or on the phase."""
    quantities = {
        "speed": np.abs(low_harmonics(lengths.values, rate=True)),
        "force": np.abs(low_harmonics(forces.values)),
    }
    return forces.with_profile(quantities), lengths.with_profile(quantities)


def _first_row(data: Measurement) -> int:
    """Return the first row of a complete period: a first period shorter than the second is not."""
    if data.period is None:
        return 0
    changes = np.flatnonzero(np.diff(data.period) != 0) + 1
    if not len(changes):
        return 0
    # In steps, not rows: samples of the first period may be missing, too.
    ends = [*data.places[changes], data.places[-1] + 1]
    first, second = int(ends[0]), int(ends[1] - ends[0])
    return int(changes[0]) if first < second - 1 else 0


@dataclass(frozen=True, eq=False)
class _Phases:
    """Positions of rows in whole periods: places (T,) in M periods of N samples each."""

    places: NDArray[np.intp]
    periods: int
    samples: int

    @property
    def present(self) -> Mask:
        """(M, N), whether there is a row."""
        return self.arrange(np.ones((len(self.places), 1)))[:, :, 0] > 0

    @property
    def seen(self) -> Mask:
        """(N,), whether any period has a row at this phase."""
        return np.any(self.present, axis=0)

    def arrange(self, values: Array) -> Array:
        """Return rows, (T, c), period by period, (M, N, c); zeros where there are none."""
        result = np.zeros((self.periods * self.samples, values.shape[1]))
        result[self.places] = values
        return result.reshape(self.periods, self.samples, -1)


def _mean_period(
    times: Array,
    omega: float,
    phases: _Phases,
    values: Array,
    *,
    robust: bool = False,
    profile: VarianceProfile | None = None,
) -> _Collected:
    periods, present, seen = phases.arrange(values), phases.present, phases.seen
    weights = present.astype(float)
    complete = bool(np.all(present))
    if not complete:
        # A missing sample takes the mean of its phase, and is no outlier.
        mean = periods.sum(axis=0) / np.maximum(weights.sum(axis=0), 1.0)[:, None]
        periods = np.where(present[:, :, None], periods, mean)
    if robust and len(periods) >= FEWEST_PERIODS:
        size = 1.0 if profile is None else profile.std
        weights = weights * huber_weights(periods / size)
    elif robust:
        harmonics = series_harmonics(len(values), phases.samples)
        own = series_weights(times, values, omega, harmonics)[1]
        weights = phases.arrange(own[:, None])[:, :, 0]
    periods, weights = periods[:, seen], weights[:, seen]
    counts = weights.sum(axis=0)
    mean = np.einsum("mn,mnj->nj", weights, periods) / counts[:, None]
    scatter = scatter_between_periods(periods, weights) if len(periods) >= _REPEATED else None
    repeats, lost = None, 1 - float(np.mean(weights))
    if np.all(seen) and lost <= _MOST_LOST:
        repeats = periods if lost == 0 else mean + weights[:, :, None] * (periods - mean)
    return mean, counts, scatter, periods if complete else None, repeats


def _single_samples(
    times: Array, omega: float, per_period: float, values: Array, *, repeated: bool, robust: bool
) -> _Collected:
    harmonics = series_harmonics(len(values), per_period)
    counts, scatter = np.ones(len(values)), None
    if robust:
        scatter, counts = series_weights(times, values, omega, harmonics)
    elif repeated:
        scatter, _ = scatter_about_series(times, values, omega, harmonics)
    return values, counts, scatter if repeated else None, None, None
