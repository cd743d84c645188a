"""Residuals of an estimate: χ², lack of fit, and their display.

`chi_square` uses the full covariance of the noise. `lack_of_fit` tests every actuator for a bias,
comparing the means over the periods with the scatter between them:

    MS_lof = M Σ(period-mean residual)² / (N − ν_j),   MS_pe = scatter between the M periods,
    F_j = MS_lof / MS_pe.

ν_j is the number of degrees of freedom that the parameters (and the motion) take: N minus the trace
of Cov(e_j) in units of the noise, so that E[MS_lof] = σ_j² for a correct model. For held-out data
ν_j = 0, and A Cov(p̂) Aᵀ adds to the expected variance. The p-value belongs to the sum of squares
with all eigenvalues of Cov(e_j); it is that of F if Cov(e_j) is a projection.

This test spreads over N samples, and a small bias hides in the noise of all of them. Forces of a
machine depend on its state, and so does their error: it is in the low harmonics of the motion.
`harmonic_lack_of_fit` tests only these, in all actuators together.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
import scipy
from pydantic import Field

from constraints.arrays import Array, Mask
from estimation.diagnostics.joint_system import ConditionalScores, SolvedSystem
from estimation.diagnostics.linearisation import Linearisation
from estimation.diagnostics.residual_covariance import ResidualCovariance
from estimation.diagnostics.significance import (
    HARMONIC_LACK_OF_FIT,
    LACK_OF_FIT,
    ChannelTest,
    OfEach,
    OmissibleTest,
    log_tail,
    no_numbers,
    ratio_tail,
    trace_as_f,
)
from estimation.estimators.experiment import Experiment
from estimation.processing import NoiseEstimate, PeriodSource
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.runfolder import Column, Numbers, OpenNumber, described, sized, strutwise

_MOST_BINS, _FEWEST_BINS = 60, 12
_PER_BIN = 24
_FEWEST = 4


@dataclass(frozen=True)
class ChiSquare:
    """Weighted sum of squares of one kind of channel."""

    value: Annotated[OpenNumber, described("1", "Σ counts · eᵀ Σ⁻¹ e")]
    freedom: Annotated[
        OpenNumber,
        Field(alias="degrees_of_freedom"),
        described("1", "expectation for a correct model and noise"),
    ]
    ratio: Annotated[
        OpenNumber,
        described("1", "value / freedom, with an estimated Σ corrected for its uncertainty"),
    ]
    p_value: Annotated[OpenNumber, Field(alias="p_larger"), described("1", "p of a larger value")]
    p_smaller: Annotated[
        OpenNumber,
        described("1", "p of a smaller value: noise given too large, or overfitted"),
    ]
    refused: Annotated[str, described("", "reason for missing p-values; otherwise empty")] = ""


def chi_square(residuals: Array, counts: Array, expected: ResidualCovariance) -> ChiSquare:
    """Test the size of residuals, (R, 6), that are means of `counts` samples, (R,).

    Notes
    -----
    With an estimated Σ the sum is a Lawley–Hotelling trace (`trace_as_f`).
    """
    inverse = np.asarray(np.linalg.inv(expected.noise.covariance), dtype=np.float64)
    value = float(np.einsum("r,ri,ij,rj->", counts, residuals, inverse, residuals))
    freedom = expected.expected_sum(inverse)
    ratio, upper, lower, refused = value / freedom, np.nan, np.nan, ""
    if expected.noise.includes_model_error:
        refused = "the noise was estimated from these residuals: their χ² carries no information"
    elif not np.isfinite(expected.noise.freedom):
        upper, lower = scipy.stats.chi2.sf(value, freedom), scipy.stats.chi2.cdf(value, freedom)
    else:
        nu = expected.noise.freedom
        ratio *= (nu - ACTUATORS - 1) / nu
        f, *counts_of_f = trace_as_f(value, freedom, nu)
        upper, lower = scipy.stats.f.sf(f, *counts_of_f), scipy.stats.f.cdf(f, *counts_of_f)
    return ChiSquare(value, freedom, ratio, float(upper), float(lower), refused)


@dataclass(frozen=True, eq=False, kw_only=True)
class LackOfFit(ChannelTest):
    """Test of six actuators for a bias."""

    samples: Annotated[int, described("1", "N, phases per period")] = 0
    fitted_freedom: Annotated[
        OfEach, described("1", "ν_j; zero for held-out data without tolerances")
    ] = field(default_factory=no_numbers)
    added_variance: Annotated[
        OfEach,
        described(
            "1",
            "expected variance in addition to the noise, relative to it: for held-out data of the "
            "parameters, the motion and unknown signs of friction",
        ),
    ] = field(default_factory=no_numbers)
    mean_square: Annotated[OfEach, Field(alias="ms_lof"), described("N^2", "MS_lof")] = field(
        default_factory=no_numbers
    )
    pure_error: Annotated[OfEach, Field(alias="ms_pe"), described("N^2", "MS_pe")] = field(
        default_factory=no_numbers
    )
    statistic: Annotated[
        OfEach,
        Field(alias="f"),
        described("1", "F_j = MS_lof / (MS_pe (1 + added variance))"),
    ] = field(default_factory=no_numbers)
    statistic_freedom: Annotated[
        OfEach,
        Field(alias="degrees_of_freedom"),
        described("1", "effective, of F's numerator: (tr B)² / tr B², B = Cov(e_j) / σ_j²"),
    ] = field(default_factory=no_numbers)
    pure_error_freedom: Annotated[
        float, Field(alias="pure_error_degrees_of_freedom"), described("1", "(M − 1) N")
    ] = 0.0


def lack_of_fit(
    part: Linearisation,
    expected: ResidualCovariance,
    *,
    residuals: Array | None = None,
    level: float = LACK_OF_FIT,
) -> LackOfFit:
    """Test the residuals of one experiment, (R, 6), N, by default those of the estimate."""
    if expected.noise.includes_model_error:
        return LackOfFit(
            refused="the noise of the residuals includes the error of the model: "
            "measure two or more periods, or give the noise"
        )
    scatter = part.force_scatter
    if scatter is None:
        return LackOfFit(
            refused="without a second period, noise and error of the model cannot be separated: "
            "measure two or more"
        )
    if scatter.is_singular:
        return LackOfFit(
            refused="the periods repeat without noise: nothing shows how large an error of the "
            "model is"
        )
    rest = part.forces if residuals is None else residuals
    weights = [expected.weights(j) for j in range(rest.shape[1])]
    trace = np.array([np.sum(w) for w in weights])
    square = np.array([np.sum(w**2) for w in weights])
    squares = np.sum(part.counts[:, None] * rest**2, axis=0)
    samples = len(rest)
    fitted = samples - trace if expected.fitted else np.zeros_like(trace)
    mean_square = squares / (samples - fitted)
    added = trace / (samples - fitted) - 1
    pure = np.diag(scatter.covariance).copy()
    statistic = mean_square / (pure * (1 + added))
    p_values = [
        ratio_tail(float(total / error), w, scatter.freedom)
        for total, error, w in zip(squares, pure, weights, strict=True)
    ]
    return LackOfFit(
        samples=samples,
        fitted_freedom=fitted,
        added_variance=added,
        mean_square=mean_square,
        pure_error=pure,
        pure_error_freedom=scatter.freedom,
        statistic=statistic,
        statistic_freedom=trace**2 / square,
        p_values=np.array(p_values),
        level=level,
    )


_LINES_PER_HARMONIC, _MOST_LINES = 3, 30
_KNOTS = 7
_REMAINING = 0.01
"""Smallest share of a combination of waves that must remain given the unknowns."""


@dataclass(frozen=True, eq=False, kw_only=True)
class HarmonicLackOfFit(OmissibleTest):
    """Test of all actuators together for a bias in the low harmonics of the motion."""

    level: Annotated[float, Field(alias="family_level"), described("1", "level of the test")] = (
        HARMONIC_LACK_OF_FIT
    )
    lines: Annotated[
        int, described("1", "largest tested multiple of the motion's base frequency")
    ] = 0
    statistic: Annotated[OpenNumber, described("1", "χ² of the residuals in these lines")] = np.nan
    freedom: Annotated[
        float, Field(alias="degrees_of_freedom"), described("1", "its degrees of freedom")
    ] = 0.0
    log_p: Annotated[OpenNumber, described("1", "logarithm of p")] = np.nan
    ratios: Annotated[OfEach, described("1", "χ² / degrees of freedom of each actuator alone")] = (
        field(default_factory=no_numbers)
    )
    shares: Annotated[
        dict[str, float],
        described(
            "1",
            "share of the excess that smooth functions of each strut's length, speed, "
            "acceleration or load, or of the time explain; empty unless the test fails",
        ),
    ] = field(default_factory=dict)

    @property
    def failed(self) -> bool:
        """Whether the residuals contain more than noise."""
        return bool(self.log_p < np.log(self.level))

    @property
    def excess(self) -> float:
        """χ² beyond its expectation."""
        return max(self.statistic - self.freedom, 0.0)


def harmonic_lack_of_fit(
    experiment: Experiment,
    part: Linearisation,
    solved: SolvedSystem,
    harmonics: int,
    *,
    level: float = HARMONIC_LACK_OF_FIT,
) -> HarmonicLackOfFit:
    """Test the lines up to three times the harmonics of the motion.

    The score test of sines and cosines in every actuator accounts for the unknowns of the fit, and
    for the noise's covariance and spectrum.
    """
    lines = min(_LINES_PER_HARMONIC * harmonics, _MOST_LINES, (len(part.times) - 1) // 2)
    angle = 2 * np.pi / experiment.recording.period * np.outer(part.times, np.arange(lines + 1))
    waves = np.concatenate([np.cos(angle), np.sin(angle[:, 1:])], axis=1)
    scores = _fit_each_actuator(part, solved, [waves] * ACTUATORS)
    whole = scores.fit(range(waves.shape[1] * ACTUATORS), _REMAINING)
    alone = [
        scores.fit(range(j * waves.shape[1], (j + 1) * waves.shape[1]), _REMAINING)
        for j in range(ACTUATORS)
    ]
    statistic, rank, freedom = whole.statistic, float(whole.rank), scores.freedom
    if np.isfinite(freedom) and solved.system.force_rows.filter is None:
        # One Σ̂ for all waves in six channels: F with its ν would reject too rarely.
        loss = NoiseEstimate(np.eye(ACTUATORS), freedom).weighting_loss
        f, _, freedom = trace_as_f(statistic * loss, rank, freedom)
        statistic = rank * f
    log_p = log_tail(np.array(statistic), np.array(rank), freedom)
    test = HarmonicLackOfFit(
        level=level,
        lines=lines,
        statistic=whole.statistic,
        freedom=float(whole.rank),
        log_p=float(log_p),
        ratios=np.array([fit.statistic / max(fit.rank, 1) for fit in alone]),
    )
    if not test.failed:
        return test
    shares = {}
    for name, values in _states(experiment, part).items():
        columns = [_hats(each) for each in values.T]
        fits = _fit_each_actuator(part, solved, columns)
        smooth = fits.fit(range(len(fits.score)), _REMAINING)
        # By chance, k functions explain k of the lines.
        chance = smooth.rank / whole.rank
        share = (smooth.statistic - smooth.rank) / test.excess
        shares[name] = float(np.clip((share - chance) / max(1 - chance, chance), 0.0, 1.0))
    return replace(test, shares=shares)


def _fit_each_actuator(
    part: Linearisation, solved: SolvedSystem, functions: Sequence[Array]
) -> ConditionalScores:
    """Return the scores of functions, (R, k) for each actuator, one after the other."""
    columns = np.zeros((*part.forces.shape, sum(each.shape[1] for each in functions)))
    scores, mixed, first = [], [], 0
    for j, each in enumerate(functions):
        columns[:, j, first : first + each.shape[1]] = each
        first += each.shape[1]
        scores.append(each.T @ solved.weighted_rest[:, j])
        mixed.append(each.T @ solved.explained[j])
    rows = solved.system.whiten_forces(columns)
    whole = np.einsum("nq,nq->q", rows, rows)
    rows, known = solved.system.eliminate_signs(rows), np.concatenate(mixed)
    information = rows.T @ rows - known @ known.T
    return ConditionalScores(np.concatenate(scores), information, whole, solved.system.freedom)


def _states(experiment: Experiment, part: Linearisation) -> dict[str, Array]:
    """Return the state of the struts at every row, (R, 6) each; load: the predicted force."""
    return {
        "length": part.position,
        "speed": part.speed,
        "acceleration": part.acceleration,
        "load": part.cells.mean(experiment.forces) - part.forces,
        "time": np.repeat(part.times[:, None], ACTUATORS, axis=1),
    }


def _hats(values: Array) -> Array:
    """Return piecewise linear functions of a variable, (R, k), with knots at its quantiles."""
    knots = np.unique(np.quantile(values, np.linspace(0, 1, _KNOTS)))
    return np.stack([np.interp(values, knots, unit) for unit in np.eye(len(knots))], axis=1)


@dataclass(frozen=True, eq=False)
class ForceResiduals:
    """Force residuals along the motion, measured minus predicted, in the order of time."""

    time: Annotated[Array, Column("t", "s", "time")]
    forces: Annotated[Array, strutwise("e", "N", "residual force, mean over the periods,")]
    std: Annotated[
        Array,
        strutwise("e", "N", "standard deviation due to the noise alone", suffix="_std"),
    ]


def force_residuals(experiment: Experiment, part: Linearisation) -> ForceResiduals:
    """Collect the force residuals of one linearised experiment."""
    order = np.argsort(part.times)
    order = order[_shown_rows(experiment, len(order))[order]]
    rest = part.cells.mean(part.force_rows)
    return ForceResiduals(part.times[order], rest[order], _force_std(experiment, part)[order])


def _shown_rows(experiment: Experiment, rows: int) -> Mask:
    """Return the rows that the model predicts, (R,); without a period, those of certain signs."""
    if experiment.recording.source is PeriodSource.NONE:
        return experiment.known_rows
    return np.ones(rows, dtype=bool)


def _force_std(experiment: Experiment, part: Linearisation) -> Array:
    noise = experiment.noise.forces
    std = np.sqrt(noise.variances / part.counts[:, None])
    return std if noise.filter is None or noise.filter.size is None else std * noise.filter.size


@dataclass(frozen=True, eq=False)
class VarianceComparison:
    """Comparison of variances as in the paper, over all single samples of each actuator."""

    model_error: Annotated[
        Numbers, sized(ACTUATORS), described("N^2", "mean square of measured minus predicted force")
    ]
    measurement_error: Annotated[
        Numbers, sized(ACTUATORS), described("N^2", "variance of the noise of one sample")
    ]
    note: Annotated[str, described("", "interpretation")] = (
        "information as in the paper, not a test: a residual contains the noise"
    )


def variance_comparison(experiment: Experiment, part: Linearisation) -> VarianceComparison:
    """Compare variances as in the paper; of averaged periods, over the single samples."""
    single, channels = part.force_rows, experiment.recording.forces
    noise = experiment.noise.forces.variances
    averaged = 0.0
    if channels.periods is not None:
        deviations = experiment.select_rows(np.moveaxis(channels.periods - channels.values, 0, 2))
        rest = channels.as_recorded(deviations) + single[:, :, None]
        single = np.moveaxis(rest, 2, 0).reshape(-1, single.shape[1])
    else:
        # If samples were lost, rows are means: a single sample has more noise.
        averaged = float(np.mean(1 - 1 / np.maximum(experiment.counts, 1.0)))
        if experiment.recording.source is PeriodSource.NONE:
            single = single[experiment.known_rows]
    return VarianceComparison(np.mean(single**2, axis=0) + averaged * noise, noise.copy())


@dataclass(frozen=True)
class BinRow:
    """Mean residual of one actuator in one bin of its strut's state."""

    strut: Annotated[int, described("1", "number of the strut")]
    over: Annotated[str, described("", "length, speed, acceleration or load")]
    centre: Annotated[float, described("m, m/s, m/s^2 or N", "mean in the bin")]
    mean: Annotated[float, described("N", "weighted mean residual force")]
    half_width: Annotated[float, described("N", "half width of its 95 % interval, due to noise")]


def dependence(experiment: Experiment, part: Linearisation) -> Iterator[BinRow]:
    """Yield the mean residuals in bins of every strut's length, speed, acceleration and load."""
    shown = _shown_rows(experiment, len(part.forces))
    weights, rest = 1 / _force_std(experiment, part) ** 2, part.cells.mean(part.force_rows)
    for name, values in _states(experiment, part).items():
        if name == "time":
            continue
        for j, (over, forces, weight) in enumerate(
            zip(values[shown].T, rest[shown].T, weights[shown].T, strict=True), start=1
        ):
            for row in _bin_means(over, forces, weight).tolist():
                yield BinRow(j, name, *row)


def _bin_means(over: Array, forces: Array, weights: Array) -> Array:
    """Return centres, weighted means and half widths of the bins with enough samples, (B, 3)."""
    count = int(np.clip(len(over) // _PER_BIN, _FEWEST_BINS, _MOST_BINS))
    edges = np.linspace(over.min(), over.max(), count + 1)
    bins = np.clip(np.searchsorted(edges, over, side="right") - 1, 0, count - 1)
    used = np.bincount(bins, minlength=count) >= _FEWEST
    total = np.bincount(bins, weights, count)[used]
    centres = np.bincount(bins, weights * over, count)[used] / total
    means = np.bincount(bins, weights * forces, count)[used] / total
    return np.stack([centres, means, scipy.stats.norm.ppf(0.975) / np.sqrt(total)], axis=1)
