"""The certificate of a motion: a proved bound of every limit's excess at every instant.

Every limit is enclosed over cells of time that cover the motion, and undecided cells are divided:
branch and bound. The excess found is attained by the motion; the proved one is exceeded at no
instant. Division continues until the two are `CLOSE`.

Where a rate changes its sign, dry friction jumps, and both signs count: cells are cut where rates
change sign. Rates that change sign within the same cell of `INSTANT` count with every combination
of signs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from itertools import pairwise
from operator import attrgetter
from typing import NamedTuple, Protocol

import numpy as np

from constraints import Limit
from constraints.arrays import Array, Mask
from expdesign.enclosure.arithmetic import EPS
from expdesign.enclosure.instructions import NoEnclosureError
from expdesign.enclosure.limit_rows import EnclosedLimits, EnclosedRow
from expdesign.enclosure.paths import EnclosedSeries
from expdesign.enclosure.taylor_model import TaylorModel
from expdesign.progress import report_progress
from expdesign.recheck.limit_check import (
    LEAST_POINTS,
    TOLERANCE,
    LimitCheck,
    Recheck,
    limit_check,
    worst_sampled,
)
from expdesign.robot import LimitModel
from expdesign.trajectory import FourierTrajectory

CLOSE = 5e-7
"""Largest difference between proved and found excess, as a share of a limit's range."""
INSTANT = 1e-10
"""Share of the motion's duration below which cells are not divided."""
CELLS = 512
"""Number of cells at the beginning."""
MOST_CELLS = 40_000
"""Largest number of cells that are enclosed; the others stay open."""
_PARTS = 8
_BLOCK = 1024
_FEWEST = 64
"""Smallest number of cells of a part for another process: below it the overhead is larger."""


class EnclosedMotion(Protocol):
    """A motion of the pose with enclosures over cells of time."""

    @property
    def breaks(self) -> Array:
        """(K,), s: beginning, end, and the instants between them that no cell may contain."""

    def models(self, edges: Array) -> list[TaylorModel]:
        """Return the models of pose, rate, acceleration and jerk, 24, over cells (N, 2), s."""


def recheck(limits: LimitModel, trajectory: FourierTrajectory) -> Recheck:
    """Check every limit at every instant of one period, with a proof."""
    checks = certify(limits, EnclosedSeries(trajectory))
    period = trajectory.period
    return Recheck(tuple(replace(check, time=check.time % period) for check in checks))


def certify(
    limits: LimitModel, motion: EnclosedMotion, *, cells: int = CELLS, most: int = MOST_CELLS
) -> tuple[LimitCheck, ...]:
    """Return the worst moment of every limit, with the proved bound of its excess.

    A limit without an enclosure is sampled in the middle of `LEAST_POINTS` cells, without a proof.

    Parameters
    ----------
    cells : int
        Number of cells at the beginning.
    most : int
        Largest number of cells that are enclosed; the others stay open.
    """
    edges = divided_cells(motion.breaks, cells)
    try:
        proof = _Proof(limits)
    except NoEnclosureError:
        known = [limit for limit in limits.limits if _is_enclosed(limits, limit)]
        proved = certify(replace(limits, limits=tuple(known)), motion, cells=cells, most=most)
        others = tuple(limit for limit in limits.limits if limit not in known)
        sampled = _sampled(replace(limits, limits=others), motion)
        checks = {check.key: check for check in (*proved, *sampled)}
        return tuple(checks[limit.key] for limit in limits.limits)
    span = motion.breaks[-1] - motion.breaks[0]
    undecided: Mask = np.ones((len(edges), len(limits.limits)), dtype=bool)
    enclosed = 0
    while len(edges) and enclosed + len(edges) <= most:
        report_progress(f"proving the limits: {len(edges)} cells of time")
        enclosed += len(edges)
        proof.open_excess[:] = -np.inf
        blocks = [slice(start, start + _BLOCK) for start in range(0, len(edges), _BLOCK)]
        examined = [
            proof.examine(motion, edges[block], undecided[block], INSTANT * span)
            for block in blocks
        ]
        edges, undecided, turns = (np.concatenate(part) for part in zip(*examined, strict=True))
        if enclosed < most:  # open cells are reported as they are, undivided
            edges, undecided = _parts(edges, undecided, turns, INSTANT * span)
    return proof.checks(edges, undecided)


def _is_enclosed(limits: LimitModel, limit: Limit) -> bool:
    try:
        EnclosedLimits(replace(limits, limits=(limit,)))
    except NoEnclosureError:
        return False
    return True


def _sampled(limits: LimitModel, motion: EnclosedMotion) -> tuple[LimitCheck, ...]:
    edges = divided_cells(motion.breaks, LEAST_POINTS)
    models = motion.models(edges)
    states = np.stack([model.at(np.zeros(len(edges))) for model in models], axis=1)
    return worst_sampled(limits, edges.mean(axis=1), limits.values(states))


def divided_cells(breaks: Array, cells: int) -> Array:
    """Return the edges of cells between the breaks, (N, 2), about equally long."""
    steps = np.diff(breaks)
    counts = np.maximum(1, np.ceil(cells * steps / np.sum(steps))).astype(int)
    place = np.arange(np.sum(counts)) - np.repeat(np.cumsum(counts) - counts, counts)
    start, end, parts = (np.repeat(one, counts) for one in (breaks[:-1], breaks[1:], counts))
    first, last = (start + k * ((end - start) / parts) for k in (place, place + 1))
    return np.stack([first, np.where(place + 1 == parts, end, last)], axis=1)


def _parts(edges: Array, undecided: Mask, turns: Array, instant: float) -> tuple[Array, Mask]:
    """Divide cells; return the parts, (P, 2), and their undecided limits, (P, L).

    Around the sign change of a rate an instant is cut out; other cells are divided evenly.
    """
    start, end = edges[:, 0], edges[:, 1]
    cut = np.isfinite(turns)
    before = np.clip(turns - 0.49 * instant, start, end)
    after = np.clip(turns + 0.49 * instant, start, end)
    around = np.stack([start, before, after, end], axis=1)[cut]
    even = start[~cut, None] + (end - start)[~cut, None] * np.arange(_PARTS + 1) / _PARTS
    even[:, -1] = end[~cut]
    grids = [(around, undecided[cut]), (even, undecided[~cut])]
    pieces = [np.stack([grid[:, :-1], grid[:, 1:]], axis=2).reshape(-1, 2) for grid, _ in grids]
    marks = [np.repeat(mask, grid.shape[1] - 1, axis=0) for grid, mask in grids]
    parts, mask = np.concatenate(pieces), np.concatenate(marks)
    real = parts[:, 1] > parts[:, 0]
    return parts[real], mask[real]


@dataclass(frozen=True)
class Found:
    """The largest excess of a limit found so far."""

    row: int = -1
    value: float = np.nan
    violation: float = -np.inf
    time: float = np.nan
    rank: tuple[float, int, float] = (-np.inf, 0, -np.inf)
    """Sorting key: the excess; of equal ones the first bound, and of it the farthest value."""


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells of time in which limits are to be bounded."""

    edges: Array
    """(N, 2), s."""
    undecided: Mask
    """(N, L), limits of each cell that are to be bounded."""
    smallest: Mask
    """(N,), cells that are not divided any more."""
    which: tuple[int, ...]
    """Numbers of the limits that are undecided in some cell, of all parts."""
    found: tuple[Found, ...]
    """(L,), excesses found before."""

    def parts(self, count: int) -> list[Cells]:
        """Divide the cells, in order, into at most `count` parts that are worth a job each."""
        size = len(self.edges)
        ends = np.linspace(0, size, max(1, min(count, size // _FEWEST)) + 1).astype(int)
        return [
            replace(
                self,
                edges=self.edges[a:b],
                undecided=self.undecided[a:b],
                smallest=self.smallest[a:b],
            )
            for a, b in pairwise(ends)
        ]


@dataclass(frozen=True, eq=False)
class CellBounds:
    """Bounds of limits in cells of time."""

    possible: Array
    """(N, L), largest possible excess; −∞ where it was not asked for."""
    turns: Array
    """(N,), place of a rate's sign change in the cell, τ; NaN without one."""
    found: tuple[Found, ...]
    """(L,), largest excess that the motion certainly attains, in these cells or before."""

    @classmethod
    def join(cls, parts: Sequence[CellBounds]) -> CellBounds:
        """Join the bounds of parts; the digits are those of the undivided cells."""
        each_limit = zip(*(part.found for part in parts), strict=True)
        found = [max(each, key=attrgetter("rank")) for each in each_limit]
        return cls(
            np.concatenate([part.possible for part in parts]),
            np.concatenate([part.turns for part in parts]),
            tuple(found),
        )


@dataclass(frozen=True, eq=False)
class Sharing:
    """A function that bounds parts of cells, for example in other processes."""

    limits: LimitModel
    """Only the proofs of these limits use it."""
    count: Callable[[], int]
    """Returns the largest number of parts at present."""
    bound: Callable[[EnclosedMotion, list[Cells]], Iterable[CellBounds]]


_sharing: ContextVar[Sharing | None] = ContextVar("sharing", default=None)


@contextmanager
def share_cells(sharing: Sharing) -> Iterator[None]:
    """Divide the cells of proofs among processes, within the context."""
    token = _sharing.set(sharing)
    try:
        yield
    finally:
        _sharing.reset(token)


def bound_cells(enclosed: EnclosedLimits, motion: EnclosedMotion, cells: Cells) -> CellBounds:
    """Enclose limits over cells and return their bounds."""
    possible, found = np.full(cells.undecided.shape, -np.inf), list(cells.found)
    with np.errstate(all="ignore"):  # unknown values are infinite or NaN
        rows, turns = enclosed(motion.models(cells.edges), cells.which)
        for k in cells.which:
            sides = list(_sides(enclosed.limits.limits[k], rows[k]))
            possible[:, k], found[k] = _largest_excess(sides, cells, k)
    return CellBounds(possible, turns, tuple(found))


def _largest_excess(
    sides: list[tuple[_Side, EnclosedRow]], cells: Cells, k: int
) -> tuple[Array, Found]:
    """Return the largest possible excess of limit k in each cell, (N,), and the one found."""
    worst, best = np.full(len(cells.edges), -np.inf), cells.found[k]
    for number, (side, row) in enumerate(sides):
        low, high = row.bounds()
        excess = np.broadcast_to(side.excess(high if side.sign > 0 else low), worst.shape)
        worst = np.maximum(worst, excess)
        promising = cells.undecided[:, k] & (excess > best.violation)
        if np.any(promising):
            found = _attained_excess(side, row, cells, promising)
            if found.violation > best.violation:
                best = replace(found, rank=(found.violation, -number, side.sign * found.value))
    return worst, best


def _attained_excess(side: _Side, row: EnclosedRow, cells: Cells, here: Mask) -> Found:
    """Return the largest excess that the motion certainly attains in some of the cells."""
    # With an undecided sign the row jumps within the cell: only instants are recorded.
    known = here & (cells.smallest | (row.changing == 0))
    values, places = _extremes(row, side.sign, len(cells.edges))
    best = np.where(known & np.isfinite(values), values, -np.inf)
    cell = int(np.argmax(best))
    value = side.sign * float(best[cell])
    if not np.isfinite(value):
        return Found()
    start, end = cells.edges[cell]
    time = float((start + end) / 2 + places[cell] * (end - start) / 2)
    return Found(side.row, value, side.limit.violation_of(side.row, value), time)


class _Side(NamedTuple):
    """One bound of one row of a limit."""

    limit: Limit
    row: int
    sign: float
    """1: upper bound; −1: lower bound."""

    @property
    def bound(self) -> float:
        return float((self.limit.upper if self.sign > 0 else self.limit.lower)[self.row])

    def excess(self, values: Array) -> Array:
        """Return the excess of values over the bound as a share of the range, rounded up."""
        rounding = 8 * EPS * (np.abs(values) + abs(self.bound))
        found = (self.sign * (values - self.bound) + rounding) / self.limit.range[self.row]
        return np.nan_to_num(found, nan=np.inf, posinf=np.inf)


class _Proof:
    """The state of the proof of all limits.

    Attributes
    ----------
    decided_excess, open_excess : (L,)
        Largest possible excess in the decided cells, and in the open ones.
    """

    def __init__(self, limits: LimitModel) -> None:
        self._model, self._enclosed = limits, EnclosedLimits(limits)
        count = len(limits.limits)
        self._found = (Found(),) * count
        self._cells = np.zeros(count, dtype=int)
        self._stuck = np.zeros(count)
        # Before any cell is examined everything is possible.
        self.decided_excess, self.open_excess = np.full(count, -np.inf), np.full(count, np.inf)

    def examine(
        self, motion: EnclosedMotion, edges: Array, undecided: Mask, instant: float
    ) -> tuple[Array, Mask, Array]:
        """Enclose limits over cells; return the undecided cells, their limits, and where to cut.

        The cut is the time of a rate's sign change, s, (N,), or NaN.
        """
        width = np.diff(edges, axis=1)[:, 0]
        smallest = width <= instant
        which = tuple(np.flatnonzero(undecided.any(axis=0)).tolist())
        bounds = self._bound(motion, Cells(edges, undecided, smallest, which, self._found))
        possible, turns, self._found = bounds.possible, bounds.turns, bounds.found
        self._cells += np.count_nonzero(undecided, axis=0)
        found = np.array([one.violation for one in self._found])
        left = undecided & ~(possible <= found + CLOSE)
        stuck = left & smallest[:, None]
        self._stuck += np.sum(np.where(stuck & ~(possible <= TOLERANCE), width[:, None], 0), axis=0)
        left &= ~smallest[:, None]
        for kept, where in ((self.decided_excess, undecided & ~left), (self.open_excess, left)):
            worst = np.max(np.where(where, possible, -np.inf), axis=0, initial=-np.inf)
            np.maximum(kept, worst, out=kept)
        again = left.any(axis=1)
        places = np.sum(edges, axis=1) / 2 + turns * width / 2
        return edges[again], left[again], places[again]

    def _bound(self, motion: EnclosedMotion, cells: Cells) -> CellBounds:
        sharing = _sharing.get()
        if sharing is not None and sharing.limits is self._model:
            parts = cells.parts(sharing.count())
            if len(parts) > 1:
                return CellBounds.join(list(sharing.bound(motion, parts)))
        return bound_cells(self._enclosed, motion, cells)

    def checks(self, edges: Array, undecided: Mask) -> tuple[LimitCheck, ...]:
        """Return the checks of all limits when these cells (N, 2) stay open for limits (N, L)."""
        width = np.diff(edges, axis=1)
        left = self._stuck + np.sum(np.where(undecided, width, 0.0), axis=0)
        proved = np.maximum(self.decided_excess, self.open_excess)
        checks = []
        # A limited quantity without any value found may have any value.
        unknown = np.isfinite(proved) | (proved > 0)
        for k, (limit, best) in enumerate(zip(self._model.limits, self._found, strict=True)):
            violation = np.inf if best.row < 0 and unknown[k] else best.violation
            check = replace(
                limit_check(limit, max(best.row, 0), best.value, violation, best.time),
                proved=float(max(proved[k], best.violation)),
                cells=int(self._cells[k]),
                open_time=float(left[k]),
            )
            checks.append(check)
        return tuple(checks)


def _sides(limit: Limit, rows: list[EnclosedRow]) -> Iterator[tuple[_Side, EnclosedRow]]:
    """Yield every finite bound with its row."""
    for number, row in enumerate(rows):
        for sign, bounds in ((1.0, limit.upper), (-1.0, limit.lower)):
            if np.isfinite(bounds[number]):
                yield _Side(limit, number, sign), row


def _extremes(row: EnclosedRow, sign: float, cells: int) -> tuple[Array, Array]:
    """Return values of sign × row that are attained in each cell, and their places τ, (N,)."""
    if row.middle is not None:
        return sign * row.middle, np.zeros(cells)
    model = row.model
    candidates = [np.broadcast_to(place, cells) for place in model.extremes()]
    values = np.stack([sign * model.at(place) for place in candidates])
    chosen = np.argmax(values, axis=0)
    every = np.arange(cells)
    best = values[chosen, every] - model.radius + row.jump
    return best, np.stack(candidates)[chosen, every]
