"""Noise of one sample of the six actuators: normal, with full covariances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import InputError, Problem, RunConfiguration


@dataclass(frozen=True, eq=False)
class SensorNoise:
    """Covariances of the measured forces and lengths; samples are independent of each other.

    Attributes
    ----------
    force_covariance : (6, 6)
        Σ, N².
    length_covariance : (6, 6)
        Δ, m².
    """

    force_covariance: Array
    length_covariance: Array

    @classmethod
    def of(cls, configuration: RunConfiguration) -> SensorNoise:
        """Return the noise of robot and run.

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
        return cls(force, length)

    def forces(self, count: int, rng: np.random.Generator) -> Array:
        """Draw the noise of `count` force samples, (count, 6), N."""
        return _draws(self.force_covariance, count, rng)

    def lengths(self, count: int, rng: np.random.Generator) -> Array:
        """Draw the noise of `count` length samples, (count, 6), m."""
        return _draws(self.length_covariance, count, rng)


def _draws(covariance: Array, count: int, rng: np.random.Generator) -> Array:
    factor = np.linalg.cholesky(covariance)
    return rng.standard_normal((count, len(covariance))) @ factor.T
