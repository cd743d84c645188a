"""The motion that fits measured lengths best: weighted least squares in ξ with the full Δ.

The pose is the finite series, not the lengths: the inverse kinematics of a finite series of the
pose has all harmonics. The fit is nonlinear and is solved by Gauss–Newton, which converges in a
few steps because the residuals are small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as sla

from constraints.arrays import Array
from estimation.measurement_model import HarmonicMotion, predict_lengths
from estimation.processing import Record
from expdesign.information.fisher import whitening
from expdesign.robot import ForwardKinematicsError, Robot
from expdesign.trajectory import PhaseBasis

CHUNK = 2048
"""Samples whose derivatives are in memory at a time."""

_STEPS = 30
_HALVINGS = 12
_CONVERGED = 1e-4
_START_POINTS = 400


class MotionFitError(ArithmeticError):
    """No motion was found that has the measured lengths."""


@dataclass(frozen=True, eq=False)
class MotionFit:
    """A motion fitted to measured lengths.

    Attributes
    ----------
    motion : HarmonicMotion
    covariance : (x, x)
        Of ξ: the coefficients (6, 2 H + 1) row by row, then ω if it was free.
    residuals : (S, 6)
        Measured minus fitted lengths, m.
    chi_square : float
        Σ counts · rᵀ Δ⁻¹ r.
    freedom : int
        6 S minus the number of unknowns.
    iterations : int
    free_frequency : bool
    """

    motion: HarmonicMotion
    covariance: Array
    residuals: Array
    chi_square: float
    freedom: int
    iterations: int
    free_frequency: bool


def fit_motion(
    robot: Robot,
    record: Record,
    covariance: Array,
    harmonics: int,
    *,
    start: HarmonicMotion | None = None,
    free_frequency: bool = False,
) -> MotionFit:
    """Fit a motion with H harmonics to the measured lengths.

    Parameters
    ----------
    covariance : (6, 6)
        Δ of one sample, m².
    start : HarmonicMotion, optional
        Where to begin; by default the forward kinematics of some of the lengths.

    Raises
    ------
    MotionFitError
        The samples do not determine that many harmonics, or no motion has these lengths.
    """
    if 2 * harmonics + 1 > record.samples:
        raise MotionFitError(
            f"{harmonics} harmonics need {2 * harmonics + 1} samples, there are {record.samples}"
        )
    first = start_motion(robot, record, min(harmonics, 5)) if start is None else start
    motion = HarmonicMotion(first.table, record.omega).with_harmonics(harmonics)
    white = whitening(covariance)
    cost, normal, right = _normal_equations(robot, record, white, motion, free=free_frequency)
    iterations = 0
    for _ in range(_STEPS):
        iterations += 1
        try:
            step = np.asarray(sla.solve(normal, right, assume_a="pos"))
        except np.linalg.LinAlgError as error:
            raise MotionFitError("the lengths do not determine the motion") from error
        decrement = float(step @ right)
        factor = 1.0
        for _ in range(_HALVINGS):
            trial = motion.moved(factor * step, free_frequency=free_frequency)
            new = _normal_equations(robot, record, white, trial, free=free_frequency)
            if new[0] <= cost * (1 + 1e-12):
                motion, (cost, normal, right) = trial, new
                break
            factor /= 2
        else:
            break
        if decrement < _CONVERGED**2 * len(step):
            break
    else:
        raise MotionFitError(f"no motion was found in {_STEPS} iterations")
    residuals = length_residuals(robot, record, motion)
    size = len(right)
    return MotionFit(
        motion=motion,
        covariance=np.asarray(np.linalg.inv(normal), dtype=np.float64),
        residuals=residuals,
        chi_square=cost,
        freedom=residuals.size - size,
        iterations=iterations,
        free_frequency=free_frequency,
    )


def start_motion(robot: Robot, record: Record, harmonics: int) -> HarmonicMotion:
    """Return a first motion: forward kinematics of some samples, and a Fourier series of them.

    Raises
    ------
    MotionFitError
        The forward kinematics found no pose.
    """
    # Evenly in phase: a stride through samples that are not averaged could meet a few phases only.
    order = np.argsort(np.mod(record.omega * record.length_times, 2 * np.pi), kind="stable")
    rows = order[:: max(1, record.samples // _START_POINTS)]
    lengths, times = record.lengths[rows], record.length_times[rows]
    try:
        poses = robot.forward_kinematics(lengths)
    except ForwardKinematicsError as error:
        raise MotionFitError(f"no pose has the measured lengths: {error}") from error
    basis = PhaseBasis.at(record.omega * times, min(harmonics, (len(times) - 1) // 2)).value
    table = np.asarray(np.linalg.lstsq(basis, poses, rcond=None)[0].T, dtype=np.float64)
    return HarmonicMotion(table, record.omega)


def length_residuals(robot: Robot, record: Record, motion: HarmonicMotion) -> Array:
    """Return measured minus modelled lengths, (S, 6), m."""
    basis = PhaseBasis.at(motion.omega * record.length_times, motion.harmonics).value
    return record.lengths - robot.inverse_kinematics(basis @ motion.table.T)


def _normal_equations(
    robot: Robot, record: Record, white: Array, motion: HarmonicMotion, *, free: bool
) -> tuple[float, Array, Array]:
    size = motion.table.size + int(free)
    cost, normal, right = 0.0, np.zeros((size, size)), np.zeros(size)
    for first in range(0, record.samples, CHUNK):
        part = slice(first, first + CHUNK)
        prediction = predict_lengths(robot, motion, record.length_times[part], free_frequency=free)
        weight = np.sqrt(record.length_counts[part])[:, None]
        residual = ((record.lengths[part] - prediction.lengths) @ white.T * weight).ravel()
        slope = (np.matmul(white, prediction.slope) * weight[:, :, None]).reshape(-1, size)
        cost += float(residual @ residual)
        normal += slope.T @ slope
        right += slope.T @ residual
    return cost, normal, right
