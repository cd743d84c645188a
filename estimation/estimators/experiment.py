"""One experiment as the estimators see it: its samples, its motion and its friction signs."""

from __future__ import annotations

from dataclasses import dataclass, replace

from constraints.arrays import Array
from estimation.kinematics.fourier_fit import MotionFit
from estimation.kinematics.friction_signs import expected_signs, rate_spread
from estimation.kinematics.pointwise import PointwiseMotion
from estimation.measurement_model import HarmonicMotion
from estimation.measurement_model.kernels import held_regressor_kernel
from estimation.processing import NoiseModel, Record
from expdesign.robot import Robot


@dataclass(frozen=True, eq=False)
class Experiment:
    """Measured forces with the motion that was estimated from the lengths.

    Attributes
    ----------
    record : Record
    noise : NoiseModel
    fit : MotionFit or None
        None after pointwise differentiation.
    spread : (S, s) or None
        Standard deviations of the rates of friction at the force samples.
    fitted_regressors : (R, 6, m)
        A at the samples, along the motion that was estimated from the lengths.
    pointwise : PointwiseMotion or None
    """

    record: Record
    noise: NoiseModel
    fit: MotionFit | None
    spread: Array | None
    fitted_regressors: Array
    pointwise: PointwiseMotion | None = None

    @classmethod
    def from_fit(
        cls, robot: Robot, record: Record, noise: NoiseModel, fit: MotionFit
    ) -> Experiment:
        """Build from a fitted motion."""
        return cls.along(robot, record, noise, fit, cls._rate_spread(robot, record, fit))

    @staticmethod
    def _rate_spread(robot: Robot, record: Record, fit: MotionFit) -> Array:
        return rate_spread(
            robot,
            fit.motion,
            record.force_times,
            fit.covariance,
            free_frequency=fit.free_frequency,
        )

    @classmethod
    def along(
        cls, robot: Robot, record: Record, noise: NoiseModel, fit: MotionFit, spread: Array
    ) -> Experiment:
        """Build from a motion whose rates have the spread given: zero for a known motion."""
        signs = expected_signs(robot, fit.motion, record.force_times, spread)
        regressors = regressors_along(robot, fit.motion, record.force_times, signs)
        return cls(record, noise, fit, spread, regressors)

    @classmethod
    def from_points(
        cls, robot: Robot, record: Record, noise: NoiseModel, motion: PointwiseMotion
    ) -> Experiment:
        """Build from pointwise kinematics."""
        state = motion.state
        regressors = robot.regressor(state[:, :6], state[:, 6:12], state[:, 12:])
        return cls(record, noise, None, None, regressors, motion)

    @property
    def forces(self) -> Array:
        """(R, 6) measured forces at the samples whose motion is known, N."""
        rows = slice(None) if self.pointwise is None else self.pointwise.rows
        return self.record.forces[rows]

    @property
    def counts(self) -> Array:
        """(R,) how many single samples each row is the mean of."""
        rows = slice(None) if self.pointwise is None else self.pointwise.rows
        return self.record.force_counts[rows]

    @property
    def times(self) -> Array:
        """(R,) s."""
        rows = slice(None) if self.pointwise is None else self.pointwise.rows
        return self.record.force_times[rows]

    def signs(self, robot: Robot, motion: HarmonicMotion) -> Array:
        """Return the expected friction signs along a motion, (S, s)."""
        if self.spread is None:
            raise ValueError("pointwise kinematics have no spread of their rates")
        return expected_signs(robot, motion, self.record.force_times, self.spread)

    def regressors(self, robot: Robot, motion: HarmonicMotion | None = None) -> Array:
        """Return A at the samples, (R, 6, m), along the fitted or another motion."""
        if motion is None:
            return self.fitted_regressors
        return regressors_along(robot, motion, self.record.force_times, self.signs(robot, motion))

    def with_noise(self, noise: NoiseModel) -> Experiment:
        """Return the experiment weighted by other covariances."""
        return replace(self, noise=noise)


def regressors_along(robot: Robot, motion: HarmonicMotion, times: Array, signs: Array) -> Array:
    """Return A at the times given, s, (S, 6, m), with the friction signs given, (S, s)."""
    state = motion.basis(times).state(motion.table)
    kernel = held_regressor_kernel(robot.terms)
    (regressors,) = kernel(state, signs, robot.machine)
    return regressors
