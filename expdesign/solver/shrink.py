"""Shrinking a motion about its centre until the unsmoothed model keeps every limit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.problem import DesignProblem
from expdesign.recheck import grid_points, local_worst, states_at
from expdesign.trajectory import FourierTrajectory

SMALLEST_FACTOR = 0.8
_BISECTIONS = 14

GRID_MARGIN = 5e-5
"""Share of each range that is kept free on the fine grid: what it can miss between its points."""


@dataclass(frozen=True)
class Shrunk:
    """A motion and the factor that its amplitudes were multiplied by.

    Attributes
    ----------
    trajectory : FourierTrajectory
    factor : float
        1: not at all.
    kept : bool
        False when even `SMALLEST_FACTOR` breaks a limit.
    """

    trajectory: FourierTrajectory
    factor: float
    kept: bool


def shrink_to_limits(
    problem: DesignProblem, trajectory: FourierTrajectory, margin: float = GRID_MARGIN
) -> Shrunk:
    """Return the largest multiple (≤ 1) of a motion that keeps all limits on the fine grid.

    Parameters
    ----------
    problem : DesignProblem
    trajectory : FourierTrajectory
    margin : float
        Share of each limit's range that is kept free.
    """
    times = trajectory.sample_times(grid_points(problem.cost.samples))
    rows = problem.limits.violations(states_at(trajectory, times))
    if np.all(rows <= -margin):
        return Shrunk(trajectory, 1.0, kept=True)
    # The moments that decide are the worst ones of each row; shrinking moves them little.
    near = times[_decisive(rows)]

    def kept(factor: float) -> bool:
        states = states_at(_scaled(trajectory, factor), near)
        return bool(np.max(problem.limits.violations(states), initial=-np.inf) <= -margin)

    low, high = SMALLEST_FACTOR, 1.0
    if not kept(low):
        return Shrunk(_scaled(trajectory, low), low, kept=False)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if kept(middle) else (low, middle)
    return Shrunk(_scaled(trajectory, low), low, kept=True)


def _decisive(rows: Array) -> NDArray[np.bool_]:
    """Mark the moments at which some row has a local worst that is near its bound, (N,)."""
    peaks = (
        local_worst(rows, periodic=True) & np.isfinite(rows) & (rows > -2 * (1 - SMALLEST_FACTOR))
    )
    spread = peaks | np.roll(peaks, 1, axis=0) | np.roll(peaks, -1, axis=0)
    return np.any(spread | (rows > 0), axis=1)


def _scaled(trajectory: FourierTrajectory, factor: float) -> FourierTrajectory:
    return replace(trajectory, mu=factor * trajectory.mu, nu=factor * trajectory.nu)
