"""Whiteness in time, channel by channel: autocorrelations up to a lag of 20 samples.

The largest of them is tested, with Bonferroni's correction over the lags. (The sum of their squares
after Ljung and Box exceeds its χ² far too often in the tail that levels over many channels need: at
200 samples 6 times as often as 1 in 6 000.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from constraints.arrays import Array
from estimation.diagnostics.levels import NOISE

_LAGS = 20
_NOTICEABLE = 0.05
"""Autocorrelation that changes a standard error by about as many percent."""


@dataclass(frozen=True, eq=False)
class Whiteness:
    """Test of six channels.

    Attributes
    ----------
    lags : int
        Autocorrelations 1 … lags are tested.
    autocorrelation : (6, lags)
        Less what the fit takes away from white noise.
    statistic : (6,)
        Largest autocorrelation in standard deviations.
    p_values : (6,)
    level : float
        Of the family of six.
    """

    lags: int
    autocorrelation: Array
    statistic: Array
    p_values: Array
    level: float = NOISE

    @property
    def significant(self) -> NDArray[np.bool_]:
        """(6,) channels that are not white."""
        return self.p_values < self.level / len(self.p_values)

    @property
    def failed(self) -> NDArray[np.bool_]:
        """(6,) channels that are not white to an extent that matters."""
        return self.significant & (np.max(np.abs(self.autocorrelation), axis=1) > _NOTICEABLE)


def whiteness(
    values: Array,
    expected: Callable[[int, int], float] | None = None,
    level: float = NOISE,
) -> Whiteness:
    """Test series for autocorrelation.

    Parameters
    ----------
    values : (K, N, 6)
        K independent series, in time.
    expected : callable, optional
        (channel, lag) → Σ_t Cov(e_t, e_{t + lag}) / σ² of residuals whose model is right; the fit
        makes neighbours correlated.
    """
    series, samples, channels = values.shape
    lags = max(1, min(_LAGS, samples // 5))
    total = np.sum(values**2, axis=(0, 1)) / (series * samples)
    correlation = np.zeros((channels, lags))
    normalised = np.zeros((channels, lags))
    for lag in range(1, lags + 1):
        products = np.sum(values[:, :-lag] * values[:, lag:], axis=(0, 1)) / total
        pairs = series * (samples - lag)
        if expected is not None:
            products = products - np.array([expected(j, lag) for j in range(channels)])
        correlation[:, lag - 1] = products / pairs
        normalised[:, lag - 1] = products / np.sqrt(pairs)
    statistic = np.max(np.abs(normalised), axis=1)
    p_values = np.minimum(1.0, 2 * lags * stats.norm.sf(statistic))
    return Whiteness(lags, correlation, statistic, p_values, level)
