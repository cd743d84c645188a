"""Distribution of the noise (the paper's Fig. 4), and samples that do not belong to it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field
from scipy import stats

from constraints.arrays import Array
from estimation.diagnostics.channel_test import ChannelTest, no_numbers
from estimation.diagnostics.levels import NOISE
from expdesign.runfolder import OpenNumbers, described

_SKEWED, _KURTIC = 0.1, 0.3
"""Sizes of skewness and excess kurtosis below which they change nothing that is estimated here."""
_NORMAL_MEDIAN = 0.6745
_FAR = 4.5
"""Distance of an outlier in robust standard deviations: 7 of a million normal samples."""


@dataclass(frozen=True, eq=False)
class Normality(ChannelTest):
    """Test of six channels for a normal distribution, and for outliers.

    An outlier is in the contrasts of its own and of all later periods: instants count it once.
    """

    std: Annotated[OpenNumbers, described("SI", "standard deviation")]
    skewness: Annotated[OpenNumbers, described("1", "0 for normal noise")]
    kurtosis: Annotated[
        OpenNumbers, Field(alias="excess_kurtosis"), described("1", "in excess of the normal one")
    ]
    statistic: Annotated[OpenNumbers, described("1", "D'Agostino and Pearson's K²")]
    p_values: Annotated[OpenNumbers, Field(alias="p"), described("1", "of each channel")]
    outliers: Annotated[
        NDArray[np.int64],
        BeforeValidator(np.array),
        described("1", "instants with a sample further away than 4.5 robust standard deviations"),
    ]
    outliers_expected: Annotated[float, described("1", "of normal noise, in each channel")]
    outlier_p_values: Annotated[
        OpenNumbers, Field(alias="outlier_p"), described("1", "of as many outliers")
    ]
    samples: Annotated[int, described("1", "number of samples of each channel")]
    mean: Annotated[OpenNumbers, described("SI", "mean")] = field(default_factory=no_numbers)
    level: Annotated[
        float,
        Field(alias="family_level"),
        described("1", "level of each of the two families of six"),
    ] = NOISE

    @property
    def significant(self) -> NDArray[np.bool_]:
        """(6,) channels that are not normal: with many samples, no real channel is."""
        return super().failed

    @property
    def failed(self) -> NDArray[np.bool_]:
        """(6,) channels that are not normal to an extent that matters."""
        large = (np.abs(self.skewness) > _SKEWED) | (np.abs(self.kurtosis) > _KURTIC)
        return self.significant & large

    @property
    def with_outliers(self) -> NDArray[np.bool_]:
        """(6,) channels with more outliers than normal noise has."""
        return self.outlier_p_values < self.level / len(self.outlier_p_values)


def normality(values: Array, level: float = NOISE) -> Normality:
    """Test independent samples, (K, N, 6): K series at N instants, 20 samples or more."""
    samples = values.reshape(-1, values.shape[2])
    centred = np.abs(values - np.median(samples, axis=0))
    scale = np.median(centred, axis=(0, 1)) / _NORMAL_MEDIAN
    far = centred > _FAR * np.where(scale > 0, scale, np.inf)
    outliers = np.count_nonzero(np.any(far, axis=0), axis=0)
    chance = -np.expm1(len(values) * np.log1p(-2 * stats.norm.sf(_FAR)))
    expected = float(values.shape[1] * chance)
    test = stats.normaltest(samples, axis=0)
    return Normality(
        mean=samples.mean(axis=0),
        std=samples.std(axis=0, ddof=1),
        skewness=stats.skew(samples, axis=0),
        kurtosis=stats.kurtosis(samples, axis=0),
        statistic=np.asarray(test.statistic),
        p_values=np.asarray(test.pvalue),
        outliers=outliers,
        outliers_expected=expected,
        outlier_p_values=stats.poisson.sf(outliers - 1, expected),
        samples=len(samples),
        level=level,
    )
