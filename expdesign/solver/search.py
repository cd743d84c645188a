"""The search: many rough searches, the best refined, hops from these, the finish and the proof."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

from expdesign.configuration import ComputationError
from expdesign.progress import tell
from expdesign.solver.continuation import FAR_HOPS, NEAR_HOPS
from expdesign.solver.crew import Crew
from expdesign.solver.finish import Finished
from expdesign.solver.jobs import (
    Build,
    Candidate,
    SearchPlan,
    finish_job,
    hop_job,
    proof_job,
    refined_job,
    rough_job,
)
from expdesign.solver.start import StartResult, given_up
from expdesign.workers import Job, Monitor, StoppedError

REFINED = 24
"""Starts that go on after the rough search, the best of all."""
BREADTHS = (12, 6, 4)
"""From how many motions hops set out, the best, in the first part of all hops, the second, the
third. Which of them hops bring farthest is not to be seen before some have been made (measured)."""
FINISHED = 4
"""Motions that are finished, the best first; more only when none of them keeps the limits."""
PROVED = 3
"""Finished motions that are proved, the best first, until one is."""
NEAR = 3
"""Hops near a motion, one after the other without a better one, before they lead far."""
PATIENCE = 80
"""Hops without a better motion after which no more are made."""
_BETTER = 1e-3
"""Difference in cost that counts: 0.1 % of D-efficiency."""
_CONFIDENCE = 0.95

_rank = attrgetter("rank")


@dataclass(frozen=True)
class SearchResult:
    """What the search found, and what the finished starts were worth, by their index."""

    finished: Finished
    best: StartResult
    starts: tuple[StartResult, ...]
    finished_merits: dict[int, float]
    interrupted: bool
    seconds: float
    cpu_seconds: float
    """Of all starts, hops, finishes and proofs, in whichever process; without building the problem
    and its derivatives."""
    ended: str
    """Why it went no further, in words."""


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

    def late() -> bool:
        return plan.max_seconds is not None and time.perf_counter() - began > plan.max_seconds

    clock = Monitor(lambda: late() or monitor.stop_requested(), monitor.report)
    crew = Crew(build, plan)
    starts = _starts(crew, plan, clock)
    motions = [start for start in starts if start.usable]
    if not motions:
        if monitor.stop_requested():
            raise StoppedError("the search was stopped before any start had a result")
        states = "; ".join(sorted({start.status for start in starts}))
        raise NoDesignError(
            f"none of {len(starts)} starts reached a motion that keeps the limits and excites the "
            f"parameters ({states})"
            if starts
            else "design.max_seconds were over before any start had a result",
            starts,
        )
    motions, hops, ended = _hopped(crew, motions, plan, clock)
    if clock.stop_requested():
        ended = "stopped" if monitor.stop_requested() else "design.max_seconds were over"
    tried = _finished(crew, motions, monitor)
    best = _proved(crew, tried, monitor)
    return SearchResult(
        best.finished,
        best.start,
        tuple(sorted([*starts, *hops], key=attrgetter("index"))),
        {candidate.start.index: candidate.merit for candidate in [*tried, best]},
        interrupted=monitor.stop_requested(),
        seconds=time.perf_counter() - began,
        cpu_seconds=crew.cpu_seconds,
        ended=ended,
    )


def _starts(crew: Crew, plan: SearchPlan, clock: Monitor) -> list[StartResult]:
    """Return what all starts came to: the best of the rough searches are refined.

    More of them only when none of the first reaches a motion that keeps the limits.
    """
    jobs = [Job(rough_job, (index,)) for index in range(1, plan.starts + 1)]
    rough: list[StartResult] = list(crew.done(jobs, clock))
    left = sorted((start for start in rough if not start.status), key=_rank, reverse=True)
    ended = [start for start in rough if start.status]
    while left and not any(start.usable for start in ended):
        jobs = [Job(refined_job, (start,)) for start in left[:REFINED]]
        left = left[REFINED:]
        ended += crew.done(jobs, clock, after_stop=True)
    return [*ended, *(given_up(start, clock) for start in left)]


@dataclass(frozen=True)
class _Motion:
    """A motion that hops set out from, and how many have come to nothing since it was reached."""

    start: StartResult
    failed: int = 0

    @property
    def rank(self) -> tuple[bool, bool, float]:
        return self.start.rank

    def after(self, hop: StartResult) -> _Motion:
        """Return what a hop leaves: the better of the two."""
        return _Motion(hop) if hop.rank > self.rank else replace(self, failed=self.failed + 1)


def _hopped(
    crew: Crew, motions: Sequence[StartResult], plan: SearchPlan, clock: Monitor
) -> tuple[list[StartResult], list[StartResult], str]:
    """Return the best motion of every start's descent, all hops, and why there were no more."""
    best = sorted((_Motion(start) for start in motions), key=_rank, reverse=True)
    made: list[StartResult] = []
    since = 0
    while len(made) < plan.hops and not clock.stop_requested():
        if since >= PATIENCE:
            return [one.start for one in best], made, _nothing_better(since)
        part = len(made) * len(BREADTHS) // plan.hops
        origins = best[: min(BREADTHS[part], plan.hops - len(made))]
        first = plan.starts + len(made) + 1
        jobs = [
            Job(
                hop_job,
                (first + k, origin.start, FAR_HOPS if origin.failed >= NEAR else NEAR_HOPS),
            )
            for k, origin in enumerate(origins)
        ]
        results: list[StartResult] = list(crew.done(jobs, clock))
        known = best[0].rank
        for hop in results:
            best[hop.index - first] = origins[hop.index - first].after(hop)
        best.sort(key=_rank, reverse=True)
        *standing, cost = best[0].rank
        *before, reached = known
        since = 0 if standing > before or cost > reached + _BETTER else since + len(results)
        made += results
    return [one.start for one in best], made, "all starts and hops were made"


def _nothing_better(hops: int) -> str:
    """Return what so many hops without a better motion say of the next one."""
    chance = 1 - (1 - _CONFIDENCE) ** (1 / hops)
    return (
        f"the last {hops} hops found nothing better: the chance that one more would is at most "
        f"{100 * chance:.2g} % (with a confidence of {100 * _CONFIDENCE:g} %)"
    )


def _finished(crew: Crew, motions: Sequence[StartResult], monitor: Monitor) -> list[Candidate]:
    """Finish the best motions, and more until one keeps the limits."""
    ranked = sorted(motions, key=_rank, reverse=True)
    tried: list[Candidate] = []
    for first in range(0, len(ranked), FINISHED):
        batch = ranked[first : first + FINISHED]
        jobs = [Job(finish_job, (result.index, result.variables)) for result in batch]
        outcomes: Iterator[tuple[float, Finished]] = crew.done(jobs, monitor, after_stop=True)
        tried += [
            Candidate(merit, finished, result)
            for result, (merit, finished) in zip(batch, outcomes, strict=True)
        ]
        if any(item.finished.check.passed for item in tried) or monitor.stop_requested():
            break
    return tried


def _proved(crew: Crew, tried: Sequence[Candidate], monitor: Monitor) -> Candidate:
    """Return the best motion of which every limit is proved to be kept, of the best few.

    Where there is none, the best of those that were looked at.
    """
    seen: list[Candidate] = []
    tell("proving the limits")
    for candidate in sorted(tried, key=_rank, reverse=True)[:PROVED]:
        job = Job(proof_job, (candidate.start.index, candidate.finished))
        ((merit, finished),) = crew.done([job], monitor, after_stop=True)
        seen.append(replace(candidate, merit=merit, finished=finished))
        if finished.check.certified or monitor.stop_requested():
            break
    return max(seen, key=_rank)
