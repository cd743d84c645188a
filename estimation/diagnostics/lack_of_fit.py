"""Bias per actuator: are the means over the periods further off than noise allows.

    MS_lof = M Σ(period-mean residual)² / (N − ν_j),   MS_pe = scatter between the M periods,
    F_j = MS_lof / MS_pe.

ν_j is the share of the degrees of freedom that the parameters (and the motion) take: N less the
trace of Cov(e_j) in units of the noise, so that E[MS_lof] = σ_j² if the model is right. For
held-out data ν_j = 0 and A Cov(p̂) Aᵀ adds to the expected variance instead. The p-value is that of
the sum of squares with all eigenvalues of Cov(e_j), which is F's where Cov(e_j) is a projection.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.diagnostics.levels import LACK_OF_FIT
from estimation.diagnostics.linearisation import Linearisation
from estimation.diagnostics.quadratic_tail import ratio_tail
from estimation.diagnostics.residual_law import ResidualLaw


@dataclass(frozen=True, eq=False)
class LackOfFit:
    """The test of all six actuators, or why it was not done.

    Attributes
    ----------
    refused : str
        Why there is no test; empty when there is one, and then everything below is set.
    samples : int
        N, phases per period.
    fitted_freedom : (6,)
        ν_j; zero for held-out data.
    added_variance : (6,)
        Expected variance besides the noise, relative to it: of unknown friction signs, and for
        held-out data of the parameters and the motion.
    mean_square : (6,)
        MS_lof, N².
    pure_error : (6,)
        MS_pe, N².
    pure_error_freedom : float
        (M − 1) N.
    statistic : (6,)
        F_j = MS_lof / (MS_pe (1 + added variance)).
    statistic_freedom : (6,)
        Of its numerator, effective: (tr B)² / tr B², B = Cov(e_j) / σ_j².
    p_values : (6,)
    level : float
        Of the family of six.
    """

    refused: str
    samples: int
    fitted_freedom: Array
    added_variance: Array
    mean_square: Array
    pure_error: Array
    pure_error_freedom: float
    statistic: Array
    statistic_freedom: Array
    p_values: Array
    level: float = LACK_OF_FIT

    @property
    def failed(self) -> NDArray[np.bool_]:
        """(6,) actuators with a bias."""
        return self.p_values < self.level / len(self.p_values)

    @classmethod
    def not_done(cls, reason: str) -> LackOfFit:
        """Return a refusal."""
        nothing = np.full(6, np.nan)
        return cls(
            refused=reason,
            samples=0,
            fitted_freedom=nothing,
            added_variance=nothing,
            mean_square=nothing,
            pure_error=nothing,
            pure_error_freedom=0.0,
            statistic=nothing,
            statistic_freedom=nothing,
            p_values=nothing,
        )


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
    part : Linearisation
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
        return LackOfFit.not_done(
            "the noise was taken from the residuals of the model, so it includes the error of the "
            "model: measure three or more periods, or give the noise"
        )
    scatter = part.force_scatter
    if scatter is None:
        return LackOfFit.not_done(
            "without a second period nothing tells the noise from the error of the model: measure "
            "two or more"
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
        refused="",
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
