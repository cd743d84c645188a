"""Residual forces against position and speed of their strut: means in bins, with intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from constraints.arrays import Array
from estimation.diagnostics.residuals import Residuals

_MOST_BINS, _FEWEST_BINS = 60, 12
_PER_BIN = 24
_FEWEST = 4


@dataclass(frozen=True, eq=False)
class BinnedResiduals:
    """One strut.

    Attributes
    ----------
    centres : (B,)
        Mean position, m, or speed, m/s, of the samples in each bin.
    means : (B,)
        Weighted mean residual, N.
    half_widths : (B,)
        Of its 95 % interval, from the noise of the forces, N.
    """

    centres: Array
    means: Array
    half_widths: Array


@dataclass(frozen=True, eq=False)
class Dependence:
    """All struts.

    Attributes
    ----------
    position, speed : tuple of six BinnedResiduals
    """

    position: tuple[BinnedResiduals, ...]
    speed: tuple[BinnedResiduals, ...]


def dependence(residual: Residuals) -> Dependence:
    """Bin the residuals over position and over speed."""
    struts = range(residual.forces.shape[1])
    return Dependence(
        tuple(_binned(residual.position[:, j], residual, j) for j in struts),
        tuple(_binned(residual.speed[:, j], residual, j) for j in struts),
    )


def _binned(over: Array, residual: Residuals, strut: int) -> BinnedResiduals:
    count = int(np.clip(len(over) // _PER_BIN, _FEWEST_BINS, _MOST_BINS))
    edges = np.linspace(over.min(), over.max(), count + 1)
    bins = np.clip(np.searchsorted(edges, over, side="right") - 1, 0, count - 1)
    weights = 1 / residual.force_std[:, strut] ** 2
    total = np.bincount(bins, weights, count)
    used = np.bincount(bins, minlength=count) >= _FEWEST
    safe = np.where(used, total, 1.0)
    centres = np.bincount(bins, weights * over, count) / safe
    means = np.bincount(bins, weights * residual.forces[:, strut], count) / safe
    return BinnedResiduals(
        centres[used], means[used], (stats.norm.ppf(0.975) / np.sqrt(safe))[used]
    )
