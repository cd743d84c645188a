"""A motion at many instants: how many are enough, and the worst of every limit among them."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from constraints.arrays import Array, Mask
from expdesign.recheck.limit_check import LimitCheck
from expdesign.robot import LimitModel
from expdesign.runfolder import copied
from expdesign.trajectory import PoseSamples

FINER = 20
"""The fine grid has at least this many points for every sample of the design."""
LEAST_POINTS = 4000


class Motion(Protocol):
    """Anything that moves the platform: a trajectory, or a motion from rest to rest."""

    def sample(self, times: Array) -> PoseSamples:
        """Return pose, rate and acceleration at times, s."""


def grid_points(samples: int) -> int:
    """Return the number of points of the fine grid on which a design of `samples` is finished."""
    return max(LEAST_POINTS, FINER * samples)


def states_at(motion: Motion, times: Array) -> Array:
    """Return pose, rate and acceleration side by side, (N, 18)."""
    return np.concatenate(motion.sample(times), axis=1)


def worst_sampled(limits: LimitModel, times: Array, values: Array) -> tuple[LimitCheck, ...]:
    """Return the worst of some instants of every limit, by the unsmoothed model; no proof.

    Parameters
    ----------
    times : (N,)
        s.
    values : (N, R)
        The limited quantities then.
    """
    violations = limits.excess(values)
    checks = []
    for limit, columns in zip(limits.limits, limits.columns, strict=True):
        part = violations[:, columns]
        moment, row = np.unravel_index(int(np.argmax(part)), part.shape)
        value = float(values[moment, columns.start + row])
        check = copied(
            LimitCheck,
            limit,
            title=limit.definition.title,
            row=limit.labels[row],
            value=value,
            bound=limit.nearest_bound(int(row), value),
            stated=limit.nearest_stated(int(row), value),
            violation=float(part[moment, row]),
            time=float(times[moment]),
        )
        checks.append(check)
    return tuple(checks)


def local_worst(rows: Array, *, periodic: bool) -> Mask:
    """Mark the entries of rows (N, R) that are no smaller than one step before and after."""
    ahead, behind = _neighbours(rows, periodic=periodic)
    peaks: Mask = (rows >= ahead) & (rows >= behind)
    return peaks


def _neighbours(rows: Array, *, periodic: bool) -> tuple[Array, Array]:
    """Return the rows one step later and one step earlier; at open ends the rows themselves."""
    if periodic:
        return np.roll(rows, -1, axis=0), np.roll(rows, 1, axis=0)
    return np.concatenate([rows[1:], rows[-1:]]), np.concatenate([rows[:1], rows[:-1]])
