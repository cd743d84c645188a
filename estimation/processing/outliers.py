"""Weights against outliers: samples far from what the other periods show count less."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_NORMAL_MEDIAN = 0.6745
"""Median of |x| for a standard normal x: turns a median absolute deviation into a std."""

_CUT = 4.0
"""Normalised distance up to which a sample has its full weight: one in 16 000 normal ones is
beyond it in one channel, so that clean data keep their efficiency and their covariance."""


def huber_weights(values: Array) -> Array:
    """Return a weight in (0, 1] for every sample, (M, N).

    Parameters
    ----------
    values : (M, N, 6)
        M periods; with M ≥ 3 distances are taken from the median over the periods, else from
        zero, as befits residuals.

    Notes
    -----
    The weight is min(1, (4/d)²) with d the largest distance among the six channels in robust
    standard deviations: the square bounds an outlier's influence on means and on covariances.
    """
    centred = values - np.median(values, axis=0) if len(values) > 2 else values  # noqa: PLR2004
    scale = np.median(np.abs(centred), axis=(0, 1)) / _NORMAL_MEDIAN
    if len(values) > 2:  # noqa: PLR2004
        # The median follows the samples: their deviations from it are too small.
        scale = scale * np.sqrt(len(values) / (len(values) - 1))
    scale = np.where(scale > 0, scale, np.inf)
    distance = np.max(np.abs(centred) / scale, axis=2)
    return np.minimum(1.0, (_CUT / np.maximum(distance, _CUT)) ** 2)
