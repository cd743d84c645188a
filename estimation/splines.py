"""Splines of six channels without a period, on equidistant knots whose number the data choose."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from constraints.arrays import Array
from estimation.kinematics import MotionFitError
from estimation.measurement_model import SplineMotion
from estimation.measurement_model.spline import DEGREE
from estimation.processing import NoiseEstimate

_FEWEST, _MOST = 4, 500
"""Intervals."""
_RATIO = 1.2
"""Of successive numbers of intervals that are tried."""
_PER_INTERVAL = 4
"""Fewest samples of an interval."""
_POINTS = 3
"""Instants of an interval that show the splines."""


@dataclass(frozen=True, eq=False)
class SmoothChannels:
    """Six channels as splines on the same knots, and their scatter about them."""

    motion: SplineMotion
    """The splines; its coordinates are the channels."""
    scatter: NoiseEstimate


def smooth_channels(times: Array, values: Array) -> SmoothChannels:
    """Fit splines to six channels, (S, 6), with as many intervals as predict them best.

    Raises
    ------
    MotionFitError
        There are too few samples.
    """
    most = min(_MOST, len(times) // _PER_INTERVAL)
    if most < _FEWEST:
        raise MotionFitError(
            f"{len(times)} samples are too few for a motion without a period: "
            f"{_FEWEST * _PER_INTERVAL} or more are needed"
        )
    steps = int(np.log(most / _FEWEST) / np.log(_RATIO)) + 1
    counts = np.unique(np.geomspace(_FEWEST, most, steps + 1).round().astype(int))
    best, least = None, np.inf
    for intervals in counts:
        found = fit_splines(times, values, int(intervals))
        if found is None:
            continue
        freedom, used = found.scatter.freedom, int(intervals) + DEGREE
        _, logarithm = np.linalg.slogdet(found.scatter.covariance * freedom / len(times))
        # Akaike's criterion, corrected for few samples.
        criterion = len(times) * (logarithm + 2 * values.shape[1] * used / freedom)
        if criterion < least:
            best, least = found, criterion
    if best is None:
        raise MotionFitError("samples are missing over too long a time for a spline")
    return best


def fit_splines(times: Array, values: Array, intervals: int) -> SmoothChannels | None:
    """Fit splines with a number of intervals; None if the samples do not determine them."""
    motion = SplineMotion.over(times, intervals)
    sampled, count = motion.at(times), len(times)
    columns = sampled.first[:, None] + np.arange(DEGREE + 1)
    rows = np.broadcast_to(np.arange(count)[:, None], columns.shape)
    shape = count, intervals + DEGREE
    basis = sparse.csr_array((sampled.basis[:, 0].ravel(), (rows.ravel(), columns.ravel())), shape)
    normal = (basis.T @ basis).toarray()
    scale = np.sqrt(np.diag(normal))
    if not np.all(scale > 0):
        return None
    try:
        factor = np.linalg.cholesky(normal / np.multiply.outer(scale, scale))
    except np.linalg.LinAlgError:
        return None
    right = (basis.T @ values) / scale[:, None]
    table = np.linalg.solve(factor.T, np.linalg.solve(factor, right)) / scale[:, None]
    rest = values - basis @ table
    freedom = float(count - shape[1])
    scatter = NoiseEstimate(rest.T @ rest / freedom, freedom, "residuals")
    return SmoothChannels(replace(motion, table=table.T), scatter)


def instants_of(motion: SplineMotion) -> Array:
    """Return instants of a motion, s, that are enough to fit its splines again."""
    places = np.linspace(0, motion.intervals, _POINTS * (motion.intervals + DEGREE))
    return np.asarray(motion.start + motion.spacing * places)
