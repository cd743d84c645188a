"""The search: groups of starts, hops from the best of each; then the finish and the proof."""

from __future__ import annotations

import itertools
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import pairwise
from operator import attrgetter
from typing import Any, NamedTuple

from expdesign.configuration import ComputationError
from expdesign.progress import report_progress
from expdesign.solver.events import ENDS, SearchEvent
from expdesign.solver.finish import Finished
from expdesign.solver.jobs import (
    Build,
    Candidate,
    DesignTask,
    SearchPlan,
    StartResult,
    finish_job,
    given_up,
    hop_job,
    proof_job,
    refined_job,
    rough_job,
)
from expdesign.workers import Job, Monitor, StoppedError, cluster_jobs, run_jobs

GROUP = 48
"""Starts of a group at most. Each group has hops of its own: the best of several short searches is
better than what one that takes as long ends with (measured)."""
REFINED = 12
"""Starts of a group that go on after the rough search, the best."""
TOGETHER = 8
"""Hops that are under way at once, each from another motion: where one sets out is decided when the
eighth before it has ended, whatever the number of workers."""
FAILED = 0.003
"""Cost by which a motion counts as worse for every hop from it that came to nothing: the best is
often where its descent ends, and others, further up, are not (measured)."""
FINISHED = 4
"""Motions that are finished, the best first; more only when none of them keeps the limits."""
PROVED = 3
"""Finished motions that are proved, the best first, until one is."""
PATIENCE = 80
"""Hops without a better motion of their group after which it gets no more."""
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
    # The time allowed begins when a start moves: processes may take seconds until they can work. A
    # cluster does not report that.
    moved = [] if plan.scheduler is None else [began]

    def report(event: SearchEvent) -> None:
        if not moved:
            moved.append(time.perf_counter())
        monitor.report(event)

    def late() -> bool:
        if plan.max_seconds is None or not moved:
            return False
        return time.perf_counter() - moved[0] > plan.max_seconds

    clock = Monitor(lambda: late() or monitor.stop_requested(), report)
    crew = Crew(build, plan)
    starts, motions, hops, ended = _groups(crew, plan, clock)
    if not motions:
        if monitor.stop_requested():
            raise StoppedError("the search was stopped before any start had a result")
        states = "; ".join(sorted({start.status for start in starts}))
        raise NoDesignError(
            f"none of {len(starts)} starts reached a motion that keeps the limits and excites the "
            f"parameters ({states})"
            if starts
            else "design.max_seconds had passed before any start had a result",
            starts,
        )
    if clock.stop_requested():
        ended = "stopped" if monitor.stop_requested() else "design.max_seconds had passed"
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


def groups(starts: int) -> list[range]:
    """Return the numbers of the starts, from 1, of every group: as evenly as may be."""
    count = -(-starts // GROUP)
    ends = [starts * k // count for k in range(count + 1)]
    return [range(first + 1, last + 1) for first, last in pairwise(ends)]


def _groups(
    crew: Crew, plan: SearchPlan, clock: Monitor
) -> tuple[list[StartResult], list[StartResult], list[StartResult], str]:
    """Return all starts, the best motion of every start's descent, all hops, and why they ended.

    What a group leaves of its hops the next ones have.
    """
    starts: list[StartResult] = []
    motions: list[StartResult] = []
    hops: list[StartResult] = []
    ended = "all starts and hops were made"
    numbered = groups(plan.starts)
    for done, numbers in enumerate(numbered, start=1):
        found = _starts(crew, numbers, clock)
        starts += found
        usable = [start for start in found if start.usable]
        wanted = plan.hops * done // len(numbered) - len(hops)
        reached, made, failed = _hopped(crew, usable, plan.starts + len(hops) + 1, wanted, clock)
        motions += reached
        hops += made
        if clock.stop_requested():
            break
    if len(hops) < plan.hops:
        ended = f"{len(hops)} of {plan.hops} hops, as groups end when {PATIENCE} gain nothing"
        if failed >= PATIENCE and max(motions, key=_rank).index in {one.index for one in reached}:
            ended = _nothing_better(failed)
    return starts, motions, hops, ended


def _starts(crew: Crew, numbers: Sequence[int], clock: Monitor) -> list[StartResult]:
    """Return what starts came to: the best of the rough searches are refined.

    More of them only when none of the first reaches a motion that keeps the limits.
    """
    jobs = [Job(rough_job, (index,)) for index in numbers]
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
    def promise(self) -> tuple[float, ...]:
        """The larger, the sooner a hop sets out from it: its rank, less where hops have failed."""
        *standing, value = self.start.rank
        return *standing, value - FAILED * self.failed

    def after(self, hop: StartResult) -> _Motion:
        """Return what a hop leaves: the better of the two."""
        better = hop.rank > self.start.rank
        return _Motion(hop) if better else replace(self, failed=self.failed + 1)


def _hopped(
    crew: Crew, motions: Sequence[StartResult], first: int, most: int, clock: Monitor
) -> tuple[list[StartResult], list[StartResult], int]:
    """Return the best motion of every start's descent, and all hops, numbered from `first`.

    And how many of these, the last ones, have found nothing better.
    """
    reached = [_Motion(start) for start in motions]
    under_way: dict[int, int] = {}
    made: list[StartResult] = []
    since, begun, over = 0, 0, False

    def hop() -> Job | None:
        """Set out from the most promising motion that no hop is under way from."""
        nonlocal begun, over
        # A late gain of one that was under way by then does not set the others out again.
        over = over or since >= PATIENCE
        free = [k for k in range(len(reached)) if k not in under_way.values()]
        if over or not free or begun == most or clock.stop_requested():
            return None
        origin, number = max(free, key=lambda k: reached[k].promise), first + begun
        under_way[number], begun = origin, begun + 1
        # A hop needs no more of its origin than where it is and what its stages reached.
        return Job(hop_job, (number, replace(reached[origin].start, trace=())))

    def after(result: StartResult) -> Job | None:
        nonlocal since
        origin, known = under_way.pop(result.index), max(one.start.rank for one in reached)
        reached[origin] = reached[origin].after(result)
        since = 0 if _gained(reached[origin].start.rank, known) else since + 1
        made.append(result)
        return hop()

    jobs = [job for job in (hop() for _ in range(TOGETHER)) if job is not None]
    for _ in crew.done(jobs, clock, then=after):
        pass
    return [one.start for one in reached], made, since


def _gained(rank: tuple[float, ...], before: tuple[float, ...]) -> bool:
    """Tell whether a rank is better by more than what does not count."""
    *standing, value = rank
    *stood, was = before
    return standing > stood or value > was + _BETTER


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
    report_progress("proving the limits")
    for candidate in sorted(tried, key=_rank, reverse=True)[:PROVED]:
        job = Job(proof_job, (candidate.start.index, candidate.finished))
        ((merit, finished),) = crew.done([job], monitor, after_stop=True)
        seen.append(replace(candidate, merit=merit, finished=finished))
        if finished.check.certified or monitor.stop_requested():
            break
    return max(seen, key=_rank)


class Crew:
    """Does the jobs of one search; `cpu_seconds` is the processor time that they took."""

    def __init__(self, build: Build, plan: SearchPlan) -> None:
        self._build, self._plan = build, plan
        self.cpu_seconds = 0.0

    def done(
        self,
        jobs: Sequence[Job],
        monitor: Monitor,
        *,
        after_stop: bool = False,
        then: Callable[[Any], Job | None] = lambda _result: None,
    ) -> Iterator[Any]:
        """Yield the results of jobs in their order; of fewer where a stop was requested.

        With `after_stop` they begin although it has been. `then` gets every result, in their order,
        and may return a job that is done as well.
        """
        numbers = itertools.count()

        def timed_job(job: Job) -> Job:
            return Job(_timed, (next(numbers), job))

        def following(done: _Done) -> Job | None:
            self.cpu_seconds += done.seconds
            job = then(done.result)
            return None if job is None else timed_job(job)

        timed = [timed_job(job) for job in jobs]
        if self._plan.scheduler is not None:
            work = _in_cluster(
                (self._plan.scheduler, self._build), timed, monitor, following, after_stop
            )
        else:
            work = run_jobs(
                self._build,
                timed,
                self._plan.workers,
                monitor,
                after_stop=after_stop,
                then=following,
            )
        for done in work:
            yield done.result


def _in_cluster(
    where: tuple[str, Build],
    jobs: Sequence[Job],
    monitor: Monitor,
    then: Callable[[_Done], Job | None],
    after_stop: bool,
) -> Iterator[_Done]:
    """Yield what jobs came to, and those that follow from them, in their order."""
    if monitor.stop_requested() and not after_stop:
        return
    found: dict[int, _Done] = {}
    waiting, following = deque(jobs), 0

    def stopped() -> bool:
        return monitor.stop_requested() and not after_stop

    # Whatever happens here, the cluster's work is given up at once.
    with closing(cluster_jobs(*where, waiting, stopped)) as results:
        for done in results:
            found[done.number] = done
            for event in done.ends:  # the cluster's own monitors are silent
                monitor.report(event)
            while following in found:
                job = then(found[following])
                if job is not None:
                    waiting.append(job)
                yield found.pop(following)
                following += 1
    for _, done in sorted(found.items()):  # after a stop: those before them were given up
        then(done)
        yield done


class _Done(NamedTuple):
    """What a job came to."""

    number: int
    result: Any
    seconds: float
    """Processor time."""
    ends: tuple[SearchEvent, ...]
    """How what it did ended, as it was reported there."""


def _timed(task: DesignTask, monitor: Monitor, number: int, job: Job) -> _Done:
    began, ends = time.process_time(), list[SearchEvent]()

    def report(event: SearchEvent) -> None:
        if event.phase in ENDS:
            ends.append(event)
        monitor.report(event)

    result = job.function(task, Monitor(monitor.stop_requested, report), *job.arguments)
    return _Done(number, result, time.process_time() - began, tuple(ends))
