"""Check of every limit: worst moment and proved excess; extreme values without a limit."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Annotated, Protocol

import numpy as np

from constraints import Limit, limit_definitions
from constraints.arrays import Array, Mask
from expdesign.configuration import quantity_text
from expdesign.configuration.limits import named_rows, open_in_words, open_rows
from expdesign.robot import LimitModel, Robot
from expdesign.runfolder import OpenNumber, described
from expdesign.trajectory import PoseSamples

TOLERANCE = 1e-6
"""Largest excess over a bound, as a share of the limit's range, that counts as kept."""


def range_share_in_words(excess: float) -> str:
    """Return an excess over a bound, a share of the limit's range, in words.

    Examples
    --------
    >>> range_share_in_words(0.0166)
    '1.66 % of its range'
    """
    return f"{100 * excess:.3g} % of its range"


@dataclass(frozen=True)
class LimitCheck:
    """The worst moment of one limit: a row of ``tables/limits.csv``.

    `row` is empty for a limit of a single row. `value` is NaN if it could not be computed; such a
    limit is not kept.
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
    time: Annotated[
        OpenNumber, described("s", "time of the worst moment, from the start of the period")
    ]
    origin: Annotated[str, described("", "source of the bound")]
    proved: Annotated[
        OpenNumber,
        described("1", "proved upper bound of the excess at every instant; empty: only sampled"),
    ] = np.nan
    cells: Annotated[int, described("1", "cells of time of the proof")] = 0
    open_time: Annotated[
        OpenNumber, described("s", "duration of the motion in cells that stayed open")
    ] = 0.0
    stated: Annotated[
        OpenNumber,
        described("see unit", "the bound as stated, before the reserve is subtracted"),
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
        """Largest possible excess: the proved one, or the one found if nothing is proved."""
        return float(np.fmax(self.proved, self.violation))

    @property
    def kept(self) -> bool:
        """Whether the limit is kept, within `TOLERANCE` of its range."""
        return bool(self.violation <= TOLERANCE)

    @property
    def used(self) -> float:
        """Share of the limit that is used, 1 at the bound; see `LimitDefinition.shares_used`."""
        return self._share_used(self.value, self.violation)

    @property
    def left(self) -> float:
        """Share of the limit, as in `used`, that is proved to be free at every instant."""
        return 1 - self._share_used(self.bound - self.proved * abs(self.bound), self.proved)

    def _share_used(self, value: float, violation: float) -> float:
        definition = limit_definitions().get(self.key)
        if definition is None:
            return 1 + violation
        numbers = np.array([value, self.bound, violation])
        return float(definition.shares_used(*numbers))

    @property
    def strut(self) -> int | None:
        """Number of the strut, from 1; None for a row of another kind."""
        word, _, number = self.row.partition(" ")
        return int(number) if word == "strut" else None

    def __str__(self) -> str:
        """Return the quantity, its value, time and bound in words."""
        row = f" of {self.row}" if self.row else ""
        return (
            f"{self.title}{row} is {self.value:.6g} {self.unit} at {self.time:.4f} s, the bound "
            f"{self.bound:.6g} {self.unit}"
        )


def worst_of_each(checks: Iterable[LimitCheck]) -> tuple[LimitCheck, ...]:
    """Return the worst check of every limit over the separately checked parts of a motion.

    Proved excess, cells and open time are those of all parts.
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
    """The checked part of the motion, in words."""

    @property
    def worst(self) -> float:
        """Largest violation as a share of its limit's range; −inf without limits."""
        return max((check.violation for check in self.limits), default=-np.inf)

    @property
    def possible(self) -> float:
        """Largest possible excess over a limit, as a share of its range."""
        return max((check.possible for check in self.limits), default=-np.inf)

    @property
    def passed(self) -> bool:
        """Whether no violation of more than `TOLERANCE` of a limit's range was found."""
        return self.worst <= TOLERANCE

    @property
    def certified(self) -> bool:
        """Whether every limit is proved to be kept at every instant, within `TOLERANCE`."""
        return all(check.certified for check in self.limits)

    @property
    def method(self) -> str:
        """Method of the check, in words."""
        cells = max((check.cells for check in self.limits), default=0)
        text = f"unsmoothed model enclosed over up to {cells} cells of time of {self.span}"
        left = max((check.open_time for check in self.limits), default=0.0)
        if self.certified or not self.passed:
            return f"{text}: holds for every instant"
        return f"{text}: not proved for every instant, {left:.3g} s stayed open"


FINER = 20
"""Smallest number of points of the fine grid per sample of the design."""
LEAST_POINTS = 4000


class Motion(Protocol):
    """A motion of the platform: a trajectory, or a motion from rest to rest."""

    def sample(self, times: Array) -> PoseSamples:
        """Return pose, rate and acceleration at times, s."""


def grid_points(samples: int) -> int:
    """Return the number of points of the fine grid on which a design is finished.

    Examples
    --------
    >>> grid_points(100), grid_points(1000)
    (4000, 20000)
    """
    return max(LEAST_POINTS, FINER * samples)


def states_at(motion: Motion, times: Array) -> Array:
    """Return pose, rate and acceleration at times (N,), s, as columns, (N, 18)."""
    return np.concatenate(motion.sample(times), axis=1)


def worst_sampled(limits: LimitModel, times: Array, values: Array) -> tuple[LimitCheck, ...]:
    """Return the worst sampled moment of every limit by the exact model, without a proof.

    Parameters
    ----------
    times : (N,)
        s.
    values : (N, R)
        Limited quantities at these times.
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
    """Return the sampled check, without a proof, of a limit with its worst moment in a row."""
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
        stated=limit.nearest_bound(row, value, stated=True),
        reserve=limit.reserve,
    )


def local_worst(rows: Array, *, periodic: bool) -> Mask:
    """Mark the local maxima of rows (N, R) over the steps.

    Examples
    --------
    >>> import numpy as np
    >>> rows = np.array([[0.0], [2.0], [1.0], [3.0]])
    >>> local_worst(rows, periodic=True)[:, 0].tolist()
    [False, True, False, True]
    """
    ahead, behind = _neighbours(rows, periodic=periodic)
    peaks: Mask = (rows >= ahead) & (rows >= behind)
    return peaks


def _neighbours(rows: Array, *, periodic: bool) -> tuple[Array, Array]:
    """Return the rows one step later and one step earlier; at open ends the rows themselves."""
    if periodic:
        return np.roll(rows, -1, axis=0), np.roll(rows, 1, axis=0)
    return np.concatenate([rows[1:], rows[-1:]]), np.concatenate([rows[:1], rows[:-1]])


REACHED = 0.99
"""Used share from which on a limit counts as reached."""


def reached_limits(model: LimitModel, values: Array) -> Mask:
    """Return for every instant which rows of limits are reached, (N, R).

    Parameters
    ----------
    model : LimitModel
    values : (N, R)
        As returned by `LimitModel.values`. NaN counts as beyond the limit.
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
    """The extreme value of a quantity without a limit.

    `value`, SI, is the smallest value of a quantity that limits bound from below, and otherwise the
    largest magnitude, of quantities with a range (rotations, lengths, joint angles) `from_home`.
    `row` names the component, strut or pair of struts.
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
    """Return the extreme values of quantities that neither robot nor run limit.

    Limits on components give one value per open component, others the extreme row. The times (N,),
    s, should be a fine grid: nothing is evaluated between them.
    """
    found: list[Unlimited] = []
    open_ones = open_rows(robot.description.limits, robot.description.shared_joint_pairs)
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
        rows_shown = range(len(extremes)) if definition.components else [int(furthest(extremes))]
        found += [
            Unlimited(
                definition.key,
                definition.title,
                one.labels[one.rows[k]],
                float(extremes[k]),
                definition.unit,
                from_home,
            )
            for k in rows_shown
        ]
    return tuple(found)


def unlimited_warning(found: Sequence[Unlimited]) -> str:
    """Return a warning about limits that are not set, with the motion's values; empty: all set."""
    known = limit_definitions()
    names = (
        named_rows(known[key], [one.row for one in rows])
        for key, rows in groupby(found, key=lambda one: one.key)
    )
    text = open_in_words(names)
    return f"{text}. There the motion reaches: {in_words(found)}" if text else ""


def in_words(found: Sequence[Unlimited]) -> str:
    """Return the values that a motion reaches, as a list in words."""
    return "; ".join(str(one) for one in found)
