"""Pointwise kinematics, for comparison with classic practice: forward kinematics sample by sample.

Rates and accelerations are differences between neighbours, of the poses as they are
(``central``) or after a zero-phase low pass (``butterworth``). Their errors are large and go
into the regressor: estimates are biased, and intervals that count the forces' noise alone do not
cover.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.special import erf

from constraints.arrays import Array
from estimation.kinematics.fourier_fit import MotionFitError
from estimation.measurement_model import HarmonicMotion
from estimation.measurement_model.motion import MotionSamples
from estimation.measurement_model.prediction import chunks, sliding_kernel, sliding_rate_kernel
from estimation.processing import PeriodicRecording
from expdesign.robot import ForwardKinematicsError, Robot

_FILTER_ORDER = 4
_EDGE = 2
_GAP = 1.5


@dataclass(frozen=True, eq=False)
class PointwiseMotion:
    """States λ, λ̇, λ̈, (R, 18), at those rows of the record, (R,), whose neighbours are known."""

    rows: NDArray[np.intp]
    state: Array


def pointwise_motion(
    robot: Robot, record: PeriodicRecording, *, cutoff: float | None = None
) -> PointwiseMotion:
    """Return poses by forward kinematics and their differences.

    Parameters
    ----------
    cutoff : float, optional
        Of the zero-phase Butterworth filter (order 4 forward and backward), Hz; none: no filter.

    Raises
    ------
    MotionFitError
        The stamps jitter, the channels have different delays, or a length has no pose.
    """
    if record.stamped:
        raise MotionFitError(
            "pointwise differentiation needs uniform time; stamped data need the Fourier fit"
        )
    if not np.allclose(record.lengths.times, record.forces.times, rtol=0, atol=1e-9):
        raise MotionFitError(
            "pointwise differentiation cannot shift channels by their delays; use the Fourier fit"
        )
    gap = np.max(np.diff(record.lengths.times)) if record.samples > 1 else 0.0
    if gap > _GAP * record.step:
        raise MotionFitError(
            "pointwise differentiation needs a sample at every step; use the Fourier fit where "
            "some were lost"
        )
    try:
        poses = robot.forward_kinematics(record.lengths.values)
    except ForwardKinematicsError as error:
        raise MotionFitError(f"no pose has the measured lengths: {error}") from error
    count, wrap = len(poses), record.averaged
    # A mean period goes on with its own beginning; single samples end where they end.
    pad = count if wrap else 0
    extended = np.concatenate([poses[count - pad :], poses, poses[:pad]]) if wrap else poses
    if cutoff is not None:
        sections = scipy.signal.butter(_FILTER_ORDER, cutoff, fs=1 / record.step, output="sos")
        extended = scipy.signal.sosfiltfilt(sections, extended, axis=0)
    rate = (extended[2:] - extended[:-2]) / (2 * record.step)
    acceleration = (extended[2:] - 2 * extended[1:-1] + extended[:-2]) / record.step**2
    state = np.concatenate([extended[1:-1], rate, acceleration], axis=1)
    if wrap:
        return PointwiseMotion(np.arange(count), state[pad - 1 : pad - 1 + count])
    rows = np.arange(1, count - 1)
    inner = slice(_EDGE, len(rows) - _EDGE)
    return PointwiseMotion(rows[inner], state[inner])


def expected_signs(robot: Robot, motion: HarmonicMotion, times: Array, spread: Array) -> Array:
    """Return E[sign] of the rates that the terms use, (S, s), at the times given, s.

    `spread` is their standard deviation, (S, s), as of `rate_spread`; 0 gives the plain signs.
    """
    return signs_along(robot, motion.at(times), spread)


def signs_along(robot: Robot, sampled: MotionSamples, spread: Array) -> Array:
    """Return the same signs along a motion that is sampled already."""
    kernel = sliding_rate_kernel(robot.terms)
    (rates,) = kernel(sampled.state(), robot.geometry_vector)
    doubtful = spread > 0
    scaled = np.divide(rates, np.sqrt(2) * spread, out=np.zeros_like(rates), where=doubtful)
    return np.where(doubtful, erf(scaled), np.sign(rates))


def rate_spread(robot: Robot, motion: HarmonicMotion, times: Array, covariance: Array) -> Array:
    """Return the standard deviations of the same rates, (S, s), from Cov(ξ), (x, x)."""
    factor = np.asarray(np.linalg.cholesky(covariance + 0.0), dtype=np.float64)
    parts = []
    for part in chunks(len(times)):
        sampled = motion.at(times[part])
        _, slope = sliding_kernel(robot.terms)(sampled.state(), robot.geometry_vector)
        parts.append(np.linalg.norm(sampled.moved(slope, factor), axis=2))
    return np.concatenate(parts)
