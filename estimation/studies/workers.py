"""The jobs of a study on local processes, with their number as progress and in their order."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from estimation.montecarlo import StudyMonitor
from estimation.montecarlo.monitor import StopRequest
from expdesign.configuration import RunConfiguration
from expdesign.workers import Job, run_jobs


class StudyInterruptedError(RuntimeError):
    """The study was stopped before everything that it compares was there."""


def results_of(
    configuration: RunConfiguration,
    build: Callable[[], Any],
    jobs: Sequence[Job],
    monitor: StudyMonitor | None,
    progress: tuple[int, int],
) -> Iterator[Any]:
    """Yield the results of the jobs in their order.

    Parameters
    ----------
    configuration : RunConfiguration
        Whose `workers` do them; a scheduler is not used.
    build : callable
        Makes what every job gets first, once per process.
    progress : (int, int)
        Jobs of the study that are done before these, and all of them.

    Raises
    ------
    StudyInterruptedError
        A stop was requested.
    """
    done, total = progress
    count = 0
    for result in run_jobs(build, jobs, configuration.run.workers or 1, StopRequest(monitor)):
        count += 1
        if monitor is not None:
            monitor.advanced(done + count, total)
        yield result
    if count < len(jobs):
        raise StudyInterruptedError(f"interrupted after {done + count} of {total} steps")
