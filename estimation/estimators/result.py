"""The result of an estimator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from estimation.measurement_model import HarmonicMotion


@dataclass(frozen=True, eq=False)
class ParameterEstimate:
    """Parameters with their covariance.

    Attributes
    ----------
    estimator : str
        ``"ls"``, ``"gm"`` or ``"ml"``.
    values : (m,)
        SI, in the order of the robot's parameters; fixed ones included.
    covariance : (m, m)
        Of the estimate, all shares together; zero for fixed parameters.
    covariance_forces : (m, m)
        The part that the noise of the forces (and the prior) makes.
    covariance_kinematics : (m, m) or None
        The part that the noise of the lengths makes; None where it is not known (pointwise
        differentiation): the covariance is then too small.
    motions : tuple of HarmonicMotion
        The motion of every experiment; estimated anew by ML. Empty for pointwise kinematics.
    cost : float
        Weighted sum of squares that was minimised.
    """

    estimator: str
    values: Array
    covariance: Array
    covariance_forces: Array
    covariance_kinematics: Array | None
    motions: tuple[HarmonicMotion, ...]
    cost: float
    iterations: int
    converged: bool
    status: str
    seconds: float

    @property
    def std(self) -> Array:
        """(m,) standard deviations."""
        return np.sqrt(np.diag(self.covariance))
