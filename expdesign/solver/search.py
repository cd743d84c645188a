"""The search: groups of starts, hops from the best of each; then the finish and the proof."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from operator import attrgetter

import numpy as np

from expdesign.configuration import ComputationError
from expdesign.progress import report_progress
from expdesign.solver.finish import polish_start, prove_design
from expdesign.solver.phases import SearchEvent
from expdesign.solver.starts import SearchPlan, StartResult, give_up, report_end, run_start
from expdesign.trajectory import FourierTrajectory
from expdesign.workers import Job, JobJournal, JobRunner, Monitor, StoppedError

GROUP = 48
"""Largest number of starts of a group. Each group has hops of its own: the best of several short
searches is better than the result of one that takes as long (measured)."""
REFINED = 12
"""Number of starts of a group, the best, that continue after the rough search."""
TOGETHER = 8
"""Number of simultaneous hops, each from another motion. The origin of a hop is chosen when the
eighth hop before it has ended, whatever the number of workers."""
FAILED = 0.003
"""Cost added to a motion for every hop from it without improvement: the best motion is often the
end of its descent, and others are not (measured)."""
FINISHED = 4
"""Number of motions that are finished at once, the best first; more only if none keeps the
limits."""
PROVED = 3
"""Largest number of finished motions that are proved, the best first, until a proof succeeds."""
PATIENCE = 80
"""Consecutive hops of a group without a better motion after which it gets no more."""
_BETTER = 1e-3
"""Relevant difference in cost: 0.1 % of D-efficiency."""
_CONFIDENCE = 0.95

_rank = attrgetter("rank")


@dataclass(frozen=True)
class SearchResult:
    """The best design, and the results of all starts and hops."""

    finish: StartResult
    """The best design."""
    best: StartResult
    """Its start."""
    starts: tuple[StartResult, ...]
    merits: dict[int, float]
    """Exact criterion of the finished motions, larger is better, by number of the start."""
    interrupted: bool
    seconds: float
    cpu_seconds: float
    """Processor time of all starts, hops, finishes and proofs in all processes, without building
    the problem and its derivatives."""
    ended: str
    """Reason for the end of the search, in words."""
    lost: str = ""
    """Reason for the loss of the cluster, in words; empty: it was not lost."""

    @property
    def trajectory(self) -> FourierTrajectory:
        """The designed trajectory."""
        if self.finish.trajectory is None:
            raise ValueError("the best motion is not finished")
        return self.finish.trajectory


class NoDesignError(ComputationError):
    """The search found no trajectory that keeps the limits and excites the parameters."""

    def __init__(self, message: str, starts: Sequence[StartResult]) -> None:
        super().__init__(message)
        self.starts = tuple(starts)


def search(
    build: Callable[[], SearchPlan],
    plan: SearchPlan,
    monitor: Monitor,
    journal: JobJournal | None = None,
) -> SearchResult:
    """Search for the best trajectory; a request to stop ends the search with the best so far.

    The loss of a cluster has the effect of a request to stop.

    Parameters
    ----------
    build : callable
        Picklable; builds the plan of a worker process, once.
    plan : SearchPlan
    monitor : Monitor
        Gets every event of the search.
    journal : JobJournal, optional
        Keeps the results of starts and hops, from which an interrupted search continues.

    Raises
    ------
    NoDesignError
        No start reached a motion that keeps the limits.
    StoppedError
        A request to stop came before such a motion was found.
    """
    began = time.perf_counter()
    # The time allowed begins when a start moves: processes may need seconds to start. A cluster
    # does not report that.
    moved = [] if plan.scheduler is None else [began]

    def report(event: SearchEvent) -> None:
        if not moved:
            moved.append(time.perf_counter())
        monitor.report(event)

    def is_late() -> bool:
        if plan.max_seconds is None or not moved:
            return False
        return time.perf_counter() - moved[0] > plan.max_seconds

    runner = JobRunner(
        build, plan.workers, plan.scheduler, keep_event=attrgetter("is_end"), journal=journal
    )
    watch = Monitor(lambda: monitor.stop_requested() or runner.lost is not None, monitor.report)
    clock = Monitor(lambda: is_late() or watch.stop_requested(), report)
    starts, motions, hops, ended = _search_groups(runner, plan, clock)
    if not motions:
        if runner.lost is not None:
            raise runner.lost
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
    tried = _polish_best(runner, motions, watch)
    best = _prove_best(runner, tried, watch)
    lost = "" if runner.lost is None else runner.lost.message
    every = sorted([*starts, *hops], key=attrgetter("index"))
    return SearchResult(
        best,
        next(start for start in motions if start.index == best.index),
        tuple(every),
        {polished.index: polished.merit for polished in [*tried, best]},
        interrupted=watch.stop_requested(),
        seconds=time.perf_counter() - began,
        cpu_seconds=runner.cpu_seconds,
        ended=lost or ended,
        lost=lost,
    )


def groups(starts: int) -> list[range]:
    """Return the numbers of the starts, from 1, of every group; groups are about equally large.

    Examples
    --------
    >>> groups(3)
    [range(1, 4)]
    """
    count = -(-starts // GROUP)
    ends = [starts * k // count for k in range(count + 1)]
    return [range(first + 1, last + 1) for first, last in pairwise(ends)]


def _search_groups(
    runner: JobRunner, plan: SearchPlan, clock: Monitor
) -> tuple[list[StartResult], list[StartResult], list[StartResult], str]:
    """Return all starts, the best motion of every start's descent, all hops, and why they ended.

    Hops that a group does not use are available to the next ones.
    """
    starts: list[StartResult] = []
    motions: list[StartResult] = []
    hops: list[StartResult] = []
    ended = "all starts and hops were made"
    numbered = groups(plan.starts)
    for done, numbers in enumerate(numbered, start=1):
        found = _run_starts(runner, plan, numbers, clock)
        starts += found
        usable = [start for start in found if start.usable]
        wanted = plan.hops * done // len(numbered) - len(hops)
        first = plan.starts + len(hops) + 1
        reached, made, failed = _run_hops(runner, usable, (first, wanted), clock)
        motions += reached
        hops += made
        if clock.stop_requested():
            break
    if len(hops) < plan.hops:
        ended = f"{len(hops)} of {plan.hops} hops, as groups end when {PATIENCE} gain nothing"
        if failed >= PATIENCE and max(motions, key=_rank).index in {one.index for one in reached}:
            ended = _chance_text(failed)
    return starts, motions, hops, ended


def _start_job(name: str, *arguments: object) -> Job:
    """Return the job of a start or hop; by its name a journal knows the result."""
    return Job(run_start, arguments, name, report_end)


def _run_starts(
    runner: JobRunner, plan: SearchPlan, numbers: Sequence[int], clock: Monitor
) -> list[StartResult]:
    """Return the results of starts: the best of the rough searches are refined.

    More of them are refined only if none of the first reaches a motion that keeps the limits.
    """
    begun = [StartResult(index, "random", np.empty(0)) for index in numbers]
    if plan.origin is not None:
        begun = [StartResult(1, "origin", plan.problem.variables.pack(plan.origin))]
    jobs = [_start_job(f"start {start.index}, rough", start, 1) for start in begun]
    rough: list[StartResult] = list(runner.run(jobs, clock))
    left = sorted((start for start in rough if not start.status), key=_rank, reverse=True)
    ended = [start for start in rough if start.status]
    while left and not any(start.usable for start in ended):
        jobs = [_start_job(f"start {start.index}", start) for start in left[:REFINED]]
        left = left[REFINED:]
        ended += runner.run(jobs, clock, after_stop=True)
    return [*ended, *(give_up(plan, clock, start) for start in left)]


@dataclass(frozen=True)
class _Origin:
    """A motion from which hops begin, and the number of hops that have not improved on it."""

    start: StartResult
    failed: int = 0

    @property
    def promise(self) -> tuple[float, ...]:
        """Sorting key of the next origin: the rank, reduced by failed hops."""
        *standing, value = self.start.rank
        return *standing, value - FAILED * self.failed

    def after(self, hop: StartResult) -> _Origin:
        """Return the better one of the two."""
        better = hop.rank > self.start.rank
        return _Origin(hop) if better else replace(self, failed=self.failed + 1)


def _run_hops(
    runner: JobRunner,
    motions: Sequence[StartResult],
    numbers: tuple[int, int],
    clock: Monitor,
) -> tuple[list[StartResult], list[StartResult], int]:
    """Return the best motion of every descent, all hops, and the number of last failed hops.

    `numbers` are that of the first hop and the largest number of hops.
    """
    first, most = numbers
    origins = [_Origin(start) for start in motions]
    under_way: dict[int, int] = {}
    made: list[StartResult] = []
    since, begun, over = 0, 0, False

    def next_hop() -> Job | None:
        """Return a hop from the most promising motion without a hop under way."""
        nonlocal begun, over
        # A late gain of a hop that was under way at the end does not restart the group.
        over = over or since >= PATIENCE
        free = [k for k in range(len(origins)) if k not in under_way.values()]
        if over or not free or begun == most or clock.stop_requested():
            return None
        place, number = max(free, key=lambda k: origins[k].promise), first + begun
        under_way[number], begun = place, begun + 1
        origin = origins[place].start
        hop = StartResult(number, "hop", origin.variables)
        return _start_job(f"hop {number}", hop, None, origin.phases)

    def follow(result: StartResult) -> Job | None:
        nonlocal since
        place, known = under_way.pop(result.index), max(one.start.rank for one in origins)
        origins[place] = origins[place].after(result)
        (*standing, value), (*stood, was) = origins[place].start.rank, known
        since = 0 if standing > stood or value > was + _BETTER else since + 1
        made.append(result)
        return next_hop()

    jobs = [job for job in (next_hop() for _ in range(TOGETHER)) if job is not None]
    for _ in runner.run(jobs, clock, then=follow):
        pass
    return [one.start for one in origins], made, since


def _chance_text(hops: int) -> str:
    """Return the chance of a better motion after so many hops without one, in words."""
    chance = 1 - (1 - _CONFIDENCE) ** (1 / hops)
    return (
        f"the last {hops} hops found nothing better: the chance that one more would is at most "
        f"{100 * chance:.2g} % (with a confidence of {100 * _CONFIDENCE:g} %)"
    )


def _polish_best(
    runner: JobRunner, motions: Sequence[StartResult], monitor: Monitor
) -> list[StartResult]:
    """Finish the best motions, and more until one keeps the limits."""
    ranked = sorted(motions, key=_rank, reverse=True)
    tried: list[StartResult] = []
    for first in range(0, len(ranked), FINISHED):
        batch = ranked[first : first + FINISHED]
        jobs = [Job(polish_start, (start,)) for start in batch]
        tried += runner.run(jobs, monitor, after_stop=True)
        if any(polished.check.passed for polished in tried) or monitor.stop_requested():
            break
    return tried


def _prove_best(runner: JobRunner, tried: Sequence[StartResult], monitor: Monitor) -> StartResult:
    """Return the best design whose limits are all proved, among the best few.

    If there is none, the best of those examined is returned.
    """
    seen: list[StartResult] = []
    report_progress("proving the limits")
    for polished in sorted(tried, key=_rank, reverse=True)[:PROVED]:
        (proved,) = runner.run([Job(prove_design, (polished,))], monitor, after_stop=True)
        seen.append(proved)
        if proved.check.certified or monitor.stop_requested():
            break
    return max(seen, key=_rank)
