"""The periods: the designed motion, repeated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from expdesign.trajectory import FourierTrajectory, PoseSamples

PERIODS = "periods"


@dataclass(frozen=True, eq=False)
class Periods:
    """A segment of whole periods of a Fourier series.

    Attributes
    ----------
    trajectory : FourierTrajectory
    periods : int
        M.
    phase : float
        Time on the trajectory's orbit at which the segment begins and ends, s.
    """

    trajectory: FourierTrajectory
    periods: int
    phase: float = 0.0

    @property
    def name(self) -> str:
        """Name of the segment."""
        return PERIODS

    @property
    def duration(self) -> float:
        """M periods, s."""
        return self.periods * self.trajectory.period

    def sample(self, times: Array) -> PoseSamples:
        """Return pose, rate and acceleration at times from the segment's own start, s."""
        return self.trajectory.sample(self._on_orbit(times))

    def jerk(self, times: Array) -> Array:
        """Return the third derivative of the pose, (N, 6)."""
        return pose_jerk(self.trajectory, self._on_orbit(times))

    def _on_orbit(self, times: Array) -> Array:
        # Within one period: later ones have exactly the same values.
        return np.mod(np.asarray(times, dtype=float) + self.phase, self.trajectory.period)


def pose_jerk(trajectory: FourierTrajectory, times: Array) -> Array:
    """Return the third derivative of the pose, (N, 6): m/s³, rad/s³."""
    orders = trajectory.omega * np.arange(1, trajectory.harmonics + 1)
    angles = np.multiply.outer(np.asarray(times, dtype=float), orders)
    mu, nu = trajectory.mu * orders**2, trajectory.nu * orders**2
    return -np.cos(angles) @ mu.T - np.sin(angles) @ nu.T
