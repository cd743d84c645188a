"""The covariance that residuals have if the model is right, channel by channel.

With rows scaled to the noise of one sample, e = ε − U g, where g are the errors of parameters and
motion. Cov(g, ε) = X Vᵀ and Cov(g) = C give

    Cov(e_j) = σ_j² 1 − U_j X V_jᵀ − V_j Xᵀ U_jᵀ + U_j C U_jᵀ + what unknown friction signs make.

LS: V = Σ W A, X = F⁻¹ (parameters only); Gauss–Markov: V = U; maximum likelihood: V = U,
X = C = J⁻¹; held-out data: X = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array


@dataclass(frozen=True, eq=False)
class ResidualLaw:
    """First-order covariance of the residuals of all channels.

    Attributes
    ----------
    noise : (6, 6)
        Covariance of one sample.
    columns : (R, 6, u)
        U, times the roots of the counts.
    partner : (R, 6, u)
        V, times the roots of the counts.
    cross : (u, u)
        X.
    covariance : (u, u)
        C.
    extra : (R, 6)
        Further variances, times the counts.
    """

    noise: Array
    columns: Array
    partner: Array
    cross: Array
    covariance: Array
    extra: Array

    def weights(self, channel: int) -> Array:
        """Return the eigenvalues of B = Cov(e_j) / σ_j², (R,): variances of independent parts.

        Few rows have an unknown sign of friction: what it adds there counts as a part of its own.
        """
        variance = float(self.noise[channel, channel])
        factor, kernel = self._low_rank(channel)
        values = np.linalg.eigvals(kernel @ (factor.T @ factor)).real / variance
        result = 1 + self.extra[:, channel] / variance
        result = np.sort(result)[::-1]
        values = values[np.argsort(-np.abs(values))][: len(result)]
        result[len(result) - len(values) :] += values
        return np.maximum(result, 0.0)

    def lagged(self, channel: int, lag: int) -> float:
        """Return Σ_t Cov(e_t, e_{t + lag}) / σ_j² within the rows of one channel."""
        factor, kernel = self._low_rank(channel)
        variance = float(self.noise[channel, channel])
        ahead = factor[:-lag] @ kernel
        return float(np.sum(ahead * factor[lag:]) / variance)

    def _low_rank(self, channel: int) -> tuple[Array, Array]:
        """Return Y and K of Cov(e_j) = σ_j² 1 + Y K Yᵀ."""
        own = self.columns[:, channel]
        if not np.any(self.cross):
            return own, self.covariance
        if self.partner is self.columns:
            return own, self.covariance - self.cross - self.cross.T
        factor = np.concatenate([own, self.partner[:, channel]], axis=1)
        kernel = np.block(
            [[self.covariance, -self.cross], [-self.cross.T, np.zeros_like(self.cross)]]
        )
        return factor, kernel
