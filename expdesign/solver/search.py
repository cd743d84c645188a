"""The search: random starts in parallel, the finish of the best, and hops from it if wanted."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from expdesign.configuration import ComputationError
from expdesign.solver.finish import Finished
from expdesign.solver.jobs import (
    CAPACITY,
    Build,
    Candidate,
    Population,
    SearchPlan,
    finish_job,
    hop_job,
    newcomer_job,
    proof_job,
    random_job,
)
from expdesign.solver.start import Screening, StartResult
from expdesign.workers import Job, Monitor, StoppedError, run_jobs

HOPS_AT_ONCE = 4
"""Hops from the same motions before they are renewed: the result must not depend on the workers."""

_EVERY = 2
"""Of so many hops one is a new random start: the best basin may be far from all that are known."""

CANDIDATES = 2
"""Starts that are finished, the best first, as many as the population has room for if hops follow.
More only when none of them keeps the limits."""


@dataclass(frozen=True)
class SearchResult:
    """What the search found, and what the finished starts were worth, by their index."""

    finished: Finished
    best: StartResult
    starts: tuple[StartResult, ...]
    finished_merits: dict[int, float]
    interrupted: bool
    seconds: float


class NoDesignError(ComputationError):
    """The search found no trajectory that keeps the limits and excites the parameters."""

    def __init__(self, message: str, starts: Sequence[StartResult]) -> None:
        super().__init__(message)
        self.starts = tuple(starts)


def search(build: Build, plan: SearchPlan, monitor: Monitor) -> SearchResult:
    """Search for the best trajectory; a request to stop ends the search with the best so far.

    `NoDesignError` tells that no start reached a motion that keeps the limits, `StoppedError` that
    the request came before one did.
    """
    began = time.perf_counter()

    def late_or_asked() -> bool:
        late = plan.max_seconds is not None and time.perf_counter() - began > plan.max_seconds
        return late or monitor.stop_requested()

    clock = Monitor(late_or_asked, monitor.report)
    jobs = [Job(random_job, (index,)) for index in range(1, plan.starts + 1)]
    results: list[StartResult] = list(run_jobs(build, jobs, plan.workers, clock))
    ranked = sorted(results, key=lambda result: (-result.merit, result.index))
    if not ranked or not np.isfinite(ranked[0].merit):
        if monitor.stop_requested():
            raise StoppedError("the search was stopped before any start had a result")
        states = "; ".join(sorted({result.status for result in ranked}))
        raise NoDesignError(
            f"none of {len(ranked)} starts reached a motion that keeps the limits and excites the "
            f"parameters ({states})"
            if ranked
            else "design.max_seconds were over before any start had a result",
            ranked,
        )
    tried = _finish_best(build, ranked, plan, monitor)
    population = Population.of(tried)
    for first in range(0, plan.hops, HOPS_AT_ONCE):
        if clock.stop_requested():
            break
        batch = range(first, min(first + HOPS_AT_ONCE, plan.hops))
        jobs = [_hop(population, plan.starts + 1, k) for k in batch]
        for result, candidate in run_jobs(build, jobs, plan.workers, clock):
            results.append(result)
            if candidate is not None:
                tried.append(candidate)
                population = population.admit(candidate)
    best = _proved(build, tried, plan, monitor)
    tried.append(best)
    return SearchResult(
        best.finished,
        best.start,
        tuple(sorted(results, key=lambda result: result.index)),
        {candidate.start.index: candidate.merit for candidate in tried},
        interrupted=monitor.stop_requested(),
        seconds=time.perf_counter() - began,
    )


def _hop(population: Population, first: int, k: int) -> Job:
    """Return the k-th hop, from the member whose turn it is, or every other time a newcomer."""
    turn, newcomer = divmod(k, _EVERY)
    if newcomer:
        least = population.least
        # Its last stage is the only one that a hop has, too, and the one that tells enough.
        reference = least.start.stages[-1:] if least is not None else ()
        return Job(newcomer_job, (first + k, Screening(reference)))
    return Job(hop_job, (first + k, population.origin(turn)))


def _proved(
    build: Build, tried: Sequence[Candidate], plan: SearchPlan, monitor: Monitor
) -> Candidate:
    """Return the best motion of which every limit is proved to be kept, of the best few.

    Where there is none, the best of those that were looked at.
    """
    seen: list[Candidate] = []
    for candidate in sorted(tried, key=lambda one: one.rank, reverse=True)[:CAPACITY]:
        job = Job(proof_job, (candidate.start.index, candidate.finished))
        ((merit, finished),) = run_jobs(build, [job], plan.workers, monitor, after_stop=True)
        seen.append(replace(candidate, merit=merit, finished=finished))
        if finished.check.certified or monitor.stop_requested():
            break
    return max(seen, key=lambda one: one.rank)


def _finish_best(
    build: Build, ranked: Sequence[StartResult], plan: SearchPlan, monitor: Monitor
) -> list[Candidate]:
    usable = [result for result in ranked if np.isfinite(result.merit)]
    tried: list[Candidate] = []
    size = CAPACITY if plan.hops else CANDIDATES
    for first in range(0, len(usable), size):
        batch = usable[first : first + size]
        jobs = [Job(finish_job, (result.index, result.variables)) for result in batch]
        outcomes: Iterator[tuple[float, Finished]] = run_jobs(
            build, jobs, plan.workers, monitor, after_stop=True
        )
        tried += [
            Candidate(merit, finished, result, result.index)
            for result, (merit, finished) in zip(batch, outcomes, strict=True)
        ]
        if any(item.finished.check.passed for item in tried) or monitor.stop_requested():
            break
    return tried
