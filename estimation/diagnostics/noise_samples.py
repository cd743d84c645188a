"""Pure noise out of repeated periods: contrasts between them, in which no model takes part.

Every period less the mean of the periods before it, scaled to the variance of one sample:
M − 1 series that are independent of each other for independent noise, unlike deviations from the
mean over all periods.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array


@dataclass(frozen=True, eq=False)
class NoiseSamples:
    """Samples of the noise of six channels.

    Attributes
    ----------
    values : (K, N, 6)
        K independent series of N samples.
    source : str
        ``"periods"``, or ``"residuals"`` of the model where periods cannot be compared.
    """

    values: Array
    source: str

    @property
    def pooled(self) -> Array:
        """(K N, 6)."""
        return self.values.reshape(-1, self.values.shape[2])


def noise_samples(periods: Array | None, residuals: Array) -> NoiseSamples:
    """Take contrasts between periods, (M, N, 6), or else the residuals, (T, 6), as they are."""
    if periods is None or len(periods) < 2:  # noqa: PLR2004 - a contrast takes two
        return NoiseSamples(residuals[None] - residuals.mean(axis=0), "residuals")
    count = len(periods)
    before = np.cumsum(periods, axis=0)[:-1] / np.arange(1, count)[:, None, None]
    number = np.arange(1, count, dtype=float)[:, None, None]
    return NoiseSamples((periods[1:] - before) * np.sqrt(number / (number + 1)), "periods")
