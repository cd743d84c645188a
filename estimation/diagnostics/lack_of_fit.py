"""Sizes of the residuals: their χ² with the full covariance of the noise, and bias per actuator.

Bias per actuator: are the means over the periods further off than noise allows.

    MS_lof = M Σ(period-mean residual)² / (N − ν_j),   MS_pe = scatter between the M periods,
    F_j = MS_lof / MS_pe.

ν_j is the share of the degrees of freedom that the parameters (and the motion) take: N less the
trace of Cov(e_j) in units of the noise, so that E[MS_lof] = σ_j² if the model is right. For
held-out data ν_j = 0 and A Cov(p̂) Aᵀ adds to the expected variance instead. The p-value is that of
the sum of squares with all eigenvalues of Cov(e_j), which is F's where Cov(e_j) is a projection.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
import scipy
from pydantic import Field

from constraints.arrays import Array
from estimation.diagnostics.channel_test import LACK_OF_FIT, ChannelTest, OfEach, no_numbers
from estimation.diagnostics.linearisation import Linearisation
from estimation.diagnostics.residual_law import ResidualLaw
from estimation.diagnostics.tails import ratio_tail
from expdesign.runfolder import OpenNumber, described


@dataclass(frozen=True)
class ChiSquare:
    """Weighted sum of squares of one kind of channel."""

    value: Annotated[OpenNumber, described("1", "Σ counts · eᵀ Σ⁻¹ e")]
    freedom: Annotated[
        OpenNumber,
        Field(alias="degrees_of_freedom"),
        described("1", "its expectation when the model and the noise are right"),
    ]
    ratio: Annotated[
        OpenNumber,
        described("1", "value / freedom, with an estimated Σ corrected for its uncertainty"),
    ]
    p_value: Annotated[OpenNumber, Field(alias="p_larger"), described("1", "of a larger value")]
    p_smaller: Annotated[
        OpenNumber,
        described("1", "of a smaller value: the noise was given too large, or the model fits it"),
    ]
    refused: Annotated[str, described("", "why there are no p-values; empty when there are")] = ""


def chi_square(residuals: Array, counts: Array, law: ResidualLaw) -> ChiSquare:
    """Test the size of residuals, (R, 6), each the mean of as many samples as `counts` says, (R,).

    Notes
    -----
    With an estimated Σ the sum is a Lawley–Hotelling trace; its F approximation is McKeon's
    (Biometrika 61, 1974).
    """
    channels = residuals.shape[1]
    inverse = np.asarray(np.linalg.inv(law.noise.covariance), dtype=np.float64)
    value = float(np.einsum("r,ri,ij,rj->", counts, residuals, inverse, residuals))
    freedom = _expectation(law, inverse)
    ratio, upper, lower, refused = value / freedom, np.nan, np.nan, ""
    if law.noise.includes_model_error:
        refused = "the noise comes from these residuals: their χ² says nothing"
    elif not np.isfinite(law.noise.freedom):
        upper, lower = scipy.stats.chi2.sf(value, freedom), scipy.stats.chi2.cdf(value, freedom)
    else:
        p, h, nu = channels, freedom / channels, law.noise.freedom
        big = (nu + h - p - 1) * (nu - 1) / ((nu - p - 3) * (nu - p))
        a = p * h
        b = 4 + (a + 2) / (big - 1)
        c = a * (b - 2) / (b * (nu - p - 1))
        f = value / nu / c
        ratio = value / (nu * p * h / (nu - p - 1))
        upper, lower = scipy.stats.f.sf(f, a, b), scipy.stats.f.cdf(f, a, b)
    return ChiSquare(value, freedom, ratio, float(upper), float(lower), refused)


def _expectation(law: ResidualLaw, inverse: Array) -> float:
    """Return E Σ eᵀ Σ⁻¹ e: 6 R less what was fitted."""
    rows = law.columns.shape[0] * law.columns.shape[1]
    weighted = np.matmul(inverse, law.columns).reshape(rows, -1)
    own = law.columns.reshape(rows, -1)
    partner = law.partner.reshape(rows, -1)
    fitted = 2 * np.sum((partner.T @ weighted) * law.cross.T)
    spread = np.sum((own.T @ weighted) * law.covariance)
    extra = np.sum(law.extra @ np.diag(inverse))
    return float(rows - fitted + spread + extra)


@dataclass(frozen=True, eq=False, kw_only=True)
class LackOfFit(ChannelTest):
    """The test of all six actuators for a bias, or why it was not done."""

    samples: Annotated[int, described("1", "N, phases per period")] = 0
    fitted_freedom: Annotated[
        OfEach, described("1", "ν_j; zero for held-out data without tolerances")
    ] = field(default_factory=no_numbers)
    added_variance: Annotated[
        OfEach,
        described(
            "1",
            "variance expected besides the noise, relative to it: of unknown friction signs, and "
            "for held-out data of the parameters and the motion",
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
        described("1", "of F's numerator, effective: (tr B)² / tr B², B = Cov(e_j) / σ_j²"),
    ] = field(default_factory=no_numbers)
    pure_error_freedom: Annotated[
        float, Field(alias="pure_error_degrees_of_freedom"), described("1", "(M − 1) N")
    ] = 0.0


def lack_of_fit(
    part: Linearisation,
    law: ResidualLaw,
    *,
    residuals: Array | None = None,
    level: float = LACK_OF_FIT,
) -> LackOfFit:
    """Test the residuals of one experiment.

    Parameters
    ----------
    law : ResidualLaw
        Of the residuals; its cross part is zero for held-out data.
    residuals : (R, 6), optional
        Other residuals than those of the estimate, N.
    """
    if law.noise.includes_model_error:
        return LackOfFit(
            refused="the noise was taken from the residuals of the model, so it includes the "
            "error of the model: measure two or more periods, or give the noise"
        )
    scatter = part.force_scatter
    if scatter is None:
        return LackOfFit(
            refused="without a second period nothing tells the noise from the error of the "
            "model: measure two or more"
        )
    rest = part.forces if residuals is None else residuals
    weights = [law.weights(j) for j in range(rest.shape[1])]
    trace = np.array([np.sum(w) for w in weights])
    square = np.array([np.sum(w**2) for w in weights])
    squares = np.sum(part.counts[:, None] * rest**2, axis=0)
    samples = len(rest)
    signs = np.sum(law.extra, axis=0) / np.diag(law.noise.covariance)
    fitted = samples - trace + signs if np.any(law.cross) else np.zeros_like(trace)
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
