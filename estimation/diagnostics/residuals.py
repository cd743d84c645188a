"""Residuals of an estimate, as they are shown."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import scipy

from constraints.arrays import Array
from estimation.diagnostics.linearisation import Linearisation
from estimation.estimators.experiment import Experiment
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.runfolder import Column, Numbers, described, sized, strutwise

_MOST_BINS, _FEWEST_BINS = 60, 12
_PER_BIN = 24
_FEWEST = 4


@dataclass(frozen=True, eq=False)
class ForceResiduals:
    """Measured minus predicted forces along a motion, in the order of time."""

    time: Annotated[Array, Column("t", "s", "time")]
    forces: Annotated[Array, strutwise("e", "N", "residual force, mean over the periods,")]
    std: Annotated[
        Array,
        strutwise("e", "N", "what the noise alone makes of the residual force", suffix="_std"),
    ]


def force_residuals(experiment: Experiment, part: Linearisation) -> ForceResiduals:
    """Collect the force residuals of one linearised experiment."""
    order = np.argsort(part.times)
    return ForceResiduals(
        part.times[order], part.forces[order], _force_std(experiment, part)[order]
    )


def _force_std(experiment: Experiment, part: Linearisation) -> Array:
    return np.sqrt(np.diag(experiment.noise.forces.covariance) / part.counts[:, None])


@dataclass(frozen=True, eq=False)
class VarianceComparison:
    """The paper's comparison, over all single samples of each actuator."""

    model_error: Annotated[
        Numbers, sized(ACTUATORS), described("N^2", "mean square of measured minus predicted force")
    ]
    measurement_error: Annotated[
        Numbers, sized(ACTUATORS), described("N^2", "variance of the noise of one sample")
    ]
    note: Annotated[str, described("", "how it is to be read")] = (
        "information as in the paper, not a test: a residual contains the noise"
    )


def variance_comparison(experiment: Experiment, part: Linearisation) -> VarianceComparison:
    """Compare as the paper does, over the single samples where periods were averaged."""
    single, periods = part.force_rows, experiment.record.forces.periods
    noise = np.diag(experiment.noise.forces.covariance)
    averaged = 0.0
    if periods is not None:
        if experiment.pointwise is not None:
            periods = periods[:, experiment.pointwise.rows]
        single = (periods - (experiment.forces - part.force_rows)).reshape(-1, single.shape[1])
    else:
        # Means, where samples were lost: a single one has more noise.
        averaged = float(np.mean(1 - 1 / np.maximum(experiment.counts, 1.0)))
    return VarianceComparison(np.mean(single**2, axis=0) + averaged * noise, noise.copy())


@dataclass(frozen=True)
class BinRow:
    """Mean residual of one actuator in one bin of its strut's length or speed."""

    strut: Annotated[int, described("1", "number of the strut")]
    over: Annotated[str, described("", "length or speed")]
    centre: Annotated[float, described("m or m/s", "mean length or speed in the bin")]
    mean: Annotated[float, described("N", "weighted mean residual force")]
    half_width: Annotated[float, described("N", "of its 95 % interval, from the forces' noise")]


def dependence(experiment: Experiment, part: Linearisation) -> Iterator[BinRow]:
    """Yield the residuals in bins of every strut's length, and of its speed."""
    weights = 1 / _force_std(experiment, part) ** 2
    for name, values in (("length", part.position), ("speed", part.speed)):
        for j, (over, forces, weight) in enumerate(
            zip(values.T, part.forces.T, weights.T, strict=True), start=1
        ):
            for row in _binned(over, forces, weight).tolist():
                yield BinRow(j, name, *row)


def _binned(over: Array, forces: Array, weights: Array) -> Array:
    """Return centres, weighted means and half widths of the bins with enough samples, (B, 3)."""
    count = int(np.clip(len(over) // _PER_BIN, _FEWEST_BINS, _MOST_BINS))
    edges = np.linspace(over.min(), over.max(), count + 1)
    bins = np.clip(np.searchsorted(edges, over, side="right") - 1, 0, count - 1)
    used = np.bincount(bins, minlength=count) >= _FEWEST
    total = np.bincount(bins, weights, count)[used]
    centres = np.bincount(bins, weights * over, count)[used] / total
    means = np.bincount(bins, weights * forces, count)[used] / total
    return np.stack([centres, means, scipy.stats.norm.ppf(0.975) / np.sqrt(total)], axis=1)
