"""Kinematics from measured lengths: weighted least squares in ξ with the full Δ, or pointwise.

The pose is the finite series, not the lengths: the inverse kinematics of a finite series of the
pose has all harmonics. The fit is nonlinear and is solved by Gauss–Newton, which converges in a
few steps because the residuals are small.

The number of harmonics is chosen against the noise floor. Starting from the expected number, every
further harmonic is tested for amplitudes beyond the noise (a score test with 12 degrees of freedom
each); the highest significant one is included with all below it, and the test is repeated. A strong
harmonic leaks into the scores of its neighbours: finally the highest ones are dropped while their
fitted amplitudes, with all others in the fit, are within the noise (a Wald test). A controller's
tracking error is visible here; `estimation.identification.harmonics` adds the harmonics that only
the forces show.

Pointwise kinematics serve the comparison with classic practice: forward kinematics sample by
sample, with differences between neighbours as rates and accelerations, of the poses as they are
(``central``) or after a zero-phase low pass (``butterworth``). Their errors are large and enter the
regressor: estimates are biased, and intervals from the forces' noise alone do not cover.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.special import erf

from constraints.arrays import Array, ComplexArray
from estimation.measurement_model import HarmonicMotion, Motion, SplineMotion, prediction
from estimation.measurement_model.banded import BandedInverse
from estimation.measurement_model.motion import NormalEquations, Rows, Samples, whiten_rows
from estimation.measurement_model.spline import MotionCovariance
from estimation.processing import NoiseEstimate, PeriodicRecording
from expdesign.configuration import ComputationError
from expdesign.information.fisher import whitening
from expdesign.robot import ForwardKinematicsError, Robot
from expdesign.trajectory import HARMONIC_LEVEL, MOST_HARMONICS, PhaseBasis

_STEPS = 30
_HALVINGS = 12
_CONVERGED = 1e-4
_START_POINTS = 400
_ROUNDS = 6
_POINTS = 4096
_NO_LINE = 1e-12
"""Smallest relevant energy of a line, relative to that of all lines."""


class MotionFitError(ComputationError):
    """No motion with the measured lengths was found."""


class NoMotionFoundError(MotionFitError):
    """The iteration did not converge: with few harmonics the residuals may be too large."""


@dataclass(frozen=True, eq=False)
class MotionFit:
    """A motion fitted to measured lengths."""

    motion: Motion
    covariance: MotionCovariance
    """(x, x), of ξ."""
    residuals: Array
    """(S, 6), measured minus fitted lengths, m."""
    wanted: int | None = None
    """Number of harmonics in the lengths, if no motion with as many was found."""

    @classmethod
    def of(
        cls,
        robot: Robot,
        recording: PeriodicRecording,
        motion: Motion,
        equations: NormalEquations,
    ) -> MotionFit:
        """Return a motion with its covariance by the equations of the lengths there."""
        inverse = BandedInverse.of if isinstance(motion, SplineMotion) else np.linalg.inv
        covariance = inverse(equations.matrix)
        return cls(motion, covariance, length_residuals(robot, recording, motion))

    @property
    def series(self) -> HarmonicMotion:
        """The motion as a Fourier series.

        Raises
        ------
        ValueError
            It is a spline.
        """
        if not isinstance(self.motion, HarmonicMotion):
            raise ValueError("a motion without a period has no Fourier series")
        return self.motion


def fit_motion(
    robot: Robot,
    recording: PeriodicRecording,
    noise: NoiseEstimate,
    harmonics: int,
    *,
    start: HarmonicMotion | None = None,
) -> MotionFit:
    """Fit a motion with H harmonics to the measured lengths, weighted by their noise.

    By default the fit starts from the forward kinematics of some samples. The frequency is one of
    the unknowns if it is one of those of the start.

    Raises
    ------
    MotionFitError
        The samples do not determine that many harmonics, or no motion has these lengths.
    """
    if 2 * harmonics + 1 > recording.samples:
        raise MotionFitError(
            f"{harmonics} harmonics need {2 * harmonics + 1} samples, there are {recording.samples}"
        )
    first = start_motion(robot, recording, min(harmonics, 5)) if start is None else start
    motion = replace(first, omega=recording.omega).with_harmonics(harmonics)
    return converge(robot, recording, noise, motion)


def converge(
    robot: Robot, recording: PeriodicRecording, noise: NoiseEstimate, motion: Motion
) -> MotionFit:
    """Fit the unknowns of a motion to the measured lengths, from their present values.

    Raises
    ------
    MotionFitError
        The samples do not determine the motion, or no motion has these lengths.
    """
    present = length_equations(robot, recording, noise, motion)
    for _ in range(_STEPS):
        try:
            step = present.eliminate(0).offset
        except np.linalg.LinAlgError as error:
            raise MotionFitError("the lengths do not determine the motion") from error
        decrement = float(step @ present.gradient)
        for halving in range(_HALVINGS):
            trial = motion.add_step(0.5**halving * step)
            following = length_equations(robot, recording, noise, trial)
            if following.cost <= present.cost * (1 + 1e-12):
                motion, present = trial, following
                break
        else:
            break
        if decrement < _CONVERGED**2 * len(step):
            break
    else:
        kind = f"with {motion.harmonics} harmonics" if motion.harmonics else "along a spline"
        raise NoMotionFoundError(f"no motion {kind} was found in {_STEPS} iterations")
    return MotionFit.of(robot, recording, motion, present)


def start_motion(robot: Robot, recording: PeriodicRecording, harmonics: int) -> HarmonicMotion:
    """Return a first motion: forward kinematics of some samples, and a Fourier series of them.

    Raises
    ------
    MotionFitError
        The forward kinematics found no pose.
    """
    # Evenly in phase: a stride through single samples could hit few phases only.
    order = np.argsort(np.mod(recording.omega * recording.lengths.times, 2 * np.pi), kind="stable")
    rows = order[:: max(1, recording.samples // _START_POINTS)]
    lengths, times = recording.lengths.values[rows], recording.lengths.times[rows]
    try:
        poses = robot.forward_kinematics(lengths)
    except ForwardKinematicsError as error:
        raise MotionFitError(f"no pose has the measured lengths: {error}") from error
    basis = PhaseBasis.at(recording.omega * times, min(harmonics, (len(times) - 1) // 2)).value
    table = np.asarray(np.linalg.lstsq(basis, poses, rcond=None)[0].T, dtype=np.float64)
    return HarmonicMotion(table, recording.omega)


def length_residuals(robot: Robot, recording: PeriodicRecording, motion: Motion) -> Array:
    """Return measured minus modelled lengths, (S, 6), m."""
    poses = motion.poses(recording.lengths.times)
    return recording.lengths.values - robot.inverse_kinematics(poses)


def length_equations(
    robot: Robot, recording: PeriodicRecording, noise: NoiseEstimate, motion: Motion
) -> NormalEquations:
    """Return the normal equations of ξ from the lengths."""

    def rows(part: slice) -> Rows:
        lengths, columns = prediction.length_columns(
            robot, motion.at(recording.lengths.times[part])
        )
        return recording.lengths.values[part] - lengths, columns, recording.lengths.counts[part]

    parts = map(rows, prediction.chunks(recording.samples))
    return NormalEquations.of(parts, noise.covariance, noise.filter)


def most_harmonics(recording: PeriodicRecording) -> int:
    """Return the largest number of harmonics that the sampling allows."""
    per_period = recording.samples if recording.averaged else recording.period / recording.step
    return int(min(MOST_HARMONICS, (per_period - 1) // 4, (recording.samples - 1) // 8))


def choose_harmonics(
    robot: Robot,
    recording: PeriodicRecording,
    noise: NoiseEstimate,
    least: int,
    *,
    expected: int | None = None,
    start: HarmonicMotion | None = None,
) -> MotionFit:
    """Fit the motion with the harmonics that exceed the noise.

    The motion has at least `least` harmonics, and the search begins at the expected number. If no
    motion of this machine has all harmonics of the lengths, for example near a singular pose with
    wrong joints, the last one found is returned.

    Raises
    ------
    MotionFitError
        No motion has these lengths, for any number of harmonics.
    """
    most = max(least, most_harmonics(recording))
    first = max(least, min(expected or least, most))
    level = HARMONIC_LEVEL / max(most - least, 1)

    fitted = partial(fit_motion, robot, recording, noise)

    def begun(count: int) -> MotionFit:
        """Fit with this number, or with more if the residuals are too large."""
        try:
            return fitted(count, start=start)
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
        harmonics = fit.series.harmonics
        if harmonics >= most:
            break
        found = np.flatnonzero(_p_values(robot, recording, noise, fit, most) < level)
        if not len(found):
            break
        wanted = harmonics + int(found[-1]) + 1
        try:
            fit = fitted(wanted, start=fit.series)
        except NoMotionFoundError:
            return replace(fit, wanted=wanted)
    needed = _highest_needed(fit, least, level)
    return fitted(needed, start=fit.series) if needed < fit.series.harmonics else fit


def _highest_needed(fit: MotionFit, least: int, level: float) -> int:
    """Return the highest harmonic whose amplitudes exceed their uncertainty."""
    size = fit.series.table.size
    order = np.arange(size).reshape(fit.series.table.shape)
    count = fit.series.harmonics
    for harmonic in range(count, least, -1):
        places = np.concatenate([order[:, harmonic], order[:, count + harmonic]])
        amplitudes = fit.series.table.ravel()[places]
        block = np.asarray(fit.covariance)[np.ix_(places, places)]
        statistic = float(amplitudes @ np.linalg.solve(block, amplitudes))
        if scipy.stats.chi2.sf(statistic, len(places)) < level:
            return harmonic
    return least


def _p_values(
    robot: Robot, recording: PeriodicRecording, noise: NoiseEstimate, fit: MotionFit, most: int
) -> Array:
    """Return the p-value of each harmonic above the fit's, tested on the fit's residuals."""
    white, motion, noise_filter = whitening(noise.covariance), fit.series, noise.filter
    rows = np.arange(recording.samples)
    if not recording.averaged:
        # Evenly in phase, so that no harmonic is an alias of another.
        order = np.argsort(np.mod(motion.omega * recording.lengths.times, 2 * np.pi), kind="stable")
        rows = order[:: max(1, recording.samples // _POINTS)]
    phases = motion.omega * recording.lengths.times[rows]
    poses = PhaseBasis.at(phases, motion.harmonics).value @ motion.table.T
    _, jacobian = robot.lengths_and_jacobian(poses)
    residual, counts = fit.residuals[rows], recording.lengths.counts[rows]
    inverse = white.T @ white
    if noise_filter is None:
        score = np.einsum("sri,sr->si", jacobian, whiten_rows(residual, inverse, counts**2))
        slope = whiten_rows(jacobian, white, counts)
        curvature = np.einsum("sri,srj->sij", slope, slope)
    else:
        weighted = whiten_rows(noise_filter(residual), inverse, counts**2)
        score = np.einsum("sri,sr->si", jacobian, noise_filter.adjoint(weighted))
        gains = noise_filter.gain @ (inverse * counts[0]) @ noise_filter.gain
        turned = _turn_information(noise_filter.scale(jacobian), gains, float(phases[0]))
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


def _turn_information(
    jacobian: Array, weights: ComplexArray, phase: float
) -> Callable[[int], Array]:
    """Return a function for the information on sine and cosine of a harmonic, (12, 12).

    `jacobian` contains the slopes of the lengths to the pose over a period, (N, 6, 6), `weights`
    those of the first lines, (K, 6, 6), `phase` that of the first sample, rad. A harmonic
    shifts the few lines of the slopes by its number.
    """
    count = len(jacobian)
    lines = np.fft.fft(jacobian, axis=0) / np.sqrt(count)
    whole = np.zeros((count, *weights.shape[1:]), dtype=np.complex128)
    whole[1 - len(weights) :] = weights[:0:-1].conj()
    whole[: len(weights)] = weights
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
    """States λ, λ̇, λ̈, (R, 18), at the rows of the recording, (R,), with known neighbours."""

    rows: NDArray[np.intp]
    state: Array
    motion: Motion | None = None
    """To which the states belong, if it is taken as known."""


def pointwise_motion(
    robot: Robot, recording: PeriodicRecording, *, cutoff: float | None = None
) -> PointwiseMotion:
    """Return poses by forward kinematics and their differences.

    `cutoff` is that of the zero-phase Butterworth filter (order 4 in both directions), Hz; None: no
    filter.

    Raises
    ------
    MotionFitError
        The stamps jitter, the channels have different delays, or a length has no pose.
    """
    if recording.stamped:
        raise MotionFitError(
            "pointwise differentiation needs uniform time; stamped data need the Fourier fit"
        )
    if not np.allclose(recording.lengths.times, recording.forces.times, rtol=0, atol=1e-9):
        raise MotionFitError(
            "pointwise differentiation cannot shift channels by their delays; use the Fourier fit"
        )
    gap = np.max(np.diff(recording.lengths.times)) if recording.samples > 1 else 0.0
    if gap > _GAP * recording.step:
        raise MotionFitError(
            "pointwise differentiation needs a sample at every step; use the Fourier fit where "
            "some were lost"
        )
    try:
        poses = robot.forward_kinematics(recording.lengths.values)
    except ForwardKinematicsError as error:
        raise MotionFitError(f"no pose has the measured lengths: {error}") from error
    count, wrap = len(poses), recording.averaged
    # A mean period is continued periodically; single samples are not.
    pad = count if wrap else 0
    extended = np.concatenate([poses[count - pad :], poses, poses[:pad]]) if wrap else poses
    if cutoff is not None:
        sections = scipy.signal.butter(_FILTER_ORDER, cutoff, fs=1 / recording.step, output="sos")
        extended = scipy.signal.sosfiltfilt(sections, extended, axis=0)
    rate = (extended[2:] - extended[:-2]) / (2 * recording.step)
    acceleration = (extended[2:] - 2 * extended[1:-1] + extended[:-2]) / recording.step**2
    state = np.concatenate([extended[1:-1], rate, acceleration], axis=1)
    if wrap:
        return PointwiseMotion(np.arange(count), state[pad - 1 : pad - 1 + count])
    rows = np.arange(1, count - 1)
    inner = slice(_EDGE, len(rows) - _EDGE)
    return PointwiseMotion(rows[inner], state[inner])


def signs_along(robot: Robot, sampled: Samples, spread: Array) -> Array:
    """Return the expected signs of the terms' rates, (S, s), along a sampled motion.

    `spread` is their standard deviation, (S, s), as of `rate_spread`; 0 gives the plain signs.
    """
    kernel = prediction.sliding_rate_kernel(robot.terms)
    (rates,) = kernel(sampled.state(), robot.geometry_vector)
    return _mean_signs(rates, spread)


def signs_about(robot: Robot, sampled: Samples, std: float) -> Array:
    """Return the expected signs along a motion if the times have a standard deviation, s."""
    return _mean_signs(*_rates_and_spread(robot, sampled, std))


def _mean_signs(rates: Array, spread: Array) -> Array:
    doubtful = spread > 0
    scaled = np.divide(rates, np.sqrt(2) * spread, out=np.zeros_like(rates), where=doubtful)
    return np.where(doubtful, erf(scaled), np.sign(rates))


_STILL = 5.0
"""Largest rate of a machine at a standstill, in standard deviations."""


def rate_spread(
    robot: Robot, motion: Motion, recording: PeriodicRecording, covariance: MotionCovariance
) -> Array:
    """Return the standard deviations of the same rates, (S, s), from Cov(ξ), (x, x).

    The uncertainty of the forces' delay adds its share: the signs are those of another instant.
    They are infinite, and the expected signs zero, where no rate differs from zero.
    """
    times, late = recording.forces.times, np.hypot(robot.delay_std, recording.jump_spread)
    factor = motion.factor(covariance)
    parts = []
    for part in prediction.chunks(len(times)):
        sampled = motion.at(times[part])
        rates, slope = prediction.sliding_kernel(robot.terms)(
            sampled.state(), robot.geometry_vector
        )
        spread = sampled.spread(slope, factor)
        if late:
            spread = add_time_spread(robot, sampled, spread, late)
        # Lengths show no sign of a friction while the whole machine stands still.
        still = np.all(np.abs(rates) <= _STILL * spread, axis=1)
        parts.append(np.where(still[:, None], np.inf, spread))
    return np.concatenate(parts)


def add_time_spread(robot: Robot, sampled: Samples, spread: Array, std: float) -> Array:
    """Add the share of a standard deviation of the time, s, to those of the rates, (S, s)."""
    return np.hypot(spread, _rates_and_spread(robot, sampled, std)[1])


def _rates_and_spread(robot: Robot, sampled: Samples, std: float) -> tuple[Array, Array]:
    """Return the rates, (S, s), and their standard deviations by that of the time, s."""
    kernel = prediction.sliding_change_kernel(robot.terms)
    rates, changes = kernel(sampled.state(), robot.geometry_vector)
    return rates, np.abs(std * changes)
