"""Signs of dry friction along an estimated motion.

sign(v) has no derivative, and near v = 0 the estimated rate does not tell the sign. What is right
on average is the sign's expectation given the estimate, erf(v / √2 σ_v), with σ_v the standard
deviation of the estimated rate: it is ±1 except for the few samples next to a reversal, and the
error that is left has the mean zero, so that it does not bias the parameters (regression
calibration). No sample is left out and no width is chosen by hand.
"""

from __future__ import annotations

import numpy as np
from scipy.special import erf

from constraints.arrays import Array
from estimation.measurement_model import HarmonicMotion
from estimation.measurement_model.motion import SampledMotion
from estimation.measurement_model.prediction import chunks, sliding_kernel, sliding_rate_kernel
from expdesign.robot import Robot


def expected_signs(robot: Robot, motion: HarmonicMotion, times: Array, spread: Array) -> Array:
    """Return E[sign] of the rates that the terms use, (S, s), at the times given, s.

    `spread` is their standard deviation, (S, s), as of `rate_spread`; 0 gives the plain signs.
    """
    return signs_along(robot, motion.at(times), spread)


def signs_along(robot: Robot, sampled: SampledMotion, spread: Array) -> Array:
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
