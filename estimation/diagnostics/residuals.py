"""Residuals of an estimate: χ², lack of fit, drift of the gains, and their display.

`chi_square` uses the full covariance of the noise. `lack_of_fit` tests every actuator for a bias,
comparing the means over the periods with the scatter between them:

    MS_lof = M Σ(period-mean residual)² / (N − ν_j),   MS_pe = scatter between the M periods,
    F_j = MS_lof / MS_pe.

ν_j is the number of degrees of freedom that the parameters (and the motion) take: N minus the trace
of Cov(e_j) in units of the noise, so that E[MS_lof] = σ_j² for a correct model. For held-out data
ν_j = 0, and A Cov(p̂) Aᵀ adds to the expected variance. The p-value belongs to the sum of squares
with all eigenvalues of Cov(e_j); it is that of F if Cov(e_j) is a projection.

`gain_drift` tests for a drift of the force gains, such as a motor constant that falls as the motor
warms up. Differences between periods show it independently of errors of the model, which are the
same in every period. In each period the residuals of all actuators are regressed on the predicted
force and on a constant of each actuator, weighted with Σ⁻¹; the twelve coefficients are regressed
on the number of the period. Their scatter about these lines, over all actuators together, scales
the variance according to Σ, so that coloured noise, or a given Σ that is too small, does not appear
as a drift.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import numpy as np
import scipy
from pydantic import Field, model_serializer

from constraints.arrays import Array
from estimation.diagnostics.joint_system import ConditionalScores
from estimation.diagnostics.linearisation import Linearisation
from estimation.diagnostics.noise_tests import why_not_compared
from estimation.diagnostics.residual_covariance import ResidualCovariance
from estimation.diagnostics.significance import (
    GAIN_DRIFT,
    LACK_OF_FIT,
    ChannelTest,
    OfEach,
    Strut,
    log_two_sided,
    no_numbers,
    ratio_tail,
)
from estimation.estimators.experiment import Experiment
from estimation.measurement_model.motion import whiten_rows
from expdesign.information.fisher import whitening
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
    With an estimated Σ the sum is a Lawley–Hotelling trace; its F approximation is McKeon's
    (Biometrika 61, 1974).
    """
    channels = residuals.shape[1]
    inverse = np.asarray(np.linalg.inv(expected.noise.covariance), dtype=np.float64)
    value = float(np.einsum("r,ri,ij,rj->", counts, residuals, inverse, residuals))
    freedom = _expectation(expected, inverse)
    ratio, upper, lower, refused = value / freedom, np.nan, np.nan, ""
    if expected.noise.includes_model_error:
        refused = "the noise was estimated from these residuals: their χ² carries no information"
    elif not np.isfinite(expected.noise.freedom):
        upper, lower = scipy.stats.chi2.sf(value, freedom), scipy.stats.chi2.cdf(value, freedom)
    else:
        p, h, nu = channels, freedom / channels, expected.noise.freedom
        big = (nu + h - p - 1) * (nu - 1) / ((nu - p - 3) * (nu - p))
        a = p * h
        b = 4 + (a + 2) / (big - 1)
        c = a * (b - 2) / (b * (nu - p - 1))
        f = value / nu / c
        ratio = value / (nu * p * h / (nu - p - 1))
        upper, lower = scipy.stats.f.sf(f, a, b), scipy.stats.f.cdf(f, a, b)
    return ChiSquare(value, freedom, ratio, float(upper), float(lower), refused)


def _expectation(expected: ResidualCovariance, inverse: Array) -> float:
    """Return E Σ eᵀ Σ⁻¹ e: 6 R minus the fitted degrees of freedom."""
    rows = expected.columns.shape[0] * expected.columns.shape[1]
    own = expected.columns.reshape(rows, -1)
    weighted = np.matmul(inverse, expected.columns).reshape(rows, -1)
    return float(rows + np.sum((own.T @ weighted) * expected.kernel))


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
    """Test the residuals of one experiment.

    Parameters
    ----------
    expected : ResidualCovariance
        Covariance of the residuals.
    residuals : (R, 6), optional
        Residuals, N; by default those of the estimate.
    """
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
    return ForceResiduals(
        part.times[order], part.forces[order], _force_std(experiment, part)[order]
    )


def _force_std(experiment: Experiment, part: Linearisation) -> Array:
    return np.sqrt(np.diag(experiment.noise.forces.covariance) / part.counts[:, None])


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
    single, periods = part.force_rows, experiment.recording.forces.periods
    noise = np.diag(experiment.noise.forces.covariance)
    averaged = 0.0
    if periods is not None:
        if experiment.pointwise is not None:
            periods = periods[:, experiment.pointwise.rows]
        single = (periods - (experiment.forces - part.force_rows)).reshape(-1, single.shape[1])
    else:
        # If samples were lost, rows are means: a single sample has more noise.
        averaged = float(np.mean(1 - 1 / np.maximum(experiment.counts, 1.0)))
    return VarianceComparison(np.mean(single**2, axis=0) + averaged * noise, noise.copy())


@dataclass(frozen=True)
class BinRow:
    """Mean residual of one actuator in one bin of its strut's length or speed."""

    strut: Annotated[int, described("1", "number of the strut")]
    over: Annotated[str, described("", "length or speed")]
    centre: Annotated[float, described("m or m/s", "mean length or speed in the bin")]
    mean: Annotated[float, described("N", "weighted mean residual force")]
    half_width: Annotated[float, described("N", "half width of its 95 % interval, due to noise")]


def dependence(experiment: Experiment, part: Linearisation) -> Iterator[BinRow]:
    """Yield the mean residuals in bins of every strut's length and speed."""
    weights = 1 / _force_std(experiment, part) ** 2
    for name, values in (("length", part.position), ("speed", part.speed)):
        for j, (over, forces, weight) in enumerate(
            zip(values.T, part.forces.T, weights.T, strict=True), start=1
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


_FEWEST_PERIODS = 4
"""Smallest number of periods that leaves a scatter about lines."""
_EXACT = 1e-9
"""Share of an information that counts as rounding."""


@dataclass(frozen=True)
class GainDrift:
    """Drift of one force's gain, or of all gains alike."""

    actuator: Annotated[Strut, described("1", "number of the actuator; null: all alike")]
    change: Annotated[OpenNumber, described("1", "change from the first period to the last")]
    std: Annotated[OpenNumber, described("1", "standard deviation of the change")]
    log_p: Annotated[OpenNumber, described("1", "logarithm of p, corrected for their number")]


@dataclass(frozen=True)
class GainDriftTest:
    """Test of all gains for a drift."""

    refused: Annotated[str, described("", "reason for an omitted test; otherwise empty")]
    level: Annotated[
        float, Field(alias="family_level"), described("1", "level of all candidates together")
    ] = GAIN_DRIFT
    scale: Annotated[
        OpenNumber,
        described("1", "variance of the coefficients between periods, relative to Σ"),
    ] = np.nan
    log_p: Annotated[
        OpenNumber, described("1", "logarithm of p of the most significant, corrected")
    ] = np.nan
    found: Annotated[
        tuple[GainDrift, ...], described("", "drifting gains, most significant first")
    ] = ()

    @model_serializer(mode="wrap")
    def _in_a_file(self, fields: Any) -> dict[str, Any]:
        return {"refused": self.refused} if self.refused else fields(self)


def gain_drift(experiment: Experiment, part: Linearisation, level: float) -> GainDriftTest:
    """Test the recording of one experiment, linearised at its estimate, for drifting gains."""
    if experiment.recording.averaged and experiment.recording.forces.periods is None:
        return GainDriftTest(why_not_compared(experiment.recording), level)
    blocks, predicted = _split_periods(experiment, part)
    periods = len(blocks)
    if periods < _FEWEST_PERIODS:
        return GainDriftTest(
            f"fewer than {_FEWEST_PERIODS} periods leave no scatter about lines", level
        )
    white = whitening(experiment.noise.forces.covariance)
    coefficients, inverses = zip(
        *(_fit_period(rest, force, white) for rest, force in zip(blocks, predicted, strict=True)),
        strict=True,
    )
    values, covariance = np.array(coefficients), np.array(inverses)
    time = np.arange(periods) - (periods - 1) / 2
    slope = time @ values / (time @ time)
    of_slope = np.einsum("m,mij->ij", time**2, covariance) / (time @ time) ** 2
    rest = values - np.mean(values, axis=0) - np.multiply.outer(time, slope)
    freedom = float(rest.shape[1] * (periods - 2))
    scale = float(np.einsum("mi,mij,mj->", rest, np.linalg.inv(covariance), rest)) / freedom
    # Gains, with drifting constants fitted as well.
    own = of_slope[:ACTUATORS, :ACTUATORS] * scale
    return _select_drifts(slope[:ACTUATORS], own, freedom, periods, GainDriftTest("", level, scale))


def _select_drifts(
    slope: Array, covariance: Array, freedom: float, periods: int, test: GainDriftTest
) -> GainDriftTest:
    """Select drifts one by one, of all gains alike or of single ones."""
    design = np.concatenate([np.ones((ACTUATORS, 1)), np.eye(ACTUATORS)], axis=1)
    inverse = np.linalg.inv(covariance)
    information, score = design.T @ inverse @ design, design.T @ inverse @ slope
    level = np.log(test.level / len(score))
    chosen: list[int] = []
    log_ps: list[float] = []
    strongest = np.nan
    while len(chosen) < ACTUATORS:
        conditional = _conditional_scores(information, score, chosen, freedom)
        diagonal = np.diag(conditional.information)
        seen = diagonal > _EXACT * conditional.whole
        statistic = np.where(seen, conditional.score / np.sqrt(np.where(seen, diagonal, 1.0)), 0.0)
        log_p = log_two_sided(statistic, freedom)
        best = int(np.argmin(log_p))
        corrected = min(0.0, float(log_p[best] + np.log(len(score))))
        strongest = corrected if np.isnan(strongest) else strongest
        if log_p[best] >= level:
            break
        chosen.append(best)
        log_ps.append(corrected)
    found = []
    if chosen:
        fit = ConditionalScores(score, information, np.diag(information), freedom).fit(chosen)
        length = periods - 1
        for k, (place, tail) in enumerate(zip(chosen, log_ps, strict=True)):
            found.append(
                GainDrift(
                    actuator=place - 1 if place else None,
                    change=float(fit.values[k]) * length,
                    std=float(np.sqrt(fit.covariance[k, k])) * length,
                    log_p=tail,
                )
            )
    return replace(test, log_p=strongest, found=tuple(found))


def _conditional_scores(
    information: Array, score: Array, chosen: Sequence[int], freedom: float
) -> ConditionalScores:
    whole = np.diag(information)
    if not chosen:
        return ConditionalScores(score, information, whole, freedom)
    cross = information[:, chosen] @ np.linalg.inv(information[np.ix_(chosen, chosen)])
    return ConditionalScores(
        score - cross @ score[chosen], information - cross @ information[chosen], whole, freedom
    )


def _split_periods(experiment: Experiment, part: Linearisation) -> tuple[list[Array], list[Array]]:
    """Return residuals and predicted forces, (n, 6) each, of every whole period."""
    predicted = experiment.forces - part.force_rows
    whitening_filter = experiment.noise.forces.filter
    periods = experiment.recording.forces.periods
    if periods is not None:
        if experiment.pointwise is not None:
            periods = periods[:, experiment.pointwise.rows]
        elif whitening_filter is not None:
            predicted = whitening_filter(predicted)
            periods = np.stack([whitening_filter(period) for period in periods])
        return [period - predicted for period in periods], [predicted] * len(periods)
    recording = experiment.recording
    times = experiment.times - experiment.times[0]
    number = np.floor(times / recording.period * (1 + 1e-12)).astype(int)
    rows = [np.flatnonzero(number == k) for k in range(int(recording.periods))]
    return [part.force_rows[each] for each in rows], [predicted[each] for each in rows]


def _fit_period(rest: Array, predicted: Array, white: Array) -> tuple[Array, Array]:
    """Fit gains and constants in one period: coefficients, (12,), and their covariance."""
    unit = np.broadcast_to(np.eye(ACTUATORS), (len(rest), ACTUATORS, ACTUATORS))
    columns = np.concatenate([predicted[:, :, None] * unit, unit], axis=2)
    ones = np.ones(len(rest))
    rows = whiten_rows(columns, white, ones).reshape(rest.size, -1)
    inverse: Array = np.asarray(np.linalg.inv(rows.T @ rows), dtype=np.float64)
    return inverse @ (rows.T @ whiten_rows(rest, white, ones).ravel()), inverse
