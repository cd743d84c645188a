"""Recordings without a period: motion as a spline, noise from the residuals of the model.

The number of intervals between the knots is that whose splines predict the six lengths best
(Akaike): they have the same smoothness as the pose. The motion itself is the spline of the pose
with these lengths. The forces' noise, with its memory, comes from the residuals of a Gauss–Markov
estimate; its weights follow, and the estimate is repeated.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from constraints.arrays import Array
from estimation.estimators import Experiment, ParameterPriors
from estimation.estimators.experiment import MotionEstimate
from estimation.estimators.joint_equations import PerturbedMachine
from estimation.kinematics import MotionFit, MotionFitError, converge
from estimation.measurement_model import Motion, SplineMotion
from estimation.measurement_model.banded import BandedInverse
from estimation.measurement_model.motion import NormalEquations, root_of_pseudo_inverse
from estimation.measurement_model.spline import SplineSamples
from estimation.processing import NoiseEstimate, PeriodicRecording
from estimation.processing.autoregression import KNOWN, AutoregressiveFilter, autoregressive_noise
from estimation.splines import SmoothChannels, fit_splines, instants_of, smooth_channels
from expdesign.configuration.estimate import SpectrumOrigin
from expdesign.information.fisher import whitening
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.robot import ForwardKinematicsError, Robot

_ROUNDS = 16
_SETTLED = 0.05
"""Mean relative change of the noise's variances in the last round."""
_HALVINGS = 8
"""Of a step that does not lower the cost."""
_FEWEST_KNOWN = 2 * ACTUATORS
_DRAWN = 48
"""Random errors of an estimate."""
_DETERMINED = 1e-10
"""Smallest relevant eigenvalue of the scaled information on the parameters."""


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
    fit = converge(robot, recording, smooth.scatter if noise is None else noise.as_white(), motion)
    if noise is not None:
        return fit, noise
    freedom = len(fit.residuals) - fit.motion.unknowns / fit.residuals.shape[1]
    own = NoiseEstimate(fit.residuals.T @ fit.residuals / freedom, freedom, "residuals")
    return converge(robot, recording, own, fit.motion), own


def _first_motion(robot: Robot, lengths: SmoothChannels) -> SplineMotion:
    """Return the spline of the poses that have the smooth lengths at some instants."""
    splines = lengths.motion
    times = instants_of(splines)
    try:
        poses = robot.forward_kinematics(splines.poses(times))
    except ForwardKinematicsError as error:
        raise MotionFitError(f"no pose has the measured lengths: {error}") from error
    found = fit_splines(times, poses, splines.intervals)
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
    found = _joint_estimate(robot, present, priors, values, origin)
    return replace(found, linear_noise=linear) if linear.includes_model_error else found


def _linear_noise(
    robot: Robot, experiment: Experiment, priors: ParameterPriors, origin: SpectrumOrigin
) -> tuple[Experiment, NoiseEstimate, Array]:
    """Return the experiment with the noise of Gauss–Markov residuals.

    Also its weights for LS and GM, and the parameters, (m,).

    Raises
    ------
    MotionFitError
        The machine hardly moves, or too shortly.
    """
    free, start = priors.free, priors.start
    rest = experiment.forces - experiment.fitted_regressors @ start
    columns = experiment.fitted_regressors[:, :, free]
    present = replace(experiment, linear_noise=None, refined_motion=None, settled=True)
    values = start.copy()
    noise = linear = present.noise.forces
    level = np.inf
    for _ in range(_ROUNDS):
        fitted = present.linear_equations(start, free, linear) + priors.equations(start)
        root = root_of_pseudo_inverse(fitted.matrix, _DETERMINED)
        move = root @ (root.T @ fitted.gradient)
        values[free] = start[free] + move
        if not noise.includes_model_error:
            return present.with_sign_variance(robot, values), noise, values
        present = _weigh_signs(robot, present, noise, values)
        known = present.certainty * _motion_certainty(robot, present, values)
        if np.count_nonzero(known >= KNOWN) < _FEWEST_KNOWN:
            raise MotionFitError(
                "the machine hardly moves, or too shortly: fewer than "
                f"{_FEWEST_KNOWN} samples have a motion and signs of friction that are known well "
                "enough to show the noise of the forces"
            )
        residuals, share = rest - columns @ move, columns @ root
        linear = autoregressive_noise(residuals, share, known, origin, always=True)
        noise = autoregressive_noise(residuals, share, present.certainty, origin)
        before, level = level, _level(linear)
        if abs(level - before) < _SETTLED:
            break
    else:
        present = replace(present, settled=False)
    # All the scatter about the first motion, its error included: a start from the prediction errors
    # would take the forces for too precise, and the first step too far.
    marginal = replace(present.noise, forces=noise.as_white())
    return replace(present, noise=marginal), linear, values


def _weigh_signs(
    robot: Robot, experiment: Experiment, noise: NoiseEstimate, values: Array
) -> Experiment:
    """Return the experiment with white noise and the certainty of its samples.

    A wrong sign is an error of few samples: noise with memory is compared by what of it cannot be
    predicted.
    """
    white = replace(noise.as_white(), covariance=_unpredicted(noise))
    noises, certain = replace(experiment.noise, forces=white), np.ones(len(experiment.certainty))
    return replace(experiment, noise=noises, certainty=certain).with_sign_variance(robot, values)


def _unpredicted(noise: NoiseEstimate) -> Array:
    """Return the covariance of a sample given those before it, (6, 6)."""
    found = noise.filter
    return found.errors if isinstance(found, AutoregressiveFilter) else noise.covariance


def _level(noise: NoiseEstimate) -> float:
    """Return the mean logarithm of the variances of a sample given those before it."""
    return float(np.linalg.slogdet(_unpredicted(noise))[1]) / ACTUATORS


def _motion_certainty(robot: Robot, experiment: Experiment, values: Array) -> Array:
    """Return weights of the samples, (S,), less where the motion is less certain than usual.

    Near the ends of the recording accelerations are known from one side alone.
    """
    fit = experiment.fitted
    found = PerturbedMachine.exact(robot).forces(experiment, fit.motion, values, slice(None))
    if not isinstance(found.sampled, SplineSamples):
        raise TypeError("the motion has no period")
    variance = found.sampled.spread(found.slope, fit.motion.factor(fit.covariance)) ** 2
    ratio = np.max(variance / np.diag(experiment.noise.forces.covariance), axis=1)
    return np.minimum(1.0, (1 + np.median(ratio)) / (1 + ratio))


def _joint_estimate(
    robot: Robot,
    experiment: Experiment,
    priors: ParameterPriors,
    values: Array,
    origin: SpectrumOrigin,
) -> Experiment:
    """Return the experiment with the motion of forces and lengths together, and its noise.

    Noise that is not given is that of the residuals of parameters and motion together. Random
    errors of both, drawn with the covariance of the estimate, show its share of the noise. It is
    taken for white until motion and noise agree: where the motion explains every force, a memory
    would keep the errors of the first motion. The signs of friction are as uncertain as this
    motion: precise forces determine its rates better than the lengths do, and the regressors of a
    wider spread would be those of less friction. The first motion can be far off: steps are
    shortened until they lower the cost.
    """
    machine, recording = PerturbedMachine.exact(robot), experiment.recording
    free, motion = priors.free, experiment.fitted.motion
    count, present = int(np.count_nonzero(free)), experiment

    def equations(motion: Motion, values: Array) -> NormalEquations:
        joint = machine.joint_equations(present.for_estimator("ml"), motion, values, free)
        return joint + priors.equations(values)

    drawn = np.random.default_rng(0).standard_normal((count + motion.unknowns, _DRAWN))
    assumed: SpectrumOrigin = "white"
    level = np.inf
    for _ in range(_ROUNDS):
        joint = equations(motion, values)
        inner = BandedInverse.of(joint.matrix[count:, count:], _DETERMINED)
        reduced = joint.eliminate(count, _DETERMINED)
        least = _DETERMINED * np.diag(joint.matrix.diagonal()[:count])
        root = whitening(reduced.matrix + least).T
        move = root @ (root.T @ reduced.gradient)
        step = np.concatenate([move, reduced.offset - reduced.slope @ move])
        through = reduced.slope @ root
        errors = np.concatenate(
            [root @ drawn[:count], inner.colour(drawn[count:]) - through @ drawn[:count]]
        )
        short = float(step @ joint.gradient) < len(values)
        for halvings in range(_HALVINGS + 1):
            share, next_values = 0.5**halvings * step, values.copy()
            next_values[free] += share[:count]
            next_motion = motion.add_step(share[count:])
            # Near the end the cost is no measure: the signs are constant in the derivatives.
            if short or equations(next_motion, next_values).cost < joint.cost:
                break
        values, motion = next_values, next_motion
        refined = MotionEstimate.of(robot, recording, motion, replace(inner, root=through))
        present = replace(present, refined_motion=refined)
        if present.noise.forces.includes_model_error:
            present = _weigh_signs(robot, present, present.noise.forces, values)
            along = present.for_estimator("ml")
            found = machine.forces(along, motion, values, slice(None))
            own = autoregressive_noise(
                recording.forces.values - found.values,
                found.columns(free).times(errors / np.sqrt(_DRAWN)),
                present.certainty,
                assumed,
            )
            present = replace(present, noise=replace(present.noise, forces=own))
        before, level = level, _level(present.noise.forces)
        if short and abs(level - before) < _SETTLED:
            if assumed == origin:
                return present
            assumed = origin
    return replace(present, settled=False)
