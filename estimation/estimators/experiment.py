"""One experiment as the estimators see it: its samples, its motion and its friction signs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimation.kinematics.fourier_fit import MotionFit
from estimation.kinematics.friction_signs import expected_signs, rate_spread
from estimation.kinematics.pointwise import PointwiseMotion
from estimation.measurement_model import HarmonicMotion, MotionBasis
from estimation.measurement_model.kernels import held_regressor_kernel
from estimation.processing import NoiseModel, Record
from expdesign.robot import Robot

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Experiment:
    """Measured forces with the motion that was estimated from the lengths.

    Attributes
    ----------
    record : Record
    noise : NoiseModel
    fit : MotionFit or None
        None after pointwise differentiation.
    spread : (S, 18) or None
        Standard deviations of the rates of friction at the force samples.
    pointwise : PointwiseMotion or None
    """

    record: Record
    noise: NoiseModel
    fit: MotionFit | None
    spread: Array | None
    pointwise: PointwiseMotion | None = None

    @classmethod
    def from_fit(
        cls, robot: Robot, record: Record, noise: NoiseModel, fit: MotionFit
    ) -> Experiment:
        """Build from a fitted motion."""
        spread = rate_spread(
            robot,
            fit.motion,
            record.force_times,
            fit.covariance,
            free_frequency=fit.free_frequency,
        )
        return cls(record, noise, fit, spread)

    @classmethod
    def from_points(cls, record: Record, noise: NoiseModel, motion: PointwiseMotion) -> Experiment:
        """Build from pointwise kinematics."""
        return cls(record, noise, None, None, motion)

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
        """Return the expected friction signs along a motion, (S, 18)."""
        if self.spread is None:
            raise ValueError("pointwise kinematics have no spread of their rates")
        return expected_signs(robot, motion, self.record.force_times, self.spread)

    def regressors(self, robot: Robot, motion: HarmonicMotion | None = None) -> Array:
        """Return A at the samples, (R, 6, m), along the fitted or another motion."""
        if self.pointwise is not None:
            state = self.pointwise.state
            return robot.regressor(state[:, :6], state[:, 6:12], state[:, 12:])
        if self.fit is None:
            raise ValueError("an experiment has a fitted or a pointwise motion")
        present = self.fit.motion if motion is None else motion
        basis = MotionBasis.at(self.record.force_times, present.omega, present.harmonics)
        state = basis.state(present.table)
        kernel = held_regressor_kernel(general=robot.general)
        (regressors,) = kernel(state, self.signs(robot, present), robot.geometry_vector)
        return regressors

    def with_noise(self, noise: NoiseModel) -> Experiment:
        """Return the experiment weighted by other covariances."""
        return replace(self, noise=noise)
