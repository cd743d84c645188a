"""What the estimators work on: one trajectory's samples, averaged over periods where that is right.

A period that is a whole number of samples gives the same phases again and again: their mean and
scatter hold all that the samples tell. Otherwise, and with stamps that jitter, every sample keeps
its own time and nothing is rounded.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from constraints.arrays import Array
from estimation.data.measurement import Measurement
from estimation.processing.noise import (
    FEWEST_PERIODS,
    NoiseEstimate,
    huber_weights,
    scatter_about_series,
    scatter_between_periods,
    series_harmonics,
    series_weights,
)
from estimation.processing.noise_lines import NoiseLines
from estimation.processing.period import PeriodError, PeriodSource, whole_samples
from estimation.processing.whitening_filter import estimated_filter
from expdesign.configuration.sections.data import SpectrumOrigin

_REPEATED = 2

_Collected = tuple[Array, Array, NoiseEstimate | None, Array | None]
"""Values, counts, scatter and periods of `Channels`."""


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
    """(M, N, 6), the single periods, when they could be averaged."""

    @property
    def alike(self) -> bool:
        """True when all values are means of as many samples, one for each phase of a period."""
        return self.periods is not None and np.ptp(self.counts) == 0

    def noise(self, spectrum: SpectrumOrigin = "auto") -> NoiseEstimate | None:
        """Return the scatter with its spectrum and the filter for it, as `estimate.spectrum` says.

        White noise is assumed where there are too few periods for a spectrum, or samples that are
        not means of as many.
        """
        repeated, periods = self.scatter, self.periods
        if repeated is None or periods is None or not self.alike or len(periods) < FEWEST_PERIODS:
            return repeated
        lines = NoiseLines.of(periods)
        if spectrum == "white":
            return replace(repeated, lines=lines)
        found = estimated_filter(lines, repeated.covariance, always=spectrum == "estimated")
        return replace(repeated, lines=lines, filter=found)


@dataclass(frozen=True, eq=False)
class Record:
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
    origin: float = 0.0
    """What was taken off the recording's times, s: whole periods, so that phases are those of the
    recording. Far from the origin phases and ω could not be told from each other."""

    @property
    def samples(self) -> int:
        """S."""
        return len(self.lengths.values)

    @property
    def averaged(self) -> bool:
        """True when the samples are means over whole periods."""
        return self.lengths.periods is not None

    @property
    def period(self) -> float:
        """Length of a period, s."""
        return float(2 * np.pi / self.omega)

    def about_series(self, channels: Channels) -> tuple[NoiseEstimate, Array]:
        """Return the scatter of its channels about a long Fourier series, and the residuals."""
        per_period = self.samples if self.averaged else self.period / self.step
        harmonics = series_harmonics(self.samples, per_period)
        return scatter_about_series(channels.times, channels.values, self.omega, harmonics)


def make_record(
    data: Measurement,
    omega: float,
    source: PeriodSource,
    *,
    average: bool = True,
    robust: bool = False,
) -> Record:
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
    available = len(data) - start
    # A last period that lacks less than a sample is complete.
    complete = int(np.floor(available / per_period + (1 - 1e-9) / per_period))
    if complete < 1:
        raise PeriodError(
            f"the recording has {available} rows, a period of {2 * np.pi / omega:.6g} s needs "
            f"{per_period:.6g}"
        )
    whole = None if data.stamped else whole_samples(omega, data.step, complete)
    collected: Callable[[Array], _Collected]
    if whole is not None and average:
        rows, origin = complete * whole, 0.0
        periods: float = complete
        used = slice(start, start + rows)
        times = data.time[start : start + whole]
        collected = partial(_mean_period, data.time[used], omega, whole, robust=robust)
    else:
        rows = min(int(np.ceil(complete * per_period * (1 - 1e-12))), available)
        used = slice(start, start + rows)
        middle = 0.5 * (data.time[used][0] + data.time[used][-1])
        period = 2 * np.pi / omega
        origin = float(np.floor(middle / period) * period)
        times = data.time[used] - origin
        # A last period that lacks less than a sample counts as whole.
        nearest = round(rows / per_period)
        near = abs(rows / per_period - nearest) * per_period < 1
        periods = nearest if near else rows / per_period
        repeated = periods >= _REPEATED - 0.5 / per_period
        collected = partial(
            _single_samples, times, omega, per_period, repeated=repeated, robust=robust
        )
    return Record(
        omega=omega,
        source=source,
        forces=Channels(times - data.force_delay, *collected(data.forces[used])),
        lengths=Channels(times - data.length_delay, *collected(data.lengths[used])),
        periods=float(periods),
        rows=rows,
        dropped=len(data) - rows,
        step=data.step,
        stamped=data.stamped,
        origin=origin,
    )


def _first_row(data: Measurement) -> int:
    """Return the first row of a complete period: a first one shorter than the second is none."""
    if data.period is None:
        return 0
    changes = np.flatnonzero(np.diff(data.period) != 0) + 1
    if not len(changes):
        return 0
    first, second = int(changes[0]), int([*changes, len(data)][1]) - int(changes[0])
    return first if first < second - 1 else 0


def _mean_period(
    times: Array, omega: float, samples: int, values: Array, *, robust: bool
) -> _Collected:
    periods = values.reshape(-1, samples, values.shape[1])
    weights = np.ones(periods.shape[:2])
    if robust and len(periods) >= FEWEST_PERIODS:
        weights = huber_weights(periods)
    elif robust:
        harmonics = series_harmonics(len(values), samples)
        weights = series_weights(times, values, omega, harmonics)[1].reshape(weights.shape)
    counts = weights.sum(axis=0)
    mean = np.einsum("mn,mnj->nj", weights, periods) / counts[:, None]
    repeated = len(periods) >= _REPEATED
    return mean, counts, scatter_between_periods(periods, weights) if repeated else None, periods


def _single_samples(
    times: Array, omega: float, per_period: float, values: Array, *, repeated: bool, robust: bool
) -> _Collected:
    harmonics = series_harmonics(len(values), per_period)
    counts, scatter = np.ones(len(values)), None
    if robust:
        scatter, counts = series_weights(times, values, omega, harmonics)
    elif repeated:
        scatter, _ = scatter_about_series(times, values, omega, harmonics)
    return values, counts, scatter if repeated else None, None
