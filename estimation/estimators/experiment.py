"""One experiment as the estimators see it: its samples, its motion and its friction signs."""

from __future__ import annotations

from dataclasses import dataclass, replace

from constraints.arrays import Array
from estimation.kinematics.fourier_fit import MotionFit
from estimation.kinematics.pointwise import PointwiseMotion, expected_signs, rate_spread
from estimation.measurement_model import HarmonicMotion
from estimation.measurement_model.prediction import held_regressor_kernel
from estimation.processing import NoiseModel, PeriodicRecording
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.robot import Robot


@dataclass(frozen=True, eq=False)
class RefinedMotion:
    """A motion with harmonics that forces and lengths show together, and the lengths alone do not.

    LS and GM do without them: what the noise of the lengths hides would cost them more than it
    tells.
    """

    motion: HarmonicMotion
    covariance: Array
    """(x, x), of its unknowns."""
    spread: Array
    """(S, s), standard deviations of the rates of friction at the force samples."""


@dataclass(frozen=True, eq=False)
class Experiment:
    """Measured forces with the motion that was estimated from the lengths."""

    record: PeriodicRecording
    noise: NoiseModel
    fit: MotionFit | None
    """None after pointwise differentiation."""
    spread: Array | None
    """(S, s), standard deviations of the rates of friction at the force samples."""
    fitted_regressors: Array
    """(R, 6, m), A at the samples, along the motion that was estimated from the lengths."""
    pointwise: PointwiseMotion | None = None
    whole: RefinedMotion | None = None
    """Where the forces show more harmonics than the lengths."""

    @classmethod
    def from_fit(
        cls, robot: Robot, record: PeriodicRecording, noise: NoiseModel, fit: MotionFit
    ) -> Experiment:
        """Build from a fitted motion."""
        spread = rate_spread(robot, fit.motion, record.forces.times, fit.covariance)
        return cls.along(robot, record, noise, fit, spread)

    @classmethod
    def along(
        cls,
        robot: Robot,
        record: PeriodicRecording,
        noise: NoiseModel,
        fit: MotionFit,
        spread: Array,
    ) -> Experiment:
        """Build from a motion whose rates have the spread given: zero for a known motion."""
        signs = expected_signs(robot, fit.motion, record.forces.times, spread)
        regressors = regressors_along(robot, fit.motion, record.forces.times, signs)
        return cls(record, noise, fit, spread, regressors)

    @classmethod
    def from_points(
        cls, robot: Robot, record: PeriodicRecording, noise: NoiseModel, motion: PointwiseMotion
    ) -> Experiment:
        """Build from pointwise kinematics."""
        return cls(record, noise, None, None, regressors_at(robot, motion), motion)

    def of_robot(self, robot: Robot) -> Experiment:
        """Return the experiment with A of another robot along the same motion."""
        if self.pointwise is not None:
            return replace(self, fitted_regressors=regressors_at(robot, self.pointwise))
        if self.fit is None:
            raise ValueError("an experiment has a fitted or a pointwise motion")
        return replace(self, fitted_regressors=self.regressors(robot, self.fit.motion))

    def with_terms_of(self, robot: Robot) -> Experiment:
        """Return the experiment with A of a robot of other terms, along the same motion.

        Its friction may have other rates, whose standard deviations follow from the same fit.
        """
        fit, whole, times = self.fit, self.whole, self.record.forces.times
        if fit is None:
            return self.of_robot(robot)
        if whole is not None:
            spread = rate_spread(robot, whole.motion, times, whole.covariance)
            whole = replace(whole, spread=spread)
        spread = rate_spread(robot, fit.motion, times, fit.covariance)
        return replace(self, spread=spread, whole=whole).of_robot(robot)

    @property
    def harmonics(self) -> int | None:
        """Of the motion that ML estimates; None after pointwise differentiation."""
        return None if self.fit is None else self.motion.harmonics

    @property
    def harmonics_left_out(self) -> int:
        """Harmonics that the forces show, without which LS and GM do."""
        if self.whole is None or self.fit is None:
            return 0
        return self.whole.motion.harmonics - self.fit.motion.harmonics

    @property
    def motion(self) -> HarmonicMotion:
        """The motion as far as it is known: ML begins from it.

        Raises
        ------
        ValueError
            The experiment has pointwise kinematics.
        """
        if self.fit is None:
            raise ValueError("pointwise kinematics are no series")
        return self.fit.motion if self.whole is None else self.whole.motion

    def select_rows(self, values: Array) -> Array:
        """Return those of the record's values, (S, …), whose motion is known: (R, …)."""
        return values if self.pointwise is None else values[self.pointwise.rows]

    @property
    def forces(self) -> Array:
        """(R, 6) measured forces at the samples whose motion is known, N."""
        return self.select_rows(self.record.forces.values)

    @property
    def counts(self) -> Array:
        """(R,) how many single samples each row is the mean of."""
        return self.select_rows(self.record.forces.counts)

    @property
    def times(self) -> Array:
        """(R,) s."""
        return self.select_rows(self.record.forces.times)

    def signs(self, robot: Robot, motion: HarmonicMotion) -> Array:
        """Return the expected friction signs along a motion, (S, s)."""
        times = self.record.forces.times
        return expected_signs(robot, motion, times, self.spread_along(motion))

    def spread_along(self, motion: HarmonicMotion) -> Array:
        """Return the standard deviations of the rates of friction along a motion, (S, s)."""
        if self.spread is None:
            raise ValueError("pointwise kinematics have no spread of their rates")
        whole = self._whole_as(motion)
        return self.spread if whole is None else whole.spread

    def signs_for_robot(self, robot: Robot, motion: HarmonicMotion) -> Array:
        """Return the expected signs that the terms of another robot use, (S, s)."""
        if self.fit is None:
            raise ValueError("pointwise kinematics have no spread of their rates")
        whole, times = self._whole_as(motion), self.record.forces.times
        covariance = self.fit.covariance if whole is None else whole.covariance
        spread = rate_spread(robot, motion, times, covariance)
        return expected_signs(robot, motion, times, spread)

    def _whole_as(self, motion: HarmonicMotion) -> RefinedMotion | None:
        """Return the whole motion if this one has its harmonics."""
        whole = self.whole
        return whole if whole and motion.harmonics == whole.motion.harmonics else None

    def regressors(self, robot: Robot, motion: HarmonicMotion) -> Array:
        """Return A at the force samples along a motion, (S, 6, m)."""
        return regressors_along(robot, motion, self.record.forces.times, self.signs(robot, motion))


def regressors_at(robot: Robot, motion: PointwiseMotion) -> Array:
    """Return A along a pointwise motion, (R, 6, m), with the exact signs of friction."""
    state = motion.state.reshape(-1, 3, COORDINATES)
    return robot.regressor(state[:, 0], state[:, 1], state[:, 2])


def regressors_along(robot: Robot, motion: HarmonicMotion, times: Array, signs: Array) -> Array:
    """Return A at the times given, s, (S, 6, m), with the friction signs given, (S, s)."""
    kernel = held_regressor_kernel(robot.terms)
    (regressors,) = kernel(motion.at(times).state(), signs, robot.machine)
    return regressors
