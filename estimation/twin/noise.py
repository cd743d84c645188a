"""Noise of one sample of the six actuators: normal, with full covariances."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import InputError, Problem, RunConfiguration


def noise_covariances(configuration: RunConfiguration) -> tuple[Array, Array]:
    """Return Σ, (6, 6), N², and Δ, (6, 6), m², of robot and run.

    Raises
    ------
    InputError
        They state no noise of the forces, or none of the lengths.
    """
    noise = configuration.robot.noise
    force = None if noise is None else noise.force_covariance
    length = None if noise is None else noise.length_covariance
    problems = [
        Problem(
            f"a simulated experiment needs the noise of the {what}s, and neither robot nor "
            "run state it",
            file=configuration.file,
            key="noise",
            allowed=f"{what}_std (six values) or {what}_covariance (6 × 6)",
        )
        for what, covariance in (("force", force), ("length", length))
        if covariance is None
    ]
    if force is None or length is None:
        raise InputError(problems)
    return force, length


def noise_draws(covariance: Array, count: int, rng: np.random.Generator) -> Array:
    """Draw samples, (count, 6), that are independent of each other."""
    factor = np.linalg.cholesky(covariance)
    return rng.standard_normal((count, len(covariance))) @ factor.T
