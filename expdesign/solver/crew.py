"""Who does the jobs of a search: processes of this machine, or a Dask cluster."""

from __future__ import annotations

import itertools
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from typing import Any, NamedTuple

from expdesign.solver.jobs import Build, DesignTask, SearchPlan
from expdesign.solver.stage import ENDS, SearchEvent
from expdesign.workers import Job, Monitor, cluster_jobs, run_jobs


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
