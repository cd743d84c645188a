"""What worker processes do: starts, hops and finishes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from constraints.arrays import Array
from expdesign.problem.design_problem import DesignProblem
from expdesign.recheck.information import Evaluator
from expdesign.solver.continuation import (
    coarse_points,
    continuation_stages,
    finish_stage,
    hop_stages,
)
from expdesign.solver.finish import Finished, controller_omega, finish
from expdesign.solver.hum_distance import KnownHum
from expdesign.solver.initial import InfeasibleLimitsError, perturbed, random_start
from expdesign.solver.stage import Watch, run_stage
from expdesign.solver.start import Screening, StartResult, judged, run_stages
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
