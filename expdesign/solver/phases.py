"""x."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from constraints.arrays import Array, Mask
from expdesign.information.criteria import CRITERIA, Criterion
from expdesign.problem.design_problem import DesignProblem
from expdesign.solver.interior_point import (
    FEASIBLE,
    RENEWED,
    STANDSTILL,
    Solution,
    Standstill,
    solve_by_interior_point,
)
from expdesign.solver.ipopt import IPOPT_OPTIONS, solve_with_ipopt

_ROUNDS = 5

_FAR = 0.05


@dataclass(frozen=True)
class Step:
    """An iteration of a stage, which solves in rounds."""

    iteration: int
    """Its number, counted over the rounds of the stage."""
    round: int
    """From 1."""
    in_round: int
    """Its number in this round."""
    most: int
    """Iterations that this round has at most."""


Report = Callable[[Step, float, float], bool]
"""(iteration, cost, violation) → go on?"""


@dataclass(frozen=True)
class Stage:
    """Settings of one stage."""

    name: str
    width: float
    """Smoothing of dry friction, m/s."""
    level: float
    """Sharpness of the criterion's surrogate."""
    samples: int
    """Of one period, in the cost."""
    points: int
    """Of one period, at which limits are held."""
    near: float
    """Rows closer to their bounds than this share of their range enter the NLP at once."""
    radius: float | None
    """Half-width of the box about the stage's start, in scaled variables."""
    iterations: int
    solver: Literal["interior point", "ipopt"] = "interior point"
    barrier: float = 0.1
    """Of the interior point method, at its beginning."""
    renewed: int | None = None
    """Iterations that share the cost's own Hessian in the interior point method; None: all."""
    standstill: Standstill = STANDSTILL
    """Where the interior point method ends."""
    criterion: Criterion | None = None
    """Where it is not the problem's own."""
    harmonics: int | None = None
    """Where they are fewer than the problem's."""
    rounds: int = 0
    """How many solves it has at most, each with all iterations; 0: they share them."""


@dataclass
class StageRecord:
    """What one stage did: settings, statistics of its solves and how the last one ended."""

    name: str
    width: float
    level: float
    samples: int
    rows: int = 0
    rounds: int = 0
    iterations: int = 0
    evaluations: dict[str, int] = field(default_factory=dict)
    seconds: float = 0.0
    status: str = ""
    converged: bool = False
    objective: float = np.nan
    violation: float = np.nan

    @classmethod
    def of(cls, stage: Stage) -> StageRecord:
        """Return the record of a stage that has not begun."""
        return cls(stage.name, stage.width, stage.level, stage.samples)

    def add(self, result: Solution, rows: int) -> None:
        """Count one solve."""
        self.rounds += 1
        self.rows = rows
        self.iterations += result.iterations
        self.seconds += result.seconds
        self.status, self.converged = result.status, result.converged
        for key, value in result.evaluations.items():
            self.evaluations[key] = self.evaluations.get(key, 0) + value


@dataclass
class _Best:
    """The best iterate of one solve: the lowest cost among those that keep the rows."""

    x: Array
    cost: float = np.inf
    violation: float = np.inf

    def offer(self, x: Array, cost: float, violation: float) -> None:
        if not np.isfinite(cost):
            return
        kept, was_kept = violation <= FEASIBLE, self.violation <= FEASIBLE
        better = cost < self.cost if kept and was_kept else violation < self.violation
        if (kept and not was_kept) or better:
            self.x, self.cost, self.violation = x.copy(), cost, violation


def run_stage(
    problem: DesignProblem, stage: Stage, start: Array, report: Report
) -> tuple[Array, StageRecord]:
    """Solve one stage from `start`; return the variables reached and the record.

    Limits are held at `stage.points` points, but only rows near their bounds are in the NLP.
    After each solve all rows are evaluated; those that were left out and are broken enter, and
    the NLP is solved again: from the point reached, or, if that is far out, from the last good
    one in a smaller box; each time with the iterations that are left, or a quarter of them.
    """
    if stage.criterion is not None:
        problem = problem.with_criterion(stage.criterion)
    phases = 2 * np.pi * np.arange(stage.points) / stage.points
    violations = problem.smooth_violations(start, phases, stage.width)
    mask: Mask = violations > -stage.near
    x, radius = start, stage.radius
    record = StageRecord.of(stage)
    while record.rounds < _ROUNDS and record.iterations < stage.iterations:
        most = max(stage.iterations - record.iterations, stage.iterations // 4)
        reached, status = solve_rows(
            problem, stage, (phases, mask, None), (x, radius), record, report, most=most
        )
        violations = problem.smooth_violations(reached, phases, stage.width)
        broken = (violations > FEASIBLE) & ~mask
        far = float(np.max(violations[broken], initial=0.0)) > _FAR
        if not far:
            x = reached
        if not np.any(broken) or status == "User_Requested_Stop":
            break
        mask = mask | broken | (violations > -stage.near)
        if far:
            radius = (stage.radius or 1.0) / 2 if radius is None else radius / 2
    violations = problem.smooth_violations(x, phases, stage.width)
    record.objective = problem.cost_value(x, stage.width, stage.level, stage.samples)
    record.violation = float(np.max(violations, initial=-np.inf))
    return x, record


def solve_rows(
    problem: DesignProblem,
    stage: Stage,
    rows: tuple[Array, Mask, Array | None],
    start: tuple[Array, float | None],
    record: StageRecord,
    report: Report,
    *,
    most: int,
) -> tuple[Array, str]:
    """Solve once and add it to the record; return the variables reached and the status.

    Where it does not converge, its best iterate counts, not its last.

    Parameters
    ----------
    rows : ((K,), (K, R), (K, R) or None)
        Phases, which limit holds at which of them, and margins.
    start : ((z,), float or None)
        Where to begin, and the half-width of the box about it.
    most : int
        Most iterations.
    """
    (phases, mask, margins), (x, radius) = rows, start
    program = problem.program(
        phases,
        mask,
        width=stage.width,
        level=stage.level,
        samples=stage.samples,
        margins=margins,
    ).within(x, radius)
    best, done, rounds = _Best(x), record.iterations, record.rounds

    def watch(number: int, objective: float, violation: float, at: Array) -> bool:
        best.offer(at, objective, violation)
        # The solvers show the start, too, before its first iteration.
        step = Step(done + number, rounds + 1, min(number, most), most)
        return report(step, objective, violation)

    if stage.solver == "ipopt":
        options = {**IPOPT_OPTIONS, "max_iter": most}
        result = solve_with_ipopt(
            program, x, options=options, curvature="limited-memory", report=watch
        )
    else:
        result = solve_by_interior_point(
            program,
            x,
            most=most,
            barrier=stage.barrier,
            renewed=stage.renewed,
            standstill=stage.standstill,
            report=watch,
        )
    record.add(result, int(np.count_nonzero(mask)))
    return (result.x if result.converged else best.x), result.status


MOST_BLUNT_HARMONICS = 5
"""Harmonics of the first stage at most: with many it was seen to get stuck far from the best."""

_EVERYTHING = 10.0
_NEAR = 0.15
_RADIUS = 0.6
_THROWN = 0.03
"""First barrier of a hop: the larger, the farther from where it was thrown it may end."""
_SETTLED = 1e-3
"""At the beginning of a stage near its optimum: from 0.01 it goes far away and comes back."""
_ROUGH = Standstill(1e-3, 3)
"""A third of the iterations less, and refinements end where they did (47 starts)."""
_FINISH_NEAR = 0.1
_FINISH_RADIUS = 0.2
_LAST_NEAR, _LAST_RADIUS = 0.03, 0.05
"""Of Ipopt's round. In a larger box it wanders off, to where rows that were left out are broken;
with three times the rows its linear algebra takes three times as long (measured). For five
harmonics; with more a step of the same size changes accelerations more, and more rows are near."""
_FINISHED = 1e-4
"""First barrier of the finish, which sets out from an optimum: as `_SETTLED`."""


def coarse_points(harmonics: int) -> int:
    """Points per period that resolve the limited quantities well enough for a blunt stage."""
    return 8 * harmonics + 8


def fine_points(harmonics: int) -> int:
    """Points per period for the sharp stages and the finish."""
    return 16 * harmonics + 20


def continuation_stages(
    problem: DesignProblem, widths: Sequence[float], iterations: int
) -> list[Stage]:
    """Return the stages of one start.

    The first one holds every limit on a coarse grid with blunt friction: it finds the basin. The
    others start from its result, so that only rows near their bounds need to be in the NLP.
    With many harmonics the first stage has only some of them; the others start from zero, and the
    next stage holds every limit too: the others move far before any of them is near its bound.
    The first stage of a criterion that is flat where a parameter is hardly excited maximises
    log det F instead; from there the condition number's optimum is out of reach (measured). A
    criterion with a surrogate is sharpened over the others; its last levels follow at the last
    width. `widths` of the smoothing of dry friction, m/s, decrease.
    """
    n, samples = problem.variables.harmonics, problem.cost.samples
    few = min(n, MOST_BLUNT_HARMONICS)
    levels = problem.criterion.levels
    coarse, fine = coarse_points(n), fine_points(n)
    flat = problem.criterion.flat
    # Criteria that depend on the scaling have a long way to go: one more stage on the first level.
    levels = levels if problem.criterion.invariant else (levels[0], *levels)
    # With few harmonics first, the next stage is on the coarse grid: one more on the fine one.
    count = max(len(widths), len(levels), 3 if few < n else 2)
    stages = [
        Stage(
            name="blunt",
            width=widths[0],
            level=levels[0],
            samples=min(samples, coarse_points(few)),
            points=coarse_points(few),
            near=_EVERYTHING,
            radius=None,
            iterations=iterations,
            renewed=RENEWED,
            standstill=_ROUGH,
            criterion=CRITERIA["d"] if flat else None,
            harmonics=few if few < n else None,
        )
    ]
    for k in range(1, count):
        # The grid goes from coarse to fine, the rows from many to those near their bounds.
        share = min(k, len(widths) - 1) / (len(widths) - 1) if len(widths) > 1 else 1.0
        points = round(coarse + share * (fine - coarse))
        near = _NEAR * (2 - share)
        if k == 1 and few < n:
            points, near = coarse, _EVERYTHING
        stages.append(
            Stage(
                name="sharp",
                width=widths[min(k, len(widths) - 1)],
                level=levels[min(k, len(levels) - 1)],
                samples=min(samples, points),
                points=points,
                near=near,
                radius=_RADIUS,
                iterations=iterations,
                barrier=_SETTLED,
            )
        )
    return stages


def hop_stages(problem: DesignProblem, widths: Sequence[float], iterations: int) -> list[Stage]:
    """Return the stages of one hop: those of a start, with fewer iterations.

    The first one holds every limit: thrown into its limits, a motion has none near its bound, and
    with few rows the solver runs out of all the others at once (measured).
    """
    n, samples = problem.variables.harmonics, problem.cost.samples
    first, *others = continuation_stages(problem, widths, max(10, iterations // 2))
    coarse = coarse_points(n)
    thrown = replace(
        first,
        points=coarse,
        samples=min(samples, coarse),
        barrier=_THROWN,
        harmonics=None,
    )
    return [thrown, *others]


def finish_stage(problem: DesignProblem, widths: Sequence[float], iterations: int) -> Stage:
    """Return the settings of each round of the finish: a small box, the sharpest smoothing.

    Twice as many samples in the cost as in the stage before: they say better which of several
    motions will be the best (measured).
    """
    n = problem.variables.harmonics
    points = fine_points(n)
    return Stage(
        name="finish",
        width=widths[-1],
        level=problem.criterion.levels[-1],
        samples=min(problem.cost.samples, 2 * points),
        points=points,
        near=_FINISH_NEAR,
        radius=_FINISH_RADIUS,
        iterations=max(10, iterations // 4),
        barrier=_FINISHED,
    )


def last_stage(stage: Stage, harmonics: int) -> Stage:
    """Return the settings of Ipopt's round, which sets out from what the rounds before found."""
    share = min(1.0, 5 / harmonics)
    return replace(stage, solver="ipopt", near=share * _LAST_NEAR, radius=share * _LAST_RADIUS)
