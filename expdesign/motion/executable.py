"""An executable motion: segments of the pose in time, one after the other without a break."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from expdesign.trajectory import FourierTrajectory, PoseSamples

Array = NDArray[np.float64]


class Segment(Protocol):
    """A part of the motion.

    Attributes
    ----------
    name : str
        ``"rest"``, ``"ramp in"``, ``"periods"``, ``"ramp out"``.
    duration : float
        s.
    """

    @property
    def name(self) -> str:
        """What the segment is."""

    @property
    def duration(self) -> float:
        """How long it takes, s."""

    def sample(self, times: Array) -> PoseSamples:
        """Return pose, rate and acceleration at times from the segment's own start, s."""


@dataclass(frozen=True, eq=False)
class ExecutableMotion:
    """The whole motion, from rest at home to rest at home.

    Attributes
    ----------
    segments : tuple of Segment
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
            if segment.name == "periods":
                return float(starts[k]), float(starts[k + 1])
        raise ValueError("the motion has no periods")

    def sample(self, times: ArrayLike) -> PoseSamples:
        """Return pose, rate and acceleration at any times, s; before and after it is at rest."""
        t = np.atleast_1d(np.asarray(times, dtype=float))
        starts = self.starts
        inside = np.clip(t, 0.0, starts[-1])
        place = np.clip(
            np.searchsorted(starts, inside, side="right") - 1, 0, len(self.segments) - 1
        )
        pose, rate, acceleration = (np.empty((len(t), 6)) for _ in range(3))
        for k, segment in enumerate(self.segments):
            rows = place == k
            if not np.any(rows):
                continue
            states = segment.sample(inside[rows] - starts[k])
            pose[rows], rate[rows] = states.pose, states.rate
            acceleration[rows] = states.acceleration
        resting = (t < 0) | (t > starts[-1])
        rate[resting] = acceleration[resting] = 0.0
        return PoseSamples(pose, rate, acceleration)
