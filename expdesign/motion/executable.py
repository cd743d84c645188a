"""An executable motion: segments of the pose in time, one after the other without a break."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from constraints.arrays import Array
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.trajectory import FourierTrajectory, PoseSamples

PERIODS = "periods"
WHOLE = 1e-6
"""Steps by which a duration may differ from a whole number of them."""


@dataclass(frozen=True, eq=False)
class Periods:
    """A segment of whole periods of a Fourier series.

    Attributes
    ----------
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


class Segment(Protocol):
    """A part of the motion."""

    @property
    def name(self) -> str:
        """``"ramp in"``, ``"periods"`` or ``"ramp out"``."""

    @property
    def duration(self) -> float:
        """How long it takes, s."""

    def sample(self, times: Array) -> PoseSamples:
        """Return pose, rate and acceleration at times from the segment's own start, s."""

    def jerk(self, times: Array) -> Array:
        """Return the third derivative of the pose, (N, 6), at such times: m/s³, rad/s³."""


@dataclass(frozen=True, eq=False)
class ExecutableMotion:
    """The whole motion, from rest at home to rest at home.

    Attributes
    ----------
    trajectory : FourierTrajectory
        The designed motion that the periods repeat.
    periods : int
        M.
    phase : float
        Time on the trajectory's orbit at which the periods begin, s.
    """

    segments: tuple[Segment, ...]
    trajectory: FourierTrajectory
    periods: int
    phase: float = 0.0
    seconds: float = 0.0

    @property
    def starts(self) -> Array:
        """(K + 1,) when each segment begins, and the end of the last, s."""
        return np.concatenate([[0.0], np.cumsum([segment.duration for segment in self.segments])])

    @property
    def duration(self) -> float:
        """Time from rest to rest, s."""
        return float(self.starts[-1])

    @property
    def window(self) -> tuple[float, float]:
        """When the measurement window begins and ends, s: the M periods."""
        starts = self.starts
        for k, segment in enumerate(self.segments):
            if segment.name == PERIODS:
                return float(starts[k]), float(starts[k + 1])
        raise ValueError("the motion has no periods")

    def steps(self, step: float) -> tuple[int, ...]:
        """Return how many controller steps each segment takes.

        Parameters
        ----------
        step : float
            Of the controller, s.

        Raises
        ------
        ValueError
            A segment is not a whole number of steps.
        """
        counts = [segment.duration / step for segment in self.segments]
        for segment, count in zip(self.segments, counts, strict=True):
            if abs(count - round(count)) > WHOLE:
                raise ValueError(f"{segment.name} takes {count:.9g} steps of {step:g} s")
        return tuple(round(count) for count in counts)

    def sample(self, times: ArrayLike) -> PoseSamples:
        """Return pose, rate and acceleration at any times, s; before and after it is at rest."""
        t = np.atleast_1d(np.asarray(times, dtype=float))
        pose, rate, acceleration = (np.empty((len(t), COORDINATES)) for _ in range(3))
        for segment, rows, local in self._places(t):
            states = segment.sample(local)
            pose[rows], rate[rows] = states.pose, states.rate
            acceleration[rows] = states.acceleration
        resting = (t < 0) | (t > self.duration)
        rate[resting] = acceleration[resting] = 0.0
        return PoseSamples(pose, rate, acceleration)

    def jerk(self, times: ArrayLike) -> Array:
        """Return the third derivative of the pose, (N, 6), at any times, s: m/s³, rad/s³.

        It is bounded but jumps from one segment to the next, where the later one counts.
        """
        t = np.atleast_1d(np.asarray(times, dtype=float))
        third = np.empty((len(t), COORDINATES))
        for segment, rows, local in self._places(t):
            third[rows] = segment.jerk(local)
        third[(t < 0) | (t > self.duration)] = 0.0
        return third

    def _places(self, times: Array) -> Iterator[tuple[Segment, NDArray[np.bool_], Array]]:
        """Yield each segment with the rows that fall into it and their times in it."""
        starts = self.starts
        inside = np.clip(times, 0.0, starts[-1])
        place = np.clip(
            np.searchsorted(starts, inside, side="right") - 1, 0, len(self.segments) - 1
        )
        for k, segment in enumerate(self.segments):
            rows = place == k
            if np.any(rows):
                yield segment, rows, inside[rows] - starts[k]
