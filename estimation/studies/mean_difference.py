"""Whether two designs lead to the same mean estimate: Welch's test, and its form for vectors."""

from __future__ import annotations

import numpy as np
from scipy import stats

from constraints.arrays import Array
from estimation.uncertainty.differences import Differences, holm


def mean_difference(first: Array, second: Array) -> Differences:
    """Test the difference of two means, parameter by parameter and jointly.

    Parameters
    ----------
    first, second : (K, m)
        Independent estimates; each K > m.

    Notes
    -----
    Every parameter by Welch's t (1947), jointly by Hotelling's T² with the degrees of freedom of
    Nel and Van der Merwe (1986): the covariances differ and are themselves estimated.
    """
    parts = [np.cov(one, rowvar=False) / len(one) for one in (first, second)]
    freedoms = [len(one) - 1 for one in (first, second)]
    total = parts[0] + parts[1]
    difference = second.mean(axis=0) - first.mean(axis=0)
    variances = [np.diag(part) for part in parts]
    std = np.sqrt(variances[0] + variances[1])
    z = difference / std
    welch = std**4 / sum(v**2 / nu for v, nu in zip(variances, freedoms, strict=True))
    p_values = holm(2 * stats.t.sf(np.abs(z), welch))
    root = np.linalg.inv(np.linalg.cholesky(total))
    size = len(difference)
    scaled = [root @ part @ root.T for part in parts]
    joint = (size + size**2) / sum(
        (float(np.sum(part**2)) + float(np.trace(part)) ** 2) / nu
        for part, nu in zip(scaled, freedoms, strict=True)
    )
    statistic = float(np.sum((root @ difference) ** 2))
    rest = joint - size + 1
    p_joint = float(stats.f.sf(statistic * rest / (joint * size), size, rest))
    return Differences(difference, std, z, p_values, statistic, size, p_joint)
