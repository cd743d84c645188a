"""Tests of the noise of six channels: whiteness, distribution, outliers, drift between periods.

Whiteness: the largest autocorrelation up to a lag of 20 samples, with Bonferroni's correction over
the lags. (The sum of squares after Ljung and Box exceeds its χ² far too often in the tail that
levels over many channels need: at 200 samples 6 times as often as 1 in 6 000.) Distribution:
D'Agostino and Pearson (the paper's Fig. 4). Drift between periods: one-way analysis of variance of
their means.

Contrasts between periods contain noise and no signal, independently of the model. The tests of
whiteness, of drift and of a hum use them; `why_not_compared` states why a recording has none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import Field

from constraints.arrays import Array
from estimation.diagnostics.significance import NOISE, ChannelTest, OfEach, below_level, no_numbers
from estimation.processing import Channels, NoiseModel, PeriodicRecording, PeriodSource
from estimation.processing.noise import NORMAL_MEDIAN
from estimation.processing.spectrum import WhiteningFilter, contrasts
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.runfolder import OpenNumber, OpenNumbers, WholeNumbers, described, sized

_LAGS = 20
_NOTICEABLE = 0.05
"""Relevant autocorrelation: it changes a standard error by about the same share."""
_SKEWED, _KURTIC = 0.1, 0.3
"""Skewness and excess kurtosis below which their effect on the estimates is negligible."""
_FAR = 4.5
"""Distance of an outlier in robust standard deviations: 7 in a million normal samples."""

_FEWEST = 2


@dataclass(frozen=True, eq=False, kw_only=True)
class Whiteness(ChannelTest):
    """Test of six channels for autocorrelation."""

    lags: Annotated[int, described("1", "autocorrelations 1 … lags are tested")]
    autocorrelation: Annotated[
        OpenNumbers,
        sized(ACTUATORS, None),
        described("1", "6 × lags, minus the part due to the fit"),
    ]
    statistic: Annotated[OfEach, described("1", "largest autocorrelation in standard deviations")]

    @property
    def failed(self) -> NDArray[np.bool_]:
        """(6,), channels with a relevant autocorrelation."""
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
        (channel, lag) → Σ_t Cov(e_t, e_{t + lag}) / σ² of residuals of a correct model, whose
        neighbours are correlated by the fit; for lag 0 that less the number of samples.
    """
    series, samples, channels = values.shape
    lags = max(1, min(_LAGS, samples // 5))
    total = np.sum(values**2, axis=(0, 1)) / (series * samples)
    free = np.ones(channels)  # share of the degrees of freedom that the fit leaves
    if expected is not None:
        free += np.array([expected(j, 0) for j in range(channels)]) / (series * samples)
    correlation = np.zeros((channels, lags))
    normalised = np.zeros((channels, lags))
    for lag in range(1, lags + 1):
        products = np.sum(values[:, :-lag] * values[:, lag:], axis=(0, 1)) / total * free
        pairs = series * (samples - lag)
        if expected is not None:
            products = products - np.array([expected(j, lag) for j in range(channels)])
        # Fewer pairs than samples: that of a slow drift would exceed 1.
        correlation[:, lag - 1] = np.clip(products / pairs, -1.0, 1.0)
        normalised[:, lag - 1] = products / np.sqrt(pairs * free)
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

    An outlier affects the contrasts of its period and of all later ones; it counts once, by its
    instant.
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
    outliers_expected: Annotated[
        float, described("1", "expected number for normal noise, per channel")
    ]
    outlier_p_values: Annotated[
        OfEach, Field(alias="outlier_p"), described("1", "p of as many outliers")
    ]
    samples: Annotated[int, described("1", "number of samples of each channel")]
    mean: Annotated[OfEach, described("SI", "mean")] = field(default_factory=no_numbers)
    size_over: Annotated[
        str,
        described("", "speed, force or phase, on which the size of the noise depends, or empty"),
    ] = ""
    size_ratio: Annotated[
        OfEach,
        described("1", "largest over smallest standard deviation; 1: the size does not depend"),
    ] = field(default_factory=no_numbers)
    size_weighted: Annotated[
        bool, described("", "the weights of the estimate account for the size")
    ] = False

    @property
    def failed(self) -> NDArray[np.bool_]:
        """(6,), channels with a relevant deviation from the normal distribution."""
        large = (np.abs(self.skewness) > _SKEWED) | (np.abs(self.kurtosis) > _KURTIC)
        return self.significant & large

    @property
    def with_outliers(self) -> NDArray[np.bool_]:
        """(6,), channels with more outliers than normal noise."""
        return below_level(self.outlier_p_values, self.level)


def normality(values: Array, level: float = NOISE) -> Normality:
    """Test independent samples, (K, N, 6), K series at N instants; at least 20 samples."""
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
    """Test of six channels for a drift from period to period."""

    means: Annotated[
        OpenNumbers,
        sized(None, ACTUATORS),
        Field(alias="period_means"),
        described("SI", "periods × 6: mean of every period, less the mean of all"),
    ] = field(default_factory=lambda: np.zeros((0, ACTUATORS)))
    std_error: Annotated[OfEach, described("SI", "standard error of each of these means")] = field(
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
        """(6,), largest minus smallest mean."""
        return np.ptp(self.means, axis=0) if len(self.means) else np.full(ACTUATORS, np.nan)


def drift(values: Array, block: NDArray[np.intp], phases: int, level: float = NOISE) -> Drift:
    """Test whether the means of blocks differ.

    Parameters
    ----------
    values : (T, 6)
        Deviations from the signal that repeats in every period.
    block : (T,)
        Period of each row, from 0.
    phases : int
        Number of means over the periods that were subtracted from the values (0: none).
    """
    count = int(block[-1]) + 1
    if count < 2:  # noqa: PLR2004 - a difference takes two
        return Drift(refused="one period shows no drift between periods", level=level)
    sizes = np.bincount(block, minlength=count).astype(float)
    sums = np.stack([np.bincount(block, column, minlength=count) for column in values.T], axis=1)
    centred = sums / sizes[:, None] - values.mean(axis=0)
    between = np.sum(sizes[:, None] * centred**2, axis=0)
    inner = np.sum((values - values.mean(axis=0)) ** 2, axis=0) - between
    freedom = len(values) - count - max(phases - 1, 0)
    variance = inner / freedom
    statistic = np.zeros_like(between)
    np.divide(between / (count - 1), variance, out=statistic, where=variance > 0)
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

    source: Annotated[str, described("", "periods; residuals if periods cannot be compared")]
    forces: Annotated[Normality, described("", "test of the forces")]
    lengths: Annotated[Normality | None, described("", "test of the lengths")]
    taken: Annotated[
        float | None,
        described("1", "weight removed by the robust loss, in samples; null: not used"),
    ] = None


@dataclass(frozen=True, eq=False)
class Drifts:
    """Tests for change from period to period."""

    forces: Annotated[Drift, described("", "test of the forces")]
    lengths: Annotated[Drift | None, described("", "test of the lengths")]


@dataclass(frozen=True, eq=False)
class Whitenesses:
    """Tests for autocorrelation; null if a test is impossible.

    The residuals are tested after the whitening filter.
    """

    force_noise: Annotated[Whiteness | None, described("", "scatter between periods")]
    length_noise: Annotated[Whiteness | None, described("", "scatter between periods")]
    force_residuals: Annotated[
        Whiteness | None, described("", "mean residuals, given the effects found")
    ] = None
    length_residuals: Annotated[Whiteness | None, described("", "mean residuals")] = None
    counted: Annotated[
        bool,
        described("", "the standard deviations account for the colour of the noise"),
    ] = False
    refused: Annotated[
        str, described("", "reason for an omitted test of the noise; otherwise empty")
    ] = ""
    std_ratio: Annotated[
        OpenNumber,
        described("1", "largest ratio of a standard deviation to that under white noise"),
    ] = np.nan
    std_ratio_p: Annotated[OpenNumber, described("1", "p of this ratio under white noise")] = np.nan
    std_ratio_of: Annotated[str, described("", "parameter with this ratio")] = ""


@dataclass(frozen=True, eq=False)
class NoiseTests:
    """Tests of the noise, with the samples of the forces' noise, (K N, 6), N."""

    samples: Array
    whiteness: Whitenesses
    normality: Normalities
    drift: Drifts


def noise_tests(
    recording: PeriodicRecording,
    noise: NoiseModel,
    forces: Array,
    lengths: Array | None,
    level: float = NOISE,
    *,
    centred: tuple[Array, Array | None] | None = None,
) -> NoiseTests:
    """Test the noise of a recording.

    Distribution and drift are tested after the whitening filters.

    Parameters
    ----------
    noise : NoiseModel
        Noise with the filters and spectra in use.
    forces, lengths : (T, 6)
        Residuals of the recording's rows, used if periods cannot be compared; None: there are none.
    centred : two of (T, 6), optional
        The same less their means at equal phases, which contain the errors of the model.
    """
    force_rows, length_rows = (forces, lengths) if centred is None else centred
    samples, white, normal, change = _test_channels(
        recording, recording.forces, noise.forces.filter, (forces, force_rows), level
    )
    if samples is None or normal is None or change is None:
        raise AssertionError("forces leave residuals")
    lengths_tested = _test_channels(
        recording, recording.lengths, noise.lengths.filter, (lengths, length_rows), level
    )
    _, length_white, length_normal, length_change = lengths_tested
    counted, repeats = noise.forces.lines is not None, recording.forces.repeats
    if length_white is not None:
        counted = counted and noise.lengths.lines is not None
    return NoiseTests(
        samples.reshape(-1, ACTUATORS),
        Whitenesses(white, length_white, counted=counted, refused=why_not_compared(recording)),
        Normalities(
            "residuals" if repeats is None or len(repeats) == 1 else "periods",
            normal,
            length_normal,
            recording.weight_taken if recording.robust else None,
        ),
        Drifts(change, length_change),
    )


def _test_channels(
    recording: PeriodicRecording,
    channels: Channels,
    noise_filter: WhiteningFilter | None,
    residuals: tuple[Array | None, Array | None],
    level: float,
) -> tuple[Array | None, Whiteness | None, Normality | None, Drift | None]:
    """Return samples of the noise, (K, N, 6), and the tests of forces or lengths."""
    samples, white, change, profile = None, None, None, channels.profile
    rows, centred = residuals
    periods = measured = channels.periods
    if periods is not None and measured is not None and len(periods) > 1:
        # A filter of the sensors makes white noise blue in the values before it.
        recorded = np.moveaxis(channels.as_recorded(np.moveaxis(periods, 0, 2)), 2, 0)
        periods = recorded if profile is None else recorded / profile.std
        samples = contrasts(periods)
        white = whiteness(samples, level=level)
        if noise_filter is not None:
            scaled = profile is not None and noise_filter.size is None
            filtered = periods if scaled else measured
            periods = np.stack([noise_filter(period) for period in filtered])
            # The jump between a period's end and beginning appears as outliers after the filter.
            ends = noise_filter.reach(samples.std(axis=(0, 1)))
            samples = contrasts(periods)[:, ends : noise_filter.count - ends]
    elif channels.repeats is not None and len(channels.repeats) > 1:
        # Missing samples are the means over the periods: errors of the model are no outliers.
        samples = contrasts(channels.repeats if profile is None else channels.repeats / profile.std)
    elif centred is not None:
        samples = centred[None] - centred.mean(axis=0)
    if periods is not None:
        count, phases = periods.shape[:2]
        values = (periods - periods.mean(axis=0)).reshape(count * phases, -1)
        change = drift(values, np.repeat(np.arange(count), phases), phases, level)
    elif recording.averaged and (reason := why_not_compared(recording)):
        change = Drift(refused=reason, level=level)
    elif rows is not None:
        block = np.arange(len(rows)) * max(1, round(recording.periods)) // len(rows)
        change = drift(rows, block, 0, level)
    normal = None if samples is None else normality(samples, level)
    if normal is not None and profile is not None:
        weighted = noise_filter is not None and noise_filter.size is not None
        normal = replace(
            normal, size_over=profile.over, size_ratio=profile.ratio, size_weighted=weighted
        )
    return samples, white, normal, change


def why_not_compared(recording: PeriodicRecording) -> str:
    """Return the reason why periods are not compared sample by sample; empty if they are."""
    if recording.averaged and recording.forces.periods is not None:
        few = len(recording.forces.periods) < _FEWEST
        return "a comparison needs two or more periods" if few else ""
    if recording.source is PeriodSource.NONE:
        return "the motion has no period"
    if recording.lost:
        missing = "1 sample is" if recording.lost == 1 else f"{recording.lost} samples are"
        return (
            f"{missing} missing in the recording: periods are compared sample by sample only "
            "if it is complete"
        )
    if recording.stamped:
        return "stamped samples have different times in every period"
    return (
        "samples have different times in every period if the frequency is estimated or a period is "
        f"not a whole number of samples ({recording.period / recording.step:.6g})"
    )
