"""What LS and GM reach with exact kinematics: their covariances before any experiment."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from estimation.twin import Twin
from expdesign.robot import Robot


def linear_covariances(robot: Robot, twin: Twin) -> dict[str, Array]:
    """Return the covariances of LS and GM by name, (m, m) each, SI.

    Over the samples and periods that the twin executes, at the true motion:
    (ΨᵀΨ)⁻¹ ΨᵀΣΨ (ΨᵀΨ)⁻¹ and F⁻¹ = (Ψᵀ Σ⁻¹ Ψ)⁻¹.
    """
    states = twin.truth.executed.sample(twin.grid.distinct_times)
    regressors = robot.regressor(states.pose, states.rate, states.acceleration)
    repeats = twin.grid.count / len(twin.grid.distinct_times)
    covariance = twin.truth.force_covariance
    flat = regressors.reshape(-1, regressors.shape[2])

    def inner(weights: Array) -> Array:
        return flat.T @ np.matmul(weights, regressors).reshape(flat.shape) * repeats

    def inverse(matrix: Array) -> Array:
        return np.asarray(np.linalg.inv(matrix), dtype=np.float64)

    plain = inverse(inner(np.eye(6)))
    return {
        "ls": plain @ inner(covariance) @ plain,
        "gm": inverse(inner(inverse(covariance))),
    }
