"""Input of the estimators from one experiment: samples, motion and friction signs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from constraints.arrays import Array, Mask
from estimation.kinematics import MotionFit, PointwiseMotion, expected_signs, rate_spread
from estimation.measurement_model import Motion
from estimation.measurement_model.prediction import held_regressor_kernel
from estimation.processing import NoiseEstimate, NoiseModel, PeriodicRecording, PeriodSource
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.robot import Robot
from expdesign.robot.deviation import force_jumps

KNOWN = 0.5
"""Least certainty of a sample whose residual is noise."""
UNSURE = 1e-3
"""Variance of a friction sign below which its effect on the forces is negligible."""


@dataclass(frozen=True, eq=False)
class MotionEstimate:
    """Motion with another number of harmonics than the fitted one, or another spline."""

    motion: Motion
    covariance: Array
    """(x, x), covariance of its unknowns."""
    spread: Array
    """(S, s), standard deviations of the rates of friction at the force samples."""

    @classmethod
    def of(
        cls, robot: Robot, recording: PeriodicRecording, motion: Motion, covariance: Array
    ) -> MotionEstimate:
        """Return a motion with the spread of its rates in a recording."""
        return cls(motion, covariance, rate_spread(robot, motion, recording, covariance))


@dataclass(frozen=True, eq=False)
class Experiment:
    """Measured forces and the motion estimated from the measured lengths."""

    recording: PeriodicRecording
    noise: NoiseModel
    fit: MotionFit | None
    """None after pointwise differentiation."""
    spread: Array | None
    """(S, s), standard deviations of the rates of friction at the force samples."""
    fitted_regressors: Array
    """(R, 6, m), A at the samples, along the motion that was estimated from the lengths."""
    certainty: Array
    """(S,), share of the noise in the variance of noise and unknown signs of friction."""
    pointwise: PointwiseMotion | None = None
    refined_motion: MotionEstimate | None = None
    """Motion of ML: a spline, or with the harmonics that only forces and lengths together
    determine; None if the forces show no more than the lengths."""
    settled: bool = True
    """Whether motion and noise of a recording without a period agree."""
    linear_motion: MotionEstimate | None = None
    """Motion of LS and GM without the harmonics that tolerances can raise and the lengths do not
    show; None if there are none. Estimated from the lengths alone, they would add their noise to
    the regressors, more of it in accelerations the higher they are: with 40 harmonics it can be
    larger than the motion."""
    linear_noise: NoiseEstimate | None = None
    """Noise by which GM weights the forces, with the error of the motion; None: that of them."""

    @classmethod
    def from_fit(
        cls, robot: Robot, recording: PeriodicRecording, noise: NoiseModel, fit: MotionFit
    ) -> Experiment:
        """Build an experiment from a fitted motion."""
        spread = rate_spread(robot, fit.motion, recording, fit.covariance)
        return cls.along(robot, recording, noise, fit, spread)

    @classmethod
    def along(
        cls,
        robot: Robot,
        recording: PeriodicRecording,
        noise: NoiseModel,
        fit: MotionFit,
        spread: Array,
    ) -> Experiment:
        """Build an experiment from a motion and the spread of its rates (zero: a known motion)."""
        signs = expected_signs(robot, fit.motion, recording.forces.times, spread)
        regressors = regressors_along(robot, fit.motion, recording.forces.times, signs)
        return cls(recording, noise, fit, spread, regressors, np.ones(len(signs)))

    @classmethod
    def from_points(
        cls, robot: Robot, recording: PeriodicRecording, noise: NoiseModel, motion: PointwiseMotion
    ) -> Experiment:
        """Build an experiment from pointwise kinematics."""
        certainty = np.ones(len(recording.forces.times))
        return cls(recording, noise, None, None, regressors_at(robot, motion), certainty, motion)

    def with_known_motion(self, robot: Robot, motion: Motion) -> Experiment:
        """Return the experiment with states and regressors of a motion, taken as known.

        Samples with uncertain signs are left out, unless a filter weights them.
        """
        times, known = self.recording.forces.times, np.ones(len(self.certainty), dtype=bool)
        if self.noise.forces.filter is None:
            known = self.certainty > KNOWN
        rows = np.flatnonzero(known)
        return replace(
            self,
            fit=None,
            linear_motion=None,
            spread=None,
            pointwise=PointwiseMotion(rows, motion.at(times).state()[rows], motion),
            fitted_regressors=self.regressors(robot, motion)[rows],
        )

    def of_robot(self, robot: Robot) -> Experiment:
        """Return the experiment with the regressors A of another robot along the same motion."""
        if self.pointwise is not None:
            return replace(self, fitted_regressors=regressors_at(robot, self.pointwise))
        return replace(self, fitted_regressors=self.regressors(robot, self.motion_of_regressors))

    def with_terms_of(self, robot: Robot) -> Experiment:
        """Return the experiment with the regressors A of a robot that has other terms.

        The motion stays. The friction of the new terms may depend on other rates; their standard
        deviations follow from the same fit.
        """
        fit = self.fit
        if fit is None:
            return self.of_robot(robot)

        def of_terms(known: MotionEstimate | None) -> MotionEstimate | None:
            if known is None:
                return None
            return MotionEstimate.of(robot, self.recording, known.motion, known.covariance)

        return replace(
            self,
            spread=rate_spread(robot, fit.motion, self.recording, fit.covariance),
            refined_motion=of_terms(self.refined_motion),
            linear_motion=of_terms(self.linear_motion),
        ).of_robot(robot)

    def along_fit(self, robot: Robot, fit: MotionFit) -> Experiment:
        """Return the experiment along another fit; the present one is the refined motion."""
        if self.spread is None:
            raise ValueError("pointwise kinematics have no fit")
        refined = MotionEstimate(self.fitted.motion, self.fitted.covariance, self.spread)
        spread = rate_spread(robot, fit.motion, self.recording, fit.covariance)
        changed = replace(self, fit=fit, spread=spread, refined_motion=refined)
        return changed.of_robot(robot)

    def with_linear_motion(self, robot: Robot, fit: MotionFit) -> Experiment:
        """Return the experiment with another fit as the motion of LS and GM."""
        linear = MotionEstimate.of(robot, self.recording, fit.motion, fit.covariance)
        return replace(self, linear_motion=linear).of_robot(robot)

    def without_lacking_terms(self, robot: Robot) -> Experiment:
        """Return the experiment without the forces of the robot's `lacking_parameters`."""
        if self.fit is None or not any(robot.lacking_parameters):
            return self
        extended, own = robot.extended, len(robot.parameters)
        times, motion = self.recording.forces.times, self.fit.motion
        signs = self.signs_for_robot(extended, motion)
        columns = regressors_along(extended, motion, times, signs)[:, :, own:]
        lacking, forces = columns @ extended.parameters[own:], self.recording.forces
        forces = replace(
            forces,
            values=forces.values - lacking,
            periods=None if forces.periods is None else forces.periods - lacking,
            repeats=None if forces.repeats is None else forces.repeats - lacking,
        )
        return replace(self, recording=replace(self.recording, forces=forces))

    @property
    def fitted(self) -> MotionFit:
        """The fitted motion.

        Raises
        ------
        ValueError
            The experiment has pointwise kinematics.
        """
        if self.fit is None:
            raise ValueError("pointwise kinematics have no Fourier series")
        return self.fit

    @property
    def motion_of_regressors(self) -> Motion:
        """Motion along which LS and GM evaluate the regressors."""
        return self.fitted.motion if self.linear_motion is None else self.linear_motion.motion

    @property
    def covariance_of_regressors(self) -> Array:
        """(x, x), covariance of its Fourier coefficients."""
        known = self.fitted if self.linear_motion is None else self.linear_motion
        return known.covariance

    @property
    def harmonics(self) -> int | None:
        """Harmonics of the motion that ML estimates; None after pointwise differentiation."""
        return None if self.fit is None else self.motion.harmonics

    @property
    def harmonics_left_out(self) -> int:
        """Number of harmonics that the forces show and that LS and GM leave out.

        It is zero where tolerances raise harmonics: the effects of the tolerances contain these,
        and more that the forces show.
        """
        if self.refined_motion is None or self.fit is None or self.linear_motion is not None:
            return 0
        return (self.refined_motion.motion.harmonics or 0) - (self.fit.motion.harmonics or 0)

    @property
    def motion(self) -> Motion:
        """Best known motion: the starting point of ML; none after pointwise differentiation."""
        return self.fitted.motion if self.refined_motion is None else self.refined_motion.motion

    def select_rows(self, values: Array) -> Array:
        """Return the rows of the values, (S, …), at which the motion is known: (R, …)."""
        return values if self.pointwise is None else values[self.pointwise.rows]

    @property
    def forces(self) -> Array:
        """(R, 6) measured forces at the samples with a known motion, N."""
        return self.select_rows(self.recording.forces.values)

    @property
    def counts(self) -> Array:
        """(R,) number of single samples averaged in each row."""
        return self.select_rows(self.recording.forces.counts)

    @property
    def effective_counts(self) -> Array:
        """(R,) counts as weights of the rows, less where signs of friction are uncertain."""
        return self.counts * self.select_rows(self.certainty)

    def row_counts(self, weights: NoiseEstimate) -> Array:
        """Return the weights of the rows, (R,), for this noise; its filter may have its own."""
        own = weights.filter is not None and weights.filter.lag is not None
        return self.counts if own else self.effective_counts

    def with_sign_variance(self, robot: Robot, values: Array) -> Experiment:
        """Return the experiment with less weight where signs of friction are uncertain.

        A sample near a reversal may have the wrong expected sign: with twice the dry friction as
        error it would count as many samples. The variance is that of parameters `values`, (m,), in
        the actuator in which it exceeds the noise most. Under coloured noise all weights stay.
        """
        noise, recording = self.noise.forces, self.recording
        if self.fit is None or noise.filter is not None:
            return self
        signs = self.signs(robot, self.motion)
        rows = np.flatnonzero(np.any(1 - signs**2 > UNSURE, axis=1))
        if not len(rows):
            return self
        state = self.motion.at(recording.forces.times[rows]).state()
        jumps, _, _ = force_jumps(robot, state, signs[rows], values)
        variance = np.einsum("sij,sj->si", jumps**2, 1 - signs[rows] ** 2)
        # Rows of one phase in several periods, or of one standstill, have the same sign.
        alike = recording.forces.counts[rows] * (1 if recording.averaged else recording.periods)
        if recording.source is PeriodSource.NONE:
            runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
            alike = np.concatenate([np.full(len(run), float(len(run))) for run in runs])
        ratio = np.max(variance / np.diag(noise.covariance), axis=1) * alike
        certainty = np.ones(len(signs))
        certainty[rows] = 1 / (1 + ratio)
        return replace(self, certainty=certainty)

    def noise_rows(self, residuals: Array) -> Array:
        """Return whitened force residuals, (n, 6), without those of uncertain signs."""
        noise_filter, known = self.noise.forces.filter, self.known_rows
        if noise_filter is not None:
            residuals = noise_filter(residuals)
            known[: noise_filter.lag] = False
        return residuals[known]

    @property
    def known_rows(self) -> Mask:
        """(R,), rows whose residuals are noise: those without uncertain signs."""
        return self.select_rows(self.certainty) > KNOWN

    @property
    def times(self) -> Array:
        """(R,) times of the rows, s."""
        return self.select_rows(self.recording.forces.times)

    def signs(self, robot: Robot, motion: Motion) -> Array:
        """Return the expected friction signs along a motion, (S, s)."""
        times = self.recording.forces.times
        return expected_signs(robot, motion, times, self.spread_along(motion))

    def spread_along(self, motion: Motion) -> Array:
        """Return the standard deviations of the rates of friction along a motion, (S, s)."""
        if self.spread is None:
            raise ValueError("pointwise kinematics have no spread of their rates")
        known = self._matching_motion(motion)
        return self.spread if known is None else known.spread

    def signs_for_robot(self, robot: Robot, motion: Motion) -> Array:
        """Return the expected friction signs for the terms of another robot, (S, s)."""
        known, recording = self._matching_motion(motion), self.recording
        covariance = self.fitted.covariance if known is None else known.covariance
        spread = rate_spread(robot, motion, recording, covariance)
        return expected_signs(robot, motion, recording.forces.times, spread)

    def _matching_motion(self, motion: Motion) -> MotionEstimate | None:
        """Return the motion of ML, or that of LS and GM, with as many harmonics; None: the fit."""
        if motion is self.fitted.motion:
            return None
        others = (self.refined_motion, self.linear_motion)
        same = (each for each in others if each and each.motion.harmonics == motion.harmonics)
        return next(same, None)

    def regressors(self, robot: Robot, motion: Motion) -> Array:
        """Return A at the force samples along a motion, (S, 6, m)."""
        return regressors_along(
            robot, motion, self.recording.forces.times, self.signs(robot, motion)
        )


def regressors_at(robot: Robot, motion: PointwiseMotion) -> Array:
    """Return A along a pointwise motion, (R, 6, m), with the exact signs of friction."""
    state = motion.state.reshape(-1, 3, COORDINATES)
    return robot.regressor(state[:, 0], state[:, 1], state[:, 2])


def regressors_along(robot: Robot, motion: Motion, times: Array, signs: Array) -> Array:
    """Return A at the times given, s, (S, 6, m), with the friction signs given, (S, s)."""
    kernel = held_regressor_kernel(robot.terms)
    (regressors,) = kernel(motion.at(times).state(), signs, robot.machine)
    return regressors
