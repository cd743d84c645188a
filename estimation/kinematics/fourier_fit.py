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
from estimation.measurement_model.normal_equations import NormalEquations, Rows
from estimation.measurement_model.prediction import chunks
from estimation.processing import Record
from expdesign.configuration import ComputationError
from expdesign.robot import ForwardKinematicsError, Robot
from expdesign.trajectory import PhaseBasis

_STEPS = 30
_HALVINGS = 12
_CONVERGED = 1e-4
_START_POINTS = 400


class MotionFitError(ComputationError):
    """No motion was found that has the measured lengths."""


@dataclass(frozen=True, eq=False)
class MotionFit:
    """A motion fitted to measured lengths.

    Attributes
    ----------
    covariance : (x, x)
        Of ξ: the coefficients (6, 2 H + 1) row by row, then ω if it was free.
    residuals : (S, 6)
        Measured minus fitted lengths, m.
    """

    motion: HarmonicMotion
    covariance: Array
    residuals: Array
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

    def equations(at: HarmonicMotion) -> NormalEquations:
        return length_equations(robot, record, covariance, at, free_frequency=free_frequency)

    present = equations(motion)
    for _ in range(_STEPS):
        try:
            step = np.asarray(sla.solve(present.matrix, present.gradient, assume_a="pos"))
        except np.linalg.LinAlgError as error:
            raise MotionFitError("the lengths do not determine the motion") from error
        decrement = float(step @ present.gradient)
        for halving in range(_HALVINGS):
            trial = motion.moved(0.5**halving * step, free_frequency=free_frequency)
            following = equations(trial)
            if following.cost <= present.cost * (1 + 1e-12):
                motion, present = trial, following
                break
        else:
            break
        if decrement < _CONVERGED**2 * len(step):
            break
    else:
        raise MotionFitError(f"no motion was found in {_STEPS} iterations")
    return MotionFit(
        motion=motion,
        covariance=np.asarray(np.linalg.inv(present.matrix), dtype=np.float64),
        residuals=length_residuals(robot, record, motion),
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


def length_equations(
    robot: Robot,
    record: Record,
    covariance: Array,
    motion: HarmonicMotion,
    *,
    free_frequency: bool = False,
) -> NormalEquations:
    """Return the normal equations of ξ from the lengths, whose covariance is Δ, (6, 6)."""

    def rows(part: slice) -> Rows:
        lengths, slope = predict_lengths(
            robot, motion, record.length_times[part], free_frequency=free_frequency
        )
        return record.lengths[part] - lengths, slope, record.length_counts[part]

    return NormalEquations.of(map(rows, chunks(record.samples)), covariance)
