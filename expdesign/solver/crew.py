"""Who does the jobs of a search: processes of this machine, or a Dask cluster."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
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
        self, jobs: Sequence[Job], monitor: Monitor, *, after_stop: bool = False
    ) -> Iterator[Any]:
        """Yield the results of jobs in their order; of fewer where a stop was requested.

        With `after_stop` they begin although it has been.
        """
        timed = [Job(_timed, (number, job)) for number, job in enumerate(jobs)]
        if self._plan.scheduler is not None:
            yield from self._in_cluster(self._plan.scheduler, timed, monitor, after_stop=after_stop)
            return
        for done in run_jobs(
            self._build, timed, self._plan.workers, monitor, after_stop=after_stop
        ):
            self.cpu_seconds += done.seconds
            yield done.result

    def _in_cluster(
        self, scheduler: str, jobs: Sequence[Job], monitor: Monitor, *, after_stop: bool
    ) -> Iterator[Any]:
        if monitor.stop_requested() and not after_stop:
            return
        found: dict[int, Any] = {}

        def stopped() -> bool:
            return monitor.stop_requested() and not after_stop

        for done in cluster_jobs(scheduler, self._build, jobs, stopped):
            self.cpu_seconds += done.seconds
            found[done.number] = done.result
            for event in done.ends:  # the cluster's own monitors are silent
                monitor.report(event)
        yield from (result for _, result in sorted(found.items()))


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
