"""Whiteness in time, channel by channel: autocorrelations up to a lag of 20 samples.

The largest of them is tested, with Bonferroni's correction over the lags. (The sum of their squares
after Ljung and Box exceeds its χ² far too often in the tail that levels over many channels need: at
200 samples 6 times as often as 1 in 6 000.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy import stats

from constraints.arrays import Array
from estimation.diagnostics.channel_test import ChannelTest
from estimation.diagnostics.levels import NOISE
from expdesign.runfolder import OpenNumbers, described

_LAGS = 20
_NOTICEABLE = 0.05
"""Autocorrelation that changes a standard error by about as many percent."""


@dataclass(frozen=True, eq=False)
class Whiteness(ChannelTest):
    """Test of six channels for autocorrelation."""

    lags: Annotated[int, described("1", "autocorrelations 1 … lags are tested")]
    autocorrelation: Annotated[
        OpenNumbers, described("1", "6 × lags, less what the fit takes away from white noise")
    ]
    statistic: Annotated[
        OpenNumbers, described("1", "largest autocorrelation in standard deviations")
    ]
    p_values: Annotated[OpenNumbers, Field(alias="p"), described("1", "of each channel")]
    level: Annotated[
        float, Field(alias="family_level"), described("1", "level of the family of six")
    ] = NOISE

    @property
    def significant(self) -> NDArray[np.bool_]:
        """(6,) channels that are not white."""
        return super().failed

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
