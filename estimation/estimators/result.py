"""The result of an estimator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from estimation.measurement_model import HarmonicMotion


@dataclass(frozen=True, eq=False)
class ParameterEstimate:
    """Parameters with their covariance."""

    estimator: str
    """``"ls"``, ``"gm"`` or ``"ml"``."""
    values: Array
    """(m,), SI, in the order of the robot's parameters; fixed ones included."""
    covariance: Array
    """(m, m), of the estimate, all shares together; zero for fixed parameters."""
    covariance_forces: Array
    """(m, m), the part that the noise of the forces (and the prior) makes."""
    covariance_kinematics: Array | None
    """(m, m), the part that the noise of the lengths makes; None where it is not known (pointwise
    differentiation): the covariance is then too small."""
    motions: tuple[HarmonicMotion, ...]
    """The motion of every experiment; estimated anew by ML. Empty for pointwise kinematics."""
    cost: float
    """Weighted sum of squares that was minimised."""
    iterations: int
    converged: bool
    status: str
    seconds: float

    @property
    def std(self) -> Array:
        """(m,) standard deviations."""
        return np.sqrt(np.diag(self.covariance))
