"""Bias per actuator: are the means over the periods further off than noise allows.

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
from pydantic import Field

from constraints.arrays import Array
from estimation.diagnostics.channel_test import LACK_OF_FIT, ChannelTest, no_numbers
from estimation.diagnostics.linearisation import Linearisation
from estimation.diagnostics.residual_law import ResidualLaw
from estimation.diagnostics.tails import ratio_tail
from expdesign.runfolder import OpenNumbers, described


@dataclass(frozen=True, eq=False, kw_only=True)
class LackOfFit(ChannelTest):
    """The test of all six actuators for a bias, or why it was not done."""

    samples: Annotated[int, described("1", "N, phases per period")] = 0
    fitted_freedom: Annotated[OpenNumbers, described("1", "ν_j; zero for held-out data")] = field(
        default_factory=no_numbers
    )
    added_variance: Annotated[
        OpenNumbers,
        described(
            "1",
            "variance expected besides the noise, relative to it: of unknown friction signs, and "
            "for held-out data of the parameters and the motion",
        ),
    ] = field(default_factory=no_numbers)
    mean_square: Annotated[OpenNumbers, Field(alias="ms_lof"), described("N^2", "MS_lof")] = field(
        default_factory=no_numbers
    )
    pure_error: Annotated[OpenNumbers, Field(alias="ms_pe"), described("N^2", "MS_pe")] = field(
        default_factory=no_numbers
    )
    statistic: Annotated[
        OpenNumbers, Field(alias="f"), described("1", "F_j = MS_lof / (MS_pe (1 + added variance))")
    ] = field(default_factory=no_numbers)
    statistic_freedom: Annotated[
        OpenNumbers,
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
    includes_model_error: bool = False,
) -> LackOfFit:
    """Test the residuals of one experiment.

    Parameters
    ----------
    law : ResidualLaw
        Of the residuals; its cross part is zero for held-out data.
    residuals : (R, 6), optional
        Other residuals than those of the estimate, N.
    level : float
        Of the family.
    includes_model_error : bool
        The covariances come from the residuals of the model itself.
    """
    if includes_model_error:
        return LackOfFit(
            refused="the noise was taken from the residuals of the model, so it includes the "
            "error of the model: measure three or more periods, or give the noise"
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
    signs = np.sum(law.extra, axis=0) / np.diag(law.noise)
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
