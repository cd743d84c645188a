"""The recheck of a motion: every limit at every time, independent of the optimiser."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from expdesign.recheck.judge import ZOOM_POINTS, ZOOMS, judge, states_at
from expdesign.recheck.limit_check import TOLERANCE, LimitCheck
from expdesign.robot import LimitModel
from expdesign.trajectory import FourierTrajectory

FINER = 20
"""The grid has at least this many points for every sample of the design."""
LEAST_POINTS = 4000


@dataclass(frozen=True)
class Recheck:
    """All limits of one motion.

    Attributes
    ----------
    limits : tuple of LimitCheck
    points : int
        Points of the grid.
    span : str
        What the grid covers, in words.
    """

    limits: tuple[LimitCheck, ...]
    points: int
    span: str = "one period"

    @property
    def worst(self) -> float:
        """Largest violation as a share of its limit's range; −inf without limits."""
        return max((check.violation for check in self.limits), default=-np.inf)

    @property
    def passed(self) -> bool:
        """True when every limit is kept within `TOLERANCE` of its range."""
        return self.worst <= TOLERANCE

    @property
    def method(self) -> str:
        """How the limits were checked, in words."""
        return (
            f"unsmoothed model on {self.points} points of {self.span}, every possible worst "
            f"moment refined {(ZOOM_POINTS - 1) // 2}-fold {ZOOMS} times; sampled, no proof "
            "between the points"
        )


def grid_points(samples: int) -> int:
    """Return the number of points on which a design of `samples` samples is checked."""
    return max(LEAST_POINTS, FINER * samples)


def recheck(limits: LimitModel, trajectory: FourierTrajectory, samples: int) -> Recheck:
    """Judge every limit on a grid at least 20 times finer than the design's samples.

    Every moment that could be a limit's worst is then searched again on ever finer grids around
    it, so that neither a maximum between the points nor a jump of dry friction is missed. Two
    changes of a rate's sign within one step of the grid are not seen.
    """
    points = grid_points(samples)
    times = trajectory.sample_times(points)
    between = partial(states_at, trajectory)
    checks = judge(limits, times, between(times), between, periodic=True)
    period = trajectory.period
    return Recheck(tuple(replace(check, time=check.time % period) for check in checks), points)
