"""One stage of the continuation: a program of limit rows that are added where they must."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from constraints.arrays import Array, Mask
from expdesign.information.spectral import Criterion
from expdesign.problem.design_problem import DesignProblem
from expdesign.solver.interior_point import STANDSTILL, Standstill, solve_by_interior_point
from expdesign.solver.ipopt import IPOPT_OPTIONS, solve_with_ipopt
from expdesign.solver.solution import FEASIBLE, Solution
from expdesign.workers import Monitor

_OFTEN = 0.05
"""Time between two reports of iterations, s: to take them in costs time."""
_ROUNDS = 5
_FAR = 0.05

STAGE_TITLES = {
    "blunt": "rough search",
    "sharp": "refinement",
    "finish": "finish",
}
"""What people call a stage of a search, by its name in files."""


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


@dataclass(frozen=True)
class TracePoint:
    """One iteration, for the convergence figure: objective as it is reported, violation."""

    stage: str
    iteration: int
    objective: float
    violation: float


ENDS = ("waiting", "done", "finished")
"""Phases of events that end something."""


@dataclass(frozen=True)
class SearchEvent:
    """One iteration, or the end, of one start."""

    start: int
    """Number of the start, from 1; hops go on counting."""
    phase: str
    """``"blunt"``, then ``"waiting"`` for the other starts, ``"sharp"``; then ``"done"``; for
    some ``"finish"``, then ``"finished"``."""
    iteration: int
    objective: float
    """The criterion in the units in which it is reported (log det F for ``d``): smoothed, and that
    of the unsmoothed model when it is done or finished."""
    violation: float
    """Largest violation of the limits in the NLP, as a share of their range."""
    seconds: float
    status: str = ""
    """Empty while it runs; then how it ended."""
    place: tuple[int, int] = (1, 1)
    """Number of the stage, from 1, and how many the start has; of the finish its rounds."""
    of_round: tuple[int, int] = (0, 0)
    """Number of the iteration in its round of the stage, and how many that has at most; 0: not
    known."""
    share: float = 0.0
    """How much of the start, or of the finish, is done, 0 … 1: by the iterations that it has at
    most."""


@dataclass
class Watch:
    """Reports the iterations of one start, and keeps them for the convergence figure."""

    monitor: Monitor
    start: int
    trace: list[TracePoint] = field(default_factory=list)
    began: float = field(default_factory=time.perf_counter)
    told: float = -np.inf
    """When it reported an iteration for the last time."""

    @property
    def seconds(self) -> float:
        """Time since it began, s."""
        return time.perf_counter() - self.began

    def tell(
        self, phase: str, iteration: int, objective: float, violation: float, status: str = ""
    ) -> None:
        """Report one iteration, or the end."""
        self.monitor.report(
            SearchEvent(self.start, phase, iteration, objective, violation, self.seconds, status)
        )

    def of_stage(
        self, stage: Stage, problem: DesignProblem, before: int = 0, place: tuple[int, int] = (1, 1)
    ) -> Report:
        """Return what reports the iterations of a stage, after those that were `before` it.

        `place` is the stage's number, from 1, among those of the start, and how many there are.
        """
        cost = problem.cost
        if stage.criterion is not None:
            cost = problem.with_criterion(stage.criterion).cost

        def report(step: Step, value: float, violation: float) -> bool:
            readable = cost.readable(value)
            point = TracePoint(stage.name, before + step.iteration, readable, violation)
            if stage.criterion is None:
                # Another criterion's numbers are shown while it runs, and kept out of the trace.
                self.trace.append(point)
            now = time.perf_counter()
            if now - self.told < _OFTEN:
                return not self.monitor.stop_requested()
            self.told = now
            number, count = place
            done = min(step.iteration / stage.iterations, 1.0)
            if stage.rounds:
                number, count, done = step.round, stage.rounds, step.in_round / step.most
            self.monitor.report(
                SearchEvent(
                    self.start,
                    stage.name,
                    point.iteration,
                    readable,
                    violation,
                    self.seconds,
                    place=(number, count),
                    of_round=(step.in_round, step.most),
                    share=(number - 1 + done) / count,
                )
            )
            return not self.monitor.stop_requested()

        return report


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
