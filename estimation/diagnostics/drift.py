"""Slow change between periods: one-way analysis of variance of the period means."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from constraints.arrays import Array
from estimation.diagnostics.levels import NOISE


@dataclass(frozen=True, eq=False)
class Drift:
    """Test of six channels, or why it was not done.

    Attributes
    ----------
    refused : str
    means : (M, 6)
        Of every period, less the mean of all, SI.
    std_error : (6,)
        Of each of these means.
    slope : (6,)
        Trend, SI per period.
    statistic, p_values : (6,)
    level : float
        Of the family of six.
    """

    refused: str
    means: Array
    std_error: Array
    slope: Array
    statistic: Array
    p_values: Array
    level: float = NOISE

    @property
    def failed(self) -> NDArray[np.bool_]:
        """(6,) channels that change from period to period."""
        return self.p_values < self.level / len(self.p_values)

    @property
    def extent(self) -> Array:
        """(6,) largest less smallest mean."""
        return np.ptp(self.means, axis=0) if len(self.means) else np.full(6, np.nan)


def drift(values: Array, block: NDArray[np.intp], phases: int, level: float = NOISE) -> Drift:
    """Test whether the means of blocks differ.

    Parameters
    ----------
    values : (T, 6)
        Deviations from what repeats in every period.
    block : (T,)
        Period of each row, from 0.
    phases : int
        How many means over the periods were taken out of the values (0: none).
    """
    count = int(block[-1]) + 1
    if count < 2:  # noqa: PLR2004 - a difference takes two
        nothing = np.full(6, np.nan)
        reason = "one period shows no change between periods"
        return Drift(reason, np.zeros((0, 6)), nothing, nothing, nothing, nothing, level)
    sizes = np.bincount(block, minlength=count).astype(float)
    sums = np.stack([np.bincount(block, column, minlength=count) for column in values.T], axis=1)
    centred = sums / sizes[:, None] - values.mean(axis=0)
    between = np.sum(sizes[:, None] * centred**2, axis=0)
    inner = np.sum((values - values.mean(axis=0)) ** 2, axis=0) - between
    freedom = len(values) - count - max(phases - 1, 0)
    variance = inner / freedom
    statistic = between / (count - 1) / variance
    number = np.arange(count) - (count - 1) / 2
    return Drift(
        refused="",
        means=centred,
        std_error=np.sqrt(variance * (1 - 1 / count) / sizes.mean()),
        slope=number @ centred / np.sum(number**2),
        statistic=statistic,
        p_values=stats.f.sf(statistic, count - 1, freedom),
        level=level,
    )
