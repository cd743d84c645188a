"""Rows of a recording in which the machine has not begun to move yet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.data.measurement import Measurement
from estimation.processing.hum import mains_frequencies
from estimation.processing.period import PeriodError

_LEFT, _AWAY = 0.01, 0.04
"""Shares of the way of a strut at which it has left its place, and is away from it."""
_SUDDEN = 5.0
"""How much longer than from one to the other it was at rest: what begins smoothly, as the fifth
power of time, takes 3.2 times as long to leave."""
_NOISE = 6.0
"""Standard deviations of a length that are no motion."""
_FEWEST = 10
"""Rows."""
_AGAIN = 0.5
"""Share of that time for which the struts are in the same place again where they rest in every
period."""


def moves_from(data: Measurement) -> float | None:
    """Return when the struts begin to move, s, in the recording's time; None: with the first row.

    A machine that rests in every period has no other rest before the first one.
    """
    lengths = data.lengths
    if len(lengths) < _FEWEST:
        return None
    first = np.median(lengths[:_FEWEST], axis=0)
    steps = np.abs(np.diff(lengths, axis=0))
    noise = 1.4826 * np.median(steps[:_FEWEST], axis=0) / np.sqrt(2)
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
    """Return where two flags follow each other: one alone may be an outlier."""
    return np.flatnonzero(flags[:-1] & flags[1:])


_PARTS = 10
_FEWEST_PARTS = 3
_FEWEST_ROWS = 20
"""Of a part: fewer show no autocorrelation."""
_STILL = 10.0
"""Variance about a straight line over that of neighbours, up to which a length is at rest: noise
with a memory of 0.9 has as much, and a motion much more that can be told from the noise at all."""
_FEW = 4
"""Values up to which it is the resolution of the measurement that is seen, and no motion."""


def at_rest(data: Measurement) -> bool:
    """Return whether all lengths stand still, but for noise and a slow drift."""
    return all(_still(data.time, column) for column in data.lengths.T)


def _still(times: Array, values: Array) -> bool:
    if resolution_only(values):
        return True
    line = np.polynomial.Polynomial.fit(times, values, 1)
    about = float(np.mean((values - line(times)) ** 2))
    return about <= _STILL * float(np.mean(np.diff(values) ** 2)) / 2


def resolution_only(values: Array) -> bool:
    """Return whether a channel, (T,), has a few values only: constant, or its last digits."""
    return len(np.unique(values)) <= _FEW


def omega_at_rest(data: Measurement) -> float:
    """Return ω, rad/s, of the equal parts into which a recording at rest is divided.

    A part is a whole number of samples, chosen with its harmonics as distant as possible from
    the multiples of the mains frequency: anything that repeats in every part is removed.

    Raises
    ------
    PeriodError
        The recording is too short for three parts.
    """
    rows = int(data.places[-1]) + 1
    parts = min(_PARTS, rows // _FEWEST_ROWS)
    if parts < _FEWEST_PARTS:
        raise PeriodError(
            f"the machine is at rest, and {rows} samples are too few to tell its noise: "
            f"{_FEWEST_PARTS * _FEWEST_ROWS} or more are needed"
        )
    lengths = np.arange(rows // (parts + 1) + 1, rows // parts + 1)
    mains = np.array(list(mains_frequencies(1 / data.step)))
    turns = np.multiply.outer(lengths * data.step, mains)
    nearest = np.min(np.abs(turns - np.round(turns)), axis=1, initial=1.0)
    # Of those that are about as far away the longest wastes the fewest samples.
    far = np.flatnonzero(nearest >= 0.9 * np.max(nearest))
    return float(2 * np.pi / (lengths[far[-1]] * data.step))
