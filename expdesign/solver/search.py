"""The search: random starts in parallel, the finish of the best, and hops from it if wanted."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from expdesign.problem import DesignProblem
from expdesign.recheck import Judge
from expdesign.solver.continuation import (
    coarse_points,
    continuation_stages,
    finish_stage,
    hop_stages,
)
from expdesign.solver.finish import Finished, controller_omega, finish
from expdesign.solver.hop import Screening, perturbed
from expdesign.solver.pool import Job, run_jobs
from expdesign.solver.progress import Monitor, SearchEvent
from expdesign.solver.random_start import InfeasibleLimitsError, random_start
from expdesign.solver.stage import TracePoint
from expdesign.solver.start import StartResult, infeasible_start, run_start
from expdesign.trajectory import FourierTrajectory

Array = NDArray[np.float64]

HOPS_AT_ONCE = 4
"""Hops from the same best before it is renewed: the result must not depend on the workers."""

CANDIDATES = 2
"""Starts that are finished, the best first; more only when none of them keeps the limits."""

_FINISH_ROUNDS = 4


@dataclass(frozen=True)
class SearchPlan:
    """How to search.

    Attributes
    ----------
    starts, hops : int
        Random starts, and hops from the best of them (0: none).
    seed : int
    widths : tuple of float
        Smoothing widths of dry friction, m/s, falling.
    iterations : int
        Most iterations of a start's first stage.
    controller_period : float
        Step of the controller, s.
    workers : int
        Processes.
    max_seconds : float or None
        Time for starts and hops, s.
    """

    starts: int
    hops: int
    seed: int
    widths: tuple[float, ...]
    iterations: int
    controller_period: float
    workers: int
    max_seconds: float | None


@dataclass(frozen=True)
class SearchResult:
    """What the search came to.

    Attributes
    ----------
    finished : Finished
        The best trajectory, finished and rechecked.
    best : StartResult
        The start that it came from.
    starts : tuple of StartResult
        Every start and hop, in their order.
    interrupted : bool
        True when the search was asked to stop before its end.
    seconds : float
    """

    finished: Finished
    best: StartResult
    starts: tuple[StartResult, ...]
    interrupted: bool
    seconds: float


@dataclass(frozen=True)
class Workshop:
    """What every worker process needs: the problem, its judge and the plan."""

    problem: DesignProblem
    judge: Judge
    plan: SearchPlan


class NoDesignError(ArithmeticError):
    """The search found no trajectory that keeps the limits and excites the parameters.

    Attributes
    ----------
    starts : tuple of StartResult
        What the starts came to instead.
    """

    def __init__(self, message: str, starts: Sequence[StartResult]) -> None:
        super().__init__(message)
        self.starts = tuple(starts)


Build = Callable[[], Workshop]
"""Builds the workshop inside a worker; picklable."""


def search(build: Build, plan: SearchPlan, monitor: Monitor) -> SearchResult:
    """Search for the best trajectory.

    Parameters
    ----------
    build : callable
        Picklable; builds problem and judge in each worker process.
    plan : SearchPlan
    monitor : Monitor
        Gets every iteration; its request to stop ends the search with the best so far.

    Raises
    ------
    NoDesignError
        No start reached a motion that keeps the limits.
    """
    began = time.perf_counter()
    clock = _Deadline(monitor, began, plan.max_seconds)
    jobs = [Job(_random_job, (index,)) for index in range(1, plan.starts + 1)]
    results: list[StartResult] = list(run_jobs(build, jobs, plan.workers, clock))
    ranked = sorted(results, key=lambda result: (-result.merit, result.index))
    if not ranked or not np.isfinite(ranked[0].merit):
        raise NoDesignError(_why_none(ranked), ranked)
    best = _finish_best(build, ranked, plan, monitor)
    for first in range(0, plan.hops, HOPS_AT_ONCE):
        if clock.stop_requested():
            break
        batch = range(first, min(first + HOPS_AT_ONCE, plan.hops))
        origin, screening = best.finished.trajectory, Screening(best.start.stages)
        jobs = [Job(_hop_job, (plan.starts + 1 + k, origin, screening)) for k in batch]
        for result, candidate in run_jobs(build, jobs, plan.workers, clock):
            results.append(result)
            if candidate is not None and candidate.rank > best.rank:
                best = candidate
    return SearchResult(
        best.finished,
        best.start,
        tuple(sorted(results, key=lambda result: result.index)),
        interrupted=monitor.stop_requested(),
        seconds=time.perf_counter() - began,
    )


@dataclass(frozen=True)
class _Candidate:
    """A finished motion, what it is worth, and the start or hop that it came from."""

    merit: float
    finished: Finished
    start: StartResult

    @property
    def rank(self) -> tuple[bool, float]:
        """Larger is better: what passed the recheck by merit, the rest by its worst limit."""
        passed = self.finished.check.passed
        return passed, self.merit if passed else -self.finished.check.worst


def _finish_best(
    build: Build, ranked: Sequence[StartResult], plan: SearchPlan, monitor: Monitor
) -> _Candidate:
    usable = [result for result in ranked if np.isfinite(result.merit)]
    tried: list[_Candidate] = []
    for first in range(0, len(usable), CANDIDATES):
        batch = usable[first : first + CANDIDATES]
        jobs = [Job(_finish_job, (result.index, result.variables)) for result in batch]
        outcomes: Iterator[tuple[float, Finished]] = run_jobs(
            build, jobs, plan.workers, monitor, after_stop=True
        )
        tried += [
            _Candidate(merit, finished, result)
            for result, (merit, finished) in zip(batch, outcomes, strict=True)
        ]
        if any(item.finished.check.passed for item in tried) or monitor.stop_requested():
            break
    return max(tried, key=lambda item: item.rank)


def _why_none(results: Sequence[StartResult]) -> str:
    if not results:
        return "the search was stopped before any start had a result"
    states = sorted({result.status for result in results})
    return (
        f"none of {len(results)} starts reached a motion that keeps the limits and excites the "
        f"parameters ({'; '.join(states)})"
    )


def _rng(seed: int, index: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,)))


def _random_job(shop: Workshop, monitor: Monitor, index: int) -> StartResult:
    problem, plan = shop.problem, shop.plan
    stages = continuation_stages(problem, plan.widths, plan.iterations)
    first = problem.with_harmonics(stages[0].harmonics or problem.variables.harmonics)
    points = coarse_points(first.variables.harmonics)
    try:
        start = random_start(first, _rng(plan.seed, index), points, plan.widths[0])
    except InfeasibleLimitsError as error:
        return infeasible_start(problem, index, str(error), monitor)
    return run_start(
        problem, shop.judge, stages, start, index=index, kind="random", monitor=monitor
    )


def _hop_job(
    shop: Workshop,
    monitor: Monitor,
    index: int,
    origin: FourierTrajectory,
    screening: Screening,
) -> tuple[StartResult, _Candidate | None]:
    """Hop, and finish what is not given up: only finished motions can be compared."""
    problem, plan = shop.problem, shop.plan
    start = problem.variables.pack(origin)
    start = perturbed(problem, start, _rng(plan.seed, index), plan.widths[-1])
    result = run_start(
        problem,
        shop.judge,
        hop_stages(problem, plan.widths, plan.iterations),
        start,
        index=index,
        kind="hop",
        monitor=monitor,
        screening=screening,
    )
    if not np.isfinite(result.merit) or monitor.stop_requested():
        return result, None
    merit, finished = _finish_job(shop, monitor, index, result.variables)
    return result, _Candidate(merit, finished, result)


def _finish_job(
    shop: Workshop, monitor: Monitor, index: int, variables: Array
) -> tuple[float, Finished]:
    problem, plan = shop.problem, shop.plan
    began = time.perf_counter()
    omega = problem.variables.trajectory(variables).omega
    bounds = problem.variables.omega_bounds
    if bounds[0] < bounds[1]:
        omega, _ = controller_omega(omega, bounds, plan.controller_period)
    fixed = problem.with_frequency((omega, omega))

    trace: list[TracePoint] = []

    def report(iteration: int, cost: float, violation: float) -> bool:
        trace.append(
            TracePoint("finish", iteration, problem.cost.readable(cost), max(violation, 0.0))
        )
        value, seconds = problem.cost.readable(cost), time.perf_counter() - began
        monitor.report(SearchEvent(index, "finish", iteration, value, violation, seconds))
        return not monitor.stop_requested()

    stage = finish_stage(problem, plan.widths, plan.iterations)
    rounds = 0 if monitor.stop_requested() else _FINISH_ROUNDS
    finished = finish(fixed, shop.judge, variables, stage, rounds=rounds, report=report)
    merit = shop.judge.merit(finished.trajectory, problem.cost.samples)
    return merit, replace(finished, trace=tuple(trace))


@dataclass(frozen=True)
class _Deadline:
    """A monitor that also stops when the time is over."""

    monitor: Monitor
    began: float
    seconds: float | None

    def report(self, event: SearchEvent) -> None:
        self.monitor.report(event)

    def stop_requested(self) -> bool:
        late = self.seconds is not None and time.perf_counter() - self.began > self.seconds
        return late or self.monitor.stop_requested()
