"""Slow drift of the length measurement, as from a machine that warms up."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from expdesign.mechanism.hexapod import ACTUATORS


def final_drift(size: float, rng: np.random.Generator) -> Array:
    """Return the drift of the six lengths at the end of the experiment, m: size with its sign."""
    return size * rng.choice((-1.0, 1.0), ACTUATORS)


def length_drift(final: Array, time: Array, duration: float) -> Array:
    """Return the drift of the measured lengths: half a cosine from 0 to its final value.

    Parameters
    ----------
    final : (6,)
        Value at the end, m.
    time : (T,)
        s, from the start.
    duration : float
        Of the experiment, s.

    Returns
    -------
    (T, 6)
        m.
    """
    return np.multiply.outer((1 - np.cos(np.pi * time / duration)) / 2, final)
