"""Whether two estimates differ by more than chance, parameter by parameter and jointly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from constraints.arrays import Array

FAMILY_LEVEL = 0.01
"""Probability that any parameter is called different when none is (Holm's correction)."""

_RANK = 1e-10
"""Eigenvalues of the difference's correlation below this share of the largest do not count."""

_TOLD_APART = 3e-2
"""Variance, relative to that of the estimates, which a difference of estimates from the same data
is allowed at the least. Products of the noises of forces and lengths, which no linear law holds,
make up to half a hundredth at 3 mm of length noise on `palida`; and what moves an estimate by less
than a sixth of its standard deviation takes next to nothing from its intervals."""


@dataclass(frozen=True, eq=False)
class Differences:
    """The test of a difference against its covariance."""

    difference: Array
    std: Array
    z: Array
    """(m,), second estimate minus first, its standard deviation, and their ratio; NaN where
    there is none."""
    p_values: Array
    """(m,), two-sided, each corrected for the family (Holm); NaN where not judged."""
    statistic: float
    freedom: float
    p_joint: float
    """Wald statistic of all parameters together, its degrees of freedom and p-value; 0, 0 and
    NaN where nothing can be judged."""

    @property
    def differs(self) -> NDArray[np.bool_]:
        """Parameters whose difference is significant at the family level, (m,)."""
        return np.nan_to_num(self.p_values, nan=1.0) < FAMILY_LEVEL

    @property
    def differ_jointly(self) -> bool:
        """True when the parameters as a whole differ at the family level."""
        return bool(self.p_joint < FAMILY_LEVEL)

    @property
    def differ(self) -> bool:
        """True when they differ jointly, or any parameter does."""
        return self.differ_jointly or bool(np.any(self.differs))


def difference_test(
    first: Array, second: Array, covariance: Array, own: Array | None = None
) -> Differences:
    """Test whether two estimates are of the same parameters.

    Parameters
    ----------
    first, second : (m,)
    covariance : (m, m)
        Of second − first when both estimate the same: the sum of their covariances for estimates
        from independent data. Rows of zeros belong to fixed parameters, which are not judged.
    own : (m, m), optional
        For estimates from the same data: the covariance of one of them. Every combination of
        parameters may then differ by a sixth of its standard deviation; those whose difference is
        no larger by chance do not count as freedom, and without any freedom a small difference
        says nothing.

    Notes
    -----
    Gauss–Markov against maximum likelihood is the test of Hausman (1978) of whether errors of the
    motion disturb the information matrix: both are of the same data, and the covariance of their
    difference comes from how these move either of them (`estimation.estimators.influence`); for
    white noise it is Cov GM − Cov ML.
    """
    difference = np.asarray(second, dtype=np.float64) - np.asarray(first, dtype=np.float64)
    variance = np.diag(covariance)
    judged = np.isfinite(variance) & (variance > 0)
    if own is not None:
        judged &= np.diag(own) > 0
        variance = np.maximum(variance, _TOLD_APART * np.diag(own))
    std = np.sqrt(np.where(judged, variance, np.nan))
    z = difference / std
    p_values = np.full(difference.size, np.nan)
    p_values[judged] = holm(2 * scipy.stats.norm.sf(np.abs(z[judged])))
    statistic, freedom, p_joint = 0.0, 0.0, float("nan")
    if np.any(judged):
        unit = std[judged] if own is None else np.sqrt(np.diag(own)[judged])
        block = covariance[np.ix_(judged, judged)] / np.multiply.outer(unit, unit)
        values, vectors = np.linalg.eigh((block + block.T) / 2)
        along = vectors.T @ (difference[judged] / unit)
        least = _RANK * values[-1] if own is None else _TOLD_APART
        told = values > least
        if own is None:
            values, along = values[told], along[told]
        # Shares of a χ²₁ each: all of it where chance makes the difference, next to nothing else.
        shares = np.clip(values / least, 0.0, 1.0)
        size, square = float(np.sum(shares)), float(np.sum(shares**2))
        if square > 0:
            statistic = float(np.sum(along**2 / np.maximum(values, least))) * size / square
            p_joint = float(scipy.stats.chi2.sf(statistic, size**2 / square))
            freedom = size**2 / square if np.any(told) else 0.0
    return Differences(difference, std, z, p_values, statistic, freedom, p_joint)


def holm(p_values: Array) -> Array:
    """Return p-values corrected for their number after Holm (1979)."""
    count = p_values.size
    order = np.argsort(p_values)
    raised = np.maximum.accumulate(p_values[order] * np.arange(count, 0, -1))
    corrected = np.empty(count)
    corrected[order] = np.minimum(raised, 1.0)
    return corrected
