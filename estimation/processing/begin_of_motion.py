"""Rows of a recording in which the machine has not begun to move yet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimation.data.measurement import Measurement

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
