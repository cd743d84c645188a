"""Period of a recording, from its period column or its lengths; recordings at rest."""

from __future__ import annotations

from enum import Enum

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.optimize import minimize_scalar

from constraints.arrays import Array
from estimation.data.measurement import Measurement
from estimation.processing.hum import mains_frequencies
from estimation.processing.noise import series_basis
from expdesign.mechanism.hexapod import ACTUATORS

_CLEAR_PEAK = 0.5
_WHOLE_DRIFT = 0.01
_WHOLE_MARKS = 0.03
"""Largest drift over the recording, in steps, of a marked period that counts as whole."""
_COARSE_HARMONICS = 6
_SEARCH_HARMONICS = 30
_ACCURACY = 1e-10
_FEWEST_PERIODS = 1.5
_MULTIPLES = (2, 3)
_MUCH_BETTER = 4.0
"""Ratio of the changes of the lengths over a period and over its multiple, for the latter."""


class PeriodSource(Enum):
    """Source of the period."""

    DESIGN = "design"
    COLUMN = "period column"
    FREQUENCY = "trajectory.frequency"
    DATA = "data"
    NONE = "no period"
    """The recording is one motion that does not repeat."""
    REST = "rest"
    """The machine does not move: the parts of the recording are arbitrary."""


class PeriodError(ValueError):
    """No period that fits the recording could be found."""


class NotRepeatedError(PeriodError):
    """The machine moves, but not periodically."""


def omega_from_column(data: Measurement) -> float:
    """Return ω, rad/s, from the rows at which the period column increases.

    Raises
    ------
    PeriodError
        Fewer than two periods are marked, or the column does not increase by one.
    """
    if data.period is None:
        raise PeriodError("the data have no period column")
    changes = np.flatnonzero(np.diff(data.period) != 0) + 1
    if len(changes) < 2:  # noqa: PLR2004 - two changes mark one whole period
        raise PeriodError("the period column marks no whole period")
    if np.any(np.diff(data.period)[changes - 1] != 1):
        row = int(changes[np.diff(data.period)[changes - 1] != 1][0])
        raise PeriodError(f"the period column does not count on by one at sample {row + 1}")
    # Each change is late by up to one step: the marks give the period to about a step, the lengths
    # refine it. A whole number of samples is preferred within that accuracy.
    slope = float(np.polyfit(np.arange(len(changes)), data.time[changes], 1)[0])
    omega = refine_omega(data, 2 * np.pi / slope)
    if data.stamped:
        return omega
    per_period = 2 * np.pi / (omega * data.step)
    drift = abs(per_period - round(per_period)) * len(data) / per_period
    return 2 * np.pi / (round(per_period) * data.step) if drift < _WHOLE_MARKS else omega


def omega_from_data(data: Measurement) -> float:
    """Estimate ω, rad/s, from the lengths alone.

    Their autocorrelation gives the period to a step, the residual of a Fourier series refines it.

    Raises
    ------
    PeriodError
        The lengths do not repeat within the recording.
    """
    times = data.time
    if not data.gapless:
        grid = np.arange(times[0], times[-1], data.step)
        lengths = np.stack([np.interp(grid, times, column) for column in data.lengths.T], axis=1)
    else:
        lengths = data.lengths
    rows = len(lengths)
    centred = lengths - lengths.mean(axis=0)
    spectrum = np.abs(np.fft.rfft(centred, 2 * rows, axis=0)) ** 2
    covariance = np.fft.irfft(spectrum.sum(axis=1))[:rows]
    lags = np.arange(rows)
    correlation = covariance / np.maximum(rows - lags, 1) / (covariance[0] / rows)
    usable = correlation[: int(rows / _FEWEST_PERIODS)]
    below = np.flatnonzero(usable < _CLEAR_PEAK)
    if not len(below):
        raise PeriodError("the lengths do not move enough to find a period")
    after = usable[below[0] :]
    best = float(np.max(after, initial=-1.0))
    if best < _CLEAR_PEAK:
        raise NotRepeatedError(
            "the lengths do not repeat within the recording: no period was found in it"
        )
    # The first peak that is nearly as high as the highest: later ones are multiples.
    peaks = np.flatnonzero(
        (usable[1:-1] >= usable[:-2]) & (usable[1:-1] >= usable[2:]) & (usable[1:-1] > 0.9 * best)
    )
    peaks = peaks[peaks + 1 > below[0]] + 1
    lag = int(peaks[0]) if len(peaks) else int(below[0] + np.argmax(after))
    return _fundamental(data, refine_omega(data, 2 * np.pi / (lag * data.step)))


def _fundamental(data: Measurement, omega: float) -> float:
    """Return ω, or its half or third if the lengths repeat much better after two or three periods.

    With a second harmonic much larger than the first, the halves of a period look alike.
    """
    period = 2 * np.pi / omega

    def change(later: float) -> float:
        """Return the mean square of the change, without drift."""
        return float(np.mean(np.var(changes_after(data, later), axis=0)))

    shares = {1: change(period)}
    for count in _MULTIPLES:
        if count * period * _FEWEST_PERIODS <= data.time[-1] - data.time[0]:
            shares[count] = change(count * period)
    best = min(shares, key=shares.__getitem__)
    if best == 1 or shares[1] < _MUCH_BETTER * shares[best]:
        return omega
    return refine_omega(data, omega / best)


def changes_after(data: Measurement, period: float) -> Array:
    """Return the changes of the lengths over a period, s, for all rows with a later period."""
    later = data.time + period
    inside = later <= data.time[-1]
    columns = [np.interp(later[inside], data.time, column) for column in data.lengths.T]
    return np.stack(columns, axis=1) - data.lengths[inside]


def refine_omega(data: Measurement, omega: float, spread: float | None = None) -> float:
    """Refine ω, rad/s, to the Fourier series that fits the lengths best.

    The search reaches `spread`, relative, to either side; by default one step of the period.
    """
    times = data.time - data.time[0]
    per_period = 2 * np.pi / (omega * data.step)
    periods = len(times) / per_period
    reach = 1.0 / per_period if spread is None else spread
    most = int(max(1, min(per_period // 4, len(times) // 8)))
    few, many = min(_COARSE_HARMONICS, most), min(_SEARCH_HARMONICS, most)
    # The phase of the highest harmonic at the end of the recording limits the width of a basin.
    spacing = 1 / (4 * few * max(periods, 1.0))
    count = int(np.ceil(reach / spacing))
    points = omega * (1 + spacing * np.arange(-count, count + 1))
    coarse = points[int(np.argmin([_misfit(data, times, point, few) for point in points]))]
    for harmonics in (few, many):
        width = omega / (4 * harmonics * max(periods, 1.0))
        found = minimize_scalar(
            lambda candidate, harmonics=harmonics: _misfit(data, times, candidate, harmonics),
            bounds=(coarse - width, coarse + width),
            method="bounded",
            options={"xatol": _ACCURACY * omega},
        )
        coarse = float(found.x)
    return float(coarse)


def omega_error(data: Measurement, omega: float) -> float:
    """Return the standard deviation of a refined ω, rad/s, under white noise of the lengths.

    It follows from the curvature of the squared residuals.
    """
    times = data.time - data.time[0]
    per_period = 2 * np.pi / (omega * data.step)
    harmonics = int(max(1, min(_SEARCH_HARMONICS, per_period // 4, len(times) // 8)))
    width = omega / (40 * harmonics * max(len(times) / per_period, 1.0))
    left, here, right = (
        _misfit(data, times, omega + shift, harmonics) for shift in (-width, 0.0, width)
    )
    curvature = (left - 2 * here + right) / width**2
    rows = ACTUATORS * (len(times) - 2 * harmonics - 1)
    return float(np.sqrt(2 * (1 + here) / (rows * curvature))) if curvature > 0 else np.inf


def _misfit(data: Measurement, times: Array, omega: float, harmonics: int) -> float:
    """Return minus the share of the lengths' variance that a Fourier series explains."""
    centred = data.lengths - data.lengths.mean(axis=0)
    rows = series_basis(omega * times, harmonics)
    right = rows.T @ centred
    explained = np.sum(right * np.linalg.lstsq(rows.T @ rows, right, rcond=None)[0])
    return float(-explained / np.sum(centred**2))


def whole_samples(omega: float, step: float, periods: float) -> int | None:
    """Return the number of samples per period if it is whole, else None.

    Whole means that rounding it shifts no sample of the recording by more than a hundredth of a
    step.
    """
    per_period = 2 * np.pi / (omega * step)
    nearest = round(per_period)
    drift = abs(per_period - nearest) * max(periods, 1.0)
    return nearest if drift <= _WHOLE_DRIFT else None


_LEFT, _AWAY = 0.01, 0.04
"""Shares of a strut's stroke that define the beginning of a motion and a clear departure."""
_SUDDEN = 5.0
"""Smallest ratio of the time at rest to the time between both. A motion that begins smoothly, with
the fifth power of time, has a ratio of 3.2."""
_RAMP = 0.05
"""Change over a period, as a share of a strut's stroke, that noise does not explain, in addition to
`_NOISE` times the median change."""
_BLOCK = 0.02
_MEDIANS = 4.0
"""Mean square of the changes of lengths and forces in a block of a period, in medians of it, that
belongs to a ramp."""
_WHOLE = 0.05
"""Part of a period that may be lacking to whole ones."""


def find_periodic_window(data: Measurement, omega: float) -> tuple[float, float] | None:
    """Return start and end, s, of the whole periods, ω in rad/s, between lead-in and lead-out.

    None if there are no such ramps, or if the recording is too short to show them.
    """
    period = 2 * np.pi / omega
    times, last = data.time, data.time[-1]
    channels = np.column_stack([data.lengths, data.forces])

    def change(later: float) -> Array:
        moved = times + later
        values = [np.interp(moved, times, column) for column in channels.T]
        inside = (moved >= times[0]) & (moved <= last)
        return np.where(inside[:, None], np.abs(np.column_stack(values) - channels), np.inf)

    if last - times[0] < 2 * period:
        return None
    changes = np.minimum(change(period), change(-period))
    usual = np.median(changes, axis=0)
    stroke = np.quantile(data.lengths, 0.99, axis=0) - np.quantile(data.lengths, 0.01, axis=0)
    block = max(round(_BLOCK * period / data.step), 1)
    lengths = slice(0, ACTUATORS)
    far = changes[:, lengths] > np.maximum(_NOISE * usual[lengths], _RAMP * stroke)
    ramp = median_filter(np.any(far, axis=1), 2 * block + 1, mode="nearest")
    moving = np.any(np.abs(data.lengths - np.median(data.lengths, axis=0)) > _AWAY * stroke, axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[True], ramp, [True]]).astype(int)))
    runs = [run for run in edges.reshape(-1, 2) if np.mean(moving[slice(*run)]) > _AGAIN]
    if not np.any(ramp) or not runs:
        return None
    first, end = max(runs, key=np.ptp).tolist()
    # The ends of a ramp: small changes, of the forces before the lengths.
    sizes = np.minimum(changes / np.maximum(usual, np.finfo(float).tiny), _MEDIANS**2) ** 2
    sizes = uniform_filter1d(np.mean(sizes, axis=1), block, mode="nearest")
    quiet = sizes[first:end] < _MEDIANS * np.median(sizes[first:end])
    first, end = first + int(np.argmax(quiet)), end - int(np.argmax(quiet[::-1]))
    # Whole periods in the middle: near the periods a ramp hardly differs from them.
    span = float(times[end - 1] - times[first]) + data.step
    whole = int(span / period + _WHOLE)
    if not whole:
        return None
    start = max(float(times[first]) + (span - whole * period) / 2, float(times[0]))
    start = float(times[np.searchsorted(times, start - data.step / 2)])
    return start, start + whole * period


_FEWEST_SETTLED = 4
_SPOILT = 4.0
"""Mean square of filtered channels in a block, relative to all blocks, that is no noise."""


def find_settled_window(data: Measurement, omega: float) -> tuple[float, float] | None:
    """Return start and end, s, of the periods without those at whose end a filter has not settled.

    A recording that begins or ends in the motion and was filtered afterwards has values there that
    come from no motion. None if no period is spoilt, or fewer than four are there.
    """
    count = int(len(data) * data.step * omega / (2 * np.pi) + _WHOLE)
    samples = whole_samples(omega, data.step, count)
    if samples is None or count < _FEWEST_SETTLED or data.lost or data.stamped:
        return None
    count = len(data) // samples
    groups = (data.length_sensors, data.lengths), (data.force_sensors, data.forces)
    filtered = [values for sensors, values in groups if sensors is not None]
    periods = np.column_stack(filtered)[: count * samples].reshape(count, samples, -1)
    squares = (periods - np.median(periods[1:-1], axis=0)) ** 2
    usual = np.mean(squares[1:-1], axis=(0, 1))
    sizes = np.mean(squares / np.where(usual > 0, usual, np.inf), axis=2)
    block = max(round(_BLOCK * samples), 1)
    first = int(np.mean(sizes[0, :block]) > _SPOILT)
    last = count - int(np.mean(sizes[-1, -block:]) > _SPOILT)
    if (first, last) == (0, count):
        return None
    start = float(data.time[first * samples])
    return start, start + (last - first) * samples * data.step


_NOISE = 6.0
"""Distance, in standard deviations of a length, that is not a motion."""
_FEWEST = 10
"""Rows."""
_AGAIN = 0.5
"""Share of that time for which the struts rest at the same place again if every period has a
rest."""


def find_motion_onset(data: Measurement) -> float | None:
    """Return the beginning of the motion, s, in the recording's time; None: the first row.

    A rest in every period does not count as rest before the motion.
    """
    lengths = data.lengths
    if len(lengths) < _FEWEST:
        return None
    first = np.median(lengths[:_FEWEST], axis=0)
    # Third differences hardly contain a motion, and have 20 times the variance of white noise.
    changes = np.abs(np.diff(lengths[: _FEWEST + 3], 3, axis=0))
    noise = 1.4826 * np.median(changes, axis=0) / np.sqrt(20)
    way = np.quantile(lengths, 0.99, axis=0) - np.quantile(lengths, 0.01, axis=0)
    off = np.abs(lengths - first)

    def at_place(share: float) -> NDArray[np.bool_]:
        return np.asarray(np.all(off <= np.maximum(share * way, _NOISE * noise), axis=1))

    resting = at_place(_LEFT)
    left = _runs(~resting)
    away = _runs(~at_place(_AWAY))
    if not len(left) or not len(away):
        return None
    begin, gone = int(left[0]), int(away[0])
    if begin < _FEWEST or begin <= _SUDDEN * max(gone - begin, 1):
        return None
    edges = np.flatnonzero(np.diff(np.concatenate([[0], resting[gone:].astype(int), [0]])))
    again = np.max(edges[1::2] - edges[::2], initial=0)
    return None if again >= _AGAIN * begin else float(data.time[begin])


def _runs(flags: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the indices of two consecutive flags: a single one may be an outlier."""
    return np.flatnonzero(flags[:-1] & flags[1:])


_PARTS = 10
_FEWEST_PARTS = 3
_FEWEST_ROWS = 20
"""Smallest number of rows of a part: fewer show no autocorrelation."""
_STILL = 10.0
"""Largest ratio of the variance about a straight line to that of neighbours for a length at rest.
Noise with a memory of 0.9 has this ratio, a visible motion a much larger one."""
_FEW = 4
"""Largest number of different values that the resolution alone explains."""


def is_at_rest(data: Measurement) -> bool:
    """Return whether all lengths are constant except for noise and a slow drift."""
    return all(_still(data.time, column) for column in data.lengths.T)


def _still(times: Array, values: Array) -> bool:
    if resolution_only(values):
        return True
    line = np.polynomial.Polynomial.fit(times, values, 1)
    about = float(np.mean((values - line(times)) ** 2))
    return about <= _STILL * float(np.mean(np.diff(values) ** 2)) / 2


def resolution_only(values: Array) -> bool:
    """Return whether a channel, (T,), is constant up to its last digits."""
    return len(np.unique(values)) <= _FEW


def choose_omega_at_rest(data: Measurement) -> float:
    """Choose ω, rad/s, of the equal parts into which a recording at rest is divided.

    A part is a whole number of samples. Its harmonics are as distant as possible from the multiples
    of the mains frequency, because the mean over the parts is removed.

    Raises
    ------
    PeriodError
        The recording is too short for three parts.
    """
    rows = int(data.places[-1]) + 1
    parts = min(_PARTS, rows // _FEWEST_ROWS)
    if parts < _FEWEST_PARTS:
        raise PeriodError(
            f"the machine is at rest, and {rows} samples are too few to estimate its noise: "
            f"{_FEWEST_PARTS * _FEWEST_ROWS} or more are needed"
        )
    lengths = np.arange(rows // (parts + 1) + 1, rows // parts + 1)
    mains = np.array(list(mains_frequencies(1 / data.step)))
    turns = np.multiply.outer(lengths * data.step, mains)
    nearest = np.min(np.abs(turns - np.round(turns)), axis=1, initial=1.0)
    # Among nearly equal distances, the longest part leaves out the fewest samples.
    far = np.flatnonzero(nearest >= 0.9 * np.max(nearest))
    return float(2 * np.pi / (lengths[far[-1]] * data.step))
