"""What the estimators work on: one trajectory's samples, averaged over periods where that is right.

A period that is a whole number of samples gives the same phases again and again: their mean and
scatter hold all that the samples tell. Otherwise, and with stamps that jitter, every sample keeps
its own time and nothing is rounded.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from estimation.data.measurement import Measurement
from estimation.processing.noise import (
    NoiseEstimate,
    scatter_about_series,
    scatter_between_periods,
    series_harmonics,
)
from estimation.processing.outliers import FEWEST_PERIODS, huber_weights, series_weights
from estimation.processing.period import PeriodError, PeriodSource, whole_samples

_REPEATED = 2


@dataclass(frozen=True, eq=False)
class Record:
    """Samples of one periodic motion.

    Attributes
    ----------
    omega : float
        rad/s.
    source : PeriodSource
        Where ω came from.
    length_times, force_times : (S,)
        When lengths and forces were what was recorded, s: stamps less the channels' delays.
    lengths, forces : (S, 6)
        Means over the periods, or single samples; m and N.
    length_counts, force_counts : (S,)
        How many samples (or how much weight) each mean is made of.
    periods : float
        Periods recorded.
    rows : int
        Rows of the recording that were used.
    dropped : int
        Rows of incomplete periods that were not.
    force_scatter, length_scatter : NoiseEstimate or None
        Covariance of one sample from the repetition; None with less than two periods.
    length_periods, force_periods : (M, N, 6) or None
        The single periods, when they could be averaged.
    step : float
        Between two rows of the recording, s.
    stamped : bool
    origin : float
        What was taken off the recording's times, s: whole periods, so that phases are those of the
        recording. Far from the origin phases and ω could not be told from each other.
    """

    omega: float
    source: PeriodSource
    length_times: Array
    lengths: Array
    length_counts: Array
    force_times: Array
    forces: Array
    force_counts: Array
    periods: float
    rows: int
    dropped: int
    force_scatter: NoiseEstimate | None
    length_scatter: NoiseEstimate | None
    length_periods: Array | None
    force_periods: Array | None
    step: float
    stamped: bool
    origin: float = 0.0

    @property
    def samples(self) -> int:
        """S."""
        return len(self.lengths)

    @property
    def averaged(self) -> bool:
        """True when the samples are means over whole periods."""
        return self.length_periods is not None

    @property
    def period(self) -> float:
        """Length of a period, s."""
        return float(2 * np.pi / self.omega)


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
    data : Measurement
    omega : float
        rad/s.
    source : PeriodSource
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
    periods = available / per_period
    # A last period that lacks less than a sample is complete.
    complete = int(np.floor(periods + (1 - 1e-9) / per_period))
    if complete < 1:
        raise PeriodError(
            f"the recording has {available} rows, a period of {2 * np.pi / omega:.6g} s needs "
            f"{per_period:.6g}"
        )
    whole = None if data.stamped else whole_samples(omega, data.step, complete)
    if whole is not None and average:
        return _averaged(data, omega, source, start, (complete, whole), robust=robust)
    rows = int(np.ceil(complete * per_period * (1 - 1e-12)))
    return _single(data, omega, source, slice(start, start + min(rows, available)), robust=robust)


def _first_row(data: Measurement) -> int:
    if data.period is None:
        return 0
    changes = np.flatnonzero(np.diff(data.period) != 0)
    if not len(changes):
        return 0
    # A first period that is shorter than the second is incomplete.
    first = int(changes[0]) + 1
    second = int(changes[1]) + 1 - first if len(changes) > 1 else len(data) - first
    return first if first < second - 1 else 0


def _averaged(
    data: Measurement,
    omega: float,
    source: PeriodSource,
    start: int,
    shape: tuple[int, int],
    *,
    robust: bool,
) -> Record:
    periods, samples = shape
    rows = slice(start, start + periods * samples)
    lengths = data.lengths[rows].reshape(periods, samples, -1)
    forces = data.forces[rows].reshape(periods, samples, -1)
    length_weights = force_weights = np.ones(shape)
    if robust:
        length_weights = _fellow_weights(data.time[rows], lengths, omega)
        force_weights = _fellow_weights(data.time[rows], forces, omega)
    times = data.time[start : start + samples]
    repeated = periods >= _REPEATED
    return Record(
        omega=omega,
        source=source,
        length_times=times - data.length_delay,
        lengths=_weighted_mean(lengths, length_weights),
        length_counts=length_weights.sum(axis=0),
        force_times=times - data.force_delay,
        forces=_weighted_mean(forces, force_weights),
        force_counts=force_weights.sum(axis=0),
        periods=float(periods),
        rows=periods * samples,
        dropped=len(data) - periods * samples,
        force_scatter=scatter_between_periods(forces, force_weights) if repeated else None,
        length_scatter=scatter_between_periods(lengths, length_weights) if repeated else None,
        length_periods=lengths,
        force_periods=forces,
        step=data.step,
        stamped=False,
    )


def _fellow_weights(times: Array, values: Array, omega: float) -> Array:
    periods, samples, channels = values.shape
    if periods >= FEWEST_PERIODS:
        return huber_weights(values)
    harmonics = series_harmonics(periods * samples, samples)
    _, weights = series_weights(times, values.reshape(-1, channels), omega, harmonics)
    return weights.reshape(periods, samples)


def _weighted_mean(values: Array, weights: Array) -> Array:
    return np.einsum("mn,mnj->nj", weights, values) / weights.sum(axis=0)[:, None]


def _single(
    data: Measurement, omega: float, source: PeriodSource, rows: slice, *, robust: bool
) -> Record:
    lengths, forces = data.lengths[rows], data.forces[rows]
    count = len(lengths)
    period = 2 * np.pi / omega
    middle = 0.5 * (data.time[rows][0] + data.time[rows][-1])
    origin = float(np.floor(middle / period) * period)
    times = data.time[rows] - origin
    per_period = 2 * np.pi / (omega * data.step)
    # A last period that lacks less than a sample counts as whole.
    nearest = round(count / per_period)
    periods = nearest if abs(count / per_period - nearest) * per_period < 1 else count / per_period
    length_scatter = force_scatter = None
    length_weights = force_weights = np.ones(count)
    harmonics = series_harmonics(count, per_period)
    repeated = periods >= _REPEATED - 0.5 / per_period
    if robust:
        length_scatter, length_weights = series_weights(times, lengths, omega, harmonics)
        force_scatter, force_weights = series_weights(times, forces, omega, harmonics)
    elif repeated:
        length_scatter, _ = scatter_about_series(times, lengths, omega, harmonics)
        force_scatter, _ = scatter_about_series(times, forces, omega, harmonics)
    return Record(
        omega=omega,
        source=source,
        length_times=times - data.length_delay,
        lengths=lengths,
        length_counts=length_weights,
        force_times=times - data.force_delay,
        forces=forces,
        force_counts=force_weights,
        periods=float(periods),
        rows=count,
        dropped=len(data) - count,
        force_scatter=force_scatter if repeated else None,
        length_scatter=length_scatter if repeated else None,
        length_periods=None,
        force_periods=None,
        step=data.step,
        stamped=data.stamped,
        origin=origin,
    )
