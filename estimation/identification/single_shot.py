"""Recordings without a period: motion as a spline, noise from the residuals of the model.

The number of intervals between the knots is that whose splines predict the six lengths best
(Akaike): they have the same smoothness as the pose. The motion itself is the spline of the pose
with these lengths. The forces' noise, with its memory, comes from the residuals of a Gauss–Markov
estimate; its weights follow, and the estimate is repeated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as sla
from scipy import sparse

from constraints.arrays import Array
from estimation.estimators import Experiment, ParameterPriors
from estimation.estimators.joint_equations import PerturbedMachine
from estimation.kinematics import MotionFit, MotionFitError, converge
from estimation.measurement_model import SplineMotion
from estimation.measurement_model.motion import NormalEquations, root_of_pseudo_inverse
from estimation.measurement_model.spline import DEGREE, SplineSamples
from estimation.processing import NoiseEstimate, NoiseModel, PeriodicRecording
from estimation.processing.autoregression import autoregressive_noise
from expdesign.configuration.estimate import SpectrumOrigin
from expdesign.robot import ForwardKinematicsError, Robot

_FEWEST, _MOST = 4, 500
"""Intervals."""
_RATIO = 1.2
"""Of successive numbers of intervals that are tried."""
_PER_INTERVAL = 4
"""Fewest samples of an interval."""
_POINTS = 3
"""Poses of an interval from which the fit starts."""
_ROUNDS, _JOINT_ROUNDS = 4, 6
_DRAWN = 48
"""Random errors of an estimate."""
_DETERMINED = 1e-10
"""Smallest relevant eigenvalue of the scaled information on the parameters."""


def spline_experiment(robot: Robot, recording: PeriodicRecording, noise: NoiseModel) -> Experiment:
    """Return a recording without a period along its spline; an unknown Δ is that of the fit.

    Raises
    ------
    MotionFitError
        The recording is too short, or no motion has these lengths.
    """
    known = None if noise.lengths.includes_model_error else noise.lengths
    fit, lengths = fit_spline(robot, recording, known)
    experiment = Experiment.from_fit(robot, recording, replace(noise, lengths=lengths), fit)
    return experiment.without_lacking_terms(robot)


def fit_spline(
    robot: Robot, recording: PeriodicRecording, noise: NoiseEstimate | None = None
) -> tuple[MotionFit, NoiseEstimate]:
    """Fit a spline of the pose to the measured lengths; without their noise, estimate it, too.

    Raises
    ------
    MotionFitError
        The recording is too short, or no motion has these lengths.
    """
    smooth = smooth_channels(recording.lengths.times, recording.lengths.values)
    motion = _first_motion(robot, smooth)
    covariance = smooth.scatter.covariance if noise is None else noise.covariance
    fit = converge(robot, recording, covariance, motion)
    if noise is not None:
        return fit, noise
    freedom = len(fit.residuals) - len(fit.covariance) / fit.residuals.shape[1]
    own = NoiseEstimate(fit.residuals.T @ fit.residuals / freedom, freedom, "residuals")
    return converge(robot, recording, own.covariance, fit.motion), own


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
        found = _smooth(times, values, int(intervals))
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


def _smooth(times: Array, values: Array, intervals: int) -> SmoothChannels | None:
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


def _first_motion(robot: Robot, lengths: SmoothChannels) -> SplineMotion:
    """Return the spline of the poses that have the smooth lengths at some instants."""
    splines = lengths.motion
    instants = np.linspace(0, splines.intervals, _POINTS * (splines.intervals + DEGREE))
    times = splines.start + splines.spacing * instants
    try:
        poses = robot.forward_kinematics(splines.poses(times))
    except ForwardKinematicsError as error:
        raise MotionFitError(f"no pose has the measured lengths: {error}") from error
    found = _smooth(times, poses, splines.intervals)
    if found is None:
        raise MotionFitError("the lengths do not determine the motion")
    return found.motion


def estimate_noise(
    robot: Robot, experiment: Experiment, priors: ParameterPriors, origin: SpectrumOrigin
) -> Experiment:
    """Return the experiment with the noise of its forces and the weights of its samples.

    A given noise is kept. The residuals along the fitted motion contain its error as well: LS and
    GM are weighted with all of it, while the noise is that of the joint estimate.
    """
    present, linear, values = _linear_noise(robot, experiment, priors, origin)
    if not present.noise.forces.includes_model_error:
        return present
    return replace(_joint_noise(robot, present, priors, values, origin), linear_noise=linear)


def _linear_noise(
    robot: Robot, experiment: Experiment, priors: ParameterPriors, origin: SpectrumOrigin
) -> tuple[Experiment, NoiseEstimate, Array]:
    """Return the experiment with the noise of Gauss–Markov residuals.

    Also its weights for LS and GM, and the parameters, (m,).
    """
    free, start = priors.free, priors.start
    rest = experiment.forces - experiment.fitted_regressors @ start
    columns = experiment.fitted_regressors[:, :, free]
    present, values = replace(experiment, linear_noise=None), start.copy()
    noise = linear = present.noise.forces
    for _ in range(_ROUNDS):
        rows = (rest, columns, present.row_counts(linear))
        fitted = NormalEquations.of([rows], linear.covariance, linear.filter)
        fitted = fitted + priors.equations(start)
        root = root_of_pseudo_inverse(fitted.matrix, _DETERMINED)
        move = root @ (root.T @ fitted.gradient)
        values[free] = start[free] + move
        if not noise.includes_model_error:
            return present.with_sign_variance(robot, values), noise, values
        white = replace(present, noise=replace(present.noise, forces=noise.as_white()))
        present = replace(white, certainty=None).with_sign_variance(robot, values)
        known = present.certainties * _motion_certainty(robot, present, values)
        residuals, share = rest - columns @ move, columns @ root
        linear = autoregressive_noise(residuals, share, known, origin, always=True)
        noise = autoregressive_noise(residuals, share, present.certainties, origin)
    return replace(present, noise=replace(present.noise, forces=noise)), linear, values


def _motion_certainty(robot: Robot, experiment: Experiment, values: Array) -> Array:
    """Return weights of the samples, (S,), less where the motion is less certain than usual.

    Near the ends of the recording accelerations are known from one side alone.
    """
    fit = experiment.fitted
    found = PerturbedMachine.exact(robot).forces(experiment, fit.motion, values, slice(None))
    if not isinstance(found.sampled, SplineSamples):
        raise TypeError("the motion has no period")
    variance = found.sampled.spread(found.slope, fit.covariance) ** 2
    ratio = np.max(variance / np.diag(experiment.noise.forces.covariance), axis=1)
    return np.minimum(1.0, (1 + np.median(ratio)) / (1 + ratio))


def _joint_noise(
    robot: Robot,
    experiment: Experiment,
    priors: ParameterPriors,
    values: Array,
    origin: SpectrumOrigin,
) -> Experiment:
    """Return the experiment with the noise of the residuals of parameters and motion together.

    Random errors of both, drawn with the covariance of the estimate, show its share of the noise.
    """
    machine, motion = PerturbedMachine.exact(robot), experiment.fitted.motion
    whole, free = slice(None), priors.free
    count = int(np.count_nonzero(free))
    present = experiment
    drawn = np.random.default_rng(0).standard_normal((count + motion.unknowns, _DRAWN))
    for _ in range(_JOINT_ROUNDS):
        joint = machine.joint_equations(present, motion, values, free) + priors.equations(values)
        scale = np.sqrt(np.diag(joint.matrix))
        scaled = joint.matrix / np.multiply.outer(scale, scale)
        factor = np.linalg.cholesky(scaled + _DETERMINED * np.eye(len(scale)))
        step = sla.cho_solve((factor, True), joint.gradient / scale) / scale
        errors = sla.solve_triangular(factor, drawn, trans="T", lower=True) / scale[:, None]
        values = values.copy()
        values[free] += step[:count]
        motion = motion.add_step(step[count:])
        found = machine.forces(present, motion, values, whole)
        own = autoregressive_noise(
            present.recording.forces.values - found.values,
            found.columns(free).times(errors / np.sqrt(_DRAWN)),
            present.certainties,
            origin,
        )
        present = replace(present, noise=replace(present.noise, forces=own))
    return present
