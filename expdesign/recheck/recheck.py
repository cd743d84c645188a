"""The recheck of a trajectory: every limit over the whole period, independent of the optimiser."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from expdesign.robot import ExactModel
from expdesign.trajectory import FourierTrajectory

Array = NDArray[np.float64]

FINER = 20
"""The grid has at least this many points for every sample of the design."""
LEAST_POINTS = 4000
_ZOOMS = 4
_ZOOM_POINTS = 33

TOLERANCE = 1e-6
"""Largest excess over a bound, as a share of the limit's range, that counts as kept."""


@dataclass(frozen=True)
class LimitCheck:
    """The worst moment of one limit.

    Attributes
    ----------
    key, title, unit, origin : str
        The limit and where it was given.
    row : str
        Component, strut or pair of struts.
    value, bound : float
        Worst value and the bound that it comes closest to (or breaks), SI.
    violation : float
        Excess over the bound as a share of the limit's range; negative: what is left.
    time : float
        When, s from the period's start.
    """

    key: str
    title: str
    unit: str
    origin: str
    row: str
    value: float
    bound: float
    violation: float
    time: float


@dataclass(frozen=True)
class Recheck:
    """All limits of one trajectory.

    Attributes
    ----------
    limits : tuple of LimitCheck
    points : int
        Points of the grid over one period.
    """

    limits: tuple[LimitCheck, ...]
    points: int

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
            f"unsmoothed model on {self.points} points of one period, each limit's worst moment "
            f"refined {_ZOOM_POINTS - 1}-fold {_ZOOMS} times; sampled, no proof between the points"
        )


def grid_points(samples: int) -> int:
    """Return the number of points on which a design of `samples` samples is checked."""
    return max(LEAST_POINTS, FINER * samples)


def recheck(model: ExactModel, trajectory: FourierTrajectory, samples: int) -> Recheck:
    """Check every limit on a grid at least 20 times finer than the design's samples.

    Each row's worst moment is then searched again on ever finer grids around it, so that neither
    a maximum between the points nor a jump of dry friction is missed by more than rounding.
    """
    points = grid_points(samples)
    times = trajectory.sample_times(points)
    violations = model.violations(states_at(trajectory, times))
    checks = []
    for limit, columns in zip(model.limits, model.columns(), strict=True):
        part = violations[:, columns]
        row = int(np.argmax(np.max(part, axis=0)))
        column = columns.start + row
        time = _zoom(model, trajectory, times, violations[:, column], column)
        value = float(model.values(states_at(trajectory, np.array([time])))[0, column])
        violation = float(limit.violation_of(row, value))
        checks.append(
            LimitCheck(
                key=limit.key,
                title=limit.definition.title,
                unit=limit.unit,
                origin=limit.origin,
                row=limit.labels[row],
                value=value,
                bound=limit.nearest_bound(row, value),
                violation=violation if np.isfinite(value) else np.inf,
                time=float(time % trajectory.period),
            )
        )
    return Recheck(tuple(checks), points)


def states_at(trajectory: FourierTrajectory, times: Array) -> Array:
    """Return pose, rate and acceleration side by side, (N, 18)."""
    samples = trajectory.sample(times)
    return np.concatenate([samples.pose, samples.rate, samples.acceleration], axis=1)


def _zoom(
    model: ExactModel, trajectory: FourierTrajectory, times: Array, violations: Array, column: int
) -> float:
    """Return the time of the worst violation in the neighbourhood of the grid's worst points."""
    step = times[1] - times[0]
    candidates = np.argsort(violations)[-3:]
    best_time, best = float(times[candidates[-1]]), float(violations[candidates[-1]])
    for candidate in candidates:
        center, width = float(times[candidate]), step
        for _ in range(_ZOOMS):
            local = center + np.linspace(-width, width, _ZOOM_POINTS)
            found = model.violations(states_at(trajectory, local))[:, column]
            k = int(np.argmax(found))
            center, width = float(local[k]), 2 * width / (_ZOOM_POINTS - 1)
            if found[k] > best:
                best_time, best = center, float(found[k])
    return best_time
