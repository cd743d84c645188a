"""One start or hop of a search: its phases, and the exact evaluation of the motion reached."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Annotated

import numpy as np
from pydantic import BeforeValidator, ConfigDict

from constraints.arrays import Array, Mask
from expdesign.problem.design_problem import DesignProblem
from expdesign.recheck.certificate import recheck
from expdesign.recheck.evaluator import Evaluator
from expdesign.recheck.limit_check import Recheck
from expdesign.solver import interior_point
from expdesign.solver.feasibility import (
    GRID_MARGIN,
    InfeasibleLimitsError,
    RestoredMotion,
    perturb,
    random_start,
    restore_limits,
    shrink_to_limits,
)
from expdesign.solver.phases import (
    Iteration,
    Phase,
    PhaseReport,
    PhaseResult,
    StartReporter,
    coarse_points,
    continuation_phases,
    fine_points,
    hop_phases,
)
from expdesign.trajectory import FourierTrajectory, KnownHum
from expdesign.workers import Monitor

GIVEN_UP = "given up: behind what others had reached at this stage"
"""Status of a start or a hop that others have left behind."""

STATUS_TEXTS = {
    "Solve_Succeeded": "converged",
    "Solved_To_Acceptable_Level": "converged: the objective stood still",
    "Maximum_Iterations_Exceeded": "stopped after design.max_iterations; its best motion counts",
    "Maximum_CpuTime_Exceeded": "stopped at the time allowed",
    "User_Requested_Stop": "stopped before its end (Ctrl-C, or design.max_seconds)",
    "Infeasible_Problem_Detected": "no point nearby keeps the limits",
    "Restoration_Failed": "the limits could not be restored from where the solver stood",
    "Search_Direction_Becomes_Too_Small": "steps became too small",
    "Invalid_Number_Detected": "the model gave a value that is not a number",
}

_ROUNDS = 5
_FAR = 0.05
_UNCHECKED = Recheck(())
_FINER = 4
"""Points at which a start's limits are judged, per point at which they were imposed."""
_BEHIND = 0.01
"""Largest cost difference to its reference with which a hop continues before its last phase."""


def status_text(status: str) -> str:
    """Return the status of a solver, in Ipopt's terms, in words.

    Examples
    --------
    >>> status_text("Search_Direction_Becomes_Too_Small")
    'steps became too small'
    """
    return STATUS_TEXTS.get(status, status.replace("_", " ").lower())


@dataclass(frozen=True)
class SearchPlan:
    """The problem, the exact evaluation of its motions, and the settings of the search."""

    problem: DesignProblem
    evaluator: Evaluator
    starts: int
    hops: int
    """Largest number of hops after the random starts."""
    weighs_gain: bool
    """Whether hops end when they are expected to gain too little."""
    seed: int
    widths: tuple[float, ...]
    """Smoothing of dry friction, m/s, decreasing."""
    iterations: int
    """Largest number of iterations of one phase of a start."""
    controller_period: float
    """s."""
    hum: KnownHum
    """Hums that the multiples of the motion's frequency avoid."""
    workers: int
    scheduler: str | None
    """Address of a Dask cluster, instead of local workers."""
    max_seconds: float | None
    origin: FourierTrajectory | None = None
    """Motion to be improved, instead of random starts; `starts` is 1 then."""

    def generator(self, index: int) -> np.random.Generator:
        """Return the random numbers of the start or hop with this number."""
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(index,)))


@dataclass(frozen=True)
class StartResult:
    """State and statistics of a start, a hop or a finish."""

    __pydantic_config__ = ConfigDict(arbitrary_types_allowed=True)  # a journal keeps results

    index: int
    """From 1; hops continue the numbers. A finish has the number of its start."""
    kind: str
    """``"random"``, ``"origin"`` (of a motion to be improved), ``"hop"`` or ``"finish"``."""
    variables: Annotated[Array, BeforeValidator(lambda values: np.array(values, dtype=float))]
    """(z,), scaled variables that were reached; of a hop without phases those of its origin."""
    merit: float = -np.inf
    """The exact criterion, larger is better; −inf before the end, and without a motion that keeps
    the limits. A start is judged by its motion shrunk until it keeps every limit at a few hundred
    points."""
    status: str = ""
    """How it ended, in words; empty before the end."""
    converged: bool = False
    """Whether the last solve converged."""
    phases: tuple[PhaseResult, ...] = ()
    trace: tuple[Iteration, ...] = ()
    seconds: float = 0.0
    trajectory: FourierTrajectory | None = None
    """Motion of a finish."""
    check: Recheck = _UNCHECKED
    """Limits of that motion."""
    shrink: float = 1.0
    """Factor by which that motion was finally shrunk; 1: not at all."""

    @property
    def iterations(self) -> int:
        """Iterations of all phases."""
        return sum(phase.iterations for phase in self.phases)

    @property
    def rank(self) -> tuple[bool, int, bool, float]:
        """Sorting key; larger is better, among starts and hops or among finishes.

        Finished motions that are certified come first, then those that keep the limits.
        Among motions after as many phases, feasible ones come first, then the smoothed objective
        decides: objectives of different phases are not comparable. The criterion of a motion
        shrunk into its limits predicts the finished one less well: over 96 starts its rank
        correlation was 0.54, the objective's 0.89.
        """
        if self.kind == "finish":
            value = self.merit if self.check.passed else -self.check.worst
            return self.check.certified, 0, self.check.passed, value
        if not self.phases:
            return False, 0, False, -np.inf
        last, going = self.phases[-1], not self.status or self.usable
        return going, len(self.phases), last.violation <= interior_point.FEASIBLE, -last.objective

    @property
    def usable(self) -> bool:
        """Whether its motion can be finished."""
        return bool(np.isfinite(self.merit))


def run_start(
    plan: SearchPlan,
    monitor: Monitor,
    begun: StartResult,
    until: int | None = None,
    reference: tuple[PhaseResult, ...] = (),
) -> StartResult:
    """Run the remaining phases of a start or a hop.

    A start begins at a random motion, a hop at a perturbation of its origin. A request to stop
    ends it after the current phase.

    Parameters
    ----------
    until : int, optional
        Number of the last phase, from 1. By default all are run, and then the exact model judges
        the motion reached.
    reference : tuple of PhaseResult
        Phases of the origin: a hop that falls behind them is given up.
    """
    problem, reporter = plan.problem, _reporter(begun, monitor)
    schedule = continuation_phases if begun.kind == "random" else hop_phases
    phases = schedule(problem, plan.widths, plan.iterations)
    harmonics = problem.variables.harmonics
    result = begun
    if not begun.phases:
        try:
            result = replace(begun, variables=_first_motion(plan, begun, phases[0].harmonics))
        except InfeasibleLimitsError as error:
            reporter.report("done", 0, -np.inf, np.inf, str(error))
            nowhere = np.full(problem.variables.size, np.nan)
            return replace(begun, variables=nowhere, status=str(error))
    for number, phase in enumerate(phases[:until], start=1):
        if number <= len(begun.phases):
            continue
        if result.phases and monitor.stop_requested():
            break
        present = problem.with_variables(harmonics=phase.harmonics or harmonics)
        place = (number, len(phases))
        report = reporter.phase_report(phase, problem, result.iterations, place)
        x, reached = solve_phase(present, phase, result.variables, report)
        result = replace(
            result,
            variables=present.variables.extend(x, harmonics),
            converged=reached.converged,
            phases=(*result.phases, reached),
        )
        if is_hopeless(reached, reference, last=number == len(phases)):
            ended = replace(result, trace=tuple(reporter.trace), seconds=reporter.seconds)
            return give_up(plan, monitor, ended)
    result = replace(result, trace=tuple(reporter.trace), seconds=reporter.seconds)
    if until is None:
        return _judge(plan, result, reporter)
    last = result.phases[-1]
    objective = problem.cost.criterion_value(last.objective)
    reporter.report("waiting", result.iterations, objective, last.violation)
    return result


def solve_phase(
    problem: DesignProblem, phase: Phase, start: Array, report: PhaseReport
) -> tuple[Array, PhaseResult]:
    """Solve one phase from `start`, (z,); return the variables reached and the result.

    Limits are imposed at `phase.points` points, but only rows near their bounds are in the
    program. After each solve all rows are evaluated; omitted rows that are violated enter, and
    the program is solved again: from the point reached, or, if that is far out, from the last
    good one in a smaller box; each time with the remaining iterations, or a quarter of all.
    """
    if phase.criterion is not None:
        problem = problem.with_criterion(phase.criterion)
    grid = 2 * np.pi * np.arange(phase.points) / phase.points
    violations = problem.smooth_violations(start, grid, phase.width)
    mask: Mask = violations > -phase.near
    x, radius = start, phase.radius
    result = PhaseResult.start(phase)
    while result.rounds < _ROUNDS and result.iterations < phase.iterations:
        most = max(phase.iterations - result.iterations, phase.iterations // 4)
        program = problem.program(
            grid,
            mask,
            width=phase.width,
            level=phase.level,
            samples=phase.samples,
            box=(x, radius),
        )
        solution = interior_point.solve_by_interior_point(
            program,
            x,
            most=most,
            barrier=phase.barrier,
            renewed=phase.renewed,
            standstill=phase.standstill,
            report=report(result, most),
        )
        result = result.add(solution, int(np.count_nonzero(mask)))
        violations = problem.smooth_violations(solution.usable, grid, phase.width)
        broken = (violations > interior_point.FEASIBLE) & ~mask
        far = float(np.max(violations[broken], initial=0.0)) > _FAR
        if not far:
            x = solution.usable
        if not np.any(broken) or solution.status == "User_Requested_Stop":
            break
        mask = mask | broken | (violations > -phase.near)
        if far:
            radius = (phase.radius or 1.0) / 2 if radius is None else radius / 2
    violations = problem.smooth_violations(x, grid, phase.width)
    return x, replace(
        result,
        objective=problem.cost_value(x, phase.width, phase.level, phase.samples),
        violation=float(np.max(violations, initial=-np.inf)),
    )


def no_report(_done: PhaseResult, _most: int) -> None:
    """Report no iteration of a round."""


def _first_motion(plan: SearchPlan, begun: StartResult, harmonics: int | None) -> Array:
    """Return the scaled variables at which a start or a hop begins, (z,)."""
    if begun.kind == "origin":
        return begun.variables
    rng = plan.generator(begun.index)
    if begun.kind == "hop":
        return perturb(plan.problem, begun.variables, rng, plan.widths[-1])
    first = plan.problem.with_variables(harmonics=harmonics or plan.problem.variables.harmonics)
    return random_start(first, rng, coarse_points(first.variables.harmonics), plan.widths[0])


def is_hopeless(reached: PhaseResult, reference: tuple[PhaseResult, ...], *, last: bool) -> bool:
    """Return whether a hop is too far behind its reference in the same phase.

    After the last phase any lag is too much.
    """
    same_problem = attrgetter("name", "width", "level", "samples")
    alike = [one for one in reference if same_problem(one) == same_problem(reached)]
    allowed = 0.0 if last else _BEHIND
    return bool(alike) and reached.objective > alike[-1].objective + allowed


def give_up(plan: SearchPlan, monitor: Monitor, start: StartResult) -> StartResult:
    """End a start that others have left behind."""
    ended = replace(start, status=GIVEN_UP)
    report_end(plan, monitor, ended)
    return ended


def report_end(plan: SearchPlan, monitor: Monitor, start: StartResult) -> None:
    """Report the end of a start or of its rough search."""
    phase = "done" if start.status else "waiting"
    violation = start.phases[-1].violation if start.phases else np.inf
    value = start.merit if plan.evaluator.criterion.larger_is_better else -start.merit
    motion = plan.problem.variables.trajectory(start.variables) if start.usable else None
    reporter = _reporter(start, monitor)
    reporter.report(phase, start.iterations, value, violation, start.status, motion)


def _judge(plan: SearchPlan, result: StartResult, reporter: StartReporter) -> StartResult:
    """Judge the motion that a start has reached by the exact model.

    The grid is finer than the one on which the limits were imposed, but coarser than the finish's:
    that would take a sixth of the search's time and hardly predict the finish better.
    """
    problem, last = plan.problem, result.phases[-1]
    status, merit = status_text(last.status), -np.inf
    trajectory = problem.variables.trajectory(result.variables)
    points = _FINER * fine_points(problem.variables.harmonics)
    feasible = shrink_to_limits(problem, trajectory, points=points)
    if not feasible.kept:
        feasible = restore_limits(problem, result.variables, GRID_MARGIN, last.width, points)
    if feasible.kept:
        merit = plan.evaluator.merit(feasible.trajectory, problem.cost.samples)
    if not np.isfinite(merit):
        status += f"; {_why_useless(problem, feasible)}"
    value = merit if plan.evaluator.criterion.larger_is_better else -merit
    motion = feasible.trajectory if np.isfinite(merit) else None
    reporter.report("done", result.iterations, value, max(last.violation, 0.0), status, motion)
    return replace(result, merit=merit, status=status, seconds=reporter.seconds)


def _why_useless(problem: DesignProblem, motion: RestoredMotion) -> str:
    if motion.kept:
        return "its motion does not excite every parameter"
    check = recheck(problem.limits, motion.trajectory)
    worst = max(check.limits, key=lambda limit: limit.violation)
    return (
        f"by the unsmoothed model its motion breaks {worst.key}, even shrunk to {motion.factor:g} "
        "of its size"
    )


def _reporter(start: StartResult, monitor: Monitor) -> StartReporter:
    """Return the reporter that continues the trace and the time of a start."""
    began = time.perf_counter() - start.seconds
    return StartReporter(monitor, start.index, start.kind, list(start.trace), began)
