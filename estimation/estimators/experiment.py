"""Input of the estimators from one experiment: samples, motion and friction signs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from constraints.arrays import Array, Mask
from estimation.kinematics import MotionFit, PointwiseMotion, rate_spread, signs_along
from estimation.measurement_model import Motion
from estimation.measurement_model.motion import NormalEquations
from estimation.measurement_model.prediction import held_regressor_kernel
from estimation.measurement_model.spline import MotionCovariance
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
    """Motion of a recording with its uncertainty."""

    motion: Motion
    covariance: MotionCovariance
    """(x, x), covariance of its unknowns."""
    spread: Array
    """(S, s), standard deviations of the rates of friction at the force samples."""

    @classmethod
    def of(
        cls,
        robot: Robot,
        recording: PeriodicRecording,
        motion: Motion,
        covariance: MotionCovariance,
    ) -> MotionEstimate:
        """Return a motion with the spread of the rates of a robot's terms."""
        return cls(motion, covariance, rate_spread(robot, motion, recording, covariance))

    def for_robot(self, robot: Robot, recording: PeriodicRecording) -> MotionEstimate:
        """Return the motion with the spread of the rates of another robot's terms."""
        return self.of(robot, recording, self.motion, self.covariance)

    def signs(self, robot: Robot, times: Array) -> Array:
        """Return the expected friction signs at the force samples, (S, s)."""
        return signs_along(robot, self.motion.at(times), self.spread)

    def regressors(self, robot: Robot, times: Array) -> Array:
        """Return A at the force samples, (S, 6, m)."""
        return regressors_along(robot, self.motion, times, self.signs(robot, times))


@dataclass(frozen=True, eq=False)
class Experiment:
    """Measured forces and the motion estimated from the measured lengths."""

    recording: PeriodicRecording
    noise: NoiseModel
    fit: MotionEstimate | None
    """Motion fitted to the lengths, or that of an estimator (`for_estimator`); None after pointwise
    differentiation."""
    fitted_regressors: Array
    """(R, 6, m), A at the samples, along the motion of LS and GM."""
    certainty: Array
    """(S,), share of the noise in the variance of noise and unknown signs of friction."""
    pointwise: PointwiseMotion | None = None
    refined_motion: MotionEstimate | None = None
    """Motion of ML: a spline, or with the harmonics that only forces and lengths together
    determine; None: the fitted one, since the forces show no more than the lengths."""
    settled: bool = True
    """Whether motion and noise of a recording without a period agree."""
    linear_motion: MotionEstimate | None = None
    """Motion of LS and GM without the harmonics that tolerances can raise and the lengths do not
    show; None: the fitted one, since there are none. Estimated from the lengths alone, they would
    add their noise to the regressors, more of it in accelerations the higher they are: with 40
    harmonics it can be larger than the motion."""
    linear_noise: NoiseEstimate | None = None
    """Noise by which GM weights the forces, with the error of the motion; None: that of them."""

    @classmethod
    def from_fit(
        cls, robot: Robot, recording: PeriodicRecording, noise: NoiseModel, fit: MotionFit
    ) -> Experiment:
        """Build an experiment from a fitted motion."""
        known = MotionEstimate.of(robot, recording, fit.motion, fit.covariance)
        return cls.along(robot, recording, noise, known)

    @classmethod
    def along(
        cls, robot: Robot, recording: PeriodicRecording, noise: NoiseModel, fit: MotionEstimate
    ) -> Experiment:
        """Build an experiment from a motion (with a spread of zero: a known one)."""
        times = recording.forces.times
        return cls(recording, noise, fit, fit.regressors(robot, times), np.ones(len(times)))

    @classmethod
    def from_points(
        cls, robot: Robot, recording: PeriodicRecording, noise: NoiseModel, motion: PointwiseMotion
    ) -> Experiment:
        """Build an experiment from pointwise kinematics."""
        certainty = np.ones(len(recording.forces.times))
        return cls(recording, noise, None, regressors_at(robot, motion), certainty, motion)

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
            pointwise=PointwiseMotion(rows, motion.at(times).state()[rows], motion),
            fitted_regressors=self.along_motion(motion).regressors(robot, times)[rows],
        )

    def for_estimator(self, name: str) -> Experiment:
        """Return the experiment along the motion of ``"ls"``, ``"gm"`` or ``"ml"``."""
        if self.fit is None:
            return self
        linear, joint = self.linear, self.joint
        fit = joint if name == "ml" else linear
        return replace(self, fit=fit, linear_motion=linear, refined_motion=joint)

    def of_robot(self, robot: Robot) -> Experiment:
        """Return the experiment with the regressors A of another robot along the same motion."""
        if self.pointwise is not None:
            return replace(self, fitted_regressors=regressors_at(robot, self.pointwise))
        regressors = self.linear.regressors(robot, self.recording.forces.times)
        return replace(self, fitted_regressors=regressors)

    def with_terms_of(self, robot: Robot) -> Experiment:
        """Return the experiment with the regressors A of a robot that has other terms.

        The motion stays. The friction of the new terms may depend on other rates; their standard
        deviations follow from the same fit.
        """
        fit, refined, linear = (
            known and known.for_robot(robot, self.recording)
            for known in (self.fit, self.refined_motion, self.linear_motion)
        )
        changed = replace(self, fit=fit, refined_motion=refined, linear_motion=linear)
        return changed.of_robot(robot)

    def without_lacking_terms(self, robot: Robot) -> Experiment:
        """Return the experiment without the forces of the robot's `lacking_parameters`."""
        if self.fit is None or not any(robot.lacking_parameters):
            return self
        extended, own = robot.extended, len(robot.parameters)
        known, forces = self.fit.for_robot(extended, self.recording), self.recording.forces
        columns = known.regressors(extended, forces.times)[:, :, own:]
        lacking = columns @ extended.parameters[own:]
        forces = replace(
            forces,
            values=forces.values - lacking,
            periods=None if forces.periods is None else forces.periods - lacking,
            repeats=None if forces.repeats is None else forces.repeats - lacking,
        )
        return replace(self, recording=replace(self.recording, forces=forces))

    @property
    def fitted(self) -> MotionEstimate:
        """The fitted motion, or that of an estimator.

        Raises
        ------
        ValueError
            The experiment has pointwise kinematics.
        """
        if self.fit is None:
            raise ValueError("pointwise kinematics have no Fourier series")
        return self.fit

    @property
    def linear(self) -> MotionEstimate:
        """Motion of LS and GM."""
        return self.linear_motion or self.fitted

    @property
    def joint(self) -> MotionEstimate:
        """Motion at which ML begins, the best known one."""
        return self.refined_motion or self.fitted

    @property
    def harmonics(self) -> int | None:
        """Harmonics of the motion that ML estimates; None after pointwise differentiation."""
        return None if self.fit is None else self.joint.motion.harmonics

    @property
    def harmonics_left_out(self) -> int:
        """Number of harmonics that the forces show and that LS and GM leave out.

        It is zero where tolerances raise harmonics: the effects of the tolerances contain these,
        and more that the forces show.
        """
        if self.fit is None or self.linear_motion is not None:
            return 0
        return (self.harmonics or 0) - (self.fit.motion.harmonics or 0)

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

    def linear_equations(self, start: Array, free: Mask, weights: NoiseEstimate) -> NormalEquations:
        """Return the normal equations of the free parameters at start values, (m,).

        The motion, that of LS and GM, is held.
        """
        rest = self.forces - self.fitted_regressors @ start
        rows = rest, self.fitted_regressors[:, :, free], self.row_counts(weights)
        return NormalEquations.of([rows], weights.covariance, weights.filter)

    def with_sign_variance(self, robot: Robot, values: Array) -> Experiment:
        """Return the experiment with less weight where signs of friction are uncertain.

        A sample near a reversal may have the wrong expected sign: with twice the dry friction as
        error it would count as many samples. The variance is that of parameters `values`, (m,), in
        the actuator in which it exceeds the noise most. Under coloured noise all weights stay.
        """
        noise, recording = self.noise.forces, self.recording
        if self.fit is None or noise.filter is not None:
            return self
        signs = self.joint.signs(robot, recording.forces.times)
        rows = np.flatnonzero(np.any(1 - signs**2 > UNSURE, axis=1))
        if not len(rows):
            return self
        state = self.joint.motion.at(recording.forces.times[rows]).state()
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

    def along_motion(self, motion: Motion) -> MotionEstimate:
        """Return another motion with the uncertainty of the fitted one, such as an estimate."""
        return replace(self.fitted, motion=motion)


def regressors_at(robot: Robot, motion: PointwiseMotion) -> Array:
    """Return A along a pointwise motion, (R, 6, m), with the exact signs of friction."""
    state = motion.state.reshape(-1, 3, COORDINATES)
    return robot.regressor(state[:, 0], state[:, 1], state[:, 2])


def regressors_along(robot: Robot, motion: Motion, times: Array, signs: Array) -> Array:
    """Return A at the times given, s, (S, 6, m), with the friction signs given, (S, s)."""
    kernel = held_regressor_kernel(robot.terms)
    (regressors,) = kernel(motion.at(times).state(), signs, robot.machine)
    return regressors
