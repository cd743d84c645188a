"""χ² of the residuals of forces and lengths, each with the full covariance of the noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field
from scipy import stats

from constraints.arrays import Array
from estimation.diagnostics.residual_law import ResidualLaw
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


def chi_square(
    residuals: Array,
    counts: Array,
    law: ResidualLaw,
    noise_freedom: float,
    *,
    includes_model_error: bool = False,
) -> ChiSquare:
    """Test the size of residuals.

    Parameters
    ----------
    residuals : (R, 6)
    counts : (R,)
    noise_freedom : float
        Behind the law's covariance; inf when it was given.

    Notes
    -----
    With an estimated Σ the sum is a Lawley–Hotelling trace; its F approximation is McKeon's
    (Biometrika 61, 1974).
    """
    channels = residuals.shape[1]
    inverse = np.asarray(np.linalg.inv(law.noise), dtype=np.float64)
    value = float(np.einsum("r,ri,ij,rj->", counts, residuals, inverse, residuals))
    freedom = _expectation(law, inverse)
    if includes_model_error:
        return ChiSquare(
            value,
            freedom,
            value / freedom,
            np.nan,
            np.nan,
            "the noise comes from these residuals: their χ² says nothing",
        )
    if not np.isfinite(noise_freedom):
        upper, lower = stats.chi2.sf(value, freedom), stats.chi2.cdf(value, freedom)
        return ChiSquare(value, freedom, value / freedom, float(upper), float(lower))
    p, h, nu = channels, freedom / channels, noise_freedom
    big = (nu + h - p - 1) * (nu - 1) / ((nu - p - 3) * (nu - p))
    a = p * h
    b = 4 + (a + 2) / (big - 1)
    c = a * (b - 2) / (b * (nu - p - 1))
    f = value / nu / c
    expected = nu * p * h / (nu - p - 1)
    return ChiSquare(
        value,
        freedom,
        value / expected,
        float(stats.f.sf(f, a, b)),
        float(stats.f.cdf(f, a, b)),
    )


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
