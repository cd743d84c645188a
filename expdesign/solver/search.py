"""The search: groups of starts, hops from the best of each; then the finish and the proof."""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import pairwise, zip_longest
from operator import attrgetter

import numpy as np

from expdesign.configuration import ComputationError
from expdesign.progress import report_progress
from expdesign.recheck.certificate import CellBounds, Cells, EnclosedMotion, Sharing, share_cells
from expdesign.solver.finish import bound_part, polish_start, prove_design, prove_limits
from expdesign.solver.phases import SearchEvent
from expdesign.solver.starts import SearchPlan, StartResult, give_up, report_end, run_start
from expdesign.trajectory import FourierTrajectory
from expdesign.workers import (
    Job,
    JobJournal,
    JobRunner,
    Known,
    Monitor,
    Procedure,
    StoppedError,
    foresee_nothing,
    unknown_jobs,
)

GROUP = 48
"""Largest number of starts of a group. Each group has hops of its own: the best of several short
searches is better than the result of one that takes as long (measured)."""
REFINED = 12
"""Number of starts of a group, the best, that continue after the rough search."""
TOGETHER = 8
"""Number of simultaneous hops, each from another motion. The origin of a hop is chosen when the
eighth hop before it has ended, whatever the number of workers."""
FORESEEN = 4 * TOGETHER
"""Largest number of hops of a group that are foreseen, to do some of them ahead."""
FAILED = 0.003
"""Cost added to a motion for every hop from it without improvement: the best motion is often the
end of its descent, and others are not (measured)."""
FINISHED = 4
"""Largest number of motions that are finished at once, the best first; more only if none keeps the
limits."""
LAG = 0.012
"""Largest lag in cost, that is of efficiency, behind the best motion of those finished with it."""
PROVED = 3
"""Largest number of finished motions that are proved, the best first, until a proof succeeds."""
BUSY = 4
"""Number of workers that a group keeps busy on average: of its simultaneous hops some wait for
slower ones before them."""
PATIENCE = 80
"""Consecutive hops of a group without a better motion after which it gets no more."""
WORTHWHILE = 0.0015
"""Gain in cost, that is of efficiency, for which the next `TOGETHER` hops are made if a plan weighs
it: over 20 seeds of PaLiDA 38 to 61 hops."""
SCALE, WEIGHT = 0.009, 8.0
"""Mean gain of hops while their number grows by the factor e (20 searches of PaLiDA), and the
number of such factors that it counts for."""
FEWEST = 16
"""Hops of a group before its gain is weighed."""
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
    """Processor time of the starts, hops, finishes and proofs whose results were used, in all
    processes, without building the problem and its derivatives."""
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
    with closing(runner):
        starts, motions, hops, ended = _search_groups(runner, plan, clock)
        if not motions:
            if runner.lost is not None:
                raise runner.lost
            if monitor.stop_requested():
                raise StoppedError("the search was stopped before any start had a result")
            raise NoDesignError(_failure_text(starts), starts)
        if clock.stop_requested():
            ended = "stopped" if monitor.stop_requested() else "design.max_seconds had passed"
        best, tried = _finish_best(runner, plan, motions, watch)
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


def _failure_text(starts: Sequence[StartResult]) -> str:
    """Return why no start reached a motion, in words."""
    if not starts:
        return "design.max_seconds had passed before any start had a result"
    states = "; ".join(sorted({start.status for start in starts}))
    return (
        f"none of {len(starts)} starts reached a motion that keeps the limits and excites the "
        f"parameters ({states})"
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

    Groups do not depend on each other. As many are searched at once as keep the workers busy, so
    that a search by few workers has a motion early.
    """
    numbered = groups(plan.starts)
    count = len(numbered)
    ends = [plan.starts + 1 + plan.hops * k // count for k in range(count + 1)]
    hop_numbers = [range(first, last) for first, last in pairwise(ends)]
    at_once = count if plan.scheduler else math.ceil(plan.workers / BUSY)
    starts: list[StartResult] = []
    searched: list[_Group] = []
    for first in range(0, count, at_once):
        block = slice(first, first + at_once)
        found = _run_starts(runner, plan, numbered[block], clock)
        made = [
            _Group(plan, lane, [start for start in one if start.usable], numbers, clock)
            for lane, (one, numbers) in enumerate(zip(found, hop_numbers[block], strict=True))
        ]
        _run_hops(runner, plan, made, [m for group in searched for m in group.motions], clock)
        starts += [start for one in found for start in one]
        searched += made
        if clock.stop_requested():
            break
    motions = [motion for group in searched for motion in group.motions]
    hops = [hop for group in searched for hop in group.made]
    return starts, motions, hops, _end_text(plan, searched)


def _start_job(name: str, *arguments: object, lane: int = 0) -> Job:
    """Return the job of a start or hop; by its name a journal knows the result."""
    return Job(run_start, arguments, name, report_end, lane)


def _run_starts(
    runner: JobRunner, plan: SearchPlan, block: Sequence[range], clock: Monitor
) -> list[list[StartResult]]:
    """Return the results of the starts of groups: the best of the rough searches are refined.

    More of a group are refined only if none of the first reaches a motion that keeps the limits.
    """
    begun = [StartResult(index, "random", np.empty(0)) for numbers in block for index in numbers]
    if plan.origin is not None:
        begun = [StartResult(1, "origin", plan.problem.variables.pack(plan.origin))]
    jobs = [_start_job(f"start {start.index}, rough", start, 1) for start in begun]
    rough: list[StartResult] = list(runner.run(jobs, clock, foresee=foresee_nothing))
    ended = [[start for start in rough if start.index in own and start.status] for own in block]
    left = [
        sorted((one for one in rough if one.index in own and not one.status), key=_rank)[::-1]
        for own in block
    ]
    while chosen := [
        start
        for done, others in zip(ended, left, strict=True)
        if not any(one.usable for one in done)
        for start in others[:REFINED]
    ]:
        jobs = [_start_job(f"start {start.index}", start) for start in chosen]
        refined = list(runner.run(jobs, clock, after_stop=True, foresee=foresee_nothing))
        taken = {start.index for start in chosen}
        left = [[start for start in others if start.index not in taken] for others in left]
        for own, done in zip(block, ended, strict=True):
            done += [start for start in refined if start.index in own]
    return [
        [*done, *(give_up(plan, clock, start) for start in others)]
        for done, others in zip(ended, left, strict=True)
    ]


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


class _Group:
    """The hops from the motions of a group of starts.

    Parameters
    ----------
    plan : SearchPlan
    lane : int
        That of its jobs.
    motions : sequence of StartResult
    numbers : range
        Those of its hops.
    clock : Monitor

    Attributes
    ----------
    origins : list of _Origin
    unused : iterator of int
        Numbers of further hops.
    under_way : dict
        Places of the origins of hops without a result, and their jobs, by number of the hop.
    made : list of StartResult
        Its hops.
    failed : int
        Number of the last hops without a better motion.
    has_gained_enough : bool
        Whether it ended since further hops were expected to gain too little.
    """

    def __init__(
        self,
        plan: SearchPlan,
        lane: int,
        motions: Sequence[StartResult],
        numbers: range,
        clock: Monitor,
    ) -> None:
        self._plan, self._lane, self._clock = plan, lane, clock
        self.numbers, self.unused = numbers, iter(numbers)
        self.origins = [_Origin(start) for start in motions]
        self.under_way: dict[int, tuple[int, Job]] = {}
        self._is_over, self._gained = False, 0.0
        self.made: list[StartResult] = []
        self.failed, self.has_gained_enough = 0, False

    @property
    def motions(self) -> list[StartResult]:
        """The best motion of every descent."""
        return [origin.start for origin in self.origins]

    def next_hop(self) -> Job | None:
        """Return a hop from the most promising motion without a hop under way."""
        used = {place for place, _ in self.under_way.values()}
        free = [k for k in range(len(self.origins)) if k not in used]
        if self._is_over or not free or self._clock.stop_requested():
            return None
        number = next(self.unused, None)
        if number is None:
            return None
        place = max(free, key=lambda k: self.origins[k].promise)
        origin = self.origins[place].start
        hop = StartResult(number, "hop", origin.variables)
        job = _start_job(f"hop {number}", hop, None, origin.phases, lane=self._lane)
        self.under_way[number] = place, job
        return job

    def foreseen(self, known: Known) -> tuple[_Group, list[Job]]:
        """Return the group after known results, and the hops without one: they gain nothing."""
        future, unknown = copy.copy(self), list[Job]()
        future.unused, future.origins = copy.copy(self.unused), list(self.origins)
        future.under_way, future.made = dict(self.under_way), list(self.made)
        for _ in range(FORESEEN):
            if not future.under_way:
                break
            number, (_, job) = next(iter(future.under_way.items()))
            result = known(job)
            if result is None:
                unknown.append(job)
                result = StartResult(number, "hop", np.empty(0))
            future.follow(result)
        return future, unknown

    def follow(self, result: StartResult) -> Job | None:
        """Add the result of a hop, in the order of the hops; return the next one."""
        known = max(one.start.rank for one in self.origins)
        place, _ = self.under_way.pop(result.index)
        self.origins[place] = self.origins[place].after(result)
        (*standing, value), (*stood, was) = self.origins[place].start.rank, known
        self.failed = 0 if standing > stood or value > was + _BETTER else self.failed + 1
        if standing == stood:
            self._gained += max(value - was, 0.0)
        self.made.append(result)
        # A late gain of a hop that was under way at the end does not restart the group.
        if not self._is_over:
            count = len(self.made)
            if self._plan.weighs_gain and count >= FEWEST:
                expected = expected_gain(self._gained, count, TOGETHER)
                self.has_gained_enough = expected < WORTHWHILE
            self._is_over = self.failed >= PATIENCE or self.has_gained_enough
        return self.next_hop()


def expected_gain(gained: float, hops: int, more: int) -> float:
    """Return the gain in cost that is expected of more hops after some.

    Where the results of hops have an exponential tail of some scale, the best of them gains
    scale / k with hop k on average: records become rare. The scale is estimated from the gain so
    far and, with a weight, from that of other searches.

    Examples
    --------
    >>> [round(100 * expected_gain(0.02, hops, 8), 2) for hops in (16, 32, 64)]
    [0.33, 0.17, 0.09]
    """
    scale = (gained + WEIGHT * SCALE) / (math.log1p(hops) + WEIGHT)
    return scale * math.log1p(more / (1 + hops))


def _run_hops(
    runner: JobRunner,
    plan: SearchPlan,
    searched: Sequence[_Group],
    others: Sequence[StartResult],
    clock: Monitor,
) -> None:
    """Run the hops of groups, which do not wait for each other.

    Ahead, the best of the present motions and `others` are finished, and further hops are made.
    """

    def follow(result: StartResult) -> Job | None:
        return next(group for group in searched if result.index in group.numbers).follow(result)

    def foresee(known: Known, is_idle_for_long: bool) -> Iterator[Job]:
        futures, unknown = zip(*(group.foreseen(known) for group in searched), strict=True)
        motions = [*others, *(motion for group in futures for motion in group.motions)]
        if is_idle_for_long:
            yield from unknown_jobs(_finish(plan, motions, clock), known)
        for hops in zip_longest(*unknown):
            yield from (hop for hop in hops if hop is not None)

    jobs = [group.next_hop() for group in searched for _ in range(TOGETHER)]
    for _ in runner.run(
        [job for job in jobs if job is not None], clock, then=follow, foresee=foresee
    ):
        pass


def _end_text(plan: SearchPlan, searched: Sequence[_Group]) -> str:
    """Return why starts and hops ended, in words."""
    made, last = sum(len(group.made) for group in searched), searched[-1]
    if made == plan.hops:
        return "all starts and hops were made"
    best = max((motion for group in searched for motion in group.motions), key=_rank, default=None)
    if last.failed >= PATIENCE and any(best is motion for motion in last.motions):
        return _chance_text(last.failed)
    if any(group.has_gained_enough for group in searched):
        return (
            f"stopped after {made} hops: {TOGETHER} more are expected to gain less than "
            f"{100 * WORTHWHILE:g} % of efficiency"
        )
    return f"{made} of {plan.hops} hops, as groups end when {PATIENCE} gain nothing"


def _chance_text(hops: int) -> str:
    """Return the chance of a better motion after so many hops without one, in words."""
    chance = 1 - (1 - _CONFIDENCE) ** (1 / hops)
    return (
        f"the last {hops} hops found nothing better: the chance that one more would is at most "
        f"{100 * chance:.2g} % (with a confidence of {100 * _CONFIDENCE:g} %)"
    )


def _finish_best(
    runner: JobRunner, plan: SearchPlan, motions: Sequence[StartResult], monitor: Monitor
) -> tuple[StartResult, list[StartResult]]:
    """Finish the best motions and prove the best of them; return that one and all finished ones.

    This process leads a proof that has not begun, and local workers bound the limits in parts of
    its cells of time. It begins the proof of a motion while a worker finishes that motion again:
    the last time this is in vain.
    """

    def bound(motion: EnclosedMotion, parts: list[Cells]) -> Iterator[CellBounds]:
        jobs = [Job(bound_part, (motion, part)) for part in parts]
        return runner.run(jobs, monitor, after_stop=True)

    def likely_jobs(known: Known, _is_idle_for_long: bool = True) -> Iterator[Job]:
        return unknown_jobs(_finish(plan, motions, monitor), known)

    def results_of(jobs: list[Job]) -> list[StartResult]:
        may_lead = plan.workers > 1 and plan.scheduler is None
        *others, last = (may_lead and [*likely_jobs(runner.known)]) or jobs
        leads = may_lead and last.function is prove_limits and not runner.has_begun(last)
        if leads or (jobs[0].function is prove_limits and runner.known(jobs[0]) is None):
            report_progress("proving the limits")
        if leads:
            with share_cells(Sharing(plan.problem.limits, lambda: runner.free, bound)):
                runner.lead(plan, last, monitor, others, likely_jobs)
        return list(runner.run(jobs, monitor, after_stop=True, foresee=foresee_nothing))

    finish = _finish(plan, motions, monitor)
    jobs = next(finish)
    while True:
        try:
            jobs = finish.send(results_of(jobs))
        except StopIteration as end:
            return end.value


def _finish(plan: SearchPlan, motions: Sequence[StartResult], monitor: Monitor) -> Procedure:
    """Finish the best motions and prove the best of them; return that one and all finished ones.

    Those that lag behind are finished if none of the others is proved, and more until one keeps
    the limits.
    """
    ranked = sorted(motions, key=_rank, reverse=True)
    *standing, value = ranked[0].rank
    close = sum(start.rank >= (*standing, value - LAG) for start in ranked[:FINISHED])
    ends = [0, close, *range(FINISHED, len(ranked), FINISHED), len(ranked)]
    tried, proved = list[StartResult](), list[StartResult]()
    for batch in (ranked[a:b] for a, b in pairwise(ends) if a < b):
        polished = yield [Job(polish_start, (start,)) for start in batch]
        tried += polished
        stopping = monitor.stop_requested()
        if stopping or any(one.check.passed for one in polished):
            proved.append((yield from _prove_best(plan, polished, monitor)))
        if stopping or any(one.check.certified or len(tried) >= FINISHED for one in proved):
            break
    if not proved:
        proved.append((yield from _prove_best(plan, tried, monitor)))
    return max(proved, key=_rank), tried


def _prove_best(plan: SearchPlan, tried: Sequence[StartResult], monitor: Monitor) -> Procedure:
    """Return the best design whose limits are all proved, among the best few.

    If there is none, the best of those examined is returned.
    """
    seen: list[StartResult] = []
    for polished in sorted(tried, key=_rank, reverse=True)[:PROVED]:
        proved = yield from prove_design(plan, monitor, polished)
        seen.append(proved)
        if proved.check.certified or monitor.stop_requested():
            break
    return max(seen, key=_rank)
