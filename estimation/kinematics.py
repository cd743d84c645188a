"""The motion that fits measured lengths best: weighted least squares in ξ with the full Δ.

The pose is the finite series, not the lengths: the inverse kinematics of a finite series of the
pose has all harmonics. The fit is nonlinear and is solved by Gauss–Newton, which converges in a
few steps because the residuals are small.

How many harmonics the lengths show is decided against the noise floor. Starting from the number
that is expected, every further harmonic is tested for amplitudes that noise does not explain (a
score test with 12 degrees of freedom each); the highest one that is found is included with all
below it, and the test is repeated. A strong harmonic leaks into the scores of its neighbours: in
the end the highest ones are dropped again while their fitted amplitudes, with all others in the
fit, are within the noise (a Wald test). A controller's tracking error shows here; what the forces
show of it besides is judged with them (`estimation.identification.harmonics`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy
import scipy.linalg as sla
from numpy.typing import NDArray
from scipy.special import erf

from constraints.arrays import Array, ComplexArray
from estimation.measurement_model import HarmonicMotion
from estimation.measurement_model.motion import MotionSamples, NormalEquations, Rows, whitened
from estimation.measurement_model.prediction import (
    chunks,
    length_columns,
    sliding_kernel,
    sliding_rate_kernel,
)
from estimation.processing import PeriodicRecording
from estimation.processing.spectrum import WhiteningFilter
from expdesign.configuration import ComputationError
from expdesign.information.fisher import whitening
from expdesign.robot import ForwardKinematicsError, Robot
from expdesign.trajectory import PhaseBasis

_STEPS = 30
_HALVINGS = 12
_CONVERGED = 1e-4
_START_POINTS = 400
_FAMILY_LEVEL = 1e-3
_MOST = 60
_ROUNDS = 6
_POINTS = 4096
_NO_LINE = 1e-12
"""Share of the energy of all lines that a line has at the least."""


class MotionFitError(ComputationError):
    """No motion was found that has the measured lengths."""


class NoMotionFoundError(MotionFitError):
    """The iteration did not end: with so few harmonics the residuals may be too large."""


@dataclass(frozen=True, eq=False)
class MotionFit:
    """A motion fitted to measured lengths."""

    motion: HarmonicMotion
    covariance: Array
    """(x, x), of ξ."""
    residuals: Array
    """(S, 6), measured minus fitted lengths, m."""
    wanted: int | None = None
    """How many harmonics the lengths show, where no motion was found that has so many."""


def fit_motion(
    robot: Robot,
    record: PeriodicRecording,
    covariance: Array,
    harmonics: int,
    *,
    start: HarmonicMotion | None = None,
    free_frequency: bool = False,
    noise_filter: WhiteningFilter | None = None,
) -> MotionFit:
    """Fit a motion with H harmonics to the measured lengths.

    The covariance is Δ of one sample, (6, 6), m², behind a filter that makes the noise white. By
    default the fit starts from the forward kinematics of some of the lengths.

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
    motion = HarmonicMotion(first.table, record.omega, free_frequency).with_harmonics(harmonics)
    present = length_equations(robot, record, covariance, motion, noise_filter)
    for _ in range(_STEPS):
        try:
            step = np.asarray(sla.solve(present.matrix, present.gradient, assume_a="pos"))
        except np.linalg.LinAlgError as error:
            raise MotionFitError("the lengths do not determine the motion") from error
        decrement = float(step @ present.gradient)
        for halving in range(_HALVINGS):
            trial = motion.moved(0.5**halving * step)
            following = length_equations(robot, record, covariance, trial, noise_filter)
            if following.cost <= present.cost * (1 + 1e-12):
                motion, present = trial, following
                break
        else:
            break
        if decrement < _CONVERGED**2 * len(step):
            break
    else:
        raise NoMotionFoundError(
            f"no motion with {harmonics} harmonics was found in {_STEPS} iterations"
        )
    return MotionFit(
        motion=motion,
        covariance=np.asarray(np.linalg.inv(present.matrix), dtype=np.float64),
        residuals=length_residuals(robot, record, motion),
    )


def start_motion(robot: Robot, record: PeriodicRecording, harmonics: int) -> HarmonicMotion:
    """Return a first motion: forward kinematics of some samples, and a Fourier series of them.

    Raises
    ------
    MotionFitError
        The forward kinematics found no pose.
    """
    # Evenly in phase: a stride through samples that are not averaged could meet a few phases only.
    order = np.argsort(np.mod(record.omega * record.lengths.times, 2 * np.pi), kind="stable")
    rows = order[:: max(1, record.samples // _START_POINTS)]
    lengths, times = record.lengths.values[rows], record.lengths.times[rows]
    try:
        poses = robot.forward_kinematics(lengths)
    except ForwardKinematicsError as error:
        raise MotionFitError(f"no pose has the measured lengths: {error}") from error
    basis = PhaseBasis.at(record.omega * times, min(harmonics, (len(times) - 1) // 2)).value
    table = np.asarray(np.linalg.lstsq(basis, poses, rcond=None)[0].T, dtype=np.float64)
    return HarmonicMotion(table, record.omega)


def length_residuals(robot: Robot, record: PeriodicRecording, motion: HarmonicMotion) -> Array:
    """Return measured minus modelled lengths, (S, 6), m."""
    basis = PhaseBasis.at(motion.omega * record.lengths.times, motion.harmonics).value
    return record.lengths.values - robot.inverse_kinematics(basis @ motion.table.T)


def length_equations(
    robot: Robot,
    record: PeriodicRecording,
    covariance: Array,
    motion: HarmonicMotion,
    noise_filter: WhiteningFilter | None = None,
) -> NormalEquations:
    """Return the normal equations of ξ from the lengths, whose covariance is Δ, (6, 6)."""

    def rows(part: slice) -> Rows:
        lengths, columns = length_columns(robot, motion.at(record.lengths.times[part]))
        return record.lengths.values[part] - lengths, columns, record.lengths.counts[part]

    return NormalEquations.of(map(rows, chunks(record.samples)), covariance, noise_filter)


def most_harmonics(record: PeriodicRecording) -> int:
    """Return how many harmonics are looked for: the sampling bears no more."""
    per_period = record.samples if record.averaged else record.period / record.step
    return int(min(_MOST, (per_period - 1) // 4, (record.samples - 1) // 8))


def choose_harmonics(
    robot: Robot,
    record: PeriodicRecording,
    covariance: Array,
    least: int,
    *,
    expected: int | None = None,
    start: HarmonicMotion | None = None,
    free_frequency: bool = False,
    noise_filter: WhiteningFilter | None = None,
) -> MotionFit:
    """Fit the motion with the harmonics that exceed the noise.

    The motion has `least` of them for certain, and the search begins at those expected; the
    covariance is Δ of one sample, (6, 6), m². Where no motion of this machine has the harmonics
    that the lengths show, as when joints are elsewhere than stated and a pose is near singular, it
    is the last one that was found.

    Raises
    ------
    MotionFitError
        No motion has these lengths, with however many harmonics.
    """
    most = most_harmonics(record)
    first = max(least, min(expected or least, most))
    level = _FAMILY_LEVEL / max(most - least, 1)

    def fitted(count: int, begin: HarmonicMotion | None) -> MotionFit:
        return fit_motion(
            robot,
            record,
            covariance,
            count,
            start=begin,
            free_frequency=free_frequency,
            noise_filter=noise_filter,
        )

    def begun(count: int) -> MotionFit:
        """Fit with that many, or with more where the residuals of so few are too large."""
        try:
            return fitted(count, start)
        except NoMotionFoundError as error:
            if count >= most:
                raise NoMotionFoundError(
                    f"{error}, nor with fewer: the lengths may not be those of this machine "
                    "(joints, half-angles and home of the robot file; order, sign and offset under "
                    "`data`), or repeat with another period"
                ) from error
            return begun(min(2 * count, most))

    fit = begun(first)
    for _ in range(_ROUNDS):
        harmonics = fit.motion.harmonics
        if harmonics >= most:
            break
        found = np.flatnonzero(
            _p_values(robot, record, covariance, fit, most, noise_filter) < level
        )
        if not len(found):
            break
        wanted = harmonics + int(found[-1]) + 1
        try:
            fit = fitted(wanted, fit.motion)
        except NoMotionFoundError:
            return replace(fit, wanted=wanted)
    needed = _highest_needed(fit, least, level)
    return fitted(needed, fit.motion) if needed < fit.motion.harmonics else fit


def _highest_needed(fit: MotionFit, least: int, level: float) -> int:
    """Return the highest harmonic whose amplitudes exceed their uncertainty."""
    size = fit.motion.table.size
    order = np.arange(size).reshape(fit.motion.table.shape)
    count = fit.motion.harmonics
    for harmonic in range(count, least, -1):
        places = np.concatenate([order[:, harmonic], order[:, count + harmonic]])
        amplitudes = fit.motion.table.ravel()[places]
        block = fit.covariance[np.ix_(places, places)]
        statistic = float(amplitudes @ np.linalg.solve(block, amplitudes))
        if scipy.stats.chi2.sf(statistic, len(places)) < level:
            return harmonic
    return least


def _p_values(
    robot: Robot,
    record: PeriodicRecording,
    covariance: Array,
    fit: MotionFit,
    most: int,
    noise_filter: WhiteningFilter | None,
) -> Array:
    """Return the p-value of each harmonic above the fit's, tested on the fit's residuals."""
    white, motion = whitening(covariance), fit.motion
    rows = np.arange(record.samples)
    if not record.averaged:
        # Evenly in phase, so that no harmonic is an alias of another.
        order = np.argsort(np.mod(motion.omega * record.lengths.times, 2 * np.pi), kind="stable")
        rows = order[:: max(1, record.samples // _POINTS)]
    phases = motion.omega * record.lengths.times[rows]
    poses = PhaseBasis.at(phases, motion.harmonics).value @ motion.table.T
    _, jacobian = robot.lengths_and_jacobian(poses)
    residual, counts = fit.residuals[rows], record.lengths.counts[rows]
    inverse = white.T @ white
    if noise_filter is None:
        score = np.einsum("sri,sr->si", jacobian, whitened(residual, inverse, counts**2))
        slope = whitened(jacobian, white, counts)
        curvature = np.einsum("sri,srj->sij", slope, slope)
    else:
        weighted = whitened(noise_filter(residual), inverse, counts**2)
        score = np.einsum("sri,sr->si", jacobian, noise_filter(weighted))
        gains = noise_filter.gain @ (inverse * counts[0]) @ noise_filter.gain
        turned = _turned_information(jacobian, gains, float(phases[0]))
    values = []
    for harmonic in range(motion.harmonics + 1, most + 1):
        sin, cos = np.sin(harmonic * phases), np.cos(harmonic * phases)
        right = np.concatenate([sin @ score, cos @ score])
        if noise_filter is None:
            blocks = [
                np.einsum("s,sij->ij", product, curvature)
                for product in (sin * sin, sin * cos, cos * cos)
            ]
            normal = np.block([[blocks[0], blocks[1]], [blocks[1].T, blocks[2]]])
        else:
            normal = turned(harmonic)
        statistic = float(right @ np.linalg.solve(normal, right))
        values.append(float(scipy.stats.chi2.sf(statistic, len(right))))
    return np.array(values)


def _turned_information(
    jacobian: Array, weights: ComplexArray, phase: float
) -> Callable[[int], Array]:
    """Return a function of the information on the sine and cosine of a harmonic, (12, 12).

    Of a period's slopes of the lengths to the pose, (N, 6, 6), weighted line by line,
    (N // 2 + 1, 6, 6), whose first sample has this phase, rad. A harmonic turns the few lines of
    the slopes by its number.
    """
    count = len(jacobian)
    lines = np.fft.fft(jacobian, axis=0) / np.sqrt(count)
    whole = np.concatenate([weights, weights[1 : count - len(weights) + 1].conj()[::-1]])
    energy = np.sum(np.abs(lines) ** 2, axis=(1, 2))
    kept = np.flatnonzero(energy > _NO_LINE * np.sum(energy))

    def information(harmonic: int) -> Array:
        own = lines[kept]
        weighted = np.matmul(whole[(kept + harmonic) % count], own)
        along = np.einsum("lji,ljk->ik", own.conj(), weighted)
        other = lines[(kept + 2 * harmonic) % count]
        against = np.einsum("lji,ljk->ik", other.conj(), weighted)
        against = against * np.exp(2j * harmonic * phase)
        mixed = (along + against).imag
        return np.block([[(along - against).real, mixed.T], [mixed, (along + against).real]]) / 2

    return information


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
