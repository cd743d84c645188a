"""The recheck of a motion: every limit at every time, independent of the optimiser."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from constraints.arrays import Array
from expdesign.recheck.limit_check import TOLERANCE, LimitCheck
from expdesign.robot import ExactModel
from expdesign.trajectory import FourierTrajectory, PoseSamples

FINER = 20
"""The grid has at least this many points for every sample of the design."""
LEAST_POINTS = 4000
_ZOOMS = 4
_ZOOM_POINTS = 33
_MOST_CANDIDATES = 48


class Motion(Protocol):
    """Anything that moves the platform: a trajectory, or a motion from rest to rest."""

    def sample(self, times: Array) -> PoseSamples:
        """Return pose, rate and acceleration at times, s."""


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
            f"moment refined {(_ZOOM_POINTS - 1) // 2}-fold {_ZOOMS} times; sampled, no proof "
            "between the points"
        )


def grid_points(samples: int) -> int:
    """Return the number of points on which a design of `samples` samples is checked."""
    return max(LEAST_POINTS, FINER * samples)


def recheck(model: ExactModel, trajectory: FourierTrajectory, samples: int) -> Recheck:
    """Check every limit on a grid at least 20 times finer than the design's samples.

    Every moment that could be a limit's worst is then searched again on ever finer grids around
    it, so that neither a maximum between the points nor a jump of dry friction is missed. Two
    changes of a rate's sign within one step of the grid are not seen.
    """
    points = grid_points(samples)
    times = trajectory.sample_times(points)
    checks = check_limits(model, trajectory, times, periodic=True)
    period = trajectory.period
    return Recheck(tuple(replace(check, time=check.time % period) for check in checks), points)


def check_limits(
    model: ExactModel, motion: Motion, times: Array, *, periodic: bool
) -> tuple[LimitCheck, ...]:
    """Return the worst moment of every limit of a motion, on a grid and between its points.

    Parameters
    ----------
    model : ExactModel
    motion : Motion
    times : (N,)
        Equidistant, s. Of a periodic motion one period without its end; otherwise with both ends,
        and nothing beyond them is looked at.
    periodic : bool
    """
    violations = model.violations(states_at(motion, times))
    search = _Search(model, motion, times, periodic)
    checks = []
    for limit, columns in zip(model.limits, model.columns(), strict=True):
        time, row = search.worst_moment(violations[:, columns], columns.start)
        state = states_at(motion, np.array([time]))
        value = float(model.values(state)[0, columns.start + row])
        checks.append(
            LimitCheck(
                key=limit.key,
                title=limit.definition.title,
                unit=limit.unit,
                origin=limit.origin,
                row=limit.labels[row],
                value=value,
                bound=limit.nearest_bound(row, value),
                violation=limit.violation_of(row, value) if np.isfinite(value) else np.inf,
                time=float(time),
            )
        )
    return tuple(checks)


def states_at(motion: Motion, times: Array) -> Array:
    """Return pose, rate and acceleration side by side, (N, 18)."""
    samples = motion.sample(times)
    return np.concatenate([samples.pose, samples.rate, samples.acceleration], axis=1)


@dataclass(frozen=True)
class _Search:
    """The search for worst moments between the points of a grid."""

    model: ExactModel
    motion: Motion
    times: Array
    periodic: bool

    def worst_moment(self, part: Array, first: int) -> tuple[float, int]:
        """Return time and row of a limit's worst moment, between the grid's points as well.

        Every local maximum of every row that could rise above the worst grid value is searched
        again on ever finer grids: one that is as high as its slope to the neighbours allows.
        """
        ahead, behind = self._neighbours(part)
        with np.errstate(invalid="ignore"):
            rise = np.maximum(np.abs(ahead - part), np.abs(behind - part))
        possible = (part >= ahead) & (part >= behind) & np.isfinite(rise)
        start, row = np.unravel_index(int(np.argmax(part)), part.shape)
        best, time, worst_row = float(part[start, row]), float(self.times[start]), int(row)
        if not np.isfinite(best):
            return time, worst_row
        # A row that hardly moves is at its worst everywhere: its highest points stand for the
        # rest.
        points, rows = np.nonzero(possible & (part + rise >= best))
        order = np.argsort(-(part + rise)[points, rows], kind="stable")[:_MOST_CANDIDATES]
        points, rows = points[order], rows[order]
        centers, width = self.times[points], self.times[1] - self.times[0]
        for _ in range(_ZOOMS):
            local = centers[:, None] + np.linspace(-width, width, _ZOOM_POINTS)
            if not self.periodic:
                local = np.clip(local, self.times[0], self.times[-1])
            states = states_at(self.motion, local.ravel())
            found = self.model.violations(states)[:, first : first + part.shape[1]]
            found = found.reshape(*local.shape, -1)[np.arange(len(rows)), :, rows]
            steps = np.argmax(found, axis=1)
            centers = local[np.arange(len(rows)), steps]
            width *= 2 / (_ZOOM_POINTS - 1)
            highest = found[np.arange(len(rows)), steps]
            k = int(np.argmax(highest))
            if highest[k] > best:
                best, time, worst_row = float(highest[k]), float(centers[k]), int(rows[k])
        return time, worst_row

    def _neighbours(self, part: Array) -> tuple[Array, Array]:
        """Return the values one step later and one step earlier."""
        if self.periodic:
            return np.roll(part, -1, axis=0), np.roll(part, 1, axis=0)
        return np.concatenate([part[1:], part[-1:]]), np.concatenate([part[:1], part[:-1]])
