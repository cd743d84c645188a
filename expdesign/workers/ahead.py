"""Jobs done ahead by idle workers: their input may still change, then their results are not used.

A procedure is a generator that yields lists of jobs and receives their results. Run on present
data, with the results that are known, it shows which jobs are likely to follow. Jobs are compared
by their content: a result that is used is the one that the job would have had later.
"""

from __future__ import annotations

import queue
from collections.abc import Callable, Generator, Iterable, Iterator
from typing import Any

from expdesign.workers.job import Job

Procedure = Generator[list[Job], list[Any], Any]
Known = Callable[[Job], Any]
"""Returns the result of a job, None if it is unknown."""
Foresee = Callable[[Known, bool], Iterable[Job]]
"""(known results, whether workers will have no other job for long) → the jobs that may follow, as
it seems at present, the most important one first."""


def unknown_jobs(procedure: Procedure, known: Known) -> Iterator[Job]:
    """Yield the foreseeable jobs of a procedure whose results are unknown.

    The expected result of a job is assumed where it is unknown.
    """
    try:
        jobs = next(procedure)
        while True:
            results = []
            for job in jobs:
                result = known(job)
                if result is None:
                    yield job
                results.append(job.expected if result is None else result)
            if any(result is None for result in results):
                return
            jobs = procedure.send(results)
    except StopIteration:
        return


def foresee_nothing(_known: Known, _is_idle_for_long: bool) -> Iterator[Job]:
    """Have no jobs done ahead; results of those that were are used."""
    return iter(())


class JobsAhead:
    """Workers that do jobs ahead, and the results of all jobs that may be asked for again."""

    def __init__(self) -> None:
        self.answers: queue.Queue[Any] = queue.Queue()
        """Answers of these workers and of those that do required jobs at the same time."""
        self.known: dict[bytes, Any] = {}
        """Results by the key of the job."""
        self.begun = set[bytes]()
        """Keys of the jobs that have begun, even those that failed: they do not begin again."""
        self.wanted: list[Job] = []
        """Jobs to be done, the most important ones first."""
        self.busy: dict[Any, bytes] = {}
        """Key of the job of each worker."""

    def next(self) -> Job | None:
        """Return the first wanted job that has not begun."""
        return next((job for job in self.wanted if job.key not in self.begun), None)

    def claim(self, key: bytes) -> Any:
        """Return the worker that does a job, which is required now, or None."""
        worker = next((one for one, own in self.busy.items() if own == key), None)
        if worker is not None:
            del self.busy[worker]
        return worker

    def end_one(self, *, unwanted: bool = False) -> bool:
        """End the worker that began last, perhaps only one whose job is not wanted any more."""
        kept = {job.key for job in self.wanted} if unwanted else ()
        worker = next((one for one in reversed(self.busy) if self.busy[one] not in kept), None)
        if worker is None:
            return False
        self.begun.discard(self.busy.pop(worker))
        worker.end()
        return True

    def end_all_but(self, keys: Iterable[bytes]) -> None:
        """End the workers of all other jobs."""
        kept, self.wanted = set(keys), []
        for worker in [one for one, key in self.busy.items() if key not in kept]:
            self.begun.discard(self.busy.pop(worker))
            worker.end()
