"""The finish of a design: whole controller steps, and every limit kept between the samples.

The optimiser holds smoothed limits at some points. Here the frequency is moved so that a period
is a whole number of controller steps, and the coefficients are solved again at that ω with
margins where the unsmoothed model, on a fine grid, is beyond the smoothed one. What little is
left over is put right by the least change of the coefficients (`expdesign.solver.feasibility`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array, Mask
from expdesign.problem.design_problem import DesignProblem, hidden_by_smoothing
from expdesign.recheck.certificate import recheck
from expdesign.recheck.information import Evaluator
from expdesign.recheck.limit_check import (
    TOLERANCE,
    Recheck,
    grid_points,
    local_worst,
    worst_sampled,
)
from expdesign.solver.events import TracePoint
from expdesign.solver.feasibility import GRID_MARGIN, LARGEST_MARGIN, brought_within
from expdesign.solver.phases import Report, Stage, StageRecord, last_stage, solve_rows
from expdesign.trajectory import FourierTrajectory

_CHECKS = 4
_WORTHWHILE = 2e-3


@dataclass(frozen=True)
class Finished:
    """A trajectory that was checked, and the factor it was shrunk by at last; 1: not at all."""

    trajectory: FourierTrajectory
    check: Recheck
    shrink: float
    record: StageRecord | None = None
    trace: tuple[TracePoint, ...] = ()


FARTHEST = 0.05
"""Share of a period by which it is changed at most to keep away from a hum."""


def controller_omega(
    omega: float, bounds: tuple[float, float], step: float, hum: KnownHum | None = None
) -> tuple[float, int]:
    """Return the nearest ω within the bounds whose period is a whole number of steps, and how many.

    The nearest that keeps its multiples away from a hum, where there is one within `FARTHEST`.
    Raises `ValueError` where no whole number fits between the bounds.
    """
    slack = 1e-12
    fewest = int(np.ceil(2 * np.pi / (bounds[1] * step) * (1 - slack)))
    most = int(np.floor(2 * np.pi / (bounds[0] * step) * (1 + slack)))
    if fewest > most:
        raise ValueError("no period within the frequency bounds is a whole number of steps")
    steps = int(np.clip(np.rint(2 * np.pi / (omega * step)), fewest, most))
    if hum is not None and hum.frequencies:
        reach = int(FARTHEST * steps)
        near = np.arange(max(fewest, steps - reach), min(most, steps + reach) + 1)
        near = near[hum.avoided(step * near.astype(np.float64))]
        if len(near):
            steps = int(near[np.argmin(np.abs(near - 2 * np.pi / (omega * step)))])
    return 2 * np.pi / (steps * step), steps


def finish(
    problem: DesignProblem,
    evaluator: Evaluator,
    start: Array,
    stage: Stage,
    *,
    rounds: int,
    report: Report,
    proving: bool = True,
    settled: bool = False,
) -> Finished:
    """Bring a solution within the limits between the samples as well.

    Both bounds of ω in the problem are the value wanted; `start` has scaled variables, (z,). Each
    of at most `rounds` is a solve with the stage's settings; the evaluator decides which of their
    trajectories is the best. With `proving` limits are proved after each, and the last solve is
    Ipopt's; without it they are looked at on the fine grid, to compare motions with one another.
    What was finished before without a proof is `settled`: the first solve may be the last.
    """
    x = start.copy()
    x[-1] = problem.variables.bounds()[0][-1]
    # What is settled is proved only where Ipopt's round does not lead to something better.
    proved = proving and not (settled and rounds)
    best, exact = _checked(problem, x, stage.width, proving=proved)
    candidate, kept = best, x
    best_merit = evaluator.merit(best.trajectory, problem.cost.samples)
    record, last_merit = StageRecord.of(stage), best_merit
    # Worst moments of earlier rounds stay: without their rows what they held comes back.
    seen: NDArray[np.bool_] = np.zeros(
        (grid_points(problem.cost.samples), len(problem.limits.keys)), dtype=bool
    )
    for number in range(1, rounds + 1):
        last = number == rounds or settled
        # Each round has all of the stage's iterations: the rows and their margins are new. Ipopt,
        # from the optimum of a program that is not quite the same, needs twice as many at times.
        ipopt = proving and last
        present = last_stage(stage, problem.variables.harmonics) if ipopt else stage
        x, status = solve_rows(
            problem,
            present,
            _critical_rows(problem, x, exact, present, candidate.check, seen),
            (x, present.radius),
            record,
            report,
            most=(1 + ipopt) * stage.iterations,
        )
        candidate, exact = _checked(problem, x, stage.width, proving=proving)
        merit = evaluator.merit(candidate.trajectory, problem.cost.samples)
        gain = evaluator.gain(merit, best_merit)
        if proving and not proved and (gain <= 0 or not candidate.check.certified):
            (best, _), proved = _checked(problem, kept, stage.width, proving=True), True
            best_merit = evaluator.merit(best.trajectory, problem.cost.samples)
            gain = evaluator.gain(merit, best_merit)
        standing, before = (
            (check.certified, check.passed) for check in (candidate.check, best.check)
        )
        if standing > before or (standing == before and candidate.check.passed and gain > 0):
            best, best_merit, kept, proved = candidate, merit, x, proving
        # A round that falls back shows rows and margins that the next one puts right (measured).
        good = best.check.certified if proving else best.check.passed
        if number == rounds or (last and good) or status == "User_Requested_Stop":
            break
        settled = good and abs(evaluator.gain(merit, last_merit)) < _WORTHWHILE
        if settled and not proving:
            break
        last_merit = merit
    if record.rounds == 0:
        return best
    record.objective = problem.cost_value(kept, stage.width, stage.level, stage.samples)
    record.violation = best.check.worst
    return replace(best, record=record)


def _critical_rows(
    problem: DesignProblem,
    x: Array,
    exact: Array,
    stage: Stage,
    check: Recheck,
    seen: NDArray[np.bool_],
) -> tuple[Array, NDArray[np.bool_], Array]:
    """Choose the instants that matter, with margins: (K,), (K, R), (K, R).

    Instants are a regular grid, every local worst of the unsmoothed limits on the fine grid, and
    the worst moments that the proof of the last motion has found where the grid shows none: rows
    that say almost the same twice would only make the program harder. Those of the fine grid are
    added to `seen`, (points, R), and all that it has are taken.
    A row's margin is what the unsmoothed value exceeds the smoothed one by, anywhere within one
    step of the regular grid: that covers the jumps of dry friction where a sign changes. `exact`,
    (points, R), are the unsmoothed violations on the fine grid.
    """
    points = len(exact)
    fine = 2 * np.pi * np.arange(points) / points
    reach = max(1, points // stage.points)
    hidden = hidden_by_smoothing(
        problem.limits, problem.states(x, fine), exact, stage.width, reach, periodic=True
    )
    peaks = local_worst(exact, periodic=True) & (exact > -stage.near / 3)
    regular = np.zeros(points, dtype=bool)
    regular[:: max(1, points // (2 * stage.points))] = True
    near = (exact > -stage.near) & np.isfinite(exact)
    seen |= peaks
    used = (regular[:, None] & near) | seen
    chosen = np.any(used, axis=1)
    moments, rows = _worst_moments(problem, check, stage.near)
    nearest = np.rint(moments * points / (2 * np.pi)).astype(np.intp) % points
    beside = used | np.roll(used, 1, axis=0) | np.roll(used, -1, axis=0)
    unseen = np.any(rows & ~beside[nearest], axis=1)
    moments, rows, nearest = moments[unseen], rows[unseen], nearest[unseen]
    margins = np.minimum(hidden + 2 * GRID_MARGIN, LARGEST_MARGIN)
    return (
        np.concatenate([fine[chosen], moments]),
        np.concatenate([used[chosen], rows]),
        np.concatenate([margins[chosen], margins[nearest]]),
    )


def _worst_moments(
    problem: DesignProblem, check: Recheck, near: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the phases (J,) at which limits of a judged motion are worst, and the rows (J, R).

    Of limits that are closer to their bounds than a share of their range.
    """
    limits, omega = problem.limits, problem.variables.omega_bounds[0]
    judged = zip(limits.limits, limits.columns, check.limits, strict=True)
    found = [
        (omega * one.time, columns.start + limit.labels.index(one.row))
        for limit, columns, one in judged
        if -near < one.violation < np.inf
    ]
    rows = np.zeros((len(found), len(limits.keys)), dtype=bool)
    rows[range(len(found)), [column for _, column in found]] = True
    return np.array([phase for phase, _ in found]), rows


def _checked(
    problem: DesignProblem, x: Array, width: float, *, proving: bool
) -> tuple[Finished, Array]:
    """Change it until every limit is proved to be kept at every instant, or kept on the fine grid.

    A limit of which nothing can be proved, or not within the budget, counts with what was found.
    What the motion breaks on the fine grid before it is changed, (points, R), comes back, too.
    """
    margin = GRID_MARGIN
    for _ in range(_CHECKS):
        kept = brought_within(problem, x, margin, width)
        if not proving:
            times = kept.trajectory.sample_times(grid_points(problem.cost.samples))
            check = Recheck(worst_sampled(problem.limits, times, kept.values))
            break
        check = recheck(problem.limits, kept.trajectory)
        if check.certified or not kept.kept or not TOLERANCE < check.possible < np.inf:
            break
        margin += 2 * check.possible
    return Finished(kept.trajectory, check, kept.factor), kept.before


_ROUNDING = 1e-9


@dataclass(frozen=True)
class HumDistance:
    """A hum and the multiple of a motion's frequency that is next to it."""

    frequency: float
    """Of the hum, Hz."""
    multiple: int
    distance: float
    """Hz, without a sign."""
    lines: float
    """The same in lines of the record."""

    @property
    def kept(self) -> bool:
        """True when it is one line of the record away, or more."""
        return self.lines >= 1 - _ROUNDING


@dataclass(frozen=True)
class KnownHum:
    """Frequencies that hum, and the number of periods of the record that they disturb."""

    frequencies: tuple[float, ...]
    """Hz."""
    periods: float

    def distances(self, omega: float) -> tuple[HumDistance, ...]:
        """Return how near each is to a multiple of ω, rad/s."""
        base = omega / (2 * np.pi)
        found = []
        for frequency in self.frequencies:
            turns = frequency / base
            off = abs(turns - round(turns))
            found.append(HumDistance(frequency, round(turns), off * base, off * self.periods))
        return tuple(found)

    def avoided(self, periods: Array) -> Mask:
        """Tell which lengths of a period, (K,), s, keep every hum a line away: (K,) of bool."""
        turns = np.multiply.outer(periods, np.array(self.frequencies))
        off = np.abs(turns - np.round(turns)) * self.periods
        return np.asarray(np.all(off >= 1 - _ROUNDING, axis=1))
