"""Input of the estimators: the samples of one motion, averaged over periods where possible.

A period that is a whole number of samples repeats the same phases: their mean and scatter are
sufficient statistics, even with lost samples. Otherwise, and with
stamps that jitter, every sample keeps its own time and nothing is rounded.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array, Mask
from estimation.data.measurement import Measurement
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
from estimation.processing.period import PeriodError, PeriodSource, moves_from, whole_samples
from estimation.processing.spectrum import NoiseLines, WhiteningFilter, estimated_filter
from expdesign.configuration.estimate import SpectrumOrigin

_REPEATED = 2

_MOST_LOST = 0.1
"""Share of the samples, or of their weight, that the noise's spectrum does without."""

_Collected = tuple[Array, Array, NoiseEstimate | None, Array | None, Array | None]
"""Values, counts, scatter, periods and repeats of `Channels`."""


@dataclass(frozen=True, eq=False)
class Channels:
    """Forces (N) or lengths (m) of a record."""

    times: Array
    """(S,), when they were what was recorded, s: stamps less the channels' delay."""
    values: Array
    """(S, 6), means over the periods, or single samples."""
    counts: Array
    """(S,), how many samples (or how much weight) each mean is made of."""
    scatter: NoiseEstimate | None
    """Covariance of one sample from the repetition; None with less than two periods."""
    periods: Array | None
    """(M, N, 6), the single periods, when they could be averaged and no sample is missing."""
    repeats: Array | None = None
    """(M, N, 6), the same as far as the samples count: the mean stands in place of the rest of an
    outlier, and of what is missing. None where that would be much, or all samples at a phase."""

    def behind(self, noise_filter: WhiteningFilter | None) -> Channels:
        """Return the same with means that count alike where a filter makes their noise white.

        It takes means of one size. What counts differ by is little: see `repeats`.
        """
        if noise_filter is None:
            return self
        return replace(self, counts=np.full_like(self.counts, np.mean(self.counts)))

    def noise(self, spectrum: SpectrumOrigin = "auto") -> NoiseEstimate | None:
        """Return the scatter with its spectrum and the filter for it, as `estimate.spectrum` says.

        White noise is assumed where there are too few periods for a spectrum, or no `repeats`.
        """
        empirical = self.empirical_noise
        if spectrum == "auto" or empirical is None or empirical.lines is None:
            return empirical
        if spectrum == "white":
            return replace(empirical, filter=None)
        if empirical.filter is not None:
            return empirical
        return replace(
            empirical, filter=estimated_filter(empirical.lines, empirical.covariance, always=True)
        )

    @cached_property
    def empirical_noise(self) -> NoiseEstimate | None:
        """Noise estimated from the repetition, with a filter if it is coloured."""
        repeated, repeats = self.scatter, self.repeats
        if repeated is None or repeats is None or len(repeats) < FEWEST_PERIODS:
            return repeated
        lines = NoiseLines.of(repeats)
        return replace(repeated, lines=lines, filter=estimated_filter(lines, repeated.covariance))


@dataclass(frozen=True, eq=False)
class PeriodicRecording:
    """Samples of one periodic motion."""

    omega: float
    """rad/s."""
    source: PeriodSource
    """Where ω came from."""
    forces: Channels
    lengths: Channels
    periods: float
    rows: int
    dropped: int
    """Rows of the recording that were used, and those of incomplete periods that were not."""
    step: float
    """Between two rows of the recording, s."""
    stamped: bool
    averaged: bool
    """True when the samples are means over whole periods."""
    robust: bool = False
    """True when samples that are far from their fellows count less."""
    lost: int = 0
    """Samples that are missing among those that were used."""
    origin: float = 0.0
    """What was taken off the recording's times, s: whole periods, so that phases are those of the
    recording. Far from the origin phases and ω could not be told from each other."""
    moves_from: float | None = None
    """When the struts begin to move, s, in the recording's time; None: with the first row."""

    @property
    def samples(self) -> int:
        """S."""
        return len(self.lengths.values)

    @property
    def own_clock(self) -> bool:
        """True when ω comes from the recording itself, in its own clock."""
        return self.source in (PeriodSource.COLUMN, PeriodSource.DATA)

    @property
    def weight_taken(self) -> float:
        """How many samples' worth of weight outliers of forces and lengths have lost."""
        kept = self.forces.counts.sum() + self.lengths.counts.sum()
        return float(max(2 * self.rows - kept, 0.0))

    @property
    def period(self) -> float:
        """Length of a period, s."""
        return float(2 * np.pi / self.omega)

    def behind(self, noise: NoiseModel) -> PeriodicRecording:
        """Return the record as it is weighted with this noise."""
        forces, lengths = noise.forces.filter, noise.lengths.filter
        return replace(
            self, forces=self.forces.behind(forces), lengths=self.lengths.behind(lengths)
        )

    def about_series(self, channels: Channels) -> tuple[NoiseEstimate, Array]:
        """Return the scatter of its channels about a long Fourier series, and the residuals."""
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
    """Bring a recording into the form that the estimators work on.

    Parameters
    ----------
    omega : float
        rad/s.
    average : bool
        Average over the periods if they are a whole number of samples.
    robust : bool
        Let samples that are far from their fellows count less (Huber).

    Raises
    ------
    PeriodError
        The recording is shorter than one period.
    """
    per_period = 2 * np.pi / (omega * data.step)
    start = _first_row(data)
    places = data.places[start:] - data.places[start]
    available = int(places[-1]) + 1
    # A last period that lacks less than a sample is complete.
    complete = int(np.floor(available / per_period + (1 - 1e-9) / per_period))
    if complete < 1:
        raise PeriodError(
            f"the recording has {available} rows, a period of {2 * np.pi / omega:.6g} s needs "
            f"{per_period:.6g}"
        )
    whole = None if data.stamped else whole_samples(omega, data.step, complete)
    averaged = whole is not None and average
    span = complete * whole if whole is not None and average else complete * per_period
    rows = int(np.searchsorted(places, min(int(np.ceil(span * (1 - 1e-12))), available)))
    used = slice(start, start + rows)
    collected: Callable[[Array], _Collected]
    if whole is not None and average:
        origin, periods = 0.0, float(complete)
        phases = _Phases(places[:rows], complete, whole)
        times = data.time[start] + data.step * np.flatnonzero(phases.seen)
        collected = partial(_mean_period, data.time[used], omega, phases, robust=robust)
    else:
        middle = 0.5 * (data.time[used][0] + data.time[used][-1])
        period = 2 * np.pi / omega
        origin = float(np.floor(middle / period) * period)
        times = data.time[used] - origin
        # A last period that lacks less than a sample counts as whole.
        reach = (int(places[rows - 1]) + 1) / per_period
        nearest = round(reach)
        periods = nearest if abs(reach - nearest) * per_period < 1 else reach
        repeated = periods >= _REPEATED - 0.5 / per_period
        collected = partial(
            _single_samples, times, omega, per_period, repeated=repeated, robust=robust
        )
    return PeriodicRecording(
        omega=omega,
        moves_from=moves_from(data),
        source=source,
        forces=Channels(times - data.force_delay, *collected(data.forces[used])),
        lengths=Channels(times - data.length_delay, *collected(data.lengths[used])),
        periods=float(periods),
        rows=rows,
        dropped=len(data) - rows,
        step=data.step,
        stamped=data.stamped,
        averaged=averaged,
        robust=robust,
        lost=int(places[rows - 1]) + 1 - rows if data.lost else 0,
        origin=origin,
    )


def _first_row(data: Measurement) -> int:
    """Return the first row of a complete period: a first one shorter than the second is none."""
    if data.period is None:
        return 0
    changes = np.flatnonzero(np.diff(data.period) != 0) + 1
    if not len(changes):
        return 0
    # In steps, not rows: of the first one as many may be missing as of any other.
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
        return self.arranged(np.ones((len(self.places), 1)))[:, :, 0] > 0

    @property
    def seen(self) -> Mask:
        """(N,), whether any period has a row at this phase."""
        return np.any(self.present, axis=0)

    def arranged(self, values: Array) -> Array:
        """Return rows, (T, c), period by period, (M, N, c); zeros where there are none."""
        result = np.zeros((self.periods * self.samples, values.shape[1]))
        result[self.places] = values
        return result.reshape(self.periods, self.samples, -1)


def _mean_period(
    times: Array, omega: float, phases: _Phases, values: Array, *, robust: bool
) -> _Collected:
    periods, present, seen = phases.arranged(values), phases.present, phases.seen
    weights = present.astype(float)
    complete = bool(np.all(present))
    if not complete:
        # An absent sample is no outlier: it stands where the others of its phase do.
        mean = periods.sum(axis=0) / np.maximum(weights.sum(axis=0), 1.0)[:, None]
        periods = np.where(present[:, :, None], periods, mean)
    if robust and len(periods) >= FEWEST_PERIODS:
        weights = weights * huber_weights(periods)
    elif robust:
        harmonics = series_harmonics(len(values), phases.samples)
        own = series_weights(times, values, omega, harmonics)[1]
        weights = phases.arranged(own[:, None])[:, :, 0]
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
