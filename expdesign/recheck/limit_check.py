"""The worst moment of every limit of a motion: what was found, what is proved, what it says."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Annotated, Protocol

import numpy as np

from constraints import Limit, limit_definitions
from constraints.arrays import Array, Mask
from expdesign.configuration import quantity_text
from expdesign.configuration.open_rows import named_rows, open_in_words, open_rows
from expdesign.robot import LimitModel, Robot
from expdesign.runfolder import OpenNumber, described
from expdesign.trajectory import PoseSamples

TOLERANCE = 1e-6
"""Largest excess over a bound, as a share of the limit's range, that counts as kept."""


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
            "one-sided limit); negative: margin",
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
    def possible(self) -> float:
        """Largest excess that there may be: what is proved; where nothing is, what was found."""
        return float(np.fmax(self.proved, self.violation))

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


def worst_of_each(checks: Iterable[LimitCheck]) -> tuple[LimitCheck, ...]:
    """Return the worst check of every limit, of parts of a motion that were judged apart.

    What is proved, and what it took, is that of all parts.
    """
    worst: dict[str, LimitCheck] = {}
    for check in checks:
        known = worst.get(check.key)
        if known is None:
            worst[check.key] = check
            continue
        worst[check.key] = replace(
            max(known, check, key=lambda one: one.violation),
            proved=float(np.maximum(known.proved, check.proved)),
            cells=known.cells + check.cells,
            open_time=known.open_time + check.open_time,
        )
    return tuple(worst.values())


@dataclass(frozen=True)
class Recheck:
    """All limits of one motion, at every instant of it."""

    limits: tuple[LimitCheck, ...]
    span: str = "one period"
    """What was looked at, in words."""

    @property
    def worst(self) -> float:
        """Largest violation as a share of its limit's range; −inf without limits."""
        return max((check.violation for check in self.limits), default=-np.inf)

    @property
    def possible(self) -> float:
        """Largest excess over a limit that there may be, as a share of its range."""
        return max((check.possible for check in self.limits), default=-np.inf)

    @property
    def passed(self) -> bool:
        """True when no limit was found broken by more than `TOLERANCE` of its range."""
        return self.worst <= TOLERANCE

    @property
    def certified(self) -> bool:
        """True when every limit is proved to be kept at every instant, within `TOLERANCE`."""
        return all(check.certified for check in self.limits)

    @property
    def method(self) -> str:
        """How the limits were checked, in words."""
        cells = max((check.cells for check in self.limits), default=0)
        said = f"unsmoothed model enclosed over up to {cells} cells of time of {self.span}"
        left = max((check.open_time for check in self.limits), default=0.0)
        if self.certified or not self.passed:
            return f"{said}: holds for every instant"
        return f"{said}: not proved for every instant, {left:.3g} s stayed open"


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
        violation = float(part[moment, row])
        checks.append(limit_check(limit, int(row), value, violation, float(times[moment])))
    return tuple(checks)


def limit_check(limit: Limit, row: int, value: float, violation: float, time: float) -> LimitCheck:
    """Return the check of a limit whose worst moment is in a row; nothing is proved of it."""
    return LimitCheck(
        key=limit.key,
        title=limit.definition.title,
        row=limit.labels[row],
        unit=limit.unit,
        value=value,
        bound=limit.nearest_bound(row, value),
        violation=violation,
        time=time,
        origin=limit.origin,
        stated=limit.nearest_stated(row, value),
        reserve=limit.reserve,
    )


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


REACHED = 0.99
"""Share of a limit that is used from which on it counts as one that is reached."""


def reached(model: LimitModel, values: Array) -> Mask:
    """Return which rows of limits are reached at which instant, (N, R).

    Parameters
    ----------
    model : LimitModel
    values : (N, R)
        As of `LimitModel.values`. One that is not a number is beyond its limit.
    """
    excess, found = model.excess(values), np.zeros(values.shape, dtype=bool)
    for limit, columns in zip(model.limits, model.columns, strict=True):
        own = values[:, columns]
        below, above = limit.lower - own, own - limit.upper
        bounds = np.where(below > above, limit.lower, limit.upper)
        with np.errstate(invalid="ignore"):
            used = limit.definition.shares_used(own, bounds, excess[:, columns])
        found[:, columns] = ~(used < REACHED) & ~limit.open_rows
    return found


POINTS = 2000
_DIGITS = 3


@dataclass(frozen=True)
class Unlimited:
    """How far a motion goes in a quantity that nothing limits.

    `value` is the smallest of a limit that bounds from below, and otherwise the largest size, of
    what has a range (rotations, lengths, joint angles) counted `from_home`. SI; `row` names the
    component, strut or pair of struts that it is of.
    """

    key: str
    title: str
    row: str
    value: OpenNumber
    unit: str
    from_home: bool

    def __str__(self) -> str:
        """Return it in words."""
        row = f" {self.row}" if self.row else ""
        away = " from home" if self.from_home else ""
        return f"{self.title}{row} {quantity_text(self.value, self.unit, _DIGITS)}{away}"


def unlimited(robot: Robot, motion: Motion, times: Array) -> tuple[Unlimited, ...]:
    """Return what a motion does at the times (N,), s, where neither robot nor run limit it.

    Of a limit on components every open component is told, of others the row that goes furthest.
    The times should be a fine grid: nothing is looked at between them.
    """
    found: list[Unlimited] = []
    open_ones = open_rows(robot.description)
    limits = tuple(Limit.boundless(one.definition, one.labels) for one in open_ones)
    model = LimitModel(robot, limits)
    values, at_home = model.values(states_at(motion, times)), model.at_home()
    for one, columns in zip(open_ones, model.columns, strict=True):
        definition = one.definition
        from_home = definition.kind == "interval"
        rows = values[:, columns][:, one.rows]
        if from_home:
            rows = rows - at_home[definition.key][one.rows]
        if definition.kind == "lower":
            extremes, furthest = rows.min(axis=0), np.argmin
        else:
            extremes, furthest = np.abs(rows).max(axis=0), np.argmax
        told = range(len(extremes)) if definition.components else [int(furthest(extremes))]
        found += [
            Unlimited(
                definition.key,
                definition.title,
                one.labels[one.rows[k]],
                float(extremes[k]),
                definition.unit,
                from_home,
            )
            for k in told
        ]
    return tuple(found)


def unlimited_warning(found: Sequence[Unlimited]) -> str:
    """Say which limits are not set and what a motion does there; empty where all are set."""
    known = limit_definitions()
    names = (
        named_rows(known[key], [one.row for one in rows])
        for key, rows in groupby(found, key=lambda one: one.key)
    )
    said = open_in_words(names)
    return f"{said}. There the motion reaches: {in_words(found)}" if said else ""


def in_words(found: Sequence[Unlimited]) -> str:
    """List what a motion reaches."""
    return "; ".join(str(one) for one in found)
