"""What worker processes do: starts, hops and finishes."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np

from constraints.arrays import Array
from expdesign.problem.design_problem import DesignProblem
from expdesign.recheck.certificate import recheck
from expdesign.recheck.information import Evaluator
from expdesign.solver.events import TracePoint, Watch
from expdesign.solver.feasibility import (
    GRID_MARGIN,
    InfeasibleLimitsError,
    Shrunk,
    brought_within,
    perturbed,
    random_start,
    shrink_to_limits,
)
from expdesign.solver.finish import Finished, KnownHum, controller_omega, finish
from expdesign.solver.interior_point import FEASIBLE
from expdesign.solver.phases import (
    Stage,
    StageRecord,
    coarse_points,
    continuation_stages,
    fine_points,
    finish_stage,
    hop_stages,
    run_stage,
)
from expdesign.workers import Monitor

_FINISH_ROUNDS = 4
_MOST_AGAIN = 4
"""Times that the best motion is refined and finished again at most."""
_GAINED = 1e-4
"""Gain per parameter, as a logarithm, for which this goes on."""


@dataclass(frozen=True)
class SearchPlan:
    """How to search."""

    starts: int
    hops: int
    """After the random starts; 0: none."""
    seed: int
    widths: tuple[float, ...]
    """Smoothing of dry friction, m/s, falling."""
    iterations: int
    """At most, of a start's first stage."""
    controller_period: float
    """s."""
    hum: KnownHum
    """What the finished frequency keeps away from."""
    workers: int
    scheduler: str | None
    """Address of a Dask cluster, instead of the workers."""
    max_seconds: float | None


@dataclass(frozen=True)
class DesignTask:
    """What every worker process needs: the problem, the evaluator of its motions, and the plan."""

    problem: DesignProblem
    evaluator: Evaluator
    plan: SearchPlan


Build = Callable[[], DesignTask]
"""Builds the task inside a worker; picklable."""


@dataclass(frozen=True)
class Candidate:
    """A finished motion, what it is worth, and where it came from."""

    merit: float
    """The judged criterion, larger is better."""
    finished: Finished
    start: StartResult

    @property
    def rank(self) -> tuple[bool, bool, float]:
        """Larger is better: what is certified before what passed, both by merit, then the rest."""
        check = self.finished.check
        return check.certified, check.passed, self.merit if check.passed else -check.worst


def rough_job(task: DesignTask, monitor: Monitor, index: int) -> StartResult:
    """Draw a motion and run its rough search."""
    problem, plan = task.problem, task.plan
    stages = continuation_stages(problem, plan.widths, plan.iterations)
    watch = Watch(monitor, index)
    first = problem.with_variables(harmonics=stages[0].harmonics or problem.variables.harmonics)
    points = coarse_points(first.variables.harmonics)
    try:
        start = random_start(first, _rng(plan.seed, index), points, plan.widths[0])
    except InfeasibleLimitsError as error:
        # No shrinking brings it within the limits.
        watch.tell("done", 0, -np.inf, np.inf, str(error))
        nowhere = np.full(problem.variables.size, np.nan)
        return StartResult(index, "random", nowhere, status=str(error))
    result = run_stages(problem, stages, StartResult(index, "random", start), monitor, until=1)
    reached = result.stages[-1]
    watch.tell(
        "waiting", result.iterations, problem.cost.readable(reached.objective), reached.violation
    )
    return result


def refined_job(task: DesignTask, monitor: Monitor, begun: StartResult) -> StartResult:
    """Run the refinements of a start."""
    problem, plan = task.problem, task.plan
    stages = continuation_stages(problem, plan.widths, plan.iterations)
    reached = run_stages(problem, stages, begun, monitor)
    return judged(problem, task.evaluator, reached, monitor)


def hop_job(task: DesignTask, monitor: Monitor, index: int, origin: StartResult) -> StartResult:
    """Throw a motion out of its basin, and run the stages of a start from there."""
    problem, plan = task.problem, task.plan
    rng = _rng(plan.seed, index)
    thrown = perturbed(problem, origin.variables, rng, plan.widths[-1])
    reached = run_stages(
        problem,
        hop_stages(problem, plan.widths, plan.iterations),
        StartResult(index, "hop", thrown),
        monitor,
        screening=Screening(origin.stages),
    )
    return judged(problem, task.evaluator, reached, monitor)


def finish_job(
    task: DesignTask,
    monitor: Monitor,
    index: int,
    variables: Array,
    *,
    proving: bool = False,
    settled: bool = False,
) -> tuple[float, Finished]:
    """Finish what a start reached; return what it is worth, too.

    Most motions are only compared with others: see `proving` and `settled` of `finish`.
    """
    problem, plan = task.problem, task.plan
    watch = Watch(monitor, index)
    omega = problem.variables.trajectory(variables).omega
    bounds = problem.variables.omega_bounds
    if bounds[0] < bounds[1]:
        omega, _ = controller_omega(omega, bounds, plan.controller_period, plan.hum)
    fixed = problem.with_variables(omega_bounds=(omega, omega))
    stage = finish_stage(problem, plan.widths, plan.iterations)
    report = watch.of_stage(replace(stage, rounds=_FINISH_ROUNDS), problem)
    rounds = 0 if monitor.stop_requested() else _FINISH_ROUNDS
    finished = finish(
        fixed,
        task.evaluator,
        variables,
        stage,
        rounds=rounds,
        report=report,
        proving=proving,
        settled=settled,
    )
    merit = task.evaluator.merit(finished.trajectory, problem.cost.samples)
    value = merit if task.evaluator.criterion.larger_is_better else -merit
    where = "" if proving else " on the fine grid"
    status = f"every limit kept{where}" if finished.check.passed else "a limit is broken"
    watch.tell("finished", len(watch.trace), value, finished.check.worst, status)
    return merit, replace(finished, trace=tuple(watch.trace))


def proof_job(
    task: DesignTask, monitor: Monitor, index: int, finished: Finished
) -> tuple[float, Finished]:
    """Finish once more what was finished without a proof, and prove it.

    Where what became better by that cannot be proved, what it was before is.
    """
    again = finished
    if task.plan.hops:  # a search without them is to be short
        again = _finished_again(task, monitor, index, finished)
    merit, proved = _proof(task, monitor, index, again)
    if again is not finished and not (proved.check.certified or monitor.stop_requested()):
        before = _proof(task, monitor, index, finished)
        if before[1].check.certified:
            return before
    return merit, proved


def _proof(
    task: DesignTask, monitor: Monitor, index: int, finished: Finished
) -> tuple[float, Finished]:
    variables = task.problem.variables.pack(finished.trajectory)
    settled = finished.record is not None and finished.record.converged
    return finish_job(task, monitor, index, variables, proving=True, settled=settled)


def _finished_again(task: DesignTask, monitor: Monitor, index: int, finished: Finished) -> Finished:
    """Refine and finish what was finished again, as long as it becomes better.

    The refinement's box is larger, and it holds no margins: it leaves where a finish got stuck.
    """
    problem, plan = task.problem, task.plan
    own = finish_stage(problem, plan.widths, plan.iterations)
    last = continuation_stages(problem, plan.widths, plan.iterations)[-1]
    last = replace(last, name=own.name, samples=own.samples)
    report = Watch(monitor, index).of_stage(last, problem)
    merit = task.evaluator.merit(finished.trajectory, problem.cost.samples)
    for _ in range(_MOST_AGAIN):
        x, _ = run_stage(problem, last, problem.variables.pack(finished.trajectory), report)
        if monitor.stop_requested():
            break
        reached, again = finish_job(task, monitor, index, x)
        gains = task.evaluator.gain(reached, merit) > _GAINED or not finished.check.passed
        if not (again.check.passed and gains):
            break
        merit, finished = reached, again
    return finished


def _rng(seed: int, index: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,)))


_FINER = 4
"""Points that a start's limits are judged at, for one that they were held at."""
_BEHIND = 0.01
"""Cost by which a hop may be behind before its last stage."""


@dataclass(frozen=True)
class StartResult:
    """What one start (or hop) has reached, and how it ended; without stages: where it sets out."""

    index: int
    """From 1; hops go on counting."""
    kind: str
    """``"random"`` or ``"hop"``."""
    variables: Array
    """(z,), scaled, that were reached; before the first stage those of its harmonics."""
    merit: float = -np.inf
    """The judged criterion, larger is better, of the motion shrunk until it keeps every limit at a
    few hundred points; −inf when it cannot be, or has not been."""
    status: str = ""
    """How it ended, in words; empty while stages are left."""
    converged: bool = False
    stages: tuple[StageRecord, ...] = ()
    trace: tuple[TracePoint, ...] = ()
    seconds: float = 0.0

    @property
    def iterations(self) -> int:
        """Iterations of all stages."""
        return sum(stage.iterations for stage in self.stages)

    @property
    def rank(self) -> tuple[bool, int, bool, float]:
        """Larger is better.

        Of motions after as many stages what keeps its rows comes first, then the smoothed objective
        decides: that of another stage is another number. What is left of the criterion in a motion
        shrunk into its limits says less about the finished one: over 96 starts its rank correlation
        was 0.54, the objective's 0.89.
        """
        if not self.stages:
            return False, 0, False, -np.inf
        last, going = self.stages[-1], not self.status or self.usable
        return going, len(self.stages), last.violation <= FEASIBLE, -last.objective

    @property
    def usable(self) -> bool:
        """Whether its motion can be finished."""
        return bool(np.isfinite(self.merit))


GIVEN_UP = "given up: behind what others had reached at this stage"
"""How a start or a hop ended that was not worth going on."""

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


def status_text(status: str) -> str:
    """Return the status of a solver, in Ipopt's terms, in words."""
    return STATUS_TEXTS.get(status, status.replace("_", " ").lower())


def _why_useless(problem: DesignProblem, shrunk: Shrunk) -> str:
    if shrunk.kept:
        return "its motion does not excite every parameter"
    check = recheck(problem.limits, shrunk.trajectory)
    worst = max(check.limits, key=lambda limit: limit.violation)
    return (
        f"by the unsmoothed model its motion breaks {worst.key}, even shrunk to {shrunk.factor:g} "
        "of its size"
    )


@dataclass(frozen=True)
class Screening:
    """Decides after each stage whether a hop or a new start is worth going on."""

    reference: tuple[StageRecord, ...]
    """What the motion that it is measured by had reached after its own stages."""

    def hopeless(self, record: StageRecord, *, last: bool) -> bool:
        """Tell whether it is too far behind what the reference had reached at the same stage.

        After the last one, whether it is behind at all.
        """
        same_problem = attrgetter("name", "width", "level", "samples")
        alike = [one for one in self.reference if same_problem(one) == same_problem(record)]
        allowed = 0.0 if last else _BEHIND
        return bool(alike) and record.objective > alike[-1].objective + allowed


def given_up(start: StartResult, monitor: Monitor) -> StartResult:
    """End a start that others have left behind."""
    _watch(start, monitor).tell(
        "done", start.iterations, -np.inf, start.stages[-1].violation, GIVEN_UP
    )
    return replace(start, status=GIVEN_UP)


def run_stages(
    problem: DesignProblem,
    stages: Sequence[Stage],
    begun: StartResult,
    monitor: Monitor,
    *,
    until: int | None = None,
    screening: Screening | None = None,
) -> StartResult:
    """Run the stages that are left, up to the one numbered `until`, from 1.

    A request to stop ends it after the stage that it reaches. With a `screening` it may be given
    up.
    """
    watch, result, harmonics = _watch(begun, monitor), begun, problem.variables.harmonics
    for number, stage in enumerate(stages[:until], start=1):
        if number <= len(begun.stages):
            continue
        if result.stages and monitor.stop_requested():
            break
        present = problem.with_variables(harmonics=stage.harmonics or harmonics)
        report = watch.of_stage(stage, problem, result.iterations, (number, len(stages)))
        x, record = run_stage(present, stage, result.variables, report)
        result = replace(
            result,
            variables=present.variables.extended(x, harmonics),
            converged=record.converged,
            stages=(*result.stages, record),
        )
        if screening is not None and screening.hopeless(record, last=number == len(stages)):
            return given_up(
                replace(result, trace=tuple(watch.trace), seconds=watch.seconds), monitor
            )
    return replace(result, trace=tuple(watch.trace), seconds=watch.seconds)


def judged(
    problem: DesignProblem, evaluator: Evaluator, result: StartResult, monitor: Monitor
) -> StartResult:
    """Judge by the unsmoothed model what a start has reached; what was given up stays as it is.

    It is looked at on a grid finer than the one its limits were held on, but not on the finish's:
    that would take a sixth of the search's time to tell little more of whether it can be finished.
    """
    if result.status:
        return result
    watch, last = _watch(result, monitor), result.stages[-1]
    status, merit = status_text(last.status), -np.inf
    trajectory = problem.variables.trajectory(result.variables)
    points = _FINER * fine_points(problem.variables.harmonics)
    shrunk = shrink_to_limits(problem, trajectory, points=points)
    if not shrunk.kept:
        shrunk = brought_within(problem, result.variables, GRID_MARGIN, last.width, points)
    if shrunk.kept:
        merit = evaluator.merit(shrunk.trajectory, problem.cost.samples)
    if not np.isfinite(merit):
        status += f"; {_why_useless(problem, shrunk)}"
    value = merit if evaluator.criterion.larger_is_better else -merit
    watch.tell("done", result.iterations, value, max(last.violation, 0.0), status)
    return replace(result, merit=merit, status=status, seconds=watch.seconds)


def _watch(start: StartResult, monitor: Monitor) -> Watch:
    """Return what goes on reporting a start."""
    return Watch(monitor, start.index, list(start.trace), time.perf_counter() - start.seconds)
