"""A recording of a machine at rest: any part of it repeats, so any length serves as a period."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from estimation.data.measurement import Measurement
from estimation.processing.hum import mains_frequencies
from estimation.processing.period import PeriodError

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
    """Return ω, rad/s, of the parts into which a recording at rest is cut to be compared.

    A part is a whole number of samples, and the multiples of the mains are as far as can be
    from its harmonics: what repeats in every part is taken out with them.

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
