"""An executable motion: segments of the pose in time, one after the other without a break."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from constraints.arrays import Array
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.motion.spline import SplineRamp
from expdesign.trajectory import FourierTrajectory, PoseSamples

PERIODS = "periods"
WHOLE = 1e-6
"""Steps by which a duration may differ from a whole number of them."""


@dataclass(frozen=True, eq=False)
class Periods:
    """A segment of whole periods of a Fourier series."""

    trajectory: FourierTrajectory
    periods: int
    """Their number M."""
    phase: float = 0.0
    """Time on the trajectory's orbit at which the segment begins and ends, s."""

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
        """Return the third derivative of the pose, (N, 6): m/s³, rad/s³."""
        series = self.trajectory
        orders = series.omega * np.arange(1, series.harmonics + 1)
        angles = np.multiply.outer(self._on_orbit(times), orders)
        mu, nu = series.mu * orders**2, series.nu * orders**2
        return -np.cos(angles) @ mu.T - np.sin(angles) @ nu.T

    def scaled(self, factor: float, home: Array) -> Periods:
        """Return home + F (λ(F t) − home) for the factor F and the pose home, (6,): m, rad."""
        return Periods(self.trajectory.scaled(factor, home), self.periods, self.phase / factor)

    def _on_orbit(self, times: Array) -> Array:
        # Within one period: later ones have exactly the same values.
        return np.mod(np.asarray(times, dtype=float) + self.phase, self.trajectory.period)


Segment = Periods | SplineRamp
"""A part of the motion: ``"ramp in"``, ``"periods"`` or ``"ramp out"``, in its own time."""


@dataclass(frozen=True, eq=False)
class ExecutableMotion:
    """The whole motion, from rest at home to rest at home."""

    segments: tuple[Segment, ...]
    trajectory: FourierTrajectory
    """The designed motion that the periods repeat."""
    periods: int
    """Their number M."""
    phase: float = 0.0
    """Time on the trajectory's orbit at which the periods begin, s."""
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
        k = [segment.name for segment in self.segments].index(PERIODS)
        return float(self.starts[k]), float(self.starts[k + 1])

    def steps(self, step: float) -> tuple[int, ...]:
        """Return how many steps of the controller, whose length in s is given, each segment takes.

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

    def scaled(self, factor: float, home: Array) -> ExecutableMotion:
        """Return the same motion λ smaller and slower: home + F (λ(F t) − home).

        Distances from home are F times as large, rates F² times and accelerations F³ times; it
        takes 1/F times as long.

        Parameters
        ----------
        factor : float
            F, 0 < F ≤ 1.
        home : (6,)
            Pose from which it begins: m, rad.
        """
        return replace(
            self,
            segments=tuple(segment.scaled(factor, home) for segment in self.segments),
            trajectory=self.trajectory.scaled(factor, home),
            phase=self.phase / factor,
        )

    def sample(self, times: ArrayLike) -> PoseSamples:
        """Return pose, rate and acceleration at any times, s; before and after it is at rest."""
        t = np.atleast_1d(np.asarray(times, dtype=float))
        starts = self.starts
        inside = np.clip(t, 0.0, starts[-1])
        last = len(self.segments) - 1
        place = np.clip(np.searchsorted(starts, inside, side="right") - 1, 0, last)
        found = PoseSamples(*(np.empty((len(t), COORDINATES)) for _ in PoseSamples._fields))
        for k, segment in enumerate(self.segments):
            rows = place == k
            if np.any(rows):
                states = segment.sample(inside[rows] - starts[k])
                for part, values in zip(found, states, strict=True):
                    part[rows] = values
        resting = (t < 0) | (t > self.duration)
        found.rate[resting] = found.acceleration[resting] = 0.0
        return found
