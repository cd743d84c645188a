"""Weights against outliers: samples far from what the other periods show count less."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from estimation.processing.noise import NoiseEstimate, scatter_about_series

_NORMAL_MEDIAN = 0.6745
"""Median of |x| for a standard normal x: turns a median absolute deviation into a std."""

_CUT = 4.0
"""Normalised distance up to which a sample has its full weight: one in 16 000 normal ones is
beyond it in one channel, so that clean data keep their efficiency and their covariance."""

FEWEST_PERIODS = 3
"""Periods from which on the median over them tells which sample is the odd one."""

_MOST_PAIRS = 20
_ROUNDS = 3
_NEARLY_ALL = 0.95


def huber_weights(values: Array) -> Array:
    """Return a weight in (0, 1] for every sample, (M, N), from its distance to its fellows.

    Parameters
    ----------
    values : (M, N, 6)
        M ≥ 3 periods.

    Notes
    -----
    The weight is min(1, (4/d)²) with d the largest distance among the six channels from the median
    over the periods, in robust standard deviations: the square bounds an outlier's influence on
    means and on covariances. The scale comes from differences of periods, which hold twice the
    variance whatever M is; a median of few periods follows them, and its distances are too small.

    Raises
    ------
    ValueError
        Fewer than three periods: their median does not tell which sample is the odd one.
    """
    periods = len(values)
    if periods < FEWEST_PERIODS:
        raise ValueError(f"distances from a median need {FEWEST_PERIODS} periods, not {periods}")
    firsts = range(0, periods, max(1, periods // _MOST_PAIRS))
    differences = np.concatenate([values[i] - values[i - 1] for i in firsts])
    scale = _robust_std(differences) / np.sqrt(2)
    # A sample's distance from the mean of all others has this much more than its own variance.
    return _weights(values - np.median(values, axis=0), scale * np.sqrt(periods / (periods - 1)))


def series_weights(
    times: Array, values: Array, omega: float, harmonics: int
) -> tuple[NoiseEstimate, Array]:
    """Return the covariance about a Fourier series and a weight for every sample, (T,).

    Parameters
    ----------
    times : (T,)
        s.
    values : (T, 6)

    Notes
    -----
    As `huber_weights`, with distances from the series, which is fitted again with the weights.
    """
    weights = np.ones(len(times))
    scatter, residuals = scatter_about_series(times, values, omega, harmonics)
    for _ in range(_ROUNDS):
        weights = _weights(residuals, _robust_std(residuals))
        scatter, residuals = scatter_about_series(times, values, omega, harmonics, weights)
    return scatter, weights


def _robust_std(values: Array) -> Array:
    """Return the standard deviation of each column, (6,), whatever a few outliers are."""
    size = np.abs(values)
    middle = np.median(size, axis=0) / _NORMAL_MEDIAN
    # Where more than half is exactly zero, as after coarse quantisation, the median says nothing.
    most = np.minimum(size, np.quantile(size, _NEARLY_ALL, axis=0))
    return np.where(middle > 0, middle, np.sqrt(np.mean(most**2, axis=0)))


def _weights(distances: Array, scale: Array) -> Array:
    scale = np.where(scale > 0, scale, np.inf)
    distance = np.max(np.abs(distances) / scale, axis=-1)
    return np.minimum(1.0, (_CUT / np.maximum(distance, _CUT)) ** 2)
