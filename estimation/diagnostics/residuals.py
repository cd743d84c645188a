"""Residuals of an estimate, as they are shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy import stats

from constraints.arrays import Array
from estimation.diagnostics.linearisation import Linearisation
from estimation.estimators.experiment import Experiment
from estimation.processing import NoiseModel
from expdesign.runfolder import Numbers, described

_MOST_BINS, _FEWEST_BINS = 60, 12
_PER_BIN = 24
_FEWEST = 4


@dataclass(frozen=True, eq=False)
class Residuals:
    """Measured minus predicted along the estimated motion.

    Attributes
    ----------
    times : (R,)
        Of the force residuals, s.
    forces : (R, 6)
        Means over the periods, N.
    force_std : (R, 6)
        What the noise of the forces alone makes of each, N.
    force_periods : (M, N, 6) or None
        Of every period, N; None when periods were not averaged.
    length_times : (R',)
        s.
    lengths : (R', 6) or None
        Means over the periods, m; None after pointwise kinematics.
    length_std : (R', 6)
        m.
    position, speed : (R, 6)
        Of the struts along the motion, m and m/s.
    """

    times: Array
    forces: Array
    force_std: Array
    force_periods: Array | None
    length_times: Array
    lengths: Array | None
    length_std: Array
    position: Array
    speed: Array


def residuals(experiment: Experiment, part: Linearisation) -> Residuals:
    """Collect the residuals of one linearised experiment."""
    record, noise = experiment.record, experiment.noise
    periods = record.force_periods
    if periods is not None and experiment.pointwise is not None:
        periods = periods[:, experiment.pointwise.rows]
    if periods is not None:
        measured = record.forces
        if experiment.pointwise is not None:
            measured = measured[experiment.pointwise.rows]
        periods = periods - (measured - part.force_rows)
    return Residuals(
        times=part.times,
        forces=part.forces,
        force_std=_std(noise.force_covariance, part.counts),
        force_periods=periods,
        length_times=part.length_times,
        lengths=part.lengths,
        length_std=_std(noise.length_covariance, part.length_counts),
        position=part.position,
        speed=part.speed,
    )


def _std(covariance: Array, counts: Array) -> Array:
    return np.sqrt(np.diag(covariance) / counts[:, None])


@dataclass(frozen=True, eq=False)
class VarianceComparison:
    """The paper's comparison, over all single samples of each actuator."""

    model_error: Annotated[
        Numbers, described("N^2", "mean square of measured minus predicted force")
    ]
    measurement_error: Annotated[Numbers, described("N^2", "variance of the noise of one sample")]
    note: Annotated[str, described("", "how it is to be read")] = (
        "information as in the paper, not a test: a residual contains the noise"
    )


def variance_comparison(residual: Residuals, rows: Array, noise: NoiseModel) -> VarianceComparison:
    """Compare as the paper does; `rows` (T, 6) are the residuals where periods are not known."""
    single = rows if residual.force_periods is None else residual.force_periods.reshape(-1, 6)
    return VarianceComparison(np.mean(single**2, axis=0), np.diag(noise.force_covariance).copy())


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
