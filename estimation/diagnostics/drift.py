"""Slow change between periods: one-way analysis of variance of the period means."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy import stats

from constraints.arrays import Array
from estimation.diagnostics.channel_test import ChannelTest, no_numbers
from estimation.diagnostics.levels import NOISE
from expdesign.runfolder import OpenNumbers, described


@dataclass(frozen=True, eq=False)
class Drift(ChannelTest):
    """Test of six channels for change from period to period, or why it was not done."""

    refused: Annotated[str, described("", "why there is no test; empty when there is one")]
    means: Annotated[
        OpenNumbers,
        Field(alias="period_means"),
        described("SI", "periods × 6: mean of every period, less the mean of all"),
    ] = field(default_factory=lambda: np.zeros((0, 6)))
    std_error: Annotated[OpenNumbers, described("SI", "of each of these means")] = field(
        default_factory=no_numbers
    )
    slope: Annotated[
        OpenNumbers, Field(alias="slope_per_period"), described("SI", "trend per period")
    ] = field(default_factory=no_numbers)
    statistic: Annotated[OpenNumbers, Field(alias="f"), described("1", "F of each channel")] = (
        field(default_factory=no_numbers)
    )
    p_values: Annotated[OpenNumbers, Field(alias="p"), described("1", "of each channel")] = field(
        default_factory=no_numbers
    )
    level: Annotated[
        float, Field(alias="family_level"), described("1", "level of the family of six")
    ] = NOISE

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
        return Drift("one period shows no change between periods", level=level)
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
