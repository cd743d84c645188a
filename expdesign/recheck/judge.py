"""The one judge of motions: the worst moment of every limit, and whether it is kept."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, NamedTuple, Protocol

import numpy as np

from constraints import limit_definitions
from constraints.arrays import Array, Mask
from expdesign.robot import LimitModel
from expdesign.runfolder import OpenNumber, copied, described
from expdesign.trajectory import FourierTrajectory, PoseSamples

TOLERANCE = 1e-6
"""Largest excess over a bound, as a share of the limit's range, that counts as kept."""

_ZOOMS = 4
_ZOOM_POINTS = 33
_MOST_CANDIDATES = 48
FINER = 20
"""The grid has at least this many points for every sample of the design."""
LEAST_POINTS = 4000


@dataclass(frozen=True)
class LimitCheck:
    """The worst moment of one limit: a row of ``tables/limits.csv``.

    `row` is empty for a limit of a single row. `value` may be NaN, where it could not be computed;
    such a limit is not kept.
    """

    key: Annotated[str, described("", "key of the limit in the YAML", name="limit")]
    title: Annotated[str, described("", "the limit in words")]
    row: Annotated[
        str, described("", "component, strut or pair of struts that comes closest to the bound")
    ]
    unit: Annotated[str, described("", "unit of value and bound")]
    value: Annotated[
        OpenNumber, described("see unit", "worst value over the whole period, unsmoothed model")
    ]
    bound: Annotated[OpenNumber, described("see unit", "bound that it comes closest to")]
    violation: Annotated[
        OpenNumber,
        described(
            "1",
            "excess over the bound as a share of the limit's range (max - min; |bound| of a "
            "one-sided limit); negative: what is left",
        ),
    ]
    time: Annotated[OpenNumber, described("s", "when, from the start of the period")]
    origin: Annotated[str, described("", "where the bound was given")]
    proved: Annotated[
        OpenNumber,
        described("1", "the same of every instant: proved to be no more; empty: only sampled"),
    ] = np.nan
    cells: Annotated[int, described("1", "cells of time that it was proved over")] = 0
    open_time: Annotated[
        OpenNumber, described("s", "how much of the motion is in cells that were left open")
    ] = 0.0
    stated: Annotated[
        OpenNumber,
        described("see unit", "the bound as it is stated: it is drawn in by the reserve"),
    ] = np.nan
    reserve: Annotated[
        float, described("1", "share of the stated range that is kept free (limits.reserve)")
    ] = 0.0

    @property
    def certified(self) -> bool:
        """Whether the limit is proved to be kept at every instant, within `TOLERANCE`."""
        return bool(self.proved <= TOLERANCE)

    @property
    def kept(self) -> bool:
        """Whether the limit is kept, within `TOLERANCE` of its range."""
        return bool(self.violation <= TOLERANCE)

    @property
    def used(self) -> float:
        """How much of the limit is used: 1 at the bound; see `LimitDefinition.share_used`."""
        definition = limit_definitions().get(self.key)
        if definition is None:
            return 1 + self.violation
        return definition.share_used(self.value, self.bound, self.violation)

    @property
    def strut(self) -> int | None:
        """Number of the strut, from 1; None for a row that is not one strut's."""
        word, _, number = self.row.partition(" ")
        return int(number) if word == "strut" else None

    def __str__(self) -> str:
        """Return it in words: what is how large, when, and which bound it comes closest to."""
        row = f" of {self.row}" if self.row else ""
        return (
            f"{self.title}{row} is {self.value:.6g} {self.unit} at {self.time:.4f} s, the bound "
            f"{self.bound:.6g} {self.unit}"
        )


class Motion(Protocol):
    """Anything that moves the platform: a trajectory, or a motion from rest to rest."""

    def sample(self, times: Array) -> PoseSamples:
        """Return pose, rate and acceleration at times, s."""


def states_at(motion: Motion, times: Array) -> Array:
    """Return pose, rate and acceleration side by side, (N, 18)."""
    return np.concatenate(motion.sample(times), axis=1)


def judge(
    limits: LimitModel,
    times: Array,
    states: Array,
    between: Callable[[Array], Array] | None = None,
    *,
    periodic: bool = False,
) -> tuple[LimitCheck, ...]:
    """Return the worst moment of every limit by the unsmoothed model.

    Parameters
    ----------
    times : (N,)
        s; equidistant where `between` is given. Of a periodic motion one period without its end;
        otherwise with both ends, and nothing beyond them is looked at.
    states : (N, 18)
        Pose, rate and acceleration then; (N, 24) with the pose's third derivative where a limit
        needs it.
    between : callable, optional
        Returns the states at other times: every moment that could be a limit's worst is then
        searched again on ever finer grids around it. Without it only `times` are judged.
    """
    values = limits.values(states)
    violations = limits.excess(values)
    checks = []
    for limit, columns in zip(limits.limits, limits.columns, strict=True):
        part = violations[:, columns]
        moment, row = np.unravel_index(int(np.argmax(part)), part.shape)
        value = values[moment, columns.start + row]
        worst = _Moment(float(times[moment]), int(row), float(value), float(part[moment, row]))
        if between is not None and np.isfinite(worst.violation):
            alone = replace(limits, limits=(limit,))
            worst = _refined(alone, part, worst, times, between, periodic=periodic)
        checks.append(
            copied(
                LimitCheck,
                limit,
                worst,
                title=limit.definition.title,
                row=limit.labels[worst.row],
                bound=limit.nearest_bound(worst.row, worst.value),
                stated=limit.nearest_stated(worst.row, worst.value),
            )
        )
    return tuple(checks)


def worst_of_each(checks: Iterable[LimitCheck]) -> tuple[LimitCheck, ...]:
    """Return the worst check of every limit, of parts of a motion that were judged apart."""
    worst: dict[str, LimitCheck] = {}
    for check in checks:
        if check.key not in worst or check.violation > worst[check.key].violation:
            worst[check.key] = check
    return tuple(worst.values())


def local_worst(rows: Array, *, periodic: bool) -> Mask:
    """Mark the entries of rows (N, R) that are no smaller than one step before and after."""
    ahead, behind = _neighbours(rows, periodic=periodic)
    peaks: Mask = (rows >= ahead) & (rows >= behind)
    return peaks


class _Moment(NamedTuple):
    time: float
    row: int
    value: float
    violation: float


def _refined(
    limit: LimitModel,
    part: Array,
    worst: _Moment,
    times: Array,
    between: Callable[[Array], Array],
    *,
    periodic: bool,
) -> _Moment:
    """Return a limit's worst moment between the grid's points.

    Every local maximum of every row that could rise above the worst grid value is searched
    again: one that is as high as its slope to the neighbours allows.
    """
    ahead, behind = _neighbours(part, periodic=periodic)
    with np.errstate(invalid="ignore"):
        rise = np.maximum(np.abs(ahead - part), np.abs(behind - part))
    possible = (part >= ahead) & (part >= behind) & np.isfinite(rise)
    # A row that hardly moves is at its worst everywhere: its highest points stand for the rest.
    points, rows = np.nonzero(possible & (part + rise >= worst.violation))
    order = np.argsort(-(part + rise)[points, rows], kind="stable")[:_MOST_CANDIDATES]
    points, rows = points[order], rows[order]
    centers, width = times[points], times[1] - times[0]
    every = np.arange(len(rows))
    for _ in range(_ZOOMS if len(rows) else 0):
        local = centers[:, None] + np.linspace(-width, width, _ZOOM_POINTS)
        if not periodic:
            local = np.clip(local, times[0], times[-1])
        values = limit.values(between(local.ravel()))
        found = limit.excess(values).reshape(*local.shape, -1)[every, :, rows]
        values = values.reshape(*local.shape, -1)[every, :, rows]
        steps = np.argmax(found, axis=1)
        centers, highest = local[every, steps], found[every, steps]
        width *= 2 / (_ZOOM_POINTS - 1)
        k = int(np.argmax(highest))
        if highest[k] > worst.violation:
            value = float(values[k, steps[k]])
            worst = _Moment(float(centers[k]), int(rows[k]), value, float(highest[k]))
    return worst


def _neighbours(rows: Array, *, periodic: bool) -> tuple[Array, Array]:
    """Return the rows one step later and one step earlier; at open ends the rows themselves."""
    if periodic:
        return np.roll(rows, -1, axis=0), np.roll(rows, 1, axis=0)
    return np.concatenate([rows[1:], rows[-1:]]), np.concatenate([rows[:1], rows[:-1]])


@dataclass(frozen=True)
class Recheck:
    """All limits of one motion."""

    limits: tuple[LimitCheck, ...]
    points: int
    span: str = "one period"
    """What the grid covers, in words."""

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
