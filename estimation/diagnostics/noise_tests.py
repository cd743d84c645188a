"""Tests of the noise of six channels: whiteness, distribution and outliers, change over periods.

Whiteness: autocorrelations up to a lag of 20 samples, of which the largest is tested, with
Bonferroni's correction over the lags. (The sum of their squares after Ljung and Box exceeds its χ²
far too often in the tail that levels over many channels need: at 200 samples 6 times as often as 1
in 6 000.) Distribution: D'Agostino and Pearson (the paper's Fig. 4). Change between periods:
one-way analysis of variance of their means.

Whether the periods of a record are compared sample by sample, and why not.

Only contrasts between periods hold noise and no signal whatever the model is: the tests of memory,
of change from period to period and of a hum are made from them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import Field

from constraints.arrays import Array
from estimation.diagnostics.significance import NOISE, ChannelTest, OfEach, below_level, no_numbers
from estimation.processing import NoiseModel, PeriodicRecording
from estimation.processing.noise import NORMAL_MEDIAN
from estimation.processing.smoothing import contrasts
from estimation.processing.whitening_filter import WhiteningFilter
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.runfolder import OpenNumber, OpenNumbers, WholeNumbers, described, sized

_LAGS = 20
_NOTICEABLE = 0.05
"""Autocorrelation that changes a standard error by about as many percent."""
_SKEWED, _KURTIC = 0.1, 0.3
"""Sizes of skewness and excess kurtosis below which they change nothing that is estimated here."""
_FAR = 4.5
"""Distance of an outlier in robust standard deviations: 7 of a million normal samples."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Whiteness(ChannelTest):
    """Test of six channels for autocorrelation."""

    lags: Annotated[int, described("1", "autocorrelations 1 … lags are tested")]
    autocorrelation: Annotated[
        OpenNumbers,
        sized(ACTUATORS, None),
        described("1", "6 × lags, less what the fit takes away"),
    ]
    statistic: Annotated[OfEach, described("1", "largest autocorrelation in standard deviations")]

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
    p_values = np.minimum(1.0, 2 * lags * scipy.stats.norm.sf(statistic))
    return Whiteness(
        lags=lags,
        autocorrelation=correlation,
        statistic=statistic,
        p_values=p_values,
        level=level,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Normality(ChannelTest):
    """Test of six channels for a normal distribution, and for outliers.

    An outlier is in the contrasts of its own and of all later periods: instants count it once.
    """

    std: Annotated[OfEach, described("SI", "standard deviation")]
    skewness: Annotated[OfEach, described("1", "0 for normal noise")]
    kurtosis: Annotated[
        OfEach, Field(alias="excess_kurtosis"), described("1", "in excess of the normal one")
    ]
    statistic: Annotated[OfEach, described("1", "D'Agostino and Pearson's K²")]
    outliers: Annotated[
        WholeNumbers,
        sized(ACTUATORS),
        described("1", "instants with a sample further away than 4.5 robust standard deviations"),
    ]
    outliers_expected: Annotated[float, described("1", "of normal noise, in each channel")]
    outlier_p_values: Annotated[
        OfEach, Field(alias="outlier_p"), described("1", "of as many outliers")
    ]
    samples: Annotated[int, described("1", "number of samples of each channel")]
    mean: Annotated[OfEach, described("SI", "mean")] = field(default_factory=no_numbers)

    @property
    def failed(self) -> NDArray[np.bool_]:
        """(6,) channels that are not normal to an extent that matters."""
        large = (np.abs(self.skewness) > _SKEWED) | (np.abs(self.kurtosis) > _KURTIC)
        return self.significant & large

    @property
    def with_outliers(self) -> NDArray[np.bool_]:
        """(6,) channels with more outliers than normal noise has."""
        return below_level(self.outlier_p_values, self.level)


def normality(values: Array, level: float = NOISE) -> Normality:
    """Test independent samples, (K, N, 6): K series at N instants, 20 samples or more."""
    samples = values.reshape(-1, values.shape[2])
    centred = np.abs(values - np.median(samples, axis=0))
    scale = np.median(centred, axis=(0, 1)) / NORMAL_MEDIAN
    far = centred > _FAR * np.where(scale > 0, scale, np.inf)
    outliers = np.count_nonzero(np.any(far, axis=0), axis=0)
    chance = -np.expm1(len(values) * np.log1p(-2 * scipy.stats.norm.sf(_FAR)))
    expected = float(values.shape[1] * chance)
    test = scipy.stats.normaltest(samples, axis=0)
    return Normality(
        mean=samples.mean(axis=0),
        std=samples.std(axis=0, ddof=1),
        skewness=scipy.stats.skew(samples, axis=0),
        kurtosis=scipy.stats.kurtosis(samples, axis=0),
        statistic=np.asarray(test.statistic),
        p_values=np.asarray(test.pvalue),
        outliers=outliers,
        outliers_expected=expected,
        outlier_p_values=scipy.stats.poisson.sf(outliers - 1, expected),
        samples=len(samples),
        level=level,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Drift(ChannelTest):
    """Test of six channels for change from period to period, or why it was not done."""

    means: Annotated[
        OpenNumbers,
        sized(None, ACTUATORS),
        Field(alias="period_means"),
        described("SI", "periods × 6: mean of every period, less the mean of all"),
    ] = field(default_factory=lambda: np.zeros((0, ACTUATORS)))
    std_error: Annotated[OfEach, described("SI", "of each of these means")] = field(
        default_factory=no_numbers
    )
    slope: Annotated[
        OfEach, Field(alias="slope_per_period"), described("SI", "trend per period")
    ] = field(default_factory=no_numbers)
    statistic: Annotated[OfEach, Field(alias="f"), described("1", "F of each channel")] = field(
        default_factory=no_numbers
    )

    @property
    def extent(self) -> Array:
        """(6,) largest less smallest mean."""
        return np.ptp(self.means, axis=0) if len(self.means) else np.full(ACTUATORS, np.nan)


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
        return Drift(refused="one period shows no change between periods", level=level)
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
        means=centred,
        std_error=np.sqrt(variance * (1 - 1 / count) / sizes.mean()),
        slope=number @ centred / np.sum(number**2),
        statistic=statistic,
        p_values=scipy.stats.f.sf(statistic, count - 1, freedom),
        level=level,
    )


@dataclass(frozen=True, eq=False)
class Normalities:
    """Tests of the noise's distribution."""

    source: Annotated[str, described("", "periods, or residuals where they cannot be compared")]
    forces: Annotated[Normality, described("", "of the forces")]
    lengths: Annotated[Normality | None, described("", "of the lengths")]
    taken: Annotated[
        float | None,
        described("1", "samples' worth of weight that the robust loss took; null: it was not used"),
    ] = None


@dataclass(frozen=True, eq=False)
class Drifts:
    """Tests for change from period to period."""

    forces: Annotated[Drift, described("", "of the forces")]
    lengths: Annotated[Drift | None, described("", "of the lengths")]


@dataclass(frozen=True, eq=False)
class Whitenesses:
    """Tests for autocorrelation; null where there is nothing to test.

    Those of residuals are taken behind the filter that makes the noise white.
    """

    force_noise: Annotated[Whiteness | None, described("", "scatter between periods")]
    length_noise: Annotated[Whiteness | None, described("", "scatter between periods")]
    force_residuals: Annotated[
        Whiteness | None, described("", "mean residuals, with the effects found taken as known")
    ] = None
    length_residuals: Annotated[Whiteness | None, described("", "mean residuals")] = None
    counted: Annotated[
        bool,
        described("", "the standard deviations count the noise as it is, white or not"),
    ] = False
    refused: Annotated[
        str, described("", "why the noise is not tested; empty: its periods are compared")
    ] = ""
    std_ratio: Annotated[
        OpenNumber,
        described("1", "largest standard deviation over the one that white noise would make"),
    ] = np.nan
    std_ratio_p: Annotated[
        OpenNumber, described("1", "p of a ratio so large if the noise is white")
    ] = np.nan
    std_ratio_of: Annotated[str, described("", "the parameter whose ratio that is")] = ""


@dataclass(frozen=True, eq=False)
class NoiseTests:
    """Samples of the forces' noise, (K N, 6) in N, and the tests of the noise."""

    samples: Array
    whiteness: Whitenesses
    normality: Normalities
    drift: Drifts


def noise_tests(
    record: PeriodicRecording,
    noise: NoiseModel,
    forces: Array,
    lengths: Array | None,
    level: float = NOISE,
) -> NoiseTests:
    """Test the noise of a record.

    Distribution and change over the periods are told behind the filters that make the noise white.

    Parameters
    ----------
    noise : NoiseModel
        Whose filters and spectra were used.
    forces, lengths : (T, 6)
        Residuals of the record's rows, which serve where periods cannot be compared; None: there
        are none.
    """
    samples, white, normal, change = _of_one_kind(
        record, record.forces.periods, noise.forces.filter, forces, level
    )
    if samples is None or normal is None or change is None:
        raise AssertionError("forces leave residuals")
    lengths_tested = _of_one_kind(
        record, record.lengths.periods, noise.lengths.filter, lengths, level
    )
    _, length_white, length_normal, length_change = lengths_tested
    counted = noise.forces.lines is not None
    if length_white is not None:
        counted = counted and noise.lengths.lines is not None
    return NoiseTests(
        samples.reshape(-1, forces.shape[1]),
        Whitenesses(white, length_white, counted=counted, refused=why_not_compared(record)),
        Normalities(
            "residuals" if white is None else "periods",
            normal,
            length_normal,
            record.weight_taken if record.robust else None,
        ),
        Drifts(change, length_change),
    )


def _of_one_kind(
    record: PeriodicRecording,
    periods: Array | None,
    noise_filter: WhiteningFilter | None,
    rows: Array | None,
    level: float,
) -> tuple[Array | None, Whiteness | None, Normality | None, Drift | None]:
    """Return samples of the noise, (K, N, 6), and the tests of forces or lengths."""
    samples, white, change = None, None, None
    if periods is not None and len(periods) > 1:
        samples = contrasts(periods)
        white = whiteness(samples, level=level)
        if noise_filter is not None:
            periods = np.stack([noise_filter(period) for period in periods])
            # What it makes of the jump from a period's end to its begin looks like outliers.
            ends = noise_filter.reach(samples.std(axis=(0, 1)))
            samples = contrasts(periods)[:, ends : noise_filter.samples - ends]
    elif rows is not None:
        samples = rows[None] - rows.mean(axis=0)
    if periods is not None:
        count, phases, channels = periods.shape
        values = (periods - periods.mean(axis=0)).reshape(-1, channels)
        change = drift(values, np.repeat(np.arange(count), phases), phases, level)
    elif record.averaged and (reason := why_not_compared(record)):
        change = Drift(refused=reason, level=level)
    elif rows is not None:
        block = np.arange(len(rows)) * max(1, round(record.periods)) // len(rows)
        change = drift(rows, block, 0, level)
    return samples, white, None if samples is None else normality(samples, level), change


_FEWEST = 2


def why_not_compared(record: PeriodicRecording) -> str:
    """Return why no two periods are compared sample by sample; empty where they are."""
    if record.averaged and record.forces.periods is not None:
        few = len(record.forces.periods) < _FEWEST
        return "there is one period, and nothing to compare it with" if few else ""
    if record.lost:
        missing = "1 sample is" if record.lost == 1 else f"{record.lost} samples are"
        return (
            f"{missing} missing in the recording, and periods are compared sample by sample only "
            "where none is"
        )
    if record.stamped:
        return "stamped samples keep their own times, and no two periods have the same"
    return (
        "samples keep their own times where the frequency is estimated or a period is no whole "
        f"number of them ({record.period / record.step:.6g}), and no two periods have the same"
    )
