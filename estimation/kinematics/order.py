"""How many harmonics the executed motion has, from the data against the noise floor.

Starting from the design's number, every further harmonic is tested for amplitudes that noise
does not explain (a score test with 12 degrees of freedom each); the highest one that is found is
included with all below it, and the test is repeated. A strong harmonic leaks into the scores of its
neighbours: in the end the highest ones are dropped again while their fitted amplitudes, with all
others in the fit, are within the noise (a Wald test). A controller's tracking error shows here.
"""

from __future__ import annotations

import numpy as np
from scipy import stats

from constraints.arrays import Array
from estimation.kinematics.fourier_fit import MotionFit, fit_motion
from estimation.measurement_model import HarmonicMotion
from estimation.processing import Record
from expdesign.information.fisher import whitening
from expdesign.robot import Robot
from expdesign.trajectory import PhaseBasis

_FAMILY_LEVEL = 1e-3
_MOST = 60
_ROUNDS = 6
_POINTS = 4096


def choose_harmonics(
    robot: Robot,
    record: Record,
    covariance: Array,
    least: int,
    *,
    start: HarmonicMotion | None = None,
    free_frequency: bool = False,
) -> MotionFit:
    """Fit the motion with as many harmonics as stand out of the noise.

    Parameters
    ----------
    covariance : (6, 6)
        Δ of one sample, m².
    least : int
        Harmonics that the motion has for certain (those of the design, or 1).
    """
    per_period = record.samples if record.averaged else record.period / record.step
    most = int(min(_MOST, (per_period - 1) // 4, (record.samples - 1) // 8))
    level = _FAMILY_LEVEL / max(most - least, 1)

    def fitted(count: int, begin: HarmonicMotion | None) -> MotionFit:
        return fit_motion(
            robot, record, covariance, count, start=begin, free_frequency=free_frequency
        )

    fit = fitted(least, start)
    for _ in range(_ROUNDS):
        harmonics = fit.motion.harmonics
        if harmonics >= most:
            break
        found = np.flatnonzero(_p_values(robot, record, covariance, fit, most) < level)
        if not len(found):
            break
        fit = fitted(harmonics + int(found[-1]) + 1, fit.motion)
    needed = _highest_needed(fit, least, level)
    return fitted(needed, fit.motion) if needed < fit.motion.harmonics else fit


def _highest_needed(fit: MotionFit, least: int, level: float) -> int:
    """Return the highest harmonic whose amplitudes stand out of their own uncertainty."""
    size = fit.motion.table.size
    order = np.arange(size).reshape(fit.motion.table.shape)
    count = fit.motion.harmonics
    for harmonic in range(count, least, -1):
        places = np.concatenate([order[:, harmonic], order[:, count + harmonic]])
        amplitudes = fit.motion.table.ravel()[places]
        block = fit.covariance[np.ix_(places, places)]
        statistic = float(amplitudes @ np.linalg.solve(block, amplitudes))
        if stats.chi2.sf(statistic, len(places)) < level:
            return harmonic
    return least


def _p_values(robot: Robot, record: Record, covariance: Array, fit: MotionFit, most: int) -> Array:
    """Return the p-value of each harmonic above the fit's, tested on the fit's residuals."""
    stride = max(1, record.samples // _POINTS) if not record.averaged else 1
    white = whitening(covariance)
    motion = fit.motion
    # Evenly in phase, so that no harmonic is an alias of another.
    order = np.argsort(np.mod(fit.motion.omega * record.length_times, 2 * np.pi), kind="stable")
    rows = order[::stride]
    times = record.length_times[rows]
    phases = motion.omega * times
    poses = PhaseBasis.at(phases, motion.harmonics).value @ motion.table.T
    _, jacobian = robot.lengths_and_jacobian(poses)
    weight = np.sqrt(record.length_counts[rows])
    slope = np.matmul(white, jacobian) * weight[:, None, None]
    residual = fit.residuals[rows] @ white.T * weight[:, None]
    score = np.einsum("sri,sr->si", slope, residual)
    curvature = np.einsum("sri,srj->sij", slope, slope)
    values = []
    for harmonic in range(motion.harmonics + 1, most + 1):
        sin, cos = np.sin(harmonic * phases), np.cos(harmonic * phases)
        right = np.concatenate([sin @ score, cos @ score])
        blocks = [
            np.einsum("s,sij->ij", product, curvature)
            for product in (sin * sin, sin * cos, cos * cos)
        ]
        normal = np.block([[blocks[0], blocks[1]], [blocks[1].T, blocks[2]]])
        statistic = float(right @ np.linalg.solve(normal, right))
        values.append(float(stats.chi2.sf(statistic, len(right))))
    return np.array(values)
